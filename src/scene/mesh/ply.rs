//! PLY, text and binary: the crate ply-rs-bw parses the header; elements are parsed here.

mod header;
mod numbers;
mod usual;

use std::io::Read;

use glam::Vec3;
use ply_rs_bw::ply::{ElementDef, Encoding, Header};

use super::colour::to_linear;
use super::fault::{NonFiniteVertex, counted, goes_on, only, small_faces};
use super::polygon::Fan;
use super::vertices::Vertices;
use super::{Mesh, MeshError};
use crate::kernels::sys::room;
use crate::scene::pieces::Pieces;
use header::{Checked, Content, Element, Field, STRIPS, colour_of, has_deep_colour, has_part_of_a_colour, is_face};
use numbers::{Bytes, Misread, Record, Stop, Words};
use usual::{TakenRecords, Usual};

/// Reads the mesh of a file of this length in bytes; None if the file cannot be read.
pub(super) fn read(file: impl Read, length: usize) -> Option<Result<Mesh, MeshError>> {
    read_by(file, length, Usual::of)
}

/// Whether a file of this length has faces or triangle strips, by its header; None if the file
/// cannot be read.
pub(in crate::scene) fn has_faces(file: impl Read, length: usize) -> Option<bool> {
    let mut pieces = Pieces::new(file, length);
    let checked = header_of(&mut pieces, length, Content::Points)?.ok()?;
    let kinds = checked.header.elements.values();
    Some(kinds.into_iter().any(|element| is_face(&element.name) && element.count > 0))
}

/// The vertices of a file, as a point cloud.
pub(in crate::scene) struct Points {
    pub vertices: Vertices,
    /// The colour of each point in linear light; empty if the file has no colours.
    pub colours: Vec<Vec3>,
    /// The indices of points that are not finite, in ascending order.
    pub non_finite: Vec<usize>,
    pub notes: Vec<String>,
}

/// Reads the vertices of a file of this length, which need not have faces; None if the file
/// cannot be read.
pub(in crate::scene) fn read_points(file: impl Read, length: usize) -> Option<Result<Points, MeshError>> {
    let mut pieces = Pieces::new(file, length);
    let checked = match header_of(&mut pieces, length, Content::Points)? {
        Ok(checked) => checked,
        Err(fault) => return Some(Err(fault)),
    };
    let mut elements = Elements::new(pieces, &checked, Usual::of);
    let made = elements.made(&checked);
    let read = made.map(|made| {
        let mut notes = made.mesh.notes;
        if !made.mesh.triangles.is_empty() || made.small_faces > 0 {
            notes.push("faces were not read: the vertices are shown as points".to_owned());
        }
        let non_finite = made.non_finite.iter().map(|vertex| vertex.index).collect();
        Points { vertices: made.points, colours: made.tints, non_finite, notes }
    });
    match read {
        // Return None if the error is due to a failed read, which then fails again.
        Err(_) if elements.pieces.lengthen().is_none() => None,
        read => Some(read),
    }
}

/// Reads the header of a file of this length; None if the file cannot be read. Leaves `pieces`
/// at the first byte after the header.
fn header_of(pieces: &mut Pieces<impl Read>, length: usize, content: Content) -> Option<Result<Checked, MeshError>> {
    pieces.fill()?;
    loop {
        match header::header(pieces.rest(), length, content) {
            Ok(checked) => {
                pieces.leave(checked.left);
                return Some(Ok(checked));
            }
            Err(fault) if pieces.ended() => return Some(Err(fault)),
            // The end of the header may follow in the next piece.
            Err(_) => pieces.lengthen()?,
        }
    }
}

/// As [`read`]. `usual` returns the layout of an element's records if the fast reader supports
/// it.
fn read_by(
    file: impl Read,
    length: usize,
    usual: fn(&Element<'_>, Encoding) -> Option<Usual>,
) -> Option<Result<Mesh, MeshError>> {
    let mut pieces = Pieces::new(file, length);
    let checked = match header_of(&mut pieces, length, Content::Mesh)? {
        Ok(checked) => checked,
        Err(fault) => return Some(Err(fault)),
    };
    let mut elements = Elements::new(pieces, &checked, usual);
    match elements.mesh(&checked) {
        // Return None if the error is due to a failed read, which then fails again.
        Err(_) if elements.pieces.lengthen().is_none() => None,
        read => Some(read),
    }
}

/// How the elements of a text file are arranged in lines.
#[derive(Clone, Copy, PartialEq)]
enum Lines {
    /// Every element so far has ended at a line end; how many lines each takes is not known.
    Unknown,
    /// Each element is on one line. Further numbers of the line are skipped.
    OneEach,
    /// Line ends are ignored, since elements end in the middle of lines; `from` is the first
    /// such line.
    None { from: usize },
}

impl Lines {
    /// The arrangement, given that another element has been read and that `left` ones remain.
    /// Under [`OneEach`](Self::OneEach) the rest of the line is skipped.
    ///
    /// A line with more numbers than an element needs either begins the next element or has
    /// numbers that the header does not declare. It is the latter if enough lines remain for one
    /// element each.
    fn after_element(self, words: &mut Words<'_>, left: usize) -> Result<Self, Stop> {
        if matches!(self, Lines::None { .. }) || !words.has_more_in_line()? {
            return Ok(self);
        }
        let mut after = words.clone();
        after.skip_line()?;
        let is_in_one_line = words.first_line == Some(words.line);
        if self == Lines::Unknown && !(is_in_one_line && after.has_lines(left)?) {
            return Ok(Lines::None { from: words.line });
        }
        *words = after;
        Ok(Lines::OneEach)
    }
}

/// The elements of a file, read one by one.
struct Elements<R> {
    pieces: Pieces<R>,
    encoding: Encoding,
    /// In a text file, the number of the current line.
    line: usize,
    /// The number of elements not read yet, not counting those without properties.
    left: usize,
    lines: Lines,
    /// The content of the element read last.
    record: Record,
    /// Returns the layout of an element's records if the fast reader supports it.
    usual: fn(&Element<'_>, Encoding) -> Option<Usual>,
}

/// The element that is being read, for errors.
#[derive(Clone, Copy)]
struct Current<'a> {
    definition: &'a ElementDef,
    fields: &'a [Field<'a>],
    /// Its number among the elements of its name, from 1.
    number: usize,
}

impl<R: Read> Elements<R> {
    /// The elements after this header, none of which has been read.
    fn new(pieces: Pieces<R>, checked: &Checked, usual: fn(&Element<'_>, Encoding) -> Option<Usual>) -> Self {
        let in_words = checked.header.elements.values().filter(|element| !element.properties.is_empty());
        let left = in_words.map(|element| element.count).sum();
        let (encoding, line) = (checked.header.encoding, checked.line);
        Elements { pieces, encoding, line, left, lines: Lines::Unknown, record: Record::default(), usual }
    }

    fn mesh(&mut self, checked: &Checked) -> Result<Mesh, MeshError> {
        self.made(checked)?.finish(&checked.header)
    }

    /// Reads all elements.
    fn made(&mut self, checked: &Checked) -> Result<Made, MeshError> {
        let header = &checked.header;
        let mut made = Made { vertices: header.elements["vertex"].count, ..Made::default() };
        if let Err(fault) = self.elements(&checked.elements(), &mut made) {
            // A small face in a binary file, where any bytes are valid numbers, is the first
            // sign that the data does not match the header: report it rather than `fault`.
            return Err(made.first_small.filter(|_| self.encoding != Encoding::Ascii).unwrap_or(fault));
        }
        let mut rest = Vec::new();
        let _ = (&mut self.pieces).take(1 << 12).read_to_end(&mut rest);
        let is_longer = !rest.trim_ascii().is_empty();
        if is_longer || matches!(self.lines, Lines::None { .. }) {
            // The data does not match the header, so small faces are errors.
            if let Some(fault) = made.first_small.take() {
                return Err(self.out_of_step(fault));
            }
        }
        made.mesh.notes.extend(is_longer.then(|| goes_on("elements")));
        made.mesh.notes.extend(match self.lines {
            Lines::Unknown => None,
            Lines::OneEach => {
                Some("lines have more numbers than the properties that the header lists: these were not read".into())
            }
            Lines::None { from } => {
                Some(format!("elements do not end with lines, from line {from} on: their numbers were read in order"))
            }
        });
        Ok(made)
    }

    fn elements(&mut self, elements: &[Element<'_>], made: &mut Made) -> Result<(), MeshError> {
        for element in elements {
            let Element { definition, fields } = element;
            made.begin(definition);
            let usual = (self.usual)(element, self.encoding);
            let mut number = 0;
            while number < definition.count {
                if let Some(usual) = &usual {
                    number += self.take_usual(usual, number, definition.count, made);
                    if number == definition.count {
                        break;
                    }
                }
                number += 1;
                self.next(Current { definition, fields, number })?;
                made.line = Some(self.line).filter(|_| self.encoding == Encoding::Ascii);
                made.add(definition, number, &self.record).map_err(|fault| self.at(fault))?;
            }
        }
        Ok(())
    }

    /// Reads records in the layout `usual` until one is unusual, and returns their number.
    /// `read` of the element's `count` records have been read before.
    fn take_usual(&mut self, usual: &Usual, read: usize, count: usize, made: &mut Made) -> usize {
        let mut taken = 0;
        // A failed read ends the loop, and fails again at the next record.
        while read + taken < count && self.pieces.fill().is_some() {
            let bytes = self.pieces.rest();
            let TakenRecords { records, left } = usual.take(bytes, read + taken, count, made);
            self.pieces.leave(left);
            if records == 0 {
                break;
            }
            taken += records;
        }
        taken
    }

    /// Reads the next element into `record`.
    fn next(&mut self, current: Current<'_>) -> Result<(), MeshError> {
        loop {
            // A failed read is reported as the end of the file; the caller tells the two apart.
            self.pieces.fill().ok_or_else(|| self.cut_off(current))?;
            let read = match self.encoding {
                Encoding::Ascii => self.next_of_text(current.fields),
                Encoding::BinaryLittleEndian => self.next_of_bytes(current.fields, false),
                Encoding::BinaryBigEndian => self.next_of_bytes(current.fields, true),
            };
            let (stop, property) = match read {
                Ok(()) => break,
                Err(why) => why,
            };
            match stop {
                Stop::End if self.pieces.ended() => return Err(self.cut_off(current)),
                Stop::End => self.pieces.lengthen().ok_or_else(|| self.cut_off(current))?,
                Stop::LineEnd => return Err(self.misread(current, property, None)),
                Stop::Misread(misread) => return Err(self.misread(current, property, Some(misread))),
            }
        }
        self.left -= usize::from(!current.fields.is_empty());
        Ok(())
    }

    fn next_of_bytes<'a>(&mut self, fields: &[Field<'a>], is_big_endian: bool) -> Result<(), (Stop, &'a str)> {
        let mut bytes = Bytes { rest: self.pieces.rest(), is_big_endian };
        self.record.read(fields, &mut bytes)?;
        let left = bytes.rest.len();
        self.pieces.leave(left);
        Ok(())
    }

    fn next_of_text<'a>(&mut self, fields: &[Field<'a>]) -> Result<(), (Stop, &'a str)> {
        if fields.is_empty() {
            return Ok(());
        }
        let mut words = Words {
            rest: self.pieces.rest(),
            ended: self.pieces.ended(),
            line: self.line,
            first_line: None,
            within_a_line: self.lines == Lines::OneEach,
        };
        let read = self.record.read(fields, &mut words).and_then(|()| {
            let lines = self.lines.after_element(&mut words, self.left - 1);
            lines.map_err(|stop| (stop, ""))
        });
        match read {
            Ok(lines) => {
                let (left, line) = (words.rest.len(), words.line);
                self.pieces.leave(left);
                self.line = line;
                self.lines = lines;
                Ok(())
            }
            Err((Stop::End, property)) => Err((Stop::End, property)),
            Err((stop, property)) => {
                self.line = words.first_line.filter(|_| matches!(stop, Stop::LineEnd)).unwrap_or(words.line);
                Err((stop, property))
            }
        }
    }

    /// The error for an invalid number, or for a line with too few numbers (`misread` is None).
    fn misread(&self, current: Current<'_>, property: &str, misread: Option<Misread>) -> MeshError {
        let Current { definition, number, .. } = current;
        let name = &definition.name;
        let (message, expected) = match misread {
            Some(Misread { found, expected }) => (format!("{name} {number}'s {property} is `{found}`"), expected),
            None => {
                let properties: Vec<_> = definition.properties.keys().map(String::as_str).collect();
                let expected = format!("its properties as the header lists them: {}", properties.join(" "));
                (format!("{name} {number} cannot be understood"), expected)
            }
        };
        self.at(MeshError::new(&message).expected(expected).of_text(&message))
    }

    fn cut_off(&self, current: Current<'_>) -> MeshError {
        let Current { definition, number, .. } = current;
        let message = format!("the file ends in {} {number}", definition.name);
        let expected = format!("{} of them, as its header says", definition.count);
        self.out_of_step(MeshError::new(message).expected(expected))
    }

    /// Adds the current line to an error, in text files.
    fn at(&self, fault: MeshError) -> MeshError {
        if self.encoding == Encoding::Ascii { self.out_of_step(fault.line(self.line)) } else { fault }
    }

    /// If elements end in the middle of lines, adds the first line where one does: often a
    /// number is missing there.
    fn out_of_step(&self, mut fault: MeshError) -> MeshError {
        if let (Lines::None { from }, Some(expected)) = (self.lines, &mut fault.expected) {
            *expected += &format!("; line {from} does not end with an element, and numbers may be missing before");
        }
        fault
    }
}

/// The mesh as far as it has been read.
#[derive(Default)]
struct Made {
    mesh: Mesh,
    /// The number of vertices according to the header.
    vertices: usize,
    points: Vertices,
    /// The vertices that are not finite.
    non_finite: Vec<NonFiniteVertex>,
    /// The colours of vertices.
    tints: Vec<Vec3>,
    fans: Vec<Fan>,
    /// The corners of the current face.
    corners: Vec<u32>,
    /// Whether elements of the current name have colours.
    is_coloured: bool,
    exceeds_one: bool,
    /// In a text file, the line of the current element.
    line: Option<usize>,
    /// The number of faces with fewer than three corners, which are left out, and the error for
    /// the first of them, which is reported if the data does not match the header.
    small_faces: usize,
    first_small: Option<MeshError>,
}

impl Made {
    /// Begins the elements of a name.
    fn begin(&mut self, definition: &ElementDef) {
        self.is_coloured = colour_of(definition).is_some();
        if self.is_coloured {
            // Earlier triangles without colours are white.
            self.mesh.paint_to(self.mesh.triangles.len(), Vec3::ONE);
        }
        match definition.name.as_str() {
            "vertex" => {
                // One more than counted: `Faces` appends a vertex of padding.
                self.points = Vertices::in_room(room(definition.count + 1));
                self.tints = room(if self.is_coloured { definition.count } else { 0 });
            }
            "face" if self.mesh.triangles.is_empty() => self.mesh.triangles = room(definition.count),
            _ => {}
        }
    }

    /// Adds an element of this definition, if its kind is read at all.
    fn add(&mut self, definition: &ElementDef, number: usize, record: &Record) -> Result<(), MeshError> {
        match definition.name.as_str() {
            "vertex" => {
                if !record.single.is_finite() {
                    self.non_finite.push(NonFiniteVertex { index: number - 1, line: self.line });
                }
                self.points.push(record.single, || record.double);
                self.add_tint(record.colour);
                return Ok(());
            }
            "face" => self.add_face(number, &record.corners)?,
            STRIPS => self.add_strips(number, &record.corners)?,
            _ => return Ok(()),
        }
        self.add_colour_of_face(record.colour);
        Ok(())
    }

    /// Adds the colour of a vertex, if vertices have colours.
    fn add_tint(&mut self, colour: Vec3) {
        if self.is_coloured {
            self.tints.push(colour);
            self.exceeds_one |= colour.max_element() > 1.0;
        }
    }

    /// Sets the colour of the triangles of the last face, if faces have colours.
    fn add_colour_of_face(&mut self, colour: Vec3) {
        if self.is_coloured {
            self.mesh.paint_to(self.mesh.triangles.len(), colour);
            self.exceeds_one |= colour.max_element() > 1.0;
        }
    }

    fn add_face(&mut self, number: usize, corners: &[i64]) -> Result<(), MeshError> {
        self.corners.clear();
        for (corner, index) in (1..).zip(corners) {
            self.corners.push(self.vertex("face", number, corner, *index)?);
        }
        if corners.len() < 3 {
            let message = format!("face {number} has {}", counted(corners.len(), "corner", "corners"));
            let fault = MeshError { line: self.line, ..MeshError::new(message).expected("at least three") };
            self.first_small.get_or_insert(fault);
            self.small_faces += 1;
            return Ok(());
        }
        self.mesh.push_face(number, &self.corners, &mut self.fans);
        Ok(())
    }

    /// Adds triangle strips, which are separated by -1. Each corner from the third on makes a
    /// triangle with the two before it, and every second triangle is reversed. Triangles with a
    /// repeated corner are left out: they only continue the strip elsewhere.
    fn add_strips(&mut self, number: usize, corners: &[i64]) -> Result<(), MeshError> {
        let mut strip = Vec::new();
        for (corner, &index) in (1..).zip(corners) {
            if index == -1 {
                strip.clear();
                continue;
            }
            strip.push(self.vertex("strip", number, corner, index)?);
            if let [.., a, b, c] = strip[..]
                && a != b
                && b != c
                && c != a
            {
                self.mesh.triangles.push(if strip.len() % 2 == 1 { [a, b, c] } else { [b, a, c] });
            }
        }
        Ok(())
    }

    /// The vertex index of a corner of a face or strip; an error if it is out of range.
    fn vertex(&self, owner: &str, number: usize, corner: usize, index: i64) -> Result<u32, MeshError> {
        u32::try_from(index).ok().filter(|index| (*index as usize) < self.vertices).ok_or_else(|| {
            let has = only(self.vertices);
            let message =
                format!("{owner} {number}'s corner {corner} refers to vertex {index}, but the file has {has}");
            MeshError::new(message).expected(format!("0 to {}, counted from 0", self.vertices as i64 - 1))
        })
    }

    /// The mesh, with the colours of its faces or else of its vertices, and with notes about
    /// what was not read.
    fn finish(mut self, header: &Header) -> Result<Mesh, MeshError> {
        match self.first_small {
            Some(fault) if self.mesh.triangles.is_empty() => return Err(fault),
            _ => {}
        }
        (self.mesh.vertices, self.mesh.origin) = self.points.finish();
        self.mesh.refuse_used(&self.non_finite)?;
        let mut mesh = self.mesh.cut(&self.fans)?;
        if mesh.colours.is_empty() && !self.tints.is_empty() {
            mesh.paint_by_vertices(&self.tints);
        } else if !mesh.colours.is_empty() {
            mesh.paint_to(mesh.triangles.len(), Vec3::ONE);
        }
        mesh.white_is_none();
        mesh.drop_vertices(&self.non_finite);
        if self.small_faces > 0 {
            mesh.notes.push(small_faces(self.small_faces));
        }
        if self.exceeds_one {
            mesh.notes.push("colours exceed 1, and are taken as they are".into());
        }
        if header.elements.values().any(has_deep_colour) && has_levels_of_8_bits(&mesh) {
            mesh.notes
                .push("colours of 16 bits do not exceed 255 of 65535: if bytes are meant, their type is uchar".into());
        }
        let has = |names: &[&str]| {
            let mut properties = header.elements.values().flat_map(|element| element.properties.keys());
            properties.any(|name| names.contains(&name.as_str()))
        };
        mesh.note_unread(&[
            ("normals", has(&["nx"])),
            ("texture coordinates", has(&["s", "u", "texture_u", "texcoord"])),
            ("transparency", has(&["alpha"])),
            ("colours of less than red, green and blue", header.elements.values().any(has_part_of_a_colour)),
        ]);
        Ok(mesh)
    }
}

/// Whether 16-bit colours are not all black and yet none exceeds 255, so that 8-bit levels are
/// meant.
fn has_levels_of_8_bits(mesh: &Mesh) -> bool {
    let brightest = mesh.colours.iter().map(|(_, colour)| colour.max_element()).fold(0.0, f32::max);
    brightest > 0.0 && brightest <= to_linear(f64::from(u8::MAX) / f64::from(u16::MAX))
}
