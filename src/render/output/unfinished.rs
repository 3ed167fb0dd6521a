//! The hidden files that are being written on systems without nameless ones: an end of the process
//! removes them.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Keeps a hidden file listed.
pub(super) struct Unfinished(PathBuf);

impl Unfinished {
    /// Lists a file that is about to be created.
    pub(super) fn new(path: &Path) -> Self {
        UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).push(path.into());
        Unfinished(path.into())
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner).retain(|path| *path != self.0);
    }
}

/// Removes the hidden files of everything that is being written, before the process ends.
pub fn remove_unfinished() {
    // The lock may be held by a thread that has just crashed or run out of memory: then nothing is
    // removed.
    for path in UNFINISHED.try_lock().iter().flat_map(|paths| paths.iter()) {
        // The file may already be gone.
        let _ = fs::remove_file(path);
    }
}
