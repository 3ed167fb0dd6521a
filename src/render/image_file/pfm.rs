//! PFM: floats as they are, the rows from the bottom.

use image::error::{DecodingError, ImageFormatHint};
use image::{ColorType, ImageDecoder, ImageError, ImageResult};
use std::io::{self, BufRead, Read};

/// Decodes `PF` (colour) or `Pf` (grey), width, height, a scale whose sign gives the byte order (negative is little
/// endian), one white space, and then the rows from the bottom.
pub(super) struct PfmDecoder<R> {
    reader: R,
    width: u32,
    height: u32,
    channels: usize,
    value: fn([u8; 4]) -> f32,
}

impl<R: BufRead> PfmDecoder<R> {
    pub(super) fn new(mut reader: R) -> ImageResult<Self> {
        let channels = if token(&mut reader)? == "PF" { 3 } else { 1 };
        let mut side = |name| {
            let text = token(&mut reader)?;
            text.parse::<u32>().map_err(|_| damaged(format!("its {name} is \"{}\"", text.escape_default())))
        };
        let (width, height) = (side("width")?, side("height")?);
        let text = token(&mut reader)?;
        let scale = text.parse::<f32>().ok().filter(|scale| scale.is_finite() && *scale != 0.0);
        let scale = scale.ok_or_else(|| damaged(format!("its scale is \"{}\"", text.escape_default())))?;
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
                // Grey has one value, which cycles through the channels.
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

/// The next word of the header, after which its one white space is consumed.
fn token(reader: &mut impl Read) -> io::Result<String> {
    // Longer than any sensible number, and short enough for a message.
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
