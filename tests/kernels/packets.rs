//! Every packet kernel against its twin in Rust: the same random and odd numbers into both, the same bits out.
//!
//! A twin has the same lanes and rounds alike. Only where kernels take estimates of roots there is no one right answer.

use std::fmt::Debug;

use glam::Vec3;
use rayo::kernels::{
    BoundsView, CHUNK, Candidate, Element, ElementKernels, F32x3, LIT_ROWS, LitRow, LitRows, LitSphere, ObjectList,
    PacketKernels, Parts, Plain, Rgb8, Rgba8, ShadeRows, ShadingRecords, SphereChunk, SphereRecords, TILE_PARTS,
    TileBuffers, TileOut, TileShade, TileWindow, TriangleChunk, Vec4,
};
use rayo::plan::{Keep, LitForm, Raster, Scale, TilePlace, Tiles, Weighted};
use rayo::scene::{Camera, Faces, Light, Rng, Scene, Sphere, Triangle, many};

use crate::kernel_cases::{self, Numbers, choose, seed, twins};

/// What kernels made, stage by stage, every number by all of its digits; NaN is NaN.
type Made = Vec<(&'static str, String)>;

fn add(made: &mut Made, what: &'static str, of: &dyn Debug) {
    made.push((what, format!("{of:?}")));
}

/// Holds what kernels and their twins made of something against each other; how many results that were.
fn compare(isa: &dyn Debug, what: &dyn Debug, made: Made, twins: Made) -> usize {
    assert_eq!(made.len(), twins.len());
    for ((stage, made), (_, twin)) in made.iter().zip(&twins) {
        let at = made.bytes().zip(twin.bytes()).position(|(a, b)| a != b).unwrap_or(made.len().min(twin.len()));
        let here = |text: &str| text.get(at.saturating_sub(80)..text.len().min(at + 80)).unwrap_or(text).to_owned();
        assert!(made == twin, "{isa:?}, {stage} of {what:?}: {} instead of {}", here(made), here(twin));
    }
    made.len()
}

/// Objects in the picture and across its borders, some of them nearly edge-on or of next to no size, in two tiles at once, and
/// around the camera; some lights are far away, and some colours too bright for f32. Faces share corners.
fn scattered(seed: u64, lights: usize) -> Scene {
    let mut rng = Rng::new(seed);
    let mut scene = Scene { camera: Camera::new(131, 67, 1.0, 1.0).unwrap(), ..many(0, 0, seed) };
    scene.lights.extend([1e12, 1e30].map(|far| Light { position: [far, 2.0, -far].into(), ..scene.lights[0] }));
    scene.lights.truncate(lights);
    for i in 0..2 * CHUNK {
        let z = rng.between(-2.0, 30.0);
        let mut across = || rng.between(-0.7, 0.7) * z.abs().max(2.0);
        let centre = Vec3::new(across(), across(), z);
        let colour = Vec3::new(rng.next_f32(), rng.next_f32(), if i % 7 == 0 { 1e38 } else { 1.0 });
        // Some lie on an axis.
        let centre = if i % 9 == 0 { Vec3::new(0.0, 0.0, z) } else { centre };
        scene.spheres.push(Sphere { radius: 1e-3 + 2.0 * rng.next_f32().powi(4), colour, centre });
        // From larger than the picture to a fraction of a pixel.
        let size = 4f32.powi(1 - (i % 8) as i32);
        let mut corner =
            || centre + size * Vec3::new(rng.between(-1.0, 1.0), rng.between(-1.0, 1.0), rng.between(-1.0, 1.0));
        scene.triangles.push(Triangle { colour, vertices: [corner(), corner(), corner()] });
    }
    // A wall whose edges go through pixels' centres, seen twice: ties and doubts.
    let wall = [[-4.0, -4.0, 8.0], [4.0, -4.0, 8.0], [0.0, 4.0, 8.0]].map(Vec3::from);
    scene.triangles.extend([Triangle { colour: Vec3::ONE, vertices: wall }; 2]);
    let corners = (0..CHUNK as u32).map(|i| [i, i + 1, i + 2]).collect();
    let vertices = scene.triangles.iter().map(|triangle| triangle.vertices[0]).take(CHUNK + 2).collect();
    scene.faces = Faces::new(vertices, corners, Vec3::new(0.5, 0.25, 1.0));
    scene
}

/// How bounds are found in a picture of 640 x 480.
const VIEW_OF_BOUNDS: BoundsView<f32> = BoundsView {
    to_pixels: 600.0,
    column: 319.5,
    row: 239.5,
    low: 0.998,
    high: 1.002,
    width: 640.0,
    height: 480.0,
    most: 1.5,
    all_columns: f32::from_bits(640 << 16),
    all_rows: f32::from_bits(480 << 16),
    reach: 1.992,
    outside: -0.026,
};

/// What kernels of tiles make of a scene's first chunks, in a window of its first tile.
fn tiles<E: Element + Debug>(
    (packets, kernels, plans): (&PacketKernels, &ElementKernels<E>, &'static PacketKernels),
    scene: &Scene,
    window: &TileWindow,
    weighted_of: for<'a> fn(&'a Tiles<'_, E>) -> &'a Weighted,
) -> Made {
    let mut made = Made::new();
    let plan = Tiles::<E>::new(scene, Raster::of(&scene.camera)[0], plans, Keep::NOTHING, 1);
    let (weighted, grid, tile) = (weighted_of(&plan), plan.grid(), TilePlace { across: 0, down: 0 });
    let ((view, rays), lanes) = (plan.view(tile), kernels.lanes);
    let (kernels, mut buffers, mut records) = (&kernels.tiles, TileBuffers::<E>::default(), SphereRecords::default());
    // Beside the window a block may have something or nothing.
    let pixels = |buffers: &TileBuffers<E>| {
        let row = |row| (0..window.columns).map(move |column| (column as usize, row as usize));
        let pixels = window.rows.clone().flat_map(row);
        pixels.map(|(column, row)| buffers.pixel(lanes, column, row)).collect::<Vec<_>>()
    };

    let mut candidates = vec![Candidate::default(); scene.spheres.len().next_multiple_of(CHUNK)];
    for keep_all in [false, true] {
        let found = packets.sphere_bounds.call(&weighted.spheres, &scene.spheres, 5, keep_all, &mut candidates);
        add(&mut made, "bounds of spheres", &(found, &candidates[..found.unwrap().0]));
    }
    candidates.iter_mut().for_each(|candidate| candidate.id -= 5);
    candidates.truncate(CHUNK);
    let order: Vec<_> = (0..=3 * CHUNK as u32).rev().map(|place| place % 150).collect();
    let order = [&[0], &order[..]].concat();
    let spheres = SphereChunk { spheres: &scene.spheres, candidates: &candidates };
    kernels.sphere_set_up.call(&weighted.spheres, spheres, 1, &mut buffers);
    add(&mut made, "planes of spheres", buffers.sphere_planes());
    kernels.nearest_spheres.call(&mut buffers, &order, window, &grid, 1);
    add(&mut made, "the nearest of spheres", &pixels(&buffers));
    kernels.sphere_shading.call(&weighted.spheres, spheres, plan.sphere_lights(), weighted.bytes, 0, &mut records);
    let lights = plan.points().len();
    records.spheres.truncate(CHUNK);
    add(&mut made, "records of spheres", &records.spheres);
    add(&mut made, "short forms", &&records.shorts[..CHUNK * lights]);
    // The long form of a packet may be left out where all of it has the short one.
    let is_long = |i: &usize| records.spheres[i / lights].short == E::ZERO;
    let longs: Vec<_> = (0..CHUNK * lights).filter(is_long).map(|i| records.lits[i]).collect();
    add(&mut made, "long forms", &longs);

    let mut shades = vec![TileShade::<E>::default(); (1 + 3 * CHUNK) * lights];
    for (kind, triangles) in plan.triangle_lists().iter().enumerate() {
        let count = triangles.len().min(2 * CHUNK);
        let mut candidates = vec![Candidate::default(); triangles.len().next_multiple_of(CHUNK)];
        for keep_all in [false, true] {
            let found = packets.bounds.call(&VIEW_OF_BOUNDS, *triangles, 5, keep_all, &mut candidates);
            add(&mut made, "bounds of triangles", &(found, &candidates[..found.unwrap().0]));
        }
        // Everywhere: what has no area there is found out.
        let anywhere = |id| Candidate { id, columns: 64 << 16, rows: 32 << 16, most: 0.75 + id as f32 };
        let candidates: Vec<_> = (0..count as u32).map(anywhere).rev().take(CHUNK).collect();
        let first_id = 1 + (1 + kind) * CHUNK;
        let lights = &weighted.lights;
        let chunk = TriangleChunk { triangles: *triangles, lights, candidates: &candidates, first_id };
        kernels.set_up.call(&view, chunk, &mut buffers, &mut shades);
        add(&mut made, "planes of triangles", buffers.planes());
        kernels.nearest_triangles.call(&mut buffers, &order, window, &grid, 8);
        add(&mut made, "the nearest of triangles", &pixels(&buffers));
    }
    shades.truncate((1 + 3 * CHUNK) * lights);
    add(&mut made, "shades", &shades);
    if pixels(&buffers).len() == 2048 {
        add(&mut made, "what is farthest", &kernels.farthest.call(&buffers));
    }
    made.extend(shaded(kernels, (&plan, &rays), &buffers, &shades, &records, window));
    // Some are shaded as spheres around the camera are.
    for record in records.spheres.iter_mut().step_by(3) {
        let [x, y, z, over_radius, around] = [0.25, -0.125, 3.0, 0.75, 1.0].map(E::from_f64);
        (record.ux, record.uy, record.uz, record.mx, record.around) = (x, y, z, over_radius, around);
    }
    made.extend(shaded(kernels, (&plan, &rays), &buffers, &shades, &records, window));

    let mut rng = Rng::new(7);
    for _ in 0..30 {
        let [x, y, z] = [0; 3].map(|_| rng.between(-3.0, 3.0));
        let sphere = Sphere { radius: rng.between(0.1, 4.0), colour: Vec3::ONE, centre: Vec3::new(x, y, z.min(0.5)) };
        let Some(around) = plan.around(&sphere) else { continue };
        let mut buffers = TileBuffers::<E>::default();
        kernels.around.call(&around, window, &mut buffers, &[0, 1]);
        add(&mut made, "a sphere around the camera", &pixels(&buffers));
    }
    made
}

/// The pixels of a tile of those objects.
fn shaded<E: Element>(
    kernels: &rayo::kernels::TileKernels<E>,
    (plan, rays): (&Tiles<'_, E>, &rayo::kernels::TileRays<E>),
    buffers: &TileBuffers<E>,
    shades: &[TileShade<E>],
    records: &SphereRecords<E>,
    window: &TileWindow,
) -> Made {
    let (ids, mut made): (Vec<_>, _) = ((0..CHUNK as u32).collect(), Made::new());
    let shading = ShadingRecords {
        shades,
        lights: plan.points(),
        sphere_ids: &ids,
        spheres: &records.spheres,
        lits: &records.lits,
        shorts: &records.shorts,
    };
    let mut floats = vec![Vec4::default(); 70 * 32];
    kernels.f32x4.call(rays, buffers, shading, window, TileOut { pixels: &mut floats, first: 3, width: 70 });
    add(&mut made, "floats of a tile", &floats);
    // In f32 bytes have estimates.
    if size_of::<E>() == 8 {
        let mut bytes = vec![Rgba8::default(); 70 * 32];
        kernels.rgba8.call(rays, buffers, shading, window, TileOut { pixels: &mut bytes, first: 3, width: 70 });
        add(&mut made, "bytes of a tile", &bytes);
    }
    made
}

#[test]
fn every_kernel_of_tiles_without_estimates_gives_the_bits_of_its_twin() {
    let (mut compared, first) = (0, seed());
    for (isa, packets, twins) in twins() {
        for (seed, lights) in [(first, 1), (first + 1, 2), (first + 2, 4), (first + 3, 0)] {
            let scene = scattered(seed, lights);
            for (columns, rows) in [(64, 0..32), (37, 3..30), (1, 5..6)] {
                let window = TileWindow { column: 0, row: 0, columns, rows };
                let what = (seed, lights, &window);
                let of = |of| tiles((of, &of.single, packets), &scene, &window, |plan| plan.linear());
                compared += compare(&isa, &what, of(packets), of(twins));
                let of = |of| tiles((of, &of.double, packets), &scene, &window, |plan| plan.linear());
                compared += compare(&isa, &what, of(packets), of(twins));
                let of = |of| tiles((of, &of.single, packets), &scene, &window, |plan| plan.levels());
                compared += compare(&isa, &what, of(packets), of(twins));
                let of = |of| tiles((of, &of.double, packets), &scene, &window, |plan| plan.levels());
                compared += compare(&isa, &what, of(packets), of(twins));
            }
        }
    }
    println!("{compared} results compared");
}

#[test]
fn lists_of_candidates_are_cut_and_culled_as_by_their_twins() {
    let mut rng = Rng::new(seed());
    for (isa, packets, twins) in twins() {
        for count in (1..70).chain([200]) {
            let mut from = |first: u32, count: u32| first + rng.next_u64() as u32 % count;
            let mut bounds = |first: u32| {
                let start = from(first - 20, 100);
                start | (start + from(1, 20) * [1, 1, 1, 4][from(0, 4) as usize]) << 16
            };
            let mut candidates: Vec<_> =
                (0..count).map(|id| Candidate { id, columns: bounds(128), rows: bounds(64), most: 0.0 }).collect();
            candidates.iter_mut().for_each(|c| c.most = [0.0, 0.5, 1.0, 1.5, 1.75, f32::MAX][from(0, 6) as usize]);
            let farthest: [f32; TILE_PARTS] = std::array::from_fn(|_| from(0, 4) as f32);
            let columns = choose(&mut rng, &[64, 64, 5, 33]);
            let window = TileWindow { column: 128, row: 64, columns, rows: if count % 3 == 0 { 9..11 } else { 0..32 } };
            let of = |kernels: &PacketKernels| {
                let mut room = vec![Candidate::default(); candidates.len().next_multiple_of(16)];
                let mut farther = room.clone();
                let near = kernels.nearer_half.call(&candidates, &mut room, &mut farther);
                let halves = format!("{:?}", (&room[..near], &farther[..candidates.len() - near]));
                room[..candidates.len()].copy_from_slice(&candidates);
                let left = kernels.visible.call(&mut room, candidates.len(), &Parts::new(farthest), &window);
                vec![("two halves", halves), ("the visible", format!("{:?}", &room[..left]))]
            };
            compare(&isa, &(count, &window), of(packets), of(twins));
        }
    }
}

/// Rows that a kernel makes, on a film that nobody has written on.
fn rows<E: Element, P: Plain + Debug>(
    kernel: &ShadeRows<E, P>,
    (sphere, rows, width): (&LitSphere<E>, &[LitRow<E>], usize),
    shown: impl Fn(usize, P) -> Option<P>,
) -> String {
    let mut lit_rows = LitRows::default();
    rows.iter().enumerate().for_each(|(i, row)| lit_rows.set_row(i, row));
    let mut out = vec![P::ZERO; rows.len() * width];
    kernel.call(sphere, &lit_rows, &mut out, width, false);
    format!("{:?}", out.into_iter().enumerate().map(|(i, pixel)| shown(i, pixel)).collect::<Vec<_>>())
}

/// What kernels make of rows of any numbers. Between the ends of a span p is above 0, so that kernels in assembly do not look
/// there: where it is not, anything may come of it, and where a byte would be beyond 255.
fn lit<E: Element>(
    kernels: &ElementKernels<E>,
    exact_bytes: bool,
    (sphere, lit_rows, width): (&LitSphere<E>, &[LitRow<E>], usize),
) -> Made {
    let of = (sphere, lit_rows, width);
    let is_sure = |i: usize| {
        let row = &lit_rows[i / width];
        let u = i as f64 % width as f64 - row.start.to_f64() + row.j.to_f64() - row.m.to_f64();
        row.a.to_f64() - u * u > 1e-5 * row.a.to_f64()
    };
    let (mut made, grey) =
        (Made::new(), LitSphere { red: E::from_f64(1.0), green: E::from_f64(1.0), blue: E::from_f64(1.0), ..*sphere });
    for (of, bodies) in [(of, &kernels.lit), ((&grey, lit_rows, width), &kernels.grey)] {
        made.push(("four floats", rows(&bodies.f32x4, of, |i, pixel| is_sure(i).then_some(pixel))));
        made.push(("three floats", rows(&bodies.f32x3, of, |i, pixel: F32x3| is_sure(i).then_some(pixel))));
        let mut levels = vec![F32x3::default(); lit_rows.len() * width];
        let mut all = LitRows::default();
        lit_rows.iter().enumerate().for_each(|(i, row)| all.set_row(i, row));
        bodies.f32x3.call(of.0, &all, &mut levels, width, false);
        let is_in_span = |i: usize| {
            let row = &lit_rows[i / width];
            (row.start.to_f64()..row.end.to_f64()).contains(&((i % width) as f64))
        };
        let has_bytes = |i: usize| exact_bytes || !is_in_span(i);
        let is_sure = |i: usize| is_sure(i) && has_bytes(i) && levels[i].iter().all(|x| *x < 255.0);
        made.push(("four bytes", rows(&bodies.rgba8, of, |i, pixel: Rgba8| is_sure(i).then_some(pixel))));
        made.push(("three bytes", rows(&bodies.rgb8, of, |i, pixel: Rgb8| is_sure(i).then_some(pixel))));
    }
    made
}

#[test]
fn every_kernel_of_a_sphere_under_one_light_gives_the_bits_of_its_twin() {
    let mut compared = 0;
    for (isa, packets, twins) in twins() {
        let mut rng = Rng::new(seed());
        // In f32, and with AVX-512 in f64 too, bytes come from estimates.
        let exact = packets.single.lanes < 16;
        for case in 0..1000 * Numbers::ALL.len() {
            let numbers = Numbers::ALL[case % Numbers::ALL.len()];
            let (width, count) = (1 + rng.next_u64() as usize % 40, 1 + rng.next_u64() as usize % 4);
            let what = (case, numbers);
            let of = (
                &kernel_cases::lit_sphere(numbers, &mut rng),
                &*kernel_cases::lit_rows(numbers, width, count, &mut rng),
                width,
            );
            compared += compare(&isa, &what, lit(&packets.single, false, of), lit(&twins.single, false, of));
            let of = (
                &kernel_cases::lit_sphere(numbers, &mut rng),
                &*kernel_cases::lit_rows(numbers, width, count, &mut rng),
                width,
            );
            compared += compare(&isa, &what, lit(&packets.double, exact, of), lit(&twins.double, exact, of));
        }
    }
    println!("{compared} results compared");
}

#[test]
fn the_rows_of_a_sphere_are_found_as_by_their_twins() {
    fn found<E: Element + Debug>(kernels: &ElementKernels<E>, scene: &Scene, first: u32, count: usize) -> Option<Made> {
        let (form, mut rows) = (LitForm::of::<E>(scene, Keep::NOTHING)?, LitRows::<E>::default());
        kernels.lit_rows.call(form.setup(Scale::Linear), first, count, &mut rows);
        let row = |i: usize| Some(rows.row(i)).filter(|row| row.start < row.end);
        Some((0..count).map(|i| ("rows", format!("{:?}", row(i)))).collect())
    }
    let mut seen = 0;
    for (isa, packets, twins) in twins() {
        for (width, height) in [(201, 151), (1, 67), (333, 5)] {
            let many = many(60, 0, 7);
            for sphere in &many.spheres {
                let camera = Camera::new(width, height, 1.0, 1.0).unwrap();
                let scene = Scene { camera, spheres: vec![*sphere], lights: many.lights[..1].to_vec(), ..many.clone() };
                for first in (0..height).step_by(LIT_ROWS - 1) {
                    let count = (height - first).min(LIT_ROWS as u32 - 1) as usize;
                    let of = |kernels: &PacketKernels| {
                        [found(&kernels.single, &scene, first, count), found(&kernels.double, &scene, first, count)]
                    };
                    for (made, twin) in of(packets).into_iter().zip(of(twins)).filter_map(|(a, b)| a.zip(b)) {
                        seen += made.iter().filter(|(_, row)| row != "None").count();
                        compare(&isa, sphere, made, twin);
                    }
                }
            }
        }
    }
    assert!(seen > 1000, "{seen} rows compared");
}
