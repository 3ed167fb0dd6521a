//! The records of spheres and triangles for the packet operations, whose rays leave the origin in any direction.
//!
//! Everything is computed in f64 and rounded once, so that no operand of the kernels has lost digits by cancellation.

use glam::DVec3;

use crate::kernels::{Element, SphereHit, TriangleHit};
use crate::reference::geometry;

/// A record in a unit of length of the object's own, so that no product leaves the range of an f32 or an f64.
#[derive(Clone, Copy, Debug)]
pub struct InUnits<R> {
    /// The operand of the operation.
    pub record: R,
    /// The unit, a power of two: t is that many times the operation's result.
    pub unit: f64,
}

/// The power of two next to the largest of some lengths; 1 if there is none.
fn unit(largest: f64) -> f64 {
    if largest.is_normal() { f64::from_bits(largest.to_bits() & f64::INFINITY.to_bits()) } else { 1.0 }
}

/// The record of a sphere. One with a number that is not finite is never hit.
pub fn sphere_hit<E: Element>(centre: [f64; 3], radius: f64) -> InUnits<SphereHit<E>> {
    let unit = unit(DVec3::from(centre).abs().max_element().max(radius));
    let (c, r) = (DVec3::from(centre) / unit, radius / unit);
    let record = SphereHit { cx: c.x, cy: c.y, cz: c.z, square: r * r, k: geometry::power(c, r) };
    InUnits { record: record.round(), unit }
}

/// The record of a triangle, for rays whose components are at most `reach`.
///
/// Terms that depend on its size are scaled to the order of 1. A triangle of no area and one whose plane passes through
/// the origin are never hit.
pub fn triangle_hit<E: Element>(vertices: [[f64; 3]; 3], reach: [f64; 3]) -> InUnits<TriangleHit<E>> {
    let vertices = vertices.map(DVec3::from);
    let unit = unit(vertices.map(|v| v.abs().max_element()).into_iter().fold(0.0, f64::max));
    InUnits { record: in_its_unit(vertices.map(|v| v / unit), DVec3::from(reach)), unit }
}

fn in_its_unit<E: Element>([v1, v2, v3]: [DVec3; 3], reach: DVec3) -> TriangleHit<E> {
    // A NaN is no volume either.
    let Some(volume) = geometry::triangle_volume([v1, v2, v3]) else { return TriangleHit::<f64>::default().round() };
    let facing = volume.signum();
    let n = facing * geometry::triangle_plane([v1, v2, v3]);
    let (k, scale) = (facing * volume, n.abs().max_element());
    // The plane through an edge, away from the triangle; and an error bound of three rounded products and their sum.
    let edge = |from: DVec3, to: DVec3| {
        let normal = facing * to.cross(from);
        let normal = normal / normal.abs().max_element();
        let bound = ROUNDINGS * E::EPSILON / 2.0 * reach.dot(normal.abs());
        // A value has to be below it.
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

/// The error of a normal with three products and two sums: 4 and some units in the last place of the largest term.
const ROUNDINGS: f64 = 4.5;
