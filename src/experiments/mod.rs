//! The experiments: each returns rows.

pub mod ablation;
pub mod accuracy;
#[cfg(rayo_asm)]
pub mod claims;
#[cfg(rayo_asm)]
pub mod complexity;
#[cfg(rayo_asm)]
pub mod document;
#[cfg(rayo_asm)]
pub mod jumps;
#[cfg(rayo_asm)]
pub mod ladder;
#[cfg(rayo_asm)]
pub mod ops;
#[cfg(rayo_asm)]
pub mod plot;
#[cfg(rayo_asm)]
pub mod speedup;
pub mod stability;
#[cfg(rayo_asm)]
pub mod step;
mod svg;
