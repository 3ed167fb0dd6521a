//! `rayo accuracy`: error against run time, for every engine, precision and output.

mod markdown;
mod table;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use clap::Args;

use super::measuring::{announce, bar, create_directory, keep_results_apart, stopped_unless, write_results};
use super::party::Party;
use super::{Failure, fit, print_result, terminal_width};
use crate::experiments::accuracy::subjects::Subject;
use crate::experiments::accuracy::summary::off_every_front;
use crate::experiments::accuracy::{self, AccuracyReport, Measured, Rate, plot, subjects};
use crate::measure::{Clock, Machine, MachineClock};

/// Scenes so few that each is shown row by row.
const FEW: usize = 8;

/// Compare every engine with exact arithmetic, and its error with its run time
///
/// The truth is computed in 1024 bits. Where it is within its margin of another answer, either is right; everywhere else
/// hits, objects, t, normals, colours and 8-bit levels are compared. Rows that no other beats in both error and time
/// are marked as the front. Writes accuracy.md, accuracy.svg, table.csv and results.json to the directory that --out
/// names. Ctrl-C keeps what is finished.
#[cfg_attr(feature = "mpi", doc = " Ranks of mpirun share the scenes, and there Ctrl-C keeps nothing.")]
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo accuracy --quick
  rayo accuracy scenes/sphere.in scenes/many.in
  rayo accuracy S1 T3 --quick --out out/stiff")]
pub struct AccuracyArgs {
    /// Scene files, or families of stiff (ill-conditioned) scenes by their ids: S1 to S9, T1 to T7, X1, X2, L1, L2, H1
    /// to H6, I1. Default: the scenes that come with the program, and each family without shadows at three levels
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

/// Measures every scene by whichever rank is free, until `proceed`, which is told of each, says no.
pub fn measure(
    party: &Party,
    subjects: &[Subject],
    quick: bool,
    machine: Machine,
    clock: &mut (impl Clock + Send),
    rate: Rate,
    mut proceed: impl FnMut(u64) -> bool + Send,
) -> Result<AccuracyReport, Failure> {
    let (mut rows, mut plain) = (Vec::new(), Vec::new());
    let work = |subject: usize| {
        let ask = &mut || proceed(0);
        let measured = accuracy::measure(&subjects[subject], quick, clock, rate, ask).map_err(Failure::input)?;
        if measured.is_some() {
            proceed(1);
        }
        Ok(measured)
    };
    let complete = party.cells(subjects.len(), work, |measured: Option<Measured>, cpu| {
        let Some(mut measured) = measured else { return false };
        measured.rows.iter_mut().for_each(|row| row.cpu = cpu.map(str::to_owned));
        rows.extend(measured.rows);
        plain.extend(measured.against_plain);
        true
    })?;
    let off_every_front = off_every_front(&rows);
    Ok(AccuracyReport { machine, complete, quick, rows, off_every_front, against_plain: plain })
}

/// Measures, prints and writes.
pub fn run(args: &AccuracyArgs, party: &Party) -> Result<ExitCode, Failure> {
    let subjects = if args.scenes.is_empty() {
        subjects::all(args.quick)
    } else {
        let named = args.scenes.iter().map(|name| subjects::named(name, args.quick));
        let subjects = party.agree(named.collect::<Result<Vec<_>, _>>().map_err(Failure::input))?.concat();
        subjects.iter().try_for_each(|subject| party.has_same(&subject.name, &subject.scene, "copy it"))?;
        subjects
    };
    let results = ["accuracy.md", "table.csv", "accuracy.svg", "results.json"];
    let apart = || keep_results_apart(&args.out, &results, &args.scenes);
    party.agree(party.leads().then(apart).transpose())?;
    if subjects.is_empty() {
        return Err(Failure::input("none of these scenes has a picture: the numbers of family N1 are not numbers"));
    }
    let contenders = accuracy::contenders_and_options();
    party.run_alike(&contenders.iter().map(|contender| contender.engine.name()).collect::<Vec<_>>())?;
    let stop = party.agree(party.stop_on_signals())?;
    party.agree(party.leads().then(|| create_directory(&args.out)).transpose())?;
    let machine = Machine::this();
    let wall = (MachineClock::wall(), Rate { hz: MachineClock::WALL_HZ, of_counter: false });
    let counter = MachineClock::counter().zip(machine.tsc_hz);
    let (mut clock, rate) = counter.map_or(wall, |(clock, hz)| (clock, Rate { hz, of_counter: true }));
    party.start_threads_and_pin();

    let seconds = accuracy::forecast_of_measure(&subjects, contenders.len(), args.quick) / party.count() as f64;
    announce(seconds, (!args.quick).then_some("--quick"));
    let bar = bar(subjects.len() as u64);
    bar.set_draw_target(party.bar_target(args.json)());
    let proceed = |subjects| {
        bar.inc(subjects);
        !stop.load(Ordering::Relaxed)
    };
    let document = measure(party, &subjects, args.quick, machine, &mut clock, rate, proceed)?;
    if !party.leads() {
        return Ok(ExitCode::SUCCESS);
    }
    bar.finish_and_clear();
    if document.rows.is_empty() {
        return Err(Failure::stopped("stopped before the first scene was finished: there is nothing to show"));
    }
    let figure = plot::figure(&document.rows).map_err(Failure::output)?;
    let (page, csv) = (markdown::text(&document), table::csv(&document));
    let texts = [("accuracy.md", page), ("table.csv", csv), ("accuracy.svg", figure)];
    write_results(&args.out, ("results.json", &document), texts)?;
    // On paper as on a terminal.
    let columns = terminal_width().unwrap_or(120);
    print_result(args.json, &document, || fit::fit(&table::text(&document, subjects.len() <= FEW), columns))?;
    stopped_unless(document.complete)?;
    Ok(ExitCode::SUCCESS)
}
