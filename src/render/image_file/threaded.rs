//! Encoders of libraries that ask for their rows: each runs in a thread of its own, and is sent block after block.

use super::encode::Encode;
use crate::render::output::Sink;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use std::io::{self, Write};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::{self, JoinHandle};
use tiff::encoder::{DirectoryEncoder, TiffEncoder, TiffKind};
use tiff::tags::{CompressionMethod, PhotometricInterpretation, Predictor, Tag};
use tiff::{TiffError, TiffResult};

/// A block of this many bytes at least, where there are so many rows.
const BLOCK_BYTES: usize = 1 << 20;

/// An encoder in a thread, which takes the samples of whole rows in blocks of so many rows, and of the rest in the last.
pub(super) struct Threaded<T> {
    /// Samples that do not fill a block yet.
    block: Vec<T>,
    samples_per_block: usize,
    /// None once the thread has ended early.
    blocks: Option<SyncSender<Vec<T>>>,
    thread: Option<JoinHandle<io::Result<()>>>,
}

impl<T: Copy + Send + 'static> Threaded<T> {
    fn new(
        samples_per_block: usize,
        encode: impl FnOnce(Receiver<Vec<T>>) -> io::Result<()> + Send + 'static,
    ) -> io::Result<Self> {
        let (blocks, receiver) = sync_channel(1);
        let thread = thread::Builder::new().name("encoder".into()).spawn(move || encode(receiver))?;
        Ok(Threaded { block: Vec::new(), samples_per_block, blocks: Some(blocks), thread: Some(thread) })
    }

    fn append(&mut self, mut samples: &[T]) -> io::Result<()> {
        while !samples.is_empty() {
            let (now, later) = samples.split_at(samples.len().min(self.samples_per_block - self.block.len()));
            self.block.extend_from_slice(now);
            samples = later;
            if self.block.len() == self.samples_per_block {
                self.send()?;
            }
        }
        Ok(())
    }

    fn send(&mut self) -> io::Result<()> {
        let next = Vec::with_capacity(self.samples_per_block);
        let block = std::mem::replace(&mut self.block, next);
        match &self.blocks {
            Some(blocks) if blocks.send(block).is_ok() => Ok(()),
            // It has stopped listening, and knows why.
            _ => self.end().and(Err(io::ErrorKind::BrokenPipe.into())),
        }
    }

    /// Lets the thread come to its end, and says how it ended.
    fn end(&mut self) -> io::Result<()> {
        self.blocks = None;
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(result)) => result,
            Some(Err(_)) => Err(io::Error::other("the encoder has failed")),
            None => Ok(()),
        }
    }

    fn complete(&mut self) -> io::Result<()> {
        if !self.block.is_empty() {
            self.send()?;
        }
        self.end()
    }
}

impl<T> Drop for Threaded<T> {
    fn drop(&mut self) {
        self.blocks = None;
        // The file must not be written to once its writer is gone.
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

impl Encode for Threaded<u8> {
    fn rgb8(&mut self, rows: &[[u8; 3]]) -> io::Result<()> {
        self.append(rows.as_flattened())
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.complete()
    }
}

impl Encode for Threaded<f32> {
    fn f32x3(&mut self, rows: &[[f32; 3]]) -> io::Result<()> {
        self.append(rows.as_flattened())
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.complete()
    }
}

/// TIFF in strips of about a megabyte.
pub(super) fn tiff(sink: Sink, width: u32, height: u32) -> io::Result<Threaded<u8>> {
    let row = 3 * width as usize;
    let rows = (BLOCK_BYTES.div_ceil(row)).min(height as usize);
    // Compression could make it smaller, but not for sure; the index and what incompressible strips grow by is added.
    let big = u64::from(height) * (row as u64 + 64) > u64::from(u32::MAX) - (1 << 20);
    Threaded::new(row * rows, move |blocks| {
        let result = if big {
            TiffEncoder::new_big(sink).and_then(|encoder| write_tiff(encoder, (width, height), rows as u32, blocks))
        } else {
            TiffEncoder::new(sink).and_then(|encoder| write_tiff(encoder, (width, height), rows as u32, blocks))
        };
        result.map_err(|error| match error {
            TiffError::IoError(error) => error,
            error => io::Error::other(error),
        })
    })
}

/// By tags and data: the library compresses what it is given whole, and not what it is given strip by strip.
fn write_tiff<K: TiffKind>(
    mut encoder: TiffEncoder<Sink, K>,
    (width, height): (u32, u32),
    rows: u32,
    blocks: Receiver<Vec<u8>>,
) -> TiffResult<()> {
    let mut directory = encoder.image_directory()?;
    let (mut offsets, mut lengths) = (Vec::new(), Vec::new());
    for _ in 0..height.div_ceil(rows) {
        let mut block = blocks.recv().map_err(|_| io::Error::from(io::ErrorKind::UnexpectedEof))?;
        // The predictor: each sample less that of the pixel to its left.
        for row in block.chunks_exact_mut(3 * width as usize) {
            for at in (3..row.len()).rev() {
                row[at] = row[at].wrapping_sub(row[at - 3]);
            }
        }
        let mut strip = ZlibEncoder::new(Vec::new(), Compression::fast());
        strip.write_all(&block)?;
        let strip = strip.finish()?;
        offsets.push(directory.write_data(&strip[..])?);
        lengths.push(strip.len() as u64);
    }
    directory.write_tag(Tag::ImageWidth, width)?;
    directory.write_tag(Tag::ImageLength, height)?;
    directory.write_tag(Tag::BitsPerSample, &[8_u16; 3][..])?;
    directory.write_tag(Tag::Compression, CompressionMethod::Deflate.to_u16())?;
    directory.write_tag(Tag::Predictor, Predictor::Horizontal.to_u16())?;
    directory.write_tag(Tag::PhotometricInterpretation, PhotometricInterpretation::RGB.to_u16())?;
    directory.write_tag(Tag::SamplesPerPixel, 3_u16)?;
    directory.write_tag(Tag::RowsPerStrip, rows)?;
    write_offsets(&mut directory, Tag::StripOffsets, &offsets)?;
    write_offsets(&mut directory, Tag::StripByteCounts, &lengths)?;
    directory.finish()
}

/// Places in the file, in as many bytes as this kind of file has for one.
fn write_offsets<K: TiffKind>(
    directory: &mut DirectoryEncoder<'_, Sink, K>,
    tag: Tag,
    values: &[u64],
) -> TiffResult<()> {
    let values: Vec<K::OffsetType> = values.iter().map(|&value| K::convert_offset(value)).collect::<TiffResult<_>>()?;
    directory.write_tag(tag, K::convert_slice(&values))
}

/// EXR in scan lines, compressed 16 by 16 as is its custom, or one by one where they are long.
pub(super) fn exr(sink: Sink, width: u32, height: u32) -> io::Result<Threaded<f32>> {
    use exr::block::writer::ChunksWriter;
    use exr::block::{UncompressedBlock, enumerate_ordered_header_block_indices, write};
    use exr::error::Error;
    use exr::meta::attribute::{ChannelDescription, LineOrder, SampleType, Text};
    use exr::meta::{BlockDescription, header::Header};
    use exr::prelude::{Compression as Method, SmallVec};

    let (width, height) = (width as usize, height as usize);
    let (compression, rows) = if width <= 1 << 16 { (Method::ZIP16, 16) } else { (Method::ZIP1, 1) };
    Threaded::new(3 * width * rows, move |blocks| {
        // Channels stand in the order of the alphabet.
        let channels = ["B", "G", "R"].map(|name| ChannelDescription::named(name, SampleType::F32));
        let header = Header::new(Text::default(), (width, height), SmallVec::from_iter(channels));
        let header = header.with_encoding(compression, BlockDescription::ScanLines, LineOrder::Increasing);
        let written = write(sink, SmallVec::from_iter([header]), true, |meta, chunks| {
            let mut compressor = chunks.sequential_blocks_compressor(&meta);
            for (index, place) in enumerate_ordered_header_block_indices(&meta.headers) {
                let samples = blocks.recv().map_err(|_| Error::Aborted)?;
                let block = UncompressedBlock::from_lines(&meta.headers[0].channels, place, |line| {
                    let row = line.location.position.y() - place.pixel_position.y();
                    let pixels: &[[f32; 3]] = samples[3 * width * row..].as_chunks().0;
                    for (bytes, pixel) in line.value.as_chunks_mut().0.iter_mut().zip(pixels) {
                        *bytes = pixel[2 - line.location.channel].to_ne_bytes();
                    }
                });
                compressor.compress_block(index, block)?;
            }
            Ok(())
        });
        written.map_err(|error| match error {
            Error::Io(error) => error,
            error => io::Error::other(error.to_string()),
        })
    })
}
