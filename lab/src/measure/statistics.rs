//! Statistics of repeated timings: mean, median, MAD, and the bootstrap interval of a median.

use serde::{Deserialize, Serialize};

/// A value, and the interval in which a repetition is expected to be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct Estimate {
    /// The estimated value.
    pub value: f64,
    /// The interval's lower end.
    pub low: f64,
    /// The interval's upper end.
    pub high: f64,
}

impl Estimate {
    /// The estimate with a wider interval: its ends are divided and multiplied by 1 + `by`.
    pub fn widened(self, by: f64) -> Self {
        Estimate { low: self.low / (1.0 + by), high: self.high * (1.0 + by), ..self }
    }

    /// Whether the two intervals have a value in common.
    pub fn overlaps(&self, other: &Estimate) -> bool {
        self.low <= other.high && other.low <= self.high
    }
}

/// The confidence of an interval.
pub const CONFIDENCE: f64 = 0.95;
/// The number of resamples of a bootstrap: enough for the first two digits of the ends of a 95 %
/// interval.
const RESAMPLES: usize = 1000;

/// The arithmetic mean; NaN for an empty slice.
pub fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The middle value, or the mean of the middle two; NaN for an empty slice.
pub fn median(values: &[f64]) -> f64 {
    median_of(&mut values.to_vec())
}

/// The smallest value; infinity for an empty slice.
pub fn minimum(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::INFINITY, f64::min)
}

/// The largest value; minus infinity for an empty slice.
pub fn maximum(values: &[f64]) -> f64 {
    values.iter().copied().fold(f64::NEG_INFINITY, f64::max)
}

/// The median absolute deviation from the median, not scaled to a normal distribution's sigma.
pub fn mad(values: &[f64]) -> f64 {
    let middle = median(values);
    median_of(&mut values.iter().map(|value| (value - middle).abs()).collect::<Vec<_>>())
}

/// The number of values that are further than `times` MAD from the median.
pub fn outliers(values: &[f64], times: f64) -> usize {
    let (middle, reach) = (median(values), times * mad(values));
    values.iter().filter(|value| (*value - middle).abs() > reach).count()
}

/// Each numerator divided by the denominator that was measured together with it.
///
/// # Panics
/// If there are not as many numerators as denominators.
pub fn pairwise_ratios(numerators: &[f64], denominators: &[f64]) -> Vec<f64> {
    assert_eq!(numerators.len(), denominators.len(), "ratios are taken pair by pair");
    numerators.iter().zip(denominators).map(|(a, b)| a / b).collect()
}

/// The median of all values in `groups`, with its percentile bootstrap interval at [`CONFIDENCE`].
///
/// A resample draws as many groups as there are, each with all its values: values that were
/// measured together may be off together, and carry less information than independent ones.
/// `random` returns 64 random bits per call; the same bits give the same interval.
pub fn median_with_interval<'a>(
    groups: impl IntoIterator<Item = &'a [f64]>,
    random: &mut dyn FnMut() -> u64,
) -> Estimate {
    let groups: Vec<&[f64]> = groups.into_iter().collect();
    let mut drawn = Vec::with_capacity(groups.iter().map(|group| group.len()).sum());
    let medians = (0..RESAMPLES).map(|_| {
        drawn.clear();
        for _ in &groups {
            drawn.extend_from_slice(groups[below(groups.len(), random)]);
        }
        median_of(&mut drawn)
    });
    let mut medians: Vec<_> = medians.collect();
    medians.sort_unstable_by(f64::total_cmp);
    let tail = (1.0 - CONFIDENCE) / 2.0;
    let value = median_of(&mut groups.concat());
    Estimate { value, low: quantile(&medians, tail), high: quantile(&medians, 1.0 - tail) }
}

/// A straight line through points, fitted by least squares.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
pub struct Line {
    pub slope: f64,
    /// The line's value at x = 0.
    pub intercept: f64,
    /// The root mean square distance of the points from the line, relative to their mean.
    pub residual: f64,
}

/// The line y = slope x + intercept with the least squared distances from `points` (x, y).
///
/// # Panics
/// With fewer than two different x.
pub fn fit_line(points: &[(f64, f64)]) -> Line {
    let count = points.len() as f64;
    let (x_mean, y_mean) =
        (points.iter().map(|p| p.0).sum::<f64>() / count, points.iter().map(|p| p.1).sum::<f64>() / count);
    let spread = points.iter().map(|p| (p.0 - x_mean).powi(2)).sum::<f64>();
    assert!(spread > 0.0, "a line needs two different x");
    let slope = points.iter().map(|p| (p.0 - x_mean) * (p.1 - y_mean)).sum::<f64>() / spread;
    let intercept = y_mean - slope * x_mean;
    let squares = points.iter().map(|p| (p.1 - slope * p.0 - intercept).powi(2)).sum::<f64>();
    Line { slope, intercept, residual: (squares / count).sqrt() / y_mean.abs() }
}

/// The median of `values`, which are reordered.
fn median_of(values: &mut [f64]) -> f64 {
    let (middle, odd) = (values.len() / 2, values.len() % 2 == 1);
    if values.is_empty() {
        return f64::NAN;
    }
    let (below, upper, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    let upper = *upper;
    if odd {
        return upper;
    }
    let lower = below.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (lower + upper) / 2.0
}

/// The quantile `q` of sorted values, interpolated linearly between neighbours.
fn quantile(sorted: &[f64], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return f64::NAN };
    let place = q * last as f64;
    let (below, above) = (place.floor() as usize, place.ceil() as usize);
    sorted[below] + (sorted[above] - sorted[below]) * place.fract()
}

/// A random number in 0..n; the probabilities of all numbers are equal up to n / 2^64.
fn below(n: usize, random: &mut dyn FnMut() -> u64) -> usize {
    ((u128::from(random()) * n as u128) >> 64) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A counter in steps of the golden ratio: even enough for draws, and the same everywhere.
    fn even() -> impl FnMut() -> u64 {
        let mut state = 7_u64;
        move || {
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            state
        }
    }

    #[test]
    fn medians_and_deviations_are_those_computed_by_hand() {
        for (values, middle, deviation) in [
            (&[3.0][..], 3.0, 0.0),
            (&[4.0, 1.0], 2.5, 1.5),
            (&[5.0, 1.0, 3.0], 3.0, 2.0),
            (&[1.0, 1.0, 1.0, 9.0], 1.0, 0.0),
            (&[2.0, 4.0, 8.0, 16.0, 32.0], 8.0, 6.0),
        ] {
            assert_eq!((median(values), mad(values)), (middle, deviation), "{values:?}");
        }
        assert!(median(&[]).is_nan());
    }

    #[test]
    fn outlier_is_beyond_the_deviations_and_not_at_them() {
        // Median 3, MAD 1.
        let values = [1.0, 2.0, 3.0, 4.0, 6.0, 6.5, 3.0];
        assert_eq!((median(&values), mad(&values)), (3.0, 1.0));
        assert_eq!(outliers(&values, 3.0), 1);
        assert_eq!(outliers(&values, 1.0), 3);
        assert_eq!(outliers(&[5.0; 4], 3.0), 0);
    }

    /// Independent values.
    fn of_each(values: &[f64]) -> Estimate {
        median_with_interval(values.chunks(1), &mut even())
    }

    #[test]
    fn interval_lies_between_the_extremes_of_its_values() {
        assert_eq!(of_each(&[2.0; 5]), Estimate { value: 2.0, low: 2.0, high: 2.0 });
        let spread = of_each(&[1.0, 2.0, 3.0, 4.0, 5.0]);
        assert_eq!(spread.value, 3.0);
        assert!(1.0 <= spread.low && spread.low < 3.0 && 3.0 < spread.high && spread.high <= 5.0, "{spread:?}");
    }

    #[test]
    fn values_of_a_group_are_drawn_together() {
        // Five runs with different offsets, each measured a hundred times.
        let runs: Vec<_> = (0..5).map(|run| [f64::from(run); 100]).collect();
        let together = median_with_interval(runs.iter().map(<[f64; 100]>::as_slice), &mut even());
        assert_eq!(together, of_each(&[0.0, 1.0, 2.0, 3.0, 4.0]));
        let apart = of_each(&runs.concat());
        assert!(apart.high - apart.low < together.high - together.low, "{apart:?} {together:?}");
    }

    #[test]
    fn more_values_make_a_narrower_interval() {
        let few: Vec<f64> = (0..5).map(f64::from).collect();
        let many: Vec<f64> = (0..500).map(|i| f64::from(i) / 100.0).collect();
        let width = |values: &[f64]| of_each(values).high - of_each(values).low;
        assert!(width(&many) < width(&few) / 2.0);
    }

    #[test]
    fn a_line_is_found_again_and_its_residual_is_relative() {
        let line = fit_line(&[(0.0, 1.0), (1.0, 3.0), (2.0, 5.0)]);
        assert_eq!(line, Line { slope: 2.0, intercept: 1.0, residual: 0.0 });
        // Slope 0, intercept 2, every point 1 away.
        let line = fit_line(&[(-1.0, 1.0), (-1.0, 3.0), (1.0, 1.0), (1.0, 3.0)]);
        assert_eq!(line, Line { slope: 0.0, intercept: 2.0, residual: 0.5 });
    }
}
