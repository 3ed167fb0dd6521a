//! Shadows: scenes whose light is known in advance, by every engine with shadows, and by the
//! engines without.

use crate::contenders::{Contender, contenders, difference};
use glam::{DMat3, DVec3, Vec3, vec3};
use rayo::internals::render::{Engine, PixelFormat};
use rayo::internals::scene::mesh::shapes::icosphere;
use rayo::internals::scene::{Camera, Light, Rng, Scene, Sphere, Triangle, View, many};

const WHITE: Vec3 = Vec3::ONE;

fn light(position: Vec3) -> Light {
    Light { intensity: 1.0, colour: WHITE, position }
}

fn sphere(radius: f32, centre: Vec3) -> Sphere {
    Sphere { radius, colour: WHITE, centre }
}

fn triangle(vertices: [Vec3; 3]) -> Triangle {
    Triangle { colour: WHITE, vertices }
}

/// Two triangles that form a parallelogram with this corner and these sides.
fn quad(corner: Vec3, [a, b]: [Vec3; 2]) -> [Triangle; 2] {
    [[corner, corner + a, corner + b], [corner + a + b, corner + a, corner + b]].map(triangle)
}

/// The plane y = -1, in front of the camera and behind it.
fn ground() -> [Triangle; 2] {
    quad(vec3(-64.0, -1.0, -64.0), [vec3(128.0, 0.0, 0.0), vec3(0.0, 0.0, 128.0)])
}

/// A scene with shadows and a film so wide that the field of view is a right angle.
fn shadowed(width: u32, height: u32) -> Scene {
    Scene { shadows: true, ..Scene::new(Camera::new(width, height, 1.0, 2.5).unwrap()) }
}

/// The contenders whose engines have shadows.
fn casting() -> impl Iterator<Item = Contender> {
    contenders().into_iter().filter(|contender| contender.engine.has_shadows())
}

/// Whether each pixel is lit.
fn lit(contender: &Contender, scene: &Scene) -> Vec<bool> {
    contender.floats(scene).into_iter().map(|[r, g, b, _]| r.max(g).max(b) > 0.0).collect()
}

fn ray(scene: &Scene, pixel: usize) -> DVec3 {
    let width = scene.camera.width() as usize;
    DVec3::from_array(scene.camera.grid::<f64>().ray((pixel / width) as u32, (pixel % width) as u32))
}

/// Compares which pixels are lit with what is known for some rays; returns the numbers of dark and
/// of lit pixels among those.
fn check_lit(contender: &Contender, scene: &Scene, known: impl Fn(DVec3) -> Option<bool>) -> [usize; 2] {
    let mut found = [0; 2];
    for (pixel, lit) in lit(contender, scene).into_iter().enumerate() {
        let Some(expected) = known(ray(scene, pixel)) else { continue };
        assert_eq!(lit, expected, "{contender}: pixel {pixel}");
        found[usize::from(lit)] += 1;
    }
    found
}

/// A closed mesh around the origin, rotated so that nothing is parallel to an axis.
fn closed(corners: impl Iterator<Item = [DVec3; 3]>) -> Vec<Triangle> {
    let turn = DMat3::from_rotation_x(0.4) * DMat3::from_rotation_y(0.7) * DMat3::from_rotation_z(1.1);
    corners.map(|corners| triangle(corners.map(|corner| (turn * corner).as_vec3()))).collect()
}

fn cube() -> Vec<Triangle> {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let faces = (0..6).flat_map(|i| {
        let [n, u, v] = [0, 1, 2].map(|j| axes[(i + j) % 3]);
        let n = if i < 3 { n } else { -n };
        let [a, b, c, d] = [n - u - v, n + u - v, n + u + v, n - u + v];
        [[a, b, c], [a, c, d]]
    });
    closed(faces)
}

fn rock() -> Vec<Triangle> {
    let rock = icosphere(1280, 0.3, 7);
    let corners = rock.triangles.iter().map(|corners| corners.map(|corner| rock.vertices[corner as usize].as_dvec3()));
    closed(corners)
}

#[test]
fn the_shadow_of_a_sphere_on_a_ground_is_the_conic_of_its_cone() {
    for (at, centre, radius) in [
        (vec3(0.0, 4.0, 5.0), vec3(0.0, 1.0, 5.0), 0.5),
        (vec3(-2.0, 3.0, 3.0), vec3(-0.5, 0.75, 5.0), 0.75),
        (vec3(9.0, 5.0, -3.0), vec3(2.0, 0.5, 6.0), 1.25),
    ] {
        let mut scene = shadowed(403, 301);
        scene.lights = vec![light(at)];
        scene.spheres = vec![sphere(radius, centre)];
        scene.triangles = ground().to_vec();
        let (at, centre, r2) = (at.as_dvec3(), centre.as_dvec3(), f64::from(radius * radius));
        let axis = centre - at;
        for contender in casting() {
            let [dark, bright] = check_lit(&contender, &scene, |ray| {
                let p = ray / -ray.y;
                let beside = ray.dot(ray) * r2 < centre.cross(ray).length_squared();
                let e = p - at;
                // The squared cosines of the angle to the axis and of the cone's half angle, both
                // multiplied by the same lengths to the fourth power.
                let (along, cone) = (e.dot(axis).powi(2), e.length_squared() * (axis.length_squared() - r2));
                let is_ground = ray.y < 0.0 && p.z <= 60.0 && beside;
                (is_ground && (along - cone).abs() > 1e-4 * cone).then_some(along < cone)
            });
            assert!(dark > 300 && bright > 10_000, "{contender}: {dark} dark and {bright} bright");
        }
    }
}

/// Seen from the wall the sphere is 10^8 radii away: its radius is lost in the rounding of the
/// distance squared.
#[test]
fn the_shadow_of_a_sphere_far_away_is_as_large_as_that_is() {
    let (at, centre, radius) = (vec3(0.0, 3.2e8, -9.6e8), vec3(0.0, 1e7, -3e7), 0.3);
    let mut scene = shadowed(101, 75);
    (scene.lights, scene.spheres) = (vec![light(at)], vec![sphere(radius, centre)]);
    scene.triangles = vec![triangle([vec3(-64.0, -64.0, 1.0), vec3(192.0, -64.0, 1.0), vec3(-64.0, 192.0, 1.0)])];
    for contender in casting().filter(|contender| contender.engine != Engine::Rust) {
        let [dark, _] = check_lit(&contender, &scene, |p| {
            let (q, g) = (centre.as_dvec3() - p, at.as_dvec3() - p);
            let beside = q.cross(g).length() / g.length() - f64::from(radius);
            (beside.abs() > 1e-4).then_some(beside > 0.0)
        });
        assert!(dark > 300, "{contender}: {dark} dark");
    }
}

#[test]
fn the_shadow_of_a_sliver_is_its_projection() {
    // The sliver is at the camera's height, so that it is seen edge-on, and so thin that its normal
    // loses digits.
    let (at, thin) = (vec3(0.5, 3.0, 5.0), 0.0625);
    let mut scene = shadowed(403, 301);
    scene.lights = vec![light(at)];
    scene.triangles = ground().to_vec();
    scene.triangles.push(triangle([vec3(-8.0, 0.0, 3.0), vec3(8.0, 0.0, 3.0), vec3(8.0, 0.0, 3.0 + thin)]));
    for contender in casting() {
        let [dark, bright] = check_lit(&contender, &scene, |ray| {
            let p = ray / -ray.y;
            // The point of the segment to the light at the sliver's height, and how far it is
            // inside the sliver.
            let q = p + (at.as_dvec3() - p) / 4.0;
            let within = (q.z - 3.0).min(f64::from(thin) * (q.x + 8.0) / 16.0 + 3.0 - q.z).min(8.0 - q.x);
            (ray.y < 0.0 && p.z <= 60.0 && within.abs() > 1e-5).then_some(within < 0.0)
        });
        assert!(dark > 200 && bright > 10_000, "{contender}: {dark} dark and {bright} bright");
    }
}

#[test]
fn a_ground_of_any_size_hides_what_is_below_it() {
    let mut scene = shadowed(67, 51);
    scene.lights = vec![light(vec3(0.0, -2.0, 3.0))];
    let wall = [vec3(-2.0, -1.0, 4.0), vec3(2.0, -1.0, 4.0), vec3(0.0, 2.0, 4.0)];
    for size in [64.0, 1e8, 1e14] {
        for contender in casting() {
            scene.triangles = vec![triangle(wall)];
            assert!(lit(&contender, &scene).contains(&true), "{contender}");
            // Its nearest corner tells where it is.
            let corners = [vec3(-size, -1.0, size), vec3(size, -1.0, size), vec3(0.0, -1.0, -8.0)];
            scene.triangles.push(triangle(corners));
            assert!(!lit(&contender, &scene).contains(&true), "{contender}: {size}");
        }
    }
}

#[test]
fn what_is_between_hides_and_what_is_not_does_not() {
    // The only pixel sees the wall at (0, 0, 4).
    let wall = triangle([vec3(-64.0, -64.0, 4.0), vec3(192.0, -64.0, 4.0), vec3(-64.0, 192.0, 4.0)]);
    let at = vec3(0.0, 4.0, 0.0);
    let across = |y: f32, z: f32| [vec3(-1.0, y - 1.0, z), vec3(1.0, y - 1.0, z), vec3(0.0, y + 1.0, z)];
    let half = [vec3(0.0, 1.0, 2.0), vec3(0.0, 3.0, 2.0), vec3(2.0, 2.0, 2.0)];
    let table: [(&str, Vec<Sphere>, Vec<Triangle>, bool); 18] = [
        ("nothing", vec![], vec![], true),
        ("a sphere between", vec![sphere(0.5, vec3(0.0, 2.0, 2.0))], vec![], false),
        ("a sphere beside", vec![sphere(0.5, vec3(1.0, 2.0, 2.0))], vec![], true),
        ("a sphere behind the light", vec![sphere(0.5, vec3(0.0, 5.0, -1.0))], vec![], true),
        ("a sphere behind the wall", vec![sphere(0.5, vec3(0.0, -1.0, 5.0))], vec![], true),
        ("a sphere behind the camera", vec![sphere(0.5, vec3(0.0, 0.0, -2.0))], vec![], true),
        ("a sphere around the light", vec![sphere(0.5, vec3(0.0, 4.0, 0.25))], vec![], false),
        ("a sphere that the light is on, behind it", vec![sphere(1.0, vec3(0.0, 5.0, 0.0))], vec![], true),
        ("a sphere that the light is on, before it", vec![sphere(1.0, vec3(0.0, 4.0, 1.0))], vec![], false),
        ("a sphere around everything", vec![sphere(64.0, vec3(0.0, 2.0, 2.0))], vec![], true),
        ("a triangle between", vec![], vec![triangle(across(2.0, 2.0))], false),
        ("a triangle's edge between", vec![], vec![triangle(half)], false),
        (
            "a triangle's corner between",
            vec![],
            vec![triangle([vec3(0.0, 2.0, 2.0), vec3(2.0, 1.5, 2.0), vec3(2.0, 2.5, 2.0)])],
            false,
        ),
        ("a triangle beside", vec![], vec![triangle(across(5.5, 2.0))], true),
        ("a triangle behind the light", vec![], vec![triangle(across(5.0, -1.0))], true),
        ("a triangle that the light is in", vec![], vec![triangle(across(4.0, 0.0))], true),
        ("a triangle that the light is a corner of", vec![], vec![triangle(across(3.0, 0.0))], true),
        (
            "a triangle in a plane through the camera, which does not see it",
            vec![],
            vec![triangle([vec3(-1.0, 1.0, 1.0), vec3(1.0, 1.0, 1.0), vec3(0.0, 9.0, 9.0)])],
            false,
        ),
    ];
    for (what, spheres, triangles, expected) in table {
        let camera = Camera::new(1, 1, 1.0, 1.0).unwrap();
        let triangles = [vec![wall], triangles].concat();
        let scene = Scene { lights: vec![light(at)], spheres, triangles, shadows: true, ..Scene::new(camera) };
        for contender in casting() {
            assert_eq!(lit(&contender, &scene), [expected], "{contender}: {what}");
        }
        // Without shadows (as in eq. 11) the pixel is lit in all cases.
        let scene = Scene { shadows: false, ..scene };
        assert!(contenders().iter().all(|contender| lit(contender, &scene) == [true]), "{what}");
    }
}

#[test]
fn an_object_alone_has_no_shadow_but_on_its_own_back() {
    let mut scene = shadowed(61, 47);
    for (at, triangle_is_lit) in
        [(vec3(3.0, 2.0, 0.0), true), (vec3(0.5, 1.0, 9.0), false), (vec3(3.0, 1.0, 4.0), true)]
    {
        scene.lights = vec![light(at)];
        scene.spheres = vec![sphere(1.0, vec3(0.25, 0.5, 4.0))];
        scene.triangles = vec![];
        for contender in casting() {
            let plain = Scene { shadows: false, ..scene.clone() };
            assert!(contender.floats(&scene) == contender.floats(&plain), "{contender}: a sphere under {at}");
        }
        scene.spheres = vec![];
        scene.triangles = vec![triangle([vec3(-2.0, -1.0, 5.0), vec3(2.0, -1.0, 5.0), vec3(0.0, 2.0, 3.75)])];
        for contender in casting() {
            let plain = contender.floats(&Scene { shadows: false, ..scene.clone() });
            let dark = vec![[0.0; 4]; plain.len()];
            let expected = if triangle_is_lit { &plain } else { &dark };
            assert!(contender.floats(&scene) == *expected && plain != dark, "{contender}: a triangle under {at}");
        }
    }
    // From inside a sphere, or from a point on it, only unlit surfaces are seen.
    scene.triangles = vec![];
    scene.lights = [1.0, 4.0, 9.0].map(|z| light(vec3(0.0, 0.5, z))).to_vec();
    for (centre, radius) in [(1.0, 3.0), (4.0, 4.0)] {
        scene.spheres = vec![sphere(radius, vec3(0.0, 0.0, centre))];
        for contender in casting() {
            assert!(!lit(&contender, &scene).contains(&true), "{contender}: from inside");
            assert!(lit(&contender, &Scene { shadows: false, ..scene.clone() }).contains(&true), "{contender}");
        }
    }
}

#[test]
fn closed_surface_lit_from_inside_lets_no_light_out() {
    let mut rng = Rng::new(5);
    let mut direction = || {
        let part = |bits: u64| (bits >> 40) as f64 / f64::from(1 << 23) - 1.0;
        DVec3::new(part(rng.next_u64()), part(rng.next_u64()), part(rng.next_u64())).normalize()
    };
    for (name, body) in [("cube", cube()), ("rock", rock())] {
        for _ in 0..3 {
            let inside = (0.3 * direction()).as_vec3();
            let outside = (4.0 * direction()).as_vec3();
            let towards = direction();
            let world = Scene { triangles: body.clone(), ..shadowed(61, 47) };
            let seen = |at: Vec3, position: DVec3| {
                let world = Scene { lights: vec![light(at)], ..world.clone() };
                world.seen_from(View { position, look_at: -0.1 * towards, up: DVec3::new(0.3, 1.0, 0.2) }).unwrap()
            };
            let from_inside = 0.2 * towards;
            for contender in casting() {
                let all = |at, position| {
                    let lit = lit(&contender, &seen(at, position));
                    (lit.iter().all(|lit| *lit), lit.contains(&true))
                };
                // The rock has dents, which cast shadows inside.
                let (is_bright, has_light) = all(inside, from_inside);
                assert!(is_bright || name == "rock" && has_light, "{contender}: in a {name} lit by {inside}");
                assert!(!all(inside, 3.0 * towards).1, "{contender}: outside a {name} lit by {inside}");
                assert!(!all(outside, from_inside).1, "{contender}: in a {name} lit by {outside}");
            }
        }
    }
}

#[test]
fn triangles_are_asked_after_spheres_have_hidden_points() {
    // In a tile of this scene the first triangle is farther than the points that spheres have left
    // open, but other triangles are not.
    let contact = rayo_lab::families::FAMILIES.iter().find(|family| family.id == "H1").unwrap();
    let scene = contact.case(8, 1, 142).scene;
    let reference = casting().next().unwrap().floats(&scene);
    for contender in casting().filter(|contender| contender.engine != Engine::Rust) {
        for (pixel, (found, expected)) in contender.floats(&scene).iter().zip(&reference).enumerate() {
            let off = (0..3).any(|channel| (found[channel] - expected[channel]).abs() > 0.01);
            assert!(!off, "{contender}: pixel {pixel}: {found:?} in place of {expected:?}");
        }
    }
}

#[test]
fn shadows_only_take_light_away_and_engines_agree_on_where() {
    for (spheres, triangles, seed) in [(0, 0, 1), (40, 0, 2), (0, 60, 3), (200, 200, 4)] {
        let scene =
            Scene { camera: Camera::new(203, 151, 1.0, 1.0).unwrap(), shadows: true, ..many(spheres, triangles, seed) };
        let plain = Scene { shadows: false, ..scene.clone() };
        let truth = Contender { engine: Engine::Reference, precision: Engine::Reference.precision() };
        let (expected, without) = (truth.bytes(&scene), truth.bytes(&plain));
        let taken = expected.iter().zip(&without).filter(|(with, without)| with != without).count();
        assert!(spheres + triangles < 9 || taken > 20, "{taken} pixels in shadow");
        for contender in casting() {
            let pixels = contender.floats(&scene).into_iter().zip(contender.floats(&plain));
            let is_less = |(with, without): ([f32; 4], [f32; 4])| with.iter().zip(without).all(|(a, b)| *a <= b);
            assert!(pixels.clone().all(is_less), "{contender} makes light");
            // At outlines and edges of shadows, engines in f32 may differ.
            let differ = |(ours, truth): (&[u8; 3], &[u8; 3])| difference(*ours, *truth) > 1;
            let plain = contender.bytes(&plain).iter().zip(&without).filter(|pair| differ(*pair)).count();
            let differing = contender.bytes(&scene).iter().zip(&expected).filter(|pair| differ(*pair)).count();
            assert!(differing <= plain + taken / 50 + 3, "{contender}: {differing} pixels, without shadows {plain}");
        }
    }
}

#[test]
fn lights_far_away_and_one_on_a_sphere_are_decided() {
    let mut scene = shadowed(101, 75);
    scene.spheres = vec![sphere(0.5, vec3(0.0, -0.25, 4.0))];
    scene.triangles =
        [&ground()[..], &[triangle([vec3(1.0, -1.0, 3.0), vec3(2.0, -1.0, 3.5), vec3(1.5, 0.5, 3.25)])]].concat();
    let sun = Vec3::new(0.5, 1.0, -0.25);
    for contender in casting() {
        scene.lights = vec![light(1e5 * sun)];
        let expected = lit(&contender, &scene);
        assert!(expected.iter().filter(|lit| !**lit).count() > 3000, "half of the picture is sky");
        for distance in [1e8, 1e10, 1e15, 1e20, 1e30, 3e38] {
            scene.lights = vec![light(distance * sun)];
            let plain = Scene { shadows: false, ..scene.clone() };
            // A pixel that is unlit without shadows is unlit with them.
            let sees = lit(&contender, &plain).contains(&true);
            let found = lit(&contender, &scene);
            let differing = found.iter().zip(&expected).filter(|(a, b)| a != b).count();
            assert!(if sees { differing <= 3 } else { !found.contains(&true) }, "{contender}: {distance}: {differing}");
        }
        // A light at the pole of the sphere, and so in a tangent plane, is not hidden from any
        // point above that plane.
        scene.lights = vec![light(vec3(0.0, 0.25, 4.0))];
        scene.triangles = quad(vec3(-9.0, 0.5, -9.0), [vec3(18.0, 0.0, 0.0), vec3(0.0, 0.0, 18.0)]).to_vec();
        let plain = contender.floats(&Scene { shadows: false, ..scene.clone() });
        let above = 0..101 * 37;
        assert!(contender.floats(&scene)[above.clone()] == plain[above], "{contender}: a ceiling");
    }
}

#[test]
fn pictures_without_objects_or_with_many_lights_are_right() {
    let mut scene = shadowed(31, 23);
    scene.lights = vec![light(vec3(1.0, 2.0, 3.0))];
    for contender in casting() {
        assert!(!lit(&contender, &scene).contains(&true), "{contender}: nothing to be seen");
    }
    scene.spheres = vec![sphere(0.5, vec3(0.0, 0.0, 4.0)), sphere(0.25, vec3(1.0, 0.5, 3.0))];
    scene.triangles = ground().to_vec();
    scene.lights = vec![];
    for contender in casting() {
        assert!(!lit(&contender, &scene).contains(&true), "{contender}: no light");
    }
    // The picture must be the sum of pictures with one light each.
    scene.lights = (0..1000).map(|i| i as f32).map(|i| light(vec3((i * 0.7).sin() * 9.0, 4.0, i * 0.01))).collect();
    for contender in casting() {
        let mut expected = vec![0.0; 31 * 23];
        for light in &scene.lights {
            let alone = contender.floats(&Scene { lights: vec![*light], ..scene.clone() });
            expected.iter_mut().zip(alone).for_each(|(sum, [r, ..])| *sum += f64::from(r));
        }
        let together = contender.floats(&scene);
        assert!(expected.iter().any(|sum| *sum > 0.0));
        for ([r, ..], sum) in together.into_iter().zip(expected) {
            let bound = 1000.0 * f64::from(contender.shade_error(PixelFormat::F32x4));
            assert!((f64::from(r) - sum).abs() <= bound, "{contender}: {r}, not {sum}");
        }
    }
    // So many lights that a tile is traced in parts: a few lights, each repeated a thousand times.
    scene.lights.truncate(8);
    let dim = scene.lights.iter().map(|of| Light { intensity: of.intensity / 1024.0, ..*of });
    let parted = Scene { lights: dim.cycle().take(8192).collect(), ..scene.clone() };
    for contender in casting() {
        for (a, b) in contender.floats(&parted).into_iter().zip(contender.floats(&scene)) {
            assert!((a[0] - b[0]).abs() <= 1e-3, "{contender}: {}, not {}", a[0], b[0]);
        }
    }
}

/// Checks the exact results of scenes with shadows: that there are shadows, that most pixels are
/// certain, and that results in few bits agree with those in 256 bits.
fn check_truth(what: &str, scenes: impl Iterator<Item = Scene>) {
    use rayo::internals::render::Precision;
    use rayo_lab::experiments::accuracy::errors::{Tally, margin_of};
    use rayo_lab::experiments::accuracy::{errors_of, expect};
    use rayo_lab::truth::Truth;
    let (mut taken, mut all, mut most) = (0, 0, 0);
    for (index, scene) in scenes.enumerate() {
        let camera = scene.camera;
        let (expected, plain) = (expect(&scene), Scene { shadows: false, ..scene.clone() });
        let tracer = Engine::Reference.prepare(None, &plain).unwrap();
        let tally = Tally::new(Precision::Double, true);
        taken += errors_of(tracer.as_ref(), camera.height(), PixelFormat::F32x3, &expected, tally).unwrap().off_by_2;
        let shadows: Vec<_> = expected.iter().filter_map(|expected| Some(expected.hit.as_ref()?.shadow)).collect();
        most += shadows.iter().filter(|shadow| **shadow >= margin_of(Precision::Double)).count();
        all += shadows.len();
        let truth = Truth::new(&scene);
        for (row, col) in (0..camera.height()).step_by(5).map(|row| (row, row % camera.width())) {
            let (exact, quick) = (truth.exact_pixel(row, col), truth.quick_pixel(row, col));
            let (Some(exact), Some(quick)) = (exact.hit, quick.and_then(|quick| quick.hit)) else { continue };
            let near = (exact.shadow - quick.shadow).abs() <= 1e-9 * exact.shadow || exact.shadow == quick.shadow;
            assert!(near || exact.shadow < 1e-16, "{what} {index}: {exact:?} {quick:?}");
        }
    }
    assert!(taken > 50, "{what}: {taken} pixels in shadow");
    assert!(10 * most >= 8 * all, "{what}: {most} of {all} are sure");
}

#[test]
fn the_judge_knows_of_random_mixtures_what_light_they_have() {
    check_truth("a mixture", crate::mixtures::scenes(24).map(|scene| Scene { shadows: true, ..scene }));
}

#[test]
fn the_judge_knows_of_every_family_of_shadows_what_light_it_has() {
    for family in rayo_lab::families::FAMILIES.iter().filter(|family| family.has_shadows()) {
        check_truth(family.id, (0..family.cases()).map(|index| family.case(index, 5, 18).scene));
    }
}

/// A regression test: compared with the needle's sides, the distance of a light from its plane is
/// so small that the light was taken to be on the plane, and so not hidden.
#[test]
fn the_judge_knows_on_which_side_of_a_needle_a_light_is() {
    let mut scene = Scene { shadows: true, ..Scene::new(Camera::new(42, 3, 565.0271, 1.0).unwrap()) };
    scene.lights = vec![light(vec3(-0.0014300407, -0.000108547836, 2.6850512))];
    scene.triangles = vec![
        triangle([
            vec3(0.00023509443, 8.275908e-6, 0.28378588),
            vec3(-0.0016768489, 0.00023664128, 5.0512934),
            vec3(0.00023509354, 8.167407e-6, 0.28378606),
        ]),
        triangle([
            vec3(7.697217e-5, -5.8513073e-5, 0.9755406),
            vec3(-0.0020653552, -0.00012964109, 3.405733),
            vec3(-0.002063213, -0.00012956996, 3.403303),
        ]),
    ];
    let truth = rayo_lab::truth::Truth::new(&scene);
    for pixel in [truth.pixel(0, 20), truth.exact_pixel(0, 20)] {
        let hit = pixel.hit.unwrap();
        assert_eq!(hit.cosines, [0.0]);
        assert!(hit.shadow < 1e-20, "{hit:?}");
    }
}

#[test]
fn what_is_lost_in_the_rounding_of_a_distance_hides_a_light_too() {
    // A light in a sphere that is smaller than the last digit of the light's distance.
    let far = vec3(-6.0852505e17, 5.7437525e17, -1.6001564e17);
    let mut in_far_sphere = shadowed(12, 12);
    in_far_sphere.lights = vec![light(far)];
    in_far_sphere.spheres = vec![sphere(1.0, far), sphere(4.0, vec3(0.0, 0.0, 9.0))];
    // A light and points at the corners of triangles whose size is 10^13 times their distance.
    let mut at_corners = Scene { shadows: true, ..Scene::new(Camera::new(12, 12, 0.5, 1.0).unwrap()) };
    at_corners.lights = vec![light(vec3(8.880835e-12, 8.010328e-13, 1.4558004e-11))];
    at_corners.spheres = vec![sphere(8.7072325e-13, vec3(8.408785e-12, 5.0689064e-13, 1.533776e-11))];
    at_corners.triangles = vec![
        triangle([vec3(-5.167334, 3.2631092, 59.006863), vec3(-16.64588, -15.926742, 29.503431), Vec3::ZERO]),
        triangle([
            vec3(-9.67869, -5.292324, 27.87064),
            vec3(-2.1803496, 7.7387547, 13.93532),
            vec3(2.149096e-13, -4.4302055e-15, -9.76624e-13),
        ]),
    ];
    let reference = casting().find(|contender| contender.engine == Engine::Reference).unwrap();
    for (scene, any) in [(in_far_sphere, false), (at_corners, true)] {
        let expected = lit(&reference, &scene);
        assert_eq!(expected.contains(&true), any);
        for contender in casting() {
            assert_eq!(lit(&contender, &scene), expected, "{contender}, light {any}");
        }
    }
}
