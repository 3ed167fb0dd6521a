//! Wavefront OBJ, piece by piece.

use std::borrow::Cow;
use std::io::Read;

use glam::Vec3;

use super::fault::{counted, not_finite};
use super::materials::{Materials, colour};
use super::polygon::Fan;
use super::{Mesh, MeshError};
use crate::kernels::sys::room;
use crate::scene::log::is_line_end;
use crate::scene::pieces::Pieces;

/// Corners are numbers from 1, or backwards from -1.
const CORNER: &str = "vertex numbers, as in 7, 7/1, 7/1/2 or 7//2";

/// The mesh of a file of this length; None if that cannot be read.
pub(super) fn read(file: impl Read, length: usize) -> Option<Result<(Mesh, Materials), MeshError>> {
    let mut pieces = Pieces::new(file, length);
    // "v 0 0 0" and "f 1 2 3" are the shortest lines.
    let most = length / 8 + 1;
    let mut obj = Obj { points: room(most), mesh: Mesh { triangles: room(most), ..Mesh::default() }, ..Obj::default() };
    loop {
        pieces.fill()?;
        let (text, ended) = (pieces.rest(), pieces.ended());
        let end =
            if ended { text.len() } else { text.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1) };
        let mut rest = &text[..end];
        if let Err(fault) = obj.lines(&mut rest, ended) {
            return Some(Err(fault));
        }
        let left = text.len() - end + rest.len();
        if ended {
            return Some(obj.mesh());
        } else if left == text.len() {
            pieces.lengthen()?;
        } else {
            pieces.leave(left);
        }
    }
}

/// What has been read of a file so far.
#[derive(Default)]
struct Obj {
    /// The number of lines begun.
    line: usize,
    points: Vec<Vec3>,
    /// The mesh, with triangles of `points`.
    mesh: Mesh,
    /// Colours of points; later points are white.
    tints: Vec<Vec3>,
    faces: usize,
    fans: Vec<Fan>,
    materials: Materials,
    normals: bool,
    textures: bool,
    /// The corners of the current face.
    corners: Vec<u32>,
    /// Whether some vertices have weights: then none has a colour.
    weighted: bool,
    /// The first vertex that is not finite, which matters if it is used, and its line.
    infinite: Option<(usize, usize)>,
    /// Corners whose vertices had not been read yet, except those that cannot be the first missing one.
    early: Vec<Corner>,
    /// The first face of less than three corners, and the corners of all such faces.
    small: Option<MeshError>,
    of_small: Vec<u32>,
}

/// A corner of a face, for an error.
struct Corner {
    line: usize,
    face: usize,
    corner: usize,
    /// The number in the file.
    index: i64,
    /// The vertex from 1, if there is one.
    vertex: i64,
}

impl Obj {
    /// Takes lines, up to one that is not all at hand.
    fn lines(&mut self, rest: &mut &[u8], ended: bool) -> Result<(), MeshError> {
        while !rest.is_empty() {
            let begun = *rest;
            let Some((line, count)) = joined(rest, ended) else {
                *rest = begun;
                return Ok(());
            };
            self.line += count;
            self.take(&line)?;
        }
        Ok(())
    }

    /// Takes a line.
    fn take(&mut self, line: &[u8]) -> Result<(), MeshError> {
        let words = || line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
        let at = self.line;
        let fault = |message: String, expected: &str| MeshError::new(message).line(at).expected(expected);
        let text = |line| {
            str::from_utf8(line).map_err(|_| fault("the line is no text: it is not UTF-8".into(), "a vertex or a face"))
        };
        match words().next() {
            Some(b"v") => {
                let vertex = self.points.len() + 1;
                let no_point = || fault(format!("vertex {vertex} is not a point"), "three numbers after v: x y z");
                let mut more = line;
                for _ in 0..4 {
                    more = more.trim_ascii_start();
                    more = &more[more.iter().position(u8::is_ascii_whitespace).unwrap_or(more.len())..];
                }
                if let Some(colour) = colour(more) {
                    self.tints.resize(self.points.len(), Vec3::ONE);
                    self.tints.push(colour);
                }
                let count = words().count();
                self.weighted |= count == 5;
                let text = text(if count > 5 { &line[..line.len() - more.len()] } else { line })?;
                let mut words = text.split_whitespace().skip(1);
                let mut number = || words.next().map(str::parse::<f32>);
                let mut coordinate = || number().and_then(Result::ok).ok_or_else(no_point);
                let mut point = Vec3::new(coordinate()?, coordinate()?, coordinate()?);
                let weight = number();
                // Unicode separates words where ASCII does not: with two more words it is a colour, not read here.
                let weight = match words.count() {
                    0 => weight.transpose().map_err(|_| no_point())?,
                    2 => None,
                    _ => return Err(MeshError::new("color parse error (too many or too few components)").line(at)),
                };
                if !point.is_finite() || weight.is_some_and(|weight| !weight.is_finite()) {
                    self.infinite.get_or_insert((vertex, at));
                }
                if let Some(weight) = weight {
                    if weight == 0.0 {
                        return Err(fault(format!("vertex {vertex} has the weight 0"), "x y z alone"));
                    }
                    point /= weight;
                }
                self.points.push(point);
            }
            Some(b"f") => {
                self.corners.clear();
                let (there_are, face) = (self.points.len() as i64, self.faces + 1);
                let words = text(line)?.split_whitespace().skip(1).take_while(|word| !word.starts_with('#'));
                for (corner, word) in (1..).zip(words) {
                    let mut parts =
                        word.split('/').map(|part| if part.is_empty() { Some(0) } else { part.parse().ok() });
                    let index = parts.next().flatten();
                    let Some(index) =
                        index.filter(|_| parts.by_ref().take(2).all(|part| part.is_some()) && parts.next().is_none())
                    else {
                        return Err(fault(format!("face {face} cannot be understood"), CORNER));
                    };
                    let vertex = if index < 0 { there_are + 1 + index } else { index };
                    self.corners.push(u32::try_from(vertex - 1).unwrap_or(u32::MAX));
                    let last = self.early.last().map(|last| last.vertex);
                    let is_first = last.is_none_or(|last| last > 0 && (vertex < 1 || vertex > last));
                    if !(1..=there_are).contains(&vertex) && is_first {
                        self.early.push(Corner { line: at, face, corner, index, vertex });
                    }
                }
                if let count @ ..3 = self.corners.len() {
                    let message = format!("face {face} has {}", counted(count, "corner", "corners"));
                    self.small.get_or_insert(fault(message, "at least three"));
                    self.of_small.append(&mut self.corners);
                    self.faces += 1;
                } else {
                    self.face();
                }
            }
            _ => self.other(line),
        }
        Ok(())
    }

    fn face(&mut self) {
        self.faces += 1;
        match self.corners[..] {
            [a, b, c] => self.mesh.triangles.push([a, b, c]),
            _ => self.mesh.push_face(self.faces, &self.corners, &mut self.fans),
        }
    }

    /// Takes a line that is neither a vertex nor a face.
    fn other(&mut self, line: &[u8]) {
        let line = line.trim_ascii_start();
        let blank = line.get(2).is_some_and(u8::is_ascii_whitespace);
        self.normals |= line.starts_with(b"vn") && blank;
        self.textures |= line.starts_with(b"vt") && blank;
        self.materials.line(line, self.mesh.triangles.len());
    }

    /// The mesh, after all lines have been read: its vertices are those that faces name, in the order in which they do.
    fn mesh(self) -> Result<(Mesh, Materials), MeshError> {
        let Obj { points, mut mesh, tints, .. } = self;
        let there_are = points.len() as i64;
        if let Some(missing) = self.early.iter().find(|corner| !(1..=there_are).contains(&corner.vertex)) {
            let Corner { line, face, corner, index, .. } = missing;
            let message = format!("face {face}'s corner {corner} is vertex {index}, which the file has not");
            let has = format!("1 to {there_are}, the number of its vertices, or -1 and down for the last ones");
            return Err(MeshError::new(message).line(*line).expected(has));
        }
        const NOWHERE: u32 = u32::MAX;
        let mut places = vec![NOWHERE; points.len()];
        mesh.vertices = room(points.len() + 1);
        let is_tinted = !tints.is_empty() && !self.weighted;
        let mut of_vertices = Vec::new();
        for index in mesh.triangles.as_flattened_mut() {
            let place = &mut places[*index as usize];
            if *place == NOWHERE {
                *place = mesh.vertices.len() as u32;
                mesh.vertices.push(points[*index as usize]);
                if is_tinted {
                    of_vertices.push(tints.get(*index as usize).copied().unwrap_or(Vec3::ONE));
                }
            }
            *index = *place;
        }
        if self.infinite.is_some() || self.weighted {
            let of_small = self.of_small.iter().map(|index| &points[*index as usize]);
            if !mesh.vertices.iter().chain(of_small).all(|vertex| vertex.is_finite()) {
                let nowhere = |(vertex, line)| not_finite(&format!("vertex {vertex}")).line(line);
                return Err(self.infinite.map_or_else(|| MeshError::new("a vertex is not finite"), nowhere));
            }
        }
        if let Some(small) = self.small {
            return Err(small);
        }
        let mut mesh = mesh.cut(&self.fans)?;
        if is_tinted {
            mesh.paint_by_vertices(&of_vertices);
            if tints.iter().any(|tint| tint.max_element() > 1.0) {
                mesh.notes.push("colours of vertices exceed 1, and are taken as they are".into());
            }
        }
        mesh.note_unread(&[("normals", self.normals), ("texture coordinates", self.textures)]);
        Ok((mesh, self.materials))
    }
}

/// Takes a line, joined with the next one after a backslash, without its end, and the number of lines; None if not all
/// at hand.
fn joined<'a>(rest: &mut &'a [u8], ended: bool) -> Option<(Cow<'a, [u8]>, usize)> {
    let mut joined = Cow::Borrowed(&[][..]);
    for count in 1.. {
        // A carriage return alone ends a line, too: in the files of old Macs.
        let end = rest.iter().position(|byte| is_line_end(*byte)).map_or(rest.len(), |end| end + 1);
        let end = end + usize::from(rest[..end].ends_with(b"\r") && rest[end..].starts_with(b"\n"));
        let line = rest.split_off(..end)?.trim_ascii_end();
        match line.strip_suffix(b"\\") {
            Some(begun) if !(ended && rest.is_empty()) => {
                joined.to_mut().extend(begun);
                joined.to_mut().push(b' ');
            }
            _ if count == 1 => return Some((line.into(), count)),
            _ => {
                joined.to_mut().extend(line);
                return Some((joined, count));
            }
        }
        if rest.is_empty() {
            break;
        }
    }
    None
}
