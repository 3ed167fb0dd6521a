//! Generated meshes of any size: an icosphere, smooth or bumpy, a torus, and a terrain. They are
//! the same on every machine.

use std::collections::HashMap;
use std::f64::consts::TAU;

use glam::DVec3;

use super::Mesh;
use crate::scene::Rng;

/// The most triangles of a generated mesh.
pub const MOST_TRIANGLES: u64 = 100_000_000;

/// The unit sphere about the origin as a subdivided icosahedron: each of its 20 faces is cut into
/// f² triangles, where f makes the total of 20 f² as near as possible to `triangles`. Closed;
/// counter-clockwise seen from outside.
///
/// If `bumps` is above 0, the radius varies by up to that share of it, by noise from `seed`; the
/// mesh remains closed.
pub fn icosphere(triangles: u64, bumps: f64, seed: u64) -> Mesh {
    let frequency = nearest(triangles, |f| 20 * f * f);
    let noise = Noise::new(seed);
    let corners = icosahedron();
    let mut mesh = Mesh::default();
    // A point on an edge or corner of the icosahedron belongs to several faces but is created once:
    // its barycentric weights of the icosahedron's corners identify it.
    let mut shared = HashMap::new();
    for face in FACES {
        let mut point = |weights: [u64; 3]| {
            let mut make = || {
                let mut weighted: Vec<_> = face.into_iter().zip(weights).filter(|(_, weight)| *weight > 0).collect();
                weighted.sort_unstable();
                let sum: DVec3 = weighted.iter().map(|&(corner, weight)| corners[corner] * weight as f64).sum();
                let direction = sum.normalize();
                let radius = 1.0 + if bumps > 0.0 { bumps * noise.fractal(direction * 2.5) } else { 0.0 };
                mesh.vertices.push((direction * radius).as_vec3());
                (mesh.vertices.len() - 1) as u32
            };
            if weights.contains(&0) {
                let mut key: Vec<_> = face.into_iter().zip(weights).filter(|(_, weight)| *weight > 0).collect();
                key.sort_unstable();
                *shared.entry(key).or_insert_with(make)
            } else {
                make()
            }
        };
        // The face's points row by row, starting at its first corner: row i has i + 1 points.
        let mut above = vec![point([frequency, 0, 0])];
        for row in 1..=frequency {
            let below: Vec<u32> = (0..=row).map(|at| point([frequency - row, row - at, at])).collect();
            for at in 0..row as usize {
                mesh.triangles.push([above[at], below[at], below[at + 1]]);
                if at + 1 < row as usize {
                    mesh.triangles.push([above[at], below[at + 1], above[at + 1]]);
                }
            }
            above = below;
        }
    }
    mesh
}

/// A torus about the y axis: the circle inside the tube has radius 1, the tube has radius 0.4. It
/// has 2 · 2n · n triangles, with n such that this is as near as possible to `triangles`. Closed;
/// counter-clockwise seen from outside.
pub fn torus(triangles: u64) -> Mesh {
    let around_tube = nearest(triangles, |n| 4 * n * n).max(3);
    let around = 2 * around_tube;
    let turn = |at: u64, of: u64| (TAU * at as f64 / of as f64).sin_cos();
    let mut mesh = Mesh::default();
    for i in 0..around {
        let (sine, cosine) = turn(i, around);
        for j in 0..around_tube {
            let (up, out) = turn(j, around_tube);
            let reach = 1.0 + 0.4 * out;
            mesh.vertices.push(DVec3::new(reach * cosine, 0.4 * up, reach * sine).as_vec3());
        }
    }
    let index = |i: u64, j: u64| (i % around * around_tube + j % around_tube) as u32;
    for i in 0..around {
        for j in 0..around_tube {
            mesh.triangles.push([index(i, j), index(i, j + 1), index(i + 1, j)]);
            mesh.triangles.push([index(i + 1, j), index(i, j + 1), index(i + 1, j + 1)]);
        }
    }
    mesh
}

/// A terrain of hills, by noise from `seed`, over the square from -1 to 1 in x and z, with y up. It
/// has 2 n² triangles, with n such that this is as near as possible to `triangles`. Open;
/// counter-clockwise seen from above.
pub fn terrain(triangles: u64, seed: u64) -> Mesh {
    let side = nearest(triangles, |n| 2 * n * n);
    let noise = Noise::new(seed);
    let mut mesh = Mesh::default();
    let along = |at: u64| 2.0 * at as f64 / side as f64 - 1.0;
    for row in 0..=side {
        for column in 0..=side {
            let (x, z) = (along(column), along(row));
            let height = 0.35 * noise.fractal(DVec3::new(1.7 * x, 0.5, 1.7 * z));
            mesh.vertices.push(DVec3::new(x, height, z).as_vec3());
        }
    }
    let index = |row: u64, column: u64| (row * (side + 1) + column) as u32;
    for row in 0..side {
        for column in 0..side {
            let [a, b, c, d] =
                [index(row, column), index(row + 1, column), index(row + 1, column + 1), index(row, column + 1)];
            mesh.triangles.push([a, b, c]);
            mesh.triangles.push([a, c, d]);
        }
    }
    mesh
}

/// The n from 1 on for which `count(n)` is nearest to `triangles`; `count` must increase.
fn nearest(triangles: u64, count: impl Fn(u64) -> u64) -> u64 {
    let triangles = triangles.min(MOST_TRIANGLES);
    let above = (1..).find(|&n| count(n) >= triangles).unwrap_or(1);
    let below = (above - 1).max(1);
    if triangles.abs_diff(count(below)) <= triangles.abs_diff(count(above)) { below } else { above }
}

/// The corners of an icosahedron on the unit sphere: even permutations of (0, ±1, ±φ), normalised.
fn icosahedron() -> [DVec3; 12] {
    let golden = (1.0 + 5.0_f64.sqrt()) / 2.0;
    let corner = |x: f64, y: f64, z: f64| DVec3::new(x, y, z).normalize();
    [
        corner(-1.0, golden, 0.0),
        corner(1.0, golden, 0.0),
        corner(-1.0, -golden, 0.0),
        corner(1.0, -golden, 0.0),
        corner(0.0, -1.0, golden),
        corner(0.0, 1.0, golden),
        corner(0.0, -1.0, -golden),
        corner(0.0, 1.0, -golden),
        corner(golden, 0.0, -1.0),
        corner(golden, 0.0, 1.0),
        corner(-golden, 0.0, -1.0),
        corner(-golden, 0.0, 1.0),
    ]
}

/// The faces of the icosahedron, counter-clockwise from outside.
const FACES: [[usize; 3]; 20] = [
    [0, 11, 5],
    [0, 5, 1],
    [0, 1, 7],
    [0, 7, 10],
    [0, 10, 11],
    [1, 5, 9],
    [5, 11, 4],
    [11, 10, 2],
    [10, 7, 6],
    [7, 1, 8],
    [3, 9, 4],
    [3, 4, 2],
    [3, 2, 6],
    [3, 6, 8],
    [3, 8, 9],
    [4, 9, 5],
    [2, 4, 11],
    [6, 2, 10],
    [8, 6, 7],
    [9, 8, 1],
];

/// Value noise: random values at integer coordinates, smoothly interpolated between them.
struct Noise {
    seed: u64,
}

impl Noise {
    fn new(seed: u64) -> Self {
        Noise { seed }
    }

    /// Fractal noise within -1 and 1: a sum of five octaves, each of twice the frequency and half
    /// the amplitude of the one before.
    fn fractal(&self, at: DVec3) -> f64 {
        (0..5).map(|octave| 0.5_f64.powi(octave + 1) * self.smooth(at * f64::from(1 << octave))).sum()
    }

    /// One octave of noise: within -1 and 1, and differentiable.
    fn smooth(&self, at: DVec3) -> f64 {
        let (cell, within) = (at.floor(), at - at.floor());
        let share = within * within * (3.0 - 2.0 * within);
        let mix = |a: f64, b: f64, share: f64| a + (b - a) * share;
        let corner = |x: f64, y: f64, z: f64| self.at(cell + DVec3::new(x, y, z));
        let edge = |y: f64, z: f64| mix(corner(0.0, y, z), corner(1.0, y, z), share.x);
        let side = |z: f64| mix(edge(0.0, z), edge(1.0, z), share.y);
        mix(side(0.0), side(1.0), share.z)
    }

    fn at(&self, cell: DVec3) -> f64 {
        let [x, y, z] = cell.to_array().map(|coordinate| coordinate as i64 as u64);
        // Mix each coordinate into the seed in turn.
        let mixed = [x, y, z].into_iter().fold(self.seed, |state, coordinate| {
            Rng::new(state ^ coordinate.wrapping_mul(0xd6e8_feb8_6659_fd93)).next_u64()
        });
        2.0 * f64::from(Rng::new(mixed).next_f32()) - 1.0
    }
}
