//! Numbers of about 100 bits with a bound on their own error: they give the truth wherever the
//! bound decides.
//!
//! A number is the sum of two f64, with a bound on all rounding errors so far. Its sign is
//! therefore known or unknown. A caller that needs an unknown sign turns to
//! [`digits`](super::digits), which is a hundred times as slow.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::digits::Exact;
use super::number::{Number, Split};

/// A bound on the relative rounding error of one operation: 64 u^2 with the u of f64, several times
/// the bounds of Joldes, Muller and Popescu (2017).
const ROUNDING: f64 = 64.0 * (f64::EPSILON / 2.0) * (f64::EPSILON / 2.0);
/// What an operation may lose if its smallest parts are subnormal.
const TINY: f64 = f64::MIN_POSITIVE;
/// Bounds are computed in f64 too, and enlarged by this factor for their own rounding.
const ROOM: f64 = 1.0 + 16.0 * f64::EPSILON;

/// A number, and a bound on its distance from the exact number. A number that is not finite has an
/// infinite bound, or NaN for one, and so never decides.
#[derive(Clone, Copy, Debug)]
pub struct Bounded {
    value: Split,
    error: f64,
}

impl Bounded {
    /// The sum of a and b, |a| >= |b|, after an operation whose operands contribute `error` to its
    /// error.
    fn of(a: f64, b: f64, error: f64) -> Self {
        let high = a + b;
        let low = b - (high - a);
        Bounded { value: Split { high, low }, error: ROOM * (error + ROUNDING * high.abs() + TINY) }
    }
}

impl Number for Bounded {
    fn new(x: f64) -> Self {
        Bounded { value: Split { high: x, low: 0.0 }, error: 0.0 }
    }

    fn to_f64(&self) -> f64 {
        self.value.high
    }

    fn split(&self) -> Split {
        self.value
    }

    fn sign(&self) -> Option<i8> {
        match self.value.high {
            x if x > self.error => Some(1),
            x if x < -self.error => Some(-1),
            0.0 if self.error == 0.0 => Some(0),
            _ => None,
        }
    }

    /// The bound is infinite for a number that may not be greater than 0.
    fn sqrt(&self) -> Self {
        let Split { high, low } = self.value;
        let root = high.sqrt();
        let rest = (-root).mul_add(root, high) + low;
        Bounded::of(root, rest / (2.0 * root), self.error / root)
    }

    fn abs(&self) -> Self {
        if self.value.high < 0.0 { -self } else { *self }
    }

    fn is_within(&self, error: f64) -> bool {
        self.error <= error
    }
}

impl From<&Exact> for Bounded {
    fn from(x: &Exact) -> Self {
        let Split { high, low } = x.split();
        Bounded::of(high, low, 0.0)
    }
}

/// a + b and its rounding error, by Knuth's algorithm for a and b in any order of magnitude.
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let from_b = sum - a;
    (sum, (a - (sum - from_b)) + (b - from_b))
}

impl Add for &Bounded {
    type Output = Bounded;
    fn add(self, other: &Bounded) -> Bounded {
        let (a, b) = (self.value, other.value);
        let (high, rest) = two_sum(a.high, b.high);
        let (low, last) = two_sum(a.low, b.low);
        let rest = rest + low;
        let sum = high + rest;
        let rest = rest - (sum - high) + last;
        Bounded::of(sum, rest, self.error + other.error)
    }
}

impl Neg for &Bounded {
    type Output = Bounded;
    fn neg(self) -> Bounded {
        let Split { high, low } = self.value;
        Bounded { value: Split { high: -high, low: -low }, ..*self }
    }
}

impl Sub for &Bounded {
    type Output = Bounded;
    fn sub(self, other: &Bounded) -> Bounded {
        self + &-other
    }
}

impl Mul for &Bounded {
    type Output = Bounded;
    fn mul(self, other: &Bounded) -> Bounded {
        let (a, b) = (self.value, other.value);
        let product = a.high * b.high;
        let rest = a.high.mul_add(b.high, -product) + (a.high * b.low + a.low * b.high);
        // The low parts are at most half a unit in the last place of the high ones.
        let error = (1.0 + f64::EPSILON) * (a.high.abs() * other.error + b.high.abs() * self.error);
        Bounded::of(product, rest, error + self.error * other.error)
    }
}

impl Div for &Bounded {
    type Output = Bounded;
    /// The bound is infinite for a divisor that may be 0.
    fn div(self, other: &Bounded) -> Bounded {
        let (a, b) = (self.value, other.value);
        let quotient = a.high / b.high;
        let rest = (-quotient).mul_add(b.high, a.high) + (a.low - quotient * b.low);
        let next = rest / b.high;
        let least = b.high.abs() * (1.0 - f64::EPSILON) - other.error;
        let error = (self.error + quotient.abs() * (1.0 + f64::EPSILON) * other.error) / least;
        let error = if least > 0.0 { error } else { f64::INFINITY };
        Bounded::of(quotient, next, error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The distance of the number from `exact`, as a share of its bound.
    fn share(x: Bounded, exact: &Exact) -> f64 {
        let Split { high, low } = x.value;
        let found = &Exact::new(high) + &Exact::new(low);
        (&found - exact).abs().to_f64() / x.error
    }

    #[test]
    fn operations_are_within_bounds_on_any_numbers() {
        let mut state = 3_u64;
        let mut number = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let size = 2f64.powi((state >> 33) as i32 % 240 - 120);
            Exact::new(size * ((state >> 11) as f64 / 2f64.powi(52) - 1.0))
        };
        let (mut checked, mut largest) = (0, 0.0_f64);
        for _ in 0..2000 {
            // Numbers with errors of their own, and sums that cancel.
            let [a, b, c] = [number(), number(), number()];
            let third = &a / &Exact::new(3.0);
            let [x, y, z] = [&a, &b, &c].map(Bounded::from);
            let w = &x / &Bounded::new(3.0);
            let pairs = [
                (w, third.clone()),
                (&x + &y, &a + &b),
                (&(&w * &y) - &z, &(&third * &b) - &c),
                (&(&w + &y) - &y, third.clone()),
                (&w * &w, &third * &third),
                ((&w * &w).sqrt(), third.abs()),
                (&(&w + &y) / &z, &(&third + &b) / &c),
                (&y / &(&w + &z), &b / &(&third + &c)),
            ];
            for (found, exact) in pairs {
                if found.error.is_finite() && found.sign().is_some() {
                    largest = largest.max(share(found, &exact));
                    checked += 1;
                }
            }
        }
        assert!(checked > 10_000 && largest <= 1.0, "{checked} checked, {largest} of the bound");
        assert!(largest > 1e-3, "the bound is {} times what is lost", 1.0 / largest);
    }

    #[test]
    fn a_sign_is_known_or_it_is_not() {
        let [one, three] = [1.0, 3.0].map(Bounded::new);
        assert_eq!((one.sign(), (-&one).sign(), Bounded::new(0.0).sign()), (Some(1), Some(-1), Some(0)));
        // 3 (1/3) - 1 is 0 except for the rounding error of 1/3.
        let nothing = &(&three * &(&one / &three)) - &one;
        assert_eq!((nothing.sign(), (&one / &nothing).sign()), (None, None));
        for x in [f64::NAN, f64::INFINITY] {
            assert_eq!((&Bounded::new(x) - &Bounded::new(x)).sign(), None, "{x}");
        }
    }
}
