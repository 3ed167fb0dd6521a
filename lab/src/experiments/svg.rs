//! What all figures share: an SVG on white, the colours of engines, axes, and the legend.

use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::ranged1d::{Ranged, ValueFormatter};
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

// Colours that people with colour blindness can tell apart (Okabe and Ito, 2008).
const BLUE: RGBColor = RGBColor(0, 114, 178);
const VERMILION: RGBColor = RGBColor(213, 94, 0);
const GREEN: RGBColor = RGBColor(0, 158, 115);
const PURPLE: RGBColor = RGBColor(204, 121, 167);
pub(super) const ORANGE: RGBColor = RGBColor(230, 159, 0);
const SKY: RGBColor = RGBColor(86, 180, 233);
/// The colours of lines that do not stand for engines, in turn.
pub(super) const COLOURS: [RGBColor; 6] = [BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY];
/// The colour of controls and of reference lines.
pub(super) const GREY: RGBColor = RGBColor(120, 120, 120);

/// The colour that an engine has in every figure.
pub(super) fn colour_of(engine: &str) -> RGBColor {
    match engine {
        "rust" => ORANGE,
        "c" => VERMILION,
        "paper" => PURPLE,
        "sse41" => SKY,
        "avx2" => GREEN,
        "avx512" => BLUE,
        "reference" => BLACK,
        _ => GREY,
    }
}

/// A generic font family, which every viewer has.
pub(super) const FONT: &str = "sans-serif";
/// The height of letters in titles, and in all other text.
const TITLE: i32 = 18;
pub(super) const SMALL: i32 = 13;
/// The average width of a letter, as a share of its height.
const LETTER: f64 = 0.56;

/// The area that a figure is drawn on.
pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
/// A chart with axes on such an area.
pub(super) type Chart<'a, 'b, X, Y> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<X, Y>>;

/// The kind of screen that a figure is drawn for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Screen {
    /// A page.
    Wide,
    /// A telephone, where the letters of a wide figure would be too small.
    Narrow,
}

impl Screen {
    /// The size in pixels that a figure has on this screen if it has the given size on a page.
    pub(super) fn size(self, (width, height): (i32, i32)) -> (i32, i32) {
        if self == Screen::Narrow { (360, height.min(420)) } else { (width, height) }
    }
}

/// Draws a figure of this size in pixels on white, and returns the SVG.
pub(super) fn draw(
    (width, height): (i32, i32),
    figure: impl FnOnce(&Area<'_>) -> Result<(), PlotError>,
) -> Result<String, PlotError> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, (width as u32, height as u32)).into_drawing_area();
        area.fill(&WHITE)?;
        figure(&area)?;
        area.present()?;
    }
    Ok(short(&svg))
}

/// Shortens an SVG without changing what it shows: drops attributes with default values, states the
/// font once, and rounds letter heights to a tenth of a pixel.
fn short(svg: &str) -> String {
    let font = format!(" font-family=\"{FONT}\"");
    let mut short = String::with_capacity(svg.len());
    for line in svg.lines() {
        let mut line = line.to_owned();
        for default in [" opacity=\"1\"", " stroke=\"none\"", " stroke-width=\"1\"", " text-anchor=\"start\"", &font] {
            line = line.replace(default, "");
        }
        if let Some((before, rest)) = line.split_once("font-size=\"")
            && let Some((size, after)) = rest.split_once('"')
            && let Ok(size) = size.parse::<f64>()
        {
            line = format!("{before}font-size=\"{size:.1}\"{after}");
        }
        short += line.replacen("<svg ", &format!("<svg{font} "), 1).trim_end();
        let is_within_text = line.starts_with("<text") || !line.starts_with('<');
        if !is_within_text {
            short.push('\n');
        }
    }
    short
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mark {
    /// A filled circle.
    Dot,
    Triangle,
    /// A square's outline.
    Square,
    /// Two strokes.
    Cross,
    Line,
}

/// Draws a mark at a position in the area.
pub(super) fn mark(
    area: &Area<'_>,
    mark: Mark,
    (x, y): (i32, i32),
    size: i32,
    colour: impl Color,
) -> Result<(), PlotError> {
    let thick = colour.stroke_width(2);
    Ok(match mark {
        Mark::Dot => area.draw(&Circle::new((x, y), size, colour.filled())),
        Mark::Triangle => area.draw(&TriangleMarker::new((x, y), size + 1, colour.filled())),
        Mark::Square => area.draw(&Rectangle::new([(x - size, y - size), (x + size, y + size)], thick)),
        Mark::Cross => area.draw(&Cross::new((x, y), size, thick)),
        Mark::Line => area.draw(&PathElement::new([(x - 8, y), (x + 8, y)], thick)),
    }?)
}

/// An entry of the legend.
pub(super) type Entry = (Mark, RGBColor, String);

/// Writes the title, and below it the legend in as many lines as it needs. Returns the area that is
/// left for the data.
pub(super) fn head<'a>(area: &Area<'a>, title: &str, entries: &[Entry]) -> Result<Area<'a>, PlotError> {
    let (width, line) = (area.dim_in_pixel().0 as i32, SMALL + 8);
    let mut y = 8;
    for words in lines(title, TITLE, width - 24) {
        write(area, &words, (12, y), TITLE)?;
        y += TITLE + 4;
    }
    if entries.is_empty() {
        return Ok(area.split_vertically(y).1);
    }
    let mut x = 24;
    y += 10;
    for (shape, colour, label) in entries {
        let words = lines(label, SMALL, width - 48);
        let wide = 16 + words.iter().map(|words| text_width(words, SMALL)).max().unwrap_or(0) + 24;
        if x + wide > width && x > 24 {
            (x, y) = (24, y + line);
        }
        mark(area, *shape, (x, y), 4, *colour)?;
        for (place, words) in words.iter().enumerate() {
            y += if place == 0 { 0 } else { SMALL + 2 };
            write(area, words, (x + 14, y - SMALL / 2 - 1), SMALL)?;
        }
        x += wide;
    }
    Ok(area.split_vertically(y + SMALL).1)
}

/// Breaks a text into lines of at most `width` pixels. A word that is wider gets a line of its own.
pub(super) fn lines(text: &str, size: i32, width: i32) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split(' ') {
        match lines.last_mut() {
            Some(line) if text_width(line, size) + text_width(word, size) + size / 2 <= width => {
                *line += " ";
                *line += word;
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// Draws a vertical line of the given opacity at a value of an axis, and writes the value below it.
pub(super) fn down(area: &Area<'_>, x: i32, bottom: i32, value: f64, strength: f64) -> Result<(), PlotError> {
    area.draw(&PathElement::new([(x, 0), (x, bottom + 4)], BLACK.mix(strength).stroke_width(1)))?;
    let value = tick(&value);
    write(area, &value, (x - text_width(&value, SMALL) / 2, bottom + 8), SMALL)
}

/// Places names beside marks so that they cover neither each other nor a mark.
struct Names {
    within: [i32; 4],
    taken: Vec<[i32; 4]>,
}

impl Names {
    /// The height of the names' letters.
    const SIZE: i32 = SMALL - 2;

    /// For names beside these marks, within these ranges of pixels.
    fn among(marks: impl Iterator<Item = (i32, i32)>, (x, y): (Range<i32>, Range<i32>)) -> Self {
        let taken = marks.map(|(x, y)| [x - 5, y - 5, x + 5, y + 5]).collect();
        Names { within: [x.start, y.start, x.end, y.end], taken }
    }

    /// The offset of a name from its mark, to the right and downwards. None if there is no room for
    /// it.
    fn place(&mut self, name: &str, (x, y): (i32, i32)) -> Option<(i32, i32)> {
        let (wide, high) = (text_width(name, Self::SIZE), Self::SIZE);
        let [left, top, right, bottom] = self.within;
        let beside = |far: i32| {
            let (right, left, middle) = (8, -8 - wide, -wide / 2);
            let (above, below) = (-6 - high - far, 6 + far);
            [(right + far, -high / 2), (left - far, -high / 2), (middle, above), (middle, below)]
                .into_iter()
                .chain([right, left].into_iter().flat_map(move |side| [(side, above), (side, below)]))
        };
        let free = |[a, b, c, d]: [i32; 4]| {
            let apart = |of: &[i32; 4]| c <= of[0] || of[2] <= a || d <= of[1] || of[3] <= b;
            left <= a && c <= right && top <= b && d <= bottom && self.taken.iter().all(apart)
        };
        let at = |(right, down): (i32, i32)| [x + right, y + down, x + right + wide, y + down + high];
        let offset = [0, 8, 16, 24, 32, 40, 48].into_iter().flat_map(beside).find(|offset| free(at(*offset)))?;
        self.taken.push(at(offset));
        Some(offset)
    }
}

/// The approximate width of a text in pixels.
pub(super) fn text_width(text: &str, size: i32) -> i32 {
    (text.chars().count() as f64 * f64::from(size) * LETTER) as i32
}

/// Draws the axes, each labelled with its quantity.
pub(super) fn axes<X, Y>(chart: &mut Chart<'_, '_, X, Y>, x: &str, y: &str) -> Result<(), PlotError>
where
    X: Ranged<ValueType = f64> + ValueFormatter<f64>,
    Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(BLACK.mix(0.12))
        .x_labels(8)
        .y_labels(8)
        .x_desc(x)
        .y_desc(y)
        .x_label_formatter(&tick)
        .y_label_formatter(&tick)
        .label_style((FONT, SMALL))
        .axis_desc_style((FONT, SMALL + 1))
        .draw()?;
    Ok(())
}

/// Checks that a logarithmic axis can show `range`; `of` names the axis's quantity. The drawing
/// library would never finish with an empty or infinite range, as of figures that were not
/// measured.
fn on_axis(range: Range<f64>, of: &str) -> Result<Range<f64>, PlotError> {
    if range.start > 0.0 && range.start < range.end && range.end / range.start < 1e30 {
        Ok(range)
    } else {
        Err(PlotError(format!("{of} from {:e} to {:e} fit on no axis", range.start, range.end)))
    }
}

/// Points with the same mark, joined by a line unless its width is 0.
pub(super) struct Series {
    pub points: Vec<(f64, f64)>,
    pub colour: RGBAColor,
    pub width: u32,
    pub mark: Option<(Mark, i32)>,
}

impl Series {
    pub(super) fn line(points: impl IntoIterator<Item = (f64, f64)>, colour: impl Color, width: u32) -> Self {
        Series { points: points.into_iter().collect(), colour: colour.to_rgba(), width, mark: None }
    }
}

/// A chart of several series on two logarithmic axes, each of which has a range and a quantity.
pub(super) struct LogChart<'a> {
    pub x: (Range<f64>, &'a str),
    pub y: (Range<f64>, &'a str),
    /// The series, drawn in this order.
    pub series: Vec<Series>,
    /// Names of points, which are drawn where there is room among marks and lines.
    pub names: Vec<(String, (f64, f64))>,
}

impl LogChart<'_> {
    /// Draws the chart. The margins, in pixels, are those around the chart, below it, and at its
    /// left.
    pub(super) fn draw(self, area: &Area<'_>, [margin, below, left]: [i32; 3]) -> Result<(), PlotError> {
        let LogChart { x, y, series, names } = self;
        let mut chart = ChartBuilder::on(area)
            .margin(margin)
            .x_label_area_size(below)
            .y_label_area_size(left)
            .build_cartesian_2d(on_axis(x.0, x.1)?.log_scale(), on_axis(y.0, y.1)?.log_scale())?;
        axes(&mut chart, x.1, y.1)?;
        let (mut marked, (left, top)) = (Vec::new(), area.get_base_pixel());
        for Series { points, colour, width, mark: shape } in series {
            if width > 0 {
                chart.draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(width)))?;
                let corners: Vec<_> = points.iter().map(|at| chart.backend_coord(at)).collect();
                marked.extend(corners.windows(2).flat_map(|ends| along(ends[0], ends[1])));
            }
            let Some((shape, size)) = shape else { continue };
            for at in points {
                let (x, y) = chart.backend_coord(&at);
                mark(area, shape, (x - left, y - top), size, colour)?;
                marked.push((x, y));
            }
        }
        let mut free = Names::among(marked.into_iter(), chart.plotting_area().get_pixel_range());
        for (name, at) in names {
            if let Some(offset) = free.place(&name, chart.backend_coord(&at)) {
                chart.draw_series([EmptyElement::at(at) + Text::new(name, offset, (FONT, Names::SIZE))])?;
            }
        }
        Ok(())
    }
}

/// Pixels along a straight line, so close together that a name cannot fit between two of them
/// without touching the line.
fn along(from: (i32, i32), to: (i32, i32)) -> impl Iterator<Item = (i32, i32)> {
    const APART: i32 = 8;
    let (right, down) = (to.0 - from.0, to.1 - from.1);
    let steps = (right.abs().max(down.abs()) / APART).max(1);
    (0..=steps).map(move |step| (from.0 + right * step / steps, from.1 + down * step / steps))
}

/// The margins of a chart that is a figure by itself.
pub(super) const ALONE: [i32; 3] = [12, 44, 64];

/// Legend entries of engines: each once, in the order of appearance.
pub(super) fn engines<'a>(mark: Mark, engines: impl Iterator<Item = &'a str>) -> Vec<Entry> {
    let mut entries = Vec::new();
    for engine in engines {
        let entry = (mark, colour_of(engine), engine.to_owned());
        if !entries.contains(&entry) {
            entries.push(entry);
        }
    }
    entries
}

/// A number at an axis: 0.25, 1000, 10⁶.
pub(super) fn tick(x: &f64) -> String {
    let exponent = x.abs().log10();
    let whole = exponent.round();
    match x.abs() {
        _ if exponent.is_finite() && (whole - exponent).abs() < 1e-9 && !(-2.0..4.0).contains(&whole) => {
            format!("10{}", superscript(whole as i32))
        }
        0.0 | 1e-3..1e5 => format!("{}", (x * 1e6).round() / 1e6),
        _ => format!("{x:e}"),
    }
}

fn superscript(exponent: i32) -> String {
    let digit = |c| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        digit => char::from_u32('⁰' as u32 + digit as u32 - '0' as u32).unwrap_or(digit),
    };
    exponent.to_string().chars().map(digit).collect()
}

/// The range of some positive values, widened by factors below and above.
pub(super) fn around(values: impl Iterator<Item = f64>, (below, above): (f64, f64)) -> Range<f64> {
    let (low, high) = values.fold((f64::INFINITY, 0.0), |(low, high): (f64, f64), x| (low.min(x), high.max(x)));
    if low <= high { below * low..above * high } else { 1.0..10.0 }
}

/// Writes a text at a position, in letters of this height.
pub(super) fn write(area: &Area<'_>, text: &str, at: (i32, i32), size: i32) -> Result<(), PlotError> {
    Ok(area.draw(&Text::new(text.to_owned(), at, (FONT, size)))?)
}

#[cfg(test)]
mod tests {
    #[test]
    fn numbers_at_axes_are_short() {
        let ticks =
            [0.0, 0.25, 1.0, 1000.0, 1e4, 2e4, 1e6, 1e-9, 0.01, 0.001, 0.30000000000000004].map(|x| super::tick(&x));
        assert_eq!(ticks, ["0", "0.25", "1", "1000", "10⁴", "20000", "10⁶", "10⁻⁹", "0.01", "10⁻³", "0.3"]);
    }
}
