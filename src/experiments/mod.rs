//! The experiments: each returns rows.

pub mod ablation;
pub mod accuracy;
pub mod claims;
pub mod complexity;
pub mod document;
pub mod gallery;
pub mod jumps;
pub mod ladder;
pub mod machines;
pub mod ops;
pub mod plot;
pub mod report;
pub mod roofline;
pub mod speedup;
pub mod stability;
pub mod step;
pub mod svg;
pub mod threads;

use crate::render::{EngineError, NoMemory};
use crate::scene::Scene;

/// Why there are no pictures to measure.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// An engine could not be prepared.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// No memory for a picture.
    #[error(transparent)]
    Memory(#[from] NoMemory),
}

/// A scene in another size.
///
/// # Panics
/// Where that is beyond the limits, as no experiment's is.
pub fn in_size(scene: &Scene, width: u32, height: u32) -> Scene {
    let camera = scene.camera.sized(width, height).expect("the sizes of an experiment are within the limits");
    Scene { camera, ..scene.clone() }
}
