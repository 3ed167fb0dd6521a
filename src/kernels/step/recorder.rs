//! The recorder in the trap handler: registers from a signal's context, and memory before and after an access.

use std::arch::x86_64::__cpuid_count;
use std::ops::Range;
use std::ptr;

use iced_x86::{Decoder, DecoderOptions, Instruction, Mnemonic, OpKind, Register};

use super::imp::TRAP_FLAG;
use super::recording::{Moment, Recording, State, Touched, Visit};
use super::{Unavailable, room};

/// The components of the extended state beyond SSE, by their numbers in XCR0.
const UPPER_YMM: u32 = 2;
const MASKS: u32 = 5;
const UPPER_ZMM: u32 = 6;
const HIGH_ZMM: u32 = 7;

/// Bytes of an element of the stack.
const WORD: usize = 8;

/// The offset of a component in the state that XSAVE wrote, by CPUID, leaf 0DH.
fn offset_of(component: u32) -> usize {
    __cpuid_count(0xd, component).ebx as usize
}

/// Records what happens in some ranges of addresses.
pub struct Recorder {
    watched: Vec<Range<usize>>,
    /// The number of instructions executed there.
    executed: u64,
    keeps: Keeps,
}

/// With memory for everything recorded: the handler does not allocate.
enum Keeps {
    /// All of them, but only that they were executed.
    Visits(Vec<Visit>),
    /// The registers too.
    Moments(Moments),
}

struct Moments {
    /// By their numbers, in ascending order.
    wanted: Vec<Range<u64>>,
    most: usize,
    kept: Vec<Moment>,
    /// The instruction being executed, if it is wanted: its memory has to be read again.
    running: Option<Instruction>,
    /// Offsets of [`UPPER_YMM`], [`MASKS`], [`UPPER_ZMM`] and [`HIGH_ZMM`].
    offsets: [usize; 4],
}

impl Recorder {
    pub fn of_visits(watched: &[Range<usize>], most: usize) -> Result<Self, Unavailable> {
        Ok(Recorder { watched: watched.into(), executed: 0, keeps: Keeps::Visits(room(most)?) })
    }

    pub fn of_moments(watched: &[Range<usize>], wanted: &[Range<u64>], most: usize) -> Result<Self, Unavailable> {
        let keeps = Keeps::Moments(Moments {
            wanted: wanted.into(),
            most,
            // The moment after the last of each run of them is kept too.
            kept: room(most.saturating_add(1))?,
            running: None,
            offsets: [UPPER_YMM, MASKS, UPPER_ZMM, HIGH_ZMM].map(offset_of),
        });
        Ok(Recorder { watched: watched.into(), executed: 0, keeps })
    }

    /// The record, and whether it is complete.
    pub fn into_visits(self) -> (Vec<Visit>, bool) {
        match self.keeps {
            Keeps::Visits(visits) => {
                let all = visits.len() as u64 == self.executed;
                (visits, all)
            }
            Keeps::Moments(_) => (Vec::new(), false),
        }
    }

    pub fn into_recording(self) -> Recording {
        let moments = match self.keeps {
            Keeps::Visits(_) => Vec::new(),
            Keeps::Moments(moments) => moments.kept,
        };
        Recording { moments, executed: self.executed }
    }

    /// Called before each instruction, with the context that it interrupted. Returns whether the record is full.
    ///
    /// # Safety
    /// The context is that of a trap after an instruction, and its next instruction is about to be executed.
    pub unsafe fn trap(&mut self, context: &libc::ucontext_t) -> bool {
        let rip = context.uc_mcontext.gregs[libc::REG_RIP as usize] as usize;
        let range = self.watched.iter().find(|range| range.contains(&rip));
        let number = range.is_some().then_some(self.executed);
        self.executed += u64::from(range.is_some());
        let mut code = [0; 16];
        if let Some(range) = range {
            let length = code.len().min(range.end - rip);
            // SAFETY: code from here to the end of the range, which is mapped and which nobody writes.
            unsafe { ptr::copy_nonoverlapping(rip as *const u8, code.as_mut_ptr(), length) };
        }
        match &mut self.keeps {
            Keeps::Visits(visits) => {
                if number.is_some() {
                    if visits.len() == visits.capacity() {
                        return true;
                    }
                    let (address, bytes) = operand(&decoded(&code, rip), &general(context)).unwrap_or_default();
                    visits.push(Visit { rip: rip as u64, address, bytes: bytes as u8 });
                }
            }
            // SAFETY: by the contract of this function.
            Keeps::Moments(moments) => unsafe { moments.trap(context, number, code) },
        }
        false
    }
}

fn decoded(code: &[u8], rip: usize) -> Instruction {
    Decoder::with_ip(64, code, rip as u64, DecoderOptions::NONE).decode()
}

impl Moments {
    /// As [`Recorder::trap`], for an instruction with that number, if it is watched.
    ///
    /// # Safety
    /// As there.
    unsafe fn trap(&mut self, context: &libc::ucontext_t, number: Option<u64>, code: [u8; 16]) {
        let number = number.filter(|number| self.wanted.iter().any(|range| range.contains(number)));
        let ran = self.running.take();
        if ran.is_none() && number.is_none() {
            return;
        }
        if let (Some(instruction), Some(Moment { state, touched: Some(touched), .. })) = (ran, self.kept.last_mut()) {
            // SAFETY: the instruction has just read or written these bytes.
            unsafe { touch(&instruction, state, touched.address, &mut touched.after) };
        }
        if self.kept.len() > self.most {
            return;
        }
        // SAFETY: by the contract of this function.
        let state = unsafe { self.state(context) };
        let mut touched = None;
        if number.is_some() && self.kept.len() < self.most {
            let instruction = decoded(&code, state.rip as usize);
            touched = operand(&instruction, &state.general).map(|(address, bytes)| {
                let mut touched = Touched { address, bytes: bytes as u8, before: [0; 64], after: [0; 64] };
                // SAFETY: the instruction is about to read or write these bytes, and would fault where they are not there.
                unsafe { touch(&instruction, &state, address, &mut touched.before) };
                touched
            });
            self.running = Some(instruction);
        }
        self.kept.push(Moment { state, number: number.filter(|_| self.running.is_some()), code, touched });
    }

    /// The registers of a context.
    ///
    /// # Safety
    /// The context is that of a signal: its pointer leads to the floating-point state that the operating system saved.
    unsafe fn state(&self, context: &libc::ucontext_t) -> State {
        /// Offsets in what FXSAVE writes, and the operating system's mark in the unused bytes that the extended state
        /// follows.
        const MXCSR: usize = 24;
        const XMM: usize = 160;
        const MARK: usize = 464;
        const IS_EXTENDED: u32 = 0x4650_5853;
        /// In the header that follows: which components are present; the others are 0.
        const PRESENT: usize = 512;

        let registers = &context.uc_mcontext.gregs;
        let mut state = State {
            general: general(context),
            rip: registers[libc::REG_RIP as usize] as u64,
            flags: registers[libc::REG_EFL as usize] as u64 & !TRAP_FLAG,
            mxcsr: 0,
            vectors: [[0; 64]; 32],
            masks: [0; 8],
        };
        let saved = context.uc_mcontext.fpregs.cast::<u8>().cast_const();
        let [upper_ymm, masks, upper_zmm, high_zmm] = self.offsets;
        // SAFETY: the legacy area is always there, the extended one where it is marked, and each component at its offset in
        // the standard form, which signals use, if the header says so.
        unsafe {
            state.mxcsr = saved.add(MXCSR).cast::<u32>().read_unaligned();
            let copy =
                |from: usize, to: &mut [u8]| ptr::copy_nonoverlapping(saved.add(from), to.as_mut_ptr(), to.len());
            for (number, vector) in state.vectors[..16].iter_mut().enumerate() {
                copy(XMM + 16 * number, &mut vector[..16]);
            }
            if saved.add(MARK).cast::<u32>().read_unaligned() != IS_EXTENDED {
                return state;
            }
            let present = saved.add(PRESENT).cast::<u64>().read_unaligned();
            let has = |component: u32| present & 1 << component != 0;
            for (number, vector) in state.vectors.iter_mut().enumerate() {
                match number {
                    16.. if has(HIGH_ZMM) => copy(high_zmm + 64 * (number - 16), vector),
                    16.. => {}
                    _ => {
                        if has(UPPER_YMM) {
                            copy(upper_ymm + 16 * number, &mut vector[16..32]);
                        }
                        if has(UPPER_ZMM) {
                            copy(upper_zmm + 32 * number, &mut vector[32..]);
                        }
                    }
                }
            }
            if has(MASKS) {
                for (number, mask) in state.masks.iter_mut().enumerate() {
                    *mask = saved.add(masks + 8 * number).cast::<u64>().read_unaligned();
                }
            }
        }
        state
    }
}

/// The general registers of a context, by their numbers in instructions.
fn general(context: &libc::ucontext_t) -> [u64; 16] {
    const ORDER: [libc::c_int; 16] = {
        use libc::*;
        [
            REG_RAX, REG_RCX, REG_RDX, REG_RBX, REG_RSP, REG_RBP, REG_RSI, REG_RDI, REG_R8, REG_R9, REG_R10, REG_R11,
            REG_R12, REG_R13, REG_R14, REG_R15,
        ]
    };
    ORDER.map(|register| context.uc_mcontext.gregs[register as usize] as u64)
}

/// The address and length of an instruction's memory operand.
fn operand(instruction: &Instruction, general: &[u64; 16]) -> Option<(u64, usize)> {
    use Mnemonic::*;
    let stack = general[4];
    match instruction.mnemonic() {
        // These have an address, but do not access memory there.
        Lea | Nop | Prefetch | Prefetchnta | Prefetcht0 | Prefetcht1 | Prefetcht2 | Prefetchw | Prefetchwt1 => {
            return None;
        }
        Push | Call => return Some((stack.wrapping_sub(WORD as u64), WORD)),
        Pop | Ret => return Some((stack, WORD)),
        _ => {}
    }
    let operand = (0..instruction.op_count()).find(|&index| instruction.op_kind(index) == OpKind::Memory)?;
    let address = instruction.virtual_address(operand, 0, |register, _, _| match register {
        Register::ES | Register::CS | Register::SS | Register::DS => Some(0),
        _ if register.is_gpr64() => Some(general[register.number()]),
        _ => None,
    })?;
    Some((address, instruction.memory_size().size().min(64)))
}

/// Copies an instruction's memory at `address`; elements that its mask excludes stay 0. No kernel compresses to memory.
///
/// # Safety
/// It is being executed with the mask registers of `state`, and accesses what [`operand`] says.
unsafe fn touch(instruction: &Instruction, state: &State, address: u64, to: &mut [u8; 64]) {
    let from = address as *const u8;
    let size = instruction.memory_size();
    if size.size() == 0 {
        // SAFETY: a word of the stack: the operand is implicit.
        unsafe { ptr::copy_nonoverlapping(from, to.as_mut_ptr(), WORD) };
        return;
    }
    let mask = match instruction.op_mask() {
        Register::None => u64::MAX,
        register => state.masks[register.number()],
    };
    let element = size.element_size();
    for index in 0..size.size().min(64) / element {
        if mask >> index & 1 != 0 || size.is_broadcast() {
            // SAFETY: an element that is touched.
            unsafe {
                ptr::copy_nonoverlapping(from.add(index * element), to.as_mut_ptr().add(index * element), element)
            };
        }
    }
}
