//! The arguments of the kernels of shadows: the visible points of a tile, and objects that may hide
//! a light from them.

use std::fmt::{Debug, Formatter, Result};
use std::ops::Range;

use super::kernel::{Callee, function, kinds, reads, writes};
use super::objects::{ObjectList as _, TriangleList};
use super::records::{
    CastTask, CasterBounds, CasterEdges, CastersTask, Element, GROUP, LightSideView, LitGroups, MOST_CASTERS, MeetTask,
    PointObject, PointView, TILE_PIXELS, TilePoints, TriangleArrays,
};
use super::tiles::TileBuffers;
use super::types::Plain;

/// The number of objects in a block.
pub(super) const BLOCK: usize = 16;

/// The number of groups of points in a tile.
pub const GROUPS: usize = TILE_PIXELS / GROUP;

kinds! {
    /// Finds the visible points at the pixels of a tile.
    Points<E: Element> as fn(&PointView<f64>, &[E; TILE_PIXELS], [u32; 2], &[PointObject<f64>], &mut TilePoints);

    /// Sets the points of the tile whose first pixel is in this column and row of the picture.
    /// `objects` has the objects of the tile by their ids, from 0 on.
    ///
    /// # Panics
    /// If `objects` lacks an id of the tile.
    fn call(
        view: &PointView<f64>, buffers: &TileBuffers<E>, first: [u32; 2], objects: &[PointObject<f64>],
        points: &mut TilePoints,
    ); |way| {
        let who = buffers.who(objects.len());
        let [column, row] = first;
        match way {
            Callee::Code(enter) => {
                let (objects, points) = (reads(objects), writes(points));
                enter([reads(view), reads(who), column.into(), row.into(), objects, points]);
            }
            Callee::Rust(find) => find(view, who, first, objects, points),
        }
    }

    /// Finds where a light sees the points of a tile.
    Seen as fn(&LightSideView<f64>, [&[f64; TILE_PIXELS]; 3], &mut LitGroups, &mut [[f32; TILE_PIXELS]; 2]);

    /// Sets where the light sees the points of those groups that have open points, and the bounds
    /// of these groups. `axis` says which coordinate is the depth, from 0 to 2.
    fn call(view: &LightSideView<f64>, points: &mut TilePoints, axis: usize, groups: &mut LitGroups); |way| {
        // These are fields of a record that is aligned.
        let TilePoints { x, y, z, seen, .. } = points;
        let axes = axes(axis).map(|axis| [&*x, &*y, &*z][axis]);
        match way {
            Callee::Code(enter) => {
                let [across, down, depth] = axes.map(|axis| reads(axis));
                enter([reads(view), across, down, depth, writes(groups), writes(seen)]);
            }
            Callee::Rust(see) => see(view, axes, groups, seen),
        }
    }

    /// Finds where a light sees triangles.
    Cast as fn(&LightSideView<f64>, [usize; 3], TriangleList<'_>, u32, &mut CasterList);

    /// Sets the bounds and the edges of the triangles in a list, which gives them by their places
    /// in the scene; the places of `triangles` begin with `first`. `axis` says which coordinate is
    /// the depth, from 0 to 2.
    ///
    /// # Panics
    /// If a triangle of the list is not among `triangles`.
    fn call(
        view: &LightSideView<f64>, axis: usize, triangles: TriangleList<'_>, first: u32, arrays: &mut TriangleArrays,
        casters: &mut CasterList,
    ); |way| {
        let (axes, places) = (axes(axis), own_bits(first)..own_bits(first + triangles.len() as u32));
        let bounds = &mut casters.bounds[..casters.count.div_ceil(BLOCK)];
        assert!(bounds.iter().flat_map(|bounds| &bounds.own).all(|own| places.contains(own)), "triangles of a list");
        if casters.count == 0 {
            return;
        }
        casters.have_edges = true;
        if casters.edges.len() < bounds.len() {
            casters.edges.resize(bounds.len(), CasterEdges::ZERO);
        }
        match way {
            Callee::Code(enter) => {
                let [objects, vertices] = triangles.addresses();
                let bounds = bounds.as_mut_ptr_range();
                let task = CastTask {
                    objects,
                    vertices,
                    first_own: places.start.into(),
                    arrays: writes(arrays),
                    edges: writes(&mut *casters.edges),
                    bounds: bounds.start as u64,
                    bounds_end: bounds.end as u64,
                    across: axes[0] as u64,
                    down: axes[1] as u64,
                    depth: axes[2] as u64,
                };
                enter([reads(view), reads(&task), 0, 0, 0, 0]);
            }
            Callee::Rust(cast) => cast(view, axes, triangles, first, casters),
        }
        // The last block is filled up with objects that meet nothing.
        let last = casters.block_count() - 1;
        casters.bounds[last].x[(casters.count - 1) % BLOCK + 1..].fill(NOWHERE);
    }

    /// Finds the objects that may hide a light from groups of points.
    Meet as fn(Option<&TilePoints>, &LitGroups, Range<usize>, &mut CasterList);

    /// Lists the pairs of a group in `asking` and an object of the list whose bounds, as the light
    /// [sees](Seen) both, meet. With `points` a pair counts only if an open point of the group is
    /// within the object: within its edges if it is a triangle that was [cast](Cast), else within
    /// its bounds.
    ///
    /// # Panics
    /// If `asking` has groups that a tile does not have.
    fn call(points: Option<&TilePoints>, groups: &LitGroups, asking: Range<usize>, casters: &mut CasterList); |way| {
        assert!(asking.end <= GROUPS, "groups of a tile");
        casters.met_count = 0;
        if casters.count == 0 || asking.is_empty() {
            return;
        }
        // There is room for all pairs, and for what is written beyond them.
        casters.met.resize(GROUPS * MOST_CASTERS + BLOCK, 0);
        match way {
            Callee::Code(enter) => {
                let task = MeetTask {
                    points: points.map_or(0, |points| reads(points)),
                    groups: reads(groups),
                    first: asking.start as u64,
                    end: asking.end as u64,
                    bounds: reads(&*casters.bounds),
                    edges: if casters.have_edges { reads(&*casters.edges) } else { 0 },
                    blocks: reads(&casters.blocks),
                    block_count: casters.block_count() as u64,
                    met: writes(&mut *casters.met),
                };
                casters.met_count = enter([reads(&task), 0, 0, 0, 0, 0]) as usize;
            }
            Callee::Rust(meet) => meet(points, groups, asking, casters),
        }
    }

    /// Finds the points that some objects hide from a light.
    Casters<C: Plain> as fn(&LitPoints<'_>, &[C], &CasterList, &mut LitGroups);

    /// Closes each open point that an object hides from the light, among the objects which its
    /// group [meets](Meet). The list `casters` gives them by their numbers in `objects`.
    ///
    /// # Panics
    /// If `objects` lacks one of these numbers.
    fn call(points: &LitPoints<'_>, objects: &[C], casters: &CasterList, groups: &mut LitGroups); |way| {
        let met = &casters.met[..casters.met_count];
        assert!(met.iter().all(|met| number(*met) < objects.len()), "objects with these numbers");
        if met.is_empty() {
            return;
        }
        match way {
            Callee::Code(enter) => {
                let task = CastersTask {
                    points: reads(points.points),
                    groups: writes(groups),
                    light: reads(points.light),
                    casters: reads(objects),
                    met: met.as_ptr_range().start as u64,
                    met_end: met.as_ptr_range().end as u64,
                };
                enter([reads(&task), 0, 0, 0, 0, 0]);
            }
            Callee::Rust(ask) => ask(points, objects, casters, groups),
        }
    }
}

/// The points of a tile, and a light that may reach them.
#[derive(Clone, Copy)]
pub struct LitPoints<'a> {
    pub points: &'a TilePoints,
    pub light: &'a [f64; 3],
}

/// The axes of a side of a light's cube that is perpendicular to `axis`: across, down and depth.
pub fn axes(axis: usize) -> [usize; 3] {
    [1, 2, 0].map(|next| (axis + next) % 3)
}

/// The bounds, as a light sees them, of an object or of several that follow each other in the
/// scene.
#[derive(Clone, Copy, Default)]
pub struct Extent {
    /// The least x and y, in cells; `high` are the greatest.
    pub low: [f32; 2],
    pub high: [f32; 2],
    pub depth: f32,
    /// The place in the scene of the first object.
    pub first: u32,
    /// The number of objects.
    pub count: u32,
}

impl Extent {
    /// The fields that are compared with those of [`CasterBounds`]; lower ends and the depth are
    /// negated.
    fn ends(&self) -> [f32; 5] {
        let Extent { low, high, depth, .. } = self;
        [-low[0], -low[1], high[0], high[1], -depth]
    }
}

/// An object's place in the scene, as the bits of an f32 that is finite, above 0, and different for
/// every place.
pub fn own_bits(place: u32) -> u32 {
    place + f32::MIN_POSITIVE.to_bits()
}

/// The number that identifies an object to kernels: the f32 with the bits [`own_bits`].
pub fn own_number(place: u32) -> f64 {
    f32::from_bits(own_bits(place)).into()
}

/// Objects that may hide a light, in blocks. There are at most [`MOST_CASTERS`].
pub struct CasterList {
    count: usize,
    /// The bounds of the objects, block by block; the vector may have more blocks.
    bounds: Vec<CasterBounds>,
    /// The bounds of whole blocks.
    blocks: CasterBounds,
    /// The edges of triangles that were [cast](Cast), with as many blocks as `bounds`.
    edges: Vec<CasterEdges>,
    have_edges: bool,
    /// Pairs of a group and the number of an object that it [meets](Meet), sorted. The first
    /// `met_count` count; the vector may have more.
    met: Vec<u32>,
    met_count: usize,
}

const _: () = assert!(MOST_CASTERS == 256, "the number of an object is the last byte of a pair");

/// The number of the object in a pair of a group and an object.
pub(super) fn number(met: u32) -> usize {
    met as usize % MOST_CASTERS
}

/// The bits of NaN, which as a coordinate meets no other.
const NOWHERE: u32 = f32::NAN.to_bits();

/// The identifying number of several objects together, which neither a point nor a group has.
const OF_SEVERAL: u32 = (-1.0f32).to_bits();

/// The bounds of no objects.
const NO_BLOCKS: CasterBounds = CasterBounds {
    x: [NOWHERE; BLOCK],
    y: [NOWHERE; BLOCK],
    past_x: [NOWHERE; BLOCK],
    past_y: [NOWHERE; BLOCK],
    depth: [NOWHERE; BLOCK],
    own: [NOWHERE; BLOCK],
};

impl CasterBounds {
    /// The fields that [`Extent::ends`] yields, in the same order.
    fn ends(&mut self) -> [&mut [u32; BLOCK]; 5] {
        let CasterBounds { x, y, past_x, past_y, depth, .. } = self;
        [x, y, past_x, past_y, depth]
    }
}

impl Default for CasterList {
    fn default() -> Self {
        let (bounds, edges, met) = Default::default();
        CasterList { count: 0, bounds, blocks: NO_BLOCKS, edges, have_edges: false, met, met_count: 0 }
    }
}

impl Debug for CasterList {
    fn fmt(&self, f: &mut Formatter<'_>) -> Result {
        let of_blocks = self.bounds.iter().zip(&self.edges).take(self.block_count());
        f.debug_list().entry(&self.blocks).entries(of_blocks).entries(self.met()).finish()
    }
}

/// An object of a list that some group of points meets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MetCaster {
    /// The object's number in the list.
    pub number: usize,
    /// The object's place in the scene.
    pub place: u32,
}

/// A group of points, and the pairs with the objects that it meets.
#[derive(Clone, Copy, Debug)]
pub(super) struct MetByGroup<'a> {
    pub(super) group: usize,
    pub(super) met: &'a [u32],
}

/// A block of the objects of a list.
pub(super) struct CasterBlock<'a> {
    pub(super) bounds: &'a mut CasterBounds,
    pub(super) edges: &'a mut CasterEdges,
}

impl CasterList {
    /// Adds the objects of an extent. For a single object the extent gives its bounds; the bounds
    /// of several are set later, by [`Cast`].
    ///
    /// # Panics
    /// If the list has no room for them.
    pub fn push(&mut self, extent: &Extent) {
        let Extent { first, count, .. } = extent;
        assert!(self.count + *count as usize <= MOST_CASTERS, "{count} casters more than {}", self.count);
        if *count == 1 {
            return self.push_as_one(extent);
        }
        let (mut next, end) = (own_bits(*first), own_bits(first + count));
        while next < end {
            let at = self.count % BLOCK;
            self.widen_block(extent);
            let bounds = self.last_block(next);
            bounds.own[at..].iter_mut().zip(next..end).for_each(|(own, place)| *own = place);
            let here = (BLOCK - at).min((end - next) as usize);
            self.count += here;
            next += here as u32;
        }
    }

    /// Adds an extent as a single object, to find out whether a group meets any of the objects in
    /// it.
    ///
    /// # Panics
    /// If the list has no room for it.
    #[inline(always)]
    pub fn push_as_one(&mut self, extent: &Extent) {
        let own = if extent.count == 1 { own_bits(extent.first) } else { OF_SEVERAL };
        let at = self.count % BLOCK;
        self.widen_block(extent);
        let bounds = self.last_block(own);
        bounds.ends().into_iter().zip(extent.ends()).for_each(|(field, end)| field[at] = end.to_bits());
        bounds.own[at] = own;
        self.count += 1;
    }

    /// Widens the bounds of the block that the next object goes to by the object's bounds.
    #[inline(always)]
    fn widen_block(&mut self, extent: &Extent) {
        assert!(self.count < MOST_CASTERS, "more than {MOST_CASTERS} casters");
        self.have_edges = false;
        let block = self.count / BLOCK;
        for (field, end) in self.blocks.ends().into_iter().zip(extent.ends()) {
            // The bounds of a block without objects are NaN, which `max` ignores.
            field[block] = end.max(f32::from_bits(field[block])).to_bits();
        }
    }

    /// The block that the next object goes to. If it is new, it is filled with the identifying
    /// number `own`.
    #[inline(always)]
    fn last_block(&mut self, own: u32) -> &mut CasterBounds {
        let block = self.count / BLOCK;
        if self.count.is_multiple_of(BLOCK) {
            if self.bounds.len() == block {
                self.bounds.push(NO_BLOCKS);
            }
            (self.bounds[block].x, self.bounds[block].own) = ([NOWHERE; BLOCK], [own; BLOCK]);
        }
        &mut self.bounds[block]
    }

    /// Removes all objects.
    pub fn clear(&mut self) {
        (self.count, self.have_edges, self.blocks) = (0, false, NO_BLOCKS);
    }

    /// The objects that some group [meets](Meet), in order.
    pub fn each_met(&self) -> impl Iterator<Item = MetCaster> {
        let mut are_met = [0u64; MOST_CASTERS / 64];
        for met in &self.met[..self.met_count] {
            are_met[number(*met) / 64] |= 1 << (number(*met) % 64);
        }
        let numbers = are_met.into_iter().enumerate().flat_map(|(word, mut bits)| {
            std::iter::from_fn(move || {
                let lowest = bits.trailing_zeros() as usize;
                bits &= bits.wrapping_sub(1);
                (lowest < 64).then_some(64 * word + lowest)
            })
        });
        numbers.map(|number| {
            let place = self.bounds[number / BLOCK].own[number % BLOCK] - own_bits(0);
            MetCaster { number, place }
        })
    }

    /// The groups that meet objects, each with its pairs.
    pub(super) fn met(&self) -> impl Iterator<Item = MetByGroup<'_>> {
        let group = |met: u32| met as usize / MOST_CASTERS;
        let by_group = self.met[..self.met_count].chunk_by(move |a, b| group(*a) == group(*b));
        by_group.map(move |met| MetByGroup { group: group(met[0]), met })
    }

    fn block_count(&self) -> usize {
        self.count.div_ceil(BLOCK)
    }

    /// The blocks that have objects.
    pub(super) fn blocks(&mut self) -> impl Iterator<Item = CasterBlock<'_>> {
        let count = self.block_count();
        let blocks = self.bounds.iter_mut().zip(&mut self.edges).take(count);
        blocks.map(|(bounds, edges)| CasterBlock { bounds, edges })
    }

    /// Lists the pairs of a group in `asking` and an object whose bounds meet the group's and for
    /// which `is_kept` holds. That is called with the group, the object's block of bounds and of
    /// edges, and the object's index in the block.
    pub(super) fn set_met(
        &mut self,
        groups: &LitGroups,
        asking: Range<usize>,
        is_kept: impl Fn(usize, &CasterBounds, Option<&CasterEdges>, usize) -> bool,
    ) {
        let LitGroups { x, y, past_x, past_y, depth, own, open } = groups;
        for group in asking.filter(|group| open[*group] != 0) {
            let ends = [x, y, past_x, past_y, depth].map(|field| f32::from_bits(field[group]));
            let meets = |CasterBounds { x, y, past_x, past_y, depth, own: owns }: &CasterBounds, at: usize| {
                let fields = [x, y, past_x, past_y, depth].map(|field| f32::from_bits(field[at]));
                ends.into_iter().zip(fields).all(|(end, field)| end <= field) && own[group] != owns[at]
            };
            let blocks = (0..self.block_count()).filter(|block| meets(&self.blocks, *block));
            for at in blocks.flat_map(|block| block * BLOCK..(block + 1) * BLOCK) {
                let (bounds, i) = (&self.bounds[at / BLOCK], at % BLOCK);
                let edges = self.have_edges.then(|| &self.edges[at / BLOCK]);
                if meets(bounds, i) && is_kept(group, bounds, edges, i) {
                    self.met[self.met_count] = (group * MOST_CASTERS + at) as u32;
                    self.met_count += 1;
                }
            }
        }
    }
}
