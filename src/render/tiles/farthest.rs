//! What is farthest in each part of a tile, and whether that hides an object.

use crate::kernels::{self, Element, PART_SIDE, Seen, TILE_PARTS, TILE_WIDTH, TileBuffers, TileWindow};

const PARTS_ACROSS: usize = TILE_WIDTH / PART_SIDE;

/// What is farthest in each part of a tile: 1/t, 0 where a pixel is nobody's.
pub(super) struct Farthest<E>([E; TILE_PARTS]);

impl<E: Element> Farthest<E> {
    /// In what is found so far.
    pub(super) fn of(buffers: &TileBuffers<E>, kernel: &kernels::Farthest<E>) -> Self {
        Farthest(kernel.call(buffers))
    }

    /// Whether all pixels of a window of the tile where the object may be have something nearer than it can be. Without a
    /// branch that depends on where, but for one on whether it is large.
    #[inline(always)]
    pub(super) fn hides(&self, seen: &Seen, window: &TileWindow) -> bool {
        let parts = |bounds: u32, first: u32, start: u32, end: u32| {
            let (start, end) = ((bounds & 0xffff).max(first + start) - first, (bounds >> 16).min(first + end));
            (start as usize / PART_SIDE, (end.saturating_sub(first + 1)) as usize / PART_SIDE)
        };
        let (left, right) = parts(seen.columns, window.column, 0, window.columns);
        let (top, bottom) = parts(seen.rows, window.row, window.rows.start, window.rows.end);
        let most = E::from_f64(seen.most.into());
        let is_nearer = |row: usize, column: usize| self.0[(row * PARTS_ACROSS + column) % TILE_PARTS] > most;
        if right > left + 1 || bottom > top + 1 {
            return (top..=bottom).all(|row| (left..=right).all(|column| is_nearer(row, column)));
        }
        is_nearer(top, left) & is_nearer(top, right) & is_nearer(bottom, left) & is_nearer(bottom, right)
    }
}
