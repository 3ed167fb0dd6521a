//! glTF 2.0: the triangles of a scene's nodes with their colours, the scene's first camera and
//! its point lights.

mod accessors;
mod buffers;
mod nodes;
mod primitives;
mod write;

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use ::gltf::binary::Glb;
use ::gltf::json::Root;
use glam::Vec3;
use serde::Deserialize;
use serde_json::Value;

use super::fault::NonFiniteVertex;
use super::vertices::Vertices;
use super::{Mesh, MeshError};
use crate::scene::diagnostic::brief;
use buffers::Buffers;

/// The first bytes of a binary file, which holds the JSON and the bytes of one buffer.
const MAGIC: &[u8] = b"glTF";
/// The length in bytes of a binary file's header, whose last word is the length of the file.
const HEADER: usize = 12;

/// How the names of the extensions begin that a file may require: as far as shapes and colours
/// are concerned, nothing beyond the core format has to be read for them.
const EXTENSIONS: [&str; 10] = [
    "KHR_lights_punctual",
    "KHR_mesh_quantization",
    "KHR_materials_",
    "KHR_techniques_",
    "KHR_texture_",
    "EXT_texture_",
    "MSFT_texture_",
    "KHR_animation_",
    "KHR_xmp",
    "KHR_audio",
];

/// Reads the mesh of a file in JSON or in binary. Buffers in other files are looked for in
/// `folder`; if that is None, such a buffer is an error.
pub(super) fn read(source: &[u8], folder: Option<&Path>) -> Result<Mesh, MeshError> {
    let (json, binary) = if source.starts_with(MAGIC) { split(source)? } else { (source, None) };
    let root: Root = serde_json::from_slice(json.trim_ascii_end()).map_err(|error| {
        // The JSON of version 1 has another structure: report the version rather than the failed
        // parsing.
        if let Ok(Versioned { asset: Asset { version } }) = serde_json::from_slice(json)
            && let Err(fault) = check_version(version.as_str().unwrap_or(&version.to_string()))
        {
            return fault;
        }
        let place = format!("line {} and column {} of the JSON", error.line(), error.column());
        let fault = MeshError::new(format!("the JSON is not that of glTF: {}", brief(&error.to_string())));
        fault.expected(format!("glTF 2.0 at {place}"))
    })?;
    check(&root)?;
    let mut file = File { root: &root, buffers: Buffers::new(&root, binary, folder), made: Made::default() };
    file.nodes()?;
    let File { buffers, made, .. } = file;
    made.finish(&root, buffers.files)
}

/// Splits a binary file into its JSON and its buffer's bytes.
fn split(source: &[u8]) -> Result<(&[u8], Option<&[u8]>), MeshError> {
    let word = |at: usize| source.get(at..at + 4).map(|word| u32::from_le_bytes([word[0], word[1], word[2], word[3]]));
    match (word(4), word(8)) {
        (Some(2), Some(length)) if length as usize >= HEADER && length as usize <= source.len() => {}
        (Some(2), Some(length)) => {
            let message = format!("the header claims a file of {length} bytes, and it has {}", source.len());
            return Err(MeshError::new(message).expected("the whole file"));
        }
        (Some(version), Some(_)) => {
            let message = format!("this is binary glTF of the version {version}");
            return Err(MeshError::new(message).expected("version 2: export it as glTF 2.0"));
        }
        _ => return Err(MeshError::new("the file ends in its header").expected("the whole file")),
    }
    let glb = Glb::from_slice(source).map_err(|error| {
        let fault = MeshError::new(format!("the file's chunks cannot be read: {}", brief(&error.to_string())));
        fault.expected("a chunk of JSON and one of bytes")
    })?;
    // Both chunks borrow from `source`.
    match (glb.json, glb.bin) {
        (Cow::Borrowed(json), None) => Ok((json, None)),
        (Cow::Borrowed(json), Some(Cow::Borrowed(bytes))) => Ok((json, Some(bytes))),
        _ => unreachable!("the library copies nothing"),
    }
}

/// The part of the JSON that files of all versions have.
#[derive(Deserialize)]
struct Versioned {
    asset: Asset,
}

#[derive(Deserialize)]
struct Asset {
    version: Value,
}

/// Rejects files that are not of version 2.
fn check_version(version: &str) -> Result<(), MeshError> {
    if version.starts_with("2.") {
        return Ok(());
    }
    let message = format!("the file is of the version `{}` of glTF", brief(version));
    Err(MeshError::new(message).expected("2.0: export it as glTF 2.0"))
}

/// Rejects files of other versions, and files that require an extension which is not read.
fn check(root: &Root) -> Result<(), MeshError> {
    check_version(&root.asset.version)?;
    let is_unread = |extension: &&String| !EXTENSIONS.iter().any(|known| extension.starts_with(known));
    let Some(unread) = root.extensions_required.iter().find(is_unread) else { return Ok(()) };
    let message = format!("the file needs the extension `{}`, which is not read", brief(unread));
    Err(MeshError::new(message).expected("a file that was exported without it, or decompressed"))
}

/// The state of reading a file.
struct File<'a> {
    root: &'a Root,
    buffers: Buffers<'a>,
    made: Made,
}

/// The mesh as far as it has been read.
#[derive(Default)]
struct Made {
    mesh: Mesh,
    points: Vertices,
    non_finite: Vec<NonFiniteVertex>,
    unread: Unread,
}

/// Content of the file that is not read, to be reported in notes, once each.
#[derive(Default)]
struct Unread {
    textures: bool,
    transparency: bool,
    skins: bool,
    morphs: bool,
    points_and_lines: bool,
    orthographic_cameras: bool,
    other_lights: bool,
}

impl Made {
    fn finish(self, root: &Root, files: Vec<PathBuf>) -> Result<Mesh, MeshError> {
        let Made { mut mesh, points, non_finite, unread } = self;
        (mesh.vertices, mesh.origin) = points.finish();
        mesh.drop_vertices(&non_finite);
        if !mesh.colours.is_empty() {
            mesh.paint_to(mesh.triangles.len(), Vec3::ONE);
        }
        mesh.white_is_none();
        mesh.libraries = files;
        let uses = |name: &str| root.extensions_used.iter().any(|used| used.starts_with(name));
        mesh.note_unread(&[
            ("textures", unread.textures),
            ("transparency", unread.transparency),
            ("skins", unread.skins),
            ("morph targets", unread.morphs),
            ("animations", !root.animations.is_empty()),
            ("points and lines", unread.points_and_lines),
            ("orthographic cameras", unread.orthographic_cameras),
            ("directional lights and spots", unread.other_lights),
            ("instances on the GPU", uses("EXT_mesh_gpu_instancing")),
            ("Draco's compressed copies", uses("KHR_draco_mesh_compression")),
            ("meshopt's compressed copies", uses("EXT_meshopt_compression") || uses("KHR_meshopt_compression")),
        ]);
        Ok(mesh)
    }
}

/// The error for an index in the JSON that is out of range.
fn missing(owner: &str, what: &str, index: usize, count: usize) -> MeshError {
    let has = if count == 1 { "has 1 of them".to_owned() } else { format!("has {count} of them") };
    MeshError::new(format!("{owner} refers to {what}[{index}], and the file {has}")).expected("a number from 0")
}
