//! A scene that was read from a file, with notes and warnings about it.

use std::path::PathBuf;

use super::Scene;
use super::diagnostic::printable;

/// A scene, and what its reader has to report.
#[derive(Clone, Debug, PartialEq)]
pub struct Opened {
    /// The scene.
    pub scene: Scene,
    /// The files that were read: the scene's own, meshes and material files.
    pub files: Vec<PathBuf>,
    /// What was done or assumed without being asked for, one note per line.
    pub notes: Vec<String>,
    /// The index of the light that moves with the camera. A mesh alone has one: the weaker light,
    /// at the camera.
    pub carried_light: Option<usize>,
    /// What is probably a mistake in the file, one warning per line.
    pub warnings: Vec<String>,
}

/// Warnings about triangles without area: the first ones, and the number of further ones.
#[derive(Default)]
pub(super) struct NoArea {
    told: Vec<String>,
    more: usize,
}

impl NoArea {
    /// The most triangles that are listed one by one.
    pub(super) const MOST: usize = 10;

    /// Adds the triangle described by `which`, at this `line` of the file `name`.
    pub(super) fn add(&mut self, name: &str, which: &str, line: impl FnOnce() -> usize) {
        if self.told.len() < Self::MOST {
            let (name, line) = (printable(name), line());
            self.told
                .push(format!("{name}:{line}: {which} has no area, and no ray hits it: its corners are on one line"));
        } else {
            self.more += 1;
        }
    }

    /// Adds this many further triangles, which are not listed.
    #[cfg(feature = "files")]
    pub(super) fn add_more(&mut self, count: usize) {
        self.more += count;
    }

    /// The warnings, one per line.
    pub(super) fn warnings(mut self, name: &str) -> Vec<String> {
        if self.more > 0 {
            self.told.push(format!("{}: and {} more triangles have no area", printable(name), self.more));
        }
        self.told
    }
}
