//! The experiments: each returns rows.

pub mod ablation;
pub mod accuracy;
#[cfg(rayo_asm)]
pub mod claims;
#[cfg(rayo_asm)]
pub mod complexity;
#[cfg(rayo_asm)]
pub mod document;
#[cfg(rayo_asm)]
pub mod gallery;
#[cfg(rayo_asm)]
pub mod jumps;
#[cfg(rayo_asm)]
pub mod ladder;
#[cfg(rayo_asm)]
pub mod machines;
#[cfg(rayo_asm)]
pub mod ops;
#[cfg(rayo_asm)]
pub mod plot;
#[cfg(rayo_asm)]
pub mod report;
#[cfg(rayo_asm)]
pub mod roofline;
#[cfg(rayo_asm)]
pub mod speedup;
pub mod stability;
#[cfg(rayo_asm)]
pub mod step;
pub mod svg;
#[cfg(rayo_asm)]
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
