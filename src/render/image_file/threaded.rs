//! Writes EXR: parts are compressed independently for the library's writer, which has a thread of
//! its own.

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

/// A writer in a thread of its own that is sent the parts of a picture. If no thread can be
/// started, it writes when all parts have come.
pub(super) struct Threaded {
    /// None if the writer has ended early.
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
                // The thread receives its work from this channel.
                let _ = give.send(write);
                Box::new(|| thread.join().unwrap_or_else(|_| Err(io::Error::other("the encoder has failed"))))
            }
        };
        Threaded { parts: Some(parts), rest: Some(rest) }
    }

    /// Tells the writer that no parts follow, and returns its result.
    fn end(&mut self) -> io::Result<()> {
        self.parts = None;
        self.rest.take().map_or(Ok(()), |rest| rest())
    }
}

impl Join for Threaded {
    fn append(&mut self, part: Cow<'_, [u8]>) -> io::Result<()> {
        match &self.parts {
            Some(parts) if parts.send(part.into_owned()).is_ok() => Ok(()),
            // The writer has ended early; its result is the reason.
            _ => self.end().and(Err(io::ErrorKind::BrokenPipe.into())),
        }
    }

    fn finish(mut self: Box<Self>) -> io::Result<()> {
        self.end()
    }
}

impl Drop for Threaded {
    fn drop(&mut self) {
        // Waits for the thread, so that the file is not written to after this value is dropped.
        let _ = self.end();
    }
}

/// EXR in scan lines, compressed 16 at a time, which is usual.
pub(super) struct ExrParts {
    header: Header,
}

impl ExrParts {
    pub(super) fn new(extent: &Extent) -> Self {
        let (width, height) = (extent.width as usize, extent.height() as usize);
        // The channels must be in alphabetical order.
        let channels = ["B", "G", "R"].map(|name| ChannelDescription::named(name, SampleType::F32));
        let header = Header::new(Text::default(), (width, height), SmallVec::from_iter(channels));
        let whole = IntegerBounds::from_dimensions(Vec2(width, extent.whole as usize));
        let header = header
            .with_encoding(Method::ZIP16, BlockDescription::ScanLines, LineOrder::Increasing)
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
        // Similar bytes are brought together: first the first and third bytes of all samples, then
        // the second and fourth ones. Then each byte becomes its difference from the byte before
        // it.
        let halves = samples.iter().map(|[a, _, c, _]| [*a, *c]).chain(samples.iter().map(|[_, b, _, d]| [*b, *d]));
        let mut bytes = halves.collect::<Vec<_>>().into_flattened();
        let mut before = 128_u8;
        for byte in &mut bytes {
            (*byte, before) = (byte.wrapping_sub(before).wrapping_add(128), *byte);
        }
        // This compression is two to three times as fast as the library's own, whose files are 0.4
        // % to 2.4 % smaller.
        let packed = deflated(&bytes, 2)?;
        Ok(if packed.len() < bytes.len() { packed } else { samples.into_flattened() }.into())
    }
}

/// Compresses bytes to a zlib stream.
fn deflated(bytes: &[u8], level: u32) -> io::Result<Vec<u8>> {
    let mut stream = ZlibEncoder::new(Vec::new(), Compression::new(level));
    stream.write_all(bytes)?;
    stream.finish()
}

impl Threaded {
    /// Begins an EXR whose data window is the given rows, and whose display window is the whole
    /// picture.
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
