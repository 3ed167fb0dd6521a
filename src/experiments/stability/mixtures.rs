//! Random mixtures of what is hard: every engine, output and way to render, held against the truth pixel by pixel.
//!
//! What is promised, and so what a failure is:
//! - Outside of the margin of the engine's precision no hit where there is none, none where there is one, and no other
//!   object than the nearest; the first in order of those that tie exactly.
//! - Of bytes, no level off by two in `single` and `fast`, none by one in `double`. There the truth may lie at a level's edge:
//!   what is within `EDGE` of it is either level.
//! - Floats within 1e-4 (`single`), 1e-3 (`fast`) or 1.5e-7 (`double`) of 1 or of what all lights together could add, whichever
//!   is more. Where lights are brighter than white, this is the promise for bytes too, light by light: the level of a sum
//!   whose cosines are off by that share of 1.
//!   A triangle whose plane is nearer to the camera than 1e-8 of the distance of its corners has no such promise: v . n of
//!   eq. 9 cancels in f64.
//! - Every float finite, the fourth of a pixel 0, its fourth byte 255. What is brighter than f32 holds is the brightest that
//!   it does.
//! - `--keep-all`, and rows in any split, write the same bytes.

use std::ops::RangeInclusive;
use std::panic::{AssertUnwindSafe, catch_unwind};

use glam::DVec3;
use serde::Serialize;

use crate::experiments::PictureError;
use crate::experiments::accuracy::Contender;
use crate::experiments::accuracy::errors::margin_of;
use crate::measure::Machine;
use crate::plan::{Keep, on_all_cores};
use crate::render::{
    Colour, Distance, Film, Found, PixelFormat, Plan, Precision, Purpose, Tracer, TrueHit, TruePixel, Truth, level,
};
use crate::scene::families::{Mixture, mixture};
use crate::scene::{Object, Scene};

/// The formats that a tracer is got ready for together.
const OUTPUTS: [[PixelFormat; 2]; 2] =
    [[PixelFormat::F32x4, PixelFormat::F32x3], [PixelFormat::Rgba8, PixelFormat::Rgb8]];

/// How far a cosine in f64 may be off where that decides between two levels: several times what the documented bound of t
/// does to the normal next to a limb.
const EDGE: f64 = 1e-9;

/// What one engine made of a mixture that it should not have. The field names are those of the JSON document.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Failure {
    /// Who.
    pub engine: &'static str,
    /// In what numbers.
    pub precision: &'static str,
    /// What a pixel is written as; None where the hits are wrong.
    pub output: Option<&'static str>,
    /// What is wrong.
    pub what: &'static str,
    /// At how many pixels.
    pub pixels: usize,
    /// The first of them: its column and row.
    pub pixel: [u32; 2],
    /// What is true there.
    pub expected: String,
    /// What was found there.
    pub found: String,
}

/// A mixture that some engine fails on.
#[derive(Clone, Debug, Serialize)]
pub struct Failing {
    /// Where its random numbers begin.
    pub seed: u64,
    /// What is in it.
    pub kinds: Vec<&'static str>,
    /// How many spheres, triangles and lights.
    pub counts: [usize; 3],
    /// Who fails, and how.
    pub failures: Vec<Failure>,
}

/// What was found.
#[derive(Clone, Debug, Serialize)]
pub struct Mixtures {
    /// The machine and the build.
    pub machine: Machine,
    /// The seed of the first mixture.
    pub seed: u64,
    /// How many were judged.
    pub mixtures: usize,
    /// Whether these are all that were asked for.
    pub complete: bool,
    /// Those that some engine fails on.
    pub failing: Vec<Failing>,
}

/// Judges `count` mixtures of the seeds from `seed` on; all threads work. `proceed` is asked before each.
///
/// # Errors
/// An engine that cannot be prepared, or no memory.
pub fn judge_mixtures(
    contenders: &[Contender],
    seed: u64,
    count: usize,
    proceed: &(dyn Fn() -> bool + Sync),
) -> Result<Mixtures, PictureError> {
    let judged = on_all_cores(count, |i| {
        if !proceed() {
            return Ok(None);
        }
        let seed = seed.wrapping_add(i as u64);
        let Mixture { scene, kinds } = mixture(seed);
        let counts = [scene.spheres.len(), scene.triangles.len(), scene.lights.len()];
        Ok(Some(Failing { seed, kinds, counts, failures: failures(&scene, contenders)? }))
    });
    let judged: Vec<Failing> = judged.into_iter().filter_map(Result::transpose).collect::<Result<_, PictureError>>()?;
    Ok(Mixtures {
        machine: Machine::this(),
        seed,
        mixtures: judged.len(),
        complete: judged.len() == count,
        failing: judged.into_iter().filter(|mixture| !mixture.failures.is_empty()).collect(),
    })
}

/// The smallest part of a scene that still fails, as far as leaving out objects and lights finds one.
pub fn minimised(scene: &Scene, fails: &dyn Fn(&Scene) -> bool) -> Scene {
    let mut scene = scene.clone();
    // Half of a list, then smaller parts, down to single ones.
    let fewer = |scene: &mut Scene, list: usize| {
        let length = [scene.lights.len(), scene.spheres.len(), scene.triangles.len()][list];
        let mut size = length.next_power_of_two();
        let mut left = length;
        while size > 0 {
            let mut start = 0;
            while start < left {
                let mut next = scene.clone();
                let part = start..left.min(start + size);
                let count = part.len();
                match list {
                    0 => drop(next.lights.drain(part)),
                    1 => drop(next.spheres.drain(part)),
                    _ => drop(next.triangles.drain(part)),
                }
                if fails(&next) {
                    *scene = next;
                    left -= count;
                } else {
                    start += size;
                }
            }
            size /= 2;
        }
    };
    for list in [1, 2, 0] {
        fewer(&mut scene, list);
    }
    scene
}

/// What is wrong with the pictures of a scene by each of `contenders`.
///
/// # Errors
/// An engine that cannot be prepared, or no memory.
pub fn failures(scene: &Scene, contenders: &[Contender]) -> Result<Vec<Failure>, PictureError> {
    let camera = scene.camera;
    let truth = Truth::new(scene);
    let pixels = (0..camera.height()).flat_map(|row| (0..camera.width()).map(move |col| (row, col)));
    let judge = Judge { scene, truth: pixels.map(|(row, col)| truth.pixel(row, col)).collect() };
    let mut failures = Vec::new();
    for contender in contenders {
        match catch_unwind(AssertUnwindSafe(|| judge.contender(*contender))) {
            Ok(found) => failures.extend(found?),
            Err(_) => failures.push(Failure {
                engine: contender.engine.name(),
                precision: contender.precision.name(),
                output: None,
                what: "a panic",
                pixels: 0,
                pixel: [0; 2],
                expected: String::new(),
                found: String::new(),
            }),
        }
    }
    Ok(failures)
}

/// A scene and what is true of its picture.
struct Judge<'a> {
    scene: &'a Scene,
    truth: Vec<TruePixel>,
}

/// What one colour may be.
struct Allowed {
    /// A float of each channel.
    floats: [RangeInclusive<f64>; 3],
    /// A level of each channel.
    levels: [RangeInclusive<u8>; 3],
}

impl Judge<'_> {
    fn contender(&self, contender: Contender) -> Result<Vec<Failure>, PictureError> {
        let Contender { engine, precision, .. } = contender;
        let height = self.scene.camera.height();
        let prepare = |format, keep| {
            let purpose = Purpose { precision: Some(precision), format: Some(format), keep, ..Purpose::default() };
            Plan::new(engine, self.scene, purpose).map(Plan::into_tracer)
        };
        let allowed: Vec<_> = self.truth.iter().map(|pixel| self.allowed(pixel, precision)).collect();
        let mut failures = Vec::new();
        for (i, formats) in OUTPUTS.into_iter().enumerate() {
            let planned = prepare(formats[0], Keep::NOTHING)?;
            let brute = prepare(formats[0], Keep::all())?;
            if i == 0 {
                let found = planned.hits(0..height);
                let wrong = self.wrong_hits(&found, precision);
                failures.extend(self.failure(contender, None, "a wrong hit", wrong));
            }
            for format in formats.into_iter().filter(|format| planned.writes(*format)) {
                let film = |tracer: &dyn Tracer, bands: bool| -> Result<Film, PictureError> {
                    let mut film = Film::new(format, self.truth.len())?;
                    let width = self.scene.camera.width() as usize;
                    // Odd bands, the last first.
                    let rows: Vec<u32> = if bands { (0..height).step_by(5).collect() } else { vec![0] };
                    for start in rows.into_iter().rev() {
                        let end = if bands { height.min(start + 5) } else { height };
                        let pixels = start as usize * width..end as usize * width;
                        tracer.rows(start..end, film.as_mut().part(pixels));
                    }
                    Ok(film)
                };
                let whole = film(planned.as_ref(), false)?;
                let wrong = (0..self.truth.len()).filter_map(|at| {
                    let (found, fourth) = (whole.colour(at), fourth_is_right(&whole, at));
                    let right = fourth && allowed[at].has(found);
                    (!right).then(|| (at, allowed[at].text(format.is_8bit()), format!("{found:?}")))
                });
                failures.extend(self.failure(contender, Some(format), "a wrong colour", wrong.collect()));
                for (what, other) in [
                    ("other pixels by bands of rows", film(planned.as_ref(), true)?),
                    ("other pixels with --keep-all", film(brute.as_ref(), false)?),
                ] {
                    let pairs = (0..self.truth.len()).map(|at| (at, whole.colour(at), other.colour(at)));
                    let differ = pairs.filter(|(_, a, b)| bits(*a) != bits(*b));
                    let wrong = differ.map(|(at, a, b)| (at, format!("{a:?}"), format!("{b:?}")));
                    failures.extend(self.failure(contender, Some(format), what, wrong.collect()));
                }
            }
        }
        Ok(failures)
    }

    /// One failure of the pixels that are wrong, each with what was expected and found.
    fn failure(
        &self,
        contender: Contender,
        output: Option<PixelFormat>,
        what: &'static str,
        wrong: Vec<(usize, String, String)>,
    ) -> Option<Failure> {
        let pixels = wrong.len();
        let (at, expected, found) = wrong.into_iter().next()?;
        let width = self.scene.camera.width() as usize;
        Some(Failure {
            engine: contender.engine.name(),
            precision: contender.precision.name(),
            output: output.map(PixelFormat::name),
            what,
            pixels,
            pixel: [at % width, at / width].map(|i| i as u32),
            expected,
            found,
        })
    }

    fn wrong_hits(&self, found: &[Option<Found>], precision: Precision) -> Vec<(usize, String, String)> {
        let pixels = self.truth.iter().zip(found).enumerate();
        let wrong = pixels.filter_map(|(at, (truth, found))| {
            let expected = truth.hit.as_ref().map(|hit| hit.object);
            let t = found.map(|found| match found.distance {
                Distance::T(t) => t,
                Distance::Inverse(inverse) => 1.0 / inverse,
            });
            let distance = t.is_none_or(|t| t > 0.0 && t.is_finite());
            let right = found.map(|found| found.object) == expected && distance;
            let judged = truth.margin >= margin_of(precision);
            let hit = truth.hit.as_ref().map(|hit| (hit.object, hit.t.high));
            let text = || (at, format!("{hit:?}, margin {:.1e}", truth.margin), format!("{found:?}"));
            (judged && !right).then(text)
        });
        wrong.collect()
    }

    /// What a pixel may show.
    fn allowed(&self, pixel: &TruePixel, precision: Precision) -> Allowed {
        if pixel.margin < margin_of(precision) {
            return Allowed::ANY;
        }
        let Some(hit) = &pixel.hit else { return Allowed::BLACK };
        let (floats, coarse) = match precision {
            Precision::Single => (1e-4, 1e-4),
            Precision::Fast => (1e-3, 1e-3),
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

    /// The light that an object reflects where its cosines are `of` the true ones.
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
    /// Whatever is a number.
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

    fn text(&self, bytes: bool) -> String {
        if bytes { format!("{:?}", self.levels) } else { format!("{:?}", self.floats) }
    }
}

/// The fourth float is 0, and the fourth byte 255.
fn fourth_is_right(film: &Film, at: usize) -> bool {
    match film {
        Film::F32x4(pixels) => pixels[at].lanes()[3] == 0.0,
        Film::Rgba8(pixels) => pixels[at][3] == 255,
        Film::F32x3(_) | Film::Rgb8(_) => true,
    }
}

fn bits(colour: Colour) -> [u32; 3] {
    match colour {
        Colour::Linear(linear) => linear.map(f32::to_bits),
        Colour::Levels(levels) => levels.map(u32::from),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::Engine;
    use crate::scene::{Light, many};

    #[test]
    fn what_does_not_matter_is_left_out() {
        let scene = many(40, 25, 3);
        let (sphere, triangle) = (scene.spheres[17], scene.triangles[24]);
        let fails = |scene: &Scene| scene.spheres.contains(&sphere) && scene.triangles.contains(&triangle);
        let left = minimised(&scene, &fails);
        assert_eq!((left.spheres, left.triangles, left.lights.len()), (vec![sphere], vec![triangle], 0));
    }

    /// What a pixel may show that is lit with `cosine` by a light of that intensity.
    fn allowed(cosine: f64, intensity: f32, precision: Precision) -> Allowed {
        let mut scene = many(1, 0, 1);
        scene.spheres[0].colour = glam::Vec3::ONE;
        scene.lights.truncate(1);
        scene.lights[0] = Light { intensity, colour: glam::Vec3::ONE, ..scene.lights[0] };
        let zero = crate::reference::exact::Split { high: 0.0, low: 0.0 };
        let colour = Some(DVec3::splat(cosine.max(0.0) * f64::from(intensity)));
        let hit = TrueHit {
            object: Object::Sphere(0),
            t: zero,
            normal: [zero; 3],
            cosines: vec![cosine],
            dazzled: false,
            colour,
            bound: 1.0,
            lever: 1.0,
        };
        let judge = Judge { scene: &scene, truth: Vec::new() };
        judge.allowed(&TruePixel { hit: Some(hit), margin: 1.0 }, precision)
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
    fn a_truth_at_the_edge_of_a_level_is_either_and_a_bright_light_behind_the_surface_adds_nothing() {
        let edge = allowed(100.0 / 255.0, 1.0, Precision::Double);
        assert!([99, 100].into_iter().all(|level| edge.has(Colour::Levels([level; 3]))));
        assert!([98, 101].into_iter().all(|level| !edge.has(Colour::Levels([level; 3]))));
        // In f32 a cosine of 1e-7 is as good as 0; one of -1/2 is not.
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
        let engine = Engine::Rust;
        let rust = [Contender { engine, precision: engine.precision(), keep_all: false }];
        let found = judge_mixtures(&rust, 1, 30, &|| true).unwrap();
        assert!(found.complete && found.mixtures == 30);
        assert!(found.failing.len() > 3, "{}", found.failing.len());
    }
}
