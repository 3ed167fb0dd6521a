//! Has the program know the commit that it is built from.

use std::env;
use std::fs;
use std::path::PathBuf;

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap());
    let log = log_of_commits().map(|log| format!("Some(include_bytes!({log:?}))"));
    fs::write(out.join("log.rs"), log.unwrap_or("None".into())).unwrap();
}

/// Git's log of the commits checked out here. The program includes it (src/commit.rs), so that a
/// commit links it again, without assembling anything. None in a package.
fn log_of_commits() -> Option<PathBuf> {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR")?);
    let git = root.parent()?.join(".git");
    // In a further work tree it is a file that names the directory. Neither changes, and both
    // belong to the repository.
    let (git, stays) = match fs::read_to_string(&git) {
        Ok(text) => (root.join(text.strip_prefix("gitdir: ")?.trim()), git),
        Err(_) => (git.clone(), git.join("description")),
    };
    let log = git.join("logs/HEAD");
    (log.is_file() && stays.is_file()).then(|| {
        println!("cargo::rerun-if-changed={}", stays.display());
        log
    })
}
