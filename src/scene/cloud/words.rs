//! The words of a line, and the numbers among them.

use glam::{DVec3, Vec3};

use super::super::mesh::number::Number;

/// The most words of a line that are kept.
const MOST: usize = 48;

/// The words of a line, which are separated by blanks, commas or semicolons.
pub(super) struct Words<'a> {
    words: [&'a [u8]; MOST],
    count: usize,
}

impl<'a> Words<'a> {
    /// The words of a line, of which no more than [`MOST`] are kept.
    #[inline]
    pub(super) fn of(line: &'a [u8]) -> Self {
        let mut words = Words { words: [&[]; MOST], count: 0 };
        let mut rest = line;
        while words.count < MOST {
            let start = rest.iter().position(|byte| !is_between(*byte)).unwrap_or(rest.len());
            rest = &rest[start..];
            if rest.is_empty() {
                break;
            }
            let end = rest.iter().position(|byte| is_between(*byte)).unwrap_or(rest.len());
            words.words[words.count] = &rest[..end];
            words.count += 1;
            rest = &rest[end..];
        }
        words
    }

    pub(super) fn all(&self) -> &[&'a [u8]] {
        &self.words[..self.count]
    }

    /// The word at this index, if the line has one.
    pub(super) fn get(&self, index: usize) -> Option<&'a [u8]> {
        self.all().get(index).copied()
    }

    /// The number that the word at this index is, if it is one.
    pub(super) fn number(&self, index: usize) -> Option<Number> {
        Number::of_word(self.get(index)?)
    }

    /// The three numbers from this index on, each rounded to f32 and to f64.
    #[inline]
    pub(super) fn point(&self, index: usize) -> Option<(Vec3, DVec3)> {
        let [x, y, z] = [self.number(index)?, self.number(index + 1)?, self.number(index + 2)?];
        Some((Vec3::new(x.single, y.single, z.single), DVec3::new(x.double, y.double, z.double)))
    }
}

/// Whether a byte separates words.
#[inline]
fn is_between(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b'\r' | b'\n' | b'\x0c' | b',' | b';')
}

/// The non-negative integer that a word is, if it is one.
pub(super) fn whole(word: &[u8]) -> Option<usize> {
    str::from_utf8(word).ok()?.parse().ok()
}

/// Whether a line is blank or a comment.
pub(super) fn is_blank(line: &[u8]) -> bool {
    let line = line.trim_ascii();
    line.is_empty() || line.starts_with(b"#") || line.starts_with(b"//")
}
