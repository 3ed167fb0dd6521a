//! The check of results: the twin's bits, the bound of any order, and the smallest wrong input.

use super::bounded::{Bounded, outcomes};
use super::call::{Session, UNWRITTEN};
use super::findings::{Check, Crash, Example, Finding, FourthLane, FourthLaneCheck, Lane, Values};
use super::wanted::{Sample, Trial, Wanted};
use crate::experiments::check::same;

/// Tries all inputs, and reports what comes of it.
///
/// # Errors
/// The crash that ended it.
pub fn check(session: &mut Session<'_>) -> Result<(), Box<Crash>> {
    let wanted = session.wanted;
    let trials = wanted.trials(session.request.inputs, session.request.seed);
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
        worst: smallest(session, tally.first_wrong)?,
    };
    session.tell(&Finding::Values(values));
    let odd = Check { holds: Some(tally.odd.failed == 0), worst: smallest(session, tally.first_odd)?, ..tally.odd };
    session.tell(&Finding::Odd(odd));
    let inputs = tally.with_w;
    let lane = fourth_lane(session, tally.fourth)?;
    session.tell(&Finding::FourthLane(FourthLaneCheck { inputs, lane }));
    Ok(())
}

/// What the function does with fourth lanes.
fn fourth_lane(session: &mut Session<'_>, fourth: Fourth) -> Result<FourthLane, Box<Crash>> {
    let Fourth::Seen { forms, within, ignored, example } = fourth else { return Ok(FourthLane::None) };
    let form = forms.into_iter().find(|(_, all)| *all).map(|(form, _)| form);
    Ok(match (form, smallest_with_w(session, example)?) {
        (Some("aos"), _) => FourthLane::As("taken for 0, as `aos` does".into()),
        (Some(_), _) => FourthLane::As("computed as the others".into()),
        _ if within => FourthLane::As("computed as the others, in another order".into()),
        _ if ignored => FourthLane::Ignored,
        (None, Some(example)) => FourthLane::Otherwise(Box::new(example)),
        (None, None) => FourthLane::Ignored,
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
        /// Whether all results are within the bound of any order of operations.
        within: bool,
        /// Whether all results are what it gives without them.
        ignored: bool,
        /// One that is neither.
        example: Option<Sample>,
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
            most(&mut self.max_ulp, ulps(&exact, got));
            most(&mut self.max_ulp_expected, ulps(&exact, &expected[0].1));
        }
    }

    fn add_with_w(&mut self, wanted: &Wanted, sample: &Sample, got: &[f32]) {
        self.with_w += 1;
        let expected = wanted.expected(sample);
        let all = || expected.iter().map(|(form, _)| (*form, true)).collect();
        if matches!(self.fourth, Fourth::Untried) {
            self.fourth = Fourth::Seen { forms: all(), within: true, ignored: true, example: None };
        }
        let Fourth::Seen { forms, within, ignored, example } = &mut self.fourth else { return };
        for ((_, all), (_, expected)) in forms.iter_mut().zip(&expected) {
            *all &= same_bits(got, expected);
        }
        let with = is_right(wanted, sample, got, &expected);
        let without = without_w(wanted, sample);
        let without = is_right(wanted, &without, got, &wanted.expected(&without));
        *within &= with;
        *ignored &= without;
        if !with && !without && example.is_none() {
            *example = Some(sample.clone());
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

/// The largest error of a result in units of its last place, of lanes whose terms do not cancel.
fn ulps(exact: &[Bounded], got: &[f32]) -> Option<f64> {
    let lanes = exact.iter().zip(got).filter(|(exact, _)| {
        let value = exact.value.abs();
        value.is_normal() && value >= 0.5 * exact.magnitude && (1e-30..1e30).contains(&value)
    });
    let error = |(exact, got): (&Bounded, &f32)| (f64::from(*got) - exact.value).abs() / ulp(exact.value);
    lanes.map(error).filter(|error| error.is_finite()).reduce(f64::max)
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

/// The smallest wrong input that is found from a wrong one, with its results.
fn smallest(session: &mut Session<'_>, wrong: Option<Sample>) -> Result<Option<Example>, Box<Crash>> {
    let Some(wrong) = wrong else { return Ok(None) };
    let wanted = session.wanted;
    let fails = |session: &mut Session<'_>, sample: &Sample| -> Result<bool, Box<Crash>> {
        let got = session.call(sample)?;
        Ok(!is_right(wanted, sample, &got, &wanted.expected(sample)))
    };
    let sample = shrink(session, wrong, &fails)?;
    example(session, &sample).map(Some)
}

/// The same of an input with fourth lanes, for which the function does neither what the twin does
/// with them nor without.
fn smallest_with_w(session: &mut Session<'_>, wrong: Option<Sample>) -> Result<Option<Example>, Box<Crash>> {
    let Some(wrong) = wrong else { return Ok(None) };
    let wanted = session.wanted;
    let fails = |session: &mut Session<'_>, sample: &Sample| -> Result<bool, Box<Crash>> {
        let got = session.call(sample)?;
        let without = without_w(wanted, sample);
        Ok([sample, &without].into_iter().all(|sample| !is_right(wanted, sample, &got, &wanted.expected(sample))))
    };
    let sample = shrink(session, wrong, &fails)?;
    example(session, &sample).map(Some)
}

type Fails<'a> = dyn Fn(&mut Session<'_>, &Sample) -> Result<bool, Box<Crash>> + 'a;

/// Simplifies an input number by number, as long as it fails.
fn shrink(session: &mut Session<'_>, mut sample: Sample, fails: &Fails<'_>) -> Result<Sample, Box<Crash>> {
    /// Passes over all numbers: few change more than twice.
    const PASSES: usize = 4;
    for _ in 0..PASSES {
        let before = sample.clone();
        for argument in 0..sample.arguments.len() {
            for place in 0..sample.arguments[argument].len() {
                let number = sample.arguments[argument][place];
                for simpler in simpler_than(number) {
                    let mut tried = sample.clone();
                    tried.arguments[argument][place] = simpler;
                    if fails(session, &tried)? {
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
    Ok(sample)
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

/// An input with its results.
pub fn example(session: &mut Session<'_>, sample: &Sample) -> Result<Example, Box<Crash>> {
    let got = session.call(sample)?;
    Ok(compared(session.wanted, sample, &got))
}

/// Results beside those that are expected.
pub fn compared(wanted: &Wanted, sample: &Sample, got: &[f32]) -> Example {
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
    fn a_last_place_is_that_of_f32() {
        assert_eq!([1.0, 1.5, -2.0].map(ulp), [f64::from(f32::EPSILON), f64::from(f32::EPSILON), 2.0_f64.powi(-22)]);
    }
}
