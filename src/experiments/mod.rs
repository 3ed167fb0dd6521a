//! The experiments: each returns rows.

pub mod document;
pub mod speedup;
