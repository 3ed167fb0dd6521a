//! `rayo ops`: the instructions of every operation in every implementation, and their cycles.

mod listing;
mod markdown;
mod proofs;
mod table;

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::{Failure, colour_on_stdout, convert, print_result, require_assembly, terminal_width};
use rayo::internals::scene::brief;
use rayo_lab::experiments::ops::{self, IMPLEMENTATIONS, IMPLEMENTATIONS_OF_LIT, LIT, OpsError, Options, Report};
use rayo_lab::experiments::prove::listing::Proofs;
use rayo_lab::experiments::svg::Screen;
use rayo_lab::measure::Machine;
use rayo_lab::measure::instructions::functions;

/// Count the instructions of every operation, and measure their cycles: the paper's section 4
///
/// Counts come from the code of this build: for C and NASM from the objects it was linked from, for
/// Rust from the running program.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo ops --op dot,cross
  rayo ops --op lit --engine avx2,portable --asm
  rayo ops --kernel rayo_paper_trace")]
pub struct OpsArgs {
    /// Only these operations, separated by commas, with the kinds of their instructions: add, sub,
    /// scale, dot, norm, cross, normalise, sphere, triangle, lambert; with --asm also lit (rows of
    /// a sphere, by portable and packets)
    #[arg(long, value_name = "NAME", value_delimiter = ',')]
    op: Vec<String>,
    /// Only these implementations, separated by commas: printed-c, printed-simd, c-O0 to c-O3,
    /// c-native, rust, glam, paper, aos, sse41, avx2, avx512, portable; `c` is all of C, `printed`
    /// both of the paper's columns
    #[arg(long, value_name = "E", value_delimiter = ',')]
    engine: Vec<String>,
    /// Print the listings side by side, in Intel's syntax; one implementation is printed beside its
    /// source
    #[arg(long)]
    asm: bool,
    /// Print the listings of these kernels, separated by commas, beside their source: any function
    /// of the objects, including the loops that trace
    #[arg(long, value_name = "SYMBOL", value_delimiter = ',', conflicts_with_all = ["op", "engine", "asm", "executed", "markdown"])]
    kernel: Vec<String>,
    /// Print the symbols that --kernel takes
    #[arg(long, conflicts_with_all = ["kernel", "op", "engine", "asm", "executed", "markdown"])]
    kernels: bool,
    /// Prove each macro equal to its twin in Rust for all inputs, on all instruction sets, and the
    /// bounds of rounding errors; say which are not proved, and why
    #[arg(long, conflicts_with_all = ["kernel", "kernels", "op", "engine", "asm", "executed", "markdown", "figure"])]
    proofs: bool,
    /// Count executed instructions too, by single-stepping: every operation on each of its paths,
    /// and a small picture
    #[arg(long)]
    executed: bool,
    /// Print one JSON document: everything that is known
    #[arg(long, conflicts_with_all = ["asm", "markdown"])]
    json: bool,
    /// Print a page with everything, in Markdown
    #[arg(long, conflicts_with_all = ["asm", "op", "engine"])]
    markdown: bool,
    /// Draw cycles against instructions, as an SVG
    #[arg(long, value_name = "FILE", conflicts_with_all = ["asm", "kernel", "kernels"])]
    figure: Option<PathBuf>,
}

/// Functions of the object files, for the JSON document.
#[derive(serde::Serialize)]
struct Listed<T> {
    kernels: Vec<T>,
}

/// The JSON document of the counts.
#[derive(serde::Serialize)]
struct Document<'a> {
    machine: Machine,
    #[serde(flatten)]
    report: &'a Report,
}

/// Counts, measures and prints.
pub fn run(args: &OpsArgs) -> Result<ExitCode, Failure> {
    require_assembly("to count")?;
    let (width, colour) = (terminal_width().unwrap_or(120), colour_on_stdout());
    if args.kernels {
        let kernels = Listed { kernels: functions() };
        print_result(args.json, &kernels, || listing::symbols(&kernels.kernels))?;
        return Ok(ExitCode::SUCCESS);
    }
    if !args.kernel.is_empty() {
        let kernels: Result<_, _> = args.kernel.iter().map(|symbol| ops::kernel(symbol)).collect();
        let kernels = Listed { kernels: kernels.map_err(Failure::input)? };
        print_result(args.json, &kernels, || listing::kernels(&kernels.kernels, width, colour))?;
        return Ok(ExitCode::SUCCESS);
    }
    if args.proofs {
        let proofs = Proofs::of_all();
        print_result(args.json, &proofs, || proofs::text(&proofs))?;
        return Ok(if proofs.hold() { ExitCode::SUCCESS } else { ExitCode::FAILURE });
    }
    if !args.asm && args.op.iter().any(|op| op == LIT) {
        return Err(Failure::input(format!("the rows of a sphere, {LIT}, are listed and not counted: add --asm")));
    }
    let options = Options {
        wanted: args.op.clone(),
        implementations: implementations(&args.op, &args.engine)?,
        executed: args.executed,
        cost: !args.asm,
    };
    let bar = super::measuring::bar(0);
    let report = ops::run(&options, &mut |done, of| {
        bar.set_length(of as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    let report = report.map_err(failure)?;
    if let Some(figure) = &args.figure {
        let svg = ops::plot::figure(&report, Screen::Wide).map_err(Failure::output)?;
        convert::write(figure, |out| out.write_all(svg.as_bytes()))?;
    }
    let document = Document { machine: Machine::this(), report: &report };
    print_result(args.json, &document, || {
        if args.asm {
            listing::text(&report, width, colour)
        } else if args.markdown {
            markdown::text(&report)
        } else {
            table::text(&report, !args.op.is_empty(), args.executed)
        }
    })?;
    // With --asm, wrong results do not fail the command: a listing may be wanted to find the
    // mistake.
    match if args.asm { ops::wrong(&options).map_err(failure)? } else { Vec::new() } {
        wrong if wrong.is_empty() => Ok(ExitCode::SUCCESS),
        wrong => Err(failure(OpsError::Wrong(wrong))),
    }
}

/// An unknown operation is the fault of the arguments; a result that differs from its twin is a check
/// that failed.
pub fn failure(error: OpsError) -> Failure {
    match error {
        OpsError::NoOperation(_) => Failure::input(error),
        OpsError::Wrong(_) => Failure::output(error),
    }
}

/// The implementations that `engines` names; an empty list means all.
fn implementations(ops: &[String], engines: &[String]) -> Result<Vec<String>, Failure> {
    let mut wanted = Vec::new();
    for engine in engines {
        let prefix = format!("{engine}-");
        let group = ["c", "printed"].contains(&engine.as_str());
        let before = wanted.len();
        let all = if ops.iter().any(|op| op == LIT) { &IMPLEMENTATIONS_OF_LIT[..] } else { &IMPLEMENTATIONS };
        wanted.extend(all.iter().filter(|i| *i == engine || group && i.starts_with(&prefix)).map(|i| i.to_string()));
        if wanted.len() == before {
            let list = all.join(", ");
            let of = if all.len() == IMPLEMENTATIONS.len() {
                format!(
                    "single operations; there are: {list}; and c for all of C, printed for both of the \
                         paper's columns"
                )
            } else {
                format!("the rows of a sphere, {LIT}; there are: {list}")
            };
            return Err(Failure::input(format!("there is no implementation `{}` of {of}", brief(engine))));
        }
    }
    Ok(wanted)
}
