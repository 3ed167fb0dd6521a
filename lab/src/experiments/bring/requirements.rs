//! What has to hold for exit status 0: all checks, or what a grader names.

use std::str::FromStr;

use super::verdict::{Figures, Verdict};
use rayo::internals::scene::brief;

/// A check that has to hold.
#[derive(Debug)]
pub struct Check {
    name: &'static str,
    /// What does not hold, in words.
    what: &'static str,
    /// Whether it holds; None if it was not made.
    holds: fn(&Verdict) -> Option<bool>,
}

/// A figure that may be at most so large.
#[derive(Debug)]
pub struct Figure {
    name: &'static str,
    /// What follows its name, for example.
    example: &'static str,
    what: &'static str,
    /// None if it is not known.
    found: fn(&Verdict) -> Option<f64>,
}

/// A requirement of `--require`.
#[derive(Clone, Copy, Debug)]
pub enum Requirement {
    Holds(&'static Check),
    AtMost(&'static Figure, f64),
}

const fn check(name: &'static str, what: &'static str, holds: fn(&Verdict) -> Option<bool>) -> Check {
    Check { name, what, holds }
}

static CHECKS: [Check; 8] = [
    // Within the bounds of any order of operations.
    check("result", "the result", |verdict| verdict.result.holds),
    // Those of the twin, in one of its forms.
    check("same-bits", "the same bits", |verdict| verdict.result.holds.map(|_| verdict.result.same_bits.is_some())),
    // Infinities, NaN and denormal numbers.
    check("odd", "odd numbers", |verdict| verdict.odd.holds),
    check("fourth-lane", "the fourth lane", |verdict| verdict.fourth_lane.holds),
    check("aliasing", "arguments in one place", |verdict| verdict.aliasing.holds),
    check("convention", "the calling convention", |verdict| verdict.convention.holds),
    check("memory", "memory", |verdict| verdict.memory.holds),
    check("proof", "a proof", |verdict| Some(verdict.proof.holds == Some(true))),
];

const fn figure(
    name: &'static str,
    example: &'static str,
    what: &'static str,
    found: fn(&Verdict) -> Option<f64>,
) -> Figure {
    Figure { name, example, what, found }
}

static FIGURES: [Figure; 6] = [
    figure("ulp", "=2", "ulp", |verdict| verdict.result.max_ulp),
    figure("instructions", "=8", "instructions", |verdict| verdict.instructions.function.map(|n| n as f64)),
    figure("body", "=5", "instructions of the body", |verdict| verdict.instructions.body.map(|n| n as f64)),
    figure("executed", "=8", "executed instructions", |verdict| verdict.instructions.executed.map(|n| n as f64)),
    figure("cycles", "=1.0", "times the latency of `paper`", |verdict| ratio(verdict, |figures| figures.latency)),
    figure("throughput", "=1.0", "times the throughput of `paper`", |verdict| {
        ratio(verdict, |figures| figures.throughput)
    }),
];

/// A figure of the user's as a multiple of the paper's.
fn ratio(verdict: &Verdict, figure: fn(&Figures) -> Option<f64>) -> Option<f64> {
    Some(figure(&verdict.figures)? / verdict.against.get("paper").and_then(figure)?)
}

impl Requirement {
    /// What is required where nothing else is said: every check that a build can make. Without
    /// assembly it cannot check the calling convention.
    pub fn all_checks(has_assembly: bool) -> Vec<Requirement> {
        let not_asked: &[&str] =
            if has_assembly { &["same-bits", "proof"] } else { &["same-bits", "proof", "convention"] };
        CHECKS.iter().filter(|check| !not_asked.contains(&check.name)).map(Requirement::Holds).collect()
    }

    /// Whether it is one of these names.
    pub fn is_one_of(self, names: &[&str]) -> bool {
        match self {
            Requirement::Holds(check) => names.contains(&check.name),
            Requirement::AtMost(figure, _) => names.contains(&figure.name),
        }
    }

    /// Why it does not hold, or None if it does.
    pub fn broken_by(self, verdict: &Verdict) -> Option<String> {
        match self {
            Requirement::Holds(Check { what, holds, .. }) => match holds(verdict) {
                Some(true) => None,
                Some(false) => Some((*what).to_owned()),
                None => Some(format!("{what}: it was not checked")),
            },
            Requirement::AtMost(Figure { what, found, .. }, most) => match found(verdict) {
                // As a person reads them: three digits.
                Some(found) if found <= most * 1.0005 => None,
                Some(found) => {
                    Some(format!("{} {what}, of which there may be {most}", (found * 1000.0).round() / 1000.0))
                }
                None => Some(format!("{what}: not known here")),
            },
        }
    }
}

impl FromStr for Requirement {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, value) =
            text.trim().split_once('=').map_or((text.trim(), None), |(name, value)| (name, Some(value)));
        if let Some(check) = CHECKS.iter().find(|known| known.name == name) {
            return if value.is_none() { Ok(Self::Holds(check)) } else { Err(format!("`{name}` takes no number")) };
        }
        let Some(figure) = FIGURES.iter().find(|known| known.name == name) else {
            let figures = FIGURES.iter().map(|figure| format!("{}{}", figure.name, figure.example));
            let known: Vec<_> = CHECKS.iter().map(|check| check.name.to_owned()).chain(figures).collect();
            return Err(format!("expected one of {}, found `{}`", known.join(", "), brief(name)));
        };
        let number = value.and_then(|value| value.trim().parse().ok());
        let number = number.filter(|number: &f64| number.is_finite() && *number >= 0.0);
        let number = number.ok_or_else(|| format!("`{name}` needs a number, as in {name}{}", figure.example))?;
        Ok(Requirement::AtMost(figure, number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_convention_is_required_where_it_can_be_checked() {
        let is_asked = |required: &[Requirement]| required.iter().any(|check| check.is_one_of(&["convention"]));
        let [with, without] = [true, false].map(Requirement::all_checks);
        assert!(with.len() == 6 && is_asked(&with) && without.len() == 5 && !is_asked(&without));
    }

    #[test]
    fn requirements_are_names_with_or_without_a_number() {
        let parse = |text: &str| text.parse::<Requirement>().unwrap();
        assert!(matches!(parse("same-bits"), Requirement::Holds(check) if check.name == "same-bits"));
        assert!(matches!(parse(" ulp=2 "), Requirement::AtMost(figure, 2.0) if figure.name == "ulp"));
        for (text, said) in [
            ("", "expected one of result, same-bits"),
            ("bits", "expected one of result, same-bits"),
            ("ulp", "`ulp` needs a number, as in ulp=2"),
            ("ulp=x", "`ulp` needs a number"),
            ("ulp=-1", "`ulp` needs a number"),
            ("ulp=nan", "`ulp` needs a number"),
            ("memory=1", "`memory` takes no number"),
        ] {
            let error = text.parse::<Requirement>().unwrap_err();
            assert!(error.starts_with(said), "{text}: {error}");
        }
    }
}
