//! From a scene to rows of pixels: the engines, the frame that drives them, and image files.

#[cfg(rayo_asm)]
mod aos;
mod engine;
mod film;
mod frame;
mod image_file;
#[cfg(rayo_asm)]
mod packet;
pub mod reference;
mod rust;
#[cfg(rayo_asm)]
mod tiles;

pub use engine::{Engine, EngineError, Precision};
pub use film::{Film, FilmMut, PixelFormat, level};
pub use frame::{Frame, RenderError, Settings, Stats, render};
pub use image_file::{Format, ImageError, ImageWriter, read};

use std::ops::Range;

/// An engine that is ready for one scene: writes any rows of the picture, in any order, from any thread.
pub trait Tracer: Sync {
    /// The format it computes in; it writes [`PixelFormat::F32x4`] in any case.
    fn writes(&self, format: PixelFormat) -> bool;

    /// How many rows, from a multiple of it on, cost least when they are traced together.
    fn rows_together(&self) -> u32 {
        1
    }

    /// Writes `rows` to `out`, row by row from its first pixel on. Floats are linear, not clamped, and 0 in the fourth.
    /// Bytes are [`level`] of the linear colour, and 255 in the fourth; an engine in f32 may shade them by estimates that
    /// are too coarse for floats, with the same hits and at most one level away.
    ///
    /// # Panics
    /// Where `out` is not as long as the rows, or of a format that it does not write.
    fn rows(&self, rows: Range<u32>, out: FilmMut<'_>);
}
