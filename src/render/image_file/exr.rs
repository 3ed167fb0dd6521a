//! OpenEXR by its library, block by block: no block is read that is larger than the whole file can mean.

use super::DEFLATE_EXPANSION;
use exr::block::UncompressedBlock;
use exr::block::reader::{ChunksReader, Reader};
use exr::error::Error;
use exr::meta::header::Header;
use exr::prelude::{Compression, SampleType, Text, Vec2, f16};
use image::error::{DecodingError, ImageFormatHint, UnsupportedError, UnsupportedErrorKind};
use image::{ColorType, ImageDecoder, ImageError, ImageFormat, ImageResult};
use std::collections::HashSet;
use std::io::{BufRead, Seek};

/// Decodes the largest level of the first part that has R, G and B, and A if present, as its display window shows it.
pub(super) struct ExrDecoder<R> {
    reader: Reader<R>,
    /// The index of that part.
    part: usize,
    /// The most bytes of pixels that the file can hold.
    most: u64,
}

impl<R: BufRead + Seek> ExrDecoder<R> {
    /// Reads the headers of a file of `length` bytes.
    pub(super) fn new(reader: R, length: u64) -> ImageResult<Self> {
        let reader = exr::block::read(reader, false).map_err(explained)?;
        let part = reader.headers().iter().position(|part| shown(part).is_some());
        let part = part.ok_or_else(|| damaged("it has no channels R, G and B of single values"))?;
        let header = &reader.headers()[part];
        let most = length.saturating_mul(expansion(header.compression)?);
        let (Vec2(width, height), size) = (header.max_block_pixel_size(), header.layer_size);
        let pixels = (width.min(size.width()) as u64).saturating_mul(height.min(size.height()) as u64);
        let block = pixels.saturating_mul(header.channels.bytes_per_pixel as u64);
        if block > most {
            return Err(damaged("a block is larger than the file can hold"));
        }
        Ok(ExrDecoder { reader, part, most })
    }

    fn header(&self) -> &Header {
        &self.reader.headers()[self.part]
    }

    /// The most pixels that a file of this length and compression can hold.
    pub(super) fn most(&self) -> u64 {
        self.most / self.header().channels.bytes_per_pixel as u64
    }
}

impl<R: BufRead + Seek> ImageDecoder for ExrDecoder<R> {
    fn dimensions(&self) -> (u32, u32) {
        let Vec2(width, height) = self.header().shared_attributes.display_window.size;
        (width as u32, height as u32)
    }

    fn color_type(&self) -> ColorType {
        match shown(self.header()) {
            Some([.., Some(_)]) => ColorType::Rgba32F,
            _ => ColorType::Rgb32F,
        }
    }

    fn read_image(self, out: &mut [u8]) -> ImageResult<()> {
        let (part, mut seen) = (self.part, HashSet::new());
        let is_wanted = |layer: usize, level: Vec2<usize>| layer == part && level == Vec2(0, 0);
        let blocks = self.reader.filter_chunks(true, |_, _, block| is_wanted(block.layer, block.level));
        let read = blocks.and_then(|blocks| {
            blocks.decompress_sequential(false, |meta, block| {
                let UncompressedBlock { index, .. } = &block;
                if !is_wanted(index.layer, index.level) || !seen.insert(index.pixel_position) {
                    return Err(Error::Invalid("a block is not the one that its table says".into()));
                }
                show(&meta.headers[part], &block, out);
                Ok(())
            })
        });
        read.map_err(explained)
    }

    fn read_image_boxed(self: Box<Self>, out: &mut [u8]) -> ImageResult<()> {
        (*self).read_image(out)
    }
}

/// The channels that are red, green, blue and, if present, alpha.
fn shown(header: &Header) -> Option<[Option<usize>; 4]> {
    let channels = ["R", "G", "B", "A"].map(|name| header.channels.find_index_of_channel(&Text::from(name)));
    (!header.deep && channels[..3].iter().all(Option::is_some)).then_some(channels)
}

/// Copies a block of pixels from its place in the data window to the display window.
fn show(header: &Header, block: &UncompressedBlock, out: &mut [u8]) {
    let Some(channels) = shown(header) else { return };
    let count = channels.iter().flatten().count();
    let window = header.shared_attributes.display_window;
    let Vec2(left, top) = header.own_attributes.layer_position - window.position;
    let Vec2(width, height) = window.size;
    for line in block.lines(&header.channels) {
        let Some(to) = channels.iter().position(|channel| *channel == Some(line.location.channel)) else { continue };
        let samples = header.channels.list[line.location.channel].sample_type;
        let Vec2(x, y) = line.location.position;
        let row = y as i64 + i64::from(top);
        if !(0..height as i64).contains(&row) {
            continue;
        }
        for (column, sample) in (x as i64 + i64::from(left)..).zip(line.value.chunks_exact(samples.bytes_per_sample()))
        {
            if (0..width as i64).contains(&column) {
                let pixel = row as usize * width + column as usize;
                out[4 * (pixel * count + to)..][..4].copy_from_slice(&value(samples, sample).to_ne_bytes());
            }
        }
    }
}

/// A sample in the byte order of this machine.
fn value(samples: SampleType, bytes: &[u8]) -> f32 {
    match (samples, bytes) {
        (SampleType::F16, &[a, b]) => f16::from_ne_bytes([a, b]).to_f32(),
        (SampleType::U32, &[a, b, c, d]) => u32::from_ne_bytes([a, b, c, d]) as f32,
        (_, &[a, b, c, d]) => f32::from_ne_bytes([a, b, c, d]),
        _ => unreachable!("samples have two bytes or four"),
    }
}

/// The most bytes that one byte can stand for, of compressions that can be undone safely.
fn expansion(compression: Compression) -> ImageResult<u64> {
    Ok(match compression {
        Compression::Uncompressed => 1,
        // Two bytes repeat one up to 128 times.
        Compression::RLE => 64,
        Compression::ZIP1 | Compression::ZIP16 => DEFLATE_EXPANSION,
        // Nine bits repeat two bytes up to 255 times; the wavelets leave that many zeros of a smooth picture.
        Compression::PIZ => 512,
        // Deflate gets three of four bytes.
        Compression::PXR24 => DEFLATE_EXPANSION * 4 / 3,
        Compression::B44 | Compression::B44A => return Err(unsupported("compression by B44")),
        Compression::DWAA(_) | Compression::DWAB(_) => return Err(unsupported("compression by DWA")),
        _ => return Err(unsupported("an unknown compression")),
    })
}

fn explained(error: Error) -> ImageError {
    match error {
        Error::Io(error) => ImageError::IoError(error),
        Error::NotSupported(what) => unsupported(&what),
        Error::Invalid(what) => damaged(&what),
        Error::Aborted => damaged("its decoder gave up on it"),
    }
}

fn damaged(what: &str) -> ImageError {
    ImageError::Decoding(DecodingError::new(ImageFormatHint::Exact(ImageFormat::OpenExr), what))
}

fn unsupported(what: &str) -> ImageError {
    let kind = UnsupportedErrorKind::GenericFeature(what.into());
    ImageError::Unsupported(UnsupportedError::from_format_and_kind(ImageFormatHint::Exact(ImageFormat::OpenExr), kind))
}
