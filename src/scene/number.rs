//! Decimal numbers read straight from a file's bytes, rounded to f32 as `str::parse` rounds them.

/// The finite number that a text begins with, and what follows it: whether that may follow is for the caller to say.
pub(super) fn number(text: &[u8]) -> Option<(f32, &[u8])> {
    let (value, length) = fast_float2::parse_partial::<f32, _>(text).ok()?;
    value.is_finite().then(|| (value, &text[length..]))
}

/// The whole number that a text begins with, of nine digits at most, and what follows it.
#[cfg(feature = "files")]
pub(super) fn whole(text: &[u8]) -> Option<(u32, &[u8])> {
    let digits = text.iter().position(|byte| !byte.is_ascii_digit()).unwrap_or(text.len());
    let (number, rest) = text.split_at(digits);
    let value = || number.iter().fold(0, |value, digit| 10 * value + u32::from(digit - b'0'));
    (1..=9).contains(&digits).then(|| (value(), rest))
}

#[cfg(test)]
mod tests {
    use super::super::Rng;
    use super::number;

    /// Whatever follows it, a number is what `str::parse` makes of it.
    fn agrees(token: &str) {
        let expected = token.parse::<f32>().ok().filter(|value| value.is_finite()).map(f32::to_bits);
        for tail in ["", " 12345678 ", "\n", ",5", "#", "x1234567"] {
            let text = format!("{token}{tail}");
            let read = number(text.as_bytes()).filter(|(_, rest)| *rest == tail.as_bytes());
            // What is longer than a number is not always seen to begin with one: "1e5x" does, "1ex" does not.
            if read.is_some() || tail.is_empty() {
                assert_eq!(read.map(|(value, _)| value.to_bits()), expected, "{text:?}");
            }
        }
    }

    #[test]
    fn numbers_are_those_of_the_standard_library_to_the_last_bit() {
        for token in [
            "0",
            "-0",
            "+1",
            "1.",
            ".5",
            "-.5",
            ".",
            "-",
            "",
            "e5",
            "1e",
            "1e+",
            "1e-",
            "1.e5",
            "0x1",
            "1_0",
            "1e5.",
            "--1",
            "1.2.3",
            "nan",
            "inf",
            "-infinity",
            "1e39",
            "-1e39",
            "3.4028235e38",
            "3.4028236e38",
            "1e-45",
            "7e-46",
            "1e-46",
            "1.17549435e-38",
            "1.1754942e-38",
            "1e-99",
            "0e99999999999999999999",
            "1e99999999999999999999",
            "1e-99999999999999999999",
            "1e-9223372036854775808",
            "1.000000059604644775390625",
            "1.000000059604644775390626",
            "16777217",
            "33554433",
            "9007199254740993",
            "99999999999999999999",
            "00000000000000000000001",
            "0.00000000000000000000001",
            "123456789012345678e-17",
            "0.12345678901234567",
            "12345678.12345678",
        ] {
            agrees(token);
        }
    }

    #[test]
    fn random_numbers_are_too() {
        let mut rng = Rng::new(17);
        for round in 0..300_000 {
            let any = f32::from_bits(rng.next_u64() as u32);
            let near = rng.between(-1000.0, 1000.0);
            let (digits, places) = (rng.next_u64() >> (rng.next_u64() % 64), rng.next_u64() % 25);
            match round % 7 {
                0 => agrees(&any.to_string()),
                1 => agrees(&format!("{any:e}")),
                2 => agrees(&near.to_string()),
                3 => agrees(&format!("{near:.*}", places as usize)),
                4 => agrees(&format!("{digits}e-{places}")),
                // Half-way between two of f32, and beside it.
                5 => agrees(&(f64::from(near) + f64::from(near.next_up())).to_string()),
                _ => agrees(&format!("{}.{digits}E{places}", digits % 1000)),
            }
        }
    }
}
