//! A run of the table in a process of its own: how it is started, and what that process does.

use std::io::{self, BufRead, BufReader, Write};
use std::process::{Child, ChildStdout, Command, ExitCode, Stdio};

use super::{ExperimentArgs, run};
use crate::cli::Failure;
use crate::experiments::speedup::{self, Run, Settings, Turn};

/// What the process does: prints each size as a line of JSON as soon as it is measured.
pub(super) fn measure(args: &ExperimentArgs, number: usize) -> Result<ExitCode, Failure> {
    let settings = run::settings(args)?;
    let mut clock = run::clock()?;
    let mut out = io::stdout().lock();
    let mut written = Ok(());
    let mut print = |turns: Vec<Turn>| {
        written = serde_json::to_writer(&mut out, &turns).map_err(io::Error::from).and_then(|()| {
            writeln!(out)?;
            out.flush()
        });
        written.is_ok()
    };
    speedup::measure_run(&settings, number, &mut clock, &mut print).map_err(run::failure)?;
    written.map_err(|error| Failure::output(format!("cannot write to standard output: {error}")))?;
    Ok(ExitCode::SUCCESS)
}

/// Starts the process for run `number`, on the core that this thread is pinned to, and waits for it. `finished` hears of
/// each size; where it says no, the process is ended and the sizes so far are the run.
pub(super) fn in_own_process(
    args: &ExperimentArgs,
    settings: &Settings,
    number: usize,
    finished: &mut dyn FnMut(usize, &[Turn]) -> bool,
) -> Result<Run, Failure> {
    let failed = |error: &dyn std::fmt::Display| Failure::output(format!("run {number} in its own process: {error}"));
    let mut process = start(args, settings, number).map_err(|error| failed(&error))?;
    let mut run = Run::new();
    for line in (&mut process.sizes).lines() {
        let turns: Vec<Turn> = serde_json::from_str(&line.map_err(|error| failed(&error))?).map_err(|e| failed(&e))?;
        run.push(turns);
        let index = run.len() - 1;
        if !finished(index, &run[index]) {
            return Ok(run);
        }
    }
    let status = process.child.wait().map_err(|error| failed(&error))?;
    if !status.success() || run.len() != settings.sizes.len() {
        return Err(failed(&format!("it ended early, {status}")));
    }
    Ok(run)
}

fn start(args: &ExperimentArgs, settings: &Settings, number: usize) -> io::Result<Process> {
    let engines: Vec<_> = settings.engines.iter().map(|engine| engine.name()).collect();
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["experiment", "--one-run", &number.to_string(), "--engines", &engines.join(",")]);
    if args.quick {
        command.arg("--quick");
    }
    command.stdin(Stdio::null()).stdout(Stdio::piped());
    // Ctrl-C is for this process, which ends the other.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    let mut child = command.spawn()?;
    let sizes = BufReader::new(child.stdout.take().expect("it was asked for"));
    Ok(Process { child, sizes })
}

/// A process that ends with its owner.
struct Process {
    child: Child,
    sizes: BufReader<ChildStdout>,
}

impl Drop for Process {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
