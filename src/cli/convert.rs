//! `rayo convert`: scenes and meshes from one format to another.

use std::io::{self, Write};
use std::path::{Component, Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use glam::Vec3;

use super::view::{open, tell};
use super::{Failure, colour_on_stderr, keep_apart, remove_part_files_on_signals, say};
use crate::render::{Existing, OutputError, OutputFile};
use crate::scene::{
    Camera, MAX_TOML, Mesh, MeshError, MeshFormat, Scene, SceneError, SceneFormat, Setting, picture_name, shown,
};

/// Convert scenes and meshes: .in, .toml, .obj, .ply, .stl
///
/// A mesh becomes a scene with a camera that sees all of it and one light; as .toml it refers to the mesh file. A scene
/// becomes a mesh of its triangles. What the new format cannot hold is lost with a warning. PLY and STL are written in
/// binary. Colours are written to PLY for each face, to OBJ for each vertex, and not to STL.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo convert scenes/meshes/rock.ply rock.toml
  rayo convert scenes/many.in many.toml
  rayo convert scenes/tetrahedron.in tetrahedron.stl")]
pub struct ConvertArgs {
    /// The scene or mesh to read
    #[arg(value_name = "IN")]
    input: PathBuf,
    /// The file to write; its extension decides the format. An existing file is replaced
    #[arg(value_name = "OUT")]
    output: PathBuf,
    /// Print no notes on what was assumed, only warnings and errors
    #[arg(long)]
    quiet: bool,
}

/// More triangles than this in one TOML file are worth a warning: reading takes some 5 kB of memory for each.
const MANY_TABLES: usize = 50_000;

/// Converts the file.
pub fn run(args: &ConvertArgs) -> Result<ExitCode, Failure> {
    let ConvertArgs { input, output, quiet } = args;
    keep_apart(output, &[input])?;
    let to = format(output)?;
    let from = SceneFormat::from_path(input).unwrap_or(SceneFormat::In);
    let mesh = || {
        let unread = |error: MeshError| Failure::input(SceneError::Mesh(error).render(colour_on_stderr()));
        let mesh = Mesh::read(input).map_err(unread)?;
        keep_apart(output, &mesh.libraries).map(|()| mesh)
    };
    match (from, to) {
        (SceneFormat::Mesh(from), SceneFormat::Mesh(to)) => {
            let mesh = mesh()?;
            if mesh.polygons > 0 && !quiet {
                say(&format!("{}: faces of more than three corners were cut into triangles", shown(input)));
            }
            mesh.notes.iter().filter(|_| !quiet).for_each(|note| say(&format!("{}: {note}", shown(input))));
            if to == MeshFormat::Stl && !mesh.colours.is_empty() {
                say(&format!("warning: {}: {to} has no place for the triangles' colours", shown(output)));
            }
            if (from == MeshFormat::Stl) != (to == MeshFormat::Stl) && !quiet {
                say(&format!("coordinates stay as they are, though {from} and {to} files differ in which way is up"));
            }
            write(output, |out| mesh.write(to, out))?;
        }
        (SceneFormat::Mesh(format), SceneFormat::Toml) => {
            let camera = Camera::default();
            let mesh = mesh()?;
            let setting = Setting::of(&mesh, format, &camera);
            let setting = setting.ok_or_else(|| Failure::input("the mesh is too large to be seen whole"))?;
            let picture = picture_name(output);
            let text = setting.to_toml(&reference(input, output)?, &picture, &camera);
            write(output, |out| out.write_all(text.as_bytes()))?;
        }
        (_, to) => {
            let opened = open(input, &Camera::default())?;
            keep_apart(output, &opened.files)?;
            let scene = tell(opened, *quiet);
            write_scene(&scene, output, to)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The format that a name asks for.
pub(super) fn format(path: &Path) -> Result<SceneFormat, Failure> {
    SceneFormat::from_path(path).ok_or_else(|| {
        let path = shown(path);
        Failure::input(format!("{path}: the name of a scene or a mesh must end in .in, .toml, .obj, .ply or .stl"))
    })
}

/// Writes a scene in a format, with a warning of what that cannot hold.
pub(super) fn write_scene(scene: &Scene, path: &Path, format: SceneFormat) -> Result<(), Failure> {
    let warn = |what: &str| say(&format!("warning: {}: {what}", shown(path)));
    match format {
        SceneFormat::Toml => {
            let (spheres, triangles) = (scene.spheres.len(), scene.triangle_count());
            let text = scene.to_toml();
            if text.len() as u64 > MAX_TOML {
                let (path, limit) = (shown(path), MAX_TOML >> 20);
                return Err(Failure::input(format!(
                    "{path}: {triangles} triangles and {spheres} spheres are more than the {limit} MiB of TOML that can \
                     be read again: write them as .in, or triangles as a mesh that a scene names"
                )));
            }
            if triangles > MANY_TABLES {
                let better = "a mesh file that the scene names does better";
                warn(&format!("{triangles} triangles, a table each, are slow to read again: {better}"));
            }
            write(path, |out| out.write_all(text.as_bytes()))
        }
        SceneFormat::In => {
            let film = scene.camera.film();
            if film != 1.0 {
                warn(&format!("the format has no place for a film of {film}: render it with --film {film}"));
            }
            if scene.shadows {
                warn("the format has no place for shadows: render it with --shadows");
            }
            write(path, |out| out.write_all(scene.to_text().as_bytes()))
        }
        SceneFormat::Mesh(format) => {
            if scene.triangle_count() == 0 {
                let path = shown(path);
                return Err(Failure::input(format!(
                    "{path}: the scene has no triangles, and {format} holds nothing else: write it as .in or .toml"
                )));
            }
            let count = |count: usize, one: &str, many: &str| match count {
                0 => None,
                1 => Some(format!("1 {one}")),
                count => Some(format!("{count} {many}")),
            };
            let coloured =
                format == MeshFormat::Stl && scene.all_triangles().any(|triangle| triangle.colour != Vec3::ONE);
            let parts = [
                count(scene.spheres.len(), "sphere", "spheres"),
                count(scene.lights.len(), "light", "lights"),
                coloured.then(|| "the triangles' colours".to_owned()),
                scene.shadows.then(|| "shadows".to_owned()),
                Some("the camera".to_owned()),
            ];
            let parts: Vec<_> = parts.into_iter().flatten().collect();
            warn(&format!("{format} has no place for {}", parts.join(", ")));
            let mesh = Mesh::of_scene(scene, format);
            write(path, |out| mesh.write(format, out))
        }
    }
}

/// Writes a file that appears whole or not at all.
pub(super) fn write(path: &Path, content: impl FnOnce(&mut OutputFile) -> io::Result<()>) -> Result<(), Failure> {
    remove_part_files_on_signals()?;
    let mut file = OutputFile::create(path, Existing::Replace).map_err(Failure::output)?;
    content(&mut file).map_err(|error| Failure::output(OutputError::Write { path: path.into(), error }))?;
    file.finish().map_err(Failure::output)
}

/// How a scene at `scene` names a mesh file: from its own folder on, with slashes.
fn reference(mesh: &Path, scene: &Path) -> Result<String, Failure> {
    let folder = scene.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    let absolute = |path: &Path| path.canonicalize();
    let (Ok(mesh), Ok(folder)) = (absolute(mesh), absolute(folder)) else {
        // The folder is missing, which writing will say.
        return Ok(mesh.to_string_lossy().into_owned());
    };
    let shared = mesh.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(shared).map(|_| Component::ParentDir);
    let relative: PathBuf = up.chain(mesh.components().skip(shared)).collect();
    let parts: Option<Vec<_>> = relative.iter().map(|part| part.to_str()).collect();
    let parts = parts.ok_or_else(|| {
        Failure::input(format!("{}: a name that is not UTF-8 cannot be written to a scene", shown(mesh)))
    })?;
    Ok(parts.join("/"))
}
