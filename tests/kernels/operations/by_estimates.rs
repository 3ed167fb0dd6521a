//! The shade by the worst estimates of roots that any CPU may give: the twins of the kernels, fed with them.

use rayo::experiments::accuracy::{ESTIMATES, errors::Expected, expect};
use rayo::kernels::{InsideSpan, LitRow, NearSpan, OutsideSpan, TriangleSpan};
use rayo::plan::{Keep, Scale, ShortForm, Spans, UseRecord};
use rayo::reference::packet::{self, Estimated, Rounding};
use rayo::render::level;
use rayo::scene::families::FAMILIES;
use rayo::scene::{Camera, Light, Scene, Sphere};

use super::{Record, twin_of_lit, twin_of_lits};

/// The documented error of `rsqrtps`, of what it should be.
const ERROR: f64 = 1.5 / 4096.0;
/// The same of `vrsqrt14ps`.
const ERROR_14: f64 = 1.0 / 16384.0;
/// By how many errors the first and the second estimate of a pixel are off, those of further lights by turns: too large
/// and too small, together and against each other, and neither.
const ADVERSARIES: [[f64; 2]; 9] =
    [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0], [0.0, 0.0]];
/// What f32 adds to the estimates' own error, in levels.
const ROUNDING: f64 = 0.02;
/// Within this of an edge, or of a second hit, f32 may answer either way.
const MARGIN: f64 = 2e-6;

/// Estimates that are off as one of [`ADVERSARIES`] wants.
fn adversary(error: f64, signs: [f64; 2]) -> impl FnMut(f32) -> f32 {
    let mut turns = signs.into_iter().cycle();
    move |x| ((1.0 + error * turns.next().expect("they come again")) / f64::from(x).sqrt()) as f32
}

/// The colours of a span in levels, by each adversary.
type Colours = Vec<[[f32; 3]; ADVERSARIES.len()]>;

/// Shades a span by the twins.
struct Shaded<'a> {
    rounding: Rounding,
    error: f64,
    lights: &'a [packet::Light<f32>],
    pixels: usize,
}

impl Shaded<'_> {
    fn by(&self, first: f32, colour: impl Fn(f32, usize) -> [f32; 3]) -> Colours {
        (0..self.pixels).map(|i| std::array::from_fn(|adversary| colour(i as f32 + first, adversary))).collect()
    }

    fn span<S: Record<f32>>(&self, span: &S) -> Colours {
        self.by(span.first(), |j, i| {
            span.colour(self.rounding, self.lights, j, Estimated(adversary(self.error, ADVERSARIES[i])))
        })
    }
}

impl UseRecord<f32> for Shaded<'_> {
    /// And whether it is the short form.
    type Result = (Colours, bool);

    fn lit(self, form: &ShortForm, row: &LitRow<f32>) -> Self::Result {
        let sphere = form.sphere(Scale::Levels).round();
        let twin = twin_of_lit(&sphere, row);
        let edge = |j: f32| j == row.j || j == row.stop - 1.0;
        let colours = self.by(row.j, |j, i| {
            let estimates = adversary(self.error, ADVERSARIES[i]);
            self.rounding.lit_by_estimates((&twin, sphere.least), j, edge(j), estimates)
        });
        (colours, true)
    }
    fn outside(self, span: &OutsideSpan<f32>) -> Self::Result {
        (self.span(span), false)
    }
    fn near(self, span: &NearSpan<f32>) -> Self::Result {
        (self.span(span), false)
    }
    fn inside(self, span: &InsideSpan<f32>) -> Self::Result {
        (self.span(span), false)
    }
    fn triangle(self, span: &TriangleSpan<f32>) -> Self::Result {
        (self.span(span), false)
    }
}

/// What came of it.
#[derive(Default)]
struct Found {
    /// The largest error in levels, of the general forms and of the short one.
    worst: [f64; 2],
    pixels: [usize; 2],
    off_by_1: usize,
}

impl Found {
    fn check(&mut self, (scene, name): (&Scene, &str), expected: &[Expected], rounding: Rounding, error: f64) {
        let spans = Spans::<f32>::new(scene, Some(Scale::Levels), Keep::NOTHING);
        // An error of so much more or less than rsqrtps's.
        let most = ESTIMATES * error / ERROR + ROUNDING;
        for row in (0..scene.camera.height()).filter(|row| !spans.is_wide(*row)) {
            for object in spans.seen_in(&(row..row + 1)) {
                let Some(span) = spans.row(object, row) else { continue };
                let lights = twin_of_lits(spans.lits(object, Scale::Levels));
                let shaded = Shaded { rounding, error, lights: &lights, pixels: (span.end - span.start) as usize };
                let (colours, short) = spans.with_record(&span, row, 1.0, Some(Scale::Levels), shaded);
                for (col, colours) in (span.start..span.end).zip(colours) {
                    let Expected { hit, margin } = expected[(row * scene.camera.width() + col) as usize];
                    let Some(hit) = hit.filter(|hit| hit.object == spans.source(object) && margin > MARGIN) else {
                        continue;
                    };
                    let Some(truth) = hit.colour else { continue };
                    self.pixels[usize::from(short)] += 1;
                    for (colour, signs) in colours.into_iter().zip(ADVERSARIES) {
                        let mut off = false;
                        for (found, truth) in colour.into_iter().zip(truth.to_array()) {
                            let found = f64::from(found).clamp(0.0, 255.0);
                            let apart = (found - 255.0 * truth.clamp(0.0, 1.0)).abs();
                            let levels = (found as u8).abs_diff(level(truth));
                            let what = || {
                                format!(
                                    "{name}, row {row}, column {col}, {rounding:?}, short form: {short}, estimates off by \
                                    {signs:?} of {error}: {found} and not {}",
                                    255.0 * truth
                                )
                            };
                            assert!(apart <= most && levels <= 1, "{}", what());
                            let worst = &mut self.worst[usize::from(short)];
                            *worst = worst.max(apart);
                            off |= levels == 1;
                        }
                        self.off_by_1 += usize::from(off);
                    }
                }
            }
        }
    }
}

/// A far sphere under a light right in front of it, so near that its short form is only just one: where estimates do the most.
fn just_short() -> Scene {
    let sphere =
        Sphere { centre: glam::Vec3::new(0.0, 0.0, 100.0), radius: 1.0, colour: glam::Vec3::new(0.95, 0.9, 0.5) };
    let light = Light { intensity: 1.0, colour: glam::Vec3::ONE, position: glam::Vec3::new(0.0, 0.0, 100.0 - 1.66) };
    let mut scene = rayo::scene::many(0, 0, 1);
    scene.camera = Camera::new(31, 31, 1.0, 0.03).unwrap();
    (scene.spheres, scene.lights) = (vec![sphere], vec![light]);
    scene
}

#[test]
fn no_estimate_that_any_cpu_may_give_puts_a_pixel_off_by_two_levels_or_more_than_is_documented() {
    let mut scenes = vec![(just_short(), "a light in front of a sphere".to_owned())];
    for family in FAMILIES {
        let variants = family.variants.len();
        let cases = (0..family.levels.len()).map(|level| family.case(level * variants + level % variants, 5, 12));
        let small = cases.filter(|case| case.valid && case.scene.camera.pixels() <= 2000);
        scenes.extend(small.map(|case| (case.scene, format!("{} case {}", case.family, case.index))));
    }
    let expected: Vec<_> = scenes.iter().map(|(scene, _)| expect(scene)).collect();
    for (error, roundings) in [(ERROR, &[Rounding::Unfused, Rounding::Fused][..]), (ERROR_14, &[Rounding::Fused][..])] {
        let mut found = Found::default();
        for ((scene, name), expected) in scenes.iter().zip(&expected) {
            for rounding in roundings {
                found.check((scene, name), expected, *rounding, error);
            }
        }
        let Found { worst, pixels, off_by_1 } = found;
        println!("estimates off by {error:.2e}: {worst:?} levels at most, of {pixels:?} pixels, {off_by_1} off by one");
        // They are felt: in the general forms as one estimate a light, in the short one nearly as much as is documented.
        assert!(off_by_1 > 100 && pixels.into_iter().all(|pixels| pixels > 1000), "{off_by_1} of {pixels:?}");
        assert!(worst[0] > 240.0 * error && worst[0] < 255.0 * error + ROUNDING, "{worst:?}");
        assert!(worst[1] > 0.75 * ESTIMATES * error / ERROR, "{worst:?}");
    }
}
