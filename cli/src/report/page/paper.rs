//! The paper's claims and what the measurements say about them: verdicts, the paper's table and
//! figure, the ladder, and the operations.

use maud::{Markup, html};

use super::{EXPLANATION, Section, absent, engines_absent, explained, figure, partly, words};
use crate::experiment::table;
use crate::table::Table;
use rayo_lab::experiments::claims::Claim;
use rayo_lab::experiments::ladder::{Explanation, main_rungs};
use rayo_lab::experiments::ops::{self, Counts, IMPLEMENTATIONS, OPS};
use rayo_lab::experiments::plot;
use rayo_lab::experiments::report::{Results, Stage};
use rayo_lab::experiments::svg::PlotError;
use rayo_lab::experiments::verdict::Verdict;

/// The section of verdicts: a card for each claim.
pub fn verdicts(results: &Results) -> Section {
    let content = match &results.experiment {
        None => absent(results, Stage::Experiment),
        Some(document) => html! {
            (partly(results, Stage::Experiment))
            div.cards { @for claim in &document.verdicts { (card(claim)) } }
        },
    };
    Section { title: "The paper's claims", id: "claims", content }
}

fn card(Claim { claim, verdict, figure }: &Claim) -> Markup {
    let class = match verdict {
        Verdict::Reproduced => "yes",
        Verdict::NotReproduced => "no",
        Verdict::TooFewRuns | Verdict::NotMeasured | Verdict::NotTestable => "unknown",
    };
    html! {
        article.(class) {
            p.verdict { (verdict) }
            h3 { (claim) }
            p { (words(figure)) }
            @if let Some(sentence) = sentence(claim) { p.teacher { (sentence) } }
        }
    }
}

/// The explanation of a claim for students.
fn sentence(claim: &str) -> Option<&'static str> {
    let begin = format!("<!-- part: claim: {claim} -->\n");
    let (_, text) = EXPLANATION.split_once(&begin)?;
    text.lines().next()
}

/// The section of figure 2 and the table of twenty sizes.
pub fn experiment(results: &Results) -> Result<Section, PlotError> {
    let content = match &results.experiment {
        None => absent(results, Stage::Experiment),
        Some(document) => html! {
            (explained("paper"))
            (figure(|screen| plot::figure2(document, screen), "Time against pixels: C and SIMD here on the left axis, the paper's on the right one.")?)
            (figure(|screen| plot::ratio(document, screen), "C/SIMD at each size with its interval, the paper's ratios, and SIMD against itself.")?)
            details {
                summary { "The table: C and SIMD at each size, beside the paper's" }
                (table::paper_table(document).html())
            }
            details {
                summary { "Every engine: cycles per pixel, and how many times as fast as C" }
                (table::engine_table(document).html())
            }
            (engines_absent(|name| document.table.rows.iter().any(|row| row.engine == name)))
        },
    };
    Ok(Section { title: "The experiment", id: "experiment", content })
}

/// The section of the ladder: a waterfall diagram, and the share of each cause in the speedup.
pub fn ladder(results: &Results) -> Result<Section, PlotError> {
    let content = match &results.experiment {
        Some(document) if !document.ladder.is_empty() => html! {
            (explained("ladder"))
            (figure(|screen| plot::waterfall(&main_rungs(&document.ladder), screen), "TSC cycles per pixel from rung to rung, on a logarithmic scale.")?)
            @if !document.explanations.is_empty() { (shares(&document.explanations).html()) }
            details {
                summary { "All rungs, with the asides" }
                (figure(|screen| plot::waterfall(&document.ladder, screen), "TSC cycles per pixel from rung to rung, all rungs.")?)
                (table::ladder_table(document).html())
            }
        },
        _ => absent(results, Stage::Experiment),
    };
    Ok(Section { title: "Where the factor comes from", id: "ladder", content })
}

/// The table of causes, each with its share in the speedup.
pub fn shares(explanations: &[Explanation]) -> Table {
    let mut table = Table::new(3, ["from", "to", "cause", "factor", "share"]);
    for Explanation { from, to, factor, shares } in explanations {
        let mut row = |cause: &str, factor: f64, percent: f64| {
            // Adding 0 turns -0 into 0.
            let (factor, percent) = (format!("{factor:.2}"), format!("{:.0} %", percent.round() + 0.0));
            table.row(vec![from.to_string(), to.to_string(), cause.into(), factor, percent]);
        };
        shares.iter().for_each(|share| row(&share.cause, share.factor, 100.0 * share.share));
        row("all of it", *factor, 100.0);
    }
    table
}

/// The section of instruction counts, and of cycles against them.
pub fn operations(results: &Results) -> Result<Section, PlotError> {
    let content = match &results.ops {
        None => absent(results, Stage::Ops),
        Some(report) => html! {
            (explained("ops"))
            (counts(report).html())
            @if let Some(reason) = &report.executed_unavailable {
                p.absent { "Executed instructions are not counted: " (words(reason)) "." }
            }
            (explained("cycles against count"))
            (figure(|screen| ops::plot::figure(report, screen), "Cycles of an operation among independent ones, against its instructions.")?)
            details {
                summary { "The listings" }
                @for op in OPS { (listings(report, op)) }
            }
        },
    };
    Ok(Section { title: "Instructions of each operation", id: "operations", content })
}

/// A table with a row for each operation and a column for each implementation: instructions in the
/// body per vector.
fn counts(report: &ops::Report) -> Table {
    let shown = |row: &Counts| row.per_vector.or(row.body.map(|count| count as f64));
    let has = |name: &&str| report.rows.iter().any(|row| row.implementation == *name && shown(row).is_some());
    let columns: Vec<_> = IMPLEMENTATIONS.into_iter().filter(has).collect();
    let head = |name: &&str| match *name {
        "printed-c" => "the paper's C".to_owned(),
        "printed-simd" => "the paper's SIMD".to_owned(),
        name => name.to_owned(),
    };
    let mut table = Table::new(1, ["operation".to_owned()].into_iter().chain(columns.iter().map(head)));
    for op in OPS {
        let cell = |name: &&str| {
            let row = report.rows.iter().find(|row| row.op == op && row.implementation == *name);
            let count = row.and_then(shown);
            count.map_or("-".into(), |count| format!("{count:.2}").trim_end_matches(".00").to_owned())
        };
        table.row([op.to_owned()].into_iter().chain(columns.iter().map(cell)).collect());
    }
    table
}

/// The listings of an operation by the paper's macros and by the widest packets.
fn listings(report: &ops::Report, op: &str) -> Markup {
    let of_op = || report.rows.iter().filter(|row| row.op == op && !row.listing.is_empty());
    let widest = of_op().rfind(|row| ["sse41", "avx2", "avx512"].contains(&&*row.implementation));
    let rows = of_op().filter(|row| ["c-O3", "paper"].contains(&&*row.implementation)).chain(widest);
    html! {
        h4 { (op) }
        div.listings {
            @for row in rows {
                div {
                    h5 { (row.implementation) }
                    pre { @for line in &row.listing { (line.text) "\n" } }
                }
            }
        }
    }
}
