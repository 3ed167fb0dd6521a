//! Errors of mesh files, built step by step: the message first, the file's name last.

use std::path::PathBuf;

use super::MeshError;
use crate::scene::mistaken::Mistaken;
use crate::scene::parse::COMMA_HELP;

impl MeshError {
    pub(in crate::scene) fn new(message: impl Into<String>) -> Self {
        MeshError { path: PathBuf::new(), line: None, message: message.into(), expected: None }
    }

    pub(in crate::scene) fn line(self, line: usize) -> Self {
        MeshError { line: Some(line), ..self }
    }

    pub(in crate::scene) fn expected(self, expected: impl Into<String>) -> Self {
        MeshError { expected: Some(expected.into()), ..self }
    }

    /// Adds a hint that commas are the cause, if the misread text contains any.
    pub(in crate::scene) fn of_text(self, text: impl AsRef<[u8]>) -> Self {
        if !text.as_ref().contains(&b',') {
            return self;
        }
        let expected = self.expected.map_or(COMMA_HELP.to_owned(), |expected| format!("{expected}; {COMMA_HELP}"));
        MeshError { expected: Some(expected), ..self }
    }

    /// The error for a file of another kind, such as an archive.
    pub(in crate::scene) fn mistaken(Mistaken { what, help }: &Mistaken) -> Self {
        MeshError::new(*what).expected(format!("a mesh: {help}"))
    }

    pub(in crate::scene) fn of(self, path: impl Into<PathBuf>) -> Self {
        MeshError { path: path.into(), ..self }
    }
}

/// "1 vertex", "8 vertices" and so on.
pub(in crate::scene) fn counted(count: usize, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

/// A vertex with an infinite or NaN coordinate. It is an error only if a face has it as a
/// corner.
#[derive(Clone, Copy)]
pub(in crate::scene) struct NonFiniteVertex {
    /// Its index among all vertices of the file.
    pub index: usize,
    /// Its line, if the file is text.
    pub line: Option<usize>,
}

impl NonFiniteVertex {
    /// The error to report if a face has it as a corner.
    pub(in crate::scene) fn fault(self) -> MeshError {
        MeshError { line: self.line, ..not_finite(&format!("vertex {}", self.index + 1)) }
    }
}

/// The error for a vertex that is not finite.
pub(in crate::scene) fn not_finite(vertex: &str) -> MeshError {
    MeshError::new(format!("{vertex} is not finite")).expected("numbers that f32 holds, within 3.4e38")
}

/// "only 8 vertices", or "no vertices".
pub(in crate::scene) fn only(vertices: usize) -> String {
    match vertices {
        0 => "no vertices".to_owned(),
        _ => format!("only {}", counted(vertices, "vertex", "vertices")),
    }
}

/// A note about faces with fewer than three corners.
pub(in crate::scene) fn small_faces(count: usize) -> String {
    format!("{} of less than three corners left out", counted(count, "face", "faces"))
}

/// A note about a file that is longer than its header says.
pub(in crate::scene) fn goes_on(elements: &str) -> String {
    format!("the file goes on after the {elements} that its header counts: what follows was not read")
}
