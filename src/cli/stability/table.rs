//! What was found as tables: one for each family.

use std::fmt::Write;

use crate::cli::table::Table;
use crate::experiments::stability::cost::Cost;
use crate::experiments::stability::operations::OperationRow;
use crate::experiments::stability::{Document, Row};
use crate::scene::families::family;

/// The columns after engine and precision: their heads and what is below.
type Column = (&'static str, fn(&Row) -> String);

pub(super) const COLUMNS: [Column; 9] = [
    ("t, ulp", |row| number(row.worst)),
    ("of bound", |row| number(row.bound)),
    ("normal", |row| number(row.angle)),
    ("wrong hits", |row| row.wrong_hits.to_string()),
    ("holes", |row| row.holes.to_string()),
    ("off by 1", |row| row.off_by_1.to_string()),
    ("off by 2", |row| row.off_by_2.to_string()),
    ("breaks at", |row| row.breaks_at.clone().unwrap_or_else(|| "-".into())),
    ("limits", |row| if row.holds { "kept" } else { "BROKEN" }.into()),
];

/// A table for each family, and what limits could be tightened.
pub fn text(document: &Document) -> String {
    let mut text = String::new();
    for rows in document.rows.chunk_by(|a, b| a.family == b.family) {
        let Some(family) = family(rows[0].family) else { continue };
        let (first, last) = (family.levels[0], family.levels[family.levels.len() - 1]);
        let head = format!("{} {}: {}, {first} to {last}", family.id, family.name, family.parameter);
        writeln!(text, "{head}\n  correct: {}", family.correct).expect("a string takes any text");
        write!(text, "  {:<16}", "engine").expect("a string takes any text");
        for (head, _) in COLUMNS {
            write!(text, " {head:>10}").expect("a string takes any text");
        }
        writeln!(text, " {:>9}", "slowdown").expect("a string takes any text");
        for row in rows {
            write!(text, "  {:<16}", format!("{} {}", row.engine, row.precision)).expect("a string takes any text");
            for (_, cell) in COLUMNS {
                write!(text, " {:>10}", cell(row)).expect("a string takes any text");
            }
            writeln!(text, " {:>9}", number(row.slowdown)).expect("a string takes any text");
        }
        text += "\n";
    }
    if !document.costs.is_empty() {
        text += "The time of a stiff picture by that of the same picture of an ordinary scene\n\n";
        text += &costs(&document.costs);
        text += "\n";
    }
    if !document.operations.is_empty() {
        text += "The operations by themselves\n\n";
        text += &operations(&document.operations);
        text += "\n";
    }
    for line in &document.tighter {
        writeln!(text, "could be tightened: {line}").expect("a string takes any text");
    }
    text
}

/// What stiffness costs: a column for each kind of it.
pub(super) fn costs(costs: &[Cost]) -> String {
    let mut kinds: Vec<&str> = Vec::new();
    let mut rows: Vec<(String, Vec<&Cost>)> = Vec::new();
    for cost in costs {
        if !kinds.contains(&cost.stiff) {
            kinds.push(cost.stiff);
        }
        let who = format!("`{}` {} {}", cost.engine, cost.precision, cost.output);
        match rows.iter_mut().find(|(other, _)| *other == who) {
            Some((_, of)) => of.push(cost),
            None => rows.push((who, vec![cost])),
        }
    }
    let mut table = Table::new(1, ["engine"].into_iter().chain(kinds.iter().copied()));
    for (who, of) in rows {
        let ratio = |kind: &&str| {
            let cost = of.iter().find(|cost| cost.stiff == *kind);
            cost.map_or("-".into(), |cost| format!("{:.2}", cost.ratio.value))
        };
        table.row([who].into_iter().chain(kinds.iter().map(ratio)).collect());
    }
    table.text()
}

/// The operations by themselves.
pub(super) fn operations(rows: &[OperationRow]) -> String {
    let mut table = Table::new(
        4,
        [
            "family",
            "operation",
            "engine",
            "range",
            "rays",
            "t, ulp",
            "of bound",
            "wrong hits",
            "holes",
            "breaks at",
            "slowdown",
        ],
    );
    for row in rows {
        table.row(vec![
            row.family.into(),
            row.operation.into(),
            format!("`{}` {}", row.engine, row.precision),
            format!("{} to {}", row.from, row.to),
            row.rays.to_string(),
            number(row.worst),
            number(row.bound),
            row.wrong_hits.to_string(),
            row.holes.map_or("-".into(), |holes| holes.to_string()),
            row.breaks_at.clone().unwrap_or_else(|| "-".into()),
            number(Some(row.slowdown)),
        ]);
    }
    table.text()
}

/// Three digits, or a power of ten where that is far from 1; a dash for None.
pub(super) fn number(x: Option<f64>) -> String {
    match x {
        None => "-".into(),
        Some(0.0) => "0".into(),
        Some(x) if (1e-2..1e4).contains(&x) => format!("{x:.2}"),
        Some(x) => format!("{x:.1e}"),
    }
}
