//! The exact results in 1024 bits, the errors of engines against them, and the page of `rayo
//! accuracy`.

use std::collections::BTreeMap;

use glam::{DVec3, Vec3};
use rayo::internals::render::reference::ReferenceTracer;
use rayo::internals::render::{Film, PixelFormat, Precision, level};
use rayo::internals::scene::{self, Camera, Light, Object, Scene, Sphere, Triangle};
use rayo_lab::exact::number::Split;
use rayo_lab::experiments::accuracy::subjects::{self, Subject};
use rayo_lab::experiments::accuracy::{contenders, judge};
use rayo_lab::experiments::in_size;
use rayo_lab::truth::{TrueHit, Truth};

/// A margin that is doubtful for f64: 64 times the rounding error of a number.
const DOUBT_OF_F64: f64 = 64.0 * f64::EPSILON;

fn shipped(name: &str) -> Scene {
    let path = format!("{}/scenes/{name}.in", concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    scene::read(path.as_ref()).unwrap()
}

fn relative(t: f64, truth: Split) -> f64 {
    (truth.error_of(t) / truth.high).abs()
}

#[test]
fn the_truth_of_an_ordinary_scene_is_what_the_reference_says() {
    let mut hits = 0;
    let scenes = ["sphere", "tetrahedron", "triangle", "two-lights", "many"].map(shipped);
    for scene in scenes.into_iter().chain([scene::many(40, 40, 7)]) {
        let scene = in_size(&scene, 80, 60);
        let (truth, reference) = (Truth::new(&scene), ReferenceTracer::new(&scene));
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
            // These spheres are small compared with their distance: the difference of long vectors
            // in f64 costs a few digits, and rays near the limb some more.
            assert!(relative(found.t, t) < 1e-10, "{place}");
            let off = (reference.colour(row, col) - colour).abs().max_element();
            assert!(off < 1e-9, "off by {off:e} {place}");
            hits += 1;
        }
    }
    assert!(hits > 5000, "only {hits} hits");
}

fn one_light(spheres: Vec<Sphere>, triangles: Vec<Triangle>, at: Vec3) -> Scene {
    let camera = Camera::new(9, 9, 1.0, 1.0).unwrap();
    let lights = vec![Light { intensity: 1.0, colour: Vec3::ONE, position: at }];
    Scene { lights, spheres, triangles, ..Scene::new(camera) }
}

/// The pixel whose ray is along +z.
const MIDDLE: (u32, u32) = (4, 4);

#[test]
fn margin_is_the_gap_to_the_second_hit_but_for_ties() {
    let sphere = |radius: f32, z: f32| Sphere { radius, colour: Vec3::ONE, centre: Vec3::new(0.0, 0.0, z) };
    for (second, gap) in [(sphere(1.0, 10.0), 1.0), (sphere(1.0, 10.0009), 1e-4), (sphere(2.0, 12.0), 1.0 / 9.0)] {
        let scene = one_light(vec![sphere(1.0, 10.0), second], Vec::new(), Vec3::ZERO);
        let pixel = Truth::new(&scene).pixel(MIDDLE.0, MIDDLE.1);
        assert_eq!(pixel.hit.as_ref().unwrap().object, Object::Sphere(0));
        assert!((pixel.margin - gap).abs() < 1e-6, "{gap}: {}", pixel.margin);
    }
}

#[test]
fn a_near_miss_in_front_is_a_doubt_and_one_behind_is_none() {
    // A triangle whose edge passes slightly beside the middle.
    let beside = |z: f32| {
        let vertices = [Vec3::new(1e-6, -z, z), Vec3::new(1e-6, z, z), Vec3::new(z, 0.0, z)];
        Triangle { colour: Vec3::ONE, vertices }
    };
    let wall = |z: f32| {
        let vertices = [Vec3::new(-9.0 * z, -9.0 * z, z), Vec3::new(9.0 * z, -9.0 * z, z), Vec3::new(0.0, 9.0 * z, z)];
        Triangle { colour: Vec3::ONE, vertices }
    };
    for (z, doubt) in [(2.0, true), (20.0, false)] {
        let scene = one_light(Vec::new(), vec![beside(z), wall(5.0)], Vec3::ZERO);
        let pixel = Truth::new(&scene).pixel(MIDDLE.0, MIDDLE.1);
        assert_eq!(pixel.hit.unwrap().object, Object::Triangle(1));
        assert_eq!(pixel.margin < 1e-5, doubt, "{z}: {}", pixel.margin);
    }
}

#[test]
fn a_light_on_the_surface_makes_any_colour_right() {
    let sphere = Sphere { radius: 1.0, colour: Vec3::ONE, centre: Vec3::new(0.0, 0.0, 3.0) };
    for (z, colour) in [(2.0, None), (1.9999, None), (1.0, Some(DVec3::ONE)), (-5.0, Some(DVec3::ONE))] {
        let scene = one_light(vec![sphere], Vec::new(), Vec3::new(0.0, 0.0, z));
        let pixel = Truth::new(&scene).pixel(MIDDLE.0, MIDDLE.1);
        let near = |a: DVec3, b: DVec3| (a - b).length() < 1e-15;
        match (pixel.hit.unwrap().colour, colour) {
            (Some(a), Some(b)) => assert!(near(a, b), "{z}: {a}"),
            (a, b) => assert_eq!(a, b, "{z}"),
        }
    }
}

/// A regression test: the product of a light's intensity and colour was once rounded to f32, and
/// pixel 694 of this row became a level too bright.
#[test]
fn in_f64_a_level_is_the_true_one_however_near_the_next_it_is() {
    let scene = shipped("two-lights");
    let (row, width) = (446, scene.camera.width());
    let truth = Truth::new(&scene);
    let green = |col: u32| 255.0 * truth.pixel(row, col).hit.unwrap().colour.unwrap().y;
    assert!((1e-8..1e-6).contains(&(127.0 - green(694))), "{}", green(694));
    let of = |col: u32| truth.pixel(row, col).hit.map_or(DVec3::ZERO, |hit| hit.colour.unwrap());
    let expected: Vec<_> = (0..width).map(|col| of(col).to_array().map(level)).collect();
    for contender in contenders().into_iter().filter(|contender| contender.precision == Precision::Double) {
        let tracer = contender.prepare(&scene).unwrap();
        let mut film = Film::new(PixelFormat::Rgb8, width as usize).unwrap();
        tracer.rows(row..row + 1, film.as_mut());
        let Film::Rgb8(found) = film else { unreachable!() };
        assert_eq!(found, expected, "{}", contender.engine);
    }
}

/// The rows of the last table of errors in docs/results/accuracy.md: for each scene the cells by
/// column.
fn documented() -> BTreeMap<String, BTreeMap<String, String>> {
    let text = include_str!("../../../docs/results/accuracy.md")
        .split("<!-- errors -->\n")
        .nth(1)
        .expect("the table is marked");
    let cells = |line: &str| line.split('|').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>();
    let head = cells(text.lines().next().unwrap());
    let rows = text.lines().skip(2).take_while(|line| line.starts_with('|')).map(cells);
    rows.map(|row| (row[1].clone(), head.iter().cloned().zip(row).skip(2).collect())).collect()
}

/// The numbers in a cell: wrong hits and objects, the largest error in ulp (None for a dash), and
/// pixels that are off by two levels.
fn figures(cell: &str) -> (f64, Option<f64>, f64) {
    let parts: Vec<_> = cell.split(" / ").collect();
    let number = |text: &str| text.replace('∞', "inf").parse().unwrap_or_else(|_| panic!("{cell}"));
    (number(parts[0]), (parts[1] != "–").then(|| number(parts[1])), number(parts[2]))
}

#[test]
fn the_errors_of_the_document_are_current() {
    let documented = documented();
    let names: Vec<_> = subjects::all(false).into_iter().map(|subject| subject.name).collect();
    assert_eq!(
        documented.keys().collect::<Vec<_>>(),
        {
            let mut n: Vec<_> = names.iter().collect();
            n.sort();
            n
        },
        "make accuracy"
    );
    let stale = |what: &str| format!("docs/results/accuracy.md is stale, run `make accuracy`: {what}");
    let contenders = contenders();
    let mut compared = 0;
    // The most ill-conditioned scene of each family, and two ordinary scenes.
    let of_interest = |subject: &Subject| match subject.family {
        Some(family) => family.stiffness == 2,
        None => ["sphere", "two-lights"].contains(&subject.name.as_str()),
    };
    for Subject { name, scene, .. } in subjects::all(false).into_iter().filter(of_interest) {
        for judgement in judge(&scene, &contenders).unwrap() {
            let contender = judgement.entry.contender;
            let (engine, precision) = (contender.engine.name(), contender.precision.name());
            let cells = &documented[&name];
            let cell = cells.get(engine).or_else(|| cells.get(&format!("{engine} {precision}")));
            let (Some(cell), PixelFormat::F32x3) = (cell, judgement.entry.output) else { continue };
            let errors = judgement.errors;
            let (wrong, ulp, off) = figures(cell);
            let what = stale(&format!("{name}, {engine} {precision}: {cell} is {errors:?}"));
            // Allow small differences, since compilers and estimates differ between machines; a
            // different formula differs much more.
            let near = |documented: f64, found: f64| (documented - found).abs() <= 3.0 + 0.1 * found;
            assert!(near(wrong, (errors.wrong_hits + errors.wrong_objects) as f64), "{what}");
            assert!(near(off, errors.off_by_2 as f64), "{what}");
            assert_eq!(ulp.is_some(), errors.max_ulp.is_some(), "{what}");
            if let (Some(documented), Some(found)) = (ulp, errors.max_ulp) {
                assert!(documented <= 1.5 * found + 0.1 && found <= 1.5 * documented + 0.1, "{what}");
            }
            compared += 1;
        }
    }
    assert!(compared >= 2 * 19, "only {compared} cells were compared");
}
