//! What measuring and planning need of CPU and operating system: the time-stamp counter, pinning
//! and pages.

use std::io;
#[cfg(feature = "lab")]
use std::marker::PhantomData;
use std::time::Duration;

#[cfg(target_os = "linux")]
use nix::{
    sched::{CpuSet, sched_getaffinity, sched_setaffinity},
    unistd::Pid,
};
#[cfg(unix)]
use nix::{
    sys::{
        resource::{UsageWho, getrusage},
        time::TimeValLike,
    },
    time::ClockId,
};

#[cfg(feature = "lab")]
use super::types::Plain;

/// The time-stamp counter before timed work: everything earlier is done, nothing later has begun.
#[cfg(target_arch = "x86_64")]
#[inline]
pub fn tsc_start() -> u64 {
    use std::arch::x86_64::{_mm_lfence, _rdtsc};
    // SAFETY: every x86-64 CPU has SSE2 and the counter; where an operating system forbade it, this
    // would be a fault, not undefined behaviour.
    unsafe {
        _mm_lfence();
        let now = _rdtsc();
        _mm_lfence();
        now
    }
}

/// The time-stamp counter after timed work.
#[cfg(target_arch = "x86_64")]
#[inline]
pub fn tsc_stop() -> u64 {
    use std::arch::x86_64::{__rdtscp, _mm_lfence};
    use std::sync::LazyLock;
    static HAS_RDTSCP: LazyLock<bool> = LazyLock::new(|| {
        let features = raw_cpuid::CpuId::new().get_extended_processor_and_feature_identifiers();
        features.is_some_and(|features| features.has_rdtscp())
    });
    if !*HAS_RDTSCP {
        return tsc_start();
    }
    let mut core = 0;
    // SAFETY: the CPU has the instruction, as just asked; else as in tsc_start. `core` is ours to
    // write.
    unsafe {
        let now = __rdtscp(&mut core);
        _mm_lfence();
        now
    }
}

/// The core that runs the calling thread at this moment, if the operating system reports it.
#[cfg(target_os = "linux")]
pub fn current_core() -> Option<usize> {
    nix::sched::sched_getcpu().ok()
}

/// The core that runs the calling thread is unknown on this system.
#[cfg(not(target_os = "linux"))]
pub fn current_core() -> Option<usize> {
    None
}

/// Whether this process was started with a signal ignored, as SIGHUP is by `nohup`.
#[cfg(unix)]
pub fn is_ignored(signal: i32) -> bool {
    // SAFETY: numbers and an address that may be null, for which all bits 0 are a value.
    let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
    // SAFETY: no new action is given, and the structure for the old one is ours to write; an
    // unknown signal leaves it as it is.
    unsafe { libc::sigaction(signal, std::ptr::null(), &mut action) };
    action.sa_sigaction == libc::SIG_IGN
}

/// Whether the first thread's stack is limited to less than others have (`ulimit -s 64`).
pub fn has_small_stack() -> bool {
    #[cfg(unix)]
    {
        use nix::sys::resource::{Resource, getrlimit};
        getrlimit(Resource::RLIMIT_STACK).is_ok_and(|(limit, _)| limit < 1 << 20)
    }
    #[cfg(not(unix))]
    false
}

#[cfg(unix)]
pub use at_start::is_open;

/// Standard output and standard error before Rust's runtime opened `/dev/null` in place of closed
/// descriptors.
#[cfg(unix)]
mod at_start {
    use std::sync::atomic::{AtomicBool, Ordering};

    static ARE_OPEN: [AtomicBool; 2] = [AtomicBool::new(true), AtomicBool::new(true)];

    #[cfg_attr(miri, allow(dead_code))]
    extern "C" fn look() {
        for (descriptor, is_open) in [1, 2].into_iter().zip(&ARE_OPEN) {
            // SAFETY: asks for the flags of a descriptor, which need not exist.
            let flags = unsafe { libc::fcntl(descriptor, libc::F_GETFL) };
            is_open.store(flags != -1 && flags & libc::O_ACCMODE != libc::O_RDONLY, Ordering::Relaxed);
        }
    }

    /// Called by the system before main; `look` needs nothing that main would have to prepare. Miri
    /// has no such descriptors.
    #[used]
    #[cfg(not(miri))]
    #[cfg_attr(target_vendor = "apple", unsafe(link_section = "__DATA,__mod_init_func"))]
    #[cfg_attr(not(target_vendor = "apple"), unsafe(link_section = ".init_array"))]
    static LOOK: extern "C" fn() = look;

    /// Whether standard output (1) or standard error (2) was open when the process began. If not,
    /// what is printed there is lost without an error.
    pub fn is_open(descriptor: usize) -> bool {
        ARE_OPEN[descriptor - 1].load(Ordering::Relaxed)
    }
}

/// Whether these were closed is unknown on this system.
#[cfg(not(unix))]
pub fn is_open(_: usize) -> bool {
    true
}

/// A thread to be started, if there is memory for it: where that ends while a thread begins, the
/// process does.
pub fn new_thread() -> io::Result<std::thread::Builder> {
    /// Its stack, what Rust and the system need before its first instruction, and what other
    /// threads take meanwhile.
    const ROOM: usize = 16 << 20;
    drop(memmap2::MmapMut::map_anon(ROOM)?);
    Ok(std::thread::Builder::new())
}

/// Makes streaming stores visible to other threads before any later store.
#[cfg(target_arch = "x86_64")]
pub fn store_fence() {
    // SAFETY: every x86-64 CPU has SSE.
    unsafe { std::arch::x86_64::_mm_sfence() }
}

/// No kernel has streaming stores here.
#[cfg(not(target_arch = "x86_64"))]
pub fn store_fence() {}

/// Pins the calling thread to its current core, and returns that.
pub fn pin_to_this_core() -> io::Result<usize> {
    let core = current_core().ok_or_else(|| io::Error::other("which core this is cannot be known"))?;
    pin_to(core).map(|()| core)
}

/// Pins the calling thread to that core.
#[cfg(target_os = "linux")]
pub fn pin_to(core: usize) -> io::Result<()> {
    let mut set = CpuSet::new();
    set.set(core).map_err(|_| io::Error::other("this core's number is beyond what a set of cores holds"))?;
    Cores(set).allow()
}

/// Pinning is not supported on this system.
#[cfg(not(target_os = "linux"))]
pub fn pin_to(_: usize) -> io::Result<()> {
    Err(io::Error::new(io::ErrorKind::Unsupported, "pinning a thread to a core needs Linux"))
}

/// The cores that this thread may use, at least 1.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Memory for this many values, on large pages as far as these lie within it.
pub fn room<T>(count: usize) -> Vec<T> {
    let mut room = Vec::with_capacity(count);
    large_pages(&mut room);
    room
}

/// Requests large pages for the memory of a vector, as far as they lie within it. Only a hint.
#[cfg(target_os = "linux")]
fn large_pages<T>(room: &mut Vec<T>) {
    const LARGE: usize = 2 << 20;
    let first = room.as_mut_ptr() as usize;
    let end = first + room.capacity() * size_of::<T>();
    let (first, end) = (first.next_multiple_of(LARGE), end / LARGE * LARGE);
    if first < end {
        // SAFETY: whole pages within the vector's own memory; which size the system makes them of
        // changes no content.
        unsafe { libc::madvise(first as *mut libc::c_void, end - first, libc::MADV_HUGEPAGE) };
    }
}

/// Large pages are not supported on this system.
#[cfg(not(target_os = "linux"))]
fn large_pages<T>(_: &mut Vec<T>) {}

/// The cores that a thread may run on.
#[cfg(target_os = "linux")]
#[derive(Clone, Copy)]
pub struct Cores(CpuSet);

#[cfg(target_os = "linux")]
impl Cores {
    /// The cores of the calling thread.
    pub fn of_this_thread() -> io::Result<Self> {
        Ok(Cores(sched_getaffinity(Pid::from_raw(0))?))
    }

    /// The number of cores, at least 1.
    pub fn count(&self) -> usize {
        (0..CpuSet::count()).filter(|core| self.0.is_set(*core) == Ok(true)).count().max(1)
    }

    /// Lets the calling thread, and those that it starts from now on, run on them.
    pub fn allow(&self) -> io::Result<()> {
        Ok(sched_setaffinity(Pid::from_raw(0), &self.0)?)
    }
}

/// Without pinning, all cores are always allowed.
#[cfg(not(target_os = "linux"))]
#[derive(Clone, Copy)]
pub struct Cores(());

#[cfg(not(target_os = "linux"))]
impl Cores {
    pub fn of_this_thread() -> io::Result<Self> {
        Ok(Cores(()))
    }

    /// The number of cores.
    pub fn count(&self) -> usize {
        cores()
    }

    /// Nothing to do.
    pub fn allow(&self) -> io::Result<()> {
        Ok(())
    }
}

/// What a thread or the ended processes have used; nothing where the system does not count it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// Pages touched for the first time or read from disk.
    pub page_faults: u64,
    /// Involuntary context switches.
    pub forced: u64,
    /// Voluntary ones, to wait.
    pub own: u64,
    /// Time of the CPU, in whole microseconds.
    pub cpu_time: Duration,
}

impl Usage {
    /// Of the calling thread, or of its process where threads are not counted.
    pub fn of_this_thread() -> Self {
        #[cfg(target_os = "linux")]
        return Usage::of(UsageWho::RUSAGE_THREAD);
        #[cfg(all(unix, not(target_os = "linux")))]
        return Usage { forced: 0, own: 0, ..Usage::of(UsageWho::RUSAGE_SELF) };
        #[cfg(not(unix))]
        Usage::default()
    }

    /// Of the processes that this one has started and waited for.
    pub fn of_children() -> Self {
        #[cfg(unix)]
        return Usage::of(UsageWho::RUSAGE_CHILDREN);
        #[cfg(not(unix))]
        Usage::default()
    }

    #[cfg(unix)]
    fn of(who: UsageWho) -> Self {
        let Ok(usage) = getrusage(who) else { return Usage::default() };
        let count = |n: libc::c_long| n.try_into().unwrap_or(0);
        Usage {
            page_faults: count(usage.minor_page_faults() + usage.major_page_faults()),
            forced: count(usage.involuntary_context_switches()),
            own: count(usage.voluntary_context_switches()),
            cpu_time: Duration::from_micros(
                (usage.user_time() + usage.system_time()).num_microseconds().unsigned_abs(),
            ),
        }
    }
}

/// The CPU time of the calling thread, none where it is not counted.
pub fn thread_cpu_time() -> Duration {
    #[cfg(unix)]
    return nix::time::clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).map_or(Duration::ZERO, Duration::from);
    #[cfg(not(unix))]
    Duration::ZERO
}

/// Multiplications in a round of [`multiply_in_chain`].
pub const CHAIN_LINKS: u32 = 20;
/// Cycles of the core's own clock from one 32-bit `imul` to the next that needs its result: 3 on
/// every Intel core since Nehalem and every AMD core since Zen.
pub const CHAIN_LATENCY: u32 = 3;

/// `rounds` x [`CHAIN_LINKS`] multiplications, each of which needs the previous result: as many
/// times [`CHAIN_LATENCY`] cycles of the core's clock, whatever the rate of the time-stamp counter.
/// `rounds` is at least 1.
#[cfg(target_arch = "x86_64")]
pub fn multiply_in_chain(rounds: u32) {
    let rounds = rounds.max(1);
    // SAFETY: registers alone, which are named.
    unsafe {
        std::arch::asm!(
            "2:",
            ".rept {links}",
            "imul {x:e}, {x:e}",
            ".endr",
            "dec {rounds:e}",
            "jnz 2b",
            links = const CHAIN_LINKS,
            x = inout(reg) 3_u32 => _,
            rounds = inout(reg) rounds => _,
            options(nomem, nostack),
        );
    }
}

/// Does nothing: without a time-stamp counter the core's own clock cannot be measured.
#[cfg(not(target_arch = "x86_64"))]
pub fn multiply_in_chain(_rounds: u32) {}

/// A slice in new pages: the first write to each page causes a page fault.
#[cfg(feature = "lab")]
pub struct Fresh<T: Plain> {
    pages: memmap2::MmapMut,
    of: PhantomData<T>,
}

#[cfg(feature = "lab")]
impl<T: Plain> Fresh<T> {
    /// Memory for `len` values, at least 1, all bits 0.
    pub fn new(len: usize) -> io::Result<Self> {
        let bytes = len.checked_mul(size_of::<T>()).filter(|bytes| *bytes > 0);
        let pages = memmap2::MmapMut::map_anon(bytes.ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?)?;
        Ok(Fresh { pages, of: PhantomData })
    }

    /// The values.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        // SAFETY: any bits are a value of a plain type.
        let (before, values, after) = unsafe { self.pages.align_to_mut() };
        assert!(before.is_empty() && after.is_empty(), "pages are aligned for every plain type");
        values
    }
}
