//! The figure of operations per cycle against operations per byte, under the roofs.

use super::{Peak, Point, Roofline};
use crate::experiments::svg::{
    ALONE, GREY, LogChart, Mark, PlotError, Screen, Series, around, colour_of, draw, engines, head,
};

const SIZE: (i32, i32) = (960, 560);

/// A point's operations per byte, and its operations per cycle.
fn position(point: &Point) -> (f64, f64) {
    (point.flops_per_pixel / point.bytes_per_pixel, point.flops_per_pixel / point.cycles_per_pixel)
}

/// The mark of a scene.
fn shape(scene: &str) -> Mark {
    if scene == "sphere" { Mark::Dot } else { Mark::Triangle }
}

pub fn figure(roofline: &Roofline, screen: Screen) -> Result<String, PlotError> {
    let Roofline { peaks, roofs, points, .. } = roofline;
    let mut entries = engines(Mark::Dot, points.iter().map(|point| &*point.engine));
    for point in points {
        let label = format!("{} (shape)", point.scene);
        if !entries.iter().any(|(_, _, name)| *name == label) {
            entries.push((shape(&point.scene), GREY, label));
        }
    }
    let levels = |peak: &Peak| format!("{}: at most {:.0}", peak.isa, peak.flops_per_cycle);
    entries.extend(peaks.iter().map(|peak| (Mark::Line, colour_of(&peak.isa), levels(peak))));
    let slopes = roofs.iter().map(|roof| format!("{}: {:.1} bytes a cycle", roof.level, roof.bytes_per_cycle));
    entries.extend(slopes.map(|label| (Mark::Line, GREY, label)));
    draw(screen.size(SIZE), |area| {
        let area = head(area, "Roofline: f32 arithmetic against bytes written, one thread", &entries)?;
        chart(roofline).draw(&area, ALONE)
    })
}

/// The peaks, the roofs and the points on their axes.
fn chart(roofline: &Roofline) -> LogChart<'static> {
    let Roofline { peaks, roofs, points, .. } = roofline;
    let highest = peaks.iter().map(|peak| peak.flops_per_cycle).fold(1.0, f64::max);
    let lowest = points.iter().map(|point| position(point).1).fold(highest, f64::min).min(1.0);
    let x = around(points.iter().map(|point| position(point).0).chain([0.1, 100.0]), (0.7, 1.5));
    let y = 0.5 * lowest..2.0 * highest;
    let mut series = Vec::new();
    for peak in peaks {
        let level = peak.flops_per_cycle;
        series.push(Series::line([(x.start, level), (x.end, level)], colour_of(&peak.isa), 1));
    }
    for roof in roofs {
        let slope = roof.bytes_per_cycle;
        let end = (highest / slope).min(x.end);
        series.push(Series::line([(x.start, slope * x.start), (end, slope * end)], GREY, 1));
    }
    for point in points {
        let mark = Some((shape(&point.scene), 6));
        series.push(Series { mark, ..Series::line([position(point)], colour_of(&point.engine), 0) });
    }
    // The name of a sloping roof is at the middle of its visible part, that of a horizontal one at
    // its right end.
    let mut names = Vec::new();
    for roof in roofs {
        let slope = roof.bytes_per_cycle;
        let middle = (x.start.max(y.start / slope) * (highest / slope).min(x.end)).sqrt();
        names.push((roof.level.clone(), (middle, slope * middle)));
    }
    names.extend(peaks.iter().map(|peak| (peak.isa.to_string(), (0.5 * x.end, peak.flops_per_cycle))));
    LogChart { x: (x, "operations per byte of the picture"), y: (y, "operations per TSC cycle"), series, names }
}
