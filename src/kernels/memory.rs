//! The program's memory: if there is none left, it ends with a message that gives the size
//! requested, not by an abort.

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
    /// Whether this thread handles failures; and whether it is ending the process.
    static IS_TOLD: Cell<bool> = const { Cell::new(false) };
    static IS_ENDING: Cell<bool> = const { Cell::new(false) };
}

/// Registers `work` to be done before a process ends for want of memory; only the first counts. It
/// has little memory itself.
#[cfg(not(target_os = "linux"))]
pub fn before_the_end(work: fn()) {
    let _ = LAST_WORK.set(work);
}

/// Reserves memory for `more` values, which may be more than there is memory for.
///
/// # Errors
/// If there is none.
pub fn try_reserve<T>(values: &mut Vec<T>, more: usize) -> Result<(), TryReserveError> {
    IS_TOLD.set(true);
    let reserved = values.try_reserve_exact(more);
    IS_TOLD.set(false);
    reserved
}

/// Puts the program's heap on large pages, as far as the system has them, and keeps what is freed.
/// The first touch of a small page takes a microsecond or two, which for a mesh of 69,000 triangles
/// was half of set-up. Only a hint, and returns whether it was followed: not where other threads
/// run, since two that move the heap's end at once could give one's memory back.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn use_large_pages() -> bool {
    if std::fs::read_dir("/proc/self/task").map_or(0, Iterator::count) != 1 {
        return false;
    }
    use libc::{M_ARENA_MAX, M_MMAP_THRESHOLD, M_TOP_PAD, M_TRIM_THRESHOLD};
    let options = [(M_MMAP_THRESHOLD, 4 << 20), (M_TRIM_THRESHOLD, 64 << 20), (M_TOP_PAD, 16 << 20), (M_ARENA_MAX, 1)];
    // What malloc writes when the heap grows is to be before the first large page, or that would be
    // made of small ones.
    let before = 256 << 10;
    // SAFETY: the options choose where memory comes from, a gap in the heap is room lost, and the
    // size of pages changes no content. Nobody else moves the end, since this thread is alone.
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

/// The allocated memory; ends the process if there is none and the thread does not handle that.
fn or_end(memory: *mut u8, bytes: usize) -> *mut u8 {
    if memory.is_null() && !IS_TOLD.get() {
        end(bytes);
    }
    memory
}

#[cold]
fn end(bytes: usize) -> ! {
    // The last work may fail to allocate, too.
    if !IS_ENDING.replace(true) {
        let _ = writeln!(io::stderr(), "error: there is no memory for {bytes} bytes");
        #[cfg(not(target_os = "linux"))]
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
unsafe impl GlobalAlloc for Allocator {
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
