//! The engines agree: with the reference on every scene, with each other, and with themselves for
//! any number of threads.

use std::fs;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use crate::contenders::{Truth, contenders, film};
use crate::extent;
use glam::DVec3;
use rayo::internals::kernels::Vec4;
use rayo::internals::render::{
    Developed, Development, Engine, Film, FilmMut, Found, Frame, PixelFormat, Settings, Tracer,
};
use rayo::internals::scene::{self, Camera, MAX_SIDE, Object, Scene, Sphere, many};

/// The most intersection tests for a picture in these tests: about a second by the slowest engine.
const MOST_TESTS: u64 = 50_000_000;
/// The most intersection tests in a sampled run.
const SAMPLED_TESTS: u64 = 8_000_000;

/// The scenes of the project by name, at their full size or reduced to [`MOST_TESTS`].
fn scenes() -> Vec<(String, Scene)> {
    let directory = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("scenes");
    let paths = fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().path());
    let mut paths: Vec<_> = paths.filter(|path| path.extension().is_some_and(|extension| extension == "in")).collect();
    paths.sort();
    assert!(paths.len() >= 5, "the scenes are missing: {paths:?}");
    let load = |path: &std::path::PathBuf| {
        let scene = scene::read(path).unwrap_or_else(|error| panic!("{error}"));
        let camera = reduced(&scene);
        (format!("{} at {}x{}", scene.name, camera.width(), camera.height()), Scene { camera, ..scene })
    };
    paths.iter().map(load).collect()
}

/// The scene's camera with the pixels reduced as far as necessary.
fn reduced(scene: &Scene) -> Camera {
    let camera = &scene.camera;
    let objects = (scene.spheres.len() + scene.triangles.len()) as u64;
    let most = if extent::all() { MOST_TESTS } else { SAMPLED_TESTS };
    let factor = (most as f64 / (camera.pixels() * objects.max(1)) as f64).sqrt().min(1.0);
    let side = |pixels: u32| ((f64::from(pixels) * factor) as u32).max(1);
    Camera::new(side(camera.width()), side(camera.height()), camera.focal(), camera.film()).unwrap()
}

#[test]
fn engines_agree_with_the_reference_but_on_outlines() {
    for (name, scene) in scenes() {
        let truth = Truth::new(&scene);
        for contender in contenders() {
            let found = truth.check(&contender, &name);
            println!(
                "{name}: {contender}: {} of {} silhouette pixels differ, elsewhere by {} at most",
                found.differing, found.silhouette, found.worst
            );
        }
    }
}

#[test]
fn the_comparison_can_fail() {
    let (width, height) = (203, 151);
    let scene = Scene { camera: Camera::new(width, height, 1.0, 1.0).unwrap(), ..many(40, 40, 11) };
    let truth = Truth::new(&scene);
    let at_silhouette = |i: &usize| truth.at_silhouette(*i as u32 / width, *i as u32 % width);
    let pixels = 0..(width * height) as usize;
    let inner = pixels.clone().find(|i| !at_silhouette(i)).unwrap();
    let outline: Vec<_> = pixels.filter(at_silhouette).collect();
    type Change<'a> = &'a dyn Fn(&mut Vec<[u8; 3]>);
    let table: [(&str, bool, Change); 5] = [
        ("nothing", true, &|_| {}),
        ("an inner pixel by one level", true, &|bytes| bytes[inner][0] ^= 1),
        ("an inner pixel by two levels", false, &|bytes| bytes[inner][2] ^= 2),
        ("all by a pixel", false, &|bytes| bytes.rotate_right(1)),
        ("an outline pixel of 500", false, &|bytes| {
            outline.iter().step_by(500).for_each(|&i| bytes[i] = [255, 0, 255])
        }),
    ];
    let reference = contenders()[0];
    for (what, agrees, change) in table {
        let mut bytes = reference.bytes(&scene);
        change(&mut bytes);
        assert_eq!(truth.compare(&reference, &bytes).is_ok(), agrees, "changed {what}");
    }
}

#[test]
fn frame_tells_hits_and_refuses_films_of_other_sizes() {
    let scene = Scene { camera: Camera::new(61, 47, 1.0, 1.0).unwrap(), ..many(20, 20, 3) };
    let truth = Truth::new(&scene);
    for contender in contenders() {
        let tracer = contender.prepare(&scene);
        let frame = Frame::new(&*tracer, scene.camera, Settings { threads: 1 }).unwrap();
        let mut hits = 0;
        // Hits found row by row are those of the whole picture.
        let all = tracer.hits(0..47);
        for (i, (row, column)) in (0..47).flat_map(|row| (0..61).map(move |column| (row, column))).enumerate() {
            let hit = frame.hit(column, row);
            let found = hit.map(|hit| (hit.object, hit.normal));
            assert_eq!(found, all[i].map(|found| (found.object, found.normal)), "{contender}: {row} {column}");
            if truth.at_silhouette(row, column) {
                continue;
            }
            assert_eq!(hit.map(|hit| hit.object), truth.object(row, column), "{contender}: {row} {column}");
            let Some(hit) = hit else { continue };
            hits += 1;
            let normal = hit.normal.unwrap_or_else(|| panic!("{contender}: {hit:?}"));
            let of_triangle = |[a, b, c]: [DVec3; 3]| (a, (b - a).cross(c - a).normalize());
            let (on, across) = match hit.object {
                Object::Sphere(sphere) => {
                    let Sphere { centre, radius, .. } = scene.spheres[sphere];
                    let outwards = (hit.place - centre.as_dvec3()).normalize();
                    (centre.as_dvec3() + f64::from(radius) * outwards, outwards)
                }
                Object::Triangle(triangle) => of_triangle(scene.triangles[triangle].vertices.map(|v| v.as_dvec3())),
            };
            assert!((hit.place - on).dot(across).abs() < 1e-3, "{contender}: {hit:?}");
            assert!(normal.dot(across).abs() > 0.999 && (normal.length() - 1.0).abs() < 1e-3, "{contender}: {hit:?}");
        }
        assert!(hits > 200 && frame.hit(61, 0).is_none() && frame.hit(0, 47).is_none(), "{contender}: {hits}");
        let mut film = frame.film(PixelFormat::F32x4, 2).unwrap();
        let mut error = |rows| frame.trace(rows, film.as_mut(), &|_| ()).unwrap_err().to_string();
        let (pixels, rows) =
            ("pixels of the film: found 122, expected 183", "rows of the picture: found 48, expected 47");
        assert_eq!(error(0..3), format!("the picture cannot be traced: {pixels}"));
        assert_eq!(error(46..48), format!("the picture cannot be traced: {rows}"));
    }
}

#[test]
fn missing_rows_have_no_hits_and_take_no_memory() {
    let [many_objects, sphere] = [many(20, 20, 3), many(1, 0, 3)];
    for (scene, width, height) in [(&many_objects, 61, 47), (&sphere, 61, 47), (&many_objects, MAX_SIDE, 2)] {
        let lights = scene.lights[..1].to_vec();
        let scene = Scene { camera: Camera::new(width, height, 1.0, 1.0).unwrap(), lights, ..scene.clone() };
        for contender in contenders() {
            let tracer = contender.prepare(&scene);
            let developed = Developed::new(&*tracer, &scene.camera, Development::default());
            let frame = Frame::new(&*tracer, scene.camera, Settings { threads: 1 }).unwrap();
            for tracer in [&*tracer, &developed] {
                assert_eq!(tracer.hits(height - 1..u32::MAX).len(), width as usize, "{contender}");
                assert!(tracer.hits(height..u32::MAX).is_empty() && tracer.hits(u32::MAX - 1..u32::MAX).is_empty());
                assert_eq!(tracer.count(1..u32::MAX), tracer.count(1..height), "{contender}");
            }
            assert_eq!(frame.count(1..u32::MAX), tracer.count(1..height), "{contender}");
            assert!(frame.film(PixelFormat::Rgb8, u32::MAX).is_err() && frame.film(PixelFormat::Rgb8, height).is_ok());
            let mut pixels = vec![Vec4::default(); width as usize * (height as usize + 1)];
            for (rows, tracer) in [0..height + 1, height..height + 1].into_iter().zip([&*tracer, &developed]) {
                let own = &mut pixels[..width as usize * rows.len()];
                let mut refused = |trace: &mut dyn FnMut(&mut [Vec4])| {
                    let panic = catch_unwind(AssertUnwindSafe(|| trace(own))).expect_err("a panic");
                    assert_eq!(panic.downcast_ref(), Some(&"the picture has no such rows"), "{contender}: {rows:?}");
                };
                refused(&mut |own| tracer.rows(rows.clone(), FilmMut::F32x4(own)));
                refused(&mut |own| _ = tracer.light(rows.clone(), &|rows, _| rows, Vec4::default(), own));
            }
        }
    }
}

/// The other tests skip these engines, so that this one reports them.
#[test]
fn engines_that_this_cpu_does_not_run_are_told() {
    for engine in Engine::ALL.iter().filter(|engine| !engine.usable()) {
        extent::not_run(engine.name(), "its kernels and its pictures");
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    // A picture wide enough for several tasks, whose width is no multiple of a packet's.
    let plain = Scene { camera: Camera::new(1003, 97, 1.0, 1.0).unwrap(), ..many(20, 20, 6) };
    for (contender, shadows) in contenders().into_iter().flat_map(|one| [(one, false), (one, one.engine.has_shadows())])
    {
        let scene = Scene { shadows, ..plain.clone() };
        let tracer = contender.prepare(&scene);
        for format in PixelFormat::ALL.into_iter().filter(|format| tracer.writes(*format)) {
            let [alone, others @ ..] = [1, 2, 3, 7].map(|threads| film(tracer.as_ref(), scene.camera, threads, format));
            assert!(others.iter().all(|other| *other == alone), "{contender}, shadows {shadows}");
        }
    }
}

#[test]
fn rows_split_in_any_way_give_the_same_bytes() {
    // The height is no multiple of a tile's 32 rows.
    let scene = Scene { camera: Camera::new(101, 131, 1.0, 1.0).unwrap(), ..many(40, 60, 7) };
    let width = scene.camera.width() as usize;
    for contender in contenders() {
        let tracer = contender.prepare(&scene);
        let Film::F32x4(whole) = film(tracer.as_ref(), scene.camera, 1, PixelFormat::F32x4) else { unreachable!() };
        for step in [1, 7, 31, 32, 33, 130] {
            let mut split = vec![[f32::NAN; 4].into(); whole.len()];
            // The parts are traced in reverse order.
            for (i, part) in split.chunks_mut(step * width).enumerate().rev() {
                let start = (i * step) as u32;
                tracer.rows(start..start + (part.len() / width) as u32, FilmMut::F32x4(part));
            }
            assert!(split == whole, "{contender}: {step} rows at a time");
        }
    }
}

/// Users of the library may implement `Tracer`.
#[test]
fn tracer_gets_rows_of_the_picture_alone() {
    struct Plain(u32);
    impl Tracer for Plain {
        fn writes(&self, format: PixelFormat) -> bool {
            format == PixelFormat::F32x4
        }
        fn rows_together(&self) -> u32 {
            self.0
        }
        fn rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
            let FilmMut::F32x4(out) = out else { unreachable!() };
            let width = out.len() / rows.len();
            out.iter_mut()
                .enumerate()
                .for_each(|(at, pixel)| *pixel = [rows.start as f32 + (at / width) as f32; 4].into());
        }
        fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
            vec![None; rows.len()]
        }
    }
    let camera = Camera::new(2, 5, 1.0, 1.0).unwrap();
    let development = Development { samples: 2, ..Development::default() };
    for together in [0, 1, 3, u32::MAX] {
        let tracer = Plain(together);
        let films = [
            film(&tracer, camera, 2, PixelFormat::F32x4),
            film(&Developed::new(&tracer, &camera, development), camera, 2, PixelFormat::F32x4),
        ];
        for (light, picture) in [0.0, 0.5].into_iter().zip(films) {
            let Film::F32x4(picture) = picture else { unreachable!() };
            let scale = 2.0 * light + 1.0;
            let rows = picture.chunks(2).map(|row| row[1].lanes()[0]);
            assert!(rows.eq((0..5).map(|row| row as f32 * scale + light)), "{together}");
        }
    }
}

/// A single sphere under one light is traced by the closed form, which has a short form.
#[cfg(all(feature = "asm", target_arch = "x86_64"))]
mod short_form {
    use glam::{DVec3, Vec3};
    use rayo::internals::plan::Omission;
    use rayo::internals::render::{Engine, Precision, Purpose};
    use rayo::internals::scene::{self, Camera, Rng, Scene};

    use crate::contenders::{Contender, Truth, packets};

    /// A sphere of radius 1 that fills a picture from `kappa` radii away, or lies anywhere on its
    /// border, under a light at the distance `gap` from its surface.
    fn lit_sphere(kappa: f64, gap: f64, rng: &mut Rng) -> Scene {
        let mut number = |from: f64, to: f64| from + (to - from) * (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        let film = 2.6 / (kappa * kappa - 1.0).sqrt();
        let [x, y] = [film, film].map(|film| number(-0.3, 0.3) * film);
        let centre = kappa * DVec3::new(x, y, 1.0).normalize();
        // The light is on the camera's side of the sphere, or slightly behind its outline.
        let towards = DVec3::new(number(-1.0, 1.0), number(-1.0, 1.0), number(-1.0, 0.3)).normalize();
        let light = centre + (1.0 + gap) * towards;
        Scene {
            lights: vec![scene::Light { intensity: 1.0, colour: Vec3::ONE, position: light.as_vec3() }],
            spheres: vec![scene::Sphere { centre: centre.as_vec3(), radius: 1.0, colour: Vec3::new(1.0, 0.5, 0.25) }],
            ..Scene::new(Camera::new(53, 41, 1.0, film as f32).unwrap())
        }
    }

    /// The short form satisfies SPHERE_LIT's error bound. It is used at all: otherwise a far sphere
    /// would take several times as long.
    #[test]
    fn closed_form_is_within_its_bound_from_any_distance() {
        let mut rng = Rng::new(7);
        let packets = packets();
        let mut worst = 0.0_f64;
        for case in 0..300 {
            let kappa = 10f64.powf(0.2 + 4.8 * f64::from(case) / 300.0);
            // The nearest lights are on both sides of the limit below which the short form is not
            // used.
            let nearest = if case % 2 == 0 { 0.55 } else { 0.7 };
            let gap = if case % 3 == 0 { kappa } else { nearest * 4f64.powi(case % 7) };
            let scene = lit_sphere(kappa, gap, &mut rng);
            let (sphere, light) = (scene.spheres[0], scene.lights[0]);
            let (centre, at) = (sphere.centre.as_dvec3(), light.position.as_dvec3());
            let distance = (at - centre).length();
            let (gap, terms) = (distance - 1.0, 3.0 * distance + 1.0);
            let loss = f64::max(terms / gap, (distance * distance - 1.0 + 2.0 * terms) / (gap * gap));
            let truth = Truth::new(&scene);
            let exact = Contender { engine: Engine::Reference, precision: Precision::Double }.floats(&scene);
            for contender in &packets {
                let what = format!("case {case}, {contender}, {kappa} radii, light at {gap}");
                truth.check(contender, &what);
                let report = contender.plan(&scene, Purpose::default()).report();
                let short = report.left_out.iter().any(|line| line.what == Omission::Loop.what());
                assert_eq!(short, loss < 32.0, "{what}: a loss of {loss}");
                if !short || contender.precision.name() != "single" {
                    continue;
                }
                for (i, (found, expected)) in contender.floats(&scene).into_iter().zip(&exact).enumerate() {
                    let (row, col) = (i as u32 / scene.camera.width(), i as u32 % scene.camera.width());
                    let d = DVec3::from(scene.camera.grid::<f64>().ray(row, col));
                    let s = 1.0 - centre.cross(d).length_squared() / d.length_squared();
                    // Even closer to the outline, hit and miss are both right.
                    if s < 2e-6 {
                        continue;
                    }
                    let bound = 2f64.powi(-24) * (1.0 + loss * (1.0 + 1.0 / s.sqrt()));
                    let error = f64::from((found[0] - expected[0]).abs());
                    assert!(error < bound, "{what}: {error} at {row}, {col}, where the bound is {bound}");
                    worst = worst.max(error / bound);
                }
            }
        }
        println!("the worst share of the bound: {worst:.2}");
        assert!(worst > 0.1, "it was not put to the test");
    }
}
