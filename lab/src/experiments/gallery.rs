//! The pictures of some scenes by every engine, and how far each is from the reference's.

use std::cmp::Ordering;

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use image::ExtendedColorType;
use image::ImageEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use serde::{Deserialize, Serialize};

use super::accuracy::subjects::{Subject, named, shipped};
use super::in_size;
use super::lab::LabError;
use crate::measure::Name;
use crate::measure::compare::{compare, difference_image};
use rayo::internals::render::{Engine, Film, PixelFormat};
use rayo::internals::scene::Scene;
use rayo::{Picture, Pixels};

/// The scenes of the gallery that come with the program. Besides these it shows the most
/// ill-conditioned scene of each family in `STIFF`.
const SHIPPED: [&str; 4] = ["sphere", "tetrahedron", "two-lights", "many"];
/// The scenes that are also shown with shadows, because their objects hide lights from each other.
const IN_SHADOWS: [&str; 2] = ["two-lights", "many"];
const STIFF: [(&str, &str); 2] = [("S1", "a far sphere"), ("S6", "a sphere as the ground")];
/// The size of the pictures: small, since the report's page contains up to three of each scene.
const SIZE: (u32, u32) = (144, 108);

/// A scene and its pictures, the reference's first.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct ScenePictures {
    pub scene: String,
    pub width: u32,
    pub height: u32,
    pub pictures: Vec<Shot>,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Shot {
    pub engine: Name,
    /// An earlier engine in the list whose picture is the same, level by level.
    pub like: Option<Name>,
    /// The picture as a PNG in base64; only for the reference and for the engine that is farthest
    /// from it.
    pub png: Option<String>,
    /// For the farthest engine its difference from the reference, as a PNG in base64: white where
    /// the difference is largest.
    pub difference: Option<String>,
    pub differing: u64,
    /// The largest difference from the reference, in levels.
    pub largest: f64,
}

/// How many times [`run`] calls `proceed`.
pub const WORK: u64 = (SHIPPED.len() + IN_SHADOWS.len() + STIFF.len()) as u64;

/// Traces every scene with every engine. None if `proceed` returns false.
///
/// # Errors
/// If an engine cannot be prepared, or if there is not enough memory.
pub fn run(proceed: &mut dyn FnMut(u64) -> bool) -> Result<Option<Vec<ScenePictures>>, LabError> {
    let ordinary = SHIPPED.iter().map(|name| ((*name).to_owned(), in_size(&shipped(name), SIZE.0, SIZE.1)));
    let in_shadows = IN_SHADOWS.iter().map(|name| {
        let scene = Scene { shadows: true, ..in_size(&shipped(name), SIZE.0, SIZE.1) };
        (format!("{name}, with shadows"), scene)
    });
    let stiff = STIFF.iter().map(|(id, words)| {
        let subjects = named(id, true).expect("the family is there");
        let Subject { name, scene, .. } = subjects.into_iter().next_back().expect("it has levels");
        (format!("{words}: {name}"), in_size(&scene, SIZE.0, SIZE.1))
    });
    let mut shown = Vec::new();
    for (name, scene) in ordinary.chain(in_shadows).chain(stiff) {
        shown.push(show(name, &scene)?);
        if !proceed(1) {
            return Ok(None);
        }
    }
    Ok(Some(shown))
}

fn show(name: String, scene: &Scene) -> Result<ScenePictures, LabError> {
    let (width, height) = (scene.camera.width(), scene.camera.height());
    let mut seen: Vec<(Name, Picture)> = Vec::new();
    let mut pictures = Vec::new();
    for engine in Engine::ALL.iter().filter(|engine| engine.usable() && (!scene.shadows || engine.has_shadows())) {
        let picture = picture(*engine, scene)?;
        let like = seen.iter().find(|(_, other)| other.pixels == picture.pixels).map(|(name, _)| name.clone());
        let truth = seen.first().map(|(_, truth)| truth);
        let compared = truth.and_then(|truth| compare(truth, &picture).ok());
        let (differing, largest) = compared.map_or((0, 0.0), |found| (found.differing, found.largest));
        pictures.push(Shot { engine: engine.name().into(), like, png: None, difference: None, differing, largest });
        seen.push((engine.name().into(), picture));
    }
    if let (Some(shot), Some((_, truth))) = (pictures.first_mut(), seen.first()) {
        shot.png = Some(png(truth));
    }
    if let Some(place) = farthest(&pictures) {
        let (truth, picture) = (&seen[0].1, &seen[place].1);
        pictures[place].png = Some(png(picture));
        pictures[place].difference = difference_image(truth, picture).ok().map(|image| png(&image));
    }
    Ok(ScenePictures { scene: name, width, height, pictures })
}

/// The index of the picture that is farthest from the reference's: by its largest difference, then
/// by its number of differing pixels. None if all are equal to it.
pub fn farthest(pictures: &[Shot]) -> Option<usize> {
    let differ = pictures.iter().enumerate().filter(|(_, shot)| shot.differing > 0 && shot.like.is_none());
    let far = |shot: &Shot| (shot.largest, shot.differing);
    differ.max_by(|(_, a), (_, b)| far(a).partial_cmp(&far(b)).unwrap_or(Ordering::Equal)).map(|(place, _)| place)
}

/// The engine's picture, in the levels that its file would have.
fn picture(engine: Engine, scene: &Scene) -> Result<Picture, LabError> {
    let (camera, pixels) = (&scene.camera, scene.camera.pixels() as usize);
    let tracer = engine.prepare(None, scene)?;
    let format = if tracer.writes(PixelFormat::Rgb8) { PixelFormat::Rgb8 } else { PixelFormat::F32x4 };
    let mut film = Film::new(format, pixels)?;
    tracer.rows(0..camera.height(), film.as_mut());
    let levels = (0..pixels).map(|pixel| film.colour(pixel).levels()).collect();
    Ok(Picture::new(camera.width(), camera.height(), Pixels::Rgb8(levels)))
}

fn png(picture: &Picture) -> String {
    let Pixels::Rgb8(pixels) = &picture.pixels else { unreachable!("levels are compared") };
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Best, FilterType::Adaptive);
    encoder
        .write_image(pixels.as_flattened(), picture.width, picture.height, ExtendedColorType::Rgb8)
        .expect("memory takes it");
    BASE64_STANDARD.encode(bytes)
}
