//! Bounds of rounding errors, proved by counting the roundings of each term of a polynomial.
//!
//! A computation of products and sums is a polynomial of its inputs. A term that goes through k
//! roundings, each with a relative error of at most u, has a relative error of at most
//! (1 + u)^k - 1. The error of the whole is therefore at most the sum of these errors, each times
//! the magnitude of its term. The expressions come from the machine code, and the constants are
//! imported from where they are used. Underflow and overflow are not considered.

use std::collections::BTreeMap;

use serde::Serialize;

use super::graph::{Expression, Node};
use super::machine::Program;
use super::{Subject, alone, graph, operations, paths};
use crate::operands::HIT_ROUNDINGS;
use rayo::internals::kernels::harness::{shadows, spheres};
use rayo::internals::plan::EDGE_ROUNDINGS;

/// The unit roundoff u of f32: the largest relative error of a rounding.
const UNIT: f64 = f32::EPSILON as f64 / 2.0;

/// A constant that bounds rounding errors.
#[derive(Clone, Debug, Serialize)]
pub struct Bound {
    pub name: &'static str,
    /// The source file that has the constant.
    pub file: &'static str,
    /// The constant in the source, as a multiple of `unit`.
    pub constant: f64,
    /// The least constant that is proved to suffice on all instruction sets, as a multiple of
    /// `unit`.
    pub needed: f64,
    /// The unit of `constant` and `needed`: u is 2^-24 of the rounded value and w is 2^-53 of it;
    /// others, such as `pixels`, stand for themselves.
    pub unit: &'static str,
    /// How it is proved: `count`, `gappa`, `sollya` or `hand`.
    pub by: &'static str,
    pub holds: bool,
}

impl Bound {
    /// A bound holds if its constant is at least the one that is needed.
    pub fn new(
        name: &'static str,
        file: &'static str,
        constant: f64,
        needed: f64,
        unit: &'static str,
        by: &'static str,
    ) -> Bound {
        Bound { name, file, constant, needed, unit, by, holds: needed <= constant }
    }
}

/// The terms of a polynomial: each is a product of inputs, with the largest number of roundings
/// that it goes through.
pub type Terms = BTreeMap<Vec<Node>, i32>;

/// The terms of an expression; None if it is no polynomial. `of_input` gives the number of
/// roundings that an input has gone through before, by its name.
pub fn terms(of: Node, of_input: &dyn Fn(&str) -> i32) -> Option<Terms> {
    let product = |a: &Terms, b: &Terms| -> Terms {
        let mut product = Terms::new();
        for (x, m) in a {
            for (y, n) in b {
                let mut inputs = [&x[..], &y[..]].concat();
                inputs.sort();
                let most = product.entry(inputs).or_insert(0);
                *most = (*most).max(m + n);
            }
        }
        product
    };
    let sum = |a: Terms, b: Terms| {
        b.into_iter().fold(a, |mut sum, (term, n)| {
            let most = sum.entry(term).or_insert(n);
            *most = (*most).max(n);
            sum
        })
    };
    let rounded = |terms: Terms| terms.into_iter().map(|(term, n)| (term, n + 1)).collect();
    Some(match of.expression() {
        Expression::Input(place) => Terms::from([(vec![of], of_input(&graph::name_of(place)))]),
        Expression::Negate(a) => terms(a, of_input)?,
        Expression::Add(a, b) => rounded(sum(terms(a, of_input)?, terms(b, of_input)?)),
        Expression::Multiply(a, b) => rounded(product(&terms(a, of_input)?, &terms(b, of_input)?)),
        Expression::Fma(a, b, c, _) => {
            rounded(sum(product(&terms(a, of_input)?, &terms(b, of_input)?), terms(c, of_input)?))
        }
        _ => return None,
    })
}

/// (1 + u)^k - 1 for k roundings, in units of u.
fn error(roundings: i32) -> f64 {
    ((1.0 + UNIT).powi(roundings) - 1.0) / UNIT
}

/// The largest relative error of a term, in units of u, in all polynomials that a result chooses
/// from or compares.
fn most(result: Node, of_input: &dyn Fn(&str) -> i32) -> f64 {
    let is_sum = |node: &Node| matches!(node.expression(), Expression::Add(..) | Expression::Fma(..));
    let users: Vec<Node> = result.all().into_iter().filter(|node| !is_sum(node)).collect();
    // The sums that are not terms of other sums.
    let sums = users.iter().flat_map(|user| user.operands()).chain([result]).filter(is_sum);
    let counted = sums.filter_map(|sum| terms(sum, of_input)).flat_map(Terms::into_values);
    counted.map(error).fold(0.0, f64::max)
}

/// The largest `need` over all instruction sets and formats of the subjects with that name, for the
/// first result of each.
fn needed(subjects: &[Subject], name: &str, need: impl Fn(Node) -> f64) -> f64 {
    let mut most = 0.0_f64;
    let subjects: Vec<_> = subjects.iter().filter(|subject| subject.name == name).collect();
    assert!(!subjects.is_empty(), "no function is `{name}`");
    for subject in subjects {
        graph::clear();
        let paths = paths(subject, &Program::default()).expect("it is proved");
        most = most.max(need(paths.code[0].results[0]));
    }
    most
}

/// All bounds that are proved by counting. The numbers in records have been rounded once; pixel
/// coordinates are exact.
pub fn bounds() -> Vec<Bound> {
    let alone = alone::all();
    let mut packets = operations::all();
    packets.retain(|subject| subject.form == "packets");
    let of_record = |name: &str| i32::from(name.starts_with("record") || name.starts_with('b'));
    let bound = |name, file, constant, needed| Bound::new(name, file, constant, needed, "u", "count");
    // Relative to the bound's unit |a x| and |b y| are at most 1, and |c| is at most 2. The
    // coordinates x and y of points have been rounded once, as well as a, b and c.
    let of_caster = |edge: Node| {
        let terms = terms(edge, &|_| 1).expect("an edge is a polynomial");
        terms.iter().map(|(term, &n)| error(n) * if term.len() == 1 { 2.0 } else { 1.0 }).sum()
    };
    let edge = needed(&alone, "triangle_at", |edge| most(edge, &of_record));
    let d = needed(&alone, "sphere_at", |d| most(d, &of_record));
    vec![
        bound("edge over a tile", "src/plan/tiles.rs", EDGE_ROUNDINGS, edge),
        bound(
            "edge of a ray and a triangle",
            "lab/src/operands.rs",
            HIT_ROUNDINGS,
            needed(&packets, "triangle", |t| most(t, &of_record)),
        ),
        bound("D of a sphere, in f32", "src/kernels/portable/spheres.rs", spheres::ROUNDINGS / UNIT, d),
        bound(
            "edge of a caster",
            "src/kernels/portable/shadows.rs",
            shadows::CASTER_ROUNDINGS,
            needed(&alone, "caster_edge", of_caster),
        ),
    ]
}
