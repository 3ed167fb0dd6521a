//! A model of what an instruction does, as operations on elements of registers and memory.
//!
//! The predictions of the model are compared with the CPU at every step.
//!
//! An operation computes one element from the values that other elements had before the
//! instruction. For floating-point numbers the model names the computation, so that it can be
//! repeated with other numbers. For integers in vectors it gives the result. For general registers
//! it only gives the elements on which the result depends. A selection (by a mask, by an index, or
//! by the comparison of a minimum) appears as what was selected, with the elements that decided it;
//! where a single bit decided, the model also gives the operands that the other value of the bit
//! would have selected.

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
    /// A general register, by the number that instructions encode.
    General(u8),
    /// zmm0 to zmm31, whose first bytes are ymm and xmm.
    Vector(u8),
    /// k0 to k7.
    Mask(u8),
    Flags,
    /// The address of the next instruction.
    Next,
    Memory,
}

/// Up to 64 bits that are read or written together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Element {
    /// The place that contains it.
    pub place: Place,
    /// The number of the element's first bit in its place; in memory, eight times its address.
    pub at: u64,
    /// Its number of bits, which is 1 for a flag and for a lane's bit of a mask.
    pub bits: u32,
}

impl Element {
    /// An element of `bytes` bytes that begins at byte `byte` of a place; in memory, at the address
    /// `byte`.
    pub fn new(place: Place, byte: u64, bytes: u32) -> Self {
        Element { place, at: 8 * byte, bits: 8 * bytes }
    }

    pub fn bit(place: Place, at: u32) -> Self {
        Element { place, at: at.into(), bits: 1 }
    }

    /// The number of the bit after the element's last.
    pub fn end(&self) -> u64 {
        self.at + u64::from(self.bits)
    }

    /// Whether the two elements have a bit in common.
    pub fn overlaps(&self, other: &Element) -> bool {
        self.place == other.place && self.at < other.end() && other.at < self.end()
    }
}

/// How an element is computed from the operands `from`, the first three of which are called `a`,
/// `b` and `c`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum What {
    /// `a`.
    Copy,
    /// The given value, which the model has computed from integers or bits.
    Computed(u64),
    /// The CPU's own result, which the model does not predict: addresses, counts and conditions in
    /// general registers, masks and flags.
    Found,
    /// A bitwise function given by its truth table, as in `vpternlogd`: the result is bit 4a + 2b +
    /// c of the table.
    Logic(u8),
    /// A floating-point computation in this format.
    Float(Number, Float),
    /// `a` converted from the first format to the second; rounded to nearest or, to integers,
    /// towards 0.
    Convert(Number, Number),
    /// All ones if a predicate of `vcmpps` holds for `a` and `b`, else all zeros.
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
    /// The minimum: a if it is less than b, else b.
    Min,
    /// The maximum: a if it is greater than b, else b.
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
    /// The elements that selected these operands: bits of masks, indices, compared numbers.
    pub by: Vec<Element>,
    /// The computation and operands that would have been selected if the last element of `by` had
    /// the other value; None where that element is more than a bit.
    pub otherwise: Option<Alternative>,
}

/// The alternative that an instruction did not select.
#[derive(Clone, Debug, PartialEq)]
pub struct Alternative {
    pub what: What,
    pub from: Vec<Element>,
}

impl Operation {
    /// All elements on which the result depends, except those that only make up addresses.
    pub fn sources(&self) -> impl Iterator<Item = &Element> {
        self.from.iter().chain(&self.by)
    }
}

/// Why there is no model of an instruction.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unknown {
    /// The model does not know the instruction, or not with these operands.
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

/// The operations of the instruction in `step`. All elements in `from` and `by` mean values from
/// before the instruction, even if the instruction overwrites them.
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
