//! Seeded inputs for every operation: random and special numbers, and inputs as they occur in
//! pictures.

use std::fmt::Debug;

use rayo::internals::kernels::{Light, OpRef, PaperSphere, PaperTriangle, Surface, Vec4};
use rayo::internals::scene::Rng;

/// A random element of `of`.
pub fn choose<T: Copy>(rng: &mut Rng, of: &[T]) -> T {
    of[(rng.next_u64() % of.len() as u64) as usize]
}

/// The source of a case's numbers.
#[derive(Clone, Copy, Debug)]
pub enum Numbers {
    /// Between -10 and 10.
    Ordinary,
    /// A few small integers, so that products and sums are exact, and ties and zeros happen.
    Integers,
    /// Any sign, any exponent from 2^-40 to 2^40.
    Magnitudes,
    /// Any exponent of f32, so that most products overflow or underflow.
    Extremes,
    /// Zeros, denormals, infinities, NaN and the like.
    Special,
    /// Any of 2^32 bit patterns.
    Bits,
    /// A source chosen anew for each number.
    Mixed,
}

impl Numbers {
    /// Every source.
    pub const ALL: [Numbers; 7] = [
        Numbers::Ordinary,
        Numbers::Integers,
        Numbers::Magnitudes,
        Numbers::Extremes,
        Numbers::Special,
        Numbers::Bits,
        Numbers::Mixed,
    ];

    /// Zeros, subnormal numbers, the ends of the normal range, numbers whose squares are at these
    /// ends, infinities and NaN.
    const SPECIAL: [f32; 14] = [
        0.0,
        f32::from_bits(1),           // the smallest denormal
        f32::from_bits(0x007f_ffff), // the largest
        f32::MIN_POSITIVE,
        1.084_202_2e-19, // 2^-63: its square is the smallest normal number
        f32::EPSILON,
        1.0 - f32::EPSILON / 2.0,
        1.0,
        1.0 + f32::EPSILON,
        16_777_216.0,   // 2^24: from here on x + 1 = x
        1.844_674_4e19, // 2^64: its square is infinite
        f32::MAX,
        f32::INFINITY,
        f32::NAN,
    ];

    /// The next number from this source.
    pub fn next(self, rng: &mut Rng) -> f32 {
        let scaled = |rng: &mut Rng, exponents: u64| {
            let exponent = (rng.next_u64() % (2 * exponents + 1)) as i32 - exponents as i32;
            rng.between(-2.0, 2.0) * 2.0_f32.powi(exponent)
        };
        match self {
            Numbers::Ordinary => rng.between(-10.0, 10.0),
            Numbers::Integers => (rng.next_u64() % 9) as f32 - 4.0,
            Numbers::Magnitudes => scaled(rng, 40),
            Numbers::Extremes => scaled(rng, 126),
            Numbers::Special => choose(rng, &Self::SPECIAL) * choose(rng, &[1.0, -1.0]),
            Numbers::Bits => f32::from_bits(rng.next_u64() as u32),
            Numbers::Mixed => choose(rng, &Self::ALL[..6]).next(rng),
        }
    }

    /// A vector of three such numbers, with w = 0.
    pub fn vector(self, rng: &mut Rng) -> Vec4 {
        Vec4 { w: 0.0, ..self.lanes(rng) }
    }

    /// Four such numbers.
    pub fn lanes(self, rng: &mut Rng) -> Vec4 {
        Vec4::from([0; 4].map(|_| self.next(rng)))
    }
}

/// The input of an operation.
#[derive(Clone, Copy, Debug)]
pub enum Input {
    Vectors(Vec4, Vec4),
    Scale(Vec4, f32),
    Sphere(Vec4, PaperSphere),
    Triangle(Vec4, PaperTriangle),
    Lambert(Surface, Light),
}

impl Input {
    /// An input whose numbers come from one source, wherever `op` reads. The w of vectors is random
    /// too if `any_w`, and otherwise 0.
    pub fn random(op: OpRef, numbers: Numbers, any_w: bool, rng: &mut Rng) -> Input {
        let vector = |rng: &mut Rng| if any_w { numbers.lanes(rng) } else { numbers.vector(rng) };
        match op {
            OpRef::Vector(_) | OpRef::Scalar(_) => Input::Vectors(vector(rng), vector(rng)),
            OpRef::Scale(_) => Input::Scale(vector(rng), numbers.next(rng)),
            OpRef::Sphere(_) => Input::Sphere(vector(rng), sphere(vector(rng), numbers.next(rng))),
            OpRef::Triangle(_) => Input::Triangle(vector(rng), triangle([0; 3].map(|_| vector(rng)))),
            OpRef::Lambert(_) => Input::Lambert(
                Surface { point: vector(rng), normal: vector(rng), colour: vector(rng) },
                Light { position: vector(rng), radiance: vector(rng) },
            ),
        }
    }

    /// An input as it occurs in pictures: a ray that passes near an object, and a light nearby.
    pub fn aimed(op: OpRef, rng: &mut Rng) -> Input {
        let point = |rng: &mut Rng| Numbers::Ordinary.vector(rng);
        match op {
            OpRef::Sphere(_) => {
                let (centre, radius) = (point(rng), rng.between(0.1, 12.0));
                let reach = rng.between(0.0, 1.5) * radius;
                let [x, y, z, _] = centre.lanes();
                let mut near = |x| x + rng.between(-reach, reach);
                let target = Vec4::new(near(x), near(y), near(z));
                let flip = choose(rng, &[0.3, 1.0, 2.0, -1.0]);
                Input::Sphere(scaled(target, flip), sphere(centre, radius))
            }
            OpRef::Triangle(_) => {
                let vertices = [0; 3].map(|_| point(rng));
                // Barycentric coordinates of a point inside of the triangle or slightly outside.
                let (u, v) = (rng.between(-0.2, 1.0), rng.between(-0.2, 1.0));
                let weights = [u, v, 1.0 - u - v];
                let mut target = Vec4::default();
                for (vertex, weight) in vertices.iter().zip(weights) {
                    target.x += weight * vertex.x;
                    target.y += weight * vertex.y;
                    target.z += weight * vertex.z;
                }
                let flip = choose(rng, &[0.3, 1.0, 2.0, -1.0]);
                Input::Triangle(scaled(target, flip), triangle(vertices))
            }
            OpRef::Lambert(_) => {
                let direction = point(rng);
                let [x, y, z, _] = direction.lanes();
                let normal = scaled(direction, 1.0 / (x * x + y * y + z * z).sqrt());
                let colour = |rng: &mut Rng| Vec4::new(rng.next_f32(), rng.next_f32(), rng.next_f32());
                let surface = Surface { point: point(rng), normal, colour: colour(rng) };
                Input::Lambert(surface, Light { position: point(rng), radiance: colour(rng) })
            }
            _ => Input::random(op, Numbers::Ordinary, false, rng),
        }
    }
}

/// A sphere; its colour does not matter.
pub fn sphere(centre: Vec4, radius: f32) -> PaperSphere {
    PaperSphere { centre, colour: Vec4::new(0.25, 0.5, 1.0), radius, padding: [0.0; 3] }
}

/// A triangle; its colour does not matter.
pub fn triangle([v1, v2, v3]: [Vec4; 3]) -> PaperTriangle {
    PaperTriangle { v1, v2, v3, colour: Vec4::new(1.0, 0.5, 0.25) }
}

fn scaled(v: Vec4, by: f32) -> Vec4 {
    Vec4::new(v.x * by, v.y * by, v.z * by)
}

/// An argument of an operation, or a component of one, as text.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Argument {
    pub name: &'static str,
    /// Each number with all of its digits.
    pub numbers: Vec<String>,
}

impl Argument {
    pub fn new<N: Debug>(name: &'static str, numbers: &[N]) -> Self {
        Argument { name, numbers: numbers.iter().map(|number| format!("{number:?}")).collect() }
    }
}

impl Input {
    /// The input's arguments by name, without the colours of objects, which no intersection reads.
    pub fn arguments(&self) -> Vec<Argument> {
        let vector = |name, v: Vec4| Argument::new(name, &v.lanes());
        match self {
            Input::Vectors(a, b) => vec![vector("a", *a), vector("b", *b)],
            Input::Scale(a, factor) => vec![vector("a", *a), Argument::new("b", &[*factor])],
            Input::Sphere(ray, sphere) => {
                vec![vector("ray", *ray), vector("centre", sphere.centre), Argument::new("radius", &[sphere.radius])]
            }
            Input::Triangle(ray, triangle) => {
                let corners = [("v1", triangle.v1), ("v2", triangle.v2), ("v3", triangle.v3)];
                [("ray", *ray)].into_iter().chain(corners).map(|(name, v)| vector(name, v)).collect()
            }
            Input::Lambert(surface, light) => vec![
                vector("point", surface.point),
                vector("normal", surface.normal),
                vector("colour", surface.colour),
                vector("light", light.position),
                vector("radiance", light.radiance),
            ],
        }
    }
}

/// An input, and the source of its numbers.
#[derive(Clone, Copy, Debug)]
pub struct Case {
    pub input: Input,
    /// The source of its numbers; None for one that is [aimed](Input::aimed).
    pub numbers: Option<Numbers>,
}

/// Inputs for `op`: for each source of numbers `count` with w = 0 and as many with any w; and 4
/// `count` that are [aimed](Input::aimed).
pub fn cases(op: OpRef, count: u32, seed: u64) -> impl Iterator<Item = Case> {
    let mut rng = Rng::new(seed);
    let sources = Numbers::ALL.into_iter().flat_map(|numbers| [(numbers, false), (numbers, true)]);
    let random = sources.flat_map(move |source| (0..count).map(move |_| Some(source)));
    random.chain((0..4 * count).map(|_| None)).map(move |source| match source {
        Some((numbers, any_w)) => Case { input: Input::random(op, numbers, any_w, &mut rng), numbers: Some(numbers) },
        None => Case { input: Input::aimed(op, &mut rng), numbers: None },
    })
}
