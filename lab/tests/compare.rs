//! The comparison of two pictures: its statistics for cases computed by hand.

use rayo::{Picture, Pixels};
use rayo_lab::measure::compare::{CompareError, Unit, compare, difference_image};

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
    // The differences are 1; 3; 2 and 1, over 12 channels: their sum is 7, that of their squares
    // 1 + 9 + 4 + 1 = 15.
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
    // 1/255 = 0.0039...: 0.25 is more than twice that, 0.005 more than once; 0.001 and the smallest
    // float are less.
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
fn difference_picture_shows_even_the_least_difference() {
    let a = levels(2, 1, &[[0, 10, 255], [3, 0, 0]]);
    let b = levels(2, 1, &[[1, 10, 0], [0, 4, 0]]);
    assert_eq!(difference_image(&a, &b).unwrap(), levels(2, 1, &[[65, 0, 255], [66, 67, 0]]));
    let b = levels(2, 1, &[[1, 10, 255], [3, 0, 0]]);
    assert_eq!(difference_image(&a, &b).unwrap(), levels(2, 1, &[[255, 0, 0], [0; 3]]));
    assert_eq!(difference_image(&a, &a).unwrap(), levels(2, 1, &[[0; 3]; 2]));
    let a = floats(2, 1, &[[0.0, 1e-30, f32::NAN], [-1.0, 0.0, f32::NAN]]);
    let b = floats(2, 1, &[[1.0, 0.0, f32::NAN], [-1.0, 0.0, 2.0]]);
    assert_eq!(difference_image(&a, &b).unwrap(), levels(2, 1, &[[255, 64, 0], [0, 0, 255]]));
    let (a, b) = (floats(1, 1, &[[1.0, 1.0, 0.0]]), floats(1, 1, &[[1.0 + 1e-7, 1.0, f32::INFINITY]]));
    assert_eq!(difference_image(&a, &b).unwrap(), levels(1, 1, &[[255, 0, 255]]));
}

#[test]
fn infinite_statistics_are_null_in_json() {
    let picture = levels(1, 1, &[[0; 3]]);
    let json = serde_json::to_value(compare(&picture, &picture).unwrap()).unwrap();
    assert_eq!(json["psnr"], serde_json::Value::Null);
    assert_eq!(json["unit"], "levels");
}
