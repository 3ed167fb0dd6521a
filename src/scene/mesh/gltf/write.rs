//! Writing a mesh as binary glTF: the JSON, then positions, colours and indices.

use std::borrow::Cow;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::io::{self, ErrorKind, Write};

use glam::{DVec3, Vec3};
use serde_json::{Value, json};

use super::{HEADER, MAGIC};
use crate::scene::Mesh;

/// The bytes of a chunk's header: its length and type.
const CHUNK_HEADER: usize = 8;
/// glTF's numbers for the component types.
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// The content of the file: a mesh in which each vertex has a single colour.
struct MeshContent<'a> {
    vertices: Cow<'a, [Vec3]>,
    /// The colour of each vertex; empty if all are white.
    colours: Vec<Vec3>,
    triangles: Cow<'a, [[u32; 3]]>,
}

impl Mesh {
    /// Writes the mesh as binary glTF. Vertex colours of glTF are in linear light, as those of
    /// [`Mesh`] are.
    pub(in crate::scene::mesh) fn write_gltf(&self, out: &mut impl Write) -> io::Result<()> {
        let parts = MeshContent::of(self);
        let mut json = parts.json(self.origin).to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let length = parts.bytes();
        let word = |number: usize| {
            let too_large = |_| io::Error::new(ErrorKind::FileTooLarge, "binary glTF holds less than 4 GiB");
            u32::try_from(number).map(u32::to_le_bytes).map_err(too_large)
        };
        out.write_all(MAGIC)?;
        out.write_all(&2_u32.to_le_bytes())?;
        out.write_all(&word(HEADER + 2 * CHUNK_HEADER + json.len() + length)?)?;
        out.write_all(&word(json.len())?)?;
        out.write_all(b"JSON")?;
        out.write_all(&json)?;
        out.write_all(&word(length)?)?;
        out.write_all(b"BIN\0")?;
        for vector in parts.vertices.iter().chain(&parts.colours) {
            out.write_all(vector.to_array().map(f32::to_le_bytes).as_flattened())?;
        }
        for triangle in parts.triangles.iter() {
            out.write_all(triangle.map(u32::to_le_bytes).as_flattened())?;
        }
        Ok(())
    }
}

impl<'a> MeshContent<'a> {
    /// The content for a mesh. A vertex that triangles of different colours share is duplicated
    /// for each colour.
    fn of(mesh: &'a Mesh) -> Self {
        if mesh.colours.is_empty() {
            let (vertices, triangles) = (Cow::from(&mesh.vertices), Cow::from(&mesh.triangles));
            return MeshContent { vertices, colours: Vec::new(), triangles };
        }
        let mut known = HashMap::new();
        let (mut vertices, mut colours, mut triangles) = (Vec::new(), Vec::new(), Vec::new());
        for (number, corners) in mesh.triangles.iter().enumerate() {
            let colour = mesh.colour(number);
            triangles.push(corners.map(|corner| match known.entry((corner, colour.to_array().map(f32::to_bits))) {
                Entry::Occupied(known) => *known.get(),
                Entry::Vacant(new) => {
                    vertices.push(mesh.vertices[corner as usize]);
                    colours.push(colour);
                    *new.insert((vertices.len() - 1) as u32)
                }
            }));
        }
        MeshContent { vertices: vertices.into(), colours, triangles: triangles.into() }
    }

    /// The length in bytes of all positions, colours and indices.
    fn bytes(&self) -> usize {
        size_of::<Vec3>() * (self.vertices.len() + self.colours.len()) + size_of::<[u32; 3]>() * self.triangles.len()
    }

    fn json(&self, origin: DVec3) -> Value {
        let (vertices, corners) = (self.vertices.len(), 3 * self.triangles.len());
        let of_vectors = size_of::<Vec3>() * vertices;
        let low = self.vertices.iter().copied().reduce(Vec3::min).unwrap_or_default().to_array();
        let high = self.vertices.iter().copied().reduce(Vec3::max).unwrap_or_default().to_array();
        let vectors =
            |view: usize| json!({"bufferView": view, "componentType": FLOAT, "count": vertices, "type": "VEC3"});
        let mut places = vectors(0);
        places["min"] = json!(low);
        places["max"] = json!(high);
        let mut accessors = vec![places];
        let mut views = vec![json!({"buffer": 0, "byteOffset": 0, "byteLength": of_vectors})];
        let mut attributes = json!({"POSITION": 0});
        if !self.colours.is_empty() {
            accessors.push(vectors(1));
            views.push(json!({"buffer": 0, "byteOffset": of_vectors, "byteLength": of_vectors}));
            attributes["COLOR_0"] = json!(1);
        }
        let indices = accessors.len();
        let before = of_vectors * indices;
        accessors.push(json!({
            "bufferView": indices, "componentType": UNSIGNED_INT, "count": corners, "type": "SCALAR",
        }));
        views.push(json!({"buffer": 0, "byteOffset": before, "byteLength": self.bytes() - before}));
        let mut node = json!({"mesh": 0});
        if origin != DVec3::ZERO {
            node["translation"] = json!(origin.to_array());
        }
        // glTF's default material is metallic: without this one, other programs would show
        // metal.
        let material = json!({
            "doubleSided": true,
            "pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 1},
        });
        json!({
            "asset": {"version": "2.0", "generator": "rayo"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [node],
            "meshes": [{"primitives": [{"attributes": attributes, "indices": indices, "material": 0}]}],
            "materials": [material],
            "accessors": accessors,
            "bufferViews": views,
            "buffers": [{"byteLength": self.bytes()}],
        })
    }
}
