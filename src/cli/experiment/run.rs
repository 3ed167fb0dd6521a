//! Runs the experiment part by part, shows how far it is, and writes its files.

use std::fs;
use std::io::{self, Write};
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use indicatif::{ProgressBar, ProgressStyle};

use super::{ExperimentArgs, one_run, table};
use crate::cli::{Failure, print, print_json};
use crate::experiments::claims::{self, Evidence};
use crate::experiments::document::{Conditions, Document};
use crate::experiments::speedup::{self, Settings, Speedup, SpeedupError, Turn};
use crate::experiments::{jumps, ladder, plot};
use crate::kernels::sys;
use crate::measure::{Machine, Totalled, TscClock};

/// Runs of the rungs: those of a ladder, quick or not, and of the few that the claims need.
const LADDER_RUNS: usize = 101;
const FEW_RUNS: usize = 25;

pub(super) fn run(args: &ExperimentArgs) -> Result<ExitCode, Failure> {
    let settings = settings(args)?;
    let mut clock = clock()?;
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

pub(super) fn settings(args: &ExperimentArgs) -> Result<Settings, Failure> {
    let runs = args.runs.map(|runs| runs as usize);
    Settings::new(args.quick, runs, args.engines.as_deref()).map_err(Failure::input)
}

pub(super) fn clock() -> Result<TscClock, Failure> {
    TscClock::new().ok_or_else(|| Failure::input("this machine has no time-stamp counter"))
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
        (true, None) => LADDER_RUNS,
        _ => FEW_RUNS,
    };
    let cpu_time = || sys::thread_cpu_time() + sys::children_cpu_time();
    let (start, cpu) = (Instant::now(), cpu_time());
    let mut clock = Totalled::new(clock);
    let bar = bar(settings.work() + ladder::work(rung_runs) + jumps::work(quick) + claims::work(quick));
    let mut proceed = |work| {
        bar.inc(work);
        !stop.load(Ordering::Relaxed)
    };
    let (measured, ticks) = table(args, settings, &mut proceed)?;
    clock.total += ticks;
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

    let (seconds, cpu) = (start.elapsed().as_secs_f64(), (cpu_time() - cpu).as_secs_f64());
    let conditions = Conditions {
        core,
        runs: measured.runs,
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

/// The table, each run of it by a process of its own, and the ticks of all that was timed.
fn table(
    args: &ExperimentArgs,
    settings: &Settings,
    proceed: &mut speedup::Progress<'_>,
) -> Result<(Speedup, u64), Failure> {
    speedup::check(settings).map_err(failure)?;
    let (mut runs, mut total) = (Vec::new(), 0);
    let mut go_on = true;
    for number in 0..settings.runs {
        let mut finished = |index: usize, turns: &[Turn]| {
            total += turns.iter().map(|turn| turn.ticks).sum::<u64>();
            go_on = proceed(settings.work_at(index));
            go_on
        };
        runs.push(one_run::in_own_process(args, settings, number, &mut finished)?);
        if !go_on {
            break;
        }
    }
    Ok((Speedup::of(settings, &runs).map_err(failure)?, total))
}

fn write_files(directory: &Path, document: &Document) -> Result<(), Failure> {
    write_file(directory, "table.md", table::text(document, true).as_bytes())?;
    write_file(directory, "table.csv", table::csv(document).as_bytes())?;
    let json = serde_json::to_vec_pretty(document).map_err(Failure::output)?;
    write_file(directory, "results.json", &json)?;
    write_file(directory, "figure2.svg", plot::figure2(document).map_err(Failure::output)?.as_bytes())?;
    write_file(directory, "ratio.svg", plot::ratio(document).map_err(Failure::output)?.as_bytes())
}

/// The file appears whole or not at all.
fn write_file(directory: &Path, name: &str, content: &[u8]) -> Result<(), Failure> {
    let path = directory.join(name);
    let mut builder = tempfile::Builder::new();
    // A temporary file is its owner's alone; a result is as readable as any other new file.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let written = builder.tempfile_in(directory).and_then(|mut file| {
        file.write_all(content)?;
        file.persist(&path).map_err(|error| error.error)
    });
    written.map(drop).map_err(|error| Failure::output(format!("cannot write {}: {error}", path.display())))
}

/// Set when the user asks for an end; a second time ends the process at once.
fn stop_on_ctrl_c() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    let seen = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if seen.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    })
    .map_err(|error| Failure::output(format!("cannot listen for Ctrl-C: {error}")))?;
    Ok(stop)
}

/// A bar on standard error, if that is a terminal.
fn bar(length: u64) -> ProgressBar {
    let bar = ProgressBar::new(length);
    let style = ProgressStyle::with_template("{bar:40} {percent} %, {eta} left");
    bar.set_style(style.expect("the template is well formed"));
    bar
}

pub(super) fn failure(error: SpeedupError) -> Failure {
    match error {
        SpeedupError::Engine(_) | SpeedupError::Memory { .. } | SpeedupError::Threads(_) => Failure::input(error),
        SpeedupError::Picture { .. } | SpeedupError::System { .. } | SpeedupError::Nothing => Failure::output(error),
    }
}

fn say(text: &str) {
    // Nothing is lost if nobody listens.
    let _ = writeln!(io::stderr(), "{text}");
}
