//! Every packet kernel against its twin in Rust, in a test with the kernel's name: the same inputs
//! must give the same bits.
//!
//! Every call is checked, and kernels and twins also run between guard pages.
//!
//! A twin has the same lanes and rounds in the same way; only where kernels take estimates of roots
//! there is no single right result. The inputs of a kernel are computed by the twins of the others,
//! so that only the tested kernel can be wrong.

use std::collections::BTreeSet;
use std::fmt::Debug;

use glam::Vec3;
use rayo::internals::kernels::fences::{self, Side};
use rayo::internals::kernels::harness::checked;
use rayo::internals::kernels::{
    BoundsView, CHUNK, Candidate, Element, ElementKernels, GROUPS, LIT_ROWS, LitGroups, LitPoints, LitRow, LitRows,
    LitSphere, Narrow, ObjectList, PacketKernels, Plain, PointObject, ShadeRows, ShadingRecords, SphereChunk,
    SphereRecords, TileBuffers, TileOut, TilePoints, TileShade, TileWindow, TriangleChunk, TriangleList, Vec4,
    own_bits, packet_symbols,
};
use rayo::internals::plan::{Casters, Keep, LitForm, PlanOptions, Scale, TilePlace, Tiles, Weighted};
use rayo::internals::render::{Engine, FilmMut};
use rayo::internals::scene::{Camera, Faces, Light, Rng, Scene, Sphere, Triangle, many};

use crate::calling_convention::survives;
use crate::extent::sampled;
use crate::kernel_cases::{self, Numbers, choose, seed, twins};

/// The results of kernels or twins, stage by stage, with all digits; all NaNs are equal.
type Made = Vec<(&'static str, String)>;

fn add(made: &mut Made, what: &'static str, of: &dyn Debug) {
    made.push((what, format!("{of:?}")));
}

/// Asserts that kernels and their twins have the same results.
fn compare(isa: &dyn Debug, what: &dyn Debug, made: Made, twins: Made) {
    assert_eq!(made.len(), twins.len());
    for ((stage, made), (_, twin)) in made.iter().zip(&twins) {
        let at = made.bytes().zip(twin.bytes()).position(|(a, b)| a != b).unwrap_or(made.len().min(twin.len()));
        let here = |text: &str| text.get(at.saturating_sub(80)..text.len().min(at + 80)).unwrap_or(text).to_owned();
        assert!(made == twin, "{isa:?}, {stage} of {what:?}: {} instead of {}", here(made), here(twin));
    }
}

/// The number of cases that run between guard pages.
const FENCED: usize = 12;

/// Replaces a kernel of one table by that of another.
type Exchange = fn(&mut PacketKernels, &PacketKernels);

/// Compares a kernel with its twin in all of these cases.
fn hold<C: Debug>(exchange: Exchange, cases: &[C], made: impl Fn(&'static PacketKernels, &C) -> Made) {
    for (isa, packets, twins) in twins() {
        let mut table = *twins;
        exchange(&mut table, packets);
        let table = &*Box::leak(Box::new(table));
        for case in cases {
            compare(&isa, case, checked(|| made(table, case)), made(twins, case));
        }
        for (side, table) in Side::ALL.into_iter().flat_map(|side| [(side, table), (side, twins)]) {
            let fenced = |case: &C| fences::within(side, || _ = made(table, case));
            let few = || cases.iter().step_by(cases.len().div_ceil(FENCED));
            if !survives(|| few().for_each(fenced)).unwrap() {
                let fatal: Vec<_> = few().filter(|case| !survives(|| fenced(case)).unwrap()).collect();
                panic!("{isa:?} touches the guard page {side:?} of an argument: {fatal:?}");
            }
        }
    }
}

/// Defines a test for each kernel: its fields in the table, the cases, and the function that
/// computes its results.
macro_rules! kernels {
    ($($name:ident: $($($field:ident).+),+; $cases:expr, $made:expr;)*) => {
        $(
            #[test]
            fn $name() {
                let exchange: Exchange = |table, of| { $(table.$($field).+ = of.$($field).+;)+ };
                hold(exchange, &$cases, $made);
            }
        )*

        /// The symbols of the kernels in a table that have a test.
        fn tested(of: &PacketKernels) -> BTreeSet<&'static str> {
            [$($(of.$($field).+.symbol()),+),*].into()
        }
    };
}

kernels! {
    set_up: single.tiles.set_up, double.tiles.set_up; tile_cases(), tiles;
    nearest_triangles: single.tiles.nearest_triangles, double.tiles.nearest_triangles; tile_cases(), tiles;
    around: single.tiles.around, double.tiles.around; tile_cases(), tiles;
    sphere_set_up: single.tiles.sphere_set_up, double.tiles.sphere_set_up; tile_cases(), tiles;
    nearest_spheres: single.tiles.nearest_spheres, double.tiles.nearest_spheres; tile_cases(), tiles;
    sphere_shading: single.tiles.sphere_shading, double.tiles.sphere_shading; tile_cases(), tiles;
    points: single.tiles.points, double.tiles.points; shadow_cases(), shadows;
    seen: seen; shadow_cases(), shadows;
    cast: cast; shadow_cases(), shadows;
    meet: meet; shadow_cases(), shadows;
    triangle_casters: triangle_casters; shadow_cases(), shadows;
    sphere_casters: sphere_casters; shadow_cases(), shadows;
    tile_f32x4: single.tiles.f32x4, double.tiles.f32x4; tile_cases(), tiles;
    tile_f32x4_fast: single.tiles.f32x4_fast, double.tiles.f32x4_fast; tile_cases(), tiles;
    tile_rgba8: single.tiles.rgba8, double.tiles.rgba8; tile_cases(), tiles;
    bounds: bounds; tile_cases(), tiles;
    sphere_bounds: sphere_bounds; tile_cases(), tiles;
    nearer_half: nearer_half; list_cases(), |table, candidates| lists(table, candidates);
    lit_f32x4: single.lit.f32x4, single.grey.f32x4, double.lit.f32x4, double.grey.f32x4;
        lit_cases(), |table, case| lit!(table, case, f32x4, Vec4::from([7.0; 4]));
    lit_f32x4_fast: single.lit.f32x4_fast, single.grey.f32x4_fast, double.lit.f32x4_fast, double.grey.f32x4_fast;
        lit_cases(), |table, case| lit!(table, case, f32x4_fast, Vec4::from([7.0; 4]));
    lit_rgba8: single.lit.rgba8, single.grey.rgba8, double.lit.rgba8, double.grey.rgba8;
        lit_cases(), |table, case| lit!(table, case, rgba8, [7; 4]);
    lit_rows: single.lit_rows, double.lit_rows; row_cases(), found_rows;
    narrow_rgb8: narrow_rgb8; Place::all(), |table, place| {
        narrowed(&table.narrow_rgb8, place, [7; 3], |i| [i, i + 1, i + 2, 255])
    };
    narrow_f32x3: narrow_f32x3; Place::all(), |table, place| {
        narrowed(&table.narrow_f32x3, place, [7.0; 3], |i| Vec4::new(i.into(), f32::from(i) + 0.5, f32::MAX))
    };
}

#[test]
fn every_packet_kernel_has_a_test() {
    let tested: BTreeSet<_> = kernel_cases::packet_kernels().iter().flat_map(|(_, table)| tested(table)).collect();
    let all = packet_symbols().into_iter().filter(|symbol| {
        kernel_cases::packet_kernels().iter().any(|(isa, _)| symbol.starts_with(&format!("rayo_{isa}_")))
    });
    assert_eq!(tested, all.collect());
}

/// A range of pixels in a film.
#[derive(Clone, Copy, Debug)]
struct Place {
    /// Whether they are written past the cache.
    streaming: bool,
    /// The index of the first one.
    first: usize,
    count: usize,
}

impl Place {
    /// Every alignment that a span can begin at, with every length up to more than two of the
    /// widest packets.
    fn all() -> Vec<Place> {
        let counts = (1..34).flat_map(|count| (0..17).map(move |first| (first, count)));
        counts.flat_map(|(first, count)| [false, true].map(|streaming| Place { streaming, first, count })).collect()
    }

    /// The film after `write` has written the range; asserts that nothing else has changed.
    fn film<P: Plain + Debug>(self, canary: P, write: impl FnOnce(&mut [P])) -> Vec<P> {
        let mut film = vec![canary; self.first + self.count + if self.streaming { 0 } else { 20 }];
        write(&mut film[self.first..self.first + self.count]);
        film
    }
}

fn narrowed<Four: Plain, P: Plain + Debug>(
    kernel: &Narrow<Four, P>,
    place: &Place,
    canary: P,
    four: impl Fn(u8) -> Four,
) -> Made {
    let four: Vec<_> = (0..place.count).map(|i| four(i as u8)).collect();
    vec![("pixels", format!("{:?}", place.film(canary, |three| kernel.call(&four, three))))]
}

/// Objects in the picture and across its borders: some nearly edge-on, some tiny, some in two
/// tiles, some around the camera. Some lights are far away, and some colours too bright for f32.
/// Faces share corners.
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
        // Some centres are on an axis.
        let centre = if i % 9 == 0 { Vec3::new(0.0, 0.0, z) } else { centre };
        scene.spheres.push(Sphere { radius: 1e-3 + 2.0 * rng.next_f32().powi(4), colour, centre });
        // Sizes from larger than the picture to a fraction of a pixel.
        let size = 4f32.powi(1 - (i % 8) as i32);
        let mut corner =
            || centre + size * Vec3::new(rng.between(-1.0, 1.0), rng.between(-1.0, 1.0), rng.between(-1.0, 1.0));
        let mut vertices = [corner(), corner(), corner()];
        // Some are in a plane with the camera, up to rounding.
        if i % 25 == 20 {
            vertices[1] = 2.0 * vertices[0];
        }
        scene.triangles.push(Triangle { colour, vertices });
    }
    // Some end, on one side, a ten-thousandth of a pixel before the middle of the picture.
    let radius = 2.999_99;
    let beside = [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y].map(|side| 3.0 * side + 10.0 * Vec3::Z);
    scene.spheres.extend(beside.map(|centre| Sphere { radius, colour: Vec3::ONE, centre }));
    // Two equal triangles whose edges pass through pixel centres, to have ties and doubtful hits.
    let wall = [[-4.0, -4.0, 8.0], [4.0, -4.0, 8.0], [0.0, 4.0, 8.0]].map(Vec3::from);
    scene.triangles.extend([Triangle { colour: Vec3::ONE, vertices: wall }; 2]);
    let corners = (0..CHUNK as u32).map(|i| [i, i + 1, i + 2]).collect();
    let vertices = scene.triangles.iter().map(|triangle| triangle.vertices[0]).take(CHUNK + 2).collect();
    scene.faces = Faces::new(vertices, corners, Vec3::new(0.5, 0.25, 1.0));
    scene
}

/// The inputs of `bounds` for a picture of 640 x 480.
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

/// A window of a tile, and its objects.
#[derive(Clone, Debug)]
struct TileCase {
    seed: u64,
    lights: usize,
    place: TilePlace,
    window: TileWindow,
    /// The number of objects in a chunk.
    count: usize,
    double: bool,
    /// Whether light is in levels up to 255.
    levels: bool,
}

fn tile_cases() -> Vec<TileCase> {
    let (mut cases, first) = (Vec::new(), seed());
    for (seed, lights) in [(first, 1), (first + 1, 2), (first + 2, 4), (first + 3, 0)] {
        for (columns, rows, count) in [(64, 0..32, CHUNK), (37, 3..30, CHUNK - 1), (1, 5..6, 3)] {
            for (double, levels) in [(false, false), (true, false), (false, true), (true, true)] {
                // The first tile, and a tile that objects reach into from the left and from above.
                let place = if levels { TilePlace { across: 1, down: 1 } } else { TilePlace { across: 0, down: 0 } };
                let (column, row) = place.first();
                let window = TileWindow { column, row, columns, rows: rows.clone() };
                cases.push(TileCase { seed, lights, place, window, count, double, levels });
            }
        }
    }
    sampled(cases, 7).collect()
}

fn tiles(table: &'static PacketKernels, case: &TileCase) -> Made {
    if case.double {
        tiles_of((table, &table.double), case, if case.levels { |plan| plan.levels() } else { |plan| plan.linear() })
    } else {
        tiles_of((table, &table.single), case, if case.levels { |plan| plan.levels() } else { |plan| plan.linear() })
    }
}

/// The results of the tile kernels for a scene's first chunks, in a window of a tile.
fn tiles_of<E: Element + Debug>(
    (packets, kernels): (&'static PacketKernels, &ElementKernels<E>),
    &TileCase { seed, lights, place, ref window, count, .. }: &TileCase,
    weighted_of: for<'a> fn(&'a Tiles<'_, E>) -> &'a Weighted,
) -> Made {
    let mut made = Made::new();
    // A clone has no spare capacity, so that reads beyond the end are caught.
    let scene = &scattered(seed, lights).clone();
    let plan = Box::new(Tiles::<E>::new(scene, packets, PlanOptions::default()));
    let (weighted, grid) = (weighted_of(&plan), plan.grid());
    let (view, rays, lanes) = (plan.view(place), plan.rays(place), kernels.lanes);
    let (kernels, mut buffers, mut records) = (&kernels.tiles, TileBuffers::<E>::default(), SphereRecords::default());
    // Pixels of a block outside of the window are unspecified: compare those within.
    let pixels = |buffers: &TileBuffers<E>| {
        let row = |row| (0..window.columns).map(move |column| (column as usize, row as usize));
        let pixels = window.rows.clone().flat_map(row);
        pixels.map(|(column, row)| buffers.pixel(lanes, column, row)).collect::<Vec<_>>()
    };

    let mut candidates = vec![Candidate::default(); scene.spheres.len().next_multiple_of(CHUNK)];
    for keep_all in [false, true] {
        let found = packets.sphere_bounds.call(&weighted.spheres, &scene.spheres, 5, keep_all, &mut candidates);
        add(&mut made, "bounds of spheres", &(found, &candidates[..found.unwrap().count]));
    }
    candidates.truncate(count);
    candidates.iter_mut().for_each(|candidate| candidate.id -= 5);
    let order: Vec<_> = (0..=3 * CHUNK as u32).rev().map(|place| place % 150).collect();
    let order = [&[0], &order[..]].concat();
    let spheres = SphereChunk { spheres: &scene.spheres, candidates: &candidates };
    kernels.sphere_set_up.call(&weighted.spheres, spheres, 1, &mut buffers);
    // Elements after the last object are unspecified.
    if count == CHUNK {
        add(&mut made, "planes of spheres", buffers.sphere_planes());
    }
    kernels.nearest_spheres.call(&mut buffers, &order, window, &grid, 1);
    add(&mut made, "the nearest of spheres", &pixels(&buffers));
    kernels.sphere_shading.call(&weighted.spheres, spheres, plan.sphere_lights(), weighted.bytes, 0, &mut records);
    let lights = plan.points().len();
    records.spheres.truncate(count);
    add(&mut made, "records of spheres", &records.spheres);
    add(&mut made, "short forms", &&records.shorts[..count * lights]);
    // The long form may be missing for a packet whose spheres all have the short one.
    let is_long = |i: &usize| records.spheres[i / lights].short == E::ZERO;
    let longs: Vec<_> = (0..count * lights).filter(is_long).map(|i| records.lits[i]).collect();
    add(&mut made, "long forms", &longs);

    let mut shades = vec![TileShade::<E>::default(); (1 + 3 * CHUNK) * lights];
    // Take the scene's triangles, not the plan's, which lack those that are never seen.
    let lists = [TriangleList::Apart(&scene.triangles), TriangleList::Joined((&scene.faces).into())];
    for (kind, triangles) in lists.iter().enumerate() {
        let most = triangles.len().min(2 * CHUNK);
        let mut candidates = vec![Candidate::default(); triangles.len().next_multiple_of(CHUNK)];
        for keep_all in [false, true] {
            let found = packets.bounds.call(&VIEW_OF_BOUNDS, *triangles, 5, keep_all, &mut candidates);
            add(&mut made, "bounds of triangles", &(found, &candidates[..found.unwrap().count]));
        }
        // Bounds of the whole tile: set-up has to find out which triangles have no area.
        let anywhere = |id| Candidate { id, columns: 64 << 16, rows: 32 << 16, most: 0.75 + id as f32 };
        let candidates: Vec<_> = (0..most as u32).map(anywhere).rev().take(count).collect();
        let first_id = 1 + (1 + kind) * CHUNK;
        let lights = &weighted.lights;
        let chunk = TriangleChunk { triangles: *triangles, lights, candidates: &candidates, first_id };
        kernels.set_up.call(&view, chunk, &mut buffers, &mut shades);
        // Elements after the last object are unspecified.
        add(&mut made, "shades", &&shades[first_id * lights.len()..][..candidates.len() * lights.len()]);
        if count == CHUNK {
            add(&mut made, "planes of triangles", buffers.planes());
        }
        kernels.nearest_triangles.call(&mut buffers, &order, window, &grid, 8);
        add(&mut made, "the nearest of triangles", &pixels(&buffers));
    }
    made.extend(shaded(kernels, (&plan, &rays), &buffers, &shades, &records, window));
    // Some spheres are shaded by the form for spheres around the camera.
    for record in records.spheres.iter_mut().step_by(3) {
        let [x, y, z, over_radius, around] = [0.25, -0.125, 3.0, 0.75, 1.0].map(E::from_f64);
        (record.ux, record.uy, record.uz, record.mx, record.around) = (x, y, z, over_radius, around);
    }
    made.extend(shaded(kernels, (&plan, &rays), &buffers, &shades, &records, window));

    let mut rng = Rng::new(7);
    for _ in 0..10 {
        let [x, y, z] = [0; 3].map(|_| rng.between(-3.0, 3.0));
        let sphere = Sphere { radius: rng.between(0.1, 4.0), colour: Vec3::ONE, centre: Vec3::new(x, y, z.min(0.5)) };
        let Some(around) = plan.around(&sphere).map(Box::new) else { continue };
        let mut buffers = TileBuffers::<E>::default();
        kernels.around.call(&around, window, &mut buffers, &[0, 1]);
        add(&mut made, "a sphere around the camera", &pixels(&buffers));
    }
    made
}

fn shadow_cases() -> Vec<TileCase> {
    let place = TilePlace { across: 0, down: 0 };
    let whole = TileWindow { column: 0, row: 0, columns: 64, rows: 0..32 };
    let case = |(seed, double)| TileCase {
        seed,
        lights: 4,
        place,
        window: whole.clone(),
        count: CHUNK,
        double,
        levels: false,
    };
    (seed()..).zip([false, true, false, true]).map(case).collect()
}

fn shadows(table: &'static PacketKernels, case: &TileCase) -> Made {
    if case.double { shadows_of((table, &table.double), case) } else { shadows_of((table, &table.single), case) }
}

/// The points of a tile under lights far and near, in and on objects, and which points are hidden.
fn shadows_of<E: Element>(
    (packets, kernels): (&'static PacketKernels, &ElementKernels<E>),
    &TileCase { seed, lights, ref window, .. }: &TileCase,
) -> Made {
    let (mut made, mut scene) = (Made::new(), scattered(seed, lights));
    let (sphere, triangle) = (scene.spheres[3], scene.triangles[5]);
    for position in [sphere.centre, sphere.centre - sphere.radius * Vec3::X, triangle.vertices[1], Vec3::ZERO] {
        scene.lights.push(Light { position, ..scene.lights[0] });
    }
    scene.shadows = true;
    let plan = Tiles::<E>::new(&scene, packets, PlanOptions::default());
    let (shadows, mut buffers) = (plan.shadows().unwrap(), TileBuffers::<E>::default());
    let candidates: Vec<_> =
        (0..CHUNK as u32).map(|id| Candidate { id, columns: 64 << 16, rows: 32 << 16, most: f32::INFINITY }).collect();
    let triangles = TriangleChunk {
        triangles: plan.triangle_lists()[0],
        lights: &plan.linear().lights,
        candidates: &candidates,
        first_id: 1,
    };
    let places: Vec<_> = (0..=CHUNK).map(|id| if id == 0 { 0 } else { (scene.spheres.len() + id) as u32 }).collect();
    kernels.tiles.set_up.call(&plan.view(TilePlace { across: 0, down: 0 }), triangles, &mut buffers, &mut Vec::new());
    kernels.tiles.nearest_triangles.call(&mut buffers, &places, window, &plan.grid(), 8);
    // A third of the objects are spheres; points may also belong to no object.
    let mut rng = Rng::new(seed);
    let nobody = PointObject { w: f64::NAN, own: -1.0, ..PointObject::default() };
    let objects: Vec<_> = places
        .iter()
        .map(|place| {
            let place = if rng.next_u64().is_multiple_of(3) {
                rng.next_u64() as usize % scene.spheres.len()
            } else {
                *place as usize
            };
            place.checked_sub(1).and_then(|place| shadows.object(place)).unwrap_or(nobody)
        })
        .collect();
    let mut points = Box::new(TilePoints::ZERO);
    kernels.tiles.points.call(&plan.point_view(), &buffers, [0, 0], &objects, &mut points);
    add(&mut made, "points", &points);
    let owners: Vec<_> = places.iter().map(|place| place.checked_sub(1).map_or(0, own_bits)).collect();
    for (light, position) in shadows.lights().enumerate() {
        let at = position.to_array();
        for side in shadows.sides(light) {
            let mut groups = Box::new(LitGroups::ZERO);
            groups.open.fill(0xffff);
            packets.seen.call(side.view(), &mut points, side.axis(), &mut groups);
            add(&mut made, "seen", &groups);
            add(&mut made, "where they are seen", &points);
            let asked = LitPoints { points: &points, light: &at };
            groups.own.fill_with(|| choose(&mut rng, &owners));
            let (mut objects, mut casters) = (<[Vec<_>; 3]>::default(), Casters::default());
            let all = side.window([-f32::INFINITY, -f32::INFINITY, 0.0, 0.0, -f32::INFINITY]).unwrap();
            side.gather(&all, &mut objects);
            for (kind, objects) in objects.iter().enumerate() {
                let mut objects = &objects[..];
                while !objects.is_empty() {
                    objects = side.cast((kind, objects), &packets.cast, &mut casters);
                    groups.open.fill_with(|| rng.next_u64() as u32 & choose(&mut rng, &[0xffff, 0xf0f0, 0]));
                    // A random range of groups, whether they have open points or not.
                    let asking = [rng.next_u64(), rng.next_u64()].map(|n| n as usize % (GROUPS + 1));
                    let asking = asking[0].min(asking[1])..asking[0].max(asking[1]);
                    packets.meet.call(None, &groups, asking, &mut casters.list);
                    add(&mut made, "some groups met", &casters.list);
                    packets.meet.call(Some(&points), &groups, 0..GROUPS, &mut casters.list);
                    add(&mut made, "cast and met", &casters.list);
                    side.make_met(&mut casters);
                    if kind == 0 {
                        packets.sphere_casters.call(&asked, &casters.spheres, &casters.list, &mut groups);
                        add(&mut made, "open to spheres", &groups);
                    } else {
                        packets.triangle_casters.call(&asked, &casters.triangles, &casters.list, &mut groups);
                        add(&mut made, "open to triangles", &groups);
                    }
                }
            }
        }
    }
    made
}

/// The pixels of a tile with these objects.
fn shaded<E: Element>(
    kernels: &rayo::internals::kernels::TileKernels<E>,
    (plan, rays): (&Tiles<'_, E>, &rayo::internals::kernels::TileRays<E>),
    buffers: &TileBuffers<E>,
    shades: &[TileShade<E>],
    records: &SphereRecords<E>,
    window: &TileWindow,
) -> Made {
    let (ids, mut made): (Vec<_>, _) = ((0..records.spheres.len() as u32).collect(), Made::new());
    let shading = ShadingRecords {
        shades,
        lights: plan.points(),
        sphere_ids: &ids,
        spheres: &records.spheres,
        lits: &records.lits,
        shorts: &records.shorts,
    };
    // The last pixel of the window is the last of the film.
    let pixels = 3 + (window.rows.len() - 1) * 70 + window.columns as usize;
    let mut floats = vec![Vec4::from([7.0; 4]); pixels];
    kernels.f32x4.call(rays, buffers, shading, window, TileOut { pixels: &mut floats, first: 3, width: 70 });
    add(&mut made, "floats of a tile", &floats);
    let mut fast = vec![Vec4::from([7.0; 4]); pixels];
    kernels.f32x4_fast.call(rays, buffers, shading, window, TileOut { pixels: &mut fast, first: 3, width: 70 });
    let mut bytes = vec![[7; 4]; pixels];
    kernels.rgba8.call(rays, buffers, shading, window, TileOut { pixels: &mut bytes, first: 3, width: 70 });
    // In f32 they come from estimates.
    if size_of::<E>() == 8 {
        add(&mut made, "fast floats of a tile", &fast);
        add(&mut made, "bytes of a tile", &bytes);
    }
    made
}

/// Lists of candidates of tiles.
fn list_cases() -> Vec<Vec<Candidate>> {
    let mut rng = Rng::new(seed());
    let mut any = || choose(&mut rng, &[0.0, 0.5, 1.0, 1.5, 1.75, f32::MAX]);
    let mut case = |count| (0..count).map(|id| Candidate { id, most: any(), ..Candidate::default() }).collect();
    (1..70).chain([200]).map(&mut case).collect()
}

/// A list of candidates, partitioned.
fn lists(kernels: &'static PacketKernels, candidates: &[Candidate]) -> Made {
    let (mut nearer, mut farther) = (candidates.to_vec(), candidates.to_vec());
    let near = kernels.nearer_half.call(candidates, &mut nearer, &mut farther);
    vec![("two halves", format!("{:?}", (&nearer[..near], &farther[..candidates.len() - near])))]
}

/// Rows of a sphere under one light, with random numbers.
#[derive(Debug)]
struct LitCase {
    seed: u64,
    numbers: Numbers,
    width: usize,
    place: Place,
}

fn lit_cases() -> Vec<LitCase> {
    let mut rng = Rng::new(seed());
    let case = |seed| {
        let mut below = |n| rng.next_u64() as usize % n;
        let (width, rows, first, streaming) = (1 + below(40), 1 + below(4), below(17), below(2) == 0);
        let numbers = Numbers::ALL[seed as usize % Numbers::ALL.len()];
        LitCase { seed, numbers, width, place: Place { streaming, first, count: rows * width } }
    };
    sampled((0..7000).map(case), 10).collect()
}

/// The results of two kernels for rows with random numbers: one in f32 and one in f64, both for any
/// colours and for grey.
macro_rules! lit {
    ($table:expr, $case:expr, $field:ident, $canary:expr) => {{
        let mut made = Made::new();
        // Bytes come from estimates in f32, and with AVX-512 also in f64; fast floats in f32.
        let [fast, bytes] = ["_fast", "8"].map(|end| stringify!($field).ends_with(end));
        let (single, double) = (fast || bytes, bytes && $table.single.lanes == 16);
        let ElementKernels { lit, grey, .. } = &$table.single;
        lit_of(&mut made, $case, (&lit.$field, &lit.f32x4), [false, single], $canary);
        lit_of(&mut made, $case, (&grey.$field, &grey.f32x4), [true, single], $canary);
        let ElementKernels { lit, grey, .. } = &$table.double;
        lit_of(&mut made, $case, (&lit.$field, &lit.f32x4), [false, double], $canary);
        lit_of(&mut made, $case, (&grey.$field, &grey.f32x4), [true, double], $canary);
        made
    }};
}
use lit;

/// Kernels in assembly assume that p > 0 between the ends of a span: exclude pixels where that
/// fails, and those whose level would exceed 255, since their results are unspecified.
fn lit_of<E: Element, P: Plain + Debug>(
    made: &mut Made,
    &LitCase { seed, numbers, width, place }: &LitCase,
    (kernel, floats): (&ShadeRows<E, P>, &ShadeRows<E, Vec4>),
    [grey, estimated]: [bool; 2],
    canary: P,
) {
    let mut rng = Rng::new(seed);
    let sphere = kernel_cases::lit_sphere::<E>(numbers, &mut rng);
    let one = E::from_f64(1.0);
    let sphere = Box::new(if grey { LitSphere { red: one, green: one, blue: one, ..sphere } } else { sphere });
    let rows = kernel_cases::lit_rows(numbers, width, place.count / width, &mut rng);
    let mut all = Box::new(LitRows::ZERO);
    rows.iter().enumerate().for_each(|(i, row)| all.set_row(i, row));
    let film = place.film(canary, |out| kernel.call(&sphere, &all, out, width, place.streaming));
    let levels = place.film(Vec4::ZERO, |out| floats.call(&sphere, &all, out, width, false));
    let is_byte = size_of::<P>() < size_of::<Vec4>();
    let shown = |(i, pixel): (usize, &P)| {
        let Some(at) = i.checked_sub(place.first).filter(|at| *at < place.count) else { return Some(*pixel) };
        let row: &LitRow<E> = &rows[at / width];
        let column = (at % width) as f64;
        let u = column - row.start.to_f64() + row.j.to_f64() - row.m.to_f64();
        let is_sure = row.a.to_f64() - u * u > 1e-5 * row.a.to_f64();
        let in_span = (row.start.to_f64()..row.end.to_f64()).contains(&column);
        let has_level = !is_byte || [levels[i].x, levels[i].y, levels[i].z].iter().all(|level| *level < 255.0);
        (is_sure && has_level && !(estimated && in_span)).then_some(*pixel)
    };
    add(made, "pixels", &film.iter().enumerate().map(shown).collect::<Vec<_>>());
}

/// Spheres and the sizes of pictures that show them.
fn row_cases() -> Vec<(u32, u32, Sphere)> {
    // A sphere that the middle row touches.
    let touched = Sphere { radius: 3.0, colour: Vec3::ONE, centre: Vec3::new(0.0, 3.0, 10.0) };
    let sizes = [(201, 151), (1, 67), (333, 5)];
    sizes
        .into_iter()
        .flat_map(|(width, height)| {
            many(60, 0, 7).spheres.into_iter().chain([touched]).map(move |s| (width, height, s))
        })
        .collect()
}

/// The rows of a sphere, computed some at a time.
fn found_rows(table: &'static PacketKernels, &(width, height, sphere): &(u32, u32, Sphere)) -> Made {
    fn found<E: Element + Debug>(made: &mut Made, kernels: &ElementKernels<E>, scene: &Scene) {
        let Some(form) = LitForm::of::<E>(scene, Keep::NOTHING).map(Box::new) else { return };
        let height = scene.camera.height();
        for first in (0..height).step_by(LIT_ROWS - 1) {
            let (count, mut rows) = ((height - first).min(LIT_ROWS as u32 - 1) as usize, Box::new(LitRows::<E>::ZERO));
            kernels.lit_rows.call(form.setup(Scale::Linear), first, count, &mut rows);
            let row = |i: usize| Some(rows.row(i)).filter(|row| row.start < row.end);
            (0..count).for_each(|i| add(made, "rows", &row(i)));
        }
    }
    let many = many(0, 0, 7);
    let camera = Camera::new(width, height, 1.0, 1.0).unwrap();
    let scene = Scene { camera, spheres: vec![sphere], lights: many.lights[..1].to_vec(), ..many.clone() };
    let mut made = Made::new();
    found(&mut made, &table.single, &scene);
    found(&mut made, &table.double, &scene);
    made
}

/// In Rust four bytes have the alignment 1.
#[test]
fn pictures_of_four_bytes_may_begin_at_any_address() {
    for scene in [Scene { lights: many(1, 0, 1).lights[..1].to_vec(), ..many(1, 0, 1) }, many(3, 3, 1)] {
        let scene = Scene { camera: scene.camera.sized(83, 35).unwrap(), ..scene };
        let all = Engine::ALL.iter().filter(|engine| engine.usable() && engine.is_packet());
        for (engine, precision) in all.flat_map(|engine| engine.precisions().iter().map(move |p| (engine, *p))) {
            let tracer = engine.prepare(Some(precision), &scene).unwrap();
            let picture = |first: usize| {
                let mut bytes = vec![7; first + 4 * 83 * 35 + 5];
                let end = bytes.len() - 5;
                tracer.rows(0..35, FilmMut::Rgba8(bytes[first..end].as_chunks_mut().0));
                assert!(bytes[..first].iter().chain(&bytes[end..]).all(|byte| *byte == 7), "{engine} at {first}");
                bytes[first..end].to_vec()
            };
            assert!((1..8).all(|first| picture(first) == picture(0)), "{engine} in {precision}");
        }
    }
}
