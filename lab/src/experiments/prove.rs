//! Proofs that operations in assembly equal their twins for all inputs.
//!
//! A proof reads the machine code of a function of this program, instruction by instruction, with
//! symbols for its inputs ([`machine`]), and runs the twin in Rust with the same symbols
//! ([`symbol`]). Both give expressions ([`graph`]). If these are the same, or are the same in every
//! case of the conditions that they contain ([`decide`]), code and twin are equal for all inputs,
//! except that a NaN may be another NaN. If they are not, random inputs are tried until some show a
//! difference, and the CPU runs the code on these.
//!
//! A proof assumes that the model of the instructions is right, which `rayo step` compares with the
//! CPU at each step that it shows; that rounding is to nearest, with denormals; and that the
//! arguments point to what the contract of the function says. A proof covers neither the calling
//! convention nor exceptions nor accesses beyond the arguments: tests do.

pub mod alone;
pub mod decide;
pub mod evaluate;
pub mod goals;
pub mod graph;
pub mod listing;
pub mod machine;
pub mod mutants;
pub mod operations;
pub mod rounding;
pub mod symbol;

use std::collections::HashMap;
use std::ops::Range;

use decide::Difference;
use evaluate::Evaluator;
use graph::{Lemma, Node};
use machine::{Machine, Program, Unproved};
use symbol::Path;

use crate::experiments::check::inputs::{Numbers, choose};
use crate::experiments::step::model::Number;
use rayo::internals::kernels::Isa;
use rayo::internals::render::Precision;
use rayo::internals::scene::Rng;

/// How many random inputs are tried where two computations are not proved equal.
const TRIES: usize = 400;
/// The seed of the random inputs.
const SEED: u64 = 1;

/// Everything that is proved: the operations of the tables, and the tracers' macros by themselves.
pub fn subjects() -> Vec<Subject> {
    let mut subjects = operations::all();
    subjects.extend(alone::all());
    subjects.retain(|subject| subject.isa.built());
    subjects
}

/// Whether an operation in f32 is proved to equal its twin. None for an implementation that is not
/// in assembly.
pub fn is_proved(operation: &str, implementation: &str) -> Option<bool> {
    let is_wanted = |subject: &Subject| {
        let name = if subject.form == "packets" { subject.isa.name() } else { subject.form };
        subject.name == operation && name == implementation && subject.precision == Precision::Single
    };
    let subject = operations::all().into_iter().find(|subject| subject.isa.built() && is_wanted(subject))?;
    Some(prove(&subject).verdict == Verdict::Proved)
}

/// Macros with an `equals` line that are not proved, and why.
///
/// A solver of bit vectors could prove these, and one iteration of the loop of `nearest` over the
/// blocks of an object, in which integers choose the lanes that f64 decides. There it stops: such a
/// solver expands each product and each root of floats into gates, thousands for one of f64, where
/// equal expressions are equal without. So loops are compared with their twins by tests.
pub const EXCEPTIONS: [(&str, &str); 4] =
    [("FIRST_AND_PAST", INTEGERS), ("LENGTH", INTEGERS), ("ONE_RAY", INTEGERS), ("MEETS", INTEGERS)];
const INTEGERS: &str = "it computes with integers, of which the model knows results alone";

/// Code, its arguments, and the twin that it is to equal.
pub struct Subject {
    /// The operation, or the macro.
    pub name: &'static str,
    /// `paper` and `aos` for one vector in a register, `packets` for one in each lane.
    pub form: &'static str,
    pub isa: Isa,
    pub precision: Precision,
    /// The macros that the code is made of, which the proof covers.
    pub macros: &'static [&'static str],
    /// The function's name in the linked program.
    pub symbol: &'static str,
    pub address: usize,
    /// Pairs of a general register and the argument that it holds. Registers have the numbers that
    /// instructions encode.
    pub registers: Vec<(usize, u64)>,
    pub inputs: Vec<InputNumber>,
    /// The results of each lane.
    pub results: Vec<Vec<ResultNumber>>,
    /// The twin's results for a lane.
    pub twin: Box<dyn Fn(usize) -> Vec<Node>>,
    /// Calls the code on the CPU; None where the CPU lacks the instructions.
    pub call: Option<Call>,
}

impl Subject {
    /// The indices of a lane's results among the results of all lanes.
    fn results_of(&self, lane: usize) -> Range<usize> {
        let first: usize = self.results[..lane].iter().map(Vec::len).sum();
        first..first + self.results[lane].len()
    }
}

/// A number that the code leaves in memory.
#[derive(Clone, Copy)]
pub struct ResultNumber {
    pub address: u64,
    pub format: Number,
}

/// A number in memory that the code may read.
pub struct InputNumber {
    pub address: u64,
    pub format: Number,
    pub name: String,
}

/// Calls a function, and returns the results of all lanes. The argument gives the bits of each
/// input by its name.
pub type Call = Box<dyn Fn(&dyn Fn(&str) -> u64) -> Vec<u64>>;

/// The outcome of a proof.
#[derive(Clone, Debug, PartialEq)]
pub struct Proof {
    pub verdict: Verdict,
    /// How many paths go through the machine code, and how many pairs of such a path and a path
    /// through the twin some input can take.
    pub paths: usize,
    pub pairs: usize,
    /// How often each of [`Lemma::ALL`] was used.
    pub lemmas: [usize; Lemma::ALL.len()],
}

#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Equal for all inputs.
    Proved,
    /// Not equal, with inputs that show it, if the search found any.
    Differs(Option<Counterexample>),
    /// Neither proved nor refuted, for the given reason.
    Unproved(String),
}

/// Inputs on which code and twin differ.
#[derive(Clone, Debug, PartialEq)]
pub struct Counterexample {
    /// The name and the value of each input.
    pub inputs: Vec<(String, f64)>,
    pub lane: usize,
    /// The results of the code and of the twin, computed by the model.
    pub code: Vec<f64>,
    pub twin: Vec<f64>,
    /// Whether the CPU has run the code on these inputs and given the model's results.
    pub seen: bool,
}

/// Proves that a subject equals its twin, or says why not.
pub fn prove(subject: &Subject) -> Proof {
    prove_in(subject, &Program::default())
}

/// [`prove`] for a program in which bytes may be changed.
pub fn prove_in(subject: &Subject, program: &Program) -> Proof {
    graph::clear();
    let (verdict, paths, pairs) = match compared(subject, program) {
        Ok((paths, pairs)) => (Verdict::Proved, paths, pairs),
        Err(verdict) => (verdict, 0, 0),
    };
    Proof { verdict, paths, pairs, lemmas: graph::uses() }
}

/// The paths through the code, and for each lane those through the twin.
pub struct Paths {
    pub code: Vec<Path>,
    pub twins: Vec<Vec<Path>>,
}

impl Paths {
    /// The code's paths with the results of one lane.
    pub fn code_of(&self, subject: &Subject, lane: usize) -> Vec<Path> {
        let results = subject.results_of(lane);
        let of_lane =
            |path: &Path| Path { conditions: path.conditions.clone(), results: path.results[results.clone()].to_vec() };
        self.code.iter().map(of_lane).collect()
    }
}

/// Runs code and twin over symbols.
///
/// # Errors
/// Why the code could not be read.
pub fn paths(subject: &Subject, program: &Program) -> Result<Paths, Unproved> {
    let mut machine = Machine::new(program, subject.address as u64);
    for &(register, value) in &subject.registers {
        machine.set_general(register, value);
    }
    for InputNumber { address, format, name } in &subject.inputs {
        machine.set_memory(*address, graph::input(*format, name));
    }
    let code = machine.run(&subject.results.concat())?;
    let twins = (0..subject.results.len()).map(|lane| symbol::paths(|| (subject.twin)(lane))).collect();
    Ok(Paths { code, twins })
}

/// Compares code and twin in all lanes. Returns the numbers of paths and pairs, as in [`Proof`].
///
/// # Errors
/// The verdict, if they are not equal in some lane or if that could not be decided.
fn compared(subject: &Subject, program: &Program) -> Result<(usize, usize), Verdict> {
    let unproved = |why: Unproved| Verdict::Unproved(why.to_string());
    let paths = paths(subject, program).map_err(unproved)?;
    let mut pairs = 0;
    for (lane, twin) in paths.twins.iter().enumerate() {
        let code = paths.code_of(subject, lane);
        for path in code.iter().chain(twin) {
            let conditions = path.conditions.iter().map(|condition| condition.node);
            let all: Vec<_> = path.results.iter().copied().chain(conditions).collect();
            if decide::reads_bits_of_results(&all) {
                return Err(unproved(Unproved::BitsOfNan));
            }
        }
        match decide::compare(&code, twin) {
            Ok(pairs_of_lane) => pairs += pairs_of_lane,
            Err(Difference::Cases) => return Err(Verdict::Unproved("there are too many cases".into())),
            Err(Difference::Under(_)) => {
                let found = search(subject, &paths, lane, program.patch.is_empty());
                return Err(Verdict::Differs(found));
            }
        }
    }
    // Code that never returns, or whose paths no input takes, would otherwise equal everything.
    if pairs == 0 { Err(Verdict::Unproved("no input takes any path".into())) } else { Ok((paths.code.len(), pairs)) }
}

/// Random bits for each input by its name. The numbers come from one source and are f32, also where
/// the input is f64.
pub fn random_inputs(subject: &Subject, numbers: Numbers, rng: &mut Rng) -> HashMap<String, u64> {
    let mut inputs = HashMap::new();
    for InputNumber { format, name, .. } in &subject.inputs {
        let x = numbers.next(rng);
        let bits = if format.bytes() == 8 { f64::from(x).to_bits() } else { x.to_bits().into() };
        inputs.insert(name.clone(), bits);
    }
    inputs
}

/// Whether two results are equal: they have the same bits, or both are NaN.
pub fn same(format: Number, a: u64, b: u64) -> bool {
    a == b || format.value(a).is_nan() && format.value(b).is_nan()
}

/// Searches random inputs for some on which the expressions of code and twin differ in a lane. If
/// `is_own`, the code is the program's without any change, and the CPU runs it on these inputs to
/// confirm its results.
fn search(subject: &Subject, paths: &Paths, lane: usize, is_own: bool) -> Option<Counterexample> {
    let mut rng = Rng::new(SEED);
    let code = paths.code_of(subject, lane);
    let formats: Vec<_> = subject.results[lane].iter().map(|result| result.format).collect();
    let agree = |a: &[u64], b: &[u64]| (0..formats.len()).all(|i| same(formats[i], a[i], b[i]));
    for _ in 0..TRIES {
        let given = random_inputs(subject, choose(&mut rng, &Numbers::ALL), &mut rng);
        let mut evaluator = Evaluator::new(&given);
        let (code, twin) = (evaluator.results(&code), evaluator.results(&paths.twins[lane]));
        let (Some(code), Some(twin)) = (code, twin) else { continue };
        if agree(&code, &twin) {
            continue;
        }
        let seen = subject.call.as_ref().filter(|_| is_own).is_some_and(|call| {
            let found = call(&|name| given[name]);
            agree(&found[subject.results_of(lane)], &code)
        });
        let values = |bits: &[u64]| bits.iter().zip(&formats).map(|(bits, format)| format.value(*bits)).collect();
        let named = |input: &InputNumber| (input.name.clone(), input.format.value(given[&input.name]));
        let inputs = subject.inputs.iter().map(named).collect();
        return Some(Counterexample { inputs, lane, code: values(&code), twin: values(&twin), seen });
    }
    None
}

/// Compares the expressions of code and twin with the CPU's results on random inputs: a check of
/// the prover itself.
///
/// # Errors
/// The first inputs on which the CPU has other results.
pub fn hold_against_cpu(subject: &Subject, tries: usize, seed: u64) -> Result<(), String> {
    let Some(call) = &subject.call else { return Ok(()) };
    graph::clear();
    let paths = paths(subject, &Program::default()).map_err(|why| why.to_string())?;
    let formats: Vec<_> = subject.results.iter().flatten().map(|result| result.format).collect();
    let mut rng = Rng::new(seed);
    for turn in 0..tries {
        let given = random_inputs(subject, Numbers::ALL[turn % Numbers::ALL.len()], &mut rng);
        let mut evaluator = Evaluator::new(&given);
        let found = call(&|name| given[name]);
        let code = evaluator.results(&paths.code).ok_or("no path of the code is taken")?;
        let mut twin = Vec::new();
        for lane in &paths.twins {
            twin.extend(evaluator.results(lane).ok_or("no path of the twin is taken")?);
        }
        for (i, format) in formats.iter().enumerate() {
            let differs = |bits| !same(*format, bits, found[i]);
            if differs(code[i]) || differs(twin[i]) {
                return Err(format!(
                    "{}: result {i} is {:#x}; the code's expression gives {:#x}, the twin's {:#x}, for {given:x?}",
                    subject.symbol, found[i], code[i], twin[i]
                ));
            }
        }
    }
    Ok(())
}
