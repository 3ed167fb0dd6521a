//! Decimal numbers read straight from a file's bytes, rounded to f32 as `str::parse` rounds them.

/// The powers of ten that f64 holds exactly.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20,
    1e21, 1e22,
];
/// The most digits that u64 holds, whatever they are.
const MOST_DIGITS: usize = 19;

/// The finite number that a text begins with, and what follows it: whether that may follow is for the caller to say.
/// Nothing where the text begins otherwise, be it with a word that stands for a number.
pub(super) fn number(text: &[u8]) -> Option<(f32, &[u8])> {
    short(text).or_else(|| {
        let in_number = |byte: &u8| matches!(byte, b'0'..=b'9' | b'+' | b'-' | b'.' | b'e' | b'E');
        let (token, rest) = text.split_at(text.iter().position(|byte| !in_number(byte)).unwrap_or(text.len()));
        let value: f32 = str::from_utf8(token).ok()?.parse().ok()?;
        value.is_finite().then_some((value, rest))
    })
}

/// The whole number that a text begins with, of nine digits at most, and what follows it.
#[cfg(feature = "files")]
pub(super) fn whole(text: &[u8]) -> Option<(u32, &[u8])> {
    let (value, rest) = digits(text, 0);
    (1..=9).contains(&(text.len() - rest.len())).then_some((value as u32, rest))
}

/// A number of few digits: their whole number and a power of ten are both exact in f64, so that one operation gives the
/// number as f64 rounds it, and that gives it as f32 does unless it is half-way between two of these.
fn short(text: &[u8]) -> Option<(f32, &[u8])> {
    let (negative, text) = match text {
        [b'-', text @ ..] => (true, text),
        _ => (false, text),
    };
    let (mut value, mut rest) = digits(text, 0);
    let (mut count, mut exponent) = (text.len() - rest.len(), 0);
    if let [b'.', fraction @ ..] = rest {
        let length;
        (value, length) = fraction_after(value, fraction);
        (count, exponent) = (count + length, -(length as i64));
        rest = &fraction[length..];
    }
    if !(1..=MOST_DIGITS).contains(&count) || value > 1 << f64::MANTISSA_DIGITS {
        return None;
    }
    if let [b'e' | b'E', power @ ..] = rest {
        let (down, power) = match power {
            [b'-', power @ ..] => (true, power),
            [b'+', power @ ..] => (false, power),
            _ => (false, power),
        };
        let (power_of_ten, after) = digits(power, 0);
        if !(1..=MOST_DIGITS).contains(&(power.len() - after.len())) {
            return None;
        }
        let power_of_ten = i64::try_from(power_of_ten).ok()?;
        (exponent, rest) = (exponent.checked_add(if down { -power_of_ten } else { power_of_ten })?, after);
    }
    let power = *POWERS.get(usize::try_from(exponent.unsigned_abs()).ok()?)?;
    let wide = if exponent < 0 { value as f64 / power } else { value as f64 * power };
    // Of f32's fraction f64 has 29 bits more.
    let half_way = wide.to_bits() << 35 == 1 << 63;
    let ordinary = (f32::MIN_POSITIVE.into()..=f32::MAX.into()).contains(&wide);
    if wide != 0.0 && (half_way || !ordinary) {
        return None;
    }
    Some((if negative { -(wide as f32) } else { wide as f32 }, rest))
}

/// Appends the digits that a text begins with to those of `value`; more than [`MOST_DIGITS`] make nothing of use.
fn digits(mut text: &[u8], mut value: u64) -> (u64, &[u8]) {
    while let [digit @ b'0'..=b'9', rest @ ..] = text {
        value = value.wrapping_mul(10).wrapping_add((digit - b'0').into());
        text = rest;
    }
    (value, text)
}

/// Appends the digits that a text begins with, and says how many they are: if they are at most 16, without a branch by
/// their number, which would be guessed wrongly at every other one.
fn fraction_after(value: u64, text: &[u8]) -> (u64, usize) {
    const POWERS: [u64; 9] = [1, 10, 100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000];
    let whole = |eights: &&[u8; 16]| text.get(eights.len()).is_none_or(|byte| !byte.is_ascii_digit());
    let Some(eights) = text.first_chunk::<16>().filter(whole) else {
        let (value, rest) = digits(text, value);
        return (value, text.len() - rest.len());
    };
    let [one, two] = [0, 8].map(|at| u64::from_le_bytes(eights[at..at + 8].try_into().expect("eight bytes")));
    let in_one = count_digits(one);
    let in_two = if in_one == 8 { count_digits(two) } else { 0 };
    let value = value.wrapping_mul(POWERS[in_one]).wrapping_add(first_digits(one, in_one));
    (value.wrapping_mul(POWERS[in_two]).wrapping_add(first_digits(two, in_two)), in_one + in_two)
}

/// How many of eight characters, the first in the lowest byte, come before one that is no digit.
fn count_digits(text: u64) -> usize {
    let digits = text ^ 0x3030_3030_3030_3030;
    // What is 10 or more gets its highest bit; what that carries into is not looked at.
    let others = (digits | digits.wrapping_add(0x7676_7676_7676_7676)) & 0x8080_8080_8080_8080;
    (others.trailing_zeros() / 8) as usize
}

/// The number that the first of eight characters make.
fn first_digits(text: u64, count: usize) -> u64 {
    // They become the last of eight, after zeros.
    let digits = if count == 0 { 0 } else { (text ^ 0x3030_3030_3030_3030) << (64 - 8 * count) };
    // Neighbours are put together: digits to pairs, pairs to fours, and the two fours.
    let pairs = digits.wrapping_mul((10 << 8) | 1) >> 8 & 0x00ff_00ff_00ff_00ff;
    let fours = pairs.wrapping_mul((100 << 16) | 1) >> 16 & 0x0000_ffff_0000_ffff;
    fours.wrapping_mul((10_000 << 32) | 1) >> 32
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
