//! Several machines side by side: C/SIMD on each, and each engine beside its machine's limit.

use plotters::prelude::*;

use super::report::Results;
use super::speedup::{CONTROL, PAPER, Timing};
use super::svg::{Area, GREY, Mark, PlotError, SMALL, Screen, colour_of, down, draw, head, lines, text_width, write};
use crate::measure::statistics::Estimate;
use rayo::internals::render::PixelFormat;

const WIDTH: i32 = 960;
const LINE: i32 = 28;
/// The height of the line with a machine's name.
const NAME: i32 = SMALL + 2;

/// C/SIMD over all sizes, as measured on one machine.
pub struct RatioOfMachine<'a> {
    /// The machine's name.
    pub name: &'a str,
    pub estimate: Estimate,
}

/// Draws C/SIMD of each machine with its interval, above the range of the paper's twenty ratios.
pub fn figure(ratios: &[RatioOfMachine<'_>], screen: Screen) -> Result<String, PlotError> {
    let papers = PAPER.map(|row| row.ratio());
    let (low, high) = papers.iter().fold((f64::INFINITY, 0.0), |(low, high), ratio| (ratio.min(low), ratio.max(high)));
    let most = ratios.iter().map(|ratio| ratio.estimate.high).fold(high, f64::max) * 1.05;
    let (width, _) = screen.size((WIDTH, 0));
    let names: Vec<_> = ratios.iter().map(|ratio| lines(ratio.name, SMALL, width / 2)).collect();
    let left = names.iter().flatten().map(|name| text_width(name, SMALL)).max().unwrap_or(0) + 24;
    let place = |ratio: f64| left + ((f64::from(width - left - 60)) * ratio / most) as i32;
    let bottom = names.iter().map(|name| LINE + NAME * (name.len() as i32 - 1)).sum();
    let entries = [
        (Mark::Dot, colour_of(CONTROL), "C/SIMD over all sizes".into()),
        (Mark::Line, GREY, format!("the paper's sizes, {low:.1} to {high:.1}")),
    ];
    draw((width, bottom + 120), |area| {
        let area = head(area, "How many times as fast the SIMD is", &entries)?;
        (0..=most as i32).map(f64::from).try_for_each(|whole| down(&area, place(whole), bottom, whole, 0.12))?;
        area.draw(&Rectangle::new([(place(low), 0), (place(high), bottom)], GREY.mix(0.3).filled()))?;
        let mut y = LINE / 2;
        for (name, ratio) in names.iter().zip(ratios) {
            for (line, words) in name.iter().enumerate() {
                write(&area, words, (8, y - SMALL / 2 + NAME * line as i32), SMALL)?;
            }
            let Estimate { value, low, high } = ratio.estimate;
            draw_interval(&area, y, [low, value, high.min(most)].map(place))?;
            write(&area, &format!("{value:.2}"), (place(high) + 10, y - SMALL / 2), SMALL)?;
            y += LINE + NAME * (name.len() as i32 - 1);
        }
        Ok(())
    })
}

/// Draws an interval with its value. `y` is the line; the columns are those of the interval's low
/// end, value and high end.
fn draw_interval(area: &Area<'_>, y: i32, [low, value, high]: [i32; 3]) -> Result<(), PlotError> {
    let colour = colour_of(CONTROL);
    area.draw(&PathElement::new([(low, y), (high, y)], colour.stroke_width(3)))?;
    Ok(area.draw(&Circle::new((value, y), 5, colour.filled()))?)
}

/// The time of an engine, and the limit that its machine's memory sets.
pub struct AgainstBound<'a> {
    pub timing: &'a Timing,
    /// The cycles per pixel that the widest stores need in the nearest level of memory that holds
    /// the picture; None where the stores were not measured.
    pub bound: Option<f64>,
}

/// Every engine at the experiment's largest size, with its machine's limit.
pub fn against_bound(results: &Results) -> impl Iterator<Item = AgainstBound<'_>> {
    let rows = || results.experiment.iter().flat_map(|experiment| &experiment.table.rows);
    let most = rows().map(|row| row.pixels).max();
    let bound = |row: &Timing| {
        let format = PixelFormat::ALL.into_iter().find(|format| format.name() == row.output)?;
        let bytes = row.pixels as usize * format.bytes();
        let roofs = &results.roofline.as_ref()?.roofs;
        // The first level of cache that the picture fits into, or memory if it fits into none.
        let caches = &results.machine.caches;
        let level = caches.iter().position(|cache| bytes <= cache.bytes).unwrap_or(caches.len());
        let roof = roofs.get(level).or(roofs.last())?;
        Some(format.bytes() as f64 / roof.bytes_per_cycle)
    };
    rows().filter(move |row| Some(row.pixels) == most).map(move |row| AgainstBound { timing: row, bound: bound(row) })
}
