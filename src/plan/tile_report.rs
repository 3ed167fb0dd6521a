//! Counts what tiles keep and what they cull.

use super::frustum::{Frustum, never_hit};
use super::light::is_dark;
use super::omission::{Omission, Switch};
use super::report::{ByTiles, Kept, LeftOut, Report};
use super::team::on_all_cores;
use super::tiles::{Tiles, covered};
use crate::kernels::{Element, PixelBounds, TILE_HEIGHT, TILE_WIDTH};

/// The counts of a picture, taken after the nearest objects of each tile have been found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TileSurvey {
    /// The number of tiles that no object's bounds meet.
    pub empty: u64,
    /// The number of candidates: an object counts once in every tile that its bounds meet.
    pub placed: u64,
    /// The number of candidates that need no set-up, since nearer objects hide them.
    pub occluded: u64,
    /// The number of candidates that are tested and are nearest at no pixel.
    pub unseen: u64,
    /// The number of spheres in the picture that have the short form in bytes.
    pub short: u64,
    /// Shadow tests, each of a point against an object that may hide a light. `averted` counts
    /// points that face away from a light; `facing` the tests of all other points against all
    /// objects; `asked` those of these tests that were made.
    pub averted: u64,
    pub facing: u64,
    pub asked: u64,
}

impl TileSurvey {
    /// The sum of the counts of two parts of the picture.
    pub fn and(self, other: Self) -> Self {
        TileSurvey {
            empty: self.empty + other.empty,
            placed: self.placed + other.placed,
            occluded: self.occluded + other.occluded,
            unseen: self.unseen + other.unseen,
            short: self.short + other.short,
            averted: self.averted + other.averted,
            facing: self.facing + other.facing,
            asked: self.asked + other.asked,
        }
    }
}

/// For each omission how many objects of a kind it drops; then how many objects are kept, and how
/// many pixels their bounds contain.
#[derive(Clone, Copy, Default)]
struct Counts {
    left_out: [u64; Omission::ALL.len()],
    kept: u64,
    covered: u64,
}

impl Counts {
    fn one(mut self, left_out: Option<Omission>, covered: u64) -> Self {
        match left_out {
            Some(omission) => self.left_out[omission as usize] += 1,
            None => {
                self.kept += 1;
                self.covered += covered;
            }
        }
        self
    }

    fn and(mut self, other: Self) -> Self {
        self.left_out.iter_mut().zip(other.left_out).for_each(|(sum, more)| *sum += more);
        Counts { kept: self.kept + other.kept, covered: self.covered + other.covered, ..self }
    }

    /// Counts all objects. `unseen` gives the omission that drops an object without pixels; `why`
    /// the one that drops an object with pixels, if any does.
    fn of<T>(
        count: usize,
        object: impl Fn(usize) -> T + Sync,
        bounds: &PixelBounds,
        unseen: impl Fn(&T) -> Omission + Sync,
        why: impl Fn(&T) -> Option<Omission> + Sync,
    ) -> Self {
        /// How many objects a thread takes at a time.
        const TOGETHER: usize = 1 << 12;
        let add = |sum: Counts, i: usize| match covered(bounds.columns[i], bounds.rows[i]) {
            0 => sum.one(Some(unseen(&object(i))), 0),
            covered => sum.one(why(&object(i)), covered),
        };
        let some = |part: usize| (part * TOGETHER..count.min((part + 1) * TOGETHER)).fold(Counts::default(), add);
        on_all_cores(count.div_ceil(TOGETHER), some).into_iter().fold(Counts::default(), Counts::and)
    }
}

/// What has been counted of a scene that is traced in tiles.
struct Tally {
    spheres: Counts,
    triangles: Counts,
    survey: TileSurvey,
    /// Whether the engine writes 8 bits.
    bytes: bool,
    /// The number of dark lights.
    dark: u64,
    /// The number of objects that hide no light.
    unhidden: u64,
    /// The number of objects times the number of tiles.
    in_all_tiles: u64,
    /// The number of pixels of the picture.
    pixels: u64,
}

impl Tally {
    /// How much work of an omission is saved.
    fn left_out(&self, omission: Omission) -> u64 {
        let Tally { spheres, triangles, survey, bytes, pixels, .. } = *self;
        let both = spheres.and(triangles);
        match omission {
            Omission::Behind | Omission::Outside | Omission::NoArea | Omission::EdgeOn | Omission::Between => {
                both.left_out[omission as usize]
            }
            Omission::DarkLights => self.dark,
            Omission::SphereCode => (spheres.kept == 0).into(),
            Omission::TriangleCode => (triangles.kept == 0).into(),
            Omission::EmptyTiles => survey.empty,
            Omission::OtherTiles => self.in_all_tiles - survey.placed,
            Omission::Occluded => survey.occluded,
            Omission::Misses => both.kept * pixels - both.covered,
            Omission::Unseen => survey.unseen,
            Omission::Averted => survey.averted,
            Omission::OtherCells => survey.facing.saturating_sub(survey.asked),
            Omission::Unhidden => self.unhidden,
            Omission::Constants => both.kept,
            Omission::Loop if bytes => survey.short,
            Omission::FloatImage if bytes => pixels,
            _ => 0,
        }
    }
}

impl Report {
    /// The report on a scene that is traced in tiles. `survey` has the counts of the whole picture,
    /// and `bytes` says whether the output has 8 bits.
    #[doc(hidden)]
    pub fn of_tiles<E: Element>(tiles: &Tiles<'_, E>, survey: TileSurvey, bytes: bool) -> Self {
        let (scene, keep) = (tiles.scene(), tiles.keep());
        let frustum = Frustum::new(&scene.camera.grid());
        let spheres = Counts::of(
            scene.spheres.len(),
            |i| scene.spheres[i],
            &tiles.sphere_bounds(),
            |sphere| frustum.unseen_sphere(sphere),
            |_| None,
        );
        let triangles = Counts::of(
            scene.triangle_count(),
            |i| scene.triangle(i),
            &tiles.triangle_bounds(),
            |triangle| frustum.unseen_triangle(triangle),
            never_hit,
        );
        let dark = scene.lights.iter().filter(|light| is_dark(light)).count();
        let [across, down] = tiles.tiles();
        let objects = (scene.spheres.len() + scene.triangle_count()) as u64;
        let tally = Tally {
            spheres,
            triangles,
            survey,
            bytes,
            dark: dark as u64,
            unhidden: tiles.shadows().map_or(0, |shadows| shadows.unhidden()),
            in_all_tiles: objects * u64::from(across) * u64::from(down),
            pixels: scene.camera.pixels(),
        };
        let line = |omission: Omission| {
            let line = LeftOut::none(omission).by_tiles();
            let kept = keep.has(omission) && line.switch != Switch::None;
            LeftOut { count: if kept { 0 } else { tally.left_out(omission) }, ..line }
        };
        let kept = Kept {
            spheres: spheres.kept as usize,
            triangles: triangles.kept as usize,
            lights: scene.lights.len() - dark,
        };
        let by_tiles = ByTiles {
            objects,
            width: TILE_WIDTH as u32,
            height: TILE_HEIGHT as u32,
            across,
            down,
            placed: survey.placed,
        };
        Report::with(kept, Some(by_tiles), Omission::ALL.into_iter().map(line))
    }
}
