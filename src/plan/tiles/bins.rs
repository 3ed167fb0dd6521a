//! Bins: for each tile, the list of the objects that may be visible in it.

use std::cmp::Reverse;
use std::ops::Range;

use super::place::{Picture, TilePlace, range, tile_range};
use crate::kernels::{Candidate, TILE_HEIGHT, TILE_WIDTH, sys};

/// Up to this many spheres are sorted by distance. The nearer ones of a tile then come first, and
/// most blocks of pixels reject the others before computing their roots. Sorting more costs more
/// than it gains.
pub(super) const MOST_SORTED: usize = 1 << 11;

/// The number of entries for which a block reserves room in advance, which take 16 MiB.
const MOST_IN_BLOCK: usize = 1 << 20;

/// For each tile the objects that may be visible in it. A tile has as many lists as the scene has
/// pieces, since a piece is added as a whole.
#[derive(Default)]
pub(super) struct Bins {
    picture: Picture,
    /// An object in more tiles than this is large. None: all objects are large, and are in all
    /// tiles.
    most_tiles: Option<usize>,
    pieces: Vec<PieceLists>,
    /// The memory of the lists. A block has the lists of several pieces, and may have room for
    /// more.
    blocks: Vec<Vec<Candidate>>,
    /// The large objects, except those that are tall.
    large: Vec<Large>,
    tall: TallObjects,
    /// Scratch memory for the runs of a piece.
    runs: Vec<Run>,
}

/// The large objects that are in few columns of tiles. They are looked at by the tiles of their
/// columns alone; any other large object is looked at by all tiles of its rows.
#[derive(Default)]
struct TallObjects {
    objects: Vec<Large>,
    /// For each column of tiles the indices of the tall objects in it; empty if there are no tall
    /// objects.
    in_column: Vec<Vec<u32>>,
}

impl TallObjects {
    /// An object in more columns of tiles is not tall, since it would take memory in the list of
    /// each.
    const MOST_COLUMNS: usize = 4;

    /// Whether an object is tall: the columns of tiles that it is in have fewer tiles than its rows
    /// have.
    fn is_tall(candidate: &Candidate, picture: Picture) -> bool {
        let TileRanges { columns, rows } = TileRanges::of(candidate);
        let [across, down] = picture.tiles().map(|tiles| tiles as usize);
        columns.len() <= Self::MOST_COLUMNS && columns.len() * down < rows.len() * across
    }

    /// The lists for these objects, which are sorted by distance.
    fn new(objects: Vec<Large>, picture: Picture) -> Self {
        let [across, _] = picture.tiles();
        let mut in_column = vec![Vec::new(); if objects.is_empty() { 0 } else { across as usize }];
        for (index, large) in objects.iter().enumerate() {
            for column in TileRanges::of(&large.candidate).columns {
                in_column[column as usize].push(index as u32);
            }
        }
        TallObjects { objects, in_column }
    }
}

/// How far a tile has gone through the large objects: the next one among those of its row, and the
/// next one among the tall ones of its column.
#[derive(Clone, Copy, Default)]
pub(super) struct NextLarge {
    in_row: usize,
    in_column: usize,
}

/// A large object: one that is in many tiles.
#[derive(Clone, Copy)]
struct Large {
    candidate: Candidate,
    /// The upper bound of its 1/t at a pixel: a constant, and the coefficients of column and row.
    most: [f32; 3],
}

impl Large {
    /// The sort key: the nearest objects come first. Distances are not negative, so that their bits
    /// have their order.
    fn rank(&self) -> (Reverse<u32>, u32) {
        (Reverse(self.candidate.most.to_bits()), self.candidate.id)
    }
}

/// The large objects, except the tall ones, whose bounds meet one row of tiles, the nearest first.
/// The list is made as far as some tile of the row has needed it, so that the next tile does not go
/// through all large objects of the picture again.
#[derive(Default)]
pub struct LargeInRow {
    down: u32,
    /// How many large objects of the picture have been tested for this row.
    seen: usize,
    objects: Vec<Large>,
}

/// Consecutive objects of a piece that are in the same tiles, as neighbours in a mesh mostly are,
/// and the first of these tiles.
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

/// Where the lists of one piece of the scene are stored.
struct PieceLists {
    /// The index of the piece in the scene.
    number: usize,
    block: usize,
    /// For each tile the index in the block at which its list begins; and at the end, where the
    /// list of the last tile ends.
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
        let [across, down] = self.picture.tiles();
        (across * down) as usize
    }

    /// Adds the candidates of piece `number` of the scene, after which about `pieces_left` pieces
    /// of this size will follow. If there are few candidates they stay in their order, as sorted
    /// spheres must. If there are many, each list begins with the candidates that are in no other
    /// tile.
    pub(super) fn add(&mut self, number: usize, candidates: &[Candidate], pieces_left: f64) {
        let most_tiles = self.most_tiles.unwrap_or(0);
        let across = self.picture.width.div_ceil(TILE_WIDTH as u32);
        // At first this is the number of objects in each tile; later it is where the tile's list
        // begins.
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
            // The next pieces may have slightly more entries.
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
        // Writing zeros in order brings the memory into the core's own caches, where the lists can
        // then be written in any order.
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
        self.pieces.push(PieceLists { number, block, starts });
    }

    /// Adds the pieces of other bins, and sorts all pieces by their order in the scene.
    pub(super) fn and(mut self, other: Self) -> Self {
        let blocks = self.blocks.len();
        self.pieces.extend(other.pieces.into_iter().map(|piece| PieceLists { block: blocks + piece.block, ..piece }));
        self.pieces.sort_unstable_by_key(|piece| piece.number);
        self.blocks.extend(other.blocks);
        self.large.extend(other.large);
        self
    }

    /// Sorts the large objects by distance, after all pieces have been added. `most` gives the
    /// coefficients for [`Large::most`] by an object's index, or None to keep the constant bound.
    pub(super) fn sort(&mut self, most: impl Fn(u32) -> Option<[f32; 3]>) {
        for large in &mut self.large {
            large.most = most(large.candidate.id).unwrap_or(large.most);
        }
        self.large.sort_unstable_by_key(Large::rank);
        if self.most_tiles.is_some() {
            let picture = self.picture;
            let tall = self.large.extract_if(.., |large| TallObjects::is_tall(&large.candidate, picture)).collect();
            self.tall = TallObjects::new(tall, picture);
        }
    }

    /// The entries of all lists. An object has an entry for each tile that it is in; a large one
    /// has one entry.
    pub(super) fn listed(&self) -> impl Iterator<Item = &Candidate> {
        let lists = self.pieces.iter().flat_map(|piece| piece.of(0..piece.starts.len() - 1, &self.blocks));
        lists.chain(self.all_large().map(|large| &large.candidate))
    }

    /// The lists of a tile, one for each piece, without large objects.
    pub(super) fn of_tile(&self, tile: TilePlace) -> impl Iterator<Item = &[Candidate]> {
        let index = (tile.down * self.picture.width.div_ceil(TILE_WIDTH as u32) + tile.across) as usize;
        self.pieces.iter().map(move |piece| piece.of(index..index + 1, &self.blocks))
    }

    /// All large objects, tall ones included.
    fn all_large(&self) -> impl Iterator<Item = &Large> {
        self.large.iter().chain(&self.tall.objects)
    }

    /// Adds up to `count` large objects that may be visible in a tile, from the nearest on. It
    /// begins at `next`, which it advances, and ends at the first object whose 1/t is below `least`
    /// everywhere. Returns whether there may be more.
    pub(super) fn add_large(
        &self,
        tile: TilePlace,
        in_row: &mut LargeInRow,
        next: &mut NextLarge,
        count: usize,
        least: f32,
        room: &mut Vec<Candidate>,
    ) -> bool {
        let (column, row) = tile.first();
        let everywhere = self.most_tiles.is_none();
        let [half_width, half_height] = [TILE_WIDTH, TILE_HEIGHT].map(|side| 0.5 * (side - 1) as f32);
        let (x, y) = (column as f32 + half_width, row as f32 + half_height);
        let enough = room.len() + count;
        while let Some((Large { mut candidate, most: [most, across, down] }, is_tall)) =
            self.next_large(tile, in_row, next)
        {
            if candidate.most < least {
                return false;
            }
            if room.len() == enough {
                return true;
            }
            *(if is_tall { &mut next.in_column } else { &mut next.in_row }) += 1;
            let columns = range(candidate.columns);
            let is_in = columns.start < column + TILE_WIDTH as u32 && column < columns.end;
            let here = most + across * x + down * y + across.abs() * half_width + down.abs() * half_height;
            // Where a tile extends beyond the picture, the sum may be beyond f32, and is then no
            // bound.
            if here.is_finite() && here < candidate.most {
                candidate.most = if here > 0.0 { here } else { 0.0 };
            }
            if everywhere || is_in && candidate.most >= least {
                room.push(candidate);
            }
        }
        false
    }

    /// The nearest of the next large objects of the row and of the column, and whether it is tall.
    #[inline]
    fn next_large(&self, tile: TilePlace, in_row: &mut LargeInRow, next: &mut NextLarge) -> Option<(Large, bool)> {
        let in_row = self.next_in_row(tile, in_row, next.in_row);
        match (in_row, self.next_in_column(tile, &mut next.in_column)) {
            (Some(in_row), Some(tall)) if tall.rank() < in_row.rank() => Some((tall, true)),
            (Some(in_row), _) => Some((in_row, false)),
            (None, tall) => tall.map(|tall| (tall, true)),
        }
    }

    /// The next tall object of a tile's column that meets the tile's row, from index `next` on,
    /// which is advanced to it.
    #[inline]
    fn next_in_column(&self, tile: TilePlace, next: &mut usize) -> Option<Large> {
        let in_column = self.tall.in_column.get(tile.across as usize)?;
        let (_, row) = tile.first();
        loop {
            let large = self.tall.objects[*in_column.get(*next)? as usize];
            let rows = range(large.candidate.rows);
            if rows.start < row + TILE_HEIGHT as u32 && row < rows.end {
                return Some(large);
            }
            *next += 1;
        }
    }

    /// The large object at index `next` among those that meet a tile's row.
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

    /// The index of the nearest large object.
    pub(super) fn first_large(&self) -> Option<u32> {
        let nearest = self.large.first().into_iter().chain(self.tall.objects.first());
        nearest.min_by_key(|large| large.rank()).map(|large| large.candidate.id)
    }

    /// The number of large objects, and of entries in the lists of the others.
    pub(super) fn counts(&self) -> [usize; 2] {
        [self.all_large().count(), self.blocks.iter().map(Vec::len).sum()]
    }
}

impl PieceLists {
    /// The lists of a range of tiles.
    fn of<'a>(&self, tiles: Range<usize>, blocks: &'a [Vec<Candidate>]) -> &'a [Candidate] {
        &blocks[self.block][self.starts[tiles.start] as usize..self.starts[tiles.end] as usize]
    }
}

/// The tiles that have an object whose numbers f32 cannot hold.
#[derive(Default)]
pub(super) struct WideTiles {
    picture: Picture,
    /// For each tile, row by row, whether it has such an object; empty if no tile has.
    are_wide: Vec<bool>,
}

impl WideTiles {
    /// An empty set of the tiles of a picture.
    pub(super) fn none_of(picture: Picture) -> Self {
        WideTiles { picture, are_wide: Vec::new() }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.are_wide.is_empty()
    }

    pub(super) fn has(&self, tile: TilePlace) -> bool {
        let [across, _] = self.picture.tiles();
        self.are_wide.get((tile.down * across + tile.across) as usize) == Some(&true)
    }

    /// Adds a tile.
    pub(super) fn add(&mut self, tile: TilePlace) {
        let [across, down] = self.picture.tiles();
        self.are_wide.resize((across * down) as usize, false);
        self.are_wide[(tile.down * across + tile.across) as usize] = true;
    }

    /// Adds all tiles that an object may be in.
    pub(super) fn add_all_of(&mut self, candidate: &Candidate) {
        let TileRanges { columns, rows } = TileRanges::of(candidate);
        for down in rows {
            columns.clone().for_each(|across| self.add(TilePlace { across, down }));
        }
    }

    /// The union of two sets of tiles of the same picture.
    pub(super) fn and(mut self, others: WideTiles) -> Self {
        if self.is_empty() {
            return others;
        }
        self.are_wide.iter_mut().zip(others.are_wide).for_each(|(is_wide, other)| *is_wide |= other);
        self
    }
}

/// The columns and rows of the tiles that an object's bounds meet.
struct TileRanges {
    columns: Range<u32>,
    rows: Range<u32>,
}

impl TileRanges {
    /// The tiles that an object may be in, whose bounds are not empty.
    fn of(candidate: &Candidate) -> Self {
        let columns = tile_range(range(candidate.columns), TILE_WIDTH);
        TileRanges { columns, rows: tile_range(range(candidate.rows), TILE_HEIGHT) }
    }

    fn count(&self) -> usize {
        self.columns.len() * self.rows.len()
    }

    /// Calls `say` with the index of each tile; a row has `across` tiles.
    fn each(&self, across: u32, mut say: impl FnMut(usize)) {
        let place = |row: u32, column: u32| (row * across + column) as usize;
        // Most objects that are in more than one tile are in two, for which no loop is needed.
        if self.count() == 2 {
            say(place(self.rows.start, self.columns.start));
            return say(place(self.rows.end - 1, self.columns.end - 1));
        }
        for row in self.rows.clone() {
            self.columns.clone().for_each(|column| say(place(row, column)));
        }
    }
}

/// Counts the objects in each tile by differences. An object changes only four numbers, at the
/// corners of the rectangle of tiles that its bounds meet; prefix sums across and down then give
/// the counts.
struct Corners {
    across: usize,
    /// For each tile, row by row, the change of the count, with one more column and row at the end.
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

/// Copies a run to the end of a tile's list. It copies entry by entry, since a copy of variable
/// length is a function call.
fn append(lists: &mut [Candidate], next: &mut u32, run: &[Candidate]) {
    for candidate in run {
        lists[*next as usize] = *candidate;
        *next += 1;
    }
}

/// Divides objects, none of which has empty bounds, into runs. Returns the runs of objects in a
/// single tile, and the others; both are stored in `room`. If `in_order`, all runs are among the
/// others, which keep their order. Each run is written to both ends of `room`, since a branch
/// between the two would be mispredicted.
fn runs_of<'a>(
    candidates: &[Candidate],
    across: u32,
    in_order: bool,
    room: &'a mut Vec<Run>,
) -> (&'a [Run], impl Iterator<Item = &'a Run> + Clone) {
    // `places` computes the first and the last column and row of bounds, and keeps only the bits
    // that differ between tiles.
    const PAST_TO_LAST: u64 = 0x0001_0000_0001_0000;
    const TILES: u64 = tile_bits(TILE_HEIGHT) << 32 | tile_bits(TILE_WIDTH);
    const FIRST: u64 = 0x0000_ffff_0000_ffff;
    let places = |candidate: &Candidate| {
        (u64::from(candidate.rows) << 32 | u64::from(candidate.columns)).wrapping_sub(PAST_TO_LAST) & TILES
    };
    room.resize(room.len().max(candidates.len()), Run::default());
    let runs = &mut room[..candidates.len()];
    // The ends of the two lists: the first grows from the front, the second from the back.
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

/// A mask of the bits, in the numbers of the first and of the last pixel, in which tiles differ.
const fn tile_bits(side: usize) -> u64 {
    let of_one = 0x1_0000 - side as u64;
    of_one << 16 | of_one
}

#[cfg(test)]
mod tests {
    use super::{Bins, LargeInRow, NextLarge, TileRanges};
    use crate::kernels::Candidate;
    use crate::plan::tiles::place::{Picture, TilePlace};
    use crate::scene::Rng;

    const MOST_TILES: usize = 5;

    /// Objects of all shapes, some of them equally near.
    fn objects(picture: Picture, count: u32) -> Vec<Candidate> {
        let mut rng = Rng::new(3);
        let mut bounds = |side: u32, longest: u32| {
            let start = rng.next_u64() as u32 % side;
            let end = side.min(start + 1 + rng.next_u64() as u32 % longest);
            start | end << 16
        };
        let Picture { width, height } = picture;
        let object = |id: u32| {
            let [longest_across, longest_down] =
                [[20, height], [150, height], [width, 20], [width, height]][id as usize % 4];
            let columns = bounds(width, longest_across);
            Candidate { id, columns, rows: bounds(height, longest_down), most: (id % 50) as f32 }
        };
        (0..count).map(object).collect()
    }

    #[test]
    fn a_tile_gets_its_large_objects_once_and_from_near_to_far() {
        let picture = Picture { width: 1000, height: 700 };
        let objects = objects(picture, 500);
        let mut bins = Bins::new(picture, Some(MOST_TILES));
        bins.add(0, &objects, 0.0);
        bins.sort(|_| None);
        let [large, tall] = [&bins.large, &bins.tall.objects].map(Vec::len);
        assert!(large > 50 && tall > 50, "{large} and {tall} that are tall");
        let [across, down] = picture.tiles();
        let mut in_row = LargeInRow::default();
        for tile in (0..down).flat_map(|down| (0..across).map(move |across| TilePlace { across, down })) {
            let is_in = |object: &&Candidate| {
                let tiles = TileRanges::of(object);
                let is_large = tiles.count() > MOST_TILES;
                is_large && tiles.columns.contains(&tile.across) && tiles.rows.contains(&tile.down)
            };
            let mut expected: Vec<_> = objects.iter().filter(is_in).copied().collect();
            expected.sort_by_key(|object| (std::cmp::Reverse(object.most.to_bits()), object.id));
            let (mut found, mut next) = (Vec::new(), NextLarge::default());
            while bins.add_large(tile, &mut in_row, &mut next, 3, 10.0, &mut found) {}
            // Objects farther than the limit end it.
            expected.retain(|object| object.most >= 10.0);
            assert_eq!(found, expected, "{tile:?}");
        }
    }
}
