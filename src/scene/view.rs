//! Where the camera stands in the world or moves, the transformation to its frame, and a camera
//! that frames a mesh.

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};

use super::mesh::Placement;
use super::{Camera, PlainArea, Scene};
use crate::kernels::StandardFloats;

/// A camera's place in the world, whose axes are the paper's: at rest x points to the right, y up,
/// and z away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Where the pinhole is.
    pub position: DVec3,
    /// What is in the middle of the picture.
    pub look_at: DVec3,
    /// What points upwards in the picture, as far as the direction of view lets it.
    pub up: DVec3,
}

/// The map from a world, or from what is placed in it, to the camera's frame: p becomes `linear` (p
/// - `position`).
///
/// What is near to the camera keeps its digits however far both are from the origin: the difference
/// is rounded once, by 2^-53 of itself at most, and its product with a rotation by some 2^-51 of
/// its length; a translation of `linear` times `position` would be rounded by 2^-53 of that.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToCamera {
    pub(super) linear: DMat3,
    position: DVec3,
}

impl ToCamera {
    /// Everything where it is.
    pub const IDENTITY: ToCamera = ToCamera { linear: DMat3::IDENTITY, position: DVec3::ZERO };

    /// The place of a point, seen from the camera.
    pub fn point(&self, point: DVec3) -> DVec3 {
        self.linear * (point - self.position)
    }

    /// The map to this camera from the frame of another one, whose own map is `other`.
    fn after_frame_of(&self, other: &ToCamera) -> ToCamera {
        if self == other {
            // Nothing moves, and nothing is rounded.
            return ToCamera::IDENTITY;
        }
        let linear = self.linear * other.linear.transpose();
        ToCamera { linear, position: other.linear * (self.position - other.position) }
    }

    /// The map for points whose coordinates are relative to `origin`, a point of the world that
    /// this map takes.
    pub(super) fn for_points_from(&self, origin: DVec3) -> ToCamera {
        ToCamera { position: self.position - origin, ..*self }
    }

    /// The test of triangles that have an area before and after they are moved.
    pub(super) fn plain_area(&self) -> PlainArea {
        let DMat3 { x_axis, y_axis, z_axis } = self.linear;
        PlainArea::after_move([x_axis, y_axis, z_axis].map(DVec3::length), self.position.length())
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
    /// Up is zero, or parallel to the view.
    #[error("the camera's up is parallel to its view, or zero")]
    Up,
    /// A point leaves the range of f32, seen from the camera: whose, such as "sphere 2's centre",
    /// counted from 1 in the scene's order.
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
    /// Where there is no direction to look in, or `up` does not tell which way is up in the
    /// picture.
    pub fn to_camera(self) -> Result<ToCamera, ViewError> {
        let _floats = StandardFloats::set();
        let forward = (self.look_at - self.position).try_normalize().ok_or(ViewError::Direction)?;
        let up = self.up.try_normalize().ok_or(ViewError::Up)?;
        // An angle of less than about 1e-6 would leave little of the direction to the right.
        let right = Some(up.cross(forward)).filter(|it| it.length() > 1e-6).ok_or(ViewError::Up)?.normalize();
        let rows = DMat3::from_cols(right, forward.cross(right), forward).transpose();
        Ok(ToCamera { linear: rows, position: self.position })
    }

    /// The view after an orbit by `part` of a turn to the right, about the world's up, around the
    /// point in the middle of the picture at this depth.
    ///
    /// # Errors
    /// If there is nothing to be seen from this view.
    pub fn orbit(self, depth: f64, part: f64) -> Result<View, ViewError> {
        let _floats = StandardFloats::set();
        let to_camera = self.to_camera()?;
        let up = to_camera.linear * self.up.normalize();
        let middle = DVec3::Z * depth;
        let turn = DQuat::from_axis_angle(up, -std::f64::consts::TAU * part);
        let position = middle - turn * middle;
        if position == DVec3::ZERO {
            return Ok(self);
        }
        // As long as the way there, in whatever unit: a step of 1 would be lost in the digits of a
        // place far away.
        let look_at = position + turn * DVec3::Z * position.length();
        let to_world = to_camera.linear.transpose();
        let point_in_world = |point: DVec3| to_world * point + self.position;
        Ok(View {
            position: point_in_world(position),
            look_at: point_in_world(look_at),
            up: to_world * (turn * DVec3::Y),
        })
    }

    /// A view of items from the direction `eye` in the world, as near as `camera` sees all of them
    /// with some room around. `ball` is the place of an item and a radius around it, and `to_world`
    /// the map of places to the world, which keeps lengths. From straight above or below, what is
    /// further away is up.
    pub(super) fn framing<T>(
        items: &[T],
        ball: impl Fn(&T) -> (Vec3, f32),
        to_world: DAffine3,
        camera: &Camera,
        eye: DVec3,
    ) -> View {
        /// So many items, which are neighbours in most files, have a box of their own.
        const TOGETHER: usize = 64;
        let from = |up: DVec3| View { position: eye, look_at: DVec3::ZERO, up };
        let around = [from(DVec3::Y), from(DVec3::Z)].into_iter().find(|view| view.to_camera().is_ok());
        let around = around.expect("a direction is across one of two axes");
        let turn = around.to_camera().expect("it was looked for").linear;
        let turned = |item: &T| {
            let (place, radius) = ball(item);
            (turn * to_world.transform_point3(place.as_dvec3()), f64::from(radius))
        };
        let nowhere = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let both = |a: (DVec3, DVec3), b: (DVec3, DVec3)| (a.0.min(b.0), a.1.max(b.1));
        let box_of = |items: &[T]| {
            let balls = items.iter().map(turned);
            balls.fold(nowhere, |all, (place, radius)| both(all, (place - radius, place + radius)))
        };
        let boxes: Vec<_> = items.chunks(TOGETHER).map(box_of).collect();
        let (low, high) = boxes.iter().copied().fold(nowhere, both);
        let middle = (low + high) / 2.0;
        let grid = camera.grid::<f64>();
        // Within the share ROOM of the film: |x| f / (z + distance) <= ROOM w for each point, and
        // for a ball a plane through the pinhole and the edge of that share of the film stays a
        // radius away.
        const ROOM: f64 = 0.9;
        let needed = |across: f64, half: f64, z: f64, radius: f64| {
            let half = ROOM * half;
            (across * grid.focal + radius * grid.focal.hypot(half)) / half - z
        };
        let needed = |place: DVec3, radius: f64| {
            let wide = needed(place.x.abs(), grid.half_width, place.z, radius);
            wide.max(needed(place.y.abs(), grid.half_height, place.z, radius))
        };
        let mut distance = 0.0;
        for (items, (low, high)) in items.chunks(TOGETHER).zip(boxes) {
            let (low, high) = (low - middle, high - middle);
            let furthest = low.abs().max(high.abs());
            // No item of the box needs more.
            if needed(furthest.with_z(low.z), 0.0) > distance {
                let balls = items.iter().map(turned);
                distance = balls.map(|(place, radius)| needed(place - middle, radius)).fold(distance, f64::max);
            }
        }
        // A mesh as thin as the direction of view has no size across; it is kept in front all the
        // same.
        let depth = (high.z - low.z) / 2.0;
        let distance = distance.max(1.01 * depth);
        let distance = if distance > 0.0 { distance } else { 1.0 };
        let centre = turn.transpose() * middle;
        View { position: centre + eye * distance, look_at: centre, up: around.up }
    }
}

impl Scene {
    /// The scene as a camera sees it that stands elsewhere in the same world. Every point is moved
    /// in f64 from the frame of this scene's own [`view`](Scene::view) to that of the new one, and
    /// rounded once; its own view changes nothing. A scene that is made in code, with the default
    /// view, is its own world.
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
    /// If there is nothing to be seen from either view, and where a point leaves the range of f32.
    pub fn seen_from(&self, view: View) -> Result<Scene, ViewError> {
        let mut camera = MovingCamera::of(self);
        camera.seen_from(view)?;
        Ok(camera.seen)
    }
}

/// A world as a camera that moves sees it: what every view gives is put where the one before it
/// was. It gives what [`Scene::seen_from`] does, and takes no new memory for it.
///
/// ```
/// use rayo::glam::{DVec3, Vec3};
/// use rayo::{Camera, Engine, Film, Frame, MovingCamera, PixelFormat, Plan, Purpose, Scene, Settings, Sphere, View};
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let ball = Sphere { radius: 1.0, colour: Vec3::ONE, centre: Vec3::ZERO };
/// let world = Scene { spheres: vec![ball], ..Scene::new(Camera::new(64, 48, 1.0, 1.0)?) };
/// let (format, threads) = (PixelFormat::Rgba8, 2);
/// let mut film = Film::new(format, world.camera.pixels() as usize)?;
/// let mut camera = MovingCamera::of(&world);
/// for step in 0..3 {
///     let position = DVec3::new(f64::from(step), 1.0, -5.0);
///     let scene = camera.seen_from(View { position, look_at: DVec3::ZERO, up: DVec3::Y })?;
///     // What to cull depends on where the camera is.
///     let purpose = Purpose { format: Some(format), threads, ..Purpose::default() };
///     let plan = Plan::new(Engine::fastest(), scene, purpose)?;
///     let frame = Frame::new(plan.tracer(), scene.camera, Settings { threads })?;
///     frame.trace(0..scene.camera.height(), film.as_mut(), &|_rows| {})?;
///     assert!(frame.hit(32, 24).is_some(), "the ball is in the middle of every picture");
/// }
/// # Ok(())
/// # }
/// ```
///
/// `examples/moving_camera.rs` goes round a mesh of a million triangles, and measures it.
pub struct MovingCamera<'a> {
    world: &'a Scene,
    seen: Scene,
    /// The triangles and the faces of the world that have no area.
    flat: (Vec<usize>, Vec<usize>),
    /// The largest of all coordinates, or infinity where one is no number.
    furthest: f32,
    /// The light that goes with the camera, by its index.
    carried_light: Option<usize>,
}

impl<'a> MovingCamera<'a> {
    /// Makes room for a copy of the world. This takes longer than a move.
    pub fn of(world: &'a Scene) -> Self {
        let _floats = StandardFloats::set();
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
        MovingCamera { world, seen: world.clone(), flat, furthest, carried_light: None }
    }

    /// Has the camera carry a light of the world, by its index, as [`Opened::carried_light`] gives
    /// it for the scene of a file: the light keeps its place in the camera's frame.
    ///
    /// [`Opened::carried_light`]: crate::Opened::carried_light
    pub fn carrying_light(self, carried_light: Option<usize>) -> Self {
        MovingCamera { carried_light, ..self }
    }

    /// Sets the camera of its views from the next one on: of another size, or with another film.
    pub fn set_camera(&mut self, camera: Camera) {
        self.seen.camera = camera;
    }

    /// Sets whether objects cast shadows in its views from the next one on.
    pub fn set_shadows(&mut self, shadows: bool) {
        self.seen.shadows = shadows;
    }

    /// As [`Scene::seen_from`], with the camera and the shadows that were set.
    ///
    /// # Errors
    /// As there; then what was seen before is lost.
    pub fn seen_from(&mut self, view: View) -> Result<&Scene, ViewError> {
        let _floats = StandardFloats::set();
        let to_camera = view.to_camera()?.after_frame_of(&self.world.view.to_camera()?);
        // Zeros keep their signs.
        let at_rest = to_camera == ToCamera::IDENTITY;
        let moved = |point: Vec3| {
            if at_rest { point } else { to_camera.point(point.as_dvec3()).as_vec3() }
        };
        let (world, seen) = (self.world, &mut self.seen);
        for (i, light) in world.lights.iter().enumerate().filter(|(i, _)| Some(*i) != self.carried_light) {
            seen.lights[i].position = moved(light.position);
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
        let reach = 2.0 * (f64::from(self.furthest) + to_camera.position.abs().max_element());
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
        seen.view = view;
        Ok(seen)
    }
}

impl Scene {
    /// The view after an orbit around the scene: [`View::orbit`] of the scene's own view, at its
    /// [`middle_depth`](Self::middle_depth). That visits every object, so that a camera that keeps
    /// moving should compute it once.
    ///
    /// # Errors
    /// If there is nothing to be seen from the scene's own view.
    pub fn orbit(&self, part: f64) -> Result<View, ViewError> {
        self.view.orbit(self.middle_depth(), part)
    }

    /// The depth of the middle of all objects, seen from the camera: halfway from the nearest
    /// centre or corner to the furthest. 0 where there is no object.
    pub fn middle_depth(&self) -> f64 {
        let _floats = StandardFloats::set();
        let depths = self.spheres.iter().map(|sphere| sphere.centre.z).chain(self.vertices().map(|vertex| vertex.z));
        let (near, far) = depths.fold((f32::MAX, f32::MIN), |(near, far), z| (near.min(z), far.max(z)));
        (f64::from(near) + f64::from(far)) / 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Faces, Rng, Triangle, many};
    use super::*;

    #[test]
    fn placed_objects_keep_their_digits_far_from_the_origin() {
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
    fn corners_on_one_line_have_no_area() {
        let mut rng = Rng::new(1);
        let mut whole = || (1 + rng.next_u64() % 4095) as f32;
        for _ in 0..10_000 {
            let along = Vec3::from_array([(); 3].map(|()| whole()));
            let vertices = [1.0 / 4096.0, whole(), whole()].map(|factor| factor * along);
            assert!(Triangle { colour: Vec3::ONE, vertices }.has_no_area(), "{vertices:?}");
        }
    }

    #[test]
    fn moving_camera_sees_the_world_moved_once() {
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
            // The camera sees by what is set, which is then set back.
            let small = world.camera.sized(12, 9).unwrap();
            camera.set_camera(small);
            camera.set_shadows(!world.shadows);
            let other = Scene { camera: small, shadows: !world.shadows, ..world.clone() };
            assert!(*camera.seen_from(view).unwrap() == other.seen_from(view).unwrap(), "x = {x}");
            camera.set_camera(world.camera);
            camera.set_shadows(world.shadows);
            let at_rest = camera.seen_from(View::default()).unwrap();
            assert!(*at_rest == world && at_rest.spheres[0].centre.x.is_sign_negative());
            assert!(camera.seen_from(View { position: DVec3::splat(-1e39), ..view }).is_err());
        }
    }

    #[test]
    fn a_camera_goes_round_what_it_looks_at_and_comes_back() {
        let world = many(50, 50, 3);
        let middle = |view: View| view.to_camera().unwrap().linear.transpose() * DVec3::Z;
        let orbit = |part| world.orbit(part).unwrap();
        assert_eq!(orbit(0.0), View::default());
        // To the right, a quarter of a turn to the left of what is behind it.
        let right = orbit(0.25);
        let distance = right.position.x;
        assert!(distance > 0.0 && (right.position.z - distance).abs() < 1e-12 * distance, "{right:?}");
        assert!(middle(right).distance(DVec3::NEG_X) < 1e-12);
        assert!(orbit(1.0).position.length() < 1e-12 * distance);
        // A camera that looks down stays above.
        let up = DVec3::new(0.0, 0.8, 0.6);
        let world = Scene { view: View { up, ..View::default() }, ..world };
        assert!(world.orbit(0.5).unwrap().position.dot(up).abs() < 1e-12 * distance);
    }

    #[test]
    fn view_of_nothing_or_beyond_f32_is_a_named_error() {
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
