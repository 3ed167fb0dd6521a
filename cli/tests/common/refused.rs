//! Makes system calls fail, as in sandboxes and on some file systems.

use std::io;
use std::os::unix::process::CommandExt;
use std::process::Command;

/// A system call that is to fail if one of its arguments has any of these bits set.
#[derive(Clone, Copy)]
pub struct Refusal {
    pub call: libc::c_long,
    pub argument: u32,
    pub bits: u32,
    pub error: libc::c_int,
}

/// Files without a name fail, as on NFS.
pub const NAMELESS: Refusal = Refusal {
    call: libc::SYS_openat,
    argument: 2,
    // O_TMPFILE includes the bits of O_DIRECTORY, which alone must not fail.
    bits: (libc::O_TMPFILE & !libc::O_DIRECTORY) as u32,
    error: libc::EOPNOTSUPP,
};

/// Giving a name to a file without one fails, which is done through a link.
pub const LINKS: Refusal =
    Refusal { call: libc::SYS_linkat, argument: 4, bits: libc::AT_SYMLINK_FOLLOW as u32, error: libc::EPERM };

/// Flushing data to the disk fails.
pub const SYNC: Refusal = Refusal { call: libc::SYS_fdatasync, argument: 0, bits: u32::MAX, error: libc::EIO };

/// Offsets in seccomp's record of a system call: the call's number, and the first argument, of
/// which the lower half comes first.
const NUMBER_AT: u32 = 0;
const ARGUMENTS_AT: u32 = 16;

/// Makes the process of `command` fail in this way.
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
