//! The reasons why an object covers no pixel.

use glam::DVec3;

use super::omission::Omission;
use crate::reference::geometry;
use crate::scene::{Grid, Sphere, Triangle};

/// A pyramid of rays, and the reasons why an object covers none of their pixels.
#[derive(Clone, Copy, Debug)]
pub struct Frustum {
    /// The unit normals of the planes through the camera and the picture's four sides, pointing
    /// outwards.
    sides: [DVec3; 4],
}

impl Frustum {
    /// The frustum of a picture.
    pub fn new(&Grid { half_width, half_height, focal, .. }: &Grid<f64>) -> Self {
        Frustum::between([-half_width, half_width], [-half_height, half_height], focal)
    }

    /// The frustum of the rays whose x and y, at the focal distance, are in these ranges.
    pub fn between([left, right]: [f64; 2], [low, high]: [f64; 2], focal: f64) -> Self {
        let sides = [
            DVec3::new(focal, 0.0, -right),
            DVec3::new(-focal, 0.0, left),
            DVec3::new(0.0, focal, -high),
            DVec3::new(0.0, -focal, low),
        ];
        Frustum { sides: sides.map(DVec3::normalize) }
    }

    /// Why no ray passes within the bounds of a sphere.
    pub fn unseen_sphere(&self, sphere: &Sphere) -> Omission {
        let (centre, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
        if centre.z <= -radius {
            Omission::Behind
        } else if self.sides.iter().any(|side| side.dot(centre) >= radius) {
            Omission::Outside
        } else {
            Omission::Between
        }
    }

    /// Why no ray passes within the bounds of a triangle.
    pub fn unseen_triangle(&self, triangle: &Triangle) -> Omission {
        let corners = triangle.vertices.map(|v| v.as_dvec3());
        if corners.iter().all(|v| v.z <= 0.0) {
            Omission::Behind
        } else if self.sides.iter().any(|side| corners.iter().all(|v| side.dot(*v) >= 0.0)) {
            Omission::Outside
        } else if geometry::has_no_area(corners) {
            Omission::NoArea
        } else {
            Omission::Between
        }
    }
}

/// Why no ray hits a triangle whose bounds contain pixels; None if a ray may hit it.
pub(super) fn never_hit(triangle: &Triangle) -> Option<Omission> {
    let corners = triangle.vertices.map(|v| v.as_dvec3());
    match geometry::triangle_volume(corners) {
        Some(_) => None,
        None if geometry::has_no_area(corners) => Some(Omission::NoArea),
        None => Some(Omission::EdgeOn),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Camera;
    use glam::{Vec3, vec3};

    #[test]
    fn what_has_no_pixel_is_behind_outside_of_no_area_or_between() {
        let frustum = Frustum::new(&Camera::new(160, 120, 1.0, 1.0).unwrap().grid());
        let sphere = |centre: Vec3| frustum.unseen_sphere(&Sphere { radius: 1.0, colour: Vec3::ONE, centre });
        for (centre, why) in [
            (vec3(0.0, 0.0, -1.0), Omission::Behind),
            (vec3(-90.0, 0.0, 20.0), Omission::Outside),
            (vec3(90.0, 0.0, 20.0), Omission::Outside),
            (vec3(0.0, -90.0, 20.0), Omission::Outside),
            (vec3(0.0, 90.0, 20.0), Omission::Outside),
            (vec3(3.0, 3.0, 1e9), Omission::Between),
        ] {
            assert_eq!(sphere(centre), why, "{centre}");
        }
        let triangle = |vertices: [Vec3; 3]| frustum.unseen_triangle(&Triangle { colour: Vec3::ONE, vertices });
        let [a, b, c] = [vec3(1e-3, 0.0, 20.0), vec3(2e-3, 0.0, 20.0), vec3(1e-3, 1e-3, 20.0)];
        for (vertices, why) in [
            ([a, b, c].map(|v| -v), Omission::Behind),
            ([a, b, c].map(|v| v + 90.0 * Vec3::Y), Omission::Outside),
            ([a, b, b], Omission::NoArea),
            ([a, b, c], Omission::Between),
        ] {
            assert_eq!(triangle(vertices), why, "{vertices:?}");
        }
    }
}
