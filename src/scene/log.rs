//! The errors of a text while it is being read: each is noted with its line and column, in one pass
//! over the text.

use std::fmt;
use std::ops::Range;

use super::mistaken::{Mistaken, recognise, recognise_unread};
use super::{Diagnostic, SceneError};

/// The most errors of a file that are kept; further ones are only counted.
const MAX_ERRORS: usize = 20;
/// What some editors put before text, and which is none of it.
pub(super) const BYTE_ORDER_MARK: &str = "\u{feff}";

/// Whether `byte` ends a line.
pub(super) fn is_line_end(byte: u8) -> bool {
    matches!(byte, b'\n' | b'\r')
}

/// The errors so far, in the file's order.
pub(super) struct Log<'a> {
    source: &'a [u8],
    /// Where the text begins, after a byte order mark.
    start: usize,
    place: Place,
    diagnostics: Vec<Diagnostic>,
    more: usize,
}

/// A place in the file. It only ever moves forward, so that all places together cost one pass.
#[derive(Clone, Copy)]
struct Place {
    offset: usize,
    line: usize,
    line_start: usize,
    column: usize,
}

impl<'a> Log<'a> {
    /// No errors of `source` yet.
    pub(super) fn new(source: &'a [u8]) -> Self {
        let start = if source.starts_with(BYTE_ORDER_MARK.as_bytes()) { BYTE_ORDER_MARK.len() } else { 0 };
        let place = Place { offset: start, line: 1, line_start: start, column: 1 };
        Log { source, start, place, diagnostics: Vec::new(), more: 0 }
    }

    /// The text and its start, after a byte order mark; or None, after noting that it is not UTF-8
    /// or no scene at all.
    pub(super) fn text(&mut self) -> Option<(&'a str, usize)> {
        match std::str::from_utf8(self.source) {
            Ok(text) => match recognise(self.source) {
                None => Some((text, self.start)),
                Some(Mistaken { what, help }) => {
                    let line = self.source.split(|byte| is_line_end(*byte)).next().unwrap_or_default();
                    self.note(0..line.len(), format_args!("{what}"), "a scene", Some((*help).to_owned()));
                    None
                }
            },
            Err(error) => {
                self.not_utf8(error);
                None
            }
        }
    }

    /// Notes an error of `token`, which must not be before the last one noted.
    pub(super) fn note(
        &mut self,
        token: Range<usize>,
        message: fmt::Arguments<'_>,
        expected: &str,
        help: Option<String>,
    ) {
        if self.diagnostics.len() == MAX_ERRORS {
            self.more += 1;
            return;
        }
        let Place { line, line_start, column, .. } = *self.place.advance(self.source, token.start);
        let mut diagnostic = Diagnostic::new(self.source, token, (line, line_start, column), message, expected);
        diagnostic.help = help;
        self.diagnostics.push(diagnostic);
    }

    /// The line of a place, which must not be before the last one noted.
    pub(super) fn line(&mut self, offset: usize) -> usize {
        self.place.advance(self.source, offset).line
    }

    /// The first error, if there is one.
    pub(super) fn first_mut(&mut self) -> Option<&mut Diagnostic> {
        self.diagnostics.first_mut()
    }

    /// `value` if it is there and nothing was noted; otherwise the errors.
    pub(super) fn finish<T>(self, value: Option<T>, name: &str) -> Result<T, SceneError> {
        match value {
            Some(value) if self.diagnostics.is_empty() => Ok(value),
            _ => Err(SceneError::Invalid { name: name.to_owned(), diagnostics: self.diagnostics, more: self.more }),
        }
    }

    fn not_utf8(&mut self, error: std::str::Utf8Error) {
        let start = error.valid_up_to();
        let end = error.error_len().map_or(self.source.len(), |length| start + length);
        let of_mistaken = |Mistaken { what, help }: &Mistaken| format!("{what}: {help}");
        let help = recognise_unread(self.source).map_or("save the file as UTF-8".to_owned(), of_mistaken);
        let message = format_args!("byte {start} of the file, {:#04x}, is not UTF-8", self.source[start]);
        self.note(start..end, message, "UTF-8 text", Some(help));
    }
}

impl Place {
    fn advance(&mut self, source: &[u8], to: usize) -> &Self {
        while self.offset < to {
            let byte = source[self.offset];
            self.offset += 1;
            if is_line_end(byte) && !source[self.offset - 1..].starts_with(b"\r\n") {
                *self = Place { line: self.line + 1, line_start: self.offset, column: 1, ..*self };
            } else if byte & 0xc0 != 0x80 {
                self.column += 1;
            }
        }
        self
    }
}
