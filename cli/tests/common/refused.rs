//! A system that refuses calls, as sandboxes and other file systems do.

use std::io;
use std::os::unix::process::CommandExt;
use std::process::Command;

/// A call that fails if one of its arguments has any of these bits.
#[derive(Clone, Copy)]
pub struct Refusal {
    pub call: libc::c_long,
    pub argument: u32,
    pub bits: u32,
    pub error: libc::c_int,
}

/// Files without a name, as on NFS.
pub const NAMELESS: Refusal = Refusal {
    call: libc::SYS_openat,
    argument: 2,
    // O_TMPFILE without the bits of O_DIRECTORY.
    bits: (libc::O_TMPFILE & !libc::O_DIRECTORY) as u32,
    error: libc::EOPNOTSUPP,
};

/// Names for files that are reached through a link, as those without one are.
pub const LINKS: Refusal =
    Refusal { call: libc::SYS_linkat, argument: 4, bits: libc::AT_SYMLINK_FOLLOW as u32, error: libc::EPERM };

/// Data that the disk does not take in the end: of any descriptor but standard input.
pub const SYNC: Refusal = Refusal { call: libc::SYS_fdatasync, argument: 0, bits: u32::MAX, error: libc::EIO };

/// Where the system's record of a call has its number, and its first argument, whose lower half
/// comes first.
const NUMBER_AT: u32 = 0;
const ARGUMENTS_AT: u32 = 16;

/// Has the command's process meet this refusal.
pub fn refuse(command: &mut Command, refusal: Refusal) {
    let install = move || install(refusal);
    // SAFETY: between fork and exec it only makes two system calls on memory of its own.
    unsafe { command.pre_exec(install) };
}

fn install(refusal: Refusal) -> io::Result<()> {
    let Refusal { call, argument, bits, error } = refusal;
    let step = |code: u32, otherwise: u8, k: u32| libc::sock_filter { code: code as u16, jt: 0, jf: otherwise, k };
    let load = libc::BPF_LD | libc::BPF_W | libc::BPF_ABS;
    let compare = |test: u32| libc::BPF_JMP | test | libc::BPF_K;
    let mut filter = [
        step(load, 0, NUMBER_AT),
        step(compare(libc::BPF_JEQ), 3, call as u32),
        step(load, 0, ARGUMENTS_AT + 8 * argument),
        step(compare(libc::BPF_JSET), 1, bits),
        step(libc::BPF_RET, 0, libc::SECCOMP_RET_ERRNO | error as u32),
        step(libc::BPF_RET, 0, libc::SECCOMP_RET_ALLOW),
    ];
    let program = libc::sock_fprog { len: filter.len() as u16, filter: filter.as_mut_ptr() };
    // SAFETY: the program and its filter live until the call returns, which copies them.
    let installed = unsafe {
        libc::prctl(libc::PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0
            && libc::prctl(libc::PR_SET_SECCOMP, libc::SECCOMP_MODE_FILTER, &raw const program) == 0
    };
    if installed { Ok(()) } else { Err(io::Error::last_os_error()) }
}
