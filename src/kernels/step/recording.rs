//! What single-stepping records of a kernel: registers between instructions, and the memory that each touched.

/// General registers, flags and vectors between two instructions. What a CPU has not is 0.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct State {
    /// rax, rcx, rdx, rbx, rsp, rbp, rsi, rdi, r8 to r15: by their numbers in instructions.
    pub general: [u64; 16],
    /// The address of the next instruction.
    pub rip: u64,
    /// The flags, without the one that makes the traps.
    pub flags: u64,
    /// Control and status of floating point.
    pub mxcsr: u32,
    /// zmm0 to zmm31, of which ymm and xmm are the first bytes.
    pub vectors: [[u8; 64]; 32],
    /// k0 to k7.
    pub masks: [u64; 8],
}

/// The memory that an instruction reads or writes, of which it has one operand at most; of `push`, `pop`, `call` and `ret` the
/// stack. Elements that a mask leaves out are 0 in both, since nobody may touch them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Touched {
    /// The address of its first byte.
    pub address: u64,
    /// Bytes of it.
    pub bytes: u8,
    /// Before the instruction.
    pub before: [u8; 64],
    /// After it.
    pub after: [u8; 64],
}

/// An instruction on its way: what it finds, and what it touches.
#[derive(Clone, Debug)]
pub(super) struct Moment {
    /// Before it.
    pub state: State,
    /// The how many-th it is of those that are watched; None: it is not wanted.
    pub number: Option<u64>,
    /// Its bytes, and what follows them.
    pub code: [u8; 16],
    /// What it touches in memory.
    pub touched: Option<Touched>,
}

/// That an instruction was executed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Visit {
    /// Its address.
    pub rip: u64,
    /// The memory that it reads or writes: the address, and how many bytes, 0 for none.
    pub address: u64,
    /// See `address`.
    pub bytes: u8,
}

/// An instruction that was executed.
#[derive(Clone, Copy, Debug)]
pub struct Step<'a> {
    /// The how many-th it is of those that are watched, from 0 on.
    pub number: u64,
    /// The registers that it found.
    pub before: &'a State,
    /// And left.
    pub after: &'a State,
    /// Its bytes, and what follows them.
    pub code: &'a [u8; 16],
    /// The memory that it read or wrote.
    pub touched: Option<&'a Touched>,
}

/// Instructions that a thread executed in code that was watched.
#[derive(Clone, Debug)]
pub struct Recording {
    pub(super) moments: Vec<Moment>,
    /// How many there were in all.
    pub executed: u64,
    /// Those that were wanted and are not recorded, since there were more than the most that one asked for.
    pub left_out: u64,
}

impl Recording {
    /// Its instructions, in the order of their execution.
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
