//! The processes that run a user's code, and the tools that make it: started and ended.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

use super::findings::Finding;
use rayo::internals::kernels::foreign::{Adoption, end_group, has_ended, mark_for_foreign_code};

/// How long an assembler, a compiler or a linker may take.
const TOOLS: Duration = Duration::from_secs(60);
/// What is kept of what a process prints: more is read and forgotten.
const MOST_PRINTED: usize = 64 << 10;
/// How long a process may take to end after its last finding, and what it has printed to arrive
/// after its end.
const LAST: Duration = Duration::from_secs(5);

/// A process that leads a group of its own; all of the group ends when this is dropped.
struct Group {
    child: Child,
    /// How it ended; its number may be another process's from then on.
    status: Option<ExitStatus>,
}

impl Group {
    fn start(mut command: Command) -> io::Result<Self> {
        // Ctrl-C is for this process, which ends the other.
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        Ok(Group { child: command.spawn()?, status: None })
    }

    /// Waits for its end until `end`, and then ends it with all that it has started.
    fn end(&mut self, end: Instant) -> io::Result<ExitStatus> {
        while Instant::now() < end && !has_ended(&self.child)? {
            std::thread::sleep(Duration::from_millis(1));
        }
        // Before it is waited for: until then no other group has its number.
        end_group(&self.child);
        // It may have left its group. If it has ended by itself, there is nothing to end.
        let _ = self.child.kill();
        let status = self.child.wait()?;
        self.status = Some(status);
        Ok(status)
    }
}

impl Drop for Group {
    fn drop(&mut self) {
        if self.status.is_none() {
            // Nobody is left to be told if it fails.
            let _ = self.end(Instant::now());
        }
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
    mark_for_foreign_code(&mut command);
    let adoption = Adoption::begin();
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
    // What it has left behind could keep its standard error open.
    drop(adoption);
    let end = match (is_complete, is_late) {
        (true, _) => End::Complete,
        (false, true) => End::Late,
        (false, false) => End::Early(status),
    };
    Ok(Heard { findings, end, printed: String::from_utf8_lossy(&printed(&stderr)).into_owned() })
}

/// Findings are a few dozen; what exceeds this, the code has written itself.
const MOST_FINDINGS: usize = 1000;
/// Bytes of all findings together.
const MOST_BYTES: u64 = 16 << 20;

/// The findings that a pipe brings, a line each. Other lines are passed over: the code has written
/// them itself. After the most that there may be, the pipe is closed.
fn lines_of(pipe: impl Read + Send + 'static) -> Receiver<Finding> {
    let (sender, receiver) = mpsc::sync_channel(MOST_FINDINGS);
    std::thread::spawn(move || {
        let lines = BufReader::new(pipe.take(MOST_BYTES)).split(b'\n').map_while(Result::ok);
        let findings = lines.filter_map(|line| serde_json::from_slice(&line).ok());
        for finding in findings.take(MOST_FINDINGS) {
            // Nobody may wait for it any more.
            if sender.send(finding).is_err() {
                return;
            }
        }
    });
    receiver
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same line again and again, for ever.
    struct Endless {
        at: usize,
    }

    impl Read for Endless {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            const LINE: &[u8] = b"{\"Undone\":\"again\"}\n";
            for byte in &mut *buffer {
                *byte = LINE[self.at % LINE.len()];
                self.at += 1;
            }
            Ok(buffer.len())
        }
    }

    #[test]
    fn endless_findings_and_lines_come_to_an_end() {
        let findings = lines_of(Endless { at: 0 });
        assert_eq!(findings.iter().take(2 * MOST_FINDINGS).count(), MOST_FINDINGS);
        assert_eq!(lines_of(io::repeat(b'x')).iter().count(), 0);
    }
}
