//! The scalar meaning of every operation and intersection, over plain values.
//!
//! [`geometry`] is the truth in f64 that every engine is held against; [`aos`] is the twin of the paper's macros, the
//! same operations in the same order.

pub mod aos;
pub mod geometry;
mod real;

pub use real::Real;
