//! The instructions of every operation, as in section 4 of the paper, and their cycles.

mod kept;
mod model;
pub mod plot;
mod subjects;
pub mod turns;

use serde::{Deserialize, Serialize};

use super::check::{self, Failed};
use super::{in_size, prove, speedup};
use crate::measure::instructions::{Code, Function, Instruction, Mix, functions};
use crate::measure::source::{FunctionInUnit, Origin, Unit};
use crate::measure::{Name, core_cycles, core_cycles_per_tick};
pub use model::Model;
use rayo::internals::kernels::step::{self, Unavailable};
use rayo::internals::kernels::{self, Chains, Isa, sys};
use rayo::internals::reference::aos::Form;
use rayo::internals::render::{Engine, Film, PixelFormat};
use rayo::internals::scene::brief;
use subjects::Subject;

/// All operations, in the order of the table.
pub use rayo::internals::kernels::ALL_OPERATIONS;
/// The operations that the table has: the paper's six, and those that its tracer builds from them.
/// Operations without a packet form are not in the table, but are counted on request.
pub use rayo::internals::kernels::OPERATIONS as OPS;

/// A kernel that is listed on request, beside the operations: it renders rows of a grey sphere to
/// bytes by the packets' closed form.
pub const LIT: &str = "lit";
/// The implementations of [`LIT`]. `portable` is the one in Rust, compiled for the widest packets
/// that this CPU has.
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

/// The paper's counts in C and in SIMD, for the first six of [`OPS`].
const PRINTED: [(usize, usize); 6] = [(35, 1), (35, 1), (25, 2), (25, 3), (26, 4), (44, 7)];

/// How many rounds of a chain, or calls of a function, a measurement consists of.
const ROUNDS: u64 = 200;
/// The number of measurements; the fastest one counts.
const REPEATS: u32 = 25;

/// The least latency that is possible: a result, and the instruction after a call or a return, is
/// available after one cycle at the earliest.
const LEAST_CYCLES: f64 = 1.0;
/// The most instructions that any core finishes in a cycle.
const MOST_IN_A_CYCLE: f64 = 8.0;
/// The reason that a row gives if the measured cycles were impossible.
const IMPOSSIBLE: &str =
    "no cycles: others had the core each time, or left it too little for any that an operation can take";

/// The sizes of the picture that is single-stepped: small for engines that trace pixels one by one,
/// for which a few pixels suffice; larger for packets, which share work within a row.
const FRAME: (u32, u32) = (16, 12);
const FRAME_OF_PACKETS: (u32, u32) = (64, 48);

#[derive(Clone, Debug, Default)]
pub struct Options {
    /// The requested operations, or [`LIT`]; empty for [`OPS`].
    pub wanted: Vec<String>,
    /// The requested [`IMPLEMENTATIONS`]; empty for all.
    pub implementations: Vec<String>,
    /// Whether to count executed instructions too.
    pub executed: bool,
    /// Whether to measure latency and throughput.
    pub cost: bool,
}

/// The counts and costs: the `ops` document without its schema number.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Report {
    /// A row for every requested operation and implementation.
    pub rows: Vec<Counts>,
    /// The instructions of a small picture by each engine; empty if executed instructions were not
    /// requested or cannot be counted.
    pub frames: Vec<FrameRow>,
    /// Why executed instructions were not counted although they were requested.
    pub executed_unavailable: Option<String>,
    /// Core cycles per tick of the time-stamp counter when the costs were measured.
    pub core_cycles_per_tick: Option<f64>,
    /// The core cycles that a chain of operations on single vectors needs to turn a result into the
    /// next operand. They are subtracted from the latencies of bodies; packets have a value of
    /// their own.
    pub feedback_cycles: Option<f64>,
    /// The assembler, the C compiler and the Rust compiler of this build.
    pub compilers: Compilers,
}

/// The tools that built the counted code.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Compilers {
    pub nasm: Name,
    pub cc: Name,
    pub rustc: Name,
}

impl Compilers {
    /// The tools of this build.
    pub fn this() -> Self {
        let or_none = |version: Option<&'static str>| version.unwrap_or("none");
        Compilers {
            nasm: or_none(kernels::built::NASM).into(),
            cc: or_none(kernels::built::CC).into(),
            rustc: kernels::built::RUSTC.into(),
        }
    }
}

/// The counts of an operation in one implementation. What does not apply, or could not be measured
/// here, is None.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Counts {
    /// The operation.
    pub op: Name,
    /// One of [`IMPLEMENTATIONS`].
    pub implementation: Name,
    /// Instructions of the macro between loading operands and storing the result.
    pub body: Option<usize>,
    /// Instructions of the whole symbol: loads, stores and `ret` too, but not what it calls.
    pub function: Option<usize>,
    /// The number of vectors that one pass of the body serves.
    pub vectors: Option<usize>,
    /// Instructions per vector of the body, or of the function if there is no body.
    pub per_vector: Option<f64>,
    /// Whether the code is proved to give its twin's results for all inputs; None for compiled
    /// code.
    #[serde(default)]
    pub proved: Option<bool>,
    /// The instructions that a call executes on its first path, from the function's entry to its
    /// return, with those of functions that it calls.
    pub executed: Option<u64>,
    /// Latency in core cycles, from operand to result: of the body if the operation can be chained,
    /// else of a call.
    pub latency: Option<f64>,
    /// Core cycles per operation when many independent ones overlap: of the body or of a call,
    /// whichever `latency` is of.
    pub throughput: Option<f64>,
    /// Whether `latency` and `throughput` are those of the `body` or of a `call`.
    pub cost_of: Option<Name>,
    /// Latency of a call in core cycles, measured by letting the address of each operand depend on
    /// the previous result.
    pub call_latency: Option<f64>,
    /// Core cycles per call when many independent calls overlap.
    pub call_throughput: Option<f64>,
    /// The longest chain of dependent operations, in words, from the macro's comment.
    pub critical_path: Option<String>,
    pub body_mix: Option<Mix>,
    pub function_mix: Option<Mix>,
    pub paths: Vec<Path>,
    /// llvm-mca's estimate for a body without jumps: a model, not a measurement.
    pub model: Option<Model>,
    /// Why the code cannot run here, if there is code.
    pub unavailable: Option<String>,
    /// Why latency or throughput is None although it was measured.
    pub no_cycles: Option<Name>,
    /// The listing of the function.
    pub listing: Vec<Line>,
}

/// The counts of one path through an operation.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Path {
    /// A description of the operands that take this path.
    pub path: Name,
    /// Instructions executed by a call, including what it calls.
    pub executed: u64,
    /// How many of the executed instructions are in the body.
    pub body: Option<u64>,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Line {
    /// Bytes from the beginning of the function.
    pub offset: usize,
    /// The instruction in Intel's syntax.
    pub text: String,
    pub body: bool,
    /// How many times a call on the first path executes it, if that was counted.
    pub executed: Option<u64>,
    /// The target of a jump, as an offset like `offset`; in C and Rust it may lie outside of the
    /// function.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target: Option<usize>,
    /// Its place in the source, for kernels in NASM that this CPU runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub source: Option<Source>,
}

/// The source line of an instruction.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Source {
    /// The file of the innermost macro; empty for an instruction outside of macros.
    pub file: String,
    pub line: usize,
    pub text: String,
    /// The macros that the instruction comes from, outermost first.
    pub macros: Vec<String>,
}

/// The listing of a function. Instructions that are in the table of source lines have their source.
pub fn listing(code: &Code) -> Vec<Line> {
    let unit = Unit::with_function(&code.symbol);
    let source = |i: &Instruction| {
        let FunctionInUnit { unit, address } = unit?;
        let Origin { calls, number, text, .. } = unit.origin(address + i.offset)?;
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

/// The function with a given symbol: a kernel of an engine, or any other function in the objects,
/// such as one in C or for tests.
///
/// # Errors
/// If there is no such symbol; the message names similar ones.
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

/// The instructions of a picture by an engine.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct FrameRow {
    pub engine: Name,
    pub width: u32,
    pub height: u32,
    /// The number of rays: one per pixel, even where the engine knows the hits of a pixel without a
    /// test.
    pub rays: u64,
    /// Instructions executed for the whole picture, without preparing the scene.
    pub instructions: u64,
    pub per_pixel: f64,
    pub per_ray: f64,
}

/// A callback for progress: gets the work done so far and the total work.
pub type Progress<'a> = dyn FnMut(usize, usize) + 'a;

/// How much work single-stepping a picture is, as a multiple of a table row's work.
const FRAME_WORK: usize = 25;

/// Why nothing was counted.
#[derive(Debug, thiserror::Error)]
pub enum OpsError {
    #[error(
        "there is no operation `{}`; there are: {}; and {LIT}, the rows of a sphere",
        brief(.0),
        ALL_OPERATIONS.join(", ")
    )]
    NoOperation(String),
    /// Some kernels are wrong, so that neither their instructions nor their cycles would mean
    /// anything.
    #[error("{}", in_words(.0))]
    Wrong(Vec<Failed>),
}

/// The message about wrong kernels: all details of the first ones, and the names of the others.
fn in_words(wrong: &[Failed]) -> String {
    const TOLD: usize = 3;
    let (told, others) = wrong.split_at(wrong.len().min(TOLD));
    let mut words: Vec<_> = told.iter().map(ToString::to_string).collect();
    if !others.is_empty() {
        let others: Vec<_> = others.iter().map(|failed| failed.symbol.as_str()).collect();
        words.push(format!("and so are or do: {}", others.join(", ")));
    }
    words.push("nothing is counted or timed until this is mended; --asm lists the instructions all the same".into());
    words.join("\n")
}

/// For each row of the table the operation and the implementation.
fn cells(options: &Options) -> Result<Vec<(&'static str, &'static str)>, OpsError> {
    let every = || ALL_OPERATIONS.into_iter().chain([LIT]);
    if let Some(op) = options.wanted.iter().find(|wanted| every().all(|op| op != *wanted)) {
        return Err(OpsError::NoOperation(op.clone()));
    }
    let is_among = |name: &str, wanted: &[String]| wanted.iter().any(|wanted| wanted == name);
    let is_wanted = |op: &&str| match options.wanted.is_empty() {
        true => OPS.contains(op),
        false => is_among(op, &options.wanted),
    };
    let has_row = |name: &&str| options.implementations.is_empty() || is_among(name, &options.implementations);
    let implementations = |op| if op == LIT { &IMPLEMENTATIONS_OF_LIT[..] } else { &IMPLEMENTATIONS[..] };
    let rows = |op| implementations(op).iter().copied().filter(has_row).map(move |name| (op, name));
    Ok(every().filter(is_wanted).flat_map(rows).collect())
}

/// Checks the requested kernels, and their chains if cycles are to be measured, and returns the
/// wrong ones.
pub fn wrong(options: &Options) -> Result<Vec<Failed>, OpsError> {
    let checks = cells(options)?.into_iter().flat_map(|(op, implementation)| check(op, implementation, options.cost));
    Ok(checks.filter_map(Result::err).map(|failed| *failed).collect())
}

/// Checks an operation in assembly against its twin. Compiled operations in C and Rust are not
/// checked.
fn check(op: &str, implementation: &str, chains: bool) -> Vec<Result<(), Box<Failed>>> {
    let of_macros = |form, kernels: Option<_>| kernels.map_or(Ok(()), |kernels| check::macros(form, op, kernels));
    let function = match implementation {
        "paper" => of_macros(Form::Paper, kernels::paper()),
        "aos" => of_macros(Form::Best, kernels::aos()),
        _ => isa(implementation).map_or(Ok(()), |isa| check::packets::<f32>(isa, op)),
    };
    let chains = chains_of(op, implementation).filter(|_| chains);
    let chains = chains.into_iter().flat_map(|chains| [chains.latency, chains.throughput]).map(check::chain);
    [function].into_iter().chain(chains).collect()
}

/// The chains of an operation in an implementation, if there are any that run here.
fn chains_of(op: &str, implementation: &str) -> Option<&'static Chains> {
    let chains = match implementation {
        "paper" => kernels::chains_of_paper()?,
        "aos" => kernels::chains_of_aos()?,
        _ => kernels::chains_of_packets(isa(implementation)?)?.chains,
    };
    chains.iter().find(|chains| chains.op == op)
}

/// Counts instructions, and measures cycles if requested, with the calling thread pinned to one
/// core.
///
/// # Errors
/// If an operation does not exist, or if kernels that are to be executed are [`wrong`].
pub fn run(options: &Options, progress: &mut Progress<'_>) -> Result<Report, OpsError> {
    let cells = cells(options)?;
    let wrong = if options.executed || options.cost { wrong(options)? } else { Vec::new() };
    if !wrong.is_empty() {
        return Err(OpsError::Wrong(wrong));
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
        // Failing to pin the thread makes the figures noisier, not wrong.
        cores = sys::Cores::of_this_thread().ok();
        let _ = sys::pin_to_this_core();
        feedback_cycles = kernels::feedback().and_then(|chain| chain_cycles(chain, LEAST_CYCLES));
    }
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
        // These cores were allowed before. If they no longer are, the thread stays pinned.
        let _ = cores.allow();
    }
    let compilers = Compilers::this();
    Ok(Report { rows, frames, executed_unavailable, core_cycles_per_tick, feedback_cycles, compilers })
}

/// One row of the table. `feedback_cycles` is None if cycles are not to be measured; otherwise it
/// has the cycles to subtract from the latencies of chains, if these are known.
fn row(op: &'static str, implementation: &'static str, step: bool, feedback_cycles: Option<Option<f64>>) -> Counts {
    let printed = OPS.iter().zip(PRINTED).find(|(name, _)| **name == op).map(|(_, printed)| printed);
    let mut row = Counts { op: op.into(), implementation: implementation.into(), ..Counts::default() };
    match (implementation, printed) {
        _ if op == LIT => {
            if let Some(code) = code(op, implementation, None) {
                row.count(&code);
            }
        }
        // The paper's counts of C appear to be those of whole functions, and its counts of SIMD
        // those of macros.
        ("printed-c", printed) => row.function = printed.map(|(c, _)| c),
        ("printed-simd", printed) => row.body = printed.map(|(_, simd)| simd),
        _ => {
            let subject = subject(op, implementation);
            if let Some(code) = code(op, implementation, subject.as_ref().ok()) {
                row.count(&code);
                row.proved = prove::is_proved(op, implementation);
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

/// The operation `op` of an implementation, ready to be called; or the reason why it does not exist
/// or does not run here.
fn subject(op: &str, implementation: &str) -> Result<Subject, String> {
    match implementation {
        "rust" => kept::rust(op).ok_or_else(|| unwritten("Rust")),
        "glam" => kept::glam(op).ok_or_else(|| unwritten("Rust with glam")),
        "paper" => subjects::assembly(op, kernels::paper().ok_or("this CPU lacks SSE4.1")?),
        "aos" => subjects::assembly(op, kernels::aos().ok_or("this CPU lacks SSE4.1")?),
        _ => match implementation.strip_prefix("c-") {
            Some(level) => {
                let functions = kernels::by_value(level)
                    .ok_or("this build has no C, or this CPU lacks what its compiler was allowed to use")?;
                subjects::c(op, functions).ok_or_else(|| unwritten("C by value"))
            }
            None => {
                let unknown = || format!("there is no implementation `{implementation}`");
                subjects::packet(op, isa(implementation).ok_or_else(unknown)?)
            }
        },
    }
}

/// The reason why a newly added operation has no row yet for an implementation in `language`.
fn unwritten(language: &str) -> String {
    format!("it is not written in {language}")
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

/// The machine code of an operation: from the objects or, for Rust, from this process.
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
            let [latency, throughput] = (subject.cost)(REPEATS);
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

    /// Takes the row's costs from chains of the body, if there are any.
    fn chain(&mut self, feedback: Option<f64>) {
        let packets = isa(&self.implementation).and_then(kernels::chains_of_packets);
        let Some(Chains { latency, throughput, .. }) = chains_of(&self.op, &self.implementation) else { return };
        let feedback = packets.map_or(feedback, |packets| chain_cycles(packets.feedback, LEAST_CYCLES));
        let latency = feedback.and_then(|feedback| Some(chain_cycles(*latency, feedback + LEAST_CYCLES)? - feedback));
        let least = self.body.map_or(0.0, |body| body as f64 / MOST_IN_A_CYCLE);
        self.cost(latency, chain_cycles(*throughput, least), "body");
    }
}

/// Core cycles per operation of a chain. None if they are fewer than `least`, which is impossible,
/// so that the measurement must be wrong.
fn chain_cycles(chain: kernels::Chain, least: f64) -> Option<f64> {
    core_cycles(REPEATS, least, || chain.run(ROUNDS))
}

/// The critical path from the comment above a macro, in the form that `implementation` uses.
fn critical_path(op: &str, implementation: &str) -> Option<String> {
    let upper = op.to_uppercase();
    let (aos, packet) = match op {
        "sphere" | "triangle" => (format!("{upper}_HIT"), format!("{upper}_HIT3")),
        "lambert" => (upper.clone(), format!("{upper}3")),
        "lambert2" => ("LAMBERT".into(), "LAMBERT3".into()),
        _ => (format!("VEC_{upper}"), format!("{upper}3")),
    };
    let (name, second) = match implementation {
        "paper" => (aos, false),
        "aos" => (aos, true),
        _ => (packet, isa(implementation)? > Isa::Sse41),
    };
    let header = format!("; {name} - ");
    let sources = [
        include_str!("../../../asm/include/vec3_aos.inc"),
        include_str!("../../../asm/include/sphere_aos.inc"),
        include_str!("../../../asm/include/triangle_aos.inc"),
        include_str!("../../../asm/include/lambert_aos.inc"),
        include_str!("../../../asm/include/vec3.inc"),
        include_str!("../../../asm/include/sphere.inc"),
        include_str!("../../../asm/include/triangle.inc"),
        include_str!("../../../asm/include/lambert.inc"),
    ];
    let comment = sources.iter().find_map(|source| source.split_once(&header))?.1;
    let line = comment.lines().find_map(|line| line.split_once("critical path"))?.1;
    // In the comment the critical paths of the two forms are two columns.
    let forms: Vec<_> = line.split("   ").map(str::trim).filter(|form| !form.is_empty()).collect();
    forms.get(usize::from(second)).or(forms.first()).map(|form| form.to_string())
}

/// Counts the instructions of a small version of the paper's picture.
fn frame(engine: &Engine) -> Result<FrameRow, Unavailable> {
    let (width, height) = if engine.is_packet() { FRAME_OF_PACKETS } else { FRAME };
    let scene = in_size(&speedup::scene(), width, height);
    let rays = scene.camera.pixels();
    let tracer = engine.prepare(None, &scene).expect("the engine runs here, in its own precision");
    let mut film = Film::new(PixelFormat::F32x4, rays as usize).expect("memory for a small picture");
    // The picture is traced once before, so that work of a first call, such as symbol binding, is
    // not counted.
    tracer.rows(0..height, film.as_mut());
    let instructions = step::count_instructions(|| tracer.rows(0..height, film.as_mut()))?;
    let per_pixel = instructions as f64 / rays as f64;
    Ok(FrameRow { engine: engine.name().into(), width, height, rays, instructions, per_pixel, per_ray: per_pixel })
}
