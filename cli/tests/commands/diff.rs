//! `rayo diff`: its report about two pictures.

use crate::place::{Place, invalid};
use rayo::Pixels;
use serde_json::json;
use std::fs;

// Two images

/// Two P3 files that differ by 3 levels in one pixel.
fn images() -> Place {
    let place = Place::new();
    place.write("a.ppm", "P3 2 1 255  10 20 30  1 2 3");
    place.write("b.ppm", "P3 2 1 255  10 20 30  1 5 3");
    place
}

#[test]
fn diff_tells_in_words_what_differs() {
    let place = images();
    let same = place.run("diff a.ppm a.ppm");
    assert_eq!((same.status, same.stdout.as_str(), same.stderr.as_str()), (0, "identical: 2x1 pixels\n", ""));
    let other = place.run("diff a.ppm b.ppm");
    assert_eq!((other.status, other.stderr.as_str()), (1, ""));
    assert_eq!(
        other.stdout,
        "1 of 2 pixels differ (50.000 %), 1 by 2 levels or more\n\
         largest difference 3 levels at (1, 0): 1 2 3 against 1 5 3\n\
         mean 0.500 levels, RMS 1.225 levels, PSNR 46.37 dB\n"
    );
}

#[test]
fn diff_passes_up_to_the_tolerance() {
    let place = images();
    for (tolerance, status) in [("0", 1), ("2.9", 1), ("3", 0), ("inf", 0)] {
        assert_eq!(place.run(&format!("diff a.ppm b.ppm --tolerance {tolerance}")).status, status, "{tolerance}");
    }
    // A NaN differs from a number by more than any tolerance.
    for (name, value) in [("nan.pfm", f32::NAN), ("one.pfm", 1.0)] {
        fs::write(place.path(name), [b"Pf\n1 1\n-1\n".as_slice(), &value.to_le_bytes()].concat()).unwrap();
    }
    assert_eq!(place.run("diff nan.pfm one.pfm --tolerance inf").status, 1);
    for tolerance in ["-1", "nan", "two"] {
        let message = invalid(tolerance, "--tolerance <T>", "expected a number that is not negative");
        place.refuses(&format!("diff a.ppm b.ppm --tolerance {tolerance}"), 2, &message);
    }
}

#[test]
fn diff_prints_one_json_document() {
    let run = images().run("diff a.ppm b.ppm --json");
    assert_eq!(run.status, 1);
    let json = run.document();
    for (name, expected) in [
        ("schema", json!(1)),
        ("within_tolerance", json!(false)),
        ("differing", json!(1)),
        ("largest", json!(3.0)),
        ("largest_at", json!([1, 0])),
    ] {
        assert_eq!(json[name], expected, "{name}");
    }
}

#[test]
fn diff_writes_the_picture_of_the_differences() {
    let place = images();
    let run = place.run("diff a.ppm b.ppm -o out.png");
    assert_eq!((run.status, run.stderr.as_str()), (1, ""));
    assert!(run.stdout.ends_with("\nout.png: the differences, white where they are largest\n"), "{}", run.stdout);
    assert_eq!(place.picture("out.png").pixels, Pixels::Rgb8(vec![[0; 3], [0, 255, 0]]));
}

#[test]
fn diff_refuses_what_claims_another_size_before_it_is_decoded() {
    let place = images();
    // A damaged picture whose header claims a large size: the damage is not reached, because the
    // sizes differ.
    place.write("large.ppm", &format!("P6 300 30 255\n{}", "x".repeat(27_000)));
    let damaged = fs::read(place.path("large.ppm")).unwrap();
    fs::write(place.path("large.ppm"), &damaged[..26_000]).unwrap();
    let sizes = "error: cannot compare a.ppm with large.ppm: the first picture has 2x1 pixels and the second 300x30: \
                 only pictures of one size can be compared";
    place.refuses("diff a.ppm large.ppm", 2, sizes);
    let run = place.run("diff large.ppm large.ppm");
    assert_eq!(
        (run.status, run.stderr.as_str()),
        (2, "error: large.ppm is damaged or incomplete: it ends too early\n")
    );
}

#[test]
fn diff_says_what_keeps_images_from_being_compared() {
    let place = images();
    let kind = "error: scene.in is of an unsupported format: rayo reads PNG, PNM (PBM, PGM, PPM and PAM), PFM, EXR, HDR, TIFF \
                and QOI";
    place.refuses("diff a.ppm scene.in", 2, kind);
    let missing = "error: cannot read none.png: No such file or directory (os error 2)";
    place.refuses("diff a.ppm none.png", 2, missing);
    let floats = "error: out.pfm: the picture of differences has 8 bits; name it .png or .ppm";
    place.refuses("diff a.ppm a.ppm -o out.pfm", 2, floats);
    assert_eq!(place.run("diff a.ppm a.ppm -o out.jpg").status, 2);
    let directory = "error: cannot write none/out.png: there is no directory none; create it first";
    place.refuses("diff a.ppm b.ppm -o none/out.png", 1, directory);
    assert_eq!(place.files(), ["a.ppm", "b.ppm", "scene.in"]);
}
