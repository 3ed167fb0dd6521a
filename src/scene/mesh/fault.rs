//! What is wrong with a mesh file, before its name is known.

/// An error of a mesh, before the name of its file is known.
#[derive(Debug)]
pub(super) struct Fault {
    pub line: Option<usize>,
    pub message: String,
    pub expected: Option<String>,
}

impl Fault {
    pub(super) fn new(message: impl Into<String>) -> Self {
        Fault { line: None, message: message.into(), expected: None }
    }

    pub(super) fn line(self, line: usize) -> Self {
        Fault { line: Some(line), ..self }
    }

    pub(super) fn expected(self, expected: impl Into<String>) -> Self {
        Fault { expected: Some(expected.into()), ..self }
    }
}

/// "1 vertex", "8 vertices" and so on.
pub(super) fn counted(count: usize, one: &str, many: &str) -> String {
    format!("{count} {}", if count == 1 { one } else { many })
}

/// The message for a vertex that is not finite.
pub(super) fn not_finite(vertex: &str) -> Fault {
    Fault::new(format!("{vertex} is not finite")).expected("numbers that f32 holds, within 3.4e38")
}
