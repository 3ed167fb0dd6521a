//! The tokens of the paper's scene format, and the kinds of lists that they form.

use std::ops::Range;

use super::log::is_line_end;

/// The film diagonal of Algorithm 1. The paper's format cannot express another one.
pub(super) const FILM: f32 = 1.0;

/// One of the three lists of a scene: lights, spheres, triangles.
pub(super) struct Kind {
    pub(super) one: &'static str,
    pub(super) many: &'static str,
    pub(super) count: &'static str,
    /// The number of tokens of each item.
    pub(super) tokens: usize,
}

/// The byte range of the first token at or after an offset.
pub(super) fn next_token(bytes: &[u8], mut at: usize) -> Option<Range<usize>> {
    let comment = |at: usize| bytes[at] == b'#' || bytes[at] == b'/' && bytes.get(at + 1) == Some(&b'/');
    while at < bytes.len() {
        if is_space(bytes[at]) {
            at += 1;
        } else if comment(at) {
            while at < bytes.len() && !is_line_end(bytes[at]) {
                at += 1;
            }
        } else {
            let start = at;
            while at < bytes.len() && !is_space(bytes[at]) && !comment(at) {
                at += 1;
            }
            return Some(start..at);
        }
    }
    None
}

/// Whether `byte` separates tokens.
pub(super) fn is_space(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | 0x0b | 0x0c) || is_line_end(byte)
}
