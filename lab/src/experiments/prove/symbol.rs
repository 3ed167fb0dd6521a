//! The traits that twins compute by, implemented for symbols instead of numbers.
//!
//! A twin keeps numbers in records and in arrays of f32 or f64. There a symbol is a NaN whose bits
//! hold the number of its node and survive conversions between f32 and f64. A twin that branches on
//! a symbol is run several times: in one run the condition holds, in another it does not.

use std::cell::RefCell;
use std::cmp::Ordering;
use std::marker::PhantomData;
use std::ops::{Add, Div, Mul, Sub};

use super::graph::{self, Node};
use crate::experiments::step::model;
use rayo::internals::kernels::Element;
use rayo::internals::kernels::harness::lanes::{Lanes, Number};
use rayo::internals::reference::aos::Scalar;

/// Decides the branches on symbols during a run of a twin.
#[derive(Default)]
struct Oracle {
    /// For the first branches of this run, whether their conditions hold.
    plan: Vec<bool>,
    /// The conditions of the branches so far.
    decided: Vec<Condition>,
}

thread_local! {
    static ORACLE: RefCell<Oracle> = RefCell::default();
}

/// A condition of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Condition {
    pub node: Node,
    /// Whether it holds along the path.
    pub holds: bool,
}

/// A path through a computation: its conditions and its results.
#[derive(Clone, Debug)]
pub struct Path {
    pub conditions: Vec<Condition>,
    pub results: Vec<Node>,
}

/// Whether the condition of a branch holds in this run. If it is not constant, it holds in a first
/// run, and does not hold in a later one.
fn decide(condition: Node) -> bool {
    if condition == graph::yes() || condition == graph::no() {
        return condition == graph::yes();
    }
    ORACLE.with_borrow_mut(|oracle| {
        if let Some(decided) = oracle.decided.iter().find(|decided| decided.node == condition) {
            return decided.holds;
        }
        let holds = oracle.plan.get(oracle.decided.len()).copied().unwrap_or(true);
        oracle.decided.push(Condition { node: condition, holds });
        holds
    })
}

/// Runs a twin along every path.
pub fn paths(twin: impl Fn() -> Vec<Node>) -> Vec<Path> {
    let mut found = Vec::new();
    let mut plan = Some(Vec::new());
    while let Some(outcomes) = plan {
        ORACLE.set(Oracle { plan: outcomes, decided: Vec::new() });
        let results = twin();
        let conditions = ORACLE.take().decided;
        // In the next run the last condition that held is the first that does not hold.
        let mut next: Vec<bool> = conditions.iter().map(|condition| condition.holds).collect();
        while next.last() == Some(&false) {
            next.pop();
        }
        plan = next.pop().map(|_| [&next[..], &[false]].concat());
        found.push(Path { conditions, results });
    }
    found
}

/// Numbers that can carry a symbol in the bits of a NaN.
pub trait Carrier: Number {
    const FORMAT: model::Number;
    fn bits(self) -> u64;
    fn of_bits(bits: u64) -> Self;
    /// A NaN that stands for the node.
    fn symbol(node: Node) -> Self;
    /// The number of the node that the NaN stands for; None for an ordinary number.
    fn carried(self) -> Option<u32>;

    /// A symbol for the input of this name.
    fn named(name: &str) -> Self {
        Self::symbol(graph::input(Self::FORMAT, name))
    }

    /// The node that a number stands for. It is converted if the NaN has been converted from the
    /// other format.
    fn node(self) -> Node {
        let Some(number) = self.carried() else { return graph::constant(Self::FORMAT, self.bits()) };
        let node = Node::numbered(number);
        if node.format() == Self::FORMAT { node } else { graph::convert(node) }
    }
}

/// The bits of an f32 that mark a symbol, and the bits that hold the number of its node.
const MARK: u32 = 0x7fe0_0000;
const NUMBER: u32 = 0x001f_ffff;
/// The number's place in an f64: a conversion from f32 shifts the mantissa by so many bits.
const SHIFT: u32 = 29;

impl Carrier for f32 {
    const FORMAT: model::Number = model::Number::Single;

    fn bits(self) -> u64 {
        self.to_bits().into()
    }

    fn of_bits(bits: u64) -> Self {
        f32::from_bits(bits as u32)
    }

    fn symbol(node: Node) -> Self {
        assert!(node.number() <= NUMBER, "the graph is larger than a symbol can tell");
        f32::from_bits(MARK | node.number())
    }

    fn carried(self) -> Option<u32> {
        (self.to_bits() & !NUMBER == MARK).then_some(self.to_bits() & NUMBER)
    }
}

impl Carrier for f64 {
    const FORMAT: model::Number = model::Number::Double;

    fn bits(self) -> u64 {
        self.to_bits()
    }

    fn of_bits(bits: u64) -> Self {
        f64::from_bits(bits)
    }

    fn symbol(node: Node) -> Self {
        // Rust does not specify which NaN a conversion yields, so that it is done on bits.
        let single = f32::symbol(node).to_bits();
        f64::from_bits(0x7ff0_0000_0000_0000 | u64::from(single & 0x007f_ffff) << SHIFT)
    }

    fn carried(self) -> Option<u32> {
        let bits = self.to_bits();
        let single = (bits >> SHIFT) as u32 & 0x007f_ffff | 0x7f80_0000;
        (bits >> 52 == 0x7ff && bits & ((1 << SHIFT) - 1) == 0).then(|| f32::from_bits(single).carried()).flatten()
    }
}

/// A symbol as a packet of one lane. If `FUSED`, products and sums are rounded together.
#[derive(Clone, Copy, Debug)]
pub struct Symbol<E, const FUSED: bool>(pub Node, PhantomData<E>);

impl<E: Carrier, const FUSED: bool> Symbol<E, FUSED> {
    fn of_node(node: Node) -> Self {
        Symbol(node, PhantomData)
    }

    /// A symbol for the input of this name.
    pub fn named(name: &str) -> Self {
        Self::of_node(graph::input(E::FORMAT, name))
    }

    fn where_holds(condition: Node) -> Self {
        Self::of_node(graph::mask(E::FORMAT, condition))
    }

    /// A mask as a condition.
    fn is_set(self) -> Node {
        graph::sign_bit(self.0).expect("a mask is a choice between all bits and none")
    }

    /// The value of a constant. The closures of twins compute with values, and are never called
    /// with symbols.
    fn known(self) -> E {
        E::of_bits(self.0.constant().expect("no closure computes with symbols"))
    }
}

impl<E: Carrier, const FUSED: bool> Lanes for Symbol<E, FUSED> {
    type Number = E;
    const COUNT: usize = 1;
    const FUSED: bool = FUSED;

    fn from_fn(mut number: impl FnMut(usize) -> E) -> Self {
        Self::of_node(number(0).node())
    }

    fn lane(&self, _: usize) -> E {
        self.0.constant().map_or_else(|| E::symbol(self.0), E::of_bits)
    }

    fn load_bits(from: &[u32]) -> Self {
        let node = f32::from_bits(from[0]).node();
        Self::of_node(if E::FORMAT == model::Number::Double { graph::convert(node) } else { node })
    }

    fn store<F: Element>(self, to: &mut [F]) {
        // Converting the number converts the NaN that carries the symbol.
        to[0] = F::from_f64(self.lane(0).to_f64());
    }

    fn map(self, f: impl Fn(E) -> E) -> Self {
        Self::all(f(self.known()))
    }

    fn zip(self, other: Self, f: impl Fn(E, E) -> E) -> Self {
        Self::all(f(self.known(), other.known()))
    }

    fn greater(self, other: Self) -> Self {
        Self::where_holds(graph::less(other.0, self.0))
    }

    fn not_less(self, other: Self) -> Self {
        Self::where_holds(graph::less_or_equal(other.0, self.0))
    }

    fn equal(self, other: Self) -> Self {
        Self::where_holds(graph::equal(self.0, other.0))
    }

    fn and(self, other: Self) -> Self {
        Self::of_node(graph::bits(graph::Logic::And, self.0, other.0))
    }

    fn any(self) -> bool {
        decide(self.is_set())
    }

    fn select(self, a: Self, b: Self) -> Self {
        Self::of_node(graph::select(self.is_set(), a.0, b.0))
    }

    fn min(self, other: Self) -> Self {
        Self::of_node(graph::min(self.0, other.0))
    }

    fn max(self, other: Self) -> Self {
        Self::of_node(graph::max(self.0, other.0))
    }

    fn sqrt(self) -> Self {
        Self::of_node(graph::root(self.0))
    }

    fn abs(self) -> Self {
        Self::of_node(graph::magnitude(self.0))
    }

    fn negated(self) -> Self {
        Self::of_node(graph::negate(self.0))
    }

    fn with_sign_of(self, sign: Self) -> Self {
        Self::of_node(graph::copy_sign(self.0, sign.0))
    }

    fn floor(self) -> Self {
        Self::of_node(graph::round(model::Rounding::Down, self.0))
    }

    fn ceil(self) -> Self {
        Self::of_node(graph::round(model::Rounding::Up, self.0))
    }

    fn fma(self, a: Self, b: Self) -> Self {
        if FUSED { Self::of_node(graph::fma(a.0, b.0, self.0, false)) } else { self + a * b }
    }
}

/// A symbol as a scalar of the single-vector twins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScalarSymbol(pub Node);

impl ScalarSymbol {
    pub fn named(name: &str) -> Self {
        ScalarSymbol(graph::input(model::Number::Single, name))
    }
}

impl From<f32> for ScalarSymbol {
    fn from(x: f32) -> Self {
        ScalarSymbol(graph::constant(model::Number::Single, x.to_bits().into()))
    }
}

impl Scalar for ScalarSymbol {
    fn sqrt(self) -> Self {
        ScalarSymbol(graph::root(self.0))
    }

    fn abs(self) -> Self {
        ScalarSymbol(graph::magnitude(self.0))
    }
}

/// Each comparison is a branch.
impl PartialOrd for ScalarSymbol {
    fn partial_cmp(&self, _: &Self) -> Option<Ordering> {
        unreachable!("the twin compares by <, <=, > and >=")
    }

    fn lt(&self, other: &Self) -> bool {
        decide(graph::less(self.0, other.0))
    }

    fn le(&self, other: &Self) -> bool {
        decide(graph::less_or_equal(self.0, other.0))
    }

    fn gt(&self, other: &Self) -> bool {
        other < self
    }

    fn ge(&self, other: &Self) -> bool {
        other <= self
    }
}

macro_rules! operators {
    ($($operator:ident: $method:ident = $make:path;)*) => {$(
        impl<E: Carrier, const FUSED: bool> $operator for Symbol<E, FUSED> {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                Self::of_node($make(self.0, other.0))
            }
        }

        impl $operator for ScalarSymbol {
            type Output = Self;
            fn $method(self, other: Self) -> Self {
                ScalarSymbol($make(self.0, other.0))
            }
        }
    )*};
}
operators! {
    Add: add = graph::add;
    Sub: sub = graph::subtract;
    Mul: mul = graph::multiply;
    Div: div = graph::divide;
}
