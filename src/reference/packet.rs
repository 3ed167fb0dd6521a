//! The twin of the operations on packets: one lane of them.
//!
//! These are the operations of `asm/include/{vec3,sphere,triangle,lambert}.inc`, in the same order. The names are those of
//! `asm/include/layout.inc`, which says what each number is.

use super::Real;

/// How a product that is added to something is rounded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rounding {
    /// Once, together with the sum: `HAS_FMA` in assembly.
    Fused,
    /// Separately, before the sum.
    Unfused,
}

/// A sphere, for rays of any direction.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "layout.inc says what each field of SphereHit is")]
pub struct SphereHit<T> {
    pub centre: [T; 3],
    pub square: T,
    pub k: T,
}

/// A triangle, for rays of any direction.
#[derive(Clone, Copy, Debug)]
pub struct TriangleHit<T> {
    /// n.
    pub normal: [T; 3],
    /// v1 . n.
    pub k: T,
    /// The normal of the plane through the origin and each edge, and the bound of rounding for a ray in it.
    pub edges: [([T; 3], T); 3],
}

/// One light on one sphere.
#[derive(Clone, Copy, Debug)]
pub struct Light<T> {
    /// From the centre, in radii.
    pub position: [T; 3],
    /// Of red, green and blue: I_L C.
    pub weights: [T; 3],
}

/// VMAX: b where either is NaN.
fn max<T: Real>(a: T, b: T) -> T {
    if a > b { a } else { b }
}

/// VMIN: b where either is NaN.
fn min<T: Real>(a: T, b: T) -> T {
    if a < b { a } else { b }
}

/// COSINE.
fn cosine<T: Real>(n: T, q: T) -> T {
    min(max(n / q.sqrt(), T::ZERO), T::ONE)
}

impl Rounding {
    /// VFMA: a * b + c.
    fn fma<T: Real>(self, a: T, b: T, c: T) -> T {
        match self {
            Rounding::Fused => a.mul_add(b, c),
            Rounding::Unfused => c + a * b,
        }
    }

    /// VDIFFERENCE: a c1 - b c2.
    fn difference<T: Real>(self, a: T, c1: T, b: T, c2: T) -> T {
        let w = b * c2;
        match self {
            Rounding::Fused => a.mul_add(c1, -w) + (-b).mul_add(c2, w),
            Rounding::Unfused => a * c1 - w,
        }
    }

    /// CROSS3.
    pub fn cross<T: Real>(self, a: [T; 3], b: [T; 3]) -> [T; 3] {
        [(1, 2), (2, 0), (0, 1)].map(|(i, j)| self.fma(-a[j], b[i], a[i] * b[j]))
    }

    /// NORM3.
    pub fn norm<T: Real>(self, a: [T; 3]) -> T {
        self.dot(a, a).sqrt()
    }

    /// NORMALISE3.
    pub fn normalise<T: Real>(self, a: [T; 3]) -> [T; 3] {
        a.map(|x| x / self.norm(a))
    }

    /// SPHERE_HIT3: t, or infinity where the ray `d` misses.
    pub fn sphere_hit<T: Real>(self, sphere: &SphereHit<T>, d: [T; 3]) -> T {
        let c = sphere.centre;
        let x = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| self.difference(d[j], c[i], d[i], c[j]));
        let disc = self.dot(d, d) * sphere.square - self.dot(x, x);
        let (a, h, root) = (self.dot(d, d), self.dot(d, c), disc.sqrt());
        let q = h + root.with_sign_of(h);
        let t = if q * sphere.k > T::ZERO { sphere.k / q } else { q / a };
        if t > T::ZERO { t } else { T::INFINITY }
    }

    /// TRIANGLE_HIT3: t, or infinity where the ray `d` misses.
    pub fn triangle_hit<T: Real>(self, triangle: &TriangleHit<T>, d: [T; 3]) -> T {
        let w = self.dot(d, triangle.normal);
        let inside = triangle.edges.iter().all(|(outward, bound)| self.dot(d, *outward) < *bound);
        if w > T::ZERO && inside { triangle.k / w } else { T::INFINITY }
    }

    /// DOT3.
    pub fn dot<T: Real>(self, a: [T; 3], b: [T; 3]) -> T {
        self.fma(a[2], b[2], self.fma(a[1], b[1], a[0] * b[0]))
    }

    /// LAMBERT3: a colour, and what the light adds to it at the point o of a sphere of radius 1 about the origin.
    pub fn lambert<T: Real>(self, light: &Light<T>, o: [T; 3], colour: [T; 3]) -> [T; 3] {
        let l = [0, 1, 2].map(|i| light.position[i] - o[i]);
        let cosine = cosine(self.dot(o, l), self.dot(l, l));
        [0, 1, 2].map(|i| self.fma(cosine, light.weights[i], colour[i]))
    }
}
