//! Recognising what a file is by its content, where its name does not tell or is wrong.

use std::path::Path;

use super::log::is_line_end;
use super::mistaken::{is_picture, recognise};
use super::token::next_token;
use super::{MeshFormat, SceneError, SceneFormat};

/// How much of a file is looked at: the first lines, and the first bytes.
const LINES: usize = 100;
const BYTES: usize = 64 << 10;

/// The first bytes of scene and mesh formats that are not read under an unknown name: glTF in
/// JSON, anything in XML, Blender, FBX, archives (as 3MF), STEP, VRML, USD.
const OTHERS: [&[u8]; 8] = [b"{", b"<", b"BLENDER", b"Kaydara", b"PK\x03\x04", b"ISO-10303", b"#VRML", b"PXR-USDC"];

/// Extensions of other formats whose content can begin like a scene in the paper's format,
/// which begins with a word and two numbers.
const OTHER_EXTENSIONS: [&str; 11] =
    ["off", "coff", "noff", "node", "ele", "poly", "smesh", "mesh", "msh", "pts", "nff"];

/// The first words of lines of OBJ files.
const OBJ_WORDS: [&[u8]; 12] = [b"v", b"vt", b"vn", b"vp", b"f", b"l", b"p", b"o", b"g", b"s", b"mtllib", b"usemtl"];

/// The first lines of a text that are neither blank nor comments, trimmed.
fn lines(source: &[u8]) -> impl Iterator<Item = &[u8]> {
    let source = source.strip_prefix(b"\xef\xbb\xbf").unwrap_or(source);
    let lines = source[..source.len().min(BYTES)].split(|byte| is_line_end(*byte)).map(<[u8]>::trim_ascii);
    lines.filter(|line| !line.is_empty() && !line.starts_with(b"#")).take(LINES)
}

/// Whether a text is TOML: its first line that is neither blank nor a comment begins a table or
/// assigns a key.
pub(super) fn is_toml(source: &[u8]) -> bool {
    let begins = |line: &[u8]| line.starts_with(b"[") || !line.starts_with(b"//") && line.contains(&b'=');
    !is_of_other_program(source) && lines(source).next().is_some_and(begins)
}

fn is_of_other_program(source: &[u8]) -> bool {
    OTHERS.iter().any(|beginning| source.starts_with(beginning))
}

/// The error for a file that is no valid scene: what the file seems to be instead, or else
/// `error`.
pub(super) fn no_scene(error: SceneError, path: &Path, source: &[u8]) -> SceneError {
    let path = path.to_owned();
    if is_picture(source) {
        return SceneError::Picture { path };
    }
    match mesh_format(source) {
        _ if recognise(source).is_some() => error,
        Some(format) => SceneError::NamelessMesh { path, format },
        None if is_foreign(&path, source) => SceneError::Foreign { path },
        None => error,
    }
}

/// The mesh format that a file's content seems to be in.
fn mesh_format(source: &[u8]) -> Option<MeshFormat> {
    let starts_with = |word: &[u8]| {
        let source = source.trim_ascii_start();
        let end = source.get(word.len()).is_some_and(u8::is_ascii_whitespace);
        end && source[..word.len()].eq_ignore_ascii_case(word)
    };
    if starts_with(b"ply") {
        return Some(MeshFormat::Ply);
    }
    // Only binary glTF begins so. JSON is not taken for glTF, as it may be anything else.
    if source.starts_with(b"glTF") {
        return Some(MeshFormat::Gltf);
    }
    let is_facet = |line: &[u8]| word(line).eq_ignore_ascii_case(b"facet");
    // A binary STL file is a title of 80 bytes, the number of its facets in 4 bytes, and 50
    // bytes for each of them.
    let count = source.get(80..84).map(|count| u32::from_le_bytes([count[0], count[1], count[2], count[3]]));
    let has_binary_length = count.is_some_and(|count| source.len() as u64 == 84 + 50 * u64::from(count));
    if has_binary_length || starts_with(b"solid") && lines(source).any(is_facet) {
        return Some(MeshFormat::Stl);
    }
    let is_obj = lines(source).all(|line| OBJ_WORDS.iter().any(|known| word(line).eq_ignore_ascii_case(known)));
    (is_obj && lines(source).any(is_vertex)).then_some(MeshFormat::Obj)
}

/// The first word of a line.
fn word(line: &[u8]) -> &[u8] {
    line.split(u8::is_ascii_whitespace).next().unwrap_or_default()
}

/// Whether a line is a vertex of OBJ: `v` and three numbers.
fn is_vertex(line: &[u8]) -> bool {
    let Ok(line) = str::from_utf8(line) else { return false };
    let mut words = line.split_ascii_whitespace();
    let is_number = |word: &str| word.parse::<f32>().is_ok();
    words.next().is_some_and(|word| word.eq_ignore_ascii_case("v"))
        && (0..3).all(|_| words.next().is_some_and(is_number))
}

/// Whether a file that is no valid scene in the paper's format was not meant as one either:
/// because it begins like another format, because its extension is of a format that begins alike,
/// or because it has another extension and does not begin with a word, a width and a height.
fn is_foreign(path: &Path, source: &[u8]) -> bool {
    if is_of_other_program(source) {
        return true;
    }
    let Some(extension) = path.extension().filter(|_| SceneFormat::from_path(path).is_none()) else { return false };
    if OTHER_EXTENSIONS.iter().any(|other| extension.eq_ignore_ascii_case(other)) {
        return true;
    }
    let mut at = 0;
    let mut token = || {
        let token = next_token(source, at)?;
        at = token.end;
        Some(&source[token])
    };
    let begins = token().is_some() && (0..2).all(|_| token().is_some_and(|side| side.iter().all(u8::is_ascii_digit)));
    !begins
}
