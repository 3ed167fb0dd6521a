//! `rayo stability`: ill-conditioned and extreme scenes, traced by every engine and checked against
//! limits in the repository.

mod markdown;
mod table;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use clap::Args;

use super::measuring::{
    announce, bar, create_directory, keep_results_apart, start_threads_and_pin, stop_on_signals, stopped_unless,
    write_results,
};
use super::number::{count, seed};
use super::{Failure, print_result, say};
use rayo::internals::render::{Engine, EngineError};
use rayo::internals::scene::{brief, shown, text_within};
use rayo_lab::experiments::stability::limits::{self, Limits};
use rayo_lab::experiments::stability::{self, Settings, StabilityReport, plot};
use rayo_lab::families::{FAMILIES, family};

/// Sweep stiff (ill-conditioned) and extreme scenes over their whole ranges, and check every engine
/// against its limits
///
/// The families are S1 to S9 (spheres), T1 to T7 (triangles), X1 and X2 (scales mixed, objects
/// twice), L1 to L3 (lights), V1 (wide films), H1 to H6 (shadows, for engines that have them), I1
/// (images) and N1 (NaN and infinity). Hits, t, normals and levels are compared with the truth in
/// 1024 bits. Writes stability.md, stability.svg, results.json and limits.csv, the tightest limits
/// that would hold, to the directory that --out names. If an engine exceeds its limits, the exit
/// status is 1, and the command that repeats the case is printed. Ctrl-C keeps what is finished.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo stability --quick
  rayo stability --family S5 --engine rust --quick
  rayo stability --family S5 --case 12")]
pub struct StabilityArgs {
    /// Sweep only this family
    #[arg(long, value_name = "NAME")]
    family: Option<String>,
    /// Sweep only this engine, in all its precisions
    #[arg(long, value_name = "E")]
    engine: Option<String>,
    /// The seed of the families' random numbers
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = seed, allow_hyphen_values = true)]
    seed: u64,
    /// Sweep only this case of the family
    #[arg(long, value_name = "K", requires = "family", value_parser = count, allow_hyphen_values = true)]
    case: Option<usize>,
    /// Check the engines against the limits in this file instead of the program's own; limits.csv
    /// among the results is such a file
    #[arg(long, value_name = "FILE")]
    limits: Option<PathBuf>,
    /// Small pictures: about a minute
    #[arg(long)]
    quick: bool,
    /// Where the files go
    #[arg(long, value_name = "DIR", default_value = "out/stability")]
    out: PathBuf,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
}

/// Sweeps the families one after the other. Calls `proceed` after each level, and ends when that
/// returns false. Then measures costs and operations.
pub fn sweep(settings: &Settings, mut proceed: impl FnMut() -> bool) -> Result<StabilityReport, Failure> {
    let (mut families, mut complete) = (Vec::new(), true);
    for family in &settings.families {
        let Some(swept) = stability::sweep(settings, family, &mut proceed).map_err(Failure::input)? else {
            complete = false;
            break;
        };
        families.push(swept);
    }
    StabilityReport::new(settings, complete, families).map_err(Failure::input)
}

/// Sweeps, prints the result and writes the files.
pub fn run(args: &StabilityArgs) -> Result<ExitCode, Failure> {
    let settings = settings(args)?;
    let results = ["stability.md", "limits.csv", "stability.svg", "results.json"];
    keep_results_apart(&args.out, &results, args.limits.as_slice())?;
    let stop = stop_on_signals()?;
    create_directory(&args.out)?;
    start_threads_and_pin();
    announce(stability::forecast(&settings), (!args.quick).then_some("--quick"));
    let bar = bar(settings.families.iter().map(|family| family.levels.len() as u64).sum());
    let proceed = || {
        bar.inc(1);
        !stop.load(Ordering::Relaxed)
    };
    let document = sweep(&settings, proceed)?;
    bar.finish_and_clear();

    let (page, limits) = (markdown::text(&document), limits::table(&document.rows));
    let figure = plot::figure(&document).map_err(Failure::output)?;
    let texts = [("stability.md", page), ("limits.csv", limits), ("stability.svg", figure)];
    write_results(&args.out, "results.json", &document, texts)?;
    print_result(args.json, &document, || table::text(&document))?;
    let verdict = verdict(&document);
    stopped_unless(document.complete)?;
    Ok(verdict)
}

/// Reports exceeded limits, with the commands that repeat the cases.
fn verdict(document: &StabilityReport) -> ExitCode {
    for row in document.rows.iter().filter(|row| !row.holds) {
        let why: Vec<_> = row.broken.iter().map(|broken| broken.why.as_str()).collect();
        say(&format!("error: {} by {} in {}: {}", row.family, row.engine, row.precision, why.join("; ")));
        for case in row.broken.iter().map(|broken| broken.case).collect::<BTreeSet<_>>() {
            say(&format!("    {}", stability::replay(&row.family, &row.engine, case, document.seed, document.quick)));
        }
    }
    if document.rows.iter().all(|row| row.holds) { ExitCode::SUCCESS } else { ExitCode::from(1) }
}

fn settings(args: &StabilityArgs) -> Result<Settings, Failure> {
    let mut settings = Settings { seed: args.seed, case: args.case, ..Settings::all(args.quick) };
    if let Some(name) = &args.family {
        let family = family(name).ok_or_else(|| {
            let ids: Vec<_> = FAMILIES.iter().map(|family| family.id).collect();
            Failure::input(format!("there is no family `{}`; there are: {}", brief(name), ids.join(", ")))
        })?;
        if let Some(case) = args.case.filter(|case| *case >= family.cases()) {
            let last = family.cases() - 1;
            return Err(Failure::input(format!("the cases of family {} are 0 to {last}, not {case}", family.id)));
        }
        settings.families = vec![family];
    }
    if let Some(name) = &args.engine {
        let engine: Engine = name.parse().map_err(Failure::input)?;
        if settings.families.iter().all(|family| family.has_shadows()) && !engine.has_shadows() {
            return Err(Failure::input(EngineError::NoShadows(engine)));
        }
        settings.contenders.retain(|contender| contender.engine == engine);
        if settings.contenders.is_empty() {
            return Err(Failure::input(rayo::internals::render::EngineError::Unusable(engine)));
        }
    }
    if let Some(path) = &args.limits {
        settings.limits = text_within(path, 1 << 20, "too many for limits")
            .map_err(|error| error.to_string())
            .and_then(|text| Limits::parse(&text))
            .map_err(|error| Failure::input(format!("{}: {error}", shown(path))))?;
    }
    Ok(settings)
}
