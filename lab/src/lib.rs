//! `rayo-lab`: what measures and judges the kernels of `rayo`, for its program and its tests.
//!
//! Downwards: [`experiments`], each of which returns rows; the [`truth`] of a picture in [`exact`]
//! arithmetic; the [`families`] of stiff scenes; [`measure`], with clocks, statistics and counted
//! instructions. It reaches the library behind its interface, by `rayo::internals`, and may change
//! at any time.

pub mod exact;
pub mod experiments;
pub mod families;
pub mod measure;
pub mod operands;
pub mod truth;
