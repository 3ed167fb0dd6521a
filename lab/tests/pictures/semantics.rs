//! The semantics that all tracers share: each engine on scenes whose pictures are known in advance.
//!
//! Scenes that need exact arithmetic use the camera of [`grid`], whose rays f32 holds exactly, and
//! objects with integer coordinates.

use crate::contenders::{self, Contender, Truth, contenders, levels};
use crate::extent;
use glam::{DVec3, Vec3, vec3};
use rayo::internals::render::PixelFormat;
use rayo::internals::scene::{Camera, Light, MAX_SIDE, Rng, Scene, Sphere, Triangle, many};

const WHITE: Vec3 = Vec3::ONE;
const RED: Vec3 = Vec3::X;
const GREEN: Vec3 = Vec3::Y;
const BLUE: Vec3 = Vec3::Z;

fn camera(width: u32, height: u32, focal: f32, film: f32) -> Camera {
    Camera::new(width, height, focal, film).unwrap()
}

/// A camera of 12 x 16 pixels with side 1: the ray of a row and column is exactly (col - 5.5, 7.5 -
/// row, focal), since for the aspect ratio 3/4 the root in Algorithm 1 is 5/4.
fn grid(focal: f32) -> Camera {
    camera(12, 16, focal, 20.0)
}

/// A camera of one pixel with the ray (0, 0, 1).
fn one_ray() -> Camera {
    camera(1, 1, 1.0, 1.0)
}

fn empty(camera: Camera) -> Scene {
    Scene { ..Scene::new(camera) }
}

fn light(position: Vec3) -> Light {
    Light { intensity: 1.0, colour: WHITE, position }
}

fn sphere(radius: f32, colour: Vec3, centre: Vec3) -> Sphere {
    Sphere { radius, colour, centre }
}

fn triangle(colour: Vec3, vertices: [Vec3; 3]) -> Triangle {
    Triangle { colour, vertices }
}

/// A triangle in the plane z = `z` that covers all that [`grid`] and [`one_ray`] see of the plane.
fn wall(colour: Vec3, z: f32) -> Triangle {
    triangle(colour, [vec3(-64.0, -64.0, z), vec3(192.0, -64.0, z), vec3(-64.0, 192.0, z)])
}

/// A sphere that covers a single ray; its pole is at z = 4.
fn ball(colour: Vec3) -> Sphere {
    sphere(1.0, colour, vec3(0.0, 0.0, 5.0))
}

/// The six permutations of three vertices.
fn orders([a, b, c]: [Vec3; 3]) -> [[Vec3; 3]; 6] {
    [[a, b, c], [b, c, a], [c, a, b], [c, b, a], [b, a, c], [a, c, b]]
}

/// The colour of a scene with a single pixel.
fn one(contender: &Contender, scene: &Scene) -> Vec3 {
    let [[r, g, b, _]] = contender.floats(scene)[..] else { panic!("not one pixel") };
    vec3(r, g, b)
}

#[track_caller]
fn assert_near(contender: &Contender, found: Vec3, expected: Vec3) {
    let error = (found - expected).abs().max_element();
    let bound = contender.shade_error(PixelFormat::F32x4) * expected.max_element();
    assert!(error <= bound, "{contender}: {found}, not {expected}");
}

/// The names of the colours in a picture. Each must be one of the named colours, or black, times a
/// positive number.
fn seen(contender: &Contender, scene: &Scene) -> Vec<char> {
    let name = |[r, g, b, _]: [f32; 4]| match [r > 0.0, g > 0.0, b > 0.0] {
        [false, false, false] => '.',
        [true, false, false] => 'r',
        [false, true, false] => 'g',
        [false, false, true] => 'b',
        _ => panic!("{contender}: {r} {g} {b} is of no object"),
    };
    contender.floats(scene).into_iter().map(name).collect()
}

#[track_caller]
fn assert_all(contender: &Contender, scene: &Scene, name: char) {
    let seen = seen(contender, scene);
    assert!(seen.iter().all(|seen| *seen == name), "{contender}: not all `{name}`: {}", String::from_iter(seen));
}

/// Asserts that no float of a picture is NaN and that the fourth of each pixel is 0.
#[track_caller]
fn assert_no_nan(contender: &Contender, scene: &Scene, what: &str) {
    for (i, [r, g, b, w]) in contender.floats(scene).into_iter().enumerate() {
        let fine = [r, g, b].iter().all(|v| *v >= 0.0) && w == 0.0;
        assert!(fine, "{what}: {contender} writes {r} {g} {b} {w} at pixel {i} of {scene:?}");
    }
}

// Camera

#[test]
fn each_pixel_looks_along_the_ray_of_the_camera_formula() {
    let table = [
        (12, 16, 8.0, 20.0),
        (7, 5, 1.0, 1.0),
        (16, 9, 35.0, 35.0),
        (5, 5, 0.5, 1.0),
        (1, 1, 1.0, 1.0),
        (1, 9, 1.0, 1.0),
        (9, 1, 1.0, 1.0),
        (67, 2, 2.0, 3.0),
    ];
    for (width, height, focal, film) in table {
        let camera = camera(width, height, focal, film);
        // PAPER.md's formula; each pixel gets its own small sphere on its ray.
        let relation = f64::from(width) / f64::from(height);
        let film_height = f64::from(film) / (relation * relation + 1.0).sqrt();
        let film_width = relation * film_height;
        let step = film_width / f64::from(width);
        let mut scene = empty(camera);
        scene.lights.push(light(Vec3::ZERO));
        let mut expected = Vec::new();
        for row in 0..height {
            for col in 0..width {
                let x = step * (f64::from(col) + 0.5) - film_width / 2.0;
                let y = film_height / 2.0 - step * (f64::from(row) + 0.5);
                let centre = 4.0 * DVec3::new(x, y, focal.into());
                let colour = vec3((row + 1) as f32 / 32.0, (col + 1) as f32 / 128.0, 1.0);
                scene.spheres.push(sphere((step * 0.8) as f32, colour, centre.as_vec3()));
                expected.push(colour);
            }
        }
        for contender in contenders() {
            for (i, ([r, g, b, _], expected)) in contender.floats(&scene).into_iter().zip(&expected).enumerate() {
                // The light is at the camera: a ray that misses the centre by the share b of the
                // radius sees about the colour times sqrt(1 - b^2). A result of 0.999 means a ray
                // within a hundredth of a pixel.
                let found = vec3(r, g, b);
                let error = (found - *expected).abs().max_element();
                assert!(error <= 1e-3, "{width}x{height}: {contender}: {found}, not {expected} at pixel {i}");
            }
        }
    }
}

#[test]
fn film_and_focal_distance_matter_by_their_ratio() {
    for seed in [1, 2] {
        let scene = |focal, film| Scene { camera: camera(203, 151, focal, film), ..many(12, 12, seed) };
        let (paper, small) = (scene(1.0, 1.0), scene(35.0, 35.0));
        let truth = Truth::new(&paper);
        for contender in contenders() {
            let bytes = contender.bytes(&small);
            truth.compare(&contender, &bytes).unwrap_or_else(|error| panic!("seed {seed}: {error}"));
            // Scaling by a power of two is exact for every ray.
            for factor in [2f32.powi(-40), 32.0, 2f32.powi(40)] {
                let scaled = scene(factor, factor);
                assert!(contender.floats(&scaled) == contender.floats(&paper), "{contender}: {factor} is not as 1");
                assert!(contender.bytes(&scaled) == contender.bytes(&paper), "{contender}: {factor} is not as 1");
            }
        }
    }
}

// Hits

#[test]
fn what_is_behind_the_camera_is_not_seen() {
    let mut scene = empty(grid(8.0));
    scene.lights = vec![light(Vec3::ZERO), light(vec3(0.0, 0.0, -100.0)), light(vec3(0.0, 0.0, 100.0))];
    scene.spheres = vec![sphere(3.0, RED, vec3(0.0, 0.0, -10.0)), sphere(40.0, RED, vec3(0.0, 0.0, -50.0))];
    scene.triangles = vec![wall(GREEN, -4.0), wall(GREEN, -1e6)];
    for contender in contenders() {
        assert_all(&contender, &scene, '.');
    }
}

#[test]
fn a_camera_inside_a_sphere_sees_the_far_wall() {
    for (centre, radius) in [(2.0, 5.0), (0.0, 5.0), (-2.0, 5.0), (0.0, 1e4)] {
        let far = centre + radius;
        for (z, expected) in [(2.0 * far, 1.0), (far + 1e-2 * far, 1.0), (0.5 * far, 0.0), (-2.0 * far, 0.0)] {
            let mut scene = empty(one_ray());
            scene.spheres = vec![sphere(radius, WHITE, vec3(0.0, 0.0, centre))];
            // The outside of the far wall faces away from the camera.
            scene.lights = vec![light(vec3(0.0, 0.0, z))];
            for contender in contenders() {
                assert_near(&contender, one(&contender, &scene), Vec3::splat(expected));
            }
        }
    }
}

#[test]
fn the_wall_of_a_sphere_behind_the_camera_hides_nothing() {
    // The camera is inside the red sphere: its near wall is behind the camera, its far wall behind
    // the green sphere.
    let mut scene = empty(grid(8.0));
    scene.lights = vec![light(Vec3::ZERO)];
    scene.spheres = vec![sphere(50.0, RED, Vec3::ZERO), sphere(1024.0, GREEN, vec3(0.0, 0.0, 1034.0))];
    for contender in contenders() {
        assert_all(&contender, &scene, 'g');
    }
}

#[test]
fn the_nearest_wins_in_any_order() {
    let mut scene = empty(grid(16.0));
    scene.lights = vec![light(Vec3::ZERO)];
    let near = sphere(1024.0, RED, vec3(0.0, 0.0, 1034.0));
    let far = sphere(1024.0, GREEN, vec3(0.0, 0.0, 1054.0));
    for spheres in [[near, far], [far, near]] {
        for triangles in [[wall(BLUE, 64.0), wall(GREEN, 128.0)], [wall(GREEN, 128.0), wall(BLUE, 64.0)]] {
            for contender in contenders() {
                let only = |spheres: &[Sphere], triangles: &[Triangle]| Scene {
                    spheres: spheres.to_vec(),
                    triangles: triangles.to_vec(),
                    ..scene.clone()
                };
                assert_all(&contender, &only(&spheres, &[]), 'r');
                assert_all(&contender, &only(&[], &triangles), 'b');
                assert_all(&contender, &only(&spheres, &triangles), 'r');
                assert_all(&contender, &only(&[], &[wall(BLUE, 64.0), wall(RED, 8.0), triangles[1]]), 'r');
                let before = [wall(BLUE, 4.0), triangles[0]];
                assert_all(&contender, &only(&spheres, &before), 'b');
            }
        }
    }
}

#[test]
fn of_two_equal_spheres_the_first_is_seen() {
    for (radius, centre) in [(9.0, vec3(0.0, 0.0, 20.0)), (7.3, vec3(1.7, -2.9, 23.1)), (1e3, vec3(0.1, 0.2, 0.3))] {
        let mut scene = empty(grid(8.0));
        scene.lights = vec![light(Vec3::ZERO), light(vec3(0.0, 0.0, 1e5))];
        scene.spheres = vec![sphere(radius, RED, centre), sphere(radius, GREEN, centre)];
        for contender in contenders() {
            let seen = seen(&contender, &scene);
            assert!(seen.contains(&'r') && !seen.contains(&'g'), "{contender}: {}", String::from_iter(seen));
        }
    }
}

/// The vertices of a triangle that is not parallel to the film and covers all that [`grid`] sees at
/// focal distance 16.
const TILTED: [Vec3; 3] = [Vec3::new(-96.0, -96.0, 32.0), Vec3::new(96.0, -96.0, 64.0), Vec3::new(0.0, 96.0, 48.0)];

/// Asserts that every contender sees the first of two triangles that are equally near.
fn the_first_is_seen(first: [Vec3; 3], second: [Vec3; 3]) {
    let mut scene = empty(grid(16.0));
    scene.lights = vec![light(Vec3::ZERO)];
    scene.triangles = vec![triangle(RED, first), triangle(GREEN, second)];
    for contender in contenders() {
        assert_all(&contender, &scene, 'r');
    }
}

#[test]
fn first_of_equal_triangles_is_seen_in_any_vertex_order() {
    for vertices in [wall(RED, 32.0).vertices, TILTED] {
        for first in orders(vertices) {
            for second in orders(vertices) {
                the_first_is_seen(first, second);
            }
        }
    }
}

#[test]
fn of_two_triangles_in_one_plane_the_first_is_seen() {
    // The triangle twice as large about a vertex, and rotated by half a turn about the middle of a
    // side: the same plane with other numbers.
    let [a, b, c] = TILTED;
    let others = [[a, a + 2.0 * (b - a), a + 2.0 * (c - a)], [a - (b - a), a + 2.0 * (b - a), a + 3.0 * (c - a)]];
    for other in others {
        for (first, second) in [(TILTED, other), (other, TILTED)] {
            the_first_is_seen(first, second);
        }
    }
}

#[test]
fn where_a_sphere_touches_a_triangle_the_sphere_is_seen() {
    // 3 x 4 pixels of side 1: the ray of row 0 and column 1 is (0, 1.5, 2), of length 2.5. A sphere
    // about 10 times that ray, with radius 5, is hit at its pole (0, 12, 16) with t = 8; all
    // intermediate results are integers.
    let mut scene = empty(camera(3, 4, 2.0, 5.0));
    scene.lights = vec![light(Vec3::ZERO)];
    scene.spheres = vec![sphere(5.0, RED, vec3(0.0, 15.0, 20.0))];
    scene.triangles = vec![wall(GREEN, 16.0)];
    for contender in contenders() {
        assert_eq!(seen(&contender, &scene)[1], 'r', "{contender}");
        // With a slightly nearer triangle the triangle is seen.
        let nearer = Scene { triangles: vec![wall(GREEN, 15.999)], ..scene.clone() };
        assert_eq!(seen(&contender, &nearer)[1], 'g', "{contender}");
    }
}

#[test]
fn edges_and_vertices_belong_to_a_triangle() {
    // At z = 4, rays at focal distance 2 pass through all odd integers.
    let vertices = [vec3(-3.0, -5.0, 4.0), vec3(9.0, -5.0, 4.0), vec3(-3.0, 7.0, 4.0)];
    let corner = [vec3(-11.0, 15.0, 4.0), vec3(-11.0, 13.0, 4.0), vec3(-9.0, 15.0, 4.0)];
    let expected = |row: i32, col: i32| {
        let (x, y) = (2 * col - 11, 15 - 2 * row);
        let large = x >= -3 && y >= -5 && x + y <= 4;
        let small = x <= -9 && y >= 13 && y - x >= 24;
        if large || small { 'r' } else { '.' }
    };
    let expected: Vec<_> = (0..16).flat_map(|row| (0..12).map(move |col| expected(row, col))).collect();
    assert_eq!(expected.iter().filter(|seen| **seen == 'r').count(), 28 + 3);
    for (large, small) in orders(vertices).into_iter().zip(orders(corner)) {
        let mut scene = empty(grid(2.0));
        scene.lights = vec![light(Vec3::ZERO)];
        scene.triangles = vec![triangle(RED, large), triangle(RED, small)];
        for contender in contenders() {
            let seen = seen(&contender, &scene);
            assert_eq!(String::from_iter(seen), String::from_iter(&expected), "{contender}: {large:?}");
        }
    }
}

/// Asserts that no contender sees a triangle.
fn is_never_hit(vertices: [Vec3; 3]) {
    let mut scene = empty(grid(2.0));
    scene.lights = vec![light(Vec3::ZERO), light(vec3(5.0, 5.0, -5.0))];
    scene.triangles = vec![triangle(RED, vertices)];
    for contender in contenders() {
        let seen = seen(&contender, &scene);
        assert!(!seen.contains(&'r'), "{contender}: {vertices:?}: {}", String::from_iter(seen));
    }
}

#[test]
fn a_triangle_of_no_area_is_never_hit() {
    // Points exactly on rays of the grid, at twice its focal distance.
    let (p, across, up) = (vec3(1.0, 1.0, 4.0), vec3(2.0, 0.0, 0.0), vec3(0.0, 2.0, 0.0));
    let slope = vec3(2.0, 4.0, 1.0);
    let tenths = vec3(0.1, 0.3, 3.3);
    let mut flat = vec![[p, p, p], [tenths, tenths, tenths], [Vec3::ZERO, Vec3::ZERO, Vec3::ZERO]];
    for step in [across, up, slope, across + up, p] {
        flat.extend(orders([p, p + step, p + 3.0 * step]));
        flat.extend(orders([p - step, p - step, p + 2.0 * step]));
    }
    // Collinear only after rounding to f32.
    flat.extend(orders([tenths, tenths * 2.0, tenths * 4.0]));
    flat.extend(orders([tenths, vec3(0.35, 0.55, 3.55), tenths]));
    flat.into_iter().for_each(is_never_hit);
}

#[test]
fn triangle_seen_from_its_edge_is_never_hit() {
    let (v, w) = (vec3(3.0, 1.0, 2.0), vec3(-2.0, 3.0, 1.0));
    // Around the camera, with the camera on an edge, at a vertex, and in front of the camera.
    for vertices in [[v, w, -v - w], [v, w, -v], [v, w, Vec3::ZERO], [v, w, v + w], [v, w, 4.0 * v]] {
        orders(vertices).into_iter().for_each(is_never_hit);
    }
    // Numbers with all digits of f32: -v and 2 v are exact, so that the plane passes exactly
    // through the camera, and v . n in f32 is 0 up to rounding.
    let mut rng = Rng::new(13);
    for _ in 0..200 {
        let mut point = || vec3(rng.between(-4.0, 4.0), rng.between(-4.0, 4.0), rng.between(-1.0, 4.0));
        let (v, w) = (point(), point());
        [[v, w, -v], [v, w, 2.0 * v], [v, w, Vec3::ZERO]].into_iter().for_each(is_never_hit);
    }
}

// Shading

#[test]
fn a_sphere_is_lit_from_outside_and_a_triangle_from_both_sides() {
    // The cosine at (0, 0, 4) is 0.6 for a light in a 3-4-5 triangle with the axis.
    for (position, outside) in [(vec3(4.0, 0.0, 1.0), true), (vec3(4.0, 0.0, 7.0), false), (vec3(0.0, -4.0, 1.0), true)]
    {
        let mut scene = empty(one_ray());
        scene.lights = vec![light(position)];
        scene.spheres = vec![ball(WHITE)];
        let flat = Scene { spheres: vec![], triangles: vec![wall(WHITE, 4.0)], ..scene.clone() };
        for contender in contenders() {
            let expected = if outside { Vec3::splat(0.6) } else { Vec3::ZERO };
            assert_near(&contender, one(&contender, &scene), expected);
            assert_near(&contender, one(&contender, &flat), Vec3::splat(0.6));
            for vertices in orders(flat.triangles[0].vertices) {
                let turned = Scene { triangles: vec![triangle(WHITE, vertices)], ..flat.clone() };
                assert_near(&contender, one(&contender, &turned), Vec3::splat(0.6));
            }
        }
    }
}

#[test]
fn a_light_in_the_plane_of_a_triangle_gives_nothing() {
    let mut scene = empty(one_ray());
    scene.lights = vec![light(vec3(3.0, 7.0, 4.0))];
    scene.triangles = vec![wall(WHITE, 4.0)];
    for contender in contenders() {
        assert!(one(&contender, &scene).max_element() <= 1e-6, "{contender}");
    }
}

#[test]
fn colours_multiply_channel_by_channel() {
    let mut scene = empty(one_ray());
    scene.lights = vec![Light { intensity: 0.5, colour: vec3(0.5, 0.25, 1.0), position: Vec3::ZERO }];
    for contender in contenders() {
        let ball = Scene { spheres: vec![ball(vec3(0.5, 1.0, 0.0))], ..scene.clone() };
        assert_near(&contender, one(&contender, &ball), vec3(0.125, 0.125, 0.0));
        let wall = Scene { triangles: vec![wall(vec3(0.5, 0.0, 3.0), 4.0)], ..scene.clone() };
        assert_near(&contender, one(&contender, &wall), vec3(0.125, 0.0, 1.5));
    }
}

#[test]
fn several_lights_add_up() {
    let lights = [
        Light { intensity: 1.0, colour: RED, position: vec3(4.0, 0.0, 1.0) },
        Light { intensity: 2.0, colour: vec3(0.0, 0.5, 0.25), position: Vec3::ZERO },
        Light { intensity: 0.5, colour: WHITE, position: vec3(0.0, -3.0, 0.0) },
        Light { intensity: 0.0, ..light(Vec3::ZERO) },
        Light { colour: Vec3::ZERO, ..light(Vec3::ZERO) },
        // A light without effect on the sphere.
        Light { intensity: 3.0, colour: BLUE, position: vec3(0.0, 0.0, 9.0) },
    ];
    for count in 0..=lights.len() {
        let mut scene = empty(one_ray());
        scene.lights = lights[..count].to_vec();
        let expected = [vec3(0.6, 0.0, 0.0), vec3(0.0, 1.0, 0.5), Vec3::splat(0.4), Vec3::ZERO, Vec3::ZERO, Vec3::ZERO];
        let on_sphere: Vec3 = expected[..count].iter().sum();
        let on_triangle = on_sphere + if count == lights.len() { 3.0 * BLUE } else { Vec3::ZERO };
        for contender in contenders() {
            let ball = Scene { spheres: vec![ball(WHITE)], ..scene.clone() };
            assert_near(&contender, one(&contender, &ball), on_sphere);
            let wall = Scene { triangles: vec![wall(WHITE, 4.0)], ..scene.clone() };
            assert_near(&contender, one(&contender, &wall), on_triangle);
        }
    }
}

#[test]
fn light_does_not_fade_with_distance_and_nothing_casts_a_shadow() {
    for distance in [0.01, 1.0, 4.0, 100.0, 1e6] {
        let mut scene = empty(one_ray());
        scene.lights = vec![light(vec3(0.6, 0.0, -0.8) * distance + vec3(0.0, 0.0, 4.0))];
        // A sphere between every light but the nearest and the surface.
        let block = sphere(0.25, RED, vec3(0.6, 0.0, -0.8) * 0.5 + vec3(0.0, 0.0, 4.0));
        for contender in contenders() {
            let ball = Scene { spheres: vec![ball(WHITE), block], ..scene.clone() };
            let wall = Scene { spheres: vec![block], triangles: vec![wall(WHITE, 4.0)], ..scene.clone() };
            for scene in [ball, wall] {
                let found = one(&contender, &scene);
                // The position of the light and P are rounded relative to 4, which matters more for
                // a near light.
                let bound = contender.shade_error(PixelFormat::F32x4) + 8.0 * f32::EPSILON / 2.0 * (4.0 / distance);
                assert!((found - 0.8).abs().max_element() <= bound, "{contender}: {found} from {distance}");
            }
        }
    }
}

#[test]
fn a_light_on_the_surface_contributes_nothing_and_no_nan() {
    // The hit is exactly (0, 0, 4), by the ray (0, 0, 1) at t = 4.
    let on = Light { intensity: 2.0, ..light(vec3(0.0, 0.0, 4.0)) };
    for (spheres, triangles) in [(vec![ball(WHITE)], vec![]), (vec![], vec![wall(WHITE, 4.0)])] {
        let mut scene = Scene { spheres, triangles, ..empty(one_ray()) };
        scene.lights = vec![on];
        let both = Scene { lights: vec![on, light(Vec3::ZERO)], ..scene.clone() };
        for contender in contenders() {
            let (alone, both) = (one(&contender, &scene), one(&contender, &both));
            if contender.cancels() || contender.engine.name() == "reference" {
                assert_eq!((alone, both), (Vec3::ZERO, Vec3::ONE), "{contender}");
            }
            // Engines that compute P in another way have L = 0 up to rounding, and may then get any
            // cosine in [0, 1].
            let slack = 3.0 * contender.shade_error(PixelFormat::F32x4);
            assert!((0.0..=2.0 + slack).contains(&alone.x), "{contender}: {alone}");
            assert!((1.0 - slack..=3.0 + slack).contains(&both.x), "{contender}: {both}");
        }
    }
}

// Image

#[test]
fn what_is_too_bright_is_clamped_in_8_bits_and_kept_in_floats() {
    for intensity in [1.0, 1.5, 300.0, 1e9, 1e30] {
        let mut scene = empty(one_ray());
        scene.lights = vec![Light { intensity, colour: vec3(1.0, 0.5, 0.0), position: Vec3::ZERO }];
        for scene in [
            Scene { spheres: vec![ball(WHITE)], ..scene.clone() },
            Scene { triangles: vec![wall(WHITE, 4.0)], ..scene },
        ] {
            for contender in contenders() {
                assert_near(&contender, one(&contender, &scene), intensity * vec3(1.0, 0.5, 0.0));
                let expected = levels([intensity, 0.5 * intensity, 0.0, 0.0]);
                let [found] = contender.bytes(&scene)[..] else { panic!("not one pixel") };
                assert!(contenders::difference(found, expected) <= 1, "{contender}: {found:?}, not {expected:?}");
                assert!(intensity == 1.0 || found[0] == 255, "{contender}: {found:?}");
            }
        }
    }
}

#[test]
fn a_light_beyond_all_bounds_gives_no_nan() {
    // 1e38 x 1e10 overflows f32, and a channel of 0 must stay 0.
    for (intensity, colour) in [(1e38, vec3(1e10, 1.0, 0.0)), (f32::MAX, vec3(f32::MAX, 1e-38, 0.0))] {
        let bright = |position| Light { intensity, colour, position };
        let lights = vec![bright(Vec3::ZERO), bright(vec3(3.0, 1.0, 50.0)), bright(vec3(4.0, 4.0, 4.0))];
        let many = many(20, 20, 15);
        let scene = Scene { lights, camera: camera(61, 47, 1.0, 1.0), ..many };
        for contender in contenders() {
            assert_no_nan(&contender, &scene, "huge light");
            assert!(contender.floats(&scene).iter().all(|pixel| pixel[2] == 0.0), "{contender}");
            assert!(contender.bytes(&scene).iter().any(|pixel| pixel[0] == 255), "{contender}");
        }
    }
}

#[test]
fn pictures_of_any_size_agree_with_the_reference() {
    let fixed = [(1, 1), (1, 2), (1, 67), (2, 1), (2000, 3), (3, 2000), (1, 1000), (MAX_SIDE, 1), (4099, 5)];
    let widths = extent::sampled(1..=67, 4).map(|width| (width, 9));
    for (width, height) in fixed.into_iter().chain(widths) {
        let scene = Scene { camera: camera(width, height, 1.0, 1.0), ..many(6, 6, u64::from(width)) };
        let truth = Truth::new(&scene);
        for contender in contenders() {
            truth.check(&contender, &format!("{width}x{height}"));
        }
    }
}

#[test]
fn no_scene_however_degenerate_gives_a_nan() {
    let seed = 16;
    let mut rng = Rng::new(seed);
    /// A number of any magnitude and sign, often one that occurs several times.
    fn number(rng: &mut Rng) -> f32 {
        const SPECIAL: [f32; 12] = [0.0, -0.0, 1.0, -1.0, 4.0, 1e-45, 1e-38, -1e-20, 1e15, -1e20, 1e30, f32::MAX];
        match rng.next_u64() % 4 {
            0 => SPECIAL[(rng.next_u64() % SPECIAL.len() as u64) as usize],
            1 => rng.between(-5.0, 5.0).round(),
            2 => rng.between(-5.0, 5.0),
            _ => rng.between(-1.0, 1.0) * 10f32.powf(rng.between(-44.0, 38.0)),
        }
    }
    for case in 0..if extent::all() { 20_000 } else { 2_000 } {
        let rng = &mut rng;
        // In some cases one scale for the whole scene, tiny or huge.
        let scale = if rng.next_u64().is_multiple_of(2) { 1.0 } else { 10f32.powf(rng.between(-40.0, 30.0)) };
        let mut coordinate = || {
            let number = if scale == 1.0 { number(rng) } else { rng.between(-3.0, 6.0) * scale };
            number.clamp(f32::MIN, f32::MAX)
        };
        let mut point = || vec3(coordinate(), coordinate(), coordinate());
        let points: [Vec3; 16] = std::array::from_fn(|_| point());
        let positive = |rng: &mut Rng| (number(rng).abs() * scale).clamp(1e-45, f32::MAX);
        let colour = |rng: &mut Rng| vec3(number(rng).abs(), 0.0, 1.0);
        let mut scene = empty(camera(7, 5, positive(rng), positive(rng)));
        if rng.next_u64().is_multiple_of(2) {
            scene.camera = camera(7, 5, 1.0, 1.0);
        }
        scene.lights = points[..3]
            .iter()
            .map(|&position| Light { intensity: number(rng).abs(), colour: colour(rng), position })
            .collect();
        scene.spheres = points[2..4].iter().map(|&centre| sphere(positive(rng), colour(rng), centre)).collect();
        let vertices = points[4..].as_chunks::<3>().0;
        scene.triangles = vertices.iter().map(|&vertices| triangle(colour(rng), vertices)).collect();
        for contender in contenders() {
            assert_no_nan(&contender, &scene, &format!("seed {seed}, case {case}"));
        }
    }
}
