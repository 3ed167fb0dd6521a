//! The twin of the packet macros: one lane of them.
//!
//! These are the operations of `asm/include/{vec3,sphere,lit,triangle,lambert}.inc`, in the same order. What belongs to a span is a
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

/// A sphere, seen from outside.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "layout.inc says what each field of OutsideSpan is")]
pub struct Outside<T> {
    pub a: Linear<T>,
    pub b: Linear<T>,
    pub h: Linear<T>,
    pub xyz: [Linear<T>; 3],
    pub c: [T; 3],
}

/// A sphere, seen from outside at less than sqrt 2 radii.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "layout.inc says what each field of NearSpan is")]
pub struct Near<T> {
    pub a: Linear<T>,
    pub b: Linear<T>,
    pub h: Linear<T>,
    pub x: Linear<T>,
    pub y: T,
    pub z: T,
    pub c: [T; 3],
}

/// A sphere, seen from inside.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "layout.inc says what each field of InsideSpan is")]
pub struct Inside<T> {
    pub x: Linear<T>,
    pub y: T,
    pub z: T,
    pub g: T,
    pub h: Linear<T>,
    pub k: T,
    pub c: [T; 3],
}

/// A triangle.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "layout.inc says what each field of TriangleSpan is")]
pub struct Triangle<T> {
    pub w: Linear<T>,
    pub xyz: [Linear<T>; 3],
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

/// One light on one object.
#[derive(Clone, Copy, Debug)]
pub struct Light<T> {
    /// From the origin of the object's points to the light.
    pub position: [T; 3],
    /// For triangles: |N . (light - v)|.
    pub cosine: T,
    /// Of red, green and blue: I_L C.
    pub weights: [T; 3],
}

/// From where the points of an object are seen, and what its normal is: the ways of LAMBERT3.
#[derive(Clone, Copy, Debug)]
pub enum Seen<T> {
    /// From the centre of a sphere of radius 1: the point is the normal.
    FromCentre,
    /// On a plane: N . L is the light's own.
    OnPlane,
    /// From the camera, of a sphere of radius 1 about this centre.
    FromCamera([T; 3]),
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

    /// VAFFINE.
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

    /// SPHERE_DEN: 1/t at pixel j, and sqrt D.
    fn den_and_root<T: Real>(self, [a, b, h]: [Linear<T>; 3], j: T) -> (T, T) {
        let root = max(self.affine(a, j) * self.affine(b, j), T::ZERO).sqrt();
        (self.affine(h, j) + root, root)
    }

    /// SPHERE_DEN: 1/t at pixel j.
    pub fn outside_den<T: Real>(self, sphere: &Outside<T>, j: T) -> T {
        self.den_and_root([sphere.a, sphere.b, sphere.h], j).0
    }

    /// SPHERE_OUTSIDE: the unit normal at pixel j.
    pub fn outside_normal<T: Real>(self, sphere: &Outside<T>, j: T) -> [T; 3] {
        let (den, root) = self.den_and_root([sphere.a, sphere.b, sphere.h], j);
        let t = T::ONE / den;
        let along = |i: usize| self.fma(-root, sphere.c[i], self.affine(sphere.xyz[i], j)) * t;
        [0, 1, 2].map(along)
    }

    /// SPHERE_OUTSIDE and its lights: the colour at pixel j.
    pub fn outside<T: Real>(self, sphere: &Outside<T>, lights: &[Light<T>], j: T, cosine: impl Cosine<T>) -> [T; 3] {
        self.lights(lights, self.outside_normal(sphere, j), Seen::FromCentre, cosine)
    }

    /// SPHERE_DEN: 1/t at pixel j.
    pub fn near_den<T: Real>(self, sphere: &Near<T>, j: T) -> T {
        self.den_and_root([sphere.a, sphere.b, sphere.h], j).0
    }

    /// SPHERE_NEAR: the point at pixel j.
    fn near_point<T: Real>(self, sphere: &Near<T>, j: T) -> [T; 3] {
        let t = T::ONE / self.near_den(sphere, j);
        [self.affine(sphere.x, j) * t, t * sphere.y, t * sphere.z]
    }

    /// The unit normal that LAMBERT3 takes at pixel j.
    pub fn near_normal<T: Real>(self, sphere: &Near<T>, j: T) -> [T; 3] {
        let p = self.near_point(sphere, j);
        [0, 1, 2].map(|i| p[i] - sphere.c[i])
    }

    /// SPHERE_NEAR and its lights: the colour at pixel j.
    pub fn near<T: Real>(self, sphere: &Near<T>, lights: &[Light<T>], j: T, cosine: impl Cosine<T>) -> [T; 3] {
        self.lights(lights, self.near_point(sphere, j), Seen::FromCamera(sphere.c), cosine)
    }

    /// SPHERE_FAR_WALL: t at pixel j, and d.x.
    fn far_wall<T: Real>(self, sphere: &Inside<T>, j: T) -> (T, T) {
        let (x, h) = (self.affine(sphere.x, j), self.affine(sphere.h, j));
        let a = x * x + sphere.g;
        let ka = a * sphere.k;
        let p = max(h, T::ZERO) + max(h, T::ZERO);
        let m = ka / (((h * h + ka).sqrt() + p) - h);
        ((m + p) / a, x)
    }

    /// 1/t at pixel j.
    pub fn inside_den<T: Real>(self, sphere: &Inside<T>, j: T) -> T {
        T::ONE / self.far_wall(sphere, j).0
    }

    /// SPHERE_INSIDE: the point at pixel j.
    fn inside_point<T: Real>(self, sphere: &Inside<T>, j: T) -> [T; 3] {
        let (t, x) = self.far_wall(sphere, j);
        [x * t, t * sphere.y, t * sphere.z]
    }

    /// The unit normal that LAMBERT3 takes at pixel j.
    pub fn inside_normal<T: Real>(self, sphere: &Inside<T>, j: T) -> [T; 3] {
        let p = self.inside_point(sphere, j);
        [0, 1, 2].map(|i| p[i] - sphere.c[i])
    }

    /// SPHERE_INSIDE and its lights: the colour at pixel j.
    pub fn inside<T: Real>(self, sphere: &Inside<T>, lights: &[Light<T>], j: T, cosine: impl Cosine<T>) -> [T; 3] {
        self.lights(lights, self.inside_point(sphere, j), Seen::FromCamera(sphere.c), cosine)
    }

    /// 1/t at pixel j.
    pub fn triangle_den<T: Real>(self, triangle: &Triangle<T>, j: T) -> T {
        self.affine(triangle.w, j)
    }

    /// TRIANGLE_PLANE and its lights: the colour at pixel j.
    pub fn triangle<T: Real>(
        self,
        triangle: &Triangle<T>,
        lights: &[Light<T>],
        j: T,
        cosine: impl Cosine<T>,
    ) -> [T; 3] {
        let t = T::ONE / self.triangle_den(triangle, j);
        self.lights(lights, triangle.xyz.map(|f| self.affine(f, j) * t), Seen::OnPlane, cosine)
    }

    /// LAMBERT3 of every light, on black: the colour of the point o.
    pub fn lights<T: Real>(self, lights: &[Light<T>], o: [T; 3], seen: Seen<T>, mut cosine: impl Cosine<T>) -> [T; 3] {
        lights.iter().fold([T::ZERO; 3], |colour, light| {
            let l = [0, 1, 2].map(|i| light.position[i] - o[i]);
            let numerator = match seen {
                Seen::FromCentre => self.dot(o, l),
                Seen::OnPlane => light.cosine,
                Seen::FromCamera(c) => self.dot([0, 1, 2].map(|i| o[i] - c[i]), l),
            };
            let cosine = self::cosine(&mut cosine, numerator, self.dot(l, l));
            [0, 1, 2].map(|i| self.fma(cosine, light.weights[i], colour[i]))
        })
    }
}
