//! The figure of cycles per pixel against pixels, objects and lights, a panel for each.

use super::{Growth, ZEROS, lines};
use crate::experiments::svg::{
    Area, COLOURS, Entry, LogChart, Mark, PlotError, Screen, Series, around, colour_of, draw, head,
};
use crate::experiments::sweeps::Axis;
use rayo::internals::render::PixelFormat;

const PANEL: (i32, i32) = (400, 460);

/// Draws the panels side by side on a wide screen, below one another on a narrow one.
pub fn figure(rows: &[Growth], screen: Screen) -> Result<String, PlotError> {
    let axes = [Axis::Pixels, Axis::Objects, Axis::Lights];
    let (across, down) = if screen == Screen::Narrow { (1, axes.len()) } else { (axes.len(), 1) };
    let (width, _) = screen.size((PANEL.0 * axes.len() as i32, PANEL.1));
    draw((width, PANEL.1 * down as i32), |area| {
        for (cell, axis) in area.split_evenly((down, across)).iter().zip(axes) {
            let mut of_axis: Vec<_> = lines(rows).into_iter().filter(|line| line[0].axis == axis).collect();
            if axis == Axis::Pixels {
                // Lines for all engines in all pixel formats would be too many: only the fastest
                // engine, the last one, is drawn.
                let fastest = rows.iter().rfind(|row| row.axis == axis && row.engine != ZEROS).map(|row| &row.engine);
                of_axis.retain(|line| line[0].engine == ZEROS || Some(&line[0].engine) == fastest);
            }
            if !of_axis.is_empty() {
                panel(cell, axis.name(), &of_axis)?;
            }
        }
        Ok(())
    })
}

fn panel(area: &Area<'_>, name: &str, lines: &[Vec<&Growth>]) -> Result<(), PlotError> {
    let point = |row: &&Growth| (row.count as f64, row.cycles_per_pixel());
    // Each scene has a colour. Its line by brute force has the same colour and is thinner.
    let of_scene = |place: usize, scene: &str| {
        let others = lines[..place].iter().filter(|other| !other[0].keep_all && other[0].scene != *scene);
        COLOURS[others.count() % COLOURS.len()]
    };
    let entry = |(place, line): (usize, &Vec<&Growth>)| -> Entry {
        let Growth { scene, engine, output, keep_all, axis, .. } = line[0];
        // The loop that only fills the film has the colour of the engine's line in the same pixel
        // format.
        let of_output = |output: &str| PixelFormat::ALL.iter().position(|format| format.name() == output);
        let place = if *axis == Axis::Pixels { of_output(output).unwrap_or(place) } else { place };
        match axis {
            Axis::Lights => (Mark::Dot, colour_of(engine), engine.to_string()),
            _ if *engine == ZEROS => (Mark::Line, COLOURS[place % COLOURS.len()], format!("{engine}, {output}")),
            Axis::Pixels => (Mark::Dot, COLOURS[place % COLOURS.len()], format!("{engine}, {output}")),
            Axis::Objects if *keep_all => (Mark::Line, of_scene(place, scene), format!("{scene}, by brute force")),
            Axis::Objects => (Mark::Dot, of_scene(place, scene), scene.to_string()),
        }
    };
    let entries: Vec<Entry> = lines.iter().enumerate().map(entry).collect();
    let area = head(area, &format!("Cycles per pixel against {name}"), &entries)?;
    let points = || lines.iter().flatten().map(point);
    let (x, y) = (around(points().map(|at| at.0), (0.8, 1.25)), around(points().map(|at| at.1), (0.7, 1.4)));
    let series = lines.iter().zip(&entries).map(|(line, (shape, colour, _))| {
        let width = if *shape == Mark::Line { 1 } else { 2 };
        let mark = (*shape == Mark::Dot).then_some((Mark::Dot, 3));
        Series { mark, ..Series::line(line.iter().map(point), *colour, width) }
    });
    let series = series.collect();
    LogChart { x: (x, name), y: (y, "TSC cycles per pixel"), series, names: Vec::new() }.draw(&area, [10, 40, 56])
}
