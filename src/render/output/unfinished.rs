//! The hidden files that are being written, on systems without nameless files. They are removed
//! when the process ends.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Keeps a hidden file in the list until it is dropped.
pub(super) struct Unfinished(PathBuf);

impl Unfinished {
    /// Adds a file that is about to be created to the list.
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

/// Removes the hidden files that are being written, before the process ends.
pub fn remove_unfinished() {
    // If the lock is held, perhaps by a thread that has crashed or run out of memory, nothing is
    // removed.
    for path in UNFINISHED.try_lock().iter().flat_map(|paths| paths.iter()) {
        // The file may already be gone.
        let _ = fs::remove_file(path);
    }
}
