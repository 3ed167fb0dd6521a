//! The closed form of one sphere under one light, the paper's own scene: its light, and the
//! constants of its rows.

use glam::DVec3;

use super::frustum::Frustum;
use super::light::{is_dark, lights, reaches};
use super::omission::{Keep, Omission};
use super::unit_rays;
use crate::kernels::{Element, LitSetup, LitSphere};
use crate::reference::geometry;
use crate::scene::{Camera, Grid, Light, Scene, Sphere};

/// The largest factor by which the closed form may amplify the errors of its operations; see
/// SPHERE_LIT. Estimated roots, which have an error of 1.5 2^-12, then cost at most three quarters
/// of a level.
const LOSS: f64 = 32.0;

/// The element types count columns exactly up to this number.
const WIDTH: u32 = 1 << 24;

/// The largest number of columns of half a silhouette. One column inside of the silhouette's end,
/// where the discriminant p is 0, p is then far above its rounding error.
const COLUMNS: f64 = 1048576.0;

/// The bound of k = |c|^2 - 1, in radii, below which a sphere is less than sqrt 2 radii away.
const NEAR: f64 = 1.0;

/// The closed form multiplies three lengths and the square of the weight. If each of these is below
/// this bound, f32 can hold the product.
const CUBED: f64 = (1u64 << 36) as f64;

/// The value of white in the output.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// 1, for floats.
    Linear,
    /// 255, for bytes.
    Levels,
}

impl Scale {
    /// Every scale.
    const ALL: [Scale; 2] = [Scale::Linear, Scale::Levels];

    fn white(self) -> f64 {
        match self {
            Scale::Linear => 1.0,
            Scale::Levels => 255.0,
        }
    }
}

/// A sphere and a light relative to the camera, in radii of the sphere.
struct LitView {
    /// The centre c; `far` is its distance.
    c: DVec3,
    far: f64,
    /// |c|^2 - 1.
    k: f64,
    /// The vector from the centre to the light; `distance` is its length.
    towards: DVec3,
    distance: f64,
    /// The coefficients of the cosine's numerator and of the distance from the light; see
    /// SPHERE_LIT.
    kn: f64,
    ke: f64,
    /// k w + kn c, where w is `towards`. It is smaller than its two terms by a factor of |c|.
    v: DVec3,
    /// c.y^2 + c.z^2 - 1.
    m: f64,
    /// The ratio of sqrt D to sqrt p.
    pixel: f64,
}

impl LitView {
    fn new(sphere: &Sphere, light: &Light, grid: &Grid<f64>) -> Self {
        let (centre, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
        let c = centre / radius;
        let towards = (light.position.as_dvec3() - centre) / radius;
        let distance = towards.length();
        let m = c.y * c.y + c.z * c.z - 1.0;
        LitView {
            c,
            far: c.length(),
            k: geometry::power(centre, radius) / (radius * radius),
            towards,
            distance,
            kn: -1.0 - c.dot(towards),
            ke: distance * distance - 1.0,
            v: c.cross(towards.cross(c)) - towards - c,
            m,
            pixel: m.sqrt() * grid.step,
        }
    }

    /// Whether the form is accurate enough and its numbers are within the range of `E`, if `gain`
    /// is the weight of the light in each scale.
    fn holds<E: Element>(&self, grid: &Grid<f64>, gain: [f64; Scale::ALL.len()], least: f64) -> bool {
        let LitView { c, far, k, towards, distance, ke, m, pixel, .. } = *self;
        let (gap, terms) = (distance - 1.0, 3.0 * distance + 1.0);
        let loss = f64::max(terms / gap, (ke + 2.0 * terms) / (gap * gap));
        // Half the width of the silhouette is sqrt(k (g - across^2)) / m.
        let [_, y, z] = grid.ray(0, 0);
        let half_width = (k * (y * y + z * z)).sqrt() / m * (1.0 / grid.step);
        let reach = grid.half_width.hypot(grid.half_height).hypot(grid.focal);
        // An upper bound of (ke den - n) den / p, which f32 must be able to hold.
        let largest = 16.0 * gain[1] * (distance * far * reach / pixel).powi(2) / least;
        let in_range = [far, distance, 1.0 / grid.focal, 1.0 / gain[0]].into_iter().all(|x| x < CUBED)
            && E::from_f64(largest).to_f64().is_finite();
        let is_accurate = k >= NEAR && gap > 0.0 && loss < LOSS && m > 0.0;
        is_accurate && in_range && half_width < COLUMNS && reaches(c, towards)
    }

    /// The constants by which the rows are set up.
    fn setup(&self, grid: &Grid<f64>, camera: &Camera, gain: f64) -> LitSetup<f64> {
        let LitView { c, k, v, m, pixel, .. } = *self;
        let [_, _, z] = grid.ray(0, 0);
        LitSetup {
            step: grid.step,
            half_width: grid.half_width,
            half_height: grid.half_height,
            columns: 1.0 / grid.step,
            width: camera.width().into(),
            cx: c.x,
            cy: c.y,
            cz: c.z,
            k,
            m,
            nx: 1.0 - c.x * c.x,
            zz: z * z,
            cyz: c.y * z,
            czz: c.z * z,
            h: 1.0 / pixel,
            q: 2.0 * gain / pixel,
            vx: v.x,
            vy: v.y,
            vzz: v.z * z,
        }
    }

    /// The constants that the rows share.
    fn sphere(&self, grid: &Grid<f64>, gain: f64, least: f64, colour: DVec3) -> LitSphere<f64> {
        let LitView { c, v, kn, ke, pixel, .. } = *self;
        LitSphere {
            h1: c.x * grid.step * (1.0 / pixel),
            least,
            q1: v.x * grid.step * (2.0 * gain / pixel),
            kn: 2.0 * gain * kn,
            ke: gain * ke,
            red: colour.x,
            green: colour.y,
            blue: colour.z,
        }
    }
}

/// The closed form of a sphere under one light, seen from outside, as SPHERE_LIT evaluates it.
#[derive(Clone, Copy, Debug)]
pub struct LitForm {
    /// The constants by which the rows are set up, in each scale.
    setups: [LitSetup<f64>; Scale::ALL.len()],
    /// The constants that the rows share, in each scale.
    spheres: [LitSphere<f64>; Scale::ALL.len()],
    /// Whether the light's red, green and blue are equal.
    is_grey: bool,
    /// Whether a grey sphere is rendered by kernels that compute one channel instead of three,
    /// which exist in f32.
    makes_grey: bool,
}

impl LitForm {
    /// The closed form of a scene of one sphere in the picture under one light, whose numbers are
    /// valid. None for any other scene; and if `keep` rules the form out, its terms would cancel
    /// too much, or it would have to clamp colours.
    pub fn of<E: Element>(scene: &Scene, keep: Keep) -> Option<Self> {
        let ([sphere], [light], 0) = (&scene.spheres[..], &lights(scene)[..], scene.triangle_count()) else {
            return None;
        };
        let grid = unit_rays(scene.camera.grid()).grid;
        let is_seen = Frustum::new(&grid).unseen_sphere(sphere) == Omission::Between;
        if keep.has(Omission::Loop) || !is_seen || scene.camera.width() > WIDTH {
            return None;
        }
        let form = Self::new::<E>(sphere, light, &grid, &scene.camera)?;
        Some(LitForm { makes_grey: size_of::<E>() == 4 && form.is_grey && !keep.has(Omission::Channels), ..form })
    }

    fn new<E: Element>(sphere: &Sphere, light: &Light, grid: &Grid<f64>, camera: &Camera) -> Option<Self> {
        let view = LitView::new(sphere, light, grid);
        let weights = |scale: Scale| light.radiance() * (scale.white() * sphere.colour.as_dvec3());
        let weight = weights(Scale::Linear).max_element();
        let gain = Scale::ALL.map(|scale| 0.25 * weights(scale).max_element().powi(2));
        // The least value of p where a root is estimated, since 0 has no estimate: a share of the
        // silhouette's squared half-width that is below the rounding of p, and at most half a
        // column.
        let least = (E::EPSILON / 32.0 * (grid.focal / view.pixel).powi(2)).min(0.5);
        let is_in_range = weight <= 1.0;
        if !is_in_range || !view.holds::<E>(grid, gain, least) {
            return None;
        }
        let colour = weights(Scale::Linear) / weight;
        Some(LitForm {
            setups: gain.map(|gain| view.setup(grid, camera, gain)),
            spheres: gain.map(|gain| view.sphere(grid, gain, least, colour)),
            is_grey: colour.x == colour.y && colour.y == colour.z,
            makes_grey: false,
        })
    }

    /// The constants by which the rows are set up.
    pub fn setup(&self, scale: Scale) -> &LitSetup<f64> {
        &self.setups[scale as usize]
    }

    /// The constants that the rows share.
    pub fn sphere(&self, scale: Scale) -> &LitSphere<f64> {
        &self.spheres[scale as usize]
    }

    /// Whether red, green and blue are equal and only one of them is computed.
    pub fn makes_grey(&self) -> bool {
        self.makes_grey
    }

    /// How much of the work of an `omission` is saved in `scene`, if `hits` pixels of its picture
    /// show the sphere. `bytes` says whether the output has 8 bits.
    pub(super) fn left_out(&self, omission: Omission, scene: &Scene, hits: u64, bytes: bool) -> u64 {
        let pixels = scene.camera.pixels();
        match omission {
            Omission::DarkLights => scene.lights.iter().filter(|light| is_dark(light)).count() as u64,
            Omission::TriangleCode | Omission::Constants | Omission::Loop => 1,
            Omission::Misses => pixels - hits,
            Omission::Search => hits,
            Omission::Unhidden if scene.shadows => 1,
            Omission::Channels if bytes => self.makes_grey.into(),
            Omission::FloatImage if bytes => pixels,
            _ => 0,
        }
    }
}
