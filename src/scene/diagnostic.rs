//! Errors of scene files and how they are shown: [`Diagnostic`], [`SceneError`], and their
//! rendering.

use std::fmt;
use std::io::{self, ErrorKind};
use std::ops::Range;
use std::path::{Path, PathBuf};

use annotate_snippets::{AnnotationKind, Group, Level, Origin, Renderer, Snippet};

use super::log::is_line_end;
use super::{MeshError, MeshFormat};

/// How many bytes of a line are shown before a token, of the token itself, and after it:
/// diagnostics of long lines stay short.
const SHOWN_BEFORE: usize = 60;
const SHOWN_TOKEN: usize = 40;
const SHOWN_AFTER: usize = 30;
/// Marks the place of a cut.
const CUT: &str = "...";

/// An error at one place of a scene file.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Diagnostic {
    /// What is wrong with what, e.g. "sphere 3's radius is negative".
    pub message: String,
    /// The line, from 1.
    pub line: usize,
    /// The column, from 1, in characters (a byte order mark is none).
    pub column: usize,
    /// The token as it stands there, cut if it is long; empty where the file ends too early.
    pub token: String,
    /// What would have been right, e.g. "a number greater than 0".
    pub expected: String,
    /// How to fix it, where that is not obvious.
    pub help: Option<String>,
    /// The whole token, in bytes of the file.
    pub span: Range<usize>,
    /// The part of the line that is shown.
    excerpt: Excerpt,
}

/// A window of a source line and the token's place in it, in bytes of `text`.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Excerpt {
    text: String,
    mark: Range<usize>,
    /// Whether the line's start is shown.
    whole_start: bool,
}

/// Why there is no scene.
///
/// `Display` is [`SceneError::render`] without colour: whole paragraphs that begin with `error: `.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The file could not be read.
    #[error("{}", self.render(false))]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        #[source]
        cause: io::Error,
    },
    /// The file was read but is not a valid scene.
    #[error("{}", self.render(false))]
    Invalid {
        /// The file's name as [`parse`](super::parse()) was given it.
        name: String,
        /// What is wrong, in the file's order; never empty.
        diagnostics: Vec<Diagnostic>,
        /// How many more there were beyond those that are kept.
        more: usize,
    },
    /// The file is a picture.
    #[error("{}", self.render(false))]
    Picture {
        /// The file.
        path: PathBuf,
    },
    /// Neither the file's name nor its content is of a known format.
    #[error("{}", self.render(false))]
    Foreign {
        /// The file.
        path: PathBuf,
    },
    /// The file seems to be a mesh, whose format only a name tells.
    #[error("{}", self.render(false))]
    NamelessMesh {
        /// The file.
        path: PathBuf,
        /// Its probable format.
        format: MeshFormat,
    },
    /// The file is an invalid mesh.
    #[error("{}", self.render(false))]
    Mesh(MeshError),
}

impl Diagnostic {
    /// `line_start` is the start of the token's line, in bytes of `source`.
    pub(super) fn new(
        source: &[u8],
        span: Range<usize>,
        (line, line_start, column): (usize, usize, usize),
        message: fmt::Arguments<'_>,
        expected: &str,
    ) -> Self {
        Diagnostic {
            message: message.to_string(),
            line,
            column,
            token: shown_token(source, &span),
            expected: expected.to_owned(),
            help: None,
            excerpt: Excerpt::new(source, line_start, &span),
            span,
        }
    }

    /// The diagnostic in one line: `file:line:column: message: found ..., expected ...`.
    pub fn one_line(&self, file: &str) -> String {
        let found = if self.token.is_empty() { "the end of the file" } else { &format!("`{}`", self.token) };
        let Diagnostic { line, column, message, expected, .. } = self;
        format!("{}:{line}:{column}: {message}: found {found}, expected {expected}", printable(file))
    }

    fn groups<'a>(&'a self, file: &'a str) -> Vec<Group<'a>> {
        let title = Level::ERROR.primary_title(self.message.as_str());
        let mark = AnnotationKind::Primary.span(self.excerpt.mark.clone()).label(format!("expected {}", self.expected));
        let snippet = Snippet::source(self.excerpt.text.as_str()).line_start(self.line).annotation(mark);
        let help = self.help.as_deref().map(|help| Level::HELP.message(help));
        if self.excerpt.whole_start {
            vec![title.element(snippet.path(file)).elements(help)]
        } else {
            // The renderer would count columns from the start of the window.
            let place = Origin::path(file).line(self.line).char_column(self.column);
            vec![title.element(place), Group::with_level(Level::ERROR).element(snippet).elements(help)]
        }
    }
}

impl SceneError {
    /// The errors of the content, in the file's order; empty if the file could not be read at all.
    pub fn diagnostics(&self) -> &[Diagnostic] {
        match self {
            SceneError::Invalid { diagnostics, .. } => diagnostics,
            _ => &[],
        }
    }

    /// A line for each diagnostic ([`Diagnostic::one_line`]), and one that counts the omitted ones.
    pub fn lines(&self) -> Vec<String> {
        match self {
            SceneError::Mesh(error) => vec![error.to_string()],
            SceneError::Invalid { name, diagnostics, more } => {
                let mut lines: Vec<_> = diagnostics.iter().map(|diagnostic| diagnostic.one_line(name)).collect();
                if *more > 0 {
                    lines.push(format!("{}: and {more} more", printable(name)));
                }
                lines
            }
            _ => vec![self.in_short()],
        }
    }

    /// Each error with its line of the file, for a terminal: with ANSI colours or plain, without a
    /// newline at the end.
    pub fn render(&self, colour: bool) -> String {
        let renderer = if colour { Renderer::styled() } else { Renderer::plain() };
        let mut parts = Vec::new();
        match self {
            SceneError::Mesh(error) => {
                let path = shown(&error.path);
                let title = Level::ERROR.primary_title(error.message.as_str());
                let place = Origin::path(path.as_str());
                let place = if let Some(line) = error.line { place.line(line) } else { place };
                let help = error.expected.as_ref().map(|it| Level::NOTE.message(format!("expected {it}")));
                parts.push(renderer.render(&[title.element(place).elements(help)]));
            }
            SceneError::Invalid { name, diagnostics, more } => {
                let name = printable(name);
                parts.extend(diagnostics.iter().map(|diagnostic| renderer.render(&diagnostic.groups(&name))));
                if *more > 0 {
                    let errors = if *more == 1 { "error" } else { "errors" };
                    let message = format!("and {more} more {errors} in `{name}`");
                    parts.push(renderer.render(&[Group::with_title(Level::ERROR.primary_title(message))]));
                }
            }
            _ => {
                let message = self.in_short();
                parts.push(renderer.render(&[Group::with_title(Level::ERROR.primary_title(message))]));
            }
        }
        parts.join("\n\n")
    }

    /// The message for a file as a whole.
    fn in_short(&self) -> String {
        match self {
            SceneError::Read { path, cause } => unreadable(path, cause),
            SceneError::Picture { path } => {
                let path = shown(path);
                format!(
                    "`{path}` is a picture, and a scene is expected: `-o {path}` is how the picture to be written is named"
                )
            }
            SceneError::Foreign { path } => format!(
                "{}: unsupported format: rayo reads scenes as .in and .toml, meshes as .obj, .ply, .stl, .glb and .gltf, \
                 to which most programs can export, and atoms or points as .xyz, .pdb and .cif",
                source_name(path)
            ),
            SceneError::NamelessMesh { path, format } => format!(
                "{} looks like a mesh in {format} format, and meshes need names that tell their formats: save it as a \
                 file whose name ends in .{}",
                source_name(path),
                format.extension()
            ),
            SceneError::Invalid { .. } | SceneError::Mesh(_) => unreachable!("they have places"),
        }
    }
}

impl Excerpt {
    fn new(source: &[u8], line_start: usize, span: &Range<usize>) -> Self {
        let whole_start = span.start - line_start <= SHOWN_BEFORE;
        // A lone continuation byte, the likely error here, does not push the window past itself.
        let cut = || boundary(source, span.start - SHOWN_BEFORE).min(span.start);
        let from = if whole_start { line_start } else { cut() };
        let token_end = shown_end(source, span);
        // A token that is cut fills the window; text after it would look like a part of it.
        let limit = if token_end < span.end { token_end } else { source.len().min(token_end + SHOWN_AFTER) };
        let rest = &source[token_end..limit];
        let line_end = rest.iter().position(|&byte| is_line_end(byte)).map_or(limit, |length| token_end + length);
        let to = if line_end == limit { boundary(source, limit) } else { line_end };
        let more = source.get(to).is_some_and(|&byte| !is_line_end(byte));

        let mut text = String::from(if whole_start { "" } else { CUT });
        text.push_str(&String::from_utf8_lossy(&source[from..span.start]));
        let start = text.len();
        text.push_str(&String::from_utf8_lossy(&source[span.start..token_end]));
        let mark = start..text.len();
        text.push_str(&String::from_utf8_lossy(&source[token_end..to]));
        text.push_str(if more { CUT } else { "" });
        Excerpt { text, mark, whole_start }
    }
}

/// The first place at or after `at` where a character can begin.
fn boundary(source: &[u8], at: usize) -> usize {
    let inside = source[at..].iter().take_while(|&&byte| byte & 0xc0 == 0x80).count();
    // No character is longer than four bytes: a longer run is not UTF-8, and any place in it will
    // do.
    at + inside.min(3)
}

/// Where the shown part of a token ends.
fn shown_end(source: &[u8], span: &Range<usize>) -> usize {
    if span.len() <= SHOWN_TOKEN { span.end } else { boundary(source, span.start + SHOWN_TOKEN) }
}

fn shown_token(source: &[u8], span: &Range<usize>) -> String {
    let end = shown_end(source, span);
    let bytes = &source[span.start..end];
    let mut token = match std::str::from_utf8(bytes) {
        Ok(text) => printable(text),
        Err(_) => bytes.escape_ascii().to_string(),
    };
    token.push_str(if end < span.end { CUT } else { "" });
    token
}

/// A path made safe to print.
pub fn shown(path: impl AsRef<Path>) -> String {
    printable(&path.as_ref().to_string_lossy())
}

/// `text` with its unseen characters escaped, so that a file cannot control the terminal.
pub fn printable(text: &str) -> String {
    let spell = |c: char| if is_unseen(c) { c.escape_default().to_string() } else { c.to_string() };
    text.chars().map(spell).collect()
}

/// Words that may repeat a file's or a user's, made safe so that they neither control a terminal
/// nor fill it. Their end may say the place.
pub fn brief(text: &str) -> String {
    const SHOWN: [usize; 2] = [240, 60];
    match (text.char_indices().nth(SHOWN[0]), text.char_indices().nth_back(SHOWN[1])) {
        (Some((end, _)), Some((start, _))) if end < start => printable(&text[..end]) + CUT + &printable(&text[start..]),
        _ => printable(text),
    }
}

/// Whether a character shows nothing itself, but may change what a terminal shows of others:
/// Unicode's controls, formats (as those that turn the direction of writing), and ends of lines and
/// paragraphs.
pub fn is_unseen(c: char) -> bool {
    let is_format = matches!(u32::from(c), 0xad | 0x61c | 0x180e | 0x200b..=0x200f | 0x2028..=0x202e | 0x2060..=0x206f | 0xfeff
        | 0xfff9..=0xfffb | 0x13430..=0x1343f | 0x1bca0..=0x1bca3 | 0x1d173..=0x1d17a | 0xe0000..=0xe007f);
    is_format || c.is_control()
}

/// `error`, or a better one if it is that there is no file because the name is an address.
#[cfg(feature = "files")]
pub fn of_address(path: &Path, error: io::Error) -> io::Error {
    let is_address = error.kind() == ErrorKind::NotFound && is_address(path);
    if is_address { io::Error::new(ErrorKind::NotFound, ONLY_FILES) } else { error }
}

/// How messages call a scene's source.
fn source_name(path: &Path) -> String {
    if path == Path::new("-") { "standard input".into() } else { format!("`{}`", shown(path)) }
}

/// Whether a name is an address on the web, which nothing is read from.
pub(crate) fn is_address(path: &Path) -> bool {
    path.to_str()
        .and_then(|name| name.split_once("://"))
        .is_some_and(|(scheme, _)| !scheme.is_empty() && scheme.bytes().all(|byte| byte.is_ascii_alphanumeric()))
}

/// What to do with such a name.
pub(crate) const ONLY_FILES: &str = "this is an address, and rayo only reads files: download it first";

fn unreadable(path: &Path, cause: &io::Error) -> String {
    let is_address = is_address(path);
    let path = shown(path);
    match cause.kind() {
        ErrorKind::NotFound if is_address => format!("`{path}`: {ONLY_FILES}"),
        ErrorKind::NotFound => match cause.get_ref() {
            Some(near) => format!("there is no scene file `{path}`: {near}"),
            None => format!("there is no scene file `{path}`"),
        },
        ErrorKind::IsADirectory => format!("`{path}` is a directory, and a scene is a file"),
        ErrorKind::PermissionDenied => format!("the scene file `{path}` may not be read: check its permissions"),
        _ => format!("the scene file `{path}` cannot be read: {cause}"),
    }
}
