//! What was found as a page: `docs/results/stability.md`.

use std::fmt::Write;

use super::table::{COLUMNS, costs, number, operations};
use crate::cli::essay::part;
use crate::experiments::stability::Document;
use crate::render::Engine;
use crate::scene::families::{FAMILIES, family};

/// What a student should know first, and what stands before the tables of costs and of operations.
const EXPLANATION: &str = include_str!("explanation.md");

/// The page: explanation, map, and a table for each family.
pub fn text(document: &Document) -> String {
    let mut text = part(EXPLANATION, "the page").to_owned();
    text += &families();
    let machine = &document.machine;
    let kind = if document.quick { "small pictures" } else { "at least 10⁵ rays for each value and engine" };
    let cpu = machine.cpu.as_deref().unwrap_or("an unknown CPU");
    writeln!(text, "## What was found\n\nOn {cpu}, seed {}, {kind}.\n", document.seed)
        .expect("a string takes any text");
    let absent: Vec<_> = Engine::ALL.iter().filter(|engine| !engine.usable()).map(|engine| engine.name()).collect();
    if !absent.is_empty() {
        writeln!(text, "This machine does not run {}, whose limits are checked where it runs.\n", absent.join(" and "))
            .expect("a string takes any text");
    }
    text += "![Every engine on every family](stability.svg)\n\n";
    for rows in document.rows.chunk_by(|a, b| a.family == b.family) {
        let Some(family) = family(rows[0].family) else { continue };
        writeln!(text, "### {}: {}\n", family.id, family.name).expect("a string takes any text");
        let heads: Vec<_> = COLUMNS.iter().map(|(head, _)| *head).collect();
        writeln!(text, "| engine | {} | slowdown |", heads.join(" | ")).expect("a string takes any text");
        writeln!(text, "|---|{}---|", "---|".repeat(heads.len())).expect("a string takes any text");
        for row in rows {
            let cells: Vec<_> = COLUMNS.iter().map(|(_, cell)| cell(row)).collect();
            let (engine, slowdown) = (format!("`{}` {}", row.engine, row.precision), number(row.slowdown));
            writeln!(text, "| {engine} | {} | {slowdown} |", cells.join(" | ")).expect("a string takes any text");
        }
        text += "\n";
    }
    if !document.costs.is_empty() {
        text += part(EXPLANATION, "costs");
        text += &costs(&document.costs);
        text += "\n";
    }
    if !document.operations.is_empty() {
        text += part(EXPLANATION, "operations");
        text += &operations(&document.operations);
    }
    text.truncate(text.trim_end().len());
    text + "\n"
}

/// What the families are.
fn families() -> String {
    let mut text =
        "## The families\n\n| id | family | parameter | from, to | correct |\n|---|---|---|---|---|\n".to_owned();
    for family in FAMILIES {
        let (first, last) = (family.levels[0], family.levels[family.levels.len() - 1]);
        let (id, name, parameter, correct) = (family.id, family.name, family.parameter, family.correct);
        writeln!(text, "| {id} | {name} | {parameter} | {first}, {last} | {correct} |")
            .expect("a string takes any text");
    }
    text + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_in_docs_has_this_explanation_and_these_families_and_a_table_for_each() {
        let page = include_str!("../../../docs/results/stability.md");
        let beginning = part(EXPLANATION, "the page").to_owned() + &families();
        assert!(page.starts_with(&beginning), "`make stability` makes it anew");
        for family in FAMILIES {
            assert!(page.contains(&format!("### {}: {}\n", family.id, family.name)), "{}", family.id);
        }
        assert!(!page.contains("BROKEN"));
    }
}
