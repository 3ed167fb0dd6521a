//! What a plan keeps and what it omits, in numbers: the lines of `rayo plan`.

use serde::{Deserialize, Serialize};

use super::frustum::never_hit;
use super::lit::LitForm;
use super::omission::{Omission, Switch};
use crate::scene::Scene;

/// What is traced of a scene, and what work is omitted.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// What is traced.
    pub kept: Kept,
    /// The omitted work, in the order of [`Omission::ALL`]; lines whose count is 0 are left out.
    pub left_out: Vec<LeftOut>,
    /// How and why the scene is traced tile by tile, if it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tiles: Option<ByTiles>,
}

/// How a scene is traced tile by tile, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct ByTiles {
    /// The number of objects in the scene.
    pub objects: u64,
    /// The number of columns of a tile.
    pub width: u32,
    /// The number of rows of a tile.
    pub height: u32,
    /// The number of tiles from left to right.
    pub across: u32,
    /// The number of tiles from top to bottom.
    pub down: u32,
    /// The number of candidates: an object counts once in every tile that its bounds meet.
    pub placed: u64,
}

/// How much of a scene is traced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[expect(missing_docs, reason = "the names say it")]
pub struct Kept {
    pub spheres: usize,
    pub triangles: usize,
    pub lights: usize,
}

/// One line of omitted work.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeftOut {
    /// The omission.
    #[serde(skip)]
    pub omission: Omission,
    /// The omitted work, from [`Omission::what`].
    pub what: &'static str,
    pub count: u64,
    /// The unit of `count`, from [`Omission::unit`].
    pub unit: &'static str,
    /// The reason, from [`Omission::reason`] unless tracing in tiles has another one.
    pub reason: &'static str,
    /// From [`Omission::switch`], unless tracing in tiles has another one.
    #[serde(skip)]
    pub switch: Switch,
}

impl LeftOut {
    /// A line whose count is 0.
    pub(super) fn none(omission: Omission) -> Self {
        LeftOut {
            omission,
            what: omission.what(),
            count: 0,
            unit: omission.unit(),
            reason: omission.reason(),
            switch: omission.switch(),
        }
    }

    /// The line as it is worded for tracing in tiles.
    pub(super) fn by_tiles(self) -> Self {
        match self.omission {
            Omission::NoArea => LeftOut {
                reason: "their corners are on one line: set-up moves them infinitely far away, so that no pixel \
                    shows them",
                ..self
            },
            Omission::EdgeOn => LeftOut {
                reason: "their plane passes through the camera: set-up moves them infinitely far away, so that no \
                    pixel shows them",
                ..self
            },
            Omission::Misses => {
                LeftOut { reason: "an object's corners or outline bound the pixels that can see it", ..self }
            }
            Omission::Constants => LeftOut {
                reason: "every ray leaves the origin: a sphere's terms are computed once, a triangle's planes once in \
                    each tile",
                ..self
            },
            Omission::Loop => LeftOut {
                what: "points and normals",
                reason: "of spheres: each light's cosine in closed form, where it loses less than half of the bits of f32",
                ..self
            },
            _ => self,
        }
    }
}

impl Report {
    /// The report on `scene` for an engine that tests every ray against every object, except for
    /// the omissions in `made`.
    #[doc(hidden)]
    pub fn of_rays(scene: &Scene, made: &[Omission]) -> Self {
        let unhit = |why| scene.all_triangles().filter(|triangle| never_hit(triangle) == Some(why)).count();
        let is_made = |omission| made.contains(&omission);
        let left_out = |why| if is_made(why) { unhit(why) } else { 0 };
        let [no_area, edge_on] = [Omission::NoArea, Omission::EdgeOn].map(left_out);
        let triangles = scene.triangle_count() - no_area - edge_on;
        let kept = Kept { spheres: scene.spheres.len(), triangles, lights: scene.lights.len() };
        let count = |omission| match omission {
            Omission::NoArea => no_area as u64,
            Omission::EdgeOn => edge_on as u64,
            Omission::Constants => (kept.spheres + kept.triangles) as u64,
            // A single object hides no other hit.
            Omission::Hidden if kept.spheres + kept.triangles > 1 => scene.camera.pixels(),
            _ => 0,
        };
        let made = Omission::ALL.into_iter().filter(|omission| is_made(*omission));
        Report::with(kept, None, made.map(|omission| LeftOut { count: count(omission), ..LeftOut::none(omission) }))
    }

    /// The report on a scene that is traced by the closed form `form`; `hits` pixels show the
    /// sphere, and `bytes` says whether the output has 8 bits.
    #[doc(hidden)]
    pub fn of_lit(scene: &Scene, form: &LitForm, hits: u64, bytes: bool) -> Self {
        let line = |omission| {
            let count = form.left_out(omission, scene, hits, bytes);
            match omission {
                // The closed form begins with the two ends of each row.
                Omission::Misses => LeftOut { count, switch: Switch::None, ..LeftOut::none(omission) },
                _ => LeftOut { count, ..LeftOut::none(omission) },
            }
        };
        let lights = scene.lights.len() - form.left_out(Omission::DarkLights, scene, hits, bytes) as usize;
        Report::with(Kept { spheres: 1, triangles: 0, lights }, None, Omission::ALL.into_iter().map(line))
    }

    /// Makes a report, without the lines whose count is 0.
    pub(super) fn with(kept: Kept, tiles: Option<ByTiles>, lines: impl Iterator<Item = LeftOut>) -> Self {
        Report { kept, left_out: lines.filter(|line| line.count > 0).collect(), tiles }
    }

    /// The report as text: a line for each omission, with counts, names and reasons in columns.
    pub fn lines(&self) -> Vec<String> {
        let Kept { spheres, triangles, lights } = self.kept;
        let mut lines = vec![format!(
            "kept: {}, {}, {}",
            counted(spheres, "sphere"),
            counted(triangles, "triangle"),
            counted(lights, "light")
        )];
        lines.extend(self.tiles.iter().map(ByTiles::line));
        lines.push(if self.left_out.is_empty() { "left out: nothing".into() } else { "left out:".into() });
        let what = self.left_out.iter().map(|line| line.what.len()).max().unwrap_or(0);
        let counts: Vec<_> = self.left_out.iter().map(|line| with_digit_groups(line.count, ',')).collect();
        let count = counts.iter().map(String::len).max().unwrap_or(0);
        let line =
            |(line, counted): (&LeftOut, &String)| format!("  {counted:>count$}  {:what$}  {}", line.what, line.reason);
        lines.extend(self.left_out.iter().zip(&counts).map(line));
        lines
    }
}

impl ByTiles {
    fn line(&self) -> String {
        let ByTiles { objects, width, height, across, down, placed } = *self;
        format!(
            "tile by tile: {across} x {down} tiles of {width} x {height} pixels, {:.2} of them for an object on average",
            placed as f64 / objects.max(1) as f64,
        )
    }
}

fn counted(count: usize, one: &str) -> String {
    format!("{} {one}{}", with_digit_groups(count as u64, ','), if count == 1 { "" } else { "s" })
}

/// A number with a separator before every three digits.
pub fn with_digit_groups(number: u64, separator: char) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(separator);
        }
        text.push(digit);
    }
    text
}
