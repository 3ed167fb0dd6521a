//! The recorder in the trap handler. It reads registers from a signal's context, and memory before
//! and after an access.

use std::arch::x86_64::__cpuid_count;
use std::ops::Range;
use std::ptr;

use iced_x86::{Decoder, DecoderOptions, Instruction, Register};

use super::super::crash::general;
use super::imp::TRAP_FLAG;
use super::recording::{MemoryOperand, Moment, Recording, State, Touched, Visit, VisitRecord, WORD, memory_operand};
use super::{Unavailable, room};

/// The numbers in XCR0 of the components of the extended state that follow SSE's.
const UPPER_YMM: u32 = 2;
const MASKS: u32 = 5;
const UPPER_ZMM: u32 = 6;
const HIGH_ZMM: u32 = 7;

/// The offset of a component in the state that XSAVE writes, from CPUID leaf 0DH.
fn offset_of(component: u32) -> usize {
    __cpuid_count(0xd, component).ebx as usize
}

/// Records instructions in some ranges of addresses.
pub struct Recorder {
    watched: Vec<Range<usize>>,
    /// The number of instructions executed in these ranges.
    executed: u64,
    keeps: RecordedState,
}

/// What is kept. Memory for it is reserved, since the handler cannot allocate.
enum RecordedState {
    /// Only that an instruction was executed.
    Visits(Vec<Visit>),
    /// The registers as well.
    Moments(Moments),
}

struct Moments {
    /// The numbers of the instructions to record, in ascending order.
    wanted: Vec<Range<u64>>,
    most: usize,
    kept: Vec<Moment>,
    /// The instruction that is being executed, if it is wanted: the memory that it accesses has to
    /// be read again afterwards.
    running: Option<Instruction>,
    /// The offsets of [`UPPER_YMM`], [`MASKS`], [`UPPER_ZMM`] and [`HIGH_ZMM`].
    offsets: [usize; 4],
}

impl Recorder {
    pub fn of_visits(watched: &[Range<usize>], most: usize) -> Result<Self, Unavailable> {
        Ok(Recorder { watched: watched.into(), executed: 0, keeps: RecordedState::Visits(room(most)?) })
    }

    pub fn of_moments(watched: &[Range<usize>], wanted: &[Range<u64>], most: usize) -> Result<Self, Unavailable> {
        let keeps = RecordedState::Moments(Moments {
            wanted: wanted.into(),
            most,
            // The state after the last instruction of each consecutive run is kept too.
            kept: room(most.saturating_add(1))?,
            running: None,
            offsets: [UPPER_YMM, MASKS, UPPER_ZMM, HIGH_ZMM].map(offset_of),
        });
        Ok(Recorder { watched: watched.into(), executed: 0, keeps })
    }

    pub fn into_visits(self) -> VisitRecord {
        match self.keeps {
            RecordedState::Visits(visits) => {
                let complete = visits.len() as u64 == self.executed;
                VisitRecord { visits, complete }
            }
            RecordedState::Moments(_) => VisitRecord { visits: Vec::new(), complete: false },
        }
    }

    pub fn into_recording(self) -> Recording {
        let moments = match self.keeps {
            RecordedState::Visits(_) => Vec::new(),
            RecordedState::Moments(moments) => moments.kept,
        };
        Recording { moments, executed: self.executed, crashed: None }
    }

    /// Called before each instruction, with the context that was interrupted. Returns whether the
    /// record is full.
    ///
    /// # Safety
    /// The context is that of a trap after an instruction, and the next instruction is about to be
    /// executed.
    pub unsafe fn trap(&mut self, context: &libc::ucontext_t) -> bool {
        let rip = context.uc_mcontext.gregs[libc::REG_RIP as usize] as usize;
        let range = self.watched.iter().find(|range| range.contains(&rip));
        let number = range.is_some().then_some(self.executed);
        self.executed += u64::from(range.is_some());
        let mut code = [0; 16];
        if let Some(range) = range {
            let length = code.len().min(range.end - rip);
            // SAFETY: the bytes from here to the end of the range are code, which is mapped and
            // never written.
            unsafe { ptr::copy_nonoverlapping(rip as *const u8, code.as_mut_ptr(), length) };
        }
        match &mut self.keeps {
            RecordedState::Visits(visits) => {
                if number.is_some() {
                    if visits.len() == visits.capacity() {
                        return true;
                    }
                    let MemoryOperand { address, bytes } =
                        memory_operand(&decoded(&code, rip), &general(context)).unwrap_or_default();
                    visits.push(Visit { rip: rip as u64, address, bytes: bytes as u8 });
                }
            }
            // SAFETY: the caller keeps the contract of this function.
            RecordedState::Moments(moments) => unsafe { moments.trap(context, number, code) },
        }
        false
    }
}

fn decoded(code: &[u8], rip: usize) -> Instruction {
    Decoder::with_ip(64, code, rip as u64, DecoderOptions::NONE).decode()
}

impl Moments {
    /// As [`Recorder::trap`], for an instruction that has this number if it is watched.
    ///
    /// # Safety
    /// That of [`Recorder::trap`].
    unsafe fn trap(&mut self, context: &libc::ucontext_t, number: Option<u64>, code: [u8; 16]) {
        let number = number.filter(|number| self.wanted.iter().any(|range| range.contains(number)));
        let ran = self.running.take();
        if ran.is_none() && number.is_none() {
            return;
        }
        if let (Some(instruction), Some(Moment { state, touched: Some(touched), .. })) = (ran, self.kept.last_mut()) {
            touch(&instruction, state, touched.address, &mut touched.after);
        }
        if self.kept.len() > self.most {
            return;
        }
        // SAFETY: the caller keeps the contract of this function.
        let state = unsafe { self.state(context) };
        let mut touched = None;
        if number.is_some() && self.kept.len() < self.most {
            let instruction = decoded(&code, state.rip as usize);
            touched = memory_operand(&instruction, &state.general).map(|MemoryOperand { address, bytes }| {
                let mut touched = Touched { address, bytes: bytes as u8, before: [0; 64], after: [0; 64] };
                touch(&instruction, &state, address, &mut touched.before);
                touched
            });
            self.running = Some(instruction);
        }
        self.kept.push(Moment { state, number: number.filter(|_| self.running.is_some()), code, touched });
    }

    /// The registers in a context.
    ///
    /// # Safety
    /// The context is that of a signal, whose pointer leads to the floating-point state that the
    /// operating system saved.
    unsafe fn state(&self, context: &libc::ucontext_t) -> State {
        /// Offsets in the area that FXSAVE writes, and the mark that the operating system puts into
        /// its unused bytes if the extended state follows.
        const MXCSR: usize = 24;
        const XMM: usize = 160;
        const MARK: usize = 464;
        const IS_EXTENDED: u32 = 0x4650_5853;
        /// In the header that follows, the offset of the bits that say which components are
        /// present. Absent components are 0.
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
        // SAFETY: the legacy area is always there, the extended one if it is marked, and each
        // component at its offset in the standard form, which signals use, if the header says that
        // it is present.
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

/// Copies the memory that an instruction accesses at `address`. Elements that its mask excludes
/// stay 0, and so do those that cannot be read, at which the instruction will fault. No kernel
/// compresses to memory.
fn touch(instruction: &Instruction, state: &State, address: u64, to: &mut [u8; 64]) {
    let size = instruction.memory_size();
    if size.size() == 0 {
        // The operand is implicit: a word of the stack.
        return read_memory(address, &mut to[..WORD]);
    }
    let bytes = size.size().min(64);
    if instruction.op_mask() == Register::None || size.is_broadcast() {
        return read_memory(address, &mut to[..bytes]);
    }
    let mask = state.masks[instruction.op_mask().number()];
    let element = size.element_size();
    for index in (0..bytes / element).filter(|index| mask >> index & 1 != 0) {
        let first = index * element;
        read_memory(address + first as u64, &mut to[first..first + element]);
    }
}

/// Copies memory that an instruction accesses, or nothing where it cannot be read, at which the
/// instruction will fault.
fn read_memory(address: u64, to: &mut [u8]) {
    let local = libc::iovec { iov_base: to.as_mut_ptr().cast(), iov_len: to.len() };
    let remote = libc::iovec { iov_base: address as *mut libc::c_void, iov_len: to.len() };
    // SAFETY: the system call only writes to `to`, and returns an error where nothing can be read.
    let read = unsafe { libc::process_vm_readv(libc::getpid(), &local, 1, &remote, 1, 0) };
    // Some sandboxes forbid this system call.
    if read < 0 && std::io::Error::last_os_error().raw_os_error() != Some(libc::EFAULT) {
        // SAFETY: if the process may not read here, it faults here as it would at the instruction.
        unsafe { ptr::copy_nonoverlapping(address as *const u8, to.as_mut_ptr(), to.len()) };
    }
}
