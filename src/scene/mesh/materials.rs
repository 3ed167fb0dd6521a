//! The colours of meshes: of vertices, and of the materials (MTL) that an OBJ file refers to.

use std::collections::HashMap;
use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};

use glam::Vec3;

use super::Mesh;
use super::colour::to_linear;
use crate::scene::diagnostic::brief;
use crate::scene::log::{BYTE_ORDER_MARK, is_line_end};
use crate::scene::{mistaken, open};

/// The longest material file that is read, in bytes.
const MOST: u64 = 16 << 20;

/// The statements about materials in an OBJ file.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Materials {
    /// The arguments of each `mtllib` statement.
    libraries: Vec<Vec<u8>>,
    /// The `usemtl` statements, in the order of the triangles.
    uses: Vec<Use>,
}

/// The material of the triangles from one on, up to the next use.
#[derive(Debug, PartialEq)]
struct Use {
    from: usize,
    name: Vec<u8>,
}

/// The properties of a material that matter here.
#[derive(Clone, Default)]
struct Material {
    colour: Option<Vec3>,
    /// Whether it has a `Kd` statement that is not a valid colour.
    has_odd_colour: bool,
    has_texture: bool,
    is_transparent: bool,
}

/// Materials by their names.
#[derive(Default)]
struct Known {
    materials: HashMap<Vec<u8>, Material>,
    /// The materials by the part of their names before a `#`: some programs take a `#` for part
    /// of the name, others for the start of a comment.
    by_short_names: HashMap<Vec<u8>, Material>,
}

/// The text before a comment. A `#` in a number such as `1.#QNAN` begins no comment: some C
/// libraries write NaN and infinity so.
pub(super) fn before_comment(text: &[u8]) -> &[u8] {
    let is_of_number = |at: usize| {
        let (before, after) = (&text[..at], &text[at + 1..]);
        let kinds: [&[u8]; 4] = [b"IND", b"INF", b"QNAN", b"SNAN"];
        let is_kind = |kind: &[u8]| after.get(..kind.len()).is_some_and(|word| word.eq_ignore_ascii_case(kind));
        before.ends_with(b"1.") && kinds.into_iter().any(is_kind)
    };
    let begins = |(at, byte): (usize, &u8)| *byte == b'#' && !is_of_number(at);
    &text[..text.iter().enumerate().position(begins).unwrap_or(text.len())]
}

/// The colour in linear light that the first three words give, if they are a valid colour.
pub(super) fn colour<'a>(mut words: impl Iterator<Item = &'a str>) -> Option<Vec3> {
    let is_possible = |value: &f64| *value >= 0.0 && value.is_finite();
    let mut channel = || words.next()?.parse().ok().filter(is_possible).map(to_linear);
    Some(Vec3::new(channel()?, channel()?, channel()?))
}

/// A finite number, rounded to f32.
pub(super) fn number(word: &[u8]) -> Option<f32> {
    str::from_utf8(word).ok()?.parse().ok().filter(|value: &f32| value.is_finite())
}

impl Mesh {
    /// Gives each triangle the mean of its corners' colours.
    pub(super) fn paint_by_vertices(&mut self, of_vertices: &[Vec3]) {
        let triangles = std::mem::take(&mut self.triangles);
        self.paint(triangles.iter().map(|triangle| {
            let [a, b, c] = triangle.map(|corner| of_vertices[corner as usize]);
            // Skip the mean of equal colours, which rounding may change.
            if a == b && b == c { a } else { ((a + b + c) / 3.0).min(Vec3::MAX) }
        }));
        self.triangles = triangles;
    }

    /// Adds a note about the parts of the file that are not read.
    pub(super) fn note_unread(&mut self, unread: &[(&str, bool)]) {
        let unread: Vec<_> = unread.iter().filter(|(_, is_there)| *is_there).map(|(what, _)| *what).collect();
        if !unread.is_empty() {
            self.notes.push(format!("not read: {}", unread.join(", ")));
        }
    }
}

impl Materials {
    /// Records that triangles from this one on have the material `name`.
    pub(super) fn use_from(&mut self, triangle: usize, name: &[u8]) {
        self.uses.push(Use { from: triangle, name: unquoted(name).to_vec() });
    }

    /// Records the arguments of an `mtllib` statement.
    pub(super) fn add_library(&mut self, names: &[u8]) {
        self.libraries.push(names.trim_ascii().to_vec());
    }

    /// Appends the statements of later lines. Triangle 0 of these is triangle `first` of the
    /// file.
    pub(super) fn append(&mut self, later: Materials, first: usize) {
        self.libraries.extend(later.libraries);
        self.uses.extend(later.uses.into_iter().map(|Use { from, name }| Use { from: first + from, name }));
    }

    /// Gives a mesh without colours those of its materials, which are read from files in
    /// `folder`.
    pub(super) fn paint(&self, mesh: &mut Mesh, folder: &Path) {
        if self.uses.is_empty() {
            return;
        }
        if !mesh.colours.is_empty() {
            return mesh.note_unread(&[("materials, since vertices have colours", true)]);
        }
        let mut known = Known::default();
        let mut all_are_read = true;
        for library in &self.libraries {
            if let Err(fault) = known.read_all(library, folder, &mut mesh.libraries) {
                let name = brief(&String::from_utf8_lossy(unquoted(library)));
                mesh.notes.push(format!("the materials in `{name}` cannot be read: {fault}"));
                all_are_read = false;
            }
        }
        self.paint_with(&known, mesh, all_are_read);
    }

    /// Gives a mesh the colours of these materials, and adds notes about what else the
    /// materials have.
    fn paint_with(&self, known: &Known, mesh: &mut Mesh, all_are_read: bool) {
        let has = |which: fn(&Material) -> bool| self.uses.iter().any(|it| known.get(&it.name).is_some_and(which));
        let is_unknown = |it: &Use| !it.name.is_empty() && known.get(&it.name).is_none();
        let unread = [
            ("materials that no file describes", all_are_read && self.uses.iter().any(is_unknown)),
            ("textures", has(|material| material.has_texture)),
            ("transparency", has(|material| material.is_transparent)),
            ("colours (Kd) that are not one or three numbers from 0", has(|material| material.has_odd_colour)),
            ("materials without a colour (Kd)", has(Material::is_plain)),
        ];
        let exceeds_one = has(|material| material.colour.is_some_and(|colour| colour.max_element() > 1.0));
        let mut uses = self.uses.iter().peekable();
        let mut colour = Vec3::ONE;
        let colours = (0..mesh.triangles.len()).map(|triangle| {
            while let Some(it) = uses.next_if(|it| it.from <= triangle) {
                colour = known.get(&it.name).and_then(|material| material.colour).unwrap_or(Vec3::ONE);
            }
            colour
        });
        mesh.paint(colours);
        mesh.note_unread(&unread);
        if exceeds_one {
            mesh.notes.push("colours of materials (Kd) exceed 1, and are taken as they are".into());
        }
    }
}

impl Material {
    /// Whether the material has neither a colour, valid or not, nor a texture.
    fn is_plain(&self) -> bool {
        self.colour.is_none() && !self.has_odd_colour && !self.has_texture
    }
}

impl Known {
    fn get(&self, name: &[u8]) -> Option<&Material> {
        self.materials.get(name).or_else(|| self.by_short_names.get(before_comment(name).trim_ascii()))
    }

    fn insert(&mut self, name: &[u8], material: Material) {
        self.by_short_names.insert(unquoted(before_comment(name)).to_vec(), material.clone());
        self.materials.insert(unquoted(name).to_vec(), material);
    }

    /// Reads the material files that an `mtllib` line names: one file whose name may contain
    /// blanks, or several files. Adds the paths of existing files to `paths`.
    fn read_all(&mut self, names: &[u8], folder: &Path, paths: &mut Vec<PathBuf>) -> io::Result<()> {
        let Err(fault) = self.read(unquoted(names), folder, paths) else { return Ok(()) };
        let names = names_of(names);
        if names.is_empty() {
            return Err(fault);
        }
        names.into_iter().map(|name| self.read(name, folder, paths)).fold(Ok(()), Result::and)
    }

    /// Reads a material file.
    fn read(&mut self, name: &[u8], folder: &Path, paths: &mut Vec<PathBuf>) -> io::Result<()> {
        let path = find(name, folder)?;
        let text = open::contents_within(&path, MOST, "too many for materials")?;
        if let Some(mistaken) = mistaken::recognise_unread(&text) {
            return Err(io::Error::other(format!("{}: {}", mistaken.what, mistaken.help)));
        }
        self.parse(text.strip_prefix(BYTE_ORDER_MARK.as_bytes()).unwrap_or(&text));
        paths.push(path);
        Ok(())
    }

    /// Adds the materials defined in a text.
    fn parse(&mut self, text: &[u8]) {
        let mut material = Material::default();
        let mut name = None;
        for line in text.split(|byte| is_line_end(*byte)).map(<[u8]>::trim_ascii) {
            let end = line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len());
            let (word, rest) = line.split_at(end);
            let is = |known: &str| word.eq_ignore_ascii_case(known.as_bytes());
            let share = || before_comment(rest).split(u8::is_ascii_whitespace).find_map(number);
            if is("newmtl") {
                let before = std::mem::take(&mut material);
                if let Some(name) = name.replace(rest) {
                    self.insert(name, before);
                }
            } else if is("Kd") {
                material.colour = diffuse(before_comment(rest));
                material.has_odd_colour = material.colour.is_none();
            } else if is("map_Kd") {
                material.has_texture = true;
            } else if is("d") {
                material.is_transparent |= share().is_some_and(|share| share < 1.0);
            } else if is("Tr") {
                material.is_transparent |= share().is_some_and(|share| share > 0.0);
            }
        }
        if let Some(name) = name {
            self.insert(name, material);
        }
    }
}

/// The colour of a `Kd` statement: three numbers, or one for a grey.
fn diffuse(text: &[u8]) -> Option<Vec3> {
    let words: Vec<_> = str::from_utf8(text).ok()?.split_ascii_whitespace().collect();
    match words[..] {
        [grey] => colour([grey; 3].into_iter()),
        _ => colour(words.into_iter()),
    }
}

/// A name without the quotes that some programs write around it.
fn unquoted(name: &[u8]) -> &[u8] {
    let name = name.trim_ascii();
    let inner = name.strip_prefix(b"\"").and_then(|name| name.strip_suffix(b"\""));
    inner.filter(|inner| !inner.contains(&b'"')).unwrap_or(name)
}

/// The file names in an `mtllib` line, up to a comment: text in quotes; text that ends in
/// `.mtl`, which may contain blanks; otherwise single words.
fn names_of(names: &[u8]) -> Vec<&[u8]> {
    let mut found = Vec::new();
    let mut rest = names.trim_ascii_start();
    while !rest.is_empty() && !rest.starts_with(b"#") {
        let (inner, end) = match rest.strip_prefix(b"\"") {
            Some(inner) => (inner, inner.iter().position(|byte| *byte == b'"')),
            None => (rest, extension_end(rest).or_else(|| rest.iter().position(u8::is_ascii_whitespace))),
        };
        let end = end.unwrap_or(inner.len());
        found.push(&inner[..end]);
        rest = inner[end..].get(1..).unwrap_or_default().trim_ascii_start();
    }
    found
}

/// The end of the first word that ends in `.mtl`, if there is one before a comment or a quote.
fn extension_end(names: &[u8]) -> Option<usize> {
    let names = before_comment(names).split(|byte| *byte == b'"').next().unwrap_or_default();
    let is_end = |end: &usize| names.get(*end).is_none_or(u8::is_ascii_whitespace);
    (4..=names.len()).filter(is_end).find(|end| names[end - 4..*end].eq_ignore_ascii_case(b".mtl"))
}

/// The regular file that a name refers to: at its path relative to the folder, or else by its
/// last component in the folder, since the path is often one of the machine that wrote it.
fn find(name: &[u8], folder: &Path) -> io::Result<PathBuf> {
    let mut name = name.to_vec();
    name.iter_mut().filter(|byte| **byte == b'\\').for_each(|byte| *byte = b'/');
    let bare = name.rsplit(|byte| *byte == b'/').next().unwrap_or_default();
    let mut found = [&name[..], bare].into_iter().flat_map(spellings).map(|name| regular(folder.join(name)));
    let first = found.next().unwrap_or_else(|| Err(io::ErrorKind::InvalidFilename.into()));
    first.or_else(|fault| found.find_map(Result::ok).ok_or(fault))
}

/// The path, or an error if it is not that of a regular file.
fn regular(path: PathBuf) -> io::Result<PathBuf> {
    if path.metadata()?.is_file() { Ok(path) } else { Err(io::Error::other("it is not a regular file")) }
}

/// The paths that the bytes of a name may mean: the bytes themselves on systems where paths are
/// bytes, and the bytes decoded as Latin-1 if they are not UTF-8.
fn spellings(name: &[u8]) -> Vec<OsString> {
    if let Ok(name) = str::from_utf8(name) {
        return vec![name.into()];
    }
    let latin_1 = name.iter().copied().map(char::from).collect::<String>().into();
    #[cfg(unix)]
    return vec![<std::ffi::OsStr as std::os::unix::ffi::OsStrExt>::from_bytes(name).to_owned(), latin_1];
    #[cfg(not(unix))]
    vec![latin_1]
}
