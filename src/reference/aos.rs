//! The twin of the paper's macros: every operation of `asm/include/*_aos.inc` over four lanes, in
//! the same order.
//!
//! Plain operations, none fused, so that the two agree to the last bit. The names are those of
//! `asm/ops/aos.asm`.

use std::ops::{Add, Div, Mul, Sub};

/// Four lanes: x, y, z and a w that is 0 in a vector.
pub type Lanes<S = f32> = [S; 4];

/// What the twin computes with: f32, and in proofs expressions in place of numbers.
pub trait Scalar:
    Copy + PartialOrd + From<f32> + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// NaN below 0.
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

/// Which forms the macros take: `AOS_BEST` of the assembly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// The forms that the paper counts.
    Paper,
    /// The best forms that we know.
    Best,
}

/// A point light: its position, and I_L.
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

/// What the Lambert term needs of a hit.
#[derive(Clone, Copy, Debug)]
pub struct Surface<S = f32> {
    /// P.
    pub point: Lanes<S>,
    /// N.
    pub normal: Lanes<S>,
    /// C.
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

/// a . b: (xx + yy) + (zz + ww), or zz + (yy + xx) in the best form.
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

/// a x b, in all four lanes as the shuffles make it.
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

/// The t of SPHERE_HIT, infinity for a miss.
#[inline]
pub fn sphere<S: Scalar>(form: Form, ray: Lanes<S>, s: &Sphere<S>) -> S {
    let a = dot(form, ray, ray);
    let h = dot(form, s.centre, ray);
    let k = dot(form, s.centre, s.centre) - s.radius * s.radius;
    let disc = h * h - k * a;
    // NaN, which no comparison holds for, if the ray misses it.
    let root = disc.sqrt();
    [(h - root) / a, (h + root) / a].into_iter().find(|t| *t > S::from(0.0)).unwrap_or(S::from(f32::INFINITY))
}

/// The normal of eq. 6.
#[inline]
pub fn plane_normal<S: Scalar>(s: &Triangle<S>) -> Lanes<S> {
    let [v1, v2, v3] = s.vertices;
    cross(sub(v1, v2), sub(v1, v3))
}

/// The t of TRIANGLE_HIT, infinity for a miss.
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

/// The light that LAMBERT adds, for `sides` 1 or 2.
#[inline]
pub fn lambert<S: Scalar>(form: Form, sides: u32, surface: &Surface<S>, light: &Light<S>) -> Lanes<S> {
    let l = normalise(form, sub(light.position, surface.point));
    let cosine = dot(form, l, surface.normal);
    let cosine = if sides == 2 { cosine.abs() } else { cosine };
    let cosine = if cosine > S::from(0.0) { cosine } else { S::from(0.0) };
    lanes(scale(light.radiance, cosine), surface.colour, |i, c| i * c)
}

/// Algorithm 1 for one ray: the colour of its pixel, which begins as `pixel`.
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
