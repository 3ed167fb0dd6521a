//! The command line program: one module per subcommand.

mod accuracy;
mod commit;
mod convert;
mod development;
mod diff;
mod engine;
mod essay;
mod experiment;
mod fit;
mod info;
mod make;
mod measuring;
mod number;
mod ops;
mod plan;
mod preview;
mod render;
mod report;
mod shell;
mod signals;
mod stability;
mod step;
mod table;
#[cfg(unix)]
mod try_kernel;
mod usage;
mod view;
mod window;

use std::fs::File;
use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Mutex, PoisonError};

use clap::{Parser, Subcommand};
use serde::Serialize;
use terminal_size::{Height, Width, terminal_size_of};

use rayo::internals::kernels::crash;
use rayo::internals::kernels::sys::{has_small_stack, is_open, new_thread};
use rayo::internals::kernels::{Isa, StandardFloats, memory};
#[cfg(not(target_os = "linux"))]
use rayo::internals::render::remove_unfinished;
use rayo::internals::render::{RenderError, is_standard_output};
use rayo::internals::scene::{SceneFormat, brief, is_unseen, shown};
use rayo_lab::measure::crash::{code_of_kernels, describe};
use rayo_lab::measure::set_commit;

/// Trace spheres and triangles with hand-written SIMD kernels, and measure them
///
/// Results go to standard output, progress and warnings to standard error. Exit status: 0 done, 1 a
/// write or a check failed or a kernel crashed, 2 invalid usage or input.
#[derive(Debug, Parser)]
#[command(name = "rayo", version, max_term_width = 120)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Render(render::RenderArgs),
    Convert(convert::ConvertArgs),
    Make(make::MakeArgs),
    Diff(diff::DiffArgs),
    Info(info::InfoArgs),
    View(window::WindowArgs),
    Plan(plan::PlanArgs),
    Accuracy(accuracy::AccuracyArgs),
    Experiment(experiment::ExperimentArgs),
    Ops(ops::OpsArgs),
    Report(report::ReportArgs),
    Stability(stability::StabilityArgs),
    Step(step::StepArgs),
    #[cfg(unix)]
    Try(try_kernel::TryArgs),
    Completions(shell::CompletionsArgs),
    Man(shell::ManArgs),
}

/// An error that ends a command: a message, and the exit status, which tells whose fault it is.
struct Failure {
    message: String,
    status: u8,
}

impl Failure {
    /// Invalid usage or input.
    fn input(error: impl ToString) -> Self {
        Failure { message: error.to_string(), status: 2 }
    }

    /// A write failed, or a check did not hold.
    fn output(error: impl ToString) -> Self {
        Failure { message: error.to_string(), status: 1 }
    }

    /// A signal ended a measurement early.
    fn stopped(message: impl Into<String>) -> Self {
        Failure { message: message.into(), status: signals::status() }
    }

    fn tell(&self) -> ExitCode {
        say(&with_prefix(&self.message));
        ExitCode::from(self.status)
    }
}

impl From<RenderError> for Failure {
    /// A failed write, such as to a full disk, is the output's fault; a setup that is impossible is
    /// the input's.
    fn from(error: RenderError) -> Self {
        match error {
            RenderError::Image(_) => Failure::output(error),
            RenderError::Memory(_) | RenderError::Size(_) | RenderError::Cancelled | RenderError::Threads { .. } => {
                Failure::input(error)
            }
        }
    }
}

/// Fails if this build lacks the assembly kernels that `what` needs.
fn require_assembly(what: &str) -> Result<(), Failure> {
    if Isa::Sse41.built() {
        return Ok(());
    }
    Err(Failure::input(format!(
        "this build has no kernels in assembly {what}: it was built without the feature `asm`, or not for x86-64"
    )))
}

/// Fails if the output file would replace one of the input files.
fn keep_apart(output: &Path, inputs: &[impl AsRef<Path>]) -> Result<(), Failure> {
    let target = output.canonicalize().ok().filter(|path| path.is_file());
    let is_one = target.is_some_and(|target| without_links(inputs).any(|input| input == target));
    if is_one { Err(is_read(output)) } else { Ok(()) }
}

/// Fails if the picture's name is a link to a file that could be a scene.
fn keep_scene_files(picture: &Path) -> Result<(), Failure> {
    let target = picture.canonicalize().unwrap_or_default();
    let is_mtl = target.extension().is_some_and(|end| end.eq_ignore_ascii_case("mtl"));
    if is_standard_output(picture) || !is_mtl && SceneFormat::from_path(&target).is_none() {
        return Ok(());
    }
    let (path, target) = (shown(picture), shown(&target));
    Err(Failure::input(format!(
        "{path} is a link to {target}, which is not a picture and would be replaced: name another file"
    )))
}

/// Fails if the picture's name is that of a terminal, such as /dev/tty.
fn keep_off_terminals(picture: &Path) -> Result<(), Failure> {
    let is_file = picture.metadata().is_ok_and(|metadata| metadata.is_file() || metadata.is_dir());
    let is_terminal = !is_file && picture.starts_with("/dev") && !is_standard_output(picture);
    if is_terminal && File::open(picture).is_ok_and(|file| file.is_terminal()) {
        let path = shown(picture);
        return Err(Failure::input(format!("{path} is a terminal, which shows no picture file: name a file with -o")));
    }
    Ok(())
}

/// Fails if standard input would be read twice.
fn keep_standard_input_whole(inputs: &[impl AsRef<Path>]) -> Result<(), Failure> {
    let names = ["-", "/dev/stdin", "/dev/fd/0", "/proc/self/fd/0"];
    let is_standard_input = |input: &&_| names.iter().any(|name| AsRef::<Path>::as_ref(*input) == Path::new(name));
    match inputs.iter().filter(is_standard_input).count() {
        0 | 1 => Ok(()),
        _ => Err(Failure::input("standard input is read once, and is named more than once: name a file")),
    }
}

/// The files that these names refer to, links resolved; missing files are left out.
fn without_links(names: &[impl AsRef<Path>]) -> impl Iterator<Item = PathBuf> {
    names.iter().filter_map(|name| name.as_ref().canonicalize().ok())
}

fn is_read(output: &Path) -> Failure {
    Failure::input(format!("{} is also read, and would be replaced: name another file", shown(output)))
}

#[global_allocator]
static MEMORY: memory::Allocator = memory::Allocator;

/// Runs the program with the arguments of the process.
fn main() -> ExitCode {
    if let Some(commit) = commit::name() {
        set_commit(commit);
    }
    // Must be called before a second thread starts.
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    memory::use_large_pages();
    // Parsing the arguments takes about 70 kB of stack.
    if !has_small_stack() {
        return run();
    }
    match new_thread().and_then(|thread| thread.spawn(run)) {
        Ok(other) => other.join().unwrap_or(ExitCode::from(101)),
        Err(error) => {
            let small = "the stack has less than 1 MiB, and no thread with a larger one can be started";
            Failure::output(format!("{small} ({error}): raise ulimit -s")).tell()
        }
    }
}

fn run() -> ExitCode {
    let _floats = StandardFloats::set();
    #[cfg(not(target_os = "linux"))]
    memory::before_the_end(remove_unfinished);
    signals::survive_file_size_limit();
    crash::explain(code_of_kernels(), end_after_crash);
    warn_of_ranks();
    let arguments = match Cli::try_parse() {
        Ok(arguments) => arguments,
        Err(other) => return help_or_usage(in_print().unwrap_or(other)),
    };
    let result = match arguments.command {
        Command::Render(args) => render::run(&args),
        Command::Convert(args) => convert::run(&args),
        Command::Make(args) => make::run(&args),
        Command::Diff(args) => diff::run(&args),
        Command::Info(args) => info::run(&args),
        Command::View(args) => window::run(&args),
        Command::Plan(args) => plan::run(&args),
        Command::Accuracy(args) => accuracy::run(&args),
        Command::Experiment(args) => experiment::run(&args),
        Command::Ops(args) => ops::run(&args),
        Command::Report(args) => report::run(&args),
        Command::Stability(args) => stability::run(&args),
        Command::Step(args) => step::run(&args),
        #[cfg(unix)]
        Command::Try(args) => try_kernel::run(&args),
        Command::Completions(args) => shell::completions(&args),
        Command::Man(args) => shell::man(&args),
    };
    result.unwrap_or_else(|failure| failure.tell())
}

/// If MPI or Slurm has started several processes, warns once (in the first of them) that each
/// process does all of the work.
fn warn_of_ranks() {
    /// The environment variables with the number of processes and the rank of this one: of Open
    /// MPI, of MPICH and its derivatives, and of Slurm's srun.
    const LAUNCHERS: [[&str; 2]; 3] = [
        ["OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK"],
        ["PMI_SIZE", "PMI_RANK"],
        ["SLURM_STEP_NUM_TASKS", "SLURM_PROCID"],
    ];
    let number = |variable| std::env::var(variable).ok()?.parse::<u64>().ok();
    let together = LAUNCHERS.iter().find(|[size, _]| number(size).is_some_and(|size| size > 1));
    if let Some([size, _]) = together.filter(|[_, rank]| number(rank) == Some(0)) {
        say(&format!(
            "warning: this is one of {} processes ({size}), each of which does all the work by itself: \
             `rayo-mpi`, which `make mpi` builds, is the program that shares a picture among them",
            number(size).unwrap_or_default()
        ));
    }
}

/// The error of `clap`, with the arguments that it repeats made safe to print.
fn in_print() -> Option<clap::Error> {
    let mut error = Cli::try_parse_from(arguments_in_print()).err()?;
    usage::add_tips(&mut error, arguments_in_print());
    Some(error)
}

fn arguments_in_print() -> impl Iterator<Item = String> {
    std::env::args_os().map(|argument| brief(&argument.to_string_lossy()))
}

/// Help and version texts are results; any other message without a command is invalid usage.
fn help_or_usage(message: clap::Error) -> ExitCode {
    if message.exit_code() == 0 {
        let text = text_of(&message, colour_on_stdout());
        return write_out(text.as_bytes()).map_or_else(|failure| failure.tell(), |()| ExitCode::SUCCESS);
    }
    say(text_of(&message, colour_on_stderr()).trim_end());
    ExitCode::from(u8::try_from(message.exit_code()).unwrap_or(2))
}

/// The text of clap's message, with terminal styles if `colour`.
fn text_of(message: &clap::Error, colour: bool) -> String {
    let text = message.render();
    if colour { text.ansi().to_string() } else { text.to_string() }
}

/// Adds "error: ", unless the message begins so itself, as rendered diagnostics do.
fn with_prefix(message: &str) -> String {
    if message.starts_with("error: ") || message.starts_with('\u{1b}') {
        message.into()
    } else {
        format!("error: {message}")
    }
}

/// From now on, signals that end the process also remove the hidden files that are being written.
/// On Linux these files have no name and vanish with the process.
fn remove_part_files_on_signals() -> Result<(), Failure> {
    if cfg!(target_os = "linux") { Ok(()) } else { listen_once(end_at_once) }
}

/// Ends the process with the exit status of the received signal.
fn end_at_once() {
    #[cfg(not(target_os = "linux"))]
    remove_unfinished();
    signals::exit()
}

/// Reports the crash of a kernel and ends the process.
fn end_after_crash(crash: crash::Crash) -> ! {
    let failure = Failure::output(describe(&crash, None));
    failure.tell();
    std::process::exit(failure.status.into())
}

/// Listens for signals, unless something already does.
fn listen_once(heard: impl FnMut() + Send + 'static) -> Result<(), Failure> {
    static IS_HEARD: Mutex<bool> = Mutex::new(false);
    let mut is_heard = IS_HEARD.lock().unwrap_or_else(PoisonError::into_inner);
    if !*is_heard {
        signals::listen(heard).map_err(Failure::output)?;
        *is_heard = true;
    }
    Ok(())
}

fn colour_on_stderr() -> bool {
    io::stderr().is_terminal() && colour_is_wanted()
}

fn colour_on_stdout() -> bool {
    io::stdout().is_terminal() && colour_is_wanted()
}

// SGR codes of terminal styles.
const PLAIN: &str = "0";
const BOLD: &str = "1";
const DIM: &str = "2";
const RED: &str = "31";
const GREEN: &str = "32";
const YELLOW: &str = "33";
const CYAN: &str = "36";

/// The text in a style, if `colour`.
fn styled(colour: bool, code: &str, text: &str) -> String {
    if colour && !text.is_empty() { format!("\u{1b}[{code}m{text}\u{1b}[0m") } else { text.into() }
}

fn colour_is_wanted() -> bool {
    std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
}

/// Prints a message that is not a result to standard error.
fn say(text: &str) {
    // A failed write is ignored: nothing important is lost.
    let _ = writeln!(io::stderr(), "{}", harmless(text));
}

/// The text without invisible characters, except line ends and terminal styles, so that text from
/// files is safe to print.
fn harmless(text: &str) -> String {
    let is_style = |at: usize| {
        let style = text[at..].strip_prefix("\u{1b}[");
        style.is_some_and(|style| style.trim_start_matches(|c: char| c.is_ascii_digit() || c == ';').starts_with('m'))
    };
    let is_kept = |(at, c): (usize, char)| !is_unseen(c) || c == '\n' || c == '\t' || is_style(at);
    let spell = |(at, c)| if is_kept((at, c)) { c.to_string() } else { c.escape_default().to_string() };
    text.char_indices().map(spell).collect()
}

/// A JSON document: the number of its schema, followed by the fields of its content.
#[derive(Serialize)]
struct Document<'a, T> {
    schema: u32,
    #[serde(flatten)]
    content: &'a T,
}

/// The text of a JSON document; all documents have schema 1. Characters that text output would
/// escape are escaped as JSON requires.
fn json(content: &impl Serialize) -> Result<String, Failure> {
    let text = serde_json::to_string_pretty(&Document { schema: 1, content }).map_err(Failure::output)?;
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        if is_unseen(c) && c != '\n' {
            c.encode_utf16(&mut [0; 2]).iter().for_each(|unit| escaped += &format!("\\u{unit:04x}"));
        } else {
            escaped.push(c);
        }
    }
    Ok(escaped)
}

/// Prints a result, as a JSON document or as text.
fn print_result(as_json: bool, result: &impl Serialize, text: impl FnOnce() -> String) -> Result<(), Failure> {
    if !as_json {
        return print(&text());
    }
    write_out(format!("{}\n", json(result)?).as_bytes())
}

/// The width and height of the terminal in characters, if standard output is one.
fn terminal_size() -> Option<(usize, usize)> {
    let (Width(width), Height(height)) = terminal_size_of(io::stdout())?;
    Some((width.into(), height.into()))
}

/// The width of the terminal in characters, if standard output is one.
fn terminal_width() -> Option<usize> {
    Some(terminal_size()?.0)
}

/// Prints text to standard output; for a terminal, lines are fitted to its width.
fn print(text: &str) -> Result<(), Failure> {
    let text = harmless(text);
    let text = terminal_width().map_or_else(|| text.clone(), |width| fit::fit(&text, width));
    write_out(text.as_bytes())
}

/// Writes to standard output. If the reader has closed the pipe, that is not an error.
fn write_out(bytes: &[u8]) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    let opened = if is_open(1) { Ok(()) } else { Err(io::Error::other("it is closed")) };
    match opened.and_then(|()| out.write_all(bytes)).and_then(|()| out.flush()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            Err(Failure::output(format!("cannot write to standard output: {error}")))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use std::any::TypeId;
    use std::ffi::OsString;
    use std::path::Path;

    use clap::error::ErrorKind;
    use clap::{Arg, Command, CommandFactory};

    use super::*;

    /// The error of the command line that has only this option, with this value; None if it is
    /// accepted.
    fn refusal_of(command: &Command, argument: &Arg, value: &str) -> Option<clap::Error> {
        let option = format!("--{}", argument.get_long()?);
        let values = vec![value; argument.get_num_args().map_or(1, |count| count.min_values())];
        Cli::try_parse_from([&["rayo", command.get_name(), &option], &values[..]].concat()).err()
    }

    /// Whether the value of an option is made of numbers: neither a text nor a word of a list.
    fn takes_numbers(argument: &Arg) -> bool {
        let names = [TypeId::of::<PathBuf>(), TypeId::of::<OsString>(), TypeId::of::<String>()];
        argument.get_long().is_some()
            && argument.get_action().takes_values()
            && !names.iter().any(|name| argument.get_value_parser().type_id() == *name)
            && argument.get_possible_values().is_empty()
    }

    #[test]
    fn bad_number_of_an_option_is_answered_with_good_ones() {
        let mut answered = 0;
        for command in Cli::command().get_subcommands() {
            for argument in command.get_arguments().filter(|argument| takes_numbers(argument)) {
                for value in ["x", "-5", "-0.1", "-1,0", "-1..2", "-inf", "1e400", "99999999999999999999999", "0.5.5"] {
                    let Some(error) = refusal_of(command, argument, value) else { continue };
                    // The value is accepted; the error is about other arguments.
                    if [ErrorKind::MissingRequiredArgument, ErrorKind::ArgumentConflict].contains(&error.kind()) {
                        continue;
                    }
                    assert_eq!(error.kind(), ErrorKind::ValueValidation, "{error}");
                    assert!(error.to_string().contains("': expected "), "{error}");
                    answered += 1;
                }
            }
        }
        assert!(answered > 100, "only {answered} were refused");
    }

    #[test]
    fn exclusive_options_are_told_with_what_they_belong_to() {
        let mut excluded = 0;
        let mut cli = Cli::command();
        cli.build();
        for command in cli.get_subcommands() {
            let words = |argument: &Arg| -> Vec<String> {
                let words = argument.get_possible_values();
                let words = words.iter().map(|word| word.get_name().to_owned());
                let values = ["1", "1,2", "1,2,3", "1x1", "x.png", "f32", "proof"].map(str::to_owned);
                let value = words.chain(values).find(|value| {
                    let refusal = refusal_of(command, argument, value);
                    refusal.is_none_or(|error| error.kind() != ErrorKind::ValueValidation)
                });
                let value = value.filter(|_| argument.get_action().takes_values());
                argument.get_long().map(|name| format!("--{name}")).into_iter().chain(value).collect()
            };
            for argument in command.get_arguments() {
                for other in command.get_arg_conflicts_with(argument) {
                    let name = command.get_name().to_owned();
                    let arguments = [vec!["rayo".into(), name], words(argument), words(other)].concat();
                    let mut error = Cli::try_parse_from(&arguments).expect_err("they exclude each other");
                    assert_eq!(error.kind(), ErrorKind::ArgumentConflict, "{arguments:?}: {error}");
                    usage::add_tips(&mut error, arguments.iter().cloned());
                    assert!(error.to_string().contains("tip: "), "{arguments:?}: {error}");
                    excluded += 1;
                }
            }
        }
        assert!(excluded > 10, "only {excluded} were refused");
    }

    #[test]
    fn help_of_every_command_has_three_valid_examples() {
        let command = Cli::command();
        for subcommand in command.get_subcommands() {
            let name = subcommand.get_name();
            let text = subcommand.get_after_help().map(ToString::to_string).unwrap_or_default();
            let mut lines = text.lines();
            assert_eq!(lines.next(), Some("Examples:"), "{name}");
            let examples: Vec<_> = lines.collect();
            assert_eq!(examples.len(), 3, "{name}: {text}");
            for example in examples {
                // What is behind these is for the shell.
                let words: Vec<_> = example.split_whitespace().take_while(|word| !["|", ">"].contains(word)).collect();
                assert_eq!(words[..2], ["rayo", name], "{example}");
                assert!(example.len() < 80, "it is wrapped: {example}");
                Cli::try_parse_from(&words).unwrap_or_else(|error| panic!("{example}: {error}"));
                for file in words.iter().filter(|word| word.starts_with("scenes/")) {
                    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join(file);
                    assert!(path.is_file(), "{example}: there is no {file}");
                }
            }
        }
    }
}
