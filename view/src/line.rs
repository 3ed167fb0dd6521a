//! The lines of text below the picture.

use std::convert::Infallible;

use embedded_graphics::Drawable as _;
use embedded_graphics::Pixel;
use embedded_graphics::draw_target::DrawTarget;
use embedded_graphics::geometry::{OriginDimensions, Point, Size};
use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::ascii::FONT_7X13;
use embedded_graphics::pixelcolor::{Rgb888, RgbColor as _};
use embedded_graphics::text::{Baseline, Text};

/// The height of a line of text in pixels, with the gap above it.
const LINE_HEIGHT: u32 = 15;

/// Pixels to the left of the text.
const MARGIN: i32 = 4;

/// The colour behind the text, as 0xAARRGGBB.
const BACKGROUND: u32 = 0xff_202020;

/// The rows of pixels that `lines` lines of text take with letters `scale` times as large as the
/// font.
pub fn height_of(lines: u32, scale: u32) -> u32 {
    lines * LINE_HEIGHT * scale
}

/// Draws at most two lines of text, the first one brighter, over `rows`: whole rows of a window of
/// `width` pixels.
pub fn draw(lines: &[&str], scale: u32, width: usize, rows: &mut [u32]) {
    let mut strip = Strip { scale, width, rows };
    strip.rows.fill(BACKGROUND);
    let colours = [Rgb888::WHITE, Rgb888::new(160, 190, 220)];
    for ((number, line), colour) in lines.iter().enumerate().zip(colours) {
        let position = Point::new(MARGIN, number as i32 * LINE_HEIGHT as i32 + 1);
        let style = MonoTextStyle::new(&FONT_7X13, colour);
        // The error of `Strip` is `Infallible`.
        let Ok(_) = Text::with_baseline(line, position, style, Baseline::Top).draw(&mut strip);
    }
}

/// Rows of a window as a target to draw to, each pixel of which is a square of `scale` times
/// `scale`.
struct Strip<'a> {
    scale: u32,
    width: usize,
    rows: &'a mut [u32],
}

impl OriginDimensions for Strip<'_> {
    fn size(&self) -> Size {
        let height = self.rows.len() / self.width.max(1);
        Size::new(self.width as u32 / self.scale, height as u32 / self.scale)
    }
}

impl DrawTarget for Strip<'_> {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        let Size { width, height } = self.size();
        for Pixel(Point { x, y }, colour) in pixels {
            let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else { continue };
            if x >= width || y >= height {
                continue;
            }
            let value = u32::from_be_bytes([255, colour.r(), colour.g(), colour.b()]);
            let side = self.scale as usize;
            let first = (y * self.scale) as usize * self.width + (x * self.scale) as usize;
            for row in self.rows[first..].chunks_mut(self.width).take(side) {
                let columns = side.min(row.len());
                row[..columns].fill(value);
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_are_drawn_at_any_scale_and_cut_at_the_edges() {
        let text = "avx2 single | 1 ~ \u{20ac}";
        for scale in [1, 2, 3] {
            for width in [1, 5, 40, 300] {
                let mut rows = vec![0; width * height_of(2, scale) as usize];
                draw(&[text, text], scale, width, &mut rows);
                assert!(rows.iter().all(|pixel| pixel >> 24 == 255));
                let lit = rows.iter().filter(|pixel| **pixel != BACKGROUND).count();
                // Part of a letter may fit into 5 columns.
                assert!(width == 5 || (lit > 0) == (width > 5), "{width} at {scale}");
                assert_eq!(lit % (scale * scale) as usize, 0);
            }
        }
        draw(&[text], 1, 7, &mut []);
    }
}
