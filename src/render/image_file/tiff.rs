//! Reads TIFF with the crate `tiff`, after checking what it does not check.

use super::DEFLATE_EXPANSION;
use crate::kernels::memory::try_reserve;
use image::codecs::tiff::TiffDecoder;
use image::error::{
    DecodingError, ImageFormatHint, LimitError, LimitErrorKind, UnsupportedError, UnsupportedErrorKind,
};
use image::metadata::Orientation;
use image::{ColorType, ImageDecoder, ImageError, ImageFormat, ImageResult, Limits};
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::num::NonZero;
use tiff::ColorType as Colour;
use tiff::tags::Tag;
use tiff::{TiffError, decoder::Decoder};

/// How many bytes a byte of LZW stands for at most: a code of twelve bits can stand for as many
/// bytes as the table has entries.
const LZW_EXPANSION: u64 = 4096 * 8 / 12;
/// How many bytes a byte of run-length encoding stands for at most: two bytes can repeat a byte up
/// to 128 times.
const RUN_EXPANSION: u64 = 64;
/// How many pixels a byte of a fax may stand for. A white row takes one bit, but no real page
/// consists of white rows, so that a lower limit suffices.
const FAX_PIXELS: u64 = 4096;

/// The value of the tag Compression for LZW.
const LZW: u64 = 5;
/// The value of the tag PhotometricInterpretation for indices into a palette.
const PALETTE: u64 = 3;
/// The value of the tag SampleFormat for floats.
const FLOATS: u64 = 3;

/// Decodes the first picture. In some files the library handles tiles wrongly: those that extend
/// beyond the picture's edges, and LZW tiles that stand side by side. It is therefore told that all
/// tiles form one column, from which the picture is put together here.
pub(super) struct TiffFile<R: Read + Seek> {
    decoder: TiffDecoder<BufReader<Patched<R>>>,
    /// The width and height of the picture.
    size: (u32, u32),
    /// The width and height of a tile, if the picture has tiles.
    tile: Option<(u32, u32)>,
    /// The most pixels that the file can hold.
    most: u64,
}

impl<R: BufRead + Seek> TiffFile<R> {
    /// Reads the header of a file of `length` bytes.
    pub(super) fn new(mut reader: R, length: u64) -> ImageResult<Self> {
        let directory = Directory::read(&mut reader, length)?;
        let mut reader = Patched { reader, patches: directory.missing_end(length) };
        reader.rewind()?;
        let Header { size, tile, stored, strip_rows, strip_bytes, most, has_idle_predictor } =
            Header::read(&mut reader, length)?;
        let mut patches = Vec::new();
        if let Some(bytes) = strip_bytes {
            patches.extend(directory.patch(Tag::StripByteCounts, bytes)?);
        }
        if has_idle_predictor {
            patches.extend(directory.patch(Tag::Predictor, 1)?);
        }
        // RowsPerStrip may be the largest number of its type, which means all rows in one strip.
        // For a fax the library would decode so many rows.
        if strip_rows.is_some_and(|rows| rows > u64::from(size.1)) {
            patches.extend(directory.patch(Tag::RowsPerStrip, size.1)?);
        }
        for (tag, old, new) in [(Tag::ImageWidth, size.0, stored.0), (Tag::ImageLength, size.1, stored.1)] {
            if old != new {
                patches.extend(directory.patch(tag, new)?);
            }
        }
        reader.patches.extend(patches);
        reader.rewind()?;
        let mut decoder = TiffDecoder::new(BufReader::new(reader))?;
        let mut limits = Limits::default();
        // Enough for the pixels, with a fourth channel that will be dropped, and for the longest
        // strip.
        limits.max_alloc = Some(decoder.total_bytes().saturating_mul(2).saturating_add(length));
        decoder.set_limits(limits)?;
        Ok(TiffFile { decoder, size, tile, most })
    }

    /// The width and height of the picture or, if it has tiles, of the column that they form.
    pub(super) fn stored(&self) -> (u32, u32) {
        self.decoder.dimensions()
    }

    /// The most pixels that the file can hold.
    pub(super) fn most(&self) -> u64 {
        self.most
    }
}

impl<R: BufRead + Seek> ImageDecoder for TiffFile<R> {
    fn dimensions(&self) -> (u32, u32) {
        self.size
    }

    fn color_type(&self) -> ColorType {
        self.decoder.color_type()
    }

    fn orientation(&mut self) -> ImageResult<Orientation> {
        self.decoder.orientation()
    }

    fn read_image(self, out: &mut [u8]) -> ImageResult<()> {
        let bytes = usize::from(self.color_type().bytes_per_pixel());
        let Some((tile_width, tile_height)) = self.tile else { return self.decoder.read_image(out) };
        let (mut column, count) = (Vec::new(), self.decoder.total_bytes() as usize);
        let no_memory = |_| ImageError::Limits(LimitError::from_kind(LimitErrorKind::InsufficientMemory));
        try_reserve(&mut column, count).map_err(no_memory)?;
        column.resize(count, 0);
        self.decoder.read_image(&mut column)?;
        let (row_of_tile, row) = (bytes * tile_width as usize, bytes * self.size.0 as usize);
        let across = row.div_ceil(row_of_tile);
        for (y, row) in out.chunks_exact_mut(row).enumerate() {
            let (down, y) = (y / tile_height as usize, y % tile_height as usize);
            for (x, part) in row.chunks_mut(row_of_tile).enumerate() {
                let from = ((down * across + x) * tile_height as usize + y) * row_of_tile;
                part.copy_from_slice(&column[from..from + part.len()]);
            }
        }
        Ok(())
    }

    fn read_image_boxed(self: Box<Self>, out: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(out)
    }
}

/// The parts of a header that the library does not check.
struct Header {
    /// The width and height of the picture.
    size: (u32, u32),
    /// The width and height of a tile, if the picture has tiles.
    tile: Option<(u32, u32)>,
    /// The width and height of the picture or, if it has tiles, of the column that they form.
    stored: (u32, u32),
    /// The number of rows in a strip, as the header gives it.
    strip_rows: Option<u64>,
    /// The bytes from the only strip to the end of the file, if the header gives 0 as its length.
    strip_bytes: Option<u32>,
    /// The most pixels that the file can hold.
    most: u64,
    /// Whether the header names a predictor that its compression does not use. The library would
    /// apply it all the same.
    has_idle_predictor: bool,
}

impl Header {
    /// Checks that this kind of picture can be read, and that no tile is larger than a file of
    /// `length` bytes can contain, since the decoder allocates a tile before it reads one.
    fn read(reader: &mut (impl Read + Seek), length: u64) -> ImageResult<Header> {
        let mut tiff = Decoder::new(&mut *reader).map_err(explained)?;
        let size = tiff.dimensions().map_err(explained)?;
        let mut number = |tag| tiff.find_tag_unsigned::<u64>(tag).map_err(explained);
        let compression = number(Tag::Compression)?.unwrap_or(1);
        let samples = number(Tag::SamplesPerPixel)?.unwrap_or(1);
        let names_predictor = number(Tag::Predictor)?.unwrap_or(1) != 1;
        let has_predictor = names_predictor && matches!(compression, LZW | 8 | 32946);
        let tile = number(Tag::TileWidth)?.zip(number(Tag::TileLength)?);
        let strip_rows = number(Tag::RowsPerStrip)?;
        if number(Tag::PhotometricInterpretation)? == Some(PALETTE) {
            return Err(unsupported("its colours are in a palette".into()));
        }
        if number(Tag::FillOrder)?.is_some_and(|order| order != 1) {
            return Err(unsupported("the bits of its bytes are in reverse order (FillOrder 2)".into()));
        }
        let expansion = expansion(compression)?;
        let colour = tiff.colortype().map_err(explained)?;
        let formats = tiff.find_tag_unsigned_vec::<u64>(Tag::SampleFormat).map_err(explained)?;
        check_colour(colour, formats.is_some_and(|formats| formats.contains(&FLOATS)))?;
        if samples > u64::from(colour.num_samples()) && (has_predictor || tile.is_some()) {
            return Err(unsupported("it has samples beside its colours, in tiles or with a predictor".into()));
        }
        let most = length.saturating_mul(8 * expansion) / (samples.max(1) * u64::from(colour.bit_depth().max(1)));
        let (width, height) = (u64::from(size.0), u64::from(size.1));
        if width.max(tile.map_or(0, |(width, _)| width)).saturating_mul(tile.map_or(1, |(_, height)| height)) > most {
            return Err(damaged("a tile is larger than the file can hold"));
        }
        let has_idle_predictor = names_predictor && !has_predictor;
        let mut list = |tag| tiff.find_tag_unsigned_vec::<u64>(tag).map(Option::unwrap_or_default).map_err(explained);
        let places = [list(Tag::StripOffsets)?, list(Tag::TileOffsets)?].concat();
        let strip_bytes = match (&places[..], &list(Tag::StripByteCounts)?[..]) {
            ([place], [0]) => u32::try_from(length.saturating_sub(*place)).ok(),
            _ => None,
        };
        if compression == LZW && places.first().is_some_and(|place| is_early_lzw(reader, *place)) {
            return Err(unsupported("compression by LZW in the form of before TIFF 5".into()));
        }
        let Some((across, down)) = tile else {
            return Ok(Header { size, tile: None, stored: size, strip_rows, strip_bytes, most, has_idle_predictor });
        };
        let count = |side: u64, of_tile: u64| Some(side.div_ceil(NonZero::new(of_tile)?.get()));
        let tiles = count(width, across).zip(count(height, down)).map(|(across, down)| across * down);
        let rows = tiles.and_then(|tiles| down.checked_mul(tiles));
        let side = |side: u64| u32::try_from(side).ok();
        let tile = side(across).zip(side(down));
        let (tile, stored) =
            tile.zip(side(across).zip(rows.and_then(side))).ok_or_else(|| damaged("its tiles have no size"))?;
        Ok(Header { size, tile: Some(tile), stored, strip_rows, strip_bytes, most, has_idle_predictor })
    }
}

/// Whether the LZW codes at this position begin with their lowest bits, as programs wrote them
/// before TIFF 5. The first code is always 256, with 9 bits.
fn is_early_lzw(reader: &mut (impl Read + Seek), place: u64) -> bool {
    let mut first = [0; 2];
    let read = reader.seek(SeekFrom::Start(place)).and_then(|_| reader.read_exact(&mut first));
    read.is_ok() && first[0] == 0 && first[1] & 1 == 1
}

/// The most bytes that one byte can stand for.
fn expansion(compression: u64) -> ImageResult<u64> {
    Ok(match compression {
        1 => 1,
        LZW => LZW_EXPANSION,
        8 | 32946 => DEFLATE_EXPANSION,
        32773 => RUN_EXPANSION,
        4 => FAX_PIXELS / 8,
        2 | 3 => return Err(unsupported("compression by CCITT group 3, of faxes (group 4 is read)".into())),
        // JPEG is refused, since its decoder allocates whatever a second header asks for.
        6 | 7 => return Err(unsupported("compression by JPEG".into())),
        other => return Err(unsupported(format!("compression by method {other}"))),
    })
}

/// Refuses the colours that `TiffDecoder` refuses, with a message that names them, and 32-bit
/// integers, which it would take for floats.
fn check_colour(colour: Colour, is_float: bool) -> ImageResult<()> {
    let (name, bits) = match colour {
        Colour::RGB(32) | Colour::RGBA(32) if is_float => return Ok(()),
        Colour::RGB(8 | 16) | Colour::RGBA(8 | 16) | Colour::CMYK(8 | 16) if !is_float => return Ok(()),
        Colour::Gray(1 | 8 | 16) | Colour::GrayA(8 | 16) if !is_float => return Ok(()),
        Colour::Gray(bits) => ("grey".into(), bits),
        Colour::RGB(bits) | Colour::RGBA(bits) => ("RGB".into(), bits),
        Colour::CMYK(bits) | Colour::CMYKA(bits) => ("CMYK".into(), bits),
        Colour::YCbCr(bits) => ("YCbCr".into(), bits),
        Colour::Lab(bits) => ("L*a*b*".into(), bits),
        Colour::Multiband { bit_depth, num_samples } => (format!("grey and {} more", num_samples - 1), bit_depth),
        other => (format!("{other:?}"), other.bit_depth()),
    };
    let kind = if is_float { "floats" } else { "whole numbers" };
    Err(unsupported(format!("its samples are {name}, in {kind} of {bits} bits")))
}

/// The first directory of the file, as bytes.
struct Directory {
    is_big_endian: bool,
    /// The bytes of a count and of a value: 4, or 8 in BigTIFF.
    word: usize,
    /// The entries, each with its offset in the file.
    entries: Vec<(u64, [u8; 20])>,
    /// Where the entries end; the offset of the next directory should follow there.
    end: u64,
}

impl Directory {
    /// Reads the directory, and checks that its values together are not longer than the file, since
    /// the library allocates memory for them.
    fn read(reader: &mut (impl Read + Seek), length: u64) -> ImageResult<Directory> {
        let mut head = [0; 16];
        reader.read_exact(&mut head[..8])?;
        let mut directory = Directory { is_big_endian: head[0] == b'M', word: 4, entries: Vec::new(), end: 0 };
        let mut count_bytes = 2;
        if directory.number(&head[2..4]) == 43 {
            reader.read_exact(&mut head[8..])?;
            directory.word = 8;
            count_bytes = 8;
        }
        let word = directory.word;
        let mut at = directory.number(&head[word..2 * word]);
        reader.seek(SeekFrom::Start(at))?;
        let mut count = [0; 8];
        reader.read_exact(&mut count[..count_bytes])?;
        at = at.saturating_add(count_bytes as u64);
        let mut together = 0_u64;
        for _ in 0..directory.number(&count[..count_bytes]) {
            let mut entry = [0; 20];
            reader.read_exact(&mut entry[..4 + 2 * word])?;
            let bytes = type_bytes(directory.number(&entry[2..4]));
            let values = directory.number(&entry[4..4 + word]);
            together = together.saturating_add(values.saturating_mul(bytes));
            if together > length {
                return Err(damaged("values are longer than the file"));
            }
            directory.entries.push((at, entry));
            at = at.saturating_add(4 + 2 * word as u64);
        }
        directory.end = at;
        Ok(directory)
    }

    /// The bytes to append to a file that ends right after its entries: the offset of the next
    /// directory, which is 0.
    fn missing_end(&self, length: u64) -> Vec<(u64, u8)> {
        (length.max(self.end)..self.end + self.word as u64).map(|at| (at, 0)).collect()
    }

    /// A number in the file's byte order.
    fn number(&self, bytes: &[u8]) -> u64 {
        let append = |number, byte: &u8| number << 8 | u64::from(*byte);
        if self.is_big_endian { bytes.iter().fold(0, append) } else { bytes.iter().rev().fold(0, append) }
    }

    /// The changed bytes, with their offsets in the file, that replace the value of a tag by a
    /// single 32-bit one.
    fn patch(&self, tag: Tag, value: u32) -> ImageResult<Vec<(u64, u8)>> {
        let is_tag = |(_, entry): &&(u64, [u8; 20])| self.number(&entry[..2]) == u64::from(tag.to_u16());
        let (at, _) = self.entries.iter().find(is_tag).ok_or_else(|| damaged("its size is missing"))?;
        let number = |value: u32, bytes: usize| {
            let mut number = value.to_le_bytes();
            if self.is_big_endian {
                number[..bytes].reverse();
            }
            number.into_iter().take(bytes)
        };
        // The value's type is changed too, since it may be a 16-bit one.
        const LONG: u32 = 4;
        let of_type = (at + 2..).zip(number(LONG, 2));
        let of_value = (at + 4 + self.word as u64..).zip(number(value, 4));
        Ok(of_type.chain(of_value).collect())
    }
}

/// The number of bytes of a value of this type.
fn type_bytes(kind: u64) -> u64 {
    match kind {
        3 | 8 => 2,
        4 | 9 | 11 | 13 => 4,
        5 | 10 | 12 | 16..=18 => 8,
        _ => 1,
    }
}

/// A reader of a file in which some bytes are replaced, and to whose end some may be added.
struct Patched<R> {
    reader: R,
    /// Offsets in the file, and the bytes that are read there instead of the file's.
    patches: Vec<(u64, u8)>,
}

impl<R: Read + Seek> Read for Patched<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let start = self.reader.stream_position()?;
        let mut count = self.reader.read(out)?;
        if count == 0 && !out.is_empty() && self.patches.iter().any(|(at, _)| *at == start) {
            count = 1;
            self.reader.seek(SeekFrom::Start(start + 1))?;
        }
        for (at, byte) in &self.patches {
            let index = at.checked_sub(start).and_then(|index| usize::try_from(index).ok());
            if let Some(patched) = index.and_then(|index| out[..count].get_mut(index)) {
                *patched = *byte;
            }
        }
        Ok(count)
    }
}

impl<R: Seek> Seek for Patched<R> {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.reader.seek(position)
    }
}

fn explained(error: TiffError) -> ImageError {
    match error {
        TiffError::IoError(error) => ImageError::IoError(error),
        TiffError::UnsupportedError(what) => unsupported(what.to_string()),
        error => damaged(&error.to_string()),
    }
}

fn damaged(what: &str) -> ImageError {
    ImageError::Decoding(DecodingError::new(ImageFormatHint::Exact(ImageFormat::Tiff), what))
}

fn unsupported(what: String) -> ImageError {
    let kind = UnsupportedErrorKind::GenericFeature(what);
    ImageError::Unsupported(UnsupportedError::from_format_and_kind(ImageFormatHint::Exact(ImageFormat::Tiff), kind))
}
