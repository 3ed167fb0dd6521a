//! Where the camera stands in the world, and the way to its own frame; and a camera that frames a mesh.

use glam::{DAffine3, DMat3, DVec3, Vec3};

use super::mesh::{Mesh, MeshFormat, Placement};
use super::{Camera, Light, Scene, Triangle};

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

/// The map from a world, or from what is placed in it, to the camera's frame: p becomes `linear` (p - `position`).
///
/// What is near to the camera keeps its digits however far both are from the origin: the difference is rounded once, by 2^-53 of
/// itself at most, and its product with a rotation by some 2^-51 of its length; a translation of `linear` times `position` would be
/// rounded by 2^-53 of that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToCamera {
    linear: DMat3,
    position: DVec3,
}

impl ToCamera {
    /// Everything where it is.
    pub const IDENTITY: ToCamera = ToCamera { linear: DMat3::IDENTITY, position: DVec3::ZERO };

    /// The place of a point, seen from the camera.
    pub fn point(&self, point: DVec3) -> DVec3 {
        self.linear * (point - self.position)
    }

    /// The map from what is placed in the world so.
    pub fn of_placed(&self, placement: &Placement) -> ToCamera {
        let DAffine3 { matrix3, translation } = placement.to_world();
        let (scale, away) = (placement.scale.to_array(), self.position - translation);
        // The columns are those of a rotation, each times a factor.
        let position = DVec3::from([0, 1, 2].map(|i| (matrix3.col(i) / scale[i]).dot(away) / scale[i]));
        ToCamera { linear: self.linear * matrix3, position }
    }
}

/// Why nothing can be seen from a view.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ViewError {
    /// It looks at where it is, or the distance is beyond numbers.
    #[error("the camera looks at where it stands, which is no direction")]
    Direction,
    /// Up is nothing, or the direction of view.
    #[error("the camera's up is the direction of its view, or nothing")]
    Up,
    /// Whose place has no number: "sphere 2's centre", counted from 1 in the scene's order.
    #[error("{0} leaves the range of f32, seen from the camera")]
    Range(String),
}

impl View {
    /// At the origin, looking along +z: the paper's camera.
    pub const AT_REST: View = View { position: DVec3::ZERO, look_at: DVec3::Z, up: DVec3::Y };

    /// The map from the world to the camera's frame.
    ///
    /// # Errors
    /// Where there is no direction to look in, or `up` does not tell which way is up in the picture.
    pub fn to_camera(self) -> Result<ToCamera, ViewError> {
        let forward = (self.look_at - self.position).try_normalize().ok_or(ViewError::Direction)?;
        let up = self.up.try_normalize().ok_or(ViewError::Up)?;
        // An angle of less than about 1e-6 would leave little of the direction to the right.
        let right = Some(up.cross(forward)).filter(|it| it.length() > 1e-6).ok_or(ViewError::Up)?.normalize();
        let rows = DMat3::from_cols(right, forward.cross(right), forward).transpose();
        Ok(ToCamera { linear: rows, position: self.position })
    }

    /// A view of points from the front, the right and above, as near as `camera` sees all of them with some room around;
    /// `to_world` is their map to the world.
    fn framing(points: &[Vec3], to_world: DAffine3, camera: &Camera) -> View {
        /// So many points, which are neighbours in most meshes, have a box of their own.
        const TOGETHER: usize = 64;
        let up = DVec3::Y;
        let eye = DVec3::new(0.55, 0.5, -1.0).normalize();
        let around = View { position: eye, look_at: DVec3::ZERO, up };
        let turn = around.to_camera().expect("a view from the front").linear;
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

impl Scene {
    /// What this scene, taken for a world, is to a camera that stands in it: the scene in the camera's frame, which is what
    /// engines trace. Every point is moved in f64 and rounded once; [`View::AT_REST`] changes nothing.
    ///
    /// A camera that moves sees the same world from one view after the other:
    ///
    /// ```
    /// use rayo::glam::{DVec3, Vec3};
    /// use rayo::{Camera, Engine, Faces, Film, Light, PixelFormat, Scene, Sphere, View};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let world = Scene {
    ///     name: "moon.png".into(),
    ///     camera: Camera::new(64, 64, 1.0, 1.0)?,
    ///     lights: vec![Light { intensity: 1.0, colour: Vec3::ONE, position: Vec3::new(-50.0, 0.0, 0.0) }],
    ///     spheres: vec![Sphere { radius: 1.0, colour: Vec3::ONE, centre: Vec3::ZERO }],
    ///     triangles: vec![],
    ///     faces: Faces::default(),
    /// };
    /// // Half a turn around the sphere, from its lit side to its dark one.
    /// let mut middle = Vec::new();
    /// for degrees in [0.0_f64, 60.0, 120.0, 180.0] {
    ///     let (sin, cos) = degrees.to_radians().sin_cos();
    ///     let view = View { position: DVec3::new(-5.0 * cos, 0.0, -5.0 * sin), look_at: DVec3::ZERO, up: DVec3::Y };
    ///     let scene = world.seen_from(view)?;
    ///     let mut film = Film::new(PixelFormat::F32x4, scene.camera.pixels() as usize)?;
    ///     Engine::fastest().prepare(None, &scene)?.rows(0..64, film.as_mut());
    ///     middle.push(film.colour(32 * 64 + 32).levels()[0]);
    /// }
    /// assert!(middle[0] > 250 && middle[1] < middle[0] && middle[2..] == [0, 0], "{middle:?}");
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`View::to_camera`], and where a point leaves the range of f32.
    pub fn seen_from(&self, view: View) -> Result<Scene, ViewError> {
        let to_camera = view.to_camera()?;
        let mut scene = self.clone();
        // Zeros keep their signs.
        if to_camera == ToCamera::IDENTITY {
            return Ok(scene);
        }
        let moved = |point: Vec3| to_camera.point(point.as_dvec3()).as_vec3();
        let beyond = |thing, i, point| ViewError::Range(format!("{thing} {}'s {point}", i + 1));
        for (i, light) in scene.lights.iter_mut().enumerate() {
            light.position = moved(light.position);
            if !light.position.is_finite() {
                return Err(beyond("light", i, "position"));
            }
        }
        for (i, sphere) in scene.spheres.iter_mut().enumerate() {
            sphere.centre = moved(sphere.centre);
            if !sphere.centre.is_finite() {
                return Err(beyond("sphere", i, "centre"));
            }
        }
        for (i, triangle) in scene.triangles.iter_mut().enumerate() {
            let vertices = triangle.vertices.map(moved);
            if !vertices.iter().all(|vertex| vertex.is_finite()) {
                return Err(beyond("triangle", i, "vertices"));
            }
            *triangle = Triangle::of_moved(triangle.colour, triangle.has_no_area(), vertices);
        }
        let before = scene.triangles.len();
        scene.faces = scene.faces.moved(to_camera).map_err(|face| beyond("triangle", before + face, "vertices"))?;
        Ok(scene)
    }
}

/// The way from a mesh alone to a scene: how it stands in the world, and from where it is seen.
pub struct Setting {
    /// The mesh in the world.
    pub placement: Placement,
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
        let light = view.position + to_camera.linear.transpose() * (DVec3::new(-0.8, 1.0, -0.3) * away);
        light.as_vec3().is_finite().then_some(Setting { placement, view, light })
    }

    /// The scene of this mesh, its colours times `colour`, in the camera's frame; nothing where it leaves the range of f32.
    pub fn scene(&self, mesh: Mesh, colour: Vec3, name: String, camera: Camera) -> Option<Scene> {
        let to_camera = self.view.to_camera().ok()?;
        let faces = mesh.placed(to_camera.of_placed(&self.placement), colour)?;
        let position = to_camera.point(self.light).as_vec3();
        let lights = vec![Light { intensity: 1.0, colour: Vec3::ONE, position }];
        Some(Scene { name, camera, lights, spheres: Vec::new(), triangles: Vec::new(), faces })
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Rng, many};
    use super::*;

    #[test]
    fn at_rest_a_scene_is_seen_as_it_is_to_the_last_bit() {
        let mut scene = many(20, 20, 3);
        scene.spheres[0].centre.x = -0.0;
        let seen = scene.seen_from(View::AT_REST).unwrap();
        assert_eq!(seen, scene);
        assert!(seen.spheres[0].centre.x.is_sign_negative());
    }

    #[test]
    fn a_camera_that_steps_back_and_turns_round_sees_what_was_behind_it_in_front_and_the_sides_exchanged() {
        let scene = many(5, 5, 3);
        let view = View { position: DVec3::new(0.0, 0.0, 8.0), look_at: DVec3::ZERO, up: DVec3::Y };
        let seen = scene.seen_from(view).unwrap();
        let expected = |point: Vec3| Vec3::new(-point.x, point.y, 8.0 - point.z);
        for (seen, object) in seen.spheres.iter().zip(&scene.spheres) {
            assert_eq!(
                (seen.centre, seen.radius, seen.colour),
                (expected(object.centre), object.radius, object.colour)
            );
        }
        for (seen, object) in seen.triangles.iter().zip(&scene.triangles) {
            assert_eq!((seen.vertices, seen.colour), (object.vertices.map(expected), object.colour));
        }
        for (seen, light) in seen.lights.iter().zip(&scene.lights) {
            assert_eq!(*seen, Light { position: expected(light.position), ..*light });
        }
        assert_eq!((seen.camera, &seen.name), (scene.camera, &scene.name));
    }

    #[test]
    fn what_is_placed_in_a_world_keeps_its_digits_however_far_both_are_from_the_origin() {
        let position = DVec3::new(1.5, -2.25, 0.5);
        let view = View { position, look_at: DVec3::new(0.5, 0.0, 4.0), up: DVec3::Y };
        let (scale, rotate) = (DVec3::new(0.3, -2.0, 1e-3), DVec3::new(20.0, 90.0, -130.0));
        let placed = |by: f64| {
            let away = DVec3::splat(by);
            let view = View { position: position + away, look_at: view.look_at + away, ..view };
            view.to_camera().unwrap().of_placed(&Placement { scale, rotate, translate: away - 3.0 })
        };
        let point = DVec3::new(0.1, 2.0, -300.0);
        let in_world = Placement { scale, rotate, translate: DVec3::splat(-3.0) }.to_world().transform_point3(point);
        let expected = view.to_camera().unwrap().point(in_world);
        assert!(placed(0.0).point(point).distance(expected) < 1e-14 * expected.length());
        for exponent in 10..51 {
            assert_eq!(placed(2f64.powi(exponent)), placed(0.0), "2^{exponent}");
        }
    }

    #[test]
    fn corners_on_one_line_have_no_area_however_f32_rounds_their_sides() {
        let mut rng = Rng::new(1);
        let mut whole = || (1 + rng.next_u64() % 4095) as f32;
        for _ in 0..10_000 {
            let along = Vec3::from_array([(); 3].map(|()| whole()));
            let vertices = [1.0 / 4096.0, whole(), whole()].map(|factor| factor * along);
            assert!(Triangle { colour: Vec3::ONE, vertices }.has_no_area(), "{vertices:?}");
        }
    }

    #[test]
    fn a_triangle_of_no_area_has_none_from_anywhere() {
        let mut scene = many(0, 1, 1);
        scene.triangles[0].vertices = [1.0, 2.0, 7.0].map(|z| z * Vec3::new(77.0, 179.0, 256.0));
        assert!(scene.triangles[0].has_no_area());
        for x in 1..50 {
            let view = View { position: DVec3::new(0.1 * f64::from(x), 1.0, -2.0), look_at: DVec3::Z, up: DVec3::Y };
            assert!(scene.seen_from(view).unwrap().triangles[0].has_no_area(), "x = {x}");
        }
    }

    #[test]
    fn a_view_of_nothing_and_a_place_beyond_f32_are_errors_that_name_it() {
        let mut scene = many(2, 1, 1);
        let seen = |scene: &Scene, view| scene.seen_from(view).unwrap_err().to_string();
        let still = View { look_at: DVec3::ZERO, ..View::AT_REST };
        assert_eq!(seen(&scene, still), "the camera looks at where it stands, which is no direction");
        let nan = View { position: DVec3::NAN, ..View::AT_REST };
        assert_eq!(scene.seen_from(nan), Err(ViewError::Direction));
        for up in [DVec3::Z, DVec3::ZERO, DVec3::NAN] {
            assert_eq!(scene.seen_from(View { up, ..View::AT_REST }), Err(ViewError::Up), "{up}");
        }
        let behind = View { position: DVec3::new(0.0, 0.0, -3e38), look_at: DVec3::ZERO, up: DVec3::Y };
        scene.spheres[1].centre.z = 3e38;
        assert_eq!(seen(&scene, behind), "sphere 2's centre leaves the range of f32, seen from the camera");
        scene.spheres[1].centre.z = 3.0;
        scene.triangles[0].vertices[2].z = 3e38;
        assert_eq!(scene.seen_from(behind), Err(ViewError::Range("triangle 1's vertices".into())));
        scene.lights[0].position.z = 3e38;
        assert_eq!(scene.seen_from(behind), Err(ViewError::Range("light 1's position".into())));
    }
}
