//! Pixel formats: three channels equal the first of four to the last bit, and nothing outside of
//! the pixels is written.

use std::path::Path;

use crate::contenders::{Contender, contenders};
use rayo::internals::kernels::Vec4;
use rayo::internals::render::{Film, FilmMut, PixelFormat, Purpose};
use rayo::internals::scene::{self, Camera, Scene, many};

/// The contenders whose engines write three channels themselves.
fn writers() -> Vec<Contender> {
    let scene = many(1, 1, 0);
    let writes = |contender: &Contender| contender.prepare(&scene).writes(PixelFormat::Rgb8);
    let writers: Vec<_> = contenders().into_iter().filter(writes).collect();
    assert!(writers.iter().all(|contender| contender.prepare(&scene).writes(PixelFormat::F32x3)));
    assert!(!writers.is_empty());
    writers
}

/// The scene with another number of pixels, in which objects keep their place in the picture.
fn sized(scene: Scene, width: u32, height: u32) -> Scene {
    let camera = &scene.camera;
    Scene { camera: Camera::new(width, height, camera.focal(), camera.film()).unwrap(), ..scene }
}

/// Values of memory that must not be written.
const FLOATS: [f32; 3] = [1.5, -2.5, 3.5];
const BYTES: [u8; 3] = [1, 2, 3];
const NUMBER: u32 = 0x0001_0203;

/// Traces the whole picture in each format. Three-channel formats that are made from four channels
/// are written from pixel `first` of a longer film on.
fn check(contender: &Contender, scene: &Scene, first: usize, what: &str) {
    let (pixels, rows) = (scene.camera.pixels() as usize, 0..scene.camera.height());
    let (mut four, mut rgba) = (vec![Vec4::default(); pixels], vec![[0; 4]; pixels]);
    let (mut floats, mut bytes) = (vec![FLOATS; first + pixels + 40], vec![BYTES; first + pixels + 40]);
    let mut numbers = vec![NUMBER; first + pixels + 40];
    let trace = |out: FilmMut<'_>| {
        let purpose = Purpose { format: Some(out.format()), ..Purpose::default() };
        contender.plan(scene, purpose).tracer().rows(rows.clone(), out);
    };
    trace(FilmMut::F32x4(&mut four));
    trace(FilmMut::Rgba8(&mut rgba));
    trace(FilmMut::F32x3(&mut floats[first..first + pixels]));
    trace(FilmMut::Rgb8(&mut bytes[first..first + pixels]));
    trace(FilmMut::Bgra8(&mut numbers[first..first + pixels]));
    let what = || format!("{contender}, {what}, {}x{} from {first} on", scene.camera.width(), scene.camera.height());
    for (i, ((floats, bytes), number)) in floats.iter().zip(&bytes).zip(&numbers).enumerate() {
        let (linear, levels) = match i.checked_sub(first).filter(|i| *i < pixels) {
            Some(i) => ([four[i].x, four[i].y, four[i].z], [rgba[i][0], rgba[i][1], rgba[i][2]]),
            None => (FLOATS, BYTES),
        };
        let pixel = i as i64 - first as i64;
        assert_eq!(floats.map(f32::to_bits), linear.map(f32::to_bits), "{}: the floats of pixel {pixel}", what());
        assert_eq!(*bytes, levels, "{}: the bytes of pixel {pixel}", what());
        let [red, green, blue] = levels;
        let in_picture = (first..first + pixels).contains(&i);
        let expected = if in_picture { u32::from_be_bytes([255, red, green, blue]) } else { NUMBER };
        assert_eq!(*number, expected, "{}: the number of pixel {pixel}", what());
    }
}

#[test]
fn engines_that_compute_in_floats_alone_write_every_format() {
    let scene = sized(many(5, 5, 2), 33, 7);
    for contender in contenders() {
        let tracer = contender.prepare(&scene);
        if tracer.writes(PixelFormat::Rgb8) {
            continue;
        }
        let film = |format| {
            let mut film = Film::new(format, 33 * 7).unwrap();
            tracer.rows(0..7, film.as_mut());
            film
        };
        let floats = film(PixelFormat::F32x4);
        for other in PixelFormat::ALL.map(film) {
            let levels = |film: &Film| (0..33 * 7).map(|pixel| film.colour(pixel).levels()).collect::<Vec<_>>();
            assert_eq!(levels(&other), levels(&floats), "{contender}");
        }
    }
}

#[test]
fn three_channels_are_the_first_of_four_at_any_width() {
    // A grey sphere, a coloured one, a triangle, two overlapping spheres, and tiles.
    let lit = |colour: &str| format!("x 9 9 1  1  1 1 1 1 -4 5 0  1  2.2 {colour} 0 0 10");
    let scenes = [
        lit("1 1 1") + "  0",
        lit("0.9 0.5 0.2") + "  0",
        "x 9 9 1  1  1 1 1 1 -4 5 0  0  1  1 0.5 0.25  -2 -2 9  2 -2 10  0 2 9".into(),
        lit("0.9 0.5 0.2") + "  1  1 0.5 0.25  -2 -2 9  2 -2 10  0 2 9",
    ]
    .map(|text| scene::parse(text.as_bytes(), "a scene of this test").unwrap_or_else(|error| panic!("{error}")));
    let under_one_light = |scene: Scene| Scene { lights: scene.lights[..1].to_vec(), ..scene };
    let random = [many(30, 30, 8), under_one_light(many(3, 0, 2)), under_one_light(many(4, 40, 6))];
    for scene in scenes.into_iter().chain(random) {
        for width in 1..=67 {
            let scene = sized(scene.clone(), width, 5);
            for contender in writers() {
                check(&contender, &scene, width as usize % 17, "any width");
            }
        }
    }
}

/// A film too large for the caches is stored past them.
#[test]
fn three_channels_past_the_cache_are_the_first_of_four() {
    let directory = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")).join("scenes");
    for name in ["sphere", "tetrahedron"] {
        let scene = scene::read(&directory.join(format!("{name}.in"))).unwrap();
        let scene = sized(scene, 1501, 1003);
        for contender in writers().into_iter().filter(|contender| contender.precision.name() != "double") {
            check(&contender, &scene, 3, name);
        }
    }
}
