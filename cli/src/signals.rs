//! What ends the program from outside: signals, and the exit status after them.

use std::io;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU8, Ordering};

/// The exit status after an end that was asked for: 128 and the number of the signal, as shells
/// have it. Ctrl-C until one came.
static STATUS: AtomicU8 = AtomicU8::new(130);

/// The exit status after the signal that was heard.
pub fn status() -> u8 {
    STATUS.load(Ordering::Relaxed)
}

/// Ends the process as the signal that was heard would.
pub fn exit() -> ! {
    std::process::exit(status().into())
}

/// The same from main.
pub fn code() -> ExitCode {
    ExitCode::from(status())
}

/// Has `heard` called whenever SIGHUP, SIGINT, SIGQUIT, SIGTERM or SIGXCPU (Ctrl-C on Windows) asks
/// for an end, in a thread of its own. Those that somebody has had ignored (a job in the
/// background, nohup) stay ignored. Without a thread, all are as they were, and that is told.
///
/// # Errors
/// What the system says if they cannot be heard.
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
    // Signals that nobody hears would be lost: the thread is there first.
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

/// After this call a write beyond the limit on a file's size (RLIMIT_FSIZE) fails with an error, as
/// a write to a full disk does; without it, SIGXFSZ ends the process.
pub fn survive_file_size_limit() {
    #[cfg(unix)]
    // Nobody reads the flag: the failed write itself reports the error. If the handler cannot be
    // registered, the signal ends the process as before.
    let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Default::default());
}
