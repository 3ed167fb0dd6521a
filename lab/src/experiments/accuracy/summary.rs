//! The results of each engine over all scenes, and why the program has engines that are on no
//! Pareto front.

use serde::{Deserialize, Serialize};

use super::{Accuracy, Label};
use crate::measure::Name;

/// The results of an engine, precision and output over all scenes.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    pub who: Label,
    pub scenes: usize,
    /// Wrong hits outside of the margin, in all scenes.
    pub wrong_hits: usize,
    pub wrong_objects: usize,
    pub max_ulp: Option<f64>,
    pub bound_share: Option<f64>,
    /// Pixels off by two levels or more, in all scenes.
    pub off_by_2: usize,
    pub max_colour: Option<f64>,
    /// The geometric mean over the scenes of the fastest run's nanoseconds per ray.
    pub ns_per_ray: f64,
    pub fronts: usize,
}

/// An entry that is on no front, with the reason why the program has it.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub struct Reason {
    #[serde(flatten)]
    pub who: Label,
    /// The reason in one sentence.
    pub reason: Name,
}

/// The summary of the rows of each entry, in the order in which entries first appear.
pub fn summaries<'a>(rows: impl IntoIterator<Item = &'a Accuracy>) -> Vec<Summary> {
    let mut groups: Vec<Vec<&Accuracy>> = Vec::new();
    for row in rows {
        match groups.iter_mut().find(|group| group[0].who == row.who) {
            Some(group) => group.push(row),
            None => groups.push(vec![row]),
        }
    }
    let summary = |group: &Vec<&Accuracy>| {
        let sum = |of: fn(&Accuracy) -> usize| group.iter().map(|row| of(row)).sum();
        let largest = |of: fn(&Accuracy) -> Option<f64>| group.iter().filter_map(|row| of(row)).reduce(f64::max);
        let logarithms: f64 = group.iter().map(|row| row.ns_per_ray.ln()).sum();
        Summary {
            who: group[0].who.clone(),
            scenes: group.len(),
            wrong_hits: sum(|row| row.errors.wrong_hits),
            wrong_objects: sum(|row| row.errors.wrong_objects),
            max_ulp: largest(|row| row.errors.max_ulp),
            bound_share: largest(|row| row.errors.bound_share),
            off_by_2: sum(|row| row.errors.off_by_2),
            max_colour: largest(|row| row.errors.max_colour),
            ns_per_ray: (logarithms / group.len() as f64).exp(),
            fronts: sum(|row| row.front.into()),
        }
    };
    groups.iter().map(summary).collect()
}

/// Every entry that is on no front, with the reason why the program has it.
pub fn off_every_front(rows: &[Accuracy]) -> Vec<Reason> {
    let off = summaries(rows).into_iter().filter(|summary| summary.fronts == 0);
    off.map(|Summary { who, .. }| Reason { reason: reason(&who).into(), who }).collect()
}

/// Why the program has an engine and precision although another may be as accurate and faster.
pub fn reason(who: &Label) -> &'static str {
    match (&*who.engine, &*who.precision, &*who.output) {
        _ if who.option.is_some() => {
            "It does all that the plan leaves out: the same bytes in more time, which is what leaving out is worth."
        }
        ("reference", ..) => "It is what the others are tested against, written to be read, and runs on any machine.",
        ("rust", ..) => "It is the yardstick of what plain Rust gives, a ray at a time.",
        ("portable", "double", _) => "It is the answer in f64 where there is no assembly.",
        ("portable", ..) => "It is the fastest where there is no assembly.",
        ("c", ..) => "It is the paper's C, kept as it is so that its time and its errors can be seen.",
        ("paper", ..) => "It is the paper's SIMD, kept as it is so that its time and its errors can be seen.",
        ("sse41", "double", _) => "It is the answer in f64 for a CPU that has neither AVX2 nor AVX-512.",
        ("sse41", ..) => "It is the fastest on a CPU that has neither AVX2 nor AVX-512.",
        ("avx2", "double", _) => "It is the answer in f64 for a CPU without AVX-512.",
        ("avx2", ..) => "It is the fastest on a CPU without AVX-512.",
        (_, "fast", _) => "It costs one root and one division less for each light, which counts where there are many.",
        (_, "double", "rgb8") => "It is for those who want each 8-bit level to be that of exact arithmetic.",
        (_, "double", _) => "It has the same errors at the stiffest scene as at the easiest.",
        _ => "It is the default: as right as f32 can be at a fraction of the time.",
    }
}
