//! Stiff and extreme scenes: every family over its whole range, engine by engine, against the truth and against limits.

pub mod cost;
pub mod limits;
pub mod operations;
pub mod plot;

use std::collections::BTreeSet;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::accuracy::{self, Contender, Judged, judge};
use super::lab::LabError;
use crate::measure::Machine;
use crate::measure::Name;
use crate::render::{EngineError, Film, Precision};
use crate::scene::families::{Case, FAMILIES, Family};
use crate::scene::{Camera, Scene, many};
use limits::{Broken, Figures, Limits};

/// Rays of a cell, all variants of a level together, at least. Of a quick run and of any other.
const RAYS: [u32; 2] = [3_000, 100_000];
/// Runs of which the fastest counts, and after how many seconds there are no more.
const RUNS: usize = 5;
const SECONDS: f64 = 0.05;

/// What is to be swept.
#[derive(Clone, Debug)]
pub struct Settings {
    pub families: Vec<&'static Family>,
    pub contenders: Vec<Contender>,
    pub seed: u64,
    /// The only case, where it is not all.
    pub case: Option<usize>,
    pub quick: bool,
    pub limits: Limits,
}

impl Settings {
    /// Every engine on every family, held to the limits that are checked in.
    pub fn all(quick: bool) -> Self {
        let (families, contenders) = (FAMILIES.iter().collect(), accuracy::contenders());
        Settings { families, contenders, seed: 1, case: None, quick, limits: Limits::checked_in() }
    }
}

/// One engine at one level of a family, all variants together. The field names are those of the JSON document.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Cell {
    pub family: Name,
    pub level: usize,
    pub value: String,
    pub engine: Name,
    pub precision: Name,
    pub rays: usize,
    /// Those nearer to another answer than the margin.
    pub in_margin: usize,
    /// Outside of the margin: a hit where there is none, none where there is one, or another object.
    pub wrong_hits: usize,
    /// Rays that hit nothing in pictures that objects cover.
    pub holes: usize,
    /// The largest error of t in units of its last place.
    pub max_ulp: Option<f64>,
    /// The same as a share of the documented bound.
    pub bound_share: Option<f64>,
    /// The largest angle between the normal and the true one, in radians.
    pub max_angle: Option<f64>,
    /// Pixels off by a level or more, in the worse of the outputs; of packets in f64 in the bytes.
    pub off_by_1: usize,
    /// Of these, pixels that the estimates in their shade do not explain.
    #[serde(skip)]
    unexplained: usize,
    pub off_by_2: usize,
    /// The CPU that the times are of, where that is not the document's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cpu: Option<String>,
    /// The fastest run of one thread, floats, all variants together.
    pub ns_per_ray: Option<f64>,
    /// Its ratio to that of the ordinary level or, where levels show more or less, of [`ordinary`]'s scene.
    pub slowdown: Option<f64>,
    /// The case with the most wrong hits or, where there are none, with the largest share of the bound.
    pub worst_case: usize,
    /// The worst case by each of [`Figures`], and its figure there.
    #[serde(skip)]
    worst_by: [(f64, usize); limits::MEASURES.len()],
    /// The rays of the whole level, of which a limit is a share, even if only one of its cases is swept.
    #[serde(skip)]
    level_rays: usize,
}

impl Cell {
    /// The engine and its precision.
    pub fn contender(&self) -> (&str, &str) {
        (&self.engine, &self.precision)
    }

    fn figures(&self) -> Figures {
        let share = |count: usize| count as f64 / self.level_rays.max(1) as f64;
        let counts = [self.wrong_hits, self.holes, self.unexplained, self.off_by_2].map(share);
        figures([self.max_ulp, self.bound_share, self.max_angle], counts)
    }

    /// Whether it breaks the documented bound or hits what is not there.
    pub fn breaks(&self) -> bool {
        self.wrong_hits > 0 || self.bound_share.is_some_and(|share| share > 1.0)
    }
}

/// In the order of [`limits::MEASURES`]: errors of t and of normals, where there are any, and shares of the rays.
fn figures(errors: [Option<f64>; 3], shares: [f64; 4]) -> Figures {
    let [ulp, bound, angle] = errors.map(|error| error.unwrap_or(0.0));
    let [wrong, holes, unexplained, off_by_2] = shares;
    [ulp, bound, angle, wrong, holes, unexplained, off_by_2]
}

/// One engine over a whole family.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Stability {
    pub family: Name,
    pub engine: Name,
    pub precision: Name,
    /// The largest error of t in units of its last place; null where nothing is hit.
    pub worst: Option<f64>,
    /// The same as a share of the documented bound.
    pub bound: Option<f64>,
    /// The largest angle between a normal and the true one, in radians.
    pub angle: Option<f64>,
    /// Outside of the margin: wrong hits and wrong objects.
    pub wrong_hits: usize,
    /// Rays that hit nothing in pictures that objects cover.
    pub holes: usize,
    pub off_by_1: usize,
    pub off_by_2: usize,
    /// The first value of the parameter, from the ordinary one outwards, at which it breaks its bound or hits wrongly.
    pub breaks_at: Option<String>,
    /// The CPU that the times are of, where that is not the document's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cpu: Option<String>,
    /// The largest ratio of a level's time to that of the ordinary one.
    pub slowdown: Option<f64>,
    pub holds: bool,
    pub broken: Vec<Broken>,
    /// The case that shows the worst.
    pub worst_case: usize,
    /// What has a limit, in the order of [`limits::MEASURES`].
    #[serde(skip)]
    worst_by: [Worst; limits::MEASURES.len()],
}

/// A figure of the worst level, counts as a share of its rays, and of that level's worst case.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize)]
struct Worst {
    figure: f64,
    case: usize,
    of_case: f64,
}

/// Everything that was found.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct StabilityReport {
    pub machine: Machine,
    pub seed: u64,
    pub quick: bool,
    pub complete: bool,
    pub rows: Vec<Stability>,
    /// The same, level by level.
    pub cells: Vec<Cell>,
    /// What a far sphere and a small scene take by what ordinary ones do.
    pub costs: Vec<cost::Cost>,
    /// The operations by themselves, at ranges that scenes do not have too.
    pub operations: Vec<operations::OperationRow>,
    pub tighter: Vec<String>,
}

/// The side of the pictures of a family.
pub fn side(family: &Family, quick: bool) -> u32 {
    let rays = f64::from(RAYS[usize::from(!quick)]) / family.variants.len() as f64;
    rays.sqrt().ceil() as u32
}

/// The seconds that [`sweep`] may take.
pub fn forecast(settings: &Settings) -> f64 {
    let rays = |family: &&Family| {
        let cases = if settings.case.is_some() { 1 } else { family.cases() };
        u64::from(side(family, settings.quick)).pow(2) * cases as u64
    };
    accuracy::forecast(settings.families.iter().map(rays).sum(), settings.contenders.len())
}

/// What was found in a family.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Swept {
    rows: Vec<Stability>,
    /// Figures that documents leave out of the rows.
    worst_by: Vec<[Worst; limits::MEASURES.len()]>,
    cells: Vec<Cell>,
}

impl Swept {
    /// Sets the CPU that the times are of, where that is not the document's.
    pub fn on(mut self, cpu: Option<&str>) -> Self {
        self.rows.iter_mut().for_each(|row| row.cpu = cpu.map(str::to_owned));
        self.cells.iter_mut().for_each(|cell| cell.cpu = cpu.map(str::to_owned));
        self
    }
}

/// Sweeps a family. `proceed` is told after each level, and ends the sweep where it says no: there is nothing then.
///
/// # Errors
/// An engine that cannot be prepared, or no memory.
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
    /// The document of families that were swept, in their order, held to their limits; with what is measured beside them where
    /// they are `complete`.
    ///
    /// # Errors
    /// An engine that cannot be prepared, or no memory.
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
            // Of small pictures the worst is not to be expected.
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
            // There is no picture; asking for one must be an error.
            for (cell, contender) in cells.iter_mut().zip(&contenders) {
                let (refused, ns) = refusal(*contender, case);
                cell.rays += 1;
                cell.wrong_hits += usize::from(!refused);
                cell.worst_case = case.index;
                cell.worst_by = [(0.0, case.index); limits::MEASURES.len()];
                let picture = ordinary(case);
                let usual = time(*contender, &picture)? * picture.camera.pixels() as f64;
                cell.slowdown = Some(cell.slowdown.unwrap_or(0.0).max(ns / usual));
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

/// Adds what one engine made of a case, in each of its outputs; gives what makes one case worse than another.
fn add(cell: &mut Cell, case: &Case, judged: &[&Judged]) -> (usize, f64) {
    let largest = |a: Option<f64>, b: Option<f64>| a.into_iter().chain(b).reduce(f64::max);
    let Some(first) = judged.first().map(|judged| judged.errors) else { return (0, 0.0) };
    let wrong = first.wrong_hits + first.wrong_objects;
    // Floats round what f64 has made, and that alone can be a level; bytes do not.
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

/// What a case of a family is compared with whose levels show more or less: as many spheres, triangles and lights in
/// ordinary places, in a square picture of as many pixels.
pub fn ordinary(case: &Case) -> Scene {
    let Scene { camera, lights, spheres, triangles, .. } = &case.scene;
    let side = (camera.pixels() as f64).sqrt().ceil() as u32;
    let scene = many(spheres.len(), triangles.len(), case.seed);
    let lamps = scene.lights.iter().copied().cycle().take(lights.len()).collect();
    let camera = Camera::new(side, side, 1.0, 1.0).expect("a square of so many pixels is within the limits");
    Scene { camera, lights: lamps, shadows: case.scene.shadows, ..scene }
}

/// Whether an invalid scene is refused, and after how many nanoseconds.
fn refusal(contender: Contender, case: &Case) -> (bool, f64) {
    let (mut refused, mut fastest) = (true, f64::INFINITY);
    for _ in 0..RUNS {
        let start = Instant::now();
        refused &= matches!(contender.prepare(&case.scene), Err(EngineError::Scene(_)));
        fastest = fastest.min(start.elapsed().as_secs_f64());
    }
    (refused, 1e9 * fastest)
}

/// Nanoseconds per ray in the fastest run of this thread.
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

/// Sets each cell's time against that of the ordinary level.
fn compare_times(family: &Family, cells: &mut [Cell]) {
    let ordinary: Vec<_> = cells.iter().filter(|cell| cell.level == family.ordinary).cloned().collect();
    for cell in cells {
        let ordinary = ordinary.iter().find(|other| other.contender() == cell.contender());
        cell.slowdown = cell.ns_per_ray.zip(ordinary).and_then(|(ns, ordinary)| Some(ns / ordinary.ns_per_ray?));
    }
}

/// The rows of a family from its cells.
fn rows(family: &Family, cells: &[Cell]) -> Vec<Stability> {
    let mut seen = BTreeSet::new();
    let contenders = cells.iter().map(Cell::contender).filter(|contender| seen.insert(*contender));
    let row = |(engine, precision): (&str, &str)| {
        let own: Vec<_> = cells.iter().filter(|cell| cell.contender() == (engine, precision)).collect();
        let largest = |of: fn(&Cell) -> Option<f64>| own.iter().filter_map(|cell| of(cell)).reduce(f64::max);
        let sum = |of: fn(&Cell) -> usize| own.iter().map(|cell| of(cell)).sum();
        let badness = |cell: &&&Cell| (cell.wrong_hits + cell.off_by_2, cell.bound_share.unwrap_or(0.0));
        let worst = own.iter().max_by(|a, b| badness(a).partial_cmp(&badness(b)).expect("shares are numbers"));
        let outwards = own.iter().filter(|cell| cell.breaks()).min_by_key(|cell| cell.level.abs_diff(family.ordinary));
        let worst_by = std::array::from_fn(|i| {
            let cells = own.iter().map(|cell| {
                let (of_case, case) = cell.worst_by[i];
                Worst { figure: cell.figures()[i], case, of_case }
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
    };
    contenders.map(row).collect()
}

/// The command that repeats one case alone.
pub fn replay(family: &str, engine: &str, case: usize, seed: u64, quick: bool) -> String {
    let quick = if quick { " --quick" } else { "" };
    format!("rayo stability --family {family} --engine {engine} --seed {seed} --case {case}{quick}")
}
