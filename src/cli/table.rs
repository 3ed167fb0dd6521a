//! Tables in Markdown that read well as they are.

use std::fmt::Write as _;

/// A table in Markdown whose columns are as wide as they need to be; all but the first `left` are aligned to the right.
pub struct Table {
    left: usize,
    head: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    pub fn new<S: Into<String>>(left: usize, head: impl IntoIterator<Item = S>) -> Self {
        Table { left, head: head.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// Adds a row.
    ///
    /// # Panics
    /// If it has not as many cells as the head.
    pub fn row(&mut self, cells: Vec<String>) {
        assert_eq!(cells.len(), self.head.len());
        self.rows.push(cells);
    }

    pub fn text(&self) -> String {
        let chars = |cell: &String| cell.chars().count();
        let lines = || [&self.head].into_iter().chain(&self.rows);
        let widths: Vec<_> =
            (0..self.head.len()).map(|i| lines().map(|row| chars(&row[i])).max().unwrap_or(0).max(3)).collect();
        let mut text = String::new();
        for (number, row) in lines().enumerate() {
            for (i, (cell, width)) in row.iter().zip(&widths).enumerate() {
                let gap = " ".repeat(width - chars(cell));
                let (left, right) = if i < self.left { ("", gap.as_str()) } else { (gap.as_str(), "") };
                write!(text, "| {left}{cell}{right} ").expect("a String takes all");
            }
            text += "|\n";
            if number == 0 {
                for (i, width) in widths.iter().enumerate() {
                    let dashes = "-".repeat(*width);
                    text += &if i < self.left { format!("|-{dashes}-") } else { format!("|-{dashes}:") };
                }
                text += "|\n";
            }
        }
        text
    }
}
