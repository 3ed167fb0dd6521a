//! Which scenes are measured: the shipped ones, each family at three levels of stiffness, or those of the user.

use std::path::Path;

use crate::experiments::in_size;
use crate::scene::families::{FAMILIES, Family};
use crate::scene::{self, Scene, SceneError, shown};

/// The scenes that come with the program, ordinary ones.
const SHIPPED: [(&str, &[u8]); 5] = [
    ("sphere", include_bytes!("../../../scenes/sphere.in")),
    ("tetrahedron", include_bytes!("../../../scenes/tetrahedron.in")),
    ("triangle", include_bytes!("../../../scenes/triangle.in")),
    ("two-lights", include_bytes!("../../../scenes/two-lights.in")),
    ("many", include_bytes!("../../../scenes/many.in")),
];
/// How many values of a family's parameter are taken.
const LEVELS: usize = 3;
/// Families whose levels are not in the order of stiffness, or not all of whose levels and variants have something to be
/// hit: those that are taken.
const CHOSEN: [(&str, [usize; LEVELS], usize); 5] = [
    // The short side, tilted: all of a sliver is thinner than a pixel, and upright its t is a whole number.
    ("T1", [0, 3, 7], 2),
    // Up to 1e-7; at 0 there is nothing to hit.
    ("T3", [0, 3, 6], 0),
    // An icosphere, a mesh with its vertices on rays, a fan.
    ("T6", [0, 4, 6], 0),
    // Ordinary, near the surface, 1e30 away.
    ("L1", [0, 4, 12], 0),
    // Behind, straddling the camera's plane, a ground that is centred behind.
    ("S8", [0, 4, 6], 0),
];
/// Where the families' random numbers begin.
const SEED: u64 = 1;

/// How large a picture may be.
#[derive(Clone, Copy, Debug)]
struct Size {
    /// The most pixels of a scene's own picture.
    pixels: u64,
    /// The side of a family's.
    side: u32,
    /// The most rays against objects.
    tests: u64,
}

/// Of a quick run, and of any other.
const SIZES: [Size; 2] =
    [Size { pixels: 160 * 120, side: 64, tests: 1 << 20 }, Size { pixels: 320 * 240, side: 192, tests: 1 << 23 }];

/// A scene to measure.
#[derive(Clone, Debug)]
pub struct Subject {
    pub name: String,
    pub family: Option<OfFamily>,
    /// The scene, its camera no larger than there is time for.
    pub scene: Scene,
}

/// Where in a family.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OfFamily {
    pub id: &'static str,
    /// How stiff: 0 ordinary, 1 between, 2 the end of the range that is further from the ordinary.
    pub stiffness: usize,
}

/// A scene that comes with the program, as it is.
///
/// # Panics
/// Where there is none of that name.
pub fn shipped(name: &str) -> Scene {
    let (_, text) = SHIPPED.iter().find(|(other, _)| *other == name).expect("the scene is one of ours");
    scene::parse(text, name).expect("a test has read it")
}

/// The shipped scenes, and every family that all engines have at three levels.
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

/// The scene of a file or, by its id, a family.
///
/// # Errors
/// A file that cannot be read or understood.
pub fn named(name: &str, quick: bool) -> Result<Vec<Subject>, SceneError> {
    let size = SIZES[usize::from(!quick)];
    match scene::families::family(name) {
        Some(family) if !Path::new(name).exists() => Ok(of_family(family, size)),
        _ => {
            let scene = reduced(scene::read(name.as_ref())?, size);
            Ok(vec![Subject { name: shown(name), family: None, scene }])
        }
    }
}

/// The ordinary level, that at the end of the range which is further from it, and one between. A case whose numbers no
/// scene may have is left out: there is no picture to judge.
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

/// The same scene with as many pixels fewer as there is time for.
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
