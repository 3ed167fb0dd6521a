//! The two jumps of the paper's Figure 2: what the time per pixel depends on, from small pictures to large ones.
//!
//! The paper blames the cache. Other causes would look alike in its data: a core that slows down while the time-stamp
//! counter goes on at its constant rate, and pages that are given out on first touch. Each is measured beside every run.

use std::hint::black_box;

use serde::{Deserialize, Serialize};

use super::in_size;
use super::lab::{LabError, Progress};
use super::speedup::{self, BASELINE, CONTROL};
use crate::kernels::{Vec4, sys};
use crate::measure::Name;
use crate::measure::statistics::{median, minimum};
use crate::measure::{Cache, Clock, Machine, Work, core_cycles_per_tick, interleave};
use crate::render::{Film, FilmMut, PixelFormat};

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
/// Runs of each size and kind.
const RUNS: usize = 5;
const QUICK_RUNS: usize = 2;
/// What a pixel of every contestant costs, touched and not.
const ROUND_WORK: u64 = 270;
/// A run in which others had the core for more than this share of it is made once more, the largest being long; where they
/// still have it for more than a few of these, they have the caches too.
const TAKEN: f64 = 0.01;
const AGAIN: usize = 1;
const MUCH_TAKEN: f64 = 0.05;
/// A change of less than this is none.
const STEADY: f64 = 0.10;
/// What writes less than this share of a bandwidth is not bound by it.
pub const BOUND: f64 = 0.5;

/// An engine at a size. The field names are those of the JSON document.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct PictureTime {
    pub width: u32,
    pub height: u32,
    pub pixels: u64,
    pub engine: Name,
    /// Whether the framebuffer had been touched before.
    pub touched: bool,
    /// TSC cycles of a pixel in the fastest run: of those in which nobody else had the core, if there are any, the one that had
    /// it for the shortest time.
    pub cycles_per_pixel: f64,
    /// Their median over all runs.
    pub cycles_per_pixel_median: f64,
    /// The core's clock cycles in a tick of the TSC, right before and after the fastest run.
    pub clock_per_tick: f64,
    /// The part of that run in which other programs had the core.
    pub taken_share: Option<f64>,
    /// Cycles of the core's own clock that it gave to a pixel, in that run.
    pub core_cycles_per_pixel: f64,
    /// Median page faults of a picture.
    pub page_faults: f64,
    /// Bytes of the framebuffer written in a TSC cycle in which the thread had the core, in that run.
    pub bytes_per_cycle: f64,
}

/// How fast a level of memory takes plain stores.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Bandwidth {
    /// `L1`, `L2`, `L3` or `memory`.
    pub level: String,
    /// The bytes written over and over.
    pub bytes: usize,
    /// The fastest of all passes, in bytes a TSC cycle.
    pub bytes_per_cycle: f64,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Jumps {
    /// Each engine at each size, touched and untouched.
    pub rows: Vec<PictureTime>,
    pub bandwidth: Vec<Bandwidth>,
}

fn sizes(quick: bool) -> Vec<(u32, u32)> {
    SIZES.into_iter().step_by(if quick { 3 } else { 1 }).collect()
}

fn runs(quick: bool) -> usize {
    if quick { QUICK_RUNS } else { RUNS }
}

/// The work that [`run`] does.
pub fn work(quick: bool) -> u64 {
    let pixels: u64 = sizes(quick).iter().map(|(width, height)| u64::from(*width) * u64::from(*height)).sum();
    pixels * runs(quick) as u64 * ROUND_WORK
}

/// What is recorded of one run beside its ticks.
#[derive(Default)]
struct Beside {
    clock: Vec<f64>,
    faults: Vec<f64>,
    ticks: Vec<f64>,
    /// Ticks in which this thread had the core.
    own: Vec<f64>,
}

impl Beside {
    /// The fastest of the runs that others had the core for the least of, within [`TAKEN`].
    fn least_taken(&self) -> usize {
        let taken = |run: &usize| {
            let share = 1.0 - self.own[*run] / self.ticks[*run];
            (if share <= TAKEN { 0.0 } else { share }, self.own[*run])
        };
        (0..self.own.len())
            .min_by(|a, b| taken(a).partial_cmp(&taken(b)).expect("times are numbers"))
            .expect("there is a run")
    }
}

/// Measures. None where `proceed` says no.
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
            contestants.extend([true, false].map(|touched| (engine, touched, Beside::default())));
        }
        let tracers = contestants.iter().map(|(engine, ..)| engine.prepare(None, &scene));
        let tracers = tracers.collect::<Result<Vec<_>, _>>()?;
        for _ in 0..runs(quick) {
            for ((_, touched, beside), tracer) in contestants.iter_mut().zip(&tracers) {
                for _ in 0..=AGAIN {
                    // Pages are untouched once.
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
        rows.extend(contestants.iter().map(|(engine, touched, beside)| {
            let fastest = beside.least_taken();
            let (own, ticks) = (beside.own[fastest], beside.ticks[fastest]);
            let clock_per_tick = beside.clock[fastest];
            PictureTime {
                width,
                height,
                pixels,
                engine: engine.name().into(),
                touched: *touched,
                cycles_per_pixel: ticks / pixels as f64,
                cycles_per_pixel_median: median(&beside.ticks) / pixels as f64,
                clock_per_tick,
                taken_share: machine.tsc_hz.map(|_| 1.0 - own / ticks),
                core_cycles_per_pixel: clock_per_tick * own / pixels as f64,
                page_faults: median(&beside.faults),
                bytes_per_cycle: pixels as f64 * PixelFormat::F32x4.bytes() as f64 / own,
            }
        }));
    }
    Ok(Some(Jumps { rows, bandwidth }))
}

fn fresh(pixels: usize) -> Result<sys::Fresh<Vec4>, LabError> {
    sys::Fresh::new(pixels).map_err(|error| LabError::System { what: "map memory for a fresh framebuffer", error })
}

/// Half of each level of cache, and four times the last: its name, and bytes.
fn levels_of(caches: &[Cache]) -> impl Iterator<Item = (String, usize)> {
    let levels = caches.iter().map(|cache| (format!("L{}", cache.level), cache.bytes / 2));
    let memory = caches.last().map(|cache| ("memory".to_owned(), (4 * cache.bytes).min(MOST_MEMORY)));
    levels.chain(memory)
}

/// What each level takes of stores: `fill` is told the pixels, and the number of the pass.
pub(super) fn bandwidth(
    caches: &[Cache],
    runs: usize,
    clock: &mut dyn Clock,
    mut fill: impl FnMut(&mut [Vec4], usize),
) -> Result<Vec<Bandwidth>, LabError> {
    let of_level = |(level, bytes): (String, usize)| {
        let len = bytes / size_of::<Vec4>();
        let mut film = Film::new(PixelFormat::F32x4, len + LINE / size_of::<Vec4>())?;
        let Film::F32x4(pixels) = &mut film else { unreachable!("it was made of floats") };
        // Stores that cross lines at both ends of a pass would show in the shortest, those of the first level.
        let first = pixels.as_ptr().align_offset(LINE);
        let pixels = &mut pixels[first..first + len];
        // Small levels are gone over so often that the clock's own time does not show.
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
/// Four times the last cache, but not more than this.
const MOST_MEMORY: usize = 256 << 20;
/// The least that is written between two looks at the clock.
const MIN_BYTES: usize = 4 << 20;
const BANDWIDTH_RUNS: usize = 5;

/// What the sweep shows of one engine.
#[derive(Clone, Debug, Serialize)]
pub struct Finding {
    pub engine: &'static str,
    /// The most cycles by the pixel of any size over the fewest, less 1: touched framebuffers, TSC cycles.
    pub change: f64,
    /// The same in cycles of the core's own clock.
    pub core_change: f64,
    /// The same of the core's clock by tick.
    pub clock_change: f64,
    /// The most that it writes, as a share of the bandwidth of the slowest level.
    pub bandwidth_share: Option<f64>,
    /// TSC cycles that a page fault costs: what untouched framebuffers cost more at the largest size.
    pub cycles_per_fault: Option<f64>,
    /// The same by the pixel.
    pub fault_cycles_per_pixel: f64,
}

impl Jumps {
    fn of(&self, engine: &str, touched: bool) -> Vec<&PictureTime> {
        self.rows.iter().filter(|row| row.engine == engine && row.touched == touched).collect()
    }

    /// Why no cause of jumps can be told, where others had the core.
    pub fn disturbed(&self) -> Option<String> {
        let most = self.rows.iter().filter_map(|row| row.taken_share).fold(0.0, f64::max);
        let why = || format!("others had the core for up to {:.0} % of the pictures of the jumps", 100.0 * most);
        (most > MUCH_TAKEN).then(why)
    }

    /// What explains the time, engine by engine.
    pub fn findings(&self) -> Vec<Finding> {
        let slowest = self.bandwidth.iter().map(|level| level.bytes_per_cycle).reduce(f64::min);
        let finding = |engine| {
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
                bandwidth_share: slowest.map(|slowest| fastest / slowest),
                cycles_per_fault: (faults > 0.0).then(|| more * last.pixels as f64 / faults),
                fault_cycles_per_pixel: more,
            })
        };
        [BASELINE, CONTROL].into_iter().filter_map(finding).collect()
    }

    /// Whether the cache makes the time by the pixel jump here, and the figures that say so. None where it jumps, and
    /// noise alone could make it: an engine comes out `noise_floor` apart from itself.
    pub fn cache_jumps(&self, noise_floor: f64) -> (Option<bool>, String) {
        let findings = self.findings();
        let jumps = |finding: &&Finding| finding.core_change > STEADY;
        let bound = |finding: &Finding| finding.bandwidth_share.is_some_and(|share| share > BOUND);
        let jumping: Vec<_> = findings.iter().filter(jumps).collect();
        let verdict = if jumping.is_empty() {
            Some(false)
        } else if noise_floor > STEADY {
            None
        } else {
            Some(jumping.into_iter().any(bound))
        };
        let figures: Vec<_> = findings
            .iter()
            .map(|finding| {
                let share = |share: Option<f64>| share.map_or("?".into(), |share| format!("{:.0} %", 100.0 * share));
                format!(
                    "`{}`: cycles a pixel differ by {:.0} % over all sizes, by {} in cycles of the core's clock; \
                    writes at most {} of the slowest level's bandwidth",
                    finding.engine,
                    100.0 * finding.change,
                    share(Some(finding.core_change)),
                    share(finding.bandwidth_share),
                )
            })
            .collect();
        (verdict, figures.join("; "))
    }
}
