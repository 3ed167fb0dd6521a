//! Reads OpenEXR with its library, block by block, after checking the header.

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

/// Decodes the largest level of the first part that has R, G and B, or Y alone, and A if it is
/// present. The picture is what the display window shows.
pub(super) struct ExrDecoder<R> {
    reader: Reader<R>,
    /// The index of the part that is decoded.
    part: usize,
    /// The most bytes of pixels that the file can hold.
    most: u64,
}

impl<R: BufRead + Seek> ExrDecoder<R> {
    /// Reads the headers of a file of `length` bytes.
    pub(super) fn new(reader: R, length: u64) -> ImageResult<Self> {
        let reader = exr::block::read(reader, false).map_err(explained)?;
        let part = reader.headers().iter().position(|part| shown(part).is_some());
        let part = part.ok_or_else(|| unsupported(&channels(reader.headers())))?;
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

    /// The width and height of the data window, whose pixels the file has.
    pub(super) fn stored(&self) -> (u32, u32) {
        let Vec2(width, height) = self.header().layer_size;
        (width as u32, height as u32)
    }

    /// How many pixels a file of this length and compression can hold at most.
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

/// The indices of the channels for red, green, blue and, if present, alpha. A grey channel stands
/// for all three colours, unless it is the luminance of colours whose chroma is in other channels.
fn shown(header: &Header) -> Option<[Option<usize>; 4]> {
    let find = |name| header.channels.find_index_of_channel(&Text::from(name));
    let colours = ["R", "G", "B"].map(find);
    let grey = find("Y").filter(|_| find("RY").is_none() && find("BY").is_none());
    let [red, green, blue] = if colours.iter().all(Option::is_some) { colours } else { [grey; 3] };
    (!header.deep && red.is_some()).then_some([red, green, blue, find("A")])
}

/// Why no part of the file can be shown; the text names its channels.
fn channels(parts: &[Header]) -> String {
    if parts.iter().all(|part| part.deep) {
        return "its data are deep".into();
    }
    let names = parts.iter().flat_map(|part| &part.channels.list).map(|channel| channel.name.to_string());
    let names: Vec<_> = names.collect();
    format!("it has the channels {}, and what is shown here is R, G and B, or Y without RY and BY", names.join(", "))
}

/// Copies a block of pixels from the data window to its position in the display window.
fn show(header: &Header, block: &UncompressedBlock, out: &mut [u8]) {
    let Some(channels) = shown(header) else { return };
    let count = channels.iter().flatten().count();
    let window = header.shared_attributes.display_window;
    let Vec2(left, top) = header.own_attributes.layer_position - window.position;
    let Vec2(width, height) = window.size;
    for line in block.lines(&header.channels) {
        let samples = header.channels.list[line.location.channel].sample_type;
        let Vec2(x, y) = line.location.position;
        let row = y as i64 + i64::from(top);
        if !(0..height as i64).contains(&row) {
            continue;
        }
        let targets = (0..4).filter(|target| channels[*target] == Some(line.location.channel));
        let columns = x as i64 + i64::from(left)..;
        for (column, sample) in columns.zip(line.value.chunks_exact(samples.bytes_per_sample())) {
            if (0..width as i64).contains(&column) {
                let pixel = row as usize * width + column as usize;
                let bytes = value(samples, sample).to_ne_bytes();
                targets.clone().for_each(|to| out[4 * (pixel * count + to)..][..4].copy_from_slice(&bytes));
            }
        }
    }
}

/// Reads a sample whose bytes are in this machine's order.
fn value(samples: SampleType, bytes: &[u8]) -> f32 {
    match (samples, bytes) {
        (SampleType::F16, &[a, b]) => f16::from_ne_bytes([a, b]).to_f32(),
        (SampleType::U32, &[a, b, c, d]) => u32::from_ne_bytes([a, b, c, d]) as f32,
        (_, &[a, b, c, d]) => f32::from_ne_bytes([a, b, c, d]),
        _ => unreachable!("samples have two bytes or four"),
    }
}

/// How many bytes one byte can stand for at most, in compressions that can be undone safely.
fn expansion(compression: Compression) -> ImageResult<u64> {
    Ok(match compression {
        Compression::Uncompressed => 1,
        // Two bytes can repeat one byte up to 128 times.
        Compression::RLE => 64,
        Compression::ZIP1 | Compression::ZIP16 => DEFLATE_EXPANSION,
        // Nine bits can repeat two bytes up to 255 times. The wavelet transform of a smooth picture
        // leaves enough zeros for that.
        Compression::PIZ => 512,
        // Deflate stores only three of four bytes.
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
