//! Memory between guard pages: for an argument, or for everything that a thread of a test
//! allocates.
//!
//! A kernel that reads or writes beyond its arguments faults at once.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::io;
use std::ptr;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Which end of the memory a guard page is at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Directly before the first byte.
    Before,
    /// Directly after the last byte, up to the alignment of the memory.
    After,
}

impl Side {
    pub const ALL: [Side; 2] = [Side::Before, Side::After];
}

/// A multiple of the page size of every system.
const PAGE: usize = 1 << 16;
/// The address from which fenced blocks are placed. Nothing else is there (AddressSanitizer's
/// shadow ends below it). Blocks are placed one after the other, and no address is used twice.
const FIRST: usize = 0x2000_0000_0000;
static NEXT: AtomicUsize = AtomicUsize::new(FIRST);

/// The number of bytes, in whole pages, that a block has between its guard pages.
fn inside(layout: Layout) -> usize {
    layout.size().next_multiple_of(PAGE)
}

/// Maps a new block of zeros next to a guard page; null if the system has no memory for it, or if
/// the alignment is more than a page.
fn map(layout: Layout, side: Side) -> *mut u8 {
    if layout.align() > PAGE {
        return ptr::null_mut();
    }
    let (inside, flags) = (inside(layout), libc::MAP_PRIVATE | libc::MAP_ANONYMOUS);
    let start = ptr::without_provenance_mut(NEXT.fetch_add(inside + 2 * PAGE, Ordering::Relaxed));
    // SAFETY: a new mapping, which replaces no other: without MAP_FIXED the address is only a hint.
    let mapping = unsafe { libc::mmap(start, inside + 2 * PAGE, libc::PROT_NONE, flags, -1, 0) };
    if mapping != start {
        return ptr::null_mut();
    }
    let first = mapping.cast::<u8>().wrapping_add(PAGE);
    // SAFETY: these are the pages between the two guard pages.
    if unsafe { libc::mprotect(first.cast(), inside, libc::PROT_READ | libc::PROT_WRITE) } != 0 {
        return ptr::null_mut();
    }
    let skipped = if side == Side::Before { 0 } else { (inside - layout.size()) & !(layout.align() - 1) };
    first.wrapping_add(skipped)
}

/// Unmaps a block that [`map`] returned.
///
/// # Safety
/// `block` and `layout` belong to a block that nobody uses any more.
unsafe fn unmap(block: *mut u8, layout: Layout) {
    let within = block.addr() % PAGE + PAGE;
    // SAFETY: the mapping that map() made, which begins with a guard page before the block's first
    // page.
    unsafe { libc::munmap(block.wrapping_sub(within).cast(), inside(layout) + 2 * PAGE) };
}

/// An argument between guard pages. The other bytes of its pages hold a pattern, so that a write
/// beside it is noticed even where it does not reach a guard page.
pub struct Fenced {
    block: *mut u8,
    /// The layout of the block; an argument without bytes has a block of one byte.
    layout: Layout,
    len: usize,
}

impl Fenced {
    /// The value of the bytes beside an argument.
    const PATTERN: u8 = 0xa5;
    /// How many bytes on either side of an argument are inspected.
    const LOOK: usize = 1024;

    /// A copy of `bytes` next to a guard page on that side. Without bytes, the address is the first
    /// of a guard page.
    ///
    /// # Errors
    /// If the system has no memory for the block, or `align` is more than a page.
    ///
    /// # Panics
    /// If `align` is not a power of two.
    pub fn new(bytes: &[u8], align: usize, side: Side) -> io::Result<Self> {
        let layout = Layout::from_size_align(bytes.len().max(1), align).expect("an alignment, and a size below 2^63");
        let block = map(layout, side);
        if block.is_null() {
            return Err(io::Error::from(io::ErrorKind::OutOfMemory));
        }
        let fenced = Fenced { block, layout, len: bytes.len() };
        let (start, pages) = (fenced.pages(), inside(layout));
        // SAFETY: the pages of the block are mapped and belong to nobody else; the argument is
        // within them.
        unsafe {
            ptr::write_bytes(start, Self::PATTERN, pages);
            ptr::copy_nonoverlapping(bytes.as_ptr(), block, bytes.len());
        }
        if bytes.is_empty() {
            // SAFETY: these are the block's own pages, which become guard pages from the first byte
            // on.
            unsafe { libc::mprotect(start.cast(), pages, libc::PROT_NONE) };
        }
        Ok(fenced)
    }

    /// The number of bytes of the argument.
    pub fn len(&self) -> usize {
        self.len
    }

    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// The address of the first page of the block.
    fn pages(&self) -> *mut u8 {
        self.block.wrapping_sub(self.block.addr() % PAGE)
    }

    /// The address of the argument's first byte.
    pub fn address(&self) -> usize {
        self.block.expose_provenance()
    }

    /// The argument's first `count` bytes, as they are now.
    ///
    /// # Panics
    /// If the argument has fewer bytes.
    pub fn bytes(&self, count: usize) -> Vec<u8> {
        assert!(count <= self.len, "an argument of {} bytes has no {count}", self.len);
        // SAFETY: the bytes are within the block, which can be read if it has any, and any value is
        // valid for them.
        (0..count).map(|index| unsafe { self.block.add(index).read_volatile() }).collect()
    }

    /// Finds a byte beside the argument that was written, less than `Fenced::LOOK` bytes away.
    /// Returns its offset from the argument's first byte.
    pub fn spoiled(&self) -> Option<isize> {
        if self.is_empty() {
            return None;
        }
        let (start, size) = (self.block.addr() % PAGE, self.layout.size());
        let pages = self.pages();
        let before = start.saturating_sub(Self::LOOK)..start;
        let after = start + size..inside(self.layout).min(start + size + Self::LOOK);
        // SAFETY: all these bytes are within the block's pages.
        let is_spoiled = |index: &usize| unsafe { pages.add(*index).read_volatile() } != Self::PATTERN;
        before.chain(after).find(is_spoiled).map(|index| index as isize - start as isize)
    }
}

impl Drop for Fenced {
    fn drop(&mut self) {
        // SAFETY: the block belongs to this value, whose life ends here.
        unsafe { unmap(self.block, self.layout) };
    }
}

thread_local! {
    static SIDE: Cell<Option<Side>> = const { Cell::new(None) };
}

/// An allocator for tests. It puts guard pages next to what a thread allocates within [`within`].
pub struct Fences;

// SAFETY: a fenced block has a mapping of its own, aligned to a page, and is recognised by its
// address. All other blocks are `System`'s. Nothing here allocates.
unsafe impl GlobalAlloc for Fences {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        match SIDE.get() {
            // SAFETY: as for the impl: the caller keeps the contract of `alloc`.
            None => unsafe { System.alloc(layout) },
            Some(side) => map(layout, side),
        }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        if block.addr() < FIRST || block.addr() >= NEXT.load(Ordering::Relaxed) {
            // SAFETY: as for the impl: the caller keeps the contract of `dealloc`.
            return unsafe { System.dealloc(block, layout) };
        }
        // SAFETY: by its address, it is a block of map().
        unsafe { unmap(block, layout) };
    }
}

/// Runs `work`. Everything that this thread allocates in it by [`Fences`] is next to a guard page
/// on that side.
pub fn within<R>(side: Side, work: impl FnOnce() -> R) -> R {
    /// Restores the previous setting, also after a panic.
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
