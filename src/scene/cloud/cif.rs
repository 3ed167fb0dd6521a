//! CIF: the atoms of the file's loop of atom sites, with coordinates in ångströms (mmCIF) or as
//! fractions of a crystal's unit cell.

use std::io::Read;

use glam::{DMat3, DVec3};

use super::elements::Kind;
use super::{Cloud, Entry, Made, Stop, no_such_frame};
use crate::scene::MeshError;
use crate::scene::diagnostic::brief;
use crate::scene::mesh::number::Number;
use crate::scene::pieces::Pieces;

/// Reads the atoms of one model; `frame` is its number from 1.
pub(super) fn read(pieces: &mut Pieces<impl Read>, length: usize, frame: Option<usize>) -> Result<Cloud, Stop> {
    let mut reader = Reader { wanted: frame.unwrap_or(1), length, ..Reader::default() };
    let mut is_in_text = false;
    let mut line_number = 0;
    while let Some(line) = pieces.line()? {
        line_number += 1;
        let words = match (is_in_text, line.strip_prefix(b";")) {
            // A text of several lines ends at a line that begins with a semicolon.
            (true, None) => continue,
            (true, Some(rest)) => {
                is_in_text = false;
                rest
            }
            (false, Some(_)) => {
                is_in_text = true;
                reader.value(b"?").map_err(|fault| fault.line(line_number))?;
                continue;
            }
            (false, None) => line,
        };
        reader.words(words).map_err(|fault| fault.line(line_number))?;
        if reader.has_ended {
            break;
        }
    }
    reader.finish(frame)
}

/// What a column of the loop of atom sites holds.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Role {
    /// One of x, y and z in ångströms.
    Place(usize),
    /// One of x, y and z as a fraction of the unit cell.
    Fraction(usize),
    /// The symbol of the chemical element.
    Symbol,
    /// The label of the atom, which begins with the element's symbol.
    Label,
    /// The number of the model.
    Model,
    Unread,
}

impl Role {
    /// The role of the column of this tag, in lower case; None if the tag is not of atom sites.
    /// Where CIF has an underscore after `_atom_site`, mmCIF has a point.
    fn of(tag: &str) -> Option<Role> {
        let name = tag.strip_prefix("_atom_site")?;
        Some(match name.strip_prefix(['.', '_'])? {
            "cartn_x" => Role::Place(0),
            "cartn_y" => Role::Place(1),
            "cartn_z" => Role::Place(2),
            "fract_x" => Role::Fraction(0),
            "fract_y" => Role::Fraction(1),
            "fract_z" => Role::Fraction(2),
            "type_symbol" => Role::Symbol,
            "label" | "label_atom_id" => Role::Label,
            "pdbx_pdb_model_num" => Role::Model,
            _ => Role::Unread,
        })
    }
}

/// What the values that come next belong to.
#[derive(Default)]
enum State {
    #[default]
    Between,
    /// A single tag outside of loops, whose value comes next.
    Tag(String),
    /// The tags of a loop, which name its columns: their roles, and whether the loop has the
    /// coordinates of atom sites.
    Columns { roles: Vec<Role>, are_atoms: bool },
    /// The rows of the loop of atom sites.
    Atoms { roles: Vec<Role> },
    /// The rows of another loop.
    Others,
}

/// The values of an atom site read so far.
#[derive(Clone, Copy, Default)]
struct Site {
    /// The number of values of the current row read so far.
    values: usize,
    place: [Option<Number>; 3],
    fractions: [Option<f64>; 3],
    symbol: Option<Kind>,
    label: Option<Kind>,
}

#[derive(Default)]
struct Reader {
    /// The number of the model to read, from 1.
    wanted: usize,
    /// The length of the file in bytes.
    length: usize,
    state: State,
    site: Site,
    /// The name of the current model, and the number of models begun so far.
    model: Vec<u8>,
    models: usize,
    /// The number of rows of atom sites read so far.
    rows: usize,
    /// The atoms with coordinates in ångströms.
    made: Made,
    /// The atoms with coordinates as fractions of the unit cell.
    in_cell: Vec<(Kind, DVec3)>,
    cell: UnitCell,
    /// The number of atoms without coordinates.
    placeless: usize,
    has_ended: bool,
}

impl Reader {
    /// Reads the words of a line.
    fn words(&mut self, line: &[u8]) -> Result<(), MeshError> {
        let mut rest = line;
        loop {
            let start = rest.iter().position(|byte| !byte.is_ascii_whitespace()).unwrap_or(rest.len());
            rest = &rest[start..];
            match rest.first() {
                None | Some(b'#') => return Ok(()),
                Some(quote @ (b'\'' | b'"')) => {
                    let end = end_of_quoted(&rest[1..], *quote);
                    self.value(&rest[1..1 + end])?;
                    rest = rest.get(end + 2..).unwrap_or_default();
                }
                Some(_) => {
                    let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
                    self.word(&rest[..end])?;
                    rest = &rest[end..];
                }
            }
        }
    }

    /// Reads a word that is not quoted.
    fn word(&mut self, word: &[u8]) -> Result<(), MeshError> {
        let begins = |with: &[u8]| word.get(..with.len()).is_some_and(|start| start.eq_ignore_ascii_case(with));
        if word[0] == b'_' {
            let tag = String::from_utf8_lossy(word).to_ascii_lowercase();
            return self.tag(tag);
        }
        match word[0] {
            b'l' | b'L' if word.eq_ignore_ascii_case(b"loop_") => {
                self.end_loop()?;
                self.state = State::Columns { roles: Vec::new(), are_atoms: false };
            }
            b'd' | b'D' if begins(b"data_") => {
                self.end_loop()?;
                self.has_ended = self.rows > 0;
            }
            _ => return self.value(word),
        }
        Ok(())
    }

    fn tag(&mut self, tag: String) -> Result<(), MeshError> {
        if let State::Columns { roles, are_atoms } = &mut self.state {
            let role = Role::of(&tag);
            // Loops of atom sites without coordinates hold the atoms' thermal motion or their
            // types.
            *are_atoms |= matches!(role, Some(Role::Place(_) | Role::Fraction(_)));
            roles.push(role.unwrap_or(Role::Unread));
            return Ok(());
        }
        self.end_loop()?;
        self.state = State::Tag(tag);
        Ok(())
    }

    /// Ends a loop; an error if its last row is incomplete.
    fn end_loop(&mut self) -> Result<(), MeshError> {
        let columns = if let State::Atoms { roles } = &self.state { roles.len() } else { 0 };
        let values = self.site.values;
        self.state = State::Between;
        if values == 0 {
            return Ok(());
        }
        let message = format!("atom {} has {values} of its {columns} values", self.rows + 1);
        Err(MeshError::new(message).expected("a value for each column of the loop"))
    }

    #[inline]
    fn value(&mut self, value: &[u8]) -> Result<(), MeshError> {
        if let State::Columns { roles, are_atoms } = &mut self.state {
            let roles = std::mem::take(roles);
            // Only the first loop of atom sites is read: a second one describes another
            // structure.
            let is_first = *are_atoms && self.rows == 0 && !roles.is_empty();
            self.state = if is_first { State::Atoms { roles } } else { State::Others };
        }
        match &self.state {
            State::Atoms { roles } => {
                let role = roles[self.site.values];
                let columns = roles.len();
                self.site.values += 1;
                if role != Role::Unread {
                    self.site_value(role, value)?;
                }
                if self.site.values == columns {
                    self.end_row()?;
                }
            }
            State::Tag(tag) => {
                self.cell.set(tag, value);
                self.state = State::Between;
            }
            State::Between | State::Others | State::Columns { .. } => {}
        }
        Ok(())
    }

    /// Stores a value of an atom site.
    fn site_value(&mut self, role: Role, value: &[u8]) -> Result<(), MeshError> {
        let is_missing = matches!(value, b"." | b"?");
        match role {
            Role::Place(axis) if !is_missing => self.site.place[axis] = Some(self.number(axis, value)?),
            Role::Fraction(axis) if !is_missing => self.site.fractions[axis] = Some(self.number(axis, value)?.double),
            Role::Symbol if !is_missing => self.site.symbol = Some(Kind::of_label(value)),
            Role::Label => self.site.label = Some(Kind::of_label(value)),
            Role::Model if self.models == 0 || value != self.model => {
                self.model = value.to_vec();
                self.models += 1;
            }
            _ => {}
        }
        Ok(())
    }

    /// A coordinate. Its uncertainty may follow in parentheses, as in `1.234(5)`, and is
    /// ignored.
    fn number(&self, axis: usize, value: &[u8]) -> Result<Number, MeshError> {
        let end = value.iter().position(|byte| *byte == b'(').unwrap_or(value.len());
        let number = Number::of_word(&value[..end]).filter(|number| number.single.is_finite());
        number.ok_or_else(|| {
            let (axis, found) = (["x", "y", "z"][axis], brief(&String::from_utf8_lossy(value)));
            let message = format!("atom {}'s {axis} is `{found}`", self.rows + 1);
            MeshError::new(message).expected("a finite number, as in 1.25 or 1.25(3)")
        })
    }

    fn end_row(&mut self) -> Result<(), MeshError> {
        let site = std::mem::take(&mut self.site);
        self.rows += 1;
        if self.models.max(1) != self.wanted {
            return Ok(());
        }
        let kind = site.symbol.or(site.label).unwrap_or(Kind::UNKNOWN);
        if let [Some(x), Some(y), Some(z)] = site.place {
            let single = [x.single, y.single, z.single].into();
            let double = [x.double, y.double, z.double].into();
            if self.made.len() == 0 {
                // Guess the number of atoms from the file's length. A row of coordinates alone
                // has about 16 bytes, a usual one 64 or more.
                self.made = Made::in_room_for_atoms(self.length / 64 + 1);
            }
            self.made.push(&Entry::atom(kind, single, double));
        } else if let [Some(x), Some(y), Some(z)] = site.fractions {
            self.in_cell.push((kind, DVec3::new(x, y, z)));
        } else {
            self.placeless += 1;
        }
        Ok(())
    }

    fn finish(mut self, frame: Option<usize>) -> Result<Cloud, Stop> {
        self.end_loop()?;
        if self.rows == 0 {
            let fault = MeshError::new("the file has no loop of atom sites");
            return Err(fault.expected("loop_ with _atom_site.Cartn_x or _atom_site_fract_x, and so on").into());
        }
        let models = self.models.max(1);
        if let Some(frame) = frame.filter(|frame| *frame > models) {
            return Err(no_such_frame(frame, models, ["model", "models"]).into());
        }
        let mut notes = Vec::new();
        if models > 1 && frame.is_none() {
            notes.push(format!("the file has {models} models, and this is the first: --frame N shows another"));
        }
        if !self.in_cell.is_empty() {
            let axes = self.cell.axes().ok_or_else(|| {
                let fault = MeshError::new("places are fractions of a cell whose lengths and angles are missing");
                fault.expected("_cell_length_a and so on, of a cell that has a volume")
            })?;
            for (number, (kind, fractions)) in (1..).zip(&self.in_cell) {
                let double = axes * *fractions;
                let single = double.as_vec3();
                if !single.is_finite() {
                    let fault = MeshError::new(format!("atom {number} has no finite place"));
                    return Err(fault.expected("a cell of ordinary size").into());
                }
                self.made.push(&Entry::atom(*kind, single, double));
            }
            notes.push("the atoms are those that the file lists: the crystal's symmetry was not applied".to_owned());
        }
        if self.placeless > 0 {
            notes.push(format!("{} atoms without a place were left out", self.placeless));
        }
        Ok(self.made.finish(true, notes)?)
    }
}

/// Where a quoted value ends: at the closing quote, which a blank or the end of the line
/// follows.
fn end_of_quoted(text: &[u8], quote: u8) -> usize {
    let ends = |at: &usize| text[*at] == quote && text.get(at + 1).is_none_or(u8::is_ascii_whitespace);
    (0..text.len()).find(ends).unwrap_or(text.len())
}

/// The unit cell of a crystal: lengths in ångströms and angles in degrees.
#[derive(Default)]
struct UnitCell {
    lengths: [Option<f64>; 3],
    angles: [Option<f64>; 3],
}

impl UnitCell {
    /// Stores the value of a tag if the tag is one of the unit cell's.
    fn set(&mut self, tag: &str, value: &[u8]) {
        let Some(name) = tag.strip_prefix("_cell").and_then(|name| name.strip_prefix(['.', '_'])) else { return };
        let place = match name {
            "length_a" => &mut self.lengths[0],
            "length_b" => &mut self.lengths[1],
            "length_c" => &mut self.lengths[2],
            "angle_alpha" => &mut self.angles[0],
            "angle_beta" => &mut self.angles[1],
            "angle_gamma" => &mut self.angles[2],
            _ => return,
        };
        let end = value.iter().position(|byte| *byte == b'(').unwrap_or(value.len());
        *place = Number::of_word(&value[..end]).map(|number| number.double).filter(|number| *number > 0.0);
    }

    /// The unit cell's axes a, b and c as columns: a along x, b in the plane of x and y.
    fn axes(&self) -> Option<DMat3> {
        let [a, b, c] = [self.lengths[0]?, self.lengths[1]?, self.lengths[2]?];
        let right = Some(90.0);
        let angles = self.angles.map(|angle| angle.or(right).unwrap_or_default());
        // `cos` of 90 degrees in radians is not exactly 0.
        let cosine = |degrees: f64| if degrees == 90.0 { 0.0 } else { degrees.to_radians().cos() };
        let [alpha, beta, gamma] = angles.map(cosine);
        let sine = (1.0 - gamma * gamma).sqrt();
        let across = (alpha - beta * gamma) / sine;
        let height = (1.0 - beta * beta - across * across).sqrt();
        let axes = DMat3::from_cols(
            DVec3::new(a, 0.0, 0.0),
            b * DVec3::new(gamma, sine, 0.0),
            c * DVec3::new(beta, across, height),
        );
        (axes.is_finite() && height > 0.0).then_some(axes)
    }
}
