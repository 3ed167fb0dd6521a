//! What was found as a page: `docs/stability.md`.

use std::fmt::Write;

use super::table::{COLUMNS, costs, number, operations};
use crate::experiments::stability::Document;
use crate::render::Engine;
use crate::scene::families::{FAMILIES, family};

/// What a student should know first.
const EXPLANATION: &str = include_str!("explanation.md");

/// What stands before the table of costs.
const COSTS: &str = "\
### What stiffness costs

The time of a picture by that of the same picture of an ordinary scene, the two by turns: `scenes/sphere.in` with its sphere moved from
4 radii to 10⁴ and its film made as much smaller, and `scenes/sphere.in` and `scenes/tetrahedron.in` at 2⁻⁷⁰ of their size, where
the squares and products of lengths that `c` and `paper` take are denormal numbers or 0. Neither size nor distance costs the
packets anything: one sphere under one light has a short form, which makes neither a point nor a normal, and whose terms do not grow with κ (see
`SPHERE_LIT`). Only where its numbers are beyond f32, from some 10⁵ radii on, does a sphere take the general form, with a root, a normal and a
light for each pixel, in two to four times the time.

";

/// What stands before the table of operations.
const OPERATIONS: &str = "\
### The operations by themselves

`SPHERE_HIT3` and `TRIANGLE_HIT3`, which `rayo ops` counts, one object at a time. In S1, S3 and T5 the rays have any direction and the numbers are
such as no scene has: distances up to 10¹⁴ radii and units of length from 10⁻³⁰⁰ to 10³⁰⁰. In the others they are the rays and the
objects of the family's pictures, and in T6 its meshes that cover the picture: a hole is a ray that meets none of their triangles. Rays
are exact here, and so the bound has no part for a camera.

No hit is wrong and no t is beyond its bound, but for `sse41` in S1: without FMA the cross product of a far sphere is rounded twice. The bound is
that of the operation, u (5 + 6 / (√s (√s + e))) with s = D / (r² a) and e = |h| / (r √a), and not that of the engines, which is less next to a wall
that the camera is close to (S5, S6, S8): the operation has one form for all spheres, that of far ones, whose discriminant r² a − |c × d|² is right to
u of its terms where the other, h² − k a, is right to u k. The engines choose between them once per sphere, and subtract in f64; an operation that is to
be counted has no choice to make.
N1: no ray meets an object of which a number is NaN or infinite, and no NaN comes out.

";

/// The page: explanation, map, and a table for each family.
pub fn text(document: &Document) -> String {
    let mut text = EXPLANATION.to_owned();
    text += &families();
    let machine = &document.machine;
    let kind = if document.quick { "small pictures" } else { "at least 10⁵ rays for each value and engine" };
    let cpu = machine.cpu.as_deref().unwrap_or("an unknown CPU");
    writeln!(text, "## What was found\n\nOn {cpu}, seed {}, {kind}.\n", document.seed)
        .expect("a string takes any text");
    let absent: Vec<_> = Engine::ALL.iter().filter(|engine| !engine.usable()).map(|engine| engine.name()).collect();
    if !absent.is_empty() {
        writeln!(text, "This machine does not run {}, whose limits are checked where it runs.\n", absent.join(" and "))
            .expect("a string takes any text");
    }
    text += "![Every engine on every family](stability.svg)\n\n";
    for rows in document.rows.chunk_by(|a, b| a.family == b.family) {
        let Some(family) = family(rows[0].family) else { continue };
        writeln!(text, "### {}: {}\n", family.id, family.name).expect("a string takes any text");
        let heads: Vec<_> = COLUMNS.iter().map(|(head, _)| *head).collect();
        writeln!(text, "| engine | {} | slowdown |", heads.join(" | ")).expect("a string takes any text");
        writeln!(text, "|---|{}---|", "---|".repeat(heads.len())).expect("a string takes any text");
        for row in rows {
            let cells: Vec<_> = COLUMNS.iter().map(|(_, cell)| cell(row)).collect();
            let (engine, slowdown) = (format!("`{}` {}", row.engine, row.precision), number(row.slowdown));
            writeln!(text, "| {engine} | {} | {slowdown} |", cells.join(" | ")).expect("a string takes any text");
        }
        text += "\n";
    }
    if !document.costs.is_empty() {
        text += COSTS;
        text += &costs(&document.costs);
        text += "\n";
    }
    if !document.operations.is_empty() {
        text += OPERATIONS;
        text += &operations(&document.operations);
    }
    text.truncate(text.trim_end().len());
    text + "\n"
}

/// What the families are.
fn families() -> String {
    let mut text =
        "## The families\n\n| id | family | parameter | from, to | correct |\n|---|---|---|---|---|\n".to_owned();
    for family in FAMILIES {
        let (first, last) = (family.levels[0], family.levels[family.levels.len() - 1]);
        let (id, name, parameter, correct) = (family.id, family.name, family.parameter, family.correct);
        writeln!(text, "| {id} | {name} | {parameter} | {first}, {last} | {correct} |")
            .expect("a string takes any text");
    }
    text + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_in_docs_has_this_explanation_and_these_families_and_a_table_for_each() {
        let page = include_str!("../../../docs/stability.md");
        assert!(page.starts_with(&(EXPLANATION.to_owned() + &families())), "rayo stability --out docs makes it anew");
        for family in FAMILIES {
            assert!(page.contains(&format!("### {}: {}\n", family.id, family.name)), "{}", family.id);
        }
        assert!(!page.contains("BROKEN"));
    }
}
