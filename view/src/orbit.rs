//! A camera that turns around a point: angles and a distance, and the view that follows.

use rayo::glam::{DQuat, DVec2, DVec3};
use rayo::{Scene, View};

/// The largest angle above or below the horizon: a camera that looked along its up would have no
/// direction to the right.
const STEEPEST: f64 = 0.49 * std::f64::consts::PI;

/// The least distance of the camera from the centre, as a share of the centre's distance from the
/// origin: far above the rounding of f64, so that the two points stay apart.
const LEAST_SHARE_OF_CENTRE: f64 = 1e-9;

/// The view that a camera began with, and the axes that its angles are measured from.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Start {
    view: View,
    /// The world's up.
    up: DVec3,
    /// The horizontal direction towards the camera.
    back: DVec3,
}

/// The position of a camera, relative to the point that it turns around.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    /// The point in the middle of the picture.
    centre: DVec3,
    /// The distance of the camera from it.
    distance: f64,
    /// The angle about the world's up, to the right, in radians.
    yaw: f64,
    /// The angle above the horizon.
    pitch: f64,
}

/// A camera that turns around a point, and comes back to where it began.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    start: Start,
    first: Place,
    place: Place,
}

impl Orbit {
    /// The camera of a scene, turning around the point on its axis of view that is as deep as the
    /// middle of all objects. None if the scene's view has no direction.
    pub fn around(scene: &Scene) -> Option<Orbit> {
        let view = scene.view;
        let forward = (view.look_at - view.position).try_normalize()?;
        let up = view.up.try_normalize()?;
        let back = (-forward).reject_from_normalized(up).try_normalize()?;
        let depth = scene.middle_depth();
        // Where the objects are behind the camera, it turns around the point that it looks at.
        let distance = if depth > 0.0 { depth } else { view.look_at.distance(view.position) };
        let pitch = (-forward.dot(up)).clamp(-1.0, 1.0).asin();
        let place = Place { centre: view.position + forward * distance, distance, yaw: 0.0, pitch };
        Some(Orbit { start: Start { view, up, back }, first: place, place })
    }

    /// The view from here, which is the scene's own to the last bit while the camera is where it
    /// began.
    pub fn view(&self) -> View {
        if self.is_at_start() {
            return self.start.view;
        }
        let Place { centre, distance, .. } = self.place;
        View { position: centre + distance * self.towards_camera(), look_at: centre, up: self.start.up }
    }

    /// Whether the camera is where it began.
    pub fn is_at_start(&self) -> bool {
        self.place == self.first
    }

    /// Brings the camera back to where it began.
    pub fn go_home(&mut self) {
        self.place = self.first;
    }

    /// Turns the camera around the centre, by radians to the right and upwards.
    pub fn turn(&mut self, right: f64, up: f64) {
        // The scene's own view may be steeper than `STEEPEST`, and turns from there.
        let steepest = STEEPEST.max(self.place.pitch.abs());
        self.place.yaw += right;
        self.place.pitch = (self.place.pitch + up).clamp(-steepest, steepest);
    }

    /// Makes the distance from the centre `factor` times as long, unless that would be too small to
    /// tell the two points apart, or too large for f32.
    pub fn zoom(&mut self, factor: f64) {
        let distance = self.place.distance * factor;
        let least = f64::from(f32::MIN_POSITIVE).max(LEAST_SHARE_OF_CENTRE * self.place.centre.length());
        if (least..f32::MAX.into()).contains(&distance) {
            self.place.distance = distance;
        }
    }

    /// Moves the camera and the centre to the right and upwards in the picture, by these shares of
    /// the distance between them.
    pub fn shift(&mut self, shares: DVec2) {
        let towards_camera = self.towards_camera();
        let right = self.start.up.cross(-towards_camera).normalize_or_zero();
        let up = (-towards_camera).cross(right);
        self.place.centre += self.place.distance * (shares.x * right + shares.y * up);
    }

    /// The direction from the centre to the camera.
    fn towards_camera(&self) -> DVec3 {
        let Start { up, back, .. } = self.start;
        let Place { yaw, pitch, .. } = self.place;
        let (sine, cosine) = pitch.sin_cos();
        cosine * (DQuat::from_axis_angle(up, -yaw) * back) + sine * up
    }
}

#[cfg(test)]
mod tests {
    use rayo::glam::Vec3;
    use rayo::{Camera, Sphere};

    use super::*;

    /// A ball at a depth of 10, which the paper's camera sees.
    fn orbit() -> Orbit {
        let ball = Sphere { radius: 1.0, colour: Vec3::ONE, centre: Vec3::new(0.0, 0.0, 10.0) };
        Orbit::around(&Scene { spheres: vec![ball], ..Scene::new(Camera::default()) }).unwrap()
    }

    #[test]
    fn a_camera_at_rest_has_the_view_of_its_scene() {
        let mut orbit = orbit();
        assert_eq!(orbit.view(), View::default());
        orbit.turn(1.0, 0.5);
        orbit.shift(DVec2::new(0.1, 0.2));
        orbit.zoom(0.5);
        assert!(!orbit.is_at_start());
        orbit.go_home();
        assert_eq!(orbit.view(), View::default());
    }

    #[test]
    fn turn_keeps_the_distance_and_zoom_the_direction() {
        let mut orbit = orbit();
        orbit.turn(std::f64::consts::FRAC_PI_2, 0.0);
        // A quarter of a turn to the right of what is in front.
        assert!(orbit.view().position.distance(DVec3::new(10.0, 0.0, 10.0)) < 1e-12, "{:?}", orbit.view());
        orbit.turn(0.3, 0.4);
        let View { position, look_at, .. } = orbit.view();
        assert!((position.distance(look_at) - 10.0).abs() < 1e-12 && position.y > 0.0);
        assert!(look_at.distance(DVec3::new(0.0, 0.0, 10.0)) < 1e-12);
        orbit.zoom(0.5);
        assert!(orbit.view().position.distance(position.midpoint(look_at)) < 1e-12);
    }

    #[test]
    fn no_turn_and_no_zoom_leaves_a_view_without_a_direction() {
        let mut orbit = orbit();
        for step in 0..4000 {
            orbit.turn(0.1, if step < 2000 { 0.1 } else { -0.1 });
            orbit.zoom(if step < 2000 { 1.5 } else { 0.5 });
            assert!(orbit.view().to_camera().is_ok(), "{step}: {:?}", orbit.view());
        }
    }

    #[test]
    fn a_shift_to_the_right_and_up_moves_both_ends_alike() {
        let mut orbit = orbit();
        orbit.shift(DVec2::new(0.1, 0.2));
        let View { position, look_at, .. } = orbit.view();
        assert!(position.distance(DVec3::new(1.0, 2.0, 0.0)) < 1e-12, "{position}");
        assert!(look_at.distance(DVec3::new(1.0, 2.0, 10.0)) < 1e-12, "{look_at}");
    }
}
