//! Executes operations on bits, and compares the resulting registers and memory with the CPU's.

use super::{Element, Operation, Place, What, arithmetic};
use rayo::internals::kernels::step::{State, Step};

/// The flags that are compared: carry, parity, zero, sign, direction and overflow. The kernels use
/// no others.
const FLAGS: u64 = 0b1100_1100_0101;
/// The control bits of MXCSR; its status bits are not modelled.
const CONTROL: u32 = 0xffc0;

/// The comparison of the model's prediction with the CPU.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Check {
    /// How many bits that the instruction wrote were compared. All other bits are compared too, but
    /// not counted.
    pub bits: u64,
    /// The 64-bit words for which the prediction was wrong.
    pub differences: Vec<Difference>,
}

/// A 64-bit word that differs from its prediction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Difference {
    pub at: Element,
    /// The model's value.
    pub predicted: u64,
    /// The CPU's value.
    pub found: u64,
}

/// Compares the operations of [`super::model`], applied to the state before the step, with the
/// state after it.
pub fn check(step: &Step, operations: &[Operation]) -> Check {
    let mut state = step.before.clone();
    let address = step.touched.map_or(0, |touched| touched.address);
    let mut memory = step.touched.map_or([0; 64], |touched| touched.before);
    let mut bits = 0;
    for operation in operations {
        if operation.what != What::Found {
            bits += u64::from(operation.to.bits);
        }
        put(&mut state, &mut memory, address, operation.to, result(step, operation));
    }
    let mut check = Check { bits, differences: Vec::new() };
    let mut compare = |place, byte: u64, predicted, found| {
        if predicted != found {
            let at = Element::new(place, byte, 8);
            check.differences.push(Difference { at, predicted, found });
        }
    };
    let after = step.after;
    for (number, (&predicted, &found)) in state.general.iter().zip(&after.general).enumerate() {
        compare(Place::General(number as u8), 0, predicted, found);
    }
    for (number, (predicted, found)) in state.vectors.iter().zip(&after.vectors).enumerate() {
        if predicted != found {
            for byte in (0..64).step_by(8) {
                compare(Place::Vector(number as u8), byte as u64, get(predicted, byte, 8), get(found, byte, 8));
            }
        }
    }
    for (number, (&predicted, &found)) in state.masks.iter().zip(&after.masks).enumerate() {
        compare(Place::Mask(number as u8), 0, predicted, found);
    }
    compare(Place::Flags, 0, state.flags & FLAGS, after.flags & FLAGS);
    compare(Place::Flags, 8, (state.mxcsr & CONTROL).into(), (after.mxcsr & CONTROL).into());
    compare(Place::Next, 0, state.rip, after.rip);
    if let Some(touched) = step.touched {
        for byte in (0..64).step_by(8) {
            compare(Place::Memory, address + byte as u64, get(&memory, byte, 8), get(&touched.after, byte, 8));
        }
    }
    check
}

/// The result of an operation, from the state before its instruction. Where the result is not
/// determined, as that of an estimate or one that the manual leaves undefined, it is the CPU's.
pub(crate) fn result(step: &Step, operation: &Operation) -> u64 {
    let from: Vec<u64> = operation.from.iter().map(|&element| before(step, element)).collect();
    let found = || after(step, operation.to);
    let bits = match operation.what {
        What::Copy => from[0],
        What::Computed(bits) => bits,
        What::Found => found(),
        What::Logic(table) => logic(table, &from),
        What::Float(format, float) => arithmetic::float(format, float, &from, found),
        What::Convert(of, to) => arithmetic::convert(of, to, from[0]),
        What::Compare(format, predicate) => arithmetic::compare(format, predicate, [from[0], from[1]]),
    };
    bits & ones(operation.to.bits)
}

/// A bitwise function of up to three operands, by its truth table.
pub(crate) fn logic(table: u8, from: &[u64]) -> u64 {
    let of = |index: usize| from.get(index).copied().unwrap_or(0);
    let is = |bit: usize, operand: u64| if bit == 1 { operand } else { !operand };
    (0..8)
        .filter(|row| table >> row & 1 == 1)
        .fold(0, |result, row| result | is(row >> 2 & 1, of(0)) & is(row >> 1 & 1, of(1)) & is(row & 1, of(2)))
}

/// The bits of an element before a step.
pub(crate) fn before(step: &Step, element: Element) -> u64 {
    let memory = step.touched.map_or(&[0; 64], |touched| &touched.before);
    read(step.before, memory, step, element)
}

/// The bits of an element after a step.
pub(crate) fn after(step: &Step, element: Element) -> u64 {
    let memory = step.touched.map_or(&[0; 64], |touched| &touched.after);
    read(step.after, memory, step, element)
}

fn read(state: &State, memory: &[u8; 64], step: &Step, element: Element) -> u64 {
    // An element that does not begin at a byte is a sign bit, and lies within one byte.
    let (byte, bytes) = ((element.at / 8) as usize, element.bits.div_ceil(8) as usize);
    let word = match element.place {
        Place::General(number) => state.general[usize::from(number)] >> element.at,
        Place::Vector(number) => get(&state.vectors[usize::from(number)], byte, bytes) >> (element.at % 8),
        Place::Mask(number) => state.masks[usize::from(number)] >> element.at,
        Place::Flags => state.flags >> element.at,
        Place::Next => state.rip,
        Place::Memory => {
            let address = step.touched.map_or(0, |touched| touched.address);
            let byte = (element.at / 8).wrapping_sub(address) as usize;
            get(memory, byte, bytes) >> (element.at % 8)
        }
    };
    word & ones(element.bits)
}

/// Writes an element to a state or, if it is in memory, to `memory`, which begins at `address`.
fn put(state: &mut State, memory: &mut [u8; 64], address: u64, element: Element, bits: u64) {
    let byte = (element.at / 8) as usize;
    let bytes = element.bits as usize / 8;
    let word = match element.place {
        Place::General(number) => &mut state.general[usize::from(number)],
        Place::Mask(number) => &mut state.masks[usize::from(number)],
        Place::Flags => &mut state.flags,
        Place::Next => &mut state.rip,
        Place::Vector(number) => {
            state.vectors[usize::from(number)][byte..byte + bytes].copy_from_slice(&bits.to_le_bytes()[..bytes]);
            return;
        }
        Place::Memory => {
            let byte = byte - address as usize;
            memory[byte..byte + bytes].copy_from_slice(&bits.to_le_bytes()[..bytes]);
            return;
        }
    };
    let mask = ones(element.bits) << element.at;
    *word = *word & !mask | bits << element.at;
}

/// Up to 8 bytes as a number. Bytes beyond the end are 0; operations that would read them were
/// refused by [`super::instruction::Instruction::finish`].
fn get(bytes: &[u8; 64], from: usize, count: usize) -> u64 {
    let mut word = [0; 8];
    if let Some(bytes) = from.checked_add(count).and_then(|end| bytes.get(from..end)) {
        word[..count].copy_from_slice(bytes);
    }
    u64::from_le_bytes(word)
}

fn ones(bits: u32) -> u64 {
    u64::MAX >> (64 - bits)
}
