//! The tables of `rayo accuracy`: one of all rows for each scene, one that summarises all scenes,
//! and everything as CSV.

use crate::table::{Column, Table};
use rayo_lab::experiments::accuracy::plain::AgainstPlain;
use rayo_lab::experiments::accuracy::summary::{Reason, Summary, summaries};
use rayo_lab::experiments::accuracy::{Accuracy, AccuracyReport, Label};

/// A number with three digits; – for None.
pub(super) fn number(x: Option<f64>) -> String {
    match x {
        None => "–".into(),
        Some(0.0) => "0".into(),
        Some(x) if x.is_infinite() => "∞".into(),
        Some(x) if x.abs() >= 999.5 || x.abs() < 0.01 => format!("{x:.1e}"),
        Some(x) if x.abs() >= 99.5 => format!("{x:.0}"),
        Some(x) if x.abs() >= 9.95 => format!("{x:.1}"),
        Some(x) => format!("{x:.2}"),
    }
}

/// A table cell by its kind of content.
enum Cell<'a> {
    Name(&'a str),
    Word(&'a str),
    Count(usize),
    Figure(Option<f64>),
    Decibels(Option<f64>),
    Share(f64),
    /// Nanoseconds; the tables for people show microseconds.
    SetUp(f64),
    Front(bool),
}

impl Cell<'_> {
    /// The cell in a table for people.
    fn text(&self) -> String {
        match *self {
            Cell::Name(text) | Cell::Word(text) => text.into(),
            Cell::Count(count) => count.to_string(),
            Cell::Figure(figure) => number(figure),
            Cell::Decibels(psnr) => psnr.map_or("∞".into(), |psnr| format!("{psnr:.1}")),
            Cell::Share(share) => format!("{:.0} %", 100.0 * share),
            Cell::SetUp(ns) => format!("{:.1}", ns / 1e3),
            Cell::Front(front) => if front { "*" } else { "" }.into(),
        }
    }

    /// The cell in the CSV, with all digits.
    fn csv(&self) -> String {
        match *self {
            Cell::Name(name) => format!("\"{}\"", name.replace('"', "\"\"")),
            Cell::Figure(figure) | Cell::Decibels(figure) => figure.map_or_else(String::new, |x| format!("{x:e}")),
            Cell::Share(x) | Cell::SetUp(x) => format!("{x:e}"),
            Cell::Front(front) => front.to_string(),
            Cell::Word(_) | Cell::Count(_) => self.text(),
        }
    }
}

/// A column: its name in the CSV, its heading in the table of a scene (None if that table lacks the
/// column), and the content of its cells.
type CellOf = (&'static str, Option<&'static str>, fn(&Accuracy) -> Cell<'_>);

const COLUMNS: [CellOf; 37] = [
    ("scene", None, |row| Cell::Name(&row.scene)),
    ("family", None, |row| Cell::Word(row.family.as_deref().unwrap_or_default())),
    ("stiffness", None, |row| row.stiffness.map_or(Cell::Word(""), Cell::Count)),
    ("width", None, |row| Cell::Count(row.width as usize)),
    ("height", None, |row| Cell::Count(row.height as usize)),
    ("engine", Some("engine"), |row| Cell::Word(&row.who.engine)),
    ("precision", Some("precision"), |row| Cell::Word(&row.who.precision)),
    ("option", Some("option"), |row| Cell::Word(row.who.option.as_deref().unwrap_or_default())),
    ("output", Some("output"), |row| Cell::Word(&row.who.output)),
    ("rays", None, |row| Cell::Count(row.errors.rays)),
    ("hits", None, |row| Cell::Count(row.errors.hits)),
    ("in_margin", None, |row| Cell::Count(row.errors.in_margin)),
    ("wrong_hits", Some("wrong hits"), |row| Cell::Count(row.errors.wrong_hits)),
    ("wrong_hits_inside", Some("in margin"), |row| Cell::Count(row.errors.wrong_hits_inside)),
    ("wrong_objects", Some("wrong object"), |row| Cell::Count(row.errors.wrong_objects)),
    ("wrong_objects_inside", None, |row| Cell::Count(row.errors.wrong_objects_inside)),
    ("max_ulp", Some("max ulp"), |row| Cell::Figure(row.errors.max_ulp)),
    ("rms_ulp", Some("rms ulp"), |row| Cell::Figure(row.errors.rms_ulp)),
    ("p999_ulp", Some("99.9 % ulp"), |row| Cell::Figure(row.errors.p999_ulp)),
    ("bound_share", Some("of bound"), |row| Cell::Figure(row.errors.bound_share)),
    ("max_angle", Some("angle"), |row| Cell::Figure(row.errors.max_angle)),
    ("rms_angle", None, |row| Cell::Figure(row.errors.rms_angle)),
    ("max_colour", Some("max colour"), |row| Cell::Figure(row.errors.max_colour)),
    ("rms_colour", Some("rms colour"), |row| Cell::Figure(row.errors.rms_colour)),
    ("off_by_1", Some("off by 1"), |row| Cell::Count(row.errors.off_by_1)),
    ("off_by_2", Some("off by 2"), |row| Cell::Count(row.errors.off_by_2)),
    ("max_level", None, |row| Cell::Count(row.errors.max_level.into())),
    ("psnr", Some("PSNR"), |row| Cell::Decibels(row.errors.psnr)),
    ("ns_per_ray", Some("ns/ray"), |row| Cell::Figure(Some(row.ns_per_ray))),
    ("ns_per_ray_median", Some("median"), |row| Cell::Figure(Some(row.ns_per_ray_median))),
    ("spread", Some("spread"), |row| Cell::Share(row.spread)),
    ("cycles_per_ray", Some("cycles/ray"), |row| Cell::Figure(row.cycles_per_ray)),
    ("cycles_per_ray_median", None, |row| Cell::Figure(row.cycles_per_ray_median)),
    ("setup_ns", Some("set-up µs"), |row| Cell::SetUp(row.setup_ns)),
    ("runs", None, |row| Cell::Count(row.runs)),
    ("error", None, |row| Cell::Figure(Some(row.error))),
    ("front", Some("front"), |row| Cell::Front(row.front)),
];

/// The table of one scene with all its rows; rows on the Pareto front are marked.
fn scene_table(rows: &[Accuracy]) -> String {
    let columns = || COLUMNS.iter().filter_map(|(_, head, cell)| Some(((*head)?, cell)));
    let mut table = Table::new(4, columns().map(|(head, _)| head));
    rows.iter().for_each(|row| table.row(columns().map(|(_, cell)| cell(row).text()).collect()));
    table.text()
}

/// The CSV, with a line for each row.
pub(super) fn csv(document: &AccuracyReport) -> String {
    let line = |cells: Vec<String>| cells.join(",") + "\n";
    let heads = line(COLUMNS.map(|(name, ..)| name.to_owned()).to_vec());
    let rows = document.rows.iter().map(|row| line(COLUMNS.map(|(.., cell)| cell(row).csv()).to_vec()));
    heads + &rows.collect::<String>()
}

/// The table that summarises all scenes.
pub(super) fn summary_table(summaries: &[Summary]) -> String {
    let columns: [Column<Summary>; 12] = [
        ("engine", |all| all.who.engine.to_string()),
        ("precision", |all| all.who.precision.to_string()),
        ("option", |all| all.who.option.as_deref().unwrap_or_default().into()),
        ("output", |all| all.who.output.to_string()),
        ("wrong hits", |all| all.wrong_hits.to_string()),
        ("wrong object", |all| all.wrong_objects.to_string()),
        ("max ulp", |all| number(all.max_ulp)),
        ("of bound", |all| number(all.bound_share)),
        ("off by 2", |all| all.off_by_2.to_string()),
        ("max colour", |all| number(all.max_colour)),
        ("ns/ray", |all| number(Some(all.ns_per_ray))),
        ("fronts", |all| format!("{} of {}", all.fronts, all.scenes)),
    ];
    Table::of(4, &columns, summaries).text()
}

/// The run times of robust formulas relative to those of plain ones.
pub(super) fn plain_table(pairs: &[AgainstPlain]) -> String {
    let columns: [Column<AgainstPlain>; 6] = [
        ("scene", |pair| pair.scene.clone()),
        ("instructions", |pair| pair.engine.to_string()),
        ("plain, ns/ray", |pair| number(Some(pair.plain_ns_per_ray))),
        ("robust, ns/ray", |pair| number(Some(pair.robust_ns_per_ray))),
        ("robust / plain", |pair| format!("{:.3}", pair.ratio.value)),
        ("95 %", |pair| format!("{:.3} to {:.3}", pair.ratio.low, pair.ratio.high)),
    ];
    Table::of(2, &columns, pairs).text()
}

/// Why engines that are on no Pareto front are kept: one line per reason, with the engines it
/// applies to.
pub(super) fn reasons(reasons: &[Reason]) -> String {
    // An engine with its option, and its combinations of precision and output.
    type Entry = (String, Vec<String>);
    let mut of: Vec<(&str, Vec<Entry>)> = Vec::new();
    for Reason { who: Label { engine, precision, option, output }, reason } in reasons {
        let option = option.as_ref().map_or(String::new(), |option| format!(" with `{option}`"));
        let (who, what) = (format!("`{engine}`{option}"), format!("{precision} {output}"));
        let i = of.iter().position(|(other, _)| other == reason).unwrap_or_else(|| {
            of.push((reason, Vec::new()));
            of.len() - 1
        });
        match of[i].1.iter_mut().find(|(other, _)| *other == who) {
            Some((_, all)) => all.push(what),
            None => of[i].1.push((who, vec![what])),
        }
    }
    let who = |(who, what): &Entry| format!("{who} ({})", what.join(", "));
    of.iter()
        .map(|(sentence, all)| format!("- {}: {sentence}\n", all.iter().map(who).collect::<Vec<_>>().join("; ")))
        .collect()
}

/// The printed text: with `each` a table for each scene, and the summary of all scenes.
pub(super) fn text(document: &AccuracyReport, each: bool) -> String {
    let mut text = String::new();
    let scenes = document.rows.chunk_by(|a, b| a.scene == b.scene);
    let mut count = 0;
    for rows in scenes {
        count += 1;
        if each {
            let Accuracy { scene, width, height, errors, .. } = &rows[0];
            text += &format!("{scene}, {width}×{height}, {} of {} rays hit:\n\n", errors.hits, errors.rays);
            text += &scene_table(rows);
            text += "\n";
        }
    }
    if !each || count > 1 {
        text += "All scenes; ns/ray is the geometric mean:\n\n";
        text += &summary_table(&summaries(&document.rows));
        text += "\n";
    }
    text += "Wrong hits and objects, errors of t and of colours: outside of the margin, within which either answer is \
             right. * is on the front of its scene and output: nothing beats it in both error and time.\n";
    if !document.against_plain.is_empty() {
        text +=
            "\nRobust packets in single precision against the paper's plain formulas, a ray in each lane, by gcc:\n\n";
        text += &plain_table(&document.against_plain);
    }
    if !document.off_every_front.is_empty() {
        text += "\nOn no front here, and why the program has it:\n";
        text += &reasons(&document.off_every_front);
    }
    text
}
