//! Wavefront OBJ: tobj reads vertices and faces; what it cannot say of an error is found in the text again.

use std::io::{self, BufRead, Read};

use glam::Vec3;
use tobj::{LoadError, LoadOptions};

use super::Mesh;
use super::read::{Fault, counted, not_finite};

/// Corners are numbers from 1, or from -1 backwards.
const CORNER: &str = "vertex numbers, as in 7, 7/1, 7/1/2 or 7//2";

pub(super) fn parse(source: &[u8]) -> Result<Mesh, Fault> {
    let mut lines = Lines::new(source);
    // A vertex with two normals is one vertex.
    let options = LoadOptions { single_index: false, ..LoadOptions::default() };
    // Materials do not come into it: the lines that name them are not handed on.
    let loaded = tobj::load_obj_buf(&mut lines, &options, |_| Ok(Default::default()));
    let models = loaded.map_err(|error| fault(error, &lines, source))?.0;

    let (mut mesh, mut fans) = (Mesh::default(), Vec::new());
    for tobj::Model { mesh: model, .. } in models {
        let base = mesh.vertices.len() as u32;
        let positions = model.positions.as_chunks().0.iter().map(|&position| Vec3::from_array(position));
        mesh.vertices.extend(positions);
        if !mesh.vertices.iter().all(|vertex| vertex.is_finite()) {
            return Err(infinite_vertex(source));
        }
        let corners: Vec<u32> = model.indices.iter().map(|index| base + index).collect();
        if model.face_arities.is_empty() {
            mesh.triangles.extend(corners.as_chunks().0);
            continue;
        }
        let mut rest = &corners[..];
        for (number, &corners) in (1..).zip(&model.face_arities) {
            let (face, after) = rest.split_at(corners as usize);
            if face.len() < 3 {
                return Err(small_face(source, number, face.len()));
            }
            mesh.push_face(number, face, &mut fans);
            rest = after;
        }
    }
    mesh.cut(&fans)
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
}

impl<'a> Lines<'a> {
    fn new(source: &'a [u8]) -> Self {
        Lines { rest: source, line: Vec::new(), at: 0, number: 0, vertices: 0, faces: 0 }
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
            // Three coordinates and a colour: the colour of a mesh is the scene's.
            if self.words().count() > 5 {
                self.line = self.words().take(4).collect::<Vec<_>>().join(&b' ');
            }
        } else if self.is(b"f") {
            self.faces += 1;
        } else {
            self.line.clear();
        }
        self.line.push(b'\n');
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
