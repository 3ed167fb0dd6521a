//! `rayo`: the paper *Trazado de rayos vectorizado* in NASM, C and Rust, from a scene file to a
//! picture.
//!
//! Without default features it has scenes, the plan, engines and films. The features `asm` and `c`
//! add engines, `files` adds the reading and writing of files.
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
//! From there on:
//!
//! - **many threads**: [`Frame`] has them trace a picture, and keeps them for the next one;
//! - **files**: with the feature `files`, `read` gives the scene of a file and `render_to_file`
//!   writes an image, which `examples/scene_to_png.rs` shows;
//! - **a camera that moves**: [`MovingCamera`] sees the same world from view to view, [`Plan`] is
//!   made anew for each, with the format of the film and the number of threads as its [`Purpose`],
//!   and the [`Film`] is used again. A scene from a file moves in the coordinates of that file;
//! - **a window**: [`PixelFormat::Bgra8`] is what windows take, and a [`Cancel`] stops a frame when
//!   its user has moved on. `view/` in the repository is such a program;
//! - **what is under a pixel**: [`Frame::hit`] returns the object, the place and the normal;
//! - **a picture for the eye**: [`Developed`] takes several samples of each pixel, and applies
//!   exposure and the curve of sRGB.
//!
//! Whatever a program has set in its floating-point unit (flushed denormal numbers, another
//! rounding, traps), the pictures are the same: each call sets what Rust assumes, and puts back at
//! its end what was there.
//!
//! Nothing here needs `unsafe` of its caller. `ARCHITECTURE.md` in the repository has the layers
//! and the reasons.

// Everything that this page re-exports is documented. In the modules behind it, comments only say
// what names do not.
#![warn(missing_docs)]

// The example of the README is compiled by a test, and `examples/scene_to_png.rs` does more of the
// same.
#[cfg(all(doctest, feature = "files"))]
#[doc = include_str!("../README.md")]
struct Readme;

/// The crate with the vector types of scenes, so that programs can use this very version: types of
/// another version do not match.
pub use glam;

// All that a program needs to have a scene traced.
pub use kernels::{ColourRun, Isa, Vec4};
pub use plan::{ByTiles, Cancel, Keep, Kept, LeftOut, Omission, Report, Switch};
pub use render::{
    Colour, Counted, Developed, Development, Distance, Engine, EngineError, Film, FilmMut, Found, Frame, Hit, NoMemory,
    PixelFormat, Plan, Precision, Purpose, RenderError, Settings, Tracer, Wanted, WrongSize, level,
};
#[cfg(feature = "files")]
pub use render::{
    Existing, Format, ImageError, ImageFile, ImageWriter, OutputError, Picture, Pixels, Stats, render as render_to_file,
};
pub use scene::{
    Camera, CameraError, Diagnostic, Faces, FileCamera, FileLight, InvalidScene, Light, MAX_PIXELS, MAX_SIDE, Mesh,
    MeshError, MeshFormat, ModelOptions, MovingCamera, Object, Opened, Placement, Scene, SceneError, Sphere, ToCamera,
    Triangle, UpAxis, View, ViewError, parse,
};
#[cfg(feature = "files")]
pub use scene::{Cloud, CloudFormat, SceneFormat, open, open_with, parse_toml, read};

#[allow(missing_docs)]
mod kernels;
#[allow(missing_docs)]
mod plan;
#[allow(missing_docs)]
mod reference;
mod render;
mod scene;

/// The modules behind this page, for the other packages of the workspace and for tests. They are no
/// part of the interface, and may change at any time.
#[doc(hidden)]
pub mod internals {
    /// Kernels in assembly and C behind safe functions, and system calls.
    pub mod kernels {
        pub use crate::kernels::*;
    }
    /// From a scene to a plan.
    pub mod plan {
        pub use crate::plan::*;
    }
    /// The scalar meaning of every operation and intersection.
    pub mod reference {
        pub use crate::reference::*;
    }
    /// From a plan to rows of pixels and image files.
    pub mod render {
        pub use crate::render::*;
    }
    /// Scenes and the files that they are read from.
    pub mod scene {
        pub use crate::scene::*;
    }
}
