//! `rayo plan`: what is kept of a scene, what is left out of it and why, and what that is worth.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use serde::Serialize;

use super::engine::EngineArgs;
use super::measuring::{bar, no_clock, pin};
use super::view::{ViewArgs, tell};
use super::{Failure, convert, keep_apart, print_result};
use crate::experiments::ablation::{self, Ablation, Timed, plot};
use crate::measure::{MachineClock, cpu_name, tsc_hz};
use crate::plan::{Report, Switch};
use crate::render::{Engine, Format, PixelFormat, Plan, Precision, Purpose};
use crate::scene::{Camera, shown};

/// The time that a measurement should take, in seconds, and in ticks where nobody knows how long they are.
const PATIENCE: f64 = 10.0;
const PATIENCE_TICKS: u64 = 20_000_000_000;

/// Show what a scene does not need, and with --measure what leaving it out is worth
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo plan scenes/tetrahedron.in
  rayo plan scenes/many.in --size 400x300 --engine reference --json
  rayo plan scenes/sphere.in --measure -o sphere.exr")]
pub struct PlanArgs {
    /// The scene: in the paper's format (.in), in TOML (.toml), or a mesh alone (.obj, .ply, .stl). Of several, one after
    /// the other
    #[arg(value_name = "SCENE", required = true)]
    scenes: Vec<PathBuf>,
    #[command(flatten)]
    engine: EngineArgs,
    #[command(flatten)]
    view: ViewArgs,
    /// The picture that it is for, by its extension: 8 bits or floats. Default: the name in the scene
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Trace the scene, on one thread, with one omission after the other not made
    #[arg(long)]
    measure: bool,
    /// Draw what that is worth: an SVG, of all the scenes
    #[arg(long, value_name = "FILE", requires = "measure")]
    figure: Option<PathBuf>,
    /// Print one JSON document, of one scene
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(Serialize)]
struct PlanDocument<'a> {
    scene: String,
    engine: &'static str,
    precision: &'static str,
    /// What a pixel is written as.
    output: &'static str,
    width: u32,
    height: u32,
    #[serde(flatten)]
    report: &'a Report,
    measured: Option<Measured<'a>>,
}

/// What `--measure` adds.
#[derive(Serialize)]
struct Measured<'a> {
    cpu: String,
    threads: usize,
    rounds: usize,
    rows: usize,
    cycles_per_pixel: f64,
    /// The plan against itself.
    control: Ratio,
    /// All that `--keep-all` keeps, against the plan.
    keep_all: Ratio,
    worth: Vec<Worth<'a>>,
}

/// A line of `left_out` not left out, against the plan.
#[derive(Serialize)]
struct Worth<'a> {
    what: &'a str,
    #[serde(flatten)]
    ratio: Ratio,
}

/// How many times as long; null where that was not measured.
#[derive(Clone, Copy, Serialize)]
struct Ratio {
    ratio: Option<f64>,
    ratio_low: Option<f64>,
    ratio_high: Option<f64>,
    /// How it was measured, or why it was not, where there is something to say.
    #[serde(skip_serializing_if = "Option::is_none")]
    note: Option<&'static str>,
}

impl From<Timed> for Ratio {
    fn from(timed: Timed) -> Self {
        let interval = match timed {
            Timed::Ratio(estimate) | Timed::Extrapolated(estimate) => Some(estimate),
            Timed::Once(_) | Timed::NoCode => None,
        };
        Ratio {
            ratio: timed.ratio(),
            ratio_low: interval.map(|interval| interval.low),
            ratio_high: interval.map(|interval| interval.high),
            note: note(timed),
        }
    }
}

/// What is to be said of how something was timed, if anything.
fn note(timed: Timed) -> Option<&'static str> {
    match timed {
        Timed::Ratio(_) => None,
        Timed::Extrapolated(_) => Some("extrapolated from one row and from two"),
        Timed::NoCode => Some("there is no code without it"),
        Timed::Once(_) => Some("extrapolated from one row and from two, timed once: too slow for more"),
    }
}

/// Prints the plans, and draws what their lines are worth.
pub fn run(args: &PlanArgs) -> Result<ExitCode, Failure> {
    if args.json && args.scenes.len() > 1 {
        return Err(Failure::input("--json prints one document, of one scene: name one, or leave it out"));
    }
    if let Some(figure) = &args.figure {
        keep_apart(figure, args.scenes.iter().map(|scene| &**scene))?;
    }
    let mut worth = Vec::new();
    for (number, path) in args.scenes.iter().enumerate() {
        let (of, report, ablation) = plan(args, path)?;
        let gap = if number > 0 { "\n" } else { "" };
        print_result(args.json, &of.plan(&report, ablation.as_ref()), || {
            format!("{gap}{}", of.text(&report, ablation.as_ref()))
        })?;
        if let Some(ablation) = ablation {
            let name = shown(path.file_name().unwrap_or_default());
            let lines = report.left_out.iter().map(|line| line.what).zip(ablation.worth);
            worth.push((name, lines.chain([("all that --keep-all keeps", ablation.keep_all)]).collect()));
        }
    }
    if let Some(figure) = &args.figure {
        let svg = plot::figure(&worth).map_err(Failure::output)?;
        convert::write(figure, |out| out.write_all(svg.as_bytes()))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The plan of a scene, and what it is worth if that is asked for.
fn plan<'a>(args: &PlanArgs, path: &'a Path) -> Result<(Of<'a>, Report, Option<Ablation>), Failure> {
    let (engine, precision) = args.engine.chosen()?;
    let scene = args.view.seen(tell(args.view.open(path, None)?, false))?;
    let bytes = match &args.output {
        Some(path) => Format::from_path(path).map_err(Failure::input)?.is_8bit(),
        None => Format::from_path(Path::new(&scene.name)).is_ok_and(|format| format.is_8bit()),
    };
    let format = engine.format_for(bytes);
    let purpose = Purpose { precision, format: Some(format), ..Purpose::default() };
    let report = Plan::new(engine, &scene, purpose).map_err(Failure::input)?.report();

    let ablation = if args.measure {
        let mut clock = MachineClock::counter().ok_or_else(no_clock)?;
        pin();
        let ticks = tsc_hz().map_or(PATIENCE_TICKS, |hz| (PATIENCE * hz) as u64);
        let (lines, bar) = (&report.left_out, bar(1));
        let mut progress = |done: usize, all: usize| {
            bar.set_length(all as u64);
            bar.set_position(done as u64);
        };
        let ablation = ablation::run(engine, purpose, &scene, lines, ticks, &mut clock, &mut progress);
        bar.finish_and_clear();
        Some(ablation.map_err(Failure::input)?)
    } else {
        None
    };
    let precision = precision.unwrap_or(engine.precision());
    Ok((Of { path, engine, precision, format, camera: scene.camera }, report, ablation))
}

/// What the plan is of.
struct Of<'a> {
    path: &'a Path,
    engine: Engine,
    precision: Precision,
    format: PixelFormat,
    camera: Camera,
}

impl Of<'_> {
    fn plan<'a>(&self, report: &'a Report, ablation: Option<&Ablation>) -> PlanDocument<'a> {
        let measured = ablation.map(|ablation| Measured {
            cpu: cpu_name(),
            threads: 1,
            rounds: ablation.rounds,
            rows: ablation.rows,
            cycles_per_pixel: ablation.cycles_per_pixel,
            control: ablation.control.into(),
            keep_all: ablation.keep_all.into(),
            worth: report
                .left_out
                .iter()
                .zip(&ablation.worth)
                .map(|(line, worth)| Worth { what: line.what, ratio: (*worth).into() })
                .collect(),
        });
        PlanDocument {
            scene: self.path.display().to_string(),
            engine: self.engine.name(),
            precision: self.precision.name(),
            output: self.format.name(),
            width: self.camera.width(),
            height: self.camera.height(),
            report,
            measured,
        }
    }

    fn text(&self, report: &Report, ablation: Option<&Ablation>) -> String {
        let Of { path, engine, precision, format, camera } = self;
        let (width, height) = (camera.width(), camera.height());
        let mut text = format!(
            "{}: {width}x{height} by {engine} in {precision}, written as {}\n{}\n",
            shown(path),
            format.name(),
            report.lines().join("\n")
        );
        if let Some(ablation) = ablation {
            text += &measured(self, report, ablation);
        }
        text
    }
}

/// The table of what each line is worth.
fn measured(of: &Of<'_>, report: &Report, ablation: &Ablation) -> String {
    let mut text = format!(
        "\nmeasured on one thread of {}: {} rounds, {} of {} rows, {:.3} cycles per pixel as planned\n",
        cpu_name(),
        ablation.rounds,
        ablation.rows,
        of.camera.height(),
        ablation.cycles_per_pixel
    );
    text += "how many times as long without the omission (median of pairwise ratios, 95 % interval):\n";
    let mut row = |name: &str, timed: Timed, arithmetic: bool| {
        let figure = match timed {
            Timed::Ratio(of) | Timed::Extrapolated(of) => {
                format!("{:>8.3}  {:>8.3} .. {:<8.3}", of.value, of.low, of.high)
            }
            Timed::NoCode => format!("{:>8}", "-"),
            Timed::Once(ratio) => format!("{:>8}", format!("~{ratio:.0}")),
        };
        let notes = arithmetic.then_some("other arithmetic").into_iter().chain(note(timed));
        let notes: String = notes.map(|note| format!("  {note}")).collect();
        text += &format!("  {name:<28}  {}\n", (figure + &notes).trim_end());
    };
    row("the plan against itself", ablation.control, false);
    for (line, worth) in report.left_out.iter().zip(&ablation.worth) {
        row(line.what, *worth, line.switch == Switch::Arithmetic);
    }
    row("all that --keep-all keeps", ablation.keep_all, false);
    text
}
