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
use crate::reference::aos as twin;

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
    /// Of a function with operands for each path. They are on the heap: of an array of one the compiler would know which
    /// element it is, whatever the result.
    fn new<T: 'static>(address: usize, cases: Vec<(&'static str, T)>, call: impl Fn(&T) -> u32 + 'static) -> Self {
        let (paths, operands): (Vec<_>, Vec<_>) = cases.into_iter().unzip();
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
const SCALAR: f32 = 0.875;
const COLOUR: [f32; 3] = [1.0, 0.5, 0.25];

const AHEAD: [f32; 3] = [0.0, 0.0, 1.0];
const RADIUS: f32 = 1.0;
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

/// A vector of an implementation, or what a vector is scaled by.
pub(super) trait Value: Copy + Default + 'static {
    fn of(vector: [f32; 3]) -> Self;

    /// The first bits of a result.
    fn bits(self) -> u32;
}

/// Each kind of vector: how it is made of three floats, and its first.
macro_rules! values {
    ($($value:ty: |$vector:pat_param| $made:expr, $first:expr;)*) => {
        $(impl Value for $value {
            fn of($vector: [f32; 3]) -> Self {
                $made
            }

            fn bits(self) -> u32 {
                let first: fn(Self) -> f32 = $first;
                first(self).to_bits()
            }
        })*
    };
}

values! {
    f32: |_| SCALAR, |scalar| scalar;
    Vec4: |[x, y, z]| Vec4::new(x, y, z), |vector| vector.x;
    twin::Lanes: |[x, y, z]| [x, y, z, 0.0], |vector| vector[0];
    Vec3A: |vector| vector.into(), |vector| vector.x;
}

/// The operands of an operation: a set for each of its paths, the common one first, and what they are.
pub(super) trait Operands: Sized + 'static {
    fn paths() -> Vec<(&'static str, Self)>;
}

impl<X: Value, Y: Value> Operands for (X, Y) {
    fn paths() -> Vec<(&'static str, Self)> {
        vec![("any operands", (X::of(A), Y::of(B)))]
    }
}

/// The operands of an implementation whose vectors are `$vector`: a sphere by its centre, a triangle by its vertices, and a
/// surface with a light by their places, the normal and the colour.
macro_rules! operands {
    ($vector:ty, $sphere:ty, $triangle:ty, $surface:ty, $light:ty;
     $of_centre:expr, $of_vertices:expr, $of_point:expr, $of_position:expr) => {
        impl Operands for ($vector, $sphere) {
            fn paths() -> Vec<(&'static str, Self)> {
                let sphere: fn($vector) -> $sphere = $of_centre;
                SPHERES.iter().map(|(path, centre)| (*path, (Value::of(AHEAD), sphere(Value::of(*centre))))).collect()
            }
        }

        impl Operands for ($vector, $triangle) {
            fn paths() -> Vec<(&'static str, Self)> {
                let triangle: fn([$vector; 3]) -> $triangle = $of_vertices;
                let operands = |vertices: [[f32; 3]; 3]| triangle(vertices.map(Value::of));
                TRIANGLES.map(|(path, ray, vertices)| (path, (Value::of(ray), operands(vertices)))).into()
            }
        }

        impl Operands for ($surface, $light) {
            fn paths() -> Vec<(&'static str, Self)> {
                let (surface, light): (fn($vector, $vector) -> $surface, fn($vector) -> $light) =
                    ($of_point, $of_position);
                let operands = |at| (surface(Value::of(POINT), Value::of(NORMAL)), light(Value::of(at)));
                LIGHTS.map(|(path, at)| (path, operands(at))).into()
            }
        }
    };
}

operands! {
    Vec4, PaperSphere, PaperTriangle, Surface, Light;
    |centre| PaperSphere { centre, colour: Value::of(COLOUR), radius: RADIUS, padding: [0.0; 3] },
    |[v1, v2, v3]| PaperTriangle { v1, v2, v3, colour: Value::of(COLOUR) },
    |point, normal| Surface { point, normal, colour: Value::of(COLOUR) },
    |position| Light { position, radiance: Value::of(COLOUR) }
}

operands! {
    twin::Lanes, twin::Sphere, twin::Triangle, twin::Surface, twin::Light;
    |centre| twin::Sphere { centre, colour: Value::of(COLOUR), radius: RADIUS },
    |vertices| twin::Triangle { vertices, colour: Value::of(COLOUR) },
    |point, normal| twin::Surface { point, normal, colour: Value::of(COLOUR) },
    |position| twin::Light { position, radiance: Value::of(COLOUR) }
}

operands! {
    Vec3A, (Vec3A, f32), [Vec3A; 3], [Vec3A; 3], [Vec3A; 2];
    |centre| (centre, RADIUS),
    |vertices| vertices,
    |point, normal| [point, normal, Value::of(COLOUR)],
    |position| [position, Value::of(COLOUR)]
}

/// An operation on one packet of f32, all lanes alike.
pub(super) fn packet(op: &str, isa: Isa) -> Result<Subject, String> {
    let ops = packet_ops::<f32>(isa).ok_or_else(|| format!("this CPU does not run {isa}"))?;
    let op = ops.iter().find(|o| o.name == op).ok_or("there is no such operation on packets")?;
    let lanes = op.lanes;
    let spread = |values: [f32; 3]| values.iter().flat_map(|&value| vec![value; lanes]).collect::<Vec<_>>();
    let cases: Vec<_> = match op.name {
        "sphere" => {
            let record = |centre: [f32; 3]| sphere_hit::<f32>(centre.map(f64::from), RADIUS.into()).record.numbers();
            SPHERES.map(|(path, centre)| (path, (spread(AHEAD), record(centre)))).into()
        }
        "triangle" => {
            let record =
                |vertices: [[f32; 3]; 3]| triangle_hit::<f32>(vertices.map(|v| v.map(f64::from)), REACH).record;
            TRIANGLES.map(|(path, ray, vertices)| (path, (spread(ray), record(vertices).numbers()))).into()
        }
        "lambert" => {
            // Seen from the centre of a unit sphere, where the normal is the point.
            let [red, green, blue] = COLOUR;
            let lit = |light: [f32; 3]| {
                let [x, y, z] = [0, 1, 2].map(|i| light[i] - POINT[i] + NORMAL[i]);
                ObjectLight { x, y, z, cosine: 0.0, red, green, blue, padding: 0.0 }.numbers()
            };
            LIGHTS.map(|(path, light)| (path, (spread(NORMAL), lit(light)))).into()
        }
        _ => {
            let b = match op.shape.b_numbers {
                0 => Vec::new(),
                1 => vec![SCALAR; lanes],
                _ => spread(B),
            };
            vec![("any operands", (spread(A), b))]
        }
    };
    Ok(Subject::new(op.address(), cases, move |(a, b)| {
        let mut out = [0.0; 3 * MOST_LANES];
        op.call(&mut out[..op.shape.out_numbers * lanes], a, b);
        out[0].bits()
    }))
}

fn kernel<X: Plain, Y: Plain, O: Plain + Value>(op: Op<X, Y, O>) -> Subject
where
    (X, Y): Operands,
{
    Subject::new(op.address(), Operands::paths(), move |(a, b)| op.call(a, b).bits())
}

/// A function in NASM.
pub(super) fn assembly(name: &str, kernels: &'static kernels::AosKernels) -> Result<Subject, String> {
    let op = kernels.ops().find(|(n, _)| *n == name).ok_or("there is no such operation")?.1;
    Ok(match op {
        OpRef::Vector(op) => kernel(op),
        OpRef::Scale(op) => kernel(op),
        OpRef::Scalar(op) => kernel(op),
        OpRef::Sphere(op) => kernel(op),
        OpRef::Triangle(op) => kernel(op),
        OpRef::Lambert(op) => kernel(op),
    })
}

/// A function in C, its vectors by value.
pub(super) fn c(op: &str, functions: &'static ByValue) -> Subject {
    let address = functions.address(op).expect("the functions are those of the table");
    let vectors = |f: fn(&ByValue, Vec4, Vec4) -> u32| {
        Subject::new(address, Operands::paths(), move |(a, b): &(Vec4, Vec4)| f(functions, *a, *b))
    };
    let ray = |direction| Ray { origin: Vec4::ZERO, direction };
    match op {
        "add" => vectors(|f, a, b| f.add(a, b).bits()),
        "sub" => vectors(|f, a, b| f.sub(a, b).bits()),
        "scale" => vectors(|f, a, _| f.scale(a, SCALAR).bits()),
        "dot" => vectors(|f, a, b| f.dot(a, b).bits()),
        "norm" => vectors(|f, a, _| f.norm(a).bits()),
        "cross" => vectors(|f, a, b| f.cross(a, b).bits()),
        "normalise" => vectors(|f, a, _| f.normalise(a).bits()),
        "sphere" => Subject::new(address, Operands::paths(), move |(direction, sphere): &(Vec4, PaperSphere)| {
            let mut t = 0.0;
            u32::from(functions.sphere(ray(*direction), sphere, &mut t)) | t.bits()
        }),
        "triangle" => Subject::new(address, Operands::paths(), move |(direction, triangle): &(Vec4, PaperTriangle)| {
            let mut t = 0.0;
            u32::from(functions.triangle(ray(*direction), triangle, &mut t)) | t.bits()
        }),
        _ => Subject::new(address, Operands::paths(), move |(surface, light): &(Surface, Light)| {
            functions.lambert(light, surface.point, surface.normal, surface.colour, false).bits()
        }),
    }
}

/// A function in Rust, kept whole.
pub(super) fn whole<X, Y, O: Value>(function: fn(&mut O, &X, &Y)) -> Subject
where
    (X, Y): Operands,
{
    Subject::new(function as usize, Operands::paths(), move |(a, b): &(X, Y)| {
        let mut out = O::default();
        black_box(function)(&mut out, a, b);
        out.bits()
    })
}
