//! The runnable functions of each implementation, with operands for each path through them.

use std::hint::black_box;
use std::rc::Rc;

use ::glam::Vec3A;

use crate::measure::core_cycles;
use crate::operands::{sphere_hit, triangle_hit};
use rayo::internals::kernels::{
    self, ByValue, Isa, Light, ObjectLight, Op, OpRef, PaperSphere, PaperTriangle, Plain, Ray, Surface, Vec4,
    packet_ops,
};
use rayo::internals::reference::aos::Lanes;

/// The number of calls in a measurement.
const CALLS: u64 = 1000;

/// A function that can be called with operands for each of its paths.
pub struct Subject {
    pub address: usize,
    /// A description of each path's operands; the first path is the common one.
    pub paths: Vec<&'static str>,
    /// Calls the function once with the operands of a path, and returns some bits of the result.
    pub run: Box<dyn Fn(usize) -> u32>,
    /// Core cycles of a call on the first path: its latency, and the cycles per call of independent
    /// calls, each the fewest of as many measurements as the argument says. None for a measurement
    /// that is impossible.
    pub cost: Box<dyn Fn(u32) -> [Option<f64>; 2]>,
}

impl Subject {
    /// A subject for a function that computes `op`, with operands for each path. The operands are
    /// in a vector on the heap: of an array of length one the compiler would know that every index
    /// selects the same element, and would so remove the dependence on the previous result.
    fn new<T: 'static>(
        address: usize,
        op: &str,
        operands: impl Fn(Numbers) -> T,
        call: impl Fn(&T) -> u32 + 'static,
    ) -> Self {
        let (paths, operands): (Vec<_>, Vec<_>) =
            cases(op).into_iter().map(|(path, numbers)| (path, operands(numbers))).unzip();
        let call = Rc::new(move |path: usize| call(&operands[path]));
        let cost = Rc::clone(&call);
        let cost = move |repeats| cost_of(&*cost, repeats);
        Subject { address, paths, run: Box::new(move |path| call(path)), cost: Box::new(cost) }
    }
}

/// Measures [`Subject::cost`]. `call` calls the function with the operands of a path, and returns
/// some bits of the result. This function is compiled for each `call`, since a call through a
/// pointer would cost cycles of its own.
fn cost_of(call: &impl Fn(usize) -> u32, repeats: u32) -> [Option<f64>; 2] {
    // The compiler must not know that every result selects the operands at index 0.
    let nothing = black_box(0);
    let latency = core_cycles(repeats, super::LEAST_CYCLES, || {
        let mut bits = 0;
        for _ in 0..CALLS {
            bits = call((bits & nothing) as usize);
        }
        black_box(bits);
        CALLS
    });
    let throughput = core_cycles(repeats, super::LEAST_CYCLES, || {
        for _ in 0..CALLS {
            black_box(call(nothing as usize));
        }
        CALLS
    });
    [latency, throughput]
}

/// The number of vectors in the largest packet.
const MOST_LANES: usize = 16;

const A: [f32; 3] = [0.5, -0.75, 1.25];
const B: [f32; 3] = [1.5, 0.625, -0.25];
pub(super) const SCALAR: f32 = 0.875;
pub(super) const COLOUR: [f32; 3] = [1.0, 0.5, 0.25];

const AHEAD: [f32; 3] = [0.0, 0.0, 1.0];
pub(super) const RADIUS: f32 = 1.0;
/// The paths through a sphere test, each with the centre of a sphere of radius 1 that the ray
/// straight ahead is tested against.
const SPHERES: [(&str, [f32; 3]); 5] = [
    ("two roots", [0.0, 0.0, 4.0]),
    ("miss", [3.0, 0.0, 4.0]),
    ("tangent", [1.0, 0.0, 4.0]),
    ("behind", [0.0, 0.0, -4.0]),
    ("from inside", [0.0, 0.0, 0.5]),
];

/// An upper bound on the components of the rays in `SPHERES` and `TRIANGLES`.
const REACH: [f64; 3] = [1.0; 3];
const FACING: [[f32; 3]; 3] = [[-1.0, -1.0, 4.0], [1.0, -1.0, 4.0], [0.0, 1.0, 4.0]];
const EDGE_ON: [[f32; 3]; 3] = [[-1.0, -1.0, 3.0], [1.0, -1.0, 3.0], [0.0, -1.0, 5.0]];
/// A path through a triangle test, with its ray and the triangle's vertices.
type TriangleCase = (&'static str, [f32; 3], [[f32; 3]; 3]);
const TRIANGLES: [TriangleCase; 6] = [
    ("inside", AHEAD, FACING),
    ("edge", [0.0, -0.25, 1.0], FACING),
    ("outside the first edge", [0.0, -0.5, 1.0], FACING),
    ("outside the last edge", [-0.25, 0.125, 1.0], FACING),
    ("parallel", AHEAD, EDGE_ON),
    ("behind", [0.0, 0.0, -1.0], FACING),
];

const POINT: [f32; 3] = [0.25, -0.5, 2.5];
const NORMAL: [f32; 3] = [0.0, 0.6, -0.8];
/// The paths through shading, each with the position of its light.
const LIGHTS: [(&str, [f32; 3]); 2] = [("lit", [3.0, 5.0, -2.0]), ("turned away", [3.0, -5.0, 8.0])];

/// Four vectors from which every implementation makes its operands: two vectors; or a ray with a
/// sphere's centre or a triangle's vertices; or a point, its normal and a light's position.
pub(super) type Numbers = [[f32; 3]; 4];

/// For each path through an operation a description and the operands; the common path comes first.
fn cases(op: &str) -> Vec<(&'static str, Numbers)> {
    let none = [0.0; 3];
    match op {
        "sphere" => SPHERES.map(|(path, centre)| (path, [AHEAD, centre, none, none])).into(),
        "triangle" => TRIANGLES.map(|(path, ray, [v1, v2, v3])| (path, [ray, v1, v2, v3])).into(),
        "lambert" | "lambert2" => LIGHTS.map(|(path, light)| (path, [POINT, NORMAL, light, none])).into(),
        _ => vec![("any operands", [A, B, none, none])],
    }
}

/// A result from which the first number can be taken.
pub(super) trait First: Copy + Default + 'static {
    fn first(self) -> f32;

    fn bits(self) -> u32 {
        self.first().to_bits()
    }
}

impl First for f32 {
    fn first(self) -> f32 {
        self
    }
}

impl First for Vec4 {
    fn first(self) -> f32 {
        self.x
    }
}

impl First for Lanes {
    fn first(self) -> f32 {
        self[0]
    }
}

impl First for Vec3A {
    fn first(self) -> f32 {
        self.x
    }
}

/// An operation on a packet of f32 whose lanes are all equal.
pub(super) fn packet(op: &str, isa: Isa) -> Result<Subject, String> {
    let ops = packet_ops::<f32>(isa).ok_or_else(|| format!("this CPU does not run {isa}"))?;
    let op = ops.iter().find(|o| o.name == op).ok_or("there is no such operation on packets")?;
    let lanes = op.lanes;
    let spread = |values: [f32; 3]| values.iter().flat_map(|&value| vec![value; lanes]).collect::<Vec<_>>();
    let operands = |[a, b, c, d]: Numbers| match op.name {
        "sphere" => (spread(a), sphere_hit::<f32>(b.map(f64::from), RADIUS.into()).record.numbers()),
        "triangle" => (spread(a), triangle_hit::<f32>([b, c, d].map(|v| v.map(f64::from)), REACH).record.numbers()),
        "lambert" => {
            // The point is relative to the centre of a unit sphere, so that the normal equals the
            // point.
            let [x, y, z] = [0, 1, 2].map(|i| c[i] - a[i] + b[i]);
            let [red, green, blue] = COLOUR;
            (spread(b), ObjectLight { x, y, z, cosine: 0.0, red, green, blue, padding: 0.0 }.numbers())
        }
        _ if op.shape.b_numbers == 1 => (spread(a), vec![SCALAR; lanes]),
        _ => (spread(a), spread(b)[..op.shape.b_numbers * lanes].to_vec()),
    };
    Ok(Subject::new(op.address(), op.name, operands, move |(a, b)| {
        let mut out = [0.0; 3 * MOST_LANES];
        op.call(&mut out[..op.shape.out_numbers * lanes], a, b);
        out[0].bits()
    }))
}

fn vector([x, y, z]: [f32; 3]) -> Vec4 {
    Vec4::new(x, y, z)
}

fn vectors([a, b, ..]: Numbers) -> (Vec4, Vec4) {
    (vector(a), vector(b))
}

fn sphere([ray, centre, ..]: Numbers) -> (Vec4, PaperSphere) {
    let (centre, colour) = (vector(centre), vector(COLOUR));
    (vector(ray), PaperSphere { centre, colour, radius: RADIUS, padding: [0.0; 3] })
}

fn triangle(numbers: Numbers) -> (Vec4, PaperTriangle) {
    let [ray, v1, v2, v3] = numbers.map(vector);
    (ray, PaperTriangle { v1, v2, v3, colour: vector(COLOUR) })
}

fn lambert(numbers: Numbers) -> (Surface, Light) {
    let [point, normal, position, _] = numbers.map(vector);
    (Surface { point, normal, colour: vector(COLOUR) }, Light { position, radiance: vector(COLOUR) })
}

/// A function in NASM.
pub(super) fn assembly(name: &str, kernels: &'static kernels::AosKernels) -> Result<Subject, String> {
    let op = kernels.ops().find(|(n, _)| *n == name).ok_or("there is no such operation")?.1;
    Ok(operation(name, op))
}

/// A subject for a function with the calling convention of those in NASM, for the operation `name`.
pub(super) fn operation(name: &str, op: OpRef) -> Subject {
    fn of<X: Plain, Y: Plain, O: Plain + First>(
        name: &str,
        op: Op<X, Y, O>,
        operands: fn(Numbers) -> (X, Y),
    ) -> Subject {
        Subject::new(op.address(), name, operands, move |(a, b)| op.call(a, b).bits())
    }
    match op {
        OpRef::Vector(op) => of(name, op, vectors),
        OpRef::Scale(op) => of(name, op, |[a, ..]| (vector(a), SCALAR)),
        OpRef::Scalar(op) => of(name, op, vectors),
        OpRef::Sphere(op) => of(name, op, sphere),
        OpRef::Triangle(op) => of(name, op, triangle),
        OpRef::Lambert(op) => of(name, op, lambert),
    }
}

/// A function in C that takes and returns vectors by value. None for an operation that is not
/// written in this way.
pub(super) fn c(op: &str, functions: &'static ByValue) -> Option<Subject> {
    let address = functions.address(op)?;
    let of =
        |f: fn(&ByValue, Vec4, Vec4) -> u32| Subject::new(address, op, vectors, move |(a, b)| f(functions, *a, *b));
    let ray = |direction| Ray { origin: Vec4::ZERO, direction };
    Some(match op {
        "add" => of(|f, a, b| f.add(a, b).bits()),
        "sub" => of(|f, a, b| f.sub(a, b).bits()),
        "scale" => of(|f, a, _| f.scale(a, SCALAR).bits()),
        "dot" => of(|f, a, b| f.dot(a, b).bits()),
        "norm" => of(|f, a, _| f.norm(a).bits()),
        "cross" => of(|f, a, b| f.cross(a, b).bits()),
        "normalise" => of(|f, a, _| f.normalise(a).bits()),
        "sphere" => Subject::new(address, op, sphere, move |(direction, sphere)| {
            let mut t = 0.0;
            u32::from(functions.sphere(ray(*direction), sphere, &mut t)) | t.bits()
        }),
        "triangle" => Subject::new(address, op, triangle, move |(direction, triangle)| {
            let mut t = 0.0;
            u32::from(functions.triangle(ray(*direction), triangle, &mut t)) | t.bits()
        }),
        "lambert" => Subject::new(address, op, lambert, move |(surface, light)| {
            functions.lambert(light, surface.point, surface.normal, surface.colour, false).bits()
        }),
        _ => return None,
    })
}

/// A function in Rust that is not inlined, with the parameters of those in NASM: out, a, b.
pub(super) fn whole<X: 'static, Y: 'static, O: First>(
    op: &str,
    operands: impl Fn(Numbers) -> (X, Y),
    function: fn(&mut O, &X, &Y),
) -> Subject {
    Subject::new(function as usize, op, operands, move |(a, b)| {
        let mut out = O::default();
        black_box(function)(&mut out, a, b);
        out.bits()
    })
}

/// A subject for a function that is timed by `call` with these operands alone.
pub(super) fn of_calls<T: Clone + 'static>(address: usize, operands: T, call: impl Fn(&T) -> u32 + 'static) -> Subject {
    Subject::new(address, "", |_| operands.clone(), call)
}
