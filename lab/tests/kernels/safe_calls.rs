//! Safe calls of kernels with lengths, numbers or positions beyond any memory: each must panic
//! before any memory is accessed.

#![forbid(unsafe_code)]

use std::panic::{self, AssertUnwindSafe, catch_unwind};

use rayo::internals::kernels::{
    Candidate, Element, ElementKernels, LitRow, LitRows, LitSphere, PacketKernels, Plain, ShadingRecords, SphereChunk,
    SphereRecords, TileBuffers, TileOut, TileShade, TileWindow, TriangleChunk, Vec4,
};
use rayo::internals::plan::{PlanOptions, TilePlace, Tiles};
use rayo::internals::scene;

use crate::calling_convention::survives;
use crate::kernel_cases::packet_kernels;

/// Calls, with descriptions of what is wrong with them.
type Calls<'a> = &'a [(&'a str, &'a dyn Fn())];

/// The calls that do not panic; each runs in a forked process.
fn accepted(calls: Calls<'_>) -> Vec<String> {
    let refused = |call: &dyn Fn()| {
        survives(|| {
            panic::set_hook(Box::new(|_| ()));
            assert!(catch_unwind(AssertUnwindSafe(call)).is_err());
        })
        .unwrap()
    };
    calls.iter().filter(|(_, call)| !refused(call)).map(|(what, _)| (*what).to_owned()).collect()
}

fn rows<E: Element>(kernels: &ElementKernels<E>) -> Vec<String> {
    let lit = |start: f64, end: f64| {
        let mut rows = LitRows::ZERO;
        (0..2).for_each(|row| rows.set_row(row, &LitRow { start, end, ..LitRow::default() }.round()));
        kernels.lit.f32x4.call(&LitSphere::default(), &rows, &mut [Vec4::default(); 128], 64, false);
    };
    let calls: Calls<'_> = &[
        ("a row that ends before it begins", &|| lit(0.0, -1.0)),
        ("a row that ends at no number", &|| lit(0.0, f64::NAN)),
        ("a row that ends past its last column", &|| lit(0.0, 65.0)),
    ];
    accepted(calls)
}

fn tiles<E: Element>(kernels: &ElementKernels<E>, plan: &Tiles<'_, E>) -> Vec<String> {
    let kernels = &kernels.tiles;
    let window = TileWindow { column: 0, row: 0, columns: 64, rows: 0..2 };
    let candidates = [0, 1].map(|id| Candidate { id, columns: 64 << 16, rows: 32 << 16, most: 1.0 });
    let tile = TilePlace { across: 0, down: 0 };
    let (view, rays) = (plan.view(tile), plan.rays(tile));
    let lights = &plan.levels().lights;
    // Sets up objects from this number on, finds the nearest, and shades.
    let triangles = |first_id: usize| {
        let (mut buffers, mut shades) = (TileBuffers::default(), Vec::new());
        let triangles =
            TriangleChunk { triangles: plan.triangle_lists()[0], lights, candidates: &candidates, first_id };
        kernels.set_up.call(&view, triangles, &mut buffers, &mut shades);
        (buffers, shades)
    };
    let spheres = SphereChunk { spheres: plan.spheres(), candidates: &candidates };
    let set_up_spheres = |first_id: usize, buffers: &mut TileBuffers<E>| {
        kernels.sphere_set_up.call(&plan.levels().spheres, spheres, first_id, buffers);
    };
    let records = |first: usize| {
        let records = &mut SphereRecords::<E>::default();
        kernels.sphere_shading.call(&plan.levels().spheres, spheres, plan.sphere_lights(), true, first, records);
    };
    let shade = |shades: &[TileShade<E>], buffers: &TileBuffers<E>, first: usize, width: usize| {
        let shading =
            ShadingRecords { shades, lights: plan.points(), sphere_ids: &[], spheres: &[], lits: &[], shorts: &[] };
        let out = TileOut { pixels: &mut [Vec4::default(); 128], first, width };
        kernels.f32x4.call(&rays, buffers, shading, &window, out);
    };
    let shaded = |first: usize, width: usize| {
        let (buffers, shades) = triangles(1);
        shade(&shades, &buffers, first, width);
    };
    let unseen = |id: u32| {
        let candidates = [Candidate { id, ..candidates[0] }];
        let triangles =
            TriangleChunk { triangles: plan.triangle_lists()[0], lights, candidates: &candidates, first_id: 1 };
        kernels.set_up.call(&view, triangles, &mut TileBuffers::default(), &mut Vec::new());
    };
    // Counts that become 0 modulo 2^64 when multiplied by 2 or by 8.
    let [half, eighth] = [1 << 63, 1 << 61];
    let calls: Calls<'_> = &[
        ("numbers of triangles that f32 has not", &|| _ = triangles(1 << 24)),
        ("numbers of triangles past the last", &|| _ = triangles(usize::MAX)),
        ("half as many triangles as there are numbers", &|| _ = triangles(half)),
        ("an eighth as many", &|| _ = triangles(eighth)),
        ("a triangle that is not there", &|| unseen(2)),
        ("a triangle that is nowhere", &|| unseen(u32::MAX)),
        ("numbers of spheres that f32 has not", &|| set_up_spheres(1 << 24, &mut TileBuffers::default())),
        ("numbers of spheres past the last", &|| set_up_spheres(usize::MAX, &mut TileBuffers::default())),
        ("records past the last", &|| records(usize::MAX)),
        ("more records than there is memory for", &|| records(1 << 40)),
        ("an eighth as many records as there are numbers", &|| records(eighth)),
        ("half as many", &|| records(half)),
        ("shades of triangles that were not set up", &|| shade(&[], &triangles(1).0, 0, 64)),
        ("pixels backwards", &|| shaded(0, 0_usize.wrapping_sub(64))),
        ("pixels that begin past the end of memory", &|| shaded(usize::MAX - 64, 64)),
        ("rows in one place", &|| shaded(0, 0)),
        ("places of none in the scene", &|| {
            let (mut buffers, _) = triangles(1);
            kernels.nearest_triangles.call(&mut buffers, &[0, 1], &window, &plan.grid(), 1);
        }),
    ];
    accepted(calls)
}

fn attack<E: Element>(packets: &'static PacketKernels, kernels: &'static ElementKernels<E>) {
    let camera = scene::Camera::new(64, 32, 1.0, 1.0).unwrap();
    let mut scene = scene::Scene { camera, ..scene::many(2, 2, 1) };
    scene.lights = vec![scene.lights[0]; 8];
    let plan = Tiles::<E>::new(&scene, packets, PlanOptions::default());
    let accepted = [rows(kernels), tiles(kernels, &plan)].concat();
    assert!(accepted.is_empty(), "{} lanes: {accepted:#?}", kernels.lanes);
}

#[test]
fn what_no_memory_has_is_refused_before_it_is_touched() {
    for (_, kernels) in packet_kernels() {
        attack(kernels, &kernels.single);
        attack(kernels, &kernels.double);
    }
}

#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[test]
fn the_end_of_the_heap_is_not_moved_beside_other_threads() {
    std::thread::scope(|scope| {
        assert!(!scope.spawn(rayo::internals::kernels::memory::use_large_pages).join().unwrap())
    });
}
