//! Times several pictures in turns, and leaves out times during which other programs had the core.

use std::cell::RefCell;
use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::check::{self, Failed};
use crate::measure::statistics::{Estimate, median_with_interval, pairwise_ratios};
use crate::measure::{Clock, Runs, Work, enough, interleave};
use rayo::internals::kernels::step::Unavailable;
use rayo::internals::render::{Engine, EngineError, Film, FilmMut, NoMemory, PixelFormat, Plan, Purpose, RenderError};
use rayo::internals::scene::{Camera, Rng, Scene};

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
pub enum LabError {
    #[error(transparent)]
    Engine(#[from] EngineError),
    #[error(transparent)]
    Memory(#[from] NoMemory),
    /// An engine's picture differs from the reference's, so that its time would mean nothing.
    #[error(
        "{wrong} of {pixels} pixels that `{who}` wrote as {output} are not those of `reference`, \
         and at most {allowed} may differ: its time is not that of the same picture"
    )]
    Picture {
        who: String,
        output: &'static str,
        /// Pixels off by more than a level.
        wrong: usize,
        pixels: usize,
        /// The number of pixels at outlines where rounding may turn a hit into a miss or a miss
        /// into a hit.
        allowed: usize,
    },
    #[error("{0}\nnothing is timed until this is mended")]
    Kernel(#[from] Box<Failed>),
    #[error(transparent)]
    Threads(#[from] RenderError),
    #[error(transparent)]
    Uncounted(#[from] Unavailable),
    #[error("cannot {what}: {error}")]
    System { what: &'static str, error: std::io::Error },
    #[error("stopped before the first size was finished: there is nothing to show")]
    Nothing,
}

/// A callback for progress: gets the work done since its last call, in roughly estimated cycles, of
/// which only the proportions matter. If it returns false, the measurement ends, and its result is
/// what was finished until then.
pub type Progress<'a> = dyn FnMut(u64) -> bool + 'a;

/// Which part of making a picture is timed.
#[derive(Clone, Copy)]
pub enum Timed {
    /// Tracing: from the prepared tracer to the last pixel.
    Tracing,
    /// Set-up: from the parsed scene to the prepared tracer.
    SetUp,
    Both,
}

/// Traces a range of rows into a film that has the size of this range.
type Trace<'a> = Box<dyn Fn(Range<u32>, FilmMut<'_>) + 'a>;

/// A picture to be timed: its camera, the format of its pixels, and the function that traces its
/// rows.
pub struct Case<'a> {
    camera: Camera,
    pub output: PixelFormat,
    trace: Trace<'a>,
}

impl<'a> Case<'a> {
    pub fn new(camera: Camera, output: PixelFormat, trace: impl Fn(Range<u32>, FilmMut<'_>) + 'a) -> Self {
        Case { camera, output, trace: Box::new(trace) }
    }

    /// A case in which an engine traces a scene.
    ///
    /// # Errors
    /// If the engine cannot trace the scene.
    pub fn of(
        timed: Timed,
        scene: &'a Scene,
        engine: Engine,
        purpose: Purpose<'a>,
        output: PixelFormat,
    ) -> Result<Self, EngineError> {
        let ready = move || Plan::new(engine, scene, purpose).map(Plan::into_tracer);
        let tracer = ready()?;
        let again = move || ready().expect("it could be done before");
        Ok(match timed {
            Timed::Tracing => Case::new(scene.camera, output, move |rows, film| tracer.rows(rows, film)),
            Timed::SetUp => Case::new(scene.camera, output, move |_, _| drop(std::hint::black_box(again()))),
            Timed::Both => Case::new(scene.camera, output, move |rows, film| again().rows(rows, film)),
        })
    }

    /// Traces a range of rows into a film that has the size of this range.
    pub fn rows(&self, rows: Range<u32>, film: FilmMut<'_>) {
        (self.trace)(rows, film);
    }

    /// Traces the whole picture.
    pub fn trace(&self, film: &mut Film) {
        (self.trace)(0..self.camera.height(), film.as_mut().part(0..self.camera.pixels() as usize));
    }
}

/// One film for each pixel format, shared by all cases. All pages of its memory have been written
/// to before, so that every case finds it in the same state.
#[derive(Default)]
pub struct Bench {
    films: Vec<(PixelFormat, Film)>,
    is_warm: bool,
}

impl Bench {
    /// Times each case once per round, in turns. Before the first use of the bench, all cases trace
    /// once untimed, so that no timing includes one-off costs. This untimed round makes checked
    /// calls, so that no kernel is timed that breaks the calling convention. `proceed` is called
    /// after each round; if it returns false, the result is None.
    ///
    /// # Errors
    /// If there is no memory for the largest picture, or if a kernel breaks a rule or crashes.
    pub fn time(
        &mut self,
        clock: &mut dyn Clock,
        cases: &[Case<'_>],
        rounds: Range<usize>,
        proceed: &mut dyn FnMut() -> bool,
    ) -> Result<Option<Vec<Runs>>, LabError> {
        for case in cases {
            let pixels = case.camera.pixels() as usize;
            if !self.films.iter().any(|(format, film)| *format == case.output && film.len() >= pixels) {
                self.films.retain(|(format, _)| *format != case.output);
                self.films.push((case.output, Film::new(case.output, pixels)?));
            }
        }
        let films = RefCell::new(&mut self.films);
        let work = |case: &'_ Case<'_>| {
            let mut films = films.borrow_mut();
            case.trace(&mut films.iter_mut().find(|(format, _)| *format == case.output).expect("it was made").1);
        };
        let mut works: Vec<Work<'_>> = cases.iter().map(|case| Box::new(move || work(case)) as Work<'_>).collect();
        if !std::mem::replace(&mut self.is_warm, true) {
            works.iter_mut().try_for_each(check::kernels_in)?;
        }
        Ok(interleave(clock, &mut works, rounds, proceed))
    }
}

/// The seed of the bootstrap, fixed so that the same samples give the same intervals.
pub const SEED: u64 = 0x5e_c7_10_05;

/// The ratios of two series that were measured in turns, pair by pair, and for each pair whether
/// one of its measurements was preempted.
pub struct Pairs {
    pub ratios: Vec<f64>,
    pub taken: Vec<bool>,
}

/// The measurements of one contestant, in the order in which they were made.
#[derive(Clone, Copy)]
pub struct Series<'a> {
    pub ticks: &'a [f64],
    /// For each measurement whether it was preempted: whether another thread had the core
    /// meanwhile.
    pub taken: &'a [bool],
}

impl Pairs {
    /// The ratios of one case's runs to another's.
    pub fn of(a: &Runs, b: &Runs) -> Self {
        Pairs::new(Series { ticks: &a.ticks, taken: &a.taken }, Series { ticks: &b.ticks, taken: &b.taken })
    }

    /// The ratios of `a` to `b`.
    pub fn new(a: Series<'_>, b: Series<'_>) -> Self {
        let taken = a.taken.iter().zip(b.taken).map(|(a, b)| *a || *b).collect();
        Pairs { ratios: pairwise_ratios(a.ticks, b.ticks), taken }
    }

    /// Interleaves series: the first ratio of each, then the second of each, and so on.
    pub fn in_turn(series: &[Pairs]) -> Self {
        let places = || 0..series.first().map_or(0, |pairs| pairs.ratios.len());
        let pairs = || places().flat_map(|place| series.iter().map(move |pairs| (pairs, place)));
        Pairs {
            ratios: pairs().map(|(pairs, place)| pairs.ratios[place]).collect(),
            taken: pairs().map(|(pairs, place)| pairs.taken[place]).collect(),
        }
    }

    /// The median ratio with its interval, from the pairs that were not preempted if these are
    /// enough, else from all. Each `together` consecutive ratios come from one process and are not
    /// independent, so that the bootstrap resamples them as one group.
    pub fn estimate(&self, together: usize) -> Estimate {
        let judged = judged(&self.taken);
        let processes = self.ratios.chunks(together).zip(judged.chunks(together));
        let groups: Vec<_> = processes.map(|(ratios, judged)| kept(ratios, judged)).collect();
        let mut rng = Rng::new(SEED);
        let groups = groups.iter().map(Vec::as_slice).filter(|group| !group.is_empty());
        median_with_interval(groups, &mut || rng.next_u64())
    }
}

/// The measurement of one case in one round.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Turn {
    /// TSC cycles.
    pub ticks: u64,
    /// Whether any of the case's runs ended on another core than it began on.
    pub migrated: bool,
    /// Whether every attempt at this measurement was preempted by another thread.
    pub taken: bool,
}

impl Turn {
    /// The turns of a case, one for each round.
    pub fn each(runs: &Runs) -> impl Iterator<Item = Turn> {
        let turn =
            |(ticks, taken): (&f64, &bool)| Turn { ticks: *ticks as u64, migrated: runs.migrations > 0, taken: *taken };
        runs.ticks.iter().zip(&runs.taken).map(turn)
    }
}

/// How many of some measurements were preempted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PreemptedCount {
    /// The number of preempted ones, which are left out if enough others remain.
    pub preempted: usize,
    pub measured: usize,
}

impl PreemptedCount {
    /// Counts the true entries of `taken`, which has an entry for each measurement.
    pub fn among<'a>(taken: impl IntoIterator<Item = &'a bool>) -> Self {
        let add = |all: PreemptedCount, taken: &bool| PreemptedCount {
            preempted: all.preempted + usize::from(*taken),
            measured: all.measured + 1,
        };
        taken.into_iter().fold(PreemptedCount::default(), add)
    }

    /// Whether enough undisturbed measurements remain to judge by.
    pub fn leaves_enough(self) -> bool {
        enough(self.measured - self.preempted, self.measured)
    }
}

/// For each measurement whether to judge by it: the undisturbed ones if these are enough, else all.
pub fn judged(taken: &[bool]) -> Vec<bool> {
    let enough = PreemptedCount::among(taken).leaves_enough();
    taken.iter().map(|taken| !(enough && *taken)).collect()
}

/// The values whose entry in `judged` is true.
pub fn kept<T: Copy>(values: &[T], judged: &[bool]) -> Vec<T> {
    values.iter().zip(judged).filter(|(_, judged)| **judged).map(|(value, _)| *value).collect()
}

#[cfg(all(test, feature = "asm", target_arch = "x86_64"))]
mod tests {
    use super::*;
    use crate::measure::Scripted;
    use rayo::internals::kernels::harness::BROKEN_DOTS;

    #[test]
    fn kernels_that_break_a_rule_or_crash_are_not_timed() {
        let camera = Camera::new(4, 3, 1.0, 1.0).unwrap();
        for (mistake, said) in [("rbx", "rbx is not preserved"), ("instruction", "crashed: SIGILL")] {
            let symbol = format!("rayo_broken_dot_{mistake}");
            let dot = *BROKEN_DOTS.iter().find(|broken| broken.symbol() == symbol).unwrap();
            let case = Case::new(camera, PixelFormat::F32x4, |_, _| {
                std::hint::black_box(dot.call(&Default::default(), &Default::default()));
            });
            // The clock has no ticks to give, so that a timed call would panic.
            let mut clock = Scripted(std::iter::empty());
            let error = Bench::default().time(&mut clock, &[case], 0..1, &mut || true).unwrap_err();
            assert!(error.to_string().contains(said), "{error}");
            assert!(matches!(error, LabError::Kernel(failed) if failed.symbol == symbol));
        }
    }
}
