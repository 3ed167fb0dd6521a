//! The thread that traces: requests come by one channel, and a reply to each goes by another.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender};
use std::time::Instant;

use rayo::{
    Cancel, Engine, EngineError, Film, Format, Frame, Hit, ImageError, ImageWriter, MovingCamera, Object, OutputError,
    PixelFormat, Plan, Purpose, RenderError, Scene, Settings, ViewError, render_to_file,
};

use crate::commands::Source;
use crate::state::{Times, Tracing, Wish};

/// A request to the thread.
pub enum Request {
    /// Draw a picture in the window.
    Draw {
        /// The picture.
        wish: Wish,
        /// What cancels it.
        cancel: Cancel,
        /// A film that is no longer needed, whose memory the picture may take.
        spare: Option<Film>,
    },
    /// Describe what is at a pixel of a picture.
    Name {
        /// The picture.
        wish: Wish,
        /// The column and the row of the pixel.
        pixel: [u32; 2],
    },
    /// Write a picture to a new file.
    Write {
        /// The picture.
        wish: Wish,
        /// What cancels it.
        cancel: Cancel,
    },
}

/// The reply to a request.
pub enum Reply {
    /// The picture is drawn.
    Drawn {
        /// The picture that was asked for.
        wish: Wish,
        /// Its pixels, in [`PixelFormat::Bgra8`].
        film: Film,
        /// How long the picture took.
        times: Times,
    },
    /// The picture was cancelled.
    Stopped,
    /// The picture cannot be drawn, and why.
    Failed(String),
    /// The pixel is described, or the picture written.
    Told {
        /// The line to show in the window.
        line: String,
        /// The lines to print: this one, and the command of `rayo` that does the same.
        printed: String,
    },
}

/// The scene, and the memory that it is moved to each camera in.
pub struct Worker<'a> {
    source: &'a Source,
    world: &'a Scene,
    moving: MovingCamera<'a>,
}

/// Why a request has no result.
#[derive(Debug)]
pub enum NoPicture {
    Stopped,
    Failed(String),
}

impl fmt::Display for NoPicture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            NoPicture::Stopped => f.write_str("it was stopped"),
            NoPicture::Failed(why) => f.write_str(why),
        }
    }
}

macro_rules! failed {
    ($($error:ty),*) => {$(
        impl From<$error> for NoPicture {
            fn from(error: $error) -> Self {
                NoPicture::Failed(error.to_string())
            }
        }
    )*};
}
failed!(ViewError, ImageError, rayo::NoMemory);

impl From<EngineError> for NoPicture {
    fn from(error: EngineError) -> Self {
        if error == EngineError::Cancelled { NoPicture::Stopped } else { NoPicture::Failed(error.to_string()) }
    }
}

impl From<RenderError> for NoPicture {
    fn from(error: RenderError) -> Self {
        match error {
            RenderError::Cancelled => NoPicture::Stopped,
            other => NoPicture::Failed(other.to_string()),
        }
    }
}

impl<'a> Worker<'a> {
    /// A worker for the scene `world`, with memory for it as a moving camera sees it.
    pub fn new(source: &'a Source, world: &'a Scene) -> Self {
        let moving = MovingCamera::of(world).carrying_light(source.carried_light);
        Worker { source, world, moving }
    }

    /// Replies to each request until the channel of either is closed; calls `wake` after each
    /// reply.
    pub fn run(mut self, requests: &Receiver<Request>, replies: &Sender<Reply>, wake: impl Fn()) {
        for request in requests {
            let reply = self.reply(request);
            if replies.send(reply).is_err() {
                return;
            }
            wake();
        }
    }

    fn reply(&mut self, request: Request) -> Reply {
        let result = match request {
            Request::Draw { wish, cancel, spare } => {
                self.draw(&wish, &cancel, spare).map(|(film, times)| Reply::Drawn { wish, film, times })
            }
            Request::Name { wish, pixel } => self.name(&wish, pixel),
            Request::Write { wish, cancel } => self.write(&wish, &cancel),
        };
        result.unwrap_or_else(|no_picture| match no_picture {
            NoPicture::Stopped => Reply::Stopped,
            NoPicture::Failed(why) => Reply::Failed(why),
        })
    }

    /// The scene as the camera of a picture sees it.
    fn seen(&mut self, wish: &Wish) -> Result<&Scene, ViewError> {
        self.moving.set_camera(wish.camera(&self.world.camera));
        self.moving.set_shadows(wish.tracing.shadows);
        self.moving.seen_from(wish.view)
    }

    /// Traces a picture, in the memory of `spare` if that has as many pixels.
    pub fn draw(&mut self, wish: &Wish, cancel: &Cancel, spare: Option<Film>) -> Result<(Film, Times), NoPicture> {
        let start = Instant::now();
        let scene = self.seen(wish)?;
        let moved = start.elapsed();
        let pixels = scene.camera.pixels() as usize;
        let mut film = match spare.filter(|film| film.len() == pixels) {
            Some(film) => film,
            None => Film::new(PixelFormat::Bgra8, pixels)?,
        };
        let start = Instant::now();
        let plan = plan(scene, &wish.tracing, PixelFormat::Bgra8, Some(cancel))?;
        let settings = Settings { threads: wish.tracing.threads };
        let frame = Frame::new(plan.tracer(), scene.camera, settings)?.stopped_by(cancel);
        let planned = start.elapsed();
        let start = Instant::now();
        frame.trace(0..scene.camera.height(), film.as_mut(), &|_rows| {})?;
        Ok((film, Times { moved, planned, traced: start.elapsed() }))
    }

    /// Describes what is at a pixel.
    fn name(&mut self, wish: &Wish, [column, row]: [u32; 2]) -> Result<Reply, NoPicture> {
        let source = self.source;
        let scene_camera = self.world.camera;
        let scene = self.seen(wish)?;
        // Every engine finds the same object, and those without packets test a whole row of pixels
        // against every object.
        let engine = Engine::fastest();
        let fastest = Tracing { engine, precision: engine.precision(), ..wish.tracing };
        let plan = plan(scene, &fastest, PixelFormat::F32x4, None)?;
        let frame = Frame::new(plan.tracer(), scene.camera, Settings { threads: 1 })?;
        let what = frame.hit(column, row).map_or_else(|| "nothing".into(), |hit| description(scene, &hit));
        let line = format!("pixel {column},{row}: {what}");
        let printed = format!("{line}\n{}", source.step_command(&scene_camera, wish, [column, row]));
        Ok(Reply::Told { line, printed })
    }

    /// Writes a picture to a file whose name is free.
    fn write(&mut self, wish: &Wish, cancel: &Cancel) -> Result<Reply, NoPicture> {
        let source = self.source;
        let scene_camera = self.world.camera;
        let scene = self.seen(wish)?;
        let plan = plan(scene, &wish.tracing, PixelFormat::Rgb8, Some(cancel))?;
        let settings = Settings { threads: wish.tracing.threads };
        let frame = Frame::new(plan.tracer(), scene.camera, settings)?.stopped_by(cancel);
        let (path, mut image) = new_file(&source.stem, scene)?;
        render_to_file(&frame, &mut image, &|_rows| {})?;
        image.finish()?;
        let line = format!("wrote {}", path.display());
        let printed = format!("{line}\n{}", source.render_command(&scene_camera, wish, &path));
        Ok(Reply::Told { line, printed })
    }
}

/// The plan of a scene for an engine with its options, which writes pixels of `format`.
fn plan<'a>(
    scene: &'a Scene,
    tracing: &Tracing,
    format: PixelFormat,
    cancel: Option<&Cancel>,
) -> Result<Plan<'a>, EngineError> {
    let purpose = Purpose {
        precision: Some(tracing.precision),
        format: Some(format),
        keep: tracing.keep(),
        threads: tracing.threads,
        cancel,
        in_bands: false,
    };
    Plan::new(tracing.engine, scene, purpose)
}

/// What was hit, in words: the object, how far away it is, its normal and its colour.
fn description(scene: &Scene, hit: &Hit) -> String {
    let (name, colour) = match hit.object {
        Object::Sphere(number) => (format!("sphere {}", number + 1), scene.spheres[number].colour),
        Object::Triangle(number) => (format!("triangle {}", number + 1), scene.triangle(number).colour),
    };
    let mut line = format!("{name}, distance {:.4}", hit.place.length());
    if let Some(normal) = hit.normal {
        line += &format!(", normal {:.3} {:.3} {:.3}", normal.x, normal.y, normal.z);
    }
    line + &format!(", colour {:.3} {:.3} {:.3}", colour.x, colour.y, colour.z)
}

/// A new PNG file for the picture of a scene, and its name: `stem` and the first number that is
/// free.
fn new_file(stem: &str, scene: &Scene) -> Result<(PathBuf, ImageWriter), ImageError> {
    let mut number = 1;
    loop {
        let path = Path::new(&format!("{stem}-{number:04}.png")).to_owned();
        match ImageWriter::create_new(&path, Format::Png, scene.camera.width(), scene.camera.height()) {
            Err(ImageError::Output(OutputError::Exists { .. })) if number < 9999 => number += 1,
            other => return other.map(|image| (path, image)),
        }
    }
}
