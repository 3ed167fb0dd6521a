//! Whether two computations are equal for all inputs, path by path and case by case.

use std::collections::{BTreeMap, HashMap};

use super::graph::{self, Expression, Lemma, Node};
use super::symbol::{Condition, Path};

/// The assumptions of a case: for each of some comparisons whether it holds.
pub type Facts = BTreeMap<Node, bool>;

/// How many cases a proof may have before it is given up.
const MOST_CASES: usize = 2_000;

/// Why two computations are not proved to be equal.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Difference {
    /// The results differ where these facts hold, provided that some input fulfils them.
    Under(Facts),
    /// There are more than `MOST_CASES` cases.
    Cases,
}

/// Compares the results of two computations on each pair of their paths that one input can take.
/// Returns the number of pairs.
pub fn compare(machine: &[Path], twin: &[Path]) -> Result<usize, Difference> {
    let mut pairs = 0;
    let mut cases = 0;
    for ours in machine {
        for theirs in twin {
            let conditions = [&ours.conditions[..], &theirs.conditions[..]].concat();
            let Some(facts) = facts_of(&conditions).filter(|facts| agrees(&conditions, facts)) else { continue };
            pairs += 1;
            equal(&ours.results, &theirs.results, &facts, &mut cases)?;
        }
    }
    Ok(pairs)
}

/// The comparisons that hold, or do not hold, where all of these conditions do; None if no input
/// meets all conditions. A condition that either of two comparisons can fulfil gives no fact: with
/// fewer facts a proof is harder to find, but no less sound.
fn facts_of(conditions: &[Condition]) -> Option<Facts> {
    let mut facts = Facts::new();
    let mut open = conditions.to_vec();
    while let Some(Condition { node: condition, holds }) = open.pop() {
        match condition.expression() {
            Expression::True if holds => {}
            Expression::True => return None,
            Expression::Not(contrary) => open.push(Condition { node: contrary, holds: !holds }),
            Expression::Both(a, b) if holds => open.extend([a, b].map(|node| Condition { node, holds: true })),
            Expression::Both(..) => {}
            _ if facts.insert(condition, holds).is_some_and(|known| known != holds) => return None,
            _ => {}
        }
    }
    (!is_contradiction(&facts)).then_some(facts)
}

/// Whether facts about the same two numbers contradict each other.
fn is_contradiction(facts: &Facts) -> bool {
    let holds = |condition: Node| facts.get(&condition) == Some(&true);
    let fails = |condition: Node| facts.get(&condition) == Some(&false);
    facts.iter().any(|(&fact, &is_true)| match fact.expression() {
        Expression::Less(a, b) if is_true => {
            fails(graph::less_or_equal(a, b))
                || holds(graph::less(b, a))
                || holds(graph::less_or_equal(b, a))
                || holds(graph::equal(a, b))
        }
        Expression::Equal(a, b) if is_true => fails(graph::less_or_equal(a, b)) || fails(graph::less_or_equal(b, a)),
        // a <= b means that a < b or a = b, so that not both can be false.
        Expression::LessOrEqual(a, b) if is_true => fails(graph::less(a, b)) && fails(graph::equal(a, b)),
        _ => false,
    })
}

/// Whether the facts are compatible with all conditions: none of these is decided the other way.
fn agrees(conditions: &[Condition], facts: &Facts) -> bool {
    conditions.iter().all(|&Condition { node: condition, holds }| {
        let mut others = facts.clone();
        others.remove(&condition);
        simplified(condition, &others, &mut HashMap::new()) != graph::truth(!holds)
    })
}

/// Compares results under some facts. If two results differ and contain a comparison that the facts
/// do not decide, it compares them again under both answers to that comparison.
fn equal(ours: &[Node], theirs: &[Node], facts: &Facts, cases: &mut usize) -> Result<(), Difference> {
    *cases += 1;
    if *cases > MOST_CASES {
        return Err(Difference::Cases);
    }
    if is_contradiction(facts) {
        return Ok(());
    }
    let mut known = HashMap::new();
    let mut simplify =
        |nodes: &[Node]| nodes.iter().map(|&node| simplified(node, facts, &mut known)).collect::<Vec<_>>();
    let (ours, theirs) = (simplify(ours), simplify(theirs));
    let Some((a, b)) = ours.iter().zip(&theirs).find(|(a, b)| a != b && !(a.is_nan() && b.is_nan())) else {
        return Ok(());
    };
    let Some(condition) = innermost_comparison(*a).or_else(|| innermost_comparison(*b)) else {
        return Err(Difference::Under(facts.clone()));
    };
    for holds in [true, false] {
        let mut case = facts.clone();
        case.insert(condition, holds);
        equal(&ours, &theirs, &case, cases)?;
    }
    Ok(())
}

/// Whether some of these results depend on bits of a computed number that may be wrong for a NaN or
/// for the root of -0.
pub fn reads_bits_of_results(results: &[Node]) -> bool {
    graph::that_read_bits(results).into_iter().any(|node| !is_guarded(node, results))
}

/// Whether `node` takes the sign of a number, and there is a comparison that is false where that
/// number is NaN, and without which no result depends on the sign.
fn is_guarded(node: Node, results: &[Node]) -> bool {
    let Expression::FlipSign(_, sign) = node.expression() else { return false };
    let takes_sign = |node: Node| matches!(node.expression(), Expression::FlipSign(_, of) if of == sign);
    let fails_with_sign = |comparison: &Node| comparison.operands().iter().any(|&a| graph::is_nan_with(a, sign));
    let mut comparisons = results.iter().flat_map(|result| result.all()).filter(is_comparison).filter(fails_with_sign);
    comparisons.any(|comparison| {
        let facts = Facts::from([(comparison, false)]);
        let mut known = HashMap::new();
        let mut left = results.iter().flat_map(|result| simplified(*result, &facts, &mut known).all());
        !left.any(takes_sign)
    })
}

fn is_comparison(node: &Node) -> bool {
    use Expression::{Equal, Less, LessOrEqual};
    matches!(node.expression(), Less(..) | LessOrEqual(..) | Equal(..))
}

/// A comparison in an expression, one that contains no other comparison.
fn innermost_comparison(of: Node) -> Option<Node> {
    // Operands have lower numbers than the expressions that contain them.
    of.all().into_iter().filter(is_comparison).min()
}

/// An expression simplified by facts. If they make it NaN, it becomes NaN.
fn simplified(of: Node, facts: &Facts, known: &mut HashMap<Node, Node>) -> Node {
    use Expression::*;
    if let Some(&known) = known.get(&of) {
        return known;
    }
    let mut again = |node: Node| simplified(node, facts, known);
    let fact = |condition: Node| facts.get(&condition).map_or(condition, |&holds| graph::truth(holds));
    let result = match of.expression() {
        Constant(_) | Input(_) | Nan | True => of,
        Less(a, b) => fact(graph::less(again(a), again(b))),
        LessOrEqual(a, b) => fact(graph::less_or_equal(again(a), again(b))),
        Equal(a, b) => fact(graph::equal(again(a), again(b))),
        Not(a) => graph::not(again(a)),
        Both(a, b) => graph::both(again(a), again(b)),
        Select(when, a, b) => {
            let when = again(when);
            if when == graph::yes() {
                again(a)
            } else if when == graph::no() {
                again(b)
            } else {
                graph::select(when, again(a), again(b))
            }
        }
        Add(a, b) => graph::add(again(a), again(b)),
        Multiply(a, b) => graph::multiply(again(a), again(b)),
        Divide(a, b) => graph::divide(again(a), again(b)),
        Fma(a, b, c, is_negative) => graph::fma(again(a), again(b), again(c), is_negative),
        Root(a) => {
            let a = again(a);
            let is_at_least_0 = graph::less_or_equal(graph::zero(a.format()), a);
            if !a.is_nan() && facts.get(&is_at_least_0) == Some(&false) {
                graph::count(Lemma::RootOfLessIsNan);
                graph::nan(a.format())
            } else {
                graph::root(a)
            }
        }
        Negate(a) => graph::negate(again(a)),
        Magnitude(a) => graph::magnitude(again(a)),
        CopySign(a, b) => graph::copy_sign(again(a), again(b)),
        Round(to, a) => graph::round(to, again(a)),
        Convert(a) => graph::convert(again(a)),
        Bits(logic, a, b) => graph::bits(logic, again(a), again(b)),
        Half(a, is_upper) => graph::half(again(a), is_upper),
        Pair(a, b) => graph::pair(again(a), again(b)),
        Sign(_) | FlipSign(..) => of,
    };
    known.insert(of, result);
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::experiments::step::model::{Number, Rounding};

    #[test]
    fn the_sign_of_what_may_be_nan_matters_unless_it_is_guarded() {
        let [x, y, most] = ["x", "y", "most"].map(|name| graph::input(Number::Double, name));
        let sum = graph::add(x, y);
        let one = graph::constant(Number::Double, 1.0_f64.to_bits());
        let turned = graph::multiply(x, graph::copy_sign(one, sum));
        let rounded = graph::round(Rounding::Down, graph::add(graph::magnitude(sum), one));
        let chosen = |when: Node| graph::select(when, graph::multiply(turned, y), most);
        let size = graph::magnitude(sum);
        let cases = [
            ("the sign of a sum", turned, true),
            ("that of an input", graph::multiply(x, graph::copy_sign(one, y)), false),
            ("given to what is NaN with it", graph::copy_sign(rounded, sum), false),
            ("given to another number", graph::copy_sign(y, sum), true),
            ("where a comparison with it holds", chosen(graph::less(most, size)), false),
            ("where it holds, and another", chosen(graph::both(graph::less(x, y), graph::less(most, size))), false),
            ("where it does not hold", chosen(graph::not(graph::less(most, size))), true),
            ("where one of others holds", chosen(graph::less(most, y)), true),
        ];
        for (case, result, reads) in cases {
            assert_eq!(reads_bits_of_results(&[result]), reads, "{case}");
        }
        let guarded = chosen(graph::less(most, size));
        assert!(reads_bits_of_results(&[guarded, turned]), "one of two results is not guarded");
    }
}
