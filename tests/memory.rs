//! How much memory a picture of many objects takes beside its scene.
#![cfg(rayo_asm)]
#![allow(unsafe_code)] // the counting allocator

mod counting;

use counting::peak_of;
use glam::Vec3;
use rayo::plan::Keep;
use rayo::render::{Engine, Film, PixelFormat, Purpose};
use rayo::scene::mesh::shapes::icosphere;
use rayo::scene::{Camera, MeshFormat, Rng, Scene, Setting, Triangle};

/// Triangles at random places in front of the camera, as wide as `size` pixels or so.
fn spread(triangles: usize, size: f32, camera: Camera) -> Scene {
    let mut rng = Rng::new(1);
    let pixel = camera.film() / camera.focal() / (camera.width() as f32).hypot(camera.height() as f32);
    let triangles = (0..triangles).map(|_| {
        let depth = rng.between(5.0, 50.0);
        let middle = Vec3::new(rng.between(-0.4, 0.4), rng.between(-0.3, 0.3), 1.0) * depth;
        let reach = 0.5 * size * pixel * depth;
        let corners = [[0; 3]; 3].map(|corner| Vec3::from(corner.map(|_| rng.between(-reach, reach))));
        Triangle { colour: Vec3::ONE, vertices: corners.map(|corner| middle + corner) }
    });
    Scene { triangles: triangles.collect(), ..rayo::scene::many(0, 0, 1) }
}

#[test]
fn a_triangle_takes_at_most_200_bytes_beside_the_scene() {
    /// What does not grow with the number: the tile that is worked on, and the places of all tiles.
    const FIXED: usize = 1 << 20;
    let camera = Camera::new(1632, 1224, 1.0, 1.0).unwrap();
    let mesh = icosphere(100_000, 0.1, 1);
    let setting = Setting::of(&mesh, MeshFormat::Obj, &camera).unwrap();
    let mesh = setting.scene(&mesh, Vec3::ONE, "mesh.png".into(), camera).unwrap();
    let mut scenes = vec![("mesh", mesh)];
    for size in [40.0, 120.0, 160.0, 2000.0] {
        scenes.push(("spread", spread(60_000, size, camera)));
    }
    // What is kept does not depend on the instruction set.
    let engine = Engine::fastest();
    for (name, scene) in scenes {
        let count = scene.triangles.len();
        for &precision in engine.precisions() {
            let purpose = Purpose {
                precision: Some(precision),
                format: Some(PixelFormat::Rgb8),
                keep: Keep::NOTHING,
                threads: 1,
            };
            let mut film = Film::new(PixelFormat::Rgb8, camera.pixels() as usize).unwrap();
            let ((), peak) = peak_of(|| {
                let tracer = engine.prepare_for(purpose, &scene, &camera).unwrap();
                tracer.rows(0..camera.height(), film.as_mut());
            });
            let each = peak.saturating_sub(FIXED) as f64 / count as f64;
            assert!(each <= 200.0, "{name} of {count} by {engine} in {precision}: {peak} bytes, {each:.1} for each");
        }
    }
}
