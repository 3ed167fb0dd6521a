//! The paper's format read piece by piece. This works as long as the file has no error.
//!
//! At any error the parser of whole texts reads the file again, since only that knows lines and
//! columns.

use std::io::{self, Read};
use std::mem;

use glam::Vec3;

use super::{Field, ListItem, MAX_PIXELS, MAX_SIDE, Rule, SceneSource, Stop, TRIANGLES, scene, whole};
use crate::scene::chunks::SharedFile;
use crate::scene::log::BYTE_ORDER_MARK;
use crate::scene::mistaken::recognise;
use crate::scene::opened::{NoArea, Opened};
use crate::scene::pieces::Pieces;
use crate::scene::token::{Kind, is_space, next_token};
use crate::scene::{Scene, Triangle};

/// Opens a file for reading from a byte offset on.
type FromPlace<'a> = dyn Fn(usize) -> io::Result<Box<dyn Read + 'a>> + 'a;

/// Reads the scene of a file of this length, which warnings call `name`; None if the parser of
/// whole texts has to read it. `open` opens the file from an offset on; `shared` is the same file
/// for several threads.
pub(in crate::scene) fn read<'a>(
    open: &'a FromPlace<'a>,
    length: usize,
    shared: Option<SharedFile<'a>>,
    name: &str,
) -> Option<Opened> {
    let mut pieces = Pieces::new(open(0).ok()?, length);
    pieces.fill()?;
    if recognise(pieces.rest()).is_some() {
        return None;
    }
    let mut parts = Streamed { open, pieces, length, left: length, shared, no_area: NoAreaPlaces::default() };
    if parts.pieces.rest().starts_with(BYTE_ORDER_MARK.as_bytes()) {
        parts.pass(BYTE_ORDER_MARK.len());
    }
    let picture = parts.token(|name| Some(name.to_owned())).ok()?;
    let scene: Scene = scene(&picture, &mut parts).ok()?;
    let warnings = parts.no_area.warnings(open, name)?;
    Some(Opened { scene, files: Vec::new(), notes: Vec::new(), carried_light: None, warnings })
}

/// The state of reading a file.
struct Streamed<'a> {
    open: &'a FromPlace<'a>,
    pieces: Pieces<Box<dyn Read + 'a>>,
    length: usize,
    /// The number of bytes that have not been read yet.
    left: usize,
    shared: Option<SharedFile<'a>>,
    no_area: NoAreaPlaces,
}

impl Streamed<'_> {
    /// Marks this many bytes as read.
    fn pass(&mut self, bytes: usize) {
        self.pieces.leave(self.pieces.rest().len() - bytes);
        self.left = self.left.saturating_sub(bytes);
    }

    /// The value that `read` parses from the next token.
    fn token<T>(&mut self, read: impl FnOnce(&str) -> Option<T>) -> Result<T, Stop> {
        self.pieces.fill().ok_or(Stop)?;
        loop {
            let (bytes, ended) = (self.pieces.rest(), self.pieces.ended());
            match next_token(bytes, 0) {
                Some(token) if ended || token.end < bytes.len() => {
                    // Check the bytes before the token too: a comment must be UTF-8.
                    let text = str::from_utf8(&bytes[..token.end]).map_err(|_| Stop)?;
                    let value = read(&text[token.start..]).ok_or(Stop)?;
                    self.pass(token.end);
                    return Ok(value);
                }
                None if ended => return Err(Stop),
                _ => self.pieces.lengthen().ok_or(Stop)?,
            }
        }
    }
}

impl SceneSource for Streamed<'_> {
    fn size(&mut self) -> Result<(u32, u32), Stop> {
        let mut side = || {
            let side = self.token(|token| whole(token).ok())?;
            if (1..=u64::from(MAX_SIDE)).contains(&side) { Ok(side as u32) } else { Err(Stop) }
        };
        let (width, height) = (side()?, side()?);
        if u64::from(width) * u64::from(height) > MAX_PIXELS { Err(Stop) } else { Ok((width, height)) }
    }

    fn number(&mut self, _: Field, rule: Rule) -> Result<f32, Stop> {
        self.token(|token| rule.check(token).ok())
    }

    fn count(&mut self, kind: &'static Kind) -> Result<u64, Stop> {
        let count = self.token(|token| whole(token).ok())?;
        // Each token has at least one byte, and so has the white space before it.
        if count > (self.left / 2 / kind.tokens) as u64 { Err(Stop) } else { Ok(count) }
    }

    /// Reads whole chunks with several threads, up to the first chunk with anything but triangles
    /// in the usual form.
    fn first_triangles(&mut self, count: u64, triangles: &mut Vec<Triangle>) -> Result<(), Stop> {
        let Some(shared) = self.shared.filter(|shared| shared.is_worth_sharing(self.left)) else { return Ok(()) };
        let Streamed { open, length, left, no_area, .. } = self;
        let at = shared.read_lines(*length - *left..*length, UsualTriangles::of, |chunk| {
            let has_room = chunk.triangles.len() as u64 <= count - triangles.len() as u64;
            if has_room {
                no_area.append(chunk.no_area, triangles.len() as u64);
                triangles.extend(chunk.triangles);
            }
            has_room
        });
        self.left = *length - at;
        self.pieces = Pieces::new(open(at).map_err(|_| Stop)?, self.left);
        Ok(())
    }

    #[inline]
    fn usual_triangle(&mut self) -> Option<Triangle> {
        self.pieces.fill()?;
        let bytes = self.pieces.rest();
        let (triangle, rest) = usual_triangle(bytes)?;
        self.pass(bytes.len() - rest.len());
        Some(triangle)
    }

    fn note_no_area(&mut self, triangle: ListItem) -> Result<(), Stop> {
        self.no_area.add(triangle.number, self.length - self.left);
        Ok(())
    }

    fn end(&mut self) -> Result<(), Stop> {
        loop {
            let (bytes, ended) = (self.pieces.rest(), self.pieces.ended());
            match next_token(bytes, 0) {
                Some(token) if ended || token.end < bytes.len() => return Err(Stop),
                None if ended => return str::from_utf8(bytes).map(drop).map_err(|_| Stop),
                _ => self.pieces.lengthen().ok_or(Stop)?,
            }
        }
    }
}

/// Reads a triangle in the usual form: twelve numbers, with only white space (no comment) before
/// each and after the last. Returns it with what follows.
#[inline(always)]
fn usual_triangle(bytes: &[u8]) -> Option<(Triangle, &[u8])> {
    let mut rest = bytes;
    let mut numbers = [0.0; 12];
    for number in &mut numbers {
        rest = after_spaces(rest);
        let (value, length) = fast_float2::parse_partial(rest).ok()?;
        rest = &rest[length..];
        if !rest.first().is_some_and(|byte| is_space(*byte)) {
            return None;
        }
        *number = value;
    }
    let [colour, a, b, c] = *numbers.as_chunks().0 else { return None };
    let [colour, a, b, c] = [colour, a, b, c].map(Vec3::from_array);
    if !numbers.iter().all(|number| number.is_finite()) || colour.min_element() < 0.0 {
        return None;
    }
    // Adding 0 turns -0 into +0.
    Some((Triangle { colour: colour + 0.0, vertices: [a, b, c] }, rest))
}

#[inline]
fn after_spaces(mut bytes: &[u8]) -> &[u8] {
    while let [byte, after @ ..] = bytes
        && is_space(*byte)
    {
        bytes = after;
    }
    bytes
}

/// Triangles in the usual form from the middle of a file, numbered from 1.
struct UsualTriangles {
    triangles: Vec<Triangle>,
    no_area: NoAreaPlaces,
}

impl UsualTriangles {
    /// Reads bytes from offset `at` of a file that consist of triangles; None if one does not have
    /// the usual form.
    fn of(at: usize, bytes: &[u8]) -> Option<Self> {
        let mut read = UsualTriangles { triangles: Vec::new(), no_area: NoAreaPlaces::default() };
        // A guess: a usual triangle has more than 48 bytes.
        read.triangles.reserve(bytes.len() / 48);
        let mut rest = after_spaces(bytes);
        while !rest.is_empty() {
            let (triangle, after) = usual_triangle(rest)?;
            read.triangles.push(triangle);
            if triangle.has_no_area() {
                read.no_area.add(read.triangles.len() as u64, at + bytes.len() - after.len());
            }
            rest = after_spaces(after);
        }
        Some(read)
    }
}

/// The triangles without area: the positions of the first ones, and the number of further ones.
#[derive(Default)]
struct NoAreaPlaces {
    first: Vec<NoAreaPlace>,
    more: u64,
}

/// A triangle without area.
struct NoAreaPlace {
    /// The triangle's number, from 1.
    number: u64,
    /// The offset of the byte after its last number.
    end: usize,
}

impl NoAreaPlaces {
    fn add(&mut self, number: u64, end: usize) {
        if self.first.len() < NoArea::MOST {
            self.first.push(NoAreaPlace { number, end });
        } else {
            self.more += 1;
        }
    }

    /// Appends those of a chunk, before which the file has `before` triangles.
    fn append(&mut self, later: NoAreaPlaces, before: u64) {
        later.first.into_iter().for_each(|NoAreaPlace { number, end }| self.add(before + number, end));
        self.more += later.more;
    }

    /// The warnings, for a file called `name`. The file is read again to count lines; None if that
    /// fails.
    fn warnings(self, open: &FromPlace<'_>, name: &str) -> Option<Vec<String>> {
        let mut no_area = NoArea::default();
        if let Some(last) = self.first.last() {
            let mut lines =
                LineCount { text: open(0).ok()?.take(last.end as u64), at: 0, line: 1, after_return: false };
            for NoAreaPlace { number, end } in self.first {
                let triangle = ListItem { one: TRIANGLES.one, number };
                let line = lines.line_of(end).ok()?;
                no_area.add(name, &triangle.to_string(), || line);
            }
        }
        no_area.add_more(self.more as usize);
        Some(no_area.warnings(name))
    }
}

/// A reader that counts the lines it has passed.
struct LineCount<R> {
    text: R,
    /// The number of bytes read.
    at: usize,
    /// The line that the next byte is in.
    line: usize,
    /// Whether the last byte was a carriage return: a line feed after it belongs to the same line
    /// end.
    after_return: bool,
}

impl<R: Read> LineCount<R> {
    /// The line of an offset, which must not be before the one asked for last.
    fn line_of(&mut self, place: usize) -> io::Result<usize> {
        let mut piece = vec![0; 64 << 10];
        while self.at < place {
            let most = piece.len().min(place - self.at);
            let bytes = &mut piece[..most];
            self.text.read_exact(bytes)?;
            self.at += most;
            let feeds = memchr::memchr_iter(b'\n', bytes).count();
            let returns = memchr::memchr_iter(b'\r', bytes).filter(|at| bytes.get(at + 1) != Some(&b'\n')).count();
            let is_one_end = mem::replace(&mut self.after_return, bytes[most - 1] == b'\r') && bytes[0] == b'\n';
            self.line += feeds + returns - usize::from(is_one_end);
        }
        Ok(self.line)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::io::{Read, Write};
    use std::path::Path;

    use super::read;
    use crate::scene::chunks::SharedFile;
    use crate::scene::parse::parse_with_warnings;
    use crate::scene::{Opened, Rng};

    /// A scene and its warnings as text, in which 0 and -0 differ.
    fn shown(opened: Opened) -> String {
        format!("{:?} {:?}", opened.scene, opened.warnings)
    }

    /// Asserts that a text is read in pieces as it is at once or, if something is wrong with it,
    /// not at all. Returns whether it is sound.
    fn is_read_alike(source: &[u8]) -> bool {
        let at_once = parse_with_warnings(source, "a.in").ok();
        let in_pieces = read(&|at| Ok(Box::new(&source[at..])), source.len(), None, "a.in");
        let is_sound = at_once.is_some();
        assert_eq!(in_pieces.map(shown), at_once.map(shown), "{}", source.escape_ascii());
        is_sound
    }

    /// Asserts the same of a text that three threads read, in chunks of so many bytes.
    fn is_read_alike_by_three(source: &[u8], chunk: usize) -> bool {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(source).unwrap();
        let shared = SharedFile::new(&file, 3).in_chunks_of(chunk);
        let open = |at| shared.rest(at).map(|file| Box::new(file) as Box<dyn Read>);
        let by_three = read(&open, source.len(), Some(shared), "a.in");
        let at_once = parse_with_warnings(source, "a.in").ok();
        let is_sound = at_once.is_some();
        assert!(by_three.map(shown) == at_once.map(shown), "{}", source.escape_ascii());
        is_sound
    }

    #[test]
    fn a_scene_is_the_same_in_pieces() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let pieces = [&b" "[..], b"\n", b"-", b"0", b"#", b"//", b"e", b".", b"\xff", b"1e39 ", b"-0 ", b"+"];
        let mut rng = Rng::new(5);
        let (mut sound, mut others) = (0, 0);
        for folder in ["fuzz/corpus/scene_in", "scenes"] {
            for entry in fs::read_dir(root.join(folder)).unwrap() {
                let path = entry.unwrap().path();
                // A folder is no scene.
                let original = fs::read(&path).unwrap_or_default();
                for round in 0..if original.len() < 4000 { 100 } else { 2 } {
                    let mut source = original.clone();
                    if round > 0 {
                        rng.change(&mut source, &pieces);
                    }
                    *if is_read_alike(&source) { &mut sound } else { &mut others } += 1;
                }
            }
        }
        assert!(sound > 100 && others > 100, "{sound} sound ones, {others} others");
    }

    #[test]
    fn several_threads_read_the_same_scene_as_one() {
        let pieces = [&b" "[..], b"\n", b"\r", b"-", b"0", b"#", b"//", b"e", b"\xff", b"1e39 ", b"-0 ", b"1 "];
        let mut rng = Rng::new(7);
        let (mut sound, mut others) = (0, 0);
        for round in 0..200 {
            let count = 300;
            let mut text = format!("\u{feff}a.png 8 6 1 1\r\n1 1 1 1 0 0 0\n0\n{count}\n");
            for i in 0..count {
                let mut number = || (rng.next_u64() % 1000) as f32 / 8.0;
                let [a, b, c, d, e, f, g] = std::array::from_fn(|_| number());
                // Some have no area, and some files have triangles across lines.
                let [h, j] = if i % (7 + round % 90) == 0 { [a, b] } else { [e, f] };
                let (white, across) = (["1 1 1", "0 -0 .5e1"][i % 2], if round % 5 == 4 { "\n" } else { " " });
                text += &format!("{white} {a} {b} {c}{across}{d} {e} {f} {h} {j} {}\n", if h == a { c } else { g });
            }
            let mut source = text.into_bytes();
            (0..round % 4).for_each(|_| rng.change(&mut source, &pieces));
            *if is_read_alike_by_three(&source, 600 + 100 * (round % 5)) { &mut sound } else { &mut others } += 1;
        }
        assert!(sound > 50 && others > 50, "{sound} sound ones, {others} others");
    }

    #[test]
    fn a_scene_of_many_pieces_is_the_same() {
        let mut rng = Rng::new(6);
        let mut triangles = String::new();
        const COUNT: usize = 9000;
        for i in 0..COUNT {
            let mut number = || (rng.next_u64() as i32) as f32 / 1e3;
            let [a, b, c, d, e, f, g, h, i_] = std::array::from_fn(|_| number());
            triangles += &match i % 5 {
                0 => format!("1 0 -0 {a} {b} {c} # {i}\n{d} {e} {f} {g} {h} {i_}\n"),
                1 => format!("1 .5 5e-1 {a:e} {b:e} {c:e}\r\n{d} {e} {f}\t{g} {h} {i_}"),
                2 => format!("\n 1. +1 1 {a} {b} {c} {d} {e} {f} {g} {h} {i_} // {}\n", "\u{e9}".repeat(i % 700)),
                _ => format!("{} 1 1 {a} {b} {c} {d} {e} {f} {g} {h} {i_}\n", i % 2),
            };
        }
        let spheres: String = (0..3000).map(|i| format!("{} 1 1 1 {i} 0 9\n", i + 1)).collect();
        let source = format!("\u{feff}a.png 8 6 1 0 3000\n{spheres}{COUNT}\n{triangles}");
        assert!(source.len() > 1 << 20);
        assert!(is_read_alike(source.as_bytes()));
        for cut in [source.len() - 1, source.len() - 9, 70_000, 140_000] {
            is_read_alike(&source.as_bytes()[..cut]);
        }
    }
}
