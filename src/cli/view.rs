//! How a scene is read, and the options that replace parts of its camera: the same wherever there is one.

use std::path::Path;
use std::str::FromStr;

use clap::Args;

use super::{Failure, colour_on_stderr, say};
use crate::scene::{self, Camera, Opened, Scene};

/// What takes the place of the scene's own camera.
#[derive(Debug, Args)]
pub struct ViewArgs {
    /// The diagonal of the film, in the units of the focal distance. Default: 1, as in the paper; old scenes want 35
    #[arg(long, value_name = "DIAGONAL", allow_negative_numbers = true)]
    film: Option<f32>,
    /// The focal distance, in place of the scene's
    #[arg(long, value_name = "DISTANCE", allow_negative_numbers = true)]
    focal: Option<f32>,
    /// The size in pixels, in place of the scene's
    #[arg(long, value_name = "WxH", allow_hyphen_values = true)]
    size: Option<Size>,
}

/// Width and height, as in 1632x1224.
#[derive(Clone, Copy, Debug)]
struct Size {
    width: u32,
    height: u32,
}

impl FromStr for Size {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let sides = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
        let (width, height) = sides.ok_or("expected width and height in pixels, as in 1632x1224")?;
        Ok(Size { width, height })
    }
}

impl ViewArgs {
    /// `camera` with what the arguments replace.
    pub(super) fn camera(&self, camera: &Camera) -> Result<Camera, Failure> {
        let size = self.size.unwrap_or(Size { width: camera.width(), height: camera.height() });
        let focal = self.focal.unwrap_or(camera.focal());
        let film = self.film.unwrap_or(camera.film());
        Camera::new(size.width, size.height, focal, film).map_err(Failure::input)
    }

    /// The scene of a file; a mesh alone is seen by a camera with these options.
    pub(super) fn open(&self, path: &Path) -> Result<Opened, Failure> {
        open(path, &self.camera(&Camera::default())?)
    }
}

/// The scene of a file; a mesh alone is seen by `camera`.
pub(super) fn open(path: &Path, camera: &Camera) -> Result<Opened, Failure> {
    scene::open(path, camera).map_err(|error| Failure::input(error.render(colour_on_stderr())))
}

/// The scene, when all has been told of how it came to be, unless `quiet`, and of what is hardly meant in it.
pub(super) fn tell(Opened { scene, notes, warnings }: Opened, quiet: bool) -> Scene {
    notes.iter().filter(|_| !quiet).for_each(|note| say(note));
    warnings.iter().for_each(|warning| say(&format!("warning: {warning}")));
    scene
}
