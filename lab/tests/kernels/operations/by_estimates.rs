//! The closed form's shade with the worst estimates of roots that any CPU may give: its twin in
//! Rust is given such estimates.

use rayo::internals::kernels::{LitRow, LitRows, LitSphere, Plain};
use rayo::internals::plan::{Keep, LitForm, Scale};
use rayo::internals::render::level;
use rayo::internals::scene::{Camera, Light, Scene, Sphere, many};
use rayo_lab::experiments::accuracy::{ESTIMATES, expect};
use rayo_lab::families::FAMILIES;
use rayo_lab::truth::TruePixel;

/// The documented largest relative error of `rsqrtps`.
const ERROR: f64 = 1.5 / 4096.0;
/// The documented largest relative error of `vrsqrt14ps`.
const ERROR_14: f64 = 1.0 / 16384.0;
/// The errors of the first and second estimate for a pixel (for further lights they alternate), in
/// units of the largest error: too large or too small, in the same or opposite direction, or exact.
const ADVERSARIES: [[f64; 2]; 9] =
    [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [0.0, 0.0]];
/// The error in levels that rounding to f32 adds to that of the estimates.
const ROUNDING: f64 = 0.02;
/// Within this margin of an outline or of a second hit, f32 may decide either way.
const MARGIN: f64 = 2e-6;

/// Estimates with the errors of one of [`ADVERSARIES`].
fn adversary(error: f64, signs: [f64; 2]) -> impl FnMut(f32) -> f32 {
    let mut turns = signs.into_iter().cycle();
    move |x| ((1.0 + error * turns.next().expect("they come again")) / f64::from(x).sqrt()) as f32
}

/// SPHERE_LIT in f32 with the estimates that `rsqrt` returns. In an edge packet p is at least
/// `least`.
fn lit_by_estimates(
    fused: bool,
    sphere: &LitSphere<f32>,
    row: &LitRow<f32>,
    (j, edge): (f32, bool),
    mut rsqrt: impl FnMut(f32) -> f32,
) -> [f32; 3] {
    let fma = |a: f32, b: f32, c: f32| if fused { a.mul_add(b, c) } else { c + a * b };
    let u = j - row.m;
    let p = fma(-u, u, row.a);
    let over_root = rsqrt(if edge { p.max(sphere.least) } else { p });
    let den = fma(fma(sphere.h1, j, row.h0), over_root, 1.0);
    let n = fma(fma(sphere.q1, j, row.q0), over_root, sphere.kn);
    let e = fma(den, sphere.ke, -n) * den;
    let light = (n * rsqrt(e)).max(0.0);
    [sphere.red, sphere.green, sphere.blue].map(|weight| light * weight)
}

/// The result of the comparison.
#[derive(Default)]
struct Found {
    /// The largest error in levels.
    worst: f64,
    pixels: usize,
    off_by_1: usize,
}

impl Found {
    fn check(&mut self, (scene, name): (&Scene, &str), expected: &[TruePixel], fused: bool, error: f64) {
        let Some(form) = LitForm::of::<f32>(scene, Keep::NOTHING) else { return };
        let sphere = form.sphere(Scale::Levels).round();
        // The allowed error, in proportion to that of rsqrtps.
        let most = ESTIMATES * error / ERROR + ROUNDING;
        let mut rows = LitRows::ZERO;
        for row in 0..scene.camera.height() {
            rayo::internals::kernels::portable().single.lit_rows.call(form.setup(Scale::Levels), row, 1, &mut rows);
            let record = rows.row(0);
            for col in record.start as u32..record.end as u32 {
                let TruePixel { hit, margin } = &expected[(row * scene.camera.width() + col) as usize];
                let hit = hit.as_ref().filter(|hit| *margin > MARGIN && !hit.dazzled);
                let Some(truth) = hit.and_then(|hit| hit.colour) else { continue };
                self.pixels += 1;
                let j = col as f32 - record.start + record.j;
                let edge = j == record.j || j == record.stop - 1.0;
                let mut off = false;
                for signs in ADVERSARIES {
                    let estimates = adversary(error, signs);
                    let colour = lit_by_estimates(fused, &sphere, &record, (j, edge), estimates);
                    for (found, truth) in colour.into_iter().zip(truth.to_array()) {
                        let found = f64::from(found).clamp(0.0, 255.0);
                        let apart = (found - 255.0 * truth.clamp(0.0, 1.0)).abs();
                        let levels = (found as u8).abs_diff(level(truth));
                        let what = || {
                            format!(
                                "{name}, row {row}, column {col}, fused: {fused}, estimates off by {signs:?} of {error}: {found} \
                                and not {}",
                                255.0 * truth
                            )
                        };
                        assert!(apart <= most && levels <= 1, "{}", what());
                        self.worst = self.worst.max(apart);
                        off |= levels == 1;
                    }
                }
                self.off_by_1 += usize::from(off);
            }
        }
    }
}

/// A far sphere under a light directly in front of it, 1.66 radii from its centre: just far enough
/// away that bytes are shaded by the short form, which is the case in which estimates matter most.
fn just_short() -> Scene {
    let sphere =
        Sphere { centre: glam::Vec3::new(0.0, 0.0, 100.0), radius: 1.0, colour: glam::Vec3::new(0.95, 0.9, 0.5) };
    let light = Light { intensity: 1.0, colour: glam::Vec3::ONE, position: glam::Vec3::new(0.0, 0.0, 100.0 - 1.66) };
    let mut scene = rayo::internals::scene::many(0, 0, 1);
    scene.camera = Camera::new(31, 31, 1.0, 0.03).unwrap();
    (scene.spheres, scene.lights) = (vec![sphere], vec![light]);
    scene
}

#[test]
fn estimates_of_any_cpu_stay_within_documented_levels() {
    let mut scenes = vec![(just_short(), "a light in front of a sphere".to_owned())];
    for family in FAMILIES {
        let variants = family.variants.len();
        let cases = (0..family.levels.len()).map(|level| family.case(level * variants + level % variants, 5, 12));
        let small = cases.filter(|case| case.valid && case.scene.camera.pixels() <= 2000);
        scenes.extend(small.map(|case| (case.scene, format!("{} case {}", case.family, case.index))));
    }
    let many = many(20, 0, 5);
    scenes.extend(many.spheres.iter().enumerate().map(|(i, sphere)| {
        let camera = Camera::new(48, 36, 1.0, 1.0).unwrap();
        let scene = Scene { camera, spheres: vec![*sphere], lights: many.lights[..1].to_vec(), ..many.clone() };
        (scene, format!("sphere {i}"))
    }));
    let expected: Vec<_> = scenes.iter().map(|(scene, _)| expect(scene)).collect();
    for (error, fused) in [(ERROR, &[false, true][..]), (ERROR_14, &[true][..])] {
        let mut found = Found::default();
        for ((scene, name), expected) in scenes.iter().zip(&expected) {
            for fused in fused {
                found.check((scene, name), expected, *fused, error);
            }
        }
        let Found { worst, pixels, off_by_1 } = found;
        println!("estimates off by {error:.2e}: {worst} levels at most, of {pixels} pixels, {off_by_1} off by one");
        // The errors nearly reach the documented bound.
        assert!(off_by_1 > 10 && pixels > 1000, "{off_by_1} of {pixels}");
        assert!(worst > 0.75 * ESTIMATES * error / ERROR, "{worst}");
    }
}
