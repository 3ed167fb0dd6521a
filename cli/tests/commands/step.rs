//! `rayo step`: what it tells of a ray is what the kernel did, where digits go, and what it says
//! where it cannot be used.

use crate::extent;
use crate::program;
use std::fs;
use std::path::Path;

use glam::Vec3;
use rayo::internals::render::{Engine, Film, FilmMut, PixelFormat};
use rayo::internals::scene::{Camera, Light, MAX_SIDE, Scene, Sphere};
use rayo_lab::experiments::ops;
use rayo_lab::experiments::step::{Line, Ray, Watched, watch, watch_operation};
use serde_json::Value;

/// A sphere in front of the camera, so far away that the paper's quadratic loses its digits, or
/// near.
fn sphere_at(distance: f32) -> Scene {
    let focal = distance / 4.0;
    Scene {
        name: "sphere.png".into(),
        lights: vec![Light { intensity: 1.0, colour: Vec3::ONE, position: Vec3::new(-6.0, 6.0, 0.0) }],
        spheres: vec![Sphere {
            radius: 1.0,
            colour: Vec3::new(1.0, 0.5, 0.25),
            centre: Vec3::new(0.25, 0.5, distance),
        }],
        ..Scene::new(Camera::new(48, 48, focal, 1.0).unwrap())
    }
}

fn engines() -> impl Iterator<Item = Engine> {
    let stepped = ["paper", "sse41", "avx2", "avx512"];
    Engine::ALL.iter().copied().filter(move |engine| stepped.contains(&engine.name()) && engine.usable())
}

fn engine(name: &str) -> Engine {
    name.parse().unwrap()
}

fn watched(scene: &Scene, engine: Engine, pixel: (u32, u32)) -> Watched {
    watch(scene, &Ray { engine, precision: None, pixel, lane: None, most: 100_000 }).unwrap()
}

fn instructions_in<'a>(watched: &'a Watched, of: &'a str) -> impl Iterator<Item = &'a Line> {
    watched.steps.iter().filter(move |line| line.macros.iter().any(|call| call.name == of))
}

#[test]
fn the_colour_that_is_told_is_the_pixel_and_what_was_stored() {
    let scene = sphere_at(4.0);
    for engine in engines() {
        let pixel = (20, 24);
        let watched = watched(&scene, engine, pixel);
        let mut film = Film::new(PixelFormat::F32x4, scene.camera.pixels() as usize).unwrap();
        engine.prepare(None, &scene).unwrap().rows(0..48, film.as_mut());
        let FilmMut::F32x4(pixels) = film.as_mut() else { unreachable!("the film was made so") };
        let found = pixels[(pixel.1 * 48 + pixel.0) as usize];
        assert_eq!(watched.colour, Some([found.x, found.y, found.z]), "{engine}");
        assert_eq!(watched.hit.unwrap().object, "sphere 0", "{engine}");
        // The last that the pixel is made of is the store of it.
        let last = watched.steps.iter().rfind(|line| line.made).unwrap();
        assert!(last.changed.iter().any(|change| change.register.starts_with('[')), "{engine}: {}", last.text);
    }
}

#[test]
fn digits_are_lost_by_the_paper_and_not_by_packets() {
    let scene = sphere_at(2000.0);
    let paper = watched(&scene, engine("paper"), (22, 22));
    let worst = &paper.steps[paper.dearest[0]];
    assert_eq!((worst.file, &*worst.source), ("asm/include/sphere_aos.inc", "subss s, k"), "the discriminant");
    assert!(worst.cost() > 1000.0, "{}", worst.cost());
    assert!(worst.cancelled_bits[0].unwrap() >= 18, "{:?}", worst.cancelled_bits);
    for engine in engines().filter(|engine| engine.is_packet()) {
        let packets = watched(&scene, engine, (22, 22));
        assert_eq!(packets.hit.as_ref().unwrap().object, "sphere 0");
        let worst = packets.dearest.first().map_or(0.0, |&at| packets.steps[at].cost());
        assert!(worst < 10.0, "{engine}: {worst} units of the last place");
        assert!(packets.steps.iter().all(|line| !line.overturned), "{engine}");
    }
}

#[test]
fn a_ray_takes_as_many_instructions_as_ops_counts_on_its_path() {
    let options = ops::Options {
        wanted: vec!["sphere".into()],
        implementations: vec!["paper".into()],
        executed: true,
        cost: false,
    };
    let report = ops::run(&options, &mut |_, _| ()).unwrap();
    let body = |path: &str| report.rows[0].paths.iter().find(|p| p.path == path).unwrap().body.unwrap() as usize;
    let scene = sphere_at(4.0);
    let hit = watched(&scene, engine("paper"), (24, 24));
    assert_eq!(instructions_in(&hit, "SPHERE_HIT").count(), body("two roots"));
    let miss = watched(&scene, engine("paper"), (0, 47));
    assert_eq!(instructions_in(&miss, "SPHERE_HIT").count(), body("miss"));
    assert!(miss.hit.is_none());
    let branch = instructions_in(&miss, "SPHERE_HIT").find_map(|line| line.branch.clone());
    assert!(branch.unwrap().taken, "below 0: to the miss");
}

#[test]
fn an_operation_takes_as_many_instructions_as_ops_counts() {
    for (op, b) in [("add", 3), ("sub", 3), ("scale", 1), ("dot", 3), ("norm", 0), ("cross", 3), ("normalise", 0)] {
        for engine in engines() {
            let b = [4.0, 5.0, 6.0][..b].to_vec();
            let b = (!b.is_empty()).then_some(b);
            let watched = watch_operation(op, engine, vec![1.0, 2.0, 3.0], b).unwrap();
            let options = ops::Options {
                wanted: vec![op.into()],
                implementations: vec![engine.name().into()],
                executed: true,
                cost: false,
            };
            let report = ops::run(&options, &mut |_, _| ()).unwrap();
            assert_eq!(Some(watched.instructions as u64), report.rows[0].executed, "{op} by {engine}");
            assert_eq!(watched.unknown, 0, "{op} by {engine}");
        }
    }
    let cross = watch_operation("cross", engine("paper"), vec![1.0, 2.0, 3.0], Some(vec![4.0, 5.0, 6.0])).unwrap();
    assert_eq!(cross.result.unwrap(), [-3.0, 6.0, -3.0]);
}

#[test]
fn one_is_not_many() {
    let cross = ["step", "--op", "cross", "--a", "1,2,3", "--b", "4,5,6", "--engine", "paper"];
    let run = program::rayo(cross, Path::new("."));
    assert!(run.printed().contains(" 4 shuffles, 2 loads, 1 store, 1 jump, 1 other\n"), "{}", run.stdout);
}

#[test]
fn a_neighbour_in_the_packet_is_the_pixel_beside() {
    let scene = sphere_at(4.0);
    for engine in engines().filter(|engine| engine.is_packet()) {
        let own = watched(&scene, engine, (20, 24));
        let lane = own.lane.unwrap();
        let other = if lane == 0 { 1 } else { lane - 1 };
        let beside =
            watch(&scene, &Ray { engine, precision: None, pixel: (20, 24), lane: Some(other), most: 100_000 }).unwrap();
        assert_eq!(beside.pixel, Some([20 + other as u32 - lane as u32, 24]), "{engine}");
        assert_eq!(beside.lane, Some(other), "{engine}");
    }
}

#[test]
fn text_of_one_ray_fits_a_screen() {
    let step = |more: &[&str]| {
        let arguments = ["step", "scenes/sphere.in", "--size", "160x120"].iter().chain(more);
        program::rayo(arguments, Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))).printed().to_owned()
    };
    let folded = step(&["--depth", "1"]);
    assert!(folded.lines().count() <= 50, "{folded}");
    assert!(folded.starts_with("pixel 80,60 by paper"), "the middle of a picture of that size: {folded}");
    assert!(folded.contains("SPHERE_HIT") && folded.contains("hits sphere 0 at t = "), "{folded}");
    let whole = step(&[]);
    for words in ["mulss s, s", "; disc", "not taken if below", "VEC_DOT", "; line 16"] {
        assert!(whole.contains(words), "{words}: {whole}");
    }
    let only = step(&["--only", "VEC_DOT"]);
    assert!(only.contains("VEC_DOT") && !only.contains("comiss"), "{only}");
}

#[test]
fn the_document_has_what_is_known_of_each_instruction() {
    let at = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let document = program::rayo(["step", "scenes/sphere.in", "--size", "160x120", "--json"], at).document();
    assert_eq!(document["schema"], 1);
    assert_eq!(document["engine"], "paper");
    assert_eq!(document["unknown"], 0);
    assert_eq!(document["instructions"], document["steps"].as_array().unwrap().len());
    assert!(document["hit"]["t"].is_f64() && document["colour"][0].is_number(), "{}", document["hit"]);
    let root = document["steps"].as_array().unwrap().iter().find(|step| step["source"] == "sqrtss s, s").unwrap();
    assert_eq!(root["file"], "asm/include/sphere_aos.inc");
    let call = root["macros"].as_array().unwrap().iter().find(|call| call["name"] == "SPHERE_HIT").unwrap();
    assert_eq!(call["parameters"][0], "t = xmm3");
    let changed = &root["changed"][0];
    assert_eq!((&changed["register"], &changed["name"]), (&Value::from("xmm11"), &Value::from("s")));
    for field in ["before", "after", "error_ulp"] {
        assert!(changed[field][0].is_number(), "{field}: {changed}");
    }
}

#[test]
fn the_page_needs_nothing_else_and_has_every_instruction() {
    let directory = tempfile::tempdir().unwrap();
    let scene = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("scenes/sphere.in");
    let arguments = ["step", scene.to_str().unwrap(), "--size", "160x120", "--html", "page.html"];
    assert_eq!(program::rayo(arguments, directory.path()).printed(), "");
    let page = fs::read_to_string(directory.path().join("page.html")).unwrap();
    for elsewhere in ["http:", "https:", "src=", "<link", "@import", "url("] {
        assert!(!page.contains(elsewhere), "{elsewhere}");
    }
    let watched = watched(
        &rayo::internals::scene::read(&scene)
            .map(|s| Scene { camera: Camera::new(160, 120, 1.0, 1.0).unwrap(), ..s })
            .unwrap(),
        engine("paper"),
        (80, 60),
    );
    let padding = watched.steps.iter().filter(|line| line.line == 0).count();
    assert_eq!(page.matches("class=\"step").count(), watched.instructions - padding);
    let failed = program::rayo(["step", scene.to_str().unwrap(), "--html", "nowhere/page.html"], directory.path());
    assert_eq!(failed.status, 1);
    assert!(!directory.path().join("nowhere").exists());
}

#[test]
fn of_a_row_of_any_width_the_neighbours_are_followed_at_most() {
    let scene = Scene { camera: Camera::new(MAX_SIDE, 1, 1.0, 1.0).unwrap(), ..sphere_at(4.0) };
    let columns = [0, 1, scene.camera.width() / 2, scene.camera.width() - 1];
    let followed = columns.map(|column| watched(&scene, engine("paper"), (column, 0)));
    assert_eq!(followed.each_ref().map(|of| of.pixel), columns.map(|column| Some([column, 0])));
}

#[test]
fn options_of_scenes_and_operations_exclude_each_other() {
    let at = Path::new(env!("CARGO_MANIFEST_DIR"));
    let dot = ["step", "--op", "dot", "--a", "1,2,3", "--b", "4,5,6"];
    for more in [
        "--precision double",
        "--lane 3",
        "--size 4x4",
        "--film 2",
        "--focal 2",
        "--shadows",
        "--steps 9",
        "--pixel 1,1",
        "--position 1,2,3",
        "--look-at 1,2,3",
        "--up 0,0,1",
    ] {
        let arguments = dot.into_iter().chain(more.split(' '));
        program::rayo(arguments, at).refuses("tip: --op takes --engine, --a and --b: --pixel,");
    }
    for more in [["--a", "1,2,3"], ["--b", "4,5,6"]] {
        let arguments = ["step", "scenes/sphere.in"].into_iter().chain(more);
        program::rayo(arguments, at).refuses("tip: --a and --b belong to --op, which takes the place of a scene");
    }
    let arguments = ["step", "scenes/sphere.in", "--json", "--depth", "1"];
    program::rayo(arguments, at).refuses("tip: --depth and --only belong to text");
}

#[test]
fn bad_use_is_told_with_what_to_do() {
    let at = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let scene = "scenes/sphere.in";
    let bad = [
        (
            &["step", scene, "--pixel", "1632,0"][..],
            "there is no pixel 1632,0: the picture has 1632 columns and 1224 rows",
        ),
        (&["step", scene, "--pixel", "7"], "expected a column and a row, as in 816,612"),
        (&["step", scene, "--engine", "reference"], "`reference` is Rust, which has no kernel to watch"),
        (&["step", scene, "--engine", "rust"], "paper, the same computation in assembly"),
        (
            &["step", "scenes/chain.toml"],
            "the engine `paper` has no shadows, as in the paper, and this scene has: packets have them, --engine auto",
        ),
        (&["step", scene, "--engine", "c"], "`rayo ops --engine c --asm` lists them"),
        (&["step", scene, "--size", "40x30", "--lane", "1"], "there is no lane 1: this engine traces ray by ray"),
        (&["step", scene, "--size", "40x30", "--steps", "10"], "more than the 10 that are recorded: add --steps "),
        (&["step", scene, "--size", "40x30", "--only", "NOTHING"], "no macro `NOTHING` was called here; there were: "),
        (&["step", "--op", "sphere"], "there is no operation `sphere` on vectors alone"),
        (&["step", "--op", "cross"], "`cross` takes a vector of three numbers: --a 1,2,3 and a second one: --b 4,5,6"),
        (&["step", "--op", "sphere", "--a", "1,2,3"], "there is no operation `sphere` on vectors alone"),
        (&["step", "--op", "dot", "--a", "1,2,3"], "`dot` takes a second vector of three numbers: --b 4,5,6"),
        (&["step", "--op", "norm", "--a", "1,2,3", "--b", "1,2,3"], "`norm` takes one vector, and no --b"),
        (&["step", "--op", "scale", "--a", "1,2,3", "--b", "1,2,3"], "`scale` takes a number to scale by"),
        (&["step"], "SCENE"),
        (&["step", "nothing.in"], "nothing.in"),
    ];
    for (arguments, words) in bad {
        program::rayo(arguments, at).refuses(words);
    }
    // Ten seconds until there are too many instructions.
    if extent::all() {
        let folder = tempfile::tempdir().unwrap();
        program::rayo(["make", "torus", "--triangles", "8000", "-o", "ring.obj"], folder.path()).printed();
        program::rayo(["step", "ring.obj"], folder.path())
            .refuses("choose packets by --engine auto, or a scene with fewer objects");
    }
}
