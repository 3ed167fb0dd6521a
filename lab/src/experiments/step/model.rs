//! A model of what an instruction does, as operations on elements of registers and memory.
//!
//! Its predictions are compared with the CPU at every step.
//!
//! An operation computes one element from others, as they were before the instruction. For
//! floating-point numbers the model names the computation, so that it can be repeated with other
//! numbers. For integers in vectors it gives the result; for general registers only the elements on
//! which the result depends. Selections (by a mask, an index, or the comparison of a minimum) are
//! resolved, and the elements that decided them are listed; where one bit decided, the model also
//! names the operands that the instruction would have taken otherwise.

mod arithmetic;
mod check;
mod float;
mod general;
mod instruction;
mod integer;
mod moves;

use iced_x86::{Decoder, DecoderOptions};

pub use arithmetic::{Estimate, Number, Rounding};
pub(crate) use arithmetic::{convert, float, holds};
pub use check::{Check, Difference, check};
pub(super) use check::{after, before, logic, result};
use instruction::Instruction;

use rayo::internals::kernels::step::Step;

/// The bits of MXCSR that change results: denormals as zeros, the rounding mode, and flush to zero.
const CHANGES_RESULTS: u32 = 0xe040;

/// A place that contains elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Place {
    /// A general register, by its number.
    General(u8),
    /// zmm0 to zmm31, whose first bytes are ymm and xmm.
    Vector(u8),
    /// k0 to k7.
    Mask(u8),
    Flags,
    /// The instruction pointer, after the instruction.
    Next,
    Memory,
}

/// Up to 64 bits that are read or written together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Element {
    /// The place that contains it.
    pub place: Place,
    /// The number of its first bit in that place; in memory, eight times the address.
    pub at: u64,
    /// Its number of bits; 1 for a flag, and for a lane's bit of a mask.
    pub bits: u32,
}

impl Element {
    /// The element of `bytes` bytes that begins at byte `byte` of a place; in memory, at that
    /// address.
    pub fn new(place: Place, byte: u64, bytes: u32) -> Self {
        Element { place, at: 8 * byte, bits: 8 * bytes }
    }

    pub fn bit(place: Place, at: u32) -> Self {
        Element { place, at: at.into(), bits: 1 }
    }

    /// The number of the bit after its last.
    pub fn end(&self) -> u64 {
        self.at + u64::from(self.bits)
    }

    /// Whether the two have a bit in common.
    pub fn overlaps(&self, other: &Element) -> bool {
        self.place == other.place && self.at < other.end() && other.at < self.end()
    }
}

/// How an element is computed from the elements `from`, the first three of which are called `a`,
/// `b` and `c`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum What {
    /// `a`.
    Copy,
    /// This value, computed from integers or bits.
    Computed(u64),
    /// Whatever the CPU computed, in general registers, masks and flags: addresses, counts and
    /// conditions.
    Found,
    /// A bitwise function by a truth table, as in `vpternlogd`: bit 4a + 2b + c of the table.
    Logic(u8),
    /// A floating-point computation in this format.
    Float(Number, Float),
    /// `a` converted from the first format to the second: rounded to nearest, or towards 0 for
    /// integers.
    Convert(Number, Number),
    /// All ones or all zeros: whether a predicate of `vcmpps` holds of `a` and `b`.
    Compare(Number, u8),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Float {
    Add,
    Sub,
    Mul,
    Div,
    Sqrt,
    /// a b + c, rounded once.
    Fma {
        /// Whether the product is negated.
        product: bool,
        /// Whether c is negated.
        addend: bool,
    },
    /// a if it is less, else b.
    Min,
    /// a if it is greater, else b.
    Max,
    /// a rounded to a whole number.
    Round(Rounding),
    /// An estimate of 1 / sqrt(a).
    ReciprocalRoot(Estimate),
}

/// How an instruction computes one element that it writes.
#[derive(Clone, Debug, PartialEq)]
pub struct Operation {
    pub to: Element,
    /// The computation.
    pub what: What,
    pub from: Vec<Element>,
    /// The elements that decided on these operands: bits of masks, indices, compared numbers.
    pub by: Vec<Element>,
    /// The computation and operands if the last of `by` had the other value; None where that is not
    /// a single bit.
    pub otherwise: Option<Alternative>,
}

/// The choice that an instruction did not take.
#[derive(Clone, Debug, PartialEq)]
pub struct Alternative {
    pub what: What,
    pub from: Vec<Element>,
}

impl Operation {
    /// All elements on which the result depends, except for addresses.
    pub fn sources(&self) -> impl Iterator<Item = &Element> {
        self.from.iter().chain(&self.by)
    }
}

/// Why there is no model of an instruction.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unknown {
    /// The model does not know it, or not with these operands.
    #[error("{name} with these operands ({bytes:02x?}) is not known")]
    Instruction {
        /// Its name, as in Intel's manual.
        name: String,
        bytes: Vec<u8>,
    },
    #[error("the memory that it touches was not recorded")]
    Memory,
    /// MXCSR does not round to nearest, or treats denormals as 0.
    #[error("floating point is not as the model has it: MXCSR is {mxcsr:#x}, not to nearest with denormals")]
    Control {
        /// The MXCSR register.
        mxcsr: u32,
    },
}

/// The operations of the instruction of `step`. All elements in `from` and `by` have their values
/// from before the instruction, even if it overwrites them.
///
/// # Errors
/// If there is no model of the instruction.
pub fn model(step: &Step) -> Result<Vec<Operation>, Unknown> {
    if step.before.mxcsr & CHANGES_RESULTS != 0 {
        return Err(Unknown::Control { mxcsr: step.before.mxcsr });
    }
    let mut instruction = Instruction::new(step);
    let families = [general::model, moves::model, integer::model, float::model];
    if !families.iter().any(|family| family(&mut instruction).is_some()) {
        let bytes = step.code[..instruction.raw.len()].to_vec();
        return Err(Unknown::Instruction { name: instruction.name, bytes });
    }
    instruction.finish()
}

/// The place of a register; None if it is no general, vector or mask register.
pub(super) fn place(register: iced_x86::Register) -> Option<Place> {
    instruction::register(register).map(|operand| operand.place)
}

/// The instruction at the beginning of `step`'s code.
pub(super) fn decode(step: &Step) -> iced_x86::Instruction {
    Decoder::with_ip(64, step.code, step.before.rip, DecoderOptions::NONE).decode()
}
