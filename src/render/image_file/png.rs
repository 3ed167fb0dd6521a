//! PNG: writes independently compressed strips as one stream, and reads pixels.

use super::Extent;
use super::parts::{Encode, Join};
use crate::render::output::Sink;
use flate2::{Compress, Compression, FlushCompress};
use image::error::{
    DecodingError, LimitError, LimitErrorKind, ParameterError, ParameterErrorKind, UnsupportedError,
    UnsupportedErrorKind,
};
use image::{ColorType, ImageDecoder, ImageError, ImageFormat, ImageResult};
use simd_adler32::Adler32;
use std::borrow::Cow;
use std::cell::Cell;
use std::io::{self, BufRead, Read, Seek, SeekFrom};
use std::rc::Rc;

/// The least number of bytes in every strip but the last: the first row of a strip and its code
/// tables cost about a hundred bytes.
const STRIP_BYTES: usize = 256 << 10;
/// The longest chunk that is written; the format allows 2^31 - 1 bytes.
const CHUNK: usize = 1 << 30;
/// The bytes that begin the zlib stream, and the empty last block that ends it, before the
/// checksum.
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
        // A power of two, so that strips consist of whole rows of tiles: a row of tiles that is
        // divided would be traced twice.
        Some(STRIP_BYTES.div_ceil(self.row).next_power_of_two() as u32)
    }

    /// Compresses a strip to deflate blocks. Before these it puts the checksum and the length of
    /// the uncompressed strip.
    fn rgb8<'a>(&self, rows: &'a [[u8; 3]]) -> io::Result<Cow<'a, [u8]>> {
        let rows = rows.as_flattened();
        let mut filtered = Vec::with_capacity(rows.len() + rows.len() / self.row);
        for (at, row) in rows.chunks_exact(self.row).enumerate() {
            // The filter subtracts the row above; in the first row of a strip it subtracts the
            // pixel to the left.
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
            // The flush ends the blocks at a byte boundary. It is complete if it leaves room in the
            // buffer.
            deflate.compress_vec(&filtered[deflate.total_in() as usize..], &mut blocks, FlushCompress::Sync)?;
            if blocks.len() < blocks.capacity() {
                return Ok(blocks.into());
            }
        }
    }
}

/// Writes the file, with the zlib stream in chunks.
pub(super) struct PngJoin {
    file: png::Writer<Sink>,
    /// The Adler-32 checksum of the rows so far: the first number is 1 plus the sum of all bytes,
    /// the second the sum of all values that the first has had. Both are modulo 65521.
    sum: [u64; 2],
}

impl PngJoin {
    pub(super) fn new(sink: Sink, extent: &Extent) -> io::Result<Self> {
        let mut encoder = png::Encoder::new(sink, extent.width, extent.height());
        // No gamma and no sRGB is declared: the values are written as they are, which usually means
        // linear.
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
        // The part's checksum was computed from the initial value 1. This appends it to the sum so
        // far (Adler-32's combination).
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

/// The IEND chunk, the last of every file.
const END: [u8; 12] = *b"\0\0\0\0IEND\xaeB`\x82";

/// A file that seems to have its last chunk even if it ends before it, since some programs do not
/// write that chunk. If the file ends within another chunk, these bytes cannot be taken for the
/// rest of that.
struct WithMissingEnd<R> {
    reader: R,
    /// How many bytes of the last chunk have been read instead of the file's.
    read: usize,
    /// Whether the file ended too early for a whole picture.
    is_short: Rc<Cell<bool>>,
}

impl<R: BufRead> BufRead for WithMissingEnd<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.reader.fill_buf()?.is_empty() {
            self.is_short.set(true);
            return Ok(&END[self.read..]);
        }
        self.reader.fill_buf()
    }

    fn consume(&mut self, count: usize) {
        if self.is_short.get() {
            self.read += count;
        } else {
            self.reader.consume(count);
        }
    }
}

impl<R: BufRead> Read for WithMissingEnd<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(out)?;
        self.consume(count);
        Ok(count)
    }
}

impl<R: Seek> Seek for WithMissingEnd<R> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.read = 0;
        self.is_short.set(false);
        self.reader.seek(to)
    }
}

/// Decodes only the pixels. Texts and colour profiles, which may unpack to a thousand times the
/// file's size, are skipped.
pub(super) struct PngDecoder<R: BufRead + Seek> {
    reader: png::Reader<WithMissingEnd<R>>,
    /// Whether the file ended too early for a whole picture.
    is_short: Rc<Cell<bool>>,
}

impl<R: BufRead + Seek> PngDecoder<R> {
    /// Reads the chunks before the pixels, and allocates at most `bytes` for rows.
    pub(super) fn new(mut reader: R, bytes: usize) -> ImageResult<Self> {
        // The name of the first chunk, which follows the signature and the chunk's length.
        if reader.fill_buf()?.get(12..16) == Some(b"CgBI") {
            let what = "it is a PNG that was changed for iPhones (CgBI)".to_owned();
            let kind = UnsupportedErrorKind::GenericFeature(what);
            return Err(ImageError::Unsupported(UnsupportedError::from_format_and_kind(ImageFormat::Png.into(), kind)));
        }
        let is_short = Rc::new(Cell::new(false));
        let reader = WithMissingEnd { reader, read: 0, is_short: Rc::clone(&is_short) };
        let mut decoder = png::Decoder::new_with_limits(reader, png::Limits { bytes });
        decoder.ignore_checksums(false);
        decoder.set_ignore_text_chunk(true);
        decoder.set_ignore_iccp_chunk(true);
        decoder.set_transformations(png::Transformations::EXPAND);
        let reader = decoder.read_info().map_err(|error| png_error(error, is_short.get()))?;
        Ok(PngDecoder { reader, is_short })
    }
}

impl<R: BufRead + Seek> ImageDecoder for PngDecoder<R> {
    fn dimensions(&self) -> (u32, u32) {
        self.reader.info().size()
    }

    fn color_type(&self) -> ColorType {
        use png::ColorType as Of;
        match self.reader.output_color_type() {
            // Such files are refused, so that their channels do not matter.
            (_, png::BitDepth::Sixteen) => ColorType::Rgb16,
            (Of::Grayscale, _) => ColorType::L8,
            (Of::GrayscaleAlpha, _) => ColorType::La8,
            (Of::Rgb | Of::Indexed, _) => ColorType::Rgb8,
            (Of::Rgba, _) => ColorType::Rgba8,
        }
    }

    fn read_image(mut self, out: &mut [u8]) -> ImageResult<()> {
        self.reader.next_frame(out).map(drop).map_err(|error| png_error(error, self.is_short.get()))
    }

    fn read_image_boxed(self: Box<Self>, out: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(out)
    }
}

/// The error for a file, which may have ended too early.
fn png_error(error: png::DecodingError, is_short: bool) -> ImageError {
    match error {
        // The file is too short, whatever the decoder says about the bytes that were added.
        _ if is_short => ImageError::IoError(io::ErrorKind::UnexpectedEof.into()),
        png::DecodingError::IoError(error) => ImageError::IoError(error),
        png::DecodingError::Format(_) => {
            ImageError::Decoding(DecodingError::new(ImageFormat::Png.into(), in_words(&error.to_string())))
        }
        png::DecodingError::Parameter(_) => {
            ImageError::Parameter(ParameterError::from_kind(ParameterErrorKind::Generic(error.to_string())))
        }
        png::DecodingError::LimitsExceeded => {
            ImageError::Limits(LimitError::from_kind(LimitErrorKind::InsufficientMemory))
        }
    }
}

/// The library's message, in which only the name is left of what it says about a chunk.
fn in_words(message: &str) -> String {
    if message.starts_with("Corrupt deflate stream.") {
        return "its compressed pixels are corrupt, or do not have the checksum that follows them".to_owned();
    }
    let named = message.split_once("ChunkType { type: ").and_then(|(before, chunk)| {
        let (name, more) = chunk.split_once(',')?;
        let (_, after) = more.split_once('}')?;
        Some(format!("{before}{name}{after}"))
    });
    named.unwrap_or_else(|| message.to_owned())
}
