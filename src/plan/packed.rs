//! A scene in the form that kernels with one vector per register read.

use crate::kernels::{Frame, Light, Objects, PaperSphere, PaperTriangle, Plain, Vec4};
use crate::reference::geometry;
use crate::scene::{Object, Scene, Triangle};

/// An object's index is written as two digits in this base, each of which f32 holds exactly.
const DIGIT: usize = 1 << 20;

/// The lights and objects of a scene in arrays, and its rays in f32.
#[derive(Clone, Debug)]
pub struct Packed {
    frame: Frame,
    lights: Vec<Light>,
    spheres: Vec<PaperSphere>,
    triangles: Vec<PaperTriangle>,
    /// For each of `triangles` its index in the scene.
    sources: Vec<usize>,
}

impl Packed {
    /// Packs `scene` in its order, without the triangles that no ray can hit: those that have no
    /// area, and those whose plane passes through the camera.
    pub fn new(scene: &Scene) -> Self {
        let lights = scene
            .lights
            .iter()
            .map(|light| Light { position: light.position.into(), radiance: light.radiance_in_f32().into() });
        let spheres = scene.spheres.iter().map(|sphere| PaperSphere {
            centre: sphere.centre.into(),
            colour: sphere.colour.into(),
            radius: sphere.radius,
            padding: [0.0; 3],
        });
        // For a triangle that is never hit, eq. 9 in f32 could return rounding errors as a hit.
        let hit = |i: &usize| geometry::triangle_volume(scene.triangle(*i).vertices.map(|v| v.as_dvec3())).is_some();
        let sources: Vec<usize> = (0..scene.triangle_count()).filter(hit).collect();
        let triangles = sources.iter().map(|i| {
            let Triangle { colour, vertices } = scene.triangle(*i);
            let [v1, v2, v3] = vertices.map(Into::into);
            PaperTriangle { v1, v2, v3, colour: colour.into() }
        });
        let grid = scene.camera.grid::<f32>();
        Packed {
            frame: Frame {
                step: grid.step,
                half_width: grid.half_width,
                half_height: grid.half_height,
                focal: grid.focal,
                width: scene.camera.width().into(),
                ..Frame::ZERO
            },
            lights: lights.collect(),
            spheres: spheres.collect(),
            triangles: triangles.collect(),
            sources,
        }
    }

    /// The rays.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// A copy in which each colour encodes the object's index, so that a pixel's colour says which
    /// object was hit; see [`Packed::object`].
    pub fn numbered(&self) -> Self {
        let mut numbered = self.clone();
        let number = |kind: f32, i: usize| Vec4::new((i % DIGIT) as f32, (i / DIGIT) as f32, kind);
        numbered.spheres.iter_mut().enumerate().for_each(|(i, sphere)| sphere.colour = number(1.0, i));
        numbered.triangles.iter_mut().enumerate().for_each(|(i, triangle)| triangle.colour = number(2.0, i));
        numbered
    }

    /// The object that a colour of [`Packed::numbered`] encodes; None for black.
    pub fn object(&self, colour: Vec4) -> Option<Object> {
        let i = colour.x as usize + colour.y as usize * DIGIT;
        match colour.z as u32 {
            0 => None,
            1 => Some(Object::Sphere(i)),
            _ => Some(Object::Triangle(self.sources[i])),
        }
    }

    pub fn objects(&self) -> Objects<'_> {
        Objects { lights: &self.lights, spheres: &self.spheres, triangles: &self.triangles }
    }
}
