//! Packets of numbers as plain arrays. Each operation acts on every lane, and compilers turn it
//! into vector instructions.

use std::ops::{Add, Div, Mul, Sub};

use super::super::records::Element;
use super::super::types::Plain;

/// A number in a lane. In a mask all of its bits are set, or none.
pub trait Number: Element + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> {
    /// All numbers of at least this magnitude are integers.
    const INTEGERS: Self;
    /// The square root; NaN below 0.
    fn sqrt(self) -> Self;
    /// `self * b + c`, rounded once.
    fn mul_add(self, b: Self, c: Self) -> Self;
    fn abs(self) -> Self;
    fn negated(self) -> Self;
    /// The magnitude of this number with the sign of another.
    fn with_sign_of(self, sign: Self) -> Self;
    /// A mask: all bits set, or none.
    fn mask(is_set: bool) -> Self;
    /// Whether any bit is set.
    fn is_set(self) -> bool;
    fn and(self, other: Self) -> Self;
    fn or(self, other: Self) -> Self;
    /// The number rounded to f32, and clamped to the largest f32; that also for a NaN.
    fn to_float(self) -> f32;
    /// The number rounded down and clamped to 0 to 255; 255 for a NaN.
    fn to_level(self) -> u32;
}

macro_rules! number {
    ($t:ident, $bits:ident, $integers:literal, |$wide:ident| $float:expr) => {
        impl Number for $t {
            const INTEGERS: Self = $integers;
            #[inline(always)]
            fn sqrt(self) -> Self {
                self.sqrt()
            }
            #[inline(always)]
            fn mul_add(self, b: Self, c: Self) -> Self {
                self.mul_add(b, c)
            }
            #[inline(always)]
            fn abs(self) -> Self {
                self.abs()
            }
            #[inline(always)]
            fn negated(self) -> Self {
                -self
            }
            #[inline(always)]
            fn with_sign_of(self, sign: Self) -> Self {
                self.copysign(sign)
            }
            #[inline(always)]
            fn mask(is_set: bool) -> Self {
                $t::from_bits(if is_set { $bits::MAX } else { 0 })
            }
            #[inline(always)]
            fn is_set(self) -> bool {
                self.to_bits() != 0
            }
            #[inline(always)]
            fn and(self, other: Self) -> Self {
                $t::from_bits(self.to_bits() & other.to_bits())
            }
            #[inline(always)]
            fn or(self, other: Self) -> Self {
                $t::from_bits(self.to_bits() | other.to_bits())
            }
            #[inline(always)]
            fn to_float(self) -> f32 {
                let $wide = self;
                $float
            }
            #[inline(always)]
            fn to_level(self) -> u32 {
                let level = if self < 255.0 { self } else { 255.0 };
                let level = if level > 0.0 { level } else { 0.0 };
                // SAFETY: the number is not a NaN, and from 0 to 255. A cast that checks this again
                // would take longer than everything else.
                unsafe { level.to_int_unchecked::<i32>() as u32 }
            }
        }
    };
}
number!(f32, u32, 8_388_608.0, |x| x);
number!(f64, u64, 4_503_599_627_370_496.0, |x| if x < f32::MAX.into() { x as f32 } else { f32::MAX });

/// A packet of numbers that are computed in lockstep.
pub trait Lanes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + 'static
{
    type Number: Number;
    /// The number of lanes.
    const COUNT: usize;
    /// Whether a product and its sum are rounded together, only once.
    const FUSED: bool;
    /// Makes a packet by a function of the lane's index.
    fn from_fn(number: impl FnMut(usize) -> Self::Number) -> Self;
    fn lane(&self, at: usize) -> Self::Number;

    /// The same number in all lanes.
    #[inline(always)]
    fn all(x: Self::Number) -> Self {
        Self::from_fn(|_| x)
    }
    /// A constant in all lanes.
    #[inline(always)]
    fn of(x: f64) -> Self {
        Self::all(Self::Number::from_f64(x))
    }
    /// 0, 1, 2, ...
    #[inline(always)]
    fn natural() -> Self {
        Self::from_fn(|i| Self::Number::from_f64(i as f64))
    }
    /// Loads the first numbers of a slice.
    #[inline(always)]
    fn load(from: &[Self::Number]) -> Self {
        let from = &from[..Self::COUNT];
        Self::from_fn(|i| from[i])
    }
    /// Loads the first numbers of a slice, which are the bits of f32.
    #[inline(always)]
    fn load_bits(from: &[u32]) -> Self {
        let from = &from[..Self::COUNT];
        Self::from_fn(|i| Self::Number::from_f64(f32::from_bits(from[i]).into()))
    }
    /// Stores the numbers, each rounded once, at the beginning of a slice.
    #[inline(always)]
    fn store<E: Element>(self, to: &mut [E]) {
        let to = &mut to[..Self::COUNT];
        for (i, to) in to.iter_mut().enumerate() {
            *to = E::from_f64(self.lane(i).to_f64());
        }
    }
    /// Applies a function to each number.
    #[inline(always)]
    fn map(self, f: impl Fn(Self::Number) -> Self::Number) -> Self {
        Self::from_fn(|i| f(self.lane(i)))
    }
    /// Applies a function to each number and the one in the same lane of `other`.
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(Self::Number, Self::Number) -> Self::Number) -> Self {
        Self::from_fn(|i| f(self.lane(i), other.lane(i)))
    }
    /// A mask of the lanes where `is` holds.
    #[inline(always)]
    fn mask(self, other: Self, is: impl Fn(&Self::Number, &Self::Number) -> bool) -> Self {
        self.zip(other, |a, b| Number::mask(is(&a, &b)))
    }
    /// self > other.
    #[inline(always)]
    fn greater(self, other: Self) -> Self {
        self.mask(other, PartialOrd::gt)
    }
    /// self >= other.
    #[inline(always)]
    fn not_less(self, other: Self) -> Self {
        self.mask(other, PartialOrd::ge)
    }
    /// self = other.
    #[inline(always)]
    fn equal(self, other: Self) -> Self {
        self.mask(other, PartialEq::eq)
    }
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        self.zip(other, Number::and)
    }
    /// Whether any bit is set in any lane.
    #[inline(always)]
    fn any(self) -> bool {
        let mut any = Self::Number::ZERO;
        for i in 0..Self::COUNT {
            any = any.or(self.lane(i));
        }
        any.is_set()
    }
    /// `a` in the lanes of this mask and `b` in the others.
    #[inline(always)]
    fn select(self, a: Self, b: Self) -> Self {
        Self::from_fn(|i| if self.lane(i).is_set() { a.lane(i) } else { b.lane(i) })
    }
    /// The minimum: self where self < other, else `other`.
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        self.zip(other, |a, b| if a < b { a } else { b })
    }
    /// The maximum: self where self > other, else `other`.
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        self.zip(other, |a, b| if a > b { a } else { b })
    }
    /// Square roots.
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(Number::sqrt)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.map(Number::abs)
    }
    #[inline(always)]
    fn negated(self) -> Self {
        self.map(Number::negated)
    }
    /// The magnitudes of these numbers with the signs of others.
    #[inline(always)]
    fn with_sign_of(self, sign: Self) -> Self {
        self.zip(sign, Number::with_sign_of)
    }
    /// The numbers rounded down to integers. The standard library's floor is a function call where
    /// SSE4.1 may be missing.
    #[inline(always)]
    fn floor(self) -> Self {
        let rounded = ((self.abs() + Self::all(Number::INTEGERS)) - Self::all(Number::INTEGERS)).with_sign_of(self);
        let down = rounded - rounded.greater(self).and(Self::of(1.0));
        Self::all(Number::INTEGERS).greater(self.abs()).select(down, self)
    }
    /// The numbers rounded up to integers.
    #[inline(always)]
    fn ceil(self) -> Self {
        self.negated().floor().negated()
    }
    /// self + a b.
    #[inline(always)]
    fn fma(self, a: Self, b: Self) -> Self {
        if Self::FUSED { Self::from_fn(|i| a.lane(i).mul_add(b.lane(i), self.lane(i))) } else { self + a * b }
    }
    /// self - a b.
    #[inline(always)]
    fn fnma(self, a: Self, b: Self) -> Self {
        if Self::FUSED { self.fma(a.negated(), b) } else { self - a * b }
    }
    /// self a - b.
    #[inline(always)]
    fn fms(self, a: Self, b: Self) -> Self {
        if Self::FUSED { b.negated().fma(self, a) } else { self * a - b }
    }
}

/// N numbers in an array.
#[derive(Clone, Copy, Debug)]
pub struct Packet<E, const N: usize, const FUSED: bool>([E; N]);

impl<E: Number, const N: usize, const FUSED: bool> Lanes for Packet<E, N, FUSED> {
    type Number = E;
    const COUNT: usize = N;
    const FUSED: bool = FUSED;
    #[inline(always)]
    fn from_fn(mut number: impl FnMut(usize) -> E) -> Self {
        let mut lanes = [E::ZERO; N];
        for (i, lane) in lanes.iter_mut().enumerate() {
            *lane = number(i);
        }
        Packet(lanes)
    }
    #[inline(always)]
    fn lane(&self, at: usize) -> E {
        self.0[at]
    }
}

macro_rules! operation {
    ($($name:ident: $method:ident;)*) => {$(
        impl<E: Number, const N: usize, const FUSED: bool> $name for Packet<E, N, FUSED> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.zip(other, E::$method)
            }
        }
    )*};
}
operation! { Add: add; Sub: sub; Mul: mul; Div: div; }

/// a . b, by the operations of DOT3.
#[inline(always)]
pub fn dot<L: Lanes>(a: [L; 3], b: [L; 3]) -> L {
    (a[0] * b[0]).fma(a[1], b[1]).fma(a[2], b[2])
}

/// a . b, with every product rounded by itself: DOT3_UNFUSED.
#[inline(always)]
pub fn dot_unfused<L: Lanes>(a: [L; 3], b: [L; 3]) -> L {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// a x b, with every product rounded by itself: CROSS3_UNFUSED.
#[inline(always)]
pub fn cross_unfused<L: Lanes>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [(1, 2), (2, 0), (0, 1)].each(|(i, j)| a[i] * b[j] - a[j] * b[i])
}

/// Applies a function to each component of two vectors.
#[inline(always)]
pub fn zip<L: Lanes>(a: [L; 3], b: [L; 3], f: impl Fn(L, L) -> L) -> [L; 3] {
    [f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2])]
}

/// An array's `map`, always inlined. In large functions the compiler does not inline the standard
/// library's.
pub trait Each<T, const K: usize> {
    /// Applies a function to each element.
    fn each<U: Copy>(self, f: impl FnMut(T) -> U) -> [U; K];
}

impl<T: Copy, const K: usize> Each<T, K> for [T; K] {
    #[inline(always)]
    fn each<U: Copy>(self, mut f: impl FnMut(T) -> U) -> [U; K] {
        let mut of = [f(self[0]); K];
        for i in 1..K {
            of[i] = f(self[i]);
        }
        of
    }
}
