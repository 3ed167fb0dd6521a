//! `rayo step`: follows one ray, or one operation, instruction by instruction.

mod html;
pub mod text;

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::str::FromStr;

use clap::Args;

use super::number::{count, single};
use super::view::{ViewArgs, tell};
use super::{Failure, colour_on_stdout, convert, keep_apart, print_result, require_assembly};
use rayo::internals::kernels::sys::cores;
use rayo::internals::render::{Engine, Precision};
use rayo::internals::scene::shown;
use rayo_lab::experiments::step::{self, Ray, WatchError};

/// The arguments for a ray through a scene, which --op excludes.
const OF_A_RAY: [&str; 19] = [
    "scene",
    "pixel",
    "precision",
    "lane",
    "steps",
    "film",
    "focal",
    "size",
    "shadows",
    "position",
    "look_at",
    "up",
    "fov",
    "from",
    "light",
    "ambient",
    "colour",
    "radius",
    "frame",
];

/// Watch one ray go through the kernels that trace it, instruction by instruction
///
/// The kernel itself is single-stepped, and each instruction is shown as it stands in its source,
/// with what it changed. With packets, the packet that contains the pixel is followed, and the
/// pixel's lane is shown.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo step scenes/sphere.in --size 400x300 --pixel 200,150 --depth 1
  rayo step scenes/sphere.in --engine avx2 --error --html ray.html
  rayo step --op cross --a 1,2,3 --b 4,5,6")]
pub struct StepArgs {
    /// The scene: in the paper's format (.in), in TOML (.toml), or a mesh alone (.obj, .ply, .stl,
    /// .glb, .gltf), or atoms or points (.xyz, .pdb, .cif)
    #[arg(required_unless_present = "op")]
    scene: Option<PathBuf>,
    /// The pixel: its column and its row, counted from 0 at the upper left. Default: the middle of
    /// the picture
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true)]
    pixel: Option<Pixel>,
    /// The engine to watch: paper, sse41, avx2, avx512, or auto for the widest packets that this
    /// CPU runs
    #[arg(long, value_name = "ENGINE", default_value = "paper")]
    engine: String,
    /// The precision: single, fast (with estimates that only affect the shade) or double. Default:
    /// the engine's own
    #[arg(long)]
    precision: Option<String>,
    /// The lane of the packet to show, counted from 0. Default: the pixel's
    #[arg(long, value_name = "N", value_parser = count, allow_hyphen_values = true)]
    lane: Option<usize>,
    /// How many macros deep to show; deeper ones are one line each, with their inputs and results
    #[arg(long, value_name = "N", value_parser = count, allow_hyphen_values = true)]
    depth: Option<usize>,
    /// Show only the uses of one macro, such as SPHERE_HIT
    #[arg(long, value_name = "MACRO")]
    only: Option<String>,
    /// Show how far each number is from what it would be without rounding, and where digits are
    /// lost
    #[arg(long)]
    error: bool,
    /// The most instructions to record
    #[arg(long, value_name = "N", default_value_t = 100_000, value_parser = count, allow_hyphen_values = true)]
    steps: usize,
    /// One operation instead of a scene: add, sub, scale, dot, norm, cross or normalise
    #[arg(long, value_name = "NAME", conflicts_with_all = OF_A_RAY)]
    op: Option<String>,
    /// The first vector of the operation
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, requires = "op", conflicts_with = "scene")]
    a: Option<Vector>,
    /// The second one, or the factor of `scale`
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, requires = "op", conflicts_with = "scene")]
    b: Option<Vector>,
    /// Print one JSON document: everything that is known
    #[arg(long, conflicts_with_all = ["depth", "only"])]
    json: bool,
    /// Write a page to a file instead of text: its tree folds, and the arrow keys step through it
    #[arg(long, value_name = "FILE", conflicts_with_all = ["json", "depth", "only"])]
    html: Option<PathBuf>,
    #[command(flatten)]
    view: ViewArgs,
}

/// A column and a row of a picture.
#[derive(Clone, Copy, Debug)]
struct Pixel(u32, u32);

impl FromStr for Pixel {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let numbers =
            text.split_once(',').and_then(|(x, y)| Some(Pixel(x.trim().parse().ok()?, y.trim().parse().ok()?)));
        numbers.ok_or("expected a column and a row, as in 816,612")
    }
}

/// A vector of up to three numbers.
#[derive(Clone, Debug)]
struct Vector(Vec<f32>);

impl FromStr for Vector {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let numbers: Option<Vec<f32>> = text.split(',').map(single).collect();
        match numbers {
            Some(numbers) if [1, 3].contains(&numbers.len()) => Ok(Vector(numbers)),
            _ => Err("expected three numbers, as in 1,2,3, or one to scale by, none of them beyond 3.4e38"),
        }
    }
}

/// Follows the ray or the operation, and prints.
pub fn run(args: &StepArgs) -> Result<ExitCode, Failure> {
    require_assembly("to watch")?;
    let failure = |error: WatchError| match error {
        WatchError::Unavailable(_) | WatchError::Memory | WatchError::Differs(..) => Failure::output(error),
        _ => Failure::input(error),
    };
    let engine = Engine::from_str(&args.engine).map_err(Failure::input)?;
    let precision = args.precision.as_deref().map(Precision::from_str).transpose().map_err(Failure::input)?;
    let watched = match (&args.op, &args.scene) {
        (Some(op), _) => {
            let numbers = |vector: &Option<Vector>| vector.as_ref().map(|vector| vector.0.clone());
            step::watch_operation(op, engine, numbers(&args.a).unwrap_or_default(), numbers(&args.b))
                .map_err(failure)?
        }
        (None, Some(path)) => {
            let opened = args.view.open(path, cores())?;
            args.html.iter().try_for_each(|page| keep_apart(page, &opened.files))?;
            let scene = args.view.seen(tell(opened, false))?;
            let middle = Pixel(scene.camera.width() / 2, scene.camera.height() / 2);
            let Pixel(x, y) = args.pixel.unwrap_or(middle);
            let ray = Ray { engine, precision, pixel: (x, y), lane: args.lane, most: args.steps };
            step::watch(&scene, &ray).map_err(failure)?
        }
        (None, None) => return Err(Failure::input("a scene is needed, or --op with --a")),
    };
    if let Some(only) = &args.only
        && !watched.steps.iter().flat_map(|step| &step.macros).any(|call| call.name == only)
    {
        let mut names: Vec<_> = watched.steps.iter().flat_map(|step| &step.macros).map(|call| call.name).collect();
        names.sort_unstable();
        names.dedup();
        return Err(Failure::input(format!("no macro `{only}` was called here; there were: {}", names.join(", "))));
    }
    // The command succeeds only if the model of instructions agreed with the CPU everywhere
    // (otherwise nothing that follows from the model is reliable) and if the kernel's result is
    // right.
    let is_fine = watched.unknown == 0 && watched.failure.is_none();
    let verdict = if is_fine { ExitCode::SUCCESS } else { ExitCode::from(1) };
    if let Some(path) = &args.html {
        let of = args.scene.as_ref().map_or(String::new(), shown);
        convert::write(path, |out| out.write_all(html::page(&watched, &of, args.error).as_bytes()))?;
        return Ok(verdict);
    }
    let how = text::How { depth: args.depth, only: args.only.clone(), error: args.error, colour: colour_on_stdout() };
    print_result(args.json, &watched, || text::text(&watched, &how))?;
    Ok(verdict)
}
