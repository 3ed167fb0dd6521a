//! The scalar meaning of every operation and intersection, over plain values.
//!
//! [`geometry`] is the truth in f64 that every engine is held against; [`aos`] is the twin of the paper's macros, the
//! same operations in the same order, and [`paper_c`] that of the paper's C.

pub mod aos;
pub mod geometry;
pub mod paper_c;
mod real;

pub use real::Real;
