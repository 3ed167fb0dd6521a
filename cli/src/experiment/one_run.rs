//! A run of the experiment in a process of its own: starting the process, and what it does.

use std::io::{self, BufRead, BufReader, Write};
use std::ops::Range;
use std::process::{Child, ChildStdout, Command, ExitCode, Stdio};

use serde::{Deserialize, Serialize};

use super::ExperimentArgs;
use crate::Failure;
use crate::measuring::{cores, failure, no_clock};
use rayo::internals::kernels::sys;
use rayo_lab::experiments::lab::Turn;
use rayo_lab::experiments::ladder::{self, Rounds};
use rayo_lab::experiments::speedup::{self, Settings};
use rayo_lab::measure::MachineClock;

/// What the process prints: a line of JSON for each message.
#[derive(Serialize, Deserialize)]
pub(super) enum Message {
    /// The times of all engines at one size.
    Size(Vec<Turn>),
    /// The times of the ladder's rounds, after all sizes.
    Rungs(Rounds),
}

/// Performs run `number` in this process: prints each [`Message`] as soon as it is measured.
pub(super) fn measure(args: &ExperimentArgs, number: usize) -> Result<ExitCode, Failure> {
    // Have this process killed when its parent ends, however that ends.
    #[cfg(target_os = "linux")]
    let _ = rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::KILL));
    let settings = args.settings()?;
    let mut clock = MachineClock::counter().ok_or_else(no_clock)?;
    let cores = cores()?;
    if let Some(core) = args.core {
        // The parent has tried pinning and warned if it is impossible.
        let _ = sys::pin_to(core);
    }
    let mut out = io::stdout().lock();
    let mut written = Ok(());
    let mut print = |message: &Message| {
        written = serde_json::to_writer(&mut out, message).map_err(io::Error::from).and_then(|()| {
            writeln!(out)?;
            out.flush()
        });
        written.is_ok()
    };
    speedup::measure_run(&settings, number, &mut clock, &mut |turns| print(&Message::Size(turns))).map_err(failure)?;
    let (first, end) = (args.rounds[0], args.rounds[1]);
    let rounds = ladder::measure_run(args.ladder, first..end, &cores, &mut clock).map_err(failure)?;
    print(&Message::Rungs(rounds));
    written.map_err(|error| Failure::output(format!("cannot write to standard output: {error}")))?;
    Ok(ExitCode::SUCCESS)
}

/// Starts a process for a run with its rounds of the ladder, pinned to `core`, and waits for it.
/// `hear` gets each message; if it returns false, the process is killed.
pub(super) fn in_own_process(
    args: &ExperimentArgs,
    settings: &Settings,
    number: usize,
    rounds: Range<usize>,
    core: Option<usize>,
    cores: &sys::Cores,
    hear: &mut dyn FnMut(Message) -> bool,
) -> Result<(), Failure> {
    let failed = |error: &dyn std::fmt::Display| Failure::output(format!("run {number} in its own process: {error}"));
    let started = ladder::on_all(cores, || start(args, settings, number, rounds, core)).map_err(failure)?;
    let mut process = started.map_err(|error| failed(&format!("cannot start: {error}; raise ulimit -u or -n")))?;
    for line in (&mut process.messages).lines() {
        let message = serde_json::from_str(&line.map_err(|error| failed(&error))?).map_err(|error| failed(&error))?;
        if !hear(message) {
            return Ok(());
        }
    }
    let status = process.child.wait().map_err(|error| failed(&error))?;
    if status.success() { Ok(()) } else { Err(failed(&format!("it ended early, {status}"))) }
}

fn start(
    args: &ExperimentArgs,
    settings: &Settings,
    number: usize,
    rounds: Range<usize>,
    core: Option<usize>,
) -> io::Result<Process> {
    let engines: Vec<_> = settings.engines.iter().map(|engine| engine.name()).collect();
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["experiment", "--one-run", &number.to_string(), "--engines", &engines.join(",")]);
    command.args(["--rounds", &rounds.start.to_string(), &rounds.end.to_string()]);
    if let Some(core) = core {
        command.args(["--core", &core.to_string()]);
    }
    for (given, flag) in [(args.quick, "--quick"), (args.ladder, "--ladder")] {
        if given {
            command.arg(flag);
        }
    }
    command.stdin(Stdio::null()).stdout(Stdio::piped());
    // In a process group of its own, the child does not receive Ctrl-C: the parent handles it and
    // kills the child.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let mut child = command.spawn()?;
    let messages = BufReader::new(child.stdout.take().expect("it was asked for"));
    Ok(Process { child, messages })
}

/// A child process that is killed when this is dropped.
struct Process {
    child: Child,
    messages: BufReader<ChildStdout>,
}

impl Drop for Process {
    fn drop(&mut self) {
        // Killing fails if the process has ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
