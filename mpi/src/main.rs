//! The program `rayo-mpi`: the pictures of `rayo render`, traced by all processes that MPI starts.

mod arguments;
mod bands;
mod picture;
mod ranks;

use std::env;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::process::ExitCode;

use clap::Parser;
use rayo::Engine;

use crate::arguments::Arguments;
use crate::ranks::Ranks;

/// Why there is no picture: what to say, and the exit status that says whose fault it is.
pub struct Failure {
    message: String,
    status: u8,
}

impl Failure {
    /// Bad usage or bad input.
    fn input(error: impl ToString) -> Self {
        Failure { message: error.to_string(), status: 2 }
    }

    /// A write failed, or the ranks are not alike.
    fn output(error: impl ToString) -> Self {
        Failure { message: error.to_string(), status: 1 }
    }

    /// Prints the message.
    fn tell(&self) -> ExitCode {
        let prefix = if self.message.starts_with("error: ") { "" } else { "error: " };
        say(&format!("{prefix}{}", self.message));
        ExitCode::from(self.status)
    }
}

/// Prints a message to standard error. It may quote a file, so that control characters are escaped.
fn say(text: &str) {
    let is_plain = |c: char| !c.is_control() || c == '\n' || c == '\t';
    let spell = |c: char| if is_plain(c) { c.to_string() } else { c.escape_default().to_string() };
    eprintln!("{}", text.chars().map(spell).collect::<String>());
}

fn main() -> ExitCode {
    // A panic in any thread ends the process: MPI then ends all ranks. A rank that went on without
    // one of its threads would leave the others waiting.
    let print_panic = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        print_panic(panic);
        std::process::exit(101);
    }));
    let Some(ranks) = Ranks::join() else {
        return Failure::output("MPI cannot be started").tell();
    };
    // The message is printed while `ranks` exists: dropping it ends MPI here, and as soon as one
    // rank has ended with a failure `mpirun` ends the others.
    match run(&ranks) {
        Ok(status) => status,
        Err(failure) if ranks.rank() == 0 => failure.tell(),
        Err(failure) => ExitCode::from(failure.status),
    }
}

/// Renders the scenes that the arguments name.
fn run(ranks: &Ranks) -> Result<ExitCode, Failure> {
    are_alike(ranks)?;
    let arguments = match Arguments::try_parse() {
        Ok(arguments) => arguments,
        Err(message) => {
            if ranks.rank() == 0 {
                // Standard error may be closed, and then there is nowhere to say so.
                let _ = message.print();
            }
            return Ok(ExitCode::from(message.exit_code() as u8));
        }
    };
    let engine = choose_engine(ranks, &arguments)?;
    let mut status = ExitCode::SUCCESS;
    for scene in &arguments.scenes {
        let Err(failure) = picture::render_scene(ranks, &arguments, engine, scene) else { continue };
        if arguments.scenes.len() == 1 {
            return Err(failure);
        }
        status = ExitCode::from(failure.status);
        if ranks.rank() == 0 {
            let name = scene.display().to_string();
            let is_named = failure.message.contains(&name);
            let message = if is_named { failure.message } else { format!("{name}: {}", failure.message) };
            Failure { message, ..failure }.tell();
        }
    }
    Ok(status)
}

/// Fails unless all ranks run the same program with the same arguments.
fn are_alike(ranks: &Ranks) -> Result<(), Failure> {
    let program = env::current_exe().and_then(std::fs::read).map_err(|error| {
        Failure::output(format!("the program cannot be read, which has to be the same on all ranks: {error}"))
    });
    let program = ranks.agree(program)?;
    let mut hasher = DefaultHasher::new();
    program.hash(&mut hasher);
    ranks.same(
        &hasher.finish().to_le_bytes(),
        "this is another build of rayo-mpi than that of rank 0: install one on all",
    )?;
    let engine = env::var_os(arguments::ENGINE_VARIABLE).filter(|engine| !engine.is_empty());
    let arguments = format!("{engine:?} {:?}", env::args_os().skip(1).collect::<Vec<_>>());
    ranks.same(
        arguments.as_bytes(),
        "this was started with other arguments, or another RAYO_ENGINE, than rank 0: start all alike",
    )
}

/// Refuses an engine that this CPU or this build does not have.
fn require_usable(engine: Engine) -> Result<Engine, Failure> {
    if engine.usable() { Ok(engine) } else { Err(Failure::input(rayo::EngineError::Unusable(engine))) }
}

/// The engine that the arguments name, or else the fastest of rank 0 that all ranks run.
fn choose_engine(ranks: &Ranks, arguments: &Arguments) -> Result<Engine, Failure> {
    if let Some(name) = arguments.named_engine() {
        return ranks.agree(name.parse::<Engine>().map_err(Failure::input).and_then(require_usable));
    }
    let usable_by_rank = ranks.gather(Engine::ALL.iter().map(|engine| u8::from(engine.usable())).collect());
    let run_by_all = |index: &usize| usable_by_rank.iter().all(|usable| usable.get(*index) == Some(&1));
    let fastest = Engine::ALL.iter().position(|engine| *engine == Engine::fastest());
    let chosen = fastest.filter(run_by_all).or_else(|| {
        let is_packet = |index: &usize| Engine::ALL[*index].is_packet();
        (0..Engine::ALL.len()).rev().filter(is_packet).find(run_by_all)
    });
    let name = chosen.map_or(Engine::Rust, |index| Engine::ALL[index]).name();
    let name = ranks.broadcast(name.as_bytes().to_vec());
    ranks.agree(String::from_utf8_lossy(&name).parse().map_err(Failure::input))
}
