//! Mutants: code in which one bit of an instruction or of a constant is changed.
//!
//! A bit of an instruction belongs to its operation, an operand, an immediate or an address. If a
//! mutant is proved to equal the twin all the same, the reason is reported, and mutant and twin are
//! compared on random inputs, so that no such proof goes unchecked.

use iced_x86::{Formatter, IntelFormatter};

use super::evaluate::Evaluator;
use super::machine::{Program, decode};
use super::{Subject, Verdict, graph, paths, prove_in, random_inputs, same};
use crate::experiments::check::inputs::Numbers;
use rayo::internals::kernels::{code_at, constants_at};
use rayo::internals::scene::Rng;

/// The number of inputs on which a mutant is compared with the twin if it is proved equal.
const TRIES: usize = 21;
/// One more than the length of the longest instruction.
const MOST_BYTES: usize = 16;

/// A change of one bit.
#[derive(Clone, Debug)]
pub struct Mutant {
    /// The address of the changed byte, and its new value.
    pub address: u64,
    pub byte: u8,
    /// The instruction before and after the change, or the changed bit of a constant.
    pub change: String,
    kind: Option<Equivalence>,
}

/// The outcome for a mutant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MutantOutcome {
    /// Random inputs were found on which it differs from the twin.
    Refuted,
    /// Its expressions differ from the twin's, but no random input showed a difference.
    Differs,
    /// The model cannot follow it: it has an unknown instruction, or accesses memory that is no
    /// argument.
    Unreadable(String),
    /// It equals the twin.
    Equivalent(Equivalence),
}

/// Why a mutant equals the twin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Equivalence {
    /// The instruction does the same, in another encoding or for elements of another format: it
    /// only copies or combines bits.
    Encoding,
    /// The results are the same expressions: no result depends on the change, or two operands were
    /// exchanged.
    Expression,
    /// The results are other expressions, which rules and cases show to be equal.
    Rules,
}

impl Equivalence {
    pub fn name(self) -> &'static str {
        match self {
            Equivalence::Encoding => "the same instruction in another encoding",
            Equivalence::Expression => "no result depends on what differs",
            Equivalence::Rules => "other expressions, equal by rules and cases",
        }
    }
}

/// A bit that can be changed.
#[derive(Clone, Copy, Debug)]
pub enum Bit {
    /// A bit of an instruction, which has `length` bytes.
    Instruction { address: u64, length: usize, bit: usize },
    /// A bit of a 32-bit word.
    Constant { address: u64, bit: usize },
}

/// All bits of a subject's instructions that are executed, and of the constants that they read.
pub fn bits(subject: &Subject) -> Vec<Bit> {
    graph::clear();
    let program = Program::default();
    let _ = paths(subject, &program);
    let code = program.code.borrow();
    let instructions = code
        .iter()
        .flat_map(|(&address, &length)| (0..8 * length).map(move |bit| Bit::Instruction { address, length, bit }));
    let constants = program.constants.borrow();
    let constants = constants.iter().flat_map(|&address| (0..32).map(move |bit| Bit::Constant { address, bit }));
    instructions.chain(constants).collect()
}

/// The mutant with that bit changed. None if the changed instruction has another length or is
/// invalid.
pub fn mutant(bit: Bit) -> Option<Mutant> {
    match bit {
        Bit::Instruction { address, length, bit } => {
            let code = code_at(address as usize)?.get(..MOST_BYTES)?;
            of_instruction(address, code, length, bit)
        }
        Bit::Constant { address, bit } => {
            let (byte, bit) = (bit / 8, bit % 8);
            let byte_there = constants_at(address as usize)?[byte];
            let change = format!("bit {bit} of byte {byte} of the constant at {address:#x}");
            Some(Mutant { address: address + byte as u64, byte: byte_there ^ 1 << bit, change, kind: None })
        }
    }
}

/// The mutant with one bit of an instruction changed; None unless that gives an instruction of the
/// same length.
fn of_instruction(address: u64, code: &[u8], length: usize, bit: usize) -> Option<Mutant> {
    let mut changed = code.to_vec();
    changed[bit / 8] ^= 1 << (bit % 8);
    let [before, after] = [code, &changed].map(|code| decode(code, address));
    if after.is_invalid() || after.len() != length {
        return None;
    }
    let words = |instruction| {
        let mut words = String::new();
        IntelFormatter::new().format(instruction, &mut words);
        words
    };
    let [before, after] = [words(&before), words(&after)];
    let plain = |words: &str| {
        let (name, operands) = words.split_once(' ').unwrap_or((words, ""));
        let moves = ["mov", "and", "or", "xor"].iter().any(|of| name.trim_start_matches('v').starts_with(of));
        let name = if moves { name.replace("pd", "ps") } else { name.into() };
        format!("{name} {operands}")
    };
    let kind = (plain(&before) == plain(&after)).then_some(Equivalence::Encoding);
    let change = format!("{before} -> {after}");
    Some(Mutant { address: address + (bit / 8) as u64, byte: changed[bit / 8], change, kind })
}

/// Tries to prove that a mutant equals the twin.
///
/// # Panics
/// If it is proved and yet differs on some input, which means that the prover is wrong.
pub fn fate(subject: &Subject, mutant: &Mutant) -> MutantOutcome {
    let program = Program { patch: [(mutant.address, mutant.byte)].into(), ..Program::default() };
    match prove_in(subject, &program).verdict {
        Verdict::Differs(Some(_)) => MutantOutcome::Refuted,
        Verdict::Differs(None) => MutantOutcome::Differs,
        Verdict::Unproved(why) => MutantOutcome::Unreadable(why),
        Verdict::Proved => {
            assert!(agrees(subject, &program), "{}: {} is proved, and differs", subject.symbol, mutant.change);
            MutantOutcome::Equivalent(mutant.kind.unwrap_or_else(|| equivalence(subject, &program)))
        }
    }
}

/// Whether code and twin agree on random inputs.
fn agrees(subject: &Subject, program: &Program) -> bool {
    graph::clear();
    let paths = paths(subject, program).expect("it was proved");
    let mut rng = Rng::new(1);
    (0..TRIES).all(|turn| {
        let given = random_inputs(subject, Numbers::ALL[turn % Numbers::ALL.len()], &mut rng);
        let mut evaluator = Evaluator::new(&given);
        let code = evaluator.results(&paths.code).expect("some path is taken");
        let twin = paths.twins.iter().flat_map(|twin| evaluator.results(twin).expect("some path is taken"));
        let formats = subject.results.iter().flatten().map(|result| result.format);
        code.iter().zip(twin).zip(formats).all(|((code, twin), format)| same(format, *code, twin))
    })
}

/// Why a mutant whose instruction differs equals the twin.
fn equivalence(subject: &Subject, program: &Program) -> Equivalence {
    graph::clear();
    let [before, after] =
        [&Program::default(), program].map(|program| paths(subject, program).expect("it was proved").code);
    let same = before.len() == after.len()
        && before.iter().zip(&after).all(|(a, b)| a.results == b.results && a.conditions == b.conditions);
    if same { Equivalence::Expression } else { Equivalence::Rules }
}
