//! From a file without a camera to a scene: which way is up, from where it is seen, and its lights.

use std::fmt;
use std::str::FromStr;

use glam::{DAffine3, DVec3, Vec3};

use super::mesh::{FileCamera, FileLight, Mesh, MeshFormat, Placement};
use super::{Camera, Faces, Light, MovedFaces, Scene, Sphere, View};

/// What is asked of a file that has no camera of its own, a mesh or a molecule alone, in place of
/// what is usual. Directions are in the file's own axes.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelOptions {
    /// The size of the picture, the focal distance and the film.
    pub camera: Camera,
    /// The file's axis that stands upright. Default: y, but z in STL files and clouds of points in
    /// XYZ.
    pub up: Option<UpAxis>,
    /// The direction to the camera, which sees all of the file. Default: to the front, the right
    /// and above, or the file's own camera.
    pub from: Option<DVec3>,
    /// The directions to its lights. Default: one at the left above the camera, or the file's own
    /// lights.
    pub lights: Vec<DVec3>,
    /// How much of the light, which is 1 in all, comes from the camera and leaves no side black.
    /// Default: 0.2.
    pub ambient: Option<f32>,
    /// A factor on the colours of all objects.
    pub colour: Vec3,
    /// The radius of all points or atoms. Default: the file's own, atoms' van der Waals radii, or
    /// what suits their number.
    pub radius: Option<f32>,
    /// The number of the frame, or model, of several in a file, counted from 1. Default: the first.
    pub frame: Option<usize>,
    /// How many threads may read a long text, in OBJ or in the paper's format: the scene is the
    /// same. Default: 1.
    pub threads: usize,
}

impl ModelOptions {
    /// Nothing but a camera.
    pub fn of(camera: Camera) -> Self {
        ModelOptions {
            camera,
            up: None,
            from: None,
            lights: Vec::new(),
            ambient: None,
            colour: Vec3::ONE,
            radius: None,
            frame: None,
            threads: 1,
        }
    }
}

/// An axis of a file that stands upright.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpAxis {
    /// To the right in most files.
    X,
    /// The opposite of x.
    NegativeX,
    /// As in most files for pictures.
    Y,
    /// The opposite of y.
    NegativeY,
    /// As in files of CAD and of maps.
    Z,
    /// The opposite of z.
    NegativeZ,
}

impl UpAxis {
    /// The axes by their names.
    const NAMES: [(&str, UpAxis); 6] = [
        ("x", UpAxis::X),
        ("-x", UpAxis::NegativeX),
        ("y", UpAxis::Y),
        ("-y", UpAxis::NegativeY),
        ("z", UpAxis::Z),
        ("-z", UpAxis::NegativeZ),
    ];

    /// How a file of right-handed axes stands in the world, which is left-handed and has y upright.
    pub fn placement(self) -> Placement {
        let rotate = match self {
            UpAxis::X => DVec3::new(0.0, 0.0, 90.0),
            UpAxis::NegativeX => DVec3::new(0.0, 0.0, -90.0),
            UpAxis::Y => DVec3::ZERO,
            UpAxis::NegativeY => DVec3::new(0.0, 0.0, 180.0),
            UpAxis::Z => DVec3::new(90.0, 0.0, 0.0),
            UpAxis::NegativeZ => DVec3::new(-90.0, 0.0, 0.0),
        };
        Placement { scale: DVec3::new(1.0, 1.0, -1.0), rotate, translate: DVec3::ZERO }
    }

    /// The axis as a direction.
    pub fn direction(self) -> DVec3 {
        match self {
            UpAxis::X => DVec3::X,
            UpAxis::NegativeX => DVec3::NEG_X,
            UpAxis::Y => DVec3::Y,
            UpAxis::NegativeY => DVec3::NEG_Y,
            UpAxis::Z => DVec3::Z,
            UpAxis::NegativeZ => DVec3::NEG_Z,
        }
    }
}

impl FromStr for UpAxis {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let name = text.strip_prefix('+').unwrap_or(text).to_ascii_lowercase();
        let known = UpAxis::NAMES.iter().find(|(known, _)| *known == name);
        known.map(|(_, axis)| *axis).ok_or("expected an axis: x, y, z, -x, -y or -z")
    }
}

impl fmt::Display for UpAxis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = UpAxis::NAMES.iter().find(|(_, axis)| axis == self).map_or("", |(name, _)| name);
        f.write_str(name)
    }
}

/// A light in a world.
pub(super) struct WorldLight {
    pub intensity: f32,
    pub colour: Vec3,
    pub position: DVec3,
}

/// A light of which only the share in all light is known.
pub(super) struct KeyLight {
    /// Its strength beside the others.
    pub strength: f64,
    pub colour: Vec3,
    pub position: DVec3,
}

impl KeyLight {
    fn white(position: DVec3) -> Self {
        KeyLight { strength: 1.0, colour: Vec3::ONE, position }
    }
}

/// The way from a file alone to a scene: how it stands in the world, from where it is seen, and its
/// lights.
pub struct Setting {
    /// The file in the world.
    pub placement: Placement,
    /// The size of the picture, the focal distance and the film.
    pub camera: Camera,
    /// The camera's place.
    pub view: View,
    /// A factor on the colours of all objects.
    pub colour: Vec3,
    /// Whether objects cast shadows on each other.
    pub shadows: bool,
    pub(super) lights: Vec<WorldLight>,
    /// The index of the light at the camera, which a camera that moves takes with it; None if there
    /// is none.
    pub fill_light: Option<usize>,
}

/// What is to be seen whole.
enum Extent<'a> {
    Points(&'a [Vec3]),
    Spheres(&'a [Sphere]),
}

/// A file's own camera and lights.
#[derive(Default)]
struct OfFile<'a> {
    camera: Option<FileCamera>,
    lights: &'a [FileLight],
}

impl Setting {
    /// The share of the light at the camera, the fill light. All lights together have 1, so that
    /// nothing that is not brighter than white is clipped, wherever they shine from; what is in the
    /// shadow of all others has a fifth of the light, which is 49 % grey on the sRGB curve.
    const FILL: f32 = 0.2;

    /// For a mesh of a format: it stands upright, is seen whole, and lit from the left above the
    /// camera, and from the camera.
    ///
    /// Nothing where its size is beyond numbers.
    pub fn of(mesh: &Mesh, format: MeshFormat, camera: &Camera) -> Option<Setting> {
        Setting::of_mesh(mesh, format, &ModelOptions::of(*camera))
    }

    /// The same, in place of which the options may ask for something else.
    pub fn of_mesh(mesh: &Mesh, format: MeshFormat, options: &ModelOptions) -> Option<Setting> {
        let placement = options.up.unwrap_or(format.up_axis()).placement();
        let of_file = OfFile { camera: mesh.camera, lights: &mesh.lights };
        Setting::around(&Extent::Points(&mesh.used()), mesh.origin, placement, &of_file, options)
    }

    /// For spheres, which are relative to an origin in the coordinates of their file.
    pub fn of_spheres(spheres: &[Sphere], origin: DVec3, up: UpAxis, options: &ModelOptions) -> Option<Setting> {
        let placement = options.up.unwrap_or(up).placement();
        Setting::around(&Extent::Spheres(spheres), origin, placement, &OfFile::default(), options)
    }

    fn around(
        extent: &Extent<'_>,
        origin: DVec3,
        placement: Placement,
        of_file: &OfFile<'_>,
        options: &ModelOptions,
    ) -> Option<Setting> {
        let to_world = placement.to_world();
        let mut framed = framing(extent, to_world, options)?;
        if origin != DVec3::ZERO {
            // Seen from near the origin, where no digits are lost; it is moved there as a whole.
            let origin = to_world.transform_point3(origin);
            framed.position += origin;
            framed.look_at += origin;
        }
        let middle = framed.look_at;
        let (view, camera) = match of_file.camera.filter(|_| options.from.is_none()) {
            Some(own) => (own.view(to_world), own.lens(&options.camera).ok()?),
            None => (framed, options.camera),
        };
        let to_camera = view.to_camera().ok()?;
        let away = view.position.distance(middle);
        let key_lights = if !options.lights.is_empty() {
            // Twice as far away as a camera that sees all is outside of it.
            let away = 2.0 * framed.position.distance(middle);
            let place = |light: &DVec3| Some(middle + to_world.matrix3 * light.try_normalize()? * away);
            let places: Option<Vec<DVec3>> = options.lights.iter().map(place).collect();
            places?.into_iter().map(KeyLight::white).collect()
        } else if !of_file.lights.is_empty() {
            of_file.lights.iter().map(|light| light.in_world(to_world, middle)).collect()
        } else {
            let position = view.position + to_camera.linear.transpose() * (DVec3::new(-0.8, 1.0, -0.3) * away);
            vec![KeyLight::white(position)]
        };
        let (lights, fill_light) = shared(&key_lights, view.position, options.ambient.unwrap_or(Self::FILL));
        let are_finite = lights.iter().all(|light| light.position.as_vec3().is_finite());
        let (colour, shadows) = (options.colour, false);
        are_finite.then_some(Setting { placement, camera, view, colour, shadows, lights, fill_light })
    }

    /// The same from another view, to which the light at the camera goes along.
    #[must_use]
    pub fn seen_from(mut self, view: View) -> Setting {
        self.view = view;
        if let Some(fill_light) = self.fill_light {
            self.lights[fill_light].position = view.position;
        }
        self
    }

    /// The scene of this mesh in the camera's frame; nothing where it leaves the range of f32.
    pub fn scene(&self, mesh: Mesh, name: String) -> Option<Scene> {
        let MovedFaces { faces, .. } = self.placed(mesh)?;
        self.scene_of_faces(faces, name)
    }

    /// A mesh in the camera's frame; nothing where it leaves the range of f32.
    pub(super) fn placed(&self, mesh: Mesh) -> Option<MovedFaces> {
        mesh.moved(self.view.to_camera().ok()?.of_placed(&self.placement), self.colour)
    }

    /// The scene of a mesh that is placed.
    pub(super) fn scene_of_faces(&self, faces: Faces, name: String) -> Option<Scene> {
        Some(Scene { faces, ..self.empty_scene(name)? })
    }

    /// The scene of these spheres, as [`scene`](Self::scene).
    #[cfg(feature = "files")]
    pub fn scene_of_spheres(&self, spheres: Vec<Sphere>, origin: DVec3, name: String) -> Option<Scene> {
        let map = self.view.to_camera().ok()?.of_placed(&self.placement);
        let spheres = super::cloud::placed(spheres, origin, map, self.colour)?;
        Some(Scene { spheres, ..self.empty_scene(name)? })
    }

    /// The lights in the camera's frame, and no object.
    fn empty_scene(&self, name: String) -> Option<Scene> {
        let to_camera = self.view.to_camera().ok()?;
        let in_frame = |light: &WorldLight| {
            let position = to_camera.point(light.position).as_vec3();
            Light { intensity: light.intensity, colour: light.colour, position }
        };
        let lights = self.lights.iter().map(in_frame).collect();
        Some(Scene { name, lights, shadows: self.shadows, view: self.view, ..Scene::new(self.camera) })
    }
}

/// The view that sees all from the direction that is asked for, or else from the front, the right
/// and above.
fn framing(extent: &Extent<'_>, to_world: DAffine3, options: &ModelOptions) -> Option<View> {
    let eye = match options.from {
        Some(from) => to_world.matrix3 * from.try_normalize()?,
        None => DVec3::new(0.55, 0.5, -1.0).normalize(),
    };
    let camera = &options.camera;
    Some(match extent {
        Extent::Points(points) => View::framing(points, |point| (*point, 0.0), to_world, camera, eye),
        Extent::Spheres(spheres) => {
            View::framing(spheres, |sphere| (sphere.centre, sphere.radius), to_world, camera, eye)
        }
    })
}

/// Lights that have 1 together with the fill light at the camera, and the index of that. None of
/// them is without light.
fn shared(key_lights: &[KeyLight], camera: DVec3, fill: f32) -> (Vec<WorldLight>, Option<usize>) {
    let all: f64 = key_lights.iter().map(|light| light.strength).sum();
    let rest = f64::from(1.0 - fill);
    let mut lights = Vec::new();
    for &KeyLight { strength, colour, position } in key_lights {
        let share = if all > 0.0 && all.is_finite() { strength / all } else { 1.0 / key_lights.len() as f64 };
        lights.push(WorldLight { intensity: (rest * share) as f32, colour, position });
    }
    lights.retain(|light| light.intensity > 0.0);
    // No shadow of a light at the camera can be seen from there.
    let fill_light = (fill > 0.0).then_some(lights.len());
    if fill_light.is_some() {
        lights.push(WorldLight { intensity: fill, colour: Vec3::ONE, position: camera });
    }
    (lights, fill_light)
}
