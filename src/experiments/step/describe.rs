//! An instruction in the words of its source: names in place of registers, and what it changed.

use iced_x86::{ConditionCode, FlowControl, Formatter, IntelFormatter, MemorySizeOptions, Mnemonic, OpKind, Register};
use serde::Serialize;

use super::model::{self, Element, Operation, Place, What, decode};
use super::shadow::{ElementError, StepError};
use super::slice;
use crate::kernels::step::Step;
use crate::measure::instructions::{self, Instruction};
use crate::measure::source::{self, Call, Macro, Parameter, Unit};

/// An instruction that was executed.
#[derive(Clone, Debug, Serialize)]
pub struct Line {
    /// Its place among all instructions that the kernels executed, counted from 0: also among those that are left out.
    pub number: u64,
    /// As a disassembler has it, in Intel's syntax.
    pub text: String,
    /// As its source has it, with the names that the macro gives its parameters.
    pub source: String,
    pub comment: &'static str,
    /// Where it stands.
    pub file: &'static str,
    pub line: usize,
    pub kernel: String,
    /// The macros that it came from, the outermost first.
    pub macros: Vec<MacroCall>,
    /// What it wrote, but for flags.
    pub changed: Vec<Change>,
    /// What it compared, in words.
    pub compared: Option<String>,
    pub branch: Option<Branch>,
    /// Bits that cancelled, for each element that is told of.
    pub cancelled_bits: Vec<Option<u32>>,
    /// Why it is not known, where it is not, or what differs.
    pub unknown: Option<String>,
    /// Whether exact values would compare otherwise, or choose another.
    pub overturned: bool,
    /// Whether something that it wrote counts as exact from here on, though it was made of what is not.
    pub restarted: bool,
    /// Whether the pixel is made of what it wrote; of the others one sees what they looked at, or decided.
    pub made: bool,
}

#[derive(Clone, Debug, Serialize)]
pub struct MacroCall {
    pub name: &'static str,
    /// Each parameter, as in `t = xmm3`.
    pub parameters: Vec<String>,
}

/// A register, or memory, that an instruction wrote.
#[derive(Clone, Debug, Serialize)]
pub struct Change {
    /// The register, or the operand in memory.
    pub register: String,
    /// What the source calls it there.
    pub name: String,
    /// The elements that are told of, by their numbers.
    pub lanes: Vec<usize>,
    /// What they were.
    pub before: Vec<Value>,
    /// What they are.
    pub after: Vec<Value>,
    /// How far from the exact values, in units of the last place; null where none is known.
    pub error_ulp: Vec<Option<f64>>,
    /// The part of that which this instruction added by rounding; the rest it inherited.
    pub added_ulp: Vec<Option<f64>>,
    /// Of sums how many leading bits cancelled.
    #[serde(skip)]
    pub cancelled_bits: Vec<Option<u32>>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Value {
    Single(f32),
    Double(f64),
    /// A whole number, or an address.
    Bits(u64),
    /// A mask, lane 0 in the lowest bit.
    Mask(u64),
}

/// What became of a jump.
#[derive(Clone, Debug, Serialize)]
pub struct Branch {
    pub taken: bool,
    /// What was compared, where it depends on that.
    pub why: String,
}

/// What elements are.
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
    /// How many units of the last place it cost: what it added, and what cancelling made more of what it inherited.
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

/// Why the model says nothing of an instruction, or where it was wrong.
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

/// Writes lines.
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

    /// The line of a step, and the instruction as it is counted.
    pub fn line(&mut self, step: &Step<'_>, error: &StepError, part: &slice::Part) -> (Line, Instruction) {
        let raw = decode(step);
        let instruction = instructions::decode(&step.code[..raw.len()], step.before.rip).next();
        let instruction = instruction.expect("the CPU has executed it");
        let mut text = String::new();
        self.formatter.format(&raw, &mut text);
        let place = Origin::of(self.unit, step.before.rip);
        let kernel = self.unit.function(step.before.rip as usize).map_or("", |(name, _)| name).to_owned();
        let kind = kind_of(&raw, &kernel);
        let changed = self.changes(step, error, part, &place, kind);
        let branch = match raw.flow_control() {
            FlowControl::ConditionalBranch => {
                Some(Branch { taken: step.after.rip != raw.next_ip(), why: condition(raw.condition_code()).into() })
            }
            _ => None,
        };
        let compared = self.comparison(step, &raw, &place, kind);
        let cancelled_bits = changed.iter().flat_map(|change| change.cancelled_bits.clone()).collect();
        // What fills up to an alignment has none, and names with % are NASM's alone.
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
        (line, instruction)
    }

    /// What the operations wrote, a change for each place, its elements those of the pixel or of the lane.
    fn changes(
        &self,
        step: &Step<'_>,
        error: &StepError,
        part: &slice::Part,
        place: &Origin,
        kind: Kind,
    ) -> Vec<Change> {
        // What is saved on the stack is no news.
        let name = decode(step).mnemonic();
        if matches!(name, Mnemonic::Push | Mnemonic::Pop | Mnemonic::Call | Mnemonic::Ret) {
            return Vec::new();
        }
        let operations = &error.operations;
        let mut places: Vec<Place> = Vec::new();
        for Operation { to: Element { place, .. }, .. } in operations {
            let is_news = !matches!(place, Place::Flags | Place::Next | Place::General(4));
            if is_news && !places.contains(place) {
                places.push(*place);
            }
        }
        let mut changes = Vec::new();
        for of in places {
            let kind = match of {
                Place::General(_) => Kind::Whole(64),
                Place::Mask(_) => Kind::Mask,
                _ => kind,
            };
            let bits = u64::from(kind.bits());
            let base = if of == Place::Memory { step.touched.map_or(0, |touched| 8 * touched.address) } else { 0 };
            let lanes_of = |from: u64, to: u64| (from - base) / bits..(to - base).div_ceil(bits);
            // Of a general register or a mask all is told.
            let is_whole = matches!(of, Place::General(_) | Place::Mask(_));
            let unit = if matches!(of, Place::Mask(_)) { 1 } else { 8 };
            let made = part.made.iter().filter(|made| operations[made.operation].to.place == of);
            let made = made.flat_map(|made| lanes_of(unit * made.units.start, unit * made.units.end));
            let mut lanes: Vec<_> = made.collect();
            let written = operations.iter().filter(|operation| operation.to.place == of && !is_zero(operation));
            let written = || written.clone().flat_map(|operation| lanes_of(operation.to.at, operation.to.end()));
            if let (true, Some(own)) = (lanes.is_empty(), self.lane) {
                lanes = written().filter(|lane| is_whole || *lane == own as u64).collect();
            }
            if self.lane.is_none() || lanes.is_empty() && is_whole {
                lanes = written().filter(|lane| *lane < 4).collect();
            }
            lanes.sort_unstable();
            lanes.dedup();
            if lanes.is_empty() {
                continue;
            }
            let at = |lane: &u64| Element { place: of, at: base + lane * bits, bits: kind.bits() };
            let elements: Vec<_> = lanes.iter().map(at).collect();
            let register = match of {
                Place::Memory => place.memory.clone(),
                of => register_name(of, operations),
            };
            let error_of = |at: &Element| error.errors.iter().find(|error| error.at == *at && error.exact.is_some());
            let errors: Vec<Option<&ElementError>> = elements.iter().map(error_of).collect();
            changes.push(Change {
                name: place.name_of(self.unit, &register).unwrap_or_else(|| register.clone()),
                register,
                error_ulp: errors.iter().map(|error| Some((*error)?.error)).collect(),
                added_ulp: errors.iter().map(|error| Some((*error)?.added)).collect(),
                cancelled_bits: errors.iter().map(|error| (*error)?.cancelled).collect(),
                lanes: lanes.into_iter().map(|lane| lane as usize).collect(),
                before: elements.iter().map(|&at| kind.value(model::before(step, at))).collect(),
                after: elements.iter().map(|&at| kind.value(model::after(step, at))).collect(),
            });
        }
        changes
    }

    /// What was compared, in words: `s = -3.2 < zero = 0`.
    fn comparison(&self, step: &Step<'_>, raw: &iced_x86::Instruction, place: &Origin, kind: Kind) -> Option<String> {
        let name = format!("{:?}", raw.mnemonic()).to_lowercase();
        let float = name.contains("comis");
        if !float && !["cmp", "test"].contains(&&*name) {
            return None;
        }
        let operand = |index: u32| -> Option<(String, Value)> {
            let kind = if float { kind } else { Kind::Whole(8 * raw.op_register(0).size().clamp(1, 8) as u32) };
            let value =
                |kind: Kind, place, at| kind.value(model::before(step, Element { place, at, bits: kind.bits() }));
            match raw.op_kind(index) {
                OpKind::Register => {
                    let register = raw.op_register(index);
                    let value = match register.number() as u8 {
                        number if register.is_gpr() => value(Kind::Whole(64), Place::General(number), 0),
                        number => value(kind, Place::Vector(number), 0),
                    };
                    let text = format!("{register:?}").to_lowercase();
                    Some((place.name_of(self.unit, &text).unwrap_or(text), value))
                }
                OpKind::Memory => Some((place.memory.clone(), value(kind, Place::Memory, 8 * step.touched?.address))),
                _ => Some((String::new(), Value::Bits(raw.try_immediate(index).ok()?))),
            }
        };
        let ((a_name, a), (b_name, b)) = (operand(0)?, operand(1)?);
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
}

/// An element that is zeroed on the way: the upper part of a register.
fn is_zero(operation: &Operation) -> bool {
    operation.what == What::Computed(0) && operation.from.is_empty() && operation.to.at >= 128
}

/// Where an instruction comes from, in the macro that a reader looks at: what stands for one operation on every lane, in
/// isa.inc and packet.inc, is taken as the instruction itself.
#[derive(Default)]
pub struct Origin {
    pub file: &'static str,
    pub line: usize,
    pub comment: &'static str,
    /// With the names of parameters.
    pub source: String,
    /// The macro calls around it, the outermost first.
    pub calls: Vec<usize>,
    /// The operand in memory, in the source's words.
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

    /// What the innermost macro that has a name for a register calls it.
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

/// A line of the source, with the marks of NASM's parameters left out, and numbers replaced by what they stand for.
fn in_words(text: &str, within: Option<&Call>, parameters: &[Parameter]) -> String {
    let arguments = within.map_or(&[][..], |call| &call.arguments);
    let named = || parameters.iter().map(|parameter| parameter.name).zip(arguments);
    let mut words = text.replace("%%", "");
    // What NASM pastes together.
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

/// Whether two names are of the same register, of whatever width.
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

/// What the elements of an instruction's result are.
fn kind_of(raw: &iced_x86::Instruction, kernel: &str) -> Kind {
    let name = format!("{:?}", raw.mnemonic()).to_lowercase();
    // Shuffles of integers serve floats too.
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

/// The register of a place, as wide as it was written.
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

/// What a condition asks for.
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
    /// As a number.
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
            // What is large is an address, or bits.
            Value::Bits(value) if value < 1 << 20 => write!(f, "{value}"),
            Value::Bits(value) => write!(f, "{value:#x}"),
            Value::Mask(value) => write!(f, "{value:#b}"),
        }
    }
}
