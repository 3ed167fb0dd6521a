//! An instruction while its model is made: its operands as elements, and the operations so far.

use iced_x86::{EncodingKind, OpKind, Register};

use super::{Element, Operation, Place, Unknown, What, check, decode};
use crate::kernels::step::Step;

/// Bytes of what legacy and VEX instructions call a vector of 128 bits; what a write to it does beyond depends on which.
const XMM: u32 = 16;
/// Bytes of a vector register.
const ZMM: u32 = 64;

/// An instruction on its way into operations.
pub(super) struct Instruction<'a> {
    pub raw: iced_x86::Instruction,
    /// Its mnemonic, without the v of VEX and EVEX.
    pub name: String,
    step: &'a Step<'a>,
    operations: Vec<Operation>,
}

/// A register or memory.
#[derive(Clone, Copy, Debug)]
pub(super) struct Operand {
    pub place: Place,
    /// The first of its bits there.
    pub at: u64,
    pub bytes: u32,
    /// Whether all its elements are the first one (EVEX's embedded broadcast).
    repeats: bool,
}

impl Operand {
    /// The element `index` of those of `bytes` bytes.
    pub fn element(self, index: u32, bytes: u32) -> Element {
        let index = if self.repeats { 0 } else { index };
        Element { place: self.place, at: self.at + 8 * u64::from(index * bytes), bits: 8 * bytes }
    }

    /// The byte `byte` and those behind it.
    pub fn bytes_from(self, byte: u32, bytes: u32) -> Element {
        Element { place: self.place, at: self.at + 8 * u64::from(byte), bits: 8 * bytes }
    }

    /// All of it, if it has no more than 64 bits.
    pub fn whole(self) -> Element {
        self.element(0, self.bytes.min(8))
    }

    pub fn is_vector(self) -> bool {
        matches!(self.place, Place::Vector(_))
    }

    pub fn is_memory(self) -> bool {
        self.place == Place::Memory
    }
}

/// What an element becomes.
#[derive(Clone, Debug)]
pub(super) struct Value {
    what: What,
    from: Vec<Element>,
    by: Vec<Element>,
}

impl Value {
    pub fn of(what: What, from: impl Into<Vec<Element>>) -> Self {
        Value { what, from: from.into(), by: Vec::new() }
    }

    pub fn computed(bits: u64, from: impl Into<Vec<Element>>) -> Self {
        Value::of(What::Computed(bits), from)
    }

    pub fn copy(from: Element) -> Self {
        Value::of(What::Copy, [from])
    }

    pub fn zero() -> Self {
        Value::computed(0, [])
    }

    /// The same, as that element decided.
    pub fn by(mut self, decided: Element) -> Self {
        self.by.push(decided);
        self
    }
}

impl<'a> Instruction<'a> {
    pub fn new(step: &'a Step<'a>) -> Self {
        let raw = decode(step);
        let mnemonic = format!("{:?}", raw.mnemonic()).to_lowercase();
        let name = match raw.encoding() {
            EncodingKind::VEX | EncodingKind::EVEX => mnemonic.strip_prefix('v').unwrap_or(&mnemonic).into(),
            _ => mnemonic,
        };
        Instruction { raw, name, step, operations: Vec::new() }
    }

    /// The operations, of which all memory was recorded, and the address of the next instruction if nothing else is.
    pub fn finish(mut self) -> Result<Vec<Operation>, Unknown> {
        if !self.operations.iter().any(|operation| operation.to.place == Place::Next) {
            let next = self.raw.next_ip();
            self.write(Element::new(Place::Next, 0, 8), Value::computed(next, []));
        }
        let recorded = |element: &Element| {
            element.place != Place::Memory
                || self.step.touched.is_some_and(|touched| {
                    let from = 8 * touched.address;
                    from <= element.at && element.end() <= from + 8 * u64::from(touched.bytes)
                })
        };
        let all = self.operations.iter().all(|o| recorded(&o.to) && o.sources().all(recorded));
        if all { Ok(self.operations) } else { Err(Unknown::Memory) }
    }

    /// Whether it says what becomes of all 512 bits of a vector register that it writes, and what of a scalar's neighbours.
    pub fn is_vex(&self) -> bool {
        self.raw.encoding() != EncodingKind::Legacy
    }

    /// Operands without the immediate one.
    pub fn operands(&self) -> u32 {
        (0..self.raw.op_count()).filter(|&i| matches!(self.raw.op_kind(i), OpKind::Register | OpKind::Memory)).count()
            as u32
    }

    /// The last operand, if it is an immediate one.
    pub fn immediate(&self) -> Option<u64> {
        let last = self.raw.op_count().checked_sub(1)?;
        self.raw.try_immediate(last).ok()
    }

    /// The operand `index`. Memory is at the address that was recorded, or at 0 for [`Instruction::finish`] to refuse.
    pub fn operand(&self, index: u32) -> Option<Operand> {
        match self.raw.op_kind(index) {
            OpKind::Register => register(self.raw.op_register(index)),
            OpKind::Memory => {
                let repeats = self.raw.is_broadcast();
                let bytes = if repeats { ZMM } else { self.raw.memory_size().size() as u32 };
                Some(Operand { repeats, ..self.memory(bytes) })
            }
            _ => None,
        }
    }

    pub fn memory(&self, bytes: u32) -> Operand {
        let address = self.step.touched.map_or(0, |touched| touched.address);
        Operand { place: Place::Memory, at: 8 * address, bytes, repeats: false }
    }

    /// The last source: of two operands or three the last that is not an immediate one.
    pub fn last(&self) -> Option<Operand> {
        self.operand(self.operands().checked_sub(1)?)
    }

    /// The source before the last, which legacy instructions also write.
    pub fn first(&self) -> Option<Operand> {
        self.operand(self.operands().checked_sub(2)?)
    }

    /// What the instruction finds.
    pub fn read(&self, element: Element) -> u64 {
        check::before(self.step, element)
    }

    pub fn write(&mut self, to: Element, value: Value) {
        let Value { what, from, by } = value;
        self.operations.push(Operation { to, what, from, by });
    }

    /// Writes all of the first operand in elements of `bytes` bytes, and what is to become of its register beyond them.
    pub fn each(&mut self, bytes: u32, value: impl Fn(&Self, u32) -> Value) -> Option<()> {
        let to = self.operand(0)?;
        self.lanes(to, bytes, to.bytes / bytes, value);
        self.zero_beyond(to, to.bytes);
        Some(())
    }

    /// Writes a bit of the first operand, a mask, for each of so many lanes: 0 where the instruction's own mask does not select
    /// it, and beyond them.
    pub fn each_bit(&mut self, lanes: u32, value: impl Fn(&Self, u32) -> Value) -> Option<()> {
        let to = self.operand(0)?.place;
        for lane in 0..lanes {
            let value = match self.selected(lane) {
                None => value(self, lane),
                Some((true, bit)) => value(self, lane).by(bit),
                Some((false, bit)) => Value::zero().by(bit),
            };
            self.write(Element::bit(to, lane), value);
        }
        self.write(Element { place: to, at: lanes.into(), bits: 64 - lanes }, Value::zero());
        Some(())
    }

    /// Writes the first `lanes` elements of `to`, where the instruction's mask selects them. Others become 0 or, as their
    /// bit decides too, stay.
    pub fn lanes(&mut self, to: Operand, bytes: u32, lanes: u32, value: impl Fn(&Self, u32) -> Value) {
        for lane in 0..lanes {
            let element = to.element(lane, bytes);
            let value = match self.selected(lane) {
                None => value(self, lane),
                Some((true, bit)) => value(self, lane).by(bit),
                Some((false, bit)) if self.raw.zeroing_masking() => Value::zero().by(bit),
                Some((false, _)) if to.is_memory() => continue,
                Some((false, bit)) => Value::copy(element).by(bit),
            };
            self.write(element, value);
        }
    }

    /// Whether the mask selects a lane, and the bit that says so; None without a mask.
    pub fn selected(&self, lane: u32) -> Option<(bool, Element)> {
        if !self.raw.has_op_mask() {
            return None;
        }
        let bit = Element::bit(register(self.raw.op_mask())?.place, lane);
        Some((self.read(bit) == 1, bit))
    }

    /// Whether elements can be taken together, since no mask selects among them and none is repeated.
    pub fn is_plain(&self) -> bool {
        !self.raw.has_op_mask() && !self.raw.is_broadcast()
    }

    /// Zeroes bytes of a place.
    pub fn zero(&mut self, to: Operand, from: u32, end: u32) {
        let mut byte = from;
        while byte < end {
            let bytes = if byte.is_multiple_of(8) { 8 } else { 4 };
            self.write(to.bytes_from(byte, bytes), Value::zero());
            byte += bytes;
        }
    }

    /// What follows the `written` bytes of a vector register: VEX and EVEX make it 0, legacy instructions keep it.
    pub fn zero_beyond(&mut self, to: Operand, written: u32) {
        if to.is_vector() && self.is_vex() {
            self.zero(to, written, ZMM);
        }
    }

    /// What follows the scalar of `bytes` bytes in the first operand: VEX takes it from `first`, legacy instructions keep it.
    pub fn scalar_beyond(&mut self, bytes: u32) -> Option<()> {
        if self.is_vex() {
            let (to, first) = (self.operand(0)?, self.first()?);
            if bytes == 4 {
                self.write(to.element(1, 4), Value::copy(first.element(1, 4)));
            }
            self.write(to.element(1, 8), Value::copy(first.element(1, 8)));
            self.zero_beyond(to, XMM);
        }
        Some(())
    }

    /// What follows `written` bytes of a load into a vector register: 0 in its first 128 bits, then as ever.
    pub fn load_beyond(&mut self, to: Operand, written: u32) {
        self.zero(to, written, XMM);
        self.zero_beyond(to, XMM);
    }

    /// Writes a general register, whose upper half a write of 32 bits zeroes, or memory.
    pub fn write_general(&mut self, to: Operand, value: Value) {
        self.write(to.whole(), value);
        if to.bytes == 4 && matches!(to.place, Place::General(_)) {
            self.write(to.bytes_from(4, 4), Value::zero());
        }
    }
}

/// A register as an operand; None for those that kernels have not.
pub(super) fn register(register: Register) -> Option<Operand> {
    let number = register.full_register().number() as u8;
    let place = match register {
        _ if register.is_gpr() => Place::General(number),
        _ if register.is_vector_register() => Place::Vector(number),
        _ if register.is_k() => Place::Mask(register.number() as u8),
        _ => return None,
    };
    let second_byte = matches!(register, Register::AH | Register::CH | Register::DH | Register::BH);
    Some(Operand { place, at: 8 * u64::from(second_byte), bytes: register.size() as u32, repeats: false })
}
