//! Pixels in memory: floats or bytes, and the step from one to the other.

use std::collections::TryReserveError;

use crate::kernels::Vec4;

/// What a pixel is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelFormat {
    /// Four floats: linear red, green, blue, and 0.
    F32x4,
    /// Four bytes: red, green, blue from 0 to 255, and 255.
    Rgba8,
}

impl PixelFormat {
    /// Bytes of a pixel.
    pub fn bytes(self) -> usize {
        match self {
            PixelFormat::F32x4 => size_of::<Vec4>(),
            PixelFormat::Rgba8 => size_of::<[u8; 4]>(),
        }
    }

    /// The name that tables and JSON carry.
    pub fn name(self) -> &'static str {
        match self {
            PixelFormat::F32x4 => "f32x4",
            PixelFormat::Rgba8 => "rgba8",
        }
    }
}

/// Whole rows of an image.
#[derive(Clone, Debug, PartialEq)]
pub enum Film {
    /// Floats.
    F32x4(Vec<Vec4>),
    /// Bytes.
    Rgba8(Vec<[u8; 4]>),
}

/// A part of a [`Film`] to write to.
#[derive(Debug)]
pub enum FilmMut<'a> {
    /// Floats.
    F32x4(&'a mut [Vec4]),
    /// Bytes.
    Rgba8(&'a mut [[u8; 4]]),
}

impl Film {
    /// A film of `pixels` pixels, none of them black: each is touched, and shows where nobody has written.
    pub fn new(format: PixelFormat, pixels: usize) -> Result<Self, TryReserveError> {
        fn filled<T: Clone>(pixels: usize, value: T) -> Result<Vec<T>, TryReserveError> {
            let mut film = Vec::new();
            film.try_reserve_exact(pixels)?;
            film.resize(pixels, value);
            Ok(film)
        }
        Ok(match format {
            PixelFormat::F32x4 => Film::F32x4(filled(pixels, [f32::NAN; 4].into())?),
            PixelFormat::Rgba8 => Film::Rgba8(filled(pixels, [255, 0, 255, 0])?),
        })
    }

    /// All of it, to write to.
    pub fn as_mut(&mut self) -> FilmMut<'_> {
        match self {
            Film::F32x4(pixels) => FilmMut::F32x4(pixels),
            Film::Rgba8(pixels) => FilmMut::Rgba8(pixels),
        }
    }
}

impl<'a> FilmMut<'a> {
    /// Its first `pixels` pixels.
    pub fn take(self, pixels: usize) -> FilmMut<'a> {
        match self {
            FilmMut::F32x4(film) => FilmMut::F32x4(&mut film[..pixels]),
            FilmMut::Rgba8(film) => FilmMut::Rgba8(&mut film[..pixels]),
        }
    }

    /// Pixels.
    pub fn len(&self) -> usize {
        match self {
            FilmMut::F32x4(pixels) => pixels.len(),
            FilmMut::Rgba8(pixels) => pixels.len(),
        }
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The 8-bit level of a linear value: floor(255 v) with v clamped to [0, 1], and 0 for a NaN.
///
/// A value in f32 is to be passed exactly: 255 v has 32 bits at most and is exact in f64.
pub fn level(v: f64) -> u8 {
    (255.0 * v.clamp(0.0, 1.0)) as u8
}

/// The pixels of 8 bits that linear ones become.
pub fn levels(linear: &Vec4) -> [u8; 4] {
    [level(linear.x.into()), level(linear.y.into()), level(linear.z.into()), 255]
}

#[cfg(test)]
mod tests {
    use super::level;

    #[test]
    fn levels_are_clamped_and_rounded_down() {
        for (v, expected) in [
            (0.0, 0),
            (-0.5, 0),
            (1.0, 255),
            (7.5, 255),
            (f64::INFINITY, 255),
            (f64::NEG_INFINITY, 0),
            (f64::NAN, 0),
            (0.5, 127),
            (1.0 / 255.0, 1),
            (f64::from((1.0_f32 / 255.0).next_down()), 0),
            (f64::from(1.0_f32.next_down()), 254),
        ] {
            assert_eq!(level(v), expected, "{v}");
        }
    }
}
