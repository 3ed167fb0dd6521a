//! Which tiles each object may be in.

use std::ops::Range;

use super::bounds::Picture;
use super::{TilePlace, range};
use crate::kernels::{Seen, TILE_HEIGHT, TILE_WIDTH, sys};

/// The objects that each tile may see.
pub(super) struct Bins {
    /// Where each tile's begin, and where the last one's end.
    starts: Vec<u32>,
    pub(super) seen: Vec<Seen>,
    /// Those that are in many tiles.
    pub(super) large: Vec<Seen>,
    /// Whether the large are in all tiles, wherever they may be seen.
    everywhere: bool,
}

impl Bins {
    /// An object in more than `most_tiles` is large; if None, all of them are, and in all tiles.
    pub(super) fn new(seen: &[Seen], picture: Picture, most_tiles: Option<usize>) -> Self {
        let across = picture.width.div_ceil(TILE_WIDTH as u32);
        let tiles = (across * picture.height.div_ceil(TILE_HEIGHT as u32)) as usize;
        let Some(most_tiles) = most_tiles else {
            return Bins { starts: vec![0; tiles + 1], seen: Vec::new(), large: seen.to_vec(), everywhere: true };
        };
        // How many objects each tile has, and then where its next one goes.
        let mut counts = vec![0_u32; tiles];
        let mut large = Vec::new();
        each_place(seen, most_tiles, |run, tiles| {
            let Some((x, y)) = tiles else { return };
            y.for_each(|row| {
                x.clone().for_each(|column| counts[(row * across + column) as usize] += run.len() as u32);
            });
        });
        let mut starts = Vec::with_capacity(tiles + 1);
        let mut sum = 0;
        for count in &mut counts {
            starts.push(sum);
            sum += std::mem::replace(count, sum);
        }
        starts.push(sum);
        let mut placed = roomy(sum as usize);
        each_place(seen, most_tiles, |run, tiles| {
            let Some((x, y)) = tiles else { return large.extend_from_slice(run) };
            y.for_each(|row| {
                x.clone().for_each(|column| {
                    let next = &mut counts[(row * across + column) as usize];
                    placed[*next as usize..][..run.len()].copy_from_slice(run);
                    *next += run.len() as u32;
                });
            });
        });
        Bins { starts, seen: placed, large, everywhere: false }
    }

    /// Whether what is in a tile is in its own list.
    pub(super) fn is_one_list(&self) -> bool {
        self.large.is_empty()
    }

    /// What a tile may see of what is in few tiles.
    pub(super) fn of_tile(&self, tile: TilePlace, width: u32) -> &[Seen] {
        let across = width.div_ceil(TILE_WIDTH as u32);
        let index = (tile.down * across + tile.across) as usize;
        &self.seen[self.starts[index] as usize..self.starts[index + 1] as usize]
    }

    /// Those that are in many tiles and may be in this one.
    pub(super) fn large_in(&self, tile: TilePlace) -> impl Iterator<Item = Seen> {
        let (column, row) = tile.first();
        let in_tile = move |large: &&Seen| {
            if self.everywhere {
                return true;
            }
            let (x, y) = (range(large.columns), range(large.rows));
            x.start < column + TILE_WIDTH as u32 && column < x.end && y.start < row + TILE_HEIGHT as u32 && row < y.end
        };
        self.large.iter().filter(in_tile).copied()
    }
}

/// The tiles, row by row, that some of these may be in.
pub(super) fn tiles_of(seen: &[Seen], picture: Picture) -> Vec<bool> {
    let across = picture.width.div_ceil(TILE_WIDTH as u32);
    let mut tiles = vec![false; (across * picture.height.div_ceil(TILE_HEIGHT as u32)) as usize];
    each_place(seen, usize::MAX, |_, ranges| {
        let Some((x, y)) = ranges else { return };
        y.for_each(|row| tiles[(row * across + x.start) as usize..][..x.len()].fill(true));
    });
    tiles
}

/// From pixels to tiles; not empty.
pub(super) fn tile_range(pixels: Range<u32>, side: usize) -> Range<u32> {
    pixels.start / side as u32..(pixels.end - 1) / side as u32 + 1
}

/// Columns and rows of tiles.
type TileRanges = (Range<u32>, Range<u32>);

/// Says of all objects that may be seen in which tiles: as many that follow one another and are in one and the same tile
/// at a time, the others one by one, and None for those that are in too many. Neighbours in a mesh are mostly in one tile.
fn each_place(seen: &[Seen], most_tiles: usize, mut say: impl FnMut(&[Seen], Option<TileRanges>)) {
    let places = |seen: &Seen| {
        let (x, y) = (range(seen.columns), range(seen.rows));
        (tile_range(x, TILE_WIDTH), tile_range(y, TILE_HEIGHT))
    };
    let is_empty = |seen: &Seen| range(seen.columns).is_empty() || range(seen.rows).is_empty();
    let mut rest = seen;
    while let Some(first) = rest.first() {
        if is_empty(first) {
            rest = &rest[1..];
            continue;
        }
        let (x, y) = places(first);
        let tiles = x.len() * y.len();
        let mut run = 1;
        if tiles == 1 {
            // Of those that are in this tile alone.
            let (left, top) = (x.start * TILE_WIDTH as u32, y.start * TILE_HEIGHT as u32);
            let within = |bounds: u32, first: u32, side: usize| {
                first <= (bounds & 0xffff)
                    && (bounds & 0xffff) < (bounds >> 16)
                    && (bounds >> 16) <= first + side as u32
            };
            let alike = |seen: &&Seen| within(seen.columns, left, TILE_WIDTH) & within(seen.rows, top, TILE_HEIGHT);
            run += rest[1..].iter().take_while(alike).count();
        }
        let (of_run, others) = rest.split_at(run);
        say(of_run, (tiles <= most_tiles).then_some((x, y)));
        rest = others;
    }
}

/// Zeros, on large pages where they are many: a page that is touched for the first time costs as much as a thousand
/// triangles' numbers on it.
pub(super) fn roomy(len: usize) -> Vec<Seen> {
    let mut zeros = sys::zeros(len);
    sys::large_pages(&mut zeros);
    zeros
}
