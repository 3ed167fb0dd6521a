//! The errors found while a text is read; the line and column of each are computed in one pass
//! over the text.

use std::fmt;
use std::ops::Range;

use super::mistaken::{Mistaken, recognise, recognise_unread};
use super::{Diagnostic, SceneError};

/// The most errors of a file that are kept; further ones are only counted.
const MAX_ERRORS: usize = 20;
/// Some editors begin a file with this mark; it is not part of the text.
pub(super) const BYTE_ORDER_MARK: &str = "\u{feff}";

/// Whether `byte` ends a line.
pub(super) fn is_line_end(byte: u8) -> bool {
    matches!(byte, b'\n' | b'\r')
}

/// The errors so far, in the order of the file.
pub(super) struct Log<'a> {
    source: &'a [u8],
    /// The byte offset where the text begins, after a byte order mark.
    start: usize,
    place: Place,
    diagnostics: Vec<Diagnostic>,
    more: usize,
}

/// A position in the file. It only ever moves forward, so that computing all lines and columns
/// costs one pass.
#[derive(Clone, Copy)]
struct Place {
    offset: usize,
    line: usize,
    line_start: usize,
    column: usize,
}

impl<'a> Log<'a> {
    /// A log of `source` without errors.
    pub(super) fn new(source: &'a [u8]) -> Self {
        let start = if source.starts_with(BYTE_ORDER_MARK.as_bytes()) { BYTE_ORDER_MARK.len() } else { 0 };
        let place = Place { offset: start, line: 1, line_start: start, column: 1 };
        Log { source, start, place, diagnostics: Vec::new(), more: 0 }
    }

    /// The text, and the offset after a byte order mark where it begins. If the source is not
    /// UTF-8 or no scene at all, that error is noted, and this is None.
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

    /// Notes an error of `token`, which must not be before the last noted one.
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

    /// The line of an offset, which must not be before the last one asked for or noted.
    pub(super) fn line(&mut self, offset: usize) -> usize {
        self.place.advance(self.source, offset).line
    }

    /// The first error, if there is one.
    pub(super) fn first_mut(&mut self) -> Option<&mut Diagnostic> {
        self.diagnostics.first_mut()
    }

    /// `value` if there is one and no error was noted; otherwise the errors.
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
