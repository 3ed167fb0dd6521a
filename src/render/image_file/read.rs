//! Image files read into memory, whoever wrote them: nothing in a file is trusted before it is checked.

use super::exr::ExrDecoder;
use super::pfm::PfmDecoder;
use super::png::PngDecoder;
use super::{DEFLATE_EXPANSION, ImageError};
use crate::kernels::Plain;
use crate::kernels::memory::try_reserve;
use crate::measure::picture::{Picture, Pixels};
use crate::scene::brief;
use image::codecs::{hdr::HdrDecoder, pnm::PnmDecoder, qoi::QoiDecoder, tiff::TiffDecoder};
use image::error::{DecodingError, ImageFormatHint, UnsupportedError, UnsupportedErrorKind};
use image::{ColorType, ImageDecoder, ImageFormat, Limits};
use std::cell::Cell;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek, SeekFrom};
use std::panic::{self, AssertUnwindSafe};
use std::path::{Path, PathBuf};
use std::sync::Once;
use tiff::tags::Tag;

/// The most memory that the pixels of one picture may take, and the longest file that is read from a pipe.
pub(super) const MAX_BYTES: u64 = 2 << 30;

/// The same for LZW in TIFF: twelve bits can repeat as many bytes as its table has words.
const LZW_EXPANSION: u64 = 4096 * 8 / 12;
/// The same for TIFF's runs: two bytes can repeat one up to 128 times.
const RUN_EXPANSION: u64 = 64;
/// The most pixels that a byte of a fax may stand for: a white row takes one bit, but no page is that white.
const FAX_PIXELS: u64 = 4096;
/// The most pixels that a byte of HDR stands for: 127 equal pixels take two bytes for each of four channels.
const HDR_PIXELS: u64 = 16;
/// The same for QOI: 62 equal pixels take one byte.
const QOI_PIXELS: u64 = 62;

/// Reads an image file, as [`ImageFile::open`] and [`ImageFile::read`] do.
///
/// # Errors
/// As theirs.
pub fn read(path: &Path) -> Result<Picture, ImageError> {
    ImageFile::open(path)?.read()
}

/// A PNG, PPM (P3, P6), PGM (P2, P5), PFM, EXR, HDR, TIFF or QOI file after its header has been read: its size is
/// known, and a file of this length can have it. The content decides the format, not the name.
pub struct ImageFile {
    path: PathBuf,
    decoder: Box<dyn ImageDecoder>,
    width: u32,
    height: u32,
}

impl ImageFile {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// If the file cannot be read, is no such image, is damaged or cannot hold what it claims, would lose something as
    /// [`Pixels`] (more than 8 bits that are not floats), is of an unsupported kind, or exceeds 2 GiB of pixels.
    pub fn open(path: &Path) -> Result<Self, ImageError> {
        let failed = |error| ImageError::Read { path: path.into(), error };
        let file = File::open(path).map_err(failed)?;
        let metadata = file.metadata().map_err(failed)?;
        let mut reader = BufReader::with_capacity(1 << 16, file);
        if metadata.is_file() {
            return Self::of_reader(path, reader, metadata.len());
        }
        // A pipe: its length must be known and it must be rewound, so it is read whole, if it begins like an image.
        let start = reader.fill_buf().map_err(failed)?;
        Magic::of(start).ok_or_else(|| ImageError::NotAnImage { path: path.into() })?;
        let mut bytes = Vec::new();
        reader.take(MAX_BYTES).read_to_end(&mut bytes).map_err(failed)?;
        Self::of_bytes(path, bytes)
    }

    /// The same for a file's bytes; `path` is only for messages.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn of_bytes(path: &Path, bytes: Vec<u8>) -> Result<Self, ImageError> {
        let length = bytes.len() as u64;
        Self::of_reader(path, Cursor::new(bytes), length)
    }

    fn of_reader(path: &Path, reader: impl BufRead + Seek + 'static, length: u64) -> Result<Self, ImageError> {
        contained(path, || {
            let (decoder, most) = decoder(path, reader, length)?;
            let (width, height) = decoder.dimensions();
            let count = u64::from(width) * u64::from(height);
            if count == 0 || count > most {
                let what = format!("it claims {width}x{height} pixels, which it cannot hold");
                return Err(ImageError::Malformed { path: path.into(), what });
            }
            let color = decoder.color_type();
            let levels = matches!(color, ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8);
            if !levels && !is_float(color) {
                return Err(ImageError::Unsupported { path: path.into(), what: "more than 8 bits per channel" });
            }
            if count > MAX_BYTES / u64::from(color.bytes_per_pixel().max(3)) {
                return Err(ImageError::TooLarge { path: path.into(), width, height });
            }
            Ok(ImageFile { path: path.into(), decoder, width, height })
        })
    }

    /// Pixels in a row, and the number of rows.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Decodes the pixels.
    ///
    /// Grey becomes R = G = B. Alpha is dropped if it is opaque everywhere. The levels of a PPM whose largest is below
    /// 255 are scaled to 255; the scale of a PFM, beyond its sign, is ignored.
    ///
    /// # Errors
    /// If the file cannot be read, is damaged, or has transparency, which would be lost.
    pub fn read(self) -> Result<Picture, ImageError> {
        let ImageFile { path, decoder, width, height } = self;
        let pixels = contained(&path, || {
            if is_float(decoder.color_type()) { floats(&path, decoder) } else { levels(&path, decoder) }
        })?;
        Ok(Picture::new(width, height, pixels))
    }
}

fn is_float(color: ColorType) -> bool {
    matches!(color, ColorType::Rgb32F | ColorType::Rgba32F)
}

thread_local! {
    /// Whether a decoder is at work in this thread, whose panics are reported as errors.
    static CONTAINED: Cell<bool> = const { Cell::new(false) };
}

/// The last line of defence: a file on which a decoder panics counts as damaged, without a panic's message.
fn contained<T>(path: &Path, decode: impl FnOnce() -> Result<T, ImageError>) -> Result<T, ImageError> {
    static QUIET: Once = Once::new();
    QUIET.call_once(|| {
        let tell = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if !CONTAINED.get() {
                tell(info);
            }
        }));
    });
    CONTAINED.set(true);
    // What a panic leaves half done is dropped unused.
    let result = panic::catch_unwind(AssertUnwindSafe(decode));
    CONTAINED.set(false);
    result.unwrap_or_else(|_| {
        let what = "its decoder gave up on it".into();
        Err(ImageError::Malformed { path: path.into(), what })
    })
}

/// The format by a file's first bytes.
enum Magic {
    Png,
    /// PPM and PGM as text, at least two bytes to a sample.
    PnmText,
    /// PPM and PGM, at least one byte to a sample.
    PnmBinary,
    Pfm,
    Exr,
    Hdr,
    Tiff,
    Qoi,
}

impl Magic {
    fn of(start: &[u8]) -> Option<Magic> {
        match start {
            [0x89, b'P', b'N', b'G', b'\r', b'\n', 0x1a, b'\n', ..] => Some(Magic::Png),
            [b'P', b'2' | b'3', ..] => Some(Magic::PnmText),
            [b'P', b'5' | b'6', ..] => Some(Magic::PnmBinary),
            [b'P', b'F' | b'f', ..] => Some(Magic::Pfm),
            [0x76, 0x2f, 0x31, 0x01, ..] => Some(Magic::Exr),
            [b'#', b'?', b'R', ..] => Some(Magic::Hdr),
            [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Some(Magic::Tiff),
            [b'q', b'o', b'i', b'f', ..] => Some(Magic::Qoi),
            _ => None,
        }
    }
}

/// The decoder for an image of `length` bytes, and the most pixels that it can hold.
fn decoder(
    path: &Path,
    mut reader: impl BufRead + Seek + 'static,
    length: u64,
) -> Result<(Box<dyn ImageDecoder>, u64), ImageError> {
    let start = reader.fill_buf().map_err(|error| ImageError::Read { path: path.into(), error })?;
    let magic = Magic::of(start).ok_or_else(|| ImageError::NotAnImage { path: path.into() })?;
    let bits = png_bits(start);
    by_magic(magic, reader, length, bits).map_err(|error| malformed(path, error))
}

fn by_magic(
    magic: Magic,
    mut reader: impl BufRead + Seek + 'static,
    length: u64,
    png_bits: u64,
) -> image::ImageResult<(Box<dyn ImageDecoder>, u64)> {
    let by_deflate = length.saturating_mul(DEFLATE_EXPANSION);
    Ok(match magic {
        Magic::Png => {
            // The rows, a bit of which may become the four bytes of a palette's colour, and what is beside the pixels.
            let most = by_deflate.saturating_mul(32).saturating_add(1 << 20).min(MAX_BYTES);
            (Box::new(PngDecoder::new(reader, most as usize)?), by_deflate.saturating_mul(8) / png_bits)
        }
        Magic::Exr => {
            let decoder = ExrDecoder::new(reader, length)?;
            let most = decoder.most();
            (Box::new(decoder), most)
        }
        Magic::Hdr => (Box::new(HdrDecoder::new(reader)?), length.saturating_mul(HDR_PIXELS)),
        Magic::Tiff => {
            let most = tiff_pixels(&mut reader, length)?;
            reader.rewind()?;
            let mut decoder = TiffDecoder::new(reader)?;
            let mut limits = Limits::default();
            // Its pixels, which may have a fourth channel that is dropped, and the longest strip.
            limits.max_alloc = Some(decoder.total_bytes().saturating_mul(2).saturating_add(length));
            decoder.set_limits(limits)?;
            (Box::new(decoder), most)
        }
        Magic::Qoi => (Box::new(QoiDecoder::new(reader)?), length.saturating_mul(QOI_PIXELS)),
        Magic::PnmText => (Box::new(PnmDecoder::new(reader)?), length / 2),
        Magic::PnmBinary => (Box::new(PnmDecoder::new(reader)?), length),
        Magic::Pfm => {
            let decoder = PfmDecoder::new(reader)?;
            let most = length / decoder.bytes_per_pixel() as u64;
            (Box::new(decoder), most)
        }
    })
}

/// Bits per pixel of a PNG that begins with these bytes; 1 if it has no such header, which its decoder will report.
fn png_bits(start: &[u8]) -> u64 {
    let channels = |color| match color {
        2 => 3,
        4 => 2,
        6 => 4,
        _ => 1,
    };
    let header = start.get(24..26).map(|header| u64::from(header[0]) * channels(header[1]));
    header.filter(|bits| *bits > 0).unwrap_or(1)
}

/// The most pixels that a TIFF of `length` bytes can hold, after checking that no value and no tile of it is larger
/// than the file can make it: the decoder allocates these before it reads them.
fn tiff_pixels(reader: &mut (impl BufRead + Seek), length: u64) -> image::ImageResult<u64> {
    let hint = || ImageFormatHint::Exact(ImageFormat::Tiff);
    let damaged = |what: &str| image::ImageError::Decoding(DecodingError::new(hint(), what));
    if !tiff_values_fit(reader, length)? {
        return Err(damaged("values are longer than the file"));
    }
    reader.rewind()?;
    let mut tiff = tiff::decoder::Decoder::new(reader).map_err(|error| damaged(&error.to_string()))?;
    let mut number = |tag| tiff.find_tag_unsigned::<u64>(tag).map_err(|error| damaged(&error.to_string()));
    let compression = number(Tag::Compression)?.unwrap_or(1);
    let samples = number(Tag::SamplesPerPixel)?.unwrap_or(1);
    let width = number(Tag::ImageWidth)?.unwrap_or_default();
    let tile =
        number(Tag::TileWidth)?.unwrap_or(width).max(width).saturating_mul(number(Tag::TileLength)?.unwrap_or(1));
    let bits = tiff.colortype().map_err(|error| damaged(&error.to_string()))?.bit_depth();
    let expansion = match compression {
        1 => 1,
        5 => LZW_EXPANSION,
        8 | 32946 => DEFLATE_EXPANSION,
        32773 => RUN_EXPANSION,
        4 => FAX_PIXELS / 8,
        // JPEG is the one of these that occurs: its decoder allocates on the word of a second header.
        _ => {
            let kind = UnsupportedErrorKind::GenericFeature("this compression".into());
            return Err(image::ImageError::Unsupported(UnsupportedError::from_format_and_kind(hint(), kind)));
        }
    };
    let most = length.saturating_mul(8 * expansion) / (samples.max(1) * u64::from(bits.max(1)));
    if tile > most {
        return Err(damaged("a tile is larger than the file can hold"));
    }
    Ok(most)
}

/// Whether the values of a TIFF's first directory are together no longer than the file.
fn tiff_values_fit(reader: &mut (impl Read + Seek), length: u64) -> io::Result<bool> {
    let mut head = [0; 16];
    reader.read_exact(&mut head[..8])?;
    let big_endian = head[0] == b'M';
    let number = |bytes: &[u8]| {
        let append = |number, byte: &u8| number << 8 | u64::from(*byte);
        if big_endian { bytes.iter().fold(0, append) } else { bytes.iter().rev().fold(0, append) }
    };
    // BigTIFF has numbers of 8 bytes, in the count of entries too.
    let (size, count) = if number(&head[2..4]) == 43 {
        reader.read_exact(&mut head[8..])?;
        (8, 8)
    } else {
        (4, 2)
    };
    let directory = number(if size == 8 { &head[8..] } else { &head[4..8] });
    reader.seek(SeekFrom::Start(directory))?;
    let mut bytes = [0; 20];
    reader.read_exact(&mut bytes[..count])?;
    let mut together = 0_u64;
    for _ in 0..number(&bytes[..count]) {
        let entry = &mut bytes[..4 + 2 * size];
        reader.read_exact(entry)?;
        let each = match number(&entry[2..4]) {
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 | 16..=18 => 8,
            _ => 1,
        };
        together = together.saturating_add(number(&entry[4..4 + size]).saturating_mul(each));
        if together > length {
            return Ok(false);
        }
    }
    Ok(true)
}

/// `count` zeros, for the pixels of a decoder's picture.
fn zeros<T: Plain>(path: &Path, (width, height): (u32, u32), count: usize) -> Result<Vec<T>, ImageError> {
    let (mut values, bytes) = (Vec::new(), count * size_of::<T>());
    try_reserve(&mut values, count).map_err(|_| ImageError::Memory { path: path.into(), width, height, bytes })?;
    values.resize(count, T::ZERO);
    Ok(values)
}

fn floats(path: &Path, decoder: Box<dyn ImageDecoder>) -> Result<Pixels, ImageError> {
    let (color, of) = (decoder.color_type(), decoder.dimensions());
    let mut bytes = zeros(path, of, decoder.total_bytes() as usize)?;
    decoder.read_image(&mut bytes).map_err(|error| malformed(path, error))?;
    let size = usize::from(color.bytes_per_pixel());
    let mut pixels = zeros(path, of, bytes.len() / size)?;
    for (pixel, bytes) in pixels.iter_mut().zip(bytes.chunks_exact(size)) {
        let value = |bytes: &[u8; 4]| f32::from_ne_bytes(*bytes);
        match bytes.as_chunks().0 {
            [r, g, b] => *pixel = [r, g, b].map(value),
            [r, g, b, alpha] if value(alpha) == 1.0 => *pixel = [r, g, b].map(value),
            _ => return Err(ImageError::Unsupported { path: path.into(), what: "transparency" }),
        }
    }
    Ok(Pixels::Rgb32F(pixels))
}

fn levels(path: &Path, decoder: Box<dyn ImageDecoder>) -> Result<Pixels, ImageError> {
    let (color, of) = (decoder.color_type(), decoder.dimensions());
    let bytes_of_all = decoder.total_bytes() as usize;
    if color == ColorType::Rgb8 {
        let mut pixels = zeros::<[u8; 3]>(path, of, bytes_of_all / 3)?;
        decoder.read_image(pixels.as_flattened_mut()).map_err(|error| malformed(path, error))?;
        return Ok(Pixels::Rgb8(pixels));
    }
    let mut bytes = zeros(path, of, bytes_of_all)?;
    decoder.read_image(&mut bytes).map_err(|error| malformed(path, error))?;
    if color.has_alpha() && bytes.chunks_exact(color.bytes_per_pixel().into()).any(|pixel| pixel.last() != Some(&255)) {
        return Err(ImageError::Unsupported { path: path.into(), what: "transparency" });
    }
    let size = usize::from(color.bytes_per_pixel());
    let mut pixels = zeros(path, of, bytes.len() / size)?;
    for (pixel, bytes) in pixels.iter_mut().zip(bytes.chunks_exact(size)) {
        *pixel = match *bytes {
            [grey] | [grey, _] => [grey; 3],
            [r, g, b, ..] => [r, g, b],
            [] => unreachable!("a pixel has a channel"),
        };
    }
    Ok(Pixels::Rgb8(pixels))
}

/// A decoder's error in our words if it is about reading.
fn malformed(path: &Path, error: image::ImageError) -> ImageError {
    let what = match error {
        image::ImageError::IoError(error) if error.kind() == io::ErrorKind::UnexpectedEof => "it ends too early".into(),
        image::ImageError::IoError(error) if error.raw_os_error().is_some() => {
            return ImageError::Read { path: path.into(), error };
        }
        image::ImageError::Unsupported(error)
            if matches!(error.format_hint(), ImageFormatHint::Exact(ImageFormat::OpenExr | ImageFormat::Tiff)) =>
        {
            return ImageError::OtherKind { path: path.into(), what: brief(&error.to_string()) };
        }
        error => brief(&error.to_string()),
    };
    ImageError::Malformed { path: path.into(), what }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_decoder_that_panics_has_met_a_damaged_file() {
        let result: Result<(), _> = contained(Path::new("a.png"), || panic!("index out of bounds"));
        let error = result.unwrap_err().to_string();
        assert_eq!(error, "a.png is damaged or incomplete: its decoder gave up on it");
        // Panics elsewhere are reported as usual.
        assert!(!CONTAINED.get());
    }
}
