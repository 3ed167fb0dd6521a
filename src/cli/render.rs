//! `rayo render`: a scene file in, a picture out.

use std::cell::Cell;
use std::collections::BTreeSet;
use std::io::{self, IsTerminal};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use clap::Args;
use glam::DVec3;
use indicatif::{ProgressBar, ProgressDrawTarget};
use serde::Serialize;

use super::development::DevelopmentArgs;
use super::engine::EngineArgs;
use super::measuring::bar_style;
use super::party::Party;
use super::preview::Preview;
use super::view::{ViewArgs, tell};
use super::{Failure, keep_apart, print_result, remove_part_files_on_signals, say};
use crate::plan::{Keep, Omission};
use crate::render::{
    Counted, Developed, Development, Engine, Existing, Format, Frame, ImageError, ImageWriter, PixelFormat, Plan,
    Precision, Purpose, RenderError, Settings, Stats, Tracer, is_standard_output,
};
use crate::scene::{Camera, MovingCamera, Scene, printable, shown};

/// A picture that takes longer than this shows its progress.
const PATIENCE: Duration = Duration::from_secs(1);
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

/// Renders the scenes.
pub fn run(args: &RenderArgs, party: &Party) -> Result<ExitCode, Failure> {
    // Before any work: what no scene can make right.
    let (engine, precision) = party.agree(args.engine.chosen())?;
    let chosen = (if args.engine.is_auto() { party.fastest() } else { engine }, precision);
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
        render_one(args, party, scene, chosen, &mut written)?;
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
        if let Err(mut failure) = render_one(args, party, scene, chosen, &mut written) {
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

/// Renders a scene to a picture that is not among those `written` before.
fn render_one(
    args: &RenderArgs,
    party: &Party,
    scene_path: &Path,
    (engine, precision): (Engine, Option<Precision>),
    written: &mut BTreeSet<PathBuf>,
) -> Result<(), Failure> {
    let (clock, up) = (Instant::now(), Cell::new(DVec3::Y));
    let open = || {
        let opened = args.view.open(scene_path, args.threads)?;
        up.set(opened.up);
        let mut scene = tell(opened, args.quiet);
        scene.camera = args.view.camera(&scene.camera)?;
        Ok(scene)
    };
    #[cfg(feature = "mpi")]
    let mut scene = party.scene(scene_path, args.broadcast, open)?;
    #[cfg(not(feature = "mpi"))]
    let mut scene = open()?;
    let (camera, parse) = (scene.camera, clock.elapsed());
    let rows = args.rows.clone().unwrap_or(0..camera.height());
    if rows.end > camera.height() {
        let Range { start, end } = rows;
        return Err(Failure::input(format!("--rows {start}..{end}: the picture has the rows 0..{}", camera.height())));
    }
    scene.doubts().iter().for_each(|doubt| say(&format!("warning: {doubt}")));
    let keep = if args.keep_all { Keep::all() } else { Keep::NOTHING };
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let threads = args.threads.unwrap_or_else(cores);
    let preview = args.preview.then(|| Preview {
        engine,
        precision,
        keep,
        threads,
        development: args.development.with_samples(Preview::SAMPLES),
        rows: rows.clone(),
        explain: args.explain && args.output.is_none(),
        quiet: args.quiet,
    });
    if let (Some(preview), None) = (&preview, &args.output) {
        return preview.show(&mut scene);
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
    if let Some(preview) = &preview {
        preview.show(&mut scene)?;
    }
    if let Some(development) = &development {
        let too_many = |error| Failure::input(format!("--samples {}: {error}", development.samples));
        scene.camera = development.camera(&camera).map_err(too_many)?;
    }
    // Before the plan: who cannot have a file need not wait for it.
    party.agree(remove_part_files_on_signals())?;
    if args.keep_all && !args.quiet && !engine.omissions().contains(&Omission::Misses) {
        say(&format!("{engine} tests every ray against every object as it is: --keep-all changes nothing"));
    }
    let prints = args.stats || args.json || path == Path::new("/dev/stdout");
    let all_rows = rows.len() as u64 * u64::from(args.orbit.unwrap_or(1));
    let progress = Progress::new(all_rows, args.quiet, party.bar_target(prints));
    let job = Job { args, party, engine, precision, threads, keep, camera, rows, format, development, progress };
    let (width, height) = (camera.width(), job.rows.len());
    if let Some(count) = args.orbit {
        let (mut moving, mut traced) = (MovingCamera::of(&scene), Duration::ZERO);
        let names: Vec<_> = (0..count).filter_map(|number| numbered(&path, number)).collect();
        for (number, path) in names.iter().enumerate() {
            keep_apart(path, [scene_path])?;
            let view = scene.orbit(up.get(), number as f64 / f64::from(count));
            traced += job.write(moving.seen_from(view).map_err(Failure::input)?, path)?.1.trace;
        }
        drop(job);
        if let (Some(first), Some(last), false) = (names.first(), names.last(), args.quiet) {
            let (first, last) = (shown(first), shown(last));
            say(&format!("{first} to {last}: {count} of {width}x{height} by {engine}, traced in {traced:.1?}"));
        }
        return Ok(());
    }
    let (setup, stats) = job.write(&scene, &path)?;
    let rows = job.rows.clone();
    drop(job);
    if !party.leads() {
        return Ok(());
    }

    if args.stats || args.json {
        let precision = precision.unwrap_or(engine.precision());
        let report = report((engine, precision), (camera.width(), &rows), threads, (parse, setup), &stats);
        print_result(args.json, &report, || report.text())?;
    } else if !args.quiet {
        say(&format!("{}: {width}x{height} by {engine}, traced in {:.1?}", shown(&path), stats.trace));
    }
    written.insert(path);
    Ok(())
}

/// What all pictures of a call have in common.
struct Job<'a> {
    args: &'a RenderArgs,
    party: &'a Party,
    engine: Engine,
    precision: Option<Precision>,
    threads: usize,
    keep: Keep,
    /// That of the picture: of several samples the scene has another.
    camera: Camera,
    rows: Range<u32>,
    format: Format,
    development: Option<Development>,
    progress: Progress,
}

impl Job<'_> {
    /// Renders a scene to a file: how long set-up took, and all else.
    fn write(&self, scene: &Scene, path: &Path) -> Result<(Duration, Stats), Failure> {
        let Job { args, party, engine, precision, threads, keep, camera, format, .. } = *self;
        let existing = if args.output.is_some() || args.force { Existing::Replace } else { Existing::Keep };
        let size = (camera.width(), camera.height());
        let (mut image, _unfinished) = party.begin(|announce| {
            ImageWriter::of_rows(path, format, size, self.rows.clone(), existing, announce).map_err(unwritten)
        })?;
        let own = if self.development.is_some() { PixelFormat::F32x4 } else { engine.format_for(format.is_8bit()) };
        let purpose = Purpose { precision, format: Some(own), keep, threads, in_bands: true };
        let clock = Instant::now();
        let plan = party.agree(Plan::new(engine, scene, purpose).map_err(Failure::input))?;
        let plain_scene = args.development.plain(scene, camera);
        let in_any_format = Purpose { format: None, ..purpose };
        let plain = plain_scene.as_ref().map(|scene| Plan::new(engine, scene, in_any_format)).transpose();
        let plain = party.agree(plain.map_err(Failure::input))?;
        if args.explain {
            plan.report().lines().iter().for_each(|line| say(line));
        }
        let developed = self.development.map(|development| {
            let developed = Developed::new(plan.tracer(), &camera, development);
            plain.iter().fold(developed, |developed, plain| developed.along_edges(plain.tracer()))
        });
        let tracer = developed.as_ref().map_or(plan.tracer(), |developed| developed as &dyn Tracer);
        let frame = party.agree(Frame::new(tracer, camera, Settings { threads }).map_err(failure))?;
        let frame = if args.stats || args.json { frame.counting_hits() } else { frame };
        let setup = clock.elapsed();

        let progress = &self.progress;
        let done = |rows| progress.advance(rows);
        let mut stats = party.render(&frame, (format, self.rows.clone()), image.as_mut(), &done)?;
        let clock = Instant::now();
        party.agree(image.map(ImageWriter::finish).transpose().map_err(Failure::output))?;
        stats.write += clock.elapsed();
        Ok((setup, stats))
    }
}

/// The name of the picture of this number, where a name has a place for it: `%d`, or `%04d` for one of four digits.
fn numbered(name: &Path, number: u32) -> Option<PathBuf> {
    let (before, rest) = name.to_str()?.split_once('%')?;
    let (width, after) = rest.split_once('d')?;
    let digits: usize = if width.is_empty() { 0 } else { width.strip_prefix('0')?.parse().ok()? };
    (digits < 10 && !after.contains('%')).then(|| format!("{before}{number:0digits$}{after}").into())
}

/// The picture that `-o` names, or else the one that the scene names, in this directory.
fn output(args: &RenderArgs, scene: &Scene) -> Result<(PathBuf, Format), Failure> {
    let path = match &args.output {
        Some(directory) if args.scenes.len() > 1 => directory.join(bare_name(&scene.name)?),
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
    let (shown, bare) = (printable(name), name.rsplit(['/', '\\']).next().unwrap_or_default());
    if ["", ".", ".."].contains(&bare) || is_standard_output(Path::new(bare)) {
        return Err(Failure::input(format!("the scene's image name `{shown}` names no file: name one with -o")));
    }
    if name.contains(char::is_control) {
        return Err(Failure::input(format!(
            "the scene's image name `{shown}` has control characters: name a file with -o"
        )));
    }
    if bare != name {
        say(&format!("warning: of the scene's image name `{shown}` only `{bare}` is used, in this directory"));
    }
    Ok(Path::new(bare).to_path_buf())
}

fn report(
    (engine, precision): (Engine, Precision),
    (width, rows): (u32, &Range<u32>),
    threads: usize,
    (parse, setup): (Duration, Duration),
    stats: &Stats,
) -> Report {
    let ns = |time: Duration| time.as_nanos() as u64;
    let Counted { rays, hits } = stats.counted.unwrap_or_default();
    Report {
        engine: engine.name(),
        precision: precision.name(),
        width,
        height: rows.len() as u32,
        threads,
        rays,
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
pub(super) fn failure(error: RenderError) -> Failure {
    match error {
        RenderError::Image(_) => Failure::output(error),
        #[cfg(feature = "mpi")]
        RenderError::Rank(_) => Failure::output(error),
        RenderError::Memory { .. } | RenderError::Size(_) | RenderError::Threads { .. } => Failure::input(error),
    }
}

/// A bar, if there is a terminal and the picture takes its time.
struct Progress {
    target: fn() -> ProgressDrawTarget,
    start: Instant,
    bar: ProgressBar,
    shown: OnceLock<()>,
    quiet: bool,
}

impl Progress {
    fn new(rows: u64, quiet: bool, target: fn() -> ProgressDrawTarget) -> Self {
        let bar = ProgressBar::with_draw_target(Some(rows), ProgressDrawTarget::hidden());
        bar.set_style(bar_style("{pos}/{len} rows, {eta} left"));
        Progress { target, start: Instant::now(), bar, shown: OnceLock::new(), quiet }
    }

    fn advance(&self, rows: u32) {
        self.bar.inc(rows.into());
        if !self.quiet && self.start.elapsed() > PATIENCE {
            self.shown.get_or_init(|| self.bar.set_draw_target((self.target)()));
        }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}
