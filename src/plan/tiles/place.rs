//! Where objects are: bounds in pixels, and the tiles that they meet.

use std::ops::Range;

use crate::kernels::{TILE_HEIGHT, TILE_WIDTH};

/// The size of the picture.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Picture {
    pub(super) width: u32,
    pub(super) height: u32,
}

impl Picture {
    /// The number of tiles across and down.
    pub(super) fn tiles(self) -> [u32; 2] {
        [self.width.div_ceil(TILE_WIDTH as u32), self.height.div_ceil(TILE_HEIGHT as u32)]
    }

    /// The bounds of an object that may be at any pixel.
    pub(super) fn whole(self) -> [u32; 2] {
        [self.width << 16, self.height << 16]
    }
}

#[derive(Clone, Copy, Debug)]
pub struct TilePlace {
    /// The index of the tile from the left.
    pub across: u32,
    /// The index of the tile from the top.
    pub down: u32,
}

impl TilePlace {
    /// The column and the row of the tile's first pixel.
    pub fn first(self) -> (u32, u32) {
        (self.across * TILE_WIDTH as u32, self.down * TILE_HEIGHT as u32)
    }
}

/// The tiles that a range of pixels meets; the range is not empty.
pub(super) fn tile_range(pixels: Range<u32>, side: usize) -> Range<u32> {
    pixels.start / side as u32..(pixels.end - 1) / side as u32 + 1
}

/// The number of pixels within bounds.
pub fn covered(columns: u32, rows: u32) -> u64 {
    range(columns).len() as u64 * range(rows).len() as u64
}

/// The range of pixels that bounds encode in 32 bits: the first pixel in the lower half, and one
/// past the last in the upper half.
pub(super) fn range(bounds: u32) -> Range<u32> {
    (bounds & 0xffff)..(bounds >> 16)
}
