//! Writing mesh files.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::fmt::{self, Display};
use std::io::{self, Write};

use glam::{DVec3, Vec3};

use super::colour::{to_encoded, to_levels, to_linear, to_short_encoded};
use super::{Mesh, MeshFormat};

impl Mesh {
    /// Writes the mesh in a format. Coordinates and colours are exact, with these exceptions: PLY
    /// holds a colour for each face, OBJ and glTF one for each vertex, STL none. Vertices far from
    /// 0 are written as doubles to PLY, with all necessary digits to OBJ, under a translated node
    /// to glTF, and lose digits in STL.
    ///
    /// # Errors
    /// If writing to `out` fails.
    pub fn write(&self, format: MeshFormat, out: &mut impl Write) -> io::Result<()> {
        match format {
            MeshFormat::Obj => self.write_obj(out),
            MeshFormat::Ply => self.write_ply(out),
            MeshFormat::Stl => self.write_stl(out),
            MeshFormat::Gltf => self.write_gltf(out),
        }
    }

    fn write_obj(&self, out: &mut impl Write) -> io::Result<()> {
        if !self.colours.is_empty() {
            return self.write_coloured_obj(out);
        }
        writeln!(out, "# {} vertices, {} triangles", self.vertices.len(), self.triangles.len())?;
        for vertex in &self.vertices {
            let [x, y, z] = self.coordinates(*vertex);
            writeln!(out, "v {x} {y} {z}")?;
        }
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|index| u64::from(index) + 1);
            writeln!(out, "f {a} {b} {c}")?;
        }
        Ok(())
    }

    /// Writes an OBJ with colours after the coordinates of vertices. A vertex that triangles of
    /// different colours share is duplicated.
    fn write_coloured_obj(&self, out: &mut impl Write) -> io::Result<()> {
        let mut known = HashMap::new();
        let mut last = ShortColour::of(Vec3::ONE);
        for (number, &triangle) in self.triangles.iter().enumerate() {
            let colour = self.colour(number);
            if last.linear != colour {
                last = ShortColour::of(colour);
            }
            for corner in triangle {
                let count = known.len() + 1;
                if let Entry::Vacant(entry) = known.entry((corner, colour.to_array().map(f32::to_bits))) {
                    let [x, y, z] = self.coordinates(self.vertices[corner as usize]);
                    let [r, g, b] = last.encoded;
                    writeln!(out, "v {x} {y} {z} {r} {g} {b}")?;
                    entry.insert(count);
                }
            }
            let [a, b, c] = triangle.map(|corner| known[&(corner, colour.to_array().map(f32::to_bits))]);
            writeln!(out, "f {a} {b} {c}")?;
        }
        Ok(())
    }

    /// Writes a PLY without the crate ply-rs-bw, which would need a map of named properties for
    /// each vertex.
    fn write_ply(&self, out: &mut impl Write) -> io::Result<()> {
        let is_far = self.origin != DVec3::ZERO;
        let kind = if is_far { "double" } else { "float" };
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\n\
             element vertex {}\nproperty {kind} x\nproperty {kind} y\nproperty {kind} z\n\
             element face {}\nproperty list uchar uint vertex_indices\n",
            self.vertices.len(),
            self.triangles.len()
        )?;
        let channels = Channels::of(self.colours.iter().map(|(_, colour)| *colour));
        if !self.colours.is_empty() {
            let kind = channels.name();
            write!(out, "property {kind} red\nproperty {kind} green\nproperty {kind} blue\n")?;
        }
        out.write_all(b"end_header\n")?;
        for vertex in &self.vertices {
            if is_far {
                out.write_all(self.place(*vertex).to_array().map(f64::to_le_bytes).as_flattened())?;
            } else {
                out.write_all(vertex.to_array().map(f32::to_le_bytes).as_flattened())?;
            }
        }
        for (number, triangle) in self.triangles.iter().enumerate() {
            out.write_all(&[3])?;
            out.write_all(triangle.map(u32::to_le_bytes).as_flattened())?;
            if !self.colours.is_empty() {
                channels.write(self.colour(number), out)?;
            }
        }
        Ok(())
    }

    fn write_stl(&self, out: &mut impl Write) -> io::Result<()> {
        out.write_all(&[0; 80])?;
        out.write_all(&(self.triangles.len() as u32).to_le_bytes())?;
        for &triangle in &self.triangles {
            let [mut a, mut b, mut c] = self.corners(triangle);
            let normal = (b - a).as_dvec3().cross((c - a).as_dvec3()).normalize_or_zero().as_vec3();
            if self.origin != DVec3::ZERO {
                [a, b, c] = [a, b, c].map(|corner| self.place(corner).as_vec3());
            }
            let points = [normal, a, b, c].map(|it| it.to_array().map(f32::to_le_bytes));
            out.write_all(points.as_flattened().as_flattened())?;
            out.write_all(&[0; 2])?;
        }
        Ok(())
    }
}

impl Mesh {
    /// The position of a vertex in the file's own coordinates.
    fn place(&self, vertex: Vec3) -> DVec3 {
        self.origin + vertex.as_dvec3()
    }

    /// The coordinates of a vertex, as text.
    fn coordinates(&self, vertex: Vec3) -> [Coordinate; 3] {
        [0, 1, 2].map(|axis| Coordinate { origin: self.origin[axis], offset: vertex[axis] })
    }
}

/// A coordinate as text: as few digits as restore the same offset when the file is read with the
/// same origin.
struct Coordinate {
    origin: f64,
    offset: f32,
}

impl Display for Coordinate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Coordinate { origin, offset } = *self;
        if origin == 0.0 {
            return write!(f, "{offset}");
        }
        let exact = origin + f64::from(offset);
        let is_enough = |text: &String| text.parse().is_ok_and(|number: f64| (number - origin) as f32 == offset);
        let short = (0..=12).map(|decimals| format!("{exact:.decimals$}")).find(is_enough);
        f.write_str(&short.unwrap_or_else(|| exact.to_string()))
    }
}

/// A colour as the numbers in a text file.
struct ShortColour {
    linear: Vec3,
    encoded: [f64; 3],
}

impl ShortColour {
    fn of(linear: Vec3) -> Self {
        ShortColour { linear, encoded: linear.to_array().map(to_short_encoded) }
    }
}

/// The types in which a PLY file can hold colour channels.
#[derive(Clone, Copy)]
enum Channels {
    /// 8-bit levels, which most programs expect.
    Levels,
    Floats,
    Doubles,
}

impl Channels {
    /// The smallest type in which all of these colours are exact.
    fn of(colours: impl Iterator<Item = Vec3> + Clone) -> Self {
        let is_float = |linear: f32| to_linear((to_encoded(linear) as f32).into()) == linear;
        if colours.clone().all(|colour| to_levels(colour).is_some()) {
            Channels::Levels
        } else if colours.flat_map(|colour| colour.to_array()).all(is_float) {
            Channels::Floats
        } else {
            Channels::Doubles
        }
    }

    /// The type's name in a header.
    fn name(self) -> &'static str {
        match self {
            Channels::Levels => "uchar",
            Channels::Floats => "float",
            Channels::Doubles => "double",
        }
    }

    fn write(self, colour: Vec3, out: &mut impl Write) -> io::Result<()> {
        let encoded = colour.to_array().map(to_encoded);
        match self {
            Channels::Levels => out.write_all(&to_levels(colour).expect("all colours are levels")),
            Channels::Floats => out.write_all(encoded.map(|value| (value as f32).to_le_bytes()).as_flattened()),
            Channels::Doubles => out.write_all(encoded.map(f64::to_le_bytes).as_flattened()),
        }
    }
}
