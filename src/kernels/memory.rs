//! The program's memory: where there is no more, it ends with a sentence that says how much was asked for, and not by an abort.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::collections::TryReserveError;
use std::io::{self, Write};
use std::sync::OnceLock;

/// The system's allocator. Who asks by [`try_reserve`] hears that there is no memory; where anybody else does, the process ends.
pub struct Memory;

static LAST_WORK: OnceLock<fn()> = OnceLock::new();

thread_local! {
    /// Whether this thread is told; and whether it is ending the process.
    static IS_TOLD: Cell<bool> = const { Cell::new(false) };
    static IS_ENDING: Cell<bool> = const { Cell::new(false) };
}

/// Has `work` done before a process ends for want of memory; the first one that is given. It has next to none itself.
pub fn before_the_end(work: fn()) {
    let _ = LAST_WORK.set(work);
}

/// Makes room for `more` values, of which a user may have asked for more than there is memory for.
///
/// # Errors
/// If there is none.
pub fn try_reserve<T>(values: &mut Vec<T>, more: usize) -> Result<(), TryReserveError> {
    IS_TOLD.set(true);
    let reserved = values.try_reserve_exact(more);
    IS_TOLD.set(false);
    reserved
}

/// What the system has given, which is nothing for those alone who are told.
fn or_end(memory: *mut u8, bytes: usize) -> *mut u8 {
    if memory.is_null() && !IS_TOLD.get() {
        end(bytes);
    }
    memory
}

#[cold]
fn end(bytes: usize) -> ! {
    // The last work may ask for memory in vain, too.
    if !IS_ENDING.replace(true) {
        let _ = writeln!(io::stderr(), "error: there is no memory for {bytes} bytes");
        if let Some(work) = LAST_WORK.get() {
            work();
        }
    }
    #[cfg(unix)]
    // SAFETY: ends the process at once: what others do at an end could take memory.
    unsafe {
        libc::_exit(1)
    }
    #[cfg(not(unix))]
    std::process::exit(1)
}

// SAFETY: the system's allocator is one, and all comes from there and goes back to it.
unsafe impl GlobalAlloc for Memory {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as the caller promises.
        or_end(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as the caller promises.
        or_end(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, bytes: usize) -> *mut u8 {
        // SAFETY: as the caller promises.
        or_end(unsafe { System.realloc(memory, layout, bytes) }, bytes)
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(memory, layout) }
    }
}
