//! What a scene becomes before the first ray: the packed arrays that kernels read.

mod packed;
mod spans;
#[cfg(rayo_asm)]
mod tiles;

pub use packed::Packed;
pub use spans::{RowSpan, Spans, UseRecord};
#[cfg(rayo_asm)]
pub use tiles::{TilePlace, Tiles, Weighted, tiles_pay};
