//! Instructions of built code, decoded and counted: those of a symbol in an object file, or of a
//! function in this process.

use std::collections::HashMap;
use std::ops::Range;

use iced_x86::{
    Decoder, DecoderOptions, FlowControl, Formatter, InstructionInfoFactory, IntelFormatter, MemorySizeOptions,
    Mnemonic, OpAccess, OpKind,
};
use object::{Object, ObjectSection, ObjectSymbol, SectionIndex, SymbolKind};
use serde::{Deserialize, Serialize};

use rayo::internals::kernels;

/// What an instruction does. Arithmetic may also read an operand from memory; see
/// [`Instruction::reads`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Class {
    /// Computes, compares or converts.
    Arithmetic,
    /// Moves elements within registers.
    Shuffle,
    /// Copies from memory to a register.
    Load,
    /// Copies from a register to memory.
    Store,
    /// Jumps, calls and returns.
    Branch,
    /// Copies from register to register.
    Move,
    /// Does not touch data: `endbr64`, `nop`, `vzeroupper`.
    Other,
}

/// The kind of operands that an instruction has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Width {
    /// General registers.
    General,
    /// One element of a vector register.
    Scalar,
    /// All elements of a vector register.
    Packed,
}

#[derive(Clone, Debug)]
pub struct Instruction {
    /// Bytes from the beginning of its function.
    pub offset: usize,
    pub bytes: usize,
    /// The instruction as text, in Intel's syntax.
    pub text: String,
    pub class: Class,
    /// The kind of its operands.
    pub width: Width,
    pub reads: bool,
    /// The target of its jump, in bytes from the beginning of the function. None for a call, whose
    /// target is in the text.
    pub target: Option<usize>,
    /// The CPUID features that the instruction needs, as Intel's manual names them.
    pub features: Vec<String>,
}

/// A function of an object, without its code.
#[derive(Clone, Debug, Serialize)]
pub struct Function {
    /// The name of the object, which is that of its source.
    pub object: &'static str,
    pub symbol: String,
    pub bytes: usize,
}

/// The functions of all objects that build.rs makes, object by object, sorted by address.
pub fn functions() -> Vec<Function> {
    let of_object = |(object, data): &(&'static str, &'static [u8])| {
        let Ok(file) = object::File::parse(*data) else { return Vec::new() };
        let functions = code_ranges(&file).into_iter();
        functions.map(|place| Function { object, symbol: place.symbol.to_owned(), bytes: place.bytes.len() }).collect()
    };
    kernels::OBJECTS.iter().flat_map(of_object).collect()
}

/// Where the code of a function is in an object file.
struct CodeRange<'a> {
    symbol: &'a str,
    section: SectionIndex,
    /// Offsets from the beginning of the section.
    bytes: Range<usize>,
    /// Whether the symbol table gives the function's length.
    has_size: bool,
}

/// The functions of an object, sorted by address. ELF may give the length of a function. Without
/// that, a function ends at its label `.end`, which functions in assembly have, or else where the
/// next one begins, padding included.
fn code_ranges<'a>(file: &object::File<'a>) -> Vec<CodeRange<'a>> {
    let is_elf = file.format() == object::BinaryFormat::Elf;
    let mut ends = HashMap::new();
    let mut places: Vec<_> = Vec::new();
    for symbol in file.symbols().filter(|symbol| symbol.is_definition()) {
        let (Ok(name), Some(index)) = (symbol.name(), symbol.section_index()) else { continue };
        let Ok(section) = file.section_by_index(index) else { continue };
        let start = (symbol.address() - section.address()) as usize;
        let end = start + symbol.size() as usize;
        let is_exported = symbol.is_global() && section.kind() == object::SectionKind::Text;
        // Functions that people write by hand often have no size.
        let has_size = is_elf && symbol.size() > 0;
        let is_function = if has_size { symbol.kind() == SymbolKind::Text } else { is_exported };
        if is_function {
            let end = if has_size { end } else { section.size() as usize };
            places.push(CodeRange { symbol: undecorated(file, name), section: index, bytes: start..end, has_size });
        } else if let Some(of) = name.strip_suffix(".end") {
            ends.insert(of, start);
        }
    }
    places.sort_by_key(|place| (place.section.0, place.bytes.start));
    let next: Vec<_> = places.iter().skip(1).map(|next| Some((next.section, next.bytes.start))).chain([None]).collect();
    for (place, next) in places.iter_mut().zip(next).filter(|(place, _)| !place.has_size) {
        let next = next.filter(|(section, _)| *section == place.section).map(|(_, start)| start);
        if let Some(end) = ends.get(place.symbol).copied().or(next) {
            place.bytes.end = end;
        }
    }
    places
}

/// A symbol as its source has it: without the _ that begins names in Mach-O, or the prefix of local
/// labels in ELF that `asm/include/isa.inc` defines.
fn undecorated<'a>(file: &object::File<'_>, symbol: &'a str) -> &'a str {
    let prefix = if file.format() == object::BinaryFormat::MachO { "_" } else { ".L" };
    symbol.strip_prefix(prefix).unwrap_or(symbol)
}

/// The instructions of a function.
#[derive(Clone, Debug)]
pub struct Code {
    pub symbol: String,
    /// The instructions, sorted by address.
    pub instructions: Vec<Instruction>,
    /// The bytes between the labels `.body` and `.body_end`, if the function has them.
    pub body: Option<Range<usize>>,
}

/// The number of instructions of each kind.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize, Serialize)]
pub struct Mix {
    /// The number of all instructions.
    pub instructions: usize,
    pub bytes: usize,
    /// Of [`Class::Arithmetic`].
    pub arithmetic: usize,
    /// Of [`Class::Shuffle`].
    pub shuffle: usize,
    /// Of [`Class::Load`].
    pub load: usize,
    /// Of [`Class::Store`].
    pub store: usize,
    /// Of [`Class::Branch`].
    pub branch: usize,
    /// Of [`Class::Move`].
    pub r#move: usize,
    /// Of [`Class::Other`].
    pub other: usize,
    /// Of [`Width::Scalar`].
    pub scalar: usize,
    /// Of [`Width::Packed`].
    pub packed: usize,
    /// How many read memory: loads and others.
    pub reads: usize,
    /// The CPUID features that the instructions need, sorted.
    pub features: Vec<String>,
}

impl Code {
    /// The function `symbol`, searched in all objects that build.rs makes.
    pub fn of_symbol(symbol: &str) -> Option<Code> {
        kernels::OBJECTS.iter().find_map(|(_, data)| Code::in_object(data, symbol))
    }

    /// The function `symbol` of the object `data`.
    pub fn in_object(data: &[u8], symbol: &str) -> Option<Code> {
        let file = object::File::parse(data).ok()?;
        let CodeRange { section, bytes: Range { start, end }, has_size, .. } =
            code_ranges(&file).into_iter().find(|of| of.symbol == symbol)?;
        let section = file.section_by_index(section).ok()?;
        let bytes = section.data().ok()?.get(start..end)?;
        let label = |name: &str| {
            let name = format!("{symbol}.{name}");
            let label = file.symbols().find(|s| s.name().is_ok_and(|label| undecorated(&file, label) == name))?;
            ((label.address() - section.address()) as usize).checked_sub(start)
        };
        let is_elf = file.format() == object::BinaryFormat::Elf;
        let instructions = if is_elf && !has_size { reached(bytes) } else { decode(bytes, 0).collect() };
        let mut code = Code {
            symbol: symbol.into(),
            instructions,
            body: label("body").zip(label("body_end")).map(|(start, end)| start..end),
        };
        // In an object file a target in another section has no address yet. Its relocation has its
        // name, or its offset in that section.
        for (at, relocation) in section.relocations() {
            let object::RelocationTarget::Symbol(target) = relocation.target() else { continue };
            let Ok(target) = file.symbol_by_index(target) else { continue };
            let Some(at) = (at as usize).checked_sub(start) else { continue };
            let hit = code.instructions.iter_mut().find(|i| (i.offset..i.offset + i.bytes).contains(&at));
            let Some(instruction) = hit else { continue };
            let name = match target.kind() {
                SymbolKind::Section => {
                    // The addend is relative to the relocated bytes, and a jump's target is
                    // relative to the end of the instruction.
                    let place = relocation.addend() + (instruction.offset + instruction.bytes - at) as i64;
                    let is_there = |s: &object::Symbol<'_, '_>| {
                        s.section_index() == target.section_index()
                            && s.address() as i64 == place
                            && s.kind() != SymbolKind::Section
                    };
                    file.symbols().find(is_there).and_then(|s| s.name().ok().map(str::to_owned))
                }
                _ => target.name().ok().map(str::to_owned),
            };
            let Some(name) = name.filter(|name| !name.is_empty()) else { continue };
            let name = undecorated(&file, &name);
            instruction.text = match (instruction.text.find('['), instruction.text.find(']')) {
                (Some(open), Some(close)) => {
                    format!("{}{name}{}", &instruction.text[..=open], &instruction.text[close..])
                }
                _ => format!("{} <{name}>", instruction.text.split(' ').next().unwrap_or_default()),
            };
        }
        Some(code)
    }

    /// The function of this process that begins at `address`; None if its code cannot be read. Its
    /// end is found by `reached`.
    pub fn of_function(symbol: &str, address: usize) -> Option<Code> {
        let instructions = reached(kernels::code_at(address)?);
        Some(Code { symbol: symbol.into(), instructions, body: None })
    }

    pub fn bytes(&self) -> usize {
        self.instructions.last().map_or(0, |last| last.offset + last.bytes)
    }

    /// The kinds of all instructions of the function.
    pub fn function(&self) -> Mix {
        Mix::of(&self.instructions)
    }

    /// The kinds of the instructions between the labels of the body, if there are any.
    pub fn body(&self) -> Option<Mix> {
        self.body_instructions().map(Mix::of)
    }

    /// The instructions between the labels of the body, if there are any.
    pub fn body_instructions(&self) -> Option<&[Instruction]> {
        let body = self.body.as_ref()?;
        let first = self.instructions.partition_point(|i| i.offset < body.start);
        let end = self.instructions.partition_point(|i| i.offset < body.end);
        Some(&self.instructions[first..end])
    }
}

impl Mix {
    /// Counts the kinds of `instructions`.
    pub fn of<'a>(instructions: impl IntoIterator<Item = &'a Instruction>) -> Mix {
        let mut mix = Mix::default();
        for i in instructions {
            mix.instructions += 1;
            mix.bytes += i.bytes;
            *match i.class {
                Class::Arithmetic => &mut mix.arithmetic,
                Class::Shuffle => &mut mix.shuffle,
                Class::Load => &mut mix.load,
                Class::Store => &mut mix.store,
                Class::Branch => &mut mix.branch,
                Class::Move => &mut mix.r#move,
                Class::Other => &mut mix.other,
            } += 1;
            mix.scalar += usize::from(i.width == Width::Scalar);
            mix.packed += usize::from(i.width == Width::Packed);
            mix.reads += usize::from(i.reads);
            mix.features.extend(i.features.iter().cloned());
        }
        mix.features.sort();
        mix.features.dedup();
        mix
    }
}

/// The instructions of a function of unknown length. It ends at the first instruction that does not
/// fall through and that no earlier jump passes over.
fn reached(bytes: &[u8]) -> Vec<Instruction> {
    let mut instructions = Vec::new();
    let mut furthest = 0;
    for Decoded { instruction, raw } in decode_raw(bytes, 0) {
        let end = instruction.offset + instruction.bytes;
        let ends = match raw.flow_control() {
            FlowControl::Return | FlowControl::Exception | FlowControl::IndirectBranch => true,
            FlowControl::UnconditionalBranch | FlowControl::ConditionalBranch => {
                let target = raw.near_branch_target() as usize;
                // A target far away is another function: the jump is a tail call.
                if target > instruction.offset && target < end + 4096 {
                    furthest = furthest.max(target);
                }
                raw.flow_control() == FlowControl::UnconditionalBranch
            }
            _ => false,
        };
        instructions.push(instruction);
        if ends && furthest < end {
            break;
        }
    }
    instructions
}

/// Decodes `bytes` as if they were at `address`.
pub fn decode(bytes: &[u8], address: u64) -> impl Iterator<Item = Instruction> {
    decode_raw(bytes, address).map(|decoded| decoded.instruction)
}

/// An instruction as [`decode`] describes it, and as the decoder returned it.
pub(super) struct Decoded {
    pub instruction: Instruction,
    pub raw: iced_x86::Instruction,
}

/// Decodes code that begins at `address`.
pub(super) fn decode_raw(bytes: &[u8], address: u64) -> impl Iterator<Item = Decoded> {
    let mut decoder = Decoder::with_ip(64, bytes, address, DecoderOptions::NONE);
    let mut info = InstructionInfoFactory::new();
    let mut formatter = IntelFormatter::new();
    formatter.options_mut().set_space_after_operand_separator(true);
    formatter.options_mut().set_branch_leading_zeros(false);
    formatter.options_mut().set_memory_size_options(MemorySizeOptions::Never); // the registers tell
    std::iter::from_fn(move || {
        let raw = decoder.can_decode().then(|| decoder.decode())?;
        let mut text = String::new();
        formatter.format(&raw, &mut text);
        let accesses: Vec<_> = info.info(&raw).used_memory().iter().map(|memory| memory.access()).collect();
        Some(Decoded { instruction: described(&raw, text, &accesses, address), raw })
    })
}

/// Describes an instruction with the text `text` and these memory accesses, in code that begins at
/// `address`.
fn described(raw: &iced_x86::Instruction, text: String, accesses: &[OpAccess], address: u64) -> Instruction {
    let is_both = |access: &OpAccess| matches!(access, OpAccess::ReadWrite | OpAccess::ReadCondWrite);
    let is_read = |access: &OpAccess| matches!(access, OpAccess::Read | OpAccess::CondRead) || is_both(access);
    let is_write = |access: &OpAccess| matches!(access, OpAccess::Write | OpAccess::CondWrite) || is_both(access);
    let reads = accesses.iter().any(is_read);
    let writes = accesses.iter().any(is_write);
    let jumps = matches!(raw.flow_control(), FlowControl::ConditionalBranch | FlowControl::UnconditionalBranch);
    let target = jumps.then(|| raw.near_branch_target().checked_sub(address)).flatten();
    let features = raw.cpuid_features().iter().map(|feature| format!("{feature:?}"));
    Instruction {
        offset: (raw.ip() - address) as usize,
        bytes: raw.len(),
        text,
        class: class(raw, reads, writes),
        width: width(raw),
        reads,
        target: target.map(|target| target as usize),
        features: features.collect(),
    }
}

/// The decoded instruction at an address of this process; None if the address has no readable code.
pub fn decode_raw_at(address: u64) -> Option<(Instruction, iced_x86::Instruction)> {
    let decoded = decode_raw(kernels::code_at(address as usize)?, address).next()?;
    Some((decoded.instruction, decoded.raw))
}

fn mnemonic(raw: &iced_x86::Instruction) -> String {
    let name = format!("{:?}", raw.mnemonic()).to_lowercase();
    // The VEX form of an instruction has the same name with a v in front.
    match raw.mnemonic() {
        Mnemonic::Verr | Mnemonic::Verw => name,
        _ => name.strip_prefix('v').map_or(name.clone(), str::to_owned),
    }
}

fn class(raw: &iced_x86::Instruction, reads: bool, writes: bool) -> Class {
    const SHUFFLES: [&str; 20] = [
        "shuf", "pshuf", "unpck", "punpck", "movhlps", "movlhps", "movshdup", "movsldup", "movddup", "insert",
        "extract", "pinsr", "pextr", "perm", "blend", "pblend", "align", "palign", "compress", "expand",
    ];
    let name = mnemonic(raw);
    if raw.flow_control() != FlowControl::Next {
        return Class::Branch;
    }
    if ["endbr64", "nop", "zeroupper", "zeroall", "int3"].contains(&name.as_str()) {
        return Class::Other;
    }
    if SHUFFLES.iter().any(|shuffle| name.starts_with(shuffle)) {
        return Class::Shuffle;
    }
    // `cmov` and `movmsk` count as computing; `mov`, `movaps`, `movss`, `movzx` and so on as
    // copying.
    let copies = name.starts_with("mov") && !name.starts_with("movmsk") || ["push", "pop", "leave"].contains(&&*name);
    if copies && writes {
        Class::Store
    } else if (copies || name.starts_with("broadcast")) && reads {
        Class::Load
    } else if copies {
        Class::Move
    } else if name.starts_with("broadcast") {
        Class::Shuffle
    } else {
        Class::Arithmetic
    }
}

fn width(raw: &iced_x86::Instruction) -> Width {
    let vector =
        (0..raw.op_count()).any(|i| raw.op_kind(i) == OpKind::Register && raw.op_register(i).is_vector_register());
    if !vector {
        return Width::General;
    }
    let name = mnemonic(raw);
    if name.starts_with("broadcast") {
        return Width::Packed;
    }
    let scalar = name.ends_with("ss") || name.ends_with("sd") || ["movd", "movq"].contains(&name.as_str());
    let scalar =
        scalar || name.starts_with("cvt") && (name.contains("2ss") || name.contains("2sd") || name.contains("s2si"));
    if scalar { Width::Scalar } else { Width::Packed }
}
