//! What tests need to try kernels and checks: kernels that break the rules, functions to count,
//! copies of the process.

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

/// A kernel without arguments that breaks one rule on purpose.
pub struct Broken {
    kernel: Kernel<()>,
    /// The one rule it breaks.
    pub breaks: Fault,
}

impl Broken {
    /// Whether the CPU has its instructions: one of them needs AVX.
    pub fn usable(&self) -> bool {
        self.breaks != Fault::Upper || vector_bytes() > 16
    }

    /// The faults found by a checked call.
    ///
    /// # Panics
    /// If it is not [`usable`](Broken::usable).
    pub fn faults(&self) -> Vec<Fault> {
        assert!(self.usable());
        // SAFETY: it has no arguments, and what it breaks is put right by the checked call.
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
        /// Kernels that are to compute `dot`, each with its own mistake.
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

/// A function without arguments, and its instruction counts.
pub struct Known {
    pub symbol: &'static str,
    kernel: Kernel<()>,
    /// Instructions between its labels `.body` and `.body_end`.
    pub body: u64,
    /// Executions of those in a call.
    pub executed: u64,
    /// Instructions that other functions execute in a call.
    pub elsewhere: u64,
}

impl Known {
    /// # Panics
    /// Where no assembly is built.
    pub fn call(&self) {
        assert!(super::Isa::Sse41.built());
        // SAFETY: it takes nothing and keeps to the convention; it needs no more than x86-64 has.
        unsafe { self.kernel.enter([0; 6]) };
    }

    pub fn address(&self) -> usize {
        self.kernel.address()
    }
}

macro_rules! known {
    ($($symbol:literal: $body:literal, executed $executed:literal, elsewhere $elsewhere:literal;)*) => {
        /// All of them. Each has `endbr64` and `ret` around its body.
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

/// How a host has set floating-point arithmetic before it calls us.
#[cfg(target_arch = "x86_64")]
pub struct HostFloats {
    pub name: &'static str,
    /// MXCSR.
    pub control: u32,
}

#[cfg(target_arch = "x86_64")]
impl HostFloats {
    /// What hosts are known to do.
    pub const ALL: [HostFloats; 5] = [
        HostFloats { name: "denormal numbers flushed to zero", control: 0x9fc0 },
        HostFloats { name: "rounding upwards", control: 0x5f80 },
        HostFloats { name: "rounding downwards", control: 0x3f80 },
        HostFloats { name: "rounding towards zero", control: 0x7f80 },
        HostFloats { name: "traps of invalid operations, divisions by zero and overflow", control: 0x1900 },
    ];

    /// Does `work`, which only calls what sets [`StandardFloats`] itself, in a thread that such a
    /// host has called.
    pub fn call<R>(&self, work: impl FnOnce() -> R) -> R {
        let _host = StandardFloats::of(self.control);
        work()
    }
}

/// Whether a copy of this process returns from `action`; false if a fault ends it.
///
/// # Safety
/// `action` only computes: in the copy no other thread runs, so that a lock may never be released.
#[cfg(unix)]
pub unsafe fn survives(action: impl FnOnce()) -> io::Result<bool> {
    // SAFETY: the child does nothing but `action`, which by this function's contract computes only,
    // and _exit.
    match unsafe { libc::fork() } {
        -1 => Err(io::Error::last_os_error()),
        0 => {
            let fine = panic::catch_unwind(AssertUnwindSafe(action)).is_ok();
            // SAFETY: ends the child at once, with nothing of the parent's run twice.
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
