//! Instructions that compute with floating-point numbers.

use super::instruction::{Instruction, Value};
use super::{Element, Estimate, Float, Number, Place, Rounding, What};

/// Truth tables for [`What::Logic`].
const AND: u8 = 0xc0;
const AND_NOT: u8 = 0x0c;
const OR: u8 = 0xfc;
const XOR: u8 = 0x3c;

/// The flags zero, parity and carry that `comiss` sets: the number of each bit, and the comparison
/// predicate that gives its value.
const FLAGS_OF_COMPARISON: [(u32, u8); 3] = [(6, 8), (2, 3), (0, 9)];
/// The flags overflow and sign, which `comiss` clears.
const CLEARED_BY_COMPARISON: [u32; 2] = [11, 7];

/// Makes the operations; None if the instruction is not one of this file's.
pub(super) fn model(i: &mut Instruction) -> Option<()> {
    let name = i.name.clone();
    if let Some(whole) = logic(i, &name) {
        return whole;
    }
    if let Some((of, to)) = conversion(&name) {
        return convert(i, of, to);
    }
    let (stem, suffix) = name.split_at(name.len().checked_sub(2)?);
    let (format, packed) = match suffix {
        "ps" => (Number::Single, true),
        "pd" => (Number::Double, true),
        "ss" => (Number::Single, false),
        "sd" => (Number::Double, false),
        _ => return None,
    };
    let (operands, float) = match stem {
        "add" => (2, Float::Add),
        "sub" => (2, Float::Sub),
        "mul" => (2, Float::Mul),
        "div" => (2, Float::Div),
        "min" => (2, Float::Min),
        "max" => (2, Float::Max),
        "sqrt" => (1, Float::Sqrt),
        "rsqrt" => (1, Float::ReciprocalRoot(Estimate::Coarse)),
        "rsqrt14" => (1, Float::ReciprocalRoot(Estimate::Fine)),
        "round" | "rndscale" => (1, Float::Round(rounding(i.immediate()?)?)),
        "hadd" => return horizontal_add(i, format),
        "cmp" if packed => return compare(i, format),
        "comi" | "ucomi" => return compare_to_flags(i, format),
        "movmsk" => return signs(i, format),
        _ => return multiply_add(i, stem, format, packed),
    };
    let (a, b, bytes) = (i.first()?, i.last()?, format.bytes());
    elements(i, bytes, packed, |lane| {
        let operands = &[a.element(lane, bytes), b.element(lane, bytes)][2 - operands..];
        Value::of(What::Float(format, float), operands)
    })
}

/// Writes each element of the first operand; only the first element if not `packed`.
fn elements(i: &mut Instruction, bytes: u32, packed: bool, value: impl Fn(u32) -> Value) -> Option<()> {
    if packed {
        return i.each(bytes, |_, lane| value(lane));
    }
    i.lanes(i.operand(0)?, bytes, 1, |_, lane| value(lane));
    i.scalar_beyond(bytes)
}

/// `vfmadd231ps` and the like. The digits of the name say which operands are multiplied and which
/// is added; the first NaN operand in that order is the result.
fn multiply_add(i: &mut Instruction, stem: &str, format: Number, packed: bool) -> Option<()> {
    let (kind, digits) = stem.split_at_checked(stem.len().checked_sub(3)?)?;
    let (product, addend) = match kind {
        "fmadd" => (false, false),
        "fmsub" => (false, true),
        "fnmadd" => (true, false),
        _ => return None,
    };
    let order = match digits {
        "132" => [0, 2, 1],
        "213" => [1, 0, 2],
        "231" => [1, 2, 0],
        _ => return None,
    };
    let [x, y, z] = [i.operand(order[0])?, i.operand(order[1])?, i.operand(order[2])?];
    let bytes = format.bytes();
    elements(i, bytes, packed, |lane| {
        let operands = [x, y, z].map(|operand| operand.element(lane, bytes));
        Value::of(What::Float(format, Float::Fma { product, addend }), operands)
    })
}

/// Adds neighbouring elements: within each 128 bits the sums from the first operand go to the lower
/// half, and those from the second to the upper half.
fn horizontal_add(i: &mut Instruction, format: Number) -> Option<()> {
    let (a, b, bytes) = (i.first()?, i.last()?, format.bytes());
    let lanes = 16 / bytes;
    i.each(bytes, |_, lane| {
        let (base, index) = (lane / lanes * lanes, lane % lanes);
        let operand = if index < lanes / 2 { a } else { b };
        let pair = base + 2 * (index % (lanes / 2));
        Value::of(What::Float(format, Float::Add), [pair, pair + 1].map(|lane| operand.element(lane, bytes)))
    })
}

/// Sets ones where the predicate holds: whole elements of a vector, or single bits of a mask, whose
/// other bits become 0.
fn compare(i: &mut Instruction, format: Number) -> Option<()> {
    let (a, b, bytes, predicate) = (i.first()?, i.last()?, format.bytes(), i.immediate()? as u8);
    let value = |lane| Value::of(What::Compare(format, predicate), [a, b].map(|operand| operand.element(lane, bytes)));
    match i.operand(0)?.place {
        Place::Mask(_) => i.each_bit(a.bytes / bytes, |_, lane| value(lane)),
        _ => i.each(bytes, |_, lane| value(lane)),
    }
}

fn compare_to_flags(i: &mut Instruction, format: Number) -> Option<()> {
    let operands = [i.first()?, i.last()?].map(|operand| operand.element(0, format.bytes()));
    for (flag, predicate) in FLAGS_OF_COMPARISON {
        i.write(Element::bit(Place::Flags, flag), Value::of(What::Compare(format, predicate), operands));
    }
    for flag in CLEARED_BY_COMPARISON {
        i.write(Element::bit(Place::Flags, flag), Value::zero());
    }
    Some(())
}

/// Collects the sign bits of all elements in a general register.
fn signs(i: &mut Instruction, format: Number) -> Option<()> {
    let (from, bytes) = (i.last()?, format.bytes());
    let signs = |operand: super::instruction::Operand| {
        let elements = (0..operand.bytes / bytes).map(|lane| operand.element(lane, bytes));
        elements.map(|element| Element { place: element.place, at: element.end() - 1, bits: 1 }).collect::<Vec<_>>()
    };
    let signs = signs(from);
    let bits = signs.iter().rev().fold(0, |bits, &sign| bits << 1 | i.read(sign));
    i.write_general(i.operand(0)?, Value::computed(bits, signs));
    Some(())
}

/// Bitwise operations: on the instruction's elements if a mask may select among them, else on 64
/// bits at a time.
fn logic(i: &mut Instruction, name: &str) -> Option<Option<()>> {
    let (table, bytes) = match name {
        "andps" | "pand" | "pandd" => (AND, 4),
        "andpd" => (AND, 8),
        "pandn" => (AND_NOT, 4),
        "orps" | "por" | "pord" => (OR, 4),
        "orpd" => (OR, 8),
        "xorps" => (XOR, 4),
        "xorpd" => (XOR, 8),
        "pternlogd" => (0, 4),
        _ => return None,
    };
    Some(bitwise(i, table, if i.is_plain() { 8 } else { bytes }))
}

fn bitwise(i: &mut Instruction, table: u8, bytes: u32) -> Option<()> {
    let (a, b) = (i.first()?, i.last()?);
    let (table, operands) = match i.name.as_str() {
        "pternlogd" => (i.immediate()? as u8, vec![i.operand(0)?, a, b]),
        _ => (table, vec![a, b]),
    };
    // The exclusive or of a register with itself is 0 and depends on nothing.
    if table == XOR && a.place == b.place && !a.is_memory() {
        return i.each(bytes, |_, _| Value::zero());
    }
    i.each(bytes, |_, lane| {
        let operands: Vec<_> = operands.iter().map(|operand| operand.element(lane, bytes)).collect();
        Value::of(What::Logic(table), operands)
    })
}

fn conversion(name: &str) -> Option<(Number, Number)> {
    Some(match name {
        "cvtdq2ps" => (Number::Int32, Number::Single),
        "cvtdq2pd" => (Number::Int32, Number::Double),
        "cvtps2pd" | "cvtss2sd" => (Number::Single, Number::Double),
        "cvtpd2ps" => (Number::Double, Number::Single),
        "cvttps2dq" | "cvttss2si" => (Number::Single, Number::Int32),
        "cvttpd2dq" | "cvttsd2si" => (Number::Double, Number::Int32),
        "cvtsi2ss" => (Number::Int32, Number::Single),
        "cvtsi2sd" => (Number::Int32, Number::Double),
        _ => return None,
    })
}

fn convert(i: &mut Instruction, of: Number, to: Number) -> Option<()> {
    let (from, into) = (i.last()?, i.operand(0)?);
    let sized = |operand: super::instruction::Operand, number| match operand.bytes {
        8 => Number::Int64,
        _ => number,
    };
    if i.name.ends_with("si") {
        let to = sized(into, to);
        i.write(into.whole(), Value::of(What::Convert(of, to), [from.element(0, of.bytes())]));
        i.zero(into, into.bytes, 8);
        return Some(());
    }
    if i.name.ends_with("ss") || i.name.ends_with("sd") {
        let of = if of == Number::Int32 { sized(from, of) } else { of };
        let value = Value::of(What::Convert(of, to), [from.element(0, of.bytes())]);
        i.lanes(into, to.bytes(), 1, |_, _| value.clone());
        return i.scalar_beyond(to.bytes());
    }
    // As many elements as fit into both operands. A narrower result leaves zeros in the rest of its
    // 128 bits.
    let lanes = (from.bytes / of.bytes()).min(into.bytes / to.bytes());
    i.lanes(into, to.bytes(), lanes, |_, lane| Value::of(What::Convert(of, to), [from.element(lane, of.bytes())]));
    let written = lanes * to.bytes();
    i.zero(into, written, 16);
    i.zero_beyond(into, written.max(16));
    Some(())
}

/// The rounding that an immediate operand selects; None if it also scales. Bit 3 only suppresses an
/// exception.
/// exception.
fn rounding(immediate: u64) -> Option<Rounding> {
    match immediate & !8 {
        1 => Some(Rounding::Down),
        2 => Some(Rounding::Up),
        _ => None,
    }
}
