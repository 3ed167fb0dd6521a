//! The document docs/accuracy.md.

use super::table::{reasons, summary_table};
use crate::experiments::accuracy::Document;
use crate::experiments::accuracy::summary::summaries;

/// All of it.
pub(super) fn text(document: &Document) -> String {
    let mut text = String::from("# Error against run time\n\n");
    text += &summary_table(&summaries(&document.rows));
    text += "\n";
    text += &reasons(&document.off_every_front);
    text
}
