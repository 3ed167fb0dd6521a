//! STL, text and binary: stl_io reads the facets; which of both it is, and how many there can be, is decided before.

use std::io::{Cursor, ErrorKind};

use glam::Vec3;

use super::Mesh;
use super::read::{Fault, not_finite};

/// A binary file: this many bytes of anything, a count of 4 bytes, and the facets.
pub(super) const TITLE: usize = 80;
pub(super) const FACET: usize = 50;

/// So many facets have as many vertices as there are numbers for, and one more.
pub(super) const MOST_FACETS: u32 = u32::MAX / 3 - 1;

/// Whether a file of so many bytes that begins like this is binary: its title may begin like a text does.
pub(super) fn is_binary(source: &[u8], length: usize) -> bool {
    let body = length.saturating_sub(TITLE + 4);
    let fits = claimed(source).is_some_and(|claimed| claimed as usize == body / FACET && body.is_multiple_of(FACET));
    fits || !source.starts_with(b"solid")
}

/// The vertices of facets, which share none in a file: a corner that is bit by bit one that was met lately becomes the same.
/// Facets are nearly always written beside their neighbours, so that few are missed; nothing but memory is lost by one.
pub(super) struct Corners {
    pub(super) vertices: Vec<Vec3>,
    /// The last vertex of each hash.
    met: Vec<u32>,
}

impl Corners {
    const BITS: u32 = 15;

    /// None so far, and where they are to be put.
    pub(super) fn new(room: Vec<Vec3>) -> Self {
        Corners { vertices: room, met: vec![u32::MAX; 1 << Self::BITS] }
    }

    /// The number of this one's vertex.
    pub(super) fn vertex(&mut self, corner: Vec3) -> u32 {
        let bits = |vertex: Vec3| vertex.to_array().map(f32::to_bits);
        let [x, y, z] = bits(corner);
        // Odd numbers without a pattern: what differs anywhere differs in the upper bits.
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

/// Makes one solid of several: stl_io reads the first. The lines between them, at which one ends and the next begins, become
/// blank.
fn join_solids(source: &mut [u8]) {
    let is = |line: &[u8], word: &[u8]| line.split(u8::is_ascii_whitespace).find(|word| !word.is_empty()) == Some(word);
    let (mut ended, mut at) = (None, 0);
    while at < source.len() {
        let end = source[at..].iter().position(|byte| *byte == b'\n').map_or(source.len(), |end| at + end);
        let line = &source[at..end];
        if is(line, b"endsolid") {
            ended = Some(at);
        } else if !line.trim_ascii().is_empty()
            && let Some(from) = ended.take()
            && is(line, b"solid")
        {
            source[from..end].iter_mut().filter(|byte| **byte != b'\n').for_each(|byte| *byte = b' ');
        }
        at = end + 1;
    }
}

pub(super) fn parse(mut source: Vec<u8>) -> Result<Mesh, Fault> {
    let binary = is_binary(&source, source.len());
    if binary {
        let body = source.len().saturating_sub(TITLE + 4);
        let Some(claimed) = claimed(&source) else {
            let message = format!("the file has {} bytes", source.len());
            return Err(Fault::new(message).expected("the word solid at its start, or 84 bytes and more"));
        };
        if claimed as usize > body / FACET {
            let message = format!("the header claims {claimed} facets, and the file has no room for so many");
            return Err(Fault::new(message).expected(format!("at most {}: {body} bytes follow it", body / FACET)));
        }
        source[..TITLE].fill(0);
    } else {
        join_solids(&mut source);
        if source.get(5).is_none_or(|&after| after != b' ') {
            // A solid without a name; stl_io looks for the space before it.
            source.insert(5, b' ');
        }
    }

    let (mut vertices, mut triangles) = (Corners::new(Vec::new()), Vec::new());
    let mut cursor = Cursor::new(source);
    let facets = stl_io::create_stl_reader(&mut cursor).map_err(|error| Fault::new(error.to_string()))?;
    for (number, facet) in (1_u32..).zip(facets) {
        let facet = facet.map_err(|error| {
            let end = error.kind() == ErrorKind::UnexpectedEof;
            let message = if end { format!("the file ends in facet {number}") } else { format!("facet {number} cannot be understood") };
            let expected = if binary { "50 bytes" } else { "facet normal x y z, outer loop, three times vertex x y z with finite numbers, endloop, endfacet; or endsolid" };
            Fault::new(message).expected(expected)
        })?;
        if number > MOST_FACETS {
            return Err(Fault::new("the file has too many facets").expected(format!("at most {MOST_FACETS}")));
        }
        let corners = facet.vertices.map(|vertex| Vec3::from_array(vertex.0));
        if let Some(corner) = corners.iter().position(|corner| !corner.is_finite()) {
            return Err(not_finite(&format!("facet {number}'s vertex {}", corner + 1)));
        }
        triangles.push(corners.map(|corner| vertices.vertex(corner)));
    }
    Ok(Mesh { vertices: vertices.vertices, triangles, ..Mesh::default() })
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::super::shapes::{icosphere, terrain};
    use super::{Corners, parse};
    use crate::scene::MeshFormat;

    #[test]
    fn neighbours_share_their_corners() {
        for shape in [icosphere(80_000, 0.1, 1), terrain(80_000, 2)] {
            let mut file = Vec::new();
            shape.write(MeshFormat::Stl, &mut file).unwrap();
            let mesh = parse(file).unwrap();
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
