//! Two pictures compared: statistics against cases computed by hand, and what `rayo diff` makes of files.

use clap::{Args, FromArgMatches};
use rayo::cli::{DiffArgs, DiffError, diff};
use rayo::measure::compare::{AMPLIFICATION, CompareError, Unit, compare, difference_image};
use rayo::measure::picture::{Picture, Pixels};
use rayo::render::read;
use std::fs;
use std::path::Path;

fn levels(width: u32, height: u32, pixels: &[[u8; 3]]) -> Picture {
    Picture::new(width, height, Pixels::Rgb8(pixels.to_vec()))
}

fn floats(width: u32, height: u32, pixels: &[[f32; 3]]) -> Picture {
    Picture::new(width, height, Pixels::Rgb32F(pixels.to_vec()))
}

fn close(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-12 * b.abs()
}

#[test]
fn identical_pictures_differ_nowhere() {
    for picture in [levels(2, 1, &[[1, 2, 3], [4, 5, 6]]), floats(2, 1, &[[f32::NAN, -1.0, f32::INFINITY], [0.0; 3]])] {
        let c = compare(&picture, &picture).unwrap();
        assert_eq!((c.differing, c.off_by_1, c.off_by_2, c.infinite), (0, 0, 0, 0));
        assert_eq!((c.largest, c.largest_at, c.mean, c.rms, c.psnr), (0.0, None, 0.0, 0.0, f64::INFINITY));
    }
}

#[test]
fn levels_are_counted_as_by_hand() {
    let a = levels(2, 2, &[[0, 0, 0], [10, 20, 30], [255, 255, 255], [7, 7, 7]]);
    let b = levels(2, 2, &[[0, 0, 1], [10, 20, 30], [252, 255, 255], [7, 9, 8]]);
    let c = compare(&a, &b).unwrap();
    assert_eq!((c.width, c.height, c.unit), (2, 2, Unit::Levels));
    assert_eq!((c.differing, c.off_by_1, c.off_by_2, c.infinite), (3, 3, 2, 0));
    assert_eq!((c.largest, c.largest_at), (3.0, Some((0, 1))));
    // Differences 1; 3; 2 and 1 over 12 channels: sum 7, squares 1 + 9 + 4 + 1 = 15.
    assert!(close(c.mean, 7.0 / 12.0));
    assert!(close(c.rms, (15.0_f64 / 12.0).sqrt()));
    assert!(close(c.psnr, 10.0 * (255.0 * 255.0 / (15.0_f64 / 12.0)).log10()));
    let swapped = compare(&b, &a).unwrap();
    assert_eq!(swapped, c);
}

#[test]
fn black_against_white_has_no_signal_left() {
    let c = compare(&levels(1, 1, &[[0; 3]]), &levels(1, 1, &[[255; 3]])).unwrap();
    assert_eq!((c.largest, c.mean, c.rms, c.psnr), (255.0, 255.0, 255.0, 0.0));
}

#[test]
fn the_first_of_equal_differences_is_named() {
    let a = levels(3, 2, &[[0; 3]; 6]);
    let b = levels(3, 2, &[[0; 3], [0; 3], [0, 5, 0], [5, 0, 0], [0; 3], [4, 4, 4]]);
    assert_eq!(compare(&a, &b).unwrap().largest_at, Some((2, 0)));
}

#[test]
fn floats_are_counted_as_by_hand() {
    let a = floats(4, 1, &[[0.0, 0.5, -1.0], [0.0; 3], [0.0; 3], [0.0, -0.0, 1e-45]]);
    let b = floats(4, 1, &[[0.0, 0.25, -1.0], [0.005, 0.0, 0.0], [0.001, 0.0, 0.0], [-0.0, 0.0, 0.0]]);
    let c = compare(&a, &b).unwrap();
    assert_eq!(c.unit, Unit::Linear);
    // 1/255 = 0.0039...: 0.25 is more than twice that, 0.005 once, 0.001 and the smallest float are less.
    assert_eq!((c.differing, c.off_by_1, c.off_by_2, c.infinite), (4, 2, 1, 0));
    assert_eq!((c.largest, c.largest_at), (0.25, Some((0, 0))));
    let (p, q, r) = (f64::from(0.005_f32), f64::from(0.001_f32), f64::from(1e-45_f32));
    assert!(close(c.mean, (0.25 + p + q + r) / 12.0));
    let rms = ((0.0625 + p * p + q * q) / 12.0).sqrt();
    assert!(close(c.rms, rms));
    assert!(close(c.psnr, -20.0 * rms.log10()));
}

#[test]
fn nan_equals_nan_and_nothing_else() {
    let nan = f32::NAN;
    let a = floats(3, 1, &[[nan, 0.0, 0.0], [nan, 0.0, 0.0], [0.5, 0.0, 0.0]]);
    let b = floats(3, 1, &[[-nan, 0.0, 0.0], [0.0, 0.0, 0.0], [0.5, nan, 0.0]]);
    let c = compare(&a, &b).unwrap();
    assert_eq!((c.differing, c.off_by_1, c.off_by_2, c.infinite), (2, 2, 2, 2));
    assert_eq!((c.largest, c.largest_at), (f64::INFINITY, Some((1, 0))));
    assert_eq!((c.mean, c.rms, c.psnr), (f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY));
}

#[test]
fn infinities_of_one_sign_are_equal() {
    let inf = f32::INFINITY;
    let c = compare(&floats(1, 2, &[[inf; 3], [inf; 3]]), &floats(1, 2, &[[inf; 3], [-inf; 3]])).unwrap();
    assert_eq!((c.differing, c.infinite, c.largest_at), (1, 1, Some((0, 1))));
}

#[test]
fn different_sizes_and_kinds_are_errors() {
    let (a, b) = (levels(2, 1, &[[0; 3]; 2]), levels(1, 2, &[[0; 3]; 2]));
    assert_eq!(compare(&a, &b), Err(CompareError::Sizes((2, 1), (1, 2))));
    let f = floats(2, 1, &[[0.0; 3]; 2]);
    assert_eq!(compare(&a, &f), Err(CompareError::Kinds(Unit::Levels, Unit::Linear)));
    assert_eq!(difference_image(&f, &a), Err(CompareError::Kinds(Unit::Linear, Unit::Levels)));
}

#[test]
fn the_difference_picture_shows_one_level_and_saturates() {
    let a = levels(2, 1, &[[0, 10, 255], [3, 0, 0]]);
    let b = levels(2, 1, &[[1, 10, 0], [0, 4, 0]]);
    let one = AMPLIFICATION as u8;
    assert_eq!(difference_image(&a, &b).unwrap(), levels(2, 1, &[[one, 0, 255], [3 * one, 255, 0]]));
    let a = floats(2, 1, &[[0.0, 1e-30, f32::NAN], [-1.0, 0.0, f32::NAN]]);
    let b = floats(2, 1, &[[1.0, 0.0, f32::NAN], [-1.0, 0.0, 2.0]]);
    assert_eq!(difference_image(&a, &b).unwrap(), levels(2, 1, &[[255, 1, 0], [0, 0, 255]]));
}

#[test]
fn infinite_statistics_are_null_in_json() {
    let picture = levels(1, 1, &[[0; 3]]);
    let json = serde_json::to_value(compare(&picture, &picture).unwrap()).unwrap();
    assert_eq!(json["psnr"], serde_json::Value::Null);
    assert_eq!(json["unit"], "levels");
}

/// What `rayo diff ARGUMENTS` prints, and whether the images agree.
fn run(arguments: &[&str]) -> Result<(bool, String), DiffError> {
    let command = DiffArgs::augment_args(clap::Command::new("diff").no_binary_name(true));
    let args = DiffArgs::from_arg_matches(&command.try_get_matches_from(arguments).unwrap()).unwrap();
    let mut out = Vec::new();
    let agree = diff(&args, &mut out)?;
    Ok((agree, String::from_utf8(out).unwrap()))
}

/// A directory with two P3 files that differ by 3 levels in one pixel, and its path with a slash.
fn files() -> (tempfile::TempDir, String) {
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("a.ppm"), "P3 2 1 255  10 20 30  1 2 3").unwrap();
    fs::write(directory.path().join("b.ppm"), "P3 2 1 255  10 20 30  1 5 3").unwrap();
    let path = format!("{}/", directory.path().display());
    (directory, path)
}

#[test]
fn diff_tells_in_words_what_differs() {
    let (_directory, d) = files();
    let (a, b) = (format!("{d}a.ppm"), format!("{d}b.ppm"));
    assert_eq!(run(&[&a, &a]).unwrap(), (true, "identical: 2x1 pixels\n".into()));
    let (agree, text) = run(&[&a, &b]).unwrap();
    assert!(!agree);
    assert_eq!(
        text,
        "1 of 2 pixels differ (50.000 %), 1 by 2 levels or more\n\
         largest difference 3 levels at (1, 0): 1 2 3 against 1 5 3\n\
         mean 0.500 levels, RMS 1.225 levels, PSNR 46.37 dB\n"
    );
}

#[test]
fn diff_passes_up_to_the_tolerance() {
    let (_directory, d) = files();
    let (a, b) = (format!("{d}a.ppm"), format!("{d}b.ppm"));
    assert!(!run(&[&a, &b, "--tolerance", "2.9"]).unwrap().0);
    assert!(run(&[&a, &b, "--tolerance", "3"]).unwrap().0);
}

#[test]
fn diff_prints_one_json_document() {
    let (_directory, d) = files();
    let (_, text) = run(&[&format!("{d}a.ppm"), &format!("{d}b.ppm"), "--json"]).unwrap();
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(json["schema"], 1);
    assert_eq!(json["within_tolerance"], false);
    assert_eq!(json["differing"], 1);
    assert_eq!(json["largest"], 3.0);
    assert_eq!(json["largest_at"], serde_json::json!([1, 0]));
}

#[test]
fn diff_writes_the_picture_of_the_differences() {
    let (_directory, d) = files();
    let out = format!("{d}out.png");
    let (_, text) = run(&[&format!("{d}a.ppm"), &format!("{d}b.ppm"), "-o", &out]).unwrap();
    assert!(text.ends_with("out.png: the differences, 64 times as bright\n"), "{text}");
    assert_eq!(read(Path::new(&out)).unwrap(), levels(2, 1, &[[0; 3], [0, 192, 0]]));
}

#[test]
fn diff_says_what_keeps_images_from_being_compared() {
    let (directory, d) = files();
    fs::write(directory.path().join("c.ppm"), "P3 1 1 255  10 20 30").unwrap();
    let (a, c) = (format!("{d}a.ppm"), format!("{d}c.ppm"));
    assert!(matches!(run(&[&a, &c]), Err(DiffError::Compare { .. })));
    assert!(matches!(run(&[&a, &format!("{d}none.png")]), Err(DiffError::Read(_))));
    assert!(matches!(run(&[&a, &a, "-o", &format!("{d}out.pfm")]), Err(DiffError::FloatOutput(_))));
    assert!(matches!(run(&[&a, &a, "-o", &format!("{d}out.jpg")]), Err(DiffError::Output(_))));
    assert!(matches!(run(&[&a, &a, "-o", &format!("{d}no/out.png")]), Err(DiffError::Write(_))));
}

#[test]
fn a_tolerance_is_a_number_that_is_not_negative() {
    let command = DiffArgs::augment_args(clap::Command::new("diff").no_binary_name(true));
    for tolerance in ["--tolerance=-1", "--tolerance=nan", "--tolerance=two"] {
        assert!(command.clone().try_get_matches_from(["a", "b", tolerance]).is_err(), "{tolerance}");
    }
}
