//! From a scene to a plan: the packed arrays that kernels read, and which work is omitted.

mod frustum;
#[cfg(feature = "lab")]
mod hits;
mod light;
mod lit;
mod omission;
mod packed;
mod report;
mod shadows;
mod team;
mod tile_report;
mod tiles;

#[cfg(feature = "lab")]
pub use hits::{InUnits, in_lanes, sphere_hit, triangle_hit};
pub use light::lights;
pub use lit::{LitForm, Scale};
pub use omission::{Keep, Omission, Switch};
pub use packed::Packed;
pub use report::{ByTiles, Kept, LeftOut, Report, grouped};
pub use shadows::{Casters, Ends, LightSide, Shadows};
pub use team::{MAX_THREADS, Team, on_all_cores};
pub use tile_report::TileSurvey;
pub use tiles::{ExactPlane, LargeInRow, LargeObjects, Raster, TilePlace, Tiles, Weighted};

use crate::scene::Grid;

/// A grid of rays scaled by a power of two, and that power: rays of about length 1 keep their squares within the range
/// of f32, and the factor is exact.
fn unit_rays(grid: Grid<f64>) -> (Grid<f64>, f64) {
    let unit = 1.0 / power_of_two(grid.focal.max(grid.half_width).max(grid.half_height));
    (grid.scaled(unit), unit)
}

/// The largest power of two that is at most `x`, which is positive and finite.
fn power_of_two(x: f64) -> f64 {
    f64::from_bits(x.to_bits() & f64::INFINITY.to_bits())
}
