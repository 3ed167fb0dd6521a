//! Omissions: each alone and all together leave every bit of the picture unchanged, and the report
//! counts them.

use crate::contenders::{Truth, check_by_force, contenders, packets};
use crate::extent;
use glam::{Vec3, vec3};
use rayo::internals::plan::{Keep, Omission, Report, Switch};
use rayo::internals::render::{Counted, Engine, Frame, PixelFormat, Plan, Purpose, Settings};
use rayo::internals::scene::{Camera, Light, Rng, Scene, Sphere, Triangle, many};

fn camera(width: u32, height: u32, focal: f32, film: f32) -> Camera {
    Camera::new(width, height, focal, film).unwrap()
}

/// Scenes of every kind: few and many objects, no light to eight lights, some without effect, one
/// colour or several, the camera inside a sphere, and invisible objects.
fn scenes() -> Vec<(String, Scene)> {
    let mut scenes = Vec::new();
    let table =
        [(0, 0, 51), (1, 0, 52), (0, 1, 53), (30, 0, 54), (0, 30, 55), (20, 20, 56), (3, 150, 57), (150, 3, 58)];
    for (i, (spheres, triangles, seed)) in table.into_iter().enumerate() {
        for lights in [0, 1, 2, 8] {
            let (width, height) = [(67, 31), (100, 3), (1, 40), (203, 151)][(i + lights) % 4];
            let mut scene = Scene { camera: camera(width, height, 1.0, 1.0), ..many(spheres, triangles, seed) };
            let first = scene.lights[0];
            scene.lights.truncate(lights);
            for i in 2..lights {
                let position = vec3(10.0 * i as f32, -7.0, 20.0 + i as f32);
                let colour = [Vec3::ZERO, Vec3::X, Vec3::ONE][i % 3];
                scene.lights.push(Light { intensity: if i == 5 { 0.0 } else { 0.3 * i as f32 }, colour, position });
            }
            scene.spheres.iter_mut().skip(1).step_by(3).for_each(|sphere| sphere.colour = Vec3::ONE);
            scene.triangles.iter_mut().skip(1).step_by(3).for_each(|triangle| triangle.colour = Vec3::Y);
            // Objects around a light, behind the camera, beside the picture, without area, and
            // edge-on.
            scene.spheres.push(Sphere { radius: 0.5, colour: Vec3::ONE, centre: first.position });
            scene.spheres.push(Sphere { radius: 4.0, colour: Vec3::ONE, centre: vec3(0.0, 0.0, -9.0) });
            scene.spheres.push(Sphere { radius: 4.0, colour: Vec3::ONE, centre: vec3(300.0, 0.0, 9.0) });
            let corner = vec3(1.0, 1.0, 9.0);
            for vertices in [[corner; 3], [corner, vec3(2.0, -3.0, 7.0), -corner], [corner, 2.0 * corner, Vec3::Z]] {
                scene.triangles.push(Triangle { colour: Vec3::ONE, vertices });
            }
            if (i + lights) % 2 == 0 {
                scene.spheres.push(Sphere { radius: 400.0, colour: vec3(0.2, 0.3, 0.4), centre: vec3(3.0, -2.0, 5.0) });
            }
            scene.shadows = i % 2 == 1;
            scenes.push((format!("many({spheres}, {triangles}, seed {seed}), {lights} lights"), scene));
        }
    }
    scenes
}

#[test]
fn omissions_alone_make_the_same_bytes_on_every_scene() {
    let alone = || Omission::ALL.into_iter().filter(|omission| omission.switch() == Switch::Work);
    for (number, (name, scene)) in scenes().into_iter().enumerate() {
        check_by_force(&scene, &name);
        for omission in alone().filter(|_| number % 3 == 0) {
            packets()
                .iter()
                .for_each(|one| one.check_kept(&scene, Keep::only(omission), &format!("{name}, {omission:?}")));
        }
    }
}

/// The sphere's outline is a parabola, which one row meets only once.
#[test]
fn a_sphere_that_a_row_never_leaves_is_seen_on_either_side() {
    for x in [5.0, -5.0] {
        let scene = Scene {
            lights: vec![Light { intensity: 1.0, colour: Vec3::ONE, position: Vec3::ZERO }],
            spheres: vec![Sphere { radius: 1.0, colour: Vec3::ONE, centre: vec3(x, 0.0, 1.0) }],
            ..Scene::new(camera(60, 45, 0.05, 1.0))
        };
        let truth = Truth::new(&scene);
        assert!((0..45).any(|row| truth.object(row, if x > 0.0 { 59 } else { 0 }).is_some()));
        for contender in packets() {
            truth.check(&contender, &format!("x = {x}"));
        }
        check_by_force(&scene, &format!("x = {x}"));
    }
}

/// The report of the widest engine for a scene text, for a picture of 160 x 120 in bytes.
fn report(lights: &str, objects: &str) -> Report {
    report_of(lights, objects, false)
}

fn report_of(lights: &str, objects: &str, shadows: bool) -> Report {
    let text = format!("x.png 160 120 1  {lights}  {objects}");
    let scene = rayo::internals::scene::parse(text.as_bytes(), "a scene of this test")
        .unwrap_or_else(|error| panic!("{error}"));
    let scene = Scene { shadows, ..scene };
    let purpose = Purpose { format: Some(PixelFormat::Rgba8), ..Purpose::default() };
    Plan::new(Engine::fastest(), &scene, purpose).unwrap().report()
}

/// How often `omission` is made.
fn count(report: &Report, omission: Omission) -> u64 {
    report.left_out.iter().find(|line| line.omission == omission).map_or(0, |line| line.count)
}

#[test]
fn lights_that_give_nothing_are_counted() {
    let (white, red) = ("1  2 1 1 1  0 0 20  0", "1  2 1 0 0  0 0 20  0");
    // The closed form is used for one light that has an effect.
    for (what, lights, objects, dark, closed) in [
        ("lit", "1  1 1 1 1  -9 9 0", white, 0, 1),
        ("no intensity", "2  1 1 1 1  -9 9 0  0 1 1 1  9 9 0", white, 1, 1),
        ("no colour", "2  1 1 1 1  -9 9 0  1 0 0 0  9 9 0", white, 1, 1),
        ("behind the sphere", "1  1 1 1 1  0 0 90", white, 0, 0),
        ("inside the sphere", "1  1 1 1 1  0 0 20", white, 0, 0),
        ("of another colour", "1  1 0 1 1  -9 9 0", red, 0, 0),
        ("none", "0", white, 0, 0),
    ] {
        let report = report(lights, objects);
        let loops = report.left_out.iter().find(|line| line.what == "loops over lights").map_or(0, |line| line.count);
        assert_eq!((count(&report, Omission::DarkLights), loops), (dark, closed), "{what}: {report:?}");
        assert_eq!(report.tiles.is_none(), closed == 1, "{what}: {report:?}");
    }
}

#[test]
fn what_depends_on_kinds_colours_and_overlap_is_counted() {
    let lamp = "1  1 1 1 1  -9 9 0";
    let sphere = report(lamp, "1  2 1 1 1  0 0 20  0");
    for (omission, expected) in [
        (Omission::TriangleCode, 1),
        (Omission::SphereCode, 0),
        (Omission::Loop, 1),
        (Omission::Channels, 1),
        (Omission::Constants, 1),
        (Omission::FloatImage, 160 * 120),
        (Omission::Hidden, 0),
    ] {
        assert_eq!(count(&sphere, omission), expected, "{omission:?}: {sphere:?}");
    }
    assert_eq!(count(&sphere, Omission::Misses) + count(&sphere, Omission::Search), 160 * 120);
    // Two triangles, of which the far one is completely hidden.
    let two = "0  2  1 1 0  -9 -9 20  9 -9 20  0 9 20  1 0 0  -90 -90 200  90 -90 200  0 90 200";
    let tiled = report(lamp, two);
    for (omission, expected) in [(Omission::SphereCode, 1), (Omission::Channels, 0), (Omission::Hidden, 0)] {
        assert_eq!(count(&tiled, omission), expected, "{omission:?}: {tiled:?}");
    }
    let scene =
        rayo::internals::scene::parse(format!("x.png 160 120 1  {lamp}  {two}").as_bytes(), "two triangles").unwrap();
    let by_rays = Plan::new(Engine::Reference, &scene, Purpose::default()).unwrap();
    assert_eq!(count(&by_rays.report(), Omission::Hidden), 160 * 120, "{:?}", by_rays.report());
    let alone = Scene { triangles: scene.triangles[..1].to_vec(), ..scene.clone() };
    let alone = Plan::new(Engine::Reference, &alone, Purpose::default()).unwrap().report();
    assert_eq!(count(&alone, Omission::Hidden), 0, "{alone:?}");
    let bright = report("1  2 1 1 1  -9 9 0", "1  2 1 1 1  0 0 20  0");
    assert_eq!(count(&bright, Omission::Channels), 0, "{bright:?}");
}

#[test]
fn questions_of_shadows_that_need_no_answer_are_counted() {
    let lamps = "2  1 1 1 1  -9 9 0  1 1 1 1  9 9 40";
    let [sphere, wall] = ["1  1 1 1  0 0 20", "1 1 1  -99 -99 30  99 -99 30  0 99 30"];
    let counts = |objects: &str| {
        let report = report_of(lamps, objects, true);
        [Omission::Averted, Omission::OtherCells, Omission::Unhidden].map(|omission| count(&report, omission))
    };
    let pixels = 160 * 120;
    assert_eq!(counts(&format!("1  {sphere}  0")), [0, 0, 2], "alone");
    assert_eq!(counts(&format!("0  1  {wall}"))[2], 2, "alone");
    // The second light is behind the wall, which fills the picture except for the sphere.
    let [averted, others, unhidden] = counts(&format!("1  {sphere}  1  {wall}"));
    assert!(averted > pixels * 3 / 4 && averted < pixels && unhidden == 0, "{averted} {others} {unhidden}");
    assert!(others > pixels / 2 && others < 2 * 2 * pixels, "{others}");
    let without = report(lamps, &format!("1  {sphere}  1  {wall}"));
    assert_eq!([Omission::Averted, Omission::OtherCells].map(|omission| count(&without, omission)), [0, 0]);
}

/// Small spheres and as many small triangles at random depths, which together cover about the area
/// of the picture.
fn crowd(half: usize, camera: Camera) -> Scene {
    let mut rng = Rng::new(57);
    let size = 0.3 / (half as f32).sqrt();
    let mut scene = Scene { shadows: true, ..Scene::new(camera) };
    scene.lights = vec![Light { intensity: 1.0, colour: Vec3::ONE, position: vec3(20.0, 20.0, 0.0) }];
    for _ in 0..half {
        let mut point = || {
            let depth = rng.between(100.0, 300.0);
            depth * vec3(rng.between(-0.4, 0.4), rng.between(-0.3, 0.3), 1.0)
        };
        let (centre, corner) = (point(), point());
        scene.spheres.push(Sphere { radius: size * centre.z, colour: Vec3::ONE, centre });
        let [a, b] = [0, 1].map(|_| 2.0 * size * corner.z * vec3(rng.between(-1.0, 1.0), rng.between(-1.0, 1.0), 0.5));
        scene.triangles.push(Triangle { colour: Vec3::ONE, vertices: [corner, corner + a, corner + b] });
    }
    scene
}

#[test]
fn brute_force_makes_the_same_bytes_of_a_crowd() {
    check_by_force(&crowd(300, camera(64, 64, 1.0, 1.0)), "a crowd");
}

/// The average number of objects of a crowd that are tested for a visible point facing the light.
/// The picture is `times` as wide and high, and has as many objects per pixel.
fn tests_for_a_point(times: u32) -> u64 {
    let camera = camera(160 * times, 120 * times, 1.0, 1.0);
    let scene = crowd(1000 * (times * times) as usize, camera);
    let purpose = Purpose { format: Some(PixelFormat::Rgba8), ..Purpose::default() };
    let plan = Plan::new(Engine::fastest(), &scene, purpose).unwrap();
    let report = plan.report();
    let facing = plan.tracer().count(0..camera.height()).hits - count(&report, Omission::Averted);
    let objects = scene.spheres.len() + scene.triangle_count();
    assert!(facing > 1000, "{facing}");
    (facing * objects as u64 - count(&report, Omission::OtherCells)) / facing
}

/// Without sorting the points of a tile as the light sees them, about 400 objects would be tested,
/// and 1,900 in the larger picture.
#[test]
fn point_of_a_crowd_is_tested_against_few_objects() {
    let [few, many] = [1, 4].map(tests_for_a_point);
    assert!(few > 0 && few < 256 && many < 2 * few, "{few} and {many} of 16 times as many objects");
}

/// The number of small spheres in the middle of the picture, each of a few pixels.
const FILLERS: usize = 40;

/// The report for [`FILLERS`] and the given objects, traced by tiles for a picture of 160 x 120 in
/// bytes, with the omissions in `keep` not made.
fn tile_report(lights: &str, spheres: &[&str], triangles: &[&str], keep: Keep) -> Report {
    let fillers = (0..FILLERS as i32).map(|i| format!("0.3  1 0.5 0.25  {} {} 20", i % 8 - 3, i as f32 / 8.0 - 2.0));
    let spheres: Vec<_> = fillers.chain(spheres.iter().map(|sphere| (*sphere).to_owned())).collect();
    let (count, spheres) = (spheres.len(), spheres.join("  "));
    let text = format!("x.png 160 120 1  {lights}  {count} {spheres}  {} {}", triangles.len(), triangles.join("  "));
    let scene = rayo::internals::scene::parse(text.as_bytes(), "a scene of this test")
        .unwrap_or_else(|error| panic!("{error}"));
    let purpose = Purpose { format: Some(PixelFormat::Rgba8), keep, ..Purpose::default() };
    Plan::new(Engine::fastest(), &scene, purpose).unwrap().report()
}

/// The text as a list; none if it is empty.
fn one_or_none(text: &str) -> Vec<&str> {
    [text].into_iter().filter(|text| !text.is_empty()).collect()
}

#[test]
fn objects_without_a_pixel_are_counted_by_the_reason() {
    let lamp = "1  1 1 1 1  -9 9 0";
    let of = |spheres: &[&str], triangles: &[&str]| tile_report(lamp, spheres, triangles, Keep::NOTHING);
    let none = of(&[], &[]);
    let reasons = [Omission::Behind, Omission::Outside, Omission::NoArea, Omission::EdgeOn, Omission::Between];
    assert_eq!(reasons.map(|reason| count(&none, reason)), [0; 5], "{none:?}");
    for (what, sphere, triangle, omission) in [
        ("a sphere behind the camera", "1  1 1 1  0 0 -5", "", Omission::Behind),
        ("a sphere that ends at the camera", "5  1 1 1  0 0 -5", "", Omission::Behind),
        ("a triangle behind the camera", "", "1 1 1  0 0 -1  1 0 -2  0 1 0", Omission::Behind),
        ("a sphere to the left", "1  1 1 1  -90 0 20", "", Omission::Outside),
        ("a sphere to the right", "1  1 1 1  90 0 20", "", Omission::Outside),
        ("a sphere below", "1  1 1 1  0 -60 20", "", Omission::Outside),
        ("a sphere above", "1  1 1 1  0 60 20", "", Omission::Outside),
        ("a triangle to the left", "", "1 1 1  -50 0 20  -60 0 20  -50 1 20", Omission::Outside),
        ("a point", "", "1 1 1  1 2 20  1 2 20  1 2 20", Omission::NoArea),
        ("a line", "", "1 1 1  1 2 20  2 4 25  3 6 30", Omission::NoArea),
        ("a triangle edge on", "", "1 1 1  1 -2 9  2 3 9  3 1 18", Omission::EdgeOn),
        ("a sphere between rays", "0.001  1 1 1  0 0 20", "", Omission::Between),
        ("a triangle between rays", "", "1 1 1  0.001 0.001 20  0.002 0.001 20  0.001 0.002 20", Omission::Between),
    ] {
        let report = of(&one_or_none(sphere), &one_or_none(triangle));
        for reason in reasons {
            assert_eq!(count(&report, reason), u64::from(reason == omission), "{what}, {reason:?}: {report:?}");
        }
        assert_eq!((report.kept.spheres, report.kept.triangles), (FILLERS, 0), "{what}");
    }
    for (sphere, triangle) in [
        ("1  1 1 1  -8.4 0 20", ""),
        ("9  1 1 1  0 0 -5", ""),
        ("3  1 1 1  3.2 0 0.5", ""),
        ("", "1 1 1  -7.9 0 20  -60 -1 20  -50 1 20"),
        ("", "1 1 1  0 -1 20  9 -1 20  3 -1 -20"),
    ] {
        let report = of(&one_or_none(sphere), &one_or_none(triangle));
        assert_eq!(report.kept.spheres + report.kept.triangles, FILLERS + 1, "{sphere}{triangle}: {report:?}");
    }
}

#[test]
fn what_tiles_leave_out_is_counted() {
    let lamps = "2  1 1 1 1  -9 9 0  0 1 1 1  9 9 0";
    let report = tile_report(lamps, &[], &[], Keep::NOTHING);
    // The fillers are in the middle of a picture of 3 x 4 tiles.
    let tiles = report.tiles.unwrap();
    assert_eq!((tiles.objects, tiles.across, tiles.down), (FILLERS as u64, 3, 4));
    assert_eq!(count(&report, Omission::OtherTiles), FILLERS as u64 * 12 - tiles.placed);
    assert!((FILLERS as u64..2 * FILLERS as u64).contains(&tiles.placed), "{tiles:?}");
    assert!((3..12).contains(&count(&report, Omission::EmptyTiles)), "{report:?}");
    for (omission, expected) in [
        (Omission::DarkLights, 1),
        (Omission::TriangleCode, 1),
        (Omission::SphereCode, 0),
        (Omission::Constants, FILLERS as u64),
        (Omission::Loop, FILLERS as u64),
        (Omission::Channels, 0),
        (Omission::FloatImage, 160 * 120),
        (Omission::Occluded, 0),
        (Omission::Unseen, 0),
    ] {
        assert_eq!(count(&report, omission), expected, "{omission:?}: {report:?}");
    }
    // A sphere behind a wall is nowhere the nearest object; nor are a hundred triangles, which are
    // not even set up in the wall's tiles.
    let wall = "1 1 1  -99 -99 9  99 -99 9  0 99 9";
    let hidden = tile_report(lamps, &["1  1 1 1  0 0 20"], &[wall], Keep::NOTHING);
    assert!(count(&hidden, Omission::Unseen) > FILLERS as u64, "{hidden:?}");
    assert_eq!(count(&hidden, Omission::EmptyTiles), 0, "{hidden:?}");
    let triangles = vec!["1 1 1  -1 -1 20  1 -1 20  0 1 20"; 100];
    let hidden = tile_report(lamps, &[], &[&[wall][..], &triangles[..]].concat(), Keep::NOTHING);
    assert!(count(&hidden, Omission::Occluded) >= 100, "{hidden:?}");
    // With all omissions kept, nothing is left out but work for which the code without the omission
    // would have other arithmetic.
    let all = tile_report(lamps, &["1  1 1 1  -90 0 20"], &triangles, Keep::all());
    assert_eq!((all.kept.spheres, all.kept.triangles, all.kept.lights), (FILLERS + 1, 100, 1), "{all:?}");
    assert!(all.left_out.iter().all(|line| line.switch != Switch::Work), "{all:?}");
}

/// A scene in which borders of tiles, of pixels and of the picture have coordinates that are
/// multiples of 1/2: for `camera(96, 128, f, 160)` the ray of a row and column is (col - 47.5, 63.5
/// - row, f), and tiles end at x = 16 and at y = 32, 0 and -32.
fn on_tile_borders(rng: &mut Rng, (spheres, triangles): (usize, usize)) -> Scene {
    let focal = [8.0, 32.0, 128.0][(rng.next_u64() % 3) as usize];
    let pick = |rng: &mut Rng, from: &[f32]| from[(rng.next_u64() % from.len() as u64) as usize];
    let xs = [16.0, 15.5, 16.5, 47.5, -47.5, 48.0, -48.0, 48.5, -49.0, 0.0, -20.5, 31.0];
    let ys = [32.0, 31.5, 32.5, 0.0, 0.5, -0.5, -32.0, -31.5, 63.5, -63.5, 64.0, -64.0, 64.5, 17.0];
    // Integer multiples of a ray are exact in f32, so that the corner lies exactly on the ray, or
    // on the border.
    let point =
        |rng: &mut Rng| pick(rng, &[1.0, 2.0, 3.0, 1.0, 4.0, -1.0]) * vec3(pick(rng, &xs), pick(rng, &ys), focal);
    let colours = [Vec3::ONE, Vec3::X, vec3(0.5, 0.5, 0.5), vec3(0.25, 1.0, 0.75), Vec3::ZERO];
    let colour = |rng: &mut Rng| colours[(rng.next_u64() % 5) as usize];
    let points: Vec<_> = (0..14).map(|_| point(rng)).collect();
    let corner = |rng: &mut Rng| points[(rng.next_u64() % points.len() as u64) as usize];
    let triangle = |rng: &mut Rng| Triangle { colour: colour(rng), vertices: [corner(rng), corner(rng), corner(rng)] };
    // A sphere around a point, up to a plane through a border of tiles or of the picture, or
    // through another point.
    let sphere = |rng: &mut Rng| {
        let (centre, other) = (point(rng), corner(rng));
        let plane = |at: f32, along: f32| (along * focal - at * centre.z).abs() / at.hypot(focal);
        let radius = match rng.next_u64() % 3 {
            0 => plane(pick(rng, &xs), centre.x),
            1 => plane(pick(rng, &ys), centre.y),
            _ => (other - centre).length(),
        };
        Sphere { radius: if radius > 1e-3 { radius } else { 1.0 }, colour: colour(rng), centre }
    };
    let light =
        |rng: &mut Rng| Light { intensity: pick(rng, &[0.75, 0.0, 3.0]), colour: colour(rng), position: corner(rng) };
    Scene {
        lights: (0..rng.next_u64() % 4).map(|_| light(rng)).collect(),
        spheres: (0..spheres).map(|_| sphere(rng)).collect(),
        triangles: (0..triangles).map(|_| triangle(rng)).collect(),
        ..Scene::new(camera(96, 128, focal, 160.0))
    }
}

#[test]
fn brute_force_makes_the_same_bytes_on_borders_of_tiles() {
    let seed = 43;
    let mut rng = Rng::new(seed);
    // More objects in some tiles than are tried without finding out which of them are hidden; and
    // few.
    let crowded = if extent::all() { 40 } else { 10 };
    let counts = [(crowded, (8, 80)), (20, (1, 0)), (20, (0, 2)), (40, (3, 5))];
    for (case, count) in counts.into_iter().flat_map(|(cases, count)| (0..cases).map(move |case| (case, count))) {
        let scene = Scene { shadows: case % 2 == 1, ..on_tile_borders(&mut rng, count) };
        // Both with and without shadows.
        if !extent::all() && case % 5 > 1 {
            continue;
        }
        let ray = scene.camera.grid::<f32>();
        assert_eq!(
            (ray.step, ray.ray(31, 63)),
            (1.0, [15.5, 32.5, ray.focal]),
            "rays are where the test takes them to be"
        );
        check_by_force(&scene, &format!("seed {seed}, case {case} of {count:?}"));
    }
}

#[test]
fn hits_are_counted_by_what_traces_and_agree_with_the_reference() {
    let mut rng = Rng::new(47);
    let few =
        (0..4).map(|i| Scene { camera: camera(67, 31, 1.0, 1.0), ..many(4 * i, 12 - 4 * i.min(3), 90 + i as u64) });
    let on_borders = (0..4).map(|_| on_tile_borders(&mut rng, (8, 80))).collect::<Vec<_>>();
    let more =
        [(40, 0), (0, 200), (40, 400)].map(|(s, t)| Scene { camera: camera(131, 97, 1.0, 1.0), ..many(s, t, 95) });
    for scene in extent::sampled(few.chain(on_borders).chain(more), 2) {
        let truth = Truth::new(&scene);
        let (width, height) = (scene.camera.width(), scene.camera.height());
        let rays = (0..height).flat_map(|row| (0..width).map(move |col| (row, col)));
        let expected = rays.filter(|(row, col)| truth.object(*row, *col).is_some()).count() as u64;
        for contender in contenders() {
            let tracer = contender.prepare(&scene);
            let counts = [1, 3].map(|threads| {
                let frame = Frame::new(tracer.as_ref(), scene.camera, Settings { threads }).unwrap();
                let mut film = frame.film(PixelFormat::F32x4, height).unwrap();
                let known = frame.trace_counted(0..height, film.as_mut(), &|_| ());
                known.unwrap_or_else(|| frame.count(0..height))
            });
            let listed = tracer.hits(0..height).into_iter().flatten().count() as u64;
            let counted = Counted { rays: scene.camera.pixels(), hits: listed };
            assert_eq!(counts, [counted; 2], "{contender}");
            if contender.engine.rays_in_f64() {
                assert_eq!(listed, expected, "{contender}: {scene:?}");
            }
        }
    }
}
