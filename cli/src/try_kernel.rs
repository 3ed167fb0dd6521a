//! `rayo try`: a function that somebody brings, checked, counted and timed beside ours.

mod table;
mod templates;
mod text;
mod watch;

use std::path::PathBuf;
use std::process::{Command, ExitCode};

use clap::Args;
use serde::Serialize;

use super::number::{seed, whole};
use super::{Failure, colour_on_stdout, print, print_result, say, write_out};
use rayo::internals::kernels::Isa;
use rayo_lab::experiments::bring::requirements::Requirement;
use rayo_lab::experiments::bring::source::Unusable;
use rayo_lab::experiments::bring::verdict::Verdict;
use rayo_lab::experiments::bring::wanted::Type;
use rayo_lab::experiments::bring::{self, Options};
use templates::Language;

/// Try a function of your own: whether it is right, keeps the calling convention, and what it costs
/// beside the paper's
///
/// It is called as `void name(out, a, b)`, like every operation of `rayo ops`. Checks that fail are
/// told with the smallest input found that shows it. The function runs in a process of its own,
/// which may crash or loop; it runs with your rights, so try only what you would run. Exit status:
/// 0 everything required holds, 1 something does not, 2 the file cannot be used.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo try --template asm --op dot > dot.asm
  rayo try dot.asm --op dot
  rayo try twice.c --truth 2*a --takes vec4 --gives vec4 --require same-bits")]
pub struct TryArgs {
    /// What has the function: NASM (.asm), assembly or C for the C compiler (.s, .S, .c), Rust
    /// (.rs), an object (.o, .so)
    #[arg(required_unless_present_any = ["template", "serve"], value_name = "FILE")]
    files: Vec<PathBuf>,
    /// The operation that it is to be: add, sub, scale, dot, norm, cross, normalise, sphere,
    /// triangle, lambert, lambert2; or trace, the whole of Algorithm 1 over rows. Default: the one
    /// with the function's name
    #[arg(long, value_name = "OP", conflicts_with = "truth")]
    op: Option<String>,
    /// The function's name. Default: the operation's, or that of the only function
    #[arg(long, value_name = "SYMBOL")]
    symbol: Option<String>,
    /// What the assembler or compiler gets beside our own: for C -O3 if nothing is said
    #[arg(long, value_name = "FLAGS", default_value = "", allow_hyphen_values = true, hide_default_value = true)]
    flags: String,
    /// What it computes, if that is no operation of ours: a formula in a and b with + - * /, dot,
    /// norm, cross, normalise, sqrt, abs, min, max, and fields such as a.x
    #[arg(long, value_name = "FORMULA", requires = "takes", requires = "gives", allow_hyphen_values = true)]
    truth: Option<String>,
    /// The types of its one or two arguments: f32, vec4, sphere, triangle, surface, light
    #[arg(long, value_name = "T,T", value_delimiter = ',', requires = "truth", allow_hyphen_values = true)]
    takes: Vec<Type>,
    /// The type of its result: f32 or vec4
    #[arg(long, value_name = "T", requires = "truth", allow_hyphen_values = true)]
    gives: Option<Type>,
    /// Check alone: no cycles
    #[arg(long)]
    check: bool,
    /// What exit status 0 asks, in place of all checks, separated by commas: result, same-bits,
    /// odd, fourth-lane, aliasing, convention, memory, proof, ulp=2, instructions=8, body=5,
    /// executed=8, cycles=1.0 and throughput=1.0 (times `paper`)
    #[arg(long, value_name = "LIST", value_delimiter = ',', allow_hyphen_values = true)]
    require: Vec<Requirement>,
    /// How many seconds of the CPU a call may take
    #[arg(long, value_name = "S", default_value_t = 10, value_parser = whole(1..=3600_u32), allow_hyphen_values = true)]
    timeout: u32,
    /// The seed of the inputs
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = seed, allow_hyphen_values = true)]
    seed: u64,
    /// Print a start that passes, for the operation: in NASM, C or Rust, or as a macro of ours
    /// between its labels
    #[arg(long, value_name = "LANGUAGE", conflicts_with_all = ["files", "truth", "check", "require", "json"])]
    template: Option<Language>,
    /// Try it again whenever a file changes, on a cleared screen, until Ctrl-C
    #[arg(long, conflicts_with = "json")]
    watch: bool,
    /// Show one call instruction by instruction: the line of each, and what it changes
    #[arg(long)]
    step: bool,
    /// Print the function's instructions beside those of `paper`, and nothing else
    #[arg(long, conflicts_with_all = ["json", "watch", "step", "check", "require"])]
    asm: bool,
    /// Print one JSON document
    #[arg(long)]
    json: bool,
    /// Be the process that runs the function
    #[arg(long, hide = true, exclusive = true)]
    serve: bool,
}

/// What `--json` prints of several files; of one, its object alone.
#[derive(Serialize)]
struct Tried<'a> {
    files: &'a [Outcome],
}

/// What became of a file.
#[derive(Serialize)]
#[serde(untagged)]
enum Outcome {
    Judged(Box<Verdict>),
    Unusable { file: String, holds: bool, unusable: String },
}

/// Runs `rayo try`: as the child process, or to print a template or listings, to watch files, or to
/// try each file once.
pub fn run(args: &TryArgs) -> Result<ExitCode, Failure> {
    if args.serve {
        return bring::serve().map(|()| ExitCode::SUCCESS).map_err(Failure::output);
    }
    if let Some(language) = args.template {
        let op = args.op.as_deref().unwrap_or("dot");
        let text = templates::of(language, op).ok_or_else(|| Failure::input(bring::no_operation(op)))?;
        write_out(text.as_bytes())?;
        return Ok(ExitCode::SUCCESS);
    }
    let options = options(args)?;
    if args.asm {
        return listings(args, &options);
    }
    if args.watch {
        return watch::watch(&args.files, || try_all(args, &options));
    }
    try_all(args, &options)
}

/// Tries every file, and prints the verdicts.
fn try_all(args: &TryArgs, options: &Options) -> Result<ExitCode, Failure> {
    let outcomes: Vec<_> = args.files.iter().map(|path| (path, bring::judge(path, options, &start))).collect();
    match <[_; 1]>::try_from(outcomes) {
        Ok([(_, outcome)]) => one(args, outcome),
        Err(outcomes) => {
            several(args, outcomes.into_iter().map(|(path, outcome)| Outcome::new(path, outcome)).collect())
        }
    }
}

/// Prints each function's instructions beside the paper's.
fn listings(args: &TryArgs, options: &Options) -> Result<ExitCode, Failure> {
    let mut all = String::new();
    for path in &args.files {
        let [yours, paper] = bring::listings(path, options).map_err(Failure::input)?;
        all += &text::listing(&rayo::internals::scene::shown(path).to_string(), &yours, &paper);
    }
    print(&all)?;
    Ok(ExitCode::SUCCESS)
}

/// A command that begins the process for a function.
fn start() -> std::io::Result<Command> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["try", "--serve"]);
    Ok(command)
}

fn options(args: &TryArgs) -> Result<Options, Failure> {
    let formula = match (&args.truth, args.gives) {
        (Some(text), Some(gives)) => {
            if args.takes.len() > 2 {
                return Err(Failure::input("a function takes one argument or two: --takes T or --takes T,T"));
            }
            if ![Type::F32, Type::Vec4].contains(&gives) {
                return Err(Failure::input(format!("a formula gives f32 or vec4, not {gives}")));
            }
            Some((text.clone(), args.takes.clone(), gives))
        }
        _ => None,
    };
    let all = || Requirement::all_checks(Isa::Sse41.built());
    let required = if args.require.is_empty() { all() } else { args.require.clone() };
    Ok(Options {
        op: args.op.clone(),
        symbol: args.symbol.clone(),
        flags: args.flags.clone(),
        formula,
        check_only: args.check,
        steps: args.step,
        seconds: args.timeout,
        seed: args.seed,
        required,
    })
}

/// Prints the verdict on the only file.
fn one(args: &TryArgs, outcome: Result<Verdict, Unusable>) -> Result<ExitCode, Failure> {
    let verdict = outcome.map_err(Failure::input)?;
    if !verdict.warnings.is_empty() {
        say(verdict.warnings.trim_end());
    }
    print_result(args.json, &verdict, || text::text(&verdict, colour_on_stdout()))?;
    Ok(if verdict.holds { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Prints a line for each file. What cannot be used decides the exit status.
fn several(args: &TryArgs, outcomes: Vec<Outcome>) -> Result<ExitCode, Failure> {
    if args.json {
        print_result(true, &Tried { files: &outcomes }, String::new)?;
    } else {
        print(&table::text(&outcomes))?;
    }
    let unusable: Vec<_> = outcomes.iter().filter_map(Outcome::unusable).collect();
    unusable.iter().for_each(|message| say(&format!("error: {message}")));
    Ok(if !unusable.is_empty() {
        ExitCode::from(2)
    } else if outcomes.iter().all(Outcome::holds) {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}

impl Outcome {
    fn new(path: &std::path::Path, outcome: Result<Verdict, Unusable>) -> Self {
        match outcome {
            Ok(verdict) => Outcome::Judged(Box::new(verdict)),
            Err(Unusable(unusable)) => {
                Outcome::Unusable { file: rayo::internals::scene::shown(path).to_string(), holds: false, unusable }
            }
        }
    }

    fn holds(&self) -> bool {
        matches!(self, Outcome::Judged(verdict) if verdict.holds)
    }

    fn unusable(&self) -> Option<&str> {
        match self {
            Outcome::Judged(_) => None,
            Outcome::Unusable { unusable, .. } => Some(unusable),
        }
    }
}
