//! Error and run time of every engine, precision and output, on ordinary and on ill-conditioned
//! scenes.

pub mod errors;
pub mod front;
pub mod plain;
pub mod plot;
pub mod subjects;
pub mod summary;

use std::collections::BTreeSet;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::lab::{Bench, Case, LabError, Timed};
use crate::measure::Name;
use crate::measure::statistics::{mad, median, minimum};
use crate::measure::{Clock, Machine, Runs};
use crate::truth::{TruePixel, Truth};
use errors::{Errors, Tally};
use front::{Point, front};
use rayo::internals::kernels::Isa;
use rayo::internals::kernels::sys::cores;
use rayo::internals::plan::{Keep, Omission, on_all_cores};
use rayo::internals::render::{Engine, EngineError, Film, PixelFormat, Plan, Precision, Purpose, Tracer};
use rayo::internals::scene::Scene;
use subjects::Subject;

/// The limits on the number of rounds, in a quick run and in a full one. A scene's rounds end after
/// `seconds`, but not before `least` rounds nor after `most`.
const ROUNDS: [Rounds; 2] = [Rounds { least: 3, most: 15, seconds: 0.15 }, Rounds { least: 5, most: 51, seconds: 1.0 }];

/// The error of SPHERE_LIT's estimated roots in levels; derived at
/// [`Contender::levels_by_estimates`].
pub const ESTIMATES: f64 = 0.75;

/// The rate of a clock.
#[derive(Clone, Copy)]
pub struct Rate {
    /// Ticks per second.
    pub hz: f64,
    /// Whether the clock is the CPU's time-stamp counter.
    pub of_counter: bool,
}

struct Rounds {
    least: usize,
    most: usize,
    seconds: f64,
}

/// An engine in one of its precisions, with or without its plan's omissions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Contender {
    pub engine: Engine,
    pub precision: Precision,
    /// Whether it does all the work that a plan leaves out, as `--keep-all` asks for.
    pub keep_all: bool,
}

/// A contender with the output that it writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    pub contender: Contender,
    pub output: PixelFormat,
}

impl Entry {
    /// The pixel format in which the engine computes for this output.
    pub fn format(self) -> PixelFormat {
        self.contender.engine.format_for(self.output.is_8bit())
    }
}

/// The names of an entry as the documents use them.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct Label {
    pub engine: Name,
    pub precision: Name,
    /// `--keep-all`, or None.
    pub option: Option<Name>,
    pub output: Name,
}

impl From<Entry> for Label {
    fn from(Entry { contender: Contender { engine, precision, keep_all }, output }: Entry) -> Self {
        let option = keep_all.then_some("--keep-all".into());
        Label { engine: engine.name().into(), precision: precision.name().into(), option, output: output.name().into() }
    }
}

/// Every engine that this machine runs, in every precision that it has.
pub fn contenders() -> Vec<Contender> {
    let engines = Engine::ALL.iter().filter(|engine| engine.usable());
    engines
        .flat_map(|engine| {
            let contender =
                |precision: &Precision| Contender { engine: *engine, precision: *precision, keep_all: false };
            engine.precisions().iter().map(contender)
        })
        .collect()
}

/// All contenders, and once more with `--keep-all` each one whose engine omits work.
pub fn contenders_and_options() -> Vec<Contender> {
    let with_option = |contender: Contender| {
        let leaves_out = contender.engine.omissions().contains(&Omission::Misses);
        [Some(contender), leaves_out.then_some(Contender { keep_all: true, ..contender })].into_iter().flatten()
    };
    contenders().into_iter().flat_map(with_option).collect()
}

impl Contender {
    /// Prepares the contender for `scene`.
    ///
    /// # Errors
    /// If the scene cannot be traced.
    pub fn prepare(self, scene: &Scene) -> Result<Box<dyn Tracer + '_>, EngineError> {
        Ok(Plan::new(self.engine, scene, self.purpose())?.into_tracer())
    }

    /// Whether the contender can trace the scene: an engine without shadows cannot trace a scene
    /// that has them.
    pub fn can_trace(self, scene: &Scene) -> bool {
        self.engine.has_shadows() || !scene.shadows
    }

    /// The options with which its plans are made.
    pub fn purpose(self) -> Purpose<'static> {
        let keep = if self.keep_all { Keep::all() } else { Keep::NOTHING };
        Purpose { precision: Some(self.precision), keep, ..Purpose::default() }
    }

    /// By how many levels of 255 estimates of roots may shift a channel of `output`, on every CPU:
    /// a bound from VRSQRT's documented error, not from one maker's implementation.
    ///
    /// With e = 1.5 2^-12, the error of `rsqrtps`, LAMBERT3 and COSINE have a relative error of e,
    /// 0.1 of a level. In SPHERE_LIT the root of D is estimated too, which moves the point along
    /// the ray by at most e sqrt s radii. With w = 1 + G the distance of the light from the centre,
    /// w . N is then off by up to (1 + G) e, and the cosine by ((1 + G) / G) (1 + 1 / G) e.
    /// SHORT_FORM_LOSS keeps G above 0.65, where that is 6.4 e; with the other estimate 7.4 e,
    /// which is 0.69 of a level. `vrsqrt14ps` has a sixth of e.
    ///
    /// So no pixel is off by two levels. How many are off by one depends on how near the true
    /// values are to the next level: in a picture of a single colour it can be none or all.
    pub fn levels_by_estimates(self, output: PixelFormat) -> f64 {
        let levels = match self.engine {
            Engine::Packet(Isa::Avx512) => ESTIMATES / 6.0,
            Engine::Packet(_) => ESTIMATES,
            _ => 0.0,
        };
        match self.precision {
            Precision::Single if output.is_8bit() => levels,
            Precision::Fast => levels,
            Precision::Single | Precision::Double => 0.0,
        }
    }

    /// The outputs that get a row: floats; and bytes too, unless the engine makes them by
    /// converting its floats.
    fn entries(self, tracer: &dyn Tracer) -> Vec<Entry> {
        let other_bytes = self.engine != Engine::Reference && self.precision != Precision::Fast;
        let bytes = other_bytes && tracer.writes(PixelFormat::Rgb8);
        let outputs = [PixelFormat::F32x3].into_iter().chain(bytes.then_some(PixelFormat::Rgb8));
        outputs.map(|output| Entry { contender: self, output }).collect()
    }
}

/// One engine, precision and output on one scene. The field names are those of the JSON document;
/// what does not apply is null, and so is what is infinite.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Accuracy {
    /// The scene: the name of its file, or its family with the value of the parameter.
    pub scene: String,
    pub family: Option<Name>,
    /// How ill-conditioned the scene is: 0 ordinary, 1 intermediate, 2 at the extreme end of its
    /// family's range.
    pub stiffness: Option<usize>,
    pub width: u32,
    pub height: u32,
    #[serde(flatten)]
    pub who: Label,
    #[serde(flatten)]
    pub errors: Errors,
    /// Nanoseconds per ray in the fastest run.
    pub ns_per_ray: f64,
    pub ns_per_ray_median: f64,
    /// The median absolute deviation of the times, as a share of their median.
    pub spread: f64,
    /// TSC cycles per ray in the fastest run; None where there is no time-stamp counter.
    pub cycles_per_ray: Option<f64>,
    pub cycles_per_ray_median: Option<f64>,
    /// Nanoseconds of the set-up, from the parsed scene to the first ray, in the fastest run; no
    /// other figure includes it.
    pub setup_ns: f64,
    pub runs: usize,
    /// The error that the Pareto front is made by: the root mean square error of a linear colour
    /// or, for bytes, of a level divided by 255.
    pub error: f64,
    /// Whether the row is on the Pareto front of its scene and output: no other row is at least as
    /// good in error and time, and better in one.
    pub front: bool,
}

/// Everything that was measured, where, and with what.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct AccuracyReport {
    pub machine: Machine,
    pub complete: bool,
    /// Whether it was a quick run, of small pictures and few rounds.
    pub quick: bool,
    pub rows: Vec<Accuracy>,
    /// Every engine, precision, option and output that is on no front, with the reason why the
    /// program has it.
    pub off_every_front: Vec<summary::Reason>,
    /// The time of the robust formulas, divided by that of the paper's plain ones.
    pub against_plain: Vec<plain::AgainstPlain>,
}

/// An entry's errors on one scene.
#[derive(Clone, Copy, Debug)]
pub struct Judged {
    pub entry: Entry,
    pub errors: Errors,
}

/// The truth of a scene's picture, row by row, computed by all threads.
pub fn expect(scene: &Scene) -> Vec<TruePixel> {
    let camera = scene.camera;
    let truth = Truth::new(scene);
    let in_row = |row| (0..camera.width()).map(|col| truth.pixel(row as u32, col)).collect::<Vec<_>>();
    on_all_cores(camera.height() as usize, in_row).into_iter().flatten().collect()
}

/// The errors of a tracer's picture of `height` rows in `format`, compared with the `expected`
/// pixels and added to an empty tally.
pub fn errors_of(
    tracer: &dyn Tracer,
    height: u32,
    format: PixelFormat,
    expected: &[TruePixel],
    mut tally: Tally,
) -> Result<Errors, LabError> {
    let found = tracer.hits(0..height);
    let mut film = Film::new(format, expected.len())?;
    tracer.rows(0..height, film.as_mut());
    for (i, (expected, found)) in expected.iter().zip(&found).enumerate() {
        tally.add(expected, found.as_ref(), film.colour(i));
    }
    Ok(tally.errors())
}

/// The errors on a scene of every contender that can trace it, computed by all threads. Nothing is
/// timed.
pub fn judge(scene: &Scene, contenders: &[Contender]) -> Result<Vec<Judged>, LabError> {
    let camera = scene.camera;
    let expected = expect(scene);
    let contenders: Vec<_> = contenders.iter().filter(|contender| contender.can_trace(scene)).collect();
    let judged = on_all_cores(contenders.len(), |i| {
        let contender = contenders[i];
        let tracer = contender.prepare(scene)?;
        let entries = contender.entries(tracer.as_ref()).into_iter().map(|entry| {
            let tally = Tally::new(contender.precision, contender.engine.rays_in_f64())
                .with_estimates(contender.levels_by_estimates(entry.output));
            let errors = errors_of(tracer.as_ref(), camera.height(), entry.format(), &expected, tally)?;
            Ok(Judged { entry, errors })
        });
        entries.collect::<Result<Vec<_>, LabError>>()
    });
    Ok(judged.into_iter().collect::<Result<Vec<_>, LabError>>()?.concat())
}

/// Core seconds to find the true result of a ray, and to compare one engine's result with it. Both
/// are averages over all families, measured on one machine, and serve only to forecast the time of
/// a run.
const TRUTH_SECONDS: f64 = 4e-5;
const ANSWER_SECONDS: f64 = 4e-6;

/// A forecast of the seconds that all threads need to compare `rays` rays of each of `contenders`
/// contenders with the truth.
pub fn forecast(rays: u64, contenders: usize) -> f64 {
    rays as f64 * (TRUTH_SECONDS + contenders as f64 * ANSWER_SECONDS) / cores() as f64
}

/// A forecast of the seconds that [`measure`] needs for all of these scenes.
pub fn forecast_of_measure(subjects: &[Subject], contenders: usize, quick: bool) -> f64 {
    let rays = subjects.iter().map(|subject| subject.scene.camera.pixels()).sum();
    forecast(rays, contenders) + subjects.len() as f64 * ROUNDS[usize::from(!quick)].seconds
}

#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct MeasuredAccuracy {
    pub rows: Vec<Accuracy>,
    /// The comparison with the plain formulas, on ordinary scenes.
    pub against_plain: Vec<plain::AgainstPlain>,
}

/// What is timed in a scene: each judged entry's picture, and then each contender's set-up.
fn timed_cases<'a>(scene: &'a Scene, judged: &[Judged], contenders: &[Contender]) -> Result<Vec<Case<'a>>, LabError> {
    let mut cases = Vec::new();
    for Judged { entry, .. } in judged {
        let Contender { engine, .. } = entry.contender;
        cases.push(Case::of(Timed::Tracing, scene, engine, entry.contender.purpose(), entry.format())?);
    }
    for contender in contenders {
        let format = contender.engine.format_for(false);
        cases.push(Case::of(Timed::SetUp, scene, contender.engine, contender.purpose(), format)?);
    }
    Ok(cases)
}

/// The row of a judged entry, from the runs of its picture and of its contender's set-up.
fn row(subject: &Subject, judged: &Judged, tracing: &Runs, set_up: &Runs, rate: Rate) -> Accuracy {
    let Judged { entry, errors } = judged;
    let camera = subject.scene.camera;
    let per_ray = |ticks: f64| ticks / camera.pixels() as f64;
    let ns = |ticks: f64| 1e9 * ticks / rate.hz;
    let fastest = minimum(&tracing.ticks);
    let middle = median(&tracing.ticks);
    Accuracy {
        scene: subject.name.clone(),
        family: subject.family.map(|family| family.id.into()),
        stiffness: subject.family.map(|family| family.stiffness),
        width: camera.width(),
        height: camera.height(),
        who: (*entry).into(),
        errors: *errors,
        ns_per_ray: ns(per_ray(fastest)),
        ns_per_ray_median: ns(per_ray(middle)),
        spread: mad(&tracing.ticks) / middle,
        cycles_per_ray: rate.of_counter.then_some(per_ray(fastest)),
        cycles_per_ray_median: rate.of_counter.then_some(per_ray(middle)),
        setup_ns: ns(minimum(&set_up.ticks)),
        runs: tracing.ticks.len(),
        error: error(errors, entry.output),
        front: false,
    }
}

/// Measures the errors and times of one scene. None if `proceed`, which is called repeatedly,
/// returns false.
///
/// # Errors
/// If an engine cannot be prepared, or if there is not enough memory.
pub fn measure(
    subject: &Subject,
    quick: bool,
    clock: &mut dyn Clock,
    rate: Rate,
    proceed: &mut dyn FnMut() -> bool,
) -> Result<Option<MeasuredAccuracy>, LabError> {
    let mut contenders = contenders_and_options();
    contenders.retain(|contender| contender.can_trace(&subject.scene));
    let judged = judge(&subject.scene, &contenders)?;
    if !proceed() {
        return Ok(None);
    }
    let scene = &subject.scene;
    let cases = timed_cases(scene, &judged, &contenders)?;
    // The first round warms up and is not counted; its duration shows how many rounds there is time
    // for.
    let Rounds { least, most, seconds } = ROUNDS[usize::from(!quick)];
    let mut bench = Bench::default();
    let start = Instant::now();
    bench.time(clock, &cases, 0..0, proceed)?;
    let rounds = ((seconds / start.elapsed().as_secs_f64()) as usize).clamp(least, most);
    let Some(runs) = bench.time(clock, &cases, 0..rounds, proceed)? else { return Ok(None) };
    let (tracings, set_ups) = runs.split_at(judged.len());
    let mut rows = Vec::new();
    for (judged, tracing) in judged.iter().zip(tracings) {
        let contender = contenders.iter().position(|contender| *contender == judged.entry.contender);
        let set_up = &set_ups[contender.expect("who was judged is among the contenders")];
        rows.push(row(subject, judged, tracing, set_up, rate));
    }
    mark(&mut rows);
    let against_plain = if subject.family.is_none() {
        plain::against_plain(&subject.name, scene, clock, rate.hz, proceed)?.unwrap_or_default()
    } else {
        Vec::new()
    };
    Ok(Some(MeasuredAccuracy { rows, against_plain }))
}

/// The error that the Pareto front is made by; see [`Accuracy::error`].
pub fn error(errors: &Errors, output: PixelFormat) -> f64 {
    if output.is_8bit() {
        errors.psnr.map_or(0.0, |psnr| 10f64.powf(-psnr / 20.0))
    } else {
        errors.rms_colour.unwrap_or(0.0)
    }
}

/// Marks the rows on the Pareto front of each scene and output.
pub fn mark(rows: &mut [Accuracy]) {
    let keys: BTreeSet<_> = rows.iter().map(|row| (row.scene.clone(), row.who.output.clone())).collect();
    for (scene, output) in keys {
        let of: Vec<usize> =
            (0..rows.len()).filter(|i| rows[*i].scene == scene && rows[*i].who.output == output).collect();
        let points: Vec<_> = of.iter().map(|i| Point { error: rows[*i].error, time: rows[*i].ns_per_ray }).collect();
        for (i, on) in of.into_iter().zip(front(&points)) {
            rows[i].front = on;
        }
    }
}
