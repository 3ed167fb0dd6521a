//! A scene that was read, with its reader's notes and warnings.

use std::path::PathBuf;

use super::Scene;
use super::diagnostic::printable;

/// A scene, and what its reader has to report.
#[derive(Clone, Debug, PartialEq)]
pub struct Opened {
    /// The scene.
    pub scene: Scene,
    /// The files that it was read from: its own, meshes, and their materials.
    pub files: Vec<PathBuf>,
    /// What was done or assumed without being asked for, a line each.
    pub notes: Vec<String>,
    /// The index of the light that moves with the camera: of a mesh alone, the weak one at the
    /// camera.
    pub carried_light: Option<usize>,
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
    pub(super) const MOST: usize = 10;

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

    /// Adds so many further ones.
    pub(super) fn add_more(&mut self, count: usize) {
        self.more += count;
    }

    /// All of them in lines.
    pub(super) fn warnings(mut self, name: &str) -> Vec<String> {
        if self.more > 0 {
            self.told.push(format!("{}: and {} more triangles have no area", printable(name), self.more));
        }
        self.told
    }
}
