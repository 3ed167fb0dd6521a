//! The experiments: each returns rows.

#[cfg(rayo_asm)]
pub mod ops;
