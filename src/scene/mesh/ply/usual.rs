//! A fast reader for the record layouts that nearly all binary PLY files have, directly from the
//! bytes.
//!
//! Records that it does not take are left to the reader of single numbers, which also reports
//! errors.

use glam::Vec3;
use ply_rs_bw::ply::Encoding;

use super::Made;
use super::header::{Element, Kind, Role, Scalar};
use super::numbers::{Bytes, Numbers, Record};

/// The record layouts that the fast reader supports.
pub(super) enum Usual {
    /// Little-endian vertices without colours: the byte offsets of x, y and z, which are f32, and
    /// the length of a record.
    PlainVertices { axes: [usize; 3], bytes: usize },
    /// Other vertices without list properties.
    Vertices { fields: Vec<RecordField>, bytes: usize, is_big_endian: bool },
    /// Faces.
    Faces(FaceLayout),
}

/// The layout of faces with a single list, that of the corners: its length is one byte, each index
/// has 4 bytes.
pub(super) struct FaceLayout {
    /// The properties beside the list that are read; their offsets are counted as if the list were
    /// absent.
    fields: Vec<RecordField>,
    /// The lengths in bytes of the properties before and after the list.
    before: usize,
    after: usize,
    is_big_endian: bool,
}

/// A scalar property of a record that is read.
pub(super) struct RecordField {
    offset: usize,
    scalar: Scalar,
    role: Role,
}

/// How much the fast reader has taken of the bytes at hand.
pub(super) struct TakenRecords {
    pub records: usize,
    /// The number of bytes that remain.
    pub left: usize,
}

impl Usual {
    /// The layout of an element's records; None if it is not supported.
    pub(super) fn of(element: &Element<'_>, encoding: Encoding) -> Option<Self> {
        let is_big_endian = match encoding {
            Encoding::Ascii => return None,
            Encoding::BinaryLittleEndian => false,
            Encoding::BinaryBigEndian => true,
        };
        match element.definition.name.as_str() {
            "face" => Usual::of_faces(element, is_big_endian),
            "vertex" => Usual::of_vertices(element, is_big_endian),
            _ => None,
        }
    }

    fn of_vertices(element: &Element<'_>, is_big_endian: bool) -> Option<Self> {
        let (mut fields, mut bytes) = (Vec::new(), 0);
        for field in &element.fields {
            let Kind::Number(scalar) = field.kind else { return None };
            fields.extend(RecordField::of(bytes, scalar, field.role));
            bytes += scalar.bytes();
        }
        let mut axes = [0; 3];
        let mut is_plain = !is_big_endian;
        for field in &fields {
            match (field.role, field.scalar) {
                (Role::Axis(axis), Scalar::Float) => axes[axis] = field.offset,
                _ => is_plain = false,
            }
        }
        let plain = Usual::PlainVertices { axes, bytes };
        Some(if is_plain { plain } else { Usual::Vertices { fields, bytes, is_big_endian } })
    }

    fn of_faces(element: &Element<'_>, is_big_endian: bool) -> Option<Self> {
        let (mut fields, mut bytes, mut before) = (Vec::new(), 0, None);
        for field in &element.fields {
            match field.kind {
                Kind::Number(scalar) => {
                    fields.extend(RecordField::of(bytes, scalar, field.role));
                    bytes += scalar.bytes();
                }
                Kind::List(Scalar::UChar, Scalar::Int | Scalar::UInt)
                    if field.role == Role::Corners && before.is_none() =>
                {
                    before = Some(bytes);
                }
                Kind::List(..) => return None,
            }
        }
        let before = before?;
        Some(Usual::Faces(FaceLayout { fields, before, after: bytes - before, is_big_endian }))
    }

    /// Reads records up to the first that needs the slow reader or is incomplete in `bytes`. `read`
    /// of the element's `count` records have been read before.
    pub(super) fn take(&self, bytes: &[u8], read: usize, count: usize, made: &mut Made) -> TakenRecords {
        match self {
            Usual::PlainVertices { axes, bytes: of_one } => {
                let records = bytes.chunks_exact(*of_one).take(count - read);
                let records = records.map_while(|record| made.add_plain_vertex(record, *axes)).count();
                TakenRecords { records, left: bytes.len() - records * of_one }
            }
            Usual::Vertices { fields, bytes: of_one, is_big_endian } => {
                let records = bytes.chunks_exact(*of_one).take(count - read);
                let records = records.map_while(|record| made.add_vertex(record, fields, *is_big_endian)).count();
                TakenRecords { records, left: bytes.len() - records * of_one }
            }
            Usual::Faces(layout) => {
                let (mut records, mut rest) = (0, bytes);
                while read + records < count
                    && let Some(after) = made.add_usual_face(read + records + 1, rest, layout)
                {
                    records += 1;
                    rest = after;
                }
                TakenRecords { records, left: rest.len() }
            }
        }
    }
}

impl RecordField {
    /// The property at this offset; None if its role is not read here.
    fn of(offset: usize, scalar: Scalar, role: Role) -> Option<Self> {
        matches!(role, Role::Axis(_) | Role::Channel { .. }).then_some(RecordField { offset, scalar, role })
    }

    /// Stores the property's value from the bytes of a record, at this offset.
    #[inline]
    fn read(&self, record: &[u8], offset: usize, is_big_endian: bool, into: &mut Record) -> Option<()> {
        let number = Bytes { rest: record.get(offset..)?, is_big_endian }.number(self.scalar).ok()?;
        into.set(self.role, self.scalar, number);
        Some(())
    }
}

impl FaceLayout {
    /// The colour of a face, from the bytes before and after its list.
    fn colour(&self, before: &[u8], after: &[u8]) -> Option<Vec3> {
        let mut record = Record::default();
        for field in &self.fields {
            let (bytes, offset) = match field.offset.checked_sub(self.before) {
                None => (before, field.offset),
                Some(offset) => (after, offset),
            };
            field.read(bytes, offset, self.is_big_endian, &mut record)?;
        }
        Some(record.colour)
    }

    #[inline]
    fn index(&self, bytes: [u8; 4]) -> u32 {
        if self.is_big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
    }
}

impl Made {
    /// Adds the vertex of a record; None if it is not finite.
    #[inline]
    fn add_plain_vertex(&mut self, record: &[u8], axes: [usize; 3]) -> Option<()> {
        let mut point = Vec3::ZERO;
        for (number, offset) in point.as_mut().iter_mut().zip(axes) {
            *number = f32::from_le_bytes(*record.get(offset..)?.first_chunk()?);
        }
        if !point.is_finite() {
            return None;
        }
        self.points.push(point, || point.as_dvec3());
        Some(())
    }

    /// As [`add_plain_vertex`](Self::add_plain_vertex), for a record with other properties.
    fn add_vertex(&mut self, bytes: &[u8], fields: &[RecordField], is_big_endian: bool) -> Option<()> {
        let mut record = Record::default();
        for field in fields {
            field.read(bytes, field.offset, is_big_endian, &mut record)?;
        }
        if !record.single.is_finite() {
            return None;
        }
        self.points.push(record.single, || record.double);
        self.add_tint(record.colour);
        Some(())
    }

    /// Adds the face at the start of `bytes` and returns what follows it; None if it has fewer than
    /// three corners or a vertex index out of range.
    #[inline]
    fn add_usual_face<'a>(&mut self, number: usize, bytes: &'a [u8], layout: &FaceLayout) -> Option<&'a [u8]> {
        let (before, rest) = bytes.split_at_checked(layout.before)?;
        let (count, rest) = rest.split_first()?;
        let (corners, rest) = rest.split_at_checked(4 * usize::from(*count))?;
        let (after, rest) = rest.split_at_checked(layout.after)?;
        let colour = if self.is_coloured { layout.colour(before, after)? } else { Vec3::ONE };
        let (corners, _) = corners.as_chunks();
        if let [a, b, c] = *corners {
            let triangle = [a, b, c].map(|bytes| layout.index(bytes));
            if triangle.iter().any(|index| *index as usize >= self.vertices) {
                return None;
            }
            self.mesh.triangles.push(triangle);
        } else {
            self.corners.clear();
            self.corners.extend(corners.iter().map(|bytes| layout.index(*bytes)));
            if self.corners.len() < 3 || self.corners.iter().any(|index| *index as usize >= self.vertices) {
                return None;
            }
            self.mesh.push_face(number, &self.corners, &mut self.fans);
        }
        self.add_colour_of_face(colour);
        Some(rest)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use super::super::{read, read_by};
    use crate::scene::Rng;

    /// The properties of vertices and of faces, by their types.
    struct Layout {
        vertices: &'static [(&'static str, &'static str)],
        before: &'static [(&'static str, &'static str)],
        after: &'static [(&'static str, &'static str)],
    }

    const LAYOUTS: [Layout; 5] = [
        Layout { vertices: &[("uchar", "q"), ("float", "z"), ("float", "x"), ("float", "y")], before: &[], after: &[] },
        Layout {
            vertices: &[("double", "x"), ("float", "y"), ("double", "z"), ("short", "flags")],
            before: &[("int", "flags")],
            after: &[("double", "quality")],
        },
        Layout {
            vertices: &[
                ("float", "x"),
                ("float", "y"),
                ("float", "z"),
                ("uchar", "red"),
                ("uchar", "green"),
                ("uchar", "blue"),
                ("uchar", "alpha"),
            ],
            before: &[],
            after: &[],
        },
        Layout {
            vertices: &[("int", "x"), ("float", "y"), ("uint64", "z"), ("float", "r"), ("float", "g"), ("ushort", "b")],
            before: &[("char", "red")],
            after: &[("ushort", "flags"), ("uchar", "green"), ("double", "blue")],
        },
        Layout {
            vertices: &[("float", "x"), ("float", "y"), ("float", "z")],
            before: &[("uchar", "red"), ("uchar", "green"), ("uchar", "blue")],
            after: &[("uchar", "flags")],
        },
    ];

    impl Layout {
        /// A file of these properties.
        fn file(&self, is_big_endian: bool) -> Vec<u8> {
            let order = if is_big_endian { "big" } else { "little" };
            let lines = |properties: &[(&str, &str)]| -> String {
                properties.iter().map(|(scalar, name)| format!("property {scalar} {name}\n")).collect()
            };
            let Layout { vertices, before, after } = self;
            let mut file = format!(
                "ply\nformat binary_{order}_endian 1.0\nelement vertex 6\n{}element face 4\n{}\
                 property list uchar uint vertex_index\n{}end_header\n",
                lines(vertices),
                lines(before),
                lines(after),
            )
            .into_bytes();
            let numbers = |file: &mut Vec<u8>, properties: &[(&str, &str)], first: usize| {
                for (i, (scalar, _)) in (first..).zip(properties) {
                    let mut bytes = match *scalar {
                        "uchar" | "char" => vec![i as u8],
                        "short" | "ushort" => (i as u16).to_le_bytes().to_vec(),
                        "int" => (i as u32).to_le_bytes().to_vec(),
                        "uint64" => (i as u64).to_le_bytes().to_vec(),
                        "float" => (i as f32 / 3.0).to_le_bytes().to_vec(),
                        "double" => (i as f64 / 3.0).to_le_bytes().to_vec(),
                        other => panic!("{other}"),
                    };
                    if is_big_endian {
                        bytes.reverse();
                    }
                    file.extend(bytes);
                }
            };
            (0..6).for_each(|vertex| numbers(&mut file, vertices, vertex * vertex % 7));
            for face in [&[0_u32, 1, 2][..], &[0, 1, 3, 2], &[5, 4, 3], &[0, 1, 2, 3, 4]] {
                numbers(&mut file, before, face.len());
                file.push(face.len() as u8);
                let bytes = |corner: &u32| if is_big_endian { corner.to_be_bytes() } else { corner.to_le_bytes() };
                file.extend(face.iter().flat_map(bytes));
                numbers(&mut file, after, face.len());
            }
            file
        }
    }

    #[test]
    fn usual_records_are_read_as_others_are() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus/mesh_ply");
        let corpus = fs::read_dir(folder).unwrap().map(|entry| fs::read(entry.unwrap().path()).unwrap());
        let mut rng = Rng::new(7);
        let mut sound = 0;
        for original in corpus.chain(LAYOUTS.iter().flat_map(|layout| [false, true].map(|is_big| layout.file(is_big))))
        {
            for round in 0..200 {
                let mut source = original.clone();
                if round > 0 && !source.is_empty() {
                    let at = (rng.next_u64() % source.len() as u64) as usize;
                    match rng.next_u64() % 4 {
                        0 => source[at] = [0, 1, 3, 4, 0x7f, 0xff][(rng.next_u64() % 6) as usize],
                        1 => source[at] ^= 1 << (rng.next_u64() % 8),
                        2 => source.truncate(at),
                        _ => source.insert(at, rng.next_u64() as u8),
                    }
                }
                let usual = read(&source[..], source.len()).unwrap();
                let careful = read_by(&source[..], source.len(), |_, _| None).unwrap();
                sound += usize::from(usual.is_ok());
                assert_eq!(format!("{usual:?}"), format!("{careful:?}"), "{}", source.escape_ascii());
            }
        }
        assert!(sound > 300, "{sound} sound ones");
    }
}
