//! XYZ: either frames, each of a count, a comment line and as many atoms, or a plain list of
//! atoms or points, one per line.

use std::io::Read;

use glam::Vec3;
use memchr::memrchr;

use super::elements::Kind;
use super::words::{Words, is_blank, whole};
use super::{Cloud, Entry, Made, Stop, no_such_frame};
use crate::scene::MeshError;
use crate::scene::diagnostic::brief;
use crate::scene::mesh::colour::{level_to_linear, to_linear};
use crate::scene::pieces::Pieces;

/// The bytes of the shortest line of a point: "0 0 0" and a line end.
const SHORTEST_POINT: usize = 6;

/// Which words of a line hold what: indices into its words.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Columns {
    /// The symbol, the label or the atomic number of an element.
    label: Option<usize>,
    /// The x coordinate; y and z follow.
    place: usize,
    radius: Option<usize>,
    /// The red channel, which green and blue follow, and the number that stands for a full
    /// channel (1 or 255).
    colour: Option<(usize, f64)>,
    /// The number of words in the first line.
    words: usize,
}

/// Reads the atoms or points of a frame, or of a list; `frame` is the frame's number from 1.
pub(super) fn read(pieces: &mut Pieces<impl Read>, length: usize, frame: Option<usize>) -> Result<Cloud, Stop> {
    let mut file = File { pieces, length, line: 0, notes: Vec::new() };
    match file.count()? {
        Some(count) => file.frames(count, frame),
        None => file.list(frame),
    }
}

struct File<'a, R> {
    pieces: &'a mut Pieces<R>,
    length: usize,
    /// The number of lines read so far.
    line: usize,
    notes: Vec<String>,
}

impl<R: Read> File<'_, R> {
    /// The atom count that begins a frame: the number in the next non-blank line, if that line
    /// is a non-negative integer alone. Otherwise the line is left unread.
    fn count(&mut self) -> Result<Option<usize>, Stop> {
        loop {
            self.pieces.fill().ok_or(Stop::Unread)?;
            let rest = self.pieces.rest();
            let end = rest.iter().position(|byte| *byte == b'\n').unwrap_or(rest.len());
            let line = &rest[..end];
            let count = match Words::of(line).all() {
                [] => None,
                [word] => match whole(word) {
                    Some(count) => Some(count),
                    None => return Ok(None),
                },
                _ => return Ok(None),
            };
            if self.next_line()?.is_none() || count.is_some() {
                return Ok(count);
            }
        }
    }

    fn next_line(&mut self) -> Result<Option<&[u8]>, Stop> {
        self.line += 1;
        Ok(self.pieces.line()?)
    }

    fn fault(&self, message: impl Into<String>, expected: impl Into<String>) -> Stop {
        MeshError::new(message).line(self.line).expected(expected).into()
    }

    /// Reads frame number `frame` of several. The first frame's atom count, `count`, has been
    /// read, and its comment is the next line.
    fn frames(&mut self, mut count: usize, frame: Option<usize>) -> Result<Cloud, Stop> {
        for number in 1..frame.unwrap_or(1) {
            self.check_room(count)?;
            for _ in 0..=count {
                if self.next_line()?.is_none() {
                    return Err(self.cut_off(count, "a line", "lines"));
                }
            }
            count = match self.count()? {
                Some(count) => count,
                None => return Err(no_such_frame(number + 1, number, ["frame", "frames"]).into()),
            };
        }
        self.check_room(count)?;
        let comment = self.next_line()?.unwrap_or_default().to_vec();
        let named = named_columns(&comment);
        let cloud = self.atoms(count, named)?;
        Ok(cloud)
    }

    fn check_room(&self, count: usize) -> Result<(), Stop> {
        let most = self.length / SHORTEST_POINT + 1;
        if count <= most {
            return Ok(());
        }
        let message = format!("a frame of {count} atoms is announced, and the file has no room for so many");
        Err(self.fault(message, format!("at most {most}: the file has {} bytes", self.length)))
    }

    fn cut_off(&self, count: usize, what: &str, many: &str) -> Stop {
        let fault = MeshError::new(format!("the file ends where {what} of a frame is expected"));
        fault.expected(format!("{count} {many}, as the frame's first line says")).into()
    }

    /// The atoms of a frame, in the columns that its comment names, or else in those that its
    /// first line suggests.
    fn atoms(&mut self, count: usize, named: Option<Columns>) -> Result<Cloud, Stop> {
        let mut columns = named;
        let mut made = Made::default();
        let mut is_molecule = true;
        for number in 1..=count {
            self.line += 1;
            let Some(line) = self.pieces.line()? else {
                self.line -= 1;
                return Err(self.cut_off(count, &format!("atom {number}"), "atoms"));
            };
            let words = Words::of(line);
            let columns = *columns.get_or_insert_with(|| columns_of_frame(&words));
            if number == 1 {
                is_molecule = columns.label.is_some();
                made = if is_molecule { Made::in_room_for_atoms(count) } else { Made::default() };
            }
            let what = if is_molecule { "atom" } else { "point" };
            match columns.entry(&words) {
                Some(entry) if entry.single.is_finite() => made.push(&entry),
                Some(_) if !is_molecule => made.placeless += 1,
                Some(_) => {
                    return Err(self.fault(format!("{what} {number} has no finite place"), columns.expected()));
                }
                None => {
                    let found = brief(&String::from_utf8_lossy(line));
                    let message = format!("{what} {number} cannot be understood: `{found}`");
                    return Err(self.fault(message, columns.expected()));
                }
            }
        }
        self.note_unread_columns(columns);
        self.note_rest()?;
        Ok(made.finish(is_molecule, std::mem::take(&mut self.notes))?)
    }

    /// Adds a note if anything follows the frame that was read.
    fn note_rest(&mut self) -> Result<(), Stop> {
        let note = match self.count()? {
            Some(_) => "the file has several frames, and this is one of them: --frame N shows another",
            None if self.pieces.rest().trim_ascii().is_empty() => return Ok(()),
            None => "the file goes on after the atoms that its first line counts: what follows was not read",
        };
        self.notes.push(note.to_owned());
        Ok(())
    }

    fn note_unread_columns(&mut self, columns: Option<Columns>) {
        if columns.is_some_and(|columns| columns.words > columns.fewest_words()) {
            self.notes.push("columns of other numbers, such as charges and normals, were not read".to_owned());
        }
    }

    /// Reads all lines as a list of atoms or points.
    fn list(&mut self, frame: Option<usize>) -> Result<Cloud, Stop> {
        if let Some(frame) = frame.filter(|frame| *frame > 1) {
            return Err(no_such_frame(frame, 1, ["frame", "frames"]).into());
        }
        self.skip_title()?;
        let Some(columns) = columns_of_list(self.pieces.rest(), self.pieces.ended()) else {
            let expected = "lines of x y z, of an element and x y z, or the number of atoms in the first line";
            return Err(match self.next_line()? {
                Some(line) => {
                    let found = brief(&String::from_utf8_lossy(line));
                    self.fault(format!("`{found}` is neither an atom nor a point"), expected)
                }
                None => MeshError::new("the file has no atoms").expected(expected).into(),
            });
        };
        let is_molecule = columns.label.is_some();
        let what = if is_molecule { "atom" } else { "point" };
        let mut made = Made::default();
        loop {
            self.line += 1;
            let Some(line) = self.pieces.line()? else { break };
            let words = Words::of(line);
            match columns.entry(&words) {
                Some(entry) if entry.single.is_finite() => made.push(&entry),
                Some(_) => made.placeless += 1,
                None if is_blank(line) => {}
                None => {
                    let number = made.len() + made.placeless + 1;
                    let found = brief(&String::from_utf8_lossy(line));
                    let message = format!("{what} {number} cannot be understood: `{found}`");
                    return Err(self.fault(message, columns.expected()));
                }
            }
        }
        self.note_unread_columns(Some(columns));
        Ok(made.finish(is_molecule, std::mem::take(&mut self.notes))?)
    }

    /// Skips comments, and a first line that names the columns.
    fn skip_title(&mut self) -> Result<(), Stop> {
        let mut is_first = true;
        loop {
            self.pieces.fill().ok_or(Stop::Unread)?;
            let rest = self.pieces.rest();
            let end = rest.iter().position(|byte| *byte == b'\n').unwrap_or(rest.len());
            let line = &rest[..end];
            let words = Words::of(line);
            let has_number = (0..words.all().len()).any(|index| words.number(index).is_some());
            let is_title = is_first && !has_number && words.all().len() >= 3;
            if rest.is_empty() || !(is_blank(line) || is_title) {
                return Ok(());
            }
            is_first &= is_blank(line);
            self.next_line()?;
        }
    }
}

impl Columns {
    /// The fewest words that each line must have.
    fn fewest_words(&self) -> usize {
        let ends = [self.label.map(|at| at + 1), self.radius.map(|at| at + 1), self.colour.map(|(at, _)| at + 3)];
        ends.into_iter().flatten().fold(self.place + 3, usize::max)
    }

    fn expected(&self) -> &'static str {
        match self {
            Columns { label: Some(_), .. } => "an element and three numbers, as in: C 0.0 1.2 -0.5",
            Columns { colour: Some(_), .. } => "three numbers, x y z, and a colour",
            _ => "three numbers: x y z",
        }
    }

    /// The atom or point that a line of these words describes.
    #[inline]
    fn entry(&self, words: &Words<'_>) -> Option<Entry> {
        let (single, double) = words.point(self.place)?;
        let kind = match self.label {
            Some(at) => Some(kind(words.get(at)?)),
            None => None,
        };
        let radius = match self.radius {
            Some(at) => Some(words.number(at)?.single).filter(|radius| radius.is_finite() && *radius > 0.0),
            None => None,
        };
        if self.radius.is_some() && radius.is_none() {
            return None;
        }
        let colour = match self.colour {
            Some((at, highest)) => Some(colour(words, at, highest)?),
            None => None,
        };
        Some(Entry { single, double, kind, radius, colour })
    }
}

/// The element that a label or an atomic number names.
#[inline]
fn kind(label: &[u8]) -> Kind {
    match label.first() {
        Some(byte) if byte.is_ascii_digit() => {
            let number = whole(label).and_then(|number| u32::try_from(number).ok());
            number.and_then(Kind::of_number).unwrap_or(Kind::UNKNOWN)
        }
        _ => Kind::of_label(label),
    }
}

/// The colour in linear light of the three words from index `at` on; `highest` stands for a
/// full channel.
fn colour(words: &Words<'_>, at: usize, highest: f64) -> Option<Vec3> {
    let channel = |index: usize| {
        let level = words.number(at + index)?.double;
        let byte = level as u8;
        let is_level = highest == f64::from(u8::MAX) && f64::from(byte) == level;
        Some(if is_level { level_to_linear(byte) } else { to_linear(level / highest) })
    };
    Some(Vec3::new(channel(0)?, channel(1)?, channel(2)?))
}

/// The columns of a frame that does not name them, guessed from its first line: an element's
/// symbol or atomic number and three coordinates, or coordinates alone.
fn columns_of_frame(first: &Words<'_>) -> Columns {
    let words = first.all().len();
    let begins_with_label = first.number(0).is_none() || words > 3 && first.get(0).and_then(whole).is_some();
    let label = begins_with_label.then_some(0);
    Columns { label, place: usize::from(begins_with_label), radius: None, colour: None, words }
}

/// The columns that the comment of a frame names, as in `Properties=species:S:1:pos:R:3:radius:R:1`
/// (extended XYZ).
fn named_columns(comment: &[u8]) -> Option<Columns> {
    const KEY: &str = "properties=";
    let comment = String::from_utf8_lossy(comment).to_ascii_lowercase();
    let list = comment[comment.find(KEY)? + KEY.len()..].split_whitespace().next()?.trim_matches('"');
    let mut columns = Columns { label: None, place: 0, radius: None, colour: None, words: 0 };
    let mut place = None;
    let mut parts = list.split(':');
    while let (Some(name), Some(_), Some(count)) = (parts.next(), parts.next(), parts.next()) {
        let at = columns.words;
        let count: usize = count.parse().ok().filter(|count| *count < 1000)?;
        match (name, count) {
            ("species" | "element" | "z", 1) if columns.label.is_none() => columns.label = Some(at),
            ("pos", 3) => place = Some(at),
            ("radius", 1) => columns.radius = Some(at),
            ("color" | "colour", 3) => columns.colour = Some((at, 1.0)),
            _ => {}
        }
        columns.words += count;
    }
    place.map(|place| Columns { place, ..columns })
}

/// The columns of a list, guessed from its first lines. `has_ended` tells whether `text` is all
/// of the file.
fn columns_of_list(text: &[u8], has_ended: bool) -> Option<Columns> {
    /// The number of lines that the guess is based on: whole numbers from 0 to 255 in so many lines are
    /// colours, and are hardly something else.
    const LINES: usize = 200;
    // The last line of `text` may be incomplete, unless the file ends there.
    let end = if has_ended { text.len() } else { memrchr(b'\n', text).unwrap_or(text.len()) };
    let whole_lines = text[..end].split_inclusive(|byte| *byte == b'\n').filter(|line| !is_blank(line));
    let lines: Vec<_> = whole_lines.take(LINES).map(Words::of).collect();
    let first = lines.first()?;
    let words = first.all().len();
    if first.number(0).is_none() {
        first.point(1)?;
        return Some(Columns { label: Some(0), place: 1, radius: None, colour: None, words });
    }
    first.point(0)?;
    // Channels may follow the coordinates directly, or after one more number, such as an
    // intensity.
    let colour = [3, 4].into_iter().find_map(|at| Some((at, highest_channel(&lines, at)?)));
    Some(Columns { label: None, place: 0, radius: None, colour, words })
}

/// The number that stands for a full channel, if the three words from index `at` on look like
/// colours in all lines: 255 if all are integers up to 255, or 1 if all are up to 1 and are no
/// normals (vectors of length 1).
fn highest_channel(lines: &[Words<'_>], at: usize) -> Option<f64> {
    let mut are_levels = true;
    let mut are_shares = true;
    let mut are_normals = true;
    for line in lines {
        let (_, colour) = line.point(at)?;
        let channels = colour.to_array();
        are_levels &= channels.iter().all(|level| level.fract() == 0.0 && (0.0..=255.0).contains(level));
        are_shares &= channels.iter().all(|share| (0.0..=1.0).contains(share));
        are_normals &= (colour.length() - 1.0).abs() < 0.01;
    }
    match (are_levels, are_shares && !are_normals) {
        // If all are 0 or 1, they are shares: 1 as a full channel.
        (true, false) => Some(255.0),
        (_, true) => Some(1.0),
        (false, false) => None,
    }
}
