//! The figures of the experiment as SVG: time against pixels, as the paper's Figure 2, and the ratio.

use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use super::document::Experiment;
use super::speedup::{BASELINE, CONTROL, PAPER, Timing, paper_mean_ratio};
use super::svg::{BLUE, FONT, PlotError, VERMILION, draw, legend};

const WIDTH: i32 = 960;
const HEIGHT: i32 = 600;
const C_COLOUR: RGBColor = VERMILION;
const SIMD_COLOUR: RGBColor = BLUE;
const CONTROL_COLOUR: RGBColor = RGBColor(120, 120, 120);

/// Megapixels and billions of cycles of an engine's rows: the means, as the paper gives them.
fn points<'a>(document: &'a Experiment, engine: &'a str) -> impl Iterator<Item = (f64, f64)> + 'a {
    document.rows.iter().filter(move |row| row.is(engine)).map(|row| (mega(row), row.cycles_mean / 1e9))
}

fn mega(row: &Timing) -> f64 {
    row.pixels as f64 / 1e6
}

/// From 0 to a little above the largest of `values`.
fn up_to(values: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    0.0..1.08 * values.fold(f64::MIN_POSITIVE, f64::max)
}

type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Megapixels to the right, and upwards what `y` says.
fn axes(chart: &mut Chart<'_, '_>, y: &str) -> Result<(), PlotError> {
    let mut mesh = chart.configure_mesh();
    mesh.light_line_style(TRANSPARENT).bold_line_style(BLACK.mix(0.12)).x_desc("megapixels").y_desc(y);
    Ok(mesh.label_style((FONT, 14)).axis_desc_style((FONT, 16)).draw()?)
}

/// Time against pixels: our C and SIMD on the left axis, the paper's on the right one, which is its machine's own.
pub fn figure2(document: &Experiment) -> Result<String, PlotError> {
    draw(WIDTH, HEIGHT, |area| {
        let ours = up_to(points(document, BASELINE).chain(points(document, CONTROL)).map(|(_, y)| y));
        let papers = up_to(PAPER.iter().map(|row| row.c / 1e9));
        let x = 0.0..2.1;
        let mut chart = ChartBuilder::on(area)
            .caption("Time of the picture: one sphere, one light", (FONT, 22))
            .margin(12)
            .x_label_area_size(44)
            .y_label_area_size(64)
            .right_y_label_area_size(64)
            .build_cartesian_2d(x.clone(), ours)?
            .set_secondary_coord(x, papers);
        axes(&mut chart, "10⁹ TSC cycles, this machine")?;
        chart
            .configure_secondary_axes()
            .y_desc("10⁹ TSC cycles, the paper's machine")
            .label_style((FONT, 14))
            .axis_desc_style((FONT, 16))
            .draw()?;
        for (engine, label, colour) in [(BASELINE, "C, here", C_COLOUR), (CONTROL, "SIMD, here", SIMD_COLOUR)] {
            chart
                .draw_series(LineSeries::new(points(document, engine), colour.stroke_width(2)).point_size(4))?
                .label(label)
                .legend(move |(x, y)| Circle::new((x + 10, y), 4, colour.filled()));
        }
        for (label, colour) in
            [("C, the paper's (right axis)", C_COLOUR), ("SIMD, the paper's (right axis)", SIMD_COLOUR)]
        {
            let points = PAPER.iter().map(|row| {
                let cycles = if colour == C_COLOUR { row.c } else { row.simd };
                (row.pixels() as f64 / 1e6, cycles / 1e9)
            });
            chart
                .draw_secondary_series(points.map(|point| Cross::new(point, 5, colour.stroke_width(2))))?
                .label(label)
                .legend(move |(x, y)| Cross::new((x + 10, y), 5, colour.stroke_width(2)));
        }
        legend(&mut chart, SeriesLabelPosition::UpperLeft)
    })
}

/// C/SIMD against pixels with its intervals, the paper's, and the control, whose distance from 1 is noise.
pub fn ratio(document: &Experiment) -> Result<String, PlotError> {
    draw(WIDTH, HEIGHT, |area| {
        let rows: Vec<_> = document.rows.iter().filter(|row| row.is(CONTROL)).collect();
        let highest = rows.iter().map(|row| row.ratio_to_c).chain(PAPER.iter().map(|row| row.ratio()));
        let y = up_to(highest);
        let top = y.end;
        let mut chart = ChartBuilder::on(area)
            .caption("C/SIMD: the median of the pairs, with its 95 % interval", (FONT, 22))
            .margin(12)
            .x_label_area_size(44)
            .y_label_area_size(56)
            .build_cartesian_2d(0.0..2.1, y)?;
        axes(&mut chart, "C/SIMD")?;
        // An interval that noise has blown up ends at the frame.
        let bar = |x: f64, value: f64, low: f64, high: f64, colour: RGBColor| {
            ErrorBar::new_vertical(x, low.min(top), value.min(top), high.min(top), colour.filled(), 8)
        };
        chart
            .draw_series(
                rows.iter().map(|row| bar(mega(row), row.ratio_to_c, row.ratio_low, row.ratio_high, SIMD_COLOUR)),
            )?
            .label("here")
            .legend(|(x, y)| Circle::new((x + 10, y), 4, SIMD_COLOUR.filled()));
        chart
            .draw_series(
                PAPER
                    .iter()
                    .map(|row| Cross::new((row.pixels() as f64 / 1e6, row.ratio()), 5, C_COLOUR.stroke_width(2))),
            )?
            .label(format!("the paper's, {:.2} in the mean", paper_mean_ratio()))
            .legend(|(x, y)| Cross::new((x + 10, y), 5, C_COLOUR.stroke_width(2)));
        chart
            .draw_series(document.control.iter().map(|row| {
                let x = f64::from(row.width) * f64::from(row.height) / 1e6;
                bar(x, row.ratio, row.low, row.high, CONTROL_COLOUR)
            }))?
            .label("SIMD against itself")
            .legend(|(x, y)| Circle::new((x + 10, y), 4, CONTROL_COLOUR.filled()));
        // Between the control at 1 and the ratios.
        legend(&mut chart, SeriesLabelPosition::Coordinate(WIDTH / 12, HEIGHT / 2))
    })
}
