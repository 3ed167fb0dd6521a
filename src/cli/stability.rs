//! `rayo stability`: stiff and extreme scenes, engine by engine, against checked-in limits.

mod markdown;
mod table;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::Ordering;

use clap::Args;

use super::measuring::{announce, bar, create_directory, keep_results_apart, stopped_unless, write_results};
use super::party::Party;
use super::{Failure, print_result, say};
use crate::experiments::stability::limits::{self, Limits};
use crate::experiments::stability::{self, Settings, StabilityReport, Swept, plot};
use crate::render::{Engine, EngineError};
use crate::scene::families::{FAMILIES, family};
use crate::scene::{brief, shown, text_within};

/// Sweep stiff (ill-conditioned) and extreme scenes over their whole ranges, and hold every engine to its limits
///
/// The families are S1 to S9 (spheres), T1 to T7 (triangles), X1 and X2 (scales mixed, objects twice), L1 and L2
/// (lights), H1 to H6 (shadows, for engines that have them), I1 (images) and N1 (what is not a number). Hits, t,
/// normals and levels are compared with the truth in 1024 bits. Writes stability.md, stability.svg, results.json and
/// limits.csv, the limits that would just hold, to the directory that --out names. If an engine does not keep its
/// limits, the exit status is 1, and the command that repeats the case is printed. Ctrl-C keeps what is finished.
#[cfg_attr(feature = "mpi", doc = " Ranks of mpirun share the families, and there Ctrl-C keeps nothing.")]
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
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Sweep only this case of the family
    #[arg(long, value_name = "K", requires = "family")]
    case: Option<usize>,
    /// Hold the engines to the limits of this file instead of the program's own; limits.csv among the results is such a
    /// file
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

/// Sweeps every family by whichever rank is free, until `proceed`, which is told of each level, says no; then rank 0
/// measures the rest alone.
pub fn sweep(
    party: &Party,
    settings: &Settings,
    mut proceed: impl FnMut() -> bool + Send,
) -> Result<StabilityReport, Failure> {
    let mut families = Vec::new();
    let work = |family| stability::sweep(settings, settings.families[family], &mut proceed).map_err(Failure::input);
    let complete = party.cells(settings.families.len(), work, |swept: Option<Swept>, cpu| {
        let is_whole = swept.is_some();
        families.extend(swept.map(|swept| swept.on(cpu)));
        is_whole
    })?;
    let document = party.leads().then(|| StabilityReport::new(settings, complete, families)).transpose();
    document.map(Option::unwrap_or_default).map_err(Failure::input)
}

/// Sweeps, prints and writes.
pub fn run(args: &StabilityArgs, party: &Party) -> Result<ExitCode, Failure> {
    let settings = party.agree(settings(args))?;
    let results = ["stability.md", "limits.csv", "stability.svg", "results.json"];
    let apart = || keep_results_apart(&args.out, &results, args.limits.as_slice());
    party.agree(party.leads().then(apart).transpose())?;
    party.run_alike(&settings.contenders.iter().map(|contender| contender.engine.name()).collect::<Vec<_>>())?;
    let stop = party.agree(party.stop_on_signals())?;
    party.agree(party.leads().then(|| create_directory(&args.out)).transpose())?;
    party.start_threads_and_pin();
    announce(stability::forecast(&settings) / party.count() as f64, (!args.quick).then_some("--quick"));
    let bar = bar(settings.families.iter().map(|family| family.levels.len() as u64).sum());
    bar.set_draw_target(party.bar_target(args.json)());
    let proceed = || {
        bar.inc(1);
        !stop.load(Ordering::Relaxed)
    };
    let document = sweep(party, &settings, proceed)?;
    bar.finish_and_clear();
    if !party.leads() {
        return Ok(ExitCode::SUCCESS);
    }

    let (page, limits) = (markdown::text(&document), limits::table(&document.rows));
    let figure = plot::figure(&document).map_err(Failure::output)?;
    let texts = [("stability.md", page), ("limits.csv", limits), ("stability.svg", figure)];
    write_results(&args.out, ("results.json", &document), texts)?;
    print_result(args.json, &document, || table::text(&document))?;
    let verdict = verdict(&document);
    stopped_unless(document.complete)?;
    Ok(verdict)
}

/// Reports the limits that are not kept, with the commands that repeat the cases.
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
            return Err(Failure::input(crate::render::EngineError::Unusable(engine)));
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
