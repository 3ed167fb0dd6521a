//! PLY, text and binary: ply-rs-bw reads the header, and elements are read straight from their
//! bytes or words.

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
use usual::{Taken, Usual};

/// The mesh of a file of this length; None if that cannot be read.
pub(super) fn read(file: impl Read, length: usize) -> Option<Result<Mesh, MeshError>> {
    read_by(file, length, Usual::of)
}

/// Whether a file of this length has faces or strips, by its header; None if that cannot be read.
pub(in crate::scene) fn has_faces(file: impl Read, length: usize) -> Option<bool> {
    let mut pieces = Pieces::new(file, length);
    let checked = header_of(&mut pieces, length, Content::Points)?.ok()?;
    let kinds = checked.header.elements.values();
    Some(kinds.into_iter().any(|element| is_face(&element.name) && element.count > 0))
}

/// The vertices of a file as points.
pub(in crate::scene) struct Points {
    pub vertices: Vertices,
    /// The colour of each in linear light; none if the file has no colours.
    pub colours: Vec<Vec3>,
    /// The indices of those that are not finite, in ascending order.
    pub non_finite: Vec<usize>,
    pub notes: Vec<String>,
}

/// The vertices of a file of this length, which may have no faces; None if that cannot be read.
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
        // A read error is not an error of the content.
        Err(_) if elements.pieces.lengthen().is_none() => None,
        read => Some(read),
    }
}

/// The header of a file of this length; None if that cannot be read. What follows it is left in
/// `pieces`.
fn header_of(pieces: &mut Pieces<impl Read>, length: usize, content: Content) -> Option<Result<Checked, MeshError>> {
    pieces.fill()?;
    loop {
        match header::header(pieces.rest(), length, content) {
            Ok(checked) => {
                pieces.leave(checked.left);
                return Some(Ok(checked));
            }
            Err(fault) if pieces.ended() => return Some(Err(fault)),
            // Its end may come later.
            Err(_) => pieces.lengthen()?,
        }
    }
}

/// As [`read`]; `usual` gives the layout of an element's records if they can be taken straight from
/// their bytes.
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
        // A read error is not an error of the content.
        Err(_) if elements.pieces.lengthen().is_none() => None,
        read => Some(read),
    }
}

/// How the elements of a text stand in lines.
#[derive(Clone, Copy, PartialEq)]
enum Lines {
    /// Each has ended with a line so far, its first one or a later one.
    Unknown,
    /// Each has a line of its own, whose further numbers are not read.
    OneEach,
    /// They follow each other as if there were no lines; this is the first that ends within an
    /// element.
    None { from: usize },
}

impl Lines {
    /// How elements stand in lines, now that another one has been read, after which so many are
    /// `left`. What does not belong to an element in its line is passed over.
    ///
    /// A line with more numbers than an element has either begins the next one or has numbers that
    /// the header does not know: the latter where each of those left can have a line of its own.
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

/// What follows the header, element by element.
struct Elements<R> {
    pieces: Pieces<R>,
    encoding: Encoding,
    /// In text, the number of the current line.
    line: usize,
    /// The elements that have not been read, of those that have any numbers.
    left: usize,
    lines: Lines,
    /// The last element.
    record: Record,
    /// Gives the layout of an element's records if they can be taken straight from their bytes.
    usual: fn(&Element<'_>, Encoding) -> Option<Usual>,
}

/// An element that is being read, for errors.
#[derive(Clone, Copy)]
struct Current<'a> {
    definition: &'a ElementDef,
    fields: &'a [Field<'a>],
    /// Its number among those of its kind, from 1.
    number: usize,
}

impl<R: Read> Elements<R> {
    /// What follows this header, from its first element on.
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
            // In a binary file, where anything is a number, it is the first sign that those which
            // follow are others.
            return Err(made.first_small.filter(|_| self.encoding != Encoding::Ascii).unwrap_or(fault));
        }
        let mut rest = Vec::new();
        let _ = (&mut self.pieces).take(1 << 12).read_to_end(&mut rest);
        let is_longer = !rest.trim_ascii().is_empty();
        if is_longer || matches!(self.lines, Lines::None { .. }) {
            // The file is not as its header says: its small faces are none.
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

    /// Takes records as long as they are usual, and returns their number. `read` of the element's
    /// `count` records have been read before.
    fn take_usual(&mut self, usual: &Usual, read: usize, count: usize, made: &mut Made) -> usize {
        let mut taken = 0;
        // A read error ends the loop, and occurs again when the next record is read.
        while read + taken < count && self.pieces.fill().is_some() {
            let bytes = self.pieces.rest();
            let Taken { records, left } = usual.take(bytes, read + taken, count, made);
            self.pieces.leave(left);
            if records == 0 {
                break;
            }
            taken += records;
        }
        taken
    }

    /// Reads an element into the record.
    fn next(&mut self, current: Current<'_>) -> Result<(), MeshError> {
        loop {
            // A read error ends the element, and is found again.
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

    /// The error for a number, or for a line that has too few of them.
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

    /// With the current line, in text.
    fn at(&self, fault: MeshError) -> MeshError {
        if self.encoding == Encoding::Ascii { self.out_of_step(fault.line(self.line)) } else { fault }
    }

    /// With the line where elements and lines part, if they do: often a number is missing there.
    fn out_of_step(&self, mut fault: MeshError) -> MeshError {
        if let (Lines::None { from }, Some(expected)) = (self.lines, &mut fault.expected) {
            *expected += &format!("; line {from} does not end with an element, and numbers may be missing before");
        }
        fault
    }
}

/// The mesh, as far as it has been read.
#[derive(Default)]
struct Made {
    mesh: Mesh,
    /// The number of vertices that the header counts.
    vertices: usize,
    points: Vertices,
    /// The vertices that are not finite.
    non_finite: Vec<NonFiniteVertex>,
    /// The colours of vertices.
    tints: Vec<Vec3>,
    fans: Vec<Fan>,
    /// The corners of the current face.
    corners: Vec<u32>,
    /// Whether the current kind of elements has colours.
    is_coloured: bool,
    exceeds_one: bool,
    /// In text, the line of the current element.
    line: Option<usize>,
    /// The number of faces with less than three corners, which are left out, and the error for the
    /// first one.
    small_faces: usize,
    first_small: Option<MeshError>,
}

impl Made {
    /// Begins with a kind of elements.
    fn begin(&mut self, definition: &ElementDef) {
        self.is_coloured = colour_of(definition).is_some();
        if self.is_coloured {
            // White for the triangles of a previous kind without colours.
            self.mesh.paint_to(self.mesh.triangles.len(), Vec3::ONE);
        }
        match definition.name.as_str() {
            "vertex" => {
                // With room for the padding that faces have after their vertices.
                self.points = Vertices::in_room(room(definition.count + 1));
                self.tints = room(if self.is_coloured { definition.count } else { 0 });
            }
            "face" if self.mesh.triangles.is_empty() => self.mesh.triangles = room(definition.count),
            _ => {}
        }
    }

    /// Adds an element of this kind, if it is of any that is read.
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

    /// Adds the colour of a vertex, if vertices have any.
    fn add_tint(&mut self, colour: Vec3) {
        if self.is_coloured {
            self.tints.push(colour);
            self.exceeds_one |= colour.max_element() > 1.0;
        }
    }

    /// Gives the triangles of the last face their colour, if faces have any.
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

    /// Adds strips of triangles, separated by -1: each corner makes one with the two before it, and
    /// every other one is reversed. Those with a repeated corner only lead the strip elsewhere.
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

    /// The vertex at a corner of a face or a strip.
    fn vertex(&self, owner: &str, number: usize, corner: usize, index: i64) -> Result<u32, MeshError> {
        u32::try_from(index).ok().filter(|index| (*index as usize) < self.vertices).ok_or_else(|| {
            let has = only(self.vertices);
            let message =
                format!("{owner} {number}'s corner {corner} refers to vertex {index}, but the file has {has}");
            MeshError::new(message).expected(format!("0 to {}, counted from 0", self.vertices as i64 - 1))
        })
    }

    /// The mesh, whose faces have their own colours, or else those of their vertices; and notes on
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

/// Whether colours of 16 bits are not all black, and none exceeds the highest level of 8.
fn has_levels_of_8_bits(mesh: &Mesh) -> bool {
    let brightest = mesh.colours.iter().map(|(_, colour)| colour.max_element()).fold(0.0, f32::max);
    brightest > 0.0 && brightest <= to_linear(f64::from(u8::MAX) / f64::from(u16::MAX))
}
