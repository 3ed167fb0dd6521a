//! The times of section 5 of the paper, measured again: `c` compared with `paper` and with every
//! other engine, at twenty sizes.

use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::accuracy::subjects::shipped;
use super::check;
use super::in_size;
use super::lab::{Bench, Case, LabError, Pairs, PreemptedCount, Timed, Turn, judged, kept};
use crate::measure::statistics::{self, Estimate, mean, median, minimum};
use crate::measure::{Clock, Name, Runs};
use rayo::internals::render::reference::ReferenceTracer;
use rayo::internals::render::{Engine, EngineError, Film, PixelFormat, Purpose, Tracer};
use rayo::internals::scene::Scene;

/// A row of the paper's table of times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperRow {
    /// Width in pixels; every size is 4:3.
    pub width: u32,
    pub height: u32,
    /// Mean TSC cycles of the paper's C on an i7-4510U.
    pub c: f64,
    /// Mean TSC cycles of the paper's SIMD.
    pub simd: f64,
}

impl PaperRow {
    pub fn pixels(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }

    /// The ratio C/SIMD.
    pub fn ratio(&self) -> f64 {
        self.c / self.simd
    }
}

/// The paper's table.
#[rustfmt::skip]
pub const PAPER: [PaperRow; 20] = [
    PaperRow { width:  365, height:  273, c:   47_412_965.40, simd:   7_458_009.60 },
    PaperRow { width:  516, height:  387, c:  101_101_387.08, simd:  14_760_852.94 },
    PaperRow { width:  632, height:  474, c:  139_660_581.06, simd:  22_901_589.62 },
    PaperRow { width:  730, height:  547, c:  183_821_009.30, simd:  29_576_126.24 },
    PaperRow { width:  816, height:  612, c:  230_551_223.58, simd:  37_123_983.44 },
    PaperRow { width:  894, height:  670, c:  434_228_563.54, simd:  70_736_674.38 },
    PaperRow { width:  966, height:  724, c:  508_383_989.28, simd:  81_353_151.38 },
    PaperRow { width: 1032, height:  774, c:  582_486_590.68, simd:  94_119_090.62 },
    PaperRow { width: 1095, height:  821, c: 1_545_718_116.28, simd: 242_396_510.46 },
    PaperRow { width: 1154, height:  866, c: 1_715_182_797.38, simd: 269_795_128.46 },
    PaperRow { width: 1211, height:  908, c: 1_887_044_517.02, simd: 296_972_078.78 },
    PaperRow { width: 1264, height:  948, c: 2_059_100_630.34, simd: 323_324_739.40 },
    PaperRow { width: 1316, height:  987, c: 2_229_584_118.58, simd: 350_339_094.04 },
    PaperRow { width: 1366, height: 1024, c: 2_399_859_498.14, simd: 377_197_091.18 },
    PaperRow { width: 1414, height: 1060, c: 2_569_943_753.52, simd: 404_182_225.46 },
    PaperRow { width: 1460, height: 1095, c: 2_748_590_124.28, simd: 430_763_849.88 },
    PaperRow { width: 1505, height: 1129, c: 2_919_986_197.18, simd: 458_490_048.64 },
    PaperRow { width: 1549, height: 1161, c: 3_115_715_808.92, simd: 484_714_280.96 },
    PaperRow { width: 1591, height: 1193, c: 3_294_098_954.12, simd: 511_512_759.16 },
    PaperRow { width: 1632, height: 1224, c: 3_445_162_034.08, simd: 538_688_063.42 },
];

/// The five sizes of a quick run, as indices into [`PAPER`]: the smallest, the largest, and three
/// between.
const QUICK_SIZES: [usize; 5] = [0, 4, 9, 14, 19];
/// The number of runs of each size in the paper.
pub const RUNS: usize = 25;
/// The number of runs of each size in a quick run.
pub const QUICK_RUNS: usize = 5;
/// The engine with which all others are compared.
pub const BASELINE: &str = "c";
/// The engine that is timed twice in each round, so that its ratio to itself shows the noise.
pub const CONTROL: &str = "paper";

/// The scene of the experiment, `scenes/sphere.in`.
pub fn scene() -> Scene {
    shipped("sphere")
}

/// The two engines that the paper compares.
pub(super) fn baseline_and_control() -> [Engine; 2] {
    [BASELINE, CONTROL].map(|name| name.parse().expect("asm is built"))
}

/// The work of a round of all contestants together, per pixel, in the unit of
/// [`Progress`](super::lab::Progress).
const ROUND_WORK: u64 = 300;

#[derive(Clone, Debug)]
pub struct Settings {
    /// Sizes, as indices into [`PAPER`].
    pub sizes: Vec<usize>,
    pub runs: usize,
    /// The engines, which always include [`BASELINE`] and [`CONTROL`].
    pub engines: Vec<Engine>,
}

impl Settings {
    /// The paper's sizes and number of runs, or fewer if `quick`; with every engine that this
    /// machine runs or, if `engines` is given, with those, the baseline and the control.
    ///
    /// # Errors
    /// If an engine is unknown or cannot run here. In a build without assembly that may be the
    /// baseline or the control.
    pub fn new(quick: bool, runs: Option<usize>, engines: Option<&[String]>) -> Result<Self, EngineError> {
        let usable = || Engine::ALL.iter().filter(|engine| engine.usable()).map(|engine| engine.name()).collect();
        let names: Vec<&str> = engines.map_or_else(usable, |names| names.iter().map(String::as_str).collect());
        let mut engines = Vec::new();
        for name in [BASELINE, CONTROL].into_iter().chain(names) {
            let engine = Engine::from_str(name)?;
            if !engine.usable() {
                return Err(EngineError::Unusable(engine));
            }
            if !engines.contains(&engine) {
                engines.push(engine);
            }
        }
        let sizes = if quick { QUICK_SIZES.to_vec() } else { (0..PAPER.len()).collect() };
        Ok(Settings { sizes, runs: runs.unwrap_or(if quick { QUICK_RUNS } else { RUNS }), engines })
    }

    /// The work of all runs, in the unit of [`Progress`](super::lab::Progress).
    pub fn work(&self) -> u64 {
        self.runs as u64 * (0..self.sizes.len()).map(|index| self.work_at(index)).sum::<u64>()
    }

    /// The work of one run at the size [`sizes`](Self::sizes)\[`index`\].
    pub fn work_at(&self, index: usize) -> u64 {
        PAPER[self.sizes[index]].pixels() * ROUND_WORK
    }
}

/// The times of one engine at one size. The field names are those of the JSON document.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Timing {
    pub width: u32,
    pub height: u32,
    pub pixels: u64,
    pub engine: Name,
    pub precision: Name,
    pub output: Name,
    pub threads: usize,
    /// Mean TSC cycles of a picture; the paper gives means too.
    pub cycles_mean: f64,
    pub cycles_median: f64,
    pub cycles_min: f64,
    /// How many times as fast as the baseline the engine is: the median ratio of the baseline's
    /// cycles to the engine's, pair by pair.
    pub ratio_to_c: f64,
    pub ratio_low: f64,
    pub ratio_high: f64,
    /// The number of runs that ended on another core than they began on. All figures include them.
    pub migrations: usize,
    /// The number of runs in which this engine or the baseline was preempted. All figures leave
    /// these runs out, unless they are more than half.
    pub taken: usize,
    /// The number of runs more than 3 MAD (median absolute deviations) from the median; all figures
    /// include them.
    pub off: usize,
    /// TSC cycles of every run.
    pub samples: Vec<f64>,
}

impl Timing {
    /// The row of a contestant, from its runs and those of the baseline.
    fn new(size: &PaperRow, entry: &Entry, baseline: &Runs, runs: Runs) -> Self {
        let pairs = Pairs::of(baseline, &runs);
        let ratio = pairs.estimate(1);
        let ticks = kept(&runs.ticks, &judged(&pairs.taken));
        Timing {
            width: size.width,
            height: size.height,
            pixels: size.pixels(),
            engine: entry.engine.name().into(),
            precision: entry.engine.precision().name().into(),
            output: entry.output.name().into(),
            threads: 1,
            cycles_mean: mean(&ticks),
            cycles_median: median(&ticks),
            cycles_min: minimum(&ticks),
            ratio_to_c: ratio.value,
            ratio_low: ratio.low,
            ratio_high: ratio.high,
            migrations: runs.migrations,
            taken: PreemptedCount::among(&pairs.taken).preempted,
            off: runs.off(),
            samples: runs.ticks,
        }
    }

    /// Median TSC cycles per pixel.
    pub fn cycles_per_pixel(&self) -> f64 {
        self.cycles_median / self.pixels as f64
    }

    /// How many of this engine's runs were preempted.
    pub fn taken(&self) -> PreemptedCount {
        PreemptedCount { preempted: self.taken, measured: self.samples.len() }
    }

    /// Whether these are times of the engine `name` writing floats.
    pub fn is(&self, name: &str) -> bool {
        self.engine == name && self.output == PixelFormat::F32x4.name()
    }
}

/// The control at one size: an engine compared with itself.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct ControlRow {
    pub width: u32,
    pub height: u32,
    /// The median ratio of the engine's two measurements in a round, pair by pair.
    pub ratio: f64,
    pub low: f64,
    pub high: f64,
    /// TSC cycles of every run of the second measurement; those of the first are in the engine's
    /// own row.
    pub samples: Vec<f64>,
}

/// The paper's table, measured again. The field names are those of the JSON document.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Speedup {
    /// The largest distance of the control's ratio from 1 at any size. A ratio that is closer to 1
    /// does not count as a difference.
    pub noise_floor: f64,
    /// C/SIMD over all sizes: the median ratio of `c` to `paper`, pair by pair. Its interval comes
    /// from a bootstrap over runs and is widened by the noise floor.
    pub c_by_simd: Estimate,
    /// The control's ratio over all sizes: that of the paper's SIMD to itself.
    pub control_overall: Estimate,
    /// The control's ratio at every size that was finished.
    pub control: Vec<ControlRow>,
    /// The times of every engine at every size that was finished.
    pub rows: Vec<Timing>,
    #[serde(skip)]
    pub runs: usize,
    /// The requested number of sizes.
    #[serde(skip)]
    pub asked_sizes: usize,
    /// The requested number of runs.
    #[serde(skip)]
    pub asked_runs: usize,
    /// How many pairs of `c` and `paper` were preempted.
    #[serde(skip)]
    pub taken: PreemptedCount,
}

/// A contestant: an engine with the pixel format that it writes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Entry {
    pub engine: Engine,
    pub output: PixelFormat,
}

/// Every engine with floats, and packet engines with bytes too: other engines would convert their
/// floats to bytes, which shows nothing new. The control has a second entry right after its first.
pub(super) fn entries(engines: &[Engine], scene: &Scene) -> Result<Vec<Entry>, EngineError> {
    let mut entries = Vec::new();
    for engine in engines {
        entries.push(Entry { engine: *engine, output: PixelFormat::F32x4 });
        if engine.name() == CONTROL {
            entries.push(entries[entries.len() - 1]);
        }
        let tracer = engine.prepare(None, scene)?;
        if engine.name() != "reference" && tracer.writes(PixelFormat::Rgba8) {
            entries.push(Entry { engine: *engine, output: PixelFormat::Rgba8 });
        }
    }
    Ok(entries)
}

/// A run: for each size that was finished, in the order of [`Settings::sizes`], the measurement of
/// every entry.
pub type Run = Vec<Vec<Turn>>;

/// Checks that every engine traces the picture of the reference.
pub fn check(settings: &Settings) -> Result<(), LabError> {
    let truth = Truth::new(&scene())?;
    for Entry { engine, output } in entries(&settings.engines, &truth.scene)? {
        truth.check(engine.name(), &Case::of(Timed::Tracing, &truth.scene, engine, Purpose::default(), output)?)?;
    }
    Ok(())
}

/// Measures run `number`: at each size it times all contestants once, one after the other, in
/// reverse order if `number` is odd. `finished` is called with the measurements of each size; if it
/// returns false, the run ends there.
///
/// Each run should be a process of its own, as in the paper: the addresses at which the operating
/// system puts code and data can change the times, and stay the same for as long as the process
/// lasts.
pub fn measure_run(
    settings: &Settings,
    number: usize,
    clock: &mut dyn Clock,
    finished: &mut dyn FnMut(Vec<Turn>) -> bool,
) -> Result<(), LabError> {
    let scene = scene();
    let entries = entries(&settings.engines, &scene)?;
    let mut bench = Bench::default();
    for size in &settings.sizes {
        let scene = in_size(&scene, PAPER[*size].width, PAPER[*size].height);
        let case = |entry: &Entry| Case::of(Timed::Tracing, &scene, entry.engine, Purpose::default(), entry.output);
        let cases = entries.iter().map(case).collect::<Result<Vec<_>, _>>()?;
        let runs = bench.time(clock, &cases, number..number + 1, &mut || true)?.expect("nobody stops it");
        if !finished(runs.iter().flat_map(Turn::each).collect()) {
            break;
        }
    }
    Ok(())
}

/// The reference's picture at the first size, with which the engines' pictures are compared before
/// they are timed.
pub(super) struct Truth {
    pub scene: Scene,
    levels: Vec<[u8; 3]>,
}

impl Truth {
    pub(super) fn new(scene: &Scene) -> Result<Self, LabError> {
        let scene = in_size(scene, PAPER[0].width, PAPER[0].height);
        let mut film = Film::new(PixelFormat::F32x4, scene.camera.pixels() as usize)?;
        ReferenceTracer::new(&scene).rows(0..scene.camera.height(), film.as_mut());
        Ok(Truth { scene, levels: levels(&film) })
    }

    /// Checks that `case` traces the reference's picture of the scene, and that its kernels keep
    /// the calling convention.
    pub(super) fn check(&self, who: &str, case: &Case<'_>) -> Result<(), LabError> {
        let pixels = self.levels.len();
        let mut film = Film::new(case.output, pixels)?;
        check::kernels_in(|| case.trace(&mut film))?;
        let apart = |a: &[u8; 3], b: &[u8; 3]| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > 1);
        let wrong = levels(&film).iter().zip(&self.levels).filter(|(a, b)| apart(a, b)).count();
        // Where a ray grazes the sphere, rounding may decide between hit and miss. That can happen
        // at a few pixels of the outline; a 64th of the picture's width plus height is more than
        // any engine has needed.
        let allowed = (self.scene.camera.width() + self.scene.camera.height()) as usize / 64;
        if wrong > allowed {
            return Err(LabError::Picture { who: who.into(), output: case.output.name(), wrong, pixels, allowed });
        }
        Ok(())
    }
}

fn levels(film: &Film) -> Vec<[u8; 3]> {
    (0..film.len()).map(|pixel| film.colour(pixel).levels()).collect()
}

/// The runs of one entry at one size; `size` is an index into the sizes of each run.
fn runs_of(runs: &[&Run], size: usize, entry: usize) -> Runs {
    Runs {
        ticks: runs.iter().map(|run| run[size][entry].ticks as f64).collect(),
        migrations: runs.iter().filter(|run| run[size][entry].migrated).count(),
        taken: runs.iter().map(|run| run[size][entry].taken).collect(),
    }
}

impl Speedup {
    /// The table, from the measurements of all `runs`. Runs that did not finish all sizes are left
    /// out, unless no run did.
    pub fn of(settings: &Settings, runs: &[Run]) -> Result<Self, LabError> {
        let entries = entries(&settings.engines, &scene())?;
        let index_of =
            |name| entries.iter().position(|entry| entry.engine.name() == name).expect("it is always entered");
        let baseline = index_of(BASELINE);
        let control = index_of(CONTROL);
        let most = runs.iter().map(Vec::len).max().filter(|most| *most > 0).ok_or(LabError::Nothing)?;
        let runs: Vec<&Run> = runs.iter().filter(|run| run.len() == most).collect();
        let mut rows = Vec::new();
        let mut control_rows = Vec::new();
        let mut by_itself = Vec::new();
        let mut by_simd = Vec::new();
        for (index, size) in settings.sizes.iter().take(most).enumerate() {
            let size = &PAPER[*size];
            let of_baseline = runs_of(&runs, index, baseline);
            for (number, entry) in entries.iter().enumerate().filter(|(number, _)| *number != control + 1) {
                rows.push(Timing::new(size, entry, &of_baseline, runs_of(&runs, index, number)));
            }
            let of_control = runs_of(&runs, index, control);
            let again = runs_of(&runs, index, control + 1);
            let pairs = Pairs::of(&of_control, &again);
            let Estimate { value: ratio, low, high } = pairs.estimate(1);
            let PaperRow { width, height, .. } = *size;
            control_rows.push(ControlRow { width, height, ratio, low, high, samples: again.ticks });
            by_itself.push(pairs);
            by_simd.push(Pairs::of(&of_baseline, &of_control));
        }
        let noise_floor = control_rows.iter().map(|row| (row.ratio - 1.0).abs()).fold(0.0, f64::max);
        let Estimate { value, low, high } = Pairs::in_turn(&by_simd).estimate(most);
        Ok(Speedup {
            rows,
            noise_floor,
            control_overall: Pairs::in_turn(&by_itself).estimate(most),
            // Resampling one series of runs cannot show how far another series would be from it.
            // The noise floor is added for that.
            c_by_simd: Estimate { value, low, high }.widened(noise_floor),
            control: control_rows,
            runs: runs.len(),
            asked_sizes: settings.sizes.len(),
            asked_runs: settings.runs,
            taken: PreemptedCount::among(by_simd.iter().flat_map(|pairs| &pairs.taken)),
        })
    }

    /// Whether every requested size and run was finished.
    pub fn complete(&self) -> bool {
        self.control.len() == self.asked_sizes && self.runs == self.asked_runs
    }
}

/// The paper's row for a size.
pub fn paper_row(width: u32, height: u32) -> Option<&'static PaperRow> {
    PAPER.iter().find(|row| row.width == width && row.height == height)
}

/// The mean of the paper's ratios C/SIMD over all sizes.
pub fn paper_mean_ratio() -> f64 {
    statistics::mean(&PAPER.map(|row| row.ratio()))
}

/// Made-up runs for tests: each contestant takes its number of `ticks` at every size in the first
/// run, and one tick more in each following run.
pub fn scripted_runs(settings: &Settings, ticks: &[u64]) -> Vec<Run> {
    let run = |number: usize| {
        let mut run = Run::new();
        let mut ticks: Vec<u64> = ticks.iter().map(|ticks| ticks + number as u64).collect();
        if number % 2 == 1 {
            ticks.reverse();
        }
        let mut clock = crate::measure::Scripted(ticks.into_iter().cycle());
        measure_run(settings, number, &mut clock, &mut |size| {
            run.push(size);
            true
        })
        .expect("the engines are there");
        run
    };
    (0..settings.runs).map(run).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayo::internals::render::FilmMut;

    fn settings(sizes: &[usize], runs: usize) -> Settings {
        let engines = [BASELINE, CONTROL].map(|name| name.parse().unwrap()).to_vec();
        Settings { sizes: sizes.to_vec(), runs, engines }
    }

    #[test]
    fn the_table_is_that_of_the_ticks() {
        // `c`, `paper`, and `paper` again, which is always a tenth slower.
        let settings = settings(&[0, 1], 3);
        let measured = Speedup::of(&settings, &scripted_runs(&settings, &[6000, 1000, 1100])).unwrap();
        assert!(measured.complete());
        let summary = |row: &Timing| (row.engine.to_string(), row.pixels, row.samples.clone(), row.cycles_median);
        let rows: Vec<_> = measured.rows.iter().map(summary).collect();
        assert_eq!(rows[0], ("c".into(), 99_645, vec![6000.0, 6001.0, 6002.0], 6001.0));
        assert_eq!(rows[1], ("paper".into(), 99_645, vec![1000.0, 1001.0, 1002.0], 1001.0));
        assert_eq!((&*rows[2].0, rows[2].1, rows[2].3), ("c", 199_692, 6001.0));
        assert_eq!((measured.rows[1].cycles_min, measured.rows[1].ratio_to_c), (1000.0, 6001.0 / 1001.0));
        assert_eq!((measured.rows[0].ratio_low, measured.rows[0].ratio_high), (1.0, 1.0));
        assert_eq!(measured.control[0].ratio, 1001.0 / 1101.0);
        assert_eq!(measured.noise_floor, 1.0 - 1001.0 / 1101.0);
        // The interval lies between the smallest and the largest ratio of a pair, widened by the
        // noise floor.
        let wider = 1.0 + measured.noise_floor;
        let Estimate { value, low, high } = measured.c_by_simd;
        assert_eq!((low, value, high), (6002.0 / 1002.0 / wider, 6001.0 / 1001.0, 6.0 * wider));
    }

    #[test]
    fn interval_holds_what_sets_runs_apart() {
        // Two made-up machines: one is noisy from run to run, the other from size to size.
        let turn = |ticks| Turn { ticks, migrated: false, taken: false };
        let ticks = [4000, 4100, 4200, 4300, 4400].map(turn);
        let simd = turn(1000);
        let settings = settings(&[0, 1, 2, 3, 4], 5);
        let by_run: Vec<Run> = ticks.iter().map(|c| vec![vec![*c, simd, simd]; 5]).collect();
        let by_size = vec![ticks.iter().map(|c| vec![*c, simd, simd]).collect::<Run>(); 5];
        let [by_run, by_size] = [by_run, by_size].map(|runs| Speedup::of(&settings, &runs).unwrap().c_by_simd);
        assert_eq!((by_run.value, by_size.value), (4.2, 4.2));
        assert!(by_run.low <= 4.1 && by_run.high >= 4.3, "{by_run:?}");
        assert_eq!((by_size.low, by_size.high), (4.2, 4.2));
    }

    #[test]
    fn disturbed_runs_are_in_no_figure_unless_most_are() {
        let settings = settings(&[0, 1], 5);
        let turn = |ticks, taken| Turn { ticks, migrated: false, taken };
        // The first runs of `c` are four times as long as the others.
        let measured = |disturbed: usize| {
            let run = |number| {
                let c = if number < disturbed { turn(24_000, true) } else { turn(6000, false) };
                vec![vec![c, turn(1000, false), turn(1000, false)]; 2]
            };
            Speedup::of(&settings, &(0..5).map(run).collect::<Vec<_>>()).unwrap()
        };
        for (disturbed, c, mean, enough) in [
            (0, 6000.0, 6000.0, true),
            (2, 6000.0, 6000.0, true),
            (3, 24_000.0, 16_800.0, false),
            (5, 24_000.0, 24_000.0, false),
        ] {
            let measured = measured(disturbed);
            let (row, simd) = (&measured.rows[0], &measured.rows[1]);
            assert_eq!((row.cycles_median, row.cycles_mean, row.taken, simd.taken), (c, mean, disturbed, disturbed));
            assert_eq!((simd.ratio_to_c, measured.c_by_simd.value, row.samples.len()), (c / 1000.0, c / 1000.0, 5));
            assert_eq!(measured.taken, PreemptedCount { preempted: 2 * disturbed, measured: 10 });
            assert_eq!(measured.taken.leaves_enough(), enough);
        }
        let control = measured(2).control_overall;
        assert_eq!((control.low, control.value, control.high), (1.0, 1.0, 1.0));
    }

    #[test]
    fn stopping_keeps_finished_runs_or_first_sizes() {
        let settings = settings(&[0, 1, 2], 3);
        let whole = scripted_runs(&settings, &[6, 1, 1]);
        let of =
            |runs: &[&[Vec<Turn>]]| Speedup::of(&settings, &runs.iter().map(|run| run.to_vec()).collect::<Vec<_>>());
        let stopped_in_second = of(&[&whole[0], &whole[1][..2]]).unwrap();
        assert_eq!((stopped_in_second.control.len(), stopped_in_second.runs), (3, 1));
        let stopped_in_first = of(&[&whole[0][..2]]).unwrap();
        assert_eq!((stopped_in_first.control.len(), stopped_in_first.runs), (2, 1));
        assert!(!stopped_in_second.complete() && !stopped_in_first.complete());
        assert!(matches!(of(&[]), Err(LabError::Nothing)));
        assert!(matches!(of(&[&[]]), Err(LabError::Nothing)));
    }

    #[test]
    fn the_papers_table_is_the_papers() {
        assert!((paper_mean_ratio() - 6.34).abs() < 0.005);
        assert!(PAPER.iter().all(|row| (f64::from(row.width) / f64::from(row.height) - 4.0 / 3.0).abs() < 0.005));
        assert_eq!(paper_row(1632, 1224).map(PaperRow::pixels), Some(1_997_568));
    }

    #[test]
    fn another_picture_is_refused() {
        let truth = Truth::new(&scene()).unwrap();
        let black = Case::new(truth.scene.camera, PixelFormat::Rgba8, |_, film| {
            let FilmMut::Rgba8(film) = film else { unreachable!() };
            film.fill([0; 4]);
        });
        let black = truth.check("black", &black);
        assert!(matches!(black, Err(LabError::Picture { wrong, .. }) if wrong > 1000));
    }
}
