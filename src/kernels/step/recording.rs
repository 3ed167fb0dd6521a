//! The records of single-stepping a kernel: the registers between instructions, and the memory that
//! each instruction accesses.

use iced_x86::{Instruction, Mnemonic, OpKind, Register};

use crate::kernels::kernel::Crashed;

/// The bytes of an element of the stack.
pub(super) const WORD: usize = 8;

/// General registers, flags and vectors between two instructions. Registers that the CPU lacks are
/// 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct State {
    /// rax, rcx, rdx, rbx, rsp, rbp, rsi, rdi, r8 to r15, in the order of the numbers that
    /// instructions encode.
    pub general: [u64; 16],
    /// The address of the next instruction.
    pub rip: u64,
    /// The flags register, without the trap flag.
    pub flags: u64,
    /// MXCSR, the control and status register of floating point.
    pub mxcsr: u32,
    /// zmm0 to zmm31, whose first bytes are ymm and xmm.
    pub vectors: [[u8; 64]; 32],
    /// k0 to k7.
    pub masks: [u64; 8],
}

/// The memory that an instruction reads or writes, which is at most one operand; for `push`, `pop`,
/// `call` and `ret` it is the stack. Elements that a mask excludes are 0 before and after, since
/// they may not be accessed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Touched {
    /// The address of the first byte.
    pub address: u64,
    pub bytes: u8,
    /// The bytes before the instruction.
    pub before: [u8; 64],
    pub after: [u8; 64],
}

/// An instruction that is being executed: its input, and the memory that it accesses.
#[derive(Clone, Debug)]
pub(super) struct Moment {
    /// The registers before the instruction.
    pub state: State,
    /// The instruction's index among those that are watched; None if it is not wanted.
    pub number: Option<u64>,
    /// The bytes of the instruction, and some that follow.
    pub code: [u8; 16],
    pub touched: Option<Touched>,
}

/// One execution of an instruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Visit {
    pub rip: u64,
    /// The address of the memory that the instruction reads or writes.
    pub address: u64,
    /// The number of bytes that it reads or writes there; 0 for none.
    pub bytes: u8,
}

/// Executions of instructions, in order.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VisitRecord {
    pub visits: Vec<Visit>,
    /// Whether the list has all executions that there were.
    pub complete: bool,
}

/// An instruction that was executed.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// The instruction's index among those that are watched, from 0.
    pub number: u64,
    pub before: &'a State,
    pub after: &'a State,
    /// The bytes of the instruction, and some that follow.
    pub code: &'a [u8; 16],
    /// The memory that the instruction read or wrote.
    pub touched: Option<&'a Touched>,
}

/// The instructions that a thread executed in the watched code.
#[derive(Clone, Debug)]
pub struct Recording {
    pub(super) moments: Vec<Moment>,
    /// The number of instructions executed.
    pub executed: u64,
    /// The crash that ended the execution. Its instruction counts as executed, but is not among the
    /// [steps](Recording::steps).
    pub crashed: Option<Box<Crashed>>,
}

impl Recording {
    /// The recorded instructions, in the order of their execution.
    pub fn steps(&self) -> impl DoubleEndedIterator<Item = Step<'_>> {
        self.moments.windows(2).filter_map(|pair| {
            Some(Step {
                number: pair[0].number?,
                before: &pair[0].state,
                after: &pair[1].state,
                code: &pair[0].code,
                touched: pair[0].touched.as_ref(),
            })
        })
    }
}

/// The memory that an instruction accesses: its address and number of bytes.
#[derive(Clone, Copy, Default)]
pub struct MemoryOperand {
    pub address: u64,
    pub bytes: usize,
}

/// The memory operand of an instruction, from the general registers before it.
pub fn memory_operand(instruction: &Instruction, general: &[u64; 16]) -> Option<MemoryOperand> {
    use Mnemonic::*;
    let stack = general[4];
    match instruction.mnemonic() {
        // These instructions have a memory operand, but do not access it.
        Lea | Nop | Prefetch | Prefetchnta | Prefetcht0 | Prefetcht1 | Prefetcht2 | Prefetchw | Prefetchwt1 => {
            return None;
        }
        Push | Call => return Some(MemoryOperand { address: stack.wrapping_sub(WORD as u64), bytes: WORD }),
        Pop | Ret => return Some(MemoryOperand { address: stack, bytes: WORD }),
        _ => {}
    }
    let operand = (0..instruction.op_count()).find(|&index| instruction.op_kind(index) == OpKind::Memory)?;
    let address = instruction.virtual_address(operand, 0, |register, _, _| match register {
        Register::ES | Register::CS | Register::SS | Register::DS => Some(0),
        _ if register.is_gpr64() => Some(general[register.number()]),
        _ => None,
    })?;
    Some(MemoryOperand { address, bytes: instruction.memory_size().size().min(64) })
}
