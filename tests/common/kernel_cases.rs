//! What the tests of the kernels share: the implementations, seeded inputs for every kind of operation, and scenes.

use rayo::kernels::harness::{faults, portable_packets};
use rayo::kernels::{
    self, AosKernels, Element, Fault, Isa, Light, LitRow, LitSphere, Op, OpRef, PacketKernels, PaperSphere,
    PaperTriangle, Plain, Surface, Vec4,
};
use rayo::scene::Rng;

/// Every table of kernels that this CPU runs, by the name in its symbols.
pub fn implementations() -> Vec<(&'static str, &'static AosKernels)> {
    let all = [("c", kernels::c()), ("paper", kernels::paper()), ("aos", kernels::aos())];
    let (usable, rest): (Vec<_>, Vec<_>) = all.into_iter().partition(|(_, kernels)| kernels.is_some());
    for (name, _) in rest {
        println!("not tested, since this CPU or this build does not run them: the kernels of `{name}`");
    }
    usable.into_iter().map(|(name, kernels)| (name, kernels.unwrap())).collect()
}

/// The packet kernels of every ISA that this CPU runs.
pub fn packet_kernels() -> Vec<(Isa, &'static PacketKernels)> {
    let (usable, rest): (Vec<_>, Vec<_>) = Isa::ALL.into_iter().partition(|isa| isa.usable());
    for isa in rest {
        println!("not tested, since this CPU does not run them: the packet kernels of {isa}");
    }
    usable.into_iter().map(|isa| (isa, kernels::packets(isa).unwrap())).collect()
}

/// A sphere under one light, with a random number in every field, and weights that are finite and not below 0.
pub fn lit_sphere<E: Element>(numbers: Numbers, rng: &mut Rng) -> LitSphere<E> {
    let [h1, least, q1, kn, ke, red, green, blue] = [0; 8].map(|_| numbers.next(rng).into());
    let [red, green, blue] = [red, green, blue].map(|weight: f64| weight.abs().min(1e30));
    LitSphere { h1, least, q1, kn, ke, red, green, blue }.round()
}

/// A row of one, of so many pixels: with any columns, or one time in four none, and random numbers.
pub fn lit_row<E: Element>(numbers: Numbers, width: usize, rng: &mut Rng) -> LitRow<E> {
    let mut below = |n: usize| (rng.next_u64() % n as u64) as usize;
    let (start, end) = (below(width + 1), below(width + 1));
    let (start, end) = if below(4) == 0 { (end.max(start), end.min(start)) } else { (start.min(end), start.max(end)) };
    let middle = (start + end) / 2;
    let [start, end, middle] = [start, end, middle].map(|column| column as f64);
    let [m, a, h0, q0] = [0; 4].map(|_| numbers.next(rng).into());
    LitRow { start, end, j: start - middle, stop: end - middle, m, a, h0, q0 }.round()
}

/// So many rows as [`lit_row`] has them.
pub fn lit_rows<E: Element>(numbers: Numbers, width: usize, count: usize, rng: &mut Rng) -> Vec<LitRow<E>> {
    (0..count).map(|_| lit_row(numbers, width, rng)).collect()
}

/// The packet kernels of each ISA that runs here, and their twins: those in Rust of the same lanes and rounding.
pub fn twins() -> Vec<(Isa, &'static PacketKernels, &'static PacketKernels)> {
    let twin = |isa| match isa {
        Isa::Sse41 => portable_packets::<4, 2, false>(),
        Isa::Avx2 => portable_packets::<8, 4, true>(),
        Isa::Avx512 => portable_packets::<16, 8, true>(),
    };
    packet_kernels().into_iter().map(|(isa, kernels)| (isa, kernels, &*Box::leak(Box::new(twin(isa))))).collect()
}

/// The seed of this run: RAYO_SEED, or a fixed one. It is printed, and so shown where a test fails.
pub fn seed() -> u64 {
    let seed = match std::env::var("RAYO_SEED") {
        Ok(text) => text.parse().unwrap_or_else(|_| panic!("RAYO_SEED must be a number from 0 to 2^64-1, not {text}")),
        Err(_) => 1,
    };
    println!("replay with RAYO_SEED={seed}");
    seed
}

/// Any of `of`.
pub fn choose<T: Copy>(rng: &mut Rng, of: &[T]) -> T {
    of[(rng.next_u64() % of.len() as u64) as usize]
}

/// Where the numbers of a case come from.
#[derive(Clone, Copy, Debug)]
pub enum Numbers {
    /// Between -10 and 10.
    Ordinary,
    /// A few small integers, so that products and sums are exact, and ties and zeros happen.
    Integers,
    /// Any sign, any exponent from 2^-40 to 2^40.
    Magnitudes,
    /// Any exponent at all, so that most products overflow or vanish.
    Extremes,
    /// The numbers at which arithmetic changes its rules.
    Special,
    /// Any of 2^32 bit patterns.
    Bits,
    /// One of the above for each number by itself.
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

    /// Zeros, denormals, the ends of the normal numbers, roots of these, infinities and NaN.
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

    /// The next number.
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

    /// Three of them, and a w that is 0.
    pub fn vector(self, rng: &mut Rng) -> Vec4 {
        Vec4 { w: 0.0, ..self.lanes(rng) }
    }

    /// Four of them.
    pub fn lanes(self, rng: &mut Rng) -> Vec4 {
        Vec4::from([0; 4].map(|_| self.next(rng)))
    }
}

/// What an operation takes.
#[derive(Clone, Copy, Debug)]
pub enum Input {
    Vectors(Vec4, Vec4),
    Scale(Vec4, f32),
    Sphere(Vec4, PaperSphere),
    Triangle(Vec4, PaperTriangle),
    Lambert(Surface, Light),
}

impl Input {
    /// Random numbers of one source in every place that `op` reads; vectors get a w of their own where `any_w`.
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

    /// A case as it comes up in a picture: a ray that passes near an object, a light that is somewhere about.
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
                // Barycentric coordinates a little beyond the inside.
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

/// A sphere of no particular colour.
pub fn sphere(centre: Vec4, radius: f32) -> PaperSphere {
    PaperSphere { centre, colour: Vec4::new(0.25, 0.5, 1.0), radius, padding: [0.0; 3] }
}

/// A triangle of no particular colour.
pub fn triangle([v1, v2, v3]: [Vec4; 3]) -> PaperTriangle {
    PaperTriangle { v1, v2, v3, colour: Vec4::new(1.0, 0.5, 0.25) }
}

fn scaled(v: Vec4, by: f32) -> Vec4 {
    Vec4::new(v.x * by, v.y * by, v.z * by)
}

/// Calls `op` checked, each argument in a place of its own, which a guard page can be next to.
fn call_alone<A: Plain, B: Plain, O: Plain>(op: Op<A, B, O>, a: &A, b: &B) -> (O, Vec<Fault>) {
    let (a, b, mut out) = (vec![*a], vec![*b], vec![O::ZERO]);
    let broken = faults(|| op.call_into(&mut out[0], &a[0], &b[0]));
    (out[0], broken)
}

/// Calls `op` checked, and gives its result: a scalar in the first lane.
///
/// # Panics
/// Where `input` is not of its kind.
pub fn call(op: OpRef, input: &Input) -> (Vec4, Vec<Fault>) {
    let scalar = |(x, broken)| (Vec4 { x, ..Vec4::default() }, broken);
    match (op, input) {
        (OpRef::Vector(op), Input::Vectors(a, b)) => call_alone(op, a, b),
        (OpRef::Scale(op), Input::Scale(a, b)) => call_alone(op, a, b),
        (OpRef::Lambert(op), Input::Lambert(a, b)) => call_alone(op, a, b),
        (OpRef::Scalar(op), Input::Vectors(a, b)) => scalar(call_alone(op, a, b)),
        (OpRef::Sphere(op), Input::Sphere(a, b)) => scalar(call_alone(op, a, b)),
        (OpRef::Triangle(op), Input::Triangle(a, b)) => scalar(call_alone(op, a, b)),
        _ => panic!("{input:?} is not what the operation takes"),
    }
}
