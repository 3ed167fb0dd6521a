//! The Pareto front of error and time: the points that no other point beats in both.

/// An error and a time; smaller is better in both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// The error. Errors are compared in whole decibels, steps of about a quarter, since smaller
    /// differences do not matter.
    pub error: f64,
    pub time: f64,
}

impl Point {
    /// Whether this point is at least as good in both and better in one.
    pub fn dominates(self, other: Point) -> bool {
        // An error of 0 becomes minus infinity, which is below all others, as it should be.
        let decibels = |error: f64| (10.0 * error.log10()).round();
        let (error, others) = (decibels(self.error), decibels(other.error));
        error <= others && self.time <= other.time && (error < others || self.time < other.time)
    }
}

/// For each point whether it is on the front, which means that no other point dominates it. A point
/// with a NaN never is.
pub fn front(points: &[Point]) -> Vec<bool> {
    let known = |p: &Point| !p.error.is_nan() && !p.time.is_nan();
    let on = |p: &Point| known(p) && !points.iter().any(|other| other.dominates(*p));
    points.iter().map(on).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayo::internals::scene::Rng;

    fn points(pairs: &[(f64, f64)]) -> Vec<Point> {
        pairs.iter().map(|(error, time)| Point { error: *error, time: *time }).collect()
    }

    #[test]
    fn the_front_is_what_nothing_else_beats_in_both() {
        for (pairs, expected) in [
            (&[(1.0, 1.0)][..], &[true][..]),
            // Points of a staircase are on the front, those above it are not.
            (&[(1.0, 9.0), (2.0, 5.0), (3.0, 6.0), (4.0, 1.0), (4.0, 2.0)], &[true, true, false, true, false]),
            // Equal points are both on the front; one that is equal in one value and worse in the
            // other is not.
            (&[(1.0, 1.0), (1.0, 1.0), (1.0, 2.0), (2.0, 1.0)], &[true, true, false, false]),
            (&[(0.0, 3.0), (f64::INFINITY, 1.0)], &[true, true]),
            // Errors that differ by less than a decibel count as equal.
            (&[(1.0e-8, 2.0), (1.02e-8, 1.0), (1.3e-8, 0.5)], &[false, true, true]),
            (&[(f64::NAN, 0.0), (1.0, f64::NAN), (1.0, 1.0)], &[false, false, true]),
            (&[], &[]),
        ] {
            assert_eq!(front(&points(pairs)), expected, "{pairs:?}");
        }
    }

    #[test]
    fn every_point_off_the_front_is_beaten_by_one_on_it() {
        let mut rng = Rng::new(1);
        let mut next = || (rng.next_u64() >> 60) as f64;
        for _ in 0..200 {
            let points: Vec<_> = (0..9).map(|_| Point { error: next(), time: next() }).collect();
            let on = front(&points);
            for (point, on_front) in points.iter().zip(&on) {
                let beaten = points.iter().zip(&on).any(|(other, on)| *on && other.dominates(*point));
                assert_ne!(beaten, *on_front, "{points:?}");
            }
        }
    }
}
