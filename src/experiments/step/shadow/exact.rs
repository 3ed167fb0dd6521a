//! Operations without rounding, and errors in units of the last place.

use crate::experiments::step::model::{Float, Number, Rounding};
use crate::reference::exact::Exact;
use crate::reference::number::Number as _;

/// A number as it is; None where it is not finite.
pub fn of_bits(format: Number, bits: u64) -> Option<Exact> {
    let value = format.value(bits);
    value.is_finite().then(|| Exact::new(value))
}

/// An integer, of which f64 may not hold all 64 bits at once.
pub fn of_integer(format: Number, bits: u64) -> Exact {
    match format {
        Number::Int64 => {
            let (high, low) = ((bits as i64 >> 32) as f64, (bits & 0xffff_ffff) as f64);
            &Exact::new(high * 4_294_967_296.0) + &Exact::new(low)
        }
        _ => Exact::new(format.value(bits)),
    }
}

/// An operation without rounding; None where there is no finite result. Those that choose or make whole numbers are none.
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

/// Whether the whole number `found` is that of the exact value: without a rounding the one towards 0.
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

/// A number less its exact value, in units of the last place of the larger of the two.
pub fn difference(format: Number, found: f64, exact: &Exact) -> f64 {
    in_units(format, found, exact, exact)
}

/// A number less another value, in the units in which [`difference`] has its own.
pub fn in_units(format: Number, found: f64, exact: &Exact, other: &Exact) -> f64 {
    let error = &Exact::new(found) - other;
    (&error / &Exact::new(unit(format, found.abs().max(exact.to_f64().abs())))).to_f64()
}

/// The last place of numbers as large as `x`, which is not negative, in f64: it has that of all f32 and of its own.
fn unit(format: Number, x: f64) -> f64 {
    let x = x.min(f64::MAX.next_down());
    let place = x.next_up() - x;
    match format {
        // 29 digits fewer, and never below the least f32.
        Number::Single => (place * 2_f64.powi(29)).max(f32::from_bits(1).into()),
        _ => place,
    }
}

/// x = m 2^e with 1 <= |m| < 2; of 0 the exponent is the least of all.
fn split(x: f64) -> (f64, i32) {
    if x == 0.0 {
        return (0.0, -1075);
    }
    let (scaled, moved) = if x.is_subnormal() { (x * 18_014_398_509_481_984.0, 54) } else { (x, 0) };
    let bits = scaled.to_bits();
    let exponent = (bits >> 52 & 0x7ff) as i32 - 1023;
    (f64::from_bits(bits & !(0x7ff << 52) | 0x3ff << 52), exponent - moved)
}

/// Of a sum: the exponent of the larger of what is added, the product or the addend of a multiply-add among them, above that
/// of the result; all digits of the format where 0 is left of what is not. None for what is no sum.
pub fn binary_digits_lost(format: Number, float: Float, from: &[f64], found: f64) -> Option<u32> {
    let digits = if format == Number::Single { 24 } else { 53 };
    let larger = match float {
        Float::Add | Float::Sub => split(from[0]).1.max(split(from[1]).1),
        Float::Fma { .. } => {
            let ((m, e), (n, f)) = (split(from[0]), split(from[1]));
            let product = if m * n == 0.0 { split(0.0).1 } else { e + f + i32::from((m * n).abs() >= 2.0) };
            product.max(split(from[2]).1)
        }
        _ => return None,
    };
    if found == 0.0 {
        return Some(if larger > split(0.0).1 { digits } else { 0 });
    }
    Some((larger - split(found).1).clamp(0, digits as i32) as u32)
}
