//! Files from which spheres are made: the atoms of a molecule, or the points of a point cloud.

mod cif;
mod elements;
mod pdb;
mod words;
mod xyz;

use std::fmt;
use std::io::Read;
use std::path::Path;

use glam::{DVec3, Vec3};

use super::mesh::fault::counted;
use super::mesh::ply::{self, Points};
use super::mesh::read::unread;
use super::mesh::vertices::Vertices;
use super::mistaken::recognise_unread;
use super::pieces::{Pieces, ReadFailed};
use super::{MeshError, Sphere, ToCamera, UpAxis, open};
use crate::kernels::StandardFloats;
use crate::kernels::sys::room;
use elements::Kind;

/// Atoms or points read from a file; each becomes a sphere.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cloud {
    /// The centres of the spheres, each finite, relative to the origin.
    pub centres: Vec<Vec3>,
    /// The point of the file's coordinates that `centres` are relative to: 0, unless the whole
    /// cloud is so far from 0 that f32 would lose digits, as with map coordinates.
    pub origin: DVec3,
    /// Whether the file holds atoms, with coordinates in ångströms; otherwise it holds points.
    pub is_molecule: bool,
    /// The chemical element of each atom; empty for points, which may have `radii` and
    /// `colours` instead.
    kinds: Vec<Kind>,
    /// The radius of each sphere; empty where the file has none.
    radii: Vec<f32>,
    /// The colour of each sphere in linear light; empty where the file has none.
    colours: Vec<Vec3>,
    /// What was dropped from the file, in sentences for the user.
    pub notes: Vec<String>,
}

/// A format of files of atoms or points.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CloudFormat {
    /// XYZ: frames of atoms, or points, one atom or point per line.
    Xyz,
    /// The format of the Protein Data Bank: records of fixed columns.
    Pdb,
    /// CIF, of the Protein Data Bank (mmCIF) or of crystals.
    Cif,
}

/// Why reading a cloud stopped.
enum Stop {
    /// The file could not be read.
    Unread,
    /// The file's content is not valid.
    Fault(MeshError),
}

impl From<MeshError> for Stop {
    fn from(fault: MeshError) -> Self {
        Stop::Fault(fault)
    }
}

impl From<ReadFailed> for Stop {
    fn from(_: ReadFailed) -> Self {
        Stop::Unread
    }
}

impl CloudFormat {
    /// The extensions of file names, in lower case, and the formats that they stand for.
    pub const EXTENSIONS: &[(&str, CloudFormat)] = &[
        ("xyz", CloudFormat::Xyz),
        ("extxyz", CloudFormat::Xyz),
        ("pdb", CloudFormat::Pdb),
        ("ent", CloudFormat::Pdb),
        ("cif", CloudFormat::Cif),
        ("mmcif", CloudFormat::Cif),
    ];

    /// The format of a file name by its extension, in upper or lower case.
    pub fn from_path(path: &Path) -> Option<CloudFormat> {
        let extension = path.extension()?;
        let known = CloudFormat::EXTENSIONS.iter().find(|(known, _)| extension.eq_ignore_ascii_case(known));
        known.map(|&(_, format)| format)
    }

    /// The format's usual name.
    pub fn name(self) -> &'static str {
        match self {
            CloudFormat::Xyz => "XYZ",
            CloudFormat::Pdb => "PDB",
            CloudFormat::Cif => "CIF",
        }
    }
}

impl fmt::Display for CloudFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Cloud {
    /// Reads a file of atoms or points in the format that its extension tells. If the file has
    /// several frames or models, `frame` selects one, counted from 1; the default is the first.
    ///
    /// # Errors
    /// If the file cannot be read or is damaged; the error names the file and the line. The
    /// memory used stays within a small multiple of the file's length, whatever sizes the file
    /// claims.
    pub fn read(path: &Path, frame: Option<usize>) -> Result<Cloud, MeshError> {
        let _floats = StandardFloats::set();
        let format = CloudFormat::from_path(path).ok_or_else(|| {
            let fault = MeshError::new("the name of a file of atoms or points tells its format");
            fault.expected(".xyz, .pdb or .cif at its end").of(path)
        })?;
        let in_pieces = open::read_twice(path).map(|(file, length)| parse(file, length, format, frame));
        let cloud = match in_pieces {
            Some(Ok(cloud)) => Ok(cloud),
            Some(Err(Stop::Fault(fault))) => Err(fault),
            // A pipe, which cannot be read twice, or a file whose reading in pieces failed: read
            // it as a whole.
            None | Some(Err(Stop::Unread)) => {
                let source = open::contents(path).map_err(|cause| unread(path, &cause, "a file of atoms or points"));
                source.and_then(|source| parse_all(&source, format, frame))
            }
        };
        cloud.map_err(|fault| fault.of(path))
    }

    /// Reads the content of a file of atoms or points; errors call the file `name`.
    ///
    /// # Errors
    /// As [`Cloud::read`].
    pub fn from_bytes(
        source: &[u8],
        format: CloudFormat,
        frame: Option<usize>,
        name: &str,
    ) -> Result<Cloud, MeshError> {
        let _floats = StandardFloats::set();
        parse_all(source, format, frame).map_err(|fault| fault.of(name))
    }

    /// Reads the vertices of a PLY file as points.
    ///
    /// # Errors
    /// As [`Cloud::read`].
    pub fn of_ply(path: &Path) -> Result<Cloud, MeshError> {
        let _floats = StandardFloats::set();
        let in_pieces = open::read_twice(path).and_then(|(file, length)| ply::read_points(file, length));
        let points = match in_pieces {
            Some(read) => read,
            None => {
                let source = open::contents(path).map_err(|cause| unread(path, &cause, "a PLY file").of(path))?;
                ply::read_points(&source[..], source.len()).expect("memory can be read")
            }
        };
        points.and_then(Cloud::of_points).map_err(|fault| fault.of(path))
    }

    /// A cloud of the finite points of a PLY file.
    fn of_points(points: Points) -> Result<Cloud, MeshError> {
        let Points { vertices, mut colours, non_finite, notes } = points;
        let is_left_out = |index: usize| non_finite.binary_search(&index).is_ok();
        let (mut centres, origin) = vertices.finish();
        let mut index = 0;
        centres.retain(|_| {
            index += 1;
            !is_left_out(index - 1)
        });
        index = 0;
        colours.retain(|_| {
            index += 1;
            !is_left_out(index - 1)
        });
        let made =
            Made { centres: Vertices::in_room(centres), colours, placeless: non_finite.len(), ..Made::default() };
        Ok(Cloud { origin, ..made.finish(false, notes)? })
    }

    /// The axis of the file that is shown upright by default: y for molecules and PLY files; z
    /// for point clouds in XYZ, which are mostly of land or rooms.
    pub fn up_axis(&self, format: Option<CloudFormat>) -> UpAxis {
        if format.is_some() && !self.is_molecule { UpAxis::Z } else { UpAxis::Y }
    }

    /// Whether the file gives every sphere a radius, by its element or directly.
    pub fn has_radii(&self) -> bool {
        !self.kinds.is_empty() || !self.radii.is_empty()
    }

    /// A radius for points that have none: half the spacing that the points would have in a
    /// square grid whose side is the diagonal of the cloud's bounding box.
    pub fn usual_radius(&self) -> f32 {
        let low = self.centres.iter().copied().fold(Vec3::INFINITY, Vec3::min);
        let high = self.centres.iter().copied().fold(Vec3::NEG_INFINITY, Vec3::max);
        let length = (high.as_dvec3() - low.as_dvec3()).length();
        // A few points do not form a surface: limit the radius so that they stay apart.
        const LARGEST_SHARE: f64 = 0.02;
        let share = (0.5 / (self.centres.len() as f64).sqrt()).min(LARGEST_SHARE);
        let radius = (length * share) as f32;
        if radius > 0.0 && radius.is_finite() { radius } else { 1.0 }
    }

    /// The spheres in the file's coordinates, relative to the origin. `radius`, if given,
    /// replaces the radii of all.
    pub fn spheres(self, radius: Option<f32>) -> Vec<Sphere> {
        let radius = radius.or_else(|| (!self.has_radii()).then(|| self.usual_radius()));
        let Cloud { centres, kinds, radii, colours, .. } = self;
        let mut spheres = room(centres.len());
        // Radii and colours are looked up once per element, not once per atom.
        let looks: Vec<(f32, Vec3)> = Kind::all().map(|kind| (kind.radius(), kind.colour())).collect();
        for (index, centre) in centres.into_iter().enumerate() {
            let (own_radius, own_colour) = match kinds.get(index) {
                Some(kind) => looks[kind.index()],
                None => (1.0, Vec3::ONE),
            };
            let own_radius = radii.get(index).copied().unwrap_or(own_radius);
            let colour = colours.get(index).copied().unwrap_or(own_colour);
            spheres.push(Sphere { radius: radius.unwrap_or(own_radius), colour, centre });
        }
        spheres
    }
}

/// Maps spheres, given relative to an origin, to the camera's coordinates and multiplies their
/// colours by `colour`; None if a coordinate overflows f32.
pub(super) fn placed(mut spheres: Vec<Sphere>, origin: DVec3, map: ToCamera, colour: Vec3) -> Option<Vec<Sphere>> {
    let map = map.for_points_from(origin);
    for sphere in &mut spheres {
        sphere.centre = map.point(sphere.centre.as_dvec3()).as_vec3();
        sphere.colour *= colour;
        if !sphere.centre.is_finite() || !sphere.colour.is_finite() {
            return None;
        }
    }
    Some(spheres)
}

/// A sphere as one line of a file describes it.
struct Entry {
    /// The centre, rounded to f32 and to f64.
    single: Vec3,
    double: DVec3,
    kind: Option<Kind>,
    radius: Option<f32>,
    colour: Option<Vec3>,
}

impl Entry {
    /// An atom of an element.
    fn atom(kind: Kind, single: Vec3, double: DVec3) -> Self {
        Entry { single, double, kind: Some(kind), radius: None, colour: None }
    }
}

/// A cloud while it is being read. All of its entries have the same optional fields.
#[derive(Default)]
struct Made {
    centres: Vertices,
    kinds: Vec<Kind>,
    radii: Vec<f32>,
    colours: Vec<Vec3>,
    /// How many atoms have an unknown element.
    unknown: usize,
    /// How many points were left out because they have no coordinates.
    placeless: usize,
}

impl Made {
    /// An empty cloud with memory reserved for this many atoms.
    fn in_room_for_atoms(count: usize) -> Self {
        Made { centres: Vertices::in_room(room(count)), kinds: room(count), ..Made::default() }
    }

    fn len(&self) -> usize {
        self.centres.len()
    }

    /// Adds a sphere. Its centre must be finite.
    #[inline]
    fn push(&mut self, entry: &Entry) {
        self.centres.push(entry.single, || entry.double);
        if let Some(kind) = entry.kind {
            self.unknown += usize::from(kind == Kind::UNKNOWN);
            self.kinds.push(kind);
        }
        self.radii.extend(entry.radius);
        self.colours.extend(entry.colour);
    }

    /// The cloud, with notes on what was left out or unknown; an error if it is empty.
    fn finish(self, is_molecule: bool, mut notes: Vec<String>) -> Result<Cloud, MeshError> {
        let Made { centres, kinds, radii, colours, unknown, placeless } = self;
        if placeless > 0 {
            let without = counted(placeless, "point has", "points have");
            notes.push(
                format!("{without} no finite place, and is left out")
                    .replace("have no finite place, and is", "have no finite place, and are"),
            );
        }
        if unknown > 0 {
            let atoms = counted(unknown, "atom is", "atoms are");
            notes.push(format!("{atoms} of no known element: pink spheres of radius 2"));
        }
        let (centres, origin) = centres.finish();
        if centres.is_empty() {
            let what = if is_molecule { "atom" } else { "point" };
            return Err(MeshError::new(format!("the file has no {what}s")).expected(format!("at least one {what}")));
        }
        Ok(Cloud { centres, origin, is_molecule, kinds, radii, colours, notes })
    }
}

/// The cloud of a file of this length in bytes, which is read piece by piece.
fn parse(mut file: impl Read, length: usize, format: CloudFormat, frame: Option<usize>) -> Result<Cloud, Stop> {
    /// Enough bytes to recognise a file of another format.
    const BEGINNING: u64 = super::mistaken::BEGINNING as u64;
    let mut begin = Vec::new();
    file.by_ref().take(BEGINNING).read_to_end(&mut begin).map_err(|_| ReadFailed)?;
    if begin.is_empty() {
        return Err(MeshError::new("the file is empty").expected(format!("atoms in the format {format}")).into());
    }
    let mistaken = recognise_unread(&begin);
    let text = begin.strip_prefix(super::log::BYTE_ORDER_MARK.as_bytes()).unwrap_or(&begin);
    let mut pieces = Pieces::new(text.chain(file), length);
    let read = match format {
        CloudFormat::Xyz => xyz::read(&mut pieces, length, frame),
        CloudFormat::Pdb => pdb::read(&mut pieces, length, frame),
        CloudFormat::Cif => cif::read(&mut pieces, length, frame),
    };
    read.map_err(|stop| match (stop, mistaken) {
        (Stop::Fault(_), Some(mistaken)) => Stop::Fault(MeshError::mistaken(mistaken)),
        (stop, _) => stop,
    })
}

fn parse_all(source: &[u8], format: CloudFormat, frame: Option<usize>) -> Result<Cloud, MeshError> {
    parse(source, source.len(), format, frame).map_err(|stop| match stop {
        Stop::Fault(fault) => fault,
        Stop::Unread => unreachable!("memory can be read"),
    })
}

/// The error for the number of a frame or model that the file does not have.
fn no_such_frame(frame: usize, has: usize, what: [&str; 2]) -> MeshError {
    let [one, many] = what;
    let message = format!("there is no {one} {frame}: the file has {}", counted(has, one, many));
    MeshError::new(message).expected(format!("--frame from 1 to {has}"))
}
