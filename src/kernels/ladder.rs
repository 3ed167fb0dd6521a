//! The rungs of the ladder that are variants of the paper's C and of its SIMD, for the experiment alone.

use std::ops::Range;

use super::isa::{Isa, psabi_level};
use super::kernel::kernel;
use super::paper::Trace;
use super::types::{Frame, Objects, Vec4};

/// A level of x86-64 that a rung was compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(dead_code, reason = "build.rs says which rungs there are")]
enum Level {
    /// The level of every x86-64 CPU.
    Base,
    /// AVX2, FMA and the rest of their level.
    V3,
    /// AVX-512 with its F, BW, CD, DQ and VL.
    V4,
    /// The level of the paper's SIMD, and of packets of four.
    Sse41,
}

impl Level {
    fn usable(self) -> bool {
        match self {
            Level::Base => true,
            Level::V3 => psabi_level() >= 3,
            Level::V4 => psabi_level() >= 4,
            Level::Sse41 => Isa::Sse41.usable(),
        }
    }
}

/// A variant of a tracer.
#[derive(Clone, Copy)]
pub struct Rung {
    /// Its name in build.rs.
    pub name: &'static str,
    /// The level it was compiled for.
    pub flags: &'static str,
    level: Level,
    trace: Trace,
}

impl Rung {
    /// Whether this CPU runs it.
    pub fn usable(&self) -> bool {
        self.level.usable()
    }

    /// As [`Trace::call`].
    ///
    /// # Panics
    /// As [`Trace::call`]; if there are more than [`MOST`] objects of a kind; if it is not [`Rung::usable`].
    pub fn call(&self, frame: &Frame, objects: Objects<'_>, rows: Range<u32>, out: &mut [Vec4]) {
        assert!(self.usable(), "this CPU does not run the rung `{}`", self.name);
        assert!(objects.spheres.len().max(objects.triangles.len()) <= MOST, "a rung takes {MOST} objects of a kind");
        self.trace.call(frame, objects, rows, out);
    }
}

macro_rules! rungs {
    (most $most:literal; $($name:literal, $level:ident, $flags:literal;)*) => {
        /// The most objects of a kind that a rung takes.
        pub const MOST: usize = $most;

        /// Every variant of the paper's C that this build has, in the order of the ladder; not each is [`Rung::usable`] everywhere.
        pub static C: &[Rung] = &[$(Rung {
            name: $name,
            flags: $flags,
            level: Level::$level,
            trace: kernel!(rayo_c, concat!("rayo_ladder_", $name)),
        }),*];
    };
}
include!(concat!(env!("OUT_DIR"), "/rungs.rs"));

/// The paper's SIMD with calls in place of macros: the same instructions on the same registers, out of line.
pub static PAPER_CALLS: Rung =
    Rung { name: "paper_calls", flags: "AOS_CALLS 1", level: Level::Sse41, trace: kernel!("rayo_calls_trace") };
