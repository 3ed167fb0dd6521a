//! A scene as the kernels of one vector per register read it.

use crate::kernels::{Frame, Light, Objects, Sphere, Triangle};
use crate::reference::geometry;
use crate::scene::{self, Camera, Scene};

/// The lights and objects of a scene in arrays of their own, and its rays in f32.
#[derive(Clone, Debug)]
pub struct Packed {
    frame: Frame,
    lights: Vec<Light>,
    spheres: Vec<Sphere>,
    triangles: Vec<Triangle>,
}

impl Packed {
    /// Packs `scene` as `camera` sees it, in the scene's order, without the triangles that no ray can hit: those of no
    /// area, and those whose plane passes through the camera.
    pub fn new(scene: &Scene, camera: &Camera) -> Self {
        let lights = scene
            .lights
            .iter()
            .map(|light| Light { position: light.position.into(), radiance: light.radiance().into() });
        let spheres = scene.spheres.iter().map(|sphere| Sphere {
            centre: sphere.centre.into(),
            colour: sphere.colour.into(),
            radius: sphere.radius,
            padding: [0.0; 3],
        });
        // Of a triangle that is never hit, eq. 9 in f32 could see the rounding.
        let hit =
            |triangle: &&scene::Triangle| geometry::triangle_volume(triangle.vertices.map(|v| v.as_dvec3())).is_some();
        let triangles = scene.triangles.iter().filter(hit).map(|triangle| {
            let [v1, v2, v3] = triangle.vertices.map(Into::into);
            Triangle { v1, v2, v3, colour: triangle.colour.into() }
        });
        let grid = camera.grid::<f32>();
        Packed {
            frame: Frame {
                step: grid.step,
                half_width: grid.half_width,
                half_height: grid.half_height,
                focal: grid.focal,
                width: camera.width().into(),
            },
            lights: lights.collect(),
            spheres: spheres.collect(),
            triangles: triangles.collect(),
        }
    }

    /// The rays.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// The lights and objects.
    pub fn objects(&self) -> Objects<'_> {
        Objects { lights: &self.lights, spheres: &self.spheres, triangles: &self.triangles }
    }
}
