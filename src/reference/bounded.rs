//! Numbers of about 100 bits that know how far they may be from the exact ones: the truth wherever they are sure of it.
//!
//! A number is the sum of two f64, and beside it stands a bound on all that its making has rounded. So a sign is known or
//! it is not, and who asks for one that is not goes to [`exact`](super::exact), which is a hundred times as slow.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::exact::{Exact, Meeting, Split, bound_of_sphere};

/// A share of a result that the rounding of one operation stays below: 64 u² of f64, several times what each is known to
/// lose (Joldes, Muller and Popescu, 2017).
const ROUNDING: f64 = 64.0 * (f64::EPSILON / 2.0) * (f64::EPSILON / 2.0);
/// What an operation may lose where its smallest parts are denormal numbers.
const TINY: f64 = f64::MIN_POSITIVE;
/// Bounds are computed in f64 too, and made larger by what that may lose.
const ROOM: f64 = 1.0 + 16.0 * f64::EPSILON;

/// A number, and a bound on its distance from the exact one. What is not finite has an infinite bound, or none: it is
/// never sure of anything.
#[derive(Clone, Copy, Debug)]
pub struct Bounded {
    value: Split,
    error: f64,
}

impl Bounded {
    /// `x` itself.
    pub const fn new(x: f64) -> Self {
        Bounded { value: Split { high: x, low: 0.0 }, error: 0.0 }
    }

    /// a + b as two parts, |a| >= |b|, after an operation on numbers with errors of `error` in all.
    fn of(a: f64, b: f64, error: f64) -> Self {
        let high = a + b;
        let low = b - (high - a);
        Bounded { value: Split { high, low }, error: ROOM * (error + ROUNDING * high.abs() + TINY) }
    }

    /// The number, without its bound.
    pub fn value(&self) -> Split {
        self.value
    }

    /// The nearest f64, without its bound.
    pub fn to_f64(self) -> f64 {
        self.value.high
    }

    /// How far it may be from the exact number.
    pub fn error(&self) -> f64 {
        self.error
    }

    /// -1, 0 or 1; None where the bound leaves it open.
    pub fn sign(&self) -> Option<i8> {
        match self.value.high {
            x if x > self.error => Some(1),
            x if x < -self.error => Some(-1),
            0.0 if self.error == 0.0 => Some(0),
            _ => None,
        }
    }

    /// The square root, of what is known to be greater than 0.
    pub fn sqrt(self) -> Self {
        let Split { high, low } = self.value;
        let root = high.sqrt();
        let rest = (-root).mul_add(root, high) + low;
        Bounded::of(root, rest / (2.0 * root), self.error / root)
    }

    /// Without its sign.
    pub fn abs(self) -> Self {
        if self.value.high < 0.0 { -self } else { self }
    }
}

impl From<&Exact> for Bounded {
    fn from(x: &Exact) -> Self {
        let Split { high, low } = Split::from(x);
        Bounded::of(high, low, 0.0)
    }
}

/// a + b and what that leaves out: Knuth's, for any a and b.
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let from_b = sum - a;
    (sum, (a - (sum - from_b)) + (b - from_b))
}

impl Add for Bounded {
    type Output = Bounded;
    fn add(self, other: Bounded) -> Bounded {
        let (a, b) = (self.value, other.value);
        let (high, rest) = two_sum(a.high, b.high);
        let (low, last) = two_sum(a.low, b.low);
        let rest = rest + low;
        let sum = high + rest;
        let rest = rest - (sum - high) + last;
        Bounded::of(sum, rest, self.error + other.error)
    }
}

impl Neg for Bounded {
    type Output = Bounded;
    fn neg(self) -> Bounded {
        let Split { high, low } = self.value;
        Bounded { value: Split { high: -high, low: -low }, ..self }
    }
}

impl Sub for Bounded {
    type Output = Bounded;
    fn sub(self, other: Bounded) -> Bounded {
        self + -other
    }
}

impl Mul for Bounded {
    type Output = Bounded;
    fn mul(self, other: Bounded) -> Bounded {
        let (a, b) = (self.value, other.value);
        let product = a.high * b.high;
        let rest = a.high.mul_add(b.high, -product) + (a.high * b.low + a.low * b.high);
        // The parts below are half a unit of those above.
        let error = (1.0 + f64::EPSILON) * (a.high.abs() * other.error + b.high.abs() * self.error);
        Bounded::of(product, rest, error + self.error * other.error)
    }
}

impl Div for Bounded {
    type Output = Bounded;
    /// Of a divisor that is not known to differ from 0, the bound is infinite.
    fn div(self, other: Bounded) -> Bounded {
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

/// A vector.
#[derive(Clone, Copy, Debug)]
pub struct Vector(pub [Bounded; 3]);

impl Vector {
    /// `v` itself.
    pub fn new(v: [f64; 3]) -> Self {
        Vector(v.map(Bounded::new))
    }

    /// self - b.
    pub fn sub(&self, b: &Vector) -> Vector {
        Vector(std::array::from_fn(|i| self.0[i] - b.0[i]))
    }

    /// s self.
    pub fn scale(&self, s: Bounded) -> Vector {
        Vector(self.0.map(|x| x * s))
    }

    /// self . b.
    pub fn dot(&self, b: &Vector) -> Bounded {
        let [x, y, z] = std::array::from_fn(|i| self.0[i] * b.0[i]);
        x + y + z
    }

    /// self x b.
    pub fn cross(&self, b: &Vector) -> Vector {
        Vector(std::array::from_fn(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            self.0[j] * b.0[k] - self.0[k] * b.0[j]
        }))
    }

    /// self / |self|, of a vector that is known not to be 0.
    pub fn normalize(&self) -> Vector {
        self.scale(Bounded::new(1.0) / self.dot(self).sqrt())
    }
}

/// A ray from the origin.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Its direction.
    pub d: Vector,
    /// d . d.
    a: Bounded,
    reach: [f64; 3],
}

impl Ray {
    /// The ray along `d`, one of many whose components are at most `reach`.
    pub fn within(d: Vector, reach: [f64; 3]) -> Self {
        Ray { d, a: d.dot(&d), reach }
    }

    /// As [`exact::Ray::longest_over_this`](super::exact::Ray::longest_over_this).
    pub fn longest_over_this(&self) -> f64 {
        let longest = self.reach.iter().map(|d| d * d).sum::<f64>().sqrt();
        longest / self.a.to_f64().sqrt()
    }
}

/// A margin is told where it is known to this share of itself, or to be below this: there is none that small to ask about.
const MARGIN: f64 = 1e-18;

/// x / size, x > 0: a margin, if it is known.
fn margin(x: Bounded, size: f64) -> Option<f64> {
    let share = x.to_f64() / size;
    (x.error <= 1e-9 * x.to_f64() || share < MARGIN).then_some(share)
}

/// A sphere that the camera is inside or outside of.
#[derive(Clone, Debug)]
pub struct Sphere {
    centre: Vector,
    inverse_radius: Bounded,
    squared_radius: Bounded,
    k: Bounded,
    inside: bool,
    kappa: f64,
}

impl Sphere {
    /// None where it is not known on which side of it the camera is.
    pub fn new(centre: [f64; 3], radius: f64) -> Option<Self> {
        let (centre, radius) = (Vector::new(centre), Bounded::new(radius));
        let (squared, squared_radius) = (centre.dot(&centre), radius * radius);
        let k = squared - squared_radius;
        let inside = k.sign()? < 0;
        let inverse_radius = Bounded::new(1.0) / radius;
        let kappa = (squared / squared_radius).to_f64().sqrt();
        Some(Sphere { centre, inverse_radius, squared_radius, k, inside, kappa })
    }

    /// As [`exact::Sphere::meet`](super::exact::Sphere::meet); None where it is not known. The discriminant is that of
    /// spheres far away, which loses the least.
    pub fn meet(&self, ray: &Ray) -> Option<Meeting<Bounded>> {
        let h = ray.d.dot(&self.centre);
        if !self.inside && h.sign()? < 0 {
            return Some(Meeting::NEVER);
        }
        let across = self.centre.cross(&ray.d);
        let whole = ray.a * self.squared_radius;
        let disc = whole - across.dot(&across);
        let missed = disc.sign()? < 0;
        let size = whole.to_f64();
        let s = margin(disc.abs(), size)?;
        let slant = 1.0 / s.sqrt();
        let along = h.to_f64().abs() / size.sqrt();
        let alone = 5.0 + 6.0 / (s.sqrt() * (s.sqrt() + along));
        let bound = bound_of_sphere(self.kappa, (self.k / self.squared_radius).to_f64(), slant);
        if missed {
            return Some(Meeting { hit: None, miss: Some(h / ray.a), margin: s, bound, alone, slant });
        }
        let root = disc.sqrt();
        let (hit, margin) = match (self.inside, h.sign()) {
            (true, Some(-1)) => (-self.k / (root - h), f64::INFINITY),
            (true, _) => ((h + root) / ray.a, f64::INFINITY),
            (false, _) => (self.k / (h + root), s),
        };
        Some(Meeting { hit: Some(hit), miss: None, margin, bound, alone, slant })
    }

    /// The unit normal at t d, outward.
    pub fn normal(&self, ray: &Ray, t: Bounded) -> Vector {
        ray.d.scale(t).sub(&self.centre).scale(self.inverse_radius)
    }
}

/// A triangle that some ray can hit.
#[derive(Clone, Debug)]
pub struct Triangle {
    edges: [Vector; 3],
    plane: Vector,
    length: f64,
    volume: Bounded,
    normal: Vector,
}

impl Triangle {
    /// None where it is not known to be one.
    pub fn new(vertices: [[f64; 3]; 3]) -> Option<Self> {
        let [v1, v2, v3] = &vertices.map(Vector::new);
        let plane = v1.sub(v2).cross(&v1.sub(v3));
        let volume = v1.dot(&plane);
        let sign = volume.sign().filter(|sign| *sign != 0).map(|sign| Bounded::new(sign.into()))?;
        let edges = [(v1, v2), (v2, v3), (v3, v1)].map(|(v, w)| v.cross(w).scale(sign));
        let length = plane.dot(&plane).to_f64().sqrt();
        let normal = plane.normalize();
        Some(Triangle { edges, plane: plane.scale(sign), length, volume: volume.abs(), normal })
    }

    /// As [`exact::Triangle::meet`](super::exact::Triangle::meet); None where it is not known.
    pub fn meet(&self, ray: &Ray) -> Option<Meeting<Bounded>> {
        let (mut inside, mut outside, mut unknown) = (f64::INFINITY, f64::NEG_INFINITY, false);
        for edge in &self.edges {
            let side = ray.d.dot(edge);
            let size: f64 = edge.0.iter().zip(ray.reach).map(|(n, d)| n.to_f64().abs() * d).sum();
            match side.sign() {
                Some(-1) => outside = outside.max(margin(-side, size)?),
                Some(1) => inside = inside.min(margin(side, size)?),
                _ => unknown = true,
            }
        }
        let missed = outside >= 0.0;
        let across = ray.d.dot(&self.plane);
        let ahead = across.sign()? > 0;
        if unknown && !missed {
            return None;
        }
        let cosine = across.to_f64() / self.length / ray.a.to_f64().sqrt();
        let slant = if ahead { 1.0 / cosine } else { f64::INFINITY };
        let bound = 3.0 + 4.0 * slant;
        let t = ahead.then(|| self.volume / across);
        Some(match (missed, t) {
            (false, Some(t)) => Meeting { hit: Some(t), miss: None, margin: inside, bound, alone: bound, slant },
            (missed, t) => {
                // Behind all edges and not ahead, only rounding could make it a hit.
                Meeting { hit: None, miss: t, margin: if missed { outside } else { 0.0 }, bound, alone: bound, slant }
            }
        })
    }

    /// n / |n| of eq. 6.
    pub fn normal(&self) -> &Vector {
        &self.normal
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How far the number is from `exact`, as a share of its bound.
    fn share(x: Bounded, exact: &Exact) -> f64 {
        let Split { high, low } = x.value;
        let found = &Exact::new(high) + &Exact::new(low);
        (&found - exact).abs().to_f64() / x.error
    }

    #[test]
    fn every_operation_is_within_its_bound_however_much_cancels_and_however_large_the_numbers_are() {
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
            let w = x / Bounded::new(3.0);
            let pairs = [
                (w, third.clone()),
                (x + y, &a + &b),
                (w * y - z, &(&third * &b) - &c),
                ((w + y) - y, third.clone()),
                (w * w, &third * &third),
                ((w * w).sqrt(), third.abs()),
                ((w + y) / z, &(&third + &b) / &c),
                (y / (w + z), &b / &(&third + &c)),
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
        assert_eq!((one.sign(), (-one).sign(), Bounded::new(0.0).sign()), (Some(1), Some(-1), Some(0)));
        // 3 (1/3) - 1 is 0 but for what 1/3 has lost.
        assert_eq!((three * (one / three) - one).sign(), None);
        assert_eq!((one / (three * (one / three) - one)).sign(), None);
        for x in [f64::NAN, f64::INFINITY] {
            assert_eq!((Bounded::new(x) - Bounded::new(x)).sign(), None, "{x}");
        }
    }
}
