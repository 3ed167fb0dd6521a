//! Mesh files written.

use std::io::{self, Write};

use glam::Vec3;

use super::{Mesh, MeshFormat};

impl Mesh {
    /// Writes the mesh in a format, to the last bit of its numbers.
    ///
    /// # Errors
    /// If `out` does not take it.
    pub fn write(&self, format: MeshFormat, out: &mut impl Write) -> io::Result<()> {
        match format {
            MeshFormat::Obj => self.write_obj(out),
            MeshFormat::Ply => self.write_ply(out),
            MeshFormat::Stl => self.write_stl(out),
        }
    }

    fn write_obj(&self, out: &mut impl Write) -> io::Result<()> {
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

    /// By hand: ply-rs-bw would have it as a map of named properties for each vertex.
    fn write_ply(&self, out: &mut impl Write) -> io::Result<()> {
        write!(
            out,
            "ply\nformat binary_little_endian 1.0\n\
             element vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
            self.vertices.len(),
            self.triangles.len()
        )?;
        for vertex in &self.vertices {
            out.write_all(vertex.to_array().map(f32::to_le_bytes).as_flattened())?;
        }
        for triangle in &self.triangles {
            out.write_all(&[3])?;
            out.write_all(triangle.map(u32::to_le_bytes).as_flattened())?;
        }
        Ok(())
    }

    fn write_stl(&self, out: &mut impl Write) -> io::Result<()> {
        let facets = self.triangles.iter().map(|&triangle| {
            let [a, b, c] = self.corners(triangle);
            let normal = (b - a).as_dvec3().cross((c - a).as_dvec3()).normalize_or_zero().as_vec3();
            let vertices = [a, b, c].map(|vertex| stl_io::Vertex::new(vertex.to_array()));
            stl_io::Triangle { normal: stl_io::Normal::new(normal.to_array()), vertices }
        });
        stl_io::write_stl(out, facets)
    }
}
