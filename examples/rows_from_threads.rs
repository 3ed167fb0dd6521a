//! Rows of a picture from your own threads: a prepared engine writes any rows, in any order, from any thread.
//!
//! `cargo run --release --example rows_from_threads`. In this way a renderer can use another scheduler, or trace first
//! what matters most. It needs only the library, without its default features.

use std::error::Error;
use std::sync::Mutex;
use std::thread;

use rayo::kernels::Vec4;
use rayo::render::{FilmMut, Tracer};
use rayo::scene::many;
use rayo::{Engine, Scene};

/// All rows by this many threads, each of which takes the next few rows when it has finished its last.
fn render(tracer: &dyn Tracer, scene: &Scene, threads: usize) -> Vec<Vec4> {
    let (width, height) = (scene.camera.width() as usize, scene.camera.height());
    // Any number would do. An engine that works in tiles is fastest with as many rows as a tile has, or a multiple.
    let together = tracer.rows_together();
    let mut picture = vec![Vec4::default(); width * height as usize];
    let pieces = Mutex::new((0..height).step_by(together as usize).zip(picture.chunks_mut(together as usize * width)));
    let next = || pieces.lock().expect("no thread has panicked").next();
    thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                while let Some((start, pixels)) = next() {
                    let rows = start..height.min(start + together);
                    // The buffer is as long as the rows, and its type decides the pixel format: here linear colours.
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
    let (scene, engine) = (many(300, 300, 1), Engine::fastest());
    let tracer = engine.prepare(None, &scene)?;
    for threads in [1, 2, 3] {
        println!("{engine}, threads: {threads}, mean red {:.6}", mean(&render(&*tracer, &scene, threads)));
    }
    Ok(())
}

#[test]
fn however_many_threads_there_are_the_picture_is_that_of_one_call() {
    // 70 rows: not a whole number of tiles.
    let camera = rayo::scene::Camera::new(90, 70, 1.0, 1.0).unwrap();
    let scene = Scene { camera, ..many(40, 40, 1) };
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
