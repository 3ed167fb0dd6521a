//! Instructions on general registers, masks and flags, and jumps: which elements they read and
//! write.
//!
//! The model takes the results of these instructions from the CPU.

use iced_x86::{FlowControl, InstructionInfoFactory, Mnemonic, OpAccess, OpKind, RflagsBits};

use super::instruction::{Instruction, Operand, Value, register};
use super::{Element, Place, What};

/// The flags, and their bit numbers in the flags register. The adjust flag is left out, since the
/// kernels never use it.
const FLAGS: [(u32, u32); 5] =
    [(RflagsBits::CF, 0), (RflagsBits::PF, 2), (RflagsBits::ZF, 6), (RflagsBits::SF, 7), (RflagsBits::OF, 11)];

/// Makes the operations; None if the instruction is not one of this file's.
pub(super) fn model(i: &mut Instruction) -> Option<()> {
    let raw = i.raw;
    let mut factory = InstructionInfoFactory::new();
    let info = factory.info(&raw);
    if info.used_registers().iter().any(|used| used.register().is_vector_register()) || raw.is_invalid() {
        return None;
    }
    let operands = (0..raw.op_count()).filter(|&number| raw.op_kind(number) == OpKind::Register);
    let registers = operands.filter_map(|number| Some((register(raw.op_register(number))?, info.op_access(number))));
    let memory = info.used_memory().iter().map(|used| (i.memory(used.memory_size().size() as u32), used.access()));
    let all: Vec<(Operand, OpAccess)> = registers.chain(memory).collect();
    let reads = |access| !matches!(access, OpAccess::Write | OpAccess::NoMemAccess | OpAccess::None);
    let writes = |access| !matches!(access, OpAccess::Read | OpAccess::NoMemAccess | OpAccess::None);
    let mut read: Vec<Element> =
        all.iter().filter(|(_, access)| reads(*access)).map(|(operand, _)| operand.whole()).collect();
    if raw.mnemonic() == Mnemonic::Lea {
        read.extend([raw.memory_base(), raw.memory_index()].into_iter().filter_map(register).map(Operand::whole));
    }
    let of = |flags: u32| FLAGS.into_iter().filter(move |(flag, _)| flags & flag != 0);
    let by: Vec<_> = of(raw.rflags_read()).map(|(_, bit)| Element::bit(Place::Flags, bit)).collect();
    let value = |what, from: &[Element]| by.iter().fold(Value::of(what, from), |value, &flag| value.by(flag));
    // Moves are copies of numbers, so that exact values move with them.
    let moves = matches!(raw.mnemonic(), Mnemonic::Mov | Mnemonic::Push | Mnemonic::Pop) && !read.is_empty();
    for &(to, _) in all.iter().filter(|(_, access)| writes(*access)) {
        i.write_general(to, value(if moves { What::Copy } else { What::Found }, &read));
    }
    for (_, bit) in of(raw.rflags_modified()) {
        i.write(Element::bit(Place::Flags, bit), value(What::Found, &read));
    }
    if raw.is_stack_instruction() {
        let pointer = Element::new(Place::General(4), 0, 8);
        i.write(pointer, Value::of(What::Found, [pointer]));
    }
    if raw.flow_control() != FlowControl::Next {
        i.write(Element::new(Place::Next, 0, 8), value(What::Found, &read));
    }
    Some(())
}
