//! The geometry of `reference`, on cases with known results.

use glam::DVec3;
use rayo::internals::reference::geometry::{
    has_no_area, sphere, sphere_hides, triangle, triangle_hides, triangle_is_turned_away, triangle_volume,
};

const Z: DVec3 = DVec3::Z;
const E: f64 = f64::EPSILON;

#[test]
fn touched_sphere_is_hit_and_one_around_at_its_far_wall() {
    assert_eq!(sphere(Z, DVec3::new(3.0, 0.0, 10.0), 3.0), Some(10.0));
    assert_eq!(sphere(Z, 3.0 * Z, 3.0), Some(6.0));
    assert_eq!(sphere(Z, -3.0 * Z, 3.0), None);
}

fn corner(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

#[test]
fn triangle_next_to_the_camera_has_its_volume_from_there() {
    // Exactly representable numbers: a corner just below the camera, and two farther ones.
    for tiny in [-60, -19, -3].map(|exponent| 2f64.powi(exponent)) {
        let (near, one, other) = (corner(0.0, -tiny, 0.0), corner(-3.0, -0.375, 5.0), corner(2.0, -0.625, 7.0));
        let expected = near.dot((near - one).cross(near - other));
        for vertices in [[near, one, other], [other, near, one], [one, other, near]] {
            assert_eq!(triangle_volume(vertices), Some(expected), "{vertices:?}");
        }
        assert_eq!(triangle_volume([near, other, one]), Some(-expected));
        // The same with two corners equally near.
        let (beside, far) = (corner(tiny, 0.0, 0.0), corner(-3.0, -0.375, 5.0));
        for vertices in [[near, beside, far], [far, near, beside], [beside, far, near]] {
            assert_eq!(triangle_volume(vertices), Some(5.0 * tiny * tiny), "{vertices:?}");
        }
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
        // A short side, and a corner very far away.
        ([a, b, corner(0.0, 1e38, 1e38)], false),
        ([1e-30 * a, 1e38 * b, a], false),
        ([a, b, a + 1e16 * (b - a)], true),
    ] {
        assert_eq!(has_no_area(corners), none, "{corners:?}");
    }
}

fn in_each_order([a, b, c]: [DVec3; 3]) -> [[DVec3; 3]; 4] {
    [[a, b, c], [b, c, a], [c, b, a], [a, c, b]]
}

#[test]
fn sphere_hides_what_is_behind_and_what_touches_it() {
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
    assert!(!sphere_hides(p, p, corner(1.0, 0.0, 4.0), 1.0, E) && !sphere_hides(p, p, corner(9.0, 0.0, 4.0), 1.0, E));
}

#[test]
fn triangle_hides_from_both_sides_but_not_in_its_plane() {
    let (light, p) = (corner(0.0, 8.0, 4.0), corner(0.0, 0.0, 4.0));
    // The segment passes through (0, 4, 4), which is `x` to the right and `z` in front of this
    // corner.
    let at = |x: f64, y: f64, z: f64| [corner(-x, y, 4.0 - z), corner(4.0 - x, y, 4.0 - z), corner(-x, y, 8.0 - z)];
    let far = |z, far: f64| [corner(-1.0, 4.0, z), corner(-1.0, 4.0, z + 4.0), far * corner(1.0, 0.25, 0.25)];
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
        (far(2.0, 1e10), true, "one that reaches far, between"),
        (far(2.0, 1e38), true, "one that reaches very far, between"),
        (far(3.8, 1e10), false, "one that reaches far, beside"),
        (far(3.8, 1e38), false, "one that reaches very far, beside"),
    ] {
        for vertices in in_each_order(vertices) {
            assert_eq!(triangle_hides(light, p, vertices, E), hides, "{what}");
            assert_eq!(triangle_hides(p, light, vertices, E), hides, "{what}, from the light");
        }
        assert!(!triangle_hides(p, p, vertices, E), "{what}");
    }
}

#[test]
fn object_hides_a_light_where_its_ray_meets_it_first() {
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
fn a_triangle_turns_its_back_to_a_light_behind_its_plane() {
    let wall = [corner(-1.0, -1.0, 4.0), corner(1.0, -1.0, 4.0), corner(0.0, 1.0, 4.0)];
    for vertices in in_each_order(wall) {
        for (z, away) in [(5.0, true), (4.0, false), (3.0, false), (-9.0, false), (1e30, true)] {
            assert_eq!(triangle_is_turned_away(corner(7.0, 0.0, z), vertices), away, "{z}");
        }
    }
}
