//! Runs the stages of `rayo report` one after the other, and shows progress.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use indicatif::ProgressBar;

use crate::experiment::ExperimentArgs;
use crate::experiment::run::{self, Prepared};
use crate::measuring::{announce, bar, bar_style, failure};
use crate::step::text;
use crate::{Failure, say};
use rayo::internals::plan::on_all_cores;
use rayo::internals::render::{Engine, Plan, Purpose};
use rayo_lab::experiments::accuracy::subjects;
use rayo_lab::experiments::complexity::Growths;
use rayo_lab::experiments::ops::{self, Options};
use rayo_lab::experiments::report::{Left, Planned, RayListing, Results, Stage};
use rayo_lab::experiments::step::{self, Ray};
use rayo_lab::experiments::{ablation, accuracy, complexity, gallery, in_size, roofline, stability, threads};
use rayo_lab::measure::MachineClock;

/// The estimated seconds of a stage, which divide the progress bar.
fn seconds(stage: Stage, quick: bool) -> f64 {
    let (of_quick, of_full) = match stage {
        Stage::Experiment => (25.0, 300.0),
        Stage::Ops => (5.0, 12.0),
        Stage::Roofline => (3.0, 8.0),
        Stage::Accuracy => (9.0, 400.0),
        Stage::Stability => (50.0, 2000.0),
        Stage::Complexity => (1.0, 400.0),
        Stage::Threads => (1.0, 4.0),
        Stage::Plans => (4.0, 40.0),
        Stage::Gallery => (3.0, 6.0),
        Stage::Ray => (1.0, 2.0),
    };
    if quick { of_quick } else { of_full }
}

/// The time for the table of one plan in ticks, if their frequency is unknown.
const TICKS: u64 = 4_000_000_000;
/// The scenes whose plans are shown.
const PLANNED: [&str; 4] = ["sphere", "tetrahedron", "two-lights", "many"];
/// The size of the picture whose ray is shown. It is small, because all of the row is
/// single-stepped to find the pixel.
const WATCHED: (u32, u32) = (400, 300);

/// The progress through all stages.
struct Course {
    bar: ProgressBar,
    stop: Arc<AtomicBool>,
    /// The position on the bar where the current stage begins, and the length of its part.
    begin: f64,
    share: f64,
    /// The work of the stage: the amount done, and the total.
    work: (u64, u64),
}

impl Course {
    fn begin(&mut self, stage: Stage, quick: bool) {
        self.begin += self.share;
        self.share = seconds(stage, quick);
        self.work = (0, 1);
        self.bar.set_message(stage.name());
        // Without a terminal, print a line for each stage instead of the bar.
        if self.bar.is_hidden() {
            let number = Stage::ALL.iter().position(|other| *other == stage).map_or(0, |place| place + 1);
            say(&format!("stage {number} of {}: {}", Stage::ALL.len(), stage.name()));
        }
        self.show();
    }

    /// Adds finished work, out of `all`. Returns whether to continue.
    fn done(&mut self, work: u64, all: u64) -> bool {
        self.work = (self.work.0 + work, all.max(1));
        self.show();
        !self.stop.load(Ordering::Relaxed)
    }

    fn show(&self) {
        let share = (self.work.0 as f64 / self.work.1 as f64).min(1.0);
        self.bar.set_position((self.begin + self.share * share) as u64);
    }
}

/// Runs all stages that this machine can; sets `stopped` if the user ended them early.
pub fn stages(quick: bool, stopped: &mut bool) -> Result<Results, Failure> {
    let total: f64 = Stage::ALL.iter().map(|stage| seconds(*stage, quick)).sum();
    // Start the worker threads before this thread is pinned: they would inherit the pinning.
    on_all_cores(0, drop);
    let mut prepared = run::prepare()?;
    announce(total, (!quick).then_some("--quick"));
    let bar = bar(total as u64);
    bar.set_style(bar_style("{msg:10} {percent:>3} %, {eta} left"));
    let stop = Arc::clone(&prepared.stop);
    let mut course = Course { bar, stop: Arc::clone(&stop), begin: 0.0, share: 0.0, work: (0, 1) };
    let mut results = Results { machine: prepared.machine.clone(), quick, ..Results::default() };
    for stage in Stage::ALL {
        if stop.load(Ordering::Relaxed) {
            results.missing.insert(stage.name(), "stopped before".into());
            continue;
        }
        course.begin(stage, quick);
        let begun = Instant::now();
        match measure(stage, quick, &mut prepared, &mut course, &mut results) {
            Ok(true) => {}
            Ok(false) => drop(results.missing.insert(stage.name(), "stopped before its end".into())),
            Err(failure) => drop(results.missing.insert(stage.name(), failure.message)),
        }
        results.seconds.insert(stage.name(), begun.elapsed().as_secs_f64());
    }
    course.bar.finish_and_clear();
    *stopped = stop.load(Ordering::Relaxed);
    Ok(results)
}

/// Runs a stage; returns whether it was completed.
fn measure(
    stage: Stage,
    quick: bool,
    prepared: &mut Prepared,
    course: &mut Course,
    results: &mut Results,
) -> Result<bool, Failure> {
    match stage {
        Stage::Experiment => measure_experiment(quick, prepared, course, results),
        Stage::Ops => measure_ops(course, results),
        Stage::Roofline => measure_roofline(prepared, course, results),
        Stage::Accuracy => measure_accuracy(quick, prepared, course, results),
        Stage::Stability => measure_stability(quick, course, results),
        Stage::Complexity => measure_complexity(quick, prepared, course, results),
        Stage::Threads => measure_threads(quick, prepared, course, results),
        Stage::Plans => measure_plans(quick, prepared, course, results),
        Stage::Gallery => make_gallery(course, results),
        Stage::Ray => watch_ray(results),
    }
}

fn measure_experiment(
    quick: bool,
    prepared: &mut Prepared,
    course: &mut Course,
    results: &mut Results,
) -> Result<bool, Failure> {
    let args = ExperimentArgs::whole(quick);
    let settings = args.settings()?;
    let all = run::work(&args, &settings);
    let document = run::measure(&args, &settings, prepared, &mut |work| course.done(work, all))?;
    let complete = document.conditions.complete;
    results.experiment = Some(document);
    Ok(complete)
}

fn measure_ops(course: &mut Course, results: &mut Results) -> Result<bool, Failure> {
    let options = Options { executed: true, cost: true, ..Options::default() };
    let mut before = 0;
    let mut progress = |done: usize, of: usize| {
        course.done((done - before) as u64, of as u64);
        before = done;
    };
    results.ops = Some(ops::run(&options, &mut progress).map_err(crate::ops::failure)?);
    Ok(true)
}

fn measure_roofline(prepared: &mut Prepared, course: &mut Course, results: &mut Results) -> Result<bool, Failure> {
    let mut proceed = |work| course.done(work, roofline::WORK);
    let caches = &results.machine.caches;
    results.roofline = roofline::run(caches, &mut prepared.clock, &mut proceed).map_err(failure)?;
    Ok(results.roofline.is_some())
}

fn measure_accuracy(
    quick: bool,
    prepared: &mut Prepared,
    course: &mut Course,
    results: &mut Results,
) -> Result<bool, Failure> {
    let machine = results.machine.clone();
    let subjects = subjects::all(quick);
    let hz = machine.tsc_hz.ok_or_else(|| Failure::input("the time-stamp counter's rate is not known"))?;
    let proceed = |work| course.done(work, subjects.len() as u64);
    let (clock, rate) = (&mut prepared.clock, accuracy::Rate { hz, of_counter: true });
    let document = crate::accuracy::measure(&subjects, quick, machine, clock, rate, proceed)?;
    let complete = document.complete;
    results.accuracy = (!document.rows.is_empty()).then_some(document);
    Ok(complete)
}

fn measure_stability(quick: bool, course: &mut Course, results: &mut Results) -> Result<bool, Failure> {
    let settings = stability::Settings::all(quick);
    let all = settings.families.iter().map(|family| family.levels.len() as u64).sum();
    let proceed = || course.done(1, all);
    let document = crate::stability::sweep(&settings, proceed)?;
    let complete = document.complete;
    results.stability = Some(document);
    Ok(complete)
}

fn measure_complexity(
    quick: bool,
    prepared: &mut Prepared,
    course: &mut Course,
    results: &mut Results,
) -> Result<bool, Failure> {
    let engines: Vec<Engine> = Engine::ALL.iter().copied().filter(|engine| engine.usable()).collect();
    let settings = complexity::Settings::new(quick, None, &engines);
    let proceed = |work| course.done(work, settings.work());
    let Growths { rows, complete } = crate::experiment::complexity::measure(&settings, &mut prepared.clock, proceed)?;
    results.complexity = Some(complexity::Complexity::new(results.machine.clone(), &settings, complete, rows));
    Ok(complete)
}

fn measure_threads(
    quick: bool,
    prepared: &mut Prepared,
    course: &mut Course,
    results: &mut Results,
) -> Result<bool, Failure> {
    let mut proceed = |work| course.done(work, threads::WORK);
    results.threads = threads::run(quick, &prepared.cores, &mut prepared.clock, &mut proceed).map_err(failure)?;
    Ok(results.threads.is_some())
}

fn measure_plans(
    quick: bool,
    prepared: &mut Prepared,
    course: &mut Course,
    results: &mut Results,
) -> Result<bool, Failure> {
    let mut plans = Vec::new();
    for name in PLANNED {
        plans.push(plan(name, quick, &mut prepared.clock)?);
        if !course.done(1, PLANNED.len() as u64) {
            break;
        }
    }
    let complete = plans.len() == PLANNED.len();
    results.plans = Some(plans);
    Ok(complete)
}

fn make_gallery(course: &mut Course, results: &mut Results) -> Result<bool, Failure> {
    let mut proceed = |work| course.done(work, gallery::WORK);
    results.gallery = gallery::run(&mut proceed).map_err(Failure::input)?;
    Ok(results.gallery.is_some())
}

fn watch_ray(results: &mut Results) -> Result<bool, Failure> {
    let scene = in_size(&subjects::shipped("sphere"), WATCHED.0, WATCHED.1);
    let engine = Engine::Paper;
    let pixel = (WATCHED.0 / 2, WATCHED.1 / 2);
    let ray = Ray { engine, precision: None, pixel, lane: None, most: 100_000 };
    let watched = step::watch(&scene, &ray).map_err(Failure::output)?;
    let how = text::How { depth: None, only: None, error: true, colour: false };
    let command = format!("rayo step scenes/sphere.in --size {}x{} --error", WATCHED.0, WATCHED.1);
    results.ray = Some(RayListing { command, text: text::text(&watched, &how) });
    Ok(true)
}

/// The plan of a scene that comes with the program, for the fastest engine and a file with 8 bits.
fn plan(name: &str, quick: bool, clock: &mut MachineClock) -> Result<Planned, Failure> {
    let scene = subjects::shipped(name);
    let engine = Engine::fastest();
    let format = engine.format_for(true);
    let purpose = Purpose { format: Some(format), ..Purpose::default() };
    let report = Plan::new(engine, &scene, purpose).map_err(Failure::input)?.report();
    // Give measuring half of the stage's time: the rest is spent on preparing the scene in every
    // variant.
    let patience = 0.5 * seconds(Stage::Plans, quick) / PLANNED.len() as f64;
    let ticks = rayo::internals::kernels::tsc_hz().map_or(TICKS, |hz| (patience * hz) as u64);
    let lines = &report.left_out;
    let measured = ablation::run(engine, purpose, &scene, lines, ticks, clock, &mut |_, _| ());
    let measured = measured.map_err(Failure::input)?;
    let worth: Vec<_> = measured.worth.iter().map(|worth| worth.timed.ratio).collect();
    Ok(Planned {
        scene: name.into(),
        engine: engine.name().into(),
        output: format.name().into(),
        width: scene.camera.width(),
        height: scene.camera.height(),
        kept: report.kept,
        cycles_per_pixel: measured.cycles_per_pixel,
        keep_all: measured.keep_all.ratio,
        left_out: Left::of(&report, &worth),
    })
}
