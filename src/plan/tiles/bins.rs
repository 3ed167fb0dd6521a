//! Which tiles each object may be in.

use std::cmp::Reverse;
use std::ops::Range;

use super::bounds::Picture;
use super::{MOST_SORTED, TilePlace, range};
use crate::kernels::{Candidate, TILE_HEIGHT, TILE_WIDTH, sys};

/// A block that is made for what is yet to come has room for so many objects at most, 16 MiB.
const MOST_IN_BLOCK: usize = 1 << 20;

/// The objects that each tile may see, of one piece of the scene after another.
#[derive(Default)]
pub(super) struct Bins {
    picture: Picture,
    /// An object in more tiles is large; if None, all of them are, and in all tiles.
    most_tiles: Option<usize>,
    pieces: Vec<Piece>,
    /// What is in their lists. Each block may have room for more.
    blocks: Vec<Vec<Candidate>>,
    /// Those that are in many tiles.
    large: Vec<Large>,
    /// Room for the runs of a piece.
    runs: Vec<Run>,
}

/// An object that is in many tiles.
#[derive(Clone, Copy)]
struct Large {
    candidate: Candidate,
    /// What its 1/t cannot exceed at a pixel: a number, and what a column and a row more add to it.
    most: [f32; 3],
}

/// Objects of a piece that follow one another and are in the same tiles, as neighbours in a mesh mostly are, and the first of
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

/// Where the objects of a piece of the scene are.
struct Piece {
    /// Its number in the scene.
    number: usize,
    block: usize,
    /// In the block: where each tile's begin, and where the last one's end.
    starts: Vec<u32>,
}

impl Bins {
    /// Without objects.
    pub(super) fn new(picture: Picture, most_tiles: Option<usize>) -> Self {
        Bins { picture, most_tiles, ..Bins::default() }
    }

    /// How many pieces have been added.
    pub(super) fn pieces(&self) -> usize {
        self.pieces.len()
    }

    /// How many tiles there are.
    pub(super) fn tiles(&self) -> usize {
        let Picture { width, height } = self.picture;
        (width.div_ceil(TILE_WIDTH as u32) * height.div_ceil(TILE_HEIGHT as u32)) as usize
    }

    /// Adds what is seen of the piece of the scene that has this number, after which so many `pieces_left` like it may come.
    /// Few stay in their order, as spheres that were sorted must; of many the lists begin with those that are in no other tile.
    pub(super) fn add(&mut self, number: usize, candidates: &[Candidate], pieces_left: f64) {
        let most_tiles = self.most_tiles.unwrap_or(0);
        let across = self.picture.width.div_ceil(TILE_WIDTH as u32);
        // How many objects each tile has, and then where they begin.
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
            // The next ones may have a few more.
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
        // Brings the memory into a core's own caches, where the lists can then be written to in any order.
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

    /// With the pieces of another, all in the scene's order.
    pub(super) fn and(mut self, other: Self) -> Self {
        let blocks = self.blocks.len();
        self.pieces.extend(other.pieces.into_iter().map(|piece| Piece { block: blocks + piece.block, ..piece }));
        self.pieces.sort_unstable_by_key(|piece| piece.number);
        self.blocks.extend(other.blocks);
        self.large.extend(other.large);
        self
    }

    /// Puts those that are in many tiles in the order of their nearness; `most` says of each, by its number, what its 1/t
    /// cannot exceed, as [`Large`] has it.
    pub(super) fn sort(&mut self, most: impl Fn(u32) -> Option<[f32; 3]>) {
        for large in &mut self.large {
            large.most = most(large.candidate.id).unwrap_or(large.most);
        }
        // Not negative, so that they are in the order of their bits.
        self.large.sort_unstable_by_key(|large| (Reverse(large.candidate.most.to_bits()), large.candidate.id));
    }

    /// All that is in a list, once for each.
    pub(super) fn listed(&self) -> impl Iterator<Item = &Candidate> {
        let lists = self.pieces.iter().flat_map(|piece| piece.of(0..piece.starts.len() - 1, &self.blocks));
        lists.chain(self.large.iter().map(|large| &large.candidate))
    }

    /// What a tile may see of what is in few tiles.
    pub(super) fn of_tile(&self, tile: TilePlace) -> impl Iterator<Item = &[Candidate]> {
        let index = (tile.down * self.picture.width.div_ceil(TILE_WIDTH as u32) + tile.across) as usize;
        self.pieces.iter().map(move |piece| piece.of(index..index + 1, &self.blocks))
    }

    /// Asks for all of this at once: one after another, each list would be waited for.
    pub(super) fn ask_for(&self, tile: TilePlace) {
        self.of_tile(tile).for_each(sys::ask_for);
    }

    /// Adds some of those that are in many tiles and may be in this one, the nearest first: up to `count` of them, from number
    /// `next` on, which then is that of the first of the others. None of these can be nearer than `least` in the tile.
    pub(super) fn add_large(
        &self,
        tile: TilePlace,
        next: &mut usize,
        count: usize,
        least: f32,
        room: &mut Vec<Candidate>,
    ) {
        let (column, row) = tile.first();
        let everywhere = self.most_tiles.is_none();
        let [half_width, half_height] = [TILE_WIDTH, TILE_HEIGHT].map(|side| 0.5 * (side - 1) as f32);
        let (x, y) = (column as f32 + half_width, row as f32 + half_height);
        let enough = room.len() + count;
        for large in &self.large[*next..] {
            let Large { mut candidate, most: [most, across, down] } = *large;
            if candidate.most < least {
                *next = self.large.len();
                return;
            }
            if room.len() == enough {
                return;
            }
            *next += 1;
            let (columns, rows) = (range(candidate.columns), range(candidate.rows));
            let is_in = columns.start < column + TILE_WIDTH as u32
                && column < columns.end
                && rows.start < row + TILE_HEIGHT as u32
                && row < rows.end;
            let here = most + across * x + down * y + across.abs() * half_width + down.abs() * half_height;
            // A NaN is not less.
            if here < candidate.most {
                candidate.most = if here > 0.0 { here } else { 0.0 };
            }
            if everywhere || is_in && candidate.most >= least {
                room.push(candidate);
            }
        }
    }

    /// How many are in many tiles.
    pub(super) fn count_large(&self) -> usize {
        self.large.len()
    }
}

impl Piece {
    /// What is in the lists of some tiles.
    fn of<'a>(&self, tiles: Range<usize>, blocks: &'a [Vec<Candidate>]) -> &'a [Candidate] {
        &blocks[self.block][self.starts[tiles.start] as usize..self.starts[tiles.end] as usize]
    }
}

/// The tiles, row by row, that some of these may be in.
pub(super) fn tiles_of(candidates: &[Candidate], picture: Picture) -> Vec<bool> {
    let across = picture.width.div_ceil(TILE_WIDTH as u32);
    let mut tiles = vec![false; (across * picture.height.div_ceil(TILE_HEIGHT as u32)) as usize];
    candidates.iter().for_each(|candidate| TileRanges::of(candidate).each(across, |tile| tiles[tile] = true));
    tiles
}

/// From pixels to tiles; not empty.
pub(super) fn tile_range(pixels: Range<u32>, side: usize) -> Range<u32> {
    pixels.start / side as u32..(pixels.end - 1) / side as u32 + 1
}

/// Columns and rows of tiles.
struct TileRanges {
    columns: Range<u32>,
    rows: Range<u32>,
}

impl TileRanges {
    /// Of an object whose bounds are not empty.
    fn of(candidate: &Candidate) -> Self {
        let columns = tile_range(range(candidate.columns), TILE_WIDTH);
        TileRanges { columns, rows: tile_range(range(candidate.rows), TILE_HEIGHT) }
    }

    fn count(&self) -> usize {
        self.columns.len() * self.rows.len()
    }

    /// Says the place of each, where a row has as many tiles as are `across`.
    fn each(&self, across: u32, mut say: impl FnMut(usize)) {
        let place = |row: u32, column: u32| (row * across + column) as usize;
        // Most of those that are in more than one, and known without a loop.
        if self.count() == 2 {
            say(place(self.rows.start, self.columns.start));
            return say(place(self.rows.end - 1, self.columns.end - 1));
        }
        for row in self.rows.clone() {
            self.columns.clone().for_each(|column| say(place(row, column)));
        }
    }
}

/// How many objects each tile has, by the changes from tile to tile, of which an object has four, in however many tiles it is.
struct Corners {
    across: usize,
    /// With a column and a row beyond the last.
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

/// One by one, since a copy of any length is a call.
fn append(lists: &mut [Candidate], next: &mut u32, run: &[Candidate]) {
    for candidate in run {
        lists[*next as usize] = *candidate;
        *next += 1;
    }
}

/// All objects, none of which has empty bounds: the runs of those that are in one tile, and the others, by way of `room`. If
/// they are to stay `in_order`, all are among the others. Which of the two it is would be a toss for a branch.
fn runs_of<'a>(
    candidates: &[Candidate],
    across: u32,
    in_order: bool,
    room: &'a mut Vec<Run>,
) -> (&'a [Run], impl Iterator<Item = &'a Run> + Clone) {
    // The first pixels and the last ones, of which the upper bits say where a tile is.
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

/// Of the first and the last pixel's numbers the bits that differ from tile to tile.
const fn tile_bits(side: usize) -> u64 {
    let of_one = 0x1_0000 - side as u64;
    of_one << 16 | of_one
}
