//! The program's memory. If there is none left, the program ends with a message that gives the size
//! requested, and not by an abort.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::collections::TryReserveError;
use std::io::{self, Write};
#[cfg(not(target_os = "linux"))]
use std::sync::OnceLock;

/// The program's global allocator, which is the system's. [`try_reserve`] returns an error; any
/// other failed allocation ends the process with a message.
pub struct Allocator;

#[cfg(not(target_os = "linux"))]
static LAST_WORK: OnceLock<fn()> = OnceLock::new();

thread_local! {
    /// Whether this thread handles failed allocations itself; and whether it is ending the process.
    static IS_TOLD: Cell<bool> = const { Cell::new(false) };
    static IS_ENDING: Cell<bool> = const { Cell::new(false) };
}

/// Registers `work` to be done before the process ends for lack of memory. Only the first
/// registration counts. `work` has little memory itself.
#[cfg(not(target_os = "linux"))]
pub fn before_the_end(work: fn()) {
    let _ = LAST_WORK.set(work);
}

/// Reserves memory for `more` values, which may be more than the system has.
///
/// # Errors
/// If there is not enough memory.
pub fn try_reserve<T>(values: &mut Vec<T>, more: usize) -> Result<(), TryReserveError> {
    IS_TOLD.set(true);
    let reserved = values.try_reserve_exact(more);
    IS_TOLD.set(false);
    reserved
}

/// Puts the program's heap on large pages, as far as the system has them, and keeps freed memory.
/// The first write to a small page takes a microsecond or two, which was half of the set-up of a
/// mesh of 69,000 triangles. This is only a hint, and the result says whether it was followed. It
/// is not followed if other threads run: two that move the end of the heap at the same time could
/// release each other's memory.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn use_large_pages() -> bool {
    if std::fs::read_dir("/proc/self/task").map_or(0, Iterator::count) != 1 {
        return false;
    }
    use libc::{M_ARENA_MAX, M_MMAP_THRESHOLD, M_TOP_PAD, M_TRIM_THRESHOLD};
    let options = [(M_MMAP_THRESHOLD, 4 << 20), (M_TRIM_THRESHOLD, 64 << 20), (M_TOP_PAD, 16 << 20), (M_ARENA_MAX, 1)];
    // The bytes that malloc writes when the heap grows must lie before the first large page;
    // otherwise that page would be made up of small ones.
    let before = 256 << 10;
    // SAFETY: the options choose where memory comes from, a gap in the heap is only wasted, and the
    // size of pages changes no content. Nobody else moves the heap's end, since this thread is
    // alone.
    unsafe {
        options.into_iter().for_each(|(option, value)| _ = libc::mallopt(option, value));
        let end = libc::sbrk(0).addr();
        let first = (end + before).next_multiple_of(2 << 20);
        libc::sbrk((first - before - end) as isize);
        std::hint::black_box(libc::malloc(before - (8 << 10)));
        let bytes = libc::sbrk(0).addr().saturating_sub(first);
        libc::madvise(std::ptr::without_provenance_mut(first), bytes, libc::MADV_HUGEPAGE);
    }
    true
}

/// Returns allocated memory. Ends the process if it is null and the thread does not handle that.
fn or_end(memory: *mut u8, bytes: usize) -> *mut u8 {
    if memory.is_null() && !IS_TOLD.get() {
        end(bytes);
    }
    memory
}

#[cold]
fn end(bytes: usize) -> ! {
    // The last work may itself fail to allocate.
    if !IS_ENDING.replace(true) {
        let _ = writeln!(io::stderr(), "error: there is no memory for {bytes} bytes");
        #[cfg(not(target_os = "linux"))]
        if let Some(work) = LAST_WORK.get() {
            work();
        }
    }
    #[cfg(unix)]
    // SAFETY: ends the process at once, since exit handlers could need memory.
    unsafe {
        libc::_exit(1)
    }
    #[cfg(not(unix))]
    std::process::exit(1)
}

// SAFETY: all memory comes from the system's allocator and goes back to it.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps the contract of GlobalAlloc.
        or_end(unsafe { System.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller keeps the contract of GlobalAlloc.
        or_end(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, memory: *mut u8, layout: Layout, bytes: usize) -> *mut u8 {
        // SAFETY: the caller keeps the contract of GlobalAlloc.
        or_end(unsafe { System.realloc(memory, layout, bytes) }, bytes)
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        // SAFETY: the caller keeps the contract of GlobalAlloc.
        unsafe { System.dealloc(memory, layout) }
    }
}
