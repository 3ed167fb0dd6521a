//! A function that a user brings: run in processes of its own, checked, counted and timed.
//!
//! The code may do anything: end its process, overwrite it, or loop for ever. So each stage of the
//! checks is a process ([`serve`]), which reports what it finds to this one (`process`), and
//! whose death is a finding too.

pub mod bounded;
mod call;
mod convention;
mod expression;
mod figures;
pub mod findings;
pub mod lines;
mod memory;
mod process;
mod proof;
pub mod requirements;
mod serve;
pub mod source;
mod steps;
mod tracer;
mod values;
pub mod verdict;
pub mod wanted;

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use super::ops::turns::{self, AGAINST};
use crate::measure::instructions::{Code, Instruction};
pub use expression::Expression;
use findings::{Request, Stage, told};
use process::hear;
use rayo::internals::kernels::{ALL_OPERATIONS, Isa};
use rayo::internals::scene::brief;
use requirements::Requirement;
pub use serve::serve;
use source::{Built, Unusable, function_of, operation_of};
use verdict::{Figures, PROOF, Verdict};
use wanted::{TRACE, Truth, Type, Wanted};

/// How a file is to be tried.
#[derive(Clone, Debug)]
pub struct Options {
    /// The operation; None if the function's name says it.
    pub op: Option<String>,
    pub symbol: Option<String>,
    pub flags: String,
    /// A formula, with the types that the function takes and gives.
    pub formula: Option<(String, Vec<Type>, Type)>,
    /// Whether to leave out cycles.
    pub check_only: bool,
    /// Whether to single-step one call.
    pub steps: bool,
    pub seconds: u32,
    pub seed: u64,
    pub required: Vec<Requirement>,
}

/// About how many inputs are tried.
const INPUTS: u32 = 20_000;
/// How many times the seconds of the CPU that a call may have its process may take by the clock:
/// other processes may have the core meanwhile.
const PATIENCE: u32 = 5;
/// How much longer a process may take for what is not the user's code.
const BESIDE: Duration = Duration::from_secs(5);
/// How long cycles may take to be measured.
const MEASURING: Duration = Duration::from_secs(60);

/// Tries a file. `start` gives a command that begins another process of this program, which calls
/// [`serve`].
///
/// # Errors
/// If the file cannot be used.
pub fn judge(
    path: &Path,
    options: &Options,
    start: &dyn Fn() -> std::io::Result<Command>,
) -> Result<Verdict, Unusable> {
    let built = Built::of(path, &options.flags)?;
    built.require_functions()?;
    let wanted = wanted(&built, options)?;
    let operation = matches!(wanted.truth, Truth::Operation(_)).then(|| wanted.name());
    let symbol = function_of(&built, options.symbol.as_deref(), operation)?;
    let code = built.code(&symbol).filter(|code| !code.instructions.is_empty());
    let code = code.ok_or_else(|| Unusable(format!("{}: `{}` has no instructions", built.name, brief(&symbol))))?;
    let offset = built.offset(&symbol);
    let offset = offset.ok_or_else(|| Unusable(format!("{}: `{}` was lost in linking", built.name, brief(&symbol))))?;
    refuse_missing_instructions(&built.name, &code)?;
    let mut verdict = Verdict {
        file: built.name.clone(),
        op: wanted.name().into(),
        symbol: symbol.clone(),
        warnings: built.warnings.clone(),
        reads: wanted.takes.iter().map(|kind| kind.bytes()).collect(),
        writes: wanted.gives.bytes(),
        ..Verdict::default()
    };
    count(&mut verdict, &wanted, &code);
    let request = Request {
        shared: built.shared.clone(),
        symbol,
        offset,
        bytes: code.bytes(),
        body: code.body.clone().map(|body| (body.start, body.end)),
        wanted,
        stage: Stage::Values,
        seed: options.seed,
        inputs: INPUTS,
        seconds: options.seconds,
        progress: built.folder.path().join("progress"),
    };
    run_stages(&mut verdict, &request, options, start)?;
    if !Isa::Sse41.built() {
        verdict.convention = Default::default();
        verdict.notes.push("the calling convention is not checked here: it takes assembly for x86-64".into());
    }
    if request.wanted.is_tracer() {
        // These are checks of operations.
        for holds in [&mut verdict.odd.holds, &mut verdict.fourth_lane.holds, &mut verdict.aliasing.holds] {
            *holds = Some(true);
        }
    }
    verdict.judge_figures(&options.required);
    verdict.broken = options.required.iter().filter_map(|required| required.broken_by(&verdict)).collect();
    if let Some(crash) = &verdict.crash {
        verdict.broken = vec![crash.what.clone()];
    }
    verdict.holds = verdict.broken.is_empty();
    Ok(verdict)
}

/// The stages of a function: its results, its memory, and, if it is right so far, its figures.
fn run_stages(
    verdict: &mut Verdict,
    request: &Request,
    options: &Options,
    start: &dyn Fn() -> std::io::Result<Command>,
) -> Result<(), Unusable> {
    let run = |verdict: &mut Verdict, stage: Stage, name: &str, time: Duration| {
        let request = Request { stage, ..request.clone() };
        run_stage(verdict, &request, name, time, start)
    };
    let time = PATIENCE * Duration::from_secs(options.seconds.into()) + BESIDE;
    run(verdict, Stage::Values, "results", time)?;
    // What crashes or does not return is not asked again.
    if verdict.crash.is_some() {
        return Ok(());
    }
    run(verdict, Stage::Memory, "memory", time)?;
    if options.steps {
        run(verdict, Stage::Steps, "steps", time)?;
    }
    let asks = |names: &[&str]| options.required.iter().any(|required| required.is_one_of(names));
    let is_right = verdict.result.holds == Some(true) && verdict.crash.is_none();
    if !is_right {
        verdict.notes.push("not timed: nothing is worth the cycles of a wrong result".into());
    } else if verdict.writes_beyond {
        verdict.notes.push("not timed: it writes to memory that is not its own, where it may spoil anything".into());
    } else if !options.check_only || asks(&["executed", "cycles", "throughput"]) {
        run(verdict, Stage::Figures, "figures", time + MEASURING)?;
    }
    let is_provable = is_right && request.wanted.ours().is_some() && Isa::Sse41.built();
    let is_asked = !options.check_only || asks(&["proof"]);
    if is_provable && is_asked {
        run(verdict, Stage::Proof, PROOF, time)?;
    }
    Ok(())
}

fn run_stage(
    verdict: &mut Verdict,
    request: &Request,
    name: &str,
    time: Duration,
    start: &dyn Fn() -> std::io::Result<Command>,
) -> Result<(), Unusable> {
    let bytes = serde_json::to_vec(request).map_err(|error| Unusable(error.to_string()))?;
    // No input is in progress yet: an earlier process may have left one.
    let _ = std::fs::write(&request.progress, u64::MAX.to_le_bytes());
    let heard = start().and_then(|command| hear(command, &bytes, time));
    let heard = heard.map_err(|error| Unusable(format!("no process for the function can be started: {error}")))?;
    verdict.hear(name, heard, || arguments_in_progress(request));
    Ok(())
}

/// The arguments of the call that a process has not come back from.
fn arguments_in_progress(request: &Request) -> Vec<(String, Vec<String>)> {
    let bytes = std::fs::read(&request.progress).unwrap_or_default();
    let Some(index) = bytes.first_chunk().map(|bytes| u64::from_le_bytes(*bytes)) else { return Vec::new() };
    let trials = request.trials();
    let trial = usize::try_from(index).ok().and_then(|index| trials.get(index));
    trial.map_or_else(Vec::new, |trial| told(&request.wanted, &trial.sample))
}

/// What the function is to compute, by the options or by its name.
fn wanted(built: &Built, options: &Options) -> Result<Wanted, Unusable> {
    if let Some((text, takes, gives)) = &options.formula {
        let formula = Expression::read(text, takes, *gives).map_err(Unusable)?;
        return Ok(Wanted { truth: Truth::Formula(formula), takes: takes.clone(), gives: *gives });
    }
    let name = match &options.op {
        Some(op) => op.clone(),
        None => operation_of(built, options.symbol.as_deref(), &operations())?,
    };
    if name == TRACE {
        return Ok(Wanted::tracer());
    }
    Wanted::operation(&name).ok_or_else(|| no_operation(&name))
}

/// The operations that there are, the tracer among them.
fn operations() -> Vec<&'static str> {
    ALL_OPERATIONS.into_iter().chain([TRACE]).collect()
}

/// The message of an operation that there is not.
pub fn no_operation(name: &str) -> Unusable {
    Unusable(format!(
        "there is no operation `{}`; there are: {}; or --truth gives a formula of your own",
        brief(name),
        operations().join(", ")
    ))
}

/// Refuses code that this CPU cannot run.
fn refuse_missing_instructions(name: &str, code: &Code) -> Result<(), Unusable> {
    let missing: Vec<_> = code.function().features.into_iter().filter(|feature| !is_there(feature)).collect();
    if missing.is_empty() {
        return Ok(());
    }
    let symbol = brief(&code.symbol);
    Err(Unusable(format!("{name}: `{symbol}` needs {}, which this CPU does not have", missing.join(", "))))
}

/// Whether this CPU has one of the features listed here. Any other one is taken to be there: code
/// that uses it crashes where it is not, and that is reported.
#[cfg(target_arch = "x86_64")]
fn is_there(feature: &str) -> bool {
    macro_rules! detected {
        ($($name:literal: $feature:tt,)*) => {
            match feature {
                $($name => std::is_x86_feature_detected!($feature),)*
                _ => true,
            }
        };
    }
    detected! {
        "SSE3": "sse3", "SSSE3": "ssse3", "SSE4_1": "sse4.1", "SSE4_2": "sse4.2", "SSE4A": "sse4a", "POPCNT": "popcnt",
        "AVX": "avx", "AVX2": "avx2", "FMA": "fma", "F16C": "f16c", "BMI1": "bmi1", "BMI2": "bmi2", "LZCNT": "lzcnt",
        "MOVBE": "movbe", "AES": "aes", "SHA": "sha", "GFNI": "gfni", "TBM": "tbm", "ADX": "adx",
        "AVX512F": "avx512f", "AVX512VL": "avx512vl", "AVX512DQ": "avx512dq", "AVX512BW": "avx512bw",
        "AVX512CD": "avx512cd", "AVX512_IFMA": "avx512ifma", "AVX512_VBMI": "avx512vbmi", "AVX512_FP16": "avx512fp16",
        "AVX512_BF16": "avx512bf16", "AVX512_VNNI": "avx512vnni", "AVX_VNNI": "avxvnni",
    }
}

/// On other CPUs no instruction is decoded, so that nothing is known of what it needs.
#[cfg(not(target_arch = "x86_64"))]
fn is_there(_: &str) -> bool {
    true
}

/// The instructions of a file's function, and those of `paper` for the same operation: for `--asm`.
///
/// # Errors
/// As [`judge`].
pub fn listings(path: &Path, options: &Options) -> Result<[Vec<Instruction>; 2], Unusable> {
    let built = Built::of(path, &options.flags)?;
    built.require_functions()?;
    let wanted = wanted(&built, options)?;
    let operation = matches!(wanted.truth, Truth::Operation(_)).then(|| wanted.name());
    let symbol = function_of(&built, options.symbol.as_deref(), operation)?;
    let yours = built.code(&symbol).map(|code| code.instructions).unwrap_or_default();
    let paper = operation.and_then(|operation| Code::of_symbol(&format!("rayo_paper_{operation}")));
    Ok([yours, paper.map(|code| code.instructions).unwrap_or_default()])
}

/// The static counts: of the function, and of ours.
fn count(verdict: &mut Verdict, wanted: &Wanted, code: &Code) {
    if !cfg!(target_arch = "x86_64") {
        return verdict.notes.push("instructions are counted on x86-64 alone".into());
    }
    let mix = code.function();
    verdict.instructions.function = Some(mix.instructions);
    verdict.instructions.body = code.body().map(|mix| mix.instructions);
    verdict.instructions.mix = Some(mix);
    let Truth::Operation(name) = &wanted.truth else { return };
    for implementation in AGAINST {
        if let Some((function, body)) = turns::instructions(name, implementation) {
            let (function, body) = (Some(function.instructions), body.map(|body| body.instructions));
            verdict.against.insert(implementation.into(), Figures { function, body, ..Figures::default() });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_call_in_progress_is_told_by_the_inputs_of_its_stage() {
        let folder = tempfile::tempdir().unwrap();
        for (stage, index) in [(Stage::Values, 200_u64), (Stage::Memory, 50)] {
            let request = Request {
                shared: "dot.so".into(),
                symbol: "dot".into(),
                offset: 0,
                bytes: 0,
                body: None,
                wanted: Wanted::operation("dot").unwrap(),
                stage,
                seed: 1,
                inputs: 1000,
                seconds: 1,
                progress: folder.path().join("progress"),
            };
            std::fs::write(&request.progress, index.to_le_bytes()).unwrap();
            let count = if stage == Stage::Memory { findings::FENCED_INPUTS } else { 1000 };
            let tried = &request.wanted.trials(count, 1)[index as usize];
            assert_eq!(arguments_in_progress(&request), told(&request.wanted, &tried.sample));
        }
    }
}
