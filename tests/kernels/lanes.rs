//! Algorithm 1 with a ray in each lane: against the twins of its operations, the reference, and the rules of calls.

use rayo::kernels::harness::checked;
use rayo::kernels::harness::lanes::{Lanes, Packet};
use rayo::kernels::{Isa, LaneTracer, Vec4, lane_tracer};
use rayo::plan::{InUnits, Packed, in_lanes, sphere_hit};
use rayo::render::{Engine, Film, FilmMut, PixelFormat};
use rayo::scene::{self, Scene};

use crate::kernel_cases::seed;
use crate::operations::on_packets::{lambert, t_of_sphere};

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
    checked(|| tracer.call(packed.frame(), &objects, rows.clone(), &mut again));
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

/// The bits of a pixel of spheres alone, by the twins of the operations.
fn twin<L: Lanes<Number = f32>>(scene: &Scene, row: u32, column: u32) -> [u32; 3] {
    let frame = *Packed::new(scene).frame();
    let x = (column as f32 + 0.5) * frame.step - frame.half_width;
    let d = [x, frame.half_height - (row as f32 + 0.5) * frame.step, frame.focal].map(L::all);
    let (mut nearest, mut colour) = (f32::INFINITY, [0.0; 3]);
    for sphere in &scene.spheres {
        let (centre, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
        let InUnits { record, unit } = sphere_hit::<f64>(centre.into(), radius);
        let lengths = [record.cx, record.cy, record.cz].map(|c| c * unit);
        let areas = [record.square, record.k].map(|square| square * unit * unit);
        let t = t_of_sphere(d, [lengths[0], lengths[1], lengths[2], areas[0], areas[1]].map(L::of));
        if t.lane(0) < nearest {
            nearest = t.lane(0);
            let o = [0, 1, 2].map(|i| (d[i] * t - L::all(sphere.centre[i])) * L::of(1.0 / radius));
            let lit = scene.lights.iter().fold([L::of(0.0); 3], |colour, light| {
                let [x, y, z] = ((light.position.as_dvec3() - centre) / radius).to_array();
                let [red, green, blue] = (light.radiance() * sphere.colour.as_dvec3()).to_array();
                lambert([x, y, z, 0.0, red, green, blue].map(L::of), o, colour)
            });
            colour = lit.map(|x| x.lane(0));
        }
    }
    colour.map(f32::to_bits)
}

#[test]
fn spheres_in_lanes_are_the_twins_of_their_operations_to_the_last_bit() {
    for (isa, tracer) in tracers() {
        let twin = if isa == Isa::Sse41 { twin::<Packet<f32, 1, false>> } else { twin::<Packet<f32, 1, true>> };
        for scene in scenes().filter(|scene| scene.triangles.is_empty()) {
            let out = traced(tracer, &scene);
            for (row, pixels) in (0..).zip(out.chunks(scene.camera.width() as usize)) {
                for (column, pixel) in (0..).zip(pixels) {
                    let ours = [pixel.x, pixel.y, pixel.z].map(f32::to_bits);
                    assert_eq!(
                        ours,
                        twin(&scene, row, column),
                        "{isa}: row {row}, column {column} of {:?}",
                        scene.camera
                    );
                }
            }
        }
    }
}
