//! Runs the stages of the experiment, shows progress, and writes the files.

use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::one_run::{self, Message};
use super::{ExperimentArgs, table};
use crate::measuring::{
    bar, cores, create_directory, failure, no_clock, pin, stop_on_signals, write_file, write_results,
};
use crate::{Failure, print_result, say};
use rayo::internals::kernels::sys;
use rayo::internals::scene::shown;
use rayo_lab::experiments::claims;
use rayo_lab::experiments::document::{Conditions, Experiment};
use rayo_lab::experiments::lab::{LabError, Progress};
use rayo_lab::experiments::speedup::{self, Settings, Speedup};
use rayo_lab::experiments::svg::Screen;
use rayo_lab::experiments::{jumps, ladder, plot, sweeps};
use rayo_lab::measure::{Machine, MachineClock};

/// The least number of rounds of the ladder, over all runs: with --ladder, and without it, where
/// only the rungs that the claims need are timed.
const LADDER_ROUNDS: usize = 250;
const FEW_ROUNDS: usize = 25;

pub(super) fn run(args: &ExperimentArgs) -> Result<ExitCode, Failure> {
    let settings = args.settings()?;
    let mut prepared = prepare()?;
    create_directory(&args.out)?;
    let stop = Arc::clone(&prepared.stop);
    let bar = bar(work(args, &settings));
    let document = measure(args, &settings, &mut prepared, &mut |work| {
        bar.inc(work);
        !stop.load(Ordering::Relaxed)
    })?;
    bar.finish_and_clear();
    write_files(&args.out, &document)?;
    print_result(args.json, &document, || table::printed(&document, args.full, &args.out))?;
    for reason in &document.disturbed {
        say(&format!("warning: {reason}"));
    }
    let Conditions { complete, runs, .. } = document.conditions;
    if complete {
        return Ok(ExitCode::SUCCESS);
    }
    let kept = format!("{runs} of {} runs, in {} sizes,", settings.runs, document.sizes().count());
    Err(interrupted(&kept, &args.out))
}

/// The failure after Ctrl-C; it says what has been kept.
pub(super) fn interrupted(kept: &str, directory: &Path) -> Failure {
    Failure::stopped(format!("stopped early: {kept} are finished and kept in {}", shown(directory)))
}

/// What every measurement needs, prepared after the arguments have been checked.
pub struct Prepared {
    pub clock: MachineClock,
    pub stop: Arc<AtomicBool>,
    pub machine: Machine,
    /// The cores that threads may run on.
    pub cores: sys::Cores,
    /// The core that this thread is pinned to.
    pub core: Option<usize>,
}

pub fn prepare() -> Result<Prepared, Failure> {
    let clock = MachineClock::counter().ok_or_else(no_clock)?;
    let stop = stop_on_signals()?;
    let machine = Machine::this();
    let cores = cores()?;
    Ok(Prepared { clock, stop, machine, cores, core: pin() })
}

/// The number of rounds of the ladder in each run.
fn rounds(args: &ExperimentArgs, settings: &Settings) -> usize {
    match (args.ladder, args.runs) {
        (true, Some(_)) => 1,
        (true, None) => LADDER_ROUNDS.div_ceil(settings.runs),
        (false, _) => FEW_ROUNDS.div_ceil(settings.runs),
    }
}

/// The amount of work that [`measure`] does, as [`Progress`] counts it.
pub fn work(args: &ExperimentArgs, settings: &Settings) -> u64 {
    let of_rungs = (settings.runs * rounds(args, settings)) as u64 * ladder::WORK;
    settings.work() + of_rungs + jumps::work(args.quick) + sweeps::work(args.quick)
}

/// Measures the stages one after the other, until `proceed` returns false.
pub fn measure(
    args: &ExperimentArgs,
    settings: &Settings,
    prepared: &mut Prepared,
    mut proceed: &mut Progress<'_>,
) -> Result<Experiment, Failure> {
    let Prepared { clock, stop, machine, cores, core } = prepared;
    let (machine, core) = (machine.clone(), *core);
    let (quick, rounds) = (args.quick, rounds(args, settings));
    let cpu_time = || sys::thread_cpu_time() + sys::Usage::of_children().cpu_time;
    let (start, cpu, ticks) = (Instant::now(), cpu_time(), clock.total);
    speedup::check(settings).map_err(failure)?;
    let instructions = ladder::check(args.ladder, cores, &mut proceed).map_err(failure)?;
    let measured = runs(args, settings, core, cores, rounds, &mut proceed)?;
    clock.total += measured.ticks;
    let of_rungs = measured.rungs;
    let measured = Speedup::of(settings, &measured.sizes).map_err(|error| match error {
        LabError::Nothing if stop.load(Ordering::Relaxed) => Failure::stopped(error.to_string()),
        error => failure(error),
    })?;
    let mut complete = measured.complete() && of_rungs.len() == settings.runs;
    let rungs = instructions.filter(|_| complete).map(|counts| ladder::of(args.ladder, cores, &counts, &of_rungs));
    let mut sweeps = None;
    let mut jumps = None;
    if rungs.is_some() {
        sweeps = sweeps::measure(quick, clock, &mut proceed).map_err(failure)?;
    }
    if sweeps.is_some() {
        jumps = jumps::run(quick, &machine, clock, &mut proceed).map_err(failure)?;
    }
    complete &= jumps.is_some();

    let (seconds, cpu) = (start.elapsed().as_secs_f64(), (cpu_time() - cpu).as_secs_f64());
    let conditions = Conditions {
        core,
        runs: measured.runs,
        complete,
        seconds,
        timed_share: machine.tsc_hz.map(|hz| (clock.total - ticks) as f64 / hz / seconds),
        taken_share: (cpu > 0.0).then(|| (1.0 - cpu / seconds).max(0.0)),
    };
    let sweeps = sweeps.unwrap_or_default();
    let mut document = Experiment { machine, conditions, table: measured, jumps, sweeps, ..Experiment::default() };
    let rungs = rungs.unwrap_or_default();
    document.verdicts = claims::judge(&document, &rungs);
    document.disturbed = claims::disturbed(&document, &rungs);
    document.explanations = ladder::explain(&rungs);
    if args.ladder && !rungs.is_empty() {
        document.against_compiler = ladder::against_compiler(&rungs);
        document.ladder = rungs;
        document.uncounted = ladder::uncounted();
    }
    Ok(document)
}

/// What the processes of all runs measured.
#[derive(Default)]
struct MeasuredRuns {
    sizes: Vec<speedup::Run>,
    rungs: Vec<ladder::Rounds>,
    /// The time that was measured, in ticks of the clock.
    ticks: u64,
}

/// Performs each run in a process of its own, with `rounds` rounds of the ladder each.
fn runs(
    args: &ExperimentArgs,
    settings: &Settings,
    core: Option<usize>,
    cores: &sys::Cores,
    rounds: usize,
    proceed: &mut Progress<'_>,
) -> Result<MeasuredRuns, Failure> {
    let mut measured = MeasuredRuns::default();
    let mut go_on = proceed(0);
    for number in 0..settings.runs {
        if !go_on {
            break;
        }
        let of_ladder = number * rounds..(number + 1) * rounds;
        let mut sizes = speedup::Run::new();
        one_run::in_own_process(args, settings, number, of_ladder, core, cores, &mut |message| {
            let work = match message {
                Message::Size(turns) => {
                    measured.ticks += turns.iter().map(|turn| turn.ticks).sum::<u64>();
                    sizes.push(turns);
                    settings.work_at(sizes.len() - 1)
                }
                Message::Rungs(of_run) => {
                    measured.ticks += of_run.iter().flatten().map(|turn| turn.ticks).sum::<u64>();
                    measured.rungs.push(of_run);
                    rounds as u64 * ladder::WORK
                }
            };
            go_on = proceed(work);
            go_on
        })?;
        measured.sizes.push(sizes);
    }
    Ok(measured)
}

fn write_files(directory: &Path, document: &Experiment) -> Result<(), Failure> {
    let texts = [
        ("table.md", table::text(document)),
        ("table.csv", table::csv(document)),
        ("figure2.svg", plot::figure2(document, Screen::Wide).map_err(Failure::output)?),
        ("ratio.svg", plot::ratio(document, Screen::Wide).map_err(Failure::output)?),
    ];
    write_results(directory, "results.json", document, texts)?;
    if !document.ladder.is_empty() {
        let figure = plot::waterfall(&document.ladder, Screen::Wide).map_err(Failure::output)?;
        write_file(directory, "ladder.svg", figure.as_bytes())?;
    }
    Ok(())
}
