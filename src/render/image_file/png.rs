//! PNG: rows compressed part by part, and the parts joined bit by bit to what a stream of all rows is.
//!
//! The encoder chooses each row's filter by that row and the one above it, and writes each row's symbols in one fixed code
//! (fdeflate's), whose bits do not depend on what stands before them. So the stream of a part holds the bits of its rows;
//! only the first lacks the row above it, and is encoded where the parts are joined.

use super::encode::{Encode, Join, Split};
use crate::render::output::Sink;
use image::error::{DecodingError, LimitError, LimitErrorKind, ParameterError, ParameterErrorKind};
use image::{ColorType, ImageDecoder, ImageError, ImageFormat, ImageResult};
use std::borrow::Cow;
use std::io::{self, BufRead, Seek, Write};
use std::ops::Range;

/// Before the first row's bits: zlib's header and that of the one block, which lists the code.
const HEADER_BITS: usize = 53 * 8 + 5;
/// Ends the block; the last of its bits is a one.
const END_BITS: usize = 12;
/// Bytes of a chunk, and of the buffer in which the encoder fills it.
const CHUNK: usize = 1 << 16;
/// Before the file's first chunk of pixels, and around the content of every chunk: length and name; and its checksum.
const BEFORE_CHUNKS: usize = 8 + 25;
const CHUNK_HEAD: usize = 8;
const CHUNK_TAIL: usize = 4;

fn begin<W: Write>(out: W, width: u32, height: u32) -> io::Result<png::Writer<W>> {
    let mut encoder = png::Encoder::new(out, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    // A lit sphere of 1632x1224 takes 6 ms and 376 kB so; no filter with deflate's level 4 takes 17 ms and 142 kB,
    // the default 68 ms and 187 kB. Neither gamma nor sRGB is declared: the values are linear and written as is.
    encoder.set_compression(png::Compression::Fast);
    Ok(encoder.write_header()?)
}

/// A zlib stream of rows, of which the first has none above it.
struct Stream {
    bytes: Vec<u8>,
    /// Where the bits of the rows are.
    rows: Range<usize>,
    sum: Sum,
}

impl Stream {
    fn new(rows: &[u8], row: usize) -> io::Result<Self> {
        let mut file = Vec::new();
        let mut writer = begin(&mut file, (row / 3) as u32, (rows.len() / row) as u32)?;
        let mut stream = writer.stream_writer_with_size(CHUNK)?;
        stream.write_all(rows)?;
        stream.finish()?;
        writer.finish()?;
        let mut bytes = Vec::with_capacity(file.len());
        let mut rest = &file[BEFORE_CHUNKS..];
        while let Some((length, after)) = rest.split_first_chunk() {
            let length = u32::from_be_bytes(*length) as usize;
            if after.starts_with(b"IDAT") {
                bytes.extend_from_slice(&rest[CHUNK_HEAD..][..length]);
            }
            rest = &rest[CHUNK_HEAD + length + CHUNK_TAIL..];
        }
        let checksum = bytes.split_off(bytes.len() - 4);
        let last = bytes.last().map_or(0, |byte| byte.leading_zeros() as usize);
        let rows_bytes = rows.len() + rows.len() / row;
        let end = 8 * bytes.len() - last - END_BITS;
        Ok(Stream { rows: HEADER_BITS..end, sum: Sum::of(&checksum, rows_bytes), bytes })
    }
}

/// Adler-32 of so many bytes.
#[derive(Clone, Copy)]
struct Sum {
    /// 1 and all bytes.
    a: u32,
    /// Every value that `a` had after a byte.
    b: u32,
    length: usize,
}

impl Sum {
    const MODULUS: u32 = 65521;
    const NOTHING: Sum = Sum { a: 1, b: 0, length: 0 };

    fn of(checksum: &[u8], length: usize) -> Self {
        let [high, low] = [0, 2].map(|at| checksum[at..].first_chunk().map_or(0, |pair| u16::from_be_bytes(*pair)));
        Sum { a: low.into(), b: high.into(), length }
    }

    fn bytes(self) -> [u8; 4] {
        (self.b << 16 | self.a).to_be_bytes()
    }

    /// What the bytes of `later` add to `b` for the `a` that they begin with in place of 1.
    fn carried(self, later: usize) -> u32 {
        let a = u64::from(self.a + Self::MODULUS - 1) % u64::from(Self::MODULUS);
        (a * (later as u64 % u64::from(Self::MODULUS)) % u64::from(Self::MODULUS)) as u32
    }

    /// The sum of these bytes and then those of `later`.
    fn then(self, later: Sum) -> Sum {
        Sum {
            a: (self.a + later.a + Self::MODULUS - 1) % Self::MODULUS,
            b: (self.b + later.b + self.carried(later.length)) % Self::MODULUS,
            length: self.length + later.length,
        }
    }

    /// The sum of those of these bytes that come after `first`.
    fn after(self, first: Sum) -> Sum {
        let length = self.length - first.length;
        Sum {
            a: (self.a + Self::MODULUS - first.a + 1) % Self::MODULUS,
            b: (self.b + 2 * Self::MODULUS - first.b - first.carried(length)) % Self::MODULUS,
            length,
        }
    }
}

/// The encoder of parts: of the first row and the last the pixels, of all but the first the bits.
pub(super) struct PngParts {
    /// Bytes of a row.
    row: usize,
}

impl PngParts {
    pub(super) fn new(width: usize) -> Self {
        PngParts { row: 3 * width }
    }
}

impl Encode for PngParts {
    fn split(&self) -> Split {
        // A part has four rows encoded once more: few of many, unless these are too long to be many.
        Split::Any { least: ((4 << 20) / self.row).clamp(1, 128) as u32 }
    }

    fn rgb8<'a>(&self, rows: &'a [[u8; 3]]) -> io::Result<Cow<'a, [u8]>> {
        let (rows, row) = (rows.as_flattened(), self.row);
        let (all, first) = (Stream::new(rows, row)?, Stream::new(&rows[..row], row)?);
        let sum = all.sum.after(first.sum);
        // The bits of the first are those that all begin with.
        let bits = first.rows.end..all.rows.end;
        let mut part = Vec::with_capacity(2 * row + PART_HEAD + all.bytes.len());
        part.extend_from_slice(&rows[..row]);
        part.extend_from_slice(&rows[rows.len() - row..]);
        for number in [bits.start % 8, bits.len(), sum.length] {
            part.extend_from_slice(&(number as u64).to_le_bytes());
        }
        part.extend_from_slice(&sum.bytes());
        part.extend_from_slice(&all.bytes[bits.start / 8..bits.end.div_ceil(8)]);
        Ok(part.into())
    }
}

/// Behind the pixels of a part: where its bits begin, their number, and the sum of their rows.
const PART_HEAD: usize = 3 * size_of::<u64>() + 4;

/// The file: its stream in chunks.
pub(super) struct PngJoin {
    file: png::Writer<Sink>,
    /// Bytes of a row.
    row: usize,
    /// The last row so far.
    above: Vec<u8>,
    stream: Bits,
    sum: Sum,
    /// The bits that end the stream.
    end: Vec<u8>,
}

impl PngJoin {
    pub(super) fn new(sink: Sink, width: u32, height: u32) -> io::Result<Self> {
        let row = 3 * width as usize;
        let (above, stream, end) = (Vec::new(), Bits::default(), Vec::new());
        Ok(PngJoin { file: begin(sink, width, height)?, row, above, stream, sum: Sum::NOTHING, end })
    }

    /// Writes the bits of a row that has another above it, or is the first.
    fn append_row(&mut self, row: &[u8]) -> io::Result<()> {
        let rows = [&self.above, row].concat();
        let stream = Stream::new(&rows, self.row)?;
        if self.above.is_empty() {
            self.stream.append(&stream.bytes, 0..stream.rows.end);
            let mut end = Bits::default();
            end.append(&stream.bytes, stream.rows.end..stream.rows.end + END_BITS);
            self.end = end.finish();
            self.sum = stream.sum;
        } else {
            let above = Stream::new(&self.above, self.row)?;
            self.stream.append(&stream.bytes, above.rows.end..stream.rows.end);
            self.sum = self.sum.then(stream.sum.after(above.sum));
        }
        Ok(())
    }

    fn write_full_chunks(&mut self) -> io::Result<()> {
        let full = self.stream.bytes.len() / CHUNK * CHUNK;
        for chunk in self.stream.bytes[..full].chunks_exact(CHUNK) {
            self.file.write_chunk(png::chunk::IDAT, chunk)?;
        }
        self.stream.bytes.drain(..full);
        Ok(())
    }
}

impl Join for PngJoin {
    fn append(&mut self, part: Cow<'_, [u8]>) -> io::Result<()> {
        let (first, rest) = part.split_at(self.row);
        let (last, rest) = rest.split_at(self.row);
        let (head, bits) = rest.split_at(PART_HEAD);
        let [start, count, length] =
            [0, 8, 16].map(|at| head[at..].first_chunk().map_or(0, |number| u64::from_le_bytes(*number) as usize));
        self.append_row(first)?;
        self.stream.append(bits, start..start + count);
        self.sum = self.sum.then(Sum::of(&head[24..], length));
        self.above.clear();
        self.above.extend_from_slice(last);
        self.write_full_chunks()
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        let end = std::mem::take(&mut self.end);
        self.stream.append(&end, 0..END_BITS);
        let mut rest = std::mem::take(&mut self.stream).finish();
        rest.extend_from_slice(&self.sum.bytes());
        for chunk in rest.chunks(CHUNK) {
            self.file.write_chunk(png::chunk::IDAT, chunk)?;
        }
        Ok(self.file.finish()?)
    }
}

/// Bits one after the other, the lowest of a byte first.
#[derive(Default)]
struct Bits {
    bytes: Vec<u8>,
    /// Those that do not fill a byte, below 8, and their number.
    partial: u64,
    count: usize,
}

impl Bits {
    /// As many as are appended at a time: with those of a partial byte, no more than a word.
    const STEP: usize = 56;

    /// Appends those of `bytes` from one place up to another.
    fn append(&mut self, bytes: &[u8], range: Range<usize>) {
        for start in range.clone().step_by(Self::STEP) {
            let count = Self::STEP.min(range.end - start);
            let from = &bytes[start / 8..];
            let word = match from.first_chunk() {
                Some(word) => u64::from_le_bytes(*word),
                None => (0..).zip(from).fold(0, |word, (at, byte)| word | u64::from(*byte) << (8 * at)),
            };
            // Of a word that begins within a byte, 57 bits at least are there.
            let bits = word >> (start % 8) & ((1 << count) - 1);
            self.partial |= bits << self.count;
            self.count += count;
            self.bytes.extend_from_slice(&self.partial.to_le_bytes()[..self.count / 8]);
            self.partial >>= self.count / 8 * 8;
            self.count %= 8;
        }
    }

    /// The bytes, of which the last may be filled up with zeros.
    fn finish(mut self) -> Vec<u8> {
        if self.count > 0 {
            self.bytes.push(self.partial as u8);
        }
        self.bytes
    }
}

/// The pixels alone: texts and colour profiles, which may unpack to a thousand times the file, are passed over.
pub(super) struct PngDecoder<R: BufRead + Seek> {
    reader: png::Reader<R>,
}

impl<R: BufRead + Seek> PngDecoder<R> {
    /// Reads what stands before the pixels, and takes at most so many bytes for rows.
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
            // Read by nobody.
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
