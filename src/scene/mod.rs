//! What is to be seen: [`Scene`], its lights and objects, and the ways to get one.

mod camera;
mod diagnostic;
mod doubts;
pub mod families;
mod log;
pub mod mesh;
mod misfit;
#[cfg(feature = "files")]
mod open;
mod opened;
mod parse;
#[cfg(feature = "files")]
mod pieces;
mod random;
#[cfg(feature = "files")]
mod tables;
mod token;
mod validity;
mod view;
mod write;
#[cfg(feature = "files")]
mod write_toml;

pub use camera::{Camera, CameraError, Grid, MAX_PIXELS, MAX_SIDE};
pub(crate) use diagnostic::brief;
#[cfg(feature = "render")]
pub(crate) use diagnostic::is_unseen;
#[cfg(feature = "render")]
pub(crate) use diagnostic::printable;
#[cfg(feature = "files")]
pub(crate) use diagnostic::shown;
pub use diagnostic::{Diagnostic, SceneError};
pub use mesh::{Mesh, MeshError, MeshFormat};
#[cfg(feature = "render")]
pub(crate) use open::picture_name;
#[cfg(feature = "lab")]
pub(crate) use open::text_within;
#[cfg(feature = "files")]
pub use open::{MAX_TOML, SceneFormat, open, read};
pub use opened::Opened;
pub use parse::parse;
pub use random::{Rng, many};
#[cfg(feature = "files")]
pub use tables::parse_toml;
pub use validity::InvalidScene;
pub use view::{MovingCamera, Setting, ToCamera, View, ViewError};

use glam::{DVec3, Vec3};

use crate::reference::geometry;

pub use crate::kernels::Faces;
pub use crate::kernels::Sphere;
pub use crate::kernels::Triangle;

/// A point light. Its light at any distance is `intensity * colour`: there is no attenuation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Factor on the colour, at least 0.
    pub intensity: f32,
    /// Red, green, blue, each at least 0.
    pub colour: Vec3,
    /// Where it stands, in the camera's frame (pinhole at the origin, looking along +z).
    pub position: Vec3,
}

impl Light {
    /// The largest I_L that an engine is given which has nothing but f32: half of what that holds, so that I_L (L . N) stays
    /// finite even where the cosine of two rounded unit vectors comes out a little above 1.
    pub const BRIGHTEST: f32 = f32::MAX / 2.0;

    /// I_L of eq. 11: intensity x colour, a product that f64 holds exactly.
    pub fn radiance(&self) -> DVec3 {
        f64::from(self.intensity) * self.colour.as_dvec3()
    }

    /// The same in f32; brighter lights are taken for [`Light::BRIGHTEST`].
    pub fn radiance_in_f32(&self) -> Vec3 {
        self.radiance().min(DVec3::splat(Self::BRIGHTEST.into())).as_vec3()
    }
}

impl Faces {
    /// Moved by `map` in f64 and rounded once; those of no area keep none. Where a corner leaves the range of f32, the number
    /// of the first face that has one.
    fn moved(mut self, map: ToCamera) -> Result<Self, usize> {
        let without_area = self.without_area();
        if map != ToCamera::IDENTITY {
            let place = |vertex: &mut Vec3| *vertex = map.point(vertex.as_dvec3()).as_vec3();
            self.vertices_mut().iter_mut().for_each(place);
        }
        // Those that no face has may be anywhere.
        if !self.vertices().iter().all(|vertex| vertex.is_finite()) {
            let is_finite = |triangle: Triangle| triangle.vertices.iter().all(|vertex| vertex.is_finite());
            if let Some(beyond) = self.iter().position(|triangle| !is_finite(triangle)) {
                return Err(beyond);
            }
        }
        self.flatten(&without_area);
        Ok(self)
    }

    /// Has those have no area that had none before they were moved, and rounded.
    fn flatten(&mut self, faces: &[usize]) {
        for face in faces {
            if !self.get(*face).has_no_area() {
                self.collapse(*face);
            }
        }
    }

    /// The numbers of those of no area. Several are looked at together, transposed: a register has one number of each.
    fn without_area(&self) -> Vec<usize> {
        const TOGETHER: usize = 16;
        let mut found = Vec::new();
        for first in (0..self.len()).step_by(TOGETHER) {
            let mut numbers = [[0.0; TOGETHER]; 9];
            for i in 0..TOGETHER {
                // The last one in place of those that are not there.
                let [a, b, c] = self.corners_of((first + i).min(self.len() - 1));
                let of_face = [a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z];
                numbers.iter_mut().zip(of_face).for_each(|(numbers, number)| numbers[i] = number);
            }
            let [ax, ay, az, bx, by, bz, cx, cy, cz] = numbers;
            let mut plain = true;
            for i in 0..TOGETHER {
                let corners = [[ax[i], ay[i], az[i]], [bx[i], by[i], bz[i]], [cx[i], cy[i], cz[i]]];
                plain &= has_plain_area(corners.map(Vec3::from_array));
            }
            if !plain {
                let last = self.len().min(first + TOGETHER);
                found.extend((first..last).filter(|face| has_no_area(self.corners_of(*face))));
            }
        }
        found
    }
}

impl Triangle {
    /// Whether its corners are on one line, or one point: no ray hits it then.
    pub fn has_no_area(&self) -> bool {
        has_no_area(self.vertices)
    }

    /// Puts the third corner on the first, where moving and rounding has drawn apart what had no area.
    fn flatten(&mut self) {
        if !self.has_no_area() {
            self.vertices[2] = self.vertices[0];
        }
    }
}

/// [`geometry::has_no_area`] of corners in f32.
#[inline]
fn has_no_area(corners: [Vec3; 3]) -> bool {
    !has_plain_area(corners) && geometry::has_no_area(corners.map(|corner| corner.as_dvec3()))
}

/// Whether corners have an area for sure. Nearly all are so far from having none that f32 tells, whatever it loses: their normal
/// is longer than 1e-5 of the longest side times the furthest corner, and what has no area is below 1e-15 of that.
#[inline]
fn has_plain_area([v1, v2, v3]: [Vec3; 3]) -> bool {
    let (a, b) = (v2 - v1, v3 - v1);
    let sides = a.length_squared() + b.length_squared();
    a.cross(b).length_squared() > 1e-10 * sides * (sides + v1.length_squared())
}

/// An object of a scene by its place in its list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Object {
    /// A sphere.
    Sphere(usize),
    /// A triangle, counted as by [`Scene::triangle`].
    Triangle(usize),
}

/// A scene file's content: every number rounded once to f32, in the file's order.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The image name that the file gives, as it stands there.
    pub name: String,
    /// Image size, focal distance and film.
    pub camera: Camera,
    /// Lights, in file order.
    pub lights: Vec<Light>,
    /// Spheres, in file order; they come before all triangles where two objects tie.
    pub spheres: Vec<Sphere>,
    /// Triangles with corners of their own, in file order.
    pub triangles: Vec<Triangle>,
    /// Those that share their corners, of which meshes are made; they come after all others.
    pub faces: Faces,
    /// Whether objects cast shadows on each other.
    pub shadows: bool,
}

impl Scene {
    /// Nothing, seen by a camera: without lights, objects and shadows, under the name `picture.png`.
    pub fn new(camera: Camera) -> Self {
        let (lights, spheres, triangles, faces, shadows) = Default::default();
        Scene { name: "picture.png".into(), camera, lights, spheres, triangles, faces, shadows }
    }

    /// How many triangles there are, of both kinds.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len() + self.faces.len()
    }

    /// The triangle of this number, counted from 0 in the scene's order.
    pub fn triangle(&self, number: usize) -> Triangle {
        match number.checked_sub(self.triangles.len()) {
            None => self.triangles[number],
            Some(face) => self.faces.get(face),
        }
    }

    /// The corners of all triangles, those of faces once, and those that none uses.
    pub(crate) fn vertices(&self) -> impl Iterator<Item = &Vec3> {
        self.triangles.iter().flat_map(|triangle| &triangle.vertices).chain(self.faces.vertices())
    }

    /// All triangles, in the scene's order.
    pub fn all_triangles(&self) -> impl Iterator<Item = Triangle> + Clone {
        self.triangles.iter().copied().chain(self.faces.iter())
    }

    /// The scene with all lengths times `factor`, but for the camera's: the same picture.
    pub fn scaled(&self, factor: f32) -> Scene {
        let mut scene = self.clone();
        scene.lights.iter_mut().for_each(|light| light.position *= factor);
        scene.spheres.iter_mut().for_each(|sphere| {
            sphere.centre *= factor;
            sphere.radius *= factor;
        });
        scene.triangles.iter_mut().flat_map(|triangle| &mut triangle.vertices).for_each(|vertex| *vertex *= factor);
        scene.faces.vertices_mut().iter_mut().for_each(|vertex| *vertex *= factor);
        scene
    }
}
