//! Scenes in the paper's format as nearly all are written, read in bulk and piece by piece.
//!
//! Whatever is unusual or wrong gives nothing: then the file is read from its start by [`super::parse`], which is careful, and
//! has words for what is wrong.

use std::io::Read;

use glam::Vec3;

use super::log::is_line_end;
use super::number::{number, whole};
use super::opened::{NoArea, Opened};
use super::parse::{FILM, is_space};
use super::pieces::Pieces;
use super::{Camera, Faces, Light, Scene, Sphere, Triangle};
use crate::kernels::sys::room;

/// The scene of a file of this length; `name` is what warnings call it.
pub(super) fn read(file: impl Read, length: usize, name: &str) -> Option<Opened> {
    let mut text = Text { pieces: Pieces::new(file, length), length, line: 1 };
    text.fill()?;
    let image = text.word()?;
    let (width, height) = (text.whole()?, text.whole()?);
    let [focal] = text.numbers()?;
    let camera = Camera::new(width, height, focal, FILM).ok()?;
    let lights = text.list(|_, _, [intensity, r, g, b, x, y, z]| {
        Some(Light { intensity: not_negative(intensity)?, colour: colour(r, g, b)?, position: Vec3::new(x, y, z) })
    })?;
    let spheres = text.list(|_, _, [radius, r, g, b, x, y, z]| {
        (radius > 0.0).then_some(Sphere { radius, colour: colour(r, g, b)?, centre: Vec3::new(x, y, z) })
    })?;
    let mut no_area = NoArea::default();
    let triangles = text.list(|number, line, [r, g, b, x1, y1, z1, x2, y2, z2, x3, y3, z3]| {
        let vertices = [Vec3::new(x1, y1, z1), Vec3::new(x2, y2, z2), Vec3::new(x3, y3, z3)];
        let triangle = Triangle { colour: colour(r, g, b)?, vertices };
        if triangle.has_no_area() {
            no_area.add(name, &format!("triangle {number}"), || line);
        }
        Some(triangle)
    })?;
    let scene = Scene { name: image, camera, lights, spheres, triangles, faces: Faces::default() };
    text.is_over().then(|| Opened { scene, notes: Vec::new(), warnings: no_area.warnings(name) })
}

fn colour(red: f32, green: f32, blue: f32) -> Option<Vec3> {
    Some(Vec3::new(not_negative(red)?, not_negative(green)?, not_negative(blue)?))
}

/// -0 becomes +0.
fn not_negative(number: f32) -> Option<f32> {
    (number >= 0.0).then_some(number + 0.0)
}

/// A file of this length, and the line that comes next, from 1.
struct Text<R> {
    pieces: Pieces<R>,
    length: usize,
    line: usize,
}

impl<R: Read> Text<R> {
    /// Has the bytes of an object at hand.
    fn fill(&mut self) -> Option<()> {
        self.pieces.fill(b"\n")
    }

    /// The next token, in which there is no comment.
    fn word(&mut self) -> Option<String> {
        let end = |text: &[u8]| text.iter().position(|byte| is_space(*byte));
        let (word, rest) = token(self.pieces.rest(), &mut self.line, |text| Some(text.split_at(end(text)?)))?;
        let (word, left) = (str::from_utf8(word).ok()?.to_owned(), rest.len());
        self.pieces.leave(left);
        let usual = !word.is_empty() && !word.starts_with('\u{feff}') && !word.contains('#') && !word.contains("//");
        usual.then_some(word)
    }

    fn whole(&mut self) -> Option<u32> {
        let (whole, rest) = token(self.pieces.rest(), &mut self.line, whole)?;
        let left = rest.len();
        self.pieces.leave(left);
        Some(whole)
    }

    fn numbers<const N: usize>(&mut self) -> Option<[f32; N]> {
        let (mut text, mut line) = (self.pieces.rest(), self.line);
        let mut numbers = [0.0; N];
        for next in &mut numbers {
            (*next, text) = token(text, &mut line, number)?;
        }
        let left = text.len();
        self.pieces.leave(left);
        self.line = line;
        Some(numbers)
    }

    /// A count and as many items, each made of its number from 1, its last line, and what it has in the file.
    fn list<T, const N: usize>(&mut self, mut item: impl FnMut(usize, usize, [f32; N]) -> Option<T>) -> Option<Vec<T>> {
        self.fill()?;
        let count = self.whole()? as usize;
        // A number and the white space before it take two bytes or more.
        if count > self.length / 2 / N {
            return None;
        }
        let mut items = room(count);
        for number in 1..=count {
            self.fill()?;
            let numbers = self.numbers()?;
            items.push(item(number, self.line, numbers)?);
        }
        Some(items)
    }

    /// Whether nothing but white space and comments is left.
    fn is_over(&mut self) -> bool {
        loop {
            let ended = self.fill().map(|()| self.pieces.ended());
            let rest = skip(self.pieces.rest(), &mut self.line);
            match (ended, rest) {
                (Some(true), Some([])) => return true,
                (Some(false), Some([])) => self.pieces.leave(0),
                _ => return false,
            }
        }
    }
}

/// What `read` takes of the next token, which is all of it.
fn token<'a, T>(
    text: &'a [u8],
    line: &mut usize,
    read: impl FnOnce(&'a [u8]) -> Option<(T, &'a [u8])>,
) -> Option<(T, &'a [u8])> {
    read(skip(text, line)?).filter(|(_, rest)| rest.first().is_some_and(|byte| is_space(*byte)))
}

/// What follows white space and comments that end, and its line.
fn skip<'a>(mut text: &'a [u8], line: &mut usize) -> Option<&'a [u8]> {
    loop {
        text = match text {
            [b' ' | b'\t' | 0x0b | 0x0c, rest @ ..] => rest,
            [b'\r', rest @ ..] if rest.first() == Some(&b'\n') => rest,
            [b'\n' | b'\r', rest @ ..] => {
                *line += 1;
                rest
            }
            [b'#', ..] | [b'/', b'/', ..] => {
                let (comment, rest) = text.split_at(text.iter().position(|byte| is_line_end(*byte))?);
                str::from_utf8(comment).ok()?;
                rest
            }
            _ => return Some(text),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::pieces::{LONGEST, PIECE};
    use super::super::{Camera, Scene, many, parse_with_care};
    use super::read;

    /// What is read in bulk, which is what is read with care.
    fn in_bulk(text: &str) -> Option<Scene> {
        let opened = read(text.as_bytes(), text.len(), "test")?;
        assert!(opened.warnings.is_empty());
        assert!(opened.scene == parse_with_care(text.as_bytes(), "test").unwrap());
        Some(opened.scene)
    }

    #[test]
    fn a_scene_of_many_pieces_is_read_in_bulk_wherever_these_end() {
        let mut scene = many(4000, 4000, 3);
        scene.camera = Camera::new(3, 2, 1.0, 1.0).unwrap();
        let text = scene.to_text();
        let text: String = text.split_inclusive('\n').filter(|line| !line.starts_with('#')).collect();
        assert!(text.len() > 3 * PIECE);
        let ends =
            [text.replace('\n', "\r\n"), text.replace('\n', " # and so on\n"), text.replace(' ', "\n// \u{e9}\r")];
        for text in ends.into_iter().chain((0..20).map(|spaces| format!("{:spaces$}{text}", ""))) {
            assert!(in_bulk(&text).is_some_and(|read| read == scene));
        }
        // Up to what an object may take, and more.
        assert!(in_bulk(&format!("{text}{}\n", " ".repeat(3 * PIECE))).is_some());
        let (before, after) = text.rsplit_once(' ').unwrap();
        let apart = |count| format!("{before}{}{after}", " ".repeat(count));
        assert!(in_bulk(&apart(LONGEST / 2)).is_some());
        assert!(parse_with_care(apart(2 * PIECE).as_bytes(), "test").is_ok());
    }

    #[test]
    fn what_is_unusual_or_wrong_is_not() {
        const VALID: &str =
            "a.png 2 2 1  1  1 1 1 1 0 0 0  1  1 1 1 1 0 0 5  1  1 1 1 0 0 5 1 0 5 0 1 5 # \u{e9}\n // end";
        assert!(in_bulk(VALID).is_some());
        for (usual, other) in [
            ("a.png", "a.png#"),
            ("a.png", "a//b"),
            ("a.png", "\u{feff}a.png"),
            ("2 2 1", "2 +2 1"),
            ("2 2 1", "2 0 1"),
            ("2 2 1", "2 2 0"),
            ("2 2 1", "2 2.0 1"),
            ("2 2 1", "2 2 1e99"),
            ("1  1 1 1 1 0 0 0", "1  -1 1 1 1 0 0 0"),
            ("1  1 1 1 1 0 0 0", "1  1 1 -1 1 0 0 0"),
            ("1  1 1 1 1 0 0 5", "1  0 1 1 1 0 0 5"),
            ("1  1 1 1 1 0 0 5", "1  1 1 1 1 0-0 5"),
            ("1  1 1 1 1 0 0 5", "1  1 1 1 1 0 nan 5"),
            ("1  1 1 1 1 0 0 5", "99  1 1 1 1 0 0 5"),
            ("// end", "/ end"),
            ("// end", "7"),
            ("0 1 5 #", "0 1"),
            ("0 1 5 #", "0 1 5#"),
        ] {
            let text = VALID.replacen(usual, other, 1);
            assert_ne!(text, VALID);
            assert!(in_bulk(&text).is_none(), "{text}");
        }
        let mut bytes = VALID.as_bytes().to_vec();
        (0..VALID.find('#').unwrap() - 1).for_each(|end| assert!(read(&bytes[..end], end, "test").is_none()));
        let accent = bytes.iter().position(|byte| !byte.is_ascii()).unwrap();
        bytes.remove(accent);
        assert!(read(&bytes[..], bytes.len(), "test").is_none());
    }
}
