//! Reads image files from any source. Nothing in a file is trusted before it is checked.

use super::super::{Picture, Pixels};
use super::exr::ExrDecoder;
use super::hdr::HdrFile;
use super::pfm::PfmDecoder;
use super::png::PngDecoder;
use super::pnm::PnmFile;
use super::qoi::QoiFile;
use super::tiff::TiffFile;
use super::{DEFLATE_EXPANSION, ImageError};
use crate::kernels::memory::try_reserve;
use crate::kernels::{Plain, StandardFloats};
use crate::scene::{Mistaken, brief, of_address, recognise_no_picture};
use image::error::{ImageFormatHint, UnsupportedErrorKind};
use image::metadata::Orientation;
use image::{ColorType, ImageDecoder, ImageFormat};
use std::cell::Cell;
use std::error::Error;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek};
use std::panic::{self, AssertUnwindSafe};
use std::path::{Path, PathBuf};
use std::sync::Once;

/// The memory that the pixels of one picture may take, and the length of a file that is read from a
/// pipe.
pub(super) const MAX_BYTES: u64 = 2 << 30;

/// How many pixels a byte of HDR stands for at most: 127 equal pixels take two bytes for each of
/// four channels.
const HDR_PIXELS: u64 = 16;
/// How many pixels a byte of QOI stands for at most: 62 equal pixels take one byte.
const QOI_PIXELS: u64 = 62;

/// Reads an image file, as [`ImageFile::open`] and [`ImageFile::read`] do.
///
/// # Errors
/// Those of these functions.
pub fn read(path: &Path) -> Result<Picture, ImageError> {
    ImageFile::open(path)?.read()
}

/// A PNG, PNM (PBM, PGM, PPM or PAM), PFM, EXR, HDR, TIFF or QOI file whose header has been read:
/// the size of the picture is known, and a file of this length can contain it. The format is
/// recognised by the content, not by the name.
pub struct ImageFile {
    path: PathBuf,
    decoder: Box<dyn ImageDecoder>,
    /// How the decoder's rows and columns are oriented in the picture.
    orientation: Orientation,
}

/// A decoder after it has read a file's header.
struct Opened {
    decoder: Box<dyn ImageDecoder>,
    /// The width and height of the pixels that the file must contain.
    stored: (u32, u32),
    /// The most pixels that a file of this length can contain.
    most: u64,
}

impl Opened {
    /// A file that must contain all pixels of the picture.
    fn whole(decoder: impl ImageDecoder + 'static, most: u64) -> Self {
        Opened { stored: decoder.dimensions(), decoder: Box::new(decoder), most }
    }
}

impl ImageFile {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// If the file cannot be read, is not an image in one of these formats, is damaged, cannot hold
    /// the pixels that it claims, is of an unsupported kind, or exceeds 2 GiB of pixels; or if
    /// something would be lost in [`Pixels`], because channels have more than 8 bits and are not
    /// floats.
    pub fn open(path: &Path) -> Result<Self, ImageError> {
        let failed = |error| ImageError::Read { path: path.into(), error };
        let file = File::open(path).map_err(|error| failed(of_address(path, error)))?;
        let metadata = file.metadata().map_err(failed)?;
        let mut reader = BufReader::with_capacity(1 << 16, file);
        if metadata.is_file() {
            return Self::of_reader(path, reader, metadata.len());
        }
        // The length of a pipe is not known, and it cannot be rewound. It is therefore read as a
        // whole, if it begins like an image.
        let start = reader.fill_buf().map_err(failed)?;
        Magic::of(start).ok_or_else(|| no_image(path, start))?;
        let mut bytes = Vec::new();
        reader.take(MAX_BYTES).read_to_end(&mut bytes).map_err(failed)?;
        Self::of_bytes(path, bytes)
    }

    /// Reads the header of a file in memory; `path` is only for messages.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn of_bytes(path: &Path, bytes: Vec<u8>) -> Result<Self, ImageError> {
        let length = bytes.len() as u64;
        Self::of_reader(path, Cursor::new(bytes), length)
    }

    fn of_reader(path: &Path, reader: impl BufRead + Seek + 'static, length: u64) -> Result<Self, ImageError> {
        contained(path, || Self::of_header(path, reader, length))
    }

    /// Checks the size that the header claims, and that this kind of image can be read.
    fn of_header(path: &Path, reader: impl BufRead + Seek + 'static, length: u64) -> Result<Self, ImageError> {
        let Opened { mut decoder, stored: (width, height), most } = open(path, reader, length)?;
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
        let (width, height) = decoder.dimensions();
        if u64::from(width) * u64::from(height) > MAX_BYTES / u64::from(color.bytes_per_pixel().max(3)) {
            return Err(ImageError::TooLarge { path: path.into(), width, height });
        }
        let orientation = decoder.orientation().map_err(|error| malformed(path, error))?;
        Ok(ImageFile { path: path.into(), decoder, orientation })
    }

    /// The number of pixels in a row, and of rows.
    pub fn size(&self) -> (u32, u32) {
        let (width, height) = self.decoder.dimensions();
        if is_transposed(self.orientation) { (height, width) } else { (width, height) }
    }

    /// Decodes the pixels.
    ///
    /// A grey value becomes R = G = B. Alpha is dropped if the picture is opaque everywhere. The
    /// samples of a PNM whose maximum is below 255 are scaled to 255. Of a PFM's scale only the
    /// sign counts. Values of an HDR are divided by its EXPOSURE and COLORCORR. A TIFF or HDR that
    /// is not stored upright is turned. An EXR is black outside of its data window.
    ///
    /// # Errors
    /// If the file cannot be read, is damaged, or has transparency, which would be lost.
    pub fn read(self) -> Result<Picture, ImageError> {
        let (width, height) = self.size();
        let ImageFile { path, decoder, orientation } = self;
        let stored = decoder.dimensions();
        let pixels = contained(&path, || {
            if is_float(decoder.color_type()) { floats(&path, decoder) } else { levels(&path, decoder) }
        })?;
        let upright = match pixels {
            _ if orientation == Orientation::NoTransforms => pixels,
            Pixels::Rgb8(pixels) => Pixels::Rgb8(turned(&path, &pixels, stored, orientation)?),
            Pixels::Rgb32F(pixels) => Pixels::Rgb32F(turned(&path, &pixels, stored, orientation)?),
        };
        Ok(Picture::new(width, height, upright))
    }
}

/// Whether stored rows are columns of the picture.
fn is_transposed(orientation: Orientation) -> bool {
    use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    matches!(orientation, Rotate90 | Rotate90FlipH | Rotate270 | Rotate270FlipH)
}

/// Turns pixels that are stored in rows of `width` to the upright picture.
fn turned<T: Plain>(
    path: &Path,
    pixels: &[T],
    (width, height): (u32, u32),
    orientation: Orientation,
) -> Result<Vec<T>, ImageError> {
    // By Exif's numbers: whether the first stored row is at the bottom or at the right side of the
    // picture, and whether the first stored column is.
    let has_last_row_first = matches!(orientation.to_exif(), 3 | 4 | 6 | 7);
    let has_last_column_first = matches!(orientation.to_exif(), 2 | 3 | 7 | 8);
    let is_transposed = is_transposed(orientation);
    let across = if is_transposed { height } else { width } as usize;
    let mut upright = zeros(path, (width, height), pixels.len())?;
    let (width, height) = (width as usize, height as usize);
    for (y, row) in upright.chunks_exact_mut(across).enumerate() {
        for (x, pixel) in row.iter_mut().enumerate() {
            let (row, column) = if is_transposed { (x, y) } else { (y, x) };
            let row = if has_last_row_first { height - 1 - row } else { row };
            let column = if has_last_column_first { width - 1 - column } else { column };
            *pixel = pixels[row * width + column];
        }
    }
    Ok(upright)
}

fn is_float(color: ColorType) -> bool {
    matches!(color, ColorType::Rgb32F | ColorType::Rgba32F)
}

thread_local! {
    /// Whether this thread runs a decoder, whose panics become errors.
    static CONTAINED: Cell<bool> = const { Cell::new(false) };
}

/// The last line of defence: a file on which a decoder panics is reported as damaged, without the
/// panic's message.
fn contained<T>(path: &Path, decode: impl FnOnce() -> Result<T, ImageError>) -> Result<T, ImageError> {
    let _floats = StandardFloats::set();
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
    // What a panic leaves half done is dropped and not used again.
    let result = panic::catch_unwind(AssertUnwindSafe(decode));
    CONTAINED.set(false);
    result.unwrap_or_else(|_| {
        let what = "its decoder gave up on it".into();
        Err(ImageError::Malformed { path: path.into(), what })
    })
}

/// The format as recognised by a file's first bytes.
enum Magic {
    Png,
    /// PBM as text, with at least one byte per pixel.
    PbmText,
    /// PBM with one bit per pixel.
    PbmBinary,
    /// PPM and PGM as text, with at least two bytes per sample.
    PnmText,
    /// PPM, PGM and PAM in binary, with at least one byte per sample.
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
            [b'P', b'1', ..] => Some(Magic::PbmText),
            [b'P', b'4', ..] => Some(Magic::PbmBinary),
            [b'P', b'2' | b'3', ..] => Some(Magic::PnmText),
            [b'P', b'5'..=b'7', ..] => Some(Magic::PnmBinary),
            [b'P', b'F' | b'f', ..] => Some(Magic::Pfm),
            [0x76, 0x2f, 0x31, 0x01, ..] => Some(Magic::Exr),
            [b'#', b'?', ..] => Some(Magic::Hdr),
            [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Some(Magic::Tiff),
            [b'q', b'o', b'i', b'f', ..] => Some(Magic::Qoi),
            _ => None,
        }
    }
}

/// The error for a file that does not begin like any image that can be read.
fn no_image(path: &Path, start: &[u8]) -> ImageError {
    let path = path.to_path_buf();
    if start.is_empty() {
        return ImageError::Malformed { path, what: "it is empty".into() };
    }
    match recognise_no_picture(start) {
        Some(Mistaken { what, help }) => ImageError::Mistaken { path, what, help },
        None => ImageError::NotAnImage { path },
    }
}

/// Reads the header of an image of `length` bytes.
fn open(path: &Path, mut reader: impl BufRead + Seek + 'static, length: u64) -> Result<Opened, ImageError> {
    let start = reader.fill_buf().map_err(|error| ImageError::Read { path: path.into(), error })?;
    let magic = Magic::of(start).ok_or_else(|| no_image(path, start))?;
    let bits = png_bits(start);
    by_magic(magic, reader, length, bits).map_err(|error| malformed(path, error))
}

fn by_magic(
    magic: Magic,
    reader: impl BufRead + Seek + 'static,
    length: u64,
    png_bits: u64,
) -> image::ImageResult<Opened> {
    let by_deflate = length.saturating_mul(DEFLATE_EXPANSION);
    Ok(match magic {
        Magic::Png => {
            // Memory for the rows, in which one bit may become the four bytes of a palette's
            // colour, and for what the file contains beside pixels.
            let most = by_deflate.saturating_mul(32).saturating_add(1 << 20).min(MAX_BYTES);
            Opened::whole(PngDecoder::new(reader, most as usize)?, by_deflate.saturating_mul(8) / png_bits)
        }
        Magic::Exr => {
            let decoder = ExrDecoder::new(reader, length)?;
            // Only the data window has to be in the file; the display window is black elsewhere.
            Opened { stored: decoder.stored(), most: decoder.most(), decoder: Box::new(decoder) }
        }
        Magic::Hdr => Opened::whole(HdrFile::new(reader)?, length.saturating_mul(HDR_PIXELS)),
        Magic::Tiff => {
            let decoder = TiffFile::new(reader, length)?;
            Opened { stored: decoder.stored(), most: decoder.most(), decoder: Box::new(decoder) }
        }
        Magic::Qoi => Opened::whole(QoiFile::new(reader)?, length.saturating_mul(QOI_PIXELS)),
        Magic::PbmText => Opened::whole(PnmFile::new(reader, true)?, length),
        Magic::PbmBinary => Opened::whole(PnmFile::new(reader, false)?, length.saturating_mul(8)),
        Magic::PnmText => Opened::whole(PnmFile::new(reader, true)?, length / 2),
        Magic::PnmBinary => Opened::whole(PnmFile::new(reader, false)?, length),
        Magic::Pfm => {
            let decoder = PfmDecoder::new(reader)?;
            let most = length / decoder.bytes_per_pixel() as u64;
            Opened::whole(decoder, most)
        }
    })
}

/// The bits per pixel of a PNG that begins with these bytes. 1 if it has no header, which its
/// decoder will report.
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

/// `count` zeros, to hold the pixels of a decoder's picture.
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

/// Whether an unsupported-format error is about PNM. Every PNM is supported, so that the file must
/// be damaged, by an impossible size.
fn is_pnm(error: &image::error::UnsupportedError) -> bool {
    matches!(error.format_hint(), ImageFormatHint::Exact(ImageFormat::Pnm))
}

/// The error for a decoder's error, in our words if it is about reading.
fn malformed(path: &Path, error: image::ImageError) -> ImageError {
    let what = match error {
        image::ImageError::IoError(error) if error.kind() == io::ErrorKind::UnexpectedEof => "it ends too early".into(),
        image::ImageError::IoError(error) if error.raw_os_error().is_some() => {
            return ImageError::Read { path: path.into(), error };
        }
        image::ImageError::Unsupported(error) if !is_pnm(&error) => {
            let what = match error.kind() {
                UnsupportedErrorKind::GenericFeature(what) => what.clone(),
                _ => error.to_string(),
            };
            return ImageError::OtherKind { path: path.into(), what: brief(&what) };
        }
        image::ImageError::Decoding(error) => {
            // The message, without the name of the format before it.
            brief(&error.source().map_or_else(|| error.to_string(), ToString::to_string))
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
