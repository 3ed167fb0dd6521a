//! Reading mesh files: what all formats share, from choosing the format to storing faces of any
//! number of corners.

use std::io::{self, ErrorKind, Read};
use std::path::Path;

use super::fault::NonFiniteVertex;
use super::materials::Materials;
use super::polygon::{self, Fan};
use super::{Mesh, MeshError, MeshFormat, gltf, obj, ply, stl};
use crate::kernels::StandardFloats;
use crate::scene::chunks::SharedFile;
use crate::scene::diagnostic::{ONLY_FILES, is_address};
use crate::scene::log::BYTE_ORDER_MARK;
use crate::scene::mistaken::{BEGINNING, Mistaken, recognise, recognise_unread};
use crate::scene::open;

impl Mesh {
    /// Reads a mesh file in the format of its extension.
    ///
    /// # Errors
    /// If it cannot be read or is damaged; [`MeshError`] names the file and the element. Material
    /// files that cannot be read are not an error, but a note. The memory used stays within a small
    /// multiple of the file's length, whatever sizes its header claims.
    pub fn read(path: &Path) -> Result<Mesh, MeshError> {
        Mesh::read_with_threads(path, 1)
    }

    /// As [`read`](Self::read), with up to this many threads if the file is a long OBJ. The number
    /// of threads changes neither the mesh nor the errors.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn read_with_threads(path: &Path, threads: usize) -> Result<Mesh, MeshError> {
        let _floats = StandardFloats::set();
        let format = MeshFormat::from_path(path).ok_or_else(|| {
            let fault = MeshError::new("the name of a mesh file tells its format");
            fault.expected(".obj, .ply, .stl, .glb or .gltf at its end").of(path)
        })?;
        let unread = |cause: io::Error| unread(path, &cause, "a mesh file");
        let folder = path.parent().unwrap_or(Path::new(""));
        if format == MeshFormat::Gltf {
            let source = open::contents(path).map_err(|cause| unread(cause).of(path))?;
            return gltf_of_bytes(&source, Some(folder)).map_err(|fault| fault.of(path));
        }
        let in_pieces = open::read_twice(path).and_then(|(file, length)| {
            let shared = SharedFile::new(&file, threads);
            parse(&file, length, format, Some(shared))
        });
        let read = in_pieces.unwrap_or_else(|| parse_all(&open::contents(path).map_err(unread)?, format));
        let (mut mesh, materials) = read.map_err(|fault| fault.of(path))?;
        materials.paint(&mut mesh, folder);
        Ok(mesh)
    }

    /// Reads the content of a mesh file; errors call the file `name`. Other files, with the
    /// materials of OBJ, are not read, and a glTF file must contain all of its buffers.
    ///
    /// # Errors
    /// As [`Mesh::read`].
    pub fn from_bytes(source: Vec<u8>, format: MeshFormat, name: &str) -> Result<Mesh, MeshError> {
        let _floats = StandardFloats::set();
        let mesh = match format {
            MeshFormat::Gltf => gltf_of_bytes(&source, None),
            _ => parse_all(&source, format).map(|(mesh, _)| mesh),
        };
        mesh.map_err(|fault| fault.of(name))
    }

    /// Adds face `number`, with at least three corners, as a fan around its first corner.
    pub(super) fn push_face(&mut self, number: usize, corners: &[u32], fans: &mut Vec<Fan>) {
        if corners.len() > 3 {
            fans.push(Fan { number, first: self.triangles.len(), corners: corners.len() });
        }
        self.triangles.extend(corners[1..].windows(2).map(|pair| [corners[0], pair[0], pair[1]]));
    }

    /// An error if one of these vertices is a corner of a triangle: that of the first such vertex.
    /// `non_finite` is in ascending order.
    pub(super) fn refuse_used(&self, non_finite: &[NonFiniteVertex]) -> Result<(), MeshError> {
        let Some(first) = non_finite.first() else { return Ok(()) };
        let mut used = vec![false; self.vertices.len() - first.index];
        for index in self.triangles.as_flattened() {
            if let Some(used) = (*index as usize).checked_sub(first.index).and_then(|index| used.get_mut(index)) {
                *used = true;
            }
        }
        let first_used = non_finite.iter().find(|vertex| used[vertex.index - first.index]);
        first_used.map_or(Ok(()), |vertex| Err(vertex.fault()))
    }

    /// Removes these vertices, which are in ascending order and which no triangle uses.
    pub(super) fn drop_vertices(&mut self, dropped: &[NonFiniteVertex]) {
        if dropped.is_empty() {
            return;
        }
        let mut index = 0;
        self.vertices.retain(|_| {
            index += 1;
            dropped.binary_search_by_key(&(index - 1), |vertex| vertex.index).is_err()
        });
        for index in self.triangles.as_flattened_mut() {
            *index -= dropped.partition_point(|vertex| vertex.index < *index as usize) as u32;
        }
    }

    /// Triangulates the faces that are not convex, once all vertices are known.
    pub(super) fn cut(mut self, fans: &[Fan]) -> Result<Mesh, MeshError> {
        self.polygons = fans.len();
        polygon::cut(fans, &self.vertices, &mut self.triangles)?;
        Ok(self)
    }
}

/// The error for a file that cannot be read; `what` says what was expected to be there.
pub(in crate::scene) fn unread(path: &Path, cause: &io::Error, what: &str) -> MeshError {
    match cause.kind() {
        ErrorKind::NotFound if is_address(path) => MeshError::new(ONLY_FILES),
        ErrorKind::NotFound => MeshError::new("there is no such file")
            .expected(open::nearest(path).map_or(what.into(), |near| format!("{what}, such as `{near}`"))),
        ErrorKind::IsADirectory => MeshError::new("this is a directory").expected(what),
        ErrorKind::PermissionDenied => MeshError::new("the file may not be read").expected("permission to read it"),
        _ => MeshError::new(format!("the file cannot be read: {cause}")),
    }
}

/// Reads the mesh of a file of this length, of which only a piece is in memory at a time; None if
/// the file cannot be read. `shared`, if given, is the same file for reading with several threads.
fn parse(
    mut file: impl Read,
    length: usize,
    format: MeshFormat,
    shared: Option<SharedFile<'_>>,
) -> Option<Result<(Mesh, Materials), MeshError>> {
    if length == 0 {
        return Some(Err(MeshError::new("the file is empty").expected(format!("a mesh in the format {format}"))));
    }
    let mut begin = Vec::new();
    file.by_ref().take(BEGINNING as u64).read_to_end(&mut begin).ok()?;
    if let Some(mistaken) = recognise(&begin).filter(|_| format != MeshFormat::Stl) {
        return Some(Err(MeshError::mistaken(mistaken)));
    }
    // Skip a byte order mark in text formats. The title of a binary STL may begin with any bytes.
    let text = begin.strip_prefix(BYTE_ORDER_MARK.as_bytes()).filter(|_| format != MeshFormat::Stl).unwrap_or(&begin);
    let unread = recognise_unread(&begin).or_else(|| other_mesh(&begin, format));
    let mark = begin.len() - text.len();
    let (file, length) = (text.chain(file), length.saturating_sub(mark));
    let alone = |mesh| (mesh, Materials::default());
    let read = match format {
        MeshFormat::Obj => obj::read(file, length, shared.map(|shared| shared.after(mark)))?,
        MeshFormat::Ply => ply::read(file, length)?.map(alone),
        MeshFormat::Stl => stl::read(file, length)?.map(alone),
        // glTF needs the whole file at once; the caller reads it so.
        MeshFormat::Gltf => unreachable!("glTF is not read in pieces"),
    };
    let read = read.and_then(|(mesh, materials)| Ok((not_empty(mesh)?, materials)));
    // Report that the file is of another kind only if it could not be read: a binary STL may begin
    // with any bytes, and a text with any words.
    Some(read.map_err(|fault| unread.map_or(fault, MeshError::mistaken)))
}

/// Reads the mesh from the content of a glTF file, with other buffers from files in `folder`.
fn gltf_of_bytes(source: &[u8], folder: Option<&Path>) -> Result<Mesh, MeshError> {
    let text = source.strip_prefix(BYTE_ORDER_MARK.as_bytes()).unwrap_or(source);
    gltf::read(text, folder).and_then(not_empty).map_err(|fault| {
        let mistaken = recognise_unread(source).or_else(|| other_mesh(source, MeshFormat::Gltf));
        mistaken.map_or(fault, MeshError::mistaken)
    })
}

/// The mesh, or an error if it has no triangles.
fn not_empty(mesh: Mesh) -> Result<Mesh, MeshError> {
    if mesh.triangles.is_empty() {
        return Err(MeshError::new("the mesh is empty").expected("at least one face"));
    }
    Ok(mesh)
}

/// The mesh format that a file begins as, if that differs from the format its name says.
fn other_mesh(beginning: &[u8], format: MeshFormat) -> Option<&'static Mistaken> {
    const HELP: &str = "give its name the ending of its format";
    const OTHERS: [(&[u8], Mistaken); 4] = [
        (b"ply", Mistaken { what: "this looks like a PLY file", help: HELP }),
        (b"solid ", Mistaken { what: "this looks like an STL file", help: HELP }),
        (b"OFF", Mistaken { what: "this looks like an OFF file", help: "export it as .obj, .ply or .stl" }),
        (b"glTF", Mistaken { what: "this looks like a glTF file", help: HELP }),
    ];
    let own: &[u8] = match format {
        MeshFormat::Obj => b"",
        MeshFormat::Ply => b"ply",
        MeshFormat::Stl => b"solid ",
        MeshFormat::Gltf => b"glTF",
    };
    let is_other = |(begins, _): &&(&[u8], Mistaken)| *begins != own && beginning.starts_with(begins);
    OTHERS.iter().find(is_other).map(|(_, mistaken)| mistaken)
}

fn parse_all(source: &[u8], format: MeshFormat) -> Result<(Mesh, Materials), MeshError> {
    parse(source, source.len(), format, None).expect("memory can be read")
}
