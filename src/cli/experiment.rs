//! `rayo experiment`: the paper's section 5 again, its table beside ours, and where the factor comes from.

mod table;

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};

use super::{Failure, print, print_json};
use crate::experiments::document::Document;
use crate::experiments::speedup::{self, Settings, SpeedupError};
use crate::kernels::sys;
use crate::measure::{Machine, TscClock};

/// No run of this experiment says more after so many.
const MAX_RUNS: u64 = 100_000;

/// Repeat the paper's experiment: C against SIMD and every other engine at twenty sizes, on one core
///
/// Writes table.csv, table.md and results.json to the directory that --out names. Ctrl-C keeps the sizes that are
/// finished.
#[derive(Debug, Args)]
pub struct ExperimentArgs {
    /// Five sizes and five runs of each: well under a minute
    #[arg(long)]
    quick: bool,
    /// Runs of each size. Default: 25, as in the paper, or 5 with --quick
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=MAX_RUNS))]
    runs: Option<u64>,
    /// Engines beside `c` and `paper`, which are always there. Default: every one that this machine runs
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    engines: Option<Vec<String>>,
    /// Where the files go
    #[arg(long, value_name = "DIR", default_value = "out/experiment")]
    out: PathBuf,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// Measures, prints and writes.
pub fn run(args: &ExperimentArgs) -> Result<ExitCode, Failure> {
    let settings = Settings::new(args.quick, args.runs.map(|runs| runs as usize), args.engines.as_deref());
    let settings = settings.map_err(Failure::input)?;
    let mut clock = TscClock::new().ok_or_else(|| Failure::input("this machine has no time-stamp counter"))?;
    fs::create_dir_all(&args.out)
        .map_err(|error| Failure::output(format!("cannot create the directory {}: {error}", args.out.display())))?;
    let stop = stop_on_ctrl_c()?;
    let machine = Machine::this();
    let core = sys::pin_to_this_core();
    if let Err(error) = &core {
        say(&format!("warning: the thread is not pinned to a core: {error}"));
    }

    let start = Instant::now();
    let bar = bar(settings.pixels());
    let measured = speedup::run(&settings, &mut clock, &mut |pixels| {
        bar.inc(pixels);
        !stop.load(Ordering::Relaxed)
    });
    bar.finish_and_clear();
    let measured = measured.map_err(failure)?;
    let document = Document::new(measured, machine, core.ok(), settings.runs, start.elapsed().as_secs_f64());

    write_files(&args.out, &document)?;
    if args.json {
        print_json(&document)?
    } else {
        print(&table::text(&document, false))?
    }
    if !document.complete {
        say("warning: stopped early: only the sizes that were finished are in the results");
    }
    Ok(ExitCode::SUCCESS)
}

fn write_files(directory: &Path, document: &Document) -> Result<(), Failure> {
    write_file(directory, "table.md", table::text(document, true).as_bytes())?;
    write_file(directory, "table.csv", table::csv(document).as_bytes())?;
    let json = serde_json::to_vec_pretty(document).map_err(Failure::output)?;
    write_file(directory, "results.json", &json)
}

/// The file appears whole or not at all.
fn write_file(directory: &Path, name: &str, content: &[u8]) -> Result<(), Failure> {
    let path = directory.join(name);
    let written = tempfile::NamedTempFile::new_in(directory).and_then(|mut file| {
        file.write_all(content)?;
        #[cfg(unix)]
        {
            // A temporary file is its owner's alone; a result is as readable as any other new file.
            use std::os::unix::fs::PermissionsExt;
            file.as_file().set_permissions(fs::Permissions::from_mode(0o644))?;
        }
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

fn failure(error: SpeedupError) -> Failure {
    match error {
        SpeedupError::Engine(_) | SpeedupError::Memory { .. } => Failure::input(error),
        SpeedupError::Picture { .. } | SpeedupError::Nothing => Failure::output(error),
    }
}

fn say(text: &str) {
    // Nothing is lost if nobody listens.
    let _ = writeln!(io::stderr(), "{text}");
}
