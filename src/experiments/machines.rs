//! Machines side by side: the factor of each, and each engine's cycles beside its machine's own limit.

use plotters::prelude::*;

use super::report::Results;
use super::speedup::{CONTROL, PAPER, Timing};
use super::svg::{GREY, Mark, PlotError, SMALL, Screen, colour_of, down, draw, head, lines, text_width, write};
use crate::measure::statistics::Estimate;
use crate::render::PixelFormat;

const WIDTH: i32 = 960;
const LINE: i32 = 28;
/// A line of a machine's name.
const NAME: i32 = SMALL + 2;

/// C/SIMD of each machine, with its interval, over the range of the paper's twenty sizes.
pub fn figure(ratios: &[(&str, Estimate)], screen: Screen) -> Result<String, PlotError> {
    let papers = PAPER.map(|row| row.ratio());
    let (low, high) = papers.iter().fold((f64::INFINITY, 0.0), |(low, high), ratio| (ratio.min(low), ratio.max(high)));
    let most = ratios.iter().map(|(_, estimate)| estimate.high).fold(high, f64::max) * 1.05;
    let (width, _) = screen.size((WIDTH, 0));
    let names: Vec<_> = ratios.iter().map(|(name, _)| lines(name, SMALL, width / 2)).collect();
    let left = names.iter().flatten().map(|name| text_width(name, SMALL)).max().unwrap_or(0) + 24;
    let place = |ratio: f64| left + ((f64::from(width - left - 60)) * ratio / most) as i32;
    let bottom = names.iter().map(|name| LINE + NAME * (name.len() as i32 - 1)).sum();
    let entries = [
        (Mark::Dot, colour_of(CONTROL), "C/SIMD over all sizes".into()),
        (Mark::Line, GREY, format!("the paper's sizes, {low:.1} to {high:.1}")),
    ];
    draw((width, bottom + 120), |area| {
        let area = head(area, "How many times as fast the SIMD is", &entries)?;
        for whole in 0..=most as i32 {
            down(&area, place(f64::from(whole)), bottom, f64::from(whole), 0.12)?;
        }
        area.draw(&Rectangle::new([(place(low), 0), (place(high), bottom)], GREY.mix(0.3).filled()))?;
        let mut y = LINE / 2;
        for (name, (_, estimate)) in names.iter().zip(ratios) {
            let colour = colour_of(CONTROL);
            for (line, words) in name.iter().enumerate() {
                write(&area, words, (8, y - SMALL / 2 + NAME * line as i32), SMALL)?;
            }
            area.draw(&PathElement::new(
                [(place(estimate.low), y), (place(estimate.high.min(most)), y)],
                colour.stroke_width(3),
            ))?;
            area.draw(&Circle::new((place(estimate.value), y), 5, colour.filled()))?;
            write(&area, &format!("{:.2}", estimate.value), (place(estimate.high) + 10, y - SMALL / 2), SMALL)?;
            y += LINE + NAME * (name.len() as i32 - 1);
        }
        Ok(())
    })
}

/// Every engine at the largest size of the experiment, with what the widest stores take for a pixel's bytes, where the picture is;
/// None where that was not measured.
pub fn against_bound(results: &Results) -> impl Iterator<Item = (&Timing, Option<f64>)> {
    let rows = || results.experiment.iter().flat_map(|experiment| &experiment.table.rows);
    let most = rows().map(|row| row.pixels).max();
    let bound = |row: &Timing| {
        let format = PixelFormat::ALL.into_iter().find(|format| format.name() == row.output)?;
        let bytes = row.pixels as usize * format.bytes();
        let roofs = &results.roofline.as_ref()?.roofs;
        // The first level that the picture fits into, or the last that there is.
        let caches = &results.machine.caches;
        let level = caches.iter().position(|cache| bytes <= cache.bytes).unwrap_or(caches.len());
        let roof = roofs.get(level).or(roofs.last())?;
        Some(format.bytes() as f64 / roof.bytes_per_cycle)
    };
    rows().filter(move |row| Some(row.pixels) == most).map(move |row| (row, bound(row)))
}
