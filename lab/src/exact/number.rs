//! The traits of the numbers that the truth is computed with: each has a sign, or knows that its
//! sign is not known.

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// The arithmetic of the truth.
pub trait Number: Clone + Debug {
    /// `x` itself.
    fn new(x: f64) -> Self;
    /// Rounded to the nearest f64.
    fn to_f64(&self) -> f64;
    /// Rounded to the sum of two f64.
    fn split(&self) -> Split;
    /// -1, 0 or 1; None if it is not known.
    fn sign(&self) -> Option<i8>;
    /// The square root of a number that is not less than 0.
    fn sqrt(&self) -> Self;
    fn abs(&self) -> Self;
    /// Whether its error is certainly no more than this.
    fn is_within(&self, error: f64) -> bool;
}

/// Numbers whose signs are taken for known, to exclude what is certain all the same.
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

/// Operations on references to such numbers.
pub trait Operations<N>:
    Copy + Add<Output = N> + Sub<Output = N> + Mul<Output = N> + Div<Output = N> + Neg<Output = N>
{
}

impl<'a, N> Operations<N> for &'a N where
    &'a N: Add<Output = N> + Sub<Output = N> + Mul<Output = N> + Div<Output = N> + Neg<Output = N>
{
}

/// A number to about 106 bits, as the sum of two f64: for fast comparisons with one of 1024 bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Split {
    /// The number rounded to nearest.
    pub high: f64,
    /// The rest, rounded to nearest.
    pub low: f64,
}

impl Split {
    /// x - self; to full f64 accuracy if x is near.
    pub fn error_of(self, x: f64) -> f64 {
        (x - self.high) - self.low
    }
}
