//! From a scene to a plan: the packed arrays that kernels read, and what work is omitted.

mod cancel;
mod frustum;
mod light;
mod lit;
mod omission;
mod packed;
mod report;
mod shadows;
mod team;
mod tile_report;
mod tiles;

pub use cancel::Cancel;
pub use light::lights;
pub use lit::{LitForm, Scale};
pub use omission::{Keep, Omission, Switch};
pub use packed::Packed;
pub use report::{ByTiles, Kept, LeftOut, Report, with_digit_groups};
pub use shadows::{Casters, LightSide, Shadows, SideBounds, Window};
pub use team::{Halved, MAX_THREADS, Team, on_all_cores};
pub use tile_report::TileSurvey;
pub use tiles::bounds::BOX_MARGIN;
pub use tiles::forms::{INVERSE_ROUNDINGS, STEEPEST};
pub use tiles::{EDGE_ROUNDINGS, ExactPlane, LargeInRow, LargeObjects, TilePlace, Tiles, Weighted};

use crate::scene::Grid;

/// How to plan. Pictures do not depend on these options.
#[derive(Clone, Copy, Default)]
pub struct PlanOptions<'a> {
    /// The omissions that are switched off.
    pub keep: Keep,
    /// The number of threads that plan; 0 means 1.
    pub threads: usize,
    /// Stops planning if it is set. Planning then skips the rest, and its plan is incomplete and
    /// must not be used.
    pub cancel: Option<&'a Cancel>,
}

impl PlanOptions<'_> {
    /// Whether planning was stopped.
    fn is_cancelled(&self) -> bool {
        self.cancel.is_some_and(Cancel::is_cancelled)
    }
}

/// Moves the items that are kept to the front, in order, and returns their number. It does so
/// without a branch for each item, which the CPU would mispredict.
#[inline(always)]
pub fn compact<T: Copy>(items: &mut [T], mut is_kept: impl FnMut(&mut T) -> bool) -> usize {
    let mut count = 0;
    for i in 0..items.len() {
        let mut item = items[i];
        let keeps = is_kept(&mut item);
        items[count] = item;
        count += usize::from(keeps);
    }
    count
}

/// A grid of rays that is scaled by a power of two, `unit`.
struct UnitRays {
    grid: Grid<f64>,
    unit: f64,
}

/// Scales rays to a length of about 1, so that their squares are within the range of f32. The
/// factor is exact.
fn unit_rays(grid: Grid<f64>) -> UnitRays {
    let unit = 1.0 / power_of_two(grid.focal.max(grid.half_width).max(grid.half_height));
    UnitRays { grid: grid.scaled(unit), unit }
}

/// The largest power of two that is at most `x`, which is positive and finite.
fn power_of_two(x: f64) -> f64 {
    f64::from_bits(x.to_bits() & f64::INFINITY.to_bits())
}
