//! The heat map: every engine over every family and level, from well within its bound to wrong.

use plotters::prelude::*;

use super::{Cell, StabilityReport};
use crate::experiments::svg::{Area, PlotError, draw, write};
use crate::scene::families::{Family, family as family_of};

/// Pixels of a cell, of the names at the left, and of what stands above.
const CELL: (i32, i32) = (9, 20);
const LEFT: i32 = 130;
const TOP: i32 = 86;
const GAP: i32 = 8;
/// A family of more levels is drawn in so many columns, each the worst of its levels.
const COLUMNS: usize = 14;

/// From good to bad: what a colour says, and the colour.
const SHADES: [(&str, RGBColor); 7] = [
    ("nothing is hit", RGBColor(225, 225, 225)),
    ("t within half of its bound", RGBColor(0, 90, 50)),
    ("t within its bound", RGBColor(120, 198, 121)),
    ("t beyond its bound, the picture right", RGBColor(255, 237, 160)),
    ("wrong hits or levels, up to 1 in 1000", RGBColor(254, 178, 76)),
    ("up to 1 in 10", RGBColor(240, 59, 32)),
    ("more", RGBColor(128, 0, 38)),
];

fn shade(cell: &Cell) -> usize {
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

/// Draws the map.
pub fn figure(document: &StabilityReport) -> Result<String, PlotError> {
    let mut names: Vec<(&str, &str)> = Vec::new();
    let mut families: Vec<(&str, usize)> = Vec::new();
    for cell in &document.cells {
        if !names.contains(&cell.contender()) {
            names.push(cell.contender());
        }
        match families.last_mut() {
            Some((id, levels)) if *id == cell.family => *levels = (*levels).max(cell.level + 1),
            _ => families.push((cell.family, cell.level + 1)),
        }
    }
    let widths: i32 = families.iter().map(|(_, levels)| CELL.0 * (*levels).min(COLUMNS) as i32 + GAP).sum();
    let (width, height) = ((LEFT + widths + GAP).max(900), TOP + CELL.1 * names.len() as i32 + 30);
    draw(width, height, |area| {
        let text = |text: &str, at: (i32, i32), size: i32| write(area, text, at, size);
        text("Engines on stiff and extreme scenes: each column a value of the family's parameter", (LEFT, 8), 16)?;
        let mut x = LEFT;
        for (label, colour) in SHADES {
            rectangle(area, (x, 34), (12, 12), colour)?;
            text(label, (x + 16, 34), 11)?;
            x += 24 + 6 * label.len() as i32;
        }
        for (i, (engine, precision)) in names.iter().enumerate() {
            text(&format!("{engine} {precision}"), (8, TOP + CELL.1 * i as i32 + 4), 12)?;
        }
        let mut left = LEFT;
        for (family, levels) in &families {
            text(family, (left, TOP - 18), 12)?;
            let columns = (*levels).min(COLUMNS);
            for (i, name) in names.iter().enumerate() {
                for column in 0..columns {
                    let own = document.cells.iter().filter(|cell| {
                        cell.family == *family && cell.contender() == *name && cell.level * columns / levels == column
                    });
                    let Some(worst) = own.map(shade).max() else { continue };
                    let at = (left + CELL.0 * column as i32, TOP + CELL.1 * i as i32);
                    rectangle(area, at, (CELL.0 - 1, CELL.1 - 2), SHADES[worst].1)?;
                }
            }
            // From where to where, as far as it is a matter of numbers.
            if let Some(Family { levels: [first, .., last], .. }) = family_of(family)
                && first.label.parse::<f64>().is_ok() | first.label.is_empty()
            {
                let below = TOP + CELL.1 * names.len() as i32 + 2;
                text(&first.to_string(), (left, below), 10)?;
                text(&format!("to {last}"), (left, below + 12), 10)?;
            }
            left += CELL.0 * columns as i32 + GAP;
        }
        Ok(())
    })
}

fn rectangle(
    area: &Area<'_>,
    (x, y): (i32, i32),
    (width, height): (i32, i32),
    colour: RGBColor,
) -> Result<(), PlotError> {
    Ok(area.draw(&Rectangle::new([(x, y), (x + width, y + height)], colour.filled()))?)
}
