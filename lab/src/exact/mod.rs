//! Arithmetic whose signs are sure: the shapes of a scene in 1024 bits, or in fewer where these are
//! sure.
//!
//! [`shapes`] and [`shadows`] have the formulas, over any [`number`]; [`digits`] has the 1024 bits,
//! and [`bounded`] the fewer ones, which know how far they may be off.

pub mod bounded;
pub mod digits;
pub mod number;
pub mod shadows;
pub mod shapes;
