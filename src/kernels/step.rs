//! Counts executed instructions exactly: the trap flag makes the CPU stop after each one, and a
//! signal handler counts.
//!
//! While the trap flag is set in a thread's flags register, the CPU raises a debug exception after
//! every instruction that the thread executes in user mode, and the operating system delivers it as
//! SIGTRAP. That needs no privilege and no hardware counter, works for any instruction set, and
//! takes some microseconds per instruction.
//!
//! Every instruction counts once. A string instruction with a repeat prefix counts once, however
//! often it repeats. A system call and the instruction after it count as one, since the CPU clears
//! the flag on its way into the operating system.
//!
//! For code in given ranges [`record`] also keeps the registers between instructions.
//!
//! For the kernels of a picture [`visits`] and [`record_kernels`] set the flag only while these
//! run, so that their callers take no longer than usual.

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod recorder;
mod recording;

use std::ops::Range;

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
use super::checked::{Code, Registers};
use super::code::code_at;
use super::kernel::{Crashed, examine};
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
use super::memory::try_reserve;
use imp::Recorder;
pub use recording::{MemoryOperand, Recording, State, Step, Touched, Visit, VisitRecord, memory_operand};

/// Why instructions cannot be counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unavailable {
    #[error("single-stepping is written for Linux on x86-64")]
    Platform,
    #[error("process {by} traces this one (a debugger?) and would get the traps; run without it")]
    Traced {
        /// The tracing process.
        by: u32,
    },
    #[error("the trap flag has no effect here, as under valgrind and some emulators")]
    NoTrap,
    /// Traps occurred, but not one for each instruction of a known sequence.
    #[error("the trap flag is not exact here: {counted} traps for {executed} instructions")]
    Inexact {
        /// The number of instructions in the sequence.
        executed: u64,
        /// The number of traps.
        counted: u64,
    },
    /// The code may start a thread or a process, which would inherit the flag and be killed by it;
    /// it may block or handle the signal; or it, or the hypervisor, may clear the flag.
    #[error(
        "the traps ceased before the end: what is counted starts a thread or a process, or something cleared the trap flag"
    )]
    Lost,
    #[error("there is no memory for {bytes} bytes of what is recorded")]
    Memory {
        /// The memory requested.
        bytes: usize,
    },
    #[error("the handler of SIGTRAP could not be installed: {}", std::io::Error::from_raw_os_error(*errno))]
    Handler {
        /// The system's error number.
        errno: i32,
    },
}

/// The instructions that all calls of one function executed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Visits {
    pub calls: u64,
    /// The number of instructions from the function's entry to its return, both included, with
    /// those of all functions that it calls.
    pub instructions: u64,
    /// For each byte of the function how often an instruction that begins there was executed.
    pub at: Vec<u64>,
}

/// Counts the instructions that the thread executes in `action`, the call of the closure included.
///
/// # Errors
/// If single-stepping is not available or not exact.
///
/// # Panics
/// If `action` panics, or if it counts instructions itself.
pub fn count_instructions(action: impl FnOnce()) -> Result<u64, Unavailable> {
    imp::self_test()?;
    imp::run(0, 0, None, action).map(|counts| counts.total)
}

/// Counts the instructions of the function that begins at `address`, and of what it calls, over all
/// its calls in `action`. The function has `bytes` bytes, or ends earlier if the program's code
/// does.
///
/// The result has no calls if no function begins at `address`.
///
/// # Errors
/// If single-stepping is not available or not exact.
///
/// # Panics
/// As [`count_instructions`].
pub fn count_function(address: usize, bytes: usize, action: impl FnOnce()) -> Result<Visits, Unavailable> {
    imp::self_test()?;
    let bytes = bytes.min(code_at(address).map_or(0, <[u8]>::len));
    imp::run(address, bytes, None, action).map(|counts| counts.visits)
}

/// Lists the executions of instructions at the addresses `watched` in the kernels of pictures that
/// `action` calls: the first `most`. After these the thread runs on without single-stepping.
///
/// # Errors
/// If single-stepping is not available or not exact.
///
/// # Panics
/// As [`count_instructions`], and if `watched` is not code of this process.
pub fn visits(watched: &[Range<usize>], most: usize, action: impl FnOnce()) -> Result<VisitRecord, Unavailable> {
    imp::self_test()?;
    let mut recorder = Recorder::of_visits(check_code(watched), most)?;
    imp::step_calls(&mut recorder, action)?;
    Ok(recorder.into_visits())
}

/// As [`visits`], with checked calls. If a kernel crashes, the list ends there.
///
/// # Errors
/// As [`visits`].
///
/// # Panics
/// As [`visits`].
pub fn visits_until_crash(
    watched: &[Range<usize>],
    most: usize,
    action: impl FnOnce(),
) -> Result<VisitRecord, Unavailable> {
    imp::self_test()?;
    let mut recorder = Recorder::of_visits(check_code(watched), most)?;
    run_until_crash(&mut recorder, action)?;
    Ok(recorder.into_visits())
}

/// Records the instructions that the thread executes in `action` at the addresses `watched`, with
/// all registers and the memory that each accesses: those whose indices are `wanted`, in ascending
/// order, and at most `most` of them, for which memory is reserved.
///
/// # Errors
/// If single-stepping is not available or not exact.
///
/// # Panics
/// As [`visits`].
pub fn record(
    watched: &[Range<usize>],
    wanted: &[Range<u64>],
    most: usize,
    action: impl FnOnce(),
) -> Result<Recording, Unavailable> {
    imp::self_test()?;
    let mut recorder = Recorder::of_moments(check_code(watched), wanted, most)?;
    imp::run(0, 0, Some(&mut recorder), action)?;
    Ok(recorder.into_recording())
}

/// As [`record`], but only in the kernels of pictures that `action` calls.
///
/// # Errors
/// As [`record`].
///
/// # Panics
/// As [`visits`].
pub fn record_kernels(
    watched: &[Range<usize>],
    wanted: &[Range<u64>],
    most: usize,
    action: impl FnOnce(),
) -> Result<Recording, Unavailable> {
    imp::self_test()?;
    let mut recorder = Recorder::of_moments(check_code(watched), wanted, most)?;
    imp::step_calls(&mut recorder, action)?;
    Ok(recorder.into_recording())
}

/// As [`record_kernels`], with checked calls. If a kernel crashes, the recording ends there.
///
/// # Errors
/// As [`record`].
///
/// # Panics
/// As [`visits`].
pub fn record_until_crash(
    watched: &[Range<usize>],
    wanted: &[Range<u64>],
    most: usize,
    action: impl FnOnce(),
) -> Result<Recording, Unavailable> {
    imp::self_test()?;
    let mut recorder = Recorder::of_moments(check_code(watched), wanted, most)?;
    let crashed = run_until_crash(&mut recorder, action)?;
    Ok(Recording { crashed, ..recorder.into_recording() })
}

/// Single-steps through `action`, including what is not in kernels. If a kernel crashes, that ends
/// `action` and the single-stepping, and the crash is returned.
fn run_until_crash(recorder: &mut Recorder, action: impl FnOnce()) -> Result<Option<Box<Crashed>>, Unavailable> {
    let mut crashed = None;
    let counts = imp::run(0, 0, Some(recorder), || crashed = examine(action).result.err());
    if crashed.is_none() {
        counts?;
    }
    Ok(crashed)
}

/// Checks that all these ranges are code, which the handler reads.
fn check_code(watched: &[Range<usize>]) -> &[Range<usize>] {
    let is_code = |range: &Range<usize>| code_at(range.start).is_some_and(|code| range.len() <= code.len());
    assert!(watched.iter().all(is_code), "code of this process");
    watched
}

/// Reserves memory for `most` records, since the handler cannot allocate.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
fn room<T>(most: usize) -> Result<Vec<T>, Unavailable> {
    let mut room = Vec::new();
    let bytes = most.saturating_mul(size_of::<T>());
    try_reserve(&mut room, most).map_err(|_| Unavailable::Memory { bytes })?;
    Ok(room)
}

/// The counts of one run of an action.
struct Counts {
    total: u64,
    visits: Visits,
}

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
mod imp {
    use std::any::Any;
    use std::arch::{asm, naked_asm};
    use std::cell::Cell;
    use std::ffi::{c_int, c_void};
    use std::mem::MaybeUninit;
    use std::panic::{self, AssertUnwindSafe};
    use std::ptr;
    use std::sync::atomic::{AtomicBool, AtomicPtr, AtomicU64, AtomicUsize, Ordering::Relaxed};
    use std::sync::{Mutex, OnceLock};

    pub use super::recorder::Recorder;
    use super::{Code, Counts, Registers, Unavailable, Visits};
    use crate::kernels::kernel::calling_through;

    /// The trap flag in the flags register.
    pub const TRAP_FLAG: u64 = 0x100;

    /// The state that the handler shares with the thread that it interrupts. Only that one thread
    /// uses it, in program order, so that relaxed accesses suffice.
    struct Shared {
        /// The address of the instruction that is being executed; 0 before the first one.
        current: AtomicUsize,
        /// The address at which counting ends.
        stop: AtomicUsize,
        stopped: AtomicBool,
        /// Whether the traps in a call of a kernel ceased before the call ended.
        lost: AtomicBool,
        traps: AtomicU64,
        total: AtomicU64,
        /// The address of the function that is watched; 0 for none.
        entry: AtomicUsize,
        bytes: AtomicUsize,
        /// The address of `bytes` counters.
        at: AtomicPtr<u64>,
        /// The stack pointer at the function's entry while the function runs, and 0 otherwise.
        frame: AtomicUsize,
        calls: AtomicU64,
        instructions: AtomicU64,
        /// The recorder; null if registers are not recorded.
        recorder: AtomicPtr<Recorder>,
    }

    static SHARED: Shared = Shared {
        current: AtomicUsize::new(0),
        stop: AtomicUsize::new(0),
        stopped: AtomicBool::new(false),
        lost: AtomicBool::new(false),
        traps: AtomicU64::new(0),
        total: AtomicU64::new(0),
        entry: AtomicUsize::new(0),
        bytes: AtomicUsize::new(0),
        at: AtomicPtr::new(ptr::null_mut()),
        frame: AtomicUsize::new(0),
        calls: AtomicU64::new(0),
        instructions: AtomicU64::new(0),
        recorder: AtomicPtr::new(ptr::null_mut()),
    };

    /// Only one thread may count at a time, since the handler belongs to the whole process.
    static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

    thread_local! {
        static COUNTING: Cell<bool> = const { Cell::new(false) };
    }

    /// Adds 1. Only one thread writes, so that no locked instruction is needed.
    fn increment(counter: &AtomicU64) {
        counter.store(counter.load(Relaxed) + 1, Relaxed);
    }

    /// Runs after every instruction. It counts the one that was executed, and clears the flag at
    /// the end.
    extern "C" fn on_trap(signal: c_int, info: *mut libc::siginfo_t, context: *mut c_void) {
        // SAFETY: the operating system gives a handler with SA_SIGINFO a valid siginfo_t. A single
        // step comes as TRAP_TRACE, but under a hypervisor about one in a million comes as
        // TRAP_BRKPT, since the bit that marks it as a single step is missing. An `int3` has
        // another code than these two.
        if !unsafe { [libc::TRAP_TRACE, libc::TRAP_BRKPT].contains(&(*info).si_code) } {
            // Another SIGTRAP, such as that of a breakpoint: it has the effect that it would have
            // without this handler. SAFETY: both functions may be called in a handler, and the
            // signal number is the one that came.
            unsafe {
                libc::signal(signal, libc::SIG_DFL);
                libc::raise(signal);
            }
            return;
        }
        // SAFETY: the third argument is the interrupted context, a ucontext_t that nobody else
        // holds.
        let context = unsafe { &mut *context.cast::<libc::ucontext_t>() };
        let registers = &mut context.uc_mcontext.gregs;
        let rip = registers[libc::REG_RIP as usize] as usize;
        let rsp = registers[libc::REG_RSP as usize] as usize;
        let s = &SHARED;
        increment(&s.traps);
        let done = s.current.load(Relaxed);
        if !is_code(rip) {
            // The CPU faults there when this handler has returned.
            registers[libc::REG_EFL as usize] &= !(TRAP_FLAG as i64);
            return;
        }
        // SAFETY: the instruction at `rip` is about to be executed, so that its bytes can be read.
        if done == rip && unsafe { repeats(rip as *const u8) } {
            // SAFETY: as above; and the registers are those with which the instruction will be
            // executed.
            unsafe { store_all_but_one(rip as *const u8, registers) };
            return;
        }
        // SAFETY: the instruction at `rip` is about to be executed, so that its bytes can be read.
        if unsafe { parts_with_traps(rip as *const u8, registers) } {
            registers[libc::REG_EFL as usize] &= !(TRAP_FLAG as i64);
            return;
        }
        s.current.store(rip, Relaxed);
        let recorder = s.recorder.load(Relaxed);
        // SAFETY: the recorder outlives the stepping, during which only this handler uses it; the
        // context is that of a trap.
        let full = !recorder.is_null() && unsafe { (*recorder).trap(context) };
        let registers = &mut context.uc_mcontext.gregs;
        if done != 0 {
            increment(&s.total);
            if s.frame.load(Relaxed) != 0 {
                increment(&s.instructions);
                let offset = done.wrapping_sub(s.entry.load(Relaxed));
                if offset < s.bytes.load(Relaxed) {
                    // SAFETY: `at` points to `bytes` counters that outlive the stepping, during
                    // which only this handler uses them.
                    unsafe { *s.at.load(Relaxed).add(offset) += 1 };
                }
                if rsp > s.frame.load(Relaxed) {
                    s.frame.store(0, Relaxed); // its return address has been taken from the stack
                }
            }
        }
        if s.frame.load(Relaxed) == 0 && rip == s.entry.load(Relaxed) {
            s.frame.store(rsp, Relaxed);
            increment(&s.calls);
        }
        let stop = full || rip == s.stop.load(Relaxed);
        // A panic ends the counting, since stepping through the making of a backtrace would take
        // minutes.
        if stop || std::thread::panicking() {
            registers[libc::REG_EFL as usize] &= !(TRAP_FLAG as i64);
            s.stopped.store(stop, Relaxed);
        }
    }

    /// Whether memory can be read at the address of an instruction. After a jump to a wild address
    /// it cannot.
    fn is_code(rip: usize) -> bool {
        // The mask of signals is read from the aligned word that holds `rip`, which lies in the
        // same page; at address 0 the system would read none. SAFETY: no mask is set, since no
        // operation has such a number: the call fails with EFAULT if the word cannot be read, and
        // with another error if it can. The interrupted code's error number is restored.
        rip > 7
            && unsafe {
                let errno = libc::__errno_location();
                let before = *errno;
                libc::syscall(libc::SYS_rt_sigprocmask, !0_usize, rip & !7, 0_usize, 8_usize);
                let is_there = *errno != libc::EFAULT;
                *errno = before;
                is_there
            }
    }

    /// Whether the instruction is a system call after which a trap would kill a process: one that
    /// starts a thread or a process, which inherits the flag, or one that changes the handling of
    /// SIGTRAP.
    ///
    /// # Safety
    /// An instruction begins at `code`.
    unsafe fn parts_with_traps(code: *const u8, registers: &[libc::greg_t; 23]) -> bool {
        // SAFETY: an instruction has at least one byte, and one that begins with 0f has a second
        // byte.
        let calls_system = unsafe { *code == 0x0f && *code.add(1) == 0x05 };
        let [call, first] = [libc::REG_RAX, libc::REG_RDI].map(|register| registers[register as usize]);
        calls_system
            && match call {
                libc::SYS_clone | libc::SYS_clone3 | libc::SYS_fork | libc::SYS_vfork | libc::SYS_rt_sigprocmask => {
                    true
                }
                libc::SYS_rt_sigaction => first == i64::from(libc::SIGTRAP),
                _ => false,
            }
    }

    /// Whether the instruction has a repeat prefix. A trap that finds it again is then its next
    /// iteration.
    ///
    /// # Safety
    /// An instruction begins at `code`.
    unsafe fn repeats(code: *const u8) -> bool {
        // SAFETY: an instruction has at least one byte, and one that begins with the prefix 66 has
        // a second byte.
        let first = unsafe {
            match *code {
                0x66 => *code.add(1),
                byte => byte,
            }
        };
        matches!(first, 0xf2 | 0xf3)
    }

    /// Executes a `rep stos` except for its last element, so that filling memory takes two traps
    /// and not one per element. Other instructions, and those in a downward direction, are left to
    /// the CPU.
    ///
    /// # Safety
    /// An instruction with a repeat prefix begins at `code`, and is about to be executed with
    /// `registers`.
    unsafe fn store_all_but_one(code: *const u8, registers: &mut [libc::greg_t; 23]) {
        const DIRECTION_FLAG: libc::greg_t = 0x400;
        let (mut at, mut element) = (0, 4);
        let opcode = loop {
            // SAFETY: each byte before this one is a prefix, after which the instruction continues.
            match unsafe { *code.add(at) } {
                0x66 => element = 2,
                0x48 => element = 8,
                0xf3 => {}
                opcode => break opcode,
            }
            at += 1;
        };
        match opcode {
            0xaa => element = 1,
            0xab => {}
            _ => return,
        }
        let (left, out) = (registers[libc::REG_RCX as usize] as usize, registers[libc::REG_RDI as usize] as *mut u8);
        if left < 2 || registers[libc::REG_EFL as usize] & DIRECTION_FLAG != 0 {
            return;
        }
        let value = registers[libc::REG_RAX as usize].to_le_bytes();
        for index in 0..left - 1 {
            // SAFETY: the instruction is about to write these bytes itself. If it may not, both
            // writes fault.
            unsafe { ptr::copy_nonoverlapping(value.as_ptr(), out.add(index * element), element) };
        }
        registers[libc::REG_RDI as usize] = out as libc::greg_t + ((left - 1) * element) as libc::greg_t;
        registers[libc::REG_RCX as usize] = 1;
    }

    /// A closure that is passed through `extern "sysv64"`, and its outcome.
    struct Action<F> {
        run: Option<F>,
        panicked: Option<Box<dyn Any + Send>>,
    }

    extern "sysv64" fn call<F: FnOnce()>(action: &mut Action<F>) {
        if let Some(run) = action.run.take() {
            action.panicked = panic::catch_unwind(AssertUnwindSafe(run)).err();
        }
    }

    /// Runs `action` with the trap flag set.
    pub fn run(
        entry: usize,
        bytes: usize,
        recorder: Option<&mut Recorder>,
        action: impl FnOnce(),
    ) -> Result<Counts, Unavailable> {
        fn call_of<F: FnOnce()>(_: &Action<F>) -> extern "sysv64" fn(&mut Action<F>) {
            call::<F>
        }
        if let Some(by) = tracer() {
            return Err(Unavailable::Traced { by });
        }
        assert!(!COUNTING.get(), "what is counted must not count instructions itself");
        let _guard = ONE_AT_A_TIME.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        COUNTING.set(true);
        let mut at = vec![0; bytes];
        let mut action = Action { run: Some(action), panicked: None };
        let call = call_of(&action);
        let s = &SHARED;
        s.current.store(0, Relaxed);
        s.stopped.store(false, Relaxed);
        s.frame.store(0, Relaxed);
        for counter in [&s.traps, &s.total, &s.calls, &s.instructions] {
            counter.store(0, Relaxed);
        }
        s.entry.store(entry, Relaxed);
        s.bytes.store(bytes, Relaxed);
        s.at.store(at.as_mut_ptr(), Relaxed);
        s.recorder.store(recorder.map_or(ptr::null_mut(), ptr::from_mut), Relaxed);
        let handled = with_handler(|| {
            // SAFETY: the compiler has aligned the stack for a call and keeps nothing below rsp.
            // Flags are pushed and popped in pairs. `call` takes its argument in rdi and keeps to
            // the convention whose clobbers are listed. The first trap occurs after the call
            // instruction, the last one at the label after it, where the handler clears the flag.
            unsafe {
                asm!(
                    "lea rax, [rip + 2f]",
                    "mov [rcx], rax",
                    "pushfq",
                    "or qword ptr [rsp], {flag}",
                    "popfq",
                    "call rdx",
                    "2:",
                    flag = const TRAP_FLAG,
                    out("rax") _,
                    inout("rcx") s.stop.as_ptr() => _,
                    inout("rdx") call => _,
                    inout("rdi") &raw mut action => _,
                    clobber_abi("sysv64"),
                );
            }
        });
        COUNTING.set(false);
        s.entry.store(0, Relaxed);
        s.bytes.store(0, Relaxed);
        s.recorder.store(ptr::null_mut(), Relaxed);
        if let Some(panic) = action.panicked {
            panic::resume_unwind(panic);
        }
        handled?;
        if s.traps.load(Relaxed) == 0 {
            return Err(Unavailable::NoTrap);
        }
        if !s.stopped.load(Relaxed) {
            return Err(Unavailable::Lost);
        }
        let visits = Visits { calls: s.calls.load(Relaxed), instructions: s.instructions.load(Relaxed), at };
        Ok(Counts { total: s.total.load(Relaxed), visits })
    }

    /// Runs `action` with the trap flag set while the kernels run that this thread calls.
    pub fn step_calls(recorder: &mut Recorder, action: impl FnOnce()) -> Result<(), Unavailable> {
        if let Some(by) = tracer() {
            return Err(Unavailable::Traced { by });
        }
        assert!(!COUNTING.get(), "what is counted must not count instructions itself");
        let _guard = ONE_AT_A_TIME.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        COUNTING.set(true);
        let s = &SHARED;
        s.frame.store(0, Relaxed);
        s.lost.store(false, Relaxed);
        s.recorder.store(ptr::from_mut(recorder), Relaxed);
        let mut outcome = Ok(());
        // SAFETY: `call_stepped` calls the kernel with the registers that it is given, and returns
        // its result.
        let stepped = || unsafe { calling_through(call_stepped, action) };
        let handled = with_handler(|| outcome = panic::catch_unwind(AssertUnwindSafe(stepped)));
        COUNTING.set(false);
        s.recorder.store(ptr::null_mut(), Relaxed);
        if let Err(panic) = outcome {
            panic::resume_unwind(panic);
        }
        handled?;
        if s.lost.load(Relaxed) { Err(Unavailable::Lost) } else { Ok(()) }
    }

    /// Calls a kernel with the trap flag set, for [`step_calls`].
    ///
    /// # Safety
    /// The registers hold the arguments of the kernel's kind, and the CPU supports it.
    unsafe fn call_stepped(code: Code, registers: Registers) -> u64 {
        let [a, b, c, d, e, f] = registers;
        let s = &SHARED;
        s.current.store(0, Relaxed);
        s.stopped.store(false, Relaxed);
        let result;
        // SAFETY: as in `run`; the kernel's arguments are in the registers of the convention.
        unsafe {
            asm!(
                "lea rax, [rip + 2f]",
                "mov [r11], rax",
                "mov rax, r10",
                // These registers get fixed values, since steps show what a register held before.
                "xor r10d, r10d",
                "xor r11d, r11d",
                "pushfq",
                "or qword ptr [rsp], {flag}",
                "popfq",
                "call rax",
                "2:",
                flag = const TRAP_FLAG,
                out("rax") result,
                inout("r11") s.stop.as_ptr() => _,
                inout("r10") code => _,
                inout("rdi") a => _,
                inout("rsi") b => _,
                inout("rdx") c => _,
                inout("rcx") d => _,
                inout("r8") e => _,
                inout("r9") f => _,
                clobber_abi("sysv64"),
            );
        }
        if !s.stopped.load(Relaxed) {
            s.lost.store(true, Relaxed);
        }
        result
    }

    /// Runs `action` while SIGTRAP is handled by [`on_trap`] and is not blocked, and restores both
    /// afterwards.
    fn with_handler(action: impl FnOnce()) -> Result<(), Unavailable> {
        let refused = || Unavailable::Handler { errno: std::io::Error::last_os_error().raw_os_error().unwrap_or(0) };
        // SAFETY: a structure of numbers and bits, for which all bits 0 are a value.
        let mut handler: libc::sigaction = unsafe { std::mem::zeroed() };
        let on_trap: extern "C" fn(c_int, *mut libc::siginfo_t, *mut c_void) = on_trap;
        handler.sa_sigaction = on_trap as usize;
        handler.sa_flags = libc::SA_SIGINFO;
        let mut old_handler = MaybeUninit::uninit();
        let (mut trap, mut old_mask) = (MaybeUninit::uninit(), MaybeUninit::uninit());
        // SAFETY: the sets and actions are ours, and each is written before it is read:
        // sigemptyset, sigaction and pthread_sigmask fill what they are given. The handler has the
        // signature that SA_SIGINFO requires, and only calls functions that a handler may call.
        unsafe {
            libc::sigemptyset(trap.as_mut_ptr());
            libc::sigaddset(trap.as_mut_ptr(), libc::SIGTRAP);
            if libc::sigaction(libc::SIGTRAP, &handler, old_handler.as_mut_ptr()) != 0 {
                return Err(refused());
            }
            // A trap while the signal is blocked would kill the process.
            libc::pthread_sigmask(libc::SIG_UNBLOCK, trap.as_ptr(), old_mask.as_mut_ptr());
        }
        action();
        // SAFETY: both structures were filled above.
        unsafe {
            libc::pthread_sigmask(libc::SIG_SETMASK, old_mask.as_ptr(), ptr::null_mut());
            libc::sigaction(libc::SIGTRAP, old_handler.as_ptr(), ptr::null_mut());
        }
        Ok(())
    }

    /// The process that traces this one, such as a debugger.
    fn tracer() -> Option<u32> {
        let status = std::fs::read_to_string("/proc/self/status").ok()?;
        let line = status.lines().find_map(|line| line.strip_prefix("TracerPid:"))?;
        line.trim().parse().ok().filter(|&by| by != 0)
    }

    const KNOWN: u64 = 8;

    /// A function of seven instructions that do nothing, and its return.
    #[unsafe(naked)]
    extern "sysv64" fn known() {
        naked_asm!("nop", "nop", "nop", "nop", "nop", "nop", "nop", "ret")
    }

    /// Counts a known sequence of instructions, once per process.
    pub fn self_test() -> Result<(), Unavailable> {
        static RESULT: OnceLock<Result<(), Unavailable>> = OnceLock::new();
        if let Some(by) = tracer() {
            return Err(Unavailable::Traced { by }); // may be gone at the next call
        }
        *RESULT.get_or_init(|| {
            let known: extern "sysv64" fn() = known;
            let counted = run(known as usize, 0, None, || std::hint::black_box(known)())?.visits.instructions;
            if counted == KNOWN { Ok(()) } else { Err(Unavailable::Inexact { executed: KNOWN, counted }) }
        })
    }
}

#[cfg(not(all(target_os = "linux", target_arch = "x86_64")))]
mod imp {
    use super::{Counts, Range, Recording, Unavailable, VisitRecord};

    /// A recorder that records nothing, on this system.
    pub struct Recorder;

    impl Recorder {
        pub fn of_visits(_: &[Range<usize>], _: usize) -> Result<Self, Unavailable> {
            Ok(Recorder)
        }

        pub fn of_moments(_: &[Range<usize>], _: &[Range<u64>], _: usize) -> Result<Self, Unavailable> {
            Ok(Recorder)
        }

        pub fn into_visits(self) -> VisitRecord {
            VisitRecord { visits: Vec::new(), complete: true }
        }

        pub fn into_recording(self) -> Recording {
            Recording { moments: Vec::new(), executed: 0, crashed: None }
        }
    }

    pub fn run(_: usize, _: usize, _: Option<&mut Recorder>, _: impl FnOnce()) -> Result<Counts, Unavailable> {
        Err(Unavailable::Platform)
    }

    pub fn step_calls(_: &mut Recorder, _: impl FnOnce()) -> Result<(), Unavailable> {
        Err(Unavailable::Platform)
    }

    pub fn self_test() -> Result<(), Unavailable> {
        Err(Unavailable::Platform)
    }
}
