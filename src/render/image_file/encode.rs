//! One encoder per format, which turns rows of a picture into bytes, part by part.

use super::parts::{Encode, Join};
use super::png::{PngJoin, PngParts};
use super::threaded::{ExrParts, Threaded};
use super::{Extent, Format};
use crate::kernels::memory::try_reserve;
use crate::render::output::Sink;
use image::codecs::hdr::HdrEncoder;
use image::{ExtendedColorType, ImageEncoder, ImageError};
use std::borrow::Cow;
use std::io::{self, Seek, SeekFrom, Write};
use tiff::TiffError;
use tiff::encoder::colortype::RGB8;
use tiff::encoder::{Compression, DeflateLevel, Predictor, TiffEncoder};

/// The encoder of the parts of a picture in `format`.
pub(super) fn encoder(format: Format, extent: &Extent) -> Box<dyn Encode> {
    let width = extent.width as usize;
    match format {
        Format::Png => Box::new(PngParts::new(extent)),
        Format::Ppm | Format::Tiff | Format::Qoi => Box::new(Bytes),
        Format::PpmText => Box::new(PpmText { width }),
        Format::Pfm => Box::new(Pfm { width }),
        Format::Exr => Box::new(ExrParts::new(extent)),
        Format::Hdr => Box::new(Hdr),
    }
}

/// Begins a file of `format` by writing its header.
pub(super) fn joiner(format: Format, mut sink: Sink, extent: &Extent) -> io::Result<Box<dyn Join>> {
    let (width, height) = (extent.width, extent.height());
    Ok(match format {
        Format::Png => Box::new(PngJoin::new(sink, extent)?),
        Format::Ppm => {
            write!(sink, "P6\n{width} {height}\n255\n")?;
            Box::new(AppendJoin { sink })
        }
        Format::PpmText => {
            write!(sink, "P3\n{width} {height}\n255\n")?;
            Box::new(AppendJoin { sink })
        }
        Format::Pfm => Box::new(BottomUp::new(sink, width, height)?),
        Format::Exr => Box::new(Threaded::exr(sink, extent)),
        Format::Hdr | Format::Tiff | Format::Qoi => {
            Box::new(BufferedPicture { format, sink, size: (width, height), pixels: Vec::new() })
        }
    })
}

/// The most bytes of an image that is held in memory until it is complete.
pub(super) const MAX_WHOLE: u64 = 1 << 30;

/// Whether images of `format` are held in memory until they are complete.
pub(super) fn is_whole(format: Format) -> bool {
    matches!(format, Format::Hdr | Format::Tiff | Format::Qoi)
}

/// How many bytes of pixels are held for an image in such a format.
pub(super) fn whole_bytes(format: Format, (width, height): (u32, u32)) -> u64 {
    format.pixels().bytes() as u64 * u64::from(width) * u64::from(height)
}

/// Whether files of `format` are not written from front to back.
pub(super) fn needs_seeking(format: Format) -> bool {
    match format {
        Format::Png | Format::Ppm | Format::PpmText | Format::Hdr | Format::Qoi => false,
        Format::Pfm | Format::Exr | Format::Tiff => true,
    }
}

/// Writes the parts to the file one after the other.
struct AppendJoin {
    sink: Sink,
}

impl Join for AppendJoin {
    fn append(&mut self, part: Cow<'_, [u8]>) -> io::Result<()> {
        self.sink.write_all(&part)
    }
}

/// Encodes pixels as their bytes in memory.
struct Bytes;

impl Encode for Bytes {
    fn rgb8<'a>(&self, rows: &'a [[u8; 3]]) -> io::Result<Cow<'a, [u8]>> {
        Ok(rows.as_flattened().into())
    }
}

struct PpmText {
    width: usize,
}

impl PpmText {
    /// Appends a level in decimal.
    fn push_decimal(text: &mut Vec<u8>, level: u8) {
        if level >= 100 {
            text.push(b'0' + level / 100);
        }
        if level >= 10 {
            text.push(b'0' + level / 10 % 10);
        }
        text.push(b'0' + level % 10);
    }
}

impl Encode for PpmText {
    fn rgb8<'a>(&self, rows: &'a [[u8; 3]]) -> io::Result<Cow<'a, [u8]>> {
        let mut text = Vec::with_capacity("255 255 255\n".len() * rows.len());
        for pixels in rows.chunks_exact(self.width) {
            for &[r, g, b] in pixels {
                for (level, end) in [(r, b' '), (g, b' '), (b, b'\n')] {
                    Self::push_decimal(&mut text, level);
                    text.push(end);
                }
            }
        }
        Ok(text.into())
    }
}

/// Encodes PFM, whose rows go from the bottom to the top.
struct Pfm {
    width: usize,
}

impl Encode for Pfm {
    fn f32x3<'a>(&self, rows: &'a [[f32; 3]]) -> io::Result<Cow<'a, [u8]>> {
        let mut bytes = Vec::with_capacity(size_of_val(rows));
        for pixels in rows.chunks_exact(self.width).rev() {
            bytes.extend(pixels.as_flattened().iter().flat_map(|value| value.to_le_bytes()));
        }
        Ok(bytes.into())
    }
}

/// Writes each part before the previous one, since the file begins with the lowest rows.
struct BottomUp {
    sink: Sink,
    /// The position in the file where the next part ends.
    end: u64,
}

impl BottomUp {
    fn new(mut sink: Sink, width: u32, height: u32) -> io::Result<Self> {
        // The negative scale means that the floats are little endian.
        let header = format!("PF\n{width} {height}\n-1.0\n");
        sink.write_all(header.as_bytes())?;
        let pixels = u64::from(width) * u64::from(height);
        Ok(BottomUp { sink, end: header.len() as u64 + pixels * size_of::<[f32; 3]>() as u64 })
    }
}

impl Join for BottomUp {
    fn append(&mut self, part: Cow<'_, [u8]>) -> io::Result<()> {
        self.end -= part.len() as u64;
        self.sink.seek(SeekFrom::Start(self.end))?;
        self.sink.write_all(&part)
    }
}

/// Encodes Radiance's pixels: the floats are rounded first, so that its encoder has nothing to
/// round.
struct Hdr;

impl Hdr {
    /// Pixels below this are black, since the exponent has 8 bits.
    const SMALLEST: f32 = f32::MIN_POSITIVE;
    /// The largest number of the format: 255/256 of 2^127.
    const LARGEST: f32 = 255.0 * (1_u128 << 119) as f32;

    /// Rounds a pixel's channels to 8 bits with a common exponent. The library's encoder truncates
    /// instead, and computes a wrong exponent for numbers just below a power of two; after this
    /// rounding it has nothing left to do wrong.
    fn rounded(pixel: [f32; 3]) -> [f32; 3] {
        let channels = pixel.map(|value| value.clamp(0.0, Self::LARGEST));
        let most = |of: [f32; 3]| of.into_iter().fold(0.0, f32::max);
        if most(channels) < Self::SMALLEST {
            return [0.0; 3];
        }
        let in_units_of = |most: f32| {
            let unit = f32::from_bits(most.to_bits() & f32::INFINITY.to_bits()) / 128.0;
            channels.map(|value| (value / unit).round() * unit)
        };
        // Rounding may have made the greatest channel a power of two, which changes the exponent.
        in_units_of(most(in_units_of(most(channels))))
    }
}

impl Encode for Hdr {
    fn f32x3<'a>(&self, rows: &'a [[f32; 3]]) -> io::Result<Cow<'a, [u8]>> {
        let mut bytes = Vec::with_capacity(size_of_val(rows));
        for pixel in rows {
            bytes.extend(Self::rounded(*pixel).iter().flat_map(|value| value.to_ne_bytes()));
        }
        Ok(bytes.into())
    }
}

/// Keeps the pixels of a picture until it is complete, for formats whose libraries take it as a
/// whole.
struct BufferedPicture {
    format: Format,
    sink: Sink,
    size: (u32, u32),
    /// Three levels for each pixel or, in HDR, three floats.
    pixels: Vec<u8>,
}

impl Join for BufferedPicture {
    fn append(&mut self, part: Cow<'_, [u8]>) -> io::Result<()> {
        if self.pixels.is_empty() {
            try_reserve(&mut self.pixels, whole_bytes(self.format, self.size) as usize)?;
        }
        self.pixels.extend_from_slice(&part);
        Ok(())
    }

    fn finish(self: Box<Self>) -> io::Result<()> {
        let BufferedPicture { format, mut sink, size: (width, height), pixels } = *self;
        match format {
            Format::Hdr => {
                let encoder = HdrEncoder::new(sink);
                encoder.write_image(&pixels, width, height, ExtendedColorType::Rgb32F).map_err(image_error)
            }
            Format::Tiff => write_tiff(sink, (width, height), &pixels),
            _ => {
                // Not through the crate `image`, which would declare the linear values as sRGB.
                let encoder = qoi::Encoder::new(&pixels, width, height).map_err(io::Error::other)?;
                let encoder = encoder.with_colorspace(qoi::ColorSpace::Linear);
                encoder.encode_to_stream(&mut sink).map(drop).map_err(qoi_error)
            }
        }
    }
}

/// Writes a TIFF by the crate `tiff`, since the crate `image` does not compress it.
fn write_tiff(sink: Sink, (width, height): (u32, u32), pixels: &[u8]) -> io::Result<()> {
    let compressed = |encoder: TiffEncoder<Sink>| {
        let encoder = encoder.with_compression(Compression::Deflate(DeflateLevel::Fast));
        encoder.with_predictor(Predictor::Horizontal).write_image::<RGB8>(width, height, pixels)
    };
    TiffEncoder::new(sink).and_then(compressed).map_err(|error| match error {
        TiffError::IoError(error) => error,
        error => io::Error::other(error),
    })
}

fn image_error(error: ImageError) -> io::Error {
    match error {
        ImageError::IoError(error) => error,
        error => io::Error::other(error),
    }
}

fn qoi_error(error: qoi::Error) -> io::Error {
    match error {
        qoi::Error::IoError(error) => error,
        error => io::Error::other(error),
    }
}
