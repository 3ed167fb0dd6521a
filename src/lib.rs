//! `rayo`: the paper *Trazado de rayos vectorizado* in NASM, C and Rust, from a scene file to a picture.
//!
//! `ARCHITECTURE.md` has the layers and the reasons; imports go only downwards:
//! `cli -> experiments -> render -> plan -> { measure, scene } -> { kernels, reference }`.
//!
//! Without its default features this is scenes, plan, engines and films; `asm`, `files`, `lab` and `cli` are what else there is.

// The example of the README is a test.
#[cfg(all(doctest, feature = "cli"))]
#[doc = include_str!("../README.md")]
struct Readme;

/// The vectors that scenes are made of.
pub use glam;

#[cfg(feature = "cli")]
pub mod cli;
#[cfg(feature = "lab")]
pub mod experiments;
pub mod kernels;
pub mod measure;
pub mod plan;
#[cfg(feature = "mpi")]
pub mod ranks;
pub mod reference;
pub mod render;
pub mod scene;
