//! A kernel as machine code with the calling convention, and checked calls, which test whether it
//! keeps that convention.

use std::fmt;
use std::sync::Mutex;

use super::crash::{self, Crash};
use super::isa::detected;

/// Gives a type, a definition or foreign declarations the calling convention of all kernels: System
/// V's on x86-64, whatever the operating system, and C's elsewhere.
#[cfg(target_arch = "x86_64")]
macro_rules! convention {
    ($($of:tt)*) => { with_abi! { "sysv64" $($of)* } };
}
#[cfg(not(target_arch = "x86_64"))]
macro_rules! convention {
    ($($of:tt)*) => { with_abi! { "C" $($of)* } };
}

macro_rules! with_abi {
    ($abi:literal type($($argument:ty),*) -> $result:ty) => { unsafe extern $abi fn($($argument),*) -> $result };
    ($abi:literal foreign { $($foreign:tt)* }) => { unsafe extern $abi { $($foreign)* } };
    ($abi:literal $(#[$doc:meta])* fn $($definition:tt)*) => {
        $(#[$doc])*
        pub(super) unsafe extern $abi fn $($definition)*
    };
}

/// The six argument registers of the convention. A kernel reads as many as its kind fills.
pub(super) type Registers = [u64; 6];

/// The address of a kernel. All kernels have this type: filling more registers than a kernel reads,
/// or reading a result that it does not return, does no harm, since the convention lets a callee
/// leave anything in these registers.
pub(super) type Code = convention!(type(u64, u64, u64, u64, u64, u64) -> u64);

/// A rule of the calling convention that a kernel broke. The order is that of the bits in
/// checked.asm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// Did not preserve rbx.
    Rbx,
    /// Did not preserve rbp.
    Rbp,
    /// Did not preserve r12.
    R12,
    /// Did not preserve r13.
    R13,
    /// Did not preserve r14.
    R14,
    /// Did not preserve r15.
    R15,
    /// Did not return with rsp as it found it.
    Rsp,
    /// Wrote into its caller's stack frame.
    Stack,
    /// Left the direction flag set.
    Direction,
    /// Changed the control bits of MXCSR.
    Mxcsr,
    /// Left the upper parts of vector registers dirty: `vzeroupper` is missing.
    Upper,
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Fault::Rbx => "rbx is not preserved",
            Fault::Rbp => "rbp is not preserved",
            Fault::R12 => "r12 is not preserved",
            Fault::R13 => "r13 is not preserved",
            Fault::R14 => "r14 is not preserved",
            Fault::R15 => "r15 is not preserved",
            Fault::Rsp => "rsp is not as it was at the call",
            Fault::Stack => "the caller's stack frame is overwritten",
            Fault::Direction => "the direction flag is left set",
            Fault::Mxcsr => "the control bits of MXCSR are changed",
            Fault::Upper => "the upper parts of vector registers are left dirty: vzeroupper is missing",
        })
    }
}

impl Fault {
    /// All rules, in the order of their bits.
    pub const ALL: [Fault; 11] = {
        use Fault::*;
        [Rbx, Rbp, R12, R13, R14, R15, Rsp, Stack, Direction, Mxcsr, Upper]
    };
}

#[cfg(rayo_asm)]
convention! { foreign {
    fn rayo_checked_call(kernel: Code, registers: *mut Registers, vectors: u64, mxcsr: u64) -> u64;
} }

/// Without assembly, calls cannot be checked.
#[cfg(not(rayo_asm))]
unsafe fn rayo_checked_call(_: Code, _: *mut Registers, _: u64, _: u64) -> u64 {
    unimplemented!("what checks calls is written in assembly, which this build lacks")
}

#[cfg(not(all(rayo_asm, rayo_c)))]
convention! {
    /// Stands for a kernel that this build lacks. No table that contains it is handed out.
    fn absent(_: u64, _: u64, _: u64, _: u64, _: u64, _: u64) -> u64 {
        unimplemented!("this build lacks the kernel")
    }
}

/// The width of this CPU's vector registers, in bytes.
pub(super) fn vector_bytes() -> u64 {
    if detected!("avx512f") {
        64
    } else if detected!("avx") {
        32
    } else {
        16
    }
}

/// The bits FTZ and DAZ of MXCSR: subnormal results and operands are replaced by 0.
const NO_DENORMALS: u64 = 0x8040;

/// What a checked call of a kernel returned.
pub(super) struct Returned {
    pub(super) result: u64,
    /// The rules of the calling convention that the kernel broke.
    pub(super) faults: Vec<Fault>,
}

/// Calls a kernel with junk in every register that it must preserve. Returns its result, and the
/// rules that it broke. Subnormal numbers may be switched off while the kernel runs, but never for
/// Rust code, whose compiler assumes them.
///
/// # Errors
/// The crash of a kernel that did not return.
///
/// # Safety
/// `kernel` takes these registers, and everything that its contract requires holds.
pub(super) unsafe fn call(
    kernel: Code,
    mut registers: Registers,
    without_denormals: bool,
) -> Result<Returned, Box<Crash>> {
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let found = {
        let _guard = ONE_AT_A_TIME.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let mxcsr = if without_denormals { NO_DENORMALS } else { 0 };
        // SAFETY: the kernel and its registers are right by this function's contract; the width is
        // that of this CPU; the bits of MXCSR unmask no exception. The lock guards the statics of
        // the checking code, and the call is the one that `caught` requires.
        unsafe { crash::caught(|| rayo_checked_call(kernel, &mut registers, vector_bytes(), mxcsr)) }?
    };
    let faults = Fault::ALL.iter().enumerate().filter(|(bit, _)| found >> bit & 1 == 1).map(|(_, fault)| *fault);
    Ok(Returned { result: registers[0], faults: faults.collect() })
}
