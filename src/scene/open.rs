//! Opening a file as a [`Scene`]: a scene in the paper's format or in TOML, or a mesh, molecule or
//! point cloud for which camera and lights are chosen.

use std::fs::{self, File};
use std::io::{self, ErrorKind, Read};
use std::path::Path;

use glam::DVec3;

use super::chunks::SharedFile;
use super::content::{is_toml, no_scene};
use super::diagnostic::{is_unseen, shown};
use super::mesh::ply;
use super::parse::{parse_with_warnings, streamed};
use super::tables::parse_with_threads;
use super::{
    Camera, Cloud, CloudFormat, Mesh, MeshError, MeshFormat, ModelOptions, MovedFaces, Opened, Scene, SceneError,
    Setting, UpAxis, parse_toml,
};
use crate::kernels::StandardFloats;
use crate::kernels::sys::room;

/// The longest scene file, in bytes.
const MAX_FILE: u64 = 4 << 30;
/// The longest scene in TOML, in bytes. Parsing takes about forty times as much memory.
pub const MAX_TOML: u64 = 32 << 20;
/// The most bytes that are read from a source of unknown length: a pipe or a device.
const MAX_STREAM: u64 = 64 << 20;
/// What the error says about a scene file that is too long.
const FOR_A_SCENE: &str = "too many for a scene";
const TOO_MUCH_TOML: &str = "too many for TOML: put its triangles into a mesh file, which [[mesh]] names";
const STANDARD_INPUT: &str = "-";

/// The formats of scene files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneFormat {
    /// The paper's text format, `.in`.
    In,
    /// TOML: a world and its camera, which may contain meshes.
    Toml,
    /// A mesh. It has no lights and mostly no camera, which are chosen for it.
    Mesh(MeshFormat),
    /// Atoms or points, for which camera and lights are chosen, too.
    Cloud(CloudFormat),
}

impl SceneFormat {
    /// The format that the file name's extension tells, in upper or lower case; None if the
    /// extension is unknown.
    pub fn from_path(path: &Path) -> Option<SceneFormat> {
        let extension = path.extension()?;
        if extension.eq_ignore_ascii_case("in") {
            Some(SceneFormat::In)
        } else if extension.eq_ignore_ascii_case("toml") {
            Some(SceneFormat::Toml)
        } else {
            let mesh = MeshFormat::from_path(path).map(SceneFormat::Mesh);
            mesh.or(CloudFormat::from_path(path).map(SceneFormat::Cloud))
        }
    }
}

/// Reads a scene file. The extension tells the format: `.toml` is TOML; `.obj`, `.ply`, `.stl`,
/// `.gltf` and `.glb` are meshes; `.xyz`, `.pdb` and `.cif` are atoms or points. With any other
/// name, or from standard input (`-`), a file is TOML if its first line that is neither blank nor a
/// comment begins a table or assigns a key, and otherwise in the paper's format.
///
/// `camera` is used for a file of a mesh, atoms or points alone: it is placed such that it sees all
/// of it. Objects without colours are white. One light is at the left above the camera, and a
/// weaker one at the camera.
///
/// # Errors
/// [`SceneError::Read`] if the file does not exist, is a directory, may not be read, or is longer
/// than 4 GiB (64 MiB for a pipe or a device, 32 MiB for TOML); otherwise the errors of
/// [`parse`](super::parse()), [`parse_toml`], [`Mesh::read`] or [`Cloud::read`].
pub fn open(path: &Path, camera: &Camera) -> Result<Opened, SceneError> {
    open_with(path, &ModelOptions::of(*camera))
}

/// As [`open`], with options for files without a camera. For scenes in the paper's format and in
/// TOML only the number of threads matters.
///
/// # Errors
/// As [`open`].
pub fn open_with(path: &Path, options: &ModelOptions) -> Result<Opened, SceneError> {
    let _floats = StandardFloats::set();
    let unread = |cause: io::Error| {
        let near = if cause.kind() == ErrorKind::NotFound { nearest(path) } else { None };
        let cause = near.map_or(cause, |near| io::Error::new(ErrorKind::NotFound, format!("did you mean `{near}`?")));
        SceneError::Read { path: path.to_owned(), cause }
    };
    if path == Path::new(STANDARD_INPUT) {
        let source = within(io::stdin().lock(), 0, MAX_STREAM, FOR_A_SCENE).map_err(unread)?;
        let mut opened = read_by_content(path, &source, "standard input", Path::new(""))?;
        opened.files.push("/dev/stdin".into());
        return Ok(opened);
    }
    let name = path.to_string_lossy();
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut opened = match SceneFormat::from_path(path) {
        Some(SceneFormat::Toml) => {
            let source = contents_within(path, MAX_TOML, TOO_MUCH_TOML).map_err(unread)?;
            parse_with_threads(&source, &name, folder, options.threads).map_err(|error| no_scene(error, path, &source))
        }
        Some(SceneFormat::Mesh(MeshFormat::Ply)) if has_points(path, options) => open_cloud(path, None, options),
        Some(SceneFormat::Mesh(format)) => open_mesh(path, format, options),
        Some(SceneFormat::Cloud(format)) => open_cloud(path, Some(format), options),
        Some(SceneFormat::In) | None => match open_in_pieces(path, &name, options.threads) {
            Some(opened) => Ok(opened),
            None => {
                let source = contents(path).map_err(unread)?;
                // Mesh files that a pipe or /dev/stdin names are relative to the current directory.
                let has_place = path.is_file() && !path.starts_with("/dev");
                let folder = if has_place { folder } else { Path::new("") };
                read_by_content(path, &source, &name, folder)
            }
        },
    }?;
    opened.files.push(path.to_owned());
    Ok(opened)
}

/// Reads a scene in the paper's format piece by piece; None if only the parser of whole texts can
/// read it or report its errors.
fn open_in_pieces(path: &Path, name: &str, threads: usize) -> Option<Opened> {
    let (file, length) = read_twice(path)?;
    let shared = SharedFile::new(&file, threads);
    let open = |at| shared.rest(at).map(|file| Box::new(file) as Box<dyn Read>);
    streamed::read(&open, length, Some(shared), name)
}

/// Reads a scene whose name does not tell its format: TOML if it looks so, else the paper's format.
fn read_by_content(path: &Path, source: &[u8], name: &str, folder: &Path) -> Result<Opened, SceneError> {
    let error = match parse_with_warnings(source, name) {
        Ok(opened) => return Ok(opened),
        Err(error) => no_scene(error, path, source),
    };
    if matches!(error, SceneError::Picture { .. } | SceneError::NamelessMesh { .. }) || !is_toml(source) {
        return Err(error);
    }
    if source.len() as u64 > MAX_TOML {
        let cause = too_large(MAX_TOML, TOO_MUCH_TOML);
        return Err(SceneError::Read { path: path.to_owned(), cause });
    }
    parse_toml(source, name, folder)
}

/// A regular file, which can be read again if a first attempt fails, and its length in bytes.
pub(super) fn read_twice(path: &Path) -> Option<(File, usize)> {
    let metadata = fs::metadata(path).ok().filter(|metadata| metadata.is_file() && metadata.len() <= MAX_FILE)?;
    Some((File::open(path).ok()?, metadata.len() as usize))
}

/// The path that was probably meant by a missing one: a scene or mesh in the same folder whose name
/// differs in at most two letters or in its extension.
pub(super) fn nearest(path: &Path) -> Option<String> {
    /// The most files of a folder that are compared.
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

/// Reads a scene file as [`open`] does; for a mesh without a camera the picture has 800 x 600
/// pixels.
///
/// # Errors
/// As [`open`].
pub fn read(path: &Path) -> Result<Scene, SceneError> {
    Ok(open(path, &Camera::default())?.scene)
}

/// The name of the picture file for a mesh file.
pub fn picture_name(path: &Path) -> String {
    // Invisible characters are replaced, since no picture is written under a name that has some.
    format!("{}.png", path.file_stem().unwrap_or_default().to_string_lossy()).replace(is_unseen, "_")
}

fn open_mesh(path: &Path, format: MeshFormat, options: &ModelOptions) -> Result<Opened, SceneError> {
    let mesh = Mesh::read_with_threads(path, options.threads).map_err(SceneError::Mesh)?;
    let (mut notes, files) = (told(path, &mesh), mesh.libraries.clone());
    let own = FileProvides { camera: mesh.camera.is_some(), lights: !mesh.lights.is_empty() };
    let setting = Setting::of_mesh(&mesh, format, options).ok_or_else(|| beyond_numbers(path, "mesh"))?;
    let placed = setting.placed(mesh).and_then(|MovedFaces { faces, without_area }| {
        Some((setting.scene_of_faces(faces, picture_name(path))?, without_area))
    });
    let (scene, without_area) = placed.ok_or_else(|| beyond_numbers(path, "mesh"))?;
    notes.push(note_of_setting("mesh", options.up.unwrap_or(format.up_axis()), own, options));
    let warnings = no_area_of_mesh(path, &without_area).into_iter().collect();
    Ok(Opened { scene, files, notes, carried_light: setting.fill_light, warnings })
}

/// Whether a PLY file is to be read as a point cloud: it has no faces, or the options give points a
/// radius.
pub fn has_points(path: &Path, options: &ModelOptions) -> bool {
    let has_faces = || read_twice(path).and_then(|(file, length)| ply::has_faces(file, length));
    options.radius.is_some() || has_faces() == Some(false)
}

/// Opens atoms or points; `format` is None for PLY.
fn open_cloud(path: &Path, format: Option<CloudFormat>, options: &ModelOptions) -> Result<Opened, SceneError> {
    let cloud = match format {
        Some(_) => Cloud::read(path, options.frame),
        None => Cloud::of_ply(path),
    };
    let cloud = cloud.map_err(SceneError::Mesh)?;
    let what = if cloud.is_molecule { "molecule" } else { "cloud of points" };
    let origin = cloud.origin;
    let up = options.up.unwrap_or(cloud.up_axis(format));
    let mut notes: Vec<_> = cloud.notes.iter().map(|note| format!("{}: {note}", shown(path))).collect();
    if options.radius.is_none() && cloud.is_molecule && cloud.has_radii() {
        notes.push(
            "atoms have their van der Waals radii and the colours of Jmol; --radius gives all another radius".into(),
        );
    } else if options.radius.is_none() && !cloud.has_radii() {
        let radius = cloud.usual_radius();
        notes.push(format!(
            "{}: points have no size, and are drawn with radius {radius:.3}: --radius gives another",
            shown(path)
        ));
    }
    let spheres = cloud.spheres(options.radius);
    let setting = Setting::of_spheres(&spheres, origin, up, options).ok_or_else(|| beyond_numbers(path, what))?;
    let scene = setting.scene_of_spheres(spheres, origin, picture_name(path));
    let scene = scene.ok_or_else(|| beyond_numbers(path, what))?;
    notes.push(note_of_setting(what, up, FileProvides::default(), options));
    Ok(Opened { scene, files: Vec::new(), notes, carried_light: setting.fill_light, warnings: Vec::new() })
}

/// The error for a model that no camera can show as a whole.
fn beyond_numbers(path: &Path, what: &str) -> SceneError {
    let fault = MeshError::new(format!("the {what} is too large or too far away to be seen whole"));
    SceneError::Mesh(fault.expected("ordinary coordinates, and no extreme film or focal distance").of(path))
}

/// Whether a file provides a camera and lights.
#[derive(Clone, Copy, Default)]
struct FileProvides {
    camera: bool,
    lights: bool,
}

/// A note about what was chosen for a model without camera and lights, except what the options
/// asked for.
fn note_of_setting(what: &str, up: UpAxis, own: FileProvides, options: &ModelOptions) -> String {
    let from = |from: DVec3| format!("{} {} {}", from.x, from.y, from.z);
    let camera = match options.from {
        Some(direction) => format!("the camera sees all of it from {}", from(direction)),
        None if own.camera => "the camera is the file's first one".to_owned(),
        None => "the camera sees all of it from the front, the right and above".to_owned(),
    };
    let lights = match options.lights.len() {
        0 if own.lights => "the point lights are the file's, as strong beside each other as in the middle of it",
        0 => "one white light is to the left above the camera",
        1 => "one white light is where it is asked for",
        _ => "white lights are where they are asked for",
    };
    let fill = if options.ambient == Some(0.0) { "" } else { ", a weak one at the camera" };
    format!("a {what} alone: {up} is up; {camera}; {lights}{fill}; `rayo convert` makes a scene of it, to be changed")
}

/// A warning about triangles of a mesh that have no area, as seams often have: how many there are,
/// and the numbers of the first ones. Numbers count from 1 the triangles of the file, where a face
/// of more corners counts as the triangles it is cut into.
pub(super) fn no_area_of_mesh(path: &Path, numbers: &[usize]) -> Option<String> {
    const MOST: usize = 5;
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

/// Notes about a mesh: faces that were triangulated, and content of its file that was skipped.
pub(super) fn told(path: &Path, mesh: &Mesh) -> Vec<String> {
    let cut = match mesh.polygons {
        0 => None,
        1 => Some("1 face of more than three corners was cut into triangles".to_owned()),
        many => Some(format!("{many} faces of more than three corners were cut into triangles")),
    };
    cut.iter().chain(&mesh.notes).map(|note| format!("{}: {note}", shown(path))).collect()
}

/// The bytes of a file, up to [`MAX_FILE`], or [`MAX_STREAM`] for pipes and devices.
pub(super) fn contents(path: &Path) -> io::Result<Vec<u8>> {
    contents_within(path, MAX_FILE, FOR_A_SCENE)
}

/// The bytes of a file if there are at most `limit`, else an error with `advice`.
pub(super) fn contents_within(path: &Path, limit: u64, advice: &str) -> io::Result<Vec<u8>> {
    let metadata = fs::metadata(path)?;
    if metadata.is_dir() {
        return Err(ErrorKind::IsADirectory.into());
    }
    let limit = if metadata.is_file() { limit } else { limit.min(MAX_STREAM) };
    if metadata.len() > limit {
        return Err(too_large(limit, advice));
    }
    // Limit the bytes that are read, too: the file may be longer than the file system said.
    within(File::open(path)?, metadata.len(), limit, advice)
}

/// As `contents_within`, for text in UTF-8.
pub fn text_within(path: &Path, limit: u64, advice: &str) -> io::Result<String> {
    String::from_utf8(contents_within(path, limit, advice)?)
        .map_err(|error| io::Error::new(ErrorKind::InvalidData, error))
}

/// The bytes of `reader`; memory for `likely` of them is allocated at the start.
fn within(reader: impl Read, likely: u64, limit: u64, advice: &str) -> io::Result<Vec<u8>> {
    let mut source = room(likely as usize);
    reader.take(limit + 1).read_to_end(&mut source)?;
    if source.len() as u64 > limit { Err(too_large(limit, advice)) } else { Ok(source) }
}

fn too_large(limit: u64, advice: &str) -> io::Error {
    let size = limit >> 20;
    io::Error::new(ErrorKind::FileTooLarge, format!("it has more than {size} MiB, {advice}"))
}
