//! The families L3, of cameras and lights near the same surface, and V1, of wide films.

use std::f64::consts::FRAC_1_SQRT_2;

use glam::{DVec3, dvec3};

use super::maker::{BLUE, GREEN, GREY, Maker, RED, light, sphere, triangle};
use super::{Family, Level, MadeScene, numbers};
use rayo::internals::scene::Scene;

/// For each variant of L3 the distance of the camera from the sphere's centre, in radii, and the
/// brightness of the light.
const CAMERAS: [(f64, f32); 7] =
    [(1.001, 10.0), (1.01, 10.0), (1.5, 3.0), (4.0, 10.0), (1000.0, 0.9), (0.9, 10.0), (1.0 - 1e-6, 3.0)];

pub const NEAR_LIGHTS: Family = Family {
    id: "L3",
    name: "a light near a sphere that the camera is near",
    parameter: "height of the light / radius",
    correct: "the direction of the light, wherever it is 1e-4 of the distance or more away",
    levels: &[
        Level { value: 1.0, label: "" },
        Level { value: 0.1, label: "" },
        Level { value: 1e-2, label: "" },
        Level { value: 1e-3, label: "" },
        Level { value: 1e-4, label: "" },
        Level { value: 1e-5, label: "" },
        Level { value: 1e-6, label: "" },
        Level { value: 1e-7, label: "" },
        Level { value: 0.0, label: "on the surface" },
        Level { value: -1e-6, label: "1e-6 inside" },
        Level { value: -1e-4, label: "1e-4 inside" },
        Level { value: -1e-2, label: "1e-2 inside" },
    ],
    ordinary: 0,
    same_work: true,
    variants: &[
        "1.001 radii away, bright",
        "1.01 radii away, bright",
        "1.5 radii away, bright",
        "4 radii away, bright",
        "1000 radii away",
        "inside, bright",
        "inside, next to the wall, bright",
    ],
    make: near_light,
};

fn near_light(maker: &mut Maker) -> MadeScene {
    let (kappa, intensity) = CAMERAS[maker.variant];
    let half = if kappa > 2.0 { 1.2 / kappa } else { 0.5 };
    let camera = maker.square(half);
    let radius = maker.between(0.5, 2.0);
    // The sphere is ahead of the camera, and slightly to the side if that leaves all of it far
    // enough in front.
    let off = if kappa > 1.0 { 0.1 * (kappa - 1.0).min(1.0) / kappa } else { 0.1 };
    let (x, y) = maker.turn();
    let ball = sphere(radius, GREY, kappa * radius * dvec3(off * x, off * y, 1.0));
    let (centre, radius) = (ball.centre.as_dvec3(), f64::from(ball.radius));
    // The light is above a point that the camera sees.
    let (x, y) = maker.turn();
    let ray = centre / centre.z + 0.3 * half * dvec3(x, y, 0.0);
    let point = first_point(ray, centre, radius);
    let normal = (point - centre) / radius;
    let mut scene = Scene { lights: Vec::new(), ..maker.scene(camera, 1, 1.0) };
    scene.lights.push(light(intensity, point + maker.value * radius * normal));
    // At most levels everything near the light is white. Another light, which is dim and far from
    // the surface, shows the rest.
    scene.lights.push(light(0.2, 3.0 * radius * dvec3(y, -x, -0.5)));
    scene.spheres.push(ball);
    scene.into()
}

/// The first point of a sphere on a ray, which must meet it.
fn first_point(ray: DVec3, centre: DVec3, radius: f64) -> DVec3 {
    let (a, h) = (ray.dot(ray), ray.dot(centre));
    let k = (centre.length() - radius) * (centre.length() + radius);
    let root = (h * h - a * k).max(0.0).sqrt();
    ray * if k > 0.0 { k / (h + root) } else { (h + root) / a }
}

pub const WIDE: Family = Family {
    id: "V1",
    name: "wide films",
    parameter: "half of the film / focal distance",
    correct: "as in any film: the nearest, in its colour, at the border of the picture too",
    levels: &numbers([0.5, 3.0, 10.0, 100.0, 1e3, 3e3, 1e4, 1e5]),
    ordinary: 0,
    same_work: false,
    variants: &[
        "spheres beside the camera",
        "spheres and triangles at the border",
        "inside of a sphere, a light far away",
        "next to the wall inside, a light far away",
    ],
    make: wide,
};

fn wide(maker: &mut Maker) -> MadeScene {
    let half = maker.value;
    let camera = maker.square(half);
    let mut scene = maker.scene(camera, 1, 2.0 * half);
    if maker.variant < 2 {
        for colour in [RED, GREEN, BLUE] {
            let depth = maker.between(1.1, 6.0);
            // The sphere is near a diagonal of the picture, where neither columns nor rows are
            // parallel to an axis of its outline.
            let (mut x, mut y) = maker.turn();
            (x, y) = (x + x.signum() * FRAC_1_SQRT_2, y + y.signum() * FRAC_1_SQRT_2);
            let centre = depth * (0.5 * half * maker.between(0.2, 1.0) * dvec3(x, y, 0.0) + DVec3::Z);
            scene.spheres.push(sphere(1.0, colour, centre));
            scene.lights.push(light(0.5, centre + dvec3(-10.0 * x, 5.0 * y, -depth)));
        }
    }
    if maker.variant == 1 {
        let (a, b) = (0.9 * half, 0.5 * half);
        scene.triangles.push(triangle(GREY, [dvec3(a, b, 1.0), dvec3(-a, a, 1.5), dvec3(b, -a, 2.0)]));
    }
    if maker.variant >= 2 {
        let kappa = if maker.variant == 2 { 0.75 } else { 1.0 - maker.between(5e-6, 5e-5) };
        let (x, y) = maker.turn();
        scene.spheres.push(sphere(1.0, GREY, kappa * dvec3(x, y, -0.025).normalize()));
        scene.spheres.push(sphere(1.0, BLUE, dvec3(x, -20.0, 1.0)));
        scene.lights[0] = light(0.9, 1e15 * dvec3(-y, x, 0.3).normalize());
    }
    scene.into()
}
