//! The numbers of PLY elements, parsed from words of text or from bytes of either order.

use glam::{DVec3, Vec3};

use super::super::colour::{level_to_linear, to_linear};
use super::super::number::Number;
use super::header::{Field, Kind, Role, Scalar};
use crate::scene::diagnostic::brief;
use crate::scene::log::is_line_end;

/// Why an element could not be read from the bytes at hand.
#[derive(Debug)]
pub(super) enum Stop {
    /// The bytes end within the element.
    End,
    /// The line ends within the element, although each element has a line of its own.
    LineEnd,
    /// A word or number is not valid for the property.
    Misread(Misread),
}

/// A number that is not valid for its property.
#[derive(Debug)]
pub(super) struct Misread {
    /// What the file has there.
    pub found: String,
    /// What would have been valid.
    pub expected: String,
}

/// A source of an element's numbers, one after the other.
pub(super) trait Numbers {
    /// The next number, which the header declares to be of this type.
    fn number(&mut self, scalar: Scalar) -> Result<Number, Stop>;
}

/// The values of an element that are read.
#[derive(Default)]
pub(super) struct Record {
    /// The vertex's coordinates, rounded to f32 and to f64.
    pub single: Vec3,
    pub double: DVec3,
    pub colour: Vec3,
    pub corners: Vec<i64>,
}

impl Record {
    /// Reads an element. An error comes with the name of the property.
    pub(super) fn read<'a>(&mut self, fields: &[Field<'a>], numbers: &mut impl Numbers) -> Result<(), (Stop, &'a str)> {
        self.corners.clear();
        for field in fields {
            self.read_field(field, numbers).map_err(|stop| (stop, field.name))?;
        }
        Ok(())
    }

    /// Stores a number of a property with this role and type.
    #[inline]
    pub(super) fn set(&mut self, role: Role, scalar: Scalar, number: Number) {
        match role {
            Role::Axis(axis) => {
                self.double[axis] = number.double;
                self.single[axis] = number.single;
            }
            Role::Channel { of, highest } => self.colour[of] = channel(number.double, scalar, highest),
            Role::Corners | Role::Unread => {}
        }
    }

    fn read_field(&mut self, field: &Field<'_>, numbers: &mut impl Numbers) -> Result<(), Stop> {
        match field.kind {
            Kind::Number(scalar) => {
                let number = numbers.number(scalar)?;
                self.set(field.role, scalar, number);
            }
            Kind::List(of_count, scalar) => {
                let count = whole(numbers.number(of_count)?)?;
                if count < 0 {
                    return Err(misread(format!("a list of {count}"), "0 numbers or more"));
                }
                for _ in 0..count {
                    let number = numbers.number(scalar)?;
                    if field.role == Role::Corners {
                        self.corners.push(whole(number)?);
                    }
                }
            }
        }
        Ok(())
    }
}

fn misread(found: impl Into<String>, expected: impl Into<String>) -> Stop {
    Stop::Misread(Misread { found: found.into(), expected: expected.into() })
}

/// A number that must be an integer, of whatever type.
fn whole(number: Number) -> Result<i64, Stop> {
    let number = number.double;
    // Well below 2^53, up to which f64 holds every integer.
    const MOST: f64 = 9e15;
    if number.fract() == 0.0 && number.abs() < MOST {
        Ok(number as i64)
    } else {
        Err(misread(number.to_string(), "a whole number"))
    }
}

/// A channel of a colour, converted to linear light; `highest` stands for a full channel.
fn channel(level: f64, scalar: Scalar, highest: f64) -> f32 {
    // Some programs declare signed bytes for unsigned ones: undo the sign.
    let level = if scalar == Scalar::Char && level < 0.0 { level + 256.0 } else { level };
    let byte = level as u8;
    if highest == f64::from(u8::MAX) && f64::from(byte) == level {
        return level_to_linear(byte);
    }
    to_linear(level / highest)
}

/// The bytes of elements in a binary file.
pub(super) struct Bytes<'a> {
    pub rest: &'a [u8],
    pub is_big_endian: bool,
}

impl Bytes<'_> {
    fn next<const N: usize>(&mut self) -> Result<[u8; N], Stop> {
        let (bytes, rest) = self.rest.split_first_chunk().ok_or(Stop::End)?;
        self.rest = rest;
        let mut bytes = *bytes;
        if self.is_big_endian {
            bytes.reverse();
        }
        Ok(bytes)
    }
}

impl Numbers for Bytes<'_> {
    fn number(&mut self, scalar: Scalar) -> Result<Number, Stop> {
        Ok(Number::of(match scalar {
            Scalar::Char => i8::from_le_bytes(self.next()?).into(),
            Scalar::UChar => u8::from_le_bytes(self.next()?).into(),
            Scalar::Short => i16::from_le_bytes(self.next()?).into(),
            Scalar::UShort => u16::from_le_bytes(self.next()?).into(),
            Scalar::Int => i32::from_le_bytes(self.next()?).into(),
            Scalar::UInt => u32::from_le_bytes(self.next()?).into(),
            // Rounded beyond 2^53, but no vertex index and no level is so large.
            Scalar::Int64 => i64::from_le_bytes(self.next()?) as f64,
            Scalar::UInt64 => u64::from_le_bytes(self.next()?) as f64,
            Scalar::Half => of_half(u16::from_le_bytes(self.next()?)),
            Scalar::Float => f32::from_le_bytes(self.next()?).into(),
            Scalar::Double => f64::from_le_bytes(self.next()?),
        }))
    }
}

/// The value of a 16-bit float (IEEE 754 binary16): a sign, 5 bits of exponent, 10 bits of
/// fraction.
fn of_half(bits: u16) -> f64 {
    let (exponent, fraction) = (i32::from(bits >> 10 & 0x1f), f64::from(bits & 0x3ff) / 1024.0);
    let magnitude = match exponent {
        0 => fraction * 2_f64.powi(-14),
        0x1f if fraction == 0.0 => f64::INFINITY,
        0x1f => f64::NAN,
        _ => (1.0 + fraction) * 2_f64.powi(exponent - 15),
    };
    if bits >> 15 == 1 { -magnitude } else { magnitude }
}

/// The words of elements in a text file, separated by blanks and line ends.
#[derive(Clone)]
pub(super) struct Words<'a> {
    pub rest: &'a [u8],
    /// Whether the file ends with `rest`; otherwise more bytes follow.
    pub ended: bool,
    /// The number of the line that `rest` begins in.
    pub line: usize,
    /// The line of the element's first word, once that has been read.
    pub first_line: Option<usize>,
    /// Whether an element must not continue in another line.
    pub within_a_line: bool,
}

impl Words<'_> {
    /// Skips blanks and line ends.
    fn skip_blanks(&mut self) {
        let blanks = self.rest.iter().position(|byte| !byte.is_ascii_whitespace()).unwrap_or(self.rest.len());
        let (blanks, rest) = self.rest.split_at(blanks);
        self.line += line_ends(blanks);
        self.rest = rest;
    }

    fn next(&mut self) -> Result<&[u8], Stop> {
        self.skip_blanks();
        let end = self.rest.iter().position(u8::is_ascii_whitespace);
        let end = if self.ended { end.unwrap_or(self.rest.len()) } else { end.ok_or(Stop::End)? };
        if end == 0 {
            return Err(Stop::End);
        }
        if self.within_a_line && *self.first_line.get_or_insert(self.line) != self.line {
            return Err(Stop::LineEnd);
        }
        self.first_line.get_or_insert(self.line);
        let (word, rest) = self.rest.split_at(end);
        self.rest = rest;
        Ok(word)
    }

    /// Whether a word follows in the current line.
    pub(super) fn has_more_in_line(&self) -> Result<bool, Stop> {
        match self.rest.iter().find(|byte| !byte.is_ascii_whitespace() || is_line_end(**byte)) {
            Some(byte) => Ok(!is_line_end(*byte)),
            None if self.ended => Ok(false),
            None => Err(Stop::End),
        }
    }

    /// Whether at least `count` lines with words follow.
    pub(super) fn has_lines(&self, count: usize) -> Result<bool, Stop> {
        let lines = self.rest.split(|byte| is_line_end(*byte)).filter(|line| !line.trim_ascii().is_empty());
        match lines.take(count).count() == count {
            false if !self.ended => Err(Stop::End),
            has_lines => Ok(has_lines),
        }
    }

    /// Skips the rest of the line.
    pub(super) fn skip_line(&mut self) -> Result<(), Stop> {
        let end = self.rest.iter().position(|byte| is_line_end(*byte));
        let end = if self.ended { end.unwrap_or(self.rest.len()) } else { end.ok_or(Stop::End)? };
        self.rest = &self.rest[end..];
        Ok(())
    }
}

impl Numbers for Words<'_> {
    fn number(&mut self, scalar: Scalar) -> Result<Number, Stop> {
        let word = self.next()?;
        let number = Number::of_word(word);
        let is_one = |number: &Number| {
            let value = number.double;
            range(scalar).is_none_or(|(least, most)| value.fract() == 0.0 && (least..=most).contains(&value))
        };
        number.filter(is_one).ok_or_else(|| {
            let name = name(scalar);
            let expected = match range(scalar) {
                None => format!("a number, as its type {name} says"),
                Some((least, most)) => format!("a whole number from {least} to {most}, as its type {name} says"),
            };
            misread(brief(&String::from_utf8_lossy(word)), expected)
        })
    }
}

/// The name of a type in a header.
fn name(scalar: Scalar) -> &'static str {
    match scalar {
        Scalar::Char => "char",
        Scalar::UChar => "uchar",
        Scalar::Short => "short",
        Scalar::UShort => "ushort",
        Scalar::Int => "int",
        Scalar::UInt => "uint",
        Scalar::Int64 => "int64",
        Scalar::UInt64 => "uint64",
        Scalar::Half => "float16",
        Scalar::Float => "float",
        Scalar::Double => "double",
    }
}

/// The smallest and the largest number of an integer type; None for floats.
fn range(scalar: Scalar) -> Option<(f64, f64)> {
    let bits = 8 * scalar.bytes() as i32;
    match scalar {
        // Up to 255: some programs declare signed bytes for unsigned ones.
        Scalar::Char => Some((-128.0, 255.0)),
        Scalar::Short | Scalar::Int | Scalar::Int64 => {
            let most = 2_f64.powi(bits - 1);
            Some((-most, most - 1.0))
        }
        Scalar::UChar | Scalar::UShort | Scalar::UInt | Scalar::UInt64 => Some((0.0, 2_f64.powi(bits) - 1.0)),
        Scalar::Half | Scalar::Float | Scalar::Double => None,
    }
}

/// The number of line ends: line feeds, and carriage returns that no line feed follows.
fn line_ends(blanks: &[u8]) -> usize {
    let returns = blanks.iter().enumerate().filter(|(at, byte)| **byte == b'\r' && blanks.get(at + 1) != Some(&b'\n'));
    returns.count() + blanks.iter().filter(|byte| **byte == b'\n').count()
}
