//! The experiments: each returns rows.
