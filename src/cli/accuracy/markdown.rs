//! The document docs/results/accuracy.md.

use super::table::{number, plain_table, reasons, summary_table};
use crate::cli::essay::part;
use crate::cli::table::Table;
use crate::experiments::accuracy::summary::summaries;
use crate::experiments::accuracy::{Document, Row};
use crate::render::Engine;
use crate::scene::families;

/// What stands before the tables, no word of which depends on the machine, and before that of plain formulas.
const EXPLANATION: &str = include_str!("explanation.md");

/// All of it.
pub(super) fn text(document: &Document) -> String {
    let rows = &document.rows;
    let machine = &document.machine;
    let mut text = part(EXPLANATION, "the page").to_owned();
    text += "## The figure\n\n![Error against time, a panel for each family](accuracy.svg)\n\n";
    text += "## All scenes together\n\n";
    text += &format!(
        "{} scenes. Counts are sums, errors the largest of any scene, times the geometric mean. {}; {}.\n\n",
        rows.chunk_by(|a, b| a.scene == b.scene).count(),
        machine.cpu.as_deref().unwrap_or("an unknown CPU"),
        machine.rustc,
    );
    text += &summary_table(&summaries(rows));
    let engines: Vec<_> = Engine::ALL.iter().filter(|engine| !engine.usable()).map(|engine| engine.name()).collect();
    if !engines.is_empty() {
        text += &format!("\nThis machine does not run {}, which the table would have too.\n", engines.join(" and "));
    }
    text += "\nWhat is on no front of this machine, and why it stays:\n\n";
    text += &reasons(&document.off_every_front);
    if !document.against_plain.is_empty() {
        text += part(EXPLANATION, "plain formulas");
        text += &plain_table(&document.against_plain);
    }
    text += "\n## Every scene\n\n";
    text += "Wrong hits and objects / the largest error of t in ulp / pixels off by two levels. A family's three scenes go from \
             ordinary to the end of its range; after its name is the value of what is varied.\n\n";
    text += "<!-- errors -->\n";
    text += &scenes_table(rows);
    text += "\n| family | what it is | what is varied | what is correct |\n|---|---|---|---|\n";
    for family in families::FAMILIES.iter().filter(|family| rows.iter().any(|row| row.family == Some(family.id))) {
        text += &format!("| {} | {} | {} | {} |\n", family.id, family.name, family.parameter, family.correct);
    }
    text
}

/// The columns: the paper's two, plain Rust, the reference, and packets whose arithmetic most CPUs have.
const COLUMNS: [(&str, &str); 7] = [
    ("c", "single"),
    ("paper", "single"),
    ("rust", "single"),
    ("reference", "double"),
    ("avx2", "single"),
    ("avx2", "fast"),
    ("avx2", "double"),
];

fn scenes_table(rows: &[Row]) -> String {
    let is = |row: &Row, (engine, precision): (&str, &str)| {
        (row.engine, row.precision, row.option, row.output) == (engine, precision, None, "f32x4")
    };
    let columns: Vec<_> = COLUMNS.into_iter().filter(|column| rows.iter().any(|row| is(row, *column))).collect();
    let names = columns.iter().map(|(engine, precision)| match *precision {
        "single" | "double" if *engine != "avx2" => (*engine).to_owned(),
        precision => format!("{engine} {precision}"),
    });
    let mut table = Table::new(1, ["scene".to_owned(), "rays".into()].into_iter().chain(names));
    for of_scene in rows.chunk_by(|a, b| a.scene == b.scene) {
        let cells = columns.iter().map(|column| {
            let row = of_scene.iter().find(|row| is(row, *column));
            row.map_or("–".into(), |row| {
                let errors = &row.errors;
                let wrong = errors.wrong_hits + errors.wrong_objects;
                format!("{wrong} / {} / {}", number(errors.max_ulp), errors.off_by_2)
            })
        });
        let first = [of_scene[0].scene.clone(), of_scene[0].errors.rays.to_string()];
        table.row(first.into_iter().chain(cells).collect());
    }
    table.text()
}
