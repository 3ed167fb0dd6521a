//! Decimal numbers of a file, rounded to f32 as `str::parse` rounds them.

/// The finite number at the start of a text, and what follows it: the caller decides whether that may follow.
pub(super) fn number(text: &[u8]) -> Option<(f32, &[u8])> {
    let (value, length) = fast_float2::parse_partial(text).ok().filter(|(value, _): &(f32, _)| value.is_finite())?;
    Some((value, &text[length..]))
}

#[cfg(test)]
mod tests {
    use super::number;

    /// Whatever follows it, a number has the value that `str::parse` gives.
    fn agrees(token: &str) {
        let expected = token.parse::<f32>().ok().filter(|value| value.is_finite()).map(f32::to_bits);
        for tail in ["", " 12345678 ", "\n", ",5", "#", "x1234567"] {
            let text = format!("{token}{tail}");
            let read = number(text.as_bytes()).filter(|(_, rest)| *rest == tail.as_bytes());
            // A text that is longer than a number is not always seen to begin with one: "1e5x" does, "1ex" does not.
            if read.is_some() || tail.is_empty() {
                assert_eq!(read.map(|(value, _)| value.to_bits()), expected, "{text:?}");
            }
        }
    }

    #[test]
    fn numbers_are_those_of_the_standard_library_to_the_last_bit() {
        const TOKENS: &str = "\
            0 -0 +1 1. .5 -.5 . - e5 1e 1e+ 1e- 1.e5 0x1 1_0 1e5. --1 1.2.3 nan inf -infinity 1e39 -1e39 \
            3.4028235e38 3.4028236e38 1e-45 7e-46 1e-46 1.17549435e-38 1.1754942e-38 1e-99 \
            0e99999999999999999999 1e99999999999999999999 1e-99999999999999999999 1e-9223372036854775808 \
            1.000000059604644775390625 1.000000059604644775390626 16777217 33554433 9007199254740993 \
            99999999999999999999 00000000000000000000001 0.00000000000000000000001 123456789012345678e-17 \
            0.12345678901234567 12345678.12345678";
        // In f64, each is half-way between two f32.
        const HALF_WAY: &str = "2.72830331325531 6.85021710395813";
        for token in TOKENS.split(' ').chain(HALF_WAY.split(' ')).chain([""]) {
            agrees(token);
        }
    }
}
