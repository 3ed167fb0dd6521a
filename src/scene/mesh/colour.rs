//! Colours as mesh files store them: values on the sRGB curve, converted to linear light on
//! reading.

use std::sync::LazyLock;

use glam::Vec3;

use crate::scene::srgb::{decode, encode};

/// The linear light of each level from 0 to 255.
static LEVELS: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|level| to_linear(level as f64 / f64::from(u8::MAX))));

/// The linear light of a file's value, where 1 is white. Negative and infinite values become
/// the nearest valid ones, and a NaN becomes 0.
pub(in crate::scene) fn to_linear(encoded: f64) -> f32 {
    if encoded > 0.0 { (decode(encoded) as f32).min(f32::MAX) } else { 0.0 }
}

/// The linear light of a level from 0 to 255.
pub(in crate::scene) fn level_to_linear(level: u8) -> f32 {
    LEVELS[usize::from(level)]
}

/// The 8-bit levels that are read as exactly this colour, if there are such levels.
pub(in crate::scene) fn to_levels(colour: Vec3) -> Option<[u8; 3]> {
    let levels = colour.to_array().map(|linear| (encode(linear.into()) * f64::from(u8::MAX)).round() as u8);
    (levels.map(level_to_linear) == colour.to_array()).then_some(levels)
}

/// The value that is read from a file as this linear light.
pub(in crate::scene) fn to_encoded(linear: f32) -> f64 {
    encode(linear.into())
}

/// [`to_encoded`] with as few digits as suffice to restore the linear light. If the file had a
/// value of up to six digits, the result is that value.
pub(in crate::scene) fn to_short_encoded(linear: f32) -> f64 {
    let exact = to_encoded(linear);
    let rounded = |digits: usize| format!("{exact:.digits$e}").parse().expect("a number");
    (5..16).map(rounded).find(|short| to_linear(*short) == linear).unwrap_or(exact)
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::{level_to_linear, to_encoded, to_levels, to_linear, to_short_encoded};
    use crate::scene::Rng;

    #[test]
    fn every_colour_is_read_again_to_the_last_bit() {
        let seed = 7;
        println!("seed {seed}");
        let mut rng = Rng::new(seed);
        let near_the_crossing = (0..2000).map(|step| f32::from_bits(0.003_13_f32.to_bits() + step));
        let others = (0..100_000).map(|_| f32::from_bits((rng.next_u64() % u64::from(f32::MAX.to_bits())) as u32));
        for linear in near_the_crossing.chain(others).chain([0.0, 1.0, f32::MAX, f32::MIN_POSITIVE, f32::from_bits(1)])
        {
            assert_eq!(to_linear(to_encoded(linear)), linear);
            assert_eq!(to_linear(to_short_encoded(linear)), linear);
        }
    }

    #[test]
    fn levels_and_short_numbers_come_back_as_they_were() {
        for level in 0..=255 {
            let linear = level_to_linear(level);
            assert_eq!(to_levels(Vec3::splat(linear)), Some([level; 3]));
            assert_eq!(to_linear(f64::from(level) / 255.0), linear);
        }
        for millionths in (0..=1_000_000).step_by(37) {
            let encoded: f64 = format!("0.{millionths:06}").parse().unwrap();
            assert_eq!(to_short_encoded(to_linear(encoded)), encoded);
        }
        assert_eq!(to_levels(Vec3::new(0.5, 1.0, 0.0)), None);
    }

    #[test]
    fn what_is_no_colour_becomes_the_nearest_one() {
        for (encoded, linear) in [(-1.0, 0.0), (f64::NAN, 0.0), (f64::INFINITY, f32::MAX), (1.0, 1.0), (0.0, 0.0)] {
            assert_eq!(to_linear(encoded), linear, "{encoded}");
        }
        // Half of the light is 188 of 255, and level 128 a fifth of it.
        assert!((to_encoded(0.5) * 255.0 - 187.5).abs() < 0.05);
        assert!((level_to_linear(128) - 0.2158605).abs() < 1e-6);
    }
}
