//! `rayo make`: meshes of any size, as mesh files or as scenes.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use glam::Vec3;
use serde::Serialize;

use super::convert::{format, write, write_scene};
use super::{Failure, print_result, say};
use crate::scene::mesh::shapes::{self, MOST_TRIANGLES};
use crate::scene::{Camera, Mesh, MeshFormat, SceneFormat, Setting, picture_name, shown};

/// Generate a mesh with about a given number of triangles
///
/// The same arguments make the same file. Its number of triangles is the nearest that the shape allows, and is printed.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo make icosphere --triangles 2000 --bumps 0.3 -o rock.ply
  rayo make torus --triangles 50000 -o ring.toml
  rayo make terrain --triangles 1000000 --seed 7 -o hills.obj")]
pub struct MakeArgs {
    /// The shape
    shape: Shape,
    /// About how many triangles
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=MOST_TRIANGLES))]
    triangles: u64,
    /// The mesh (.obj, .ply, .stl) to write, or a scene with the mesh (.toml, .in). An existing file is replaced
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// How far the icosphere's surface goes in and out, as a share of its radius, from 0 to 0.9
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, value_parser = share)]
    bumps: f64,
    /// The seed of the terrain and of the bumps
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    seed: u64,
    /// Print the counts as one JSON document
    #[arg(long)]
    json: bool,
    /// Print nothing
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

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    shape: String,
    triangles: usize,
    vertices: usize,
    seed: u64,
}

/// Makes the mesh.
pub fn run(args: &MakeArgs) -> Result<ExitCode, Failure> {
    let MakeArgs { shape, triangles, output, bumps, seed, json, quiet } = args;
    let to = format(output)?;
    if *bumps > 0.0 && *shape != Shape::Icosphere {
        return Err(Failure::input("--bumps is for the icosphere alone"));
    }
    let mesh = match shape {
        Shape::Icosphere => shapes::icosphere(*triangles, *bumps, *seed),
        Shape::Torus => shapes::torus(*triangles),
        Shape::Terrain => shapes::terrain(*triangles, *seed),
    };
    let (made, vertices) = (mesh.triangles.len(), mesh.vertices.len());
    match to {
        SceneFormat::Mesh(format) => write(output, |out| standing(&mesh, format).write(format, out))?,
        format => {
            let camera = Camera::default();
            let setting = Setting::of(&mesh, MeshFormat::Obj, &camera).expect("the shapes are of ordinary size");
            let scene = setting.scene(mesh, Vec3::ONE, picture_name(output), camera);
            write_scene(&scene.expect("the shapes are of ordinary size"), output, format)?;
        }
    }

    let name = shape.to_possible_value().expect("no shape is hidden").get_name().to_owned();
    if *json {
        print_result(true, &Report { shape: name, triangles: made, vertices, seed: *seed }, String::new)?;
    } else if !quiet {
        say(&format!("{}: {name} of {made} triangles and {vertices} vertices", shown(output)));
    }
    Ok(ExitCode::SUCCESS)
}

/// The mesh with the axis upwards that files of a format are taken to have: the shapes have y.
fn standing(mesh: &Mesh, format: MeshFormat) -> Mesh {
    let mut mesh = mesh.clone();
    if format == MeshFormat::Stl {
        for vertex in &mut mesh.vertices {
            *vertex = Vec3::new(vertex.x, -vertex.z, vertex.y);
        }
    }
    mesh
}
