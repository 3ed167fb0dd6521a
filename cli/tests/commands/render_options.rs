//! The options of `rayo render` and `rayo info`, and their output.

use crate::place::{Place, SCENE, size};
use rayo::Pixels;
use rayo::internals::render::Engine;
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

// What is rendered

#[test]
fn size_film_and_focal_distance_take_the_place_of_the_scenes() {
    let place = Place::new();
    for arguments in
        ["-o plain.pfm", "-o scaled.pfm --film 32 --focal 32", "-o wide.pfm --focal 0.5", "-o small.pfm --size 7x3"]
    {
        assert_eq!(place.run(&format!("render scene.in --quiet {arguments}")).status, 0, "{arguments}");
    }
    let plain = place.picture("plain.pfm");
    assert_eq!(size(&plain), (16, 12));
    assert_eq!(place.picture("scaled.pfm"), plain);
    assert_ne!(place.picture("wide.pfm"), plain);
    assert_eq!(size(&place.picture("small.pfm")), (7, 3));
}

#[test]
fn shadows_are_an_option_that_the_papers_engines_refuse() {
    let place = Place::new();
    place.write("shadow.in", &SCENE.replace("5 5 0", "1 1 0"));
    for arguments in ["shadow.in -o plain.pfm", "shadow.in -o option.pfm --shadows"] {
        assert_eq!(place.run(&format!("render {arguments} --quiet --engine reference")).status, 0, "{arguments}");
    }
    assert_ne!(place.picture("option.pfm"), place.picture("plain.pfm"));
    assert_eq!(place.run("convert shadow.in shadow.toml").status, 0);
    let toml = fs::read_to_string(place.path("shadow.toml")).unwrap().replace("[image]\n", "[image]\nshadows = true\n");
    place.write("shadow.toml", &toml);
    assert_eq!(place.run("convert shadow.toml again.toml").status, 0);
    assert_eq!(place.run("render again.toml -o key.pfm --quiet --engine reference").status, 0);
    assert_eq!(place.picture("key.pfm"), place.picture("option.pfm"));
    assert_eq!(place.run("plan again.toml --engine rust").status, 0);
    let have = Engine::ALL.iter().filter(|engine| engine.has_shadows() && engine.usable());
    let have = have.map(|engine| engine.name()).collect::<Vec<_>>().join(", ");
    for engine in Engine::ALL.iter().filter(|engine| ["c", "paper"].contains(&engine.name())) {
        let message = format!(
            "error: the engine `{engine}` has no shadows, as in the paper: leave them out or ask one of {have}"
        );
        for arguments in
            ["render again.toml -o no.pfm", "render shadow.in -o no.pfm --shadows", "plan scene.in --shadows"]
        {
            place.refuses(&format!("{arguments} --engine {engine}"), 2, &message);
        }
    }
    assert!(!place.path("no.pfm").exists());
}

#[test]
fn one_side_of_the_size_keeps_the_shape() {
    let place = Place::new();
    for (given, expected) in [
        ("800x", "800x600"),
        ("x600", "800x600"),
        ("7x", "7x5"),
        ("x1", "1x1"),
        ("1x", "1x1"),
        // Both sides given: they are taken as they are, up to the largest.
        ("65535x1", "65535x1"),
        ("1x65535", "1x65535"),
    ] {
        let run = place.run(&format!("render scene.in --size {given} -o out.ppm"));
        assert!(run.summary().starts_with(&format!("out.ppm: {expected} by ")), "{given}: {}", run.summary());
    }
}

#[test]
fn a_picture_that_can_hardly_be_meant_is_warned_of() {
    let place = Place::new();
    let black = "warning: the scene has no light: whatever is seen is black\n";
    let behind = "warning: nothing is in front of the camera, which looks along +z from the origin\n";
    let filled = "warning: every ray hits, as through a long lens: is the focal distance of 50 meant for the film of an old \
                  scene? try `--film 35`\n";
    let levels = "warning: an object has the colour 255 128 0, and white is 1 1 1: are levels of 255 meant? divide them by 255\n";
    let light = "1 1 1 1 1 5 5 0";
    for (scene, arguments, warning) in [
        ("1  0  1 1 1 1 1 0 0 5  0".to_owned(), "", black.to_owned()),
        ("1  1 0 1 1 1 5 5 0  1 1 1 1 1 0 0 5  0".to_owned(), "", black.to_owned()),
        ("1  1 1 0 0 0 5 5 0  1 1 1 1 1 0 0 5  0".to_owned(), "", black.to_owned()),
        (format!("1  {light}  1 1 1 1 1 0 0 -5  0"), "", behind.to_owned()),
        (format!("1  {light}  1 6 1 1 1 0 0 -5  0"), "", String::new()),
        ("1  0  0  1 1 1 1 0 0 -1 1 0 -1 0 1 0".to_owned(), "", format!("{black}{behind}")),
        (format!("50  {light}  1 1 1 1 1 0 0 5  0"), "", filled.to_owned()),
        (format!("50  {light}  1 1 1 1 1 0 0 5  0"), "--film 35", String::new()),
        (format!("50  {light}  1 1 1 1 1 0 0 500  0"), "", String::new()),
        (format!("50  {light}  0  1 1 1 1 -9 -9 9 9 -9 9 0 9 9"), "", filled.to_owned()),
        (format!("5  {light}  1 1 1 1 1 0 0 5  0"), "", String::new()),
        (format!("1  {light}  2 1 1 1 1 0 0 5 1 255 128 0 0 0 5  0"), "", levels.to_owned()),
        (format!("1  {light}  0  1 255 128 0 -1 -1 5 1 -1 5 0 1 5"), "", levels.to_owned()),
        (format!("1  {light}  1 1 255 128 0.5 0 0 5  0"), "", String::new()),
        (format!("1  {light}  1 1 256 128 0 0 0 5  0"), "", String::new()),
        (format!("1  {light}  1 1 10 2 0 0 0 5  0"), "", String::new()),
        ("1  1 1 255 255 255 5 5 0  1 1 1 1 1 0 0 5  0".to_owned(), "", String::new()),
    ] {
        place.write("scene.in", &format!("x.png 16 12 {scene}\n"));
        let run = place.run(&format!("render scene.in --quiet --force {arguments}"));
        assert_eq!((run.status, run.stderr), (0, warning), "{scene} {arguments}");
    }
}

#[test]
fn a_camera_goes_round_a_scene_from_one_reading_of_it() {
    let place = Place::new();
    fs::create_dir(place.path("frames")).unwrap();
    let run = place.run("render scene.in --orbit 4 -o frames/%02d.ppm");
    assert_eq!((run.status, run.stdout.as_str()), (0, ""), "{}", run.stderr);
    let summary = format!("frames/00.ppm to frames/03.ppm: 4 of 16x12 by {}, traced in ", Engine::fastest());
    assert!(run.summary().starts_with(&summary), "{}", run.summary());
    place.run("render scene.in -o plain.ppm");
    let picture = |name: &str| fs::read(place.path(name)).unwrap();
    let all = [0, 1, 2, 3].map(|number| picture(&format!("frames/{number:02}.ppm")));
    assert!(all[0] == picture("plain.ppm") && (1..4).all(|i| all[i] != all[i - 1]));
    // A finer turn has the same pictures and others between them; samples and rows apply to each
    // picture.
    place.run("render scene.in --orbit 8 -o frames/%d.ppm --quiet");
    assert!((0..4).all(|i| all[i] == picture(&format!("frames/{}.ppm", 2 * i))));
    place.run("render scene.in --orbit 2 -o s%d.ppm --samples 2 --edges --rows 3..9 --background 1,0,0");
    place.run("render scene.in -o s.ppm --samples 2 --edges --rows 3..9 --background 1,0,0");
    assert!(picture("s0.ppm") == picture("s.ppm") && picture("s1.ppm") != picture("s.ppm"));

    let names_one = |name| {
        format!(
            "error: --orbit writes several pictures, and {name} is the name of one: give it a number, as in frames/%04d.png"
        )
    };
    for (arguments, message) in [
        ("scene.in --orbit 2 -o x.png", names_one("x.png")),
        ("scene.in --orbit 2 -o -", names_one("-")),
        ("scene.in --orbit 2 -o %x.png", names_one("%x.png")),
        ("scene.in --orbit 2 -o %4d.png", names_one("%4d.png")),
        ("scene.in --orbit 2 -o %d%d.png", names_one("%d%d.png")),
        ("scene.in --orbit 2 -o %099d.png", names_one("%099d.png")),
        (
            "scene.in scene.in --orbit 2 -o %d.png",
            "error: --orbit goes round one scene: render the others in calls of their own".into(),
        ),
        (
            "scene.in --orbit 2 -o none/%d.png",
            "error: cannot write none/0.png: there is no directory none; create it first".into(),
        ),
    ] {
        place.refuses(&format!("render {arguments}"), if arguments.contains("none") { 1 } else { 2 }, &message);
    }
    for with in ["--preview", "--stats", "--json", "--explain"] {
        let run = place.run(&format!("render scene.in --orbit 2 -o %d.png {with}"));
        assert!(run.status == 2 && run.stderr.contains("cannot be used with"), "{}", run.stderr);
    }
    let run = place.run("render scene.in --orbit 2");
    assert!(run.status == 2 && run.stderr.contains("--output <FILE>"), "{}", run.stderr);
}

#[test]
fn several_scenes_are_rendered_in_one_call() {
    let place = Place::new();
    place.write("other.in", &SCENE.replace("picture.png", "other.pfm"));
    place.write("same.in", SCENE);
    let expected = "2 scenes make 2 pictures, and there is no directory out for them: create it first";
    place.refuses("render scene.in other.in -o out", 2, &format!("error: {expected}"));
    place.refuses(
        "render scene.in other.in -o -",
        2,
        "error: several pictures cannot go to standard output: name a directory with -o",
    );

    let run = place.run("render scene.in other.in --quiet --json");
    assert_eq!((run.status, run.stderr.as_str()), (0, ""));
    assert_eq!(serde_json::Deserializer::from_str(&run.stdout).into_iter::<Value>().count(), 2);
    fs::create_dir(place.path("out")).unwrap();
    assert_eq!(place.run("render scene.in other.in -o out").stderr.lines().count(), 2);
    for name in ["picture.png", "other.pfm"] {
        assert_eq!(fs::read(place.path(name)).unwrap(), fs::read(place.path("out").join(name)).unwrap());
    }

    // A scene that cannot be rendered is reported, and the others are still rendered.
    place.write("bad.in", "bad.png 8 0 1 0 0 0");
    fs::remove_file(place.path("out/other.pfm")).unwrap();
    let run = place.run("render bad.in scene.in same.in nothing.in other.in -o out --quiet");
    assert_eq!(run.status, 2);
    assert!(run.stderr.contains("bad.in:1:"), "{}", run.stderr);
    let same = "error: same.in: its picture is out/picture.png, as is that of a scene before it: render it in a call of \
                its own";
    assert!(run.stderr.contains(same) && run.stderr.contains("`nothing.in`"), "{}", run.stderr);
    assert!(place.path("out/other.pfm").exists());
}

#[test]
fn some_rows_are_those_of_the_whole_picture() {
    let place = Place::new();
    for name in ["a.png", "a.pfm", "a.hdr"] {
        place.run(&format!("render scene.in --quiet -o {name}"));
        place.run(&format!("render scene.in --rows 3..8 --quiet -o rows-{name}"));
        let (whole, part) = (place.picture(name), place.picture(&format!("rows-{name}")));
        assert_eq!(size(&part), (16, 5), "{name}");
        match (whole.pixels, part.pixels) {
            (Pixels::Rgb8(whole), Pixels::Rgb8(part)) => assert_eq!(whole[16 * 3..16 * 8], part, "{name}"),
            (Pixels::Rgb32F(whole), Pixels::Rgb32F(part)) => assert_eq!(whole[16 * 3..16 * 8], part, "{name}"),
            _ => panic!("{name}"),
        }
    }
    // The rows of an EXR are at their place in the picture, and the rest is black.
    place.run("render scene.in --quiet -o a.exr");
    place.run("render scene.in --rows 3..8 --quiet -o rows.exr");
    let (Pixels::Rgb32F(mut whole), part) = (place.picture("a.exr").pixels, place.picture("rows.exr")) else {
        panic!()
    };
    assert_eq!(size(&part), (16, 12));
    (0..16 * 12).filter(|pixel| !(16 * 3..16 * 8).contains(pixel)).for_each(|pixel| whole[pixel] = [0.0; 3]);
    assert!(matches!(part.pixels, Pixels::Rgb32F(part) if part == whole));

    let stats = place.run("render scene.in --rows 3..8 --stats --json -o b.png").document();
    assert_eq!((&stats["height"], &stats["rays"]), (&json!(5), &json!(16 * 5)));
    place.refuses("render scene.in --rows 3..13 -o b.png", 2, "error: --rows 3..13: the picture has the rows 0..12");
    let run = place.run("render scene.in --rows 8..8 -o b.png");
    assert!(run.stderr.contains("expected the first row and the one after the last, as in 0..100"), "{}", run.stderr);
}

#[test]
fn a_long_picture_shows_no_progress_where_nobody_watches() {
    let place = Place::new();
    // About two seconds of work for the slowest engine: progress would be shown after one.
    place.write("many.in", &rayo::internals::scene::many(60, 60, 1).to_text());
    let run = place.run("render many.in --engine reference --threads 1");
    assert!(run.summary().starts_with("many.png: 640x480 by reference, traced in "), "{}", run.summary());
    assert!(!run.stderr.contains(['\r', '\u{1b}']), "{}", run.stderr.escape_debug());
}

// Figures

#[test]
fn stats_tell_where_the_time_went() {
    let place = Place::new();
    let run = place.run("render scene.in --stats --engine rust --threads 1");
    assert_eq!((run.status, run.stderr.as_str()), (0, ""));
    let names: Vec<_> = run.stdout.lines().map(|line| line.split_whitespace().next().unwrap()).collect();
    assert_eq!(names, ["engine", "rays", "parse", "set-up", "trace", "encode", "write"], "{}", run.stdout);
    assert!(run.stdout.starts_with("engine   rust, single, 1 thread\nrays     192 (16x12), "), "{}", run.stdout);
}

#[test]
fn stats_in_json_have_these_fields_and_count_the_rays_that_hit() {
    let place = Place::new();
    // A triangle that covers the picture, and one that is not visible.
    for (triangle, hits) in [("-99 -99 9  99 -99 9  0 99 9", 192), ("-99 -99 -9  99 -99 -9  0 99 -9", 0)] {
        place.write("flat.in", &format!("x.png 16 12 1  1 1 1 1 1 0 5 0  0  1  1 1 1 {triangle}"));
        assert_eq!(place.run("render flat.in --json --force").document()["hits"], hits, "{triangle}");
    }
    for arguments in ["--stats --json", "--json", "--json --quiet"] {
        let run = place.run(&format!("render scene.in --engine rust --size 40x30 --force {arguments}"));
        assert_eq!((run.status, run.stderr.as_str()), (0, ""));
        let json = run.document();
        for (name, expected) in [
            ("schema", json!(1)),
            ("engine", json!("rust")),
            ("precision", json!("single")),
            ("width", json!(40)),
            ("height", json!(30)),
            ("rays", json!(1200)),
        ] {
            assert_eq!(json[name], expected, "{name}");
        }
        for name in ["hits", "parse_ns", "setup_ns", "trace_ns", "encode_ns", "write_ns"] {
            assert!(json[name].is_u64(), "{name}: {}", json[name]);
        }
        assert!((1..1200).contains(&json["hits"].as_u64().unwrap()), "{}", json["hits"]);
        let cycles = &json["trace_cycles"];
        assert!(if cfg!(target_arch = "x86_64") { cycles.is_u64() } else { cycles.is_null() }, "{cycles}");
    }
}

#[test]
fn info_tells_what_this_build_and_cpu_have() {
    let place = Place::new();
    let json = place.run("info --json").document();
    assert_eq!(json["schema"], 1);
    assert_eq!(json["version"], env!("CARGO_PKG_VERSION"));
    for name in ["cpu", "tsc_hz", "isa", "engines", "nasm", "cc", "rustc", "kernel", "hypervisor", "core_hz", "date"] {
        assert!(json.get(name).is_some(), "{name}");
    }
    // In a repository the commit that is checked out; in a package none.
    let commit = json["commit"].as_str().unwrap_or_default();
    let digits = if Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join(".git/description").is_file()
        || Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join(".git").is_file()
    {
        12
    } else {
        commit.len()
    };
    assert!(commit.len() == digits && commit.chars().all(|digit| digit.is_ascii_hexdigit()), "{commit}");
    assert!(json["rustc"].as_str().unwrap().starts_with("rustc "));
    for (name, built) in [("nasm", cfg!(all(feature = "asm", target_arch = "x86_64"))), ("cc", cfg!(feature = "c"))] {
        assert!(if built { json[name].is_string() } else { json[name].is_null() }, "{name}");
    }
    if cfg!(target_arch = "x86_64") {
        assert!(json["tsc_hz"].as_f64().unwrap() > 1e8);
    }
    for isa in json["isa"].as_array().unwrap() {
        assert!(isa["name"].is_string() && isa["usable"].is_boolean(), "{isa}");
        assert_eq!(isa["built"], cfg!(all(feature = "asm", target_arch = "x86_64")), "{isa}");
    }
    let names = Engine::ALL.iter().filter(|engine| engine.usable()).map(|engine| engine.name());
    assert_eq!(json["engines"], json!(names.collect::<Vec<_>>()));

    let text = place.run("info");
    assert_eq!((text.status, text.stderr.as_str()), (0, ""));
    assert!(text.stdout.starts_with(&format!("version      {}\n", env!("CARGO_PKG_VERSION"))), "{}", text.stdout);
    assert!(text.stdout.contains("\nengines      reference, rust"), "{}", text.stdout);
}

#[test]
fn nothing_is_coloured_but_at_a_terminal() {
    let mut place = Place::new();
    place.write("bad.in", "x.png 0 5");
    for variables in [vec![], vec![("NO_COLOR", "1")], vec![("NO_COLOR", "1"), ("CLICOLOR_FORCE", "1")]] {
        place.variables = variables;
        for arguments in ["", "--help", "rendr", "render --threads 0", "render bad.in", "render none.in", "info"] {
            let run = place.run(arguments);
            assert!(!run.stdout.contains('\u{1b}') && !run.stderr.contains('\u{1b}'), "{arguments}: {:?}", run.stderr);
        }
    }
}
