//! What can be run of each implementation: functions with their operands, one set for each path through them.

use std::hint::black_box;
use std::rc::Rc;

use ::glam::Vec3A;

use super::kept;
use crate::kernels::{
    self, ByValue, Isa, Light, ObjectLight, Op, OpRef, Plain, Ray, Sphere, Surface, Triangle, Vec4, by_value,
    packet_ops,
};
use crate::measure::core_cycles;
use crate::plan::{sphere_hit, triangle_hit};
use crate::reference::aos as twin;

/// Calls in a measurement.
const CALLS: u64 = 1000;

/// A function that can be called with operands for each of its paths.
pub struct Subject {
    /// Where its code is.
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
    fn new(address: usize, paths: &[&'static str], call: impl Fn(usize) -> u32 + 'static) -> Self {
        let call = Rc::new(call);
        let cost = Rc::clone(&call);
        Subject {
            address,
            paths: paths.to_vec(),
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

const ANY: &[&str] = &["any operands"];
const A: [f32; 3] = [0.5, -0.75, 1.25];
const B: [f32; 3] = [1.5, 0.625, -0.25];
const SCALAR: f32 = 0.875;
const COLOUR: [f32; 3] = [1.0, 0.5, 0.25];

struct SphereCase {
    path: &'static str,
    centre: [f32; 3],
}

const AHEAD: [f32; 3] = [0.0, 0.0, 1.0];
const RADIUS: f32 = 1.0;
/// Spheres of radius 1 for the ray straight ahead.
const SPHERES: [SphereCase; 5] = [
    SphereCase { path: "two roots", centre: [0.0, 0.0, 4.0] },
    SphereCase { path: "miss", centre: [3.0, 0.0, 4.0] },
    SphereCase { path: "tangent", centre: [1.0, 0.0, 4.0] },
    SphereCase { path: "behind", centre: [0.0, 0.0, -4.0] },
    SphereCase { path: "from inside", centre: [0.0, 0.0, 0.5] },
];

struct TriangleCase {
    path: &'static str,
    ray: [f32; 3],
    vertices: [[f32; 3]; 3],
}

/// No component of a ray of these is larger.
const REACH: [f64; 3] = [1.0; 3];
const FACING: [[f32; 3]; 3] = [[-1.0, -1.0, 4.0], [1.0, -1.0, 4.0], [0.0, 1.0, 4.0]];
const TRIANGLES: [TriangleCase; 6] = [
    TriangleCase { path: "inside", ray: AHEAD, vertices: FACING },
    TriangleCase { path: "edge", ray: [0.0, -0.25, 1.0], vertices: FACING },
    TriangleCase { path: "outside the first edge", ray: [0.0, -0.5, 1.0], vertices: FACING },
    TriangleCase { path: "outside the last edge", ray: [-0.25, 0.125, 1.0], vertices: FACING },
    TriangleCase { path: "parallel", ray: AHEAD, vertices: [[-1.0, -1.0, 3.0], [1.0, -1.0, 3.0], [0.0, -1.0, 5.0]] },
    TriangleCase { path: "behind", ray: [0.0, 0.0, -1.0], vertices: FACING },
];

struct LambertCase {
    path: &'static str,
    light: [f32; 3],
}

const POINT: [f32; 3] = [0.25, -0.5, 2.5];
const NORMAL: [f32; 3] = [0.0, 0.6, -0.8];
const LIGHTS: [LambertCase; 2] = [
    LambertCase { path: "lit", light: [3.0, 5.0, -2.0] },
    LambertCase { path: "turned away", light: [3.0, -5.0, 8.0] },
];

fn vec4([x, y, z]: [f32; 3]) -> Vec4 {
    Vec4::new(x, y, z)
}

fn lanes([x, y, z]: [f32; 3]) -> twin::Lanes<f32> {
    [x, y, z, 0.0]
}

fn spheres() -> Vec<Sphere> {
    let sphere = |case: &SphereCase| Sphere {
        centre: vec4(case.centre),
        colour: vec4(COLOUR),
        radius: RADIUS,
        padding: [0.0; 3],
    };
    SPHERES.iter().map(sphere).collect()
}

fn triangles() -> Vec<(Vec4, Triangle)> {
    let triangle = |case: &TriangleCase| {
        let [v1, v2, v3] = case.vertices.map(vec4);
        (vec4(case.ray), Triangle { v1, v2, v3, colour: vec4(COLOUR) })
    };
    TRIANGLES.iter().map(triangle).collect()
}

fn lights() -> Vec<Light> {
    LIGHTS.iter().map(|case| Light { position: vec4(case.light), radiance: vec4(COLOUR) }).collect()
}

fn sphere_paths() -> Vec<&'static str> {
    SPHERES.iter().map(|case| case.path).collect()
}

fn triangle_paths() -> Vec<&'static str> {
    TRIANGLES.iter().map(|case| case.path).collect()
}

fn lambert_paths() -> Vec<&'static str> {
    LIGHTS.iter().map(|case| case.path).collect()
}

/// The first bits of a result.
trait Bits {
    fn bits(&self) -> u32;
}

impl Bits for f32 {
    fn bits(&self) -> u32 {
        self.to_bits()
    }
}

impl Bits for Vec4 {
    fn bits(&self) -> u32 {
        self.x.to_bits()
    }
}

impl Bits for twin::Lanes<f32> {
    fn bits(&self) -> u32 {
        self[0].to_bits()
    }
}

impl Bits for Vec3A {
    fn bits(&self) -> u32 {
        self.x.to_bits()
    }
}

/// The operation `op` of an implementation, ready to be called; else why there is none, or none that runs here.
pub fn subject(op: &str, implementation: &str) -> Result<Subject, String> {
    match implementation {
        "rust" => Ok(rust(op)),
        "glam" => Ok(glam(op)),
        "paper" => assembly(op, kernels::paper().ok_or("this CPU lacks SSE4.1")?),
        "aos" => assembly(op, kernels::aos().ok_or("this CPU lacks SSE4.1")?),
        _ => match implementation.strip_prefix("c-") {
            Some(level) => {
                let functions = by_value(level).ok_or("this CPU lacks what the compiler was allowed to use")?;
                Ok(c(op, functions))
            }
            None => packet(
                op,
                super::isa(implementation).ok_or_else(|| format!("there is no implementation `{implementation}`"))?,
            ),
        },
    }
}

/// An operation on one packet of f32, all lanes alike.
fn packet(op: &str, isa: Isa) -> Result<Subject, String> {
    let ops = packet_ops::<f32>(isa).ok_or_else(|| format!("this CPU does not run {isa}"))?;
    let op = *ops.iter().find(|o| o.name == op).ok_or("there is no such operation on packets")?;
    let lanes = op.lanes;
    let spread = |values: [f32; 3]| values.iter().flat_map(|&value| vec![value; lanes]).collect::<Vec<_>>();
    let (paths, operands): (_, Vec<_>) = match op.name {
        "sphere" => {
            let record =
                |case: &SphereCase| sphere_hit::<f32>(case.centre.map(f64::from), RADIUS.into()).record.numbers();
            (sphere_paths(), SPHERES.iter().map(|case| (spread(AHEAD), record(case))).collect())
        }
        "triangle" => {
            let record =
                |case: &TriangleCase| triangle_hit::<f32>(case.vertices.map(|v| v.map(f64::from)), REACH).record;
            let operands = |case: &TriangleCase| (spread(case.ray), record(case).numbers());
            (triangle_paths(), TRIANGLES.iter().map(operands).collect())
        }
        "lambert" => {
            // Seen from the centre of a unit sphere, where the normal is the point.
            let [x, y, z] = [0, 1, 2].map(|i| move |light: [f32; 3]| light[i] - POINT[i] + NORMAL[i]);
            let [red, green, blue] = COLOUR;
            let lit = |LambertCase { light, .. }: &LambertCase| {
                let (x, y, z) = (x(*light), y(*light), z(*light));
                ObjectLight { x, y, z, cosine: 0.0, red, green, blue, padding: 0.0 }.numbers()
            };
            (lambert_paths(), LIGHTS.iter().map(|case| (spread(NORMAL), lit(case))).collect())
        }
        _ => {
            let b = match op.shape.b_numbers {
                0 => Vec::new(),
                1 => vec![SCALAR; lanes],
                _ => spread(B),
            };
            (ANY.to_vec(), vec![(spread(A), b)])
        }
    };
    Ok(Subject::new(op.address(), &paths, move |path| {
        let (a, b) = &operands[path];
        let mut out = [0.0; 3 * MOST_LANES];
        op.call(&mut out[..op.shape.out_numbers * lanes], a, b);
        out[0].bits()
    }))
}

fn kernel<A: Plain, B: Plain, O: Plain + Bits>(
    op: Op<A, B, O>,
    paths: &[&'static str],
    operands: Vec<(A, B)>,
) -> Subject {
    Subject::new(op.address(), paths, move |path| {
        let (a, b) = &operands[path];
        op.call(a, b).bits()
    })
}

/// A function in NASM.
fn assembly(name: &str, kernels: &'static kernels::AosKernels) -> Result<Subject, String> {
    let op = kernels.ops().find(|(n, _)| *n == name).ok_or("there is no such operation")?.1;
    Ok(match op {
        OpRef::Vector(op) => kernel(op, ANY, vec![(vec4(A), vec4(B))]),
        OpRef::Scale(op) => kernel(op, ANY, vec![(vec4(A), SCALAR)]),
        OpRef::Scalar(op) => kernel(op, ANY, vec![(vec4(A), vec4(B))]),
        OpRef::Sphere(op) => kernel(op, &sphere_paths(), spheres().into_iter().map(|s| (vec4(AHEAD), s)).collect()),
        OpRef::Triangle(op) => kernel(op, &triangle_paths(), triangles()),
        OpRef::Lambert(op) => {
            let surface = Surface { point: vec4(POINT), normal: vec4(NORMAL), colour: vec4(COLOUR) };
            kernel(op, &lambert_paths(), lights().into_iter().map(|light| (surface, light)).collect())
        }
    })
}

/// A function in C, its vectors by value.
fn c(op: &str, functions: &'static ByValue) -> Subject {
    let address = functions.address(op).expect("the functions are those of the table");
    let vectors = |f: fn(&ByValue, Vec4, Vec4) -> u32| {
        // On the heap: of an array of one the compiler would know which element it is, whatever the result.
        let operands: Box<[_]> = Box::new([(vec4(A), vec4(B))]);
        Subject::new(address, ANY, move |path| {
            let (a, b) = operands[path];
            f(functions, a, b)
        })
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
        "sphere" => {
            let spheres = spheres();
            Subject::new(address, &sphere_paths(), move |path| {
                let mut t = 0.0;
                u32::from(functions.sphere(ray(vec4(AHEAD)), &spheres[path], &mut t)) | t.bits()
            })
        }
        "triangle" => {
            let triangles = triangles();
            Subject::new(address, &triangle_paths(), move |path| {
                let mut t = 0.0;
                let (direction, triangle) = &triangles[path];
                u32::from(functions.triangle(ray(*direction), triangle, &mut t)) | t.bits()
            })
        }
        _ => {
            let lights = lights();
            Subject::new(address, &lambert_paths(), move |path| {
                functions.lambert(&lights[path], vec4(POINT), vec4(NORMAL), vec4(COLOUR), false).bits()
            })
        }
    }
}

/// A function in Rust, kept whole.
fn whole<A: 'static, B: 'static, O: Default + Bits + 'static>(
    function: fn(&mut O, &A, &B),
    paths: &[&'static str],
    operands: Vec<(A, B)>,
) -> Subject {
    Subject::new(function as usize, paths, move |path| {
        let (a, b) = &operands[path];
        let mut out = O::default();
        black_box(function)(&mut out, a, b);
        out.bits()
    })
}

fn rust(op: &str) -> Subject {
    use kept::rust;
    let (a, b) = (lanes(A), lanes(B));
    let colour = lanes(COLOUR);
    match op {
        "add" => whole(rust::add, ANY, vec![(a, b)]),
        "sub" => whole(rust::sub, ANY, vec![(a, b)]),
        "scale" => whole(rust::scale, ANY, vec![(a, SCALAR)]),
        "dot" => whole(rust::dot, ANY, vec![(a, b)]),
        "norm" => whole(rust::norm, ANY, vec![(a, b)]),
        "cross" => whole(rust::cross, ANY, vec![(a, b)]),
        "normalise" => whole(rust::normalise, ANY, vec![(a, b)]),
        "sphere" => {
            let sphere = |case: &SphereCase| twin::Sphere { centre: lanes(case.centre), colour, radius: RADIUS };
            whole(rust::sphere, &sphere_paths(), SPHERES.iter().map(|case| (lanes(AHEAD), sphere(case))).collect())
        }
        "triangle" => {
            let triangle = |case: &TriangleCase| twin::Triangle { vertices: case.vertices.map(lanes), colour };
            let operands = TRIANGLES.iter().map(|case| (lanes(case.ray), triangle(case)));
            whole(rust::triangle, &triangle_paths(), operands.collect())
        }
        _ => {
            let surface = twin::Surface { point: lanes(POINT), normal: lanes(NORMAL), colour };
            let light = |case: &LambertCase| twin::Light { position: lanes(case.light), radiance: colour };
            whole(rust::lambert, &lambert_paths(), LIGHTS.iter().map(|case| (surface, light(case))).collect())
        }
    }
}

fn glam(op: &str) -> Subject {
    use kept::glam;
    let (a, b) = (Vec3A::from(A), Vec3A::from(B));
    match op {
        "add" => whole(glam::add, ANY, vec![(a, b)]),
        "sub" => whole(glam::sub, ANY, vec![(a, b)]),
        "scale" => whole(glam::scale, ANY, vec![(a, SCALAR)]),
        "dot" => whole(glam::dot, ANY, vec![(a, b)]),
        "norm" => whole(glam::norm, ANY, vec![(a, b)]),
        "cross" => whole(glam::cross, ANY, vec![(a, b)]),
        "normalise" => whole(glam::normalise, ANY, vec![(a, b)]),
        "sphere" => {
            let sphere = |case: &SphereCase| glam::Sphere { centre: case.centre.into(), radius: RADIUS };
            whole(glam::sphere, &sphere_paths(), SPHERES.iter().map(|case| (AHEAD.into(), sphere(case))).collect())
        }
        "triangle" => {
            let operands = TRIANGLES.iter().map(|case| (case.ray.into(), case.vertices.map(Vec3A::from)));
            whole(glam::triangle, &triangle_paths(), operands.collect())
        }
        _ => {
            let operand = |case: &LambertCase| {
                let surface = glam::Surface { point: POINT.into(), normal: NORMAL.into(), colour: COLOUR.into() };
                (surface, glam::Light { position: case.light.into(), radiance: COLOUR.into() })
            };
            whole(glam::lambert, &lambert_paths(), LIGHTS.iter().map(operand).collect())
        }
    }
}
