//! What the commands that measure share: files that appear whole, a progress bar, and an end when the user asks for it.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use indicatif::{ProgressBar, ProgressStyle};

use super::{Failure, convert};

/// The file appears whole or not at all.
pub fn write_file(directory: &Path, name: &str, content: &[u8]) -> Result<(), Failure> {
    convert::write(&directory.join(name), |out| out.write_all(content))
}

/// Set when the user asks for an end; a second time ends the process at once.
pub fn stop_on_ctrl_c() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    let seen = Arc::clone(&stop);
    ctrlc::set_handler(move || {
        if seen.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    })
    .map_err(|error| Failure::output(format!("cannot listen for Ctrl-C: {error}")))?;
    Ok(stop)
}

/// A bar on standard error, if that is a terminal.
pub fn bar(length: u64) -> ProgressBar {
    let bar = ProgressBar::new(length);
    bar.set_style(bar_style("{percent} %, {eta} left"));
    bar
}

/// A bar that takes what `rest` leaves of the line.
pub fn bar_style(rest: &str) -> ProgressStyle {
    ProgressStyle::with_template(&format!("{{wide_bar}} {rest}")).expect("the template is well formed")
}

/// Where the files go.
pub fn create_directory(path: &Path) -> Result<(), Failure> {
    fs::create_dir_all(path).map_err(|error| {
        let path = path.display();
        Failure::output(format!("cannot create the directory {path}: {error}; name another one with --out"))
    })
}
