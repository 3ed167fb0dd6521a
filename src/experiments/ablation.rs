//! What each omission is worth: a scene traced as planned, and with one omission after the other not made.

use std::collections::TryReserveError;
use std::ops::Range;

use serde::Serialize;

use crate::measure::statistics::{Estimate, median, median_with_interval, pairwise_ratios};
use crate::measure::{Clock, Work, interleave};
use crate::plan::{Keep, LeftOut, Omission, Switch};
use crate::render::{Engine, EngineError, Film, FilmMut, PixelFormat, Purpose, Tracer};
use crate::scene::{Camera, Rng, Scene};

/// Rounds, where all rounds together stay within the ticks that are allowed.
const ROUNDS: usize = 21;
/// Fewer make no interval.
const FEWEST_ROUNDS: usize = 5;
/// Rows are traced as many at a time as have this many pixels, as a frame does.
const BAND_PIXELS: usize = 1 << 14;
/// Where the bootstrap's draws begin.
const SEED: u64 = 0x0ab1_a710;

/// What was measured.
#[derive(Clone, Debug, Serialize)]
pub struct Ablation {
    /// Rounds: each traces the scene once as planned, once more so, and once with each omission not made.
    pub rounds: usize,
    /// Rows that were traced, spread evenly over the picture.
    pub rows: usize,
    /// Median TSC cycles of a pixel as planned.
    pub cycles_per_pixel: f64,
    /// The plan against itself: no ratio closer to 1 than its interval reaches is a difference.
    pub control: Estimate,
    /// What `--keep-all` takes, by what the plan takes.
    pub keep_all: Estimate,
    /// The same for one omission each; None where it cannot be switched off.
    pub worth: Vec<Option<Estimate>>,
}

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
pub enum AblationError {
    /// An engine could not be prepared.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// No memory for the picture.
    #[error("there is no memory for a picture of {pixels} pixels: {source}")]
    Memory {
        /// Its size.
        pixels: u64,
        /// What the allocator says.
        source: TryReserveError,
    },
}

/// A way to trace the scene.
struct Contestant<'a> {
    tracer: Box<dyn Tracer + 'a>,
    /// Whether it traces floats and makes bytes of them.
    by_floats: bool,
}

/// Measures what the `lines` of a plan are worth in about `ticks` of the clock, on one thread. Tracing alone: the plan is
/// made before.
///
/// # Errors
/// An engine that is not there, and no memory for two pictures.
pub fn run(
    (engine, purpose): (Engine, Purpose),
    scene: &Scene,
    camera: &Camera,
    lines: &[LeftOut],
    ticks: u64,
    clock: &mut dyn Clock,
) -> Result<Ablation, AblationError> {
    let prepare = |keep: Keep, by_floats: bool| -> Result<Contestant<'_>, EngineError> {
        let format = if by_floats { Some(PixelFormat::F32x4) } else { purpose.format };
        Ok(Contestant { tracer: engine.prepare_for(Purpose { format, keep, ..purpose }, scene, camera)?, by_floats })
    };
    let mut contestants =
        vec![prepare(Keep::NOTHING, false)?, prepare(Keep::NOTHING, false)?, prepare(Keep::all(), false)?];
    let mut places = Vec::with_capacity(lines.len());
    for line in lines {
        let timed = line.omission.switch() != Switch::None;
        places.push(timed.then_some(contestants.len()));
        if timed {
            contestants.push(prepare(Keep::only(line.omission), line.omission == Omission::FloatImage)?);
        }
    }
    let pixels = camera.pixels();
    let film = |format, pixels: u64| {
        Film::new(format, pixels as usize).map_err(|source| AblationError::Memory { pixels, source })
    };
    let by_floats = contestants.iter().any(|contestant| contestant.by_floats);
    let mut out = film(purpose.format.unwrap_or(PixelFormat::F32x4), pixels)?;
    let mut floats = film(PixelFormat::F32x4, if by_floats { pixels } else { 0 })?;

    let bands = bands(camera);
    // One band of each, there and back, to see how many all of them can have.
    let middle = &bands[bands.len() / 2..=bands.len() / 2];
    let mut total = 0;
    for contestant in &contestants {
        clock.time(&mut || contestant.trace(camera, middle, &mut out, &mut floats));
    }
    for contestant in contestants.iter().rev() {
        total += clock.time(&mut || contestant.trace(camera, middle, &mut out, &mut floats));
    }
    let affordable = (ticks / total.max(1)) as usize;
    // Rather fewer rows than fewer rounds: an interval wants rounds.
    let rounds = affordable.clamp(FEWEST_ROUNDS, ROUNDS);
    let share = (affordable / rounds).clamp(1, bands.len());
    let chosen: Vec<_> = (0..share).map(|i| bands[(2 * i + 1) * bands.len() / (2 * share)].clone()).collect();
    let rows: usize = chosen.iter().map(Range::len).sum();

    let films = std::cell::RefCell::new((out, floats));
    let mut works: Vec<Work<'_>> = Vec::new();
    for contestant in &contestants {
        let (films, chosen) = (&films, &chosen);
        works.push(Box::new(move || {
            let (out, floats) = &mut *films.borrow_mut();
            contestant.trace(camera, chosen, out, floats);
        }));
    }
    let runs = interleave(clock, &mut works, 0..rounds, &mut || true).expect("nobody stops it");
    let mut rng = Rng::new(SEED);
    let mut against_plan = |index: usize| {
        let ratios = pairwise_ratios(&runs[index].ticks, &runs[0].ticks);
        median_with_interval(ratios.chunks(1), &mut || rng.next_u64())
    };
    Ok(Ablation {
        rounds,
        rows,
        cycles_per_pixel: median(&runs[0].ticks) / (rows as f64 * f64::from(camera.width())),
        control: against_plan(1),
        keep_all: against_plan(2),
        worth: places.into_iter().map(|place| place.map(&mut against_plan)).collect(),
    })
}

/// The rows of a picture as a frame hands them to a thread.
fn bands(camera: &Camera) -> Vec<Range<u32>> {
    let rows = (BAND_PIXELS / camera.width() as usize).max(1);
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
    use crate::scene::many;

    /// A clock by a script, in which contestants take turns, forwards and backwards.
    struct Scripted {
        ticks: Vec<u64>,
        calls: usize,
    }

    impl Clock for Scripted {
        fn time(&mut self, _: &mut dyn FnMut()) -> u64 {
            let (round, turn) = (self.calls / self.ticks.len(), self.calls % self.ticks.len());
            self.calls += 1;
            self.ticks[if round.is_multiple_of(2) { turn } else { self.ticks.len() - 1 - turn }]
        }

        fn core(&mut self) -> Option<usize> {
            Some(0)
        }
    }

    /// As planned 100 ticks, again 100, all kept 800, and then each line more than the one before.
    #[test]
    fn a_ratio_is_what_a_line_takes_by_what_the_plan_takes() {
        let scene = Scene { camera: Camera::new(64, 48, 1.0, 1.0).unwrap(), ..many(4, 4, 71) };
        let engine = Engine::fastest();
        let purpose = Purpose { format: Some(PixelFormat::Rgba8), ..Purpose::default() };
        let lines = engine.report(purpose, &scene, &scene.camera).unwrap().left_out;
        let timed = lines.iter().filter(|line| line.omission.switch() != Switch::None).count();
        let one_each = (2..).map(|i| 100 * i).take(timed);
        let ticks = [100, 100, 800].into_iter().chain(one_each).collect();
        let mut clock = Scripted { ticks, calls: 0 };
        let found = run((engine, purpose), &scene, &scene.camera, &lines, u64::MAX, &mut clock).unwrap();
        assert_eq!((found.rounds, found.rows), (ROUNDS, 48));
        assert_eq!((found.control.value, found.keep_all.value), (1.0, 8.0));
        let mut expected = (2..).map(f64::from);
        for (line, worth) in lines.iter().zip(&found.worth) {
            assert_eq!(worth.is_some(), line.omission.switch() != Switch::None, "{:?}", line.omission);
            if let Some(worth) = worth {
                assert_eq!(worth.value, expected.next().unwrap(), "{:?}", line.omission);
            }
        }
    }
}
