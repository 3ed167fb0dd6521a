//! `rayo plan`: which parts of a scene are kept, which are omitted and why, and how much time that
//! saves.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use serde::Serialize;

use super::engine::EngineArgs;
use super::measuring::{bar, failure, no_clock, pin};
use super::view::{ViewArgs, tell};
use super::{Failure, convert, keep_apart, keep_standard_input_whole, print_result};
use rayo::internals::kernels::sys::cores;
use rayo::internals::kernels::tsc_hz;
use rayo::internals::plan::{Report, Switch};
use rayo::internals::render::{Format, Plan, Purpose, is_standard_output};
use rayo::internals::scene::shown;
use rayo_lab::experiments::ablation::{self, Ablation, Timed, plot};
use rayo_lab::measure::MachineClock;

/// How long a measurement should take: in seconds, and in ticks of the clock if their frequency is
/// unknown.
const PATIENCE: f64 = 10.0;
const PATIENCE_TICKS: u64 = 20_000_000_000;

/// Show which work a scene does not need, and with --measure what omitting it gains
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo plan scenes/tetrahedron.in
  rayo plan scenes/many.in --size 400x300 --engine reference --json
  rayo plan scenes/sphere.in --measure -o sphere.exr")]
pub struct PlanArgs {
    /// The scene: in the paper's format (.in), in TOML (.toml), or a mesh alone (.obj, .ply, .stl,
    /// .glb, .gltf), or atoms or points (.xyz, .pdb, .cif). Several are planned one after the other
    #[arg(value_name = "SCENE", required = true)]
    scenes: Vec<PathBuf>,
    #[command(flatten)]
    engine: EngineArgs,
    #[command(flatten)]
    view: ViewArgs,
    /// The picture to plan for, whose extension means 8 bits or floats. Default: the name in the
    /// scene
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Time the scene, on one thread, as planned and without one omission at a time
    #[arg(long)]
    measure: bool,
    /// Draw the gains in all scenes, as an SVG
    #[arg(long, value_name = "FILE", requires = "measure")]
    figure: Option<PathBuf>,
    /// Print one JSON document, for a single scene
    #[arg(long)]
    json: bool,
}

/// The JSON document.
#[derive(Serialize)]
struct PlanDocument {
    scene: String,
    engine: &'static str,
    precision: &'static str,
    /// The pixel format of the output.
    output: &'static str,
    width: u32,
    height: u32,
    #[serde(flatten)]
    report: Report,
    measured: Option<Ablation>,
}

/// Prints the plans and, with --measure, draws what their omissions save.
pub fn run(args: &PlanArgs) -> Result<ExitCode, Failure> {
    if args.json && args.scenes.len() > 1 {
        return Err(Failure::input("--json prints one document, of one scene: name one, or leave it out"));
    }
    if args.figure.as_deref().is_some_and(is_standard_output) {
        return Err(Failure::input("the plan is printed to standard output, where --figure would draw: name a file"));
    }
    keep_standard_input_whole(&args.scenes)?;
    // Check this before measuring, which takes long.
    args.figure.iter().try_for_each(|figure| keep_apart(figure, &args.scenes))?;
    let mut worth = Vec::new();
    for (number, path) in args.scenes.iter().enumerate() {
        let document = plan(args, path)?;
        let gap = if number > 0 { "\n" } else { "" };
        print_result(args.json, &document, || format!("{gap}{}", document.text()))?;
        if let Some(measured) = document.measured {
            let name = shown(path.file_name().unwrap_or_default());
            let lines = measured.worth.iter().map(|worth| (worth.what, worth.timed));
            worth.push((name, lines.chain([("all that --keep-all keeps", measured.keep_all)]).collect()));
        }
    }
    if let Some(figure) = &args.figure {
        let svg = plot::figure(&worth).map_err(Failure::output)?;
        convert::write(figure, |out| out.write_all(svg.as_bytes()))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The plan of a scene and, with --measure, what its omissions save.
fn plan(args: &PlanArgs, path: &Path) -> Result<PlanDocument, Failure> {
    let (engine, precision) = args.engine.chosen()?;
    let opened = args.view.open(path, cores())?;
    args.figure.iter().try_for_each(|figure| keep_apart(figure, &opened.files))?;
    let scene = args.view.seen(tell(opened, false))?;
    let bytes = match &args.output {
        Some(path) => Format::from_path(path).map_err(Failure::input)?.is_8bit(),
        None => Format::from_path(Path::new(&scene.name)).is_ok_and(|format| format.is_8bit()),
    };
    let format = engine.format_for(bytes);
    let purpose = Purpose { precision, format: Some(format), ..Purpose::default() };
    let report = Plan::new(engine, &scene, purpose).map_err(Failure::input)?.report();

    let measured = if args.measure {
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
        Some(ablation.map_err(failure)?)
    } else {
        None
    };
    Ok(PlanDocument {
        scene: path.display().to_string(),
        engine: engine.name(),
        precision: precision.unwrap_or(engine.precision()).name(),
        output: format.name(),
        width: scene.camera.width(),
        height: scene.camera.height(),
        report,
        measured,
    })
}

impl PlanDocument {
    fn text(&self) -> String {
        let PlanDocument { scene, engine, precision, output, width, height, report, measured } = self;
        let lines = report.lines().join("\n");
        let scene = shown(scene);
        let text = format!("{scene}: {width}x{height} by {engine} in {precision}, written as {output}\n{lines}\n");
        text + &measured.as_ref().map(|measured| self.worth(measured)).unwrap_or_default()
    }

    /// The table of the time that each omission saves.
    fn worth(
        &self,
        Ablation { cpu, rounds, rows, cycles_per_pixel, control, keep_all, worth, .. }: &Ablation,
    ) -> String {
        let mut text = format!(
            "\nmeasured on one thread of {cpu}: {rounds} rounds, {rows} of {} rows, {cycles_per_pixel:.3} cycles per pixel \
            as planned\n",
            self.height
        );
        text += "how many times as long without the omission (median of pairwise ratios, 95 % interval):\n";
        let mut row = |name: &str, timed: Timed, arithmetic: bool| {
            let figure = match (timed.ratio, timed.ratio_low, timed.ratio_high) {
                (Some(ratio), Some(low), Some(high)) => format!("{ratio:>8.3}  {low:>8.3} .. {high:<8.3}"),
                (ratio, ..) => format!("{:>8}", ratio.map_or("-".into(), |ratio| format!("~{ratio:.0}"))),
            };
            let notes = arithmetic.then_some("other arithmetic").into_iter().chain(timed.note);
            let notes: String = notes.map(|note| format!("  {note}")).collect();
            text += &format!("  {name:<28}  {}\n", (figure + &notes).trim_end());
        };
        row("the plan against itself", *control, false);
        for (line, worth) in self.report.left_out.iter().zip(worth) {
            row(line.what, worth.timed, line.switch == Switch::Arithmetic);
        }
        row("all that --keep-all keeps", *keep_all, false);
        text
    }
}
