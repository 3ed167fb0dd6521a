//! Reads PFM: rows of floats, from the bottom to the top.

use image::error::{DecodingError, ImageFormatHint, UnsupportedError, UnsupportedErrorKind};
use image::{ColorType, ImageDecoder, ImageError, ImageResult};
use std::io::{self, BufRead, Read};

/// Decodes `PF` (colour) or `Pf` (grey), width, height, a scale whose sign gives the byte order
/// (negative is little endian), one white space, and then the rows from the bottom to the top. If
/// the line `PF` ends in CR LF, then CR LF also counts as the one white space after the scale.
pub(super) struct PfmDecoder<R> {
    reader: R,
    width: u32,
    height: u32,
    channels: usize,
    value: fn([u8; 4]) -> f32,
}

impl<R: BufRead> PfmDecoder<R> {
    pub(super) fn new(mut reader: R) -> ImageResult<Self> {
        let (magic, white) = token(&mut reader)?;
        let channels = match magic.as_str() {
            "PF" => 3,
            "Pf" => 1,
            "PF4" => return Err(other_kind("it has a fourth channel (PF4)")),
            other => return Err(damaged(format!("it begins with \"{}\"", other.escape_default()))),
        };
        let has_cr_lf = white == b'\r' && reader.fill_buf()?.first() == Some(&b'\n');
        let mut side = |name| {
            let (text, _) = token(&mut reader)?;
            text.parse::<u32>().map_err(|_| damaged(format!("its {name} is \"{}\"", text.escape_default())))
        };
        let (width, height) = (side("width")?, side("height")?);
        let (text, white) = token(&mut reader)?;
        let scale = text.parse::<f32>().ok().filter(|scale| scale.is_finite() && *scale != 0.0);
        let scale = scale.ok_or_else(|| damaged(format!("its scale is \"{}\"", text.escape_default())))?;
        if has_cr_lf && white == b'\r' && reader.fill_buf()?.first() == Some(&b'\n') {
            reader.consume(1);
        }
        let value = if scale < 0.0 { f32::from_le_bytes } else { f32::from_be_bytes };
        Ok(PfmDecoder { reader, width, height, channels, value })
    }

    pub(super) fn bytes_per_pixel(&self) -> usize {
        self.channels * size_of::<f32>()
    }
}

impl<R: BufRead> ImageDecoder for PfmDecoder<R> {
    fn dimensions(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    fn color_type(&self) -> ColorType {
        ColorType::Rgb32F
    }

    fn read_image(mut self, out: &mut [u8]) -> ImageResult<()> {
        let mut row = vec![0; self.width as usize * self.bytes_per_pixel()];
        for pixels in out.chunks_exact_mut(self.width as usize * size_of::<[f32; 3]>()).rev() {
            self.reader.read_exact(&mut row)?;
            let pixels = pixels.as_chunks_mut::<4>().0.chunks_exact_mut(3);
            for (pixel, bytes) in pixels.zip(row.chunks_exact(self.bytes_per_pixel())) {
                // The single value of a grey pixel is repeated for all channels.
                for (channel, &bytes) in pixel.iter_mut().zip(bytes.as_chunks().0.iter().cycle()) {
                    *channel = (self.value)(bytes).to_ne_bytes();
                }
            }
        }
        Ok(())
    }

    fn read_image_boxed(self: Box<Self>, out: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(out)
    }
}

fn damaged(what: String) -> ImageError {
    ImageError::Decoding(DecodingError::new(ImageFormatHint::Name("PFM".into()), what))
}

fn other_kind(what: &str) -> ImageError {
    let kind = UnsupportedErrorKind::GenericFeature(what.to_owned());
    ImageError::Unsupported(UnsupportedError::from_format_and_kind(ImageFormatHint::Name("PFM".into()), kind))
}

/// The next word of the header, and the one white space after it; both are consumed.
fn token(reader: &mut impl Read) -> io::Result<(String, u8)> {
    // The longest word that is accepted: longer than any sensible number, and short enough for a
    // message.
    const LONGEST: usize = 32;
    let mut token = String::new();
    while token.len() < LONGEST {
        let mut byte = [0];
        reader.read_exact(&mut byte)?;
        match byte[0] {
            white if white.is_ascii_whitespace() && token.is_empty() => {}
            white if white.is_ascii_whitespace() => return Ok((token, white)),
            other => token.push(other.into()),
        }
    }
    Ok((token, b' '))
}
