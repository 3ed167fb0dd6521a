//! What a scene becomes before the first ray: the packed arrays that kernels read.

mod hits;
mod packed;
mod spans;

pub use hits::{sphere_hit, triangle_hit};
pub use packed::Packed;
pub use spans::{RowSpan, Spans, UseRecord};
