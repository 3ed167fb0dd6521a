//! The primitives of glTF meshes: triangles, strips and fans, indexed or not, and their
//! colours.

use std::collections::HashMap;

use ::gltf::json::material::AlphaMode;
use ::gltf::json::mesh::{Mode, Primitive, Semantic};
use ::gltf::json::validation::Checked;
use glam::{DAffine3, DVec3, Vec3};

use super::accessors::{Elements, Kind, elements};
use super::{File, missing};
use crate::scene::MeshError;
use crate::scene::mesh::fault::{NonFiniteVertex, not_finite};

/// The most vertices, or triangles, of a mesh, unless the buffers have more bytes than this. A
/// small file could otherwise blow up: by instances of a mesh, and by accessors that share their
/// bytes.
const MOST: usize = 1 << 24;

/// The range of a primitive's vertices within the mesh that is being built.
#[derive(Clone, Copy)]
struct Range {
    first: usize,
    count: usize,
}

impl File<'_> {
    /// Reads a mesh of the file for a node, whose coordinates `to_file` maps to the file's.
    pub(super) fn mesh(&mut self, index: usize, to_file: DAffine3, node: usize) -> Result<(), MeshError> {
        let meshes = &self.root.meshes;
        let Some(mesh) = meshes.get(index) else {
            return Err(missing(&format!("nodes[{node}]"), "meshes", index, meshes.len()));
        };
        // Primitives of different materials often share their vertices: read these once.
        let mut known = HashMap::new();
        for (number, primitive) in mesh.primitives.iter().enumerate() {
            let name = format!("meshes[{index}].primitives[{number}]");
            self.made.unread.morphs |= primitive.targets.as_ref().is_some_and(|targets| !targets.is_empty());
            let mode = match primitive.mode {
                Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) => mode,
                Checked::Valid(_) => {
                    self.made.unread.points_and_lines = true;
                    continue;
                }
                Checked::Invalid => {
                    let fault = MeshError::new(format!("{name} is of an unknown mode"));
                    return Err(fault.expected("a number from 0 to 6"));
                }
            };
            let Some(places) = primitive.attributes.get(&Checked::Valid(Semantic::Positions)) else {
                // A primitive without positions is described by an extension that is not read.
                continue;
            };
            let places = places.value();
            let range = match known.get(&places) {
                Some(range) => *range,
                None => {
                    let range = self.vertices(places, to_file, &name)?;
                    known.insert(places, range);
                    range
                }
            };
            self.triangles(primitive, mode, range, &name)?;
        }
        Ok(())
    }

    /// Adds the vertices of an accessor of positions.
    fn vertices(&mut self, accessor: usize, to_file: DAffine3, name: &str) -> Result<Range, MeshError> {
        let owner = format!("{name}.attributes.POSITION");
        let places = elements(self.root, &mut self.buffers, accessor, &Kind::PLACES, &owner)?;
        let (first, count) = (self.made.points.len(), places.count);
        check_size(places.buffer_bytes, first + count, "vertices", name)?;
        let keeps = to_file == DAffine3::IDENTITY;
        for index in 0..count {
            let place = Vec3::from_array(places.vector(index));
            let double = if keeps { place.as_dvec3() } else { to_file.transform_point3(place.as_dvec3()) };
            let single = double.as_vec3();
            if !single.is_finite() {
                self.made.non_finite.push(NonFiniteVertex { index: first + index, line: None });
            }
            self.made.points.push(single, || double);
        }
        Ok(Range { first, count })
    }

    /// Adds the triangles of a primitive, with their colours.
    fn triangles(&mut self, primitive: &Primitive, mode: Mode, range: Range, name: &str) -> Result<(), MeshError> {
        let start = self.made.mesh.triangles.len();
        let corners = self.corners(primitive, range, name)?;
        let most = start + corners.len();
        check_size(self.buffers.bytes_read(), most, "triangles", name)?;
        let mesh = &mut self.made.mesh;
        match mode {
            Mode::TriangleStrip => mesh.triangles.extend(strip(&corners)),
            Mode::TriangleFan => {
                let pairs = corners.get(1..).unwrap_or_default().windows(2);
                mesh.triangles.extend(pairs.map(|pair| [corners[0], pair[0], pair[1]]));
            }
            _ => mesh.triangles.extend_from_slice(corners.as_chunks::<3>().0),
        }
        self.check_finite(start, range, name)?;
        self.paint(primitive, start, range, name)
    }

    /// The corners of a primitive as vertex indices of the mesh that is being built.
    fn corners(&mut self, primitive: &Primitive, range: Range, name: &str) -> Result<Vec<u32>, MeshError> {
        let Range { first, count } = range;
        // Fits into u32: `check_size` limited the number of vertices.
        let first = first as u32;
        let Some(accessor) = primitive.indices else { return Ok((first..first + count as u32).collect()) };
        let owner = format!("{name}.indices");
        let indices = elements(self.root, &mut self.buffers, accessor.value(), &Kind::INDICES, &owner)?;
        check_size(indices.buffer_bytes, indices.count / 3, "triangles", name)?;
        let mut corners = Vec::with_capacity(indices.count);
        for number in 0..indices.count {
            let index = indices.index(number);
            if index as usize >= count {
                let message = format!("{owner}[{number}] refers to vertex {index}, and there are {count}");
                return Err(MeshError::new(message).expected(format!("0 to {}", count - 1)));
            }
            corners.push(first + index);
        }
        Ok(corners)
    }

    /// An error if a triangle from number `start` on has a corner that is not finite.
    fn check_finite(&self, start: usize, range: Range, name: &str) -> Result<(), MeshError> {
        let non_finite = &self.made.non_finite;
        let is_there = non_finite.last().is_some_and(|last| last.index >= range.first);
        if !is_there {
            return Ok(());
        }
        let is_finite = |corner: u32| non_finite.binary_search_by_key(&(corner as usize), |it| it.index).is_err();
        let wrong = self.made.mesh.triangles[start..].as_flattened().iter().find(|corner| !is_finite(**corner));
        wrong.map_or(Ok(()), |corner| Err(not_finite(&format!("vertex {} of {name}", *corner as usize - range.first))))
    }

    /// Sets the colour of each triangle from number `start` on: the base colour of its material
    /// times the mean of its corners' colours.
    fn paint(&mut self, primitive: &Primitive, start: usize, range: Range, name: &str) -> Result<(), MeshError> {
        let factor = self.factor(primitive, name)?;
        let end = self.made.mesh.triangles.len();
        let Some(accessor) = primitive.attributes.get(&Checked::Valid(Semantic::Colors(0))) else {
            self.made.mesh.paint_to(end, factor.as_vec3());
            return Ok(());
        };
        let owner = format!("{name}.attributes.COLOR_0");
        let colours = elements(self.root, &mut self.buffers, accessor.value(), &Kind::COLOURS, &owner)?;
        if colours.count < range.count {
            let message = format!("{owner} has {} colours for {} vertices", colours.count, range.count);
            return Err(MeshError::new(message).expected("a colour for each vertex"));
        }
        for triangle in start..end {
            let corners = self.made.mesh.triangles[triangle].map(|corner| corner as usize - range.first);
            let colour = factor * mean(&colours, corners);
            self.made.mesh.paint_to(triangle + 1, colour.min(DVec3::splat(f32::MAX.into())).as_vec3());
        }
        Ok(())
    }

    /// The base colour factor of a primitive's material, in linear light.
    fn factor(&mut self, primitive: &Primitive, name: &str) -> Result<DVec3, MeshError> {
        let Some(material) = primitive.material else { return Ok(DVec3::ONE) };
        let materials = &self.root.materials;
        let Some(material) = materials.get(material.value()) else {
            return Err(missing(name, "materials", material.value(), materials.len()));
        };
        let base = &material.pbr_metallic_roughness;
        self.made.unread.textures |= base.base_color_texture.is_some();
        self.made.unread.transparency |= material.alpha_mode != Checked::Valid(AlphaMode::Opaque);
        let [red, green, blue, _] = base.base_color_factor.0;
        // `max` turns a NaN into 0.
        Ok(DVec3::from([red, green, blue].map(|factor| f64::from(factor).max(0.0).min(f32::MAX.into()))))
    }
}

/// The mean colour of three vertices.
fn mean(colours: &Elements<'_>, corners: [usize; 3]) -> DVec3 {
    let colour = |corner: usize| DVec3::from(colours.shares(corner).map(|share| f64::from(share.max(0.0))));
    let [a, b, c] = corners.map(colour);
    (a + b + c) / 3.0
}

/// The triangles of a strip. Those with a repeated corner are left out: they only continue the
/// strip elsewhere.
fn strip(corners: &[u32]) -> impl Iterator<Item = [u32; 3]> {
    let triangles = corners.windows(3).enumerate().map(|(number, window)| match number % 2 {
        0 => [window[0], window[1], window[2]],
        _ => [window[1], window[0], window[2]],
    });
    triangles.filter(|[a, b, c]| a != b && b != c && c != a)
}

/// An error if `count` exceeds what a file of this size can reasonably hold.
fn check_size(buffer_bytes: usize, count: usize, what: &str, name: &str) -> Result<(), MeshError> {
    // By bytes alone: a triangle without shared vertices takes 36 bytes of a buffer, and an
    // index takes at least one.
    let most = MOST.max(buffer_bytes).min(i32::MAX as usize);
    if count <= most {
        return Ok(());
    }
    let message = format!("with {name} the file has {count} {what}, instances of meshes being counted each by itself");
    Err(MeshError::new(message).expected(format!("at most {most} in a file of this size")))
}
