//! The program `rayo`.

use std::process::ExitCode;

#[global_allocator]
static MEMORY: rayo::kernels::memory::Memory = rayo::kernels::memory::Memory;

/// The log of what was checked out, whose last line names the commit, if the program was built from a repository.
const LOG: Option<&[u8]> = include!(concat!(env!("OUT_DIR"), "/log.rs"));

/// The first digits of that name: a line has the old commit and the new one.
static COMMIT: Option<[u8; 12]> = match LOG {
    Some(log) => commit(log),
    None => None,
};

const fn commit(log: &[u8]) -> Option<[u8; 12]> {
    let mut begin = log.len().saturating_sub(1);
    while begin > 0 && log[begin - 1] != b'\n' {
        begin -= 1;
    }
    while begin < log.len() && log[begin] != b' ' {
        begin += 1;
    }
    match log.split_at(begin).1 {
        [b' ', rest @ ..] => rest.first_chunk().copied(),
        _ => None,
    }
}

fn main() -> ExitCode {
    if let Some(Ok(commit)) = COMMIT.as_ref().map(|digits| std::str::from_utf8(digits)) {
        rayo::measure::set_commit(commit);
    }
    rayo::cli::main()
}
