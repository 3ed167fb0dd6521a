//! The tables of `rayo ops`, in as many parts as the width of a terminal takes.

use std::fmt::Write as _;

use crate::cli::essay::{filled, part};
use crate::experiments::ops::{Counts, IMPLEMENTATIONS, OPS, Report};
use crate::measure::instructions::Mix;

/// What goes into a line of an operation.
type Cell = fn(&Counts) -> Option<String>;

const LABEL: usize = 12;

/// The heading of a column above its own, and its own.
fn heading(implementation: &str) -> (&'static str, &str) {
    match implementation.split_once('-') {
        Some(("printed", name)) => ("paper", if name == "c" { "C" } else { "SIMD" }),
        Some((_, level)) => ("C, at", level),
        None => match implementation {
            "rust" | "glam" => ("Rust", implementation),
            "paper" | "aos" => ("NASM", implementation),
            _ => ("packets", implementation),
        },
    }
}

fn width(implementation: &str) -> usize {
    if implementation.starts_with("printed") { 5 } else { 8 }
}

/// Two digits or three that mean something.
pub fn short(cycles: f64) -> String {
    if cycles < 9.95 { format!("{cycles:.1}") } else { format!("{cycles:.0}") }
}

/// Latency and throughput, where both are known.
pub fn pair(latency: Option<f64>, throughput: Option<f64>, between: &str) -> Option<String> {
    Some(format!("{}{between}{}", short(latency?), short(throughput?)))
}

/// The same of a row, where it was measured.
fn measured(row: &Counts, latency: Option<f64>, throughput: Option<f64>) -> Option<String> {
    let known = |cycles: Option<f64>| cycles.map_or("n/a".into(), short);
    row.cost_of.as_ref().map(|_| format!("{}/{}", known(latency), known(throughput)))
}

/// The whole text, in lines of some `columns` characters; `detail`: some operations alone, with kinds of instructions and
/// paths.
pub fn text(report: &Report, detail: bool, executed: bool, columns: usize) -> String {
    let has: fn(&Counts) -> bool = |row| row.body.or(row.function).is_some();
    let any =
        |name: &str, what: fn(&Counts) -> bool| report.rows.iter().any(|row| row.implementation == name && what(row));
    let (implementations, empty): (Vec<&str>, Vec<&str>) =
        IMPLEMENTATIONS.into_iter().filter(|name| any(name, |_| true)).partition(|name| any(name, has));
    let mut text = String::new();

    let mut lines: Vec<(&str, Cell)> =
        vec![("body", |row| row.body.map(|n| n.to_string())), ("function", |row| row.function.map(|n| n.to_string()))];
    if report.rows.iter().any(|row| row.vectors > Some(1)) {
        lines.push(("per vector", |row| row.per_vector.map(|n| format!("{n:.2}").trim_end_matches(".00").into())));
    }
    if executed {
        lines.push(("executed", |row| match (row.executed, row.function, &*row.implementation) {
            (Some(n), ..) => Some(n.to_string()),
            (None, Some(_), name) if !name.starts_with("printed") => Some("n/a".into()),
            _ => None,
        }));
    }
    lines.push(("body cycles", |row| {
        measured(row, row.latency, row.throughput).filter(|_| row.cost_of.as_deref() == Some("body"))
    }));
    if report.rows.iter().any(|row| row.model.is_some()) {
        lines.push(("llvm-mca", |row| row.model.as_ref().and_then(|m| pair(Some(m.cycles), Some(m.throughput), "/"))));
    }
    lines.push(("call cycles", |row| measured(row, row.call_latency, row.call_throughput)));

    let ops = || OPS.into_iter().filter(|op| report.rows.iter().any(|row| row.op == *op));
    for (number, now) in parts(&implementations, columns - LABEL.min(columns), |name| width(name)).iter().enumerate() {
        text += if number > 0 { "\n" } else { "" };
        head(&mut text, now);
        for op in ops() {
            writeln!(text, "{op}").unwrap();
            for (label, cell) in &lines {
                let row = |name: &&str| report.rows.iter().find(|row| row.op == op && row.implementation == *name);
                let cells: Vec<_> = now.iter().map(|name| row(name).and_then(cell)).collect();
                if cells.iter().any(Option::is_some) {
                    let cells = now.iter().zip(cells).map(|(name, cell)| (width(name), cell));
                    line(&mut text, &format!(" {label}"), cells);
                }
            }
        }
    }
    if detail {
        for op in ops() {
            let rows: Vec<_> = report.rows.iter().filter(|row| row.op == op).collect();
            kinds(&mut text, op, &rows, columns);
            paths(&mut text, op, &rows, columns);
        }
    }
    critical_paths(&mut text, report, columns);
    frames(&mut text, report);
    notes(&mut text, report, executed, &empty);
    text
}

fn line(text: &mut String, label: &str, cells: impl Iterator<Item = (usize, Option<String>)>) {
    let mut line = format!("{label:<LABEL$}");
    for (width, cell) in cells {
        write!(line, "{:>width$}", cell.as_deref().unwrap_or("-")).unwrap();
    }
    writeln!(text, "{}", line.trim_end()).unwrap();
}

fn head(text: &mut String, columns: &[&str]) {
    let mut last = "";
    let groups = columns.iter().map(|name| {
        let (group, _) = heading(name);
        let shown = if group == last { "" } else { group };
        last = group;
        (width(name), Some(shown.to_owned()))
    });
    line(text, "", groups.collect::<Vec<_>>().into_iter());
    line(text, "", columns.iter().map(|name| (width(name), Some(heading(name).1.to_owned()))));
}

/// Columns in parts that fit beside a label, one at least in each.
fn parts<T>(columns: &[T], most: usize, width: impl Fn(&T) -> usize) -> Vec<&[T]> {
    let mut taken = 0;
    let mut first = 0;
    let mut parts = Vec::new();
    for (at, column) in columns.iter().enumerate() {
        if at > first && taken + width(column) > most {
            parts.push(&columns[first..at]);
            (first, taken) = (at, 0);
        }
        taken += width(column);
    }
    parts.push(&columns[first..]);
    parts
}

/// A kind of instructions: its name, the width of its column, and how many there are.
type Kind = (&'static str, usize, fn(&Mix) -> usize);

const KINDS: [Kind; 12] = [
    ("all", 6, |mix| mix.instructions),
    ("bytes", 6, |mix| mix.bytes),
    ("arith", 7, |mix| mix.arithmetic),
    ("shuffle", 8, |mix| mix.shuffle),
    ("load", 6, |mix| mix.load),
    ("store", 6, |mix| mix.store),
    ("branch", 7, |mix| mix.branch),
    ("move", 6, |mix| mix.r#move),
    ("other", 6, |mix| mix.other),
    ("scalar", 8, |mix| mix.scalar),
    ("packed", 7, |mix| mix.packed),
    ("reads", 6, |mix| mix.reads),
];
/// Before them, and after the last of them.
const KINDS_LABEL: usize = 18;
const NEEDS: usize = 18;

/// The kinds of instructions of one operation.
fn kinds(text: &mut String, op: &str, rows: &[&Counts], columns: usize) {
    // Where not all fit, what an implementation needs is beside the last of them.
    let most = columns.saturating_sub(KINDS_LABEL + NEEDS);
    let parts = parts(&KINDS, most, |(_, width, _)| *width);
    for (number, part) in parts.iter().enumerate() {
        let last = number + 1 == parts.len();
        write!(text, "\n{:<KINDS_LABEL$}", if number == 0 { op } else { "" }).unwrap();
        part.iter().for_each(|(name, width, _)| write!(text, "{name:>width$}").unwrap());
        writeln!(text, "{}", if last { "  needs" } else { "" }).unwrap();
        for row in rows {
            for (what, mix) in [("body", &row.body_mix), ("function", &row.function_mix)] {
                let Some(mix) = mix else { continue };
                write!(text, "{:<KINDS_LABEL$}", format!("{} {what}", row.implementation)).unwrap();
                part.iter().for_each(|(_, width, count)| write!(text, "{:>width$}", count(mix)).unwrap());
                let needs = mix.features.iter().filter(|name| last && beyond_x86_64(name)).cloned();
                let needs = needs.collect::<Vec<_>>().join(" ");
                writeln!(text, "{}{needs}", if last { "  " } else { "" }).unwrap();
            }
        }
    }
}

/// Whether a feature is more than what every CPU of the architecture has, or at least one of its vectors. endbr64 is a nop
/// where CET_IBT is not there.
fn beyond_x86_64(feature: &str) -> bool {
    !feature.starts_with("INTEL") && !["X64", "CMOV", "MULTIBYTENOP", "CET_IBT"].contains(&feature)
}

/// Executed instructions of one operation, by path.
fn paths(text: &mut String, op: &str, rows: &[&Counts], columns: usize) {
    let Some(longest) = rows.iter().max_by_key(|row| row.paths.len()).filter(|row| row.paths.len() > 1) else {
        return;
    };
    writeln!(text, "\nexecuted in a call of {op}, by path").unwrap();
    let rows: Vec<_> = rows.iter().filter(|row| !row.paths.is_empty()).collect();
    let width = |row: &&&Counts| (row.implementation.len() + 1).max(8);
    for part in parts(&rows, columns.saturating_sub(23), width) {
        let mut heading = format!("{:<23}", "");
        for row in part {
            write!(heading, "{:>width$}", row.implementation, width = width(row)).unwrap();
        }
        writeln!(text, "{heading}").unwrap();
        for path in &longest.paths {
            write!(text, "{:<23}", path.path).unwrap();
            for row in part {
                let executed = row.paths.iter().find(|p| p.path == path.path).map(|p| p.executed.to_string());
                write!(text, "{:>width$}", executed.as_deref().unwrap_or("-"), width = width(row)).unwrap();
            }
            writeln!(text).unwrap();
        }
    }
}

/// Those that have more than one operation; implementations that share one are in one line, and the others in a last line.
fn critical_paths(text: &mut String, report: &Report, columns: usize) {
    let rows = report.rows.iter().filter_map(|row| Some((row, row.critical_path.as_ref()?)));
    let (chains, single): (Vec<_>, Vec<_>) = rows.partition(|(_, path)| path.contains("->"));
    if chains.is_empty() && single.is_empty() {
        return;
    }
    writeln!(text, "\nCritical paths").unwrap();
    for alike in chains.chunk_by(|(a, a_path), (b, b_path)| (&a.op, a_path) == (&b.op, b_path)) {
        let names: Vec<_> = alike.iter().map(|(row, _)| &*row.implementation).collect();
        let (row, path) = alike[0];
        let names = format!("  {:<10}{:<14}", row.op, names.join(", "));
        let fits = names.len() + 2 + path.len() <= columns;
        let (names, gap) = if fits { (&*names, "  ") } else { (names.trim_end(), "\n            ") };
        writeln!(text, "{names}{gap}{path}").unwrap();
    }
    let mut ops: Vec<_> = single.iter().map(|(row, _)| &*row.op).collect();
    ops.dedup();
    if !ops.is_empty() {
        writeln!(text, "  of one operation: {}", ops.join(", ")).unwrap();
    }
}

fn frames(text: &mut String, report: &Report) {
    if report.frames.is_empty() {
        return;
    }
    writeln!(text, "\nA whole picture: the paper's sphere, a ray for each pixel").unwrap();
    writeln!(text, "  {:<12}{:>10}{:>12}{:>12}{:>12}", "", "pixels", "executed", "per pixel", "per ray").unwrap();
    for frame in &report.frames {
        writeln!(
            text,
            "  {:<12}{:>10}{:>12}{:>12.1}{:>12.1}",
            frame.engine,
            format!("{}x{}", frame.width, frame.height),
            frame.instructions,
            frame.per_pixel,
            frame.per_ray
        )
        .unwrap();
    }
}

/// Whose models were asked, and for what.
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

fn notes(text: &mut String, report: &Report, executed: bool, empty: &[&str]) {
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
