//! Numbers of 1024 bits, whose signs count as known.
//!
//! Inputs are f32 or f64 data, which are taken as exact. 1024 bits suffice for a product of three
//! coordinates of a scene, which are f32: it is a multiple of 2^-447 below 2^384, and sums of such
//! products are exact.

use std::ops::{Add, Div, Mul, Neg, Sub};

use dashu_float::FBig;
use dashu_float::round::mode::HalfEven;

use super::number::{Number, Split};

pub const BITS: usize = 1024;

/// A finite number of [`BITS`] bits with an unlimited exponent. Operations round to nearest.
#[derive(Clone, Debug, PartialEq, PartialOrd)]
pub struct Exact(FBig<HalfEven, 2>);

impl Exact {
    /// Whether the number is greater than 0.
    pub fn is_positive(&self) -> bool {
        self.sign() == Some(1)
    }

    /// Whether the number is less than 0.
    pub fn is_negative(&self) -> bool {
        self.sign() == Some(-1)
    }
}

impl Number for Exact {
    /// # Panics
    /// If `x` is not finite.
    fn new(x: f64) -> Self {
        let x: FBig<HalfEven, 2> = x.try_into().unwrap_or_else(|_| panic!("an exact number is finite, not {x}"));
        assert!(x.repr().is_finite(), "an exact number is finite");
        // A result has the precision of its more precise operand.
        Exact(x.with_precision(BITS).value())
    }

    fn to_f64(&self) -> f64 {
        self.0.to_f64().value()
    }

    fn split(&self) -> Split {
        let high = self.to_f64();
        Split { high, low: (self - &Exact::new(high)).to_f64() }
    }

    fn sign(&self) -> Option<i8> {
        Some(self.0.cmp(&FBig::ZERO) as i8)
    }

    /// 0 for a negative number.
    fn sqrt(&self) -> Self {
        if self.is_positive() { Exact(self.0.sqrt()) } else { Exact::new(0.0) }
    }

    fn abs(&self) -> Self {
        if self.is_negative() { -self } else { self.clone() }
    }

    fn is_within(&self, _: f64) -> bool {
        true
    }
}

macro_rules! operation {
    ($trait:ident, $name:ident) => {
        impl $trait for &Exact {
            type Output = Exact;
            fn $name(self, other: &Exact) -> Exact {
                Exact((&self.0).$name(&other.0))
            }
        }
    };
}
operation!(Add, add);
operation!(Sub, sub);
operation!(Mul, mul);
operation!(Div, div);

impl Neg for &Exact {
    type Output = Exact;
    fn neg(self) -> Exact {
        Exact(-&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_their_bits() {
        let (one, tiny) = (Exact::new(1.0), Exact::new(2f64.powi(-1020)));
        assert_eq!((&(&one + &tiny) - &one).to_f64(), 2f64.powi(-1020));
        let root = Exact::new(2.0).sqrt();
        let error = (&(&root * &root) - &Exact::new(2.0)).abs().to_f64();
        assert!(error < 2f64.powi(-1020), "{error:e}");
        assert_eq!(Exact::new(-1.0).sqrt(), Exact::new(0.0));
        // f64's range is no limit here.
        let square = &Exact::new(f64::MIN_POSITIVE) * &Exact::new(f64::MIN_POSITIVE);
        assert_eq!(square.sqrt().to_f64(), f64::MIN_POSITIVE);
    }

    #[test]
    fn a_split_number_shows_differences_below_the_rounding_of_f64() {
        let third = &Exact::new(1.0) / &Exact::new(3.0);
        let split = third.split();
        let error = (&(&Exact::new(split.high) + &Exact::new(split.low)) - &third).to_f64();
        assert!(error.abs() < 2f64.powi(-107), "{error:e}");
        // 1/3 in f64 is a third of a unit of its last place too small: 2^-54 / 3.
        assert_eq!(split.error_of(1.0 / 3.0), -(2f64.powi(-54) / 3.0));
    }
}
