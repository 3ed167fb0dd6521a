//! What an instruction does, as operations on elements of registers and memory: a model that is compared with the CPU.
//!
//! An operation makes one element of others, which are those that the instruction finds. Of what an instruction
//! computes with floating-point numbers, the model says what: that can be done again with other numbers. Of integers in
//! vectors it knows the result, and of those in general registers which others they are made of. What selects (a mask,
//! an index, the numbers that a minimum compares) is resolved, and named.

mod arithmetic;
mod check;
mod float;
mod general;
mod instruction;
mod integer;
mod moves;

use iced_x86::{Decoder, DecoderOptions};

pub(super) use arithmetic::holds;
pub use arithmetic::{Estimate, Number, Rounding};
pub use check::{Check, Difference, check};
pub(super) use check::{after, before, logic, result};
use instruction::Instruction;

use crate::kernels::step::Step;

/// Bits of the control of floating point that change results: denormals as 0, the rounding, and underflow to 0.
const CHANGES_RESULTS: u32 = 0xe040;

/// Where elements are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Place {
    /// A general register, by its number.
    General(u8),
    /// zmm0 to zmm31, of which ymm and xmm are the first bytes.
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
    /// What it is a part of.
    pub place: Place,
    /// The first of its bits there. Of memory: eight times the address.
    pub at: u64,
    /// How many bits it has; 1 for a flag, and for a lane's bit of a mask.
    pub bits: u32,
}

impl Element {
    /// The `bytes` bytes from byte `byte` of a place on; of memory from that address on.
    pub fn new(place: Place, byte: u64, bytes: u32) -> Self {
        Element { place, at: 8 * byte, bits: 8 * bytes }
    }

    pub fn bit(place: Place, at: u32) -> Self {
        Element { place, at: at.into(), bits: 1 }
    }

    /// The first bit behind it.
    pub fn end(&self) -> u64 {
        self.at + u64::from(self.bits)
    }

    /// Whether the two have a bit in common.
    pub fn overlaps(&self, other: &Element) -> bool {
        self.place == other.place && self.at < other.end() && other.at < self.end()
    }
}

/// What is made of the elements `from`. `a`, `b` and `c` are the first, second and third of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum What {
    /// `a`.
    Copy,
    /// This, of integers and bits.
    Computed(u64),
    /// What the CPU made of them in general registers, masks and flags: addresses, counts and conditions.
    Found,
    /// The bit of this table whose number is made of the bits of `a` (4), `b` (2) and `c` (1), as of `vpternlogd`.
    Logic(u8),
    /// A number of this format.
    Float(Number, Float),
    /// `a` of the first format in the second: to nearest, and to integers towards 0.
    Convert(Number, Number),
    /// All ones or all zeros: the predicate of `vcmpps` of `a` and `b`.
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
        /// The product's sign is turned round.
        product: bool,
        /// c's sign is.
        addend: bool,
    },
    /// a where it is less, else b.
    Min,
    /// a where it is greater, else b.
    Max,
    /// a as a whole number.
    Round(Rounding),
    /// About 1 / the root of a.
    ReciprocalRoot(Estimate),
}

/// An element that an instruction writes, and what of.
#[derive(Clone, Debug, PartialEq)]
pub struct Operation {
    pub to: Element,
    /// With what.
    pub what: What,
    pub from: Vec<Element>,
    /// What decided that it is made of these: bits of masks, indices, numbers compared.
    pub by: Vec<Element>,
}

impl Operation {
    /// All that the element depends on, addresses apart.
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
    /// Not rounding to nearest, or denormals as 0.
    #[error("floating point is not as the model has it: MXCSR is {mxcsr:#x}, not to nearest with denormals")]
    Control {
        /// Control and status of floating point.
        mxcsr: u32,
    },
}

/// What the instruction of `step` writes. All of `from` and `by` is what it finds, also where it writes there.
///
/// # Errors
/// Where there is no model of it.
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

/// Where a register is; None for those that kernels have not.
pub(super) fn place(register: iced_x86::Register) -> Option<Place> {
    instruction::register(register).map(|operand| operand.place)
}

/// The instruction at the beginning of `step`'s code.
pub(super) fn decode(step: &Step) -> iced_x86::Instruction {
    Decoder::with_ip(64, step.code, step.before.rip, DecoderOptions::NONE).decode()
}
