//! Wavefront OBJ: tobj reads vertices and faces; what it cannot say of an error is found in the text again.

use std::io::{self, BufRead, Read};

use glam::Vec3;
use tobj::{LoadError, LoadOptions};

use super::Mesh;
use super::materials::{Materials, colour};
use super::read::{Fault, counted, not_finite};

/// Corners are numbers from 1, or from -1 backwards.
const CORNER: &str = "vertex numbers, as in 7, 7/1, 7/1/2 or 7//2";

pub(super) fn parse(source: &[u8]) -> Result<(Mesh, Materials), Fault> {
    let mut lines = Lines::new(source);
    lines.coloured = is_coloured(source);
    // A vertex with two normals is one vertex.
    let options = LoadOptions { single_index: false, ..LoadOptions::default() };
    // Materials do not come into it: the lines that name them are not handed on.
    let loaded = tobj::load_obj_buf(&mut lines, &options, |_| Ok(Default::default()));
    let models = loaded.map_err(|error| fault(error, &lines, source))?.0;

    let (mut mesh, mut fans) = (Mesh::default(), Vec::new());
    let (mut tints, mut triangles_of) = (Vec::new(), Vec::new());
    for tobj::Model { mesh: model, .. } in models {
        let base = mesh.vertices.len() as u32;
        tints.extend(model.vertex_color.as_chunks().0.iter().map(|&tint| Vec3::from_array(tint)));
        let positions = model.positions.as_chunks().0.iter().map(|&position| Vec3::from_array(position));
        mesh.vertices.extend(positions);
        if !mesh.vertices.iter().all(|vertex| vertex.is_finite()) {
            return Err(infinite_vertex(source));
        }
        let corners: Vec<u32> = model.indices.iter().map(|index| base + index).collect();
        if model.face_arities.is_empty() {
            mesh.triangles.extend(corners.as_chunks().0);
            triangles_of.resize(triangles_of.len() + corners.len() / 3, 1);
            continue;
        }
        let mut rest = &corners[..];
        for (number, &corners) in (1..).zip(&model.face_arities) {
            let (face, after) = rest.split_at(corners as usize);
            if face.len() < 3 {
                return Err(small_face(source, number, face.len()));
            }
            mesh.push_face(number, face, &mut fans);
            triangles_of.push(face.len() - 2);
            rest = after;
        }
    }
    let mut mesh = mesh.cut(&fans)?;
    if lines.coloured {
        mesh.paint_by_vertices(&tints);
    }
    lines.unread.tell(&mut mesh);
    Ok((mesh, lines.materials.by_triangles(triangles_of.into_iter())))
}

/// What of a file is not read.
#[derive(Default)]
pub(super) struct Unread {
    normals: bool,
    textures: bool,
}

impl Unread {
    /// Looks at a line that is of no vertex and no face.
    pub(super) fn line(&mut self, line: &[u8]) {
        let blank = |line: &[u8]| line.get(2).is_some_and(u8::is_ascii_whitespace);
        self.normals |= line.starts_with(b"vn") && blank(line);
        self.textures |= line.starts_with(b"vt") && blank(line);
    }

    /// Notes it.
    pub(super) fn tell(&self, mesh: &mut Mesh) {
        mesh.note_unread(&[("normals", self.normals), ("texture coordinates", self.textures)]);
    }
}

/// Whether vertices have colours. Where some have weights, they are taken to have none: tobj knows but one of both.
fn is_coloured(source: &[u8]) -> bool {
    let (mut lines, mut coloured) = (Lines::new(source), false);
    while lines.next_line() {
        if lines.is(b"v") {
            if lines.words().count() == 5 {
                return false;
            }
            coloured |= lines.tint().is_some();
        }
    }
    coloured
}

/// The lines of vertices and faces, with the others left empty: so there is one model in one file, no normal or texture
/// can be out of range, and comments may be in any encoding.
struct Lines<'a> {
    rest: &'a [u8],
    /// What of the current line is still to be read.
    line: Vec<u8>,
    at: usize,
    /// The number of the line that was begun last, and of all that it has been joined from.
    number: usize,
    vertices: usize,
    faces: usize,
    /// Whether vertices are to have colours.
    coloured: bool,
    /// Of what is left out: materials, by the faces before them, and what is not read.
    materials: Materials,
    unread: Unread,
}

impl<'a> Lines<'a> {
    fn new(source: &'a [u8]) -> Self {
        let (line, materials, unread) = Default::default();
        Lines { rest: source, line, at: 0, number: 0, vertices: 0, faces: 0, coloured: false, materials, unread }
    }

    /// Takes the next line, or those that end in backslashes and the one after them, without what ends it.
    fn next_line(&mut self) -> bool {
        self.line.clear();
        self.at = 0;
        if self.rest.is_empty() {
            return false;
        }
        loop {
            let end = self.rest.iter().position(|&byte| byte == b'\n');
            let (line, rest) = self.rest.split_at(end.unwrap_or(self.rest.len()));
            self.rest = rest.strip_prefix(b"\n").unwrap_or(rest);
            self.number += 1;
            let line = line.trim_ascii_end();
            match line.strip_suffix(b"\\") {
                Some(begun) if !self.rest.is_empty() => {
                    self.line.extend(begun);
                    self.line.push(b' ');
                }
                _ => {
                    self.line.extend(line);
                    return true;
                }
            }
        }
    }

    fn words(&self) -> impl Iterator<Item = &[u8]> {
        self.line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty())
    }

    fn is(&self, kind: &[u8]) -> bool {
        self.words().next() == Some(kind)
    }

    /// Leaves of the line what is to be read.
    fn sift(&mut self) {
        if self.is(b"v") {
            self.vertices += 1;
            let tint = self.tint();
            if self.words().count() > 5 {
                self.line = self.words().take(4).collect::<Vec<_>>().join(&b' ');
            }
            if self.coloured && self.words().count() == 4 {
                let Vec3 { x, y, z } = tint.unwrap_or(Vec3::ONE);
                self.line.extend(format!(" {x} {y} {z}").into_bytes());
            }
        } else if self.is(b"f") {
            self.faces += 1;
        } else {
            let line = self.line.trim_ascii_start();
            self.unread.line(line);
            self.materials.line(line, self.faces);
            self.line.clear();
        }
        self.line.push(b'\n');
    }

    /// The colour that stands behind a vertex's coordinates.
    fn tint(&self) -> Option<Vec3> {
        colour(&self.words().skip(4).collect::<Vec<_>>().join(&b' '))
    }
}

impl BufRead for Lines<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.at == self.line.len() && self.next_line() {
            self.sift();
        }
        Ok(&self.line[self.at..])
    }

    fn consume(&mut self, amount: usize) {
        self.at += amount;
    }
}

impl Read for Lines<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.fill_buf()?.read(buffer)?;
        self.consume(read);
        Ok(read)
    }
}

/// What tobj's error means, and where.
fn fault(error: LoadError, lines: &Lines<'_>, source: &[u8]) -> Fault {
    let Lines { number, vertices, faces, .. } = *lines;
    match error {
        LoadError::FaceVertexOutOfBounds => missing_vertex(source),
        LoadError::PositionParseError => Fault::new(format!("vertex {vertices} is not a point"))
            .line(number)
            .expected("three numbers after v: x y z"),
        LoadError::ScalingByZeroError => {
            Fault::new(format!("vertex {vertices} has the weight 0")).line(number).expected("x y z alone")
        }
        LoadError::FaceParseError => {
            Fault::new(format!("face {faces} cannot be understood")).line(number).expected(CORNER)
        }
        LoadError::ReadError => {
            Fault::new("the line is no text: it is not UTF-8").line(number).expected("a vertex or a face")
        }
        error => Fault::new(error.to_string()).line(number),
    }
}

/// The face that has a vertex which there is not.
fn missing_vertex(source: &[u8]) -> Fault {
    let mut all = Lines::new(source);
    while all.next_line() {
        all.sift();
    }
    let there_are = all.vertices;
    let mut lines = Lines::new(source);
    while lines.next_line() {
        lines.sift();
        if !lines.is(b"f") {
            continue;
        }
        for (corner, word) in (1..).zip(lines.words().skip(1)) {
            let index = word.split(|&byte| byte == b'/').next().and_then(|index| str::from_utf8(index).ok());
            let index = index.and_then(|index| index.parse::<i64>().ok()).unwrap_or(0);
            let found = if index < 0 { lines.vertices as i64 + 1 + index } else { index };
            if !(1..=there_are as i64).contains(&found) {
                let face = lines.faces;
                let message = format!("face {face}'s corner {corner} is vertex {index}, which the file has not");
                let has = format!("1 to {there_are}, the number of its vertices, or -1 and down for the last ones");
                return Fault::new(message).line(lines.number).expected(has);
            }
        }
    }
    Fault::new("a face has a vertex which the file has not")
}

fn infinite_vertex(source: &[u8]) -> Fault {
    let mut lines = Lines::new(source);
    while lines.next_line() {
        lines.sift();
        let numbers: Vec<f32> =
            lines.words().skip(1).filter_map(|word| str::from_utf8(word).ok()?.parse().ok()).collect();
        if lines.is(b"v") && !numbers.iter().all(|number| number.is_finite()) {
            return not_finite(&format!("vertex {}", lines.vertices)).line(lines.number);
        }
    }
    Fault::new("a vertex is not finite")
}

fn small_face(source: &[u8], face: usize, corners: usize) -> Fault {
    let mut lines = Lines::new(source);
    while lines.faces < face && lines.next_line() {
        lines.sift();
    }
    let message = format!("face {face} has {}", counted(corners, "corner", "corners"));
    Fault::new(message).line(lines.number).expected("at least three")
}
