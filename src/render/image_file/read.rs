//! Image files read into memory, whoever wrote them: nothing in a file is believed before it is checked.

use super::ImageError;
use crate::measure::picture::{Picture, Pixels};
use image::codecs::{
    hdr::HdrDecoder, openexr::OpenExrDecoder, png::PngDecoder, pnm::PnmDecoder, qoi::QoiDecoder, tiff::TiffDecoder,
};
use image::{ColorType, ImageDecoder, Limits};
use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, Read, Seek};
use std::path::Path;

/// The most memory that the pixels of one picture may take, and the longest file that is read from a pipe.
pub(super) const MAX_BYTES: u64 = 2 << 30;

/// The most bytes that one byte of deflate can stand for: two bits can repeat 258 bytes.
const DEFLATE_EXPANSION: u64 = 1032;
/// As many pixels at most as a byte of EXR or TIFF stands for, in any of their compressions of a picture.
const MOST_EXPANSION: u64 = 4096;
/// The same for HDR: 127 equal pixels take two bytes for each of four channels.
const HDR_EXPANSION: u64 = 16;
/// The same for QOI: 62 equal pixels take one.
const QOI_EXPANSION: u64 = 62;

/// Reads a PNG, PPM (P3, P6), PGM (P2, P5), PFM, EXR, HDR, TIFF or QOI file; its content tells the format, not its name.
///
/// Grey becomes R = G = B. Alpha is dropped where it is opaque everywhere. A PPM whose largest level is below 255 is
/// stretched to it; the scale of a PFM, beyond its sign, is ignored.
///
/// # Errors
/// If the file cannot be read, is no such image, is damaged, would lose something as [`Pixels`] (16 bits,
/// transparency), or has more pixels than fit into 2 GiB.
pub fn read(path: &Path) -> Result<Picture, ImageError> {
    let failed = |error| ImageError::Read { path: path.into(), error };
    let file = File::open(path).map_err(failed)?;
    let metadata = file.metadata().map_err(failed)?;
    let mut reader = BufReader::with_capacity(1 << 16, file);
    if metadata.is_file() {
        return decode(path, reader, metadata.len());
    }
    // A pipe: its length must be known and it must be rewound, so it is read whole, but only if it begins like an image.
    let start = reader.fill_buf().map_err(failed)?;
    Magic::of(start).ok_or_else(|| ImageError::NotAnImage { path: path.into() })?;
    let mut bytes = Vec::new();
    reader.take(MAX_BYTES).read_to_end(&mut bytes).map_err(failed)?;
    let length = bytes.len() as u64;
    decode(path, Cursor::new(bytes), length)
}

/// What a file's first bytes say that it is.
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

/// Decodes an image of `length` bytes; `path` is for messages alone.
fn decode(path: &Path, mut reader: impl BufRead + Seek, length: u64) -> Result<Picture, ImageError> {
    let start = reader.fill_buf().map_err(|error| ImageError::Read { path: path.into(), error })?;
    let magic = Magic::of(start).ok_or_else(|| ImageError::NotAnImage { path: path.into() })?;
    let damaged = |error: image::ImageError| malformed(path, error);
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_BYTES);
    match magic {
        Magic::Png => {
            let decoder = PngDecoder::with_limits(reader, limits).map_err(damaged)?;
            // Its smallest pixel is one bit before compression.
            decode_with(path, decoder, length.saturating_mul(8 * DEFLATE_EXPANSION))
        }
        Magic::Exr => {
            let decoder = OpenExrDecoder::new(reader).map_err(damaged)?;
            decode_with(path, decoder, length.saturating_mul(MOST_EXPANSION))
        }
        Magic::Hdr => {
            let decoder = HdrDecoder::new(reader).map_err(damaged)?;
            decode_with(path, decoder, length.saturating_mul(HDR_EXPANSION))
        }
        Magic::Tiff => {
            let mut decoder = TiffDecoder::new(reader).map_err(damaged)?;
            decoder.set_limits(limits).map_err(damaged)?;
            decode_with(path, decoder, length.saturating_mul(MOST_EXPANSION))
        }
        Magic::Qoi => {
            let decoder = QoiDecoder::new(reader).map_err(damaged)?;
            decode_with(path, decoder, length.saturating_mul(QOI_EXPANSION))
        }
        Magic::PnmText => decode_with(path, PnmDecoder::new(reader).map_err(damaged)?, length / 2),
        Magic::PnmBinary => decode_with(path, PnmDecoder::new(reader).map_err(damaged)?, length),
        Magic::Pfm => decode_pfm(path, reader, length),
    }
}

/// Decodes levels or floats from a file that cannot hold more than `most` pixels.
fn decode_with(path: &Path, decoder: impl ImageDecoder, most: u64) -> Result<Picture, ImageError> {
    match decoder.color_type() {
        ColorType::Rgb32F | ColorType::Rgba32F => decode_floats(path, decoder, most),
        _ => decode_8bit(path, decoder, most),
    }
}

fn decode_floats(path: &Path, decoder: impl ImageDecoder, most: u64) -> Result<Picture, ImageError> {
    let (width, height) = decoder.dimensions();
    let color = decoder.color_type();
    let count = checked_count(path, (width, height), color.bytes_per_pixel().into(), most)?;
    let mut bytes = vec![0; count * usize::from(color.bytes_per_pixel())];
    decoder.read_image(&mut bytes).map_err(|error| malformed(path, error))?;
    let values = |bytes: &[u8]| bytes.as_chunks().0.iter().map(|&bytes| f32::from_ne_bytes(bytes)).collect::<Vec<_>>();
    let mut pixels = Vec::with_capacity(count);
    for pixel in bytes.chunks_exact(color.bytes_per_pixel().into()) {
        match values(pixel)[..] {
            [r, g, b] | [r, g, b, 1.0] => pixels.push([r, g, b]),
            _ => return Err(ImageError::Unsupported { path: path.into(), what: "transparency" }),
        }
    }
    Ok(Picture::new(width, height, Pixels::Rgb32F(pixels)))
}

fn decode_8bit(path: &Path, decoder: impl ImageDecoder, most: u64) -> Result<Picture, ImageError> {
    let unsupported = |what| ImageError::Unsupported { path: path.into(), what };
    let (width, height) = decoder.dimensions();
    let color = decoder.color_type();
    if !matches!(color, ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8) {
        return Err(unsupported("more than 8 bits per channel"));
    }
    let count = checked_count(path, (width, height), u64::from(color.bytes_per_pixel().max(3)), most)?;
    if color == ColorType::Rgb8 {
        let mut pixels = vec![[0; 3]; count];
        decoder.read_image(pixels.as_flattened_mut()).map_err(|error| malformed(path, error))?;
        return Ok(Picture::new(width, height, Pixels::Rgb8(pixels)));
    }
    let mut bytes = vec![0; count * usize::from(color.bytes_per_pixel())];
    decoder.read_image(&mut bytes).map_err(|error| malformed(path, error))?;
    if color.has_alpha() && bytes.chunks_exact(color.bytes_per_pixel().into()).any(|pixel| pixel.last() != Some(&255)) {
        return Err(unsupported("transparency"));
    }
    let pixels = match color {
        ColorType::L8 => bytes.into_iter().map(|grey| [grey; 3]).collect(),
        ColorType::La8 => bytes.as_chunks().0.iter().map(|&[grey, _]| [grey; 3]).collect(),
        _ => bytes.as_chunks().0.iter().map(|&[r, g, b, _]| [r, g, b]).collect(),
    };
    Ok(Picture::new(width, height, Pixels::Rgb8(pixels)))
}

/// Decodes floats: `PF` (colour) or `Pf` (grey), width, height, a scale whose sign tells the byte order (negative is
/// little endian), one white space, and then the rows from the bottom.
fn decode_pfm(path: &Path, mut reader: impl BufRead, length: u64) -> Result<Picture, ImageError> {
    let damaged = |what: String| ImageError::Malformed { path: path.into(), what };
    let io = |error: io::Error| malformed(path, error.into());

    let channels = if token(&mut reader).map_err(io)? == "PF" { 3 } else { 1 };
    let mut side = |name| {
        let text = token(&mut reader).map_err(io)?;
        text.parse::<u32>().map_err(|_| damaged(format!("its {name} is \"{}\"", text.escape_default())))
    };
    let (width, height) = (side("width")?, side("height")?);
    let text = token(&mut reader).map_err(io)?;
    let scale = text.parse::<f32>().ok().filter(|scale| scale.is_finite() && *scale != 0.0);
    let scale = scale.ok_or_else(|| damaged(format!("its scale is \"{}\"", text.escape_default())))?;
    let value = if scale < 0.0 { f32::from_le_bytes } else { f32::from_be_bytes };

    let per_pixel = channels * size_of::<f32>();
    let count = checked_count(path, (width, height), size_of::<[f32; 3]>() as u64, length / per_pixel as u64)?;
    let mut pixels = vec![[0.0; 3]; count];
    let mut row = vec![0; width as usize * per_pixel];
    for pixels in pixels.chunks_exact_mut(width as usize).rev() {
        reader.read_exact(&mut row).map_err(io)?;
        for (pixel, bytes) in pixels.iter_mut().zip(row.chunks_exact(per_pixel)) {
            // Grey has one value, which cycles through the channels.
            for (channel, &bytes) in pixel.iter_mut().zip(bytes.as_chunks().0.iter().cycle()) {
                *channel = value(bytes);
            }
        }
    }
    Ok(Picture::new(width, height, Pixels::Rgb32F(pixels)))
}

/// The next word of a PFM header, with the one white space that ends it taken off the reader.
fn token(reader: &mut impl BufRead) -> io::Result<String> {
    // Longer than any number that makes sense, and short enough for a message.
    const LONGEST: usize = 32;
    let mut token = String::new();
    while token.len() < LONGEST {
        let mut byte = [0];
        reader.read_exact(&mut byte)?;
        match byte[0] {
            white if white.is_ascii_whitespace() && token.is_empty() => {}
            white if white.is_ascii_whitespace() => break,
            other => token.push(other.into()),
        }
    }
    Ok(token)
}

/// The number of pixels, once it is clear that there are some, that the file can hold them (`most`, from its length),
/// and that they fit into [`MAX_BYTES`] at `per_pixel` bytes.
fn checked_count(path: &Path, (width, height): (u32, u32), per_pixel: u64, most: u64) -> Result<usize, ImageError> {
    let count = u64::from(width) * u64::from(height);
    if count == 0 || count > most {
        let what = format!("it claims {width}x{height} pixels, which it cannot hold");
        return Err(ImageError::Malformed { path: path.into(), what });
    }
    if count > MAX_BYTES / per_pixel {
        return Err(ImageError::TooLarge { path: path.into(), width, height });
    }
    Ok(count as usize)
}

/// A decoder's error in our words where it is about reading.
fn malformed(path: &Path, error: image::ImageError) -> ImageError {
    let what = match error {
        image::ImageError::IoError(error) if error.kind() == io::ErrorKind::UnexpectedEof => "it ends too early".into(),
        image::ImageError::IoError(error) if error.raw_os_error().is_some() => {
            return ImageError::Read { path: path.into(), error };
        }
        error => error.to_string(),
    };
    ImageError::Malformed { path: path.into(), what }
}
