//! Spheres in tiles: their kernels give the bits of their twin, one sphere at a time, whatever the instruction set.

use glam::DVec3;
use rayo::kernels::{
    CHUNK, Candidate, Element, ElementKernels, Isa, PacketKernels, SphereChunk, SphereRecords, TileBuffers, packets,
};
use rayo::plan::{Keep, Raster, Tiles};
use rayo::reference::tile::{InFront, SphereView, lit, weights};
use rayo::scene::{Camera, Grid, Light, Rng, Scene, Sphere, many};

/// As the twin takes a sphere: its centre and radius.
fn of(sphere: &Sphere) -> (DVec3, f64) {
    (sphere.centre.as_dvec3(), sphere.radius.into())
}

/// As the twin takes a light: where it is, and what of it a sphere reflects.
fn on(sphere: &Sphere, light: &Light, most: f64) -> (DVec3, DVec3) {
    (light.position.as_dvec3(), weights(sphere.colour.as_dvec3(), 255.0, light.radiance(), most))
}

/// Spheres in the picture, across its borders, around the camera, behind it; some lights are far away, and some colours too
/// bright for f32.
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
        let colour = [rng.next_f32(), rng.next_f32(), if i % 7 == 0 { 1e38 } else { 1.0 }].into();
        // Some lie on an axis.
        let centre = if i % 9 == 0 { glam::Vec3::new(0.0, 0.0, z) } else { centre };
        scene.spheres.push(Sphere { radius, colour, centre });
    }
    scene
}

fn check<E: Element + std::fmt::Debug>(packets: &'static PacketKernels, kernels: &ElementKernels<E>, scene: &Scene) {
    let plan = Tiles::<E>::new(scene, Raster::of(&scene.camera)[0], packets, Keep::NOTHING, 1);
    let (view, scale) = (&plan.levels().spheres, plan.scale());
    let sides = [scene.camera.width(), scene.camera.height()];
    let Grid { step, half_width, half_height, focal } = scene.camera.grid::<f64>();
    let twin = SphereView { step, half_width, half_height, focal, scale, sides: sides.map(f64::from) };
    let mut found = vec![Candidate::default(); scene.spheres.len().next_multiple_of(CHUNK)];
    let (count, _) = packets.sphere_bounds.call(view, &scene.spheres, 0, true, &mut found).unwrap();
    assert_eq!(count, scene.spheres.len());
    let (far, most) = if size_of::<E>() == 4 { (2f64.powi(36), f32::MAX.into()) } else { (1e30, f64::INFINITY) };
    let rounded = |numbers: &[f64]| numbers.iter().map(|number| E::from_f64(*number)).collect::<Vec<_>>();
    let (mut fronts, mut sideways, mut shorts, mut longs) = (0, 0, 0, 0);
    for candidates in found[..count].chunks(CHUNK) {
        let spheres = SphereChunk { spheres: &scene.spheres, candidates };
        let (mut buffers, mut records) = (TileBuffers::<E>::default(), SphereRecords::default());
        kernels.tiles.sphere_set_up.call(view, spheres, 7, &mut buffers);
        kernels.tiles.sphere_shading.call(view, spheres, plan.sphere_lights(), true, 0, &mut records);
        for (i, candidate) in candidates.iter().enumerate() {
            let sphere = &scene.spheres[candidate.id as usize];
            let (centre, radius) = of(sphere);
            let bounds = twin.of_sphere(centre, radius, view.most);
            assert_eq!(([candidate.columns, candidate.rows], candidate.most), bounds, "{sphere:?}");
            let Some(front) = InFront::new(centre, radius, &twin) else { continue };
            fronts += 1;
            sideways += usize::from(candidate.most == Candidate::ANY);
            let p = buffers.sphere_planes();
            let planes = [
                &p.column, &p.row, &p.d0, &p.dx, &p.dy, &p.dxx, &p.dxy, &p.dyy, &p.bound, &p.h, &p.hx, &p.hy, &p.most,
                &p.id,
            ];
            let own = [f64::from(candidate.most), (7 + i) as f64];
            assert_eq!(planes.map(|plane| plane[i])[..], rounded(&[&front.planes[..], &own].concat()), "{sphere:?}");
            let numbers = records.spheres[i].numbers();
            assert_eq!(numbers[..20], rounded(&front.shading), "{sphere:?}");
            let mut short = true;
            for (number, light) in scene.lights.iter().enumerate() {
                let of_light = i * scene.lights.len() + number;
                let (expected, accurate) = front.short_lit(of(sphere), on(sphere, light, most), &twin);
                assert_eq!(records.shorts[of_light].numbers(), rounded(&expected), "{sphere:?} {light:?}");
                short &= accurate;
            }
            assert_eq!(numbers[20..], rounded(&[f64::from(u8::from(short)), 0.0, 0.0, 0.0]), "{sphere:?}");
            (shorts, longs) = (shorts + usize::from(short), longs + usize::from(!short));
            for (number, light) in scene.lights.iter().enumerate().filter(|_| !short) {
                let of_light = i * scene.lights.len() + number;
                assert_eq!(
                    records.lits[of_light].numbers(),
                    rounded(&lit(of(sphere), on(sphere, light, most), far)),
                    "{sphere:?} {light:?}"
                );
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
