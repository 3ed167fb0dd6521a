//! What is farthest in each part of a tile, and whether that hides an object.

use crate::kernels::{Element, Seen, TILE_HEIGHT, TILE_WIDTH, TileBuffers, TileWindow};

/// Sides of a part of a tile, in pixels: a square whose farthest pixel is known.
const PART_SIDE: usize = 8;
const PARTS_ACROSS: usize = TILE_WIDTH / PART_SIDE;
const PARTS_DOWN: usize = TILE_HEIGHT / PART_SIDE;

/// What is farthest in each part of a tile: 1/t, 0 where a pixel is nobody's.
pub(super) struct Farthest {
    /// Of the whole tile.
    all: f64,
    parts: [f64; PARTS_ACROSS * PARTS_DOWN],
}

impl Farthest {
    /// In what kernels of so many lanes have found.
    pub(super) fn of<E: Element>(buffers: &TileBuffers<E>, lanes: usize) -> Self {
        let least = |a: E, b: E| if b < a { b } else { a };
        let mut parts = [[E::from_f64(f64::INFINITY); PART_SIDE]; PARTS_ACROSS * PARTS_DOWN];
        // A part's pixels in a row of blocks follow one another.
        let block_height = (lanes / 4).max(1);
        for (i, row) in buffers.near().chunks_exact(TILE_WIDTH * block_height).enumerate() {
            let parts = &mut parts[i * block_height / PART_SIDE * PARTS_ACROSS..][..PARTS_ACROSS];
            for (part, near) in parts.iter_mut().zip(row.chunks_exact(PART_SIDE * block_height)) {
                for near in near.as_chunks::<PART_SIDE>().0 {
                    part.iter_mut().zip(near).for_each(|(part, near)| *part = least(*part, *near));
                }
            }
        }
        let parts = parts.map(|part| part.into_iter().fold(part[0], least).to_f64());
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
