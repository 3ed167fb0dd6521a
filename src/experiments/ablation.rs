//! What each omission gains: a scene timed as planned, and without one omission at a time.

pub mod plot;

use std::ops::Range;
use std::slice::from_ref;

use serde::Serialize;

use super::lab::{LabError, Pairs};
use crate::measure::statistics::{Estimate, median};
use crate::measure::{Clock, Runs, Work, cpu_name, interleave};
use crate::plan::{Keep, LeftOut, Omission, Switch};
use crate::render::{Engine, EngineError, Film, FilmMut, PixelFormat, Plan, Purpose, Tracer};
use crate::scene::{Camera, Scene};

/// Rounds, where all rounds together stay within the ticks that are allowed.
const ROUNDS: usize = 21;
/// Fewer rounds give no interval.
const FEWEST_ROUNDS: usize = 5;
/// The pixels of the rows that are traced at a time, as by a frame.
const BAND_PIXELS: usize = 1 << 14;
/// Of the ticks that are allowed, one in so many is what a contestant may take for a band, or else for a row and for two in
/// every round.
const BAND_SHARE: u64 = 50;
const ROWS_SHARE: u64 = 10;

/// What was measured of a plan. The field names are those of the JSON document.
#[derive(Clone, Debug, Serialize)]
pub struct Ablation {
    pub cpu: String,
    pub threads: usize,
    /// Rounds: each traces the scene once as planned, once more so, and once with each omission not made.
    pub rounds: usize,
    /// Rows that were traced, spread evenly over the picture.
    pub rows: usize,
    /// Median TSC cycles of a pixel as planned.
    pub cycles_per_pixel: f64,
    /// The plan against itself: no ratio closer to 1 than its interval reaches is a difference.
    pub control: Timed,
    /// What `--keep-all` takes, by what the plan takes.
    pub keep_all: Timed,
    /// The same with one omission each not made.
    pub worth: Vec<Worth>,
}

/// A line of a plan, not left out.
#[derive(Clone, Debug, Serialize)]
pub struct Worth {
    pub what: &'static str,
    #[serde(flatten)]
    pub timed: Timed,
}

/// How many times as long as the plan a contestant takes. The field names are those of the JSON document; null where that was not
/// measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Timed {
    pub ratio: Option<f64>,
    pub ratio_low: Option<f64>,
    /// None where it takes too long for more than a single measurement.
    pub ratio_high: Option<f64>,
    /// What is to be said of how it was timed, if anything.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub note: Option<&'static str>,
}

impl Timed {
    /// There is no code without the omission.
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

/// A way to trace the scene.
struct Contestant<'a> {
    tracer: Box<dyn Tracer + 'a>,
    /// Whether it traces floats and makes bytes of them.
    by_floats: bool,
}

/// How much of the picture a contestant can trace in every round.
#[derive(Clone, Copy)]
enum Part {
    /// All bands that are chosen.
    Bands,
    /// One row of one band, and two.
    Rows,
    /// None of it: a band takes so many ticks.
    Nothing(u64),
}

/// Measures what the `lines` of a plan are worth in about `ticks` of the clock, on one thread. Tracing alone: the plan is
/// made before. `progress` hears how much of how much is done.
///
/// # Errors
/// An engine that is not there, and no memory for two pictures.
pub fn run(
    engine: Engine,
    purpose: Purpose,
    scene: &Scene,
    lines: &[LeftOut],
    ticks: u64,
    clock: &mut dyn Clock,
    progress: &mut dyn FnMut(usize, usize),
) -> Result<Ablation, LabError> {
    let prepare = |keep: Keep, by_floats: bool| -> Result<Contestant<'_>, EngineError> {
        let format = if by_floats { Some(PixelFormat::F32x4) } else { purpose.format };
        let plan = Plan::new(engine, scene, Purpose { format, keep, ..purpose })?;
        Ok(Contestant { tracer: plan.into_tracer(), by_floats })
    };
    let mut contestants =
        vec![prepare(Keep::NOTHING, false)?, prepare(Keep::NOTHING, false)?, prepare(Keep::all(), false)?];
    let mut places = Vec::with_capacity(lines.len());
    for line in lines {
        let timed = line.switch != Switch::None;
        places.push(timed.then_some(contestants.len()));
        if timed {
            contestants.push(prepare(Keep::only(line.omission), line.omission == Omission::FloatImage)?);
        }
    }
    let camera = &scene.camera;
    let pixels = camera.pixels() as usize;
    let by_floats = contestants.iter().any(|contestant| contestant.by_floats);
    let mut out = Film::new(purpose.format.unwrap_or(PixelFormat::F32x4), pixels)?;
    let mut floats = Film::new(PixelFormat::F32x4, if by_floats { pixels } else { 0 })?;

    let bands = bands(camera, contestants[0].tracer.rows_together());
    let middle = &bands[bands.len() / 2];
    let band_rows = middle.len() as u64;
    // At most so many rows of it, to see how much of the picture each contestant can trace.
    let few = |rows: u64| middle.start..middle.start + rows.min(band_rows) as u32;
    let (mut of_bands, mut of_rows) = (0, 0);
    let mut parts = Vec::with_capacity(contestants.len());
    let all = contestants.len() + ROUNDS;
    for (index, contestant) in contestants.iter().enumerate() {
        let mut time =
            |rows: u64| clock.time(&mut || contestant.trace(camera, from_ref(&few(rows)), &mut out, &mut floats));
        let one = time(1);
        // If a band would take long, two rows are timed as well: much of what one row takes may be set-up.
        let two = if index < 2 || one * band_rows <= ticks / BAND_SHARE { 2 * one } else { time(2) };
        let band = one + two.saturating_sub(one) * (band_rows - 1);
        parts.push(if index < 2 || band <= ticks / BAND_SHARE {
            time(band_rows);
            of_bands += time(band_rows);
            Part::Bands
        } else if one + two <= ticks / ROWS_SHARE {
            of_rows += one + two;
            Part::Rows
        } else {
            Part::Nothing(band)
        });
        progress(index + 1, all);
    }
    // An interval needs rounds: where time is short, fewer rows are traced rather than fewer rounds.
    let affordable = (ticks.saturating_sub(FEWEST_ROUNDS as u64 * of_rows) / of_bands.max(1)) as usize;
    let most = (ticks / of_rows.max(1)).clamp(FEWEST_ROUNDS as u64, ROUNDS as u64) as usize;
    let rounds = affordable.clamp(FEWEST_ROUNDS, most);
    let share = (affordable / rounds).clamp(1, bands.len());
    let chosen: Vec<_> = (0..share).map(|i| bands[(2 * i + 1) * bands.len() / (2 * share)].clone()).collect();
    let rows: usize = chosen.iter().map(Range::len).sum();

    let films = std::cell::RefCell::new((out, floats));
    let (one, two) = (few(1), few(2));
    let mut works: Vec<Work<'_>> = Vec::new();
    for (contestant, part) in contestants.iter().zip(&parts) {
        let bands: &[&[Range<u32>]] = match part {
            Part::Bands => &[&chosen],
            Part::Rows => &[from_ref(&one), from_ref(&two)],
            Part::Nothing(_) => &[],
        };
        for bands in bands.iter().copied() {
            let films = &films;
            works.push(Box::new(move || {
                let (out, floats) = &mut *films.borrow_mut();
                contestant.trace(camera, bands, out, floats);
            }));
        }
    }
    let mut done = 0;
    let mut proceed = || {
        done += 1;
        progress(contestants.len() + done, contestants.len() + rounds);
        true
    };
    let runs = interleave(clock, &mut works, 0..rounds, &mut proceed).expect("nobody stops it");
    let estimate = |own: &Runs| Pairs::of(own, &runs[0]).estimate(1);
    let planned = median(&runs[0].ticks);
    let mut in_turn = runs.iter();
    let mut next = || in_turn.next().expect("every contestant has the works of its part");
    let against_plan = |part: &Part| match part {
        Part::Bands => Timed::of(estimate(next()), None),
        Part::Rows => {
            let (one, two) = (next(), next());
            let all = |(one, two): (&f64, &f64)| share as f64 * (one + (two - one).max(0.0) * (band_rows - 1) as f64);
            let taken = one.taken.iter().zip(&two.taken).map(|(one, two)| *one || *two).collect();
            let ticks = one.ticks.iter().zip(&two.ticks).map(all).collect();
            // Each further row is taken to cost as much as the second.
            let estimate = estimate(&Runs { ticks, taken, migrations: 0 });
            Timed::of(estimate, Some("extrapolated from one row and from two"))
        }
        Part::Nothing(band) => Timed::once(share as f64 * *band as f64 / planned),
    };
    let timed: Vec<Timed> = parts.iter().map(against_plan).collect();
    let worth = |(line, place): (&LeftOut, Option<usize>)| Worth {
        what: line.what,
        timed: place.map_or(Timed::NO_CODE, |place| timed[place]),
    };
    Ok(Ablation {
        cpu: cpu_name(),
        threads: 1,
        rounds,
        rows,
        cycles_per_pixel: planned / (rows as f64 * f64::from(camera.width())),
        control: timed[1],
        keep_all: timed[2],
        worth: lines.iter().zip(places).map(worth).collect(),
    })
}

/// The rows of a picture as a frame hands them to a thread.
fn bands(camera: &Camera, together: u32) -> Vec<Range<u32>> {
    let rows = (BAND_PIXELS / camera.width() as usize).max(1).next_multiple_of(together as usize);
    let start = |row: u32| row..(row + rows as u32).min(camera.height());
    (0..camera.height()).step_by(rows).map(start).collect()
}

impl Contestant<'_> {
    fn trace(&self, camera: &Camera, bands: &[Range<u32>], out: &mut Film, floats: &mut Film) {
        for rows in bands {
            let width = camera.width() as usize;
            let pixels = rows.start as usize * width..rows.end as usize * width;
            let out = out.as_mut().part(pixels.clone());
            if self.by_floats && out.format().is_8bit() {
                let FilmMut::F32x4(floats) = floats.as_mut() else { unreachable!("it was made of floats") };
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
    use crate::scene::many;

    type Script = Scripted<std::vec::IntoIter<u64>>;

    /// First the `trials`, then rounds of `round`, there and back.
    fn script(trials: Vec<u64>, round: &[u64]) -> Script {
        let mut ticks = trials;
        for i in 0..ROUNDS {
            if i % 2 == 0 { ticks.extend(round) } else { ticks.extend(round.iter().rev()) }
        }
        Scripted(ticks.into_iter())
    }

    /// What is found of eighteen objects in one band of 48 rows, with at most so many of the lines that can be timed.
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
        let mut told = Vec::new();
        let mut progress = |done, all| told.push((done, all));
        let mut clock = clock(timed);
        let found = run(engine, purpose, &scene, &lines, ticks, &mut clock, &mut progress).unwrap();
        assert_eq!((found.rounds, found.rows), (ROUNDS, 48));
        assert!(clock.0.next().is_none(), "all of the script was used");
        assert!(told.is_sorted() && told.last() == Some(&(3 + timed + ROUNDS, 3 + timed + ROUNDS)), "{told:?}");
        (lines, found)
    }

    fn ratio(timed: Timed) -> f64 {
        assert!(timed.note.is_none() && timed.ratio_low <= timed.ratio && timed.ratio <= timed.ratio_high, "{timed:?}");
        timed.ratio.unwrap()
    }

    /// As planned 100 ticks, again 100, all kept 800, and then each line more than the one before.
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

    /// All kept, one row takes 30 ticks and two 50, so that 48 take 970; and a line takes 300 and 700, which is too many.
    #[test]
    fn what_takes_long_is_extrapolated_from_two_rows_in_every_round_or_once() {
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
