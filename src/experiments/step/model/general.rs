//! Instructions on general registers, masks and flags, and jumps.

use iced_x86::{ConditionCode, Register};

use super::instruction::{Instruction, Operand, Value, register};
use super::{Element, Place, What};

/// Flags, by their bits.
const CARRY: u32 = 0;
const PARITY: u32 = 2;
const ZERO: u32 = 6;
const SIGN: u32 = 7;
const OVERFLOW: u32 = 11;

const STACK: Place = Place::General(4);

/// What an instruction does to the flags: a bit each, None for what the manual leaves open. The adjust flag is left out: the
/// kernels never use it.
type Flags<'a> = &'a [(u32, Option<bool>)];

/// Makes the operations; None where it is not one of these.
pub(super) fn model(i: &mut Instruction) -> Option<()> {
    let condition = i.raw.condition_code();
    match i.name.clone().as_str() {
        "nop" | "endbr64" | "prefetcht0" => Some(()),
        "mov" => {
            let value =
                if i.operands() == 2 { Value::copy(i.last()?.whole()) } else { Value::computed(i.immediate()?, []) };
            i.write_general(i.operand(0)?, value);
            Some(())
        }
        "movzx" => {
            let (to, from) = (i.operand(0)?, i.last()?);
            i.write(Element { bits: 64, ..to.whole() }, Value::computed(i.read(from.whole()), [from.whole()]));
            Some(())
        }
        "movsxd" => {
            let (to, from) = (i.operand(0)?, i.last()?);
            i.write_general(to, Value::computed(i.read(from.whole()) as i32 as u64, [from.whole()]));
            Some(())
        }
        "lea" => address(i),
        "add" | "adc" | "sub" | "sbb" | "cmp" | "inc" | "dec" => sum(i),
        "and" | "or" | "xor" | "test" => logic(i),
        "not" => {
            let operand = i.operand(0)?;
            i.write_general(operand, Value::computed(!i.read(operand.whole()), [operand.whole()]));
            Some(())
        }
        "imul" => multiply(i),
        "shl" | "shr" => shift(i),
        "shlx" | "shrx" | "bzhi" => by_register(i),
        "bsf" | "bsr" => outermost_bit(i),
        "popcnt" => count_bits(i),
        "bt" | "btr" | "bts" => test_bit(i),
        "xchg" => {
            let (a, b) = (i.operand(0)?, i.operand(1)?);
            i.write_general(a, Value::copy(b.whole()));
            i.write_general(b, Value::copy(a.whole()));
            Some(())
        }
        "push" | "pop" | "call" | "ret" => stack(i),
        "jmp" => {
            jump(i, Value::computed(i.raw.near_branch_target(), []));
            (i.raw.near_branch_target() != 0).then_some(())
        }
        "kmovq" | "kmovw" => move_mask(i),
        "knotw" => {
            let (to, from) = (i.operand(0)?, i.last()?.element(0, 2));
            i.write(to.element(0, 8), Value::computed(!i.read(from) & 0xffff, [from]));
            Some(())
        }
        "kortestw" => {
            let masks = [i.operand(0)?, i.operand(1)?].map(|operand| operand.element(0, 2));
            let or = i.read(masks[0]) | i.read(masks[1]);
            let clear = [(PARITY, Some(false)), (SIGN, Some(false)), (OVERFLOW, Some(false))];
            flags(i, &masks, &[(ZERO, Some(or == 0)), (CARRY, Some(or == 0xffff))]);
            flags(i, &[], &clear);
            Some(())
        }
        name if condition != ConditionCode::None => conditional(i, name, condition),
        _ => None,
    }
}

fn flags(i: &mut Instruction, from: &[Element], made: Flags) {
    for &(flag, bit) in made {
        let value = bit.map_or_else(|| Value::of(What::Undefined, []), |bit| Value::computed(bit.into(), from));
        i.write(Element::bit(Place::Flags, flag), value);
    }
}

/// Sign, zero and parity of a result.
fn result_flags(i: &mut Instruction, from: &[Element], result: u64, bits: u32) {
    let even = (result as u8).count_ones().is_multiple_of(2);
    let sign = result >> (bits - 1) & 1 == 1;
    flags(i, from, &[(ZERO, Some(result == 0)), (SIGN, Some(sign)), (PARITY, Some(even))]);
}

/// The elements that an instruction's first operand and its last one are, without an immediate, and their numbers in the
/// bits of the first.
fn operands(i: &Instruction) -> Option<(Vec<Element>, u64, u64)> {
    let a = i.operand(0)?.whole();
    let ones = u64::MAX >> (64 - a.bits);
    match i.immediate() {
        Some(immediate) => Some((vec![a], i.read(a), immediate & ones)),
        None if i.operands() == 1 => Some((vec![a], i.read(a), 1)),
        None => {
            let b = i.operand(1)?.whole();
            Some((vec![a, b], i.read(a), i.read(b)))
        }
    }
}

fn sum(i: &mut Instruction) -> Option<()> {
    let (mut from, a, b) = operands(i)?;
    let to = i.operand(0)?;
    let bits = 8 * to.bytes;
    let ones = u64::MAX >> (64 - bits);
    let name = i.name.clone();
    let carry_in = Element::bit(Place::Flags, CARRY);
    let mut carried = 0;
    if name == "adc" || name == "sbb" {
        carried = i.read(carry_in);
        from.push(carry_in);
    }
    let adds = matches!(name.as_str(), "add" | "adc" | "inc");
    let (result, carry, overflow) = if adds {
        let result = a.wrapping_add(b).wrapping_add(carried) & ones;
        let carry = u128::from(a) + u128::from(b) + u128::from(carried) > u128::from(ones);
        (result, carry, (a ^ result) & (b ^ result))
    } else {
        let result = a.wrapping_sub(b).wrapping_sub(carried) & ones;
        (result, u128::from(a) < u128::from(b) + u128::from(carried), (a ^ b) & (a ^ result))
    };
    if name != "cmp" {
        i.write_general(to, Value::computed(result, from.as_slice()));
    }
    result_flags(i, &from, result, bits);
    flags(i, &from, &[(OVERFLOW, Some(overflow >> (bits - 1) & 1 == 1))]);
    if name != "inc" && name != "dec" {
        flags(i, &from, &[(CARRY, Some(carry))]);
    }
    Some(())
}

fn logic(i: &mut Instruction) -> Option<()> {
    let (mut from, a, b) = operands(i)?;
    let to = i.operand(0)?;
    let result = match i.name.as_str() {
        "or" => a | b,
        "xor" => a ^ b,
        _ => a & b,
    };
    // A register with itself is 0 and depends on nothing.
    if i.name == "xor" && from.len() == 2 && from[0] == from[1] {
        from.clear();
    }
    if i.name != "test" {
        i.write_general(to, Value::computed(result, from.as_slice()));
    }
    result_flags(i, &from, result, 8 * to.bytes);
    flags(i, &[], &[(CARRY, Some(false)), (OVERFLOW, Some(false))]);
    Some(())
}

/// Of two operands, or of the last two of three, one of which may be immediate.
fn multiply(i: &mut Instruction) -> Option<()> {
    let to = i.operand(0)?;
    let bits = 8 * to.bytes;
    let signed = |bits_of: u64| i128::from((bits_of << (64 - bits)) as i64 >> (64 - bits));
    let (from, a, b) = match i.immediate() {
        Some(immediate) => {
            let a = i.operand(1)?.whole();
            (vec![a], i.read(a), immediate)
        }
        None => operands(i)?,
    };
    let product = signed(a) * signed(b);
    let overflows = product != signed(product as u64);
    i.write_general(to, Value::computed(product as u64, from.as_slice()));
    flags(i, &from, &[(CARRY, Some(overflows)), (OVERFLOW, Some(overflows))]);
    flags(i, &[], &[(ZERO, None), (SIGN, None), (PARITY, None)]);
    Some(())
}

/// By an immediate operand.
fn shift(i: &mut Instruction) -> Option<()> {
    let (from, a, count) = operands(i)?;
    let to = i.operand(0)?;
    let bits = 8 * to.bytes;
    let count = i.immediate().and(Some(count))? as u32 & if bits == 64 { 63 } else { 31 };
    if bits < 32 {
        return None;
    }
    if count == 0 {
        i.write_general(to, Value::copy(to.whole()));
        return Some(());
    }
    let top = |bits_of: u64| bits_of >> (bits - 1) & 1 == 1;
    let (result, carry, overflow) = if i.name == "shl" {
        let (result, carry) = (a << count & u64::MAX >> (64 - bits), a >> (bits - count) & 1 == 1);
        (result, carry, top(result) != carry)
    } else {
        (a >> count, a >> (count - 1) & 1 == 1, top(a))
    };
    i.write_general(to, Value::computed(result, from.as_slice()));
    result_flags(i, &from, result, bits);
    flags(i, &from, &[(CARRY, Some(carry)), (OVERFLOW, (count == 1).then_some(overflow))]);
    Some(())
}

/// Shifts that leave the flags alone, and `bzhi`, which keeps the bits below a number of them.
fn by_register(i: &mut Instruction) -> Option<()> {
    let (to, from, count) = (i.operand(0)?, i.operand(1)?.whole(), i.operand(2)?.whole());
    let (bits, a) = (8 * to.bytes, i.read(from));
    let number = i.read(count) as u32;
    let shift = number & (bits - 1);
    let result = match i.name.as_str() {
        "shlx" => a << shift & u64::MAX >> (64 - bits),
        "shrx" => a >> shift,
        _ if number & 0xff < bits => a & !(u64::MAX << (number & 0xff)),
        _ => a,
    };
    i.write_general(to, Value::computed(result, [from, count]));
    if i.name == "bzhi" {
        let sign = result >> (bits - 1) & 1 == 1;
        let carry = number & 0xff >= bits;
        flags(i, &[from, count], &[(ZERO, Some(result == 0)), (SIGN, Some(sign)), (CARRY, Some(carry))]);
        flags(i, &[], &[(OVERFLOW, Some(false)), (PARITY, None)]);
    }
    Some(())
}

/// `bsf`, and `bsr`, which looks for the highest bit. Of 0 there is none: the zero flag says so, and the register stays, as
/// AMD promises and Intel's do.
fn outermost_bit(i: &mut Instruction) -> Option<()> {
    let lowest = i.name == "bsf";
    let (to, from) = (i.operand(0)?, i.operand(1)?.whole());
    let a = i.read(from);
    if a != 0 {
        let number = if lowest { a.trailing_zeros() } else { a.ilog2() };
        i.write_general(to, Value::computed(number.into(), [from]));
    }
    flags(i, &[from], &[(ZERO, Some(a == 0))]);
    flags(i, &[], &[(CARRY, None), (SIGN, None), (PARITY, None), (OVERFLOW, None)]);
    Some(())
}

fn count_bits(i: &mut Instruction) -> Option<()> {
    let (to, from) = (i.operand(0)?, i.operand(1)?.whole());
    let a = i.read(from);
    i.write_general(to, Value::computed(a.count_ones().into(), [from]));
    flags(i, &[from], &[(ZERO, Some(a == 0))]);
    let zero = Some(false);
    flags(i, &[], &[(CARRY, zero), (SIGN, zero), (PARITY, zero), (OVERFLOW, zero)]);
    Some(())
}

/// The carry becomes a bit of a register, which `btr` clears there and `bts` sets.
fn test_bit(i: &mut Instruction) -> Option<()> {
    let (from, a, b) = operands(i)?;
    let to = i.operand(0)?;
    if to.is_memory() {
        return None;
    }
    let bit = 1 << (b & u64::from(8 * to.bytes - 1));
    match i.name.as_str() {
        "btr" => i.write_general(to, Value::computed(a & !bit, from.as_slice())),
        "bts" => i.write_general(to, Value::computed(a | bit, from.as_slice())),
        _ => {}
    }
    flags(i, &from, &[(CARRY, Some(a & bit != 0))]);
    flags(i, &[], &[(SIGN, None), (PARITY, None), (OVERFLOW, None)]);
    Some(())
}

fn address(i: &mut Instruction) -> Option<()> {
    let raw = i.raw;
    // iced resolves what is relative to the next instruction.
    let mut address = raw.memory_displacement64();
    let mut from = Vec::new();
    for (part, scale) in [(raw.memory_base(), 1), (raw.memory_index(), raw.memory_index_scale())] {
        if part != Register::None && part != Register::RIP {
            let element = register(part)?.whole();
            address = address.wrapping_add(i.read(element).wrapping_mul(scale.into()));
            from.push(element);
        }
    }
    let to = i.operand(0)?;
    i.write_general(to, Value::computed(address, from));
    Some(())
}

fn stack(i: &mut Instruction) -> Option<()> {
    let pointer = Element::new(STACK, 0, 8);
    let top = i.memory(8).whole();
    let moved = |i: &mut Instruction, by: i64| {
        i.write(pointer, Value::computed(i.read(pointer).wrapping_add_signed(by), [pointer]));
    };
    match i.name.as_str() {
        "push" => {
            let from = i.operand(0)?.whole();
            moved(i, -8);
            i.write(top, Value::copy(from));
        }
        "call" => {
            let next = i.raw.next_ip();
            moved(i, -8);
            i.write(top, Value::computed(next, []));
            jump(i, Value::computed(i.raw.near_branch_target(), []));
        }
        "pop" => {
            moved(i, 8);
            i.write(i.operand(0)?.whole(), Value::copy(top));
        }
        _ => {
            moved(i, 8);
            jump(i, Value::copy(top));
        }
    }
    Some(())
}

fn jump(i: &mut Instruction, to: Value) {
    i.write(Element::new(Place::Next, 0, 8), to);
}

/// Jumps and copies that depend on flags.
fn conditional(i: &mut Instruction, name: &str, condition: ConditionCode) -> Option<()> {
    let read = [CARRY, PARITY, ZERO, SIGN, OVERFLOW].map(|flag| Element::bit(Place::Flags, flag));
    let [carry, parity, zero, sign, overflow] = read.map(|flag| i.read(flag) == 1);
    let [c, p, z, s, o] = read;
    let (met, by) = match condition {
        ConditionCode::o | ConditionCode::no => (overflow, vec![o]),
        ConditionCode::b | ConditionCode::ae => (carry, vec![c]),
        ConditionCode::e | ConditionCode::ne => (zero, vec![z]),
        ConditionCode::be | ConditionCode::a => (carry || zero, vec![c, z]),
        ConditionCode::s | ConditionCode::ns => (sign, vec![s]),
        ConditionCode::p | ConditionCode::np => (parity, vec![p]),
        ConditionCode::l | ConditionCode::ge => (sign != overflow, vec![s, o]),
        ConditionCode::le | ConditionCode::g => (zero || sign != overflow, vec![z, s, o]),
        ConditionCode::None => return None,
    };
    // The second of each pair is the first one's contrary, and has an odd number.
    let met = met != ((condition as u32 - ConditionCode::o as u32) % 2 == 1);
    let decided = |value: Value| by.iter().fold(value, |value, &flag| value.by(flag));
    if name.starts_with('j') {
        let next = if met { i.raw.near_branch_target() } else { i.raw.next_ip() };
        jump(i, decided(Value::computed(next, [])));
        return Some(());
    }
    let to = i.operand(0)?;
    let from = if met { i.operand(1)? } else { to };
    // Whether or not it copies, it zeroes the upper half.
    name.starts_with("cmov").then(|| i.write_general(to, decided(Value::copy(from.whole()))))
}

/// Between a mask and a general register; what is beyond the bits that are copied becomes 0.
fn move_mask(i: &mut Instruction) -> Option<()> {
    let bytes = if i.name == "kmovq" { 8 } else { 2 };
    let (to, from): (Operand, Operand) = (i.operand(0)?, i.operand(1)?);
    if to.is_memory() || from.is_memory() {
        return None;
    }
    let element = from.element(0, bytes);
    i.write(to.element(0, 8), Value::computed(i.read(element), [element]));
    Some(())
}
