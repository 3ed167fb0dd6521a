//! `rayo`: the paper *Trazado de rayos vectorizado* in NASM, C and Rust, from a scene file to a picture.
//!
//! `ARCHITECTURE.md` has the layers and the reasons; imports go only downwards:
//! `cli -> experiments -> render -> plan -> { measure, scene } -> { kernels, reference }`.

// The example of the README is a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

pub mod cli;
pub mod experiments;
pub mod kernels;
pub mod measure;
pub mod plan;
pub mod reference;
pub mod render;
pub mod scene;
