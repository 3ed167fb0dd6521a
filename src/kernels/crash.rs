//! Handles crashes inside of kernels: the signals that faults of the CPU raise.
//!
//! A checked call that crashes returns with a description of the crash. For other calls a program
//! can install a function that reports the crash and ends the process; see [`explain`]. Faults of
//! other code, and signals that processes send, have the effect that they would have without this
//! handler.

use std::ops::Range;

/// A fault that ended a kernel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Crash {
    /// The signal's number.
    pub signal: i32,
    /// The cause, `si_code` of `siginfo_t`.
    pub code: i32,
    /// The address that could not be accessed. It is 0 where the CPU does not report it, such as
    /// for a vector that is not aligned.
    pub address: u64,
    /// The address of the instruction.
    pub rip: u64,
    /// The general registers before the instruction, in the order of their numbers: rax, rcx, rdx,
    /// rbx, rsp, rbp, rsi, rdi, r8 to r15.
    pub general: [u64; 16],
}

/// Installs `tell`, which ends the process if a thread crashes in the `code` of kernels outside of
/// checked calls.
///
/// `tell` runs on the thread that crashed, on a separate stack, and may allocate and lock like any
/// function: a kernel holds no lock and leaves no memory half allocated. Other threads continue
/// meanwhile; one that crashes too waits for the end of the process. If there is no memory for the
/// stack, a crash has the effect that it would have without this call.
pub fn explain(code: Vec<Range<usize>>, tell: fn(Crash) -> !) {
    imp::explain(code, tell);
}

/// Runs `call`, and returns the crash of the kernel in it, if the kernel crashes.
///
/// # Safety
/// `call` is a call of `rayo_checked_call`, and no other thread calls that at the same time.
pub(super) unsafe fn caught<R>(call: impl FnOnce() -> R) -> Result<R, Box<Crash>> {
    imp::caught(call)
}

/// From now on the end of a timer (SIGPROF) during a checked call ends that call like a crash.
/// Elsewhere the signal does nothing.
#[cfg(feature = "lab")]
pub(super) fn watch_timers() {
    imp::watch_timers();
}

/// The general registers of a signal's context, by the numbers that instructions encode.
#[cfg(all(target_os = "linux", target_arch = "x86_64", any(rayo_asm, feature = "lab")))]
pub(super) fn general(context: &libc::ucontext_t) -> [u64; 16] {
    const ORDER: [libc::c_int; 16] = {
        use libc::*;
        [
            REG_RAX, REG_RCX, REG_RDX, REG_RBX, REG_RSP, REG_RBP, REG_RSI, REG_RDI, REG_R8, REG_R9, REG_R10, REG_R11,
            REG_R12, REG_R13, REG_R14, REG_R15,
        ]
    };
    ORDER.map(|register| context.uc_mcontext.gregs[register as usize] as u64)
}

#[cfg(all(rayo_asm, target_os = "linux"))]
mod imp {
    use std::cell::Cell;
    use std::ffi::{c_int, c_void};
    use std::mem::MaybeUninit;
    use std::ops::Range;
    use std::ptr;
    use std::sync::OnceLock;
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::{Crash, general};

    const SIGNALS: [c_int; 4] = [libc::SIGSEGV, libc::SIGBUS, libc::SIGILL, libc::SIGFPE];
    /// The direction flag, which functions expect to be clear, and the trap flag: a crash ends
    /// single-stepping.
    const DIRECTION_AND_TRAP: i64 = 0x500;

    thread_local! {
        /// Whether this thread is in a checked call.
        static IN_CHECKED_CALL: Cell<bool> = const { Cell::new(false) };
        /// The last crash of this thread.
        static LAST: Cell<Option<Crash>> = const { Cell::new(None) };
    }

    /// The actions of the signals before this handler was installed.
    static BEFORE: OnceLock<[libc::sigaction; SIGNALS.len()]> = OnceLock::new();

    /// How the program reports a crash.
    struct LastWords {
        code: Vec<Range<usize>>,
        tell: fn(Crash) -> !,
        /// The upper end of the stack on which `tell` runs.
        stack: usize,
    }

    static LAST_WORDS: OnceLock<LastWords> = OnceLock::new();

    convention! { foreign {
        fn rayo_checked_crashed();
        fn rayo_checked_home() -> u64;
    } }

    pub fn caught<R>(call: impl FnOnce() -> R) -> Result<R, Box<Crash>> {
        handle();
        IN_CHECKED_CALL.set(true);
        let result = call();
        IN_CHECKED_CALL.set(false);
        LAST.take().map_or(Ok(result), |crash| Err(Box::new(crash)))
    }

    pub fn explain(code: Vec<Range<usize>>, tell: fn(Crash) -> !) {
        const STACK: usize = 1 << 20;
        let Ok(stack) = memmap2::MmapMut::map_anon(STACK) else { return };
        let end = stack.as_ptr_range().end as usize;
        std::mem::forget(stack);
        let _ = LAST_WORDS.set(LastWords { code, tell, stack: end });
        handle();
    }

    /// Installs the handler for all signals, when it is first called.
    fn handle() {
        BEFORE.get_or_init(|| {
            SIGNALS.map(|signal| {
                let mut before = MaybeUninit::zeroed();
                // SAFETY: a structure of numbers and addresses, for which all bits 0 are a value;
                // the system fills it.
                unsafe {
                    libc::sigaction(signal, ptr::null(), before.as_mut_ptr());
                    before.assume_init()
                }
            })
        });
        static IS_HANDLED: OnceLock<()> = OnceLock::new();
        IS_HANDLED.get_or_init(|| {
            SIGNALS.iter().for_each(|signal| handle_one(*signal));
        });
    }

    /// Installs the handler for one signal. `BEFORE`, which the handler reads, must be set.
    fn handle_one(signal: c_int) {
        let on_fault: extern "C" fn(c_int, *mut libc::siginfo_t, *mut c_void) = on_fault;
        // SAFETY: a structure of numbers and addresses, for which all bits 0 are a value. The
        // handler has the signature that SA_SIGINFO requires.
        unsafe {
            let mut handler: libc::sigaction = std::mem::zeroed();
            handler.sa_sigaction = on_fault as usize;
            // Rust gives each thread an alternate stack for signals, which serves if its own stack
            // is full.
            handler.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
            libc::sigaction(signal, &handler, ptr::null_mut());
        }
    }

    #[cfg(feature = "lab")]
    pub fn watch_timers() {
        handle();
        handle_one(libc::SIGPROF);
    }

    extern "C" fn on_fault(signal: c_int, info: *mut libc::siginfo_t, context: *mut c_void) {
        // SAFETY: the operating system gives a handler with SA_SIGINFO a valid siginfo_t, whose
        // address is only used if the signal is a fault; and as the third argument the interrupted
        // context, a ucontext_t that nobody else holds.
        let (code, address, context) =
            unsafe { ((*info).si_code, (*info).si_addr() as u64, &mut *context.cast::<libc::ucontext_t>()) };
        let general = general(context);
        let registers = &mut context.uc_mcontext.gregs;
        let rip = registers[libc::REG_RIP as usize] as u64;
        let crash = Crash { signal, code, address, rip, general };
        // Signals that processes send have codes of at most 0.
        let is_fault = code > 0;
        if is_fault && IN_CHECKED_CALL.get() && is_in_kernel() {
            IN_CHECKED_CALL.set(false);
            LAST.set(Some(crash));
            registers[libc::REG_EFL as usize] &= !DIRECTION_AND_TRAP;
            registers[libc::REG_RIP as usize] = rayo_checked_crashed as *const () as i64;
            return;
        }
        if is_fault
            && let Some(words) = LAST_WORDS.get()
            && words.code.iter().any(|code| code.contains(&(rip as usize)))
        {
            static IS_TOLD: AtomicBool = AtomicBool::new(false);
            while IS_TOLD.swap(true, Ordering::Relaxed) {
                // SAFETY: the function only waits, and may be called in a handler.
                unsafe { libc::pause() };
            }
            LAST.set(Some(crash));
            registers[libc::REG_EFL as usize] &= !DIRECTION_AND_TRAP;
            registers[libc::REG_RIP as usize] = tell as *const () as i64;
            // The stack is aligned as it is after a call instruction.
            registers[libc::REG_RSP as usize] = (words.stack - size_of::<usize>()) as i64;
            return;
        }
        let place = SIGNALS.iter().position(|known| *known == signal);
        if let (Some(before), Some(place)) = (BEFORE.get(), place) {
            // SAFETY: both functions may be called in a handler, and the action is one that the
            // system returned.
            unsafe {
                libc::sigaction(signal, &before[place], ptr::null_mut());
                // If the signal was a fault, the instruction faults again; otherwise the signal has
                // to be raised again.
                if !is_fault {
                    libc::raise(signal);
                }
            }
        }
    }

    /// Whether the checked call that this thread makes has entered its kernel and not come back: a
    /// timer may end right before and after that too.
    fn is_in_kernel() -> bool {
        // SAFETY: reads one word, and changes nothing.
        unsafe { rayo_checked_home() != 0 }
    }

    /// Continues after a crash, instead of the kernel and on a stack of its own.
    extern "C" fn tell() -> ! {
        let words = LAST_WORDS.get().expect("the handler has seen them");
        (words.tell)(LAST.get().expect("the handler has set it"))
    }
}

#[cfg(not(all(rayo_asm, target_os = "linux")))]
mod imp {
    use std::ops::Range;

    use super::Crash;

    /// On this system a crash has the effect that it would have without a handler.
    pub fn caught<R>(call: impl FnOnce() -> R) -> Result<R, Box<Crash>> {
        Ok(call())
    }

    pub fn explain(_: Vec<Range<usize>>, _: fn(Crash) -> !) {}

    /// On this system the parent process has to enforce time limits.
    #[cfg(feature = "lab")]
    pub fn watch_timers() {}
}
