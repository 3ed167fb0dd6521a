//! `rayo accuracy`: error against run time, for every engine, precision and output.

mod markdown;
mod table;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use clap::Args;

use super::measuring::{
    announce, bar, create_directory, start_threads_and_pin, stop_on_ctrl_c, tell_whether, write_results,
};
use super::{Failure, print_result};
use crate::experiments::accuracy::{self, plot, subjects};
use crate::measure::{Clock, Machine, TscClock, WallClock};

/// Scenes so few that each is shown row by row.
const FEW: usize = 8;

/// Hold every engine against exact arithmetic, and its error against its run time
///
/// The truth is computed in 256 bits. Where it is within its margin of another answer, either is right; everywhere else
/// hits, objects, t, normals, colours and 8-bit levels are compared. Rows that nothing beats in both error and time are
/// marked: they are the front. Writes accuracy.md, accuracy.svg, table.csv and results.json to the directory that --out
/// names; docs/results/accuracy.md and its figure are made by this command. Ctrl-C keeps what is finished.
#[derive(Debug, Args)]
pub struct AccuracyArgs {
    /// Scene files, or families of stiff scenes by their ids (S1 to S9, T1 to T7, X1, X2, L1, L2, I1). Default: the scenes that come
    /// with the program, and each family at three levels of stiffness
    #[arg(value_name = "SCENE")]
    scenes: Vec<String>,
    /// Small pictures and few runs: under a minute
    #[arg(long)]
    quick: bool,
    /// Where the files go
    #[arg(long, value_name = "DIR", default_value = "out/accuracy")]
    out: PathBuf,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// Measures, prints and writes.
pub fn run(args: &AccuracyArgs) -> Result<ExitCode, Failure> {
    let subjects = if args.scenes.is_empty() {
        subjects::all(args.quick)
    } else {
        let named = args.scenes.iter().map(|name| subjects::named(name, args.quick));
        named.collect::<Result<Vec<_>, _>>().map_err(Failure::input)?.concat()
    };
    if subjects.is_empty() {
        return Err(Failure::input("none of these scenes has a picture: the numbers of family N1 are not numbers"));
    }
    create_directory(&args.out)?;
    let stop = stop_on_ctrl_c()?;
    let machine = Machine::this();
    let (mut tsc, mut wall) = (TscClock::new(), WallClock::new());
    let (clock, hz, cycles): (&mut dyn Clock, f64, bool) = match (&mut tsc, machine.tsc_hz) {
        (Some(clock), Some(hz)) => (clock, hz, true),
        _ => (&mut wall, WallClock::HZ, false),
    };
    start_threads_and_pin();

    let contenders = accuracy::contenders_and_options().len();
    let seconds = accuracy::forecast_of_measure(&subjects, contenders, args.quick);
    announce(seconds, (!args.quick).then_some("--quick"));
    let bar = bar(subjects.len() as u64);
    let mut proceed = |subjects| {
        bar.inc(subjects);
        !stop.load(Ordering::Relaxed)
    };
    let document = accuracy::sweep(&subjects, args.quick, machine, clock, (hz, cycles), &mut proceed);
    let document = document.map_err(Failure::input)?;
    bar.finish_and_clear();
    if document.rows.is_empty() {
        return Err(Failure::output("stopped before the first scene was finished: there is nothing to show"));
    }
    let figure = plot::figure(&document.rows).map_err(Failure::output)?;
    let (page, csv) = (markdown::text(&document), table::csv(&document));
    let texts = [("accuracy.md", page), ("table.csv", csv), ("accuracy.svg", figure)];
    write_results(&args.out, ("results.json", &document), texts)?;
    print_result(args.json, &document, || table::text(&document, subjects.len() <= FEW))?;
    tell_whether(document.complete);
    Ok(ExitCode::SUCCESS)
}
