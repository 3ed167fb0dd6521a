//! Checks the numbers of scenes that programs build.

use glam::Vec3;

use super::Scene;

/// An invalid number of a scene.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field} must be {expected}, not {found}")]
pub struct InvalidScene {
    /// What the number is: "sphere 2's radius", for example, counted from 1 in the scene's order.
    pub field: String,
    /// The valid values.
    pub expected: &'static str,
    /// The invalid value.
    pub found: String,
}

const FINITE: &str = "finite";
const POSITIVE: &str = "finite and greater than 0";
const NOT_NEGATIVE: &str = "finite and at least 0";

impl Scene {
    /// Checks that every number is valid. Scenes read from files always are.
    ///
    /// # Errors
    /// The first invalid number.
    pub fn check(&self) -> Result<(), InvalidScene> {
        self.check_lights()?;
        for (i, sphere) in self.spheres.iter().enumerate() {
            if !(sphere.radius.is_finite() && sphere.radius > 0.0) {
                return invalid("sphere", i, "radius", POSITIVE, sphere.radius.to_string());
            } else if !bright(sphere.colour) {
                return invalid("sphere", i, "colour", NOT_NEGATIVE, sphere.colour.to_string());
            } else if !sphere.centre.is_finite() {
                return invalid("sphere", i, "centre", FINITE, sphere.centre.to_string());
            }
        }
        for (i, triangle) in self.all_triangles().enumerate() {
            if !bright(triangle.colour) {
                return invalid("triangle", i, "colour", NOT_NEGATIVE, triangle.colour.to_string());
            } else if let Some(vertex) = triangle.vertices.iter().find(|vertex| !vertex.is_finite()) {
                return invalid("triangle", i, "vertices", FINITE, vertex.to_string());
            }
        }
        Ok(())
    }

    /// Checks the lights only, since checking a million objects takes a while.
    pub(crate) fn check_lights(&self) -> Result<(), InvalidScene> {
        for (i, light) in self.lights.iter().enumerate() {
            if !(light.intensity.is_finite() && light.intensity >= 0.0) {
                return invalid("light", i, "intensity", NOT_NEGATIVE, light.intensity.to_string());
            } else if !bright(light.colour) {
                return invalid("light", i, "colour", NOT_NEGATIVE, light.colour.to_string());
            } else if !light.position.is_finite() {
                return invalid("light", i, "position", FINITE, light.position.to_string());
            }
        }
        Ok(())
    }
}

fn bright(colour: Vec3) -> bool {
    colour.is_finite() && colour.cmpge(Vec3::ZERO).all()
}

fn invalid(thing: &str, i: usize, field: &str, expected: &'static str, found: String) -> Result<(), InvalidScene> {
    Err(InvalidScene { field: format!("{thing} {}'s {field}", i + 1), expected, found })
}

#[cfg(test)]
mod tests {
    use super::super::many;

    #[test]
    fn what_is_below_its_least_is_named_and_what_is_not_passes() {
        let scene = many(2, 2, 1);
        assert_eq!(scene.check(), Ok(()));
        let mut dark = scene.clone();
        dark.lights[1].intensity = -1.0;
        assert_eq!(dark.check().unwrap_err().to_string(), "light 2's intensity must be finite and at least 0, not -1");
        let mut dark = scene.clone();
        dark.triangles[0].colour.y = -0.5;
        assert_eq!(dark.check().unwrap_err().field, "triangle 1's colour");
        for radius in [0.0, -1.0] {
            let mut none = scene.clone();
            none.spheres[0].radius = radius;
            assert_eq!(none.check().unwrap_err().field, "sphere 1's radius");
        }
    }
}
