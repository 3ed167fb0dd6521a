//! The first line of a scene file that does not hold the numbers of an object.
//!
//! Where a count and its lines disagree, that is the place to look, and the error shows further down.

use super::log::is_line_end;
use super::parse::{Kind, next_token};

/// A list whose count has been read.
pub(super) struct List {
    pub kind: &'static Kind,
    /// Its items, as its count says.
    pub count: u64,
    /// The tokens of the file that come before the first one's.
    pub first: usize,
}

/// The first line, before the line `end`, at whose beginning an item begins and that is no whole number of items. Where an
/// item takes several lines as if that was meant, there is none.
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

/// Whether an item of so many tokens takes the next lines whole, as if somebody had meant it: with more than one token in
/// the last, for one alone is what a count looks like, or with one in each.
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

/// The lines that have tokens, by their numbers from 1, and how many each has.
#[derive(Clone)]
struct Lines<'a> {
    text: &'a str,
    line: usize,
    /// Up to where lines have been counted, and tokens read.
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
            // Of CR LF one counts.
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
