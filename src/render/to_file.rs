//! A whole picture into an image file: an engine driven over it band by band.

use std::time::{Duration, Instant};

use super::{Film, Frame, ImageWriter, PixelFormat, RenderError};
use crate::measure::Cycles;

/// A band is as many whole rows as fit in this for each thread, and at least one: little enough that its pixels are still in a
/// core's second level when they are encoded or written and when the next band takes their place, and enough that waking
/// the threads for each does not count.
const BAND_BYTES: usize = 512 << 10;

/// Where the time of a picture went.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stats {
    /// Tracing alone, into memory that was touched before.
    pub trace: Duration,
    /// Tracing alone, in cycles of the time-stamp counter, where there is one.
    pub trace_cycles: Option<u64>,
    /// Making of four floats what the file has, where the engine does not, and encoding the file.
    pub encode: Duration,
    /// Handing bytes to the operating system.
    pub write: Duration,
}

/// Renders the whole picture into an image file, band by band; `done` hears of every few rows that are traced.
pub fn render(frame: &Frame<'_>, image: &mut ImageWriter, done: &(dyn Fn(u32) + Sync)) -> Result<Stats, RenderError> {
    let camera = frame.camera;
    let own = image.format().pixels();
    let format = if frame.tracer.writes(own) { own } else { PixelFormat::F32x4 };
    let band_rows = (BAND_BYTES * frame.threads() / (camera.width() as usize * format.bytes())).max(1);
    let band_rows =
        band_rows.next_multiple_of(frame.tracer.rows_together() as usize).min(camera.height() as usize) as u32;
    let mut film = frame.film(format, band_rows)?;
    let mut converted = if format == own { None } else { Some(frame.film(own, band_rows)?) };
    let mut stats = Stats { trace_cycles: Cycles::available().then_some(0), ..Stats::default() };
    for start in (0..camera.height()).step_by(band_rows as usize) {
        let rows = start..camera.height().min(start + band_rows);
        let pixels = camera.width() as usize * rows.len();

        let clock = (Instant::now(), Cycles::start());
        frame.trace_band(rows, film.as_mut().part(0..pixels), done);
        stats.trace_cycles = stats.trace_cycles.map(|sum| sum + clock.1.stop());
        stats.trace += clock.0.elapsed();

        let clock = (Instant::now(), image.writing());
        if let (Some(converted), Film::F32x4(floats)) = (&mut converted, &film) {
            converted.as_mut().part(0..pixels).set(&floats[..pixels]);
        }
        match converted.as_ref().unwrap_or(&film) {
            Film::F32x3(film) => image.write_f32x3(&film[..pixels])?,
            Film::Rgb8(film) => image.write_rgb8(&film[..pixels])?,
            Film::F32x4(_) | Film::Rgba8(_) => unreachable!("no file has them"),
        }
        let write = image.writing() - clock.1;
        stats.write += write;
        stats.encode += clock.0.elapsed().saturating_sub(write);
    }
    Ok(stats)
}
