//! The arguments of `rayo render`.

use std::mem::take;
use std::ops::Range;
use std::path::{Path, PathBuf};

use clap::Args;

use crate::Failure;
use crate::development::DevelopmentArgs;
use crate::engine::EngineArgs;
use crate::number::whole;
use crate::view::{ViewArgs, tell};
use rayo::internals::kernels::sys::cores;
use rayo::internals::plan::MAX_THREADS;
use rayo::internals::scene::{Camera, Scene};

/// More than an hour at 24 pictures per second.
const MOST_PICTURES: u32 = 100_000;

/// Render a scene file to a picture
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo render scenes/sphere.in -o sphere.png
  rayo render scenes/many.in --size 1600x1200 --engine paper --stats
  rayo render scenes/island.toml --preview --srgb")]
pub struct RenderArgs {
    /// The scene: in the paper's format (.in), in TOML (.toml), or a mesh alone (.obj, .ply, .stl,
    /// .glb, .gltf), or atoms or points (.xyz, .pdb, .cif); - for a scene from standard input.
    /// Several are rendered one after the other, even if one of them fails
    #[arg(value_name = "SCENE", required = true)]
    pub scenes: Vec<PathBuf>,
    /// The picture: .png, .ppm (P6), .pgm (P3 text, as old scenes name it), .tiff or .qoi with 8
    /// bits; .pfm, .exr or .hdr with linear floats. An existing file is replaced; - is a PNG on
    /// standard output, ppm:- and so on are other formats there. For several scenes: the directory
    /// of their pictures. Default: the scene's name for it, in this directory
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Show the picture in the terminal, two pixels in each character, and write a file only if -o
    /// is given too. As many pixels are traced as fit, but no more than the picture has, with 4 x 4
    /// samples each unless --samples says otherwise. If NO_COLOR is set, or standard output is not
    /// a terminal, it consists of letters from dark to bright, in the latter case in 80 columns and
    /// 24 lines
    #[arg(long)]
    pub preview: bool,
    /// Go round the scene once in N steps and write a picture from each: -o has a number in its
    /// name, as in frames/%04d.png. The camera begins where it is, and keeps its distance from the
    /// middle of all objects
    #[arg(long, value_name = "N", value_parser = whole(1..=MOST_PICTURES), allow_hyphen_values = true, requires = "output",
        conflicts_with_all = ["preview", "explain", "stats", "json"])]
    pub orbit: Option<u32>,
    #[command(flatten)]
    pub engine: EngineArgs,
    #[command(flatten)]
    pub view: ViewArgs,
    #[command(flatten)]
    pub development: DevelopmentArgs,
    /// Write only the rows from A, counted from 0, up to but not including B: an .exr has its place
    /// in the whole picture (data window and display window), and any other format is a picture of
    /// these rows
    #[arg(long, value_name = "A..B", value_parser = rows, allow_hyphen_values = true)]
    pub rows: Option<Range<u32>>,
    /// The number of threads that trace and encode. Default: one for each core
    #[arg(long, value_name = "N", value_parser = whole(1..=MAX_THREADS), allow_hyphen_values = true)]
    pub threads: Option<usize>,
    /// Print what is left out, and why, before the first ray
    #[arg(long)]
    pub explain: bool,
    /// Leave out nothing that can be kept with the same arithmetic: the same picture by brute force
    #[arg(long)]
    pub keep_all: bool,
    /// Print where the time went
    #[arg(long)]
    pub stats: bool,
    /// Print where the time went as JSON: a document for each scene
    #[arg(long)]
    pub json: bool,
    /// Let the name in the scene replace an existing file
    #[arg(long)]
    pub force: bool,
    /// Print no progress and no summary, only warnings and errors
    #[arg(long)]
    pub quiet: bool,
}

/// Parses a range of rows in Rust's notation.
fn rows(text: &str) -> Result<Range<u32>, String> {
    let ends = text.split_once("..").and_then(|(from, to)| Some(from.parse().ok()?..to.parse().ok()?));
    ends.filter(|rows: &Range<u32>| !rows.is_empty())
        .ok_or_else(|| "expected the first row and the one after the last, as in 0..100".into())
}

/// A scene prepared for rendering, with other information from its files.
pub(super) struct SceneToRender {
    pub scene: Scene,
    /// The files that the scene was read from.
    pub files: Vec<PathBuf>,
    /// The index of the light that moves with the camera, if there is one.
    pub carried_light: Option<usize>,
}

impl RenderArgs {
    /// Reads the scene, and prints its notes and warnings.
    pub(super) fn open(&self, path: &Path) -> Result<SceneToRender, Failure> {
        let mut opened = self.view.open(path, self.threads.unwrap_or_else(cores))?;
        let files = take(&mut opened.files);
        let carried_light = opened.carried_light;
        Ok(SceneToRender { scene: self.view.seen(tell(opened, self.quiet))?, files, carried_light })
    }

    /// The rows of a camera's picture that the arguments ask for.
    pub(super) fn rows_of(&self, camera: &Camera) -> Result<Range<u32>, Failure> {
        let (rows, height) = (self.rows.clone().unwrap_or(0..camera.height()), camera.height());
        if rows.end > height {
            let Range { start, end } = rows;
            return Err(Failure::input(format!("--rows {start}..{end}: the picture has the rows 0..{height}")));
        }
        Ok(rows)
    }
}
