//! One encoder per format: rows of a picture in, bytes out, part by part; and a writer that joins the parts to a file.

use super::parts::{Encode, Join};
use super::png::{PngJoin, PngParts};
use super::threaded::{ExrParts, Threaded, TiffParts};
use super::{Extent, Format};
use crate::kernels::memory::try_reserve;
use crate::render::output::Sink;
use image::Rgb;
use image::codecs::hdr::HdrEncoder;
use std::borrow::Cow;
use std::io::{self, Seek, SeekFrom, Write};

/// The encoder of the parts of a picture in `format`.
pub(super) fn encoder(format: Format, extent: &Extent) -> Box<dyn Encode> {
    let width = extent.width as usize;
    match format {
        Format::Png => Box::new(PngParts::new(extent)),
        Format::Ppm | Format::Qoi => Box::new(Bytes),
        Format::PpmText => Box::new(PpmText { width }),
        Format::Pfm => Box::new(Pfm { width }),
        Format::Exr => Box::new(ExrParts::new(extent)),
        Format::Hdr => Box::new(Hdr { width }),
        Format::Tiff => Box::new(TiffParts::new(extent)),
    }
}

/// Begins a file of `format`, and writes its header.
pub(super) fn joiner(format: Format, mut sink: Sink, extent: &Extent) -> io::Result<Box<dyn Join>> {
    let (width, height) = (extent.width, extent.height());
    Ok(match format {
        Format::Png => Box::new(PngJoin::new(sink, extent)?),
        Format::Ppm => {
            write!(sink, "P6\n{width} {height}\n255\n")?;
            Box::new(InOrder { sink })
        }
        Format::PpmText => {
            write!(sink, "P3\n{width} {height}\n255\n")?;
            Box::new(InOrder { sink })
        }
        Format::Pfm => Box::new(BottomUp::new(sink, width, height)?),
        Format::Exr => Box::new(Threaded::exr(sink, extent)),
        Format::Hdr => {
            write!(sink, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n")?;
            Box::new(InOrder { sink })
        }
        Format::Tiff => Box::new(Threaded::tiff(sink, extent)),
        Format::Qoi => Box::new(Qoi { sink, size: (width, height), pixels: Vec::new() }),
    })
}

/// The most bytes of an image that is held in memory until it is complete.
pub(super) const MAX_WHOLE: u64 = 1 << 30;

/// Whether an image of `format` is held in memory.
pub(super) fn is_whole(format: Format) -> bool {
    format == Format::Qoi
}

/// How many bytes of it are held.
pub(super) fn whole_bytes(width: u32, height: u32) -> u64 {
    3 * u64::from(width) * u64::from(height)
}

/// Whether `format` is written out of order.
pub(super) fn needs_seeking(format: Format) -> bool {
    match format {
        Format::Png | Format::Ppm | Format::PpmText | Format::Hdr | Format::Qoi => false,
        Format::Pfm | Format::Exr | Format::Tiff => true,
    }
}

/// Writes the parts one after the other.
struct InOrder {
    sink: Sink,
}

impl Join for InOrder {
    fn append(&mut self, part: Cow<'_, [u8]>) -> io::Result<()> {
        self.sink.write_all(&part)
    }
}

/// Pixels as they are.
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

/// PFM keeps its rows bottom to top.
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

/// Each part is written before the one above it in the picture.
struct BottomUp {
    sink: Sink,
    /// The place in the file where the next part from the top ends.
    end: u64,
}

impl BottomUp {
    fn new(mut sink: Sink, width: u32, height: u32) -> io::Result<Self> {
        // The sign of the scale says that the floats are little endian.
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

/// Radiance's format, which the image crate encodes whole or, as here, a picture of one row at a time.
struct Hdr {
    width: usize,
}

impl Hdr {
    /// Ends the header before each row, that of a picture of one row.
    const HEADER_END: &[u8] = b"\n\n-Y 1 +X ";
    /// Below this a pixel is black: the exponent has 8 bits.
    const SMALLEST: f32 = f32::MIN_POSITIVE;
    /// The largest number of the format: 255/256 of 2^127.
    const LARGEST: f32 = 255.0 * (1_u128 << 119) as f32;

    /// The numbers of 8 bits times a power of two that are nearest to a pixel's. The encoder truncates the rest, and
    /// its logarithm rounds a number next to a power of two to that.
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
        // The greatest may have become a power of two.
        in_units_of(most(in_units_of(most(channels))))
    }
}

impl Encode for Hdr {
    fn f32x3<'a>(&self, rows: &'a [[f32; 3]]) -> io::Result<Cow<'a, [u8]>> {
        let (mut row, mut encoded, mut part) = (Vec::new(), Vec::new(), Vec::new());
        for pixels in rows.chunks_exact(self.width) {
            row.clear();
            row.extend(pixels.iter().map(|pixel| Rgb(Self::rounded(*pixel))));
            encoded.clear();
            HdrEncoder::new(&mut encoded).encode(&row, self.width, 1).map_err(io::Error::other)?;
            let header = encoded.windows(Self::HEADER_END.len()).position(|window| window == Self::HEADER_END);
            let line = header.map(|at| &encoded[at + Self::HEADER_END.len()..]).unwrap_or_default();
            let digits = line.iter().take_while(|byte| byte.is_ascii_digit()).count();
            let scan_line = line.get(digits + 1..).ok_or_else(|| io::Error::other("the encoder wrote no row"))?;
            part.extend_from_slice(scan_line);
        }
        Ok(part.into())
    }
}

/// QOI: its encoder takes all pixels at once.
struct Qoi {
    sink: Sink,
    size: (u32, u32),
    pixels: Vec<u8>,
}

impl Join for Qoi {
    fn append(&mut self, part: Cow<'_, [u8]>) -> io::Result<()> {
        if self.pixels.is_empty() {
            try_reserve(&mut self.pixels, whole_bytes(self.size.0, self.size.1) as usize)?;
        }
        self.pixels.extend_from_slice(&part);
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        let (width, height) = self.size;
        let encoder = qoi::Encoder::new(&self.pixels, width, height).map_err(io::Error::other)?;
        encoder.with_colorspace(qoi::ColorSpace::Linear).encode_to_stream(&mut self.sink).map_err(io::Error::other)?;
        Ok(())
    }
}
