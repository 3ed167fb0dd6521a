//! Runs the experiment part by part, shows how far it is, and writes its files.

use std::fs;
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use super::{ExperimentArgs, table};
use crate::cli::measuring::{bar, say, stop_on_ctrl_c, write_file};
use crate::cli::{Failure, print, print_json};
use crate::experiments::claims::{self, Evidence};
use crate::experiments::document::{Conditions, Document};
use crate::experiments::speedup::{self, Settings, SpeedupError};
use crate::experiments::{jumps, ladder, plot};
use crate::kernels::sys;
use crate::measure::{Machine, Totalled, TscClock};

/// Runs of the rungs: those of a ladder, and of the few that the claims need.
const LADDER_RUNS: usize = 101;
const FEW_RUNS: usize = 25;

pub(super) fn run(args: &ExperimentArgs) -> Result<ExitCode, Failure> {
    let settings = Settings::new(args.quick, args.runs.map(|runs| runs as usize), args.engines.as_deref());
    let settings = settings.map_err(Failure::input)?;
    let mut clock = TscClock::new().ok_or_else(|| Failure::input("this machine has no time-stamp counter"))?;
    fs::create_dir_all(&args.out)
        .map_err(|error| Failure::output(format!("cannot create the directory {}: {error}", args.out.display())))?;
    let stop = stop_on_ctrl_c()?;
    let machine = Machine::this();
    let cores = sys::Cores::of_this_thread()
        .map_err(|error| Failure::output(format!("cannot ask for the cores of this thread: {error}")))?;
    let core = sys::pin_to_this_core();
    if let Err(error) = &core {
        say(&format!("warning: the thread is not pinned to a core: {error}"));
    }

    let document = measure(args, &settings, machine, core.ok(), &cores, &mut clock, &stop)?;
    write_files(&args.out, &document)?;
    if args.json {
        print_json(&document)?
    } else {
        print(&table::text(&document, false))?
    }
    if !document.conditions.complete {
        say("warning: stopped early: only what was finished is in the results");
    }
    Ok(ExitCode::SUCCESS)
}

/// The parts one after the other, until the user asks for an end.
fn measure(
    args: &ExperimentArgs,
    settings: &Settings,
    machine: Machine,
    core: Option<usize>,
    cores: &sys::Cores,
    clock: &mut TscClock,
    stop: &AtomicBool,
) -> Result<Document, Failure> {
    let quick = args.quick;
    let rung_runs = match (args.ladder, args.runs) {
        (true, Some(runs)) => runs as usize,
        (true, None) if !quick => LADDER_RUNS,
        _ => FEW_RUNS,
    };
    let (start, cpu) = (Instant::now(), sys::thread_cpu_time());
    let mut clock = Totalled::new(clock);
    let bar = bar(settings.work() + ladder::work(rung_runs) + jumps::work(quick) + claims::work(quick));
    let mut proceed = |work| {
        bar.inc(work);
        !stop.load(Ordering::Relaxed)
    };
    let measured = speedup::run(settings, &mut clock, &mut proceed).map_err(failure)?;
    let mut complete = measured.complete();
    let mut rungs = None;
    let mut sweeps = None;
    let mut jumps = None;
    if complete {
        rungs = ladder::run(args.ladder, rung_runs, cores, &mut clock, &mut proceed).map_err(failure)?;
    }
    if rungs.is_some() {
        sweeps = claims::sweeps(quick, &mut clock, &mut proceed).map_err(failure)?;
    }
    if sweeps.is_some() {
        jumps = jumps::run(quick, &machine, &mut clock, &mut proceed).map_err(failure)?;
    }
    complete &= jumps.is_some();
    bar.finish_and_clear();

    let (seconds, cpu) = (start.elapsed().as_secs_f64(), (sys::thread_cpu_time() - cpu).as_secs_f64());
    let conditions = Conditions {
        core,
        runs: settings.runs,
        complete,
        seconds,
        timed_share: machine.tsc_hz.map(|hz| clock.total as f64 / hz / seconds),
        taken_share: (cpu > 0.0).then(|| (1.0 - cpu / seconds).max(0.0)),
    };
    let verdicts = claims::judge(&Evidence {
        speedup: &measured,
        sweeps: sweeps.as_deref(),
        rungs: rungs.as_deref(),
        jumps: jumps.as_ref(),
        machine: &machine,
    });
    let mut document = Document::new(measured, machine, conditions);
    document.verdicts = verdicts;
    document.jumps = jumps;
    document.sweeps = sweeps.unwrap_or_default();
    if let Some(rungs) = rungs {
        document.explanations = ladder::explain(&rungs);
        if args.ladder {
            document.ladder = rungs;
            document.uncounted = ladder::uncounted();
        }
    }
    Ok(document)
}

fn write_files(directory: &Path, document: &Document) -> Result<(), Failure> {
    write_file(directory, "table.md", table::text(document, true).as_bytes())?;
    write_file(directory, "table.csv", table::csv(document).as_bytes())?;
    let json = serde_json::to_vec_pretty(document).map_err(Failure::output)?;
    write_file(directory, "results.json", &json)?;
    write_file(directory, "figure2.svg", plot::figure2(document).map_err(Failure::output)?.as_bytes())?;
    write_file(directory, "ratio.svg", plot::ratio(document).map_err(Failure::output)?.as_bytes())
}

fn failure(error: SpeedupError) -> Failure {
    match error {
        SpeedupError::Engine(_) | SpeedupError::Memory { .. } | SpeedupError::Threads(_) => Failure::input(error),
        SpeedupError::Picture { .. } | SpeedupError::System { .. } | SpeedupError::Nothing => Failure::output(error),
    }
}
