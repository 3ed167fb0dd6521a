//! Renders a whole picture into an image file, band by band.

use std::borrow::Cow;
use std::io;
use std::ops::Range;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use super::image_file::PartEncoder;
use super::{Counted, Film, Frame, ImageWriter, PixelFormat, RenderError, UNPOISONED, WrongSize};
use crate::kernels::Cycles;
use crate::kernels::StandardFloats;

/// A band has whole rows: as many as fit into this many bytes per thread, but at least one. Bands
/// are small because the first picture of a process has to wait for its film's memory: the first
/// write to a page costs as much as ten thousand pixels of a sphere.
const BAND_BYTES: usize = 128 << 10;

/// With several threads, a band has at least this many tasks per thread, so that all threads finish
/// it at about the same time.
const TASKS: usize = 3;

/// How the time of a picture was spent.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stats {
    /// The time of tracing alone, into memory that has been written to before.
    pub trace: Duration,
    /// The time of tracing alone, in cycles of the time-stamp counter, if the machine has one.
    pub trace_cycles: Option<u64>,
    /// The time of encoding, and of converting pixels if the engine does not write the file's
    /// format.
    pub encode: Duration,
    /// The time of handing bytes to the operating system.
    pub write: Duration,
    /// The number of rays and of hits, if the frame [counts](Frame::counting_hits) them.
    pub counted: Option<Counted>,
}

impl Stats {
    /// The statistics of a frame that has not taken any time yet.
    pub(super) fn of(frame: &Frame<'_>) -> Self {
        Stats {
            trace_cycles: Cycles::available().then_some(0),
            counted: frame.counts_hits.then(Counted::default),
            ..Stats::default()
        }
    }

    /// Traces a band with `bands` and adds the time that it takes. `done` is called with the number
    /// of rows of each finished task.
    pub(super) fn trace(
        &mut self,
        bands: &mut Bands<'_>,
        rows: Range<u32>,
        done: &(dyn Fn(u32) + Sync),
    ) -> Result<(), RenderError> {
        let clock = (Instant::now(), Cycles::start());
        let known = bands.trace(rows.clone(), done)?;
        self.trace_cycles = self.trace_cycles.map(|sum| sum + clock.1.stop());
        self.trace += clock.0.elapsed();
        self.counted = self.counted.map(|sum| sum + known.unwrap_or_else(|| bands.frame.count(rows)));
        Ok(())
    }
}

/// Renders the rows of an image file into it, band by band. `done` is called with the number of
/// rows of each traced task.
///
/// # Errors
/// [`RenderError::Size`] if the file is not for pictures of the frame's size, or has rows already;
/// then nothing is traced. Also [`RenderError::Memory`], [`RenderError::Image`] and
/// [`RenderError::Cancelled`].
pub fn render(frame: &Frame<'_>, image: &mut ImageWriter, done: &(dyn Fn(u32) + Sync)) -> Result<Stats, RenderError> {
    let _floats = StandardFloats::set();
    let (camera, [width, height, begun]) = (&frame.camera, image.size());
    for (what, found, expected) in [
        ("pixels in a row of the file", width, camera.width()),
        ("rows of the file's picture", height, camera.height()),
        ("rows in the file already", begun, 0),
    ] {
        if found != expected {
            return Err(WrongSize { what, found: found as usize, expected: expected as usize }.into());
        }
    }
    let mut bands = Bands::new(frame, image.encoder())?;
    let (all, height) = (image.rows(), bands.height(image.rows().len() as u32));
    let mut stats = Stats::of(frame);
    for start in all.clone().step_by(height as usize) {
        let rows = start..all.end.min(start.saturating_add(height));
        stats.trace(&mut bands, rows, done)?;
        let clock = (Instant::now(), image.writing());
        bands.encode(|rows, part| image.append(rows, part))?;
        let write = image.writing() - clock.1;
        stats.write += write;
        stats.encode += clock.0.elapsed().saturating_sub(write);
    }
    Ok(stats)
}

/// An engine, the films that it writes to, and the encoder of their pixels.
pub(super) struct Bands<'a> {
    frame: &'a Frame<'a>,
    encoder: Arc<PartEncoder>,
    format: PixelFormat,
    film: Film,
    /// A film in the file's pixel format, if the engine writes another format.
    converted: Option<Film>,
    /// The number of rows of the band that was traced last.
    rows: u32,
}

impl<'a> Bands<'a> {
    pub(super) fn new(frame: &'a Frame<'a>, encoder: Arc<PartEncoder>) -> Result<Self, RenderError> {
        let own = encoder.pixels();
        let format = if frame.tracer.writes(own) { own } else { PixelFormat::F32x4 };
        let converted = if format == own { None } else { Some(frame.film(own, 0)?) };
        Ok(Bands { frame, encoder, format, film: frame.film(format, 0)?, converted, rows: 0 })
    }

    /// The number of rows of a band in a picture of `rows` rows.
    pub(super) fn height(&self, rows: u32) -> u32 {
        let threads = self.frame.threads();
        let width = self.frame.camera.width() as usize;
        let height = (BAND_BYTES * threads / (width * self.format.bytes())).max(1);
        let height = if threads > 1 { height.max(TASKS * threads * self.frame.task_rows()) } else { height };
        let height = self.encoder.part_rows().map_or(height, |part| height.max(part as usize * threads));
        let rows_together = self.frame.rows_together();
        let together = self.encoder.part_rows().filter(|part| !rows_together.is_multiple_of(*part));
        height.next_multiple_of(together.unwrap_or(rows_together) as usize).min(rows as usize) as u32
    }

    /// Traces rows. `done` is called with the number of rows of each finished task. Returns the
    /// number of rays and hits, if requested and known.
    fn trace(&mut self, rows: Range<u32>, done: &(dyn Fn(u32) + Sync)) -> Result<Option<Counted>, RenderError> {
        let pixels = self.frame.camera.width() as usize * rows.len();
        if self.film.len() < pixels {
            self.film = self.frame.film(self.format, rows.len() as u32)?;
            if let Some(converted) = &mut self.converted {
                *converted = self.frame.film(self.encoder.pixels(), rows.len() as u32)?;
            }
        }
        self.rows = rows.len() as u32;
        let film = self.film.as_mut().part(0..pixels);
        let counted = if self.frame.counts_hits {
            self.frame.trace_counted(rows, film, done)
        } else {
            self.frame.trace_band(rows, film, done);
            None
        };
        // A band whose tracing was stopped is not part of a picture.
        if self.frame.is_cancelled() { Err(RenderError::Cancelled) } else { Ok(counted) }
    }

    /// Encodes the traced band part by part. Each thread writes its own parts when it is their
    /// turn, so that neither do their bytes move to another core's caches, nor does the memory move
    /// back for the next band.
    pub(super) fn encode<E: Send>(
        &mut self,
        take: impl FnMut(u32, io::Result<Cow<'_, [u8]>>) -> Result<(), E> + Send,
    ) -> Result<(), E> {
        let (width, threads) = (self.frame.camera.width() as usize, self.frame.threads() as u32);
        if let (Some(converted), Film::F32x4(floats)) = (&mut self.converted, &self.film) {
            let pixels = width * self.rows as usize;
            converted.as_mut().part(0..pixels).set(&floats[..pixels]);
        }
        let film = self.converted.as_ref().unwrap_or(&self.film);
        let height = self.encoder.part_rows().unwrap_or(self.rows.div_ceil(threads));
        let starts = (0..self.rows).step_by(height as usize);
        let ready: Vec<_> = starts.clone().map(|_| None).collect();
        let in_order = Mutex::new((ready, 0, take, Ok(())));
        self.frame.share(starts.enumerate(), |(index, start)| {
            let rows = start as usize..self.rows.min(start + height) as usize;
            let part = self.encoder.encode(film, width * rows.start..width * rows.end);
            let (ready, next, take, taken) = &mut *in_order.lock().expect(UNPOISONED);
            ready[index] = Some((rows.len() as u32, part));
            while let Some((rows, part)) = ready.get_mut(*next).and_then(Option::take) {
                *next += 1;
                if taken.is_ok() {
                    *taken = take(rows, part);
                }
            }
        });
        in_order.into_inner().expect(UNPOISONED).3
    }
}
