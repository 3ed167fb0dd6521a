//! Where the camera stands in the world, and the way to its own frame; and a camera that frames a mesh.

use glam::{DAffine3, DMat3, DVec3, Vec3};

use super::mesh::{Mesh, MeshFormat};
use super::{Camera, Light, Scene};

/// A camera's place in the world, whose axes are the paper's: at rest x points to the right, y up, and z away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Where the pinhole is.
    pub position: DVec3,
    /// What is in the middle of the picture.
    pub look_at: DVec3,
    /// What points upwards in the picture, as far as the direction of view lets it.
    pub up: DVec3,
}

/// Why a view cannot be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NoView {
    /// It looks at where it is, or the distance is beyond numbers.
    Direction,
    /// Up is nothing, or the direction of view.
    Up,
}

impl View {
    /// At the origin, looking along +z: the paper's camera.
    pub const AT_REST: View = View { position: DVec3::ZERO, look_at: DVec3::Z, up: DVec3::Y };

    /// The map from the world to the camera's frame: a rotation and a translation.
    pub(super) fn to_camera(self) -> Result<DAffine3, NoView> {
        let forward = (self.look_at - self.position).try_normalize().ok_or(NoView::Direction)?;
        let up = self.up.try_normalize().ok_or(NoView::Up)?;
        // An angle of less than about 1e-6 would leave little of the direction to the right.
        let right = Some(up.cross(forward)).filter(|it| it.length() > 1e-6).ok_or(NoView::Up)?.normalize();
        let rows = DMat3::from_cols(right, forward.cross(right), forward).transpose();
        Ok(DAffine3::from_mat3_translation(rows, -(rows * self.position)))
    }

    /// A view of points from the front, the right and above, as near as `camera` sees all of them with some room around;
    /// `to_world` is their map to the world.
    fn framing(points: &[Vec3], to_world: DAffine3, camera: &Camera) -> View {
        /// So many points, which are neighbours in most meshes, have a box of their own.
        const TOGETHER: usize = 64;
        let up = DVec3::Y;
        let eye = DVec3::new(0.55, 0.5, -1.0).normalize();
        let around = View { position: eye, look_at: DVec3::ZERO, up };
        let turn = around.to_camera().expect("a view from the front").matrix3;
        let turned = |point: &Vec3| turn * to_world.transform_point3(point.as_dvec3());
        let nowhere = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let both = |a: (DVec3, DVec3), b: (DVec3, DVec3)| (a.0.min(b.0), a.1.max(b.1));
        let box_of = |points: &[Vec3]| points.iter().map(turned).fold(nowhere, |all, point| both(all, (point, point)));
        let boxes: Vec<_> = points.chunks(TOGETHER).map(box_of).collect();
        let (low, high) = boxes.iter().copied().fold(nowhere, both);
        let middle = (low + high) / 2.0;
        let grid = camera.grid::<f64>();
        // Within the share ROOM of the film: |x| f / (z + distance) <= ROOM w for each point.
        const ROOM: f64 = 0.9;
        let needed = |across: f64, half: f64, z: f64| across * grid.focal / (ROOM * half) - z;
        let needed = |x: f64, y: f64, z: f64| needed(x, grid.half_width, z).max(needed(y, grid.half_height, z));
        let mut distance = 0.0;
        for (points, (low, high)) in points.chunks(TOGETHER).zip(boxes) {
            let (low, high) = (low - middle, high - middle);
            let furthest = low.abs().max(high.abs());
            // No point of the box needs more.
            if needed(furthest.x, furthest.y, low.z) > distance {
                let points = points.iter().map(|point| turned(point) - middle);
                distance = points.map(|p| needed(p.x.abs(), p.y.abs(), p.z)).fold(distance, f64::max);
            }
        }
        // A mesh as thin as the direction of view has no size across; it is kept in front all the same.
        let depth = (high.z - low.z) / 2.0;
        let distance = distance.max(1.01 * depth);
        let distance = if distance > 0.0 { distance } else { 1.0 };
        let centre = turn.transpose() * middle;
        View { position: centre + eye * distance, look_at: centre, up }
    }
}

/// The way from a mesh alone to a scene: how it stands in the world, and from where it is seen.
pub struct Setting {
    /// The mesh in the world.
    pub placement: super::mesh::Placement,
    /// The camera.
    pub view: View,
    /// The place of the one light, which is white.
    pub light: DVec3,
}

impl Setting {
    /// For a mesh of a format: it stands upright, is seen whole, and lit from the left above the camera.
    ///
    /// Nothing where its size is beyond numbers.
    pub fn of(mesh: &Mesh, format: MeshFormat, camera: &Camera) -> Option<Setting> {
        let placement = format.placement();
        let to_world = placement.to_world();
        let view = View::framing(&mesh.used(), to_world, camera);
        let to_camera = view.to_camera().ok()?;
        let away = view.position.distance(view.look_at);
        let light = to_camera.inverse().transform_point3(DVec3::new(-0.8, 1.0, -0.3) * away);
        light.as_vec3().is_finite().then_some(Setting { placement, view, light })
    }

    /// The scene of this mesh, in one colour, in the camera's frame; nothing where it leaves the range of f32.
    pub fn scene(&self, mesh: Mesh, colour: Vec3, name: String, camera: Camera) -> Option<Scene> {
        let to_camera = self.view.to_camera().ok()?;
        let triangles = mesh.placed(to_camera * self.placement.to_world(), colour)?;
        let position = to_camera.transform_point3(self.light).as_vec3();
        let lights = vec![Light { intensity: 1.0, colour: Vec3::ONE, position }];
        Some(Scene { name, camera, lights, spheres: Vec::new(), triangles })
    }
}
