//! The arguments of `rayo-mpi`: those of `rayo render` that make sense for several processes.

use std::env;
use std::ops::Range;
use std::path::PathBuf;
use std::str::FromStr;

use clap::Parser;
use rayo::{Camera, Development, Precision};

/// The variable whose value is the engine where `--engine` is not given.
pub const ENGINE_VARIABLE: &str = "RAYO_ENGINE";

/// Render scene files to the pictures of `rayo render`, by all processes that MPI starts together
///
/// Each process reads the scenes; the first one writes the pictures. Exit status: 0 done, 1 a write
/// failed or the processes are not alike, 2 invalid usage or input.
#[derive(Debug, Parser)]
#[command(
    name = "rayo-mpi",
    version,
    max_term_width = 120,
    after_help = "Examples:
  mpirun -n 4 rayo-mpi scenes/sphere.in -o sphere.png
  mpirun -n 4 rayo-mpi scenes/many.in --engine reference --size 1600x1200 -o many.exr
  mpirun -n 4 rayo-mpi scenes/island.toml --orbit 60 --srgb -o frames/%04d.png"
)]
pub struct Arguments {
    /// The scene: in the paper's format (.in), in TOML (.toml), or a mesh alone (.obj, .ply, .stl,
    /// .glb, .gltf), or atoms or points (.xyz, .pdb, .cif). Several are rendered one after the
    /// other, even if one of them fails
    #[arg(value_name = "SCENE", required = true)]
    pub scenes: Vec<PathBuf>,
    /// The picture, whose format its extension says. An existing file is replaced. For several
    /// scenes: the directory of their pictures. Default: the scene's name for it, in this directory
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Go round the scene once in N steps and write a picture from each: -o has a number in its
    /// name, as in frames/%04d.png
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000), requires = "output")]
    pub orbit: Option<u32>,
    /// The engine: reference, rust, c, paper, portable, sse41, avx2, avx512, or auto for the
    /// fastest that all CPUs run
    #[arg(long, value_name = "ENGINE", env = ENGINE_VARIABLE, default_value = "auto")]
    engine: String,
    /// The precision: single, fast (with estimates that only affect the shade) or double. Default:
    /// the engine's own
    #[arg(long)]
    pub precision: Option<Precision>,
    /// The diagonal of the film, in the unit of the focal distance. Default: 1, as in the paper;
    /// old scenes need 35
    #[arg(long, value_name = "DIAGONAL", allow_negative_numbers = true)]
    film: Option<f32>,
    /// The focal distance, instead of the scene's
    #[arg(long, value_name = "DISTANCE", allow_negative_numbers = true)]
    focal: Option<f32>,
    /// The size in pixels, instead of the scene's; 800x or x600 keeps the shape
    #[arg(long, value_name = "WxH", allow_hyphen_values = true)]
    size: Option<Size>,
    /// Let objects cast shadows on each other, like `shadows = true` in TOML. The engines c and
    /// paper have none
    #[arg(long)]
    pub shadows: bool,
    /// Trace N times N rays (N up to 16) through each pixel, on a regular grid, and average their
    /// linear light, for smooth edges
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=16))]
    samples: Option<u32>,
    /// Take samples only of pixels at edges of the plain picture
    #[arg(long, requires = "samples")]
    pub edges: bool,
    /// The colour of rays that hit nothing: linear red, green and blue, of which 1 is white
    #[arg(long, value_name = "R,G,B", value_parser = colour, allow_hyphen_values = true)]
    background: Option<[f32; 3]>,
    /// Multiply all light by 2 to this power, from -60 to 60
    #[arg(long, value_name = "STOPS", value_parser = stops, allow_negative_numbers = true)]
    exposure: Option<f64>,
    /// Write levels on the sRGB curve, as screens expect them, instead of linear ones; for formats
    /// with 8 bits
    #[arg(long)]
    pub srgb: bool,
    /// Write only the rows from A, counted from 0, up to but not including B
    #[arg(long, value_name = "A..B", value_parser = rows)]
    pub rows: Option<Range<u32>>,
    /// The number of threads of each process. Default: one for each core that MPI gives the process
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
    /// Leave out nothing that can be kept with the same arithmetic: the same picture by brute force
    #[arg(long)]
    pub keep_all: bool,
    /// Let the name in the scene replace an existing file
    #[arg(long)]
    pub force: bool,
    /// Print no summary, only warnings and errors
    #[arg(long)]
    pub quiet: bool,
}

/// Width and height, of which one may be left out.
#[derive(Clone, Copy, Debug)]
struct Size {
    width: Option<u32>,
    height: Option<u32>,
}

impl FromStr for Size {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let expected = "expected width and height in pixels, as in 1632x1224, or one of them, as in 800x or x600";
        let (width, height) = text.split_once('x').ok_or(expected)?;
        let side = |text: &str| {
            if text.is_empty() { Ok(None) } else { text.parse().map(Some).map_err(|_| expected) }
        };
        let size = Size { width: side(width)?, height: side(height)? };
        if size.width.or(size.height).is_some() { Ok(size) } else { Err(expected) }
    }
}

fn stops(text: &str) -> Result<f64, String> {
    let stops = text.parse().ok().filter(|stops: &f64| stops.abs() <= 60.0);
    stops.ok_or_else(|| "expected a number of stops from -60 to 60".into())
}

fn colour(text: &str) -> Result<[f32; 3], String> {
    let channel = |text: &str| text.trim().parse().ok().filter(|v: &f32| v.is_finite() && *v >= 0.0);
    let colour: Option<Vec<f32>> = text.split(',').map(channel).collect();
    let colour = colour.and_then(|colour| colour.try_into().ok());
    colour.ok_or_else(|| "expected three numbers of at least 0 with commas between them, as in 0.2,0.3,0.5".into())
}

fn rows(text: &str) -> Result<Range<u32>, String> {
    let ends = text.split_once("..").and_then(|(from, to)| Some(from.parse().ok()?..to.parse().ok()?));
    ends.filter(|rows: &Range<u32>| !rows.is_empty())
        .ok_or_else(|| "expected the first row and the one after the last, as in 0..100".into())
}

impl Arguments {
    /// The name of the engine; None for the fastest. An empty variable counts as none.
    pub fn named_engine(&self) -> Option<&str> {
        let is_empty = self.engine.is_empty() && env::var_os(ENGINE_VARIABLE).is_some_and(|value| value.is_empty());
        (!is_empty && self.engine != "auto").then_some(&self.engine)
    }

    /// `camera` with what the arguments replace.
    ///
    /// # Errors
    /// If there is no such camera: what is wrong with it.
    pub fn seen_by(&self, camera: &Camera) -> Result<Camera, String> {
        // The side that keeps the shape, rounded to the nearest, and at least 1. One too large for
        // a u32 stays too large for a camera.
        let in_shape = |side: u32, of: u32, to: u32| {
            let doubled = 2 * u64::from(side) * u64::from(to) / u64::from(of);
            u32::try_from(doubled.div_ceil(2)).unwrap_or(u32::MAX).max(1)
        };
        let own = [camera.width(), camera.height()];
        let [width, height] = match self.size {
            None => own,
            Some(Size { width: Some(width), height }) => {
                [width, height.unwrap_or_else(|| in_shape(width, own[0], own[1]))]
            }
            Some(Size { width: None, height }) => {
                let height = height.unwrap_or(own[1]);
                [in_shape(height, own[1], own[0]), height]
            }
        };
        let focal = self.focal.unwrap_or(camera.focal());
        let film = self.film.unwrap_or(camera.film());
        Camera::new(width, height, focal, film).map_err(|error| error.to_string())
    }

    /// How the linear light becomes the colours of the picture; None if nothing is done to it.
    pub fn development(&self) -> Option<Development> {
        let plain = Development::default();
        let development = Development {
            samples: self.samples.unwrap_or(plain.samples),
            background: self.background.unwrap_or(plain.background),
            exposure: self.exposure.unwrap_or(plain.exposure),
            srgb: self.srgb,
        };
        (development != plain).then_some(development)
    }
}
