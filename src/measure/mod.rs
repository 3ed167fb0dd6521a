//! Measuring: cycles and statistics, and pictures compared.

pub mod compare;
mod cycles;
mod interleave;
mod machine;
pub mod picture;
pub mod statistics;

pub use cycles::{Cycles, tsc_hz};
#[cfg(test)]
pub(crate) use interleave::Scripted;
pub use interleave::{Clock, OFF_BY_MAD, Runs, Totalled, TscClock, Work, interleave};
pub use machine::{Cache, Machine, cpu_name, tsc_invariant};
