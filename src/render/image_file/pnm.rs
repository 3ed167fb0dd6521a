//! Reads PBM, PGM, PPM and PAM with the crate `image`, after removing comments, and scales samples.

use image::codecs::pnm::{PnmDecoder, PnmHeader, PnmSubtype};
use image::error::{DecodingError, ImageFormatHint};
use image::{ColorType, ImageDecoder, ImageError, ImageFormat, ImageResult};
use std::io::{self, Chain, Cursor, Read};

/// Decodes P1 to P7. Samples whose declared maximum is below 255 are checked and scaled to 255;
/// files with a larger maximum are refused.
pub(super) struct PnmFile<R> {
    samples: PnmDecoder<Chain<Cursor<String>, Uncommented<R>>>,
    /// The largest sample that the header allows.
    largest: u32,
    /// Whether samples have to be scaled from the header's maximum to 255.
    is_scaled: bool,
}

impl<R: Read> PnmFile<R> {
    /// Reads the header. In text formats comments may be anywhere in the file.
    pub(super) fn new(reader: R, is_text: bool) -> ImageResult<Self> {
        let reader = Uncommented { reader, is_text, in_comment: false };
        let samples = PnmDecoder::new(Cursor::new(String::new()).chain(reader))?;
        let largest = samples.header().maximal_sample();
        let is_scaled = largest < 255 && !matches!(samples.subtype(), PnmSubtype::Bitmap(_));
        if !is_scaled {
            return Ok(PnmFile { samples, largest, is_scaled });
        }
        // The library scales samples before it checks them. It is given a header with a maximum of
        // 255, so that it has nothing to scale.
        let (reader, header) = samples.into_inner();
        let (_, reader) = reader.into_inner();
        let samples = PnmDecoder::new(Cursor::new(header_of_levels(&header)).chain(reader))?;
        Ok(PnmFile { samples, largest, is_scaled })
    }
}

/// The header of the same picture with a maximum of 255.
fn header_of_levels(header: &PnmHeader) -> String {
    let (width, height) = (header.width(), header.height());
    match header.as_arbitrary() {
        Some(header) => {
            format!("P7\nWIDTH {width}\nHEIGHT {height}\nDEPTH {}\nMAXVAL 255\nENDHDR\n", header.depth)
        }
        None => {
            let [p, digit] = header.subtype().magic_constant().map(char::from);
            format!("{p}{digit} {width} {height} 255\n")
        }
    }
}

impl<R: Read> ImageDecoder for PnmFile<R> {
    fn dimensions(&self) -> (u32, u32) {
        self.samples.dimensions()
    }

    fn color_type(&self) -> ColorType {
        // For a PAM without a TUPLTYPE, the library takes every sample for a byte.
        if self.largest > 255 { ColorType::L16 } else { self.samples.color_type() }
    }

    fn read_image(self, out: &mut [u8]) -> ImageResult<()> {
        self.samples.read_image(out)?;
        if self.is_scaled {
            for sample in out {
                if u32::from(*sample) > self.largest {
                    return Err(damaged(format!("a sample is {sample}, and its largest is {}", self.largest)));
                }
                *sample = ((u32::from(*sample) * 255 + self.largest / 2) / self.largest) as u8;
            }
        }
        Ok(())
    }

    fn read_image_boxed(self: Box<Self>, out: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(out)
    }
}

fn damaged(what: String) -> ImageError {
    ImageError::Decoding(DecodingError::new(ImageFormatHint::Exact(ImageFormat::Pnm), what))
}

/// A reader that replaces comments in text formats by blanks, and leaves binary formats as they
/// are.
struct Uncommented<R> {
    reader: R,
    is_text: bool,
    in_comment: bool,
}

impl<R: Read> Read for Uncommented<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let count = self.reader.read(out)?;
        for byte in out[..count].iter_mut().filter(|_| self.is_text) {
            self.in_comment = match *byte {
                b'#' => true,
                b'\n' | b'\r' => false,
                _ => self.in_comment,
            };
            if self.in_comment {
                *byte = b' ';
            }
        }
        Ok(count)
    }
}
