//! The verdict on a claim: whether the interval of a measured figure agrees with it.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::measure::statistics::Estimate;

/// The verdict on a claim, in the words of the JSON document.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
pub enum Verdict {
    /// The whole interval agrees with the claim.
    #[serde(rename = "reproduced")]
    Reproduced,
    /// The whole interval contradicts the claim.
    #[serde(rename = "not reproduced")]
    NotReproduced,
    /// The interval contains both values that agree with the claim and values that contradict it,
    /// or too few undisturbed runs remained for an interval.
    #[serde(rename = "too few runs to tell")]
    TooFewRuns,
    /// The run was stopped before the figure was measured.
    #[serde(rename = "not measured")]
    NotMeasured,
    /// More runs would not decide: this machine or build lacks something, or two measurements of
    /// the same ratio disagree.
    #[serde(rename = "not testable here")]
    NotTestable,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

impl Verdict {
    /// The verdict on the claim that a figure is at least `least`.
    pub fn at_least(figure: Estimate, least: f64) -> Self {
        Verdict::of(figure.low >= least, figure.high < least)
    }

    /// The verdict on the claim that a figure is at most `most`.
    pub fn at_most(figure: Estimate, most: f64) -> Self {
        Verdict::of(figure.high <= most, figure.low > most)
    }

    fn of(agrees: bool, contradicts: bool) -> Self {
        match (agrees, contradicts) {
            (true, _) => Verdict::Reproduced,
            (_, true) => Verdict::NotReproduced,
            _ => Verdict::TooFewRuns,
        }
    }

    /// The verdict on the claim that both of two claims hold.
    pub fn and(self, other: Self) -> Self {
        match (self, other) {
            (Verdict::NotReproduced, _) | (_, Verdict::NotReproduced) => Verdict::NotReproduced,
            (Verdict::Reproduced, other) => other,
            (not_told, _) => not_told,
        }
    }

    /// The verdict on the claim that at least one of two claims holds.
    pub fn or(self, other: Self) -> Self {
        match (self, other) {
            (Verdict::Reproduced, _) | (_, Verdict::Reproduced) => Verdict::Reproduced,
            (Verdict::NotReproduced, other) => other,
            (not_told, _) => not_told,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Verdict::{NotReproduced, Reproduced, TooFewRuns};

    #[test]
    fn an_interval_across_the_limit_tells_nothing() {
        for (low, high, at_least, at_most) in [
            (1.0, 1.9, NotReproduced, Reproduced),
            (2.0, 3.0, Reproduced, TooFewRuns),
            (1.9, 2.1, TooFewRuns, TooFewRuns),
            (2.1, 3.0, Reproduced, NotReproduced),
            (f64::NAN, f64::NAN, TooFewRuns, TooFewRuns),
        ] {
            let figure = Estimate { value: low, low, high };
            assert_eq!(Verdict::at_least(figure, 2.0), at_least, "{low} {high}");
            assert_eq!(Verdict::at_most(figure, 2.0), at_most, "{low} {high}");
        }
    }

    #[test]
    fn what_is_sure_of_a_part_can_be_sure_of_the_whole() {
        for (a, b, and, or) in [
            (Reproduced, Reproduced, Reproduced, Reproduced),
            (Reproduced, NotReproduced, NotReproduced, Reproduced),
            (NotReproduced, NotReproduced, NotReproduced, NotReproduced),
            (Reproduced, TooFewRuns, TooFewRuns, Reproduced),
            (NotReproduced, TooFewRuns, NotReproduced, TooFewRuns),
        ] {
            assert_eq!((a.and(b), b.and(a)), (and, and), "{a} {b}");
            assert_eq!((a.or(b), b.or(a)), (or, or), "{a} {b}");
        }
    }
}
