//! The page `docs/results/stability.md`.

use super::table::{costs, of_family, operations};
use crate::essay::{absent_engines, part};
use crate::table::Table;
use rayo_lab::experiments::stability::StabilityReport;
use rayo_lab::families::{FAMILIES, Family, family};

/// The introduction for students, and the texts before the tables of costs and of operations.
const EXPLANATION: &str = include_str!("explanation.md");

/// The page: introduction, map, and a table for each family.
pub fn text(document: &StabilityReport) -> String {
    let mut text = part(EXPLANATION, "the page").to_owned();
    text += &families();
    let kind = if document.quick { "small pictures" } else { "at least 10⁵ rays for each value and engine" };
    text += &format!("## What was found\n\nOn {}, seed {}, {kind}.\n\n", document.machine.cpu(), document.seed);
    if let Some(absent) = absent_engines() {
        text += &format!("This machine does not run {absent}, whose limits are checked where it runs.\n\n");
    }
    text += "![Every engine on every family](stability.svg)\n\n";
    for rows in document.rows.chunk_by(|a, b| a.family == b.family) {
        let Some(family) = family(&rows[0].family) else { continue };
        text += &format!("### {}: {}\n\n", family.id, family.name);
        text += &(of_family(rows).left(usize::MAX).compact() + "\n");
    }
    if !document.costs.is_empty() {
        text += part(EXPLANATION, "costs");
        text += &(costs(&document.costs) + "\n");
    }
    if !document.operations.is_empty() {
        text += part(EXPLANATION, "operations");
        text += &operations(&document.operations);
    }
    text.trim_end().to_owned() + "\n"
}

fn families() -> String {
    let mut table = Table::new(usize::MAX, ["id", "family", "parameter", "from, to", "correct"]);
    for Family { id, name, parameter, levels, correct, .. } in FAMILIES {
        let range = format!("{}, {}", levels[0], levels[levels.len() - 1]);
        table.row([id, name, parameter, range.as_str(), correct].map(Into::into).to_vec());
    }
    format!("## The families\n\n{}\n", table.compact())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn page_in_docs_has_every_family_and_its_table() {
        let page = include_str!("../../../docs/results/stability.md");
        let beginning = part(EXPLANATION, "the page").to_owned() + &families();
        assert!(page.starts_with(&beginning), "`make stability` makes it anew");
        for family in FAMILIES {
            assert!(page.contains(&format!("### {}: {}\n", family.id, family.name)), "{}", family.id);
        }
        assert!(!page.contains("BROKEN"));
    }
}
