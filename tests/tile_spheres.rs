//! Spheres in tiles: their kernels give the bits of the formulas here, one sphere at a time, whatever the instruction set.

#![cfg(rayo_asm)]

use glam::DVec3;
use rayo::kernels::{
    CHUNK, Element, Isa, PacketKernels, Seen, SpanKernels, SphereRecords, Spheres, TileBuffers, packets,
};
use rayo::plan::{Keep, Tiles};
use rayo::scene::{Camera, Grid, Light, Rng, Scene, Sphere, many};

/// What is known of a sphere in front.
struct InFront {
    /// Columns and rows, with fractions.
    bounds: [[f64; 2]; 2],
    /// The ray at its origin.
    origin: DVec3,
    /// The fields of its planes but for the last two.
    planes: [f64; 12],
    /// The fields of its record but for the last ones.
    looks: [f64; 20],
}

/// A sphere that is wholly in front of the camera's plane, with the camera outside; None if it is not.
fn in_front(sphere: &Sphere, grid: &Grid<f64>, scale: f64, sides: [u32; 2]) -> Option<InFront> {
    let Grid { step, half_width, half_height, focal } = *grid;
    let (centre, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
    // In units of the radius.
    let c = centre / radius;
    let k = c.dot(c) - 1.0;
    if c.z.is_nan() || c.z < 1.001 || !k.is_finite() {
        return None;
    }
    let columns = silhouette(c.x, c.z).map(|x| (focal * x + half_width) / step - 0.5);
    let rows = silhouette(c.y, c.z).map(|y| (half_height - focal * y) / step - 0.5);
    let rows = [rows[1], rows[0]];
    let [width, height] = sides.map(f64::from);
    let middle = |[low, high]: [f64; 2], side: f64| (0.5 * (low + high)).round().clamp(0.0, side);
    let (column, row) = (middle(columns, width), middle(rows, height));
    // The ray at the origin, and what i columns and j rows add to it.
    let d = DVec3::new(step * (column + 0.5) - half_width, half_height - step * (row + 0.5), focal);
    let (across, down) = (DVec3::X * step, DVec3::Y * -step);
    // D = d.d - |c x d|^2, both of them quadratic in i and j: no difference of large numbers for a far sphere.
    let (a, u, v) = (c.cross(d), c.cross(across), c.cross(down));
    let square = (scale / (k * radius)).powi(2);
    let quadratic = [
        d.dot(d) - a.dot(a),
        2.0 * (d.dot(across) - a.dot(u)),
        2.0 * (d.dot(down) - a.dot(v)),
        across.dot(across) - u.dot(u),
        -2.0 * u.dot(v),
        down.dot(down) - v.dot(v),
    ];
    let [d0, dx, dy, dxx, dxy, dyy] = quadratic.map(|x| x * square);
    let reach =
        |[low, high]: [f64; 2], origin: f64, side: f64| (high.min(side) - origin).max(origin - low.max(0.0)) + 1.0;
    let (i, j) = (reach(columns, column, width), reach(rows, row, height));
    let unit = f64::from(f32::EPSILON);
    let terms = [d0, dx * i, dy * j, dxx * i * i, dxy * i * j, dyy * j * j];
    let bound = 4.0 * unit * terms.iter().map(|term| term.abs()).sum::<f64>();
    let (over, h) = (scale / (k * radius), c.dot(d));
    // n / t = (d - h c / k) - sqrt(D) c / k, over the radius.
    let normal = |d: DVec3, h: f64| (d - h / k * c) * (scale / radius);
    let (m, mx, my) = (normal(d, h), normal(across, c.dot(across)), normal(down, c.dot(down)));
    Some(InFront {
        bounds: [columns, rows],
        origin: d,
        planes: [column, row, d0, dx, dy, dxx, dxy, dyy, bound, h * over, c.dot(across) * over, c.dot(down) * over],
        looks: [
            column, row, d0, dx, dy, dxx, dxy, dyy, m.x, mx.x, my.x, m.y, mx.y, my.y, m.z, mx.z, my.z, c.x, c.y, c.z,
        ],
    })
}

/// One light on a sphere in the short form, and whether that is accurate enough for bytes in f32.
fn short_lit(planned: &InFront, sphere: &Sphere, light: &Light, grid: &Grid<f64>, scale: f64) -> ([f64; 8], bool) {
    let radius = f64::from(sphere.radius);
    let (c, l) = (sphere.centre.as_dvec3() / radius, light.position.as_dvec3() / radius);
    let from_centre = (light.position.as_dvec3() - sphere.centre.as_dvec3()) / radius;
    let k = c.dot(c) - 1.0;
    let (kn, ke) = (k - c.dot(l), l.dot(l) - k);
    let (products, gap) = ((c.length() + 1.0) * from_centre.length(), from_centre.length() - 1.0);
    let loss = f64::max((kn.abs() + products) / gap, (ke.abs() + 2.0 * products) / (gap * gap));
    let q = from_centre * (scale / radius);
    let weights = light.radiance() * (255.0 * sphere.colour.as_dvec3());
    let numbers = [q.dot(planned.origin), q.x * grid.step, -q.y * grid.step, kn, ke, weights.x, weights.y, weights.z];
    (numbers, gap > 0.25 && gap < 2f64.powi(36) && loss < 1024.0)
}

/// The same in the long form, for lights up to `far` radii away.
fn lit(sphere: &Sphere, light: &Light, far: f64) -> [f64; 8] {
    let mut l = (light.position.as_dvec3() - sphere.centre.as_dvec3()) / f64::from(sphere.radius);
    if l.length() > far {
        l *= far / l.length();
    }
    let weights = light.radiance() * (255.0 * sphere.colour.as_dvec3());
    [l.x, l.y, l.z, 0.0, weights.x, weights.y, weights.z, 0.0]
}

/// Where a sphere's silhouette ends along one axis at distance 1: |cx - cz x| = sqrt(x^2 + 1), solved for x.
fn silhouette(cx: f64, cz: f64) -> [f64; 2] {
    let m = cz * cz - 1.0;
    let root = (cx * cx + m).sqrt();
    let b = cx * cz;
    // The product of the two is (cx^2 - 1) / m.
    let product = (cx - 1.0) * (cx + 1.0);
    if b >= 0.0 { [product / (b + root), (b + root) / m] } else { [(b - root) / m, product / (b - root)] }
}

/// The first pixel of a range of coordinates, and the one past the last << 16.
fn first_and_past([low, high]: [f64; 2], side: u32) -> u32 {
    const MARGIN: f64 = 1e-3;
    // Casts saturate.
    let first = ((low - MARGIN).ceil() as u32).min(side);
    let past = ((high + MARGIN).floor() + 1.0).clamp(0.0, side.into()) as u32;
    first | past << 16
}

/// Spheres in the picture, across its borders, around the camera, behind it; some lights are far away.
fn scene(seed: u64) -> Scene {
    let mut rng = Rng::new(seed);
    let camera = Camera::new(333, 217, 1.0, 1.0).unwrap();
    let mut scene = Scene { camera, ..many(0, 0, seed) };
    scene.lights.extend([1e12, 1e30].map(|far| Light { position: [far, 2.0, -far].into(), ..scene.lights[0] }));
    for i in 0..200 {
        let z = rng.between(-3.0, 30.0);
        let mut across = || rng.between(-0.7, 0.7) * z.abs().max(2.0);
        let centre = [across(), across(), z].into();
        let radius = 1e-3 + 2.0 * rng.next_f32().powi(4);
        let colour = [rng.next_f32(), rng.next_f32(), 1.0].into();
        // Some lie on an axis.
        let centre = if i % 9 == 0 { glam::Vec3::new(0.0, 0.0, z) } else { centre };
        scene.spheres.push(Sphere { radius, colour, centre });
    }
    scene
}

fn check<E: Element + std::fmt::Debug>(packets: &'static PacketKernels, kernels: &SpanKernels<E>, scene: &Scene) {
    let plan = Tiles::<E>::new(scene, &scene.camera, packets, Keep::NOTHING, 1);
    let (view, grid, scale) = (&plan.levels().spheres, scene.camera.grid::<f64>(), plan.scale());
    let sides = [scene.camera.width(), scene.camera.height()];
    let mut found = vec![Seen::default(); scene.spheres.len().next_multiple_of(CHUNK)];
    let (count, _) = packets.sphere_bounds.call(view, &scene.spheres, 0, true, &mut found).unwrap();
    assert_eq!(count, scene.spheres.len());
    let far = if size_of::<E>() == 4 { 2f64.powi(36) } else { 1e30 };
    let rounded = |numbers: &[f64]| numbers.iter().map(|number| E::from_f64(*number)).collect::<Vec<_>>();
    let (mut fronts, mut sideways, mut shorts, mut longs) = (0, 0, 0, 0);
    for seen in found[..count].chunks(CHUNK) {
        let spheres = Spheres { balls: &scene.spheres, seen };
        let (mut buffers, mut records) = (TileBuffers::<E>::default(), SphereRecords::default());
        kernels.tiles.sphere_set_up.call(view, spheres, 7, &mut buffers);
        kernels.tiles.sphere_looks.call(view, spheres, plan.sphere_lights(), true, 0, &mut records);
        for (i, seen) in seen.iter().enumerate() {
            let sphere = &scene.spheres[seen.id as usize];
            let Some(front) = in_front(sphere, &grid, scale, sides) else {
                let behind = f64::from(sphere.centre.z) / f64::from(sphere.radius) <= -1.0;
                let whole = sides.map(|side| side << 16);
                let expected = if behind { ([0; 2], 0.0) } else { (whole, Seen::ANY) };
                assert_eq!(([seen.columns, seen.rows], seen.near), expected, "{sphere:?}");
                continue;
            };
            fronts += 1;
            let bounds = [0, 1].map(|axis| first_and_past(front.bounds[axis], sides[axis]));
            assert_eq!([seen.columns, seen.rows], bounds, "{sphere:?}");
            let nearest = scale * grid.focal / (f64::from(sphere.centre.z) - f64::from(sphere.radius));
            let c = sphere.centre.as_dvec3() / f64::from(sphere.radius);
            if c.dot(c) > 2.0 * c.z * c.z - 1.0 {
                sideways += 1;
                assert_eq!(seen.near, Seen::ANY, "{sphere:?}");
            } else {
                assert!((1.0005..1.0015).contains(&(f64::from(seen.near) / nearest)), "{sphere:?}");
            }
            let p = buffers.sphere_planes();
            let planes = [
                &p.column, &p.row, &p.d0, &p.dx, &p.dy, &p.dxx, &p.dxy, &p.dyy, &p.bound, &p.h, &p.hx, &p.hy, &p.most,
                &p.id,
            ];
            let own = [f64::from(seen.near), (7 + i) as f64];
            assert_eq!(planes.map(|plane| plane[i])[..], rounded(&[&front.planes[..], &own].concat()), "{sphere:?}");
            let numbers = records.spheres[i].numbers();
            assert_eq!(numbers[..20], rounded(&front.looks), "{sphere:?}");
            let mut short = true;
            for (number, light) in scene.lights.iter().enumerate() {
                let of_light = i * scene.lights.len() + number;
                let (expected, accurate) = short_lit(&front, sphere, light, &grid, scale);
                assert_eq!(records.shorts[of_light].numbers(), rounded(&expected), "{sphere:?} {light:?}");
                short &= accurate;
            }
            assert_eq!(numbers[20..], rounded(&[f64::from(u8::from(short)), 0.0, 0.0, 0.0]), "{sphere:?}");
            (shorts, longs) = (shorts + usize::from(short), longs + usize::from(!short));
            for (number, light) in scene.lights.iter().enumerate().filter(|_| !short) {
                let of_light = i * scene.lights.len() + number;
                assert_eq!(records.lits[of_light].numbers(), rounded(&lit(sphere, light, far)), "{sphere:?} {light:?}");
            }
        }
    }
    assert!(
        fronts > 50 && sideways > 0 && (scene.lights.len() > 2 || shorts > 10) && longs > 0,
        "{fronts}, {shorts}, {longs}"
    );
}

#[test]
fn kernels_of_spheres_give_the_bits_of_one_sphere_at_a_time() {
    for seed in 1..5 {
        let far = scene(seed);
        let mut near = far.clone();
        near.lights.truncate(1);
        for kernels in [Isa::Sse41, Isa::Avx2, Isa::Avx512].into_iter().filter_map(packets) {
            for scene in [&near, &far] {
                check(kernels, &kernels.single, scene);
                check(kernels, &kernels.double, scene);
            }
        }
    }
}
