//! Spheres and triangles as the packet operations take them, for rays of any direction from the origin.
//!
//! Everything is computed in f64 and rounded once: what the kernels multiply has no cancellation behind it.

use glam::DVec3;

use crate::kernels::{Element, SphereHit, TriangleHit};
use crate::reference::geometry;

/// The record of a sphere.
pub fn sphere_hit<E: Element>(centre: [f32; 3], radius: f32) -> SphereHit<E> {
    let (c, r) = (DVec3::from(centre.map(f64::from)), f64::from(radius));
    SphereHit { cx: c.x, cy: c.y, cz: c.z, square: r * r, k: c.dot(c) - r * r }.round()
}

/// The record of a triangle, for rays whose components are at most `reach`.
///
/// What depends on its size is scaled to the order of 1, so that no product leaves the range of an f32. A triangle of no area
/// and one whose plane passes through the origin are never hit.
pub fn triangle_hit<E: Element>(vertices: [[f32; 3]; 3], reach: [f32; 3]) -> TriangleHit<E> {
    let [v1, v2, v3] = vertices.map(|v| DVec3::from(v.map(f64::from)));
    let reach = DVec3::from(reach.map(f64::from));
    // A NaN is no volume either.
    let Some(volume) = geometry::triangle_volume([v1, v2, v3]) else { return TriangleHit::<f64>::default().round() };
    let facing = volume.signum();
    let n = facing * geometry::triangle_plane([v1, v2, v3]);
    let (k, scale) = (facing * volume, n.abs().max_element());
    // The plane through an edge, away from the triangle; and what three rounded products and their sum may be off.
    let edge = |from: DVec3, to: DVec3| {
        let normal = facing * to.cross(from);
        let normal = normal / normal.abs().max_element();
        let bound = ROUNDINGS * E::EPSILON / 2.0 * reach.dot(normal.abs());
        // What is compared has to be below it.
        (normal, bound.max(f32::MIN_POSITIVE.into()))
    };
    let ((a, ea), (b, eb), (c, ec)) = (edge(v1, v2), edge(v2, v3), edge(v3, v1));
    let n = n / scale;
    #[rustfmt::skip]
    let record = TriangleHit {
        nx: n.x, ny: n.y, nz: n.z, k: k / scale,
        ax: a.x, ay: a.y, az: a.z, a: ea,
        bx: b.x, by: b.y, bz: b.z, b: eb,
        cx: c.x, cy: c.y, cz: c.z, c: ec,
    };
    record.round()
}

/// A normal's rounding, three products and two sums: 4 and some units in the last place of the largest term.
const ROUNDINGS: f64 = 4.5;
