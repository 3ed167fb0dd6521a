//! The tables of the results, one for each family.

use crate::table::{Column, Table};
use rayo_lab::experiments::stability::cost::Cost;
use rayo_lab::experiments::stability::operations::OperationRow;
use rayo_lab::experiments::stability::{Stability, StabilityReport};
use rayo_lab::families::family;

/// The columns after those of engine and precision.
const COLUMNS: [Column<Stability>; 10] = [
    ("t, ulp", |row| number(row.worst)),
    ("of bound", |row| number(row.bound)),
    ("normal", |row| number(row.angle)),
    ("wrong hits", |row| row.wrong_hits.to_string()),
    ("holes", |row| row.holes.to_string()),
    ("off by 1", |row| row.off_by_1.to_string()),
    ("off by 2", |row| row.off_by_2.to_string()),
    ("breaks at", |row| row.breaks_at.clone().unwrap_or_else(|| "-".into())),
    ("limits", |row| if row.holds { "kept" } else { "BROKEN" }.into()),
    ("slowdown", |row| number(row.slowdown)),
];

/// The table of a family, with a row for each engine.
pub(super) fn of_family(rows: &[Stability]) -> Table {
    let mut table = Table::new(1, ["engine"].into_iter().chain(COLUMNS.map(|(head, _)| head)));
    for row in rows {
        let engine = format!("`{}` {}", row.engine, row.precision);
        table.row([engine].into_iter().chain(COLUMNS.map(|(_, cell)| cell(row))).collect());
    }
    table
}

/// A table for each family, and the limits that could be tightened.
pub fn text(document: &StabilityReport) -> String {
    let mut text = String::new();
    for rows in document.rows.chunk_by(|a, b| a.family == b.family) {
        let Some(family) = family(&rows[0].family) else { continue };
        let (first, last) = (family.levels[0], family.levels[family.levels.len() - 1]);
        text += &format!("{} {}: {}, {first} to {last}\n", family.id, family.name, family.parameter);
        text += &format!("correct: {}\n\n", family.correct);
        text += &(of_family(rows).text() + "\n");
    }
    if !document.costs.is_empty() {
        text += "The time of a stiff picture divided by that of the same picture of an ordinary scene\n\n";
        text += &(costs(&document.costs) + "\n");
    }
    if !document.operations.is_empty() {
        text += "The operations by themselves\n\n";
        text += &(operations(&document.operations) + "\n");
    }
    text + &document.tighter.iter().map(|line| format!("could be tightened: {line}\n")).collect::<String>()
}

/// The table of what ill-conditioned scenes cost, with a column for each kind.
pub(super) fn costs(costs: &[Cost]) -> String {
    let mut kinds: Vec<&str> = Vec::new();
    let mut rows: Vec<(String, Vec<&Cost>)> = Vec::new();
    for cost in costs {
        if !kinds.contains(&&*cost.stiff) {
            kinds.push(&cost.stiff);
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

/// The table of single operations.
pub(super) fn operations(rows: &[OperationRow]) -> String {
    let columns: [Column<OperationRow>; 11] = [
        ("family", |row| row.family.to_string()),
        ("operation", |row| row.operation.to_string()),
        ("engine", |row| format!("`{}` {}", row.engine, row.precision)),
        ("range", |row| format!("{} to {}", row.from, row.to)),
        ("rays", |row| row.rays.to_string()),
        ("t, ulp", |row| number(row.worst)),
        ("of bound", |row| number(row.bound)),
        ("wrong hits", |row| row.wrong_hits.to_string()),
        ("holes", |row| row.holes.map_or("-".into(), |holes| holes.to_string())),
        ("breaks at", |row| row.breaks_at.clone().unwrap_or_else(|| "-".into())),
        ("slowdown", |row| number(Some(row.slowdown))),
    ];
    Table::of(4, &columns, rows).text()
}

/// A number with three digits, or a power of ten if it is far from 1; a dash for None.
pub(super) fn number(x: Option<f64>) -> String {
    match x {
        None => "-".into(),
        Some(0.0) => "0".into(),
        Some(x) if (1e-2..1e4).contains(&x) => format!("{x:.2}"),
        Some(x) => format!("{x:.1e}"),
    }
}
