//! What a scene becomes before the first ray: the packed arrays that kernels read, and what is left out of them.

mod hits;
mod light;
mod omission;
mod packed;
mod report;
mod spans;
#[cfg(rayo_asm)]
mod tile_report;
#[cfg(rayo_asm)]
mod tiles;

pub use hits::{InUnits, sphere_hit, triangle_hit};
pub use omission::{Keep, Omission, Switch};
pub use packed::Packed;
pub use report::{ByTiles, Kept, LeftOut, Report, grouped};
pub use spans::{RowSpan, RowSpans, Scale, Shading, ShortForm, Spans, UseRecord, Way};
#[cfg(rayo_asm)]
pub use tile_report::TileSurvey;
#[cfg(rayo_asm)]
pub use tiles::{TilePlace, Tiles, Weighted, tiles_pay};
