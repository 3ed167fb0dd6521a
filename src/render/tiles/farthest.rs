//! What is farthest in each part of a tile, and whether that hides an object.

use crate::kernels::{self, Element, PART_SIDE, Seen, TILE_PARTS, TILE_WIDTH, TileBuffers, TileWindow};

const PARTS_ACROSS: usize = TILE_WIDTH / PART_SIDE;

/// What is farthest in each part of a tile: 1/t, 0 where a pixel is nobody's.
pub(super) struct Farthest {
    /// Of the whole tile.
    all: f64,
    parts: [f64; TILE_PARTS],
}

impl Farthest {
    /// In what is found so far.
    pub(super) fn of<E: Element>(buffers: &TileBuffers<E>, kernel: &kernels::Farthest<E>) -> Self {
        let parts = kernel.call(buffers).map(E::to_f64);
        Farthest { all: parts.into_iter().fold(f64::INFINITY, f64::min), parts }
    }

    /// Whether all pixels of a window of the tile where the object may be have something nearer than it can be.
    #[inline]
    pub(super) fn hides(&self, seen: &Seen, window: &TileWindow) -> bool {
        if self.all > seen.most.into() {
            return true;
        }
        let parts = |bounds: u32, first: u32, start: u32, end: u32| {
            let (start, end) = ((bounds & 0xffff).max(first + start) - first, (bounds >> 16).min(first + end));
            (start as usize / PART_SIDE, (end.saturating_sub(first + 1)) as usize / PART_SIDE)
        };
        let (left, right) = parts(seen.columns, window.column, 0, window.columns);
        let (top, bottom) = parts(seen.rows, window.row, window.rows.start, window.rows.end);
        let at = |row: usize, column: usize| self.parts[(row * PARTS_ACROSS + column) % self.parts.len()];
        if right > left + 1 || bottom > top + 1 {
            return (top..=bottom).all(|row| (left..=right).all(|column| at(row, column) > seen.most.into()));
        }
        let farthest = f64::min(at(top, left).min(at(top, right)), at(bottom, left).min(at(bottom, right)));
        farthest > seen.most.into()
    }
}
