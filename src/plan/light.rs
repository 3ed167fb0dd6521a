//! Which lights contribute to the visible part of an object.

use glam::DVec3;

use crate::scene::{Light, Scene};

/// A light does not reach a sphere if the numerator of eq. 11's cosine is below 0 by this share of
/// its terms wherever the sphere is visible; rounding and estimates, in f32 too, change it by a
/// hundredth of that.
const MARGIN: f64 = 1e-3;

/// The lights that are not dark.
pub fn lights(scene: &Scene) -> Vec<&Light> {
    scene.lights.iter().filter(|light| !is_dark(light)).collect()
}

/// Whether a light has no intensity or no colour.
pub fn is_dark(light: &Light) -> bool {
    light.radiance().max_element() == 0.0
}

/// Whether a light reaches any visible point of a sphere about `centre`, in units of its radius;
/// `to_light` is the vector from there to the light.
///
/// With the centre at 0 and l the vector to the light, the lit points n of the unit sphere are
/// those with n . l > 1. With c the vector from the camera to the centre, the points visible from
/// the camera, which is outside, have an angle with -c whose cosine is at least 1 / |c|.
pub fn reaches(centre: DVec3, to_light: DVec3) -> bool {
    let (distance, camera) = (to_light.length(), centre.length());
    let angle = (-to_light.dot(centre) / (distance * camera)).clamp(-1.0, 1.0).acos();
    let brightest = distance * (angle - (1.0 / camera).acos()).max(0.0).cos();
    brightest - 1.0 >= -MARGIN * (1.0 + distance)
}

/// Whether f32 holds this sum of the light that all lights may add to an object, times 255 too,
/// with room for the rounding of that sum.
pub fn is_in_f32(light: DVec3) -> bool {
    light.max_element() <= f64::from(f32::MAX) / 512.0
}
