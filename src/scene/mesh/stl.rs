//! STL, text and binary: stl_io reads the facets; which of both it is, and how many there can be, is decided before.

use std::io::{Cursor, ErrorKind};

use glam::Vec3;

use super::Mesh;
use super::read::{Fault, not_finite};

/// A binary file: this many bytes of anything, a count of 4 bytes, and the facets.
pub(super) const TITLE: usize = 80;
pub(super) const FACET: usize = 50;

/// Whether a file of so many bytes that begins like this is binary: its title may begin like a text does.
pub(super) fn is_binary(source: &[u8], length: usize) -> bool {
    let body = length.saturating_sub(TITLE + 4);
    let fits = claimed(source).is_some_and(|claimed| claimed as usize == body / FACET && body.is_multiple_of(FACET));
    fits || !source.starts_with(b"solid")
}

/// The number of facets that a binary file claims.
fn claimed(source: &[u8]) -> Option<u32> {
    source.get(TITLE..)?.first_chunk().map(|count| u32::from_le_bytes(*count))
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
    } else if source.get(5).is_none_or(|&after| after != b' ') {
        // A solid without a name; stl_io looks for the space before it.
        source.insert(5, b' ');
    }

    let mut mesh = Mesh::default();
    let mut cursor = Cursor::new(source);
    let facets = stl_io::create_stl_reader(&mut cursor).map_err(|error| Fault::new(error.to_string()))?;
    for (number, facet) in (1..).zip(facets) {
        let facet = facet.map_err(|error| {
            let end = error.kind() == ErrorKind::UnexpectedEof;
            let message = if end { format!("the file ends in facet {number}") } else { format!("facet {number} cannot be understood") };
            let expected = if binary { "50 bytes" } else { "facet normal x y z, outer loop, three times vertex x y z with finite numbers, endloop, endfacet; or endsolid" };
            Fault::new(message).expected(expected)
        })?;
        let base = u32::try_from(mesh.vertices.len()).ok().filter(|base| *base < u32::MAX - 3);
        let base = base.ok_or_else(|| Fault::new("the file has too many facets").expected("at most 1431655764"))?;
        let corners = facet.vertices.map(|vertex| Vec3::from_array(vertex.0));
        if let Some(corner) = corners.iter().position(|corner| !corner.is_finite()) {
            return Err(not_finite(&format!("facet {number}'s vertex {}", corner + 1)));
        }
        mesh.vertices.extend(corners);
        mesh.triangles.push([base, base + 1, base + 2]);
    }
    Ok(mesh)
}
