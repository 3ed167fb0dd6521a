//! Where the camera stands in the world or moves, the transformation to its frame, and a camera that frames a mesh.

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};

use super::mesh::{Mesh, MeshFormat, Placement};
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

impl Default for View {
    /// At the origin, looking along +z: the paper's camera.
    fn default() -> Self {
        View { position: DVec3::ZERO, look_at: DVec3::Z, up: DVec3::Y }
    }
}

impl View {
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

    /// What is `up`, seen from the camera: of length 1.
    #[cfg(feature = "files")]
    pub(super) fn up(self) -> Option<DVec3> {
        Some(self.to_camera().ok()?.linear * self.up.try_normalize()?)
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
    /// engines trace. Every point is moved in f64 and rounded once; the default view changes nothing.
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
    ///     lights: vec![Light { intensity: 1.0, colour: Vec3::ONE, position: Vec3::new(-50.0, 0.0, 0.0) }],
    ///     spheres: vec![Sphere { radius: 1.0, colour: Vec3::ONE, centre: Vec3::ZERO }],
    ///     ..Scene::new(Camera::new(64, 64, 1.0, 1.0)?)
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
    /// [`MovingCamera`] does the same again and again, and sooner.
    ///
    /// # Errors
    /// As [`View::to_camera`], and where a point leaves the range of f32.
    pub fn seen_from(&self, view: View) -> Result<Scene, ViewError> {
        let mut camera = MovingCamera::of(self);
        camera.seen_from(view)?;
        Ok(camera.seen)
    }
}

/// A world as a camera that moves sees it: what every view gives is put where the one before it was.
///
/// `examples/moving_camera.rs` goes round a mesh of a million triangles.
pub struct MovingCamera<'a> {
    world: &'a Scene,
    seen: Scene,
    /// The triangles and the faces of the world that have no area.
    flat: (Vec<usize>, Vec<usize>),
    /// The largest of all coordinates, or infinity where one is no number.
    furthest: f32,
}

impl<'a> MovingCamera<'a> {
    /// Makes room for a world, which this takes longer than to move it.
    pub fn of(world: &'a Scene) -> Self {
        let places = world.vertices().chain(world.lights.iter().map(|light| &light.position));
        let places = places.chain(world.spheres.iter().map(|sphere| &sphere.centre));
        let furthest =
            places.fold(
                0.0,
                |furthest: f32, place| {
                    if place.is_finite() { furthest.max(place.abs().max_element()) } else { f32::INFINITY }
                },
            );
        let is_flat = |i: &usize| world.triangles[*i].has_no_area();
        let flat = ((0..world.triangles.len()).filter(is_flat).collect(), world.faces.without_area());
        MovingCamera { world, seen: world.clone(), flat, furthest }
    }

    /// As [`Scene::seen_from`].
    ///
    /// # Errors
    /// As there; then what was seen before is lost.
    pub fn seen_from(&mut self, view: View) -> Result<&Scene, ViewError> {
        let to_camera = view.to_camera()?;
        // Zeros keep their signs.
        let at_rest = to_camera == ToCamera::IDENTITY;
        let moved = |point: Vec3| {
            if at_rest { point } else { to_camera.point(point.as_dvec3()).as_vec3() }
        };
        let (world, seen) = (self.world, &mut self.seen);
        for (seen, light) in seen.lights.iter_mut().zip(&world.lights) {
            seen.position = moved(light.position);
        }
        for (seen, sphere) in seen.spheres.iter_mut().zip(&world.spheres) {
            seen.centre = moved(sphere.centre);
        }
        for (seen, triangle) in seen.triangles.iter_mut().zip(&world.triangles) {
            seen.vertices = triangle.vertices.map(moved);
        }
        for (seen, vertex) in seen.faces.vertices_mut().iter_mut().zip(world.faces.vertices()) {
            *seen = moved(*vertex);
        }
        // A turn makes a number at most root three times as large.
        let reach = 2.0 * (f64::from(self.furthest) + view.position.abs().max_element());
        if reach >= f32::MAX.into() {
            // The world had numbers.
            seen.check().map_err(|beyond| ViewError::Range(beyond.field))?;
        }
        let (triangles, faces) = &self.flat;
        triangles.iter().for_each(|triangle| seen.triangles[*triangle].flatten());
        for face in faces {
            seen.faces.take_corners(&world.faces, *face);
        }
        seen.faces.flatten(faces);
        Ok(seen)
    }
}

impl Scene {
    /// Where a camera at rest goes that goes round what it looks at, as far away as the middle of all objects: to the right, by such
    /// a part of a turn about `up`, which is as in [`Opened`](super::Opened).
    pub fn orbit(&self, up: DVec3, part: f64) -> View {
        let depths = self.spheres.iter().map(|sphere| sphere.centre.z).chain(self.vertices().map(|vertex| vertex.z));
        let (near, far) = depths.fold((f32::MAX, f32::MIN), |(near, far), z| (near.min(z), far.max(z)));
        let middle = DVec3::Z * (f64::from(near) + f64::from(far)) / 2.0;
        let turn = DQuat::from_axis_angle(up, -std::f64::consts::TAU * part);
        let position = middle - turn * middle;
        // As long as the way there, in whatever unit: a step of 1 would be lost in the digits of a place far away.
        let step = if position == DVec3::ZERO { 1.0 } else { position.length() };
        View { position, look_at: position + turn * DVec3::Z * step, up: turn * DVec3::Y }
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
        Some(Scene { name, lights, faces, ..Scene::new(camera) })
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Faces, Rng, Triangle, many};
    use super::*;

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
    fn what_a_moving_camera_sees_is_the_world_moved_once_wherever_it_was_before() {
        let mut world = many(5, 40, 3);
        world.spheres[0].centre.x = -0.0;
        let line = [1.0, 2.0, 7.0].map(|z| z * Vec3::new(77.0, 179.0, 256.0));
        (0..9).for_each(|i| world.triangles[4 * i].vertices = line);
        let vertices = [line, world.triangles[1].vertices].concat();
        world.faces = Faces::new(vertices, vec![[0, 1, 2], [3, 4, 5], [0, 4, 5]], Vec3::ONE);
        let mut camera = MovingCamera::of(&world);
        for x in (-25..25).map(f64::from) {
            let view = View { position: DVec3::new(0.1 * x, 1.0, -2.0), look_at: DVec3::Z, up: DVec3::Y };
            let seen = camera.seen_from(view).unwrap();
            assert!(*seen == world.seen_from(view).unwrap(), "x = {x}");
            let map = view.to_camera().unwrap();
            let moved = |point: &Vec3| map.point(point.as_dvec3()).as_vec3();
            assert!(seen.faces.vertices().iter().copied().eq(world.faces.vertices().iter().map(moved)));
            assert!(seen.faces.get(0).has_no_area() && seen.faces.corners()[1..] == world.faces.corners()[1..]);
            for (i, triangle) in seen.triangles.iter().enumerate() {
                let flat = world.triangles[i].has_no_area();
                assert!(if flat {
                    triangle.has_no_area()
                } else {
                    triangle.vertices == world.triangles[i].vertices.map(|v| moved(&v))
                });
            }
            let at_rest = camera.seen_from(View::default()).unwrap();
            assert!(*at_rest == world && at_rest.spheres[0].centre.x.is_sign_negative());
            assert!(camera.seen_from(View { position: DVec3::splat(-1e39), ..view }).is_err());
        }
    }

    #[test]
    fn a_camera_goes_round_what_it_looks_at_and_comes_back() {
        let world = many(50, 50, 3);
        let middle = |view: View| view.to_camera().unwrap().linear.transpose() * DVec3::Z;
        let start = world.orbit(DVec3::Y, 0.0);
        assert_eq!(start, View::default());
        // To the right, a quarter of a turn to the left of what is behind it.
        let right = world.orbit(DVec3::Y, 0.25);
        let distance = right.position.x;
        assert!(distance > 0.0 && (right.position.z - distance).abs() < 1e-12 * distance, "{right:?}");
        assert!(middle(right).distance(DVec3::NEG_X) < 1e-12);
        assert!(world.orbit(DVec3::Y, 1.0).position.length() < 1e-12 * distance);
        // A camera that looks down stays above.
        let up = DVec3::new(0.0, 0.8, 0.6);
        assert!((world.orbit(up, 0.5).position.dot(up)).abs() < 1e-12 * distance);
    }

    #[test]
    fn a_view_of_nothing_and_a_place_beyond_f32_are_errors_that_name_it() {
        let mut scene = many(2, 1, 1);
        let seen = |scene: &Scene, view| scene.seen_from(view).unwrap_err().to_string();
        let still = View { look_at: DVec3::ZERO, ..View::default() };
        assert_eq!(seen(&scene, still), "the camera looks at where it stands, which is no direction");
        let nan = View { position: DVec3::NAN, ..View::default() };
        assert_eq!(scene.seen_from(nan), Err(ViewError::Direction));
        for up in [DVec3::Z, DVec3::ZERO, DVec3::NAN] {
            assert_eq!(scene.seen_from(View { up, ..View::default() }), Err(ViewError::Up), "{up}");
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
