//! The heat map: the result of every engine at every level of every family.

use plotters::prelude::*;
use plotters::style::FontTransform;

use super::{Cell, StabilityReport};
use crate::experiments::svg::{Area, FONT, PlotError, draw, text_width, write};

/// Lengths in pixels: the size of a cell, the width of the names at the left, and the height of the
/// title and legend above the cells.
const CELL: (i32, i32) = (12, 20);
const LEFT: i32 = 130;
const TOP: i32 = 92;
/// The height of the letters of the parameter's values, below the cells.
const VALUE: i32 = 10;
const GAP: i32 = 10;
/// The width of the figure, in which families stand side by side.
const WIDTH: i32 = 1240;
/// The most columns of a family. If it has more levels, each column shows the worst of several.
const COLUMNS: usize = 14;

/// The colours and their meanings, from good to bad. Worse ones are darker, so that they can be
/// told apart by lightness alone.
pub const SHADES: [(&str, RGBColor); 7] = [
    ("nothing is hit", RGBColor(240, 240, 240)),
    ("t within half of its bound", RGBColor(211, 239, 208)),
    ("t within its bound", RGBColor(163, 217, 155)),
    ("t beyond its bound, the picture right", RGBColor(233, 207, 95)),
    ("wrong hits or levels, up to 1 in 1000", RGBColor(240, 150, 46)),
    ("up to 1 in 10", RGBColor(207, 43, 27)),
    ("more", RGBColor(109, 0, 32)),
];

/// The index of a cell's shade in [`SHADES`].
pub fn shade(cell: &Cell) -> usize {
    let wrong = cell.wrong_hits.max(cell.off_by_2) as f64 / cell.rays.max(1) as f64;
    match cell.bound_share {
        _ if wrong > 0.1 => 6,
        _ if wrong > 1e-3 => 5,
        _ if wrong > 0.0 => 4,
        None => 0,
        Some(share) if share <= 0.5 => 1,
        Some(share) if share <= 1.0 => 2,
        Some(_) => 3,
    }
}

/// A family's part of a row of the figure, and the value of its parameter in each column.
struct FamilyInRow<'a> {
    family: &'a str,
    values: Vec<&'a str>,
}

impl FamilyInRow<'_> {
    fn columns(&self) -> usize {
        self.values.len().min(COLUMNS)
    }

    fn width(&self) -> i32 {
        CELL.0 * self.columns() as i32 + GAP
    }

    fn column(&self, level: usize) -> usize {
        level * self.columns() / self.values.len()
    }
}

/// Draws the heat map.
pub fn figure(document: &StabilityReport) -> Result<String, PlotError> {
    let mut names: Vec<(&str, &str)> = Vec::new();
    let mut parts: Vec<FamilyInRow<'_>> = Vec::new();
    for cell in &document.cells {
        if !names.contains(&cell.contender()) {
            names.push(cell.contender());
        }
        if parts.last().is_none_or(|part| part.family != cell.family) {
            parts.push(FamilyInRow { family: &cell.family, values: Vec::new() });
        }
        let values = &mut parts.last_mut().expect("it was made").values;
        values.resize(values.len().max(cell.level + 1), "");
        values[cell.level] = &cell.value;
    }
    // Families fill a row until the next one does not fit; then another row begins below.
    let mut rows: Vec<Vec<FamilyInRow<'_>>> = vec![Vec::new()];
    let mut used = LEFT;
    for part in parts {
        used += part.width();
        if used > WIDTH {
            rows.push(Vec::new());
            used = LEFT + part.width();
        }
        rows.last_mut().expect("there is one").push(part);
    }
    // The height of a row is that of its cells and, below them, of the longest value.
    let below = |parts: &Vec<FamilyInRow<'_>>| {
        let values = parts.iter().flat_map(|part| &part.values);
        values.map(|value| text_width(value, VALUE)).max().unwrap_or(0) + 16
    };
    let heights: Vec<_> = rows.iter().map(|parts| 24 + CELL.1 * names.len() as i32 + below(parts)).collect();
    draw((WIDTH, TOP - 24 + heights.iter().sum::<i32>()), |area| {
        write(area, "Engines on stiff and extreme scenes: each column a value of the family's parameter", (12, 8), 18)?;
        draw_legend(area)?;
        let mut top = TOP;
        for (parts, height) in rows.iter().zip(&heights) {
            for (i, (engine, precision)) in names.iter().enumerate() {
                write(area, &format!("{engine} {precision}"), (8, top + CELL.1 * i as i32 + 4), 12)?;
            }
            let mut left = LEFT;
            for part in parts {
                draw_part(area, document, part, &names, (left, top))?;
                left += part.width();
            }
            top += height;
        }
        Ok(())
    })
}

/// Draws the colours with their meanings.
fn draw_legend(area: &Area<'_>) -> Result<(), PlotError> {
    let (mut x, mut y) = (12, 38);
    for (label, colour) in SHADES {
        let wide = 40 + text_width(label, 12);
        if x + wide > WIDTH {
            (x, y) = (12, y + 20);
        }
        rectangle(area, (x, y), (12, 12), colour)?;
        write(area, label, (x + 16, y), 12)?;
        x += wide;
    }
    Ok(())
}

/// Draws a family: its name, its columns, and below them the name of its parameter.
fn draw_part(
    area: &Area<'_>,
    document: &StabilityReport,
    part: &FamilyInRow<'_>,
    names: &[(&str, &str)],
    (left, top): (i32, i32),
) -> Result<(), PlotError> {
    write(area, part.family, (left, top - 17), 13)?;
    for (i, name) in names.iter().enumerate() {
        for column in 0..part.columns() {
            let own = document.cells.iter().filter(|cell| {
                cell.family == part.family && cell.contender() == *name && part.column(cell.level) == column
            });
            let Some(worst) = own.map(shade).max() else { continue };
            let at = (left + CELL.0 * column as i32, top + CELL.1 * i as i32);
            rectangle(area, at, (CELL.0 - 1, CELL.1 - 2), SHADES[worst].1)?;
        }
    }
    let below = top + CELL.1 * names.len() as i32 + 4;
    let style = TextStyle::from((FONT, VALUE)).transform(FontTransform::Rotate90);
    for column in 0..part.columns() {
        let Some(level) = (0..part.values.len()).find(|level| part.column(*level) == column) else { continue };
        let at = (left + CELL.0 * column as i32 + 10, below);
        area.draw(&Text::new(part.values[level], at, style.clone()))?;
    }
    Ok(())
}

fn rectangle(
    area: &Area<'_>,
    (x, y): (i32, i32),
    (width, height): (i32, i32),
    colour: RGBColor,
) -> Result<(), PlotError> {
    Ok(area.draw(&Rectangle::new([(x, y), (x + width, y + height)], colour.filled()))?)
}
