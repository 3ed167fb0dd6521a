//! Runs the program in a directory, as users do.

use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

/// The observable results of a run.
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

    /// Standard output; the run must have succeeded.
    #[track_caller]
    pub fn printed(&self) -> &str {
        assert_eq!(self.status, 0, "{}", self.stderr);
        &self.stdout
    }

    /// The only line on standard error of a run that succeeded and printed nothing.
    #[track_caller]
    pub fn summary(&self) -> &str {
        assert_eq!((self.printed(), self.stderr.lines().count()), ("", 1), "{}", self.stderr);
        self.stderr.trim_end()
    }

    /// The JSON document that the run printed.
    #[track_caller]
    pub fn document(&self) -> Value {
        assert!(self.stdout.ends_with('\n'), "{self:?}");
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{error}: {}", self.stdout))
    }

    /// Asserts that the run failed because of invalid usage or input, with these words in its
    /// message.
    #[track_caller]
    pub fn refuses(&self, words: &str) {
        assert_eq!((self.status, self.stdout.as_str()), (2, ""), "{}", self.stderr);
        assert!(self.stderr.contains(words), "`{words}` is not in {}", self.stderr);
    }
}

/// Runs the program with these arguments, independently of the developer's settings for colours,
/// terminal width and engine. RAYO_RUNNER names a program that emulates another CPU.
#[track_caller]
pub fn rayo(arguments: impl IntoIterator<Item = impl AsRef<OsStr>>, directory: &Path) -> Run {
    let program = env!("CARGO_BIN_EXE_rayo");
    let runner = std::env::var_os("RAYO_RUNNER");
    let mut command = Command::new(runner.as_deref().unwrap_or(program.as_ref()));
    command.args(runner.as_ref().map(|_| program));
    command.env("NO_COLOR", "1").env_remove("COLUMNS").env_remove("RAYO_ENGINE");
    Run::of(command.current_dir(directory).args(arguments).output().unwrap())
}

/// The program as a shell starts it in the foreground: no signal is ignored, unlike in background
/// jobs, which tests may be.
#[cfg(target_os = "linux")]
#[allow(dead_code, reason = "not every program of those that share it sends signals")]
pub fn in_the_foreground() -> Command {
    let mut command = Command::new("env");
    command.arg("--default-signal").arg(env!("CARGO_BIN_EXE_rayo"));
    command
}

/// Sends a signal to a process, by the shell, since minimal systems have no separate `kill`.
/// Returns whether the process existed.
#[cfg(target_os = "linux")]
#[allow(dead_code, reason = "as above")]
pub fn signal(name: &str, process: u32) -> bool {
    Command::new("sh").args(["-c", "kill -s \"$0\" \"$1\"", name, &process.to_string()]).status().unwrap().success()
}
