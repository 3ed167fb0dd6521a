//! What all figures share: an SVG on white, its font, and the list of its series.

use plotters::coord::Shift;
use plotters::drawing::DrawingAreaErrorKind;
use plotters::prelude::*;

/// Why there is no figure.
#[derive(Debug, thiserror::Error)]
#[error("cannot draw the figure: {0}")]
pub struct PlotError(String);

impl<E: std::error::Error + Send + Sync> From<DrawingAreaErrorKind<E>> for PlotError {
    fn from(error: DrawingAreaErrorKind<E>) -> Self {
        PlotError(error.to_string())
    }
}

/// Colours that remain apart for those who see few of them (Okabe and Ito, 2008).
pub(super) const BLUE: RGBColor = RGBColor(0, 114, 178);
pub(super) const VERMILION: RGBColor = RGBColor(213, 94, 0);
pub(super) const GREEN: RGBColor = RGBColor(0, 158, 115);
pub(super) const PURPLE: RGBColor = RGBColor(204, 121, 167);
pub(super) const ORANGE: RGBColor = RGBColor(230, 159, 0);
pub(super) const SKY: RGBColor = RGBColor(86, 180, 233);

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
        area.fill(&WHITE)?;
        figure(&area)?;
        area.present()?;
    }
    Ok(svg)
}

/// The list of the labelled series.
#[cfg(rayo_asm)]
pub(super) fn legend<'a, T: CoordTranslate>(
    chart: &mut ChartContext<'a, SVGBackend<'a>, T>,
    position: SeriesLabelPosition,
) -> Result<(), PlotError> {
    let mut labels = chart.configure_series_labels();
    labels.position(position).background_style(WHITE.mix(0.9)).border_style(BLACK.mix(0.3));
    Ok(labels.label_font((FONT, 14)).margin(10).draw()?)
}

/// Words at a place, in letters of that size.
pub(super) fn write(area: &Area<'_>, text: &str, at: (i32, i32), size: i32) -> Result<(), PlotError> {
    Ok(area.draw(&Text::new(text.to_owned(), at, (FONT, size)))?)
}
