//! `rayo render --preview`: shows the picture of a scene in the terminal, traced at the terminal's
//! resolution.

use std::ops::Range;
use std::time::Instant;

use anstyle::{Color, Reset, RgbColor, Style};
use anstyle_lossy::rgb_to_xterm;

use super::development::sampled;
use super::engine::Tracing;
use super::{Failure, colour_on_stdout, say, terminal_size, write_out};
use rayo::internals::render::{Developed, Development, Film, Frame, PixelFormat};
use rayo::internals::scene::{Camera, Scene};

/// The size in characters that is assumed if standard output is no terminal.
const PAGE: (usize, usize) = (80, 24);
/// Lines of the terminal that are left free, for messages below the picture and for the prompt.
const BELOW: usize = 2;
/// Characters from dark to bright.
const LETTERS: &[u8] = b" .:-=+*#%@";

/// What to show of a scene, and how.
pub struct Preview {
    pub tracing: Tracing,
    pub development: Development,
    /// The camera of the full picture.
    pub camera: Camera,
    /// The rows of the full picture that are shown.
    pub rows: Range<u32>,
    pub explain: bool,
    pub quiet: bool,
    /// The path of the scene file, made safe to print.
    pub scene_name: String,
}

impl Preview {
    /// The default samples per pixel and direction. A terminal has so few pixels that edges would
    /// look ragged with fewer.
    pub const SAMPLES: u32 = 4;

    /// Prints the picture of the scene. Replaces the scene's camera by the one that traces all
    /// samples.
    pub fn show(&self, scene: &mut Scene) -> Result<(), Failure> {
        let (columns, lines) = terminal_size().map_or(PAGE, |(columns, lines)| (columns, lines.saturating_sub(BELOW)));
        let Fitted { camera, rows } = fit(&self.camera, self.rows.clone(), (columns as u32, lines as u32));
        scene.camera = sampled(&camera, self.development)?;
        let (pixels, width) = (self.trace(scene, &camera, rows)?, camera.width() as usize);
        let text = if colour_on_stdout() { blocks(&pixels, width, true_colour()) } else { letters(&pixels, width) };
        write_out(text.as_bytes())
    }

    /// The RGB values of the pixels in these rows.
    fn trace(&self, scene: &Scene, camera: &Camera, rows: Range<u32>) -> Result<Vec<[u8; 3]>, Failure> {
        let Preview { tracing, development, .. } = *self;
        let plan = tracing.plan(scene, Some(PixelFormat::F32x4))?;
        if self.explain {
            plan.report().lines().iter().for_each(|line| say(line));
        }
        let developed = Developed::new(plan.tracer(), camera, development);
        let frame = Frame::new(&developed, *camera, tracing.settings()).map_err(Failure::from)?;
        let mut film = frame.film(PixelFormat::Rgb8, rows.len() as u32).map_err(Failure::from)?;
        let clock = Instant::now();
        frame.trace(rows.clone(), film.as_mut(), &|_| ()).map_err(Failure::from)?;
        if !self.quiet {
            let (width, height, samples) = (camera.width(), rows.len(), development.samples);
            let (name, engine, time) = (&self.scene_name, tracing.engine, clock.elapsed());
            say(&format!(
                "preview of {name}: {width}x{height}, {samples}x{samples} samples by {engine}, traced in {time:.1?}"
            ));
        }
        let Film::Rgb8(pixels) = film else { unreachable!("it was asked for") };
        Ok(pixels)
    }
}

/// A picture that fits into the terminal.
struct Fitted {
    camera: Camera,
    /// The rows of that picture that are shown.
    rows: Range<u32>,
}

/// Scales a picture to fit into this many characters, each of which shows two pixels one above the
/// other. The result has the camera of the scaled picture, which is never larger than the original,
/// and the rows that correspond to `rows`.
fn fit(camera: &Camera, rows: Range<u32>, (columns, lines): (u32, u32)) -> Fitted {
    let (most, all) = (2 * lines.max(1), rows.len() as f64);
    let scale = (f64::from(columns) / f64::from(camera.width())).min(f64::from(most) / all).min(1.0);
    let side = |side: u32| ((f64::from(side) * scale).round() as u32).max(1);
    let (width, height) = (side(camera.width()), side(camera.height()));
    let share = |row: u32| f64::from(row) / f64::from(camera.height()) * f64::from(height);
    let first = (share(rows.start) as u32).min(height - 1);
    let end = (share(rows.end).round() as u32).clamp(first + 1, first + most);
    let camera = camera.sized(width, height).expect("it is no larger than a camera's picture");
    Fitted { camera, rows: first..end }
}

/// Whether the terminal shows 24-bit colours, by the conventional variable COLORTERM.
fn true_colour() -> bool {
    std::env::var("COLORTERM").is_ok_and(|value| ["truecolor", "24bit"].contains(&value.as_str()))
}

/// The picture as lines of upper half blocks: the foreground colour is the upper pixel, the
/// background colour the lower one. Colours have 24 bits, or are among the 256 that nearly all
/// terminals have.
fn blocks(pixels: &[[u8; 3]], width: usize, true_colour: bool) -> String {
    let colour = |&[red, green, blue]: &[u8; 3]| -> Color {
        let rgb = RgbColor(red, green, blue);
        if true_colour { rgb.into() } else { rgb_to_xterm(rgb).into() }
    };
    let mut text = String::new();
    for pair in pixels.chunks(2 * width) {
        let (above, below) = pair.split_at(width);
        let mut last = None;
        for (x, above) in above.iter().enumerate() {
            let style = Style::new().fg_color(Some(colour(above))).bg_color(below.get(x).map(colour));
            if last != Some(style) {
                text += &style.to_string();
                last = Some(style);
            }
            text.push('▀');
        }
        text += &format!("{Reset}\n");
    }
    text
}

/// The picture as lines of characters, each as bright as its two pixels.
fn letters(pixels: &[[u8; 3]], width: usize) -> String {
    // Luma of ITU-R BT.709.
    let brightness = |[red, green, blue]: [u8; 3]| {
        (0.2126 * f64::from(red) + 0.7152 * f64::from(green) + 0.0722 * f64::from(blue)) / 255.0
    };
    let mut text = String::new();
    for pair in pixels.chunks(2 * width) {
        let (above, below) = pair.split_at(width);
        let letter = |(x, above): (usize, &[u8; 3])| {
            let both = (brightness(*above) + brightness(*below.get(x).unwrap_or(above))) / 2.0;
            char::from(LETTERS[(both * (LETTERS.len() - 1) as f64).round() as usize])
        };
        let line: String = above.iter().enumerate().map(letter).collect();
        text += line.trim_end();
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayo::internals::scene::MAX_SIDE;

    fn camera(width: u32, height: u32) -> Camera {
        Camera::new(width, height, 1.0, 1.0).unwrap()
    }

    #[test]
    fn a_picture_fits_into_the_terminal_and_keeps_its_shape() {
        for ((width, height), (columns, lines), expected) in [
            ((1632, 1224), (80, 24), (64, 48)),
            ((1632, 1224), (40, 50), (40, 30)),
            ((40, 30), (80, 24), (40, 30)),
            ((MAX_SIDE, 2), (80, 24), (80, 1)),
            ((2, MAX_SIDE), (80, 24), (1, 48)),
            ((400, 300), (80, 0), (3, 2)),
        ] {
            let Fitted { camera: fitted, rows } = fit(&camera(width, height), 0..height, (columns, lines));
            assert_eq!((fitted.width(), fitted.height()), expected, "{width}x{height} in {columns}x{lines}");
            assert_eq!(rows, 0..expected.1);
        }
    }

    const WHITE: [u8; 3] = [255; 3];
    const BLACK: [u8; 3] = [0; 3];

    #[test]
    fn letters_are_as_bright_as_two_pixels() {
        let pixels = [
            [WHITE, WHITE, BLACK, BLACK], //
            [WHITE, [64; 3], BLACK, BLACK],
            [BLACK, BLACK, [0, 255, 0], BLACK],
        ];
        assert_eq!(letters(pixels.as_flattened(), 4), "@*\n  *\n");
    }

    #[test]
    fn blocks_have_both_pixels_and_say_a_colour_once() {
        let pixels = [
            [[1, 2, 3], [1, 2, 3], WHITE], //
            [[4, 5, 6], [4, 5, 6], BLACK],
            [BLACK, BLACK, BLACK],
        ];
        let (colour, white) = ("\u{1b}[38;2;1;2;3m\u{1b}[48;2;4;5;6m", "\u{1b}[38;2;255;255;255m\u{1b}[48;2;0;0;0m");
        let last = "\u{1b}[38;2;0;0;0m▀▀▀\u{1b}[0m\n";
        let expected = format!("{colour}▀▀{white}▀\u{1b}[0m\n{last}");
        assert_eq!(blocks(pixels.as_flattened(), 3, true), expected);
        assert_eq!(
            blocks(&[WHITE, BLACK, WHITE, BLACK], 2, false),
            "\u{1b}[38;5;231m\u{1b}[48;5;231m▀\u{1b}[38;5;16m\u{1b}[48;5;16m▀\u{1b}[0m\n"
        );
    }
}
