//! What a plan keeps and what it leaves out, counted: the lines of `rayo plan`.

use serde::{Deserialize, Serialize};

use super::omission::{Omission, Switch};
use super::spans::{RowSpans, Spans, Way};
use crate::kernels::Element;
use crate::scene::Scene;

/// What is kept of a scene, and each line of what is left out.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// What is traced.
    pub kept: Kept,
    /// What is not, in the order of [`Omission::ALL`]; only what there is any of.
    pub left_out: Vec<LeftOut>,
    /// If the scene goes tile by tile, how and why.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tiles: Option<ByTiles>,
}

/// How a scene goes tile by tile, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct ByTiles {
    /// Objects of the scene.
    pub objects: u64,
    /// From so many on tiles cost less than the spans of each row.
    pub fewest_objects: u64,
    /// Pixels of a tile.
    pub width: u32,
    /// Pixels of a tile.
    pub height: u32,
    /// Tiles of the picture, from left to right.
    pub across: u32,
    /// Tiles of the picture, from top to bottom.
    pub down: u32,
    /// Objects of tiles, each in as many as its bounds meet.
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

/// One line of what is left out.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LeftOut {
    /// Which.
    #[serde(skip)]
    pub omission: Omission,
    /// [`Omission::what`].
    pub what: &'static str,
    /// How much of it.
    pub count: u64,
    /// [`Omission::unit`].
    pub unit: &'static str,
    /// [`Omission::reason`], or that of tiles.
    pub reason: &'static str,
    /// [`Omission::switch`], or that of tiles.
    #[serde(skip)]
    pub switch: Switch,
}

impl LeftOut {
    /// None of it.
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

    /// As tiles have it.
    pub(super) fn by_tiles(self) -> Self {
        match self.omission {
            Omission::NoArea => {
                let reason =
                    "their corners are on one line: set-up takes them as infinitely far, and no pixel is theirs";
                LeftOut { reason, switch: Switch::None, ..self }
            }
            Omission::EdgeOn => {
                let reason = "their plane passes through the camera: set-up takes them as infinitely far, and no pixel is theirs";
                LeftOut { reason, switch: Switch::None, ..self }
            }
            Omission::DarkLights => LeftOut { switch: Switch::None, ..self },
            Omission::Misses => {
                LeftOut { reason: "an object's corners or outline bound the pixels that can see it", ..self }
            }
            Omission::Constants => LeftOut {
                reason: "every ray leaves the origin: a sphere's terms are made once, a triangle's planes once in each tile",
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

/// What is found out by looking at every row.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Survey {
    misses: u64,
    search: u64,
    depths: u64,
    hidden: u64,
}

impl Report {
    /// Of `scene`, which `spans` is the plan of, as far as an engine makes the omissions `made`; `bytes` says whether it
    /// writes 8 bits.
    pub fn new<E: Element>(scene: &Scene, spans: &Spans<E>, made: &[Omission], bytes: bool) -> Self {
        let (spheres, triangles) = spans.counts();
        let is_made = |omission: Omission| made.contains(&omission) && !spans.keep().has(omission);
        let unseen = |omission| if is_made(omission) { spans.left_out(omission) as usize } else { 0 };
        let kept = if made.contains(&Omission::Outside) {
            Kept { spheres, triangles, lights: scene.lights.len() - unseen(Omission::DarkLights) }
        } else {
            let triangles = scene.triangle_count() - unseen(Omission::NoArea) - unseen(Omission::EdgeOn);
            Kept { spheres: scene.spheres.len(), triangles, lights: scene.lights.len() }
        };
        let by_rows = [Omission::Misses, Omission::Search, Omission::Depths, Omission::Hidden];
        let survey = if by_rows.into_iter().any(is_made) { Survey::new(spans) } else { Survey::default() };
        let count = |omission| match omission {
            Omission::Misses => survey.misses,
            Omission::Search => survey.search,
            Omission::Depths => survey.depths,
            Omission::Hidden => survey.hidden,
            Omission::SphereCode => (kept.spheres == 0).into(),
            Omission::TriangleCode => (kept.triangles == 0).into(),
            Omission::Constants => (kept.spheres + kept.triangles) as u64,
            Omission::Channels | Omission::FloatImage if !bytes => 0,
            Omission::FloatImage => spans.pixels(),
            _ => spans.left_out(omission),
        };
        let made = Omission::ALL.into_iter().filter(|omission| is_made(*omission));
        let lines = made.map(|omission| LeftOut { count: count(omission), ..LeftOut::none(omission) });
        Report { kept, left_out: lines.filter(|line| line.count > 0).collect(), tiles: None }
    }

    /// The report in lines: counts, names and reasons in columns.
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
        let counts: Vec<_> = self.left_out.iter().map(|line| grouped(line.count, ',')).collect();
        let count = counts.iter().map(String::len).max().unwrap_or(0);
        let line =
            |(line, counted): (&LeftOut, &String)| format!("  {counted:>count$}  {:what$}  {}", line.what, line.reason);
        lines.extend(self.left_out.iter().zip(&counts).map(line));
        lines
    }
}

impl ByTiles {
    fn line(&self) -> String {
        let ByTiles { objects, fewest_objects, width, height, across, down, placed } = *self;
        format!(
            "tile by tile: {} objects, and from {fewest_objects} on that costs less than row by row; \
             {across} x {down} tiles of {width} x {height} pixels, {} of them for an object on average",
            grouped(objects, ','),
            format_args!("{:.2}", placed as f64 / objects as f64),
        )
    }
}

fn counted(count: usize, one: &str) -> String {
    format!("{} {one}{}", grouped(count as u64, ','), if count == 1 { "" } else { "s" })
}

/// A number with a separator before each three digits.
pub fn grouped(number: u64, separator: char) -> String {
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

impl Survey {
    /// Goes over all rows, with those objects at hand that a row may see.
    fn new<E: Element>(spans: &Spans<E>) -> Self {
        let mut survey = Survey::default();
        let (mut in_row, mut extents) = (RowSpans::default(), Vec::new());
        for (row, seen) in spans.rows_and_objects() {
            extents.clear();
            extents.extend(seen.iter().filter_map(|object| spans.row(*object, row)).map(|span| span.start..span.end));
            let hits: u64 = extents.iter().map(|span| span.len() as u64).sum();
            extents.sort_unstable_by_key(|span| span.start);
            let (mut pixels, mut end) = (0, 0);
            for span in &extents {
                pixels += u64::from(span.end.max(end) - span.start.max(end));
                end = end.max(span.end);
            }
            survey.misses += spans.tests_in_row() - hits;
            survey.hidden += hits - pixels;
            match spans.spans_in(row, &seen, &mut in_row) {
                Way::Apart if hits == pixels => survey.search += pixels,
                Way::Apart => survey.depths += pixels,
                Way::Nearest | Way::NearestInRow => {}
            }
        }
        survey
    }
}

#[cfg(test)]
mod tests {
    use super::grouped;

    #[test]
    fn numbers_are_grouped_by_three_digits() {
        for (number, text) in [(0, "0"), (999, "999"), (1000, "1,000"), (12_345_678, "12,345,678")] {
            assert_eq!(grouped(number, ','), text);
        }
    }
}
