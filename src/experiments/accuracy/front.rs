//! The front of error and time: what nothing else beats in both.

/// An error and a time, both better the smaller.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// The error, whose tenth digit nobody sees: it is compared in whole decibels, steps of a quarter.
    pub error: f64,
    pub time: f64,
}

impl Point {
    /// Whether it is at least as good in both and better in one.
    pub fn dominates(self, other: Point) -> bool {
        // The logarithm of 0 is below all others.
        let decibels = |error: f64| (10.0 * error.log10()).round();
        let (error, others) = (decibels(self.error), decibels(other.error));
        error <= others && self.time <= other.time && (error < others || self.time < other.time)
    }
}

/// Which of the points are dominated by none. A point that is not a number is never on the front.
pub fn front(points: &[Point]) -> Vec<bool> {
    let known = |p: &Point| !p.error.is_nan() && !p.time.is_nan();
    let on = |p: &Point| known(p) && !points.iter().any(|other| other.dominates(*p));
    points.iter().map(on).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Rng;

    fn points(pairs: &[(f64, f64)]) -> Vec<Point> {
        pairs.iter().map(|(error, time)| Point { error: *error, time: *time }).collect()
    }

    #[test]
    fn the_front_is_what_nothing_else_beats_in_both() {
        for (pairs, expected) in [
            (&[(1.0, 1.0)][..], &[true][..]),
            // A staircase, and what is above it.
            (&[(1.0, 9.0), (2.0, 5.0), (3.0, 6.0), (4.0, 1.0), (4.0, 2.0)], &[true, true, false, true, false]),
            // Equals are both on it; equal in one and worse in the other is off it.
            (&[(1.0, 1.0), (1.0, 1.0), (1.0, 2.0), (2.0, 1.0)], &[true, true, false, false]),
            (&[(0.0, 3.0), (f64::INFINITY, 1.0)], &[true, true]),
            // A difference that nobody sees is none.
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
