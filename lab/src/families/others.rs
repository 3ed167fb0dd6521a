//! The families of lights, images and invalid fields: L1, I1 and N1.

use glam::{DVec3, Vec3, dvec3};

use super::maker::{BLUE, GREEN, GREY, Maker, RED, camera, light, sphere, triangle};
use super::{Family, Level, MadeScene, names};
use rayo::internals::scene::{Camera, Scene, many};

pub const LIGHTS: Family = Family {
    id: "L1",
    name: "lights",
    parameter: "where, or how bright",
    correct: "finite; a light on the surface gives nothing there; a far light is the limit",
    levels: &names([
        "ordinary",
        "none",
        "intensity 0",
        "on the surface",
        "at 1e-3 from the surface",
        "in the plane",
        "inside of the sphere",
        "at the camera",
        "at 1e6",
        "at 1e12",
        "at 1e18",
        "at 1e24",
        "at 1e30",
        "at 1e38",
        "intensity 1e-30",
        "intensity 1e10",
        "intensity 1e38",
    ]),
    ordinary: 0,
    same_work: true,
    variants: &["a sphere", "a triangle", "both, a light more", "inside of a sphere"],
    make: lights,
};

fn lights(maker: &mut Maker) -> MadeScene {
    let camera = maker.square(0.5);
    let mut scene = maker.scene(camera, 1 + usize::from(maker.variant == 2), 4.0);
    let ball = sphere(1.0, RED, dvec3(0.25, -0.25, 4.0));
    let wall = triangle(GREEN, [dvec3(-2.0, -2.0, 5.0), dvec3(3.0, -1.5, 4.5), dvec3(-0.5, 2.5, 5.5)]);
    let [centre, vertex, other] = [ball.centre, wall.vertices[0], wall.vertices[1]].map(|position| position.as_dvec3());
    if maker.variant != 1 {
        scene.spheres.push(ball);
    }
    if [1, 2].contains(&maker.variant) {
        scene.triangles.push(wall);
    }
    if maker.variant == 3 {
        scene.spheres[0] = sphere(6.0, GREY, dvec3(0.5, 0.25, 1.0));
    }
    let (x, y) = maker.turn();
    let first = scene.lights[0].position.as_dvec3();
    // A unit vector that points from the surface to the camera.
    let towards = dvec3(0.6 * x, 0.6 * y, -0.8);
    let surface = match maker.variant {
        1 => (3.0 * vertex + 2.0 * other + wall.vertices[2].as_dvec3()) / 6.0,
        3 => dvec3(0.5, 0.25, 7.0),
        _ => centre + towards,
    };
    let (position, intensity) = match maker.value as usize {
        0 => (first, 0.9),
        1 => {
            scene.lights.clear();
            return scene.into();
        }
        2 => (first, 0.0),
        3 => (surface, 0.9),
        4 => (surface + 1e-3 * towards, 0.9),
        5 => (vertex + 3.0 * (other - vertex), 0.9),
        6 => (centre + 0.5 * towards, 0.9),
        7 => (DVec3::ZERO, 0.9),
        // Not quite towards the camera, so that a part of the surface is dark.
        distance @ 8..14 => (10f64.powi([6, 12, 18, 24, 30, 38][distance - 8]) * towards, 0.9),
        dim => (first, [1e-30, 1e10, 1e38][dim - 14]),
    };
    scene.lights[0] = light(intensity, position);
    scene.into()
}

const IMAGE_LEVELS: &[Level] = &names([
    "640x480", "1x1", "1x2", "2x1", "1x67", "1x1000", "65535x1", "3x2000", "2000x3", "4099x5", "1x9", "2x9", "3x9",
    "4x9", "5x9", "6x9", "7x9", "8x9", "9x9", "10x9", "11x9", "12x9", "13x9", "14x9", "15x9", "16x9", "17x9", "18x9",
    "19x9", "20x9", "21x9", "22x9", "23x9", "24x9", "25x9", "26x9", "27x9", "28x9", "29x9", "30x9", "31x9", "32x9",
    "33x9", "34x9", "35x9", "36x9", "37x9", "38x9", "39x9", "40x9", "41x9", "42x9", "43x9", "44x9", "45x9", "46x9",
    "47x9", "48x9", "49x9", "50x9", "51x9", "52x9", "53x9", "54x9", "55x9", "56x9", "57x9", "58x9", "59x9", "60x9",
    "61x9", "62x9", "63x9", "64x9", "65x9", "66x9", "67x9",
]);

pub const IMAGES: Family = Family {
    id: "I1",
    name: "images of odd sizes",
    parameter: "width x height",
    correct: "every pixel as the reference has it",
    levels: IMAGE_LEVELS,
    ordinary: 0,
    same_work: false,
    variants: &["many objects"],
    make: images,
};

fn images(maker: &mut Maker) -> MadeScene {
    let size = IMAGE_LEVELS[maker.value as usize].label;
    let (width, height) = size.split_once('x').expect("a size");
    let [width, height] = [width, height].map(|side| side.parse().expect("a side"));
    let scene = many(6, 6, maker.rng.next_u64());
    Scene { camera: camera(width, height, 1.0, 1.0), ..scene }.into()
}

pub const NOT_NUMBERS: Family = Family {
    id: "N1",
    name: "NaN and infinity through the library",
    parameter: "the field",
    correct: "an error that names the field; no pixel that is NaN",
    levels: &names([
        "a radius",
        "a centre",
        "a sphere's colour",
        "a vertex",
        "a triangle's colour",
        "a light's position",
        "a light's colour",
        "a light's intensity",
    ]),
    ordinary: 0,
    same_work: false,
    variants: &["NaN", "infinite", "minus infinite"],
    make: not_numbers,
};

fn not_numbers(maker: &mut Maker) -> MadeScene {
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY][maker.variant];
    let camera: Camera = maker.square(0.5);
    let mut scene = maker.scene(camera, 2, 4.0);
    scene.spheres = vec![sphere(1.0, RED, dvec3(0.0, 0.0, 4.0)), sphere(1.0, BLUE, dvec3(0.5, 0.5, 6.0))];
    scene.triangles = vec![triangle(GREEN, [dvec3(-2.0, -2.0, 5.0), dvec3(3.0, -1.5, 4.5), dvec3(-0.5, 2.5, 5.5)])];
    let axis = (maker.rng.next_u64() % 3) as usize;
    let spoil = |v: &mut Vec3| v[axis] = bad;
    match maker.value as usize {
        0 => scene.spheres[1].radius = bad,
        1 => spoil(&mut scene.spheres[1].centre),
        2 => spoil(&mut scene.spheres[1].colour),
        3 => spoil(&mut scene.triangles[0].vertices[axis]),
        4 => spoil(&mut scene.triangles[0].colour),
        5 => spoil(&mut scene.lights[1].position),
        6 => spoil(&mut scene.lights[1].colour),
        _ => scene.lights[1].intensity = bad,
    }
    MadeScene { valid: false, ..scene.into() }
}
