//! Triangulating faces of more than three corners: as a fan if they are convex, else by ear
//! clipping.

use glam::{DVec2, DVec3, Vec3};

use super::MeshError;
use super::fault::counted;

/// The most corners that ear clipping compares with each corner of a face, on average: enough for
/// faces of some two thousand corners. This bounds the time.
const PATIENCE: usize = 1000;

/// A face that was stored as a triangle fan around its first corner, before all vertices were
/// known.
pub(super) struct Fan {
    /// The face's number in the file, from 1.
    pub number: usize,
    /// The index of its first triangle in the mesh.
    pub first: usize,
    /// The number of its corners; it has two triangles fewer.
    pub corners: usize,
}

/// Replaces, in place, the fans of faces that are not convex.
pub(super) fn cut(fans: &[Fan], vertices: &[Vec3], triangles: &mut [[u32; 3]]) -> Result<(), MeshError> {
    for &Fan { number, first, corners } in fans {
        let fan = &mut triangles[first..first + corners - 2];
        let mut outline: Vec<u32> = fan[0][..2].iter().copied().chain(fan.iter().map(|triangle| triangle[2])).collect();
        let place = |index: &u32| vertices[*index as usize];
        // Remove repeated corners: neither of the two copies makes a turn, which would hide a turn
        // to the right.
        let mut before = place(&outline[corners - 1]);
        outline.retain(|index| place(index) != std::mem::replace(&mut before, place(index)));
        let flat = flat(outline.iter().map(|index| place(index).as_dvec3()).collect());
        if outline.len() < 3 || is_convex(&flat) {
            continue;
        }
        let ears = ears(&flat).ok_or_else(|| {
            let corners = counted(corners, "corner", "corners");
            MeshError::new(format!("face {number} has {corners} and is not convex")).expected("triangles in its place")
        })?;
        fan.fill([outline[0]; 3]); // Without an area: those left stand for repeated corners.
        for (triangle, ear) in fan.iter_mut().zip(ears) {
            *triangle = ear.map(|corner| outline[corner]);
        }
    }
    Ok(())
}

/// A face projected to two dimensions, along the axis nearest to its normal by Newell's method,
/// such that its corners go counter-clockwise.
fn flat(corners: Vec<DVec3>) -> Vec<DVec2> {
    let from_first = |corner: &DVec3| *corner - corners[0];
    let edges = corners.iter().zip(corners.iter().skip(1));
    let normal: DVec3 = edges.map(|(a, b)| from_first(a).cross(from_first(b))).sum();
    let drop = normal.abs().max_position();
    let seen = |corner: &DVec3| {
        let (u, v) = (corner[(drop + 1) % 3], corner[(drop + 2) % 3]);
        if normal[drop] < 0.0 { DVec2::new(v, u) } else { DVec2::new(u, v) }
    };
    corners.iter().map(seen).collect()
}

/// Whether the outline makes no turn to the right, beyond the rounding of corners to f32, and does
/// not return to where it came from.
fn is_convex(flat: &[DVec2]) -> bool {
    let rounding = flat.iter().map(|corner| corner.abs().max_element()).fold(0.0, f64::max) * f64::from(f32::EPSILON);
    (0..flat.len()).all(|at| {
        let [a, b, c] = [at, at + 1, at + 2].map(|at| flat[at % flat.len()]);
        a != c && turn(a, b, c) >= -2.0 * rounding * ((b - a).length() + (c - b).length())
    })
}

/// Greater than 0 if the way from `a` over `b` to `c` turns left at `b`.
fn turn(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - b)
}

/// Triangulates by clipping ears: triangles of three consecutive corners with no other corner
/// inside. If there is no ear, as in an outline that crosses itself, any three consecutive corners
/// are clipped. None if this takes too long.
fn ears(flat: &[DVec2]) -> Option<Vec<[usize; 3]>> {
    let mut rest: Vec<usize> = (0..flat.len()).collect();
    let mut ears = Vec::with_capacity(flat.len() - 2);
    let (mut at, mut refused, mut left, mut are_sought) = (0, 0, PATIENCE * flat.len(), true);
    while rest.len() > 3 {
        let count = rest.len();
        let ear = |at: usize| [at + count - 1, at, at + 1].map(|at| rest[at % count]);
        // Where the outline returns along the same edge it encloses nothing: clip that spike before
        // the corners beside it are taken for an ear.
        let mut places = if are_sought { 0..count } else { at + count - 2..at + count };
        let back = places.find(|at| matches!(ear(*at).map(|corner| flat[corner]), [a, b, c] if a == c || b == c));
        are_sought &= back.is_some();
        at = back.unwrap_or(at) % count;
        let [a, b, c] = ear(at).map(|corner| flat[corner]);
        let within = |&corner: &usize| {
            let p = flat[corner];
            p != a && p != b && p != c && turn(a, b, p) >= 0.0 && turn(b, c, p) >= 0.0 && turn(c, a, p) >= 0.0
        };
        let first_within = if turn(a, b, c) > 0.0 { rest.iter().position(within) } else { Some(0) };
        left = left.checked_sub(first_within.unwrap_or(count) + 1)?;
        if back.is_some() || refused == count || first_within.is_none() {
            ears.push(ear(at));
            rest.remove(at);
            refused = 0;
            // The next corner is now at index `at`. Continuing after it avoids a fan of slivers.
            at = (at + 1) % (count - 1);
        } else {
            refused += 1;
            at = (at + 1) % count;
        }
    }
    ears.push([rest[0], rest[1], rest[2]]);
    Some(ears)
}
