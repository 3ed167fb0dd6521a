//! The traits of the numbers that the truth is computed with. A number either knows its sign or
//! knows that the sign is unknown.

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// The arithmetic of the truth.
pub trait Number: Clone + Debug {
    /// The number equal to `x`.
    fn new(x: f64) -> Self;
    /// The number rounded to the nearest f64.
    fn to_f64(&self) -> f64;
    /// The number rounded to a sum of two f64.
    fn split(&self) -> Split;
    /// The sign: -1, 0 or 1. None if it is unknown.
    fn sign(&self) -> Option<i8>;
    /// The square root of a number that is not less than 0.
    fn sqrt(&self) -> Self;
    fn abs(&self) -> Self;
    /// Whether the error of the number is certainly at most `error`.
    fn is_within(&self, error: f64) -> bool;
}

/// f64, all of whose signs are taken as known. It serves to exclude objects that a ray certainly
/// misses.
impl Number for f64 {
    fn new(x: f64) -> Self {
        x
    }

    fn to_f64(&self) -> f64 {
        *self
    }

    fn split(&self) -> Split {
        Split { high: *self, low: 0.0 }
    }

    fn sign(&self) -> Option<i8> {
        self.partial_cmp(&0.0).map(|order| order as i8)
    }

    fn sqrt(&self) -> Self {
        f64::sqrt(*self)
    }

    fn abs(&self) -> Self {
        f64::abs(*self)
    }

    fn is_within(&self, _: f64) -> bool {
        true
    }
}

/// Arithmetic operators on references to such numbers.
pub trait Operations<N>:
    Copy + Add<Output = N> + Sub<Output = N> + Mul<Output = N> + Div<Output = N> + Neg<Output = N>
{
}

impl<'a, N> Operations<N> for &'a N where
    &'a N: Add<Output = N> + Sub<Output = N> + Mul<Output = N> + Div<Output = N> + Neg<Output = N>
{
}

/// A number with about 106 bits, as the sum of two f64, for fast comparisons with a number of 1024
/// bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Split {
    /// The number, rounded to nearest.
    pub high: f64,
    /// The number minus `high`, rounded to nearest.
    pub low: f64,
}

impl Split {
    /// x minus this number; to full f64 accuracy if x is near it.
    pub fn error_of(self, x: f64) -> f64 {
        (x - self.high) - self.low
    }
}
