//! `rayo render`: a scene file in, a picture out.

mod name;
mod picture;
mod stats;

use std::cell::Cell;
use std::collections::BTreeSet;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use clap::Args;
use glam::DVec3;

use self::name::{numbered, output};
use self::picture::{Picture, Progress};
use self::stats::Report;
use super::development::{DevelopmentArgs, sampled};
use super::engine::EngineArgs;
use super::party::Party;
use super::preview::Preview;
use super::view::{ViewArgs, tell};
use super::{Failure, keep_apart, print_result, remove_part_files_on_signals, say};
use crate::plan::{Keep, Omission};
use crate::render::{Engine, PixelFormat, Plan, Precision, Purpose, RenderError, is_standard_output};
use crate::scene::{Camera, Scene, shown};

/// No machine has more cores than this.
const MAX_THREADS: usize = 4096;
/// An hour of them, and more.
const MOST_PICTURES: u32 = 100_000;

/// Render a scene file to a picture
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo render scenes/sphere.in -o sphere.png
  rayo render scenes/many.in --size 1600x1200 --engine paper --stats
  rayo render scenes/island.toml --preview --srgb")]
pub struct RenderArgs {
    /// The scene: in the paper's format (.in), in TOML (.toml), or a mesh alone (.obj, .ply, .stl); - for a scene from
    /// standard input. Several are rendered one after the other, and one that fails does not keep the others from it
    #[arg(value_name = "SCENE", required = true)]
    scenes: Vec<PathBuf>,
    /// The picture: .png, .ppm (P6), .pgm (P3 text, as old scenes name it), .tiff or .qoi with 8 bits; .pfm, .exr or .hdr
    /// with linear floats. Replaces what is there; - is standard output, as PNG, and ppm:- and the like in another format.
    /// Of several scenes: the directory of their pictures. Default: the name in the scene, in this directory
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Show the picture in the terminal, two pixels in each character, and write a file only if -o is given too. It is traced
    /// at as many pixels as fit, at most at those of the picture, with 4 x 4 samples of each unless --samples says otherwise.
    /// Where standard output is no terminal, or NO_COLOR is set, it is made of letters from dark to bright; where it is no
    /// terminal, in 80 columns and 24 lines
    #[arg(long)]
    preview: bool,
    /// Go round the scene once in N steps and write a picture from each place, as many as N: -o has a number in its name, as
    /// in frames/%04d.png. The camera stays as far from the middle of all objects as it is, and begins where it is
    #[arg(long, value_name = "N", value_parser = pictures, allow_negative_numbers = true, requires = "output",
        conflicts_with_all = ["preview", "explain", "stats", "json"])]
    orbit: Option<u32>,
    #[command(flatten)]
    engine: EngineArgs,
    #[command(flatten)]
    view: ViewArgs,
    #[command(flatten)]
    development: DevelopmentArgs,
    /// Only the rows from A on, the first being 0, up to B, which is not among them: an .exr has its place in the whole
    /// picture (data window and display window), and any other format is a picture of these rows
    #[arg(long, value_name = "A..B", value_parser = rows)]
    rows: Option<Range<u32>>,
    /// Threads that read, trace and encode. Default: one for each core
    #[arg(long, value_name = "N", value_parser = threads, allow_negative_numbers = true)]
    threads: Option<usize>,
    /// Print what is left out, and why, before the first ray
    #[arg(long)]
    explain: bool,
    /// Leave nothing out that can be kept with the same arithmetic: brute force, for the same picture
    #[arg(long)]
    keep_all: bool,
    /// Print where the time went
    #[arg(long)]
    stats: bool,
    /// Print it as one JSON document
    #[arg(long)]
    json: bool,
    /// Let the name in the scene replace a file that exists
    #[arg(long)]
    force: bool,
    /// Of several processes that MPI started, let the first alone read the scene and send it to the others
    #[cfg(feature = "mpi")]
    #[arg(long)]
    broadcast: bool,
    /// No progress and no summary; warnings and errors remain
    #[arg(long)]
    quiet: bool,
}

fn threads(text: &str) -> Result<usize, String> {
    let threads = text.parse().ok().filter(|threads| (1..=MAX_THREADS).contains(threads));
    threads.ok_or_else(|| format!("expected a whole number from 1 to {MAX_THREADS}"))
}

fn pictures(text: &str) -> Result<u32, String> {
    let pictures = text.parse().ok().filter(|pictures| (1..=MOST_PICTURES).contains(pictures));
    pictures.ok_or_else(|| format!("expected a whole number from 1 to {MOST_PICTURES}"))
}

/// Rows as Rust writes a range of them.
fn rows(text: &str) -> Result<Range<u32>, String> {
    let ends = text.split_once("..").and_then(|(from, to)| Some(from.parse().ok()?..to.parse().ok()?));
    ends.filter(|rows: &Range<u32>| !rows.is_empty())
        .ok_or_else(|| "expected the first row and the one after the last, as in 0..100".into())
}

/// By what pictures are traced.
#[derive(Clone, Copy)]
pub(super) struct Tracing {
    pub engine: Engine,
    pub precision: Option<Precision>,
    pub keep: Keep,
    pub threads: usize,
}

impl Tracing {
    /// The plan of a scene for one format, or for any, whose rows come band by band.
    pub(super) fn plan(self, scene: &Scene, format: Option<PixelFormat>) -> Result<Plan<'_>, Failure> {
        let Tracing { engine, precision, keep, threads } = self;
        Plan::new(engine, scene, Purpose { precision, format, keep, threads, in_bands: true }).map_err(Failure::input)
    }
}

/// Renders the scenes.
pub fn run(args: &RenderArgs, party: &Party) -> Result<ExitCode, Failure> {
    // Before any work: what no scene can make right.
    let (engine, precision) = party.agree(args.engine.chosen())?;
    let tracing = Tracing {
        engine: if args.engine.is_auto() { party.fastest() } else { engine },
        precision,
        keep: if args.keep_all { Keep::all() } else { Keep::NOTHING },
        threads: args.threads.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from)),
    };
    let to_standard_output = args.output.as_deref().is_some_and(is_standard_output);
    if (args.stats || args.json) && to_standard_output {
        return Err(Failure::input(
            "the picture goes to standard output, where --stats and --json would print into it: leave them out, or name \
             a file with -o",
        ));
    }
    if args.preview {
        can_be_shown(args, party, to_standard_output)?;
    }
    if args.orbit.is_some() {
        can_go_round(args, party)?;
    }
    let mut written = BTreeSet::new();
    if let [scene] = &args.scenes[..] {
        render_one(args, party, scene, tracing, &mut written)?;
        return Ok(ExitCode::SUCCESS);
    }
    if let Some(directory) = args.output.as_deref().filter(|path| !path.is_dir()) {
        return Err(Failure::input(if to_standard_output {
            "several pictures cannot go to standard output: name a directory with -o".into()
        } else {
            format!(
                "several scenes have several pictures, and there is no directory {}: create it first",
                shown(directory)
            )
        }));
    }
    let mut status = ExitCode::SUCCESS;
    for scene in &args.scenes {
        if let Err(mut failure) = render_one(args, party, scene, tracing, &mut written) {
            let name = shown(scene);
            if !failure.message.contains(&name) {
                failure.message = format!("{name}: {}", failure.message);
            }
            status = failure.tell();
        }
    }
    Ok(status)
}

/// Standard output holds one thing, and a terminal one process.
fn can_be_shown(args: &RenderArgs, party: &Party, to_standard_output: bool) -> Result<(), Failure> {
    let problem = if !party.is_alone() {
        "--preview is for one process: start it without MPI, or leave it out"
    } else if to_standard_output {
        "--preview prints where the picture is to go, to standard output: name a file with -o"
    } else if args.json {
        "--preview prints a picture where --json prints a document: leave one of them out"
    } else if args.stats && args.output.is_none() {
        "--stats is of a picture that is written, and --preview alone writes none: name a file with -o"
    } else {
        return Ok(());
    };
    Err(Failure::input(problem))
}

/// A number for each picture, one scene, and one process.
fn can_go_round(args: &RenderArgs, party: &Party) -> Result<(), Failure> {
    let name = args.output.as_deref().unwrap_or(Path::new(""));
    let problem = if !party.is_alone() {
        "--orbit is for one process: start it without MPI, or leave it out".into()
    } else if args.scenes.len() > 1 {
        "--orbit goes round one scene: render the others in calls of their own".into()
    } else if numbered(name, 0).is_none() {
        format!(
            "--orbit writes several pictures, and {} is the name of one: give it a number, as in frames/%04d.png",
            shown(name)
        )
    } else {
        return Ok(());
    };
    Err(Failure::input(problem))
}

impl RenderArgs {
    /// The scene, with what is to be told of it told, and what points upwards in it.
    fn open(&self, path: &Path, party: &Party) -> Result<(Scene, DVec3), Failure> {
        let up = Cell::new(DVec3::Y);
        let open = || {
            let opened = self.view.open(path, self.threads)?;
            up.set(opened.up);
            let mut scene = tell(opened, self.quiet);
            scene.camera = self.view.camera(&scene.camera)?;
            Ok(scene)
        };
        #[cfg(feature = "mpi")]
        let scene = party.scene(path, self.broadcast, open)?;
        #[cfg(not(feature = "mpi"))]
        let (scene, _) = (open()?, party);
        Ok((scene, up.get()))
    }

    /// The rows that are asked for, of a camera's picture.
    fn rows_of(&self, camera: &Camera) -> Result<Range<u32>, Failure> {
        let (rows, height) = (self.rows.clone().unwrap_or(0..camera.height()), camera.height());
        if rows.end > height {
            let Range { start, end } = rows;
            return Err(Failure::input(format!("--rows {start}..{end}: the picture has the rows 0..{height}")));
        }
        Ok(rows)
    }
}

/// Renders a scene to a picture that is not among those `written` before.
fn render_one(
    args: &RenderArgs,
    party: &Party,
    scene_path: &Path,
    tracing: Tracing,
    written: &mut BTreeSet<PathBuf>,
) -> Result<(), Failure> {
    let clock = Instant::now();
    let (mut scene, up) = args.open(scene_path, party)?;
    let (camera, parse) = (scene.camera, clock.elapsed());
    let rows = args.rows_of(&camera)?;
    scene.doubts().iter().for_each(|doubt| say(&format!("warning: {doubt}")));
    let show = |scene: &mut Scene| {
        let development = args.development.with_samples(Preview::SAMPLES);
        let (explain, quiet) = (args.explain && args.output.is_none(), args.quiet);
        Preview { tracing, development, camera, rows: rows.clone(), explain, quiet }.show(scene)
    };
    if args.preview && args.output.is_none() {
        return show(&mut scene);
    }
    let (path, format) = output(args, &scene)?;
    if written.contains(&path) {
        let path = shown(path);
        return Err(Failure::input(format!(
            "its picture is {path}, as is that of a scene before it: render it in a call of its own"
        )));
    }
    keep_apart(&path, [scene_path])?;
    let development = args.development.of(&path, format)?;
    if args.preview {
        show(&mut scene)?;
    }
    scene.camera = development.map_or(Ok(camera), |development| sampled(&camera, development))?;
    // Before the plan: who cannot have a file need not wait for it.
    party.agree(remove_part_files_on_signals())?;
    let engine = tracing.engine;
    if args.keep_all && !args.quiet && !engine.omissions().contains(&Omission::Misses) {
        say(&format!("{engine} tests every ray against every object as it is: --keep-all changes nothing"));
    }
    let prints = args.stats || args.json || path == Path::new("/dev/stdout");
    let all_rows = rows.len() as u64 * u64::from(args.orbit.unwrap_or(1));
    let progress = Progress::new(all_rows, args.quiet, party.bar_target(prints));
    let picture = Picture { args, party, tracing, camera, rows, format, development, progress };
    if let Some(count) = args.orbit {
        return picture.go_round(&scene, up, count, [scene_path, &path]);
    }
    let (setup, stats) = picture.write(&scene, &path)?;
    picture.progress.end();
    if !party.leads() {
        return Ok(());
    }
    if args.stats || args.json {
        let report = Report::of(tracing, (camera.width(), &picture.rows), [parse, setup], &stats);
        print_result(args.json, &report, || report.text())?;
    } else if !args.quiet {
        say(&format!("{}: {} by {engine}, traced in {:.1?}", shown(&path), picture.size(), stats.trace));
    }
    written.insert(path);
    Ok(())
}

/// Disk full and the like are the output's fault; what cannot be set up is not.
pub(super) fn failure(error: RenderError) -> Failure {
    match error {
        RenderError::Image(_) => Failure::output(error),
        #[cfg(feature = "mpi")]
        RenderError::Rank(_) => Failure::output(error),
        RenderError::Memory { .. } | RenderError::Size(_) | RenderError::Threads { .. } => Failure::input(error),
    }
}
