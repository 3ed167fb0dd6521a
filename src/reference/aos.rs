//! The twin of the paper's macros: every operation of `asm/include/*_aos.inc` on four lanes, in the
//! same order.
//!
//! The operations are plain and never fused, so that twin and macros agree to the last bit. The
//! names are those of `asm/ops/aos.asm`.

use std::ops::{Add, Div, Mul, Sub};

/// Four lanes: x, y, z, and w, which is 0 in a vector.
pub type Lanes<S = f32> = [S; 4];

/// The numbers that the twin computes with: f32 or, in proofs, symbolic expressions.
pub trait Scalar:
    Copy + PartialOrd + From<f32> + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// The square root; NaN below 0.
    fn sqrt(self) -> Self;
    fn abs(self) -> Self;
}

impl Scalar for f32 {
    #[inline]
    fn sqrt(self) -> Self {
        self.sqrt()
    }

    #[inline]
    fn abs(self) -> Self {
        self.abs()
    }
}

/// Which forms the macros have, as `AOS_BEST` selects them in the assembly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// The forms whose instructions the paper counts.
    Paper,
    /// The best forms that we know.
    Best,
}

/// A point light: its position, and its radiance I_L.
#[derive(Clone, Copy, Debug)]
pub struct Light<S = f32> {
    pub position: Lanes<S>,
    /// I_L = intensity x colour.
    pub radiance: Lanes<S>,
}

#[derive(Clone, Copy, Debug)]
pub struct Sphere<S = f32> {
    pub centre: Lanes<S>,
    pub colour: Lanes<S>,
    pub radius: S,
}

#[derive(Clone, Copy, Debug)]
pub struct Triangle<S = f32> {
    pub vertices: [Lanes<S>; 3],
    pub colour: Lanes<S>,
}

/// What the Lambert term needs to know about a hit.
#[derive(Clone, Copy, Debug)]
pub struct Surface<S = f32> {
    /// The point P.
    pub point: Lanes<S>,
    /// The normal N.
    pub normal: Lanes<S>,
    /// The colour C.
    pub colour: Lanes<S>,
}

fn lanes<S: Scalar>(a: Lanes<S>, b: Lanes<S>, op: impl Fn(S, S) -> S) -> Lanes<S> {
    std::array::from_fn(|i| op(a[i], b[i]))
}

/// a + b.
#[inline]
pub fn add<S: Scalar>(a: Lanes<S>, b: Lanes<S>) -> Lanes<S> {
    lanes(a, b, |a, b| a + b)
}

/// a - b.
#[inline]
pub fn sub<S: Scalar>(a: Lanes<S>, b: Lanes<S>) -> Lanes<S> {
    lanes(a, b, |a, b| a - b)
}

/// a * s.
#[inline]
pub fn scale<S: Scalar>(a: Lanes<S>, s: S) -> Lanes<S> {
    a.map(|a| a * s)
}

/// a . b: (xx + yy) + (zz + ww), or in the best form zz + (yy + xx).
#[inline]
pub fn dot<S: Scalar>(form: Form, a: Lanes<S>, b: Lanes<S>) -> S {
    let [x, y, z, w] = lanes(a, b, |a, b| a * b);
    match form {
        Form::Paper => (x + y) + (z + w),
        Form::Best => z + (y + x),
    }
}

/// ||a||.
#[inline]
pub fn norm<S: Scalar>(form: Form, a: Lanes<S>) -> S {
    dot(form, a, a).sqrt()
}

/// a x b, with the fourth lane as the macro's shuffles make it.
#[inline]
pub fn cross<S: Scalar>(a: Lanes<S>, b: Lanes<S>) -> Lanes<S> {
    let yzx = |v: Lanes<S>| [v[1], v[2], v[0], v[3]];
    let zxy = |v: Lanes<S>| [v[2], v[0], v[1], v[3]];
    sub(lanes(yzx(a), zxy(b), |a, b| a * b), lanes(zxy(a), yzx(b), |a, b| a * b))
}

/// a / ||a||.
#[inline]
pub fn normalise<S: Scalar>(form: Form, a: Lanes<S>) -> Lanes<S> {
    let s = norm(form, a);
    a.map(|a| a / s)
}

/// The t that SPHERE_HIT gives; infinity for a miss.
#[inline]
pub fn sphere<S: Scalar>(form: Form, ray: Lanes<S>, s: &Sphere<S>) -> S {
    let a = dot(form, ray, ray);
    let h = dot(form, s.centre, ray);
    let k = dot(form, s.centre, s.centre) - s.radius * s.radius;
    let disc = h * h - k * a;
    // If the ray misses, the root is NaN, for which no comparison holds.
    let root = disc.sqrt();
    [(h - root) / a, (h + root) / a].into_iter().find(|t| *t > S::from(0.0)).unwrap_or(S::from(f32::INFINITY))
}

/// The triangle's normal, eq. 6.
#[inline]
pub fn plane_normal<S: Scalar>(s: &Triangle<S>) -> Lanes<S> {
    let [v1, v2, v3] = s.vertices;
    cross(sub(v1, v2), sub(v1, v3))
}

/// The t that TRIANGLE_HIT gives; infinity for a miss.
#[inline(always)]
pub fn triangle<S: Scalar>(form: Form, ray: Lanes<S>, s: &Triangle<S>) -> S {
    let [v1, v2, v3] = s.vertices;
    let n = plane_normal(s);
    let t = dot(form, n, v1) / dot(form, n, ray);
    let positive = t > S::from(0.0);
    let p = scale(ray, t);
    let same_side = |a, b, c| {
        let edge = sub(b, a);
        dot(form, cross(edge, sub(p, a)), cross(edge, sub(c, a))) >= S::from(0.0)
    };
    if positive && same_side(v1, v2, v3) && same_side(v2, v3, v1) && same_side(v3, v1, v2) {
        t
    } else {
        S::from(f32::INFINITY)
    }
}

/// The light that LAMBERT adds to a surface with one or two `sides`.
#[inline]
pub fn lambert<S: Scalar>(form: Form, sides: u32, surface: &Surface<S>, light: &Light<S>) -> Lanes<S> {
    let l = normalise(form, sub(light.position, surface.point));
    let cosine = dot(form, l, surface.normal);
    let cosine = if sides == 2 { cosine.abs() } else { cosine };
    let cosine = if cosine > S::from(0.0) { cosine } else { S::from(0.0) };
    lanes(scale(light.radiance, cosine), surface.colour, |i, c| i * c)
}

/// Algorithm 1 for one ray: the colour of its pixel, which is `pixel` at the beginning.
pub fn trace(
    form: Form,
    ray: Lanes,
    lights: &[Light],
    spheres: &[Sphere],
    triangles: &[Triangle],
    mut pixel: Lanes,
) -> Lanes {
    let shade = |sides, surface: Surface| {
        lights.iter().fold([0.0; 4], |sum, light| add(sum, lambert(form, sides, &surface, light)))
    };
    let mut nearest = f32::INFINITY;
    for s in spheres {
        let t = sphere(form, ray, s);
        if t < nearest {
            nearest = t;
            let point = scale(ray, t);
            let normal = normalise(form, sub(point, s.centre));
            pixel = shade(1, Surface { point, normal, colour: s.colour });
        }
    }
    for s in triangles {
        let t = triangle(form, ray, s);
        if t < nearest {
            nearest = t;
            let (point, normal) = (scale(ray, t), normalise(form, plane_normal(s)));
            pixel = shade(2, Surface { point, normal, colour: s.colour });
        }
    }
    pixel
}
