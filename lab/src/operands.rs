//! The records of spheres and triangles for operations on packets, whose rays leave the origin in
//! any direction.
//!
//! Everything is computed in f64 and rounded once, so that no operand of the kernels has lost
//! digits by cancellation.

use glam::DVec3;
use glam::Vec3;

use rayo::internals::kernels::{Element, SphereHit, TriangleHit};
use rayo::internals::kernels::{LaneObjects, LaneTracer, ObjectLight};
use rayo::internals::plan::lights;
use rayo::internals::reference::geometry;
use rayo::internals::scene::{Light, Scene};

/// A record whose unit of length is chosen for the object, so that no product exceeds the range of
/// f32 or f64.
#[derive(Clone, Copy, Debug)]
pub struct InUnits<R> {
    /// The record that the operation takes.
    pub record: R,
    /// The unit, a power of two: t is the operation's result times the unit.
    pub unit: f64,
}

/// The objects of a scene for a tracer with a ray in each lane. The squares of their numbers must
/// be within the range of f32.
pub fn in_lanes(scene: &Scene, tracer: &LaneTracer) -> LaneObjects {
    let lights = lights(scene);
    let grid = scene.camera.grid();
    let reach = [grid.half_width, grid.half_height, grid.focal];
    let light = |position: DVec3, cosine, light: &Light, colour: Vec3| {
        let [x, y, z] = position.to_array();
        let [red, green, blue] = (light.radiance() * colour.as_dvec3()).to_array();
        ObjectLight { x, y, z, cosine, red, green, blue, padding: 0.0 }.round()
    };
    let mut objects = tracer.objects(lights.len());
    for sphere in &scene.spheres {
        let (centre, radius) = (sphere.centre.as_dvec3(), f64::from(sphere.radius));
        let InUnits { record: SphereHit { cx, cy, cz, square, k }, unit } = sphere_hit::<f64>(centre.into(), radius);
        let area = unit * unit;
        let record = SphereHit { cx: cx * unit, cy: cy * unit, cz: cz * unit, square: square * area, k: k * area };
        let lit = |of: &&Light| light((of.position.as_dvec3() - centre) / radius, 0.0, of, sphere.colour);
        let place = centre.extend(1.0 / radius).as_vec4().to_array();
        objects.sphere(&record.round(), place, &lights.iter().map(lit).collect::<Vec<_>>());
    }
    for triangle in scene.all_triangles() {
        let vertices = triangle.vertices.map(|v| v.as_dvec3());
        let InUnits { record, unit } = triangle_hit::<f32>(vertices.map(DVec3::into), reach);
        let normal = geometry::triangle_plane(vertices).normalize_or_zero();
        let lit = |of: &&Light| {
            let position = of.position.as_dvec3();
            light(position, normal.dot(position - vertices[0]).abs(), of, triangle.colour)
        };
        let record = TriangleHit { k: record.k * unit as f32, ..record };
        objects.triangle(&record, &lights.iter().map(lit).collect::<Vec<_>>());
    }
    objects
}

/// The power of two next below the largest of some lengths; 1 if that is 0 or not normal.
fn unit(largest: f64) -> f64 {
    if largest.is_normal() { f64::from_bits(largest.to_bits() & f64::INFINITY.to_bits()) } else { 1.0 }
}

/// The record of a sphere, which is never hit if a number is not finite.
pub fn sphere_hit<E: Element>(centre: [f64; 3], radius: f64) -> InUnits<SphereHit<E>> {
    let unit = unit(DVec3::from(centre).abs().max_element().max(radius));
    let (c, r) = (DVec3::from(centre) / unit, radius / unit);
    let record = SphereHit { cx: c.x, cy: c.y, cz: c.z, square: r * r, k: geometry::power(c, r) };
    InUnits { record: record.round(), unit }
}

/// The record of a triangle, for rays whose components are at most `reach` in magnitude.
///
/// Terms that depend on the triangle's size are scaled to the order of 1. A triangle that has no
/// area, or whose plane passes through the origin, is never hit.
pub fn triangle_hit<E: Element>(vertices: [[f64; 3]; 3], reach: [f64; 3]) -> InUnits<TriangleHit<E>> {
    let vertices = vertices.map(DVec3::from);
    let unit = unit(vertices.map(|v| v.abs().max_element()).into_iter().fold(0.0, f64::max));
    InUnits { record: in_its_unit(vertices.map(|v| v / unit), DVec3::from(reach)), unit }
}

fn in_its_unit<E: Element>([v1, v2, v3]: [DVec3; 3], reach: DVec3) -> TriangleHit<E> {
    // A volume that is NaN counts as none.
    let Some(volume) = geometry::triangle_volume([v1, v2, v3]) else { return TriangleHit::<f64>::default().round() };
    let facing = volume.signum();
    let n = facing * geometry::triangle_plane([v1, v2, v3]);
    let (k, scale) = (facing * volume, n.abs().max_element());
    // The plane through the origin and an edge, with its normal pointing away from the triangle,
    // and an error bound for three rounded products and their sum.
    let edge = |from: DVec3, to: DVec3| {
        let normal = facing * to.cross(from);
        let normal = normal / normal.abs().max_element();
        let bound = HIT_ROUNDINGS * E::EPSILON / 2.0 * reach.dot(normal.abs());
        // The kernels compare strictly, d . normal < bound, so that the bound must not round to 0.
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

/// A bound on the error of d . normal, in units of u times the sum of its terms' magnitudes. A term
/// is rounded up to four times: in the record, in its product, and in two sums. The bound is proved
/// in `experiments/prove/rounding.rs`.
pub const HIT_ROUNDINGS: f64 = 4.5;
