//! The paper's claims, each with the verdict on it and the measured figure that decides it.

use serde::{Deserialize, Serialize};

use super::document::Experiment;
use super::jumps::Jumps;
use super::lab::PreemptedCount;
use super::ladder::{self, AgainstCompiler, Rung};
use super::speedup::{BASELINE, CONTROL, PAPER, Speedup, Timing};
use super::sweeps::{self, Axis};
use super::verdict::Verdict;
use crate::measure::Name;
use crate::measure::statistics::{Estimate, maximum, minimum};
use rayo::internals::plan::with_digit_groups;

/// A claim of the paper with its verdict. The field names are those of the JSON document.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Claim {
    pub claim: Name,
    pub verdict: Verdict,
    pub figure: String,
}

/// The largest residual, relative to the cost, with which a cost counts as linear.
const STRAIGHT: f64 = 0.05;
/// The range that counts as "about 6". The paper's own ratios are from 6.1 to 6.8.
const ABOUT_SIX: [f64; 2] = [5.0, 7.0];
/// By how much two measurements of the same ratio may differ, relative to it. One is of a single
/// size and the other of many, so that they need not be equal.
const SAME: f64 = 0.25;
/// The widest interval, as a share of its ratio, that allows a verdict.
const READABLE: f64 = 0.25;
/// The least share of a factor, on a logarithmic scale, with which a cause counts as one that
/// matters.
const MATTERS: f64 = 0.10;

/// The verdict on every claim, from the table, the sweeps, the jumps and the rungs of the ladder.
/// Whatever was not measured is empty or None.
pub fn judge(of: &Experiment, rungs: &[Rung]) -> Vec<Claim> {
    let objections = objections(of, rungs);
    let claim = |claim: &'static str, by: &[Source], judged: Judged| {
        let objection = objections.iter().find(|objection| by.contains(&objection.source));
        let Judged { verdict, figure } = match objection {
            Some(objection) => judged.unless(objection),
            None => judged,
        };
        Claim { claim: claim.into(), verdict, figure }
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
        claim("The jumps in time are the cache", &[Jumps], jumps(of)),
    ]
}

/// A verdict, and in words the figure on which it rests.
struct Judged {
    verdict: Verdict,
    figure: String,
}

impl Judged {
    fn new(verdict: Verdict, figure: impl Into<String>) -> Self {
        Judged { verdict, figure: figure.into() }
    }

    fn not_measured() -> Self {
        Judged::new(Verdict::NotMeasured, "not measured: the run was stopped before")
    }

    fn without_a_steady_counter() -> Self {
        Judged::new(Verdict::NotTestable, "the time-stamp counter is not known to tick at a constant rate")
    }

    /// Replaces the verdict by the one of an objection to its measurement. A verdict that already
    /// says why nothing can be decided stays as it is.
    fn unless(self, objection: &Objection) -> Self {
        if [Verdict::NotMeasured, Verdict::NotTestable].contains(&self.verdict) {
            return self;
        }
        Judged::new(objection.verdict, format!("{}; but {}", self.figure, objection.why))
    }
}

/// A separate part of the measurement, which can be disturbed by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Source {
    Table,
    Sweeps,
    Ladder,
    Jumps,
}

/// A reason why a part of the measurement cannot decide the claims that rest on it, and the verdict
/// that these get.
struct Objection {
    source: Source,
    verdict: Verdict,
    why: String,
}

/// Why this run cannot give some verdicts that a run should give: measurements were preempted, or
/// two measurements of the same ratio disagree.
pub fn disturbed(of: &Experiment, rungs: &[Rung]) -> Vec<String> {
    let mut reasons: Vec<String> = objections(of, rungs).into_iter().map(|objection| objection.why).collect();
    reasons.dedup();
    reasons
}

fn objections(of: &Experiment, rungs: &[Rung]) -> Vec<Objection> {
    let mut objections = Vec::new();
    let too_few = |source, why| Objection { source, verdict: Verdict::TooFewRuns, why };
    let of_ladder = ladder::taken(rungs);
    for (source, taken, what) in [
        (Source::Table, of.table.taken, "pairs of pictures of the table"),
        (Source::Ladder, of_ladder, "pictures of the ladder"),
    ] {
        if !taken.leaves_enough() {
            let PreemptedCount { preempted, measured } = taken;
            let why =
                format!("others had the core in {preempted} of {measured} {what}, each time that they were tried");
            objections.push(too_few(source, why));
        }
    }
    // A single preempted point would bend a line, so that none is allowed.
    let taken: usize = of.sweeps.iter().map(|sweep| sweep.taken).sum();
    if taken > 0 {
        let counts: usize = of.sweeps.iter().map(|sweep| sweep.points.len()).sum();
        let why = format!("others had the core in most pictures at {taken} of {counts} counts of objects and lights");
        objections.push(too_few(Source::Sweeps, why));
    }
    if let Some(why) = of.jumps.as_ref().and_then(Jumps::disturbed) {
        objections.push(too_few(Source::Jumps, why));
    }
    if let Some(why) = apart(&of.table, rungs) {
        let objection = |source| Objection { source, verdict: Verdict::NotTestable, why: why.clone() };
        objections.extend([Source::Table, Source::Ladder].map(objection));
    }
    objections
}

/// The reason for distrust if the table and the ladder, which both measure `c` and `paper`,
/// disagree on their ratio.
fn apart(table: &Speedup, rungs: &[Rung]) -> Option<String> {
    let ladder = ladder::ratio(rungs, BASELINE, CONTROL)?;
    let table = table.c_by_simd;
    (!table.widened(SAME).overlaps(&ladder)).then(|| {
        format!(
            "`{BASELINE}` by `{CONTROL}` is {:.2} [{:.2}, {:.2}] by the table and {:.2} [{:.2}, {:.2}] by the \
            ladder of the same run: one of them is not right",
            table.value, table.low, table.high, ladder.value, ladder.low, ladder.high
        )
    })
}

/// The ratio of two rungs, with an interval for verdicts. If all samples come from one process, the
/// interval is widened by [`SAME`], since they do not show how processes differ.
fn ratio(rungs: &[Rung], a: &str, b: &str) -> Option<Estimate> {
    let ratio = ladder::ratio(rungs, a, b)?;
    let is_of_one_process = rungs.iter().any(|rung| rung.samples.len() <= rung.samples_per_run);
    Some(if is_of_one_process { ratio.widened(SAME) } else { ratio })
}

/// Whether the table was made from a single run, so that its spread is unknown.
fn one_run(table: &Speedup) -> bool {
    table.rows.iter().any(|row| row.samples.len() < 2)
}

/// The verdict on the claim that SIMD is about 6 times as fast: decided only if the whole interval
/// is inside [`ABOUT_SIX`] or outside of it.
fn factor(of: &Experiment, rungs: &[Rung]) -> Judged {
    let ours = of.table.c_by_simd;
    let [low, high] = ABOUT_SIX;
    let mut figure = format!("C/SIMD {:.2} [{:.2}, {:.2}]", ours.value, ours.low, ours.high);
    if let Some(called) = ladder::ratio(rungs, "c, called", "paper") {
        figure += &format!("; {:.2} [{:.2}, {:.2}] where C calls its functions", called.value, called.low, called.high);
    }
    let verdict = Verdict::at_least(ours, low).and(Verdict::at_most(ours, high));
    let (verdict, where_it_is) = match verdict {
        _ if one_run(&of.table) => (Verdict::TooFewRuns, "is that of one run, which has no spread"),
        _ if (ours.high - ours.low) / ours.value > READABLE => (Verdict::TooFewRuns, "is too wide to judge by"),
        Verdict::Reproduced => (verdict, "is within that"),
        Verdict::NotReproduced => (verdict, "is outside of that"),
        _ => (verdict, "is in part outside of that"),
    };
    Judged::new(verdict, format!("{figure}; about 6 is from {low} to {high}, and the interval {where_it_is}"))
}

/// The verdict on the claim that the ratio does not depend on the size. The largest difference
/// between two sizes is compared with the paper's: once with the ratios as far apart as their
/// intervals allow, and once as close together.
fn constant_ratio(speedup: &Speedup) -> Judged {
    let rows: Vec<_> = speedup.rows.iter().filter(|row| row.is(CONTROL)).collect();
    let (first, last) = (rows[0], rows[rows.len() - 1]);
    if rows.len() < 2 {
        return Judged::new(Verdict::NotMeasured, "one size only: the run was stopped before the second");
    }
    let ratios: Vec<_> = rows.iter().map(|row| row.ratio_to_c).collect();
    let (low, high) = (minimum(&ratios), maximum(&ratios));
    let [lows, highs] = [|row: &Timing| row.ratio_low, |row: &Timing| row.ratio_high]
        .map(|end| rows.iter().map(|row| end(row)).collect::<Vec<_>>());
    let apart = Estimate {
        value: high / low - 1.0,
        low: (maximum(&lows) / minimum(&highs) - 1.0).max(0.0),
        high: maximum(&highs) / minimum(&lows) - 1.0,
    };
    let papers = PAPER.map(|row| row.ratio());
    let paper_spread = maximum(&papers) / minimum(&papers) - 1.0;
    let figure = format!(
        "C/SIMD from {low:.2} to {high:.2}, {} % apart, from {} to {} pixels; the paper's {:.1} % apart",
        percent(apart),
        with_digit_groups(first.pixels, ' '),
        with_digit_groups(last.pixels, ' '),
        100.0 * paper_spread,
    );
    if one_run(speedup) {
        return Judged::new(Verdict::TooFewRuns, format!("{figure}, but of one run each, which has no spread"));
    }
    Judged::new(Verdict::at_most(apart, paper_spread), figure)
}

/// A share with its interval, in per cent: `12.3 [4.5, 20.1]`.
fn percent(share: Estimate) -> String {
    format!("{:.1} [{:.1}, {:.1}]", 100.0 * share.value, 100.0 * share.low, 100.0 * share.high)
}

fn linear(of: &Experiment, axis: Axis) -> Judged {
    if !of.machine.tsc_invariant {
        return Judged::without_a_steady_counter();
    }
    let pixels = sweeps::in_pixels(&of.table.rows);
    let of_axis: Vec<_> = of.sweeps.iter().chain(&pixels).filter(|sweep| sweep.axis == axis).collect();
    if of_axis.is_empty() {
        return Judged::not_measured();
    }
    let (unit, pixels_each) = match axis {
        Axis::Pixels => ("per pixel", 1.0),
        Axis::Objects => ("per object and pixel", f64::from(sweeps::SIZE.0) * f64::from(sweeps::SIZE.1)),
        Axis::Lights => ("per light and pixel", f64::from(sweeps::SIZE.0) * f64::from(sweeps::SIZE.1)),
    };
    let in_words = |sweep: &&sweeps::Sweep| {
        let cycles = sweep.line.slope / pixels_each;
        format!("`{}` {cycles:.1} cycles {unit}, residual {} %", sweep.engine, percent(sweep.residual))
    };
    let figure = of_axis.iter().map(in_words).collect::<Vec<_>>().join("; ");
    if axis == Axis::Pixels && one_run(&of.table) {
        return Judged::new(Verdict::TooFewRuns, format!("{figure}, but of one run, which has no spread"));
    }
    let straight = |sweep: &&sweeps::Sweep| {
        let grows = if sweep.line.slope > 0.0 { Verdict::Reproduced } else { Verdict::NotReproduced };
        Verdict::at_most(sweep.residual, STRAIGHT).and(grows)
    };
    Judged::new(of_axis.iter().map(straight).fold(Verdict::Reproduced, Verdict::and), figure)
}

/// What calls cost in the paper's SIMD and in the C, as ratios of the times with calls and without,
/// and their share of the factor between the C that calls its functions and the SIMD.
struct Calls {
    simd: Estimate,
    c: Estimate,
    share: Estimate,
    /// The factor between the C that calls its functions and the SIMD.
    whole: Estimate,
}

impl Calls {
    fn of(rungs: &[Rung]) -> Option<Self> {
        let c = ratio(rungs, "sqrtf", "inlined")?;
        let others = [("c, called", "sqrtf"), ("inlined", "lean"), ("lean", "paper")];
        let others = others.into_iter().map(|(a, b)| ratio(rungs, a, b)).collect::<Option<Vec<_>>>()?;
        let product = |end: fn(&Estimate) -> f64| others.iter().map(end).product::<f64>();
        // Without a factor to explain, calls have no share of it.
        let share = |calls: f64, others: f64| match calls * others {
            whole if whole > 1.0 => calls.ln() / whole.ln(),
            _ => f64::NAN,
        };
        let share = Estimate {
            value: share(c.value, product(|other| other.value)),
            low: share(c.low, product(|other| other.high)),
            high: share(c.high, product(|other| other.low)),
        };
        let [simd, whole] = ["paper, called", "c, called"].map(|rung| ratio(rungs, rung, "paper"));
        Some(Calls { simd: simd?, c, share, whole: whole? })
    }
}

fn macros_matter_little(of: &Experiment, rungs: &[Rung]) -> Judged {
    let Some(Calls { simd, c, share, whole }) = Calls::of(rungs) else { return Judged::not_measured() };
    let cost = |ratio: Estimate| format!("{:.0} %", 100.0 * (ratio.value - 1.0));
    let figure = format!(
        "calls cost the SIMD {} and the C {}; that is {} % of the factor of {:.2} between the C that calls its \
        functions and the SIMD",
        cost(simd),
        cost(c),
        percent(share),
        whole.value
    );
    let is_little = Verdict::at_most(simd.widened(of.table.noise_floor), 1.0 + MATTERS);
    Judged::new(is_little.and(Verdict::at_most(share, MATTERS)), figure)
}

fn macros_explain(rungs: &[Rung]) -> Judged {
    let Some(Calls { c, share, whole, .. }) = Calls::of(rungs) else { return Judged::not_measured() };
    // Three of four lanes in use explain a factor of 3; the claim is about the rest.
    let beyond = Estimate { value: whole.value / LANES, low: whole.low / LANES, high: whole.high / LANES };
    let figure = format!(
        "beyond the {LANES} of its lanes there is a factor of {:.2} to explain; calls are {:.2} ({} % of the factor of \
        {:.2} between the C that calls its functions and the SIMD)",
        beyond.value,
        c.value,
        percent(share),
        whole.value,
    );
    // If the rest is no more than 1, nothing remains to be explained, and calls have no share of
    // it. Where only an end of the interval is no more than 1, the share could be anything.
    let share =
        |calls: f64, beyond: f64, of_nothing: f64| if beyond > 1.0 { calls.ln() / beyond.ln() } else { of_nothing };
    let share = Estimate {
        value: share(c.value, beyond.value, 0.0),
        low: share(c.low, beyond.high, 0.0),
        high: share(c.high, beyond.low, if beyond.high > 1.0 { f64::INFINITY } else { 0.0 }),
    };
    Judged::new(Verdict::at_least(share, 0.5), figure)
}

/// The verdict on the claim that code written by hand is faster than compiled code. It compares the
/// paper's SIMD with its C compiled with the same omissions, and the packet kernel with the same
/// closed form compiled. Intrinsics are in the figure, but not in the verdict, since they too are
/// written by hand.
fn by_hand(of: &Experiment, rungs: &[Rung]) -> Judged {
    let Some(paper) = ratio(rungs, "lean", "paper") else { return Judged::not_measured() };
    let with_interval = |of: Estimate| format!("{:.2} [{:.2}, {:.2}]", of.value, of.low, of.high);
    let mut figure = format!(
        "the paper's SIMD is {} times as fast as its C, compiled with the same omissions",
        with_interval(paper)
    );
    let mut verdict = Verdict::at_least(paper.widened(of.table.noise_floor), 1.0);
    let mut has_packets = false;
    for AgainstCompiler { engine, compiled, .. } in &ladder::against_compiler(rungs) {
        if engine != ladder::WIDEST_BY_HAND {
            continue;
        }
        let Some(ratio) = ratio(rungs, compiled, engine) else { continue };
        figure += &format!("; the fastest packets {} times as fast as the {compiled}", with_interval(ratio));
        if !compiled.contains("intrinsics") {
            has_packets = true;
            verdict = verdict.and(Verdict::at_least(ratio.widened(of.table.noise_floor), 1.0));
        }
    }
    if !has_packets {
        return Judged::new(Verdict::NotTestable, format!("{figure}; no kernel of packets was compiled"));
    }
    if verdict == Verdict::TooFewRuns {
        figure +=
            &format!("; one of the intervals is not beyond the noise floor of {:.1} %", 100.0 * of.table.noise_floor);
    }
    Judged::new(verdict, figure)
}

/// The factor that the paper expects from three lanes in use.
const LANES: f64 = 3.0;

fn jumps(of: &Experiment) -> Judged {
    if !of.machine.tsc_invariant {
        return Judged::without_a_steady_counter();
    }
    match &of.jumps {
        Some(jumps) => Judged::new(jumps.are_the_cache(), jumps.figures()),
        None => Judged::not_measured(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiments::jumps;
    use crate::experiments::speedup;
    use crate::experiments::sweeps::Sweep;
    use crate::measure::Machine;
    use crate::measure::statistics::fit_line;

    /// A table in which `paper` takes 6 cycles per pixel and `c` takes 6 `c_by_simd`, with
    /// intervals of `spread` on either side.
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
            samples: [1.0 - spread, 1.0, 1.0 + spread].map(|of| of * cycles).to_vec(),
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
            runs: 3,
            asked_sizes: PAPER.len(),
            asked_runs: 3,
            taken: PreemptedCount { preempted: 0, measured: PAPER.len() },
        }
    }

    /// Rungs with these names and cycles.
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

    /// Sizes at which both engines take these `cycles` per pixel, with runs that vary by `spread`
    /// on either side, and write at `share` of the bandwidth.
    fn sweep_of_sizes(cycles: &[f64], share: f64, spread: f64) -> Jumps {
        let run = |cycles: f64, off: f64| jumps::PictureRun {
            core_cycles_per_pixel: 1.5 * cycles * off,
            bytes_per_cycle: 10.0 * share / off,
        };
        let rows = [BASELINE, CONTROL].into_iter().flat_map(|engine| {
            cycles.iter().flat_map(move |cycles| {
                [true, false].map(|touched| jumps::PictureTime {
                    engine: engine.into(),
                    touched,
                    cycles_per_pixel: *cycles,
                    clock_per_tick: 1.5,
                    core_cycles_per_pixel: 1.5 * cycles,
                    bytes_per_cycle: 10.0 * share,
                    samples: [1.0 - spread, 1.0, 1.0 + spread].map(|off| run(*cycles, off)).to_vec(),
                    ..jumps::PictureTime::default()
                })
            })
        });
        let bandwidth = jumps::Bandwidth { level: "memory".into(), bytes: 1, bytes_per_cycle: 10.0 };
        Jumps { rows: rows.collect(), bandwidth: vec![bandwidth] }
    }

    /// An experiment of which only the table was measured, on a machine with an invariant
    /// time-stamp counter.
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
            (5.1, 0.04, Verdict::TooFewRuns),
            (6.9, 0.04, Verdict::TooFewRuns),
            (4.5, 0.01, Verdict::NotReproduced),
            (12.0, 0.01, Verdict::NotReproduced),
            (6.3, 0.3, Verdict::TooFewRuns),
        ] {
            let of = alone(table(ratio, spread, 0.01));
            assert_eq!(verdict(&of, &[], "6 times"), expected, "{ratio} {spread}");
            assert!(judge(&of, &[])[0].figure.contains("about 6 is from 5 to 7, and the interval is "));
        }
    }

    #[test]
    fn the_ratio_depends_on_the_size_if_intervals_are_apart() {
        for (last, spread, runs, expected) in [
            (4.3, 0.01, 5, Verdict::Reproduced),
            (4.3, 0.1, 5, Verdict::TooFewRuns),
            (5.9, 0.01, 5, Verdict::NotReproduced),
            (5.9, 0.2, 5, Verdict::TooFewRuns),
            (4.3, 0.01, 1, Verdict::TooFewRuns),
            (5.9, 0.01, 1, Verdict::TooFewRuns),
        ] {
            let mut speedup = table(4.3, spread, 0.01);
            for row in &mut speedup.rows {
                row.samples.resize(runs, row.cycles_min);
            }
            let row = speedup.rows.last_mut().unwrap();
            (row.ratio_to_c, row.ratio_low, row.ratio_high) = (last, last * (1.0 - spread), last * (1.0 + spread));
            let found = verdict(&alone(speedup), &[], "depend on the size");
            assert_eq!(found, expected, "{last} {spread} {runs}");
        }
    }

    #[test]
    fn of_one_run_nobody_knows_the_spread() {
        let mut speedup = table(4.3, 0.0, 0.0);
        for row in &mut speedup.rows {
            row.samples.truncate(1);
        }
        let of = alone(speedup);
        for claim in ["6 times", "depend on the size", "in pixels"] {
            assert_eq!(verdict(&of, &[], claim), Verdict::TooFewRuns, "{claim}");
        }
    }

    /// Asserts that `claims`, and no others, have the verdict `instead` because of an objection,
    /// and that its reason is given with each of them and once for the whole run.
    fn none_of(of: &Experiment, rungs: &[Rung], claims: &[&str], instead: Verdict, why: &str) {
        for claim in judge(of, rungs) {
            let none = claims.iter().any(|none| claim.claim.contains(none));
            assert_eq!(claim.figure.contains(why), none, "{}: {}", claim.claim, claim.figure);
            assert!(!none || claim.verdict == instead, "{}", claim.claim);
        }
        let reasons = disturbed(of, rungs);
        assert_eq!(
            reasons.iter().filter(|reason| reason.contains(why)).count(),
            usize::from(!claims.is_empty()),
            "{reasons:?}"
        );
    }

    #[test]
    fn disturbed_figures_give_no_verdict() {
        let line = fit_line(&[(1.0, 10.0), (2.0, 20.0), (3.0, 30.0)]);
        let sweep = |axis| Sweep {
            axis,
            engine: BASELINE.into(),
            points: vec![(1.0, 10.0); 3],
            line,
            residual: Estimate::default(),
            taken: 0,
        };
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
            jumps: Some(sweep_of_sizes(&[100.0, 150.0, 250.0], 0.9, 0.01)),
            ..alone(table(6.3, 0.01, 0.01))
        };
        assert_eq!(disturbed(&clean, &rungs), Vec::<String>::new());
        let too_few = Verdict::TooFewRuns;
        none_of(&clean, &rungs, &[], too_few, "others had the core");
        // Half of the pairs being undisturbed is enough.
        for (taken, claims) in
            [(10, &[][..]), (11, &["about 6", "the size", "in pixels", "calls matter", "calls explain"])]
        {
            let mut busy = clean.clone();
            busy.table.taken = PreemptedCount { preempted: taken, measured: 20 };
            none_of(&busy, &rungs, claims, too_few, "the core in 11 of 20 pairs");
        }
        let busy: Vec<_> = rungs.iter().map(|rung| Rung { taken: vec![true, true, false], ..rung.clone() }).collect();
        none_of(
            &clean,
            &busy,
            &["calls matter", "calls explain"],
            too_few,
            "the core in 14 of 21 pictures of the ladder",
        );
        let mut busy = clean.clone();
        busy.sweeps[0].taken = 1;
        none_of(&busy, &rungs, &["in objects", "in lights"], too_few, "at 1 of 6 counts");
        let mut busy = clean;
        busy.jumps.as_mut().unwrap().rows[0].taken_share = Some(0.35);
        none_of(&busy, &rungs, &["the cache"], too_few, "the core for up to 35 %");
    }

    #[test]
    fn figures_that_disagree_are_told_without_a_verdict() {
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
            none_of(&of, &rungs, if is_apart { &claims } else { &[] }, Verdict::NotTestable, &why);
        }
    }

    #[test]
    fn what_an_interrupt_came_before_is_not_measured() {
        let of = alone(table(6.3, 0.01, 0.01));
        for claim in ["in objects", "in lights", "matter little", "explain", "by hand", "cache"] {
            assert_eq!(verdict(&of, &[], claim), Verdict::NotMeasured, "{claim}");
        }
        let mut one_size = of.clone();
        one_size.table.rows.truncate(2);
        for claim in ["depend on the size", "in pixels"] {
            assert_eq!(verdict(&of, &[], claim), Verdict::Reproduced, "{claim}");
            assert_eq!(verdict(&one_size, &[], claim), Verdict::NotMeasured, "{claim}");
        }
    }

    #[test]
    fn cycles_of_a_counter_that_is_not_invariant_are_not_testable() {
        let mut of = alone(table(6.3, 0.01, 0.01));
        of.machine.tsc_invariant = false;
        for claim in ["in pixels", "in objects", "in lights", "cache"] {
            assert_eq!(verdict(&of, &[], claim), Verdict::NotTestable, "{claim}");
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
            (10.0, Some(1.5), 0.6, Verdict::TooFewRuns),
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
    fn a_noisy_ladder_does_not_tell_what_calls_cost() {
        let table = alone(table(6.3, 0.01, 0.01));
        // In every process each rung runs at another speed.
        let noisy =
            |cycles: f64, noise: f64| [1.0 - noise, 1.0, 1.0 + noise, 1.0 + 0.5 * noise].map(|off| off * cycles);
        let of = |noise: f64| {
            let names = ["c, called", "sqrtf", "inlined", "lean", "paper", "paper, called"];
            let cycles = [90.0, 36.0, 30.0, 29.0, 10.0, 10.3];
            let rung = |(place, (name, cycles)): (usize, (&str, f64))| {
                let mut samples = noisy(cycles, noise).to_vec();
                samples.rotate_left(place % 4);
                Rung {
                    rung: name.into(),
                    threads: 1,
                    samples,
                    taken: vec![false; 4],
                    samples_per_run: 1,
                    ..Rung::default()
                }
            };
            names.into_iter().zip(cycles).enumerate().map(rung).collect::<Vec<_>>()
        };
        for (noise, little, explain) in
            [(0.005, Verdict::Reproduced, Verdict::NotReproduced), (0.5, Verdict::TooFewRuns, Verdict::TooFewRuns)]
        {
            assert_eq!(verdict(&table, &of(noise), "matter little"), little, "{noise}");
            assert_eq!(verdict(&table, &of(noise), "explain"), explain, "{noise}");
        }
    }

    #[test]
    fn cache_is_blamed_only_near_the_bandwidth_of_stores() {
        for (cycles, share, spread, expected) in [
            (&[100.0, 101.0, 102.0][..], 0.9, 0.01, Verdict::NotReproduced),
            (&[100.0, 150.0, 250.0], 0.9, 0.01, Verdict::Reproduced),
            (&[100.0, 150.0, 250.0], 0.02, 0.01, Verdict::NotReproduced),
            (&[100.0, 150.0, 250.0], 0.9, 0.5, Verdict::TooFewRuns),
            (&[100.0, 101.0, 102.0], 0.9, 0.2, Verdict::TooFewRuns),
            (&[100.0, 101.0, 102.0], 0.02, 0.2, Verdict::NotReproduced),
        ] {
            let jumps = Some(sweep_of_sizes(cycles, share, spread));
            let of = Experiment { jumps, ..alone(table(6.3, 0.01, 0.01)) };
            assert_eq!(verdict(&of, &[], "cache"), expected, "{cycles:?} {share} {spread}");
        }
    }

    #[test]
    fn a_cost_is_linear_where_its_whole_residual_is_small() {
        let line = fit_line(&[(1.0, 10.0), (2.0, 20.0), (3.0, 30.0)]);
        let of = |low: f64, high: f64| {
            let residual = Estimate { value: low, low, high };
            let sweep =
                Sweep { axis: Axis::Objects, engine: BASELINE.into(), points: Vec::new(), line, residual, taken: 0 };
            // The table's noise says nothing about the sweeps.
            let experiment = Experiment { sweeps: vec![sweep], ..alone(table(6.3, 0.01, 0.2)) };
            verdict(&experiment, &[], "in objects")
        };
        assert_eq!(of(0.01, 0.02), Verdict::Reproduced);
        assert_eq!(of(0.2, 0.3), Verdict::NotReproduced);
        assert_eq!(of(0.01, 0.3), Verdict::TooFewRuns);
    }
}
