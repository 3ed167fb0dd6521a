//! `rayo render --samples --edges --background --exposure --srgb`: what is made of linear light after tracing.

use std::path::Path;

use crate::program::rayo;
use rayo::measure::picture::Pixels;
use rayo::render::read;
use tempfile::TempDir;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");
const SCENE: &str = "scenes/tetrahedron.in";

/// Renders the scene, at 120x90, with these arguments.
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
fn samples_along_edges_alone_make_nearly_the_same_picture_of_fewer_rays() {
    let directory = TempDir::new().unwrap();
    let rendered = |scene: &str, more: &[&str]| {
        let path = directory.path().join("a.png");
        let arguments = ["render", scene, "--json", "--size", "800x600", "-o", path.to_str().unwrap()];
        let report = rayo(arguments.iter().chain(more), ROOT.as_ref()).document();
        let Pixels::Rgb8(pixels) = read(&path).unwrap().pixels else { panic!("it has bytes") };
        (report["rays"].as_u64().unwrap(), report["hits"].as_u64().unwrap(), pixels)
    };
    // By spans and by tiles.
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
fn what_cannot_be_developed_is_refused_with_a_reason() {
    let directory = TempDir::new().unwrap();
    for (name, args, expected) in [
        ("a.png", &["--samples", "0"][..], "expected a whole number from 1 to 16"),
        ("a.png", &["--samples", "17"], "expected a whole number from 1 to 16"),
        ("a.png", &["--edges"], "--samples <N>"),
        ("a.png", &["--background", "1,2"], "expected three numbers from 0 on"),
        ("a.png", &["--background", "1,2,-3"], "expected three numbers from 0 on"),
        ("a.png", &["--exposure", "nan"], "expected a number of stops"),
        ("a.exr", &["--srgb"], "--srgb is for formats with 8 bits"),
        ("a.ppm", &["--samples", "16", "--size", "70000x100"], "--samples 16: each side of an image"),
    ] {
        let path = directory.path().join(name);
        rayo(["render", SCENE, "-o", path.to_str().unwrap()].iter().chain(args), ROOT.as_ref()).refuses(expected);
        assert!(!path.exists(), "{args:?} wrote a file");
    }
}
