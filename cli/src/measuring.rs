//! Shared by the commands that measure: atomic writing of files, a progress bar, and stopping at
//! the user's request.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use super::{Failure, convert, end_at_once, json, keep_apart, listen_once, say};
use rayo::internals::kernels::sys;
use rayo::internals::plan::on_all_cores;
use rayo::internals::scene::shown;
use rayo_lab::experiments::lab::LabError;

/// Writes a file atomically: it appears with all of its content or not at all.
pub fn write_file(directory: &Path, name: &str, content: &[u8]) -> Result<(), Failure> {
    convert::write(&directory.join(name), |out| out.write_all(content))
}

/// Writes the results: first the JSON document, from which the texts could be made again.
pub fn write_results<const N: usize>(
    directory: &Path,
    name: &str,
    document: &impl Serialize,
    texts: [(&str, String); N],
) -> Result<(), Failure> {
    for (name, text) in [(name, json(document)?)].into_iter().chain(texts) {
        write_file(directory, name, text.as_bytes())?;
    }
    Ok(())
}

/// Fails if a file of results would replace one of the inputs.
pub fn keep_results_apart(directory: &Path, names: &[&str], inputs: &[impl AsRef<Path>]) -> Result<(), Failure> {
    names.iter().try_for_each(|name| keep_apart(&directory.join(name), inputs))
}

/// The cores that threads may run on.
pub fn cores() -> Result<sys::Cores, Failure> {
    let failed = |error| Failure::output(format!("cannot ask for the cores of this thread: {error}"));
    sys::Cores::of_this_thread().map_err(failed)
}

/// Pins this thread to the core it runs on, and returns the core; warns if that is impossible.
pub fn pin() -> Option<usize> {
    let refused = |error: &std::io::Error| say(&format!("warning: the thread is not pinned to a core: {error}"));
    sys::pin_to_this_core().inspect_err(refused).ok()
}

/// Starts the worker threads that compute exact results, and then pins this thread to its core, so
/// that all times are of one core. Threads started later would inherit the pinning.
pub fn start_threads_and_pin() {
    on_all_cores(0, drop);
    pin();
}

pub fn no_clock() -> Failure {
    Failure::input("this machine has no time-stamp counter")
}

pub fn failure(error: LabError) -> Failure {
    match error {
        LabError::Engine(_) | LabError::Threads(_) => Failure::input(error),
        _ => Failure::output(error),
    }
}

/// The failure to report if a signal stopped a measurement before it was complete.
pub fn stopped_unless(complete: bool) -> Result<(), Failure> {
    let stopped = || Failure::stopped("stopped early: only what was finished is in the results");
    complete.then_some(()).ok_or_else(stopped)
}

/// Returns a flag that is set when a signal asks the process to end. A second signal ends the
/// process at once.
pub fn stop_on_signals() -> Result<Arc<AtomicBool>, Failure> {
    let stop = Arc::new(AtomicBool::new(false));
    let seen = Arc::clone(&stop);
    listen_once(move || {
        if seen.swap(true, Ordering::Relaxed) {
            end_at_once();
        }
    })?;
    Ok(stop)
}

/// Runs of at least this many seconds are announced.
const LONG: f64 = 10.0;

/// Announces how long a run will take, if it is long. `shorter` says how to get a shorter one.
pub fn announce(seconds: f64, shorter: Option<&str>) {
    if seconds >= LONG {
        let shorter = shorter.map_or_else(String::new, |how| format!("; {how} is shorter"));
        say(&format!("this will take about {}{shorter}", duration(seconds)));
    }
}

/// A duration in words, rounded to the precision of an estimate.
fn duration(seconds: f64) -> String {
    if seconds < 90.0 {
        format!("{:.0} seconds", (seconds / 10.0).ceil() * 10.0)
    } else {
        format!("{:.0} minutes", (seconds / 60.0).ceil())
    }
}

/// A progress bar on standard error, hidden if that is no terminal.
pub fn bar(length: u64) -> ProgressBar {
    let bar = ProgressBar::new(length);
    bar.set_style(bar_style("{percent} %, {eta} left"));
    bar
}

/// The style of a progress bar that takes the part of the line that `rest` leaves.
pub fn bar_style(rest: &str) -> ProgressStyle {
    ProgressStyle::with_template(&format!("{{wide_bar}} {rest}")).expect("the template is well formed")
}

/// Creates the directory for results and checks that files can be written there, before a long run
/// starts.
pub fn create_directory(path: &Path) -> Result<(), Failure> {
    let failed = |what: &str, error| {
        let path = shown(path);
        Failure::output(format!("cannot create {what} {path}: {error}; name another one with --out"))
    };
    fs::create_dir_all(path).map_err(|error| failed("the directory", error))?;
    tempfile::tempfile_in(path).map(drop).map_err(|error| failed("a file in the directory", error))
}

#[cfg(test)]
mod tests {
    use super::duration;

    #[test]
    fn a_duration_is_as_precise_as_an_estimate() {
        let words = [4.0, 10.0, 31.0, 89.0, 91.0, 600.0].map(duration);
        assert_eq!(words, ["10 seconds", "10 seconds", "40 seconds", "90 seconds", "2 minutes", "10 minutes"]);
    }
}
