//! Random scenes, with few objects or many, that mix what is difficult in all families.

use glam::{DVec3, Vec3, dvec3};
use proptest::collection::vec;
use proptest::option;
use proptest::prelude::*;
use proptest::sample::select;
use proptest::strategy::ValueTree;
use proptest::test_runner::{RngSeed, TestRunner};
use rayo::internals::scene::{Camera, Light, Rng, Scene, Sphere, Triangle};

/// Functions that each add an object, or a few related ones, to a scene.
const KINDS: [fn(&mut Mixer); 18] = [
    ordinary, beside, around, across, far, tangent, nested, sun, remote, sizes, ground, sliver, grazing, small, large,
    degenerate, mesh, duplicate,
];

/// How the lights of a scene are chosen: anywhere, far away, from dim to bright, beyond f32, on
/// objects, white.
const LIGHTS: [fn(&mut Mixer, Light) -> Light; 6] = [
    |_, light| light,
    |mixer, light| {
        let distance = mixer.any(&[1e6, 1e12, 1e20, 1e30]);
        Light { position: (distance * mixer.direction()).as_vec3(), ..light }
    },
    |mixer, light| Light {
        intensity: mixer.any(&[0.0, 1e-30, 1e-10, 1e-3, 1.0, 1e3, 1e10, 1e20, 1e30, 1e37]),
        ..light
    },
    |mixer, light| Light { intensity: mixer.between(0.2, 3.0) as f32 * 1e38, ..light },
    |mixer, light| Light { position: mixer.surface().as_vec3(), ..light },
    |_, light| Light { colour: Vec3::ONE, intensity: 1.0, ..light },
];

/// A scene that every engine accepts. A failing scene is shrunk to fewer and simpler objects and
/// lights.
pub fn mixture() -> impl Strategy<Value = Scene> {
    // Mostly the values usual in files, where the film's diagonal is 1.
    let focal = select(vec![1.0, 1.0, 1.0, 1.0, 0.5, 0.25, 2.0, 30.0, 1e4]);
    let film = prop_oneof![7 => Just(1.0), 1 => select(vec![1e-6, 35.0, 1e6])];
    let camera = (12..57_u32, 12..57_u32, focal, film)
        .prop_map(|(width, height, focal, film)| Camera::new(width, height, focal * film, film).unwrap());
    let seed = || any::<u64>().no_shrink();
    // Numbers of objects on both sides of the limit for tiles. Most objects are of one kind, mostly
    // the ordinary one; the others are of four kinds. Each object can be left out when a failing
    // scene is shrunk.
    let object = || option::weighted(0.999, (0..10_usize, seed()));
    let objects = prop_oneof![
        10 => vec(object(), 1..33), 3 => vec(object(), 31..33), 28 => vec(object(), 1..201), 1 => vec(object(), 200..1400)
    ];
    let main = prop_oneof![2 => Just(0), 1 => 0..KINDS.len()];
    let others = prop::array::uniform4(0..KINDS.len());
    let light = || (prop_oneof![Just(false), Just(true)], seed());
    let lights = (0..LIGHTS.len(), prop_oneof![5 => vec(light(), 0..4), 3 => vec(light(), 0..9)]);
    // The unit of length. It only affects the rounding to f32 and the range.
    let unit = prop_oneof![3 => Just(1.0), 1 => select(vec![1e-15, 1e-9, 1e-4, 0.125, 1e3, 1e7, 1e15])];
    (camera, objects, main, others, lights, unit).prop_map(|(camera, objects, main, others, (kind, lights), unit)| {
        let across = f64::from(camera.film()) / f64::from(camera.width()).hypot(f64::from(camera.height()));
        let half = |side: u32| 0.5 * across * f64::from(side) / f64::from(camera.focal());
        let scene = Scene { ..Scene::new(camera) };
        let half = (half(camera.width()), half(camera.height()));
        let mut mixer = Mixer { rng: Rng::new(0), scene, half };
        for (kind, seed) in objects.into_iter().flatten() {
            mixer.rng = Rng::new(seed);
            KINDS[*others.get(kind).unwrap_or(&main)](&mut mixer);
            mixer.leave_out_what_f32_has_not();
        }
        for (odd, seed) in lights {
            mixer.rng = Rng::new(seed);
            let light = mixer.light();
            let light = if odd { LIGHTS[kind](&mut mixer, light) } else { light };
            mixer.scene.lights.push(light);
        }
        let scaled = mixer.scene.scaled(unit);
        if scaled.check().is_ok() { scaled } else { mixer.scene }
    })
}

/// A runner that generates the same scenes in every run. PROPTEST_CASES sets their number, and
/// PROPTEST_RNG_SEED selects others.
pub fn runner() -> TestRunner {
    let default = ProptestConfig { failure_persistence: None, max_shrink_iters: 10_000, ..ProptestConfig::default() };
    let rng_seed = if default.rng_seed == RngSeed::Random { RngSeed::Fixed(1) } else { default.rng_seed };
    TestRunner::new(ProptestConfig { rng_seed, ..default })
}

/// The first scenes of the runner.
pub fn scenes(count: usize) -> impl Iterator<Item = Scene> {
    let mut runner = runner();
    (0..count).map(move |_| mixture().new_tree(&mut runner).unwrap().current())
}

/// A scene that is being generated.
struct Mixer {
    rng: Rng,
    scene: Scene,
    /// Half the width and height that the camera sees at depth 1.
    half: (f64, f64),
}

impl Mixer {
    fn whole(&mut self, below: usize) -> usize {
        (self.rng.next_u64() % below as u64) as usize
    }

    /// True once in this many times, on average.
    fn chance(&mut self, times: usize) -> bool {
        self.whole(times) == 0
    }

    fn any<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.whole(of.len())]
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.rng.next_f32())
    }

    /// A number whose logarithm is uniform, from 2^low to 2^high.
    fn size(&mut self, low: i32, high: i32) -> f64 {
        let exponent = low + self.whole((high - low) as usize) as i32;
        2f64.powi(exponent) * self.between(1.0, 2.0)
    }

    /// A uniformly random direction.
    fn direction(&mut self) -> DVec3 {
        loop {
            let v = DVec3::from([(); 3].map(|()| self.between(-1.0, 1.0)));
            if (0.01..=1.0).contains(&v.length_squared()) {
                return v.normalize();
            }
        }
    }

    /// A random direction parallel to the film.
    fn turn(&mut self) -> DVec3 {
        self.direction().with_z(0.0).normalize()
    }

    /// A point at this depth that is mostly visible.
    fn seen(&mut self, depth: f64) -> DVec3 {
        let (x, y) = (self.between(-1.1, 1.1), self.between(-1.1, 1.1));
        depth * dvec3(x * self.half.0, y * self.half.1, 1.0)
    }

    fn colour(&mut self) -> Vec3 {
        let bright = |mixer: &mut Mixer| match mixer.whole(24) {
            0 => 0.0,
            1 => 4.0,
            _ => mixer.between(0.1, 1.0) as f32,
        };
        if self.chance(8) { Vec3::splat(bright(self)) } else { Vec3::from([(); 3].map(|()| bright(self))) }
    }

    fn sphere(&mut self, radius: f64, centre: DVec3) {
        let colour = self.colour();
        self.scene.spheres.push(Sphere { radius: radius as f32, colour, centre: centre.as_vec3() });
    }

    fn triangle(&mut self, vertices: [DVec3; 3]) {
        let colour = self.colour();
        self.scene.triangles.push(Triangle { colour, vertices: vertices.map(|v| v.as_vec3()) });
    }

    /// A triangle around a point, of about this size; `height` is about its height divided by its
    /// length.
    fn triangle_at(&mut self, centre: DVec3, size: f64, height: f64) {
        let along = self.direction();
        let across = along.cross(self.direction()) * height;
        let [a, b, c] = [-1.0, 1.0, 0.0].map(|share: f64| centre + size * (share + self.between(-0.3, 0.3)) * along);
        self.triangle([a, b, c + size * across]);
    }

    fn ordinary_at(&mut self, depth: f64) {
        let centre = self.seen(depth);
        let size = depth * self.half.1 * self.between(0.03, 0.4);
        if self.chance(2) {
            self.sphere(size, centre);
        } else {
            self.triangle_at(centre, 1.5 * size, 1.0);
        }
    }

    /// An ordinary light, often coloured.
    fn light(&mut self) -> Light {
        let colour = if self.chance(3) { Vec3::ONE } else { self.colour().min(Vec3::ONE) };
        let position = (self.size(-1, 7) * self.direction()).as_vec3();
        Light { intensity: self.between(0.1, 1.0) as f32, colour, position }
    }

    /// A point on, in or close to an object.
    fn surface(&mut self) -> DVec3 {
        let direction = self.direction();
        let share = self.any(&[0.0, 0.5, 1.0, 1.001, 1.1]);
        match (&self.scene.spheres[..], &self.scene.triangles[..]) {
            ([first, ..], _) => first.centre.as_dvec3() + share * f64::from(first.radius) * direction,
            (_, [first, ..]) => first.vertices[0].as_dvec3().lerp(first.vertices[1].as_dvec3(), share),
            _ => direction,
        }
    }

    fn leave_out_what_f32_has_not(&mut self) {
        self.scene.spheres.retain(|s| s.radius > 0.0 && s.radius.is_finite() && s.centre.is_finite());
        self.scene.triangles.retain(|t| t.vertices.iter().all(|v| v.is_finite()));
    }
}

/// An object that is easy to see, at some depth.
fn ordinary(mixer: &mut Mixer) {
    let depth = mixer.between(2.0, 60.0);
    mixer.ordinary_at(depth);
}
/// An object that is only just in front of the plane z = 0 as a whole.
fn beside(mixer: &mut Mixer) {
    let radius = mixer.size(-6, 8);
    let (hair, far) = (mixer.between(0.0, 1.0), mixer.between(0.3, 2.5));
    let centre = radius * (far * mixer.turn() + (1.0005 + 0.0495 * hair * hair) * DVec3::Z);
    mixer.sphere(radius, centre);
}

fn around(mixer: &mut Mixer) {
    let radius = mixer.size(-4, 14);
    let share = mixer.between(0.0, 0.99);
    let kappa = mixer.any(&[0.0, share, share, 1.0 - 1e-3, 1.0 - 1e-5, 1.0 - 1e-7, 1.0]);
    let centre = kappa * radius * mixer.direction();
    mixer.sphere(radius, centre);
}

fn across(mixer: &mut Mixer) {
    let radius = mixer.size(-4, 8);
    let share = mixer.between(1.02, 3.0);
    let kappa = mixer.any(&[share, share, 1.0 + 1e-7, 1.0 + 1e-5, 1.001, 1e3]);
    let direction = mixer.direction();
    let centre = if mixer.chance(2) { direction.with_z(-direction.z.abs()) } else { direction };
    mixer.sphere(radius, kappa * radius * centre);
}

/// A far object, from a tenth of a pixel to the whole picture in size.
fn far(mixer: &mut Mixer) {
    let distance = mixer.size(-3, 24);
    let radius = distance * mixer.half.1 * mixer.size(-8, 0);
    let centre = mixer.seen(distance);
    mixer.sphere(radius, centre);
}

/// A sphere that the axis touches exactly, in integers.
fn tangent(mixer: &mut Mixer) {
    let (a, b, radius) = mixer.any(&[(3.0, 4.0, 5.0), (-8.0, 15.0, 17.0), (5.0, -12.0, 13.0), (-24.0, -7.0, 25.0)]);
    let distance = radius * mixer.size(0, 10);
    mixer.sphere(radius, dvec3(a, b, distance));
}

const GAPS: [f64; 7] = [1e-1, 1e-2, 1e-4, 1e-5, 1e-6, 1.2e-7, 0.0];

/// A sphere inside another, or two beside or through each other; or two triangles, one behind the
/// other.
fn nested(mixer: &mut Mixer) {
    let depth = mixer.between(2.0, 30.0);
    let (centre, size) = (mixer.seen(depth), depth * mixer.half.1 * 0.3);
    let gap = mixer.any(&GAPS);
    if mixer.chance(3) {
        mixer.triangle_at(centre, size, 1.0);
        let mut other = *mixer.scene.triangles.last().expect("one was just added");
        other.vertices = other.vertices.map(|v| (v.as_dvec3() * (1.0 + gap)).as_vec3());
        other.colour = mixer.colour();
        mixer.scene.triangles.push(other);
        return;
    }
    mixer.sphere(size, centre);
    match mixer.whole(3) {
        0 => mixer.sphere(size * (1.0 - gap), centre),
        1 => {
            let touching = centre + (1.5 + gap) * size * mixer.direction();
            mixer.sphere(0.5 * size, touching);
        }
        _ => {
            let beside = centre + gap * size * mixer.direction();
            mixer.sphere(size, beside);
        }
    }
}

/// The sun in metres: seen, beside or behind the camera, often with a light in it.
fn sun(mixer: &mut Mixer) {
    let seen = mixer.seen(1.0).normalize();
    let direction = if mixer.chance(2) { seen } else { mixer.direction() };
    let centre = 1.4e11 * direction;
    mixer.sphere(7e8, centre);
    if mixer.chance(2) {
        let light = mixer.light();
        mixer.scene.lights.push(Light { position: centre.as_vec3(), ..light });
    }
}

/// An ordinary object at a much larger distance, of a much larger size, or both.
fn remote(mixer: &mut Mixer) {
    let factor = mixer.size(50, 93);
    let depth = mixer.between(2.0, 60.0);
    let (near, far) = (mixer.seen(depth), mixer.seen(factor));
    let size = depth * mixer.half.1 * mixer.between(0.03, 0.4);
    let beyond = mixer.direction() * factor;
    match mixer.whole(5) {
        0 => mixer.sphere(factor * mixer.half.1 * 0.2, far),
        1 => mixer.sphere(size, beyond),
        2 => mixer.sphere(size * factor, near),
        3 => mixer.triangle_at(far, factor * mixer.half.1 * 0.2, 1.0),
        _ => mixer.triangle_at(near, factor, 1.0),
    }
}

/// An ordinary object in a unit of length that is up to 10^12 times as small or large.
fn sizes(mixer: &mut Mixer) {
    let unit = mixer.any(&[1e-12, 1e-8, 1e-8, 1e8, 1e8, 1e12]);
    let depth = unit * mixer.between(2.0, 60.0);
    mixer.ordinary_at(depth);
}

fn ground(mixer: &mut Mixer) {
    let radius = mixer.any(&[10.0, 1e3, 1e5, 1e7]);
    let height = mixer.between(0.5, 3.0);
    let ahead = mixer.between(-1.0, 1.0);
    mixer.sphere(radius, dvec3(0.0, -radius - height, ahead));
}

fn sliver(mixer: &mut Mixer) {
    let depth = mixer.between(2.0, 60.0);
    let centre = mixer.seen(depth);
    let height = mixer.any(&[1e-1, 1e-2, 1e-3, 1e-5, 1e-7]);
    mixer.triangle_at(centre, depth * mixer.half.1 * 0.7, height);
}

/// An object in a plane that passes close to the camera.
fn grazing(mixer: &mut Mixer) {
    let slope = mixer.any(&[1e-1, 1e-2, 1e-3, 1e-5, 1e-7, 0.0]);
    let x = mixer.turn();
    let y = dvec3(-x.y, x.x, 0.0);
    let wide = mixer.half.1;
    let on = |across: f64, z: f64| across * wide * x + slope * (z - 4.0) * y + z * DVec3::Z;
    let [near, far] = [mixer.between(-1.0, 3.0), mixer.between(6.0, 90.0)];
    mixer.triangle([on(-0.5 * near, near), on(0.6 * near, near), on(0.1 * far, far)]);
}

fn small(mixer: &mut Mixer) {
    let depth = mixer.size(0, 20);
    let centre = mixer.seen(depth);
    let size = depth * mixer.half.1 * mixer.size(-12, -3);
    mixer.triangle_at(centre, size, 1.0);
}

fn large(mixer: &mut Mixer) {
    let depth = mixer.between(2.0, 60.0);
    let centre = mixer.seen(depth);
    let size = depth * mixer.any(&[1.0, 10.0, 1e3, 1e5, 1e9]);
    mixer.triangle_at(centre, size, 1.0);
}

/// A triangle without area or in a plane through the camera, exactly or up to rounding; behind the
/// camera, or across z = 0.
fn degenerate(mixer: &mut Mixer) {
    let depth = mixer.between(2.0, 60.0);
    let [a, b] = [mixer.seen(depth), mixer.seen(0.5 * depth)];
    let tiny = mixer.any(&[0.0, 1e-7, 1e-12]) * mixer.direction();
    let vertices = match mixer.whole(7) {
        0 => [a, a, b],
        1 => [a, b, a.lerp(b, 0.25) + tiny],
        2 => [a, b, tiny],
        3 => [a, b, 2.0 * a - b + tiny],
        4 => [a, -b, a.cross(b) + tiny],
        5 => [-a, -b, -a.cross(b)],
        _ => [a, b, dvec3(a.y, -b.x, -depth)],
    };
    mixer.triangle(vertices);
}

/// A closed mesh, in front of the camera or around it.
fn mesh(mixer: &mut Mixer) {
    let size = mixer.size(-2, 4);
    let centre = if mixer.chance(3) {
        0.2 * size * mixer.direction()
    } else {
        let depth = size * 3.0 / mixer.half.1;
        mixer.seen(depth)
    };
    let x = mixer.direction();
    let (y, z) = x.any_orthonormal_pair();
    for face in 0..8 {
        let sign = |bit: i32| if face & bit == 0 { size } else { -size };
        mixer.triangle([centre + sign(1) * x, centre + sign(2) * y, centre + sign(4) * z]);
    }
}

/// A copy of an existing object in another colour.
fn duplicate(mixer: &mut Mixer) {
    let count = mixer.scene.spheres.len() + mixer.scene.triangles.len();
    let (i, colour) = (mixer.whole(count.max(1)), mixer.colour());
    if let Some(sphere) = mixer.scene.spheres.get(i) {
        mixer.scene.spheres.push(Sphere { colour, ..*sphere });
    } else if let Some(triangle) = mixer.scene.triangles.get(i - mixer.scene.spheres.len()) {
        mixer.scene.triangles.push(Triangle { colour, ..*triangle });
    }
}
