//! The scalar meaning of every operation and intersection, over plain values.
//!
//! [`geometry`] is the truth in f64 that every engine is held against, and `shapes` the one that it is held against itself, in
//! the 1024 bits of `exact`, or in the fewer ones of `bounded` where these are sure, as `shadows` is of shadows; [`aos`] is the
//! twin of the paper's macros, the same operations in the same order. The twins of packet kernels are kernels themselves.

pub mod aos;
#[cfg(feature = "lab")]
pub mod bounded;
#[cfg(feature = "lab")]
pub mod exact;
pub mod geometry;
#[cfg(feature = "lab")]
pub mod number;
#[cfg(feature = "lab")]
pub mod shadows;
#[cfg(feature = "lab")]
pub mod shapes;
