//! Code that a user provides: a process in which it runs, and calls of its functions.
//!
//! Nothing can be assumed of such code: it may write to any memory of its process. It is therefore
//! only loaded by a process that was started for it, which has nothing to lose, and whose parent
//! trusts none of its answers.

use std::ffi::{CStr, CString};
use std::fs::File;
use std::io;
use std::os::fd::AsFd;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;
use std::process::{Child, Command};

use super::checked::{Code, Registers};
use super::code;
use super::crash;
use super::isa::Isa;
use super::kernel::{CheckedCall, Crashed, Kernel, Kind, examine};
use super::paper::{OpRef, Trace};

/// What a process for foreign code may consume.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// The seconds of the CPU that a call may take; the process may take twice as many and a
    /// minute.
    pub seconds: u32,
    /// The bytes of memory that the process may have.
    pub memory: u64,
}

/// The variable that marks a process for foreign code. Its value is the parent's process number.
const STARTED_BY: &str = "RAYO_FOREIGN_CODE_FOR";

/// Makes `command` start a process that may call [`OwnProcess::begin`].
pub fn mark_for_foreign_code(command: &mut Command) {
    command.env(STARTED_BY, std::process::id().to_string());
}

/// Proof that this process was started to run foreign code and nothing else.
pub struct OwnProcess {
    id: u32,
    handlers: Vec<usize>,
}

impl OwnProcess {
    /// Turns this process into one for foreign code: it ends with its parent and at its limits,
    /// leaves no core file, and sends what the code prints to standard error. The returned file,
    /// which was standard output, is for the report to the parent.
    ///
    /// Foreign code may break all that Rust promises about this process. So a process can only
    /// become one if its parent has [marked](mark_for_foreign_code) it for this alone: it holds
    /// nothing that anybody relies on, and its parent takes its report for that of a stranger.
    ///
    /// # Errors
    /// If the parent has not started this process for foreign code, or if the system refuses one of
    /// the limits.
    pub fn begin(limits: Limits) -> io::Result<(Self, File)> {
        #[cfg(target_os = "linux")]
        // SAFETY: only changes which signal this process gets when its parent ends.
        unsafe {
            libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL);
        }
        let parent = std::os::unix::process::parent_id().to_string();
        if std::env::var(STARTED_BY) != Ok(parent) {
            return Err(io::Error::other("only `rayo try` itself starts a process for foreign code"));
        }
        let report = File::from(io::stdout().as_fd().try_clone_to_owned()?);
        // SAFETY: both descriptors are open. Rust code that holds standard output writes to
        // standard error from now on.
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
            // SAFETY: the structure of two numbers is only read. If a limit cannot be set, the
            // parent's clock enforces the time all the same.
            unsafe { libc::setrlimit(resource, &limit) };
        }
        let mut own = OwnProcess { id: std::process::id(), handlers: Vec::new() };
        crash::watch_timers();
        own.handlers = handlers();
        Ok((own, report))
    }

    /// Whether this is a copy of the process that the foreign code has made by `fork`.
    pub fn is_copy(&self) -> bool {
        std::process::id() != self.id
    }

    /// Ends the process at once, so that no exit handler runs twice.
    pub fn end(&self) -> ! {
        // SAFETY: ends this process, whatever its state.
        unsafe { libc::_exit(0) }
    }

    /// The numbers of the signals whose handlers the foreign code has changed.
    pub fn changed_handlers(&self) -> Vec<usize> {
        let now = handlers();
        (0..now.len()).filter(|signal| now[*signal] != self.handlers[*signal]).map(|signal| signal + 1).collect()
    }

    /// Interrupts the next checked call as if it had crashed, if it has not returned once this
    /// process has used the CPU for that many more seconds.
    pub fn allow(&self, seconds: u32) {
        let value = libc::timeval { tv_sec: seconds.into(), tv_usec: 0 };
        // Then again each tenth of a second: a signal outside of a kernel is ignored.
        let timer = libc::itimerval { it_value: value, it_interval: libc::timeval { tv_sec: 0, tv_usec: 100_000 } };
        // SAFETY: sets a timer of this process, whose signal has been handled since begin(); the
        // structure is only read.
        unsafe { libc::setitimer(libc::ITIMER_PROF, &timer, std::ptr::null_mut()) };
    }
}

/// The addresses of the handlers of all signals.
fn handlers() -> Vec<usize> {
    let handler = |signal| {
        // SAFETY: a structure of numbers and an address that may be null, for which all bits 0 are
        // a value.
        let mut action: libc::sigaction = unsafe { std::mem::zeroed() };
        // SAFETY: no new action is set, and the structure for the old one is ours to write.
        unsafe { libc::sigaction(signal, std::ptr::null(), &mut action) };
        action.sa_sigaction
    };
    (1..=31).map(handler).collect()
}

/// A user's shared object, which stays loaded for the life of the process.
pub struct Loaded {
    handle: *mut libc::c_void,
    /// The address at which the shared object is loaded; addresses in its file count from there.
    base: usize,
}

impl Loaded {
    /// Loads a shared object and runs its initialisers.
    ///
    /// # Errors
    /// The message of the system's loader.
    pub fn open(path: &Path, _own: &OwnProcess) -> Result<Self, String> {
        let name = CString::new(path.as_os_str().as_bytes()).map_err(|error| error.to_string())?;
        // SAFETY: the name ends in 0. Whatever the initialisers do, they do in a process that was
        // started for them.
        let handle = unsafe { libc::dlopen(name.as_ptr(), libc::RTLD_NOW | libc::RTLD_LOCAL) };
        if handle.is_null() {
            // SAFETY: after a failure this is a text that ends in 0, until the next call of the
            // loader by this thread.
            let error = unsafe { CStr::from_ptr(libc::dlerror()) };
            return Err(error.to_string_lossy().into_owned());
        }
        let base = code::base_of(&name).unwrap_or(0);
        Ok(Loaded { handle, base })
    }

    /// The function of that name. If it is not exported, it is found by `offset`, its address in
    /// the file.
    pub fn function(&self, symbol: &str, offset: u64) -> Option<Function> {
        let name = CString::new(symbol).ok()?;
        // SAFETY: the handle of the loader is never closed, and the name ends in 0.
        let exported = unsafe { libc::dlsym(self.handle, name.as_ptr()) } as usize;
        let address = match (exported, self.base) {
            (0, 0) => return None,
            (0, base) => base + offset as usize,
            (exported, _) => exported,
        };
        // SAFETY: the address is not null, and it is only called as foreign code is called.
        let code = unsafe { std::mem::transmute::<usize, Code>(address) };
        // The symbol has to live as long as the code, which is never unloaded.
        Some(Function { code, symbol: String::leak(symbol.to_owned()) })
    }
}

/// A function that a user provides, with the calling convention of our kernels.
#[derive(Clone, Copy)]
pub struct Function {
    code: Code,
    symbol: &'static str,
}

/// The outcome of a call.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// None if the function returned.
    pub crash: Option<Box<Crashed>>,
    /// The rules of the calling convention that the function broke.
    pub broken: Vec<CheckedCall>,
}

impl Function {
    pub fn address(self) -> usize {
        self.code as usize
    }

    pub fn symbol(self) -> &'static str {
        self.symbol
    }

    /// Calls the function with these numbers in the argument registers; for arguments in memory,
    /// they are addresses.
    pub fn call(self, registers: [u64; 6]) {
        // SAFETY: foreign code runs in a process of its own: a `Loaded` exists only where an
        // `OwnProcess` does.
        unsafe { self.kernel::<()>().enter(registers as Registers) };
    }

    /// As [`call`](Self::call), by a checked call, if this build has the assembly for that.
    pub fn examine(self, registers: [u64; 6]) -> Outcome {
        if !Isa::Sse41.built() {
            self.call(registers);
            return Outcome { crash: None, broken: Vec::new() };
        }
        let examined = examine(|| self.call(registers));
        Outcome { crash: examined.result.err(), broken: examined.broken }
    }

    /// The function as an operation with the arguments and the result of `operation`.
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

    /// The function as an implementation of Algorithm 1 over rows.
    pub fn trace(self) -> Trace {
        self.kernel()
    }

    fn kernel<K: Kind>(self) -> Kernel<K> {
        // SAFETY: nothing is required of foreign code: it may do anything, since its process was
        // started for it.
        unsafe { Kernel::new(self.code, self.symbol) }
    }
}

/// Whether a child has ended. It is not waited for, so that its process number stays its own.
///
/// # Errors
/// If the system cannot tell.
pub fn has_ended(child: &Child) -> io::Result<bool> {
    // SAFETY: a structure of numbers and addresses, for which all bits 0 are a value.
    let mut info: libc::siginfo_t = unsafe { std::mem::zeroed() };
    let options = libc::WEXITED | libc::WNOHANG | libc::WNOWAIT;
    // SAFETY: the structure is ours to write, and with WNOWAIT the child can still be waited for.
    if unsafe { libc::waitid(libc::P_PID, child.id(), &mut info, options) } == -1 {
        return Err(io::Error::last_os_error());
    }
    Ok(info.si_signo != 0)
}

/// Kills a child that leads a process group, and the whole group. The child must not have been
/// waited for: afterwards its number may be another group's.
pub fn end_group(leader: &Child) {
    let Ok(id) = libc::pid_t::try_from(leader.id()) else { return };
    // SAFETY: only sends a signal.
    unsafe { libc::kill(-id, libc::SIGKILL) };
}

/// While this exists, orphans among the descendants of this process become its children, such as
/// copies of foreign code in process groups of their own. When it is dropped, all children are
/// killed that this process has got since, those that it has started itself too.
pub struct Adoption {
    /// The children that there were before, which belong to somebody else.
    before: Vec<libc::pid_t>,
    /// Whether this process adopted orphans before.
    did_adopt: bool,
}

impl Adoption {
    pub fn begin() -> Self {
        let before = children();
        Adoption { before, did_adopt: adopt_orphans(true) }
    }
}

impl Drop for Adoption {
    fn drop(&mut self) {
        /// How often the children are listed: code that starts processes faster than they are
        /// killed is given up.
        const MOST_ROUNDS: u32 = 50;
        for _ in 0..MOST_ROUNDS {
            let left: Vec<_> = children().into_iter().filter(|child| !self.before.contains(child)).collect();
            // A process that we may not kill, such as one of another user, is not waited for
            // either.
            if left.into_iter().filter(|child| end_child(*child)).count() == 0 {
                break;
            }
        }
        adopt_orphans(self.did_adopt);
    }
}

/// Kills a child and waits for its end. False if the system refuses.
fn end_child(child: libc::pid_t) -> bool {
    // SAFETY: a child that came after all those of others, so that nobody else waits for it.
    unsafe { libc::kill(child, libc::SIGKILL) == 0 && libc::waitpid(child, std::ptr::null_mut(), 0) == child }
}

/// Sets whether orphans among the descendants of this process become its children, where the system
/// can do that. Returns whether they did before.
fn adopt_orphans(does: bool) -> bool {
    let mut did = libc::c_int::from(does);
    #[cfg(target_os = "linux")]
    // SAFETY: writes a number of ours, and only changes which process becomes the parent of
    // orphans.
    unsafe {
        libc::prctl(libc::PR_GET_CHILD_SUBREAPER, &mut did);
        libc::prctl(libc::PR_SET_CHILD_SUBREAPER, libc::c_ulong::from(does));
    }
    did != 0
}

/// The children of this process, if the system lists them.
fn children() -> Vec<libc::pid_t> {
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let lists = tasks.filter_map(|task| std::fs::read_to_string(task.path().join("children")).ok());
    lists.flat_map(|list| list.split_whitespace().filter_map(|id| id.parse().ok()).collect::<Vec<_>>()).collect()
}
