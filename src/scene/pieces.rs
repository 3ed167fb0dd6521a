//! A file read piece by piece.

use std::io::{self, BufRead, ErrorKind, Read};

use memchr::memchr;

/// The size of a piece, which stays in a core's caches. Getting memory for a whole file takes
/// longer than filling it.
const PIECE: usize = 128 << 10;
/// At least this much is at hand before the end: the most that is read at once.
const LONGEST: usize = 16 << 10;

/// The system has not given the bytes of a file.
#[derive(Debug)]
pub(super) struct ReadFailed;

/// A file, and its piece in memory.
pub(super) struct Pieces<R> {
    file: R,
    bytes: Vec<u8>,
    /// The index in `bytes` of the first that has not been read.
    at: usize,
    /// Whether `bytes` are the last ones.
    ended: bool,
}

impl<R: Read> Pieces<R> {
    /// For a file of this length.
    pub(super) fn new(file: R, length: usize) -> Self {
        Pieces { file, bytes: Vec::with_capacity(length.min(PIECE + LONGEST)), at: 0, ended: false }
    }

    /// Has [`LONGEST`] bytes at hand, or all that are left.
    pub(super) fn fill(&mut self) -> Option<()> {
        if self.rest().len() < LONGEST { self.lengthen() } else { Some(()) }
    }

    /// Has twice as much at hand, or all that is left.
    pub(super) fn lengthen(&mut self) -> Option<()> {
        if !self.ended {
            self.bytes.drain(..self.at);
            self.at = 0;
            let most = self.bytes.len().max(PIECE);
            let more = self.file.by_ref().take(most as u64).read_to_end(&mut self.bytes).ok()?;
            self.ended = more < most;
        }
        Some(())
    }

    /// Whether these are the last bytes.
    pub(super) fn ended(&self) -> bool {
        self.ended
    }

    /// The bytes at hand.
    pub(super) fn rest(&self) -> &[u8] {
        &self.bytes[self.at..]
    }

    /// The next line, without the bytes that end it; None at the end of the file. A line of any
    /// length is at hand as a whole.
    pub(super) fn line(&mut self) -> Result<Option<&[u8]>, ReadFailed> {
        let mut searched = 0;
        let length = loop {
            self.fill().ok_or(ReadFailed)?;
            let rest = self.rest();
            if let Some(at) = memchr(b'\n', &rest[searched..]) {
                break searched + at + 1;
            } else if self.ended {
                break rest.len();
            }
            searched = rest.len();
            self.lengthen().ok_or(ReadFailed)?;
        };
        let line = &self.bytes[self.at..self.at + length];
        self.at += length;
        let line = line.strip_suffix(b"\n").unwrap_or(line);
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        Ok((length > 0).then_some(line))
    }

    /// Marks all bytes at hand as read, except the last `left`.
    pub(super) fn leave(&mut self, bytes: usize) {
        self.at = self.bytes.len() - bytes;
    }
}

impl<R: Read> BufRead for Pieces<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        self.fill().ok_or(ErrorKind::Other)?;
        Ok(self.rest())
    }

    fn consume(&mut self, amount: usize) {
        self.at += amount;
    }
}

impl<R: Read> Read for Pieces<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.fill_buf()?.read(buffer)?;
        self.consume(read);
        Ok(read)
    }
}
