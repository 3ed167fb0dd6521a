//! Instructions that move elements: loads and stores, broadcasts, shuffles, blends.

use super::instruction::{Instruction, Operand, Value};
use super::{Element, Place};

/// The bytes of a 128-bit part. Most shuffles move elements only within such parts.
const PART: u32 = 16;

/// Makes the operations; None if the instruction is not one of this file's.
pub(super) fn model(i: &mut Instruction) -> Option<()> {
    match i.name.clone().as_str() {
        "movaps" | "movups" | "movntps" | "movdqa32" => whole(i, 4),
        "movapd" | "movupd" => whole(i, 8),
        "movdqu8" => whole(i, 1),
        "movss" | "movd" => scalar(i, 4),
        "movsd" | "movq" => scalar(i, 8),
        "movlps" if i.operand(0)?.is_memory() => scalar(i, 8),
        "movhlps" => halves(i, |a, b| [b.element(1, 8), a.element(1, 8)]),
        "movlhps" => halves(i, |a, b| [a.element(0, 8), b.element(0, 8)]),
        "movshdup" => of_last(i, 4, |lane| lane | 1),
        "movddup" => of_last(i, 8, |lane| lane & !1),
        "broadcastss" | "pbroadcastd" => of_last(i, 4, |_| 0),
        "broadcastsd" => of_last(i, 8, |_| 0),
        "broadcasti128" | "broadcasti32x4" => of_last(i, 4, |lane| lane & 3),
        "pshufd" | "permilps" => {
            let immediate = i.immediate()? as u32;
            of_last(i, 4, |lane| lane & !3 | immediate >> (2 * (lane & 3)) & 3)
        }
        "shufps" => shuffle(i),
        "unpcklps" => interleave(i, 4, 0),
        "unpckhps" => interleave(i, 4, 1),
        "unpcklpd" => interleave(i, 8, 0),
        "unpckhpd" => interleave(i, 8, 1),
        "perm2f128" => permute_parts(i),
        "permd" | "permps" => permute(i),
        "permi2ps" => permute_two(i, 0, [1, 2]),
        "permt2ps" => permute_two(i, 1, [0, 2]),
        "pshufb" => shuffle_bytes(i),
        "blendps" | "pblendd" => blend(i),
        "blendvps" => blend_by_signs(i, 4),
        "blendvpd" => blend_by_signs(i, 8),
        "insertps" => insert_element(i),
        "insertf128" | "insertf32x4" => insert_part(i),
        "extractf128" | "extracti128" | "extractf32x4" | "extracti32x4" => extract_part(i, PART),
        "extractf64x4" | "extracti64x4" => extract_part(i, 2 * PART),
        "extractps" | "pextrd" => extract_element(i, 4),
        "pextrw" => extract_element(i, 2),
        "pextrb" => extract_element(i, 1),
        "pcompressd" => compress(i, 4),
        "zeroupper" => zero_upper(i),
        _ => None,
    }
}

/// Copies all of the last operand, in pieces of 64 bits; if a mask selects among elements, in the
/// instruction's elements.
fn whole(i: &mut Instruction, bytes: u32) -> Option<()> {
    let from = i.last()?;
    let bytes = if i.is_plain() { 8 } else { bytes };
    i.each(bytes, |_, lane| Value::copy(from.element(lane, bytes)))
}

/// Copies one element from or to memory or a general register. Moves between two vector registers
/// merge, and are not modelled.
fn scalar(i: &mut Instruction, bytes: u32) -> Option<()> {
    let (to, from) = (i.operand(0)?, i.last()?);
    let value = Value::copy(from.element(0, bytes));
    match (to.is_vector(), from.is_vector()) {
        (true, true) => return None,
        (true, false) => {
            i.write(to.element(0, bytes), value);
            i.load_beyond(to, bytes);
        }
        (false, _) => i.write_general(to, value),
    }
    Some(())
}

/// Permutation: element i of the destination is element `index(i)` of the last operand.
fn of_last(i: &mut Instruction, bytes: u32, index: impl Fn(u32) -> u32) -> Option<()> {
    let from = i.last()?;
    i.each(bytes, |_, lane| Value::copy(from.element(index(lane), bytes)))
}

/// Compression from register to register: moves the elements that the mask selects to the lowest
/// places, in order, followed by zeros.
fn compress(i: &mut Instruction, bytes: u32) -> Option<()> {
    let (to, from) = (i.operand(0)?, i.last()?);
    if to.is_memory() || !i.raw.zeroing_masking() {
        return None;
    }
    let lanes = to.bytes / bytes;
    let bits = (0..lanes).map(|lane| i.selected(lane)).collect::<Option<Vec<_>>>()?;
    let mut selected = (0..lanes).filter(|&lane| bits[lane as usize].0);
    let values =
        (0..lanes).map(|_| selected.next().map_or(Value::zero(), |lane| Value::copy(from.element(lane, bytes))));
    for (lane, value) in values.collect::<Vec<_>>().into_iter().enumerate() {
        // Where an element comes to depends on the whole mask.
        let value = bits.iter().fold(value, |value, (_, bit)| value.by(*bit));
        i.write(to.element(lane as u32, bytes), value);
    }
    i.zero_beyond(to, to.bytes);
    Some(())
}

fn halves(i: &mut Instruction, pick: impl Fn(Operand, Operand) -> [Element; 2]) -> Option<()> {
    let picked = pick(i.first()?, i.last()?);
    i.each(8, |_, lane| Value::copy(picked[lane as usize]))
}

/// `shufps`: takes two elements of the first operand and two of the last, within each part.
fn shuffle(i: &mut Instruction) -> Option<()> {
    let (a, b, immediate) = (i.first()?, i.last()?, i.immediate()? as u32);
    i.each(4, |_, lane| {
        let from = if lane & 3 < 2 { a } else { b };
        Value::copy(from.element(lane & !3 | immediate >> (2 * (lane & 3)) & 3, 4))
    })
}

/// `unpcklps` and the like: takes the elements of the lower (0) or upper (1) half of each part,
/// alternately from the two operands.
fn interleave(i: &mut Instruction, bytes: u32, half: u32) -> Option<()> {
    let (a, b) = (i.first()?, i.last()?);
    let lanes = PART / bytes;
    i.each(bytes, |_, lane| {
        let (base, index) = (lane / lanes * lanes, lane % lanes);
        let from = if index % 2 == 0 { a } else { b };
        Value::copy(from.element(base + half * lanes / 2 + index / 2, bytes))
    })
}

/// `vperm2f128`: each half of the result is one of the halves of the two operands, or 0.
fn permute_parts(i: &mut Instruction) -> Option<()> {
    let (a, b, immediate) = (i.first()?, i.last()?, i.immediate()? as u32);
    i.each(8, |_, lane| {
        let control = immediate >> (4 * (lane / 2));
        let from = if control & 2 == 0 { a } else { b };
        if control & 8 != 0 { Value::zero() } else { Value::copy(from.element(2 * (control & 1) + lane % 2, 8)) }
    })
}

/// `vpermps`: permutes the elements of the last operand by indices in the first source.
fn permute(i: &mut Instruction) -> Option<()> {
    let (indices, from) = (i.first()?, i.last()?);
    let lanes = from.bytes / 4;
    i.each(4, |i, lane| {
        let index = indices.element(lane, 4);
        Value::copy(from.element(i.read(index) as u32 & (lanes - 1), 4)).by(index)
    })
}

/// `vpermt2ps` and `vpermi2ps`: select elements from two operands by indices in a third.
fn permute_two(i: &mut Instruction, indices: u32, tables: [u32; 2]) -> Option<()> {
    let indices = i.operand(indices)?;
    let tables = [i.operand(tables[0])?, i.operand(tables[1])?];
    let lanes = indices.bytes / 4;
    i.each(4, |i, lane| {
        let index = indices.element(lane, 4);
        let at = i.read(index) as u32;
        let table = tables[usize::from(at & lanes != 0)];
        Value::copy(table.element(at & (lanes - 1), 4)).by(index)
    })
}

/// `pshufb`: selects bytes of the first operand by indices in the last, within each part; 0 for a
/// negative index.
fn shuffle_bytes(i: &mut Instruction) -> Option<()> {
    let (from, indices) = (i.first()?, i.last()?);
    i.each(1, |i, lane| {
        let index = indices.element(lane, 1);
        let at = i.read(index) as u32;
        let value = if at & 0x80 != 0 { Value::zero() } else { Value::copy(from.element(lane & !15 | at & 15, 1)) };
        value.by(index)
    })
}

fn blend(i: &mut Instruction) -> Option<()> {
    let (a, b, immediate) = (i.first()?, i.last()?, i.immediate()?);
    i.each(4, |_, lane| Value::copy(if immediate >> lane & 1 == 1 { b } else { a }.element(lane, 4)))
}

/// `vblendvps`: takes elements of the second operand or, where the sign bit of the fourth is set,
/// of the third. The legacy form has other operands and is not modelled.
fn blend_by_signs(i: &mut Instruction, bytes: u32) -> Option<()> {
    if !i.is_vex() {
        return None;
    }
    let [a, b, mask] = [i.operand(1)?, i.operand(2)?, i.operand(3)?];
    i.each(bytes, |i, lane| {
        let sign = Element { place: mask.place, at: mask.element(lane, bytes).end() - 1, bits: 1 };
        let (taken, other) = if i.read(sign) == 1 { (b, a) } else { (a, b) };
        Value::copy(taken.element(lane, bytes)).instead_of(Value::copy(other.element(lane, bytes)), sign)
    })
}

/// `insertps`: copies an element of the last operand over an element of the first, and zeroes the
/// elements that the immediate operand names.
fn insert_element(i: &mut Instruction) -> Option<()> {
    let (a, b, immediate) = (i.first()?, i.last()?, i.immediate()? as u32);
    let source = if b.is_memory() { 0 } else { immediate >> 6 & 3 };
    i.each(4, |_, lane| {
        if immediate >> lane & 1 == 1 {
            Value::zero()
        } else if lane == immediate >> 4 & 3 {
            Value::copy(b.element(source, 4))
        } else {
            Value::copy(a.element(lane, 4))
        }
    })
}

fn insert_part(i: &mut Instruction) -> Option<()> {
    let (a, b, immediate) = (i.first()?, i.last()?, i.immediate()? as u32);
    let part = immediate & (i.operand(0)?.bytes / PART - 1);
    i.each(8, |_, lane| Value::copy(if lane / 2 == part { b.element(lane % 2, 8) } else { a.element(lane, 8) }))
}

fn extract_part(i: &mut Instruction, bytes: u32) -> Option<()> {
    let (from, immediate) = (i.last()?, i.immediate()? as u32);
    let part = immediate & (from.bytes / bytes - 1);
    i.each(8, |_, lane| Value::copy(from.element(part * bytes / 8 + lane, 8)))
}

/// Extracts an element to memory or to a general register, whose other bits become 0.
fn extract_element(i: &mut Instruction, bytes: u32) -> Option<()> {
    let (to, from, immediate) = (i.operand(0)?, i.last()?, i.immediate()? as u32);
    if !to.is_memory() && bytes != 4 {
        return None;
    }
    i.write_general(to, Value::copy(from.element(immediate & (PART / bytes - 1), bytes)));
    Some(())
}

/// `vzeroupper`: zeroes the bits beyond the lowest 128 of the 16 registers that VEX can name.
fn zero_upper(i: &mut Instruction) -> Option<()> {
    for number in 0..16 {
        for word in PART / 8..8 {
            i.write(Element::new(Place::Vector(number), 8 * u64::from(word), 8), Value::zero());
        }
    }
    Some(())
}
