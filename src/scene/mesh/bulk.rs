//! Mesh files in the layouts that nearly all have, read in bulk.
//!
//! Whatever is unusual or wrong gives nothing: then [`super::read`] has the file read from its start by the reader of its
//! format, which is careful, and has words for what is wrong.

use std::io::Read;

use glam::Vec3;
use ply_rs_bw::ply::{Encoding, Property, PropertyDef, PropertyType, ScalarType};

use super::materials::Materials;
use super::read::Fault;
use super::{Mesh, MeshFormat, obj, ply, stl};
use crate::kernels::sys::room;
use crate::scene::pieces::Pieces;

/// The mesh of a file of this length in its format's usual layout, of which only a piece at a time is in memory.
pub(super) fn read(file: impl Read, length: usize, format: MeshFormat) -> Option<Result<(Mesh, Materials), Fault>> {
    match format {
        _ if length == 0 => None,
        MeshFormat::Obj => obj::read(file, length),
        MeshFormat::Ply => Some(Ok((ply(file, length)?, Materials::default()))),
        MeshFormat::Stl => Some(Ok((stl(file, length)?, Materials::default()))),
    }
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

#[cfg(test)]
mod tests {
    use std::fs;

    use super::super::shapes::{icosphere, terrain};
    use super::{Mesh, MeshFormat, read};
    use crate::scene::pieces::{LONGEST, PIECE};

    /// What is read in bulk, which is what is read with care.
    fn in_bulk(source: impl Into<Vec<u8>>, format: MeshFormat) -> Option<Mesh> {
        let source = source.into();
        let read = read(&source[..], source.len(), format)?.ok()?;
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
        for blanks in [LONGEST / 2, 2 * PIECE] {
            let long =
                [&obj[..], b"f 1", " ".repeat(blanks).as_bytes(), b" 2 3\n", &b"# after\n".repeat(PIECE)].concat();
            assert_eq!(
                in_bulk(long, MeshFormat::Obj).map(|mesh| mesh.triangles.len()),
                Some(shape.triangles.len() + 1)
            );
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
                assert!(read(&file[..], file.len(), MeshFormat::Ply).is_none());
            }
            (0..file.len()).for_each(|length| assert!(read(&file[..length], length, MeshFormat::Ply).is_none()));
        }
    }
}
