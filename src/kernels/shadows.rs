//! The arguments of the kernels of shadows: the visible points of a tile, and the objects that may hide a light from them.

use super::kernel::{Way, function, kinds, reads, writes};
use super::objects::{ObjectList as _, TriangleList};
use super::records::{
    CastTask, CasterBounds, CastersTask, Element, LightSideView, LitGroups, MOST_CASTERS, PointObject, PointView,
    SphereCasters, TilePoints, TriangleArrays, TriangleCasters,
};
use super::tiles::{TILE_PIXELS, TileBuffers};
use super::types::Plain;

/// A block of objects that may hide a light.
pub trait Caster: Plain {
    /// Their places in the scene.
    fn own(&mut self) -> &mut [f64; BLOCK];
}

impl Caster for TriangleCasters<f64> {
    fn own(&mut self) -> &mut [f64; BLOCK] {
        &mut self.own
    }
}

impl Caster for SphereCasters<f64> {
    fn own(&mut self) -> &mut [f64; BLOCK] {
        &mut self.own
    }
}

/// The objects of a block.
pub(super) const BLOCK: usize = 16;

kinds! {
    /// Computes what is visible at the pixels of a tile.
    Points<E: Element> as fn(&PointView<f64>, &[E; TILE_PIXELS], [u32; 2], &[PointObject<f64>], &mut TilePoints<f64>);

    /// Sets the points of a tile, whose first pixel is in this column and row of the picture. `objects` has those of the tile
    /// by their ids, from 0 on.
    ///
    /// # Panics
    /// If it has not all.
    fn call(
        view: &PointView<f64>, buffers: &TileBuffers<E>, first: [u32; 2], objects: &[PointObject<f64>],
        points: &mut TilePoints<f64>,
    ); |way| {
        let who = buffers.who(objects.len());
        let [column, row] = first;
        match way {
            Way::Code(enter) => {
                let (objects, points) = (reads(objects), writes(points));
                enter([reads(view), reads(who), column.into(), row.into(), objects, points]);
            }
            Way::Rust(find) => find(view, who, first, objects, points),
        }
    }

    /// Finds how a light sees the points of a tile.
    Seen as fn(&LightSideView<f64>, [&[f64; TILE_PIXELS]; 3], &mut LitGroups);

    /// Sets the bounds of the groups that are open; `axis` says which coordinate is the depth, 0 to 2.
    fn call(view: &LightSideView<f64>, points: &TilePoints<f64>, axis: usize, groups: &mut LitGroups); |way| {
        // Fields of the record, which is aligned.
        let axes = axes(axis).map(|axis| [&points.x, &points.y, &points.z][axis]);
        match way {
            Way::Code(enter) => {
                let [across, down, depth] = axes.map(|axis| reads(axis));
                enter([reads(view), across, down, depth, writes(groups), 0]);
            }
            Way::Rust(see) => see(view, axes, groups),
        }
    }

    /// Computes how a light sees triangles.
    Cast as fn(&LightSideView<f64>, [usize; 3], TriangleList<'_>, u32, &mut CasterList<TriangleCasters<f64>>);

    /// Sets the planes and the bounds of triangles that are in a list by their places in the scene, where those of
    /// `triangles` begin with `first`; `axis` says which coordinate is the depth, 0 to 2. None of those is visible whose bound
    /// is no number: they are to be [set alone](CasterList::set_planes).
    ///
    /// # Panics
    /// If one is not among `triangles`.
    fn call(
        view: &LightSideView<f64>, axis: usize, triangles: TriangleList<'_>, first: u32, arrays: &mut TriangleArrays,
        casters: &mut CasterList<TriangleCasters<f64>>,
    ); |way| {
        let (axes, places) = (axes(axis), own_bits(first)..own_bits(first + triangles.len() as u32));
        assert!(casters.bounds.iter().flat_map(|bounds| &bounds.own).all(|own| places.contains(own)), "triangles of a list");
        if casters.count == 0 {
            return;
        }
        match way {
            Way::Code(enter) => {
                let [objects, vertices] = triangles.addresses();
                let bounds = casters.bounds.as_mut_ptr_range();
                let task = CastTask {
                    objects,
                    vertices,
                    first_own: places.start.into(),
                    arrays: writes(arrays),
                    casters: writes(&mut *casters.casters),
                    bounds: bounds.start as u64,
                    bounds_end: bounds.end as u64,
                    across: axes[0] as u64,
                    down: axes[1] as u64,
                    depth: axes[2] as u64,
                };
                enter([reads(view), reads(&task), 0, 0, 0, 0]);
            }
            Way::Rust(cast) => cast(view, axes, triangles, first, casters),
        }
        // The last block is filled up with its first one.
        let last = casters.bounds.len() - 1;
        casters.bounds[last].x[(casters.count - 1) % BLOCK + 1..].fill(NOWHERE);
    }

    /// Finds the points that some objects hide from a light.
    Casters<C: Caster> as fn(&LitPoints<'_>, &CasterList<C>, &mut LitGroups);

    /// Of the open points closes those that one of the objects hides from the light.
    fn call(points: &LitPoints<'_>, casters: &CasterList<C>, groups: &mut LitGroups); |way| {
        if casters.count == 0 {
            return;
        }
        match way {
            Way::Code(enter) => {
                let task = CastersTask {
                    points: reads(points.points),
                    groups: writes(groups),
                    light: reads(points.light),
                    casters: reads(&*casters.casters),
                    bounds: reads(&*casters.bounds),
                    blocks: reads(&casters.blocks),
                    block_count: casters.bounds.len() as u64,
                };
                enter([reads(&task), 0, 0, 0, 0, 0]);
            }
            Way::Rust(ask) => ask(points, casters, groups),
        }
    }
}

/// Points of a tile under a light.
#[derive(Clone, Copy)]
pub struct LitPoints<'a> {
    pub points: &'a TilePoints<f64>,
    pub light: &'a [f64; 3],
}

/// The greatest distance of an edge's ends beside the least one, from which the rounding of its middle matters near the latter.
pub const FAR_BESIDE_NEAR: f64 = 1024.0;

/// The axes of a side of a light's cube that looks along one of them: across, down and depth.
pub fn axes(axis: usize) -> [usize; 3] {
    [1, 2, 0].map(|next| (axis + next) % 3)
}

/// The bounds of an object, or of some that are next to each other in the scene, as a light sees them.
#[derive(Clone, Copy)]
pub struct Extent {
    /// The least x and y, in cells.
    pub low: [f32; 2],
    pub high: [f32; 2],
    pub depth: f32,
    /// The first object's place in the scene.
    pub first: u32,
    /// How many there are.
    pub count: u32,
}

/// The place of an object in a scene, as the bits of an f32 that is unlike those of other places, above 0 and finite.
pub fn own_bits(place: u32) -> u32 {
    place + f32::MIN_POSITIVE.to_bits()
}

/// Objects that may hide a light, in blocks: at most [`MOST_CASTERS`].
#[derive(Debug)]
pub struct CasterList<C> {
    count: usize,
    /// There may be more, with anything in them.
    casters: Vec<C>,
    bounds: Vec<CasterBounds>,
    /// Of blocks.
    blocks: CasterBounds,
}

/// The bits of a coordinate that meets no other.
const NOWHERE: u32 = f32::NAN.to_bits();

/// No block.
const NO_BLOCKS: CasterBounds = CasterBounds {
    x: [NOWHERE; BLOCK],
    y: [NOWHERE; BLOCK],
    past_x: [NOWHERE; BLOCK],
    past_y: [NOWHERE; BLOCK],
    depth: [NOWHERE; BLOCK],
    own: [NOWHERE; BLOCK],
};

impl CasterBounds {
    /// Its fields that are compared, those of `Ends`.
    fn ends(&mut self) -> [&mut [u32; BLOCK]; 5] {
        let CasterBounds { x, y, past_x, past_y, depth, .. } = self;
        [x, y, past_x, past_y, depth]
    }
}

impl<C: Caster> Default for CasterList<C> {
    fn default() -> Self {
        CasterList { count: 0, casters: Vec::new(), bounds: Vec::new(), blocks: NO_BLOCKS }
    }
}

impl<C: Caster> CasterList<C> {
    /// Adds the objects of an extent, which become the bounds of one alone: those of several are left to [`Cast`].
    ///
    /// # Panics
    /// If there is no room.
    pub fn push(&mut self, Extent { low, high, depth, first, count }: &Extent) {
        assert!(self.count + *count as usize <= MOST_CASTERS, "{count} casters more than {}", self.count);
        let ends = [-low[0], -low[1], high[0], high[1], -depth];
        for place in *first..first + count {
            let (block, at) = (self.count / BLOCK, self.count % BLOCK);
            if at == 0 {
                self.bounds.push(CasterBounds { own: [own_bits(place); BLOCK], ..NO_BLOCKS });
                if self.casters.len() == block {
                    self.casters.push(C::ZERO);
                }
            }
            if at == 0 || place == *first {
                for (field, end) in self.blocks.ends().into_iter().zip(ends) {
                    field[block] = end.max(f32::from_bits(field[block])).to_bits();
                }
            }
            let bounds = &mut self.bounds[block];
            if *count == 1 {
                bounds.ends().into_iter().zip(ends).for_each(|(field, end)| field[at] = end.to_bits());
            }
            bounds.own[at] = own_bits(place);
            self.casters[block].own()[at] = place.into();
            self.count += 1;
        }
    }

    /// The block of the last one, and where in it that is.
    pub fn last_mut(&mut self) -> Option<(&mut C, usize)> {
        let last = self.count.checked_sub(1)?;
        Some((&mut self.casters[last / BLOCK], last % BLOCK))
    }

    pub fn clear(&mut self) {
        self.count = 0;
        self.bounds.clear();
        self.blocks = NO_BLOCKS;
    }

    /// Those that may hide a light from points of a group: blocks, and where in these.
    pub(super) fn meeting(&self, groups: &LitGroups, group: usize) -> impl Iterator<Item = (&C, usize)> {
        let LitGroups { x, y, past_x, past_y, depth, own, .. } = groups;
        let ends = [x, y, past_x, past_y, depth].map(|field| f32::from_bits(field[group]));
        let own = own[group];
        let meets = move |CasterBounds { x, y, past_x, past_y, depth, own: owns }: &CasterBounds, at: usize| {
            let fields = [x, y, past_x, past_y, depth].map(|field| f32::from_bits(field[at]));
            ends.into_iter().zip(fields).all(|(end, field)| end <= field) && own != owns[at]
        };
        let blocks = self.bounds.iter().zip(&self.casters).enumerate();
        blocks.filter(move |(block, _)| meets(&self.blocks, *block)).flat_map(move |(_, (bounds, casters))| {
            (0..BLOCK).filter(move |at| meets(bounds, *at)).map(move |at| (casters, at))
        })
    }
}

impl CasterList<TriangleCasters<f64>> {
    /// Which of them are in doubt: their numbers, and their places in the scene.
    pub fn doubtful(&self) -> Vec<(usize, u32)> {
        let of = |at: usize| (&self.casters[at / BLOCK], at % BLOCK);
        let doubtful = (0..self.count).map(|at| (at, of(at))).filter(|(_, (of, at))| of.bound[*at].is_nan());
        doubtful.map(|(at, (of, i))| (at, of.own[i] as u32)).collect()
    }

    /// Blocks, and their bounds.
    pub(super) fn blocks(&mut self) -> impl Iterator<Item = (&mut TriangleCasters<f64>, &mut CasterBounds)> {
        self.casters.iter_mut().zip(&mut self.bounds)
    }
}
