//! A file of text read in chunks of whole lines by several threads, whose results are taken in
//! order.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::ops::Range;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;

use crate::kernels::StandardFloats;
use crate::kernels::sys::new_thread;

/// The bytes of a chunk: a chunk and what is read from it fit into a core's own cache.
const CHUNK: usize = 256 << 10;
/// The longest line that may reach beyond its chunk.
const LONGEST_LINE: usize = 4 << 10;
/// A text of fewer chunks is read before other threads have started.
const FEWEST_CHUNKS: usize = 8;
/// How many chunks may wait for an earlier one, for each thread.
const AHEAD: usize = 4;

/// A file that several threads may read at once.
#[derive(Clone, Copy)]
pub(super) struct SharedFile<'a> {
    file: &'a File,
    /// Where the text begins, after a byte order mark.
    start: usize,
    threads: usize,
    /// The bytes of a chunk.
    chunk: usize,
}

impl<'a> SharedFile<'a> {
    /// For this many threads.
    pub(super) fn new(file: &'a File, threads: usize) -> Self {
        SharedFile { file, start: 0, threads, chunk: CHUNK }
    }

    /// The same, in chunks of so many bytes.
    #[cfg(test)]
    pub(super) fn in_chunks_of(self, bytes: usize) -> Self {
        SharedFile { chunk: bytes, ..self }
    }

    /// The text after so many bytes more.
    pub(super) fn after(self, bytes: usize) -> Self {
        SharedFile { start: self.start + bytes, ..self }
    }

    /// Whether several threads may read this much of a text.
    pub(super) fn is_worth_sharing(self, bytes: usize) -> bool {
        self.threads > 1 && bytes >= FEWEST_CHUNKS * self.chunk
    }

    /// The rest of the text from this byte on, for a single reader.
    pub(super) fn rest(self, at: usize) -> io::Result<&'a File> {
        use std::io::Seek;
        let mut file = self.file;
        file.seek(io::SeekFrom::Start((self.start + at) as u64))?;
        Ok(file)
    }

    /// The lines that begin in the first chunk of a text of this length.
    pub(super) fn first_lines(self, length: usize) -> Option<Vec<u8>> {
        let mut buffer = Vec::new();
        let count = self.lines(0, &(0..length), &mut buffer)?.bytes.len();
        buffer.truncate(count);
        Some(buffer)
    }

    /// Has several threads `read` the lines of a part of the text, chunk by chunk, whose places in
    /// the text `read` is given too, and passes what they read to `take`, in the order of the text.
    /// Where a chunk cannot be read, or `take` returns false, this ends. Returns the place up to
    /// which the text was taken: the beginning of the part, or of a line.
    pub(super) fn read_lines<T: Send>(
        self,
        part: Range<usize>,
        read: impl Fn(usize, &[u8]) -> Option<T> + Sync,
        take: impl FnMut(T) -> bool + Send,
    ) -> usize {
        let first = part.start;
        let chunks = part.len().div_ceil(self.chunk);
        let queue = Queue {
            state: Mutex::new(State { begun: 0, taken: 0, at: first, waiting: BTreeMap::new(), take }),
            chunks,
            ahead: AHEAD * self.threads,
            changed: Condvar::new(),
        };
        let work = || {
            let mut buffer = Vec::new();
            while let Some(number) = queue.next() {
                let lines = self.lines(number, &part, &mut buffer);
                queue.give(number, lines.and_then(|lines| Some((read(lines.at, lines.bytes)?, lines.end()))));
            }
        };
        thread::scope(|scope| {
            for _ in 1..self.threads.min(chunks) {
                let started = new_thread().and_then(|thread| {
                    thread.spawn_scoped(scope, || {
                        let _floats = StandardFloats::set();
                        work();
                    })
                });
                if started.is_err() {
                    break;
                }
            }
            work();
        });
        queue.state.into_inner().unwrap_or_else(PoisonError::into_inner).at
    }

    /// The lines that begin in a chunk of a part of the text; None if they cannot be read, or the
    /// last one is too long.
    fn lines<'b>(self, number: usize, part: &Range<usize>, buffer: &'b mut Vec<u8>) -> Option<Lines<'b>> {
        let begin = part.start + number * self.chunk;
        // A chunk begins after the first line end at or after the byte before it.
        let before = usize::from(number > 0);
        let end = part.end.min(begin + self.chunk);
        let read_to = part.end.min(end + LONGEST_LINE);
        buffer.resize(self.chunk + LONGEST_LINE + 1, 0);
        let bytes = &mut buffer[..read_to - (begin - before)];
        read_exact_at(self.file, bytes, (self.start + begin - before) as u64).ok()?;
        let line_after = |at: usize| memchr::memchr(b'\n', &bytes[at..]).map(|line_end| at + line_end + 1);
        let from = if number > 0 { line_after(0)? } else { 0 };
        let to = if end < part.end { line_after(end - 1 - (begin - before))? } else { bytes.len() };
        Some(Lines { at: begin - before + from, bytes: &bytes[from..to] })
    }
}

/// The lines that begin in a chunk: none, if one reaches from the chunk before to its end.
struct Lines<'a> {
    /// Their place in the text.
    at: usize,
    bytes: &'a [u8],
}

impl Lines<'_> {
    fn end(&self) -> usize {
        self.at + self.bytes.len()
    }
}

/// The chunks of a text, for threads that read them, and what they have read.
struct Queue<T, F> {
    state: Mutex<State<T, F>>,
    chunks: usize,
    /// How many chunks may wait for an earlier one.
    ahead: usize,
    /// Notified when chunks have been taken.
    changed: Condvar,
}

struct State<T, F> {
    /// The number of chunks that threads have begun to read: all, if no more are to be read.
    begun: usize,
    /// The number of chunks taken.
    taken: usize,
    /// The end of the last one in the text.
    at: usize,
    /// What was read of later chunks, with their ends in the text; None if a chunk was not read.
    waiting: BTreeMap<usize, Option<(T, usize)>>,
    take: F,
}

impl<T, F: FnMut(T) -> bool> Queue<T, F> {
    fn state(&self) -> MutexGuard<'_, State<T, F>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The number of the next chunk to be read.
    fn next(&self) -> Option<usize> {
        let is_too_far = |state: &mut State<T, F>| state.begun < self.chunks && state.begun > state.taken + self.ahead;
        let state = self.changed.wait_while(self.state(), is_too_far);
        let mut state = state.unwrap_or_else(PoisonError::into_inner);
        let number = state.begun;
        if number == self.chunks {
            return None;
        }
        state.begun += 1;
        Some(number)
    }

    /// Takes what was read of a chunk, and of later ones that waited for it.
    fn give(&self, number: usize, read: Option<(T, usize)>) {
        let mut state = self.state();
        state.waiting.insert(number, read);
        loop {
            let next = state.taken;
            let Some(read) = state.waiting.remove(&next) else { break };
            let end = read.and_then(|(read, end)| (state.take)(read).then_some(end));
            let Some(end) = end else {
                // Later chunks are not taken.
                state.taken = usize::MAX;
                state.begun = self.chunks;
                break;
            };
            state.at = end;
            state.taken += 1;
        }
        self.changed.notify_all();
    }
}

/// Reads bytes of a file from this place on.
#[cfg(unix)]
fn read_exact_at(file: &File, bytes: &mut [u8], at: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, at)
}

/// Reads bytes of a file from this place on.
#[cfg(windows)]
fn read_exact_at(file: &File, mut bytes: &mut [u8], mut at: u64) -> io::Result<()> {
    while !bytes.is_empty() {
        let read = std::os::windows::fs::FileExt::seek_read(file, bytes, at)?;
        if read == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        bytes = &mut bytes[read..];
        at += read as u64;
    }
    Ok(())
}

/// On other systems a file is read by one thread.
#[cfg(not(any(unix, windows)))]
fn read_exact_at(_: &File, _: &mut [u8], _: u64) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::io::Write;

    use super::SharedFile;
    use crate::scene::Rng;

    const CHUNK: usize = 8 << 10;

    /// A file of so many lines of up to this many bytes, and its text.
    fn written(lines: usize, longest: u64) -> (File, Vec<u8>) {
        let mut rng = Rng::new(longest);
        let mut text = Vec::new();
        for line in 0..lines {
            text.extend(std::iter::repeat_n(b'a' + (line % 26) as u8, (rng.next_u64() % longest) as usize));
            text.push(b'\n');
        }
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(b"head").unwrap();
        file.write_all(&text).unwrap();
        (file, text)
    }

    #[test]
    fn all_lines_are_taken_once_and_in_order() {
        for (lines, longest) in [(3_000, 100), (10_000, 20), (100, 4_000)] {
            let (file, text) = written(lines, longest);
            for threads in [1, 2, 5] {
                let mut taken = Vec::new();
                let file = SharedFile::new(&file, threads).after(4).in_chunks_of(CHUNK);
                let read = |_, lines: &[u8]| (lines.is_empty() || lines.ends_with(b"\n")).then(|| lines.to_vec());
                let at = file.read_lines(0..text.len(), read, |lines| {
                    taken.extend(lines);
                    true
                });
                assert_eq!(at, text.len());
                assert!(taken == text, "{threads} threads, lines of up to {longest} bytes");
            }
        }
    }

    #[test]
    fn unusual_chunk_ends_at_the_beginning_of_a_line() {
        let (file, text) = written(3_000, 100);
        let file = SharedFile::new(&file, 3).after(4).in_chunks_of(CHUNK);
        for most in [0, 1, CHUNK, 3 * CHUNK + 5, text.len() / 2] {
            for is_read in [false, true] {
                let mut taken = Vec::new();
                let read = |at: usize, lines: &[u8]| {
                    assert!(text[at..].starts_with(lines));
                    (is_read || at + lines.len() < most).then(|| lines.to_vec())
                };
                let at = file.read_lines(0..text.len(), read, |lines| {
                    let is_taken = taken.len() + lines.len() < most;
                    if is_taken {
                        taken.extend(lines);
                    }
                    is_taken
                });
                assert!(at <= most && (at == 0 || text[at - 1] == b'\n'));
                assert!(most < CHUNK || at + 2 * CHUNK > most, "{at} of {most}");
                assert!(taken == text[..at]);
            }
        }
    }

    #[test]
    fn a_line_that_reaches_far_beyond_its_chunk_is_left_to_others() {
        let mut file = tempfile::tempfile().unwrap();
        let mut text = vec![b'\n'; 3 * CHUNK];
        text[CHUNK - 10..2 * CHUNK].fill(b'x');
        file.write_all(&text).unwrap();
        let file = SharedFile::new(&file, 2).in_chunks_of(CHUNK);
        let at = file.read_lines(0..text.len(), |_, _| Some(()), |()| true);
        assert_eq!(at, 0);
    }
}
