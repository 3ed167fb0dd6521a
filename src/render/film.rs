//! Pixels in memory, each of three or four floats or bytes, and conversions between them.

use std::collections::TryReserveError;
use std::ops::Range;

use glam::DVec3;

use crate::kernels::memory::try_reserve;
use crate::kernels::{self, Narrow, Vec4};

/// The format of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelFormat {
    /// Four floats: linear red, green, blue, and 0.
    F32x4,
    /// Three floats: linear red, green, blue.
    F32x3,
    /// Four bytes: red, green, blue from 0 to 255, and 255.
    Rgba8,
    /// Three bytes: red, green, blue from 0 to 255.
    Rgb8,
    /// The number `0xffRRGGBB`, which windows use: on little-endian machines the bytes blue, green,
    /// red and 255.
    Bgra8,
}

impl PixelFormat {
    /// All formats, in the order of their variants.
    pub const ALL: [PixelFormat; 5] =
        [PixelFormat::F32x4, PixelFormat::F32x3, PixelFormat::Rgba8, PixelFormat::Rgb8, PixelFormat::Bgra8];

    /// The bytes of a pixel.
    pub fn bytes(self) -> usize {
        match self {
            PixelFormat::F32x4 => size_of::<Vec4>(),
            PixelFormat::F32x3 => size_of::<[f32; 3]>(),
            PixelFormat::Rgba8 => size_of::<[u8; 4]>(),
            PixelFormat::Rgb8 => size_of::<[u8; 3]>(),
            PixelFormat::Bgra8 => size_of::<u32>(),
        }
    }

    /// Whether pixels are levels from 0 to 255, and not floats.
    pub fn is_8bit(self) -> bool {
        match self {
            PixelFormat::F32x4 | PixelFormat::F32x3 => false,
            PixelFormat::Rgba8 | PixelFormat::Rgb8 | PixelFormat::Bgra8 => true,
        }
    }

    /// The format's name in tables and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            PixelFormat::F32x4 => "f32x4",
            PixelFormat::F32x3 => "f32x3",
            PixelFormat::Rgba8 => "rgba8",
            PixelFormat::Rgb8 => "rgb8",
            PixelFormat::Bgra8 => "bgra8",
        }
    }
}

/// The colour of a pixel in any format.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Colour {
    /// Linear red, green, blue.
    Linear([f32; 3]),
    /// Red, green, blue from 0 to 255.
    Levels([u8; 3]),
}

impl Colour {
    /// The colour as 8-bit levels.
    pub fn levels(self) -> [u8; 3] {
        match self {
            Colour::Linear(linear) => linear.map(|v| level(v.into())),
            Colour::Levels(levels) => levels,
        }
    }
}

/// A pixel as a Rust type.
pub trait Pixel: Copy + Send + 'static {
    /// The format of such pixels.
    const FORMAT: PixelFormat;
    /// Makes a pixel of a linear colour. Floats are clamped to the largest f32.
    fn of_colour(colour: DVec3) -> Self;
    /// Makes a pixel of a linear colour of four floats.
    fn of_linear(linear: &Vec4) -> Self;
    /// The linear colour of the pixel.
    fn colour(self) -> Colour;
    /// Wraps a slice of pixels of this type as a film to write to.
    fn film(pixels: &mut [Self]) -> FilmMut<'_>;
}

impl Pixel for Vec4 {
    const FORMAT: PixelFormat = PixelFormat::F32x4;
    fn of_colour(colour: DVec3) -> Self {
        // The sum of very bright lights may exceed f32.
        colour.min(DVec3::splat(f32::MAX.into())).as_vec3().into()
    }
    fn of_linear(linear: &Vec4) -> Self {
        *linear
    }
    fn colour(self) -> Colour {
        Colour::Linear([self.x, self.y, self.z])
    }
    fn film(pixels: &mut [Self]) -> FilmMut<'_> {
        FilmMut::F32x4(pixels)
    }
}

impl Pixel for [f32; 3] {
    const FORMAT: PixelFormat = PixelFormat::F32x3;
    fn of_colour(colour: DVec3) -> Self {
        Self::of_linear(&Pixel::of_colour(colour))
    }
    fn of_linear(linear: &Vec4) -> Self {
        [linear.x, linear.y, linear.z]
    }
    fn colour(self) -> Colour {
        Colour::Linear(self)
    }
    fn film(pixels: &mut [Self]) -> FilmMut<'_> {
        FilmMut::F32x3(pixels)
    }
}

impl Pixel for [u8; 4] {
    const FORMAT: PixelFormat = PixelFormat::Rgba8;
    fn of_colour(colour: DVec3) -> Self {
        let [r, g, b] = Pixel::of_colour(colour);
        [r, g, b, 255]
    }
    fn of_linear(linear: &Vec4) -> Self {
        let [r, g, b] = Pixel::of_linear(linear);
        [r, g, b, 255]
    }
    fn colour(self) -> Colour {
        let [r, g, b, _] = self;
        Colour::Levels([r, g, b])
    }
    fn film(pixels: &mut [Self]) -> FilmMut<'_> {
        FilmMut::Rgba8(pixels)
    }
}

impl Pixel for [u8; 3] {
    const FORMAT: PixelFormat = PixelFormat::Rgb8;
    fn of_colour(colour: DVec3) -> Self {
        colour.to_array().map(level)
    }
    fn of_linear(linear: &Vec4) -> Self {
        linear.colour().levels()
    }
    fn colour(self) -> Colour {
        Colour::Levels(self)
    }
    fn film(pixels: &mut [Self]) -> FilmMut<'_> {
        FilmMut::Rgb8(pixels)
    }
}

/// A pixel of [`PixelFormat::Bgra8`].
impl Pixel for u32 {
    const FORMAT: PixelFormat = PixelFormat::Bgra8;
    fn of_colour(colour: DVec3) -> Self {
        bgra(Pixel::of_colour(colour))
    }
    fn of_linear(linear: &Vec4) -> Self {
        bgra(Pixel::of_linear(linear))
    }
    fn colour(self) -> Colour {
        let [_, r, g, b] = self.to_be_bytes();
        Colour::Levels([r, g, b])
    }
    fn film(pixels: &mut [Self]) -> FilmMut<'_> {
        FilmMut::Bgra8(pixels)
    }
}

/// The pixel of [`PixelFormat::Bgra8`] with the colour of one of [`PixelFormat::Rgba8`].
fn bgra([r, g, b, a]: [u8; 4]) -> u32 {
    u32::from_be_bytes([a, r, g, b])
}

/// Converts pixels of [`PixelFormat::Rgba8`] to as many of [`PixelFormat::Bgra8`].
pub(super) fn rgba_to_bgra(rgba: &[[u8; 4]], out: &mut [u32]) {
    out.iter_mut().zip(rgba).for_each(|(out, pixel)| *out = bgra(*pixel));
}

/// Makes a function of a kernel that converts pixels of four channels to pixels of three.
pub(super) fn narrow<Four, Three>(kernel: &Narrow<Four, Three>) -> impl Fn(&[Four], &mut [Three]) {
    |four, three| kernel.call(four, three)
}

/// Pixels in memory: whole rows of a picture, from the top.
#[derive(Clone, Debug, PartialEq)]
pub enum Film {
    /// Four floats each.
    F32x4(Vec<Vec4>),
    /// Three floats each.
    F32x3(Vec<[f32; 3]>),
    /// Four bytes each.
    Rgba8(Vec<[u8; 4]>),
    /// Three bytes each.
    Rgb8(Vec<[u8; 3]>),
    /// Four bytes each, as a number.
    Bgra8(Vec<u32>),
}

/// There is not enough memory for a film.
#[derive(Clone, Debug, thiserror::Error)]
#[error("there is no memory for {bytes} bytes of pixels: {source}")]
pub struct NoMemory {
    /// The memory requested.
    pub bytes: usize,
    /// The allocator's error.
    pub source: TryReserveError,
}

/// A buffer has the wrong size.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{what}: found {found}, expected {expected}")]
pub struct WrongSize {
    /// What was counted, and in which unit.
    pub what: &'static str,
    /// The number found.
    pub found: usize,
    /// The number required, or required at least.
    pub expected: usize,
}

/// Pixels to write to: a [`Film`], a part of one, or any buffer of a caller.
#[derive(Debug)]
pub enum FilmMut<'a> {
    /// Four floats each.
    F32x4(&'a mut [Vec4]),
    /// Three floats each.
    F32x3(&'a mut [[f32; 3]]),
    /// Four bytes each.
    Rgba8(&'a mut [[u8; 4]]),
    /// Three bytes each.
    Rgb8(&'a mut [[u8; 3]]),
    /// Four bytes each, as a number.
    Bgra8(&'a mut [u32]),
}

/// Evaluates an expression with the pixels of a film, which is a `$kind`. It is compiled once for
/// each pixel format.
macro_rules! with_pixels {
    ($kind:ident($pixels:ident) = $film:expr => $use:expr) => {
        match $film {
            $kind::F32x4($pixels) => $use,
            $kind::F32x3($pixels) => $use,
            $kind::Rgba8($pixels) => $use,
            $kind::Rgb8($pixels) => $use,
            $kind::Bgra8($pixels) => $use,
        }
    };
}
pub(super) use with_pixels;

impl Film {
    /// A film of `pixels` pixels. They are not black, so that all pages of its memory have been
    /// written to, and that a pixel which is never traced can be seen.
    pub fn new(format: PixelFormat, pixels: usize) -> Result<Self, NoMemory> {
        Self::filled(format, pixels).map_err(|source| NoMemory { bytes: pixels.saturating_mul(format.bytes()), source })
    }

    fn filled(format: PixelFormat, pixels: usize) -> Result<Self, TryReserveError> {
        fn filled<T: Clone>(pixels: usize, value: T) -> Result<Vec<T>, TryReserveError> {
            let mut film = Vec::new();
            try_reserve(&mut film, pixels)?;
            film.resize(pixels, value);
            Ok(film)
        }
        Ok(match format {
            PixelFormat::F32x4 => Film::F32x4(filled(pixels, [f32::NAN; 4].into())?),
            PixelFormat::F32x3 => Film::F32x3(filled(pixels, [f32::NAN; 3])?),
            PixelFormat::Rgba8 => Film::Rgba8(filled(pixels, [255, 0, 255, 0])?),
            PixelFormat::Rgb8 => Film::Rgb8(filled(pixels, [255, 0, 255])?),
            PixelFormat::Bgra8 => Film::Bgra8(filled(pixels, 0x00ff_00ff)?),
        })
    }

    /// The whole film, to write to.
    pub fn as_mut(&mut self) -> FilmMut<'_> {
        with_pixels!(Film(pixels) = self => Pixel::film(pixels))
    }

    /// The colour of a pixel of the film.
    ///
    /// # Panics
    /// If there is no such pixel.
    pub fn colour(&self, pixel: usize) -> Colour {
        with_pixels!(Film(pixels) = self => pixels[pixel].colour())
    }

    /// The pixels as they are in memory: floats of 4 bytes in the machine's byte order, or bytes.
    pub fn bytes(&self) -> &[u8] {
        with_pixels!(Film(pixels) = self => kernels::bytes(pixels))
    }

    /// Copies the film's rows of `width` pixels to a buffer whose rows begin `stride` bytes apart,
    /// as those of windows and textures do. Bytes between rows stay unchanged.
    ///
    /// # Errors
    /// If the film does not consist of whole rows of that width, or if they do not fit into the
    /// stride or the buffer.
    ///
    /// ```
    /// # use rayo::{Film, PixelFormat};
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let film = Film::new(PixelFormat::Rgb8, 3 * 2)?;
    /// let mut texture = [0; 2 * 16];
    /// film.copy_rows(3, &mut texture, 16)?;
    /// assert_eq!(texture[16..25], film.bytes()[9..]);
    /// assert!(film.copy_rows(3, &mut texture, 8).is_err());
    /// # Ok(())
    /// # }
    /// ```
    pub fn copy_rows(&self, width: usize, buffer: &mut [u8], stride: usize) -> Result<(), WrongSize> {
        if self.is_empty() {
            return Ok(());
        }
        let bytes = self.bytes();
        let row = (bytes.len() / self.len()).saturating_mul(width);
        let all = (self.len() / width.max(1)).saturating_sub(1).saturating_mul(stride).saturating_add(row);
        let rest = self.len() % width.max(1);
        for (what, found, expected, is_wrong) in [
            ("pixels in a row", width, 1, width == 0),
            ("pixels in the last row", rest, width, rest > 0),
            ("bytes from row to row", stride, row, stride < row),
            ("bytes of the buffer", buffer.len(), all, buffer.len() < all),
        ] {
            if is_wrong {
                return Err(WrongSize { what, found, expected });
            }
        }
        buffer.chunks_mut(stride).zip(bytes.chunks(row)).for_each(|(to, row)| to[..row.len()].copy_from_slice(row));
        Ok(())
    }

    /// The number of pixels.
    pub fn len(&self) -> usize {
        with_pixels!(Film(pixels) = self => pixels.len())
    }

    /// Whether the film has no pixels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl<'a> FilmMut<'a> {
    /// A range of the film's pixels.
    pub fn part(self, pixels: Range<usize>) -> FilmMut<'a> {
        with_pixels!(FilmMut(film) = self => Pixel::film(&mut film[pixels]))
    }

    /// Writes linear colours, converted to the film's format.
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn set(self, linear: &[Vec4]) {
        assert_eq!(self.len(), linear.len(), "as many pixels");
        with_pixels!(FilmMut(film) = self => {
            film.iter_mut().zip(linear).for_each(|(pixel, linear)| *pixel = Pixel::of_linear(linear));
        });
    }

    /// The format of the pixels.
    pub fn format(&self) -> PixelFormat {
        match self {
            FilmMut::F32x4(_) => PixelFormat::F32x4,
            FilmMut::F32x3(_) => PixelFormat::F32x3,
            FilmMut::Rgba8(_) => PixelFormat::Rgba8,
            FilmMut::Rgb8(_) => PixelFormat::Rgb8,
            FilmMut::Bgra8(_) => PixelFormat::Bgra8,
        }
    }

    /// The number of pixels.
    pub fn len(&self) -> usize {
        with_pixels!(FilmMut(pixels) = self => pixels.len())
    }

    /// Whether the film has no pixels.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The 8-bit level of a linear value: floor(255 v) with v clamped to [0, 1], and 0 for a NaN.
///
/// A value in f32 is to be passed unchanged: 255 v then has at most 32 significant bits and is
/// exact in f64.
pub fn level(v: f64) -> u8 {
    (255.0 * v.clamp(0.0, 1.0)) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn every_format_shows_the_same_colour() {
        let linear = [Vec4::new(0.5, 2.0, 0.25), Vec4::new(0.0, 1.0, 0.75)];
        for format in PixelFormat::ALL {
            let mut film = Film::new(format, 3).unwrap();
            assert_eq!((film.as_mut().format(), film.len(), film.is_empty()), (format, 3, false));
            film.as_mut().part(1..3).set(&linear);
            let expected = if format.is_8bit() {
                [[127, 255, 63], [0, 255, 191]].map(Colour::Levels)
            } else {
                [[0.5, 2.0, 0.25], [0.0, 1.0, 0.75]].map(Colour::Linear)
            };
            assert_eq!([film.colour(1), film.colour(2)], expected, "{}", format.name());
            assert_eq!(film.colour(1).levels(), [127, 255, 63]);
            film.as_mut().part(0..1).set(&linear[1..]);
            assert_eq!(film.colour(0), film.colour(2));
        }
        let colour = DVec3::new(1e300, 0.5, 0.0);
        assert_eq!(Vec4::of_colour(colour), Vec4::new(f32::MAX, 0.5, 0.0));
        assert_eq!(<[f32; 3]>::of_colour(colour), [f32::MAX, 0.5, 0.0]);
        assert_eq!(<[u8; 4]>::of_colour(colour), [255, 127, 0, 255]);
        assert_eq!(<[u8; 3]>::of_colour(colour), [255, 127, 0]);
        assert_eq!(u32::of_colour(colour), 0xff_ff7f00);
    }

    #[test]
    fn rows_are_copied_with_gaps_left_alone() {
        let linear: Vec<_> = (0..6).map(|i| Vec4::new(i as f32 / 255.0, 0.0, 1.0)).collect();
        for format in PixelFormat::ALL {
            let mut film = Film::new(format, 6).unwrap();
            film.as_mut().set(&linear);
            let row = 3 * format.bytes();
            for stride in [row, row + 5] {
                let mut buffer = vec![7; stride + row];
                film.copy_rows(3, &mut buffer, stride).unwrap();
                assert_eq!([&buffer[..row], &buffer[stride..]].concat(), film.bytes(), "{}", format.name());
                assert!(buffer[row..stride].iter().all(|byte| *byte == 7));
                let wrong =
                    |width, bytes: usize, stride| film.copy_rows(width, &mut vec![7; bytes], stride).unwrap_err();
                let what = |what, found, expected| WrongSize { what, found, expected };
                assert_eq!(
                    wrong(3, stride + row - 1, stride),
                    what("bytes of the buffer", stride + row - 1, stride + row)
                );
                assert_eq!(wrong(3, 999, row - 1), what("bytes from row to row", row - 1, row));
                assert_eq!(wrong(3, 999, usize::MAX), what("bytes of the buffer", 999, usize::MAX));
                assert_eq!(wrong(4, 999, 99), what("pixels in the last row", 2, 4));
                assert_eq!(wrong(usize::MAX, 999, 99), what("pixels in the last row", 6, usize::MAX));
                assert_eq!(wrong(0, 999, 99).to_string(), "pixels in a row: found 0, expected 1");
            }
            Film::new(format, 0).unwrap().copy_rows(3, &mut [], 0).unwrap();
            for (pixels, bytes) in [(1 << 56, format.bytes() << 56), (usize::MAX, usize::MAX)] {
                let told = Film::new(format, pixels).unwrap_err().to_string();
                assert!(told.starts_with(&format!("there is no memory for {bytes} bytes of pixels: ")), "{told}");
            }
        }
    }
}
