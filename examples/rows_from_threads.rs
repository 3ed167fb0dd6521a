//! Rows of a picture from your own threads: a prepared engine writes any rows, in any order, from
//! any thread.
//!
//! `cargo run --release -p rayo --example rows_from_threads` runs it. In this way a renderer can
//! use another scheduler, or trace first what matters most. It needs only the library, without its
//! default features.

use std::error::Error;
use std::sync::Mutex;
use std::thread;

use rayo::glam::Vec3;
use rayo::{Camera, Engine, FilmMut, Light, Scene, Sphere, Tracer, Vec4};

/// A spiral of balls that goes away from the camera.
fn spiral(balls: u16, camera: Camera) -> Scene {
    let ball = |n: u16| {
        let (sin, cos) = (0.7 * f32::from(n)).sin_cos();
        let centre = Vec3::new(2.0 * cos, 2.0 * sin, 4.0 + 0.1 * f32::from(n));
        Sphere { radius: 0.4, colour: Vec3::new(1.0, 0.7, 0.3), centre }
    };
    Scene {
        lights: vec![Light { intensity: 1.0, colour: Vec3::ONE, position: Vec3::new(-3.0, 5.0, 0.0) }],
        spheres: (0..balls).map(ball).collect(),
        ..Scene::new(camera)
    }
}

/// Traces all rows with this many threads. Each takes the next few rows whenever it has finished
/// its last ones.
fn render(tracer: &dyn Tracer, scene: &Scene, threads: usize) -> Vec<Vec4> {
    let (width, height) = (scene.camera.width() as usize, scene.camera.height());
    // Any number of rows is possible. An engine that works in tiles is fastest with as many as a
    // tile has, or a multiple.
    let together = tracer.rows_together();
    let mut picture = vec![Vec4::default(); width * height as usize];
    let pieces = Mutex::new((0..height).step_by(together as usize).zip(picture.chunks_mut(together as usize * width)));
    let next = || pieces.lock().expect("no thread has panicked").next();
    thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while let Some((start, pixels)) = next() {
                    let rows = start..height.min(start + together);
                    // The buffer is as long as the rows, and its type decides the pixel format:
                    // here linear colours.
                    tracer.rows(rows, FilmMut::F32x4(pixels));
                }
            });
        }
    });
    picture
}

/// The mean of the red of all pixels.
fn mean(picture: &[Vec4]) -> f64 {
    picture.iter().map(|pixel| f64::from(pixel.x)).sum::<f64>() / picture.len() as f64
}

fn main() -> Result<(), Box<dyn Error>> {
    let (scene, engine) = (spiral(300, Camera::new(800, 600, 1.0, 1.0)?), Engine::fastest());
    let tracer = engine.prepare(None, &scene)?;
    for threads in [1, 2, 3] {
        println!("{engine}, threads: {threads}, mean red {:.6}", mean(&render(&*tracer, &scene, threads)));
    }
    Ok(())
}

#[test]
fn threads_change_no_picture() {
    // 70 rows: not a whole number of tiles.
    let scene = spiral(40, Camera::new(90, 70, 1.0, 1.0).unwrap());
    for engine in Engine::ALL.iter().filter(|engine| engine.usable()) {
        let tracer = engine.prepare(None, &scene).unwrap();
        let mut whole = vec![Vec4::default(); scene.camera.pixels() as usize];
        tracer.rows(0..scene.camera.height(), FilmMut::F32x4(&mut whole));
        assert!(mean(&whole) > 0.01, "{engine} shows nothing");
        for threads in [1, 3] {
            assert_eq!(render(&*tracer, &scene, threads), whole, "{engine}, {threads} threads");
        }
    }
}
