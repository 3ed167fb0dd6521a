//! The page docs/results/instruction-counts.md.

use super::table::{pair, short};
use crate::essay::{filled, part};
use crate::table::Table;
use rayo_lab::experiments::ops::{Counts, FrameRow, IMPLEMENTATIONS, OPS, Report};
use rayo_lab::measure::cpu_name;

/// The text around the tables.
const EXPLANATION: &str = include_str!("explanation.md");

/// The implementations that an assembler built, and those that a compiler built.
const ASSEMBLED: &[&str] = BUILT.split_at(7).1;
const COMPILED: &[&str] = BUILT.split_at(7).0;
/// All implementations except the two columns that the paper printed, of which there is no code.
const BUILT: &[&str] = IMPLEMENTATIONS.split_at(2).1;

/// The page.
pub fn text(report: &Report) -> String {
    let explanation = |name| part(EXPLANATION, name);
    let by_compilers = filled(explanation("by compilers"), |what| match what {
        "C" => report.compilers.cc.to_string(),
        "Rust" => report.compilers.rustc.to_string(),
        _ => unreachable!("no figure `{what}`"),
    });
    let cost_of_cpu = explanation("cost").replace("{CPU}", &cpu_name());
    [
        explanation("the page"),
        explanation("in assembly"),
        &assembled(report),
        "<!-- end -->\n\n",
        &by_compilers,
        &compiled(report),
        "<!-- end -->\n\n",
        explanation("executed"),
        &executed(report),
        &cost_of_cpu,
        &cost(report),
        &lessons(report),
    ]
    .concat()
}

fn find<'a>(report: &'a Report, op: &str, implementation: &str) -> Option<&'a Counts> {
    report.rows.iter().find(|row| row.op == op && row.implementation == implementation)
}

fn number(value: Option<impl ToString>) -> String {
    value.map_or("–".into(), |value| value.to_string())
}

/// Those of `names` that have code in this report.
fn there<'a>(report: &Report, names: &[&'a str]) -> Vec<&'a str> {
    let has = |name: &&&str| report.rows.iter().any(|row| row.implementation == **name && row.function.is_some());
    names.iter().filter(has).copied().collect()
}

/// A table with a row for each operation: its name, and its cells under the other headings.
fn by_operation<S: Into<String>>(
    heads: impl IntoIterator<Item = S>,
    cells: impl Fn(&'static str) -> Vec<String>,
) -> Table {
    let mut table = Table::new(1, ["operation".to_owned()].into_iter().chain(heads.into_iter().map(Into::into)));
    OPS.iter().for_each(|op| table.row([vec![op.to_string()], cells(op)].concat()));
    table
}

fn assembled(report: &Report) -> String {
    let names = there(report, ASSEMBLED);
    let cell = |op: &str, name: &str| {
        let row = find(report, op, name)?;
        let (body, function) = (row.body_mix.as_ref()?, row.function?);
        let each = match row.vectors {
            Some(vectors) if vectors > 1 => format!(", {:.2} a vector", row.per_vector?),
            _ => String::new(),
        };
        Some(format!("{} / {function}, {} B{each}", body.instructions, body.bytes))
    };
    let counts = by_operation(["printed"].iter().chain(&names).copied(), |op| {
        let printed = number(find(report, op, "printed-simd").and_then(|row| row.body));
        [printed].into_iter().chain(names.iter().map(|name| number(cell(op, name)))).collect()
    });
    let heads = ["critical path, `paper`", "critical path, `aos`", "critical path, packets with FMA"];
    let paths = by_operation(heads, |op| {
        let path = |name| number(find(report, op, name).and_then(|row| row.critical_path.clone()));
        ["paper", "aos", "avx2"].map(path).to_vec()
    });
    format!("{}\n{}", counts.compact(), paths.left(usize::MAX).compact())
}

fn compiled(report: &Report) -> String {
    let names = there(report, COMPILED);
    let counts = by_operation(["printed"].iter().chain(&names).copied(), |op| {
        let count = |name: &&str| number(find(report, op, name).and_then(|row| row.function));
        ["printed-c"].iter().chain(&names).map(count).collect()
    });
    counts.compact() + "\n"
}

fn executed(report: &Report) -> String {
    if let Some(reason) = &report.executed_unavailable {
        return format!("Not available: {reason}.\n\n");
    }
    let has_paths = |name: &&str| report.rows.iter().any(|row| row.implementation == *name && !row.paths.is_empty());
    let names: Vec<_> = IMPLEMENTATIONS.into_iter().filter(has_paths).collect();
    if names.is_empty() {
        return "Not counted: `--executed` was not given.\n\n".into();
    }
    let mut table = Table::new(1, ["operation"].iter().chain(&names).copied());
    for op in OPS {
        let paths = names.iter().find_map(|name| find(report, op, name).filter(|row| !row.paths.is_empty()));
        for (case, path) in paths.iter().flat_map(|row| row.paths.iter().enumerate()) {
            let several = paths.is_some_and(|row| row.paths.len() > 1);
            let label = if several { format!("{op}, {}", path.path) } else { op.into() };
            let counts = names.iter().map(|name| {
                number(find(report, op, name).and_then(|row| row.paths.get(case)).map(|path| path.executed))
            });
            table.row([label].into_iter().chain(counts).collect());
        }
    }
    let mut text = table.compact() + "\n";
    if !report.frames.is_empty() {
        text += "The paper's picture of one sphere and one light, a ray for each pixel, by whole engines:\n\n";
        let mut table = Table::new(1, ["engine", "pixels", "instructions", "per pixel and ray"]);
        for FrameRow { engine, width, height, instructions, per_pixel, .. } in &report.frames {
            let size = format!("{width}×{height}");
            table.row(vec![engine.to_string(), size, instructions.to_string(), format!("{per_pixel:.1}")]);
        }
        text += &(table.compact() + "\n");
    }
    text
}

fn cost(report: &Report) -> String {
    let names = there(report, BUILT);
    let bodies: Vec<_> = names
        .iter()
        .filter(|name| {
            report.rows.iter().any(|row| row.implementation == **name && row.cost_of.as_deref() == Some("body"))
        })
        .collect();
    let heads = bodies.iter().map(|name| format!("body of {name}"));
    let costs = by_operation(heads.chain(names.iter().map(|name| format!("call of {name}"))), |op| {
        let body = bodies.iter().map(|name| {
            find(report, op, name)
                .filter(|row| row.cost_of.as_deref() == Some("body"))
                .map(|row| (row.latency, row.throughput))
        });
        let call = names.iter().map(|name| find(report, op, name).map(|row| (row.call_latency, row.call_throughput)));
        let cell = |of: Option<(Option<f64>, Option<f64>)>| {
            number(of.and_then(|(latency, throughput)| pair(latency, throughput, " / ")))
        };
        body.chain(call).map(cell).collect()
    });
    costs.compact() + "\n"
}

/// The text of what the figures teach, with figures of this report: `{function add c-O0}` is a kind
/// of figure, an operation and an implementation.
fn lessons(report: &Report) -> String {
    filled(part(EXPLANATION, "what it teaches"), |what| {
        let [kind, op, name] = what.split(' ').collect::<Vec<_>>()[..] else { unreachable!("no figure `{what}`") };
        let row = find(report, op, name);
        let of_body = row.filter(|row| row.cost_of.as_deref() == Some("body"));
        match kind {
            "function" => number(row.and_then(|row| row.function)),
            "body" => number(row.and_then(|row| row.body)),
            "executed" => number(row.and_then(|row| row.executed)),
            "latency" => number(of_body.and_then(|row| row.latency).map(short)),
            "throughput" => number(of_body.and_then(|row| row.throughput).map(short)),
            "call" => number(row.and_then(|row| row.call_throughput).map(short)),
            _ => unreachable!("no figure `{what}`"),
        }
    })
}
