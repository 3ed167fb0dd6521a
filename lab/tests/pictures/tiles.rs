//! Objects, tile by tile: what is left out changes no byte, ties go to the first, meshes have no
//! holes.

use crate::contenders::{Contender, Truth, check_by_force, film, packets};
use crate::extent;
use glam::{DVec3, Vec3};
use rayo::internals::kernels::Vec4;
use rayo::internals::plan::{Keep, Omission, Report};
use rayo::internals::render::{
    Counted, Distance, Engine, Film, FilmMut, Found, PixelFormat, Plan, Precision, Purpose, Tracer,
};
use rayo::internals::scene::mesh::Placement;
use rayo::internals::scene::{
    self, Camera, Faces, Light, MAX_SIDE, Object, Rng, Scene, Sphere, ToCamera, Triangle, View, many,
};
use std::ops::Range;

const FORMATS: [PixelFormat; 2] = [PixelFormat::F32x4, PixelFormat::Rgba8];

fn tiles<'a>(contender: &Contender, scene: &'a Scene) -> Box<dyn Tracer + 'a> {
    contender.plan(scene, Purpose::default()).into_tracer()
}

fn camera(width: u32, height: u32) -> Camera {
    Camera::new(width, height, 1.0, 1.0).unwrap()
}

/// Objects of all sizes at random places, in the picture, across its edges and the camera's plane,
/// and behind it.
fn scattered(spheres: usize, triangles: usize, seed: u64, camera: Camera) -> Scene {
    let mut rng = Rng::new(seed);
    let mut scene = Scene { camera, ..many(0, 0, seed) };
    scene.lights.truncate(1 + (seed % 2) as usize);
    let mut place = |size: f32| {
        let z = rng.between(-2.0, 20.0);
        let spread = |rng: &mut Rng| rng.between(-0.6, 0.6) * z.abs().max(size);
        ([spread(&mut rng), spread(&mut rng), z], size * rng.next_f32().powi(4), [rng.next_f32(), 0.5, 0.25])
    };
    for _ in 0..spheres {
        let (centre, radius, colour) = place(3.0);
        scene.spheres.push(Sphere { radius: radius + 0.001, colour: colour.into(), centre: centre.into() });
    }
    for _ in 0..triangles {
        let (centre, size, colour) = place(8.0);
        let mut corner = || [0, 1, 2].map(|i| centre[i] + size * place(1.0).2[0] - size * place(1.0).2[0]).into();
        scene.triangles.push(Triangle { colour: colour.into(), vertices: [corner(), corner(), corner()] });
    }
    scene
}

/// Walls of 8 x 8 pixels before some parts of the tiles, and at many depths behind them what they
/// hide, or not.
fn behind_walls(seed: u64) -> Scene {
    let camera = camera(192, 96);
    let (grid, mut rng) = (camera.grid::<f64>(), Rng::new(seed));
    let mut scene = Scene { camera, ..many(0, 0, seed) };
    let mut add = |first: [f64; 2], side: f64, depth: f64, rng: &mut Rng| {
        let at = |x: f64, y: f64| {
            let (x, y) = ((first[0] + x * side) * grid.step, (first[1] + y * side) * grid.step);
            (depth / grid.focal * DVec3::new(x - grid.half_width, grid.half_height - y, grid.focal)).as_vec3()
        };
        let colour = Vec3::from_array([(); 3].map(|()| rng.between(0.1, 1.0)));
        let corners = [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 1.0), at(0.0, 1.0)];
        scene.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|of| Triangle { colour, vertices: of.map(|i| corners[i]) }));
        let radius = 0.4 * side * grid.step * depth / grid.focal;
        scene.spheres.push(Sphere { radius: radius as f32, colour, centre: (1.0 + rng.next_f32()) * at(0.5, 0.5) });
    };
    for (row, column) in (0..12).flat_map(|row| (0..24).map(move |column| (row, column))) {
        if !rng.next_u64().is_multiple_of(4) {
            let depth = rng.between(1.0, 1.2).into();
            add([f64::from(column) * 8.0, f64::from(row) * 8.0], 8.0, depth, &mut rng);
        }
    }
    for _ in 0..1500 {
        let first = [rng.between(0.0, 188.0), rng.between(0.0, 92.0)].map(f64::from);
        let (side, depth) = (rng.between(1.0, 9.0).into(), rng.between(2.0, 20.0).into());
        add(first, side, depth, &mut rng);
    }
    scene
}

/// Spheres before and behind a tilted triangle, which covers some tiles of a picture of many, one
/// below another, and is in parts of others.
fn about_a_wall(seed: u64) -> Scene {
    let (camera, mut rng) = (Camera::new(16, 3200, 1.0, 2.0).unwrap(), Rng::new(seed));
    let corners = [[-9.0, 4.0, 3.0], [0.2, 4.0, 3.0], [-0.05, -3.0, 6.0]].map(Vec3::from_array);
    let mut sphere = |_| {
        let y = rng.between(-4.0, 4.0);
        let centre = Vec3::new(0.0, y, 3.0 + 3.0 * (4.0 - y) / 7.0 + rng.between(-0.01, 0.8));
        Sphere { centre, radius: rng.between(0.005, 0.03), colour: Vec3::ONE }
    };
    let spheres = (0..8000).map(&mut sphere).collect();
    Scene {
        spheres,
        triangles: vec![Triangle { vertices: corners, colour: Vec3::X }],
        ..Scene { camera, ..many(0, 0, seed) }
    }
}

/// Scenes of great depth: one object behind another all over the picture, and all around the
/// camera.
fn deep(seed: u64) -> Vec<(&'static str, Scene)> {
    let mut rng = Rng::new(seed);
    let empty = Scene { camera: camera(203, 97), ..many(0, 0, seed) };
    // Of this size at some depth and place, tilted by so much of it.
    let mut triangles = |count: usize, size: f32, around: f32, tilt: f32, depths: [f32; 2]| {
        let mut of = |low: f32, high: f32| low + rng.next_f32() * (high - low);
        let mut triangle = |_| {
            let z = of(depths[0], depths[1]);
            let [x, y] = [0.5, 0.25].map(|side| of(-around, around) * side * z.abs());
            let turn = of(0.0, 6.0);
            let corner = |i: u8| {
                let (sin, cos) = (turn + 2.1 * f32::from(i)).sin_cos();
                Vec3::new(x + size * z * cos, y + size * z * sin, z)
            };
            let vertices = [0, 1, 2].map(corner).map(|corner| corner + Vec3::Z * z * of(-tilt, tilt));
            Triangle { colour: Vec3::new(of(0.0, 1.0), of(0.0, 1.0), 1.0), vertices }
        };
        Scene { triangles: (0..count).map(&mut triangle).collect(), ..empty.clone() }
    };
    let walls = triangles(900, 3.0, 0.0, 0.0, [2.0, 6.0]);
    let nearest_last = |scene: &Scene| {
        let mut triangles = scene.triangles.clone();
        triangles.sort_by(|a, b| b.vertices[0].z.total_cmp(&a.vertices[0].z));
        Scene { triangles, ..scene.clone() }
    };
    let one_wall = triangles(1, 3.0, 0.0, 0.0, [2.0, 2.0]);
    let scenes = [
        ("walls from far to near", nearest_last(&walls)),
        ("walls", walls),
        ("walls through one another", triangles(300, 3.0, 0.0, 0.25, [3.0, 4.0])),
        ("large triangles", triangles(2000, 0.2, 1.0, 0.1, [2.0, 6.0])),
        ("triangles of a tile or two", triangles(3000, 0.1, 1.0, 0.02, [2.0, 6.0])),
        ("triangles around the camera", triangles(2000, 0.3, 3.0, 2.0, [-3.0, 3.0])),
    ];
    let mut spheres = |count: usize, most: f32, beyond: f32| {
        let mut sphere = |_| {
            let [x, y, z] = [0; 3].map(|_| 6.0 * rng.next_f32() - 3.0);
            let centre = Vec3::new(x, y, if beyond > 0.0 { beyond + z.abs() } else { z });
            Sphere { centre, radius: (centre.length() * most * rng.next_f32()).max(1e-3), colour: Vec3::ONE }
        };
        Scene { spheres: (0..count).map(&mut sphere).collect(), ..empty.clone() }
    };
    let with = |scene: Scene, triangles: &Scene| Scene { triangles: triangles.triangles.clone(), ..scene };
    scenes
        .into_iter()
        .chain([
            ("spheres around the camera", spheres(1500, 0.6, 0.0)),
            ("the camera in many spheres", spheres(100, 2.0, 0.0)),
            ("large spheres", spheres(2000, 0.3, 4.0)),
            ("spheres behind a wall", with(spheres(2000, 0.05, 3.0), &one_wall)),
            ("spheres about a wall", about_a_wall(seed)),
        ])
        .collect()
}

#[test]
fn what_is_left_out_changes_no_byte() {
    let crowds = [(60, 0, 1), (0, 300, 2), (30, 200, 3), (5, 900, 4), (200, 20, 5), (5000, 9, 6)];
    for (spheres, triangles, seed) in extent::sampled(crowds, 2) {
        let scene = scattered(spheres, triangles, seed, camera(203, 97));
        check_by_force(&scene, &format!("{spheres}, {triangles}, seed {seed}"));
    }
    (1..4).for_each(|seed| check_by_force(&behind_walls(seed), &format!("behind walls, seed {seed}")));
    deep(1).iter().for_each(|(name, scene)| check_by_force(scene, name));
}

#[test]
fn overfull_tile_is_the_same_in_any_order_of_triangles() {
    let camera = camera(64, 32);
    let mut scene = Scene { camera, ..many(3, 40_000, 5) };
    // Many have a pixel, and they lie in many depths.
    let mut rng = Rng::new(5);
    for triangle in &mut scene.triangles {
        let [a, b, c] = triangle.vertices;
        let (middle, depth) = ((a + b + c) / 3.0, rng.between(0.5, 2.0));
        triangle.vertices = triangle.vertices.map(|corner| depth * (middle + 8.0 * (corner - middle)));
    }
    // And then before a wall, so that every pixel is somebody's.
    for wall in [false, true] {
        if wall {
            scene.spheres.clear();
            let vertices = [[-900.0, -900.0, 99.0], [900.0, -900.0, 99.0], [0.0, 900.0, 99.0]].map(Vec3::from_array);
            scene.triangles.push(Triangle { colour: Vec3::ONE, vertices });
        }
        let mut reversed = scene.clone();
        reversed.triangles.reverse();
        for contender in packets() {
            for format in FORMATS {
                let [one, other] = [&scene, &reversed].map(|scene| contender.bits(scene, format, Keep::NOTHING));
                assert!(one == other, "{contender}, {format:?}");
                let mut film = Film::new(format, one.len()).unwrap();
                let hits = tiles(&contender, &reversed).counted_rows(0..32, film.as_mut()).unwrap().hits;
                assert_eq!(hits == one.len() as u64, wall, "{contender}, {format:?}: {hits} hits");
                let distinct: std::collections::BTreeSet<_> = one.into_iter().collect();
                assert!(distinct.len() > 100, "{contender}: {} colours", distinct.len());
            }
        }
    }
}

#[test]
fn overfull_tile_keeps_the_nearest_spheres() {
    let mut rng = Rng::new(6);
    let mut scene = Scene { camera: camera(64, 32), ..many(0, 0, 6) };
    for _ in 0..70_000 {
        let z = rng.between(2.0, 9.0);
        let [x, y] = [0.4, 0.2].map(|side| rng.between(-side, side) * z);
        let colour = Vec3::new(rng.next_f32(), rng.next_f32(), 1.0);
        scene.spheres.push(Sphere { radius: rng.between(0.001, 0.003) * z, colour, centre: Vec3::new(x, y, z) });
    }
    for contender in extent::sampled(packets(), 4) {
        contender.check_kept(&scene, Keep::all(), "many spheres");
    }
}

/// Spheres that nearly touch the camera's plane, through a very wide lens.
fn beside_the_camera() -> Scene {
    let mut rng = Rng::new(4);
    let mut scene = Scene { camera: Camera::new(203, 151, 1.0, 30.0).unwrap(), ..many(0, 0, 4) };
    for _ in 0..40 {
        let [x, y] = [20.0, 15.0].map(|side| rng.between(-side, side));
        let colour = Vec3::new(rng.next_f32(), 0.5, 1.0);
        scene.spheres.push(Sphere { radius: 1.0, colour, centre: Vec3::new(x, y, rng.between(1.001, 1.02)) });
    }
    scene
}

#[test]
fn floats_are_within_a_few_roundings_of_the_reference() {
    for scene in [Scene { camera: camera(203, 151), ..many(40, 400, 6) }, beside_the_camera()] {
        let truth = Truth::new(&scene);
        let reference = rayo::internals::render::reference::ReferenceTracer::new(&scene);
        let inside = (0..151 * 203)
            .map(|i| (i / 203, i % 203))
            .map(|(row, column)| (!truth.at_silhouette(row, column)).then(|| reference.colour(row, column).to_array()));
        let inside: Vec<_> = inside.collect();
        for contender in packets().into_iter().filter(|contender| contender.precision.name() != "fast") {
            let Film::F32x4(film) = film(tiles(&contender, &scene).as_ref(), scene.camera, 1, PixelFormat::F32x4)
            else {
                unreachable!()
            };
            let mut worst = 0.0_f64;
            for (pixel, expected) in film.iter().zip(&inside) {
                let numbers = pixel.lanes().into_iter().zip(expected.iter().flatten());
                worst = numbers.map(|(a, b)| (f64::from(a) - *b).abs()).fold(worst, f64::max);
            }
            println!("{contender}: {worst:e}");
            assert!(worst < 5e-6, "{contender}: {worst:e}");
        }
    }
}

/// A floor from under the camera to far away, whose horizon is aslant: near to it there is little
/// left of the terms of 1/t.
#[test]
fn what_is_steep_is_as_far_as_it_is() {
    let mut scene = Scene { camera: camera(203, 97), ..many(0, 40, 6) };
    let vertices = [[-64.0, 15.0, 0.015_625], [64.0, -17.0, 0.015_625], [1024.0, -257.0, 4096.0]].map(Vec3::from_array);
    scene.triangles.push(Triangle { colour: Vec3::ONE, vertices });
    let reference = rayo::internals::render::reference::ReferenceTracer::new(&scene);
    for contender in packets() {
        let hits = tiles(&contender, &scene).hits(0..97);
        let errors = (0..).zip(&hits).filter_map(|(i, found)| {
            let (found, truth) = (found.as_ref()?, reference.hit(i / 203, i % 203)?);
            let Distance::Inverse(inverse) = found.distance else { unreachable!("as tiles compare it") };
            (found.object == Object::Triangle(40) && truth.object == found.object)
                .then(|| (inverse * truth.t - 1.0).abs())
        });
        let (count, worst) = errors.fold((0, 0.0), |(count, worst), error| (count + 1, f64::max(worst, error)));
        println!("{contender}: {count} pixels, {worst:e}");
        let most = if contender.precision.name() == "double" { 1e-13 } else { 16.0 / f64::from(1 << 24) };
        assert!(count > 1000 && worst < most, "{contender}: {count} pixels, {worst:e}");
    }
}

/// Bounds have 16 bits, as many as the longest side needs.
#[test]
fn the_longest_sides_are_as_in_the_reference() {
    for (width, height) in [(MAX_SIDE, 3), (2, MAX_SIDE)] {
        let mut scene = Scene { camera: camera(width, height), ..many(0, 0, 1) };
        for i in -4..5_i16 {
            let along = |at: f32| if width > height { Vec3::new(at, 0.0, 4.0) } else { Vec3::new(0.0, at, 4.0) };
            let (at, colour) = (f32::from(i) * 0.4, Vec3::new(0.5, 0.1 * f32::from(i).abs(), 1.0));
            scene.spheres.push(Sphere { radius: 0.1, colour, centre: along(at) });
            let beside = Vec3::new(if width > height { 0.0 } else { 1.0 }, if width > height { 1.0 } else { 0.0 }, 0.0);
            let vertices = [along(at + 0.15), along(at + 0.3) + beside, along(at + 0.25) - beside];
            scene.triangles.push(Triangle { colour, vertices });
        }
        let truth = Truth::new(&scene);
        for contender in extent::sampled(packets(), 3) {
            let tracer = tiles(&contender, &scene);
            truth.check(&contender, &format!("{width} x {height}"));
            let hits = tracer.hits(1..height).into_iter().map(|found| found.map(|found| found.object));
            let expected = (1..height).flat_map(|row| (0..width).map(move |column| (row, column)));
            let differing =
                hits.zip(expected).filter(|(hit, (row, column))| *hit != truth.object(*row, *column)).count();
            assert!(differing < 10, "{contender}: {differing}");
            let kept = contender.plan(&scene, Purpose::default()).report().kept;
            assert_eq!((kept.spheres, kept.triangles), (9, 9), "{contender}");
        }
    }
}

#[test]
fn planning_sees_what_is_invalid_among_all_others() {
    type Spoil = fn(&mut Scene);
    let spoils: [(&str, Spoil); 8] = [
        ("light 2's intensity must be finite and at least 0, not -1", |scene| scene.lights[1].intensity = -1.0),
        ("sphere 7's radius", |scene| scene.spheres[6].radius = 0.0),
        ("sphere 7's radius", |scene| scene.spheres[6].radius = -0.0),
        ("sphere 7's radius", |scene| scene.spheres[6].radius = -1.0),
        ("sphere 7's centre", |scene| scene.spheres[6].centre.y = f32::NAN),
        ("sphere 7's colour", |scene| scene.spheres[6].colour.y = -1.0),
        ("triangle 7's vertices", |scene| scene.triangles[6].vertices[1].x = f32::INFINITY),
        ("triangle 7's colour", |scene| scene.triangles[6].colour.z = f32::NAN),
    ];
    for (field, spoil) in spoils {
        let mut scene = many(60, 60, 1);
        spoil(&mut scene);
        for contender in packets() {
            let purpose = Purpose { precision: Some(contender.precision), ..Purpose::default() };
            let error = Plan::new(contender.engine, &scene, purpose).err().map(|error| error.to_string());
            assert!(error.as_ref().is_some_and(|error| error.contains(field)), "{contender}, {field}: {error:?}");
        }
    }
}

#[test]
fn planning_on_several_threads_gives_the_same_bytes() {
    let mut scene = Scene { camera: camera(301, 131), ..many(20_000, 50_000, 9) };
    let others = scattered(20_000, 20_000, 9, scene.camera);
    scene.spheres.extend(others.spheres.into_iter().filter(|sphere| sphere.radius < 0.1));
    scene.triangles.extend(others.triangles);
    for contender in packets() {
        let picture = |threads: usize| {
            let tracer = contender.plan(&scene, Purpose { threads, ..Purpose::default() }).into_tracer();
            film(tracer.as_ref(), scene.camera, 1, PixelFormat::F32x4)
        };
        let alone = picture(1);
        for threads in [0, 2, 3] {
            assert!(picture(threads) == alone, "{contender}, {threads} threads");
        }
    }
}

#[test]
fn what_shares_its_corners_is_seen_as_what_has_its_own() {
    let mut joined = scattered(40, 60, 8, camera(200, 150));
    for (place, count, colour) in [(3.6, 9000, Vec3::ONE), (2.9, 320, Vec3::new(1.0, 0.25, 0.0)), (3.4, 80, Vec3::Y)] {
        let placement = Placement { translate: DVec3::new(0.1, 0.5 - place / 8.0, place), ..Placement::IDENTITY };
        let mesh = scene::mesh::shapes::icosphere(count, 0.3, 5);
        assert!(joined.faces.append(mesh.placed(ToCamera::IDENTITY.of_placed(&placement), colour).unwrap()));
    }
    // A wall twice, of which the first wins; a corner near the camera, which is to come first; what
    // f32 does not hold; and a plane through the camera, which rounding hides.
    let wall = [(-9.0, -9.0), (9.0, -9.0), (0.0, 9.0)].map(|(x, y)| Vec3::new(x, y, 4.0));
    let near = [Vec3::new(3.0, 0.0, 5.0), Vec3::new(1e-9, 0.0, 1e-8), Vec3::new(3.0, 3.0, 5.0)];
    let far = wall.map(|corner| 1e20 * corner);
    let through = [Vec3::new(0.0, 1.0, -1e25), Vec3::splat(-1e38), Vec3::splat(1e30)];
    for (corners, colour) in
        [(wall, Vec3::X), (wall, Vec3::Z), (near, Vec3::ONE), (far, Vec3::ONE), (through, Vec3::ONE)]
    {
        assert!(joined.faces.append(Faces::new(corners.to_vec(), vec![[0, 1, 2], [2, 1, 0]], colour)));
    }
    let mut apart = joined.clone();
    apart.triangles.extend(std::mem::take(&mut apart.faces).iter());
    let count = apart.triangles.len();
    assert!(joined.triangle_count() == count && joined.all_triangles().eq(apart.triangles.iter().copied()));
    assert!((0..count).all(|number| joined.triangle(number) == apart.triangles[number]));
    let view = View { position: DVec3::new(0.3, 0.2, -1.0), look_at: DVec3::new(0.0, 0.1, 3.0), up: DVec3::Y };
    let scaled = (joined.scaled(0.25), apart.scaled(0.25));
    let moved = (joined.seen_from(view).unwrap(), apart.seen_from(view).unwrap());
    for (joined, apart) in extent::sampled([(joined, apart), scaled, moved], 3) {
        for contender in packets() {
            for format in FORMATS {
                let [one, other] = [&joined, &apart].map(|scene| contender.bits(scene, format, Keep::NOTHING));
                assert!(one == other, "{contender}, {format:?}");
            }
            let found = |scene| tiles(&contender, scene).hits(0..150);
            assert_eq!(found(&joined), found(&apart), "{contender}");
            let report = |scene| contender.plan(scene, Purpose::default()).report();
            // What hides what depends on the order in which they are asked.
            let counts = |report: &Report| {
                let lines = report
                    .left_out
                    .iter()
                    .filter(|line| !matches!(line.omission, Omission::Occluded | Omission::Unseen));
                lines.map(|line| (line.what, line.count)).collect::<Vec<_>>()
            };
            let [one, other] = [report(&joined), report(&apart)];
            assert_eq!((one.kept, counts(&one)), (other.kept, counts(&other)), "{contender}");
        }
    }
}

/// Spheres around the camera, across its plane and beside it: the fewest and the most that a kernel
/// traces.
fn around_the_camera() -> Vec<Sphere> {
    let sphere = |radius, centre: [f32; 3]| Sphere { radius, colour: [1.0; 3].into(), centre: centre.into() };
    vec![
        sphere(90.0, [1.0, 2.0, 30.0]),
        sphere(60.0, [0.0, -50.0, -20.0]),
        sphere(3.0, [-4.5, 0.0, 1.0]),
        sphere(2.0, [0.5, 4.0, 2.001]),
        sphere(2.0, [4.0, -0.5, 2.02]),
    ]
}

#[test]
fn first_of_equal_objects_is_seen_in_any_order_of_work() {
    let among_many = |spheres: usize, triangles: usize, camera| Scene { camera, ..many(spheres, triangles, 17) };
    let mut around = among_many(40, 0, Camera::new(203, 151, 0.5, 1.0).unwrap());
    around.spheres.extend(around_the_camera());
    for once in [among_many(500, 0, camera(203, 151)), among_many(0, 500, camera(203, 151)), around] {
        let painted = |colour: Vec3| {
            let mut scene = once.clone();
            scene.spheres.iter_mut().for_each(|sphere| sphere.colour = colour);
            scene.triangles.iter_mut().for_each(|triangle| triangle.colour = colour);
            scene
        };
        // Each object twice: the first one white, and its copy black somewhere behind it in the
        // list.
        let (once, copies) = (painted(Vec3::ONE), painted(Vec3::ZERO));
        let mut twice = once.clone();
        twice.spheres.extend(copies.spheres.into_iter().rev());
        twice.triangles.extend(copies.triangles.into_iter().rev());
        for contender in packets() {
            for format in FORMATS {
                let [once_seen, seen] = [&once, &twice].map(|scene| contender.bits(scene, format, Keep::NOTHING));
                assert!(once_seen == seen, "{contender}, {format:?}, {} spheres", once.spheres.len());
            }
        }
    }
}

/// The second is in so many tiles that it is traced before those of a tile alone.
#[test]
fn first_of_equally_near_triangles_is_seen() {
    let facing = |colour: Vec3, size: f32| {
        let corners = [[-0.5, -0.5, 4.0], [0.5, -0.5, 4.0], [-0.5, 0.5, 4.0]].map(Vec3::from_array);
        Triangle { colour, vertices: corners.map(|v| Vec3::new(size * v.x, size * v.y, v.z)) }
    };
    let scene = Scene { camera: camera(640, 480), ..many(0, 0, 3) };
    let triangles = vec![facing(Vec3::X, 0.25), facing(Vec3::ONE, 64.0), facing(Vec3::Y, 0.5)];
    let scene = Scene { triangles, ..scene };
    for contender in packets() {
        let hits = tiles(&contender, &scene).hits(239..240);
        assert!(matches!(hits[318], Some(Found { object: Object::Triangle(0), .. })), "{contender}: {:?}", hits[318]);
    }
    check_by_force(&scene, "triangles");
}

/// A house in metres, and the sun.
fn with_a_sun(seed: u64) -> Scene {
    let mut scene = Scene { camera: camera(203, 151), ..many(30, 30, seed) };
    let (position, colour) = (Vec3::new(2e10, 5e10, 1.4e11), Vec3::ONE);
    // Its light comes from where f32 has no squares.
    scene.lights.push(Light { intensity: 0.5, colour, position: 1e15 * position });
    scene.spheres.push(Sphere { radius: 7e8, colour, centre: position });
    scene.spheres.push(Sphere { radius: 2e10, colour, centre: [-2e10, 3e10, 1.4e11].into() });
    scene
}

#[test]
fn sun_over_a_house_is_asked_in_its_tiles_alone() {
    let scene = with_a_sun(3);
    let truth = Truth::new(&scene);
    check_by_force(&scene, "a sun");
    for contender in packets() {
        truth.check(&contender, "a sun");
        let tracer = tiles(&contender, &scene);
        let hits = tracer.hits(0..151);
        assert!(hits.iter().flatten().any(|found| found.object == Object::Sphere(31)), "{contender}");
        // Whole tiles, and parts of some.
        for rows in [0..151, 0..32, 40..64, 33..100] {
            let of_rows = &hits[203 * rows.start as usize..203 * rows.end as usize];
            let mut film = Film::new(PixelFormat::F32x4, of_rows.len()).unwrap();
            let counted = tracer.counted_rows(rows, film.as_mut());
            let hits = of_rows.iter().flatten().count() as u64;
            assert_eq!(counted, Some(Counted { rays: of_rows.len() as u64, hits }), "{contender}");
        }
    }
}

#[test]
fn overfull_tile_keeps_spheres_with_a_pixel() {
    let camera = camera(64, 32);
    let crowd = Scene { camera, ..many(4100, 0, 7) };
    let mut scene = Scene { camera, ..many(0, 0, 1) };
    // About the corner between four pixels, and nearer to it than any of their middles; their
    // bounds hold these.
    let pixel = 10.0 * camera.grid::<f32>().step;
    for i in 0..4100 {
        let radius = pixel * (0.6 + 1e-5 * i as f32);
        scene.spheres.push(Sphere { radius, colour: [1.0; 3].into(), centre: [0.0, 0.0, 10.0].into() });
    }
    check_by_force(&crowd, "a crowd");
    for contender in packets() {
        assert!(contender.floats(&scene).concat().iter().all(|v| *v == 0.0), "{contender}: nobody has a pixel");
    }
}

/// Triangles whose corners lie on rays, and so do edges that go along a row or a column, but for
/// what f32 makes of them.
#[test]
fn rays_on_edges_are_decided_as_by_the_reference() {
    let camera = camera(203, 97);
    let (grid, mut rng) = (camera.grid::<f64>(), Rng::new(9));
    let mut scene = Scene { camera, ..many(0, 0, 9) };
    for _ in 0..200 {
        let mut pixel = |side: u64| (rng.next_u64() % side) as u32;
        let (row, column) = (pixel(97), pixel(203));
        let pixels = [(row, column), (row, pixel(203)), (pixel(97), column)];
        let vertices = pixels
            .map(|(row, column)| (DVec3::from(grid.ray(row, column)) * f64::from(rng.between(2.0, 9.0))).as_vec3());
        scene.triangles.push(Triangle { colour: Vec3::ONE, vertices });
    }
    // Around the camera in a plane with many rays, but for what f64 makes of it: nobody sees these.
    for _ in 0..100 {
        let mut share = || (rng.next_u64() >> 44) as f32 / (1 << 20) as f32;
        let vertices = [(); 3].map(|()| share() - 0.5).map(|x| Vec3::new(x, 3.0 * x, share() - 0.5));
        scene.triangles.push(Triangle { colour: Vec3::ONE, vertices });
    }
    let reference = rayo::internals::render::reference::ReferenceTracer::new(&scene);
    let truth: Vec<_> = (0..203 * 97).map(|i| reference.hit(i / 203, i % 203).map(|hit| hit.object)).collect();
    for contender in packets() {
        let hits = tiles(&contender, &scene).hits(0..97);
        let differing = hits.iter().zip(&truth).filter(|(found, truth)| found.map(|found| found.object) != **truth);
        assert_eq!(differing.count(), 0, "{contender}");
    }
}

/// A wall over more tiles than have it in their lists, which ends beside their borders.
#[test]
fn what_is_in_many_tiles_is_seen_up_to_its_last_pixels() {
    for (width, height, border) in [(140, 1060, 64.0), (2120, 70, 32.0)] {
        let camera = camera(width, height);
        let grid = camera.grid::<f64>();
        for [start, end] in [[0.25, border + 0.75], [border - 0.75, 2.0 * border + 4.0]] {
            let all = f64::from(width.max(height));
            let corners = [(start, 0.0), (end, 0.0), (start, all), (end, all)].map(|(short, long)| {
                let [x, y] = if width < height { [short, long] } else { [long, short] };
                let [x, y] = [x * grid.step - grid.half_width, grid.half_height - y * grid.step];
                (2.0 / grid.focal * DVec3::new(x, y, grid.focal)).as_vec3()
            });
            let mut scene = Scene { camera, ..many(40, 0, 3) };
            for of in [[0, 1, 2], [3, 2, 1]] {
                scene.triangles.push(Triangle { colour: Vec3::ONE, vertices: of.map(|i: usize| corners[i]) });
            }
            check_by_force(&scene, &format!("{width}x{height}, {start} to {end}"));
        }
    }
}

#[test]
fn sphere_beside_the_camera_is_seen_at_borders_of_tiles() {
    for (step, [x, y]) in extent::sampled(0_u8..40, 4)
        .flat_map(|step| [[0.0, -5.0], [0.0, 5.0], [-5.0, 0.0], [5.0, 0.0]].map(|at| (step, at)))
    {
        let mut scene = Scene { camera: camera(128, 64), ..many(40, 0, 3) };
        let radius = 4.96 + 0.002 * f32::from(step);
        scene.spheres.push(Sphere { radius, colour: Vec3::ONE, centre: Vec3::new(x, y, 2.0) });
        check_by_force(&scene, &format!("{radius} at {x}, {y}"));
    }
}

/// Walls from the middle of one pixel to that of another, but for rounding, in a picture so wide
/// that f32 has few digits left between pixels.
#[test]
fn what_ends_on_rays_of_a_wide_picture_is_seen_there() {
    let (camera, mut rng) = (camera(4000, 8), Rng::new(8));
    let (grid, mut scene) = (camera.grid::<f64>(), Scene { camera, ..many(0, 0, 8) });
    for _ in 0..400 {
        let depth = f64::from(rng.between(1.0, 9.0)) / grid.focal;
        let (first, columns, row) = (rng.next_u64() % 3990, 1 + rng.next_u64() % 9, rng.next_u64() % 7);
        let corners = [(0, 0), (columns, 0), (columns, 1), (0, 1)].map(|(column, down)| {
            (depth * DVec3::from_array(grid.ray((row + down) as u32, (first + column) as u32))).as_vec3()
        });
        let colour = Vec3::new(rng.next_f32(), rng.next_f32(), 1.0);
        scene.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|of| Triangle { colour, vertices: of.map(|i| corners[i]) }));
    }
    check_by_force(&scene, "a wide picture");
}

/// The rays inside a sphere around the camera meet triangles across its plane first, and no number
/// of f32 says how near either is.
#[test]
fn crossing_the_cameras_plane_is_nearer_than_too_near() {
    let mut scene = Scene { camera: camera(64, 32), ..many(400, 0, 3) };
    for sphere in &mut scene.spheres {
        (sphere.centre, sphere.radius) = (1e20 * sphere.centre, 1e20 * sphere.radius);
    }
    scene.spheres.push(Sphere { radius: 1e-19, colour: Vec3::ONE, centre: Vec3::ZERO });
    let corners = [[-3.0, -3.0, -0.5], [3.0, -3.0, -0.5], [0.0, 3.0, 1.5]].map(Vec3::from_array);
    for i in 0_u8..80 {
        let size = 1e-20 * (1.0 + f32::from(i) / 128.0);
        scene
            .triangles
            .push(Triangle { colour: Vec3::new(0.5, 1.0, f32::from(i)), vertices: corners.map(|v| size * v) });
    }
    for contender in packets() {
        let hits = tiles(&contender, &scene).hits(0..32);
        let of_triangle = |found: &&Option<_>| matches!(found, Some(Found { object: Object::Triangle(0), .. }));
        assert!(hits.iter().filter(of_triangle).count() > 100, "{contender}");
    }
    check_by_force(&scene, "too near for f32");
}

/// Its 1/t is 0 in f32, in the unit of the others, and its tiles are many.
#[test]
fn a_large_triangle_behind_a_tiny_scene_is_seen() {
    let mut scene = Scene { camera: camera(640, 480), ..many(0, 0, 1) };
    let corners = [[-0.3, -0.3, 1.0], [0.3, -0.3, 1.1], [0.0, 0.3, 1.05]].map(Vec3::from_array);
    for (size, aside) in [(1e-20, 1.0), (1e-20, 2.0), (1e34, 0.0)] {
        let vertices = corners.map(|v| size * (v + aside * Vec3::X));
        scene.triangles.push(Triangle { colour: Vec3::ONE, vertices });
    }
    for contender in packets() {
        let found = tiles(&contender, &scene).hits(240..241)[320];
        let is_large = matches!(found, Some(Found { object: Object::Triangle(2), .. }));
        assert!(is_large, "{contender}: {found:?}");
    }
    check_by_force(&scene, "a tiny scene before a large triangle");
}

/// A picture is one column of its tiles. In the others a triangle's 1/t would be less than f32's
/// least number, and its bound there was taken for 0.
#[test]
fn what_is_beyond_f32_only_beside_the_picture_is_seen() {
    for height in [40, 4400] {
        let mut scene = Scene { camera: camera(1, height), ..many(0, 0, 1) };
        let (size, far) = ((1 << 20) as f32, [[1.0, -1.0, 1.0], [-1.0, -1.0, 1.0], [0.0, 1.0, 1.0]]);
        let far = far.map(|v| size * Vec3::from_array(v));
        let near = [[-1.0, -0.6], [1.0, -0.6], [0.0, 0.1]].map(|[column, y]| {
            // In the unit of the far one; in the first row 1/z is negative.
            let inverse = f32::MAX * (0.05 - 0.3 * y - 0.0315 * column);
            size / inverse * Vec3::new(column / height as f32, y, 1.0)
        });
        for vertices in [far, far, near] {
            scene.triangles.push(Triangle { colour: Vec3::ONE, vertices });
        }
        for contender in packets() {
            let hits = tiles(&contender, &scene).hits(height / 2..height);
            let is_near = |found: &Option<_>| matches!(found, Some(Found { object: Object::Triangle(2), .. }));
            assert!(hits.iter().all(is_near), "{contender}, {height} rows");
        }
        check_by_force(&scene, &format!("{height} rows"));
    }
}

/// Two corners are far away on opposite sides: of the volume that a far one spans half the digits
/// are lost, and with it what is behind came through.
#[test]
fn triangle_through_all_tiles_is_as_near_as_its_corner() {
    let far = [
        [-361_616.3, -449_900.38, 343_805.1],
        [361_617.03, 449_901.56, -343_805.66],
        [0.706_873_83, -3.5535762, -3.2507455],
    ];
    let dot = [
        [-0.016285308, 0.06059567, 0.037765108],
        [-0.01585581, 0.06059567, 0.037765108],
        [-0.016070558, 0.06102517, 0.037765108],
    ];
    let triangle = |corners: [[f32; 3]; 3]| Triangle { colour: Vec3::ONE, vertices: corners.map(Vec3::from_array) };
    let triangles = [far, dot].map(triangle).to_vec();
    let light = Light { intensity: 1.0, colour: Vec3::ONE, position: Vec3::new(7.0, 0.35, -23.0) };
    for (width, height) in [(450, 1700), (9, 34)] {
        let camera = Camera::new(width, height, 0.3, 1.0).unwrap();
        let scene = Scene { camera, triangles: triangles.clone(), lights: vec![light], ..Scene::new(camera) };
        let reference = Plan::new(Engine::Reference, &scene, Purpose::default()).unwrap().into_tracer().hits(0..32);
        for contender in packets() {
            for (found, of_reference) in tiles(&contender, &scene).hits(0..32).iter().zip(&reference) {
                let object = |found: &Option<Found>| found.as_ref().map(|found| found.object);
                assert_eq!(object(found), object(of_reference), "{contender}");
            }
        }
        check_by_force(&scene, "a triangle through all tiles");
    }
}

/// Planes that all but pass through the camera, with one corner or two far away: by the volume that
/// a far one spans, nothing is there, or what is not, and no bound of 1/t holds for another's.
#[test]
fn far_reaching_object_is_as_near_as_its_nearest_corner() {
    for (focal, corners) in [
        (
            1.0,
            [
                [1368626.0, -821830.6, -3380129.0],
                [-6.182_417_4, 22.248446, 6.089421],
                [-0.776_434_3, -2.3341064, 3.304365],
            ],
        ),
        (
            0.29,
            [
                [4.2512122e11, 7.433678e10, 3.6929316e11],
                [-5726758.5, -1834032.3, 2032799.6],
                [929905.56, 995252.44, -6199708.5],
            ],
        ),
        (
            3945.9805,
            [
                [-96324.92, 36557.766, -38176.45],
                [-0.7135417, 0.2704528, -0.05388173],
                [0.5132682, -0.19469383, 0.5333368],
            ],
        ),
        (
            1.0061661,
            [
                [0.041384988, -0.1322181, 0.1076906],
                [0.0018064887, -0.005771429, 0.004700781],
                [-0.007221616, 0.023071852, -0.018791841],
            ],
        ),
        // Its products are exact, and cancel.
        (1.0, [[1.0, 0.0, 8.881784e-16], [-1.0, 1.0, -1.0], [0.0, -3.0, 3.0]]),
        (
            616.86725,
            [
                [2.4179041, 2.9496775, 3.4736676],
                [25.214285, 30.761032, 36.225105],
                [-0.04867144, -0.059375826, -0.069923535],
            ],
        ),
    ] {
        let camera = Camera::new(64, 32, focal, 1.0).unwrap();
        let triangle = Triangle { colour: Vec3::ONE, vertices: corners.map(Vec3::from_array) };
        let scene = Scene { triangles: vec![triangle], ..Scene { camera, ..many(0, 0, 1) } };
        let reference = Plan::new(Engine::Reference, &scene, Purpose::default()).unwrap().into_tracer().hits(0..32);
        for contender in packets() {
            let hits = tiles(&contender, &scene).hits(0..32);
            let is_seen = |found: &[Option<Found>]| found.iter().map(Option::is_some).collect::<Vec<_>>();
            assert_eq!(is_seen(&hits), is_seen(&reference), "{contender}, {focal}");
        }
        check_by_force(&scene, &format!("focal distance {focal}"));
    }
}

/// A needle, one that begins nearer than it ends, and a triangle of which all but a corner is far
/// away.
#[test]
fn triangle_is_the_same_from_any_first_corner() {
    let behind = [[0.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 1.0, -1.0]];
    let wall = [[-9.0, -9.0, 0.77096], [9.0, -9.0, 0.77096], [0.0, 9.0, 0.77096]];
    for (side, mut corners, wall) in [
        (128, [[0.2, 0.2, 1.75], [-8e-16, 8e-16, 1.0], [8e-16, -8e-16, 1.0]], None),
        (3, [[0.238, 0.238, 0.7], [-3e-14, 3e-14, 1.0], [3e-14, -3e-14, 1.0]], Some(wall)),
        (20, [[3e16, 2e16, 1e16], [0.0, -1.0, 10.0], [-2e16, 1e16, 7e15]], None),
        (20, [[9e17, 3e17, 1.1e18], [-8e17, 4e17, 1.2e18], [0.1, -1.0, 2.0]], None),
    ] {
        for (turns, others) in (0..3).flat_map(|turns| [(turns, 0), (turns, 4096)]) {
            corners.rotate_left(usize::from(others == 0));
            let all = [corners].into_iter().chain(wall).chain(std::iter::repeat_n(behind, others));
            let triangles = all.map(|of| Triangle { colour: Vec3::ONE, vertices: of.map(Vec3::from_array) }).collect();
            let lights = vec![Light { intensity: 1.0, colour: Vec3::ONE, position: Vec3::new(-3.0, 4.0, -5.0) }];
            let scene = Scene { triangles, lights, ..Scene { camera: camera(side, side), ..many(0, 0, 1) } };
            let what = format!("{corners:?}, {others} others, {turns} turns");
            let reference = Engine::Reference.prepare(None, &scene).unwrap();
            let picture = |tracer: &dyn Tracer| {
                let mut film = film(tracer, scene.camera, 1, PixelFormat::F32x4);
                let FilmMut::F32x4(pixels) = film.as_mut() else { unreachable!("the film was made so") };
                (
                    tracer.hits(0..side).iter().map(|found| found.map(|found| found.object)).collect::<Vec<_>>(),
                    pixels.to_vec(),
                )
            };
            let (objects, expected) = picture(&*reference);
            assert!(objects.contains(&Some(Object::Triangle(0))), "{what}");
            for contender in packets() {
                let (found, pixels) = picture(&*tiles(&contender, &scene));
                assert_eq!(found, objects, "{contender}: {what}");
                let most = if contender.precision == Precision::Double { 2e-6 } else { 1.0 / 255.0 };
                let is_near = |(a, b): (&Vec4, &Vec4)| (a.x - b.x).abs() <= most;
                assert!(pixels.iter().zip(&expected).all(is_near), "{contender}: {what}");
            }
            check_by_force(&scene, &what);
        }
    }
}

/// One is behind the camera, and its line passes through that but for rounding; the planes of the
/// others pass through it exactly.
#[test]
fn what_no_ray_hits_is_not_seen_whatever_else_there_is() {
    for corners in [
        [
            [-0.0007202606, -0.00093550154, 5.1391403e-6],
            [-2.1098394e-6, -2.7403387e-6, 1.5053942e-8],
            [1.3614357e-6, 1.7682838e-6, -9.713997e-9],
        ],
        [
            [2694840320.0, 0.0, 9162457088.0],
            [-5373952000.0, 5242880.0, -18272485376.0],
            [-1.9073486e-5, -0.055298805, 0.010994911],
        ],
        [[0.0, -4.0, 8.0], [-0.66604173, 8.037073e-9, 0.05514598], [0.0, 4.25, -8.5]],
    ] {
        let behind = |i: u16| [[0.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 1.0, -2.0 - f32::from(i)]];
        let triangle = |corners: [[f32; 3]; 3]| Triangle { colour: Vec3::ONE, vertices: corners.map(Vec3::from_array) };
        for others in [0, 5000] {
            let triangles = [corners].into_iter().chain((0..others).map(behind)).map(triangle).collect();
            let scene = Scene { camera: camera(33, 33), triangles, ..many(0, 0, 1) };
            for contender in packets() {
                let hits = tiles(&contender, &scene).hits(0..33);
                assert!(hits.iter().all(Option::is_none), "{contender}: {corners:?} and {others}");
            }
        }
    }
}

/// Of two tiles side by side without an object different rows are wanted.
#[test]
fn a_background_fills_the_wanted_rows_of_each_tile() {
    let scene = Scene { camera: camera(128, 32), ..many(0, 0, 1) };
    let (sky, other) = (Vec4::from([0.25; 4]), Vec4::from([7.0; 4]));
    let wanted = |_: Range<u32>, columns: Range<u32>| if columns.start == 0 { 0..8 } else { 16..32 };
    for contender in packets() {
        let mut light = vec![other; 128 * 32];
        tiles(&contender, &scene).light(0..32, &wanted, sky, &mut light);
        for (i, light) in (0..).zip(light) {
            let is_wanted = wanted(0..32, i % 128 / 64..0).contains(&(i / 128));
            assert!(!is_wanted || light == sky, "{contender}: pixel {i} is {light:?}");
        }
    }
}

#[test]
fn sphere_around_the_camera_is_not_seen_along_tangents() {
    let sphere = |centre| Sphere { radius: 3.0, colour: Vec3::ONE, centre };
    for centre in [3.0 * Vec3::Y, -3.0 * Vec3::Y, 3.0 * Vec3::X, -3.0 * Vec3::X] {
        let scene = Scene { camera: camera(65, 33), spheres: vec![sphere(centre)], ..many(0, 40, 3) };
        let reference = rayo::internals::render::reference::ReferenceTracer::new(&scene);
        for contender in packets() {
            for (i, found) in (0..).zip(tiles(&contender, &scene).hits(0..33)) {
                let expected = reference.hit(i / 65, i % 65).map(|hit| hit.object);
                assert_eq!(found.map(|found| found.object), expected, "{contender}: {centre}, pixel {i}");
            }
        }
    }
}

#[test]
fn nearer_sphere_around_the_camera_is_seen_beyond_f32() {
    let mut scene = many(0, 40, 3).scaled(2_f32.powi(33));
    for radius in [2e-30, 1e-30] {
        scene.spheres.push(Sphere { radius, colour: Vec3::ONE, centre: Vec3::ZERO });
    }
    for contender in packets() {
        let hits = tiles(&contender, &scene).hits(0..32);
        let nearer = |found: &Option<_>| matches!(found, Some(Found { object: Object::Sphere(1), .. }));
        assert!(hits.iter().all(nearer), "{contender}");
    }
}

/// Kernels in f32 take a light for nearer than this wall.
#[test]
fn a_wall_beyond_all_is_lit_from_where_the_light_is() {
    let mut scene = Scene { camera: camera(203, 97), ..many(0, 40, 3) };
    let position = 1e25 * Vec3::new(1.0, 2.0, 3.0);
    scene.lights = vec![Light { intensity: 1.0, colour: Vec3::ONE, position }];
    let vertices = [[-2.0, -2.0, 1.0], [2.0, -2.0, 1.0], [0.0, 2.0, 1.0]].map(|corner| 1e14 * Vec3::from_array(corner));
    scene.triangles.push(Triangle { colour: Vec3::ONE, vertices });
    let truth = Truth::new(&scene);
    for contender in packets() {
        truth.check(&contender, "a wall beyond all");
    }
}

/// Such a film is nearer than f32 can say in pixels.
#[test]
fn on_a_film_beyond_all_bounds_things_are_where_they_are() {
    for (film, focal, z) in [(1e30, 3e-16, 1e-8), (1e30, 1e-30, 1e-25), (1e36, 1e-25, 1e-28)] {
        let mut scene = Scene { camera: Camera::new(64, 48, focal, film).unwrap(), ..many(0, 0, 3) };
        let reach = (f64::from(z) * f64::from(film) / f64::from(focal)) as f32;
        let position = Vec3::new(0.0, 0.0, -reach);
        scene.lights = vec![Light { intensity: 1.0, colour: Vec3::ONE, position }];
        let corner = |x: f32, y: f32| Vec3::new(x * reach, y * reach, z);
        let vertices = [corner(-0.25, -0.2), corner(0.3, -0.15), corner(0.05, 0.25)];
        scene.triangles.push(Triangle { colour: Vec3::ONE, vertices });
        let truth = Truth::new(&scene);
        assert!((0..48).any(|row| truth.object(row, 32).is_some()));
        for contender in packets() {
            truth.check(&contender, &format!("a film of {film}"));
        }
        check_by_force(&scene, &format!("a film of {film}"));
    }
}

/// A wall of triangles whose corners, edges and diagonals lie exactly on rays: x and y of all rays
/// are multiples of 1/32.
#[test]
fn a_closed_wall_whose_corners_lie_on_rays_has_no_holes() {
    let camera = Camera::new(64, 48, 1.0, 5.0).unwrap();
    let text = "x 64 48 1  1  1 1 1 1 0 0 0  0  0";
    let mut scene = Scene { camera, ..scene::parse(text.as_bytes(), "wall").unwrap() };
    for (cell, depth) in [(1, 1.0), (2, 2.0), (3, 1.5), (7, 4.0)] {
        scene.triangles.clear();
        for (row, column) in (-1..48).step_by(cell).flat_map(|row| (-1..64).step_by(cell).map(move |col| (row, col))) {
            let corner = |row: i32, column: i32| {
                let at = |i: i32| (i as f32 + 0.5) / 16.0;
                (depth * glam::Vec3::new(at(column) - 2.0, 1.5 - at(row), 1.0)).to_array().into()
            };
            let cell = cell as i32;
            let [a, b] = [corner(row, column), corner(row, column + cell)];
            let [c, d] = [corner(row + cell, column), corner(row + cell, column + cell)];
            for vertices in [[a, b, c], [c, b, d]] {
                scene.triangles.push(Triangle { colour: [1.0; 3].into(), vertices });
            }
        }
        let reference = rayo::internals::render::reference::ReferenceTracer::new(&scene);
        let truth: Vec<_> = (0..64 * 48).map(|i| reference.hit(i / 64, i % 64).map(|hit| hit.object)).collect();
        assert!(truth.iter().all(Option::is_some), "cells of {cell}");
        for contender in packets() {
            let seen = tiles(&contender, &scene).hits(0..48).into_iter().map(|found| found.map(|found| found.object));
            assert!(seen.eq(truth.iter().copied()), "{contender}: other triangles of cells of {cell}");
        }
    }
}
