//! The figure of cycles against instructions, with a mark for each operation.

use plotters::style::RGBColor;

use super::Report;
use crate::experiments::svg::{
    ALONE, Entry, GREY, LogChart, Mark, ORANGE, PlotError, Screen, Series, around, colour_of, draw, head,
};

const SIZE: (i32, i32) = (960, 560);

/// The implementations that are shown, each with its mark.
const SHOWN: [(&str, Mark); 7] = [
    ("c-O3", Mark::Dot),
    ("glam", Mark::Dot),
    ("paper", Mark::Dot),
    ("aos", Mark::Square),
    ("sse41", Mark::Triangle),
    ("avx2", Mark::Triangle),
    ("avx512", Mark::Triangle),
];

fn colour(implementation: &str) -> RGBColor {
    match implementation {
        "c-O3" => colour_of("c"),
        "glam" => ORANGE,
        "aos" => colour_of("paper"),
        other => colour_of(other),
    }
}

/// A point of the figure: an operation of an implementation.
struct Point<'a> {
    op: &'a str,
    implementation: &'a str,
    mark: Mark,
    /// Instructions per vector, and cycles per vector.
    at: (f64, f64),
}

/// Draws cycles per vector against instructions per vector, on logarithmic axes.
pub fn figure(report: &Report, screen: Screen) -> Result<String, PlotError> {
    let mut points = Vec::new();
    for row in &report.rows {
        let shown = SHOWN.iter().find(|(name, _)| *name == row.implementation);
        let cycles = row.throughput.or(row.call_throughput);
        let count = row.per_vector.or(row.function.map(|count| count as f64));
        if let (Some((_, mark)), Some(cycles), Some(count)) = (shown, cycles, count) {
            let at = (count, cycles / row.vectors.unwrap_or(1) as f64);
            points.push(Point { op: &row.op, implementation: &row.implementation, mark: *mark, at });
        }
    }
    let is_there = |name: &str| points.iter().any(|point| point.implementation == name);
    let mut entries: Vec<Entry> = SHOWN
        .iter()
        .filter(|(name, _)| is_there(name))
        .map(|(name, mark)| (*mark, colour(name), (*name).to_owned()))
        .collect();
    entries.push((Mark::Line, GREY, "one cycle per instruction".into()));
    draw(screen.size(SIZE), |area| {
        let area = head(area, "Fewer instructions are not always faster", &entries)?;
        chart(&points).draw(&area, ALONE)
    })
}

/// The points on their axes, with the line of one cycle per instruction.
fn chart(points: &[Point<'_>]) -> LogChart<'static> {
    let x = around(points.iter().map(|point| point.at.0), (0.6, 1.8));
    let y = around(points.iter().map(|point| point.at.1), (0.6, 1.8));
    let (low, high) = (x.start.max(y.start), x.end.min(y.end));
    let mut series = vec![Series::line([(low, low), (high, high)], GREY, 1)];
    let mut names: Vec<(String, (f64, f64))> = Vec::new();
    for Point { op, implementation, mark, at } in points {
        let mark = Some((*mark, if *mark == Mark::Square { 4 } else { 5 }));
        series.push(Series { mark, ..Series::line([*at], colour(implementation), 0) });
        if ["c-O3", "paper"].contains(implementation) {
            // Operations at nearly the same position share a label.
            let same = |(_, (x, y)): &&mut (String, (f64, f64))| *x == at.0 && (y.ln() - at.1.ln()).abs() < 0.1;
            match names.iter_mut().find(same) {
                Some((names, _)) => *names += &format!(", {op}"),
                None => names.push(((*op).to_owned(), *at)),
            }
        }
    }
    LogChart {
        x: (x, "instructions per vector"),
        y: (y, "core cycles per vector, many operations being independent"),
        series,
        names,
    }
}
