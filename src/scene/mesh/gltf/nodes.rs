//! The nodes of a glTF scene, from its roots on: the positions of their meshes, cameras and
//! lights.

use ::gltf::json::camera::Type as CameraType;
use ::gltf::json::extensions::scene::khr_lights_punctual::Type as LightType;
use ::gltf::json::scene::Node;
use ::gltf::json::validation::Checked;
use glam::{DAffine3, DMat4, DQuat, DVec3, Vec3};

use super::{File, missing};
use crate::scene::MeshError;
use crate::scene::mesh::{FileCamera, FileLight};

impl File<'_> {
    /// Reads all nodes of the scene, each before its children, in the order of the file.
    pub(super) fn nodes(&mut self) -> Result<(), MeshError> {
        let nodes = &self.root.nodes;
        let mut visited = vec![false; nodes.len()];
        let mut open: Vec<_> = self.roots()?.into_iter().map(|root| (root, DAffine3::IDENTITY)).collect();
        open.reverse();
        while let Some((index, parent)) = open.pop() {
            let Some(node) = nodes.get(index) else {
                return Err(missing("a scene or a node", "nodes", index, nodes.len()));
            };
            if std::mem::replace(&mut visited[index], true) {
                let fault = MeshError::new(format!("nodes[{index}] is reached twice"));
                return Err(fault.expected("nodes without a cycle, each with one parent"));
            }
            let to_file = parent * transformation(node, index)?;
            self.camera(node, to_file, index)?;
            self.light(node, to_file, index)?;
            if let Some(mesh) = node.mesh {
                self.made.unread.skins |= node.skin.is_some();
                self.mesh(mesh.value(), to_file, index)?;
            }
            let children = node.children.iter().flatten().rev();
            open.extend(children.map(|child| (child.value(), to_file)));
        }
        Ok(())
    }

    /// The root nodes: those of the file's default scene, or else of its first scene; if it has
    /// no scene, all nodes without a parent.
    fn roots(&self) -> Result<Vec<usize>, MeshError> {
        let scenes = &self.root.scenes;
        if scenes.is_empty() {
            let children = self.root.nodes.iter().flat_map(|node| node.children.iter().flatten());
            let mut has_parent = vec![false; self.root.nodes.len()];
            children.for_each(|child| {
                if let Some(has) = has_parent.get_mut(child.value()) {
                    *has = true;
                }
            });
            return Ok((0..has_parent.len()).filter(|node| !has_parent[*node]).collect());
        }
        let index = self.root.scene.map_or(0, |scene| scene.value());
        let scene = scenes.get(index).ok_or_else(|| missing("the file", "scenes", index, scenes.len()))?;
        Ok(scene.nodes.iter().map(|node| node.value()).collect())
    }

    /// Takes the camera of a node, if it is the first camera of the file.
    fn camera(&mut self, node: &Node, to_file: DAffine3, index: usize) -> Result<(), MeshError> {
        let Some(camera) = node.camera else { return Ok(()) };
        let cameras = &self.root.cameras;
        let Some(camera) = cameras.get(camera.value()) else {
            return Err(missing(&format!("nodes[{index}]"), "cameras", camera.value(), cameras.len()));
        };
        if camera.type_ != Checked::Valid(CameraType::Perspective) {
            self.made.unread.orthographic_cameras = true;
            return Ok(());
        }
        let Some(perspective) = camera.perspective.as_ref().filter(|_| self.made.mesh.camera.is_none()) else {
            return Ok(());
        };
        let camera = FileCamera {
            position: to_file.translation,
            forward: to_file.transform_vector3(DVec3::NEG_Z),
            up: to_file.transform_vector3(DVec3::Y),
            field_of_view: f64::from(perspective.yfov).to_degrees(),
        };
        let has_angle = camera.field_of_view > 0.0 && camera.field_of_view < 180.0;
        if has_angle && camera.view(DAffine3::IDENTITY).to_camera().is_ok() {
            self.made.mesh.camera = Some(camera);
        }
        Ok(())
    }

    /// Takes the light of a node, if it is a point light.
    fn light(&mut self, node: &Node, to_file: DAffine3, index: usize) -> Result<(), MeshError> {
        let extension = node.extensions.as_ref().and_then(|extensions| extensions.khr_lights_punctual.as_ref());
        let Some(light) = extension.map(|extension| extension.light.value()) else { return Ok(()) };
        let of_root = self.root.extensions.as_ref().and_then(|extensions| extensions.khr_lights_punctual.as_ref());
        let lights = of_root.map_or(&[][..], |extension| &extension.lights[..]);
        let Some(light) = lights.get(light) else {
            return Err(missing(&format!("nodes[{index}]"), "lights", light, lights.len()));
        };
        if light.type_ != Checked::Valid(LightType::Point) {
            self.made.unread.other_lights = true;
            return Ok(());
        }
        let colour = Vec3::from_array(light.color).max(Vec3::ZERO);
        let intensity = f64::from(light.intensity).max(0.0);
        let position = to_file.translation;
        if colour.is_finite() && intensity.is_finite() && position.is_finite() {
            self.made.mesh.lights.push(FileLight { position, intensity, colour });
        }
        Ok(())
    }
}

/// The map from a node's coordinates to those of its parent.
fn transformation(node: &Node, index: usize) -> Result<DAffine3, MeshError> {
    let map = match node.matrix {
        Some(matrix) => DAffine3::from_mat4(DMat4::from_cols_array(&matrix.map(f64::from))),
        None => {
            let scale = node.scale.map_or(DVec3::ONE, |scale| Vec3::from_array(scale).as_dvec3());
            let translation = node.translation.map_or(DVec3::ZERO, |by| Vec3::from_array(by).as_dvec3());
            let rotation =
                node.rotation.map_or(DQuat::IDENTITY, |rotation| DQuat::from_array(rotation.0.map(f64::from)));
            // A unit quaternion rounded to f32 is not quite of length 1. One of length 0 is
            // taken for no rotation.
            let length = rotation.length();
            let rotation = if length > 0.0 { rotation / length } else { DQuat::IDENTITY };
            DAffine3::from_scale_rotation_translation(scale, rotation, translation)
        }
    };
    if map.is_finite() {
        return Ok(map);
    }
    let fault = MeshError::new(format!("the transformation of nodes[{index}] is not finite"));
    Err(fault.expected("numbers that f32 holds, within 3.4e38"))
}
