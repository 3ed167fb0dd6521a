//! What tests need to test kernels and their checks: kernels that break rules, functions to be
//! counted, copies of the process.

#[cfg(unix)]
use std::io;
#[cfg(unix)]
use std::panic::{self, AssertUnwindSafe};

use super::checked::{Fault, vector_bytes};
use super::floats::StandardFloats;
use super::kernel::{Kernel, kernel};
pub use super::kernel::{checked, faults, without_denormals};
use super::paper::Op;
pub use super::portable::{lanes, nearest, packets as portable_packets, rows, set_up, shade, shadows, spheres};
use super::types::Vec4;

/// A kernel without arguments that breaks one rule of the calling convention on purpose.
pub struct Broken {
    kernel: Kernel<()>,
    /// The one rule that it breaks.
    pub breaks: Fault,
}

impl Broken {
    /// Whether the CPU has the kernel's instructions: one such kernel needs AVX.
    pub fn usable(&self) -> bool {
        self.breaks != Fault::Upper || vector_bytes() > 16
    }

    /// The broken rules that a checked call finds.
    ///
    /// # Panics
    /// If the kernel is not [`usable`](Broken::usable).
    pub fn faults(&self) -> Vec<Fault> {
        assert!(self.usable());
        // SAFETY: the kernel has no arguments, and the checked call repairs what it breaks.
        faults(|| _ = unsafe { self.kernel.enter([0; 6]) })
    }
}

macro_rules! broken {
    ($($symbol:literal breaks $fault:ident;)*) => {
        /// A kernel for every [`Fault`].
        pub static BROKEN: &[Broken] = &[$(Broken { kernel: kernel!($symbol), breaks: Fault::$fault }),*];
    };
}

broken! {
    "rayo_broken_rbx" breaks Rbx;
    "rayo_broken_rbp" breaks Rbp;
    "rayo_broken_r12" breaks R12;
    "rayo_broken_r13" breaks R13;
    "rayo_broken_r14" breaks R14;
    "rayo_broken_r15" breaks R15;
    "rayo_broken_rsp" breaks Rsp;
    "rayo_broken_stack" breaks Stack;
    "rayo_broken_direction" breaks Direction;
    "rayo_broken_mxcsr" breaks Mxcsr;
    "rayo_broken_upper" breaks Upper;
}

macro_rules! broken_dots {
    ($($symbol:literal;)*) => {
        /// Kernels that should compute `dot`, each with a different mistake.
        pub static BROKEN_DOTS: &[Op<Vec4, Vec4, f32>] = &[$(kernel!($symbol)),*];
    };
}

broken_dots! {
    "rayo_broken_dot_wrong";
    "rayo_broken_dot_rbx";
    "rayo_broken_dot_address";
    "rayo_broken_dot_alignment";
    "rayo_broken_dot_instruction";
    "rayo_broken_dot_division";
}

/// A function without arguments whose instruction counts are known.
pub struct Known {
    pub symbol: &'static str,
    kernel: Kernel<()>,
    /// Instructions between its labels `.body` and `.body_end`.
    pub body: u64,
    /// How often these instructions are executed in a call.
    pub executed: u64,
    /// How many instructions other functions execute in a call.
    pub elsewhere: u64,
}

impl Known {
    /// # Panics
    /// If this build has no assembly.
    pub fn call(&self) {
        assert!(super::Isa::Sse41.built());
        // SAFETY: the function has no arguments and keeps the convention; it needs only
        // instructions that every x86-64 CPU has.
        unsafe { self.kernel.enter([0; 6]) };
    }

    pub fn address(&self) -> usize {
        self.kernel.address()
    }
}

macro_rules! known {
    ($($symbol:literal: $body:literal, executed $executed:literal, elsewhere $elsewhere:literal;)*) => {
        /// All such functions. Each has `endbr64` before its body and `ret` after it.
        pub static KNOWN: &[Known] = &[$(Known {
            symbol: $symbol,
            kernel: kernel!($symbol),
            body: $body,
            executed: $executed,
            elsewhere: $elsewhere,
        }),*];
    };
}

known! {
    "rayo_known_0": 0, executed 0, elsewhere 0;
    "rayo_known_1": 1, executed 1, elsewhere 0;
    "rayo_known_7": 7, executed 7, elsewhere 0;
    "rayo_known_1000": 1000, executed 1000, elsewhere 0;
    "rayo_known_loop": 3, executed 21, elsewhere 0;
    "rayo_known_repeat": 3, executed 3, elsewhere 0;
    "rayo_known_call": 2, executed 2, elsewhere 9;
}

/// Floating-point settings that a host may have made before it calls the library.
#[cfg(target_arch = "x86_64")]
pub struct HostFloats {
    pub name: &'static str,
    /// The value of MXCSR.
    pub control: u32,
}

#[cfg(target_arch = "x86_64")]
impl HostFloats {
    /// Settings that hosts are known to make.
    pub const ALL: [HostFloats; 5] = [
        HostFloats { name: "denormal numbers flushed to zero", control: 0x9fc0 },
        HostFloats { name: "rounding upwards", control: 0x5f80 },
        HostFloats { name: "rounding downwards", control: 0x3f80 },
        HostFloats { name: "rounding towards zero", control: 0x7f80 },
        HostFloats { name: "traps of invalid operations, divisions by zero and overflow", control: 0x1900 },
    ];

    /// Runs `work` as if a host with these settings had called it. `work` must only call functions
    /// that set [`StandardFloats`] themselves.
    pub fn call<R>(&self, work: impl FnOnce() -> R) -> R {
        let _host = StandardFloats::of(self.control);
        work()
    }
}

/// Runs `action` in a copy of this process. Returns whether it returned there; false if a fault
/// ended the copy.
///
/// # Safety
/// `action` only computes: the copy has no other threads, so that a lock might never be released.
#[cfg(unix)]
pub unsafe fn survives(action: impl FnOnce()) -> io::Result<bool> {
    // SAFETY: the child only runs `action`, which only computes by this function's contract, and
    // _exit.
    match unsafe { libc::fork() } {
        -1 => Err(io::Error::last_os_error()),
        0 => {
            let fine = panic::catch_unwind(AssertUnwindSafe(action)).is_ok();
            // SAFETY: ends the child at once, so that none of the parent's exit handlers run twice.
            unsafe { libc::_exit(if fine { 0 } else { 1 }) }
        }
        child => {
            let mut status = 0;
            // SAFETY: our own child, and a status that is ours to write.
            if unsafe { libc::waitpid(child, &mut status, 0) } != child {
                return Err(io::Error::last_os_error());
            }
            Ok(libc::WIFEXITED(status) && libc::WEXITSTATUS(status) == 0)
        }
    }
}
