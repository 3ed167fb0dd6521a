//! The page that compares several machines.

use maud::html;

use super::{Section, explained, figure, machine, paper};
use crate::Failure;
use crate::table::Table;
use rayo_lab::experiments::machines::{self, AgainstBound, RatioOfMachine};
use rayo_lab::experiments::report::Results;

/// The sections of the comparison. Machines are numbered, since two may have the same name.
pub fn sections(all: &[Results]) -> Result<Vec<Section>, Failure> {
    let names: Vec<String> =
        all.iter().enumerate().map(|(place, results)| format!("{}: {}", place + 1, results.machine.cpu())).collect();
    let mut ratios = Vec::new();
    for (name, results) in names.iter().zip(all) {
        if let Some(experiment) = &results.experiment {
            ratios.push(RatioOfMachine { name, estimate: experiment.table.c_by_simd });
        }
    }
    let holds = Section {
        title: "Does the paper's 6 hold?",
        id: "factor",
        content: html! {
            (explained("many"))
            (figure(|screen| machines::figure(&ratios, screen), "C/SIMD of each machine over all sizes with its interval, and the paper's range.")
                .map_err(Failure::output)?)
            (claims(all, &names).html())
        },
    };
    let shares = Section {
        title: "Where the factor comes from",
        id: "ladder",
        content: html! {
            @for (name, results) in names.iter().zip(all) {
                h3 { (name) }
                @match &results.experiment {
                    Some(document) if !document.explanations.is_empty() => { (paper::shares(&document.explanations).html()) }
                    _ => { p.absent { "Not measured: the ladder is not among these results." } }
                }
            }
        },
    };
    let speed = Section {
        title: "Cycles per pixel, relative to each machine's own bound",
        id: "bound",
        content: html! { (bounds(all, &names).html()) },
    };
    let machines = Section {
        title: "Machines and builds",
        id: "machines",
        content: html! {
            @for (name, results) in names.iter().zip(all) {
                details { summary { (name) } (machine(&results.machine)) }
            }
        },
    };
    Ok(vec![holds, shares, speed, machines])
}

/// A table with a row for each claim and a column for each machine.
fn claims(all: &[Results], names: &[String]) -> Table {
    let mut table = Table::new(usize::MAX, ["claim".to_owned()].into_iter().chain(names.iter().cloned()));
    let claims =
        all.iter().filter_map(|results| results.experiment.as_ref()).max_by_key(|document| document.verdicts.len());
    for claim in claims.iter().flat_map(|document| &document.verdicts) {
        let verdict = |results: &Results| {
            let verdicts = &results.experiment.as_ref()?.verdicts;
            Some(verdicts.iter().find(|other| other.claim == claim.claim)?.verdict.to_string())
        };
        let cells = all.iter().map(|results| verdict(results).unwrap_or_else(|| "not measured".into()));
        table.row([claim.claim.to_string()].into_iter().chain(cells).collect());
    }
    table
}

/// The cycles per pixel of each engine in the experiment's largest picture, relative to the cycles
/// that the widest stores of its pixels would take alone.
fn bounds(all: &[Results], names: &[String]) -> Table {
    let mut table =
        Table::new(3, ["machine", "engine", "picture", "cycles a pixel", "bound, cycles a pixel", "times the bound"]);
    for (name, results) in names.iter().zip(all) {
        for AgainstBound { timing: row, bound } in machines::against_bound(results) {
            let cycles = row.cycles_per_pixel();
            table.row(vec![
                name.clone(),
                format!("{}, {}", row.engine, row.output),
                format!("{}×{}", row.width, row.height),
                format!("{cycles:.2}"),
                bound.map_or("-".into(), |bound| format!("{bound:.2}")),
                bound.map_or("-".into(), |bound| format!("{:.1}", cycles / bound)),
            ]);
        }
    }
    table
}
