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

/// The bytes of a chunk: a chunk and the data read from it together fit into a core's private
/// (L2) cache.
const CHUNK: usize = 256 << 10;
/// The bytes read past a chunk's end to complete its last line. Parallel reading ends at a line
/// that reaches further.
const LONGEST_LINE: usize = 4 << 10;
/// A text of fewer chunks than this is read by one thread: it is finished before further
/// threads would have started.
const FEWEST_CHUNKS: usize = 8;
/// How many chunks per thread may be read ahead of the first unfinished one, which bounds the
/// memory that results wait in.
const AHEAD: usize = 4;

/// A file that several threads may read at once.
#[derive(Clone, Copy)]
pub(super) struct SharedFile<'a> {
    file: &'a File,
    /// The offset where the text begins, after a byte order mark.
    start: usize,
    threads: usize,
    /// The bytes of a chunk.
    chunk: usize,
}

impl<'a> SharedFile<'a> {
    /// A file to be read by up to `threads` threads.
    pub(super) fn new(file: &'a File, threads: usize) -> Self {
        SharedFile { file, start: 0, threads, chunk: CHUNK }
    }

    /// This file, in chunks of this many bytes.
    #[cfg(test)]
    pub(super) fn in_chunks_of(self, bytes: usize) -> Self {
        SharedFile { chunk: bytes, ..self }
    }

    /// This file, whose text begins this many bytes later.
    pub(super) fn after(self, bytes: usize) -> Self {
        SharedFile { start: self.start + bytes, ..self }
    }

    /// Whether a text of this many bytes is worth reading with several threads.
    pub(super) fn is_worth_sharing(self, bytes: usize) -> bool {
        self.threads > 1 && bytes >= FEWEST_CHUNKS * self.chunk
    }

    /// The file positioned at this byte of the text, for a single reader of the rest.
    pub(super) fn rest(self, at: usize) -> io::Result<&'a File> {
        use std::io::Seek;
        let mut file = self.file;
        file.seek(io::SeekFrom::Start((self.start + at) as u64))?;
        Ok(file)
    }

    /// The lines that begin in the first chunk of a text of this length in bytes.
    pub(super) fn first_lines(self, length: usize) -> Option<Vec<u8>> {
        let mut buffer = Vec::new();
        let count = self.lines(0, &(0..length), &mut buffer)?.bytes.len();
        buffer.truncate(count);
        Some(buffer)
    }

    /// Lets several threads `read` the lines of a part of the text, chunk by chunk; `read` is
    /// also given the offset of its lines in the text. What it returns is passed to `take` in the
    /// order of the text. Reading ends early where a chunk cannot be read or `take` returns false.
    /// Returns the offset up to which the text was taken: the start of the part or of a line.
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

    /// The lines that begin in chunk `number` of a part of the text. None if they cannot be
    /// read, or if the last one reaches further than [`LONGEST_LINE`] beyond the chunk.
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

/// The lines that begin in a chunk. There are none if a line of an earlier chunk reaches to
/// this chunk's end.
struct Lines<'a> {
    /// The offset of the first line in the text.
    at: usize,
    bytes: &'a [u8],
}

impl Lines<'_> {
    fn end(&self) -> usize {
        self.at + self.bytes.len()
    }
}

/// The chunks that threads have yet to read, and the results that wait for those of earlier
/// chunks.
struct Queue<T, F> {
    state: Mutex<State<T, F>>,
    chunks: usize,
    /// How many chunks may be begun beyond those taken.
    ahead: usize,
    /// Notified when chunks have been taken.
    changed: Condvar,
}

struct State<T, F> {
    /// The number of chunks that threads have begun to read; set to the number of all chunks
    /// when no more are to be read.
    begun: usize,
    /// The number of chunks whose results were taken.
    taken: usize,
    /// The offset in the text where the last chunk that was taken ends.
    at: usize,
    /// The results of chunks that wait for earlier ones, by chunk number, each with the offset
    /// where its lines end; None if a chunk could not be read.
    waiting: BTreeMap<usize, Option<(T, usize)>>,
    take: F,
}

impl<T, F: FnMut(T) -> bool> Queue<T, F> {
    fn state(&self) -> MutexGuard<'_, State<T, F>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The number of the next chunk to read, or None if there is no more. Waits while too many
    /// results wait for an earlier chunk.
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

    /// Takes the result of a chunk if it is the next in order, and then later ones that waited
    /// for it; else keeps it.
    fn give(&self, number: usize, read: Option<(T, usize)>) {
        let mut state = self.state();
        state.waiting.insert(number, read);
        loop {
            let next = state.taken;
            let Some(read) = state.waiting.remove(&next) else { break };
            let end = read.and_then(|(read, end)| (state.take)(read).then_some(end));
            let Some(end) = end else {
                // No later chunk will be taken: this number never becomes a chunk's.
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

/// Fills `bytes` from the file's offset `at` on.
#[cfg(unix)]
fn read_exact_at(file: &File, bytes: &mut [u8], at: u64) -> io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, at)
}

/// Fills `bytes` from the file's offset `at` on.
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

/// Fails on other systems, so that one thread reads the file.
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
