//! What the families build cases from: a case's value, variant and random numbers, and parts of
//! scenes.

use std::f64::consts::SQRT_2;

use glam::{DVec3, Vec3};

use rayo::internals::scene::direction;
use rayo::internals::scene::{Camera, Light, MAX_SIDE, Rng, Scene, Sphere, Triangle};

pub const RED: Vec3 = Vec3::new(1.0, 0.25, 0.125);
pub const GREEN: Vec3 = Vec3::new(0.125, 1.0, 0.25);
pub const BLUE: Vec3 = Vec3::new(0.25, 0.125, 1.0);
pub const GREY: Vec3 = Vec3::new(0.75, 0.75, 0.75);

/// A case that is being made.
pub struct Maker {
    /// The value of the parameter at this level.
    pub value: f64,
    /// The index of the variant.
    pub variant: usize,
    pub side: u32,
    pub rng: Rng,
}

impl Maker {
    pub fn new(value: f64, variant: usize, seed: u64, index: usize, side: u32) -> Self {
        // Each case has random numbers of its own.
        let mut rng = Rng::new(seed ^ ((index as u64) << 32));
        rng.next_u64();
        Maker { value, variant, side, rng }
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.rng.next_f32())
    }

    /// A direction in the plane of the film.
    pub fn turn(&mut self) -> (f64, f64) {
        let (x, y) = direction(&mut self.rng);
        (x.into(), y.into())
    }

    /// A square picture that extends `half` to each side at distance 1; the focal distance is
    /// `focal`.
    pub fn square_at(&self, focal: f64, half: f64) -> Camera {
        camera(self.side, self.side, focal, 2.0 * SQRT_2 * half * focal)
    }

    /// As [`square_at`](Self::square_at), with the focal distance 1.
    pub fn square(&self, half: f64) -> Camera {
        self.square_at(1.0, half)
    }

    /// A picture of `height` rows and about side x side pixels, which is no wider than a picture may
    /// be and is seen as far as `half` to both sides.
    pub fn strip(&self, height: u32, half: f64) -> Camera {
        let width = (self.side * self.side).div_ceil(height).min(MAX_SIDE);
        let relation = f64::from(width) / f64::from(height);
        camera(width, height, 1.0, 2.0 * half * (1.0 + 1.0 / (relation * relation)).sqrt())
    }

    /// A scene without objects under `count` lights. The first light is behind the camera and to
    /// the side. `scale` is a typical length of the scene.
    pub fn scene(&mut self, camera: Camera, count: usize, scale: f64) -> Scene {
        let (x, y) = self.turn();
        let side = self.between(0.3, 1.2);
        let positions = [DVec3::new(side * x, side * y, -0.5), DVec3::new(-2.0 * y, 2.0 * x, 0.25)];
        let light = |(position, intensity): (&DVec3, f32)| light(intensity, scale * *position);
        let lights = positions[..count].iter().zip([0.9, 0.4]).map(light).collect();
        Scene { name: "case.png".into(), lights, ..Scene::new(camera) }
    }
}

pub fn camera(width: u32, height: u32, focal: f64, film: f64) -> Camera {
    Camera::new(width, height, focal as f32, film as f32).expect("a case's camera is within the limits")
}

pub fn light(intensity: f32, position: DVec3) -> Light {
    Light { intensity, colour: Vec3::new(1.0, 0.9, 0.8), position: position.as_vec3() }
}

pub fn sphere(radius: f64, colour: Vec3, centre: DVec3) -> Sphere {
    Sphere { radius: radius as f32, colour, centre: centre.as_vec3() }
}

pub fn triangle(colour: Vec3, vertices: [DVec3; 3]) -> Triangle {
    Triangle { colour, vertices: vertices.map(|v| v.as_vec3()) }
}

/// The tangent of half the angle that a sphere at distance `kappa` radii subtends, at most `most`.
pub fn tangent(kappa: f64, most: f64) -> f64 {
    if kappa <= 1.0 { most } else { (1.0 / (kappa * kappa - 1.0).sqrt()).min(most) }
}

/// The triangles of an icosahedron whose faces have been divided into four `divisions` times, with
/// all vertices on the unit sphere.
pub fn icosphere(divisions: u32) -> Vec<[DVec3; 3]> {
    let g = (1.0 + 5f64.sqrt()) / 2.0;
    // The vertices are the cyclic permutations of (+-1, +-g, 0); three that are 2 apart are a face.
    let signs = [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)];
    let corners: Vec<DVec3> = signs
        .iter()
        .flat_map(|(a, b)| [DVec3::new(*a, b * g, 0.0), DVec3::new(0.0, *a, b * g), DVec3::new(b * g, 0.0, *a)])
        .collect();
    let near = |a: DVec3, b: DVec3| (a.distance(b) - 2.0).abs() < 1e-6;
    let mut faces = Vec::new();
    for (i, a) in corners.iter().enumerate() {
        for (j, b) in corners.iter().enumerate().skip(i + 1) {
            for c in corners.iter().skip(j + 1) {
                if near(*a, *b) && near(*b, *c) && near(*a, *c) {
                    faces.push([*a, *b, *c].map(DVec3::normalize));
                }
            }
        }
    }
    for _ in 0..divisions {
        let divide = |[a, b, c]: [DVec3; 3]| {
            // A midpoint has the same bits whichever end comes first.
            let [d, e, f] = [a + b, b + c, c + a].map(DVec3::normalize);
            [[a, d, f], [d, b, e], [f, e, c], [d, e, f]]
        };
        faces = faces.into_iter().flat_map(divide).collect();
    }
    faces
}
