//! Occlusion queries: which points of a tile are hidden from a light by objects on one side of its
//! cube.
//!
//! Here "in front of" and "behind" are meant as seen from the light: an occluder is in front of the
//! points that it hides.
//!
//! Usually one query is made for all points of a tile, against the objects in front of them. If
//! these are a crowd of small objects, neighbours in the picture make bad groups: they are at
//! different depths, so that the light sees them spread along a line, whose bounding box contains
//! much of the crowd. Such points are sorted along a Hilbert curve over the light's view, and each
//! part of the curve gets its own query, which first drops the objects that are in front of none of
//! its points.

use std::ops::Range;

use crate::kernels::{
    Extent, GROUP, GROUPS, LitGroups, LitPoints, MOST_CASTERS, PacketKernels, Plain, TILE_PIXELS, TilePoints,
};
use crate::plan::{Casters, LightSide, SideBounds, TileSurvey, Window};

/// More objects than this in front of a tile's points are a crowd. With half this limit, a scene of
/// 100,000 small triangles takes 1.1 times as long (Zen 3).
const CROWD: usize = 256;

/// The objects of a crowd count as small if the middle cell of the window has at most this share of
/// them. If it has more, a smaller window would not have many fewer: without this rule 10,000
/// spheres of 100 pixels take 1.5 times as long.
const MOST_IN_THE_MIDDLE: f32 = 0.125;

/// Sorted points behind at most this many objects make one query. With half this limit, a million
/// small triangles take 1.1 times as long.
const FEW: usize = 128;

/// A part of the curve is halved if its halves together have at most this many times as many
/// objects in front of them as the part itself. Large objects are in front of both halves and count
/// twice. The limit 1.5 is not faster.
const MOST_OF_HALVES: f32 = 1.25;

/// The Hilbert curve has this many cells across and as many down.
const CURVE_SIDE: usize = 64;
const CURVE_CELLS: usize = CURVE_SIDE * CURVE_SIDE;

/// The position on the curve of each cell, row by row.
static PLACES_ON_CURVE: [u16; CURVE_CELLS] = {
    let mut places = [0; CURVE_CELLS];
    let mut cell = 0;
    while cell < CURVE_CELLS {
        places[cell] = place_on_curve(cell % CURVE_SIDE, cell / CURVE_SIDE);
        cell += 1;
    }
    places
};

/// The position of a cell on the Hilbert curve that begins in the first column of the first row and
/// ends in the last column of that row.
const fn place_on_curve(mut column: usize, mut row: usize) -> u16 {
    let mut place = 0;
    let mut half = CURVE_SIDE / 2;
    while half > 0 {
        let (is_right, is_low) = (column >= half, row >= half);
        (column, row) = (column % half, row % half);
        // The curve goes down on the left and up on the right. The parts in the quadrants are
        // mirrored at a diagonal so that they join.
        let quadrant = match (is_right, is_low) {
            (false, false) => {
                (column, row) = (row, column);
                0
            }
            (false, true) => 1,
            (true, true) => 2,
            (true, false) => {
                (column, row) = (half - 1 - row, half - 1 - column);
                3
            }
        };
        place = 4 * place + quadrant;
        half /= 2;
    }
    place
}

/// The open points of a tile that objects on a side of the cube may be in front of, sorted along a
/// Hilbert curve over the light's view.
pub(super) struct AlongCurve {
    points: TilePoints,
    groups: LitGroups,
    /// The number of points.
    count: usize,
    /// For each point its index in the tile.
    order: [u16; TILE_PIXELS],
    /// For each point of the tile the position of its cell on the curve, or [`NO_CELL`].
    cells: [u16; TILE_PIXELS],
    /// For each cell the index of its first point.
    starts: [u16; CURVE_CELLS + 1],
}

/// The cell of a point that is not open, or that no object is in front of.
const NO_CELL: u16 = u16::MAX;

impl Default for AlongCurve {
    fn default() -> Self {
        AlongCurve {
            points: TilePoints::ZERO,
            groups: LitGroups::ZERO,
            count: 0,
            order: [0; TILE_PIXELS],
            cells: [0; TILE_PIXELS],
            starts: [0; CURVE_CELLS + 1],
        }
    }
}

impl AlongCurve {
    /// Takes the open points of a tile within a window. Their coordinates on the side of the cube,
    /// `points.seen`, must have been computed.
    fn take(&mut self, points: &TilePoints, groups: &LitGroups, window: &Window) {
        self.find_cells(points, groups, window);
        self.sort();
        let AlongCurve { points: sorted, groups: together, count, order, .. } = self;
        // The last group is filled up with copies of its last point, which are not open.
        let filled = count.next_multiple_of(GROUP);
        if filled > *count {
            let last = order[*count - 1];
            order[*count..filled].fill(last);
        }
        for (place, from) in order[..filled].iter().enumerate() {
            let from = usize::from(*from);
            sorted.x[place] = points.x[from];
            sorted.y[place] = points.y[from];
            sorted.z[place] = points.z[from];
            sorted.own[place] = points.own[from];
        }
        for (group, own) in sorted.own.as_chunks::<GROUP>().0.iter().enumerate() {
            let open = count.saturating_sub(group * GROUP).min(GROUP);
            together.open[group] = (1 << open) - 1;
            let first = own[0].to_bits();
            let are_of_one = open > 0 && own.iter().all(|own| own.to_bits() == first);
            together.own[group] = if are_of_one { first } else { 0 };
        }
    }

    /// Finds the cell of each point, and counts the points in each cell: `starts[cell + 1]` becomes
    /// the number of points in `cell`.
    fn find_cells(&mut self, points: &TilePoints, groups: &LitGroups, window: &Window) {
        let [low, high] = window.corners();
        let size = (high[0] - low[0]).max(high[1] - low[1]);
        // Half a cell less, so that the greatest coordinate falls into the last cell too.
        let scale = if size > 0.0 { (CURVE_SIDE as f32 - 0.5) / size } else { 0.0 };
        self.starts.fill(0);
        self.cells.fill(NO_CELL);
        let [x, y] = points.seen.each_ref().map(|seen| seen.as_chunks::<GROUP>().0);
        let of_group = groups.open.iter().zip(self.cells.as_chunks_mut::<GROUP>().0).zip(x.iter().zip(y));
        for ((open, cells), (x, y)) in of_group.filter(|((open, _), _)| **open != 0) {
            for i in 0..GROUP {
                let is_in_window = (low[0] <= x[i]) & (x[i] <= high[0]) & (low[1] <= y[i]) & (y[i] <= high[1]);
                let has_cell = is_in_window & (open >> i & 1 != 0);
                let column = ((x[i] - low[0]) * scale) as usize % CURVE_SIDE;
                let row = ((y[i] - low[1]) * scale) as usize % CURVE_SIDE;
                let cell = PLACES_ON_CURVE[row * CURVE_SIDE + column];
                self.starts[usize::from(cell) + 1] += u16::from(has_cell);
                cells[i] = if has_cell { cell } else { NO_CELL };
            }
        }
    }

    /// Sorts the points by their cells.
    fn sort(&mut self) {
        let AlongCurve { count, order, cells, starts, .. } = self;
        let mut sum = 0;
        for start in &mut starts[1..] {
            // `starts[cell + 1]` is now where the next point of the cell goes; in the end it is
            // where the cell's points end.
            sum += std::mem::replace(start, sum);
        }
        *count = usize::from(sum);
        for (from, cell) in cells.iter().enumerate().filter(|(_, cell)| **cell != NO_CELL) {
            let next = &mut starts[usize::from(*cell) + 1];
            order[usize::from(*next)] = from as u16;
            *next += 1;
        }
    }

    /// Closes those points of the tile that have been closed here.
    fn give_back(&self, groups: &mut LitGroups) {
        for (place, from) in self.order[..self.count].iter().enumerate() {
            let from = usize::from(*from);
            let is_hidden = !self.groups.open[place / GROUP] >> (place % GROUP) & 1;
            groups.open[from / GROUP] &= !(is_hidden << (from % GROUP));
        }
    }
}

/// An occlusion query: which open points of some groups are hidden from a light by objects on a
/// side of its cube.
pub(super) struct OcclusionQuery<'a, 's> {
    pub packets: &'static PacketKernels,
    pub side: LightSide<'a>,
    /// Whether to cull objects that are in front of no point of a group.
    pub culls: bool,
    pub points: &'s TilePoints,
    pub groups: &'s mut LitGroups,
    pub casters: &'s mut Casters,
    pub counts: &'s mut TileSurvey,
}

impl<'a> OcclusionQuery<'a, '_> {
    /// Closes the open points that an object hides. Points behind a crowd are sorted with
    /// `along_curve`.
    pub fn run(mut self, along_curve: &mut Option<Box<AlongCurve>>) {
        let Some(window) = self.side.window(ends(self.groups, 0..GROUPS)) else { return };
        if !self.culls || !self.is_behind_a_crowd(&window) {
            let near = self.gather(&window);
            return self.close_hidden(near, 0..GROUPS);
        }
        let sorted = &mut **along_curve.get_or_insert_default();
        sorted.take(self.points, self.groups, &window);
        self.packets.seen.call(self.side.view(), &mut sorted.points, self.side.axis(), &mut sorted.groups);
        let all = 0..sorted.count.div_ceil(GROUP);
        let AlongCurve { points, groups, .. } = sorted;
        OcclusionQuery { points, groups, casters: self.casters, counts: self.counts, ..self }.run_in_parts(all);
        sorted.give_back(self.groups);
    }

    /// Whether the points are behind many small objects.
    fn is_behind_a_crowd(&self, window: &Window) -> bool {
        let crowd = self.side.crowd(window);
        crowd > CROWD && self.side.crowd(&window.middle()) as f32 <= MOST_IN_THE_MIDDLE * crowd as f32
    }

    /// The window of some groups, and the number of objects in its cells.
    fn crowd(&self, part: Range<usize>) -> Option<(Window, usize)> {
        let window = self.side.window(ends(self.groups, part))?;
        let crowd = self.side.crowd(&window);
        Some((window, crowd))
    }

    /// Closes the hidden ones of sorted points. A part of the curve is halved as long as its halves
    /// have fewer objects in front of them.
    fn run_in_parts(&mut self, part: Range<usize>) {
        let Some((window, crowd)) = self.crowd(part.clone()) else { return };
        if part.len() > 1 && crowd > FEW {
            let middle = part.start + part.len().next_power_of_two() / 2;
            let halves = [part.start..middle, middle..part.end];
            let crowds = halves.clone().map(|half| self.crowd(half).map_or(0, |(_, crowd)| crowd));
            if crowds.iter().sum::<usize>() as f32 <= MOST_OF_HALVES * crowd as f32 {
                return halves.into_iter().for_each(|half| self.run_in_parts(half));
            }
        }
        let near = self.gather(&window).map(|near| self.in_front_of_points(&near, part.clone()));
        self.close_hidden(near, part);
    }

    /// The objects of each kind that may be in front of the points of a window.
    fn gather(&self, window: &Window) -> [Vec<&'a Extent>; 3] {
        let mut near = [0; 3].map(|_| Vec::with_capacity(GROUPS));
        self.side.gather(window, &mut near);
        near
    }

    /// Those of some objects that are in front of an open point of some groups; of a crowd, they
    /// are few.
    fn in_front_of_points(&mut self, near: &[&'a Extent], part: Range<usize>) -> Vec<&'a Extent> {
        let list = &mut self.casters.list;
        let mut in_front = Vec::with_capacity(near.len());
        for near in near.chunks(MOST_CASTERS) {
            list.clear();
            near.iter().for_each(|extent| list.push_as_one(extent));
            self.packets.meet.call(Some(self.points), self.groups, part.clone(), list);
            in_front.extend(list.each_met().map(|met| near[met.number]));
        }
        in_front
    }

    /// Closes the open points of some groups that one of these objects hides.
    fn close_hidden(&mut self, near: [Vec<&'a Extent>; 3], part: Range<usize>) {
        let OcclusionQuery { packets, side, culls, points, groups, casters, counts } = self;
        let light = side.light();
        let lit_points = LitPoints { points, light: &light };
        let open: u64 = groups.open[part.clone()].iter().map(|open| u64::from(open.count_ones())).sum();
        for (kind, mut near) in near.into_iter().enumerate() {
            counts.asked += open * near.iter().map(|of| u64::from(of.count)).sum::<u64>();
            near.sort_unstable_by_key(|of| of.depth.to_bits());
            let mut near = &near[..];
            // An object that is farther than all points that are still open hides none of them.
            while near.first().is_some_and(|of| of.depth <= farthest(groups, part.clone())) {
                near = side.cast((kind, near), &packets.cast, casters);
                // Points are needed only to cull by edges, which only triangles have.
                let points = (*culls && kind > 0).then_some(*points);
                packets.meet.call(points, groups, part.clone(), &mut casters.list);
                side.make_met(casters);
                if kind == 0 {
                    packets.sphere_casters.call(&lit_points, &casters.spheres, &casters.list, groups);
                } else {
                    packets.triangle_casters.call(&lit_points, &casters.triangles, &casters.list, groups);
                }
            }
        }
    }
}

/// The bounds of the open points of some groups on a side; infinite if there are none.
fn ends(LitGroups { x, y, past_x, past_y, depth, open, .. }: &LitGroups, part: Range<usize>) -> SideBounds {
    [x, y, past_x, past_y, depth].map(|field| least_of_open(&field[part.clone()], &open[part.clone()]))
}

/// The depth of the farthest open point in some groups.
fn farthest(LitGroups { depth, open, .. }: &LitGroups, part: Range<usize>) -> f32 {
    -least_of_open(&depth[part.clone()], &open[part])
}

/// The least of the numbers of those groups that have open points. The numbers are floats, given as
/// bits.
fn least_of_open(numbers: &[u32], open: &[u32]) -> f32 {
    let or_least = |least: f32, number: u32, open: u32| {
        let number = if open != 0 { f32::from_bits(number) } else { f32::INFINITY };
        if number < least { number } else { least }
    };
    // Eight minima are kept, since with a single one each comparison would wait for the one before.
    let mut least = [f32::INFINITY; 8];
    let (numbers, numbers_left) = numbers.as_chunks::<8>();
    let (open, open_left) = open.as_chunks::<8>();
    for (numbers, open) in numbers.iter().zip(open) {
        least = std::array::from_fn(|i| or_least(least[i], numbers[i], open[i]));
    }
    let left = numbers_left.iter().zip(open_left);
    left.fold(least.into_iter().fold(f32::INFINITY, f32::min), |least, (number, open)| or_least(least, *number, *open))
}

#[cfg(test)]
mod tests {
    use super::{CURVE_CELLS, CURVE_SIDE, PLACES_ON_CURVE};

    #[test]
    fn the_curve_goes_from_each_cell_to_one_beside_it() {
        let mut cells = vec![None; CURVE_CELLS];
        for (cell, place) in PLACES_ON_CURVE.iter().enumerate() {
            assert_eq!(cells[usize::from(*place)].replace(cell), None, "place {place}");
        }
        for pair in cells.windows(2) {
            let [(x, y), (next_x, next_y)] =
                [0, 1].map(|i| pair[i].unwrap()).map(|cell| (cell % CURVE_SIDE, cell / CURVE_SIDE));
            assert_eq!(x.abs_diff(next_x) + y.abs_diff(next_y), 1, "{pair:?}");
        }
    }
}
