//! Describes an instruction as its source has it, and what it changed.

use std::ops::Range;

use iced_x86::{ConditionCode, FlowControl, Formatter, IntelFormatter, MemorySizeOptions, Mnemonic, OpKind, Register};
use serde::Serialize;

use super::model::{self, Element, Operation, Place, What, decode};
use super::shadow::{ElementError, ShadowedStep, StepError};
use super::slice;
use crate::measure::instructions::{self, Instruction};
use crate::measure::source::{self, Call, Macro, Parameter, Unit};
use rayo::internals::kernels::step::Step;

/// An executed instruction.
#[derive(Clone, Debug, Serialize)]
pub struct Line {
    /// Its number among all instructions that the kernels executed, shown or not, counted from 0.
    pub number: u64,
    /// The disassembled instruction, in Intel's syntax.
    pub text: String,
    /// The instruction as it stands in its source, with the names that the macro gives its
    /// parameters.
    pub source: String,
    pub comment: &'static str,
    /// The source file.
    pub file: &'static str,
    pub line: usize,
    pub kernel: String,
    /// The macros that it comes from, outermost first.
    pub macros: Vec<MacroCall>,
    /// What the instruction wrote, except flags.
    pub changed: Vec<Change>,
    /// The numbers that the instruction compared, in words.
    pub compared: Option<String>,
    pub branch: Option<Branch>,
    /// The number of bits that cancelled, for each element that is shown.
    pub cancelled_bits: Vec<Option<u32>>,
    /// Why the model does not know the instruction, or how the CPU's result differs from the
    /// model's. None if both agree.
    pub unknown: Option<String>,
    /// Whether exact values would decide the instruction's comparison or selection differently.
    pub overturned: bool,
    /// Whether some result counts as exact from here on although its operands were not exact.
    pub restarted: bool,
    /// Whether the pixel depends on what the instruction wrote. Other instructions are shown
    /// because they read data of the pixel or decide a jump.
    pub made: bool,
}

#[derive(Clone, Debug, Serialize)]
pub struct MacroCall {
    pub name: &'static str,
    /// Each parameter with its argument, as in `t = xmm3`.
    pub parameters: Vec<String>,
}

/// A register or memory that an instruction wrote.
#[derive(Clone, Debug, Serialize)]
pub struct Change {
    /// The register, or the operand in memory.
    pub register: String,
    /// The name that the source gives the register or the memory.
    pub name: String,
    /// The numbers of the elements that are shown.
    pub lanes: Vec<usize>,
    /// The values of these elements before the instruction.
    pub before: Vec<Value>,
    /// The values of these elements after the instruction.
    pub after: Vec<Value>,
    /// The errors of these elements, in units of the last place; null where no exact value is
    /// known.
    pub error_ulp: Vec<Option<f64>>,
    /// The part of these errors that the instruction added by rounding. The rest came with its
    /// operands.
    pub added_ulp: Vec<Option<f64>>,
    /// For sums, how many leading bits cancelled.
    #[serde(skip)]
    pub cancelled_bits: Vec<Option<u32>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Value {
    Single(f32),
    Double(f64),
    /// An integer or an address.
    Bits(u64),
    /// A mask, lane 0 in the lowest bit.
    Mask(u64),
}

/// The outcome of a jump.
#[derive(Clone, Debug, Serialize)]
pub struct Branch {
    pub taken: bool,
    /// The comparison that decided the jump; empty for an unconditional one.
    pub why: String,
}

/// The kind of number that elements hold.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Single,
    Double,
    Whole(u32),
    Mask,
}

impl Kind {
    fn bits(self) -> u32 {
        match self {
            Kind::Single => 32,
            Kind::Double => 64,
            Kind::Whole(bits) => bits,
            Kind::Mask => 64,
        }
    }

    fn value(self, bits: u64) -> Value {
        match self {
            Kind::Single => Value::Single(f32::from_bits(bits as u32)),
            Kind::Double => Value::Double(f64::from_bits(bits)),
            Kind::Mask => Value::Mask(bits),
            Kind::Whole(_) => Value::Bits(bits),
        }
    }
}

impl Line {
    /// How many units of the last place the instruction cost: the rounding error that it added, and
    /// the amplification of its operands' errors by cancellation.
    pub fn cost(&self) -> f64 {
        let cost = |change: &Change| {
            let parts = change.error_ulp.iter().zip(&change.added_ulp).zip(&change.cancelled_bits);
            let costs = parts.map(|((error, added), cancelled)| match (error, added) {
                (Some(error), Some(added)) => {
                    let more = 1.0 - (-f64::from(cancelled.unwrap_or(0))).exp2();
                    added.abs() + (error - added).abs() * more
                }
                _ => 0.0,
            });
            costs.fold(0.0, f64::max)
        };
        self.changed.iter().map(cost).fold(0.0, f64::max)
    }
}

/// Why the model does not know an instruction, or where its prediction was wrong.
pub fn unknown(error: &StepError) -> Option<String> {
    match &error.check {
        Err(unknown) => Some(unknown.to_string()),
        Ok(check) => check.differences.first().map(|difference| {
            format!(
                "{:?}: {:#x} was predicted, {:#x} found",
                difference.at.place, difference.predicted, difference.found
            )
        }),
    }
}

/// A step as the document shows it.
pub struct DescribedStep {
    pub line: Line,
    /// The instruction, decoded for counting instructions by kind.
    pub instruction: Instruction,
}

/// The elements that an instruction wrote to one register or to memory, as lanes of one width.
struct WrittenLanes {
    place: Place,
    kind: Kind,
    /// The bit at which lane 0 begins.
    base: u64,
}

impl WrittenLanes {
    /// The elements in `place`, written by an instruction whose elements are of this kind.
    fn new(place: Place, kind: Kind, step: &Step<'_>) -> Self {
        let kind = match place {
            Place::General(_) => Kind::Whole(64),
            Place::Mask(_) => Kind::Mask,
            _ => kind,
        };
        let base = if place == Place::Memory { step.touched.map_or(0, |touched| 8 * touched.address) } else { 0 };
        WrittenLanes { place, kind, base }
    }

    /// Whether the place is shown as a single value: a general register or a mask.
    fn is_whole(&self) -> bool {
        matches!(self.place, Place::General(_) | Place::Mask(_))
    }

    /// The lanes that contain at least one of these bits.
    fn of_bits(&self, from: u64, to: u64) -> Range<u64> {
        let bits = u64::from(self.kind.bits());
        (from - self.base) / bits..(to - self.base).div_ceil(bits)
    }

    fn element(&self, lane: u64) -> Element {
        let bits = self.kind.bits();
        Element { place: self.place, at: self.base + lane * u64::from(bits), bits }
    }

    /// The lanes that were written, except those that were set to zero as the upper part of a
    /// register.
    fn written(&self, operations: &[Operation]) -> Vec<u64> {
        let here = operations.iter().filter(|operation| operation.to.place == self.place && !is_zero(operation));
        here.flat_map(|operation| self.of_bits(operation.to.at, operation.to.end())).collect()
    }

    /// The written lanes on which the pixel depends.
    fn needed(&self, operations: &[Operation], part: &slice::Contribution) -> Vec<u64> {
        let bits_of_unit = if matches!(self.place, Place::Mask(_)) { 1 } else { 8 };
        let here = part.made.iter().filter(|made| operations[made.operation].to.place == self.place);
        here.flat_map(|made| self.of_bits(bits_of_unit * made.units.start, bits_of_unit * made.units.end)).collect()
    }
}

/// The registers and the memory that the operations wrote, in order, except flags, the instruction
/// pointer and the stack pointer.
fn written_places(operations: &[Operation]) -> Vec<Place> {
    let mut places: Vec<Place> = Vec::new();
    for Operation { to: Element { place, .. }, .. } in operations {
        let is_news = !matches!(place, Place::Flags | Place::Next | Place::General(4));
        if is_news && !places.contains(place) {
            places.push(*place);
        }
    }
    places
}

/// Makes the lines of the document.
pub struct Describer {
    unit: &'static Unit,
    lane: Option<usize>,
    formatter: IntelFormatter,
}

impl Describer {
    pub fn new(unit: &'static Unit, lane: Option<usize>) -> Self {
        let mut formatter = IntelFormatter::new();
        formatter.options_mut().set_space_after_operand_separator(true);
        formatter.options_mut().set_branch_leading_zeros(false);
        formatter.options_mut().set_memory_size_options(MemorySizeOptions::Never);
        Describer { unit, lane, formatter }
    }

    /// Describes a step; `part` is what it contributes to the pixel.
    pub fn line(&mut self, shadowed: &ShadowedStep<'_>, part: &slice::Contribution) -> DescribedStep {
        let ShadowedStep { step, error } = shadowed;
        let raw = decode(step);
        let instruction = instructions::decode(&step.code[..raw.len()], step.before.rip).next();
        let instruction = instruction.expect("the CPU has executed it");
        let mut text = String::new();
        self.formatter.format(&raw, &mut text);
        let place = Origin::of(self.unit, step.before.rip);
        let kernel = self.unit.function(step.before.rip as usize).map_or("", |function| function.symbol).to_owned();
        let kind = kind_of(&raw, &kernel);
        let changed = self.changes(shadowed, part, &place, kind);
        let branch = match raw.flow_control() {
            FlowControl::ConditionalBranch => {
                Some(Branch { taken: step.after.rip != raw.next_ip(), why: condition(raw.condition_code()).into() })
            }
            _ => None,
        };
        let compared = self.comparison(step, &raw, &place, kind);
        let cancelled_bits = changed.iter().flat_map(|change| change.cancelled_bits.clone()).collect();
        // Padding has no source line, and a source line with a % consists mostly of NASM's
        // preprocessor names. Both are shown as disassembled.
        let is_of_nasm = place.line == 0 || place.source.contains('%');
        let source = if is_of_nasm { text.clone() } else { place.source.clone() };
        let line = Line {
            number: step.number,
            text,
            source,
            comment: place.comment,
            file: place.file,
            line: place.line,
            kernel,
            macros: place.macros(self.unit),
            changed,
            compared,
            branch,
            cancelled_bits,
            unknown: unknown(error),
            overturned: !error.overturned.is_empty(),
            restarted: !error.restarted.is_empty(),
            made: !part.made.is_empty(),
        };
        DescribedStep { line, instruction }
    }

    /// What the operations wrote: a change for each register or memory operand, with the elements
    /// that belong to the pixel or to the followed lane.
    fn changes(
        &self,
        shadowed: &ShadowedStep<'_>,
        part: &slice::Contribution,
        origin: &Origin,
        kind: Kind,
    ) -> Vec<Change> {
        let ShadowedStep { step, error } = shadowed;
        // Pushes, pops, calls and returns save registers or addresses, which are not shown as
        // changes.
        let name = decode(step).mnemonic();
        if matches!(name, Mnemonic::Push | Mnemonic::Pop | Mnemonic::Call | Mnemonic::Ret) {
            return Vec::new();
        }
        let mut changes = Vec::new();
        for place in written_places(&error.operations) {
            let written = WrittenLanes::new(place, kind, step);
            let lanes = self.shown_lanes(&written, &error.operations, part);
            if !lanes.is_empty() {
                changes.push(self.change(shadowed, &written, &lanes, origin));
            }
        }
        changes
    }

    /// The lanes of a register or of memory that are shown, in order: those on which the pixel
    /// depends. Without any, the lane that is followed; without such a lane, the first four.
    fn shown_lanes(&self, written: &WrittenLanes, operations: &[Operation], part: &slice::Contribution) -> Vec<u64> {
        let is_whole = written.is_whole();
        let mut lanes = written.needed(operations, part);
        if let (true, Some(followed)) = (lanes.is_empty(), self.lane) {
            lanes = written.written(operations);
            lanes.retain(|lane| is_whole || *lane == followed as u64);
        }
        if self.lane.is_none() || lanes.is_empty() && is_whole {
            lanes = written.written(operations);
            lanes.retain(|lane| *lane < 4);
        }
        lanes.sort_unstable();
        lanes.dedup();
        lanes
    }

    /// How the given lanes changed.
    fn change(&self, shadowed: &ShadowedStep<'_>, written: &WrittenLanes, lanes: &[u64], origin: &Origin) -> Change {
        let ShadowedStep { step, error } = shadowed;
        let elements: Vec<_> = lanes.iter().map(|lane| written.element(*lane)).collect();
        let register = match written.place {
            Place::Memory => origin.memory.clone(),
            place => register_name(place, &error.operations),
        };
        let error_of = |at: &Element| error.errors.iter().find(|error| error.at == *at && error.exact.is_some());
        let errors: Vec<Option<&ElementError>> = elements.iter().map(error_of).collect();
        let value = |bits: u64| written.kind.value(bits);
        Change {
            name: origin.name_of(self.unit, &register).unwrap_or_else(|| register.clone()),
            register,
            error_ulp: errors.iter().map(|error| Some((*error)?.error)).collect(),
            added_ulp: errors.iter().map(|error| Some((*error)?.added)).collect(),
            cancelled_bits: errors.iter().map(|error| (*error)?.cancelled).collect(),
            lanes: lanes.iter().map(|lane| *lane as usize).collect(),
            before: elements.iter().map(|&at| value(model::before(step, at))).collect(),
            after: elements.iter().map(|&at| value(model::after(step, at))).collect(),
        }
    }

    /// The comparison in words: `s = -3.2 < zero = 0`.
    fn comparison(&self, step: &Step<'_>, raw: &iced_x86::Instruction, place: &Origin, kind: Kind) -> Option<String> {
        let name = format!("{:?}", raw.mnemonic()).to_lowercase();
        let float = name.contains("comis");
        if !float && !["cmp", "test"].contains(&&*name) {
            return None;
        }
        let kind = if float { kind } else { Kind::Whole(8 * raw.op_register(0).size().clamp(1, 8) as u32) };
        let operand = |index: u32| self.compared_operand(step, raw, index, place, kind);
        let ComparedOperand { name: a_name, value: a } = operand(0)?;
        let ComparedOperand { name: b_name, value: b } = operand(1)?;
        if name == "test" {
            let both = || format!("{a_name} = {a} and {b_name} = {b}");
            return Some(if a_name == b_name { format!("{a_name} = {a}") } else { both() });
        }
        let relation = match (a.number(), b.number()) {
            (a, b) if a < b => "<",
            (a, b) if a > b => ">",
            (a, b) if a == b => "=",
            _ => "is not comparable to",
        };
        let b_text = if b_name.is_empty() { b.to_string() } else { format!("{b_name} = {b}") };
        Some(format!("{a_name} = {a} {relation} {b_text}"))
    }

    /// An operand of a comparison, whose elements are of this kind. None if it is neither register
    /// nor memory nor an immediate number.
    fn compared_operand(
        &self,
        step: &Step<'_>,
        raw: &iced_x86::Instruction,
        index: u32,
        origin: &Origin,
        kind: Kind,
    ) -> Option<ComparedOperand> {
        let before = |kind: Kind, place, at| kind.value(model::before(step, Element { place, at, bits: kind.bits() }));
        Some(match raw.op_kind(index) {
            OpKind::Register => {
                let register = raw.op_register(index);
                let value = match register.number() as u8 {
                    number if register.is_gpr() => before(Kind::Whole(64), Place::General(number), 0),
                    number => before(kind, Place::Vector(number), 0),
                };
                let text = format!("{register:?}").to_lowercase();
                ComparedOperand { name: origin.name_of(self.unit, &text).unwrap_or(text), value }
            }
            OpKind::Memory => {
                let value = before(kind, Place::Memory, 8 * step.touched?.address);
                ComparedOperand { name: origin.memory.clone(), value }
            }
            _ => ComparedOperand { name: String::new(), value: Value::Bits(raw.try_immediate(index).ok()?) },
        })
    }
}

/// An operand of a comparison: the source's name for it, empty for a number, and its value.
struct ComparedOperand {
    name: String,
    value: Value,
}

/// Whether an operation only zeroes an element beyond the lowest 128 bits of a register.
fn is_zero(operation: &Operation) -> bool {
    operation.what == What::Computed(0) && operation.from.is_empty() && operation.to.at >= 128
}

/// The origin of an instruction, in the macro where a reader looks for it. Macros of isa.inc and
/// packet.inc stand for one operation on every lane and are taken for the instruction itself.
#[derive(Default)]
pub struct Origin {
    pub file: &'static str,
    pub line: usize,
    pub comment: &'static str,
    /// The source line, with the names of parameters.
    pub source: String,
    /// The macro calls around it, outermost first.
    pub calls: Vec<usize>,
    /// The operand in memory, as the source names it.
    memory: String,
}

impl Origin {
    pub fn of(unit: &'static Unit, rip: u64) -> Self {
        let Some(source::Origin { calls, number, text, comment }) = unit.origin(rip as usize) else {
            return Origin::default();
        };
        let within = calls.last().map(|&call| &unit.calls[call]);
        let source = in_words(text, within, within.map_or(&[], |call| &unit.macros[call.of].parameters));
        let memory = source.find('[').and_then(|start| Some(&source[start..=start + source[start..].find(']')?]));
        let memory = memory.unwrap_or("memory").to_owned();
        Origin { file: unit.file(calls.last().copied()), line: number, comment, source, calls, memory }
    }

    fn macros(&self, unit: &Unit) -> Vec<MacroCall> {
        let call = |&call: &usize| {
            let Call { of, arguments, .. } = &unit.calls[call];
            let Macro { name, parameters, .. } = &unit.macros[*of];
            let names = parameters.iter().map(|parameter| parameter.name).chain(std::iter::repeat(""));
            let parameter = |(name, argument): (&str, &&str)| match name {
                "" => (*argument).to_owned(),
                name => format!("{name} = {argument}"),
            };
            MacroCall { name, parameters: names.zip(arguments).map(parameter).collect() }
        };
        self.calls.iter().map(call).collect()
    }

    /// The name that the innermost macro which names the register gives it.
    fn name_of(&self, unit: &Unit, register: &str) -> Option<String> {
        self.calls.iter().rev().find_map(|&call| {
            let Call { of, arguments, .. } = &unit.calls[call];
            let mut named = unit.macros[*of].parameters.iter().zip(arguments);
            named
                .find(|(_, argument)| same_register(argument, register))
                .map(|(parameter, _)| parameter.name.to_owned())
        })
    }
}

/// A source line without the % marks of NASM's parameters, in which numbered parameters are
/// replaced by their arguments.
fn in_words(text: &str, within: Option<&Call>, parameters: &[Parameter]) -> String {
    let arguments = within.map_or(&[][..], |call| &call.arguments);
    let named = || parameters.iter().map(|parameter| parameter.name).zip(arguments);
    let mut words = text.replace("%%", "");
    // Names of parameters that NASM pastes to other text.
    for (name, argument) in named() {
        words = words.replace(&format!("%+ {name}"), &format!("%+ {argument}"));
        words = words.replace(&format!("{name} %+"), &format!("{argument} %+"));
    }
    words = words.replace(" %+ ", "");
    for (index, argument) in arguments.iter().enumerate().rev() {
        words = words.replace(&format!("%{}", index + 1), argument);
    }
    for (name, argument) in named() {
        words = words.replace(&format!("%[{name}]"), argument);
    }
    words.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Whether two names denote the same register, in any width.
pub fn same_register(a: &str, b: &str) -> bool {
    let number = |name: &str| -> Option<(char, u32)> {
        let vector = name.strip_prefix(['x', 'y', 'z']).and_then(|name| name.strip_prefix("mm"));
        if let Some(number) = vector {
            return Some(('v', number.parse().ok()?));
        }
        const OLD: [&str; 8] = ["ax", "cx", "dx", "bx", "sp", "bp", "si", "di"];
        if let Some(place) = OLD.iter().position(|old| name == *old || name.len() == 3 && &name[1..] == *old) {
            return Some(('r', place as u32));
        }
        let digits = name.strip_prefix('r')?.trim_end_matches(['d', 'w', 'b']);
        Some(('r', digits.parse().ok()?))
    };
    a == b || number(a).is_some() && number(a) == number(b)
}

/// The kind of the elements of an instruction's result.
fn kind_of(raw: &iced_x86::Instruction, kernel: &str) -> Kind {
    let name = format!("{:?}", raw.mnemonic()).to_lowercase();
    // Shuffles of integers move floats too, so that their elements are not taken for integers.
    let whole = name.starts_with('p') && !name.starts_with("pshufd")
        || name.starts_with("vp") && !name.starts_with("vperm") && !name.starts_with("vpshufd")
        || name.ends_with("2dq")
        || name.contains("2si")
        || name.starts_with("vmovdqu")
        || name.starts_with("vmovdqa");
    let ends = |with: [&str; 2]| with.iter().any(|end| name.ends_with(end));
    if whole {
        Kind::Whole(32)
    } else if ends(["pd", "sd"]) || kernel.contains("_double_") && !ends(["ps", "ss"]) {
        Kind::Double
    } else {
        Kind::Single
    }
}

/// The name of a register in the width that was written.
fn register_name(of: Place, operations: &[Operation]) -> String {
    let register = match of {
        Place::General(number) => Register::RAX + u32::from(number),
        Place::Mask(number) => Register::K0 + u32::from(number),
        Place::Vector(number) => {
            let end = operations.iter().filter(|o| o.to.place == of && !is_zero(o)).map(|o| o.to.end()).max();
            let first = match end.unwrap_or(0) {
                257.. => Register::ZMM0,
                129.. => Register::YMM0,
                _ => Register::XMM0,
            };
            first + u32::from(number)
        }
        _ => return String::new(),
    };
    format!("{register:?}").to_lowercase()
}

/// A condition code in words.
fn condition(code: ConditionCode) -> &'static str {
    match code {
        ConditionCode::b => "if below, or not comparable",
        ConditionCode::be => "if not above, or not comparable",
        ConditionCode::a => "if above",
        ConditionCode::ae => "if not below",
        ConditionCode::e => "if equal, or 0",
        ConditionCode::ne => "if not equal, or not 0",
        ConditionCode::l => "if less",
        ConditionCode::le => "if not greater",
        ConditionCode::g => "if greater",
        ConditionCode::ge => "if not less",
        ConditionCode::s => "if negative",
        ConditionCode::ns => "if not negative",
        ConditionCode::p => "if not comparable",
        ConditionCode::np => "if comparable",
        ConditionCode::o | ConditionCode::no | ConditionCode::None => "",
    }
}

impl Value {
    /// The value as a number.
    pub fn number(self) -> f64 {
        match self {
            Value::Single(value) => value.into(),
            Value::Double(value) => value,
            Value::Bits(bits) | Value::Mask(bits) => bits as f64,
        }
    }
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let plain = |value: f64| value == 0.0 || !value.is_finite() || (1e-4..1e7).contains(&value.abs());
        match *self {
            Value::Single(value) if plain(value.into()) => write!(f, "{value}"),
            Value::Single(value) => write!(f, "{value:e}"),
            Value::Double(value) if plain(value) => write!(f, "{value}"),
            Value::Double(value) => write!(f, "{value:e}"),
            // Large values are addresses or bit patterns, and are shown in hexadecimal.
            Value::Bits(value) if value < 1 << 20 => write!(f, "{value}"),
            Value::Bits(value) => write!(f, "{value:#x}"),
            Value::Mask(value) => write!(f, "{value:#b}"),
        }
    }
}
