//! Wavefront OBJ, read piece by piece.

mod usual;

use std::borrow::Cow;
use std::io::Read;

use glam::{DVec3, Vec3};

use super::fault::{NonFiniteVertex, counted, only, small_faces};
use super::materials::{Materials, before_comment, colour};
use super::number::Number;
use super::polygon::Fan;
use super::vertices::Vertices;
use super::{Mesh, MeshError};
use crate::kernels::sys::room;
use crate::scene::chunks::SharedFile;
use crate::scene::diagnostic::brief;
use crate::scene::log::is_line_end;
use crate::scene::pieces::Pieces;

/// What a corner of a face must be: vertex numbers count from 1, or backwards from -1.
const CORNER: &str = "vertex numbers, as in 7, 7/1, 7/1/2 or 7//2";

/// Reads the mesh of a file of this length in bytes; None if the file cannot be read. `shared`,
/// if given, is the same file for reading with several threads.
pub(super) fn read(
    file: impl Read,
    length: usize,
    shared: Option<SharedFile<'_>>,
) -> Option<Result<(Mesh, Materials), MeshError>> {
    // A vertex or a face takes at least 8 bytes: "v 0 0 0" and "f 1 2 3" with their line ends.
    let most = length / 8 + 1;
    let points = Vertices::in_room(room(most));
    let mut obj = Obj { points, mesh: Mesh { triangles: room(most), ..Mesh::default() }, ..Obj::default() };
    let read = match shared.filter(|shared| shared.is_worth_sharing(length)) {
        Some(shared) => obj.take_shared(length, shared)?,
        None => obj.take_pieces(file, length)?,
    };
    Some(read.and_then(|()| obj.mesh()))
}

/// What has been read of a file, or of a part of it, so far.
#[derive(Default)]
struct Obj {
    /// The number of lines begun.
    line: usize,
    points: Vertices,
    /// The mesh; its triangles are indices into `points`.
    mesh: Mesh,
    /// The colours of the first points; later ones are white.
    tints: Vec<Vec3>,
    faces: usize,
    fans: Vec<Fan>,
    materials: Materials,
    /// The corners of the current face.
    corners: Vec<u32>,
    /// Whether some vertices have weights: then numbers after coordinates are not colours.
    weighted: bool,
    /// The vertices that are not finite.
    non_finite: Vec<NonFiniteVertex>,
    /// Corners that refer to vertices which had not been read yet. Only those are kept that may
    /// turn out to be the first with a missing vertex.
    early: Vec<Corner>,
    skipped: Skipped,
    /// Whether these lines are from the middle of a file, so that faces may refer to vertices
    /// of earlier lines.
    follows_others: bool,
}

/// What was skipped in a file, to be reported in notes.
#[derive(Default)]
struct Skipped {
    normals: bool,
    textures: bool,
    surfaces: bool,
    calls: bool,
    /// Whether comments hold vertex colours, as ZBrush writes them.
    colours_in_comments: bool,
    /// The number of vertices with numbers after the coordinates that are no colour.
    tails: usize,
    /// The number of faces with fewer than three corners.
    faces: usize,
    /// The number of lines that begin with no keyword of OBJ, and the number and first word of
    /// the first such line.
    lines: usize,
    first_line: Option<(usize, String)>,
}

/// A chunk of lines in the simple form that nearly all files have, read without knowing the
/// lines before.
struct UsualLines {
    obj: Obj,
    /// The number of vertices, from before and within the chunk, that its faces need to exist.
    vertices: usize,
}

impl UsualLines {
    /// Reads whole lines; None if one has another form.
    fn of(text: &[u8]) -> Option<Self> {
        // A guess from the length of the text: a usual line has more than 16 bytes.
        let most = text.len() / 16;
        let points = Vertices::after_near_ones(Vec::with_capacity(most));
        let mesh = Mesh { triangles: Vec::with_capacity(most), ..Mesh::default() };
        let mut obj = Obj { points, mesh, follows_others: true, ..Obj::default() };
        let mut rest = text;
        while !rest.is_empty() {
            rest = obj.take_usual(rest)?;
        }
        let furthest = obj.mesh.triangles.as_flattened().iter().copied().reduce(u32::max);
        Some(UsualLines { vertices: furthest.map_or(0, |index| index as usize + 1), obj })
    }
}

/// A corner of a face, kept to report an error in it.
struct Corner {
    line: usize,
    face: usize,
    corner: usize,
    /// The index as written in the file.
    index: i64,
    /// The number of the vertex from 1; below 1 if there is none.
    vertex: i64,
}

impl Obj {
    /// Reads whole lines; the last one is left if it may continue beyond the bytes at hand.
    fn lines(&mut self, rest: &mut &[u8], ended: bool) -> Result<(), MeshError> {
        while !rest.is_empty() {
            if let Some(after) = self.take_usual(rest) {
                *rest = after;
                continue;
            }
            let begun = *rest;
            let Some((line, count)) = joined(rest, ended) else {
                *rest = begun;
                return Ok(());
            };
            self.line += count;
            self.take(&line)?;
        }
        Ok(())
    }

    /// Reads the rest of a file of this length piece by piece; None if the file cannot be read.
    fn take_pieces(&mut self, file: impl Read, length: usize) -> Option<Result<(), MeshError>> {
        let mut pieces = Pieces::new(file, length);
        loop {
            pieces.fill()?;
            let (text, ended) = (pieces.rest(), pieces.ended());
            let end =
                if ended { text.len() } else { text.iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1) };
            let mut rest = &text[..end];
            if let Err(fault) = self.lines(&mut rest, ended) {
                return Some(Err(fault));
            }
            let left = text.len() - end + rest.len();
            if ended {
                return Some(Ok(()));
            } else if left == text.len() {
                pieces.lengthen()?;
            } else {
                pieces.leave(left);
            }
        }
    }

    /// As [`take_pieces`](Self::take_pieces), but several threads read chunks of the file after
    /// the first one, as long as all lines have the usual form; the rest is read piece by piece.
    fn take_shared(&mut self, length: usize, shared: SharedFile<'_>) -> Option<Result<(), MeshError>> {
        let first_lines = shared.first_lines(length).unwrap_or_default();
        let mut rest = &first_lines[..];
        if let Err(fault) = self.lines(&mut rest, false) {
            return Some(Err(fault));
        }
        let mut taken = first_lines.len() - rest.len();
        if self.points.are_near() {
            taken = shared.read_lines(taken..length, |_, text| UsualLines::of(text), |lines| self.append(lines));
        }
        self.take_pieces(shared.rest(taken).ok()?, length - taken)
    }

    /// Appends a chunk of lines, unless they refer to vertices that come later; returns whether
    /// it did.
    fn append(&mut self, lines: UsualLines) -> bool {
        let UsualLines { obj, vertices } = lines;
        if vertices > self.points.len() + obj.points.len() {
            return false;
        }
        let Obj { line, points, mesh, faces, fans, materials, skipped, .. } = obj;
        let first = self.mesh.triangles.len();
        let shifted =
            |Fan { number, first: of, corners }| Fan { number: self.faces + number, first: first + of, corners };
        self.fans.extend(fans.into_iter().map(shifted));
        self.materials.append(materials, first);
        self.skipped.append(skipped, self.line);
        self.points.append(points);
        self.mesh.triangles.extend(mesh.triangles);
        self.line += line;
        self.faces += faces;
        true
    }

    /// Reads the next line if it has the usual form, and returns what follows it.
    #[inline]
    fn take_usual<'a>(&mut self, rest: &'a [u8]) -> Option<&'a [u8]> {
        let after = match rest {
            [b'v', b' ', numbers @ ..] if self.points.are_near() => {
                let (point, after) = usual::point(numbers)?;
                self.points.push(point, || point.as_dvec3());
                after
            }
            [b'f', b' ', corners @ ..] => {
                let vertices = if self.follows_others { usize::MAX } else { self.points.len() };
                let after = usual::corners(corners, vertices, &mut self.corners)?;
                self.faces += 1;
                self.add_face();
                after
            }
            _ => return self.take_usual_other(rest),
        };
        self.line += 1;
        Some(after)
    }

    /// As [`take_usual`](Self::take_usual), for a line that is neither a vertex nor a face.
    fn take_usual_other<'a>(&mut self, rest: &'a [u8]) -> Option<&'a [u8]> {
        let (line, after) = usual::line(rest)?;
        let (keyword, rest) = keyword_of(line);
        if matches!(keyword, b"v" | b"V" | b"f" | b"F" | b"fo") {
            return None;
        }
        self.line += 1;
        self.other(keyword, rest);
        Some(after)
    }

    /// Reads a line of any form.
    fn take(&mut self, line: &[u8]) -> Result<(), MeshError> {
        let (keyword, rest) = keyword_of(line);
        match keyword {
            b"v" | b"V" => self.vertex(rest),
            b"f" | b"F" | b"fo" => self.face(rest),
            _ => {
                self.other(keyword, rest);
                Ok(())
            }
        }
    }

    fn fault(&self, message: String, expected: &str) -> MeshError {
        MeshError::new(message).line(self.line).expected(expected)
    }

    /// A line's text without a comment, which may be in any encoding.
    fn text<'a>(&self, rest: &'a [u8]) -> Result<&'a str, MeshError> {
        let not_utf8 = |_| self.fault("the line is no text: it is not UTF-8".into(), "a vertex or a face");
        str::from_utf8(before_comment(rest)).map_err(not_utf8)
    }

    /// Reads a vertex: coordinates, which nothing, one weight, or several numbers that begin
    /// with a colour may follow.
    fn vertex(&mut self, rest: &[u8]) -> Result<(), MeshError> {
        let text = self.text(rest)?;
        let number = self.points.len() + 1;
        let no_point =
            || self.fault(format!("vertex {number} is not a point"), "three numbers after v: x y z").of_text(text);
        let mut words = text.split_whitespace();
        let mut coordinate = || next_number(&mut words).ok_or_else(no_point);
        let [x, y, z] = [coordinate()?, coordinate()?, coordinate()?];
        let mut point = Vec3::new(x.single, y.single, z.single);
        let mut exact = DVec3::new(x.double, y.double, z.double);
        let tail = words.clone();
        let mut is_finite = point.is_finite();
        match tail.count() {
            0 => {}
            1 => {
                let weight = next_number(&mut words).ok_or_else(no_point)?;
                if weight.single == 0.0 {
                    return Err(self.fault(format!("vertex {number} has the weight 0"), "x y z alone"));
                }
                self.weighted = true;
                point /= weight.single;
                exact /= weight.double;
                is_finite &= weight.single.is_finite() && point.is_finite();
            }
            _ => match colour(words) {
                Some(colour) => {
                    self.tints.resize(self.points.len(), Vec3::ONE);
                    self.tints.push(colour);
                }
                None => self.skipped.tails += 1,
            },
        }
        if !is_finite {
            self.non_finite.push(NonFiniteVertex { index: number - 1, line: Some(self.line) });
        }
        self.points.push(point, || exact);
        Ok(())
    }

    fn face(&mut self, rest: &[u8]) -> Result<(), MeshError> {
        let text = self.text(rest)?;
        self.faces += 1;
        self.corners.clear();
        for (corner, word) in (1..).zip(text.split_whitespace()) {
            let Some(index) = vertex_index(word) else {
                let message = format!("face {} cannot be understood", self.faces);
                return Err(self.fault(message, CORNER).of_text(text));
            };
            self.corner(corner, index);
        }
        self.add_face();
        Ok(())
    }

    /// Adds the face whose corners have been read.
    fn add_face(&mut self) {
        match self.corners[..] {
            [] | [_] | [_, _] => self.skipped.faces += 1,
            [a, b, c] => self.mesh.triangles.push([a, b, c]),
            _ => self.mesh.push_face(self.faces, &self.corners, &mut self.fans),
        }
    }

    /// Adds a corner of the current face. Its vertex may follow later in the file.
    fn corner(&mut self, corner: usize, index: i64) {
        let there_are = self.points.len() as i64;
        let vertex = if index < 0 { there_are + 1 + index } else { index };
        self.corners.push(u32::try_from(vertex - 1).unwrap_or(u32::MAX));
        if (1..=there_are).contains(&vertex) {
            return;
        }
        let last = self.early.last().map(|last| last.vertex);
        if last.is_none_or(|last| last > 0 && (vertex < 1 || vertex > last)) {
            self.early.push(Corner { line: self.line, face: self.faces, corner, index, vertex });
        }
    }

    /// Handles a line that is neither a vertex nor a face.
    fn other(&mut self, keyword: &[u8], rest: &[u8]) {
        let is = |word: &str| keyword.eq_ignore_ascii_case(word.as_bytes());
        let skipped = &mut self.skipped;
        if is("vn") {
            skipped.normals = true;
        } else if is("vt") {
            skipped.textures = true;
        } else if is("usemtl") {
            self.materials.use_from(self.mesh.triangles.len(), rest);
        } else if is("mtllib") {
            self.materials.add_library(rest);
        } else if is("curv") || is("curv2") || is("surf") {
            skipped.surfaces = true;
        } else if is("call") {
            skipped.calls = true;
        } else if keyword.is_empty() {
            skipped.colours_in_comments |= rest.starts_with(b"#MRGB ");
        } else if !SKIPPED.split(' ').any(is) {
            skipped.lines += 1;
            let word = || brief(&String::from_utf8_lossy(keyword));
            skipped.first_line.get_or_insert_with(|| (self.line, word()));
        }
    }

    /// The mesh, after all lines have been read. It keeps only the vertices that faces use, in
    /// the order of their first use.
    fn mesh(self) -> Result<(Mesh, Materials), MeshError> {
        self.check()?;
        let Obj { points, mut mesh, tints, .. } = self;
        let (points, origin) = points.finish();
        mesh.origin = origin;
        const UNUSED: u32 = u32::MAX;
        let mut places = vec![UNUSED; points.len()];
        mesh.vertices = room(points.len() + 1);
        let is_tinted = !tints.is_empty() && !self.weighted;
        let mut of_vertices = Vec::new();
        for index in mesh.triangles.as_flattened_mut() {
            let place = &mut places[*index as usize];
            if *place == UNUSED {
                *place = mesh.vertices.len() as u32;
                mesh.vertices.push(points[*index as usize]);
                if is_tinted {
                    of_vertices.push(tints.get(*index as usize).copied().unwrap_or(Vec3::ONE));
                }
            }
            *index = *place;
        }
        if let Some(used) = self.non_finite.iter().find(|vertex| places[vertex.index] != UNUSED) {
            return Err(used.fault());
        }
        let mut mesh = mesh.cut(&self.fans)?;
        if is_tinted {
            mesh.paint_by_vertices(&of_vertices);
            if tints.iter().any(|tint| tint.max_element() > 1.0) {
                mesh.notes.push("colours of vertices exceed 1, and are taken as they are".into());
            }
        }
        self.skipped.note(&mut mesh, !tints.is_empty() && self.weighted);
        Ok((mesh, self.materials))
    }

    /// An error if a face refers to a missing vertex or if there is no triangle.
    fn check(&self) -> Result<(), MeshError> {
        let there_are = self.points.len();
        let is_missing = |corner: &&Corner| !(1..=there_are as i64).contains(&corner.vertex);
        if let Some(Corner { line, face, corner, index, vertex }) = self.early.iter().find(is_missing) {
            let refers = format!("face {face}'s corner {corner} refers to vertex {index}");
            let message = match *index {
                0 => format!("{refers}, but vertices are counted from 1"),
                ..0 => {
                    let before = (vertex - 1 - index) as usize;
                    format!("{refers}, but only {} before it", counted(before, "vertex comes", "vertices come"))
                }
                1.. => format!("{refers}, but the file has {}", only(there_are)),
            };
            let message = match &self.skipped.first_line {
                Some((line, word)) => format!("{message}; line {line} begins with `{word}`, which OBJ does not know"),
                None => message,
            };
            let fault = MeshError::new(message).line(*line);
            let expected = match there_are {
                0 => "vertices: lines such as v 0 0 1".to_owned(),
                _ => format!("1 to {there_are}, the number of its vertices, or -1 and down for the last ones"),
            };
            return Err(fault.expected(expected));
        }
        if !self.mesh.triangles.is_empty() {
            return Ok(());
        }
        let Skipped { faces, surfaces, lines, .. } = self.skipped;
        let vertices = counted(there_are, "vertex", "vertices");
        let reason = if faces > 0 {
            format!("each of its {} has less than three corners", counted(faces, "face", "faces"))
        } else if surfaces {
            "it has curves and surfaces in place of faces, and these are not read".to_owned()
        } else if there_are > 0 {
            format!("it has {vertices} and no face")
        } else if lines > 0 {
            "no line begins with v or f".to_owned()
        } else {
            "it has no vertices and no faces".to_owned()
        };
        Err(MeshError::new(format!("the mesh is empty: {reason}")).expected("at least one face, such as f 1 2 3"))
    }
}

impl Skipped {
    /// Adds what was skipped in later lines; `line` is the number of lines before these.
    fn append(&mut self, later: Skipped, line: usize) {
        self.normals |= later.normals;
        self.textures |= later.textures;
        self.surfaces |= later.surfaces;
        self.calls |= later.calls;
        self.colours_in_comments |= later.colours_in_comments;
        self.tails += later.tails;
        self.faces += later.faces;
        self.lines += later.lines;
        let shifted = |(first, word)| (line + first, word);
        self.first_line = self.first_line.take().or_else(|| later.first_line.map(shifted));
    }

    /// Adds notes about what was skipped.
    fn note(&self, mesh: &mut Mesh, colours: bool) {
        let Skipped { faces, tails, lines, .. } = *self;
        mesh.note_unread(&[
            ("normals", self.normals),
            ("texture coordinates", self.textures),
            ("curves and surfaces", self.surfaces),
            ("files that `call` names", self.calls),
            ("colours of vertices, since some vertices have weights", colours),
            ("colours in comments (#MRGB)", self.colours_in_comments),
        ]);
        if faces > 0 {
            mesh.notes.push(small_faces(faces));
        }
        if tails > 0 {
            let vertices = counted(tails, "vertex", "vertices");
            mesh.notes.push(format!("not read: numbers behind the coordinates of {vertices}, which are no colours"));
        }
        if let Some((line, word)) = &self.first_line {
            let first = if lines == 1 { "" } else { "the first " };
            let lines = counted(lines, "line", "lines");
            mesh.notes.push(format!("left out: {lines} that OBJ does not know, {first}in line {line}: `{word}`"));
        }
    }
}

/// The keywords of OBJ lines that are skipped: of groups, points and lines, of curves and
/// surfaces, and of display attributes.
const SKIPPED: &str = "g o s p l mg vp deg bmat step cstype parm trim hole scrv sp end con bevel c_interp d_interp lod \
    shadow_obj trace_obj ctech stech maplib usemap csh bsp bzp cdc cdp res";

/// The first word of a line, and what follows it.
fn keyword_of(line: &[u8]) -> (&[u8], &[u8]) {
    // C's `isspace` accepts a vertical tab, and so does the splitting of the words after the
    // keyword.
    let is_blank = |byte: &u8| byte.is_ascii_whitespace() || *byte == b'\x0b';
    let line = &line[line.iter().position(|byte| !is_blank(byte)).unwrap_or(line.len())..];
    line.split_at(line.iter().position(|byte| is_blank(byte) || *byte == b'#').unwrap_or(line.len()))
}

/// The next word as a number, if it is one.
fn next_number<'a>(words: &mut impl Iterator<Item = &'a str>) -> Option<Number> {
    Number::of_word(words.next()?.as_bytes())
}

/// The first of up to three integers separated by slashes, all of which are checked; a missing
/// one counts as 0. None if one is not an integer.
fn vertex_index(word: &str) -> Option<i64> {
    let number = |part: &str| if part.is_empty() { Some(0) } else { part.parse::<i64>().ok() };
    let mut parts = word.split('/').map(number);
    let index = parts.next()??;
    let is_valid = parts.by_ref().take(2).all(|part| part.is_some()) && parts.next().is_none();
    is_valid.then_some(index)
}

/// Whether a line that ends in a backslash continues in the next line. A comment does not,
/// since it may end in the name of a Windows folder. A name does not either if the next line is
/// empty or begins with a keyword.
fn goes_on(line: &[u8], next: &[u8]) -> bool {
    let is_one_of =
        |keyword: &[u8], words: &str| words.split(' ').any(|it| keyword.eq_ignore_ascii_case(it.as_bytes()));
    let (next, _) = keyword_of(next.split(|byte| is_line_end(*byte)).next().unwrap_or_default());
    let is_own = next.is_empty() || is_one_of(next, "v vn vt f g o s usemtl mtllib");
    let is_name = is_one_of(keyword_of(line).0, "g o usemtl mtllib");
    !line.contains(&b'#') && (!is_name || !is_own)
}

/// Takes the next line without its end, joined with the following ones where it ends in a
/// backslash, and the number of lines taken. None if the end is not in the buffer yet.
fn joined<'a>(rest: &mut &'a [u8], ended: bool) -> Option<(Cow<'a, [u8]>, usize)> {
    let mut joined = Cow::Borrowed(&[][..]);
    for count in 1.. {
        // A carriage return alone ends a line, too, as in files of the classic Mac OS.
        let end = memchr::memchr2(b'\n', b'\r', rest).map_or(rest.len(), |end| end + 1);
        let end = end + usize::from(rest[..end].ends_with(b"\r") && rest[end..].starts_with(b"\n"));
        let line = rest.split_off(..end)?.trim_ascii_end();
        match line.strip_suffix(b"\\") {
            // Whether the line goes on depends on the next one, which must be in the buffer as a
            // whole.
            Some(_) if !ended && !rest.iter().any(|byte| is_line_end(*byte)) => return None,
            Some(begun) if !rest.is_empty() && goes_on(line, rest) => {
                joined.to_mut().extend(begun);
                joined.to_mut().push(b' ');
            }
            _ if count == 1 => return Some((line.into(), count)),
            _ => {
                joined.to_mut().extend(line);
                return Some((joined, count));
            }
        }
    }
    None
}
