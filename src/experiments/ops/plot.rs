//! The figure: cycles against instructions, a mark for each operation in each implementation.

use plotters::style::RGBColor;

use super::Report;
use crate::experiments::svg::{
    ALONE, Entry, GREY, LogChart, Mark, ORANGE, PlotError, Screen, Series, around, colour_of, draw, head,
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
        let (low, high) = (x.start.max(y.start), x.end.min(y.end));
        let mut series = vec![Series::line([(low, low), (high, high)], GREY, 1)];
        let mut names: Vec<(String, (f64, f64))> = Vec::new();
        for (op, implementation, mark, at) in &marks {
            let mark = Some((*mark, if *mark == Mark::Square { 4 } else { 5 }));
            series.push(Series { mark, ..Series::line([*at], colour(implementation), 0) });
            if ["c-O3", "paper"].contains(implementation) {
                // Operations with equal figures share a name.
                let same = |(_, (x, y)): &&mut (String, (f64, f64))| *x == at.0 && (y.ln() - at.1.ln()).abs() < 0.1;
                match names.iter_mut().find(same) {
                    Some((names, _)) => *names += &format!(", {op}"),
                    None => names.push(((*op).to_owned(), *at)),
                }
            }
        }
        let x = (x.clone(), "instructions for each vector");
        let y = (y.clone(), "core cycles for each vector, many independent");
        LogChart { x, y, series, names }.draw(&area, ALONE)
    })
}
