//! The twin of the packet macros: one lane of them.
//!
//! These are the operations of `asm/include/{vec3,sphere,lit,triangle,lambert}.inc`, in the same order. What belongs to a row is a
//! function of j, its pixel. Where macros take an estimate of a root, it is what a [`Cosine`] of the caller's makes it: no two
//! CPUs need have the same. The names are those of `asm/include/layout.inc`, which says what each number is.

use super::Real;

/// What a product that is added to something is rounded to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rounding {
    /// Together with the sum, once: `HAS_FMA` of the assembly.
    Fused,
    /// By itself, and then the sum.
    Unfused,
}

/// The linear function `slope j + offset`: fields `name1` and `name0` of a record.
#[derive(Clone, Copy, Debug)]
pub struct Linear<T> {
    /// From one pixel to the next.
    pub slope: T,
    /// At j = 0.
    pub offset: T,
}

/// A row of a sphere, seen from outside, lit by one light.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "layout.inc says what each field of LitSphere and LitRows is")]
pub struct LitSphere<T> {
    pub m: T,
    pub a: T,
    pub h: Linear<T>,
    pub q: Linear<T>,
    pub kn: T,
    pub ke: T,
    pub weights: [T; 3],
}

/// A sphere that rays of any direction may meet.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "layout.inc says what each field of SphereHit is")]
pub struct SphereHit<T> {
    pub centre: [T; 3],
    pub square: T,
    pub k: T,
}

/// A triangle that rays of any direction may meet.
#[derive(Clone, Copy, Debug)]
pub struct TriangleHit<T> {
    /// n.
    pub normal: [T; 3],
    /// v1 . n.
    pub k: T,
    /// The normal of the plane through the origin and each edge, and what rounding may make of a ray in it.
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

/// How light falls on a surface: n / sqrt q, of n and q.
pub trait Cosine<T> {
    /// n / sqrt q.
    fn over_root(&mut self, n: T, q: T) -> T;
}

/// Without an estimate.
#[derive(Clone, Copy, Debug)]
pub struct Exact;

impl<T: Real> Cosine<T> for Exact {
    fn over_root(&mut self, n: T, q: T) -> T {
        n / q.sqrt()
    }
}

/// VRSQRT: about 1 / sqrt x.
#[derive(Clone, Copy, Debug)]
pub struct Estimated<F>(pub F);

impl<T: Real, F: FnMut(T) -> T> Cosine<T> for Estimated<F> {
    fn over_root(&mut self, n: T, q: T) -> T {
        n * (self.0)(q)
    }
}

/// VMAX: b where either is NaN.
pub(super) fn max<T: Real>(a: T, b: T) -> T {
    if a > b { a } else { b }
}

/// VMIN: b where either is NaN.
pub(super) fn min<T: Real>(a: T, b: T) -> T {
    if a < b { a } else { b }
}

/// COSINE.
pub(super) fn cosine<T: Real>(by: &mut impl Cosine<T>, n: T, q: T) -> T {
    min(max(by.over_root(n, q), T::ZERO), T::ONE)
}

impl Rounding {
    /// VFMA: a * b + c.
    pub(super) fn fma<T: Real>(self, a: T, b: T, c: T) -> T {
        match self {
            Rounding::Fused => a.mul_add(b, c),
            Rounding::Unfused => c + a * b,
        }
    }

    /// f at j.
    fn affine<T: Real>(self, f: Linear<T>, j: T) -> T {
        self.fma(f.slope, j, f.offset)
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

    /// SPHERE_LIT and the weights: the colour at pixel j, which is in a packet with an end of the span or not.
    pub fn lit<T: Real>(self, sphere: &LitSphere<T>, j: T, edge: bool) -> [T; 3] {
        let u = j - sphere.m;
        let p = self.fma(-u, u, sphere.a);
        let root = if edge { max(p, T::ZERO) } else { p }.sqrt();
        let den = self.affine(sphere.h, j) + root;
        let n = self.fma(root, sphere.kn, self.affine(sphere.q, j));
        let e = self.fma(den, sphere.ke, -n) * den;
        let light = max(n / e.sqrt(), T::ZERO);
        sphere.weights.map(|weight| light * weight)
    }

    /// SPHERE_LIT in f32 with estimates, which `rsqrt` gives. An edge packet takes p for `least` where it is less.
    pub fn lit_by_estimates<T: Real>(
        self,
        (sphere, least): (&LitSphere<T>, T),
        j: T,
        edge: bool,
        mut rsqrt: impl FnMut(T) -> T,
    ) -> [T; 3] {
        let u = j - sphere.m;
        let p = self.fma(-u, u, sphere.a);
        let over_root = rsqrt(if edge { max(p, least) } else { p });
        let den = self.fma(self.affine(sphere.h, j), over_root, T::ONE);
        let n = self.fma(self.affine(sphere.q, j), over_root, sphere.kn);
        let e = self.fma(den, sphere.ke, -n) * den;
        let light = max(Estimated(rsqrt).over_root(n, e), T::ZERO);
        sphere.weights.map(|weight| light * weight)
    }

    /// LAMBERT3 on black: the colour of the point o of a sphere of radius 1 about the origin.
    pub fn lambert<T: Real>(self, light: &Light<T>, o: [T; 3]) -> [T; 3] {
        let l = [0, 1, 2].map(|i| light.position[i] - o[i]);
        let cosine = cosine(&mut Exact, self.dot(o, l), self.dot(l, l));
        light.weights.map(|weight| self.fma(cosine, weight, T::ZERO))
    }
}

/// A film and a sphere, in units of its radius, for rows of it.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "layout.inc says what each field of LitSetup is")]
pub struct LitSetup {
    pub step: f64,
    pub half: [f64; 2],
    pub columns: f64,
    pub width: f64,
    pub c: [f64; 3],
    pub k: f64,
    pub m: f64,
    pub nx: f64,
    pub zz: f64,
    pub cyz: f64,
    pub czz: f64,
    pub h: f64,
    pub q: f64,
    pub v: [f64; 3],
}

impl LitSetup {
    /// Of a row of the picture start, end, j, stop, m, a, h0 and q0, see LitRows; no columns where it misses the sphere, and the
    /// rest is left open then.
    pub fn row(&self, row: u32) -> [f64; 8] {
        let [cx, cy, cz] = self.c;
        let y = self.half[1] - (f64::from(row) + 0.5) * self.step;
        let g = y * y + self.zz;
        let across = self.cyz - y * cz;
        let root = ((g - across * across) * self.k).sqrt();
        let h = y * cy + self.czz;
        let b = h * cx;
        let q = b + root.copysign(b);
        let p = if q == 0.0 { 0.0 } else { (g * self.nx - across * across) / q };
        let one = q / self.m;
        let (left, right) = (min(one, -p), max(-p, one));
        let middle = (left + right) * 0.5;
        if root.is_nan() || middle * cx + h <= 0.0 {
            return [0.0; 8];
        }
        let column = |x: f64| (x + self.half[0]) * self.columns - 0.5;
        let inside = |column: f64| min(max(column, 0.0), self.width);
        let (start, end) = (inside(column(left).ceil()), inside(column(right).floor() + 1.0));
        let origin = ((start + end) * 0.5).floor();
        let x = (origin + 0.5) * self.step - self.half[0];
        let half = (right - left) * 0.5 * self.columns;
        let q0 = (x * self.v[0] + y * self.v[1] + self.v[2]) * self.q;
        [start, end, start - origin, end - origin, (middle - x) * self.columns, half * half, (x * cx + h) * self.h, q0]
    }
}
