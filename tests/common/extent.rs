//! How many cases tests run: all in `make test-all`, samples of the slow ones in `make test`; and
//! reporting of what cannot be tested on this machine.

#![allow(dead_code, reason = "no program of those that share it uses all of it")]

use std::env;
use std::fs::File;
use std::io::Write;

/// Whether the environment variable RAYO_ALL asks for every case.
pub fn all() -> bool {
    env::var_os("RAYO_ALL").is_some()
}

/// Every case if RAYO_ALL is set; otherwise the first and every `step`-th after it.
pub fn sampled<T>(cases: impl IntoIterator<Item = T>, step: usize) -> impl Iterator<Item = T> {
    cases.into_iter().step_by(if all() { 1 } else { step })
}

/// Reports that `check` was skipped because `need` is missing, in the file that RAYO_NOT_RUN names
/// and that `make test` shows at its end.
///
/// # Panics
/// If RAYO_MUST, a comma-separated list, contains `need`.
pub fn not_run(need: &str, check: &str) {
    let must = env::var("RAYO_MUST").unwrap_or_default();
    assert!(
        !must.split(',').any(|word| word == need),
        "{check} was not run, and RAYO_MUST asks for it: no {need} here"
    );
    let line = format!("not run, for want of {need}: {check}\n");
    if let Some(path) = env::var_os("RAYO_NOT_RUN") {
        let mut file = File::options().append(true).create(true).open(path).unwrap();
        file.write_all(line.as_bytes()).unwrap(); // at once: tests run side by side
    }
    print!("{line}");
}
