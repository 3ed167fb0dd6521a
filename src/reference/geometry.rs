//! Ray against sphere, ray against triangle, shadow, and the Lambert term, in f64 and readable: the truth.
//!
//! A ray is its direction `d`, of any length but 0: it starts at the origin, and its points are `t d` for t > 0.

use glam::DVec3;

/// The smallest t > 0 at which the ray is on the sphere, eq. 5.
///
/// The roots of a t^2 - 2 h t + k, one as k/q and the other as q/a, so that neither cancels. From far away h^2 - a k
/// would cancel too; there a r^2 - |c x d|^2 is the same number.
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

/// h^2 - a k of [`sphere`]: its sign says whether the line along `d` meets the sphere, and it is 0 where it touches.
fn discriminant(d: DVec3, centre: DVec3, radius: f64) -> f64 {
    let (a, h, r2) = (d.dot(d), d.dot(centre), radius * radius);
    if centre.dot(centre) < 2.0 * r2 {
        h * h - a * power(centre, radius)
    } else {
        a * r2 - centre.cross(d).length_squared()
    }
}

/// |c|^2 - r^2, the power of the camera: its sign says whether the camera is outside, on or inside the sphere, and is
/// right for numbers of f32, however much cancels.
pub fn power(centre: DVec3, radius: f64) -> f64 {
    // The squares of 24 bits are exact. Their sum is kept as parts that do not overlap, the largest last: Shewchuk's
    // expansions.
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

/// a + b as its rounded value and the rounding error: Knuth's, for any a and b.
fn two_sum(a: f64, b: f64) -> (f64, f64) {
    let sum = a + b;
    let from_b = sum - a;
    (sum, (a - (sum - from_b)) + (b - from_b))
}

/// The unit normal of a sphere at its point `p`, outward.
pub fn sphere_normal(p: DVec3, centre: DVec3) -> DVec3 {
    (p - centre).normalize()
}

/// The t > 0 at which the ray meets the triangle, its edges and vertices included: eq. 9 and eq. 10.
///
/// Eq. 10 asks on which side of each edge P = t d lies. With the ray from the origin that is the sign of d . (v x w)
/// for the edge from v to w, compared with the sign of the triangle's own volume v1 . n, where n is that of eq. 6. In
/// f64 v x w is exactly -(w x v), so two triangles that share an edge never both miss a ray.
pub fn triangle(d: DVec3, vertices: [DVec3; 3]) -> Option<f64> {
    let volume = triangle_volume(vertices)?;
    let inside = is_inside(d, vertices, volume);
    let t = volume / d.dot(triangle_plane(vertices));
    (inside && t > 0.0 && t.is_finite()).then_some(t)
}

/// Eq. 10 for a triangle of this volume, or of one of this sign.
fn is_inside(d: DVec3, [v1, v2, v3]: [DVec3; 3], volume: f64) -> bool {
    [(v1, v2), (v2, v3), (v3, v1)].iter().all(|(v, w)| d.dot(v.cross(*w)) * volume.signum() >= 0.0)
}

/// A corner is near if it is nearer than this share of the farthest one's distance.
pub const NEAR_CORNER: f64 = 1.0 / (1 << 20) as f64;

/// Rotated so that the nearest corner comes first: its product with the normal is the triangle's volume like any
/// other's, but the terms of a farther one would cancel.
pub fn near_corner_first(corners: [DVec3; 3]) -> [DVec3; 3] {
    let [v1, v2, v3] = corners;
    match nearest_corner(corners, 1.0) {
        0 => corners,
        1 => [v2, v3, v1],
        _ => [v3, v1, v2],
    }
}

/// The index of a [near](NEAR_CORNER) corner, or else 0.
pub fn near_corner(corners: [DVec3; 3]) -> usize {
    nearest_corner(corners, NEAR_CORNER)
}

/// The index of the nearest corner, if it is within a share of the farthest one's distance, or else 0.
fn nearest_corner(corners: [DVec3; 3], share: f64) -> usize {
    let [one, two, three] = corners.map(|v| v.abs().max_element());
    let near = share * one.max(two).max(three);
    if two < near && two < one && two <= three {
        1
    } else if three < near && three < one && three < two {
        2
    } else {
        0
    }
}

/// From this share of the product of its terms on no rounding makes a volume of 0.
const PLAIN: f64 = 1e-10;

/// The normal of a sliver is shorter than this share of the product of two sides.
const SLIVER: f64 = 1e-2;

/// v1 . n of eq. 9, six times the volume that a triangle spans with the camera; None if it is 0, so that no ray hits:
/// the triangle has no area, or its plane passes through the camera.
pub fn triangle_volume(vertices: [DVec3; 3]) -> Option<f64> {
    triangle_side(vertices, DVec3::ZERO, 0.0)
}

/// The same with another point in the camera's place: its sign says on which side of the triangle's plane that is. None also if
/// it is there but for its own rounding, of so many units of f64's epsilon.
pub fn triangle_side(vertices: [DVec3; 3], point: DVec3, units: f64) -> Option<f64> {
    side_of_plane(vertices, triangle_plane(vertices), point, units)
}

/// The same for one whose [plane](triangle_plane) is known.
pub fn side_of_plane(vertices: [DVec3; 3], n: DVec3, point: DVec3, units: f64) -> Option<f64> {
    let [nearest, ..] = near_corner_first(vertices.map(|v| v - point));
    let volume = nearest.dot(n);
    let sides = |[v1, v2, v3]: [DVec3; 3]| (v1 - v2, v1 - v3);
    let size = |(a, b): (DVec3, DVec3)| a.abs().max_element() * b.abs().max_element();
    if units == 0.0 && volume.abs() > PLAIN * nearest.abs().element_sum() * size(sides(vertices)) {
        return Some(volume);
    }
    let [v1, v2, v3] = near_corner_first(vertices);
    let (a, b) = sides([v1, v2, v3]);
    // If its sides are rounded, n has no more digits than the products that cancel in it.
    let exact = (v1 - a, v1 - b) == (v2, v3) && (v2 + a, v3 + b) == (v1, v1);
    let size = if exact { n } else { DVec3::splat(size((a, b))) };
    // A volume that is 0 except for rounding is 0.
    let rounded = 4.0 * nearest.abs() + units * point.abs();
    (volume.abs() > f64::EPSILON * rounded.dot(size.abs())).then_some(volume)
}

/// The vector p of the plane p . x = 1 of a triangle; None if the [volume](triangle_volume) is 0.
#[inline]
pub fn plane_of_one(vertices: [DVec3; 3]) -> Option<DVec3> {
    let [v1, v2, v3] = near_corner_first(vertices);
    let (a, b) = (v1 - v2, v1 - v3);
    let (n, size) = (a.cross(b), a.abs().max_element() * b.abs().max_element());
    let volume = v1.dot(n);
    // Nearly all are plain, and this is asked for every visible one.
    if n.abs().max_element() > SLIVER * size && volume.abs() > PLAIN * v1.abs().element_sum() * size {
        return Some(n / volume);
    }
    let n = triangle_plane(vertices);
    Some(n / side_of_plane(vertices, n, DVec3::ZERO, 0.0)?)
}

/// The normal of a triangle's plane, eq. 6; not of length 1, and 0 if the triangle has no area.
pub fn triangle_plane(vertices: [DVec3; 3]) -> DVec3 {
    let [v1, v2, v3] = near_corner_first(vertices);
    let (a, b) = (v1 - v2, v1 - v3);
    let n = a.cross(b);
    if n.abs().max_element() > SLIVER * a.abs().max_element() * b.abs().max_element() {
        return n;
    }
    // In a sliver the products cancel: Kahan's difference of products keeps the rounding error of each.
    let difference = |a: f64, b: f64, c: f64, d: f64| {
        let cd = c * d;
        a.mul_add(b, -cd) - c.mul_add(d, -cd)
    };
    DVec3::new(difference(a.y, b.z, b.y, a.z), difference(a.z, b.x, b.z, a.x), difference(a.x, b.y, b.x, a.y))
}

/// Whether the corners of a triangle are on one line, or one point: its normal is 0 except for the rounding of corners.
pub fn has_no_area([v1, v2, v3]: [DVec3; 3]) -> bool {
    let longest = (v1 - v2).abs().max((v1 - v3).abs()).max_element();
    let furthest = v1.abs().max(v2.abs()).max(v3.abs()).max_element();
    let size = triangle_plane([v1, v2, v3]).abs().max_element();
    size.is_nan() || size <= 4.0 * f64::EPSILON * longest * furthest
}

/// L . N of eq. 11 for the side that the unit normal `n` points to: from 0 to 1, and 0 for a light on the surface.
pub fn lambert(light: DVec3, p: DVec3, n: DVec3) -> f64 {
    (light - p).try_normalize().map_or(0.0, |l| l.dot(n).max(0.0))
}

/// L . N of eq. 11 for a two-sided surface.
pub fn lambert_two_sided(light: DVec3, p: DVec3, n: DVec3) -> f64 {
    (light - p).try_normalize().map_or(0.0, |l| l.dot(n).abs())
}

/// Whether a sphere hides a light from the point `p` of another object: whether it meets the segment between them, from outside
/// or inside, its ends excepted. What the segment touches hides.
///
/// The roots of [`sphere`], asked for a light in the camera's place: how many are between 0 and 1 follows from the signs at the
/// ends, and from where the middle of the chord is. Seen from the nearer end, the other one at any distance costs no digits. p is
/// rounded, with this `epsilon`, but the light is where it is.
pub fn sphere_hides(light: DVec3, p: DVec3, centre: DVec3, radius: f64, epsilon: f64) -> bool {
    let (to_light, from_p, from_light) = (light - p, centre - p, centre - light);
    let (before_p, before_light) = (to_light.dot(from_p) > 0.0, to_light.dot(from_light) < 0.0);
    let (of_light, of_p) = (power(from_light, radius), power_of(p, centre, radius));
    // The line to a light inside meets it, whatever rounding makes of it.
    if of_light >= 0.0 && discriminant(to_light, shorter(from_p, from_light), radius) < 0.0 {
        return false;
    }
    let rounding = 32.0 * epsilon * radius * p.abs().element_sum();
    if of_light > 0.0 {
        let p_is_inside = of_p < -rounding;
        before_light && (before_p || p_is_inside)
    } else {
        // A light on the sphere is behind it for whatever its wall is in front of.
        of_p > rounding && (of_light < 0.0 || before_light)
    }
}

fn shorter(a: DVec3, b: DVec3) -> DVec3 {
    if b.length_squared() < a.length_squared() { b } else { a }
}

/// [`power`] of a point: for one near to a large sphere |c - p|^2 would lose what |c|^2 - r^2 keeps.
fn power_of(p: DVec3, centre: DVec3, radius: f64) -> f64 {
    if p.dot(p) < radius * radius { p.dot(p - 2.0 * centre) + power(centre, radius) } else { power(centre - p, radius) }
}

/// Whether a triangle hides a light from the point `p` of another object, which is rounded with this `epsilon`: whether they are
/// strictly on different sides of its plane, and the line between them meets it. Its edges and vertices hide.
pub fn triangle_hides(light: DVec3, p: DVec3, vertices: [DVec3; 3], epsilon: f64) -> bool {
    let [v1, v2, v3] = vertices;
    // v x w of eq. 10 is twice the edge's middle times the edge, which loses no digits seen from the nearer end.
    let to_light = light - p;
    let middle = |v: DVec3, w: DVec3| shorter((v - p) + (w - p), (v - light) + (w - light));
    let volume = |v: DVec3, w: DVec3| to_light.dot(middle(v, w).cross(w - v));
    let first = volume(v1, v2);
    // Of most triangles the line meets neither side, which costs less to know than where its ends are.
    [1.0, -1.0].into_iter().any(|side| {
        (first * side >= 0.0 && volume(v2, v3) * side >= 0.0 && volume(v3, v1) * side >= 0.0)
            && triangle_side(vertices, p, 8.0 * epsilon / f64::EPSILON).is_some_and(|of_p| of_p.signum() == side)
            && triangle_side(vertices, light, 0.0).is_some_and(|of_light| of_light.signum() != side)
    })
}

/// Whether a triangle turns its back to a light: whether that and the camera are strictly on different sides of its plane.
pub fn triangle_is_turned_away(light: DVec3, vertices: [DVec3; 3]) -> bool {
    let sides = triangle_side(vertices, light, 0.0).zip(triangle_volume(vertices));
    sides.is_some_and(|(of_light, of_camera)| of_light.signum() != of_camera.signum())
}

#[cfg(test)]
mod tests {
    use super::*;

    const Z: DVec3 = DVec3::Z;
    const E: f64 = f64::EPSILON;

    #[test]
    fn a_sphere_that_the_ray_touches_is_hit_and_one_that_the_camera_is_on_at_its_far_wall_if_at_all() {
        assert_eq!(sphere(Z, DVec3::new(3.0, 0.0, 10.0), 3.0), Some(10.0));
        assert_eq!(sphere(Z, 3.0 * Z, 3.0), Some(6.0));
        assert_eq!(sphere(Z, -3.0 * Z, 3.0), None);
    }

    fn corner(x: f64, y: f64, z: f64) -> DVec3 {
        DVec3::new(x, y, z)
    }

    #[test]
    fn a_triangle_that_begins_next_to_the_camera_has_its_volume_from_there() {
        // Exactly representable: a corner below the camera, and two farther ones.
        for tiny in [-60, -19, -3].map(|exponent| 2f64.powi(exponent)) {
            let (near, one, other) = (corner(0.0, -tiny, 0.0), corner(-3.0, -0.375, 5.0), corner(2.0, -0.625, 7.0));
            let expected = near.dot((near - one).cross(near - other));
            for vertices in [[near, one, other], [other, near, one], [one, other, near]] {
                assert_eq!(triangle_volume(vertices), Some(expected), "{vertices:?}");
            }
            assert_eq!(triangle_volume([near, other, one]), Some(-expected));
        }
    }

    #[test]
    fn corners_on_one_line_are_told_from_a_plane_through_the_camera() {
        let (a, b) = (corner(0.5, 0.75, 3.0), corner(1.25, -0.25, 0.375));
        for (corners, none) in [
            ([a, a, a], true),
            ([a, b, a], true),
            ([a, a + b, a + 4.0 * b], true),
            ([a, a + 0.125 * b, a + 0.375 * b], true),
            ([a, b, -a], false),
            ([a, b, DVec3::ZERO], false),
            ([a, b, corner(0.5, 0.75, 3.000_001)], false),
        ] {
            assert_eq!(has_no_area(corners), none, "{corners:?}");
        }
    }

    fn in_each_order([a, b, c]: [DVec3; 3]) -> [[DVec3; 3]; 4] {
        [[a, b, c], [b, c, a], [c, b, a], [a, c, b]]
    }

    #[test]
    fn a_sphere_hides_what_is_behind_one_of_its_walls_and_what_touches_it() {
        let (light, p) = (corner(0.0, 8.0, 4.0), corner(0.0, 0.0, 4.0));
        for (centre, radius, hides, what) in [
            ((0.0, 4.0, 4.0), 1.0, true, "between"),
            ((1.0, 2.0, 4.0), 1.0, true, "touched"),
            ((1.5, 2.0, 4.0), 1.0, false, "beside"),
            ((1.0, 0.0, 4.0), 1.0, false, "touched at the point"),
            ((1.0, 8.0, 4.0), 1.0, false, "touched at the light"),
            ((0.0, -2.0, 4.0), 1.0, false, "behind the point"),
            ((0.0, 10.0, 4.0), 1.0, false, "behind the light"),
            ((0.0, 8.5, 4.0), 1.0, true, "around the light"),
            ((0.0, 0.5, 4.0), 1.0, true, "around the point"),
            ((0.0, 4.0, 4.0), 9.0, false, "around both"),
            ((0.0, -1.0, 4.0), 1.0, false, "the point on it, outside"),
            ((0.0, 1.0, 4.0), 1.0, true, "the point on its far wall"),
            ((0.0, 9.0, 4.0), 1.0, false, "the light on it, outside"),
            ((0.0, 7.0, 4.0), 1.0, true, "the light on its far wall"),
            ((0.0, 4.0, 4.0), 4.0, false, "both on it"),
            ((0.0, 5.0, 4.0), 5.0, false, "the point on it, the light inside"),
            ((0.0, 3.0, 4.0), 5.0, false, "the light on it, the point inside"),
        ] {
            let (x, y, z) = centre;
            assert_eq!(sphere_hides(light, p, corner(x, y, z), radius, E), hides, "{what}");
        }
        assert!(
            !sphere_hides(p, p, corner(1.0, 0.0, 4.0), 1.0, E) && !sphere_hides(p, p, corner(9.0, 0.0, 4.0), 1.0, E)
        );
    }

    #[test]
    fn what_is_small_and_near_a_light_hides_it_from_what_is_far_away() {
        let (light, side) = (corner(0.5, 8.0, 4.0), corner(3.0, -4.0, 0.0));
        for far in [1e3, 1e10, 1e20, 1e30] {
            let p = light + far * side;
            for (beside, hides) in [(0.0, true), (1.2, false)] {
                let centre = light + 2.0 * side + beside * corner(0.8, 0.6, 0.0);
                let vertices = [Z, corner(0.8, 0.6, -1.0), corner(-0.8, -0.6, -1.0)].map(|v| centre + v);
                assert_eq!(sphere_hides(light, p, centre, 1.0, E), hides, "{far}");
                assert_eq!(triangle_hides(light, p, vertices, E), hides, "{far}");
            }
        }
    }

    #[test]
    fn a_triangle_hides_from_both_sides_with_its_edges_and_corners_but_not_what_is_in_its_plane() {
        let (light, p) = (corner(0.0, 8.0, 4.0), corner(0.0, 0.0, 4.0));
        // The segment goes through (0, 4, 4), to the right of this corner by x and in front of it by z.
        let at = |x: f64, y: f64, z: f64| [corner(-x, y, 4.0 - z), corner(4.0 - x, y, 4.0 - z), corner(-x, y, 8.0 - z)];
        for (vertices, hides, what) in [
            (at(1.0, 4.0, 1.0), true, "between"),
            (at(0.0, 4.0, 0.0), true, "a corner between"),
            (at(2.0, 4.0, 2.0), true, "an edge between"),
            (at(2.1, 4.0, 2.0), false, "beside"),
            (at(1.0, -1.0, 1.0), false, "behind the point"),
            (at(1.0, 9.0, 1.0), false, "behind the light"),
            (at(1.0, 0.0, 1.0), false, "the point in it"),
            (at(1.0, 8.0, 1.0), false, "the light in it"),
            (at(0.0, 8.0, 0.0), false, "the light at its corner"),
            ([corner(0.0, 1.0, 3.0), corner(0.0, 2.0, 9.0), corner(0.0, 7.0, 3.0)], false, "both in its plane"),
            ([corner(0.0, 4.0, 3.0), corner(0.0, 4.0, 4.0), corner(0.0, 4.0, 6.0)], false, "of no area"),
        ] {
            for vertices in in_each_order(vertices) {
                assert_eq!(triangle_hides(light, p, vertices, E), hides, "{what}");
                assert_eq!(triangle_hides(p, light, vertices, E), hides, "{what}, from the light");
            }
            assert!(!triangle_hides(p, p, vertices, E), "{what}");
        }
    }

    #[test]
    fn an_object_hides_a_light_where_a_ray_from_the_light_meets_it_before_the_point() {
        let mut state = 1_u64;
        let mut number = |size: f64| {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            f64::from((size * ((state >> 33) as f64 / f64::from(1_u32 << 30) - 1.0)) as f32)
        };
        let (mut hidden, mut asked) = ([0; 2], 0);
        for _ in 0..100_000 {
            let mut point = || corner(number(4.0), number(4.0), number(4.0));
            let (light, p, vertices) = (point(), point(), [point(), point(), point()]);
            let radius = number(3.0).abs();
            let by = [
                (sphere(p - light, vertices[0] - light, radius), sphere_hides(light, p, vertices[0], radius, E)),
                (triangle(p - light, vertices.map(|v| v - light)), triangle_hides(light, p, vertices, E)),
            ];
            for (i, (met, hides)) in by.into_iter().enumerate() {
                if met.is_some_and(|t| (t - 1.0).abs() < 1e-9) {
                    continue;
                }
                assert_eq!(met.is_some_and(|t| t < 1.0), hides, "{light} {p} {vertices:?} {radius}");
                hidden[i] += u32::from(hides);
                asked += 1;
            }
        }
        assert!(hidden.iter().all(|hidden| *hidden > 3_000) && asked > 199_000, "{hidden:?} of {asked}");
    }

    #[test]
    fn a_light_at_any_distance_and_above_a_ground_of_any_size_is_where_it_is() {
        let (block, tent) = (corner(1.0, 2.0, 5.0), [(-1.0, 1.0), (3.0, -1.0), (-1.0, -1.0)]);
        let tent = tent.map(|(x, z)| corner(x, 2.0, 5.0 + z));
        for distance in [1e2, 1e5, 1e10, 1e20, 1e30, 3e38] {
            for (p, hides) in [(corner(1.0, 0.0, 5.0), true), (corner(3.0, 0.0, 5.0), false)] {
                let light = corner(0.0, distance, 0.0);
                assert_eq!(sphere_hides(light, p, block, 0.5, E), hides, "{distance}");
                assert_eq!(triangle_hides(light, p, tent, E), hides, "{distance}");
            }
        }
        // What is next to a light hides it from a cone.
        let light = corner(1.0, 2.0, 3.0);
        let beside = |x: f64, z: f64| corner(0.25 + x, 1.0, z - 0.125);
        let caster = [(-1.0, 1.0), (3.0, -1.0), (-1.0, -1.0)].map(|(x, z)| light + beside(x, z));
        for distance in [2.0, 1e5, 1e8, 1e10, 1e13] {
            for (x, z) in [(0.0, 0.0), (-0.9, -0.9), (2.7, -0.9), (1.1, 0.0), (0.0, -1.1), (-1.1, 0.0)] {
                let hides = x > -1.0 && z > -1.0 && x + 2.0 * z < 1.0;
                assert_eq!(
                    triangle_hides(light, light + distance * beside(x, z), caster, E),
                    hides,
                    "{distance} {x} {z}"
                );
            }
        }
        for radius in [1e2, 1e4, 1e6, 1e7] {
            let ground = corner(0.0, -radius, 5.0);
            for height in [1e-3, 0.7, 3.0].map(|height: f64| f64::from(height as f32)) {
                let p = corner(0.1, height, 5.0);
                assert!(!sphere_hides(corner(3.0, 0.1, 4.0), p, ground, radius, E), "{radius} {height}");
                assert!(sphere_hides(corner(3.0, -0.5, 4.0), p, ground, radius, E), "{radius} {height}");
                assert!(sphere_hides(corner(0.3, -3.0 * radius, 4.0), p, ground, radius, E), "{radius} {height}");
            }
        }
    }

    #[test]
    fn a_triangle_turns_its_back_to_a_light_behind_its_plane() {
        let wall = [corner(-1.0, -1.0, 4.0), corner(1.0, -1.0, 4.0), corner(0.0, 1.0, 4.0)];
        for vertices in in_each_order(wall) {
            for (z, away) in [(5.0, true), (4.0, false), (3.0, false), (-9.0, false), (1e30, true)] {
                assert_eq!(triangle_is_turned_away(corner(7.0, 0.0, z), vertices), away, "{z}");
            }
        }
    }
}
