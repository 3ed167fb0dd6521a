//! Memory between guard pages: for an argument, or for all that a thread of a test allocates.
//!
//! A kernel that reads or writes beside its arguments faults at once.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::io;
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
/// Fenced blocks lie from here on, where nothing else does (AddressSanitizer's shadow ends before),
/// one after the other and never in the place of another.
const FIRST: usize = 0x2000_0000_0000;
static NEXT: AtomicUsize = AtomicUsize::new(FIRST);

/// The pages that a block has between its fences.
fn inside(layout: Layout) -> usize {
    layout.size().next_multiple_of(PAGE)
}

/// A new block of zeros next to a guard page, or null if the system has no memory for it.
fn map(layout: Layout, side: Side) -> *mut u8 {
    let (inside, flags) = (inside(layout), libc::MAP_PRIVATE | libc::MAP_ANONYMOUS);
    let start = ptr::without_provenance_mut(NEXT.fetch_add(inside + 2 * PAGE, Ordering::Relaxed));
    // SAFETY: a new mapping, which takes nothing from anybody: without MAP_FIXED the place is no
    // more than a wish.
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

/// Gives back a block of [`map`].
///
/// # Safety
/// `block` and `layout` are those of a block that nobody uses any more.
unsafe fn unmap(block: *mut u8, layout: Layout) {
    let within = block.addr() % PAGE + PAGE;
    // SAFETY: the mapping that map() made: one page before its first page is a fence.
    unsafe { libc::munmap(block.wrapping_sub(within).cast(), inside(layout) + 2 * PAGE) };
}

/// An argument between guard pages. Of the pages that it lies in, what is beside it has a pattern,
/// so that a write there shows even where no guard page is.
pub struct Fenced {
    block: *mut u8,
    /// Of no bytes: one byte.
    layout: Layout,
    len: usize,
}

impl Fenced {
    /// The byte beside an argument.
    const PATTERN: u8 = 0xa5;
    /// How far beside an argument is looked.
    const LOOK: usize = 1024;

    /// A copy of `bytes` next to a guard page on that side; of no bytes, the first address of a
    /// guard page.
    ///
    /// # Errors
    /// If the system has no memory for it.
    ///
    /// # Panics
    /// If `align` is no power of two.
    pub fn new(bytes: &[u8], align: usize, side: Side) -> io::Result<Self> {
        let layout = Layout::from_size_align(bytes.len().max(1), align).expect("an alignment, and a size below 2^63");
        let block = map(layout, side);
        if block.is_null() {
            return Err(io::Error::from(io::ErrorKind::OutOfMemory));
        }
        let fenced = Fenced { block, layout, len: bytes.len() };
        let (start, pages) = (fenced.pages(), inside(layout));
        // SAFETY: the pages of the block, which are mapped and nobody else's, and the argument
        // within them.
        unsafe {
            ptr::write_bytes(start, Self::PATTERN, pages);
            ptr::copy_nonoverlapping(bytes.as_ptr(), block, bytes.len());
        }
        if bytes.is_empty() {
            // SAFETY: its own pages, which become a guard page from the first byte on.
            unsafe { libc::mprotect(start.cast(), pages, libc::PROT_NONE) };
        }
        Ok(fenced)
    }

    /// How many bytes it has.
    pub fn len(&self) -> usize {
        self.len
    }

    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Where its pages begin.
    fn pages(&self) -> *mut u8 {
        self.block.wrapping_sub(self.block.addr() % PAGE)
    }

    /// The address of its first byte.
    pub fn address(&self) -> usize {
        self.block.expose_provenance()
    }

    /// Its first `count` bytes as they are now.
    ///
    /// # Panics
    /// If it has fewer.
    pub fn bytes(&self, count: usize) -> Vec<u8> {
        assert!(count <= self.layout.size());
        // SAFETY: they are within the block, and whatever is written there are bytes.
        (0..count).map(|index| unsafe { self.block.add(index).read_volatile() }).collect()
    }

    /// The place of the first byte beside it that was written, by its distance from its own first
    /// byte: of those that are less than [`Fenced::LOOK`] bytes away.
    pub fn spoiled(&self) -> Option<isize> {
        if self.is_empty() {
            return None;
        }
        let (start, size) = (self.block.addr() % PAGE, self.layout.size());
        let pages = self.pages();
        let before = start.saturating_sub(Self::LOOK)..start;
        let after = start + size..inside(self.layout).min(start + size + Self::LOOK);
        // SAFETY: all are within its pages.
        let is_spoiled = |index: &usize| unsafe { pages.add(*index).read_volatile() } != Self::PATTERN;
        before.chain(after).find(is_spoiled).map(|index| index as isize - start as isize)
    }
}

impl Drop for Fenced {
    fn drop(&mut self) {
        // SAFETY: its own block, which ends here.
        unsafe { unmap(self.block, self.layout) };
    }
}

thread_local! {
    static SIDE: Cell<Option<Side>> = const { Cell::new(None) };
}

/// An allocator that puts guard pages next to what a thread allocates, where it asks for that: for
/// tests.
pub struct Fences;

// SAFETY: a fenced block has a mapping of its own, aligned as a page is; it is known by its
// address, and all others are `System`'s. Nothing here allocates.
unsafe impl GlobalAlloc for Fences {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        match SIDE.get() {
            // SAFETY: as for the impl.
            None => unsafe { System.alloc(layout) },
            Some(side) => map(layout, side),
        }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        if block.addr() < FIRST || block.addr() >= NEXT.load(Ordering::Relaxed) {
            // SAFETY: as for the impl.
            return unsafe { System.dealloc(block, layout) };
        }
        // SAFETY: a block of map(), by its address.
        unsafe { unmap(block, layout) };
    }
}

/// Does something, with all that this thread allocates by [`Fences`] next to a guard page on that
/// side.
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
