//! What is found out about a user's function, as the process that runs it reports it.

use serde::{Deserialize, Serialize};

use super::lines::Line;
use super::wanted::{Sample, Trial, Wanted};

/// Something that was found out. A line of JSON each, between two processes.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub enum Finding {
    /// How results compare for ordinary numbers.
    Values(Values),
    /// The same for infinities, NaN, denormal numbers and extreme exponents.
    Odd(Check),
    FourthLane(FourthLane),
    /// Arguments at the same address.
    Aliasing(Vec<Fault>),
    /// Rules of the calling convention.
    Convention(Vec<Fault>),
    /// Memory beside the arguments, and whether something is written there.
    Memory {
        faults: Vec<Fault>,
        writes: bool,
    },
    Crash(Box<Crash>),
    /// Executed instructions: of the function, and of its body.
    Executed(Executed),
    /// Cycles of each contestant.
    Cycles(Vec<Cycles>),
    /// The picture of a tracer.
    Picture(Picture),
    /// Ratios of its time to others'.
    Ratios(Vec<Ratio>),
    /// A call, instruction by instruction.
    Steps(Vec<Step>),
    /// Whether it is proved to equal the twin, in words that begin with [`PROVED`] if it is.
    Proof(String),
    /// The code started a copy of the process.
    Copy,
    /// What could not be done, and why.
    Undone(String),
    /// The last one.
    Done,
}

/// How a proof in words begins.
pub const PROVED: &str = "the same as";

/// How the results compare with those that are expected.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Values {
    /// Whether all are within the bound of any order of operations; None if that is not known.
    pub holds: Option<bool>,
    /// Inputs that were tried.
    pub inputs: u64,
    /// What all results have the same bits as, if there is such a thing.
    pub same_bits: Option<String>,
    /// The largest error where terms do not cancel, in units of the last place of the exact result.
    pub max_ulp: Option<f64>,
    /// The same of the expected results themselves.
    pub max_ulp_expected: Option<f64>,
    /// How many results are outside of the bound of any order of operations.
    pub outside: u64,
    /// The smallest input found whose result is outside.
    pub worst: Option<Example>,
}

/// An input with its results, lane by lane.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Example {
    /// The arguments: the name of each, and its numbers.
    pub arguments: Vec<(String, Vec<String>)>,
    pub lanes: Vec<Lane>,
}

/// A number of a result.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Lane {
    pub expected: String,
    pub got: String,
    pub is_right: bool,
}

/// Inputs that were tried, and one that failed.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Check {
    /// None if nothing was tried.
    pub holds: Option<bool>,
    pub inputs: u64,
    pub failed: u64,
    pub worst: Option<Example>,
}

/// What a function does with fourth lanes that are not 0.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct FourthLane {
    pub holds: Option<bool>,
    /// How many inputs had one.
    pub inputs: u64,
    /// What the function does with it.
    pub says: String,
    pub worst: Option<Example>,
}

/// A broken rule, in words, with the line that breaks it as far as that is known.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fault {
    pub rule: String,
    /// The instruction that breaks it.
    pub instruction: Option<String>,
    pub line: Option<Line>,
}

impl Fault {
    pub fn new(rule: impl Into<String>) -> Self {
        Fault { rule: rule.into(), instruction: None, line: None }
    }
}

/// What ended a call, or its process.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Crash {
    /// Where: among the results, the guard pages or the figures.
    pub stage: String,
    /// The signal, in words.
    pub what: String,
    /// Why, if that is known: the address.
    pub cause: Option<String>,
    pub instruction: Option<String>,
    pub line: Option<Line>,
    /// The arguments of the call.
    pub arguments: Vec<(String, Vec<String>)>,
}

/// Executed instructions of a call.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Executed {
    pub function: u64,
    pub body: Option<u64>,
}

/// What calls of a contestant cost, in cycles of the core.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Cycles {
    pub contestant: String,
    /// From an operand to the result that depends on it.
    pub latency: Option<f64>,
    /// Of a call, when the calls are independent.
    pub throughput: Option<f64>,
    /// Executed instructions of a call.
    pub executed: Option<u64>,
}

/// The picture of a tracer, held against the reference's.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Picture {
    pub scene: String,
    pub width: u32,
    pub height: u32,
    /// Whether it has the bits of `paper`'s.
    pub same_bits: bool,
    /// Pixels that are off by more than 1/255.
    pub wrong: u64,
    /// How many may be, at outlines.
    pub allowed: u64,
    /// The largest difference of a channel.
    pub largest: f64,
    /// The pixel of the largest difference.
    pub at: Option<(u32, u32)>,
}

/// The time of one tracer as a multiple of another's, with an interval.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Ratio {
    pub scene: String,
    /// What is divided by what: `C/yours`, `yours/paper`.
    pub what: String,
    pub ratio: f64,
    pub low: f64,
    pub high: f64,
    /// Cycles a pixel of the user's.
    pub per_pixel: f64,
}

/// An instruction that was executed.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Step {
    pub text: String,
    pub line: Option<Line>,
    /// What it changed: the name of each register, and what is in it.
    pub changed: Vec<(String, String)>,
}

/// What a process for a user's code is asked for.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Request {
    pub shared: std::path::PathBuf,
    pub symbol: String,
    /// The function's address in the file, and its length.
    pub offset: u64,
    pub bytes: usize,
    /// The place of its body in it.
    pub body: Option<(usize, usize)>,
    pub wanted: Wanted,
    pub stage: Stage,
    pub seed: u64,
    /// How many inputs to try in the stage of results.
    pub inputs: u32,
    pub seconds: u32,
    /// A file that gets the number of the input that is being tried.
    pub progress: std::path::PathBuf,
}

/// What a process is asked for: each stage has one of its own, so that a stage that ends its
/// process leaves the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Stage {
    /// Results, and the calling convention.
    Values,
    /// Guard pages.
    Memory,
    /// Executed instructions and cycles.
    Figures,
    /// One call, instruction by instruction.
    Steps,
    /// The proof for all inputs.
    Proof,
}

/// How many inputs are tried between guard pages, or at the same address.
pub const FENCED_INPUTS: u32 = 54;

impl Request {
    /// The inputs of its stage: what is noted of progress are their indices.
    pub fn trials(&self) -> Vec<Trial> {
        let inputs = if self.stage == Stage::Memory { FENCED_INPUTS } else { self.inputs };
        self.wanted.trials(inputs, self.seed)
    }
}

impl Example {
    pub fn new(wanted: &Wanted, sample: &Sample, lanes: Vec<Lane>) -> Self {
        Example { arguments: told(wanted, sample), lanes }
    }
}

/// The arguments of a call, by name.
pub fn told(wanted: &Wanted, sample: &Sample) -> Vec<(String, Vec<String>)> {
    wanted.arguments(sample).into_iter().map(|argument| (argument.name.to_owned(), argument.numbers)).collect()
}
