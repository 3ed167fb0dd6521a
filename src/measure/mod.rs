//! Measuring: cycles and statistics, and the comparison of pictures.

use std::borrow::Cow;

#[cfg(feature = "files")]
pub mod compare;
#[cfg(feature = "lab")]
mod core_clock;
mod cycles;
#[cfg(feature = "lab")]
pub mod instructions;
#[cfg(feature = "lab")]
mod interleave;
mod machine;
#[cfg(feature = "files")]
pub mod picture;
#[cfg(feature = "lab")]
pub mod source;
#[cfg(feature = "lab")]
pub mod statistics;
#[cfg(feature = "lab")]
mod watch;

#[cfg(feature = "lab")]
pub use core_clock::{core_cycles, core_cycles_per_tick};
pub use cycles::{Cycles, tsc_hz};
#[cfg(all(test, feature = "lab"))]
pub(crate) use interleave::Scripted;
#[cfg(feature = "lab")]
pub use interleave::{Clock, MachineClock, OFF_BY_MAD, Runs, Work, enough, interleave};
pub use machine::{Cache, Machine, caches, cpu_name, set_commit};
#[cfg(feature = "lab")]
pub use watch::Watch;

/// A name in a document: one that the program has, or that it read.
pub type Name = Cow<'static, str>;
