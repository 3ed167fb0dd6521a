//! The setting for a file without a camera: which way is up, the position of the camera, and the
//! lights.

use std::fmt;
use std::str::FromStr;

use glam::{DAffine3, DVec3, Vec3};

use super::mesh::{FileCamera, FileLight, Mesh, MeshFormat, Placement};
use super::{Camera, Faces, Light, MovedFaces, Scene, Sphere, View};

/// Options for a mesh, molecule or point cloud without a scene file: each replaces what would be
/// chosen by default. Directions are in the file's own coordinates.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelOptions {
    /// The size of the picture, the focal distance and the film.
    pub camera: Camera,
    /// The axis of the file that points upwards. Default: y, or z in STL files and in point clouds
    /// in XYZ.
    pub up: Option<UpAxis>,
    /// The direction from the model to the camera, which is placed such that it sees all of the
    /// model. Default: the file's own camera, or else to the front, the right and above.
    pub from: Option<DVec3>,
    /// The directions from the model to its lights. Default: the file's own lights, or else one at
    /// the left above the camera.
    pub lights: Vec<DVec3>,
    /// The share of the light that comes from the position of the camera, so that no visible side
    /// is black. All lights together have 1. Default: 0.2.
    pub ambient: Option<f32>,
    /// A factor on the colours of all objects.
    pub colour: Vec3,
    /// The radius of all points or atoms. Default: the radii of the file, atoms' van der Waals
    /// radii, or a radius that suits the number of points.
    pub radius: Option<f32>,
    /// The number, from 1, of the frame or model to read from a file with several. Default: the
    /// first.
    pub frame: Option<usize>,
    /// How many threads may read a long text, in OBJ or in the paper's format. The scene does not
    /// depend on it. Default: 1.
    pub threads: usize,
}

impl ModelOptions {
    /// The default options for a camera.
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

/// The axis of a file's coordinates that points upwards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpAxis {
    /// The axis to the right in most files.
    X,
    /// The opposite of x.
    NegativeX,
    /// Upwards in most files for graphics.
    Y,
    /// The opposite of y.
    NegativeY,
    /// Upwards in files of CAD and in maps.
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

    /// The placement, in the left-handed world with y up, of a file with right-handed coordinates.
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

/// A light in world coordinates.
pub(super) struct WorldLight {
    pub intensity: f32,
    pub colour: Vec3,
    pub position: DVec3,
}

/// A light whose share of all light is still to be computed.
pub(super) struct KeyLight {
    /// Its strength relative to the other lights.
    pub strength: f64,
    pub colour: Vec3,
    pub position: DVec3,
}

impl KeyLight {
    fn white(position: DVec3) -> Self {
        KeyLight { strength: 1.0, colour: Vec3::ONE, position }
    }
}

/// How a model without a scene file becomes a scene: its placement in the world, the camera and the
/// lights.
pub struct Setting {
    /// The placement of the file's coordinates in the world.
    pub placement: Placement,
    /// The size of the picture, the focal distance and the film.
    pub camera: Camera,
    /// The position and orientation of the camera.
    pub view: View,
    /// A factor on the colours of all objects.
    pub colour: Vec3,
    /// Whether objects cast shadows on each other.
    pub shadows: bool,
    pub(super) lights: Vec<WorldLight>,
    /// The index of the fill light at the camera, which moves with the camera; None if there is
    /// none.
    pub fill_light: Option<usize>,
}

/// The points or spheres that the camera has to see.
enum Extent<'a> {
    Points(&'a [Vec3]),
    Spheres(&'a [Sphere]),
}

/// The camera and lights that a file provides.
#[derive(Default)]
struct OfFile<'a> {
    camera: Option<FileCamera>,
    lights: &'a [FileLight],
}

impl Setting {
    /// The default share of the fill light, the one at the camera. All lights together have 1, so
    /// that no surface of a colour up to white is clipped, whatever the directions of the lights. A
    /// surface in the shadow of all other lights gets a fifth of the light, which is 49 % grey on
    /// the sRGB curve.
    const FILL: f32 = 0.2;

    /// The setting for a mesh of a format: upright, with all of it visible, and lit from the left
    /// above the camera and from the camera.
    ///
    /// None if coordinates are so large that no camera can see all of it.
    pub fn of(mesh: &Mesh, format: MeshFormat, camera: &Camera) -> Option<Setting> {
        Setting::of_mesh(mesh, format, &ModelOptions::of(*camera))
    }

    /// As [`of`](Self::of), with options.
    pub fn of_mesh(mesh: &Mesh, format: MeshFormat, options: &ModelOptions) -> Option<Setting> {
        let placement = options.up.unwrap_or(format.up_axis()).placement();
        let of_file = OfFile { camera: mesh.camera, lights: &mesh.lights };
        Setting::around(&Extent::Points(&mesh.used()), mesh.origin, placement, &of_file, options)
    }

    /// The setting for spheres, whose centres are relative to `origin` in the coordinates of their
    /// file.
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
            // The view was computed relative to `origin`, where no digits are lost; shift it as a
            // whole.
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
            // Twice the distance of the camera, which itself is outside of the model.
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

    /// The setting from another view. The light at the camera moves along.
    #[must_use]
    pub fn seen_from(mut self, view: View) -> Setting {
        self.view = view;
        if let Some(fill_light) = self.fill_light {
            self.lights[fill_light].position = view.position;
        }
        self
    }

    /// The scene of this mesh in camera coordinates; None if a coordinate overflows f32.
    pub fn scene(&self, mesh: Mesh, name: String) -> Option<Scene> {
        let MovedFaces { faces, .. } = self.placed(mesh)?;
        self.scene_of_faces(faces, name)
    }

    /// The mesh in camera coordinates; None if a coordinate overflows f32.
    pub(super) fn placed(&self, mesh: Mesh) -> Option<MovedFaces> {
        mesh.moved(self.view.to_camera().ok()?.of_placed(&self.placement), self.colour)
    }

    /// The scene of faces that are in camera coordinates already.
    pub(super) fn scene_of_faces(&self, faces: Faces, name: String) -> Option<Scene> {
        Some(Scene { faces, ..self.empty_scene(name)? })
    }

    /// The scene of these spheres; None as for [`scene`](Self::scene).
    #[cfg(feature = "files")]
    pub fn scene_of_spheres(&self, spheres: Vec<Sphere>, origin: DVec3, name: String) -> Option<Scene> {
        let map = self.view.to_camera().ok()?.of_placed(&self.placement);
        let spheres = super::cloud::placed(spheres, origin, map, self.colour)?;
        Some(Scene { spheres, ..self.empty_scene(name)? })
    }

    /// The scene with the lights in camera coordinates, but without objects.
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

/// The view that shows everything from the direction that the options ask for, or else from the
/// front, the right and above.
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

/// The lights such that they and the fill light at the camera have 1 together, and the index of the
/// fill light. Lights without strength are left out.
fn shared(key_lights: &[KeyLight], camera: DVec3, fill: f32) -> (Vec<WorldLight>, Option<usize>) {
    let all: f64 = key_lights.iter().map(|light| light.strength).sum();
    let rest = f64::from(1.0 - fill);
    let mut lights = Vec::new();
    for &KeyLight { strength, colour, position } in key_lights {
        let share = if all > 0.0 && all.is_finite() { strength / all } else { 1.0 / key_lights.len() as f64 };
        lights.push(WorldLight { intensity: (rest * share) as f32, colour, position });
    }
    lights.retain(|light| light.intensity > 0.0);
    // The light at the camera casts no shadow that is visible from the camera.
    let fill_light = (fill > 0.0).then_some(lights.len());
    if fill_light.is_some() {
        lights.push(WorldLight { intensity: fill, colour: Vec3::ONE, position: camera });
    }
    (lights, fill_light)
}
