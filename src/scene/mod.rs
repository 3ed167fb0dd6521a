//! The scene that is to be rendered: [`Scene`] with its lights and objects, and the ways to read or
//! build one.

mod camera;
#[cfg(feature = "files")]
mod chunks;
#[cfg(feature = "files")]
mod cloud;
#[cfg(feature = "files")]
mod content;
mod diagnostic;
mod doubts;
mod log;
pub mod mesh;
mod misfit;
mod mistaken;
#[cfg(feature = "files")]
mod open;
mod opened;
mod parse;
#[cfg(feature = "files")]
mod pieces;
mod random;
mod setting;
pub mod srgb;
#[cfg(feature = "files")]
mod tables;
mod token;
mod validity;
mod view;
mod write;
#[cfg(feature = "files")]
mod write_toml;

pub use camera::{Camera, CameraError, Grid, MAX_PIXELS, MAX_SIDE};
#[cfg(feature = "files")]
pub use cloud::{Cloud, CloudFormat};
pub use diagnostic::{Diagnostic, SceneError, brief, is_unseen, printable};
#[cfg(feature = "files")]
pub use diagnostic::{of_address, shown};
pub use mesh::{FileCamera, FileLight, Mesh, MeshError, MeshFormat, Placement};
#[cfg(feature = "files")]
pub(crate) use mistaken::{Mistaken, recognise_no_picture};
#[cfg(feature = "files")]
pub use open::{MAX_TOML, SceneFormat, has_points, open, open_with, picture_name, read, text_within};
pub use opened::Opened;
pub use parse::parse;
pub use random::{Rng, direction, many};
pub use setting::{ModelOptions, Setting, UpAxis};
#[cfg(feature = "files")]
pub use tables::parse_toml;
pub use validity::InvalidScene;
pub use view::{MovingCamera, ToCamera, View, ViewError};

use glam::{DVec3, Vec3};

use crate::kernels::StandardFloats;
use crate::reference::geometry;

pub use crate::kernels::Faces;
pub use crate::kernels::Sphere;
pub use crate::kernels::Triangle;

/// A point light. It is not attenuated: at any distance its light is `intensity * colour`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// A factor on the colour, at least 0.
    pub intensity: f32,
    /// Red, green, blue, each at least 0.
    pub colour: Vec3,
    /// Its position in camera coordinates (pinhole at the origin, looking along +z).
    pub position: Vec3,
}

impl Light {
    /// The largest I_L (eq. 11) that is passed to engines which compute in f32: half of f32's
    /// largest number, so that I_L (L . N) stays finite even where rounding makes the cosine of two
    /// unit vectors slightly greater than 1.
    pub const BRIGHTEST: f32 = f32::MAX / 2.0;

    /// I_L of eq. 11, intensity x colour. f64 holds the product of two f32 exactly.
    pub fn radiance(&self) -> DVec3 {
        f64::from(self.intensity) * self.colour.as_dvec3()
    }

    /// [`radiance`](Self::radiance) in f32, with channels limited to [`Light::BRIGHTEST`].
    pub fn radiance_in_f32(&self) -> Vec3 {
        self.radiance().min(DVec3::splat(Self::BRIGHTEST.into())).as_vec3()
    }
}

/// Faces that were transformed to camera coordinates.
pub(crate) struct MovedFaces {
    pub faces: Faces,
    /// The numbers of the faces that have no area after the transformation: readers of files warn
    /// of them.
    #[cfg_attr(not(feature = "files"), expect(dead_code))]
    pub without_area: Vec<usize>,
}

impl Faces {
    /// The faces transformed by `map` in f64 and rounded once. Faces without area still have none.
    /// If a corner overflows f32, the error is the number of the first face with such a corner.
    fn moved(mut self, map: ToCamera) -> Result<MovedFaces, usize> {
        let mut doubtful = self.without_plain_area(map.plain_area());
        let no_area_before: Vec<usize> =
            doubtful.iter().copied().filter(|face| has_no_area(self.corners_of(*face))).collect();
        if map != ToCamera::IDENTITY {
            let place = |vertex: &mut Vec3| *vertex = map.point(vertex.as_dvec3()).as_vec3();
            self.vertices_mut().iter_mut().for_each(place);
        }
        // Only corners count: a vertex that no face uses may overflow.
        if !self.vertices().iter().all(|vertex| vertex.is_finite()) {
            let is_finite = |triangle: Triangle| triangle.vertices.iter().all(|vertex| vertex.is_finite());
            if let Some(beyond) = self.iter().position(|triangle| !is_finite(triangle)) {
                return Err(beyond);
            }
        }
        self.flatten(&no_area_before);
        doubtful.retain(|face| has_no_area(self.corners_of(*face)));
        Ok(MovedFaces { faces: self, without_area: doubtful })
    }

    /// Restores that these faces have no area, where transforming and rounding their corners
    /// separately has given them one.
    fn flatten(&mut self, faces: &[usize]) {
        for face in faces {
            if !self.get(*face).has_no_area() {
                self.collapse(*face);
            }
        }
    }

    /// The indices of the faces that have no area.
    fn without_area(&self) -> Vec<usize> {
        let mut doubtful = self.without_plain_area(PlainArea::WHERE_THEY_ARE);
        doubtful.retain(|face| has_no_area(self.corners_of(*face)));
        doubtful
    }

    /// The indices of the faces that do not pass [`PlainArea`]'s test, and so may lack an area. The
    /// test runs on 16 faces at a time, transposed so that a register holds one coordinate of
    /// several faces.
    fn without_plain_area(&self, plain_area: PlainArea) -> Vec<usize> {
        const TOGETHER: usize = 16;
        let mut found = Vec::new();
        for first in (0..self.len()).step_by(TOGETHER) {
            let mut numbers = [[0.0; TOGETHER]; 9];
            for i in 0..TOGETHER {
                // Repeat the last face to fill up the 16.
                let [a, b, c] = self.corners_of((first + i).min(self.len() - 1));
                let of_face = [a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z];
                numbers.iter_mut().zip(of_face).for_each(|(numbers, number)| numbers[i] = number);
            }
            let [ax, ay, az, bx, by, bz, cx, cy, cz] = numbers;
            let mut plain = true;
            for i in 0..TOGETHER {
                let corners = [[ax[i], ay[i], az[i]], [bx[i], by[i], bz[i]], [cx[i], cy[i], cz[i]]];
                plain &= plain_area.is_of(corners.map(Vec3::from_array));
            }
            if !plain {
                let last = self.len().min(first + TOGETHER);
                found.extend((first..last).filter(|face| !plain_area.is_of(self.corners_of(*face))));
            }
        }
        found
    }
}

impl Triangle {
    /// Whether the corners are collinear or equal, so that no ray hits the triangle.
    pub fn has_no_area(&self) -> bool {
        has_no_area(self.vertices)
    }

    /// If the triangle had no area before it was transformed and rounded, makes sure that it has
    /// none: its third corner becomes equal to the first.
    fn flatten(&mut self) {
        if !self.has_no_area() {
            self.vertices[2] = self.vertices[0];
        }
    }
}

/// [`geometry::has_no_area`] of corners in f32.
#[inline]
fn has_no_area(corners: [Vec3; 3]) -> bool {
    !PlainArea::WHERE_THEY_ARE.is_of(corners) && geometry::has_no_area(corners.map(|corner| corner.as_dvec3()))
}

/// A conservative test in f32 for triangles that have an area, both as they are and after a
/// transformation. No triangle without area passes, and most others do.
///
/// With sides a and b from the corner v1, the test is |a x b|^2 > share (|a|^2 + |b|^2) (|a|^2 +
/// |b|^2 + |v1|^2 + distance^2). Without a transformation share is 1e-10: the normal must be longer
/// than 1e-5 times the longest side times the furthest corner. A triangle without area has less
/// than 1e-15 of that product, and computing the normal in f32 errs by up to 4e-7 of it.
///
/// A linear map that scales by s1 >= s2 >= s3 along three axes, relative to a point at some
/// distance, shortens the normal at most by the factor s2 s3. It lengthens sides and corners (as
/// seen from that point) at most by s1, and rounding moves each corner by 2^-24 of its length. So
/// for the transformed triangle the same test holds if its factor 1e-5 is multiplied by s1^2 / (s2
/// s3): the rounding of corners contributes up to 1.2e-6 of the product.
#[derive(Clone, Copy)]
struct PlainArea {
    share: f32,
    distance_squared: f32,
}

impl PlainArea {
    /// The test for triangles that are not transformed.
    const WHERE_THEY_ARE: PlainArea = PlainArea { share: 1e-10, distance_squared: 0.0 };

    /// The test for triangles that are transformed by a map with these scale factors, relative to a
    /// point at this distance.
    fn after_move(mut factors: [f64; 3], distance: f64) -> PlainArea {
        /// Factors within which squares neither underflow nor overflow. With others no triangle
        /// passes the test.
        const FACTORS: std::ops::Range<f64> = 1e-12..1e12;
        if !factors.iter().all(|factor| FACTORS.contains(factor)) {
            return PlainArea { share: f32::INFINITY, distance_squared: 0.0 };
        }
        factors.sort_by(f64::total_cmp);
        let [least, middle, most] = factors;
        let stretch = most * most / (least * middle);
        PlainArea { share: (1e-10 * stretch * stretch) as f32, distance_squared: (distance * distance) as f32 }
    }

    #[inline]
    fn is_of(self, [v1, v2, v3]: [Vec3; 3]) -> bool {
        let (a, b) = (v2 - v1, v3 - v1);
        let sides = a.length_squared() + b.length_squared();
        a.cross(b).length_squared() > self.share * sides * (sides + v1.length_squared() + self.distance_squared)
    }
}

/// An object of a scene, by its kind and index.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Object {
    /// The sphere with this index in [`Scene::spheres`].
    Sphere(usize),
    /// The triangle with this number, as [`Scene::triangle`] counts from 0.
    Triangle(usize),
}

/// Objects, lights and a camera: the content of a scene file, each number rounded once to f32, or a
/// scene that a program builds.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The file name of the picture, as the scene file gives it. The library does not use it: its
    /// functions are told the names of the files they write.
    pub name: String,
    /// Image size, focal distance and film.
    pub camera: Camera,
    /// Lights, in the order of the file.
    pub lights: Vec<Light>,
    /// Spheres, in the order of the file. Of two objects at equal distance the first is visible;
    /// spheres come before triangles.
    pub spheres: Vec<Sphere>,
    /// Triangles that each have their own corners, in the order of the file.
    pub triangles: Vec<Triangle>,
    /// Triangles that share vertices, as those of meshes do. They come after all others.
    pub faces: Faces,
    /// Whether objects cast shadows on each other.
    pub shadows: bool,
    /// The position of the camera in the world, as the file gives it, so that [`Scene::seen_from`]
    /// can move it. All coordinates of the scene are already relative to the camera.
    pub view: View,
}

impl Scene {
    /// An empty scene, without lights, objects and shadows, named `picture.png`.
    pub fn new(camera: Camera) -> Self {
        let (lights, spheres, triangles, faces, shadows, view) = Default::default();
        Scene { name: "picture.png".into(), camera, lights, spheres, triangles, faces, shadows, view }
    }

    /// The number of triangles, of `triangles` and of `faces`.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len() + self.faces.len()
    }

    /// The triangle with this number, from 0: first those of `triangles`, then those of `faces`.
    pub fn triangle(&self, number: usize) -> Triangle {
        match number.checked_sub(self.triangles.len()) {
            None => self.triangles[number],
            Some(face) => self.faces.get(face),
        }
    }

    /// The corners of `triangles` and all vertices of `faces`, used or not.
    pub(crate) fn vertices(&self) -> impl Iterator<Item = &Vec3> {
        self.triangles.iter().flat_map(|triangle| &triangle.vertices).chain(self.faces.vertices())
    }

    /// All triangles, in the order of their numbers.
    pub fn all_triangles(&self) -> impl Iterator<Item = Triangle> + Clone {
        self.triangles.iter().copied().chain(self.faces.iter())
    }

    /// The scene with all lengths multiplied by `factor`, except those of the camera's film. Its
    /// picture is the same.
    pub fn scaled(&self, factor: f32) -> Scene {
        let _floats = StandardFloats::set();
        let mut scene = self.clone();
        scene.lights.iter_mut().for_each(|light| light.position *= factor);
        scene.spheres.iter_mut().for_each(|sphere| {
            sphere.centre *= factor;
            sphere.radius *= factor;
        });
        scene.triangles.iter_mut().flat_map(|triangle| &mut triangle.vertices).for_each(|vertex| *vertex *= factor);
        scene.faces.vertices_mut().iter_mut().for_each(|vertex| *vertex *= factor);
        scene.view.position *= f64::from(factor);
        scene.view.look_at *= f64::from(factor);
        scene
    }
}
