//! `rayo render`: a scene file in, a picture out.

use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use clap::Args;
use indicatif::{ProgressBar, ProgressDrawTarget};
use serde::Serialize;

use super::engine::EngineArgs;
use super::measuring::bar_style;
use super::view::{ViewArgs, tell};
use super::{Failure, print_result, remove_part_files_on_signals, say};
use crate::plan::{Keep, Omission};
use crate::render::{
    Engine, Format, Frame, ImageError, ImageWriter, Plan, Precision, Purpose, RenderError, Settings, Stats,
    is_standard_output, render,
};
use crate::scene::{Camera, Scene};

/// A picture that takes longer than this shows its progress.
const PATIENCE: Duration = Duration::from_secs(1);
/// No machine has more cores than this.
const MAX_THREADS: usize = 4096;

/// Render a scene file to a picture
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// The scene: in the paper's format (.in), in TOML (.toml), or a mesh alone (.obj, .ply, .stl); - for a scene from
    /// standard input
    scene: PathBuf,
    /// The picture: .png, .ppm (P6), .pgm (P3 text, as old scenes name it), .tiff or .qoi with 8 bits; .pfm, .exr or .hdr
    /// with linear floats. Replaces what is there; - is standard output, as PNG, and ppm:- and the like in another format.
    /// Default: the name in the scene, in this directory
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    engine: EngineArgs,
    #[command(flatten)]
    view: ViewArgs,
    /// Threads that trace. Default: one for each core
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
    /// No progress and no summary; warnings and errors remain
    #[arg(long)]
    quiet: bool,
}

fn threads(text: &str) -> Result<usize, String> {
    let threads = text.parse().ok().filter(|threads| (1..=MAX_THREADS).contains(threads));
    threads.ok_or_else(|| format!("expected a whole number from 1 to {MAX_THREADS}"))
}

/// What `--stats` prints; the names are those of the JSON document.
#[derive(Serialize)]
struct Report {
    engine: &'static str,
    precision: &'static str,
    width: u32,
    height: u32,
    threads: usize,
    rays: u64,
    hits: u64,
    parse_ns: u64,
    setup_ns: u64,
    trace_ns: u64,
    trace_cycles: Option<u64>,
    encode_ns: u64,
    write_ns: u64,
}

/// Renders the scene.
pub fn run(args: &RenderArgs) -> Result<ExitCode, Failure> {
    // Before any work: what no scene can make right.
    let (engine, precision) = args.engine.chosen()?;
    if (args.stats || args.json) && args.output.as_deref().is_some_and(is_standard_output) {
        return Err(Failure::input(
            "the picture goes to standard output, where --stats and --json would print into it: leave them out, or name \
             a file with -o",
        ));
    }

    let clock = Instant::now();
    let opened = args.view.open(&args.scene)?;
    let parse = clock.elapsed();
    let mut scene = tell(opened, args.quiet);
    let camera = args.view.camera(&scene.camera)?;
    scene.camera = camera;
    let (path, format) = output(args, &scene)?;
    scene.doubts().iter().for_each(|doubt| say(&format!("warning: {doubt}")));
    // Before the plan: who cannot have a file need not wait for it.
    remove_part_files_on_signals()?;
    let create = if args.output.is_some() || args.force { ImageWriter::create } else { ImageWriter::create_new };
    let mut image = create(&path, format, camera.width(), camera.height()).map_err(unwritten)?;
    let keep = if args.keep_all { Keep::all() } else { Keep::NOTHING };
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let threads = args.threads.unwrap_or_else(cores);
    let purpose = Purpose { precision, format: Some(engine.format_for(format.is_8bit())), keep, threads };
    let clock = Instant::now();
    let plan = Plan::new(engine, &scene, purpose).map_err(Failure::input)?;
    let planning = clock.elapsed();
    if args.explain {
        plan.report().lines().iter().for_each(|line| say(line));
    }
    if args.keep_all && !args.quiet && !engine.omissions().contains(&Omission::Misses) {
        say(&format!("{engine} tests every ray against every object as it is: --keep-all changes nothing"));
    }

    let clock = Instant::now();
    let frame = Frame::new(plan.tracer(), camera, Settings { threads }).map_err(failure)?;
    let setup = planning + clock.elapsed();

    let progress = Progress::new(camera.height(), args.quiet);
    let mut stats = render(&frame, &mut image, &|rows| progress.advance(rows)).map_err(failure)?;
    let clock = Instant::now();
    image.finish().map_err(Failure::output)?;
    stats.write += clock.elapsed();
    drop(progress);

    if args.stats || args.json {
        let precision = precision.unwrap_or(engine.precision());
        let report = report((engine, precision), &camera, frame.count_hits(), threads, (parse, setup), &stats);
        print_result(args.json, &report, || report.text())?;
    } else if !args.quiet {
        let (width, height) = (camera.width(), camera.height());
        say(&format!("{}: {width}x{height} by {engine}, traced in {:.1?}", path.display(), stats.trace));
    }
    Ok(ExitCode::SUCCESS)
}

/// The picture that `-o` names, or else the one that the scene names, in this directory.
fn output(args: &RenderArgs, scene: &Scene) -> Result<(PathBuf, Format), Failure> {
    let path = match &args.output {
        Some(path) => path.clone(),
        None => bare_name(&scene.name)?,
    };
    let format = Format::from_path(&path).map_err(Failure::input)?;
    if !is_standard_output(&path) {
        return Ok((path, format));
    }
    if format != Format::PpmText && io::stdout().is_terminal() {
        return Err(Failure::input(
            "the picture goes to standard output, and that is a terminal: name a file with -o, or send it on to a program",
        ));
    }
    // As errors name it.
    Ok(("/dev/stdout".into(), format))
}

/// What is left of a scene's image name without its directories: scenes come from anywhere and must not choose one.
fn bare_name(name: &str) -> Result<PathBuf, Failure> {
    let bare = name.rsplit(['/', '\\']).next().unwrap_or_default();
    if bare.is_empty() || bare == "." || bare == ".." {
        return Err(Failure::input(format!("the scene's image name `{name}` names no file: name one with -o")));
    }
    if bare != name {
        say(&format!("warning: of the scene's image name `{name}` only `{bare}` is used, in this directory"));
    }
    Ok(Path::new(bare).to_path_buf())
}

fn report(
    (engine, precision): (Engine, Precision),
    camera: &Camera,
    hits: u64,
    threads: usize,
    (parse, setup): (Duration, Duration),
    stats: &Stats,
) -> Report {
    let ns = |time: Duration| time.as_nanos() as u64;
    Report {
        engine: engine.name(),
        precision: precision.name(),
        width: camera.width(),
        height: camera.height(),
        threads,
        rays: camera.pixels(),
        hits,
        parse_ns: ns(parse),
        setup_ns: ns(setup),
        trace_ns: ns(stats.trace),
        trace_cycles: stats.trace_cycles,
        encode_ns: ns(stats.encode),
        write_ns: ns(stats.write),
    }
}

impl Report {
    fn text(&self) -> String {
        let share = 100.0 * self.hits as f64 / self.rays as f64;
        let cycles =
            self.trace_cycles.map(|cycles| format!(", {:.2} cycles per ray", cycles as f64 / self.rays as f64));
        let threads = if self.threads == 1 { "1 thread".into() } else { format!("{} threads", self.threads) };
        let time = |ns: u64| format!("{:>10.3} ms", ns as f64 / 1e6);
        let lines = [
            ("engine", format!("{}, {}, {threads}", self.engine, self.precision)),
            (
                "rays",
                format!("{} ({}x{}), {} of them hit ({share:.1} %)", self.rays, self.width, self.height, self.hits),
            ),
            ("parse", time(self.parse_ns)),
            ("set-up", time(self.setup_ns)),
            ("trace", time(self.trace_ns) + &cycles.unwrap_or_default()),
            ("encode", time(self.encode_ns)),
            ("write", time(self.write_ns)),
        ];
        lines.map(|(name, value)| format!("{name:<8} {value}\n")).concat()
    }
}

/// Too large a picture for its format is bad usage; what else keeps a file from being begun is not.
fn unwritten(error: ImageError) -> Failure {
    match error {
        ImageError::Whole { .. } => Failure::input(error),
        _ => Failure::output(error),
    }
}

/// Disk full and the like are the output's fault; what cannot be set up is not.
fn failure(error: RenderError) -> Failure {
    match error {
        RenderError::Image(_) => Failure::output(error),
        RenderError::Memory { .. } | RenderError::Threads { .. } => Failure::input(error),
    }
}

/// A bar on standard error, if that is a terminal and the picture takes its time.
struct Progress {
    start: Instant,
    bar: ProgressBar,
    shown: OnceLock<()>,
    quiet: bool,
}

impl Progress {
    fn new(rows: u32, quiet: bool) -> Self {
        let bar = ProgressBar::with_draw_target(Some(rows.into()), ProgressDrawTarget::hidden());
        bar.set_style(bar_style("{pos}/{len} rows, {eta} left"));
        Progress { start: Instant::now(), bar, shown: OnceLock::new(), quiet }
    }

    fn advance(&self, rows: u32) {
        self.bar.inc(rows.into());
        if !self.quiet && self.start.elapsed() > PATIENCE {
            self.shown.get_or_init(|| self.bar.set_draw_target(ProgressDrawTarget::stderr()));
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
