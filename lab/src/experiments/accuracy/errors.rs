//! How far an engine's pixels are from the truth: hits, t, normals, colours and levels.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::exact::number::Split;
use crate::truth::{TrueHit, TruePixel};
use rayo::internals::render::{Colour, Distance, Found, Precision, level};

/// The relative margin around a decision within which an f32 engine may answer either way: 2e-6, in
/// units of f32's roundoff u = 2^-24.
const MARGIN_IN_U: f64 = 2e-6 * 16_777_216.0;

/// The coefficient of the error of t that comes from rounding a camera ray, in units of the ray's
/// roundoff u. It is multiplied by [`TrueHit::lever`].
///
/// A ray's x is step (col + 1/2) - W/2, where W is the width of the film. The product is at most W;
/// it and its factor `step` are rounded, so that the difference, however small, may be off by 2u W,
/// which is 4u times half of the film's width. The ray is thus turned by up to 4u times the length
/// of the longest ray divided by its own length. How much t changes then depends on how obliquely
/// the ray meets the surface.
const CAMERA: f64 = 4.0;

/// The errors of one picture. Rays within the margin are only counted in `*_inside`, and add to no
/// other error. The field names are those of the JSON document; what does not apply is None.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
pub struct Errors {
    /// Pixels.
    pub rays: usize,
    pub hits: usize,
    pub in_margin: usize,
    /// Rays for which the engine found a hit where there is none, or none where there is one, or a
    /// t that is not a finite number above 0.
    pub wrong_hits: usize,
    /// As `wrong_hits`, for rays within the margin, where either answer is right.
    pub wrong_hits_inside: usize,
    /// Rays that hit another object than the nearest.
    pub wrong_objects: usize,
    /// As `wrong_objects`, for rays within the margin.
    pub wrong_objects_inside: usize,
    /// Pixels off by two levels or more where the rounding of the visible point decides whether a
    /// light is hidden.
    #[serde(skip)]
    pub off_by_2_inside: usize,
    /// The largest error of t, in units of the last place of the engine's precision.
    pub max_ulp: Option<f64>,
    pub rms_ulp: Option<f64>,
    pub p999_ulp: Option<f64>,
    /// The largest |error of t| / t, divided by its bound: the documented bound for an exact ray
    /// plus the error of the rounded camera ray.
    pub bound_share: Option<f64>,
    /// The largest angle between the engine's normal and the true one, in radians.
    pub max_angle: Option<f64>,
    pub rms_angle: Option<f64>,
    /// The largest error of a linear colour, relative to the true value where that is above 1.
    pub max_colour: Option<f64>,
    pub rms_colour: Option<f64>,
    /// Pixels with a channel off by one 8-bit level or more.
    pub off_by_1: usize,
    /// Pixels off by one level that the engine's estimated roots do not explain; see
    /// [`Tally::with_estimates`].
    #[serde(skip)]
    pub unexplained: usize,
    pub off_by_2: usize,
    pub max_level: u8,
    /// The peak signal-to-noise ratio of the 8-bit picture, in decibels; None if no level differs.
    pub psnr: Option<f64>,
}

/// Accumulates the largest of some numbers, and the mean of their squares.
#[derive(Clone, Copy, Debug, Default)]
struct Sum {
    largest: f64,
    squares: f64,
    count: usize,
}

impl Sum {
    fn add(&mut self, x: f64) {
        self.largest = self.largest.max(x);
        self.squares += x * x;
        self.count += 1;
    }

    fn largest(&self) -> Option<f64> {
        (self.count > 0).then_some(self.largest)
    }

    fn rms(&self) -> Option<f64> {
        (self.count > 0).then(|| (self.squares / self.count as f64).sqrt())
    }
}

/// Accumulates the errors of one picture by one engine.
#[derive(Clone, Debug)]
pub struct Tally {
    /// The engine's unit roundoff.
    u: f64,
    camera_u: f64,
    /// By how many levels estimated roots may shift a channel.
    estimates: f64,
    errors: Errors,
    ulps: Vec<f64>,
    t: Sum,
    bound_share: f64,
    angles: Sum,
    colours: Sum,
    levels: Sum,
}

/// The margin within which an engine of that precision may answer either way.
pub fn margin_of(precision: Precision) -> f64 {
    MARGIN_IN_U * unit(precision == Precision::Double)
}

/// The unit roundoff of f64 or of f32.
fn unit(double: bool) -> f64 {
    let digits = if double { f64::MANTISSA_DIGITS } else { f32::MANTISSA_DIGITS };
    2f64.powi(-(digits as i32))
}

impl Tally {
    /// An empty tally for an engine that computes in `precision`. If `rays_in_f64`, its rays are
    /// computed in f64 all the same.
    pub fn new(precision: Precision, rays_in_f64: bool) -> Self {
        let double = precision == Precision::Double;
        Tally::of(unit(double), unit(double || rays_in_f64))
    }

    /// An empty tally for results in f64 (`double`) or f32 along rays that are exact.
    pub fn of_exact_rays(double: bool) -> Self {
        Tally::of(unit(double), 0.0)
    }

    fn of(u: f64, camera_u: f64) -> Self {
        Tally {
            u,
            camera_u,
            estimates: 0.0,
            errors: Errors::default(),
            ulps: Vec::new(),
            t: Sum::default(),
            bound_share: 0.0,
            angles: Sum::default(),
            colours: Sum::default(),
            levels: Sum::default(),
        }
    }

    /// Sets by how many `levels` estimated roots may shift a channel. A level that is off by one
    /// then counts as explained if the true value is within that distance of it.
    pub fn with_estimates(self, levels: f64) -> Self {
        Tally { estimates: levels, ..self }
    }

    /// Adds a pixel: the truth, what the engine found, and the colour that it wrote.
    pub fn add(&mut self, TruePixel { hit, margin }: &TruePixel, found: Option<&Found>, written: Colour) {
        let errors = &mut self.errors;
        errors.rays += 1;
        errors.hits += usize::from(hit.is_some());
        let t = found.map(|found| found.distance.t());
        let found = found.filter(|_| t.is_some_and(|t| t.is_finite() && t > 0.0));
        // A t that is not a finite number above 0 is a wrong hit, even within the margin.
        let wrong_hit = found.is_some() != hit.is_some() || t.is_some() && found.is_none();
        let wrong_object = !wrong_hit && hit.as_ref().zip(found).is_some_and(|(hit, found)| hit.object != found.object);
        if *margin < MARGIN_IN_U * self.u {
            errors.in_margin += 1;
            errors.wrong_hits_inside += usize::from(wrong_hit);
            errors.wrong_objects_inside += usize::from(wrong_object);
            return;
        }
        errors.wrong_hits += usize::from(wrong_hit);
        errors.wrong_objects += usize::from(wrong_object);
        if let (Some(hit), Some(found), false) = (hit, found, wrong_hit || wrong_object) {
            self.add_hit(hit, found);
        }
        // Any colour is right at the terminator of a very bright light, where rounding in f32
        // decides between black and white.
        let colour = hit.as_ref().map_or(Some(DVec3::ZERO), |hit| hit.colour.filter(|_| !hit.dazzled));
        let Some(colour) = colour else { return };
        // Visible points, which shadows start from, are as inaccurate as the rays.
        if hit.as_ref().is_some_and(|hit| hit.shadow < MARGIN_IN_U * self.camera_u) {
            self.errors.in_margin += 1;
            let differ = |(v, truth): (u8, f64)| v.abs_diff(level(truth)) >= 2;
            let is_off = written.levels().into_iter().zip(colour.to_array()).any(differ);
            self.errors.off_by_2_inside += usize::from(is_off);
            return;
        }
        self.add_colour(colour, written);
    }

    fn add_hit(&mut self, hit: &TrueHit, found: &Found) {
        let relative = match found.distance {
            Distance::T(t) => hit.t.error_of(t) / hit.t.high,
            // w t - 1, rounded once: the relative difference of the true t and 1/w.
            Distance::Inverse(w) => w.mul_add(hit.t.high, -1.0) + w * hit.t.low,
        };
        let relative = relative.abs();
        // A unit of the last place is 2u times the largest power of two that is not above t.
        let power = 2f64.powi(hit.t.high.log2().floor() as i32);
        let ulps = relative * (hit.t.high / power) / (2.0 * self.u);
        self.ulps.push(ulps);
        self.t.add(ulps);
        self.bound_share = self.bound_share.max(relative / (hit.bound * self.u + CAMERA * hit.lever * self.camera_u));
        if let Some(normal) = found.normal {
            self.angles.add(angle(hit.normal, normal));
        }
    }

    fn add_colour(&mut self, colour: DVec3, written: Colour) {
        if let Colour::Linear(linear) = written {
            for (v, truth) in linear.into_iter().zip(colour.to_array()) {
                let error = (f64::from(v) - truth).abs() / truth.max(1.0);
                // A colour that is not a number counts as infinitely wrong.
                self.colours.add(if error.is_nan() { f64::INFINITY } else { error });
            }
        }
        let (mut most, mut explained) = (0, true);
        for (v, truth) in written.levels().into_iter().zip(colour.to_array()) {
            let off = v.abs_diff(level(truth));
            self.levels.add(off.into());
            most = most.max(off);
            // Level v stands for all values from v to v + 1.
            let (value, written) = (255.0 * truth.clamp(0.0, 1.0), f64::from(v));
            explained &= off == 0 || (written - value).max(value - (written + 1.0)) < self.estimates;
        }
        self.errors.off_by_1 += usize::from(most >= 1);
        self.errors.unexplained += usize::from(!explained);
        self.errors.off_by_2 += usize::from(most >= 2);
        self.errors.max_level = self.errors.max_level.max(most);
    }

    /// The accumulated errors.
    pub fn errors(mut self) -> Errors {
        self.ulps.sort_unstable_by(f64::total_cmp);
        let rank = (0.999 * self.ulps.len() as f64).ceil() as usize;
        let levels = self.levels.rms().filter(|rms| *rms > 0.0);
        Errors {
            max_ulp: self.t.largest(),
            rms_ulp: self.t.rms(),
            p999_ulp: rank.checked_sub(1).map(|last| self.ulps[last]),
            bound_share: (self.t.count > 0).then_some(self.bound_share),
            max_angle: self.angles.largest(),
            rms_angle: self.angles.rms(),
            max_colour: self.colours.largest(),
            rms_colour: self.colours.rms(),
            psnr: levels.map(|rms| 20.0 * (255.0 / rms).log10()),
            ..self.errors
        }
    }
}

/// The angle between a normal and the true normal or its opposite, whichever is nearer. Small
/// angles are accurate, since it is computed from the difference of the two vectors.
fn angle(truth: [Split; 3], normal: DVec3) -> f64 {
    let high = DVec3::from(truth.map(|component| component.high));
    let side = if high.dot(normal) < 0.0 { -normal } else { normal };
    let difference = DVec3::from([0, 1, 2].map(|i| truth[i].error_of(side[i])));
    high.cross(difference).length().atan2(high.dot(side))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayo::internals::scene::Object;

    const FAR: f64 = 1.0;

    fn exact(x: f64) -> Split {
        Split { high: x, low: 0.0 }
    }

    fn target(t: f64) -> TrueHit {
        let normal = [0.0, 0.0, -1.0].map(exact);
        TrueHit {
            object: Object::Sphere(3),
            t: exact(t),
            normal,
            cosines: Vec::new(),
            dazzled: false,
            colour: Some(DVec3::splat(0.5)),
            bound: 5.0,
            lever: 1.0,
            shadow: FAR,
        }
    }

    fn found(t: f64) -> Found {
        Found { object: Object::Sphere(3), distance: Distance::T(t), normal: Some(DVec3::NEG_Z) }
    }

    const RIGHT: Colour = Colour::Linear([0.5; 3]);
    const BLACK: Colour = Colour::Linear([0.0; 3]);

    fn one(margin: f64, hit: Option<TrueHit>, found: Option<Found>, written: Colour) -> Errors {
        let mut tally = Tally::new(Precision::Single, true);
        tally.add(&TruePixel { hit, margin }, found.as_ref(), written);
        tally.errors()
    }

    #[test]
    fn a_right_pixel_has_no_error() {
        let right = one(FAR, Some(target(3.0)), Some(found(3.0)), RIGHT);
        let zero = Some(0.0);
        assert_eq!((right.rays, right.hits, right.wrong_hits, right.wrong_objects), (1, 1, 0, 0));
        assert_eq!((right.max_ulp, right.rms_ulp, right.p999_ulp, right.bound_share), (zero, zero, zero, zero));
        assert_eq!((right.max_angle, right.max_colour, right.off_by_1, right.psnr), (zero, zero, 0, None));
        let nothing = one(FAR, None, None, BLACK);
        assert_eq!((nothing.hits, nothing.max_ulp, nothing.max_angle, nothing.max_colour), (0, None, None, zero));
    }

    #[test]
    fn hits_and_objects_are_wrong_outside_or_inside_of_the_margin() {
        let other = Found { object: Object::Triangle(3), ..found(3.0) };
        for (hit, found, hits, objects) in [
            (Some(target(3.0)), None, 1, 0),
            (None, Some(found(3.0)), 1, 0),
            (Some(target(3.0)), Some(found(f64::NAN)), 1, 0),
            (Some(target(3.0)), Some(found(-3.0)), 1, 0),
            (None, Some(found(f64::INFINITY)), 1, 0),
            (Some(target(3.0)), Some(other), 0, 1),
            (None, None, 0, 0),
        ] {
            let outside = one(2.1e-6, hit.clone(), found, BLACK);
            assert_eq!((outside.wrong_hits, outside.wrong_objects), (hits, objects), "{found:?}");
            assert_eq!((outside.wrong_hits_inside, outside.wrong_objects_inside), (0, 0), "{found:?}");
            let inside = one(1.9e-6, hit, found, BLACK);
            assert_eq!((inside.wrong_hits_inside, inside.wrong_objects_inside), (hits, objects), "{found:?}");
            assert_eq!((inside.wrong_hits, inside.wrong_objects, inside.off_by_1), (0, 0, 0), "{found:?}");
        }
    }

    #[test]
    fn the_margin_of_f64_is_as_many_of_its_own_units() {
        let mut tally = Tally::new(Precision::Double, true);
        tally.add(&TruePixel { hit: None, margin: 1e-14 }, Some(&found(3.0)), BLACK);
        assert_eq!(tally.errors().wrong_hits, 1);
    }

    #[test]
    fn error_of_t_is_counted_in_ulp_and_in_bounds() {
        let ulp = f64::from(f32::EPSILON);
        // From 2 to 4 a unit is 2 epsilon, and u is half of epsilon; a tenth of a unit counts as
        // such.
        for (t, error, ulps) in
            [(3.0, 2.0 * ulp, 1.0), (3.0, -4.0 * ulp, 2.0), (1.0, 0.1 * ulp, 0.1), (8.0, ulp, 0.125)]
        {
            let found = one(FAR, Some(target(t)), Some(found(t + error)), RIGHT);
            assert!((found.max_ulp.unwrap() - ulps).abs() < 1e-6, "{t} {error}: {found:?}");
            let share = error.abs() / t / (5.0 * 0.5 * ulp);
            assert!((found.bound_share.unwrap() - share).abs() < 1e-6 * share, "{t} {error}: {found:?}");
            let inverse = Found { distance: Distance::Inverse(1.0 / (t + error)), ..super::tests::found(t) };
            let by_inverse = one(FAR, Some(target(t)), Some(inverse), RIGHT);
            assert!((by_inverse.max_ulp.unwrap() - ulps).abs() < 1e-5, "{t} {error}: {by_inverse:?}");
        }
    }

    #[test]
    fn the_rounding_of_a_camera_in_f32_is_a_part_of_the_bound() {
        let error = 9.0 * f64::from(f32::EPSILON) / 2.0;
        for (rays_in_f64, share) in [(true, 9.0 / 5.0), (false, 1.0)] {
            let mut tally = Tally::new(Precision::Single, rays_in_f64);
            tally.add(&TruePixel { hit: Some(target(1.0)), margin: FAR }, Some(&found(1.0 + error)), RIGHT);
            assert!((tally.errors().bound_share.unwrap() - share).abs() < 1e-6);
        }
    }

    #[test]
    fn mean_and_share_of_errors_are_as_by_hand() {
        let mut tally = Tally::new(Precision::Single, true);
        for i in 0..1000 {
            // 998 errors are 1 unit, one is 2 and one is 30.
            let ulps = if i == 10 { 30.0 } else { 1.0 + f64::from(i == 20) };
            let found = found(1.0 + ulps * f64::from(f32::EPSILON));
            tally.add(&TruePixel { hit: Some(target(1.0)), margin: FAR }, Some(&found), RIGHT);
        }
        let Errors { max_ulp, rms_ulp, p999_ulp, .. } = tally.errors();
        let near = |a: Option<f64>, b: f64| (a.unwrap() - b).abs() < 1e-6;
        assert!(near(max_ulp, 30.0) && near(p999_ulp, 2.0));
        assert!(near(rms_ulp, ((998.0 + 4.0 + 900.0) / 1000.0_f64).sqrt()));
    }

    #[test]
    fn angle_is_measured_to_the_last_digits() {
        for angle in [0.0, 1e-20, 1e-16, 1e-9, 1e-3, 1.0] {
            let normal = DVec3::new(f64::sin(angle), 0.0, -f64::cos(angle));
            for normal in [normal, -normal] {
                let found = one(FAR, Some(target(3.0)), Some(Found { normal: Some(normal), ..found(3.0) }), RIGHT);
                assert!((found.max_angle.unwrap() - angle).abs() <= 1e-12 * angle, "{angle}: {found:?}");
            }
        }
        let none = one(FAR, Some(target(3.0)), Some(Found { normal: None, ..found(3.0) }), RIGHT);
        assert_eq!(none.max_angle, None);
    }

    #[test]
    fn colours_and_levels_are_compared_channel_by_channel() {
        let errors = one(FAR, Some(target(3.0)), Some(found(3.0)), Colour::Linear([0.5, 0.5 + 0.25, 0.5]));
        assert_eq!((errors.max_colour, errors.off_by_1, errors.off_by_2, errors.max_level), (Some(0.25), 1, 1, 64));
        assert!((errors.rms_colour.unwrap() - 0.25 / 3f64.sqrt()).abs() < 1e-15);
        let rms = 64.0 / 3f64.sqrt();
        assert!((errors.psnr.unwrap() - 20.0 * (255.0 / rms).log10()).abs() < 1e-12);
        // 0.5 is level 127.
        let levels = one(FAR, Some(target(3.0)), Some(found(3.0)), Colour::Levels([126, 127, 127]));
        assert_eq!((levels.max_colour, levels.off_by_1, levels.off_by_2), (None, 1, 0));
        // A colour of 0.5 is 127.5 levels, and so level 127, half a level below 128: writing 128 is
        // explained only by estimates that may be off by more than that.
        for (written, estimates, unexplained) in
            [(127, 0.0, 0), (128, 0.0, 1), (128, 0.4, 1), (128, 0.6, 0), (126, 0.4, 1), (126, 0.6, 0), (125, 0.6, 1)]
        {
            let mut tally = Tally::new(Precision::Single, true).with_estimates(estimates);
            let expected = TruePixel { hit: Some(target(3.0)), margin: FAR };
            tally.add(&expected, Some(&found(3.0)), Colour::Levels([127, written, 127]));
            assert_eq!(tally.errors().unexplained, unexplained, "{written} {estimates}");
        }
        // Errors of bright light are relative.
        let bright = TrueHit { colour: Some(DVec3::splat(200.0)), ..target(3.0) };
        let errors = one(FAR, Some(bright), Some(found(3.0)), Colour::Linear([202.0, 200.0, 200.0]));
        assert_eq!((errors.max_colour, errors.off_by_1), (Some(0.01), 0));
        // A light on the surface makes any colour right, and a NaN is never right.
        let free = TrueHit { colour: None, ..target(3.0) };
        assert_eq!(one(FAR, Some(free), Some(found(3.0)), BLACK).off_by_1, 0);
        let nan = one(FAR, Some(target(3.0)), Some(found(3.0)), Colour::Linear([f32::NAN; 3]));
        assert_eq!((nan.max_colour, nan.off_by_2), (Some(f64::INFINITY), 1));
    }
}
