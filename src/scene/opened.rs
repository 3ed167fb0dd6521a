//! A scene that was read, with its reader's notes and warnings.

use std::path::PathBuf;

use glam::DVec3;

use super::Scene;
use super::diagnostic::printable;

/// A scene, and what its reader has to report.
#[derive(Clone, Debug, PartialEq)]
pub struct Opened {
    /// The scene.
    pub scene: Scene,
    /// The world's up in the camera's frame: of length 1.
    pub up: DVec3,
    /// The files that it was read from: its own, meshes, and their materials.
    pub files: Vec<PathBuf>,
    /// What was done or assumed without being asked for, a line each.
    pub notes: Vec<String>,
    /// What is probably a mistake in the file, a line each.
    pub warnings: Vec<String>,
}

/// Warnings of triangles that have no area: the first ones, and the number of further ones.
#[derive(Default)]
pub(super) struct NoArea {
    told: Vec<String>,
    more: usize,
}

impl NoArea {
    /// The most that are listed one by one.
    const MOST: usize = 10;

    /// Adds the triangle `which` of the file `name`, in this `line`.
    pub(super) fn add(&mut self, name: &str, which: &str, line: impl FnOnce() -> usize) {
        if self.told.len() < Self::MOST {
            let (name, line) = (printable(name), line());
            self.told
                .push(format!("{name}:{line}: {which} has no area, and no ray hits it: its corners are on one line"));
        } else {
            self.more += 1;
        }
    }

    /// All of them in lines.
    pub(super) fn warnings(mut self, name: &str) -> Vec<String> {
        if self.more > 0 {
            self.told.push(format!("{}: and {} more triangles have no area", printable(name), self.more));
        }
        self.told
    }
}
