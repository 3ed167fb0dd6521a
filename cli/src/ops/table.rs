//! The tables of `rayo ops`.

use std::fmt::Write as _;

use crate::essay::{filled, part};
use crate::table::{Column, Table};
use rayo_lab::experiments::ops::{Counts, FrameRow, IMPLEMENTATIONS, Path, Report};
use rayo_lab::measure::instructions::Mix;

/// A number with two or three significant digits.
pub fn short(cycles: f64) -> String {
    if cycles < 9.95 { format!("{cycles:.1}") } else { format!("{cycles:.0}") }
}

/// Latency and throughput, if both are known.
pub fn pair(latency: Option<f64>, throughput: Option<f64>, between: &str) -> Option<String> {
    Some(format!("{}{between}{}", short(latency?), short(throughput?)))
}

/// Latency and throughput of a row; None if neither was measured.
fn measured(row: &Counts, latency: Option<f64>, throughput: Option<f64>) -> Option<String> {
    let known = |cycles: Option<f64>| cycles.map_or("n/a".into(), short);
    row.cost_of.as_ref().map(|_| format!("{}/{}", known(latency), known(throughput)))
}

/// The text of a cell; a dash for None.
fn cell(value: Option<impl ToString>) -> String {
    value.map_or("-".into(), |value| value.to_string())
}

fn has_code(row: &Counts) -> bool {
    row.body.or(row.function).is_some()
}

/// The whole text; `detail` adds kinds of instructions and paths, for a selection of operations.
pub fn text(report: &Report, detail: bool, executed: bool) -> String {
    let mut text = counts(report, executed).text();
    if detail {
        writeln!(text, "\n{}", kinds(report).text().trim_end()).unwrap();
        paths(&mut text, report);
    }
    critical_paths(&mut text, report);
    if !report.frames.is_empty() {
        text += "\nA whole picture: the paper's sphere, a ray for each pixel\n\n";
        text += &Table::of(1, &FRAMES, &report.frames).text();
    }
    notes(&mut text, report, executed);
    text
}

/// The table of instruction counts and cycles of each operation in each implementation that has
/// code for it.
fn counts(report: &Report, executed: bool) -> Table {
    let mut columns: Vec<Column<Counts>> = vec![
        ("operation", |row| row.op.to_string()),
        ("by", |row| row.implementation.to_string()),
        ("body", |row| cell(row.body)),
        ("function", |row| cell(row.function)),
    ];
    if report.rows.iter().any(|row| row.vectors > Some(1)) {
        columns.push(("per vector", |row| cell(row.per_vector.map(|n| format!("{n:.2}").replace(".00", "")))));
    }
    columns.push(("proved", |row| cell(row.proved.map(|is| if is { "yes" } else { "NO" }))));
    if executed {
        columns.push(("executed", |row| match (row.executed, row.function) {
            (None, Some(_)) if !row.implementation.starts_with("printed") => "n/a".into(),
            (executed, _) => cell(executed),
        }));
    }
    columns.push(("body cycles", |row| {
        cell(measured(row, row.latency, row.throughput).filter(|_| row.cost_of.as_deref() == Some("body")))
    }));
    if report.rows.iter().any(|row| row.model.is_some()) {
        columns.push(("llvm-mca", |row| {
            cell(row.model.as_ref().and_then(|model| pair(Some(model.cycles), Some(model.throughput), "/")))
        }));
    }
    columns.push(("call cycles", |row| cell(measured(row, row.call_latency, row.call_throughput))));
    Table::of(2, &columns, report.rows.iter().filter(|row| has_code(row)))
}

/// The instructions of the body or of the whole function of an operation.
struct Code {
    op: String,
    name: String,
    mix: Mix,
}

/// The columns of the table of kinds: the number of instructions of each kind in a body or
/// function.
const KINDS: [Column<Code>; 15] = [
    ("operation", |code| code.op.clone()),
    ("code", |code| code.name.clone()),
    ("all", |code| code.mix.instructions.to_string()),
    ("bytes", |code| code.mix.bytes.to_string()),
    ("arith", |code| code.mix.arithmetic.to_string()),
    ("shuffle", |code| code.mix.shuffle.to_string()),
    ("load", |code| code.mix.load.to_string()),
    ("store", |code| code.mix.store.to_string()),
    ("branch", |code| code.mix.branch.to_string()),
    ("move", |code| code.mix.r#move.to_string()),
    ("other", |code| code.mix.other.to_string()),
    ("scalar", |code| code.mix.scalar.to_string()),
    ("packed", |code| code.mix.packed.to_string()),
    ("reads", |code| code.mix.reads.to_string()),
    ("needs", |code| {
        code.mix.features.iter().filter(|name| beyond_x86_64(name)).cloned().collect::<Vec<_>>().join(" ")
    }),
];

/// The table of the kinds of instructions of every body and function.
fn kinds(report: &Report) -> Table {
    let codes = report.rows.iter().flat_map(|row| {
        [("body", &row.body_mix), ("function", &row.function_mix)].into_iter().filter_map(|(what, mix)| {
            let name = format!("{} {what}", row.implementation);
            Some(Code { op: row.op.to_string(), name, mix: mix.clone()? })
        })
    });
    Table::of(2, &KINDS, &codes.collect::<Vec<_>>())
}

/// Whether a CPU feature is beyond the x86-64 baseline and worth naming. endbr64 counts as
/// baseline: it is a nop on CPUs without CET_IBT.
fn beyond_x86_64(feature: &str) -> bool {
    !feature.starts_with("INTEL") && !["X64", "CMOV", "MULTIBYTENOP", "CET_IBT"].contains(&feature)
}

/// Executed instructions of operations with several paths: a table with a row for each path and a
/// column for each implementation.
fn paths(text: &mut String, report: &Report) {
    for rows in report.rows.chunk_by(|a, b| a.op == b.op) {
        let Some(longest) = rows.iter().max_by_key(|row| row.paths.len()).filter(|row| row.paths.len() > 1) else {
            continue;
        };
        let rows: Vec<_> = rows.iter().filter(|row| !row.paths.is_empty()).collect();
        let mut table = Table::new(1, ["path"].into_iter().chain(rows.iter().map(|row| &*row.implementation)));
        for Path { path, .. } in &longest.paths {
            let executed = |row: &&Counts| row.paths.iter().find(|other| other.path == *path).map(|path| path.executed);
            table.row([path.to_string()].into_iter().chain(rows.iter().map(|row| cell(executed(row)))).collect());
        }
        writeln!(text, "\nexecuted in a call of {}, by path\n\n{}", longest.op, table.text().trim_end()).unwrap();
    }
}

/// The critical paths with more than one instruction. Implementations with the same path share a
/// line, and the operations whose path is a single instruction share the last line.
fn critical_paths(text: &mut String, report: &Report) {
    let rows = report.rows.iter().filter_map(|row| Some((row, row.critical_path.as_ref()?)));
    let (chains, single): (Vec<_>, Vec<_>) = rows.partition(|(_, path)| path.contains("->"));
    if chains.is_empty() && single.is_empty() {
        return;
    }
    writeln!(text, "\nCritical paths").unwrap();
    for alike in chains.chunk_by(|(a, a_path), (b, b_path)| (&a.op, a_path) == (&b.op, b_path)) {
        let names: Vec<_> = alike.iter().map(|(row, _)| &*row.implementation).collect();
        let (row, path) = alike[0];
        writeln!(text, "  {:<10}{:<14}  {path}", row.op, names.join(", ")).unwrap();
    }
    let mut ops: Vec<_> = single.iter().map(|(row, _)| &*row.op).collect();
    ops.dedup();
    if !ops.is_empty() {
        writeln!(text, "  of one operation: {}", ops.join(", ")).unwrap();
    }
}

/// The columns of the table of instructions executed for whole pictures.
const FRAMES: [Column<FrameRow>; 5] = [
    ("engine", |frame| frame.engine.to_string()),
    ("pixels", |frame| format!("{}x{}", frame.width, frame.height)),
    ("executed", |frame| frame.instructions.to_string()),
    ("per pixel", |frame| format!("{:.1}", frame.per_pixel)),
    ("per ray", |frame| format!("{:.1}", frame.per_ray)),
];

/// The CPU models that made the predictions, and for which implementations.
pub fn models(report: &Report) -> Vec<String> {
    let mut cpus: Vec<&str> = report.rows.iter().filter_map(|row| Some(&*row.model.as_ref()?.cpu)).collect();
    cpus.sort_unstable();
    cpus.dedup();
    let of = |cpu: &str| {
        let modelled = |name: &&str| {
            let by = |row: &Counts| row.model.as_ref().is_some_and(|model| model.cpu == cpu);
            report.rows.iter().any(|row| row.implementation == *name && by(row))
        };
        let names: Vec<_> = IMPLEMENTATIONS.into_iter().filter(modelled).collect();
        format!("{} by its model of {cpu}", names.join(", "))
    };
    cpus.into_iter().map(of).collect()
}

fn notes(text: &mut String, report: &Report, executed: bool) {
    let about = |name| part(include_str!("notes.txt"), name);
    *text += about("counts");
    if executed {
        *text += about("executed");
    }
    *text += about("cycles");
    if report.rows.iter().any(|row| row.model.is_some()) {
        *text += about("models");
        for cpu in models(report) {
            writeln!(text, "          {cpu}").unwrap();
        }
    }
    if let (Some(per_tick), Some(feedback)) = (report.core_cycles_per_tick, report.feedback_cycles) {
        *text += &filled(about("clock"), |what| match what {
            "cycles" => format!("{per_tick:.3}"),
            "feedback" => format!("{feedback:.2}"),
            _ => unreachable!("no figure `{what}`"),
        });
    }
    *text += about("nothing");
    let mut note = |line: &str| writeln!(text, "{line}").unwrap();
    let is_empty = |name: &&str| {
        let mut rows = report.rows.iter().filter(|row| row.implementation == *name).peekable();
        rows.peek().is_some() && !rows.any(has_code)
    };
    let empty: Vec<_> = IMPLEMENTATIONS.into_iter().filter(is_empty).collect();
    if !empty.is_empty() {
        note(&format!("          no functions of single operations in this build: {}", empty.join(", ")));
    }
    if let Some(reason) = &report.executed_unavailable {
        note(&format!("n/a       executed instructions cannot be counted here: {reason}"));
    }
    let mut reasons: Vec<_> =
        report.rows.iter().filter_map(|row| Some((&row.implementation, row.unavailable.as_ref()?))).collect();
    reasons.sort_unstable();
    reasons.dedup();
    for (implementation, reason) in reasons {
        note(&format!("n/a       {implementation}: {reason}"));
    }
    let unknown: Vec<_> = report.rows.iter().filter(|row| row.no_cycles.is_some()).collect();
    if let Some(reason) = unknown.first().and_then(|row| row.no_cycles.as_ref()) {
        let rows: Vec<_> = unknown.iter().map(|row| format!("{} {}", row.op, row.implementation)).collect();
        note(&format!("n/a       {reason}: {}", rows.join(", ")));
    }
    note(&format!("built by  {}; {}; {}", report.compilers.nasm, report.compilers.cc, report.compilers.rustc));
}
