//! The program, run in a directory as its users run it.

use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Output};

/// Runs it with these arguments; neither colours nor a width or an engine of the developer's own. What RAYO_RUNNER names plays
/// another CPU for it.
pub fn rayo(arguments: impl IntoIterator<Item = impl AsRef<OsStr>>, directory: &Path) -> Output {
    let program = env!("CARGO_BIN_EXE_rayo");
    let runner = std::env::var_os("RAYO_RUNNER");
    let mut command = Command::new(runner.as_deref().unwrap_or(program.as_ref()));
    command.args(runner.as_ref().map(|_| program));
    command.env("NO_COLOR", "1").env_remove("COLUMNS").env_remove("RAYO_ENGINE");
    command.current_dir(directory).args(arguments).output().unwrap()
}

/// The program as a shell starts it in the foreground: no signal is ignored, as some are where tests run in the background.
#[cfg(target_os = "linux")]
#[allow(dead_code, reason = "not every program of those that share it sends signals")]
pub fn in_the_foreground() -> Command {
    let mut command = Command::new("env");
    command.arg("--default-signal").arg(env!("CARGO_BIN_EXE_rayo"));
    command
}

/// Sends it a signal, by the shell: minimal systems have no `kill` beside it. Whether it was there to hear.
#[cfg(target_os = "linux")]
#[allow(dead_code, reason = "as above")]
pub fn signal(name: &str, process: u32) -> bool {
    Command::new("sh").args(["-c", "kill -s \"$0\" \"$1\"", name, &process.to_string()]).status().unwrap().success()
}
