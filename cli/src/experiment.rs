//! `rayo experiment`: repeats the experiment of the paper's section 5 and explains the speedup that
//! it finds.

pub mod complexity;
mod one_run;
pub mod run;
pub mod table;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::Failure;
use super::number::{count, whole};
use rayo::internals::render::Engine;
use rayo_lab::experiments::speedup::Settings;

/// The most runs of a size: further ones would not narrow the confidence intervals noticeably.
const MAX_RUNS: u64 = 100_000;

/// Repeat the paper's experiment: C against SIMD and every other engine at twenty sizes, on one
/// core
///
/// Prints a verdict for each of the paper's claims, and with --full its table beside ours and what
/// the verdicts rest on. Writes table.csv, table.md, results.json, figure2.svg and ratio.svg, with
/// --ladder also ladder.svg, and with --complexity complexity.md, .csv, .json and .svg, to the
/// directory of --out. Ctrl-C keeps what is finished.
#[derive(Debug, Default, Args)]
#[command(after_help = "Examples:
  rayo experiment --quick
  rayo experiment --ladder --full
  rayo experiment --engines rust,avx2 --runs 50 --out out/avx2")]
pub struct ExperimentArgs {
    /// Five sizes and five runs of each: well under a minute
    #[arg(long)]
    quick: bool,
    /// Climb from the paper's C to the fastest engine, one change at a time
    #[arg(long)]
    ladder: bool,
    /// Measure instead how the packets' time grows, up to 100 million pixels, ten million objects,
    /// and 64 lights
    #[arg(long, conflicts_with_all = ["ladder", "full"])]
    complexity: bool,
    /// Runs of each size. Default: 25, as in the paper, or 5 with --quick; 9 or 2 with --complexity
    #[arg(long, value_name = "N", value_parser = whole(1..=MAX_RUNS), allow_hyphen_values = true)]
    runs: Option<u64>,
    /// Engines to measure beside `c` and `paper`. Default: every one that this machine runs
    #[arg(long, value_name = "A,B", value_delimiter = ',')]
    engines: Option<Vec<String>>,
    /// Print the tables too
    #[arg(long, conflicts_with = "json")]
    full: bool,
    /// Where the files go
    #[arg(long, value_name = "DIR", default_value = "out/experiment")]
    out: PathBuf,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
    /// Measure run NUMBER alone and print it; for the processes that this command starts itself
    #[arg(long, value_name = "NUMBER", hide = true, requires = "rounds", value_parser = count, allow_hyphen_values = true)]
    one_run: Option<usize>,
    /// With --one-run: the first of its rounds of the ladder, and the one after the last
    #[arg(long, value_name = "ROUND", num_args = 2, hide = true, value_parser = count, allow_hyphen_values = true)]
    rounds: Vec<usize>,
    /// With --one-run: the core to stay on
    #[arg(long, value_name = "NUMBER", hide = true, value_parser = count, allow_hyphen_values = true)]
    core: Option<usize>,
}

impl ExperimentArgs {
    /// All of the experiment, with the ladder, for `rayo report`, which writes the files itself.
    pub fn whole(quick: bool) -> Self {
        ExperimentArgs { quick, ladder: true, ..ExperimentArgs::default() }
    }

    pub fn settings(&self) -> Result<Settings, Failure> {
        let runs = self.runs.map(|runs| runs as usize);
        Settings::new(self.quick, runs, self.engines.as_deref()).map_err(Failure::input)
    }
}

/// Measures, prints the result and writes the files; with --one-run, performs that run only.
pub fn run(args: &ExperimentArgs) -> Result<ExitCode, Failure> {
    // The two programs that the paper compares must be available.
    for engine in ["c", "paper"] {
        engine.parse::<Engine>().map_err(Failure::input)?;
    }
    match args.one_run {
        Some(number) => one_run::measure(args, number),
        None if args.complexity => complexity::run(args),
        None => run::run(args),
    }
}
