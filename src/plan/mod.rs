//! What a scene becomes before the first ray: the packed arrays that kernels read.

mod packed;
mod spans;

pub use packed::Packed;
pub use spans::{RowSpan, ShortForm, Spans, UseRecord};
