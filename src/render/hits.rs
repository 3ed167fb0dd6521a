//! What an engine finds at a pixel before shading, to measure errors.

use std::ops::Add;

use glam::DVec3;

use crate::scene::Object;

/// The visible point at a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The first object that the ray hits.
    pub object: Object,
    /// The point in the camera's frame: z is the depth, and its length the distance from the pinhole.
    pub place: DVec3,
    /// The unit normal, of a triangle on either side. None if the engine cannot give it.
    pub normal: Option<DVec3>,
}

/// An engine's hit at a pixel, in its own numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// The first object that the ray hits.
    pub object: Object,
    /// The point t r_d.
    pub distance: Distance,
    /// The unit normal, of a triangle on either side. None if the engine cannot give it.
    pub normal: Option<DVec3>,
}

/// t, or what an engine has in its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distance {
    /// t.
    T(f64),
    /// 1/t.
    Inverse(f64),
}

impl Distance {
    /// t.
    pub fn t(self) -> f64 {
        match self {
            Distance::T(t) => t,
            Distance::Inverse(inverse) => 1.0 / inverse,
        }
    }
}

/// Rays, and how many of them hit something.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counted {
    /// Rays whose light is in the picture.
    pub rays: u64,
    /// Those that hit something.
    pub hits: u64,
}

impl Add for Counted {
    type Output = Counted;

    fn add(self, other: Counted) -> Counted {
        Counted { rays: self.rays + other.rays, hits: self.hits + other.hits }
    }
}
