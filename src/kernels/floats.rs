//! The control of floating-point arithmetic, which a host may have set otherwise than Rust and the
//! kernels assume.

use std::marker::PhantomData;

#[cfg(target_arch = "aarch64")]
use aarch64 as register;
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
use unknown as register;
#[cfg(target_arch = "x86_64")]
use x86_64 as register;

/// While it lives, this thread computes as Rust and the kernels assume: to nearest, with denormal
/// numbers, without traps.
///
/// Every public function that computes begins with one, so that a host which flushes denormal
/// numbers to zero, rounds another way or unmasks exceptions (Fortran's `-ffpe-trap`, Delphi,
/// audio, debuggers) gets the same pictures. What the host had set is put back at the end, its
/// exception flags included. Threads that are started meanwhile begin with it. Where nothing is to
/// be changed it costs a read of the register. On CPUs other than x86-64 and ARM64 it does nothing.
#[must_use = "it lasts as long as this does"]
pub struct StandardFloats {
    /// What the host had set, if it was something else.
    of_host: Option<register::Control>,
    /// Keeps the guard on the thread whose register it has set: a raw pointer is neither `Send` nor
    /// `Sync`.
    _thread: PhantomData<*const ()>,
}

impl StandardFloats {
    /// Sets this thread's register, if it has another value.
    pub fn set() -> Self {
        Self::of(register::STANDARD)
    }

    /// Sets another value: only for what tests do to play such a host, since Rust does not define
    /// what it then computes.
    pub(super) fn of(control: register::Control) -> Self {
        let found = register::read();
        let is_set = found & register::CONTROL == control;
        if !is_set {
            register::write(control);
        }
        StandardFloats { of_host: (!is_set).then_some(found), _thread: PhantomData }
    }
}

impl Drop for StandardFloats {
    fn drop(&mut self) {
        if let Some(of_host) = self.of_host {
            register::write(of_host);
        }
    }
}

/// MXCSR. No code of ours uses the x87, which has a control word of its own.
#[cfg(target_arch = "x86_64")]
pub(super) mod x86_64 {
    use std::arch::asm;

    pub type Control = u32;

    /// All exceptions masked, rounding to nearest, neither FTZ nor DAZ.
    pub const STANDARD: Control = 0x1f80;
    /// All bits but the flags of exceptions that have occurred.
    pub const CONTROL: Control = !0x3f;

    #[inline]
    pub fn read() -> Control {
        let mut control = 0;
        // SAFETY: every x86-64 CPU has the instruction, and `control` has the four bytes that it
        // writes.
        unsafe { asm!("stmxcsr [{}]", in(reg) &mut control, options(nostack, preserves_flags)) };
        control
    }

    /// The compiler takes the instruction for one that may use any memory: it moves no load and no
    /// store across, and so none of the arithmetic between them.
    #[inline]
    pub fn write(control: Control) {
        // SAFETY: every x86-64 CPU has the instruction, which reads four bytes. The value is the
        // one that Rust assumes, or was in the register before, so that no reserved bit is set; a
        // trap that it unmasks is taken by a later operation only.
        unsafe { asm!("ldmxcsr [{}]", in(reg) &control, options(nostack)) };
    }
}

/// FPCR, whose value is 0 where a process begins. The flags of exceptions are in another register.
#[cfg(target_arch = "aarch64")]
pub(super) mod aarch64 {
    use std::arch::asm;

    pub type Control = u64;

    pub const STANDARD: Control = 0;
    pub const CONTROL: Control = !0;

    #[inline]
    pub fn read() -> Control {
        let control;
        // SAFETY: every ARM64 CPU with floating-point numbers, which Rust requires, lets a process
        // read the register.
        unsafe { asm!("mrs {}, fpcr", out(reg) control, options(nostack, preserves_flags)) };
        control
    }

    /// As on x86-64.
    #[inline]
    pub fn write(control: Control) {
        // SAFETY: a process may write the register; the value is the one that Rust assumes, or was
        // there before.
        unsafe { asm!("msr fpcr, {}", in(reg) control, options(nostack)) };
    }
}

/// A CPU whose register is not known here.
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
mod unknown {
    pub type Control = u32;

    pub const STANDARD: Control = 0;
    pub const CONTROL: Control = !0;

    pub fn read() -> Control {
        STANDARD
    }

    pub fn write(_: Control) {}
}
