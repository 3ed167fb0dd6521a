//! STL: binary files read piece by piece, text files line by line.

use std::io::Read;

use glam::{DVec3, Vec3};

use super::fault::{counted, goes_on, not_finite};
use super::number::Number;
use super::polygon::Fan;
use super::vertices::Vertices;
use super::{Mesh, MeshError};
use crate::kernels::sys::room;
use crate::scene::diagnostic::brief;
use crate::scene::log::is_line_end;

/// The layout of a binary file: a title of `TITLE` bytes, a count of 4 bytes, and the facets of
/// `FACET` bytes each.
const TITLE: usize = 80;
const FACET: usize = 50;

/// How many bytes from the start of a file decide whether it is text.
const BEGINNING: usize = 1 << 10;

/// Whether an STL file is text or binary, as its beginning and its length tell.
#[derive(Debug, PartialEq)]
enum Kind {
    Text,
    Binary,
    Neither,
}

/// The kind of a file with this length and beginning. A text begins with `solid` in upper or lower
/// case. But so may the title of a binary file, which may also be longer than its count of facets
/// implies.
fn kind(beginning: &[u8], length: usize) -> Kind {
    let body = length.saturating_sub(TITLE + 4);
    if claimed(beginning).is_some_and(|claimed| claimed as usize == body / FACET && body.is_multiple_of(FACET)) {
        return Kind::Binary;
    }
    let mut lines = beginning.split(|byte| is_line_end(*byte)).map(first_word).filter(|word| !word.is_empty());
    let first = lines.next().unwrap_or_default();
    let is_keyword = |word: &[u8]| KEYWORDS.iter().any(|keyword| word.eq_ignore_ascii_case(keyword));
    // Text has no control characters besides white space. Bytes of non-ASCII encodings are none.
    let is_plain = !beginning.iter().any(|byte| byte.is_ascii_control() && !byte.is_ascii_whitespace());
    let is_solid = first.get(..5).is_some_and(|start| start.eq_ignore_ascii_case(b"solid"));
    // If four bytes of a text are taken for the count, it is far more than the file has room for.
    let has_room = claimed(beginning).is_some_and(|claimed| claimed as usize <= body / FACET);
    let is_text = if is_plain {
        is_solid || is_keyword(first) || lines.any(is_keyword)
    } else {
        is_solid && !has_room && lines.next().is_some_and(is_keyword)
    };
    if is_text {
        Kind::Text
    } else if is_plain && length >= TITLE + 4 {
        Kind::Neither
    } else {
        Kind::Binary
    }
}

/// Words that lines of a text file begin with.
const KEYWORDS: [&[u8]; 3] = [b"solid", b"facet", b"endsolid"];

/// The first word of a line; any non-ASCII bytes, such as a byte order mark, count as separators.
fn first_word(line: &[u8]) -> &[u8] {
    line.split(|byte| !byte.is_ascii_graphic()).find(|word| !word.is_empty()).unwrap_or_default()
}

/// Merges the corners of facets into shared vertices, which STL lacks: a corner whose bits equal
/// those of a recent corner becomes the same vertex. "Recent" means the last with its hash, so that
/// the table is small. Facets are nearly always written beside their neighbours, so that few equal
/// corners are missed; each of these only costs the memory of a vertex.
struct Corners {
    vertices: Vertices,
    /// The last vertex of each hash value.
    met: Vec<Met>,
}

/// An entry of the hash table. It holds the coordinates too, since looking them up among all
/// vertices would mostly miss the cache.
#[derive(Clone, Copy)]
struct Met {
    /// The bits of the vertex's coordinates.
    bits: [u32; 3],
    index: u32,
}

impl Met {
    /// An empty entry: its bits are NaNs, which no vertex has.
    const NONE: Met = Met { bits: [u32::MAX; 3], index: u32::MAX };
}

impl Corners {
    const BITS: u32 = 15;

    /// No corners yet; vertices are stored in `room`.
    fn new(room: Vec<Vec3>) -> Self {
        Corners { vertices: Vertices::in_room(room), met: vec![Met::NONE; 1 << Self::BITS] }
    }

    /// The index of a corner's vertex, which is added if it is new. Its finite coordinates are
    /// given rounded to f32 and to f64.
    #[inline]
    fn vertex(&mut self, single: Vec3, double: impl FnOnce() -> DVec3 + Copy) -> u32 {
        let bits = single.to_array().map(f32::to_bits);
        let [x, y, z] = bits;
        // Multiplication by odd constants without a regular bit pattern makes each coordinate
        // affect the upper bits.
        let mixed = x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77) ^ z.wrapping_mul(0xc2b2_ae3d);
        let met = &mut self.met[(mixed >> (u32::BITS - Self::BITS)) as usize];
        let is_met = met.bits == bits && self.vertices.is_exactly(met.index, single, double);
        if !is_met {
            *met = Met { bits, index: self.vertices.len() as u32 };
            self.vertices.push(single, double);
        }
        met.index
    }

    /// The index of the vertex whose coordinates are three words of a text file. None if a word is
    /// not a finite number.
    fn vertex_of_words(&mut self, words: [&[u8]; 3]) -> Option<u32> {
        let [x, y, z] = words.map(Number::of_word);
        let (x, y, z) = (x?, y?, z?);
        let single = Vec3::new(x.single, y.single, z.single);
        single.is_finite().then(|| self.vertex(single, || DVec3::new(x.double, y.double, z.double)))
    }
}

/// The number of facets that a binary file's header claims.
fn claimed(source: &[u8]) -> Option<u32> {
    source.get(TITLE..)?.first_chunk().map(|count| u32::from_le_bytes(*count))
}

/// Reads the mesh of a file of this length; None if the file cannot be read.
pub(super) fn read(mut file: impl Read, length: usize) -> Option<Result<Mesh, MeshError>> {
    let mut beginning = Vec::new();
    file.by_ref().take(BEGINNING as u64).read_to_end(&mut beginning).ok()?;
    match kind(&beginning, length) {
        Kind::Binary => binary(beginning.as_slice().chain(file), length),
        Kind::Text => {
            file.read_to_end(&mut beginning).ok()?;
            Some(text(beginning))
        }
        Kind::Neither => {
            let line = beginning.split(|byte| is_line_end(*byte)).find(|line| !line.trim_ascii().is_empty());
            let line = brief(&String::from_utf8_lossy(line.unwrap_or_default().trim_ascii()));
            let message = format!("this is no STL file: it is a text that begins with `{line}`");
            Some(Err(MeshError::new(message).expected("the word solid at the start of a text, or a binary file")))
        }
    }
}

/// Reads a binary file.
fn binary(mut file: impl Read, length: usize) -> Option<Result<Mesh, MeshError>> {
    /// The facets read at a time: 100 KiB, which fit into a core's caches.
    const TOGETHER: usize = 2048;
    let mut head = Vec::new();
    file.by_ref().take((TITLE + 4) as u64).read_to_end(&mut head).ok()?;
    let body = length.saturating_sub(TITLE + 4);
    let (count, notes) = match claimed(&head) {
        Some(claimed) => match count(claimed, body) {
            Ok(count) => count,
            Err(fault) => return Some(Err(fault)),
        },
        None => {
            let fault = MeshError::new(format!("the file has {length} bytes"));
            return Some(Err(fault.expected("the word solid at its start, or 84 bytes and more")));
        }
    };
    // A closed mesh has about half as many vertices as triangles; `Corners` grows if it has more.
    let (mut vertices, mut triangles) = (Corners::new(room(count + 1)), room(count));
    let mut piece = vec![[0; FACET]; count.min(TOGETHER)];
    let mut attributes = 0;
    for first in (0..count).step_by(TOGETHER) {
        let facets = &mut piece[..TOGETHER.min(count - first)];
        file.read_exact(facets.as_flattened_mut()).ok()?;
        for facet in facets {
            // The corners follow the normal, which has 12 bytes.
            let [a, b, c] = *facet[12..48].as_chunks::<4>().0.as_chunks::<3>().0 else { return None };
            attributes |= facet[48] | facet[49];
            let point = |corner: [[u8; 4]; 3]| Vec3::from(corner.map(f32::from_le_bytes));
            let mut vertex = |corner| {
                let finite = Some(point(corner)).filter(|point| point.is_finite());
                finite.map(|point| vertices.vertex(point, || point.as_dvec3()))
            };
            let (Some(a), Some(b), Some(c)) = (vertex(a), vertex(b), vertex(c)) else {
                let corner = [a, b, c].iter().position(|corner| !point(*corner).is_finite());
                return Some(Err(corner_not_finite(triangles.len() + 1, corner?)));
            };
            triangles.push([a, b, c]);
        }
    }
    let (vertices, origin) = vertices.vertices.finish();
    let mut mesh = Mesh { vertices, origin, triangles, notes, ..Mesh::default() };
    mesh.note_unread(&[("attributes of facets, which some programs use for colours", attributes != 0)]);
    Some(Ok(mesh))
}

/// How many facets to read from a binary file that claims `claimed` of them and has `body` bytes
/// after its header; and notes about it.
fn count(claimed: u32, body: usize) -> Result<(usize, Vec<String>), MeshError> {
    let (count, most) = (claimed as usize, body / FACET);
    if count > most {
        let message = format!("the header claims {claimed} facets, and the file has no room for so many");
        return Err(MeshError::new(message).expected(format!("at most {most}: {body} bytes follow it")));
    }
    // Some programs reserve space for the count but never fill it in.
    if count == 0 && most > 0 {
        if body.is_multiple_of(FACET) {
            let follow = if most == 1 { "1 follows, which was" } else { &format!("{most} follow, which were") };
            return Ok((most, vec![format!("the header counts 0 facets, but {follow} read")]));
        }
        let message = format!("the header counts 0 facets, but {body} bytes follow it");
        return Err(MeshError::new(message).expected(format!("the number of facets, of {FACET} bytes each")));
    }
    let is_longer = body > count * FACET && count > 0;
    Ok((count, is_longer.then(|| goes_on("facets")).into_iter().collect()))
}

fn corner_not_finite(facet: usize, corner: usize) -> MeshError {
    not_finite(&format!("facet {facet}'s vertex {}", corner + 1))
}

/// What a text file may have next.
#[derive(Clone, Copy, PartialEq)]
enum Step {
    /// A solid, or other text between solids.
    Solid,
    /// Another facet, or the end of the solid.
    Facet,
    Loop,
    /// One of the first three vertices of a facet.
    Vertex,
    /// The end of the loop or another vertex, since some programs write polygons.
    EndLoop,
    EndFacet,
}

/// Reads all solids of a text file as one mesh. Other text between solids is skipped, unless it may
/// be part of a facet.
fn text(mut source: Vec<u8>) -> Result<Mesh, MeshError> {
    const STEPS: &str =
        "facet normal x y z, outer loop, three times vertex x y z with finite numbers, endloop, endfacet; or endsolid";
    source.make_ascii_lowercase();
    let (mut vertices, mut mesh) = (Corners::new(Vec::new()), Mesh::default());
    let (mut facets, mut fans): (_, Vec<Fan>) = (0, Vec::new());
    let (mut corners, mut words) = (Vec::new(), Vec::new());
    let mut step = Step::Solid;
    for (line, text) in lines(&source) {
        words.clear();
        let all = text.split(|byte| !byte.is_ascii_graphic()).filter(|word| !word.is_empty());
        words.extend(all.take_while(|word| !word.starts_with(b"#")));
        let mut rest = &words[..];
        while let Some(statement) = rest.split_off(..statement_length(rest)).filter(|words| !words.is_empty()) {
            let facet = facets + 1;
            let misread = || {
                MeshError::new(format!("facet {facet} cannot be understood")).line(line).expected(STEPS).of_text(text)
            };
            step = match (step, statement) {
                (Step::Solid | Step::Facet, [b"facet"] | [b"facet", b"normal", ..]) => Step::Loop,
                (Step::Loop, [b"outer", b"loop"]) => {
                    corners.clear();
                    Step::Vertex
                }
                (Step::Vertex | Step::EndLoop, [b"vertex", x, y, z]) => {
                    corners.push(vertices.vertex_of_words([x, y, z]).ok_or_else(misread)?);
                    if corners.len() < 3 { Step::Vertex } else { Step::EndLoop }
                }
                (Step::EndLoop, [b"endloop"] | [b"end", b"loop"]) => Step::EndFacet,
                (Step::EndFacet, [b"endfacet"] | [b"end", b"facet"]) => {
                    facets = facet;
                    mesh.push_face(facet, &corners, &mut fans);
                    Step::Facet
                }
                (Step::Facet, [b"endsolid", ..] | [b"end", b"solid", ..]) => Step::Solid,
                (Step::Facet | Step::Solid, [b"solid", ..]) => Step::Facet,
                // The solid's name may follow `solid` without a blank.
                (Step::Solid, [word, ..]) if facets == 0 && word.starts_with(b"solid") => Step::Facet,
                (Step::Solid, [word, ..]) if *word != b"vertex" => Step::Solid,
                _ => return Err(misread()),
            };
        }
    }
    if !matches!(step, Step::Solid | Step::Facet) {
        return Err(MeshError::new(format!("the file ends in facet {}", facets + 1)).expected(STEPS));
    }
    let is_cut = step == Step::Facet && facets > 0;
    let whole = counted(facets, "whole facet", "whole facets");
    mesh.notes.extend(is_cut.then(|| format!("the file ends after {whole}, without endsolid: it may be cut off")));
    (mesh.vertices, mesh.origin) = vertices.vertices.finish();
    mesh.cut(&fans)
}

/// The number of words of the first statement in a line. Most files have one statement per line,
/// but some have all in one line; the name of a solid ends before `facet normal` then.
fn statement_length(line: &[&[u8]]) -> usize {
    let begins = |words: &[&[u8]]| {
        matches!(
            words,
            [b"facet", b"normal", ..]
                | [b"outer", b"loop", ..]
                | [b"vertex" | b"endloop" | b"endfacet" | b"endsolid", ..]
                | [b"end", b"loop" | b"facet" | b"solid", ..]
        )
    };
    let has_name = !begins(line) || matches!(line, [b"endsolid", ..] | [b"end", b"solid", ..]);
    let is_next = |at: &usize| match &line[*at..] {
        [b"facet", b"normal", ..] => true,
        words => !has_name && begins(words),
    };
    (1..line.len()).find(is_next).unwrap_or(line.len())
}

/// The lines of a text, with their numbers. Carriage returns end them if there is no line feed, as
/// in files of the classic Mac OS.
fn lines(text: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
    let line_end = if text.contains(&b'\n') { b'\n' } else { b'\r' };
    (1..).zip(text.split(move |byte| *byte == line_end))
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
        assert_eq!(points.map(|point| corners.vertex(point, || point.as_dvec3())), [0, 1, 2, 0, 2, 1]);
        assert_eq!(corners.vertices.finish().0, points[..3]);
    }
}
