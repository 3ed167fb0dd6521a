//! The program, run in a directory as its users run it.

use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

/// What a run leaves to see.
#[derive(Debug)]
pub struct Run {
    pub status: i32,
    pub stdout: String,
    pub stderr: String,
}

#[allow(dead_code, reason = "not every program of those that share it asks for all of it")]
impl Run {
    #[track_caller]
    pub fn of(output: Output) -> Self {
        let text = |bytes| String::from_utf8(bytes).unwrap();
        let status = output.status.code().unwrap_or_else(|| panic!("it was killed: {}", output.status));
        Run { status, stdout: text(output.stdout), stderr: text(output.stderr) }
    }

    /// What it printed, where it succeeded.
    #[track_caller]
    pub fn printed(&self) -> &str {
        assert_eq!(self.status, 0, "{}", self.stderr);
        &self.stdout
    }

    /// Its only line on standard error, where it succeeded and printed nothing.
    #[track_caller]
    pub fn summary(&self) -> &str {
        assert_eq!((self.printed(), self.stderr.lines().count()), ("", 1), "{}", self.stderr);
        self.stderr.trim_end()
    }

    /// The one JSON document that it printed.
    #[track_caller]
    pub fn document(&self) -> Value {
        assert!(self.stdout.ends_with('\n'), "{self:?}");
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{error}: {}", self.stdout))
    }

    /// Holds that it was bad usage or bad input, of which it said so among other words.
    #[track_caller]
    pub fn refuses(&self, words: &str) {
        assert_eq!((self.status, self.stdout.as_str()), (2, ""), "{}", self.stderr);
        assert!(self.stderr.contains(words), "`{words}` is not in {}", self.stderr);
    }
}

/// Runs it with these arguments; neither colours nor a width or an engine of the developer's own.
/// What RAYO_RUNNER names plays another CPU for it.
#[track_caller]
pub fn rayo(arguments: impl IntoIterator<Item = impl AsRef<OsStr>>, directory: &Path) -> Run {
    let program = env!("CARGO_BIN_EXE_rayo");
    let runner = std::env::var_os("RAYO_RUNNER");
    let mut command = Command::new(runner.as_deref().unwrap_or(program.as_ref()));
    command.args(runner.as_ref().map(|_| program));
    command.env("NO_COLOR", "1").env_remove("COLUMNS").env_remove("RAYO_ENGINE");
    Run::of(command.current_dir(directory).args(arguments).output().unwrap())
}

/// The program as a shell starts it in the foreground: no signal is ignored, as some are where
/// tests run in the background.
#[cfg(target_os = "linux")]
#[allow(dead_code, reason = "not every program of those that share it sends signals")]
pub fn in_the_foreground() -> Command {
    let mut command = Command::new("env");
    command.arg("--default-signal").arg(env!("CARGO_BIN_EXE_rayo"));
    command
}

/// Sends it a signal, by the shell: minimal systems have no `kill` beside it. Whether it was there
/// to hear.
#[cfg(target_os = "linux")]
#[allow(dead_code, reason = "as above")]
pub fn signal(name: &str, process: u32) -> bool {
    Command::new("sh").args(["-c", "kill -s \"$0\" \"$1\"", name, &process.to_string()]).status().unwrap().success()
}
