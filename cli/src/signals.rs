//! Signals that end the program, and the exit status after them.

use std::io;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU8, Ordering};

/// The exit status after a signal: 128 plus the number of the signal, as in shells. SIGINT's until
/// one is received.
static STATUS: AtomicU8 = AtomicU8::new(130);

/// The exit status after the received signal.
pub fn status() -> u8 {
    STATUS.load(Ordering::Relaxed)
}

/// Ends the process with the exit status of the received signal.
pub fn exit() -> ! {
    std::process::exit(status().into())
}

/// The exit status of the received signal, for `main` to return.
pub fn code() -> ExitCode {
    ExitCode::from(status())
}

/// Calls `heard`, in a thread of its own, whenever SIGHUP, SIGINT, SIGQUIT, SIGTERM or SIGXCPU
/// (Ctrl-C on Windows) asks the process to end. Signals that the parent process made it ignore (for
/// a background job, or by nohup) stay ignored. If no thread can be started, signals keep their
/// default effect, and a note says so.
///
/// # Errors
/// The system's error, if it refuses the handlers.
pub fn listen(heard: impl FnMut() + Send + 'static) -> io::Result<()> {
    start(heard).map_err(|error| io::Error::new(error.kind(), format!("cannot listen for signals: {error}")))
}

#[cfg(unix)]
fn start(mut heard: impl FnMut() + Send + 'static) -> io::Result<()> {
    use std::sync::mpsc;

    use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGXCPU};
    use signal_hook::iterator::Signals;

    use super::say;
    use rayo::internals::kernels::sys::{is_ignored, new_thread};

    let listened = [SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGXCPU].into_iter().filter(|signal| !is_ignored(*signal));
    // Start the thread before registering the signals, which would otherwise be lost if it cannot
    // start.
    let (give, take) = mpsc::channel::<Signals>();
    let listening = new_thread().and_then(|thread| {
        thread.spawn(move || {
            for signal in take.recv().iter_mut().flat_map(Signals::forever) {
                STATUS.store(128 + signal as u8, Ordering::Relaxed);
                heard();
            }
        })
    });
    match listening {
        Ok(_) => drop(give.send(Signals::new(listened)?)),
        Err(_) => say("note: no thread can be started that listens for signals: they end this at once"),
    }
    Ok(())
}

#[cfg(not(unix))]
fn start(heard: impl FnMut() + Send + 'static) -> io::Result<()> {
    ctrlc::set_handler(heard).map_err(io::Error::other)
}

/// After this call, a write beyond the limit of file sizes (RLIMIT_FSIZE) fails with an error, as
/// on a full disk; by default SIGXFSZ would end the process.
pub fn survive_file_size_limit() {
    #[cfg(unix)]
    // The flag is never read: the failed write reports the error. If the handler cannot be
    // registered, the default stays.
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Default::default());
}
