//! The ladder from the paper's C to the fastest engine, one change per rung, and its causes.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::in_size;
use super::lab::{Bench, Case, LabError, Pairs, PreemptedCount, Progress, Series, Turn, judged, kept};
use super::speedup::{self, Truth};
use crate::measure::statistics::{Estimate, median};
use crate::measure::{Clock, Name};
use crate::operands::in_lanes;
use rayo::internals::kernels::ladder::{self, Rung as Variant};
use rayo::internals::kernels::{self, ElementKernels, Isa, LaneTracer, Vec4, step, sys};
use rayo::internals::plan::Packed;
use rayo::internals::render::{
    Engine, Film, FilmMut, Frame, LitTracer, PacketKernelSet, PixelFormat, Purpose, Settings, Tracer,
};
use rayo::internals::scene::Scene;

/// The size that most rungs trace: small enough for the picture to stay in a second-level cache,
/// and for a run to end before the operating system is likely to preempt it.
pub const SIZE: (u32, u32) = (256, 192);
/// The size for rungs with threads, since a small picture takes less time than waking a second
/// core, and for rungs of the closed form, by hand and compiled. It is the paper's largest size.
const LARGE: (u32, u32) = (1632, 1224);
/// The work of a round per pixel, in the unit of [`Progress`].
const ROUND_WORK: u64 = 2400;

/// A measured rung. The field names are those of the JSON document.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Rung {
    pub rung: String,
    /// What is different from [`Rung::over`], in words.
    pub change: String,
    /// The compiler's flags, where they differ from those of the engine.
    pub flags: Name,
    /// The rung that this one is compared with: for an aside the one that it varies, otherwise the
    /// last one before it that is not an aside. None for the first.
    pub over: Option<String>,
    /// Whether it is an aside: the next rung does not build on it.
    pub aside: bool,
    pub threads: usize,
    /// Median TSC cycles per pixel.
    pub cycles_per_pixel: f64,
    /// Instructions executed per pixel, by single-stepping; None where they cannot be counted.
    pub instructions_per_pixel: Option<f64>,
    /// The gain: the median ratio of the cycles of [`Rung::over`] to this rung's, pair by pair.
    pub gain: f64,
    pub gain_low: f64,
    pub gain_high: f64,
    /// The gain over the first rung.
    pub gain_total: f64,
    /// TSC cycles of every run; those of a larger picture are scaled to the number of pixels in
    /// [`SIZE`].
    pub samples: Vec<f64>,
    /// For each sample, whether it was preempted by another thread. Preempted samples are left out
    /// of all figures unless they are more than half.
    pub taken: Vec<bool>,
    /// How many consecutive samples come from one process.
    pub samples_per_run: usize,
}

impl Rung {
    fn series(&self) -> Series<'_> {
        Series { ticks: &self.samples, taken: &self.taken }
    }
}

/// A packet engine compared with compiled code for the same instruction set and the same output.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct AgainstCompiler {
    pub engine: Name,
    /// The rung of the compiled code.
    pub compiled: Name,
    /// How many times as fast the engine is as the compiled code: the median of the ratios, pair by
    /// pair.
    pub ratio: f64,
    pub low: f64,
    pub high: f64,
}

/// The part of a factor between two rungs that one cause accounts for.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct CauseShare {
    pub cause: Name,
    /// The factor that this cause accounts for.
    pub factor: f64,
    /// The logarithm of this factor divided by that of the whole factor: the shares of all causes
    /// add up to 1.
    pub share: f64,
}

/// The factor between two rungs, divided among its causes.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Explanation {
    pub from: Name,
    pub to: Name,
    pub factor: f64,
    pub shares: Vec<CauseShare>,
}

/// The name of the rung of vectorised brute force for the widest instruction set that this CPU has.
const WIDEST: &str = "turned";

/// A rung of brute-force C that the compiler vectorises, for one instruction set.
pub(super) struct VectorisedRung {
    /// The packet engine of the same instruction set, with which it is compared.
    pub engine: &'static str,
    /// Its name if the CPU has a wider instruction set; the rung of the widest is named [`WIDEST`].
    pub rung_if_not_widest: &'static str,
    /// The name of the compiled variant in build.rs.
    pub variant: &'static str,
}

/// The rungs of brute-force C that the compiler vectorises, narrowest instruction set first.
pub(super) const VECTORISED: [VectorisedRung; 3] = [
    VectorisedRung { engine: "sse41", rung_if_not_widest: "turned, sse41", variant: "turned_sse41" },
    VectorisedRung { engine: "avx2", rung_if_not_widest: "turned, avx2", variant: "turned_v3" },
    VectorisedRung { engine: "avx512", rung_if_not_widest: "turned, avx512", variant: "turned_v4" },
];

/// What the rungs of the closed form are called for one instruction set.
struct ClosedFormIsa {
    isa: Isa,
    /// What names of variants in build.rs end in.
    variant_suffix: &'static str,
    /// The rung of the packets written by hand if the CPU has a wider instruction set; that of the
    /// widest is named [`WIDEST_BY_HAND`].
    by_hand_if_not_widest: &'static str,
}

/// What the rungs of the closed form are called, narrowest instruction set first.
const CLOSED_FORM_ISAS: [ClosedFormIsa; 3] = [
    ClosedFormIsa { isa: Isa::Sse41, variant_suffix: "sse41", by_hand_if_not_widest: "large, sse41" },
    ClosedFormIsa { isa: Isa::Avx2, variant_suffix: "v3", by_hand_if_not_widest: "large, avx2" },
    ClosedFormIsa { isa: Isa::Avx512, variant_suffix: "v4", by_hand_if_not_widest: "large, avx512" },
];

/// A compiled version of the closed form.
struct ClosedForm {
    /// What names of its rungs begin with.
    rung: &'static str,
    /// What names of its variants in build.rs begin with.
    variant: &'static str,
    /// The difference from the kernel in assembly, in words.
    change: &'static str,
}

/// The compiled versions of the closed form of the experiment's sphere. They write bytes.
const CLOSED_FORMS: [ClosedForm; 4] = [
    ClosedForm {
        rung: "closed form in C",
        variant: "closed",
        change: "the same rows in C, which the compiler vectorises",
    },
    ClosedForm { rung: "closed form in C by Clang", variant: "clang", change: "the same, by Clang" },
    ClosedForm {
        rung: "closed form in Rust",
        variant: "rust",
        change: "the same rows in Rust, which the compiler vectorises",
    },
    ClosedForm {
        rung: "closed form in intrinsics",
        variant: "intrinsics",
        change: "the same rows in C with intrinsics, with estimates of roots",
    },
];

/// A rung of the paper's C.
struct CRung {
    rung: &'static str,
    /// The difference from the rung before it, or from the one that it varies, in words.
    change: &'static str,
    /// The rung that it varies, if it is an aside.
    aside_of: Option<&'static str>,
    /// Variants in build.rs, of which the first that this CPU runs is measured; if it runs none,
    /// the rung is left out. None stands for the engine `c`.
    variants: Option<&'static [&'static str]>,
    /// Whether a claim of the documentation needs it; the others are only in the whole ladder.
    claimed: bool,
}

/// The rungs of the paper's C whose variants all have the paper's arrays, in order.
const C_RUNGS: [CRung; 10] = [
    CRung {
        rung: "c, called",
        change: "the paper's C with every small function called",
        aside_of: None,
        variants: Some(&["calls"]),
        claimed: true,
    },
    // A vector passed by value is stored in halves, and loading it whole has to wait for both
    // stores. This variant, compiled without vector instructions, shows what that costs.
    CRung {
        rung: "c, called, scalar",
        change: "the same, not vectorised by the compiler",
        aside_of: Some("c, called"),
        variants: Some(&["calls_scalar"]),
        claimed: false,
    },
    CRung {
        rung: "c",
        change: "the engine `c`: the same, inlined",
        aside_of: Some("c, called"),
        variants: None,
        claimed: true,
    },
    CRung {
        rung: "sqrtf",
        change: "roots by sqrtf in place of pow",
        aside_of: None,
        variants: Some(&["sqrtf"]),
        claimed: true,
    },
    CRung {
        rung: "inlined",
        change: "small functions inlined",
        aside_of: None,
        variants: Some(&["inlined"]),
        claimed: true,
    },
    CRung {
        rung: "lean",
        change: "without adding r_o = 0, the 2 of eq. 5, and the distance, for which t serves",
        aside_of: None,
        variants: Some(&["lean"]),
        claimed: true,
    },
    CRung {
        rung: "nearest only",
        change: "only the nearest hit is shaded",
        aside_of: None,
        variants: Some(&["nearest"]),
        claimed: false,
    },
    CRung {
        rung: "hoisted",
        change: "constants of the scene computed once",
        aside_of: None,
        variants: Some(&["hoisted"]),
        claimed: false,
    },
    // The widest level that this CPU runs stands for -march=native.
    CRung {
        rung: "native",
        change: "for this CPU's instructions, as -march=native",
        aside_of: None,
        variants: Some(&["native_v4", "native_v3"]),
        claimed: false,
    },
    CRung {
        rung: "fast-math",
        change: "-ffast-math",
        aside_of: None,
        variants: Some(&["fast_v4", "fast_v3"]),
        claimed: false,
    },
];

/// The rung of the widest packets, written by hand, that writes bytes in the larger picture.
pub const WIDEST_BY_HAND: &str = "large";

/// The rung that traces a ray in each of four lanes; rungs with more lanes are asides.
const LANES: &str = "lanes";

/// What traces the picture of a rung.
enum Tracing {
    Variant(&'static Variant),
    Engine(Engine, PixelFormat),
    /// A ray in each lane.
    Lanes(&'static LaneTracer),
    /// Whole rows by a compiled closed form, as bytes.
    Rows(&'static Variant<ElementKernels<f32>>),
    /// The paper's macros in the best forms that we know.
    Aos(&'static kernels::AosKernels),
    Threads(Engine, PixelFormat, usize),
}

/// A rung before it is measured.
struct Planned {
    rung: String,
    change: String,
    /// The rung that this one varies, if it is an aside.
    aside_of: Option<&'static str>,
    tracing: Tracing,
}

impl Planned {
    fn new(rung: &str, change: &str, aside_of: Option<&'static str>, tracing: Tracing) -> Self {
        Planned { rung: rung.into(), change: change.into(), aside_of, tracing }
    }
}

/// The variant in build.rs with this name.
fn variant(name: &str) -> &'static Variant {
    ladder::C.iter().find(|variant| variant.name == name).expect("build.rs has it")
}

/// The engine with this name, tracing floats.
fn engine_in_floats(name: &str) -> Tracing {
    let engine = Engine::ALL.iter().copied().find(|engine| engine.name() == name);
    Tracing::Engine(engine.expect("asm is built"), PixelFormat::F32x4)
}

/// Every rung that this CPU runs, in order; if not `whole`, only those that the claims need.
fn plan(whole: bool, cores: &sys::Cores) -> Vec<Planned> {
    let isas: Vec<_> = Isa::ALL.into_iter().filter(|isa| isa.usable()).collect();
    let mut rungs = c_rungs(whole);
    if whole {
        rungs.extend(vectorised_rungs());
    }
    rungs.extend(paper_rungs(whole));
    if whole {
        rungs.extend(isas.iter().flat_map(|isa| lane_and_packet_rungs(*isa)));
    }
    let Some(&widest) = isas.last() else { return rungs };
    rungs.extend(byte_rungs(&isas, whole));
    if whole {
        let tracing = Tracing::Threads(Engine::Packet(widest), PixelFormat::Rgba8, cores.count());
        rungs.push(Planned::new("threads", "the same with all cores", None, tracing));
    }
    rungs
}

/// The rungs of [`C_RUNGS`].
fn c_rungs(whole: bool) -> Vec<Planned> {
    let mut rungs = Vec::new();
    for CRung { rung, change, aside_of, variants, claimed } in C_RUNGS {
        let tracing = match variants {
            None => Some(engine_in_floats(speedup::BASELINE)),
            Some(names) => {
                let usable = names.iter().map(|name| variant(name)).find(|variant| variant.usable());
                usable.map(Tracing::Variant)
            }
        };
        if let Some(tracing) = tracing.filter(|_| whole || claimed) {
            rungs.push(Planned::new(rung, change, aside_of, tracing));
        }
    }
    rungs
}

/// The rungs of [`VECTORISED`]: the widest that this CPU runs, and the others as its asides.
fn vectorised_rungs() -> Vec<Planned> {
    let mut rungs = Vec::new();
    for VectorisedRung { rung_if_not_widest, variant: name, .. } in VECTORISED.into_iter().rev() {
        let variant = variant(name);
        if !variant.usable() {
            continue;
        }
        let tracing = Tracing::Variant(variant);
        rungs.push(if rungs.is_empty() {
            Planned::new(WIDEST, "arrays over pixels, which the compiler vectorises", None, tracing)
        } else {
            Planned::new(rung_if_not_widest, "the same for fewer lanes", Some(WIDEST), tracing)
        });
    }
    rungs
}

/// The paper's SIMD and its asides.
fn paper_rungs(whole: bool) -> Vec<Planned> {
    let called = Tracing::Variant(&ladder::PAPER_CALLS);
    let mut rungs = vec![
        Planned::new("paper", "the paper's SIMD", None, engine_in_floats(speedup::CONTROL)),
        Planned::new("paper, called", "the same with calls in place of macros", Some("paper"), called),
    ];
    if whole && let Some(kernels) = kernels::aos() {
        let tracing = Tracing::Aos(kernels);
        rungs.push(Planned::new("paper, best forms", "the same without haddps", Some("paper"), tracing));
    }
    rungs
}

/// For one instruction set a rung with a ray in each lane, and one of packets in closed form. With
/// four lanes each is a rung of the ladder; with more, the former is an aside of the latter.
fn lane_and_packet_rungs(isa: Isa) -> [Planned; 2] {
    let lanes = Tracing::Lanes(kernels::lane_tracer(isa).expect("the CPU supports it"));
    let packets = Tracing::Engine(Engine::Packet(isa), PixelFormat::F32x4);
    let change_of_lanes = "a ray in each lane, tested against every object";
    if isa == Isa::Sse41 {
        [
            Planned::new(LANES, change_of_lanes, None, lanes),
            Planned::new(isa.name(), "packets of rays, in closed form", None, packets),
        ]
    } else {
        [
            Planned::new(isa.name(), "packets of more rays", None, packets),
            Planned::new(&format!("{LANES}, {isa}"), change_of_lanes, Some(isa.name()), lanes),
        ]
    }
}

/// The rungs that write bytes: the widest packets in both sizes, and the closed form by hand and
/// compiled for each of `isas`, which has at least one. Unless `whole`, only the widest instruction
/// set has rungs.
fn byte_rungs(isas: &[Isa], whole: bool) -> Vec<Planned> {
    let widest = isas[isas.len() - 1];
    let bytes = |isa| Tracing::Engine(Engine::Packet(isa), PixelFormat::Rgba8);
    let mut rungs = Vec::new();
    if whole {
        rungs.push(Planned::new("rgba8", "8-bit output", None, bytes(widest)));
    }
    let change = format!("a picture of {}×{}, which exceeds that cache", LARGE.0, LARGE.1);
    rungs.push(Planned::new(WIDEST_BY_HAND, &change, None, bytes(widest)));
    for closed_form in CLOSED_FORM_ISAS.into_iter().rev().filter(|closed_form| isas.contains(&closed_form.isa)) {
        if closed_form.isa == widest {
            rungs.extend(compiled_closed_forms(&closed_form, WIDEST_BY_HAND));
        } else if whole {
            let by_hand = closed_form.by_hand_if_not_widest;
            rungs.push(Planned::new(by_hand, "the same for fewer lanes", Some(WIDEST_BY_HAND), bytes(closed_form.isa)));
            rungs.extend(compiled_closed_forms(&closed_form, by_hand));
        }
    }
    rungs
}

/// The compiled versions of the closed form for one instruction set, as asides of the rung
/// `by_hand`.
fn compiled_closed_forms(isa: &ClosedFormIsa, by_hand: &'static str) -> Vec<Planned> {
    let mut rungs = Vec::new();
    for ClosedForm { rung, variant, change } in CLOSED_FORMS {
        let name = format!("{variant}_{}", isa.variant_suffix);
        if let Some(variant) = ladder::CLOSED.iter().find(|variant| variant.name == name && variant.usable()) {
            let rung = format!("{rung}, {}", isa.isa);
            rungs.push(Planned::new(&rung, change, Some(by_hand), Tracing::Rows(variant)));
        }
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

    /// Instructions executed per pixel, without the set-up of the engine and the fixed cost of a
    /// call. None with threads, which cannot be single-stepped, and where
    /// [`step::count_instructions`] does not work.
    fn instructions(&self, scene: &Scene, cores: &sys::Cores) -> Result<Option<f64>, LabError> {
        let Counted { size: (width, height), step_by, call_size, call_row } = match &self.tracing {
            Tracing::Threads(..) => return Ok(None),
            Tracing::Rows(_) => COUNTED_BY_SPANS,
            Tracing::Engine(engine, _) if engine.is_packet() => COUNTED_BY_SPANS,
            Tracing::Lanes(_) => COUNTED_BY_ROWS,
            Tracing::Variant(variant) if variant.name.starts_with("turned") => COUNTED_BY_ROWS,
            _ => COUNTED_ONE_BY_ONE,
        };
        // The fixed cost of a call is what two calls for a row each execute more than one call for
        // both rows.
        let rows = [call_row..call_row + 1, call_row + 1..call_row + 2, call_row..call_row + 2];
        let Some(calls) = self.count(scene, cores, call_size, rows)? else { return Ok(None) };
        let call = (calls[0] + calls[1]).saturating_sub(calls[2]);
        let rows = (step_by as u32 / 2..height).step_by(step_by).map(|row| row..row + 1);
        let Some(rows) = self.count(scene, cores, (width, height), rows)? else { return Ok(None) };
        let pixels = rows.len() as f64 * f64::from(width);
        let sum: u64 = rows.iter().map(|row| row - call).sum();
        Ok(Some(sum as f64 / pixels))
    }

    /// The instructions of one call for each range of rows in `calls`, in a picture of `size`. None
    /// where [`step::count_instructions`] does not work.
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

    /// The tracer of the engine, if the rung has one.
    fn tracer<'a>(&self, scene: &'a Scene) -> Result<Option<Box<dyn Tracer + 'a>>, LabError> {
        Ok(match self.tracing {
            Tracing::Engine(engine, _) | Tracing::Threads(engine, ..) => Some(engine.prepare(None, scene)?),
            Tracing::Rows(variant) => {
                let packets = Engine::fastest().packets().expect("kernels of rows stand beside those of packets");
                let kernels = PacketKernelSet { packets, element: variant.kernels(), estimates: false };
                let tracer = LitTracer::new(kernels, scene, Purpose::default());
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

/// The pixels of a film in format F32x4; panics on any other film.
pub(super) fn floats(film: FilmMut<'_>) -> &mut [Vec4] {
    if let FilmMut::F32x4(film) = film { film } else { unreachable!("its output is floats") }
}

/// Calls `start`, and lets the threads that it starts run on all of `cores`, although the calling
/// thread is pinned to one core.
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

/// Why instructions cannot be counted on this machine, if they cannot.
pub fn uncounted() -> Option<String> {
    step::count_instructions(|| ()).err().map(|reason| reason.to_string())
}

/// Checks that every rung traces the reference's picture. If the ladder is `whole`, it also counts
/// their instructions per pixel, where that is possible. Threads may run on `cores`. None if
/// `proceed` returns false.
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

/// A clock that runs all work once untimed before it times it. Otherwise the first rung of each
/// size or pixel format would find its film evicted from the caches, unlike the next rungs.
struct Warmed<'a>(&'a mut dyn Clock);

impl Clock for Warmed<'_> {
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

/// For each rung, in the order of the ladder, its measurements in the rounds of one process.
pub type Rounds = Vec<Vec<Turn>>;

/// Measures the given `rounds` of the ladder in this process, which is one
/// [run](speedup::measure_run) of the experiment.
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
    let measured = Bench::default().time(&mut Warmed(clock), &cases, rounds, &mut || true)?.expect("nobody stops it");
    Ok(measured.iter().map(|runs| Turn::each(runs).collect()).collect())
}

/// The measurements of a rung: see [`Rung::samples`] and [`Rung::taken`].
struct Samples {
    ticks: Vec<f64>,
    taken: Vec<bool>,
}

impl Samples {
    /// The ratios of these samples to those of another rung, pair by pair.
    fn ratios_to(&self, other: &Samples) -> Pairs {
        let series = [self, other].map(|samples| Series { ticks: &samples.ticks, taken: &samples.taken });
        let [these, others] = series;
        Pairs::new(these, others)
    }
}

/// The rungs, from the measurements of all `runs`, each of which has the same number of rounds;
/// `instructions` come from [`check`].
pub fn of(whole: bool, cores: &sys::Cores, instructions: &[Option<f64>], runs: &[Rounds]) -> Vec<Rung> {
    let planned = plan(whole, cores);
    let pixels = |(width, height): (u32, u32)| f64::from(width) * f64::from(height);
    let samples = |index: usize| {
        let turns = || runs.iter().flat_map(|rounds| &rounds[index]);
        let scale = pixels(SIZE) / pixels(planned[index].size());
        Samples {
            ticks: turns().map(|turn| turn.ticks as f64 * scale).collect(),
            taken: turns().map(|turn| turn.taken).collect(),
        }
    };
    let measured: Vec<Samples> = (0..planned.len()).map(samples).collect();
    let samples_per_run = runs.first().map_or(1, |rounds| rounds[0].len().max(1));
    let mut rungs = Vec::new();
    let mut before: Option<usize> = None;
    for (index, (rung, samples)) in planned.iter().zip(&measured).enumerate() {
        let over = match rung.aside_of {
            Some(name) => planned.iter().position(|rung| rung.rung == name),
            None => before,
        };
        let over_rung = |over: &Samples| over.ratios_to(samples).estimate(samples_per_run);
        let gain = over_rung(&measured[over.unwrap_or(index)]);
        rungs.push(Rung {
            rung: rung.rung.clone(),
            change: rung.change.clone(),
            flags: rung.flags().into(),
            over: over.map(|over| planned[over].rung.clone()),
            aside: rung.aside_of.is_some(),
            threads: rung.threads(),
            cycles_per_pixel: median(&kept(&samples.ticks, &judged(&samples.taken))) / pixels(SIZE),
            instructions_per_pixel: instructions[index],
            gain: gain.value,
            gain_low: gain.low,
            gain_high: gain.high,
            gain_total: over_rung(&measured[0]).value,
            samples: samples.ticks.clone(),
            taken: samples.taken.clone(),
            samples_per_run,
        });
        if rung.aside_of.is_none() {
            before = Some(index);
        }
    }
    rungs
}

/// Which rows of which picture are single-stepped to count instructions. The picture is small,
/// since every instruction causes a trap.
struct Counted {
    size: (u32, u32),
    /// One row in `step_by` is counted.
    step_by: usize,
    /// The size of another picture, and the first of two of its rows, by which the fixed cost of a
    /// call is found.
    call_size: (u32, u32),
    call_row: u32,
}

/// For code that traces pixels one by one: few pixels suffice, if the share of them that hits is
/// that of the timed picture.
const COUNTED_ONE_BY_ONE: Counted = Counted { size: (12, 9), step_by: 3, call_size: (1, 2), call_row: 0 };
/// For code in which all pixels of a row take the same path: few rows suffice.
const COUNTED_BY_ROWS: Counted = Counted { size: (64, 48), step_by: 16, call_size: (1, 2), call_row: 0 };
/// For code that shares work within a row: rows must be as long as in the timed picture, and the
/// rows by which the cost of a call is found must meet the sphere.
const COUNTED_BY_SPANS: Counted = Counted { size: SIZE, step_by: 32, call_size: (64, 48), call_row: 24 };

/// A rung of the short ladder.
struct MainRung {
    /// Its name; None for the widest packets, whose name depends on the CPU.
    rung: Option<&'static str>,
    /// Its change from the rung before it, in words.
    change: &'static str,
}

/// The rungs of the short ladder of ten.
const MAIN: [MainRung; 10] = [
    MainRung { rung: Some("c, called"), change: "the paper's C with every small function called" },
    MainRung { rung: Some("c"), change: "small functions inlined by the compiler" },
    MainRung { rung: Some("inlined"), change: "roots by sqrtf in place of pow" },
    MainRung { rung: Some("lean"), change: "without the work that the SIMD leaves out" },
    MainRung { rung: Some("paper"), change: "the paper's SIMD: three lanes of four" },
    MainRung { rung: Some(LANES), change: "a ray in each of four lanes" },
    MainRung { rung: Some("sse41"), change: "packets that know what their rays meet" },
    MainRung { rung: None, change: "packets of more rays" },
    MainRung { rung: Some("rgba8"), change: "bytes in place of floats" },
    MainRung { rung: Some("threads"), change: "all cores, in a larger picture" },
];

/// The ladder in ten rungs, each compared with the one before it in this list.
pub fn main_rungs(rungs: &[Rung]) -> Vec<Rung> {
    let find = |name: &str| rungs.iter().find(|rung| rung.rung == name);
    let mut main: Vec<Rung> = Vec::new();
    for MainRung { rung: name, change } in MAIN {
        let Some(rung) = name.map_or_else(|| wider(rungs), find) else { continue };
        let before = main.last();
        let gain = before.map_or(1.0, |before| before.cycles_per_pixel / rung.cycles_per_pixel);
        let over = before.map(|before| before.rung.clone());
        main.push(Rung { change: change.into(), aside: false, over, gain, ..rung.clone() });
    }
    main
}

/// The widest packet rung, if this CPU has packets wider than four lanes.
fn wider(rungs: &[Rung]) -> Option<&Rung> {
    let wider = Isa::ALL.into_iter().filter(|isa| *isa > Isa::Sse41);
    wider.rev().find_map(|isa| rungs.iter().find(|rung| rung.rung == isa.name()))
}

/// How many samples of single-threaded rungs were preempted.
pub fn taken(rungs: &[Rung]) -> PreemptedCount {
    PreemptedCount::among(rungs.iter().filter(|rung| rung.threads == 1).flat_map(|rung| &rung.taken))
}

/// The median ratio of the cycles of rung `a` to those of rung `b`, pair by pair; None if one of
/// the rungs is missing.
pub fn ratio(rungs: &[Rung], a: &str, b: &str) -> Option<Estimate> {
    let find = |name| rungs.iter().find(|rung: &&Rung| rung.rung == name);
    let (a, b) = (find(a)?, find(b)?);
    Some(Pairs::new(a.series(), b.series()).estimate(a.samples_per_run))
}

/// Compares each packet engine among the rungs with compiled code for its instruction set: with
/// brute force over arrays of rays, and with the same closed form.
pub fn against_compiler(rungs: &[Rung]) -> Vec<AgainstCompiler> {
    let is_rung = |name: &str| rungs.iter().any(|rung| rung.rung == name);
    let compare = |engine: &'static str, compiled: String| {
        let Estimate { value: ratio, low, high } = ratio(rungs, &compiled, engine)?;
        Some(AgainstCompiler { engine: engine.into(), compiled: compiled.into(), ratio, low, high })
    };
    let mut compared = Vec::new();
    for VectorisedRung { engine, rung_if_not_widest, variant } in VECTORISED {
        let is_usable = || ladder::C.iter().any(|rung| rung.name == variant && rung.usable());
        if is_rung(rung_if_not_widest) {
            compared.extend(compare(engine, rung_if_not_widest.to_owned()));
        } else if is_usable() {
            compared.extend(compare(engine, WIDEST.to_owned()));
        }
    }
    for ClosedFormIsa { isa, by_hand_if_not_widest, .. } in CLOSED_FORM_ISAS {
        let by_hand = if is_rung(by_hand_if_not_widest) { by_hand_if_not_widest } else { WIDEST_BY_HAND };
        for ClosedForm { rung, .. } in CLOSED_FORMS {
            compared.extend(compare(by_hand, format!("{rung}, {isa}")));
        }
    }
    compared
}

/// A cause of a factor, and the two rungs that differ by this cause alone.
struct Cause {
    cause: &'static str,
    from: &'static str,
    to: &'static str,
}

const POW: Cause = Cause { cause: "pow", from: "c, called", to: "sqrtf" };
const CALLS: Cause = Cause { cause: "calls", from: "sqrtf", to: "inlined" };
const LEFT_OUT: Cause = Cause { cause: "leaving things out", from: "inlined", to: "lean" };
const THREE_LANES: Cause = Cause { cause: "lanes", from: "lean", to: "paper" };
const POW_OF_ENGINE: Cause = Cause { cause: "pow", from: "c", to: "inlined" };
const BY_HAND: Cause = Cause { cause: "by hand", from: "turned, sse41", to: LANES };
const ALGORITHM: Cause = Cause { cause: "algorithm", from: LANES, to: "sse41" };

/// Divides three factors among their causes. Two lead to the paper's SIMD: from the C that calls
/// its functions, and from the engine `c`, whose functions the compiler inlines. The third leads
/// from the best compiled variant of that C to the packets.
pub fn explain(rungs: &[Rung]) -> Vec<Explanation> {
    let all = [
        explain_by(rungs, &[POW, CALLS, LEFT_OUT, THREE_LANES]),
        explain_by(rungs, &[POW_OF_ENGINE, LEFT_OUT, THREE_LANES]),
        explain_by(rungs, &[BY_HAND, ALGORITHM]),
    ];
    all.into_iter().flatten().collect()
}

/// The factor from the first rung of `causes` to the last; each cause begins at the rung where the
/// one before it ends. None if a rung was not measured.
fn explain_by(rungs: &[Rung], causes: &[Cause]) -> Option<Explanation> {
    let factor = |cause: &Cause| Some(ratio(rungs, cause.from, cause.to)?.value);
    let factors = causes.iter().map(factor).collect::<Option<Vec<f64>>>()?;
    // The whole is the product of the medians, not the median of the whole ratio, so that the
    // shares add up to exactly 1.
    let whole: f64 = factors.iter().product();
    let shares = causes.iter().zip(&factors).map(|(cause, factor)| CauseShare {
        cause: cause.cause.into(),
        factor: *factor,
        share: factor.ln() / whole.ln(),
    });
    Some(Explanation {
        from: causes[0].from.into(),
        to: causes[causes.len() - 1].to.into(),
        factor: whole,
        shares: shares.collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_main_rungs_are_ten_and_each_is_beside_the_one_before() {
        let names =
            ["c, called", "c", "sqrtf", "inlined", "lean", "turned", "paper", "lanes", "sse41", "avx2", "rgba8"];
        let cycles = [80.0, 40.0, 70.0, 20.0, 19.0, 5.0, 10.0, 5.0, 2.0, 1.0, 0.5];
        let rung = |(name, cycles): (&str, f64)| Rung {
            rung: name.into(),
            cycles_per_pixel: cycles,
            aside: true,
            ..Rung::default()
        };
        let mut rungs: Vec<Rung> = names.into_iter().zip(cycles).map(rung).collect();
        rungs.push(Rung { rung: "threads".into(), cycles_per_pixel: 0.25, ..Rung::default() });
        let main = main_rungs(&rungs);
        let names: Vec<_> = main.iter().map(|rung| rung.rung.as_str()).collect();
        assert_eq!(names, ["c, called", "c", "inlined", "lean", "paper", "lanes", "sse41", "avx2", "rgba8", "threads"]);
        assert_eq!((main[0].over.as_deref(), main[2].over.as_deref()), (None, Some("c")));
        assert_eq!((main[2].gain, main[9].gain), (2.0, 2.0));
        assert!(main.iter().all(|rung| !rung.aside));
    }
}
