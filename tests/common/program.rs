//! The program, run in a directory as its users run it.

use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Output};

/// Runs it with these arguments; neither colours nor a width or an engine of the developer's own.
pub fn rayo(arguments: impl IntoIterator<Item = impl AsRef<OsStr>>, directory: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rayo"));
    command.env("NO_COLOR", "1").env_remove("COLUMNS").env_remove("RAYO_ENGINE");
    command.current_dir(directory).args(arguments).output().unwrap()
}
