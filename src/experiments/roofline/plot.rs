//! The figure: operations in a cycle against operations by the byte, under what the core and each level of memory take.

use plotters::prelude::*;

use super::Roofline;
use crate::experiments::svg::{FONT, GREY, Mark, Names, PlotError, Screen, around, colour_of, draw, head, log_chart};

const SIZE: (i32, i32) = (960, 560);

/// Draws it.
pub fn figure(roofline: &Roofline, screen: Screen) -> Result<String, PlotError> {
    let Roofline { peaks, roofs, points, .. } = roofline;
    let at = |point: &super::Point| {
        (point.flops_per_pixel / point.bytes_per_pixel, point.flops_per_pixel / point.cycles_per_pixel)
    };
    let mut entries = Vec::new();
    for point in points {
        if !entries.iter().any(|(_, _, name)| *name == point.engine) {
            entries.push((Mark::Dot, colour_of(&point.engine), point.engine.to_string()));
        }
    }
    let shape = |scene: &str| if scene == "sphere" { Mark::Dot } else { Mark::Triangle };
    for point in points {
        let label = format!("{} (shape)", point.scene);
        if !entries.iter().any(|(_, _, name)| *name == label) {
            entries.push((shape(&point.scene), GREY, label));
        }
    }
    let highest = peaks.iter().map(|peak| peak.flops_per_cycle).fold(1.0, f64::max);
    let lowest = points.iter().map(|point| at(point).1).fold(highest, f64::min).min(1.0);
    let x = around(points.iter().map(|point| at(point).0).chain([0.1, 100.0]), (0.7, 1.5));
    draw(screen.size(SIZE), |area| {
        let area = head(area, "Roofline: arithmetic of f32 against what is written, one thread", &entries)?;
        let mut chart = log_chart(
            &area,
            (x.clone(), "operations by the byte of the picture"),
            (0.5 * lowest..2.0 * highest, "operations in a TSC cycle"),
        )?;
        let mut names: Vec<(String, (f64, f64))> = Vec::new();
        for peak in peaks {
            let level = peak.flops_per_cycle;
            let line = [(x.start, level), (x.end, level)];
            chart.draw_series(LineSeries::new(line, colour_of(&peak.isa).stroke_width(1)))?;
            // What takes the same shares a line.
            match names.iter_mut().find(|(_, (_, other))| (other / (1.25 * level)).ln().abs() < 0.05) {
                Some((name, _)) => *name = format!("{}, {name}", peak.isa),
                None => names.push((format!("{}: {level:.0}", peak.isa), (x.start, 1.25 * level))),
            }
        }
        for roof in roofs {
            let slope = roof.bytes_per_cycle;
            let end = (highest / slope).min(x.end);
            chart
                .draw_series(LineSeries::new([(x.start, slope * x.start), (end, slope * end)], GREY.stroke_width(1)))?;
            let at = (0.75 * lowest / slope).max(x.start);
            names.push((format!("{}: {slope:.1} bytes", roof.level), (at, 0.8 * slope * at)));
        }
        let on_screen = |at: &(f64, f64)| chart.backend_coord(at);
        let marks = points.iter().map(|point| on_screen(&at(point)));
        let mut free = Names::among(marks, chart.plotting_area().get_pixel_range());
        let placed = names.iter().filter_map(|(name, at)| Some((name, *at, free.place(name, on_screen(at))?)));
        for (name, at, offset) in placed.collect::<Vec<_>>() {
            chart.draw_series([EmptyElement::at(at) + Text::new(name.clone(), offset, (FONT, Names::SIZE))])?;
        }
        for point in points {
            let colour = colour_of(&point.engine);
            match shape(&point.scene) {
                Mark::Dot => chart.draw_series([Circle::new(at(point), 6, colour.filled())]).map(drop),
                _ => chart.draw_series([TriangleMarker::new(at(point), 7, colour.filled())]).map(drop),
            }?;
        }
        Ok(())
    })
}
