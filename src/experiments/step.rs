//! One ray through the kernels that trace it, or one operation: every instruction, in the words of its source.

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

use describe::Describer;
pub use describe::{Branch, Change, Line, MacroCall, Value};
pub use tree::{Argument, Node};

use crate::kernels::step::{self, Step, Unavailable, Visit};
use crate::kernels::{Isa, Vec4};
use crate::measure::instructions::Mix;
use crate::measure::source::Unit;
use crate::render::{Engine, EngineError, Film, FilmMut, Found, PixelFormat, Precision};
use crate::scene::{Object, Scene};
use model::{Element, Operation, Place};
use parts::{Part, parts_of_call, range_of};
use shadow::{Shadow, StepError};

/// Instructions of a pixel and its neighbours, or of its tile, that are followed at most, to find those of the pixel.
const MOST_VISITS: usize = 1 << 20;

/// The instructions that cost most digits, that are named.
const DEAREST: usize = 3;

/// What to watch of a scene.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub engine: Engine,
    /// In what numbers; None: the engine's own.
    pub precision: Option<Precision>,
    /// Column and row.
    pub pixel: (u32, u32),
    /// A lane of the packet, in place of the pixel's own.
    pub lane: Option<usize>,
    /// The most instructions to record.
    pub most: usize,
}

/// Why there is nothing to watch.
#[derive(Debug, thiserror::Error)]
pub enum WatchError {
    #[error("{0}")]
    Engine(String),
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
        /// As it was asked for.
        lane: usize,
        /// Those that there are.
        lanes: usize,
    },
    #[error("instructions cannot be watched here: {0}")]
    Unavailable(#[from] Unavailable),
    /// A pixel that is too much work to be followed.
    #[error(
        "to make this pixel takes more than the {MOST_VISITS} instructions that can be followed: choose packets by --engine, or a scene with fewer objects"
    )]
    TooLong,
    #[error("this takes {needed} instructions, more than the {most} that are recorded: raise --steps")]
    TooMany {
        /// Instructions that would be recorded.
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

/// What was watched: the `step` document without its schema.
#[derive(Debug, Default, Serialize)]
pub struct Watched {
    pub engine: &'static str,
    pub precision: &'static str,
    /// Column and row; null for an operation.
    pub pixel: Option<[u32; 2]>,
    /// The lane that is told of, of a packet.
    pub lane: Option<usize>,
    /// Those of a packet; 1 for engines that trace ray by ray.
    pub lanes: usize,
    /// Instructions that are told of.
    pub instructions: usize,
    /// Those that the model does not know, or of which it had other bits.
    pub unknown: usize,
    /// Bits of registers and memory that were held against the model, and all were the same but for what `unknown` counts.
    pub bits_compared: u64,
    /// The instructions that cost most digits, by their places in `steps`, the worst first.
    pub dearest: Vec<usize>,
    /// Each instruction, in the order of execution.
    pub steps: Vec<Line>,
    pub hit: Option<Hit>,
    /// What the pixel shows: linear red, green and blue.
    pub colour: Option<[f32; 3]>,
    /// What the operation gives.
    pub result: Option<Vec<f32>>,
    pub kinds: Mix,
    /// The same in the order of the source, for those who read.
    #[serde(skip)]
    pub tree: Vec<Node>,
}

/// What a ray hits.
#[derive(Debug, Serialize)]
pub struct Hit {
    /// The object, such as `sphere 0`.
    pub object: String,
    /// Where, in lengths of r_d.
    pub t: f64,
    pub point: [f64; 3],
    /// The unit normal, where the engine can tell.
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
        Engine::C => Err(WatchError::Engine(
            "`c` is compiled, and its instructions have no macros to be told by: `rayo ops --engine c --asm` lists them; \
             paper, sse41, avx2 and avx512 can be watched"
                .into(),
        )),
        other => Err(WatchError::Engine(format!(
            "`{other}` is Rust, which has no kernel to watch: try paper, the same computation in assembly, or sse41, avx2, avx512"
        ))),
    }
}

/// Rays of a packet; 1 for an engine that traces one by one.
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

/// Watches how a pixel is made.
pub fn watch(scene: &Scene, ray: &Ray) -> Result<Watched, WatchError> {
    let Ray { engine, precision, pixel, most, .. } = *ray;
    let unit = unit(engine, isa(engine)?)?;
    let (width, height) = (scene.camera.width(), scene.camera.height());
    if pixel.0 >= width || pixel.1 >= height {
        return Err(WatchError::Pixel { pixel, size: (width, height) });
    }
    let tracer = engine.prepare(precision, scene)?;
    let mut film = Film::new(PixelFormat::F32x4, width as usize).map_err(|_| WatchError::Memory)?;
    let row = pixel.1..pixel.1 + 1;
    let FilmMut::F32x4(pixels) = film.as_mut() else { unreachable!("the film was made so") };
    let first = pixels.as_ptr();
    let place = |column: u32| first.wrapping_add(column as usize) as u64;
    // Of packets the pixel's tile alone, else the pixel and its neighbours, so that what is once for the row is seen.
    let near = u32::from(!engine.is_packet());
    let of_pixel = |rows: Range<u32>, Range { start, end }: Range<u32>| {
        if start <= pixel.0 + near && pixel.0 < end + near { rows } else { 0..0 }
    };
    let mut trace = || _ = tracer.light(row.clone(), &of_pixel, Vec4::default(), pixels);
    // Once before: what is computed or bound at the first call is not the row's.
    trace();
    let watched = [unit.code.clone()];
    let (visits, all) = step::visits(&watched, MOST_VISITS, &mut trace)?;
    if !all {
        return Err(WatchError::TooLong);
    }
    let executed = visits.len() as u64;
    let calls = calls(unit, &visits);
    let mut run = Run { visits: &visits, film: place(0)..place(width), pixel: place(pixel.0)..place(pixel.0 + 1) };
    let wanted = run.wanted(&calls);
    let needed: u64 = wanted.iter().map(|range| range.end - range.start).sum();
    if needed > most as u64 {
        return Err(WatchError::TooMany { needed, most });
    }
    let recording = step::record(&watched, &wanted, needed as usize, &mut trace)?;
    if recording.executed != executed {
        return Err(WatchError::Differs(executed, recording.executed));
    }
    let seen = Candidate::of(recording.steps());
    let of_pixel = |bytes: &Range<u64>| (bytes.start..bytes.end).map(|byte| Element::new(Place::Memory, byte, 1));
    let mut slice = slice::slice(&seen.steps, of_pixel(&run.pixel));
    let lanes = lanes(engine, precision);
    let own = lane_of(&seen.steps, &slice).filter(|_| lanes > 1);
    let lane = match ray.lane {
        None => own,
        Some(lane) => {
            let column = i64::from(pixel.0) + lane as i64 - own.map_or(0, |own| own as i64);
            if lane >= lanes || own.is_none() && lanes > 1 || column < 0 || column >= i64::from(width) {
                return Err(WatchError::Lane { lane, lanes });
            }
            // The neighbour that is in that lane of the same packet.
            run.pixel = place(column as u32)..place(column as u32 + 1);
            slice = slice::slice(&seen.steps, of_pixel(&run.pixel));
            (lanes > 1).then_some(lane)
        }
    };
    let told = ray.lane.zip(own).map_or(pixel.0, |(lane, own)| pixel.0 + lane as u32 - own as u32);
    let by_number: HashMap<u64, usize> = seen.steps.iter().enumerate().map(|(at, (s, _))| (s.number, at)).collect();
    let told_calls = run.items(&calls, &by_number, &slice);
    let mut watched = seen.tell(unit, &told_calls, &slice, lane);
    let found = tracer.hits(row).swap_remove(told as usize);
    let direction = DVec3::from(scene.camera.grid::<f64>().ray(pixel.1, told));
    let colour = pixels[told as usize];
    watched.hit = found.map(|found| Hit::new(&found, direction));
    watched.colour = Some([colour.x, colour.y, colour.z]);
    watched.pixel = Some([told, pixel.1]);
    watched.lanes = lanes;
    watched.engine = engine.name();
    watched.precision = precision.unwrap_or(engine.precision()).name();
    Ok(watched)
}

/// Watches one operation on vectors of one's own.
pub fn watch_operation(op: &str, engine: Engine, a: Vec<f32>, b: Option<Vec<f32>>) -> Result<Watched, WatchError> {
    let isa = isa(engine)?;
    let unit = unit(engine, isa)?;
    let operation = operation::Operation::new(op, engine, isa, a, b)?;
    let mut result = Vec::new();
    let watched = [unit.code.clone()];
    let all = 0..u64::MAX;
    let recording = step::record(&watched, from_ref(&all), operation::MOST, || result = operation.call())?;
    let seen = Candidate::of(recording.steps());
    let call = (0..seen.steps.len()).map(Item::Step).collect();
    let nothing = vec![slice::Part::default(); seen.steps.len()];
    let lanes = lanes(engine, None);
    let mut watched = seen.tell(unit, &[call], &nothing, (lanes > 1).then_some(0));
    watched.engine = engine.name();
    watched.precision = Precision::Single.name();
    watched.lanes = lanes;
    watched.result = Some(result);
    Ok(watched)
}

/// The calls of kernels, as rows of visits, each with its parts.
fn calls(unit: &Unit, visits: &[Visit]) -> Vec<Vec<Part>> {
    let is_entry = |visit: &Visit| unit.function(visit.rip as usize).is_some_and(|(_, at)| at == visit.rip as usize);
    let mut starts: Vec<_> = (0..visits.len()).filter(|&number| is_entry(&visits[number])).collect();
    starts.push(visits.len());
    starts.windows(2).map(|call| parts_of_call(visits, call[0]..call[1])).collect()
}

/// A row that was traced.
struct Run<'a> {
    visits: &'a [Visit],
    /// Where the row's pixels are, and the one that is watched.
    film: Range<u64>,
    pixel: Range<u64>,
}

/// What is told of a kernel's call, in the order of execution.
enum Item {
    /// An instruction, by its place among those recorded.
    Step(usize),
    /// The same, which the row needs once, and not for each pixel.
    Once(usize),
    /// Rounds of a loop, or a kernel's call, that are for other pixels.
    Others { rounds: usize, instructions: usize },
}

impl Run<'_> {
    fn touches(&self, range: &Range<usize>, bytes: &Range<u64>) -> bool {
        self.visits[range.clone()]
            .iter()
            .any(|visit| visit.address < bytes.end && bytes.start < visit.address + u64::from(visit.bytes))
    }

    /// Whether a round is left out: it makes other pixels of the film.
    fn is_of_others(&self, round: &[Part]) -> bool {
        let range = range_of(round);
        self.touches(&range, &self.film) && !self.touches(&range, &self.pixel)
    }

    /// The numbers of what is to be recorded: all but the rounds that make other pixels.
    fn wanted(&self, calls: &[Vec<Part>]) -> Vec<Range<u64>> {
        fn add(run: &Run<'_>, parts: &[Part], wanted: &mut Vec<Range<u64>>) {
            for part in parts {
                match part {
                    Part::Row(range) => {
                        let range = range.start as u64..range.end as u64;
                        match wanted.last_mut() {
                            Some(last) if last.end == range.start => last.end = range.end,
                            _ => wanted.push(range),
                        }
                    }
                    Part::Loop(rounds) => {
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

    /// What is told of each call: of kernels that have to do with the pixel, the rounds that do. Others are told of with the call
    /// before them.
    fn items(&self, calls: &[Vec<Part>], by_number: &HashMap<u64, usize>, slice: &[slice::Part]) -> Vec<Vec<Item>> {
        let mut told: Vec<Vec<Item>> = Vec::new();
        for call in calls {
            let range = range_of(call);
            if !self.has_to_do(&range, by_number, slice) {
                if told.is_empty() {
                    told.push(Vec::new());
                }
                others(told.last_mut().expect("there is one"), range.len());
                continue;
            }
            let mut items = Vec::new();
            self.add(call, by_number, slice, false, &mut items);
            // Where a kernel makes pixels in the rounds of a loop, the rest is the row's.
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

    fn has_to_do(&self, range: &Range<usize>, by_number: &HashMap<u64, usize>, slice: &[slice::Part]) -> bool {
        let of = |number: usize| by_number.get(&(number as u64)).is_some_and(|&at| slice[at].any());
        range.clone().any(of)
    }

    /// `within`: the parts are of a round that makes the pixel alone, so that all of it is told.
    fn add(
        &self,
        parts: &[Part],
        by_number: &HashMap<u64, usize>,
        slice: &[slice::Part],
        within: bool,
        items: &mut Vec<Item>,
    ) {
        for part in parts {
            match part {
                Part::Row(range) => {
                    let recorded = range.clone().filter_map(|number| by_number.get(&(number as u64)));
                    items.extend(recorded.map(|&at| if within { Item::Step(at) } else { Item::Once(at) }));
                }
                Part::Loop(rounds) => {
                    for round in rounds {
                        let range = range_of(round);
                        let makes_it = self.touches(&range, &self.film) && self.touches(&range, &self.pixel);
                        let tell = within || makes_it || self.has_to_do(&range, by_number, slice);
                        if tell && !self.is_of_others(round) {
                            self.add(round, by_number, slice, within || makes_it, items);
                        } else {
                            others(items, range.len());
                        }
                    }
                }
            }
        }
    }
}

fn others(items: &mut Vec<Item>, more: usize) {
    match items.last_mut() {
        Some(Item::Others { rounds, instructions }) => {
            *rounds += 1;
            *instructions += more;
        }
        _ => items.push(Item::Others { rounds: 1, instructions: more }),
    }
}

/// Instructions that were recorded, with what the model and the exact values have to say of each.
struct Candidate<'a> {
    steps: Vec<(Step<'a>, StepError)>,
}

impl<'a> Candidate<'a> {
    fn of(steps: impl Iterator<Item = Step<'a>>) -> Self {
        let mut shadow = Shadow::new();
        Candidate { steps: steps.map(|step| (step, shadow.step(&step))).collect() }
    }

    /// What there is to be told of some of them; what was watched is for the caller to add.
    fn tell(&self, unit: &'static Unit, calls: &[Vec<Item>], slice: &[slice::Part], lane: Option<usize>) -> Watched {
        let mut describer = Describer::new(unit, lane);
        let mut lines = Vec::new();
        let mut line_of = HashMap::new();
        let mut kinds = Vec::new();
        for item in calls.iter().flatten() {
            let &(Item::Step(at) | Item::Once(at)) = item else { continue };
            let (step, error) = &self.steps[at];
            let (line, instruction) = describer.line(step, error, &slice[at]);
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
            unknown: self.steps.iter().filter(|(_, error)| describe::unknown(error).is_some()).count(),
            bits_compared: self.steps.iter().filter_map(|(_, error)| error.check.as_ref().ok()).map(|c| c.bits).sum(),
            dearest,
            steps: lines,
            kinds: Mix::of(&kinds),
            tree,
            ..Watched::default()
        }
    }
}

/// The lane that most of the pixel's arithmetic is in.
fn lane_of(steps: &[(Step<'_>, StepError)], slice: &[slice::Part]) -> Option<usize> {
    let mut counts: HashMap<u64, usize> = HashMap::new();
    for ((_, error), part) in steps.iter().zip(slice) {
        for made in &part.made {
            let Operation { to, what, .. } = &error.operations[made.operation];
            if let (Place::Vector(_), model::What::Float(..)) = (to.place, what) {
                *counts.entry(to.at / u64::from(to.bits)).or_default() += 1;
            }
        }
    }
    counts.into_iter().max_by_key(|&(lane, count)| (count, std::cmp::Reverse(lane))).map(|(lane, _)| lane as usize)
}
