//! Fits text to the width of a terminal: splits wide tables, and breaks lines between words.

/// The text in lines of `width` characters, where that is possible. Cells of Markdown tables are
/// not broken.
pub fn fit(text: &str, width: usize) -> String {
    let mut fitted = String::new();
    let lines: Vec<_> = text.lines().collect();
    for block in lines.chunk_by(|a, b| a.starts_with('|') && b.starts_with('|')) {
        let wide = block.iter().any(|line| shown_length(line) > width);
        match block {
            [] => {}
            _ if !wide => block.iter().for_each(|line| fitted += &format!("{line}\n")),
            [_, rule, ..] if rule.starts_with("|-") => table(&mut fitted, block, width),
            _ => block.iter().for_each(|line| wrap(&mut fitted, line, width)),
        }
    }
    fitted
}

/// Splits a table into several, each with the leading columns of words and as many number columns
/// as fit. The leading columns are those before the first number column, as long as they take at
/// most half of the width; the first column always is one.
fn table(fitted: &mut String, lines: &[&str], width: usize) {
    let lines: Vec<Vec<char>> = lines.iter().map(|line| line.chars().collect()).collect();
    // The bounds of the columns. The rule below the heading has a bar exactly there, unlike other
    // lines, and all cells are aligned with it.
    let bars: Vec<_> = (0..lines[1].len()).filter(|at| lines[1][*at] == '|').collect();
    let columns: Vec<_> = bars.windows(2).map(|bars| bars[0]..bars[1]).collect();
    let mut words = 0;
    let of_words = columns.iter().take_while(|column| {
        words += column.len();
        lines[1][column.end - 1] != ':' && words <= width / 2
    });
    let (first, mut rest) = columns.split_at(of_words.count().max(1));
    while !rest.is_empty() {
        let mut taken = first.iter().map(|column| column.len()).sum::<usize>() + 1;
        let fitting = rest.iter().take_while(|column| {
            taken += column.len();
            taken <= width
        });
        let (now, later) = rest.split_at(fitting.count().max(1));
        for line in &lines {
            let cells = first.iter().chain(now).flat_map(|column| &line[column.clone()]);
            fitted.extend(cells.chain(&['|', '\n']));
        }
        *fitted += if later.is_empty() { "" } else { "\n" };
        rest = later;
    }
}

/// Breaks a line between words. Continued lines are indented: to the text after a label if the line
/// begins with one, or as the line itself, at least by two spaces.
fn wrap(fitted: &mut String, line: &str, width: usize) {
    let start = spaces_at(line);
    let text = match line[start..].find("  ") {
        Some(label) => line[..start + label].chars().count() + spaces_at(&line[start + label..]),
        None => start.max(2),
    };
    let indent = " ".repeat(if text <= width / 3 { text } else { 2 });
    let (mut length, mut words) = (0, 0);
    // Splitting at single spaces keeps wider gaps within a line as they are.
    for word in line.split_inclusive(' ') {
        let word_length = word.trim_end().chars().count();
        if length + word_length > width && words > 0 {
            fitted.truncate(fitted.trim_end_matches(' ').len());
            *fitted += &format!("\n{indent}");
            (length, words) = (indent.len(), 0);
            if word_length == 0 {
                continue;
            }
        }
        *fitted += word;
        length += word.chars().count();
        words += usize::from(word_length > 0);
    }
    *fitted += "\n";
}

/// The number of characters that a terminal shows: escape sequences for styles (SGR) take no space.
fn shown_length(line: &str) -> usize {
    let mut parts = line.split("\u{1b}[");
    let first = parts.next().map_or(0, |part| part.chars().count());
    first + parts.map(|part| part.split_once('m').map_or(part, |(_, shown)| shown).chars().count()).sum::<usize>()
}

fn spaces_at(text: &str) -> usize {
    text.len() - text.trim_start_matches(' ').len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::Table;

    #[test]
    fn what_fits_stays_as_it_is() {
        let text = "a line\n\n| a | b |\n|---|---|\n| 1 | 2 |\n  another\n";
        assert_eq!(fit(text, 9), text);
    }

    #[test]
    fn styles_take_no_place() {
        let text = "\u{1b}[2ma line\u{1b}[0m of \u{1b}[1mten\u{1b}[0m\n";
        assert_eq!((shown_length(text.trim_end()), fit(text, 13)), (13, text.into()));
    }

    #[test]
    fn wide_table_is_cut_with_its_first_column_repeated() {
        let mut table = Table::new(1, ["name", "first", "second", "third"]);
        table.row(["a", "1", "2", "3"].map(Into::into).to_vec());
        table.row(["b", "4", "\u{d7}5", "6"].map(Into::into).to_vec());
        let expected = "\
| name | first |
|------|------:|
| a    |     1 |
| b    |     4 |

| name | second |
|------|-------:|
| a    |      2 |
| b    |     \u{d7}5 |

| name | third |
|------|------:|
| a    |     3 |
| b    |     6 |
";
        assert_eq!(fit(&table.text(), 20), expected);
        // Where not even two columns fit, nothing is lost.
        assert_eq!(fit(&table.text(), 5), expected);
        assert_eq!(fit(&table.text(), 30).lines().next(), Some("| name | first | second |"));
    }

    #[test]
    fn a_long_line_is_broken_between_words() {
        assert_eq!(fit("one two three four\n", 9), "one two\n  three\n  four\n");
        assert_eq!(fit("- one two three\n  four five six\n", 11), "- one two\n  three\n  four five\n  six\n");
        assert_eq!(fit("a    one two three four\n", 15), "a    one two\n     three four\n");
        assert_eq!(fit("   a one two three four\n", 15), "   a one two\n   three four\n");
        // A word that is longer than a line is not cut.
        assert_eq!(fit("a bcdefghij k\n", 4), "a\n  bcdefghij\n  k\n");
    }
}
