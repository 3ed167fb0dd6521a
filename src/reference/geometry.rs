//! Ray against sphere, ray against triangle, and the Lambert term, in f64 and readable: the truth.
//!
//! A ray is its direction `d`, of any length but 0: it starts at the origin, and its points are `t d` for t > 0.

use glam::DVec3;

/// The smallest t > 0 at which the ray is on the sphere, eq. 5.
///
/// The roots of a t^2 - 2 h t + k, one as k/q and the other as q/a, so that neither cancels. From far away h^2 - a k
/// would cancel too; there a r^2 - |c x d|^2 is the same number.
pub fn sphere(d: DVec3, centre: DVec3, radius: f64) -> Option<f64> {
    let a = d.dot(d);
    let h = d.dot(centre);
    let r2 = radius * radius;
    let disc = if centre.dot(centre) < 2.0 * r2 {
        h * h - a * power(centre, radius)
    } else {
        a * r2 - centre.cross(d).length_squared()
    };
    if disc.is_nan() || disc < 0.0 {
        return None;
    }
    let k = power(centre, radius);
    let q = h + disc.sqrt().copysign(h);
    let hits = [k / q, q / a].into_iter().filter(|t| *t > 0.0);
    hits.min_by(f64::total_cmp).filter(|t| t.is_finite())
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
pub fn triangle(d: DVec3, [v1, v2, v3]: [DVec3; 3]) -> Option<f64> {
    let volume = triangle_volume([v1, v2, v3])?;
    let inside = [(v1, v2), (v2, v3), (v3, v1)].iter().all(|(v, w)| d.dot(v.cross(*w)) * volume.signum() >= 0.0);
    let t = volume / d.dot(triangle_plane([v1, v2, v3]));
    (inside && t > 0.0 && t.is_finite()).then_some(t)
}

/// A corner is near if it is nearer than this share of the farthest one's distance.
pub const NEAR_CORNER: f64 = 1.0 / (1 << 20) as f64;

/// Rotated so that the nearest corner comes first: its product with the normal is the triangle's volume like any
/// other's, but the terms of a farther one would cancel.
pub fn near_corner_first(mut corners: [DVec3; 3]) -> [DVec3; 3] {
    let nearest = nearest_corner(corners, 1.0);
    corners.rotate_left(nearest);
    corners
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

/// The normal of a sliver is shorter than this share of the product of two sides.
const SLIVER: f64 = 1e-2;

/// v1 . n of eq. 9, six times the volume that a triangle spans with the camera; None if it is 0, so that no ray hits:
/// the triangle has no area, or its plane passes through the camera.
pub fn triangle_volume(vertices: [DVec3; 3]) -> Option<f64> {
    let (n, [v1, v2, v3]) = (triangle_plane(vertices), near_corner_first(vertices));
    let volume = v1.dot(n);
    let (a, b) = (v1 - v2, v1 - v3);
    // If its sides are rounded, n has no more digits than the products that cancel in it.
    let exact = (v1 - a, v1 - b) == (v2, v3) && (v2 + a, v3 + b) == (v1, v1);
    let size = if exact { n } else { DVec3::splat(a.abs().max_element() * b.abs().max_element()) };
    // A volume that is 0 except for rounding is 0.
    (volume.abs() > 4.0 * f64::EPSILON * v1.abs().dot(size.abs())).then_some(volume)
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

#[cfg(test)]
mod tests {
    use super::*;

    const Z: DVec3 = DVec3::Z;

    #[test]
    fn a_sphere_ahead_is_hit_at_its_near_wall() {
        assert_eq!(sphere(Z, 10.0 * Z, 3.0), Some(7.0));
    }

    #[test]
    fn a_camera_inside_a_sphere_sees_its_far_wall() {
        assert_eq!(sphere(Z, DVec3::ZERO, 3.0), Some(3.0));
        assert_eq!(sphere(Z, Z, 3.0), Some(4.0));
        assert_eq!(sphere(Z, -Z, 3.0), Some(2.0));
    }

    #[test]
    fn a_sphere_behind_or_beside_the_camera_is_not_hit() {
        assert_eq!(sphere(Z, -10.0 * Z, 3.0), None);
        assert_eq!(sphere(Z, DVec3::new(4.0, 0.0, 10.0), 3.0), None);
    }

    #[test]
    fn a_sphere_that_the_ray_touches_is_hit() {
        assert_eq!(sphere(Z, DVec3::new(3.0, 0.0, 10.0), 3.0), Some(10.0));
    }

    #[test]
    fn a_camera_on_a_sphere_sees_the_far_wall_or_nothing() {
        assert_eq!(sphere(Z, 3.0 * Z, 3.0), Some(6.0));
        assert_eq!(sphere(Z, -3.0 * Z, 3.0), None);
    }

    fn corner(x: f64, y: f64, z: f64) -> DVec3 {
        DVec3::new(x, y, z)
    }

    #[test]
    fn edges_and_vertices_belong_to_a_triangle_in_either_order() {
        let [a, b, c] = [corner(0.0, 0.0, 4.0), corner(4.0, 0.0, 4.0), corner(0.0, 4.0, 4.0)];
        for v in [[a, b, c], [c, b, a], [b, c, a]] {
            for (x, y, hit) in
                [(1.0, 1.0, true), (0.0, 0.0, true), (2.0, 2.0, true), (0.0, 3.0, true), (2.1, 2.0, false)]
            {
                assert_eq!(triangle(corner(x, y, 4.0), v), hit.then_some(1.0), "{x} {y}");
            }
        }
    }

    #[test]
    fn a_triangle_of_no_area_behind_the_camera_or_seen_from_its_edge_is_not_hit() {
        let flat = [corner(-1.0, 0.0, 4.0), corner(0.0, 0.0, 4.0), corner(1.0, 0.0, 4.0)];
        assert_eq!(triangle(Z, flat), None);
        let behind = [corner(-1.0, -1.0, -4.0), corner(1.0, -1.0, -4.0), corner(0.0, 1.0, -4.0)];
        assert_eq!(triangle(Z, behind), None);
        let edge_on = [corner(0.1, -1.0, 3.0), corner(0.2, 2.0, 6.0), corner(0.1, 1.0, 3.0)];
        let through_camera = [edge_on[0], edge_on[1], -edge_on[0]];
        assert_eq!(triangle(edge_on[1], through_camera), None);
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

    #[test]
    fn a_light_on_the_surface_gives_nothing() {
        assert_eq!(lambert(Z, Z, Z), 0.0);
        assert_eq!(lambert_two_sided(Z, Z, Z), 0.0);
        assert_eq!(lambert(2.0 * Z, Z, Z), 1.0);
        assert_eq!(lambert(Z, 2.0 * Z, Z), 0.0);
        assert_eq!(lambert_two_sided(Z, 2.0 * Z, Z), 1.0);
    }
}
