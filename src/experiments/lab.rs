//! Times cases in turns on one clock, and judges their times: those in which other programs had the core are left out.

use std::cell::RefCell;
use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::kernels::step::Unavailable;
use crate::measure::statistics::{Estimate, median_with_interval, pairwise_ratios};
use crate::measure::{Clock, Runs, Work, enough, interleave};
use crate::render::{Engine, EngineError, Film, FilmMut, NoMemory, PixelFormat, Plan, Purpose, RenderError};
use crate::scene::{Camera, Rng, Scene};

/// Why nothing was measured.
#[derive(Debug, thiserror::Error)]
pub enum LabError {
    #[error(transparent)]
    Engine(#[from] EngineError),
    #[error(transparent)]
    Memory(#[from] NoMemory),
    /// An engine's picture is not that of the reference: its time would mean nothing.
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
        /// Pixels that rounding may turn at an outline.
        allowed: usize,
    },
    #[error(transparent)]
    Threads(#[from] RenderError),
    #[error(transparent)]
    Uncounted(#[from] Unavailable),
    #[error("cannot {what}: {error}")]
    System { what: &'static str, error: std::io::Error },
    #[error("stopped before the first size was finished: there is nothing to show")]
    Nothing,
}

/// Hears how much work has been done since it last heard, in cycles of some machine or other: the shares are what
/// matters. Where it says no, what is being measured ends, and what is finished is the result.
pub type Progress<'a> = dyn FnMut(u64) -> bool + 'a;

/// What is timed of a picture.
#[derive(Clone, Copy)]
pub enum Timed {
    /// From a tracer that is ready to the last pixel.
    Tracing,
    /// From the parsed scene to the tracer.
    SetUp,
    Both,
}

/// Traces rows into a film of their size.
type Trace<'a> = Box<dyn Fn(Range<u32>, FilmMut<'_>) + 'a>;

/// A picture to be timed: its camera, the format of its pixels, and the function that traces its rows.
pub struct Case<'a> {
    camera: Camera,
    pub output: PixelFormat,
    trace: Trace<'a>,
}

impl<'a> Case<'a> {
    pub fn new(camera: Camera, output: PixelFormat, trace: impl Fn(Range<u32>, FilmMut<'_>) + 'a) -> Self {
        Case { camera, output, trace: Box::new(trace) }
    }

    /// A case of an engine on a scene.
    ///
    /// # Errors
    /// A scene that it does not trace.
    pub fn of(
        timed: Timed,
        scene: &'a Scene,
        engine: Engine,
        purpose: Purpose,
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

    /// Traces rows into a film of their size.
    pub fn rows(&self, rows: Range<u32>, film: FilmMut<'_>) {
        (self.trace)(rows, film);
    }

    /// Traces the whole picture.
    pub fn trace(&self, film: &mut Film) {
        (self.trace)(0..self.camera.height(), film.as_mut().part(0..self.camera.pixels() as usize));
    }
}

/// One film for each pixel format, shared by all cases. Its memory has been touched before, so that every case finds it in
/// the same state.
#[derive(Default)]
pub struct Bench {
    films: Vec<(PixelFormat, Film)>,
    is_warm: bool,
}

impl Bench {
    /// Times each of the cases once in each of the rounds, in turns; the first time that the bench is used, all trace once
    /// before, since nobody is to pay for what happens once. None where `proceed` says no, which is asked after each round.
    ///
    /// # Errors
    /// No memory for the largest picture.
    pub fn time(
        &mut self,
        clock: &mut dyn Clock,
        cases: &[Case<'_>],
        rounds: Range<usize>,
        proceed: &mut dyn FnMut() -> bool,
    ) -> Result<Option<Vec<Runs>>, NoMemory> {
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
            works.iter_mut().for_each(|work| work());
        }
        Ok(interleave(clock, &mut works, rounds, proceed))
    }
}

/// Where the bootstrap's draws begin: the same samples give the same intervals.
const SEED: u64 = 0x5e_c7_10_05;

/// The ratios of two series that were measured in turns, pair by pair, and whether others had the core in either.
pub struct Pairs {
    pub ratios: Vec<f64>,
    pub taken: Vec<bool>,
}

impl Pairs {
    /// The ratios of one case's runs to another's.
    pub fn of(a: &Runs, b: &Runs) -> Self {
        Pairs::new((&a.ticks, &a.taken), (&b.ticks, &b.taken))
    }

    /// The same from the ticks of each series, and whether others had the core.
    pub fn new(a: (&[f64], &[bool]), b: (&[f64], &[bool])) -> Self {
        Pairs { ratios: pairwise_ratios(a.0, b.0), taken: a.1.iter().zip(b.1).map(|(a, b)| *a || *b).collect() }
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

    /// The median of those to judge by, with its interval: so many of them, one after the other, were measured in one
    /// process, and so are drawn together.
    pub fn estimate(&self, together: usize) -> Estimate {
        let judged = judged(&self.taken);
        let processes = self.ratios.chunks(together).zip(judged.chunks(together));
        let groups: Vec<_> = processes.map(|(ratios, judged)| kept(ratios, judged)).collect();
        let mut rng = Rng::new(SEED);
        let groups = groups.iter().map(Vec::as_slice).filter(|group| !group.is_empty());
        median_with_interval(groups, &mut || rng.next_u64())
    }
}

/// A case's picture in one round.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Turn {
    /// TSC cycles.
    pub ticks: u64,
    /// Whether it ended on another core than it began on.
    pub migrated: bool,
    /// Whether others had the core, each time it was tried.
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

/// How many of some measurements were disturbed: others had the core.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Taken {
    /// The disturbed ones, which are left out if enough others remain.
    pub taken: usize,
    pub of: usize,
}

impl Taken {
    /// Counts them.
    pub fn among<'a>(taken: impl IntoIterator<Item = &'a bool>) -> Self {
        let add = |all: Taken, taken: &bool| Taken { taken: all.taken + usize::from(*taken), of: all.of + 1 };
        taken.into_iter().fold(Taken::default(), add)
    }

    /// Whether enough remain to judge by.
    pub fn leaves_enough(self) -> bool {
        enough(self.of - self.taken, self.of)
    }
}

/// Which measurements to judge by: the undisturbed ones if there are enough of them, else all.
pub fn judged(taken: &[bool]) -> Vec<bool> {
    let enough = Taken::among(taken).leaves_enough();
    taken.iter().map(|taken| !(enough && *taken)).collect()
}

/// The values to judge by.
pub fn kept<T: Copy>(values: &[T], judged: &[bool]) -> Vec<T> {
    values.iter().zip(judged).filter(|(_, judged)| **judged).map(|(value, _)| *value).collect()
}
