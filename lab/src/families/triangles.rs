//! The families of triangles, T1 to T7.

use glam::{DVec3, dvec3};

use super::maker::{BLUE, GREEN, GREY, Maker, RED, camera, icosphere, triangle};
use super::spheres::SCALES;
use super::{Family, MadeScene, names, numbers};

pub const SLIVER: Family = Family {
    id: "T1",
    name: "slivers",
    parameter: "height / length",
    correct: "no wrong hit outside of the margin",
    levels: &numbers([1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7]),
    ordinary: 0,
    same_work: true,
    variants: &["all of it", "its short side", "its short side, tilted, two lights"],
    make: sliver,
};

fn sliver(maker: &mut Maker) -> MadeScene {
    let height = 2.0 * maker.value;
    let (x, y) = maker.turn();
    // The midpoint of the long side is exactly on the axis.
    let slope = if maker.variant == 2 { 0.75 } else { 0.0 };
    let end = dvec3(x, y, slope);
    let at = dvec3(0.0, 0.0, 4.0);
    let apex = at + dvec3(-y, x, slope) * height + end * (0.25 * height);
    let half = if maker.variant == 0 { 0.3 } else { (0.3 * height).min(0.3) };
    let camera = maker.square(half);
    let mut scene = maker.scene(camera, 1 + usize::from(maker.variant == 2), 4.0);
    let (one, other) = (end.as_vec3().as_dvec3(), at);
    scene.triangles.push(triangle(RED, [other - one, other + one, apex]));
    scene.into()
}

pub const FAR: Family = Family {
    id: "T2",
    name: "small and far triangles",
    parameter: "distance / length",
    correct: "no wrong hit outside of the margin; no hole in a mesh",
    levels: &numbers([1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6, 1e7]),
    ordinary: 0,
    same_work: true,
    variants: &["a triangle", "a triangle, two lights", "a closed mesh"],
    make: far,
};

fn far(maker: &mut Maker) -> MadeScene {
    let distance = maker.value;
    let half = 0.8 / (distance + 0.5);
    let camera = maker.square(half);
    let mut scene = maker.scene(camera, 1 + usize::from(maker.variant == 1), distance);
    let (x, y) = maker.turn();
    let centre = dvec3(0.0, 0.0, distance + 0.75);
    let turned = |v: DVec3| centre + dvec3(x * v.x - y * v.y, y * v.x + x * v.y, v.z);
    if maker.variant == 2 {
        let faces = icosphere(1).into_iter().map(|face| triangle(GREY, face.map(|v| turned(0.7 * v))));
        scene.triangles.extend(faces);
    } else {
        let corners = [dvec3(-0.5, -0.4, 0.1), dvec3(0.6, -0.3, -0.2), dvec3(-0.1, 0.5, 0.2)];
        scene.triangles.push(triangle(GREEN, corners.map(turned)));
    }
    scene.into()
}

pub const GRAZING: Family = Family {
    id: "T3",
    name: "triangles at a grazing angle",
    parameter: "angle of the plane to the view",
    correct: "t within the bound; a plane through the camera is not hit",
    levels: &numbers([1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 0.0]),
    ordinary: 0,
    same_work: true,
    variants: &["one light", "two lights", "turned"],
    make: grazing,
};

fn grazing(maker: &mut Maker) -> MadeScene {
    let slope = maker.value;
    let half = if slope == 0.0 { 1e-3 } else { slope };
    let camera = maker.square(half);
    let mut scene = maker.scene(camera, 1 + usize::from(maker.variant == 1), 4.0);
    // The plane y = slope (z - 4). Where z < 4 it is seen from far below, and beyond from slightly
    // above. With slope 0 it contains the camera.
    let (x, y) = if maker.variant == 2 { maker.turn() } else { (1.0, 0.0) };
    let on = |across: f64, z: f64| {
        let up = slope * (z - 4.0);
        dvec3(x * across - y * up, y * across + x * up, z)
    };
    let (near, far) = (maker.between(2.25, 3.0), maker.between(6.0, 12.0));
    scene.triangles.push(triangle(RED, [on(-3.0 * half, near), on(4.0 * half, near), on(half, far)]));
    scene.into()
}

pub const LARGE: Family = Family {
    id: "T4",
    name: "large triangles",
    parameter: "length / distance",
    correct: "t within the bound",
    levels: &numbers([1.0, 10.0, 1e3, 1e5, 1e7, 1e9]),
    ordinary: 0,
    same_work: true,
    variants: &["a wall", "a floor", "a wall with an edge in view, two lights"],
    make: large,
};

fn large(maker: &mut Maker) -> MadeScene {
    let length = maker.value;
    let camera = maker.square(0.5);
    let mut scene = maker.scene(camera, 1 + usize::from(maker.variant == 2), 1.0);
    let slope = maker.between(-0.4, 0.4);
    let wall = |x: f64, y: f64| dvec3(x, y, 1.0 + slope * x.clamp(-1.0, 1.0));
    let vertices = match maker.variant {
        0 => [wall(-length, -length), wall(2.0 * length, -length), wall(-length, 2.0 * length)],
        1 => [dvec3(-length, -1.0, 0.1), dvec3(length, -1.0, 0.1), dvec3(0.1, -1.0, length)],
        // One edge passes close to the axis.
        _ => [wall(-0.25, -length), wall(0.25, length), wall(length, 0.0)],
    };
    scene.triangles.push(triangle(BLUE, vertices));
    scene.into()
}

pub const SCALE: Family = Family {
    id: "T5",
    name: "small and large scenes of triangles",
    parameter: "unit of length",
    correct: "the same image; the same bytes for a power of two",
    levels: SCALES,
    ordinary: 6,
    same_work: true,
    variants: &["triangles that overlap", "one triangle"],
    make: scaled,
};

fn scaled(maker: &mut Maker) -> MadeScene {
    let unit = maker.value;
    let camera = maker.square(0.4);
    let mut scene = maker.scene(camera, 2 - maker.variant, 4.0 * unit);
    let shift = dvec3(maker.between(-0.5, 0.5), maker.between(-0.5, 0.5), 0.0);
    let corners = [dvec3(-1.0, -1.0, 4.0), dvec3(1.5, -0.5, 5.0), dvec3(0.0, 1.25, 3.5)];
    let colours = if maker.variant == 0 { &[RED, GREEN, BLUE][..] } else { &[GREY] };
    for (colour, turn) in colours.iter().zip([0.0, 0.35, -0.4]) {
        let at = |v: DVec3| unit * (shift + dvec3(v.x - turn * v.y, v.y + turn * v.x, v.z + 0.5 * turn));
        scene.triangles.push(triangle(*colour, corners.map(at)));
    }
    scene.into()
}

pub const SHARED: Family = Family {
    id: "T6",
    name: "shared edges and vertices",
    parameter: "mesh",
    correct: "every ray inside of a closed mesh hits",
    levels: &names([
        "an icosphere",
        "an icosphere, finer",
        "an icosphere around the camera",
        "an icosphere, far",
        "a bumpy mesh with its vertices on rays",
        "a bumpy mesh with its vertices on rays, finer",
        "a fan of 2000",
    ]),
    ordinary: 0,
    same_work: false,
    variants: &["one light", "two lights"],
    make: shared,
};

fn shared(maker: &mut Maker) -> MadeScene {
    let (x, y) = maker.turn();
    let turned = |v: DVec3| dvec3(x * v.x - y * v.z, v.y, y * v.x + x * v.z);
    let kind = maker.value as usize;
    let lights = 1 + maker.variant;
    // The kinds whose meshes are seen from inside or fill the picture.
    let covered = [2, 4, 5, 6].contains(&kind);
    let scene = match kind {
        0..4 => {
            let (divisions, distance) = [(2, 3.0), (3, 3.0), (2, 0.1), (2, 3e4)][kind];
            let camera = maker.square(if covered { 1.0 } else { 1.05 / distance });
            let mut scene = maker.scene(camera, lights, distance);
            let centre = dvec3(0.0, 0.0, distance);
            scene.triangles.extend(icosphere(divisions).iter().map(|face| {
                let vertices = face.map(|v| turned(v) + centre);
                triangle(GREY, vertices)
            }));
            scene
        }
        4 | 5 => on_rays(maker, if kind == 4 { 32 } else { 8 }, lights),
        _ => {
            // With an odd side the middle pixel is on the axis, as is the vertex that all triangles
            // share.
            let side = maker.side | 1;
            let camera = camera(side, side, 1.0, 1.0);
            let mut scene = maker.scene(camera, lights, 4.0);
            let rim = |i: u32| {
                let (sin, cos) = (f64::from(i % 2000) / 2000.0 * std::f64::consts::TAU).sin_cos();
                dvec3(3.0 * cos, 3.0 * sin, 4.0 + 0.5 * (x * cos + y * sin))
            };
            let hub = dvec3(0.0, 0.0, 4.0);
            let colour = |i: u32| [GREY, GREY * 0.75][(i % 2) as usize];
            scene.triangles.extend((0..2000).map(|i| triangle(colour(i), [hub, rim(i), rim(i + 1)])));
            scene
        }
    };
    MadeScene { covered, ..scene.into() }
}

/// A mesh over the whole picture whose vertices are exactly on rays, `cell` pixels apart.
///
/// 384 x 512 pixels on a film with diagonal 5 have the side 1/128, so that f32 holds every ray, and
/// its products with small numbers, exactly.
fn on_rays(maker: &mut Maker, cell: u32, lights: usize) -> rayo::internals::scene::Scene {
    let (width, height) = if maker.side >= 320 { (384, 512) } else { (96, 128) };
    let step = 3.0 / f64::from(width);
    let mut scene = maker.scene(camera(width, height, 2.0, 5.0), lights, 4.0);
    // The mesh extends from one cell before the first ray to one cell past the last.
    let (columns, rows) = (width / cell + 3, height / cell + 3);
    let depths: Vec<f64> = (0..columns * rows).map(|_| 1.0 + (maker.rng.next_u64() % 17) as f64 / 32.0).collect();
    let vertex = |i: u32, j: u32| {
        let pixel = |at: u32| f64::from(at * cell) - f64::from(cell) + 0.5;
        let ray = dvec3(step * pixel(i) - 1.5, 2.0 - step * pixel(j), 2.0);
        depths[(j * columns + i) as usize] * ray
    };
    for j in 0..rows - 1 {
        for i in 0..columns - 1 {
            let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
            scene.triangles.push(triangle(GREY, [a, b, c]));
            scene.triangles.push(triangle(GREY, [a, c, d]));
        }
    }
    scene
}

pub const DEGENERATE: Family = Family {
    id: "T7",
    name: "degenerate triangles",
    parameter: "kind",
    correct: "no hit of zero area or at t <= 0",
    levels: &names([
        "crossing z = 0",
        "three equal vertices",
        "two equal vertices",
        "on a line, exactly",
        "on a line, but for the rounding of its numbers",
        "on a line, far apart in size",
        "a vertex at the camera",
        "an edge through the camera",
        "the plane through the camera",
        "behind the camera",
        "all but one vertex behind the camera",
        "on a line, but for an ulp",
        "a vertex an ulp from the camera",
        "an edge an ulp from the camera",
        "the plane an ulp from the camera",
        "crossing z = 0 by an ulp",
    ]),
    ordinary: 0,
    same_work: false,
    variants: &["one light", "two lights"],
    make: degenerate,
};

/// `v` with component i moved away from 0 by `count[i]` units in the last place of f32; a component
/// of 0 is moved by units of 1.
fn ulps(v: DVec3, count: [i32; 3]) -> DVec3 {
    let further = |x: f32, count: i32| match count {
        0 => x,
        _ if x == 0.0 => count as f32 * f32::EPSILON,
        _ => f32::from_bits(x.to_bits().wrapping_add_signed(count)),
    };
    let [x, y, z] = v.as_vec3().to_array();
    DVec3::from([(x, count[0]), (y, count[1]), (z, count[2])].map(|(x, count)| f64::from(further(x, count))))
}

fn degenerate(maker: &mut Maker) -> MadeScene {
    let camera = maker.square(0.8);
    let mut scene = maker.scene(camera, 1 + maker.variant, 4.0);
    let (p, along) = (dvec3(0.5, 0.25, 4.0), dvec3(-1.0, 0.5, 2.0));
    let tenths = dvec3(0.1, 0.3, 3.3);
    let vertices = match maker.value as usize {
        0 => vec![
            [dvec3(-2.0, -1.0, 6.0), dvec3(2.0, -1.5, 5.0), dvec3(0.3, 0.2, -2.0)],
            [dvec3(-1.0, 3.0, 9.0), dvec3(1.0, 1.0, 0.0), dvec3(3.0, 0.5, -1.0)],
        ],
        1 => vec![[p, p, p], [tenths, tenths, tenths], [DVec3::ZERO; 3]],
        2 => vec![[p, p + along, p], [tenths, 2.0 * tenths, tenths], [p + along, p, p]],
        3 => vec![[p, p + along, p + 3.0 * along], [p - along, p, p + 2.0 * along]],
        4 => (1..20)
            .map(|i| [tenths, tenths + f64::from(i) * along / 7.0, tenths + f64::from(i) * along / 3.0])
            .collect(),
        5 => {
            // Differences of numbers of very different size are rounded even in f64.
            let tiny = dvec3(3e-12, 7e-12, 1e-11);
            vec![[tiny, p * 1e6, 2e6 * p], [p, p + 1e9 * along, p - 1e-3 * along], [1e-9 * p, p, 1e9 * p]]
        }
        6 => vec![[DVec3::ZERO, p, p + along], [p, DVec3::ZERO, dvec3(-1.0, 2.0, 3.0)]],
        7 => vec![[p, -2.0 * p, dvec3(-1.0, 2.0, 3.0)], [dvec3(0.0, 1.0, 5.0), 0.5 * p, -p]],
        8 => vec![[p, along, p + along], [p, 2.0 * p + along, 3.0 * p - along]],
        9 => vec![
            [dvec3(-3.0, -3.0, -4.0), dvec3(3.0, -3.0, -4.0), dvec3(0.0, 4.0, -3.0)],
            [dvec3(-3.0, -3.0, -1e6), dvec3(3e6, -3.0, -4.0), dvec3(0.0, 4.0, 0.0)],
        ],
        10 => vec![[dvec3(0.1, 0.2, 3.0), dvec3(-3.0, -1.0, -4.0), dvec3(3.0, -2.0, -2.0)]],
        // Neighbours in f32 of kinds 3 and 6 to 8, which are degenerate; these have an area and a
        // side.
        11 => vec![[p, p + along, ulps(p + 3.0 * along, [0, 1, 0])], [p - along, ulps(p, [-1, 0, 0]), p + 2.0 * along]],
        12 => vec![
            [ulps(DVec3::ZERO, [1, 0, 1]), p, p + along],
            [p, ulps(DVec3::ZERO, [0, -1, 1]), dvec3(-1.0, 2.0, 3.0)],
        ],
        13 => vec![
            [p, ulps(-2.0 * p, [0, 1, 0]), dvec3(-1.0, 2.0, 3.0)],
            [dvec3(0.0, 1.0, 5.0), 0.5 * p, ulps(-p, [1, 0, 0])],
        ],
        14 => vec![[p, along, ulps(p + along, [0, 0, 1])], [p, ulps(2.0 * p + along, [0, -1, 0]), 3.0 * p - along]],
        _ => vec![
            [dvec3(-2.0, -1.0, 6.0), dvec3(2.0, -1.5, 5.0), ulps(dvec3(0.3, 0.2, 0.0), [0, 0, -1])],
            [dvec3(-1.0, 3.0, 9.0), dvec3(1.0, 1.0, 0.0), ulps(dvec3(3.0, 0.5, 0.0), [0, 0, 1])],
        ],
    };
    scene.triangles = vertices.into_iter().map(|vertices| triangle(RED, vertices)).collect();
    scene.into()
}
