//! The figure: error against nanoseconds a ray, a panel for each family, a line for each engine over stiffness.

use plotters::prelude::*;

use super::Accuracy;
use super::front::{Point, front};
use crate::experiments::svg::{Area, BLUE, FONT, GREEN, ORANGE, PURPLE, PlotError, SKY, VERMILION, draw, write};

const COLUMNS: usize = 3;
const PANEL: (i32, i32) = (400, 300);
const HEAD: i32 = 96;
/// Errors below this are drawn on it: on a logarithmic axis there is no 0.
const FLOOR: f64 = 1e-9;
/// Errors above this too: bright light, or a picture of NaN.
const CEILING: f64 = 1.0;

fn colour(engine: &str) -> RGBColor {
    match engine {
        "reference" => BLACK,
        "rust" => ORANGE,
        "c" => VERMILION,
        "paper" => PURPLE,
        "sse41" => SKY,
        "avx2" => GREEN,
        _ => BLUE,
    }
}

fn point(row: &Accuracy) -> (f64, f64) {
    (row.ns_per_ray, row.error.clamp(FLOOR, CEILING))
}

/// The panels: each family, and before them the scenes that are of none.
fn panels(rows: &[Accuracy]) -> Vec<(String, Vec<&Accuracy>)> {
    let mut panels: Vec<(String, Vec<&Accuracy>)> = Vec::new();
    // The same errors later are no news: what leaves nothing out has no place here.
    for row in rows.iter().filter(|row| row.who.output == "f32x3" && row.who.option.is_none()) {
        let title = match row.family {
            Some(id) => {
                let name = crate::scene::families::family(id).map_or("", |family| family.name);
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
    let (width, height) = (PANEL.0 * COLUMNS as i32, HEAD + PANEL.1 * lines as i32);
    let times = || rows.iter().map(|row| row.ns_per_ray);
    let x = 0.7 * times().fold(f64::INFINITY, f64::min)..1.4 * times().fold(0.0, f64::max);
    draw(width, height, |area| {
        let (head, body) = area.split_vertically(HEAD);
        legend(&head, rows)?;
        for (cell, (title, rows)) in body.split_evenly((lines, COLUMNS)).iter().zip(&panels) {
            panel(cell, title, rows, x.clone())?;
        }
        Ok(())
    })
}

fn panel(area: &Area<'_>, title: &str, rows: &[&Accuracy], x: std::ops::Range<f64>) -> Result<(), PlotError> {
    let mut chart = ChartBuilder::on(area)
        .caption(title, (FONT, 14))
        .margin(6)
        .x_label_area_size(32)
        .y_label_area_size(48)
        .build_cartesian_2d(x.log_scale(), (FLOOR / 2.0..3.0 * CEILING).log_scale())?;
    let error = |y: &f64| if *y <= 1.01 * FLOOR { "0".into() } else { format!("{y:.0e}") };
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.1))
        .x_desc("ns a ray")
        .y_labels(6)
        .x_label_formatter(&|x| format!("{x}"))
        .y_label_formatter(&error)
        .label_style((FONT, 11))
        .axis_desc_style((FONT, 12))
        .draw()?;

    // The front of the stiffest of these scenes.
    let last = rows.last().map(|row| row.scene.as_str());
    let stiffest: Vec<&&Accuracy> = rows.iter().filter(|row| Some(row.scene.as_str()) == last).collect();
    let points: Vec<_> = stiffest.iter().map(|row| Point { error: row.error, time: row.ns_per_ray }).collect();
    let mut on: Vec<_> = stiffest.iter().zip(front(&points)).filter(|(_, on)| *on).map(|(row, _)| point(row)).collect();
    on.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut steps: Vec<(f64, f64)> = Vec::new();
    for (x, y) in on {
        // Up to here the one before is the best that there is.
        let before = steps.last().map_or(3.0 * CEILING, |(_, y)| *y);
        steps.extend([(x, before), (x, y)]);
    }
    chart.draw_series(LineSeries::new(steps, BLACK.mix(0.35).stroke_width(5)))?;

    let mut drawn: Vec<(&str, &str)> = Vec::new();
    for row in rows {
        let key = (row.who.engine, row.who.precision);
        if drawn.contains(&key) {
            continue;
        }
        drawn.push(key);
        let of: Vec<_> = rows.iter().filter(|other| (other.who.engine, other.who.precision) == key).collect();
        let line = of.iter().map(|row| point(row));
        chart.draw_series(LineSeries::new(line, colour(row.who.engine).stroke_width(1)))?;
        // A mark by its precision, larger the stiffer.
        let colour = colour(row.who.engine);
        let marks = of.iter().map(|row| (point(row), 2 + row.stiffness.unwrap_or(1) as i32));
        match row.who.precision {
            "single" => chart.draw_series(marks.map(|(at, size)| Circle::new(at, size, colour.filled()))).map(drop),
            "fast" => {
                chart.draw_series(marks.map(|(at, size)| TriangleMarker::new(at, size + 1, colour.filled()))).map(drop)
            }
            _ => chart.draw_series(marks.map(|(at, size)| Circle::new(at, size, colour.stroke_width(2)))).map(drop),
        }?;
    }
    Ok(())
}

/// What the colours and marks stand for.
fn legend(area: &Area<'_>, rows: &[Accuracy]) -> Result<(), PlotError> {
    let text = |text: &str, x: i32, y: i32, size: i32| write(area, text, (x, y), size);
    text("Error against run time: the root mean square error of a linear colour, and nanoseconds a ray", 12, 8, 20)?;
    let mut x = 16;
    let mut seen: Vec<&str> = Vec::new();
    for engine in rows.iter().map(|row| row.who.engine) {
        if !seen.contains(&engine) {
            seen.push(engine);
            area.draw(&Circle::new((x, 46), 5, colour(engine).filled()))?;
            text(engine, x + 10, 39, 14)?;
            x += 34 + 8 * engine.len() as i32;
        }
    }
    x += 20;
    for precision in ["single", "fast", "double"] {
        let black = BLACK.mix(0.7);
        match precision {
            "single" => area.draw(&Circle::new((x, 46), 5, black.filled())),
            "fast" => area.draw(&TriangleMarker::new((x, 46), 6, black.filled())),
            _ => area.draw(&Circle::new((x, 46), 5, black.stroke_width(2))),
        }?;
        text(precision, x + 10, 39, 14)?;
        x += 80;
    }
    text(
        "A line joins the three scenes of a family, small marks ordinary, large ones the end of its range. \
         Grey: the front of the stiffest, which nothing beats in both.",
        12,
        66,
        13,
    )
}
