//! What is left out makes no difference: each omission alone and all together, to the last bit, and what is told of them.

#![cfg(rayo_asm)]

mod contenders;

use contenders::{Contender, Truth, contenders, film};
use glam::{Vec3, vec3};
use rayo::plan::{Keep, Omission, Switch};
use rayo::render::{Film, PixelFormat, Purpose};
use rayo::scene::{Camera, Light, Rng, Scene, Sphere, Triangle, many};

/// The packet engines in all of their precisions, as far as this machine runs them.
fn packets() -> Vec<Contender> {
    let packet = |contender: &Contender| ["sse41", "avx2", "avx512"].contains(&contender.engine.name());
    contenders().into_iter().filter(packet).collect()
}

/// The bytes of a picture.
fn picture(contender: &Contender, scene: &Scene, format: PixelFormat, keep: Keep) -> Vec<u8> {
    let purpose = Purpose { precision: Some(contender.precision), format: Some(format), keep };
    let tracer = contender.engine.prepare_for(purpose, scene, &scene.camera).unwrap();
    match film(tracer.as_ref(), scene.camera, 1, format) {
        Film::F32x4(pixels) => pixels.into_iter().flat_map(|v| v.lanes()).flat_map(f32::to_le_bytes).collect(),
        Film::Rgba8(pixels) => pixels.concat(),
    }
}

/// Holds the picture with `keep` against the one without.
fn check(contender: &Contender, scene: &Scene, keep: Keep, what: &str) {
    for format in [PixelFormat::F32x4, PixelFormat::Rgba8] {
        let planned = picture(contender, scene, format, Keep::NOTHING);
        let kept = picture(contender, scene, format, keep);
        if let Some(at) = planned.iter().zip(&kept).position(|(a, b)| a != b) {
            let pixel = at / format.bytes();
            let (row, col) = (pixel / scene.camera.width() as usize, pixel % scene.camera.width() as usize);
            let bytes = |picture: &[u8]| picture[pixel * format.bytes()..][..format.bytes()].to_vec();
            panic!(
                "{what}: {contender} writes {:?} planned and {:?} with more work as {} at row {row}, column {col}: {scene:?}",
                bytes(&planned),
                bytes(&kept),
                format.name()
            );
        }
    }
}

fn camera(width: u32, height: u32, focal: f32, film: f32) -> Camera {
    Camera::new(width, height, focal, film).unwrap()
}

/// A scene of few small numbers: 12 x 16 rays through whole or half numbers, objects whose vertices, outlines and centres
/// fall on rays, on the border of the picture, on each other and on lights, before the camera and behind it.
fn on_borders(rng: &mut Rng) -> Scene {
    // Of `camera(12, 16, f, 20)` the ray of row and col is (col - 5.5, 7.5 - row, f).
    let focal = [2.0, 8.0, 16.0][(rng.next_u64() % 3) as usize];
    let mut number = |low: i32, high: i32| (low + (rng.next_u64() % (high - low + 1) as u64) as i32) as f32;
    let mut colours = [Vec3::ONE, Vec3::X, vec3(0.5, 0.5, 0.5), vec3(0.25, 1.0, 0.75), Vec3::ZERO].into_iter().cycle();
    let mut colour = || colours.next().unwrap();
    // A point on a ray or on the border between two, as likely in front of the camera as not in the frustum.
    let mut point = || {
        let z = number(-2, 6) * focal / 2.0;
        vec3(number(-16, 16) * z / focal / 2.0, number(-20, 20) * z / focal / 2.0, z)
    };
    let points: Vec<Vec3> = (0..6).map(|_| point()).collect();
    let mut pick = {
        let mut rng = Rng::new(rng.next_u64());
        move || points[(rng.next_u64() % points.len() as u64) as usize]
    };
    let count = |rng: &mut Rng, most: u64| (rng.next_u64() % (most + 1)) as usize;
    let (spheres, triangles, lights) = (count(rng, 4), count(rng, 6), count(rng, 3));
    let spheres = (0..spheres)
        .map(|i| {
            let (centre, towards) = (pick(), pick());
            // Through another point, or of a whole radius.
            let through = (towards - centre).length();
            let radius = if i % 2 == 0 && through > 0.0 { through } else { 1.0 + i as f32 };
            Sphere { radius, colour: colour(), centre }
        })
        .collect();
    let triangles = (0..triangles).map(|_| Triangle { colour: colour(), vertices: [pick(), pick(), pick()] }).collect();
    let lights = (0..lights)
        .map(|i| Light {
            intensity: [1.0, 0.0, 3.0][i],
            colour: [Vec3::ONE, Vec3::ONE, vec3(0.5, 0.0, 1.0)][i],
            position: pick(),
        })
        .collect();
    Scene { name: "borders.png".into(), camera: camera(12, 16, focal, 20.0), lights, spheres, triangles }
}

#[test]
fn brute_force_makes_the_same_bytes_where_everything_is_on_a_border() {
    let seed = 41;
    let mut rng = Rng::new(seed);
    for case in 0..300 {
        let scene = on_borders(&mut rng);
        for contender in packets() {
            check(&contender, &scene, Keep::all(), &format!("seed {seed}, case {case}"));
        }
    }
}

/// Scenes of every kind: few and many objects, lights from none to eight, some of them dark, one colour for all or not,
/// the camera inside a sphere, and objects that nobody sees.
fn scenes() -> Vec<(String, Scene)> {
    let mut scenes = Vec::new();
    let table =
        [(0, 0, 51), (1, 0, 52), (0, 1, 53), (30, 0, 54), (0, 30, 55), (20, 20, 56), (3, 150, 57), (150, 3, 58)];
    for (i, (spheres, triangles, seed)) in table.into_iter().enumerate() {
        for lights in [0, 1, 2, 8] {
            let (width, height) = [(67, 31), (100, 3), (1, 40), (203, 151)][(i + lights) % 4];
            let mut scene = Scene { camera: camera(width, height, 1.0, 1.0), ..many(spheres, triangles, seed) };
            let first = scene.lights[0];
            scene.lights.truncate(lights);
            for i in 2..lights {
                let position = vec3(10.0 * i as f32, -7.0, 20.0 + i as f32);
                let colour = [Vec3::ZERO, Vec3::X, Vec3::ONE][i % 3];
                scene.lights.push(Light { intensity: if i == 5 { 0.0 } else { 0.3 * i as f32 }, colour, position });
            }
            scene.spheres.iter_mut().skip(1).step_by(3).for_each(|sphere| sphere.colour = Vec3::ONE);
            scene.triangles.iter_mut().skip(1).step_by(3).for_each(|triangle| triangle.colour = Vec3::Y);
            // In the light, behind the camera, beside the picture, of no area, edge on.
            scene.spheres.push(Sphere { radius: 0.5, colour: Vec3::ONE, centre: first.position });
            scene.spheres.push(Sphere { radius: 4.0, colour: Vec3::ONE, centre: vec3(0.0, 0.0, -9.0) });
            scene.spheres.push(Sphere { radius: 4.0, colour: Vec3::ONE, centre: vec3(300.0, 0.0, 9.0) });
            let corner = vec3(1.0, 1.0, 9.0);
            for vertices in [[corner; 3], [corner, vec3(2.0, -3.0, 7.0), -corner], [corner, 2.0 * corner, Vec3::Z]] {
                scene.triangles.push(Triangle { colour: Vec3::ONE, vertices });
            }
            if (i + lights) % 2 == 0 {
                scene.spheres.push(Sphere { radius: 400.0, colour: vec3(0.2, 0.3, 0.4), centre: vec3(3.0, -2.0, 5.0) });
            }
            scenes.push((format!("many({spheres}, {triangles}, seed {seed}), {lights} lights"), scene));
        }
    }
    scenes
}

#[test]
fn brute_force_makes_the_same_bytes_on_scenes_of_every_kind() {
    for (name, scene) in scenes() {
        for contender in packets() {
            check(&contender, &scene, Keep::all(), &name);
        }
    }
}

#[test]
fn each_omission_alone_makes_the_same_bytes() {
    for (name, scene) in scenes().into_iter().step_by(3) {
        for omission in Omission::ALL.into_iter().filter(|omission| omission.switch() == Switch::Work) {
            for contender in packets() {
                check(&contender, &scene, Keep::only(omission), &format!("{name}, {omission:?}"));
            }
        }
    }
}

/// What two triangles hide of each other is decided at the ends of what they share: here they cross, touch along an edge,
/// lie in one plane, and are apart by less than f32 can tell.
#[test]
fn triangles_that_nearly_coincide_are_the_same_cut_or_by_depth() {
    let mut rng = Rng::new(61);
    for case in 0..60 {
        let mut point = || vec3(rng.between(-4.0, 4.0), rng.between(-3.0, 3.0), rng.between(8.0, 12.0));
        let [a, b, c] = [point(), point(), point()];
        let gap = [0.0, 1e-7, 1e-6, 1e-5, 1e-3][case % 5];
        let behind = |v: Vec3| v * (1.0 + gap);
        let scene = Scene {
            name: "gap.png".into(),
            camera: camera(131, 97, 1.0, 1.0),
            lights: vec![Light { intensity: 1.0, colour: Vec3::ONE, position: vec3(3.0, 4.0, 0.0) }],
            spheres: vec![],
            triangles: vec![
                Triangle { colour: Vec3::X, vertices: [a, b, c].map(behind) },
                Triangle { colour: Vec3::Y, vertices: [b, c, a] },
                Triangle { colour: Vec3::Z, vertices: [a, b, point()] },
            ],
        };
        for contender in packets() {
            check(&contender, &scene, Keep::only(Omission::Depths), &format!("case {case}, gap {gap}"));
            check(&contender, &scene, Keep::all(), &format!("case {case}, gap {gap}"));
        }
    }
}

/// The sphere's outline is a parabola of which one row's two ends are one.
#[test]
fn a_sphere_that_a_row_never_leaves_is_seen_on_either_side() {
    for x in [5.0, -5.0] {
        let scene = Scene {
            name: "side.png".into(),
            camera: camera(60, 45, 0.05, 1.0),
            lights: vec![Light { intensity: 1.0, colour: Vec3::ONE, position: Vec3::ZERO }],
            spheres: vec![Sphere { radius: 1.0, colour: Vec3::ONE, centre: vec3(x, 0.0, 1.0) }],
            triangles: vec![],
        };
        let truth = Truth::new(&scene);
        assert!((0..45).any(|row| truth.object(row, if x > 0.0 { 59 } else { 0 }).is_some()));
        for contender in packets() {
            truth.check(&contender, &format!("x = {x}"));
            check(&contender, &scene, Keep::all(), &format!("x = {x}"));
        }
    }
}
