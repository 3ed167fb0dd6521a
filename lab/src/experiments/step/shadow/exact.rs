//! Operations without rounding, and errors in units of the last place.

use crate::exact::digits::Exact;
use crate::exact::number::Number as _;
use crate::experiments::step::model::{Float, Number, Rounding};

/// The exact value of a number; None if it is not finite.
pub fn of_bits(format: Number, bits: u64) -> Option<Exact> {
    let value = format.value(bits);
    value.is_finite().then(|| Exact::new(value))
}

/// The exact value of an integer, as the sum of two parts, since an f64 cannot hold 64 bits.
pub fn of_integer(format: Number, bits: u64) -> Exact {
    match format {
        Number::Int64 => {
            let (high, low) = ((bits as i64 >> 32) as f64, (bits & 0xffff_ffff) as f64);
            &Exact::new(high * 4_294_967_296.0) + &Exact::new(low)
        }
        _ => Exact::new(format.value(bits)),
    }
}

/// The result of an operation without rounding. None if it is not finite, and for operations that
/// select or that round to whole numbers.
pub fn float(float: Float, from: &[Exact]) -> Option<Exact> {
    let zero = Exact::new(0.0);
    let turned = |x: Exact, turned: bool| if turned { -&x } else { x };
    Some(match float {
        Float::Add => &from[0] + &from[1],
        Float::Sub => &from[0] - &from[1],
        Float::Mul => &from[0] * &from[1],
        Float::Div if from[1] == zero => return None,
        Float::Div => &from[0] / &from[1],
        Float::Sqrt if from[0].is_negative() => return None,
        Float::Sqrt => from[0].sqrt(),
        Float::Fma { product, addend } => &turned(&from[0] * &from[1], product) + &turned(from[2].clone(), addend),
        Float::ReciprocalRoot(_) if !from[0].is_positive() => return None,
        Float::ReciprocalRoot(_) => &Exact::new(1.0) / &from[0].sqrt(),
        Float::Min | Float::Max | Float::Round(_) => return None,
    })
}

/// Whether `found` is the exact value rounded to a whole number. Without a `rounding`, it is
/// rounded towards 0.
pub fn is_whole(exact: &Exact, found: f64, rounding: Option<Rounding>) -> bool {
    let above = exact - &Exact::new(found);
    let (zero, one) = (Exact::new(0.0), Exact::new(1.0));
    let of_below = zero <= above && above < one;
    let of_above = -&one < above && above <= zero;
    match rounding {
        Some(Rounding::Down) => of_below,
        Some(Rounding::Up) => of_above,
        None if found > 0.0 => of_below,
        None if found < 0.0 => of_above,
        None => of_below || of_above,
    }
}

/// A number minus its exact value, in units of the last place of the larger of the two.
pub fn difference(format: Number, found: f64, exact: &Exact) -> f64 {
    in_units(format, found, exact, exact)
}

/// A number minus another value, in the units that [`difference`] uses for the number and its exact
/// value.
pub fn in_units(format: Number, found: f64, exact: &Exact, other: &Exact) -> f64 {
    let error = &Exact::new(found) - other;
    (&error / &Exact::new(unit(format, found.abs().max(exact.to_f64().abs())))).to_f64()
}

/// The unit in the last place, as an f64, of numbers of a format with the magnitude `x`.
fn unit(format: Number, x: f64) -> f64 {
    let x = x.min(f64::MAX.next_down());
    let place = x.next_up() - x;
    match format {
        // f32 has 29 bits fewer than f64, and its unit is never below the least f32.
        Number::Single => (place * 2_f64.powi(29)).max(f32::from_bits(1).into()),
        _ => place,
    }
}

/// A number m 2^e with 1 <= |m| < 2; 0 has an exponent that is less than any other.
struct BinaryParts {
    significand: f64,
    exponent: i32,
}

fn split(x: f64) -> BinaryParts {
    if x == 0.0 {
        return BinaryParts { significand: 0.0, exponent: -1075 };
    }
    let (scaled, moved) = if x.is_subnormal() { (x * 18_014_398_509_481_984.0, 54) } else { (x, 0) };
    let bits = scaled.to_bits();
    let exponent = (bits >> 52 & 0x7ff) as i32 - 1023;
    let significand = f64::from_bits(bits & !(0x7ff << 52) | 0x3ff << 52);
    BinaryParts { significand, exponent: exponent - moved }
}

/// How many leading bits a sum lost: the exponent of its larger summand (for a multiply-add the
/// product or the addend) minus that of the result; all bits of the format if the result is 0 and
/// the summands are not. None for operations that are not sums.
pub fn binary_digits_lost(format: Number, float: Float, from: &[f64], found: f64) -> Option<u32> {
    let digits = if format == Number::Single { 24 } else { 53 };
    let larger = match float {
        Float::Add | Float::Sub => split(from[0]).exponent.max(split(from[1]).exponent),
        Float::Fma { .. } => {
            let (a, b) = (split(from[0]), split(from[1]));
            let product = a.significand * b.significand;
            let exponent = if product == 0.0 {
                split(0.0).exponent
            } else {
                a.exponent + b.exponent + i32::from(product.abs() >= 2.0)
            };
            exponent.max(split(from[2]).exponent)
        }
        _ => return None,
    };
    if found == 0.0 {
        return Some(if larger > split(0.0).exponent { digits } else { 0 });
    }
    Some((larger - split(found).exponent).clamp(0, digits as i32) as u32)
}
