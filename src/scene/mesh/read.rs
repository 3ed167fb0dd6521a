//! Reading mesh files: what all formats share, from the file's name to faces of any number of corners.

use std::io::{self, ErrorKind, Read};
use std::path::Path;

use super::materials::Materials;
use super::polygon::{self, Fan};
use super::{Mesh, MeshError, MeshFormat, obj, ply, stl};
use crate::scene::log::BYTE_ORDER_MARK;
use crate::scene::open;

impl Mesh {
    /// Reads a mesh file in the format of its extension.
    ///
    /// # Errors
    /// If it cannot be read or is damaged; [`MeshError`] names the file and the element. Unreadable materials are not
    /// an error, but a note. Memory stays within a small multiple of the file's length, whatever its header claims.
    pub fn read(path: &Path) -> Result<Mesh, MeshError> {
        let format = MeshFormat::from_path(path).ok_or_else(|| {
            let fault = MeshError::new("the name of a mesh file tells its format");
            fault.expected(".obj, .ply or .stl at its end").of(path)
        })?;
        let unread = |cause: io::Error| match cause.kind() {
            ErrorKind::NotFound => MeshError::new("there is no such file").expected(
                open::nearest(path).map_or("a mesh file".into(), |near| format!("a mesh file, such as `{near}`")),
            ),
            ErrorKind::IsADirectory => MeshError::new("this is a directory").expected("a mesh file"),
            ErrorKind::PermissionDenied => MeshError::new("the file may not be read").expected("permission to read it"),
            _ => MeshError::new(format!("the file cannot be read: {cause}")),
        };
        let in_pieces = open::read_twice(path).and_then(|(file, length)| parse(file, length, format));
        let read = in_pieces.unwrap_or_else(|| parse_all(&open::contents(path).map_err(unread)?, format));
        let (mut mesh, materials) = read.map_err(|fault| fault.of(path))?;
        materials.paint(&mut mesh, path.parent().unwrap_or(Path::new("")));
        Ok(mesh)
    }

    /// Reads the content of a mesh file, without the materials in other files; errors call it `name`.
    ///
    /// # Errors
    /// As [`Mesh::read`].
    pub fn from_bytes(source: Vec<u8>, format: MeshFormat, name: &str) -> Result<Mesh, MeshError> {
        parse_all(&source, format).map(|(mesh, _)| mesh).map_err(|fault| fault.of(name))
    }

    /// Adds face `number`, of three corners or more, as a fan around its first.
    pub(super) fn push_face(&mut self, number: usize, corners: &[u32], fans: &mut Vec<Fan>) {
        if corners.len() > 3 {
            fans.push(Fan { number, first: self.triangles.len(), corners: corners.len() });
        }
        self.triangles.extend(corners[1..].windows(2).map(|pair| [corners[0], pair[0], pair[1]]));
    }

    /// Triangulates faces that are not convex, now that all vertices are known.
    pub(super) fn cut(mut self, fans: &[Fan]) -> Result<Mesh, MeshError> {
        self.polygons = fans.len();
        polygon::cut(fans, &self.vertices, &mut self.triangles)?;
        Ok(self)
    }
}

/// The mesh of a file of this length, with only a piece at a time in memory; None if that cannot be read.
fn parse(mut file: impl Read, length: usize, format: MeshFormat) -> Option<Result<(Mesh, Materials), MeshError>> {
    if length == 0 {
        return Some(Err(MeshError::new("the file is empty").expected(format!("a mesh in the format {format}"))));
    }
    let mut begin = Vec::new();
    file.by_ref().take(8).read_to_end(&mut begin).ok()?;
    // The title of a binary STL may begin with anything.
    let text = begin.strip_prefix(BYTE_ORDER_MARK.as_bytes());
    let text = text.filter(|text| format != MeshFormat::Stl || *text == b"solid").unwrap_or(&begin);
    let (file, length) = (text.chain(file), length.saturating_sub(begin.len() - text.len()));
    let alone = |mesh| (mesh, Materials::default());
    let read = match format {
        MeshFormat::Obj => obj::read(file, length)?,
        MeshFormat::Ply => ply::read(file, length)?.map(alone),
        MeshFormat::Stl => stl::read(file, length)?.map(alone),
    };
    let empty = || MeshError::new("the mesh is empty").expected("at least one face");
    Some(read.and_then(|read| if read.0.triangles.is_empty() { Err(empty()) } else { Ok(read) }))
}

fn parse_all(source: &[u8], format: MeshFormat) -> Result<(Mesh, Materials), MeshError> {
    parse(source, source.len(), format).expect("memory can be read")
}
