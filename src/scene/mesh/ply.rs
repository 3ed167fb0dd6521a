//! PLY, text and binary: ply-rs-bw reads header and elements, after the header's counts were checked against the file.

use std::io::{BufRead, Read};

use glam::Vec3;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType, Version,
};

use super::fault::{counted, goes_on, not_finite};
use super::{Mesh, MeshError};
use crate::kernels::sys::room;
use crate::scene::pieces::Pieces;

/// The name of elements of triangle strips.
const STRIPS: &str = "tristrips";

/// The header, checked to be that of a mesh and to fit a file of this length; what follows it, and the line of that.
fn header(source: &[u8], length: usize) -> Result<(Header, &[u8], usize), MeshError> {
    if !source.starts_with(b"ply") {
        return Err(MeshError::new("this is no PLY file").line(1).expected("the word ply in the first line"));
    }
    let mut reader = Reader::new(source);
    let header = Parser::<Point>::new().read_header(&mut reader).map_err(|error| {
        let fault = MeshError::new("the header cannot be understood")
            .expected("lines that begin with format, comment, element, property or obj_info, and end_header at last");
        match error.line() {
            Some(line) => fault.line(line),
            None => MeshError::new("the header has no usable format line").expected("as in: format ascii 1.0"),
        }
    })?;
    if header.version != (Version { major: 1, minor: 0 }) {
        let message = format!("the format's version is {}", header.version);
        return Err(MeshError::new(message).expected("1.0, as in: format ascii 1.0"));
    }
    let line = reader.line();
    let payload = reader.into_inner();
    let text = &source[..source.len() - payload.len()];
    check(&header, text, length.saturating_sub(text.len()))?;
    Ok((header, payload, line))
}

/// The mesh of a file of this length; None if that cannot be read.
pub(super) fn read(file: impl Read, length: usize) -> Option<Result<Mesh, MeshError>> {
    let mut pieces = Pieces::new(file, length);
    pieces.fill()?;
    let (header, left, line) = loop {
        match header(pieces.rest(), length) {
            Ok((header, rest, line)) => break (header, rest.len(), line),
            Err(fault) if pieces.ended() => return Some(Err(fault)),
            // Its end may come later.
            Err(_) => pieces.lengthen()?,
        }
    };
    pieces.leave(left);
    let mut elements = Elements { pieces, encoding: header.encoding, line, text: String::new(), is_longer: false };
    match elements.mesh(&header) {
        // A read error is not an error of the content.
        Err(_) if elements.pieces.lengthen().is_none() => None,
        read => Some(read),
    }
}

impl<R: Read> Elements<R> {
    fn mesh(&mut self, header: &Header) -> Result<Mesh, MeshError> {
        let (mut mesh, mut fans, mut tints) = (Mesh::default(), Vec::new(), Vec::new());
        let vertices = header.elements["vertex"].count;
        let vertex = |owner: &str, number: usize, corner: usize, index: i64| {
            u32::try_from(index).ok().filter(|index| (*index as usize) < vertices).ok_or_else(|| {
                let message = format!("{owner} {number}'s corner {corner} is vertex {index}, which the file has not");
                MeshError::new(message).expected(format!("0 to {}, counted from 0", vertices as i64 - 1))
            })
        };
        for element in header.elements.values() {
            let is_coloured = colour_of(element).is_some();
            if is_coloured {
                // White for the triangles of a previous element without colours.
                mesh.paint_to(mesh.triangles.len(), Vec3::ONE);
            }
            match element.name.as_str() {
                "vertex" => {
                    // With room for the padding that faces have after their vertices.
                    mesh.vertices = room(element.count + 1);
                    tints = room(if is_coloured { element.count } else { 0 });
                    for number in 1..=element.count {
                        let Point { at: point, colour } = self.next("vertex", number, element)?;
                        if !point.is_finite() {
                            return Err(self.at(not_finite(&format!("vertex {number}"))));
                        }
                        mesh.vertices.push(point);
                        tints.extend(is_coloured.then_some(colour));
                    }
                }
                "face" => {
                    if mesh.triangles.is_empty() {
                        mesh.triangles = room(element.count);
                    }
                    let mut corners = Vec::new();
                    for number in 1..=element.count {
                        let Face { corners: indices, colour } = self.next("face", number, element)?;
                        corners.clear();
                        for (corner, index) in (1..).zip(indices) {
                            corners.push(vertex("face", number, corner, index).map_err(|fault| self.at(fault))?);
                        }
                        if corners.len() < 3 {
                            let message = format!("face {number} has {}", counted(corners.len(), "corner", "corners"));
                            return Err(self.at(MeshError::new(message).expected("at least three")));
                        }
                        mesh.push_face(number, &corners, &mut fans);
                        if is_coloured {
                            mesh.paint_to(mesh.triangles.len(), colour);
                        }
                    }
                }
                STRIPS => {
                    for number in 1..=element.count {
                        let Face { corners, colour } = self.next(STRIPS, number, element)?;
                        mesh.push_strips(&corners, |corner, index| vertex("strip", number, corner, index))
                            .map_err(|fault| self.at(fault))?;
                        if is_coloured {
                            mesh.paint_to(mesh.triangles.len(), colour);
                        }
                    }
                }
                name => {
                    for number in 1..=element.count {
                        // Skipped, whatever it is.
                        self.next::<Point>(name, number, element)?;
                    }
                }
            }
        }
        let mut rest = Vec::new();
        let _ = (&mut self.pieces).take(1 << 12).read_to_end(&mut rest);
        mesh.notes.extend((!rest.trim_ascii().is_empty()).then(|| goes_on("elements")));
        let longer = "lines have more numbers than the properties that the header lists: these were not read";
        mesh.notes.extend(self.is_longer.then(|| longer.into()));
        Ok(painted(mesh.cut(&fans)?, header, &tints))
    }
}

impl Mesh {
    /// Adds strips of triangles, separated by -1: each corner makes one with the two before it, and every other one is
    /// reversed. Those with a repeated corner only lead the strip elsewhere.
    fn push_strips(
        &mut self,
        corners: &[i64],
        vertex: impl Fn(usize, i64) -> Result<u32, MeshError>,
    ) -> Result<(), MeshError> {
        let mut strip = Vec::new();
        for (corner, &index) in (1..).zip(corners) {
            if index == -1 {
                strip.clear();
                continue;
            }
            strip.push(vertex(corner, index)?);
            if let [.., a, b, c] = strip[..]
                && a != b
                && b != c
                && c != a
            {
                self.triangles.push(if strip.len() % 2 == 1 { [a, b, c] } else { [b, a, c] });
            }
        }
        Ok(())
    }
}

/// Which of red, green and blue a property is.
fn channel_of(name: &str) -> Option<usize> {
    let name = name.strip_prefix("diffuse_").unwrap_or(name);
    ["red", "green", "blue"].iter().position(|channel| *channel == name)
}

/// The properties that are an element's colour.
fn colour_of(element: &ElementDef) -> Option<[&str; 3]> {
    use ScalarType::{Double, Float, UChar, UShort};
    let mut names = [None; 3];
    for (name, property) in &element.properties {
        if let (Some(channel), PropertyType::Scalar(UChar | UShort | Float | Double)) =
            (channel_of(name), &property.data_type)
            && names[channel].replace(name.as_str()).is_some()
        {
            return None;
        }
    }
    let [red, green, blue] = names;
    Some([red?, green?, blue?])
}

/// A channel of a colour: levels as shares of the highest one, and impossible values as the nearest possible one.
fn channel(property: &Property) -> f32 {
    let value = match *property {
        Property::UChar(level) => f32::from(level) / 255.0,
        Property::UShort(level) => f32::from(level) / 65535.0,
        Property::Float(value) => value,
        Property::Double(value) => value as f32,
        _ => 0.0,
    };
    // A NaN is impossible, too.
    if value > 0.0 { value.min(f32::MAX) } else { 0.0 }
}

/// The mesh of a file, whose faces have their own colours, or else those of their vertices if there are `tints`; and
/// notes on what was not read.
fn painted(mut mesh: Mesh, header: &Header, tints: &[Vec3]) -> Mesh {
    if mesh.colours.is_empty() && !tints.is_empty() {
        mesh.paint_by_vertices(tints);
    } else if !mesh.colours.is_empty() {
        mesh.paint_to(mesh.triangles.len(), Vec3::ONE);
    }
    mesh.white_is_none();
    let has = |names: &[&str]| {
        let mut properties = header.elements.values().flat_map(|element| element.properties.keys());
        properties.any(|name| names.contains(&name.as_str()))
    };
    mesh.note_unread(&[
        ("normals", has(&["nx"])),
        ("texture coordinates", has(&["s", "u", "texture_u", "texcoord"])),
        ("transparency", has(&["alpha"])),
    ]);
    mesh
}

/// Checks that the header is that of a mesh and that the `length` bytes after it can hold its elements.
fn check(header: &Header, text: &[u8], length: usize) -> Result<(), MeshError> {
    let begins = |word: &[u8]| text.split(|&byte| byte == b'\n').filter(|line| line.starts_with(word)).count();
    let properties: usize = header.elements.values().map(|element| element.properties.len()).sum();
    if begins(b"element ") != header.elements.len() || begins(b"property ") != properties {
        return Err(MeshError::new("the header names an element or a property twice").expected("a name once"));
    }

    for element in header.elements.values() {
        let ElementDef { name, count, properties } = element;
        let least: usize = match header.encoding {
            // A line for each element, with a digit and a separator for each property.
            Encoding::Ascii => (2 * properties.len()).max(1),
            _ => properties.values().map(|property| least_bytes(&property.data_type)).sum(),
        };
        if least == 0 && *count > 0 {
            return Err(
                MeshError::new(format!("the header gives its {name} elements no properties")).expected("at least one")
            );
        }
        // The last line may lack its end.
        let most = (length + 1).checked_div(least).unwrap_or(0);
        if *count > most {
            let message = format!("the header claims {count} {name} elements, and the file has no room for so many");
            return Err(MeshError::new(message).expected(format!("at most {most}: {length} bytes follow the header")));
        }
    }

    let Some(vertex) = header.elements.get("vertex") else {
        return Err(MeshError::new("the header has no vertices").expected("element vertex, with its number"));
    };
    if u32::try_from(vertex.count).is_err() {
        return Err(MeshError::new(format!("{} vertices are too many", vertex.count)).expected("at most 4294967295"));
    }
    for axis in ["x", "y", "z"] {
        let found = vertex.properties.get(axis).map(|property| &property.data_type);
        if !matches!(found, Some(PropertyType::Scalar(_))) {
            return Err(MeshError::new(format!("vertices have no {axis}")).expected(format!("property float {axis}")));
        }
    }
    let faces: Vec<_> = ["face", STRIPS].iter().filter_map(|name| header.elements.get(*name)).collect();
    if faces.is_empty() {
        return Err(MeshError::new("the header has no faces").expected("element face, with its number"));
    }
    for face in faces {
        let list = face.properties.iter().find(|(name, _)| is_corners(name)).map(|(_, property)| &property.data_type);
        if !matches!(list, Some(PropertyType::List(_, index)) if !matches!(index, ScalarType::Float | ScalarType::Double))
        {
            return Err(MeshError::new("faces have no corners").expected("property list uchar int vertex_indices"));
        }
    }
    Ok(())
}

/// The fewest bytes that a property takes in a binary file.
fn least_bytes(property: &PropertyType) -> usize {
    let (PropertyType::Scalar(scalar) | PropertyType::List(scalar, _)) = property;
    match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

/// Whether a line has more words than its element's properties.
fn is_longer(line: &str, element: &ElementDef) -> bool {
    let mut words = line.split_ascii_whitespace();
    for property in element.properties.values() {
        let first = words.next();
        if let (PropertyType::List(..), Some(Ok(count @ 1..))) = (&property.data_type, first.map(str::parse::<usize>)) {
            words.nth(count - 1);
        }
    }
    words.next().is_some()
}

fn is_corners(property: &str) -> bool {
    property == "vertex_indices" || property == "vertex_index"
}

/// What follows the header, element by element.
struct Elements<R> {
    pieces: Pieces<R>,
    encoding: Encoding,
    /// In text, the number of the next line.
    line: usize,
    text: String,
    /// Whether a line has more numbers than its element's properties.
    is_longer: bool,
}

impl<R: Read> Elements<R> {
    fn next<E: PropertyAccess>(&mut self, name: &str, number: usize, element: &ElementDef) -> Result<E, MeshError> {
        let parser = Parser::<E>::new();
        let read = match self.encoding {
            Encoding::Ascii => {
                self.text.clear();
                match self.pieces.read_line(&mut self.text) {
                    Ok(0) => return Err(self.cut_off(name, number, element)),
                    Ok(_) => self.line += 1,
                    Err(_) => {
                        self.line += 1;
                        return Err(self.at(MeshError::new(format!("{name} {number} is no text")).expected("numbers")));
                    }
                }
                self.is_longer |= is_longer(&self.text, element);
                parser.read_ascii_element(&self.text, element)
            }
            Encoding::BinaryLittleEndian => parser.read_little_endian_element(&mut self.pieces, element),
            Encoding::BinaryBigEndian => parser.read_big_endian_element(&mut self.pieces, element),
        };
        read.map_err(|error| self.misread(name, number, element, &error))
    }

    fn misread(&self, name: &str, number: usize, element: &ElementDef, error: &ParseError) -> MeshError {
        if error.kind() == std::io::ErrorKind::UnexpectedEof {
            return self.cut_off(name, number, element);
        }
        let number_of = |word: &str| word.parse::<f64>().ok();
        let mut numbers = self.text.split_ascii_whitespace().filter_map(number_of);
        if self.encoding == Encoding::Ascii && name == "vertex" && numbers.any(|number| !number.is_finite()) {
            return self.at(not_finite(&format!("vertex {number}")));
        }
        let properties: Vec<_> = element.properties.keys().map(String::as_str).collect();
        let expected = format!("its properties as the header lists them: {}", properties.join(" "));
        self.at(MeshError::new(format!("{name} {number} cannot be understood")).expected(expected))
    }

    fn cut_off(&self, name: &str, number: usize, element: &ElementDef) -> MeshError {
        let message = format!("the file ends in {name} {number}");
        MeshError::new(message).expected(format!("{} of them, as its header says", element.count))
    }

    /// With the line of the last element, in text.
    fn at(&self, fault: MeshError) -> MeshError {
        if self.encoding == Encoding::Ascii { fault.line(self.line - 1) } else { fault }
    }
}

/// A vertex: x, y and z of its properties, and its colour.
struct Point {
    at: Vec3,
    colour: Vec3,
}

impl PropertyAccess for Point {
    fn new() -> Self {
        Point { at: Vec3::ZERO, colour: Vec3::ONE }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if let Some(axis) = ["x", "y", "z"].iter().position(|axis| *axis == name) {
            self.at[axis] = property.to_f32_lossy().unwrap_or_default();
        } else if let Some(of) = channel_of(name) {
            self.colour[of] = channel(&property);
        } else {
            return PropertyAccessResult::Ignored;
        }
        PropertyAccessResult::Set
    }
}

/// A face: the corners and the colour of its properties.
struct Face {
    corners: Vec<i64>,
    colour: Vec3,
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Face { corners: Vec::new(), colour: Vec3::ONE }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if let Some(of) = channel_of(name) {
            self.colour[of] = channel(&property);
            return PropertyAccessResult::Set;
        }
        if !is_corners(name) {
            return PropertyAccessResult::Ignored;
        }
        self.corners = match property {
            Property::ListChar(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUChar(list) => list.into_iter().map(i64::from).collect(),
            Property::ListShort(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUShort(list) => list.into_iter().map(i64::from).collect(),
            Property::ListInt(list) => list.into_iter().map(i64::from).collect(),
            Property::ListUInt(list) => list.into_iter().map(i64::from).collect(),
            _ => return PropertyAccessResult::Ignored,
        };
        PropertyAccessResult::Set
    }
}
