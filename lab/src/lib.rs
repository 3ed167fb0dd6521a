//! `rayo-lab`: what measures and judges the kernels of `rayo`, for its program and its tests.
//!
//! From the top downwards: [`experiments`], each of which returns rows; the [`truth`] of a picture
//! in [`exact`] arithmetic; the [`families`] of ill-conditioned scenes; [`measure`], with clocks,
//! statistics and counted instructions. The lab uses the library's internals through
//! `rayo::internals`, and may change at any time.

pub mod exact;
pub mod experiments;
pub mod families;
pub mod measure;
pub mod operands;
pub mod truth;
