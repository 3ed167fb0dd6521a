//! Errors of scene files, [`Diagnostic`] and [`SceneError`], and how they are rendered as text.

use std::fmt;
use std::io::{self, ErrorKind};
use std::ops::Range;
use std::path::{Path, PathBuf};

use annotate_snippets::{AnnotationKind, Group, Level, Origin, Renderer, Snippet};

use super::log::is_line_end;
use super::{MeshError, MeshFormat};

/// How many bytes of a line are shown before an erroneous token, of the token itself, and after
/// it. Diagnostics of long lines stay short that way.
const SHOWN_BEFORE: usize = 60;
const SHOWN_TOKEN: usize = 40;
const SHOWN_AFTER: usize = 30;
/// Shown where a line is cut.
const CUT: &str = "...";

/// An error at one place of a scene file.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Diagnostic {
    /// What is wrong, e.g. "sphere 3's radius is negative".
    pub message: String,
    /// The line, from 1.
    pub line: usize,
    /// The column, from 1, in characters; a byte order mark does not count.
    pub column: usize,
    /// The token in question, cut if it is long; empty where the file ends too early.
    pub token: String,
    /// What would have been valid, e.g. "a number greater than 0".
    pub expected: String,
    /// How to fix it, where that is not obvious.
    pub help: Option<String>,
    /// The byte range of the whole token in the file.
    pub span: Range<usize>,
    /// The part of the line around the token that is shown.
    excerpt: Excerpt,
}

/// A part of a source line, and the byte range of the token within `text`.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Excerpt {
    text: String,
    mark: Range<usize>,
    /// Whether the line's start is shown.
    whole_start: bool,
}

/// Why a scene could not be read.
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
        /// The operating system's error.
        #[source]
        cause: io::Error,
    },
    /// The file was read but is not a valid scene.
    #[error("{}", self.render(false))]
    Invalid {
        /// The file's name as [`parse`](super::parse()) was given it.
        name: String,
        /// What is wrong, in the order of the file; never empty.
        diagnostics: Vec<Diagnostic>,
        /// How many further errors the file has that are not in `diagnostics`.
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
    /// The file seems to be a mesh, but its name lacks the extension that tells the format.
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
    /// A diagnostic of a token. `line_start` is the byte offset of the token's line in
    /// `source`.
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
            // Give the column explicitly: the renderer would count it from the start of the
            // excerpt.
            let place = Origin::path(file).line(self.line).char_column(self.column);
            vec![title.element(place), Group::with_level(Level::ERROR).element(snippet).elements(help)]
        }
    }
}

impl SceneError {
    /// The errors in the content, in the order of the file; empty if the file could not be read
    /// at all.
    pub fn diagnostics(&self) -> &[Diagnostic] {
        match self {
            SceneError::Invalid { diagnostics, .. } => diagnostics,
            _ => &[],
        }
    }

    /// One line for each diagnostic ([`Diagnostic::one_line`]), and one with the number of
    /// omitted ones.
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

    /// Each error with the line of the file it is in, for a terminal: coloured by ANSI codes or
    /// plain, without a newline at the end.
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

    /// The message for an error that concerns a file as a whole.
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
        // The token may be a lone UTF-8 continuation byte, as this error is likely of that: do
        // not cut behind it.
        let cut = || boundary(source, span.start - SHOWN_BEFORE).min(span.start);
        let from = if whole_start { line_start } else { cut() };
        let token_end = shown_end(source, span);
        // Nothing follows a token that was cut, since it would look like a part of the token.
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

/// The first offset at or after `at` where a UTF-8 character can begin.
fn boundary(source: &[u8], at: usize) -> usize {
    let inside = source[at..].iter().take_while(|&&byte| byte & 0xc0 == 0x80).count();
    // No character has more than four bytes: a longer run of continuation bytes is not UTF-8,
    // and any offset in it will do.
    at + inside.min(3)
}

/// The offset where the shown part of a token ends.
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

/// A path as text that is safe to print.
pub fn shown(path: impl AsRef<Path>) -> String {
    printable(&path.as_ref().to_string_lossy())
}

/// `text` with its invisible characters escaped, so that a file cannot control the terminal.
pub fn printable(text: &str) -> String {
    let spell = |c: char| if is_unseen(c) { c.escape_default().to_string() } else { c.to_string() };
    text.chars().map(spell).collect()
}

/// Text from a file or a user, made safe so that it neither controls a terminal nor fills it:
/// invisible characters are escaped, and the middle of a long text is left out. The end is kept,
/// since it may tell the place.
pub fn brief(text: &str) -> String {
    const SHOWN: [usize; 2] = [240, 60];
    match (text.char_indices().nth(SHOWN[0]), text.char_indices().nth_back(SHOWN[1])) {
        (Some((end, _)), Some((start, _))) if end < start => printable(&text[..end]) + CUT + &printable(&text[start..]),
        _ => printable(text),
    }
}

/// Whether a character is invisible but may change how a terminal shows others: Unicode's
/// control and format characters (such as those that change the direction of writing), and
/// separators of lines and paragraphs.
pub fn is_unseen(c: char) -> bool {
    let is_format = matches!(u32::from(c), 0xad | 0x61c | 0x180e | 0x200b..=0x200f | 0x2028..=0x202e | 0x2060..=0x206f | 0xfeff
        | 0xfff9..=0xfffb | 0x13430..=0x1343f | 0x1bca0..=0x1bca3 | 0x1d173..=0x1d17a | 0xe0000..=0xe007f);
    is_format || c.is_control()
}

/// `error`, or a clearer error if no file was found because the path is a web address.
#[cfg(feature = "files")]
pub fn of_address(path: &Path, error: io::Error) -> io::Error {
    let is_address = error.kind() == ErrorKind::NotFound && is_address(path);
    if is_address { io::Error::new(ErrorKind::NotFound, ONLY_FILES) } else { error }
}

/// The name of a scene's source in messages.
fn source_name(path: &Path) -> String {
    if path == Path::new("-") { "standard input".into() } else { format!("`{}`", shown(path)) }
}

/// Whether a path is a web address. Nothing is read from the web.
pub(crate) fn is_address(path: &Path) -> bool {
    path.to_str()
        .and_then(|name| name.split_once("://"))
        .is_some_and(|(scheme, _)| !scheme.is_empty() && scheme.bytes().all(|byte| byte.is_ascii_alphanumeric()))
}

/// The help for a path that is a web address.
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
