//! The scalar meaning of every operation and intersection, over plain values.
//!
//! [`geometry`] is the truth in f64 that every engine is held against; the lab holds it in turn
//! against exact arithmetic. [`aos`] is the twin of the paper's macros, the same operations in the
//! same order. The twins of packet kernels are kernels themselves.

pub mod aos;
pub mod geometry;
