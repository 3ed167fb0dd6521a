//! What measuring and planning need from the CPU and the operating system: the time-stamp counter,
//! pinning, threads, pages.

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

/// The time-stamp counter before timed work. All earlier instructions have completed, and no later
/// one has begun.
#[cfg(target_arch = "x86_64")]
#[inline]
pub fn tsc_start() -> u64 {
    use std::arch::x86_64::{_mm_lfence, _rdtsc};
    // SAFETY: every x86-64 CPU has SSE2 and the counter. If an operating system forbids reading it,
    // the result is a fault and not undefined behaviour.
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
    // SAFETY: the CPU has the instruction, as just checked; otherwise as in tsc_start. `core` is
    // ours to write.
    unsafe {
        let now = __rdtscp(&mut core);
        _mm_lfence();
        now
    }
}

/// The core that runs the calling thread now, if the operating system reports it.
#[cfg(target_os = "linux")]
pub fn current_core() -> Option<usize> {
    nix::sched::sched_getcpu().ok()
}

/// None: this system does not report which core runs a thread.
#[cfg(not(target_os = "linux"))]
pub fn current_core() -> Option<usize> {
    None
}

/// Whether this process was started with a signal ignored, as `nohup` does with SIGHUP.
#[cfg(unix)]
pub fn is_ignored(signal: i32) -> bool {
    // SAFETY: a structure of numbers and an address that may be null, for which all bits 0 are a
    // value.
    let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
    // SAFETY: no new action is set, and the structure for the old one is ours to write. An unknown
    // signal leaves it unchanged.
    unsafe { libc::sigaction(signal, std::ptr::null(), &mut action) };
    action.sa_sigaction == libc::SIG_IGN
}

/// Whether the stack of the first thread is limited to less than that of other threads (`ulimit -s
/// 64`).
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

/// Whether standard output and standard error were open before Rust's runtime opened `/dev/null` in
/// place of closed descriptors.
#[cfg(unix)]
mod at_start {
    use std::sync::atomic::{AtomicBool, Ordering};

    static ARE_OPEN: [AtomicBool; 2] = [AtomicBool::new(true), AtomicBool::new(true)];

    #[cfg_attr(miri, allow(dead_code))]
    extern "C" fn look() {
        for (descriptor, is_open) in [1, 2].into_iter().zip(&ARE_OPEN) {
            // SAFETY: only asks for the flags of a descriptor, which need not exist.
            let flags = unsafe { libc::fcntl(descriptor, libc::F_GETFL) };
            is_open.store(flags != -1 && flags & libc::O_ACCMODE != libc::O_RDONLY, Ordering::Relaxed);
        }
    }

    /// The system calls this before main; `look` needs nothing that main would have to prepare.
    /// Miri has no such descriptors.
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

/// Assumes that both were open, since this system does not tell.
#[cfg(not(unix))]
pub fn is_open(_: usize) -> bool {
    true
}

/// A builder for a new thread, if there is enough memory for one. If memory runs out while a thread
/// starts, the process is aborted, so that this is checked before.
pub fn new_thread() -> io::Result<std::thread::Builder> {
    /// The memory for the stack, for what Rust and the system need before the thread's first
    /// instruction, and for what other threads allocate meanwhile.
    const ROOM: usize = 16 << 20;
    drop(memmap2::MmapMut::map_anon(ROOM)?);
    Ok(std::thread::Builder::new())
}

/// Makes non-temporal stores visible to other threads before any later store.
#[cfg(target_arch = "x86_64")]
pub fn store_fence() {
    // SAFETY: every x86-64 CPU has SSE.
    unsafe { std::arch::x86_64::_mm_sfence() }
}

/// Does nothing: on this architecture no kernel uses non-temporal stores.
#[cfg(not(target_arch = "x86_64"))]
pub fn store_fence() {}

/// Pins the calling thread to its current core, and returns that core.
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

/// Memory for `count` values, on large pages as far as these fit into it.
pub fn room<T>(count: usize) -> Vec<T> {
    let mut room = Vec::with_capacity(count);
    large_pages(&mut room);
    room
}

/// Requests large pages for the memory of a vector, as far as they fit into it. This is only a
/// hint.
#[cfg(target_os = "linux")]
fn large_pages<T>(room: &mut Vec<T>) {
    const LARGE: usize = 2 << 20;
    let first = room.as_mut_ptr() as usize;
    let end = first + room.capacity() * size_of::<T>();
    let (first, end) = (first.next_multiple_of(LARGE), end / LARGE * LARGE);
    if first < end {
        // SAFETY: whole pages within the vector's own memory; their size does not change their
        // content.
        unsafe { libc::madvise(first as *mut libc::c_void, end - first, libc::MADV_HUGEPAGE) };
    }
}

/// Large pages are not supported on this system.
#[cfg(not(target_os = "linux"))]
fn large_pages<T>(_: &mut Vec<T>) {}

/// A set of cores that a thread may run on.
#[cfg(target_os = "linux")]
#[derive(Clone, Copy)]
pub struct Cores(CpuSet);

#[cfg(target_os = "linux")]
impl Cores {
    /// The cores that the calling thread may run on.
    pub fn of_this_thread() -> io::Result<Self> {
        Ok(Cores(sched_getaffinity(Pid::from_raw(0))?))
    }

    /// The number of cores, at least 1.
    pub fn count(&self) -> usize {
        (0..CpuSet::count()).filter(|core| self.0.is_set(*core) == Ok(true)).count().max(1)
    }

    /// Lets the calling thread, and threads that it starts from now on, run on these cores.
    pub fn allow(&self) -> io::Result<()> {
        Ok(sched_setaffinity(Pid::from_raw(0), &self.0)?)
    }
}

/// All cores, since threads cannot be pinned on this system.
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

    /// Does nothing, since threads cannot be pinned.
    pub fn allow(&self) -> io::Result<()> {
        Ok(())
    }
}

/// What a thread, or the processes that have ended, have used. Zero where the system does not count
/// it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// The number of pages that were accessed for the first time or read from disk.
    pub page_faults: u64,
    /// The number of involuntary context switches.
    pub forced: u64,
    /// The number of voluntary context switches, to wait.
    pub own: u64,
    /// CPU time, in whole microseconds.
    pub cpu_time: Duration,
}

impl Usage {
    /// The usage of the calling thread, or of its process where the system does not count by
    /// thread.
    pub fn of_this_thread() -> Self {
        #[cfg(target_os = "linux")]
        return Usage::of(UsageWho::RUSAGE_THREAD);
        #[cfg(all(unix, not(target_os = "linux")))]
        return Usage { forced: 0, own: 0, ..Usage::of(UsageWho::RUSAGE_SELF) };
        #[cfg(not(unix))]
        Usage::default()
    }

    /// The usage of the processes that this one has started and waited for.
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

/// The CPU time of the calling thread; 0 where the system does not count it.
pub fn thread_cpu_time() -> Duration {
    #[cfg(unix)]
    return nix::time::clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).map_or(Duration::ZERO, Duration::from);
    #[cfg(not(unix))]
    Duration::ZERO
}

/// The number of multiplications in a round of [`multiply_in_chain`].
pub const CHAIN_LINKS: u32 = 20;
/// The latency in core cycles of a 32-bit `imul`: 3 on every Intel core since Nehalem and every AMD
/// core since Zen.
pub const CHAIN_LATENCY: u32 = 3;

/// Executes `rounds` x [`CHAIN_LINKS`] multiplications, each of which needs the previous result.
/// They take [`CHAIN_LATENCY`] cycles of the core's clock each, whatever the rate of the time-stamp
/// counter. `rounds` is at least 1.
#[cfg(target_arch = "x86_64")]
pub fn multiply_in_chain(rounds: u32) {
    let rounds = rounds.max(1);
    // SAFETY: only uses registers, which are declared.
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
pub struct FreshPages<T: Plain> {
    pages: memmap2::MmapMut,
    of: PhantomData<T>,
}

#[cfg(feature = "lab")]
impl<T: Plain> FreshPages<T> {
    /// New memory for `len` values, at least 1, with all bits 0.
    pub fn new(len: usize) -> io::Result<Self> {
        let bytes = len.checked_mul(size_of::<T>()).filter(|bytes| *bytes > 0);
        let pages = memmap2::MmapMut::map_anon(bytes.ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?)?;
        Ok(FreshPages { pages, of: PhantomData })
    }

    /// The values.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        // SAFETY: any bits are a value of a plain type.
        let (before, values, after) = unsafe { self.pages.align_to_mut() };
        assert!(before.is_empty() && after.is_empty(), "pages are aligned for every plain type");
        values
    }
}
