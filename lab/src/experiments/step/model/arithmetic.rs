//! Floating-point arithmetic exactly as on x86, with its NaN and signed zeros.

use std::cmp::Ordering;

use super::Float;

/// The format of the number in an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Number {
    Single,
    Double,
    Int32,
    Int64,
}

impl Number {
    pub fn bytes(self) -> u32 {
        match self {
            Number::Single | Number::Int32 => 4,
            Number::Double | Number::Int64 => 8,
        }
    }

    /// The mask of the format's sign bit.
    pub fn sign(self) -> u64 {
        1 << (8 * self.bytes() - 1)
    }

    /// The number that these bits represent. It is exact, except that large i64 are rounded to f64.
    pub fn value(self, bits: u64) -> f64 {
        match self {
            Number::Single => f32::from_bits(bits as u32).into(),
            Number::Double => f64::from_bits(bits),
            Number::Int32 => f64::from(bits as i32),
            Number::Int64 => bits as i64 as f64,
        }
    }
}

/// How a number is rounded to a whole number, as encoded in the low bits of the immediate operand
/// of `roundpd` and `vrndscalepd`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Rounding {
    Down,
    Up,
}

/// The accuracy of an estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Estimate {
    /// `rsqrtps`: relative error up to 1.5 2^-12; denormal operands count as 0.
    Coarse,
    /// `vrsqrt14ps`, `vrsqrt14pd`: relative error up to 2^-14.
    Fine,
}

impl Estimate {
    /// The documented bound of the relative error.
    pub fn bound(self) -> f64 {
        match self {
            Estimate::Coarse => 1.5 / 4096.0,
            Estimate::Fine => 1.0 / 16384.0,
        }
    }
}

/// The result of a floating-point computation on `from`. An estimate has no unique result: `found`,
/// the CPU's own, is returned if it keeps the documented bound.
///
/// If operands are NaN, the result is the first NaN, made quiet. An invalid operation without a NaN
/// operand gives the default NaN. (Rust's own operations do not promise that.) A minimum or maximum
/// of two zeros, or with a NaN, is its second operand, unchanged.
pub(crate) fn float(format: Number, float: Float, from: &[u64], found: impl Fn() -> u64) -> u64 {
    match format {
        Number::Single => single(float, from, found),
        _ => double(float, from, found),
    }
}

macro_rules! formats {
    ($($name:ident $float:ident $bits:ident $quiet:literal $default:literal;)*) => { $(
        fn $name(float: Float, from: &[u64], found: impl Fn() -> u64) -> u64 {
            let of = |index: usize| $float::from_bits(from[index] as $bits);
            let signed = |x: $float, turned: bool| if turned { -x } else { x };
            match float {
                Float::Min => return if of(0) < of(1) { from[0] } else { from[1] },
                Float::Max => return if of(0) > of(1) { from[0] } else { from[1] },
                _ => {}
            }
            if let Some(nan) = (0..from.len()).find(|&index| of(index).is_nan()) {
                return from[nan] | $quiet;
            }
            let result = match float {
                Float::Add => of(0) + of(1),
                Float::Sub => of(0) - of(1),
                Float::Mul => of(0) * of(1),
                Float::Div => of(0) / of(1),
                Float::Sqrt => of(0).sqrt(),
                Float::Fma { product, addend } => signed(of(0), product).mul_add(of(1), signed(of(2), addend)),
                Float::Round(Rounding::Down) => of(0).floor(),
                Float::Round(Rounding::Up) => of(0).ceil(),
                Float::ReciprocalRoot(Estimate::Coarse) if of(0).is_subnormal() => {
                    (0.0 as $float).copysign(of(0)).recip()
                }
                Float::ReciprocalRoot(estimate) => {
                    let root = of(0).sqrt();
                    let found = $float::from_bits(found() as $bits);
                    // Computed in f64, whose own rounding error is negligible beside the bound.
                    // False if a number is not finite.
                    if (f64::from(found) * f64::from(of(0)).sqrt() - 1.0).abs() <= estimate.bound() {
                        found
                    } else {
                        root.recip()
                    }
                }
                Float::Min | Float::Max => unreachable!("above"),
            };
            if result.is_nan() { $default } else { result.to_bits().into() }
        }
    )* };
}
formats! {
    single f32 u32 0x0040_0000 0xffc0_0000;
    double f64 u64 0x0008_0000_0000_0000 0xfff8_0000_0000_0000;
}

/// Converts a number to another format.
pub(crate) fn convert(of: Number, to: Number, bits: u64) -> u64 {
    const QUIET: u64 = 0x0008_0000_0000_0000;
    let value = of.value(bits);
    match (of, to) {
        // A NaN keeps its sign and the bits of its payload that fit, and becomes quiet.
        (Number::Single, Number::Double) if value.is_nan() => {
            (bits & 0x8000_0000) << 32 | 0x7ff0_0000_0000_0000 | QUIET | (bits & 0x007f_ffff) << 29
        }
        (Number::Double, Number::Single) if value.is_nan() => {
            bits >> 32 & 0x8000_0000 | 0x7fc0_0000 | bits >> 29 & 0x007f_ffff
        }
        (Number::Int64, Number::Single) => (bits as i64 as f32).to_bits().into(),
        (_, Number::Single) => (value as f32).to_bits().into(),
        (_, Number::Double) => value.to_bits(),
        // A number that the integer format cannot hold becomes the least integer of that format.
        (_, Number::Int32) => {
            let fits = (-2_147_483_648.0..2_147_483_648.0).contains(&value.trunc());
            (if fits { value as i32 } else { i32::MIN }) as u32 as u64
        }
        (_, Number::Int64) => {
            let fits = (-9_223_372_036_854_775_808.0..9_223_372_036_854_775_808.0).contains(&value);
            (if fits { value as i64 } else { i64::MIN }) as u64
        }
    }
}

/// Whether a predicate holds for two numbers in this order, which is None if one is NaN.
pub(crate) fn holds(predicate: u8, order: Option<Ordering>) -> bool {
    // The bits of an entry say, from the highest, whether the predicate holds if the numbers are
    // unordered, greater, less or equal. Predicates from 16 on repeat these entries, with other
    // exceptions.
    const TABLE: [u8; 16] = [
        0b0001, 0b0010, 0b0011, 0b1000, 0b1110, 0b1101, 0b1100, 0b0111, // eq lt le unord neq nlt nle ord
        0b1001, 0b1010, 0b1011, 0b0000, 0b0110, 0b0101, 0b0100, 0b1111, // eq_u nge ngt false neq_o ge gt true
    ];
    let bit = match order {
        Some(Ordering::Equal) => 0,
        Some(Ordering::Less) => 1,
        Some(Ordering::Greater) => 2,
        None => 3,
    };
    TABLE[usize::from(predicate & 15)] >> bit & 1 == 1
}

/// All ones if the predicate holds, else 0.
pub(super) fn compare(format: Number, predicate: u8, from: [u64; 2]) -> u64 {
    let [a, b] = from.map(|bits| format.value(bits));
    if holds(predicate, a.partial_cmp(&b)) { u64::MAX } else { 0 }
}
