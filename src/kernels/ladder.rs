//! The rungs of the ladder that are variants of the paper's code and of the packets' closed form.
//! They serve the experiment alone.

use std::ops::Range;

use super::ffi::{ElementKernels, LitBodies, PACKETS};
use super::isa::{Isa, psabi_level};
use super::kernel::kernel;
use super::packet::{Rgba8, ShadeRows};
use super::paper::Trace;
use super::portable;
use super::records::{LitRows, LitSphere};
use super::types::{Frame, Objects, Vec4};

/// The level of x86-64 that a rung was compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(dead_code, reason = "build.rs says which rungs there are")]
enum Level {
    /// The level of every x86-64 CPU.
    Base,
    /// x86-64-v3: AVX2, FMA and others.
    V3,
    /// x86-64-v4: AVX-512 F, BW, CD, DQ and VL.
    V4,
    /// SSE4.1, which the paper's SIMD and packets of four need.
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

/// A variant of a tracer, or of the kernels that a tracer calls.
/// ```no_run
/// rayo::internals::kernels::ladder::C[0].usable();
/// ```
/// A tracer's kernel is private, since it does not check that it has room for the objects:
/// ```compile_fail,E0624
/// rayo::internals::kernels::ladder::C[0].kernel();
/// ```
#[derive(Clone, Copy)]
pub struct Rung<K = Trace> {
    /// The variant's name in build.rs.
    pub name: &'static str,
    /// The level it was compiled for.
    pub flags: &'static str,
    level: Level,
    kernel: K,
}

impl<K> Rung<K> {
    /// Whether this CPU runs the rung.
    pub fn usable(&self) -> bool {
        self.level.usable()
    }

    /// The kernel or kernels, if this CPU runs them.
    ///
    /// # Panics
    /// If the rung is not [`Rung::usable`].
    fn kernel(&self) -> &K {
        assert!(self.usable(), "this CPU does not run the rung `{}`", self.name);
        &self.kernel
    }
}

impl Rung<ElementKernels<f32>> {
    /// The kernels.
    ///
    /// # Panics
    /// If the rung is not [`Rung::usable`].
    pub fn kernels(&self) -> &ElementKernels<f32> {
        self.kernel()
    }
}

impl Rung {
    /// Calls the tracer as [`Trace::call`] does.
    ///
    /// # Panics
    /// As [`Trace::call`]; if there are more than [`MOST`] objects of a kind; if the rung is not
    /// [`Rung::usable`].
    pub fn call(&self, frame: &Frame, objects: Objects<'_>, rows: Range<u32>, out: &mut [Vec4]) {
        assert!(objects.spheres.len().max(objects.triangles.len()) <= MOST, "a rung takes {MOST} objects of a kind");
        self.kernel().call(frame, objects, rows, out);
    }
}

macro_rules! rungs {
    (most $most:literal; $($name:literal, $level:ident, $flags:literal;)*) => {
        /// How many objects of a kind a rung takes at most.
        pub const MOST: usize = $most;

        /// Every variant of the paper's C that this build has, in the order of the ladder. Not
        /// every CPU can run all of them; see [`Rung::usable`].
        pub static C: &[Rung] = &[$(Rung {
            name: $name,
            flags: $flags,
            level: Level::$level,
            kernel: kernel!(rayo_c, concat!("rayo_ladder_", $name)),
        }),*];
    };
}

/// The packet kernels of a level, in which `kernel` renders the grey bytes of a sphere's rows.
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
        /// Compiled versions of the closed form of one grey sphere, which write bytes: from C, if
        /// this build has it, and from Rust.
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
                    // SAFETY: only Rung::kernels() hands this out, and only if the CPU supports the
                    // level.
                    |sphere, rows, out, width| unsafe { $rows(sphere, rows, out, width) },
                    $name,
                ),
            ),
        }
    };
}

/// The address of the code in [`CLOSED`] that was compiled from Rust for an ISA.
pub fn rows_in_rust(isa: Isa) -> usize {
    type Rows = unsafe fn(&LitSphere<f32>, &LitRows<f32>, &mut [Rgba8], usize);
    let rows: [Rows; 3] = [portable::grey_sse41, portable::grey_v3, portable::grey_v4];
    rows[isa as usize] as usize
}

include!(concat!(env!("OUT_DIR"), "/rungs.rs"));

/// The paper's SIMD with calls instead of macros: the same instructions on the same registers, but
/// out of line.
pub static PAPER_CALLS: Rung =
    Rung { name: "paper_calls", flags: "AOS_CALLS 1", level: Level::Sse41, kernel: kernel!("rayo_calls_trace") };
