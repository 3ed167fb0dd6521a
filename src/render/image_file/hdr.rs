//! Reads Radiance HDR: a header with the order of rows and factors of the values, and the pixels.

use image::codecs::hdr::HdrDecoder;
use image::error::{DecodingError, ImageFormatHint, UnsupportedError, UnsupportedErrorKind};
use image::metadata::Orientation;
use image::{ColorType, ImageDecoder, ImageError, ImageFormat, ImageResult};
use std::io::{self, BufRead, Chain, Cursor, Read};

/// The length that a header may have: some programs write a line for every command that made the
/// picture.
const LONGEST: u64 = 1 << 20;
/// The number of rows or columns that a picture may have, so that their product does not overflow.
const LONGEST_SIDE: u32 = 1 << 31;

/// Decodes pictures in all eight orders of rows and columns, whichever program the first line
/// names. Values are divided by EXPOSURE and COLORCORR, which are factors that programs have
/// applied and recorded.
pub(super) struct HdrFile<R> {
    pixels: HdrDecoder<Chain<Cursor<String>, R>>,
    header: Header,
}

/// The contents of a header that matter for the pixels.
struct Header {
    /// The number of stored rows, which are columns of the picture in four of the eight orders.
    rows: u32,
    /// The number of pixels in a stored row.
    columns: u32,
    orientation: Orientation,
    /// The numbers that red, green and blue have to be divided by.
    divisors: [f64; 3],
}

impl<R: BufRead> HdrFile<R> {
    pub(super) fn new(mut reader: R) -> ImageResult<Self> {
        let header = Header::read(&mut (&mut reader).take(LONGEST))?;
        // The library reads only one order and one program name, and is therefore given a header
        // with these.
        let plain = format!("#?RADIANCE\n\n-Y {} +X {}\n", header.rows, header.columns);
        Ok(HdrFile { pixels: HdrDecoder::new(Cursor::new(plain).chain(reader))?, header })
    }
}

impl<R: BufRead> ImageDecoder for HdrFile<R> {
    fn dimensions(&self) -> (u32, u32) {
        self.pixels.dimensions()
    }

    fn color_type(&self) -> ColorType {
        self.pixels.color_type()
    }

    fn orientation(&mut self) -> ImageResult<Orientation> {
        Ok(self.header.orientation)
    }

    fn read_image(self, out: &mut [u8]) -> ImageResult<()> {
        self.pixels.read_image(out)?;
        if self.header.divisors == [1.0; 3] {
            return Ok(());
        }
        for pixel in out.as_chunks_mut::<4>().0.chunks_exact_mut(3) {
            for (value, divisor) in pixel.iter_mut().zip(self.header.divisors) {
                *value = ((f64::from(f32::from_ne_bytes(*value)) / divisor) as f32).to_ne_bytes();
            }
        }
        Ok(())
    }

    fn read_image_boxed(self: Box<Self>, out: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(out)
    }
}

impl Header {
    /// Reads lines up to an empty one, and then the line with the size.
    fn read(reader: &mut impl BufRead) -> ImageResult<Header> {
        let mut divisors = [1.0; 3];
        // The first line is "#?RADIANCE" or the like, which `Magic` has checked.
        line(reader)?;
        loop {
            let line = line(reader)?;
            if line.is_empty() {
                break;
            }
            let Some((name, value)) = line.split_once('=').filter(|_| !line.starts_with('#')) else { continue };
            match name.trim() {
                "FORMAT" if value.trim() != "32-bit_rle_rgbe" => return Err(other_format(value.trim())),
                "EXPOSURE" => {
                    let [exposure] = factors(name, value)?;
                    divisors = divisors.map(|divisor| divisor * exposure);
                }
                "COLORCORR" => {
                    let correction: [f64; 3] = factors(name, value)?;
                    divisors = std::array::from_fn(|channel| divisors[channel] * correction[channel]);
                }
                _ => {}
            }
        }
        let (rows, columns, orientation) = size(&line(reader)?)?;
        Ok(Header { rows, columns, orientation, divisors })
    }
}

/// A line of the header, without its end.
fn line(reader: &mut impl BufRead) -> ImageResult<String> {
    let mut line = Vec::new();
    reader.read_until(b'\n', &mut line)?;
    match line.pop() {
        Some(b'\n') => Ok(String::from_utf8_lossy(&line).trim_end().into()),
        _ => Err(io::Error::from(io::ErrorKind::UnexpectedEof).into()),
    }
}

/// The positive numbers that a line of the header gives.
fn factors<const N: usize>(name: &str, value: &str) -> ImageResult<[f64; N]> {
    let is_factor = |factor: &f64| factor.is_finite() && *factor > 0.0;
    let factors: Option<Vec<f64>> =
        value.split_ascii_whitespace().map(|word| word.parse().ok().filter(is_factor)).collect();
    let factors = factors.and_then(|factors| factors.try_into().ok());
    factors.ok_or_else(|| damaged(format!("its {} is \"{}\"", name.trim(), value.trim())))
}

/// The number of stored rows, of pixels in each, and their order, from a line such as "-Y 480 +X
/// 640".
fn size(line: &str) -> ImageResult<(u32, u32, Orientation)> {
    let words: Vec<_> = line.split_ascii_whitespace().collect();
    let no_size = || damaged(format!("its size is \"{line}\""));
    let &[rows_along, rows, columns_along, columns] = words.as_slice() else { return Err(no_size()) };
    // The order as a number of Exif's, which says at which sides of the picture the first stored
    // row and the first stored column are.
    let order = match (rows_along, columns_along) {
        ("-Y", "+X") => 1,
        ("-Y", "-X") => 2,
        ("+Y", "-X") => 3,
        ("+Y", "+X") => 4,
        ("+X", "-Y") => 5,
        ("-X", "-Y") => 6,
        ("-X", "+Y") => 7,
        ("+X", "+Y") => 8,
        _ => return Err(no_size()),
    };
    let side = |text: &str| text.parse().ok().filter(|side| *side <= LONGEST_SIDE).ok_or_else(no_size);
    Ok((side(rows)?, side(columns)?, Orientation::from_exif(order).ok_or_else(no_size)?))
}

fn other_format(format: &str) -> ImageError {
    let what = match format {
        "32-bit_rle_xyze" => "its colours are XYZ and not RGB".into(),
        other => format!("its format is \"{other}\""),
    };
    let kind = UnsupportedErrorKind::GenericFeature(what);
    ImageError::Unsupported(UnsupportedError::from_format_and_kind(ImageFormatHint::Exact(ImageFormat::Hdr), kind))
}

fn damaged(what: String) -> ImageError {
    ImageError::Decoding(DecodingError::new(ImageFormatHint::Exact(ImageFormat::Hdr), what))
}
