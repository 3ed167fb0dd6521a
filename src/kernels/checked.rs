//! Checked calls: whether a kernel keeps the calling convention, and kernels that do not, to show that we would notice.

use std::sync::Mutex;

use super::ffi::Op;
use super::types::Vec4;

/// A rule of the calling convention that a kernel broke, in the order of the bits in checked.asm.
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

impl Fault {
    /// Every one, by its bit.
    pub const ALL: [Fault; 11] = [
        Fault::Rbx,
        Fault::Rbp,
        Fault::R12,
        Fault::R13,
        Fault::R14,
        Fault::R15,
        Fault::Rsp,
        Fault::Stack,
        Fault::Direction,
        Fault::Mxcsr,
        Fault::Upper,
    ];
}

/// A kernel without arguments that breaks one rule on purpose.
pub struct Broken {
    code: unsafe extern "sysv64" fn(),
    /// The one rule it breaks.
    pub breaks: Fault,
}

impl Broken {
    /// Whether its instructions are there: one of them needs AVX.
    pub fn usable(&self) -> bool {
        self.breaks != Fault::Upper || vector_bytes() > 16
    }

    /// What a checked call finds.
    ///
    /// # Panics
    /// Where it is not [`usable`](Broken::usable).
    pub fn call_checked(&self) -> Result<(), Vec<Fault>> {
        assert!(self.usable());
        // SAFETY: it has no arguments, and what it breaks is put right by the checked call.
        unsafe { call(self.code as *const (), [0; 6]) }
    }
}

macro_rules! broken {
    ($($name:ident breaks $fault:ident),* $(,)?) => {
        unsafe extern "sysv64" {
            $(fn $name();)*
        }
        /// A kernel for every [`Fault`].
        pub static BROKEN: &[Broken] = &[$(Broken { code: $name, breaks: Fault::$fault }),*];
    };
}

broken! {
    rayo_broken_rbx breaks Rbx,
    rayo_broken_rbp breaks Rbp,
    rayo_broken_r12 breaks R12,
    rayo_broken_r13 breaks R13,
    rayo_broken_r14 breaks R14,
    rayo_broken_r15 breaks R15,
    rayo_broken_rsp breaks Rsp,
    rayo_broken_stack breaks Stack,
    rayo_broken_direction breaks Direction,
    rayo_broken_mxcsr breaks Mxcsr,
    rayo_broken_upper breaks Upper,
}

unsafe extern "sysv64" {
    fn rayo_checked_call(kernel: *const (), args: *const [u64; 6], vectors: u64) -> u64;
    fn rayo_broken_read(out: *mut Vec4, a: *const Vec4, b: *const Vec4);
    fn rayo_broken_write(out: *mut Vec4, a: *const Vec4, b: *const Vec4);
}

/// An operation that reads one vector past `a`.
///
/// # Safety
/// For a call that is expected to fault, in a process of its own: what lies behind `a` must not be there.
pub unsafe fn broken_read() -> Op<Vec4, Vec4, Vec4> {
    Op::new(rayo_broken_read)
}

/// An operation that writes one vector past `out`.
///
/// # Safety
/// For a call that is expected to fault, in a process of its own: what lies behind `out` must not be there.
pub unsafe fn broken_write() -> Op<Vec4, Vec4, Vec4> {
    Op::new(rayo_broken_write)
}

/// How wide this CPU's vectors are.
fn vector_bytes() -> u64 {
    match () {
        () if is_x86_feature_detected!("avx512f") => 64,
        () if is_x86_feature_detected!("avx") => 32,
        () => 16,
    }
}

/// Calls a kernel with junk in every register that it must preserve, and lists the rules it broke.
///
/// # Safety
/// `kernel` is a function of the sysv64 convention that takes `args`, and everything its own contract asks for holds.
pub(super) unsafe fn call(kernel: *const (), args: [u64; 6]) -> Result<(), Vec<Fault>> {
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
    let found = {
        let _guard = ONE_AT_A_TIME.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        // SAFETY: the kernel and its arguments by this function's contract; the width is that of this CPU; the statics
        // of the harness are behind the lock.
        unsafe { rayo_checked_call(kernel, &args, vector_bytes()) }
    };
    let faults: Vec<_> =
        Fault::ALL.iter().enumerate().filter(|(bit, _)| found >> bit & 1 == 1).map(|(_, fault)| *fault).collect();
    if faults.is_empty() { Ok(()) } else { Err(faults) }
}
