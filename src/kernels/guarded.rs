//! Guard pages: slices next to inaccessible memory, and whether a copy of the process survives an access.

use std::io;
use std::ops::{Deref, DerefMut};
use std::panic::{self, AssertUnwindSafe};

use super::sys::Fresh;
use super::types::Plain;

/// The place of the inaccessible page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Right before the first element.
    Before,
    /// Right after the last element.
    After,
}

/// A slice that begins or ends at an inaccessible page: reading or writing outside faults at once.
pub struct Guarded<T: Plain>(Fresh<T>);

impl<T: Plain> Guarded<T> {
    /// A copy of `values` with an inaccessible page on each side, flush with the one on `side`. The size of an element must
    /// be a multiple of its alignment.
    pub fn new(values: &[T], side: Side) -> io::Result<Self> {
        // SAFETY: a question without arguments that matter to memory.
        let page = unsafe { libc::sysconf(libc::_SC_PAGESIZE) } as usize;
        let inside = size_of_val(values).next_multiple_of(page).max(page);
        let skipped = match side {
            Side::Before => 0,
            Side::After => inside - size_of_val(values),
        };
        let mut memory = Fresh::within(inside + 2 * page, page + skipped, values.len())?;
        memory.copy_from_slice(values);
        for guard in [0, page + inside] {
            // SAFETY: the first page or the last one of our own, in which no value lies.
            if unsafe { libc::mprotect(memory.pages.byte_add(guard).as_ptr(), page, libc::PROT_NONE) } != 0 {
                return Err(io::Error::last_os_error());
            }
        }
        Ok(Guarded(memory))
    }
}

impl<T: Plain> Deref for Guarded<T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        &self.0
    }
}

impl<T: Plain> DerefMut for Guarded<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.0
    }
}

/// Whether a copy of this process returns from `action`; false if a fault ends it.
///
/// # Safety
/// `action` only computes: in the copy no other thread runs, so that a lock may never be released.
pub unsafe fn survives(action: impl FnOnce()) -> io::Result<bool> {
    // SAFETY: the child does nothing but `action`, which by this function's contract computes only, and _exit.
    match unsafe { libc::fork() } {
        -1 => Err(io::Error::last_os_error()),
        0 => {
            let fine = panic::catch_unwind(AssertUnwindSafe(action)).is_ok();
            // SAFETY: ends the child at once, with nothing of the parent's run twice.
            unsafe { libc::_exit(if fine { 0 } else { 1 }) }
        }
        child => {
            let mut status = 0;
            // SAFETY: our own child, and a status that is ours to write.
            if unsafe { libc::waitpid(child, &mut status, 0) } != child {
                return Err(io::Error::last_os_error());
            }
            Ok(libc::WIFEXITED(status) && libc::WEXITSTATUS(status) == 0)
        }
    }
}
