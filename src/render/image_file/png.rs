//! PNG: strips of rows compressed independently, one after another in one stream; and the pixels read back.

use super::Extent;
use super::parts::{Encode, Join};
use crate::render::output::Sink;
use flate2::{Compress, Compression, FlushCompress};
use image::error::{DecodingError, LimitError, LimitErrorKind, ParameterError, ParameterErrorKind};
use image::{ColorType, ImageDecoder, ImageError, ImageFormat, ImageResult};
use simd_adler32::Adler32;
use std::borrow::Cow;
use std::io::{self, BufRead, Seek};

/// The least bytes of a strip but the last. Its first row and its codes cost some hundred bytes.
const STRIP_BYTES: usize = 256 << 10;
/// More than a chunk holds, and less than it may hold.
const CHUNK: usize = 1 << 30;
/// Begins the stream, and ends it except for its checksum: a last block of no bytes.
const HEADER: [u8; 2] = [0x78, 0x01];
const LAST_BLOCK: [u8; 5] = [1, 0, 0, 0xff, 0xff];

pub(super) struct PngParts {
    /// Bytes of a row.
    row: usize,
}

impl PngParts {
    pub(super) fn new(extent: &Extent) -> Self {
        PngParts { row: 3 * extent.width as usize }
    }
}

impl Encode for PngParts {
    fn part_rows(&self) -> Option<u32> {
        // A power of two fits rows of tiles, which would be traced twice if cut.
        Some(STRIP_BYTES.div_ceil(self.row).next_power_of_two() as u32)
    }

    /// Blocks, preceded by the checksum of their content and its length.
    fn rgb8<'a>(&self, rows: &'a [[u8; 3]]) -> io::Result<Cow<'a, [u8]>> {
        let rows = rows.as_flattened();
        let mut filtered = Vec::with_capacity(rows.len() + rows.len() / self.row);
        for (at, row) in rows.chunks_exact(self.row).enumerate() {
            // Minus the row above or, in the first row, minus the pixel to the left.
            let (filter, before) = match at.checked_sub(1) {
                Some(above) => (2, &rows[above * self.row..]),
                None => (1, &[&[0; 3], row].concat()[..]),
            };
            filtered.push(filter);
            filtered.extend(row.iter().zip(before).map(|(byte, before)| byte.wrapping_sub(*before)));
        }
        let mut sum = Adler32::new();
        sum.write(&filtered);
        let (sum, length) = (sum.finish().to_le_bytes(), (filtered.len() as u64).to_le_bytes());
        let (mut blocks, mut deflate) = ([&sum[..], &length].concat(), Compress::new(Compression::fast(), false));
        loop {
            blocks.reserve(filtered.len() / 2 + 64);
            // The flush ends them on a byte boundary. It is complete where it leaves room.
            deflate.compress_vec(&filtered[deflate.total_in() as usize..], &mut blocks, FlushCompress::Sync)?;
            if blocks.len() < blocks.capacity() {
                return Ok(blocks.into());
            }
        }
    }
}

/// Writes the file: its stream in chunks.
pub(super) struct PngJoin {
    file: png::Writer<Sink>,
    /// Adler-32 of the rows so far; its halves are sums of all bytes plus 1, and of all values of the first half.
    sum: [u64; 2],
}

impl PngJoin {
    pub(super) fn new(sink: Sink, extent: &Extent) -> io::Result<Self> {
        let mut encoder = png::Encoder::new(sink, extent.width, extent.height());
        // Neither gamma nor sRGB is declared: the values are linear and written as is.
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        let mut file = encoder.write_header()?;
        file.write_chunk(png::chunk::IDAT, &HEADER)?;
        Ok(PngJoin { file, sum: [1, 0] })
    }
}

impl Join for PngJoin {
    fn append(&mut self, part: Cow<'_, [u8]>) -> io::Result<()> {
        const MODULUS: u64 = 65521;
        let (Some((sum, rest)), [a, b]) = (part.split_first_chunk(), self.sum) else { return Ok(()) };
        let Some((length, blocks)) = rest.split_first_chunk() else { return Ok(()) };
        let (sum, length) = (u64::from(u32::from_le_bytes(*sum)), u64::from_le_bytes(*length));
        // The part's own sum begins with 1 in place of the sum so far.
        let before = a + MODULUS - 1;
        self.sum = [(before + sum % (1 << 16)) % MODULUS, (b + (sum >> 16) + before * (length % MODULUS)) % MODULUS];
        blocks.chunks(CHUNK).try_for_each(|chunk| self.file.write_chunk(png::chunk::IDAT, chunk).map_err(Into::into))
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        let [a, b] = self.sum.map(|half| (half as u16).to_be_bytes());
        self.file.write_chunk(png::chunk::IDAT, &[&LAST_BLOCK[..], &b, &a].concat())?;
        Ok(self.file.finish()?)
    }
}

/// Decodes only the pixels: texts and colour profiles, which may unpack to a thousand times the file, are skipped.
pub(super) struct PngDecoder<R: BufRead + Seek> {
    reader: png::Reader<R>,
}

impl<R: BufRead + Seek> PngDecoder<R> {
    /// Reads the header before the pixels, and allocates at most `bytes` for rows.
    pub(super) fn new(reader: R, bytes: usize) -> ImageResult<Self> {
        let mut decoder = png::Decoder::new_with_limits(reader, png::Limits { bytes });
        decoder.set_ignore_text_chunk(true);
        decoder.set_ignore_iccp_chunk(true);
        decoder.set_transformations(png::Transformations::EXPAND);
        Ok(PngDecoder { reader: decoder.read_info().map_err(png_error)? })
    }
}

impl<R: BufRead + Seek> ImageDecoder for PngDecoder<R> {
    fn dimensions(&self) -> (u32, u32) {
        self.reader.info().size()
    }

    fn color_type(&self) -> ColorType {
        use png::ColorType as Of;
        match self.reader.output_color_type() {
            // Not used.
            (_, png::BitDepth::Sixteen) => ColorType::Rgb16,
            (Of::Grayscale, _) => ColorType::L8,
            (Of::GrayscaleAlpha, _) => ColorType::La8,
            (Of::Rgb | Of::Indexed, _) => ColorType::Rgb8,
            (Of::Rgba, _) => ColorType::Rgba8,
        }
    }

    fn read_image(mut self, out: &mut [u8]) -> ImageResult<()> {
        self.reader.next_frame(out).map(drop).map_err(png_error)
    }

    fn read_image_boxed(self: Box<Self>, out: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(out)
    }
}

fn png_error(error: png::DecodingError) -> ImageError {
    match error {
        png::DecodingError::IoError(error) => ImageError::IoError(error),
        png::DecodingError::Format(_) => ImageError::Decoding(DecodingError::new(ImageFormat::Png.into(), error)),
        png::DecodingError::Parameter(_) => {
            ImageError::Parameter(ParameterError::from_kind(ParameterErrorKind::Generic(error.to_string())))
        }
        png::DecodingError::LimitsExceeded => {
            ImageError::Limits(LimitError::from_kind(LimitErrorKind::InsufficientMemory))
        }
    }
}
