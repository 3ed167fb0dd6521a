//! Signs that the picture of a scene is probably not what its author meant, found without
//! tracing it.

use glam::{DVec3, Vec3};

use super::Scene;
use crate::reference::geometry;

/// A colour with a channel above this is probably in levels from 0 to 255: no author means an
/// object that reflects ten times the light it receives.
const BRIGHT: f32 = 10.0;

/// The focal distance above which the format's film, whose diagonal is 1, sees less than 6
/// degrees.
const LONG: f32 = 10.0;

impl Scene {
    /// Probable mistakes in the scene, a line each. Costs at most as much as tracing four rays
    /// by brute force.
    pub fn doubts(&self) -> Vec<String> {
        let (mut doubts, camera) = (Vec::new(), &self.camera);
        if self.lights.iter().all(|light| light.radiance() == DVec3::ZERO) {
            doubts.push("the scene has no light: whatever is seen is black".to_owned());
        }
        if let Some(colour) = self.colour_in_levels() {
            let [red, green, blue] = colour.to_array();
            doubts.push(format!(
                "an object has the colour {red} {green} {blue}, and white is 1 1 1: are levels of 255 meant? divide them by 255"
            ));
        }
        if !self.reaches_in_front() {
            doubts.push("nothing is in front of the camera, which looks along +z from the origin".to_owned());
        } else if camera.film() == 1.0 && camera.focal() > LONG && self.covers_corners() {
            doubts.push(format!(
                "every ray hits, as through a long lens: is the focal distance of {} meant for the film of an old scene? try \
                 `--film 35`",
                camera.focal(),
            ));
        }
        doubts
    }

    /// The first colour of a sphere or single triangle (not of a mesh) that is much brighter
    /// than white and whose channels are all integers up to 255.
    fn colour_in_levels(&self) -> Option<Vec3> {
        let of_spheres = self.spheres.iter().map(|sphere| sphere.colour);
        let mut colours = of_spheres.chain(self.triangles.iter().map(|triangle| triangle.colour));
        let is_level = |channel: f32| channel.fract() == 0.0 && channel <= f32::from(u8::MAX);
        colours.find(|colour| colour.max_element() > BRIGHT && colour.to_array().into_iter().all(is_level))
    }

    fn reaches_in_front(&self) -> bool {
        self.spheres.iter().any(|sphere| sphere.centre.z + sphere.radius > 0.0)
            || self.all_triangles().any(|triangle| triangle.vertices.iter().any(|vertex| vertex.z > 0.0))
    }

    /// Whether the rays through all four corners of the picture hit something. Then nearly all
    /// rays hit, unless the objects form a frame around the picture.
    fn covers_corners(&self) -> bool {
        let camera = &self.camera;
        let grid = camera.grid::<f64>();
        let (right, bottom) = (camera.width() - 1, camera.height() - 1);
        [(0, 0), (0, right), (bottom, 0), (bottom, right)].into_iter().all(|(row, column)| {
            let ray = DVec3::from_array(grid.ray(row, column)).normalize();
            let sphere = |centre: DVec3, radius| geometry::sphere(ray, centre, radius).is_some();
            self.spheres.iter().any(|s| sphere(s.centre.as_dvec3(), s.radius.into()))
                || self.all_triangles().any(|t| geometry::triangle(ray, t.vertices.map(|v| v.as_dvec3())).is_some())
        })
    }
}
