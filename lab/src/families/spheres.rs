//! The families of spheres, S1 to S8.

use glam::{DVec3, dvec3};

use super::maker::{BLUE, GREEN, GREY, Maker, RED, sphere, tangent};
use super::{Family, Level, MadeScene, names, numbers};
use rayo::internals::scene::Camera;

/// Integers with a^2 + b^2 = c^2. A sphere of radius c whose centre is at (a, b) from the axis
/// touches the axis exactly.
const PYTHAGOREAN: [(f64, f64, f64); 4] =
    [(3.0, 4.0, 5.0), (-8.0, 15.0, 17.0), (5.0, -12.0, 13.0), (-24.0, -7.0, 25.0)];

const FAR_LEVELS: &[Level] = &numbers([1.001, 1.01, 1.1, 1.4, 1.5, 2.0, 4.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6, 1e7]);

pub const FAR: Family = Family {
    id: "S1",
    name: "far spheres",
    parameter: "distance / radius",
    correct: "t within the bound, the normal within 1e-5 rad away from the limb",
    levels: FAR_LEVELS,
    ordinary: 6,
    same_work: true,
    variants: &["on the axis", "beside the axis", "beside the axis, two lights", "at the side of a wide picture"],
    make: far,
};

fn far(maker: &mut Maker) -> MadeScene {
    let kappa = maker.value;
    let radius = maker.between(0.5, 2.0);
    let seen = tangent(kappa, 2.0);
    let lights = if maker.variant == 2 { 2 } else { 1 };
    let (x, y) = maker.turn();
    let (camera, direction): (Camera, DVec3) = match maker.variant {
        0 => (maker.square(1.1 * seen), dvec3(0.1 * seen * x, 0.1 * seen * y, 1.0)),
        1 | 2 => {
            let off = if kappa < 2.0 { 0.5 * seen } else { 4.0 * seen };
            (maker.square(off + 1.2 * seen), dvec3(off * x, off * y, 1.0))
        }
        _ => {
            // Half a radian to the side of the axis, where the limb crosses the picture's rows at
            // an angle.
            let height = if kappa > 1e3 { 2 } else { 5 };
            let side = maker.strip(height, 0.6);
            (side, dvec3(0.5 * x.signum(), 0.0, 1.0))
        }
    };
    let mut scene = maker.scene(camera, lights, kappa * radius);
    scene.spheres.push(sphere(radius, RED, kappa * radius * direction.normalize()));
    scene.into()
}

pub const TANGENT: Family = Family {
    id: "S2",
    name: "rays that nearly touch a sphere",
    parameter: "distance from the limb / radius",
    correct: "hit where the discriminant is not negative; within the margin either is right",
    levels: &numbers([1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7]),
    ordinary: 0,
    same_work: true,
    variants: &["4 radii away", "1000 radii away", "4 radii away, two lights"],
    make: touching,
};

fn touching(maker: &mut Maker) -> MadeScene {
    let kappa: f64 = if maker.variant == 1 { 1000.0 } else { 4.0 };
    let lights = if maker.variant == 2 { 2 } else { 1 };
    let (a, b, radius) = PYTHAGOREAN[(maker.rng.next_u64() % 4) as usize];
    let distance = radius * (kappa * kappa - 1.0).sqrt() * maker.between(0.9, 1.1);
    let camera = maker.square(2.0 * maker.value * radius / distance);
    let mut scene = maker.scene(camera, lights, distance);
    scene.spheres.push(sphere(radius, GREEN, dvec3(a, b, distance)));
    scene.into()
}

/// The scales of S3 and T5.
pub const SCALES: &[Level] = &numbers([1e-24, 1e-21, 1e-18, 1e-13, 1e-10, 1e-5, 1.0, 1e5, 1e7, 1e10, 1e15, 1e20]);

pub const SCALE: Family = Family {
    id: "S3",
    name: "small and large scenes of spheres",
    parameter: "unit of length",
    correct: "the same image; the same bytes for a power of two",
    levels: SCALES,
    ordinary: 6,
    same_work: true,
    variants: &["spheres that overlap", "one sphere", "the camera inside"],
    make: scaled,
};

fn scaled(maker: &mut Maker) -> MadeScene {
    let unit = maker.value;
    let camera = maker.square(0.5);
    let mut scene = maker.scene(camera, 1 + usize::from(maker.variant != 1), 5.0 * unit);
    let centre = dvec3(maker.between(-0.5, 0.5), maker.between(-0.5, 0.5), 4.0);
    scene.spheres = match maker.variant {
        0 => vec![
            sphere(unit, RED, unit * centre),
            sphere(1.25 * unit, GREEN, unit * (centre + dvec3(0.5, 0.25, 1.0))),
            sphere(0.5 * unit, BLUE, unit * (centre - dvec3(0.75, 0.5, 0.5))),
        ],
        1 => vec![sphere(unit, GREY, unit * centre)],
        _ => vec![sphere(6.0 * unit, RED, unit * centre), sphere(unit, GREEN, unit * centre)],
    };
    scene.into()
}

pub const FILM: Family = Family {
    id: "S4",
    name: "focal distance and film",
    parameter: "focal distance, alone or with the film",
    correct: "nothing changes where both are scaled",
    levels: &numbers([1e-6, 1e-4, 1e-2, 1.0, 1e2, 1e4, 1e6]),
    ordinary: 3,
    same_work: true,
    variants: &["both scaled", "focal distance alone", "focal distance alone, two lights"],
    make: film,
};

fn film(maker: &mut Maker) -> MadeScene {
    let focal = maker.value;
    // A changed focal length alone shows a wider or narrower part of the scene. The limb is on the
    // axis, so that there is always something to see.
    let half = if maker.variant == 0 { 0.5 } else { 0.5 / focal };
    let camera = maker.square_at(focal, half);
    let lights = if maker.variant == 2 { 2 } else { 1 };
    let mut scene = maker.scene(camera, lights, 12.0);
    let (a, b, radius) = PYTHAGOREAN[0];
    let near = maker.between(8.0, 16.0);
    scene.spheres.push(sphere(radius, RED, dvec3(a, b, near)));
    scene.spheres.push(sphere(4.0, BLUE, dvec3(-3.0, -4.0, 24.0)));
    if half > 1.0 {
        // In so wide a picture most rays are far from the axis.
        scene.spheres.push(sphere(100.0, GREY, dvec3(10.0, 20.0, -30.0)));
    }
    scene.into()
}

pub const CAMERA: Family = Family {
    id: "S5",
    name: "the camera inside, on and just outside of a sphere",
    parameter: "distance from the centre / radius",
    correct: "the smallest t > 0: the far wall from inside",
    levels: &[
        Level { value: 0.0, label: "0" },
        Level { value: 0.5, label: "0.5" },
        Level { value: 0.9, label: "0.9" },
        Level { value: 0.999, label: "1 - 1e-3" },
        Level { value: 1.0 - 1e-5, label: "1 - 1e-5" },
        Level { value: 1.0 - 1e-7, label: "1 - 1e-7" },
        Level { value: 1.0, label: "1" },
        Level { value: 1.0 + 1e-7, label: "1 + 1e-7" },
        Level { value: 1.0 + 1e-5, label: "1 + 1e-5" },
        Level { value: 1.001, label: "1 + 1e-3" },
        Level { value: 1.1, label: "1.1" },
    ],
    ordinary: 1,
    same_work: true,
    variants: &["the centre ahead", "the centre behind", "the centre beside, two lights"],
    make: inside,
};

fn inside(maker: &mut Maker) -> MadeScene {
    // (2, 3, 6) has length exactly 7, so that the radius alone decides on which side of the surface
    // the camera is.
    let direction = [dvec3(2.0, 3.0, 6.0), dvec3(3.0, -2.0, -6.0), dvec3(-6.0, 3.0, 2.0)][maker.variant];
    let scale = 2f64.powi((maker.rng.next_u64() % 7) as i32 - 3);
    let (radius, centre) = if maker.value == 0.0 {
        (7.0, DVec3::ZERO)
    } else if maker.value < 0.95 {
        (7.0, maker.value * direction)
    } else {
        (7.0 / maker.value, direction)
    };
    let camera = maker.square(0.8);
    let mut scene = maker.scene(camera, 1 + usize::from(maker.variant == 2), 60.0 * scale);
    // The light is outside as well, so that it lights the far wall, whose normal points away from
    // the centre.
    scene.lights[0].position.z = 40.0 * scale as f32;
    scene.spheres.push(sphere(radius * scale, RED, scale * centre));
    scene.into()
}

pub const GROUND: Family = Family {
    id: "S6",
    name: "a sphere as the ground",
    parameter: "radius / height of the camera",
    correct: "t within the bound",
    levels: &numbers([10.0, 100.0, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8]),
    ordinary: 2,
    same_work: true,
    variants: &["one light", "two lights", "a ball on it"],
    make: ground,
};

fn ground(maker: &mut Maker) -> MadeScene {
    let radius = maker.value as f32;
    // The camera's height above the ground is 1, or one unit in the last place of the radius if
    // that is more.
    let centre = (radius + 1.0).max(radius.next_up());
    let height = f64::from(centre - radius);
    let camera = maker.square(0.5);
    let lights = if maker.variant == 0 { 1 } else { 2 };
    let mut scene = maker.scene(camera, lights, 10.0 * height);
    scene.lights[0].position.y = 6.0 * height as f32;
    scene.spheres.push(sphere(radius.into(), GREY, dvec3(0.0, -f64::from(centre), 0.0)));
    if maker.variant == 2 {
        let side = maker.between(-0.5, 0.5);
        scene.spheres.push(sphere(0.5 * height, RED, height * dvec3(side, -0.5, 4.0)));
    }
    scene.into()
}

pub const NESTED: Family = Family {
    id: "S7",
    name: "nested, touching, interpenetrating and equal spheres",
    parameter: "gap / distance",
    correct: "the nearest; the first of equals",
    levels: &[
        Level { value: 1e-1, label: "" },
        Level { value: 1e-2, label: "" },
        Level { value: 1e-4, label: "" },
        Level { value: 1e-6, label: "" },
        Level { value: 1.2e-7, label: "1 ulp" },
        Level { value: 0.0, label: "0" },
    ],
    ordinary: 0,
    same_work: true,
    variants: &["one in the other", "touching", "interpenetrating", "side by side", "three equal, two lights"],
    make: nested,
};

fn nested(maker: &mut Maker) -> MadeScene {
    let gap = maker.value;
    let camera = maker.square(0.4);
    let mut scene = maker.scene(camera, if maker.variant == 4 { 2 } else { 1 }, 5.0);
    let centre = dvec3(maker.between(-0.25, 0.25), maker.between(-0.25, 0.25), 4.0).as_vec3().as_dvec3();
    // The larger sphere is nearer. It comes last in half of the cases: the order in the file may
    // only decide between equal distances.
    let (one, other) = (sphere(1.0, RED, centre), sphere(1.0 - 4.0 * gap, GREEN, centre));
    scene.spheres = match maker.variant {
        0 if maker.rng.next_u64().is_multiple_of(2) => vec![one, other],
        0 => vec![other, one],
        1 => vec![one, sphere(0.5, GREEN, centre + dvec3(0.9, 1.2, 0.0) * (1.0 + gap))],
        2 => vec![one, sphere(1.0, GREEN, centre + dvec3(0.6 * gap, 0.8 * gap, -gap))],
        3 => vec![one, sphere(1.0, GREEN, centre + dvec3(4.0 * gap, 0.0, 0.0))],
        _ => vec![one, sphere(1.0, GREEN, centre), sphere(1.0, BLUE, centre + dvec3(0.0, 0.0, 4.0 * gap))],
    };
    scene.into()
}

pub const BEHIND: Family = Family {
    id: "S8",
    name: "spheres behind and beside the camera",
    parameter: "where the centre is",
    correct: "no hit behind; beside, what lies ahead",
    levels: &names([
        "at 2 radii",
        "at 1.001 radii",
        "at 1000 radii",
        "at 1e7 radii",
        "beside, straddling",
        "beside, touching the plane z = 0 from behind",
        "a ground sphere below, behind",
    ]),
    ordinary: 0,
    same_work: false,
    variants: &["one light", "two lights"],
    make: behind,
};

fn behind(maker: &mut Maker) -> MadeScene {
    let camera = maker.square(2.0);
    let (x, y) = maker.turn();
    let mut scene = maker.scene(camera, 1 + maker.variant, 3.0);
    let (radius, centre) = match maker.value as usize {
        0 => (1.0, dvec3(0.3 * x, 0.3 * y, -2.0)),
        1 => (1.0, dvec3(0.0, 0.0, -1.001)),
        2 => (1.0, dvec3(300.0 * x, 300.0 * y, -1000.0)),
        3 => (1.0, dvec3(x, y, -1e7)),
        4 => (1.0, dvec3(1.05 * x, 1.05 * y, -0.2)),
        5 => (1.0, dvec3(1.5 * x, 1.5 * y, -1.0)),
        _ => (1e4, dvec3(0.0, -1e4 - 1.0, -2.0)),
    };
    scene.spheres.push(sphere(radius, RED, centre));
    scene.into()
}
