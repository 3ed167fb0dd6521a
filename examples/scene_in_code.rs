//! A scene built in code and rendered into a buffer on every core: no file is read and none is
//! written.
//!
//! `cargo run --release -p rayo --example scene_in_code` shows it in letters. It needs only the
//! library: `rayo = { path = "../rayo", default-features = false, features = ["asm", "c"] }`, or
//! without these features the engines in Rust.

use std::error::Error;
use std::thread::available_parallelism;

use rayo::glam::Vec3;
use rayo::{Camera, Engine, Film, Frame, Light, PixelFormat, Scene, Settings, Sphere, Triangle};

/// A ball above a floor, under one light. The pinhole is at the origin; x points to the right, y
/// up, and z away.
fn ball() -> Result<Scene, Box<dyn Error>> {
    let [near, far] = [2.0, 30.0].map(|z| [-20.0, 20.0].map(|x| Vec3::new(x, -1.5, z)));
    let grey = Vec3::splat(0.6);
    Ok(Scene {
        name: "ball.png".into(),
        lights: vec![Light { intensity: 1.0, colour: Vec3::ONE, position: Vec3::new(-6.0, 6.0, 0.0) }],
        spheres: vec![Sphere { radius: 1.0, colour: Vec3::new(1.0, 0.6, 0.2), centre: Vec3::new(0.0, 0.0, 6.0) }],
        // A triangle is two-sided, so that the order of its corners does not matter.
        triangles: vec![
            Triangle { colour: grey, vertices: [near[0], near[1], far[0]] },
            Triangle { colour: grey, vertices: [near[1], far[1], far[0]] },
        ],
        // Pixels in a row and in a column, the focal distance, and the diagonal of the film.
        ..Scene::new(Camera::new(64, 32, 1.0, 1.0)?)
    })
}

/// The picture by an engine: linear red, green and blue of every pixel, row by row.
fn render(scene: &Scene, engine: Engine) -> Result<Film, Box<dyn Error>> {
    // The plan decides which work this scene does not need. An invalid scene, with a NaN for
    // example, is an error.
    let tracer = engine.prepare(None, scene)?;
    let threads = available_parallelism()?.get();
    // The threads of a frame are kept for its next picture; the closure is for a progress bar.
    let frame = Frame::new(&*tracer, scene.camera, Settings { threads })?;
    let mut film = frame.film(PixelFormat::F32x4, scene.camera.height())?;
    frame.trace(0..scene.camera.height(), film.as_mut(), &|_rows| {})?;
    Ok(film)
}

/// A letter for each pixel, denser for a brighter red, from 0 to 255.
fn letters(film: &Film, camera: &Camera) -> String {
    const LETTERS: &[u8] = b" .:-=+*#";
    let letter = |pixel: u32| LETTERS[usize::from(film.colour(pixel as usize).levels()[0] / 32)] as char;
    let row = |row: u32| (0..camera.width()).map(|column| letter(row * camera.width() + column)).collect::<String>();
    (0..camera.height()).map(|number| row(number) + "\n").collect()
}

fn main() -> Result<(), Box<dyn Error>> {
    let (scene, engine) = (ball()?, Engine::fastest());
    println!("{}by {engine}", letters(&render(&scene, engine)?, &scene.camera));
    Ok(())
}

#[test]
fn engines_show_the_ball_on_the_floor_below_the_sky() {
    let scene = ball().unwrap();
    for engine in Engine::ALL.iter().filter(|engine| engine.usable()) {
        let picture = letters(&render(&scene, *engine).unwrap(), &scene.camera);
        let rows: Vec<_> = picture.lines().collect();
        assert_eq!((rows.len(), rows[0].len()), (32, 64), "{engine}");
        assert!(rows[0].trim().is_empty() && rows[31].trim().len() == 64, "{engine}:\n{picture}");
        // The ball's lit side is the left one.
        let (first, last) = (rows[12].find('#'), rows[12].rfind('#'));
        assert!(first > Some(18) && last > first && last < Some(32), "{engine}:\n{picture}");
    }
}
