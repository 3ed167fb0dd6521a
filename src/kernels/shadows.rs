//! The arguments of the kernels of shadows: the visible points of a tile, and the objects that may hide a light from them.

use std::ops::Range;

use super::kernel::{Way, function, kinds, reads, writes};
use super::records::{
    CasterBounds, CastersTask, Element, GROUP, LightSideView, LitGroups, MOST_CASTERS, PointObject, PointView,
    SphereCaster, TilePoints, TriangleCaster,
};
use super::tiles::{TILE_PIXELS, TileBuffers};
use super::types::Plain;

/// An object that may hide a light.
pub trait Caster: Plain {}

impl Caster for TriangleCaster<f64> {}
impl Caster for SphereCaster<f64> {}

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
        let axes = [&points.x, &points.y, &points.z];
        let axes = [1, 2, 0].map(|next| axes[(axis + next) % 3]);
        match way {
            Way::Code(enter) => {
                let [across, down, depth] = axes.map(|axis| reads(axis));
                enter([reads(view), across, down, depth, writes(groups), 0]);
            }
            Way::Rust(see) => see(view, axes, groups),
        }
    }

    /// Finds the points that some objects hide from a light.
    Casters<C: Caster> as fn(&LitPoints<'_>, &CasterList<C>, &mut LitGroups, Range<usize>);

    /// Of the open points of these groups closes those that one of the objects hides from the light.
    ///
    /// # Panics
    /// If there are not as many groups.
    fn call(points: &LitPoints<'_>, casters: &CasterList<C>, groups: &mut LitGroups, of: Range<usize>); |way| {
        assert!(of.end <= TILE_PIXELS / GROUP, "groups of a tile");
        if casters.casters.is_empty() || of.is_empty() {
            return;
        }
        match way {
            Way::Code(enter) => {
                let bounds = casters.bounds.as_ptr_range();
                let task = CastersTask {
                    points: reads(points.points),
                    groups: writes(groups),
                    first: of.start as u64,
                    end: of.end as u64,
                    light: reads(points.light),
                    casters: reads(&*casters.casters),
                    bounds: bounds.start as u64,
                    bounds_end: bounds.end as u64,
                };
                enter([reads(&task), 0, 0, 0, 0, 0]);
            }
            Way::Rust(ask) => ask(points, casters, groups, of),
        }
    }
}

/// Points of a tile under a light.
#[derive(Clone, Copy)]
pub struct LitPoints<'a> {
    pub points: &'a TilePoints<f64>,
    pub light: &'a [f64; 3],
}

/// The bounds of an object as a light sees it.
#[derive(Clone, Copy)]
pub struct Extent {
    /// The least x and y, in cells.
    pub low: [f32; 2],
    pub high: [f32; 2],
    pub depth: f32,
    /// The object's place in the scene.
    pub own: u32,
}

/// The place of an object in a scene, as the bits of an f32 that is unlike those of other places, above 0 and finite.
pub fn own_bits(place: u32) -> u32 {
    place + f32::MIN_POSITIVE.to_bits()
}

/// Objects that may hide a light: at most [`MOST_CASTERS`].
pub struct CasterList<C> {
    casters: Vec<C>,
    bounds: Vec<CasterBounds>,
}

impl<C> Default for CasterList<C> {
    fn default() -> Self {
        CasterList { casters: Vec::new(), bounds: Vec::new() }
    }
}

impl<C> CasterList<C> {
    /// Adds one.
    ///
    /// # Panics
    /// If it is full.
    #[inline(always)]
    pub fn push(&mut self, caster: C, Extent { low, high, depth, own }: &Extent) {
        // Beyond the last one: no number meets others.
        const NOWHERE: [u32; 16] = [f32::NAN.to_bits(); 16];
        assert!(self.casters.len() < MOST_CASTERS);
        let at = self.casters.len() % 16;
        if at == 0 {
            self.bounds.push(CasterBounds { x: NOWHERE, ..CasterBounds::ZERO });
        }
        let last = self.bounds.len() - 1;
        let bounds = &mut self.bounds[last];
        (bounds.x[at], bounds.y[at]) = ((-low[0]).to_bits(), (-low[1]).to_bits());
        (bounds.past_x[at], bounds.past_y[at]) = (high[0].to_bits(), high[1].to_bits());
        (bounds.depth[at], bounds.own[at]) = ((-depth).to_bits(), own_bits(*own));
        self.casters.push(caster);
    }

    pub fn clear(&mut self) {
        self.casters.clear();
        self.bounds.clear();
    }

    /// Those that may hide a light from points of a group.
    pub(super) fn meeting(&self, groups: &LitGroups, group: usize) -> impl Iterator<Item = &C> {
        let LitGroups { x, y, past_x, past_y, depth, own, .. } = groups;
        let ends = [x, y, past_x, past_y, depth].map(|field| f32::from_bits(field[group]));
        let own = own[group];
        let meets = move |at: usize| {
            let CasterBounds { x, y, past_x, past_y, depth, own: owns } = &self.bounds[at / 16];
            let fields = [x, y, past_x, past_y, depth].map(|field| f32::from_bits(field[at % 16]));
            ends.into_iter().zip(fields).all(|(end, field)| end <= field) && own != owns[at % 16]
        };
        self.casters.iter().enumerate().filter(move |(at, _)| meets(*at)).map(|(_, caster)| caster)
    }
}
