//! The twin of the paper's macros: every operation of `asm/include/*_aos.inc` over four lanes, in the same order.
//!
//! Plain operations, none fused, so that the two agree to the last bit. The names are those of `asm/ops/aos.asm`.

use super::Real;

/// Four lanes: x, y, z and a w that is 0 in a vector.
pub type Lanes<T> = [T; 4];

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
pub struct Light<T> {
    pub position: Lanes<T>,
    /// I_L = intensity x colour.
    pub radiance: Lanes<T>,
}

#[derive(Clone, Copy, Debug)]
pub struct Sphere<T> {
    pub centre: Lanes<T>,
    pub colour: Lanes<T>,
    pub radius: T,
}

#[derive(Clone, Copy, Debug)]
pub struct Triangle<T> {
    pub vertices: [Lanes<T>; 3],
    pub colour: Lanes<T>,
}

/// What the Lambert term needs of a hit.
#[derive(Clone, Copy, Debug)]
pub struct Surface<T> {
    /// P.
    pub point: Lanes<T>,
    /// N.
    pub normal: Lanes<T>,
    /// C.
    pub colour: Lanes<T>,
}

fn lanes<T: Real>(a: Lanes<T>, b: Lanes<T>, op: impl Fn(T, T) -> T) -> Lanes<T> {
    std::array::from_fn(|i| op(a[i], b[i]))
}

/// a + b.
#[inline]
pub fn add<T: Real>(a: Lanes<T>, b: Lanes<T>) -> Lanes<T> {
    lanes(a, b, |a, b| a + b)
}

/// a - b.
#[inline]
pub fn sub<T: Real>(a: Lanes<T>, b: Lanes<T>) -> Lanes<T> {
    lanes(a, b, |a, b| a - b)
}

/// a * s.
#[inline]
pub fn scale<T: Real>(a: Lanes<T>, s: T) -> Lanes<T> {
    a.map(|a| a * s)
}

/// a . b: (xx + yy) + (zz + ww), or zz + (yy + xx) in the best form.
#[inline]
pub fn dot<T: Real>(form: Form, a: Lanes<T>, b: Lanes<T>) -> T {
    let [x, y, z, w] = lanes(a, b, |a, b| a * b);
    match form {
        Form::Paper => (x + y) + (z + w),
        Form::Best => z + (y + x),
    }
}

/// ||a||.
#[inline]
pub fn norm<T: Real>(form: Form, a: Lanes<T>) -> T {
    dot(form, a, a).sqrt()
}

/// a x b, in all four lanes as the shuffles make it.
#[inline]
pub fn cross<T: Real>(a: Lanes<T>, b: Lanes<T>) -> Lanes<T> {
    let yzx = |v: Lanes<T>| [v[1], v[2], v[0], v[3]];
    let zxy = |v: Lanes<T>| [v[2], v[0], v[1], v[3]];
    sub(lanes(yzx(a), zxy(b), |a, b| a * b), lanes(zxy(a), yzx(b), |a, b| a * b))
}

/// a / ||a||.
#[inline]
pub fn normalise<T: Real>(form: Form, a: Lanes<T>) -> Lanes<T> {
    let s = norm(form, a);
    a.map(|a| a / s)
}

/// The t of SPHERE_HIT, infinity for a miss.
#[inline]
pub fn sphere<T: Real>(form: Form, ray: Lanes<T>, s: &Sphere<T>) -> T {
    let a = dot(form, ray, ray);
    let h = dot(form, s.centre, ray);
    let k = dot(form, s.centre, s.centre) - s.radius * s.radius;
    let disc = h * h - k * a;
    if disc >= T::ZERO {
        let root = disc.sqrt();
        for t in [(h - root) / a, (h + root) / a] {
            if t > T::ZERO {
                return t;
            }
        }
    }
    T::INFINITY
}

/// The normal of eq. 6.
#[inline]
pub fn plane_normal<T: Real>(s: &Triangle<T>) -> Lanes<T> {
    let [v1, v2, v3] = s.vertices;
    cross(sub(v1, v2), sub(v1, v3))
}

/// The t of TRIANGLE_HIT, infinity for a miss.
#[inline]
pub fn triangle<T: Real>(form: Form, ray: Lanes<T>, s: &Triangle<T>) -> T {
    let [v1, v2, v3] = s.vertices;
    let n = plane_normal(s);
    let t = dot(form, n, v1) / dot(form, n, ray);
    let positive = t > T::ZERO;
    let p = scale(ray, t);
    let same_side = |a, b, c| {
        let edge = sub(b, a);
        dot(form, cross(edge, sub(p, a)), cross(edge, sub(c, a))) >= T::ZERO
    };
    if positive && same_side(v1, v2, v3) && same_side(v2, v3, v1) && same_side(v3, v1, v2) { t } else { T::INFINITY }
}

/// The light that LAMBERT adds, for `sides` 1 or 2.
#[inline]
pub fn lambert<T: Real>(form: Form, sides: u32, surface: &Surface<T>, light: &Light<T>) -> Lanes<T> {
    let l = normalise(form, sub(light.position, surface.point));
    let cosine = dot(form, l, surface.normal);
    let cosine = if sides == 2 { cosine.abs() } else { cosine };
    let cosine = if cosine > T::ZERO { cosine } else { T::ZERO };
    lanes(scale(light.radiance, cosine), surface.colour, |i, c| i * c)
}

/// Algorithm 1 for one ray: the colour of its pixel, which begins as `pixel`.
pub fn trace<T: Real>(
    form: Form,
    ray: Lanes<T>,
    lights: &[Light<T>],
    spheres: &[Sphere<T>],
    triangles: &[Triangle<T>],
    mut pixel: Lanes<T>,
) -> Lanes<T> {
    let shade = |sides, surface: Surface<T>| {
        lights.iter().fold([T::ZERO; 4], |sum, light| add(sum, lambert(form, sides, &surface, light)))
    };
    let mut nearest = T::INFINITY;
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
