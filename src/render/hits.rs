//! What an engine finds at a pixel before shading, to measure errors.

use std::ops::Add;

use glam::DVec3;

use crate::scene::Object;

/// The visible point at a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The first object that the ray hits.
    pub object: Object,
    /// The point in the camera's frame: its z is the depth, and its length is the distance from the
    /// pinhole.
    pub place: DVec3,
    /// The unit normal; for a triangle, either of its two. None if the engine cannot give it.
    pub normal: Option<DVec3>,
}

/// What a tracer finds at a pixel. [`Frame::hit`](super::Frame::hit) makes a [`Hit`] of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// The first object that the ray hits.
    pub object: Object,
    /// How far along the ray the hit is.
    pub distance: Distance,
    /// The unit normal; for a triangle, either of its two. None if the engine cannot give it.
    pub normal: Option<DVec3>,
}

/// How far along its ray a hit is. The point is t r_d, where the z of r_d is the focal distance, so
/// that t is the depth in focal distances. Engines that compute with planes over the picture have
/// 1/t.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distance {
    /// The distance t.
    T(f64),
    /// Its inverse, 1/t.
    Inverse(f64),
}

impl Distance {
    /// The distance t, computed from 1/t if need be.
    pub fn t(self) -> f64 {
        match self {
            Distance::T(t) => t,
            Distance::Inverse(inverse) => 1.0 / inverse,
        }
    }
}

/// The number of rays, and of the rays that hit something.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counted {
    /// Rays that contribute to the picture.
    pub rays: u64,
    /// Rays that hit something.
    pub hits: u64,
}

impl Add for Counted {
    type Output = Counted;

    fn add(self, other: Counted) -> Counted {
        Counted { rays: self.rays + other.rays, hits: self.hits + other.hits }
    }
}
