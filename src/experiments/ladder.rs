//! The ladder: one change at a time from the paper's C to the fastest engine, and each one's share of the factor.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::in_size;
use super::lab::{Bench, Case, LabError, Pairs, Progress, Taken, Turn, judged, kept};
use super::speedup::{self, Truth};
use crate::kernels::ladder::{self, Rung as Variant};
use crate::kernels::{self, ElementKernels, Isa, LaneTracer, Vec4, step, sys};
use crate::measure::statistics::{Estimate, median};
use crate::measure::{Clock, Name};
use crate::plan::{Packed, in_lanes};
use crate::render::{Engine, Film, FilmMut, Frame, LitTracer, PixelFormat, Purpose, Settings, Tracer};
use crate::scene::Scene;

/// The size that most rungs trace: small enough for the picture to stay in a second-level cache, and for a run to
/// be over before the operating system thinks of giving the core to another program.
pub const SIZE: (u32, u32) = (256, 192);
/// The size that the others trace, the paper's largest: by all cores, since the smaller one is done in less time than waking another
/// takes; and in closed form, by hand and compiled.
const LARGE: (u32, u32) = (1632, 1224);
/// Work of a round in a pixel.
const ROUND_WORK: u64 = 2400;

/// A rung. The field names are those of the JSON document.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Rung {
    pub rung: String,
    /// What is different from [`Rung::over`], in words.
    pub change: String,
    /// The compiler's flags, where they differ from those of the engine.
    pub flags: Name,
    /// The rung that it is compared with: the one before, or for an aside the one it departs from; None for the first.
    pub over: Option<String>,
    /// Whether it is an aside: the next rung does not build on it.
    pub aside: bool,
    pub threads: usize,
    /// Median TSC cycles of a pixel.
    pub cycles_per_pixel: f64,
    /// Instructions executed in a pixel, by single-stepping; None where they cannot be counted.
    pub instructions_per_pixel: Option<f64>,
    /// The median ratio of the cycles of [`Rung::over`] to its own, pair by pair.
    pub gain: f64,
    pub gain_low: f64,
    pub gain_high: f64,
    /// The same ratio against the first rung.
    pub gain_total: f64,
    /// Cycles of every run; of a larger picture, for as many of its pixels as the other rungs trace.
    pub samples: Vec<f64>,
    /// Of each of them, whether others had the core. Those are in no figure, unless they are more than half.
    pub taken: Vec<bool>,
    /// How many of them, one after the other, were taken in one process.
    pub samples_per_run: usize,
}

/// A packet engine beside what a compiler made for the same instruction set, to the same output.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct AgainstCompiler {
    pub engine: Name,
    /// The rung that the compiler made.
    pub compiled: Name,
    /// How many times as fast the engine is: the median ratio, pair by pair.
    pub ratio: f64,
    pub low: f64,
    pub high: f64,
}

/// Part of a factor.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct Share {
    pub cause: Name,
    /// The factor by itself.
    pub factor: f64,
    /// Its share of the whole on a logarithmic scale, where factors add up: all shares make 1.
    pub share: f64,
}

/// A factor taken apart.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Explanation {
    pub from: Name,
    pub to: Name,
    pub factor: f64,
    pub shares: Vec<Share>,
}

/// What the compiler vectorises, in the widest form that this CPU runs.
const WIDEST: &str = "turned";

/// The same by instruction set: the packet engine of the same, the name of the rung where it is not the widest, and of the
/// variant.
pub(super) const TURNED: [(&str, &str, &str); 3] = [
    ("sse41", "turned, sse41", "turned_sse41"),
    ("avx2", "turned, avx2", "turned_v3"),
    ("avx512", "turned, avx512", "turned_v4"),
];

/// The same levels: how rungs of a closed form are named after them, how their variants are, and the rung by hand where it is not
/// the widest.
const LEVELS: [(&str, &str, &str); 3] =
    [("sse41", "sse41", "large, sse41"), ("avx2", "v3", "large, avx2"), ("avx512", "v4", "large, avx512")];

/// The closed form of the experiment's sphere in bytes, compiled: the rung, the variant, and what is different from the kernel in
/// assembly.
const CLOSED: [(&str, &str, &str); 4] = [
    ("closed form in C", "closed", "the same rows in C, which the compiler vectorises"),
    ("closed form in C by Clang", "clang", "the same, by Clang"),
    ("closed form in Rust", "rust", "the same rows in Rust, which the compiler vectorises"),
    ("closed form in intrinsics", "intrinsics", "the same rows in C by intrinsics, with estimates of roots"),
];

/// The rung of the widest packets to bytes in the larger picture.
pub const WIDEST_BY_HAND: &str = "large";

/// The rung with a ray in each lane, in four of them; with more it is an aside.
const LANES: &str = "lanes";

/// What traces the picture of a rung.
enum Tracing {
    Variant(&'static Variant),
    Engine(Engine, PixelFormat),
    /// A ray in each lane.
    Lanes(&'static LaneTracer),
    /// Rows in closed form, to bytes.
    Rows(&'static Variant<ElementKernels<f32>>),
    /// The paper's macros in the best forms we know.
    Aos(&'static kernels::AosKernels),
    Threads(Engine, PixelFormat, usize),
}

/// A rung before it is measured.
struct Planned {
    rung: String,
    change: String,
    /// The rung that this one is an aside to, if it is an aside.
    aside_of: Option<&'static str>,
    tracing: Tracing,
}

/// Every rung that this CPU runs, in order. `whole` is all of it; else those that the claims need.
fn plan(whole: bool, cores: &sys::Cores) -> Vec<Planned> {
    let variant = |name: &str| ladder::C.iter().find(|rung| rung.name == name).expect("build.rs has it");
    // The widest level that this CPU runs stands for -march=native.
    let native = |names: &[&'static str]| names.iter().map(|name| variant(name)).find(|rung| rung.usable());
    let mut rungs = Vec::new();
    let mut rung = |rung: &str, change: &str, aside_of, tracing| {
        rungs.push(Planned { rung: rung.into(), change: change.into(), aside_of, tracing });
    };
    let c = |name| Tracing::Variant(variant(name));
    rung("c, called", "the paper's C with every small function called", None, c("calls"));
    let engine = |engine: Option<Engine>| Tracing::Engine(engine.expect("asm is built"), PixelFormat::F32x4);
    let by_name = |name: &str| Engine::ALL.iter().copied().find(|engine| engine.name() == name);
    if whole {
        // Passed by value, a vector is stored in halves; read back whole it waits for both.
        rung("c, called, scalar", "the same, no lanes found by the compiler", Some("c, called"), c("calls_scalar"));
    }
    rung("c", "the engine `c`: the same, inlined", Some("c, called"), engine(by_name(speedup::BASELINE)));
    rung("sqrtf", "roots by sqrtf, not pow", None, c("sqrtf"));
    rung("inlined", "small functions inlined", None, c("inlined"));
    rung("lean", "without r_o = 0, the 2 of eq. 5, the distance for which t stands", None, c("lean"));
    if whole {
        rung("nearest only", "only the nearest hit is shaded", None, c("nearest"));
        rung("hoisted", "constants of the scene computed once", None, c("hoisted"));
        if let Some(variant) = native(&["native_v4", "native_v3"]) {
            rung("native", "for this CPU's instructions, as -march=native", None, Tracing::Variant(variant));
        }
        if let Some(variant) = native(&["fast_v4", "fast_v3"]) {
            rung("fast-math", "-ffast-math", None, Tracing::Variant(variant));
        }
        let turned = TURNED.iter().map(|(_, name, of)| (*name, variant(of))).filter(|(_, rung)| rung.usable());
        for (place, (name, variant)) in turned.rev().enumerate() {
            match place {
                0 => rung(WIDEST, "arrays over pixels, which the compiler vectorises", None, Tracing::Variant(variant)),
                _ => rung(name, "the same for fewer lanes", Some(WIDEST), Tracing::Variant(variant)),
            }
        }
    }
    rung("paper", "the paper's SIMD", None, engine(by_name(speedup::CONTROL)));
    rung(
        "paper, called",
        "the same with calls in place of macros",
        Some("paper"),
        Tracing::Variant(&ladder::PAPER_CALLS),
    );
    if whole && let Some(kernels) = kernels::aos() {
        rung("paper, best forms", "the same without haddps", Some("paper"), Tracing::Aos(kernels));
    }
    let isas: Vec<_> = Isa::ALL.into_iter().filter(|isa| isa.usable()).collect();
    for isa in isas.iter().copied().filter(|_| whole) {
        let lanes = Tracing::Lanes(kernels::lane_tracer(isa).expect("the CPU supports it"));
        let packets = Tracing::Engine(Engine::Packet(isa), PixelFormat::F32x4);
        let asked = "a ray in each lane, which asks every object";
        if isa == Isa::Sse41 {
            rung(LANES, asked, None, lanes);
            rung(isa.name(), "packets of rays, in closed form", None, packets);
        } else {
            rung(isa.name(), "packets of more rays", None, packets);
            rung(&format!("{LANES}, {isa}"), asked, Some(isa.name()), lanes);
        }
    }
    let Some(&widest) = isas.last() else { return rungs };
    let bytes = |isa| Tracing::Engine(Engine::Packet(isa), PixelFormat::Rgba8);
    if whole {
        rung("rgba8", "8-bit output", None, bytes(widest));
    }
    let change = format!("a picture of {}×{}, which leaves that cache", LARGE.0, LARGE.1);
    rung(WIDEST_BY_HAND, &change, None, bytes(widest));
    for (isa, (name, level, narrower)) in isas.iter().zip(LEVELS).rev() {
        let by_hand = if *isa == widest { WIDEST_BY_HAND } else { narrower };
        if *isa != widest {
            if !whole {
                break;
            }
            rung(by_hand, "the same for fewer lanes", Some(WIDEST_BY_HAND), bytes(*isa));
        }
        for (way, of, change) in CLOSED {
            let variant = ladder::CLOSED.iter().find(|rung| rung.name == format!("{of}_{level}") && rung.usable());
            if let Some(variant) = variant {
                rung(&format!("{way}, {name}"), change, Some(by_hand), Tracing::Rows(variant));
            }
        }
    }
    if whole {
        let tracing = Tracing::Threads(Engine::Packet(widest), PixelFormat::Rgba8, cores.count());
        rung("threads", "the same by all cores", None, tracing);
    }
    rungs
}

impl Planned {
    fn size(&self) -> (u32, u32) {
        let is_large = matches!(self.tracing, Tracing::Rows(_) | Tracing::Threads(..));
        if is_large || self.rung.starts_with(WIDEST_BY_HAND) { LARGE } else { SIZE }
    }

    fn threads(&self) -> usize {
        if let Tracing::Threads(_, _, threads) = self.tracing { threads } else { 1 }
    }

    /// Instructions executed in a pixel, set-up of the engine and of a call not included. None with threads, which cannot be stepped
    /// through, and where [`step::count_instructions`] does not work.
    fn instructions(&self, scene: &Scene, cores: &sys::Cores) -> Result<Option<f64>, LabError> {
        let Counted { size: (width, height), step_by, call: (call_size, twice) } = match &self.tracing {
            Tracing::Threads(..) => return Ok(None),
            Tracing::Rows(_) => COUNTED_BY_SPANS,
            Tracing::Engine(engine, _) if engine.is_packet() => COUNTED_BY_SPANS,
            Tracing::Lanes(_) => COUNTED_BY_ROWS,
            Tracing::Variant(variant) if variant.name.starts_with("turned") => COUNTED_BY_ROWS,
            _ => COUNTED_ONE_BY_ONE,
        };
        // The cost of a call: what a call for each of two rows takes more than one call for both.
        let rows = [twice..twice + 1, twice + 1..twice + 2, twice..twice + 2];
        let Some(calls) = self.count(scene, cores, call_size, rows)? else { return Ok(None) };
        let call = (calls[0] + calls[1]).saturating_sub(calls[2]);
        let rows = (step_by as u32 / 2..height).step_by(step_by).map(|row| row..row + 1);
        let Some(rows) = self.count(scene, cores, (width, height), rows)? else { return Ok(None) };
        let pixels = rows.len() as f64 * f64::from(width);
        let sum: u64 = rows.iter().map(|row| row - call).sum();
        Ok(Some(sum as f64 / pixels))
    }

    /// Instructions of a call for each of `calls`, which are rows of a picture of `size`. None where
    /// [`step::count_instructions`] does not work.
    fn count(
        &self,
        scene: &Scene,
        cores: &sys::Cores,
        size: (u32, u32),
        calls: impl IntoIterator<Item = Range<u32>>,
    ) -> Result<Option<Vec<u64>>, LabError> {
        let scene = in_size(scene, size.0, size.1);
        let packed = Packed::new(&scene);
        let tracer = self.tracer(&scene)?;
        let case = self.case(tracer.as_deref(), &packed, &scene, cores)?;
        let mut film = Film::new(case.output, 2 * size.0 as usize)?;
        let count = |rows: Range<u32>| {
            let film = film.as_mut().part(0..rows.len() * size.0 as usize);
            step::count_instructions(|| case.rows(rows, film)).ok()
        };
        Ok(calls.into_iter().map(count).collect())
    }

    fn flags(&self) -> &'static str {
        match self.tracing {
            Tracing::Variant(variant) => variant.flags,
            Tracing::Rows(variant) => variant.flags,
            _ => "",
        }
    }

    /// The tracer of an engine, where it is one.
    fn tracer<'a>(&self, scene: &'a Scene) -> Result<Option<Box<dyn Tracer + 'a>>, LabError> {
        Ok(match self.tracing {
            Tracing::Engine(engine, _) | Tracing::Threads(engine, ..) => Some(engine.prepare(None, scene)?),
            Tracing::Rows(variant) => {
                let packets = Engine::fastest().packets().expect("kernels of rows stand beside those of packets");
                let tracer = LitTracer::new(packets, (variant.kernel(), false), scene, Purpose::default());
                Some(Box::new(tracer.expect("the experiment's sphere has the form")))
            }
            Tracing::Variant(_) | Tracing::Aos(_) | Tracing::Lanes(_) => None,
        })
    }

    fn case<'a>(
        &self,
        tracer: Option<&'a dyn Tracer>,
        packed: &'a Packed,
        scene: &Scene,
        cores: &sys::Cores,
    ) -> Result<Case<'a>, LabError> {
        let camera = scene.camera;
        let engine = || tracer.expect("an engine has one");
        Ok(match self.tracing {
            Tracing::Variant(variant) => Case::new(camera, PixelFormat::F32x4, move |rows, film| {
                variant.call(packed.frame(), packed.objects(), rows, floats(film));
            }),
            Tracing::Aos(kernels) => Case::new(camera, PixelFormat::F32x4, move |rows, film| {
                kernels.trace.call(packed.frame(), packed.objects(), rows, floats(film));
            }),
            Tracing::Lanes(tracer) => {
                let objects = in_lanes(scene, tracer);
                Case::new(camera, PixelFormat::F32x4, move |rows, film| {
                    tracer.call(packed.frame(), &objects, rows, floats(film));
                })
            }
            Tracing::Engine(..) | Tracing::Rows(_) => {
                let output = if let Tracing::Engine(_, output) = self.tracing { output } else { PixelFormat::Rgba8 };
                let tracer = engine();
                Case::new(camera, output, move |rows, film| tracer.rows(rows, film))
            }
            Tracing::Threads(_, output, threads) => {
                let frame = on_all(cores, || Frame::new(engine(), camera, Settings { threads }))??;
                Case::new(camera, output, move |rows, film| {
                    frame.trace(rows, film, &|_| ()).expect("a film of the rows' size");
                })
            }
        })
    }
}

/// The pixels of a film of floats.
pub(super) fn floats(film: FilmMut<'_>) -> &mut [Vec4] {
    if let FilmMut::F32x4(film) = film { film } else { unreachable!("its output is floats") }
}

/// Threads that `start` starts may run on `cores`, although this one is pinned.
pub fn on_all<T>(cores: &sys::Cores, start: impl FnOnce() -> T) -> Result<T, LabError> {
    let failed = |error| LabError::System { what: "change the cores that threads may run on", error };
    let pinned = sys::Cores::of_this_thread().map_err(failed)?;
    cores.allow().map_err(failed)?;
    let started = start();
    pinned.allow().map_err(failed)?;
    Ok(started)
}

/// The work of a round, in the unit of [`Progress`].
pub const WORK: u64 = SIZE.0 as u64 * SIZE.1 as u64 * ROUND_WORK;

/// Why the rungs have no count of instructions, where they cannot have one here.
pub fn uncounted() -> Option<String> {
    step::count_instructions(|| ()).err().map(|reason| reason.to_string())
}

/// Whether every rung's picture is that of the reference, and the instructions of a pixel of each, where it is the `whole`
/// ladder and they can be counted. `cores` are those that threads may run on. None where `proceed` says no.
pub fn check(
    whole: bool,
    cores: &sys::Cores,
    proceed: &mut Progress<'_>,
) -> Result<Option<Vec<Option<f64>>>, LabError> {
    let planned = plan(whole, cores);
    let truth = Truth::new(&speedup::scene())?;
    let scene = &truth.scene;
    let packed = Packed::new(scene);
    for rung in &planned {
        let tracer = rung.tracer(scene)?;
        truth.check(&rung.rung, &rung.case(tracer.as_deref(), &packed, scene, cores)?)?;
    }
    let mut instructions = Vec::new();
    for rung in &planned {
        if !proceed(0) {
            return Ok(None);
        }
        instructions.push(if whole { rung.instructions(scene, cores)? } else { None });
    }
    Ok(Some(instructions))
}

/// A clock by which all work is done once before it is timed: else the first rung of a size or a format would find its film out of
/// the caches, and not the next one.
struct Warm<'a>(&'a mut dyn Clock);

impl Clock for Warm<'_> {
    fn time(&mut self, work: &mut dyn FnMut()) -> u64 {
        work();
        self.0.time(work)
    }

    fn core(&mut self) -> Option<usize> {
        self.0.core()
    }

    fn taken(&mut self) -> bool {
        self.0.taken()
    }
}

/// The turns of each rung in `rounds`, in the order of the ladder.
pub type Rounds = Vec<Vec<Turn>>;

/// Measures those `rounds`, as part of a [run](speedup::measure_run).
pub fn measure_run(
    whole: bool,
    rounds: Range<usize>,
    cores: &sys::Cores,
    clock: &mut dyn Clock,
) -> Result<Rounds, LabError> {
    let planned = plan(whole, cores);
    let in_its_size = |rung: &Planned| in_size(&speedup::scene(), rung.size().0, rung.size().1);
    let scenes: Vec<_> = planned.iter().map(in_its_size).collect();
    let packed = Packed::new(&scenes[0]);
    let tracers = planned.iter().zip(&scenes).map(|(rung, scene)| rung.tracer(scene));
    let tracers = tracers.collect::<Result<Vec<_>, _>>()?;
    let cases = planned.iter().zip(&tracers).zip(&scenes);
    let cases = cases.map(|((rung, tracer), scene)| rung.case(tracer.as_deref(), &packed, scene, cores));
    let cases = cases.collect::<Result<Vec<_>, _>>()?;
    let measured = Bench::default().time(&mut Warm(clock), &cases, rounds, &mut || true)?.expect("nobody stops it");
    Ok(measured.iter().map(|runs| Turn::each(runs).collect()).collect())
}

/// The rungs that `runs` tell of, each of as many rounds; `instructions` are those of [`check`].
pub fn of(whole: bool, cores: &sys::Cores, instructions: &[Option<f64>], runs: &[Rounds]) -> Vec<Rung> {
    let planned = plan(whole, cores);
    let pixels = |(width, height): (u32, u32)| f64::from(width) * f64::from(height);
    let samples = |index: usize| {
        let turns = runs.iter().flat_map(|rounds| &rounds[index]);
        let scale = pixels(SIZE) / pixels(planned[index].size());
        turns.map(|turn| (turn.ticks as f64 * scale, turn.taken)).unzip()
    };
    let measured: Vec<(Vec<f64>, Vec<bool>)> = (0..planned.len()).map(samples).collect();
    let samples_per_run = runs.first().map_or(1, |rounds| rounds[0].len().max(1));
    let mut rungs = Vec::new();
    let mut before: Option<usize> = None;
    for (index, (rung, samples)) in planned.iter().zip(&measured).enumerate() {
        let over = match rung.aside_of {
            Some(name) => planned.iter().position(|rung| rung.rung == name),
            None => before,
        };
        let (ticks, taken) = samples;
        let over_rung = |(of, of_taken): &(Vec<f64>, Vec<bool>)| {
            Pairs::new((of, of_taken), (ticks, taken)).estimate(samples_per_run)
        };
        let gain = over_rung(&measured[over.unwrap_or(index)]);
        rungs.push(Rung {
            rung: rung.rung.clone(),
            change: rung.change.clone(),
            flags: rung.flags().into(),
            over: over.map(|over| planned[over].rung.clone()),
            aside: rung.aside_of.is_some(),
            threads: rung.threads(),
            cycles_per_pixel: median(&kept(ticks, &judged(taken))) / pixels(SIZE),
            instructions_per_pixel: instructions[index],
            gain: gain.value,
            gain_low: gain.low,
            gain_high: gain.high,
            gain_total: over_rung(&measured[0]).value,
            samples: ticks.clone(),
            taken: taken.clone(),
            samples_per_run,
        });
        if rung.aside_of.is_none() {
            before = Some(index);
        }
    }
    rungs
}

/// The picture whose instructions are counted. It is small, since every instruction is a trap.
struct Counted {
    size: (u32, u32),
    /// The distance between the rows that are counted.
    step_by: usize,
    /// The size of a picture, and the first of two of its rows, that tell what a call costs beyond its rows.
    call: ((u32, u32), u32),
}

/// Where pixels are traced one by one, a few suffice: the share that is hit is that of the picture that is timed.
const COUNTED_ONE_BY_ONE: Counted = Counted { size: (12, 9), step_by: 3, call: ((1, 2), 0) };
/// Where all pixels of a row take the same path, a few rows suffice.
const COUNTED_BY_ROWS: Counted = Counted { size: (64, 48), step_by: 16, call: ((1, 2), 0) };
/// Where a row shares what it needs, rows have to be as long as those that are timed, and a call has to see the sphere.
const COUNTED_BY_SPANS: Counted = Counted { size: SIZE, step_by: 32, call: ((64, 48), 24) };

/// The samples of single-threaded rungs in which others had the core.
pub fn taken(rungs: &[Rung]) -> Taken {
    Taken::among(rungs.iter().filter(|rung| rung.threads == 1).flat_map(|rung| &rung.taken))
}

/// The median ratio of the cycles of rung `a` to those of rung `b`, pair by pair; None where one is not there.
pub fn ratio(rungs: &[Rung], a: &str, b: &str) -> Option<Estimate> {
    let find = |name| rungs.iter().find(|rung: &&Rung| rung.rung == name);
    let (a, b) = (find(a)?, find(b)?);
    Some(Pairs::new((&a.samples, &a.taken), (&b.samples, &b.taken)).estimate(a.samples_per_run))
}

/// Each packet engine that is a rung, against what the compiler made for its instruction set: of the algorithm with a ray in
/// each lane, and of the same closed form.
pub fn against_compiler(rungs: &[Rung]) -> Vec<AgainstCompiler> {
    let there = |name: &str| rungs.iter().any(|rung| rung.rung == name);
    let compiled = |(name, _, narrower)| {
        let by_hand = if there(narrower) { narrower } else { WIDEST_BY_HAND };
        CLOSED.map(|(way, ..)| (by_hand, format!("{way}, {name}")))
    };
    let turned = TURNED.into_iter().filter_map(|(engine, narrower, variant)| {
        let widest = || ladder::C.iter().any(|rung| rung.name == variant && rung.usable()).then_some(WIDEST);
        Some((engine, if there(narrower) { narrower } else { widest()? }.to_owned()))
    });
    let against = |(engine, compiled): (&'static str, String)| {
        let Estimate { value: ratio, low, high } = ratio(rungs, &compiled, engine)?;
        Some(AgainstCompiler { engine: engine.into(), compiled: compiled.into(), ratio, low, high })
    };
    turned.chain(LEVELS.into_iter().flat_map(compiled)).filter_map(against).collect()
}

/// Factors taken apart: the two that the paper's explanations are about, from the C that calls its functions and from the engine
/// `c`, whose functions the compiler inlines; and from the best of that C to packets, by hand and by algorithm.
pub fn explain(rungs: &[Rung]) -> Vec<Explanation> {
    let apart = |steps: &[(&'static str, &'static str, &'static str)]| {
        let factor = |a, b| Some(ratio(rungs, a, b)?.value);
        let factors = steps.iter().map(|(cause, a, b)| Some((*cause, factor(*a, *b)?))).collect::<Option<Vec<_>>>()?;
        // The product of the medians: the shares then add up exactly.
        let whole: f64 = factors.iter().map(|(_, factor)| factor).product();
        let shares = factors.iter().map(|(cause, factor)| Share {
            cause: (*cause).into(),
            factor: *factor,
            share: factor.ln() / whole.ln(),
        });
        Some(Explanation {
            from: steps[0].1.into(),
            to: steps[steps.len() - 1].2.into(),
            factor: whole,
            shares: shares.collect(),
        })
    };
    [
        apart(&[
            ("pow", "c, called", "sqrtf"),
            ("calls", "sqrtf", "inlined"),
            ("leaving things out", "inlined", "lean"),
            ("lanes", "lean", "paper"),
        ]),
        apart(&[("pow", "c", "inlined"), ("leaving things out", "inlined", "lean"), ("lanes", "lean", "paper")]),
        apart(&[("by hand", "turned, sse41", LANES), ("algorithm", LANES, "sse41")]),
    ]
    .into_iter()
    .flatten()
    .collect()
}
