//! `rayo view`: starts `rayo-view`, the program with the window, which is a separate package.

use std::env::consts::EXE_SUFFIX;
use std::ffi::OsString;
use std::io::{self, ErrorKind};
use std::path::PathBuf;
use std::process::{Command, ExitCode};

use clap::Args;

use super::Failure;

/// Show a scene in a window, and compare engines in it by hand
///
/// This starts the program rayo-view, if it is installed beside this one; in the repository,
/// `make view` builds it. `rayo-view --help` lists its options and its keys.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo view scenes/island.toml
  rayo view scenes/sphere.in --engine c --threads 1
  rayo view bunny.ply --size 1280x720 --shadows")]
pub struct WindowArgs {
    /// The scene, and options of rayo-view
    #[arg(value_name = "SCENE", required = true, trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<OsString>,
}

/// Starts the program.
pub fn run(args: &WindowArgs) -> Result<ExitCode, Failure> {
    let name = PathBuf::from(format!("rayo-view{EXE_SUFFIX}"));
    let beside = std::env::current_exe().map(|this| this.with_file_name(&name)).ok().filter(|path| path.is_file());
    // If it is not in this program's directory, the system searches PATH.
    let mut command = Command::new(beside.unwrap_or(name));
    run_instead_of_this(command.args(&args.arguments)).map_err(|error| match error.kind() {
        ErrorKind::NotFound => Failure::output(
            "the program rayo-view is not installed beside rayo: `make view SCENE=...` in the repository builds and starts it",
        ),
        _ => Failure::output(format!("cannot start rayo-view: {error}")),
    })
}

/// Replaces this process by the program, so that signals reach it.
#[cfg(unix)]
fn run_instead_of_this(command: &mut Command) -> io::Result<ExitCode> {
    use std::os::unix::process::CommandExt as _;

    Err(command.exec())
}

/// Runs the program and ends with its exit status.
#[cfg(not(unix))]
fn run_instead_of_this(command: &mut Command) -> io::Result<ExitCode> {
    let status = command.status()?;
    Ok(ExitCode::from(status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(1)))
}
