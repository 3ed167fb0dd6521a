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
#[cfg(feature = "files")]
#[cfg(not(target_os = "linux"))]
pub use output::remove_unfinished;
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
    /// Whether it computes in a format, as always in [`PixelFormat::F32x4`], unless it was prepared
    /// for another format alone. What it writes in other formats it converts from that.
    fn writes(&self, format: PixelFormat) -> bool;

    /// The number of rows, starting at a multiple of it, that cost least when traced together.
    fn rows_together(&self) -> u32 {
        1
    }

    /// Whether one thread finishes the whole picture before a second one would be awake and have
    /// its memory.
    fn is_quick(&self) -> bool {
        false
    }

    /// Writes `rows` of the picture to `out`, row by row from its first pixel on. Floats are
    /// linear, not clamped, and 0 in the fourth channel. Bytes are the [`level`] of the linear
    /// colour, and 255 in the fourth; an engine in f32 may shade them with estimates that are too
    /// coarse for floats, with the same hits and at most one level away.
    ///
    /// # Panics
    /// If the picture has no such rows, or `out` is not as long as they are.
    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>);

    /// As [`counted_rows`](Self::counted_rows), in four floats that are to be developed: a ray
    /// without a hit gets the light `background`, and pixels that are not `wanted` may be left
    /// unchanged.
    ///
    /// # Panics
    /// As `rows`; and if there is a background and it has none, as a tracer that is not an
    /// engine's.
    fn light(&self, rows: Range<u32>, wanted: &Wanted<'_>, background: Vec4, out: &mut [Vec4]) -> Option<Counted> {
        let _ = wanted;
        assert_eq!(background, Vec4::default(), "this tracer has no background");
        self.counted_rows(rows, FilmMut::F32x4(out))
    }

    /// The hits at those pixels of `rows` that the picture has, row by row, by the same code that
    /// renders them. This is not made for speed.
    fn hits(&self, rows: Range<u32>) -> Vec<Option<Found>>;

    /// The rays of `rows` and their hits, which takes as long as tracing unless the plan knows
    /// them.
    fn count(&self, rows: Range<u32>) -> Counted {
        let hits = self.hits(rows);
        Counted { rays: hits.len() as u64, hits: hits.into_iter().flatten().count() as u64 }
    }

    /// The kept and the omitted work, if the tracer omits any; `bytes` says whether pixels of 8
    /// bits are written.
    fn report(&self, bytes: bool) -> Option<Report> {
        let _ = bytes;
        None
    }

    /// Writes rows as [`rows`](Self::rows) does, and returns their [`count`](Self::count) if that
    /// costs almost nothing at the same time; else None.
    fn counted_rows(&self, rows: Range<u32>, out: FilmMut<'_>) -> Option<Counted> {
        self.rows(rows, out);
        None
    }
}

/// For a range of rows and one of columns, the range of these rows from the first to the last that
/// has wanted pixels in these columns.
pub type Wanted<'a> = dyn Fn(Range<u32>, Range<u32>) -> Range<u32> + 'a;

/// Panics unless a picture of this size has `rows`, and a film their number of pixels.
fn assert_rows(rows: &Range<u32>, [width, height]: [u32; 2], film: usize) {
    assert!(rows.end <= height, "the picture has no such rows");
    assert_eq!(film, rows.len() * width as usize, "the film must have the size of the rows");
}

/// Writes `rows` in another format by a tracer that computes in floats alone, row by row.
fn rows_by_floats(tracer: &dyn Tracer, rows: Range<u32>, [width, height]: [u32; 2], out: FilmMut<'_>) {
    assert_rows(&rows, [width, height], out.len());
    let mut floats = vec![Vec4::default(); width as usize];
    with_pixels!(FilmMut(out) = out => for (row, out) in rows.zip(out.chunks_exact_mut(width as usize)) {
        tracer.rows(row..row + 1, FilmMut::F32x4(&mut floats));
        Pixel::film(out).set(&floats);
    });
}

/// The part of `rows` that a picture of this height has.
fn existing(rows: Range<u32>, height: u32) -> Range<u32> {
    rows.start.min(height)..rows.end.min(height)
}

/// The pixels, as row and column, of the part of `rows` that the picture has.
fn existing_pixels(rows: Range<u32>, [width, height]: [u32; 2]) -> impl Iterator<Item = (u32, u32)> {
    existing(rows, height).flat_map(move |row| (0..width).map(move |col| (row, col)))
}

/// Whether a pixel is wanted.
fn is_wanted(wanted: &Wanted<'_>, row: u32, column: u32) -> bool {
    !wanted(row..row + 1, column..column + 1).is_empty()
}
