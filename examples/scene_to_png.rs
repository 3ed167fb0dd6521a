//! From a scene file to a PNG: read, traced with shadows and 16 samples a pixel, written in sRGB.
//!
//! `cargo run --release -p rayo --example scene_to_png -- scenes/island.toml island.png 400x300`
//! runs it; without a size the picture has the scene's. It needs the library with the feature
//! `files`:
//!
//! ```toml
//! rayo = { path = "../rayo", default-features = false, features = ["asm", "files"] }
//! ```

use std::error::Error;
use std::path::{Path, PathBuf};
use std::thread::available_parallelism;

use rayo::{Developed, Development, Engine, Format, Frame, ImageWriter, Scene, Settings};

/// Renders the scene of a file, which may be the paper's, TOML or a mesh, to an image file of this
/// width and height; None: the scene's.
fn render(scene: &Path, picture: &Path, size: Option<(u32, u32)>) -> Result<(), Box<dyn Error>> {
    // An error of the file has its line, its column and what was expected there.
    let mut scene = rayo::read(scene)?;
    scene.shadows = true;
    if let Some((width, height)) = size {
        scene.camera = scene.camera.sized(width, height)?;
    }
    // The name decides the format. Files of bytes are in sRGB, those of floats stay linear.
    let format = Format::from_path(picture)?;
    let development = Development { samples: 4, srgb: format.is_8bit(), ..Development::default() };
    // What is traced has the pixels of all samples; what is developed has those of the picture.
    let samples = Scene { camera: development.camera(&scene.camera)?, ..scene.clone() };
    let tracer = Engine::fastest().prepare(None, &samples)?;
    let developed = Developed::new(&*tracer, &scene.camera, development);
    let frame = Frame::new(&developed, scene.camera, Settings { threads: available_parallelism()?.get() })?;
    // The file is written band by band, and appears when it is finished.
    let (width, height) = (scene.camera.width(), scene.camera.height());
    let mut image = ImageWriter::create(picture, format, width, height)?;
    rayo::render_to_file(&frame, &mut image, &|_rows| {})?;
    Ok(image.finish()?)
}

/// The width and the height in a text such as 400x300.
fn parse_size(size: &str) -> Result<(u32, u32), Box<dyn Error>> {
    let (width, height) = size.split_once('x').ok_or("a size is a width and a height, as in 400x300")?;
    Ok((width.parse()?, height.parse()?))
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1);
    let scene = arguments.next().map_or("scenes/sphere.in".into(), PathBuf::from);
    let picture = arguments.next().map_or("sphere.png".into(), PathBuf::from);
    let size = arguments.next().map(|size| parse_size(&size.to_string_lossy())).transpose()?;
    render(&scene, &picture, size)?;
    println!("{} shows {}", picture.display(), scene.display());
    Ok(())
}

#[test]
fn the_file_shows_the_scene_in_every_format() {
    use rayo::{ImageFile, Pixels};
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("ball.toml");
    let ball = "image = { width = 40, height = 30 }\n[camera]\nposition = [0, 0, -5]\n\
        [[light]]\nposition = [-9, 9, -9]\n[[sphere]]\ncentre = [0, 0, 0]\nradius = 1\ncolour = [1, 0.5, 0]\n";
    std::fs::write(&scene, ball).unwrap();
    for name in ["ball.png", "ball.exr"] {
        let picture = folder.path().join(name);
        render(&scene, &picture, None).unwrap();
        let picture = ImageFile::open(&picture).unwrap().read().unwrap();
        let middle = 15 * 40 + 20;
        let [red, green, blue] = match &picture.pixels {
            Pixels::Rgb8(levels) => levels[middle].map(f32::from),
            Pixels::Rgb32F(linear) => linear[middle],
        };
        assert!((picture.width, picture.height) == (40, 30) && red > green && green > blue && blue == 0.0, "{name}");
    }
}
