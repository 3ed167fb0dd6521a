//! Scenes in the paper's format with the usual layout, read in bulk and piece by piece.
//!
//! Anything unusual or wrong yields None: then [`super::parse`] reads the file again, with care and with words.

use std::collections::BTreeMap;
use std::io::Read;
use std::sync::{Mutex, PoisonError};
use std::thread;

use glam::{DVec3, Vec3};

use super::log::is_line_end;
use super::number::{number, whole};
use super::opened::{NoArea, Opened};
use super::pieces::{PIECE, Pieces};
use super::token::{FILM, is_space};
use super::{Camera, Light, Scene, Sphere, Triangle};
use crate::kernels::sys::room;

/// The scene of a file of `length` bytes, read with that many threads; warnings call it `name`.
pub(super) fn read(file: impl Read + Send, length: usize, name: &str, threads: usize) -> Option<Opened> {
    let mut text = Text { pieces: Pieces::new(file, length), length, line: 1, threads };
    text.fill()?;
    let image = text.word()?;
    let (width, height) = (text.whole()?, text.whole()?);
    let [focal] = text.numbers()?;
    let camera = Camera::new(width, height, focal, FILM).ok()?;
    let (lights, _) = text.list(|[intensity, r, g, b, x, y, z]| {
        let light =
            Light { intensity: not_negative(intensity)?, colour: colour(r, g, b)?, position: Vec3::new(x, y, z) };
        Some((light, true))
    })?;
    let (spheres, _) = text.list(|[radius, r, g, b, x, y, z]| {
        let sphere = Sphere { radius, colour: colour(r, g, b)?, centre: Vec3::new(x, y, z) };
        (radius > 0.0).then_some((sphere, true))
    })?;
    let (triangles, flat) = text.list(|[r, g, b, x1, y1, z1, x2, y2, z2, x3, y3, z3]| {
        let vertices = [Vec3::new(x1, y1, z1), Vec3::new(x2, y2, z2), Vec3::new(x3, y3, z3)];
        let triangle = Triangle { colour: colour(r, g, b)?, vertices };
        Some((triangle, !triangle.has_no_area()))
    })?;
    let mut no_area = NoArea::default();
    flat.iter().for_each(|(at, line)| no_area.add(name, &format!("triangle {}", at + 1), || *line));
    let scene = Scene { name: image, lights, spheres, triangles, ..Scene::new(camera) };
    text.is_over().then(|| Opened { scene, up: DVec3::Y, notes: Vec::new(), warnings: no_area.warnings(name) })
}

fn colour(red: f32, green: f32, blue: f32) -> Option<Vec3> {
    Some(Vec3::new(not_negative(red)?, not_negative(green)?, not_negative(blue)?))
}

/// -0 becomes +0.
fn not_negative(number: f32) -> Option<f32> {
    (number >= 0.0).then_some(number + 0.0)
}

/// A file of this length, and the number of the next line, from 1.
struct Text<R> {
    pieces: Pieces<R>,
    length: usize,
    line: usize,
    /// The threads that may read it, at least 1.
    threads: usize,
}

/// Items of a list; and the places of those that need a warning, each with its line.
type Items<T> = (Vec<T>, Vec<(usize, usize)>);

/// Lines, with their items and the number of lines, if they hold nothing else.
type Piece<T> = (Vec<u8>, Option<(Items<T>, usize)>);

/// What several threads have read of a list.
struct Shared<'a, T, R> {
    text: &'a mut Text<R>,
    items: Items<T>,
    /// The number of pieces taken, and how many of the first ones have their items in `items`.
    taken: usize,
    joined: usize,
    /// Pieces that finished out of order, by their number.
    early: BTreeMap<usize, Piece<T>>,
    /// Whether a piece holds something other than items.
    over: bool,
}

impl<R: Read + Send> Text<R> {
    /// Has the bytes of an object at hand.
    fn fill(&mut self) -> Option<()> {
        self.pieces.fill(b"\n")
    }

    /// The next token, if no comment begins in it.
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
        let (numbers, rest) = numbers(self.pieces.rest(), &mut self.line)?;
        let left = rest.len();
        self.pieces.leave(left);
        Some(numbers)
    }

    /// A count and that many items, each made by `item`, which also says whether it is free of warnings.
    fn list<T: Send, const N: usize>(
        &mut self,
        item: impl Fn([f32; N]) -> Option<(T, bool)> + Sync,
    ) -> Option<Items<T>> {
        self.fill()?;
        let count = self.whole()? as usize;
        // A number and the white space before it take two bytes or more.
        if count > self.length / 2 / N {
            return None;
        }
        let mut items = (room(count), Vec::new());
        if self.threads > 1 && 2 * N * count > PIECE {
            items = self.together(items, count, &item);
        }
        while items.0.len() < count {
            self.fill()?;
            let numbers = self.numbers()?;
            push(&mut items, item(numbers)?, self.line);
        }
        Some(items)
    }

    /// Has threads read at most that many items, from pieces that hold whole lines of them and nothing else.
    fn together<T: Send, const N: usize>(
        &mut self,
        items: Items<T>,
        count: usize,
        item: &(impl Fn([f32; N]) -> Option<(T, bool)> + Sync),
    ) -> Items<T> {
        let others = (self.threads - 1).min(self.length / PIECE);
        // A thread that waits for its turn to run would hold up the rest of the file.
        let most_early = 4 * self.threads;
        let shared = Shared { text: self, items, taken: 0, joined: 0, early: BTreeMap::new(), over: false };
        let shared = Mutex::new(shared);
        let lock = || shared.lock().unwrap_or_else(PoisonError::into_inner);
        let work = || {
            let mut done = None;
            loop {
                let mut shared = lock();
                shared.join(done.take(), count);
                if shared.over || shared.items.0.len() == count {
                    break;
                }
                if shared.early.len() >= most_early {
                    drop(shared);
                    thread::yield_now();
                    continue;
                }
                let Some(lines) = shared.text.pieces.take_lines() else {
                    shared.over = true;
                    break;
                };
                let number = shared.taken;
                shared.taken += 1;
                drop(shared);
                let read = items_of(&lines, item);
                done = Some((number, (lines, read)));
            }
        };
        thread::scope(|scope| {
            for _ in 0..others {
                // The threads that run do all of it.
                if thread::Builder::new().spawn_scoped(scope, work).is_err() {
                    break;
                }
            }
            work();
        });
        let Shared { text, items, early, .. } = shared.into_inner().unwrap_or_else(PoisonError::into_inner);
        early.values().rev().for_each(|(lines, _)| text.pieces.give_back(lines));
        items
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

impl<T, R> Shared<'_, T, R> {
    /// Takes the items of a piece, and of later ones that finished before it.
    fn join(&mut self, piece: Option<(usize, Piece<T>)>, count: usize) {
        self.early.extend(piece);
        while let Some(first) = self.early.first_entry().filter(|first| *first.key() == self.joined) {
            match &mut first.into_mut().1 {
                Some(((items, told), lines)) if !self.over && self.items.0.len() + items.len() <= count => {
                    let (before, line) = (self.items.0.len(), &mut self.text.line);
                    self.items.1.extend(told.iter().map(|(at, of_piece)| (before + at, *line + of_piece)));
                    self.items.0.append(items);
                    *line += *lines;
                }
                _ => {
                    self.over = true;
                    return;
                }
            }
            self.early.pop_first();
            self.joined += 1;
        }
    }
}

/// The items of these lines, and the number of lines; None if there is anything else.
fn items_of<T, const N: usize>(
    mut text: &[u8],
    item: impl Fn([f32; N]) -> Option<(T, bool)>,
) -> Option<(Items<T>, usize)> {
    let (mut items, mut line) = ((Vec::new(), Vec::new()), 0);
    loop {
        text = skip(text, &mut line)?;
        if text.is_empty() {
            return Some((items, line));
        }
        let (numbers, rest) = numbers(text, &mut line)?;
        push(&mut items, item(numbers)?, line);
        text = rest;
    }
}

fn push<T>(items: &mut Items<T>, (item, is_usual): (T, bool), line: usize) {
    if !is_usual {
        items.1.push((items.0.len(), line));
    }
    items.0.push(item);
}

/// The next numbers, and what follows them.
fn numbers<'a, const N: usize>(mut text: &'a [u8], line: &mut usize) -> Option<([f32; N], &'a [u8])> {
    let mut numbers = [0.0; N];
    for next in &mut numbers {
        (*next, text) = token(text, line, number)?;
    }
    Some((numbers, text))
}

/// The value that `read` makes of the next token, if it takes all of it.
fn token<'a, T>(
    text: &'a [u8],
    line: &mut usize,
    read: impl FnOnce(&'a [u8]) -> Option<(T, &'a [u8])>,
) -> Option<(T, &'a [u8])> {
    read(skip(text, line)?).filter(|(_, rest)| rest.first().is_some_and(|byte| is_space(*byte)))
}

/// What follows white space and complete comments, and its line.
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
    use super::super::parse::opened_with_care;
    use super::super::pieces::{LONGEST, PIECE};
    use super::super::{Camera, Scene, many, parse_with_care};
    use super::read;

    /// A scene read in bulk, with any number of threads, which must equal the one read with care.
    fn in_bulk(text: &str) -> Option<Scene> {
        let [opened, by_several] = [1, 3].map(|threads| read(text.as_bytes(), text.len(), "test", threads));
        assert!(opened == by_several);
        let opened = opened?;
        assert!(opened == opened_with_care(text.as_bytes(), "test").unwrap());
        Some(opened.scene)
    }

    #[test]
    fn a_scene_of_many_pieces_is_read_in_bulk_wherever_these_end() {
        let mut scene = many(10_000, 10_000, 3);
        scene.camera = Camera::new(3, 2, 1.0, 1.0).unwrap();
        // Warnings, with lines from several pieces.
        (0..9).for_each(|i| scene.triangles[1100 * i].vertices[2] = scene.triangles[1100 * i].vertices[0]);
        let text = scene.to_text();
        let text: String = text.split_inclusive('\n').filter(|line| !line.starts_with('#')).collect();
        assert!(text.len() > 9 * PIECE);
        let ends =
            [text.replace('\n', "\r\n"), text.replace('\n', " # and so on\n"), text.replace(' ', "\n// \u{e9}\r")];
        for text in ends.into_iter().chain((0..5).map(|spaces| format!("{:spaces$}{text}", ""))) {
            assert!(in_bulk(&text).is_some_and(|read| read == scene));
        }
        // Something unusual in any of the pieces.
        for at in (0..text.len()).step_by(text.len() / 5) {
            let at = at + text[at..].find('\n').unwrap();
            assert!(in_bulk(&format!("{} ?{}", &text[..at], &text[at..])).is_none());
        }
        // Up to the longest that an object may be, and beyond.
        assert!(in_bulk(&format!("{text}{}\n", " ".repeat(3 * PIECE))).is_some());
        let (before, after) = text.rsplit_once(' ').unwrap();
        let apart = |count| format!("{before}{}{after}", " ".repeat(count));
        assert!(in_bulk(&apart(LONGEST / 2)).is_some());
        assert!(parse_with_care(apart(2 * PIECE).as_bytes(), "test").is_ok());
    }
}
