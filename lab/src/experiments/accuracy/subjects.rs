//! The scenes to measure: the shipped ones, each family at three degrees of ill-conditioning, or
//! the user's own.

use std::path::Path;

use crate::experiments::in_size;
use crate::families::{self, FAMILIES, Family};
use rayo::internals::scene::{self, Scene, SceneError, brief, shown};

/// The scenes that come with the program, which are ordinary ones.
const SHIPPED: [(&str, &[u8]); 5] = [
    ("sphere", include_bytes!("../../../../scenes/sphere.in")),
    ("tetrahedron", include_bytes!("../../../../scenes/tetrahedron.in")),
    ("triangle", include_bytes!("../../../../scenes/triangle.in")),
    ("two-lights", include_bytes!("../../../../scenes/two-lights.in")),
    ("many", include_bytes!("../../../../scenes/many.in")),
];
/// How many values of a family's parameter are measured.
const LEVELS: usize = 3;
/// For some families, which of their values to measure, and in which variant: those whose values
/// are not sorted by ill-conditioning, or some of whose values and variants show no error.
const CHOSEN: [(&str, [usize; LEVELS], usize); 5] = [
    // Variant 2 shows the short side of a tilted sliver. A sliver seen as a whole is thinner than a
    // pixel, and the t of one that is not tilted is a whole number, which every formula computes
    // exactly.
    ("T1", [0, 3, 7], 2),
    // Up to an angle of 1e-7; at an angle of 0 there is nothing to hit.
    ("T3", [0, 3, 6], 0),
    // An icosphere, a mesh whose vertices lie on rays, and a fan.
    ("T6", [0, 4, 6], 0),
    // A light at an ordinary place, near the surface, and 1e30 away.
    ("L1", [0, 4, 12], 0),
    // A sphere behind the camera, one across the camera's plane, and a ground whose centre is
    // behind the camera.
    ("S8", [0, 4, 6], 0),
];
/// The seed of the families' random numbers.
const SEED: u64 = 1;

/// Limits on the size of a picture.
#[derive(Clone, Copy, Debug)]
struct Size {
    /// The most pixels of a scene that has a size of its own.
    pixels: u64,
    /// The side of a family's square picture.
    side: u32,
    /// The most pairs of a ray and an object.
    tests: u64,
}

/// The limits of a quick run, and of a full one.
const SIZES: [Size; 2] =
    [Size { pixels: 160 * 120, side: 64, tests: 1 << 20 }, Size { pixels: 320 * 240, side: 192, tests: 1 << 23 }];

/// A scene to measure.
#[derive(Clone, Debug)]
pub struct Subject {
    pub name: String,
    pub family: Option<OfFamily>,
    /// The scene, with its picture reduced to the limits.
    pub scene: Scene,
}

/// A scene's place in a family.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OfFamily {
    pub id: &'static str,
    /// How ill-conditioned the scene is: 0 ordinary, 1 intermediate, 2 at whichever end of the
    /// range is farther from the ordinary value.
    pub stiffness: usize,
}

/// A scene that comes with the program, unchanged.
///
/// # Panics
/// If there is none of that name.
pub fn shipped(name: &str) -> Scene {
    let (_, text) = SHIPPED.iter().find(|(other, _)| *other == name).expect("the scene is one of ours");
    scene::parse(text, name).expect("a test has read it")
}

/// The shipped scenes, and three scenes of every family that all engines can trace.
pub fn all(quick: bool) -> Vec<Subject> {
    let size = SIZES[usize::from(!quick)];
    let shipped = SHIPPED.iter().map(|(name, _)| Subject {
        name: (*name).into(),
        family: None,
        scene: reduced(shipped(name), size),
    });
    shipped
        .chain(FAMILIES.iter().filter(|family| !family.has_shadows()).flat_map(|family| of_family(family, size)))
        .collect()
}

/// Why a name denotes nothing that can be measured.
#[derive(Debug, thiserror::Error)]
pub enum SubjectError {
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The name of neither a file nor a family.
    #[error(
        "there is neither a scene file nor a family `{}`; the families are {}",
        brief(.0),
        FAMILIES.iter().map(|family| family.id).collect::<Vec<_>>().join(", ")
    )]
    Unknown(String),
}

/// The scene of a file or, by its id, a family.
///
/// # Errors
/// If the file cannot be read or parsed, or if the name is neither of a file nor of a family.
pub fn named(name: &str, quick: bool) -> Result<Vec<Subject>, SubjectError> {
    let size = SIZES[usize::from(!quick)];
    let path = Path::new(name);
    match families::family(name) {
        Some(family) if !path.exists() => Ok(of_family(family, size)),
        None if !path.exists() && path.extension().is_none() => Err(SubjectError::Unknown(name.to_owned())),
        _ => {
            let scene = reduced(scene::read(name.as_ref())?, size);
            Ok(vec![Subject { name: shown(name), family: None, scene }])
        }
    }
}

/// Three scenes of a family: at its ordinary value, at the end of the range that is farther from
/// it, and at a value between. Values that no valid scene can have are left out.
fn of_family(family: &'static Family, size: Size) -> Vec<Subject> {
    let (ordinary, last) = (family.ordinary, family.levels.len() - 1);
    let end = if ordinary > last - ordinary { 0 } else { last };
    let chosen = CHOSEN.iter().find(|(id, ..)| *id == family.id).map(|(_, levels, variant)| (*levels, *variant));
    let (levels, variant) = chosen.unwrap_or(([ordinary, ordinary.midpoint(end), end], 0));
    let subjects = (0..LEVELS).filter_map(|stiffness| {
        let level = levels[stiffness];
        let new = !levels[..stiffness].contains(&level);
        let case = family.case(level * family.variants.len() + variant, SEED, size.side);
        let name = format!("{} {}", family.id, case.level);
        let family = Some(OfFamily { id: family.id, stiffness });
        (new && case.valid).then(|| Subject { name, family, scene: reduced(case.scene, size) })
    });
    subjects.collect()
}

/// The scene with a picture that is small enough for the limits.
fn reduced(scene: Scene, size: Size) -> Scene {
    let camera = scene.camera;
    let objects = (scene.spheres.len() + scene.triangle_count()).max(1) as u64;
    let most = size.pixels.min(size.tests.div_ceil(objects)).max(1);
    if camera.pixels() <= most {
        return scene;
    }
    let factor = (most as f64 / camera.pixels() as f64).sqrt();
    let side = |pixels: u32| ((f64::from(pixels) * factor) as u32).max(1);
    in_size(&scene, side(camera.width()), side(camera.height()))
}
