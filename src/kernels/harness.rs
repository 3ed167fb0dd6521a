//! What tests need to try kernels and checks: kernels that break the rules, functions to count, copies of the process.

#[cfg(unix)]
use std::io;
#[cfg(unix)]
use std::panic::{self, AssertUnwindSafe};

use super::checked::{Fault, vector_bytes};
use super::kernel::{Kernel, kernel};
pub use super::kernel::{checked, faults, without_denormals};
pub use super::portable::{lanes, packets as portable_packets};

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

/// Whether a copy of this process returns from `action`; false if a fault ends it.
///
/// # Safety
/// `action` only computes: in the copy no other thread runs, so that a lock may never be released.
#[cfg(unix)]
pub unsafe fn survives(action: impl FnOnce()) -> io::Result<bool> {
    // SAFETY: the child does nothing but `action`, which by this function's contract computes only, and _exit.
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
