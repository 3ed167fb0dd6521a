//! Markdown tables that are readable as plain text.

use std::fmt::Write as _;

use maud::{Markup, html};

/// A column of a table whose rows are `T`s: the heading, and the text of a cell.
pub type Column<T> = (&'static str, fn(&T) -> String);

/// A CSV: a line of headings, and one for each row.
pub fn csv<T>(columns: &[Column<T>], rows: &[T]) -> String {
    let heads = columns.iter().map(|(head, _)| (*head).to_owned()).collect::<Vec<_>>();
    let cells = |row: &T| columns.iter().map(|(_, cell)| cell(row)).collect();
    [heads].into_iter().chain(rows.iter().map(cells)).map(|cells| cells.join(",") + "\n").collect()
}

/// A Markdown table whose columns are as wide as their content; the first `left` columns are
/// aligned to the left, the others to the right.
pub struct Table {
    left: usize,
    head: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    pub fn new<S: Into<String>>(left: usize, head: impl IntoIterator<Item = S>) -> Self {
        Table { left, head: head.into_iter().map(Into::into).collect(), rows: Vec::new() }
    }

    /// A table with these columns and rows.
    pub fn of<'a, T: 'a>(left: usize, columns: &[Column<T>], rows: impl IntoIterator<Item = &'a T>) -> Table {
        let mut table = Table::new(left, columns.iter().map(|(head, _)| *head));
        rows.into_iter().for_each(|row| table.row(columns.iter().map(|(_, cell)| cell(row)).collect()));
        table
    }

    /// The table as HTML; the first cell of each row is its heading.
    pub fn html(&self) -> Markup {
        let class = |place: usize| if place < self.left { "left" } else { "number" };
        html! {
            div.scroll tabindex="0" {
                table {
                    thead { tr { @for (i, cell) in self.head.iter().enumerate() { th.(class(i)) scope="col" { (cell) } } } }
                    tbody {
                        @for row in &self.rows {
                            tr {
                                @for (i, cell) in row.iter().enumerate() {
                                    @if i == 0 { th.(class(i)) scope="row" { (words(cell)) } } @else { td.(class(i)) { (words(cell)) } }
                                }
                            }
                        }
                    }
                }
            }
        }
    }

    /// Adds a row.
    ///
    /// # Panics
    /// If it has another number of cells than the heading.
    pub fn row(&mut self, cells: Vec<String>) {
        assert_eq!(cells.len(), self.head.len());
        self.rows.push(cells);
    }

    /// The table with this many columns aligned to the left.
    pub fn left(self, left: usize) -> Self {
        Table { left, ..self }
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

    /// The table without padding, for readers who see the Markdown rendered.
    pub fn compact(&self) -> String {
        let line = |cells: &Vec<String>| format!("| {} |\n", cells.join(" | "));
        let dashes = (0..self.head.len()).map(|i| if i < self.left { "---|" } else { "--:|" });
        let rule = format!("|{}\n", dashes.collect::<String>());
        [line(&self.head), rule].into_iter().chain(self.rows.iter().map(line)).collect()
    }
}

/// Text with code between backticks, as HTML.
pub(super) fn words(text: &str) -> Markup {
    html! { @for (i, piece) in text.split('`').enumerate() { @if i % 2 == 0 { (piece) } @else { code { (piece) } } } }
}
