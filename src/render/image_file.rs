//! Image files, written band by band, so that an image need not be in memory as a whole, and read
//! back.

mod encode;
mod exr;
mod hdr;
mod parts;
mod pfm;
mod png;
mod pnm;
mod qoi;
mod read;
mod threaded;
mod tiff;

use super::film::with_pixels;
use super::output::{self, Destination, Existing, OutputError};
use super::{Film, PixelFormat};
use crate::kernels::StandardFloats;
use crate::scene::shown;
use parts::{Encode, Join};
pub use read::{ImageFile, read};
use std::borrow::Cow;
use std::io;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use thiserror::Error;

/// How many bytes a byte of deflate can stand for at most: two bits can stand for 258 bytes.
const DEFLATE_EXPANSION: u64 = 1032;

/// A format that images are written in.
// A new format needs a variant here, a row in [`Format::EXTENSIONS`], its encoder and its joiner of
// parts in `encode.rs`, and its decoder in `read.rs`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// PNG: 8 bits per channel, compressed without loss.
    Png,
    /// Binary PPM (P6): 8 bits per channel.
    Ppm,
    /// PPM as text (P3): 8 bits per channel, one pixel per line.
    PpmText,
    /// PFM: linear floats, uncompressed, little endian.
    Pfm,
    /// OpenEXR: linear floats, compressed without loss.
    Exr,
    /// Radiance HDR: linear values that are not negative, with 8 bits each and a common exponent;
    /// held in memory until the image is complete.
    Hdr,
    /// TIFF: 8 bits per channel, compressed without loss; held in memory until the image is
    /// complete.
    Tiff,
    /// QOI: 8 bits per channel, compressed without loss; held in memory until the image is
    /// complete.
    Qoi,
}

impl Format {
    /// Each file extension, in lower case, with the format that is written under it.
    pub const EXTENSIONS: &[(&str, Format)] = &[
        ("png", Format::Png),
        ("ppm", Format::Ppm),
        // `.pgm` means a grey image, but scenes from the paper's time use it for P3 images in
        // colour.
        ("pgm", Format::PpmText),
        ("pfm", Format::Pfm),
        ("exr", Format::Exr),
        ("hdr", Format::Hdr),
        ("tiff", Format::Tiff),
        ("tif", Format::Tiff),
        ("qoi", Format::Qoi),
    ];

    /// The format that a file name means by its extension, in upper or lower case; PNG without an
    /// extension. For standard output, `:-` follows the extension.
    ///
    /// # Errors
    /// If the extension is unknown; the message lists the known ones.
    pub fn from_path(path: &Path) -> Result<Format, ImageError> {
        let extension = output::format_of_standard_output(path).or(path.extension());
        let Some(extension) = extension else { return Ok(Format::Png) };
        let known = Format::EXTENSIONS.iter().find(|(known, _)| extension.eq_ignore_ascii_case(known));
        known.map(|&(_, format)| format).ok_or_else(|| ImageError::UnknownFormat { path: path.into() })
    }

    /// The format of the pixels from which a file is made: three levels
    /// ([`ImageWriter::write_rgb8`]) or three floats ([`ImageWriter::write_f32x3`]). No file format
    /// is written with a fourth channel.
    pub fn pixels(self) -> PixelFormat {
        match self {
            Format::Png | Format::Ppm | Format::PpmText | Format::Tiff | Format::Qoi => PixelFormat::Rgb8,
            Format::Pfm | Format::Exr | Format::Hdr => PixelFormat::F32x3,
        }
    }

    /// Whether the pixels are levels and not floats.
    pub fn is_8bit(self) -> bool {
        self.pixels().is_8bit()
    }
}

/// Why an image file could not be written or read. Every message names the file (`path`) and says
/// what to do.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "path, width and height are what they are called in every variant")]
pub enum ImageError {
    /// The name has an unknown extension.
    #[error("{path}: the name of an image must end in {}", extensions(), path = shown(path))]
    UnknownFormat { path: PathBuf },
    /// A side of the image is zero.
    #[error("{path}: an image of {width}x{height} has no pixels to write: give both sides at least 1",
        path = shown(path))]
    NoPixels { path: PathBuf, width: u32, height: u32 },
    /// The image has more pixels than may be held in memory, and the format cannot be written row
    /// by row.
    #[error("{path}: an image of {width}x{height} takes {need} MiB of memory in this format, which is written as a \
        whole, and {limit} MiB are allowed: name it .png, .ppm, .exr or .pfm, which are written row by row",
        path = shown(path), need = bytes >> 20, limit = encode::MAX_WHOLE >> 20)]
    Whole {
        path: PathBuf,
        width: u32,
        height: u32,
        /// The memory that the image's pixels take.
        bytes: u64,
    },
    /// The file could not be created, written or named.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// [`ImageWriter::finish`] was called before all rows had been written.
    #[error("{path} was not written: only {rows} of its {height} rows were rendered", path = shown(path))]
    RowsMissing {
        path: PathBuf,
        /// Rows that were written.
        rows: u32,
        /// Rows of the image.
        height: u32,
    },
    /// Opening or reading failed.
    #[error("cannot read {path}: {error}", path = shown(path))]
    Read {
        path: PathBuf,
        /// The system's error.
        error: io::Error,
    },
    /// The content begins like no known format.
    #[error("{path} is of an unsupported format: rayo reads PNG, PNM (PBM, PGM, PPM and PAM), PFM, EXR, HDR, TIFF and \
        QOI", path = shown(path))]
    NotAnImage { path: PathBuf },
    /// The content is something else than an image, such as a web page.
    #[error("{path}: {what}, and an image is expected: {help}", path = shown(path))]
    Mistaken {
        path: PathBuf,
        /// What the content is, in words.
        what: &'static str,
        /// What to do.
        help: &'static str,
    },
    /// The file begins like an image, but is truncated, damaged or inconsistent.
    #[error("{path} is damaged or incomplete: {what}", path = shown(path))]
    Malformed {
        path: PathBuf,
        /// The damage.
        what: String,
    },
    /// The image is of a kind that the decoders do not support, or not safely.
    #[error("{path} is of a kind that is not read here: {what}; convert it to PNG or PFM first", path = shown(path))]
    OtherKind {
        path: PathBuf,
        /// The kind.
        what: String,
    },
    /// The image is valid, but something of it would be lost.
    #[error("{path} has {what}, which would be lost here: convert it to 8-bit RGB or to PFM first",
        path = shown(path))]
    Unsupported {
        path: PathBuf,
        /// What would be lost.
        what: &'static str,
    },
    /// There is not enough memory for the pixels.
    #[error("{path} has {width}x{height} pixels, and there is no memory for {bytes} bytes of them", path = shown(path))]
    Memory {
        path: PathBuf,
        width: u32,
        height: u32,
        /// The memory requested.
        bytes: usize,
    },
    /// The image has more pixels than may be read into memory.
    #[error("{path} has {width}x{height} pixels, more than the {limit} MiB of memory allowed for one picture: \
        compare a part of it", path = shown(path), limit = read::MAX_BYTES >> 20)]
    TooLarge { path: PathBuf, width: u32, height: u32 },
}

/// The list of extensions, as text: ".png, .ppm, ... or .pfm".
fn extensions() -> String {
    let names: Vec<_> = Format::EXTENSIONS.iter().map(|(extension, _)| format!(".{extension}")).collect();
    match names.split_last() {
        Some((last, rest)) if !rest.is_empty() => format!("{} or {last}", rest.join(", ")),
        _ => names.concat(),
    }
}

/// The rows of a picture that a file holds: all or some of them.
#[derive(Clone, Debug)]
pub(super) struct Extent {
    width: u32,
    rows: Range<u32>,
    /// The number of rows of the picture.
    whole: u32,
}

impl Extent {
    /// Some of the rows of a picture with this width and height.
    pub(super) fn new((width, whole): (u32, u32), rows: Range<u32>) -> Self {
        assert!(rows.start <= rows.end && rows.end <= whole, "{rows:?} of {whole} rows");
        Extent { width, rows, whole }
    }

    fn height(&self) -> u32 {
        self.rows.end - self.rows.start
    }
}

/// Encodes parts of a picture, in any order and from any thread. [`ImageWriter::append`] joins the
/// parts to a file.
pub(super) struct PartEncoder {
    format: Format,
    encode: Box<dyn Encode>,
}

impl PartEncoder {
    /// The encoder for a file of this format.
    pub(super) fn new(format: Format, extent: &Extent) -> Self {
        PartEncoder { format, encode: encode::encoder(format, extent) }
    }

    /// The format of the pixels from which parts are made.
    pub(super) fn pixels(&self) -> PixelFormat {
        self.format.pixels()
    }

    /// The number of rows in every part but the last; None if parts may be cut anywhere.
    pub(super) fn part_rows(&self) -> Option<u32> {
        self.encode.part_rows()
    }

    /// Encodes rows of a film, whose format is that of this encoder's [`pixels`](Self::pixels).
    pub(super) fn encode<'a>(&self, film: &'a Film, pixels: Range<usize>) -> io::Result<Cow<'a, [u8]>> {
        match film {
            Film::Rgb8(film) => self.encode.rgb8(&film[pixels]),
            Film::F32x3(film) => self.encode.f32x3(&film[pixels]),
            Film::F32x4(_) | Film::Rgba8(_) | Film::Bgra8(_) => unreachable!("no file has them"),
        }
    }
}

/// An image file that is being written. It takes rows from the top, and appears under its name when
/// it is [`finish`](Self::finish)ed.
///
/// Until then there is nothing under the name, or the file that was there before; on Linux there is
/// not even a hidden file. A symbolic link stays, and the file that it points to is replaced. A
/// device or a pipe is written to directly, and so is standard output under the name `-`.
pub struct ImageWriter {
    path: PathBuf,
    extent: Extent,
    /// The number of rows written so far.
    rows: u32,
    encoder: Arc<PartEncoder>,
    /// Rows that do not make up a whole part yet.
    pending: Film,
    /// Declared before `destination`, and therefore dropped before it: its last writes still find
    /// the file open.
    joiner: Box<dyn Join>,
    destination: Destination,
}

impl ImageWriter {
    /// Begins an image of `width` x `height` pixels that will replace the file at `path`.
    ///
    /// # Errors
    /// If a side is zero, if nothing can be written at `path`, or if the format is held in memory
    /// and the image is too large ([`ImageError::Whole`]).
    pub fn create(path: &Path, format: Format, width: u32, height: u32) -> Result<Self, ImageError> {
        Self::of_rows(path, format, (width, height), 0..height, Existing::Replace)
    }

    /// Begins an image at a path where nothing may exist, be it a file, a link or a device.
    ///
    /// If something appears there before [`finish`](Self::finish) is called, that call fails and
    /// replaces nothing.
    ///
    /// # Errors
    /// As [`create`](Self::create), and [`OutputError::Exists`].
    pub fn create_new(path: &Path, format: Format, width: u32, height: u32) -> Result<Self, ImageError> {
        Self::of_rows(path, format, (width, height), 0..height, Existing::Keep)
    }

    /// Begins an image of some of a picture's rows. In [`Format::Exr`] they are at their position
    /// in the whole picture; in the other formats they are a picture by themselves.
    ///
    /// # Errors
    /// As [`create`](Self::create), and as [`create_new`](Self::create_new) if an existing file
    /// must not be replaced.
    ///
    /// # Panics
    /// If the picture does not have these rows.
    pub fn of_rows(
        path: &Path,
        format: Format,
        size: (u32, u32),
        rows: Range<u32>,
        existing: Existing,
    ) -> Result<Self, ImageError> {
        let extent = Extent::new(size, rows);
        let (width, height) = (extent.width, extent.height());
        if width == 0 || height == 0 {
            return Err(ImageError::NoPixels { path: path.into(), width, height });
        }
        let bytes = encode::whole_bytes(format, (width, height));
        if encode::is_whole(format) && bytes > encode::MAX_WHOLE {
            return Err(ImageError::Whole { path: path.into(), width, height, bytes });
        }
        let (destination, sink) = output::open(path, existing, encode::needs_seeking(format))?;
        let joiner = encode::joiner(format, sink, &extent).map_err(|error| destination.explain(path, error))?;
        let encoder = Arc::new(PartEncoder::new(format, &extent));
        let pending = if format.is_8bit() { Film::Rgb8(Vec::new()) } else { Film::F32x3(Vec::new()) };
        Ok(ImageWriter { path: path.into(), extent, rows: 0, encoder, pending, joiner, destination })
    }

    /// The format of the file.
    pub fn format(&self) -> Format {
        self.encoder.format
    }

    /// The rows of the picture that the file holds.
    pub fn rows(&self) -> Range<u32> {
        self.extent.rows.clone()
    }

    /// The number of pixels in a row, of rows in the whole picture, and of rows written so far.
    pub(super) fn size(&self) -> [u32; 3] {
        let pending = self.pending.len() / self.extent.width as usize;
        [self.extent.width, self.extent.whole, self.rows + pending as u32]
    }

    /// The encoder of the file's parts.
    pub(super) fn encoder(&self) -> Arc<PartEncoder> {
        Arc::clone(&self.encoder)
    }

    /// The time that the system has taken so far to accept what was written, without that of
    /// encoding.
    pub fn writing(&self) -> Duration {
        self.destination.writing()
    }

    /// Appends whole rows of 8-bit R, G, B. Any number of rows per call, in order from the top.
    ///
    /// After an error the image cannot be completed.
    ///
    /// # Errors
    /// If writing fails.
    ///
    /// # Panics
    /// If the format does not have 8 bits, if a row is incomplete, or if there are more rows than
    /// the image has. These are bugs of the caller.
    pub fn write_rgb8(&mut self, rows: &[[u8; 3]]) -> Result<(), ImageError> {
        let format = self.format();
        assert!(format.is_8bit(), "{format:?} takes floats: quantising is not done here, nor undone");
        self.check(rows.len());
        if let Film::Rgb8(pending) = &mut self.pending {
            pending.extend_from_slice(rows);
        }
        self.append_pending()
    }

    /// Appends whole rows of linear R, G, B, which are not clamped. A call may have any number of
    /// rows; calls go from the top to the bottom.
    ///
    /// After an error the image cannot be completed.
    ///
    /// # Errors
    /// If writing fails.
    ///
    /// # Panics
    /// If the format has 8 bits, if a row is incomplete, or if there are more rows than the image
    /// has. These are bugs of the caller.
    pub fn write_f32x3(&mut self, rows: &[[f32; 3]]) -> Result<(), ImageError> {
        let format = self.format();
        assert!(!format.is_8bit(), "{format:?} takes 8 bits: quantising is not done here");
        self.check(rows.len());
        if let Film::F32x3(pending) = &mut self.pending {
            pending.extend_from_slice(rows);
        }
        self.append_pending()
    }

    /// Checks that `pixels` more pixels are whole rows of the image.
    fn check(&self, pixels: usize) {
        let width = self.extent.width as usize;
        assert!(pixels.is_multiple_of(width), "{pixels} pixels are no whole rows of {width}");
        let left = self.extent.height() - self.rows - (self.pending.len() / width) as u32;
        assert!(pixels / width <= left as usize, "{} rows, where {left} are left", pixels / width);
    }

    /// Writes those pending rows that make up whole parts.
    fn append_pending(&mut self) -> Result<(), ImageError> {
        let _floats = StandardFloats::set();
        let width = self.extent.width as usize;
        let pending = (self.pending.len() / width) as u32;
        let part = self.encoder.part_rows().unwrap_or(pending);
        let is_last = self.rows + pending == self.extent.height();
        let encoder = self.encoder();
        let film = std::mem::replace(&mut self.pending, Film::Rgb8(Vec::new()));
        let mut from = 0;
        while from < pending && (from + part <= pending || is_last) {
            let rows = part.min(pending - from);
            self.append(rows, encoder.encode(&film, width * from as usize..width * (from + rows) as usize))?;
            from += rows;
        }
        self.pending = film;
        with_pixels!(Film(film) = &mut self.pending => drop(film.drain(..width * from as usize)));
        Ok(())
    }

    /// Writes the next part, which has `rows` rows, or returns the encoder's error.
    pub(super) fn append(&mut self, rows: u32, part: io::Result<Cow<'_, [u8]>>) -> Result<(), ImageError> {
        let appended = part.and_then(|part| self.joiner.append(part));
        appended.map_err(|error| self.destination.explain(&self.path, error))?;
        self.rows += rows;
        Ok(())
    }

    /// Completes the image and gives it its name.
    ///
    /// # Errors
    /// If rows are missing, or if writing or renaming fails. The target is then as it was before,
    /// except that a target which is written to directly has received what was written.
    pub fn finish(self) -> Result<(), ImageError> {
        let _floats = StandardFloats::set();
        let ImageWriter { path, extent, rows, pending, joiner, destination, .. } = self;
        let (height, rows) = (extent.height(), rows + (pending.len() / extent.width as usize) as u32);
        if rows < height {
            return Err(ImageError::RowsMissing { path, rows, height });
        }
        if let Err(error) = joiner.finish() {
            return Err(destination.explain(&path, error).into());
        }
        Ok(destination.finish(path)?)
    }
}
