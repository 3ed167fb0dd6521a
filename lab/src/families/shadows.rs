//! The families of scenes with shadows, H1 to H6.

use glam::{DVec3, dvec3};

use super::crowds::{COLOURS, EmptyScene, UNSHADED, VARIANTS, empty, fill};
use super::maker::{GREEN, GREY, Maker, RED, icosphere, light, sphere, triangle};
use super::{Family, MadeScene, names, numbers};
use rayo::internals::scene::Triangle;

/// Two triangles that make up the parallelogram with a corner and two sides.
fn quad(corner: DVec3, [a, b]: [DVec3; 2]) -> [Triangle; 2] {
    [[corner, corner + a, corner + b], [corner + a + b, corner + a, corner + b]].map(|v| triangle(GREY, v))
}

/// A large part of the plane y = -1, in front of the camera and behind it.
fn ground() -> [Triangle; 2] {
    quad(dvec3(-64.0, -1.0, -64.0), [128.0 * DVec3::X, 128.0 * DVec3::Z])
}

/// The numbers of objects of H1, H2 and H3. H1 begins with the second one.
const FEW_TO_MANY: [usize; 6] = [1, 4, 31, 32, 200, 5000];

/// A scene to which objects are to be added; it has two lights if it is to have many objects.
fn begin(maker: &mut Maker, half: f64, first: usize) -> EmptyScene {
    let count = FEW_TO_MANY[first + maker.variant];
    maker.side = if count > 1000 { maker.side.div_ceil(4) } else { maker.side };
    let camera = maker.square(half);
    EmptyScene { scene: maker.scene(camera, 1 + usize::from(count >= 200), 4.0), count }
}

pub const CONTACT: Family = Family {
    id: "H1",
    name: "a ball on a ground",
    parameter: "gap / radius",
    correct: "the shadow begins where the two touch",
    levels: &numbers([1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10, 1e-12, 0.0]),
    ordinary: 0,
    same_work: true,
    variants: &["4 objects", "31 objects", "32 objects", "200 objects", "5000 objects"],
    make: contact,
};

fn contact(maker: &mut Maker) -> MadeScene {
    // Whole numbers below 2^24, and an upward direction whose length is exactly 7, so that all
    // distances are exact.
    let (up, unit, radius) = (dvec3(2.0, 6.0, -3.0), 2f64.powi(-19), 458_752.0);
    let (centre, distance) = (radius * dvec3(1.0, 0.0, 5.0), 28.0 * radius);
    let gap = maker.value * radius;
    let EmptyScene { mut scene, count } = begin(maker, 0.6, 1);
    scene.spheres.push(sphere(unit * radius, RED, unit * centre));
    if maker.variant.is_multiple_of(2) {
        let WholePlane { normal, far } = plane(radius + gap);
        let mut on = (-far / normal.length_squared() * normal).round();
        on.x = -far - normal.y * on.y - normal.z * on.z;
        let sides = [dvec3(-normal.y, 1.0, 0.0), dvec3(0.0, normal.z, -normal.y)].map(|side| 800.0 * side);
        let corner = centre + on - sides[0] - sides[1];
        scene.triangles.extend(quad(unit * corner, sides.map(|side| 2.0 * unit * side)));
    } else {
        // A step of length s perpendicular to the line between the centres makes the distance
        // longer by s^2 / 2 of itself.
        let across = (2.0 * distance * gap / 10.0).sqrt().round() * dvec3(3.0, -1.0, 0.0);
        scene.spheres.push(sphere(unit * 27.0 * radius, GREY, unit * (centre - up * (distance / 7.0) - across)));
    }
    // The other objects are behind these two.
    fill(maker, &mut scene, 0.6, count, |_| 0.3, UNSHADED);
    let (x, z) = maker.turn();
    scene.lights[0].position = (unit * (centre + radius * dvec3(2.0 * x, 3.0, 2.0 * z - 2.0))).as_vec3();
    scene.into()
}

/// The plane of the points x with `normal` . x = `far`. Both consist of whole numbers.
struct WholePlane {
    normal: DVec3,
    far: f64,
}

/// A plane at this distance, as nearly as whole numbers allow.
fn plane(distance: f64) -> WholePlane {
    let normals =
        (900..1100).step_by(2).flat_map(|y| (-600..-300).map(move |z| dvec3(1.0, f64::from(y), f64::from(z))));
    let far = |n: &DVec3| (distance * n.length()).round();
    let error = |n: &DVec3| (far(n) / n.length() - distance).abs();
    let best = normals.min_by(|a, b| error(a).total_cmp(&error(b))).expect("there are some");
    WholePlane { normal: best, far: far(&best) }
}

pub const GRAZING: Family = Family {
    id: "H2",
    name: "light at a grazing angle",
    parameter: "height of the light / distance",
    correct: "long shadows of what stands on the ground, none of the ground",
    levels: &numbers([1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 0.0]),
    ordinary: 0,
    same_work: true,
    variants: &["1 object", "4 objects", "31 objects", "32 objects", "200 objects", "5000 objects"],
    make: grazing,
};

fn grazing(maker: &mut Maker) -> MadeScene {
    let EmptyScene { mut scene, count } = begin(maker, 0.5, 0);
    if maker.variant.is_multiple_of(2) {
        scene.spheres.push(sphere(1000.0, GREY, dvec3(0.0, -1001.0, 6.0)));
    } else {
        scene.triangles.extend(ground());
    }
    for i in scene.spheres.len() + scene.triangles.len()..count {
        let at = dvec3(maker.between(-2.0, 2.0), -1.0, maker.between(4.0, 9.0));
        let size = maker.between(0.05, 0.3) * (8.0 / count as f64).sqrt().min(1.0);
        if i % 2 == 0 {
            scene.spheres.push(sphere(size, RED, at + size * DVec3::Y));
        } else {
            let corners = [at - size * DVec3::X, at + size * DVec3::X, at + size * dvec3(0.2, 2.0, 0.5)];
            scene.triangles.push(triangle(GREEN, corners));
        }
    }
    let (x, z) = maker.turn();
    scene.lights[0].position = dvec3(5.0 * x, 5.0 * maker.value - 1.0, 6.0 + 5.0 * z).as_vec3();
    scene.into()
}

pub const LIGHTS: Family = Family {
    id: "H3",
    name: "lights near, in and on things, and far away",
    parameter: "where",
    correct: "the object that a light is on hides it from what is behind; a far light is the limit",
    levels: &names([
        "ordinary",
        "at 1e-3 from the sphere",
        "on the sphere",
        "inside of the sphere",
        "in the triangle's plane",
        "in the triangle",
        "at its corner",
        "at 1e2 radii",
        "at 1e4 radii",
        "at 1e6 radii",
        "at 1e8 radii",
        "at 1e10 radii",
    ]),
    ordinary: 0,
    same_work: true,
    variants: GRAZING.variants,
    make: lights,
};

fn lights(maker: &mut Maker) -> MadeScene {
    let EmptyScene { mut scene, count } = begin(maker, 0.6, 0);
    // The vector (2, 6, 3) has length 7, and the mean of the corners is exact, so that a light can
    // be placed exactly on an object.
    let (centre, to_side) = (dvec3(0.5, -0.125, 5.0), dvec3(-2.0, 6.0, -3.0) / 8.0);
    let corners = [dvec3(-2.0, -1.0, 4.0), dvec3(-1.0, -1.0, 5.0), dvec3(-1.0, 1.0, 4.5)];
    scene.spheres.push(sphere(0.875, RED, centre));
    scene.triangles.push(triangle(GREEN, corners));
    match maker.value {
        _ if count > 1 => scene.triangles.extend(ground()),
        4.0..7.0 => scene.spheres.clear(),
        _ => scene.triangles.clear(),
    }
    fill(maker, &mut scene, 0.6, count, |_| 0.15, UNSHADED);
    let (x, z) = maker.turn();
    let sun = dvec3(0.6 * x, 0.8, 0.6 * z);
    scene.lights[0].position = match maker.value as usize {
        0 => dvec3(3.0 * x, 2.0, 4.0 + z),
        1 => centre + 1.001 * to_side,
        2 => centre + to_side,
        3 => centre + 0.5 * to_side,
        4 => 3.0 * corners[2] - corners[0] - corners[1],
        5 => 0.5 * corners[2] + 0.25 * (corners[0] + corners[1]),
        6 => corners[2],
        far => 10f64.powi(2 * (far as i32 - 6)) * 0.875 * sun,
    }
    .as_vec3();
    scene.into()
}

pub const CLOSED: Family = Family {
    id: "H4",
    name: "closed meshes",
    parameter: "seen from, lit from",
    correct: "not one leak, not one speck",
    levels: &names(["inside, inside", "inside, outside", "outside, inside", "outside, outside"]),
    ordinary: 0,
    same_work: false,
    variants: &["20 triangles", "80 triangles", "320 triangles", "5120 triangles", "81920 triangles"],
    make: closed,
};

fn closed(maker: &mut Maker) -> MadeScene {
    maker.side = maker.side.div_ceil([1, 1, 1, 2, 8][maker.variant]);
    let (level, camera) = (maker.value as usize, maker.square(0.3));
    let centre = dvec3(0.0, 0.0, if level < 2 { 0.25 } else { 1.5 });
    let mut scene = maker.scene(camera, 1, 4.0);
    let (x, y) = maker.turn();
    let turned = |v: DVec3| centre + dvec3(x * v.x - y * v.y, y * v.x + x * v.y, v.z);
    let faces = icosphere([0, 1, 2, 4, 6][maker.variant]);
    scene.triangles = faces.into_iter().map(|face| triangle(GREY, face.map(turned))).collect();
    let lights = [0.5, 3.0].map(|far| centre + far * dvec3(0.6 * y, 0.6 * x, -0.8));
    scene.lights = vec![light(0.9, lights[level % 2])];
    MadeScene { covered: true, ..scene.into() }
}

pub const NEEDLES: Family = Family {
    id: "H5",
    name: "slivers and needles as casters",
    parameter: "height / length",
    correct: "a shadow as thin as they are",
    levels: &numbers([1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7]),
    ordinary: 0,
    same_work: true,
    variants: VARIANTS,
    make: needles,
};

fn needles(maker: &mut Maker) -> MadeScene {
    let EmptyScene { mut scene, count } = empty(maker, 0.5, 1, 4.0);
    scene.triangles.extend(ground());
    let length = (200.0 / count as f64).sqrt().min(1.0);
    for i in 0..count {
        let at = dvec3(maker.between(-1.5, 1.5), maker.between(-0.8, 0.5), maker.between(3.0, 6.0));
        let (x, y) = maker.turn();
        let [along, up] = [dvec3(x, 0.2, y), dvec3(-y, 0.6, x) * maker.value].map(|side| length * side);
        scene.triangles.push(triangle(COLOURS[i % COLOURS.len()], [at - along, at + along, at + up]));
    }
    scene.lights[0].position = dvec3(maker.between(-2.0, 2.0), 3.0, maker.between(2.0, 6.0)).as_vec3();
    scene.into()
}

pub const SCALES: Family = Family {
    id: "H6",
    name: "many lights and casters of all sizes",
    parameter: "largest / ordinary",
    correct: "each light by itself",
    levels: &numbers([1.0, 1e2, 1e4, 1e6]),
    ordinary: 0,
    same_work: false,
    variants: VARIANTS,
    make: scales,
};

fn scales(maker: &mut Maker) -> MadeScene {
    let EmptyScene { mut scene, count } = empty(maker, 0.5, 2, 40.0);
    let ratio = maker.value;
    scene.lights.extend([ratio, 1.0, 1.0 / ratio].map(|scale| {
        let at = dvec3(maker.between(-0.5, 0.5), maker.between(-0.5, 0.5), 1.0);
        light(0.3, scale * maker.between(10.0, 50.0) * at)
    }));
    let of = |i: usize| [ratio, 1.0, 1.0 / ratio, 1.0][i / 2 % 4];
    fill(maker, &mut scene, 0.5, count, of, UNSHADED);
    scene.into()
}
