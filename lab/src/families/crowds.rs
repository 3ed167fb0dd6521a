//! The families whose scenes have one object or many, up to 5,000: S9, X1, X2 and L2.

use glam::{DVec3, Vec3, dvec3};

use super::maker::{BLUE, GREEN, GREY, Maker, RED, light, sphere, triangle};
use super::{Family, Level, MadeScene, names, numbers};
use rayo::internals::scene::{Scene, Sphere, Triangle};

const COUNTS: [usize; 5] = [1, 31, 32, 200, 5000];
pub(super) const VARIANTS: &[&str] = &["1 object", "31 objects", "32 objects", "200 objects", "5000 objects"];
pub(super) const COLOURS: [Vec3; 4] = [RED, GREEN, BLUE, GREY];

/// A scene to which objects are to be added, and how many.
pub(super) struct EmptyScene {
    pub scene: Scene,
    pub count: usize,
}

/// A scene to be filled, whose picture extends `half` to each side at distance 1.
pub(super) fn empty(maker: &mut Maker, half: f64, lights: usize, scale: f64) -> EmptyScene {
    let count = COUNTS[maker.variant];
    // Scenes of many objects have smaller pictures and the others larger ones, so that a level has
    // as many rays as in other families.
    maker.side = if count > 1000 { maker.side.div_ceil(2) } else { maker.side + maker.side / 8 };
    let camera = maker.square(half);
    EmptyScene { scene: maker.scene(camera, lights, scale), count }
}

/// Adds spheres and triangles in turn until there are `count` objects, at random positions and many
/// depths in a picture that extends `half` to each side at distance 1. Object i is `scale(i)` times
/// as far away and as large, and its colour is multiplied by `shade(i)`.
pub(super) fn fill(
    maker: &mut Maker,
    scene: &mut Scene,
    half: f64,
    count: usize,
    scale: impl Fn(usize) -> f64,
    shade: impl Fn(usize) -> f32,
) {
    let size = half * (1.0 / count as f64).sqrt().clamp(0.02, 0.35);
    for i in scene.spheres.len() + scene.triangles.len()..count {
        let reach = 0.9 * half;
        let mut place = |reach: f64| dvec3(maker.between(-reach, reach), maker.between(-reach, reach), 1.0);
        let (at, a, b, c) = (place(if count == 1 { 0.2 * half } else { reach }), place(1.0), place(1.0), place(1.0));
        let depth = scale(i) * maker.between(20.0, 60.0);
        let colour = shade(i) * COLOURS[i % COLOURS.len()];
        if i % 2 == 0 {
            scene.spheres.push(sphere(depth * size, colour, depth * at));
        } else {
            let corner =
                |x: f64, y: f64, v: DVec3| depth * (at + size * (1.5 * dvec3(x, y, 0.0) + 0.7 * v - 0.7 * DVec3::Z));
            scene.triangles.push(triangle(colour, [corner(-1.0, -1.0, a), corner(1.0, -0.8, b), corner(0.2, 1.2, c)]));
        }
    }
}

const UNSCALED: fn(usize) -> f64 = |_| 1.0;
pub(super) const UNSHADED: fn(usize) -> f32 = |_| 1.0;

pub const BESIDE: Family = Family {
    id: "S9",
    name: "spheres beside the camera, wholly in front of it",
    parameter: "z of the centre / radius",
    correct: "as anywhere: the nearest, t within the bound",
    levels: &numbers([2.0, 1.2, 1.05, 1.02, 1.005, 1.001, 1.0005]),
    ordinary: 0,
    same_work: true,
    variants: VARIANTS,
    make: beside,
};

fn beside(maker: &mut Maker) -> MadeScene {
    let (radius, far) = (maker.between(0.5, 2.0), maker.between(0.9, 1.5));
    let (x, y) = maker.turn();
    let EmptyScene { mut scene, count } = empty(maker, 1.0, 2, 2.0 * radius);
    let centre = radius * dvec3(far * x, far * y, maker.value);
    scene.spheres.push(sphere(radius, RED, centre));
    if count > 1 {
        // A sphere that is farther by a factor of 1 + 1e-4, and first in the file.
        scene.spheres.insert(0, sphere(radius, GREEN, centre * (1.0 + 1e-4)));
    }
    fill(maker, &mut scene, 1.0, count, UNSCALED, UNSHADED);
    scene.into()
}

/// The distance of the sun, in metres.
const SUN: f64 = 1.4e11;

pub const SCALES: Family = Family {
    id: "X1",
    name: "scales mixed within one scene",
    parameter: "largest / ordinary",
    correct: "the nearest, however large or small it is",
    levels: &[
        Level { value: 1.0, label: "" },
        Level { value: 1e4, label: "" },
        Level { value: 1e8, label: "" },
        Level { value: SUN, label: "the sun, in metres" },
        Level { value: 1e12, label: "" },
        Level { value: 1e18, label: "" },
        Level { value: 1e24, label: "" },
        Level { value: 1e28, label: "" },
    ],
    ordinary: 0,
    same_work: false,
    variants: VARIANTS,
    make: scales,
};

fn scales(maker: &mut Maker) -> MadeScene {
    let ratio = maker.value;
    let EmptyScene { mut scene, count } = empty(maker, 0.5, 2, 40.0);
    if ratio == SUN {
        let (x, y) = maker.turn();
        let centre = SUN * dvec3(0.3 * x, 0.3 * y, 1.0).normalize();
        scene.lights.push(light(0.5, centre));
        scene.spheres.push(sphere(7e8, GREY, centre));
        fill(maker, &mut scene, 0.5, count, UNSCALED, UNSHADED);
    } else {
        // An object that is smaller by a factor is nearer by the same factor, so that it appears as
        // large.
        let scale = |i: usize| [ratio, 1.0, 1.0 / ratio, 1.0][i / 2 % 4];
        fill(maker, &mut scene, 0.5, count, scale, UNSHADED);
    }
    scene.into()
}

pub const DUPLICATES: Family = Family {
    id: "X2",
    name: "objects twice, in other colours",
    parameter: "where they are",
    correct: "the first in order",
    levels: &names(["ahead", "around the camera", "across z = 0", "behind the camera", "beside the camera"]),
    ordinary: 0,
    same_work: false,
    variants: VARIANTS,
    make: duplicates,
};

fn duplicates(maker: &mut Maker) -> MadeScene {
    let EmptyScene { mut scene, count } = empty(maker, 0.6, 2, 20.0);
    let half = count.div_ceil(2);
    let special = if maker.value == 0.0 { 0 } else { half.div_ceil(4).min(20) };
    for _ in 0..special {
        let radius = maker.between(5.0, 500.0);
        let (x, y) = maker.turn();
        let centre = match maker.value as usize {
            1 => dvec3(0.4 * x, 0.4 * y, maker.between(-0.9, 0.9)),
            2 => dvec3(1.02 * x, 1.02 * y, maker.between(-0.9, 0.9)),
            3 => dvec3(x, y, -1.5),
            _ => dvec3(1.2 * x, 1.2 * y, maker.between(1.0005, 1.05)),
        };
        scene.spheres.push(sphere(radius, COLOURS[special % 4], radius * centre));
    }
    fill(maker, &mut scene, 0.6, half, UNSCALED, UNSHADED);
    let other = |colour: Vec3| Vec3::ONE - 0.8 * colour;
    let spheres = scene.spheres.iter().map(|s| Sphere { colour: other(s.colour), ..*s }).collect::<Vec<_>>();
    let triangles = scene.triangles.iter().map(|t| Triangle { colour: other(t.colour), ..*t }).collect::<Vec<_>>();
    scene.spheres.extend(spheres);
    scene.triangles.extend(triangles);
    // If `count` is odd, there is one object too many.
    if scene.spheres.len() + scene.triangles.len() > count {
        scene.spheres.pop();
    }
    scene.into()
}

const INTENSITIES: [f32; 8] = [1.0, 1e-30, 1e-10, 1e3, 1e10, 1e20, 1e30, 1e37];

pub const BRIGHTNESS: Family = Family {
    id: "L2",
    name: "lights from dim to beyond f32",
    parameter: "intensity, or where",
    correct: "finite; the bytes are those of the floats",
    levels: &names([
        "1",
        "1e-30",
        "1e-10",
        "1e3",
        "1e10",
        "1e20",
        "1e30",
        "1e37",
        "a sum beyond f32",
        "at 1e20",
        "at 1e30",
    ]),
    ordinary: 0,
    same_work: true,
    variants: VARIANTS,
    make: brightness,
};

fn brightness(maker: &mut Maker) -> MadeScene {
    let EmptyScene { mut scene, count } = empty(maker, 0.5, 2, 40.0);
    let level = maker.value as usize;
    let mut intensity = 1.0;
    match level {
        8 => scene.lights = vec![scene.lights[0], scene.lights[1], scene.lights[0]],
        9 | 10 => scene.lights.iter_mut().for_each(|light| light.position *= [1e20, 1e30][level - 9] / 40.0),
        _ => intensity = INTENSITIES[level],
    }
    match level {
        8 => scene.lights.iter_mut().for_each(|light| light.intensity = 1.5e38),
        _ => scene.lights[0].intensity *= intensity,
    }
    // Some objects reflect so little that they appear as bright as under ordinary light.
    let shade = |i: usize| if i % 3 == 1 { 1.0 / intensity } else { 1.0 };
    fill(maker, &mut scene, 0.5, count, UNSCALED, shade);
    scene.into()
}
