//! What is under a pixel: the object that a click has met, its place and its normal, and the object
//! painted red.
//!
//! `cargo run --release -p rayo --example pick_a_pixel` shows both pictures in letters. It needs
//! only the library, without its default features.

use std::error::Error;

use rayo::glam::{DVec3, Vec3};
use rayo::{Camera, Engine, Film, Frame, Hit, Light, Object, PixelFormat, Scene, Settings, Sphere, View};

/// Nine grey balls in a square.
fn balls() -> Result<Scene, Box<dyn Error>> {
    let ball = |n: u8| Sphere {
        radius: 0.8,
        colour: Vec3::splat(0.5),
        centre: Vec3::new(2.0 * f32::from(n % 3) - 2.0, 2.0 * f32::from(n / 3) - 2.0, 0.0),
    };
    Ok(Scene {
        lights: vec![Light { intensity: 1.0, colour: Vec3::ONE, position: Vec3::new(-6.0, 6.0, -9.0) }],
        spheres: (0..9).map(ball).collect(),
        ..Scene::new(Camera::new(64, 48, 1.0, 1.0)?)
    })
}

/// The picture of a scene, and what is at one of its pixels; both by the same rays, so that they
/// cannot differ.
fn look(scene: &Scene, [column, row]: [u32; 2]) -> Result<(Film, Option<Hit>), Box<dyn Error>> {
    let tracer = Engine::fastest().prepare(None, scene)?;
    let frame = Frame::new(&*tracer, scene.camera, Settings { threads: 1 })?;
    let mut film = frame.film(PixelFormat::Rgba8, scene.camera.height())?;
    frame.trace(0..scene.camera.height(), film.as_mut(), &|_rows| {})?;
    Ok((film, frame.hit(column, row)))
}

/// A letter for each pixel of every other row: `#` where it is red, `o` where it is not black.
fn letters(film: &Film, camera: &Camera) -> String {
    let letter = |pixel: u32| match film.colour(pixel as usize).levels() {
        [0, 0, 0] => ' ',
        [_, 0, 0] => '#',
        _ => 'o',
    };
    let row = |row: u32| (0..camera.width()).map(move |column| letter(row * camera.width() + column));
    (0..camera.height()).step_by(2).map(|number| row(number).collect::<String>() + "\n").collect()
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut world = balls()?;
    let view = View { position: DVec3::new(3.0, 2.0, -9.0), look_at: DVec3::ZERO, up: DVec3::Y };
    let click = [44, 20];
    let scene = world.seen_from(view)?;
    let (film, hit) = look(&scene, click)?;
    println!("{}", letters(&film, &scene.camera));
    let Some(Hit { object, place, normal }) = hit else {
        println!("there is nothing at {click:?}");
        return Ok(());
    };
    // The place is in the camera's frame: z is the depth.
    println!("at {click:?} is {object:?}, {:.3} in front of the camera; its normal is {normal:?}", place.z);
    // Objects keep their numbers wherever the camera stands.
    if let Object::Sphere(number) = object {
        world.spheres[number].colour = Vec3::X;
    }
    println!("{}", letters(&look(&world.seen_from(view)?, click)?.0, &scene.camera));
    Ok(())
}

#[test]
fn every_ball_is_found_at_the_pixel_that_shows_its_middle() {
    let world = balls().unwrap();
    let scene = world.seen_from(View { position: -9.0 * DVec3::Z, look_at: DVec3::ZERO, up: DVec3::Y }).unwrap();
    let camera = scene.camera;
    for (number, ball) in scene.spheres.iter().enumerate() {
        // A film of diagonal 1 is 0.8 wide and 0.6 high.
        let across = |part: f32, sides: u32| (f32::from(sides as u16) * (0.5 + part)) as u32;
        let column = across(ball.centre.x / ball.centre.z / 0.8, camera.width());
        let row = across(-ball.centre.y / ball.centre.z / 0.6, camera.height());
        let hit = look(&scene, [column, row]).unwrap().1.expect("a ball");
        assert_eq!(hit.object, Object::Sphere(number));
        assert!((hit.place.distance(ball.centre.as_dvec3()) - 0.8).abs() < 1e-5);
        assert!(hit.normal.is_none_or(|normal| normal.z < -0.9));
    }
    assert_eq!(look(&scene, [0, 0]).unwrap().1, None);
}
