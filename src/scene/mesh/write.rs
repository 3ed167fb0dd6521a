//! Writing mesh files.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::io::{self, Write};

use glam::Vec3;

use super::{Mesh, MeshFormat};
use crate::kernels::ColourRun;

impl Mesh {
    /// Writes the mesh in a format, exact to the last bit: PLY with a colour for each face, OBJ for each vertex, STL
    /// without.
    ///
    /// # Errors
    /// If writing to `out` fails.
    pub fn write(&self, format: MeshFormat, out: &mut impl Write) -> io::Result<()> {
        match format {
            MeshFormat::Obj => self.write_obj(out),
            MeshFormat::Ply => self.write_ply(out),
            MeshFormat::Stl => self.write_stl(out),
        }
    }

    fn write_obj(&self, out: &mut impl Write) -> io::Result<()> {
        if !self.colours.is_empty() {
            return self.write_coloured_obj(out);
        }
        writeln!(out, "# {} vertices, {} triangles", self.vertices.len(), self.triangles.len())?;
        for Vec3 { x, y, z } in &self.vertices {
            writeln!(out, "v {x} {y} {z}")?;
        }
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|index| u64::from(index) + 1);
            writeln!(out, "f {a} {b} {c}")?;
        }
        Ok(())
    }

    /// Colours follow the vertices, of which each has one: a vertex that triangles of different colours share becomes
    /// several.
    fn write_coloured_obj(&self, out: &mut impl Write) -> io::Result<()> {
        let mut known = HashMap::new();
        for (number, &triangle) in self.triangles.iter().enumerate() {
            let colour = self.colour(number);
            for corner in triangle {
                let count = known.len() + 1;
                if let Entry::Vacant(entry) = known.entry((corner, colour.to_array().map(f32::to_bits))) {
                    let (Vec3 { x, y, z }, Vec3 { x: r, y: g, z: b }) = (self.vertices[corner as usize], colour);
                    writeln!(out, "v {x} {y} {z} {r} {g} {b}")?;
                    entry.insert(count);
                }
            }
            let [a, b, c] = triangle.map(|corner| known[&(corner, colour.to_array().map(f32::to_bits))]);
            writeln!(out, "f {a} {b} {c}")?;
        }
        Ok(())
    }

    /// By hand: ply-rs-bw would need a map of named properties for each vertex.
    fn write_ply(&self, out: &mut impl Write) -> io::Result<()> {
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\n\
             element vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {}\nproperty list uchar uint vertex_indices\n",
            self.vertices.len(),
            self.triangles.len()
        )?;
        // Levels as other programs expect them, if that loses nothing.
        let levels = |colour: Vec3| colour.to_array().map(|channel| (channel * 255.0).round() as u8);
        let in_levels =
            |(_, colour): &ColourRun| levels(*colour).map(|level| f32::from(level) / 255.0) == colour.to_array();
        let of_levels = self.colours.iter().all(in_levels);
        if !self.colours.is_empty() {
            let kind = if of_levels { "uchar" } else { "float" };
            write!(out, "property {kind} red\nproperty {kind} green\nproperty {kind} blue\n")?;
        }
        out.write_all(b"end_header\n")?;
        for vertex in &self.vertices {
            out.write_all(vertex.to_array().map(f32::to_le_bytes).as_flattened())?;
        }
        for (number, triangle) in self.triangles.iter().enumerate() {
            out.write_all(&[3])?;
            out.write_all(triangle.map(u32::to_le_bytes).as_flattened())?;
            if self.colours.is_empty() {
                continue;
            }
            let colour = self.colour(number);
            if of_levels {
                out.write_all(&levels(colour))?;
            } else {
                out.write_all(colour.to_array().map(f32::to_le_bytes).as_flattened())?;
            }
        }
        Ok(())
    }

    fn write_stl(&self, out: &mut impl Write) -> io::Result<()> {
        out.write_all(&[0; 80])?;
        out.write_all(&(self.triangles.len() as u32).to_le_bytes())?;
        for &triangle in &self.triangles {
            let [a, b, c] = self.corners(triangle);
            let normal = (b - a).as_dvec3().cross((c - a).as_dvec3()).normalize_or_zero().as_vec3();
            let points = [normal, a, b, c].map(|it| it.to_array().map(f32::to_le_bytes));
            out.write_all(points.as_flattened().as_flattened())?;
            out.write_all(&[0; 2])?;
        }
        Ok(())
    }
}
