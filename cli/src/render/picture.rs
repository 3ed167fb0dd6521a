//! Writes a picture of a scene to a file, or a series of pictures from all sides.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget};

use super::args::RenderArgs;
use super::name::{keep_scenes, numbered};
use crate::engine::Tracing;
use crate::measuring::bar_style;
use crate::{Failure, say};
use rayo::internals::render::{
    Developed, Development, Existing, Format, Frame, ImageError, ImageWriter, PixelFormat, Settings, Stats, Tracer,
    render,
};
use rayo::internals::scene::{Camera, MovingCamera, Scene, shown};

/// Progress is shown if a picture takes longer than this.
const PATIENCE: Duration = Duration::from_secs(1);

/// What all pictures of a scene share.
pub(super) struct Picture<'a> {
    pub args: &'a RenderArgs,
    pub tracing: Tracing,
    /// The camera of the picture, with one ray per pixel; the scene's own camera traces all
    /// samples.
    pub camera: Camera,
    pub rows: Range<u32>,
    pub format: Format,
    pub development: Option<Development>,
    pub progress: Progress,
}

impl Picture<'_> {
    /// Renders a scene to a file. Returns the time of the set-up, and the statistics of the rest.
    pub(super) fn write(&self, scene: &Scene, path: &Path) -> Result<(Duration, Stats), Failure> {
        let Picture { args, tracing, camera, format, .. } = *self;
        let existing = if args.output.is_some() || args.force { Existing::Replace } else { Existing::Keep };
        let size = (camera.width(), camera.height());
        let mut image = ImageWriter::of_rows(path, format, size, self.rows.clone(), existing).map_err(unwritten)?;
        let clock = Instant::now();
        let own = tracing.engine.format_for(format.is_8bit());
        let own = if self.development.is_some() { PixelFormat::F32x4 } else { own };
        let plan = tracing.plan(scene, Some(own))?;
        let plain_scene = args.development.plain(scene, camera);
        let plain = plain_scene.as_ref().map(|scene| tracing.plan(scene, None)).transpose()?;
        if args.explain {
            plan.report().lines().iter().for_each(|line| say(line));
        }
        let developed = self.development.map(|development| {
            let developed = Developed::new(plan.tracer(), &camera, development);
            plain.iter().fold(developed, |developed, plain| developed.along_edges(plain.tracer()))
        });
        let tracer = developed.as_ref().map_or(plan.tracer(), |developed| developed as &dyn Tracer);
        // Starting another thread takes longer than tracing one quick picture; it only pays if
        // there is a file to compress.
        let alone = args.orbit.is_none() && tracer.is_quick() && matches!(format, Format::Ppm | Format::Pfm);
        let settings = if alone { Settings { threads: 1 } } else { tracing.settings() };
        let frame = Frame::new(tracer, camera, settings)?;
        let frame = if args.stats || args.json { frame.counting_hits() } else { frame };
        let setup = clock.elapsed();

        let progress = &self.progress;
        let done = |rows| progress.advance(rows);
        let mut stats = render(&frame, &mut image, &done)?;
        let clock = Instant::now();
        image.finish().map_err(Failure::output)?;
        stats.write += clock.elapsed();
        Ok((setup, stats))
    }

    /// Renders as many pictures as asked for, from all around a scene, and reports it. `files` of
    /// the scene must not be replaced.
    pub(super) fn go_round(
        &self,
        mut moving: MovingCamera<'_>,
        scene: &Scene,
        count: u32,
        path: &Path,
        inputs: &BTreeSet<PathBuf>,
    ) -> Result<(), Failure> {
        let mut traced = Duration::ZERO;
        let names: Vec<_> = (0..count).filter_map(|number| numbered(path, number)).collect();
        names.iter().try_for_each(|path| keep_scenes(path, inputs))?;
        let mut written = BTreeSet::new();
        let depth = scene.middle_depth();
        for (number, path) in names.iter().enumerate() {
            if path.canonicalize().is_ok_and(|file| written.contains(&file)) {
                let path = shown(path);
                return Err(Failure::input(format!(
                    "{path} is the file of a picture before it, by a link: remove that"
                )));
            }
            let view = scene.view.orbit(depth, number as f64 / f64::from(count)).map_err(Failure::input)?;
            traced += self.write(moving.seen_from(view).map_err(Failure::input)?, path)?.1.trace;
            written.extend(path.canonicalize());
        }
        self.progress.end();
        if let (Some(first), Some(last), false) = (names.first(), names.last(), self.args.quiet) {
            let (first, last, size) = (shown(first), shown(last), self.size());
            let engine = self.tracing.engine;
            say(&format!("{first} to {last}: {count} of {size} by {engine}, traced in {traced:.1?}"));
        }
        Ok(())
    }

    /// The width and height in pixels, as in 1632x1224.
    pub(super) fn size(&self) -> String {
        format!("{}x{}", self.camera.width(), self.rows.len())
    }
}

/// A picture too large for its format is invalid usage; other errors in creating a file are output
/// errors.
fn unwritten(error: ImageError) -> Failure {
    match error {
        ImageError::Whole { .. } => Failure::input(error),
        _ => Failure::output(error),
    }
}

/// A progress bar, if standard error is a terminal and the picture takes long.
pub(super) struct Progress {
    start: Instant,
    bar: ProgressBar,
    shown: OnceLock<()>,
    quiet: bool,
}

impl Progress {
    pub(super) fn new(rows: u64, quiet: bool) -> Self {
        let bar = ProgressBar::with_draw_target(Some(rows), ProgressDrawTarget::hidden());
        bar.set_style(bar_style("{pos}/{len} rows, {eta} left"));
        Progress { start: Instant::now(), bar, shown: OnceLock::new(), quiet }
    }

    fn advance(&self, rows: u32) {
        self.bar.inc(rows.into());
        if !self.quiet && self.start.elapsed() > PATIENCE {
            self.shown.get_or_init(|| self.bar.set_draw_target(ProgressDrawTarget::stderr()));
        }
    }

    /// Removes the bar, before other messages are printed.
    pub(super) fn end(&self) {
        self.bar.finish_and_clear();
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.end();
    }
}
