//! PDB: the atoms of its ATOM and HETATM records, by their columns.

use std::io::Read;
use std::ops::Range;

use glam::{DVec3, Vec3};

use super::elements::Kind;
use super::{Cloud, Entry, Made, Stop, no_such_frame};
use crate::scene::MeshError;
use crate::scene::diagnostic::brief;
use crate::scene::mesh::number::Number;
use crate::scene::pieces::Pieces;

/// The columns of a record, counted from 0.
const NAME: Range<usize> = 12..16;
const RESIDUE: Range<usize> = 17..20;
const PLACE: [Range<usize>; 3] = [30..38, 38..46, 46..54];
const ELEMENT: Range<usize> = 76..78;
/// The usual length of a record, with the end of its line.
const RECORD: usize = 81;

/// The atoms of a model, counted from 1; those before the first MODEL record are of the first one.
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

/// The text in some columns of a record, without the blanks around it; a short record has nothing
/// in them.
fn field(line: &[u8], columns: Range<usize>) -> &[u8] {
    let end = columns.end.min(line.len());
    line.get(columns.start..end).unwrap_or_default().trim_ascii()
}

/// The element of an atom: by its own columns, or else by its name, in which a symbol of one letter
/// stands in the second column: ` CA ` is a carbon, and `CA  ` is calcium, except in a chain of
/// residues of other names, where programs are less exact.
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
