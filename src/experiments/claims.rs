//! The paper's claims one by one: reproduced, not reproduced, or not testable here, with the figure that says so.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::document::Experiment;
use super::in_size;
use super::jumps::Jumps;
use super::lab::{Bench, Case, LabError, Progress, Taken, Timed};
use super::ladder::{self, AgainstCompiler, Rung};
use super::speedup::{self, BASELINE, CONTROL, PAPER, Speedup, Timing};
use crate::measure::Clock;
use crate::measure::Name;
use crate::measure::statistics::{Estimate, Line, fit_line, median, minimum};
use crate::render::{Engine, PixelFormat, Purpose};
use crate::scene::{Light, Scene, many};

/// What became of a claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub enum Verdict {
    #[serde(rename = "reproduced")]
    Reproduced,
    #[serde(rename = "not reproduced")]
    NotReproduced,
    /// This machine, or this run, cannot tell.
    #[serde(rename = "not testable here")]
    NotTestable,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// A claim of the paper and what became of it. The field names are those of the JSON document.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Claim {
    pub claim: Name,
    pub verdict: Verdict,
    pub figure: String,
}

/// What the cost of a picture depends on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Axis {
    /// w h.
    #[default]
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
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Sweep {
    pub axis: Axis,
    pub engine: Name,
    /// Count, and TSC cycles of the fastest picture.
    pub points: Vec<(f64, f64)>,
    /// The line; its slope is in cycles by the pixel, object or light.
    pub line: Line,
    /// Points of which others had the core in more than half of the pictures.
    pub taken: usize,
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
pub fn sweeps(quick: bool, clock: &mut dyn Clock, proceed: &mut Progress<'_>) -> Result<Option<Vec<Sweep>>, LabError> {
    let mut sweeps = Vec::new();
    let objects = |count: usize| many(count / 2, count - count / 2, SEED);
    let axes: [Sweeping; 2] =
        [(Axis::Objects, &OBJECTS, OBJECT_WORK, &objects), (Axis::Lights, &LIGHTS, LIGHT_WORK, &lit)];
    for (axis, counts, work, scene_of) in axes {
        let engines = speedup::baseline_and_control();
        let mut points: Vec<Vec<(f64, f64)>> = vec![Vec::new(); engines.len()];
        let mut taken = vec![0; engines.len()];
        for count in counts {
            let scene = in_size(&scene_of(*count), SIZE.0, SIZE.1);
            let pixels = scene.camera.pixels();
            let case =
                |engine: &Engine| Case::of(Timed::Tracing, &scene, *engine, Purpose::default(), PixelFormat::F32x4);
            let cases = engines.iter().map(case).collect::<Result<Vec<_>, _>>()?;
            let mut proceed = || proceed(pixels * *count as u64 * work);
            let Some(measured) = Bench::default().time(clock, &cases, 0..runs(quick), &mut proceed)? else {
                return Ok(None);
            };
            for ((points, taken), runs) in points.iter_mut().zip(&mut taken).zip(measured) {
                points.push((*count as f64, minimum(&runs.ticks)));
                *taken += usize::from(!Taken::among(&runs.taken).leaves_enough());
            }
        }
        for ((engine, points), taken) in engines.iter().zip(points).zip(taken) {
            sweeps.push(Sweep { axis, engine: engine.name().into(), line: fit_line(&points), points, taken });
        }
    }
    Ok(Some(sweeps))
}

/// The cost in pixels, which the table has measured; none with fewer than three sizes, through which any line goes.
fn pixel_sweeps(rows: &[Timing]) -> Vec<Sweep> {
    let sweep = |engine: &'static str| {
        let rows: Vec<_> = rows.iter().filter(|row| row.is(engine)).collect();
        let points: Vec<_> = rows.iter().map(|row| (row.pixels as f64, row.cycles_min)).collect();
        let taken = rows.iter().filter(|row| !row.taken().leaves_enough()).count();
        (points.len() > 2).then(|| Sweep {
            axis: Axis::Pixels,
            engine: engine.into(),
            line: fit_line(&points),
            points,
            taken,
        })
    };
    [BASELINE, CONTROL].into_iter().filter_map(sweep).collect()
}

/// What is about 6: from 5 to 7. The paper's own rows are from 6.1 to 6.8.
const ABOUT_SIX: [f64; 2] = [5.0, 7.0];
/// Two figures of one thing differ by less than this, one being of one size and the other of many.
const SAME: f64 = 0.25;
/// The widest interval of a ratio, relative to it, that lets one judge.
const READABLE: f64 = 0.25;
/// A share of a factor from which on a cause is one that matters.
const MATTERS: f64 = 0.10;

/// The verdict about every claim, by what was measured and the rungs of the ladder: none of either where that was not.
pub fn judge(of: &Experiment, rungs: &[Rung]) -> Vec<Claim> {
    let reasons = reasons(of, rungs);
    let claim = |claim: &'static str, by: &[Source], (verdict, figure): (Verdict, String)| {
        // What was not measured needs no other reason.
        match reasons.iter().find(|(source, _)| by.contains(source)) {
            Some((_, why)) if verdict != Verdict::NotTestable => {
                Claim { claim: claim.into(), verdict: Verdict::NotTestable, figure: format!("{figure}; but {why}") }
            }
            _ => Claim { claim: claim.into(), verdict, figure },
        }
    };
    use Source::{Jumps, Ladder, Sweeps, Table};
    vec![
        claim("SIMD is about 6 times faster than C", &[Table], factor(of, rungs)),
        claim("The ratio does not depend on the size", &[Table], constant_ratio(&of.table)),
        claim("The cost grows linearly in pixels", &[Table], linear(of, Axis::Pixels)),
        claim("The cost grows linearly in objects", &[Sweeps], linear(of, Axis::Objects)),
        claim("The cost grows linearly in lights", &[Sweeps], linear(of, Axis::Lights)),
        claim("Macros in place of calls matter little (section 4)", &[Ladder, Table], macros_matter_little(of, rungs)),
        claim(
            "Macros in place of calls explain the factor beyond 3 (section 5)",
            &[Ladder, Table],
            macros_explain(rungs),
        ),
        claim("Written by hand it is faster than compiled (section 5)", &[Ladder], by_hand(of, rungs)),
        claim("The jumps in time are the cache", &[Jumps, Table], jumps(of)),
    ]
}

/// What was measured by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    Table,
    Sweeps,
    Ladder,
    Jumps,
}

/// Why there are verdicts that this run cannot give, where it could have: others had the core, or two figures of one thing are
/// apart.
pub fn disturbed(of: &Experiment, rungs: &[Rung]) -> Vec<String> {
    let mut reasons: Vec<String> = reasons(of, rungs).into_iter().map(|(_, why)| why).collect();
    reasons.dedup();
    reasons
}

/// Of what no verdict can be had, and why.
fn reasons(of: &Experiment, rungs: &[Rung]) -> Vec<(Source, String)> {
    let mut reasons = Vec::new();
    let mut not_enough = |source, taken: Taken, what: &str| {
        if !taken.leaves_enough() {
            let Taken { taken, of } = taken;
            let why = format!("others had the core in {taken} of {of} {what}, each time that they were tried");
            reasons.push((source, why));
        }
    };
    not_enough(Source::Table, of.table.taken, "pairs of pictures of the table");
    not_enough(Source::Ladder, ladder::taken(rungs), "pictures of the ladder");
    // One point that is off bends a line.
    let taken: usize = of.sweeps.iter().map(|sweep| sweep.taken).sum();
    if taken > 0 {
        let counts: usize = of.sweeps.iter().map(|sweep| sweep.points.len()).sum();
        let why = format!("others had the core in most pictures at {taken} of {counts} counts of objects and lights");
        reasons.push((Source::Sweeps, why));
    }
    if let Some(why) = of.jumps.as_ref().and_then(Jumps::disturbed) {
        reasons.push((Source::Jumps, why));
    }
    if let Some(why) = apart(&of.table, rungs) {
        reasons.extend([Source::Table, Source::Ladder].map(|source| (source, why.clone())));
    }
    reasons
}

/// Where the table and the ladder, which both have `c` and `paper`, say two things.
fn apart(table: &Speedup, rungs: &[Rung]) -> Option<String> {
    let ladder = ladder::ratio(rungs, BASELINE, CONTROL)?;
    let table = table.c_by_simd;
    let wider = |of: Estimate| Estimate { low: of.low / (1.0 + SAME), high: of.high * (1.0 + SAME), ..of };
    (!wider(table).overlaps(&ladder)).then(|| {
        format!(
            "`{BASELINE}` by `{CONTROL}` is {:.2} [{:.2}, {:.2}] by the table and {:.2} [{:.2}, {:.2}] by the ladder of the same \
            run: one of them is not right",
            table.value, table.low, table.high, ladder.value, ladder.low, ladder.high
        )
    })
}

fn not_measured() -> (Verdict, String) {
    (Verdict::NotTestable, "not measured: the run was stopped before".into())
}

/// About 6 is from 5 to 7, and it is the whole interval that has to be within or outside.
fn factor(of: &Experiment, rungs: &[Rung]) -> (Verdict, String) {
    let ours = of.table.c_by_simd;
    let [low, high] = ABOUT_SIX;
    let mut figure = format!("C/SIMD {:.2} [{:.2}, {:.2}]", ours.value, ours.low, ours.high);
    if let Some(called) = ladder::ratio(rungs, "c, called", "paper") {
        figure += &format!("; {:.2} [{:.2}, {:.2}] where C calls its functions", called.value, called.low, called.high);
    }
    let (verdict, where_it_is) = if (ours.high - ours.low) / ours.value > READABLE {
        (Verdict::NotTestable, "is too wide to judge by")
    } else if low <= ours.low && ours.high <= high {
        (Verdict::Reproduced, "is within that")
    } else if ours.high < low || high < ours.low {
        (Verdict::NotReproduced, "is outside of that")
    } else {
        (Verdict::NotTestable, "is in part outside of that")
    };
    (verdict, format!("{figure}; about 6 is from {low} to {high}, and the interval {where_it_is}"))
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
    let verdict = if rows.len() < 2 {
        return (Verdict::NotTestable, format!("{figure}: one size only"));
    } else if high / low - 1.0 <= paper_spread {
        Verdict::Reproduced
    } else if rows.iter().any(|row| row.samples.len() < 2) {
        return (Verdict::NotTestable, format!("{figure}, but of one run each, which has no interval"));
    } else if widest > READABLE {
        return (Verdict::NotTestable, format!("{figure}, but intervals of up to {:.0} %", 100.0 * widest));
    } else if rows.iter().all(|row| row.ratio_low <= middle && middle <= row.ratio_high) {
        Verdict::Reproduced
    } else {
        Verdict::NotReproduced
    };
    (verdict, figure)
}

fn linear(of: &Experiment, axis: Axis) -> (Verdict, String) {
    if !of.machine.tsc_invariant {
        return (Verdict::NotTestable, "the time-stamp counter is not known to tick at a constant rate".into());
    }
    let pixels = pixel_sweeps(&of.table.rows);
    let of_axis: Vec<_> = of.sweeps.iter().chain(&pixels).filter(|sweep| sweep.axis == axis).collect();
    if of_axis.is_empty() {
        return not_measured();
    }
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
    let (floor, figure) = (of.table.noise_floor, figures.join("; "));
    if straight {
        (Verdict::Reproduced, figure)
    } else if floor > QUIET {
        (Verdict::NotTestable, format!("{figure}, at a noise floor of {:.1} %", 100.0 * floor))
    } else {
        (Verdict::NotReproduced, figure)
    }
}

/// What calls cost the paper's SIMD, and the share that they have in the factor of the C that calls.
fn calls(rungs: &[Rung]) -> Option<(f64, f64, f64)> {
    let simd = ladder::ratio(rungs, "paper, called", "paper")?.value;
    let whole = ladder::explain(rungs).into_iter().find(|whole| whole.from == "c, called")?;
    let share = whole.shares.iter().find(|share| share.cause == "calls")?;
    Some((simd, share.factor, share.share))
}

fn macros_matter_little(of: &Experiment, rungs: &[Rung]) -> (Verdict, String) {
    let Some((simd, c, share)) = calls(rungs) else { return not_measured() };
    let figure = format!(
        "calls cost the SIMD {:.0} % and the C {:.0} %, {:.0} % of the factor",
        100.0 * (simd - 1.0),
        100.0 * (c - 1.0),
        100.0 * share
    );
    let little = simd - 1.0 < MATTERS.max(of.table.noise_floor) && share < MATTERS;
    (if little { Verdict::Reproduced } else { Verdict::NotReproduced }, figure)
}

fn macros_explain(rungs: &[Rung]) -> (Verdict, String) {
    let measured = calls(rungs).zip(ladder::ratio(rungs, "c, called", "paper"));
    let Some(((_, c, share), whole)) = measured else { return not_measured() };
    // Three lanes of four give 3; what is beyond it is to be explained.
    let beyond = whole.value / LANES;
    let figure = format!(
        "beyond the {LANES} of its lanes there is a factor of {beyond:.2} to explain; calls are {c:.2} ({:.0} % of all)",
        100.0 * share
    );
    let explained = beyond > 1.0 && c.ln() / beyond.ln() > 0.5;
    (if explained { Verdict::Reproduced } else { Verdict::NotReproduced }, figure)
}

/// The paper's own form, its SIMD beside its C compiled without what the SIMD omits; and the packets' kernel beside the same
/// closed form compiled. Intrinsics are told and not judged: they are by hand, too.
fn by_hand(of: &Experiment, rungs: &[Rung]) -> (Verdict, String) {
    let Some(paper) = ladder::ratio(rungs, "lean", "paper") else { return not_measured() };
    let against = ladder::against_compiler(rungs);
    let closed: Vec<_> = against.iter().filter(|of| of.engine == ladder::WIDEST_BY_HAND).collect();
    // The ratio of one run has no interval: it may be as far off as two figures of one thing are apart.
    let margin = if rungs.iter().all(|rung| rung.samples.len() > rung.samples_per_run) { 1.0 } else { 1.0 + SAME };
    let told = |value: f64, low: f64, high: f64| format!("{value:.2} [{:.2}, {:.2}]", low / margin, high * margin);
    let mut figure = format!(
        "the paper's SIMD is {} times as fast as its C, compiled with the same omissions",
        told(paper.value, paper.low, paper.high)
    );
    for AgainstCompiler { compiled, ratio, low, high, .. } in &closed {
        figure += &format!("; the fastest packets {} times as fast as the {compiled}", told(*ratio, *low, *high));
    }
    let plain = || closed.iter().filter(|of| !of.compiled.contains("intrinsics"));
    let lows = plain().map(|of| of.low).chain([paper.low]).fold(f64::INFINITY, f64::min);
    let highs = plain().map(|of| of.high).chain([paper.high]).fold(f64::INFINITY, f64::min);
    let floor = 1.0 + of.table.noise_floor;
    let verdict = match (plain().next().is_none(), lows / margin > floor, highs * margin < floor) {
        (true, ..) => return (Verdict::NotTestable, format!("{figure}; no kernel of packets was compiled")),
        (_, true, _) => Verdict::Reproduced,
        (_, _, true) => Verdict::NotReproduced,
        _ => return (Verdict::NotTestable, format!("{figure}; one of the intervals contains the noise floor")),
    };
    (verdict, figure)
}

/// What the paper expects of three lanes in use.
const LANES: f64 = 3.0;

fn jumps(of: &Experiment) -> (Verdict, String) {
    if !of.machine.tsc_invariant {
        return (Verdict::NotTestable, "the time-stamp counter is not known to tick at a constant rate".into());
    }
    let Some(jumps) = &of.jumps else { return not_measured() };
    let floor = of.table.noise_floor;
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

    /// A table in which `c` takes 6 `c_by_simd` cycles a pixel and `paper` 6, with intervals of `spread` either way.
    fn table(c_by_simd: f64, spread: f64, noise_floor: f64) -> Speedup {
        let row = |engine: &'static str, size: &speedup::PaperRow, cycles: f64, ratio: f64| Timing {
            width: size.width,
            height: size.height,
            pixels: size.pixels(),
            engine: engine.into(),
            output: "f32x4".into(),
            cycles_min: cycles,
            ratio_to_c: ratio,
            ratio_low: ratio * (1.0 - spread),
            ratio_high: ratio * (1.0 + spread),
            samples: vec![cycles],
            ..Timing::default()
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
            taken: Taken { taken: 0, of: PAPER.len() },
        }
    }

    /// Rungs with these cycles.
    fn rungs(cycles: &[(&str, f64)]) -> Vec<Rung> {
        let rung = |(name, cycles): &(&str, f64)| Rung {
            rung: (*name).into(),
            threads: 1,
            samples: vec![*cycles; 3],
            taken: vec![false; 3],
            samples_per_run: 1,
            ..Rung::default()
        };
        cycles.iter().map(rung).collect()
    }

    /// A sweep in which both engines take these cycles a pixel, and write at this share of the bandwidth.
    fn sweep_of_sizes(cycles: &[f64], share: f64) -> Jumps {
        let rows = [BASELINE, CONTROL].into_iter().flat_map(|engine| {
            cycles.iter().flat_map(move |cycles| {
                [true, false].map(|touched| jumps::PictureTime {
                    engine: engine.into(),
                    touched,
                    cycles_per_pixel: *cycles,
                    clock_per_tick: 1.5,
                    core_cycles_per_pixel: 1.5 * cycles,
                    bytes_per_cycle: 10.0 * share,
                    ..jumps::PictureTime::default()
                })
            })
        });
        let bandwidth = jumps::Bandwidth { level: "memory".into(), bytes: 1, bytes_per_cycle: 10.0 };
        Jumps { rows: rows.collect(), bandwidth: vec![bandwidth] }
    }

    /// A table, and nothing else, of a machine whose time-stamp counter is invariant.
    fn alone(table: Speedup) -> Experiment {
        let machine = Machine { tsc_invariant: true, ..Machine::default() };
        Experiment { table, machine, ..Experiment::default() }
    }

    fn verdict(of: &Experiment, rungs: &[Rung], claim: &str) -> Verdict {
        let claims = judge(of, rungs);
        claims.iter().find(|judged| judged.claim.contains(claim)).unwrap_or_else(|| panic!("{claim}")).verdict
    }

    #[test]
    fn the_factor_is_held_against_the_papers_range() {
        for (ratio, spread, expected) in [
            (6.3, 0.01, Verdict::Reproduced),
            (5.28, 0.04, Verdict::Reproduced),
            (5.1, 0.04, Verdict::NotTestable),
            (6.9, 0.04, Verdict::NotTestable),
            (4.5, 0.01, Verdict::NotReproduced),
            (12.0, 0.01, Verdict::NotReproduced),
            (6.3, 0.3, Verdict::NotTestable),
        ] {
            let of = alone(table(ratio, spread, 0.01));
            assert_eq!(verdict(&of, &[], "6 times"), expected, "{ratio} {spread}");
            assert!(judge(&of, &[])[0].figure.contains("about 6 is from 5 to 7, and the interval is "));
            assert_eq!(verdict(&of, &[], "depend on the size"), Verdict::Reproduced);
        }
    }

    #[test]
    fn one_run_of_each_size_cannot_show_that_the_ratio_depends_on_it() {
        for (runs, expected) in [(1, Verdict::NotTestable), (2, Verdict::NotReproduced)] {
            let mut speedup = table(4.3, 0.01, 0.01);
            for row in &mut speedup.rows {
                row.samples.resize(runs, row.cycles_min);
            }
            let last = speedup.rows.last_mut().unwrap();
            (last.ratio_to_c, last.ratio_low, last.ratio_high) = (5.9, 5.8, 6.0);
            assert_eq!(verdict(&alone(speedup), &[], "depend on the size"), expected, "{runs}");
        }
    }

    /// Asserts which claims have no verdict, and that the reason is told with each and once in all.
    fn none_of(of: &Experiment, rungs: &[Rung], claims: &[&str], why: &str) {
        for claim in judge(of, rungs) {
            let none = claims.iter().any(|none| claim.claim.contains(none));
            assert_eq!(claim.figure.contains(why), none, "{}: {}", claim.claim, claim.figure);
            assert!(!none || claim.verdict == Verdict::NotTestable, "{}", claim.claim);
        }
        let reasons = disturbed(of, rungs);
        assert_eq!(
            reasons.iter().filter(|reason| reason.contains(why)).count(),
            usize::from(!claims.is_empty()),
            "{reasons:?}"
        );
    }

    #[test]
    fn where_others_had_the_core_there_is_no_verdict_by_what_they_disturbed() {
        let line = fit_line(&[(1.0, 10.0), (2.0, 20.0), (3.0, 30.0)]);
        let sweep = |axis| Sweep { axis, engine: BASELINE.into(), points: vec![(1.0, 10.0); 3], line, taken: 0 };
        let rungs = rungs(&[
            ("c, called", 128.0),
            ("c", 63.0),
            ("sqrtf", 60.0),
            ("inlined", 40.0),
            ("lean", 30.0),
            ("paper", 10.0),
            ("paper, called", 10.1),
        ]);
        let clean = Experiment {
            sweeps: vec![sweep(Axis::Objects), sweep(Axis::Lights)],
            jumps: Some(sweep_of_sizes(&[100.0, 150.0, 250.0], 0.9)),
            ..alone(table(6.3, 0.01, 0.01))
        };
        assert_eq!(disturbed(&clean, &rungs), Vec::<String>::new());
        none_of(&clean, &rungs, &[], "others had the core");
        // Half of the pairs are enough.
        for (taken, claims) in
            [(10, &[][..]), (11, &["about 6", "the size", "in pixels", "calls matter", "calls explain", "the cache"])]
        {
            let mut busy = clean.clone();
            busy.table.taken = Taken { taken, of: 20 };
            none_of(&busy, &rungs, claims, "the core in 11 of 20 pairs");
        }
        let busy: Vec<_> = rungs.iter().map(|rung| Rung { taken: vec![true, true, false], ..rung.clone() }).collect();
        none_of(&clean, &busy, &["calls matter", "calls explain"], "the core in 14 of 21 pictures of the ladder");
        let mut busy = clean.clone();
        busy.sweeps[0].taken = 1;
        none_of(&busy, &rungs, &["in objects", "in lights"], "at 1 of 6 counts");
        let mut busy = clean;
        busy.jumps.as_mut().unwrap().rows[0].taken_share = Some(0.35);
        none_of(&busy, &rungs, &["the cache"], "the core for up to 35 %");
    }

    #[test]
    fn two_figures_of_one_thing_that_are_apart_are_both_told_and_neither_gives_a_verdict() {
        let steps = [
            ("c, called", 170.0),
            ("c", 0.0),
            ("sqrtf", 60.0),
            ("inlined", 40.0),
            ("lean", 30.0),
            ("paper", 10.0),
            ("paper, called", 10.1),
        ];
        for (c, is_apart) in [(52.8, false), (63.0, false), (167.4, true), (30.0, true)] {
            let rungs = rungs(&steps.map(|(name, cycles)| (name, if name == "c" { c } else { cycles })));
            let of = alone(table(5.28, 0.01, 0.01));
            let why = format!("5.28 [5.23, 5.33] by the table and {:.2} [{0:.2}, {0:.2}] by the ladder", c / 10.0);
            let claims = ["about 6", "the size", "in pixels", "calls matter", "calls explain"];
            none_of(&of, &rungs, if is_apart { &claims } else { &[] }, &why);
        }
    }

    #[test]
    fn what_was_not_measured_is_not_testable_and_neither_are_cycles_without_an_invariant_counter() {
        for invariant in [true, false] {
            let mut of = alone(table(6.3, 0.01, 0.01));
            of.machine.tsc_invariant = invariant;
            for claim in ["in objects", "in lights", "matter little", "explain", "cache"] {
                assert_eq!(verdict(&of, &[], claim), Verdict::NotTestable, "{claim}");
            }
            let pixels = if invariant { Verdict::Reproduced } else { Verdict::NotTestable };
            assert_eq!(verdict(&of, &[], "in pixels"), pixels);
        }
    }

    #[test]
    fn macros_are_judged_by_what_calls_cost() {
        let table = alone(table(6.3, 0.01, 0.01));
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
            assert_eq!(verdict(&table, &rungs, "matter little"), little, "{calls} {paper_called}");
            assert_eq!(verdict(&table, &rungs, "explain"), explain, "{calls} {paper_called}");
        }
    }

    #[test]
    fn the_hand_is_judged_by_the_same_algorithm_compiled() {
        let closed = "closed form in C, avx2";
        for (paper, compiled, floor, expected) in [
            (10.0, Some(1.5), 0.01, Verdict::Reproduced),
            (10.0, Some(0.9), 0.01, Verdict::NotReproduced),
            (30.0, Some(1.5), 0.01, Verdict::NotReproduced),
            (10.0, Some(1.5), 0.6, Verdict::NotReproduced),
            (10.0, None, 0.01, Verdict::NotTestable),
        ] {
            let of = alone(table(6.3, 0.01, floor));
            let mut cycles = vec![("lean", 20.0), ("paper", paper), (ladder::WIDEST_BY_HAND, 1.0)];
            cycles.extend(compiled.map(|cycles| (closed, cycles)));
            cycles.push(("closed form in intrinsics, avx2", 0.9));
            let rungs = rungs(&cycles);
            assert_eq!(verdict(&of, &rungs, "by hand"), expected, "{paper} {compiled:?} {floor}");
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
        for (cycles, share, floor, expected) in [
            (&[100.0, 101.0, 102.0][..], 0.9, 0.01, Verdict::NotReproduced),
            (&[100.0, 150.0, 250.0], 0.9, 0.01, Verdict::Reproduced),
            (&[100.0, 150.0, 250.0], 0.02, 0.01, Verdict::NotReproduced),
            (&[100.0, 150.0, 250.0], 0.9, 0.5, Verdict::NotTestable),
        ] {
            let of = Experiment { jumps: Some(sweep_of_sizes(cycles, share)), ..alone(table(6.3, 0.01, floor)) };
            assert_eq!(verdict(&of, &[], "cache"), expected, "{cycles:?} {share} {floor}");
        }
    }

    #[test]
    fn a_crooked_cost_is_not_linear_unless_noise_could_have_bent_it() {
        let sweep = |points: Vec<(f64, f64)>| {
            let line = fit_line(&points);
            vec![Sweep { axis: Axis::Objects, engine: BASELINE.into(), points, line, taken: 0 }]
        };
        let straight = sweep(vec![(1.0, 10.0), (2.0, 20.0), (3.0, 30.0)]);
        let crooked = sweep(vec![(1.0, 10.0), (2.0, 40.0), (3.0, 90.0)]);
        for (sweeps, floor, expected) in [
            (&straight, 0.01, Verdict::Reproduced),
            (&crooked, 0.01, Verdict::NotReproduced),
            (&crooked, 0.2, Verdict::NotTestable),
        ] {
            let of = Experiment { sweeps: sweeps.clone(), ..alone(table(6.3, 0.01, floor)) };
            assert_eq!(verdict(&of, &[], "in objects"), expected, "{floor}");
        }
    }
}
