//! Scenes as every engine shows them, and how far each picture is from the reference's.

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
use crate::measure::picture::{Picture, Pixels};
use crate::render::{Engine, Film, PixelFormat};
use crate::scene::Scene;

/// The scenes that come with the program, and stiff families of which the stiffest of three is shown.
const SHIPPED: [&str; 4] = ["sphere", "tetrahedron", "two-lights", "many"];
/// Those in which objects hide lights from each other.
const IN_SHADOWS: [&str; 2] = ["two-lights", "many"];
const STIFF: [(&str, &str); 2] = [("S1", "a far sphere"), ("S6", "a sphere as the ground")];
const SIZE: (u32, u32) = (320, 240);

/// A scene and its pictures, the reference's first.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Shown {
    pub scene: String,
    pub width: u32,
    pub height: u32,
    pub pictures: Vec<Shot>,
}

#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Shot {
    pub engine: Name,
    /// The engine that shows the same levels, and has the picture.
    pub like: Option<Name>,
    /// The picture as PNG, in base64.
    pub png: Option<String>,
    /// What is different from the reference's, white where it is most; as PNG, in base64.
    pub difference: Option<String>,
    pub differing: u64,
    /// By how many levels at most.
    pub largest: f64,
}

/// How many times [`run`] calls `proceed`.
pub const WORK: u64 = (SHIPPED.len() + IN_SHADOWS.len() + STIFF.len()) as u64;

/// Traces them all. None where `proceed` says no.
///
/// # Errors
/// An engine that cannot be prepared, or no memory.
pub fn run(proceed: &mut dyn FnMut(u64) -> bool) -> Result<Option<Vec<Shown>>, LabError> {
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

fn show(name: String, scene: &Scene) -> Result<Shown, LabError> {
    let (width, height) = (scene.camera.width(), scene.camera.height());
    let mut seen: Vec<(Name, Picture)> = Vec::new();
    let mut pictures = Vec::new();
    for engine in Engine::ALL.iter().filter(|engine| engine.usable() && (!scene.shadows || engine.has_shadows())) {
        let picture = picture(*engine, scene)?;
        let like = seen.iter().find(|(_, other)| other.pixels == picture.pixels).map(|(name, _)| name.clone());
        let truth = seen.first().map(|(_, truth)| truth);
        let compared =
            truth.and_then(|truth| Some((compare(truth, &picture).ok()?, difference_image(truth, &picture).ok()?)));
        let (differing, largest) = compared.as_ref().map_or((0, 0.0), |(found, _)| (found.differing, found.largest));
        let difference = compared.filter(|_| differing > 0 && like.is_none()).map(|(_, image)| png(&image));
        let own = like.is_none().then(|| png(&picture));
        pictures.push(Shot { engine: engine.name().into(), like, png: own, difference, differing, largest });
        seen.push((engine.name().into(), picture));
    }
    Ok(Shown { scene: name, width, height, pictures })
}

/// The levels that the engine's file would have.
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
