//! What is wrong with a mesh file, put together piece by piece, the file's name last.

use std::path::PathBuf;

use super::MeshError;

impl MeshError {
    pub(in crate::scene) fn new(message: impl Into<String>) -> Self {
        MeshError { path: PathBuf::new(), line: None, message: message.into(), expected: None }
    }

    pub(super) fn line(self, line: usize) -> Self {
        MeshError { line: Some(line), ..self }
    }

    pub(in crate::scene) fn expected(self, expected: impl Into<String>) -> Self {
        MeshError { expected: Some(expected.into()), ..self }
    }

    pub(in crate::scene) fn of(self, path: impl Into<PathBuf>) -> Self {
        MeshError { path: path.into(), ..self }
    }
}

/// "1 vertex", "8 vertices" and so on.
pub(super) fn counted(count: usize, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

/// The message for a vertex that is not finite.
pub(super) fn not_finite(vertex: &str) -> MeshError {
    MeshError::new(format!("{vertex} is not finite")).expected("numbers that f32 holds, within 3.4e38")
}

/// A note of a file that is longer than its header tells.
pub(super) fn goes_on(elements: &str) -> String {
    format!("the file goes on after the {elements} that its header counts: what follows was not read")
}
