//! The pictures of a scene: every rank reads it and traces, and rank 0 writes the files.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::thread::{self, available_parallelism};

use rayo::{
    Camera, Developed, Development, Engine, Existing, Format, Frame, ImageError, ImageWriter, Keep, MovingCamera,
    PixelFormat, Plan, Purpose, RenderError, Scene, Settings, Tracer,
};

use crate::arguments::Arguments;
use crate::bands::{SharedTracer, serve};
use crate::ranks::Ranks;
use crate::{Failure, say};

/// What all pictures of a scene have in common.
struct Pictures<'a> {
    ranks: &'a Ranks,
    arguments: &'a Arguments,
    engine: Engine,
    /// The camera of the picture. With several samples for each pixel that of the scene is larger.
    camera: Camera,
    rows: Range<u32>,
    format: Format,
    development: Option<Development>,
}

/// Renders the scene of a file to its picture, or to those from all around it.
pub fn render_scene(ranks: &Ranks, arguments: &Arguments, engine: Engine, path: &Path) -> Result<(), Failure> {
    let OpenedScene { mut scene, files, carried_light } = ranks.agree(open(ranks, arguments, path))?;
    let is_other = format!("{} is another scene here than on rank 0: copy it", path.display());
    ranks.same(&digest(&scene), &is_other)?;
    let (target, pictures) = ranks.agree(prepare(ranks, arguments, engine, &scene))?;
    let names = ranks.agree(names(arguments, &target))?;
    let names_are_free =
        if ranks.rank() == 0 { names.iter().try_for_each(|name| keep_inputs(name, &files)) } else { Ok(()) };
    ranks.agree(names_are_free)?;
    let camera = pictures.development.map_or(Ok(scene.camera), |development| development.camera(&scene.camera));
    scene.camera = ranks.agree(camera.map_err(|error| Failure::input(format!("--samples: {error}"))))?;
    let size = format!("{}x{} by {engine} on {} ranks", pictures.camera.width(), pictures.rows.len(), ranks.count());
    let summary = match arguments.orbit {
        None => {
            pictures.write(&scene, &target)?;
            format!("{}: {size}", target.display())
        }
        Some(count) => {
            let depth = scene.middle_depth();
            let mut moving = MovingCamera::of(&scene).carrying_light(carried_light);
            for (number, name) in names.iter().enumerate() {
                let view = scene.view.orbit(depth, number as f64 / f64::from(count));
                let view = ranks.agree(view.map_err(Failure::input))?;
                pictures.write(ranks.agree(moving.seen_from(view).map_err(Failure::input))?, name)?;
            }
            format!("{}: {count} of {size}", target.display())
        }
    };
    if ranks.rank() == 0 && !arguments.quiet {
        say(&summary);
    }
    Ok(())
}

/// A scene as it is to be seen, and what else its files say.
struct OpenedScene {
    scene: Scene,
    /// The files that it was read from.
    files: Vec<PathBuf>,
    /// The index of the light that the camera carries, if it carries one.
    carried_light: Option<usize>,
}

fn open(ranks: &Ranks, arguments: &Arguments, path: &Path) -> Result<OpenedScene, Failure> {
    let of_mesh = arguments.seen_by(&Camera::default()).map_err(Failure::input)?;
    let opened = rayo::open(path, &of_mesh).map_err(|error| Failure::input(error.render(false)))?;
    let mut scene = opened.scene;
    scene.camera = arguments.seen_by(&scene.camera).map_err(Failure::input)?;
    scene.shadows |= arguments.shadows;
    if ranks.rank() == 0 {
        opened.notes.iter().filter(|_| !arguments.quiet).for_each(|note| say(&format!("note: {note}")));
        opened.warnings.iter().chain(&scene.doubts()).for_each(|warning| say(&format!("warning: {warning}")));
    }
    Ok(OpenedScene { scene, files: opened.files, carried_light: opened.carried_light })
}

/// A hash of all that a picture depends on, to tell whether two ranks have read the same scene.
fn digest(scene: &Scene) -> [u8; 8] {
    let mut hasher = DefaultHasher::new();
    let Scene { name, camera, lights, spheres, .. } = scene;
    (name, camera.width(), camera.height(), lights.len(), spheres.len(), scene.triangle_count()).hash(&mut hasher);
    (scene.shadows, format!("{:?}", scene.view)).hash(&mut hasher);
    let mut hash = |numbers: &[f32]| numbers.iter().for_each(|number| number.to_bits().hash(&mut hasher));
    hash(&[camera.focal(), camera.film()]);
    for light in lights {
        hash(&[light.intensity]);
        [light.colour, light.position].iter().for_each(|vector| hash(&vector.to_array()));
    }
    for sphere in spheres {
        hash(&[sphere.radius]);
        [sphere.colour, sphere.centre].iter().for_each(|vector| hash(&vector.to_array()));
    }
    for triangle in scene.all_triangles() {
        hash(&triangle.colour.to_array());
        triangle.vertices.iter().for_each(|vertex| hash(&vertex.to_array()));
    }
    hasher.finish().to_le_bytes()
}

/// The file of the picture, and what all pictures of the scene have in common.
fn prepare<'a>(
    ranks: &'a Ranks,
    arguments: &'a Arguments,
    engine: Engine,
    scene: &Scene,
) -> Result<(PathBuf, Pictures<'a>), Failure> {
    let target = match &arguments.output {
        Some(directory) if arguments.scenes.len() > 1 => directory.join(plain_name(&scene.name)?),
        Some(file) => file.clone(),
        None => plain_name(&scene.name)?,
    };
    let format = Format::from_path(&target).map_err(Failure::input)?;
    if arguments.srgb && !format.is_8bit() {
        return Err(Failure::input("--srgb is for formats with 8 bits, and this one has linear floats: leave it out"));
    }
    let (camera, height) = (scene.camera, scene.camera.height());
    let rows = arguments.rows.clone().unwrap_or(0..height);
    if rows.end > height {
        let Range { start, end } = rows;
        return Err(Failure::input(format!("--rows {start}..{end}: the picture has the rows 0..{height}")));
    }
    let development = arguments.development();
    Ok((target, Pictures { ranks, arguments, engine, camera, rows, format, development }))
}

/// The name of its picture that a scene has, which is refused if it names a directory, a hidden
/// file or an option: scenes may come from anybody.
fn plain_name(name: &str) -> Result<PathBuf, Failure> {
    if name.is_empty() || name.starts_with(['.', '-']) || name.contains(['/', '\\']) || name.contains(char::is_control)
    {
        let name = name.escape_debug();
        return Err(Failure::input(format!("the scene's image name `{name}` is not that of a plain file: use -o")));
    }
    Ok(name.into())
}

/// The files of the pictures: the target, or for an orbit the target with a number in the place of
/// `%d` or `%04d`.
fn names(arguments: &Arguments, target: &Path) -> Result<Vec<PathBuf>, Failure> {
    let Some(count) = arguments.orbit else { return Ok(vec![target.into()]) };
    if arguments.scenes.len() > 1 {
        return Err(Failure::input("--orbit goes round one scene: render the others in calls of their own"));
    }
    let numbered = |number: u32| {
        let (before, rest) = target.to_str()?.split_once('%')?;
        let (width, after) = rest.split_once('d')?;
        let digits: usize = if width.is_empty() { 0 } else { width.strip_prefix('0')?.parse().ok()? };
        (digits < 10 && !after.contains('%')).then(|| format!("{before}{number:0digits$}{after}").into())
    };
    let names: Option<Vec<_>> = (0..count).map(numbered).collect();
    let problem = "--orbit writes several pictures, and -o names one: give it a number, as in frames/%04d.png";
    names.ok_or_else(|| Failure::input(problem))
}

/// Refuses a picture that would replace a file that the scene was read from.
fn keep_inputs(picture: &Path, inputs: &[PathBuf]) -> Result<(), Failure> {
    let Ok(target) = picture.canonicalize() else { return Ok(()) };
    if target.is_file() && inputs.iter().any(|file| file.canonicalize().is_ok_and(|file| file == target)) {
        let picture = picture.display();
        return Err(Failure::input(format!("{picture} is also read, and would be replaced: name another file")));
    }
    Ok(())
}

impl Pictures<'_> {
    /// Renders a scene to a file.
    fn write(&self, scene: &Scene, path: &Path) -> Result<(), Failure> {
        let Pictures { ranks, arguments, camera, development, .. } = *self;
        // The file is begun before the plan is made, so that one which cannot be written fails at
        // once.
        let image = ranks.agree(if ranks.rank() == 0 { self.begin(path).map(Some) } else { Ok(None) })?;
        let format = self.engine.format_for(self.format.is_8bit());
        let format = if development.is_some() { PixelFormat::F32x4 } else { format };
        let plan = ranks.agree(self.plan(scene, Some(format)))?;
        let is_along_edges = arguments.edges && development.is_some_and(|development| development.samples > 1);
        let plain_scene = is_along_edges.then(|| Scene { camera, ..scene.clone() });
        let plain = ranks.agree(plain_scene.as_ref().map(|scene| self.plan(scene, None)).transpose())?;
        let developed = development.map(|development| {
            let developed = Developed::new(plan.tracer(), &camera, development);
            plain.iter().fold(developed, |developed, plain| developed.along_edges(plain.tracer()))
        });
        let tracer = developed.as_ref().map_or(plan.tracer(), |developed| developed as &dyn Tracer);
        let shared = SharedTracer::new(tracer, camera, self.rows.clone(), ranks);
        let traced = if image.is_some() { &shared as &dyn Tracer } else { tracer };
        let frame = Frame::new(traced, camera, Settings { threads: self.threads() }).map_err(Failure::input);
        let frame = ranks.agree(frame)?;
        let Some(image) = image else {
            serve(ranks, &frame, camera.width());
            return ranks.agree(Ok(()));
        };
        // Only this thread may call MPI: another one writes.
        let written = thread::scope(|scope| {
            let writer = thread::Builder::new().spawn_scoped(scope, || finish(&frame, image));
            let writer = writer.map_err(|error| Failure::output(format!("no thread can be started: {error}")))?;
            shared.hand_out(ranks, || writer.is_finished());
            writer.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        });
        // The other ranks may be tracing bands that nobody will take, and would not come to agree.
        if let Err(failure) = &written {
            failure.tell();
            ranks.abort(failure.status);
        }
        ranks.agree(written)
    }

    /// Begins the file of a picture.
    fn begin(&self, path: &Path) -> Result<ImageWriter, Failure> {
        let is_named = self.arguments.output.is_some() || self.arguments.force;
        let existing = if is_named { Existing::Replace } else { Existing::Keep };
        let size = (self.camera.width(), self.camera.height());
        // Only a picture that is too large for its format is bad usage.
        ImageWriter::of_rows(path, self.format, size, self.rows.clone(), existing).map_err(|error| match error {
            ImageError::Whole { .. } => Failure::input(error),
            _ => Failure::output(error),
        })
    }

    fn plan<'s>(&self, scene: &'s Scene, format: Option<PixelFormat>) -> Result<Plan<'s>, Failure> {
        let keep = if self.arguments.keep_all { Keep::all() } else { Keep::NOTHING };
        let precision = self.arguments.precision;
        let purpose =
            Purpose { precision, format, keep, threads: self.threads(), in_bands: true, ..Purpose::default() };
        Plan::new(self.engine, scene, purpose).map_err(Failure::input)
    }

    fn threads(&self) -> usize {
        self.arguments.threads.map_or_else(|| available_parallelism().map_or(1, usize::from), usize::from)
    }
}

/// Renders a frame into its file, which gets its name when it is whole.
fn finish(frame: &Frame<'_>, mut image: ImageWriter) -> Result<(), Failure> {
    rayo::render_to_file(frame, &mut image, &|_| ()).map_err(|error| match error {
        RenderError::Image(_) => Failure::output(error),
        _ => Failure::input(error),
    })?;
    image.finish().map_err(Failure::output)
}
