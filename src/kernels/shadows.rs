//! The arguments of the kernels of shadows: the visible points of a tile, and the objects that may hide a light from them.

use super::kernel::{Way, function, kinds, reads, writes};
use super::records::{
    CasterBounds, CastersTask, Element, PointObject, PointView, SphereCaster, TilePoints, TriangleCaster,
};
use super::tiles::{TILE_PIXELS, TileBuffers};
use super::types::Plain;

/// The number of points that are asked for together.
pub const GROUP: usize = 16;

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

    /// Finds the points that some objects hide from a light.
    Casters<C: Caster> as fn(&LitPoints<'_>, &CasterList<C>, u32) -> u32;

    /// Those of the `open` points, a bit for each, that none of the objects hides from the light.
    ///
    /// # Panics
    /// If there are not as many points.
    fn call(points: &LitPoints<'_>, casters: &CasterList<C>, open: u32) -> u32; |way| {
        let LitPoints { points: all, first, light, seen } = points;
        assert!(*first <= TILE_PIXELS - GROUP, "points of a tile");
        if casters.casters.is_empty() || open == 0 {
            return open;
        }
        match way {
            Way::Code(enter) => {
                // There are bounds for as many as there can be.
                let task = CastersTask {
                    // In the whole record, of which the kernel reads other fields too.
                    points: reads(*all) + (first * size_of::<f64>()) as u64,
                    light: reads(*light),
                    seen: reads(seen),
                    casters: reads(&*casters.casters),
                    bounds: reads(&casters.bounds),
                    count: casters.casters.len() as u64,
                    open: open.into(),
                };
                enter([reads(&task), 0, 0, 0, 0, 0]) as u32
            }
            Way::Rust(ask) => ask(points, casters, open),
        }
    }
}

/// Points of a tile under a light.
pub struct LitPoints<'a> {
    pub points: &'a TilePoints<f64>,
    /// The first of [`GROUP`] in blocks.
    pub first: usize,
    pub light: &'a [f64; 3],
    /// The greatest x and y of the points as the light sees them, and the least, negated.
    pub seen: [f32; 4],
}

/// Objects that may hide a light: at most [`GROUP`].
pub struct CasterList<C> {
    casters: Vec<C>,
    bounds: CasterBounds,
}

impl<C> Default for CasterList<C> {
    fn default() -> Self {
        CasterList { casters: Vec::new(), bounds: CasterBounds::ZERO }
    }
}

impl<C> CasterList<C> {
    /// Adds one with its bounds as the light sees it: the least x and y, and the greatest, negated.
    ///
    /// # Panics
    /// If there are as many already.
    pub fn push(&mut self, caster: C, bounds: [f32; 4]) {
        let CasterBounds { x, y, past_x, past_y } = &mut self.bounds;
        let at = self.casters.len();
        [x[at], y[at], past_x[at], past_y[at]] = bounds.map(f32::to_bits);
        self.casters.push(caster);
    }

    pub fn clear(&mut self) {
        self.casters.clear();
    }

    /// All, with whether their bounds meet those of points.
    pub(super) fn meeting(&self, seen: [f32; 4]) -> impl Iterator<Item = &C> {
        let CasterBounds { x, y, past_x, past_y } = &self.bounds;
        let meets = move |at: usize| {
            [x, y, past_x, past_y].into_iter().zip(seen).all(|(bounds, seen)| f32::from_bits(bounds[at]) <= seen)
        };
        self.casters.iter().enumerate().filter(move |(at, _)| meets(*at)).map(|(_, caster)| caster)
    }
}
