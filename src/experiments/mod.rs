//! The experiments: each returns rows.

pub(crate) mod ablation;
pub mod accuracy;
pub(crate) mod claims;
pub(crate) mod complexity;
pub(crate) mod document;
pub mod gallery;
pub(crate) mod jumps;
pub(crate) mod lab;
pub(crate) mod ladder;
pub(crate) mod machines;
pub mod ops;
pub(crate) mod plot;
pub(crate) mod report;
pub mod roofline;
pub(crate) mod speedup;
pub mod stability;
pub mod step;
pub(crate) mod svg;
pub mod threads;

use crate::scene::Scene;

/// A scene in another size.
///
/// # Panics
/// Where that is beyond the limits, as no experiment's is.
pub fn in_size(scene: &Scene, width: u32, height: u32) -> Scene {
    let camera = scene.camera.sized(width, height).expect("the sizes of an experiment are within the limits");
    Scene { camera, ..scene.clone() }
}
