//! `rayo make`: generates meshes of any size, as mesh files or scenes.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use glam::Vec3;
use serde::Serialize;

use super::convert::{format, write, write_scene};
use super::number::{seed, whole};
use super::{Failure, print_result, say};
use rayo::internals::scene::mesh::shapes::{self, MOST_TRIANGLES};
use rayo::internals::scene::{Camera, Mesh, MeshFormat, SceneFormat, Setting, picture_name, shown};

/// Generate a mesh with about a given number of triangles
///
/// The same arguments make the same file. Its number of triangles is the nearest that the shape
/// allows, and is printed.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo make icosphere --triangles 2000 --bumps 0.3 -o rock.ply
  rayo make torus --triangles 50000 -o ring.toml
  rayo make terrain --triangles 1000000 --seed 7 -o hills.obj")]
pub struct MakeArgs {
    /// The shape
    shape: Shape,
    /// About how many triangles
    #[arg(long, value_name = "N", value_parser = whole(1..=MOST_TRIANGLES), allow_hyphen_values = true)]
    triangles: u64,
    /// The mesh (.obj, .ply, .stl, .glb) to write, or a scene with the mesh (.toml, .in). An
    /// existing file is replaced
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// How far the icosphere's surface goes in and out, as a share of its radius, from 0 to 0.9.
    /// Default: 0
    #[arg(long, value_name = "SHARE", value_parser = share, allow_hyphen_values = true)]
    bumps: Option<f64>,
    /// The seed of the terrain and of the bumps. Default: 1
    #[arg(long, value_name = "SEED", value_parser = seed, allow_hyphen_values = true)]
    seed: Option<u64>,
    /// Print the counts as one JSON document
    #[arg(long)]
    json: bool,
    /// Print no summary
    #[arg(long)]
    quiet: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Shape {
    /// A sphere of 20 f² nearly equal triangles: closed, smooth or with bumps
    Icosphere,
    /// A ring of 4 n² triangles: closed
    Torus,
    /// Hills over a square, of 2 n² triangles: open
    Terrain,
}

fn share(text: &str) -> Result<f64, String> {
    let share = text.parse().ok().filter(|share| (0.0..=0.9).contains(share));
    share.ok_or_else(|| "expected a number from 0 to 0.9".into())
}

/// The JSON document.
#[derive(Serialize)]
struct Report {
    shape: String,
    triangles: usize,
    vertices: usize,
    seed: u64,
}

/// Generates and writes the mesh.
pub fn run(args: &MakeArgs) -> Result<ExitCode, Failure> {
    let MakeArgs { shape, triangles, output, bumps, seed, json, quiet } = args;
    let to = format(output)?;
    if bumps.is_some() && *shape != Shape::Icosphere {
        return Err(Failure::input("--bumps is for the icosphere alone"));
    }
    if seed.is_some() && *shape != Shape::Terrain && bumps.is_none() {
        return Err(Failure::input(
            "--seed is for the terrain and for the icosphere's --bumps: this shape has nothing random",
        ));
    }
    let (bumps, seed) = (bumps.unwrap_or(0.0), seed.unwrap_or(1));
    let mesh = match shape {
        Shape::Icosphere => shapes::icosphere(*triangles, bumps, seed),
        Shape::Torus => shapes::torus(*triangles),
        Shape::Terrain => shapes::terrain(*triangles, seed),
    };
    let (made, vertices) = (mesh.triangles.len(), mesh.vertices.len());
    match to {
        SceneFormat::Mesh(format) => write(output, |out| standing(&mesh, format).write(format, out))?,
        format => {
            let camera = Camera::default();
            let setting = Setting::of(&mesh, MeshFormat::Obj, &camera).expect("the shapes are of ordinary size");
            let scene = setting.scene(mesh, picture_name(output));
            write_scene(&scene.expect("the shapes are of ordinary size"), output, format)?;
        }
    }

    let name = shape.to_possible_value().expect("no shape is hidden").get_name().to_owned();
    if *json {
        print_result(true, &Report { shape: name, triangles: made, vertices, seed }, String::new)?;
    } else if !quiet {
        say(&format!("{}: {name} of {made} triangles and {vertices} vertices", shown(output)));
    }
    Ok(ExitCode::SUCCESS)
}

/// The mesh rotated for a file format: generated meshes have y up, and the format may have another
/// axis up.
fn standing(mesh: &Mesh, format: MeshFormat) -> Mesh {
    let mut mesh = mesh.clone();
    if format == MeshFormat::Stl {
        for vertex in &mut mesh.vertices {
            *vertex = Vec3::new(vertex.x, -vertex.z, vertex.y);
        }
    }
    mesh
}
