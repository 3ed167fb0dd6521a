//! `rayo render --samples --edges --background --exposure --srgb`: how linear light is developed
//! after tracing.

use std::path::Path;

use crate::program::rayo;
use rayo::Pixels;
use rayo::internals::render::read;
use tempfile::TempDir;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
const SCENE: &str = "scenes/tetrahedron.in";

/// Renders the scene with 120x90 pixels and these arguments.
fn render(directory: &Path, name: &str, args: &[&str]) -> Vec<u8> {
    let path = directory.join(name);
    let arguments = ["render", SCENE, "--quiet", "--size", "120x90", "-o", path.to_str().unwrap()];
    rayo(arguments.iter().chain(args), ROOT.as_ref()).printed();
    std::fs::read(path).unwrap()
}

#[test]
fn what_is_not_asked_for_changes_no_byte() {
    let directory = TempDir::new().unwrap();
    let plain = render(directory.path(), "plain.png", &[]);
    let asked = render(directory.path(), "asked.png", &["--samples", "1", "--exposure", "0", "--background", "0,0,0"]);
    assert!(plain == asked);
    assert!(plain != render(directory.path(), "srgb.png", &["--srgb"]));
}

#[test]
fn samples_along_edges_take_fewer_rays_for_the_same() {
    let directory = TempDir::new().unwrap();
    let rendered = |scene: &str, more: &[&str]| {
        let path = directory.path().join("a.png");
        let arguments = ["render", scene, "--json", "--size", "800x600", "-o", path.to_str().unwrap()];
        let report = rayo(arguments.iter().chain(more), ROOT.as_ref()).document();
        let Pixels::Rgb8(pixels) = read(&path).unwrap().pixels else { panic!("it has bytes") };
        (report["rays"].as_u64().unwrap(), report["hits"].as_u64().unwrap(), pixels)
    };
    // A scene traced by spans, and one traced by tiles.
    for scene in ["scenes/sphere.in", "scenes/many.in"] {
        let [(rays, hits, all), edges, (.., one)] =
            [&["--samples", "4"][..], &["--samples", "4", "--edges"], &[]].map(|more| rendered(scene, more));
        assert!(edges.0 < rays / 2 && edges.1 < hits / 2, "{scene}: {} of {rays} rays", edges.0);
        let error = |picture: &[[u8; 3]]| -> u64 {
            let levels = picture.as_flattened().iter().zip(all.as_flattened());
            levels.map(|(a, b)| u64::from(a.abs_diff(*b)).pow(2)).sum()
        };
        assert!(20 * error(&edges.2) < error(&one), "{scene}: {} against {}", error(&edges.2), error(&one));
    }
}

#[test]
fn an_srgb_picture_of_a_mesh_shows_the_levels_of_its_file() {
    let directory = TempDir::new().unwrap();
    let write = |name: &str, text: &str| std::fs::write(directory.path().join(name), text).unwrap();
    let ply = |kind: &str, colour: &str| {
        let channels = ["red", "green", "blue"].map(|channel| format!("property {kind} {channel}\n")).concat();
        format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n{channels}\
             element face 1\nproperty list uchar int vertex_indices\nend_header\n-9 -9 0 {colour}\n9 -9 0 {colour}\n\
             0 9 0 {colour}\n3 0 1 2\n"
        )
    };
    write("levels.ply", &ply("uchar", "128 64 32"));
    write("floats.ply", &ply("float", "0.50196 0.25098 0.12549"));
    let colour = "0.50196 0.25098 0.12549";
    write("vertices.obj", &format!("v -9 -9 0 {colour}\nv 9 -9 0 {colour}\nv 0 9 0 {colour}\nf 1 2 3\n"));
    write("material.obj", "mtllib m.mtl\nusemtl m\nv -9 -9 0\nv 9 -9 0\nv 0 9 0\nf 1 2 3\n");
    write("m.mtl", &format!("newmtl m\nKd {colour}\n"));
    for mesh in ["levels.ply", "floats.ply", "vertices.obj", "material.obj"] {
        // The mesh faces the camera and the light, which is beside the camera.
        let scene = format!(
            "[image]\nfile = 'a.png'\nwidth = 1\nheight = 1\n[[light]]\nposition = [0, 0, 0]\n[[mesh]]\nfile = '{mesh}'\n\
             translate = [0, 0, 5]\n"
        );
        write("scene.toml", &scene);
        rayo(["render", "scene.toml", "--srgb", "--force", "--quiet"], directory.path()).printed();
        let Pixels::Rgb8(pixels) = read(&directory.path().join("a.png")).unwrap().pixels else {
            panic!("it has bytes")
        };
        let near = pixels[0].iter().zip([128_u8, 64, 32]).all(|(level, of_file)| level.abs_diff(of_file) <= 1);
        assert!(near, "{mesh}: {:?}", pixels[0]);
    }
}

#[test]
fn a_background_in_srgb_is_the_colour_of_the_picture() {
    let directory = TempDir::new().unwrap();
    let corner = |args: &[&str]| {
        render(directory.path(), "a.png", args);
        let Pixels::Rgb8(pixels) = read(&directory.path().join("a.png")).unwrap().pixels else {
            panic!("it has bytes")
        };
        pixels[0]
    };
    for (colour, levels) in [("#ff8000", [255, 128, 0]), ("#010A0b", [1, 10, 11]), ("#fefdfc", [254, 253, 252])] {
        for more in [&[][..], &["--samples", "3"], &["--samples", "2", "--edges"]] {
            assert_eq!(corner(&[&["--srgb", "--background", colour], more].concat()), levels, "{colour}");
        }
    }
    for level in 0..=255 {
        let colour = format!("#{level:02x}{level:02X}{level:02x}");
        assert_eq!(corner(&["--srgb", "--background", &colour]), [level; 3], "{colour}");
    }
    // Without --srgb, levels are in linear light.
    assert_eq!(corner(&["--background", "#ff8000"]), [255, 55, 0]);
}

#[test]
fn a_background_brighter_than_white_is_noted_once() {
    let directory = TempDir::new().unwrap();
    std::fs::create_dir(directory.path().join("d")).unwrap();
    let noted = |arguments: &[&str]| {
        let scenes = ["render", SCENE, "--size", "12x9", "-o"];
        let run = rayo(scenes.iter().chain(arguments), ROOT.as_ref());
        assert_eq!(run.status, 0, "{}", run.stderr);
        run.stderr.lines().filter(|line| line.starts_with("note: --background")).map(String::from).collect::<Vec<_>>()
    };
    let path = |name: &str| directory.path().join(name).to_str().unwrap().to_string();
    let bright = ["--background", "255,255,128.5"];
    let note = "note: --background 255,255,128.5 is brighter than white, which is 1,1,1; levels from 0 to 255 are written in \
                hexadecimal, as in '#ff8000'";
    assert_eq!(noted(&[&[path("a.png").as_str()], &bright[..]].concat()), [note]);
    // Several pictures get a single note; floats, --quiet, a darker exposure and white get none.
    let scenes = [path("d").as_str(), "scenes/sphere.in", "--background", "1,2,1"].map(String::from);
    assert_eq!(noted(&scenes.each_ref().map(String::as_str)).len(), 1);
    let none = [""; 0];
    assert_eq!(noted(&[&[path("a.exr").as_str()], &bright[..]].concat()), none);
    assert_eq!(noted(&[&[path("a.png").as_str(), "--quiet"], &bright[..]].concat()), none);
    assert_eq!(noted(&[&path("a.png"), "--background", "2,2,2", "--exposure", "-1"]), none);
    assert_eq!(noted(&[&path("a.png"), "--background", "#ffffff"]), none);
}

#[test]
fn what_cannot_be_developed_is_refused_with_a_reason() {
    let directory = TempDir::new().unwrap();
    for (name, args, expected) in [
        ("a.png", &["--samples", "0"][..], "expected a whole number from 1 to 16"),
        ("a.png", &["--samples", "17"], "expected a whole number from 1 to 16"),
        ("a.png", &["--edges"], "--samples <N>"),
        ("a.png", &["--background", "1,2"], "expected three numbers of at least 0"),
        ("a.png", &["--background", "1,2,-3"], "expected three numbers of at least 0"),
        ("a.png", &["--background", "#ff800"], "expected '#rrggbb'"),
        ("a.png", &["--background", "#+f8000"], "expected '#rrggbb'"),
        ("a.png", &["--background", "#ff80éa"], "expected '#rrggbb'"),
        ("a.png", &["--exposure", "nan"], "expected a number of stops"),
        ("a.exr", &["--srgb"], "--srgb is for formats with 8 bits"),
        ("a.ppm", &["--samples", "16", "--size", "4096x100"], "--samples 16: each side of an image"),
    ] {
        let path = directory.path().join(name);
        rayo(["render", SCENE, "-o", path.to_str().unwrap()].iter().chain(args), ROOT.as_ref()).refuses(expected);
        assert!(!path.exists(), "{args:?} wrote a file");
    }
}
