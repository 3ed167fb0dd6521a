//! The options for developing a picture: what happens to the linear light after tracing.

use std::path::Path;

use clap::Args;

use super::number::whole;
use super::{Failure, say};
use rayo::internals::render::{Development, Format};
use rayo::internals::scene::{Camera, Scene, shown, srgb};

/// The most samples per pixel in each direction.
const MOST_SAMPLES: u32 = 16;
/// The largest exposure, up or down, in stops.
const MOST_STOPS: f64 = 60.0;

/// How a picture is developed.
#[derive(Debug, Args)]
pub struct DevelopmentArgs {
    /// Trace N times N rays (N up to 16) through each pixel, on a regular grid, and average their
    /// linear light, for smooth edges
    #[arg(long, value_name = "N", value_parser = whole(1..=MOST_SAMPLES), allow_hyphen_values = true)]
    samples: Option<u32>,
    /// Take samples only of pixels at edges of the plain picture: this is faster, and within a
    /// level where light is smooth, but misses what is smaller than a pixel. A preview has all
    /// samples
    #[arg(long, requires = "samples")]
    edges: bool,
    /// The colour of rays that hit nothing: linear red, green and blue, of which 1 is white, or
    /// '#rrggbb' in sRGB, which a picture with --srgb shows as it is
    #[arg(long, value_name = "R,G,B|#rrggbb", value_parser = colour, allow_hyphen_values = true)]
    background: Option<[f32; 3]>,
    /// Multiply all light by 2 to this power, from -60 to 60
    #[arg(long, value_name = "STOPS", value_parser = stops, allow_hyphen_values = true)]
    exposure: Option<f64>,
    /// Write levels on the sRGB curve, as screens expect them, instead of linear ones; for formats
    /// with 8 bits
    #[arg(long)]
    srgb: bool,
}

fn stops(text: &str) -> Result<f64, String> {
    let stops = text.parse().ok().filter(|stops: &f64| stops.abs() <= MOST_STOPS);
    stops.ok_or_else(|| format!("expected a number of stops from -{MOST_STOPS} to {MOST_STOPS}"))
}

pub(super) fn colour(text: &str) -> Result<[f32; 3], &'static str> {
    if let Some(digits) = text.strip_prefix('#') {
        return levels(digits).ok_or("expected '#rrggbb', with two hexadecimal digits each of red, green and blue");
    }
    let channel = |text: &str| text.trim().parse().ok().filter(|v: &f32| v.is_finite() && *v >= 0.0);
    let colour: Option<Vec<f32>> = text.split(',').map(channel).collect();
    let colour = colour.and_then(|colour| colour.try_into().ok());
    colour.ok_or(
        "expected three numbers of at least 0 with commas between them, as in 0.2,0.3,0.5, or a colour as '#ff8000'",
    )
}

/// The linear light of six hexadecimal digits of sRGB levels.
fn levels(digits: &str) -> Option<[f32; 3]> {
    let are_digits = digits.len() == 6 && digits.bytes().all(|digit| digit.is_ascii_hexdigit());
    let [_, levels @ ..] = u32::from_str_radix(digits, 16).ok().filter(|_| are_digits)?.to_be_bytes();
    Some(levels.map(|level| srgb::decode(f64::from(level) / 255.0) as f32))
}

impl DevelopmentArgs {
    /// The development that the options ask for, of the picture at `path`; None if no option is
    /// given.
    pub(super) fn of(&self, path: &Path, format: Format) -> Result<Option<Development>, Failure> {
        if self.srgb && !format.is_8bit() {
            return Err(Failure::input(format!(
                "{}: --srgb is for formats with 8 bits, and this one has linear floats: leave it out, or name a .png",
                shown(path)
            )));
        }
        let plain = Development::default();
        let development = self.with_samples(plain.samples);
        Ok((development != plain).then_some(development))
    }

    /// Notes that an 8-bit picture clips a background brighter than white: the user may have meant
    /// levels up to 255.
    pub(super) fn note_bright_background(&self) {
        let Some(background) = self.background else { return };
        let exposure = self.exposure.unwrap_or_default().exp2();
        if background.iter().any(|channel| f64::from(*channel) * exposure > 1.0) {
            let background = background.map(|channel| channel.to_string()).join(",");
            say(&format!(
                "note: --background {background} is brighter than white, which is 1,1,1; levels from 0 to 255 are written in \
                 hexadecimal, as in '#ff8000'"
            ));
        }
    }

    /// With --edges: the scene with the camera of the picture itself, one ray per pixel, in which
    /// edges are searched.
    pub(super) fn plain(&self, scene: &Scene, camera: Camera) -> Option<Scene> {
        (self.edges && self.samples > Some(1)).then(|| Scene { camera, ..scene.clone() })
    }

    /// The development that the options ask for, with this many samples by default.
    pub(super) fn with_samples(&self, samples: u32) -> Development {
        let plain = Development::default();
        Development {
            samples: self.samples.unwrap_or(samples),
            background: self.background.unwrap_or(plain.background),
            exposure: self.exposure.unwrap_or(plain.exposure),
            srgb: self.srgb,
        }
    }
}

/// The camera that traces all samples of a picture with this camera.
pub(super) fn sampled(camera: &Camera, development: Development) -> Result<Camera, Failure> {
    let samples = development.samples;
    development.camera(camera).map_err(|error| Failure::input(format!("--samples {samples}: {error}")))
}
