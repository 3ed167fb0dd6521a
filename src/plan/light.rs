//! Which lights contribute to the visible part of an object.

use glam::DVec3;

use crate::scene::{Light, Scene};

/// A light does not reach a sphere if, wherever the sphere is visible, the numerator of eq. 11's
/// cosine is below 0 by this share of its terms. Rounding and estimated roots change it by a
/// hundredth of that, in f32 too.
const MARGIN: f64 = 1e-3;

/// The lights that are not dark.
pub fn lights(scene: &Scene) -> Vec<&Light> {
    scene.lights.iter().filter(|light| !is_dark(light)).collect()
}

/// Whether a light has no intensity or no colour.
pub fn is_dark(light: &Light) -> bool {
    light.radiance().max_element() == 0.0
}

/// Whether a light reaches any visible point of a sphere. `centre` is its position and `to_light`
/// the vector from there to the light, both in units of its radius.
///
/// With the centre at 0 and l the vector to the light, the lit points n of the unit sphere are
/// those with n . l > 1. With c the vector from the camera to the centre, the visible points, for a
/// camera outside, are those whose angle with -c has a cosine of at least 1 / |c|.
pub fn reaches(centre: DVec3, to_light: DVec3) -> bool {
    let (distance, camera) = (to_light.length(), centre.length());
    let angle = (-to_light.dot(centre) / (distance * camera)).clamp(-1.0, 1.0).acos();
    let brightest = distance * (angle - (1.0 / camera).acos()).max(0.0).cos();
    brightest - 1.0 >= -MARGIN * (1.0 + distance)
}

/// Whether f32 can hold the sum of the light that all lights may add to an object, also times 255,
/// with room for the rounding of the sum.
pub fn is_in_f32(light: DVec3) -> bool {
    light.max_element() <= f64::from(f32::MAX) / 512.0
}
