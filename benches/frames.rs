//! Whole frames, one group per scene, with a row for each engine and pixel format that this machine has.
//!
//! One thread, into memory that was touched before, 320 x 240 pixels. criterion runs the rows one after the other;
//! ratios to rely on come from `rayo experiment`, which interleaves its contestants.

use std::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3;
use rayo::render::{Engine, Film, PixelFormat};
use rayo::scene::{Camera, Faces, Light, Scene, Sphere, Triangle, many};

const SEED: u64 = 1;

fn lamp(position: Vec3) -> Light {
    Light { intensity: 0.5, colour: Vec3::ONE, position }
}

/// One light and no objects, with 320 x 240 pixels at focal distance 1 and film 1.
fn empty() -> Scene {
    let camera = Camera::new(320, 240, 1.0, 1.0).expect("a camera within the limits");
    let light = lamp(Vec3::new(-4.0, 5.0, 0.0));
    Scene {
        name: "bench".to_owned(),
        camera,
        lights: vec![light],
        spheres: Vec::new(),
        triangles: Vec::new(),
        faces: Faces::default(),
    }
}

/// The experiment of the paper: a sphere that covers about half of the picture.
fn sphere() -> Scene {
    let sphere = Sphere { radius: 2.2, colour: Vec3::new(0.9, 0.5, 0.2), centre: Vec3::new(0.0, 0.0, 10.0) };
    Scene { spheres: vec![sphere], ..empty() }
}

fn tetrahedron() -> Scene {
    let corners = [[-3.0, -2.0, 12.0], [3.0, -2.0, 12.0], [0.0, -2.0, 8.0], [0.0, 3.0, 10.0]].map(Vec3::from);
    let faces = [[0, 1, 2], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    let face = |face: [usize; 3]| Triangle { colour: Vec3::new(0.3, 0.7, 0.9), vertices: face.map(|i| corners[i]) };
    Scene { triangles: faces.map(face).to_vec(), ..empty() }
}

/// The sphere under eight lights about it.
fn eight_lights() -> Scene {
    let corner = |i: u32, bit: u32| if i >> bit & 1 == 0 { -6.0 } else { 6.0 };
    let lights = (0..8).map(|i| lamp(Vec3::new(corner(i, 0), corner(i, 1), 4.0 + corner(i, 2))));
    Scene { lights: lights.collect(), ..sphere() }
}

fn frames(c: &mut Criterion) {
    let small = |scene: Scene| Scene { camera: empty().camera, ..scene };
    for (name, scene) in [
        ("sphere", sphere()),
        ("tetrahedron", tetrahedron()),
        ("hundred_spheres", small(many(100, 0, SEED))),
        ("hundred_triangles", small(many(0, 100, SEED))),
        ("thousand_spheres", small(many(1000, 0, SEED))),
        ("thousand_triangles", small(many(0, 1000, SEED))),
        ("eight_lights", eight_lights()),
    ] {
        let camera = scene.camera;
        let mut group = c.benchmark_group(format!("frame/{name}"));
        group.throughput(Throughput::Elements(camera.pixels()));
        for engine in Engine::ALL.iter().filter(|engine| engine.usable()) {
            let tracer = engine.prepare(None, &scene).expect("an engine that can be used");
            for format in PixelFormat::ALL {
                if !tracer.writes(format) {
                    continue;
                }
                let mut film = Film::new(format, camera.pixels() as usize).expect("memory");
                group.bench_function(format!("{engine}/{}", format.name()), |bencher| {
                    bencher.iter(|| tracer.rows(0..camera.height(), film.as_mut()));
                });
            }
        }
        group.finish();
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    targets = frames
}
criterion_main!(benches);
