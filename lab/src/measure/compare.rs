//! The comparison of two pictures: how many pixels differ, by how much, and where.

use rayo::{Picture, Pixels};
use serde::Serialize;
use thiserror::Error;

/// The brightness, out of 255, with which [`difference_image`] shows the smallest difference.
pub const LEAST_SHADE: f64 = 64.0;

/// Why two pictures cannot be compared.
#[derive(Debug, Error, Clone, PartialEq, Eq)]
pub enum CompareError {
    /// The pixels do not correspond.
    #[error(
        "the first picture has {}x{} pixels and the second {}x{}: \
         only pictures of one size can be compared", .0.0, .0.1, .1.0, .1.1
    )]
    Sizes((u32, u32), (u32, u32)),
    /// Levels and linear values have no common unit without a choice of quantisation.
    #[error(
        "the first picture has {} and the second {}: \
         write both in the same kind of format (say, both .png or both .pfm)", .0.describe(), .1.describe()
    )]
    Kinds(Unit, Unit),
}

/// The unit of a [`Comparison`]'s differences.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Unit {
    /// Steps of an 8-bit channel, from 0 to 255.
    Levels,
    /// Linear values of a float channel, in which 1/255 corresponds to one level.
    Linear,
}

impl Unit {
    fn of(pixels: &Pixels) -> Unit {
        match pixels {
            Pixels::Rgb8(_) => Unit::Levels,
            Pixels::Rgb32F(_) => Unit::Linear,
        }
    }

    fn describe(self) -> &'static str {
        match self {
            Unit::Levels => "8-bit levels",
            Unit::Linear => "float values",
        }
    }

    /// The value of full brightness, PSNR's peak.
    fn peak(self) -> f64 {
        match self {
            Unit::Levels => 255.0,
            Unit::Linear => 1.0,
        }
    }
}

/// The result of [`compare`]. Two pixels differ by as much as the channel in which they differ
/// most.
///
/// Between floats, NaN equals NaN, and infinity equals infinity of the same sign; the difference of
/// a NaN and a number is infinite. JSON has no infinity: `largest`, `mean`, `rms` and `psnr` are
/// `null` there if they are infinite.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Comparison {
    /// Pixels in a row of either picture.
    pub width: u32,
    /// Rows of either picture.
    pub height: u32,
    /// The unit of `largest`, `mean` and `rms`.
    pub unit: Unit,
    /// Pixels that differ at all.
    pub differing: u64,
    /// Pixels that differ by one level or more (1/255 in floats).
    pub off_by_1: u64,
    /// Pixels that differ by two levels or more (2/255 in floats).
    pub off_by_2: u64,
    /// Pixels whose difference is infinite, which 8-bit pictures have none of.
    pub infinite: u64,
    /// The largest difference of any channel.
    pub largest: f64,
    /// The pixel `(x, y)` of `largest`, counted from the upper left; the first one in reading
    /// order. `None` if nothing differs.
    pub largest_at: Option<(u32, u32)>,
    /// Mean absolute difference over all channels of all pixels.
    pub mean: f64,
    /// Root of the mean squared difference over all channels of all pixels.
    pub rms: f64,
    /// Peak signal-to-noise ratio `20 log10(peak / rms)` in decibels, with a peak of 255 levels or
    /// of 1 in floats; infinite when nothing differs.
    pub psnr: f64,
}

/// Compares two pictures of the same size and kind, pixel by pixel.
///
/// # Errors
/// If the sizes differ, or if one has levels and the other floats.
///
/// # Panics
/// If a picture does not have the number of pixels that it claims.
pub fn compare(a: &Picture, b: &Picture) -> Result<Comparison, CompareError> {
    Ok(tally(a, differences(a, b)?))
}

/// Shows where two pictures differ, however little. The result is an 8-bit picture of |a - b| per
/// channel: from [`LEAST_SHADE`] for the smallest difference to 255 for the largest finite one, and
/// 255 for an infinite one. Equal pixels are black.
///
/// # Errors
/// If the sizes differ, or if one has levels and the other floats.
///
/// # Panics
/// If a picture does not have the number of pixels that it claims.
pub fn difference_image(a: &Picture, b: &Picture) -> Result<Picture, CompareError> {
    let largest = differences(a, b)?.flatten().filter(|d| d.is_finite()).fold(0.0, f64::max);
    let shade = |d: f64| match d {
        0.0 => 0,
        // A cast from float to integer saturates, so that an infinite difference becomes 255.
        _ => (LEAST_SHADE + (255.0 - LEAST_SHADE) * (d / largest)).round() as u8,
    };
    let pixels = differences(a, b)?.map(|pixel| pixel.map(shade)).collect();
    Ok(Picture::new(a.width, a.height, Pixels::Rgb8(pixels)))
}

/// The difference of each pair of pixels, per channel.
type Differences<'a> = Box<dyn Iterator<Item = [f64; 3]> + 'a>;

fn differences<'a>(a: &'a Picture, b: &'a Picture) -> Result<Differences<'a>, CompareError> {
    a.check();
    b.check();
    if (a.width, a.height) != (b.width, b.height) {
        return Err(CompareError::Sizes((a.width, a.height), (b.width, b.height)));
    }
    match (&a.pixels, &b.pixels) {
        (Pixels::Rgb8(p), Pixels::Rgb8(q)) => Ok(Box::new(p.iter().zip(q).map(|(p, q)| level_differences(p, q)))),
        (Pixels::Rgb32F(p), Pixels::Rgb32F(q)) => Ok(Box::new(p.iter().zip(q).map(|(p, q)| linear_differences(p, q)))),
        (p, q) => Err(CompareError::Kinds(Unit::of(p), Unit::of(q))),
    }
}

fn level_differences(p: &[u8; 3], q: &[u8; 3]) -> [f64; 3] {
    std::array::from_fn(|channel| f64::from(p[channel].abs_diff(q[channel])))
}

fn linear_differences(p: &[f32; 3], q: &[f32; 3]) -> [f64; 3] {
    std::array::from_fn(|channel| {
        let (p, q) = (p[channel], q[channel]);
        if p == q || (p.is_nan() && q.is_nan()) {
            0.0
        } else if p.is_nan() || q.is_nan() {
            f64::INFINITY
        } else {
            // Two f32 that differ also differ in f64, where their difference does not underflow.
            (f64::from(p) - f64::from(q)).abs()
        }
    })
}

/// Sums up the differences of all pixels of two pictures shaped like `shape`, in reading order.
fn tally(shape: &Picture, differences: impl Iterator<Item = [f64; 3]>) -> Comparison {
    let unit = Unit::of(&shape.pixels);
    let level = unit.peak() / 255.0;
    let mut result = Comparison {
        width: shape.width,
        height: shape.height,
        unit,
        differing: 0,
        off_by_1: 0,
        off_by_2: 0,
        infinite: 0,
        largest: 0.0,
        largest_at: None,
        mean: 0.0,
        rms: 0.0,
        psnr: f64::INFINITY,
    };
    // For levels these sums are integers, which f64 holds exactly up to 2^53.
    let (mut sum, mut squares) = (0.0, 0.0);
    let mut largest_index = 0;
    for (index, [r, g, b]) in differences.enumerate() {
        let pixel = r.max(g).max(b);
        if pixel == 0.0 {
            continue;
        }
        sum += r + g + b;
        squares += r * r + g * g + b * b;
        result.differing += 1;
        result.off_by_1 += u64::from(pixel >= level);
        result.off_by_2 += u64::from(pixel >= 2.0 * level);
        result.infinite += u64::from(pixel.is_infinite());
        if pixel > result.largest {
            result.largest = pixel;
            largest_index = index;
        }
    }
    if result.differing > 0 {
        let width = shape.width as usize;
        result.largest_at = Some(((largest_index % width) as u32, (largest_index / width) as u32));
        let samples = 3.0 * shape.pixels.len() as f64;
        result.mean = sum / samples;
        result.rms = (squares / samples).sqrt();
        result.psnr = 20.0 * (unit.peak() / result.rms).log10();
    }
    result
}
