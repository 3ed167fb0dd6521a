//! The tables of `rayo ops --proofs`.

use std::collections::{BTreeMap, BTreeSet};

use crate::table::Table;
use rayo_lab::experiments::prove::listing::{MacroProof, Proofs};
use rayo_lab::experiments::prove::rounding::Bound;

/// The tables of proved macros, of unproved macros with the reasons, and of proved bounds, each
/// with its number of rows.
pub fn text(proofs: &Proofs) -> String {
    let mut rows = BTreeMap::<&str, Vec<&MacroProof>>::new();
    for row in &proofs.macros {
        rows.entry(row.name).or_default().push(row);
    }
    let mut table = Table::new(1, ["macro", "form", "proofs", "paths", "lemmas"]);
    let mut others = String::new();
    let mut summary = Summary::default();
    for (name, rows) in &rows {
        let (proved, unproved): (Vec<&MacroProof>, Vec<_>) =
            rows.iter().copied().partition(|row| row.verdict == "proved");
        for row in unproved {
            others += &format!("  {name}: {}\n", row.reason.as_deref().unwrap_or_default());
        }
        let Some(paths) = proved.iter().map(|row| row.paths).max() else { continue };
        summary.add(paths);
        table.row(proved_row(name, paths, &proved));
    }
    format!(
        "Of {} macros with a twin, {} are proved to equal it for all inputs: {} by one path, {} by cases.\n\n\
         {}\nNot proved:\n{others}\nBounds of rounding errors: {}.\n\n{}",
        rows.len(),
        summary.by_one_path + summary.by_cases,
        summary.by_one_path,
        summary.by_cases,
        table.text(),
        ways(&proofs.bounds),
        bounds(&proofs.bounds).text()
    )
}

/// How many macros are proved by a single path through their machine code, and by several.
#[derive(Default)]
struct Summary {
    by_one_path: usize,
    by_cases: usize,
}

impl Summary {
    fn add(&mut self, paths: usize) {
        if paths == 1 {
            self.by_one_path += 1;
        } else {
            self.by_cases += 1;
        }
    }
}

/// The row of a macro: its forms, on which instruction sets and in which precisions it is proved,
/// and the lemmas used.
fn proved_row(name: &str, paths: usize, proved: &[&MacroProof]) -> Vec<String> {
    let forms: BTreeSet<_> = proved.iter().map(|row| row.form).collect();
    let lemmas: BTreeSet<_> = proved.iter().flat_map(|row| row.lemmas.keys().copied()).collect();
    let list = |words: BTreeSet<&str>| words.into_iter().collect::<Vec<_>>().join(", ");
    vec![name.into(), list(forms), proved.len().to_string(), paths.to_string(), list(lemmas)]
}

/// The number of bounds proved by each method.
fn ways(bounds: &[Bound]) -> String {
    let names = [("count", "by counting"), ("gappa", "by Gappa"), ("sollya", "by Sollya"), ("hand", "by hand")];
    let of_way = |(by, name): (&str, &str)| format!("{} {name}", bounds.iter().filter(|bound| bound.by == by).count());
    names.map(of_way).join(", ")
}

fn bounds(bounds: &[Bound]) -> Table {
    let mut table = Table::new(1, ["bound", "unit", "constant", "needed", "by", ""]);
    for bound in bounds {
        let digits = |number: f64| if number < 1e-3 { format!("{number:.1e}") } else { format!("{number:.4}") };
        table.row(vec![
            bound.name.into(),
            bound.unit.into(),
            digits(bound.constant),
            digits(bound.needed),
            bound.by.into(),
            if bound.holds { "holds" } else { "FAILS" }.into(),
        ]);
    }
    table
}
