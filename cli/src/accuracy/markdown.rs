//! The page docs/results/accuracy.md.

use super::table::{number, plain_table, reasons, summary_table};
use crate::essay::{absent_engines, part};
use crate::table::Table;
use rayo_lab::experiments::accuracy::summary::summaries;
use rayo_lab::experiments::accuracy::{Accuracy, AccuracyReport, Label};
use rayo_lab::families::{FAMILIES, Family};

/// The text before the tables, and the text before the table of plain formulas. It must not depend
/// on the machine that was measured.
const EXPLANATION: &str = include_str!("explanation.md");

/// The whole page.
pub(super) fn text(document: &AccuracyReport) -> String {
    let rows = &document.rows;
    let mut text = part(EXPLANATION, "the page").to_owned();
    text += "## The figure\n\n![Error against time, a panel for each family](accuracy.svg)\n\n";
    text += "## All scenes together\n\n";
    text += &format!(
        "{} scenes. Counts are sums, errors the largest of any scene, times the geometric mean. {}; {}.\n\n",
        rows.chunk_by(|a, b| a.scene == b.scene).count(),
        document.machine.cpu(),
        document.machine.rustc,
    );
    text += &summary_table(&summaries(rows));
    if let Some(absent) = absent_engines() {
        text += &format!("\nThis machine does not run {absent}: that is missing from the table.\n");
    }
    text += "\nEntries that are on no front on this machine, and why the program has them:\n\n";
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
    let mut table = Table::new(usize::MAX, ["family", "what it is", "what is varied", "what is correct"]);
    for Family { id, name, parameter, correct, .. } in FAMILIES.iter().filter(|family| !family.has_shadows()) {
        if rows.iter().any(|row| row.family.as_deref() == Some(id)) {
            table.row([id, name, parameter, correct].map(|cell| (*cell).into()).to_vec());
        }
    }
    text + "\n" + &table.compact()
}

/// The columns of the table: the paper's two programs, plain Rust, the reference, and packets with
/// the most widespread instruction set.
const COLUMNS: [(&str, &str); 7] = [
    ("c", "single"),
    ("paper", "single"),
    ("rust", "single"),
    ("reference", "double"),
    ("avx2", "single"),
    ("avx2", "fast"),
    ("avx2", "double"),
];

fn scenes_table(rows: &[Accuracy]) -> String {
    let is = |row: &Accuracy, (engine, precision): (&'static str, &'static str)| {
        row.who == Label { engine: engine.into(), precision: precision.into(), option: None, output: "f32x3".into() }
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
