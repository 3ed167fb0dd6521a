//! The scalar meaning of every operation and intersection, over plain values.
//!
//! [`geometry`] is the truth in f64 that every engine is held against, and [`exact`] the one in 256 bits that it is held
//! against itself, with [`bounded`] for what fewer bits are sure of; [`aos`] is the twin of the paper's macros, the same
//! operations in the same order, [`paper_c`] that of the paper's C, [`packet`] that of the packet macros, and [`tile`] that
//! of the tile macros.

pub mod aos;
#[cfg(feature = "lab")]
pub mod bounded;
#[cfg(feature = "lab")]
pub mod exact;
pub mod geometry;
pub mod packet;
pub mod paper_c;
mod real;
pub mod tile;

pub use real::Real;
