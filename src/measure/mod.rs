//! Measuring: cycles and statistics, and pictures compared.

pub mod compare;
mod cycles;
pub mod picture;

pub use cycles::{Cycles, tsc_hz};
