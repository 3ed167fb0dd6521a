//! The paper's scene format: a lexer on bytes, and the parser, which reports errors with their
//! lines and columns.

#[cfg(feature = "files")]
pub(super) mod streamed;

use std::fmt;
use std::ops::Range;

use glam::Vec3;

use super::log::Log;
use super::misfit::{List, first_misfit};
use super::opened::{NoArea, Opened};
use super::token::{FILM, Kind, next_token};
use super::{Camera, Light, MAX_PIXELS, MAX_SIDE, Scene, SceneError, Sphere, Triangle};
use crate::kernels::StandardFloats;
use crate::kernels::sys::room;

/// Reads a scene in the paper's format; `name` is what diagnostics call the file.
///
/// Tokens are separated by white space. `#` and `//` start a comment anywhere, even within a token;
/// it runs to the end of the line (LF, CR LF or CR). A UTF-8 byte order mark is skipped. The
/// camera's film diagonal is 1. A negative zero in an intensity or a colour becomes 0.
///
/// # Errors
/// [`SceneError::Invalid`] with up to 20 diagnostics. After an invalid value parsing continues; an
/// invalid count, the end of the file or a byte that is not UTF-8 ends it. The memory used stays
/// within a small multiple of the length of `source`, whatever the counts claim; the time is linear
/// in that length.
pub fn parse(source: &[u8], name: &str) -> Result<Scene, SceneError> {
    Ok(parse_with_warnings(source, name)?.scene)
}

/// As [`parse`], with a warning for each triangle without area.
pub(super) fn parse_with_warnings(source: &[u8], name: &str) -> Result<Opened, SceneError> {
    let _floats = StandardFloats::set();
    let mut log = Log::new(source);
    let mut no_area = NoArea::default();
    let scene = log.text().and_then(|(text, start)| {
        let (log, no_area) = (&mut log, &mut no_area);
        let last = start..start;
        Parser { name, text, at: start, last, tokens: 0, lists: Vec::new(), announced: None, log, no_area }.scene().ok()
    });
    let scene = log.finish(scene, name)?;
    Ok(Opened { scene, files: Vec::new(), notes: Vec::new(), carried_light: None, warnings: no_area.warnings(name) })
}

/// Parsing cannot continue; the reason has been noted.
struct Stop;

/// The help for a number with a comma in it.
pub(super) const COMMA_HELP: &str = "the decimal mark is a point, and white space alone separates numbers";

/// What a number has to satisfy.
#[derive(Clone, Copy)]
pub(super) enum Rule {
    Any,
    NotNegative,
    Positive,
}

/// Why a token is not a valid number.
pub(super) struct Problem {
    pub(super) what: &'static str,
    pub(super) help: Option<&'static str>,
}

/// What diagnostics call a number: "the width", "sphere 3's radius".
#[derive(Clone, Copy)]
struct Field {
    owner: Option<ListItem>,
    part: &'static str,
}

/// An item of a list: the kind of list and the item's number from 1.
#[derive(Clone, Copy)]
struct ListItem {
    one: &'static str,
    number: u64,
}

const LIGHTS: Kind = Kind { one: "light", many: "lights", count: "the light count", tokens: 7 };
const SPHERES: Kind = Kind { one: "sphere", many: "spheres", count: "the sphere count", tokens: 7 };
const TRIANGLES: Kind = Kind { one: "triangle", many: "triangles", count: "the triangle count", tokens: 12 };
const COLOUR: [&str; 3] = ["red", "green", "blue"];
const POSITION: [&str; 3] = ["x", "y", "z"];
const VERTEX_FIELDS: [[&str; 3]; 3] = [["x1", "y1", "z1"], ["x2", "y2", "z2"], ["x3", "y3", "z3"]];

struct Parser<'a, 'b> {
    name: &'b str,
    text: &'a str,
    /// The byte offset of the next token or of the space before it.
    at: usize,
    /// The byte range of the last token.
    last: Range<usize>,
    /// The number of tokens read so far.
    tokens: usize,
    /// The lists whose counts have been read.
    lists: Vec<List>,
    /// The list whose count was read last.
    announced: Option<Announced>,
    log: &'b mut Log<'a>,
    no_area: &'b mut NoArea,
}

/// A list's count that has been read, and the line it is in.
struct Announced {
    line: usize,
    count: u64,
    kind: &'static Kind,
}

/// A source of the values of a scene, in the order of the format: a whole text, or a file read
/// piece by piece.
trait SceneSource {
    /// The image's width and height.
    fn size(&mut self) -> Result<(u32, u32), Stop>;

    /// A number rounded to f32.
    fn number(&mut self, field: Field, rule: Rule) -> Result<f32, Stop>;

    /// The number of items of a list.
    fn count(&mut self, kind: &'static Kind) -> Result<u64, Stop>;

    /// May append some of the next `count` triangles, if several threads can read them; the others
    /// are read one by one.
    fn first_triangles(&mut self, _count: u64, _triangles: &mut Vec<Triangle>) -> Result<(), Stop> {
        Ok(())
    }

    /// The next triangle, if its text has the form that nearly all have and is in memory as a
    /// whole; None if its numbers have to be read one by one.
    fn usual_triangle(&mut self) -> Option<Triangle> {
        None
    }

    /// Warns that the triangle read last has no area.
    fn note_no_area(&mut self, triangle: ListItem) -> Result<(), Stop>;

    /// Checks that nothing follows.
    fn end(&mut self) -> Result<(), Stop>;
}

/// Reads the part of a scene after the image name.
fn scene(name: &str, parts: &mut impl SceneSource) -> Result<Scene, Stop> {
    let (width, height) = parts.size()?;
    let focal = parts.number(Field { owner: None, part: "the focal distance" }, Rule::Positive)?;
    let lights = list(parts, &LIGHTS, none_ahead, |parts, light| {
        let intensity = parts.number(light.part("intensity"), Rule::NotNegative)?;
        let colour = vector(parts, light, COLOUR, Rule::NotNegative)?;
        Ok(Light { intensity, colour, position: vector(parts, light, POSITION, Rule::Any)? })
    })?;
    let spheres = list(parts, &SPHERES, none_ahead, |parts, sphere| {
        let radius = parts.number(sphere.part("radius"), Rule::Positive)?;
        let colour = vector(parts, sphere, COLOUR, Rule::NotNegative)?;
        Ok(Sphere { radius, colour, centre: vector(parts, sphere, POSITION, Rule::Any)? })
    })?;
    let triangles = list(parts, &TRIANGLES, SceneSource::first_triangles, |parts, triangle| {
        let item = match parts.usual_triangle() {
            Some(item) => item,
            None => {
                let colour = vector(parts, triangle, COLOUR, Rule::NotNegative)?;
                let mut vertex = |names| vector(parts, triangle, names, Rule::Any);
                let [a, b, c] = VERTEX_FIELDS;
                Triangle { colour, vertices: [vertex(a)?, vertex(b)?, vertex(c)?] }
            }
        };
        if item.has_no_area() {
            parts.note_no_area(triangle)?;
        }
        Ok(item)
    })?;
    parts.end()?;
    // Any error of the camera's numbers has been noted above.
    let camera = Camera::new(width, height, focal, FILM).map_err(|_| Stop)?;
    Ok(Scene { name: name.to_owned(), lights, spheres, triangles, ..Scene::new(camera) })
}

fn vector(parts: &mut impl SceneSource, of: ListItem, [x, y, z]: [&'static str; 3], rule: Rule) -> Result<Vec3, Stop> {
    let mut number = |part| parts.number(of.part(part), rule);
    Ok(Vec3::new(number(x)?, number(y)?, number(z)?))
}

/// Reads a list: its count, then the items. `ahead` may read the first of them; the others are read
/// one by one.
fn list<T, P: SceneSource>(
    parts: &mut P,
    kind: &'static Kind,
    ahead: impl Fn(&mut P, u64, &mut Vec<T>) -> Result<(), Stop>,
    item: impl Fn(&mut P, ListItem) -> Result<T, Stop>,
) -> Result<Vec<T>, Stop> {
    let count = parts.count(kind)?;
    // `count` has checked that the file has enough bytes for so many items.
    let mut items = room(count as usize);
    ahead(parts, count, &mut items)?;
    for number in items.len() as u64 + 1..=count {
        items.push(item(parts, ListItem { one: kind.one, number })?);
    }
    Ok(items)
}

/// Reads no item, so that all are read one by one.
fn none_ahead<T, P: SceneSource>(_: &mut P, _count: u64, _items: &mut Vec<T>) -> Result<(), Stop> {
    Ok(())
}

impl<'a> Parser<'a, '_> {
    fn scene(mut self) -> Result<Scene, Stop> {
        let Some(name) = self.token() else {
            let message = if self.at == self.last.end { "the file is empty" } else { "the file holds no scene" };
            let expected = "an image name, then the image's width and height";
            self.log.note(self.last.clone(), format_args!("{message}"), expected, None);
            return Err(Stop);
        };
        let name = &self.text[name];
        let scene = scene(name, &mut self);
        // Put the first line that does not hold a whole item first, since it may be the cause of
        // the errors.
        if let Some(line) = self.log.first_mut().map(|first| first.line)
            && let Some(misfit) = first_misfit(self.text, &self.lists, line)
            && let Some(first) = self.log.first_mut()
        {
            let help = first.help.take().map_or_else(String::new, |help| format!("{help}; "));
            first.help = Some(format!("{help}{misfit}: look there first"));
        }
        if let Some(first) = self.log.first_mut()
            && name.parse::<f64>().is_ok()
        {
            // A missing name shifts all values, so that an error occurs far from its cause.
            let help = "the file's first token is the image name, and here it is a number: is the name missing?";
            first.help = Some(help.to_owned());
        }
        scene
    }

    /// The byte range of the next token, or `None` at the end of the file.
    fn token(&mut self) -> Option<Range<usize>> {
        let Some(token) = next_token(self.text.as_bytes(), self.at) else {
            self.at = self.text.len();
            return None;
        };
        self.at = token.end;
        self.tokens += 1;
        self.last = token.clone();
        Some(token)
    }

    /// The next token; an error if the file ends.
    fn wanted(&mut self, field: Field, expected: &str) -> Result<&'a str, Stop> {
        if let Some(token) = self.token() {
            return Ok(&self.text[token]);
        }
        let list = self.announced.as_ref().filter(|_| field.owner.is_some());
        let help = list.map(|list| format!("{list}: add what is missing or correct the count"));
        // Report the position just after the last token: the file may end many empty lines later.
        self.log.note(self.last.end..self.last.end, format_args!("{field} is missing"), expected, help);
        Err(Stop)
    }

    /// The width or height of the image. An invalid one is noted and replaced by 1.
    fn side(&mut self, part: &'static str) -> Result<u32, Stop> {
        let expected = format!("a whole number from 1 to {MAX_SIDE}");
        let problem = match whole(self.wanted(Field { owner: None, part }, &expected)?) {
            Ok(0) => "is 0",
            Ok(side) if side > u64::from(MAX_SIDE) => "is too large",
            Ok(side) => return Ok(side as u32),
            Err(problem) => problem,
        };
        self.log.note(self.last.clone(), format_args!("{part} {problem}"), &expected, None);
        Ok(1)
    }

    /// The number of tokens left; reads them.
    fn remaining(&mut self) -> usize {
        std::iter::from_fn(|| self.token()).count()
    }
}

impl SceneSource for Parser<'_, '_> {
    fn size(&mut self) -> Result<(u32, u32), Stop> {
        let width = self.side("the width")?;
        let height = self.side("the height")?;
        if u64::from(width) * u64::from(height) > MAX_PIXELS {
            let message = format_args!("an image of {width} x {height} has more than {MAX_PIXELS} pixels");
            let expected = format!("a height of at most {} for that width", MAX_PIXELS / u64::from(width));
            self.log.note(self.last.clone(), message, &expected, None);
        }
        Ok((width, height))
    }

    /// A number rounded to f32. An invalid one is noted and replaced by 1.
    fn number(&mut self, field: Field, rule: Rule) -> Result<f32, Stop> {
        let token = self.wanted(field, rule.expected())?;
        rule.check(token).or_else(|Problem { what, help }| {
            let help = help.map(str::to_owned);
            self.log.note(self.last.clone(), format_args!("{field} {what}"), rule.expected(), help);
            Ok(1.0)
        })
    }

    fn count(&mut self, kind: &'static Kind) -> Result<u64, Stop> {
        let expected = format!("a whole number: how many {} follow (0 for none)", kind.many);
        let count = whole(self.wanted(Field { owner: None, part: kind.count }, &expected)?);
        let place = self.last.clone();
        let (what, expected) = match count {
            // Each token has at least one byte, and so has the white space before it.
            Ok(count) if count <= ((self.text.len() - self.at) / 2 / kind.tokens) as u64 => {
                let line = self.log.line(place.start);
                self.lists.push(List { kind, count, first: self.tokens });
                self.announced = Some(Announced { line, count, kind });
                return Ok(count);
            }
            Ok(_) => {
                let tokens = self.remaining();
                let Kind { one, tokens: each, .. } = kind;
                let most = tokens / each;
                let numbers = if tokens == 1 { "1 number follows" } else { &format!("{tokens} numbers follow") };
                ("is larger than what follows", format!("at most {most}: {numbers}, and a {one} takes {each}"))
            }
            Err(problem) => (problem, expected),
        };
        self.log.note(place, format_args!("{} {what}", kind.count), &expected, None);
        Err(Stop)
    }

    fn note_no_area(&mut self, triangle: ListItem) -> Result<(), Stop> {
        let Parser { log, no_area, name, last, .. } = self;
        no_area.add(name, &triangle.to_string(), || log.line(last.start));
        Ok(())
    }

    /// Notes an error if anything follows the last triangle.
    fn end(&mut self) -> Result<(), Stop> {
        let Some(token) = self.token() else { return Ok(()) };
        let extra = 1 + self.remaining();
        let these = if extra == 1 { "this token" } else { &format!("the {extra} tokens from here on") };
        let help = self.announced.as_ref().map(|list| format!("{list}: correct the count or remove {these}"));
        self.log.note(token, format_args!("the scene is complete here, and more follows"), "the end of the file", help);
        Ok(())
    }
}

impl Rule {
    pub(super) fn expected(self) -> &'static str {
        match self {
            Rule::Any => "a number",
            Rule::NotNegative => "a number of at least 0",
            Rule::Positive => "a number greater than 0",
        }
    }

    /// The token rounded to f32, if that satisfies the rule.
    pub(super) fn check(self, token: &str) -> Result<f32, Problem> {
        let problem = |what, help| Err(Problem { what, help });
        let Ok(number) = token.parse::<f32>() else {
            let comma = token.contains(',');
            return problem("is not a number", comma.then_some(COMMA_HELP));
        };
        // `str::parse` accepts nan, inf and infinity, and returns infinity for numbers that are too
        // large: reject the words, and report the large numbers as such.
        let word = !token.bytes().any(|byte| byte.is_ascii_digit());
        let zero = number == 0.0;
        match self {
            _ if number.is_nan() => problem("is not a number", None),
            _ if number.is_infinite() && word => problem("is infinite", None),
            _ if number.is_infinite() => {
                problem("is out of range", Some("numbers are held as f32: from -3.4028235e38 to 3.4028235e38"))
            }
            Rule::NotNegative if number < 0.0 => problem("is negative", None),
            Rule::Positive if number < 0.0 || zero && token.starts_with('-') => problem("is negative", None),
            Rule::Positive if zero && vanished(token) => {
                problem("rounds to 0", Some("numbers are held as f32: the smallest above 0 is 1e-45"))
            }
            Rule::Positive if zero => problem("is 0", None),
            // Adding 0 turns -0 into +0.
            Rule::NotNegative => Ok(number + 0.0),
            _ => Ok(number),
        }
    }
}

/// Whether a token whose number was rounded to 0 is not 0: a digit before its exponent is not 0.
fn vanished(token: &str) -> bool {
    token.bytes().take_while(|byte| !byte.eq_ignore_ascii_case(&b'e')).any(|byte| matches!(byte, b'1'..=b'9'))
}

/// A non-negative integer, where too large ones become `u64::MAX`, which all limits exclude; or
/// what is wrong with the token.
fn whole(token: &str) -> Result<u64, &'static str> {
    let digits = token.strip_prefix(['+', '-']).unwrap_or(token);
    if digits.is_empty() || !digits.bytes().all(|byte| byte.is_ascii_digit()) {
        return Err("is not a whole number");
    }
    // All characters are digits, so parsing only fails if there are too many.
    match digits.parse().unwrap_or(u64::MAX) {
        number if number > 0 && token.starts_with('-') => Err("is negative"),
        number => Ok(number),
    }
}

impl fmt::Display for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.owner {
            Some(owner) => write!(f, "{owner}'s {}", self.part),
            None => f.write_str(self.part),
        }
    }
}

impl ListItem {
    fn part(self, part: &'static str) -> Field {
        Field { owner: Some(self), part }
    }
}

impl fmt::Display for ListItem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.one, self.number)
    }
}

impl fmt::Display for Announced {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Announced { line, count, kind } = self;
        write!(f, "line {line} announces {count} {}", if *count == 1 { kind.one } else { kind.many })
    }
}
