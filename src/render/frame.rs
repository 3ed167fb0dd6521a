//! The frame: drives an engine over all rows of a picture, band by band, with any number of threads.

use std::collections::TryReserveError;
use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use crossbeam_deque::{Injector, Steal};

use super::film::with_pixels;
use super::{Film, FilmMut, ImageError, ImageWriter, Pixel, PixelFormat, Tracer};
use crate::measure::Cycles;
use crate::scene::Camera;

/// A band is as many whole rows as fit in this, and at least one: little enough that who encodes or writes it still finds
/// it in a cache, and enough that waking the threads for each does not count.
const BAND_BYTES: usize = 8 << 20;
/// A thread takes as many whole rows at a time as have this many pixels, and at least one.
const TASK_PIXELS: usize = 1 << 14;

/// How to render.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Threads that trace, at least 1.
    pub threads: usize,
}

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

/// Why a picture was not made.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// Not even one band fits into memory.
    #[error("there is no memory for {bytes} bytes of pixels: {source}")]
    Memory {
        /// How much was asked for.
        bytes: usize,
        /// What the allocator says.
        source: TryReserveError,
    },
    /// The threads could not be started.
    #[error("cannot start {threads} threads: {source}")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// What the operating system says.
        source: rayon::ThreadPoolBuildError,
    },
    /// The image file.
    #[error(transparent)]
    Image(#[from] ImageError),
}

/// An engine, the camera it is ready for, and the threads that run it.
pub struct Frame<'a> {
    tracer: &'a dyn Tracer,
    camera: Camera,
    /// The threads beside this one, if any.
    others: Option<rayon::ThreadPool>,
}

impl<'a> Frame<'a> {
    /// Starts the threads.
    pub fn new(tracer: &'a dyn Tracer, camera: Camera, settings: Settings) -> Result<Self, RenderError> {
        let threads = settings.threads.max(1);
        let others = (threads > 1).then(|| rayon::ThreadPoolBuilder::new().num_threads(threads - 1).build());
        let others = others.transpose().map_err(|source| RenderError::Threads { threads, source })?;
        Ok(Frame { tracer, camera, others })
    }

    /// A film for `rows` rows, in memory that has been touched.
    pub fn film(&self, format: PixelFormat, rows: u32) -> Result<Film, RenderError> {
        let pixels = self.camera.width() as usize * rows as usize;
        let bytes = pixels * format.bytes();
        Film::new(format, pixels).map_err(|source| RenderError::Memory { bytes, source })
    }

    /// Traces `rows` into `film`, whose size they have; `done` hears of every few rows that are finished.
    ///
    /// # Panics
    /// As [`Tracer::rows`].
    pub fn trace(&self, rows: Range<u32>, film: FilmMut<'_>, done: &(dyn Fn(u32) + Sync)) {
        with_pixels!(FilmMut(film) = film => self.trace_tasks(rows, film, done));
    }

    /// At how many pixels of the picture the engine finds something.
    pub fn count_hits(&self) -> u64 {
        let (height, rows) = (self.camera.height(), self.task_rows() as u32);
        let hits = AtomicU64::new(0);
        self.share((0..height).step_by(rows as usize), |start| {
            let hits_in_task = self.tracer.count_hits(start..height.min(start + rows));
            hits.fetch_add(hits_in_task, Ordering::Relaxed);
        });
        hits.into_inner()
    }

    /// Has all threads take tasks until none is left. This one takes part: it need not wait until another is awake, which can
    /// take longer than a small picture.
    fn share<T: Send>(&self, tasks: impl Iterator<Item = T>, work: impl Fn(T) + Sync) {
        let Some(others) = &self.others else { return tasks.for_each(work) };
        let queue = Injector::new();
        tasks.for_each(|task| queue.push(task));
        let take_all = || {
            loop {
                match queue.steal() {
                    Steal::Success(task) => work(task),
                    Steal::Retry => {}
                    Steal::Empty => break,
                }
            }
        };
        others.in_place_scope(|scope| {
            (0..others.current_num_threads()).for_each(|_| scope.spawn(|_| take_all()));
            take_all();
        });
    }

    /// The rows that a thread takes at a time.
    fn task_rows(&self) -> usize {
        let rows = (TASK_PIXELS / self.camera.width() as usize).max(1);
        rows.next_multiple_of(self.tracer.rows_together() as usize)
    }

    fn trace_tasks<P: Pixel>(&self, rows: Range<u32>, film: &mut [P], done: &(dyn Fn(u32) + Sync)) {
        let width = self.camera.width() as usize;
        assert_eq!(film.len(), width * rows.len(), "the film must have the size of the rows");
        let task_rows = self.task_rows();
        self.share(film.chunks_mut(task_rows * width).enumerate(), |(index, part): (usize, &mut [P])| {
            let start = rows.start + (index * task_rows) as u32;
            let count = (part.len() / width) as u32;
            self.tracer.rows(start..start + count, P::film(part));
            done(count);
        });
    }
}

/// Renders the whole picture into an image file, band by band; `done` hears of every few rows that are traced.
pub fn render(frame: &Frame<'_>, image: &mut ImageWriter, done: &(dyn Fn(u32) + Sync)) -> Result<Stats, RenderError> {
    let camera = frame.camera;
    let own = image.format().pixels();
    let format = if frame.tracer.writes(own) { own } else { PixelFormat::F32x4 };
    let band_rows = (BAND_BYTES / (camera.width() as usize * format.bytes())).max(1);
    let band_rows =
        band_rows.next_multiple_of(frame.tracer.rows_together() as usize).min(camera.height() as usize) as u32;
    let mut film = frame.film(format, band_rows)?;
    let mut converted = if format == own { None } else { Some(frame.film(own, band_rows)?) };
    let mut stats = Stats { trace_cycles: Cycles::available().then_some(0), ..Stats::default() };
    for start in (0..camera.height()).step_by(band_rows as usize) {
        let rows = start..camera.height().min(start + band_rows);
        let pixels = camera.width() as usize * rows.len();

        let clock = (Instant::now(), Cycles::start());
        frame.trace(rows, film.as_mut().part(0..pixels), done);
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
