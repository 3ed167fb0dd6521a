//! Every operation and tracer against its scalar twin, to the last bit.
//!
//! All of them use only + - x / and roots, correctly rounded and in an order that the twin follows,
//! so that there is exactly one right result; except that packets may take estimates. The payload
//! of a NaN is unspecified: any NaN equals any NaN.

mod by_estimates;
mod on_packets;
mod paper_c;

use std::ops::Range;

use crate::kernel_cases::{self, Input, Numbers, choose, implementations, seed};
use rayo::internals::kernels::{Frame, Light, Objects, PaperSphere, PaperTriangle, Plain, Trace, Vec4};
use rayo::internals::plan::Packed;
use rayo::internals::reference::aos::{self, Form, Lanes};
use rayo::internals::scene::{Camera, MAX_SIDE, Rng, many};
use rayo_lab::experiments::check::inputs::{Case, cases};
use rayo_lab::experiments::check::twins::{self, twin_of_light, twin_of_sphere, twin_of_triangle};
use rayo_lab::experiments::check::{self, same};

/// The twin that an implementation must equal.
#[derive(Clone, Copy, Debug)]
enum Twin {
    /// `reference::aos`.
    Macros(Form),
    /// `paper_c`, whose comment explains why it equals C to the last bit although C calls `pow`.
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

    /// The result of the operation `name` for `input`; a scalar is in the first lane.
    fn op(self, name: &str, input: &Input) -> Lanes {
        match self {
            Twin::Macros(form) => twins::of_macros(form, name, input),
            Twin::C => paper_c::op(name, input),
        }
    }

    /// The pixels of these rows.
    fn trace(self, frame: &Frame, objects: Objects<'_>, rows: Range<u32>) -> Vec<Lanes> {
        let lights: Vec<_> = objects.lights.iter().map(twin_of_light).collect();
        let spheres: Vec<_> = objects.spheres.iter().map(twin_of_sphere).collect();
        let triangles: Vec<_> = objects.triangles.iter().map(twin_of_triangle).collect();
        let pixels = rows.flat_map(|row| (0..frame.width).map(move |col| (row, col)));
        let pixel = |(row, col)| {
            let centre = |i: f32| frame.step * (i + 0.5);
            let (x, y) =
                (centre((frame.first + col) as f32) - frame.half_width, frame.half_height - centre(row as f32));
            let ray = [x, y, frame.focal, 0.0];
            match self {
                Twin::Macros(form) => aos::trace(form, ray, &lights, &spheres, &triangles, frame.background.lanes()),
                Twin::C => paper_c::trace(ray, &lights, &spheres, &triangles, frame.background.lanes()),
            }
        };
        pixels.map(pixel).collect()
    }
}

/// The number of cases for each source of numbers, with w = 0 and with any w.
const CASES: u32 = 5_000;

#[test]
fn every_operation_equals_its_twin_to_the_last_bit() {
    let seed = seed();
    for (implementation, kernels) in implementations() {
        let twin = Twin::of(implementation);
        for (name, op) in kernels.ops() {
            let (mut hits, mut inside) = (0, 0);
            for Case { input, numbers } in cases(op, CASES, seed) {
                let result = check::one(op, &input, &|input| twin.op(name, input));
                let result = result.unwrap_or_else(|failed| panic!("{implementation} {name}: {failed}"));
                if numbers.is_none() {
                    hits += u32::from(result[0].is_finite());
                    if let Input::Sphere(_, PaperSphere { centre: c, radius: r, .. }) = input {
                        inside += u32::from(c.x * c.x + c.y * c.y + c.z * c.z < r * r);
                    }
                }
            }
            // Some rays must hit and some must miss, from outside and from inside.
            let some = 4 * CASES / 10..4 * CASES * 9 / 10;
            assert!(!["sphere", "triangle"].contains(&name) || some.contains(&hits), "{implementation} {name}: {hits}");
            assert!(name != "sphere" || some.contains(&inside), "{implementation}: {inside} from inside");
        }
    }
}

const MISS: f32 = f32::INFINITY;

type Point = [f32; 3];

/// A case for each path through the sphere code: ray, centre, radius, and a t that is exact in any
/// order of operations.
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
            // The only t that is not exact: a square root of 16/3 is in it.
            let close = path == "a slanting ray" && (found - t).abs() < 1e-6;
            assert!(found == t || close, "{implementation}, {path}: {found} instead of {t}");
        }
    }
}

const CORNERS: [Point; 3] = [[0.0, 0.0, 4.0], [4.0, 0.0, 4.0], [0.0, 4.0, 4.0]];

/// A case for each path through the triangle code: ray, vertices, t.
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
fn triangle_is_hit_as_by_hand_in_any_order_of_vertices() {
    for (implementation, kernels) in implementations() {
        for (path, ray, [a, b, c], t) in TRIANGLES {
            for vertices in [[a, b, c], [b, c, a], [c, a, b], [c, b, a], [b, a, c], [a, c, b]] {
                let found = kernels.triangle.call(&vector(ray), &kernel_cases::triangle(vertices.map(vector)));
                assert_eq!(found, t, "{implementation}, {path}, {vertices:?}");
            }
        }
    }
}

fn vector([x, y, z]: [f32; 3]) -> Vec4 {
    Vec4::new(x, y, z)
}

/// The lights, spheres and triangles of a scene.
#[derive(Clone, Debug, Default)]
struct Lot {
    lights: Vec<Light>,
    spheres: Vec<PaperSphere>,
    triangles: Vec<PaperTriangle>,
}

impl Lot {
    fn objects(&self) -> Objects<'_> {
        Objects { lights: &self.lights, spheres: &self.spheres, triangles: &self.triangles }
    }

    /// A small ordinary scene, in some cases without lights or objects.
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

    /// Objects with arbitrary numbers.
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
        ..Frame::ZERO
    }
}

/// The pixels that the kernel writes; unwritten ones would be NaN.
fn traced(trace: Trace, frame: &Frame, objects: Objects<'_>, rows: Range<u32>) -> Vec<Lanes> {
    let mut film = vec![Vec4::from([f32::NAN; 4]); frame.width as usize * rows.len()];
    trace.call(frame, objects, rows, &mut film);
    film.into_iter().map(Vec4::lanes).collect()
}

fn check_trace(implementation: &str, trace: Trace, frame: &Frame, lot: &Lot, rows: Range<u32>) -> Vec<Lanes> {
    let found = traced(trace, frame, lot.objects(), rows.clone());
    let expected = Twin::of(implementation).trace(frame, lot.objects(), rows);
    for (pixel, (found, expected)) in found.iter().zip(&expected).enumerate() {
        let what = || format!("{implementation}, pixel {pixel} of {frame:?}: {found:?} instead of {expected:?}");
        assert!(found.iter().zip(expected).all(|(a, b)| same(*a, *b)), "{} in {lot:?}", what());
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
                    // Part of the picture's columns and rows, over a background.
                    let first = rng.next_u64() % u64::from(width);
                    let row = rng.next_u64() as u32 % height;
                    let rows = row..row + 1 + rng.next_u64() as u32 % (height - row);
                    let part = Frame {
                        first,
                        width: u64::from(width) - first,
                        background: Vec4::new(0.5, 2.0, 0.25),
                        ..frame
                    };
                    check_trace(implementation, kernels.trace, &part, &lot, rows);
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
        check_trace(implementation, kernels.trace, &frame(3, MAX_SIDE, 1.0, 1.0), &lot, MAX_SIDE - 1000..MAX_SIDE);
        check_trace(implementation, kernels.trace, &frame(MAX_SIDE, 2, 1.0, 1.0), &lot, 1..2);
    }
}
