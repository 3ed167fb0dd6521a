//! Reading a file piece by piece.

use std::io::{self, BufRead, ErrorKind, Read};

use memchr::memchr;

/// The size of a piece, which fits into a core's caches. Allocating memory for a whole file would
/// take longer than reading it.
const PIECE: usize = 128 << 10;
/// The most bytes that a reader needs at once. At least as many are in memory, except near the end
/// of the file.
const LONGEST: usize = 16 << 10;

/// The file could not be read.
#[derive(Debug)]
pub(super) struct ReadFailed;

/// A file and the piece of it that is in memory.
pub(super) struct Pieces<R> {
    file: R,
    bytes: Vec<u8>,
    /// The index in `bytes` of the first one that has not been consumed.
    at: usize,
    /// Whether the file ends with `bytes`.
    ended: bool,
}

impl<R: Read> Pieces<R> {
    /// A reader for a file of this length.
    pub(super) fn new(file: R, length: usize) -> Self {
        Pieces { file, bytes: Vec::with_capacity(length.min(PIECE + LONGEST)), at: 0, ended: false }
    }

    /// Reads more if fewer than [`LONGEST`] bytes are in memory; None if reading fails.
    pub(super) fn fill(&mut self) -> Option<()> {
        if self.rest().len() < LONGEST { self.lengthen() } else { Some(()) }
    }

    /// Reads until twice as many bytes are in memory, or the rest of the file; None if reading
    /// fails.
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

    /// Whether the file ends with the bytes in memory.
    pub(super) fn ended(&self) -> bool {
        self.ended
    }

    /// The bytes in memory that have not been consumed.
    pub(super) fn rest(&self) -> &[u8] {
        &self.bytes[self.at..]
    }

    /// The next line, without its line end; None at the end of the file. A line of any length is
    /// returned as a whole.
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

    /// Consumes all bytes in memory except the last `bytes`.
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
