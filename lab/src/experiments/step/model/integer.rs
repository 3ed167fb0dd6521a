//! Instructions that compute with integers in vector registers.

use super::instruction::{Instruction, Value};

/// Makes the operations; None if the instruction is not one of this file's.
pub(super) fn model(i: &mut Instruction) -> Option<()> {
    match i.name.clone().as_str() {
        "paddd" => binary(i, u32::wrapping_add),
        "psubd" => binary(i, u32::wrapping_sub),
        "pmulld" => binary(i, u32::wrapping_mul),
        "pcmpeqd" => binary(i, |a, b| if a == b { u32::MAX } else { 0 }),
        "pcmpd" => compare(i, |bits| i64::from(bits as i32)),
        "pcmpud" => compare(i, |bits| bits as i64),
        "pmaxud" => choose(i, |a, b| a >= b),
        "pminud" => choose(i, |a, b| a <= b),
        "pslld" => shift(i, 4, u64::checked_shl),
        "psrld" => shift(i, 4, u64::checked_shr),
        "psrlq" => shift(i, 8, u64::checked_shr),
        "packssdw" => pack(i, 4, |bits| (bits as i32).clamp(i16::MIN.into(), i16::MAX.into()) as u64),
        "packuswb" => pack(i, 2, |bits| (bits as i16).clamp(0, 255) as u64),
        _ => None,
    }
}

fn binary(i: &mut Instruction, compute: impl Fn(u32, u32) -> u32) -> Option<()> {
    let (a, b) = (i.first()?, i.last()?);
    i.each(4, |i, lane| {
        let operands = [a.element(lane, 4), b.element(lane, 4)];
        let [a, b] = operands.map(|element| i.read(element) as u32);
        Value::computed(compute(a, b).into(), operands)
    })
}

/// Writes a mask, whose bits say for which pairs of elements the immediate operand's predicate
/// holds.
fn compare(i: &mut Instruction, number: impl Fn(u64) -> i64) -> Option<()> {
    let (a, b, predicate) = (i.first()?, i.last()?, i.immediate()?);
    i.each_bit(a.bytes / 4, |i, lane| {
        let operands = [a.element(lane, 4), b.element(lane, 4)];
        let [a, b] = operands.map(|element| number(i.read(element)));
        let holds = match predicate & 3 {
            0 => a == b,
            1 => a < b,
            2 => a <= b,
            _ => false,
        };
        // Predicates 4 to 7 are the negations of 0 to 3.
        Value::computed((holds != (predicate & 4 != 0)).into(), operands)
    })
}

/// Writes one of two elements: the first if `takes_first` returns true for the two.
fn choose(i: &mut Instruction, takes_first: impl Fn(u64, u64) -> bool) -> Option<()> {
    let (a, b) = (i.first()?, i.last()?);
    i.each(4, |i, lane| {
        let (a, b) = (a.element(lane, 4), b.element(lane, 4));
        let (chosen, other) = if takes_first(i.read(a), i.read(b)) { (a, b) } else { (b, a) };
        // Both elements decided which one is written.
        Value::copy(chosen).by(chosen).by(other)
    })
}

/// Shifts elements of `bytes` bytes by an immediate count, which may exceed their number of bits.
fn shift(i: &mut Instruction, bytes: u32, compute: impl Fn(u64, u32) -> Option<u64>) -> Option<()> {
    let from = i.operand(i.operands().checked_sub(1)?)?;
    let count = i.immediate()? as u32;
    i.each(bytes, |i, lane| {
        let element = from.element(lane, bytes);
        let shifted = compute(i.read(element), count).filter(|_| count < 8 * bytes).unwrap_or(0);
        Value::computed(shifted & u64::MAX >> (64 - 8 * bytes), [element])
    })
}

/// Narrows elements of `bytes` bytes to half that size, with saturation. Each 128 bits get the
/// narrowed elements of the first operand, then those of the last.
fn pack(i: &mut Instruction, bytes: u32, saturate: impl Fn(u64) -> u64) -> Option<()> {
    let (a, b) = (i.first()?, i.last()?);
    let lanes = 16 / bytes;
    i.each(bytes / 2, |i, lane| {
        let (part, index) = (lane / (2 * lanes), lane % (2 * lanes));
        let from = if index < lanes { a } else { b };
        let element = from.element(part * lanes + index % lanes, bytes);
        Value::computed(saturate(i.read(element)), [element])
    })
}
