//! Algorithm 1 with a ray in each lane: against the twins of its operations, the reference, and the rules of calls.

use rayo::kernels::{Isa, LaneTracer, Vec4, lane_tracer};
use rayo::plan::{Packed, in_lanes, sphere_hit};
use rayo::reference::packet::{self, Rounding};
use rayo::render::{Engine, Film, FilmMut, PixelFormat};
use rayo::scene::{self, Scene};

use crate::kernel_cases::seed;

fn tracers() -> Vec<(Isa, &'static LaneTracer)> {
    Isa::ALL.into_iter().filter_map(|isa| Some((isa, lane_tracer(isa)?))).collect()
}

/// Scenes of as many spheres and triangles, in pictures whose rows end within a packet.
fn scenes() -> impl Iterator<Item = Scene> {
    let counts = [(0, 0), (1, 0), (0, 1), (7, 0), (0, 9), (12, 15)];
    counts.into_iter().zip([1, 3, 16, 21, 33, 47]).map(|((spheres, triangles), width)| {
        let mut scene = scene::many(spheres, triangles, seed());
        scene.camera = scene.camera.sized(width, 19).unwrap();
        scene
    })
}

fn traced(tracer: &LaneTracer, scene: &Scene) -> Vec<Vec4> {
    let (packed, objects) = (Packed::new(scene), in_lanes(scene, tracer));
    let rows = 0..scene.camera.height();
    let mut out = vec![Vec4::default(); scene.camera.pixels() as usize];
    tracer.call(packed.frame(), &objects, rows.clone(), &mut out);
    let mut again = vec![Vec4::new(1.0, 2.0, 3.0); out.len()];
    tracer.call_checked(packed.frame(), &objects, rows.clone(), &mut again).unwrap();
    assert_eq!(out, again);
    // Row by row it is the same.
    for (row, pixels) in rows.zip(out.chunks(scene.camera.width() as usize)) {
        let mut one = vec![Vec4::default(); pixels.len()];
        tracer.call(packed.frame(), &objects, row..row + 1, &mut one);
        assert_eq!(one, pixels);
    }
    out
}

#[test]
fn a_ray_in_each_lane_sees_what_the_reference_sees() {
    for (isa, tracer) in tracers() {
        for scene in scenes() {
            let mut film = Film::new(PixelFormat::F32x4, scene.camera.pixels() as usize).unwrap();
            let reference = Engine::Reference.prepare(None, &scene).unwrap();
            reference.rows(0..scene.camera.height(), film.as_mut());
            let FilmMut::F32x4(truth) = film.as_mut() else { unreachable!("as it was made") };
            let apart = |a: &Vec4, b: &Vec4| [a.x - b.x, a.y - b.y, a.z - b.z].iter().any(|by| by.abs() > 1e-4);
            let out = traced(tracer, &scene);
            let wrong = truth.iter().zip(&out).filter(|(truth, ours)| apart(truth, ours)).count();
            assert!(100 * wrong <= out.len(), "{isa}: {wrong} of {} pixels", out.len());
        }
    }
}

#[test]
fn spheres_in_lanes_are_the_twins_of_their_operations_to_the_last_bit() {
    for (isa, tracer) in tracers() {
        let rounding = if isa == Isa::Sse41 { Rounding::Unfused } else { Rounding::Fused };
        for scene in scenes().filter(|scene| scene.triangles.is_empty()) {
            let frame = *Packed::new(&scene).frame();
            let twin = |row: u32, column: u64| {
                let x = (column as f32 + 0.5) * frame.step - frame.half_width;
                let d = [x, frame.half_height - (row as f32 + 0.5) * frame.step, frame.focal];
                let (mut nearest, mut colour) = (f32::INFINITY, [0.0; 3]);
                for sphere in &scene.spheres {
                    let (centre, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
                    let hit = sphere_hit::<f64>(centre.into(), radius);
                    let [length, area] = [hit.unit, hit.unit * hit.unit];
                    let hit = hit.record;
                    let record = packet::SphereHit {
                        centre: [hit.cx, hit.cy, hit.cz].map(|c| (c * length) as f32),
                        square: (hit.square * area) as f32,
                        k: (hit.k * area) as f32,
                    };
                    let t = rounding.sphere_hit(&record, d);
                    if t < nearest {
                        nearest = t;
                        let scale = (1.0 / radius) as f32;
                        let o = [0, 1, 2].map(|i| (d[i] * t - sphere.centre[i]) * scale);
                        colour = [0.0; 3];
                        for light in &scene.lights {
                            let weights = light.radiance() * sphere.colour.as_dvec3();
                            let light = packet::Light {
                                position: ((light.position.as_dvec3() - centre) / radius).as_vec3().into(),
                                weights: weights.as_vec3().into(),
                            };
                            colour = rounding.lambert(&light, o, colour);
                        }
                    }
                }
                colour.map(f32::to_bits)
            };
            let out = traced(tracer, &scene);
            for (row, pixels) in (0..).zip(out.chunks(frame.width as usize)) {
                for (column, pixel) in (0..).zip(pixels) {
                    let ours = [pixel.x, pixel.y, pixel.z].map(f32::to_bits);
                    assert_eq!(ours, twin(row, column), "{isa}: row {row}, column {column} of {:?}", scene.camera);
                }
            }
        }
    }
}
