//! The sRGB transfer function (IEC 61966-2-1), which converts between the linear light that scenes
//! are computed in and the encoded values of pictures and mesh files.

/// The linear light at which the linear part and the power part of the curve meet. The standard
/// rounds this point to 0.0031308, or 0.04045 encoded; there the parts are up to 3e-8 apart, so
/// that some values would have no inverse.
const CROSSING: f64 = 0.003_130_668_442_500_63;
/// The slope of the linear part.
const SLOPE: f64 = 12.92;

/// The encoded value of linear light, which must not be negative; also defined beyond 1.
pub fn encode(linear: f64) -> f64 {
    if linear <= CROSSING { SLOPE * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The linear light of an encoded value that is not negative: the inverse of [`encode`].
#[cfg(feature = "files")]
pub fn decode(encoded: f64) -> f64 {
    if encoded <= SLOPE * CROSSING { encoded / SLOPE } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}
