//! Reads QOI with three or four channels; in either case codes may set alpha.

use image::error::{DecodingError, ImageFormatHint};
use image::{ColorType, ImageDecoder, ImageError, ImageFormat, ImageResult};
use qoi::{Channels, Decoder};
use std::io::{Chain, Cursor, Read};

const HEADER_BYTES: usize = 14;
/// The offset of the header's byte that gives the number of channels.
const CHANNELS_AT: usize = 12;

/// Always decodes with alpha. The number of channels in the header only says which are to be shown:
/// codes may set alpha in a picture of three channels too, and later codes depend on it.
pub(super) struct QoiFile<R> {
    decoder: Decoder<Chain<Cursor<[u8; HEADER_BYTES]>, R>>,
    channels: Channels,
}

impl<R: Read> QoiFile<R> {
    pub(super) fn new(mut reader: R) -> ImageResult<Self> {
        let mut header = [0; HEADER_BYTES];
        reader.read_exact(&mut header)?;
        let channels = Decoder::new(&header).map_err(explained)?.header().channels;
        header[CHANNELS_AT] = Channels::Rgba.into();
        Ok(QoiFile { decoder: Decoder::from_stream(Cursor::new(header).chain(reader)).map_err(explained)?, channels })
    }
}

impl<R: Read> ImageDecoder for QoiFile<R> {
    fn dimensions(&self) -> (u32, u32) {
        (self.decoder.header().width, self.decoder.header().height)
    }

    fn color_type(&self) -> ColorType {
        ColorType::Rgba8
    }

    fn read_image(mut self, out: &mut [u8]) -> ImageResult<()> {
        self.decoder.decode_to_buf(&mut *out).map_err(explained)?;
        if self.channels.is_rgb() {
            out.as_chunks_mut::<4>().0.iter_mut().for_each(|[.., alpha]| *alpha = 255);
        }
        Ok(())
    }

    fn read_image_boxed(self: Box<Self>, out: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(out)
    }
}

fn explained(error: qoi::Error) -> ImageError {
    match error {
        qoi::Error::IoError(error) => ImageError::IoError(error),
        error => ImageError::Decoding(DecodingError::new(ImageFormatHint::Exact(ImageFormat::Qoi), error)),
    }
}
