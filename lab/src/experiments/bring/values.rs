//! The check of results: the twin's bits, the bound of any order, and the smallest wrong input.

use super::bounded::{Bounded, outcomes};
use super::call::{Session, UNWRITTEN};
use super::findings::{Check, Crash, Example, Finding, FourthLane, Lane, Values};
use super::wanted::{Sample, Trial, Wanted};
use crate::experiments::check::same;

/// Tries all inputs, and reports what comes of it.
///
/// # Errors
/// The crash that ended it.
pub fn check(session: &mut Session<'_>) -> Result<(), Box<Crash>> {
    let wanted = session.wanted;
    let trials = session.request.trials();
    let mut tally = Tally::new(wanted);
    for (index, trial) in trials.iter().enumerate() {
        session.note(index as u64);
        let got = session.call(&trial.sample)?;
        tally.add(wanted, trial, &got);
    }
    session.note(u64::MAX);
    let values = Values {
        holds: Some(tally.ordinary.failed == 0),
        inputs: tally.ordinary.inputs,
        same_bits: tally.same_bits(),
        max_ulp: tally.max_ulp,
        max_ulp_expected: tally.max_ulp_expected,
        outside: tally.ordinary.failed,
        worst: tally.first_wrong.map(|wrong| smallest(session, wrong, &is_wrong)).transpose()?,
    };
    session.tell(&Finding::Values(values));
    let worst = tally.first_odd.map(|wrong| smallest(session, wrong, &is_wrong)).transpose()?;
    session.tell(&Finding::Odd(Check { holds: Some(tally.odd.failed == 0), worst, ..tally.odd }));
    let lane = fourth_lane(session, tally.fourth, tally.with_w)?;
    session.tell(&Finding::FourthLane(lane));
    Ok(())
}

/// What the function does with fourth lanes; `inputs` had one.
fn fourth_lane(session: &mut Session<'_>, fourth: Fourth, inputs: u64) -> Result<FourthLane, Box<Crash>> {
    let lane = |says: &str, worst: Option<Example>| FourthLane {
        holds: Some(worst.is_none()),
        inputs,
        says: says.into(),
        worst,
    };
    let Fourth::Seen { forms, not_computed, not_ignored, neither } = fourth else {
        return Ok(lane("there is none", None));
    };
    let form = forms.into_iter().find(|(_, all)| *all).map(|(form, _)| form);
    let is_neither = |wanted: &Wanted, sample: &Sample, got: &[f32]| {
        is_wrong(wanted, sample, got) && is_wrong(wanted, &without_w(wanted, sample), got)
    };
    Ok(match (form, neither, not_computed) {
        (Some("aos"), ..) => lane("taken for 0, as `aos` does", None),
        (Some(_), ..) => lane("computed as the others", None),
        (None, Some(neither), _) => {
            lane("neither added nor taken for 0", Some(smallest(session, neither, &is_neither)?))
        }
        (None, None, None) => lane("computed as the others, in another order", None),
        (None, None, Some(ignored)) if not_ignored => {
            let example = smallest(session, ignored, &is_wrong)?;
            lane("computed for some inputs, taken for 0 for others", Some(example))
        }
        (None, None, Some(_)) => lane("taken for 0, as it is in a vector", None),
    })
}

/// What the results so far come to.
struct Tally {
    /// For each form of the twin, whether all results have its bits; odd numbers apart.
    same: Vec<(&'static str, bool)>,
    ordinary: Check,
    odd: Check,
    first_wrong: Option<Sample>,
    first_odd: Option<Sample>,
    fourth: Fourth,
    /// Inputs with fourth lanes that are not 0.
    with_w: u64,
    max_ulp: Option<f64>,
    max_ulp_expected: Option<f64>,
}

/// What is known of fourth lanes.
enum Fourth {
    Untried,
    Seen {
        /// For each form of the twin, whether all results are what it gives.
        forms: Vec<(&'static str, bool)>,
        /// The first input whose result is outside of the bound of any order of operations.
        not_computed: Option<Sample>,
        /// Whether a result is not what the function has to give with 0 in place of fourth lanes.
        not_ignored: bool,
        /// The first input whose result is neither.
        neither: Option<Sample>,
    },
}

impl Tally {
    fn new(wanted: &Wanted) -> Self {
        let zeros = Sample { arguments: wanted.takes.iter().map(|kind| vec![0.0; kind.numbers()]).collect() };
        let same = wanted.expected(&zeros).into_iter().map(|(form, _)| (form, true)).collect();
        Tally {
            same,
            ordinary: Check::default(),
            odd: Check::default(),
            first_wrong: None,
            first_odd: None,
            fourth: Fourth::Untried,
            with_w: 0,
            max_ulp: None,
            max_ulp_expected: None,
        }
    }

    fn add(&mut self, wanted: &Wanted, trial: &Trial, got: &[f32]) {
        if trial.has_w {
            return self.add_with_w(wanted, &trial.sample, got);
        }
        let expected = wanted.expected(&trial.sample);
        for ((_, all), (_, expected)) in self.same.iter_mut().zip(&expected) {
            *all &= same_bits(got, expected);
        }
        let is_right = is_right(wanted, &trial.sample, got, &expected);
        let (check, first) = match trial.is_odd {
            true => (&mut self.odd, &mut self.first_odd),
            false => (&mut self.ordinary, &mut self.first_wrong),
        };
        check.inputs += 1;
        if !is_right {
            check.failed += 1;
            first.get_or_insert_with(|| trial.sample.clone());
        }
        if !trial.is_odd {
            let exact = wanted.bounded(&trial.sample);
            most(&mut self.max_ulp, ulps(&exact, got, is_right));
            most(&mut self.max_ulp_expected, ulps(&exact, &expected[0].1, true));
        }
    }

    fn add_with_w(&mut self, wanted: &Wanted, sample: &Sample, got: &[f32]) {
        self.with_w += 1;
        let expected = wanted.expected(sample);
        let all = || expected.iter().map(|(form, _)| (*form, true)).collect();
        if matches!(self.fourth, Fourth::Untried) {
            self.fourth = Fourth::Seen { forms: all(), not_computed: None, not_ignored: false, neither: None };
        }
        let Fourth::Seen { forms, not_computed, not_ignored, neither } = &mut self.fourth else { return };
        for ((_, all), (_, expected)) in forms.iter_mut().zip(&expected) {
            *all &= same_bits(got, expected);
        }
        let with = is_right(wanted, sample, got, &expected);
        let without = without_w(wanted, sample);
        let without = is_right(wanted, &without, got, &wanted.expected(&without));
        *not_ignored |= !without;
        if !with {
            not_computed.get_or_insert_with(|| sample.clone());
        }
        if !with && !without {
            neither.get_or_insert_with(|| sample.clone());
        }
    }

    fn same_bits(&self) -> Option<String> {
        self.same.iter().find(|(_, all)| *all).map(|(form, _)| (*form).to_owned())
    }
}

fn most(largest: &mut Option<f64>, value: Option<f64>) {
    if let Some(value) = value {
        *largest = Some(largest.map_or(value, |largest| largest.max(value)));
    }
}

fn same_bits(got: &[f32], expected: &[f32]) -> bool {
    got.iter().zip(expected).all(|(got, expected)| is_written(*got) && same(*got, *expected))
}

fn is_written(got: f32) -> bool {
    got.to_bits() != UNWRITTEN
}

/// Whether a result is the twin's, to the bit, or within the bound of any order of its operations.
fn is_right(wanted: &Wanted, sample: &Sample, got: &[f32], expected: &[(&str, Vec<f32>)]) -> bool {
    expected.iter().any(|(_, expected)| same_bits(got, expected)) || is_within(wanted, sample, got)
}

fn is_within(wanted: &Wanted, sample: &Sample, got: &[f32]) -> bool {
    let allows =
        |exact: &Vec<Bounded>| got.iter().zip(exact).all(|(got, exact)| is_written(*got) && exact.allows(*got));
    match outcomes(|| wanted.bounded(sample)) {
        Some(exact) => exact.iter().any(allows),
        // So many doubts that anything may come of them.
        None => got.iter().all(|got| is_written(*got)),
    }
}

/// The largest error of a result in units of its last place, of lanes whose terms do not cancel. An
/// infinity or a NaN that is wrong has the largest error that there is.
fn ulps(exact: &[Bounded], got: &[f32], is_right: bool) -> Option<f64> {
    let error = |(exact, got): (&Bounded, &f32)| {
        if !got.is_finite() {
            return (!is_right && !exact.allows(*got)).then_some(f64::MAX);
        }
        let value = exact.value.abs();
        let is_meaningful = value >= 0.5 * exact.magnitude && (1e-30..1e30).contains(&value);
        is_meaningful.then(|| (f64::from(*got) - exact.value).abs() / ulp(exact.value))
    };
    exact.iter().zip(got).filter_map(error).reduce(f64::max)
}

/// The distance between two numbers of f32 around a value.
fn ulp(value: f64) -> f64 {
    let exponent = value.abs().log2().floor() as i32;
    2.0_f64.powi(exponent.max(-126) - 23)
}

fn without_w(wanted: &Wanted, sample: &Sample) -> Sample {
    let mut sample = sample.clone();
    for (argument, kind) in sample.arguments.iter_mut().zip(&wanted.takes) {
        kind.fourth_lanes().into_iter().for_each(|lane| argument[lane] = 0.0);
    }
    sample
}

/// Whether a result for a sample is wrong in the sense of some check.
type IsWrong<'a> = dyn Fn(&Wanted, &Sample, &[f32]) -> bool + 'a;

fn is_wrong(wanted: &Wanted, sample: &Sample, got: &[f32]) -> bool {
    !is_right(wanted, sample, got, &wanted.expected(sample))
}

/// The smallest wrong input that is found from a wrong one, with its results: simplified number by
/// number, as long as the result is wrong.
fn smallest(session: &mut Session<'_>, mut sample: Sample, is_wrong: &IsWrong<'_>) -> Result<Example, Box<Crash>> {
    /// Passes over all numbers: few change more than twice.
    const PASSES: usize = 4;
    let wanted = session.wanted;
    for _ in 0..PASSES {
        let before = sample.clone();
        for argument in 0..sample.arguments.len() {
            for place in 0..sample.arguments[argument].len() {
                for simpler in simpler_than(sample.arguments[argument][place]) {
                    let mut tried = sample.clone();
                    tried.arguments[argument][place] = simpler;
                    if is_wrong(wanted, &tried, &session.call(&tried)?) {
                        sample = tried;
                        break;
                    }
                }
            }
        }
        if sample == before {
            break;
        }
    }
    let got = session.call(&sample)?;
    Ok(compared(wanted, &sample, &got))
}

/// Numbers that are easier to read, the easiest first.
fn simpler_than(number: f32) -> Vec<f32> {
    let effort = |x: f32| -> u32 {
        match x {
            0.0 => 0,
            1.0 => 1,
            x if x.abs() <= 10.0 && x.fract() == 0.0 => 2 + x.abs() as u32 + u32::from(x < 0.0),
            x => 20 + format!("{x:?}").len() as u32,
        }
    };
    let mut candidates = vec![0.0, 1.0, 2.0, 3.0, -1.0, number.round(), (number * 2.0).round() / 2.0];
    candidates.push(format!("{number:.1e}").parse().unwrap_or(number));
    let mut simpler: Vec<_> = candidates.into_iter().filter(|x| effort(*x) < effort(number)).collect();
    simpler.sort_by_key(|x| effort(*x));
    simpler
}

/// Results beside those that are expected.
fn compared(wanted: &Wanted, sample: &Sample, got: &[f32]) -> Example {
    let expected = &wanted.expected(sample)[0].1;
    let exact = wanted.bounded(sample);
    let lanes = got.iter().zip(expected).zip(&exact).map(|((got, expected), exact)| Lane {
        expected: format!("{expected:?}"),
        got: if is_written(*got) { format!("{got:?}") } else { "what was there before: it is not written".into() },
        is_right: is_written(*got) && (same(*got, *expected) || exact.allows(*got)),
    });
    Example::new(wanted, sample, lanes.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_become_simpler_and_never_the_same() {
        assert!(simpler_than(0.0).is_empty());
        assert_eq!(simpler_than(1.0), [0.0]);
        assert_eq!(&simpler_than(3.217)[..3], [0.0, 1.0, 2.0]);
        for number in [-7.5, 1e30, f32::NAN, f32::INFINITY, 1e-40] {
            assert!(simpler_than(number).iter().all(|simpler| simpler.to_bits() != number.to_bits()), "{number}");
        }
    }

    #[test]
    fn a_result_that_is_not_finite_has_the_largest_error() {
        let exact = [2.0, f32::INFINITY].map(Bounded::from);
        assert_eq!(ulps(&exact, &[2.0, f32::INFINITY], true), Some(0.0));
        for wrong in [f32::NAN, f32::INFINITY, f32::from_bits(UNWRITTEN)] {
            assert_eq!(ulps(&exact, &[wrong, f32::INFINITY], false), Some(f64::MAX));
        }
        // As where a comparison is in doubt.
        assert_eq!(ulps(&exact, &[f32::INFINITY, 1.0], true), None);
        let largest = Bounded::from(f32::MAX);
        assert_eq!(ulps(&[largest + largest], &[f32::NAN], false), None);
    }

    #[test]
    fn a_last_place_is_that_of_f32() {
        assert_eq!([1.0, 1.5, -2.0].map(ulp), [f64::from(f32::EPSILON), f64::from(f32::EPSILON), 2.0_f64.powi(-22)]);
    }
}
