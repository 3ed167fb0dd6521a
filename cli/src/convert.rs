//! `rayo convert`: scenes and meshes from one format to another.

use std::io::{self, Write};
use std::path::{Component, Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use glam::{DVec3, Vec3};

use super::view::{ViewArgs, tell};
use super::{Failure, colour_on_stderr, keep_apart, remove_part_files_on_signals, say};
use rayo::internals::kernels::sys::cores;
use rayo::internals::render::{Existing, OutputError, OutputFile};
use rayo::internals::scene::{
    CloudFormat, MAX_TOML, Mesh, MeshError, MeshFormat, ModelOptions, Scene, SceneError, SceneFormat, Setting,
    has_points, picture_name, shown,
};

/// Convert scenes and meshes: .in, .toml, .obj, .ply, .stl, .glb, .gltf
///
/// A mesh becomes a scene with a camera that sees all of it and two lights, or with what the
/// options say; as .toml it refers to the mesh file. A molecule or a cloud of points (.xyz, .pdb,
/// .cif, .ply) becomes a scene of spheres. A scene becomes a mesh of its triangles. What the new
/// format cannot hold is lost with a warning. PLY, STL and glTF are written in binary. Colours are
/// written to PLY for each face, to OBJ and glTF for each vertex, and not to STL.
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
    #[command(flatten)]
    view: ViewArgs,
}

/// A TOML file with more triangles than this gets a warning, since reading it takes about 5 kB of
/// memory for each.
const MANY_TABLES: usize = 50_000;

/// Converts the file.
pub fn run(args: &ConvertArgs) -> Result<ExitCode, Failure> {
    let ConvertArgs { input, output, quiet, view } = args;
    keep_apart(output, &[input])?;
    let to = format(output)?;
    let options = view.model_options()?;
    let from = SceneFormat::from_path(input).unwrap_or(SceneFormat::In);
    // A PLY file of points becomes a scene of spheres, not a mesh.
    let is_mesh = matches!(from, SceneFormat::Mesh(_)) && !has_points(input, &options);
    match (from, to) {
        (SceneFormat::Mesh(from), SceneFormat::Mesh(to)) if is_mesh => mesh_to_mesh(args, from, to)?,
        (SceneFormat::Mesh(from), SceneFormat::Toml) if is_mesh => mesh_to_toml(args, from, &options)?,
        (_, to) => {
            let opened = view.open(input, cores())?;
            keep_apart(output, &opened.files)?;
            let scene = view.seen(tell(opened, *quiet))?;
            write_scene(&scene, output, to)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// Reads the input mesh. Fails if the output would replace one of its files.
fn read_mesh(args: &ConvertArgs) -> Result<Mesh, Failure> {
    let unread = |error: MeshError| Failure::input(SceneError::Mesh(error).render(colour_on_stderr()));
    let mesh = Mesh::read_with_threads(&args.input, cores()).map_err(unread)?;
    keep_apart(&args.output, &mesh.libraries).map(|()| mesh)
}

/// Writes a mesh in another mesh format, with notes and warnings about what is lost or changed.
fn mesh_to_mesh(args: &ConvertArgs, from: MeshFormat, to: MeshFormat) -> Result<(), Failure> {
    let ConvertArgs { input, output, quiet, view } = args;
    if let Some(option) = view.given() {
        let message = format!("{option} is for scenes: {to} files have neither camera nor lights");
        return Err(Failure::input(message));
    }
    let mesh = read_mesh(args)?;
    if mesh.polygons > 0 && !quiet {
        say(&format!("note: {}: faces of more than three corners were cut into triangles", shown(input)));
    }
    mesh.notes.iter().filter(|_| !quiet).for_each(|note| say(&format!("note: {}: {note}", shown(input))));
    if to == MeshFormat::Stl && !mesh.colours.is_empty() {
        say(&format!("warning: {}: {to} has no place for the triangles' colours", shown(output)));
    }
    let is_origin_kept = match to {
        MeshFormat::Stl => mesh.origin == DVec3::ZERO,
        MeshFormat::Gltf => mesh.origin.as_vec3().as_dvec3() == mesh.origin,
        MeshFormat::Obj | MeshFormat::Ply => true,
    };
    if !is_origin_kept {
        let lost = "has floats of 32 bits, which lose digits of coordinates so far from 0: OBJ and PLY keep them";
        say(&format!("warning: {}: {to} {lost}", shown(output)));
    }
    if (from == MeshFormat::Stl) != (to == MeshFormat::Stl) && !quiet {
        say(&format!("note: coordinates stay as they are, though {from} and {to} files differ in which way is up"));
    }
    write(output, |out| mesh.write(to, out))
}

/// Writes a scene that refers to the mesh file.
fn mesh_to_toml(args: &ConvertArgs, from: MeshFormat, options: &ModelOptions) -> Result<(), Failure> {
    let ConvertArgs { input, output, view, .. } = args;
    view.suit(input)?;
    let mesh = read_mesh(args)?;
    let setting = Setting::of_mesh(&mesh, from, options);
    let mut setting = setting.ok_or_else(|| Failure::input("the mesh is too large to be seen whole"))?;
    if let Some(view) = view.view(input, setting.view) {
        // Report a view without a picture now rather than when the scene is read.
        view.to_camera().map_err(Failure::input)?;
        setting = setting.seen_from(view);
    }
    setting.camera = view.camera(&setting.camera)?;
    setting.shadows = view.shadows();
    let text = setting.to_toml(&reference(input, output)?, &picture_name(output));
    write(output, |out| out.write_all(text.as_bytes()))
}

/// The format that the extension of a name tells.
pub(super) fn format(path: &Path) -> Result<SceneFormat, Failure> {
    match SceneFormat::from_path(path) {
        Some(SceneFormat::Cloud(format)) => Err(no_writer(path, format)),
        Some(SceneFormat::Mesh(MeshFormat::Gltf))
            if !path.extension().is_some_and(|end| end.eq_ignore_ascii_case("glb")) =>
        {
            Err(Failure::input(format!(
                "{}: glTF is written in binary, to a file whose name ends in .glb",
                shown(path)
            )))
        }
        Some(format) => Ok(format),
        None => {
            let path = shown(path);
            let expected = "the name of a scene or a mesh must end in .in, .toml, .obj, .ply, .stl or .glb";
            Err(Failure::input(format!("{path}: {expected}")))
        }
    }
}

/// The error for an output in a format of atoms or points.
fn no_writer(path: &Path, format: CloudFormat) -> Failure {
    Failure::input(format!("{}: {format} files are read, and not written: write spheres as .in or .toml", shown(path)))
}

/// Writes a scene in a format, with a warning about what the format cannot hold.
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
        SceneFormat::Cloud(format) => Err(no_writer(path, format)),
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

/// Writes a file atomically: it appears with all of its content or not at all.
pub(super) fn write(path: &Path, content: impl FnOnce(&mut OutputFile) -> io::Result<()>) -> Result<(), Failure> {
    remove_part_files_on_signals()?;
    let mut file = OutputFile::create(path, Existing::Replace).map_err(Failure::output)?;
    content(&mut file).map_err(|error| Failure::output(OutputError::Write { path: path.into(), error }))?;
    file.finish().map_err(Failure::output)
}

/// The path by which a scene at `scene` refers to a mesh file: relative to the scene's folder, with
/// slashes.
fn reference(mesh: &Path, scene: &Path) -> Result<String, Failure> {
    let folder = scene.parent().filter(|folder| *folder != Path::new("")).unwrap_or(Path::new("."));
    let absolute = |path: &Path| path.canonicalize();
    let (Ok(mesh), Ok(folder)) = (absolute(mesh), absolute(folder)) else {
        // The scene's folder does not exist; writing the scene will report that.
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
