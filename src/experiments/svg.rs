//! What all figures share: an SVG on white, its font, and the list of its series.

use plotters::coord::Shift;
use plotters::prelude::*;

/// Why there is no figure.
#[derive(Debug, thiserror::Error)]
#[error("cannot draw the figure: {0}")]
pub struct PlotError(String);

impl PlotError {
    pub(super) fn new(error: impl ToString) -> Self {
        PlotError(error.to_string())
    }
}

/// A font that every viewer has.
pub(super) const FONT: &str = "sans-serif";

/// What a figure is drawn on.
pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Draws on white, of so many pixels, and gives the SVG.
pub(super) fn draw(
    width: i32,
    height: i32,
    figure: impl FnOnce(&Area<'_>) -> Result<(), PlotError>,
) -> Result<String, PlotError> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (width as u32, height as u32)).into_drawing_area();
        area.fill(&WHITE).map_err(PlotError::new)?;
        figure(&area)?;
        area.present().map_err(PlotError::new)?;
    }
    Ok(svg)
}

/// The list of the labelled series.
#[cfg(rayo_asm)]
pub(super) fn legend<'a, T: CoordTranslate>(
    chart: &mut ChartContext<'a, SVGBackend<'a>, T>,
    position: SeriesLabelPosition,
) -> Result<(), PlotError> {
    chart
        .configure_series_labels()
        .position(position)
        .background_style(WHITE.mix(0.9))
        .border_style(BLACK.mix(0.3))
        .label_font((FONT, 14))
        .margin(10)
        .draw()
        .map_err(PlotError::new)
}
