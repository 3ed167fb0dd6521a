//! The number format in which the tile kernels can trace an object: f32, or f64.
//!
//! Kernels compare w = 1/t in units of the scene's `scale`. Results in f32 are as accurate as
//! documented under these conditions:
//!
//! - **its planes keep their digits.** A sphere's D is summed from terms about the middle of its
//!   outline, an ellipse with the half-axes a = f sqrt k / m, away from the picture's axis, and
//!   b = f / sqrt m, where k = c . c - 1 and m = cz^2 - 1 in radii. In its middle D is k / m of
//!   f^2. Columns and rows are not the ellipse's axes: if a is at the angle p to the columns, the
//!   term of x^2 at the end of its bounds is D (cos^2 p / a^2 + sin^2 p / b^2) (a^2 cos^2 p + b^2
//!   sin^2 p), which is at most D (1 + (sin p cos p)^2 k / m), and the others are no larger.
//!   Divided by d . d that is k / m (1 + (sin p cos p)^2 k / m) times the squared cosine of the
//!   angle between the picture's axis and the sphere's ray nearest to it: at most [`OUTLINE`].
//!   Beyond it f64 would lose digits too, and the sphere is found pixel by pixel, like one around
//!   the camera: see [`is_quadratic`].
//! - **squares are finite.** The largest is that of w l, at the nearest point and for the farthest
//!   light: w l stays below [`MOST`]. A triangle's w over a whole tile, and a sphere's D, stay
//!   below [`MOST_OVER_A_TILE`].
//! - **nothing is subnormal.** A sphere's D is bounded by 2^-21 of terms that are squares of a
//!   pixel's step times scale over k radii: that product is at least [`LEAST`].
//! - **lights keep their directions.** Those moved nearer, to [`FAR`], are still 2^26 times as far
//!   away as the object: w is at least [`LEAST_INVERSE`].
//! - **its w keeps its digits over a tile.** That of a triangle is summed from the tile's middle,
//!   w = t0 + tx x + ty y, with an error below u (3 w + 4 |tx x| + 5 |ty y|): at most [`STEEPEST`]
//!   u w at every pixel where it may be. A tile where that fails is traced in f64, others may be in
//!   f32. If triangles are many, only those whose bounds have a side of [`LONG`] pixels are tested;
//!   for shorter ones the error is that of a ray a hundred-thousandth of a pixel away.
//! - **the light of all lights together is a number**, in levels too.
//! - **lights near it keep their directions.** See [`LightLoss`].

use std::ops::Range;

use glam::DVec3;

use super::bins::WideTiles;
use super::place::{Picture, TilePlace, range, tile_range};
use crate::kernels::{Candidate, Extremes, TILE_HEIGHT, TILE_WIDTH};
use crate::plan::light;
use crate::reference::geometry;
use crate::scene::{Grid, Light, Sphere, Triangle};

const OUTLINE: f64 = 4.0;
/// The largest error of w in units of u w; see the fifth condition above, and
/// `proofs/inverse-apart.g`.
pub const STEEPEST: f64 = 16.0;
/// How many u of its magnitude w itself, and its greatest changes across and down a tile,
/// contribute to the error of w.
pub const INVERSE_ROUNDINGS: [f64; 3] = [3.0, 4.0, 5.0];
pub(super) const LONG: usize = 32;
const MOST: f64 = (1u64 << 60) as f64;
const MOST_OVER_A_TILE: f64 = (1u128 << 100) as f64;
const LEAST: f64 = 1.0 / (1u64 << 48) as f64;
const LEAST_INVERSE: f64 = 1.0 / (1u64 << 14) as f64;

/// The least radius, in units of the scene's extent, of spheres that are certainly narrow: scale /
/// (k radius) is then at most [`MOST`], for any usual focal distance.
const LEAST_RADIUS: f64 = 1.0 / (1u64 << 38) as f64;

/// A sphere whose centre is nearer to the camera's plane than this many radii contains the camera
/// or reaches behind the plane, or nearly so. The kernels have this constant as PACKET(front).
const FRONT: f64 = 1.001;

/// Up to this distance in radii, f32 can compute the normal of a sphere beside the camera from its
/// point relative to the camera.
const FARTHEST_AROUND: f64 = 64.0;

/// If a light is nearer to a point than this share of the point's distance from the camera, f32
/// cannot represent its direction, and any colour is right there.
const AT_THE_SURFACE: f64 = 1e-4;

/// If a light is this many times as bright as white, both black at its terminator and white beside
/// it are right.
const DAZZLING: f64 = 1.0 / AT_THE_SURFACE;

/// The greatest [`LightLoss`] in f32: 255 levels times 4 u times this is less than one level.
const MOST_LOSS: f64 = (1u64 << 14) as f64;

/// For light that is at most this bright, f32 loses no more than [`MOST_LOSS`] in coordinates
/// relative to the camera, wherever the light is.
const NEVER_LOST: f64 = MOST_LOSS * AT_THE_SURFACE;

/// The squared distance in radii beyond which a sphere loses less in coordinates relative to its
/// centre than in coordinates relative to the camera.
const FARTHEST_FROM_CAMERA: f64 = 5.0;

/// The greatest distance of lights whose square f32 can hold: in units of the scene's extent, and
/// in radii of a sphere.
pub(super) const FAR: f64 = (1u64 << 40) as f64;
pub(super) const FAR_IN_RADII: f64 = (1u64 << 36) as f64;

/// Whether the discriminant D of a sphere may be a quadratic over the pixels: the whole sphere is
/// in front of the camera, by [`FRONT`], and the quadratic keeps its digits, by [`OUTLINE`]. Other
/// spheres contain the camera or are beside it, and have a kernel of their own.
pub(super) fn is_quadratic(sphere: &Sphere) -> bool {
    let c = sphere.centre.as_dvec3() / f64::from(sphere.radius);
    c.z >= FRONT && c.dot(c) < f64::INFINITY && keeps_digits(c)
}

/// Whether the discriminant D of a sphere in front of the camera, with the centre `c` in radii,
/// keeps its digits.
fn keeps_digits(c: DVec3) -> bool {
    let power = c.dot(c);
    let (k, m) = (power - 1.0, c.z * c.z - 1.0);
    if k <= 2.0 * m {
        // This holds for nearly every sphere: the left side below is then at most 2 m (m + 2 m /
        // 4).
        return true;
    }
    let beside = c.x.hypot(c.y);
    // The cosine of the angle between the picture's axis and the sphere's ray nearest to it.
    let inmost = if beside * k.sqrt() <= c.z { 1.0 } else { (c.z * k.sqrt() + beside) / power };
    // (sin p cos p)^2. It has no effect on the axis, where the outline is a circle.
    let slant = if beside > 0.0 { (c.x / beside * (c.y / beside)).powi(2) } else { 0.0 };
    k * inmost * inmost * (m + slant * k) <= OUTLINE * m * m
}

/// How much light on a sphere is lost to rounding where a light is near its surface, in units of 4
/// u of white.
///
/// A cosine is N . (l - P) / |l - P|. In f32, l and P each have an error of up to twice u times
/// their distance from the origin of their coordinates, and so the cosine has an error of 4 u times
/// that distance over |l - P|. At a visible point |l - P| is at least h, the light's distance from
/// the surface, and at least [`AT_THE_SURFACE`] times |P| where a colour is promised; |P| is about
/// |l| there. Light that is w times as bright as white loses w times as much; light that is
/// [`DAZZLING`] is either white or not promised.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LightLoss {
    /// The loss in coordinates relative to the sphere's centre, where l and P are a radius away.
    /// Spheres in front of the camera are shaded in these.
    from_centre: f64,
    /// The loss in coordinates relative to the camera. Spheres that contain the camera are shaded
    /// in these.
    from_camera: f64,
}

impl LightLoss {
    /// The loss on a sphere from lights with these positions and radiances.
    pub(super) fn of(sphere: &Sphere, lights: impl Iterator<Item = (DVec3, DVec3)>) -> Self {
        let (centre, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
        let mut loss = LightLoss::default();
        for (position, radiance) in lights {
            let distance = position.length();
            // The square of the distance from the centre minus that of the radius, computed so that
            // it is accurate near the surface.
            let power = if distance < radius {
                position.dot(position - 2.0 * centre) + geometry::power(centre, radius)
            } else {
                geometry::power(position - centre, radius)
            };
            let height = power.abs() / ((position - centre).length() + radius);
            let nearest = height.max(AT_THE_SURFACE * distance).max(f64::MIN_POSITIVE);
            let weights = (radiance * sphere.colour.as_dvec3()).to_array();
            let weight = weights.into_iter().filter(|weight| *weight <= DAZZLING).fold(0.0, f64::max);
            loss.from_centre += weight * radius / nearest;
            loss.from_camera += weight * distance / nearest;
        }
        loss
    }

    /// Whether f32 cannot shade the sphere in either form.
    fn is_beyond_f32(self) -> bool {
        self.from_centre.min(self.from_camera) > MOST_LOSS
    }

    /// Whether f32 can only shade the sphere in coordinates relative to the camera.
    fn needs_camera(self) -> bool {
        self.from_centre > MOST_LOSS && self.from_camera < self.from_centre
    }
}

/// Whether f32 has to shade a sphere in coordinates relative to the camera. That is a sphere that
/// is not in front of the camera, or one so near that the camera and a light are much nearer to its
/// surface than its centre is.
pub(super) fn is_shaded_from_camera(sphere: &Sphere, lights: impl Iterator<Item = (DVec3, DVec3)>) -> bool {
    if !is_quadratic(sphere) {
        return true;
    }
    let (centre, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
    // If the loss relative to the centre is the greater one, the light is within a radius of the
    // camera. If it exceeds MOST_LOSS where the other loss does not, the light is also within a
    // small share of a radius of the surface.
    centre.dot(centre) < FARTHEST_FROM_CAMERA * radius * radius && LightLoss::of(sphere, lights).needs_camera()
}

/// The number format that an object needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Form {
    /// Kernels in f32 can trace the object. With the precision `double` it is traced in f64 all the
    /// same.
    Narrow,
    /// Only kernels in f64 can trace the object.
    Wide,
}

/// What the form of an object depends on, beside the object itself.
pub(super) struct Forms {
    grid: Grid<f64>,
    scale: f64,
    /// The positions and radiances of the lights, without dark ones.
    lights: Vec<(DVec3, DVec3)>,
    /// The distance of the farthest light, as kernels take it, divided by the scale.
    farthest: f64,
    /// The radiance of all lights together; `strongest` is the greatest component of the radiance
    /// of a light.
    radiance: DVec3,
    strongest: f64,
}

impl Forms {
    /// What forms depend on, for `lights` of which none is dark. The kernels of triangles take them
    /// to be at most `far` away.
    pub(super) fn new(grid: Grid<f64>, scale: f64, lights: &[&Light], far: f64) -> Self {
        let lights: Vec<_> = lights.iter().map(|light| (light.position.as_dvec3(), light.radiance())).collect();
        let radiance: DVec3 = lights.iter().map(|(_, radiance)| *radiance).sum();
        let strongest = lights.iter().map(|(_, radiance)| radiance.max_element()).fold(0.0, f64::max);
        let farthest = lights.iter().map(|(position, _)| position.length()).fold(0.0, f64::max).min(far) / scale;
        Forms { grid, scale, lights, farthest, radiance, strongest }
    }

    /// The extent of the scene, from which `scale` was derived.
    fn extent(&self) -> f64 {
        self.scale * self.grid.focal
    }

    /// Whether objects with these extremes meet the conditions that spheres and triangles share.
    fn are_usual(&self, extremes: &Extremes) -> bool {
        let Extremes { most, brightest, .. } = *extremes;
        f64::from(most) * LEAST_INVERSE <= self.extent()
            && brightest.is_sign_positive()
            && light::is_in_f32(f64::from(brightest) * self.radiance)
            && self.grid.step >= 1.0 / (1 << 20) as f64
            && (1.0 / 1024.0..=(1 << 20) as f64).contains(&self.grid.focal)
    }

    /// For spheres with these extremes, an upper bound of 1/t: a sphere whose own upper bound is
    /// not above it is certainly narrow. Below 0 if each sphere has to be tested.
    pub(super) fn surely_narrow_spheres(&self, extremes: &Extremes) -> f32 {
        let (most, least) = (f64::from(extremes.most) / self.extent(), f64::from(extremes.least) / self.extent());
        // k is at least 2^-9 and at most 3 most^2 / least^2, so that k radii are at least `least`
        // over 2^9 and at most 3 most^2 / least.
        let fine = least >= LEAST_RADIUS && most * most < least * (1u64 << 26) as f64;
        let keeps_light = f64::from(extremes.brightest) * self.strongest <= NEVER_LOST;
        if fine && keeps_light && self.are_usual(extremes) { (MOST / FAR_IN_RADII) as f32 } else { -1.0 }
    }

    /// As [`surely_narrow_spheres`](Self::surely_narrow_spheres), for triangles.
    pub(super) fn surely_narrow_triangles(&self, extremes: &Extremes) -> f32 {
        if self.are_usual(extremes) { (MOST / self.farthest.max(1.0)) as f32 } else { -1.0 }
    }

    /// The form of a sphere. The upper bound of its 1/t is corrected, since f32 may not have been
    /// able to hold it.
    pub(super) fn of_sphere(&self, sphere: &Sphere, candidate: &mut Candidate) -> Form {
        let (centre, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
        let (c, Grid { step, focal, .. }) = (centre / radius, self.grid);
        let power = c.dot(c);
        let is_too_bright = || {
            let brightest = f64::from(sphere.colour.max_element()) * self.strongest;
            brightest > NEVER_LOST && LightLoss::of(sphere, self.lights.iter().copied()).is_beyond_f32()
        };
        if !is_quadratic(sphere) {
            candidate.most = Candidate::ANY;
            // The distances of the near and of the far wall from the camera, in radii. The near one
            // is at least what rounding can distinguish from 0.
            let [near, far] = [(power.sqrt() - 1.0).abs().max(f64::EPSILON), power.sqrt() + 1.0];
            // 1/t is |d| over the distance of the point. In a wide film the longest d is much
            // longer than the focal distance.
            let Grid { half_width, half_height, .. } = self.grid;
            let longest = self.scale * DVec3::new(half_width, half_height, focal).length();
            let most = longest / (radius * near);
            let narrow = most.max(1.0) * self.farthest.max(1.0) <= MOST
                && self.extent() >= LEAST_INVERSE * radius * far
                && radius * MOST >= longest
                && far <= FARTHEST_AROUND
                && light::is_in_f32(sphere.colour.as_dvec3() * self.radiance)
                && !is_too_bright();
            return if narrow { Form::Narrow } else { Form::Wide };
        }
        let near = near_of_sphere(self.scale * focal) / (centre.z - radius);
        candidate.most = bounded(near);
        let over = self.scale / ((power - 1.0) * radius);
        let lights = self.lights.iter().map(|(position, _)| (position - centre).length() / radius);
        let far = lights.fold(1.0, f64::max).min(FAR_IN_RADII);
        let narrow = near * far <= MOST
            && self.scale / radius <= MOST
            && over <= MOST
            && over * step >= LEAST
            && light::is_in_f32(sphere.colour.as_dvec3() * self.radiance)
            && !is_too_bright();
        if narrow { Form::Narrow } else { Form::Wide }
    }

    /// The form of a triangle. The upper bound of its 1/t is corrected too: kernels in f64 would
    /// otherwise clamp the 1/t of a wide triangle to the range of f32.
    pub(super) fn of_triangle(&self, triangle: &Triangle, candidate: &mut Candidate) -> Form {
        let corners = triangle.vertices.map(|v| v.as_dvec3());
        let [a, b, c] = corners.map(|v| v.z);
        let (nearest, farthest) = (a.min(b).min(c), a.max(b).max(c));
        if candidate.most != Candidate::ANY {
            candidate.most = bounded(candidate.most.into());
        }
        let Some(volume) = geometry::triangle_volume(corners) else { return Form::Narrow };
        let height = volume.abs() / geometry::triangle_plane(corners).length();
        let Grid { half_width, half_height, focal, .. } = self.grid;
        let over_tiles = self.scale * DVec3::new(half_width, half_height, focal).length() / height;
        let most = if nearest > 0.0 { over_tiles.min(self.extent() / nearest) } else { over_tiles };
        let narrow = over_tiles <= MOST_OVER_A_TILE
            && most * self.farthest.max(1.0) <= MOST
            && self.extent() / farthest >= LEAST_INVERSE
            && light::is_in_f32(triangle.colour.as_dvec3() * self.radiance);
        candidate.most = if narrow || candidate.most < Candidate::ANY { candidate.most } else { f32::INFINITY };
        if narrow { Form::Narrow } else { Form::Wide }
    }

    /// Adds the tiles in which f32 loses the w of a triangle with these bounds.
    pub(super) fn steep_tiles(&self, triangle: &Triangle, candidate: &Candidate, tiles: &mut WideTiles) {
        let corners = triangle.vertices.map(|v| v.as_dvec3());
        // The w of the farthest corner, in the unit in which w is n . d / (v . n).
        let farthest = self.grid.focal / greatest(corners.map(|v| v.z)).max(0.0);
        if self.surely_nowhere_steep(corners, farthest) {
            return;
        }
        let Some(volume) = geometry::triangle_volume(corners) else { return };
        let n = geometry::triangle_plane(corners) / volume;
        let [tx, ty] = [n.x * self.grid.step, -n.y * self.grid.step];
        // The distances from the tile's middle of the first and the last of those pixels of a range
        // that are in the tile.
        let part = |pixels: &Range<u32>, first: u32, side: usize| {
            let (start, end) = (pixels.start.max(first), pixels.end.min(first + side as u32));
            let middle = f64::from(first) + side as f64 / 2.0;
            [f64::from(start) - middle, f64::from(end) - 1.0 - middle]
        };
        let (of_columns, of_rows) = (range(candidate.columns), range(candidate.rows));
        for down in tile_range(of_rows.clone(), TILE_HEIGHT) {
            for across in tile_range(of_columns.clone(), TILE_WIDTH) {
                let tile = TilePlace { across, down };
                if tiles.has(tile) {
                    continue;
                }
                let (column, row) = tile.first();
                let [left, right] = part(&of_columns, column, TILE_WIDTH);
                let [top, bottom] = part(&of_rows, row, TILE_HEIGHT);
                let middle = DVec3::from(self.grid.ray(row + TILE_HEIGHT as u32 / 2, column + TILE_WIDTH as u32 / 2));
                let least = n.dot(middle) + (tx * left).min(tx * right) + (ty * top).min(ty * bottom);
                let [x, y] = [left.abs().max(right.abs()), top.abs().max(bottom.abs())];
                let is_exact = steepness(tx, ty, x, y) <= (STEEPEST - INVERSE_ROUNDINGS[0]) * least.max(farthest);
                // This is also false for a NaN.
                if !is_exact {
                    tiles.add(tile);
                }
            }
        }
    }

    /// Whether a triangle is certainly not steep in any tile, whatever the rounding of its plane.
    /// That is the case for nearly all triangles.
    fn surely_nowhere_steep(&self, [v, v2, v3]: [DVec3; 3], farthest: f64) -> bool {
        let (a, b) = (v2 - v, v3 - v);
        let n = a.cross(b);
        let rounding = 8.0 * f64::EPSILON * size(a) * size(b);
        let most = self.grid.step * (n.abs() + rounding);
        let volume = v.dot(n).abs() - 4.0 * rounding * size(v);
        let (x, y) = (TILE_WIDTH as f64 / 2.0, TILE_HEIGHT as f64 / 2.0);
        steepness(most.x, most.y, x, y) <= (STEEPEST - INVERSE_ROUNDINGS[0]) * farthest * volume
    }
}

/// The upper bound of a triangle's 1/t at a pixel, from its plane: at the first pixel, and its
/// increments per column and per row. None if f32 cannot hold them, if the plane that kernels
/// compute may differ from this one by more than the margin allows, or if no ray hits the triangle.
pub(super) fn most_at(triangle: &Triangle, grid: Grid<f64>, scale: f64, picture: Picture) -> Option<[f32; 3]> {
    let geometry::PlaneOfOne { p, lost } = geometry::plane_of_one(triangle.vertices.map(|v| v.as_dvec3()))?;
    let n = scale * p;
    let (first, ray) = (n.dot(grid.ray(0, 0).into()), DVec3::from(grid.ray(0, 0)).abs());
    let (across, down) = (n.x * grid.step, -n.y * grid.step);
    let terms = n.abs().dot(ray) + across.abs() * f64::from(picture.width) + down.abs() * f64::from(picture.height);
    // Half of the margin, 2^-18 of the terms, is for the kernel's plane; see `is_kernels`. The
    // other half is for roundings in f32, here and in the kernel, which are about 2^-24 of the
    // terms unless results are subnormal.
    let most = [first + terms / f64::from(1 << 17), across, down].map(|x| x as f32);
    let is_kernels = scale * lost * ray.element_sum() <= terms / f64::from(1 << 18);
    ((1e-30..f32::MAX.into()).contains(&terms) && is_kernels).then_some(most)
}

/// A lower bound of a triangle's 1/t, as kernels round it, at all pixels of a tile; 0 if the
/// triangle may not cover all of them.
pub(super) fn least_over(triangle: &Triangle, grid: Grid<f64>, scale: f64, picture: Picture, tile: TilePlace) -> f32 {
    let (column, row) = tile.first();
    let corners = [[0, 0], [TILE_WIDTH, 0], [0, TILE_HEIGHT], [TILE_WIDTH, TILE_HEIGHT]];
    let corners = corners.map(|[across, down]| [column + across as u32, row + down as u32]);
    let [a, b, c] = triangle.vertices.map(|v| v.as_dvec3());
    let volume = a.dot(b.cross(c)).signum();
    let is_inside = |[column, row]: [u32; 2]| {
        let ray = DVec3::from(grid.ray(row, column));
        [(a, b), (b, c), (c, a)]
            .iter()
            .all(|(from, to)| volume * from.cross(*to).dot(ray) > 1e-14 * from.length() * to.length() * ray.length())
    };
    let Some([first, across, down]) = most_at(triangle, grid, scale, picture) else { return 0.0 };
    let terms = first.abs() + across.abs() * picture.width as f32 + down.abs() * picture.height as f32;
    let there = |[column, row]: [u32; 2]| first + across * column as f32 + down * row as f32;
    let least = corners.into_iter().map(there).fold(f32::MAX, f32::min) - terms / (1 << 14) as f32;
    if corners.into_iter().all(is_inside) { least.max(0.0) } else { 0.0 }
}

/// The greatest magnitude of a vector's components.
fn size(v: DVec3) -> f64 {
    greatest(v.abs().to_array())
}

/// The maximum of numbers that are not NaN, written so that it compiles to one instruction for two
/// numbers.
fn greatest([a, b, c]: [f64; 3]) -> f64 {
    let of_two = if a > b { a } else { b };
    if of_two > c { of_two } else { c }
}

/// A bound on the error of w = t0 + tx x + ty y beyond 3 u w, in units of u.
fn steepness(tx: f64, ty: f64, x: f64, y: f64) -> f64 {
    let [_, across, down] = INVERSE_ROUNDINGS;
    across * tx.abs() * x + down * ty.abs() * y
}

/// An upper bound of 1/t as an f32 above 0 that is not [`Candidate::ANY`]; infinity if it is beyond
/// f32.
fn bounded(near: f64) -> f32 {
    if near < Candidate::ANY.into() {
        (near as f32).clamp(f32::MIN_POSITIVE, Candidate::ANY.next_down())
    } else {
        f32::INFINITY
    }
}

/// The upper bound of a sphere's 1/t, times the distance of the sphere's nearest point from the
/// camera's plane; `extent` is that of the scene. The margin is for the rounding of D, which
/// cancels at the outline, where 1/t is least, and loses some digits near the nearest point.
pub(super) fn near_of_sphere(extent: f64) -> f64 {
    extent * (1.0 + 1.0 / 1024.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{power_of_two, unit_rays};
    use crate::scene::{Camera, Rng};
    use glam::Vec3;

    /// 2 to a power from `low` to `high`, and up to twice that.
    fn power(rng: &mut Rng, low: i32, high: i32) -> f64 {
        let [exponent, fraction] = [0, 1].map(|_| (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64);
        ((f64::from(low) + exponent * f64::from(high - low)).floor()).exp2() * (1.0 + fraction)
    }

    #[test]
    fn a_sphere_that_is_narrow_for_sure_is_narrow() {
        let mut rng = Rng::new(1);
        let [mut sure, mut doubtful] = [0, 0];
        for round in 0..400_000 {
            let sign = |rng: &mut Rng| [1.0, -1.0][(rng.next_u64() % 2) as usize];
            let (focal, film) = (power(&mut rng, -12, 8) as f32, power(&mut rng, -6, 6) as f32);
            let width = 1 + (rng.next_u64() % 65_535) as u32;
            let camera = Camera::new(width, 1 + width / 2, focal, film).unwrap();
            let grid = unit_rays(camera.grid()).grid;
            let extent = power(&mut rng, -20, 20);
            let light = Light {
                intensity: 1.0,
                colour: Vec3::ONE,
                position: Vec3::from_array([0; 3].map(|_| (sign(&mut rng) * extent * power(&mut rng, -8, 60)) as f32)),
            };
            let forms = Forms::new(grid, power_of_two(extent / grid.focal), &[&light], extent * FAR);
            let [x, y] = [0; 2].map(|_| (sign(&mut rng) * extent * power(&mut rng, -20, 10)) as f32);
            let sphere = Sphere {
                radius: (extent * power(&mut rng, -42, 4)) as f32,
                colour: Vec3::splat(power(&mut rng, -4, 4) as f32),
                centre: Vec3::new(x, y, (extent * power(&mut rng, -20, 10)) as f32),
            };
            let (centre, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
            let c = centre / radius;
            // The spheres that the kernel of bounds leaves to the plan.
            if c.z < FRONT || c.dot(c) > 2.0 * c.z * c.z - 1.0 {
                continue;
            }
            let extremes = Extremes {
                most: greatest(sphere.centre.abs().as_dvec3().to_array()).max(radius) as f32,
                least: sphere.radius,
                brightest: sphere.colour.x,
                nearest: 0.0,
                longest: 0.0,
            };
            let mut candidate = Candidate {
                most: bounded(near_of_sphere(forms.extent()) / (centre.z - radius)),
                ..Candidate::default()
            };
            if candidate.most <= forms.surely_narrow_spheres(&extremes) {
                assert_eq!(
                    forms.of_sphere(&sphere, &mut candidate),
                    Form::Narrow,
                    "round {round}: {sphere:?}, {camera:?}, {extent}"
                );
                sure += 1;
            } else {
                doubtful += 1;
            }
        }
        assert!(sure > 10_000 && doubtful > 10_000, "{sure}, {doubtful}");
    }
}
