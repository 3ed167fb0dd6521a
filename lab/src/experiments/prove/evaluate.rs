//! Evaluates expressions for given inputs, by the arithmetic of the model of the CPU.

use std::collections::HashMap;

use super::graph::{self, Expression, Logic, Node};
use super::symbol::Path;
use crate::experiments::step::model::{self, Float};

/// The bits of a symbol that is no argument, such as a register that the caller did not set: they
/// are a NaN.
const UNSET: u64 = 0x7fc0_dead;

/// Evaluates expressions for given inputs.
pub struct Evaluator<'a> {
    /// The bits of each input, by its name.
    inputs: &'a HashMap<String, u64>,
    known: HashMap<Node, u64>,
}

impl<'a> Evaluator<'a> {
    pub fn new(inputs: &'a HashMap<String, u64>) -> Self {
        Evaluator { inputs, known: HashMap::new() }
    }

    /// The results along the path whose conditions hold; None if there is no such path.
    pub fn results(&mut self, paths: &[Path]) -> Option<Vec<u64>> {
        let taken = paths.iter().find(|path| {
            path.conditions.iter().all(|condition| self.bits(condition.node) == u64::from(condition.holds))
        })?;
        Some(taken.results.iter().map(|node| self.bits(*node)).collect())
    }

    /// The value of a node: the bits of an expression, or 1 or 0 for a condition.
    pub fn bits(&mut self, node: Node) -> u64 {
        if let Some(&known) = self.known.get(&node) {
            return known;
        }
        let bits = self.computed(node);
        self.known.insert(node, bits);
        bits
    }

    fn computed(&mut self, node: Node) -> u64 {
        use Expression::*;
        let format = node.format();
        let sign = format.sign();
        let float = |float, operands: &[u64]| model::float(format, float, operands, || 0);
        match node.expression() {
            Constant(bits) => bits,
            Input(number) => self.inputs.get(&graph::name_of(number)).copied().unwrap_or(UNSET),
            Nan => {
                if format.bytes() == 8 {
                    f64::NAN.to_bits()
                } else {
                    f32::NAN.to_bits().into()
                }
            }
            Add(a, b) => float(Float::Add, &[self.bits(a), self.bits(b)]),
            Multiply(a, b) => float(Float::Mul, &[self.bits(a), self.bits(b)]),
            Divide(a, b) => float(Float::Div, &[self.bits(a), self.bits(b)]),
            Fma(a, b, c, product) => {
                float(Float::Fma { product, addend: false }, &[self.bits(a), self.bits(b), self.bits(c)])
            }
            Root(a) => float(Float::Sqrt, &[self.bits(a)]),
            Round(to, a) => float(Float::Round(to), &[self.bits(a)]),
            Negate(a) => self.bits(a) ^ sign,
            Magnitude(a) => self.bits(a) & !sign,
            CopySign(a, b) => self.bits(a) & !sign | self.bits(b) & sign,
            Sign(a) => self.bits(a) & sign,
            FlipSign(a, b) => self.bits(a) ^ self.bits(b) & sign,
            Convert(a) => model::convert(a.format(), format, self.bits(a)),
            Select(when, a, b) => {
                if self.bits(when) == 1 {
                    self.bits(a)
                } else {
                    self.bits(b)
                }
            }
            Bits(logic, a, b) => {
                let (a, b) = (self.bits(a), self.bits(b));
                match logic {
                    Logic::And => a & b,
                    Logic::Or => a | b,
                    Logic::Xor => a ^ b,
                }
            }
            Half(a, is_upper) => {
                if is_upper {
                    self.bits(a) >> 32
                } else {
                    self.bits(a) & 0xffff_ffff
                }
            }
            Pair(a, b) => self.bits(a) | self.bits(b) << 32,
            True => 1,
            Not(a) => 1 - self.bits(a),
            Both(a, b) => self.bits(a) & self.bits(b),
            Less(a, b) => u64::from(self.value(a) < self.value(b)),
            LessOrEqual(a, b) => u64::from(self.value(a) <= self.value(b)),
            Equal(a, b) => u64::from(self.value(a) == self.value(b)),
        }
    }

    fn value(&mut self, node: Node) -> f64 {
        node.format().value(self.bits(node))
    }
}
