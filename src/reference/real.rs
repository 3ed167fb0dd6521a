//! The two element types of the kernels, f32 and f64, behind one trait.

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A binary floating-point type with correctly rounded + - x / sqrt and fma.
pub trait Real:
    Copy
    + Debug
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// 0.
    const ZERO: Self;
    /// 1/2.
    const HALF: Self;
    /// 1.
    const ONE: Self;
    /// Greater than every finite number.
    const INFINITY: Self;

    /// Exact.
    fn from_f32(x: f32) -> Self;
    /// Rounded to nearest.
    fn from_f64(x: f64) -> Self;
    /// Rounded to nearest, exact up to 2^24.
    fn from_u32(x: u32) -> Self;
    /// The square root, NaN below 0.
    fn sqrt(self) -> Self;
    /// `self * b + c`, rounded once.
    fn mul_add(self, b: Self, c: Self) -> Self;
    fn abs(self) -> Self;
    /// Its magnitude with the sign of another.
    fn with_sign_of(self, sign: Self) -> Self;
}

macro_rules! real {
    ($t:ident) => {
        impl Real for $t {
            const ZERO: $t = 0.0;
            const HALF: $t = 0.5;
            const ONE: $t = 1.0;
            const INFINITY: $t = $t::INFINITY;

            fn from_f32(x: f32) -> $t {
                x.into()
            }
            fn from_f64(x: f64) -> $t {
                x as $t
            }
            fn from_u32(x: u32) -> $t {
                x as $t
            }
            fn sqrt(self) -> $t {
                self.sqrt()
            }
            fn mul_add(self, b: $t, c: $t) -> $t {
                self.mul_add(b, c)
            }
            fn abs(self) -> $t {
                self.abs()
            }
            fn with_sign_of(self, sign: $t) -> $t {
                self.copysign(sign)
            }
        }
    };
}
real!(f32);
real!(f64);
