//! The header of a PLY file: parsed by ply-rs-bw, then checked against the file's length.

use std::slice;

use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, ElementDef, Encoding, Header, PropertyType, ScalarType, Version};

use super::super::MeshError;
use crate::scene::diagnostic::brief;
use crate::scene::log::is_line_end;

/// The name of the element that holds triangle strips.
pub(super) const STRIPS: &str = "tristrips";

/// What is wanted from a file.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Content {
    /// A mesh: the file must have faces.
    Mesh,
    /// The vertices only.
    Points,
}

/// Whether elements of this name are faces or strips.
pub(super) fn is_face(name: &str) -> bool {
    name == "face" || name == STRIPS
}

/// What a property of an element holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Role {
    /// One of x, y and z.
    Axis(usize),
    /// One of red, green and blue; `highest` stands for a full channel.
    Channel { of: usize, highest: f64 },
    /// The list of the corners of a face or strip.
    Corners,
    /// Anything else, which is skipped.
    Unread,
}

/// The type of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Scalar {
    Char,
    UChar,
    Short,
    UShort,
    Int,
    UInt,
    Int64,
    UInt64,
    Half,
    Float,
    Double,
}

/// Types that programs write but ply-rs-bw does not know: the name, the type, and the name of a
/// known type of the same size that replaces it for the crate.
const OTHERS: [(&[u8], Scalar, &[u8]); 4] = [
    (b"int64", Scalar::Int64, b"double"),
    (b"uint64", Scalar::UInt64, b"double"),
    (b"float16", Scalar::Half, b"short"),
    (b"half", Scalar::Half, b"short"),
];
/// The types that ply-rs-bw knows.
const LIBRARY_TYPES: &str =
    "char uchar short ushort int uint float double int8 uint8 int16 uint16 int32 uint32 float32 float64";

impl Scalar {
    fn of(scalar: &ScalarType) -> Self {
        match scalar {
            ScalarType::Char => Scalar::Char,
            ScalarType::UChar => Scalar::UChar,
            ScalarType::Short => Scalar::Short,
            ScalarType::UShort => Scalar::UShort,
            ScalarType::Int => Scalar::Int,
            ScalarType::UInt => Scalar::UInt,
            ScalarType::Float => Scalar::Float,
            ScalarType::Double => Scalar::Double,
        }
    }

    /// The size of the type in a binary file, in bytes.
    pub(super) fn bytes(self) -> usize {
        match self {
            Scalar::Char | Scalar::UChar => 1,
            Scalar::Short | Scalar::UShort | Scalar::Half => 2,
            Scalar::Int | Scalar::UInt | Scalar::Float => 4,
            Scalar::Int64 | Scalar::UInt64 | Scalar::Double => 8,
        }
    }
}

/// The type of a property: a number or a list.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    Number(Scalar),
    /// A list: the types of its length and of its numbers.
    List(Scalar, Scalar),
}

/// A property of an element.
pub(super) struct Field<'a> {
    pub name: &'a str,
    pub kind: Kind,
    pub role: Role,
}

/// An element of the header, with its properties as they are to be read.
pub(super) struct Element<'a> {
    pub definition: &'a ElementDef,
    pub fields: Vec<Field<'a>>,
}

/// A header whose content is supported and whose elements fit into the file.
pub(super) struct Checked {
    pub header: Header,
    /// The types that were replaced for ply-rs-bw, for each property in the order of the
    /// header.
    others: Vec<OtherTypes>,
    /// How many of the bytes at hand follow the header.
    pub left: usize,
    /// The number of the line that follows the header.
    pub line: usize,
}

/// The types of a property that were replaced for ply-rs-bw: of a list's length and of its
/// numbers, or of a single number. None where the type was not replaced.
type OtherTypes = [Option<Scalar>; 2];

/// Parses the header at the start of `source`, the bytes read so far of a file of this length.
pub(super) fn header(source: &[u8], length: usize, content: Content) -> Result<Checked, MeshError> {
    if !source.starts_with(b"ply") {
        return Err(MeshError::new("this is no PLY file").line(1).expected("the word ply in the first line"));
    }
    let (text, others, rest) = split(source);
    let line = text.iter().filter(|byte| **byte == b'\n').count() + 1;
    let header = Parser::<DefaultElement>::new().read_header(&mut Reader::new(&text[..])).map_err(|error| {
        let fault = MeshError::new("the header cannot be understood")
            .expected("lines that begin with format, comment, element, property or obj_info, and end_header at last");
        match error.line() {
            Some(line) => unknown_type(&text, line).unwrap_or(fault).line(line),
            None => MeshError::new("the header has no usable format line").expected("as in: format ascii 1.0"),
        }
    })?;
    if header.version != (Version { major: 1, minor: 0 }) {
        let message = format!("the format's version is {}", header.version);
        return Err(MeshError::new(message).expected("1.0, as in: format ascii 1.0"));
    }
    check(&header, &text, length.saturating_sub(source.len() - rest.len()), content)?;
    Ok(Checked { header, others, left: rest.len(), line })
}

impl Checked {
    /// The elements in the order of the file.
    pub(super) fn elements(&self) -> Vec<Element<'_>> {
        let mut others = self.others.iter();
        let elements = self.header.elements.values();
        elements.map(|definition| Element { definition, fields: fields(definition, &mut others) }).collect()
    }
}

/// The error for a header line that gives a property an unknown type, if this line does.
fn unknown_type(text: &[u8], line: usize) -> Option<MeshError> {
    let line = text.split(|byte| *byte == b'\n').nth(line - 1)?;
    let words: Vec<_> = line.split(|byte| *byte == b' ').map(String::from_utf8_lossy).collect();
    let types = match &words[..] {
        [first, list, count, numbers, _] if first == "property" && list == "list" => vec![count, numbers],
        [first, scalar, _] if first == "property" => vec![scalar],
        _ => return None,
    };
    let unknown = types.into_iter().find(|word| !LIBRARY_TYPES.split(' ').any(|known| known == word.as_ref()))?;
    let others = OTHERS.map(|(name, ..)| String::from_utf8_lossy(name)).join(" ");
    Some(
        MeshError::new(format!("`{}` is no type of a property", brief(unknown)))
            .expected(format!("one of {LIBRARY_TYPES} {others}")),
    )
}

/// Splits a file into its header lines, in a form that ply-rs-bw accepts, the types replaced in
/// them, and what follows the header. Lines are trimmed, non-ASCII characters in comments replaced,
/// and empty lines turned into comments.
fn split(source: &[u8]) -> (Vec<u8>, Vec<OtherTypes>, &[u8]) {
    // If the first line ends in a carriage return alone, as on the classic Mac OS, so do the
    // others.
    let first = source.iter().position(|byte| is_line_end(*byte)).unwrap_or(source.len());
    let is_of_old_mac = source[first..].starts_with(b"\r") && !source[first..].starts_with(b"\r\n");
    let line_end = if is_of_old_mac { b'\r' } else { b'\n' };
    let mut length = 0;
    let (mut text, mut others) = (Vec::new(), Vec::new());
    for line in source.split_inclusive(|byte| *byte == line_end) {
        length += line.len();
        let words = line.trim_ascii();
        let words = if words.is_empty() { b"comment" } else { words };
        let format = format_line(words);
        let words = format.as_ref().map_or(words, |line| &line[..]);
        let property = property(words);
        let words = property.as_ref().map_or(words, |(line, _)| &line[..]);
        text.extend(words.iter().map(|byte| if byte.is_ascii() { *byte } else { b'?' }));
        text.push(b'\n');
        others.extend(property.as_ref().map(|(_, others)| *others));
        if words == b"end_header" {
            break;
        }
    }
    (text, others, &source[length..])
}

/// A `format` line in a form that ply-rs-bw accepts, if its version lacks the point, as in
/// `format ascii 1`.
fn format_line(line: &[u8]) -> Option<Vec<u8>> {
    let mut words: Vec<_> = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).collect();
    match &mut words[..] {
        [b"format", _, version] if *version == b"1" => *version = b"1.0",
        _ => return None,
    }
    Some(words.join(&b' '))
}

/// A `property` line in a form that ply-rs-bw accepts, and the types that were replaced in it;
/// None if the line is not of a property.
fn property(line: &[u8]) -> Option<(Vec<u8>, OtherTypes)> {
    let mut words: Vec<_> = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).collect();
    let types = match words[..] {
        [b"property", b"list", ..] => 2..4,
        [b"property", ..] => 1..2,
        _ => return None,
    };
    let mut others = OtherTypes::default();
    for (word, other) in words.iter_mut().take(types.end).skip(types.start).zip(&mut others) {
        if let Some((_, scalar, stand_in)) = OTHERS.iter().find(|(name, ..)| word == name) {
            *other = Some(*scalar);
            *word = stand_in;
        }
    }
    Some((words.join(&b' '), others))
}

/// An error if the content is not supported, or if the `length` bytes after the header cannot
/// hold the elements.
fn check(header: &Header, text: &[u8], length: usize, content: Content) -> Result<(), MeshError> {
    let lines_of = |keyword: &[u8]| {
        let first_words = text.split(|byte| *byte == b'\n').map(|line| line.split(u8::is_ascii_whitespace).next());
        first_words.filter(|word| *word == Some(keyword)).count()
    };
    let properties: usize = header.elements.values().map(|element| element.properties.len()).sum();
    if lines_of(b"element") != header.elements.len() || lines_of(b"property") != properties {
        return Err(MeshError::new("the header names an element or a property twice").expected("a name once"));
    }
    for element in header.elements.values() {
        check_room(element, header.encoding, length)?;
    }
    check_content(header, content)
}

/// An error if `length` bytes cannot hold as many of an element as the header claims.
fn check_room(element: &ElementDef, encoding: Encoding, length: usize) -> Result<(), MeshError> {
    let ElementDef { name, count, properties } = element;
    let least: usize = match encoding {
        // At least a digit and a separator for each property.
        Encoding::Ascii => (2 * properties.len()).max(1),
        _ => properties.values().map(|property| least_bytes(&property.data_type)).sum(),
    };
    if least == 0 && *count > 0 {
        let message = format!("the header gives its {name} elements no properties");
        return Err(MeshError::new(message).expected("at least one"));
    }
    // `length + 1` because the last separator may be missing.
    let most = (length + 1).checked_div(least).unwrap_or(0);
    if *count > most {
        let message = format!("the header claims {count} {name} elements, and the file has no room for so many");
        return Err(MeshError::new(message).expected(format!("at most {most}: {length} bytes follow the header")));
    }
    Ok(())
}

/// An error if vertices lack coordinates or, in a mesh, faces lack corners.
fn check_content(header: &Header, content: Content) -> Result<(), MeshError> {
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
    if content == Content::Points {
        return Ok(());
    }
    if faces.is_empty() {
        return Err(MeshError::new("the header has no faces").expected("element face, with its number"));
    }
    for face in faces {
        let list = face.properties.iter().find(|(name, _)| is_corners(name)).map(|(_, property)| &property.data_type);
        if !matches!(list, Some(PropertyType::List(..))) {
            return Err(MeshError::new("faces have no corners").expected("property list uchar int vertex_indices"));
        }
    }
    Ok(())
}

/// The fewest bytes of a property in a binary file: of its number, or of an empty list's
/// length.
fn least_bytes(property: &PropertyType) -> usize {
    let (PropertyType::Scalar(scalar) | PropertyType::List(scalar, _)) = property;
    Scalar::of(scalar).bytes()
}

fn is_corners(property: &str) -> bool {
    property == "vertex_indices" || property == "vertex_index"
}

/// The properties of an element, in the order of the file. Takes the element's entries from
/// `others`, which is left at those of the next element.
fn fields<'a>(element: &'a ElementDef, others: &mut slice::Iter<'_, OtherTypes>) -> Vec<Field<'a>> {
    let colour = colour_of(element);
    let role = |name: &str, kind: Kind| match kind {
        Kind::Number(scalar) => {
            let axis = ["x", "y", "z"].iter().position(|axis| *axis == name);
            let channel = colour.and_then(|names| names.iter().position(|channel| *channel == name));
            match (axis, channel) {
                (Some(axis), _) if element.name == "vertex" => Role::Axis(axis),
                (_, Some(of)) => Role::Channel { of, highest: highest_level(scalar) },
                _ => Role::Unread,
            }
        }
        Kind::List(..) if is_corners(name) => Role::Corners,
        Kind::List(..) => Role::Unread,
    };
    let properties = element.properties.iter().zip(others);
    properties
        .map(|((name, property), [first, second])| {
            let kind = match &property.data_type {
                PropertyType::Scalar(scalar) => Kind::Number(first.unwrap_or(Scalar::of(scalar))),
                PropertyType::List(count, scalar) => {
                    Kind::List(first.unwrap_or(Scalar::of(count)), second.unwrap_or(Scalar::of(scalar)))
                }
            };
            Field { name, kind, role: role(name, kind) }
        })
        .collect()
}

/// The names that programs give to the channels of a colour. The first set of these that an
/// element has is its colour.
const COLOURS: [[&str; 3]; 3] =
    [["red", "green", "blue"], ["diffuse_red", "diffuse_green", "diffuse_blue"], ["r", "g", "b"]];

/// The names of an element's colour properties.
pub(super) fn colour_of(element: &ElementDef) -> Option<[&'static str; 3]> {
    let is_number = |name: &&str| {
        element.properties.get(*name).is_some_and(|property| matches!(property.data_type, PropertyType::Scalar(_)))
    };
    COLOURS.into_iter().find(|names| names.iter().all(is_number))
}

/// Whether an element has some channels of a colour but not all, or not as numbers.
pub(super) fn has_part_of_a_colour(element: &ElementDef) -> bool {
    let is_there = |name: &&str| element.properties.contains_key(*name);
    colour_of(element).is_none() && COLOURS[..2].as_flattened().iter().any(is_there)
}

/// The highest level of 16-bit colours.
const MOST_OF_16_BITS: f64 = 65535.0;

/// Whether an element's colours are 16-bit levels.
pub(super) fn has_deep_colour(element: &ElementDef) -> bool {
    let is_deep = |name: &str| element.properties[name].data_type == PropertyType::Scalar(ScalarType::UShort);
    colour_of(element).is_some_and(|names| names.iter().all(|name| is_deep(name)))
}

/// The number that stands for a full channel: 1 for floats; for integers 255, whatever their
/// size, except unsigned 16-bit ones.
fn highest_level(scalar: Scalar) -> f64 {
    match scalar {
        Scalar::Half | Scalar::Float | Scalar::Double => 1.0,
        Scalar::UShort => MOST_OF_16_BITS,
        _ => 255.0,
    }
}
