//! Section 4 of the paper, counted: instructions of every operation in every implementation, and what they cost.

mod kept;
mod model;
pub mod plot;
mod subjects;

use serde::{Deserialize, Serialize};

use super::{in_size, speedup};
use crate::kernels::step::{self, Unavailable};
use crate::kernels::{self, Chains, Isa, sys};
use crate::measure::Name;
use crate::measure::instructions::{Code, Function, Instruction, Mix, functions};
use crate::measure::source::{Origin, Unit};
use crate::measure::{core_cycles, core_cycles_per_tick};
use crate::render::{Engine, Film, PixelFormat};
use crate::scene::brief;
pub use model::Model;
use subjects::Subject;

/// The operations: the six of the paper, and what its tracer makes of them.
pub use crate::kernels::OPERATIONS as OPS;

/// What is listed beside them if it is asked for: the rows of a grey sphere, as the packets make their bytes.
pub const LIT: &str = "lit";
/// The implementations of [`LIT`]; `portable` is that in Rust, compiled for the widest packets that this CPU has.
pub const IMPLEMENTATIONS_OF_LIT: [&str; 4] = ["sse41", "avx2", "avx512", "portable"];

/// The implementations, in the order of the table's columns.
pub const IMPLEMENTATIONS: [&str; 14] = [
    "printed-c",
    "printed-simd",
    "c-O0",
    "c-O1",
    "c-O2",
    "c-O3",
    "c-native",
    "rust",
    "glam",
    "paper",
    "aos",
    "sse41",
    "avx2",
    "avx512",
];

/// The paper's table: C and SIMD, for the first six of [`OPS`].
const PRINTED: [(usize, usize); 6] = [(35, 1), (35, 1), (25, 2), (25, 3), (26, 4), (44, 7)];

/// Rounds of a chain, and calls of a function, in a measurement.
const ROUNDS: u64 = 200;
/// Measurements of which the fastest is taken.
const REPEATS: u32 = 25;

/// A result that another needs is a cycle away at least, and so is what follows a call and a return: these are jumps.
const LEAST_CYCLES: f64 = 1.0;
/// No core finishes more instructions in a cycle.
const MOST_IN_A_CYCLE: f64 = 8.0;
/// What a row says if its cycles are not known.
const IMPOSSIBLE: &str =
    "no cycles: others had the core each time, or left it too little for any that an operation can take";

/// The picture that is traced step by step: small where pixels are traced one by one and a few tell all, larger where they
/// share what a row needs.
const FRAME: (u32, u32) = (16, 12);
const FRAME_OF_PACKETS: (u32, u32) = (64, 48);

#[derive(Clone, Debug, Default)]
pub struct Options {
    /// Some of [`OPS`], or [`LIT`]; none for all of the former.
    pub wanted: Vec<String>,
    /// Some of [`IMPLEMENTATIONS`]; none for all.
    pub implementations: Vec<String>,
    /// Whether to count executed instructions too.
    pub executed: bool,
    /// Whether to measure latency and throughput.
    pub cost: bool,
}

/// What was counted: the `ops` document without its schema.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Report {
    /// A row for every operation and implementation that was asked for.
    pub rows: Vec<Counts>,
    /// A whole small picture by each engine; empty where executed instructions were not asked for or cannot be counted.
    pub frames: Vec<FrameRow>,
    /// Why there are no executed counts although they were asked for.
    pub executed_unavailable: Option<String>,
    /// Core cycles in a tick of the time-stamp counter when the costs were measured.
    pub core_cycles_per_tick: Option<f64>,
    /// Core cycles of what the chains of latency of one vector add to each operation; taken off the latencies of bodies, as
    /// is that of packets off theirs.
    pub feedback_cycles: Option<f64>,
    /// The assembler, the C compiler and the Rust compiler of this build.
    pub compilers: Compilers,
}

/// What the counted code was made with.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Compilers {
    pub nasm: Name,
    pub cc: Name,
    pub rustc: Name,
}

impl Compilers {
    /// Those of this build.
    pub fn this() -> Self {
        let or_none = |version: Option<&'static str>| version.unwrap_or("none");
        Compilers {
            nasm: or_none(option_env!("RAYO_NASM")).into(),
            cc: or_none(option_env!("RAYO_CC")).into(),
            rustc: env!("RAYO_RUSTC").into(),
        }
    }
}

/// An operation in an implementation. What does not apply, or could not be had here, is None.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Counts {
    /// One of [`OPS`].
    pub op: Name,
    /// One of [`IMPLEMENTATIONS`].
    pub implementation: Name,
    /// Instructions of the macro between loading operands and storing the result.
    pub body: Option<usize>,
    /// Instructions of the whole symbol: loads, stores and `ret` too, but not what it calls.
    pub function: Option<usize>,
    /// Vectors that a pass of the body serves.
    pub vectors: Option<usize>,
    /// Instructions of the body for each vector; of the function where there is no body.
    pub per_vector: Option<f64>,
    /// Instructions executed from the function's entry to its return, with what it calls, on its first path.
    pub executed: Option<u64>,
    /// Core cycles from operand to result: of the body where there is a chain of it, else of a call.
    pub latency: Option<f64>,
    /// Core cycles for each operation when many are independent: of the body or of a call, as `latency`.
    pub throughput: Option<f64>,
    /// What `latency` and `throughput` are of: `body` or `call`.
    pub cost_of: Option<Name>,
    /// Core cycles of a call from one result to the next, led back as the address of the next operand.
    pub call_latency: Option<f64>,
    /// Core cycles of a call among independent ones.
    pub call_throughput: Option<f64>,
    /// The longest chain of operations, in words; as the macro's comment has it.
    pub critical_path: Option<String>,
    pub body_mix: Option<Mix>,
    pub function_mix: Option<Mix>,
    pub paths: Vec<Path>,
    /// What llvm-mca makes of a body without jumps: a model, not a measurement.
    pub model: Option<Model>,
    /// Why there is nothing to run here, where there is code.
    pub unavailable: Option<String>,
    /// Why latency or throughput was measured and is not known.
    pub no_cycles: Option<Name>,
    /// The function, line by line.
    pub listing: Vec<Line>,
}

/// A path through an operation.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Path {
    /// What the operands are.
    pub path: Name,
    /// Instructions executed in a call, with what it calls.
    pub executed: u64,
    /// Of those, in the body.
    pub body: Option<u64>,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Line {
    /// Bytes from the beginning of the function.
    pub offset: usize,
    /// In Intel's syntax.
    pub text: String,
    pub body: bool,
    /// How often a call on the first path executes it, where that was counted.
    pub executed: Option<u64>,
    /// Where it may jump to, as `offset`; of C and Rust beyond the function too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target: Option<usize>,
    /// Where it comes from, of kernels in NASM that this CPU runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<Source>,
}

/// The line of the source that an instruction comes from.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Source {
    /// The file of the innermost macro; empty outside of macros.
    pub file: String,
    pub line: usize,
    pub text: String,
    /// The macros that it stands in, the outermost first.
    pub macros: Vec<String>,
}

/// The listing of a function, each instruction with its source where there is a table of it.
pub fn listing(code: &Code) -> Vec<Line> {
    let unit = Unit::with_function(&code.symbol);
    let source = |i: &Instruction| {
        let (unit, start) = unit?;
        let Origin { calls, number, text, .. } = unit.origin(start + i.offset)?;
        Some(Source {
            file: unit.file(calls.last().copied()).to_owned(),
            line: number,
            text: text.to_owned(),
            macros: calls.iter().map(|&call| unit.macros[unit.calls[call].of].name.to_owned()).collect(),
        })
    };
    let in_body = |i: &Instruction| code.body.as_ref().is_some_and(|body| body.contains(&i.offset));
    let line = |i: &Instruction| Line {
        offset: i.offset,
        text: i.text.clone(),
        body: in_body(i),
        executed: None,
        target: i.target,
        source: source(i),
    };
    code.instructions.iter().map(line).collect()
}

/// A function of the objects, with its listing.
#[derive(Clone, Debug, Serialize)]
pub struct Kernel {
    #[serde(flatten)]
    pub function: Function,
    pub instructions: usize,
    pub listing: Vec<Line>,
}

/// The kernel of a symbol; of C and of tests too, which the objects have beside the engines' kernels.
///
/// # Errors
/// What is no symbol, with the symbols that are nearest to it.
pub fn kernel(symbol: &str) -> Result<Kernel, String> {
    let functions = functions();
    match functions.iter().find(|function| function.symbol == symbol) {
        Some(function) => {
            let code = Code::of_symbol(symbol).expect("the objects have what they list");
            let listing = listing(&code);
            Ok(Kernel { function: function.clone(), instructions: listing.len(), listing })
        }
        None => {
            let mut near: Vec<_> = functions.iter().map(|function| function.symbol.as_str()).collect();
            near.sort_by_cached_key(|known| strsim::damerau_levenshtein(known, symbol));
            near.truncate(3);
            let (near, symbol) = (near.join(", "), brief(symbol));
            Err(format!("there is no kernel `{symbol}`; the nearest are {near}: `rayo ops --kernels` lists all"))
        }
    }
}

/// A picture by an engine.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct FrameRow {
    pub engine: Name,
    pub width: u32,
    pub height: u32,
    /// Rays: one for each pixel, also where the engine knows without tracing what it hits.
    pub rays: u64,
    /// Instructions executed for all of it; preparing the scene is not among them.
    pub instructions: u64,
    pub per_pixel: f64,
    pub per_ray: f64,
}

/// Is told how much is done, of how much.
pub type Progress<'a> = dyn FnMut(usize, usize) + 'a;

/// The work of single-stepping through a picture, in rows of the table.
const FRAME_WORK: usize = 25;

/// Counts, and measures where that is asked for, with the calling thread on one core.
pub fn run(options: &Options, progress: &mut Progress<'_>) -> Result<Report, String> {
    let every = || OPS.into_iter().chain([LIT]);
    if let Some(op) = options.wanted.iter().find(|wanted| every().all(|op| op != *wanted)) {
        let (op, list) = (brief(op), OPS.join(", "));
        return Err(format!("there is no operation `{op}`; there are: {list}; and {LIT}, the rows of a sphere"));
    }
    let mut executed_unavailable = None;
    let mut step = options.executed;
    if step && let Err(reason) = step::count_instructions(|| ()) {
        executed_unavailable = Some(reason.to_string());
        step = false;
    }
    let mut feedback_cycles = None;
    let mut cores = None;
    if options.cost {
        // Unpinned figures are noisier, not wrong.
        cores = sys::Cores::of_this_thread().ok();
        let _ = sys::pin_to_this_core();
        feedback_cycles = kernels::feedback().and_then(|chain| chain_cycles(chain, LEAST_CYCLES));
    }
    let is_among = |name: &str, wanted: &[String]| wanted.iter().any(|wanted| wanted == name);
    let wanted = |name: &&str| options.implementations.is_empty() || is_among(name, &options.implementations);
    let ops = every().filter(|op| if options.wanted.is_empty() { *op != LIT } else { is_among(op, &options.wanted) });
    let implementations = |op| if op == LIT { &IMPLEMENTATIONS_OF_LIT[..] } else { &IMPLEMENTATIONS[..] };
    let cells: Vec<_> =
        ops.flat_map(|op| implementations(op).iter().copied().filter(wanted).map(move |name| (op, name))).collect();
    let engines: Vec<_> = Engine::ALL.iter().filter(|engine| engine.usable()).collect();
    let engines = if step && options.wanted.is_empty() { &engines[..] } else { &[] };
    let work = cells.len() + FRAME_WORK * engines.len();
    let mut rows = Vec::new();
    for (op, implementation) in cells {
        progress(rows.len(), work);
        rows.push(row(op, implementation, step, options.cost.then_some(feedback_cycles)));
    }
    let mut frames = Vec::new();
    for engine in engines {
        progress(rows.len() + FRAME_WORK * frames.len(), work);
        match frame(engine) {
            Ok(frame) => frames.push(frame),
            Err(reason) => executed_unavailable = Some(reason.to_string()),
        }
    }
    let core_cycles_per_tick = options.cost.then(core_cycles_per_tick);
    if let Some(cores) = cores {
        // It was allowed before; if it no longer is, the thread stays where it is.
        let _ = cores.allow();
    }
    let compilers = Compilers::this();
    Ok(Report { rows, frames, executed_unavailable, core_cycles_per_tick, feedback_cycles, compilers })
}

/// One cell of the table. `feedback_cycles`: what to take off chains of latency, where that is known; None for no costs.
fn row(op: &'static str, implementation: &'static str, step: bool, feedback_cycles: Option<Option<f64>>) -> Counts {
    let printed = OPS.iter().zip(PRINTED).find(|(name, _)| **name == op).map(|(_, printed)| printed);
    let mut row = Counts { op: op.into(), implementation: implementation.into(), ..Counts::default() };
    match (implementation, printed) {
        _ if op == LIT => {
            if let Some(code) = code(op, implementation, None) {
                row.count(&code);
            }
        }
        // What the paper counted as C looks like whole functions, its SIMD is its macros.
        ("printed-c", printed) => row.function = printed.map(|(c, _)| c),
        ("printed-simd", printed) => row.body = printed.map(|(_, simd)| simd),
        _ => {
            let subject = subject(op, implementation);
            if let Some(code) = code(op, implementation, subject.as_ref().ok()) {
                row.count(&code);
                match &subject {
                    Ok(subject) => row.execute(&code, subject, step, feedback_cycles.is_some()),
                    Err(reason) => row.unavailable = Some(reason.clone()),
                }
                if let Some(feedback) = feedback_cycles {
                    row.chain(feedback);
                    row.model = code.body_instructions().and_then(model::estimate);
                }
            }
        }
    }
    let vectors = row.vectors.or(row.body.or(row.function).map(|_| 1));
    row.vectors = vectors;
    row.per_vector = row.body.or(row.function).zip(vectors).map(|(count, vectors)| count as f64 / vectors as f64);
    row
}

/// The operation `op` of an implementation, ready to be called; else why there is none, or none that runs here.
fn subject(op: &str, implementation: &str) -> Result<Subject, String> {
    match implementation {
        "rust" => Ok(kept::rust(op)),
        "glam" => Ok(kept::glam(op)),
        "paper" => subjects::assembly(op, kernels::paper().ok_or("this CPU lacks SSE4.1")?),
        "aos" => subjects::assembly(op, kernels::aos().ok_or("this CPU lacks SSE4.1")?),
        _ => match implementation.strip_prefix("c-") {
            Some(level) => {
                let functions = kernels::by_value(level)
                    .ok_or("this build has no C, or this CPU lacks what its compiler was allowed to use")?;
                Ok(subjects::c(op, functions))
            }
            None => {
                let unknown = || format!("there is no implementation `{implementation}`");
                subjects::packet(op, isa(implementation).ok_or_else(unknown)?)
            }
        },
    }
}

/// The symbol of an operation in the objects.
fn symbol(op: &str, implementation: &str) -> String {
    match implementation.strip_prefix("c-") {
        Some(level) => format!("rayo_c_{level}_{op}"),
        None if isa(implementation).is_some() => format!("rayo_{implementation}_single_{op}3"),
        None => format!("rayo_{implementation}_{op}"),
    }
}

/// The ISA of an implementation on packets.
fn isa(implementation: &str) -> Option<Isa> {
    Isa::ALL.into_iter().find(|isa| isa.name() == implementation)
}

/// The code of an operation: out of the objects, or for Rust out of this process.
fn code(op: &str, implementation: &str, subject: Option<&Subject>) -> Option<Code> {
    match implementation {
        "portable" if op == LIT => {
            let widest = Isa::ALL.into_iter().rfind(|isa| isa.usable())?;
            Code::of_function(&format!("{op} for {widest}"), kernels::ladder::rows_in_rust(widest))
        }
        _ if op == LIT => Code::of_symbol(&format!("rayo_{implementation}_single_grey_rgba8")),
        "rust" | "glam" => Code::of_function(&format!("{implementation} {op}"), subject?.address),
        _ => Code::of_symbol(&symbol(op, implementation)),
    }
}

impl Counts {
    fn count(&mut self, code: &Code) {
        self.body_mix = code.body();
        self.function_mix = Some(code.function());
        self.body = self.body_mix.as_ref().map(|mix| mix.instructions);
        self.function = self.function_mix.as_ref().map(|mix| mix.instructions);
        self.vectors = isa(&self.implementation).map(Isa::lanes);
        self.critical_path = critical_path(&self.op, &self.implementation);
        self.listing = listing(code);
    }

    fn execute(&mut self, code: &Code, subject: &Subject, step: bool, cost: bool) {
        if step {
            for (case, path) in subject.paths.iter().enumerate() {
                let visits = step::count_function(subject.address, code.bytes(), || {
                    (subject.run)(case);
                });
                let visits = match visits {
                    Ok(visits) if visits.calls == 1 => visits,
                    Ok(visits) => {
                        self.unavailable = Some(format!("one call was made and {} were seen", visits.calls));
                        return;
                    }
                    Err(reason) => {
                        self.unavailable = Some(reason.to_string());
                        return;
                    }
                };
                let body = code.body.clone().map(|body| visits.at[body].iter().sum());
                self.paths.push(Path { path: (*path).into(), executed: visits.instructions, body });
                if case == 0 {
                    self.executed = Some(visits.instructions);
                    for line in &mut self.listing {
                        line.executed = Some(visits.at[line.offset]);
                    }
                }
            }
        }
        if cost {
            let [latency, throughput] = (subject.cost)();
            (self.call_latency, self.call_throughput) = (latency, throughput);
            self.cost(latency, throughput, "call");
        }
    }

    fn cost(&mut self, latency: Option<f64>, throughput: Option<f64>, of: &'static str) {
        (self.latency, self.throughput, self.cost_of) = (latency, throughput, Some(of.into()));
        if latency.is_none() || throughput.is_none() {
            self.no_cycles = Some(IMPOSSIBLE.into());
        }
    }

    /// Where there are chains of the body, they are what the row tells.
    fn chain(&mut self, feedback: Option<f64>) {
        let packets = isa(&self.implementation).and_then(kernels::chains_of_packets);
        let chains = match &*self.implementation {
            "paper" => kernels::chains_of_paper(),
            "aos" => kernels::chains_of_aos(),
            _ => packets.map(|packets| packets.chains),
        };
        let Some(Chains { latency, throughput, .. }) = chains.and_then(|c| c.iter().find(|c| c.op == self.op)) else {
            return;
        };
        let feedback = packets.map_or(feedback, |packets| chain_cycles(packets.feedback, LEAST_CYCLES));
        let latency = feedback.and_then(|feedback| Some(chain_cycles(*latency, feedback + LEAST_CYCLES)? - feedback));
        let least = self.body.map_or(0.0, |body| body as f64 / MOST_IN_A_CYCLE);
        self.cost(latency, chain_cycles(*throughput, least), "body");
    }
}

/// Core cycles for each operation of a chain, which takes `least` at least; None where none can be right.
fn chain_cycles(chain: kernels::Chain, least: f64) -> Option<f64> {
    core_cycles(REPEATS, least, || chain.run(ROUNDS))
}

/// What the comment above a macro says of its critical path, in the form that `implementation` takes.
fn critical_path(op: &str, implementation: &str) -> Option<String> {
    let upper = op.to_uppercase();
    let (aos, packet) = match op {
        "sphere" | "triangle" => (format!("{upper}_HIT"), format!("{upper}_HIT3")),
        "lambert" => (upper.clone(), format!("{upper}3")),
        _ => (format!("VEC_{upper}"), format!("{upper}3")),
    };
    let (name, second) = match implementation {
        "paper" => (aos, false),
        "aos" => (aos, true),
        _ => (packet, isa(implementation)? > Isa::Sse41),
    };
    let header = format!("; {name} - ");
    let sources = [
        include_str!("../../asm/include/vec3_aos.inc"),
        include_str!("../../asm/include/sphere_aos.inc"),
        include_str!("../../asm/include/triangle_aos.inc"),
        include_str!("../../asm/include/lambert_aos.inc"),
        include_str!("../../asm/include/vec3.inc"),
        include_str!("../../asm/include/sphere.inc"),
        include_str!("../../asm/include/triangle.inc"),
        include_str!("../../asm/include/lambert.inc"),
    ];
    let comment = sources.iter().find_map(|source| source.split_once(&header))?.1;
    let line = comment.lines().find_map(|line| line.split_once("critical path"))?.1;
    // Two forms stand in two columns.
    let forms: Vec<_> = line.split("   ").map(str::trim).filter(|form| !form.is_empty()).collect();
    forms.get(usize::from(second)).or(forms.first()).map(|form| form.to_string())
}

/// The paper's picture, small.
fn frame(engine: &Engine) -> Result<FrameRow, Unavailable> {
    let (width, height) = if engine.is_packet() { FRAME_OF_PACKETS } else { FRAME };
    let scene = in_size(&speedup::scene(), width, height);
    let rays = scene.camera.pixels();
    let tracer = engine.prepare(None, &scene).expect("the engine runs here, in its own precision");
    let mut film = Film::new(PixelFormat::F32x4, rays as usize).expect("memory for a small picture");
    // Once before: what is computed or bound at the first call is not the picture's.
    tracer.rows(0..height, film.as_mut());
    let instructions = step::count_instructions(|| tracer.rows(0..height, film.as_mut()))?;
    let per_pixel = instructions as f64 / rays as f64;
    Ok(FrameRow { engine: engine.name().into(), width, height, rays, instructions, per_pixel, per_ray: per_pixel })
}
