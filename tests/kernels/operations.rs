//! Every operation, tracer and packet kernel against its scalar twin, to the last bit.
//!
//! All of them use + - x / and roots alone, correctly rounded, in an order that the twin follows, so that there is one
//! right answer; only where packets take estimates there is none. The payload of a NaN is left open: any NaN equals any
//! NaN.

mod by_estimates;
mod on_packets;

use std::ops::Range;

use crate::kernel_cases::{self, Input, Numbers, choose, implementations, packet_kernels, seed};
use rayo::kernels::{
    Bodies, Element, Frame, InRow, InsideSpan, Isa, LIT_ROWS, Light, LitRow, LitRows, LitSphere, NearSpan, ObjectLight,
    Objects, OpRef, OutsideSpan, Planes, Rgb8, Rgba8, Row, Shade, ShadeRows, SpanKernels, Sphere, Trace, Triangle,
    TriangleSpan, Vec4,
};
use rayo::plan::{Keep, Omission, Packed, Scale, ShortForm, Spans, UseRecord};
use rayo::reference::aos::{self, Form, Lanes};
use rayo::reference::packet::{self, Cosine, Exact, Linear, Rounding};
use rayo::reference::{Real, paper_c};
use rayo::scene::{Camera, Rng, Scene, many};

/// What an implementation must equal.
#[derive(Clone, Copy, Debug)]
enum Twin {
    /// `reference::aos`.
    Macros(Form),
    /// `reference::paper_c`, which says why C equals it to the last bit though it calls `pow`.
    C,
}

impl Twin {
    fn of(implementation: &str) -> Twin {
        match implementation {
            "c" => Twin::C,
            "paper" => Twin::Macros(Form::Paper),
            "aos" => Twin::Macros(Form::Best),
            _ => panic!("the kernels of `{implementation}` need a twin"),
        }
    }

    /// What the operation `name` makes of `input`, a scalar in the first lane.
    fn op(self, name: &str, input: &Input) -> Lanes<f32> {
        let scalar = |x| [x, 0.0, 0.0, 0.0];
        match (name, *input) {
            ("add", Input::Vectors(a, b)) => aos::add(a.lanes(), b.lanes()),
            ("sub", Input::Vectors(a, b)) => aos::sub(a.lanes(), b.lanes()),
            ("scale", Input::Scale(a, b)) => aos::scale(a.lanes(), b),
            ("dot", Input::Vectors(a, b)) => scalar(match self {
                Twin::Macros(form) => aos::dot(form, a.lanes(), b.lanes()),
                Twin::C => paper_c::dot(a.lanes(), b.lanes()),
            }),
            ("norm", Input::Vectors(a, _)) => scalar(match self {
                Twin::Macros(form) => aos::norm(form, a.lanes()),
                Twin::C => paper_c::norm(a.lanes()),
            }),
            ("cross", Input::Vectors(a, b)) => match self {
                Twin::Macros(_) => aos::cross(a.lanes(), b.lanes()),
                Twin::C => paper_c::cross(a.lanes(), b.lanes()),
            },
            ("normalise", Input::Vectors(a, _)) => match self {
                Twin::Macros(form) => aos::normalise(form, a.lanes()),
                Twin::C => paper_c::normalise(a.lanes()),
            },
            ("sphere", Input::Sphere(a, b)) => scalar(match self {
                Twin::Macros(form) => aos::sphere(form, a.lanes(), &twin_of_sphere(&b)),
                Twin::C => paper_c::sphere(a.lanes(), &twin_of_sphere(&b)),
            }),
            ("triangle", Input::Triangle(a, b)) => scalar(match self {
                Twin::Macros(form) => aos::triangle(form, a.lanes(), &twin_of_triangle(&b)),
                Twin::C => paper_c::triangle(a.lanes(), &twin_of_triangle(&b)),
            }),
            ("lambert" | "lambert2", Input::Lambert(a, b)) => {
                let sides = if name == "lambert" { 1 } else { 2 };
                let surface =
                    aos::Surface { point: a.point.lanes(), normal: a.normal.lanes(), colour: a.colour.lanes() };
                match self {
                    // The macro adds to what there is: here to 0, which makes a -0 a 0.
                    Twin::Macros(form) => aos::add([0.0; 4], aos::lambert(form, sides, &surface, &twin_of_light(&b))),
                    Twin::C => paper_c::lambert(sides, &surface, &twin_of_light(&b)),
                }
            }
            _ => panic!("the operation `{name}` needs a twin for {input:?}"),
        }
    }

    /// The pixels of `rows`.
    fn trace(self, frame: &Frame, objects: Objects<'_>, rows: Range<u32>) -> Vec<Lanes<f32>> {
        let lights: Vec<_> = objects.lights.iter().map(twin_of_light).collect();
        let spheres: Vec<_> = objects.spheres.iter().map(twin_of_sphere).collect();
        let triangles: Vec<_> = objects.triangles.iter().map(twin_of_triangle).collect();
        let pixels = rows.flat_map(|row| (0..frame.width).map(move |col| (row, col)));
        let pixel = |(row, col)| {
            let centre = |i: f32| frame.step * (i + 0.5);
            let (x, y) = (centre(col as f32) - frame.half_width, frame.half_height - centre(row as f32));
            let ray = [x, y, frame.focal, 0.0];
            match self {
                Twin::Macros(form) => aos::trace(form, ray, &lights, &spheres, &triangles),
                Twin::C => paper_c::trace(ray, &lights, &spheres, &triangles),
            }
        };
        pixels.map(pixel).collect()
    }
}

fn twin_of_light(light: &Light) -> aos::Light<f32> {
    aos::Light { position: light.position.lanes(), radiance: light.radiance.lanes() }
}

fn twin_of_sphere(sphere: &Sphere) -> aos::Sphere<f32> {
    aos::Sphere { centre: sphere.centre.lanes(), colour: sphere.colour.lanes(), radius: sphere.radius }
}

fn twin_of_triangle(triangle: &Triangle) -> aos::Triangle<f32> {
    let vertices = [triangle.v1, triangle.v2, triangle.v3].map(Vec4::lanes);
    aos::Triangle { vertices, colour: triangle.colour.lanes() }
}

/// Whether two results are the same number, with its sign, or both are NaN.
fn same(a: Lanes<f32>, b: Lanes<f32>) -> bool {
    a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan())
}

fn call(op: OpRef, input: &Input) -> Lanes<f32> {
    kernel_cases::call(op, input).0.lanes()
}

/// Cases of each source of numbers, with and without a w of its own.
const CASES: u32 = 5_000;

#[test]
fn every_operation_equals_its_twin_to_the_last_bit() {
    let seed = seed();
    for (implementation, kernels) in implementations() {
        let twin = Twin::of(implementation);
        for (name, op) in kernels.ops() {
            let mut rng = Rng::new(seed);
            let check = |what: String, input: Input| {
                let (found, expected) = (call(op, &input), twin.op(name, &input));
                assert!(
                    same(found, expected),
                    "{implementation} {name}, {what}: {found:?} instead of {expected:?} for {input:?}"
                );
            };
            for (numbers, any_w) in Numbers::ALL.iter().flat_map(|numbers| [(*numbers, false), (*numbers, true)]) {
                for case in 0..CASES {
                    let input = Input::random(op, numbers, any_w, &mut rng);
                    check(format!("case {case} of {numbers:?}"), input);
                }
            }
            for case in 0..4 * CASES {
                check(format!("aimed case {case}"), Input::aimed(op, &mut rng));
            }
        }
    }
}

#[test]
fn aimed_rays_hit_and_miss_from_outside_and_from_inside() {
    let mut rng = Rng::new(seed());
    for (implementation, kernels) in implementations() {
        for (name, op) in kernels.ops().filter(|(name, _)| ["sphere", "triangle"].contains(name)) {
            let (mut hits, mut inside) = (0, 0);
            for _ in 0..CASES {
                let input = Input::aimed(op, &mut rng);
                hits += u32::from(call(op, &input)[0].is_finite());
                if let Input::Sphere(_, Sphere { centre: c, radius: r, .. }) = input {
                    inside += u32::from(c.x * c.x + c.y * c.y + c.z * c.z < r * r);
                }
            }
            let some = CASES / 10..CASES * 9 / 10;
            assert!(some.contains(&hits), "{implementation} {name}: {hits} hits of {CASES}");
            assert!(name == "triangle" || some.contains(&inside), "{implementation}: {inside} of {CASES} from inside");
        }
    }
}

const MISS: f32 = f32::INFINITY;

type Point = [f32; 3];

/// Each way through the sphere code: ray, centre, radius and the t that is exact in any order of operations.
const SPHERES: [(&str, Point, Point, f32, f32); 15] = [
    ("two roots, the near wall", [0.0, 0.0, 1.0], [0.0, 0.0, 10.0], 3.0, 7.0),
    ("a ray that is not of length 1", [0.0, 0.0, 2.0], [0.0, 0.0, 10.0], 3.0, 3.5),
    ("a slanting ray", [1.0, 1.0, 1.0], [4.0, 4.0, 4.0], 4.0, 4.0 - 2.309_401),
    ("tangent, one root", [0.0, 0.0, 1.0], [3.0, 0.0, 10.0], 3.0, 10.0),
    ("past it, no root", [0.0, 0.0, 1.0], [4.0, 0.0, 10.0], 3.0, MISS),
    ("behind, both roots negative", [0.0, 0.0, 1.0], [0.0, 0.0, -10.0], 3.0, MISS),
    ("tangent behind", [0.0, 0.0, 1.0], [3.0, 0.0, -10.0], 3.0, MISS),
    ("from the centre", [0.0, 0.0, 1.0], [0.0, 0.0, 0.0], 3.0, 3.0),
    ("from inside, the far wall", [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], 3.0, 4.0),
    ("from inside, the centre behind", [0.0, 0.0, 1.0], [0.0, 0.0, -1.0], 3.0, 2.0),
    ("on the near wall: t = 0 is no hit, the far wall is", [0.0, 0.0, 1.0], [0.0, 0.0, 3.0], 3.0, 6.0),
    ("on the far wall, outward", [0.0, 0.0, 1.0], [0.0, 0.0, -3.0], 3.0, MISS),
    ("a ray without direction", [0.0, 0.0, 0.0], [0.0, 0.0, 10.0], 3.0, MISS),
    ("a centre that is no number", [0.0, 0.0, 1.0], [f32::NAN, 0.0, 10.0], 3.0, MISS),
    ("a centre at infinity", [0.0, 0.0, 1.0], [0.0, 0.0, f32::INFINITY], 3.0, MISS),
];

#[test]
fn a_sphere_is_hit_on_each_path_as_worked_out_by_hand() {
    for (implementation, kernels) in implementations() {
        for (path, ray, centre, radius, t) in SPHERES {
            let found = kernels.sphere.call(&vector(ray), &kernel_cases::sphere(vector(centre), radius));
            // The one t that is not exact has a root of 16/3 in it.
            let close = path == "a slanting ray" && (found - t).abs() < 1e-6;
            assert!(found == t || close, "{implementation}, {path}: {found} instead of {t}");
        }
    }
}

const CORNERS: [Point; 3] = [[0.0, 0.0, 4.0], [4.0, 0.0, 4.0], [0.0, 4.0, 4.0]];

/// Each way through the triangle code: ray, vertices, t.
const TRIANGLES: [(&str, Point, [Point; 3], f32); 17] = [
    ("inside", [1.0, 1.0, 4.0], CORNERS, 1.0),
    ("inside, a longer ray", [2.0, 2.0, 8.0], CORNERS, 0.5),
    ("on the edge v1v2", [2.0, 0.0, 4.0], CORNERS, 1.0),
    ("on the edge v2v3", [2.0, 2.0, 4.0], CORNERS, 1.0),
    ("on the edge v3v1", [0.0, 2.0, 4.0], CORNERS, 1.0),
    ("at v1", [0.0, 0.0, 4.0], CORNERS, 1.0),
    ("at v2", [4.0, 0.0, 4.0], CORNERS, 1.0),
    ("at v3", [0.0, 4.0, 4.0], CORNERS, 1.0),
    ("beyond the edge v1v2", [1.0, -0.25, 4.0], CORNERS, MISS),
    ("beyond the edge v2v3", [2.25, 2.0, 4.0], CORNERS, MISS),
    ("beyond the edge v3v1", [-0.25, 1.0, 4.0], CORNERS, MISS),
    ("beyond v2, on the line of an edge", [5.0, 0.0, 4.0], CORNERS, MISS),
    ("behind", [-1.0, -1.0, -4.0], CORNERS, MISS),
    ("parallel to the plane", [1.0, 0.0, 0.0], CORNERS, MISS),
    ("in a plane through the camera", [1.0, 0.0, 4.0], [[0.0, 0.0, 4.0], [4.0, 0.0, 4.0], [4.0, 0.0, 8.0]], MISS),
    ("of no area", [1.0, 1.0, 4.0], [[0.0, 0.0, 4.0], [1.0, 1.0, 4.0], [2.0, 2.0, 4.0]], MISS),
    ("with a vertex that is no number", [1.0, 1.0, 4.0], [[f32::NAN, 0.0, 4.0], CORNERS[1], CORNERS[2]], MISS),
];

#[test]
fn a_triangle_is_hit_on_each_path_as_worked_out_by_hand_in_any_order_of_its_vertices() {
    for (implementation, kernels) in implementations() {
        for (path, ray, [a, b, c], t) in TRIANGLES {
            for vertices in [[a, b, c], [b, c, a], [c, a, b], [c, b, a], [b, a, c], [a, c, b]] {
                let found = kernels.triangle.call(&vector(ray), &kernel_cases::triangle(vertices.map(vector)));
                assert_eq!(found, t, "{implementation}, {path}, {vertices:?}");
            }
        }
    }
}

#[test]
fn a_light_in_front_of_behind_and_on_a_surface_gives_what_eq_11_says() {
    let surface = rayo::kernels::Surface {
        point: Vec4::new(1.0, 2.0, 3.0),
        normal: Vec4::new(0.0, 0.0, -1.0),
        colour: Vec4::new(0.5, 0.25, 1.0),
    };
    for (implementation, kernels) in implementations() {
        for (place, position, one_side, two_sides) in [
            ("in front", [1.0, 2.0, -1.0], 1.0, 1.0),
            ("behind", [1.0, 2.0, 9.0], 0.0, 1.0),
            ("beside", [7.0, 2.0, 3.0], 0.0, 0.0),
            ("on it", [1.0, 2.0, 3.0], 0.0, 0.0),
        ] {
            let light = Light { position: vector(position), radiance: Vec4::new(2.0, 4.0, 8.0) };
            for (op, cosine) in [(kernels.lambert, one_side), (kernels.lambert2, two_sides)] {
                let expected = Vec4::new(1.0 * cosine, 1.0 * cosine, 8.0 * cosine);
                assert_eq!(op.call(&surface, &light), expected, "{implementation}, a light {place}");
            }
        }
    }
}

fn vector([x, y, z]: [f32; 3]) -> Vec4 {
    Vec4::new(x, y, z)
}

/// Lights, spheres and triangles of a scene.
#[derive(Clone, Debug, Default)]
struct Lot {
    lights: Vec<Light>,
    spheres: Vec<Sphere>,
    triangles: Vec<Triangle>,
}

impl Lot {
    fn objects(&self) -> Objects<'_> {
        Objects { lights: &self.lights, spheres: &self.spheres, triangles: &self.triangles }
    }

    /// A small scene as people make them, some without lights or objects.
    fn tidy(rng: &mut Rng) -> Lot {
        let count = |rng: &mut Rng| (rng.next_u64() % 6) as usize;
        let mut scene = many(count(rng), count(rng), rng.next_u64());
        scene.lights.truncate((rng.next_u64() % 4) as usize);
        let packed = Packed::new(&scene);
        let objects = packed.objects();
        Lot {
            lights: objects.lights.to_vec(),
            spheres: objects.spheres.to_vec(),
            triangles: objects.triangles.to_vec(),
        }
    }

    /// Objects of any numbers at all.
    fn wild(rng: &mut Rng) -> Lot {
        let numbers = choose(rng, &Numbers::ALL);
        let mut lot = Lot::default();
        for _ in 0..rng.next_u64() % 5 {
            lot.lights.push(Light { position: numbers.vector(rng), radiance: numbers.vector(rng) });
        }
        for _ in 0..rng.next_u64() % 5 {
            lot.spheres.push(kernel_cases::sphere(numbers.vector(rng), numbers.next(rng)));
        }
        for _ in 0..rng.next_u64() % 5 {
            lot.triangles.push(kernel_cases::triangle([0; 3].map(|_| numbers.vector(rng))));
        }
        lot
    }
}

fn frame(width: u32, height: u32, focal: f32, film: f32) -> Frame {
    let grid = Camera::new(width, height, focal, film).unwrap().grid::<f32>();
    Frame {
        step: grid.step,
        half_width: grid.half_width,
        half_height: grid.half_height,
        focal: grid.focal,
        width: width.into(),
    }
}

/// The pixels that the kernel writes, on a film that nobody has written on.
fn traced(trace: Trace, frame: &Frame, objects: Objects<'_>, rows: Range<u32>) -> Vec<Lanes<f32>> {
    let mut film = vec![Vec4::from([f32::NAN; 4]); frame.width as usize * rows.len()];
    trace.call(frame, objects, rows, &mut film);
    film.into_iter().map(Vec4::lanes).collect()
}

fn check_trace(implementation: &str, trace: Trace, frame: &Frame, lot: &Lot, rows: Range<u32>) -> Vec<Lanes<f32>> {
    let found = traced(trace, frame, lot.objects(), rows.clone());
    let expected = Twin::of(implementation).trace(frame, lot.objects(), rows);
    for (pixel, (found, expected)) in found.iter().zip(&expected).enumerate() {
        let what = || format!("{implementation}, pixel {pixel} of {frame:?}: {found:?} instead of {expected:?}");
        assert!(same(*found, *expected), "{} in {lot:?}", what());
    }
    found
}

#[test]
fn every_tracer_equals_its_twin_to_the_last_bit_at_any_size() {
    let mut rng = Rng::new(seed());
    for (implementation, kernels) in implementations() {
        let (mut lit, mut pixels) = (0, 0);
        let narrow = (1..=33).map(|width| (width, 1 + width % 5));
        for (width, height) in narrow.chain([(1, 1), (1, 40), (100, 1), (48, 36)]) {
            for (focal, film) in [(1.0, 1.0), (35.0, 35.0), (0.1, 3.0)] {
                let frame = frame(width, height, focal, film);
                for lot in [Lot::default(), Lot::tidy(&mut rng), Lot::tidy(&mut rng), Lot::wild(&mut rng)] {
                    let found = check_trace(implementation, kernels.trace, &frame, &lot, 0..height);
                    pixels += found.len();
                    lit += found.iter().filter(|pixel| **pixel != [0.0; 4]).count();
                }
            }
        }
        assert!((pixels / 20..pixels).contains(&lit), "{implementation}: {lit} of {pixels} pixels are not black");
    }
}

#[test]
fn far_rows_and_long_rows_keep_their_places() {
    let lot = Lot::tidy(&mut Rng::new(7));
    for (implementation, kernels) in implementations() {
        check_trace(implementation, kernels.trace, &frame(3, 1_000_000, 1.0, 1.0), &lot, 999_000..1_000_000);
        check_trace(implementation, kernels.trace, &frame(1_000_000, 2, 1.0, 1.0), &lot, 1..2);
    }
}

#[test]
fn the_nearest_hit_wins_and_the_first_in_order_a_tie() {
    let colours = [Vec4::new(1.0, 0.0, 0.0), Vec4::new(0.0, 1.0, 0.0), Vec4::new(0.0, 0.0, 1.0)];
    let [red, green, blue] = colours;
    let ball = |z, colour| Sphere { colour, ..kernel_cases::sphere(Vec4::new(0.0, 0.0, z), 1.0) };
    let wall = |z, colour| Triangle {
        colour,
        ..kernel_cases::triangle([Vec4::new(-9.0, -9.0, z), Vec4::new(9.0, -9.0, z), Vec4::new(0.0, 9.0, z)])
    };
    let light = Light { position: Vec4::default(), radiance: Vec4::new(1.0, 1.0, 1.0) };
    for (what, spheres, triangles, expected) in [
        ("the sphere behind comes last", vec![ball(5.0, red), ball(9.0, green)], vec![], red),
        ("the sphere in front comes last", vec![ball(9.0, green), ball(5.0, red)], vec![], red),
        ("equal spheres", vec![ball(5.0, red), ball(5.0, green)], vec![], red),
        ("a triangle in front of a sphere", vec![ball(5.0, red)], vec![wall(3.0, blue)], blue),
        ("a triangle behind a sphere", vec![ball(5.0, red)], vec![wall(6.0, blue)], red),
        ("a triangle that touches a sphere", vec![ball(5.0, red)], vec![wall(4.0, blue)], red),
        ("equal triangles", vec![], vec![wall(4.0, green), wall(4.0, blue)], green),
    ] {
        let lot = Lot { lights: vec![light], spheres, triangles };
        for (implementation, kernels) in implementations() {
            let found = traced(kernels.trace, &frame(1, 1, 1.0, 1.0), lot.objects(), 0..1);
            assert_eq!(found, [expected.lanes()], "{implementation}: {what}");
        }
    }
}

#[test]
fn rows_give_the_same_bytes_however_they_are_split() {
    let mut rng = Rng::new(seed());
    for (implementation, kernels) in implementations() {
        for _ in 0..20 {
            let (width, height) = (1 + (rng.next_u64() % 40) as u32, 1 + (rng.next_u64() % 40) as u32);
            let (frame, lot) = (frame(width, height, 1.0, 1.0), Lot::tidy(&mut rng));
            let whole = traced(kernels.trace, &frame, lot.objects(), 0..height);
            let (mut parts, mut row) = (Vec::new(), 0);
            while row < height {
                let end = row + 1 + rng.next_u64() as u32 % (height - row);
                parts.extend(traced(kernels.trace, &frame, lot.objects(), row..end));
                row = end;
            }
            let bits = |pixels: &[Lanes<f32>]| pixels.iter().flatten().map(|x| x.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&whole), bits(&parts), "{implementation} at {width}x{height}");
        }
    }
}

/// Cases of each source of numbers and kernel.
const PACKET_CASES: usize = 1_000;
/// More than two packets of the widest.
const MOST_PIXELS: usize = 40;

fn linear<E>(slope: E, offset: E) -> Linear<E> {
    Linear { slope, offset }
}

fn twin_of_lits<E: Element>(lits: &[ObjectLight<E>]) -> Vec<packet::Light<E>> {
    let light = |l: &ObjectLight<E>| packet::Light {
        position: [l.x, l.y, l.z],
        cosine: l.cosine,
        weights: [l.red, l.green, l.blue],
    };
    lits.iter().map(light).collect()
}

/// A span record, its twin, and what the twin makes of it.
trait Record<E>: Copy + std::fmt::Debug {
    fn first(&self) -> E;
    fn depth(&self) -> E;
    fn colour(&self, rounding: Rounding, lights: &[packet::Light<E>], j: E, cosine: impl Cosine<E>) -> [E; 3];
    fn den(&self, rounding: Rounding, j: E) -> E;
    /// None for a triangle.
    fn normal(&self, rounding: Rounding, j: E) -> Option<[E; 3]>;
}

/// Gives a record its twin: the value that is made of `$s`, and the functions that take it.
macro_rules! record {
    ($name:ident, $s:ident => $twin:expr, $colour:ident, $den:ident $(, $normal:ident)?) => {
        impl<E: Element + Real> Record<E> for $name<E> {
            fn first(&self) -> E {
                self.j
            }
            fn depth(&self) -> E {
                self.depth
            }
            fn colour(&self, rounding: Rounding, lights: &[packet::Light<E>], j: E, cosine: impl Cosine<E>) -> [E; 3] {
                let $s = self;
                rounding.$colour(&$twin, lights, j, cosine)
            }
            fn den(&self, rounding: Rounding, j: E) -> E {
                let $s = self;
                rounding.$den(&$twin, j)
            }
            fn normal(&self, rounding: Rounding, j: E) -> Option<[E; 3]> {
                let ($s, _rounding, _j) = (self, rounding, j);
                let _twin = $twin;
                [$(_rounding.$normal(&_twin, _j))?].into_iter().next()
            }
        }
    };
}

record!(OutsideSpan, s => packet::Outside {
    a: linear(s.a1, s.a0),
    b: linear(s.b1, s.b0),
    h: linear(s.h1, s.h0),
    xyz: [linear(s.x1, s.x0), linear(s.y1, s.y0), linear(s.z1, s.z0)],
    c: [s.cx, s.cy, s.cz],
}, outside, outside_den, outside_normal);
record!(NearSpan, s => packet::Near {
    a: linear(s.a1, s.a0),
    b: linear(s.b1, s.b0),
    h: linear(s.h1, s.h0),
    x: linear(s.x1, s.x0),
    y: s.y,
    z: s.z,
    c: [s.cx, s.cy, s.cz],
}, near, near_den, near_normal);
record!(InsideSpan, s => packet::Inside {
    x: linear(s.x1, s.x0),
    y: s.y,
    z: s.z,
    g: s.g,
    h: linear(s.h1, s.h0),
    k: s.k,
    c: [s.cx, s.cy, s.cz],
}, inside, inside_den, inside_normal);
record!(TriangleSpan, s => packet::Triangle {
    w: linear(s.w1, s.w0),
    xyz: [linear(s.x1, s.x0), linear(s.y1, s.y0), linear(s.z1, s.z0)],
}, triangle, triangle_den);

fn twin_of_lit<E: Element>(s: &LitSphere<E>, row: &LitRow<E>) -> packet::LitSphere<E> {
    packet::LitSphere {
        m: row.m,
        a: row.a,
        h: linear(s.h1, row.h0),
        q: linear(s.q1, row.q0),
        kn: s.kn,
        ke: s.ke,
        weights: [s.red, s.green, s.blue],
    }
}

/// The pixel of a colour in floats: f64 is rounded once more.
fn float_pixel<E: Element>(colour: [E; 3]) -> Lanes<f32> {
    // Of f64 what is beyond f32 is its largest number, and so is a NaN: VMIN.
    let most = f64::from(f32::MAX);
    let narrow = |x: f64| if size_of::<E>() == 8 && (x.is_nan() || x >= most) { f32::MAX } else { x as f32 };
    let [r, g, b] = colour.map(|x| narrow(x.to_f64()));
    [r, g, b, 0.0]
}

/// Three floats as the four that they are the first of.
fn four([r, g, b]: [f32; 3]) -> Lanes<f32> {
    [r, g, b, 0.0]
}

/// Three levels as the four that they are the first of.
fn opaque([r, g, b]: Rgb8) -> Rgba8 {
    [r, g, b, 255]
}

/// The 8-bit levels of a colour; None where they are left open: below 0, and where it is not clamped from 256 on.
fn levels<E: Element>(colour: [E; 3], clamp: bool) -> Option<Rgba8> {
    let [r, g, b] = colour.map(|x| {
        let x = x.to_f64();
        // VMIN makes a NaN white.
        let x = if clamp && (x >= 255.0 || x.is_nan()) { 255.0 } else { x };
        (0.0..256.0).contains(&x).then_some(x as u8)
    });
    Some([r?, g?, b?, 255])
}

/// How often kernel and twin were compared, and how many results were neither 0, white, infinite nor NaN.
#[derive(Default)]
struct Compared {
    all: usize,
    ordinary: usize,
}

impl Compared {
    fn floats(&mut self, found: Lanes<f32>, expected: Lanes<f32>, what: &dyn Fn() -> String) {
        assert!(same(found, expected), "{found:?} instead of {expected:?}: {}", what());
        self.all += 1;
        self.ordinary += usize::from(expected[0].is_normal());
    }

    fn levels(&mut self, found: Rgba8, expected: Option<Rgba8>, what: &dyn Fn() -> String) {
        let Some(expected) = expected else { return };
        assert_eq!(found, expected, "{}", what());
        self.all += 1;
        self.ordinary += usize::from(expected[0] % 255 != 0);
    }
}

fn shaded<S, E, P: Copy>(
    kernel: &Shade<S, E, P>,
    span: &S,
    lits: &[ObjectLight<E>],
    pixels: usize,
    canary: P,
) -> Vec<P> {
    let mut out = vec![canary; pixels];
    kernel.call(span, lits, &mut out, false);
    out
}

/// Compares the exact kernels of one kind of object with their twin, over random records.
fn check_bodies<S: Record<E>, E: Element + Real>(
    alone: Option<&Bodies<S, E>>,
    bodies: &InRow<S, E>,
    normals: Option<&Planes<S, E>>,
    rounding: Rounding,
    random: impl Fn(Numbers, usize, &mut Rng) -> S,
    rng: &mut Rng,
) -> Compared {
    let mut compared = Compared::default();
    for case in 0..PACKET_CASES * Numbers::ALL.len() {
        let numbers = Numbers::ALL[case % Numbers::ALL.len()];
        let pixels = 1 + rng.next_u64() as usize % MOST_PIXELS;
        let span = random(numbers, pixels, rng);
        let lits: Vec<ObjectLight<E>> = (0..rng.next_u64() % 4).map(|_| kernel_cases::lit(numbers, rng)).collect();
        let lights = twin_of_lits(&lits);
        let j = |i: usize| E::from_u32(i as u32) + span.first();
        let colours: Vec<_> = (0..pixels).map(|i| span.colour(rounding, &lights, j(i), Exact)).collect();

        let f32x4 = alone.map(|alone| shaded(&alone.f32x4, &span, &lits, pixels, Vec4::default()));
        let rgba8 = alone.map(|alone| shaded(&alone.rgba8, &span, &lits, pixels, [0; 4]));
        // In f32 the bytes come from estimates.
        let rgba8 = rgba8.filter(|_| size_of::<E>() == 8);
        let mut row = Row::new(pixels);
        bodies.depth.call(&span, &mut row, 0..pixels);
        bodies.planes.call(&span, &lits, &mut row, 0..pixels);
        for (i, colour) in colours.into_iter().enumerate() {
            let what = || format!("case {case} of {numbers:?}, pixel {i} of {pixels}, {lits:?}, {span:?}");
            if let Some(f32x4) = &f32x4 {
                compared.floats(f32x4[i].lanes(), float_pixel(colour), &what);
            }
            if let Some(rgba8) = &rgba8 {
                compared.levels(rgba8[i], levels(colour, true), &what);
            }
            let in_row = [0, 1, 2, 3, 4].map(|plane| row.plane(plane)[i]);
            let den = span.den(rounding, j(i)) * span.depth();
            // Nobody is as near as 0, and NaN is no place.
            let zero = E::from_f32(0.0);
            let [r, g, b] = colour;
            let expected = if den > zero { [E::from_f32(2.0), r, g, b, den] } else { [zero; 5] };
            if den > zero {
                compared.floats(float_pixel([in_row[1], in_row[2], in_row[3]]), float_pixel(colour), &what);
            }
            let bits = |x: E| x.to_f64().to_bits();
            let equal = |(a, b): (E, E)| bits(a) == bits(b) || a.to_f64().is_nan() && b.to_f64().is_nan();
            let all = in_row.into_iter().zip(expected).all(equal);
            assert!(all, "{in_row:?} instead of {expected:?}: {}", what());
            let mut owned = Row::new(pixels);
            bodies.depth.call(&span, &mut owned, 0..pixels);
            assert_eq!(normals.is_some(), span.normal(rounding, j(i)).is_some());
            if let (Some(kernel), Some(normal)) = (normals, span.normal(rounding, j(i))) {
                kernel.call(&span, &[], &mut owned, 0..pixels);
                let found = [1, 2, 3].map(|plane| owned.plane(plane)[i]);
                let expected = if den > zero { normal } else { [zero; 3] };
                let all = found.into_iter().zip(expected).all(equal);
                assert!(all, "the normal {found:?} instead of {expected:?}: {}", what());
            }
        }
    }
    compared
}

/// What the twin makes of rows, each `width` pixels: None where the kernel's pixel is black because no span has it.
/// `packets` gives the number of a pixel's packet in memory.
fn twins_of_lit<E: Element + Real>(
    rounding: Rounding,
    sphere: &LitSphere<E>,
    rows: &[LitRow<E>],
    width: usize,
    packets: impl Fn(usize) -> usize,
) -> Vec<Option<[E; 3]>> {
    let mut colours = vec![None; rows.len() * width];
    for (i, row) in rows.iter().enumerate() {
        let [start, end] = [row.start, row.end].map(|column| i * width + column.to_f64() as usize);
        for (pixel, colour) in (start..end).zip(colours.iter_mut().skip(start)) {
            let edge = [start, end - 1].map(&packets).contains(&packets(pixel));
            let j = E::from_u32((pixel - start) as u32) + row.j;
            *colour = Some(rounding.lit(&twin_of_lit(sphere, row), j, edge));
        }
    }
    colours
}

/// Rows made by a kernel, and which packet of memory each pixel is in.
fn lit_rows<E: Element, P: Copy>(
    kernel: &ShadeRows<E, P>,
    lanes: usize,
    sphere: &LitSphere<E>,
    rows: &[LitRow<E>],
    width: usize,
    canary: P,
) -> (Vec<P>, impl Fn(usize) -> usize + use<E, P>) {
    let mut lit_rows = LitRows::default();
    for (i, row) in rows.iter().enumerate() {
        lit_rows.set_row(i, row);
    }
    let mut out = vec![canary; rows.len() * width];
    kernel.call(sphere, &lit_rows, &mut out, width, false);
    // Packets begin at multiples of the lanes' channels, or pixels of four: one in so many pixels does.
    let (unit, inverse) = if size_of::<P>().is_multiple_of(3) { (size_of::<P>() / 3, 11) } else { (size_of::<P>(), 1) };
    let first = out.as_ptr() as usize / unit * inverse % lanes;
    (out, move |pixel| (first + pixel) / lanes)
}

fn check_lit<E: Element + Real>(isa: Isa, kernels: &SpanKernels<E>, rounding: Rounding, rng: &mut Rng) -> Compared {
    // In f32, and with AVX-512 in f64 too, the bytes come from estimates.
    let exact = size_of::<E>() == 8 && isa != Isa::Avx512;
    let mut compared = Compared::default();
    let black = [E::from_u32(0); 3];
    for case in 0..PACKET_CASES * Numbers::ALL.len() {
        let numbers = Numbers::ALL[case % Numbers::ALL.len()];
        let (width, count) = (1 + rng.next_u64() as usize % MOST_PIXELS, 1 + rng.next_u64() as usize % 4);
        let any: LitSphere<E> = kernel_cases::lit_sphere(numbers, rng);
        let grey = LitSphere { red: E::from_u32(1), green: E::from_u32(1), blue: E::from_u32(1), ..any };
        let rows: Vec<_> = (0..count).map(|_| kernel_cases::lit_row(numbers, width, rng)).collect();
        for (sphere, bodies) in [(&any, &kernels.lit), (&grey, &kernels.grey)] {
            let what =
                |pixel: usize| format!("case {case} of {numbers:?}, pixel {pixel} of {width}: {sphere:?} {rows:?}");
            let (f32x4, packets) = lit_rows(&bodies.f32x4, kernels.lanes, sphere, &rows, width, Vec4::default());
            let twins = twins_of_lit(rounding, sphere, &rows, width, packets);
            for (i, (pixel, twin)) in f32x4.iter().zip(twins).enumerate() {
                compared.floats(pixel.lanes(), float_pixel(twin.unwrap_or(black)), &|| what(i));
            }
            let (f32x3, packets) = lit_rows(&bodies.f32x3, kernels.lanes, sphere, &rows, width, [0.0; 3]);
            let twins = twins_of_lit(rounding, sphere, &rows, width, packets);
            for (i, (pixel, twin)) in f32x3.iter().zip(twins).enumerate() {
                compared.floats(four(*pixel), float_pixel(twin.unwrap_or(black)), &|| what(i));
            }
            let row = &rows[0];
            let pixels = (row.end.to_f64() - row.start.to_f64()).max(0.0) as usize;
            let mut in_row = owned(kernels, row.j, row.stop, pixels);
            let mut of_row = LitRows::default();
            of_row.set_row(0, row);
            kernels.lit_planes.call(sphere, &of_row, &mut in_row, 0..pixels);
            for i in 0..pixels {
                let found = [1, 2, 3].map(|plane| in_row.plane(plane)[i]);
                let j = E::from_u32(i as u32) + row.j;
                let twin = rounding.lit(&twin_of_lit(sphere, row), j, true);
                let rounded = |x: E| x.to_f64() as f32;
                compared.floats(four(found.map(rounded)), four(twin.map(rounded)), &|| what(i));
            }
            let (rgba8, packets) = lit_rows(&bodies.rgba8, kernels.lanes, sphere, &rows, width, [0; 4]);
            let twins = twins_of_lit(rounding, sphere, &rows, width, packets);
            for (i, (pixel, twin)) in rgba8.iter().zip(twins).enumerate() {
                if exact || twin.is_none() {
                    compared.levels(*pixel, levels(twin.unwrap_or(black), false), &|| what(i));
                }
            }
            let (rgb8, packets) = lit_rows(&bodies.rgb8, kernels.lanes, sphere, &rows, width, [0; 3]);
            let twins = twins_of_lit(rounding, sphere, &rows, width, packets);
            for (i, (pixel, twin)) in rgb8.into_iter().zip(twins).enumerate() {
                if exact || twin.is_none() {
                    compared.levels(opaque(pixel), levels(twin.unwrap_or(black), false), &|| what(i));
                }
            }
        }
    }
    compared
}

/// A row in which all pixels are those of object 1: a sphere with 1/t = 1 everywhere.
fn owned<E: Element>(kernels: &SpanKernels<E>, j: E, end: E, pixels: usize) -> Row<E> {
    let [zero, one] = [0.0, 1.0].map(E::from_f64);
    let everywhere = OutsideSpan { j, end, id: one, depth: one, h0: one, ..OutsideSpan::<f64>::default().round() };
    let mut row = Row::new(pixels);
    kernels.outside_in_row.depth.call(&everywhere, &mut row, 0..pixels);
    assert!(row.plane(0)[..pixels].iter().all(|who| *who != zero));
    row
}

fn check_packets<E: Element + Real>(isa: Isa, kernels: &SpanKernels<E>, seed: u64) {
    let rounding = if isa == Isa::Sse41 { Rounding::Unfused } else { Rounding::Fused };
    let rng = &mut Rng::new(seed);
    for (name, compared) in [
        ("lit", check_lit(isa, kernels, rounding, rng)),
        (
            "outside",
            check_bodies(
                Some(&kernels.outside),
                &kernels.outside_in_row,
                Some(&kernels.outside_normals),
                rounding,
                |n, p, rng| kernel_cases::outside_span(n, 2.0, p, rng),
                rng,
            ),
        ),
        (
            "near",
            check_bodies(
                None,
                &kernels.near_in_row,
                Some(&kernels.near_normals),
                rounding,
                |n, p, rng| kernel_cases::near_span(n, 2.0, p, rng),
                rng,
            ),
        ),
        (
            "inside",
            check_bodies(
                None,
                &kernels.inside_in_row,
                Some(&kernels.inside_normals),
                rounding,
                |n, p, rng| kernel_cases::inside_span(n, 2.0, p, rng),
                rng,
            ),
        ),
        (
            "triangle",
            check_bodies(
                Some(&kernels.triangle),
                &kernels.triangle_in_row,
                None,
                rounding,
                |n, p, rng| kernel_cases::triangle_span(n, 2.0, p, rng),
                rng,
            ),
        ),
    ] {
        let Compared { all, ordinary } = compared;
        println!("{isa}, {} bytes, {name}: {all} compared, {ordinary} ordinary numbers", size_of::<E>());
        assert!(ordinary > all / 100, "{isa} {name}: {ordinary} of {all} are ordinary numbers");
    }
}

#[test]
fn every_packet_kernel_without_estimates_equals_its_twin_to_the_last_bit() {
    let seed = seed();
    for (isa, kernels) in packet_kernels() {
        check_packets(isa, &kernels.single, seed);
        check_packets(isa, &kernels.double, seed);
    }
}

/// Compares what a kernel makes of a planned span with what its twin does.
struct Planned<'a, E: 'static> {
    kernels: &'static SpanKernels<E>,
    rounding: Rounding,
    lits: &'a [ObjectLight<E>],
    pixels: usize,
    compared: &'a mut Compared,
}

impl<E: Element + Real> Planned<'_, E> {
    fn check<S: Record<E>>(&mut self, kernel: &Shade<S, E, Vec4>, span: &S) {
        let lights = twin_of_lits(self.lits);
        let found = shaded(kernel, span, self.lits, self.pixels, Vec4::default());
        for (i, pixel) in found.into_iter().enumerate() {
            let colour = span.colour(self.rounding, &lights, E::from_u32(i as u32) + span.first(), Exact);
            self.compared.floats(pixel.lanes(), float_pixel(colour), &|| format!("pixel {i} of {span:?}"));
        }
    }

    /// The record's id is nobody's, as all pixels of a new row are.
    fn check_in_row<S: Record<E>>(&mut self, bodies: &InRow<S, E>, span: &S) {
        let lights = twin_of_lits(self.lits);
        let mut row = Row::new(self.pixels);
        bodies.planes.call(span, self.lits, &mut row, 0..self.pixels);
        for i in 0..self.pixels {
            let found = [1, 2, 3].map(|plane| row.plane(plane)[i]);
            let colour = span.colour(self.rounding, &lights, E::from_u32(i as u32) + span.first(), Exact);
            self.compared.floats(float_pixel(found), float_pixel(colour), &|| format!("pixel {i} of {span:?}"));
        }
    }
}

impl<E: Element + Real> UseRecord<E> for Planned<'_, E> {
    type Result = ();

    fn lit(self, form: &ShortForm, row: &LitRow<E>) {
        let (sphere, width) = (form.sphere(Scale::Linear).round(), self.pixels);
        let rows = [*row];
        let bodies = &self.kernels.lit;
        let (found, packets) = lit_rows(&bodies.f32x4, self.kernels.lanes, &sphere, &rows, width, Vec4::default());
        let twins = twins_of_lit(self.rounding, &sphere, &rows, width, packets);
        for (i, (pixel, twin)) in found.into_iter().zip(twins).enumerate() {
            let colour = twin.expect("a span that fills its row");
            self.compared.floats(pixel.lanes(), float_pixel(colour), &|| format!("pixel {i} of {row:?} of {sphere:?}"));
        }
    }
    fn outside(mut self, span: &OutsideSpan<E>) {
        self.check(&self.kernels.outside.f32x4, span);
    }
    fn near(mut self, span: &NearSpan<E>) {
        self.check_in_row(&self.kernels.near_in_row, span);
    }
    fn inside(mut self, span: &InsideSpan<E>) {
        self.check_in_row(&self.kernels.inside_in_row, span);
    }
    fn triangle(mut self, span: &TriangleSpan<E>) {
        self.check(&self.kernels.triangle.f32x4, span);
    }
}

fn check_planned<E: Element + Real>(isa: Isa, kernels: &'static SpanKernels<E>) {
    let rounding = if isa == Isa::Sse41 { Rounding::Unfused } else { Rounding::Fused };
    let mut compared = Compared::default();
    for (lights, keep) in [(1, Keep::NOTHING), (1, Keep::only(Omission::Loop)), (2, Keep::NOTHING)] {
        let mut scene = Scene { camera: Camera::new(201, 151, 1.0, 1.0).unwrap(), ..many(12, 12, 31) };
        scene.lights.truncate(lights);
        // One sphere has the camera in it, and one nearly.
        scene.spheres[0].radius = 400.0;
        scene.spheres[1].radius = 0.9 * scene.spheres[1].centre.length();
        let spans = Spans::<E>::new(&scene, Some(Scale::Linear), keep);
        for row in 0..scene.camera.height() {
            for object in spans.seen_in(&(row..row + 1)) {
                let Some(span) = spans.row(object, row) else { continue };
                let (lits, pixels) = (spans.lits(object, Scale::Linear), (span.end - span.start) as usize);
                let user = Planned { kernels, rounding, lits, pixels, compared: &mut compared };
                spans.with_record(&span, row, 0.0, Some(Scale::Linear), user);
            }
        }
    }
    let Compared { all, ordinary } = compared;
    println!("{isa}, {} bytes: {all} compared, {ordinary} ordinary numbers", size_of::<E>());
    assert!(ordinary > all / 4, "{isa}: {ordinary} of {all} are ordinary numbers");
}

#[test]
fn the_spans_of_a_scene_are_shaded_as_their_twins_to_the_last_bit() {
    for (isa, kernels) in packet_kernels() {
        check_planned(isa, &kernels.single);
        check_planned(isa, &kernels.double);
    }
}

/// Compares the rows of the spheres of a scene, as a kernel finds them, with the plan's.
fn check_lit_rows<E: Element + Real>(kernels: &'static SpanKernels<E>, scene: &Scene) -> usize {
    struct Row;
    impl<E: Element> UseRecord<E> for Row {
        type Result = LitRow<E>;
        fn lit(self, _: &ShortForm, row: &LitRow<E>) -> LitRow<E> {
            *row
        }
        fn outside(self, _: &OutsideSpan<E>) -> LitRow<E> {
            unreachable!("the object has a short form")
        }
        fn near(self, _: &NearSpan<E>) -> LitRow<E> {
            unreachable!("the object has a short form")
        }
        fn inside(self, _: &InsideSpan<E>) -> LitRow<E> {
            unreachable!("the object has a short form")
        }
        fn triangle(self, _: &TriangleSpan<E>) -> LitRow<E> {
            unreachable!("the object has a short form")
        }
    }
    let plan = Spans::<E>::new(scene, Some(Scale::Linear), Keep::default());
    let height = scene.camera.height();
    let mut compared = 0;
    for object in plan.seen_in(&(0..height)) {
        let Some(form) = plan.short_form(object) else { continue };
        for first in (0..height).step_by(LIT_ROWS - 1) {
            let mut found = LitRows::default();
            let count = (height - first).min(LIT_ROWS as u32 - 1);
            kernels.lit_rows.call(form.setup(Scale::Linear), first, count as usize, &mut found);
            for row in 0..count {
                let what = format!("row {} of object {object}", first + row);
                // Who it is, is not the kernel's to say.
                let found = LitRow { id: E::from_u32(1), ..found.row(row as usize) };
                let Some(span) = plan.row(object, first + row) else {
                    assert!(found.start >= found.end, "{what}: {found:?} instead of nothing");
                    continue;
                };
                let expected = plan.with_record(&span, first + row, 1.0, Some(Scale::Linear), Row);
                // Where it is alone, its first column is column 0.
                let [start, end] = [span.start, span.end].map(E::from_u32);
                assert_eq!(found, LitRow { start, end, ..expected }, "{what}");
                compared += 1;
            }
        }
    }
    compared
}

#[test]
fn the_rows_of_a_sphere_are_those_of_the_plan_to_the_last_bit() {
    for (isa, kernels) in packet_kernels() {
        for (width, height) in [(201, 151), (1, 67), (333, 5)] {
            let mut scene = Scene { camera: Camera::new(width, height, 1.0, 1.0).unwrap(), ..many(60, 0, 7) };
            scene.lights.truncate(1);
            let compared = [check_lit_rows(&kernels.single, &scene), check_lit_rows(&kernels.double, &scene)];
            println!("{isa}, {width}x{height}: {compared:?} rows");
            assert!(compared[0] > 10 && compared[0] == compared[1], "{isa}: {compared:?} rows compared");
        }
    }
}
