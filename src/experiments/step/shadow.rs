//! Exact values beside the numbers in registers and memory: what each would be if nothing before it had been rounded.
//!
//! A number has a shadow where the two differ; where it has none, it is itself exact. So shadows begin by themselves, and
//! what nobody watched (other code that writes the same memory) ends them: a shadow holds the bits that it belongs to, and is
//! none beside others. The path is that of the CPU: what it compared, chose and masked out stays so, and is reported where
//! exact values would have it otherwise.

mod exact;

use std::collections::BTreeMap;

use iced_x86::{InstructionInfoFactory, OpAccess};

use super::model::{self, Check, Element, Float, Number, Operation, Place, Unknown, What, check, logic, model};
use crate::kernels::step::Step;
use crate::reference::exact::Exact;
use crate::reference::number::Number as _;
use exact::{binary_digits_lost, of_bits, of_integer};

/// The shadows of registers and memory.
#[derive(Clone, Debug, Default)]
pub struct Shadow {
    /// By place and first bit, no two of which overlap.
    values: BTreeMap<(Place, u64), Value>,
}

#[derive(Clone, Debug)]
struct Value {
    format: Number,
    /// What it is the shadow of.
    bits: u64,
    exact: Exact,
}

/// What an instruction did to digits.
#[derive(Clone, Debug)]
pub struct StepError {
    /// What it does, by the model; none where there is no model of it.
    pub operations: Vec<Operation>,
    /// The model held against the CPU. Where it is wrong or knows nothing, shadows of what was written have ended.
    pub check: Result<Check, Unknown>,
    /// Of each number that was computed or converted, and of each that was moved and has a shadow.
    pub errors: Vec<ElementError>,
    /// The operations, by their places, whose outcome exact values would change: comparisons, what is the less or the
    /// greater, signs that select, and whole numbers.
    pub overturned: Vec<usize>,
    /// What was made of numbers with shadows and has none: integers, single bytes, numbers made of those that are not
    /// finite, and what the model has wrong. It counts as exact from here on.
    pub restarted: Vec<Element>,
}

/// A number that was written, in units of the last place of its format: those of the larger of it and its exact value.
#[derive(Clone, Debug)]
pub struct ElementError {
    pub at: Element,
    /// What it would be without rounding; None where it is not finite. Then there are no errors, which are 0.
    pub exact: Option<Exact>,
    /// The number less its exact value: what was inherited and what was added.
    pub error: f64,
    /// The part that this instruction added by rounding its result. The rest the errors of the operands brought: the
    /// operation, without rounding, on them less that on exact ones.
    pub added: f64,
    /// Of sums: how many leading bits of the larger of what was added were lost, all of them where 0 is left.
    pub cancelled: Option<u32>,
}

/// The shadows that an instruction makes, before it ends those of what it overwrites.
#[derive(Default)]
struct Made {
    values: Vec<(Element, Value)>,
    errors: Vec<ElementError>,
    overturned: Vec<usize>,
    restarted: Vec<Element>,
}

impl Made {
    /// A number that is another's copy, with its shadow if it has one, or begins anew.
    fn moved(&mut self, at: Element, format: Number, bits: u64, shadow: Option<Exact>) {
        let found = format.value(bits);
        match shadow {
            Some(exact) => {
                let error = exact::difference(format, found, &exact);
                self.number(at, format, bits, Some(exact), [error, 0.0], None);
            }
            None => self.number(at, format, bits, of_bits(format, bits), [0.0, 0.0], None),
        }
    }

    /// A number that was computed, with its exact value, and what exact computing makes of the operands as they are, if
    /// that is another.
    fn computed(
        &mut self,
        at: Element,
        format: Number,
        bits: u64,
        exact: Exact,
        of_rounded: Option<Exact>,
        cancelled: Option<u32>,
    ) {
        let found = format.value(bits);
        let error = exact::difference(format, found, &exact);
        let added = of_rounded.map_or(error, |of_rounded| exact::in_units(format, found, &exact, &of_rounded));
        self.number(at, format, bits, Some(exact), [error, added], cancelled);
    }

    fn number(
        &mut self,
        at: Element,
        format: Number,
        bits: u64,
        exact: Option<Exact>,
        [error, added]: [f64; 2],
        cancelled: Option<u32>,
    ) {
        if let (Some(exact), true) = (&exact, error != 0.0) {
            self.values.push((at, Value { format, bits, exact: exact.clone() }));
        }
        self.errors.push(ElementError { at, exact, error, added, cancelled });
    }
}

impl Shadow {
    /// No shadows: all that is there is exact.
    pub fn new() -> Self {
        Shadow::default()
    }

    /// The exact value of a number that is `bits` now; None where it is not finite.
    pub fn value(&self, at: Element, format: Number, bits: u64) -> Option<Exact> {
        self.shadow(at, format, bits).cloned().or_else(|| of_bits(format, bits))
    }

    fn shadow(&self, at: Element, format: Number, bits: u64) -> Option<&Exact> {
        let value = self.values.get(&(at.place, at.at))?;
        (value.format == format && value.bits == bits).then_some(&value.exact)
    }

    /// Follows an instruction. Those of a recording are to be given all, in their order.
    pub fn step(&mut self, step: &Step) -> StepError {
        let operations = match model(step) {
            Ok(operations) => operations,
            Err(unknown) => {
                let restarted = self.end(&written(step));
                let (operations, errors, overturned) = Default::default();
                return StepError { operations, check: Err(unknown), errors, overturned, restarted };
            }
        };
        let check = check(step, &operations);
        let to: Vec<_> = operations.iter().filter(|operation| !is_kept(operation)).map(|o| o.to).collect();
        let mut made = Made::default();
        if check.differences.is_empty() {
            self.compute(step, &operations, &mut made);
            self.copy(step, &operations, &mut made);
            self.end(&to);
            self.values.extend(made.values.into_iter().map(|(at, value)| ((at.place, at.at), value)));
        } else {
            let wrong = check.differences.iter().map(|difference| difference.at);
            made.restarted = self.end(&to.into_iter().chain(wrong).collect::<Vec<_>>());
        }
        let Made { errors, overturned, restarted, .. } = made;
        StepError { operations, check: Ok(check), errors, overturned, restarted }
    }

    /// Ends the shadows of these elements, and gives those that had one.
    fn end(&mut self, elements: &[Element]) -> Vec<Element> {
        let mut ended = Vec::new();
        for element in elements {
            let keys: Vec<_> = self.overlapping(element).map(|(at, _)| (at.place, at.at)).collect();
            if !keys.is_empty() {
                ended.push(*element);
            }
            for key in keys {
                self.values.remove(&key);
            }
        }
        ended
    }

    fn overlapping(&self, element: &Element) -> impl Iterator<Item = (Element, &Value)> {
        // No number is longer than 64 bits.
        let keys = (element.place, element.at.saturating_sub(63))..(element.place, element.end());
        let elements = self
            .values
            .range(keys)
            .map(|(&(place, at), value)| (Element { place, at, bits: 8 * value.format.bytes() }, value));
        elements.filter(|(at, _)| at.overlaps(element))
    }

    /// The shadows in an element, of which the step still finds the numbers.
    fn alive(&self, step: &Step, element: &Element) -> impl Iterator<Item = (Element, &Value)> {
        let shadows: Vec<_> = self.overlapping(element).collect();
        shadows.into_iter().filter(|(at, value)| model::before(step, *at) == value.bits)
    }

    /// All operations but copies.
    fn compute(&self, step: &Step, operations: &[Operation], made: &mut Made) {
        for (place, operation) in operations.iter().enumerate() {
            if operation.sources().any(|source| self.has_another_sign(step, source)) {
                made.overturned.push(place);
            }
            let overturned = match operation.what {
                What::Float(format, float) => self.float(step, operation, format, float, made),
                What::Convert(of, to @ (Number::Single | Number::Double)) => {
                    self.convert(step, operation, of, to, made);
                    false
                }
                What::Convert(of, to) => {
                    self.restart(step, operation, made);
                    let found = to.value(model::result(step, operation));
                    let exact = self.shadow(operation.from[0], of, model::before(step, operation.from[0]));
                    exact.is_some_and(|exact| !exact::is_whole(exact, found, None))
                }
                What::Compare(format, predicate) => self.compares_otherwise(step, operation, format, predicate),
                What::Logic(table) => {
                    self.logic(step, operation, table, made);
                    false
                }
                What::Computed(_) | What::Found => {
                    self.restart(step, operation, made);
                    false
                }
                What::Copy => false,
            };
            if overturned {
                made.overturned.push(place);
            }
        }
    }

    /// Whether it is the sign of a number whose exact value has the other.
    fn has_another_sign(&self, step: &Step, bit: &Element) -> bool {
        let other = |(at, value): (Element, &Value)| {
            at.end() == bit.end()
                && if model::before(step, *bit) == 1 { value.exact.is_positive() } else { value.exact.is_negative() }
        };
        bit.bits == 1 && self.alive(step, bit).any(other)
    }

    /// The result of an operation begins anew, which is worth saying where a number with a shadow went into it.
    fn restart(&self, step: &Step, operation: &Operation, made: &mut Made) {
        if operation.from.iter().any(|source| source.bits > 1 && self.alive(step, source).next().is_some()) {
            made.restarted.push(operation.to);
        }
    }

    /// Gives whether exact values would have chosen otherwise.
    fn float(&self, step: &Step, operation: &Operation, format: Number, float: Float, made: &mut Made) -> bool {
        let to = operation.to;
        let bits: Vec<u64> = operation.from.iter().map(|&element| model::before(step, element)).collect();
        let result = model::result(step, operation);
        if let (Float::Min | Float::Max, Some(chosen)) = (float, bits.iter().rposition(|&bits| bits == result)) {
            made.moved(to, format, result, self.shadow(operation.from[chosen], format, result).cloned());
            return self.chooses_otherwise(operation, format, float == Float::Min, &bits, chosen);
        }
        let shadows = operation.from.iter().zip(&bits).map(|(&from, &bits)| self.shadow(from, format, bits).cloned());
        let shadows: Vec<Option<Exact>> = shadows.collect();
        let rounded: Option<Vec<Exact>> = bits.iter().map(|&bits| of_bits(format, bits)).collect();
        let Some(rounded) = rounded.filter(|_| format.value(result).is_finite()) else {
            made.moved(to, format, result, None);
            made.restarted.extend(shadows.iter().any(Option::is_some).then_some(to));
            return false;
        };
        if let Float::Round(rounding) = float {
            made.moved(to, format, result, None);
            made.restarted.extend(shadows[0].is_some().then_some(to));
            return shadows[0].as_ref().is_some_and(|x| !exact::is_whole(x, format.value(result), Some(rounding)));
        }
        let of_rounded = exact::float(float, &rounded).expect("the CPU has a finite result too");
        let made_of_exact = if shadows.iter().all(Option::is_none) {
            Some((of_rounded.clone(), None))
        } else {
            let operands: Vec<_> = shadows.into_iter().zip(rounded).map(|(x, rounded)| x.unwrap_or(rounded)).collect();
            exact::float(float, &operands).map(|exact| (exact, Some(of_rounded)))
        };
        match made_of_exact {
            Some((exact, of_rounded)) => {
                let operands: Vec<f64> = bits.iter().map(|&bits| format.value(bits)).collect();
                let cancelled = binary_digits_lost(format, float, &operands, format.value(result));
                made.computed(to, format, result, exact, of_rounded, cancelled);
            }
            None => {
                // Exact operands would divide by 0, or ask for the root of what is negative.
                made.moved(to, format, result, None);
                made.restarted.push(to);
            }
        }
        false
    }

    /// Whether exact values would have a minimum or maximum choose the other operand.
    fn chooses_otherwise(&self, of: &Operation, format: Number, least: bool, bits: &[u64], chosen: usize) -> bool {
        let other = 1 - chosen;
        let shadow = |index: usize| self.shadow(of.from[index], format, bits[index]);
        if shadow(0).is_none() && shadow(1).is_none() {
            return false;
        }
        let value = |index: usize| self.value(of.from[index], format, bits[index]);
        match (value(chosen), value(other)) {
            (Some(chosen), Some(other)) => {
                if least {
                    other < chosen
                } else {
                    other > chosen
                }
            }
            _ => false,
        }
    }

    /// Into a floating-point format.
    fn convert(&self, step: &Step, operation: &Operation, of: Number, to: Number, made: &mut Made) {
        let from = operation.from[0];
        let bits = model::before(step, from);
        let result = model::result(step, operation);
        let is_float = matches!(of, Number::Single | Number::Double);
        self.restart(step, operation, made);
        if is_float {
            made.restarted.retain(|&restarted| restarted != operation.to);
        }
        let rounded = if is_float { of_bits(of, bits) } else { Some(of_integer(of, bits)) };
        match rounded.filter(|_| to.value(result).is_finite()) {
            Some(rounded) => match self.shadow(from, of, bits) {
                Some(exact) => made.computed(operation.to, to, result, exact.clone(), Some(rounded), None),
                None => made.computed(operation.to, to, result, rounded, None, None),
            },
            None => made.moved(operation.to, to, result, None),
        }
    }

    /// Whether exact values would compare otherwise.
    fn compares_otherwise(&self, step: &Step, operation: &Operation, format: Number, predicate: u8) -> bool {
        let found = |&from: &Element| (from, format, model::before(step, from));
        let shadowed = |(from, format, bits)| self.shadow(from, format, bits).is_some();
        if !operation.from.iter().map(found).any(shadowed) {
            return false;
        }
        let mut values = operation.from.iter().map(found).map(|(from, format, bits)| self.value(from, format, bits));
        let (Some(Some(a)), Some(Some(b))) = (values.next(), values.next()) else { return false };
        let holds = model::result(step, operation) & 1 == 1;
        model::holds(predicate, a.partial_cmp(&b)) != holds
    }

    /// Bits selected by others keep their shadow, with another sign if that is what was done to them.
    fn logic(&self, step: &Step, operation: &Operation, table: u8, made: &mut Made) {
        let has = |bits, format| {
            operation.from.iter().any(|source| {
                self.alive(step, source).any(|(at, value)| value.format == format && (at.at - source.at) % bits == 0)
            })
        };
        if operation.from.iter().all(|source| self.alive(step, source).next().is_none()) {
            return;
        }
        let format = if operation.to.bits == 64 && has(64, Number::Double) { Number::Double } else { Number::Single };
        let bits = 8 * format.bytes();
        for first in (0..operation.to.bits).step_by(bits as usize) {
            let part = |element: &Element| Element { at: element.at + u64::from(first), bits, ..*element };
            let from: Vec<_> = operation.from.iter().map(part).collect();
            let words: Vec<_> = from.iter().map(|&element| model::before(step, element)).collect();
            let result = logic(table, &words) & (u64::MAX >> (64 - bits));
            // The bits of the result that depend on those of one operand.
            let dependent = |index: usize| {
                let mut other = words.clone();
                other[index] = !other[index];
                (logic(table, &words) ^ logic(table, &other)) & (u64::MAX >> (64 - bits))
            };
            let shadowed = |index: &usize| self.alive(step, &from[*index]).next().is_some();
            let made_of: Vec<_> =
                (0..from.len()).filter(shadowed).filter(|&index| dependent(index) & !format.sign() != 0).collect();
            let &[index] = &made_of[..] else {
                if !made_of.is_empty() {
                    made.restarted.push(part(&operation.to));
                }
                continue;
            };
            let all = u64::MAX >> (64 - bits);
            let exact = self.shadow(from[index], format, words[index]).and_then(|exact| {
                let changed = result ^ words[index];
                match dependent(index) {
                    _ if changed & !format.sign() != 0 => None,
                    bits if bits == all => Some(if changed == 0 { exact.clone() } else { -exact }),
                    bits if bits == all ^ format.sign() => {
                        Some(if result & format.sign() == 0 { exact.abs() } else { -&exact.abs() })
                    }
                    _ => None,
                }
            });
            match exact {
                Some(exact) => made.moved(part(&operation.to), format, result, Some(exact)),
                None => made.restarted.push(part(&operation.to)),
            }
        }
    }

    /// Moves shadows. Neighbours that are copied to neighbours are one copy, so that it does not matter in which pieces an
    /// instruction moves a number.
    fn copy(&self, step: &Step, operations: &[Operation], made: &mut Made) {
        let mut spans: Vec<(Element, Element)> = Vec::new();
        for operation in operations.iter().filter(|o| o.what == What::Copy && !is_kept(o)) {
            let (to, from) = (operation.to, operation.from[0]);
            match spans.last_mut() {
                Some((last_to, last_from))
                    if (last_to.place, last_from.place) == (to.place, from.place)
                        && last_to.end() == to.at
                        && last_from.end() == from.at =>
                {
                    last_to.bits += to.bits;
                    last_from.bits += from.bits;
                }
                _ => spans.push((to, from)),
            }
        }
        for (to, from) in spans {
            for (at, value) in self.alive(step, &from) {
                if at.at >= from.at && at.end() <= from.end() {
                    let to = Element { place: to.place, at: to.at + (at.at - from.at), bits: at.bits };
                    made.moved(to, value.format, value.bits, Some(value.exact.clone()));
                } else {
                    made.restarted.push(to);
                }
            }
        }
    }
}

/// Whether an operation only says that an element stays.
fn is_kept(operation: &Operation) -> bool {
    operation.what == What::Copy && operation.from[0] == operation.to
}

/// What an instruction writes of which there is no model: whole registers, and the memory that was recorded.
fn written(step: &Step) -> Vec<Element> {
    let writes =
        |access| !matches!(access, OpAccess::None | OpAccess::Read | OpAccess::CondRead | OpAccess::NoMemAccess);
    let raw = model::decode(step);
    let mut factory = InstructionInfoFactory::new();
    let registers = factory.info(&raw).used_registers().iter().filter(|used| writes(used.access()));
    let places = registers.filter_map(|used| model::place(used.register()));
    let memory = step.touched.map(|touched| Element::new(Place::Memory, touched.address, touched.bytes.into()));
    places.map(|place| Element::new(place, 0, 64)).chain(memory).collect()
}
