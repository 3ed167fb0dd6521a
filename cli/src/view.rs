//! The options for the camera and for models without a scene file, and reading a scene with them.
//! Shared by all commands that take a scene.

use std::collections::BTreeSet;
use std::path::Path;
use std::str::FromStr;
use std::sync::{Mutex, PoisonError};

use clap::Args;
use glam::{DVec3, Vec3};

use super::development::colour;
use super::number::{length, single, whole};
use super::{Failure, colour_on_stderr, say};
use rayo::internals::scene::{
    self, Camera, MeshFormat, ModelOptions, MovingCamera, Opened, Scene, SceneFormat, UpAxis, View, shown,
};

/// What takes the place of the scene's own camera, and shadows; and how a file is seen that has no
/// camera.
#[derive(Debug, Args)]
pub struct ViewArgs {
    /// The diagonal of the film, in the unit of the focal distance. Default: 1, as in the paper;
    /// old scenes need 35
    #[arg(long, value_name = "DIAGONAL", value_parser = length, allow_hyphen_values = true)]
    film: Option<f32>,
    /// The focal distance, instead of the scene's
    #[arg(long, value_name = "DISTANCE", value_parser = length, allow_hyphen_values = true)]
    focal: Option<f32>,
    /// The angle that a column of the picture sees, in degrees, instead of --film
    #[arg(long, value_name = "DEGREES", value_parser = degrees, allow_hyphen_values = true, conflicts_with = "film")]
    fov: Option<f64>,
    /// The size in pixels, instead of the scene's; 800x or x600 keeps the shape
    #[arg(long, value_name = "WxH", allow_hyphen_values = true)]
    size: Option<Size>,
    /// Where the camera stands in the world, instead of where the scene says
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    position: Option<Place>,
    /// What is in the middle of the picture, instead of what the scene says
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    look_at: Option<Place>,
    /// What points upwards in the picture, instead of what the scene says; or an axis, such as z or
    /// -y: of a mesh, a molecule or points alone the axis of the file that stands upright, as z
    /// does in models of CAD
    #[arg(long, value_name = "X,Y,Z|AXIS", allow_hyphen_values = true)]
    up: Option<Up>,
    /// The side from which a mesh, a molecule or points alone are seen as a whole: a direction in
    /// the file's own axes
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, conflicts_with = "position")]
    from: Option<Direction>,
    /// The side from which a mesh, a molecule or points alone are lit, instead of the left above
    /// the camera: a direction in the file's own axes. Given several times, the lights share the
    /// light
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    light: Vec<Direction>,
    /// How much of the light of a mesh, a molecule or points alone, which is 1 in all, comes from
    /// the camera and leaves no side black. Default: 0.2
    #[arg(long, value_name = "SHARE", value_parser = share, allow_hyphen_values = true)]
    ambient: Option<f32>,
    /// A factor on the colours of a mesh, a molecule or points alone, which are white where the
    /// file has none: linear red, green and blue, or '#rrggbb' in sRGB
    #[arg(long, value_name = "R,G,B|#rrggbb", value_parser = colour, allow_hyphen_values = true)]
    colour: Option<[f32; 3]>,
    /// The radius of all points of a cloud, or atoms of a molecule; the vertices of a PLY file
    /// become points. Default: the file's own, the van der Waals radii of atoms, or what suits the
    /// number of points
    #[arg(long, value_name = "RADIUS", value_parser = radius, allow_hyphen_values = true)]
    radius: Option<f32>,
    /// The frame of an .xyz file, or the model of a .pdb or .cif file, counted from 1. Default: the
    /// first
    #[arg(long, value_name = "N", value_parser = whole(1..=usize::MAX), allow_hyphen_values = true)]
    frame: Option<usize>,
    /// Let objects cast shadows on each other, like `shadows = true` in TOML. The engines c and
    /// paper have none
    #[arg(long)]
    shadows: bool,
}

/// A point or a direction in the world.
#[derive(Clone, Copy, Debug)]
struct Place(DVec3);

impl FromStr for Place {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let numbers: Option<Vec<f64>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
        match numbers.as_deref() {
            Some(&[x, y, z]) if [x, y, z].iter().all(|number| number.is_finite()) => Ok(Place(DVec3::new(x, y, z))),
            _ => Err("expected three numbers, as in 1,2.5,-3"),
        }
    }
}

/// The upward direction: a vector in the world, or an axis of a file.
#[derive(Clone, Copy, Debug)]
enum Up {
    Direction(DVec3),
    Axis(UpAxis),
}

impl FromStr for Up {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if let Ok(axis) = text.parse() {
            return Ok(Up::Axis(axis));
        }
        let Place(direction) =
            text.parse().map_err(|_| "expected three numbers, as in 1,2.5,-3, or an axis, as in z")?;
        Ok(Up::Direction(direction))
    }
}

/// A direction; not the zero vector.
#[derive(Clone, Copy, Debug)]
struct Direction(DVec3);

impl FromStr for Direction {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let Place(direction) = text.parse()?;
        let direction = direction.try_normalize().map(|_| Direction(direction));
        direction.ok_or("expected a direction: three numbers that are not all 0, as in 1,1,0.5")
    }
}

fn degrees(text: &str) -> Result<f64, &'static str> {
    let angle = text.trim().parse().ok().filter(|angle: &f64| *angle > 0.0 && *angle < 180.0);
    angle.ok_or("expected an angle in degrees, greater than 0 and less than 180")
}

fn share(text: &str) -> Result<f32, &'static str> {
    single(text).filter(|share| (0.0..=1.0).contains(share)).ok_or("expected a number from 0 to 1")
}

fn radius(text: &str) -> Result<f32, &'static str> {
    let radius = single(text).filter(|radius| *radius > 0.0 && radius.is_finite());
    radius.ok_or("expected a number greater than 0, from 1e-45 to 3.4e38")
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
    /// Width and height; if only one is given, the other keeps the aspect ratio of `camera`.
    fn of(self, camera: &Camera) -> (u32, u32) {
        // Rounded to nearest, but at least 1. Too large values saturate and are rejected later.
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
    /// Whether --shadows is given.
    pub(super) fn shadows(&self) -> bool {
        self.shadows
    }

    /// `camera` with the changes that the arguments ask for.
    pub(super) fn camera(&self, camera: &Camera) -> Result<Camera, Failure> {
        let (width, height) = self.size.unwrap_or(Size::Both(camera.width(), camera.height())).of(camera);
        let focal = self.focal.unwrap_or(camera.focal());
        let film = self.film.unwrap_or(camera.film());
        let camera = Camera::new(width, height, focal, film).map_err(Failure::input)?;
        self.fov.map_or(Ok(camera), |fov| camera.with_field_of_view(fov)).map_err(Failure::input)
    }

    /// The options for files without a camera.
    pub(super) fn model_options(&self) -> Result<ModelOptions, Failure> {
        Ok(ModelOptions {
            camera: self.camera(&Camera::default())?,
            up: if let Some(Up::Axis(axis)) = self.up { Some(axis) } else { None },
            from: self.from.map(|Direction(from)| from),
            lights: self.light.iter().map(|Direction(light)| *light).collect(),
            ambient: self.ambient,
            colour: self.colour.map_or(Vec3::ONE, Vec3::from_array),
            radius: self.radius,
            frame: self.frame,
            threads: 1,
        })
    }

    /// Fails if an option does not apply to a file with this name.
    pub(super) fn suit(&self, path: &Path) -> Result<(), Failure> {
        let format = SceneFormat::from_path(path);
        let is_scene = !matches!(format, Some(SceneFormat::Mesh(_) | SceneFormat::Cloud(_)));
        let is_cloud = matches!(format, Some(SceneFormat::Cloud(_)));
        let may_have_points = is_cloud || format == Some(SceneFormat::Mesh(MeshFormat::Ply));
        let given = [
            ("--from", self.from.is_some() && is_scene, "a mesh, a molecule or points alone"),
            ("--light", !self.light.is_empty() && is_scene, "a mesh, a molecule or points alone"),
            ("--ambient", self.ambient.is_some() && is_scene, "a mesh, a molecule or points alone"),
            ("--colour", self.colour.is_some() && is_scene, "a mesh, a molecule or points alone"),
            ("--radius", self.radius.is_some() && !may_have_points, "atoms and points: .xyz, .pdb, .cif and .ply"),
            ("--frame", self.frame.is_some() && !is_cloud, "files of several frames or models: .xyz, .pdb and .cif"),
        ];
        let unsuited = given.iter().find(|(_, is_unsuited, _)| *is_unsuited);
        unsuited.map_or(Ok(()), |(option, _, what)| {
            Err(Failure::input(format!("{option} is for {what}, and {} is something else", shown(path))))
        })
    }

    /// The name of the first of the options that is given.
    pub(super) fn given(&self) -> Option<&'static str> {
        let all = [
            ("--film", self.film.is_some()),
            ("--fov", self.fov.is_some()),
            ("--focal", self.focal.is_some()),
            ("--size", self.size.is_some()),
            ("--position", self.position.is_some()),
            ("--look-at", self.look_at.is_some()),
            ("--up", self.up.is_some()),
            ("--from", self.from.is_some()),
            ("--light", !self.light.is_empty()),
            ("--ambient", self.ambient.is_some()),
            ("--colour", self.colour.is_some()),
            ("--radius", self.radius.is_some()),
            ("--frame", self.frame.is_some()),
            ("--shadows", self.shadows),
        ];
        all.iter().find(|(_, is_given)| *is_given).map(|(name, _)| *name)
    }

    /// The scene with the camera and shadows that the arguments ask for.
    pub(super) fn seen(&self, mut scene: Scene) -> Result<Scene, Failure> {
        scene.camera = self.camera(&scene.camera)?;
        scene.shadows |= self.shadows;
        Ok(scene)
    }

    /// Reads the scene of a file with up to this many threads. A file without a camera gets one by
    /// the arguments.
    pub(super) fn open(&self, path: &Path, threads: usize) -> Result<Opened, Failure> {
        self.suit(path)?;
        let opened = scene::open_with(path, &ModelOptions { threads, ..self.model_options()? });
        let mut opened = opened.map_err(|error| Failure::input(error.render(colour_on_stderr())))?;
        if let Some(view) = self.view(path, opened.scene.view) {
            let mut moving = MovingCamera::of(&opened.scene).carrying_light(opened.carried_light);
            opened.scene = moving.seen_from(view).cloned().map_err(Failure::input)?;
        }
        Ok(opened)
    }

    /// The view that the arguments ask for; what they do not give is as in the scene's `own` view.
    /// None if they change nothing.
    pub(super) fn view(&self, path: &Path, own: View) -> Option<View> {
        let or_own = |given: Option<Place>, own: DVec3| given.map_or(own, |Place(place)| place);
        // For a model without a scene file, an axis has been used as the file's upward axis
        // already.
        let is_alone = matches!(SceneFormat::from_path(path), Some(SceneFormat::Mesh(_) | SceneFormat::Cloud(_)));
        let up = match self.up {
            Some(Up::Direction(up)) => Some(up),
            Some(Up::Axis(axis)) if !is_alone => Some(axis.direction()),
            _ => None,
        };
        let moves = self.position.is_some() || self.look_at.is_some() || up.is_some();
        moves.then(|| View {
            position: or_own(self.position, own.position),
            look_at: or_own(self.look_at, own.look_at),
            up: up.unwrap_or(own.up),
        })
    }
}

/// Prints the warnings about a scene and, unless `quiet`, its notes; returns the scene.
pub(super) fn tell(Opened { scene, notes, warnings, .. }: Opened, quiet: bool) -> Scene {
    notes.iter().filter(|note| !quiet && is_new(note)).for_each(|note| say(&format!("note: {note}")));
    warnings.iter().for_each(|warning| say(&format!("warning: {warning}")));
    scene
}

/// Whether a note has not been printed before: notes that name no file apply to all files that are
/// read.
fn is_new(note: &str) -> bool {
    static TOLD: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
    TOLD.lock().unwrap_or_else(PoisonError::into_inner).insert(note.to_owned())
}
