//! The listings of `rayo ops`: implementations of an operation side by side, and one function
//! beside its source.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use crate::{BOLD, CYAN, DIM, PLAIN, YELLOW, styled};
use rayo_lab::experiments::ops::{ALL_OPERATIONS, Counts, Kernel, LIT, Line, Report, Source};
use rayo_lab::measure::instructions::Function;

/// The fewest columns side by side, however narrow the terminal is.
const ABREAST: usize = 2;
/// The width of a label, and the width that the text of most instructions fits into.
const LABEL: usize = 5;
const TEXT: usize = 44;

/// An instruction prepared for printing.
struct Shown<'a> {
    line: &'a Line,
    /// The label of this instruction, if another one jumps to it; else empty.
    label: String,
    /// The instruction in Intel's syntax, with the label of its jump target.
    text: String,
    /// Whether the function in the first column of the listing has this instruction too, in the same
    /// order.
    common: bool,
}

/// The instructions of a function, with labels in place of offsets.
fn shown(listing: &[Line]) -> Vec<Shown<'_>> {
    let targets: BTreeSet<_> = listing.iter().filter_map(|line| line.target).collect();
    let labels: Vec<_> = listing.iter().map(|line| line.offset).filter(|offset| targets.contains(offset)).collect();
    let label = |offset| Some(format!(".{}", 1 + labels.binary_search(&offset).ok()?));
    let text = |line: &Line| {
        let operation = line.text.split(' ').next().unwrap_or_default();
        line.target.and_then(label).map_or(line.text.clone(), |label| format!("{operation} {label}"))
    };
    let shown = |line| Shown {
        line,
        label: label(line.offset).map_or(String::new(), |label| label + ":"),
        text: text(line),
        common: true,
    };
    listing.iter().map(shown).collect()
}

/// The listings of each operation, in lines of this many characters.
pub fn text(report: &Report, width: usize, colour: bool) -> String {
    let mut text = String::new();
    let mut side_by_side = false;
    for op in ALL_OPERATIONS.into_iter().chain([LIT]) {
        let rows: Vec<_> = report.rows.iter().filter(|row| row.op == op && !row.listing.is_empty()).collect();
        // The implementation that the others are compared with: the paper's macros, or else the
        // first one.
        let Some(base) = rows.iter().find(|row| row.implementation == "paper").or(rows.first()) else { continue };
        let others: Vec<_> = rows.iter().filter(|row| row.implementation != base.implementation).collect();
        writeln!(text, "{}", styled(colour, BOLD, op)).unwrap();
        if others.is_empty() {
            writeln!(text, "{}", styled(colour, BOLD, &title(base))).unwrap();
            beside_source(&mut text, &base.listing, width, colour);
            continue;
        }
        side_by_side = true;
        // As many columns as fit without truncating a line, but at least ABREAST.
        let longest = rows.iter().flat_map(|row| shown(&row.listing)).map(|line| cell(&line).chars().count()).max();
        let abreast = (width / (longest.unwrap_or(0) + 1)).clamp(ABREAST, rows.len());
        for others in others.chunks(abreast - 1) {
            band(&mut text, base, others, width / abreast, colour);
        }
    }
    text += "|  part of the body";
    text += if side_by_side { "     *  not in the first column, or not in that order\n" } else { "\n" };
    if side_by_side {
        text += "one --engine alone, or --kernel, has the source beside each instruction\n";
    }
    if report.rows.iter().flat_map(|row| &row.listing).any(|line| line.executed.is_some()) {
        text += "numbers at the left of a line: how often a call on the common path executes it\n";
    }
    if let Some(reason) = &report.executed_unavailable {
        writeln!(text, "executed instructions cannot be counted here: {reason}").unwrap();
    }
    text
}

/// The listings of functions of the object files.
pub fn kernels(kernels: &[Kernel], width: usize, colour: bool) -> String {
    let mut text = String::new();
    for Kernel { function: Function { object, symbol, bytes }, instructions, listing } in kernels {
        let about = format!(" in {object}: {instructions} instructions, {bytes} bytes");
        writeln!(text, "{}{about}", styled(colour, BOLD, symbol)).unwrap();
        beside_source(&mut text, listing, width, colour);
    }
    text
}

/// The symbols of functions that can be listed, one per line.
pub fn symbols(functions: &[Function]) -> String {
    let longest = functions.iter().map(|function| function.symbol.len()).max().unwrap_or(0);
    let line =
        |Function { object, symbol, bytes }: &Function| format!("{symbol:<longest$} {bytes:>7} bytes  {object}\n");
    functions.iter().map(line).collect()
}

fn title(row: &Counts) -> String {
    format!("  {} ({})", row.implementation, row.listing.len())
}

/// A function with one instruction per line and its source to the right. Several nops in a row,
/// which align a loop, are one line.
fn beside_source(text: &mut String, listing: &[Line], width: usize, colour: bool) {
    let lines = shown(listing);
    let longest = lines.iter().map(|line| cell(line).chars().count()).max().unwrap_or(0).min(LABEL + TEXT);
    let pads = |a: &Shown, b: &Shown| a.text == "nop" && b.text == "nop" && b.label.is_empty();
    for lines in lines.chunk_by(pads) {
        let line = &lines[0];
        let times = if lines.len() > 1 { format!(", {} times", lines.len()) } else { String::new() };
        let cell = cell(line) + &times;
        let shown = styled(colour && line.line.target.is_some(), CYAN, &cell);
        let taken = cell.chars().count().max(longest) + 2;
        let gap = " ".repeat(taken - cell.chars().count());
        let source = line.line.source.as_ref().map_or(String::new(), |it| origin(it, width.saturating_sub(taken)));
        let gap = if source.is_empty() { "" } else { &gap };
        writeln!(text, "{shown}{gap}{}", styled(colour, DIM, &source)).unwrap();
    }
    writeln!(text).unwrap();
}

/// The source line of an instruction and the macros around it, innermost first, as far as there is
/// room.
fn origin(Source { file, line, macros, .. }: &Source, room: usize) -> String {
    let file = file.rsplit('/').next().unwrap_or_default();
    let mut origin = if file.is_empty() { String::new() } else { format!("{file}:{line}") };
    for (depth, name) in macros.iter().rev().enumerate() {
        let more = format!("{}{name}", if depth == 0 { "  " } else { " < " });
        if origin.chars().count() + more.chars().count() > room {
            break;
        }
        origin += &more;
    }
    if origin.chars().count() > room { String::new() } else { origin }
}

/// The text of an instruction in a column.
fn cell(Shown { line, label, text, common }: &Shown<'_>) -> String {
    let times = line.executed.map_or(String::new(), |times| format!("{times} "));
    let marks = [if *common { ' ' } else { '*' }, if line.body { '|' } else { ' ' }].iter().collect::<String>();
    format!("{label:<LABEL$}{marks}{times}{text}")
}

/// Listings side by side. Each takes `width` characters, including a space at its end.
fn band(text: &mut String, base: &Counts, others: &[&&Counts], width: usize, colour: bool) {
    let width = width - 1;
    let base_lines = shown(&base.listing);
    let texts = |lines: &[Shown<'_>]| lines.iter().map(|line| line.text.clone()).collect::<Vec<_>>();
    let base_texts = texts(&base_lines);
    let mut columns = vec![(base, base_lines)];
    for row in others {
        let mut lines = shown(&row.listing);
        let common = common(&base_texts, &texts(&lines));
        lines.iter_mut().zip(common).for_each(|(line, common)| line.common = common);
        columns.push((row, lines));
    }
    let heads: String = columns.iter().map(|(row, _)| format!("{:<width$} ", title(row))).collect();
    writeln!(text, "{}", styled(colour, BOLD, heads.trim_end())).unwrap();
    for i in 0..columns.iter().map(|(_, lines)| lines.len()).max().unwrap_or(0) {
        let cells = columns.iter().map(|(_, lines)| {
            let cell = lines.get(i).map_or(String::new(), cell);
            // Listings without a marked body, such as those of C, are not dimmed, nor is each of
            // their lines marked as different from the first column.
            let has_body = lines.iter().any(|line| line.line.body);
            let style = lines.get(i).map_or(PLAIN, |line| {
                if has_body && !line.line.body {
                    DIM
                } else if has_body && !line.common {
                    YELLOW
                } else {
                    PLAIN
                }
            });
            (format!("{cell:<width$.width$} "), style)
        });
        let mut cells: Vec<_> = cells.collect();
        while cells.last().is_some_and(|(cell, _)| cell.trim().is_empty()) {
            cells.pop();
        }
        if let Some((last, _)) = cells.last_mut() {
            last.truncate(last.trim_end().len());
        }
        let line: String = cells.iter().map(|(cell, style)| styled(colour && *style != PLAIN, style, cell)).collect();
        writeln!(text, "{line}").unwrap();
    }
    writeln!(text).unwrap();
}

/// Which lines of `b` belong to a longest common subsequence with `a`.
fn common(a: &[String], b: &[String]) -> Vec<bool> {
    let mut longest = vec![vec![0_usize; b.len() + 1]; a.len() + 1];
    for i in (0..a.len()).rev() {
        for j in (0..b.len()).rev() {
            longest[i][j] =
                if a[i] == b[j] { longest[i + 1][j + 1] + 1 } else { longest[i + 1][j].max(longest[i][j + 1]) };
        }
    }
    let mut common = vec![false; b.len()];
    let (mut i, mut j) = (0, 0);
    while i < a.len() && j < b.len() {
        if a[i] == b[j] {
            common[j] = true;
            (i, j) = (i + 1, j + 1);
        } else if longest[i + 1][j] >= longest[i][j + 1] {
            i += 1;
        } else {
            j += 1;
        }
    }
    common
}

#[cfg(test)]
mod tests {
    use super::{beside_source, common};
    use rayo_lab::experiments::ops::Line;

    fn line(offset: usize, text: &str, target: Option<usize>) -> Line {
        Line { offset, text: text.into(), body: false, executed: None, target, source: None }
    }

    #[test]
    fn lines_are_common_where_they_come_in_the_same_order() {
        let lines = |text: &str| text.split(' ').map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(common(&lines("a b c d"), &lines("a x c d")), [true, false, true, true]);
        assert_eq!(common(&lines("a b"), &lines("b a")), [true, false]);
        assert_eq!(common(&lines("a"), &lines("b c")), [false, false]);
    }

    #[test]
    fn what_pads_up_to_a_loop_is_one_line() {
        let listing = [line(0, "nop", None), line(1, "nop", None), line(2, "dec eax", None), line(4, "jg 2", Some(2))];
        let mut text = String::new();
        beside_source(&mut text, &listing, 80, false);
        assert_eq!(text, "       nop, 2 times\n.1:    dec eax\n       jg .1\n\n");
    }
}
