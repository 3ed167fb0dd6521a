//! The figure: operations per cycle against operations per byte, under the limits of the core and each level of memory.

use super::Roofline;
use crate::experiments::svg::{
    ALONE, GREY, LogChart, Mark, PlotError, Screen, Series, around, colour_of, draw, engines, head,
};

const SIZE: (i32, i32) = (960, 560);

pub fn figure(roofline: &Roofline, screen: Screen) -> Result<String, PlotError> {
    let Roofline { peaks, roofs, points, .. } = roofline;
    let at = |point: &super::Point| {
        (point.flops_per_pixel / point.bytes_per_pixel, point.flops_per_pixel / point.cycles_per_pixel)
    };
    let mut entries = engines(Mark::Dot, points.iter().map(|point| &*point.engine));
    let shape = |scene: &str| if scene == "sphere" { Mark::Dot } else { Mark::Triangle };
    for point in points {
        let label = format!("{} (shape)", point.scene);
        if !entries.iter().any(|(_, _, name)| *name == label) {
            entries.push((shape(&point.scene), GREY, label));
        }
    }
    let levels = |peak: &super::Peak| format!("{}: at most {:.0}", peak.isa, peak.flops_per_cycle);
    entries.extend(peaks.iter().map(|peak| (Mark::Line, colour_of(&peak.isa), levels(peak))));
    let slopes = roofs.iter().map(|roof| format!("{}: {:.1} bytes a cycle", roof.level, roof.bytes_per_cycle));
    entries.extend(slopes.map(|label| (Mark::Line, GREY, label)));
    let highest = peaks.iter().map(|peak| peak.flops_per_cycle).fold(1.0, f64::max);
    let lowest = points.iter().map(|point| at(point).1).fold(highest, f64::min).min(1.0);
    let x = around(points.iter().map(|point| at(point).0).chain([0.1, 100.0]), (0.7, 1.5));
    draw(screen.size(SIZE), |area| {
        let area = head(area, "Roofline: arithmetic of f32 against what is written, one thread", &entries)?;
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
            series.push(Series { mark, ..Series::line([at(point)], colour_of(&point.engine), 0) });
        }
        let x = (x.clone(), "operations by the byte of the picture");
        let y = (0.5 * lowest..2.0 * highest, "operations in a TSC cycle");
        LogChart { x, y, series, names: Vec::new() }.draw(&area, ALONE)
    })
}
