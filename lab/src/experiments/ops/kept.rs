//! Every operation in Rust, each as a function that the compiler must not inline.

use glam::Vec3A;

use super::subjects::{COLOUR, Numbers, RADIUS, SCALAR, Subject, whole};
use rayo::internals::reference::aos::{self, Form, Light, Sphere, Surface, Triangle};

/// The scalar twin of the paper's macros: four floats are computed one after the other, unless the
/// compiler vectorises them. None for an operation without such a twin.
pub fn rust(op: &str) -> Option<Subject> {
    let vector = |[x, y, z]: [f32; 3]| [x, y, z, 0.0];
    let colour = vector(COLOUR);
    let vectors = |[a, b, ..]: Numbers| (vector(a), vector(b));
    let sphere = |[ray, centre, ..]: Numbers| (vector(ray), Sphere { centre: vector(centre), colour, radius: RADIUS });
    let triangle = |numbers: Numbers| {
        let [ray, vertices @ ..] = numbers.map(vector);
        (ray, Triangle { vertices, colour })
    };
    let lambert = |numbers: Numbers| {
        let [point, normal, position, _] = numbers.map(vector);
        (Surface { point, normal, colour }, Light { position, radiance: colour })
    };
    Some(match op {
        "add" => whole(op, vectors, |out, a, b| *out = aos::add(*a, *b)),
        "sub" => whole(op, vectors, |out, a, b| *out = aos::sub(*a, *b)),
        "scale" => whole(op, |[a, ..]| (vector(a), SCALAR), |out, a, b| *out = aos::scale(*a, *b)),
        "dot" => whole(op, vectors, |out, a, b| *out = aos::dot(Form::Paper, *a, *b)),
        "norm" => whole(op, vectors, |out, a, _| *out = aos::norm(Form::Paper, *a)),
        "cross" => whole(op, vectors, |out, a, b| *out = aos::cross(*a, *b)),
        "normalise" => whole(op, vectors, |out, a, _| *out = aos::normalise(Form::Paper, *a)),
        "sphere" => whole(op, sphere, |out, a, b| *out = aos::sphere(Form::Paper, *a, b)),
        "triangle" => whole(op, triangle, |out, a, b| *out = aos::triangle(Form::Paper, *a, b)),
        "lambert" => whole(op, lambert, |out, a, b| *out = aos::lambert(Form::Paper, 1, a, b)),
        "lambert2" => whole(op, lambert, |out, a, b| *out = aos::lambert(Form::Paper, 2, a, b)),
        _ => return None,
    })
}

/// The operation with glam's `Vec3A`, which keeps a vector in one register. None for an operation
/// that is not written with it.
pub fn glam(op: &str) -> Option<Subject> {
    let vector = Vec3A::from_array;
    let vectors = |[a, b, ..]: Numbers| (vector(a), vector(b));
    // The operands are a point, its normal and its colour, and a light's position and its colour.
    let lambert = |numbers: Numbers| {
        let [point, normal, position, _] = numbers.map(vector);
        ([point, normal, vector(COLOUR)], [position, vector(COLOUR)])
    };
    Some(match op {
        "add" => whole(op, vectors, |out, a, b| *out = *a + *b),
        "sub" => whole(op, vectors, |out, a, b| *out = *a - *b),
        "scale" => whole(op, |[a, ..]| (vector(a), SCALAR), |out, a, b| *out = *a * *b),
        "dot" => whole(op, vectors, |out, a, b| *out = a.dot(*b)),
        "norm" => whole(op, vectors, |out, a, _| *out = a.length()),
        "cross" => whole(op, vectors, |out, a, b| *out = a.cross(*b)),
        "normalise" => whole(op, vectors, |out, a, _| *out = a.normalize()),
        "sphere" => {
            whole(op, |[ray, centre, ..]| (vector(ray), (vector(centre), RADIUS)), |out, a, b| *out = sphere_hit(*a, b))
        }
        "triangle" => whole(
            op,
            |[ray, vertices @ ..]| (vector(ray), vertices.map(vector)),
            |out, a, b| *out = triangle_hit(*a, b),
        ),
        "lambert" => whole(op, lambert, |out, a, b| *out = shade(a, b)),
        _ => return None,
    })
}

#[inline(always)]
fn shade([point, normal, colour]: &[Vec3A; 3], [position, radiance]: &[Vec3A; 2]) -> Vec3A {
    (position - point).normalize_or_zero().dot(*normal).max(0.0) * radiance * colour
}

#[inline(always)]
fn sphere_hit(ray: Vec3A, (centre, radius): &(Vec3A, f32)) -> f32 {
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
fn triangle_hit(ray: Vec3A, &[v1, v2, v3]: &[Vec3A; 3]) -> f32 {
    let n = (v1 - v2).cross(v1 - v3);
    let t = v1.dot(n) / ray.dot(n);
    let p = t * ray;
    let same_side = |a: Vec3A, b: Vec3A, c: Vec3A| (b - a).cross(p - a).dot((b - a).cross(c - a)) >= 0.0;
    if t > 0.0 && same_side(v1, v2, v3) && same_side(v2, v3, v1) && same_side(v3, v1, v2) { t } else { f32::INFINITY }
}
