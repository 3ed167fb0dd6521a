//! Numbers as expressions over inputs, each kept once, by rules that IEEE 754 makes exact.
//!
//! A node stands for the result of its operations for all values of the inputs; which NaN a NaN is,
//! it leaves open. Each rule below replaces an expression by an equal one, so that two computations
//! whose nodes are the same are equal for all inputs. A rule that holds only for some inputs or
//! uses is a lemma: its uses are counted, and [`that_read_bits`] finds the places where it would
//! not hold.
//!
//! The graph is local to a thread, so that nodes can be plain numbers with operators.

use std::cell::RefCell;
use std::collections::{HashMap, HashSet};

use crate::experiments::step::model::{Float, Number, Rounding, float, holds};

/// An expression, by its index in the graph of this thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Node(u32);

/// What a node is. Numbers have a format, single or double; conditions are true or false.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Expression {
    /// The bits of a number or of a mask.
    Constant(u64),
    /// An input, by the index of its name.
    Input(u32),
    /// Any NaN.
    Nan,
    Add(Node, Node),
    Multiply(Node, Node),
    Divide(Node, Node),
    /// a b + c or, with the flag, -(a b) + c, rounded once.
    Fma(Node, Node, Node, bool),
    Root(Node),
    Negate(Node),
    Magnitude(Node),
    /// The magnitude of the first number with the sign of the second.
    CopySign(Node, Node),
    /// The sign bit of a number, and no other bit.
    Sign(Node),
    /// The first number, negated where the second has its sign bit set.
    FlipSign(Node, Node),
    Round(Rounding, Node),
    /// A number converted to the other format.
    Convert(Node),
    /// The first number where the condition holds, else the second.
    Select(Node, Node, Node),
    /// A bitwise operation that no rule turns into an operation on numbers.
    Bits(Logic, Node, Node),
    /// The lower (false) or upper half of a double.
    Half(Node, bool),
    /// A double of two halves, the lower first.
    Pair(Node, Node),

    True,
    /// The negation of a condition.
    Not(Node),
    Both(Node, Node),
    /// a < b: false where either is NaN.
    Less(Node, Node),
    /// a <= b: false where either is NaN.
    LessOrEqual(Node, Node),
    /// a = b: false where either is NaN.
    Equal(Node, Node),
}
use Expression::*;

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Logic {
    And,
    Or,
    Xor,
}

/// A rule that does not hold for all numbers, but does in the places where it is used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Lemma {
    /// The sign bit of a root is 0, so that `or` can give the root a sign. This is false only of
    /// the root of -0, which is -0. But where the sum h + root is formed, with the sign of h, both
    /// zeros give the same sum.
    RootHasNoSign,
    /// The root of a number below 0 is NaN, and so is whatever is computed from it; no comparison
    /// with it holds.
    RootOfLessIsNan,
    /// Adding 0 to a sum changes at most the sign of a sum that is 0, and no comparison depends on
    /// that.
    ZeroHasNoEffect,
}

impl Lemma {
    pub const ALL: [Lemma; 3] = [Lemma::RootHasNoSign, Lemma::RootOfLessIsNan, Lemma::ZeroHasNoEffect];

    /// The name of the lemma in lists.
    pub fn name(self) -> &'static str {
        match self {
            Lemma::RootHasNoSign => "root-has-no-sign",
            Lemma::RootOfLessIsNan => "root-of-less-is-nan",
            Lemma::ZeroHasNoEffect => "zero-has-no-effect",
        }
    }
}

#[derive(Default)]
struct Graph {
    nodes: Vec<(Number, Expression)>,
    known: HashMap<(Number, Expression), Node>,
    names: Vec<String>,
    uses: [usize; Lemma::ALL.len()],
}

thread_local! {
    static GRAPH: RefCell<Graph> = RefCell::default();
}

/// Forgets all nodes of this thread.
pub fn clear() {
    GRAPH.take();
}

/// The number of nodes.
pub fn size() -> usize {
    GRAPH.with_borrow(|graph| graph.nodes.len())
}

/// Counts a use of a lemma.
pub fn count(lemma: Lemma) {
    GRAPH.with_borrow_mut(|graph| graph.uses[lemma as usize] += 1);
}

/// How often each lemma was used since the graph was cleared.
pub fn uses() -> [usize; Lemma::ALL.len()] {
    GRAPH.with_borrow(|graph| graph.uses)
}

pub fn name_of(input: u32) -> String {
    GRAPH.with_borrow(|graph| graph.names[input as usize].clone())
}

fn node(format: Number, expression: Expression) -> Node {
    GRAPH.with_borrow_mut(|graph| {
        let key = (format, expression);
        if let Some(&known) = graph.known.get(&key) {
            return known;
        }
        let node = Node(graph.nodes.len() as u32);
        graph.nodes.push(key);
        graph.known.insert(key, node);
        node
    })
}

fn condition(expression: Expression) -> Node {
    node(Number::Single, expression)
}

/// The constant of a format whose bits are all set.
fn ones(format: Number) -> u64 {
    u64::MAX >> (64 - 8 * format.bytes())
}

impl Node {
    /// The node with this number, as [`Node::number`] gave it.
    pub fn numbered(number: u32) -> Node {
        Node(number)
    }

    pub fn number(self) -> u32 {
        self.0
    }

    pub fn expression(self) -> Expression {
        GRAPH.with_borrow(|graph| graph.nodes[self.0 as usize].1)
    }

    /// The format of a number or, for a comparison, of its operands.
    pub fn format(self) -> Number {
        GRAPH.with_borrow(|graph| graph.nodes[self.0 as usize].0)
    }

    /// The bits of a constant.
    pub fn constant(self) -> Option<u64> {
        match self.expression() {
            Constant(bits) => Some(bits),
            _ => None,
        }
    }

    /// Whether the result is NaN for all inputs.
    pub fn is_nan(self) -> bool {
        match self.expression() {
            Nan => true,
            Constant(bits) => self.format().value(bits).is_nan(),
            _ => false,
        }
    }

    /// The nodes that this one is computed from.
    pub fn operands(self) -> Vec<Node> {
        match self.expression() {
            Constant(_) | Input(_) | Nan | True => vec![],
            Root(a) | Negate(a) | Magnitude(a) | Sign(a) | Round(_, a) | Convert(a) | Half(a, _) | Not(a) => vec![a],
            Add(a, b)
            | Multiply(a, b)
            | Divide(a, b)
            | CopySign(a, b)
            | FlipSign(a, b)
            | Bits(_, a, b)
            | Pair(a, b)
            | Both(a, b)
            | Less(a, b)
            | LessOrEqual(a, b)
            | Equal(a, b) => vec![a, b],
            Fma(a, b, c, _) | Select(a, b, c) => vec![a, b, c],
        }
    }

    /// This node and all nodes that it depends on, each once.
    pub fn all(self) -> Vec<Node> {
        let mut found = HashSet::from([self]);
        let mut open = vec![self];
        let mut all = Vec::new();
        while let Some(node) = open.pop() {
            all.push(node);
            open.extend(node.operands().into_iter().filter(|operand| found.insert(*operand)));
        }
        all
    }

    /// The operand of a negation; any other node itself.
    fn stripped(self) -> Node {
        match self.expression() {
            Negate(a) => a,
            _ => self,
        }
    }

    fn is_negated(self) -> bool {
        matches!(self.expression(), Negate(_))
    }
}

pub fn constant(format: Number, bits: u64) -> Node {
    node(format, Constant(bits & ones(format)))
}

pub fn zero(format: Number) -> Node {
    constant(format, 0)
}

pub fn input(format: Number, name: &str) -> Node {
    let place = GRAPH.with_borrow_mut(|graph| {
        let known = graph.names.iter().position(|known| known == name);
        known.unwrap_or_else(|| {
            graph.names.push(name.into());
            graph.names.len() - 1
        })
    });
    node(format, Input(place as u32))
}

pub fn nan(format: Number) -> Node {
    node(format, Nan)
}

/// The result for constant operands, by the model of the CPU; None if an operand is not constant.
fn folded(format: Number, operation: Float, operands: &[Node]) -> Option<Node> {
    let bits = operands.iter().map(|operand| operand.constant()).collect::<Option<Vec<_>>>()?;
    Some(constant(format, float(format, operation, &bits, || 0)))
}

/// Whether arithmetic on these operands gives NaN because one of them is NaN.
fn any_nan(operands: &[Node]) -> bool {
    operands.iter().any(|operand| operand.is_nan())
}

/// a + b = b + a, and a + -0 = a.
pub fn add(a: Node, b: Node) -> Node {
    let format = a.format();
    if any_nan(&[a, b]) {
        return nan(format);
    }
    if let Some(other) = [(a, b), (b, a)].iter().find(|(a, _)| a.constant() == Some(format.sign())) {
        return other.1;
    }
    folded(format, Float::Add, &[a, b]).unwrap_or_else(|| node(format, Add(a.min(b), a.max(b))))
}

/// a - b = a + (-b).
pub fn subtract(a: Node, b: Node) -> Node {
    add(a, negate(b))
}

/// a b = b a. Signs move out of products, and a factor of 1 with a sign gives that sign to the
/// other factor.
pub fn multiply(a: Node, b: Node) -> Node {
    let format = a.format();
    if any_nan(&[a, b]) {
        return nan(format);
    }
    if let Some(folded) = folded(format, Float::Mul, &[a, b]) {
        return folded;
    }
    let sign_of = |a: Node| match a.expression() {
        CopySign(one, sign) if one.constant().is_some_and(|bits| format.value(bits) == 1.0) => Some(sign),
        _ => None,
    };
    if let Some((x, sign)) = sign_of(a).map(|sign| (b, sign)).or(sign_of(b).map(|sign| (a, sign))) {
        return flip_sign(x, sign);
    }
    let is_negative = a.is_negated() != b.is_negated();
    let (a, b) = (a.stripped(), b.stripped());
    negate_if(is_negative, node(format, Multiply(a.min(b), a.max(b))))
}

/// The node of a / b. Signs are moved out of it, so that (-a) / b and a / (-b) become one node.
pub fn divide(a: Node, b: Node) -> Node {
    let format = a.format();
    if any_nan(&[a, b]) {
        return nan(format);
    }
    if let Some(folded) = folded(format, Float::Div, &[a, b]) {
        return folded;
    }
    let is_negative = a.is_negated() != b.is_negated();
    negate_if(is_negative, node(format, Divide(a.stripped(), b.stripped())))
}

/// a b + c, or c - a b, rounded once. Signs move out of the product, but not out of the sum: if the
/// sum is 0, they would change its sign.
pub fn fma(a: Node, b: Node, c: Node, is_negative: bool) -> Node {
    let format = a.format();
    if any_nan(&[a, b, c]) {
        return nan(format);
    }
    let operation = Float::Fma { product: is_negative, addend: false };
    if let Some(folded) = folded(format, operation, &[a, b, c]) {
        return folded;
    }
    let is_negative = is_negative ^ a.is_negated() ^ b.is_negated();
    let (a, b) = (a.stripped(), b.stripped());
    node(format, Fma(a.min(b), a.max(b), c, is_negative))
}

pub fn root(a: Node) -> Node {
    let format = a.format();
    if a.is_nan() {
        return nan(format);
    }
    folded(format, Float::Sqrt, &[a]).unwrap_or_else(|| node(format, Root(a)))
}

pub fn round(to: Rounding, a: Node) -> Node {
    let format = a.format();
    if a.is_nan() {
        return nan(format);
    }
    folded(format, Float::Round(to), &[a]).unwrap_or_else(|| node(format, Round(to, a)))
}

/// A single as a double, or a double rounded to a single.
pub fn convert(a: Node) -> Node {
    let (from, to) = match a.format() {
        Number::Single => (Number::Single, Number::Double),
        _ => (Number::Double, Number::Single),
    };
    match a.constant() {
        Some(bits) => constant(to, crate::experiments::step::model::convert(from, to, bits)),
        None if a.is_nan() => nan(to),
        None => node(to, Convert(a)),
    }
}

/// -(-a) = a. The negation of a choice one of whose numbers is constant becomes a choice of
/// negations.
pub fn negate(a: Node) -> Node {
    let format = a.format();
    match a.expression() {
        Constant(bits) => constant(format, bits ^ format.sign()),
        Negate(a) => a,
        Nan => a,
        Select(when, b, c) if b.constant().or(c.constant()).is_some() => select(when, negate(b), negate(c)),
        _ => node(format, Negate(a)),
    }
}

fn negate_if(turns: bool, a: Node) -> Node {
    if turns { negate(a) } else { a }
}

/// |a|. Operations that only change the sign of a are left out.
pub fn magnitude(a: Node) -> Node {
    let format = a.format();
    match a.expression() {
        Constant(bits) => constant(format, bits & !format.sign()),
        Negate(b) | CopySign(b, _) | FlipSign(b, _) => magnitude(b),
        Magnitude(_) | Nan => a,
        _ => node(format, Magnitude(a)),
    }
}

pub fn copy_sign(magnitude_of: Node, sign_of: Node) -> Node {
    let format = magnitude_of.format();
    let plain = match magnitude_of.expression() {
        Negate(a) | Magnitude(a) | CopySign(a, _) | FlipSign(a, _) => a,
        _ => magnitude_of,
    };
    match sign_of.expression() {
        Constant(bits) => negate_if(bits & format.sign() != 0, magnitude(plain)),
        Sign(of) | CopySign(_, of) => node(format, CopySign(plain, of)),
        _ if plain.is_nan() => plain,
        _ => node(format, CopySign(plain, sign_of)),
    }
}

/// A number, negated where another has its sign bit. A number without a sign gets that sign.
fn flip_sign(a: Node, sign_of: Node) -> Node {
    if has_no_sign(a) { copy_sign(a, sign_of) } else { node(a.format(), FlipSign(a, sign_of)) }
}

/// Whether the sign bit is clear unless the number is NaN: in magnitudes, and their rounded sums.
fn has_no_sign(a: Node) -> bool {
    match a.expression() {
        Magnitude(_) => true,
        Constant(bits) => bits & a.format().sign() == 0,
        Add(a, b) => has_no_sign(a) && has_no_sign(b),
        Round(_, a) => has_no_sign(a),
        _ => false,
    }
}

/// The minimum as x86 computes it: a where a < b, else b.
pub fn min(a: Node, b: Node) -> Node {
    select(less(a, b), a, b)
}

/// The maximum as x86 computes it: a where a > b, else b.
pub fn max(a: Node, b: Node) -> Node {
    select(less(b, a), a, b)
}

/// The first number where the condition holds, else the second. It is one of them if both are the
/// same or the condition is constant. Of two nested choices with the same second number it makes
/// one, by both conditions.
pub fn select(when: Node, a: Node, b: Node) -> Node {
    match when.expression() {
        True => return a,
        Not(contrary) if contrary.expression() == True => return b,
        Not(contrary) => return select(contrary, b, a),
        _ => {}
    }
    // An operand that is itself a choice by this condition is known here.
    let a = match a.expression() {
        Select(again, a, _) if again == when => a,
        _ => a,
    };
    let b = match b.expression() {
        Select(again, _, b) if again == when => b,
        _ => b,
    };
    match a.expression() {
        _ if a == b => a,
        Select(also, a, c) if c == b => select(both(when, also), a, b),
        _ => node(a.format(), Select(when, a, b)),
    }
}

/// All bits set where a condition holds, else no bit.
pub fn mask(format: Number, when: Node) -> Node {
    select(when, constant(format, ones(format)), zero(format))
}

pub fn yes() -> Node {
    condition(True)
}

pub fn no() -> Node {
    condition(Not(yes()))
}

pub fn truth(is: bool) -> Node {
    if is { yes() } else { no() }
}

pub fn not(a: Node) -> Node {
    match a.expression() {
        Not(a) => a,
        _ => condition(Not(a)),
    }
}

pub fn both(a: Node, b: Node) -> Node {
    if a == no() || b == no() || a == not(b) {
        no()
    } else if a == yes() || a == b {
        b
    } else if b == yes() {
        a
    } else {
        condition(Both(a.min(b), a.max(b)))
    }
}

pub fn either(a: Node, b: Node) -> Node {
    not(both(not(a), not(b)))
}

/// A sum, possibly with a flipped sign, without the zeros that were added to it. To a comparison it
/// is the same number.
fn without_zeros(a: Node) -> Node {
    let format = a.format();
    match a.expression() {
        Add(x, y) if x == zero(format) => without_zeros(y),
        Add(x, y) if y == zero(format) => without_zeros(x),
        Add(x, y) => add(without_zeros(x), without_zeros(y)),
        FlipSign(x, sign) => node(format, FlipSign(without_zeros(x), sign)),
        _ => a,
    }
}

/// A comparison of two numbers, for which -0 equals 0. It is decided if both are constants, and
/// false if one is NaN.
fn compare(a: Node, b: Node, is: fn(&f64, &f64) -> bool, make: fn(Node, Node) -> Expression) -> Node {
    let format = a.format();
    if any_nan(&[a, b]) {
        return no();
    }
    if let (Some(a), Some(b)) = (a.constant(), b.constant()) {
        return truth(is(&format.value(a), &format.value(b)));
    }
    let plain = |a: Node| {
        let plain = without_zeros(a);
        if plain != a {
            count(Lemma::ZeroHasNoEffect);
        }
        if plain.constant() == Some(format.sign()) { zero(format) } else { plain }
    };
    node(format, make(plain(a), plain(b)))
}

pub fn less(a: Node, b: Node) -> Node {
    compare(a, b, f64::lt, Less)
}

pub fn less_or_equal(a: Node, b: Node) -> Node {
    compare(a, b, f64::le, LessOrEqual)
}

pub fn equal(a: Node, b: Node) -> Node {
    let ordered = |a: Node, b: Node| Equal(a.min(b), a.max(b));
    compare(a, b, f64::eq, ordered)
}

/// A predicate of `vcmpps` as a combination of the comparisons less, equal and greater. A predicate
/// that holds for NaN is the negation of the one whose number differs in bit 2.
pub fn predicate(number: u8, a: Node, b: Node) -> Node {
    use std::cmp::Ordering;
    if holds(number, None) {
        return not(predicate(number ^ 4, a, b));
    }
    match [Ordering::Less, Ordering::Equal, Ordering::Greater].map(|order| holds(number, Some(order))) {
        [false, false, false] => no(),
        [true, false, false] => less(a, b),
        [false, true, false] => equal(a, b),
        [true, true, false] => less_or_equal(a, b),
        [false, false, true] => less(b, a),
        [false, true, true] => less_or_equal(b, a),
        [true, false, true] => either(less(a, b), less(b, a)),
        [true, true, true] => either(less_or_equal(a, b), less_or_equal(b, a)),
    }
}

/// Whether the sign bit of a number is set, as a condition; None where no rule gives such a
/// condition.
pub fn sign_bit(a: Node) -> Option<Node> {
    match a.expression() {
        Constant(bits) => Some(truth(bits & a.format().sign() != 0)),
        Select(when, b, c) => {
            let (b, c) = (sign_bit(b)?, sign_bit(c)?);
            Some(either(both(when, b), both(not(when), c)))
        }
        _ => None,
    }
}

/// A bitwise operation on two numbers of one format.
pub fn bits(logic: Logic, a: Node, b: Node) -> Node {
    let format = a.format();
    if a == b {
        return if logic == Logic::Xor { zero(format) } else { a };
    }
    by_constant(logic, a, b)
        .or_else(|| by_constant(logic, b, a))
        .or_else(|| by_choice(logic, a, b))
        .or_else(|| by_choice(logic, b, a))
        .or_else(|| by_sign(logic, a, b))
        .or_else(|| by_sign(logic, b, a))
        .unwrap_or_else(|| node(format, Bits(logic, a.min(b), a.max(b))))
}

/// A bitwise operation with a constant operand. If that has all bits or none, the result is an
/// operand or constant; if it is the sign bit, a negation or a sign; if it has all other bits, a
/// magnitude.
fn by_constant(logic: Logic, a: Node, b: Node) -> Option<Node> {
    let (format, bits) = (a.format(), a.constant()?);
    let all = ones(format);
    if let Some(other) = b.constant() {
        let bits = match logic {
            Logic::And => bits & other,
            Logic::Or => bits | other,
            Logic::Xor => bits ^ other,
        };
        return Some(constant(format, bits));
    }
    match logic {
        Logic::And | Logic::Or if bits == 0 || bits == all => {
            Some(if (logic == Logic::Or) == (bits == 0) { b } else { a })
        }
        Logic::Xor if bits == 0 => Some(b),
        Logic::Xor if bits == format.sign() => Some(negate(b)),
        Logic::And if bits == !format.sign() & all => Some(magnitude(b)),
        Logic::And if bits == format.sign() => Some(match b.expression() {
            Sign(_) => b,
            _ => node(format, Sign(b)),
        }),
        _ => None,
    }
}

/// A bitwise operation on a choice becomes a choice of results if one of the two numbers is
/// constant or, for xor, if `b` cancels in both.
fn by_choice(logic: Logic, a: Node, b: Node) -> Option<Node> {
    let Select(when, yes, no) = a.expression() else { return None };
    let pushes = match logic {
        Logic::Xor => cancels(yes, b) && cancels(no, b),
        _ => yes.constant().or(no.constant()).is_some(),
    };
    pushes.then(|| select(when, bits(logic, yes, b), bits(logic, no, b)))
}

/// Whether `a` xor `b` is simpler than `a`.
fn cancels(a: Node, b: Node) -> bool {
    match a.expression() {
        Constant(_) => true,
        Bits(Logic::Xor, x, y) => x == b || y == b,
        Select(_, x, y) => cancels(x, b) && cancels(y, b),
        _ => false,
    }
}

/// (x xor y) xor y = x. An operation with a sign bit alone becomes one on signs.
fn by_sign(logic: Logic, a: Node, b: Node) -> Option<Node> {
    match (logic, a.expression(), b.expression()) {
        (Logic::Xor, Bits(Logic::Xor, x, y), _) if y == b => Some(x),
        (Logic::Xor, Bits(Logic::Xor, x, y), _) if x == b => Some(y),
        (Logic::Xor, Sign(of), _) => Some(flip_sign(b, of)),
        (Logic::Or, Sign(of), Magnitude(_)) => Some(copy_sign(b, of)),
        (Logic::Or, Sign(of), Root(_)) => {
            count(Lemma::RootHasNoSign);
            Some(copy_sign(b, of))
        }
        _ => None,
    }
}

/// The bits of b that are not set in a.
pub fn without(a: Node, b: Node) -> Node {
    bits(Logic::And, bits(Logic::Xor, a, constant(a.format(), ones(a.format()))), b)
}

/// One half of a double.
pub fn half(a: Node, is_upper: bool) -> Node {
    match a.expression() {
        Constant(bits) => constant(Number::Single, if is_upper { bits >> 32 } else { bits }),
        Pair(lower, upper) => {
            if is_upper {
                upper
            } else {
                lower
            }
        }
        Select(when, b, c) if b.constant().is_some() && c.constant().is_some() => {
            select(when, half(b, is_upper), half(c, is_upper))
        }
        _ => node(Number::Single, Half(a, is_upper)),
    }
}

/// The double of two halves.
pub fn pair(lower: Node, upper: Node) -> Node {
    match (lower.expression(), upper.expression()) {
        (Constant(lower), Constant(upper)) => constant(Number::Double, lower | upper << 32),
        (Half(a, false), Half(b, true)) if a == b => a,
        (Select(when, a, b), Select(again, c, d)) if when == again => select(when, pair(a, c), pair(b, d)),
        (Select(when, a, b), Constant(_)) => select(when, pair(a, upper), pair(b, upper)),
        (Constant(_), Select(when, a, b)) => select(when, pair(lower, a), pair(lower, b)),
        _ => node(Number::Double, Pair(lower, upper)),
    }
}

/// The nodes in these results that depend on bits of a computed number that may be wrong for a NaN
/// or for the root of -0: on a half of the number, or on its sign. Left out are the sign of h in
/// h + root, and a sign that is given to what is NaN wherever the number is: they do not matter.
pub fn that_read_bits(results: &[Node]) -> Vec<Node> {
    let all: HashSet<Node> = results.iter().flat_map(|result| result.all()).collect();
    all.iter().copied().filter(|node| reads_bits(*node, results, &all)).collect()
}

/// Whether a number is computed from another by arithmetic alone, so that it is NaN where the other
/// one is.
pub fn is_nan_with(number: Node, other: Node) -> bool {
    let mut found = HashSet::new();
    let mut open = vec![number];
    while let Some(node) = open.pop() {
        if node == other {
            return true;
        }
        if let Add(..) | Multiply(..) | Divide(..) | Fma(..) | Root(_) | Negate(_) | Magnitude(_) | Round(..)
        | Convert(_) = node.expression()
        {
            open.extend(node.operands().into_iter().filter(|operand| found.insert(*operand)));
        }
    }
    false
}

/// Whether a node reads such bits of its operands. `all` are the nodes that the results depend on.
fn reads_bits(node: Node, results: &[Node], all: &HashSet<Node>) -> bool {
    let is_given = |node: Node| matches!(node.expression(), Input(_) | Constant(_));
    match node.expression() {
        Sign(a) | Half(a, _) => !is_given(a),
        Bits(_, a, b) | Pair(a, b) => !is_given(a) || !is_given(b),
        FlipSign(a, sign) => !is_given(sign) && !is_nan_with(a, sign),
        CopySign(magnitude_of, sign) => {
            let is_known = is_given(sign) || is_nan_with(magnitude_of, sign);
            let is_plain = is_known && !matches!(magnitude_of.expression(), Root(_));
            let sum = Add(node.min(sign), node.max(sign));
            let mut users = all.iter().filter(|user| user.operands().contains(&node));
            !is_plain && (results.contains(&node) || users.any(|user| user.expression() != sum))
        }
        _ => false,
    }
}
