//! `rayo accuracy`: error against run time, for every engine, precision and output.

mod markdown;
mod table;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use clap::Args;

use super::measuring::{
    announce, bar, create_directory, keep_results_apart, start_threads_and_pin, stop_on_signals, stopped_unless,
    write_results,
};
use super::{Failure, fit, keep_standard_input_whole, print_result, terminal_width};
use rayo_lab::experiments::accuracy::subjects::Subject;
use rayo_lab::experiments::accuracy::summary::off_every_front;
use rayo_lab::experiments::accuracy::{self, AccuracyReport, Rate, plot, subjects};
use rayo_lab::measure::{Clock, Machine, MachineClock};

/// Up to this many scenes each get a table of all rows.
const FEW: usize = 8;

/// Compare every engine with exact arithmetic, and its error with its run time
///
/// The truth is computed in 1024 bits. Where the data do not decide between two answers, either is
/// right; everywhere else hits, objects, t, normals, colours and 8-bit levels are compared. Rows
/// that no other beats in both error and time form the Pareto front, and are marked. Writes
/// accuracy.md, accuracy.svg, table.csv and results.json to the directory that --out names. Ctrl-C
/// keeps what is finished.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo accuracy --quick
  rayo accuracy scenes/sphere.in scenes/many.in
  rayo accuracy S1 T3 --quick --out out/stiff")]
pub struct AccuracyArgs {
    /// Scene files, or families of stiff (ill-conditioned) scenes by their ids: S1 to S9, T1 to T7,
    /// X1, X2, L1 to L3, V1, H1 to H6, I1; N1 has no pictures to compare. Default: the scenes that
    /// come with the program, and each family without shadows at three levels
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

/// Measures the scenes one after the other. `proceed` is called with the number of scenes finished
/// since its last call; measuring ends when it returns false.
pub fn measure(
    subjects: &[Subject],
    quick: bool,
    machine: Machine,
    clock: &mut impl Clock,
    rate: Rate,
    mut proceed: impl FnMut(u64) -> bool,
) -> Result<AccuracyReport, Failure> {
    let (mut rows, mut plain, mut complete) = (Vec::new(), Vec::new(), true);
    for subject in subjects {
        let measured = accuracy::measure(subject, quick, clock, rate, &mut || proceed(0)).map_err(Failure::input)?;
        let Some(measured) = measured else {
            complete = false;
            break;
        };
        rows.extend(measured.rows);
        plain.extend(measured.against_plain);
        proceed(1);
    }
    let off_every_front = off_every_front(&rows);
    Ok(AccuracyReport { machine, complete, quick, rows, off_every_front, against_plain: plain })
}

/// Measures, prints the result and writes the files.
pub fn run(args: &AccuracyArgs) -> Result<ExitCode, Failure> {
    let subjects = if args.scenes.is_empty() {
        subjects::all(args.quick)
    } else {
        let named = args.scenes.iter().map(|name| subjects::named(name, args.quick));
        named.collect::<Result<Vec<_>, _>>().map_err(Failure::input)?.concat()
    };
    keep_standard_input_whole(&args.scenes)?;
    let results = ["accuracy.md", "table.csv", "accuracy.svg", "results.json"];
    keep_results_apart(&args.out, &results, &args.scenes)?;
    if subjects.is_empty() {
        return Err(Failure::input("none of these scenes has a picture: family N1 has values that are not numbers"));
    }
    let contenders = accuracy::contenders_and_options();
    let stop = stop_on_signals()?;
    create_directory(&args.out)?;
    let machine = Machine::this();
    let wall = (MachineClock::wall(), Rate { hz: MachineClock::WALL_HZ, of_counter: false });
    let counter = MachineClock::counter().zip(machine.tsc_hz);
    let (mut clock, rate) = counter.map_or(wall, |(clock, hz)| (clock, Rate { hz, of_counter: true }));
    start_threads_and_pin();

    let seconds = accuracy::forecast_of_measure(&subjects, contenders.len(), args.quick);
    announce(seconds, (!args.quick).then_some("--quick"));
    let bar = bar(subjects.len() as u64);
    let proceed = |subjects| {
        bar.inc(subjects);
        !stop.load(Ordering::Relaxed)
    };
    let document = measure(&subjects, args.quick, machine, &mut clock, rate, proceed)?;
    bar.finish_and_clear();
    if document.rows.is_empty() {
        return Err(Failure::stopped("stopped before the first scene was finished: there is nothing to show"));
    }
    let figure = plot::figure(&document.rows).map_err(Failure::output)?;
    let (page, csv) = (markdown::text(&document), table::csv(&document));
    let texts = [("accuracy.md", page), ("table.csv", csv), ("accuracy.svg", figure)];
    write_results(&args.out, "results.json", &document, texts)?;
    // As wide as a terminal, or 120 columns if the output is none.
    let columns = terminal_width().unwrap_or(120);
    print_result(args.json, &document, || fit::fit(&table::text(&document, subjects.len() <= FEW), columns))?;
    stopped_unless(document.complete)?;
    Ok(ExitCode::SUCCESS)
}
