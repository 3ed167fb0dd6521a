//! Crashes inside of kernels: a handler of the signals that the CPU's faults raise.
//!
//! A checked call that crashes returns, with what is known of the crash. Outside of these, a
//! program may ask for its own last words: see [`explain`]. Faults of any other code, and signals
//! that somebody sends, do what they would have done.

use std::ops::Range;

/// A fault that ended a kernel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Crash {
    /// The signal's number.
    pub signal: i32,
    /// What it comes of, as `siginfo_t` has it.
    pub code: i32,
    /// The address that could not be accessed; 0 where the CPU does not tell it, as where a vector
    /// is not aligned.
    pub address: u64,
    /// The address of the instruction.
    pub rip: u64,
    /// The registers before it: rax, rcx, rdx, rbx, rsp, rbp, rsi, rdi, r8 to r15, as instructions
    /// number them.
    pub general: [u64; 16],
}

/// Installs `tell`, which ends the process when a thread crashes in the `code` of kernels, outside
/// of checked calls.
///
/// It runs on the thread that crashed, on a stack of its own, and may allocate and lock like any
/// function: a kernel holds no lock and has no memory half allocated. Other threads go on
/// meanwhile; one that crashes too waits for the end. If there is no memory for that stack, a crash
/// does what it would have done without this call.
pub fn explain(code: Vec<Range<usize>>, tell: fn(Crash) -> !) {
    imp::explain(code, tell);
}

/// Does `call`, and returns the crash of the kernel in it, if it has one.
///
/// # Safety
/// `call` is one of `rayo_checked_call`, while no other thread makes one.
pub(super) unsafe fn caught<R>(call: impl FnOnce() -> R) -> Result<R, Box<Crash>> {
    imp::caught(call)
}

/// From now on the end of a timer during a checked call ends it like a crash, with the signal
/// SIGPROF; elsewhere it does nothing.
#[cfg(feature = "lab")]
pub(super) fn watch_timers() {
    imp::watch_timers();
}

/// The general registers of a signal's context, by their numbers in instructions.
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
    /// Flags that a function expects to be clear, and the one of single-stepping, which a crash
    /// ends.
    const DIRECTION_AND_TRAP: i64 = 0x500;

    thread_local! {
        /// Whether this thread is in a checked call.
        static IN_CHECKED_CALL: Cell<bool> = const { Cell::new(false) };
        /// This thread's last crash.
        static LAST: Cell<Option<Crash>> = const { Cell::new(None) };
    }

    /// What the signals did before.
    static BEFORE: OnceLock<[libc::sigaction; SIGNALS.len()]> = OnceLock::new();

    /// How the program tells of a crash.
    struct LastWords {
        code: Vec<Range<usize>>,
        tell: fn(Crash) -> !,
        /// The end of a stack.
        stack: usize,
    }

    static LAST_WORDS: OnceLock<LastWords> = OnceLock::new();

    convention! { foreign {
        fn rayo_checked_crashed();
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

    /// Handles the signals, from the first call on.
    fn handle() {
        BEFORE.get_or_init(|| {
            SIGNALS.map(|signal| {
                let mut before = MaybeUninit::zeroed();
                // SAFETY: a structure of numbers and addresses, for which all 0 is a value, and
                // which the system fills.
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

    /// Installs the handler for a signal; BEFORE, which it reads, is set.
    fn handle_one(signal: c_int) {
        let on_fault: extern "C" fn(c_int, *mut libc::siginfo_t, *mut c_void) = on_fault;
        // SAFETY: a structure of numbers and addresses, for which all 0 is a value; the handler has
        // the signature that SA_SIGINFO asks for.
        unsafe {
            let mut handler: libc::sigaction = std::mem::zeroed();
            handler.sa_sigaction = on_fault as usize;
            // Threads of Rust have a further stack for the case that their own is full.
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
        // SAFETY: the operating system gives a handler with SA_SIGINFO a valid siginfo_t, of a
        // fault as far as it is one; and as the third argument the interrupted context, a
        // ucontext_t that nobody else holds.
        let (code, address, context) =
            unsafe { ((*info).si_code, (*info).si_addr() as u64, &mut *context.cast::<libc::ucontext_t>()) };
        let general = general(context);
        let registers = &mut context.uc_mcontext.gregs;
        let rip = registers[libc::REG_RIP as usize] as u64;
        let crash = Crash { signal, code, address, rip, general };
        // What processes send has codes up to 0.
        let is_fault = code > 0;
        if is_fault && IN_CHECKED_CALL.replace(false) {
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
                // SAFETY: waits; it may be called in a handler.
                unsafe { libc::pause() };
            }
            LAST.set(Some(crash));
            registers[libc::REG_EFL as usize] &= !DIRECTION_AND_TRAP;
            registers[libc::REG_RIP as usize] = tell as *const () as i64;
            // As behind a call.
            registers[libc::REG_RSP as usize] = (words.stack - size_of::<usize>()) as i64;
            return;
        }
        let place = SIGNALS.iter().position(|known| *known == signal);
        if let (Some(before), Some(place)) = (BEFORE.get(), place) {
            // SAFETY: both functions may be called in a handler; the action is one that the system
            // gave.
            unsafe {
                libc::sigaction(signal, &before[place], ptr::null_mut());
                // A fault comes again.
                if !is_fault {
                    libc::raise(signal);
                }
            }
        }
    }

    /// Continues after a crash, in place of the kernel and on a stack of its own.
    extern "C" fn tell() -> ! {
        let words = LAST_WORDS.get().expect("the handler has seen them");
        (words.tell)(LAST.get().expect("the handler has set it"))
    }
}

#[cfg(not(all(rayo_asm, target_os = "linux")))]
mod imp {
    use std::ops::Range;

    use super::Crash;

    /// A crash does here what it would have done.
    pub fn caught<R>(call: impl FnOnce() -> R) -> Result<R, Box<Crash>> {
        Ok(call())
    }

    pub fn explain(_: Vec<Range<usize>>, _: fn(Crash) -> !) {}

    /// Who started the process ends it.
    #[cfg(feature = "lab")]
    pub fn watch_timers() {}
}
