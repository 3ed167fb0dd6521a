//! Shadow values of numbers: what each number would be if nothing before it had been rounded.
//!
//! A number has a shadow if it differs from its exact value; a number without a shadow is itself
//! exact. So numbers from unwatched code count as exact. If unwatched code overwrites a number, its
//! shadow becomes invalid: each shadow has a copy of the bits of its number, and is ignored where
//! the bits differ. The path of execution is the CPU's: its comparisons, selections and masks stay
//! as they are, and are reported if exact values would decide differently.

mod exact;

use std::collections::BTreeMap;

use iced_x86::{InstructionInfoFactory, OpAccess};

use super::model::{self, Check, Element, Float, Number, Operation, Place, Unknown, What, check, logic, model};
use crate::exact::digits::Exact;
use crate::exact::number::Number as _;
use exact::{binary_digits_lost, of_bits, of_integer};
use rayo::internals::kernels::step::Step;

/// The shadows of registers and memory.
#[derive(Clone, Debug, Default)]
pub struct Shadow {
    /// The shadows by place and first bit. Their elements do not overlap.
    values: BTreeMap<(Place, u64), Value>,
}

#[derive(Clone, Debug)]
struct Value {
    format: Number,
    /// The bits of the number that the shadow belongs to.
    bits: u64,
    exact: Exact,
}

/// An executed instruction with its rounding errors.
pub struct ShadowedStep<'a> {
    pub step: Step<'a>,
    pub error: StepError,
}

/// The rounding errors of an instruction, and what the model says about it.
#[derive(Clone, Debug)]
pub struct StepError {
    /// The instruction's operations according to the model; empty if there is no model of it.
    pub operations: Vec<Operation>,
    /// The comparison of the model with the CPU. Where the model is wrong or missing, the shadows
    /// of the written elements are dropped.
    pub check: Result<Check, Unknown>,
    /// The error of each number that was computed or converted, and of each number with a shadow
    /// that was moved.
    pub errors: Vec<ElementError>,
    /// The indices of the operations that exact values would decide differently: comparisons,
    /// minima and maxima, selections by sign, and roundings to whole numbers.
    pub overturned: Vec<usize>,
    /// Results without a shadow although an operand has one: integers, single bytes, results of
    /// numbers that are not finite, and results that the model predicts wrongly. They count as
    /// exact from here on.
    pub restarted: Vec<Element>,
}

/// The error of a number that was written, in units of the last place of its format; the unit is
/// that of the larger of the number and its exact value.
#[derive(Clone, Debug)]
pub struct ElementError {
    pub at: Element,
    /// The value without rounding; None if it is not finite, in which case the errors are 0.
    pub exact: Option<Exact>,
    /// The number minus its exact value: the inherited error plus the added one.
    pub error: f64,
    /// The error that this instruction added by rounding its result. The rest is inherited: it is
    /// the unrounded result of the given operands minus that of the exact operands.
    pub added: f64,
    /// For sums, how many leading bits of the larger summand cancelled; all of them if the result
    /// is 0.
    pub cancelled: Option<u32>,
}

/// The shadows that an instruction makes. They are collected before the shadows of overwritten
/// elements are dropped.
#[derive(Default)]
struct NewShadows {
    values: Vec<(Element, Value)>,
    errors: Vec<ElementError>,
    overturned: Vec<usize>,
    restarted: Vec<Element>,
}

impl NewShadows {
    /// Records a copied number with its shadow, if it has one, or a number that counts as exact
    /// from here on.
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

    /// Records a computed number with its exact value. If its operands were not exact, `unrounded`
    /// is the result of the operands as they are, without rounding.
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
    /// No shadows: all numbers count as exact.
    pub fn new() -> Self {
        Shadow::default()
    }

    /// The exact value of a number whose bits are now `bits`; None if it is not finite.
    pub fn value(&self, at: Element, format: Number, bits: u64) -> Option<Exact> {
        self.shadow(at, format, bits).cloned().or_else(|| of_bits(format, bits))
    }

    fn shadow(&self, at: Element, format: Number, bits: u64) -> Option<&Exact> {
        let value = self.values.get(&(at.place, at.at))?;
        (value.format == format && value.bits == bits).then_some(&value.exact)
    }

    /// Updates the shadows by an instruction. It must be called for all instructions of a
    /// recording, in order.
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
        let mut made = NewShadows::default();
        if check.differences.is_empty() {
            self.compute(step, &operations, &mut made);
            self.copy(step, &operations, &mut made);
            self.end(&to);
            self.values.extend(made.values.into_iter().map(|(at, value)| ((at.place, at.at), value)));
        } else {
            let wrong = check.differences.iter().map(|difference| difference.at);
            made.restarted = self.end(&to.into_iter().chain(wrong).collect::<Vec<_>>());
        }
        let NewShadows { errors, overturned, restarted, .. } = made;
        StepError { operations, check: Ok(check), errors, overturned, restarted }
    }

    /// Drops the shadows of these elements, and returns the elements that had one.
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
        // A number has at most 64 bits, so that one that overlaps begins at most 63 bits earlier.
        let keys = (element.place, element.at.saturating_sub(63))..(element.place, element.end());
        let elements = self
            .values
            .range(keys)
            .map(|(&(place, at), value)| (Element { place, at, bits: 8 * value.format.bytes() }, value));
        elements.filter(|(at, _)| at.overlaps(element))
    }

    /// The shadows in an element that are valid: their numbers still have the bits that they belong
    /// to.
    fn alive(&self, step: &Step, element: &Element) -> impl Iterator<Item = (Element, &Value)> {
        let shadows: Vec<_> = self.overlapping(element).collect();
        shadows.into_iter().filter(|(at, value)| model::before(step, *at) == value.bits)
    }

    /// Computes the shadows of all operations except copies.
    fn compute(&self, step: &Step, operations: &[Operation], made: &mut NewShadows) {
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

    /// Whether a bit is the sign of a number whose exact value has the opposite sign.
    fn has_another_sign(&self, step: &Step, bit: &Element) -> bool {
        let other = |(at, value): (Element, &Value)| {
            at.end() == bit.end()
                && if model::before(step, *bit) == 1 { value.exact.is_positive() } else { value.exact.is_negative() }
        };
        bit.bits == 1 && self.alive(step, bit).any(other)
    }

    /// Makes the result of an operation count as exact, and records that if an operand had a
    /// shadow.
    fn restart(&self, step: &Step, operation: &Operation, made: &mut NewShadows) {
        if operation.from.iter().any(|source| source.bits > 1 && self.alive(step, source).next().is_some()) {
            made.restarted.push(operation.to);
        }
    }

    /// Computes the shadow of a floating-point result. Returns whether exact values would have
    /// selected the other operand.
    fn float(&self, step: &Step, operation: &Operation, format: Number, float: Float, made: &mut NewShadows) -> bool {
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
                // With exact operands this is a division by 0 or the root of a negative number.
                made.moved(to, format, result, None);
                made.restarted.push(to);
            }
        }
        false
    }

    /// Whether the minimum or maximum of the exact values is the other operand.
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

    /// Computes the shadow of a conversion to a floating-point format.
    fn convert(&self, step: &Step, operation: &Operation, of: Number, to: Number, made: &mut NewShadows) {
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

    /// Whether the comparison of the exact values has another outcome.
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

    /// Computes the shadow of a bitwise operation. A number that is selected keeps its shadow,
    /// which is negated if the number's sign bit was flipped.
    fn logic(&self, step: &Step, operation: &Operation, table: u8, made: &mut NewShadows) {
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
            // The bits of the result that depend on the operand `index`.
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

    /// Moves shadows. Copies of adjacent elements to adjacent places are joined to one copy, so
    /// that it does not matter in what pieces an instruction moves a number.
    fn copy(&self, step: &Step, operations: &[Operation], made: &mut NewShadows) {
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

/// Whether an operation copies an element to itself.
fn is_kept(operation: &Operation) -> bool {
    operation.what == What::Copy && operation.from[0] == operation.to
}

/// The elements that an instruction without a model writes: whole registers and the recorded
/// memory.
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
