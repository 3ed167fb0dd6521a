//! Triangle meshes: what their files hold, and where a scene puts them.

#[cfg(feature = "files")]
mod materials;
#[cfg(feature = "files")]
mod obj;
#[cfg(feature = "files")]
mod ply;
#[cfg(feature = "files")]
mod polygon;
#[cfg(feature = "files")]
mod read;
pub mod shapes;
#[cfg(feature = "files")]
mod stl;
#[cfg(feature = "files")]
mod write;

use std::borrow::Cow;
use std::collections::HashMap;
use std::fmt;
use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat3, DVec3, Vec3};

use super::diagnostic::shown;
use super::{Faces, Scene, ToCamera};
use crate::kernels::ColourRun;

/// Triangles that share their corners.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Points, each finite, in the file's own coordinates.
    pub vertices: Vec<Vec3>,
    /// Three indices into `vertices` for each triangle; methods panic where there is no such vertex.
    pub triangles: Vec<[u32; 3]>,
    /// Their colours, in runs of those that follow one another up to the last; none if all are white.
    pub colours: Vec<ColourRun>,
    /// How many faces of the file had more than three corners, and have become triangles: the same face where it is flat.
    pub polygons: usize,
    /// What the file has and the mesh has not, or is not as the file wants it: a sentence each.
    pub notes: Vec<String>,
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
}

/// What is wrong with a mesh file, and where.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", self.one_line())]
pub struct MeshError {
    /// The file.
    pub path: PathBuf,
    /// The line, from 1, where the file is text and the error has one.
    pub line: Option<usize>,
    /// What is wrong with which element, e.g. "face 17's corner 3 is vertex 9, which the file has not".
    pub message: String,
    /// What would have been right, where that is not obvious.
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
    /// What a file name ends in, in lower case, and the format that it stands for.
    pub const EXTENSIONS: &[(&str, MeshFormat)] =
        &[("obj", MeshFormat::Obj), ("ply", MeshFormat::Ply), ("stl", MeshFormat::Stl)];

    /// The format that the file name asks for by its extension, in upper or lower case.
    pub fn from_path(path: &Path) -> Option<MeshFormat> {
        let extension = path.extension()?;
        let known = MeshFormat::EXTENSIONS.iter().find(|(known, _)| extension.eq_ignore_ascii_case(known));
        known.map(|&(_, format)| format)
    }

    /// The name that people know it by.
    pub fn name(self) -> &'static str {
        match self {
            MeshFormat::Obj => "OBJ",
            MeshFormat::Ply => "PLY",
            MeshFormat::Stl => "STL",
        }
    }

    /// How files of this format are taken to stand in the world, where nobody says otherwise: their coordinates are
    /// right-handed, and the world is left-handed; y is up, but in STL, which printers use, z.
    pub fn placement(self) -> Placement {
        let scale = DVec3::new(1.0, 1.0, -1.0);
        let rotate = if self == MeshFormat::Stl { DVec3::new(90.0, 0.0, 0.0) } else { DVec3::ZERO };
        Placement { scale, rotate, translate: DVec3::ZERO }
    }
}

impl fmt::Display for MeshFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// How a mesh is put into the world: scaled, then rotated, then moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Factors along the mesh's own axes; a negative one mirrors.
    pub scale: DVec3,
    /// Degrees about x, then about y, then about z: 90 about x takes y to z, about y z to x, about z x to y.
    pub rotate: DVec3,
    /// What is added at last.
    pub translate: DVec3,
}

impl Placement {
    /// Everything where it is.
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

/// Of an angle in degrees; exact for quarter turns.
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
    /// The vertices that triangles have, each once, in their order.
    pub fn used(&self) -> Cow<'_, [Vec3]> {
        let mut used = vec![false; self.vertices.len()];
        self.triangles.iter().flatten().for_each(|&index| used[index as usize] = true);
        if !used.contains(&false) {
            return Cow::from(&self.vertices);
        }
        self.vertices.iter().zip(used).filter_map(|(vertex, used)| used.then_some(*vertex)).collect()
    }

    /// The three corners of a triangle.
    pub fn corners(&self, triangle: [u32; 3]) -> [Vec3; 3] {
        triangle.map(|index| self.vertices[index as usize])
    }

    /// Its triangles, moved by `map` in f64 and rounded once, their colours times `colour`; nothing where a corner leaves the
    /// range of f32.
    pub fn placed(self, map: ToCamera, colour: Vec3) -> Option<Faces> {
        let Mesh { vertices, triangles, mut colours, .. } = self;
        if colours.is_empty() {
            colours.push((triangles.len(), Vec3::ONE));
        }
        colours.iter_mut().for_each(|(_, of)| *of *= colour);
        Faces::coloured(vertices, triangles, colours).moved(map).ok()
    }

    /// The colour of a triangle, by its number.
    pub fn colour(&self, triangle: usize) -> Vec3 {
        self.colours
            .get(self.colours.partition_point(|(end, _)| *end <= triangle))
            .map_or(Vec3::ONE, |(_, colour)| *colour)
    }

    /// Gives a colour to the triangles up to `end` that have none.
    fn paint_to(&mut self, end: usize, colour: Vec3) {
        match self.colours.last_mut() {
            Some((before, last)) if *last == colour => *before = end,
            Some((before, _)) if *before == end => {}
            None if end == 0 => {}
            _ => self.colours.push((end, colour)),
        }
    }

    /// Gives all triangles colours, in their order.
    fn paint(&mut self, colours: impl Iterator<Item = Vec3>) {
        (1..).zip(colours).for_each(|(end, colour)| self.paint_to(end, colour));
        self.white_is_none();
    }

    /// Forgets colours that are all white.
    fn white_is_none(&mut self) {
        self.colours.truncate(if matches!(self.colours[..], [(_, Vec3::ONE)]) { 0 } else { usize::MAX });
    }

    /// The mesh of a scene's triangles, as a file of a format would hold it so that [`MeshFormat::placement`] gives the
    /// camera's frame. Corners that are equal bit by bit become one vertex.
    pub fn of_scene(scene: &Scene, format: MeshFormat) -> Mesh {
        let mut known = HashMap::new();
        let mut mesh = Mesh::default();
        // The placements are mirror images that exchange and negate axes: their own inverses, and exact.
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
