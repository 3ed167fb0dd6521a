//! STL: binary piece by piece, and text line by line.

use std::io::Read;

use glam::Vec3;

use super::fault::{goes_on, not_finite};
use super::materials::number;
use super::{Mesh, MeshError};
use crate::kernels::sys::room;

/// A binary file: a title of this many bytes, a count of 4 bytes, and the facets.
const TITLE: usize = 80;
const FACET: usize = 50;

/// Whether a file of this length and beginning is binary: its title may begin as a text does.
fn is_binary(source: &[u8], length: usize) -> bool {
    let body = length.saturating_sub(TITLE + 4);
    let fits = claimed(source).is_some_and(|claimed| claimed as usize == body / FACET && body.is_multiple_of(FACET));
    fits || !source.starts_with(b"solid")
}

/// The vertices of facets, which share none in a file: a corner equal bit by bit to a recent one becomes the same
/// vertex. Facets are nearly always written beside their neighbours: few are missed, at the cost of memory.
struct Corners {
    vertices: Vec<Vec3>,
    /// The last vertex of each hash.
    met: Vec<u32>,
}

impl Corners {
    const BITS: u32 = 15;

    /// No vertices yet, and the mesh that they are added to.
    fn new(room: Vec<Vec3>) -> Self {
        Corners { vertices: room, met: vec![u32::MAX; 1 << Self::BITS] }
    }

    /// The index of this corner's vertex.
    fn vertex(&mut self, corner: Vec3) -> u32 {
        let bits = |vertex: Vec3| vertex.to_array().map(f32::to_bits);
        let [x, y, z] = bits(corner);
        // Odd numbers without a pattern: any difference changes the upper bits.
        let mixed = x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77) ^ z.wrapping_mul(0xc2b2_ae3d);
        let met = &mut self.met[(mixed >> (u32::BITS - Self::BITS)) as usize];
        if self.vertices.get(*met as usize).is_none_or(|vertex| bits(*vertex) != [x, y, z]) {
            *met = self.vertices.len() as u32;
            self.vertices.push(corner);
        }
        *met
    }
}

/// The number of facets that a binary file claims.
fn claimed(source: &[u8]) -> Option<u32> {
    source.get(TITLE..)?.first_chunk().map(|count| u32::from_le_bytes(*count))
}

/// The mesh of a file of this length; None if that cannot be read.
pub(super) fn read(mut file: impl Read, length: usize) -> Option<Result<Mesh, MeshError>> {
    let mut source = Vec::new();
    file.by_ref().take((TITLE + 4) as u64).read_to_end(&mut source).ok()?;
    if is_binary(&source, length) {
        return binary(file, &source, length);
    }
    file.read_to_end(&mut source).ok()?;
    Some(text(source))
}

/// Reads the rest of a binary file after its head.
fn binary(mut file: impl Read, head: &[u8], length: usize) -> Option<Result<Mesh, MeshError>> {
    /// The facets of a piece, which stays in a core's caches.
    const TOGETHER: usize = 2048;
    let body = length.saturating_sub(TITLE + 4);
    let Some(claimed) = claimed(head) else {
        let fault = MeshError::new(format!("the file has {length} bytes"));
        return Some(Err(fault.expected("the word solid at its start, or 84 bytes and more")));
    };
    let (count, most) = (claimed as usize, body / FACET);
    if count > most {
        let message = format!("the header claims {claimed} facets, and the file has no room for so many");
        return Some(Err(MeshError::new(message).expected(format!("at most {most}: {body} bytes follow it"))));
    }
    // A closed mesh has half as many vertices.
    let (mut vertices, mut triangles) = (Corners::new(room(count + 1)), room(count));
    let mut piece = vec![[0; FACET]; count.min(TOGETHER)];
    for first in (0..count).step_by(TOGETHER) {
        let facets = &mut piece[..TOGETHER.min(count - first)];
        file.read_exact(facets.as_flattened_mut()).ok()?;
        for facet in facets {
            // After the normal.
            let [a, b, c] = *facet[12..48].as_chunks::<4>().0.as_chunks::<3>().0 else { return None };
            let point = |corner: [[u8; 4]; 3]| Vec3::from(corner.map(f32::from_le_bytes));
            let mut vertex = |corner| Some(point(corner)).filter(|it| it.is_finite()).map(|it| vertices.vertex(it));
            let (Some(a), Some(b), Some(c)) = (vertex(a), vertex(b), vertex(c)) else {
                let corner = [a, b, c].iter().position(|corner| !point(*corner).is_finite());
                return Some(Err(nowhere(triangles.len() + 1, corner?)));
            };
            triangles.push([a, b, c]);
        }
    }
    let notes = (count < most).then(|| goes_on("facets")).into_iter().collect();
    Some(Ok(Mesh { vertices: vertices.vertices, triangles, notes, ..Mesh::default() }))
}

fn nowhere(facet: usize, corner: usize) -> MeshError {
    not_finite(&format!("facet {facet}'s vertex {}", corner + 1))
}

/// Reads all solids as one mesh. What stands between them is passed over, unless it may be part of a facet.
fn text(mut source: Vec<u8>) -> Result<Mesh, MeshError> {
    const STEPS: &str =
        "facet normal x y z, outer loop, three times vertex x y z with finite numbers, endloop, endfacet; or endsolid";
    // Expected is: 0 a facet or the end of its solid, 1 its loop, 2 to 4 its vertices, 5 and 6 its ends, 7 a solid.
    source.make_ascii_lowercase();
    let (mut vertices, mut triangles) = (Corners::new(Vec::new()), Vec::new());
    let (mut expected, mut triangle, mut words) = (0, [0; 3], Vec::new());
    for (line, text) in (2..).zip(source.split(|byte| *byte == b'\n').skip(1)) {
        words.clear();
        words.extend(text.split(|byte| !byte.is_ascii_graphic()).filter(|word| !word.is_empty()));
        let facet = triangles.len() + 1;
        let misread = || MeshError::new(format!("facet {facet} cannot be understood")).line(line).expected(STEPS);
        expected = match (expected, &words[..]) {
            (_, []) => expected,
            (0 | 7, [b"facet", b"normal", _, _, _]) => 1,
            (1, [b"outer", b"loop"]) => 2,
            (2..=4, [b"vertex", x, y, z]) => {
                let point = (|| Some(Vec3::new(number(x)?, number(y)?, number(z)?)))().ok_or_else(misread)?;
                triangle[expected - 2] = vertices.vertex(point);
                expected + 1
            }
            (5, [b"endloop"]) => 6,
            (6, [b"endfacet"]) => {
                triangles.push(triangle);
                0
            }
            (0, [b"endsolid", ..]) => 7,
            (0 | 7, [b"solid", ..]) => 0,
            (7, [word, ..]) if *word != b"vertex" => 7,
            _ => return Err(misread()),
        };
    }
    if expected != 7 {
        return Err(MeshError::new(format!("the file ends in facet {}", triangles.len() + 1)).expected(STEPS));
    }
    Ok(Mesh { vertices: vertices.vertices, triangles, ..Mesh::default() })
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::shapes::{icosphere, terrain};
    use super::{Corners, read};
    use crate::scene::MeshFormat;

    #[test]
    fn neighbours_share_their_corners() {
        for shape in [icosphere(80_000, 0.1, 1), terrain(80_000, 2)] {
            let mut file = Vec::new();
            shape.write(MeshFormat::Stl, &mut file).unwrap();
            let mesh = read(&file[..], file.len()).unwrap().unwrap();
            assert!(mesh.triangles.iter().zip(&shape.triangles).all(|(a, b)| mesh.corners(*a) == shape.corners(*b)));
            let (found, least) = (mesh.vertices.len(), shape.vertices.len());
            assert!((least..least + least / 10).contains(&found), "{found} in place of {least}");
        }
    }

    #[test]
    fn only_what_is_the_same_bit_by_bit_is_one_vertex() {
        let mut corners = Corners::new(Vec::new());
        let points = [Vec3::ZERO, -Vec3::ZERO, Vec3::X, Vec3::ZERO, Vec3::X, -Vec3::ZERO];
        assert_eq!(points.map(|point| corners.vertex(point)), [0, 1, 2, 0, 2, 1]);
        assert_eq!(corners.vertices, points[..3]);
    }
}
