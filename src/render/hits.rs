//! What an engine finds at a pixel before it becomes a colour, for measuring errors.

use glam::DVec3;

use crate::scene::Object;

/// What an engine finds at a pixel, in its own numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// What the ray hits first.
    pub object: Object,
    /// Where: the point t r_d.
    pub distance: Distance,
    /// The unit normal, of a triangle on either side. None where the engine cannot tell.
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
