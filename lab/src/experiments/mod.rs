//! The experiments: each measures, and returns rows that others print.

pub mod ablation;
pub mod accuracy;
#[cfg(unix)]
pub mod bring;
pub mod check;
pub mod claims;
pub mod complexity;
pub mod document;
pub mod gallery;
pub mod jumps;
pub mod lab;
pub mod ladder;
pub mod machines;
pub mod ops;
pub mod plot;
pub mod prove;
pub mod report;
pub mod roofline;
pub mod speedup;
pub mod stability;
pub mod step;
pub mod svg;
pub mod sweeps;
pub mod threads;
pub mod verdict;

use rayo::internals::scene::Scene;

/// A scene in another size.
///
/// # Panics
/// If the size is beyond a camera's limits, which no experiment's is.
pub fn in_size(scene: &Scene, width: u32, height: u32) -> Scene {
    let camera = scene.camera.sized(width, height).expect("the sizes of an experiment are within the limits");
    Scene { camera, ..scene.clone() }
}
