//! A camera that moves around a mesh of a million triangles, frame after frame into one buffer.
//!
//! `cargo run --release -p rayo --example moving_camera` prints how long a frame takes, and its
//! parts. No tree is built: for each frame the mesh is transformed to the camera's frame, in memory
//! that is reused, then planned and traced. A scene that was read is moved in the same way, in the
//! coordinates of its file. It needs only the library, without its default features.

use std::error::Error;
use std::thread::available_parallelism;
use std::time::{Duration, Instant};

use rayo::glam::{DVec3, Vec3};
use rayo::{
    Camera, Engine, Faces, Film, Frame, Light, MovingCamera, PixelFormat, Plan, Purpose, Scene, Settings, View,
};

/// A ring around the y axis, under one light: `around` times `across` faces of four corners, each
/// of two triangles.
fn ring(around: u32, across: u32, camera: Camera) -> Scene {
    let angle = |part: u32, of: u32| std::f32::consts::TAU * part as f32 / of as f32;
    let vertex = |i: u32| {
        let ((sin, cos), (up, out)) = (angle(i / across, around).sin_cos(), angle(i % across, across).sin_cos());
        Vec3::new((1.0 + 0.35 * out) * cos, 0.35 * up, (1.0 + 0.35 * out) * sin)
    };
    let corners = (0..around * across).flat_map(|i| {
        let corner = |a: u32, b: u32| (i / across + a) % around * across + (i % across + b) % across;
        [[corner(0, 0), corner(1, 0), corner(1, 1)], [corner(0, 0), corner(1, 1), corner(0, 1)]]
    });
    let vertices = (0..around * across).map(vertex).collect();
    Scene {
        lights: vec![Light { intensity: 1.0, colour: Vec3::ONE, position: Vec3::new(-4.0, 6.0, -3.0) }],
        faces: Faces::new(vertices, corners.collect(), Vec3::new(1.0, 0.6, 0.2)),
        ..Scene::new(camera)
    }
}

/// One of `frames` places around the ring, and slightly above it.
fn place(frame: u32, frames: u32) -> View {
    let (sin, cos) = (std::f64::consts::TAU * f64::from(frame) / f64::from(frames)).sin_cos();
    View { position: DVec3::new(3.0 * sin, 1.2, -3.0 * cos), look_at: DVec3::ZERO, up: DVec3::Y }
}

/// Renders the world from `frames` places: `show` gets every picture, and the times to transform,
/// plan and trace it.
fn go_round(
    world: &Scene,
    frames: u32,
    threads: usize,
    mut show: impl FnMut(&Film, [Duration; 3]),
) -> Result<(), Box<dyn Error>> {
    let purpose = Purpose { format: Some(PixelFormat::Rgba8), threads, ..Purpose::default() };
    let mut film = Film::new(PixelFormat::Rgba8, world.camera.pixels() as usize)?;
    let mut camera = MovingCamera::of(world);
    for number in 0..frames {
        let start = Instant::now();
        let scene = camera.seen_from(place(number, frames))?;
        let moved = start.elapsed();
        let plan = Plan::new(Engine::fastest(), scene, purpose)?;
        // Its threads are those of the plan, and of the previous frame.
        let frame = Frame::new(plan.tracer(), scene.camera, Settings { threads })?;
        let planned = start.elapsed();
        frame.trace(0..scene.camera.height(), film.as_mut(), &|_rows| {})?;
        show(&film, [moved, planned - moved, start.elapsed() - planned]);
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let world = ring(1000, 500, Camera::new(1632, 1224, 1.0, 1.0)?);
    let threads = available_parallelism()?.get();
    println!("{} triangles, {} pixels, {threads} threads", world.faces.len(), world.camera.pixels());
    let mut times = Vec::new();
    go_round(&world, 120, threads, |_film, parts| times.push(parts.map(|part| 1e3 * part.as_secs_f64())))?;
    times.sort_by_key(|parts| Duration::from_secs_f64(parts.iter().sum()));
    for (name, [moved, planned, traced]) in [("fastest", times[0]), ("median", times[times.len() / 2])] {
        let all = moved + planned + traced;
        println!("{name}: moved {moved:.2}, planned {planned:.2}, traced {traced:.2}: {all:.2} ms, {:.0}/s", 1e3 / all);
    }
    Ok(())
}

#[test]
fn every_frame_is_the_picture_of_the_scene_seen_from_there() {
    let world = ring(100, 25, Camera::new(64, 48, 1.0, 1.0).unwrap());
    let mut number = 0;
    go_round(&world, 5, 2, |film, _| {
        let scene = world.seen_from(place(number, 5)).unwrap();
        let mut alone = Film::new(PixelFormat::Rgba8, film.len()).unwrap();
        Engine::fastest().prepare(None, &scene).unwrap().rows(0..48, alone.as_mut());
        let lit = |film: &Film| (0..film.len()).map(|pixel| film.colour(pixel).levels()).collect::<Vec<_>>();
        assert_eq!(lit(film), lit(&alone), "frame {number}");
        assert!(lit(film).iter().filter(|[red, ..]| *red > 100).count() > 300, "frame {number}");
        number += 1;
    })
    .unwrap();
    assert_eq!(number, 5);
}
