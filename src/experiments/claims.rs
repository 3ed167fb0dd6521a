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

impl Axis {
    /// Its name, as in the JSON document.
    pub fn name(self) -> &'static str {
        match self {
            Axis::Pixels => "pixels",
            Axis::Objects => "objects",
            Axis::Lights => "lights",
        }
    }
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
/// A noise floor above this could have bent a line that is straight.
const QUIET: f64 = 0.01;

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
            let Some(measured) = interleave(clock, &mut contestants, 0..runs(quick), &mut proceed) else {
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
        () if floor > QUIET => (Verdict::NotTestable, format!("{figure}, at a noise floor of {:.1} %", 100.0 * floor)),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiments::jumps;
    use crate::measure::Machine;
    use crate::measure::statistics::Estimate;

    /// A table in which `c` takes 6 `c_by_simd` cycles a pixel and `paper` 6, with intervals of `spread` either way.
    fn table(c_by_simd: f64, spread: f64, noise_floor: f64) -> Speedup {
        let row = |engine, size: &speedup::PaperRow, cycles: f64, ratio: f64| Row {
            width: size.width,
            height: size.height,
            pixels: size.pixels(),
            engine,
            precision: "single",
            output: "f32x4",
            threads: 1,
            cycles_mean: cycles,
            cycles_median: cycles,
            cycles_min: cycles,
            ratio_to_c: ratio,
            ratio_low: ratio * (1.0 - spread),
            ratio_high: ratio * (1.0 + spread),
            migrations: 0,
            off: 0,
            samples: vec![cycles],
        };
        let rows = PAPER.iter().flat_map(|size| {
            let cycles = 6.0 * size.pixels() as f64;
            [row(BASELINE, size, cycles * c_by_simd, 1.0), row(CONTROL, size, cycles, c_by_simd)]
        });
        let estimate = |value| Estimate { value, low: value * (1.0 - spread), high: value * (1.0 + spread) };
        Speedup {
            rows: rows.collect(),
            control: Vec::new(),
            noise_floor,
            control_overall: estimate(1.0),
            c_by_simd: estimate(c_by_simd),
            runs: 1,
            asked: (PAPER.len(), 1),
        }
    }

    fn machine(tsc_invariant: bool) -> Machine {
        Machine { tsc_invariant, ..Machine::this() }
    }

    /// Rungs with these cycles.
    fn rungs(cycles: &[(&str, f64)]) -> Vec<Rung> {
        let rung = |(name, cycles): &(&str, f64)| Rung {
            rung: (*name).into(),
            change: String::new(),
            flags: "",
            over: None,
            aside: false,
            threads: 1,
            cycles_per_pixel: *cycles,
            instructions_per_pixel: None,
            gain: 1.0,
            gain_low: 1.0,
            gain_high: 1.0,
            gain_total: 1.0,
            samples: vec![*cycles; 3],
            samples_per_run: 1,
        };
        cycles.iter().map(rung).collect()
    }

    /// A sweep in which both engines take these cycles a pixel, and write at this share of the bandwidth.
    fn sweep_of_sizes(cycles: &[f64], share: f64) -> Jumps {
        let rows = [BASELINE, CONTROL].into_iter().flat_map(|engine| {
            cycles.iter().flat_map(move |cycles| {
                [true, false].map(|touched| jumps::Row {
                    width: 100,
                    height: 100,
                    pixels: 10_000,
                    engine,
                    touched,
                    cycles_per_pixel: *cycles,
                    cycles_per_pixel_median: *cycles,
                    clock_per_tick: 1.5,
                    taken_share: Some(0.0),
                    core_cycles_per_pixel: 1.5 * cycles,
                    page_faults: 0.0,
                    bytes_per_cycle: 10.0 * share,
                })
            })
        });
        let bandwidth = jumps::Bandwidth { level: "memory".into(), bytes: 1, bytes_per_cycle: 10.0 };
        Jumps { rows: rows.collect(), bandwidth: vec![bandwidth] }
    }

    fn verdict(evidence: &Evidence<'_>, claim: &str) -> Verdict {
        let claims = judge(evidence);
        claims.iter().find(|judged| judged.claim.contains(claim)).unwrap_or_else(|| panic!("{claim}")).verdict
    }

    #[test]
    fn the_factor_is_held_against_the_papers_range() {
        let machine = machine(true);
        for (ratio, spread, expected) in [
            (6.3, 0.01, Verdict::Reproduced),
            (4.5, 0.01, Verdict::NotReproduced),
            (12.0, 0.01, Verdict::NotReproduced),
            (6.3, 0.3, Verdict::NotTestable),
        ] {
            let speedup = table(ratio, spread, 0.01);
            let evidence = Evidence { speedup: &speedup, sweeps: None, rungs: None, jumps: None, machine: &machine };
            assert_eq!(verdict(&evidence, "6 times"), expected, "{ratio} {spread}");
            assert_eq!(verdict(&evidence, "depend on the size"), Verdict::Reproduced);
        }
    }

    #[test]
    fn what_was_not_measured_is_not_testable_and_neither_are_cycles_without_an_invariant_counter() {
        let speedup = table(6.3, 0.01, 0.01);
        for invariant in [true, false] {
            let machine = machine(invariant);
            let evidence = Evidence { speedup: &speedup, sweeps: None, rungs: None, jumps: None, machine: &machine };
            for claim in ["in objects", "in lights", "matter little", "explain", "cache"] {
                assert_eq!(verdict(&evidence, claim), Verdict::NotTestable, "{claim}");
            }
            let pixels = if invariant { Verdict::Reproduced } else { Verdict::NotTestable };
            assert_eq!(verdict(&evidence, "in pixels"), pixels);
        }
    }

    #[test]
    fn macros_are_judged_by_what_calls_cost() {
        let (speedup, machine) = (table(6.3, 0.01, 0.01), machine(true));
        let of = |calls: f64, paper_called: f64| {
            let inlined = 30.0;
            rungs(&[
                ("c, called", 2.0 * calls * inlined),
                ("sqrtf", calls * inlined),
                ("inlined", inlined),
                ("lean", 30.0),
                ("paper", 10.0),
                ("paper, called", 10.0 * paper_called),
            ])
        };
        for (calls, paper_called, little, explain) in [
            (1.02, 1.01, Verdict::Reproduced, Verdict::NotReproduced),
            (4.0, 1.01, Verdict::NotReproduced, Verdict::Reproduced),
            (1.02, 1.5, Verdict::NotReproduced, Verdict::NotReproduced),
        ] {
            let rungs = of(calls, paper_called);
            let evidence =
                Evidence { speedup: &speedup, sweeps: None, rungs: Some(&rungs), jumps: None, machine: &machine };
            assert_eq!(verdict(&evidence, "matter little"), little, "{calls} {paper_called}");
            assert_eq!(verdict(&evidence, "explain"), explain, "{calls} {paper_called}");
        }
    }

    #[test]
    fn a_factor_is_taken_apart_into_shares_that_make_it() {
        let rungs = rungs(&[("c, called", 160.0), ("sqrtf", 80.0), ("inlined", 40.0), ("lean", 20.0), ("paper", 10.0)]);
        let whole = &ladder::explain(&rungs)[0];
        assert_eq!(whole.factor, 16.0);
        for share in &whole.shares {
            assert_eq!((share.factor, share.share), (2.0, 0.25), "{}", share.cause);
        }
    }

    #[test]
    fn the_cache_is_to_blame_only_where_time_jumps_and_stores_come_near_the_bandwidth() {
        let machine = machine(true);
        for (cycles, share, floor, expected) in [
            (&[100.0, 101.0, 102.0][..], 0.9, 0.01, Verdict::NotReproduced),
            (&[100.0, 150.0, 250.0], 0.9, 0.01, Verdict::Reproduced),
            (&[100.0, 150.0, 250.0], 0.02, 0.01, Verdict::NotReproduced),
            (&[100.0, 150.0, 250.0], 0.9, 0.5, Verdict::NotTestable),
        ] {
            let (speedup, jumps) = (table(6.3, 0.01, floor), sweep_of_sizes(cycles, share));
            let evidence =
                Evidence { speedup: &speedup, sweeps: None, rungs: None, jumps: Some(&jumps), machine: &machine };
            assert_eq!(verdict(&evidence, "cache"), expected, "{cycles:?} {share} {floor}");
        }
    }

    #[test]
    fn a_crooked_cost_is_not_linear_unless_noise_could_have_bent_it() {
        let machine = machine(true);
        let sweep = |points: Vec<(f64, f64)>| {
            let line = fit_line(&points);
            vec![Sweep { axis: Axis::Objects, engine: BASELINE, points, line }]
        };
        let straight = sweep(vec![(1.0, 10.0), (2.0, 20.0), (3.0, 30.0)]);
        let crooked = sweep(vec![(1.0, 10.0), (2.0, 40.0), (3.0, 90.0)]);
        for (sweeps, floor, expected) in [
            (&straight, 0.01, Verdict::Reproduced),
            (&crooked, 0.01, Verdict::NotReproduced),
            (&crooked, 0.2, Verdict::NotTestable),
        ] {
            let speedup = table(6.3, 0.01, floor);
            let evidence =
                Evidence { speedup: &speedup, sweeps: Some(sweeps), rungs: None, jumps: None, machine: &machine };
            assert_eq!(verdict(&evidence, "in objects"), expected, "{floor}");
        }
    }
}
