//! `rayo-view`: a window that shows a scene, in which engines can be compared by hand.

mod bench;
mod commands;
mod display;
mod line;
mod model;
mod orbit;
mod state;
mod window;
mod worker;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;
use std::sync::mpsc::channel;
use std::thread::{self, available_parallelism};

use clap::Parser;
use rayo::{Camera, Engine, Opened, Precision, Scene, SceneFormat, open_with};
use softbuffer::Context;

use crate::commands::Source;
use crate::model::ModelArguments;
use crate::state::{State, Tracing};
use crate::window::App;
use crate::worker::Worker;

/// Show a scene in a window, and compare the engines that trace it by hand
///
/// A drag with the left button turns the camera around what is in the middle, with the right one it
/// shifts it; the wheel, + and - change the distance, and the arrow keys turn. Keys: 1 to 8 take an
/// engine (reference, rust, c, paper, portable, sse41, avx2, avx512), p the next precision, s
/// shadows, k all that is otherwise omitted, t more threads; space lets the camera go round, h
/// brings it back. A click names what is there, and prints the command that follows its ray; w
/// writes the picture to a new file; c prints the camera in TOML; q ends.
///
/// Exit status: 0 closed, 1 no window, 2 invalid usage or input.
#[derive(Debug, Parser)]
#[command(
    name = "rayo-view",
    version,
    max_term_width = 120,
    after_help = "Examples:
  rayo-view scenes/island.toml
  rayo-view scenes/sphere.in --engine c --threads 1
  rayo-view bunny.ply --size 1280x720 --shadows"
)]
struct Arguments {
    /// The scene: in the paper's format (.in), in TOML (.toml), a mesh alone (.obj, .ply, .stl,
    /// .glb, .gltf), or atoms or points alone (.xyz, .pdb, .cif, .ply)
    scene: PathBuf,
    /// The size of the picture in pixels, which keeps the vertical field of view. Default: the
    /// scene's
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,
    /// The diagonal of the film, in the unit of the focal distance. Default: the scene's; old
    /// scenes need 35
    #[arg(long, value_name = "DIAGONAL")]
    film: Option<f32>,
    /// The focal distance, instead of the scene's
    #[arg(long, value_name = "DISTANCE")]
    focal: Option<f32>,
    /// The angle that a column of the picture sees, in degrees, instead of --film
    #[arg(long, value_name = "DEGREES", conflicts_with = "film")]
    fov: Option<f64>,
    #[command(flatten)]
    model: ModelArguments,
    /// The engine to begin with: reference, rust, c, paper, portable, sse41, avx2, avx512, or auto
    /// for the fastest
    #[arg(long, value_name = "ENGINE", default_value = "auto")]
    engine: String,
    /// The precision to begin with: single, fast or double. Default: the engine's own
    #[arg(long)]
    precision: Option<String>,
    /// Let objects cast shadows on each other
    #[arg(long)]
    shadows: bool,
    /// The number of threads to begin with. Default: one for each core
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Print a line for each event and each picture
    #[arg(long)]
    log: bool,
    /// Open no window, but go round once in N pictures, and print how long each part of them took
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    frames: Option<u32>,
}

/// A size in pixels, as in 1280x720.
fn size(text: &str) -> Result<[u32; 2], String> {
    let sides = text.split_once('x').and_then(|(width, height)| Some([width.parse().ok()?, height.parse().ok()?]));
    let sides = sides.filter(|sides: &[u32; 2]| sides.iter().all(|side| (1..=16_384).contains(side)));
    sides.ok_or_else(|| "expected width and height in pixels, as in 1280x720".into())
}

/// Why there is no window, and the exit status that says whose fault that is.
struct Failure {
    message: String,
    status: u8,
}

impl Failure {
    fn input(error: impl ToString) -> Self {
        Failure { message: error.to_string(), status: 2 }
    }

    fn display(message: impl Into<String>) -> Self {
        Failure { message: message.into(), status: 1 }
    }
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(Failure { message, status }) => {
            let prefix = if message.starts_with("error") { "" } else { "error: " };
            eprintln!("{prefix}{message}");
            ExitCode::from(status)
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), Failure> {
    let Opened { scene: mut world, notes, warnings, carried_light, .. } = read(arguments)?;
    for line in notes
        .into_iter()
        .map(|note| format!("note: {note}"))
        .chain(warnings.into_iter().map(|warning| format!("warning: {warning}")))
    {
        eprintln!("{line}");
    }
    let source = Source {
        path: arguments.scene.display().to_string(),
        stem: stem(&arguments.scene),
        view: world.view,
        shadows: world.shadows,
        carried_light,
        model: arguments.model.text(),
    };
    world.shadows |= arguments.shadows;
    let cores = available_parallelism().map_or(1, usize::from);
    let tracing = tracing(arguments, &world, cores)?;
    let size = [world.camera.width(), world.camera.height()];
    let state = State::new(&world, tracing, size, cores.max(tracing.threads));
    let state = state.ok_or_else(|| Failure::input("the scene's camera looks at where it stands, or along its up"))?;
    if let Some(frames) = arguments.frames {
        return bench::run(&source, &world, &state, frames).map_err(Failure::input);
    }
    show(&source, &world, state, arguments.log)
}

/// Reads the scene, and gives its camera what the arguments replace.
fn read(arguments: &Arguments) -> Result<Opened, Failure> {
    // A mesh alone is framed by this camera.
    let camera = with_arguments(arguments, &Camera::default())?;
    let is_alone =
        matches!(SceneFormat::from_path(&arguments.scene), Some(SceneFormat::Mesh(_) | SceneFormat::Cloud(_)));
    if arguments.model.is_given() && !is_alone {
        return Err(Failure::input(
            "--from, --up, --light, --ambient, --colour, --radius and --frame are for a mesh, a molecule or points alone",
        ));
    }
    let options = arguments.model.options(camera);
    let mut opened = open_with(&arguments.scene, &options).map_err(|error| Failure::input(error.render(false)))?;
    opened.scene.camera = with_arguments(arguments, &opened.scene.camera)?;
    Ok(opened)
}

/// `camera` with what the arguments replace.
fn with_arguments(arguments: &Arguments, camera: &Camera) -> Result<Camera, Failure> {
    let focal = arguments.focal.unwrap_or(camera.focal());
    let film = arguments.film.unwrap_or(camera.film());
    let camera = Camera::new(camera.width(), camera.height(), focal, film).map_err(Failure::input)?;
    let camera = match arguments.size {
        Some([width, height]) => camera.sized_by_height(width, height).map_err(Failure::input)?,
        None => camera,
    };
    arguments.fov.map_or(Ok(camera), |fov| camera.with_field_of_view(fov)).map_err(Failure::input)
}

/// The engine and its options that trace the first picture.
fn tracing(arguments: &Arguments, world: &Scene, cores: usize) -> Result<Tracing, Failure> {
    let engine = Engine::from_str(&arguments.engine).map_err(Failure::input)?;
    let precision = arguments.precision.as_deref().map(Precision::from_str).transpose().map_err(Failure::input)?;
    engine.takes(world, precision).map_err(Failure::input)?;
    Ok(Tracing {
        engine,
        precision: precision.unwrap_or(engine.precision()),
        shadows: world.shadows,
        keeps_all: false,
        threads: arguments.threads.map_or(cores, usize::from),
    })
}

/// The file name of a scene without its extension and without characters that a shell or a terminal
/// would not take as they are: how the names of its pictures begin.
fn stem(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let stem: String = stem.chars().filter(|c| c.is_alphanumeric() || "-_.".contains(*c)).collect();
    if stem.is_empty() { "picture".into() } else { stem }
}

/// Opens the window, and starts the thread that traces for it; returns when the window is closed.
fn show(source: &Source, world: &Scene, state: State, logs: bool) -> Result<(), Failure> {
    let event_loop = display::open().map_err(Failure::display)?;
    let context = Context::new(event_loop.owned_display_handle());
    let context = context.map_err(|_| Failure::display(display::cannot_be_opened()))?;
    let wake = event_loop.create_proxy();
    let (request_sender, requests) = channel();
    let (reply_sender, replies) = channel();
    thread::scope(|scope| {
        scope.spawn(move || {
            // An error means that the event loop has ended, and with it the window.
            Worker::new(source, world).run(&requests, &reply_sender, || _ = wake.send_event(()));
        });
        let mut app = App::new(source, world.camera, state, request_sender, replies, context, logs);
        let ran = event_loop.run_app(&mut app);
        // This drops the sender of requests, which ends the worker, and cancels what it traces.
        match (app.end(), ran) {
            (Some(failure), _) => Err(Failure::display(failure)),
            (None, Err(_)) => Err(Failure::display("the display was closed")),
            (None, Ok(())) => Ok(()),
        }
    })
}
