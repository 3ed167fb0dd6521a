//! A picture by several ranks: each traces and encodes bands as it becomes free, and rank 0 writes them in order.

use std::io;
use std::ops::Range;
use std::time::{Duration, Instant};

use super::image_file::{Extent, PartEncoder};
use super::to_file::Bands;
use super::{Counted, Format, Frame, ImageWriter, RenderError, Stats};
use crate::ranks::{Pace, Ranks};

/// Renders `rows` into an image file of a format, as [`render`](super::render()) does; rank 0 has the file, and tells
/// `done` of the rows that are written. The times are those of the slowest rank.
///
/// # Errors
/// As [`render`](super::render()), on the rank where it happens and on rank 0.
pub fn render_by_ranks(
    ranks: &Ranks,
    frame: &Frame<'_>,
    (format, rows): (Format, Range<u32>),
    mut image: Option<&mut ImageWriter>,
    done: &dyn Fn(u32),
) -> Result<Stats, RenderError> {
    let extent = Extent::new((frame.camera.width(), frame.camera.height()), rows.clone());
    let mut bands = Bands::new(frame, PartEncoder::new(format, &extent).into())?;
    // Ranks may have more threads or fewer; bands are the same for all.
    let height = ranks.broadcast(bands.height(rows.len() as u32, ranks.count()).to_le_bytes().into());
    let height = height.first_chunk().map_or(1, |bytes| u32::from_le_bytes(*bytes));
    let band = |index: u64| {
        let start = rows.start + index as u32 * height;
        start..rows.end.min(start.saturating_add(height))
    };
    let mut stats = Stats::of(frame);
    let place = format!("rank {} on {}", ranks.rank(), Ranks::host());
    let work = |index| {
        stats.trace(&mut bands, band(index), &|_| ()).map_err(|error| format!("{place}: {error}"))?;
        let clock = Instant::now();
        let mut encoded = Vec::new();
        bands
            .encode(|rows, part| {
                let part = part?;
                // With room for the rest of its message.
                encoded.reserve(part.len() + 64);
                encoded.extend_from_slice(&rows.to_le_bytes());
                encoded.extend_from_slice(&(part.len() as u64).to_le_bytes());
                encoded.extend_from_slice(&part);
                Ok(())
            })
            .map_err(|error: io::Error| format!("{place}: {error}"))?;
        stats.encode += clock.elapsed();
        Ok(encoded)
    };
    let mut write = Duration::ZERO;
    let take = |index, encoded: Result<Vec<u8>, String>| {
        let Some(image) = &mut image else { return Ok(()) };
        let encoded = encoded.map_err(RenderError::Rank)?;
        let before = image.writing();
        let mut rest = &encoded[..];
        while let Some((rows, after)) = rest.split_first_chunk() {
            let (length, after) = after.split_at(size_of::<u64>());
            let (part, after) =
                after.split_at(length.first_chunk().map_or(0, |length| u64::from_le_bytes(*length)) as usize);
            image.append(u32::from_le_bytes(*rows), Ok(part.into()))?;
            rest = after;
        }
        write += image.writing() - before;
        done(band(index).len() as u32);
        Ok(())
    };
    let count = rows.len().div_ceil(height as usize) as u64;
    let result = ranks.share((count, Pace::BANDS), work, take);
    // A rank that failed has told rank 0; only the times of the others remain to be collected.
    let Counted { rays, hits } = stats.counted.unwrap_or_default();
    let numbers =
        [stats.trace.as_nanos() as u64, stats.encode.as_nanos() as u64, stats.trace_cycles.unwrap_or(0), rays, hits];
    stats.counted = stats.counted.map(|_| Counted::default());
    for of_rank in ranks.gather(numbers.map(u64::to_le_bytes).concat()) {
        let number = |at: usize| of_rank[at..].first_chunk().map_or(0, |number| u64::from_le_bytes(*number));
        stats.trace = stats.trace.max(Duration::from_nanos(number(0)));
        stats.encode = stats.encode.max(Duration::from_nanos(number(8)));
        stats.trace_cycles = stats.trace_cycles.map(|cycles| cycles.max(number(16)));
        stats.counted = stats.counted.map(|sum| sum + Counted { rays: number(24), hits: number(32) });
    }
    stats.write = write;
    result.map(|()| stats)
}
