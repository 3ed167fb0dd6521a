//! Executes machine code over symbols: the instructions of a function, by the model of `rayo step`.
//!
//! Vectors, masks and the memory that the caller names hold expressions. General registers hold
//! numbers, such as addresses and counts, which must not depend on inputs. At a jump that depends
//! on inputs the machine follows both ways, each with the condition under which it is taken. The
//! model of `rayo step` says what an instruction does to vectors; the few instructions on general
//! registers are modelled here. The CPU is never asked, so that code for instructions that it lacks
//! can be read as well.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet, HashMap};

use iced_x86::{ConditionCode, FlowControl, InstructionInfoFactory, Mnemonic, OpKind, Register};

use super::ResultNumber;
use super::graph::{self, Expression, Logic, Node};
use super::symbol::{Condition, Path};
use crate::experiments::step::model::{self, Alternative, Element, Float, Number, Operation, Place, What};
use rayo::internals::kernels::step::{MemoryOperand, State, Step, Touched, memory_operand};
use rayo::internals::kernels::{code_at, constants_at};

/// Code that takes more instructions than this, on all paths together, is treated as an endless
/// loop.
const MOST_STEPS: usize = 10_000;
/// Expressions with more nodes than this are treated as too large.
const MOST_NODES: usize = 500_000;
/// The stack pointer on entry, and its number among the general registers.
const STACK: u64 = 0x7f00_0000_0000;
const RSP: usize = 4;

/// Why some code can be neither proved nor refuted.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Unproved {
    #[error(transparent)]
    Model(#[from] model::Unknown),
    #[error("{0} is not done with symbols")]
    Instruction(String),
    #[error("an address or a count depends on an input")]
    Address,
    #[error("it reads memory at {0:#x}, which is neither an input nor a constant")]
    Memory(u64),
    #[error("integers or bits of an input decide what it does")]
    Integers,
    #[error("it does not end within {MOST_STEPS} instructions")]
    Loop,
    #[error("its expressions are too large")]
    Large,
    #[error("its result depends on the bits of a NaN")]
    BitsOfNan,
}

/// What a general register holds.
#[derive(Clone, Debug, PartialEq)]
enum General {
    Known(u64),
    /// The bits of a mask, as a condition for each lane.
    Lanes(Vec<Node>),
    /// A number that depends on inputs and is no mask.
    Unknown,
}

/// What the flags hold after the last instruction.
#[derive(Clone, Copy, Debug)]
enum Flags {
    /// A comparison of two numbers.
    Compared(Node, Node),
    /// Those of an integer result: whether it is 0, its carry if the model has it, and its sign.
    Known {
        zero: bool,
        carry: Option<bool>,
        sign: bool,
    },
    /// The zero flag says whether a mask selects no lane.
    NoLane(Node),
    Unknown,
}

/// The program's code, in which some bytes may be changed, and a record of what was read of it.
#[derive(Default)]
pub struct Program {
    /// Changed bytes, by their addresses.
    pub patch: HashMap<u64, u8>,
    /// The instructions that were executed: the address of each, and its length in bytes.
    pub code: RefCell<BTreeMap<u64, usize>>,
    /// The addresses of the 32-bit words of constants that were read.
    pub constants: RefCell<BTreeSet<u64>>,
}

impl Program {
    /// The `N` bytes at an address: a changed byte where there is one, else the byte of `here`, and
    /// 0 past its end.
    fn bytes<const N: usize>(&self, address: u64, here: &[u8]) -> [u8; N] {
        let byte = |at: usize| {
            let changed = self.patch.get(&(address + at as u64)).copied();
            changed.or(here.get(at).copied()).unwrap_or(0)
        };
        std::array::from_fn(byte)
    }
}

/// The state of a symbolic execution at one point of one path.
#[derive(Clone)]
pub struct Machine<'a> {
    program: &'a Program,
    general: [General; 16],
    vectors: Vec<[Node; 16]>,
    masks: Vec<[Node; 64]>,
    flags: Flags,
    /// 32-bit words, by their addresses.
    memory: HashMap<u64, Node>,
    rip: u64,
    conditions: Vec<Condition>,
}

impl<'a> Machine<'a> {
    /// The state at the beginning of the function at `entry`. Vectors that are not set hold symbols
    /// that occur in no twin.
    pub fn new(program: &'a Program, entry: u64) -> Self {
        let unset = |register: usize, word: usize| graph::input(Number::Single, &format!("unset {register}.{word}"));
        let mut machine = Machine {
            program,
            general: [const { General::Unknown }; 16],
            vectors: (0..32).map(|register| std::array::from_fn(|word| unset(register, word))).collect(),
            masks: vec![[graph::no(); 64]; 8],
            flags: Flags::Unknown,
            memory: HashMap::new(),
            rip: entry,
            conditions: Vec::new(),
        };
        for register in 0..16 {
            // A value that belongs to the caller: it can be saved and restored, but is no address.
            machine.general[register] = General::Known(0xdead_0000 + register as u64);
        }
        machine.general[RSP] = General::Known(STACK);
        machine
    }

    /// Sets a general register.
    pub fn set_general(&mut self, register: usize, value: u64) {
        self.general[register] = General::Known(value);
    }

    /// Sets a number in memory.
    pub fn set_memory(&mut self, address: u64, number: Node) {
        if number.format().bytes() == 8 {
            self.memory.insert(address, graph::half(number, false));
            self.memory.insert(address + 4, graph::half(number, true));
        } else {
            self.memory.insert(address, number);
        }
    }

    /// A number in memory.
    pub fn memory(&self, address: u64, format: Number) -> Result<Node, Unproved> {
        let lower = self.word(address)?;
        if format.bytes() == 8 { Ok(graph::pair(lower, self.word(address + 4)?)) } else { Ok(lower) }
    }

    /// Runs along all paths until they return. The results are read from memory at the end of each.
    pub fn run(self, results: &[ResultNumber]) -> Result<Vec<Path>, Unproved> {
        let mut paths = Vec::new();
        let mut open = vec![self];
        let mut steps = 0;
        while let Some(mut machine) = open.pop() {
            loop {
                steps += 1;
                if steps > MOST_STEPS {
                    return Err(Unproved::Loop);
                }
                if graph::size() > MOST_NODES {
                    return Err(Unproved::Large);
                }
                match machine.step()? {
                    Next::Goes => {}
                    Next::Forks(other) => open.push(*other),
                    Next::Returns => break,
                }
            }
            let number = |result: &ResultNumber| machine.memory(result.address, result.format);
            let results = results.iter().map(number).collect::<Result<_, _>>()?;
            paths.push(Path { conditions: machine.conditions, results });
        }
        Ok(paths)
    }

    /// A 32-bit word: one that was set, or a constant of the program.
    fn word(&self, address: u64) -> Result<Node, Unproved> {
        if let Some(&word) = self.memory.get(&address) {
            return Ok(word);
        }
        let here = constants_at(address as usize).filter(|bytes| bytes.len() >= 4).ok_or(Unproved::Memory(address))?;
        self.program.constants.borrow_mut().insert(address);
        let bytes = self.program.bytes::<4>(address, here);
        Ok(graph::constant(Number::Single, u32::from_le_bytes(bytes).into()))
    }

    /// Executes the next instruction.
    fn step(&mut self) -> Result<Next<'a>, Unproved> {
        let here = code_at(self.rip as usize).ok_or(Unproved::Memory(self.rip))?;
        let code = self.program.bytes::<16>(self.rip, here);
        let instruction = decode(&code, self.rip);
        self.program.code.borrow_mut().insert(self.rip, instruction.len());
        match instruction.flow_control() {
            FlowControl::Next => {}
            FlowControl::Return => return Ok(Next::Returns),
            FlowControl::UnconditionalBranch => {
                self.rip = instruction.near_branch_target();
                return Ok(Next::Goes);
            }
            FlowControl::ConditionalBranch => return self.branch(&instruction),
            _ => return Err(unknown(&instruction)),
        }
        let does_nothing = matches!(instruction.mnemonic(), Mnemonic::Endbr64 | Mnemonic::Nop);
        if uses_vectors(&instruction) {
            self.vector_step(&code, &instruction)?;
        } else if !does_nothing {
            self.general_step(&instruction)?;
        }
        self.rip = instruction.next_ip();
        Ok(Next::Goes)
    }

    fn branch(&mut self, instruction: &iced_x86::Instruction) -> Result<Next<'a>, Unproved> {
        let condition = self.condition(instruction.condition_code()).ok_or_else(|| unknown(instruction))?;
        let (target, next) = (instruction.near_branch_target(), instruction.next_ip());
        let decides = |known: Node| known == condition || known == graph::not(condition);
        let known = self.conditions.iter().find(|known| decides(known.node));
        let jumps = match known {
            _ if condition == graph::yes() || condition == graph::no() => Some(condition == graph::yes()),
            Some(known) => Some((known.node == condition) == known.holds),
            None => None,
        };
        if let Some(jumps) = jumps {
            self.rip = if jumps { target } else { next };
            return Ok(Next::Goes);
        }
        let mut other = self.clone();
        other.rip = next;
        other.conditions.push(Condition { node: condition, holds: false });
        self.rip = target;
        self.conditions.push(Condition { node: condition, holds: true });
        Ok(Next::Forks(Box::new(other)))
    }

    /// The condition under which a conditional jump is taken, from the flags.
    fn condition(&self, code: ConditionCode) -> Option<Node> {
        use ConditionCode::{a, ae, b, be, e, ne, ns, s};
        Some(match (self.flags, code) {
            // `comiss` sets the zero and the carry flag where a number is NaN.
            (Flags::Compared(x, y), ae) => graph::less_or_equal(y, x),
            (Flags::Compared(x, y), b) => graph::not(graph::less_or_equal(y, x)),
            (Flags::Compared(x, y), a) => graph::less(y, x),
            (Flags::Compared(x, y), be) => graph::not(graph::less(y, x)),
            (Flags::NoLane(none), e) => none,
            (Flags::NoLane(none), ne) => graph::not(none),
            (Flags::Known { zero, carry, sign }, _) => graph::truth(match code {
                e => zero,
                ne => !zero,
                b => carry?,
                ae => !carry?,
                be => carry? || zero,
                a => !carry? && !zero,
                s => sign,
                ns => !sign,
                _ => return None,
            }),
            _ => return None,
        })
    }

    /// Executes an instruction on vectors by the model.
    fn vector_step(&mut self, code: &[u8; 16], instruction: &iced_x86::Instruction) -> Result<(), Unproved> {
        let before = self.state(instruction);
        let touched = self.touched(instruction)?;
        let step = Step { number: 0, before: &before, after: &before, code, touched: touched.as_ref() };
        let operations = model::model(&step)?;
        let stores = instruction.op0_kind() == OpKind::Memory;
        if stores && instruction.has_op_mask() && !self.is_mask_known(instruction) {
            return Err(Unproved::Integers);
        }
        if is_of_lanes(instruction.mnemonic()) {
            return self.lanes_step(&operations, instruction);
        }
        // All operands are read before any result is written.
        let mut written = Vec::new();
        for operation in &self.by_words(operations) {
            match operation.to.place {
                Place::Flags => match (operation.what, &operation.from[..]) {
                    (What::Compare(format, _), &[a, b]) => {
                        let [a, b] = [self.read(a, format)?, self.read(b, format)?];
                        self.flags = Flags::Compared(a, b);
                    }
                    (What::Computed(_), _) => {}
                    _ => return Err(unknown(instruction)),
                },
                Place::General(register) => {
                    // A number that was converted to an integer, or a word of a vector.
                    let value = self.value(operation).ok().and_then(Node::constant);
                    self.general[usize::from(register)] = value.map_or(General::Unknown, General::Known);
                }
                _ => written.push((operation.to, self.value(operation)?)),
            }
        }
        written.into_iter().try_for_each(|(to, value)| self.write(to, value))
    }

    /// The operations of an instruction, except the one that moves the instruction pointer. One
    /// that copies 64 bits, or combines 64 bits of f32 bitwise, is split into two on 32 bits each,
    /// since two f32 are not the halves of an f64.
    fn by_words(&self, operations: Vec<Operation>) -> Vec<Operation> {
        let mut words = Vec::new();
        for operation in operations {
            if operation.to.place == Place::Next {
                continue;
            }
            let copies = operation.what == What::Copy && operation.otherwise.is_none();
            let combines = matches!(operation.what, What::Logic(_))
                && !operation.from.iter().any(|element| self.is_double(*element));
            if operation.to.bits == 64 && (copies || combines) {
                words.extend([0, 32].map(|first| half_of(&operation, first)));
            } else {
                words.push(operation);
            }
        }
        words
    }

    /// Whether one of the two 32-bit words of an element is half of an f64.
    fn is_double(&self, element: Element) -> bool {
        let word = |at| self.read(Element { at, bits: 32, ..element }, Number::Single);
        let words = [word(element.at), word(element.at + 32)];
        words.iter().flatten().any(|word| matches!(word.expression(), Expression::Half(..)))
    }

    /// Sets a general register to the bits of a mask, or to the signs of a vector.
    fn lanes_step(&mut self, operations: &[Operation], instruction: &iced_x86::Instruction) -> Result<(), Unproved> {
        let Some(Element { place: Place::General(register), .. }) = operations.first().map(|operation| operation.to)
        else {
            return Err(unknown(instruction));
        };
        let lanes = if instruction.op1_register().is_k() {
            self.masks[instruction.op1_register().number()][..16].to_vec()
        } else {
            let signs = operations[0].from.iter().map(|&sign| self.condition_of(sign));
            signs.collect::<Result<_, _>>()?
        };
        self.general[usize::from(register)] = General::Lanes(lanes);
        Ok(())
    }

    /// Whether the mask of an instruction is constant.
    fn is_mask_known(&self, instruction: &iced_x86::Instruction) -> bool {
        let is_known = |lane: &Node| *lane == graph::yes() || *lane == graph::no();
        self.masks[instruction.op_mask().number()].iter().all(is_known)
    }

    /// The registers as numbers; 0 where they are not constant.
    fn state(&self, instruction: &iced_x86::Instruction) -> State {
        let known = |general: &General| if let General::Known(bits) = general { *bits } else { 0 };
        let general = self.general.each_ref().map(known);
        let mut state =
            State { general, rip: self.rip, flags: 0, mxcsr: 0x1f80, vectors: [[0; 64]; 32], masks: [0; 8] };
        for operand in 0..instruction.op_count() {
            let register = instruction.op_register(operand);
            if instruction.op_kind(operand) == OpKind::Register && register.is_vector_register() {
                let number = register.full_register().number();
                for (bytes, word) in state.vectors[number].chunks_exact_mut(4).zip(self.vectors[number]) {
                    bytes.copy_from_slice(&(word.constant().unwrap_or(0) as u32).to_le_bytes());
                }
            }
        }
        for (mask, lanes) in state.masks.iter_mut().zip(&self.masks) {
            *mask = (0..64).filter(|&lane| lanes[lane] == graph::yes()).fold(0, |mask, lane| mask | 1 << lane);
        }
        state
    }

    /// The memory that an instruction accesses, whose address must be constant.
    fn touched(&self, instruction: &iced_x86::Instruction) -> Result<Option<Touched>, Unproved> {
        let is_known = |register: Register| {
            !register.is_gpr() || matches!(self.general[register.full_register().number()], General::Known(_))
        };
        let Some(MemoryOperand { address, bytes }) = memory_operand(instruction, &self.state(instruction).general)
        else {
            return Ok(None);
        };
        if !is_known(instruction.memory_base()) || !is_known(instruction.memory_index()) {
            return Err(Unproved::Address);
        }
        let mut before = [0; 64];
        for at in (0..bytes & !3).step_by(4) {
            let word = self.word(address + at as u64).ok().and_then(Node::constant).unwrap_or(0);
            before[at..at + 4].copy_from_slice(&(word as u32).to_le_bytes());
        }
        Ok(Some(Touched { address, bytes: bytes as u8, before, after: before }))
    }

    /// The result of an operation. Where a bit that depends on inputs selects one of two
    /// alternatives, it is a choice between the results of both.
    fn value(&self, operation: &Operation) -> Result<Node, Unproved> {
        let Operation { to, what, from, by, otherwise } = operation;
        let (last, others) = match (otherwise, &by[..]) {
            (Some(_), [others @ .., last]) => (Some(*last), others),
            (_, others) => (None, others),
        };
        for &decided in others {
            self.bits(decided)?;
        }
        let taken = self.made(*what, from, to.bits)?;
        let (Some(last), Some(Alternative { what, from })) = (last, otherwise) else { return Ok(taken) };
        let bit = self.condition_of(last)?;
        if bit == graph::yes() {
            return Ok(taken);
        }
        let other = self.made(*what, from, to.bits)?;
        // The model takes an unknown bit for 0: `taken` is the result for 0, and `other` that for
        // 1.
        Ok(if to.bits == 1 {
            graph::either(graph::both(bit, other), graph::both(graph::not(bit), taken))
        } else {
            graph::select(bit, other, taken)
        })
    }

    /// The result of `what` on some elements: a number of `bits` bits, or a condition if `bits` is
    /// 1.
    fn made(&self, what: What, from: &[Element], bits: u32) -> Result<Node, Unproved> {
        let of_size = if bits == 64 { Number::Double } else { Number::Single };
        match what {
            What::Copy => self.read(from[0], of_size),
            What::Computed(value) => {
                // The model has computed this from numbers, which is right only if all operands are
                // constants.
                from.iter().try_for_each(|&element| self.bits(element).map(drop))?;
                Ok(if bits == 1 { graph::truth(value == 1) } else { graph::constant(of_size, value) })
            }
            What::Found => Err(Unproved::Integers),
            What::Logic(table) => {
                let operands =
                    from.iter().map(|&element| self.read(element, of_size)).collect::<Result<Vec<_>, _>>()?;
                logic(table, &operands)
            }
            What::Float(format, float) => {
                let operands = from.iter().map(|&element| self.read(element, format)).collect::<Result<Vec<_>, _>>()?;
                float_of(float, &operands)
            }
            What::Convert(Number::Int32 | Number::Int64, to) => {
                let integer = if from[0].bits == 64 { Number::Int64 } else { Number::Int32 };
                Ok(graph::constant(to, model::convert(integer, to, self.bits(from[0])?)))
            }
            What::Convert(of, Number::Single | Number::Double) => Ok(graph::convert(self.read(from[0], of)?)),
            What::Convert(..) => Err(Unproved::Integers),
            What::Compare(format, number) => {
                let holds = graph::predicate(number, self.read(from[0], format)?, self.read(from[1], format)?);
                Ok(if bits == 1 { holds } else { graph::mask(of_size, holds) })
            }
        }
    }

    /// An element as a number of a format. An element of another size, or across words, must be
    /// constant.
    fn read(&self, element: Element, format: Number) -> Result<Node, Unproved> {
        if u64::from(element.bits) != 8 * u64::from(format.bytes()) {
            return Ok(graph::constant(format, self.bits(element)?));
        }
        let word = |at: u64| match element.place {
            Place::Vector(number) => Ok(self.vectors[usize::from(number)][(at / 32) as usize]),
            Place::Memory => self.word(at / 8),
            _ => Ok(graph::constant(Number::Single, self.bits(Element { at, bits: 32, ..element })?)),
        };
        if !element.at.is_multiple_of(32) && element.place != Place::Memory {
            return Ok(graph::constant(format, self.bits(element)?));
        }
        let lower = word(element.at)?;
        if format.bytes() == 8 { Ok(graph::pair(lower, word(element.at + 32)?)) } else { Ok(lower) }
    }

    /// One bit as a condition: a bit of a mask, or the sign bit of a number.
    fn condition_of(&self, element: Element) -> Result<Node, Unproved> {
        match element.place {
            Place::Mask(number) => Ok(self.masks[usize::from(number)][element.at as usize]),
            Place::Vector(number) if element.at % 32 == 31 => {
                let word = self.vectors[usize::from(number)][(element.at / 32) as usize];
                graph::sign_bit(word).ok_or(Unproved::Integers)
            }
            _ => Err(Unproved::Integers),
        }
    }

    /// The bits of an element that is constant.
    fn bits(&self, element: Element) -> Result<u64, Unproved> {
        let ones = u64::MAX >> (64 - element.bits);
        let word = |word: Node| word.constant().ok_or(Unproved::Integers);
        match element.place {
            Place::General(number) => match &self.general[usize::from(number)] {
                General::Known(bits) => Ok(bits >> element.at & ones),
                _ => Err(Unproved::Integers),
            },
            Place::Mask(_) if element.bits == 1 => match self.condition_of(element)?.expression() {
                Expression::True => Ok(1),
                Expression::Not(contrary) if contrary == graph::yes() => Ok(0),
                _ => Err(Unproved::Integers),
            },
            Place::Vector(number) => {
                let words = &self.vectors[usize::from(number)][(element.at / 32) as usize..];
                let lower = word(words[0])?;
                let upper = if element.at % 32 + u64::from(element.bits) > 32 { word(words[1])? } else { 0 };
                Ok((lower | upper << 32) >> (element.at % 32) & ones)
            }
            Place::Memory => {
                let bytes = element.at / 8;
                let lower = word(self.word(bytes & !3)?)?;
                let shift = 8 * (bytes & 3) + element.at % 8;
                let upper = if shift + u64::from(element.bits) > 32 { word(self.word((bytes & !3) + 4)?)? } else { 0 };
                Ok((lower | upper << 32) >> shift & ones)
            }
            _ => Err(Unproved::Integers),
        }
    }

    fn write(&mut self, to: Element, value: Node) -> Result<(), Unproved> {
        let words = match to.bits {
            64 => vec![graph::half(value, false), graph::half(value, true)],
            _ => vec![value],
        };
        match to.place {
            Place::Vector(number) if to.bits >= 32 => {
                let first = (to.at / 32) as usize;
                self.vectors[usize::from(number)][first..first + words.len()].copy_from_slice(&words);
            }
            Place::Memory if to.bits >= 32 => {
                for (word, value) in words.into_iter().enumerate() {
                    self.memory.insert(to.at / 8 + 4 * word as u64, value);
                }
            }
            Place::Mask(number) if to.bits == 1 => self.masks[usize::from(number)][to.at as usize] = value,
            // The model clears the bits of a mask beyond the lanes of the instruction.
            Place::Mask(number) if value.constant() == Some(0) => {
                self.masks[usize::from(number)][to.at as usize..].fill(graph::no());
            }
            _ => return Err(Unproved::Integers),
        }
        Ok(())
    }

    /// Executes an instruction on general registers. Its result is unknown unless its operands are
    /// constants.
    fn general_step(&mut self, instruction: &iced_x86::Instruction) -> Result<(), Unproved> {
        use Mnemonic::*;
        let touched = self.touched(instruction)?.map(|touched| touched.address);
        let last = instruction.op_count().checked_sub(1).ok_or_else(|| unknown(instruction))?;
        let first = || self.general_operand(instruction, 0, touched);
        let second = || self.general_operand(instruction, last, touched);
        match instruction.mnemonic() {
            Mov => {
                let value = second()?;
                self.set_operand(instruction, 0, touched, value)
            }
            Lea => {
                let address = |register, _, _| match &self.general[Register::full_register(register).number()] {
                    General::Known(bits) => Some(*bits),
                    _ => None,
                };
                let address = instruction.virtual_address(1, 0, address).ok_or(Unproved::Address)?;
                self.set_operand(instruction, 0, None, General::Known(address))
            }
            Xchg => {
                let (a, b) = (first()?, second()?);
                self.set_operand(instruction, 0, touched, b)?;
                self.set_operand(instruction, last, touched, a)
            }
            Push => {
                let value = first()?;
                self.move_stack(-8)?;
                let address = self.stack()?;
                self.set_word(address, 8, value)
            }
            Pop => {
                let value = self.general_memory(self.stack()?, 8)?;
                self.move_stack(8)?;
                self.set_operand(instruction, 0, None, value)
            }
            Test if matches!(first()?, General::Lanes(_))
                && instruction.op0_register() == instruction.op1_register() =>
            {
                if let General::Lanes(lanes) = first()? {
                    let none = lanes.into_iter().fold(graph::yes(), |none, lane| graph::both(none, graph::not(lane)));
                    self.flags = Flags::NoLane(none);
                }
                Ok(())
            }
            Add | Sub | And | Or | Xor | Cmp | Test | Inc | Dec | Shl | Shr => {
                let operands = [first()?, second()?];
                self.integer_step(instruction, operands, touched)
            }
            _ => Err(unknown(instruction)),
        }
    }

    /// Executes an integer instruction on these operands. If one of them is in memory, it is at
    /// `touched`.
    fn integer_step(
        &mut self,
        instruction: &iced_x86::Instruction,
        operands: [General; 2],
        touched: Option<u64>,
    ) -> Result<(), Unproved> {
        use Mnemonic::*;
        let mnemonic = instruction.mnemonic();
        let only_compares = matches!(mnemonic, Cmp | Test);
        let [General::Known(a), General::Known(b)] = operands else {
            self.flags = Flags::Unknown;
            if only_compares {
                return Ok(());
            }
            return self.set_operand(instruction, 0, touched, General::Unknown);
        };
        let bytes = match instruction.op0_kind() {
            OpKind::Register => instruction.op0_register().size() as u32,
            _ => instruction.memory_size().size() as u32,
        };
        let ones = u64::MAX >> (64 - 8 * bytes);
        let Integer { bits, carry } = integer(mnemonic, a & ones, b & ones, 8 * bytes);
        let bits = bits & ones;
        let is_shift_by_0 = matches!(mnemonic, Shl | Shr) && b % 32 == 0;
        self.flags = if is_shift_by_0 {
            // The instruction leaves the flags unchanged, which is not modelled here. Unknown flags
            // are safe: a jump that reads them proves nothing.
            Flags::Unknown
        } else {
            Flags::Known { zero: bits == 0, carry, sign: bits >> (8 * bytes - 1) == 1 }
        };
        if only_compares {
            return Ok(());
        }
        self.set_operand(instruction, 0, touched, General::Known(bits))
    }

    fn general_operand(
        &self,
        instruction: &iced_x86::Instruction,
        operand: u32,
        address: Option<u64>,
    ) -> Result<General, Unproved> {
        match (instruction.op_kind(operand), address) {
            (OpKind::Register, _) => {
                let register = instruction.op_register(operand);
                let value = &self.general[register.full_register().number()];
                Ok(match value {
                    General::Known(bits) => General::Known(bits & u64::MAX >> (64 - 8 * register.size())),
                    other => other.clone(),
                })
            }
            (OpKind::Memory, Some(address)) => self.general_memory(address, instruction.memory_size().size()),
            _ => instruction.try_immediate(operand).map(General::Known).map_err(|_| unknown(instruction)),
        }
    }

    fn general_memory(&self, address: u64, bytes: usize) -> Result<General, Unproved> {
        if bytes < 4 {
            return Ok(General::Unknown);
        }
        let lower = self.word(address)?.constant();
        let upper = if bytes == 8 { self.word(address + 4)?.constant() } else { Some(0) };
        Ok(lower.zip(upper).map_or(General::Unknown, |(lower, upper)| General::Known(lower | upper << 32)))
    }

    fn set_operand(
        &mut self,
        instruction: &iced_x86::Instruction,
        operand: u32,
        address: Option<u64>,
        value: General,
    ) -> Result<(), Unproved> {
        if instruction.op_kind(operand) == OpKind::Memory {
            return self.set_word(address.ok_or(Unproved::Address)?, instruction.memory_size().size(), value);
        }
        let register = instruction.op_register(operand);
        let known = match value {
            // A write to 8 or 16 bits of a register keeps the other bits, which is not modelled.
            _ if register.size() < 4 => General::Unknown,
            General::Known(bits) => General::Known(bits & u64::MAX >> (64 - 8 * register.size())),
            other => other,
        };
        self.general[register.full_register().number()] = known;
        Ok(())
    }

    fn set_word(&mut self, address: u64, bytes: usize, value: General) -> Result<(), Unproved> {
        let General::Known(bits) = value else { return Err(Unproved::Integers) };
        match bytes {
            4 => self.set_memory(address, graph::constant(Number::Single, bits)),
            8 => self.set_memory(address, graph::constant(Number::Double, bits)),
            _ => return Err(Unproved::Integers),
        }
        Ok(())
    }

    fn stack(&self) -> Result<u64, Unproved> {
        if let General::Known(stack) = self.general[RSP] { Ok(stack) } else { Err(Unproved::Address) }
    }

    fn move_stack(&mut self, bytes: i64) -> Result<(), Unproved> {
        self.general[RSP] = General::Known(self.stack()?.wrapping_add_signed(bytes));
        Ok(())
    }
}

enum Next<'a> {
    Goes,
    /// A jump by a condition that depends on inputs: this machine has jumped, and the machine in
    /// the box has not.
    Forks(Box<Machine<'a>>),
    Returns,
}

pub fn decode(code: &[u8], rip: u64) -> iced_x86::Instruction {
    iced_x86::Decoder::with_ip(64, code, rip, iced_x86::DecoderOptions::NONE).decode()
}

fn unknown(instruction: &iced_x86::Instruction) -> Unproved {
    Unproved::Instruction(format!("{:?}", instruction.mnemonic()).to_lowercase())
}

/// Whether an instruction has a vector or a mask register.
fn uses_vectors(instruction: &iced_x86::Instruction) -> bool {
    let mut factory = InstructionInfoFactory::new();
    let info = factory.info(instruction);
    let is_vector_or_mask = |register: Register| register.is_vector_register() || register.is_k();
    info.used_registers().iter().any(|used| is_vector_or_mask(used.register()))
}

/// Whether an instruction moves a bit of each lane to a general register.
fn is_of_lanes(mnemonic: Mnemonic) -> bool {
    use Mnemonic::{Kmovw, Movmskpd, Movmskps, Vmovmskpd, Vmovmskps};
    matches!(mnemonic, Kmovw | Movmskpd | Movmskps | Vmovmskpd | Vmovmskps)
}

/// The result of an integer instruction, before the bits beyond its operand size are cut off.
struct Integer {
    bits: u64,
    /// The carry flag. None for increments and shifts, whose carry is not modelled, so that a jump
    /// on it is not followed.
    carry: Option<bool>,
}

/// The result of an integer instruction on operands of `bits` bits.
fn integer(mnemonic: Mnemonic, a: u64, b: u64, bits: u32) -> Integer {
    use Mnemonic::{Add, And, Cmp, Dec, Inc, Or, Shl, Sub, Test, Xor};
    // The CPU takes 6 bits of a shift count for 64-bit operands, and 5 bits for all smaller ones.
    let count = b & if bits == 64 { 63 } else { 31 };
    let with_carry = |bits, carry| Integer { bits, carry: Some(carry) };
    let without_carry = |bits| Integer { bits, carry: None };
    match mnemonic {
        Add => with_carry(a.wrapping_add(b), (u128::from(a) + u128::from(b)) >> bits != 0),
        Sub | Cmp => with_carry(a.wrapping_sub(b), a < b),
        And | Test => with_carry(a & b, false),
        Or => with_carry(a | b, false),
        Xor => with_carry(a ^ b, false),
        Inc => without_carry(a.wrapping_add(1)),
        Dec => without_carry(a.wrapping_sub(1)),
        Shl => without_carry(a << count),
        _ => without_carry(a >> count),
    }
}

/// The 32-bit half of a 64-bit operation that begins at bit `first`.
fn half_of(operation: &Operation, first: u64) -> Operation {
    let half = |element: &Element| Element { at: element.at + first, bits: 32, ..*element };
    Operation { to: half(&operation.to), from: operation.from.iter().map(half).collect(), ..operation.clone() }
}

/// A bitwise function of two numbers; `table` is its truth table in the model's form.
fn logic(table: u8, operands: &[Node]) -> Result<Node, Unproved> {
    let &[a, b] = operands else { return Err(Unproved::Integers) };
    match table {
        0xc0 => Ok(graph::bits(Logic::And, a, b)),
        0xfc => Ok(graph::bits(Logic::Or, a, b)),
        0x3c => Ok(graph::bits(Logic::Xor, a, b)),
        0x0c => Ok(graph::without(a, b)),
        _ => Err(Unproved::Integers),
    }
}

fn float_of(float: Float, operands: &[Node]) -> Result<Node, Unproved> {
    Ok(match (float, operands) {
        (Float::Add, &[a, b]) => graph::add(a, b),
        (Float::Sub, &[a, b]) => graph::subtract(a, b),
        (Float::Mul, &[a, b]) => graph::multiply(a, b),
        (Float::Div, &[a, b]) => graph::divide(a, b),
        (Float::Min, &[a, b]) => graph::min(a, b),
        (Float::Max, &[a, b]) => graph::max(a, b),
        (Float::Sqrt, &[a]) => graph::root(a),
        (Float::Round(to), &[a]) => graph::round(to, a),
        (Float::Fma { product, addend }, &[a, b, c]) => {
            graph::fma(a, b, if addend { graph::negate(c) } else { c }, product)
        }
        // The results of estimates differ from CPU to CPU.
        _ => return Err(Unproved::Integers),
    })
}
