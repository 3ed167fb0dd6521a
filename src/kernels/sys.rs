//! What measuring and planning need of CPU and operating system: the time-stamp counter, pinning and pages.

use std::io;
#[cfg(feature = "lab")]
use std::marker::PhantomData;

#[cfg(feature = "lab")]
use super::types::Plain;

/// The time-stamp counter before timed work: everything earlier is done, nothing later has begun.
#[cfg(target_arch = "x86_64")]
#[inline]
pub fn tsc_start() -> u64 {
    use std::arch::x86_64::{_mm_lfence, _rdtsc};
    // SAFETY: every x86-64 CPU has SSE2 and the counter; where an operating system forbade it, this would be a fault,
    // not undefined behaviour.
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
    // SAFETY: the CPU has the instruction, as just asked; else as in tsc_start. `core` is ours to write.
    unsafe {
        let now = __rdtscp(&mut core);
        _mm_lfence();
        now
    }
}

/// The core that runs the calling thread at this moment, if the operating system reports it.
#[cfg(target_os = "linux")]
pub fn current_core() -> Option<usize> {
    // SAFETY: takes nothing, gives a number.
    usize::try_from(unsafe { libc::sched_getcpu() }).ok()
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
    // SAFETY: no new action is given, and the structure for the old one is ours to write; an unknown signal leaves it as it is.
    unsafe { libc::sigaction(signal, std::ptr::null(), &mut action) };
    action.sa_sigaction == libc::SIG_IGN
}

/// Whether the first thread's stack is limited to less than others have (`ulimit -s 64`).
pub fn has_small_stack() -> bool {
    #[cfg(unix)]
    {
        let mut limit = libc::rlimit { rlim_cur: libc::RLIM_INFINITY, rlim_max: libc::RLIM_INFINITY };
        // SAFETY: the structure is ours to write.
        unsafe { libc::getrlimit(libc::RLIMIT_STACK, &mut limit) };
        limit.rlim_cur < 1 << 20
    }
    #[cfg(not(unix))]
    false
}

#[cfg(unix)]
pub use at_start::is_standard_output_open;

/// Standard output before Rust's runtime opened `/dev/null` in place of a closed descriptor.
#[cfg(unix)]
mod at_start {
    use std::sync::atomic::{AtomicBool, Ordering};

    static IS_OPEN: AtomicBool = AtomicBool::new(true);

    #[cfg_attr(miri, allow(dead_code))]
    extern "C" fn look() {
        // SAFETY: asks for the flags of a descriptor, which need not exist.
        let flags = unsafe { libc::fcntl(1, libc::F_GETFL) };
        IS_OPEN.store(flags != -1 && flags & libc::O_ACCMODE != libc::O_RDONLY, Ordering::Relaxed);
    }

    /// Called by the system before main; `look` needs nothing that main would have to prepare. Miri has no such descriptors.
    #[used]
    #[cfg(not(miri))]
    #[cfg_attr(target_vendor = "apple", unsafe(link_section = "__DATA,__mod_init_func"))]
    #[cfg_attr(not(target_vendor = "apple"), unsafe(link_section = ".init_array"))]
    static LOOK: extern "C" fn() = look;

    /// Whether standard output was open when the process began. If not, printed output is lost without an error.
    pub fn is_standard_output_open() -> bool {
        IS_OPEN.load(Ordering::Relaxed)
    }
}

/// Whether standard output was closed is unknown on this system.
#[cfg(not(unix))]
pub fn is_standard_output_open() -> bool {
    true
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
    // SAFETY: a set of bits, for which all 0 is a value.
    let mut set: libc::cpu_set_t = unsafe { std::mem::zeroed() };
    if core >= 8 * size_of_val(&set) {
        return Err(io::Error::other("this core's number is beyond what a set of cores holds"));
    }
    // SAFETY: the core is within the set, as just checked.
    unsafe { libc::CPU_SET(core, &mut set) };
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
        // SAFETY: whole pages within the vector's own memory; which size the system makes them of changes no content.
        unsafe { libc::madvise(first as *mut libc::c_void, end - first, libc::MADV_HUGEPAGE) };
    }
}

/// Large pages are not supported on this system.
#[cfg(not(target_os = "linux"))]
fn large_pages<T>(_: &mut Vec<T>) {}

/// The cores that a thread may run on.
#[cfg(target_os = "linux")]
#[derive(Clone, Copy)]
pub struct Cores(libc::cpu_set_t);

#[cfg(target_os = "linux")]
impl Cores {
    /// The cores of the calling thread.
    pub fn of_this_thread() -> io::Result<Self> {
        // SAFETY: a set of bits, for which all 0 is a value.
        let mut set: libc::cpu_set_t = unsafe { std::mem::zeroed() };
        // SAFETY: 0 is the calling thread, the set is ours to write and its size is given.
        match unsafe { libc::sched_getaffinity(0, size_of_val(&set), &mut set) } {
            0 => Ok(Cores(set)),
            _ => Err(io::Error::last_os_error()),
        }
    }

    /// The number of cores, at least 1.
    pub fn count(&self) -> usize {
        // SAFETY: the set was filled when it was made.
        (unsafe { libc::CPU_COUNT(&self.0) }).try_into().unwrap_or(1).max(1)
    }

    /// Lets the calling thread, and those that it starts from now on, run on them.
    pub fn allow(&self) -> io::Result<()> {
        // SAFETY: 0 is the calling thread, the set is ours and its size is given.
        match unsafe { libc::sched_setaffinity(0, size_of_val(&self.0), &self.0) } {
            0 => Ok(()),
            _ => Err(io::Error::last_os_error()),
        }
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

/// What a thread, a process or its children have used.
#[cfg(unix)]
fn usage(who: libc::c_int) -> libc::rusage {
    // SAFETY: numbers, for which all bits 0 are a value.
    let mut usage: libc::rusage = unsafe { std::mem::zeroed() };
    // SAFETY: the structure is ours to write. It cannot fail with a valid `who`; if it did, the zeros would remain.
    unsafe { libc::getrusage(who, &mut usage) };
    usage
}

/// The page faults so far of the calling thread (or of its process, if threads are not counted): pages touched for the
/// first time or read from disk.
#[cfg(unix)]
pub fn page_faults() -> u64 {
    #[cfg(target_os = "linux")]
    const WHO: libc::c_int = libc::RUSAGE_THREAD;
    #[cfg(not(target_os = "linux"))]
    const WHO: libc::c_int = libc::RUSAGE_SELF;
    let usage = usage(WHO);
    (usage.ru_minflt + usage.ru_majflt).try_into().unwrap_or(0)
}

/// Page faults are not counted on this system.
#[cfg(not(unix))]
pub fn page_faults() -> u64 {
    0
}

/// The context switches of a thread.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Switches {
    /// Involuntary ones.
    pub forced: u64,
    /// Voluntary ones, to wait.
    pub own: u64,
}

/// The switches of the calling thread so far; none if they are not counted per thread.
#[cfg(target_os = "linux")]
pub fn switches() -> Switches {
    let usage = usage(libc::RUSAGE_THREAD);
    let count = |n: libc::c_long| n.try_into().unwrap_or(0);
    Switches { forced: count(usage.ru_nivcsw), own: count(usage.ru_nvcsw) }
}

/// Switches are not counted on this system.
#[cfg(not(target_os = "linux"))]
pub fn switches() -> Switches {
    Switches::default()
}

/// The CPU time of the calling thread.
#[cfg(unix)]
pub fn thread_cpu_time() -> std::time::Duration {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: the structure is ours to write. POSIX has the clock; without it the zeros would remain.
    unsafe { libc::clock_gettime(libc::CLOCK_THREAD_CPUTIME_ID, &mut time) };
    std::time::Duration::new(time.tv_sec.try_into().unwrap_or(0), time.tv_nsec.try_into().unwrap_or(0))
}

/// The CPU time of the processes that this one has started and waited for.
#[cfg(unix)]
pub fn children_cpu_time() -> std::time::Duration {
    let usage = usage(libc::RUSAGE_CHILDREN);
    let seconds = |time: libc::timeval| {
        let (seconds, micros) = (time.tv_sec.try_into().unwrap_or(0), time.tv_usec.try_into().unwrap_or(0));
        std::time::Duration::from_secs(seconds) + std::time::Duration::from_micros(micros)
    };
    seconds(usage.ru_utime) + seconds(usage.ru_stime)
}

/// The time of other processes is unknown on this system.
#[cfg(not(unix))]
pub fn children_cpu_time() -> std::time::Duration {
    std::time::Duration::ZERO
}

/// The time of a thread is unknown on this system.
#[cfg(not(unix))]
pub fn thread_cpu_time() -> std::time::Duration {
    std::time::Duration::ZERO
}

/// Multiplications in a round of [`multiply_in_chain`].
pub const CHAIN_LINKS: u32 = 20;
/// Cycles of the core's own clock from one 32-bit `imul` to the next that needs its result: 3 on every Intel core since
/// Nehalem and every AMD core since Zen.
pub const CHAIN_LATENCY: u32 = 3;

/// `rounds` x [`CHAIN_LINKS`] multiplications, each of which needs the previous result: as many times [`CHAIN_LATENCY`]
/// cycles of the core's clock, whatever the rate of the time-stamp counter. `rounds` is at least 1.
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

/// Without a counter there is nothing to compare it with.
#[cfg(not(target_arch = "x86_64"))]
pub fn multiply_in_chain(_rounds: u32) {}

/// A slice in untouched pages: the first write to each is a page fault.
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
