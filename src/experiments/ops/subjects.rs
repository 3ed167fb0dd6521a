//! What can be run of each implementation: functions with their operands, one set for each path through them.

use std::hint::black_box;
use std::rc::Rc;

use ::glam::Vec3A;

use crate::kernels::{
    self, ByValue, Isa, Light, ObjectLight, Op, OpRef, PaperSphere, PaperTriangle, Plain, Ray, Surface, Vec4,
    packet_ops,
};
use crate::measure::core_cycles;
use crate::plan::{sphere_hit, triangle_hit};
use crate::reference::aos::Lanes;

/// Calls in a measurement.
const CALLS: u64 = 1000;

/// A function that can be called with operands for each of its paths.
pub struct Subject {
    pub address: usize,
    /// What the operands of each path are; the first is the common one.
    pub paths: Vec<&'static str>,
    /// Calls it once with the operands of a path, and gives some bits of the result.
    pub run: Box<dyn Fn(usize) -> u32>,
    /// Core cycles of a call on the first path: from result to result, and among independent calls; None where none can be
    /// right.
    pub cost: Box<dyn Fn() -> [Option<f64>; 2]>,
}

impl Subject {
    /// Of a function that computes `op`, with operands for each path. They are on the heap: of an array of one the compiler
    /// would know which element it is, whatever the result.
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
        Subject {
            address,
            paths,
            run: Box::new(move |path| call(path)),
            cost: Box::new(move || {
                // The compiler must not know that a result selects the first operands whatever it is.
                let nothing = black_box(0);
                let latency = core_cycles(super::REPEATS, super::LEAST_CYCLES, || {
                    let mut bits = 0;
                    for _ in 0..CALLS {
                        bits = cost((bits & nothing) as usize);
                    }
                    black_box(bits);
                    CALLS
                });
                let throughput = core_cycles(super::REPEATS, super::LEAST_CYCLES, || {
                    for _ in 0..CALLS {
                        black_box(cost(nothing as usize));
                    }
                    CALLS
                });
                [latency, throughput]
            }),
        }
    }
}

/// Vectors in the largest packet.
const MOST_LANES: usize = 16;

const A: [f32; 3] = [0.5, -0.75, 1.25];
const B: [f32; 3] = [1.5, 0.625, -0.25];
pub(super) const SCALAR: f32 = 0.875;
pub(super) const COLOUR: [f32; 3] = [1.0, 0.5, 0.25];

const AHEAD: [f32; 3] = [0.0, 0.0, 1.0];
pub(super) const RADIUS: f32 = 1.0;
/// Paths, and the centres of spheres of radius 1 for the ray straight ahead.
const SPHERES: [(&str, [f32; 3]); 5] = [
    ("two roots", [0.0, 0.0, 4.0]),
    ("miss", [3.0, 0.0, 4.0]),
    ("tangent", [1.0, 0.0, 4.0]),
    ("behind", [0.0, 0.0, -4.0]),
    ("from inside", [0.0, 0.0, 0.5]),
];

/// No component of a ray of these is larger.
const REACH: [f64; 3] = [1.0; 3];
const FACING: [[f32; 3]; 3] = [[-1.0, -1.0, 4.0], [1.0, -1.0, 4.0], [0.0, 1.0, 4.0]];
const EDGE_ON: [[f32; 3]; 3] = [[-1.0, -1.0, 3.0], [1.0, -1.0, 3.0], [0.0, -1.0, 5.0]];
/// Paths, rays, and the vertices of triangles.
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
/// Paths, and where lights stand that shine on the surface with this normal there.
const LIGHTS: [(&str, [f32; 3]); 2] = [("lit", [3.0, 5.0, -2.0]), ("turned away", [3.0, -5.0, 8.0])];

/// What an implementation makes its operands of: two vectors; a ray, and a sphere's centre or a triangle's vertices; a point, its
/// normal, and the place of a light.
pub(super) type Numbers = [[f32; 3]; 4];

/// The operands for each path through an operation, the common one first, and what they are.
fn cases(op: &str) -> Vec<(&'static str, Numbers)> {
    let none = [0.0; 3];
    match op {
        "sphere" => SPHERES.map(|(path, centre)| (path, [AHEAD, centre, none, none])).into(),
        "triangle" => TRIANGLES.map(|(path, ray, [v1, v2, v3])| (path, [ray, v1, v2, v3])).into(),
        "lambert" => LIGHTS.map(|(path, light)| (path, [POINT, NORMAL, light, none])).into(),
        _ => vec![("any operands", [A, B, none, none])],
    }
}

/// The first number of a result.
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

/// An operation on one packet of f32, all lanes alike.
pub(super) fn packet(op: &str, isa: Isa) -> Result<Subject, String> {
    let ops = packet_ops::<f32>(isa).ok_or_else(|| format!("this CPU does not run {isa}"))?;
    let op = ops.iter().find(|o| o.name == op).ok_or("there is no such operation on packets")?;
    let lanes = op.lanes;
    let spread = |values: [f32; 3]| values.iter().flat_map(|&value| vec![value; lanes]).collect::<Vec<_>>();
    let operands = |[a, b, c, d]: Numbers| match op.name {
        "sphere" => (spread(a), sphere_hit::<f32>(b.map(f64::from), RADIUS.into()).record.numbers()),
        "triangle" => (spread(a), triangle_hit::<f32>([b, c, d].map(|v| v.map(f64::from)), REACH).record.numbers()),
        "lambert" => {
            // Seen from the centre of a unit sphere, where the normal is the point.
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
    fn of<X: Plain, Y: Plain, O: Plain + First>(
        name: &str,
        op: Op<X, Y, O>,
        operands: fn(Numbers) -> (X, Y),
    ) -> Subject {
        Subject::new(op.address(), name, operands, move |(a, b)| op.call(a, b).bits())
    }
    let op = kernels.ops().find(|(n, _)| *n == name).ok_or("there is no such operation")?.1;
    Ok(match op {
        OpRef::Vector(op) => of(name, op, vectors),
        OpRef::Scale(op) => of(name, op, |[a, ..]| (vector(a), SCALAR)),
        OpRef::Scalar(op) => of(name, op, vectors),
        OpRef::Sphere(op) => of(name, op, sphere),
        OpRef::Triangle(op) => of(name, op, triangle),
        OpRef::Lambert(op) => of(name, op, lambert),
    })
}

/// A function in C, its vectors by value.
pub(super) fn c(op: &str, functions: &'static ByValue) -> Subject {
    let address = functions.address(op).expect("the functions are those of the table");
    let of =
        |f: fn(&ByValue, Vec4, Vec4) -> u32| Subject::new(address, op, vectors, move |(a, b)| f(functions, *a, *b));
    let ray = |direction| Ray { origin: Vec4::ZERO, direction };
    match op {
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
        _ => Subject::new(address, op, lambert, move |(surface, light)| {
            functions.lambert(light, surface.point, surface.normal, surface.colour, false).bits()
        }),
    }
}

/// A function in Rust, kept whole, with the signature of those in NASM: out, a, b.
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
