//! PDB: the atoms of the file's ATOM and HETATM records, whose fields are in fixed columns.

use std::io::Read;
use std::ops::Range;

use glam::{DVec3, Vec3};

use super::elements::Kind;
use super::{Cloud, Entry, Made, Stop, no_such_frame};
use crate::scene::MeshError;
use crate::scene::diagnostic::brief;
use crate::scene::mesh::number::Number;
use crate::scene::pieces::Pieces;

/// The columns of a record's fields, counted from 0.
const NAME: Range<usize> = 12..16;
const RESIDUE: Range<usize> = 17..20;
const PLACE: [Range<usize>; 3] = [30..38, 38..46, 46..54];
const ELEMENT: Range<usize> = 76..78;
/// The usual length of a record in bytes, with the end of its line.
const RECORD: usize = 81;

/// Reads the atoms of one model; `frame` is its number from 1. Atoms before the first MODEL
/// record belong to the first model.
pub(super) fn read(pieces: &mut Pieces<impl Read>, length: usize, frame: Option<usize>) -> Result<Cloud, Stop> {
    let wanted = frame.unwrap_or(1);
    let mut made = Made::in_room_for_atoms(length / RECORD + 1);
    let (mut line_number, mut models, mut notes) = (0, 0, Vec::new());
    while let Some(line) = pieces.line()? {
        line_number += 1;
        match line.get(..6).unwrap_or(line) {
            b"ATOM  " | b"HETATM" => {
                models = models.max(1);
                if models == wanted {
                    let number = made.len() + 1;
                    made.push(&atom(line, number).map_err(|fault| fault.line(line_number))?);
                }
            }
            b"MODEL " if made.len() > 0 && frame.is_none() => {
                notes.push("the file has several models, and this is the first: --frame N shows another".to_owned());
                break;
            }
            b"MODEL " => models += 1,
            _ => {}
        }
        if models > wanted {
            break;
        }
    }
    if let Some(frame) = frame.filter(|frame| *frame > models && models > 0) {
        return Err(no_such_frame(frame, models, ["model", "models"]).into());
    }
    if made.len() == 0 {
        let fault = MeshError::new("the file has no atoms");
        return Err(fault.expected("records that begin with ATOM or HETATM, as in PDB files").into());
    }
    Ok(made.finish(true, notes)?)
}

/// The atom of a record.
fn atom(line: &[u8], number: usize) -> Result<Entry, MeshError> {
    const COLUMNS: &str = "numbers in the columns 31 to 38, 39 to 46 and 47 to 54";
    let mut single = Vec3::ZERO;
    let mut double = DVec3::ZERO;
    for (axis, columns) in PLACE.into_iter().enumerate() {
        let field = field(line, columns);
        let Some(coordinate) = Number::of_word(field) else {
            let axis = ["x", "y", "z"][axis];
            let found = brief(&String::from_utf8_lossy(field));
            return Err(MeshError::new(format!("atom {number}'s {axis} is `{found}`")).expected(COLUMNS));
        };
        single[axis] = coordinate.single;
        double[axis] = coordinate.double;
    }
    if !single.is_finite() {
        return Err(MeshError::new(format!("atom {number} has no finite place")).expected(COLUMNS));
    }
    Ok(Entry::atom(kind(line), single, double))
}

/// The text in these columns of a record, trimmed; empty where the record is too short.
fn field(line: &[u8], columns: Range<usize>) -> &[u8] {
    let end = columns.end.min(line.len());
    line.get(columns.start..end).unwrap_or_default().trim_ascii()
}

/// The element of an atom: by the columns of the element, or else by the atom's name. In a name
/// a one-letter symbol is in the second column: ` CA ` is a carbon and `CA  ` is calcium. In an
/// ATOM record whose residue has another name than the atom, as in proteins, `CA  ` is a carbon
/// nevertheless: some programs misalign names there.
fn kind(line: &[u8]) -> Kind {
    if let Some(kind) = Kind::of_symbol(field(line, ELEMENT)) {
        return kind;
    }
    let name = line.get(NAME).unwrap_or_default();
    let letters = name.trim_ascii_start().trim_ascii_end();
    let letters = &letters[letters.iter().take_while(|byte| byte.is_ascii_digit()).count()..];
    let begins_with_two = name.first().is_some_and(u8::is_ascii_alphabetic);
    let is_hydrogen = letters.len() == 4 && letters[0] == b'H';
    let is_of_chain = line.starts_with(b"ATOM") && field(line, RESIDUE) != letters && !letters.starts_with(b"SE");
    let length = if begins_with_two && !is_hydrogen && !is_of_chain { 2 } else { 1 };
    Kind::of_label(&letters[..length.min(letters.len())])
}
