//! The grammar of numbers that all text formats of meshes share.

/// A number of a file, rounded to f64 and to f32 (which may overflow to infinity).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::scene) struct Number {
    pub double: f64,
    pub single: f32,
}

impl Number {
    /// A number given as an f64, such as one from a binary file.
    pub(in crate::scene) fn of(double: f64) -> Self {
        Number { double, single: double as f32 }
    }

    /// The number that a word is: digits with optional sign, point and exponent; `nan` or
    /// `inf`.
    pub(in crate::scene) fn of_word(word: &[u8]) -> Option<Self> {
        let word = str::from_utf8(word).ok()?;
        let Ok(double) = word.parse::<f64>() else { return not_finite(word).map(Number::of) };
        // Rounding to f64 and then to f32 equals rounding once, except where the f64 is halfway
        // between two f32: parse again then. f32 below the smallest normal one have fewer digits,
        // so their halves lie elsewhere.
        const DIGITS_MORE: u32 = f64::MANTISSA_DIGITS - f32::MANTISSA_DIGITS;
        let is_halfway = double.to_bits() << (u64::BITS - DIGITS_MORE) == 1 << (u64::BITS - 1);
        let is_small = double.abs() < f64::from(f32::MIN_POSITIVE);
        let single = if is_halfway || is_small { word.parse().ok()? } else { double as f32 };
        Some(Number { double, single })
    }
}

/// NaN or infinity as C libraries write them: `-nan(ind)`, `1.#QNAN`, `-1.#INF`.
fn not_finite(word: &str) -> Option<f64> {
    let word = word.trim_start_matches(['-', '+']).to_ascii_lowercase();
    match word.strip_prefix("1.#") {
        Some(kind) if kind.starts_with("inf") => Some(f64::INFINITY),
        Some(_) => Some(f64::NAN),
        None => word.starts_with("nan(").then_some(f64::NAN),
    }
}

#[cfg(test)]
mod tests {
    use super::Number;
    use crate::scene::Rng;

    #[test]
    fn a_number_is_rounded_to_f32_once() {
        let mut rng = Rng::new(3);
        for _ in 0..20_000 {
            let bits = rng.next_u64() as u32;
            let (low, high) = (f32::from_bits(bits), f32::from_bits(bits + 1));
            if !low.is_finite() || !high.is_finite() {
                continue;
            }
            // Halfway between two neighbours, written out to the last digit, and a little more or
            // less than that.
            let halfway = (f64::from(low) + f64::from(high)) / 2.0;
            let text = format!("{halfway:.200}");
            let more = format!("{text}1");
            for word in [&text, &more, &format!("{:e}", f64::from(low)), &format!("{low}")] {
                let number = Number::of_word(word.as_bytes()).unwrap();
                assert_eq!(number.single.to_bits(), word.parse::<f32>().unwrap().to_bits(), "{word}");
                assert_eq!(number.double.to_bits(), word.parse::<f64>().unwrap().to_bits(), "{word}");
            }
        }
    }
}
