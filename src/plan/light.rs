//! Which lights give an object anything, where it is seen.

use glam::DVec3;

use super::omission::{Keep, Omission};
use super::spans::Scale;
use crate::kernels::{Element, ObjectLight};
use crate::scene::{Light, Scene};

/// A light is said not to reach a sphere if the numerator of eq. 11's cosine is below 0 by this share of its terms
/// wherever the sphere is seen; all that rounding and estimates do to it, in f32 too, is a hundredth of that.
const MARGIN: f64 = 1e-3;

/// Lights further than this, in the unit of their object, are brought to this distance: L is the same for all points of
/// the object to the last bit of f64, and |L|^2 is within the range of f32.
const FAR_LIGHT: f64 = (1u64 << 60) as f64;

/// One light as one object sees it.
pub struct LightOn<'a> {
    light: &'a Light,
    /// From a sphere's centre, in units of its radius.
    pub to_light: DVec3,
    /// From where the records see the object, in units of its size.
    seen: DVec3,
    /// For triangles: the height above its plane, in units of its size.
    height: f64,
    /// Whether any point that the camera sees reflects some of it.
    pub reaches: bool,
}

/// The lights that are not dark; or all.
pub fn lights(scene: &Scene, keep: Keep) -> Vec<&Light> {
    scene.lights.iter().filter(|light| !is_dark(light) || keep.has(Omission::DarkLights)).collect()
}

/// Whether it has no intensity or no colour.
pub fn is_dark(light: &Light) -> bool {
    light.radiance().max_element() == 0.0
}

impl<'a> LightOn<'a> {
    /// On a sphere about `centre`, in units of its radius and seen from `centre`: `to_light` is, too, and `seen` is from
    /// where its records see it.
    ///
    /// Only points n with n . l > 1 are lit. Those of the far wall, which a camera inside sees, are in any direction;
    /// those of the near wall are about -c, at angles of which the cosine is 1 / |c| or more.
    pub fn on_sphere(centre: DVec3, to_light: DVec3, seen: DVec3, colour: DVec3, light: &'a Light) -> Self {
        let (distance, camera) = (to_light.length(), centre.length());
        let brightest = if camera <= 1.0 || distance == 0.0 {
            distance
        } else {
            let angle = (-to_light.dot(centre) / (distance * camera)).clamp(-1.0, 1.0).acos();
            distance * (angle - (1.0 / camera).acos()).max(0.0).cos()
        };
        // What is not known to be dark is lit: a NaN too.
        let dark = brightest - 1.0 < -MARGIN * (1.0 + distance);
        let reflects = Scale::Linear.weights(light, colour).max_element() > 0.0;
        LightOn { light, to_light, seen, height: 0.0, reaches: reflects && !dark }
    }

    /// On a triangle above whose plane the light is at `height`, `seen` from where its records see it: its two sides are
    /// lit alike, from everywhere but its own plane.
    pub fn on_triangle<E: Element>(height: f64, seen: DVec3, colour: DVec3, light: &'a Light) -> Self {
        let reflects = Scale::Linear.weights(light, colour).max_element() > 0.0;
        let reaches = reflects && E::from_f64(brought_near(seen) * height) != E::ZERO;
        LightOn { light, to_light: seen, seen, height, reaches }
    }

    /// Whether it has no intensity or no colour.
    pub fn is_dark(&self) -> bool {
        is_dark(self.light)
    }

    /// Whether it is among those that the object is shaded by.
    pub fn is_kept(&self, keep: Keep) -> bool {
        self.reaches || keep.has(Omission::IdleLights) || self.is_dark() && keep.has(Omission::DarkLights)
    }

    /// I_L C in a scale.
    pub fn weights(&self, scale: Scale, colour: DVec3) -> DVec3 {
        scale.weights(self.light, colour)
    }

    /// As kernels read it.
    pub fn record<E: Element>(&self, scale: Scale, colour: DVec3) -> ObjectLight<E> {
        let share = brought_near(self.seen);
        let (DVec3 { x, y, z }, weights) = (share * self.seen, self.weights(scale, colour));
        let cosine = share * self.height;
        ObjectLight { x, y, z, cosine, red: weights.x, green: weights.y, blue: weights.z, padding: 0.0 }.round()
    }
}

/// What share of its distance brings a light that is too far to [`FAR_LIGHT`].
fn brought_near(seen: DVec3) -> f64 {
    FAR_LIGHT / seen.abs().max_element().max(FAR_LIGHT)
}

/// Whether f32 holds the light of so many on one object, in levels too, with room for what its sum is rounded to.
pub fn is_in_f32(light: DVec3) -> bool {
    light.max_element() <= f64::from(f32::MAX) / 512.0
}

impl Scale {
    /// I_L C.
    fn weights(self, light: &Light, colour: DVec3) -> DVec3 {
        light.radiance() * (self.white() * colour)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Vec3, dvec3};

    const WHITE: DVec3 = DVec3::ONE;

    fn lamp(colour: Vec3) -> Light {
        Light { intensity: 1.0, colour, position: Vec3::ZERO }
    }

    #[test]
    fn a_light_behind_a_sphere_or_in_it_does_not_reach_what_is_seen_of_it() {
        let white = lamp(Vec3::ONE);
        // The camera sees the points about (0, 0, -1) of a sphere two radii away: those within 60 degrees.
        let centre = dvec3(0.0, 0.0, 2.0);
        for (light, reaches) in [
            (dvec3(0.0, 0.0, -9.0), true),
            (dvec3(0.0, 0.0, 9.0), false),
            (dvec3(0.0, 0.0, -0.9), false),
            (dvec3(0.0, 0.0, 0.0), false),
            (dvec3(9.0, 0.0, 0.0), true),
            (dvec3(0.0, 0.0, 1e30), false),
            // A light that is far away reaches them from up to 150 degrees.
            (1e6 * dvec3(0.49, 0.0, 0.872), false),
            (1e6 * dvec3(0.51, 0.0, 0.860), true),
            (1e6 * dvec3(0.48, 0.0, 0.877), false),
            (dvec3(f64::NAN, 0.0, 0.0), true),
        ] {
            let on = LightOn::on_sphere(centre, light, light, WHITE, &white);
            assert_eq!(on.reaches, reaches, "{light}");
        }
    }

    #[test]
    fn from_inside_a_sphere_each_light_outside_is_seen_and_none_within() {
        let white = lamp(Vec3::ONE);
        for (light, reaches) in
            [(dvec3(0.0, 0.0, 0.9), false), (dvec3(0.0, 3.0, 0.0), true), (dvec3(0.0, 0.0, -3.0), true)]
        {
            let on = LightOn::on_sphere(dvec3(0.0, 0.0, 0.5), light, light, WHITE, &white);
            assert_eq!(on.reaches, reaches, "{light}");
        }
    }

    #[test]
    fn a_light_reaches_both_sides_of_a_triangle_but_not_from_its_plane() {
        let white = lamp(Vec3::ONE);
        for (light, reaches) in
            [(dvec3(1.0, 2.0, 3.0), true), (dvec3(1.0, 2.0, -3.0), true), (dvec3(1.0, 2.0, 0.0), false)]
        {
            let on = LightOn::on_triangle::<f32>(light.z.abs(), light, WHITE, &white);
            assert_eq!(on.reaches, reaches, "{light}");
        }
    }

    #[test]
    fn a_light_does_not_reach_what_does_not_reflect_its_colour() {
        for (light, colour, reaches) in [
            (Vec3::X, DVec3::Y, false),
            (Vec3::X, DVec3::X, true),
            (Vec3::ZERO, DVec3::ONE, false),
            (Vec3::ONE, DVec3::ZERO, false),
        ] {
            let towards = dvec3(0.0, 0.0, -9.0);
            let light = lamp(light);
            assert_eq!(LightOn::on_sphere(2.0 * DVec3::Z, towards, towards, colour, &light).reaches, reaches);
            assert_eq!(LightOn::on_triangle::<f32>(9.0, towards, colour, &light).reaches, reaches);
        }
    }
}
