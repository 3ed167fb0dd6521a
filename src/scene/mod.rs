//! What is to be seen: [`Scene`], its lights and objects, and the ways to get one.

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
    /// The largest I_L that an engine is given which has nothing but f32: half of what that holds,
    /// so that I_L (L . N) stays finite even where the cosine of two rounded unit vectors comes out
    /// a little above 1.
    pub const BRIGHTEST: f32 = f32::MAX / 2.0;

    /// I_L of eq. 11: intensity x colour, a product that f64 holds exactly.
    pub fn radiance(&self) -> DVec3 {
        f64::from(self.intensity) * self.colour.as_dvec3()
    }

    /// [`radiance`](Self::radiance) in f32; brighter lights are taken for [`Light::BRIGHTEST`].
    pub fn radiance_in_f32(&self) -> Vec3 {
        self.radiance().min(DVec3::splat(Self::BRIGHTEST.into())).as_vec3()
    }
}

/// Faces that were moved to the camera's frame.
pub(crate) struct MovedFaces {
    pub faces: Faces,
    /// The numbers of those that have no area where they are now.
    pub without_area: Vec<usize>,
}

impl Faces {
    /// Moved by `map` in f64 and rounded once; those of no area keep none. Where a corner leaves
    /// the range of f32, the number of the first face that has one.
    fn moved(mut self, map: ToCamera) -> Result<MovedFaces, usize> {
        let mut doubtful = self.without_plain_area(map.plain_area());
        let no_area_before: Vec<usize> =
            doubtful.iter().copied().filter(|face| has_no_area(self.corners_of(*face))).collect();
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
        self.flatten(&no_area_before);
        doubtful.retain(|face| has_no_area(self.corners_of(*face)));
        Ok(MovedFaces { faces: self, without_area: doubtful })
    }

    /// Has those have no area that had none before they were moved, and rounded.
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

    /// The indices of the faces that do not pass [`PlainArea`]'s test. It runs on 16 faces at a
    /// time, transposed, so that a register holds one coordinate of several faces.
    fn without_plain_area(&self, plain_area: PlainArea) -> Vec<usize> {
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
    /// Whether its corners are on one line, or one point: no ray hits it then.
    pub fn has_no_area(&self) -> bool {
        has_no_area(self.vertices)
    }

    /// Puts the third corner on the first, where moving and rounding has drawn apart what had no
    /// area.
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

/// A test in f32 which most triangles pass, and none that has no area, neither where it is nor
/// after a move.
///
/// With sides a and b from the corner v1 it is |a x b|^2 > share (|a|^2 + |b|^2) (|a|^2 + |b|^2 +
/// |v1|^2 + distance^2): without a move, a normal longer than 1e-5 of the longest side times the
/// furthest corner. What has no area is below 1e-15 of that, and f32 loses 4e-7 of it in computing
/// the normal.
///
/// A move by a linear map with the factors s1 >= s2 >= s3 along three axes, relative to a point at
/// some distance, leaves at least s2 s3 of the normal, and makes sides and corners at most s1 times
/// as long, where corners count from that point; rounding moves each corner by 2^-24 of its length.
/// So the same holds of what was moved if the test's 1e-5 is multiplied by s1^2 / (s2 s3): the
/// rounding of corners takes up to 1.2e-6 of these.
#[derive(Clone, Copy)]
struct PlainArea {
    share: f32,
    distance_squared: f32,
}

impl PlainArea {
    /// Of triangles that are not moved.
    const WHERE_THEY_ARE: PlainArea = PlainArea { share: 1e-10, distance_squared: 0.0 };

    /// Of triangles that are moved by a map with these factors, relative to a point at this
    /// distance.
    fn after_move(mut factors: [f64; 3], distance: f64) -> PlainArea {
        /// With other factors numbers may become subnormal or infinite: no triangle passes then.
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

/// An object of a scene by its place in its list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Object {
    /// The sphere of this number in [`Scene::spheres`], from 0.
    Sphere(usize),
    /// The triangle of this number by [`Scene::triangle`], from 0.
    Triangle(usize),
}

/// What is to be seen, and from where: the content of a scene file, each number rounded once to
/// f32, or what a program makes.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The name of the picture, as the file gives it. The library writes to the names that it is
    /// called with, and not to this.
    pub name: String,
    /// Image size, focal distance and film.
    pub camera: Camera,
    /// Lights, in the order of the file.
    pub lights: Vec<Light>,
    /// Spheres, in the order of the file. Where two objects are equally far away, the first is
    /// seen; spheres come before triangles.
    pub spheres: Vec<Sphere>,
    /// Triangles with corners of their own, in the order of the file.
    pub triangles: Vec<Triangle>,
    /// Those that share their corners, of which meshes are made; they come after all others.
    pub faces: Faces,
    /// Whether objects cast shadows on each other.
    pub shadows: bool,
    /// Where the camera stands in the world, as the file says, so that [`Scene::seen_from`] can
    /// move it. Every point above is in the camera's frame already.
    pub view: View,
}

impl Scene {
    /// An empty scene: without lights, objects and shadows, under the name `picture.png`.
    pub fn new(camera: Camera) -> Self {
        let (lights, spheres, triangles, faces, shadows, view) = Default::default();
        Scene { name: "picture.png".into(), camera, lights, spheres, triangles, faces, shadows, view }
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

    /// The scene with all lengths times `factor`, but for those of the camera's film: the same
    /// picture.
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
