//! The verdict on a user's function: what `rayo try --json` prints, and the text is made of.

use std::collections::BTreeMap;

use serde::Serialize;

use super::call::SIGPROF;
use super::findings::{Check, Crash, Cycles, Fault, Finding, FourthLane, PROVED, Picture, Ratio, Step, Values};
use super::process::{End, Heard};
use super::requirements::Requirement;
use crate::measure::instructions::Mix;

/// The stage whose process may fail without the function's fault.
pub const PROOF: &str = "proof";

/// All that is known of a function.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Verdict {
    pub file: String,
    pub op: String,
    pub symbol: String,
    /// Whether everything that is required holds.
    pub holds: bool,
    /// What is required and does not hold.
    pub broken: Vec<String>,
    pub result: Values,
    pub odd: Check,
    pub fourth_lane: FourthLane,
    pub aliasing: FaultsVerdict,
    pub convention: FaultsVerdict,
    pub memory: FaultsVerdict,
    pub proof: ProofVerdict,
    pub instructions: Instructions,
    #[serde(rename = "cycles")]
    pub figures: Figures,
    pub crash: Option<Crash>,
    /// The beginning of what it printed.
    pub printed: String,
    /// What our own implementations cost, by name.
    pub against: BTreeMap<String, Figures>,
    /// The pictures of a tracer, and its time as a multiple of others'.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub pictures: Vec<Picture>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub ratios: Vec<Ratio>,
    /// A call, instruction by instruction, where that was asked for.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub steps: Vec<Step>,
    /// What could not be done, and why.
    pub notes: Vec<String>,
    /// What the tools said of the source.
    pub warnings: String,
    /// Bytes of each argument, and of the result.
    #[serde(skip)]
    pub reads: Vec<usize>,
    #[serde(skip)]
    pub writes: usize,
    /// Whether it writes where it may not.
    #[serde(skip)]
    pub writes_beyond: bool,
}

/// Whether it equals the twin for every input.
#[derive(Clone, Debug, Default, Serialize)]
pub struct ProofVerdict {
    /// None where no proof was tried.
    pub holds: Option<bool>,
    /// What is proved, or why nothing is; empty where no proof was tried.
    pub says: String,
}

#[derive(Clone, Debug, Default, Serialize)]
pub struct FaultsVerdict {
    pub holds: Option<bool>,
    pub faults: Vec<Fault>,
}

#[derive(Clone, Debug, Default, Serialize)]
pub struct Instructions {
    /// Whether there are no more than is required; None where they are not counted.
    pub holds: Option<bool>,
    pub function: Option<usize>,
    pub body: Option<usize>,
    pub executed: Option<u64>,
    pub executed_body: Option<u64>,
    /// By kind.
    pub mix: Option<Mix>,
}

/// What a call costs.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Figures {
    /// Whether the user's are no more than is required; None of ours, and where there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub holds: Option<bool>,
    pub latency: Option<f64>,
    pub throughput: Option<f64>,
    /// Static instructions, and those that a call executes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub function: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub body: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub executed: Option<u64>,
}

impl Verdict {
    /// Says of instructions and cycles whether they are what is required.
    pub(super) fn judge_figures(&mut self, required: &[Requirement]) {
        let hold = |names: &[&str]| {
            let asked = required.iter().filter(|required| required.is_one_of(names));
            asked.filter_map(|required| required.broken_by(self)).next().is_none()
        };
        let instructions = hold(&["instructions", "body", "executed"]);
        let cycles = hold(&["cycles", "throughput"]);
        self.instructions.holds = self.instructions.function.map(|_| instructions);
        self.figures.holds = self.figures.latency.map(|_| cycles);
    }

    /// Adds what a process has found out. `arguments` gives those of the input that it was at.
    pub(super) fn hear(&mut self, stage: &str, heard: Heard, arguments: impl FnOnce() -> Vec<(String, Vec<String>)>) {
        for finding in heard.findings {
            self.add(stage, finding);
        }
        self.printed += &heard.printed;
        if stage == PROOF {
            // A prover that gives up is no fault of the function.
            if self.proof.holds.is_none() {
                self.add(stage, Finding::Proof("none: the prover did not come to an end".into()));
            }
            return;
        }
        let what = match heard.end {
            End::Complete => return,
            End::Copied => "it starts a copy of the process: nothing more is asked of it".to_owned(),
            End::Late => "no answer in time: does it loop for ever?".to_owned(),
            End::Early(status) => ended(status),
        };
        if self.crash.is_none() {
            self.crash = Some(Crash { stage: stage.into(), what, arguments: arguments(), ..Crash::default() });
        }
    }

    fn add(&mut self, stage: &str, finding: Finding) {
        match finding {
            Finding::Values(values) => self.result = values,
            Finding::Odd(check) => self.odd = check,
            Finding::FourthLane(lane) => self.fourth_lane = lane,
            Finding::Aliasing(faults) => self.aliasing = faults.into(),
            Finding::Convention(faults) => {
                self.convention = faults.into();
            }
            Finding::Memory { faults, writes } => {
                self.memory = faults.into();
                self.writes_beyond = writes;
            }
            Finding::Crash(crash) => self.crash = Some(Crash { stage: stage.into(), ..*crash }),
            Finding::Executed(executed) => {
                self.instructions.executed = Some(executed.function);
                self.instructions.executed_body = executed.body;
            }
            Finding::Cycles(cycles) => cycles.into_iter().for_each(|cycles| self.add_cycles(cycles)),
            Finding::Undone(what) => {
                if !self.notes.contains(&what) {
                    self.notes.push(what);
                }
            }
            Finding::Picture(picture) => self.add_picture(picture),
            Finding::Ratios(ratios) => self.ratios = ratios,
            Finding::Steps(steps) => self.steps = steps,
            Finding::Proof(says) => self.proof = ProofVerdict { holds: Some(says.starts_with(PROVED)), says },
            Finding::Copy | Finding::Done => {}
        }
    }

    /// A picture counts as so many results.
    fn add_picture(&mut self, picture: Picture) {
        let holds = picture.wrong <= picture.allowed;
        self.result.inputs += u64::from(picture.width) * u64::from(picture.height);
        self.result.outside += picture.wrong;
        self.result.holds = Some(self.result.holds.unwrap_or(true) && holds);
        self.pictures.push(picture);
        let is_same = self.pictures.iter().all(|picture| picture.same_bits);
        self.result.same_bits = is_same.then(|| "paper".into());
    }

    fn add_cycles(&mut self, cycles: Cycles) {
        let figures = match cycles.contestant.as_str() {
            crate::experiments::ops::turns::YOURS => &mut self.figures,
            other => self.against.entry(other.to_owned()).or_default(),
        };
        figures.latency = cycles.latency;
        figures.throughput = cycles.throughput;
        figures.executed = cycles.executed;
    }
}

/// How a process ended that did not say all it was asked for.
fn ended(status: std::process::ExitStatus) -> String {
    use std::os::unix::process::ExitStatusExt;
    match (status.code(), status.signal()) {
        (Some(code), _) => format!("it ends the process, with exit status {code}"),
        (None, Some(SIGPROF)) => "no answer in time: does it loop for ever?".into(),
        (None, Some(9)) => "it was killed: it may have used all of its memory or time".into(),
        (None, Some(number)) => {
            format!("it kills the process: {}", crate::measure::crash::signal(number))
        }
        (None, None) => "it ends the process".into(),
    }
}

impl From<Vec<Fault>> for FaultsVerdict {
    fn from(faults: Vec<Fault>) -> Self {
        FaultsVerdict { holds: Some(faults.is_empty()), faults }
    }
}
