//! The listings of `rayo ops --asm`, side by side.

use std::fmt::Write as _;

use crate::experiments::ops::{Counts, Line, OPS, Report};

/// The least and the most columns beside each other.
const ABREAST: (usize, usize) = (2, 4);

/// The listing of each operation, in lines of so many characters.
pub fn text(report: &Report, width: usize) -> String {
    let mut text = String::new();
    for op in OPS {
        let rows: Vec<_> = report.rows.iter().filter(|row| row.op == op && !row.listing.is_empty()).collect();
        // What the others are held against: the paper's macros, or else the first.
        let Some(base) = rows.iter().find(|row| row.implementation == "paper").or(rows.first()) else { continue };
        let others: Vec<_> = rows.iter().filter(|row| row.implementation != base.implementation).collect();
        writeln!(text, "{op}").unwrap();
        if others.is_empty() {
            band(&mut text, base, &[], width);
        }
        // As many as fit without cutting a line off, as far as that goes.
        let lines = rows.iter().flat_map(|row| &row.listing);
        let longest = lines.map(|line| cell(line, true).chars().count()).max().unwrap_or(0);
        let abreast = (width / (longest + 1)).clamp(ABREAST.0, ABREAST.1).min(rows.len());
        for others in others.chunks((abreast - 1).max(1)) {
            band(&mut text, base, others, width / abreast);
        }
    }
    text += "|  part of the body     *  not in the first column, or not in that order\n";
    if report.rows.iter().flat_map(|row| &row.listing).any(|line| line.executed.is_some()) {
        text += "numbers at the left of a line: how often a call on the common path executes it\n";
    }
    if let Some(reason) = &report.executed_unavailable {
        writeln!(text, "executed instructions cannot be counted here: {reason}").unwrap();
    }
    text
}

/// A line as it is printed.
fn cell(line: &Line, common: bool) -> String {
    let times = line.executed.map_or(String::new(), |times| format!("{times} "));
    format!("{}{}{times}{}", if common { ' ' } else { '*' }, if line.body { '|' } else { ' ' }, line.text)
}

/// Listings beside each other, each in so many characters, a space at the end included.
fn band(text: &mut String, base: &Counts, others: &[&&Counts], width: usize) {
    let width = width - 1;
    let lines_of = |row: &Counts| row.listing.iter().map(|line| line.text.clone()).collect::<Vec<_>>();
    let base_lines = lines_of(base);
    let mut columns = vec![(base, vec![true; base_lines.len()])];
    columns.extend(others.iter().map(|row| (**row, common(&base_lines, &lines_of(row)))));
    let mut line = String::new();
    for (row, _) in &columns {
        write!(line, "{:<width$} ", format!("  {} ({})", row.implementation, row.listing.len())).unwrap();
    }
    writeln!(text, "{}", line.trim_end()).unwrap();
    for i in 0..columns.iter().map(|(row, _)| row.listing.len()).max().unwrap_or(0) {
        let mut line = String::new();
        for (row, common) in &columns {
            let cell = row.listing.get(i).map_or(String::new(), |line| cell(line, common[i]));
            write!(line, "{cell:<width$.width$} ").unwrap();
        }
        writeln!(text, "{}", line.trim_end()).unwrap();
    }
    writeln!(text).unwrap();
}

/// Which lines of `b` are part of the longest sequence that it has in common with `a`.
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
    use super::common;

    #[test]
    fn lines_are_common_where_they_come_in_the_same_order() {
        let lines = |text: &str| text.split(' ').map(str::to_owned).collect::<Vec<_>>();
        assert_eq!(common(&lines("a b c d"), &lines("a x c d")), [true, false, true, true]);
        assert_eq!(common(&lines("a b"), &lines("b a")), [true, false]);
        assert_eq!(common(&lines("a"), &lines("b c")), [false, false]);
    }
}
