//! Mesh files in the layouts that nearly all have, read in bulk.
//!
//! Whatever is unusual or wrong gives nothing: then [`super::read`] has the file read from its start by the reader of its
//! format, which is careful, and has words for what is wrong.

use std::io::Read;

use glam::Vec3;
use ply_rs_bw::ply::{Encoding, Property, PropertyDef, PropertyType, ScalarType};

use super::materials::{Materials, colour};
use super::{Mesh, MeshFormat, obj, ply, stl};
use crate::kernels::sys::room;
use crate::scene::number::{number, whole};
use crate::scene::pieces::Pieces;

/// The mesh of a file of this length in its format's usual layout, of which only a piece at a time is in memory.
pub(super) fn read(file: impl Read, length: usize, format: MeshFormat) -> Option<(Mesh, Materials)> {
    let read = match format {
        MeshFormat::Obj => obj(file, length)?,
        MeshFormat::Ply => (ply(file, length)?, Materials::default()),
        MeshFormat::Stl => (stl(file, length)?, Materials::default()),
    };
    (!read.0.triangles.is_empty()).then_some(read)
}

/// The point of three coordinates, if it is finite.
fn point(x: &[u8; 4], y: &[u8; 4], z: &[u8; 4]) -> Option<Vec3> {
    Some(Vec3::from([x, y, z].map(|bytes| f32::from_le_bytes(*bytes)))).filter(|point| point.is_finite())
}

/// Binary STL, piece by piece.
fn stl(mut file: impl Read, length: usize) -> Option<Mesh> {
    /// Facets of a piece, which stays in a core's caches.
    const TOGETHER: usize = 2048;
    let mut header = [0; stl::TITLE + 4];
    file.read_exact(&mut header).ok()?;
    let claimed = u32::from_le_bytes(*header.last_chunk()?);
    let (count, most) = (claimed as usize, length.checked_sub(header.len())? / stl::FACET);
    if count > most || claimed > stl::MOST_FACETS || !stl::is_binary(&header, length) {
        return None;
    }
    // A closed mesh has half as many vertices.
    let mut vertices = stl::Corners::new(room(count + 1));
    let mut triangles = room(count);
    let mut piece = vec![[0; stl::FACET]; count.min(TOGETHER)];
    for first in (0..count).step_by(TOGETHER) {
        let facets = &mut piece[..TOGETHER.min(count - first)];
        file.read_exact(facets.as_flattened_mut()).ok()?;
        for facet in facets {
            // After the normal.
            let [a, b, c] = *facet[12..48].as_chunks::<4>().0.as_chunks::<3>().0 else { return None };
            let mut vertex = |[x, y, z]: [[u8; 4]; 3]| Some(vertices.vertex(point(&x, &y, &z)?));
            triangles.push([vertex(a)?, vertex(b)?, vertex(c)?]);
        }
    }
    Some(Mesh { vertices: vertices.vertices, triangles, ..Mesh::default() })
}

/// Binary little-endian PLY of vertices, whose properties are numbers, and then faces, which have corners, and numbers after them.
fn ply(file: impl Read, length: usize) -> Option<Mesh> {
    let mut pieces = Pieces::new(file, length);
    pieces.fill(&[])?;
    let (header, rest, _) = ply::header(pieces.rest(), length).ok()?;
    let left = rest.len();
    pieces.leave(left);
    let [vertex, face] = header.elements.values().collect::<Vec<_>>()[..] else { return None };
    let mut of_face = face.properties.values().map(|property| &property.data_type);
    let corners_first =
        matches!(of_face.next(), Some(PropertyType::List(ScalarType::UChar, ScalarType::Int | ScalarType::UInt)));
    if header.encoding != Encoding::BinaryLittleEndian
        || vertex.name != "vertex"
        || face.name != "face"
        || !corners_first
    {
        return None;
    }
    let of_face = Numbers::of(face.properties.iter().skip(1))?;
    let of_vertex = Numbers::of(vertex.properties.iter())?;
    let size = of_vertex.size;
    let [x, y, z] = of_vertex.places(["x", "y", "z"])?;
    if [x, y, z].iter().any(|(_, of)| **of != ScalarType::Float) {
        return None;
    }
    let [(x, _), (y, _), (z, _)] = [x, y, z];
    let tint = ply::colour_of(vertex).and_then(|names| of_vertex.places(names));
    let paint = ply::colour_of(face).and_then(|names| of_face.places(names));

    // With the one that faces have behind them.
    let mut mesh = Mesh { vertices: room(vertex.count + 1), triangles: room(face.count), ..Mesh::default() };
    let mut tints = room(if tint.is_some() { vertex.count } else { 0 });
    while mesh.vertices.len() < vertex.count {
        pieces.fill(&[])?;
        let rest = pieces.rest();
        let here = (rest.len() / size).min(vertex.count - mesh.vertices.len());
        if here == 0 {
            return None;
        }
        let (points, rest) = rest.split_at(here * size);
        for bytes in points.chunks_exact(size) {
            let [x, y, z] = [x, y, z].map(|at| bytes[at..].first_chunk());
            mesh.vertices.push(point(x?, y?, z?)?);
        }
        if let Some(tint) = tint {
            for bytes in points.chunks_exact(size) {
                tints.push(channels(bytes, tint)?);
            }
        }
        let left = rest.len();
        pieces.leave(left);
    }
    /// The most bytes of a face.
    const MOST: usize = 1 + 4 * 255;
    // A negative index is beyond it, too.
    let end = u32::try_from(vertex.count).ok()?.min(1 << 31);
    let index = |bytes: &[u8; 4]| Some(u32::from_le_bytes(*bytes)).filter(|index| *index < end);
    let (mut fans, mut corners, mut number) = (Vec::new(), Vec::new(), 0);
    while number < face.count {
        pieces.fill(&[])?;
        let mut rest = pieces.rest();
        while number < face.count && (rest.len() >= MOST || pieces.ended()) {
            number += 1;
            let corners_of = usize::from(*rest.split_off_first()?);
            let indices = rest.split_off(..4 * corners_of)?.as_chunks().0;
            if let [a, b, c] = indices {
                mesh.triangles.push([index(a)?, index(b)?, index(c)?]);
            } else if corners_of > 3 {
                corners.clear();
                for bytes in indices {
                    corners.push(index(bytes)?);
                }
                mesh.push_face(number, &corners, &mut fans);
            } else {
                return None;
            }
            if of_face.size > 0 {
                let numbers = rest.split_off(..of_face.size)?;
                if let Some(paint) = paint {
                    mesh.paint_to(mesh.triangles.len(), channels(numbers, paint)?);
                }
            }
        }
        let left = rest.len();
        pieces.leave(left);
    }
    Some(ply::painted(mesh.cut(&fans).ok()?, &header, &tints))
}

/// Where a number is among the bytes of its element, and of what type it is.
type Place<'a> = (usize, &'a ScalarType);

/// The numbers of an element one after another, where each is among its bytes, and how many bytes these are.
struct Numbers<'a> {
    of: Vec<(&'a str, Place<'a>)>,
    size: usize,
}

impl<'a> Numbers<'a> {
    /// Nothing, where there are lists among them.
    fn of(properties: impl Iterator<Item = (&'a String, &'a PropertyDef)>) -> Option<Self> {
        let mut numbers = Numbers { of: Vec::new(), size: 0 };
        for (name, property) in properties {
            let PropertyType::Scalar(scalar) = &property.data_type else { return None };
            numbers.of.push((name, (numbers.size, scalar)));
            numbers.size += ply::least_bytes(&property.data_type);
        }
        Some(numbers)
    }

    fn places(&self, names: [&str; 3]) -> Option<[Place<'a>; 3]> {
        let [a, b, c] = names.map(|name| self.of.iter().find(|(of, _)| *of == name).map(|(_, place)| *place));
        Some([a?, b?, c?])
    }
}

/// The colour whose channels are at these places.
fn channels(bytes: &[u8], places: [Place<'_>; 3]) -> Option<Vec3> {
    let [r, g, b] = places.map(|(at, of)| {
        let property = match of {
            ScalarType::UChar => Property::UChar(bytes[at]),
            ScalarType::Float => Property::Float(f32::from_le_bytes(*bytes[at..].first_chunk()?)),
            _ => return None,
        };
        Some(ply::channel(&property))
    });
    Some(Vec3::new(r?, g?, b?))
}

/// OBJ without lines that go on in the next one or are very long, and vertices without weights.
fn obj(file: impl Read, length: usize) -> Option<(Mesh, Materials)> {
    let mut pieces = Pieces::new(file, length);
    // "v 0 0 0" and "f 1 2 3" are the shortest lines.
    let most = length / 8 + 1;
    let (mut points, mut mesh) = (room(most), Mesh { triangles: room(most), ..Mesh::default() });
    let (mut fans, mut corners, mut faces) = (Vec::new(), Vec::new(), 0);
    let (mut tints, mut materials, mut unread) = (Vec::new(), Materials::default(), obj::Unread::default());
    while !pieces.ended() {
        pieces.fill(&[])?;
        let text = pieces.rest();
        let end = if pieces.ended() { text.len() } else { text.iter().rposition(|byte| *byte == b'\n')? + 1 };
        let left = text.len() - end;
        let mut rest = text[..end].trim_ascii_start();
        while let [kind, after @ ..] = rest {
            let whole_word = after.first().is_none_or(u8::is_ascii_whitespace);
            match kind {
                b'v' if whole_word => {
                    rest = after;
                    let mut coordinate = || word(&mut rest, number);
                    points.push(Vec3::new(coordinate()?, coordinate()?, coordinate()?));
                    let more = line(&mut rest)?;
                    if !more.is_empty() {
                        // One number is a weight.
                        if more.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty()).count() == 1 {
                            return None;
                        }
                        if let Some(colour) = colour(more) {
                            tints.resize(points.len() - 1, Vec3::ONE);
                            tints.push(colour);
                        }
                    }
                }
                b'f' if whole_word => {
                    rest = after;
                    corners.clear();
                    while !blanks(rest).first().is_none_or(|byte| matches!(byte, b'\r' | b'\n')) {
                        corners.push(word(&mut rest, |text| corner(text, points.len() as u32))?);
                    }
                    if !line(&mut rest)?.trim_ascii().is_empty() {
                        return None;
                    }
                    faces += 1;
                    match corners[..] {
                        [a, b, c] => mesh.triangles.push([a, b, c]),
                        [_, _, _, ..] => mesh.push_face(faces, &corners, &mut fans),
                        _ => return None,
                    }
                }
                _ => {
                    let line = line(&mut rest)?;
                    unread.line(line);
                    materials.line(line, mesh.triangles.len());
                }
            }
            rest = rest.trim_ascii_start();
        }
        pieces.leave(left);
    }

    // Vertices in the order in which faces name them, as tobj has them.
    const NOWHERE: u32 = u32::MAX;
    let mut places = vec![NOWHERE; points.len()];
    mesh.vertices = room(points.len() + 1);
    let mut of_vertices = Vec::new();
    for index in mesh.triangles.as_flattened_mut() {
        let place = places.get_mut(*index as usize)?;
        if *place == NOWHERE {
            *place = mesh.vertices.len() as u32;
            mesh.vertices.push(points[*index as usize]);
            if !tints.is_empty() {
                of_vertices.push(tints.get(*index as usize).copied().unwrap_or(Vec3::ONE));
            }
        }
        *index = *place;
    }
    let mut mesh = mesh.cut(&fans).ok()?;
    if !tints.is_empty() {
        mesh.paint_by_vertices(&of_vertices);
    }
    unread.tell(&mut mesh);
    Some((mesh, materials))
}

/// Takes the next word of the line, which is all that `read` takes.
fn word<'a, T>(rest: &mut &'a [u8], read: impl FnOnce(&'a [u8]) -> Option<(T, &'a [u8])>) -> Option<T> {
    let (value, after) = read(blanks(rest))?;
    *rest = after;
    after.first().is_none_or(u8::is_ascii_whitespace).then_some(value)
}

/// What follows blanks.
fn blanks(text: &[u8]) -> &[u8] {
    let mut text = text;
    while let [b' ' | b'\t', after @ ..] = text {
        text = after;
    }
    text
}

/// Takes what is left of the line; nothing if it goes on in the next one.
fn line<'a>(rest: &mut &'a [u8]) -> Option<&'a [u8]> {
    let end = rest.iter().position(|byte| *byte == b'\n').map_or(rest.len(), |end| end + 1);
    let line = rest.split_off(..end)?.trim_ascii_end();
    (!line.ends_with(b"\\")).then_some(line)
}

/// A corner of a face, as the place of its vertex from 0, and what follows it; `vertices` there are so far.
fn corner(text: &[u8], vertices: u32) -> Option<(u32, &[u8])> {
    let (back, text) = text.strip_prefix(b"-").map_or((false, text), |text| (true, text));
    let (number, mut rest) = whole(text)?;
    let before = number.checked_sub(1)?;
    // The numbers of a texture and a normal, which may be left out.
    for _ in 0..2 {
        if let [b'/', text @ ..] = rest {
            let number = text.strip_prefix(b"-").unwrap_or(text);
            let left_out = text.first().is_none_or(|byte| *byte == b'/' || byte.is_ascii_whitespace());
            rest = if left_out { text } else { whole(number)?.1 };
        }
    }
    Some((if back { vertices.checked_sub(number)? } else { before }, rest))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::shapes::{icosphere, terrain};
    use super::{Mesh, MeshFormat, read};
    use crate::scene::pieces::{LONGEST, PIECE};

    /// What is read in bulk, which is what is read with care.
    fn in_bulk(source: impl Into<Vec<u8>>, format: MeshFormat) -> Option<Mesh> {
        let source = source.into();
        let read = read(&source[..], source.len(), format)?;
        let with_care = Mesh::parse_with_care(source, format).unwrap();
        // Debug tells -0 from 0.
        assert_eq!(format!("{read:?}"), format!("{with_care:?}"));
        Some(read.0)
    }

    #[test]
    fn what_is_written_is_read_in_bulk() {
        for shape in [icosphere(3000, 0.1, 1), terrain(3000, 2)] {
            for &(_, format) in MeshFormat::EXTENSIONS {
                let mut file = Vec::new();
                shape.write(format, &mut file).unwrap();
                let mesh = in_bulk(file, format).unwrap();
                let soup = |mesh: &Mesh| mesh.triangles.iter().map(|&it| mesh.corners(it)).collect::<Vec<_>>();
                assert_eq!(soup(&mesh), soup(&shape));
            }
        }
    }

    #[test]
    fn a_mesh_of_many_pieces_is_read_in_bulk_wherever_these_end() {
        let shape = terrain(20_000, 2);
        let [obj, ply] = [MeshFormat::Obj, MeshFormat::Ply].map(|format| {
            let mut file = Vec::new();
            shape.write(format, &mut file).unwrap();
            file
        });
        assert!(ply.len() > 2 * PIECE && obj.len() > 2 * PIECE);
        for more in 0..16 {
            let comment = "c".repeat(more);
            let obj = [format!("# {comment}\n").as_bytes(), &obj].concat();
            assert_eq!(in_bulk(obj, MeshFormat::Obj).map(|mesh| mesh.triangles.len()), Some(shape.triangles.len()));
            let header = format!("ply\nformat binary_little_endian 1.0\ncomment {comment}\n");
            let after = ply.iter().enumerate().filter(|(_, byte)| **byte == b'\n').nth(1).unwrap().0 + 1;
            let ply = [header.as_bytes(), &ply[after..]].concat();
            assert!(in_bulk(ply, MeshFormat::Ply).is_some_and(|mesh| mesh == shape));
        }
        // A line that may be longer than what is at hand.
        for (blanks, bulk) in [(LONGEST / 2, true), (2 * PIECE, false)] {
            let long =
                [&obj[..], b"f 1", " ".repeat(blanks).as_bytes(), b" 2 3\n", &b"# after\n".repeat(PIECE)].concat();
            assert_eq!(in_bulk(long, MeshFormat::Obj).is_some(), bulk);
        }
    }

    #[test]
    fn the_meshes_of_the_project_are_read_in_bulk() {
        for name in ["hills", "ring", "rock"] {
            let file = fs::read(format!("{}/scenes/meshes/{name}.ply", env!("CARGO_MANIFEST_DIR"))).unwrap();
            assert!(in_bulk(file, MeshFormat::Ply).is_some(), "{name}");
        }
    }

    #[test]
    fn an_obj_file_as_programs_write_it_is_read_in_bulk() {
        const VERTICES: &str = "v 0 0 -0\nv  1.5e+00 .25 0\n  v 1 1. 7e-41 \r\nv\t0 1 0.30000000000000004 1 0.5 0\n";
        for (faces, bulk) in [
            ("f 1 2 3", true),
            ("f 1/1 2/2 3/1\nf 1//1 2//2 4//3\nf 1/1/1 2/1/2 1/2/1", true),
            ("f 1/ 2/-7 3//-8 \t 4/0/0\t\r\n\r\n", true),
            ("f -1 -2 -3 -4\nf 4 3 2 1", true),
            ("f 1 4 5\nv 9 9 9\nv 8 8 8", true),
            ("# \u{e9}\nmtllib a b.mtl\nvt 0 0\nvn 0 0 1\nvp 1\no x\nusemtl y\ns off\nl 1 2\nfo\nf 3 2 1", true),
            // What goes on in the next line, weights, blanks of other kinds.
            ("f 1 2 \\\n3", false),
            ("# \\\nf 1 2 3\nf 1 2 3", false),
            ("v 1 2 3 4\nf 1 2 3", false),
            ("f 1 2 3\r4", false),
            ("f 1\x0b2 3 4", false),
            ("f\x0c1 2 3", false),
            // What is wrong.
            ("f 1 2", false),
            ("f 1 2 5", false),
            ("f 1 2 0", false),
            ("f 1 2 -0", false),
            ("f 1 2 -5", false),
            ("f 1 2 3/x", false),
            ("f 1 2 3/1/2/3", false),
            ("f 1 2 +3", false),
            ("v 1 2 1e39\nf 1 2 3", false),
            ("v 1 2\n3\nf 1 2 3", false),
            ("v 1 2 3x\nf 1 2 3", false),
            ("v\nf 1 2 3", false),
            ("", false),
        ] {
            let source = [VERTICES.as_bytes(), faces.as_bytes()].concat();
            assert_eq!(in_bulk(source, MeshFormat::Obj).is_some(), bulk, "{faces:?}");
        }
    }

    #[test]
    fn a_ply_file_as_programs_write_it_is_read_in_bulk() {
        const LITTLE: &str = "binary_little_endian";
        const POINT: &str = "property float x\nproperty float y\nproperty float z\n";
        const CORNERS: &str = "property list uchar int vertex_indices\n";
        for (format, vertex, length, face, bulk) in [
            (LITTLE, POINT, 12, CORNERS, true),
            (LITTLE, POINT, 12, "property list uint8 uint32 vertex_index\n", true),
            (LITTLE, &format!("property double nx\nproperty uchar red\n{POINT}property short s\n"), 23, CORNERS, true),
            ("binary_big_endian", POINT, 12, CORNERS, false),
            ("ascii", POINT, 12, CORNERS, false),
            (LITTLE, &POINT.replace("float", "double"), 24, CORNERS, false),
            (LITTLE, &format!("property list uchar int of\n{POINT}"), 13, CORNERS, false),
            (LITTLE, POINT, 12, "property list uchar ushort vertex_indices\n", false),
            (LITTLE, POINT, 12, &format!("{CORNERS}property uchar red\n"), false),
            (LITTLE, POINT, 12, &format!("{CORNERS}element edge 0\nproperty int a\n"), false),
        ] {
            let header =
                format!("ply\nformat {format} 1.0\nelement vertex 4\n{vertex}element face 2\n{face}end_header\n");
            let corners = |of: &[u32]| of.iter().flat_map(|corner| corner.to_le_bytes()).collect::<Vec<_>>();
            let faces = [&[3], &corners(&[3, 1, 0])[..], &[4], &corners(&[0, 1, 2, 3])].concat();
            // Whatever the properties of a vertex, zeros are numbers.
            let file = [header.as_bytes(), &vec![0; 4 * length], &faces].concat();
            assert_eq!(read(&file[..], file.len(), MeshFormat::Ply).is_some(), bulk, "{header}");
            if !bulk {
                continue;
            }
            let mesh = in_bulk(&file[..], MeshFormat::Ply).unwrap();
            assert_eq!((mesh.triangles.len(), mesh.polygons), (3, 1));
            // An index beyond the vertices and one below 0, a face of two corners, a point that is nowhere.
            let end = header.len() + 4 * length;
            for (wrong, byte) in
                [(end + 1..end + 2, 4), (end + 4..end + 5, 0x80), (end..end + 1, 2), (header.len()..end, 0xff)]
            {
                let mut file = file.clone();
                file[wrong].fill(byte);
                assert_eq!(read(&file[..], file.len(), MeshFormat::Ply), None);
            }
            (0..file.len()).for_each(|length| assert_eq!(read(&file[..length], length, MeshFormat::Ply), None));
        }
    }
}
