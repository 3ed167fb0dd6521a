//! Error against run time: every engine, precision and output, on ordinary scenes and on stiff ones.

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
use crate::kernels::Isa;
use crate::kernels::sys::cores;
use crate::measure::Name;
use crate::measure::statistics::{mad, median, minimum};
use crate::measure::{Clock, Machine};
use crate::plan::{Keep, Omission, on_all_cores};
use crate::render::{Engine, EngineError, Film, PixelFormat, Plan, Precision, Purpose, Tracer, TruePixel, Truth};
use crate::scene::Scene;
use errors::{Errors, Tally};
use front::{Point, front};
use subjects::Subject;

/// Rounds of a quick run and of any other: at least so many, at most so many, and until a scene has taken so long.
const ROUNDS: [Rounds; 2] = [Rounds { least: 3, most: 15, seconds: 0.15 }, Rounds { least: 5, most: 51, seconds: 1.0 }];

/// See [`Contender::levels_by_estimates`].
pub const ESTIMATES: f64 = 0.75;

/// How fast a clock ticks.
#[derive(Clone, Copy)]
pub struct Rate {
    /// Ticks in a second.
    pub hz: f64,
    /// Whether they are those of the time-stamp counter.
    pub of_counter: bool,
}

struct Rounds {
    least: usize,
    most: usize,
    seconds: f64,
}

/// An engine in one of its precisions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Contender {
    pub engine: Engine,
    pub precision: Precision,
    /// Whether it does all the work that a plan leaves out, as `--keep-all` asks for.
    pub keep_all: bool,
}

/// A contender with what it writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    pub contender: Contender,
    pub output: PixelFormat,
}

impl Entry {
    /// The format that it computes in for such a file.
    pub fn format(self) -> PixelFormat {
        self.contender.engine.format_for(self.output.is_8bit())
    }
}

/// The same, by the names that documents use.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct Who {
    pub engine: Name,
    pub precision: Name,
    /// `--keep-all`, or none.
    pub option: Option<Name>,
    pub output: Name,
}

impl From<Entry> for Who {
    fn from(Entry { contender: Contender { engine, precision, keep_all }, output }: Entry) -> Self {
        let option = keep_all.then_some("--keep-all".into());
        Who { engine: engine.name().into(), precision: precision.name().into(), option, output: output.name().into() }
    }
}

/// Every engine of this machine in every precision that it has.
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

/// The same; each that leaves work out is there once more with `--keep-all`.
pub fn contenders_and_options() -> Vec<Contender> {
    let with_option = |contender: Contender| {
        let leaves_out = contender.engine.omissions().contains(&Omission::Misses);
        [Some(contender), leaves_out.then_some(Contender { keep_all: true, ..contender })].into_iter().flatten()
    };
    contenders().into_iter().flat_map(with_option).collect()
}

impl Contender {
    /// Prepares it for `scene`.
    ///
    /// # Errors
    /// A scene that cannot be traced.
    pub fn prepare(self, scene: &Scene) -> Result<Box<dyn Tracer + '_>, EngineError> {
        Ok(Plan::new(self.engine, scene, self.purpose())?.into_tracer())
    }

    /// Whether it has the shadows that a scene may have.
    pub fn can_trace(self, scene: &Scene) -> bool {
        self.engine.has_shadows() || !scene.shadows
    }

    /// The purpose of its plans.
    pub fn purpose(self) -> Purpose {
        let keep = if self.keep_all { Keep::all() } else { Keep::NOTHING };
        Purpose { precision: Some(self.precision), keep, ..Purpose::default() }
    }

    /// How many levels of 255 estimates of roots may put a channel of its `output` off by, on every CPU: what VRSQRT's
    /// documented error allows, not what one maker's silicon does with it.
    ///
    /// With e = 1.5 2^-12, the error of `rsqrtps`, LAMBERT3 and COSINE are off by e of what they should be, 0.1 of a level.
    /// In SPHERE_LIT an estimate is in the root of D too, which moves the point along the ray by e sqrt s of a radius at
    /// most. With w = 1 + G the distance of the light from the centre, w . N is then off by up to (1 + G) e, and the cosine
    /// by ((1 + G) / G) (1 + 1 / G) e. SHORT_FORM_LOSS keeps G above 0.65, where that is 6.4 e; with the other estimate
    /// 7.4 e, which is 0.69 of a level. `vrsqrt14ps` has a sixth of e.
    ///
    /// So no pixel is off by two levels. How many are off by one depends on how near true values are to a level: in a
    /// picture of one colour it is none or all.
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

    /// The outputs that get a row: floats, and bytes where these are not made from its floats.
    fn entries(self, tracer: &dyn Tracer) -> Vec<Entry> {
        let other_bytes = self.engine != Engine::Reference && self.precision != Precision::Fast;
        let bytes = other_bytes && tracer.writes(PixelFormat::Rgb8);
        let outputs = [PixelFormat::F32x3].into_iter().chain(bytes.then_some(PixelFormat::Rgb8));
        outputs.map(|output| Entry { contender: self, output }).collect()
    }
}

/// One engine, precision and output on one scene. The field names are those of the JSON document; what does not apply is
/// null, and so is what is infinite.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Accuracy {
    /// The scene: its file, or a family and the value of its parameter.
    pub scene: String,
    pub family: Option<Name>,
    /// How stiff: 0 ordinary, 1 between, 2 the end of the family's range.
    pub stiffness: Option<usize>,
    pub width: u32,
    pub height: u32,
    #[serde(flatten)]
    pub who: Who,
    #[serde(flatten)]
    pub errors: Errors,
    /// The CPU that the times are of, where that is not the document's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cpu: Option<String>,
    /// Nanoseconds of a ray: the fastest run.
    pub ns_per_ray: f64,
    pub ns_per_ray_median: f64,
    /// The median absolute deviation as a share of the median.
    pub spread: f64,
    /// Cycles of the time-stamp counter of a ray, the fastest run; None where there is no counter.
    pub cycles_per_ray: Option<f64>,
    pub cycles_per_ray_median: Option<f64>,
    /// Nanoseconds from the parsed scene to the first ray, the fastest run; in no other figure.
    pub setup_ns: f64,
    pub runs: usize,
    /// What the front compares: the root mean square error of a linear colour, or of a level as a share of 255.
    pub error: f64,
    /// Whether no other row of this scene and output is as good in error and time, and better in one.
    pub front: bool,
}

/// Everything that was measured, where, and with what.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct AccuracyReport {
    pub machine: Machine,
    pub complete: bool,
    /// Whether the pictures are small and the runs few.
    pub quick: bool,
    pub rows: Vec<Accuracy>,
    /// Every engine, precision, option and output that is on no front, and why it stays.
    pub off_every_front: Vec<summary::Reason>,
    /// What the robust formulas take by what the paper's plain ones do.
    pub against_plain: Vec<plain::AgainstPlain>,
}

/// The errors of one entry on one scene.
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

/// What a tracer's picture is worth: its `height` rows in a format against what is `expected`, by a tally that has nothing
/// yet.
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

/// The errors of the picture of a scene by every contender that has its shadows, computed by all threads; nothing is timed.
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

/// Seconds of a core that a ray takes, whose truth is found, and each engine's answer to it: what they take on our machine on
/// the average of all families.
const TRUTH_SECONDS: f64 = 4e-5;
const ANSWER_SECONDS: f64 = 4e-6;

/// The seconds that it may take to hold so many `rays` of each of so many contenders against the truth, by all threads.
pub fn forecast(rays: u64, contenders: usize) -> f64 {
    rays as f64 * (TRUTH_SECONDS + contenders as f64 * ANSWER_SECONDS) / cores() as f64
}

/// The seconds that [`measure`] may take for all these.
pub fn forecast_of_measure(subjects: &[Subject], contenders: usize, quick: bool) -> f64 {
    let rays = subjects.iter().map(|subject| subject.scene.camera.pixels()).sum();
    forecast(rays, contenders) + subjects.len() as f64 * ROUNDS[usize::from(!quick)].seconds
}

#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Measured {
    pub rows: Vec<Accuracy>,
    /// The plain formulas beside them, on ordinary scenes.
    pub against_plain: Vec<plain::AgainstPlain>,
}

/// Measures everything of one scene; None where `proceed`, which is asked now and then, says no.
///
/// # Errors
/// An engine that cannot be prepared, or no memory.
pub fn measure(
    subject: &Subject,
    quick: bool,
    clock: &mut dyn Clock,
    rate: Rate,
    proceed: &mut dyn FnMut() -> bool,
) -> Result<Option<Measured>, LabError> {
    let mut contenders = contenders_and_options();
    contenders.retain(|contender| contender.can_trace(&subject.scene));
    let judged = judge(&subject.scene, &contenders)?;
    if !proceed() {
        return Ok(None);
    }
    let (scene, camera) = (&subject.scene, subject.scene.camera);
    let pixels = camera.pixels();
    let mut cases = Vec::new();
    for Judged { entry: Entry { contender, output }, .. } in &judged {
        let format = contender.engine.format_for(output.is_8bit());
        cases.push(Case::of(Timed::Tracing, scene, contender.engine, contender.purpose(), format)?);
    }
    for contender in &contenders {
        let format = contender.engine.format_for(false);
        cases.push(Case::of(Timed::SetUp, scene, contender.engine, contender.purpose(), format)?);
    }
    // One round is not counted: it warms up, and says how many there is time for.
    let Rounds { least, most, seconds } = ROUNDS[usize::from(!quick)];
    let (start, mut bench) = (Instant::now(), Bench::default());
    bench.time(clock, &cases, 0..0, proceed)?;
    let rounds = ((seconds / start.elapsed().as_secs_f64()) as usize).clamp(least, most);
    let Some(runs) = bench.time(clock, &cases, 0..rounds, proceed)? else { return Ok(None) };

    let per_ray = |ticks: f64| ticks / pixels as f64;
    let ns = |ticks: f64| 1e9 * ticks / rate.hz;
    let rows = judged.iter().enumerate().map(|(i, Judged { entry, errors })| {
        let who = contenders.iter().position(|contender| *contender == entry.contender);
        let setup = minimum(&runs[judged.len() + who.expect("who was judged is among the contenders")].ticks);
        let (fastest, middle) = (minimum(&runs[i].ticks), median(&runs[i].ticks));
        Accuracy {
            scene: subject.name.clone(),
            family: subject.family.map(|family| family.id.into()),
            stiffness: subject.family.map(|family| family.stiffness),
            width: camera.width(),
            height: camera.height(),
            who: (*entry).into(),
            errors: *errors,
            cpu: None,
            ns_per_ray: ns(per_ray(fastest)),
            ns_per_ray_median: ns(per_ray(middle)),
            spread: mad(&runs[i].ticks) / middle,
            cycles_per_ray: rate.of_counter.then_some(per_ray(fastest)),
            cycles_per_ray_median: rate.of_counter.then_some(per_ray(middle)),
            setup_ns: ns(setup),
            runs: rounds,
            error: error(errors, entry.output),
            front: false,
        }
    });
    let mut rows: Vec<Accuracy> = rows.collect();
    mark(&mut rows);
    let against_plain = if subject.family.is_none() {
        plain::against_plain(&subject.name, scene, clock, rate.hz, proceed)?.unwrap_or_default()
    } else {
        Vec::new()
    };
    Ok(Some(Measured { rows, against_plain }))
}

/// What the front compares.
pub fn error(errors: &Errors, output: PixelFormat) -> f64 {
    if output.is_8bit() {
        errors.psnr.map_or(0.0, |psnr| 10f64.powf(-psnr / 20.0))
    } else {
        errors.rms_colour.unwrap_or(0.0)
    }
}

/// Marks the front of each scene and output.
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
