//! The control of floating-point arithmetic, which a host may have set differently from what Rust
//! and the kernels assume.

use std::marker::PhantomData;

#[cfg(target_arch = "aarch64")]
use aarch64 as register;
#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
use unknown as register;
#[cfg(target_arch = "x86_64")]
use x86_64 as register;

/// While this value lives, the thread computes as Rust and the kernels assume: it rounds to
/// nearest, keeps subnormal numbers, and raises no traps.
///
/// Every public function that computes begins with such a guard, so that a host which flushes
/// subnormal numbers to zero, rounds in another way or unmasks exceptions (Fortran's `-ffpe-trap`,
/// Delphi, audio, debuggers) gets the same pictures. In the end the host's settings are restored,
/// its exception flags included. Threads that are started meanwhile inherit the standard settings.
/// If nothing has to be changed, the cost is one read of the register. On CPUs other than x86-64
/// and ARM64 the guard does nothing.
#[must_use = "it lasts as long as this does"]
pub struct StandardFloats {
    /// The host's settings, if they were different.
    of_host: Option<register::Control>,
    /// Keeps the guard on the thread whose register it has set: a raw pointer is neither `Send` nor
    /// `Sync`.
    _thread: PhantomData<*const ()>,
}

impl StandardFloats {
    /// Sets the standard value in this thread's register, if it has another one.
    pub fn set() -> Self {
        Self::of(register::STANDARD)
    }

    /// Sets another value. This is only for tests that act as such a host, since Rust does not
    /// define what it then computes.
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

/// The register MXCSR. None of our code uses the x87, which has a control word of its own.
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

    /// The compiler assumes that the instruction may use any memory. It therefore moves no load or
    /// store across it, and so none of the arithmetic between them.
    #[inline]
    pub fn write(control: Control) {
        // SAFETY: every x86-64 CPU has the instruction, which reads four bytes. The value is the
        // one that Rust assumes, or was in the register before, so that no reserved bit is set. A
        // trap that it unmasks can only be raised by a later operation.
        unsafe { asm!("ldmxcsr [{}]", in(reg) &control, options(nostack)) };
    }
}

/// The register FPCR, which is 0 when a process begins. The exception flags are in another
/// register.
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

    /// As for MXCSR, the compiler moves no arithmetic across.
    #[inline]
    pub fn write(control: Control) {
        // SAFETY: a process may write the register; the value is the one that Rust assumes, or was
        // there before.
        unsafe { asm!("msr fpcr, {}", in(reg) control, options(nostack)) };
    }
}

/// A CPU whose control register is not known here.
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
