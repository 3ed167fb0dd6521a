//! `rayo try --watch`: does it again whenever a file changes, on a cleared screen.

use std::io::IsTerminal;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::{Duration, SystemTime};

use super::super::{Failure, write_out};

/// How often the files are looked at.
const PAUSE: Duration = Duration::from_millis(100);
/// Clears a terminal and goes to its first line.
const CLEAR: &[u8] = b"\x1b[2J\x1b[H";

/// Does `work` now and after each change of a file, for ever.
///
/// # Errors
/// If nothing can be printed any more. What `work` has against a file is told, and the file is
/// waited for.
pub fn watch(files: &[PathBuf], work: impl Fn() -> Result<ExitCode, Failure>) -> Result<ExitCode, Failure> {
    let is_terminal = std::io::stdout().is_terminal();
    loop {
        let seen = times(files);
        if is_terminal {
            write_out(CLEAR)?;
        }
        if let Err(failure) = work() {
            if failure.status != 2 {
                return Err(failure);
            }
            failure.tell();
        }
        while times(files) == seen {
            std::thread::sleep(PAUSE);
        }
    }
}

/// When each file was changed last, and its length; None for one that is not there: an editor may
/// be replacing it.
fn times(files: &[PathBuf]) -> Vec<Option<(SystemTime, u64)>> {
    let time = |path: &PathBuf| {
        let metadata = path.metadata().ok()?;
        Some((metadata.modified().ok()?, metadata.len()))
    };
    files.iter().map(time).collect()
}
