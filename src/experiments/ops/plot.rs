//! The figure: cycles against instructions, a mark for each operation in each implementation.

use plotters::prelude::*;

use super::Report;
use crate::experiments::svg::{
    Entry, FONT, GREY, Mark, Names, ORANGE, PlotError, Screen, around, colour_of, draw, head, log_chart,
};

const SIZE: (i32, i32) = (960, 560);

/// The implementations that are shown: whose, and by what mark.
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

/// Instructions and cycles for each vector, on logarithmic axes.
pub fn figure(report: &Report, screen: Screen) -> Result<String, PlotError> {
    let mut marks = Vec::new();
    for row in &report.rows {
        let shown = SHOWN.iter().find(|(name, _)| *name == row.implementation);
        let cycles = row.throughput.or(row.call_throughput);
        let count = row.per_vector.or(row.function.map(|count| count as f64));
        if let (Some((_, mark)), Some(cycles), Some(count)) = (shown, cycles, count) {
            let vectors = row.vectors.unwrap_or(1) as f64;
            marks.push((&*row.op, &*row.implementation, *mark, (count, cycles / vectors)));
        }
    }
    let of = |name: &str| marks.iter().any(|(_, implementation, ..)| *implementation == name);
    let mut entries: Vec<Entry> = SHOWN
        .iter()
        .filter(|(name, _)| of(name))
        .map(|(name, mark)| (*mark, colour(name), (*name).to_owned()))
        .collect();
    entries.push((Mark::Line, GREY, "a cycle for each instruction".into()));
    let x = around(marks.iter().map(|(.., at)| at.0), (0.6, 1.8));
    let y = around(marks.iter().map(|(.., at)| at.1), (0.6, 1.8));
    draw(screen.size(SIZE), |area| {
        let area = head(area, "Fewer instructions are not always faster", &entries)?;
        let mut chart = log_chart(
            &area,
            (x.clone(), "instructions for each vector"),
            (y.clone(), "core cycles for each vector, many independent"),
        )?;
        let (low, high) = (x.start.max(y.start), x.end.min(y.end));
        chart.draw_series(LineSeries::new([(low, low), (high, high)], GREY.stroke_width(1)))?;
        let mut labels: Vec<(String, (f64, f64))> = Vec::new();
        for (op, implementation, mark, at) in &marks {
            let colour = colour(implementation);
            match mark {
                Mark::Triangle => chart.draw_series([TriangleMarker::new(*at, 6, colour.filled())]).map(drop),
                Mark::Square => {
                    let square = Rectangle::new([(-4, -4), (4, 4)], colour.stroke_width(2));
                    chart.draw_series([EmptyElement::at(*at) + square]).map(drop)
                }
                _ => chart.draw_series([Circle::new(*at, 5, colour.filled())]).map(drop),
            }?;
            if ["c-O3", "paper"].contains(implementation) {
                // What takes the same shares a name.
                let same = |(_, (x, y)): &&mut (String, (f64, f64))| *x == at.0 && (y.ln() - at.1.ln()).abs() < 0.1;
                match labels.iter_mut().find(same) {
                    Some((names, _)) => *names += &format!(", {op}"),
                    None => labels.push(((*op).to_owned(), *at)),
                }
            }
        }
        let on_screen = |at: &(f64, f64)| chart.backend_coord(at);
        let mut free =
            Names::among(marks.iter().map(|(.., at)| on_screen(at)), chart.plotting_area().get_pixel_range());
        let placed = labels.iter().filter_map(|(name, at)| Some((name, *at, free.place(name, on_screen(at))?)));
        for (name, at, offset) in placed.collect::<Vec<_>>() {
            chart.draw_series([EmptyElement::at(at) + Text::new(name.clone(), offset, (FONT, Names::SIZE))])?;
        }
        Ok(())
    })
}
