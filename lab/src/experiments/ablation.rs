//! The gain of each omission: a scene is timed as planned, and without one omission at a time.

pub mod plot;

use std::cell::RefCell;
use std::ops::Range;
use std::slice::from_ref;

use serde::Serialize;

use super::check;
use super::lab::{LabError, Pairs};
use crate::measure::statistics::{Estimate, median};
use crate::measure::{Clock, Runs, Work, cpu_name, interleave};
use rayo::internals::plan::{Keep, LeftOut, Omission, Switch};
use rayo::internals::render::{Engine, EngineError, Film, FilmMut, PixelFormat, Plan, Purpose, Tracer};
use rayo::internals::scene::{Camera, Scene};

/// The number of rounds if the allowed ticks suffice for it.
const ROUNDS: usize = 21;
/// The least number of rounds: fewer give no usable interval.
const FEWEST_ROUNDS: usize = 5;
/// About how many pixels are traced in one call. A band is whole rows of them, like the tasks that
/// a frame gives to its threads.
const BAND_PIXELS: usize = 1 << 14;
/// What a contestant may take of the allowed ticks in a round: 1 / `BAND_SHARE` of them to trace a
/// band. If a band takes longer, only one row and two rows are traced, which together may take 1 /
/// `ROWS_SHARE`.
const BAND_SHARE: u64 = 50;
const ROWS_SHARE: u64 = 10;

/// The measured gains of a plan's omissions. The field names are those of the JSON document.
#[derive(Clone, Debug, Serialize)]
pub struct Ablation {
    pub cpu: String,
    pub threads: usize,
    /// The number of rounds. A round traces the scene twice as planned, so that the two can be
    /// compared, and once without each omission.
    pub rounds: usize,
    /// The number of rows that were traced, spread evenly over the picture.
    pub rows: usize,
    /// Median TSC cycles per pixel as planned.
    pub cycles_per_pixel: f64,
    /// The plan timed against itself. A ratio within this interval shows no difference from the
    /// plan.
    pub control: Timed,
    /// The time with `--keep-all`, divided by that of the plan.
    pub keep_all: Timed,
    /// For each omission, the time without it, divided by that of the plan.
    pub worth: Vec<OmissionGain>,
}

/// The gain of one omission of a plan: the time without it, relative to the plan's.
#[derive(Clone, Debug, Serialize)]
pub struct OmissionGain {
    pub what: &'static str,
    #[serde(flatten)]
    pub timed: Timed,
}

/// The ratio of a contestant's time to the plan's. The field names are those of the JSON document;
/// null where nothing was measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Timed {
    pub ratio: Option<f64>,
    pub ratio_low: Option<f64>,
    /// None if there was only time for a single measurement.
    pub ratio_high: Option<f64>,
    /// A remark on how it was timed, if one is needed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<&'static str>,
}

impl Timed {
    /// Of an omission that cannot be switched off, since no code does the work that it saves.
    const NO_CODE: Timed =
        Timed { ratio: None, ratio_low: None, ratio_high: None, note: Some("there is no code without it") };

    fn of(estimate: Estimate, note: Option<&'static str>) -> Self {
        let Estimate { value, low, high } = estimate;
        Timed { ratio: Some(value), ratio_low: Some(low), ratio_high: Some(high), note }
    }

    fn once(ratio: f64) -> Self {
        let note = "extrapolated from one row and from two, timed once: too slow for more";
        Timed { ratio: Some(ratio), note: Some(note), ..Timed::NO_CODE }
    }
}

/// A tracer of the scene: the plan's, or one without an omission.
struct Contestant<'a> {
    tracer: Box<dyn Tracer + 'a>,
    /// Whether it traces floats and converts them to bytes afterwards.
    by_floats: bool,
}

/// How much of the picture a contestant can trace in every round.
#[derive(Clone, Copy)]
enum Workload {
    /// All chosen bands.
    Bands,
    /// One row and two rows of a band, from which the time of a whole band is extrapolated.
    Rows,
    /// No rows, since even these take too long. A band would take this many ticks, extrapolated
    /// from a single measurement.
    Nothing(u64),
}

/// The contestants in order: the plan; the plan again, as the control; `--keep-all`; and the plan
/// without each omission that can be switched off.
struct Contestants<'a> {
    all: Vec<Contestant<'a>>,
    /// For each of the plan's omissions the index of its contestant, if it has one.
    of_lines: Vec<Option<usize>>,
}

/// The number of contestants that are the plan itself. They are always timed on whole bands.
const PLANS: usize = 2;

/// The films that all contestants draw on.
struct Films {
    out: Film,
    /// Floats to be converted to bytes; without pixels if no contestant needs them.
    floats: Film,
}

/// What was found by tracing the first rows of a band: how much each contestant has time for in a
/// round. `of_bands` are the ticks for one band by every contestant that traces bands; `of_rows`
/// are those of all other contestants.
struct Trials {
    parts: Vec<Workload>,
    of_bands: u64,
    of_rows: u64,
}

/// The number of rounds, and the bands that are traced in each.
struct Schedule {
    rounds: usize,
    bands: Vec<Range<u32>>,
}

/// Measures the gain of each of the `lines` of a plan, on one thread, in about `ticks` ticks of the
/// clock. Only tracing is timed, not planning. `progress` is called with the amount of work done
/// and the total amount.
///
/// # Errors
/// If the engine cannot run here, or if there is no memory for two pictures.
pub fn run(
    engine: Engine,
    purpose: Purpose,
    scene: &Scene,
    lines: &[LeftOut],
    ticks: u64,
    clock: &mut dyn Clock,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Ablation, LabError> {
    let contestants = Contestants::new(engine, purpose, scene, lines)?;
    let camera = &scene.camera;
    let mut films = contestants.films(purpose.format, camera)?;
    let bands = bands(camera, contestants.all[0].tracer.rows_together());
    let middle = bands[bands.len() / 2].clone();

    let trials = contestants.try_out(camera, &middle, ticks, clock, &mut films, progress)?;
    let schedule = trials.schedule(ticks, &bands);
    let rows: usize = schedule.bands.iter().map(Range::len).sum();

    let count = contestants.all.len();
    let mut done = 0;
    let mut proceed = || {
        done += 1;
        progress(count + done, count + schedule.rounds);
        true
    };
    let films = RefCell::new(films);
    let mut works = contestants.works(camera, &trials.parts, &schedule.bands, &middle, &films);
    let runs = interleave(clock, &mut works, 0..schedule.rounds, &mut proceed).expect("nobody stops it");
    let timed = against_plan(&trials.parts, &runs, schedule.bands.len(), middle.len());
    let worth = |(line, place): (&LeftOut, &Option<usize>)| OmissionGain {
        what: line.what,
        timed: place.map_or(Timed::NO_CODE, |place| timed[place]),
    };
    Ok(Ablation {
        cpu: cpu_name(),
        threads: 1,
        rounds: schedule.rounds,
        rows,
        cycles_per_pixel: median(&runs[0].ticks) / (rows as f64 * f64::from(camera.width())),
        control: timed[1],
        keep_all: timed[PLANS],
        worth: lines.iter().zip(&contestants.of_lines).map(worth).collect(),
    })
}

impl<'a> Contestants<'a> {
    fn new(engine: Engine, purpose: Purpose, scene: &'a Scene, lines: &[LeftOut]) -> Result<Self, EngineError> {
        let prepare = |keep: Keep, by_floats: bool| -> Result<Contestant<'a>, EngineError> {
            let format = if by_floats { Some(PixelFormat::F32x4) } else { purpose.format };
            let plan = Plan::new(engine, scene, Purpose { format, keep, ..purpose })?;
            Ok(Contestant { tracer: plan.into_tracer(), by_floats })
        };
        let mut all =
            vec![prepare(Keep::NOTHING, false)?, prepare(Keep::NOTHING, false)?, prepare(Keep::all(), false)?];
        let mut of_lines = Vec::with_capacity(lines.len());
        for line in lines {
            let is_timed = line.switch != Switch::None;
            of_lines.push(is_timed.then_some(all.len()));
            if is_timed {
                all.push(prepare(Keep::only(line.omission), line.omission == Omission::FloatImage)?);
            }
        }
        Ok(Contestants { all, of_lines })
    }

    fn films(&self, format: Option<PixelFormat>, camera: &Camera) -> Result<Films, LabError> {
        let pixels = camera.pixels() as usize;
        let by_floats = self.all.iter().any(|contestant| contestant.by_floats);
        Ok(Films {
            out: Film::new(format.unwrap_or(PixelFormat::F32x4), pixels)?,
            floats: Film::new(PixelFormat::F32x4, if by_floats { pixels } else { 0 })?,
        })
    }

    /// Checks every contestant, and times it on the first rows of a band to see how much of the
    /// picture it has time for.
    fn try_out(
        &self,
        camera: &Camera,
        band: &Range<u32>,
        ticks: u64,
        clock: &mut dyn Clock,
        films: &mut Films,
        progress: &mut dyn FnMut(usize, usize),
    ) -> Result<Trials, LabError> {
        let band_rows = band.len() as u64;
        let mut trials = Trials { parts: Vec::with_capacity(self.all.len()), of_bands: 0, of_rows: 0 };
        for (index, contestant) in self.all.iter().enumerate() {
            check::kernels_in(|| contestant.trace(camera, from_ref(&first_rows(band, 1)), films))?;
            let mut time =
                |rows: u64| clock.time(&mut || contestant.trace(camera, from_ref(&first_rows(band, rows)), films));
            let is_plan = index < PLANS;
            let one = time(1);
            // If a band would take long, two rows are timed as well: much of the time of the first
            // row may be set-up, which further rows do not repeat.
            let two = if is_plan || one * band_rows <= ticks / BAND_SHARE { 2 * one } else { time(2) };
            let whole = one + two.saturating_sub(one) * (band_rows - 1);
            trials.parts.push(if is_plan || whole <= ticks / BAND_SHARE {
                time(band_rows);
                trials.of_bands += time(band_rows);
                Workload::Bands
            } else if one + two <= ticks / ROWS_SHARE {
                trials.of_rows += one + two;
                Workload::Rows
            } else {
                Workload::Nothing(whole)
            });
            progress(index + 1, self.all.len() + ROUNDS);
        }
        Ok(trials)
    }

    /// The calls to be timed in a round: none, one or two for each contestant, as its part says.
    fn works<'b>(
        &'b self,
        camera: &'b Camera,
        parts: &[Workload],
        bands: &'b [Range<u32>],
        middle: &Range<u32>,
        films: &'b RefCell<Films>,
    ) -> Vec<Work<'b>> {
        let mut works: Vec<Work<'b>> = Vec::new();
        let mut add = |contestant: &'b Contestant<'a>, rows: Vec<Range<u32>>| {
            works.push(Box::new(move || contestant.trace(camera, &rows, &mut films.borrow_mut())));
        };
        for (contestant, part) in self.all.iter().zip(parts) {
            match part {
                Workload::Bands => add(contestant, bands.to_vec()),
                Workload::Rows => [1, 2].into_iter().for_each(|rows| add(contestant, vec![first_rows(middle, rows)])),
                Workload::Nothing(_) => {}
            }
        }
        works
    }
}

impl Trials {
    /// The rounds and bands for which `ticks` suffice. A confidence interval needs several rounds:
    /// where time is short, fewer rows are traced rather than fewer rounds.
    fn schedule(&self, ticks: u64, bands: &[Range<u32>]) -> Schedule {
        let left = ticks.saturating_sub(FEWEST_ROUNDS as u64 * self.of_rows);
        // How many bands can be traced in all rounds together.
        let affordable = (left / self.of_bands.max(1)) as usize;
        let most = (ticks / self.of_rows.max(1)).clamp(FEWEST_ROUNDS as u64, ROUNDS as u64) as usize;
        let rounds = affordable.clamp(FEWEST_ROUNDS, most);
        let count = (affordable / rounds).clamp(1, bands.len());
        // Spread evenly over the picture.
        let band = |i: usize| bands[(2 * i + 1) * bands.len() / (2 * count)].clone();
        Schedule { rounds, bands: (0..count).map(band).collect() }
    }
}

/// The ratio of each contestant's time to the plan's, from `runs`, in each of which `bands` bands
/// of `band_rows` rows were traced.
fn against_plan(parts: &[Workload], runs: &[Runs], bands: usize, band_rows: usize) -> Vec<Timed> {
    let estimate = |own: &Runs| Pairs::of(own, &runs[0]).estimate(1);
    let planned = median(&runs[0].ticks);
    let mut in_turn = runs.iter();
    let mut next = || in_turn.next().expect("every contestant has the works of its part");
    let of_part = |part: &Workload| match part {
        Workload::Bands => Timed::of(estimate(next()), None),
        Workload::Rows => {
            let extrapolated = extrapolate(next(), next(), bands, band_rows);
            Timed::of(estimate(&extrapolated), Some("extrapolated from one row and from two"))
        }
        Workload::Nothing(band) => Timed::once(bands as f64 * *band as f64 / planned),
    };
    parts.iter().map(of_part).collect()
}

/// The times of `bands` bands, extrapolated from the times of one row and of two: each further row
/// is assumed to take as long as the second one.
fn extrapolate(one: &Runs, two: &Runs, bands: usize, band_rows: usize) -> Runs {
    let all = |(one, two): (&f64, &f64)| bands as f64 * (one + (two - one).max(0.0) * (band_rows - 1) as f64);
    Runs {
        ticks: one.ticks.iter().zip(&two.ticks).map(all).collect(),
        taken: one.taken.iter().zip(&two.taken).map(|(one, two)| *one || *two).collect(),
        migrations: 0,
    }
}

/// The first `rows` rows of a band, or all if it has fewer.
fn first_rows(band: &Range<u32>, rows: u64) -> Range<u32> {
    band.start..band.start + rows.min(band.len() as u64) as u32
}

/// Divides the rows of a picture into bands, as a frame divides them into tasks for threads.
fn bands(camera: &Camera, together: u32) -> Vec<Range<u32>> {
    let rows = (BAND_PIXELS / camera.width() as usize).max(1).next_multiple_of(together as usize);
    let start = |row: u32| row..(row + rows as u32).min(camera.height());
    (0..camera.height()).step_by(rows).map(start).collect()
}

impl Contestant<'_> {
    fn trace(&self, camera: &Camera, bands: &[Range<u32>], films: &mut Films) {
        for rows in bands {
            let width = camera.width() as usize;
            let pixels = rows.start as usize * width..rows.end as usize * width;
            let out = films.out.as_mut().part(pixels.clone());
            if self.by_floats && out.format().is_8bit() {
                let FilmMut::F32x4(floats) = films.floats.as_mut() else { unreachable!("it was made of floats") };
                let floats = &mut floats[pixels];
                self.tracer.rows(rows.clone(), FilmMut::F32x4(floats));
                out.set(floats);
            } else {
                self.tracer.rows(rows.clone(), out);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::Scripted;
    use rayo::internals::scene::many;

    type Script = Scripted<std::vec::IntoIter<u64>>;

    /// A scripted clock: first the `trials`, then rounds of `round`, every other one in reverse
    /// order.
    fn script(trials: Vec<u64>, round: &[u64]) -> Script {
        let mut ticks = trials;
        for i in 0..ROUNDS {
            if i % 2 == 0 { ticks.extend(round) } else { ticks.extend(round.iter().rev()) }
        }
        Scripted(ticks.into_iter())
    }

    /// The measurement of a plan for eighteen objects, in one band of 48 rows, with at most `most`
    /// lines that can be timed.
    fn measured(most: usize, ticks: u64, mut clock: impl FnMut(usize) -> Script) -> (Vec<LeftOut>, Ablation) {
        let scene = Scene { camera: Camera::new(64, 48, 1.0, 1.0).unwrap(), ..many(9, 9, 71) };
        let engine = Engine::fastest();
        let purpose = Purpose { format: Some(PixelFormat::Rgba8), ..Purpose::default() };
        let mut lines = Plan::new(engine, &scene, purpose).unwrap().report().left_out;
        let mut left = most;
        lines.retain(|line| {
            let timed = line.switch != Switch::None;
            left -= usize::from(timed && left > 0);
            !timed || left > 0
        });
        let timed = lines.iter().filter(|line| line.switch != Switch::None).count();
        let mut reports = Vec::new();
        let mut progress = |done, all| reports.push((done, all));
        let mut clock = clock(timed);
        let found = run(engine, purpose, &scene, &lines, ticks, &mut clock, &mut progress).unwrap();
        assert_eq!((found.rounds, found.rows), (ROUNDS, 48));
        assert!(clock.0.next().is_none(), "all of the script was used");
        assert!(
            reports.is_sorted() && reports.last() == Some(&(3 + timed + ROUNDS, 3 + timed + ROUNDS)),
            "{reports:?}"
        );
        (lines, found)
    }

    fn ratio(timed: Timed) -> f64 {
        assert!(timed.note.is_none() && timed.ratio_low <= timed.ratio && timed.ratio <= timed.ratio_high, "{timed:?}");
        timed.ratio.unwrap()
    }

    /// The scripted plan takes 100 ticks, again 100, `--keep-all` 800, and then each line more than
    /// the one before.
    #[test]
    fn a_ratio_is_what_a_line_takes_by_what_the_plan_takes() {
        let (lines, found) = measured(usize::MAX, u64::MAX, |timed| {
            let round: Vec<_> = [100, 100, 800].into_iter().chain((2..).map(|i| 100 * i).take(timed)).collect();
            script(round.iter().flat_map(|ticks| [1, *ticks, *ticks]).collect(), &round)
        });
        assert_eq!((ratio(found.control), ratio(found.keep_all)), (1.0, 8.0));
        let mut expected = (2..).map(f64::from);
        for (line, worth) in lines.iter().zip(&found.worth) {
            match line.switch {
                Switch::None => assert_eq!(worth.timed, Timed::NO_CODE, "{:?}", line.omission),
                _ => assert_eq!(ratio(worth.timed), expected.next().unwrap(), "{:?}", line.omission),
            }
        }
    }

    /// With `--keep-all` one row takes 30 ticks and two take 50, so that 48 take 970. The last line
    /// takes 300 for one row and 700 for two, too many for every round.
    #[test]
    fn slow_contestants_are_extrapolated_from_two_rows() {
        let (lines, found) = measured(2, 5000, |timed| {
            assert_eq!(timed, 1);
            script(vec![1, 10, 10, 1, 10, 10, 30, 50, 300, 700], &[10, 10, 30, 50])
        });
        assert_eq!(ratio(found.control), 1.0);
        assert_eq!(found.keep_all.ratio, Some(97.0));
        assert_eq!(found.keep_all.note, Some("extrapolated from one row and from two"));
        let slow = lines.iter().position(|line| line.switch != Switch::None).unwrap();
        assert_eq!(found.worth[slow].timed, Timed::once(1910.0));
    }
}
