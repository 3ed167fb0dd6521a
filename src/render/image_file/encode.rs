//! One encoder per format: rows in, bytes out.

use super::Format;
use super::threaded;
use crate::render::output::Sink;
use image::Rgb;
use image::codecs::hdr::HdrEncoder;
use std::io::{self, Seek, SeekFrom, Write};

/// Turns rows from the top, whole ones and never too many, into the bytes of a file.
pub(super) trait Encode: Send {
    /// Rows of R, G, B; called for 8-bit formats.
    fn rgb8(&mut self, _rows: &[[u8; 3]]) -> io::Result<()> {
        unreachable!("not an 8-bit format")
    }

    /// Rows of R, G, B; called for float formats.
    fn f32x3(&mut self, _rows: &[[f32; 3]]) -> io::Result<()> {
        unreachable!("not a float format")
    }

    /// Writes what comes after the last row.
    fn finish(self: Box<Self>) -> io::Result<()> {
        Ok(())
    }
}

/// Begins a file of `format`: its header is written here.
pub(super) fn encoder(format: Format, sink: Sink, width: u32, height: u32) -> io::Result<Box<dyn Encode>> {
    Ok(match format {
        Format::Png => Box::new(Png::new(sink, width, height)?),
        Format::Ppm => Box::new(Ppm::new(sink, width, height)?),
        Format::PpmText => Box::new(PpmText::new(sink, width, height)?),
        Format::Pfm => Box::new(Pfm::new(sink, width, height)?),
        Format::Exr => Box::new(threaded::exr(sink, width, height)?),
        Format::Hdr => Box::new(Hdr::new(sink, width, height)?),
        Format::Tiff => Box::new(threaded::tiff(sink, width, height)?),
        Format::Qoi => Box::new(Qoi::new(sink, width, height)),
    })
}

/// The most bytes of an image that is held in memory until it is whole.
pub(super) const MAX_WHOLE: u64 = 1 << 30;

/// Whether the encoder of `format` holds the image in memory.
pub(super) fn is_whole(format: Format) -> bool {
    format == Format::Qoi
}

/// How much it holds.
pub(super) fn whole_bytes(width: u32, height: u32) -> u64 {
    3 * u64::from(width) * u64::from(height)
}

/// Whether the encoder of `format` writes out of order.
pub(super) fn needs_seeking(format: Format) -> bool {
    match format {
        Format::Png | Format::Ppm | Format::PpmText | Format::Hdr | Format::Qoi => false,
        Format::Pfm | Format::Exr | Format::Tiff => true,
    }
}

struct Png {
    stream: png::StreamWriter<'static, Sink>,
}

impl Png {
    fn new(sink: Sink, width: u32, height: u32) -> io::Result<Self> {
        let mut encoder = png::Encoder::new(sink, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        // A lit sphere of 1632x1224 takes 6 ms and 376 kB so; no filter with deflate's level 4 takes 17 ms and 142 kB,
        // the default 68 ms and 187 kB. Neither gamma nor sRGB is declared: the values are linear and written as is.
        encoder.set_compression(png::Compression::Fast);
        let stream = encoder.write_header()?.into_stream_writer_with_size(1 << 16)?;
        Ok(Png { stream })
    }
}

impl Encode for Png {
    fn rgb8(&mut self, rows: &[[u8; 3]]) -> io::Result<()> {
        self.stream.write_all(rows.as_flattened())
    }

    fn finish(self: Box<Self>) -> io::Result<()> {
        Ok(self.stream.finish()?)
    }
}

struct Ppm {
    sink: Sink,
}

impl Ppm {
    fn new(mut sink: Sink, width: u32, height: u32) -> io::Result<Self> {
        write!(sink, "P6\n{width} {height}\n255\n")?;
        Ok(Ppm { sink })
    }
}

impl Encode for Ppm {
    fn rgb8(&mut self, rows: &[[u8; 3]]) -> io::Result<()> {
        self.sink.write_all(rows.as_flattened())
    }
}

struct PpmText {
    sink: Sink,
    width: usize,
    row: Vec<u8>,
}

impl PpmText {
    fn new(mut sink: Sink, width: u32, height: u32) -> io::Result<Self> {
        write!(sink, "P3\n{width} {height}\n255\n")?;
        Ok(PpmText { sink, width: width as usize, row: Vec::new() })
    }

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
    fn rgb8(&mut self, rows: &[[u8; 3]]) -> io::Result<()> {
        for pixels in rows.chunks_exact(self.width) {
            self.row.clear();
            for &[r, g, b] in pixels {
                for (level, end) in [(r, b' '), (g, b' '), (b, b'\n')] {
                    Self::push_decimal(&mut self.row, level);
                    self.row.push(end);
                }
            }
            self.sink.write_all(&self.row)?;
        }
        Ok(())
    }
}

/// PFM keeps its rows bottom to top, so each band is written before the one above it in the picture.
struct Pfm {
    sink: Sink,
    width: usize,
    /// Where the next row from the top ends in the file.
    end: u64,
    row: Vec<u8>,
}

impl Pfm {
    fn new(mut sink: Sink, width: u32, height: u32) -> io::Result<Self> {
        // The sign of the scale says that the floats are little endian.
        let header = format!("PF\n{width} {height}\n-1.0\n");
        sink.write_all(header.as_bytes())?;
        let end = header.len() as u64 + Self::bytes_per_row(width as usize) * u64::from(height);
        Ok(Pfm { sink, width: width as usize, end, row: Vec::new() })
    }

    fn bytes_per_row(width: usize) -> u64 {
        width as u64 * size_of::<[f32; 3]>() as u64
    }
}

impl Encode for Pfm {
    fn f32x3(&mut self, rows: &[[f32; 3]]) -> io::Result<()> {
        let rows = rows.chunks_exact(self.width);
        self.end -= rows.len() as u64 * Self::bytes_per_row(self.width);
        self.sink.seek(SeekFrom::Start(self.end))?;
        for pixels in rows.rev() {
            self.row.clear();
            self.row.extend(pixels.as_flattened().iter().flat_map(|value| value.to_le_bytes()));
            self.sink.write_all(&self.row)?;
        }
        Ok(())
    }
}

/// Radiance's format, which the image crate encodes whole or, as here, a picture of one row at a time.
struct Hdr {
    sink: Sink,
    width: usize,
    row: Vec<Rgb<f32>>,
    encoded: Vec<u8>,
}

impl Hdr {
    /// Behind the header of each row, that of a picture of one row.
    const HEADER_END: &[u8] = b"\n\n-Y 1 +X ";
    /// Below this a pixel is black: the exponent has 8 bits.
    const SMALLEST: f32 = f32::MIN_POSITIVE;
    /// The largest power of two that the exponent holds, so that nothing is rounded up beyond it.
    const LARGEST: f32 = 8.507_059e37;

    fn new(mut sink: Sink, width: u32, height: u32) -> io::Result<Self> {
        write!(sink, "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n")?;
        Ok(Hdr { sink, width: width as usize, row: Vec::new(), encoded: Vec::new() })
    }
}

impl Encode for Hdr {
    fn f32x3(&mut self, rows: &[[f32; 3]]) -> io::Result<()> {
        for pixels in rows.chunks_exact(self.width) {
            self.row.clear();
            self.row.extend(pixels.iter().map(|pixel| {
                let channels = pixel.map(|value| value.clamp(0.0, Self::LARGEST));
                let seen = channels.iter().any(|value| *value >= Self::SMALLEST);
                Rgb(if seen { channels } else { [0.0; 3] })
            }));
            self.encoded.clear();
            HdrEncoder::new(&mut self.encoded).encode(&self.row, self.width, 1).map_err(io::Error::other)?;
            let header = self.encoded.windows(Self::HEADER_END.len()).position(|window| window == Self::HEADER_END);
            let line = header.map(|at| &self.encoded[at + Self::HEADER_END.len()..]).unwrap_or_default();
            let digits = line.iter().take_while(|byte| byte.is_ascii_digit()).count();
            let scan_line = line.get(digits + 1..).ok_or_else(|| io::Error::other("the encoder wrote no row"))?;
            self.sink.write_all(scan_line)?;
        }
        Ok(())
    }
}

/// QOI: its encoder takes all pixels at once.
struct Qoi {
    sink: Sink,
    size: (u32, u32),
    pixels: Vec<u8>,
}

impl Qoi {
    fn new(sink: Sink, width: u32, height: u32) -> Self {
        Qoi { sink, size: (width, height), pixels: Vec::new() }
    }
}

impl Encode for Qoi {
    fn rgb8(&mut self, rows: &[[u8; 3]]) -> io::Result<()> {
        if self.pixels.is_empty() {
            self.pixels.try_reserve_exact(whole_bytes(self.size.0, self.size.1) as usize)?;
        }
        self.pixels.extend_from_slice(rows.as_flattened());
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        let (width, height) = self.size;
        let encoder = qoi::Encoder::new(&self.pixels, width, height).map_err(io::Error::other)?;
        encoder.with_colorspace(qoi::ColorSpace::Linear).encode_to_stream(&mut self.sink).map_err(io::Error::other)?;
        Ok(())
    }
}
