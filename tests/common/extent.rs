//! How much is tried: every case in `make test-all`, a sample of the slow ones in `make test`; and
//! what cannot be tried here.

#![allow(dead_code, reason = "no program of those that share it uses all of it")]

use std::env;
use std::fs::File;
use std::io::Write;

/// Whether every case is asked for, by the variable RAYO_ALL.
pub fn all() -> bool {
    env::var_os("RAYO_ALL").is_some()
}

/// Every case; in a sample the first and each `step`-th after it.
pub fn sampled<T>(cases: impl IntoIterator<Item = T>, step: usize) -> impl Iterator<Item = T> {
    cases.into_iter().step_by(if all() { 1 } else { step })
}

/// Says that `check` was not made for the lack of `need`: in the file that RAYO_NOT_RUN names,
/// which `make test` shows at its end.
///
/// # Panics
/// Where RAYO_MUST, a list with commas, has that word.
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
