//! What a scene becomes before the first ray: the packed arrays that kernels read.

mod packed;

pub use packed::Packed;
