//! Scene files by their names: the paper's format, TOML, or a mesh alone, read into the one [`Scene`].

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read};
use std::path::Path;

use glam::Vec3;

use super::diagnostic::{is_unseen, shown};
use super::log::is_line_end;
use super::parse::parse_with_warnings;
use super::token::next_token;
use super::{Camera, Faces, Mesh, MeshError, MeshFormat, Opened, Scene, SceneError, Setting, parse_toml};
use crate::kernels::sys::room;

/// The longest scene file, in bytes.
const MAX_FILE: u64 = 4 << 30;
/// The longest scene in TOML, in bytes: its text takes some forty times as much memory while it is read.
pub const MAX_TOML: u64 = 32 << 20;
/// The most that is read from a source whose length is unknown: a pipe, a device.
const MAX_STREAM: u64 = 64 << 20;
/// The message for a longer scene.
const FOR_A_SCENE: &str = "too many for a scene";
const STANDARD_INPUT: &str = "-";

/// The formats of scene files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneFormat {
    /// The paper's.
    In,
    Toml,
    /// A mesh, which is not a whole scene.
    Mesh(MeshFormat),
}

impl SceneFormat {
    /// The format by the file name's extension, in upper or lower case; None if it is unknown.
    pub fn from_path(path: &Path) -> Option<SceneFormat> {
        let extension = path.extension()?;
        if extension.eq_ignore_ascii_case("in") {
            Some(SceneFormat::In)
        } else if extension.eq_ignore_ascii_case("toml") {
            Some(SceneFormat::Toml)
        } else {
            MeshFormat::from_path(path).map(SceneFormat::Mesh)
        }
    }
}

/// Reads a scene file: TOML if its name ends in `.toml`, a mesh in `.obj`, `.ply` or `.stl`, and the paper's format for
/// any other name. `-` is standard input, which is TOML if its first line with content is a table or a key.
///
/// `camera` is for a mesh alone, which has none: it is placed to see the whole mesh, in white, under one light.
///
/// # Errors
/// [`SceneError::Read`] if there is no such file, it is a directory, may not be read, or has more than 4 GiB (64 MiB
/// for a pipe or a device, 32 MiB for TOML); otherwise what [`parse`](super::parse()), [`parse_toml`] or [`Mesh::read`] returns.
pub fn open(path: &Path, camera: &Camera) -> Result<Opened, SceneError> {
    let unread = |cause: io::Error| {
        let near = if cause.kind() == ErrorKind::NotFound { nearest(path) } else { None };
        let cause = near.map_or(cause, |near| io::Error::new(ErrorKind::NotFound, format!("did you mean `{near}`?")));
        SceneError::Read { path: path.to_owned(), cause }
    };
    if path == Path::new(STANDARD_INPUT) {
        let source = within(io::stdin().lock(), 0, MAX_STREAM, FOR_A_SCENE).map_err(unread)?;
        let name = "standard input";
        let parsed = if is_toml(&source) {
            parse_toml(&source, name, Path::new(""))
        } else {
            parse_with_warnings(&source, name)
        };
        let mut opened = parsed.map_err(|error| no_picture(error, path, &source))?;
        opened.files.push("/dev/stdin".into());
        return Ok(opened);
    }
    let name = path.to_string_lossy();
    let mut opened = match SceneFormat::from_path(path) {
        Some(SceneFormat::Toml) => {
            let folder = path.parent().unwrap_or(Path::new(""));
            let advice = "too many for TOML: put its triangles into a mesh file, which [[mesh]] names";
            parse_toml(&contents_within(path, MAX_TOML, advice).map_err(unread)?, &name, folder)
        }
        Some(SceneFormat::Mesh(format)) => open_mesh(path, format, camera),
        Some(SceneFormat::In) | None => {
            let source = contents(path).map_err(unread)?;
            parse_with_warnings(&source, &name).map_err(|error| match no_picture(error, path, &source) {
                SceneError::Invalid { .. } if is_foreign(path, &source) => SceneError::Foreign { path: path.into() },
                error => error,
            })
        }
    }?;
    opened.files.push(path.to_owned());
    Ok(opened)
}

/// A file that can be read again after a first attempt failed, and its length.
pub(super) fn read_twice(path: &Path) -> Option<(File, usize)> {
    let metadata = fs::metadata(path).ok().filter(|metadata| metadata.is_file() && metadata.len() <= MAX_FILE)?;
    Some((File::open(path).ok()?, metadata.len() as usize))
}

/// Whether a text without a name is TOML: its first line with content begins a table or assigns a key.
fn is_toml(source: &[u8]) -> bool {
    let source = source.strip_prefix(b"\xef\xbb\xbf").unwrap_or(source);
    let lines = source.split(|byte| is_line_end(*byte)).map(<[u8]>::trim_ascii);
    let first = lines.into_iter().find(|line| !line.is_empty() && !line.starts_with(b"#"));
    first.is_some_and(|line| line.starts_with(b"[") || !line.starts_with(b"//") && line.contains(&b'='))
}

/// The error for a file that is not a scene; for a picture, an error that says so.
fn no_picture(error: SceneError, path: &Path, source: &[u8]) -> SceneError {
    const BEGINNINGS: [&[u8]; 13] = [
        b"\x89PNG",
        b"\xff\xd8\xff",
        b"GIF8",
        b"II*\0",
        b"II+\0",
        b"MM\0*",
        b"MM\0+",
        b"v/1\x01",
        b"#?R",
        b"qoif",
        b"P3",
        b"P6",
        b"PF",
    ];
    if BEGINNINGS.iter().any(|beginning| source.starts_with(beginning)) {
        return SceneError::Picture { path: path.to_owned() };
    }
    error
}

/// Whether a file that is not a scene is not meant as one in the paper's format either: by its name, and because it
/// does not begin with a name, a width and a height.
fn is_foreign(path: &Path, source: &[u8]) -> bool {
    let mut at = 0;
    let mut token = || {
        let token = next_token(source, at)?;
        at = token.end;
        Some(&source[token])
    };
    let begins = token().is_some() && (0..2).all(|_| token().is_some_and(|side| side.iter().all(u8::is_ascii_digit)));
    path.extension().is_some() && SceneFormat::from_path(path).is_none() && !begins
}

/// The path that was probably meant in place of a missing one: a scene or a mesh in the same folder whose name differs
/// in at most two letters or in its extension.
pub(super) fn nearest(path: &Path) -> Option<String> {
    /// At most this many files are looked at.
    const MOST: usize = 10_000;
    let folder = path.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    let name = path.file_name()?.to_string_lossy();
    let near = fs::read_dir(folder).ok()?.take(MOST).filter_map(|entry| {
        let other = path.with_file_name(entry.ok()?.file_name());
        SceneFormat::from_path(&other).filter(|_| other != path)?;
        let apart = strsim::damerau_levenshtein(&name, &other.file_name()?.to_string_lossy());
        let apart = if other.file_stem() == path.file_stem() { apart.min(1) } else { apart };
        (apart <= 2).then(|| (apart, shown(&other)))
    });
    Some(near.min()?.1)
}

/// Reads a scene file as [`open`] does; a mesh alone gets 800 x 600 pixels.
///
/// # Errors
/// As [`open`].
pub fn read(path: &Path) -> Result<Scene, SceneError> {
    Ok(open(path, &Camera::default())?.scene)
}

/// What a picture of the mesh in a file is called.
pub(crate) fn picture_name(path: &Path) -> String {
    // No picture is written under a name with unseen characters.
    format!("{}.png", path.file_stem().unwrap_or_default().to_string_lossy()).replace(is_unseen, "_")
}

fn open_mesh(path: &Path, format: MeshFormat, camera: &Camera) -> Result<Opened, SceneError> {
    let mesh = Mesh::read(path).map_err(SceneError::Mesh)?;
    let (mut notes, files) = (told(path, &mesh), mesh.libraries.clone());
    let setting = Setting::of(&mesh, format, camera);
    let scene = setting
        .and_then(|setting| Some((setting.view.up()?, setting.scene(mesh, Vec3::ONE, picture_name(path), *camera)?)));
    let (above, scene) = scene.ok_or_else(|| {
        let fault = MeshError::new("the mesh is too large or too far away to be seen whole");
        SceneError::Mesh(fault.expected("ordinary coordinates, and no extreme film or focal distance").of(path))
    })?;
    let up = if format == MeshFormat::Stl { "z" } else { "y" };
    notes.push(format!(
        "{}: a mesh alone: {up} is up, the camera sees all of it from the front, the right and above, one white light \
         stands to the left above the camera; `rayo convert` makes a scene of it, to be changed",
        shown(path)
    ));
    let warnings = no_area_of_mesh(path, &scene.faces).into_iter().collect();
    Ok(Opened { scene, up: above, files, notes, warnings })
}

/// A warning of the triangles of a mesh that have no area, which are often its seams: their number, and the first of
/// them by their numbers in the file, from 1, where a face of more corners counts as the triangles it is cut into.
pub(super) fn no_area_of_mesh(path: &Path, mesh: &Faces) -> Option<String> {
    const MOST: usize = 5;
    let numbers = mesh.without_area();
    let listed: Vec<_> = numbers.iter().take(MOST).map(|number| (number + 1).to_string()).collect();
    let (count, listed) = (numbers.len(), listed.join(", "));
    let path = shown(path);
    match count {
        0 => None,
        1 => Some(format!("{path}: triangle {listed} has no area, and no ray hits it")),
        2..=MOST => Some(format!("{path}: {count} triangles have no area, and no ray hits them: {listed}")),
        _ => Some(format!("{path}: {count} triangles have no area, and no ray hits them: {listed} and so on")),
    }
}

/// Notes on a mesh: faces that were triangulated, and content of its file that was skipped.
pub(super) fn told(path: &Path, mesh: &Mesh) -> Vec<String> {
    let cut = match mesh.polygons {
        0 => None,
        1 => Some("1 face of more than three corners was cut into triangles".to_owned()),
        many => Some(format!("{many} faces of more than three corners were cut into triangles")),
    };
    cut.iter().chain(&mesh.notes).map(|note| format!("{}: {note}", shown(path))).collect()
}

/// A file's bytes, up to the limit of its kind.
pub(super) fn contents(path: &Path) -> io::Result<Vec<u8>> {
    contents_within(path, MAX_FILE, FOR_A_SCENE)
}

/// A file's bytes if there are at most `limit`, else an error with `advice`.
pub(super) fn contents_within(path: &Path, limit: u64, advice: &str) -> io::Result<Vec<u8>> {
    let metadata = fs::metadata(path)?;
    if metadata.is_dir() {
        return Err(ErrorKind::IsADirectory.into());
    }
    let limit = if metadata.is_file() { limit } else { limit.min(MAX_STREAM) };
    if metadata.len() > limit {
        return Err(too_large(limit, advice));
    }
    // The length is only what the file system says: the bytes read are limited, too.
    within(File::open(path)?, metadata.len(), limit, advice)
}

/// The same for a text.
#[cfg(feature = "lab")]
pub(crate) fn text_within(path: &Path, limit: u64, advice: &str) -> io::Result<String> {
    String::from_utf8(contents_within(path, limit, advice)?)
        .map_err(|error| io::Error::new(ErrorKind::InvalidData, error))
}

/// The bytes of `reader`, with room for `likely` of them from the start.
fn within(reader: impl Read, likely: u64, limit: u64, advice: &str) -> io::Result<Vec<u8>> {
    let mut source = room(likely as usize);
    reader.take(limit + 1).read_to_end(&mut source)?;
    if source.len() as u64 > limit { Err(too_large(limit, advice)) } else { Ok(source) }
}

fn too_large(limit: u64, advice: &str) -> io::Error {
    let size = limit >> 20;
    io::Error::new(ErrorKind::FileTooLarge, format!("it has more than {size} MiB, {advice}"))
}
