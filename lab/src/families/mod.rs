//! The ill-conditioned and extreme scenes: families of seeded cases, each over the whole range of a
//! parameter.
//!
//! A case is a scene whose camera looks at the critical place: the limb of a sphere, the short side
//! of a sliver, a vertex. The correct picture is the same for all engines; experiments and tests
//! measure how close an engine comes to it.

mod crowds;
mod maker;
mod others;
mod shadows;
mod spheres;
mod triangles;
mod views;

use maker::Maker;
use rayo::Scene;

/// The side of a case's picture, in pixels. It gives at least 10^5 rays in families that do not set
/// their own size.
pub const SIDE: u32 = 320;

/// Scenes that are difficult in one respect, increasingly so along [`Family::levels`].
#[derive(Debug)]
pub struct Family {
    /// `S1` to `S9` (spheres), `T1` to `T7` (triangles), `X1` and `X2` (scales mixed, objects
    /// twice), `L1` to `L3` (lights), `V1` (wide films), `H1` to `H6` (shadows), `I1` (images),
    /// `N1` (not numbers).
    pub id: &'static str,
    /// A description in a few words.
    pub name: &'static str,
    pub parameter: &'static str,
    /// The correct result, in words.
    pub correct: &'static str,
    /// The values of the parameter over its whole range; the ordinary case is at
    /// [`Family::ordinary`].
    pub levels: &'static [Level],
    /// The index of the ordinary case in `levels`.
    pub ordinary: usize,
    /// Whether the pictures of all levels show about as much, so that their times can be compared.
    pub same_work: bool,
    pub variants: &'static [&'static str],
    make: fn(&mut Maker) -> MadeScene,
}

/// One value of a family's parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    /// The parameter, or the index of a named level.
    pub value: f64,
    /// The name of the level, if it has one.
    pub label: &'static str,
}

impl std::fmt::Display for Level {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.value {
            _ if !self.label.is_empty() => f.write_str(self.label),
            value if value == 0.0 || (1e-3..1e4).contains(&value.abs()) => write!(f, "{value}"),
            value => write!(f, "{value:e}"),
        }
    }
}

/// One scene of a family.
#[derive(Clone)]
pub struct Case {
    /// The family's id.
    pub family: &'static str,
    /// The case's number in the family: `level * variants + variant`.
    pub index: usize,
    /// The seed of its random numbers.
    pub seed: u64,
    /// The value of the parameter.
    pub level: Level,
    /// The name of the variant.
    pub variant: &'static str,
    /// The scene; its camera looks at the critical place.
    pub scene: Scene,
    /// Whether all numbers of the scene are valid. If not, an engine must refuse to trace it.
    pub valid: bool,
    /// Whether every ray of the picture hits something.
    pub covered: bool,
}

/// The result of a family's function.
struct MadeScene {
    scene: Scene,
    valid: bool,
    covered: bool,
}

impl From<Scene> for MadeScene {
    fn from(scene: Scene) -> Self {
        MadeScene { scene, valid: true, covered: false }
    }
}

impl Family {
    /// The number of cases: each level in each variant.
    pub fn cases(&self) -> usize {
        self.levels.len() * self.variants.len()
    }

    /// Whether its scenes have shadows, which not all engines have.
    pub fn has_shadows(&self) -> bool {
        self.id.starts_with('H')
    }

    /// Case `index`, with a picture of about `side` x `side` pixels.
    ///
    /// The same arguments give the same scene on every machine.
    ///
    /// # Panics
    /// If `index` is not below [`Family::cases`].
    pub fn case(&self, index: usize, seed: u64, side: u32) -> Case {
        let (level, variant) = (self.levels[index / self.variants.len()], index % self.variants.len());
        let mut maker = Maker::new(level.value, variant, seed, index, side);
        let MadeScene { mut scene, valid, covered } = (self.make)(&mut maker);
        scene.shadows = self.has_shadows();
        let (family, variant) = (self.id, self.variants[variant]);
        Case { family, index, seed, level, variant, scene, valid, covered }
    }
}

/// Every family, in the order of their ids.
pub static FAMILIES: &[Family] = &[
    spheres::FAR,
    spheres::TANGENT,
    spheres::SCALE,
    spheres::FILM,
    spheres::CAMERA,
    spheres::GROUND,
    spheres::NESTED,
    spheres::BEHIND,
    crowds::BESIDE,
    triangles::SLIVER,
    triangles::FAR,
    triangles::GRAZING,
    triangles::LARGE,
    triangles::SCALE,
    triangles::SHARED,
    triangles::DEGENERATE,
    crowds::SCALES,
    crowds::DUPLICATES,
    others::LIGHTS,
    crowds::BRIGHTNESS,
    views::NEAR_LIGHTS,
    views::WIDE,
    shadows::CONTACT,
    shadows::GRAZING,
    shadows::LIGHTS,
    shadows::CLOSED,
    shadows::NEEDLES,
    shadows::SCALES,
    others::IMAGES,
    others::NOT_NUMBERS,
];

/// The family with this id, in upper or lower case.
pub fn family(id: &str) -> Option<&'static Family> {
    FAMILIES.iter().find(|family| family.id.eq_ignore_ascii_case(id))
}

/// Levels that are numbers.
const fn numbers<const N: usize>(values: [f64; N]) -> [Level; N] {
    let mut levels = [Level { value: 0.0, label: "" }; N];
    let mut i = 0;
    while i < N {
        levels[i].value = values[i];
        i += 1;
    }
    levels
}

/// Levels that have names, numbered from 0.
const fn names<const N: usize>(labels: [&'static str; N]) -> [Level; N] {
    let mut levels = [Level { value: 0.0, label: "" }; N];
    let mut i = 0;
    while i < N {
        levels[i] = Level { value: i as f64, label: labels[i] };
        i += 1;
    }
    levels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_are_reproducible_and_numbers_unless_said() {
        for family in FAMILIES {
            for index in 0..family.cases() {
                let (case, again) = (family.case(index, 1, 16), family.case(index, 1, 16));
                // NaN is not equal to itself, but its text is.
                assert_eq!(format!("{:?}", case.scene), format!("{:?}", again.scene), "{} {index}", family.id);
                assert_eq!(case.valid, family.id != "N1", "{} {index}", family.id);
                assert_eq!(case.scene.shadows, family.has_shadows(), "{} {index}", family.id);
            }
        }
    }

    #[test]
    fn a_case_has_a_hundred_thousand_rays_or_a_size_of_its_own() {
        for family in FAMILIES.iter().filter(|family| !["I1", "N1"].contains(&family.id)) {
            for index in 0..family.cases() {
                let Case { variant, scene: Scene { camera, .. }, .. } = family.case(index, 1, SIDE);
                // The other variants of its level have correspondingly more.
                assert!(
                    camera.pixels() >= 100_000
                        || ["5000 objects", "5120 triangles", "81920 triangles"].contains(&variant),
                    "{} {index}: {camera:?}",
                    family.id
                );
            }
        }
    }

    #[test]
    fn another_seed_gives_another_scene() {
        for family in FAMILIES.iter().filter(|family| !["T7", "I1"].contains(&family.id)) {
            let index = family.cases() - 1;
            let scenes = [1, 2].map(|seed| format!("{:?}", family.case(index, seed, 16).scene));
            assert_ne!(scenes[0], scenes[1], "{}", family.id);
        }
    }
}
