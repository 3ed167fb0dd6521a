//! Compares every output and way of rendering a random mixture with the exact result, pixel by
//! pixel.
//!
//! A failure is a violation of one of these promises:
//! - Outside of the margin of the engine's precision no hit where there is none, none where there
//!   is one, and no other object than the nearest; the first in order of those that tie exactly.
//! - Outside of the margin of f64, in which points are found, no light that is hidden, and none
//!   hidden that is not.
//! - Of bytes, no level off by two in `single` and `fast`, none by one in `double`. There the truth
//!   may lie at a level's edge: what is within `EDGE` of it is either level.
//! - Floats within 1e-4 (`single`), 2^-10 (`fast`; of `avx512` 2^-12) or 1.5e-7 (`double`) of 1 or
//!   of what all lights together could add, whichever is more. Where lights are brighter than
//!   white, this is the promise for bytes too, light by light: the level of a sum whose cosines are
//!   off by that share of 1. A triangle whose plane is nearer to the camera than 1e-8 of the
//!   distance of its corners has no such promise: v . n of eq. 9 cancels in f64.
//! - Every float finite, the fourth of a pixel 0, its fourth byte 255. What is brighter than f32
//!   holds is the brightest that it does.
//! - `--keep-all`, and rows in any split, write the same bytes.

use std::ops::RangeInclusive;

use crate::mixtures;
use glam::DVec3;
use proptest::prelude::*;
use proptest::test_runner::{TestCaseError, TestError};
use rayo::internals::plan::{Keep, on_all_cores};
use rayo::internals::render::{Colour, Distance, Film, Found, PixelFormat, Plan, Precision, Purpose, Tracer, level};
use rayo::internals::scene::{Light, Object, Scene, many};
use rayo_lab::experiments::accuracy::errors::margin_of;
use rayo_lab::experiments::accuracy::{Contender, contenders};
use rayo_lab::truth::{TrueHit, TruePixel, Truth};

/// The pixel formats, grouped by the tracer that serves them.
const OUTPUTS: [[PixelFormat; 2]; 2] =
    [[PixelFormat::F32x4, PixelFormat::F32x3], [PixelFormat::Rgba8, PixelFormat::Rgb8]];

/// By how much a cosine in f64 may be off near the boundary between two levels: several times what
/// the documented bound of t causes for a normal near the limb.
const EDGE: f64 = 1e-9;

/// By how much two estimates with the accuracy of `rsqrtps` may change a cosine.
const ESTIMATES: f64 = 1.0 / 1024.0;

/// A scene and the exact result for its picture.
struct Judge<'a> {
    scene: &'a Scene,
    truth: Vec<TruePixel>,
}

/// The allowed values of a colour: an interval of floats and an interval of levels for each
/// channel.
#[derive(Debug)]
struct Allowed {
    floats: [RangeInclusive<f64>; 3],
    levels: [RangeInclusive<u8>; 3],
}

/// Descriptions of what is wrong with a scene's pictures by these contenders.
fn failures(scene: &Scene, contenders: &[Contender]) -> Vec<String> {
    let truth = Truth::new(scene);
    let width = scene.camera.width() as usize;
    let pixel = |at: usize| truth.pixel((at / width) as u32, (at % width) as u32);
    let judge = Judge { scene, truth: on_all_cores(scene.camera.pixels() as usize, pixel) };
    contenders.iter().flat_map(|contender| judge.contender(*contender)).collect()
}

impl Judge<'_> {
    fn contender(&self, contender: Contender) -> Vec<String> {
        let Contender { engine, precision, .. } = contender;
        let (width, height) = (self.scene.camera.width() as usize, self.scene.camera.height());
        let prepare = |format, keep| {
            let purpose = Purpose { precision: Some(precision), format: Some(format), keep, ..Purpose::default() };
            Plan::new(engine, self.scene, purpose).unwrap().into_tracer()
        };
        // By how much an estimate may change a cosine; see SPHERE_LIT.
        let estimates = if engine.name() == "avx512" { 1.0 / 4096.0 } else { ESTIMATES };
        let allowed: Vec<_> = self.truth.iter().map(|pixel| self.allowed(pixel, precision, estimates)).collect();
        let mut failures = Vec::new();
        // Of wrong pixels only the number is reported, and the first one with its expected and
        // found values.
        let mut fail = |what: &str, wrong: &mut dyn Iterator<Item = (usize, String)>| {
            if let Some((at, why)) = wrong.next() {
                let (row, col, pixels) = (at / width, at % width, 1 + wrong.count());
                failures
                    .push(format!("{what} by {engine} in {precision}: {pixels} pixels, row {row} column {col} {why}"));
            }
        };
        fail("a wrong hit", &mut self.wrong_hits(&prepare(OUTPUTS[0][0], Keep::NOTHING).hits(0..height), precision));
        for formats in OUTPUTS {
            let (planned, brute) = (prepare(formats[0], Keep::NOTHING), prepare(formats[0], Keep::all()));
            for format in formats.into_iter().filter(|format| planned.writes(*format)) {
                // The film traced in bands of this many rows, from the last band to the first.
                let film = |tracer: &dyn Tracer, band: u32| {
                    let mut film = Film::new(format, self.truth.len()).unwrap();
                    for start in (0..height).step_by(band as usize).rev() {
                        let end = height.min(start + band);
                        let pixels = start as usize * width..end as usize * width;
                        tracer.rows(start..end, film.as_mut().part(pixels));
                    }
                    film
                };
                let whole = film(planned.as_ref(), height);
                let wrong = (0..self.truth.len())
                    .filter(|at| !(allowed[*at].has(whole.colour(*at)) && fourth_is_right(&whole, *at)));
                fail(
                    &format!("a wrong colour as {}", format.name()),
                    &mut wrong.map(|at| (at, format!("{:?} for {:?}", whole.colour(at), allowed[at]))),
                );
                for (how, other) in
                    [("by bands of rows", film(planned.as_ref(), 5)), ("with --keep-all", film(brute.as_ref(), height))]
                {
                    let pairs = (0..self.truth.len()).map(|at| (at, whole.colour(at), other.colour(at)));
                    let differ = pairs.filter(|(_, a, b)| bits(*a) != bits(*b));
                    let mut wrong = differ.map(|(at, a, b)| (at, format!("{b:?} for {a:?}")));
                    fail(&format!("other pixels {how} as {}", format.name()), &mut wrong);
                }
            }
        }
        failures
    }

    fn wrong_hits(&self, found: &[Option<Found>], precision: Precision) -> impl Iterator<Item = (usize, String)> {
        let pixels = self.truth.iter().zip(found).enumerate();
        pixels.filter_map(move |(at, (truth, found))| {
            let expected = truth.hit.as_ref().map(|hit| hit.object);
            let t = found.map(|found| match found.distance {
                Distance::T(t) => t,
                Distance::Inverse(inverse) => 1.0 / inverse,
            });
            let distance = t.is_none_or(|t| t > 0.0 && t.is_finite());
            let right = found.map(|found| found.object) == expected && distance;
            let judged = truth.margin >= margin_of(precision);
            (judged && !right).then(|| (at, format!("{found:?} for {truth:?}")))
        })
    }

    /// The allowed colours of a pixel.
    fn allowed(&self, pixel: &TruePixel, precision: Precision, estimates: f64) -> Allowed {
        if pixel.margin < margin_of(precision) {
            return Allowed::ANY;
        }
        let Some(hit) = &pixel.hit else { return Allowed::BLACK };
        if hit.shadow < margin_of(Precision::Double) {
            return Allowed::ANY;
        }
        let (floats, coarse) = match precision {
            Precision::Single => (1e-4, 1e-4),
            Precision::Fast => (estimates, estimates),
            Precision::Double => (1.5e-7, EDGE),
        };
        let most = self.sum(hit, &|_| 1.0);
        let off = floats * most.max(DVec3::ONE);
        if hit.colour.is_none() {
            return Allowed { floats: per_channel(|i| 0.0..=most[i] + off[i]), levels: per_channel(|_| 0..=255) };
        }
        let light = self.sum(hit, &|cosine| cosine);
        let (dim, bright) = (self.sum(hit, &|cosine| cosine - coarse), self.sum(hit, &|cosine| cosine + coarse));
        let steps = if precision == Precision::Double { 0 } else { 1 };
        Allowed {
            floats: per_channel(|i| light[i].min(f32::MAX.into()) - off[i]..=light[i] + off[i]),
            levels: per_channel(|i| {
                let level_of_truth = level(light[i]);
                let (least, most) = (level_of_truth.saturating_sub(steps), level_of_truth.saturating_add(steps));
                least.min(level(dim[i]))..=most.max(level(bright[i]))
            }),
        }
    }

    /// The light that an object reflects if its cosines are changed by `of`.
    fn sum(&self, hit: &TrueHit, of: &dyn Fn(f64) -> f64) -> DVec3 {
        let colour = match hit.object {
            Object::Sphere(i) => self.scene.spheres[i].colour,
            Object::Triangle(i) => self.scene.triangles[i].colour,
        };
        let lights = self
            .scene
            .lights
            .iter()
            .zip(&hit.cosines)
            .map(|(light, cosine)| of(*cosine).max(0.0) * light.radiance() * colour.as_dvec3());
        lights.sum()
    }
}

fn per_channel<T>(of: impl Fn(usize) -> T) -> [T; 3] {
    [0, 1, 2].map(of)
}

impl Allowed {
    /// Any number is allowed.
    const ANY: Allowed = Allowed { floats: [const { 0.0..=f64::INFINITY }; 3], levels: [const { 0..=255 }; 3] };
    const BLACK: Allowed = Allowed { floats: [const { 0.0..=0.0 }; 3], levels: [const { 0..=0 }; 3] };

    fn has(&self, colour: Colour) -> bool {
        match colour {
            Colour::Linear(linear) => {
                let in_range =
                    |(v, range): (&f32, &RangeInclusive<f64>)| v.is_finite() && range.contains(&f64::from(*v));
                linear.iter().zip(&self.floats).all(in_range)
            }
            Colour::Levels(levels) => levels.iter().zip(&self.levels).all(|(v, range)| range.contains(v)),
        }
    }
}

/// Whether the fourth float is 0, or the fourth byte 255.
fn fourth_is_right(film: &Film, at: usize) -> bool {
    match film {
        Film::F32x4(pixels) => pixels[at].lanes()[3] == 0.0,
        Film::Rgba8(pixels) => pixels[at][3] == 255,
        Film::Bgra8(pixels) => pixels[at] >> 24 == 255,
        Film::F32x3(_) | Film::Rgb8(_) => true,
    }
}

fn bits(colour: Colour) -> [u32; 3] {
    match colour {
        Colour::Linear(linear) => linear.map(f32::to_bits),
        Colour::Levels(levels) => levels.map(u32::from),
    }
}

/// The allowed colours of a pixel that a light of this intensity shines on with this cosine.
fn allowed(cosine: f64, intensity: f32, precision: Precision) -> Allowed {
    let mut scene = many(1, 0, 1);
    scene.spheres[0].colour = glam::Vec3::ONE;
    scene.lights.truncate(1);
    scene.lights[0] = Light { intensity, colour: glam::Vec3::ONE, ..scene.lights[0] };
    let zero = rayo_lab::exact::number::Split { high: 0.0, low: 0.0 };
    let colour = Some(DVec3::splat(cosine.max(0.0) * f64::from(intensity)));
    let hit = TrueHit {
        object: Object::Sphere(0),
        t: zero,
        normal: [zero; 3],
        cosines: vec![cosine],
        shadow: f64::INFINITY,
        dazzled: false,
        colour,
        bound: 1.0,
        lever: 1.0,
    };
    let judge = Judge { scene: &scene, truth: Vec::new() };
    judge.allowed(&TruePixel { hit: Some(hit), margin: 1.0 }, precision, ESTIMATES)
}

#[test]
fn a_colour_is_wrong_from_what_is_promised_on() {
    let floats = |v: f32| Colour::Linear([v; 3]);
    let levels = |v: u8| Colour::Levels([v; 3]);
    let cosine = 100.5 / 255.0;
    let v = (cosine) as f32;
    for (precision, right, wrong, step) in [
        (Precision::Single, 0.9e-4, 1.1e-4, 1),
        (Precision::Fast, 0.9e-3, 1.1e-3, 1),
        (Precision::Double, 1e-7, 2.5e-7, 0),
    ] {
        let allowed = allowed(cosine, 1.0, precision);
        assert!(allowed.has(floats(v + right)) && allowed.has(floats(v - right)), "{precision}");
        assert!(!allowed.has(floats(v + wrong)) && !allowed.has(floats(v - wrong)), "{precision}");
        assert!(allowed.has(levels(100 + step)) && allowed.has(levels(100 - step)), "{precision}");
        assert!(!allowed.has(levels(101 + step)) && !allowed.has(levels(99 - step)), "{precision}");
        assert!(!allowed.has(floats(f32::NAN)) && !allowed.has(floats(f32::INFINITY)), "{precision}");
    }
}

#[test]
fn truth_at_the_edge_of_a_level_is_either_level() {
    let edge = allowed(100.0 / 255.0, 1.0, Precision::Double);
    assert!([99, 100].into_iter().all(|level| edge.has(Colour::Levels([level; 3]))));
    assert!([98, 101].into_iter().all(|level| !edge.has(Colour::Levels([level; 3]))));
    // In f32 a cosine of 1e-7 cannot be told from 0, but -1/2 can.
    for (cosine, white) in [(1e-7, true), (0.5, true), (-0.5, false)] {
        let bright = allowed(cosine, 1e30, Precision::Single);
        assert_eq!(bright.has(Colour::Levels([255; 3])), white, "{cosine}");
        assert_eq!(bright.has(Colour::Levels([0; 3])), cosine < 0.1, "{cosine}");
    }
}

#[test]
fn light_beyond_f32_is_as_bright_as_that_can_be() {
    for (cosine, right) in [(1.0, 3e38), (0.5, 1.5e38)] {
        let bright = allowed(cosine, 3e38, Precision::Double);
        for v in [3e38, 1.5e38, f32::MAX, f32::INFINITY] {
            assert_eq!(bright.has(Colour::Linear([v; 3])), v == right, "{cosine}, {v}");
        }
    }
}

#[test]
fn what_f32_loses_without_care_is_found() {
    let rust: Vec<_> = contenders().into_iter().filter(|contender| contender.engine.name() == "rust").collect();
    let failing = mixtures::scenes(30).filter(|scene| !failures(scene, &rust).is_empty()).count();
    assert!(failing > 3, "{failing}");
}

#[test]
fn no_packet_engine_fails_on_a_random_mixture_of_all_families() {
    let packets: Vec<_> = contenders().into_iter().filter(|contender| contender.engine.is_packet()).collect();
    let scenes = (mixtures::mixture(), any::<bool>()).prop_map(|(scene, shadows)| Scene { shadows, ..scene });
    let run = mixtures::runner().run(&scenes, |scene| {
        let failures = failures(&scene, &packets);
        if failures.is_empty() { Ok(()) } else { Err(TestCaseError::fail(failures.join("\n"))) }
    });
    match run {
        Ok(()) => {}
        Err(TestError::Fail(reason, scene)) => panic!("{reason}\n{}", scene.to_toml()),
        Err(error) => panic!("{error}"),
    }
}
