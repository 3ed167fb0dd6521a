//! Clocks, statistics, counted instructions, the machine, descriptions of crashes, and the
//! comparison of pictures.

use std::borrow::Cow;

pub mod compare;
mod core_clock;
pub mod crash;
pub mod instructions;
mod interleave;
mod machine;
pub mod source;
pub mod statistics;
mod watch;

pub use core_clock::{core_cycles, core_cycles_per_tick};
pub use interleave::{Clock, MachineClock, OFF_BY_MAD, Runs, Scripted, Work, enough, interleave};
pub use machine::{Machine, cpu_name, set_commit};
pub use watch::ThreadWatch;

/// A name in a document: one of the program's own, or one that was read.
pub type Name = Cow<'static, str>;
