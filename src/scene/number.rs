//! Decimal numbers read straight from a file's bytes, rounded to f32 as `str::parse` rounds them.

/// The finite number at the start of a text, and what follows it: the caller decides whether that may follow.
#[inline]
pub(super) fn number(text: &[u8]) -> Option<(f32, &[u8])> {
    let (value, length) = usual(text).or_else(|| any(text))?;
    Some((value, &text[length..]))
}

#[cold]
fn any(text: &[u8]) -> Option<(f32, usize)> {
    fast_float2::parse_partial(text).ok().filter(|(value, _): &(f32, _)| value.is_finite())
}

/// A number of up to 15 digits without an exponent, followed by white space, and its length: nearly all numbers of a
/// file, for which the library takes half as long again.
#[inline]
fn usual(text: &[u8]) -> Option<(f32, usize)> {
    const MOST: usize = 15;
    const POWERS: [u64; MOST + 1] = {
        let mut powers = [1; MOST + 1];
        let mut i = 1;
        while i <= MOST {
            powers[i] = 10 * powers[i - 1];
            i += 1;
        }
        powers
    };
    // More digits would be too many.
    let text = &text[..text.len().min(MOST + 10)];
    let minus = *text.first()? == b'-';
    let start = usize::from(minus);
    let (mut value, mut at) = one_by_one(0, text, start);
    let (mut count, mut places) = (at - start, 0);
    if text.get(at) == Some(&b'.') {
        let first = at + 1;
        let (digits, length) = up_to_eight(text[first..].first_chunk()?);
        value = value.wrapping_mul(POWERS[length]).wrapping_add(digits);
        at = first + length;
        if length == 8 {
            (value, at) = one_by_one(value, text, at);
        }
        places = at - first;
        count += places;
    }
    if *text.get(at)? > b' ' || !(1..=MOST).contains(&count) {
        return None;
    }
    // Both are exact, and the quotient is rounded to f64. Rounding that to f32 is as good as rounding once, unless it
    // is half-way between two f32.
    let value = value as i64 as f64 / POWERS[places] as i64 as f64;
    let half_way = value.to_bits() << 35 == 1 << 63;
    (!half_way).then_some((if minus { -value } else { value } as f32, at))
}

/// The digits from a place on, appended to `value`, and the place after them; meaningless if they are too many.
#[inline]
fn one_by_one(mut value: u64, text: &[u8], mut at: usize) -> (u64, usize) {
    while let Some(digit) = text.get(at).map(|byte| byte.wrapping_sub(b'0')).filter(|digit| *digit < 10) {
        value = value.wrapping_mul(10).wrapping_add(digit.into());
        at += 1;
    }
    (value, at)
}

/// The number of the digits that a text begins with, and how many there are: all of them at once.
#[inline]
fn up_to_eight(text: &[u8; 8]) -> (u64, usize) {
    const fn each(byte: u8) -> u64 {
        u64::from_le_bytes([byte; 8])
    }
    // The first digit is in the lowest byte; bytes that are not digits have their highest bit set in `others`.
    let digits = u64::from_le_bytes(*text) ^ each(b'0');
    let others = (((digits & each(0x7f)) + each(0x80 - 10)) | digits) & each(0x80);
    let count = others.trailing_zeros() as usize / 8;
    if count == 0 {
        return (0, 0);
    }
    let ones = digits << (64 - 8 * count);
    let pairs = (ones.wrapping_mul(1 + (10 << 8)) >> 8) & 0x00ff_00ff_00ff_00ff;
    let fours = (pairs.wrapping_mul(1 + (100 << 16)) >> 16) & 0x0000_ffff_0000_ffff;
    (fours.wrapping_mul(1 + (10_000 << 32)) >> 32, count)
}

/// The integer at the start of a text, of at most nine digits, and what follows it.
#[cfg(feature = "files")]
#[inline]
pub(super) fn whole(text: &[u8]) -> Option<(u32, &[u8])> {
    let (value, length) = match text.first_chunk().map(up_to_eight) {
        Some((value, length @ ..8)) => (value, length),
        _ => one_by_one(0, text, 0),
    };
    (1..=9).contains(&length).then(|| (value as u32, &text[length..]))
}

#[cfg(test)]
mod tests {
    use super::super::Rng;
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
                // Half-way between two f32, and next to that.
                5 => agrees(&(f64::from(near) + f64::from(near.next_up())).to_string()),
                _ => agrees(&format!("{}.{digits}E{places}", digits % 1000)),
            }
        }
    }
}
