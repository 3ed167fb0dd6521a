//! From a scene to rows of pixels: the engines, the frame that drives them, and image files.

mod aos;
mod development;
mod edges;
mod engine;
mod film;
mod frame;
mod hits;
#[cfg(feature = "files")]
mod image_file;
mod lit;
#[cfg(feature = "files")]
mod output;
#[cfg(feature = "files")]
mod picture;
mod plan;
pub mod reference;
mod rust;
mod tiles;
#[cfg(feature = "files")]
mod to_file;

pub use development::{Developed, Development};
pub use engine::{Engine, EngineError, Precision, Purpose};
pub use film::{Colour, Film, FilmMut, NoMemory, Pixel, PixelFormat, WrongSize, level};
pub use frame::{Frame, RenderError, Settings};
pub use hits::{Counted, Distance, Found, Hit};
#[cfg(feature = "files")]
pub use image_file::{Format, ImageError, ImageFile, ImageWriter, read};
pub use lit::LitTracer;
#[cfg(all(feature = "files", not(target_os = "linux")))]
pub use output::remove_unfinished;
#[cfg(feature = "files")]
pub use output::{Existing, OutputError, OutputFile, is_standard_error, is_standard_output};
#[cfg(feature = "files")]
pub use picture::{Picture, Pixels};
pub use plan::{PacketKernelSet, Plan};
#[cfg(feature = "files")]
pub use to_file::{Stats, render};

use std::ops::Range;

use self::film::with_pixels;
use crate::kernels::Vec4;
use crate::plan::Report;

/// The message for a poisoned lock, which cannot occur in this layer.
const UNPOISONED: &str = "nothing panics while it is locked";

/// An engine prepared for one scene: writes any rows of the picture, in any order, from any thread.
pub trait Tracer: Sync {
    /// Whether the tracer computes in this format; what it writes in other formats it converts from
    /// [`PixelFormat::F32x4`]. It always computes in that one, unless it was prepared for another
    /// format alone.
    fn writes(&self, format: PixelFormat) -> bool;

    /// The number of rows that are cheapest to trace together, if they start at a multiple of it.
    fn rows_together(&self) -> u32 {
        1
    }

    /// Whether one thread finishes the whole picture before a second thread would be awake and have
    /// its memory.
    fn is_quick(&self) -> bool {
        false
    }

    /// Writes `rows` of the picture to `out`, row by row, beginning with its first pixel. Floats
    /// are linear, not clamped, and 0 in the fourth channel. Bytes are the [`level`] of the linear
    /// colour, and 255 in the fourth channel. An engine in f32 may shade bytes with estimates of
    /// roots that would be too inaccurate for floats; hits are then the same, and levels differ by
    /// at most one.
    ///
    /// # Panics
    /// If the picture has no such rows, or if `out` does not have as many pixels.
    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>);

    /// As [`counted_rows`](Self::counted_rows), in four floats that are to be developed. A ray
    /// without a hit gets the colour `background`, and pixels that are not `wanted` may be left
    /// unchanged.
    ///
    /// # Panics
    /// As `rows`; and if `background` is not black and the tracer does not support one.
    fn light(&self, rows: Range<u32>, wanted: &Wanted<'_>, background: Vec4, out: &mut [Vec4]) -> Option<Counted> {
        let _ = wanted;
        assert_eq!(background, Vec4::default(), "this tracer has no background");
        self.counted_rows(rows, FilmMut::F32x4(out))
    }

    /// The hits at the pixels of those `rows` that the picture has, row by row, found by the code
    /// that renders them. It is not made for speed.
    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>>;

    /// Counts the rays of `rows` and their hits, which takes as long as tracing them, unless the
    /// plan knows the counts.
    fn count(&self, rows: Range<u32>) -> Counted {
        let hits = self.hits(rows);
        Counted { rays: hits.len() as u64, hits: hits.into_iter().flatten().count() as u64 }
    }

    /// The report of the kept and the omitted work, if the tracer omits any. `bytes` says whether
    /// the pixels written have 8 bits.
    fn report(&self, bytes: bool) -> Option<Report> {
        let _ = bytes;
        None
    }

    /// Writes rows as [`rows`](Self::rows) does, and returns their [`count`](Self::count), or None
    /// if counting at the same time would take longer.
    fn counted_rows(&self, rows: Range<u32>, out: FilmMut<'_>) -> Option<Counted> {
        self.rows(rows, out);
        None
    }
}

/// The argument is a range of rows and one of columns. The result is the range of these rows from
/// the first to the last that has wanted pixels in these columns.
pub type Wanted<'a> = dyn Fn(Range<u32>, Range<u32>) -> Range<u32> + 'a;

/// Panics unless a picture of this size has these `rows`, and `film` is their number of pixels.
fn assert_rows(rows: &Range<u32>, [width, height]: [u32; 2], film: usize) {
    assert!(rows.end <= height, "the picture has no such rows");
    assert_eq!(film, rows.len() * width as usize, "the film must have the size of the rows");
}

/// Writes `rows` in another format, row by row, with a tracer that computes only in floats.
fn rows_by_floats(tracer: &dyn Tracer, rows: Range<u32>, [width, height]: [u32; 2], out: FilmMut<'_>) {
    assert_rows(&rows, [width, height], out.len());
    let mut floats = vec![Vec4::default(); width as usize];
    with_pixels!(FilmMut(out) = out => for (row, out) in rows.zip(out.chunks_exact_mut(width as usize)) {
        tracer.rows(row..row + 1, FilmMut::F32x4(&mut floats));
        Pixel::film(out).set(&floats);
    });
}

/// Those of `rows` that a picture of this height has.
fn existing(rows: Range<u32>, height: u32) -> Range<u32> {
    rows.start.min(height)..rows.end.min(height)
}

/// The pixels, as row and column, of those `rows` that the picture has.
fn existing_pixels(rows: Range<u32>, [width, height]: [u32; 2]) -> impl Iterator<Item = (u32, u32)> {
    existing(rows, height).flat_map(move |row| (0..width).map(move |col| (row, col)))
}

/// Whether a pixel is wanted.
fn is_wanted(wanted: &Wanted<'_>, row: u32, column: u32) -> bool {
    !wanted(row..row + 1, column..column + 1).is_empty()
}
