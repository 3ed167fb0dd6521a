//! The position and orientation of the camera in the world, the transformation to camera
//! coordinates, and views that show all of a model.

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};

use super::mesh::Placement;
use super::{Camera, PlainArea, Scene};
use crate::kernels::StandardFloats;

/// The camera's position and orientation in the world, whose coordinates are left-handed as in the
/// paper: for the default view x points to the right, y upwards, and z away from the viewer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The position of the pinhole.
    pub position: DVec3,
    /// The point in the middle of the picture.
    pub look_at: DVec3,
    /// The direction that points upwards in the picture. Only its part perpendicular to the
    /// direction of view matters.
    pub up: DVec3,
}

/// The map from world coordinates, or from those of an object placed in the world, to camera
/// coordinates: p is mapped to `linear` (p - `position`).
///
/// Points near the camera keep their precision, however far both are from the origin: the
/// difference has a rounding error of at most 2^-53 of itself, and its product with a rotation one
/// of about 2^-51 of its length. A translation by `linear` times `position`, added after the
/// product, would have an error of 2^-53 of that translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToCamera {
    pub(super) linear: DMat3,
    position: DVec3,
}

impl ToCamera {
    /// The identity map.
    pub const IDENTITY: ToCamera = ToCamera { linear: DMat3::IDENTITY, position: DVec3::ZERO };

    /// The camera coordinates of a point.
    pub fn point(&self, point: DVec3) -> DVec3 {
        self.linear * (point - self.position)
    }

    /// The map to this camera's coordinates from those of another camera, whose map from the world
    /// is `other`.
    fn after_frame_of(&self, other: &ToCamera) -> ToCamera {
        if self == other {
            // Exactly the identity, so that nothing is rounded.
            return ToCamera::IDENTITY;
        }
        let linear = self.linear * other.linear.transpose();
        ToCamera { linear, position: other.linear * (self.position - other.position) }
    }

    /// The map for points that are given relative to `origin`, a point in the coordinates that this
    /// map takes.
    pub(super) fn for_points_from(&self, origin: DVec3) -> ToCamera {
        ToCamera { position: self.position - origin, ..*self }
    }

    /// The test for triangles that surely have an area before and after this map.
    pub(super) fn plain_area(&self) -> PlainArea {
        let DMat3 { x_axis, y_axis, z_axis } = self.linear;
        PlainArea::after_move([x_axis, y_axis, z_axis].map(DVec3::length), self.position.length())
    }

    /// The map from the coordinates of an object with this placement in the world.
    pub fn of_placed(&self, placement: &Placement) -> ToCamera {
        let DAffine3 { matrix3, translation } = placement.to_world();
        let (scale, away) = (placement.scale.to_array(), self.position - translation);
        // The columns of `matrix3` are those of a rotation, each times a scale factor, so that the
        // inverse is the transpose divided by the factors squared.
        let position = DVec3::from([0, 1, 2].map(|i| (matrix3.col(i) / scale[i]).dot(away) / scale[i]));
        ToCamera { linear: self.linear * matrix3, position }
    }
}

/// Why a view has no picture.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ViewError {
    /// `look_at` equals `position`, or their distance overflows.
    #[error("the camera looks at where it stands, which is no direction")]
    Direction,
    /// `up` is zero, or parallel to the direction of view.
    #[error("the camera's up is parallel to its view, or zero")]
    Up,
    /// A coordinate relative to the camera overflows f32. The text names it, such as "sphere 2's
    /// centre", counted from 1 in the scene's order.
    #[error("{0} leaves the range of f32, seen from the camera")]
    Range(String),
}

impl Default for View {
    /// The paper's camera: at the origin, looking along +z.
    fn default() -> Self {
        View { position: DVec3::ZERO, look_at: DVec3::Z, up: DVec3::Y }
    }
}

impl View {
    /// The map from world to camera coordinates.
    ///
    /// # Errors
    /// If the direction of view is undefined, or if `up` is parallel to it.
    pub fn to_camera(self) -> Result<ToCamera, ViewError> {
        let _floats = StandardFloats::set();
        let forward = (self.look_at - self.position).try_normalize().ok_or(ViewError::Direction)?;
        let up = self.up.try_normalize().ok_or(ViewError::Up)?;
        // Within about 1e-6 radians of the direction of view, `up` would leave little precision for
        // the direction to the right.
        let right = Some(up.cross(forward)).filter(|it| it.length() > 1e-6).ok_or(ViewError::Up)?.normalize();
        let rows = DMat3::from_cols(right, forward.cross(right), forward).transpose();
        Ok(ToCamera { linear: rows, position: self.position })
    }

    /// The view after an orbit by `part` of a full turn to the right, about the axis along `up`
    /// through the point in the middle of the picture at this depth.
    ///
    /// # Errors
    /// If this view has no picture.
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
        // Look at a point as far away as the camera has moved: at a distance of 1, the difference
        // of the two points could lose its digits far from 0.
        let look_at = position + turn * DVec3::Z * position.length();
        let to_world = to_camera.linear.transpose();
        let point_in_world = |point: DVec3| to_world * point + self.position;
        Ok(View {
            position: point_in_world(position),
            look_at: point_in_world(look_at),
            up: to_world * (turn * DVec3::Y),
        })
    }

    /// A view in the direction `eye` of the world (from the model to the camera) that shows all
    /// items with a margin, from as near as possible with this `camera`. `ball` gives the centre of
    /// an item and a radius around it; `to_world` maps centres to the world and must preserve
    /// lengths. Seen from straight above or below, what is further away is up.
    pub(super) fn framing<T>(
        items: &[T],
        ball: impl Fn(&T) -> (Vec3, f32),
        to_world: DAffine3,
        camera: &Camera,
        eye: DVec3,
    ) -> View {
        /// This many consecutive items, which are near each other in most files, share a bounding
        /// box.
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
        // Everything must be within the share ROOM of the film. A point with coordinates x, z
        // satisfies |x| f / (z + distance) <= ROOM w; a ball must be a radius away from the plane
        // through the pinhole and the edge of that part of the film.
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
            // Otherwise no item in the box needs a larger distance.
            if needed(furthest.with_z(low.z), 0.0) > distance {
                let balls = items.iter().map(turned);
                distance = balls.map(|(place, radius)| needed(place - middle, radius)).fold(distance, f64::max);
            }
        }
        // A mesh along the direction of view may be a single point in the picture, for which any
        // distance suits: keep the mesh in front of the camera.
        let depth = (high.z - low.z) / 2.0;
        let distance = distance.max(1.01 * depth);
        let distance = if distance > 0.0 { distance } else { 1.0 };
        let centre = turn.transpose() * middle;
        View { position: centre + eye * distance, look_at: centre, up: around.up }
    }
}

impl Scene {
    /// The scene seen by a camera elsewhere in the same world. Every point is transformed in f64
    /// from the coordinates of this scene's own [`view`](Scene::view) to those of the new one and
    /// rounded once. With the scene's own view nothing changes. For a scene that a program made
    /// with the default view, the scene's coordinates are those of the world.
    ///
    /// A camera that moves through the world:
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
    /// For many views, [`MovingCamera`] does the same faster.
    ///
    /// # Errors
    /// If either view has no picture, or if a coordinate overflows f32.
    pub fn seen_from(&self, view: View) -> Result<Scene, ViewError> {
        let mut camera = MovingCamera::of(self);
        camera.seen_from(view)?;
        Ok(camera.seen)
    }
}

/// A scene seen by a camera that moves. Each view gives the same as [`Scene::seen_from`], but
/// overwrites the one before instead of allocating memory.
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
/// `examples/moving_camera.rs` moves around a mesh of a million triangles and measures the time of
/// each frame.
pub struct MovingCamera<'a> {
    world: &'a Scene,
    seen: Scene,
    /// The numbers of the world's triangles and faces that have no area.
    flat: (Vec<usize>, Vec<usize>),
    /// The largest absolute coordinate, or infinity if one is NaN.
    furthest: f32,
    /// The index of the light that moves with the camera.
    carried_light: Option<usize>,
}

impl<'a> MovingCamera<'a> {
    /// Copies the world, which takes longer than transforming it to a view.
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

    /// Makes a light of the world move with the camera, so that it keeps its position relative to
    /// the camera. `carried_light` is its index, which [`Opened::carried_light`] gives for files.
    ///
    /// [`Opened::carried_light`]: crate::Opened::carried_light
    pub fn carrying_light(self, carried_light: Option<usize>) -> Self {
        MovingCamera { carried_light, ..self }
    }

    /// Sets the camera for the views from the next one on: another image size or film.
    pub fn set_camera(&mut self, camera: Camera) {
        self.seen.camera = camera;
    }

    /// Sets whether objects cast shadows in the views from the next one on.
    pub fn set_shadows(&mut self, shadows: bool) {
        self.seen.shadows = shadows;
    }

    /// As [`Scene::seen_from`], with the camera and shadows that were set here.
    ///
    /// # Errors
    /// As [`Scene::seen_from`]. After an error the last view is no longer available.
    pub fn seen_from(&mut self, view: View) -> Result<&Scene, ViewError> {
        let _floats = StandardFloats::set();
        let to_camera = view.to_camera()?.after_frame_of(&self.world.view.to_camera()?);
        // Keep the points as they are: transforming them by the identity would lose the signs of
        // zeros.
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
        // A rotation makes a coordinate at most sqrt(3) times as large.
        let reach = 2.0 * (f64::from(self.furthest) + to_camera.position.abs().max_element());
        if reach >= f32::MAX.into() {
            // The world's own numbers are valid, so that an invalid one has overflowed.
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
    /// [`middle_depth`](Self::middle_depth). That depth is computed from all objects, so that a
    /// camera that moves often should compute it once.
    ///
    /// # Errors
    /// If the scene's own view has no picture.
    pub fn orbit(&self, part: f64) -> Result<View, ViewError> {
        self.view.orbit(self.middle_depth(), part)
    }

    /// The depth halfway between the nearest and the furthest centre or corner of all objects; 0 if
    /// there is no object.
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
