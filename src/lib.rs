//! `rayo`: the paper *Trazado de rayos vectorizado* in NASM, C and Rust, from a scene file to a picture.
//!
//! Without default features it has scenes, the plan, engines and films; `asm`, `c`, `files`, `lab`, `cli` add the rest.
//!
//! A scene that is built in code, traced by the fastest engine that runs here:
//!
//! ```
//! use rayo::glam::Vec3;
//! use rayo::{Camera, Engine, Film, Light, PixelFormat, Scene, Sphere, Triangle};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // The pinhole is at the origin; x points to the right, y up, and z away.
//! let scene = Scene {
//!     name: "ball.png".into(),
//!     lights: vec![Light { intensity: 1.0, colour: Vec3::ONE, position: Vec3::new(-5.0, 5.0, 0.0) }],
//!     spheres: vec![Sphere { radius: 1.0, colour: Vec3::new(1.0, 0.5, 0.0), centre: Vec3::new(0.0, 0.0, 5.0) }],
//!     triangles: vec![Triangle {
//!         colour: Vec3::ONE,
//!         vertices: [Vec3::new(-9.0, 0.0, 9.0), Vec3::new(9.0, 0.0, 9.0), Vec3::new(0.0, 9.0, 9.0)],
//!     }],
//!     // Pixels in a row and in a column, the focal distance, and the diagonal of the film.
//!     ..Scene::new(Camera::new(320, 240, 1.0, 1.0)?)
//! };
//! let tracer = Engine::fastest().prepare(None, &scene)?;
//! let mut film = Film::new(PixelFormat::F32x4, scene.camera.pixels() as usize)?;
//! tracer.rows(0..scene.camera.height(), film.as_mut());
//!
//! let pixel = |column: u32, row: u32| film.colour((row * scene.camera.width() + column) as usize).levels();
//! let [red, green, blue] = pixel(160, 120);
//! assert!(red > green && green > blue && blue == 0, "the ball is orange");
//! let [red, green, blue] = pixel(160, 0);
//! assert!(red > 0 && red == green && green == blue, "above it the triangle is white");
//! assert_eq!(pixel(160, 239), [0, 0, 0], "and nothing is below it");
//! # Ok(())
//! # }
//! ```
//!
//! [`Frame`] traces the same by many threads, [`Scene::seen_from`] moves the camera, [`Developed`] takes more samples of
//! each pixel, and with the feature `files` there are `read` and `render_to_file`, from a scene file to an image file.
//!
//! `ARCHITECTURE.md` has the layers and the reasons; imports go only downwards:
//! `cli -> experiments -> render -> plan -> { measure, scene } -> { kernels, reference }`.

// The example of the README is a test.
#[cfg(all(doctest, feature = "cli"))]
#[doc = include_str!("../README.md")]
struct Readme;

/// The vectors that scenes are made of: those of another version would be other types.
pub use glam;

// All that a program needs to have a scene traced.
pub use kernels::Vec4;
pub use plan::{Keep, Omission, Report};
pub use render::{
    Colour, Counted, Developed, Development, Distance, Engine, EngineError, Film, FilmMut, Found, Frame, Hit, NoMemory,
    PixelFormat, Plan, Precision, Purpose, RenderError, Settings, Tracer, WrongSize, level,
};
#[cfg(feature = "files")]
pub use render::{Existing, Format, ImageError, ImageFile, ImageWriter, OutputError, Stats, render as render_to_file};
pub use scene::{
    Camera, CameraError, Diagnostic, Faces, InvalidScene, Light, Mesh, MeshError, MeshFormat, MovingCamera, Object,
    Opened, Scene, SceneError, Sphere, Triangle, View, ViewError, parse,
};
#[cfg(feature = "files")]
pub use scene::{SceneFormat, open, read};

// The rooms of the house. The program, its tests, its benches and its examples reach into them; they may change at any time.
#[cfg(feature = "render")]
#[doc(hidden)]
pub mod cli;
#[cfg(feature = "lab")]
#[doc(hidden)]
pub mod experiments;
#[doc(hidden)]
pub mod kernels;
#[doc(hidden)]
pub mod measure;
#[doc(hidden)]
pub mod plan;
#[cfg(feature = "mpi")]
#[doc(hidden)]
pub mod ranks;
#[doc(hidden)]
pub mod reference;
#[doc(hidden)]
pub mod render;
#[doc(hidden)]
pub mod scene;
