//! `rayo diff`: compares two images and reports the difference in words, as JSON, or as a picture.

use super::{
    Failure, keep_apart, keep_off_terminals, keep_scene_files, keep_standard_input_whole, print_result,
    remove_part_files_on_signals,
};
use clap::Args;
use rayo::internals::render::{Format, ImageError, ImageFile, ImageWriter, is_standard_output};
use rayo::internals::scene::shown;
use rayo::{Picture, Pixels};
use rayo_lab::measure::compare::{self, CompareError, Comparison, Unit};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Compare two images pixel by pixel: exit 0 if they agree within the tolerance, 1 if not, 2 if
/// they cannot be compared
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  rayo diff f64.png simd.png
  rayo diff f64.png simd.png --tolerance 1 -o difference.png
  rayo diff f64.exr simd.exr --tolerance 1e-4 --json")]
pub struct DiffArgs {
    /// One image (PNG, PNM, PFM, EXR, HDR, TIFF or QOI, recognised by its content); - for standard
    /// input
    pub a: PathBuf,
    /// The other, of the same size and kind
    pub b: PathBuf,
    /// The largest difference of a channel that passes: in levels for 8-bit images, in linear
    /// values for floats
    #[arg(long, value_name = "T", default_value_t = 0.0, value_parser = tolerance, allow_hyphen_values = true)]
    pub tolerance: f64,
    /// Write a picture of the differences: black where there is none, white where it is largest,
    /// and at least grey where there is any
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Print one JSON document
    #[arg(long)]
    pub json: bool,
}

/// Compares the images, prints the result to standard output, and returns the verdict as exit code
/// 0 or 1.
///
/// # Errors
/// If the images cannot be compared.
pub fn run(args: &DiffArgs) -> Result<ExitCode, Failure> {
    keep_standard_input_whole(&[&args.a, &args.b])?;
    let output = args.output.as_deref().map(|path| {
        keep_apart(path, &[input(&args.a), input(&args.b)])?;
        // Before comparing, reject a name that no picture can be written to.
        let format = output_format(path)?;
        keep_scene_files(path)?;
        keep_off_terminals(path)?;
        remove_part_files_on_signals().map(|()| (path, format))
    });
    let (comparison, text) = diff(args, output.transpose()?)?;
    let within_tolerance = comparison.largest <= args.tolerance && comparison.largest.is_finite();
    let verdict = Verdict {
        a: args.a.to_string_lossy(),
        b: args.b.to_string_lossy(),
        tolerance: args.tolerance,
        within_tolerance,
        comparison,
    };
    print_result(args.json, &verdict, || text)?;
    Ok(if within_tolerance { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// The path to read an image from: `-` means standard input.
fn input(path: &Path) -> &Path {
    if path == Path::new("-") { Path::new("/dev/stdin") } else { path }
}

/// Compares the images; returns the result in numbers and in words, and writes the picture of the
/// differences.
fn diff(args: &DiffArgs, output: Option<(&Path, Format)>) -> Result<(Comparison, String), Failure> {
    let incomparable =
        |error| Failure::input(format!("cannot compare {} with {}: {error}", shown(&args.a), shown(&args.b)));
    let a = ImageFile::open(input(&args.a)).map_err(Failure::input)?;
    let b = ImageFile::open(input(&args.b)).map_err(Failure::input)?;
    // Compare the sizes before allocating memory for pixels.
    if a.size() != b.size() {
        return Err(incomparable(CompareError::Sizes(a.size(), b.size())));
    }
    let (a, b) = (a.read().map_err(Failure::input)?, b.read().map_err(Failure::input)?);
    let comparison = compare::compare(&a, &b).map_err(incomparable)?;
    if let Some((path, format)) = output {
        let difference = compare::difference_image(&a, &b).map_err(incomparable)?;
        write_picture(path, format, &difference).map_err(Failure::output)?;
    }
    let mut text = words(&comparison, &a, &b);
    if let Some((path, _)) = output {
        text += &format!("{}: the differences, white where they are largest\n", shown(path));
    }
    Ok((comparison, text))
}

/// The JSON document. The fields of the comparison are flattened into it.
#[derive(Serialize)]
struct Verdict<'a> {
    a: std::borrow::Cow<'a, str>,
    b: std::borrow::Cow<'a, str>,
    tolerance: f64,
    within_tolerance: bool,
    #[serde(flatten)]
    comparison: Comparison,
}

fn tolerance(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|tolerance: &f64| *tolerance >= 0.0).ok_or("expected a number that is not negative".into())
}

fn output_format(path: &Path) -> Result<Format, Failure> {
    if is_standard_output(path) {
        let message = "the verdict goes to standard output: name a file for the picture of the differences";
        return Err(Failure::input(message));
    }
    let format = Format::from_path(path).map_err(Failure::input)?;
    let floats = || format!("{}: the picture of differences has 8 bits; name it .png or .ppm", shown(path));
    format.is_8bit().then_some(format).ok_or_else(|| Failure::input(floats()))
}

fn write_picture(path: &Path, format: Format, picture: &Picture) -> Result<(), ImageError> {
    let Pixels::Rgb8(pixels) = &picture.pixels else { unreachable!("differences are shown in 8 bits") };
    let mut writer = ImageWriter::create(path, format, picture.width, picture.height)?;
    writer.write_rgb8(pixels)?;
    writer.finish()
}

/// The result in words: one line, or three if the images differ.
fn words(comparison: &Comparison, a: &Picture, b: &Picture) -> String {
    let &Comparison { width, height, unit, differing, off_by_1, off_by_2, infinite, largest, .. } = comparison;
    let Some((x, y)) = comparison.largest_at else {
        return format!("identical: {width}x{height} pixels\n");
    };
    let pixels = u64::from(width) * u64::from(height);
    let share = 100.0 * differing as f64 / pixels as f64;
    let (by_1, name, level) = match unit {
        Unit::Levels => (String::new(), " levels", " levels"),
        Unit::Linear => (format!(", {off_by_1} by 1/255 or more"), "", "/255"),
    };
    let infinite =
        if infinite > 0 { format!(", {infinite} where one is not a number or infinite") } else { String::new() };
    let index = y as usize * width as usize + x as usize;
    let (of_a, of_b) = (describe(a, index), describe(b, index));
    let (mean, rms) = (short(comparison.mean), short(comparison.rms));
    format!(
        "{differing} of {pixels} pixels differ ({share:.3} %){by_1}, {off_by_2} by 2{level} or more{infinite}\n\
         largest difference {largest}{name} at ({x}, {y}): {of_a} against {of_b}\n\
         mean {mean}{name}, RMS {rms}{name}, PSNR {:.2} dB\n",
        comparison.psnr
    )
}

/// A number with about three significant digits.
fn short(value: f64) -> String {
    if (0.1..1e4).contains(&value) { format!("{value:.3}") } else { format!("{value:.2e}") }
}

/// The channels of a pixel, in words.
fn describe(picture: &Picture, index: usize) -> String {
    match &picture.pixels {
        Pixels::Rgb8(pixels) => pixels[index].map(|level| level.to_string()).join(" "),
        Pixels::Rgb32F(pixels) => pixels[index].map(|value| value.to_string()).join(" "),
    }
}
