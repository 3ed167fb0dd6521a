//! Finds the first line of a scene file whose numbers do not form whole items of a list.
//!
//! If the count of a list disagrees with its lines, the mistake is there, although the error occurs
//! further down.

use super::log::is_line_end;
use super::token::{Kind, next_token};

/// A list of items whose count has been read.
pub(super) struct List {
    pub kind: &'static Kind,
    /// The number of items that the count says.
    pub count: u64,
    /// The number of tokens in the file before the list's first item.
    pub first: usize,
}

/// The first line before line `end` that begins with an item but does not consist of whole items.
/// None if items look as if they were deliberately split over several lines.
pub(super) fn first_misfit(text: &str, lists: &[List], end: usize) -> Option<String> {
    let mut lines = Lines { text: text.trim_start_matches('\u{feff}'), line: 1, from: 0, at: 0 };
    let mut before = 0_usize;
    loop {
        let rest = lines.clone();
        let (line, tokens) = lines.next().filter(|(line, _)| *line < end)?;
        let begins = |list: &&List| {
            let gone = before.checked_sub(list.first).filter(|gone| gone.is_multiple_of(list.kind.tokens));
            gone.is_some_and(|gone| ((gone / list.kind.tokens) as u64) < list.count)
        };
        if let Some(List { kind, first, .. }) = lists.iter().rev().find(begins)
            && !tokens.is_multiple_of(kind.tokens)
            && !is_split(rest, kind.tokens)
        {
            let (Kind { one, tokens: each, .. }, number) = (kind, 1 + (before - first) / kind.tokens);
            let what = if tokens < *each {
                format!("line {line} has {tokens} of the {each} numbers of {one} {number}")
            } else {
                format!("line {line} has {tokens} numbers, and a {one} takes {each}")
            };
            return Some(what);
        }
        before += tokens;
    }
}

/// Whether the next lines hold one item of this many tokens, as if split deliberately: with one
/// token per line, or with more than one in the last line (a single one would look like a count).
fn is_split(lines: Lines<'_>, tokens: usize) -> bool {
    let (mut sum, mut most) = (0, 0);
    for (_, of_line) in lines {
        sum += of_line;
        most = most.max(of_line);
        if sum >= tokens {
            return sum == tokens && (of_line > 1 || most == 1);
        }
    }
    false
}

/// The lines that have tokens: for each its number from 1 and the number of its tokens.
#[derive(Clone)]
struct Lines<'a> {
    text: &'a str,
    line: usize,
    /// Lines have been counted up to the offset `from`, and tokens read up to `at`.
    from: usize,
    at: usize,
}

impl Iterator for Lines<'_> {
    type Item = (usize, usize);

    fn next(&mut self) -> Option<Self::Item> {
        let bytes = self.text.as_bytes();
        let mut tokens = 0;
        while let Some(token) = next_token(bytes, self.at) {
            let between = &self.text[self.from..token.start];
            // CR LF counts as one line end.
            let ends = between.bytes().filter(|byte| is_line_end(*byte)).count() - between.matches("\r\n").count();
            if ends > 0 && tokens > 0 {
                break;
            }
            self.line += ends;
            (self.from, self.at) = (token.start, token.end);
            tokens += 1;
        }
        (tokens > 0).then_some((self.line, tokens))
    }
}
