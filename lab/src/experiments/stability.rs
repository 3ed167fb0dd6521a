//! Sweeps the families of ill-conditioned and extreme scenes: compares every engine with the truth
//! and with its limits.

pub mod cost;
pub mod limits;
pub mod operations;
pub mod plot;

use std::collections::BTreeSet;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::accuracy::{self, Contender, Judged, judge};
use super::lab::LabError;
use crate::families::{Case, FAMILIES, Family};
use crate::measure::{Machine, Name};
use limits::{Broken, Limits, MeasureValues};
use rayo::internals::render::{EngineError, Film, Precision};
use rayo::internals::scene::{Camera, Scene, many};

/// The least number of rays per engine and level, over all variants, in a quick run and in a full
/// one. (A level is a value of a family's parameter; its variants are cases with that value.)
const RAYS: [u32; 2] = [3_000, 100_000];
/// The number of timed runs, of which the fastest counts. After [`SECONDS`] seconds no further run
/// begins.
const RUNS: usize = 5;
const SECONDS: f64 = 0.05;

/// What to sweep.
#[derive(Clone, Debug)]
pub struct Settings {
    pub families: Vec<&'static Family>,
    pub contenders: Vec<Contender>,
    pub seed: u64,
    /// The only case to sweep; None for all.
    pub case: Option<usize>,
    pub quick: bool,
    pub limits: Limits,
}

impl Settings {
    /// Every engine on every family, with the checked-in limits.
    pub fn all(quick: bool) -> Self {
        let (families, contenders) = (FAMILIES.iter().collect(), accuracy::contenders());
        Settings { families, contenders, seed: 1, case: None, quick, limits: Limits::checked_in() }
    }
}

/// The results of one engine at one level of a family, over all variants. The field names are those
/// of the JSON document.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Cell {
    pub family: Name,
    pub level: usize,
    pub value: String,
    pub engine: Name,
    pub precision: Name,
    pub rays: usize,
    /// The number of rays so close to another result that an engine may give either: within the
    /// margin of [`accuracy::errors`].
    pub in_margin: usize,
    /// The number of rays outside of the margin that have a hit where there is none, or none where
    /// there is one, or hit another object.
    pub wrong_hits: usize,
    /// The number of rays that hit nothing although objects cover the picture without a gap.
    pub holes: usize,
    /// The largest error of t in units of its last place.
    pub max_ulp: Option<f64>,
    /// The largest relative error of t divided by its documented bound.
    pub bound_share: Option<f64>,
    /// The largest angle between the normal and the true one, in radians.
    pub max_angle: Option<f64>,
    /// The number of pixels off by a level or more, in the worse of the two outputs. For engines in
    /// f64 only bytes count, since rounding a colour to an f32 float can change a level.
    pub off_by_1: usize,
    /// The number of pixels off by one level that estimated roots in shading do not explain.
    #[serde(skip)]
    unexplained: usize,
    pub off_by_2: usize,
    /// Nanoseconds per ray over all variants in the fastest run, with one thread, writing floats.
    pub ns_per_ray: Option<f64>,
    /// The ratio of `ns_per_ray` to that of the ordinary level or, in families whose levels differ
    /// in how much they show, to that of the [`ordinary`] scene.
    pub slowdown: Option<f64>,
    /// The case with the most wrong hits. If there are none, the case whose t is worst relative to
    /// its bound.
    pub worst_case: usize,
    /// For each of [`MeasureValues`], its value in the worst case, and the number of that case.
    #[serde(skip)]
    worst_by: [(f64, usize); limits::MEASURES.len()],
    /// The number of rays of the whole level, even if only one of its cases is swept. Limits on
    /// counts are shares of it.
    #[serde(skip)]
    level_rays: usize,
}

impl Cell {
    /// The engine and its precision.
    pub fn contender(&self) -> (&str, &str) {
        (&self.engine, &self.precision)
    }

    fn figures(&self) -> MeasureValues {
        let share = |count: usize| count as f64 / self.level_rays.max(1) as f64;
        let counts = [self.wrong_hits, self.holes, self.unexplained, self.off_by_2].map(share);
        figures([self.max_ulp, self.bound_share, self.max_angle], counts)
    }

    /// Whether t exceeds the documented bound or a hit is wrong.
    pub fn breaks(&self) -> bool {
        self.wrong_hits > 0 || self.bound_share.is_some_and(|share| share > 1.0)
    }
}

/// The figures in the order of [`limits::MEASURES`]: the errors of t and of normals, 0 for None,
/// and then shares of the rays.
fn figures(errors: [Option<f64>; 3], shares: [f64; 4]) -> MeasureValues {
    let [ulp, bound, angle] = errors.map(|error| error.unwrap_or(0.0));
    let [wrong, holes, unexplained, off_by_2] = shares;
    [ulp, bound, angle, wrong, holes, unexplained, off_by_2]
}

/// The results of one engine over a whole family.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Stability {
    pub family: Name,
    pub engine: Name,
    pub precision: Name,
    /// The largest error of t in units of its last place; null if nothing is hit.
    pub worst: Option<f64>,
    /// The largest relative error of t divided by its documented bound.
    pub bound: Option<f64>,
    /// The largest angle between a normal and the true one, in radians.
    pub angle: Option<f64>,
    /// The number of wrong hits and wrong objects outside of the margin.
    pub wrong_hits: usize,
    /// The number of rays that hit nothing although objects cover the picture without a gap.
    pub holes: usize,
    pub off_by_1: usize,
    pub off_by_2: usize,
    /// The first value of the parameter, going away from the ordinary one, at which t exceeds its
    /// bound or a hit is wrong.
    pub breaks_at: Option<String>,
    /// The largest ratio of a level's time to the ordinary level's.
    pub slowdown: Option<f64>,
    pub holds: bool,
    pub broken: Vec<Broken>,
    /// The case with the worst results.
    pub worst_case: usize,
    /// The figures that have limits, in the order of [`limits::MEASURES`].
    #[serde(skip)]
    worst_by: [WorstFigure; limits::MEASURES.len()],
}

/// A figure at the worst level, and in the worst case of that level. Counts are shares of the
/// level's rays.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize)]
struct WorstFigure {
    figure: f64,
    case: usize,
    of_case: f64,
}

/// The results of all families.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct StabilityReport {
    pub machine: Machine,
    pub seed: u64,
    pub quick: bool,
    pub complete: bool,
    pub rows: Vec<Stability>,
    /// The results level by level.
    pub cells: Vec<Cell>,
    /// The times of scenes with a far sphere and of small scenes, divided by those of ordinary
    /// scenes.
    pub costs: Vec<cost::Cost>,
    /// Single operations, also with numbers beyond the range of any scene's.
    pub operations: Vec<operations::OperationRow>,
    pub tighter: Vec<String>,
}

/// The side of the pictures of a family.
pub fn side(family: &Family, quick: bool) -> u32 {
    let rays = f64::from(RAYS[usize::from(!quick)]) / family.variants.len() as f64;
    rays.sqrt().ceil() as u32
}

/// A forecast of how many seconds [`sweep`] takes.
pub fn forecast(settings: &Settings) -> f64 {
    let rays = |family: &&Family| {
        let cases = if settings.case.is_some() { 1 } else { family.cases() };
        u64::from(side(family, settings.quick)).pow(2) * cases as u64
    };
    accuracy::forecast(settings.families.iter().map(rays).sum(), settings.contenders.len())
}

/// The results of a family.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Swept {
    rows: Vec<Stability>,
    /// The limited figures of each row, which documents leave out.
    worst_by: Vec<[WorstFigure; limits::MEASURES.len()]>,
    cells: Vec<Cell>,
}

/// Sweeps a family. `proceed` is called after each level; if it returns false, the sweep ends and
/// returns None.
///
/// # Errors
/// If an engine cannot be prepared, or if there is not enough memory.
pub fn sweep(
    settings: &Settings,
    family: &Family,
    proceed: &mut dyn FnMut() -> bool,
) -> Result<Option<Swept>, LabError> {
    let mut cells = Vec::new();
    for level in 0..family.levels.len() {
        cells.extend(sweep_level(settings, family, level)?);
        if !proceed() {
            return Ok(None);
        }
    }
    if family.same_work {
        compare_times(family, &mut cells);
    }
    let rows = rows(family, &cells);
    Ok(Some(Swept { worst_by: rows.iter().map(|row| row.worst_by).collect(), rows, cells }))
}

impl StabilityReport {
    /// Makes the document of the swept families, in their order, and compares their results with
    /// the limits. If `complete`, costs and single operations are measured too.
    ///
    /// # Errors
    /// If an engine cannot be prepared, or if there is not enough memory.
    pub fn new(settings: &Settings, complete: bool, families: Vec<Swept>) -> Result<Self, LabError> {
        let mut document = StabilityReport {
            machine: Machine::this(),
            seed: settings.seed,
            quick: settings.quick,
            complete,
            ..StabilityReport::default()
        };
        for Swept { rows, worst_by, cells } in families {
            let rows = rows.into_iter().zip(worst_by);
            document.rows.extend(rows.map(|(row, worst_by)| Stability { worst_by, ..row }));
            document.cells.extend(cells);
        }
        for row in &mut document.rows {
            row.broken = settings.limits.broken(row);
            row.holds = row.broken.is_empty();
        }
        if document.complete && settings.case.is_none() {
            document.costs = cost::measure(&settings.families, &settings.contenders, settings.quick)?;
            document.operations = operations::sweep(&settings.families, settings.seed, settings.quick);
            // The small pictures of a quick run may lack the worst rays, so that no limit can be
            // tightened by them.
            let tighter = document.rows.iter().filter_map(|row| settings.limits.tighter(row));
            document.tighter = if settings.quick { Vec::new() } else { tighter.collect() };
        }
        Ok(document)
    }
}

fn sweep_level(settings: &Settings, family: &Family, level: usize) -> Result<Vec<Cell>, LabError> {
    let variants = family.variants.len();
    let cases =
        (level * variants..(level + 1) * variants).filter(|case| settings.case.is_none_or(|only| only == *case));
    let cases: Vec<Case> = cases.map(|case| family.case(case, settings.seed, side(family, settings.quick))).collect();
    if cases.is_empty() {
        return Ok(Vec::new());
    }
    let mut contenders = settings.contenders.clone();
    contenders.retain(|contender| contender.can_trace(&cases[0].scene));
    let mut cells: Vec<Cell> = contenders.iter().map(|contender| empty(family, level, *contender)).collect();
    let mut worst = vec![(0, -1.0); cells.len()];
    let mut usual = vec![0.0; cells.len()];
    for case in &cases {
        if !case.valid {
            // An invalid scene has no picture; an engine must refuse it with an error.
            for (cell, contender) in cells.iter_mut().zip(&contenders) {
                add_refusal(cell, case, *contender)?;
            }
            continue;
        }
        let judged = judge(&case.scene, &contenders)?;
        for ((cell, worst), contender) in cells.iter_mut().zip(&mut worst).zip(&contenders) {
            let own: Vec<_> = judged.iter().filter(|judged| judged.entry.contender == *contender).collect();
            let badness = add(cell, case, &own);
            if badness > *worst {
                *worst = badness;
                cell.worst_case = case.index;
            }
            let ns = time(*contender, &case.scene)? * case.scene.camera.pixels() as f64;
            *cell.ns_per_ray.get_or_insert(0.0) += ns;
        }
        if !family.same_work {
            let picture = ordinary(case);
            for (usual, contender) in usual.iter_mut().zip(&contenders) {
                *usual += time(*contender, &picture)? * case.scene.camera.pixels() as f64;
            }
        }
    }
    for (cell, usual) in cells.iter_mut().zip(usual) {
        cell.level_rays = cell.rays * variants / cases.len();
        cell.slowdown = cell.slowdown.or(cell.ns_per_ray.filter(|_| !family.same_work).map(|ns| ns / usual));
        cell.ns_per_ray = cell.ns_per_ray.map(|ns| ns / cell.rays as f64);
    }
    Ok(cells)
}

fn empty(family: &Family, level: usize, contender: Contender) -> Cell {
    Cell {
        family: family.id.into(),
        level,
        value: family.levels[level].to_string(),
        engine: contender.engine.name().into(),
        precision: contender.precision.name().into(),
        worst_by: [(-1.0, 0); limits::MEASURES.len()],
        ..Cell::default()
    }
}

/// Adds to a cell whether an engine refuses an invalid case, and how long it takes to do so,
/// divided by the time of an ordinary picture.
fn add_refusal(cell: &mut Cell, case: &Case, contender: Contender) -> Result<(), LabError> {
    let Refusal { refused, ns } = refusal(contender, case);
    cell.rays += 1;
    cell.wrong_hits += usize::from(!refused);
    cell.worst_case = case.index;
    cell.worst_by = [(0.0, case.index); limits::MEASURES.len()];
    let picture = ordinary(case);
    let usual = time(contender, &picture)? * picture.camera.pixels() as f64;
    cell.slowdown = Some(cell.slowdown.unwrap_or(0.0).max(ns / usual));
    Ok(())
}

/// Adds an engine's results for a case, in each of its outputs. Returns the key by which cases are
/// ranked from good to bad.
fn add(cell: &mut Cell, case: &Case, judged: &[&Judged]) -> (usize, f64) {
    let largest = |a: Option<f64>, b: Option<f64>| a.into_iter().chain(b).reduce(f64::max);
    let Some(first) = judged.first().map(|judged| judged.errors) else { return (0, 0.0) };
    let wrong = first.wrong_hits + first.wrong_objects;
    // An engine in f64 rounds its colours to f32 for a float file, which alone can change a level.
    // For bytes it does not, so that only its bytes are judged.
    let bytes = judged.iter().any(|judged| judged.entry.output.is_8bit());
    let coarse = |judged: &&&Judged| {
        let Contender { precision, .. } = judged.entry.contender;
        precision == Precision::Double && bytes && !judged.entry.output.is_8bit()
    };
    let seen: Vec<_> = judged.iter().filter(|judged| !coarse(judged)).collect();
    let most = |of: fn(&Judged) -> usize| seen.iter().map(|judged| of(judged)).max().unwrap_or(0);
    let (off_by_1, off_by_2) = (most(|judged| judged.errors.off_by_1), most(|judged| judged.errors.off_by_2));
    let unexplained = most(|judged| judged.errors.unexplained);
    let leaks = most(|judged| judged.errors.off_by_2_inside);
    let holes = if case.covered { first.wrong_hits + first.wrong_hits_inside + leaks } else { 0 };
    cell.rays += first.rays;
    cell.in_margin += first.in_margin;
    cell.wrong_hits += wrong;
    cell.holes += holes;
    cell.max_ulp = largest(cell.max_ulp, first.max_ulp);
    cell.bound_share = largest(cell.bound_share, first.bound_share);
    cell.max_angle = largest(cell.max_angle, first.max_angle);
    cell.off_by_1 += off_by_1;
    cell.unexplained += unexplained;
    cell.off_by_2 += off_by_2;
    let shares = [wrong, holes, unexplained, off_by_2].map(|count| count as f64 / first.rays as f64);
    let found = figures([first.max_ulp, first.bound_share, first.max_angle], shares);
    for (worst, figure) in cell.worst_by.iter_mut().zip(found) {
        if figure > worst.0 {
            *worst = (figure, case.index);
        }
    }
    (wrong + off_by_2, first.bound_share.unwrap_or(0.0))
}

/// The scene whose time is compared with that of a case, in families whose levels differ in how
/// much they show. It has as many spheres, triangles and lights, at ordinary positions, in a square
/// picture of as many pixels.
pub fn ordinary(case: &Case) -> Scene {
    let Scene { camera, lights, spheres, triangles, .. } = &case.scene;
    let side = (camera.pixels() as f64).sqrt().ceil() as u32;
    let scene = many(spheres.len(), triangles.len(), case.seed);
    let lamps = scene.lights.iter().copied().cycle().take(lights.len()).collect();
    let camera = Camera::new(side, side, 1.0, 1.0).expect("a square of so many pixels is within the limits");
    Scene { camera, lights: lamps, shadows: case.scene.shadows, ..scene }
}

/// Whether a scene was refused in every run, and after how many nanoseconds in the fastest run.
struct Refusal {
    refused: bool,
    ns: f64,
}

/// Whether a contender refuses an invalid scene.
fn refusal(contender: Contender, case: &Case) -> Refusal {
    let (mut refused, mut fastest) = (true, f64::INFINITY);
    for _ in 0..RUNS {
        let start = Instant::now();
        refused &= matches!(contender.prepare(&case.scene), Err(EngineError::Scene(_)));
        fastest = fastest.min(start.elapsed().as_secs_f64());
    }
    Refusal { refused, ns: 1e9 * fastest }
}

/// Nanoseconds per ray in the fastest run, by the calling thread alone.
fn time(contender: Contender, scene: &Scene) -> Result<f64, LabError> {
    let camera = scene.camera;
    let tracer = contender.prepare(scene)?;
    let mut film = Film::new(contender.engine.format_for(false), camera.pixels() as usize)?;
    let start = Instant::now();
    let mut fastest = f64::INFINITY;
    for _ in 0..RUNS {
        let run = Instant::now();
        tracer.rows(0..camera.height(), film.as_mut());
        fastest = fastest.min(run.elapsed().as_secs_f64());
        if start.elapsed().as_secs_f64() > SECONDS {
            break;
        }
    }
    Ok(1e9 * fastest / camera.pixels() as f64)
}

/// Sets the slowdown of each cell, relative to the cell of the ordinary level.
fn compare_times(family: &Family, cells: &mut [Cell]) {
    let ordinary: Vec<_> = cells.iter().filter(|cell| cell.level == family.ordinary).cloned().collect();
    for cell in cells {
        let ordinary = ordinary.iter().find(|other| other.contender() == cell.contender());
        cell.slowdown = cell.ns_per_ray.zip(ordinary).and_then(|(ns, ordinary)| Some(ns / ordinary.ns_per_ray?));
    }
}

/// The rows of a family: one for each contender, from its cells.
fn rows(family: &Family, cells: &[Cell]) -> Vec<Stability> {
    let mut seen = BTreeSet::new();
    let contenders = cells.iter().map(Cell::contender).filter(|contender| seen.insert(*contender));
    contenders.map(|(engine, precision)| row(family, cells, engine, precision)).collect()
}

/// The row of a contender from the cells of a family.
fn row(family: &Family, cells: &[Cell], engine: &str, precision: &str) -> Stability {
    let own: Vec<_> = cells.iter().filter(|cell| cell.contender() == (engine, precision)).collect();
    let largest = |of: fn(&Cell) -> Option<f64>| own.iter().filter_map(|cell| of(cell)).reduce(f64::max);
    let sum = |of: fn(&Cell) -> usize| own.iter().map(|cell| of(cell)).sum();
    let badness = |cell: &&&Cell| (cell.wrong_hits + cell.off_by_2, cell.bound_share.unwrap_or(0.0));
    let worst = own.iter().max_by(|a, b| badness(a).partial_cmp(&badness(b)).expect("shares are numbers"));
    let outwards = own.iter().filter(|cell| cell.breaks()).min_by_key(|cell| cell.level.abs_diff(family.ordinary));
    let worst_by = std::array::from_fn(|i| {
        let cells = own.iter().map(|cell| {
            let (of_case, case) = cell.worst_by[i];
            WorstFigure { figure: cell.figures()[i], case, of_case }
        });
        cells.max_by(|a, b| a.figure.total_cmp(&b.figure)).unwrap_or_default()
    });
    Stability {
        family: family.id.into(),
        engine: engine.to_owned().into(),
        precision: precision.to_owned().into(),
        worst: largest(|cell| cell.max_ulp),
        bound: largest(|cell| cell.bound_share),
        angle: largest(|cell| cell.max_angle),
        wrong_hits: sum(|cell| cell.wrong_hits),
        holes: sum(|cell| cell.holes),
        off_by_1: sum(|cell| cell.off_by_1),
        off_by_2: sum(|cell| cell.off_by_2),
        breaks_at: outwards.map(|cell| cell.value.clone()),
        slowdown: largest(|cell| cell.slowdown),
        holds: true,
        worst_case: worst.map_or(0, |cell| cell.worst_case),
        worst_by,
        ..Stability::default()
    }
}

/// The command that repeats a single case.
pub fn replay(family: &str, engine: &str, case: usize, seed: u64, quick: bool) -> String {
    let quick = if quick { " --quick" } else { "" };
    format!("rayo stability --family {family} --engine {engine} --seed {seed} --case {case}{quick}")
}
