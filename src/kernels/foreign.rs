//! Code that a user brings: a process of its own for it, and its functions, called like ours.
//!
//! Nothing can be known of such code: it may write anywhere, and the process with it. So only a
//! process that was started for it loads it, which has nothing to lose, and whose answers its
//! parent takes for what they are.

use std::ffi::{CStr, CString};
use std::fs::File;
use std::io;
use std::os::fd::AsFd;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

use super::checked::{Code, Registers};
use super::code;
use super::crash;
use super::isa::Isa;
use super::kernel::{CheckedCall, Crashed, Kernel, Kind, examine};
use super::paper::{OpRef, Trace};

/// What a process for foreign code may use.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Seconds that a call may last, and that the process may compute.
    pub seconds: u32,
    /// Bytes of memory that it may have in all.
    pub memory: u64,
}

/// The proof that this process was started to run foreign code, and nothing else.
pub struct OwnProcess {
    id: u32,
    handlers: Vec<usize>,
}

impl OwnProcess {
    /// Makes this process one for foreign code: it ends with its parent and at its limits, leaves
    /// no core file, and what the code prints goes to standard error. The report to the parent goes
    /// to the file that is returned, which was standard output.
    ///
    /// # Errors
    /// If the system refuses one of these.
    pub fn begin(limits: Limits) -> io::Result<(Self, File)> {
        #[cfg(target_os = "linux")]
        // SAFETY: changes nothing but which signal this process gets when its parent ends.
        unsafe {
            libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL);
        }
        let report = File::from(io::stdout().as_fd().try_clone_to_owned()?);
        // SAFETY: two open descriptors; whoever holds standard output in Rust writes to standard
        // error from now on.
        if unsafe { libc::dup2(2, 1) } == -1 {
            return Err(io::Error::last_os_error());
        }
        let most = [
            (libc::RLIMIT_CPU, 2 * u64::from(limits.seconds) + 60),
            (libc::RLIMIT_AS, limits.memory),
            (libc::RLIMIT_CORE, 0),
            (libc::RLIMIT_FSIZE, 64 << 20),
        ];
        for (resource, most) in most {
            let limit = libc::rlimit { rlim_cur: most as libc::rlim_t, rlim_max: most as libc::rlim_t };
            // SAFETY: a structure of two numbers, which is only read. What is not limited is so by
            // the parent's clock.
            unsafe { libc::setrlimit(resource, &limit) };
        }
        let mut own = OwnProcess { id: std::process::id(), handlers: Vec::new() };
        crash::watch_timers();
        own.handlers = handlers();
        Ok((own, report))
    }

    /// Whether this is a copy of the process, which the foreign code has made by `fork`.
    pub fn is_copy(&self) -> bool {
        std::process::id() != self.id
    }

    /// Ends the process at once, with nothing of it run twice.
    pub fn end(&self) -> ! {
        // SAFETY: ends this process, whatever state it is in.
        unsafe { libc::_exit(0) }
    }

    /// The signals whose handling the foreign code has changed, by their numbers.
    pub fn changed_handlers(&self) -> Vec<usize> {
        let now = handlers();
        (0..now.len()).filter(|signal| now[*signal] != self.handlers[*signal]).map(|signal| signal + 1).collect()
    }

    /// Interrupts a checked call as if it had crashed, once this process has had the CPU for that
    /// many seconds more.
    pub fn allow(&self, seconds: u32) {
        let value = libc::timeval { tv_sec: seconds.into(), tv_usec: 0 };
        let timer = libc::itimerval { it_value: value, it_interval: libc::timeval { tv_sec: 0, tv_usec: 0 } };
        // SAFETY: sets a timer of this process, whose signal is handled since begin(); the
        // structure is only read.
        unsafe { libc::setitimer(libc::ITIMER_PROF, &timer, std::ptr::null_mut()) };
    }
}

/// What each signal does here.
fn handlers() -> Vec<usize> {
    let handler = |signal| {
        // SAFETY: numbers and an address that may be null, for which all bits 0 are a value.
        let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
        // SAFETY: no new action is given, and the structure for the old one is ours to write.
        unsafe { libc::sigaction(signal, std::ptr::null(), &mut action) };
        action.sa_sigaction
    };
    (1..=31).map(handler).collect()
}

/// The shared object of a user, in this process for good.
pub struct Loaded {
    handle: *mut libc::c_void,
    /// What its addresses count from.
    base: usize,
}

impl Loaded {
    /// Loads a shared object, whose initialisers run.
    ///
    /// # Errors
    /// What the system's loader says against it.
    pub fn open(path: &Path, _own: &OwnProcess) -> Result<Self, String> {
        let name = CString::new(path.as_os_str().as_bytes()).map_err(|error| error.to_string())?;
        // SAFETY: a name that ends in 0. What the initialisers do is the user's affair, in a
        // process for it.
        let handle = unsafe { libc::dlopen(name.as_ptr(), libc::RTLD_NOW | libc::RTLD_LOCAL) };
        if handle.is_null() {
            // SAFETY: after a failure it is a text that ends in 0, until the next call of the
            // loader by this thread.
            let error = unsafe { CStr::from_ptr(libc::dlerror()) };
            return Err(error.to_string_lossy().into_owned());
        }
        let base = code::base_of(&name).unwrap_or(0);
        Ok(Loaded { handle, base })
    }

    /// The function of that name; `offset` is its address in the file, by which one is found that
    /// is not exported.
    pub fn function(&self, symbol: &str, offset: u64) -> Option<Function> {
        let name = CString::new(symbol).ok()?;
        // SAFETY: a handle of the loader, which is never closed, and a name that ends in 0.
        let exported = unsafe { libc::dlsym(self.handle, name.as_ptr()) } as usize;
        let address = match (exported, self.base) {
            (0, 0) => return None,
            (0, base) => base + offset as usize,
            (exported, _) => exported,
        };
        // SAFETY: not null; what is there is called only as foreign code is.
        let code = unsafe { std::mem::transmute::<usize, Code>(address) };
        // A symbol lives as long as its code: for good.
        Some(Function { code, symbol: String::leak(symbol.to_owned()) })
    }
}

/// A function that a user brings, with the convention of ours.
#[derive(Clone, Copy)]
pub struct Function {
    code: Code,
    symbol: &'static str,
}

/// What became of a call.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// None if the function returned.
    pub crash: Option<Box<Crashed>>,
    /// The rules that it broke.
    pub broken: Vec<CheckedCall>,
}

impl Function {
    pub fn address(self) -> usize {
        self.code as usize
    }

    pub fn symbol(self) -> &'static str {
        self.symbol
    }

    /// Calls it with these numbers in its argument registers: addresses, as far as it takes any.
    pub fn call(self, registers: [u64; 6]) {
        // SAFETY: foreign code, in a process of its own: there is a `Loaded` only where there was
        // an `OwnProcess`.
        unsafe { self.kernel::<()>().enter(registers as Registers) };
    }

    /// The same by a checked call, where the assembly for these is built.
    pub fn examine(self, registers: [u64; 6]) -> Outcome {
        if !Isa::Sse41.built() {
            self.call(registers);
            return Outcome { crash: None, broken: Vec::new() };
        }
        let examined = examine(|| self.call(registers));
        Outcome { crash: examined.result.err(), broken: examined.broken }
    }

    /// As an operation that takes and gives what another does.
    pub fn like(self, operation: OpRef) -> OpRef {
        match operation {
            OpRef::Vector(_) => OpRef::Vector(self.kernel()),
            OpRef::Scale(_) => OpRef::Scale(self.kernel()),
            OpRef::Scalar(_) => OpRef::Scalar(self.kernel()),
            OpRef::Sphere(_) => OpRef::Sphere(self.kernel()),
            OpRef::Triangle(_) => OpRef::Triangle(self.kernel()),
            OpRef::Lambert(_) => OpRef::Lambert(self.kernel()),
        }
    }

    /// As Algorithm 1 over rows.
    pub fn trace(self) -> Trace {
        self.kernel()
    }

    fn kernel<K: Kind>(self) -> Kernel<K> {
        // SAFETY: foreign code, of which nothing can be asked: its process is the proof that it may
        // do anything.
        unsafe { Kernel::new(self.code, self.symbol) }
    }
}

/// Ends a process that leads a group, and all of this group.
pub fn end_group(leader: &std::process::Child) {
    let Ok(id) = libc::pid_t::try_from(leader.id()) else { return };
    // SAFETY: sends a signal to the group that a process of ours leads, which has not been waited
    // for, or had members.
    unsafe { libc::kill(-id, libc::SIGKILL) };
}

/// From now on this process is the parent of what its children leave behind, so that
/// [`end_orphans`] finds it: a copy of foreign code in a group of its own among them.
pub fn adopt_orphans() {
    #[cfg(target_os = "linux")]
    // SAFETY: changes nothing but who becomes the parent of orphans.
    unsafe {
        libc::prctl(libc::PR_SET_CHILD_SUBREAPER, 1);
    }
}

/// Ends all processes that this one is the parent of, where the system lists them.
pub fn end_orphans() {
    /// Of code that starts processes faster than they are ended, no more is tried.
    const MOST_ROUNDS: u32 = 50;
    for _ in 0..MOST_ROUNDS {
        let children = children();
        if children.is_empty() {
            return;
        }
        for child in children {
            // SAFETY: a child of this process, which nobody else waits for.
            unsafe {
                libc::kill(child, libc::SIGKILL);
                libc::waitpid(child, std::ptr::null_mut(), 0);
            }
        }
    }
}

/// The processes that this one is the parent of.
fn children() -> Vec<libc::pid_t> {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let lists = tasks.filter_map(|task| std::fs::read_to_string(task.path().join("children")).ok());
    lists.flat_map(|list| list.split_whitespace().filter_map(|id| id.parse().ok()).collect::<Vec<_>>()).collect()
}
