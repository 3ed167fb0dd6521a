//! An allocator that puts guard pages next to what a thread allocates, where it asks for that.
//!
//! Kernels that read or write beside their arguments fault at once.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ptr;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The place of a guard page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Right before the first byte.
    Before,
    /// Right after the last, but for what the alignment asks.
    After,
}

impl Side {
    pub const ALL: [Side; 2] = [Side::Before, Side::After];
}

/// A multiple of every system's pages.
const PAGE: usize = 1 << 16;
/// Fenced blocks lie from here on, where nothing else does (AddressSanitizer's shadow ends before), one after the other
/// and never in the place of another.
const FIRST: usize = 0x2000_0000_0000;
static NEXT: AtomicUsize = AtomicUsize::new(FIRST);

thread_local! {
    static SIDE: Cell<Option<Side>> = const { Cell::new(None) };
}

struct Fences;

/// The pages that a block has between its fences.
fn inside(layout: Layout) -> usize {
    layout.size().next_multiple_of(PAGE)
}

// SAFETY: a fenced block has a mapping of its own, aligned as a page is; it is known by its address, and all others are
// `System`'s. Nothing here allocates.
unsafe impl GlobalAlloc for Fences {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let Some(side) = SIDE.get() else {
            // SAFETY: as for the impl.
            return unsafe { System.alloc(layout) };
        };
        let (inside, flags) = (inside(layout), libc::MAP_PRIVATE | libc::MAP_ANONYMOUS);
        let start = ptr::without_provenance_mut(NEXT.fetch_add(inside + 2 * PAGE, Ordering::Relaxed));
        // SAFETY: a new mapping, which takes nothing from anybody: without MAP_FIXED the place is no more than a wish.
        let mapping = unsafe { libc::mmap(start, inside + 2 * PAGE, libc::PROT_NONE, flags, -1, 0) };
        if mapping != start {
            return ptr::null_mut();
        }
        let first = mapping.cast::<u8>().wrapping_add(PAGE);
        // SAFETY: the pages between the two fences.
        if unsafe { libc::mprotect(first.cast(), inside, libc::PROT_READ | libc::PROT_WRITE) } != 0 {
            return ptr::null_mut();
        }
        let skipped = if side == Side::Before { 0 } else { (inside - layout.size()) & !(layout.align() - 1) };
        first.wrapping_add(skipped)
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        if block.addr() < FIRST || block.addr() >= NEXT.load(Ordering::Relaxed) {
            // SAFETY: as for the impl.
            return unsafe { System.dealloc(block, layout) };
        }
        let within = block.addr() % PAGE + PAGE;
        // SAFETY: the mapping that alloc() made: one before its first page is a fence.
        unsafe { libc::munmap(block.wrapping_sub(within).cast(), inside(layout) + 2 * PAGE) };
    }
}

#[global_allocator]
static ALLOCATOR: Fences = Fences;

/// Does something, with all that this thread allocates next to a guard page on that side.
pub fn within<R>(side: Side, work: impl FnOnce() -> R) -> R {
    /// Restores the setting, after a panic too.
    struct Restore(Option<Side>);
    impl Drop for Restore {
        fn drop(&mut self) {
            SIDE.set(self.0);
        }
    }
    let _restore = Restore(SIDE.replace(Some(side)));
    work()
}

/// A copy of values next to a guard page.
pub fn copy<T: Clone>(values: &[T], side: Side) -> Vec<T> {
    within(side, || values.to_vec())
}
