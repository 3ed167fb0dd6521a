//! Guard pages: slices next to inaccessible memory, and whether a copy of the process survives an access.

use std::io;
use std::ops::{Deref, DerefMut};
use std::panic::{self, AssertUnwindSafe};
use std::ptr::NonNull;

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
pub struct Guarded<T: Plain> {
    mapping: NonNull<libc::c_void>,
    bytes: usize,
    first: NonNull<T>,
    len: usize,
}

impl<T: Plain> Guarded<T> {
    /// A copy of `values` with an inaccessible page on each side, flush with the one on `side`.
    pub fn new(values: &[T], side: Side) -> io::Result<Self> {
        // SAFETY: a question without arguments that matter to memory.
        let page = unsafe { libc::sysconf(libc::_SC_PAGESIZE) } as usize;
        let inside = size_of_val(values).next_multiple_of(page).max(page);
        let bytes = inside + 2 * page;
        let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS;
        // SAFETY: a new mapping at no given address takes nothing from anybody.
        let mapping = unsafe { libc::mmap(std::ptr::null_mut(), bytes, libc::PROT_NONE, flags, -1, 0) };
        if mapping == libc::MAP_FAILED {
            return Err(io::Error::last_os_error());
        }
        let mapping = NonNull::new(mapping).ok_or_else(io::Error::last_os_error)?;
        // SAFETY: one page into a mapping of `inside` + 2 pages.
        let middle = unsafe { mapping.byte_add(page) };
        let skipped = match side {
            Side::Before => 0,
            Side::After => inside - size_of_val(values),
        };
        // SAFETY: `skipped` is at most `inside`. A page and the size of T are multiples of T's alignment, so that the
        // first element is aligned whichever side it is flush with.
        let first = unsafe { middle.byte_add(skipped) }.cast::<T>();
        let guarded = Guarded { mapping, bytes, first, len: values.len() };
        // SAFETY: the pages between the two guards are ours.
        if unsafe { libc::mprotect(middle.as_ptr(), inside, libc::PROT_READ | libc::PROT_WRITE) } != 0 {
            return Err(io::Error::last_os_error());
        }
        assert!(first.is_aligned(), "the size of an element must be a multiple of its alignment");
        // SAFETY: both have room for `len` elements, and new memory overlaps with none.
        unsafe { first.copy_from_nonoverlapping(NonNull::from(values).cast(), values.len()) };
        Ok(guarded)
    }
}

impl<T: Plain> Deref for Guarded<T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        // SAFETY: new() made room for `len` aligned elements and wrote them; they live as long as self.
        unsafe { std::slice::from_raw_parts(self.first.as_ptr(), self.len) }
    }
}

impl<T: Plain> DerefMut for Guarded<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        // SAFETY: as in deref, and self is borrowed alone.
        unsafe { std::slice::from_raw_parts_mut(self.first.as_ptr(), self.len) }
    }
}

impl<T: Plain> Drop for Guarded<T> {
    fn drop(&mut self) {
        // SAFETY: the mapping that new() made, whole, and nothing borrows from it any more.
        unsafe { libc::munmap(self.mapping.as_ptr(), self.bytes) };
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
