//! Algorithm 1 with a ray in each lane, compared with the reference and called under the rules of
//! checked calls. Its operations are tested in operations/.

use rayo::internals::kernels::harness::checked;
use rayo::internals::kernels::{Isa, LaneTracer, Vec4, lane_tracer};
use rayo::internals::plan::Packed;
use rayo::internals::render::{Engine, Film, FilmMut, PixelFormat};
use rayo::internals::scene::{self, Scene};
use rayo_lab::operands::in_lanes;

use crate::kernel_cases::seed;

fn tracers() -> Vec<(Isa, &'static LaneTracer)> {
    Isa::ALL.into_iter().filter_map(|isa| Some((isa, lane_tracer(isa)?))).collect()
}

/// Scenes with various numbers of spheres and triangles, in pictures whose rows end within a
/// packet.
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
    // Tracing row by row gives the same.
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
            let apart = |a: &Vec4, b: &Vec4| [a.x - b.x, a.y - b.y, a.z - b.z].iter().any(|by| by.abs() > 1e-5);
            let out = traced(tracer, &scene);
            let wrong = truth.iter().zip(&out).filter(|(truth, ours)| apart(truth, ours)).count();
            assert!(200 * wrong <= out.len(), "{isa}: {wrong} of {} pixels", out.len());
        }
    }
}
