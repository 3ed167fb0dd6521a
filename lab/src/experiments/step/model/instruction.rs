//! An instruction during its translation to operations: its operands, and the operations so far.

use iced_x86::{EncodingKind, OpKind, Register};

use super::{Alternative, Element, Operation, Place, Unknown, What, check, decode};
use rayo::internals::kernels::step::Step;

/// The bytes of a 128-bit vector. Whether a write to it zeroes or keeps the rest of the register
/// depends on the encoding, VEX or legacy.
const XMM: u32 = 16;
/// The bytes of a whole vector register.
const ZMM: u32 = 64;

/// An instruction that is being translated to operations.
pub(super) struct Instruction<'a> {
    pub raw: iced_x86::Instruction,
    /// The mnemonic, without the leading v of VEX and EVEX.
    pub name: String,
    step: &'a Step<'a>,
    operations: Vec<Operation>,
}

/// An operand in a register or in memory.
#[derive(Clone, Copy, Debug)]
pub(super) struct Operand {
    pub place: Place,
    /// The number of the operand's first bit in its place.
    pub at: u64,
    pub bytes: u32,
    /// Whether its first element is used for all elements (EVEX's embedded broadcast).
    repeats: bool,
}

impl Operand {
    /// The element with this index, where elements have `bytes` bytes.
    pub fn element(self, index: u32, bytes: u32) -> Element {
        let index = if self.repeats { 0 } else { index };
        Element { place: self.place, at: self.at + 8 * u64::from(index * bytes), bits: 8 * bytes }
    }

    /// The element of `bytes` bytes that begins at the operand's byte `byte`.
    pub fn bytes_from(self, byte: u32, bytes: u32) -> Element {
        Element { place: self.place, at: self.at + 8 * u64::from(byte), bits: 8 * bytes }
    }

    /// The operand as one element: all of it, or its first 64 bits.
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

/// The new value of an element.
#[derive(Clone, Debug)]
pub(super) struct Value {
    what: What,
    from: Vec<Element>,
    by: Vec<Element>,
    otherwise: Option<Alternative>,
}

impl Value {
    pub fn of(what: What, from: impl Into<Vec<Element>>) -> Self {
        Value { what, from: from.into(), by: Vec::new(), otherwise: None }
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

    /// Adds an element that decided which operands this value is made of.
    pub fn by(mut self, decided: Element) -> Self {
        self.by.push(decided);
        self
    }

    /// This value, selected by the bit `decided`, whose other value would have selected `other`.
    pub fn instead_of(self, other: Value, decided: Element) -> Self {
        let otherwise = Some(Alternative { what: other.what, from: other.from });
        Value { otherwise, ..self.by(decided) }
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

    /// Checks that all memory that the operations use was recorded, and returns them. If none
    /// writes the instruction pointer, its advance to the next instruction is added.
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

    /// Whether the encoding is VEX or EVEX. Instructions so encoded define all 512 bits of a vector
    /// register that they write, also those beside a scalar.
    pub fn is_vex(&self) -> bool {
        self.raw.encoding() != EncodingKind::Legacy
    }

    /// The number of operands, without the immediate one.
    pub fn operands(&self) -> u32 {
        (0..self.raw.op_count()).filter(|&i| matches!(self.raw.op_kind(i), OpKind::Register | OpKind::Memory)).count()
            as u32
    }

    /// The value of the last operand, if it is immediate.
    pub fn immediate(&self) -> Option<u64> {
        let last = self.raw.op_count().checked_sub(1)?;
        self.raw.try_immediate(last).ok()
    }

    /// The operand with this index. Memory is at its recorded address; without a record it is at 0,
    /// which [`Instruction::finish`] refuses.
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

    /// The last source operand, which is the last operand that is not immediate.
    pub fn last(&self) -> Option<Operand> {
        self.operand(self.operands().checked_sub(1)?)
    }

    /// The source operand before the last. In legacy encoding it is the destination too.
    pub fn first(&self) -> Option<Operand> {
        self.operand(self.operands().checked_sub(2)?)
    }

    /// The bits of an element before the instruction.
    pub fn read(&self, element: Element) -> u64 {
        check::before(self.step, element)
    }

    pub fn write(&mut self, to: Element, value: Value) {
        let Value { what, from, by, otherwise } = value;
        self.operations.push(Operation { to, what, from, by, otherwise });
    }

    /// Writes the whole first operand in elements of `bytes` bytes, and zeroes or keeps the rest of
    /// its register.
    pub fn each(&mut self, bytes: u32, value: impl Fn(&Self, u32) -> Value) -> Option<()> {
        let to = self.operand(0)?;
        self.lanes(to, bytes, to.bytes / bytes, value);
        self.zero_beyond(to, to.bytes);
        Some(())
    }

    /// Writes one bit per lane to the first operand, a mask register. Bits that the instruction's
    /// own mask does not select become 0, as do those beyond the lanes.
    pub fn each_bit(&mut self, lanes: u32, value: impl Fn(&Self, u32) -> Value) -> Option<()> {
        let to = self.operand(0)?.place;
        for lane in 0..lanes {
            let value = match self.selected(lane) {
                None => value(self, lane),
                Some((true, bit)) => value(self, lane).instead_of(Value::zero(), bit),
                Some((false, bit)) => Value::zero().instead_of(value(self, lane), bit),
            };
            self.write(Element::bit(to, lane), value);
        }
        self.write(Element { place: to, at: lanes.into(), bits: 64 - lanes }, Value::zero());
        Some(())
    }

    /// Writes those of the first `lanes` elements of `to` that the instruction's mask selects. The
    /// others become 0 or, if the instruction merges, keep their values.
    pub fn lanes(&mut self, to: Operand, bytes: u32, lanes: u32, value: impl Fn(&Self, u32) -> Value) {
        for lane in 0..lanes {
            let element = to.element(lane, bytes);
            let kept = if self.raw.zeroing_masking() { Value::zero() } else { Value::copy(element) };
            let value = match self.selected(lane) {
                None => value(self, lane),
                Some((true, bit)) => value(self, lane).instead_of(kept, bit),
                Some((false, _)) if to.is_memory() => continue,
                Some((false, bit)) => kept.instead_of(value(self, lane), bit),
            };
            self.write(element, value);
        }
    }

    /// Whether the mask selects a lane, and the mask's bit for it; None without a mask.
    pub fn selected(&self, lane: u32) -> Option<(bool, Element)> {
        if !self.raw.has_op_mask() {
            return None;
        }
        let bit = Element::bit(register(self.raw.op_mask())?.place, lane);
        Some((self.read(bit) == 1, bit))
    }

    /// Whether several elements can be copied as one: no mask selects among them, and none is
    /// broadcast.
    pub fn is_plain(&self) -> bool {
        !self.raw.has_op_mask() && !self.raw.is_broadcast()
    }

    /// Zeroes the bytes `from..end` of an operand's place.
    pub fn zero(&mut self, to: Operand, from: u32, end: u32) {
        let mut byte = from;
        while byte < end {
            let bytes = if byte.is_multiple_of(8) { 8 } else { 4 };
            self.write(to.bytes_from(byte, bytes), Value::zero());
            byte += bytes;
        }
    }

    /// Defines the bytes of a vector register after the first `written`: VEX and EVEX zero them,
    /// legacy encoding keeps them.
    pub fn zero_beyond(&mut self, to: Operand, written: u32) {
        if to.is_vector() && self.is_vex() {
            self.zero(to, written, ZMM);
        }
    }

    /// Defines what follows a scalar of `bytes` bytes in the first operand: VEX copies it from
    /// `first`, legacy encoding keeps it.
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

    /// Defines what follows `written` bytes that were loaded into a vector register: zeros up to
    /// 128 bits, and beyond these as [`Self::zero_beyond`].
    pub fn load_beyond(&mut self, to: Operand, written: u32) {
        self.zero(to, written, XMM);
        self.zero_beyond(to, XMM);
    }

    /// Writes to memory or to a general register. A write of 32 bits zeroes the upper half of the
    /// register.
    pub fn write_general(&mut self, to: Operand, value: Value) {
        self.write(to.whole(), value);
        if to.bytes == 4 && matches!(to.place, Place::General(_)) {
            self.write(to.bytes_from(4, 4), Value::zero());
        }
    }
}

/// A register as an operand; None if it is no general, vector or mask register.
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
