//! Follows one ray, or one operation, and shows every instruction as its source has it.

mod describe;
pub mod model;
mod operation;
mod parts;
pub mod shadow;
mod slice;
mod tree;

use std::collections::HashMap;
use std::ops::Range;
use std::slice::from_ref;

use glam::DVec3;
use serde::Serialize;

pub use describe::{Branch, Change, Line, MacroCall, Value};
use describe::{DescribedStep, Describer};
pub use tree::{Argument, Node};

use crate::experiments::check::{self, What};
use crate::measure::instructions::Mix;
use crate::measure::source::Unit;
use model::{Element, Operation, Place};
use parts::{Stretch, parts_of_call, range_of};
use rayo::internals::kernels::step::{self, Recording, Step, Unavailable, Visit, VisitRecord};
use rayo::internals::kernels::{Isa, Vec4};
use rayo::internals::render::{Engine, EngineError, Film, FilmMut, Found, PixelFormat, Precision};
use rayo::internals::scene::{Object, Scene};
use shadow::{Shadow, ShadowedStep};

/// How many instructions are followed at most to find those of a pixel. They make the pixel and its
/// neighbours or, with packets, its tile.
const MOST_VISITS: usize = 1 << 20;

/// How many of the instructions that lose the most digits are listed.
const DEAREST: usize = 3;

/// Which ray of a scene to watch, and how.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub engine: Engine,
    /// The precision; None for the engine's own.
    pub precision: Option<Precision>,
    /// The pixel's column and row.
    pub pixel: (u32, u32),
    /// The lane of the packet to show; None for the pixel's own.
    pub lane: Option<usize>,
    /// The largest number of instructions to record.
    pub most: usize,
}

/// Why there is nothing to watch.
#[derive(Debug, thiserror::Error)]
pub enum WatchError {
    #[error("{0}")]
    Engine(String),
    /// The scene has shadows, and the engine has none.
    #[error("the engine `{0}` has no shadows, as in the paper, and this scene has: packets have them, --engine auto")]
    NoShadows(Engine),
    #[error(transparent)]
    Prepare(#[from] EngineError),
    #[error("there is no pixel {},{}: the picture has {} columns and {} rows, counted from 0", .pixel.0, .pixel.1, .size.0, .size.1)]
    Pixel {
        /// Column and row.
        pixel: (u32, u32),
        /// Width and height.
        size: (u32, u32),
    },
    #[error("there is no lane {lane}: {}", if *lanes == 1 { "this engine traces ray by ray".into() } else { format!("the packet has {lanes}, counted from 0, and the picture no pixel beyond its edge") })]
    Lane {
        /// The requested lane.
        lane: usize,
        /// The number of lanes.
        lanes: usize,
    },
    #[error("instructions cannot be watched here: {0}")]
    Unavailable(#[from] Unavailable),
    /// Making the pixel takes more instructions than can be followed.
    #[error(
        "to make this pixel takes more than the {MOST_VISITS} instructions that can be followed: {}a scene with fewer objects",
        if .0.is_packet() { "choose " } else { "choose packets by --engine auto, or " }
    )]
    TooLong(Engine),
    #[error(
        "this takes {needed} instructions, more than the {most} that are recorded: add --steps {needed}, or show another pixel"
    )]
    TooMany {
        /// The number of instructions that would be recorded.
        needed: u64,
        /// The limit.
        most: usize,
    },
    #[error("{0}")]
    Operation(String),
    #[error("there is not enough memory for a row of the picture")]
    Memory,
    #[error("two runs of the same row took {0} and {1} instructions: nothing can be said of one pixel")]
    Differs(u64, u64),
}

/// The watched instructions: the `step` document without its schema number.
#[derive(Debug, Default, Serialize)]
pub struct Watched {
    pub engine: &'static str,
    pub precision: &'static str,
    /// The pixel's column and row; null for an operation.
    pub pixel: Option<[u32; 2]>,
    /// The lane of the packet that is shown.
    pub lane: Option<usize>,
    /// The number of lanes of a packet; 1 for engines that trace ray by ray.
    pub lanes: usize,
    /// The number of instructions shown.
    pub instructions: usize,
    /// The number of instructions that the model does not know, or for which its prediction
    /// differed from the CPU in some bit.
    pub unknown: usize,
    /// How many bits of registers and memory were compared with the model. All were equal, except
    /// at the instructions that `unknown` counts.
    pub bits_compared: u64,
    /// The instructions that lose the most digits, as indices into `steps`, the worst first.
    pub dearest: Vec<usize>,
    /// Each instruction, in the order of execution.
    pub steps: Vec<Line>,
    pub hit: Option<Hit>,
    /// The pixel's colour: linear red, green and blue.
    pub colour: Option<[f32; 3]>,
    /// The result of the operation.
    pub result: Option<Vec<f32>>,
    /// Whether the operation's twin returns the same bits; null for a scene.
    pub same_as_twin: Option<bool>,
    /// How a kernel failed: a result that differs from its twin's, a broken rule of the calling
    /// convention, or a crash.
    pub failure: Option<String>,
    pub kinds: Mix,
    /// The instructions as a tree, ordered as in the source, to be printed as text or as a page.
    #[serde(skip)]
    pub tree: Vec<Node>,
}

/// The hit of a ray.
#[derive(Debug, Serialize)]
pub struct Hit {
    /// The object, such as `sphere 0`.
    pub object: String,
    /// The distance along the ray, as a multiple of the length of r_d.
    pub t: f64,
    pub point: [f64; 3],
    /// The unit normal, if the engine computes one.
    pub normal: Option<[f64; 3]>,
}

impl Hit {
    fn new(found: &Found, direction: DVec3) -> Self {
        let t = found.distance.t();
        let object = match found.object {
            Object::Sphere(index) => format!("sphere {index}"),
            Object::Triangle(index) => format!("triangle {index}"),
        };
        Hit { object, t, point: (direction * t).into(), normal: found.normal.map(Into::into) }
    }
}

/// The instruction set of an engine's kernels, if it has kernels in assembly.
fn isa(engine: Engine) -> Result<Isa, WatchError> {
    match engine {
        Engine::Paper => Ok(Isa::Sse41),
        Engine::Packet(isa) => Ok(isa),
        Engine::C => Err(WatchError::Engine(format!(
            "`c` is compiled, and its instructions have no macros to be told by: `rayo ops --engine c --asm` lists them; \
             {} can be watched",
            watchable()
        ))),
        other => Err(WatchError::Engine(format!(
            "`{other}` is Rust, which has no kernel to watch: watch paper, the same computation in assembly; {} can be watched",
            watchable()
        ))),
    }
}

/// The names of the engines that can be watched on this machine.
fn watchable() -> String {
    let engines =
        Engine::ALL.iter().filter(|engine| engine.usable() && matches!(engine, Engine::Paper | Engine::Packet(_)));
    engines.map(|engine| engine.name()).collect::<Vec<_>>().join(", ")
}

/// The number of rays of a packet; 1 for an engine that traces ray by ray.
fn lanes(engine: Engine, precision: Option<Precision>) -> usize {
    match engine {
        Engine::Packet(isa) if precision == Some(Precision::Double) => isa.lanes() / 2,
        Engine::Packet(isa) => isa.lanes(),
        _ => 1,
    }
}

/// The kernels of an engine's instruction set.
fn unit(engine: Engine, isa: Isa) -> Result<&'static Unit, WatchError> {
    if !engine.usable() {
        return Err(EngineError::Unusable(engine).into());
    }
    Unit::of(isa).ok_or(WatchError::Unavailable(Unavailable::Platform))
}

/// Checks that the picture has the ray's pixel, and that the engine has shadows if the scene does.
fn check_ray(scene: &Scene, ray: &Ray) -> Result<(), WatchError> {
    let size = (scene.camera.width(), scene.camera.height());
    if ray.pixel.0 >= size.0 || ray.pixel.1 >= size.1 {
        return Err(WatchError::Pixel { pixel: ray.pixel, size });
    }
    if scene.shadows && !ray.engine.has_shadows() {
        return Err(WatchError::NoShadows(ray.engine));
    }
    Ok(())
}

/// Watches the instructions that make a pixel.
pub fn watch(scene: &Scene, ray: &Ray) -> Result<Watched, WatchError> {
    let Ray { engine, precision, pixel, most, .. } = *ray;
    let unit = unit(engine, isa(engine)?)?;
    check_ray(scene, ray)?;
    let tracer = engine.prepare(precision, scene)?;
    let width = scene.camera.width();
    let mut film = Film::new(PixelFormat::F32x4, width as usize).map_err(|_| WatchError::Memory)?;
    let FilmMut::F32x4(pixels) = film.as_mut() else { unreachable!("the film was made so") };
    let film = RowOfFilm { address: pixels.as_ptr() as u64, width };
    let row = pixel.1..pixel.1 + 1;
    // With packets only the pixel's tile is traced. Otherwise the pixel and its neighbours are, so
    // that work that is done once per row can be told from work per pixel.
    let near = u32::from(!engine.is_packet());
    let rows_of_tile = |rows: Range<u32>, columns: Range<u32>| {
        if columns.start <= pixel.0 + near && pixel.0 < columns.end + near { rows } else { 0..0 }
    };
    let mut trace = || _ = tracer.light(row.clone(), &rows_of_tile, Vec4::default(), pixels);
    // The row is traced once before, unwatched, so that work of a first call is not shown.
    let failed = check::kernels_in(&mut trace).err();
    let precision = precision.unwrap_or(engine.precision()).name();
    if failed.as_ref().is_some_and(|failed| matches!(failed.what, What::Crash(_))) {
        let last = watch_crash(unit, engine, &mut trace, most)?;
        return Ok(Watched { engine: engine.name(), precision, pixel: Some(pixel.into()), ..last });
    }
    let visits = visits_of_row(unit, engine, &mut trace)?;
    let calls = calls(unit, &visits);
    let run = Run { visits: &visits, film: film.bytes(0..width), pixel: film.bytes(pixel.0..pixel.0 + 1) };
    let recording = record_pixel(unit, &run, &calls, most, &mut trace)?;
    let seen = Candidate::of(recording.steps());
    let shown = shown_pixel(ray, &seen.steps, &film)?;
    let run = Run { pixel: film.bytes(shown.column..shown.column + 1), ..run };
    let by_number: HashMap<u64, usize> = seen.steps.iter().enumerate().map(|(at, s)| (s.step.number, at)).collect();
    let items = run.items(&calls, &by_number, &shown.slice);
    let mut watched = seen.tell(unit, &items, &shown.slice, shown.lane);
    let found = tracer.hits(row).swap_remove(shown.column as usize);
    let direction = DVec3::from(scene.camera.grid::<f64>().ray(pixel.1, shown.column));
    let colour = pixels[shown.column as usize];
    watched.failure = failed.map(|failed| failed.to_string());
    watched.hit = found.map(|found| Hit::new(&found, direction));
    watched.colour = Some([colour.x, colour.y, colour.z]);
    watched.pixel = Some([shown.column, pixel.1]);
    watched.lanes = lanes(engine, ray.precision);
    watched.engine = engine.name();
    watched.precision = precision;
    Ok(watched)
}

/// The pixels of a row in memory, each a [`Vec4`].
struct RowOfFilm {
    address: u64,
    width: u32,
}

impl RowOfFilm {
    /// The addresses of the pixels in some columns.
    fn bytes(&self, columns: Range<u32>) -> Range<u64> {
        let address = |column: u32| self.address + u64::from(column) * size_of::<Vec4>() as u64;
        address(columns.start)..address(columns.end)
    }
}

/// The instructions that `trace` executes in kernels, without their registers.
fn visits_of_row(unit: &Unit, engine: Engine, trace: &mut dyn FnMut()) -> Result<Vec<Visit>, WatchError> {
    let VisitRecord { visits, complete } = step::visits(from_ref(&unit.code), MOST_VISITS, trace)?;
    if complete { Ok(visits) } else { Err(WatchError::TooLong(engine)) }
}

/// Runs `trace` again, and records those instructions that may contribute to the pixel. It is an
/// error if they are more than `most`.
fn record_pixel(
    unit: &Unit,
    run: &Run<'_>,
    calls: &[Vec<Stretch>],
    most: usize,
    trace: &mut dyn FnMut(),
) -> Result<Recording, WatchError> {
    let wanted = run.wanted(calls);
    let needed: u64 = wanted.iter().map(|range| range.end - range.start).sum();
    if needed > most as u64 {
        return Err(WatchError::TooMany { needed, most });
    }
    let recording = step::record_kernels(from_ref(&unit.code), &wanted, needed as usize, trace)?;
    let executed = run.visits.len() as u64;
    if recording.executed != executed {
        return Err(WatchError::Differs(executed, recording.executed));
    }
    Ok(recording)
}

/// The pixel that is shown: the requested one or, if another lane was requested, the pixel of the
/// same packet in that lane.
struct ShownPixel {
    column: u32,
    /// The pixel's lane, if the engine traces packets.
    lane: Option<usize>,
    /// What each recorded instruction contributes to the pixel.
    slice: Vec<slice::Contribution>,
}

/// Finds the lane of the ray's pixel, and from that the pixel in the requested lane.
fn shown_pixel(ray: &Ray, steps: &[ShadowedStep<'_>], film: &RowOfFilm) -> Result<ShownPixel, WatchError> {
    let slice_of = |column: u32| {
        let bytes = film.bytes(column..column + 1);
        slice::slice(steps, bytes.map(|byte| Element::new(Place::Memory, byte, 1)))
    };
    let column = ray.pixel.0;
    let slice = slice_of(column);
    let lanes = lanes(ray.engine, ray.precision);
    let lane_of_pixel = lane_of(steps, &slice).filter(|_| lanes > 1);
    let Some(lane) = ray.lane else { return Ok(ShownPixel { column, lane: lane_of_pixel, slice }) };
    let column = i64::from(column) + lane as i64 - lane_of_pixel.map_or(0, |lane| lane as i64);
    let has_no_lane = lane_of_pixel.is_none() && lanes > 1;
    if lane >= lanes || has_no_lane || column < 0 || column >= i64::from(film.width) {
        return Err(WatchError::Lane { lane, lanes });
    }
    let column = column as u32;
    Ok(ShownPixel { column, lane: (lanes > 1).then_some(lane), slice: slice_of(column) })
}

/// Watches one operation on given vectors.
pub fn watch_operation(op: &str, engine: Engine, a: Vec<f32>, b: Option<Vec<f32>>) -> Result<Watched, WatchError> {
    let isa = isa(engine)?;
    let unit = unit(engine, isa)?;
    let operation = operation::Operation::new(op, engine, isa, a, b)?;
    let mut result = Vec::new();
    let watched = [unit.code.clone()];
    let all = 0..u64::MAX;
    let recording = step::record_until_crash(&watched, from_ref(&all), operation::MOST, || result = operation.call())?;
    let lanes = lanes(engine, None);
    let mut watched = tell_call(unit, &recording, (lanes > 1).then_some(0));
    watched.engine = engine.name();
    watched.precision = Precision::Single.name();
    watched.lanes = lanes;
    if recording.crashed.is_none() {
        watched.result = Some(result);
        let checked = operation.check();
        watched.same_as_twin = Some(!matches!(&checked, Err(failed) if matches!(failed.what, What::Result(_))));
        watched.failure = checked.err().map(|failed| failed.to_string());
    }
    Ok(watched)
}

/// Describes all instructions of one call of a kernel, and the crash that may have ended it.
fn tell_call(unit: &'static Unit, recording: &Recording, lane: Option<usize>) -> Watched {
    let seen = Candidate::of(recording.steps());
    let call = (0..seen.steps.len()).map(Item::Step).collect();
    let nothing = vec![slice::Contribution::default(); seen.steps.len()];
    let failure = recording.crashed.clone().map(|crashed| What::Crash(crashed).to_string());
    Watched { failure, ..seen.tell(unit, &[call], &nothing, lane) }
}

/// Watches the call of a kernel that crashes: the last `most` instructions of it, if it executes at
/// most [`MOST_VISITS`].
fn watch_crash(
    unit: &'static Unit,
    engine: Engine,
    trace: &mut dyn FnMut(),
    most: usize,
) -> Result<Watched, WatchError> {
    let watched = [unit.code.clone()];
    let VisitRecord { visits, complete } = step::visits_until_crash(&watched, MOST_VISITS, &mut *trace)?;
    if !complete {
        return Err(WatchError::TooLong(engine));
    }
    let start = calls(unit, &visits).last().map_or(0, |call| range_of(call).start);
    let start = start.max(visits.len().saturating_sub(most));
    let wanted = start as u64..visits.len() as u64;
    let recording = step::record_until_crash(&watched, from_ref(&wanted), visits.len() - start, trace)?;
    Ok(Watched { lanes: 1, ..tell_call(unit, &recording, None) })
}

/// Divides the executed instructions into calls of kernels, and each call into straight code and
/// loops.
fn calls(unit: &Unit, visits: &[Visit]) -> Vec<Vec<Stretch>> {
    let is_entry = |visit: &Visit| {
        unit.function(visit.rip as usize).is_some_and(|function| function.address == visit.rip as usize)
    };
    let mut starts: Vec<_> = (0..visits.len()).filter(|&number| is_entry(&visits[number])).collect();
    starts.push(visits.len());
    starts.windows(2).map(|call| parts_of_call(visits, call[0]..call[1])).collect()
}

/// A row of the picture whose instructions were followed.
struct Run<'a> {
    visits: &'a [Visit],
    /// The addresses of the row's pixels; `pixel` are those of the watched pixel.
    film: Range<u64>,
    pixel: Range<u64>,
}

/// What is shown of a kernel's call; items are in the order of execution.
enum Item {
    /// An instruction, by its index among the recorded ones.
    Step(usize),
    /// An instruction that the row executes once, not for each pixel, by its index among the
    /// recorded ones.
    Once(usize),
    /// Rounds of a loop, or a call of a kernel, that contribute only to other pixels.
    Others { rounds: usize, instructions: usize },
}

impl Run<'_> {
    fn touches(&self, range: &Range<usize>, bytes: &Range<u64>) -> bool {
        self.visits[range.clone()]
            .iter()
            .any(|visit| visit.address < bytes.end && bytes.start < visit.address + u64::from(visit.bytes))
    }

    /// Whether a round of a loop is left out because it writes to the film, but not to the watched
    /// pixel.
    fn is_of_others(&self, round: &[Stretch]) -> bool {
        let range = range_of(round);
        self.touches(&range, &self.film) && !self.touches(&range, &self.pixel)
    }

    /// The numbers of the instructions to record: all, except those of rounds that make other
    /// pixels.
    fn wanted(&self, calls: &[Vec<Stretch>]) -> Vec<Range<u64>> {
        fn add(run: &Run<'_>, parts: &[Stretch], wanted: &mut Vec<Range<u64>>) {
            for part in parts {
                match part {
                    Stretch::Straight(range) => {
                        let range = range.start as u64..range.end as u64;
                        match wanted.last_mut() {
                            Some(last) if last.end == range.start => last.end = range.end,
                            _ => wanted.push(range),
                        }
                    }
                    Stretch::Loop(rounds) => {
                        for round in rounds.iter().filter(|round| !run.is_of_others(round)) {
                            add(run, round, wanted);
                        }
                    }
                }
            }
        }
        let mut wanted = Vec::new();
        for call in calls {
            add(self, call, &mut wanted);
        }
        wanted
    }

    /// What is shown of each call. Of a kernel that contributes to the pixel these are the rounds
    /// that do. A call that does not is counted with the call before it.
    fn items(
        &self,
        calls: &[Vec<Stretch>],
        by_number: &HashMap<u64, usize>,
        slice: &[slice::Contribution],
    ) -> Vec<Vec<Item>> {
        let mut told: Vec<Vec<Item>> = Vec::new();
        for call in calls {
            let range = range_of(call);
            if !self.has_to_do(&range, by_number, slice) {
                if told.is_empty() {
                    told.push(Vec::new());
                }
                add_to_others(told.last_mut().expect("there is one"), range.len());
                continue;
            }
            let mut items = Vec::new();
            self.add(call, by_number, slice, false, &mut items);
            // A kernel without a loop over pixels makes the pixel by all of its instructions. In
            // any other kernel the instructions outside of that loop belong to the row.
            if !items.iter().any(|item| matches!(item, Item::Step(_))) {
                for item in &mut items {
                    if let Item::Once(at) = *item {
                        *item = Item::Step(at);
                    }
                }
            }
            told.push(items);
        }
        told
    }

    fn has_to_do(&self, range: &Range<usize>, by_number: &HashMap<u64, usize>, slice: &[slice::Contribution]) -> bool {
        let of = |number: usize| by_number.get(&(number as u64)).is_some_and(|&at| slice[at].any());
        range.clone().any(of)
    }

    /// Adds items for `parts`. If `within`, the parts belong to a round that makes only this pixel,
    /// so that their instructions belong to the pixel and not to the row.
    fn add(
        &self,
        parts: &[Stretch],
        by_number: &HashMap<u64, usize>,
        slice: &[slice::Contribution],
        within: bool,
        items: &mut Vec<Item>,
    ) {
        for part in parts {
            match part {
                Stretch::Straight(range) => {
                    let recorded = range.clone().filter_map(|number| by_number.get(&(number as u64)));
                    items.extend(recorded.map(|&at| if within { Item::Step(at) } else { Item::Once(at) }));
                }
                Stretch::Loop(rounds) => {
                    for round in rounds {
                        let range = range_of(round);
                        let makes_it = self.touches(&range, &self.film) && self.touches(&range, &self.pixel);
                        let tell = within || makes_it || self.has_to_do(&range, by_number, slice);
                        if tell && !self.is_of_others(round) {
                            self.add(round, by_number, slice, within || makes_it, items);
                        } else {
                            add_to_others(items, range.len());
                        }
                    }
                }
            }
        }
    }
}

fn add_to_others(items: &mut Vec<Item>, more: usize) {
    match items.last_mut() {
        Some(Item::Others { rounds, instructions }) => {
            *rounds += 1;
            *instructions += more;
        }
        _ => items.push(Item::Others { rounds: 1, instructions: more }),
    }
}

/// The recorded instructions, each with the model's results and the exact values.
struct Candidate<'a> {
    steps: Vec<ShadowedStep<'a>>,
}

impl<'a> Candidate<'a> {
    fn of(steps: impl Iterator<Item = Step<'a>>) -> Self {
        let mut shadow = Shadow::new();
        Candidate { steps: steps.map(|step| ShadowedStep { step, error: shadow.step(&step) }).collect() }
    }

    /// Describes the recorded instructions of `calls`. The caller fills in what was watched.
    fn tell(
        &self,
        unit: &'static Unit,
        calls: &[Vec<Item>],
        slice: &[slice::Contribution],
        lane: Option<usize>,
    ) -> Watched {
        let mut describer = Describer::new(unit, lane);
        let mut lines = Vec::new();
        let mut line_of = HashMap::new();
        let mut kinds = Vec::new();
        for item in calls.iter().flatten() {
            let &(Item::Step(at) | Item::Once(at)) = item else { continue };
            let DescribedStep { line, instruction } = describer.line(&self.steps[at], &slice[at]);
            kinds.push(instruction);
            line_of.insert(at, lines.len());
            lines.push(line);
        }
        let tree = tree::grow(unit, calls, &self.steps, &line_of, lane);
        let mut dearest: Vec<_> = (0..lines.len()).filter(|&at| lines[at].cost() > 0.0).collect();
        dearest.sort_by(|&a, &b| lines[b].cost().total_cmp(&lines[a].cost()));
        dearest.truncate(DEAREST);
        Watched {
            lane,
            instructions: lines.len(),
            unknown: self.steps.iter().filter(|step| describe::unknown(&step.error).is_some()).count(),
            bits_compared: self.steps.iter().filter_map(|step| step.error.check.as_ref().ok()).map(|c| c.bits).sum(),
            dearest,
            steps: lines,
            kinds: Mix::of(&kinds),
            tree,
            ..Watched::default()
        }
    }
}

/// The lane in which most of the pixel's arithmetic is done.
fn lane_of(steps: &[ShadowedStep<'_>], slice: &[slice::Contribution]) -> Option<usize> {
    let mut counts: HashMap<u64, usize> = HashMap::new();
    for (ShadowedStep { error, .. }, part) in steps.iter().zip(slice) {
        for made in &part.made {
            let Operation { to, what, .. } = &error.operations[made.operation];
            if let (Place::Vector(_), model::What::Float(..)) = (to.place, what) {
                *counts.entry(to.at / u64::from(to.bits)).or_default() += 1;
            }
        }
    }
    counts.into_iter().max_by_key(|&(lane, count)| (count, std::cmp::Reverse(lane))).map(|(lane, _)| lane as usize)
}
