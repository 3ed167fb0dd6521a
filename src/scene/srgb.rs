//! The sRGB curve (IEC 61966-2-1) between linear light, in which scenes count, and what pictures
//! and mesh files hold.

/// Where the line and the power of the curve cross. The standard rounds this place to 0.0031308 and
/// 0.04045: up to 3e-8 apart, so that some values there would have no inverse.
const CROSSING: f64 = 0.003_130_668_442_500_63;
/// The slope of the line.
const SLOPE: f64 = 12.92;

/// The encoded value of linear light from 0; the curve goes on beyond 1.
pub fn encode(linear: f64) -> f64 {
    if linear <= CROSSING { SLOPE * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// The linear light of an encoded value from 0: the inverse of [`encode`].
#[cfg(feature = "files")]
pub fn decode(encoded: f64) -> f64 {
    if encoded <= SLOPE * CROSSING { encoded / SLOPE } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}
