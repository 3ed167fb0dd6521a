//! Intersections of a ray with a sphere and a triangle, shadows, and the Lambert term, in readable
//! f64. They define the right result.
//!
//! A ray is given by its direction `d`, of any length but 0. It starts at the origin, and its
//! points are `t d` for t > 0.

use glam::{DVec3, Vec3Swizzles};

/// The smallest t > 0 at which the ray is on the sphere, eq. 5.
///
/// The roots of a t^2 - 2 h t + k are computed as k/q and q/a, so that neither cancels. For a
/// distant sphere h^2 - a k would cancel too; it is then computed as a r^2 - |c x d|^2, which is
/// the same number.
pub fn sphere(d: DVec3, centre: DVec3, radius: f64) -> Option<f64> {
    let (a, h) = (d.dot(d), d.dot(centre));
    let disc = discriminant(d, centre, radius);
    if disc.is_nan() || disc < 0.0 {
        return None;
    }
    let k = power(centre, radius);
    let q = h + disc.sqrt().copysign(h);
    let hits = [k / q, q / a].into_iter().filter(|t| *t > 0.0);
    hits.min_by(f64::total_cmp).filter(|t| t.is_finite())
}

/// The discriminant h^2 - a k of [`sphere`]. Its sign says whether the line along `d` meets the
/// sphere; it is 0 where the line touches it.
fn discriminant(d: DVec3, centre: DVec3, radius: f64) -> f64 {
    let (a, h, r2) = (d.dot(d), d.dot(centre), radius * radius);
    if centre.dot(centre) < 2.0 * r2 {
        h * h - a * power(centre, radius)
    } else {
        a * r2 - centre.cross(d).length_squared()
    }
}

/// |c|^2 - r^2, the power of the camera with respect to a sphere. Its sign says whether the camera
/// is outside of the sphere, on it or inside. For f32 numbers the sign is right however much
/// cancels.
pub fn power(centre: DVec3, radius: f64) -> f64 {
    // The square of a 24-bit number is exact in f64. The sum is kept as parts that do not overlap,
    // the largest last (Shewchuk's expansions).
    let mut parts = [0.0; 4];
    for (i, square) in [centre.x, centre.y, centre.z].map(|c| c * c).into_iter().chain([-radius * radius]).enumerate() {
        let mut sum = square;
        for part in &mut parts[..i] {
            let (rounded, rest) = two_sum(sum, *part);
            (sum, *part) = (rounded, rest);
        }
        parts[i] = sum;
    }
    parts.iter().sum()
}

/// a + b and its rounding error, by Knuth's algorithm for a and b in any order of magnitude.
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let from_b = sum - a;
    (sum, (a - (sum - from_b)) + (b - from_b))
}

/// The outward unit normal of a sphere at the point `p` of its surface.
pub fn sphere_normal(p: DVec3, centre: DVec3) -> DVec3 {
    (p - centre).normalize()
}

/// The t > 0 at which the ray meets the triangle, whose edges and vertices count: eq. 9 and eq. 10.
///
/// Eq. 10 asks on which side of each edge P = t d lies. For a ray from the origin that is the sign
/// of d . (v x w), for the edge from v to w, compared with the sign of the triangle's own volume
/// v1 . n, where n is the normal of eq. 6. In f64 v x w is exactly -(w x v), so that two triangles
/// that share an edge never both miss a ray.
pub fn triangle(d: DVec3, vertices: [DVec3; 3]) -> Option<f64> {
    let volume = triangle_volume(vertices)?;
    let inside = is_inside(d, vertices, volume);
    let t = volume / d.dot(triangle_plane(vertices));
    (inside && t > 0.0 && t.is_finite()).then_some(t)
}

/// Eq. 10 for a triangle with this volume; only the sign of the volume matters.
fn is_inside(d: DVec3, [v1, v2, v3]: [DVec3; 3], volume: f64) -> bool {
    [(v1, v2), (v2, v3), (v3, v1)].iter().all(|(v, w)| d.dot(v.cross(*w)) * volume.signum() >= 0.0)
}

/// The corners, rotated so that the nearest one comes first. The product of any corner with the
/// normal is the volume, but for a farther corner the terms would cancel.
pub fn near_corner_first(vertices: [DVec3; 3]) -> [DVec3; 3] {
    least_first(vertices, vertices.map(|v| v.abs().max_element()))
}

/// The corners, rotated so that the longest side is opposite the first one. In the cross product of
/// two longer sides terms would cancel.
fn short_sides_first([v1, v2, v3]: [DVec3; 3]) -> [DVec3; 3] {
    least_first([v1, v2, v3], [v2 - v3, v3 - v1, v1 - v2].map(|side| -side.abs().max_element()))
}

/// The corners, rotated so that the one with the least of these numbers comes first.
fn least_first([v1, v2, v3]: [DVec3; 3], [one, two, three]: [f64; 3]) -> [DVec3; 3] {
    // Not by `rotate_left`, which would be a call that moves memory.
    match if two < one { 1 + usize::from(three < two) } else { 2 * usize::from(three < one) } {
        0 => [v1, v2, v3],
        1 => [v2, v3, v1],
        _ => [v3, v1, v2],
    }
}

/// A volume of at least this share of the product of its terms cannot be 0 in exact arithmetic.
const PLAIN: f64 = 1e-10;

/// In a sliver the normal is shorter than this share of the product of two sides.
const SLIVER: f64 = 1e-2;

/// v1 . n of eq. 9: six times the volume of the tetrahedron that the triangle forms with the
/// camera. None if it is 0, so that no ray hits: the triangle has no area, or its plane contains
/// the camera.
pub fn triangle_volume(vertices: [DVec3; 3]) -> Option<f64> {
    triangle_side(vertices, DVec3::ZERO, 0.0)
}

/// As [`triangle_volume`], with `point` in place of the camera: the sign says on which side of the
/// triangle's plane it is. None also if the point is in the plane up to its own rounding, which is
/// `units` units of f64's epsilon.
pub fn triangle_side(vertices: [DVec3; 3], point: DVec3, units: f64) -> Option<f64> {
    side_of_plane(vertices, triangle_plane(vertices), point, units)
}

/// As [`triangle_side`], for a triangle whose normal `n`, from [`triangle_plane`], is known.
pub fn side_of_plane(vertices: [DVec3; 3], n: DVec3, point: DVec3, units: f64) -> Option<f64> {
    let [nearest, ..] = near_corner_first(vertices.map(|v| v - point));
    let volume = nearest.dot(n);
    let sides = |[v1, v2, v3]: [DVec3; 3]| (v1 - v2, v1 - v3);
    let (a, b) = sides(vertices);
    let size = a.abs().max_element() * b.abs().max_element();
    if units == 0.0 && volume.abs() > PLAIN * nearest.abs().element_sum() * size {
        return Some(volume);
    }
    let [v1, v2, v3] = short_sides_first(vertices);
    let (a, b) = sides([v1, v2, v3]);
    // If the sides are rounded, n is no more accurate than the products that cancel in it.
    let exact = (v1 - a, v1 - b) == (v2, v3) && (v2 + a, v3 + b) == (v1, v1);
    let n = if exact { kahans_normal(a, b) } else { n };
    let (a, b, volume) = (a.abs(), b.abs(), nearest.dot(n));
    let size = if exact { n.abs() } else { a.yzx() * b.zxy() + a.zxy() * b.yzx() };
    // A volume that differs from 0 by no more than rounding counts as 0.
    let rounded = 4.0 * nearest.abs() + units * point.abs();
    (volume.abs() > f64::EPSILON * rounded.dot(size)).then_some(volume)
}

/// The plane p . x = 1 of a triangle.
pub struct PlaneOfOne {
    pub p: DVec3,
    /// A bound on the error of each component of p, for a normal whose components are differences
    /// of rounded products.
    pub lost: f64,
}

/// The plane p . x = 1 of a triangle; None if the [volume](triangle_volume) is 0.
#[inline]
pub fn plane_of_one(vertices: [DVec3; 3]) -> Option<PlaneOfOne> {
    let [v1, v2, v3] = short_sides_first(vertices);
    let (a, b) = (v1 - v2, v1 - v3);
    let (mut n, size) = (a.cross(b), a.abs().max_element() * b.abs().max_element());
    let mut volume = v1.dot(n);
    let distance = v1.abs().element_sum();
    // Nearly all triangles need no more care than this, and every visible one comes here.
    if n.abs().max_element() <= SLIVER * size || volume.abs() <= PLAIN * distance * size {
        n = triangle_plane(vertices);
        volume = side_of_plane(vertices, n, DVec3::ZERO, 0.0)?;
    }
    let p = n / volume;
    // n has an error of 2 epsilon times the size. v . n has three times that, with terms that may
    // be eight times as large (BETTER_CORNER).
    let lost = 512.0 * f64::EPSILON * size / volume.abs() * distance * p.abs().max_element();
    Some(PlaneOfOne { p, lost })
}

/// The normal of a triangle's plane, eq. 6. Its length is not 1; it is 0 if the triangle has no
/// area.
pub fn triangle_plane(vertices: [DVec3; 3]) -> DVec3 {
    let [v1, v2, v3] = short_sides_first(vertices);
    let (a, b) = (v1 - v2, v1 - v3);
    let n = a.cross(b);
    if n.abs().max_element() > SLIVER * a.abs().max_element() * b.abs().max_element() {
        return n;
    }
    // In a sliver the products cancel.
    kahans_normal(a, b)
}

/// a x b by Kahan's difference of products, which takes account of the rounding error of each
/// product.
fn kahans_normal(a: DVec3, b: DVec3) -> DVec3 {
    let difference = |a: f64, b: f64, c: f64, d: f64| {
        let cd = c * d;
        a.mul_add(b, -cd) - c.mul_add(d, -cd)
    };
    DVec3::new(difference(a.y, b.z, b.y, a.z), difference(a.z, b.x, b.z, a.x), difference(a.x, b.y, b.x, a.y))
}

/// Whether the corners of a triangle are on one line, or at one point, up to the rounding of the
/// corners.
pub fn has_no_area([v1, v2, v3]: [DVec3; 3]) -> bool {
    // A corner that moves changes the normal by the length of the opposite side times the movement.
    let size = |v: DVec3| v.abs().max_element();
    let moved = [(v1, v2 - v3), (v2, v3 - v1), (v3, v1 - v2)].map(|(corner, side)| size(corner) * size(side));
    let normal = size(triangle_plane([v1, v2, v3]));
    normal.is_nan() || normal <= 4.0 * f64::EPSILON * moved.into_iter().fold(0.0, f64::max)
}

/// L . N of eq. 11 for the side that the unit normal `n` points to: from 0 to 1, and 0 for a light
/// that is on the surface.
pub fn lambert(light: DVec3, p: DVec3, n: DVec3) -> f64 {
    (light - p).try_normalize().map_or(0.0, |l| l.dot(n).max(0.0))
}

/// L . N of eq. 11 for a two-sided surface.
pub fn lambert_two_sided(light: DVec3, p: DVec3, n: DVec3) -> f64 {
    (light - p).try_normalize().map_or(0.0, |l| l.dot(n).abs())
}

/// Whether a sphere hides a light from the point `p` of another object: whether it meets the
/// segment between the two, from outside or from inside, the ends of the segment excepted. A sphere
/// that touches the segment hides the light.
///
/// The equation is that of [`sphere`] with the light in place of the camera. How many roots are
/// between 0 and 1 follows from the signs at the ends of the segment, and from where the middle of
/// the chord is. The computation is relative to the nearer end, so that a far other end costs no
/// digits. p is rounded, with this `epsilon`, while the light is exact.
pub fn sphere_hides(light: DVec3, p: DVec3, centre: DVec3, radius: f64, epsilon: f64) -> bool {
    let (to_light, from_p, from_light) = (light - p, centre - p, centre - light);
    let (before_p, before_light) = (to_light.dot(from_p) > 0.0, to_light.dot(from_light) < 0.0);
    let (of_light, of_p) = (power(from_light, radius), power_of(p, centre, radius));
    // A line to a light inside of the sphere meets the sphere, whatever rounding may say.
    if of_light >= 0.0 && discriminant(to_light, shorter(from_p, from_light), radius) < 0.0 {
        return false;
    }
    let rounding = 32.0 * epsilon * radius * p.abs().element_sum();
    if of_light > 0.0 {
        let p_is_inside = of_p < -rounding;
        before_light && (before_p || p_is_inside)
    } else {
        // A light on the sphere is hidden from points that the sphere's wall is in front of.
        of_p > rounding && (of_light < 0.0 || before_light)
    }
}

fn shorter(a: DVec3, b: DVec3) -> DVec3 {
    if b.length_squared() < a.length_squared() { b } else { a }
}

/// [`power`] relative to the point `p`. For a point near a large sphere |c - p|^2 would lose digits
/// that |c|^2 - r^2 keeps.
fn power_of(p: DVec3, centre: DVec3, radius: f64) -> f64 {
    if p.dot(p) < radius * radius { p.dot(p - 2.0 * centre) + power(centre, radius) } else { power(centre - p, radius) }
}

/// Whether a triangle hides a light from the point `p` of another object, which is rounded with
/// this `epsilon`: whether the two are strictly on different sides of its plane, and the line
/// between them meets the triangle, whose edges and vertices count.
pub fn triangle_hides(light: DVec3, p: DVec3, vertices: [DVec3; 3], epsilon: f64) -> bool {
    let [v1, v2, v3] = vertices;
    // In eq. 10, v x w is the cross product of a point of the edge's line with the edge. No digits
    // are lost if that point is the edge's middle, or an end that is a thousand times nearer,
    // relative to p or the light, whichever is nearer.
    let to_light = light - p;
    let point = |v: DVec3, w: DVec3| {
        let (middle, end) = (0.5 * (v + w), shorter(v, w));
        if 1e6 * end.length_squared() < middle.length_squared() { end } else { middle }
    };
    let volume = |v: DVec3, w: DVec3| {
        let point = shorter(point(v - p, w - p), point(v - light, w - light));
        to_light.dot(point.cross(w - v))
    };
    let first = volume(v1, v2);
    // The line meets neither side of most triangles, which is cheaper to find out than where its
    // ends are.
    [1.0, -1.0].into_iter().any(|side| {
        (first * side >= 0.0 && volume(v2, v3) * side >= 0.0 && volume(v3, v1) * side >= 0.0)
            && triangle_side(vertices, p, 8.0 * epsilon / f64::EPSILON).is_some_and(|of_p| of_p.signum() == side)
            && triangle_side(vertices, light, 0.0).is_some_and(|of_light| of_light.signum() != side)
    })
}

/// Whether a triangle faces away from a light: whether the light and the camera are strictly on
/// different sides of its plane.
pub fn triangle_is_turned_away(light: DVec3, vertices: [DVec3; 3]) -> bool {
    let sides = triangle_side(vertices, light, 0.0).zip(triangle_volume(vertices));
    sides.is_some_and(|(of_light, of_camera)| of_light.signum() != of_camera.signum())
}
