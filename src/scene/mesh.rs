//! Triangle meshes: reading and writing their files, and placing them in a scene.

#[cfg(feature = "files")]
pub(super) mod colour;
#[cfg(feature = "files")]
pub(super) mod fault;
#[cfg(feature = "files")]
mod gltf;
#[cfg(feature = "files")]
mod materials;
#[cfg(feature = "files")]
pub(super) mod number;
#[cfg(feature = "files")]
mod obj;
#[cfg(feature = "files")]
pub(super) mod ply;
#[cfg(feature = "files")]
mod polygon;
#[cfg(feature = "files")]
pub(super) mod read;
pub mod shapes;
#[cfg(feature = "files")]
mod stl;
#[cfg(feature = "files")]
pub(super) mod vertices;
#[cfg(feature = "files")]
mod write;

use std::borrow::Cow;
use std::collections::HashMap;
use std::fmt;
use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DVec3, Vec3};

use super::diagnostic::shown;
use super::setting::KeyLight;
use super::{Camera, CameraError, Faces, MovedFaces, Scene, ToCamera, UpAxis, View};
use crate::kernels::ColourRun;

/// Triangles whose corners are indices into a list of vertices.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Points, each finite, relative to the origin.
    pub vertices: Vec<Vec3>,
    /// The point of the file's coordinates that `vertices` are relative to: 0, unless the whole
    /// mesh is so far from 0 that f32 would lose digits of its shape, as with map coordinates.
    pub origin: DVec3,
    /// Three indices into `vertices` for each triangle; methods panic if one is out of range.
    pub triangles: Vec<[u32; 3]>,
    /// The triangles' colours in linear light (files hold them on the sRGB curve), run-length
    /// encoded: each run has a colour and ends before the triangle whose number it gives. Triangles
    /// after the last run are white.
    pub colours: Vec<ColourRun>,
    /// How many faces of the file had more than three corners and were triangulated. The
    /// triangles cover exactly the face if that is planar.
    pub polygons: usize,
    /// The other files that were read for it: of materials (MTL) or of glTF buffers.
    pub libraries: Vec<PathBuf>,
    /// What was dropped from the file or violates the format, in sentences for the user.
    pub notes: Vec<String>,
    /// The camera of the file, if it has one.
    pub camera: Option<FileCamera>,
    /// The lights of the file, of formats that have them.
    pub lights: Vec<FileLight>,
}

/// The camera of a mesh file, in the file's own coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FileCamera {
    /// Where the pinhole is.
    pub position: DVec3,
    /// The direction of view.
    pub forward: DVec3,
    /// The direction that points upwards in the picture.
    pub up: DVec3,
    /// The vertical field of view, in degrees.
    pub field_of_view: f64,
}

impl FileCamera {
    /// The same view in the world.
    pub(super) fn view(&self, to_world: DAffine3) -> View {
        let position = to_world.transform_point3(self.position);
        let look_at = position + to_world.transform_vector3(self.forward);
        View { position, look_at, up: to_world.transform_vector3(self.up) }
    }

    /// `camera` with the film's diagonal chosen for the field of view of the file's camera.
    pub(super) fn lens(&self, camera: &Camera) -> Result<Camera, CameraError> {
        camera.with_field_of_view(self.field_of_view)
    }
}

/// A point light of a mesh file, in the file's own coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FileLight {
    /// Where it is.
    pub position: DVec3,
    /// Its luminous intensity in candela, at least 0.
    pub intensity: f64,
    /// Its colour in linear light.
    pub colour: Vec3,
}

impl FileLight {
    /// The light in the world. Its strength is the one it has at `middle`, by the inverse
    /// square of the distance, since lights here are not attenuated.
    pub(super) fn in_world(&self, to_world: DAffine3, middle: DVec3) -> KeyLight {
        let position = to_world.transform_point3(self.position);
        let strength = self.intensity / position.distance_squared(middle).max(f64::MIN_POSITIVE);
        KeyLight { strength, colour: self.colour, position }
    }
}

/// A format of mesh files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Wavefront OBJ.
    Obj,
    /// PLY: text, or binary of either byte order. Binary little endian is written.
    Ply,
    /// STL: text or binary. Binary is written.
    Stl,
    /// glTF 2.0: JSON or binary. Binary is written.
    Gltf,
}

/// An error of a mesh file, and where it is.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", self.one_line())]
pub struct MeshError {
    /// The file.
    pub path: PathBuf,
    /// The line, from 1, if the file is text and the error has one.
    pub line: Option<usize>,
    /// What is wrong with which element, e.g. "face 17's corner 3 refers to vertex 9, but the
    /// file has only 3 vertices".
    pub message: String,
    /// What would have been valid, if that is not obvious.
    pub expected: Option<String>,
}

impl MeshError {
    fn one_line(&self) -> String {
        let MeshError { path, line, message, expected } = self;
        let place = line.map(|line| format!(":{line}")).unwrap_or_default();
        let expected = expected.as_ref().map(|it| format!(": expected {it}")).unwrap_or_default();
        format!("{}{place}: {message}{expected}", shown(path))
    }
}

impl MeshFormat {
    /// The extensions of file names, in lower case, each with its format.
    pub const EXTENSIONS: &[(&str, MeshFormat)] = &[
        ("obj", MeshFormat::Obj),
        ("ply", MeshFormat::Ply),
        ("stl", MeshFormat::Stl),
        ("glb", MeshFormat::Gltf),
        ("gltf", MeshFormat::Gltf),
    ];

    /// The format of a file name by its extension, in upper or lower case.
    pub fn from_path(path: &Path) -> Option<MeshFormat> {
        let extension = path.extension()?;
        let known = MeshFormat::EXTENSIONS.iter().find(|(known, _)| extension.eq_ignore_ascii_case(known));
        known.map(|&(_, format)| format)
    }

    /// The format's usual name.
    pub fn name(self) -> &'static str {
        match self {
            MeshFormat::Obj => "OBJ",
            MeshFormat::Ply => "PLY",
            MeshFormat::Stl => "STL",
            MeshFormat::Gltf => "glTF",
        }
    }

    /// The usual extension of the format's files.
    pub fn extension(self) -> &'static str {
        let known = MeshFormat::EXTENSIONS.iter().find(|(_, format)| *format == self);
        known.map_or("", |(extension, _)| extension)
    }

    /// How files of this format are placed in the world by default. Their coordinates are
    /// right-handed, the world's are left-handed. y is up, except in STL, a format of 3D printing,
    /// where z is.
    pub fn placement(self) -> Placement {
        self.up_axis().placement()
    }

    /// The axis that stands upright in most files of this format.
    pub fn up_axis(self) -> UpAxis {
        if self == MeshFormat::Stl { UpAxis::Z } else { UpAxis::Y }
    }
}

impl fmt::Display for MeshFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The placement of a mesh in the world: it is scaled, then rotated, then translated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Factors along the mesh's own axes; a negative factor mirrors.
    pub scale: DVec3,
    /// Rotations in degrees about x, then about y, then about z. 90 degrees about x turns y to
    /// z, about y turns z to x, and about z turns x to y.
    pub rotate: DVec3,
    /// The translation, applied last.
    pub translate: DVec3,
}

impl Placement {
    /// No change.
    pub const IDENTITY: Placement = Placement { scale: DVec3::ONE, rotate: DVec3::ZERO, translate: DVec3::ZERO };

    /// The map from the mesh's coordinates to the world's.
    pub fn to_world(&self) -> DAffine3 {
        let [(sx, cx), (sy, cy), (sz, cz)] = self.rotate.to_array().map(sine_and_cosine);
        let about_x = DMat3::from_cols(DVec3::X, DVec3::new(0.0, cx, sx), DVec3::new(0.0, -sx, cx));
        let about_y = DMat3::from_cols(DVec3::new(cy, 0.0, -sy), DVec3::Y, DVec3::new(sy, 0.0, cy));
        let about_z = DMat3::from_cols(DVec3::new(cz, sz, 0.0), DVec3::new(-sz, cz, 0.0), DVec3::Z);
        let linear = about_z * about_y * about_x * DMat3::from_diagonal(self.scale);
        DAffine3::from_mat3_translation(linear, self.translate)
    }
}

/// Sine and cosine of an angle in degrees; exact for quarter turns.
fn sine_and_cosine(degrees: f64) -> (f64, f64) {
    let turned = degrees.rem_euclid(360.0);
    match turned {
        0.0 => (0.0, 1.0),
        90.0 => (1.0, 0.0),
        180.0 => (0.0, -1.0),
        270.0 => (-1.0, 0.0),
        _ => turned.to_radians().sin_cos(),
    }
}

impl Mesh {
    /// The vertices that triangles use, each once, in the order of `vertices` and relative to
    /// the origin.
    pub fn used(&self) -> Cow<'_, [Vec3]> {
        let mut used = vec![false; self.vertices.len()];
        self.triangles.iter().flatten().for_each(|&index| used[index as usize] = true);
        if !used.contains(&false) {
            return Cow::from(&self.vertices);
        }
        self.vertices.iter().zip(used).filter_map(|(vertex, used)| used.then_some(*vertex)).collect()
    }

    /// The three corners of a triangle, relative to the origin.
    pub fn corners(&self, triangle: [u32; 3]) -> [Vec3; 3] {
        triangle.map(|index| self.vertices[index as usize])
    }

    /// The mesh's triangles, mapped by `map` in f64 and then rounded once, with their colours
    /// multiplied by `colour`; None if a corner overflows f32.
    pub fn placed(self, map: ToCamera, colour: Vec3) -> Option<Faces> {
        self.moved(map, colour).map(|moved| moved.faces)
    }

    /// As [`placed`](Self::placed), with the numbers of the triangles that have no area.
    pub(super) fn moved(mut self, map: ToCamera, colour: Vec3) -> Option<MovedFaces> {
        // Triangles after the last run of colours are white: store that run, too.
        self.paint_to(self.triangles.len(), Vec3::ONE);
        let Mesh { vertices, origin, triangles, mut colours, .. } = self;
        colours.iter_mut().for_each(|(_, of)| *of *= colour);
        Faces::coloured(vertices, triangles, colours).moved(map.for_points_from(origin)).ok()
    }

    /// The colour of a triangle, by its number.
    pub fn colour(&self, triangle: usize) -> Vec3 {
        self.colours
            .get(self.colours.partition_point(|(end, _)| *end <= triangle))
            .map_or(Vec3::ONE, |(_, colour)| *colour)
    }

    /// Sets the colour of the triangles up to `end` that have none.
    fn paint_to(&mut self, end: usize, colour: Vec3) {
        match self.colours.last_mut() {
            Some((before, last)) if *last == colour => *before = end,
            Some((before, _)) if *before == end => {}
            None if end == 0 => {}
            _ => self.colours.push((end, colour)),
        }
    }

    /// Sets the colours of all triangles, given in their order.
    fn paint(&mut self, colours: impl Iterator<Item = Vec3>) {
        (1..).zip(colours).for_each(|(end, colour)| self.paint_to(end, colour));
        self.white_is_none();
    }

    /// Removes the runs of colours if all triangles are white, which is the default.
    fn white_is_none(&mut self) {
        self.colours.truncate(if matches!(self.colours[..], [(_, Vec3::ONE)]) { 0 } else { usize::MAX });
    }

    /// The mesh of a scene's triangles, in coordinates such that [`MeshFormat::placement`] of a
    /// file in this format maps them back to the camera's coordinates. Corners with equal bits
    /// become one vertex.
    pub fn of_scene(scene: &Scene, format: MeshFormat) -> Mesh {
        let mut known = HashMap::new();
        let mut mesh = Mesh::default();
        // The placements only exchange and negate axes, as mirror images: each is its own
        // inverse, and exact.
        let map = format.placement().to_world().inverse();
        for triangle in scene.all_triangles() {
            let corners = triangle.vertices.map(|vertex| {
                *known.entry(vertex.to_array().map(f32::to_bits)).or_insert_with(|| {
                    mesh.vertices.push(map.transform_point3(vertex.as_dvec3()).as_vec3());
                    (mesh.vertices.len() - 1) as u32
                })
            });
            mesh.triangles.push(corners);
        }
        mesh.paint(scene.all_triangles().map(|triangle| triangle.colour));
        mesh
    }
}
