//! Every operation and intersection, one group each, with a row per implementation.
//!
//! The rows are C, both forms of the macros, the scalar twin in Rust, and glam where it has the
//! operation.
//!
//! A row runs through 64 inputs, so that nothing can be computed in advance, and writes 64 results:
//! on some CPUs, a single place on the stack that a kernel writes and its caller reads each time
//! costs more than the operation. The kernels' functions are called, not inlined; `rayo ops` tells
//! what operations cost within a kernel. criterion runs the rows one after the other; for reliable
//! ratios use `rayo experiment`, which interleaves its contestants.

use std::hint::black_box;

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3A;
use rayo::internals::kernels::{self, AosKernels, Light, Op, PaperSphere, PaperTriangle, Plain, Surface, Vec4};
use rayo::internals::reference::aos::{self, Form};
use rayo::internals::scene::Rng;

const INPUTS: usize = 64;
const SEED: u64 = 1;

/// The inputs of all operations; about half of the rays hit their objects.
struct Inputs {
    vectors: Vec<Vec4>,
    others: Vec<Vec4>,
    scalars: Vec<f32>,
    rays: Vec<Vec4>,
    spheres: Vec<PaperSphere>,
    triangles: Vec<PaperTriangle>,
    surfaces: Vec<Surface>,
    lights: Vec<Light>,
}

impl Inputs {
    fn new() -> Self {
        let mut rng = Rng::new(SEED);
        let colour = Vec4::new(0.25, 0.5, 1.0);
        let mut point =
            |x: f32, near: f32, far: f32| Vec4::new(rng.between(-x, x), rng.between(-x, x), rng.between(near, far));
        let mut some = |x, near, far| (0..INPUTS).map(|_| point(x, near, far)).collect::<Vec<_>>();
        let (vectors, others) = (some(9.0, -9.0, 9.0), some(9.0, -9.0, 9.0));
        let (rays, centres) = (some(0.3, 1.0, 1.0), some(0.5, 4.0, 6.0));
        let (corners, lamps) = (some(3.0, 4.0, 6.0), some(9.0, -9.0, 0.0));
        let mut unit = Rng::new(SEED);
        Inputs {
            scalars: (0..INPUTS).map(|_| unit.between(-9.0, 9.0)).collect(),
            spheres: centres
                .iter()
                .map(|&centre| PaperSphere { centre, colour, radius: 1.0, padding: [0.0; 3] })
                .collect(),
            triangles: (0..INPUTS)
                .map(|i| {
                    let [v1, v2, v3] = [0, 1, 2].map(|corner| corners[(i + 7 * corner) % INPUTS]);
                    PaperTriangle { v1, v2, v3, colour }
                })
                .collect(),
            surfaces: vectors
                .iter()
                .zip(&others)
                .map(|(v, &point)| {
                    let normal = Vec3A::new(v.x, v.y, v.z).normalize();
                    Surface { point, normal: Vec4::new(normal.x, normal.y, normal.z), colour }
                })
                .collect(),
            lights: lamps.iter().map(|&position| Light { position, radiance: colour }).collect(),
            vectors,
            others,
            rays,
        }
    }
}

/// A row: applies `op` to each pair of inputs and writes the results to memory.
fn row<A, B, O: Default>(
    group: &mut BenchmarkGroup<WallTime>,
    name: &str,
    a: &[A],
    b: &[B],
    op: impl Fn(&mut O, &A, &B),
) {
    let mut results: Vec<_> = a.iter().map(|_| O::default()).collect();
    group.throughput(Throughput::Elements(a.len() as u64));
    group.bench_function(name, |bencher| {
        bencher.iter(|| {
            for ((a, b), out) in black_box(a).iter().zip(black_box(b)).zip(black_box(&mut results)) {
                op(out, a, b);
            }
            black_box(&results);
        });
    });
}

/// A group with a row for each table of kernels that this CPU can run.
fn kernel_rows<A: Plain, B: Plain, O: Plain + Default>(
    group: &mut BenchmarkGroup<WallTime>,
    op: impl Fn(&AosKernels) -> Op<A, B, O>,
    a: &[A],
    b: &[B],
) {
    for (name, kernels) in [("c", kernels::c()), ("paper", kernels::paper()), ("aos", kernels::aos())] {
        if let Some(op) = kernels.map(&op) {
            row(group, name, a, b, |out, a, b| op.call_into(out, a, b));
        }
    }
}

fn glam(v: &Vec4) -> Vec3A {
    Vec3A::from_array([v.x, v.y, v.z])
}

fn operations(c: &mut Criterion) {
    let inputs = Inputs::new();
    let Inputs { vectors, others, scalars, rays, spheres, triangles, surfaces, lights } = &inputs;
    // Convert before timing: glam's vectors stay in its own types between operations, as the
    // kernels' do.
    let (glams, glam_others): (Vec<_>, Vec<_>) =
        (vectors.iter().map(glam).collect(), others.iter().map(glam).collect());
    let form = Form::Paper;

    /// Adds a group `$name` with rows for the kernels with that name, the twin, and glam.
    macro_rules! group {
        ($name:ident, $a:expr, $b:expr, twin $twin:expr $(, glam $glam_a:expr, $glam_b:expr => $glam:expr)?) => {{
            let mut group = c.benchmark_group(stringify!($name));
            kernel_rows(&mut group, |kernels| kernels.$name, $a, $b);
            row(&mut group, "twin", $a, $b, |out, a, b| *out = $twin(a, b));
            $(row(&mut group, "glam", $glam_a, $glam_b, |out, a, b| *out = $glam(a, b));)?
            group.finish();
        }};
    }

    group!(add, vectors, others, twin |a: &Vec4, b: &Vec4| aos::add(a.lanes(), b.lanes()),
        glam &glams, &glam_others => |a: &Vec3A, b: &Vec3A| *a + *b);
    group!(sub, vectors, others, twin |a: &Vec4, b: &Vec4| aos::sub(a.lanes(), b.lanes()),
        glam &glams, &glam_others => |a: &Vec3A, b: &Vec3A| *a - *b);
    group!(scale, vectors, scalars, twin |a: &Vec4, b: &f32| aos::scale(a.lanes(), *b),
        glam &glams, scalars => |a: &Vec3A, b: &f32| *a * *b);
    group!(dot, vectors, others, twin |a: &Vec4, b: &Vec4| aos::dot(form, a.lanes(), b.lanes()),
        glam &glams, &glam_others => |a: &Vec3A, b: &Vec3A| a.dot(*b));
    group!(norm, vectors, others, twin |a: &Vec4, _: &Vec4| aos::norm(form, a.lanes()),
        glam &glams, &glam_others => |a: &Vec3A, _: &Vec3A| a.length());
    group!(cross, vectors, others, twin |a: &Vec4, b: &Vec4| aos::cross(a.lanes(), b.lanes()),
        glam &glams, &glam_others => |a: &Vec3A, b: &Vec3A| a.cross(*b));
    group!(normalise, vectors, others, twin |a: &Vec4, _: &Vec4| aos::normalise(form, a.lanes()),
        glam &glams, &glam_others => |a: &Vec3A, _: &Vec3A| a.normalize());

    let twin = |b: &PaperSphere| aos::Sphere { centre: b.centre.lanes(), colour: b.colour.lanes(), radius: b.radius };
    group!(sphere, rays, spheres, twin |a: &Vec4, b: &PaperSphere| aos::sphere(form, a.lanes(), &twin(b)));
    let twin =
        |b: &PaperTriangle| aos::Triangle { vertices: [b.v1, b.v2, b.v3].map(Vec4::lanes), colour: b.colour.lanes() };
    group!(triangle, rays, triangles, twin |a: &Vec4, b: &PaperTriangle| aos::triangle(form, a.lanes(), &twin(b)));
    let twin = |sides: u32| {
        move |a: &Surface, b: &Light| {
            let surface = aos::Surface { point: a.point.lanes(), normal: a.normal.lanes(), colour: a.colour.lanes() };
            let light = aos::Light { position: b.position.lanes(), radiance: b.radiance.lanes() };
            aos::lambert(form, sides, &surface, &light)
        }
    };
    group!(lambert, surfaces, lights, twin twin(1));
    group!(lambert2, surfaces, lights, twin twin(2));
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .sample_size(30)
        .warm_up_time(std::time::Duration::from_millis(300))
        .measurement_time(std::time::Duration::from_secs(1));
    targets = operations
}
criterion_main!(benches);
