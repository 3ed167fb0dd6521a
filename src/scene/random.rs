//! Scenes generated from a seed, and the random number generator. The results are the same on every
//! machine.

use std::f32::consts::PI;

use glam::Vec3;

use super::{Camera, Light, Scene, Sphere, Triangle};

/// SplitMix64 (Steele, Lea and Flood, 2014): a counter that advances by the golden ratio times
/// 2^64, and a mixing function.
///
/// Not cryptographically secure. The sequence of a seed never changes between versions.
#[derive(Clone, Debug)]
pub struct Rng {
    state: u64,
}

impl Rng {
    /// The generator at the start of the sequence of this seed.
    pub fn new(seed: u64) -> Self {
        Rng { state: seed }
    }

    /// A uniformly distributed value.
    pub fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.state;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// A uniform number in [0, 1), a multiple of 2⁻²⁴.
    pub fn next_f32(&mut self) -> f32 {
        (self.next_u64() >> 40) as f32 / (1 << 24) as f32
    }

    /// A uniform number between `low` and `high`. Rounding may produce `high` itself.
    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.next_f32()
    }
}

#[cfg(all(test, feature = "files"))]
impl Rng {
    /// Mutates a text at one position: inserts one of `pieces`, replaces a byte by one, or removes
    /// up to three bytes.
    pub(crate) fn change(&mut self, text: &mut Vec<u8>, pieces: &[&[u8]]) {
        if text.is_empty() {
            return;
        }
        let at = (self.next_u64() % text.len() as u64) as usize;
        let piece = pieces[(self.next_u64() % pieces.len() as u64) as usize].iter().copied();
        match self.next_u64() % 3 {
            0 => drop(text.splice(at..at, piece)),
            1 => drop(text.splice(at..=at, piece)),
            _ => drop(text.drain(at..(at + 3).min(text.len()))),
        }
    }
}

/// The share of the picture that the objects would cover if none overlapped.
const COVER: f32 = 0.55;
/// The smallest and the largest depth of objects.
const DEPTHS: (f32, f32) = (20.0, 60.0);
/// Half of the width and height that the camera sees at depth 1: a film of diagonal 1 in the format
/// 4:3 is 0.8 wide and 0.6 high.
const HALF_VIEW: (f32, f32) = (0.4, 0.3);

/// A scene of small spheres and triangles of various sizes, spread evenly over the picture at
/// various depths, under two lights; 640 x 480 pixels, focal distance 1, film diagonal 1.
///
/// All numbers have at most three decimals. The same arguments give the same scene on every
/// machine.
pub fn many(spheres: usize, triangles: usize, seed: u64) -> Scene {
    let mut rng = Rng::new(seed);
    let mut spots = Spots::new(&mut rng, spheres.saturating_add(triangles));
    let spheres = (0..spheres).map(|_| spots.next(&mut rng).sphere()).collect();
    let triangles = (0..triangles).map(|_| spots.next(&mut rng).triangle(&mut rng)).collect();
    let light = |intensity, colour, position| Light { intensity, colour, position };
    Scene {
        name: "many.png".to_owned(),
        lights: vec![
            light(0.9, Vec3::new(1.0, 0.95, 0.85), Vec3::new(-20.0, 25.0, -5.0)),
            light(0.35, Vec3::new(0.6, 0.75, 1.0), Vec3::new(30.0, -10.0, 10.0)),
        ],
        spheres,
        triangles,
        ..Scene::new(Camera::new(640, 480, 1.0, 1.0).expect("a camera within the limits"))
    }
}

/// The position, size and colour of an object.
struct Spot {
    centre: Vec3,
    /// Half of the object's extent.
    size: f32,
    colour: Vec3,
}

/// A sequence of points that fills the picture evenly: each step adds an irrational share of the
/// width and of the height. The shares are those of Roberts' R₂ sequence, 1/g and 1/g², where
/// g³ = g + 1: they leave the smallest gaps.
struct Spots {
    across: f32,
    up: f32,
    /// The mean radius of an object, as seen at depth 1.
    radius: f32,
}

impl Spots {
    fn new(rng: &mut Rng, count: usize) -> Self {
        let view = 4.0 * HALF_VIEW.0 * HALF_VIEW.1;
        // `count` circles of this radius have the area COVER times the picture's.
        let radius = (COVER * view / (PI * count.max(1) as f32)).sqrt();
        Spots { across: rng.next_f32(), up: rng.next_f32(), radius }
    }

    fn next(&mut self, rng: &mut Rng) -> Spot {
        self.across = (self.across + 0.754_877_7).fract();
        self.up = (self.up + 0.569_840_3).fract();
        let depth = rng.between(DEPTHS.0, DEPTHS.1);
        let x = HALF_VIEW.0 * (2.0 * self.across - 1.0);
        let y = HALF_VIEW.1 * (2.0 * self.up - 1.0);
        // Squaring makes small objects frequent and large ones rare.
        let large = rng.next_f32();
        let size = self.radius * depth * (0.45 + 1.5 * large * large);
        // The hue varies along the diagonal of the picture, plus a random part.
        let hue = 0.45 * (self.across + self.up) + rng.between(0.0, 0.25);
        let colour = colour(hue, rng.between(0.45, 0.85), rng.between(0.75, 1.0));
        Spot { centre: Vec3::new(x * depth, y * depth, depth), size, colour }
    }
}

impl Spot {
    fn sphere(&self) -> Sphere {
        Sphere { radius: tidy(self.size), colour: self.colour, centre: self.centre.map(tidy) }
    }

    /// A triangle around the point, slightly irregular, with a random orientation.
    fn triangle(&self, rng: &mut Rng) -> Triangle {
        let (x, y) = direction(rng);
        let slope = (rng.between(-1.0, 1.0), rng.between(-1.0, 1.0));
        // Rotation by a third of a turn. Constants, since the sine function differs between
        // machines.
        const COSINE: f32 = -0.5;
        const SINE: f32 = 0.866_025_4;
        let third = |(x, y): (f32, f32)| (COSINE * x - SINE * y, SINE * x + COSINE * y);
        let mut corner = |(x, y): (f32, f32)| {
            let reach = self.size * rng.between(1.0, 1.7);
            (self.centre + reach * Vec3::new(x, y, slope.0 * x + slope.1 * y)).map(tidy)
        };
        let vertices = [corner((x, y)), corner(third((x, y))), corner(third(third((x, y))))];
        Triangle { colour: self.colour, vertices }
    }
}

/// A random unit vector in the plane: a random point of the unit disc, normalised.
pub fn direction(rng: &mut Rng) -> (f32, f32) {
    loop {
        let (x, y) = (rng.between(-1.0, 1.0), rng.between(-1.0, 1.0));
        let length = (x * x + y * y).sqrt();
        if (0.1..=1.0).contains(&length) {
            return (x / length, y / length);
        }
    }
}

/// The RGB colour of a hue (1 is a full turn), a saturation and a value in [0, 1].
fn colour(hue: f32, saturation: f32, value: f32) -> Vec3 {
    // Over the hue, each channel is a trapezoid, shifted by a third of a turn against the others.
    let channel = |shift: f32| {
        let share = (((hue + shift).fract() * 6.0 - 3.0).abs() - 1.0).clamp(0.0, 1.0);
        tidy(value * (1.0 - saturation * (1.0 - share)))
    };
    Vec3::new(channel(0.0), channel(2.0 / 3.0), channel(1.0 / 3.0))
}

/// A number rounded to three decimals, so that the scene's text is easy to read.
fn tidy(number: f32) -> f32 {
    (number * 1000.0).round() / 1000.0
}
