//! Bins: the lists of the objects that each tile may see.

use std::cmp::Reverse;
use std::ops::Range;

use super::place::{Picture, TilePlace, range, tile_range};
use crate::kernels::{Candidate, TILE_HEIGHT, TILE_WIDTH, sys};

/// Up to this many spheres are sorted by distance: the nearer ones of a tile then come first, and most blocks of pixels
/// reject the others before their roots. Sorting more costs more than it gains.
pub(super) const MOST_SORTED: usize = 1 << 11;

/// A block that is made ahead has room for at most this many objects, 16 MiB.
const MOST_IN_BLOCK: usize = 1 << 20;

/// The objects that may be visible in each tile, for one piece of the scene after another.
#[derive(Default)]
pub(super) struct Bins {
    picture: Picture,
    /// An object in more tiles is large; if None, all objects are, and in all tiles.
    most_tiles: Option<usize>,
    pieces: Vec<Piece>,
    /// The content of their lists. Each block may have room for more.
    blocks: Vec<Vec<Candidate>>,
    /// The objects in many tiles.
    large: Vec<Large>,
    /// Memory for the runs of a piece.
    runs: Vec<Run>,
}

/// An object in many tiles.
#[derive(Clone, Copy)]
struct Large {
    candidate: Candidate,
    /// The upper bound of its 1/t at a pixel: a constant, and the coefficients of the column and the row.
    most: [f32; 3],
}

/// The objects in many tiles that meet a row of tiles, the nearest first, as far as a tile has asked: its neighbours need
/// not go through all of the picture's.
#[derive(Default)]
pub struct LargeInRow {
    down: u32,
    /// How many of the picture's have been looked at.
    seen: usize,
    objects: Vec<Large>,
}

/// Consecutive objects of a piece that are in the same tiles, as neighbours in a mesh mostly are, and the first of
/// these tiles.
#[derive(Clone, Copy, Default)]
struct Run {
    start: u32,
    end: u32,
    tile: u32,
}

impl Run {
    fn len(self) -> u32 {
        self.end - self.start
    }

    fn of(self, candidates: &[Candidate]) -> &[Candidate] {
        &candidates[self.start as usize..self.end as usize]
    }
}

/// The place of the objects of a piece of the scene.
struct Piece {
    /// Its index in the scene.
    number: usize,
    block: usize,
    /// In the block: the beginning of each tile's objects, and the end of the last one's.
    starts: Vec<u32>,
}

impl Bins {
    /// Empty bins.
    pub(super) fn new(picture: Picture, most_tiles: Option<usize>) -> Self {
        Bins { picture, most_tiles, ..Bins::default() }
    }

    /// The number of pieces added.
    pub(super) fn pieces(&self) -> usize {
        self.pieces.len()
    }

    pub(super) fn tiles(&self) -> usize {
        let Picture { width, height } = self.picture;
        (width.div_ceil(TILE_WIDTH as u32) * height.div_ceil(TILE_HEIGHT as u32)) as usize
    }

    /// Adds the candidates of piece `number` of the scene, after which about `pieces_left` like it will come. A few
    /// stay in their order, as sorted spheres must; of many the lists begin with those that are in no other tile.
    pub(super) fn add(&mut self, number: usize, candidates: &[Candidate], pieces_left: f64) {
        let most_tiles = self.most_tiles.unwrap_or(0);
        let across = self.picture.width.div_ceil(TILE_WIDTH as u32);
        // The number of objects in each tile, later their beginnings.
        let mut starts = vec![0_u32; self.tiles() + 1];
        let in_order = candidates.len() <= MOST_SORTED || self.most_tiles.is_none();
        let (in_one, in_more) = runs_of(candidates, across, in_order, &mut self.runs);
        for run in in_one {
            starts[run.tile as usize] += run.len();
        }
        let mut corners = Corners::new(across, starts.len() - 1);
        for run in in_more.clone() {
            let tiles = TileRanges::of(&candidates[run.start as usize]);
            if tiles.count() > most_tiles {
                self.large.extend(
                    run.of(candidates)
                        .iter()
                        .map(|candidate| Large { candidate: *candidate, most: [candidate.most, 0.0, 0.0] }),
                );
            } else {
                corners.add(&tiles, run.len());
            }
        }
        corners.add_sums_to(&mut starts);
        let count: usize = starts.iter().map(|count| *count as usize).sum();
        if self.blocks.last().is_none_or(|last| last.capacity() - last.len() < count) {
            // The next pieces may have slightly more.
            let likely = count + count / 64;
            let more = (MOST_IN_BLOCK / likely.max(1)).saturating_sub(1);
            let room_for_more = likely as f64 * pieces_left.min(more as f64);
            self.blocks.push(sys::room(count + room_for_more as usize));
        }
        let (block, lists) = (self.blocks.len() - 1, self.blocks.last_mut().expect("one was just pushed"));
        let mut sum = lists.len() as u32;
        for start in &mut starts {
            sum += std::mem::replace(start, sum);
        }
        // Brings the memory into the core's own caches, where the lists can then be written in any order.
        lists.resize(lists.len() + count, Candidate::default());
        let mut next = starts.clone();
        for run in in_one {
            append(lists, &mut next[run.tile as usize], run.of(candidates));
        }
        for run in in_more {
            let tiles = TileRanges::of(&candidates[run.start as usize]);
            if tiles.count() <= most_tiles {
                tiles.each(across, |tile| append(lists, &mut next[tile], run.of(candidates)));
            }
        }
        self.pieces.push(Piece { number, block, starts });
    }

    /// These bins with the pieces of others, all in the scene's order.
    pub(super) fn and(mut self, other: Self) -> Self {
        let blocks = self.blocks.len();
        self.pieces.extend(other.pieces.into_iter().map(|piece| Piece { block: blocks + piece.block, ..piece }));
        self.pieces.sort_unstable_by_key(|piece| piece.number);
        self.blocks.extend(other.blocks);
        self.large.extend(other.large);
        self
    }

    /// Sorts the objects in many tiles by distance; `most` gives each one's upper bound of 1/t by its index, as in
    /// [`Large`].
    pub(super) fn sort(&mut self, most: impl Fn(u32) -> Option<[f32; 3]>) {
        for large in &mut self.large {
            large.most = most(large.candidate.id).unwrap_or(large.most);
        }
        // Not negative, and so ordered by their bits.
        self.large.sort_unstable_by_key(|large| (Reverse(large.candidate.most.to_bits()), large.candidate.id));
    }

    /// All list entries, once for each list.
    pub(super) fn listed(&self) -> impl Iterator<Item = &Candidate> {
        let lists = self.pieces.iter().flat_map(|piece| piece.of(0..piece.starts.len() - 1, &self.blocks));
        lists.chain(self.large.iter().map(|large| &large.candidate))
    }

    /// The objects in few tiles that may be visible in this one.
    pub(super) fn of_tile(&self, tile: TilePlace) -> impl Iterator<Item = &[Candidate]> {
        let index = (tile.down * self.picture.width.div_ceil(TILE_WIDTH as u32) + tile.across) as usize;
        self.pieces.iter().map(move |piece| piece.of(index..index + 1, &self.blocks))
    }

    /// Adds objects in many tiles that may be visible in this one, the nearest first: up to `count` of them, from place
    /// `next` in the row of tiles on, which is advanced. It stops at objects that cannot be at `least` or nearer.
    /// Returns whether more may come.
    pub(super) fn add_large(
        &self,
        tile: TilePlace,
        in_row: &mut LargeInRow,
        next: &mut usize,
        (count, least): (usize, f32),
        room: &mut Vec<Candidate>,
    ) -> bool {
        let (column, row) = tile.first();
        let everywhere = self.most_tiles.is_none();
        let [half_width, half_height] = [TILE_WIDTH, TILE_HEIGHT].map(|side| 0.5 * (side - 1) as f32);
        let (x, y) = (column as f32 + half_width, row as f32 + half_height);
        let enough = room.len() + count;
        while let Some(Large { mut candidate, most: [most, across, down] }) = self.next_in_row(tile, in_row, *next) {
            if candidate.most < least {
                return false;
            }
            if room.len() == enough {
                return true;
            }
            *next += 1;
            let columns = range(candidate.columns);
            let is_in = columns.start < column + TILE_WIDTH as u32 && column < columns.end;
            let here = most + across * x + down * y + across.abs() * half_width + down.abs() * half_height;
            // Where a tile reaches beyond the picture, a sum may be beyond f32: it is no bound then.
            if here.is_finite() && here < candidate.most {
                candidate.most = if here > 0.0 { here } else { 0.0 };
            }
            if everywhere || is_in && candidate.most >= least {
                room.push(candidate);
            }
        }
        false
    }

    /// The object in many tiles at place `next` of a tile's row.
    fn next_in_row(&self, tile: TilePlace, in_row: &mut LargeInRow, next: usize) -> Option<Large> {
        if in_row.down != tile.down {
            in_row.objects.clear();
            (in_row.down, in_row.seen) = (tile.down, 0);
        }
        let (_, row) = tile.first();
        while in_row.objects.len() == next {
            let large = self.large.get(in_row.seen)?;
            in_row.seen += 1;
            let rows = range(large.candidate.rows);
            if self.most_tiles.is_none() || rows.start < row + TILE_HEIGHT as u32 && row < rows.end {
                in_row.objects.push(*large);
            }
        }
        Some(in_row.objects[next])
    }

    /// The nearest of the objects in many tiles.
    pub(super) fn first_large(&self) -> Option<u32> {
        self.large.first().map(|large| large.candidate.id)
    }

    /// The number of objects in many tiles, and of entries in the lists of the others.
    pub(super) fn counts(&self) -> [usize; 2] {
        [self.large.len(), self.blocks.iter().map(Vec::len).sum()]
    }
}

impl Piece {
    /// The lists of some tiles.
    fn of<'a>(&self, tiles: Range<usize>, blocks: &'a [Vec<Candidate>]) -> &'a [Candidate] {
        &blocks[self.block][self.starts[tiles.start] as usize..self.starts[tiles.end] as usize]
    }
}

/// For each tile, row by row, whether any of these may be in it.
pub(super) fn tiles_of(candidates: &[Candidate], picture: Picture) -> Vec<bool> {
    let across = picture.width.div_ceil(TILE_WIDTH as u32);
    let mut tiles = vec![false; (across * picture.height.div_ceil(TILE_HEIGHT as u32)) as usize];
    candidates.iter().for_each(|candidate| TileRanges::of(candidate).each(across, |tile| tiles[tile] = true));
    tiles
}

/// Columns and rows of tiles.
struct TileRanges {
    columns: Range<u32>,
    rows: Range<u32>,
}

impl TileRanges {
    /// The tiles of an object whose bounds are not empty.
    fn of(candidate: &Candidate) -> Self {
        let columns = tile_range(range(candidate.columns), TILE_WIDTH);
        TileRanges { columns, rows: tile_range(range(candidate.rows), TILE_HEIGHT) }
    }

    fn count(&self) -> usize {
        self.columns.len() * self.rows.len()
    }

    /// Calls `say` with the index of each, where a row has `across` tiles.
    fn each(&self, across: u32, mut say: impl FnMut(usize)) {
        let place = |row: u32, column: u32| (row * across + column) as usize;
        // Most objects in more than one tile are in two, which need no loop.
        if self.count() == 2 {
            say(place(self.rows.start, self.columns.start));
            return say(place(self.rows.end - 1, self.columns.end - 1));
        }
        for row in self.rows.clone() {
            self.columns.clone().for_each(|column| say(place(row, column)));
        }
    }
}

/// The number of objects in each tile, from its changes between tiles: four for an object in any number of tiles.
struct Corners {
    across: usize,
    /// With one column and one row beyond the last.
    changes: Vec<u32>,
}

impl Corners {
    fn new(across: u32, tiles: usize) -> Self {
        let across = across as usize;
        Corners { across, changes: vec![0; (across + 1) * (tiles / across + 1)] }
    }

    fn add(&mut self, TileRanges { columns, rows }: &TileRanges, count: u32) {
        let pitch = self.across + 1;
        let at = |row: u32, column: u32| row as usize * pitch + column as usize;
        for (place, change) in [
            (at(rows.start, columns.start), count),
            (at(rows.start, columns.end), count.wrapping_neg()),
            (at(rows.end, columns.start), count.wrapping_neg()),
            (at(rows.end, columns.end), count),
        ] {
            self.changes[place] = self.changes[place].wrapping_add(change);
        }
    }

    fn add_sums_to(self, counts: &mut [u32]) {
        let mut above = vec![0_u32; self.across + 1];
        for (changes, counts) in self.changes.chunks(self.across + 1).zip(counts.chunks_mut(self.across)) {
            let mut sum = 0_u32;
            for ((above, change), count) in above.iter_mut().zip(changes).zip(counts) {
                *above = above.wrapping_add(*change);
                sum = sum.wrapping_add(*above);
                *count += sum;
            }
        }
    }
}

/// One by one, since a copy of variable length is a call.
fn append(lists: &mut [Candidate], next: &mut u32, run: &[Candidate]) {
    for candidate in run {
        lists[*next as usize] = *candidate;
        *next += 1;
    }
}

/// All objects, none of which has empty bounds: the runs of those in one tile, and the others, by way of `room`. If
/// they are to stay `in_order`, all are among the others. A branch between the two would be mispredicted.
fn runs_of<'a>(
    candidates: &[Candidate],
    across: u32,
    in_order: bool,
    room: &'a mut Vec<Run>,
) -> (&'a [Run], impl Iterator<Item = &'a Run> + Clone) {
    // The first and the last pixels, whose upper bits give the tile.
    const PAST_TO_LAST: u64 = 0x0001_0000_0001_0000;
    const TILES: u64 = tile_bits(TILE_HEIGHT) << 32 | tile_bits(TILE_WIDTH);
    const FIRST: u64 = 0x0000_ffff_0000_ffff;
    let places = |candidate: &Candidate| {
        (u64::from(candidate.rows) << 32 | u64::from(candidate.columns)).wrapping_sub(PAST_TO_LAST) & TILES
    };
    room.resize(room.len().max(candidates.len()), Run::default());
    let runs = &mut room[..candidates.len()];
    // From the front, and from the back.
    let (mut in_one, mut in_more) = (0, runs.len());
    let mut start = 0;
    for run in candidates.chunk_by(|a, b| places(a) == places(b)) {
        let (place, end) = (places(&run[0]), start + run.len() as u32);
        let (row, column) = ((place >> 32) as u16 / TILE_HEIGHT as u16, place as u16 / TILE_WIDTH as u16);
        let run = Run { start, end, tile: u32::from(row) * across + u32::from(column) };
        let is_in_one = !in_order & (place >> 16 & FIRST == place & FIRST);
        runs[in_one] = run;
        runs[in_more - 1] = run;
        in_one += usize::from(is_in_one);
        in_more -= usize::from(!is_in_one);
        start = end;
    }
    (&runs[..in_one], runs[in_more..].iter().rev())
}

/// The bits of the first and the last pixel's numbers that differ between tiles.
const fn tile_bits(side: usize) -> u64 {
    let of_one = 0x1_0000 - side as u64;
    of_one << 16 | of_one
}
