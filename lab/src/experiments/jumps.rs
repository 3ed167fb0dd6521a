//! The two jumps of the paper's Figure 2: what the time per pixel depends on.
//!
//! The paper blames the cache. Two other causes would look the same in its data: a core that slows
//! down while the time-stamp counter goes on at its constant rate, and the cost of memory pages
//! that are touched for the first time. Both are recorded beside every run.

use std::hint::black_box;

use serde::{Deserialize, Serialize};

use super::check;
use super::in_size;
use super::lab::{LabError, Progress};
use super::speedup::{self, BASELINE, CONTROL};
use super::verdict::Verdict;
use crate::measure::Name;
use crate::measure::statistics::{Estimate, maximum, median, minimum};
use crate::measure::{Clock, Machine, Work, core_cycles_per_tick, interleave};
use rayo::internals::kernels::{Cache, Vec4, sys};
use rayo::internals::render::{Engine, Film, FilmMut, PixelFormat};

/// Sizes from 0.02 to 16 Mpixel, all 4:3; a quick run takes every third.
const SIZES: [(u32, u32); 13] = [
    (164, 123),
    (260, 195),
    (365, 273),
    (516, 387),
    (730, 547),
    (816, 612),
    (966, 724),
    (1095, 821),
    (1633, 1225),
    (2309, 1732),
    (2828, 2121),
    (3640, 2730),
    (4619, 3464),
];
/// The number of runs of each size, each with a touched and with an untouched framebuffer.
const RUNS: usize = 5;
const QUICK_RUNS: usize = 3;
/// The work of a round per pixel, in the unit of [`Progress`]: that of all engines, with a touched
/// and with an untouched framebuffer.
const ROUND_WORK: u64 = 270;
/// A run is repeated once if other programs had the core for more than this share of its time; not
/// more often, because runs of the largest size are long. If they still had it for more than
/// `MUCH_TAKEN`, they have evicted the caches too, and there is no verdict.
const TAKEN: f64 = 0.01;
const AGAIN: usize = 1;
const MUCH_TAKEN: f64 = 0.05;
/// A change smaller than this share does not count as a jump.
const STEADY: f64 = 0.10;
/// An engine that writes at less than this share of a level's bandwidth is not limited by it.
pub const BOUND: f64 = 0.5;

/// The time of an engine at a size. The field names are those of the JSON document.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct PictureTime {
    pub width: u32,
    pub height: u32,
    pub pixels: u64,
    pub engine: Name,
    /// Whether the pages of the framebuffer had been written to before.
    pub touched: bool,
    /// TSC cycles per pixel in the fastest run: among the undisturbed runs the one that took least
    /// time. Without any, it is the run that other programs disturbed for the smallest share of its
    /// time.
    pub cycles_per_pixel: f64,
    /// The median TSC cycles per pixel over all runs.
    pub cycles_per_pixel_median: f64,
    /// Cycles of the core's clock per TSC tick, measured right before and after the fastest run.
    pub clock_per_tick: f64,
    /// The share of the fastest run's time in which other programs had the core.
    pub taken_share: Option<f64>,
    /// Cycles of the core's own clock per pixel in the fastest run, while this thread had the core.
    pub core_cycles_per_pixel: f64,
    /// The median number of page faults of a picture.
    pub page_faults: f64,
    /// Bytes of the framebuffer written per TSC cycle in the fastest run, while this thread had the
    /// core.
    pub bytes_per_cycle: f64,
    /// The undisturbed runs, or all runs if other programs had the core in each.
    #[serde(default)]
    pub samples: Vec<PictureRun>,
}

/// One run of a [`PictureTime`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub struct PictureRun {
    /// Cycles of the core's own clock per pixel, while this thread had the core.
    pub core_cycles_per_pixel: f64,
    /// Bytes of the framebuffer written per TSC cycle, while this thread had the core.
    pub bytes_per_cycle: f64,
}

/// How fast plain stores to a level of memory are.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Bandwidth {
    /// `L1`, `L2`, `L3` or `memory`.
    pub level: String,
    /// The size of the memory that is written over and over, in bytes.
    pub bytes: usize,
    /// The rate of the fastest pass, in bytes per TSC cycle.
    pub bytes_per_cycle: f64,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Jumps {
    /// Each engine at each size, with a touched and with an untouched framebuffer.
    pub rows: Vec<PictureTime>,
    pub bandwidth: Vec<Bandwidth>,
}

fn sizes(quick: bool) -> Vec<(u32, u32)> {
    SIZES.into_iter().step_by(if quick { 3 } else { 1 }).collect()
}

fn runs(quick: bool) -> usize {
    if quick { QUICK_RUNS } else { RUNS }
}

/// The work that [`run`] does, in the unit of [`Progress`].
pub fn work(quick: bool) -> u64 {
    let pixels: u64 = sizes(quick).iter().map(|(width, height)| u64::from(*width) * u64::from(*height)).sum();
    pixels * runs(quick) as u64 * ROUND_WORK
}

/// What is recorded beside the times of a case's runs. Each list has an entry for every run.
#[derive(Default)]
struct PerRun {
    clock: Vec<f64>,
    faults: Vec<f64>,
    ticks: Vec<f64>,
    /// Ticks during which this thread had the core.
    own: Vec<f64>,
}

impl PerRun {
    fn run(&self, run: usize, pixels: u64) -> PictureRun {
        PictureRun {
            core_cycles_per_pixel: self.clock[run] * self.own[run] / pixels as f64,
            bytes_per_cycle: pixels as f64 * PixelFormat::F32x4.bytes() as f64 / self.own[run],
        }
    }

    /// The share of a run's time in which other programs had the core; a share of up to [`TAKEN`]
    /// counts as 0.
    fn taken(&self, run: usize) -> f64 {
        let share = 1.0 - self.own[run] / self.ticks[run];
        if share <= TAKEN { 0.0 } else { share }
    }

    /// The undisturbed runs, or all runs if other programs had the core in each.
    fn undisturbed(&self) -> Vec<usize> {
        let all = 0..self.own.len();
        let undisturbed: Vec<_> = all.clone().filter(|run| self.taken(*run) == 0.0).collect();
        if undisturbed.is_empty() { all.collect() } else { undisturbed }
    }

    /// The fastest of the undisturbed runs. If there are none, the run that other programs
    /// disturbed for the smallest share of its time.
    fn least_taken(&self) -> usize {
        let rank = |run: &usize| (self.taken(*run), self.own[*run]);
        (0..self.own.len())
            .min_by(|a, b| rank(a).partial_cmp(&rank(b)).expect("times are numbers"))
            .expect("there is a run")
    }
}

/// An engine at a size, with a touched or an untouched framebuffer, and what was recorded of its
/// runs.
struct Contestant {
    engine: Engine,
    touched: bool,
    beside: PerRun,
}

impl Contestant {
    /// The contestant's row, from what was recorded beside its runs.
    fn picture_time(&self, width: u32, height: u32, machine: &Machine) -> PictureTime {
        let Contestant { engine, touched, beside } = self;
        let pixels = u64::from(width) * u64::from(height);
        let fastest = beside.least_taken();
        let (own, ticks) = (beside.own[fastest], beside.ticks[fastest]);
        let PictureRun { core_cycles_per_pixel, bytes_per_cycle } = beside.run(fastest, pixels);
        PictureTime {
            width,
            height,
            pixels,
            engine: engine.name().into(),
            touched: *touched,
            cycles_per_pixel: ticks / pixels as f64,
            cycles_per_pixel_median: median(&beside.ticks) / pixels as f64,
            clock_per_tick: beside.clock[fastest],
            taken_share: machine.tsc_hz.map(|_| 1.0 - own / ticks),
            core_cycles_per_pixel,
            page_faults: median(&beside.faults),
            bytes_per_cycle,
            samples: beside.undisturbed().into_iter().map(|run| beside.run(run, pixels)).collect(),
        }
    }
}

/// Measures every engine at every size. None if `proceed` returns false.
pub fn run(
    quick: bool,
    machine: &Machine,
    clock: &mut dyn Clock,
    proceed: &mut Progress<'_>,
) -> Result<Option<Jumps>, LabError> {
    let scene = speedup::scene();
    let engines = speedup::baseline_and_control();
    let bandwidth = bandwidth(&machine.caches, BANDWIDTH_RUNS, clock, |pixels, pass| {
        pixels.fill(Vec4::new(pass as f32, 0.0, 1.0));
    })?;
    let mut rows = Vec::new();
    for (width, height) in sizes(quick) {
        let scene = in_size(&scene, width, height);
        let pixels = scene.camera.pixels();
        let mut film = Film::new(PixelFormat::F32x4, pixels as usize)?;
        let mut contestants = Vec::new();
        for engine in engines {
            contestants.extend([true, false].map(|touched| Contestant { engine, touched, beside: PerRun::default() }));
        }
        let tracers = contestants.iter().map(|contestant| contestant.engine.prepare(None, &scene));
        let tracers = tracers.collect::<Result<Vec<_>, _>>()?;
        let middle = height / 2..height / 2 + 1;
        for tracer in &tracers {
            let row = film.as_mut().part(0..width as usize);
            check::kernels_in(|| tracer.rows(middle.clone(), row))?;
        }
        for _ in 0..runs(quick) {
            for (Contestant { touched, beside, .. }, tracer) in contestants.iter_mut().zip(&tracers) {
                for _ in 0..=AGAIN {
                    // A page is untouched only until its first write, so that every run needs new
                    // memory.
                    let mut fresh = if *touched { None } else { Some(fresh(pixels as usize)?) };
                    let before = core_cycles_per_tick();
                    let (faults, cpu) = (sys::Usage::of_this_thread().page_faults, sys::thread_cpu_time());
                    let ticks = clock.time(&mut || {
                        let out = match &mut fresh {
                            Some(fresh) => FilmMut::F32x4(fresh.as_mut_slice()),
                            None => film.as_mut(),
                        };
                        tracer.rows(0..height, out);
                    }) as f64;
                    let cpu = (sys::thread_cpu_time() - cpu).as_secs_f64();
                    let own = machine.tsc_hz.map_or(ticks, |hz| (cpu * hz).min(ticks));
                    beside.faults.push((sys::Usage::of_this_thread().page_faults - faults) as f64);
                    beside.ticks.push(ticks);
                    beside.own.push(own);
                    beside.clock.push((before + core_cycles_per_tick()) / 2.0);
                    if ticks - own <= TAKEN * ticks {
                        break;
                    }
                }
            }
            if !proceed(pixels * ROUND_WORK) {
                return Ok(None);
            }
        }
        rows.extend(contestants.iter().map(|contestant| contestant.picture_time(width, height, machine)));
    }
    Ok(Some(Jumps { rows, bandwidth }))
}

fn fresh(pixels: usize) -> Result<sys::FreshPages<Vec4>, LabError> {
    sys::FreshPages::new(pixels).map_err(|error| LabError::System { what: "map memory for a fresh framebuffer", error })
}

/// A level of memory.
struct MemoryLevel {
    name: String,
    /// How many bytes to write over and over so that they stay in this level.
    bytes: usize,
}

/// The levels of memory. Half of each cache is written and, to reach memory, four times the last
/// cache.
fn levels_of(caches: &[Cache]) -> impl Iterator<Item = MemoryLevel> {
    let levels = caches.iter().map(|cache| MemoryLevel { name: format!("L{}", cache.level), bytes: cache.bytes / 2 });
    let memory =
        caches.last().map(|cache| MemoryLevel { name: "memory".to_owned(), bytes: (4 * cache.bytes).min(MOST_MEMORY) });
    levels.chain(memory)
}

/// The rate at which each level of memory takes stores. `fill` writes the pixels that it is given;
/// its second argument is the number of the pass.
pub(super) fn bandwidth(
    caches: &[Cache],
    runs: usize,
    clock: &mut dyn Clock,
    mut fill: impl FnMut(&mut [Vec4], usize),
) -> Result<Vec<Bandwidth>, LabError> {
    let of_level = |MemoryLevel { name: level, bytes }: MemoryLevel| {
        let len = bytes / size_of::<Vec4>();
        let mut film = Film::new(PixelFormat::F32x4, len + LINE / size_of::<Vec4>())?;
        let Film::F32x4(pixels) = &mut film else { unreachable!("it was made of floats") };
        // The pixels begin at a cache line. Stores that cross lines at both ends of a pass would
        // slow down the shortest passes, those within the first-level cache.
        let first = pixels.as_ptr().align_offset(LINE);
        let pixels = &mut pixels[first..first + len];
        // Small levels are written so many times per measurement that reading the clock takes a
        // negligible part of the time.
        let passes = (MIN_BYTES / bytes).max(1);
        let mut pass = |pass| fill(black_box(&mut *pixels), pass);
        let mut work: [Work<'_>; 1] = [Box::new(|| (0..passes).for_each(&mut pass))];
        let runs = interleave(clock, &mut work, 0..runs, &mut || true).expect("nobody stops it");
        let bytes = len * size_of::<Vec4>();
        Ok(Bandwidth { level, bytes, bytes_per_cycle: (bytes * passes) as f64 / minimum(&runs[0].ticks) })
    };
    levels_of(caches).map(of_level).collect()
}

/// Bytes of a cache line.
const LINE: usize = 64;
/// The largest size that is written to measure memory, in bytes.
const MOST_MEMORY: usize = 256 << 20;
/// The least number of bytes that is written between two readings of the clock.
const MIN_BYTES: usize = 4 << 20;
const BANDWIDTH_RUNS: usize = 5;

/// What the measurement shows about one engine.
#[derive(Clone, Debug, Serialize)]
pub struct Finding {
    pub engine: &'static str,
    /// By how much the TSC cycles per pixel change with the size of a touched framebuffer: the
    /// largest divided by the smallest, minus 1.
    pub change: f64,
    /// The same change in cycles of the core's own clock.
    pub core_change: f64,
    /// The change of the core's clock per TSC tick between sizes, computed alike.
    pub clock_change: f64,
    /// The highest rate at which the engine writes, as a share of the bandwidth of the slowest
    /// level.
    pub bandwidth_share: Option<f64>,
    /// TSC cycles per page fault: the time that an untouched framebuffer adds at the largest size,
    /// divided by the number of its page faults.
    pub cycles_per_fault: Option<f64>,
    /// The time that an untouched framebuffer adds at the largest size, in TSC cycles per pixel.
    pub fault_cycles_per_pixel: f64,
}

impl Jumps {
    fn of(&self, engine: &str, touched: bool) -> Vec<&PictureTime> {
        self.rows.iter().filter(|row| row.engine == engine && row.touched == touched).collect()
    }

    /// Why the cause of jumps cannot be determined, if other programs had the core for too long.
    pub fn disturbed(&self) -> Option<String> {
        let most = self.rows.iter().filter_map(|row| row.taken_share).fold(0.0, f64::max);
        let why = || format!("others had the core for up to {:.0} % of the pictures of the jumps", 100.0 * most);
        (most > MUCH_TAKEN).then(why)
    }

    /// The findings, engine by engine.
    pub fn findings(&self) -> Vec<Finding> {
        [BASELINE, CONTROL].into_iter().filter_map(|engine| self.finding(engine)).collect()
    }

    /// The finding about an engine; None if it was not measured.
    fn finding(&self, engine: &'static str) -> Option<Finding> {
        let (touched, untouched) = (self.of(engine, true), self.of(engine, false));
        let change = |of: fn(&PictureTime) -> f64| {
            let values = || touched.iter().map(|row| of(row));
            values().fold(0.0, f64::max) / values().fold(f64::INFINITY, f64::min) - 1.0
        };
        let fastest = touched.iter().map(|row| row.bytes_per_cycle).fold(0.0, f64::max);
        let (last, fresh) = (touched.last()?, untouched.last()?);
        let own = |row: &PictureTime| row.core_cycles_per_pixel / row.clock_per_tick;
        let more = own(fresh) - own(last);
        let faults = fresh.page_faults - last.page_faults;
        Some(Finding {
            engine,
            change: change(|row| row.cycles_per_pixel),
            core_change: change(|row| row.core_cycles_per_pixel),
            clock_change: change(|row| row.clock_per_tick),
            bandwidth_share: self.slowest_level().map(|slowest| fastest / slowest),
            cycles_per_fault: (faults > 0.0).then(|| more * last.pixels as f64 / faults),
            fault_cycles_per_pixel: more,
        })
    }

    /// The bandwidth of the slowest level of memory.
    fn slowest_level(&self) -> Option<f64> {
        self.bandwidth.iter().map(|level| level.bytes_per_cycle).reduce(f64::min)
    }

    /// The largest ratio between two sizes of the core's own cycles per pixel, minus 1, with
    /// touched framebuffers. The ends of its interval take the runs of each size once as close
    /// together as possible, and once as far apart.
    fn core_change(&self, engine: &str) -> Estimate {
        let rows = self.of(engine, true);
        let cycles = |row: &PictureTime| row.samples.iter().map(|run| run.core_cycles_per_pixel).collect::<Vec<_>>();
        let [fastest, slowest] =
            [minimum, maximum].map(|end| rows.iter().map(|row| end(&cycles(row))).collect::<Vec<_>>());
        let counted: Vec<_> = rows.iter().map(|row| row.core_cycles_per_pixel).collect();
        Estimate {
            value: maximum(&counted) / minimum(&counted) - 1.0,
            low: (maximum(&fastest) / minimum(&slowest) - 1.0).max(0.0),
            high: maximum(&slowest) / minimum(&fastest) - 1.0,
        }
    }

    /// The highest rate at which an engine writes at any size, as a share of the bandwidth of the
    /// slowest level. The interval goes from the slowest runs of each size to the fastest.
    fn share_of_bandwidth(&self, engine: &str) -> Option<Estimate> {
        let slowest_level = self.slowest_level()?;
        let rows = self.of(engine, true);
        let bytes = |row: &PictureTime| row.samples.iter().map(|run| run.bytes_per_cycle).collect::<Vec<_>>();
        let most =
            |of: &dyn Fn(&PictureTime) -> f64| rows.iter().map(|row| of(row)).fold(0.0, f64::max) / slowest_level;
        Some(Estimate {
            value: most(&|row| row.bytes_per_cycle),
            low: most(&|row| minimum(&bytes(row))),
            high: most(&|row| maximum(&bytes(row))),
        })
    }

    /// The verdict on the claim that the cache makes the time per pixel jump. The claim holds if an
    /// engine's core cycles jump and it writes at a rate that memory limits.
    pub fn are_the_cache(&self) -> Verdict {
        let of_engine = |engine: &'static str| {
            let jumps = Verdict::at_least(self.core_change(engine), STEADY);
            let is_bound =
                self.share_of_bandwidth(engine).map_or(Verdict::NotReproduced, |share| Verdict::at_least(share, BOUND));
            jumps.and(is_bound)
        };
        [BASELINE, CONTROL].into_iter().map(of_engine).fold(Verdict::NotReproduced, Verdict::or)
    }

    /// The figures on which the verdict of `are_the_cache` rests, in words.
    pub fn figures(&self) -> String {
        let percent =
            |of: Estimate| format!("{:.0} [{:.0}, {:.0}] %", 100.0 * of.value, 100.0 * of.low, 100.0 * of.high);
        let of_engine = |finding: &Finding| {
            let share = self.share_of_bandwidth(finding.engine);
            format!(
                "`{}`: cycles a pixel differ by {:.0} % over all sizes, by {} in cycles of the core's clock; \
                writes at most {} of the slowest level's bandwidth",
                finding.engine,
                100.0 * finding.change,
                percent(self.core_change(finding.engine)),
                share.map_or("?".into(), percent),
            )
        };
        self.findings().iter().map(of_engine).collect::<Vec<_>>().join("; ")
    }
}
