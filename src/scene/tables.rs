//! Scene files in TOML: they describe objects in the world and a camera. Each key is checked, and
//! everything is transformed to camera coordinates.

use std::ops::Range;
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::log::Log;
use super::mesh::{Mesh, Placement};
use super::open::no_area_of_mesh;
use super::opened::NoArea;
use super::parse::{Problem, Rule};
use super::view::{ToCamera, View, ViewError};
use super::{Camera, Faces, Light, MAX_PIXELS, MAX_SIDE, MovedFaces, Opened, Scene, SceneError, Sphere, Triangle};
use crate::kernels::StandardFloats;
use crate::reference::geometry;

/// The default focal distance and film diagonal: the values of Algorithm 1.
const FOCAL: f32 = 1.0;
const FILM: f32 = 1.0;

/// Reads a scene in TOML. Diagnostics call the file `name`; paths of mesh files are relative to
/// `folder`.
///
/// # Errors
/// [`SceneError::Invalid`] with up to 20 diagnostics. Mesh files are read only if the text has no
/// errors. The memory used stays within a multiple of the lengths of `source` and of the mesh
/// files, and the time is linear in them.
pub fn parse_toml(source: &[u8], name: &str, folder: &Path) -> Result<Opened, SceneError> {
    parse_with_threads(source, name, folder, 1)
}

/// As [`parse_toml`], with up to this many threads to read each mesh.
pub(super) fn parse_with_threads(
    source: &[u8],
    name: &str,
    folder: &Path,
    threads: usize,
) -> Result<Opened, SceneError> {
    let _floats = StandardFloats::set();
    let mut log = Log::new(source);
    let Some((text, start)) = log.text() else { return log.finish(None, name) };
    let mut reader = Reader { start, notes: Vec::new(), folder, threads, no_area: Vec::new() };
    let (table, errors) = DeTable::parse_recoverable(&text[start..]);
    // Report only the first syntax error: further ones are often its consequences.
    let opened = match errors.iter().min_by_key(|error| error.span().map_or(usize::MAX, |span| span.start)) {
        Some(error) => {
            let (message, expected) = error.message().split_once(", expected ").unwrap_or((error.message(), "TOML"));
            let end = text.len() - start;
            let place = visible(&text[start..], error.span().unwrap_or(end..end));
            let help = help_on_escapes(&text[start..], &place, message);
            reader.note(place.clone(), message, expected);
            reader.help(help.or_else(|| help_on_comma(&text[start..], &place)));
            None
        }
        None => reader.scene(table.get_ref(), name),
    };
    let Reader { mut notes, no_area, .. } = reader;
    notes.sort_by_key(|note| (note.span.start, note.span.end));
    for Note { span, message, expected, help } in notes {
        log.note(span, format_args!("{message}"), &expected, help);
    }
    let mut warnings = NoArea::default();
    for (place, which) in no_area {
        warnings.add(name, &which, || log.line(place));
    }
    let mut opened = log.finish(opened, name)?;
    opened.warnings.splice(0..0, warnings.warnings(name));
    Ok(opened)
}

/// The help for a path written with backslashes, as on Windows, of which one begins an unknown
/// escape.
fn help_on_escapes(text: &str, place: &Range<usize>, message: &str) -> Option<String> {
    let line_start = text[..place.start].rfind('\n').map_or(0, |at| at + 1);
    let is_of_escape = ["escape", "hex", "unicode"].iter().any(|word| message.contains(word));
    (is_of_escape && text[line_start..place.start].contains('\\')).then(|| ON_BACKSLASHES.to_owned())
}

const ON_BACKSLASHES: &str = "in double quotes a backslash begins an escape, such as \\t for a tab: write the path with / or \
                              in 'single quotes'";

/// The help for a number with a decimal comma.
const DECIMAL_MARK: &str = "the decimal mark is a point: 0.5 in place of 0,5";

/// The help for an error at a comma between two digits.
fn help_on_comma(text: &str, span: &Range<usize>) -> Option<String> {
    let is_digit = |byte: Option<&u8>| byte.is_some_and(u8::is_ascii_digit);
    let (before, after) = text.as_bytes().split_at(span.start);
    let is_in_number = is_digit(before.last()) && after.first() == Some(&b',') && is_digit(after.get(1));
    is_in_number.then(|| DECIMAL_MARK.to_owned())
}

/// The byte range to show for an error. An empty one is replaced by the word that begins there, or
/// else by the word before.
fn visible(text: &str, span: Range<usize>) -> Range<usize> {
    let after = text.get(span.start..).unwrap_or_default();
    if !span.is_empty() || after.trim_ascii().is_empty() {
        return span;
    }
    let blank = |c: char| c.is_ascii_whitespace();
    let next = after.find(blank).unwrap_or(after.len());
    if next > 0 {
        return span.start..span.start + next;
    }
    let end = text[..span.start].trim_ascii_end().len();
    text[..end].rfind(blank).map_or(0, |at| at + 1)..end
}

struct Note {
    span: Range<usize>,
    message: String,
    expected: String,
    help: Option<String>,
}

struct Reader<'a> {
    /// The byte offset where the TOML begins, after a byte order mark.
    start: usize,
    /// The errors, in the order in which values are read, which is not that of the file.
    notes: Vec<Note>,
    /// Triangles without area: their byte offsets in the file, and what messages call them.
    no_area: Vec<(usize, String)>,
    folder: &'a Path,
    /// How many threads may read a mesh file.
    threads: usize,
}

/// A table whose keys have been checked.
struct Fields<'t> {
    /// What messages call the table: "sphere 3" or "the camera".
    owner: String,
    table: &'t DeTable<'t>,
    span: Range<usize>,
}

/// A number rounded to f32, and to f64 for transformations.
#[derive(Clone, Copy)]
struct Number {
    single: f32,
    double: f64,
}

type Point = [Number; 3];

impl Number {
    fn of(value: f32) -> Self {
        Number { single: value, double: value.into() }
    }
}

fn single(point: Point) -> Vec3 {
    Vec3::from_array(point.map(|number| number.single))
}

fn double(point: Point) -> DVec3 {
    DVec3::from_array(point.map(|number| number.double))
}

impl Fields<'_> {
    fn get(&self, key: &str) -> Option<&Spanned<DeValue<'_>>> {
        self.table.get(key)
    }

    fn name(&self, key: &str) -> String {
        format!("{}'s {key}", self.owner)
    }

    /// The byte range of a key's value, or of the table's header if the key is missing.
    fn span(&self, key: &str) -> Range<usize> {
        self.get(key).map_or(self.span.clone(), Spanned::span)
    }
}

impl Reader<'_> {
    fn scene(&mut self, root: &DeTable<'_>, name: &str) -> Option<Opened> {
        let root = Fields { owner: "the scene".into(), table: root, span: 0..0 };
        self.known(&root, &["image", "camera", "light", "sphere", "triangle", "mesh"]);
        let (file, width, height, shadows) = self.image(&root, name);
        let (focal, film, to_camera, view) = self.camera(&root);

        let mut lights = Vec::new();
        for fields in self.list(&root, "light", &["position", "colour", "intensity"]) {
            let intensity = self.number_or(&fields, "intensity", Rule::NotNegative, 1.0);
            let colour = self.colour(&fields);
            let position = self.wanted_point(&fields, "position");
            lights.push(Light { intensity, colour, position: self.moved(&fields, "position", to_camera, position) });
        }
        let mut spheres = Vec::new();
        for fields in self.list(&root, "sphere", &["centre", "radius", "colour"]) {
            let radius = match fields.get("radius") {
                Some(_) => self.number_or(&fields, "radius", Rule::Positive, 1.0),
                None => {
                    self.missing(&fields, "radius", Rule::Positive.expected());
                    1.0
                }
            };
            let colour = self.colour(&fields);
            let centre = self.wanted_point(&fields, "centre");
            spheres.push(Sphere { radius, colour, centre: self.moved(&fields, "centre", to_camera, centre) });
        }
        let mut triangles = Vec::new();
        for fields in self.list(&root, "triangle", &["vertices", "colour"]) {
            let colour = self.colour(&fields);
            let vertices = self.vertices(&fields);
            let moved = vertices.map(|vertex| self.moved(&fields, "vertices", to_camera, vertex));
            let mut triangle = Triangle { colour, vertices: moved };
            if to_camera != ToCamera::IDENTITY && geometry::has_no_area(vertices.map(double)) {
                triangle.flatten();
            }
            if triangle.has_no_area() {
                self.no_area.push((self.start + fields.span.start, fields.owner.clone()));
            }
            triangles.push(triangle);
        }
        let (mut files, mut told, mut warnings, mut faces) = (Vec::new(), Vec::new(), Vec::new(), Faces::default());
        for fields in self.list(&root, "mesh", &["file", "colour", "scale", "rotate", "translate"]) {
            let colour = self.colour(&fields);
            let placement = self.placement(&fields);
            let file = self.text(&fields, "file", "the name of a mesh file: .obj, .ply, .stl, .glb or .gltf");
            if let Some(file) = file.filter(|_| self.notes.is_empty()) {
                let map = to_camera.of_placed(&placement);
                let Some(moved) = self.mesh(&fields, file, map, colour, (&mut told, &mut files)) else { continue };
                warnings.extend(no_area_of_mesh(&self.mesh_path(file), &moved.without_area));
                if !faces.append(moved.faces) {
                    let message = format!("{} and those before it have too many vertices", fields.owner);
                    self.note(fields.span.clone(), &message, &format!("at most {}", Faces::MOST_VERTICES));
                }
            }
        }
        if !self.notes.is_empty() {
            return None;
        }
        // Any error of the camera's numbers has been noted above.
        let camera = Camera::new(width, height, focal, film).ok()?;
        let scene = Scene { name: file, camera, lights, spheres, triangles, faces, shadows, view };
        Some(Opened { scene, files, notes: told, carried_light: None, warnings })
    }

    /// The name, width and height of the picture, and whether it has shadows.
    fn image(&mut self, root: &Fields<'_>, name: &str) -> (String, u32, u32, bool) {
        let stem = Path::new(name).file_stem().unwrap_or("image".as_ref()).to_string_lossy();
        let default = format!("{stem}.png");
        let Some(fields) = self.table(root, "image", "the image", &["file", "width", "height", "shadows"]) else {
            if root.get("image").is_none() {
                self.note(0..0, "the scene has no image", "[image], with its width and height");
            }
            return (default, 1, 1, false);
        };
        let file = match fields.get("file") {
            Some(_) => self.text(&fields, "file", "the name of a picture").unwrap_or_default().to_owned(),
            None => default,
        };
        let (width, height) = (self.side(&fields, "width"), self.side(&fields, "height"));
        if u64::from(width) * u64::from(height) > MAX_PIXELS {
            let message = format!("an image of {width} x {height} has more than {MAX_PIXELS} pixels");
            let expected = format!("a height of at most {} for that width", MAX_PIXELS / u64::from(width));
            self.note(fields.span("height"), &message, &expected);
        }
        (file, width, height, self.is_set(&fields, "shadows"))
    }

    /// The focal distance, the film's diagonal, the map from world to camera coordinates, and the
    /// view that defines it.
    fn camera(&mut self, root: &Fields<'_>) -> (f32, f32, ToCamera, View) {
        let keys = ["focal", "film", "position", "look_at", "up"];
        let Some(fields) = self.table(root, "camera", "the camera", &keys) else {
            return (FOCAL, FILM, ToCamera::IDENTITY, View::default());
        };
        let focal = self.number_or(&fields, "focal", Rule::Positive, FOCAL);
        let film = self.number_or(&fields, "film", Rule::Positive, FILM);
        let before = self.notes.len();
        let at_rest = View::default();
        let position = self.point(&fields, "position", Rule::Any).map_or(at_rest.position, double);
        let look_at = self.point(&fields, "look_at", Rule::Any).map_or(position + at_rest.look_at, double);
        let up = self.point(&fields, "up", Rule::Any).map_or(at_rest.up, double);
        if self.notes.len() > before {
            return (focal, film, ToCamera::IDENTITY, View::default());
        }
        let view = View { position, look_at, up };
        let map = view.to_camera().unwrap_or_else(|why| {
            let (key, expected) = match why {
                ViewError::Up if (View { up: DVec3::Z, ..view }).to_camera().is_ok() => {
                    ("up", "a direction across the view, such as up = [0, 0, 1]")
                }
                ViewError::Up => ("up", "a direction across the view, such as up = [0, 1, 0]"),
                _ => ("look_at", "a point other than the camera's position"),
            };
            self.note(fields.span(key), &why.to_string(), expected);
            ToCamera::IDENTITY
        });
        (focal, film, map, view)
    }

    fn placement(&mut self, fields: &Fields<'_>) -> Placement {
        let still = Placement::IDENTITY;
        let scale = match fields.get("scale") {
            Some(value) if !value.get_ref().is_array() => {
                let name = fields.name("scale");
                self.number(value, &name, Rule::Any).map_or(still.scale, |number| DVec3::splat(number.double))
            }
            _ => self.point(fields, "scale", Rule::Any).map_or(still.scale, double),
        };
        if scale.to_array().contains(&0.0) {
            self.note(fields.span("scale"), &format!("{} is 0", fields.name("scale")), "factors other than 0");
        }
        let rotate = self.point(fields, "rotate", Rule::Any).map_or(still.rotate, double);
        let translate = self.point(fields, "translate", Rule::Any).map_or(still.translate, double);
        Placement { scale, rotate, translate }
    }

    /// The path of a mesh file. Backslashes, as in paths from Windows, are taken for slashes on
    /// other systems, unless a file with exactly that name exists.
    fn mesh_path(&self, file: &str) -> PathBuf {
        let path = self.folder.join(file);
        if path.exists() { path } else { self.folder.join(file.replace('\\', "/")) }
    }

    /// The triangles of a mesh file in camera coordinates.
    fn mesh(
        &mut self,
        fields: &Fields<'_>,
        file: &str,
        map: ToCamera,
        colour: Vec3,
        (told, files): (&mut Vec<String>, &mut Vec<PathBuf>),
    ) -> Option<MovedFaces> {
        let path = self.mesh_path(file);
        let mesh = match Mesh::read_with_threads(&path, self.threads) {
            Ok(mesh) => mesh,
            Err(error) => {
                let expected = error.expected.clone().unwrap_or("a mesh that can be read".into());
                let message = super::mesh::MeshError { expected: None, ..error }.to_string();
                self.note(fields.span("file"), &message, &expected);
                self.help(file.contains(char::is_control).then(|| ON_BACKSLASHES.to_owned()));
                return None;
            }
        };
        told.extend(super::open::told(&path, &mesh));
        files.extend_from_slice(&mesh.libraries);
        files.push(path);
        let moved = mesh.moved(map, colour);
        if moved.is_none() {
            let message = format!("{} leaves the range of f32 where it is put", fields.owner);
            self.note(fields.span.clone(), &message, "coordinates within 3.4e38");
        }
        moved
    }

    fn vertices(&mut self, fields: &Fields<'_>) -> [Point; 3] {
        let stand_in = [[Number::of(0.0); 3]; 3];
        let expected = "three points, as in [[0, 0, 5], [1, 0, 5], [0, 1, 5]]";
        let Some(value) = fields.get("vertices") else {
            self.missing(fields, "vertices", expected);
            return stand_in;
        };
        let name = fields.name("vertices");
        let Some(points) = value.get_ref().as_array() else {
            self.note(value.span(), &format!("{name} are {}", kind(value.get_ref())), expected);
            return stand_in;
        };
        let Some([a, b, c]) = points.get(..) else {
            let message = format!("{} has {} of its three vertices", fields.owner, points.len());
            self.note(value.span(), &message, expected);
            return stand_in;
        };
        let mut number = 0;
        [a, b, c].map(|value| {
            number += 1;
            let name = format!("{}'s vertex {number}", fields.owner);
            self.numbers(value, &name, Rule::Any).unwrap_or(stand_in[0])
        })
    }

    /// A point mapped to camera coordinates in f64 and rounded once.
    fn moved(&mut self, fields: &Fields<'_>, key: &str, to_camera: ToCamera, point: Point) -> Vec3 {
        if to_camera == ToCamera::IDENTITY {
            return single(point);
        }
        let moved = to_camera.point(double(point)).as_vec3();
        if !moved.is_finite() {
            let message = format!("{} leaves the range of f32, seen from the camera", fields.name(key));
            self.note(fields.span(key), &message, "coordinates within 3.4e38");
        }
        moved
    }

    /// The tables of an array, such as every `[[light]]`.
    fn list<'t>(&mut self, root: &'t Fields<'_>, key: &str, keys: &[&str]) -> Vec<Fields<'t>> {
        let Some(value) = root.get(key) else { return Vec::new() };
        let expected = format!("[[{key}]] above the keys of each one");
        let Some(array) = value.get_ref().as_array() else {
            self.note(value.span(), &format!("{key} is {}", kind(value.get_ref())), &expected);
            return Vec::new();
        };
        let mut found = Vec::new();
        for (number, item) in (1..).zip(array.iter()) {
            let owner = format!("{key} {number}");
            match item.get_ref().as_table() {
                Some(table) => {
                    let fields = Fields { owner, table, span: item.span() };
                    self.known(&fields, keys);
                    found.push(fields);
                }
                None => self.note(item.span(), &format!("{owner} is {}", kind(item.get_ref())), &expected),
            }
        }
        found
    }

    fn table<'t>(&mut self, root: &'t Fields<'_>, key: &str, owner: &str, keys: &[&str]) -> Option<Fields<'t>> {
        let value = root.get(key)?;
        let Some(table) = value.get_ref().as_table() else {
            self.note(value.span(), &format!("{key} is {}", kind(value.get_ref())), &format!("[{key}] above its keys"));
            return None;
        };
        let fields = Fields { owner: owner.into(), table, span: value.span() };
        self.known(&fields, keys);
        Some(fields)
    }

    /// Notes an error for each unknown key.
    fn known(&mut self, fields: &Fields<'_>, keys: &[&str]) {
        for key in fields.table.keys() {
            let word = key.get_ref().as_ref();
            if keys.contains(&word) {
                continue;
            }
            let message = format!("{} has no key `{}`", fields.owner, super::diagnostic::brief(word));
            let near = keys.iter().map(|known| (strsim::damerau_levenshtein(known, word), known)).min();
            self.note(key.span(), &message, &one_of(keys));
            if let Some((1 | 2, known)) = near {
                self.help(Some(format!("did you mean `{known}`?")));
            }
        }
    }

    fn side(&mut self, fields: &Fields<'_>, key: &str) -> u32 {
        let expected = format!("a whole number from 1 to {MAX_SIDE}");
        let Some(value) = fields.get(key) else {
            self.missing(fields, key, &expected);
            return 1;
        };
        let number = value.get_ref().as_integer();
        let side = number.and_then(|number| u32::from_str_radix(number.as_str(), number.radix()).ok());
        side.filter(|side| (1..=MAX_SIDE).contains(side)).unwrap_or_else(|| {
            let problem = match value.get_ref() {
                DeValue::Integer(_) => "out of range",
                other => kind(other),
            };
            self.note(value.span(), &format!("{} is {problem}", fields.name(key)), &expected);
            1
        })
    }

    fn text<'t>(&mut self, fields: &'t Fields<'_>, key: &str, expected: &str) -> Option<&'t str> {
        let Some(value) = fields.get(key) else {
            self.missing(fields, key, expected);
            return None;
        };
        let problem = match value.get_ref() {
            DeValue::String(text) if text.is_empty() => "empty",
            DeValue::String(text) => return Some(text),
            other => kind(other),
        };
        self.note(value.span(), &format!("{} is {problem}", fields.name(key)), expected);
        None
    }

    /// The boolean at a key; false if the key is missing.
    fn is_set(&mut self, fields: &Fields<'_>, key: &str) -> bool {
        let Some(value) = fields.get(key) else { return false };
        value.get_ref().as_bool().unwrap_or_else(|| {
            let problem = kind(value.get_ref());
            self.note(value.span(), &format!("{} are {problem}", fields.name(key)), "true or false");
            false
        })
    }

    fn colour(&mut self, fields: &Fields<'_>) -> Vec3 {
        self.point(fields, "colour", Rule::NotNegative).map_or(Vec3::ONE, single)
    }

    fn number_or(&mut self, fields: &Fields<'_>, key: &str, rule: Rule, default: f32) -> f32 {
        let Some(value) = fields.get(key) else { return default };
        self.number(value, &fields.name(key), rule).map_or(default, |number| number.single)
    }

    fn wanted_point(&mut self, fields: &Fields<'_>, key: &str) -> Point {
        if fields.get(key).is_none() {
            self.missing(fields, key, "three numbers, as in [0, 0, 5]");
        }
        self.point(fields, key, Rule::Any).unwrap_or([Number::of(0.0); 3])
    }

    /// The three numbers at a key; None if the key is missing or a number is invalid.
    fn point(&mut self, fields: &Fields<'_>, key: &str, rule: Rule) -> Option<Point> {
        self.numbers(fields.get(key)?, &fields.name(key), rule)
    }

    fn numbers(&mut self, value: &Spanned<DeValue<'_>>, name: &str, rule: Rule) -> Option<Point> {
        let expected = "three numbers, as in [0, 0, 5]";
        let Some(array) = value.get_ref().as_array() else {
            self.note(value.span(), &format!("{name} is {}", kind(value.get_ref())), expected);
            return None;
        };
        let Some([x, y, z]) = array.get(..) else {
            self.note(value.span(), &format!("{name} has {} of its three numbers", array.len()), expected);
            self.help((array.len() > 3).then(|| DECIMAL_MARK.to_owned()));
            return None;
        };
        let parts = if matches!(rule, Rule::NotNegative) { ["red", "green", "blue"] } else { ["x", "y", "z"] };
        let [x, y, z] = [(x, parts[0]), (y, parts[1]), (z, parts[2])]
            .map(|(value, part)| self.number(value, &format!("the {part} of {name}"), rule));
        Some([x?, y?, z?])
    }

    fn number(&mut self, value: &Spanned<DeValue<'_>>, name: &str, rule: Rule) -> Option<Number> {
        let token = match value.get_ref() {
            DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str().to_owned(),
            // Integers may be in hexadecimal, octal or binary. One beyond i128 becomes a decimal
            // number too large for f32.
            DeValue::Integer(integer) => i128::from_str_radix(integer.as_str(), integer.radix())
                .map_or_else(|_| "1e99".to_owned(), |number| number.to_string()),
            DeValue::Float(float) => float.as_str().to_owned(),
            other => {
                self.note(value.span(), &format!("{name} is {}", kind(other)), rule.expected());
                return None;
            }
        };
        match rule.check(&token) {
            Ok(single) => Some(Number { single, double: token.parse().unwrap_or(single.into()) }),
            Err(Problem { what, help }) => {
                self.note(value.span(), &format!("{name} {what}"), rule.expected());
                self.help(help.map(str::to_owned));
                None
            }
        }
    }

    fn missing(&mut self, fields: &Fields<'_>, key: &str, expected: &str) {
        let expected = format!("`{key}`: {expected}");
        self.note(fields.span.clone(), &format!("{} has no {key}", fields.owner), &expected);
    }

    fn note(&mut self, span: Range<usize>, message: &str, expected: &str) {
        let span = span.start + self.start..span.end + self.start;
        self.notes.push(Note { span, message: message.into(), expected: expected.into(), help: None });
    }

    /// Adds `help`, if any, to the note made last.
    fn help(&mut self, help: Option<String>) {
        if let (Some(_), Some(note)) = (&help, self.notes.last_mut()) {
            note.help = help;
        }
    }
}

fn kind(value: &DeValue<'_>) -> &'static str {
    match value {
        DeValue::String(_) => "a string",
        DeValue::Integer(_) | DeValue::Float(_) => "a number",
        DeValue::Boolean(_) => "true or false",
        DeValue::Datetime(_) => "a date or a time",
        DeValue::Array(array) => match array.first().map(|first| first.get_ref()) {
            Some(DeValue::Table(_)) => "an array of tables",
            _ => "an array of something else",
        },
        DeValue::Table(_) => "a table",
    }
}

/// A list of keys such as "`a`, `b` or `c`".
fn one_of(keys: &[&str]) -> String {
    let quoted: Vec<_> = keys.iter().map(|key| format!("`{key}`")).collect();
    let (last, rest) = quoted.split_last().expect("a table has keys");
    format!("{} or {last}", rest.join(", "))
}
