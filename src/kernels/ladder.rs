//! The rungs of the ladder that are variants of the paper's code and of the packets' closed form,
//! for the experiment alone.

use std::ops::Range;

use super::ffi::{ElementKernels, LitBodies, PACKETS};
use super::isa::{Isa, psabi_level};
use super::kernel::kernel;
use super::packet::{Rgba8, ShadeRows};
use super::paper::Trace;
use super::portable;
use super::records::{LitRows, LitSphere};
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

/// A variant of a tracer, or of the kernels that one calls.
/// ```no_run
/// rayo::internals::kernels::ladder::C[0].usable();
/// ```
/// A tracer's kernel is private, since it does not check that it has room for the objects:
/// ```compile_fail,E0624
/// rayo::internals::kernels::ladder::C[0].kernel();
/// ```
#[derive(Clone, Copy)]
pub struct Rung<K = Trace> {
    /// Its name in build.rs.
    pub name: &'static str,
    /// The level it was compiled for.
    pub flags: &'static str,
    level: Level,
    kernel: K,
}

impl<K> Rung<K> {
    /// Whether this CPU runs it.
    pub fn usable(&self) -> bool {
        self.level.usable()
    }

    /// What it is, if this CPU runs it.
    ///
    /// # Panics
    /// If it is not [`Rung::usable`].
    fn kernel(&self) -> &K {
        assert!(self.usable(), "this CPU does not run the rung `{}`", self.name);
        &self.kernel
    }
}

impl Rung<ElementKernels<f32>> {
    /// The kernels.
    ///
    /// # Panics
    /// If it is not [`Rung::usable`].
    pub fn kernels(&self) -> &ElementKernels<f32> {
        self.kernel()
    }
}

impl Rung {
    /// As [`Trace::call`].
    ///
    /// # Panics
    /// As [`Trace::call`]; if there are more than [`MOST`] objects of a kind; if it is not
    /// [`Rung::usable`].
    pub fn call(&self, frame: &Frame, objects: Objects<'_>, rows: Range<u32>, out: &mut [Vec4]) {
        assert!(objects.spheres.len().max(objects.triangles.len()) <= MOST, "a rung takes {MOST} objects of a kind");
        self.kernel().call(frame, objects, rows, out);
    }
}

macro_rules! rungs {
    (most $most:literal; $($name:literal, $level:ident, $flags:literal;)*) => {
        /// The most objects of a kind that a rung takes.
        pub const MOST: usize = $most;

        /// Every variant of the paper's C that this build has, in the order of the ladder; not each
        /// is [`Rung::usable`] everywhere.
        pub static C: &[Rung] = &[$(Rung {
            name: $name,
            flags: $flags,
            level: Level::$level,
            kernel: kernel!(rayo_c, concat!("rayo_ladder_", $name)),
        }),*];
    };
}

/// The packet kernels of a level, but for the grey bytes of a sphere's rows, which `kernel` makes.
const fn with_rows(level: Level, kernel: ShadeRows<f32, Rgba8>) -> ElementKernels<f32> {
    let isa = match level {
        Level::Base | Level::Sse41 => Isa::Sse41,
        Level::V3 => Isa::Avx2,
        Level::V4 => Isa::Avx512,
    };
    let kernels = PACKETS[isa as usize].single;
    ElementKernels { grey: LitBodies { rgba8: kernel, ..kernels.grey }, ..kernels }
}

macro_rules! closed {
    ($($name:literal, $level:ident, $flags:literal;)*) => {
        /// The closed form of one grey sphere in bytes, compiled: from C if this build has it, and
        /// from Rust.
        pub static CLOSED: &[Rung<ElementKernels<f32>>] = &[
            $(Rung {
                name: $name,
                flags: $flags,
                level: Level::$level,
                kernel: with_rows(Level::$level, kernel!(rayo_c, concat!("rayo_ladder_", $name))),
            },)*
            in_rust!("rust_sse41", Sse41, portable::grey_sse41),
            in_rust!("rust_v3", V3, portable::grey_v3),
            in_rust!("rust_v4", V4, portable::grey_v4),
        ];
    };
}

macro_rules! in_rust {
    ($name:literal, $level:ident, $rows:path) => {
        Rung {
            name: $name,
            flags: "",
            level: Level::$level,
            kernel: with_rows(
                Level::$level,
                ShadeRows::<f32, Rgba8>::in_rust(
                    // SAFETY: Rung::kernels() hands it out, and only where the CPU is of its level.
                    |sphere, rows, out, width| unsafe { $rows(sphere, rows, out, width) },
                    $name,
                ),
            ),
        }
    };
}

/// The address of the code from Rust among [`CLOSED`], for the level of an ISA.
pub fn rows_in_rust(isa: Isa) -> usize {
    type Rows = unsafe fn(&LitSphere<f32>, &LitRows<f32>, &mut [Rgba8], usize);
    let rows: [Rows; 3] = [portable::grey_sse41, portable::grey_v3, portable::grey_v4];
    rows[isa as usize] as usize
}

include!(concat!(env!("OUT_DIR"), "/rungs.rs"));

/// The paper's SIMD with calls in place of macros: the same instructions on the same registers, out
/// of line.
pub static PAPER_CALLS: Rung =
    Rung { name: "paper_calls", flags: "AOS_CALLS 1", level: Level::Sse41, kernel: kernel!("rayo_calls_trace") };
