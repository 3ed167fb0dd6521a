//! Measuring: cycles and statistics, and pictures compared.

pub mod compare;
#[cfg(rayo_asm)]
mod core_clock;
mod cycles;
#[cfg(rayo_asm)]
pub mod instructions;
pub mod picture;

#[cfg(rayo_asm)]
pub use core_clock::{core_cycles, core_cycles_per_tick};
pub use cycles::{Cycles, tsc_hz};
