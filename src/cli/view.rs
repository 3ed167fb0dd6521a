//! How a scene is read, and the options that change how it is seen: shared by all commands that take one.

use std::path::Path;
use std::str::FromStr;

use clap::Args;

use super::{Failure, colour_on_stderr, say};
use crate::scene::{self, Camera, Opened, Scene};

/// What takes the place of the scene's own camera, and shadows.
#[derive(Debug, Args)]
pub struct ViewArgs {
    /// The diagonal of the film, in the unit of the focal distance. Default: 1, as in the paper; old scenes need 35
    #[arg(long, value_name = "DIAGONAL", allow_negative_numbers = true)]
    film: Option<f32>,
    /// The focal distance, instead of the scene's
    #[arg(long, value_name = "DISTANCE", allow_negative_numbers = true)]
    focal: Option<f32>,
    /// The size in pixels, instead of the scene's; 800x or x600 keeps the shape
    #[arg(long, value_name = "WxH", allow_hyphen_values = true)]
    size: Option<Size>,
    /// Let objects cast shadows on each other, like `shadows = true` in TOML. The engines c and paper have none
    #[arg(long)]
    shadows: bool,
}

/// Width and height, as in 1632x1224, or one of them, as in 800x and x600.
#[derive(Clone, Copy, Debug)]
enum Size {
    Both(u32, u32),
    Width(u32),
    Height(u32),
}

impl FromStr for Size {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let size = text.split_once('x').and_then(|(width, height)| {
            Some(match (width, height) {
                (width, "") => Size::Width(width.parse().ok()?),
                ("", height) => Size::Height(height.parse().ok()?),
                (width, height) => Size::Both(width.parse().ok()?, height.parse().ok()?),
            })
        });
        size.ok_or("expected width and height in pixels, as in 1632x1224, or one of them, as in 800x or x600")
    }
}

impl Size {
    /// Width and height, of which the one that is not given keeps the shape of `camera`.
    fn of(self, camera: &Camera) -> (u32, u32) {
        // To the nearest, and 1 at least; what is too large stays too large.
        let other = |side: u32, of: u32, to: u32| {
            let doubled = 2 * u64::from(side) * u64::from(to) / u64::from(of);
            u32::try_from(doubled.div_ceil(2)).unwrap_or(u32::MAX).max(1)
        };
        match self {
            Size::Both(width, height) => (width, height),
            Size::Width(width) => (width, other(width, camera.width(), camera.height())),
            Size::Height(height) => (other(height, camera.height(), camera.width()), height),
        }
    }
}

impl ViewArgs {
    /// `camera` with what the arguments replace.
    fn camera(&self, camera: &Camera) -> Result<Camera, Failure> {
        let (width, height) = self.size.unwrap_or(Size::Both(camera.width(), camera.height())).of(camera);
        let focal = self.focal.unwrap_or(camera.focal());
        let film = self.film.unwrap_or(camera.film());
        Camera::new(width, height, focal, film).map_err(Failure::input)
    }

    /// The scene as it is to be seen.
    pub(super) fn seen(&self, mut scene: Scene) -> Result<Scene, Failure> {
        scene.camera = self.camera(&scene.camera)?;
        scene.shadows |= self.shadows;
        Ok(scene)
    }

    /// The scene of a file; a mesh alone gets a camera of these.
    pub(super) fn open(&self, path: &Path) -> Result<Opened, Failure> {
        open(path, &self.camera(&Camera::default())?)
    }
}

/// The scene of a file; a mesh alone is seen by `camera`.
pub(super) fn open(path: &Path, camera: &Camera) -> Result<Opened, Failure> {
    scene::open(path, camera).map_err(|error| Failure::input(error.render(colour_on_stderr())))
}

/// The scene, when all has been told of how it came to be, unless `quiet`, and of what is hardly meant in it.
pub(super) fn tell(Opened { scene, notes, warnings, .. }: Opened, quiet: bool) -> Scene {
    notes.iter().filter(|_| !quiet).for_each(|note| say(note));
    warnings.iter().for_each(|warning| say(&format!("warning: {warning}")));
    scene
}
