//! What a scene becomes before the first ray: the packed arrays that kernels read, and what is left out of them.

mod hits;
mod light;
mod omission;
mod packed;
mod report;
mod spans;
mod team;
mod tile_report;
mod tiles;

pub use hits::{InUnits, sphere_hit, triangle_hit};
pub use omission::{Keep, Omission, Switch};
pub use packed::Packed;
pub use report::{ByTiles, Kept, LeftOut, Report, grouped};
pub use spans::{RowSpan, RowSpans, Scale, Shading, ShortForm, Spans, UseRecord, Way};
pub use team::{Team, on_all_cores};
pub use tile_report::TileSurvey;
pub use tiles::{LargeObjects, TilePlace, Tiles, Weighted, tiles_pay};

use crate::scene::{Camera, Grid};

/// The camera's rays, and by what power of two they are longer: those of about length 1 keep their squares within the range of
/// f32, and the factor is exact.
fn unit_rays(camera: &Camera) -> (Grid<f64>, f64) {
    let grid = camera.grid::<f64>();
    let unit = 1.0 / power_of_two(grid.focal.max(grid.half_width).max(grid.half_height));
    (grid.scaled(unit), unit)
}

/// The largest power of two that is at most `x`, which is positive and finite.
fn power_of_two(x: f64) -> f64 {
    f64::from_bits(x.to_bits() & f64::INFINITY.to_bits())
}
