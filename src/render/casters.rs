//! The shadows of the engine `rust`: the questions of [`geometry::sphere_hides`] and [`geometry::triangle_hides`] in f32.
//!
//! On which sides of everything lights stand is found in f64 beforehand: in f32 a light above a large ground would be in it.

use glam::{DVec3, Vec3A};

use super::rust::near_1;
use crate::reference::geometry;
use crate::scene::{self, Object, Scene};

/// What hides lights, and where these are.
pub struct Casters {
    spheres: Vec<Sphere>,
    triangles: Vec<Triangle>,
    /// For each light its sides of the spheres, then of the triangles.
    sides: Vec<(Vec<Side>, Vec<Side>)>,
}

/// Of a sphere the outside is positive, of a triangle the side to which its normal points; 0 is on it.
type Side = i8;

fn side(number: f64) -> Side {
    Side::from(number > 0.0) - Side::from(number < 0.0)
}

struct Sphere {
    centre: Vec3A,
    /// 1 / r: all else is in units of the radius, whose square may be beyond f32.
    scale: f32,
    /// |c|^2 - r^2.
    constant: f32,
}

struct Triangle {
    vertices: [Vec3A; 3],
    /// Near to length 1, and 0 for a triangle of no area.
    normal: Vec3A,
    /// v1 . n: positive if the normal points away from the camera.
    offset: f32,
}

impl Sphere {
    fn new(sphere: &scene::Sphere) -> Self {
        let radius = f64::from(sphere.radius);
        let constant = geometry::power(sphere.centre.as_dvec3(), radius) / (radius * radius);
        Sphere { centre: sphere.centre.into(), scale: (1.0 / radius) as f32, constant: constant as f32 }
    }

    /// Whether it hides a light on this side of it from `p`: so far away, in the direction of length 1.
    fn hides(&self, of_light: Side, (to_light, distance): (Vec3A, f32), p: Vec3A) -> bool {
        let Sphere { centre, scale, constant } = *self;
        let (c, distance) = ((centre - p) * scale, distance * scale);
        let (p, h) = (p * scale, to_light.dot(c));
        let of_p = if p.dot(p) < 1.0 { p.dot(p - 2.0 * centre * scale) + constant } else { c.dot(c) - 1.0 };
        let rounding = 32.0 * f32::EPSILON * p.abs().element_sum();
        if of_light > 0 {
            let disc = if of_p < 1.0 { h * h - of_p } else { 1.0 - c.cross(to_light).length_squared() };
            disc >= 0.0 && h < distance && (h > 0.0 || of_p < -rounding)
        } else {
            of_p > rounding && (of_light < 0 || h < distance)
        }
    }
}

impl Triangle {
    fn new(triangle: &scene::Triangle) -> Self {
        let vertices = triangle.vertices.map(|v| v.as_dvec3());
        let normal = if triangle.has_no_area() { DVec3::ZERO } else { near_1(geometry::triangle_plane(vertices)) };
        let [nearest, ..] = geometry::near_corner_first(vertices);
        let vertices = triangle.vertices.map(Vec3A::from);
        Triangle { vertices, normal: normal.as_vec3a(), offset: nearest.dot(normal) as f32 }
    }

    /// Whether it hides a light on this side of it, in this direction, from `p`.
    fn hides(&self, of_light: Side, to_light: Vec3A, p: Vec3A) -> bool {
        let of_p = self.offset - self.normal.dot(p);
        let rounding = 8.0 * f32::EPSILON * self.normal.abs().dot(p.abs());
        if !(of_p.abs() > rounding && of_p.signum() * f32::from(of_light) < 0.0) {
            return false;
        }
        // Products of lengths may be beyond f32.
        let [v1, v2, v3] = self.vertices.map(|v| (v - p).as_dvec3());
        let to_light = to_light.as_dvec3() * f64::from(of_p.signum());
        [(v1, v2), (v2, v3), (v3, v1)].into_iter().all(|(v, w)| to_light.dot(v.cross(w)) >= 0.0)
    }
}

impl Casters {
    /// Everything, whether or not the camera sees it.
    pub fn new(scene: &Scene) -> Self {
        let sides = scene.lights.iter().map(|light| {
            let at = light.position.as_dvec3();
            let of_sphere = |s: &scene::Sphere| side(geometry::power(s.centre.as_dvec3() - at, s.radius.into()));
            let of_triangle = |triangle: scene::Triangle| {
                let vertices = triangle.vertices.map(|v| v.as_dvec3());
                geometry::triangle_side(vertices, at, 0.0).map_or(0, side)
            };
            (scene.spheres.iter().map(of_sphere).collect(), scene.all_triangles().map(of_triangle).collect())
        });
        Casters {
            spheres: scene.spheres.iter().map(Sphere::new).collect(),
            triangles: scene.all_triangles().map(|triangle| Triangle::new(&triangle)).collect(),
            sides: sides.collect(),
        }
    }

    /// Whether they let a light through to the visible point `p` of an object.
    pub fn let_through(&self, light: usize, to_light: Vec3A, object: Object, p: Vec3A) -> bool {
        let Casters { spheres, triangles, sides } = self;
        let (of_spheres, of_triangles) = &sides[light];
        let is_turned_away = match object {
            Object::Sphere(i) => spheres[i].constant <= 0.0,
            Object::Triangle(i) => triangles[i].offset * f32::from(of_triangles[i]) < 0.0,
        };
        let distance = to_light.length();
        let to_light = to_light / distance;
        let is_hidden_by_sphere =
            |(i, side): (usize, &Side)| Object::Sphere(i) != object && spheres[i].hides(*side, (to_light, distance), p);
        let is_hidden_by_triangle =
            |(i, side): (usize, &Side)| Object::Triangle(i) != object && triangles[i].hides(*side, to_light, p);
        !is_turned_away
            && !of_spheres.iter().enumerate().any(is_hidden_by_sphere)
            && !of_triangles.iter().enumerate().any(is_hidden_by_triangle)
    }
}
