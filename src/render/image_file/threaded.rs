//! TIFF and EXR: parts compressed independently, and the libraries' writers, which take them in threads of their own.

use super::Extent;
use super::parts::{Encode, Join};
use crate::kernels::sys::new_thread;
use crate::render::output::Sink;
use exr::block::chunk::{Chunk, CompressedBlock, CompressedScanLineBlock};
use exr::block::enumerate_ordered_header_block_indices;
use exr::block::writer::ChunksWriter;
use exr::error::Error;
use exr::meta::attribute::{ChannelDescription, LineOrder, SampleType, Text};
use exr::meta::{BlockDescription, header::Header};
use exr::prelude::{Compression as Method, IntegerBounds, SmallVec, Vec2};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use std::borrow::Cow;
use std::io::{self, Write};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use tiff::encoder::{DirectoryEncoder, TiffEncoder, TiffKind};
use tiff::tags::{CompressionMethod, PhotometricInterpretation, Predictor, Tag};
use tiff::{TiffError, TiffResult};

/// The least bytes of a strip but the last.
const STRIP_BYTES: usize = 1 << 20;

/// A writer in a thread, which takes the parts of a picture; where none can be started it writes when all are there.
pub(super) struct Threaded {
    /// None once the writer has ended early.
    parts: Option<SyncSender<Vec<u8>>>,
    rest: Option<Box<dyn FnOnce() -> io::Result<()> + Send>>,
}

impl Threaded {
    fn new(count: usize, write: impl FnOnce(Receiver<Vec<u8>>) -> io::Result<()> + Send + 'static) -> Self {
        let (give, take) = sync_channel(1);
        let work = move || take.recv().map_or(Ok(()), |write: Box<dyn FnOnce() -> _ + Send>| write());
        let thread = new_thread().and_then(|thread| thread.name("writer".into()).spawn(work));
        let (parts, receiver) = sync_channel(if thread.is_ok() { 1 } else { count });
        let write = Box::new(move || write(receiver));
        let rest: Box<dyn FnOnce() -> _ + Send> = match thread {
            Err(_) => write,
            Ok(thread) => {
                // It waits for this.
                let _ = give.send(write);
                Box::new(|| thread.join().unwrap_or_else(|_| Err(io::Error::other("the encoder has failed"))))
            }
        };
        Threaded { parts: Some(parts), rest: Some(rest) }
    }

    /// Lets the writer finish, and returns its result.
    fn end(&mut self) -> io::Result<()> {
        self.parts = None;
        self.rest.take().map_or(Ok(()), |rest| rest())
    }
}

impl Join for Threaded {
    fn append(&mut self, part: Cow<'_, [u8]>) -> io::Result<()> {
        match &self.parts {
            Some(parts) if parts.send(part.into_owned()).is_ok() => Ok(()),
            // It has stopped listening, and knows the reason.
            _ => self.end().and(Err(io::ErrorKind::BrokenPipe.into())),
        }
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.end()
    }
}

impl Drop for Threaded {
    fn drop(&mut self) {
        // The file must not be written to after its writer is gone.
        let _ = self.end();
    }
}

/// TIFF in strips of about a megabyte, each compressed independently.
pub(super) struct TiffParts {
    width: usize,
    rows: u32,
}

impl TiffParts {
    pub(super) fn new(extent: &Extent) -> Self {
        let width = extent.width as usize;
        // A power of two fits rows of tiles, which would be traced twice if cut.
        let rows = STRIP_BYTES.div_ceil(3 * width).next_power_of_two();
        TiffParts { width, rows: rows.min(extent.height() as usize) as u32 }
    }
}

impl Encode for TiffParts {
    fn part_rows(&self) -> Option<u32> {
        Some(self.rows)
    }

    fn rgb8<'a>(&self, rows: &'a [[u8; 3]]) -> io::Result<Cow<'a, [u8]>> {
        let mut block = rows.as_flattened().to_vec();
        // The predictor: each sample minus that of the pixel to its left.
        for row in block.chunks_exact_mut(3 * self.width) {
            for at in (3..row.len()).rev() {
                row[at] = row[at].wrapping_sub(row[at - 3]);
            }
        }
        Ok(deflated(&block, 1)?.into())
    }
}

impl Threaded {
    /// Begins a TIFF.
    pub(super) fn tiff(sink: Sink, extent: &Extent) -> Self {
        let (size, rows) = ((extent.width, extent.height()), TiffParts::new(extent).rows);
        // Compression could make it smaller, but not certainly; index and growth of incompressible strips are added.
        let big = u64::from(size.1) * (3 * u64::from(size.0) + 64) > u64::from(u32::MAX) - (1 << 20);
        Threaded::new(size.1.div_ceil(rows) as usize, move |strips| {
            let result = if big {
                TiffEncoder::new_big(sink).and_then(|encoder| write_tiff(encoder, size, rows, strips))
            } else {
                TiffEncoder::new(sink).and_then(|encoder| write_tiff(encoder, size, rows, strips))
            };
            result.map_err(|error| match error {
                TiffError::IoError(error) => error,
                error => io::Error::other(error),
            })
        })
    }
}

/// By tags and data: the library compresses whole images, but not images given strip by strip.
fn write_tiff<K: TiffKind>(
    mut encoder: TiffEncoder<Sink, K>,
    (width, height): (u32, u32),
    rows: u32,
    strips: Receiver<Vec<u8>>,
) -> TiffResult<()> {
    let mut directory = encoder.image_directory()?;
    let (mut offsets, mut lengths) = (Vec::new(), Vec::new());
    for _ in 0..height.div_ceil(rows) {
        let strip = strips.recv().map_err(|_| io::Error::from(io::ErrorKind::UnexpectedEof))?;
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

/// Offsets in the file, in as many bytes as this kind of file uses for one.
fn write_offsets<K: TiffKind>(
    directory: &mut DirectoryEncoder<'_, Sink, K>,
    tag: Tag,
    values: &[u64],
) -> TiffResult<()> {
    let values: Vec<K::OffsetType> = values.iter().map(|&value| K::convert_offset(value)).collect::<TiffResult<_>>()?;
    directory.write_tag(tag, K::convert_slice(&values))
}

/// EXR in scan lines, compressed 16 at a time as usual, or one by one if they are long.
pub(super) struct ExrParts {
    header: Header,
}

impl ExrParts {
    pub(super) fn new(extent: &Extent) -> Self {
        let (width, height) = (extent.width as usize, extent.height() as usize);
        let method = if width <= 1 << 16 { Method::ZIP16 } else { Method::ZIP1 };
        // Channels are in alphabetical order.
        let channels = ["B", "G", "R"].map(|name| ChannelDescription::named(name, SampleType::F32));
        let header = Header::new(Text::default(), (width, height), SmallVec::from_iter(channels));
        let whole = IntegerBounds::from_dimensions(Vec2(width, extent.whole as usize));
        let header = header
            .with_encoding(method, BlockDescription::ScanLines, LineOrder::Increasing)
            .with_position(Vec2(0, extent.rows.start.cast_signed()))
            .with_display_window(whole);
        ExrParts { header }
    }
}

impl Encode for ExrParts {
    fn part_rows(&self) -> Option<u32> {
        Some(self.header.compression.scan_lines_per_block() as u32)
    }

    fn f32x3<'a>(&self, rows: &'a [[f32; 3]]) -> io::Result<Cow<'a, [u8]>> {
        let width = self.header.layer_size.width();
        let mut samples = Vec::with_capacity(3 * rows.len());
        for row in rows.chunks_exact(width) {
            for channel in [2, 1, 0] {
                samples.extend(row.iter().map(|pixel| pixel[channel].to_le_bytes()));
            }
        }
        // Similar bytes come together: first and third bytes of all samples, then the others. Each minus the previous.
        let halves = samples.iter().map(|[a, _, c, _]| [*a, *c]).chain(samples.iter().map(|[_, b, _, d]| [*b, *d]));
        let mut bytes = halves.collect::<Vec<_>>().into_flattened();
        let mut before = 128_u8;
        for byte in &mut bytes {
            (*byte, before) = (byte.wrapping_sub(before).wrapping_add(128), *byte);
        }
        // Two to three times as fast as the library's own, whose files are 0.4 to 2.4 % smaller.
        let packed = deflated(&bytes, 2)?;
        Ok(if packed.len() < bytes.len() { packed } else { samples.into_flattened() }.into())
    }
}

/// A zlib stream of the bytes.
fn deflated(bytes: &[u8], level: u32) -> io::Result<Vec<u8>> {
    let mut stream = ZlibEncoder::new(Vec::new(), Compression::new(level));
    stream.write_all(bytes)?;
    stream.finish()
}

impl Threaded {
    /// Begins an EXR, whose data window is the rows and whose display window is the whole picture.
    pub(super) fn exr(sink: Sink, extent: &Extent) -> Self {
        let header = ExrParts::new(extent).header;
        let top = header.own_attributes.layer_position.y();
        Threaded::new(header.chunk_count, move |parts| {
            let written = exr::block::write(sink, SmallVec::from_iter([header]), true, |meta, chunks| {
                for (index, place) in enumerate_ordered_header_block_indices(&meta.headers) {
                    let block = CompressedScanLineBlock {
                        y_coordinate: top + place.pixel_position.y() as i32,
                        compressed_pixels_le: parts.recv().map_err(|_| Error::Aborted)?,
                    };
                    chunks.write_chunk(
                        index,
                        Chunk { layer_index: 0, compressed_block: CompressedBlock::ScanLine(block) },
                    )?;
                }
                Ok(())
            });
            written.map_err(exr_error)
        })
    }
}

fn exr_error(error: Error) -> io::Error {
    match error {
        Error::Io(error) => error,
        error => io::Error::other(error.to_string()),
    }
}
