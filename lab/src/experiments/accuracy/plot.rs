//! The figure of error against nanoseconds per ray: a panel per family, a line per engine.

use plotters::prelude::*;

use super::Accuracy;
use super::front::{Point, front};
use crate::experiments::svg::{
    Area, Entry, GREY, LogChart, Mark, PlotError, Screen, Series, around, colour_of, draw, engines, head,
};

const COLUMNS: usize = 3;
const PANEL: (i32, i32) = (420, 320);
/// The size of a panel that is drawn by itself.
const LARGE: (i32, i32) = (960, 560);
const HEAD: i32 = 64;
/// Smaller errors are drawn at this value, since a logarithmic axis has no 0.
const FLOOR: f64 = 1e-9;
/// Larger errors, such as those of bright lights or NaN, are drawn at this value.
const CEILING: f64 = 1.0;

/// The mark of each precision.
const PRECISIONS: [(Mark, &str); 3] = [(Mark::Dot, "single"), (Mark::Triangle, "fast"), (Mark::Square, "double")];

fn point(row: &Accuracy) -> (f64, f64) {
    (row.ns_per_ray, row.error.clamp(FLOOR, CEILING))
}

/// The name and the rows of a family, or of a scene without one.
pub type Panel<'a> = (String, Vec<&'a Accuracy>);

/// A panel for each scene that belongs to no family, then one for each family.
pub fn panels(rows: &[Accuracy]) -> Vec<Panel<'_>> {
    let mut panels: Vec<Panel<'_>> = Vec::new();
    // Rows with `--keep-all` would repeat the same errors at longer times, and are left out.
    for row in rows.iter().filter(|row| row.who.output == "f32x3" && row.who.option.is_none()) {
        let title = match &row.family {
            Some(id) => {
                let name = crate::families::family(id).map_or("", |family| family.name);
                format!("{id}: {name}")
            }
            None => row.scene.clone(),
        };
        match panels.iter_mut().find(|(other, _)| *other == title) {
            Some((_, rows)) => rows.push(row),
            None => panels.push((title, vec![row])),
        }
    }
    panels
}

/// Error against time of all rows that write floats.
pub fn figure(rows: &[Accuracy]) -> Result<String, PlotError> {
    let panels = panels(rows);
    let lines = panels.len().div_ceil(COLUMNS).max(1);
    let size = (PANEL.0 * COLUMNS as i32, HEAD + PANEL.1 * lines as i32);
    let x = times(rows.iter());
    draw(size, |area| {
        let (top, body) = area.split_vertically(HEAD);
        head(
            &top,
            "Error against run time: the root mean square error of a linear colour, and nanoseconds a ray",
            &entries(rows.iter()),
        )?;
        for (cell, (title, rows)) in body.split_evenly((lines, COLUMNS)).iter().zip(&panels) {
            panel(&head(cell, title, &[])?, rows, x.clone())?;
        }
        Ok(())
    })
}

pub fn one_figure((title, rows): &Panel<'_>, screen: Screen) -> Result<String, PlotError> {
    draw(screen.size(LARGE), |area| {
        let area = head(area, title, &entries(rows.iter().copied()))?;
        panel(&area, rows, times(rows.iter().copied()))
    })
}

fn times<'a>(rows: impl Iterator<Item = &'a Accuracy>) -> std::ops::Range<f64> {
    around(rows.map(|row| row.ns_per_ray), (0.7, 1.4))
}

/// The legend of colours and marks.
fn entries<'a>(rows: impl Iterator<Item = &'a Accuracy>) -> Vec<Entry> {
    let mut entries = engines(Mark::Line, rows.map(|row| &*row.who.engine));
    entries.extend(PRECISIONS.map(|(mark, name)| (mark, GREY, name.to_owned())));
    entries.push((Mark::Line, GREY, "wide: the Pareto front of the stiffest scene".into()));
    entries
}

fn panel(area: &Area<'_>, rows: &[&Accuracy], x: std::ops::Range<f64>) -> Result<(), PlotError> {
    // The front is that of the scene which comes last, the most ill-conditioned one.
    let last = rows.last().map(|row| row.scene.as_str());
    let stiffest: Vec<&&Accuracy> = rows.iter().filter(|row| Some(row.scene.as_str()) == last).collect();
    let points: Vec<_> = stiffest.iter().map(|row| Point { error: row.error, time: row.ns_per_ray }).collect();
    let mut on: Vec<_> = stiffest.iter().zip(front(&points)).filter(|(_, on)| *on).map(|(row, _)| point(row)).collect();
    on.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut steps: Vec<(f64, f64)> = Vec::new();
    for (x, y) in on {
        // Up to this time the previous point has the smallest error, so that the front is a
        // staircase.
        let before = steps.last().map_or(3.0 * CEILING, |(_, y)| *y);
        steps.extend([(x, before), (x, y)]);
    }
    let mut series = vec![Series::line(steps, BLACK.mix(0.2), 5)];

    let mut drawn: Vec<(&str, &str)> = Vec::new();
    for row in rows {
        let key = (&*row.who.engine, &*row.who.precision);
        if drawn.contains(&key) {
            continue;
        }
        drawn.push(key);
        let of = || rows.iter().filter(|other| (&*other.who.engine, &*other.who.precision) == key);
        let colour = colour_of(&row.who.engine);
        series.push(Series::line(of().map(|row| point(row)), colour.mix(0.6), 1));
        let mark = PRECISIONS.iter().find(|(_, precision)| *precision == row.who.precision).map(|(mark, _)| *mark);
        // The more ill-conditioned the scene, the larger its mark.
        let size = |row: &Accuracy| 3 + row.stiffness.unwrap_or(1) as i32;
        let marked = |row: &&Accuracy| Series {
            mark: mark.map(|mark| (mark, size(row))),
            ..Series::line([point(row)], colour, 0)
        };
        series.extend(of().map(marked));
    }
    let y = (FLOOR / 3.0..3.0 * CEILING, "error; 10⁻⁹ is 0");
    LogChart { x: (x, "ns a ray"), y, series, names: Vec::new() }.draw(area, [8, 36, 56])
}
