//! Finds the twin of an operation by name, which the kernels must equal to the last bit.

use super::inputs::Input;
use rayo::internals::kernels::harness::lanes::{Lanes, dot};
use rayo::internals::kernels::{Light, PaperSphere, PaperTriangle, Surface, Vec4};
use rayo::internals::reference::aos::{self, Form, Scalar};

/// The expected result of a single-vector macro in that form; a scalar is in the first lane.
///
/// # Panics
/// For an operation without a twin, or with operands that are not its own.
pub fn of_macros(form: Form, name: &str, input: &Input) -> aos::Lanes {
    of_macros_on(form, name, &input.operands())
}

/// The expected result of a single-vector macro on operands that are numbers, or symbolic
/// expressions that are to be proved equal.
///
/// # Panics
/// For an operation without a twin, or with operands that are not its own.
pub fn of_macros_on<S: Scalar>(form: Form, name: &str, operands: &Operands<S>) -> aos::Lanes<S> {
    let scalar = |x| [x, S::from(0.0), S::from(0.0), S::from(0.0)];
    match (name, operands) {
        ("add", Operands::Vectors(a, b)) => aos::add(*a, *b),
        ("sub", Operands::Vectors(a, b)) => aos::sub(*a, *b),
        ("scale", Operands::Scale(a, b)) => aos::scale(*a, *b),
        ("dot", Operands::Vectors(a, b)) => scalar(aos::dot(form, *a, *b)),
        ("norm", Operands::Vectors(a, _)) => scalar(aos::norm(form, *a)),
        ("cross", Operands::Vectors(a, b)) => aos::cross(*a, *b),
        ("normalise", Operands::Vectors(a, _)) => aos::normalise(form, *a),
        ("sphere", Operands::Sphere(a, b)) => scalar(aos::sphere(form, *a, b)),
        ("triangle", Operands::Triangle(a, b)) => scalar(aos::triangle(form, *a, b)),
        ("lambert", Operands::Lambert(a, b)) => lambert_of_macros(form, 1, a, b),
        ("lambert2", Operands::Lambert(a, b)) => lambert_of_macros(form, 2, a, b),
        _ => panic!("the operation `{name}` needs a twin in lab/src/experiments/check/twins.rs for its operands"),
    }
}

/// The operands of an operation on single vectors, in the twin's types.
#[derive(Clone, Copy, Debug)]
pub enum Operands<S> {
    Vectors(aos::Lanes<S>, aos::Lanes<S>),
    Scale(aos::Lanes<S>, S),
    Sphere(aos::Lanes<S>, aos::Sphere<S>),
    Triangle(aos::Lanes<S>, aos::Triangle<S>),
    Lambert(aos::Surface<S>, aos::Light<S>),
}

/// The twin of LAMBERT, which adds to a given colour. Here that is 0, so that a result of -0
/// becomes 0.
fn lambert_of_macros<S: Scalar>(
    form: Form,
    sides: u32,
    surface: &aos::Surface<S>,
    light: &aos::Light<S>,
) -> aos::Lanes<S> {
    aos::add([S::from(0.0); 4], aos::lambert(form, sides, surface, light))
}

impl Input {
    /// The operands of the twin.
    fn operands(&self) -> Operands<f32> {
        match *self {
            Input::Vectors(a, b) => Operands::Vectors(a.lanes(), b.lanes()),
            Input::Scale(a, b) => Operands::Scale(a.lanes(), b),
            Input::Sphere(a, b) => Operands::Sphere(a.lanes(), twin_of_sphere(&b)),
            Input::Triangle(a, b) => Operands::Triangle(a.lanes(), twin_of_triangle(&b)),
            Input::Lambert(a, b) => Operands::Lambert(twin_of_surface(&a), twin_of_light(&b)),
        }
    }
}

pub fn twin_of_surface(surface: &Surface) -> aos::Surface {
    aos::Surface { point: surface.point.lanes(), normal: surface.normal.lanes(), colour: surface.colour.lanes() }
}

pub fn twin_of_light(light: &Light) -> aos::Light {
    aos::Light { position: light.position.lanes(), radiance: light.radiance.lanes() }
}

pub fn twin_of_sphere(sphere: &PaperSphere) -> aos::Sphere {
    aos::Sphere { centre: sphere.centre.lanes(), colour: sphere.colour.lanes(), radius: sphere.radius }
}

pub fn twin_of_triangle(triangle: &PaperTriangle) -> aos::Triangle {
    let vertices = [triangle.v1, triangle.v2, triangle.v3].map(Vec4::lanes);
    aos::Triangle { vertices, colour: triangle.colour.lanes() }
}

/// SPHERE_HIT3: t, or infinity where the ray `d` misses. The second argument has the fields of
/// `SphereHit`.
fn t_of_sphere<L: Lanes>(d: [L; 3], [x, y, z, square, k]: [L; 5]) -> L {
    let c = [x, y, z];
    // VDIFFERENCE, which is Kahan's difference of products.
    let across = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| {
        let w = d[i] * c[j];
        let difference = d[j].fms(c[i], w);
        if L::FUSED { difference + w.fnma(d[i], c[j]) } else { difference }
    });
    let h = dot(d, c);
    let q = h + (dot(d, d) * square - dot(across, across)).sqrt().with_sign_of(h);
    let t = (q * k).greater(L::of(0.0)).select(k / q, q / dot(d, d));
    t.greater(L::of(0.0)).select(t, L::of(f64::INFINITY))
}

/// TRIANGLE_HIT3: t, or infinity where the ray `d` misses. The second argument has the fields of
/// `TriangleHit`.
fn t_of_triangle<L: Lanes>(d: [L; 3], [[x, y, z, k], edges @ ..]: [[L; 4]; 4]) -> L {
    let w = dot(d, [x, y, z]);
    let inside = edges.map(|[x, y, z, bound]| bound.greater(dot(d, [x, y, z])));
    let hit = inside.into_iter().fold(w.greater(L::of(0.0)), L::and);
    hit.select(k / w, L::of(f64::INFINITY))
}

/// LAMBERT3: `colour` plus the light's contribution at the point `o` of the unit sphere around the
/// origin. The first argument has the fields of an `ObjectLight`.
fn lambert<L: Lanes>([x, y, z, _, weights @ ..]: [L; 7], o: [L; 3], colour: [L; 3]) -> [L; 3] {
    let l = [x - o[0], y - o[1], z - o[2]];
    let cosine = (dot(o, l) / dot(l, l).sqrt()).max(L::of(0.0)).min(L::of(1.0));
    [0, 1, 2].map(|i| colour[i].fma(cosine, weights[i]))
}

/// The expected result of a packet macro for the vector in one lane, with the operations in the
/// same order. `b` has the elements of the second operand, or of the record.
///
/// # Panics
/// For an operation without a twin.
pub fn of_packets<L: Lanes>(op: &str, a: [L::Number; 3], b: &[L::Number]) -> Vec<L::Number> {
    let (a, b): (_, Vec<_>) = (a.map(L::all), b.iter().map(|b| L::all(*b)).collect());
    let three = || [b[0], b[1], b[2]];
    let found = match op {
        "add" => (0..3).map(|i| a[i] + b[i]).collect(),
        "sub" => (0..3).map(|i| a[i] - b[i]).collect(),
        "scale" => a.map(|a| a * b[0]).to_vec(),
        "dot" => vec![dot(a, three())],
        "norm" => vec![dot(a, a).sqrt()],
        "cross" => [(1, 2), (2, 0), (0, 1)].map(|(i, j)| (a[i] * b[j]).fnma(a[j], b[i])).to_vec(),
        "normalise" => a.map(|x| x / dot(a, a).sqrt()).to_vec(),
        "sphere" => vec![t_of_sphere(a, b[..5].try_into().unwrap())],
        "triangle" => vec![t_of_triangle(a, [0, 4, 8, 12].map(|i| b[i..i + 4].try_into().unwrap()))],
        "lambert" => lambert(b[..7].try_into().unwrap(), a, [L::of(0.0); 3]).to_vec(),
        _ => panic!("the operation `{op}` on packets needs a twin in lab/src/experiments/check/twins.rs"),
    };
    found.into_iter().map(|x: L| x.lane(0)).collect()
}
