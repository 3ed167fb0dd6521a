//! The document docs/instruction-counts.md.

use std::fmt::Write as _;

use super::table::short;
use crate::experiments::ops::{IMPLEMENTATIONS, OPS, Report, Row};
use crate::measure::cpu_name;

/// The implementations whose code the assembler fixes, and those that a compiler makes.
const ASSEMBLED: [&str; 5] = ["paper", "aos", "sse41", "avx2", "avx512"];
const COMPILED: [&str; 7] = ["c-O0", "c-O1", "c-O2", "c-O3", "c-native", "rust", "glam"];

/// The document.
pub fn text(report: &Report) -> String {
    let mut text = String::from(
        "# Instructions per operation\n\n\
         Made by `rayo ops --executed --markdown > docs/instruction-counts.md`; a test says when it is stale.\n\n\
         The paper's section 4 gives a number of instructions for each operation, and neither says what was counted nor at \
         which level of optimisation. Here a **body** is the macro between loading its operands and storing its result, and \
         a **function** is the whole symbol: loads, stores and `ret` too, but not what it calls. Counts are disassembled \
         from the objects that this program was linked from, or for Rust from the running program.\n\n",
    );
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
    text.push_str(
        "## In assembly\n\n\
         `printed` is the paper's own SIMD column. `paper` are its macros, which come out as it says; `aos` are the best \
         forms that we know with one vector in a register; `sse41`, `avx2` and `avx512` serve 4, 8 and 16 vectors at once, \
         and meet a sphere or a triangle with masks in place of jumps, so that all paths are one. Each cell is body / function, with the bytes of the body.\n\n\
         <!-- assembled -->\n",
    );
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
    writeln!(
        text,
        "## By compilers\n\n\
         `printed` is the paper's own C column. The functions in C take and give vectors by value, as the paper's program \
         does, compiled at each level. `rust` is the scalar twin of the macros, `glam` the library's `Vec3A`; both take \
         addresses, as the functions in assembly do.\n\n\
         <!-- compiled by {}; {} -->",
        report.compilers.cc, report.compilers.rustc
    )
    .unwrap();
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
    text.push_str(
        "## Executed\n\nFrom a function's entry to its return, with all that it calls, on each path; counted by \
         single-stepping.\n\n",
    );
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
    writeln!(
        text,
        "## Cost\n\n\
         Latency / throughput in cycles of the core's own clock on {}, the fewest of many measurements. A body is timed in \
         a chain of itself; its throughput includes loads of its operands. A call is timed with the loop around it: for \
         latency the address of its operand is made of the last result.\n",
        cpu_name().as_deref().unwrap_or("an unknown CPU")
    )
    .unwrap();
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

/// What the figures teach, with those of this report.
fn lessons(text: &mut String, report: &Report) {
    let count = |op: &str, name: &str| number(find(report, op, name).and_then(|row| row.function));
    let body = |op: &str, name: &str| number(find(report, op, name).and_then(|row| row.body));
    let latency = |op: &str, name: &str| {
        number(find(report, op, name).and_then(|row| row.latency.filter(|_| row.cost_of == Some("body"))).map(short))
    };
    let throughput = |op: &str, name: &str| {
        number(find(report, op, name).and_then(|row| row.throughput.filter(|_| row.cost_of == Some("body"))).map(short))
    };
    let call = |op: &str, name: &str| number(find(report, op, name).and_then(|row| row.call_throughput).map(short));
    let executed = |op: &str, name: &str| number(find(report, op, name).and_then(|row| row.executed));
    writeln!(
        text,
        "## What it teaches\n\n\
         **The paper compares two different things.** Its SIMD column counts bodies: its macros come to exactly those \
         numbers. Its C column is of whole functions: an addition is printed with {} and a scaling with {}, and this \
         compiler makes {} and {} at -O0, {} and {} at -O1, {} and {} at -O3. The nearest level for these two is for the \
         reader to see; at -O3, which the paper names, the function is far shorter than printed. Nor does the count of a \
         symbol tell what is executed: `norm` calls the library's `pow`, so that a call of {} instructions at -O3 executes \
         {}, against {} in assembly, where the root is one instruction.\n",
        count("add", "printed-c"),
        count("scale", "printed-c"),
        count("add", "c-O0"),
        count("scale", "c-O0"),
        count("add", "c-O1"),
        count("scale", "c-O1"),
        count("add", "c-O3"),
        count("scale", "c-O3"),
        count("norm", "c-O3"),
        executed("norm", "c-O3"),
        executed("norm", "paper"),
    )
    .unwrap();
    writeln!(
        text,
        "**Fewer instructions are not always faster.** The paper's dot product has {} instructions and ours {}, since \
         `haddps` is two shuffles and an addition in one: {} cycles from operand to result against {}, and one every {} \
         cycles against one every {}. In C, an addition by value has {} instructions at -O1 and {} at -O3, yet independent \
         calls take {} and {} cycles each: the shorter code stores its halves and reads them back as one, which the CPU \
         cannot forward from its store buffer. What counts is the longest chain of operations, and which parts of the CPU \
         they compete for; the number of instructions bounds neither. A packet instruction moves the question elsewhere: \
         it serves 4, 8 or 16 vectors at once, and its count is to be divided by them.",
        body("dot", "paper"),
        body("dot", "aos"),
        latency("dot", "paper"),
        latency("dot", "aos"),
        throughput("dot", "paper"),
        throughput("dot", "aos"),
        count("add", "c-O1"),
        count("add", "c-O3"),
        call("add", "c-O1"),
        call("add", "c-O3"),
    )
    .unwrap();
}
