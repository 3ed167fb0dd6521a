//! Parsing numbers in arguments; errors say which numbers an option accepts.

use std::fmt::Display;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// The largest count, where an option has no other limit.
const MOST: usize = u32::MAX as usize;

/// A parser of integers in this range.
pub(super) fn whole<T>(range: RangeInclusive<T>) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static
where
    T: FromStr + PartialOrd + Display + Clone + Send + Sync + 'static,
{
    move |text| {
        let number = text.parse().ok().filter(|number| range.contains(number));
        number.ok_or_else(|| format!("expected a whole number from {} to {}", range.start(), range.end()))
    }
}

/// Parses a count or an index, from 0.
pub(super) fn count(text: &str) -> Result<usize, String> {
    whole(0..=MOST)(text)
}

/// Parses the seed of random numbers.
pub(super) fn seed(text: &str) -> Result<u64, String> {
    whole(0..=u64::MAX)(text)
}

/// Parses a length. Invalid lengths, such as -1, are left to the camera, whose error names the
/// length.
pub(super) fn length(text: &str) -> Result<f32, &'static str> {
    single(text).ok_or("expected a number greater than 0, from 1e-45 to 3.4e38")
}

/// A number as f32; None if a finite number would overflow to infinity, or a nonzero one underflow
/// to 0. Also parses the names of infinity and NaN.
pub(super) fn single(text: &str) -> Option<f32> {
    let number: f32 = text.trim().parse().ok()?;
    let significand = text.split(['e', 'E']).next().unwrap_or_default();
    let is_too_large = number.is_infinite() && significand.contains(|c: char| c.is_ascii_digit());
    let is_too_small = number == 0.0 && significand.contains(|c| ('1'..='9').contains(&c));
    (!is_too_large && !is_too_small).then_some(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_of_32_bits_neither_overflows_nor_vanishes() {
        for (text, number) in [("1e38", 1e38), ("-0", 0.0), ("0e9", 0.0), (" 1 ", 1.0), ("-inf", f32::NEG_INFINITY)] {
            assert_eq!(single(text), Some(number), "{text}");
        }
        assert!(single("nan").is_some_and(f32::is_nan));
        for text in ["1e400", "-1e39", "1e-50", "", "x", "1,2"] {
            assert_eq!(single(text), None, "{text}");
        }
    }

    #[test]
    fn a_whole_number_that_is_none_of_the_range_is_answered_with_it() {
        let from_1_to_16 = whole(1..=16);
        assert_eq!(from_1_to_16("16"), Ok(16));
        for text in ["0", "17", "-1", "1.5", "", "x", "99999999999999999999"] {
            assert_eq!(from_1_to_16(text).unwrap_err(), "expected a whole number from 1 to 16", "{text}");
        }
    }
}
