//! The figures of the experiment: time against pixels, the ratio C/SIMD, and the ladder.

use plotters::prelude::*;

use super::document::Experiment;
use super::ladder::Rung;
use super::speedup::{BASELINE, CONTROL, PAPER, Timing, paper_mean_ratio};
use super::svg::{
    Area, FONT, GREY, Mark, PlotError, SMALL, Screen, axes, colour_of, down, draw, head, lines, text_width, tick, write,
};

const SIZE: (i32, i32) = (960, 560);

/// For each size megapixels and billions of cycles of an engine: mean cycles, since the paper gives
/// means.
fn points<'a>(document: &'a Experiment, engine: &'a str) -> impl Iterator<Item = (f64, f64)> + 'a {
    document.table.rows.iter().filter(move |row| row.is(engine)).map(|row| (mega(row), row.cycles_mean / 1e9))
}

fn mega(row: &Timing) -> f64 {
    row.pixels as f64 / 1e6
}

/// From 0 to a little above the largest of `values`.
fn up_to(values: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    0.0..1.08 * values.fold(f64::MIN_POSITIVE, f64::max)
}

/// Draws time against pixels: our C and SIMD on the left axis, and the paper's on an axis at the
/// right, since they were measured on another machine.
pub fn figure2(document: &Experiment, screen: Screen) -> Result<String, PlotError> {
    let (c, simd) = (colour_of(BASELINE), colour_of(CONTROL));
    let entries = [
        (Mark::Dot, c, "C, here"),
        (Mark::Dot, simd, "SIMD, here"),
        (Mark::Cross, c, "C, the paper's (right axis)"),
        (Mark::Cross, simd, "SIMD, the paper's (right axis)"),
    ];
    draw(screen.size(SIZE), |area| {
        let title = "Time of the picture: one sphere, one light";
        let area = head(area, title, &entries.map(|(mark, colour, text)| (mark, colour, text.into())))?;
        draw_times(&area, document)
    })
}

/// The axes and series of [`figure2`].
fn draw_times(area: &Area<'_>, document: &Experiment) -> Result<(), PlotError> {
    let (c, simd) = (colour_of(BASELINE), colour_of(CONTROL));
    let ours = up_to(points(document, BASELINE).chain(points(document, CONTROL)).map(|(_, y)| y));
    let papers = up_to(PAPER.iter().map(|row| row.c / 1e9));
    let x = 0.0..2.1;
    let mut chart = ChartBuilder::on(area)
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(64)
        .right_y_label_area_size(64)
        .build_cartesian_2d(x.clone(), ours)?
        .set_secondary_coord(x, papers);
    axes(&mut chart, "megapixels", "10⁹ TSC cycles, this machine")?;
    chart
        .configure_secondary_axes()
        .y_desc("10⁹ TSC cycles, the paper's machine")
        .y_label_formatter(&tick)
        .label_style((FONT, SMALL))
        .axis_desc_style((FONT, SMALL + 1))
        .draw()?;
    for (engine, colour) in [(BASELINE, c), (CONTROL, simd)] {
        let line = LineSeries::new(points(document, engine), colour.stroke_width(2));
        chart.draw_series(line)?;
        chart.draw_series(points(document, engine).map(|at| Circle::new(at, 4, colour.filled())))?;
    }
    for (colour, cycles) in [(c, (|row| row.c) as fn(&super::speedup::PaperRow) -> f64), (simd, |row| row.simd)] {
        let points = PAPER.iter().map(|row| (row.pixels() as f64 / 1e6, cycles(row) / 1e9));
        chart.draw_secondary_series(points.map(|at| Cross::new(at, 5, colour.stroke_width(2))))?;
    }
    Ok(())
}

/// Draws C/SIMD against pixels with its intervals, beside the paper's ratios and the control, whose
/// distance from 1 is noise.
pub fn ratio(document: &Experiment, screen: Screen) -> Result<String, PlotError> {
    let (simd, paper) = (colour_of(CONTROL), colour_of(BASELINE));
    let entries = [
        (Mark::Dot, simd, "here".into()),
        (Mark::Cross, paper, format!("the paper's, {:.2} in the mean", paper_mean_ratio())),
        (Mark::Dot, GREY, "SIMD against itself".into()),
    ];
    draw(screen.size(SIZE), |area| {
        draw_ratios(&head(area, "C/SIMD: the median of the pairs, with its 95 % interval", &entries)?, document)
    })
}

/// The axes and series of [`ratio`].
fn draw_ratios(area: &Area<'_>, document: &Experiment) -> Result<(), PlotError> {
    let (simd, paper) = (colour_of(CONTROL), colour_of(BASELINE));
    let rows: Vec<_> = document.table.rows.iter().filter(|row| row.is(CONTROL)).collect();
    let highest = rows.iter().map(|row| row.ratio_to_c).chain(PAPER.iter().map(|row| row.ratio()));
    let y = up_to(highest);
    let top = y.end;
    let mut chart = ChartBuilder::on(area)
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(56)
        .build_cartesian_2d(0.0..2.1, y)?;
    axes(&mut chart, "megapixels", "C/SIMD")?;
    // An interval that noise has made very wide is cut off at the frame.
    let bar = |x: f64, value: f64, low: f64, high: f64, colour: RGBColor| {
        ErrorBar::new_vertical(x, low.min(top), value.min(top), high.min(top), colour.filled(), 8)
    };
    chart.draw_series(rows.iter().map(|row| bar(mega(row), row.ratio_to_c, row.ratio_low, row.ratio_high, simd)))?;
    chart.draw_series(
        PAPER.iter().map(|row| Cross::new((row.pixels() as f64 / 1e6, row.ratio()), 5, paper.stroke_width(2))),
    )?;
    chart.draw_series(document.table.control.iter().map(|row| {
        let x = f64::from(row.width) * f64::from(row.height) / 1e6;
        bar(x, row.ratio, row.low, row.high, GREY)
    }))?;
    Ok(())
}

/// The height of a rung's bar, and of the gap below the bar.
const BAR: (i32, i32) = (18, 8);
/// The columns of the bars in a wide figure, which has names to their left and words to their
/// right. In a narrow figure names and words are above the bars.
const BARS: std::ops::Range<i32> = 205..570;
const LADDER_WIDTH: i32 = 1080;

/// The layout of the ladder's figure.
struct Waterfall<'a> {
    ladder: &'a [Rung],
    screen: Screen,
    width: i32,
    /// The columns of the bars.
    bars: std::ops::Range<i32>,
    /// The binary logarithms of the smallest and of the largest cost.
    low: f64,
    high: f64,
}

/// Draws the ladder as a waterfall: how each change affects the cycles per pixel, from the first
/// rung to the last. The scale is logarithmic, so that factors add up. Asides are drawn in grey and
/// do not shift the bars after them.
pub fn waterfall(ladder: &[Rung], screen: Screen) -> Result<String, PlotError> {
    let (width, _) = screen.size((LADDER_WIDTH, 0));
    let bars = if screen == Screen::Narrow { 16..width - 16 } else { BARS };
    let costs = || ladder.iter().map(|rung| rung.cycles_per_pixel);
    let low = costs().fold(f64::INFINITY, f64::min).log2();
    let high = costs().fold(0.0, f64::max).log2();
    let layout = Waterfall { ladder, screen, width, bars, low, high };
    let bottom: i32 = ladder.iter().map(|rung| layout.height_of(rung)).sum();
    let entries = [
        (Mark::Dot, colour_of("avx512"), "faster than what it builds on".into()),
        (Mark::Dot, colour_of("c"), "slower".into()),
        (Mark::Dot, GREY, "an aside: the next rung does not build on it".into()),
    ];
    draw((width, bottom + if screen == Screen::Narrow { 160 } else { 110 }), |area| {
        let area = head(area, "From the paper's C to the fastest engine, one change a bar", &entries)?;
        layout.draw_axis(&area, bottom)?;
        layout.draw_rungs(&area)
    })
}

impl Waterfall<'_> {
    /// The column of a cost.
    fn column(&self, cycles: f64) -> i32 {
        let std::ops::Range { start, end } = self.bars;
        start + ((cycles.log2() - self.low) / (self.high - self.low).max(1.0) * f64::from(end - start)) as i32
    }

    /// The words that stand right of a rung's bar or, in a narrow figure, with its name above it.
    fn words(&self, rung: &Rung) -> Vec<String> {
        let gain = if rung.over.is_some() { format!(", ×{:.2}", rung.gain) } else { String::new() };
        let words = format!("{} cycles{gain}: {}", cycles(rung.cycles_per_pixel), rung.change);
        if self.screen == Screen::Narrow {
            lines(&format!("{}: {words}", rung.rung), SMALL, self.width - 24)
        } else {
            vec![words]
        }
    }

    /// The height of a rung's bar with its gap, and in a narrow figure with its words.
    fn height_of(&self, rung: &Rung) -> i32 {
        let above = if self.screen == Screen::Narrow { (SMALL + 2) * self.words(rung).len() as i32 } else { 0 };
        above + BAR.0 + BAR.1
    }

    /// Draws the axis: its lines, and below them the quantity.
    fn draw_axis(&self, area: &Area<'_>, bottom: i32) -> Result<(), PlotError> {
        let values = (-4..8).flat_map(|exponent| [1.0, 3.0].map(|digit| digit * 10_f64.powi(exponent)));
        for value in values.filter(|value| (self.low..=self.high).contains(&value.log2())) {
            down(area, self.column(value), bottom, value, 0.12)?;
        }
        let quantity = "TSC cycles per pixel";
        let left = (self.bars.start + self.bars.end - text_width(quantity, SMALL)) / 2;
        write(area, quantity, (left, bottom + 26), SMALL + 1)
    }

    /// Draws a bar for each rung, with its name and its words.
    fn draw_rungs(&self, area: &Area<'_>) -> Result<(), PlotError> {
        let mut y = 6;
        for rung in self.ladder {
            let before = rung.over.as_ref().and_then(|over| self.ladder.iter().find(|other| other.rung == *over));
            let now = self.column(rung.cycles_per_pixel);
            let from = before.map_or(now, |before| self.column(before.cycles_per_pixel));
            let colour = if rung.aside || before.is_none() {
                GREY
            } else {
                colour_of(if rung.gain >= 1.0 { "avx512" } else { "c" })
            };
            let words = self.words(rung);
            if self.screen == Screen::Narrow {
                for words in &words {
                    write(area, words, (12, y), SMALL)?;
                    y += SMALL + 2;
                }
            } else {
                write(area, &rung.rung, (8, y + 2), SMALL)?;
                write(area, &words.concat(), (self.bars.end + 16, y + 2), SMALL)?;
            }
            area.draw(&Rectangle::new([(now.min(from) - 1, y), (now.max(from) + 1, y + BAR.0)], colour.filled()))?;
            y += BAR.0 + BAR.1;
        }
        Ok(())
    }
}

/// Cycles with about three digits.
fn cycles(cycles: f64) -> String {
    if cycles < 10.0 { format!("{cycles:.2}") } else { format!("{cycles:.0}") }
}
