//! The twin of the tile macros: one object, one pixel of a tile, one light.
//!
//! These are the operations of `asm/include/{tile,tile_hit,tile_light}.inc`, and of the set-up in `asm/tracers`, in the same
//! order. `asm/include/tile_layout.inc` says what each number is. Set-up is in f64, and its results are rounded once.

use std::ops::{Range, RangeInclusive};

use glam::DVec3;

use super::packet::{Cosine, Rounding, cosine, max, min};
use super::{Real, geometry};

/// A sphere is in front if its centre is at least so many radii before the camera's plane.
const FRONT: f64 = 1.001;
/// Pixels by which the bounds of a sphere are opened.
const OUTLINE: f64 = 1e-3;
/// By how many units of its terms D may be rounded.
const ROUNDINGS: f64 = 4.0 * f32::EPSILON as f64;
/// What is 0 but for the rounding, against the sum of its terms.
const PLANE: f64 = 4.0 * f64::EPSILON;
/// The short form is accurate enough if the light is further than this from the sphere, nearer than that, in radii, and
/// if the terms cancel to no less than one part in so many.
const SHORT: (f64, f64, f64) = (0.25, (1u64 << 36) as f64, 1024.0);

/// The grid of rays, a power of two that brings 1/t to size, and the sides of the picture.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "SphereView has them")]
pub struct SphereView {
    pub step: f64,
    pub half_width: f64,
    pub half_height: f64,
    pub focal: f64,
    pub scale: f64,
    pub sides: [f64; 2],
}

impl SphereView {
    /// The ray of a pixel.
    pub fn ray(&self, column: f64, row: f64) -> DVec3 {
        let (x, y) = (self.step * (column + 0.5) - self.half_width, self.half_height - self.step * (row + 0.5));
        DVec3::new(x, y, self.focal)
    }
}

/// The rays of a tile, from the pixel in its middle, and the rounding bound of an edge.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "TileView has them")]
pub struct TileView {
    pub ray: DVec3,
    pub step: f64,
    pub down: f64,
    pub scale: f64,
    pub bound: DVec3,
    pub bound_0: f64,
}

/// A linear function of the pixel: `origin + across x + down y`, fields name0, namex and namey.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "the formula is above")]
pub struct Plane<T> {
    pub origin: T,
    pub across: T,
    pub down: T,
}

/// A triangle in a tile.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "TrianglePlanes has them")]
pub struct TrianglePlanes<T> {
    pub edges: [Plane<T>; 3],
    pub inverse: Plane<T>,
    pub most: T,
}

/// What set-up makes of a triangle.
#[derive(Clone, Copy, Debug)]
pub struct Triangle {
    /// Its planes.
    pub planes: TrianglePlanes<f64>,
    /// Its first corner.
    corner: DVec3,
    /// Not of length 1.
    normal: DVec3,
    /// What makes it as long as shading wants it.
    per: f64,
}

/// A sphere as a function of the pixels from its own origin.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "SpherePlanes has them")]
pub struct SpherePlanes<T> {
    pub d: [T; 6],
    pub h: Plane<T>,
    pub most: T,
}

/// What is known of a sphere in front.
#[derive(Clone, Copy, Debug)]
pub struct InFront {
    /// Columns and rows, with fractions.
    pub bounds: [[f64; 2]; 2],
    /// The ray at its origin.
    origin: DVec3,
    /// The fields of SpherePlanes but for the last two.
    pub planes: [f64; 12],
    /// The fields of TileSphere but for the last ones.
    pub shading: [f64; 20],
}

/// What turns corners into bounds.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "BoundsView has them")]
pub struct BoundsView {
    pub to_pixels: f32,
    pub column: f32,
    pub row: f32,
    pub low: f32,
    pub high: f32,
    pub sides: [f32; 2],
    pub most: f32,
    pub reach: f32,
    pub outside: f32,
}

/// Nearer than this a corner's place in the picture could overflow.
const LEAST: f32 = 1e-30;

/// PROJECT, along one axis, of corners with `to_pixels / z`.
fn project(over: [f32; 3], along: [f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|i| over[i] * along[i])
}

/// FIRST_AND_PAST.
fn first_and_past([from, to]: [f32; 2], side: f32) -> u32 {
    let [first, past] = [from, to].map(|x| min(max(x, 0.0), side) as u32);
    first | past << 16
}

/// CROSS2.
fn cross2([ax, ay]: [f32; 2], [bx, by]: [f32; 2]) -> f32 {
    ax * by - ay * bx
}

/// EDGES_HERE: the greatest of what is least of the edges, and the least of what is greatest.
fn edges_here([low, high]: [f32; 2], [a, b, c]: [f32; 3]) -> [f32; 2] {
    [max(low, min(min(a, b), c)), min(high, max(max(a, b), c))]
}

/// The pixels from the first to the one past the last << 16.
fn length(bounds: u32) -> f32 {
    (bounds >> 16) as f32 - (bounds & 0xffff) as f32
}

impl BoundsView {
    /// The columns and rows that a triangle can cover, each as the first and the one past the last << 16, and what its 1/t
    /// cannot exceed: the largest number if it reaches behind the camera. Where these hold four pixels at most, and an
    /// edge or another has each of them outside, there are no columns.
    pub fn of_triangle(&self, corners: [[f32; 3]; 3]) -> ([u32; 2], f32) {
        let least = |[a, b, c]: [f32; 3]| min(min(a, b), c);
        let most = |[a, b, c]: [f32; 3]| max(max(a, b), c);
        let z = corners.map(|corner| corner[2]);
        if most(z) <= 0.0 {
            return ([0; 2], f32::MAX);
        }
        let [width, height] = self.sides;
        if least(z) <= LEAST {
            return ([width, height].map(|side| (side as u32) << 16), f32::MAX);
        }
        let over = z.map(|z| self.to_pixels / z);
        let across = project(over, corners.map(|corner| corner[0]));
        let up = project(over, corners.map(|corner| corner[1]));
        let columns = [least(across) + self.column + self.low, most(across) + self.column + self.high];
        let rows = [self.row - most(up) + self.low, self.row - least(up) + self.high];
        let bounds = [first_and_past(columns, width), first_and_past(rows, height)];
        let cannot_exceed = self.most / least(z);
        if most(across) - least(across) >= self.reach || most(up) - least(up) >= self.reach {
            return (bounds, cannot_exceed);
        }
        // Edges at the first pixel, and what a column and a row more add to them.
        let [first_column, first_row] = bounds.map(|bounds| (bounds & 0xffff) as f32);
        let x = across.map(|x| x - (first_column - self.column));
        let y = up.map(|y| y - (self.row - first_row));
        let next = [(0, 1), (1, 2), (2, 0)];
        let mut edges = next.map(|(v, w)| cross2([x[v], y[v]], [x[w], y[w]]));
        let (column, row) = (next.map(|(v, w)| y[v] - y[w]), next.map(|(v, w)| x[v] - x[w]));
        let mut extremes = [least(edges), most(edges)];
        for (step, sign) in [(column, 1.0), (row, 1.0), (column, -1.0)] {
            edges = [0, 1, 2].map(|i| edges[i] + sign * step[i]);
            extremes = edges_here(extremes, edges);
        }
        let [low, high] = extremes;
        if self.outside > max(low, -high) { ([0, bounds[1]], cannot_exceed) } else { (bounds, cannot_exceed) }
    }

    /// The longer side of what bounds hold; 0 where that is nothing.
    pub fn longer_side(bounds: [u32; 2]) -> f32 {
        let [columns, rows] = bounds.map(length);
        if min(columns, rows) > 0.0 { max(columns, rows) } else { 0.0 }
    }
}

/// SILHOUETTE.
fn silhouette(cx: f64, cz: f64) -> [f64; 2] {
    let m = cz * cz - 1.0;
    let root = (cx * cx + m).sqrt();
    let b = cx * cz;
    // The product of the two is (cx^2 - 1) / m.
    let product = (cx - 1.0) * (cx + 1.0);
    if b >= 0.0 { [product / (b + root), (b + root) / m] } else { [(b - root) / m, product / (b - root)] }
}

/// NEAREST_PIXEL: the one in the middle, in the picture.
fn nearest_pixel([low, high]: [f64; 2], side: f64) -> f64 {
    (0.5 * (low + high)).round().clamp(0.0, side)
}

/// REACH: how far a range is from a place where it is in the picture, and a pixel more.
fn reach([low, high]: [f64; 2], origin: f64, side: f64) -> f64 {
    (high.min(side) - origin).max(origin - low.max(0.0)) + 1.0
}

/// SPHERE_D: D = d.d - |c x d|^2 of the ray d at an origin, and of what i columns and j rows add to it, times `square`.
fn sphere_d(c: DVec3, d: DVec3, across: DVec3, down: DVec3, square: f64) -> [f64; 6] {
    // Both of them are quadratic in i and j: no difference of large numbers for a far sphere.
    let (a, u, v) = (c.cross(d), c.cross(across), c.cross(down));
    let quadratic = [
        d.dot(d) - a.dot(a),
        2.0 * (d.dot(across) - a.dot(u)),
        2.0 * (d.dot(down) - a.dot(v)),
        across.dot(across) - u.dot(u),
        -2.0 * u.dot(v),
        down.dot(down) - v.dot(v),
    ];
    quadratic.map(|x| x * square)
}

/// TERM: what D can be rounded by where its terms are no larger than at i and j.
fn rounding([d0, dx, dy, dxx, dxy, dyy]: [f64; 6], i: f64, j: f64) -> f64 {
    let terms = [d0, dx * i, dy * j, dxx * i * i, dxy * i * j, dyy * j * j];
    ROUNDINGS * terms.iter().map(|term| term.abs()).sum::<f64>()
}

/// NORMAL: n / t = (d - h c / k) - sqrt(D) c / k over the radius, its first part, with h = c . d.
fn normal(c: DVec3, k: f64, d: DVec3, h: f64, per: f64) -> DVec3 {
    (d - h / k * c) * per
}

/// TO_LIGHT: from the centre to the light, in radii.
fn to_light((centre, radius): (DVec3, f64), light: DVec3) -> DVec3 {
    (light - centre) / radius
}

/// WEIGHT and SPHERE_WEIGHT: what a light that radiates so much adds to an object of this colour, but no more than `most`.
/// `white` is 1 for triangles, whose lights have it in them.
pub fn weights(colour: DVec3, white: f64, radiance: DVec3, most: f64) -> DVec3 {
    DVec3::from_array((colour * white * radiance).to_array().map(|weight| min(weight, most)))
}

impl SphereView {
    /// The columns and rows that a sphere can cover, and what its 1/t cannot exceed, which is `most` at distance 1: the
    /// largest number where no kernel traces it, and where its planes may lose digits to the side.
    pub fn of_sphere(&self, centre: DVec3, radius: f64, most: f64) -> ([u32; 2], f32) {
        let sides = self.sides.map(|side| side as u32);
        let c = centre / radius;
        match InFront::new(centre, radius, self) {
            Some(front) => {
                let sideways = c.dot(c) > 2.0 * c.z * c.z - 1.0;
                let cannot_exceed = if sideways { f32::MAX } else { (most / (centre.z - radius)) as f32 };
                ([0, 1].map(|axis| InFront::pixels(front.bounds[axis], sides[axis])), cannot_exceed)
            }
            None if c.z <= -1.0 => ([0; 2], 0.0),
            None => (sides.map(|side| side << 16), f32::MAX),
        }
    }
}

impl InFront {
    /// SPHERE_BOX and what the functions of sphere_set_up.asm make of it; None unless the sphere is wholly in front of the
    /// camera's plane, with the camera outside.
    pub fn new(centre: DVec3, radius: f64, view: &SphereView) -> Option<Self> {
        let SphereView { step, half_width, half_height, focal, scale, sides: [width, height] } = *view;
        // In units of the radius.
        let c = centre / radius;
        let k = c.dot(c) - 1.0;
        if c.z.is_nan() || c.z < FRONT || !k.is_finite() {
            return None;
        }
        let columns = silhouette(c.x, c.z).map(|x| (focal * x + half_width) / step - 0.5);
        let rows = silhouette(c.y, c.z).map(|y| (half_height - focal * y) / step - 0.5);
        let rows = [rows[1], rows[0]];
        let (column, row) = (nearest_pixel(columns, width), nearest_pixel(rows, height));
        // The ray at the origin, and what a column and a row more add to it.
        let d = view.ray(column, row);
        let (across, down) = (DVec3::X * step, DVec3::Y * -step);
        let (over, per) = (scale / (k * radius), scale / radius);
        let quadratic = sphere_d(c, d, across, down, over.powi(2));
        let [d0, dx, dy, dxx, dxy, dyy] = quadratic;
        let bound = rounding(quadratic, reach(columns, column, width), reach(rows, row, height));
        let [h, hx, hy] = [d, across, down].map(|d| c.dot(d));
        let (m, mx, my) = (normal(c, k, d, h, per), normal(c, k, across, hx, per), normal(c, k, down, hy, per));
        Some(InFront {
            bounds: [columns, rows],
            origin: d,
            planes: [column, row, d0, dx, dy, dxx, dxy, dyy, bound, h * over, hx * over, hy * over],
            shading: [
                column, row, d0, dx, dy, dxx, dxy, dyy, m.x, mx.x, my.x, m.y, mx.y, my.y, m.z, mx.z, my.z, c.x, c.y,
                c.z,
            ],
        })
    }

    /// PIXELS_BETWEEN: the first pixel in a range of coordinates, and the one past the last << 16.
    pub fn pixels(range: [f64; 2], side: u32) -> u32 {
        let [low, high] = range;
        // Casts saturate.
        let first = ((low - OUTLINE).ceil() as u32).min(side);
        let past = ((high + OUTLINE).floor() + 1.0).clamp(0.0, side.into()) as u32;
        first | past << 16
    }

    /// A light on a sphere in the short form, and whether that is accurate enough for bytes in f32. The weights are for
    /// white at 255.
    pub fn short_lit(
        &self,
        (centre, radius): (DVec3, f64),
        (light, weights): (DVec3, DVec3),
        view: &SphereView,
    ) -> ([f64; 8], bool) {
        let (c, l) = (centre / radius, light / radius);
        let from_centre = to_light((centre, radius), light);
        let k = c.dot(c) - 1.0;
        let (kn, ke) = (k - c.dot(l), l.dot(l) - k);
        let (products, gap) = ((c.length() + 1.0) * from_centre.length(), from_centre.length() - 1.0);
        let loss = f64::max((kn.abs() + products) / gap, (ke.abs() + 2.0 * products) / (gap * gap));
        let q = from_centre * (view.scale / radius);
        let (near, far, most) = SHORT;
        let numbers = [q.dot(self.origin), q.x * view.step, -q.y * view.step, kn, ke, weights.x, weights.y, weights.z];
        (numbers, gap > near && gap < far && loss < most)
    }
}

/// A light on a sphere in the long form, brought to `far` radii where it is further away.
pub fn lit(sphere: (DVec3, f64), (light, weights): (DVec3, DVec3), far: f64) -> [f64; 8] {
    let mut l = to_light(sphere, light);
    if l.length() > far {
        l *= far / l.length();
    }
    [l.x, l.y, l.z, 0.0, weights.x, weights.y, weights.z, 0.0]
}

/// PARTS: the parts of a tile, so many pixels long, where an object with these bounds may be, across or down, within the
/// window of the tile that begins at `tile`.
pub fn parts(bounds: Range<u32>, tile: u32, window: Range<u32>, side: u32) -> RangeInclusive<u32> {
    let first = bounds.start.max(tile + window.start) - tile;
    let last = bounds.end.min(tile + window.end).saturating_sub(tile + 1);
    first / side..=last / side
}

/// What VISIBLE leaves out: whether what is farthest in all of these columns and rows of parts, of which a row has so many, is
/// nearer than `most`.
pub fn hides(farthest: &[f32], across: u32, [columns, mut rows]: [RangeInclusive<u32>; 2], most: f32) -> bool {
    rows.all(|row| columns.clone().all(|column| farthest[(row * across + column) as usize] > most))
}

/// What NEARER_HALF cuts at: as many f32 are between it and the least of some numbers not below 0 as between it and the
/// greatest, the largest f32 not being taken for that.
pub fn middle(numbers: impl Iterator<Item = f32> + Clone) -> f32 {
    let most = numbers.clone().filter(|number| *number != f32::MAX).fold(0.0, max);
    let least = numbers.fold(f32::MAX, min);
    f32::from_bits((least.to_bits() + most.to_bits()) / 2)
}

/// IF_OUTSIDE_TRIANGLE: whether the ray `d` is outside an edge of a triangle whose volume has the sign of `side`.
pub fn outside_triangle(d: DVec3, [a, b, c]: [DVec3; 3], side: f64) -> bool {
    let inside = |(v, w): (DVec3, DVec3)| d.dot(v.cross(w)) * 1f64.copysign(side) >= 0.0;
    ![(a, b), (b, c), (c, a)].into_iter().all(inside)
}

/// IF_OUTSIDE_SPHERE: whether the ray `d` passes a sphere.
pub fn outside_sphere(d: DVec3, centre: DVec3, radius: f64) -> bool {
    let x = centre.cross(d);
    let hit = d.dot(d) * radius * radius >= x.dot(x);
    !hit
}

/// AROUND: what stands for 1/t of the nearest wall of a sphere around the camera or beside it, 0 where the ray misses it. `scale` is
/// 1/t where t is 1.
pub fn around(d: DVec3, centre: DVec3, radius: f64, scale: f64) -> f64 {
    let (a, h, k, r2) = (d.dot(d), d.dot(centre), geometry::power(centre, radius), radius * radius);
    let far = centre.dot(centre) >= 2.0 * r2;
    let disc = if far { a * r2 - centre.cross(d).length_squared() } else { h * h - a * k };
    let q = h + disc.sqrt().copysign(h);
    let one = max(q * if k == 0.0 { 0.0 } else { scale / k }, 0.0);
    let other = max(a * scale / q, 0.0);
    max(one, if other < f64::INFINITY { other } else { 0.0 })
}

impl Rounding {
    /// AROUND_NORMAL: of 1/t, the ray, and the centre and the radius over the scale, the latter inverted.
    pub fn around_normal<T: Real>(self, w: T, ray: [T; 3], centre: [T; 3], over_radius: T) -> [T; 3] {
        let t = T::ONE / w;
        [0, 1, 2].map(|i| (ray[i] * t - centre[i]) * over_radius)
    }

    /// AROUND_COSINE: of 1/t, the ray, the normal and the light.
    pub fn around_cosine<T: Real>(self, w: T, ray: [T; 3], n: [T; 3], light: [T; 3], by: &mut impl Cosine<T>) -> T {
        let to_light = [0, 1, 2].map(|i| self.fma(light[i], w, -ray[i]));
        cosine(by, self.dot(n, to_light), self.dot(to_light, to_light))
    }

    /// What a tile keeps of a triangle, by TRIANGLE_VOLUME and TRIANGLE_EDGE: where its volume is 0 but for the rounding it
    /// is at no distance, and so never nearest.
    pub fn set_up(self, [a, b, c]: [DVec3; 3], most: f64, view: &TileView) -> Triangle {
        let normal = (a - b).cross(a - c);
        let volume = a.dot(normal);
        let seen = volume.abs() > a.abs().dot(normal.abs()) * PLANE;
        let n = if seen { normal * (view.scale / volume) } else { DVec3::ZERO };
        let plane = |n: DVec3| Plane {
            origin: self.dot(n.into(), view.ray.into()),
            across: n.x * view.step,
            down: n.y * view.down,
        };
        let edges = [(a, b), (b, c), (c, a)].map(|(v, w)| {
            let e = v.cross(w);
            let Plane { origin, across, down } = plane(e);
            let bound = self.fma(origin.abs(), view.bound_0, self.dot(e.abs().into(), view.bound.into()));
            let over = 1f64.copysign(volume) / bound;
            Plane { origin: origin * over, across: across * over, down: down * over }
        });
        let per = 1.0 / (self.norm(normal.into()) * view.scale);
        Triangle { planes: TrianglePlanes { edges, inverse: plane(n), most }, corner: a, normal, per }
    }

    /// What a light at `light` does to a triangle, but for the colours: |n . (l - v)| / |n|, over the scale.
    pub fn shade(self, triangle: &Triangle, light: DVec3) -> f64 {
        let along = self.dot((light - triangle.corner).into(), triangle.normal.into()).abs();
        min(along * triangle.per, f64::INFINITY)
    }

    /// PLANE_ROW and PLANE_AT.
    pub fn plane_at<T: Real>(self, plane: &Plane<T>, x: T, y: T) -> T {
        self.fma(plane.across, x, self.fma(plane.down, y, plane.origin))
    }

    /// TRIANGLE_AT: the least of the edges, which are inside from 1 up and outside below -1, and 1/t.
    pub fn triangle_at<T: Real>(self, triangle: &TrianglePlanes<T>, x: T, y: T) -> (T, T) {
        let [one, two, three] = triangle.edges.map(|edge| self.plane_at(&edge, x, y));
        (min(min(one, two), three), min(self.plane_at(&triangle.inverse, x, y), triangle.most))
    }

    /// SPHERE_ROW, SPHERE_D_AT and SPHERE_INVERSE_AT: D and 1/t.
    pub fn sphere_at<T: Real>(self, sphere: &SpherePlanes<T>, x: T, y: T) -> (T, T) {
        let [d0, dx, dy, dxx, dxy, dyy] = sphere.d;
        let row = self.fma(self.fma(dyy, y, dy), y, d0);
        let d = self.fma(self.fma(dxx, x, self.fma(dxy, y, dx)), x, row);
        let w = self.plane_at(&sphere.h, x, y) + max(d, T::ZERO).sqrt();
        (d, min(w, sphere.most))
    }

    /// TRIANGLE_COSINE: of a [shade](Rounding::shade), 1/t, the ray and the light.
    pub fn triangle_cosine<T: Real>(self, shade: T, w: T, ray: [T; 3], light: [T; 3], by: &mut impl Cosine<T>) -> T {
        let to_light = [0, 1, 2].map(|i| self.fma(light[i], w, -ray[i]));
        cosine(by, shade * w, self.dot(to_light, to_light))
    }

    /// SPHERE_ROOT and NORMAL_OVER_T of a TileSphere's first 20 fields: n / t.
    pub fn normal_over_t<T: Real>(self, shading: &[T; 20], x: T, y: T) -> [T; 3] {
        let &[_, _, d0, dx, dy, dxx, dxy, dyy, ref rest @ ..] = shading;
        let along = self.fma(dxx, x, self.fma(dxy, y, dx));
        let d = self.fma(along, x, self.fma(self.fma(dyy, y, dy), y, d0));
        let root = max(d, T::ZERO).sqrt();
        [0, 1, 2].map(|i| {
            let m = self.fma(rest[3 * i + 2], y, self.fma(rest[3 * i + 1], x, rest[3 * i]));
            self.fma(-rest[9 + i], root, m)
        })
    }

    /// SPHERE_COSINE: of n / t, 1/t and the light.
    pub fn sphere_cosine<T: Real>(self, m: [T; 3], w: T, light: [T; 3], by: &mut impl Cosine<T>) -> T {
        let to_light = [0, 1, 2].map(|i| self.fma(light[i], w, -m[i]));
        cosine(by, self.dot(light, m) - w, self.dot(to_light, to_light))
    }

    /// SHORT_COSINE: of a ShortLight's q0, qx, qy, kn, ke, and 1/t.
    pub fn short_cosine<T: Real>(self, short: [T; 5], w: T, x: T, y: T, by: &mut impl Cosine<T>) -> T {
        let [q0, qx, qy, kn, ke] = short;
        let q = self.fma(y, qy, self.fma(x, qx, q0));
        let e = ((w * ke - q) - q) * w;
        cosine(by, self.fma(w, kn, q), e)
    }
}
