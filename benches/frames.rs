//! Whole frames, one group per scene, with a row for each engine and pixel format that this machine
//! has.
//!
//! `frame`: one thread, into memory that was written before, 320 x 240 pixels. `many`: from the
//! parsed scene to the last of 1632 x 1224 pixels in RGBA8, including set-up, by the packet
//! engines; by the fastest one also in `double` and on two threads. criterion runs the rows one
//! after the other; for reliable ratios use `rayo experiment`, which interleaves its contestants.

use std::time::Duration;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3;
use rayo::internals::plan::Keep;
use rayo::internals::render::{Engine, Film, Frame, PixelFormat, Plan, Precision, Purpose, Settings};
use rayo::internals::scene::mesh::shapes::icosphere;
use rayo::internals::scene::{Camera, Light, MeshFormat, Scene, Setting, Sphere, Triangle, many};

const SEED: u64 = 1;

fn lamp(position: Vec3) -> Light {
    Light { intensity: 0.5, colour: Vec3::ONE, position }
}

/// One light and no objects, with 320 x 240 pixels at focal distance 1 and film 1.
fn empty() -> Scene {
    let camera = Camera::new(320, 240, 1.0, 1.0).expect("a camera within the limits");
    let light = lamp(Vec3::new(-4.0, 5.0, 0.0));
    Scene { lights: vec![light], ..Scene::new(camera) }
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

/// The sphere under eight lights around it.
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

fn many_objects(c: &mut Criterion) {
    let fastest = Engine::fastest();
    if !fastest.is_packet() {
        return;
    }
    let camera = empty().camera.sized(1632, 1224).expect("a camera within the limits");
    let scattered = |scene: Scene| Scene { camera, lights: empty().lights, ..scene };
    let mesh = |count| {
        let mesh = icosphere(count, 0.3, SEED);
        let setting = Setting::of(&mesh, MeshFormat::Obj, &camera);
        let scene = setting.and_then(|setting| setting.scene(mesh, "mesh".to_owned()));
        scene.expect("a mesh of ordinary size")
    };
    for (name, scene) in [
        ("thousand_spheres", scattered(many(1000, 0, SEED))),
        ("thousand_triangles", scattered(many(0, 1000, SEED))),
        ("mesh_70k", mesh(70_000)),
        ("mesh_1M", mesh(1_000_000)),
    ] {
        let mut group = c.benchmark_group(format!("many/{name}"));
        group.throughput(Throughput::Elements(camera.pixels()));
        let mut film = Film::new(PixelFormat::Rgba8, camera.pixels() as usize).expect("memory");
        let packets = Engine::ALL.iter().copied().filter(|engine| engine.usable() && engine.is_packet());
        let mut rows: Vec<_> = packets.map(|engine| (engine, None, 1)).collect();
        rows.extend([(fastest, Some(Precision::Double), 1), (fastest, None, 2)]);
        for (engine, precision, threads) in rows {
            let named = precision.map(|precision| format!("/{precision}")).unwrap_or_default();
            group.bench_function(format!("{engine}{named}/{threads}"), |bencher| {
                bencher.iter(|| {
                    let format = Some(PixelFormat::Rgba8);
                    let purpose =
                        Purpose { precision, format, keep: Keep::NOTHING, threads, cancel: None, in_bands: false };
                    let plan = Plan::new(engine, &scene, purpose).expect("a scene that engines take");
                    let frame = Frame::new(plan.tracer(), camera, Settings { threads }).expect("threads");
                    frame.trace(0..camera.height(), film.as_mut(), &|_| ()).unwrap();
                });
            });
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
    targets = frames, many_objects
}
criterion_main!(benches);
