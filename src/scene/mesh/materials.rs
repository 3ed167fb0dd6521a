//! Colours of meshes: those of vertices, and the materials that an OBJ file names (MTL).

use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};

use glam::Vec3;

use super::Mesh;
use crate::scene::diagnostic::brief;
use crate::scene::log::BYTE_ORDER_MARK;
use crate::scene::open;

/// The longest file of materials that is read, in bytes.
const MOST: u64 = 16 << 20;

/// The statements of an OBJ file about materials.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Materials {
    /// The files of materials.
    libraries: Vec<Vec<u8>>,
    /// The material used from each triangle on.
    uses: Vec<(usize, Vec<u8>)>,
}

/// The used part of a material.
#[derive(Default)]
struct Material {
    colour: Option<Vec3>,
    has_texture: bool,
    is_transparent: bool,
}

/// The three numbers at the start of a text, if they are a colour.
pub(super) fn colour(text: &[u8]) -> Option<Vec3> {
    let mut words = text.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    let mut channel = || number(words.next()?).filter(|value| *value >= 0.0);
    Some(Vec3::new(channel()?, channel()?, channel()?))
}

/// A finite number, rounded to f32.
pub(super) fn number(word: &[u8]) -> Option<f32> {
    str::from_utf8(word).ok()?.parse().ok().filter(|value: &f32| value.is_finite())
}

impl Mesh {
    /// Gives each triangle the mean of the colours of its corners.
    pub(super) fn paint_by_vertices(&mut self, of_vertices: &[Vec3]) {
        let triangles = std::mem::take(&mut self.triangles);
        self.paint(triangles.iter().map(|triangle| {
            let [a, b, c] = triangle.map(|corner| of_vertices[corner as usize]);
            // The mean of three equal colours may differ from them by rounding.
            if a == b && b == c { a } else { ((a + b + c) / 3.0).min(Vec3::MAX) }
        }));
        self.triangles = triangles;
    }

    /// Notes the parts of its file that are not read.
    pub(super) fn note_unread(&mut self, unread: &[(&str, bool)]) {
        let unread: Vec<_> = unread.iter().filter(|(_, is_there)| *is_there).map(|(what, _)| *what).collect();
        if !unread.is_empty() {
            self.notes.push(format!("not read: {}", unread.join(", ")));
        }
    }
}

impl Materials {
    /// Takes a line about materials; `triangles` came before it.
    pub(super) fn line(&mut self, line: &[u8], triangles: usize) {
        let word = |word: &[u8]| {
            let name = line.strip_prefix(word)?;
            name.first().is_some_and(u8::is_ascii_whitespace).then(|| name.trim_ascii().to_vec())
        };
        if let Some(name) = word(b"usemtl") {
            self.uses.push((triangles, name));
        } else if let Some(name) = word(b"mtllib") {
            self.libraries.push(name);
        }
    }

    /// Gives a mesh without colours those of its materials, from files in this folder.
    pub(super) fn paint(&self, mesh: &mut Mesh, folder: &Path) {
        if self.uses.is_empty() {
            return;
        }
        if !mesh.colours.is_empty() {
            return mesh.note_unread(&[("materials, since vertices have colours", true)]);
        }
        let (mut known, mut all_are_read) = (HashMap::new(), true);
        for library in &self.libraries {
            let words = || library.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
            let mut read = |name| read(name, folder, &mut known).map(|path| mesh.libraries.push(path));
            // One name with blanks, or several.
            let fault = read(library).or_else(|one| words().map(read).reduce(Result::and).unwrap_or(Err(one)));
            if let Err(fault) = fault {
                let name = brief(&String::from_utf8_lossy(library));
                mesh.notes.push(format!("its materials are not all there: `{name}` cannot be read: {fault}"));
                all_are_read = false;
            }
        }
        let none = Material::default();
        let of = |name: &[u8]| known.get(name).unwrap_or(&none);
        let has = |which: fn(&Material) -> bool| self.uses.iter().any(|(_, name)| which(of(name)));
        let unread = [
            (
                "materials that no file describes",
                all_are_read && self.uses.iter().any(|(_, name)| !known.contains_key(name)),
            ),
            ("textures", has(|material| material.has_texture)),
            ("transparency", has(|material| material.is_transparent)),
        ];
        let mut uses = self.uses.iter().peekable();
        let mut colour = Vec3::ONE;
        let colours = (0..mesh.triangles.len()).map(|triangle| {
            while let Some((_, name)) = uses.next_if(|(from, _)| *from <= triangle) {
                colour = of(name).colour.unwrap_or(Vec3::ONE);
            }
            colour
        });
        mesh.paint(colours);
        mesh.note_unread(&unread);
    }
}

/// Reads a file of materials, if there is a regular one; returns which.
fn read(name: &[u8], folder: &Path, known: &mut HashMap<Vec<u8>, Material>) -> io::Result<PathBuf> {
    let path = folder.join(str::from_utf8(name).map_err(io::Error::other)?.replace('\\', "/"));
    if !path.metadata()?.is_file() {
        return Err(io::Error::other("it is not a regular file"));
    }
    let text = open::contents_within(&path, MOST, "too many for materials")?;
    let mut material = Material::default();
    let mut begun = None;
    let text = text.strip_prefix(BYTE_ORDER_MARK.as_bytes()).unwrap_or(&text);
    for line in text.split(|byte| *byte == b'\n').map(<[u8]>::trim_ascii) {
        let end = line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len());
        let (word, rest) = line.split_at(end);
        let rest = rest.trim_ascii();
        let share = || number(rest.split(u8::is_ascii_whitespace).next()?);
        match word {
            b"newmtl" => {
                known.extend(begun.replace(rest.to_vec()).map(|name| (name, std::mem::take(&mut material))));
            }
            b"Kd" => material.colour = colour(rest),
            b"map_Kd" => material.has_texture = true,
            b"d" => material.is_transparent |= share().is_some_and(|share| share < 1.0),
            b"Tr" => material.is_transparent |= share().is_some_and(|share| share > 0.0),
            _ => {}
        }
    }
    known.extend(begun.map(|name| (name, material)));
    Ok(path)
}
