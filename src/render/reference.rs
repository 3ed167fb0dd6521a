//! The engine `reference`: Algorithm 1 in f64; also the first hit of every ray.

use std::ops::Range;

use glam::DVec3;

use super::film::with_pixels;
use super::{
    Counted, Distance, FilmMut, Found, Pixel, PixelFormat, Tracer, Wanted, assert_rows, existing_pixels, is_wanted,
};
use crate::kernels::Vec4;
use crate::reference::geometry;
use crate::scene::{Grid, Object, Scene};

/// The first hit of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// The object.
    pub object: Object,
    /// The distance t; the hit is at the point t r_d.
    pub t: f64,
}

struct Light {
    position: DVec3,
    radiance: DVec3,
}

struct Sphere {
    centre: DVec3,
    radius: f64,
    colour: DVec3,
}

struct Triangle {
    vertices: [DVec3; 3],
    /// The unit normal; NaN for a triangle without an area, which is then never hit.
    normal: DVec3,
    colour: DVec3,
}

/// A scene in f64.
pub struct ReferenceTracer {
    size: [u32; 2],
    grid: Grid<f64>,
    lights: Vec<Light>,
    spheres: Vec<Sphere>,
    triangles: Vec<Triangle>,
    shadows: bool,
}

impl ReferenceTracer {
    /// Converts `scene` to f64, which holds its f32 numbers exactly.
    pub fn new(scene: &Scene) -> Self {
        let lights = scene.lights.iter().map(|light| Light {
            position: light.position.as_dvec3(),
            radiance: f64::from(light.intensity) * light.colour.as_dvec3(),
        });
        let spheres = scene.spheres.iter().map(|sphere| Sphere {
            centre: sphere.centre.as_dvec3(),
            radius: sphere.radius.into(),
            colour: sphere.colour.as_dvec3(),
        });
        let triangles = scene.all_triangles().map(|triangle| {
            let vertices = triangle.vertices.map(|v| v.as_dvec3());
            Triangle {
                vertices,
                normal: geometry::triangle_plane(vertices).normalize(),
                colour: triangle.colour.as_dvec3(),
            }
        });
        ReferenceTracer {
            size: [scene.camera.width(), scene.camera.height()],
            grid: scene.camera.grid(),
            lights: lights.collect(),
            spheres: spheres.collect(),
            triangles: triangles.collect(),
            shadows: scene.shadows,
        }
    }

    fn ray(&self, row: u32, col: u32) -> DVec3 {
        self.grid.ray(row, col).into()
    }

    /// The nearest hit of the ray through a pixel; if several are equally near, the first in the
    /// scene.
    pub fn hit(&self, row: u32, col: u32) -> Option<Hit> {
        let d = self.ray(row, col);
        let spheres = self.spheres.iter().enumerate();
        let spheres = spheres.map(|(i, s)| (Object::Sphere(i), geometry::sphere(d, s.centre, s.radius)));
        let triangles = self.triangles.iter().enumerate();
        let triangles = triangles.map(|(i, s)| (Object::Triangle(i), geometry::triangle(d, s.vertices)));
        let hits = spheres.chain(triangles).filter_map(|(object, t)| Some(Hit { object, t: t? }));
        hits.reduce(|nearest, hit| if hit.t < nearest.t { hit } else { nearest })
    }

    /// The unit normal of an object at the point `p` of its surface.
    fn normal(&self, object: Object, p: DVec3) -> DVec3 {
        match object {
            Object::Sphere(i) => geometry::sphere_normal(p, self.spheres[i].centre),
            Object::Triangle(i) => self.triangles[i].normal,
        }
    }

    /// The linear colour of a pixel, not clamped.
    pub fn colour(&self, row: u32, col: u32) -> DVec3 {
        self.colour_of_hit(row, col).unwrap_or(DVec3::ZERO)
    }

    fn colour_of_hit(&self, row: u32, col: u32) -> Option<DVec3> {
        let Hit { object, t } = self.hit(row, col)?;
        let p = t * self.ray(row, col);
        let n = self.normal(object, p);
        let (colour, cosine): (DVec3, Box<dyn Fn(DVec3) -> f64>) = match object {
            Object::Sphere(i) => (self.spheres[i].colour, Box::new(move |light| geometry::lambert(light, p, n))),
            Object::Triangle(i) => {
                (self.triangles[i].colour, Box::new(move |light| geometry::lambert_two_sided(light, p, n)))
            }
        };
        let lights =
            self.lights.iter().filter(|light| !self.shadows || self.reaches(light.position, object, p, f64::EPSILON));
        Some(lights.map(|light| cosine(light.position) * light.radiance * colour).sum())
    }

    /// Whether a light reaches the visible point `p` of an object: neither another object nor the
    /// object's own surface is between them. `epsilon` is that of the type to which `p` was
    /// rounded.
    pub(super) fn reaches(&self, light: DVec3, object: Object, p: DVec3, epsilon: f64) -> bool {
        let is_turned_away = match object {
            Object::Sphere(i) => geometry::power(self.spheres[i].centre, self.spheres[i].radius) <= 0.0,
            Object::Triangle(i) => geometry::triangle_is_turned_away(light, self.triangles[i].vertices),
        };
        let mut spheres = (0..).map(Object::Sphere).zip(&self.spheres).filter(|(other, _)| *other != object);
        let mut triangles = (0..).map(Object::Triangle).zip(&self.triangles).filter(|(other, _)| *other != object);
        !is_turned_away
            && !spheres.any(|(_, s)| geometry::sphere_hides(light, p, s.centre, s.radius, epsilon))
            && !triangles.any(|(_, s)| geometry::triangle_hides(light, p, s.vertices, epsilon))
    }
}

impl Tracer for ReferenceTracer {
    fn writes(&self, _: PixelFormat) -> bool {
        true
    }

    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
        assert_rows(&rows, self.size, out.len());
        let pixels = existing_pixels(rows, self.size).map(|(row, col)| self.colour(row, col));
        with_pixels!(FilmMut(out) = out => pixels.zip(out).for_each(|(colour, out)| *out = Pixel::of_colour(colour)));
    }

    fn light(&self, rows: Range<u32>, wanted: &Wanted<'_>, background: Vec4, out: &mut [Vec4]) -> Option<Counted> {
        assert_rows(&rows, self.size, out.len());
        let pixels = existing_pixels(rows, self.size).zip(out);
        for ((row, col), out) in pixels.filter(|((row, col), _)| is_wanted(wanted, *row, *col)) {
            *out = self.colour_of_hit(row, col).map_or(background, Pixel::of_colour);
        }
        None
    }

    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        let found = |row, col| {
            let Hit { object, t } = self.hit(row, col)?;
            let normal = self.normal(object, t * self.ray(row, col));
            Some(Found { object, distance: Distance::T(t), normal: Some(normal) })
        };
        existing_pixels(rows, self.size).map(|(row, col)| found(row, col)).collect()
    }
}
