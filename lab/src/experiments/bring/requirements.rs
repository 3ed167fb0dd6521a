//! What has to hold for exit status 0: all checks, or those that a grader names.

use std::str::FromStr;

use super::verdict::Verdict;
use rayo::internals::scene::brief;

/// A requirement of `--require`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Requirement {
    /// The results are within the bound of any order of operations.
    Result,
    /// The results have the same bits as the twin's, in one of its forms.
    SameBits,
    /// Infinities, NaN and denormal numbers too.
    Odd,
    FourthLane,
    Aliasing,
    Convention,
    Memory,
    Proof,
    /// At most so many units in the last place.
    Ulp(f64),
    /// At most so many instructions of the function, of its body, or executed.
    Instructions(f64),
    Body(f64),
    Executed(f64),
    /// The latency is at most so many times the paper's.
    Cycles(f64),
    /// The same of throughput.
    Throughput(f64),
}

/// A name of `--require`.
struct Name {
    name: &'static str,
    meaning: Meaning,
}

enum Meaning {
    Alone(Requirement),
    /// With a number: an example of one, and what it makes.
    OfNumber(&'static str, fn(f64) -> Requirement),
}

const fn alone(name: &'static str, requirement: Requirement) -> Name {
    Name { name, meaning: Meaning::Alone(requirement) }
}

const fn of_number(name: &'static str, example: &'static str, requirement: fn(f64) -> Requirement) -> Name {
    Name { name, meaning: Meaning::OfNumber(example, requirement) }
}

const NAMES: [Name; 14] = [
    alone("result", Requirement::Result),
    alone("same-bits", Requirement::SameBits),
    alone("odd", Requirement::Odd),
    alone("fourth-lane", Requirement::FourthLane),
    alone("aliasing", Requirement::Aliasing),
    alone("convention", Requirement::Convention),
    alone("memory", Requirement::Memory),
    alone("proof", Requirement::Proof),
    of_number("ulp", "=2", Requirement::Ulp),
    of_number("instructions", "=8", Requirement::Instructions),
    of_number("body", "=5", Requirement::Body),
    of_number("executed", "=8", Requirement::Executed),
    of_number("cycles", "=1.0", Requirement::Cycles),
    of_number("throughput", "=1.0", Requirement::Throughput),
];

impl Name {
    /// As one would write it.
    fn example(&self) -> String {
        match self.meaning {
            Meaning::Alone(_) => self.name.to_owned(),
            Meaning::OfNumber(example, _) => format!("{}{example}", self.name),
        }
    }
}

impl Requirement {
    /// What is required where nothing else is said: every check.
    pub const ALL_CHECKS: [Requirement; 6] = [
        Requirement::Result,
        Requirement::Odd,
        Requirement::FourthLane,
        Requirement::Aliasing,
        Requirement::Convention,
        Requirement::Memory,
    ];

    /// Whether it can be judged only with cycles or executed instructions.
    pub fn needs_figures(self) -> bool {
        matches!(self, Requirement::Cycles(_) | Requirement::Throughput(_) | Requirement::Executed(_))
    }

    /// Whether it asks for a proof.
    pub fn needs_proof(self) -> bool {
        self == Requirement::Proof
    }

    /// Why it does not hold, or None if it does.
    pub fn broken_by(self, verdict: &Verdict) -> Option<String> {
        let check = |holds: Option<bool>, what: &str| match holds {
            Some(true) => None,
            Some(false) => Some(what.to_owned()),
            None => Some(format!("{what}: it was not checked")),
        };
        let ratio = |figure: fn(&super::verdict::Figures) -> Option<f64>| {
            let paper = verdict.against.get("paper").and_then(figure)?;
            Some(figure(&verdict.figures)? / paper)
        };
        match self {
            Requirement::Result => check(verdict.result.holds, "the result"),
            Requirement::SameBits => {
                check(verdict.result.holds.map(|_| verdict.result.same_bits.is_some()), "the same bits")
            }
            Requirement::Odd => check(verdict.odd.holds, "odd numbers"),
            Requirement::FourthLane => check(verdict.fourth_lane.holds, "the fourth lane"),
            Requirement::Aliasing => check(verdict.aliasing.holds, "arguments in one place"),
            Requirement::Convention => check(verdict.convention.holds, "the calling convention"),
            Requirement::Memory => check(verdict.memory.holds, "memory"),
            Requirement::Proof => check(Some(verdict.is_proved()), "a proof"),
            Requirement::Ulp(most) => at_most("ulp", verdict.result.max_ulp, most),
            Requirement::Instructions(most) => {
                at_most("instructions", verdict.instructions.function.map(|n| n as f64), most)
            }
            Requirement::Body(most) => {
                at_most("instructions of the body", verdict.instructions.body.map(|n| n as f64), most)
            }
            Requirement::Executed(most) => {
                at_most("executed instructions", verdict.instructions.executed.map(|n| n as f64), most)
            }
            Requirement::Cycles(most) => {
                at_most("times the latency of `paper`", ratio(|figures| figures.latency), most)
            }
            Requirement::Throughput(most) => {
                at_most("times the throughput of `paper`", ratio(|figures| figures.throughput), most)
            }
        }
    }
}

fn at_most(what: &str, found: Option<f64>, most: f64) -> Option<String> {
    match found {
        // As a person reads them: three digits.
        Some(found) if found <= most * 1.0005 => None,
        Some(found) => Some(format!("{} {what}, of which there may be {most}", (found * 1000.0).round() / 1000.0)),
        None => Some(format!("{what}: not known here")),
    }
}

impl FromStr for Requirement {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, value) =
            text.trim().split_once('=').map_or((text.trim(), None), |(name, value)| (name, Some(value)));
        let Some(known) = NAMES.iter().find(|known| known.name == name) else {
            let known: Vec<_> = NAMES.iter().map(Name::example).collect();
            return Err(format!("expected one of {}, found `{}`", known.join(", "), brief(name)));
        };
        match (&known.meaning, value) {
            (Meaning::Alone(requirement), None) => Ok(*requirement),
            (Meaning::Alone(_), Some(_)) => Err(format!("`{name}` takes no number")),
            (Meaning::OfNumber(_, requirement), value) => {
                let number = value.and_then(|value| value.trim().parse().ok());
                let number = number.filter(|number: &f64| number.is_finite() && *number >= 0.0);
                number.map(requirement).ok_or_else(|| format!("`{name}` needs a number, as in {}", known.example()))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requirements_are_names_with_or_without_a_number() {
        assert_eq!("same-bits".parse(), Ok(Requirement::SameBits));
        assert_eq!(" ulp=2 ".parse(), Ok(Requirement::Ulp(2.0)));
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
