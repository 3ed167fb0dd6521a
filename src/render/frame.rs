//! The frame: drives an engine over rows of a picture with any number of threads.

use std::cell::Cell;
use std::collections::TryReserveError;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use crossbeam_deque::{Steal, Stealer, Worker};

#[cfg(feature = "files")]
use super::ImageError;
use super::film::with_pixels;
use super::{Film, FilmMut, Pixel, PixelFormat, Tracer};
use crate::scene::Camera;

/// A thread takes as many whole rows at a time as have this many pixels, and at least one.
const TASK_PIXELS: usize = 1 << 14;
/// So long a thread that has nothing to do waits for more before it sleeps: to be woken takes up to 0.7 ms, in which a
/// packet engine is done with a picture.
const LINGER: Duration = Duration::from_millis(2);

/// How to render.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Threads that trace, at least 1.
    pub threads: usize,
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
    #[cfg(feature = "files")]
    #[error(transparent)]
    Image(#[from] ImageError),
    /// Another rank, which says where and what.
    #[cfg(feature = "mpi")]
    #[error("{0}")]
    Rank(String),
}

/// An engine, the camera it is ready for, and the threads that run it.
pub struct Frame<'a> {
    pub(super) tracer: &'a dyn Tracer,
    pub(super) camera: Camera,
    /// The threads beside this one, if any.
    others: Option<rayon::ThreadPool>,
    /// Whether [`Stats`](super::Stats) are to say at how many pixels there is something.
    #[cfg(feature = "files")]
    pub(super) counts_hits: bool,
}

impl<'a> Frame<'a> {
    /// Starts the threads.
    pub fn new(tracer: &'a dyn Tracer, camera: Camera, settings: Settings) -> Result<Self, RenderError> {
        let threads = settings.threads.max(1);
        let others = (threads > 1).then(|| rayon::ThreadPoolBuilder::new().num_threads(threads - 1).build());
        let others = others.transpose().map_err(|source| RenderError::Threads { threads, source })?;
        let frame = Frame {
            tracer,
            camera,
            others,
            #[cfg(feature = "files")]
            counts_hits: false,
        };
        frame.keep_awake();
        Ok(frame)
    }

    /// Has [`Stats`](super::Stats) say at how many pixels there is something.
    #[cfg(feature = "files")]
    pub fn counting_hits(mut self) -> Self {
        self.counts_hits = true;
        self
    }

    /// Threads that trace.
    #[cfg(feature = "files")]
    pub(super) fn threads(&self) -> usize {
        1 + self.others.as_ref().map_or(0, rayon::ThreadPool::current_num_threads)
    }

    /// A film for `rows` rows, in memory that has been touched.
    pub fn film(&self, format: PixelFormat, rows: u32) -> Result<Film, RenderError> {
        let pixels = self.camera.width() as usize * rows as usize;
        let bytes = pixels * format.bytes();
        Film::new(format, pixels).map_err(|error| RenderError::Memory { bytes, source: error.source })
    }

    /// Traces `rows` into `film`, whose size they have; `done` hears of every few rows that are finished. The threads then
    /// stay awake for a while, as more is likely to follow.
    ///
    /// # Panics
    /// As [`Tracer::rows`].
    pub fn trace(&self, rows: Range<u32>, film: FilmMut<'_>, done: &(dyn Fn(u32) + Sync)) {
        self.trace_band(rows, film, done);
        self.keep_awake();
    }

    /// The same for a band, after which cores have other things to do.
    pub(super) fn trace_band(&self, rows: Range<u32>, film: FilmMut<'_>, done: &(dyn Fn(u32) + Sync)) {
        let trace = |rows, film: FilmMut<'_>| self.tracer.rows(rows, film);
        with_pixels!(FilmMut(film) = film => self.trace_tasks(rows, film, trace, done));
    }

    /// The same; and at how many pixels the engine finds something, where [it knows](Tracer::counted_rows).
    pub fn trace_counted(&self, rows: Range<u32>, film: FilmMut<'_>, done: &(dyn Fn(u32) + Sync)) -> Option<u64> {
        let (hits, unknown) = (AtomicU64::new(0), AtomicBool::new(false));
        let trace = |rows, film: FilmMut<'_>| match self.tracer.counted_rows(rows, film) {
            Some(in_task) => _ = hits.fetch_add(in_task, Ordering::Relaxed),
            None => unknown.store(true, Ordering::Relaxed),
        };
        with_pixels!(FilmMut(film) = film => self.trace_tasks(rows, film, trace, done));
        (!unknown.into_inner()).then_some(hits.into_inner())
    }

    /// At how many pixels of `rows` the engine finds something.
    pub fn count_hits(&self, rows: Range<u32>) -> u64 {
        let task_rows = self.task_rows();
        let hits = AtomicU64::new(0);
        self.share(rows.clone().step_by(task_rows), |start| {
            let hits_in_task = self.tracer.count_hits(start..rows.end.min(start + task_rows as u32));
            hits.fetch_add(hits_in_task, Ordering::Relaxed);
        });
        hits.into_inner()
    }

    /// Has all threads take tasks until none is left. This one takes part, from the front on: it need not wait until another
    /// is awake. The others come from the back, and so two threads find in their caches what they wrote last time.
    pub(super) fn share<T: Send>(&self, tasks: impl DoubleEndedIterator<Item = T>, work: impl Fn(T) + Sync) {
        let Some(others) = &self.others else { return tasks.for_each(work) };
        let queue = Worker::new_lifo();
        tasks.rev().for_each(|task| queue.push(task));
        let stealer = queue.stealer();
        let done = AtomicUsize::new(0);
        others.in_place_scope(|scope| {
            let count = others.current_num_threads();
            for _ in 0..count {
                scope.spawn(|_| {
                    steal_all(&stealer, &work);
                    done.fetch_add(1, Ordering::Release);
                });
            }
            while let Some(task) = queue.pop() {
                work(task);
            }
            wait_a_while(|| done.load(Ordering::Acquire) == count);
        });
    }

    /// Has the other threads linger, from when they have nothing to do.
    fn keep_awake(&self) {
        if let Some(others) = &self.others {
            others.spawn_broadcast(|_| linger());
        }
    }

    /// The rows that a thread takes at a time.
    pub(super) fn task_rows(&self) -> usize {
        let rows = (TASK_PIXELS / self.camera.width() as usize).max(1);
        rows.next_multiple_of(self.tracer.rows_together() as usize)
    }

    fn trace_tasks<P: Pixel>(
        &self,
        rows: Range<u32>,
        film: &mut [P],
        trace: impl Fn(Range<u32>, FilmMut<'_>) + Sync,
        done: &(dyn Fn(u32) + Sync),
    ) {
        let width = self.camera.width() as usize;
        assert_eq!(film.len(), width * rows.len(), "the film must have the size of the rows");
        let task_rows = self.task_rows();
        self.share(film.chunks_mut(task_rows * width).enumerate(), |(index, part): (usize, &mut [P])| {
            let start = rows.start + (index * task_rows) as u32;
            let count = (part.len() / width) as u32;
            trace(start..start + count, P::film(part));
            done(count);
        });
    }
}

/// Works on tasks from the back of a queue until it is empty.
fn steal_all<T>(queue: &Stealer<T>, work: impl Fn(T)) {
    loop {
        match queue.steal() {
            Steal::Success(task) => work(task),
            Steal::Retry => {}
            Steal::Empty => return,
        }
    }
}

/// Has a thread of a pool look for work for [`LINGER`] after it last had some.
fn linger() {
    thread_local!(static LINGERS: Cell<bool> = const { Cell::new(false) });
    // What a lingering thread finds may be this.
    if LINGERS.replace(true) {
        return;
    }
    while wait_a_while(|| rayon::yield_now() == Some(rayon::Yield::Executed)) {}
    LINGERS.set(false);
}

/// Awake until something is so, and not much longer than [`LINGER`]; whether it is.
fn wait_a_while(is_so: impl Fn() -> bool) -> bool {
    let start = Instant::now();
    loop {
        if is_so() {
            return true;
        }
        if start.elapsed() > LINGER {
            return false;
        }
        std::thread::yield_now();
    }
}
