//! The figure: cycles by the pixel against pixels, objects and lights, a panel each, on logarithmic axes.

use plotters::prelude::*;

use super::{Growth, ZEROS, lines};
use crate::experiments::claims::Axis;
use crate::experiments::svg::{Area, BLUE, FONT, GREEN, ORANGE, PURPLE, PlotError, SKY, VERMILION, draw, legend};

const PANEL: (i32, i32) = (460, 460);
/// How many times as high as its highest point a panel is: above, there is room for the list of its lines.
const ROOM: f64 = 50.0;

const COLOURS: [RGBColor; 7] = [BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK];

/// Draws the panels side by side.
pub fn figure(rows: &[Growth]) -> Result<String, PlotError> {
    let axes = [Axis::Pixels, Axis::Objects, Axis::Lights];
    draw(PANEL.0 * axes.len() as i32, PANEL.1, |area| {
        for (cell, axis) in area.split_evenly((1, axes.len())).iter().zip(axes) {
            let mut of_axis: Vec<_> = lines(rows).into_iter().filter(|line| line[0].axis == axis).collect();
            if axis == Axis::Pixels {
                // Each engine in each kind of pixel would be too many lines: the fastest, which is the last.
                let fastest = rows.iter().rfind(|row| row.axis == axis && row.engine != ZEROS).map(|row| row.engine);
                of_axis.retain(|line| line[0].engine == ZEROS || Some(line[0].engine) == fastest);
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
    let points = || lines.iter().flatten().map(point);
    let ends = |of: fn((f64, f64)) -> f64| {
        let values = || points().map(of);
        (values().fold(f64::INFINITY, f64::min), values().fold(0.0, f64::max))
    };
    let ((left, right), (low, high)) = (ends(|p| p.0), ends(|p| p.1));
    let mut chart = ChartBuilder::on(area)
        .caption(format!("Cycles by the pixel against {name}"), (FONT, 16))
        .margin(8)
        .x_label_area_size(36)
        .y_label_area_size(52)
        .build_cartesian_2d((0.8 * left..1.25 * right).log_scale(), (0.7 * low..ROOM * high).log_scale())?;
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.1))
        .x_desc(name)
        .y_desc("TSC cycles by the pixel")
        .x_label_formatter(&|x| format!("{x:e}"))
        .label_style((FONT, 12))
        .axis_desc_style((FONT, 13))
        .draw()?;
    for (place, line) in lines.iter().enumerate() {
        // What only fills the film has the colour of those who trace the same kind of pixels.
        let same = |other: &Vec<&Growth>| line[0].axis == Axis::Pixels && other[0].output == line[0].output;
        let colour = COLOURS[lines.iter().position(same).unwrap_or(place) % COLOURS.len()];
        let Growth { scene, engine, output, keep_all, .. } = *line[0];
        let label = match line[0].axis {
            Axis::Objects => format!("{scene}{}", if keep_all { ", by brute force" } else { "" }),
            Axis::Pixels => format!("{engine}, {output}"),
            Axis::Lights => engine.to_owned(),
        };
        let width = if engine == ZEROS || keep_all { 1 } else { 2 };
        chart
            .draw_series(LineSeries::new(line.iter().map(point), colour.stroke_width(width)).point_size(3))?
            .label(label)
            .legend(move |(x, y)| Circle::new((x + 10, y), 4, colour.filled()));
    }
    legend(&mut chart, SeriesLabelPosition::UpperLeft)
}
