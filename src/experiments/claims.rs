//! The paper's claims one by one: reproduced, not reproduced, or not testable here, with the figure that says so.

use std::fmt;

use serde::Serialize;

use super::jumps::Jumps;
use super::ladder::{self, Rung};
use super::speedup::{self, BASELINE, CONTROL, Films, PAPER, Progress, Row, Speedup, SpeedupError};
use crate::measure::statistics::{Line, fit_line, median, minimum};
use crate::measure::{Clock, Machine, Work, interleave};
use crate::render::{Engine, PixelFormat};
use crate::scene::{Camera, Light, Scene, many};

/// What became of a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Verdict {
    /// It holds here.
    #[serde(rename = "reproduced")]
    Reproduced,
    /// It does not hold here.
    #[serde(rename = "not reproduced")]
    NotReproduced,
    /// This machine, or this run, cannot tell.
    #[serde(rename = "not testable here")]
    NotTestable,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Verdict::Reproduced => "reproduced",
            Verdict::NotReproduced => "not reproduced",
            Verdict::NotTestable => "not testable here",
        })
    }
}

/// A claim of the paper and what became of it. The field names are those of the JSON document.
#[derive(Clone, Debug, Serialize)]
pub struct Claim {
    /// What the paper says.
    pub claim: &'static str,
    /// What became of it.
    pub verdict: Verdict,
    /// The figure that says so.
    pub figure: String,
}

/// What the cost of a picture depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// w h.
    Pixels,
    /// s + t.
    Objects,
    /// l.
    Lights,
}

/// The cost of an engine along an axis, and the straight line through it.
#[derive(Clone, Debug, Serialize)]
pub struct Sweep {
    /// What is varied.
    pub axis: Axis,
    /// Who traced.
    pub engine: &'static str,
    /// Count, and TSC cycles of the fastest picture.
    pub points: Vec<(f64, f64)>,
    /// The line; its slope is in cycles by the pixel, object or light.
    pub line: Line,
}

/// How many objects, half of them spheres and half triangles.
const OBJECTS: [usize; 6] = [2, 8, 16, 24, 32, 40];
/// How many lights over the experiment's sphere.
const LIGHTS: [usize; 6] = [1, 8, 16, 24, 32, 40];
/// The pictures of these sweeps: small, so that a run is short.
const SIZE: (u32, u32) = (128, 96);
const SEED: u64 = 5;
/// Work in a pixel of a round of both engines, by the object and by the light.
const OBJECT_WORK: u64 = 300;
const LIGHT_WORK: u64 = 60;
/// A line fits where its residual is less.
const STRAIGHT: f64 = 0.05;

fn runs(quick: bool) -> usize {
    if quick { 15 } else { 50 }
}

/// The work that [`sweeps`] does.
pub fn work(quick: bool) -> u64 {
    let sum = |counts: &[usize]| counts.iter().sum::<usize>() as u64;
    u64::from(SIZE.0)
        * u64::from(SIZE.1)
        * runs(quick) as u64
        * (sum(&OBJECTS) * OBJECT_WORK + sum(&LIGHTS) * LIGHT_WORK)
}

/// The experiment's scene under `count` lights of the same place and, together, the same strength.
fn lit(count: usize) -> Scene {
    let mut scene = speedup::scene();
    let light = scene.lights[0];
    scene.lights = vec![Light { intensity: light.intensity / count as f32, ..light }; count];
    scene
}

/// An axis, the counts along it, the work that a point should take, and the scene of a count.
type Sweeping<'a> = (Axis, &'a [usize], u64, &'a dyn Fn(usize) -> Scene);

/// The cost in objects and in lights. None where `proceed` says no.
pub fn sweeps(
    quick: bool,
    clock: &mut dyn Clock,
    proceed: &mut Progress<'_>,
) -> Result<Option<Vec<Sweep>>, SpeedupError> {
    let mut sweeps = Vec::new();
    let objects = |count: usize| many(count / 2, count - count / 2, SEED);
    let axes: [Sweeping; 2] =
        [(Axis::Objects, &OBJECTS, OBJECT_WORK, &objects), (Axis::Lights, &LIGHTS, LIGHT_WORK, &lit)];
    for (axis, counts, work, scene_of) in axes {
        let engines: Vec<Engine> =
            Engine::ALL.iter().copied().filter(|engine| [BASELINE, CONTROL].contains(&engine.name())).collect();
        let mut points: Vec<Vec<(f64, f64)>> = vec![Vec::new(); engines.len()];
        for count in counts {
            let scene = scene_of(*count);
            let camera = Camera::new(SIZE.0, SIZE.1, scene.camera.focal(), scene.camera.film())
                .expect("the size is within the limits");
            let films = std::cell::RefCell::new(Films::new(camera.pixels() as usize)?);
            let tracers = engines.iter().map(|engine| engine.prepare(None, &scene, &camera));
            let tracers = tracers.collect::<Result<Vec<_>, _>>()?;
            let mut contestants: Vec<Work<'_>> = Vec::new();
            for tracer in &tracers {
                let films = &films;
                contestants.push(Box::new(move || {
                    tracer.rows(0..SIZE.1, films.borrow_mut().of(PixelFormat::F32x4).as_mut());
                }));
            }
            let mut proceed = || proceed(camera.pixels() * *count as u64 * work);
            let Some(measured) = interleave(clock, &mut contestants, runs(quick), &mut proceed) else {
                return Ok(None);
            };
            for (points, runs) in points.iter_mut().zip(measured) {
                points.push((*count as f64, minimum(&runs.ticks)));
            }
        }
        for (engine, points) in engines.iter().zip(points) {
            sweeps.push(Sweep { axis, engine: engine.name(), line: fit_line(&points), points });
        }
    }
    Ok(Some(sweeps))
}

/// The cost in pixels, which the table has measured; None with fewer than three sizes, through which any line goes.
fn pixel_sweeps(rows: &[Row]) -> Option<Vec<Sweep>> {
    let sweep = |engine: &'static str| {
        let points: Vec<_> =
            rows.iter().filter(|row| row.is(engine)).map(|row| (row.pixels as f64, row.cycles_min)).collect();
        (points.len() > 2).then(|| Sweep { axis: Axis::Pixels, engine, line: fit_line(&points), points })
    };
    [BASELINE, CONTROL].into_iter().map(sweep).collect()
}

/// What was measured for the claims; what was not is None.
pub struct Evidence<'a> {
    /// The table.
    pub speedup: &'a Speedup,
    /// The costs in objects and lights.
    pub sweeps: Option<&'a [Sweep]>,
    /// The rungs with and without calls.
    pub rungs: Option<&'a [Rung]>,
    /// Time by the pixel from small pictures to large ones.
    pub jumps: Option<&'a Jumps>,
    /// Where.
    pub machine: &'a Machine,
}

/// How far from the paper's range a ratio may be and still be about the same.
const ABOUT: f64 = 0.10;
/// The widest interval of a ratio, relative to it, that lets one judge.
const READABLE: f64 = 0.25;
/// A share of a factor from which on a cause is one that matters.
const MATTERS: f64 = 0.10;

/// The verdict about every claim.
pub fn judge(evidence: &Evidence<'_>) -> Vec<Claim> {
    let claim = |claim, (verdict, figure)| Claim { claim, verdict, figure };
    vec![
        claim("SIMD is about 6 times faster than C", factor(evidence)),
        claim("The ratio does not depend on the size", constant_ratio(evidence.speedup)),
        claim("The cost grows linearly in pixels", linear(evidence, Axis::Pixels)),
        claim("The cost grows linearly in objects", linear(evidence, Axis::Objects)),
        claim("The cost grows linearly in lights", linear(evidence, Axis::Lights)),
        claim("Macros in place of calls matter little (section 4)", macros_matter_little(evidence)),
        claim("Macros in place of calls explain the factor beyond 3 (section 5)", macros_explain(evidence)),
        claim("The jumps in time are the cache", jumps(evidence)),
    ]
}

fn not_measured() -> (Verdict, String) {
    (Verdict::NotTestable, "not measured: the run was stopped before".into())
}

fn factor(evidence: &Evidence<'_>) -> (Verdict, String) {
    let ours = evidence.speedup.c_by_simd;
    let ratios = PAPER.map(|row| row.ratio());
    let (low, high) = (minimum(&ratios) * (1.0 - ABOUT), ratios.into_iter().fold(0.0, f64::max) * (1.0 + ABOUT));
    let mut figure = format!("C/SIMD {:.2} [{:.2}, {:.2}]", ours.value, ours.low, ours.high);
    let called = evidence.rungs.and_then(|rungs| ladder::ratio(rungs, "c, called", "paper"));
    if let Some(called) = called {
        figure += &format!("; {:.2} [{:.2}, {:.2}] where C calls its functions", called.value, called.low, called.high);
    }
    let verdict = match () {
        () if (ours.high - ours.low) / ours.value > READABLE => Verdict::NotTestable,
        () if low <= ours.value && ours.value <= high => Verdict::Reproduced,
        () => Verdict::NotReproduced,
    };
    if verdict == Verdict::NotTestable {
        figure += ": too wide an interval to judge by";
    }
    (verdict, figure)
}

fn constant_ratio(speedup: &Speedup) -> (Verdict, String) {
    let rows: Vec<_> = speedup.rows.iter().filter(|row| row.is(CONTROL)).collect();
    let (first, last) = (rows[0], rows[rows.len() - 1]);
    let ratios: Vec<_> = rows.iter().map(|row| row.ratio_to_c).collect();
    let (low, high) = (minimum(&ratios), ratios.iter().copied().fold(0.0, f64::max));
    let papers = PAPER.map(|row| row.ratio());
    let paper_spread = papers.iter().copied().fold(0.0, f64::max) / minimum(&papers) - 1.0;
    let figure = format!(
        "C/SIMD from {low:.2} to {high:.2}, {:.1} % apart, from {} to {} pixels; the paper's {:.1} % apart",
        100.0 * (high / low - 1.0),
        first.pixels,
        last.pixels,
        100.0 * paper_spread,
    );
    // A median that noise has moved keeps the others' within its interval.
    let middle = median(&ratios);
    let widest = rows.iter().map(|row| (row.ratio_high - row.ratio_low) / row.ratio_to_c).fold(0.0, f64::max);
    let verdict = match () {
        () if rows.len() < 2 => return (Verdict::NotTestable, format!("{figure}: one size only")),
        () if high / low - 1.0 <= paper_spread => Verdict::Reproduced,
        () if widest > READABLE => {
            return (Verdict::NotTestable, format!("{figure}, but intervals of up to {:.0} %", 100.0 * widest));
        }
        () if rows.iter().all(|row| row.ratio_low <= middle && middle <= row.ratio_high) => Verdict::Reproduced,
        () => Verdict::NotReproduced,
    };
    (verdict, figure)
}

fn linear(evidence: &Evidence<'_>, axis: Axis) -> (Verdict, String) {
    if !evidence.machine.tsc_invariant {
        return (Verdict::NotTestable, "the time-stamp counter is not known to tick at a constant rate".into());
    }
    let pixels;
    let sweeps = match axis {
        Axis::Pixels => {
            pixels = pixel_sweeps(&evidence.speedup.rows);
            pixels.as_deref()
        }
        Axis::Objects | Axis::Lights => evidence.sweeps,
    };
    let Some(sweeps) = sweeps else { return not_measured() };
    let of_axis: Vec<_> = sweeps.iter().filter(|sweep| sweep.axis == axis).collect();
    let unit = match axis {
        Axis::Pixels => "a pixel",
        Axis::Objects => "an object",
        Axis::Lights => "a light",
    };
    let figures: Vec<_> = of_axis
        .iter()
        .map(|sweep| {
            let per_pixel = if axis == Axis::Pixels { 1.0 } else { f64::from(SIZE.0) * f64::from(SIZE.1) };
            let more = if axis == Axis::Pixels { String::new() } else { " and pixel".into() };
            format!(
                "`{}` {:.1} cycles {unit}{more}, residual {:.1} %",
                sweep.engine,
                sweep.line.slope / per_pixel,
                100.0 * sweep.line.residual
            )
        })
        .collect();
    let straight = of_axis.iter().all(|sweep| sweep.line.slope > 0.0 && sweep.line.residual <= STRAIGHT);
    let (floor, figure) = (evidence.speedup.noise_floor, figures.join("; "));
    match () {
        () if straight => (Verdict::Reproduced, figure),
        () if floor > STRAIGHT => {
            (Verdict::NotTestable, format!("{figure}, at a noise floor of {:.1} %", 100.0 * floor))
        }
        () => (Verdict::NotReproduced, figure),
    }
}

/// What calls cost the paper's SIMD, and the share that they have in the factor of the C that calls.
fn calls(evidence: &Evidence<'_>) -> Option<(f64, f64, f64)> {
    let rungs = evidence.rungs?;
    let simd = ladder::ratio(rungs, "paper, called", "paper")?.value;
    let whole = ladder::explain(rungs).into_iter().find(|whole| whole.from == "c, called")?;
    let share = whole.shares.iter().find(|share| share.cause == "calls")?;
    Some((simd, share.factor, share.share))
}

fn macros_matter_little(evidence: &Evidence<'_>) -> (Verdict, String) {
    let Some((simd, c, share)) = calls(evidence) else { return not_measured() };
    let figure = format!(
        "calls cost the SIMD {:.0} % and the C {:.0} %, {:.0} % of the factor",
        100.0 * (simd - 1.0),
        100.0 * (c - 1.0),
        100.0 * share
    );
    let little = simd - 1.0 < MATTERS.max(evidence.speedup.noise_floor) && share < MATTERS;
    (if little { Verdict::Reproduced } else { Verdict::NotReproduced }, figure)
}

fn macros_explain(evidence: &Evidence<'_>) -> (Verdict, String) {
    let Some((_, c, share)) = calls(evidence) else { return not_measured() };
    let Some(whole) = evidence.rungs.and_then(|rungs| ladder::ratio(rungs, "c, called", "paper")) else {
        return not_measured();
    };
    // Three lanes of four give 3; what is beyond it is to be explained.
    let beyond = whole.value / LANES;
    let figure = format!(
        "beyond the {LANES} of its lanes there is a factor of {beyond:.2} to explain; calls are {c:.2} ({:.0} % of all)",
        100.0 * share
    );
    let explained = beyond > 1.0 && c.ln() / beyond.ln() > 0.5;
    (if explained { Verdict::Reproduced } else { Verdict::NotReproduced }, figure)
}

/// What the paper expects of three lanes in use.
const LANES: f64 = 3.0;

fn jumps(evidence: &Evidence<'_>) -> (Verdict, String) {
    if !evidence.machine.tsc_invariant {
        return (Verdict::NotTestable, "the time-stamp counter is not known to tick at a constant rate".into());
    }
    let Some(jumps) = evidence.jumps else { return not_measured() };
    let floor = evidence.speedup.noise_floor;
    match jumps.cache_jumps(floor) {
        (Some(true), figure) => (Verdict::Reproduced, figure),
        (Some(false), figure) => (Verdict::NotReproduced, figure),
        (None, figure) => (Verdict::NotTestable, format!("{figure}, at a noise floor of {:.1} %", 100.0 * floor)),
    }
}
