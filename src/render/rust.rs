//! The engine `rust`: Algorithm 1 in f32 with glam's `Vec3A`, written as ordinary Rust.
//!
//! Terms that do not depend on the ray are computed once, and only the nearest hit is shaded.

use std::ops::Range;

use glam::{DVec3, Vec3A, Vec4 as GlamVec4};

use super::reference::ReferenceTracer;
use super::{
    Counted, Distance, FilmMut, Found, PixelFormat, Tracer, Wanted, assert_rows, existing_pixels, is_wanted,
    rows_by_floats,
};
use crate::kernels::Vec4;
use crate::reference::geometry;
use crate::scene::{self, Grid, Object, Scene};

struct Light {
    position: Vec3A,
    radiance: Vec3A,
}

struct Sphere {
    centre: Vec3A,
    /// |c|^2 - r^2, the constant of eq. 5 for rays from the origin.
    constant: f32,
    /// r^2.
    squared_radius: f32,
    /// Whether the centre is at least sqrt 2 radii from the camera.
    far: bool,
    colour: Vec3A,
}

/// The planes of a triangle, computed in f64 and rounded once: in f32 the rounding errors of a
/// triangle without an area, or in a plane through the camera, would look like a plane. The normals
/// are scaled by [`near_1`], so that triangles of any size stay within the range of f32.
struct Triangle {
    /// The index of the triangle in the scene.
    source: usize,
    /// n of eq. 6.
    normal: Vec3A,
    /// v1 . n of eq. 9.
    offset: f32,
    /// For each edge from v to w the normal of the plane through it and the camera, v x w, pointing
    /// inwards.
    edges: [Vec3A; 3],
    colour: Vec3A,
}

impl Triangle {
    /// None for a triangle that no ray hits.
    fn new(source: usize, triangle: scene::Triangle) -> Option<Self> {
        let vertices @ [v1, v2, v3] = triangle.vertices.map(|v| v.as_dvec3());
        let volume = geometry::triangle_volume(vertices)?;
        let normal = near_1(geometry::triangle_plane(vertices));
        let edges = [v1.cross(v2), v2.cross(v3), v3.cross(v1)].map(|edge| near_1(edge) * volume.signum());
        Some(Triangle {
            source,
            normal: normal.as_vec3a(),
            offset: v1.dot(normal) as f32,
            edges: edges.map(|edge| edge.as_vec3a()),
            colour: triangle.colour.into(),
        })
    }
}

/// `v` times the power of two, which is an exact factor, that brings its largest component near 1;
/// 0 stays 0.
fn near_1(v: DVec3) -> DVec3 {
    let size = v.abs().max_element();
    if size == 0.0 { v } else { v * 2f64.powi(-(size.log2() as i32)) }
}

/// The first hit of a ray: the point p = t d, and the unit normal n there.
struct Hit {
    object: Object,
    t: f32,
    p: Vec3A,
    n: Vec3A,
    colour: Vec3A,
}

/// A scene with the terms that do not depend on the ray.
pub struct RustTracer {
    size: [u32; 2],
    grid: Grid<f32>,
    lights: Vec<Light>,
    spheres: Vec<Sphere>,
    triangles: Vec<Triangle>,
    /// Finds which lights are hidden, if the scene has shadows.
    casters: Option<ReferenceTracer>,
}

impl RustTracer {
    /// Computes the terms that do not depend on the ray.
    pub fn new(scene: &Scene) -> Self {
        let lights = scene
            .lights
            .iter()
            .map(|light| Light { position: light.position.into(), radiance: light.radiance_in_f32().into() });
        let spheres = scene.spheres.iter().map(|sphere| {
            let radius = f64::from(sphere.radius);
            let constant = geometry::power(sphere.centre.as_dvec3(), radius);
            Sphere {
                centre: sphere.centre.into(),
                squared_radius: (radius * radius) as f32,
                constant: constant as f32,
                far: constant >= radius * radius,
                colour: sphere.colour.into(),
            }
        });
        RustTracer {
            size: [scene.camera.width(), scene.camera.height()],
            grid: scene.camera.grid(),
            lights: lights.collect(),
            spheres: spheres.collect(),
            triangles: scene
                .all_triangles()
                .enumerate()
                .filter_map(|(source, triangle)| Triangle::new(source, triangle))
                .collect(),
            casters: scene.shadows.then(|| ReferenceTracer::new(scene)),
        }
    }

    /// The nearest hit of the ray `d`.
    #[inline]
    fn hit(&self, d: Vec3A) -> Option<Hit> {
        let mut nearest = f32::INFINITY;
        let mut sphere = None;
        let mut triangle = None;
        let a = d.length_squared();
        for (i, s) in self.spheres.iter().enumerate() {
            let h = d.dot(s.centre);
            // Two forms of the same discriminant: the first does not cancel for far spheres, the
            // second not for near ones.
            let disc =
                if s.far { a * s.squared_radius - s.centre.cross(d).length_squared() } else { h * h - a * s.constant };
            if disc >= 0.0 {
                let q = h + disc.sqrt().copysign(h);
                let near = s.constant / q;
                let t = if near > 0.0 { near } else { q / a };
                if t > 0.0 && t < nearest {
                    nearest = t;
                    sphere = Some(i);
                }
            }
        }
        for s in &self.triangles {
            let t = s.offset / d.dot(s.normal);
            if t > 0.0 && t < nearest && s.edges.iter().all(|edge| d.dot(*edge) >= 0.0) {
                nearest = t;
                triangle = Some(s);
            }
        }
        let (t, p) = (nearest, nearest * d);
        if let Some(s) = triangle {
            Some(Hit { object: Object::Triangle(s.source), t, p, n: s.normal.normalize(), colour: s.colour })
        } else {
            let (i, s) = sphere.map(|i| (i, &self.spheres[i]))?;
            // A sphere can be smaller than the rounding error of P, and its centre then equal P.
            let n = (p - s.centre).normalize_or_zero();
            Some(Hit { object: Object::Sphere(i), t, p, n, colour: s.colour })
        }
    }

    /// The light that a hit reflects in a scene without shadows.
    #[inline(always)]
    fn shade_alone(&self, Hit { object, p, n, colour, .. }: Hit) -> Vec3A {
        match object {
            Object::Triangle(_) => self.shade(p, colour, |l| l.dot(n).abs()),
            Object::Sphere(_) => self.shade(p, colour, |l| l.dot(n).max(0.0)),
        }
    }

    /// The light that a hit reflects in a scene with shadows.
    fn shade_among(&self, casters: &ReferenceTracer, Hit { object, p, n, colour, .. }: Hit) -> Vec3A {
        let reflected = |light: &Light| {
            let cosine = (light.position - p).normalize_or_zero().dot(n);
            let cosine = if matches!(object, Object::Triangle(_)) { cosine.abs() } else { cosine };
            let (from, to, epsilon) = (light.position.as_dvec3(), p.as_dvec3(), f32::EPSILON.into());
            if cosine > 0.0 && casters.reaches(from, object, to, epsilon) {
                cosine * light.radiance * colour
            } else {
                Vec3A::ZERO
            }
        };
        self.lights.iter().map(reflected).sum()
    }

    fn trace(&self, rows: Range<u32>, is_wanted: impl Fn(u32, u32) -> bool, background: Vec4, out: &mut [Vec4]) {
        match &self.casters {
            None => self.trace_by(|hit| self.shade_alone(hit), rows, is_wanted, background, out),
            Some(casters) => self.trace_by(|hit| self.shade_among(casters, hit), rows, is_wanted, background, out),
        }
    }

    #[inline(always)]
    fn trace_by(
        &self,
        shade: impl Fn(Hit) -> Vec3A,
        rows: Range<u32>,
        is_wanted: impl Fn(u32, u32) -> bool,
        background: Vec4,
        out: &mut [Vec4],
    ) {
        assert_rows(&rows, self.size, out.len());
        for (row, out) in rows.zip(out.chunks_exact_mut(self.size[0] as usize)) {
            for (col, out) in (0..self.size[0]).zip(out).filter(|(col, _)| is_wanted(row, *col)) {
                let light = self.hit(self.grid.ray(row, col).into()).map(&shade);
                *out = light.map_or(background, |light| GlamVec4::from((light, 0.0)).to_array().into());
            }
        }
    }

    fn shade(&self, p: Vec3A, colour: Vec3A, cosine: impl Fn(Vec3A) -> f32) -> Vec3A {
        let reflected = |light: &Light| cosine((light.position - p).normalize_or_zero()) * light.radiance * colour;
        self.lights.iter().map(reflected).sum()
    }
}

impl Tracer for RustTracer {
    fn writes(&self, format: PixelFormat) -> bool {
        format == PixelFormat::F32x4
    }

    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>) {
        let FilmMut::F32x4(out) = out else { return rows_by_floats(self, rows, self.size, out) };
        self.trace(rows, |_, _| true, Vec4::default(), out);
    }

    fn light(&self, rows: Range<u32>, wanted: &Wanted<'_>, background: Vec4, out: &mut [Vec4]) -> Option<Counted> {
        self.trace(rows, |row, column| is_wanted(wanted, row, column), background, out);
        None
    }

    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>> {
        let found = |row, col| {
            let Hit { object, t, n, .. } = self.hit(self.grid.ray(row, col).into())?;
            Some(Found { object, distance: Distance::T(t.into()), normal: Some(n.as_dvec3()) })
        };
        existing_pixels(rows, self.size).map(|(row, col)| found(row, col)).collect()
    }
}
