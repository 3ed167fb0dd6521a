//! `rayo report`: runs all experiments, or reads the results of earlier runs, and shows them on one
//! page.

mod language;
mod page;
mod run;

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use self::language::{Language, in_language};
use super::experiment::table::summary;
use super::measuring::{create_directory, write_file};
use super::{Failure, json, print, require_assembly, say, signals};
use rayo::internals::scene::shown;
use rayo_lab::experiments::report::Results;

/// Run every experiment and put the results on one page, or make the page from the results of one
/// machine or several
///
/// Prints a verdict for each of the paper's claims. Writes report.html, a page in one file, and
/// results.json, which --from reads again, to the directory of --out. Ctrl-C makes the page of what
/// is finished; a second one ends it.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo report --quick
  rayo report --from out/report --out out/again
  rayo report --from desktop laptop --out out/both --lang es")]
pub struct ReportArgs {
    /// Few runs and small pictures: a minute or two
    #[arg(long, conflicts_with = "from")]
    quick: bool,
    /// Measure nothing, but take a machine's results from this directory; those of several are
    /// shown side by side
    #[arg(long, value_name = "DIR", num_args = 1..)]
    from: Vec<PathBuf>,
    /// The language of the page; the text inside figures stays English
    #[arg(long, value_enum, default_value_t)]
    lang: Language,
    /// Where the files go
    #[arg(long, value_name = "DIR", default_value = "out/report")]
    out: PathBuf,
}

/// Runs or reads the experiments, and writes the page.
pub fn run(args: &ReportArgs) -> Result<ExitCode, Failure> {
    let mut stopped = false;
    let machines = if args.from.is_empty() {
        require_assembly("to report on")?;
        create_directory(&args.out)?;
        let results = run::stages(args.quick, &mut stopped)?;
        write_file(&args.out, "results.json", json(&results)?.as_bytes())?;
        vec![results]
    } else {
        let read = args.from.iter().map(|directory| Results::read(directory)).collect::<Result<Vec<_>, _>>();
        read.map_err(Failure::input)?
    };
    // If results from elsewhere cannot be drawn, the input is at fault, not the output.
    let page = page::page(&machines)
        .map_err(|failure| if args.from.is_empty() { failure } else { Failure { status: 2, ..failure } })?;
    create_directory(&args.out)?;
    write_file(&args.out, "report.html", in_language(page, args.lang).as_bytes())?;
    for (stage, reason) in machines.iter().flat_map(|results| &results.missing) {
        say(&format!("warning: {stage} is not in the report, or not all of it: {reason}"));
    }
    let summaries = machines.iter().filter_map(|results| results.experiment.as_ref()).map(summary);
    print(&format!("{}\n{}\n", summaries.collect::<Vec<_>>().join("\n"), shown(args.out.join("report.html"))))?;
    Ok(if stopped { signals::code() } else { ExitCode::SUCCESS })
}
