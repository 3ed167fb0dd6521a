//! The processes that run a user's code, and the tools that make it: started and ended.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use super::findings::Finding;
use rayo::internals::kernels::foreign::{adopt_orphans, end_group, end_orphans};

/// How long an assembler, a compiler or a linker may take.
const TOOLS: Duration = Duration::from_secs(60);
/// What is kept of what a process prints: more is read and forgotten.
const MOST_PRINTED: usize = 64 << 10;
/// How long a process may take to end after its last word.
const LAST: Duration = Duration::from_millis(300);

/// A process of its own group, which ends with this.
struct Group {
    child: Child,
}

impl Group {
    fn start(mut command: Command) -> io::Result<Self> {
        // Ctrl-C is for this process, which ends the other.
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        Ok(Group { child: command.spawn()? })
    }

    /// Waits for its end until `end`, and then ends it with all that it has started.
    fn end(&mut self, end: Instant) -> io::Result<ExitStatus> {
        while Instant::now() < end {
            if let Some(status) = self.child.try_wait()? {
                end_group(&self.child);
                return Ok(status);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        end_group(&self.child);
        self.child.wait()
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        if matches!(self.child.try_wait(), Ok(None)) {
            end_group(&self.child);
            // It may have ended by itself.
            let _ = self.child.kill();
            let _ = self.child.wait();
        }
    }
}

/// Ends what a user's code has left behind, when this goes.
struct Orphans;

impl Drop for Orphans {
    fn drop(&mut self) {
        end_orphans();
    }
}

/// The first bytes of what a pipe brings, once nobody writes to it any more: see [`printed`].
fn drain(mut pipe: impl Read + Send + 'static) -> Receiver<Vec<u8>> {
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        let (mut kept, mut buffer) = (Vec::new(), [0; 4096]);
        while let Ok(count @ 1..) = pipe.read(&mut buffer) {
            let room = MOST_PRINTED.saturating_sub(kept.len());
            kept.extend_from_slice(&buffer[..count.min(room)]);
        }
        // Nobody may wait for it any more.
        let _ = sender.send(kept);
    });
    receiver
}

fn printed(receiver: &Receiver<Vec<u8>>) -> Vec<u8> {
    receiver.recv_timeout(LAST).unwrap_or_default()
}

/// Runs a tool, and returns what it said.
///
/// # Errors
/// If it cannot be started, or does not end in time.
pub fn output_within(mut command: Command) -> io::Result<Output> {
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut group = Group::start(command)?;
    let stdout = drain(group.child.stdout.take().expect("it was asked for"));
    let stderr = drain(group.child.stderr.take().expect("it was asked for"));
    let began = Instant::now();
    let status = group.end(began + TOOLS)?;
    if began.elapsed() >= TOOLS {
        return Err(io::Error::other(format!("it did not end within {} seconds", TOOLS.as_secs())));
    }
    Ok(Output { status, stdout: printed(&stdout), stderr: printed(&stderr) })
}

/// What a process with a user's code did.
pub struct Heard {
    /// What it found out, in order.
    pub findings: Vec<Finding>,
    pub end: End,
    /// The beginning of what the code printed.
    pub printed: String,
}

/// How such a process ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// With all that it was asked for.
    Complete,
    /// It had to be ended: its time was over.
    Late,
    /// It has started a copy of itself, and was ended for it.
    Copied,
    /// Before its time.
    Early(ExitStatus),
}

/// Starts a process with a request on its standard input, and hears what it finds out on its
/// standard output, for as long as it may take.
///
/// # Errors
/// If it cannot be started.
pub fn hear(mut command: Command, request: &[u8], time: Duration) -> io::Result<Heard> {
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    adopt_orphans();
    let _orphans = Orphans;
    let end = Instant::now() + time;
    let mut group = Group::start(command)?;
    // If it has ended already, what it says of that is enough.
    let _ = group.child.stdin.take().expect("it was asked for").write_all(request);
    let lines = lines_of(group.child.stdout.take().expect("it was asked for"));
    let stderr = drain(group.child.stderr.take().expect("it was asked for"));
    let mut findings = Vec::new();
    let mut is_late = false;
    let is_complete = loop {
        match lines.recv_timeout(end.saturating_duration_since(Instant::now())) {
            Ok(Finding::Done) => break true,
            Ok(Finding::Copy) => {
                findings.push(Finding::Copy);
                return Ok(Heard { findings, end: End::Copied, printed: String::new() });
            }
            Ok(finding) => findings.push(finding),
            Err(RecvTimeoutError::Disconnected) => break false,
            Err(RecvTimeoutError::Timeout) => {
                is_late = true;
                break false;
            }
        }
    };
    let status = group.end(if is_late { Instant::now() } else { Instant::now() + LAST })?;
    let end = match (is_complete, is_late) {
        (true, _) => End::Complete,
        (false, true) => End::Late,
        (false, false) => End::Early(status),
    };
    Ok(Heard { findings, end, printed: String::from_utf8_lossy(&printed(&stderr)).into_owned() })
}

/// The findings that a pipe brings, a line each. What is none, the code has written itself.
fn lines_of(pipe: impl Read + Send + 'static) -> Receiver<Finding> {
    /// A longer line is no finding.
    const MOST_BYTES: u64 = 16 << 20;
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        let mut pipe = BufReader::new(pipe);
        let mut line = Vec::new();
        while let Ok(1..) = (&mut pipe).take(MOST_BYTES).read_until(b'\n', &mut line) {
            if let Ok(finding) = serde_json::from_slice(&line)
                && sender.send(finding).is_err()
            {
                return;
            }
            line.clear();
        }
    });
    receiver
}
