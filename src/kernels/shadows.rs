//! The arguments of the kernels of shadows: the visible points of a tile, and the objects that may hide a light from them.

use super::kernel::{Way, function, kinds, reads, writes};
use super::records::{
    CHUNK, CastersTask, Element, PointObject, PointView, SphereCaster, TilePoint, TilePoints, TriangleCaster,
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
    Casters<C: Caster> as fn(&LitPoints<'_>, &[C], &[[f32; 4]], u32) -> u32;

    /// Those of the `open` points, a bit for each, that none of the objects hides from the light: at most [`CHUNK`], whose
    /// bounds are their least x and y as the light sees them, and their greatest, negated.
    ///
    /// # Panics
    /// If there are more objects, or not as many bounds; or not as many points.
    fn call(points: &LitPoints<'_>, casters: &[C], bounds: &[[f32; 4]], open: u32) -> u32; |way| {
        let LitPoints { points: all, first, light, seen } = points;
        assert!(*first <= TILE_PIXELS - GROUP, "points of a tile");
        assert!(casters.len() == bounds.len() && casters.len() <= CHUNK, "a chunk of objects with their bounds");
        if casters.is_empty() || open == 0 {
            return open;
        }
        match way {
            Way::Code(enter) => {
                let task = CastersTask {
                    // In the whole record, of which the kernel reads other fields too.
                    points: reads(*all) + (first * size_of::<f64>()) as u64,
                    light: reads(*light),
                    seen: reads(seen),
                    casters: reads(casters),
                    bounds: reads(bounds),
                    count: casters.len() as u64,
                    open: open.into(),
                };
                enter([reads(&task), 0, 0, 0, 0, 0]) as u32
            }
            Way::Rust(ask) => ask(points, casters, bounds, open),
        }
    }
}

/// Points of a tile under a light.
pub struct LitPoints<'a> {
    pub points: &'a TilePoints<f64>,
    /// The first of [`GROUP`] in blocks.
    pub first: usize,
    /// The light: x, y, z and the sum of their magnitudes.
    pub light: &'a TilePoint<f64>,
    /// The greatest x and y of the points as the light sees them, and the least, negated.
    pub seen: [f32; 4],
}
