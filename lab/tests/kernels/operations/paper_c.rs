//! The twin of the paper's C: every operation of `src/kernels/c/paper.h` in f32, in the same order.
//!
//! C differs from the macros in the order of a dot product's sums, in taking roots with `pow` in
//! f64, in keeping the factors 2 and 4 of eq. 5 and the origin of the ray, and in ordering hits by
//! distance instead of t. All of it is correctly rounded, so the two agree to the last bit. `pow`
//! need not be, but is close enough: where x has 24 bits, its root is at least 2^-51 (relative)
//! from the middle between two f32, and the error of `pow` is below 2^-52.

use rayo::internals::reference::aos::{Lanes, Light, Sphere, Surface, Triangle, add, scale, sub};
use rayo_lab::experiments::check::inputs::Input;
use rayo_lab::experiments::check::twins::{twin_of_light, twin_of_sphere, twin_of_surface, twin_of_triangle};

type Vector = Lanes;

const ORIGIN: Vector = [0.0; 4];

/// The result of the operation `name` for `input`; a scalar is in the first lane.
pub fn op(name: &str, input: &Input) -> Lanes {
    let scalar = |x| [x, 0.0, 0.0, 0.0];
    match (name, *input) {
        ("add", Input::Vectors(a, b)) => add(a.lanes(), b.lanes()),
        ("sub", Input::Vectors(a, b)) => sub(a.lanes(), b.lanes()),
        ("scale", Input::Scale(a, b)) => scale(a.lanes(), b),
        ("dot", Input::Vectors(a, b)) => scalar(dot(a.lanes(), b.lanes())),
        ("norm", Input::Vectors(a, _)) => scalar(norm(a.lanes())),
        ("cross", Input::Vectors(a, b)) => cross(a.lanes(), b.lanes()),
        ("normalise", Input::Vectors(a, _)) => normalise(a.lanes()),
        ("sphere", Input::Sphere(a, b)) => scalar(sphere(a.lanes(), &twin_of_sphere(&b))),
        ("triangle", Input::Triangle(a, b)) => scalar(triangle(a.lanes(), &twin_of_triangle(&b))),
        ("lambert", Input::Lambert(a, b)) => lambert(1, &twin_of_surface(&a), &twin_of_light(&b)),
        ("lambert2", Input::Lambert(a, b)) => lambert(2, &twin_of_surface(&a), &twin_of_light(&b)),
        _ => panic!("the operation `{name}` of C needs a twin for {input:?}"),
    }
}

fn square_root(x: f32) -> f32 {
    f64::from(x).powf(0.5) as f32
}

/// a . b: ((xx + yy) + zz) + ww.
pub fn dot(a: Vector, b: Vector) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}

/// ||a||.
pub fn norm(a: Vector) -> f32 {
    square_root(dot(a, a))
}

/// a x b, with w = 0.
pub fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0], 0.0]
}

/// a / ||a||.
pub fn normalise(a: Vector) -> Vector {
    let norm = norm(a);
    a.map(|a| a / norm)
}

/// Eq. 1, for a ray from the origin.
fn point_on(ray: Vector, t: f32) -> Vector {
    add(ORIGIN, scale(ray, t))
}

/// The smallest root t > 0 of eq. 5; infinity if there is none.
pub fn sphere(ray: Vector, s: &Sphere) -> f32 {
    let from_centre = sub(ORIGIN, s.centre);
    let a = dot(ray, ray);
    let b = 2.0 * dot(ray, from_centre);
    let c = dot(from_centre, from_centre) - s.radius * s.radius;
    let disc = b * b - 4.0 * a * c;
    if disc >= 0.0 {
        let root = square_root(disc);
        for t in [(-b - root) / (2.0 * a), (-b + root) / (2.0 * a)] {
            if t > 0.0 {
                return t;
            }
        }
    }
    f32::INFINITY
}

/// The normal of eq. 6.
pub fn plane_normal(s: &Triangle) -> Vector {
    let [v1, v2, v3] = s.vertices;
    cross(sub(v1, v2), sub(v1, v3))
}

/// The t > 0 of eq. 9 if eq. 10 holds for each edge; otherwise infinity.
pub fn triangle(ray: Vector, s: &Triangle) -> f32 {
    let [v1, v2, v3] = s.vertices;
    let n = plane_normal(s);
    let across = dot(ray, n);
    let t = dot(sub(v1, ORIGIN), n) / across;
    let p = point_on(ray, t);
    let same_side = |a, b, c| {
        let edge = sub(b, a);
        dot(cross(edge, sub(p, a)), cross(edge, sub(c, a))) >= 0.0
    };
    let ahead = across != 0.0 && t > 0.0;
    if ahead && same_side(v1, v2, v3) && same_side(v2, v3, v1) && same_side(v3, v1, v2) { t } else { f32::INFINITY }
}

/// The light of eq. 11 for one light and `sides` 1 or 2.
pub fn lambert(sides: u32, surface: &Surface, light: &Light) -> Vector {
    let cosine = dot(normalise(sub(light.position, surface.point)), surface.normal);
    let cosine = if sides == 2 { cosine.abs() } else { cosine };
    if cosine > 0.0 {
        let [x, y, z, _] = scale(light.radiance, cosine);
        let [red, green, blue, _] = surface.colour;
        [x * red, y * green, z * blue, 0.0]
    } else {
        [0.0; 4]
    }
}

/// Algorithm 1 for one ray: the colour of its pixel; `pixel` is the background.
pub fn trace(ray: Vector, lights: &[Light], spheres: &[Sphere], triangles: &[Triangle], mut pixel: Vector) -> Vector {
    let shade =
        |sides, surface: Surface| lights.iter().fold([0.0; 4], |sum, light| add(sum, lambert(sides, &surface, light)));
    let distance = |point| norm(sub(point, ORIGIN));
    let mut nearest = f32::INFINITY;
    for s in spheres {
        let point = point_on(ray, sphere(ray, s));
        if distance(point) < nearest {
            nearest = distance(point);
            pixel = shade(1, Surface { point, normal: normalise(sub(point, s.centre)), colour: s.colour });
        }
    }
    for s in triangles {
        let point = point_on(ray, triangle(ray, s));
        if distance(point) < nearest {
            nearest = distance(point);
            pixel = shade(2, Surface { point, normal: normalise(plane_normal(s)), colour: s.colour });
        }
    }
    pixel
}
