//! Numbers with a bound of what rounding does to them, in whatever order the operations are done.
//!
//! The twin of an operation, run on these in place of f32, gives its exact value (to the precision
//! of f64) and a bound E: a computation in f32 of the same operations, in any order, fused or not,
//! errs by at most E. With u = 2^-24:
//!
//! - a sum of n terms errs by at most the errors of its terms and (n - 1) u times the sum of their
//!   magnitudes, in any order and with any parentheses (Higham, *Accuracy and Stability of
//!   Numerical Algorithms*, section 4.2);
//! - a product errs by |x| ey + |y| ex + ex ey, and by u of itself; a quotient may be made by a
//!   reciprocal, which is two roundings; a root is one;
//! - a result below the normal numbers errs by half of the least denormal more.
//!
//! Terms of second order are covered by `MARGIN`. Where a comparison is undecided within the
//! bounds, both outcomes are right: [`outcomes`] takes them one after the other.

use std::cell::RefCell;
use std::cmp::Ordering;
use std::ops::{Add, Div, Mul, Sub};

use rayo::internals::reference::aos::Scalar;

/// Half of the distance from 1 to the next f32.
const U: f64 = 1.0 / (1 << 24) as f64;
/// The least denormal number of f32.
const LEAST: f64 = 1.401_298_464_324_817e-45;
/// The largest number of f32.
const MOST: f64 = f32::MAX as f64;
/// What covers terms of second order, and the rounding of the exact value to f64.
const MARGIN: f64 = 1.0 + 1e-5;

/// A number, and how far from it a computation in f32 may be.
#[derive(Clone, Copy, Debug)]
pub struct Bounded {
    /// The exact value.
    pub value: f64,
    /// The sum of the magnitudes of its terms: larger than the value where these cancel.
    pub magnitude: f64,
    /// The errors of its terms.
    of_terms: f64,
    /// How many terms it is the sum of.
    terms: f64,
}

impl Bounded {
    /// A bound of the error.
    pub fn error(self) -> f64 {
        // An infinity or a NaN is exact: only inputs make one here.
        if self.terms == 1.0 || self.of_terms.is_infinite() || !self.value.is_finite() {
            return self.of_terms;
        }
        let error = self.of_terms + (self.terms - 1.0) * U * self.magnitude * MARGIN;
        if self.value.is_finite() && self.magnitude + error >= MOST { f64::INFINITY } else { error }
    }

    /// A number that is given, or computed: what may exceed f32 may be anything.
    fn term(value: f64, error: f64) -> Self {
        let exceeds = error > 0.0 && value.is_finite() && value.abs() + error >= MOST;
        let error = if exceeds || error.is_nan() { f64::INFINITY } else { error * MARGIN };
        Bounded { value, magnitude: value.abs() + error, of_terms: error, terms: 1.0 }
    }

    /// Whether `got` is what a computation in f32 may give.
    pub fn allows(self, got: f32) -> bool {
        let error = self.error();
        if error.is_infinite() {
            return true;
        }
        let got = f64::from(got);
        if self.value.is_finite() {
            return (got - self.value).abs() <= error + self.value.abs() * U + LEAST;
        }
        got == self.value || got.is_nan() && self.value.is_nan()
    }
}

/// What rounding adds to the error of a product or a quotient: nothing where the result is exact.
fn rounding(value: f64, relative: f64) -> f64 {
    if value == 0.0 || !value.is_finite() { 0.0 } else { relative + LEAST }
}

impl From<f32> for Bounded {
    fn from(value: f32) -> Self {
        Bounded::term(value.into(), 0.0)
    }
}

impl Add for Bounded {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        // A term that is 0 is no term: nothing is rounded.
        if other.magnitude == 0.0 {
            return self;
        }
        if self.magnitude == 0.0 {
            return other;
        }
        Bounded {
            value: self.value + other.value,
            magnitude: self.magnitude + other.magnitude,
            of_terms: self.of_terms + other.of_terms,
            terms: self.terms + other.terms,
        }
    }
}

impl Sub for Bounded {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + Bounded { value: -other.value, ..other }
    }
}

impl Mul for Bounded {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let value = self.value * other.value;
        let [x, y] = [self, other].map(|factor| factor.error());
        // An infinite error is one whatever it is multiplied with: an infinity times 0 is NaN.
        let error = |x: f64, value: f64| if x == 0.0 || x.is_infinite() { x } else { x * value.abs() };
        let of_factors = error(y, self.value) + error(x, other.value) + error(x, y);
        Bounded::term(value, of_factors + rounding(value, U * (value.abs() + of_factors)))
    }
}

impl Div for Bounded {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        let [x, y] = [self, other].map(|operand| operand.error());
        let least = other.value.abs() - y;
        if y > 0.0 && least <= 0.0 {
            return Bounded::term(value, f64::INFINITY);
        }
        let is_exact = x + y == 0.0 || !value.is_finite() && x.is_finite();
        let of_operands = if is_exact { 0.0 } else { (x + value.abs() * y) / least };
        // By a reciprocal, which may be denormal or infinite itself.
        let reciprocal = 1.0 / other.value.abs();
        let is_odd = other.value != 0.0 && !(1e-37..3e38).contains(&reciprocal) && other.value.is_finite();
        let rounding = rounding(value, 2.0 * U * (value.abs() + of_operands));
        Bounded::term(value, if is_odd { f64::INFINITY } else { of_operands + rounding })
    }
}

/// By value, where the bounds decide; else by what [`outcomes`] tries.
impl PartialOrd for Bounded {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        let exact = self.value.partial_cmp(&other.value)?;
        let doubt = self.error() + other.error();
        if doubt == 0.0 || (self.value - other.value).abs() > doubt {
            return Some(exact);
        }
        Some(if decide() { Ordering::Greater } else { Ordering::Less })
    }
}

impl PartialEq for Bounded {
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl Scalar for Bounded {
    fn sqrt(self) -> Self {
        let error = self.error();
        let root = self.value.max(0.0).sqrt();
        if self.value + error < 0.0 || self.value - error < 0.0 && error > 0.0 && self.value != 0.0 && !decide() {
            return Bounded::term(f64::NAN, 0.0);
        }
        if error == 0.0 {
            let root = self.value.sqrt();
            return Bounded::term(root, if root == 0.0 || !root.is_finite() { 0.0 } else { root * U });
        }
        let least = (self.value - error).max(0.0).sqrt();
        let of_square = (error / (root + least)).min(error.sqrt());
        Bounded::term(root, if root + least == 0.0 { error.sqrt() } else { of_square + U * (root + of_square) })
    }

    fn abs(self) -> Self {
        Bounded { value: self.value.abs(), ..self }
    }
}

/// The most comparisons that are taken both ways.
const MOST_DOUBTS: usize = 5;

thread_local! {
    /// The outcomes of undecided comparisons: those to take, and how many have been asked for.
    static SCRIPT: RefCell<(Vec<bool>, usize)> = const { RefCell::new((Vec::new(), 0)) };
}

fn decide() -> bool {
    SCRIPT.with_borrow_mut(|(script, asked)| {
        *asked += 1;
        script.get(*asked - 1).copied().unwrap_or(true)
    })
}

/// The results of `compute` for each outcome of the comparisons that the bounds leave undecided: at
/// most 32 of them, and None if there would be more.
pub fn outcomes<R>(compute: impl Fn() -> R) -> Option<Vec<R>> {
    let mut results = Vec::new();
    let mut open = vec![Vec::new()];
    while let Some(script) = open.pop() {
        let taken = script.len();
        SCRIPT.set((script.clone(), 0));
        results.push(compute());
        // Nothing of it is to decide comparisons elsewhere.
        let (_, asked) = SCRIPT.take();
        if asked > MOST_DOUBTS {
            return None;
        }
        // Of each comparison after the script, which was taken as true, the other outcome is open.
        for place in taken..asked {
            let mut other = script.clone();
            other.resize(place, true);
            other.push(false);
            open.push(other);
        }
    }
    Some(results)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(values: &[f32]) -> Vec<Bounded> {
        values.iter().map(|value| Bounded::from(*value)).collect()
    }

    #[test]
    fn any_order_of_a_sum_is_within_the_bound() {
        let terms = [1.0e3_f32, -999.9, 0.1234567, 3.25];
        let exact = of(&terms).into_iter().reduce(|a, b| a + b).unwrap();
        let [a, b, c, d] = terms;
        for sum in [((a + b) + c) + d, (a + c) + (b + d), a + (b + (c + d)), ((d + c) + b) + a] {
            assert!(exact.allows(sum), "{sum}");
        }
        assert!(!exact.allows(a + b + d));
    }

    #[test]
    fn products_and_quotients_are_within_a_rounding_or_two() {
        let [x, y] = of(&[1.1, 3.7])[..] else { unreachable!() };
        assert!((x * y).allows(1.1_f32 * 3.7) && (x / y).allows(1.1_f32 / 3.7) && (x / y).allows(1.1 * (1.0 / 3.7)));
        assert!(!(x * y).allows(f32::from_bits((1.1_f32 * 3.7).to_bits() + 4)));
        assert!(x.sqrt().allows(1.1_f32.sqrt()) && !x.sqrt().allows(1.1_f32.sqrt() * 1.000_001));
    }

    #[test]
    fn infinities_and_nan_are_themselves() {
        let [inf, one, huge] = of(&[f32::INFINITY, 1.0, f32::MAX])[..] else { unreachable!() };
        assert!((inf + one).allows(f32::INFINITY) && !(inf + one).allows(f32::MAX));
        assert!((inf - inf).allows(f32::NAN) && !(inf - inf).allows(0.0));
        assert!((huge + huge).allows(f32::INFINITY) && (huge + huge).allows(0.0));
        let zero = Bounded::from(0.0);
        assert!((huge * zero + one).allows(1.0) && !(huge * zero + one).allows(0.0));
        assert!((huge * huge - huge * huge).allows(f32::NAN));
        assert!((inf * zero + one).allows(f32::NAN) && !(inf * zero + one).allows(0.0));
        assert!((one / zero).allows(f32::INFINITY) && !(one / zero).allows(f32::MAX));
    }

    #[test]
    fn doubtful_comparison_is_taken_both_ways() {
        let [x, y] = of(&[0.1, 0.3])[..] else { unreachable!() };
        let zero = Bounded::from(0.0);
        let doubtful = outcomes(|| (x + x + x - y > zero, y > x)).unwrap();
        assert_eq!(doubtful, [(true, true), (false, true)]);
        assert_eq!(outcomes(|| y > x).unwrap(), [true]);
    }
}
