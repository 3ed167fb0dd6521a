//! Every operation in Rust as a function that is kept whole, with the signature of those in NASM: out, a, b.

use super::subjects::{Subject, whole};

macro_rules! kept {
    ($($name:ident($a:ident: $a_type:ty, $b:ident: $b_type:ty) -> $out:ty { $value:expr })*) => {
        $(#[inline(never)]
        fn $name(out: &mut $out, $a: &$a_type, $b: &$b_type) {
            *out = $value;
        })*

        /// The operation of that name.
        pub fn subject(op: &str) -> super::Subject {
            match op {
                $(stringify!($name) => super::whole($name),)*
                _ => unreachable!("there is no operation {op}"),
            }
        }
    };
}

/// The scalar twin of the paper's macros: four floats, one after the other, as far as the compiler leaves them so.
pub mod rust {
    use crate::reference::aos::{self, Form, Lanes, Light, Sphere, Surface, Triangle};

    type V = Lanes;

    kept! {
        add(a: V, b: V) -> V { aos::add(*a, *b) }
        sub(a: V, b: V) -> V { aos::sub(*a, *b) }
        scale(a: V, b: f32) -> V { aos::scale(*a, *b) }
        dot(a: V, b: V) -> f32 { aos::dot(Form::Paper, *a, *b) }
        norm(a: V, _b: V) -> f32 { aos::norm(Form::Paper, *a) }
        cross(a: V, b: V) -> V { aos::cross(*a, *b) }
        normalise(a: V, _b: V) -> V { aos::normalise(Form::Paper, *a) }
        sphere(a: V, b: Sphere) -> f32 { aos::sphere(Form::Paper, *a, b) }
        triangle(a: V, b: Triangle) -> f32 { aos::triangle(Form::Paper, *a, b) }
        lambert(a: Surface, b: Light) -> V { aos::lambert(Form::Paper, 1, a, b) }
    }
}

/// glam's `Vec3A`, a vector in one register with the operations of a library.
pub mod glam {
    use glam::Vec3A;

    /// A centre, and a radius.
    pub type Sphere = (Vec3A, f32);
    /// Vertices.
    pub type Triangle = [Vec3A; 3];
    /// A point, its normal, and the colour there.
    pub type Surface = [Vec3A; 3];
    /// A place, and what light comes from it.
    pub type Light = [Vec3A; 2];

    kept! {
        add(a: Vec3A, b: Vec3A) -> Vec3A { *a + *b }
        sub(a: Vec3A, b: Vec3A) -> Vec3A { *a - *b }
        scale(a: Vec3A, b: f32) -> Vec3A { *a * *b }
        dot(a: Vec3A, b: Vec3A) -> f32 { a.dot(*b) }
        norm(a: Vec3A, _b: Vec3A) -> f32 { a.length() }
        cross(a: Vec3A, b: Vec3A) -> Vec3A { a.cross(*b) }
        normalise(a: Vec3A, _b: Vec3A) -> Vec3A { a.normalize() }
        sphere(ray: Vec3A, s: Sphere) -> f32 { sphere_hit(*ray, s) }
        triangle(ray: Vec3A, s: Triangle) -> f32 { triangle_hit(*ray, s) }
        lambert(s: Surface, l: Light) -> Vec3A { shade(s, l) }
    }

    #[inline(always)]
    fn shade([point, normal, colour]: &Surface, [position, radiance]: &Light) -> Vec3A {
        (position - point).normalize_or_zero().dot(*normal).max(0.0) * radiance * colour
    }

    #[inline(always)]
    fn sphere_hit(ray: Vec3A, (centre, radius): &Sphere) -> f32 {
        let (a, h) = (ray.length_squared(), ray.dot(*centre));
        let disc = h * h - (centre.length_squared() - radius * radius) * a;
        if disc >= 0.0 {
            let root = disc.sqrt();
            for t in [(h - root) / a, (h + root) / a] {
                if t > 0.0 {
                    return t;
                }
            }
        }
        f32::INFINITY
    }

    #[inline(always)]
    fn triangle_hit(ray: Vec3A, &[v1, v2, v3]: &Triangle) -> f32 {
        let n = (v1 - v2).cross(v1 - v3);
        let t = v1.dot(n) / ray.dot(n);
        let p = t * ray;
        let same_side = |a: Vec3A, b: Vec3A, c: Vec3A| (b - a).cross(p - a).dot((b - a).cross(c - a)) >= 0.0;
        if t > 0.0 && same_side(v1, v2, v3) && same_side(v2, v3, v1) && same_side(v3, v1, v2) {
            t
        } else {
            f32::INFINITY
        }
    }
}
