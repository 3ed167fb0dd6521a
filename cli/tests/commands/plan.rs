//! `rayo plan`: what is kept and omitted, in words and as a JSON document.

use std::path::Path;

use crate::program::{self, Run};

/// A scene with one object or light for each kind of omission.
const EVERYTHING: &str = "\
all.png 160 120 1
4
0.5  1 1 1    -10 10 0
0    1 1 1    0 0 0        # dark
0.4  1 0 0    0 0 300      # behind all
0.3  0 1 1    10 0 0
6
2    1 1 1    -3 0 20
1    1 1 1    0 0 -5       # behind the camera
1    1 1 1    90 0 20      # beside the picture
2    0 0 0    -3 3 22      # black
1.5  1 1 1    -3 0 24      # hidden in part
1    1 0 0    3 3 20       # of one light's colour
5
0 1 0    1 -3 20  6 -3 20  3 2 20
0 0 1    2 -3 22  7 -3 22  4 2 22             # behind it
1 1 1    1 1 20  2 2 20  3 3 20               # no area
1 1 1    1 1 20  2 5 20  0 0 0                # edge on
1 1 1    -50 -30 20  -60 -30 20  -50 -40 20   # below the picture
";

/// Runs the program in a directory where the file all.in contains [`EVERYTHING`].
fn rayo(directory: &Path, arguments: &str) -> Run {
    std::fs::write(directory.join("all.in"), EVERYTHING).unwrap();
    program::rayo(arguments.split(' '), directory)
}

const WARNING: &str = "warning: all.in:17: triangle 3 has no area, and no ray hits it: its corners are on one line\n";

#[test]
fn the_plan_of_one_of_everything_reads_like_this() {
    let directory = tempfile::tempdir().unwrap();
    let run = rayo(directory.path(), "plan all.in --engine sse41");
    insta::assert_snapshot!("plan_of_everything", run.printed());
    assert_eq!(run.stderr, WARNING);
    let of_c = rayo(directory.path(), "plan all.in --engine c");
    assert!(of_c.printed().contains("kept: 6 spheres, 3 triangles, 4 lights\n"), "{of_c:?}");
    rayo(directory.path(), "plan all.in --engine none").refuses("there is no engine `none`");
}

#[test]
fn the_plan_is_one_json_document_with_these_fields() {
    let directory = tempfile::tempdir().unwrap();
    let json = rayo(directory.path(), "plan all.in --engine sse41 --json --size 80x60").document();
    for (place, expected) in [
        ("/schema", "1"),
        ("/scene", "\"all.in\""),
        ("/engine", "\"sse41\""),
        ("/precision", "\"single\""),
        ("/output", "\"rgb8\""),
        ("/width", "80"),
        ("/height", "60"),
        ("/kept", r#"{"lights":3,"spheres":4,"triangles":2}"#),
        ("/left_out/0/what", "\"objects behind the camera\""),
        ("/left_out/0/count", "1"),
        ("/measured", "null"),
    ] {
        assert_eq!(json.pointer(place).map(ToString::to_string).as_deref(), Some(expected), "{place}");
    }
    for line in json["left_out"].as_array().unwrap() {
        let text = |key: &str| line[key].as_str().is_some_and(|text| !text.is_empty());
        assert!(text("what") && text("reason") && text("unit") && line["count"].as_u64() > Some(0), "{line}");
    }
}

#[test]
fn the_plan_of_many_objects_says_that_it_goes_by_tiles() {
    let directory = tempfile::tempdir().unwrap();
    rayo(directory.path(), "make torus --triangles 400 -o torus.toml --quiet").printed();
    let plan = rayo(directory.path(), "plan torus.toml --engine sse41");
    let why = "\ntile by tile: 13 x 19 tiles of 64 x 32 pixels, ";
    assert!(plan.printed().contains(why), "{plan:?}");
    let run = rayo(directory.path(), "plan torus.toml --json --measure --size 100x70");
    let json = run.document();
    assert_eq!(json["kept"].to_string(), r#"{"lights":2,"spheres":0,"triangles":400}"#);
    let tiles = ["objects", "width", "height", "across", "down"].map(|key| json["tiles"][key].as_u64());
    assert_eq!(tiles, [400, 64, 32, 2, 3].map(Some));
    assert_eq!((&json["measured"]["rows"], &json["measured"]["threads"]), (&70.into(), &1.into()));
    let is_ratio = |ratio: &serde_json::Value| {
        let [middle, low, high] = ["ratio", "ratio_low", "ratio_high"].map(|key| ratio[key].as_f64());
        assert!(Some(0.0) < low && low <= middle && middle <= high, "{ratio}");
    };
    ["control", "keep_all"].iter().for_each(|of| is_ratio(&json["measured"][of]));
    let (lines, worth) = (json["left_out"].as_array().unwrap(), json["measured"]["worth"].as_array().unwrap());
    assert_eq!(lines.len(), worth.len());
    for (line, worth) in lines.iter().zip(worth) {
        assert_eq!(line["what"], worth["what"]);
        let has_code = !["code for spheres", "constant terms"].contains(&line["what"].as_str().unwrap());
        assert_eq!((worth["ratio"].is_null(), worth["note"].is_string()), (!has_code, !has_code), "{worth}");
        [worth].into_iter().filter(|_| has_code).for_each(is_ratio);
    }
    for what in ["objects in other tiles", "tests of rays that miss", "float image"] {
        assert!(lines.iter().any(|line| line["what"] == what), "{what}: {json}");
    }
    assert_eq!(run.stderr, "", "no bar but on a terminal");
}

#[test]
fn render_explains_its_plan_and_brute_force_makes_the_same_file() {
    let directory = tempfile::tempdir().unwrap();
    let planned = rayo(directory.path(), "render all.in -o planned.png --explain --quiet");
    let plan = rayo(directory.path(), "plan all.in");
    let (_, lines) = plan.printed().split_once('\n').unwrap();
    assert_eq!((planned.printed(), planned.stderr.as_str()), ("", &*format!("{WARNING}{lines}")));
    assert_eq!(rayo(directory.path(), "render all.in -o kept.png --keep-all --quiet").stderr, WARNING);
    let file = |name: &str| std::fs::read(directory.path().join(name)).unwrap();
    assert!(file("planned.png") == file("kept.png"));
    let rust = rayo(directory.path(), "render all.in -o rust.png --keep-all --engine rust").stderr;
    assert!(
        rust.contains("rust tests every ray against every object as it is: --keep-all changes nothing\n"),
        "{rust}"
    );
}

#[test]
fn figure_has_a_line_for_each_timed_omission() {
    let directory = tempfile::TempDir::new().unwrap();
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenes");
    let scenes = ["sphere.in", "tetrahedron.in"].map(|name| format!("{folder}/{name}"));
    let [sphere, tetrahedron] = scenes.each_ref().map(String::as_str);
    let plan = ["plan", sphere, tetrahedron, "--size", "16x12", "--measure", "--figure", "worth.svg"];
    let run = program::rayo(plan, directory.path());
    let told = run.printed();
    assert!(told.contains("\n  the plan against itself "), "{told}");
    assert!(told.contains("sphere.in: 16x12") && told.contains("\n\n") && told.contains("tetrahedron.in: 16x12"));
    let figure = std::fs::read_to_string(directory.path().join("worth.svg")).unwrap();
    for text in ["sphere.in", "tetrahedron.in", "all that --keep-all keeps"] {
        assert_eq!(figure.matches(&format!(">{text}<")).count(), 1, "{text}");
    }
    for (args, expected) in [
        (&["plan", sphere, "--figure", "a.svg"][..], "--measure"),
        (&["plan", sphere, tetrahedron, "--json"], "--json prints one document, of one scene"),
    ] {
        program::rayo(args, directory.path()).refuses(expected);
    }
}
