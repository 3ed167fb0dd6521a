//! Arithmetic whose signs are certain: intersections of rays and objects in 1024 bits, or in fewer
//! bits where these suffice.
//!
//! [`shapes`] and [`shadows`] have the formulas, generic over [`number`]; [`digits`] has the
//! numbers of 1024 bits, and [`bounded`] shorter ones with a bound on their error.

pub mod bounded;
pub mod digits;
pub mod number;
pub mod shadows;
pub mod shapes;
