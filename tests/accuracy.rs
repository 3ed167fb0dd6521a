//! The truth in 256 bits, against f64 where f64 is beyond doubt and against brute force where it is not.

use glam::{DVec3, Vec3};
use rayo::reference::exact::{self, Exact, Rays};
use rayo::render::reference::ReferenceTracer;
use rayo::render::{Distance, Engine, Film, Found, PixelFormat, TrueHit, Truth};
use rayo::scene::{self, Camera, Light, Object, Rng, Scene, Sphere, Triangle};

/// Doubtful for f64: 64 times the rounding of a number.
const DOUBT_OF_F64: f64 = 64.0 * f64::EPSILON;

fn shipped(name: &str) -> Scene {
    let path = format!("{}/scenes/{name}.in", env!("CARGO_MANIFEST_DIR"));
    scene::read(path.as_ref()).unwrap()
}

fn camera(scene: &Scene, width: u32, height: u32) -> Camera {
    Camera::new(width, height, scene.camera.focal(), scene.camera.film()).unwrap()
}

fn relative(t: f64, truth: &Exact) -> f64 {
    (&(&Exact::new(t) - truth) / truth).to_f64().abs()
}

#[test]
fn the_truth_of_an_ordinary_scene_is_what_the_reference_says() {
    let mut hits = 0;
    let scenes = ["sphere", "tetrahedron", "triangle", "two-lights", "many"].map(shipped);
    for scene in scenes.into_iter().chain([scene::many(40, 40, 7)]) {
        let camera = camera(&scene, 80, 60);
        let (truth, reference) = (Truth::new(&scene, &camera), ReferenceTracer::new(&scene, &camera));
        for (row, col) in (0..60).flat_map(|row| (0..80).map(move |col| (row, col))) {
            let (pixel, found) = (truth.pixel(row, col), reference.hit(row, col));
            if pixel.margin < DOUBT_OF_F64 {
                continue;
            }
            let place = format!("{} row {row} col {col}: {pixel:?} {found:?}", scene.name);
            assert_eq!(pixel.hit.as_ref().map(|hit| hit.object), found.map(|hit| hit.object), "{place}");
            let (Some(TrueHit { t, colour: Some(colour), .. }), Some(found)) = (pixel.hit, found) else {
                continue;
            };
            // These spheres are small: the difference of long vectors in f64 costs a few digits, and the limb some more.
            assert!(relative(found.t, &t) < 1e-10, "{place}");
            let off = (reference.colour(row, col) - colour).abs().max_element();
            assert!(off < 1e-9, "off by {off:e} {place}");
            hits += 1;
        }
    }
    assert!(hits > 5000, "only {hits} hits");
}

/// Stiff objects, one of a kind: far spheres, ground spheres, slivers, grazing and far triangles.
fn stiff(rng: &mut Rng) -> (Vec<Sphere>, Vec<Triangle>) {
    let mut aim = |distance: f32| distance * Vec3::new(rng.between(-0.35, 0.35), rng.between(-0.25, 0.25), 1.0);
    let spheres = [1e3_f32, 1e5, 1e7].map(|far| Sphere {
        radius: far * 0.2,
        colour: Vec3::ONE,
        // In the picture and beside it by turns, a few percent of the distance from the axis.
        centre: aim(far),
    });
    let thin = [3e-3_f32, 3e-5].map(|r| Sphere { radius: r * 200.0, colour: Vec3::ONE, centre: aim(200.0) });
    let ground = Sphere { radius: 1e7, colour: Vec3::ONE, centre: Vec3::new(0.0, -1e7 - 1.0, 0.0) };
    let triangles = [1.0_f32, 1e-3, 1e-6].map(|height| {
        let (a, b) = (aim(100.0), aim(100.0));
        Triangle { colour: Vec3::ONE, vertices: [a, b, a + 0.5 * (b - a) + Vec3::new(0.0, 40.0 * height, 0.0)] }
    });
    let grazing = Triangle { colour: Vec3::ONE, vertices: [aim(10.0), aim(1e4), aim(1e4) + Vec3::Y * 1e-2] };
    ([&spheres[..], &thin, &[ground]].concat(), [&triangles[..], &[grazing]].concat())
}

#[test]
fn what_f64_rules_out_is_never_what_256_bits_hit() {
    let (mut hits, mut near_misses) = (0, 0);
    for seed in 1..=4 {
        let (spheres, triangles) = stiff(&mut Rng::new(seed));
        let camera = Camera::new(64, 48, 1.0, 1.0).unwrap();
        let rays = Rays::new(64, 48, 1.0, 1.0);
        let scene = Scene { name: String::new(), camera, lights: Vec::new(), spheres, triangles };
        let truth = Truth::new(&scene, &camera);
        for (row, col) in (0..48).flat_map(|row| (0..64).map(move |col| (row, col))) {
            let ray = rays.ray(row, col);
            let mut nearest: Option<(Object, Exact)> = None;
            let mut meet = |object: Object, meeting: exact::Meeting| {
                near_misses += usize::from(meeting.miss.is_some());
                if let Some(t) = meeting.hit.filter(|t| nearest.as_ref().is_none_or(|(_, nearest)| t < nearest)) {
                    nearest = Some((object, t));
                }
            };
            for (i, sphere) in scene.spheres.iter().enumerate() {
                let sphere = exact::Sphere::new(sphere.centre.as_dvec3().into(), sphere.radius.into()).unwrap();
                meet(Object::Sphere(i), sphere.meet(&ray));
            }
            for (i, triangle) in scene.triangles.iter().enumerate() {
                let triangle = exact::Triangle::new(triangle.vertices.map(|v| v.as_dvec3().into())).unwrap();
                meet(Object::Triangle(i), triangle.meet(&ray));
            }
            let found = truth.pixel(row, col).hit.map(|hit| (hit.object, hit.t));
            assert_eq!(found, nearest, "seed {seed} row {row} col {col}");
            hits += usize::from(nearest.is_some());
        }
    }
    assert!(hits > 1000 && near_misses > 1000, "{hits} hits, {near_misses} near misses");
}

fn one_light(spheres: Vec<Sphere>, triangles: Vec<Triangle>, at: Vec3) -> (Scene, Camera) {
    let camera = Camera::new(9, 9, 1.0, 1.0).unwrap();
    let lights = vec![Light { intensity: 1.0, colour: Vec3::ONE, position: at }];
    (Scene { name: String::new(), camera, lights, spheres, triangles }, camera)
}

/// The middle of the picture looks along +z.
const MIDDLE: (u32, u32) = (4, 4);

#[test]
fn the_margin_is_the_gap_to_the_second_hit_and_an_exact_tie_is_no_doubt() {
    let sphere = |radius: f32, z: f32| Sphere { radius, colour: Vec3::ONE, centre: Vec3::new(0.0, 0.0, z) };
    for (second, gap) in [(sphere(1.0, 10.0), 1.0), (sphere(1.0, 10.0009), 1e-4), (sphere(2.0, 12.0), 1.0 / 9.0)] {
        let (scene, camera) = one_light(vec![sphere(1.0, 10.0), second], Vec::new(), Vec3::ZERO);
        let pixel = Truth::new(&scene, &camera).pixel(MIDDLE.0, MIDDLE.1);
        assert_eq!(pixel.hit.as_ref().unwrap().object, Object::Sphere(0));
        assert!((pixel.margin - gap).abs() < 1e-6, "{gap}: {}", pixel.margin);
    }
}

#[test]
fn a_near_miss_in_front_is_a_doubt_and_one_behind_is_none() {
    // Its edge passes a little beside the middle.
    let beside = |z: f32| {
        let vertices = [Vec3::new(1e-6, -z, z), Vec3::new(1e-6, z, z), Vec3::new(z, 0.0, z)];
        Triangle { colour: Vec3::ONE, vertices }
    };
    let wall = |z: f32| {
        let vertices = [Vec3::new(-9.0 * z, -9.0 * z, z), Vec3::new(9.0 * z, -9.0 * z, z), Vec3::new(0.0, 9.0 * z, z)];
        Triangle { colour: Vec3::ONE, vertices }
    };
    for (z, doubt) in [(2.0, true), (20.0, false)] {
        let (scene, camera) = one_light(Vec::new(), vec![beside(z), wall(5.0)], Vec3::ZERO);
        let pixel = Truth::new(&scene, &camera).pixel(MIDDLE.0, MIDDLE.1);
        assert_eq!(pixel.hit.unwrap().object, Object::Triangle(1));
        assert_eq!(pixel.margin < 1e-5, doubt, "{z}: {}", pixel.margin);
    }
}

#[test]
fn a_light_on_the_surface_makes_any_colour_right() {
    let sphere = Sphere { radius: 1.0, colour: Vec3::ONE, centre: Vec3::new(0.0, 0.0, 3.0) };
    for (z, colour) in [(2.0, None), (1.9999, None), (1.0, Some(DVec3::ONE)), (-5.0, Some(DVec3::ONE))] {
        let (scene, camera) = one_light(vec![sphere], Vec::new(), Vec3::new(0.0, 0.0, z));
        let pixel = Truth::new(&scene, &camera).pixel(MIDDLE.0, MIDDLE.1);
        let near = |a: DVec3, b: DVec3| (a - b).length() < 1e-15;
        match (pixel.hit.unwrap().colour, colour) {
            (Some(a), Some(b)) => assert!(near(a, b), "{z}: {a}"),
            (a, b) => assert_eq!(a, b, "{z}"),
        }
    }
}

#[test]
fn what_an_engine_says_that_it_hits_is_what_it_draws() {
    // Each object has a hue of its own, and the light is in the camera, so that nothing that is seen is dark.
    let mut scene = scene::many(30, 30, 5);
    scene.lights = vec![Light { intensity: 1.0, colour: Vec3::ONE, position: Vec3::ZERO }];
    let mut rng = Rng::new(3);
    let mut hue = || Vec3::new(rng.between(0.2, 1.0), rng.between(0.2, 1.0), rng.between(0.2, 1.0)).normalize();
    scene.spheres.iter_mut().for_each(|sphere| sphere.colour = hue());
    scene.triangles.iter_mut().for_each(|triangle| triangle.colour = hue());
    let camera = camera(&scene, 203, 151);
    let pixels = camera.pixels() as usize;
    let tracers = Engine::ALL.iter().filter(|engine| engine.usable()).flat_map(|engine| {
        engine.precisions().iter().map(|p| (*engine, *p, engine.prepare(Some(*p), &scene, &camera).unwrap()))
    });
    for (engine, precision, tracer) in tracers {
        let mut film = Film::new(PixelFormat::F32x4, pixels).unwrap();
        tracer.rows(0..151, film.as_mut());
        let Film::F32x4(film) = film else { unreachable!() };
        let found = tracer.hits(0..151);
        assert_eq!(found.len(), pixels);
        // In two pieces it is the same.
        assert_eq!([tracer.hits(0..40), tracer.hits(40..151)].concat(), found);
        let mut hits = 0;
        for (i, (pixel, found)) in film.iter().zip(&found).enumerate() {
            let drawn = DVec3::new(pixel.x.into(), pixel.y.into(), pixel.z.into());
            let what = format!("{engine} {precision} pixel {i}: {found:?}, drawn {drawn}");
            let Some(Found { object, distance, normal }) = found else {
                assert_eq!(drawn, DVec3::ZERO, "{what}");
                continue;
            };
            hits += 1;
            let colour = match object {
                Object::Sphere(i) => scene.spheres[*i].colour,
                Object::Triangle(i) => scene.triangles[*i].colour,
            };
            // A limb is dark.
            let dark = drawn.length() < 1e-3;
            assert!(dark || drawn.normalize().distance(colour.as_dvec3()) < 1e-3, "{what}");
            let t = match distance {
                Distance::T(t) => *t,
                Distance::Inverse(inverse) => 1.0 / inverse,
            };
            let d = DVec3::from(camera.grid::<f64>().ray(i as u32 / 203, i as u32 % 203));
            if let Some(normal) = normal {
                assert!((normal.length() - 1.0).abs() < 1e-3, "{what}");
                // The cosine at the point is what was drawn; the limb of a small sphere is a difference of long vectors.
                let cosine = (-normal.dot(d) / d.length()).abs();
                assert!((cosine - drawn.length()).abs() < 0.02, "{what}, cosine {cosine}");
            }
            assert!((20.0..70.0).contains(&t), "{what}");
        }
        assert!(hits > pixels / 4, "{engine} {precision}: {hits} hits");
    }
}
