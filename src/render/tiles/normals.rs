//! The normals by which tiles are shaded, from pictures under lights that are infinitely far along the axes.

use std::ops::Range;

use glam::{DVec3, Vec3};

use super::TileTracer;
use crate::kernels::{Element, Vec4};
use crate::plan::Keep;
use crate::reference::geometry;
use crate::render::{FilmMut, Found, Tracer};
use crate::scene::{Light, Object, Scene, Sphere, Triangle};

/// So far away that all points of a scene see it in the same direction.
const FAR: f32 = 1e38;

impl<E: Element> TileTracer<'_, E> {
    /// Adds the normals to what was `found` in `rows`. The kernels keep them in registers; but the cosine to a light along an
    /// axis is a normal's component, or 0 where that points away. It comes through floats, and is as exact as they are.
    pub(super) fn add_normals(&self, rows: Range<u32>, found: &mut [Option<Found>]) {
        let [ahead, back] = [FAR, -FAR].map(|far| self.lit_along_the_axes(far, rows.clone()));
        let cosines = |pixel: Vec4| DVec3::new(pixel.x.into(), pixel.y.into(), pixel.z.into());
        for (found, (ahead, back)) in found.iter_mut().zip(ahead.into_iter().zip(back)) {
            let Some(found) = found else { continue };
            found.normal = Some(match found.object {
                Object::Sphere(_) => cosines(ahead) - cosines(back),
                // Both of its sides are lit alike, and the signs are lost.
                Object::Triangle(i) => {
                    let vertices = self.plan.scene().triangle(i).vertices.map(|vertex| vertex.as_dvec3());
                    cosines(ahead) * geometry::triangle_plane(vertices).signum()
                }
            });
        }
    }

    /// The rows in white, with red light from `far` along x, green along y and blue along z.
    fn lit_along_the_axes(&self, far: f32, rows: Range<u32>) -> Vec<Vec4> {
        let light = |axis: Vec3| Light { intensity: 1.0, colour: axis, position: far * axis };
        let mut faces = self.plan.scene().faces.clone();
        faces.paint(Vec3::ONE);
        let scene = Scene {
            name: String::new(),
            camera: *self.plan.camera(),
            lights: [Vec3::X, Vec3::Y, Vec3::Z].map(light).to_vec(),
            spheres: self.plan.scene().spheres.iter().map(|sphere| Sphere { colour: Vec3::ONE, ..*sphere }).collect(),
            triangles: self.plan.scene().triangles.iter().map(|face| Triangle { colour: Vec3::ONE, ..*face }).collect(),
            faces,
        };
        let tracer = TileTracer::planned(self.packets, self.kernels, &scene, (Keep::NOTHING, 1));
        let mut out = vec![Vec4::default(); rows.len() * self.plan.camera().width() as usize];
        tracer.rows(rows, FilmMut::F32x4(&mut out));
        out
    }
}
