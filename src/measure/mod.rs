//! Measuring: cycles and statistics, and pictures compared.

pub mod compare;
#[cfg(rayo_asm)]
mod core_clock;
mod cycles;
#[cfg(rayo_asm)]
pub mod instructions;
mod interleave;
mod machine;
pub mod picture;
pub mod statistics;
mod watch;

#[cfg(rayo_asm)]
pub use core_clock::{core_cycles, core_cycles_per_tick};
pub use cycles::{Cycles, tsc_hz};
pub use interleave::{Clock, OFF_BY_MAD, Runs, Totalled, TscClock, WallClock, Work, enough, interleave};
pub use machine::{Cache, Machine, caches, cpu_name, tsc_invariant};
pub use watch::Watch;
