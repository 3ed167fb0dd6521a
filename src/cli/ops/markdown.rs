//! The document docs/results/instruction-counts.md.

use std::fmt::Write as _;

use super::table::short;
use crate::cli::essay::{filled, part};
use crate::experiments::ops::{IMPLEMENTATIONS, OPS, Report, Row};
use crate::measure::cpu_name;

/// What stands around the tables.
const EXPLANATION: &str = include_str!("explanation.md");

/// The implementations whose code the assembler fixes, and those that a compiler makes.
const ASSEMBLED: [&str; 5] = ["paper", "aos", "sse41", "avx2", "avx512"];
const COMPILED: [&str; 7] = ["c-O0", "c-O1", "c-O2", "c-O3", "c-native", "rust", "glam"];

/// The document.
pub fn text(report: &Report) -> String {
    let mut text = part(EXPLANATION, "the page").to_owned();
    assembled(&mut text, report);
    compiled(&mut text, report);
    executed(&mut text, report);
    cost(&mut text, report);
    lessons(&mut text, report);
    text
}

fn find<'a>(report: &'a Report, op: &str, implementation: &str) -> Option<&'a Row> {
    report.rows.iter().find(|row| row.op == op && row.implementation == implementation)
}

fn number(value: Option<impl ToString>) -> String {
    value.map_or("–".into(), |value| value.to_string())
}

/// Those of `names` that have any code.
fn there<'a>(report: &Report, names: &[&'a str]) -> Vec<&'a str> {
    let has = |name: &&&str| report.rows.iter().any(|row| row.implementation == **name && row.function.is_some());
    names.iter().filter(has).copied().collect()
}

fn table(text: &mut String, head: &[String], rows: impl IntoIterator<Item = Vec<String>>) {
    writeln!(text, "| {} |", head.join(" | ")).unwrap();
    writeln!(text, "|---|{}", "--:|".repeat(head.len() - 1)).unwrap();
    for row in rows {
        writeln!(text, "| {} |", row.join(" | ")).unwrap();
    }
    text.push('\n');
}

fn assembled(text: &mut String, report: &Report) {
    let names = there(report, &ASSEMBLED);
    text.push_str(part(EXPLANATION, "in assembly"));
    let head = ["operation", "printed"].into_iter().chain(names.iter().copied()).map(str::to_owned).collect::<Vec<_>>();
    let rows = OPS.iter().map(|op| {
        let mut cells = vec![op.to_string(), number(find(report, op, "printed-simd").and_then(|row| row.body))];
        cells.extend(names.iter().map(|name| {
            let row = find(report, op, name);
            let cell = row.and_then(|row| {
                let (body, function) = (row.body_mix.as_ref()?, row.function?);
                let each = match row.vectors {
                    Some(vectors) if vectors > 1 => format!(", {:.2} a vector", row.per_vector?),
                    _ => String::new(),
                };
                Some(format!("{} / {function}, {} B{each}", body.instructions, body.bytes))
            });
            number(cell)
        }));
        cells
    });
    table(text, &head, rows);
    text.push_str("| operation | critical path, `paper` | critical path, `aos` | critical path, packets with FMA |\n");
    text.push_str("|---|---|---|---|\n");
    for op in OPS {
        let path = |name| number(find(report, op, name).and_then(|row| row.critical_path.clone()));
        writeln!(text, "| {op} | {} | {} | {} |", path("paper"), path("aos"), path("avx2")).unwrap();
    }
    text.push_str("<!-- end -->\n\n");
}

fn compiled(text: &mut String, report: &Report) {
    let names = there(report, &COMPILED);
    *text += &filled(part(EXPLANATION, "by compilers"), |what| match what {
        "C" => report.compilers.cc.to_string(),
        "Rust" => report.compilers.rustc.to_string(),
        _ => unreachable!("no figure `{what}`"),
    });
    let head = ["operation", "printed"].into_iter().chain(names.iter().copied()).map(str::to_owned).collect::<Vec<_>>();
    let rows = OPS.iter().map(|op| {
        let counts = ["printed-c"].iter().chain(&names);
        let counts = counts.map(|name| number(find(report, op, name).and_then(|row| row.function)));
        std::iter::once(op.to_string()).chain(counts).collect()
    });
    table(text, &head, rows);
    text.push_str("<!-- end -->\n\n");
}

fn executed(text: &mut String, report: &Report) {
    text.push_str(part(EXPLANATION, "executed"));
    if let Some(reason) = &report.executed_unavailable {
        writeln!(text, "Not available: {reason}.\n").unwrap();
        return;
    }
    let names: Vec<_> = IMPLEMENTATIONS
        .into_iter()
        .filter(|name| report.rows.iter().any(|row| row.implementation == *name && !row.paths.is_empty()))
        .collect();
    if names.is_empty() {
        text.push_str("Not counted: `--executed` was not given.\n\n");
        return;
    }
    let head: Vec<_> = ["operation"].into_iter().chain(names.iter().copied()).map(str::to_owned).collect();
    let mut rows = Vec::new();
    for op in OPS {
        let paths = names.iter().find_map(|name| find(report, op, name).filter(|row| !row.paths.is_empty()));
        for (case, path) in paths.iter().flat_map(|row| row.paths.iter().enumerate()) {
            let several = paths.is_some_and(|row| row.paths.len() > 1);
            let label = if several { format!("{op}, {}", path.path) } else { op.into() };
            let counts = names.iter().map(|name| {
                number(find(report, op, name).and_then(|row| row.paths.get(case)).map(|path| path.executed))
            });
            rows.push(std::iter::once(label).chain(counts).collect());
        }
    }
    table(text, &head, rows);
    if !report.frames.is_empty() {
        text.push_str("The paper's picture of one sphere and one light, a ray for each pixel, by whole engines:\n\n");
        let head = ["engine", "pixels", "instructions", "per pixel and ray"].map(str::to_owned);
        let rows = report.frames.iter().map(|frame| {
            let size = format!("{}×{}", frame.width, frame.height);
            vec![frame.engine.into(), size, frame.instructions.to_string(), format!("{:.1}", frame.per_pixel)]
        });
        table(text, &head, rows);
    }
}

fn cost(text: &mut String, report: &Report) {
    let names = there(report, &[&COMPILED[..], &ASSEMBLED[..]].concat());
    let cpu = cpu_name().unwrap_or_else(|| "an unknown CPU".into());
    text.push_str(&part(EXPLANATION, "cost").replace("{CPU}", &cpu));
    let pair = |latency: Option<f64>, throughput: Option<f64>| {
        number(
            latency.zip(throughput).map(|(latency, throughput)| format!("{} / {}", short(latency), short(throughput))),
        )
    };
    let mut head = vec!["operation".to_owned()];
    let bodies: Vec<_> = names
        .iter()
        .filter(|name| report.rows.iter().any(|row| row.implementation == **name && row.cost_of == Some("body")))
        .collect();
    head.extend(bodies.iter().map(|name| format!("body of {name}")));
    head.extend(names.iter().map(|name| format!("call of {name}")));
    let rows = OPS.iter().map(|op| {
        let body = bodies.iter().map(|name| {
            let row = find(report, op, name).filter(|row| row.cost_of == Some("body"));
            pair(row.and_then(|row| row.latency), row.and_then(|row| row.throughput))
        });
        let call = names.iter().map(|name| {
            let row = find(report, op, name);
            pair(row.and_then(|row| row.call_latency), row.and_then(|row| row.call_throughput))
        });
        std::iter::once(op.to_string()).chain(body).chain(call).collect()
    });
    table(text, &head, rows);
}

/// What the figures teach, with those of this report: `{function add c-O0}` is the figure of a kind, an operation and an
/// implementation.
fn lessons(text: &mut String, report: &Report) {
    *text += &filled(part(EXPLANATION, "what it teaches"), |what| {
        let [kind, op, name] = what.split(' ').collect::<Vec<_>>()[..] else { unreachable!("no figure `{what}`") };
        let row = find(report, op, name);
        let of_body = row.filter(|row| row.cost_of == Some("body"));
        match kind {
            "function" => number(row.and_then(|row| row.function)),
            "body" => number(row.and_then(|row| row.body)),
            "executed" => number(row.and_then(|row| row.executed)),
            "latency" => number(of_body.and_then(|row| row.latency).map(short)),
            "throughput" => number(of_body.and_then(|row| row.throughput).map(short)),
            "call" => number(row.and_then(|row| row.call_throughput).map(short)),
            _ => unreachable!("no figure `{what}`"),
        }
    });
}
