//! Drives an engine over rows of a picture with any number of threads.

use std::ops::Range;
use std::sync::{Arc, Mutex};

use glam::DVec3;

#[cfg(feature = "files")]
use super::ImageError;
use super::film::with_pixels;
use super::{
    Counted, Film, FilmMut, Hit, NoMemory, Pixel, PixelFormat, Tracer, UNPOISONED, WrongSize, assert_rows, existing,
};
use crate::kernels::StandardFloats;
use crate::plan::{Cancel, Halved, MAX_THREADS, Team};
use crate::scene::Camera;

/// A task has whole rows: as many as have this many pixels together, but at least one.
const TASK_PIXELS: usize = 1 << 14;

/// The settings of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// The number of threads that trace, at least 1.
    pub threads: usize,
}

/// Why a picture was not made.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// Not even one band fits into memory.
    #[error(transparent)]
    Memory(#[from] NoMemory),
    /// The film has another size than the rows.
    #[error("the picture cannot be traced: {0}")]
    Size(#[from] WrongSize),
    /// The threads could not be started.
    #[error("cannot start {threads} threads: {} {given}, ask for no more",
        if *given == MAX_THREADS { "there may be" } else { "the system gives" })]
    Threads {
        /// The number of threads requested.
        threads: usize,
        /// The number of threads that there can be.
        given: usize,
    },
    /// [`Frame::stopped_by`]'s argument was set.
    #[error("tracing was stopped")]
    Cancelled,
    /// The image file could not be written.
    #[cfg(feature = "files")]
    #[error(transparent)]
    Image(#[from] ImageError),
}

/// An engine, the camera that it is prepared for, and the threads that run it.
pub struct Frame<'a> {
    pub(super) tracer: &'a dyn Tracer,
    pub(super) camera: Camera,
    team: Arc<Team>,
    cancel: Option<&'a Cancel>,
    /// Whether [`Stats`](super::Stats) include the number of rays and of hits.
    #[cfg(feature = "files")]
    pub(super) counts_hits: bool,
}

impl<'a> Frame<'a> {
    /// Starts the threads, or takes over those of the last frame or plan if it had as many.
    ///
    /// # Errors
    /// [`RenderError::Threads`].
    pub fn new(tracer: &'a dyn Tracer, camera: Camera, settings: Settings) -> Result<Self, RenderError> {
        let _floats = StandardFloats::set();
        let threads = settings.threads.max(1);
        let team = Team::of(threads).map_err(|given| RenderError::Threads { threads, given })?;
        team.keep_awake();
        Ok(Frame {
            tracer,
            camera,
            team,
            cancel: None,
            #[cfg(feature = "files")]
            counts_hits: false,
        })
    }

    /// Lets `cancel` stop [`trace`](Self::trace) and `render_to_file`. It is checked before every
    /// task, which has then as few rows as possible: one, or as many as a tile has.
    pub fn stopped_by(mut self, cancel: &'a Cancel) -> Self {
        self.cancel = Some(cancel);
        self
    }

    /// Makes [`Stats`](super::Stats) include the number of rays and of hits.
    #[cfg(feature = "files")]
    pub fn counting_hits(mut self) -> Self {
        self.counts_hits = true;
        self
    }

    /// The number of threads that trace.
    #[cfg(feature = "files")]
    pub(super) fn threads(&self) -> usize {
        self.team.threads()
    }

    /// A film for `rows` rows, all of whose memory has been written to. It is an error if the
    /// picture has fewer rows.
    pub fn film(&self, format: PixelFormat, rows: u32) -> Result<Film, RenderError> {
        self.check_rows(rows)?;
        let pixels = self.camera.width() as usize * rows as usize;
        Ok(Film::new(format, pixels)?)
    }

    /// Traces `rows` into `film`, and calls `done` with the number of rows of each finished task.
    /// Afterwards the threads stay awake for a while, since more work is likely to follow.
    ///
    /// # Errors
    /// [`RenderError::Size`] if the picture has no such rows or the film has another number of
    /// pixels; then nothing is traced. [`RenderError::Cancelled`] if tracing was
    /// [stopped](Self::stopped_by); then some rows are unchanged.
    pub fn trace(&self, rows: Range<u32>, film: FilmMut<'_>, done: &(dyn Fn(u32) + Sync)) -> Result<(), RenderError> {
        let pixels = self.camera.width() as usize * rows.len();
        self.check_rows(rows.end)?;
        if film.len() != pixels {
            return Err(WrongSize { what: "pixels of the film", found: film.len(), expected: pixels }.into());
        }
        self.trace_band(rows, film, done);
        self.team.keep_awake();
        if self.is_cancelled() { Err(RenderError::Cancelled) } else { Ok(()) }
    }

    /// Whether the frame was stopped.
    pub(super) fn is_cancelled(&self) -> bool {
        self.cancel.is_some_and(Cancel::is_cancelled)
    }

    /// Checks that the picture has this number of rows.
    fn check_rows(&self, rows: u32) -> Result<(), WrongSize> {
        let (what, found, expected) = ("rows of the picture", rows as usize, self.camera.height() as usize);
        if found > expected { Err(WrongSize { what, found, expected }) } else { Ok(()) }
    }

    /// The first hit of the ray through the centre of a pixel; None if it hits nothing, or if there
    /// is no such pixel.
    ///
    /// ```
    /// # use rayo::glam::Vec3;
    /// # use rayo::{Camera, Engine, Frame, Object, Scene, Settings, Sphere};
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let sphere = Sphere { radius: 1.0, colour: Vec3::ONE, centre: Vec3::new(0.0, 0.0, 5.0) };
    /// let scene = Scene { spheres: vec![sphere], ..Scene::new(Camera::new(321, 241, 1.0, 1.0)?) };
    /// let tracer = Engine::fastest().prepare(None, &scene)?;
    /// let frame = Frame::new(&*tracer, scene.camera, Settings { threads: 1 })?;
    /// let hit = frame.hit(160, 120).expect("the sphere is in the middle");
    /// assert_eq!(hit.object, Object::Sphere(0));
    /// assert!((hit.place.z - 4.0).abs() < 1e-5 && hit.place.truncate().length() < 1e-5);
    /// assert_eq!(frame.hit(0, 0), None);
    /// # Ok(())
    /// # }
    /// ```
    pub fn hit(&self, column: u32, row: u32) -> Option<Hit> {
        let _floats = StandardFloats::set();
        let found = (*self.tracer.hits(row..row.saturating_add(1)).get(column as usize)?)?;
        let place = found.distance.t() * DVec3::from(self.camera.grid().ray(row, column));
        Some(Hit { object: found.object, place, normal: found.normal })
    }

    /// As [`trace`](Self::trace), for a band of a larger picture. The threads do not stay awake
    /// afterwards, since the cores have other work to do.
    pub(super) fn trace_band(&self, rows: Range<u32>, film: FilmMut<'_>, done: &(dyn Fn(u32) + Sync)) {
        let trace = |rows, film: FilmMut<'_>| self.tracer.rows(rows, film);
        with_pixels!(FilmMut(film) = film => self.trace_tasks(rows, film, trace, done));
    }

    /// As [`trace`](Self::trace). Returns the number of rays and hits, if the engine
    /// [knows](Tracer::counted_rows) them.
    ///
    /// # Panics
    /// As [`Tracer::rows`], also if the film is not as long as the rows.
    pub fn trace_counted(&self, rows: Range<u32>, film: FilmMut<'_>, done: &(dyn Fn(u32) + Sync)) -> Option<Counted> {
        let sum = Mutex::new(Some(Counted::default()));
        let trace = |rows, film: FilmMut<'_>| add(&sum, self.tracer.counted_rows(rows, film));
        with_pixels!(FilmMut(film) = film => self.trace_tasks(rows, film, trace, done));
        sum.into_inner().expect(UNPOISONED)
    }

    /// Counts the rays of `rows`, and their hits.
    pub fn count(&self, rows: Range<u32>) -> Counted {
        let (task_rows, rows) = (self.task_rows(), existing(rows, self.camera.height()));
        let sum = Mutex::new(Some(Counted::default()));
        self.team.share(rows.clone().step_by(task_rows), |start| {
            add(&sum, Some(self.tracer.count(start..rows.end.min(start + task_rows as u32))));
        });
        sum.into_inner().expect(UNPOISONED).unwrap_or_default()
    }

    /// See [`Team::share`].
    #[cfg(feature = "files")]
    pub(super) fn share<T: Send>(&self, tasks: impl Iterator<Item = T>, work: impl Fn(T) + Sync) {
        self.team.share(tasks, work);
    }

    /// The number of rows that a thread takes at a time.
    pub(super) fn task_rows(&self) -> usize {
        // The frame checks before each task whether it was stopped: the smaller the tasks, the
        // sooner it stops.
        let pixels = if self.cancel.is_some() { 0 } else { TASK_PIXELS };
        let rows = (pixels / self.camera.width() as usize).max(1);
        rows.next_multiple_of(self.rows_together() as usize)
    }

    /// [`Tracer::rows_together`], limited to the rows that the picture has.
    pub(super) fn rows_together(&self) -> u32 {
        self.tracer.rows_together().clamp(1, self.camera.height())
    }

    fn trace_tasks<'f, P: Pixel>(
        &self,
        rows: Range<u32>,
        film: &'f mut [P],
        trace: impl Fn(Range<u32>, FilmMut<'_>) + Sync,
        done: &(dyn Fn(u32) + Sync),
    ) {
        let width = self.camera.width() as usize;
        assert_rows(&rows, [self.camera.width(), self.camera.height()], film.len());
        let task_rows = self.task_rows();
        // Rows that are cheapest to trace together are not separated: half a tile takes four fifths
        // of a tile's time.
        let together = self.rows_together();
        let halve = |(start, part): (u32, &'f mut [P])| {
            let count = (part.len() / width) as u32 / 2 / together * together;
            if count == 0 {
                return Halved::whole((start, part));
            }
            let (half, rest) = part.split_at_mut(count as usize * width);
            Halved { first: (start, half), rest: Some((start + count, rest)) }
        };
        let work = |(): &mut (), (start, part): (u32, &'f mut [P])| {
            if self.is_cancelled() {
                return;
            }
            let count = (part.len() / width) as u32;
            trace(start..start + count, P::film(part));
            done(count);
        };
        self.team.share_with(rows.step_by(task_rows).zip(film.chunks_mut(task_rows * width)), halve, || (), work);
    }
}

/// Adds the counts of some rows. If these are unknown, the sum becomes unknown.
fn add(sum: &Mutex<Option<Counted>>, some: Option<Counted>) {
    let mut sum = sum.lock().expect(UNPOISONED);
    *sum = sum.zip(some).map(|(sum, some)| sum + some);
}
