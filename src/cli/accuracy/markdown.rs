//! The document docs/accuracy.md.

use super::table::{number, plain_table, reasons, summary_table};
use crate::cli::table::Table;
use crate::experiments::accuracy::summary::summaries;
use crate::experiments::accuracy::{Document, Row};
use crate::render::Engine;
use crate::scene::families;

/// What stands before the tables: no word of it depends on the machine.
const EXPLANATION: &str = include_str!("explanation.md");

/// What stands before the table of plain formulas.
const PLAIN: &str = "
## What being right costs

The plain formulas are the paper's: eq. 5 with half of b, eq. 9 and eq. 10, all in f32, with what a scene's rays share computed
once. `turned.c` has them over arrays of rays, one in each lane, and the compiler makes them for the same instructions as the
packets' (-O3 -ffast-math). Both write floats, by turns. The robust packets compute more exactly, and less: the ends of a span are
found in f64 once per row, and no ray is asked whether it hits.

A compiler's code is a weak opponent. A strong one would be the packets' own loops with the plain formulas in them. It is not there, since
nobody else would need it; counted, it would save one instruction of a packet at most. Along a row eq. 5's discriminant h² − a k is a
polynomial, two fused operations. `SPHERE_LIT`, for a sphere that is alone under one light, has a² − x² for it, a subtraction and one fused operation;
`SPHERE_DEN`, for any other, two fused operations and a product, one more of the 24 and up that such a packet takes (`SPHERE_OUTSIDE`). Eq. 9's t
is one fused operation and a division, as in `TRIANGLE_PLANE`; eq. 10 would be three edges more, which a span has behind it. The rest of what
being right costs is in the set-up of a row: f64 for f32, once for hundreds of pixels.

";

/// All of it.
pub(super) fn text(document: &Document) -> String {
    let rows = &document.rows;
    let machine = &document.machine;
    let mut text = EXPLANATION.to_owned();
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
        text += PLAIN;
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
