//! How much memory a picture of many objects takes in addition to its scene.

use crate::counting::peak_of;
use crate::extent;
use glam::{DVec3, Vec3};
use rayo::internals::render::{Engine, Film, PixelFormat, Plan, Precision, Purpose};
use rayo::internals::scene::{Camera, Light, Rng, Scene, Sphere, Triangle};
use rayo::internals::scene::{MeshFormat, mesh::shapes::icosphere};

/// Long triangles that each meet the most tiles for which an object's place is kept in the lists,
/// in 11 tiles of a row; `across` gives the first tile of each.
fn long(triangles: usize, camera: Camera, mut across: impl FnMut(&mut Rng) -> [u32; 2]) -> Scene {
    let mut rng = Rng::new(1);
    let grid = camera.grid::<f64>();
    let triangles = (0..triangles).map(|_| {
        let [tile, row] = across(&mut rng);
        let corners = [(20, 6), (10 * 64 + 40, 12), (5 * 64, 24)].map(|(x, y)| {
            let jitter = |rng: &mut Rng| (rng.next_u64() % 5) as u32;
            let (column, row) = (64 * tile + x + jitter(&mut rng), 32 * row + y + jitter(&mut rng));
            let ray = DVec3::from(grid.ray(row, column));
            (ray * f64::from(rng.between(5.0, 50.0))).as_vec3()
        });
        Triangle { colour: Vec3::ONE, vertices: corners }
    });
    Scene { camera, triangles: triangles.collect(), ..rayo::internals::scene::many(0, 0, 1) }
}

/// The peak of memory that a picture takes in addition to the scene, in one precision.
fn peak_beside(scene: &Scene, precision: Precision) -> usize {
    let mut film = Film::new(PixelFormat::Rgb8, scene.camera.pixels() as usize).unwrap();
    peak_of(|| picture(scene, precision, &mut film)).1
}

fn picture(scene: &Scene, precision: Precision, film: &mut Film) {
    // The memory does not depend on the instruction set.
    let engine = Engine::fastest();
    let purpose = Purpose { precision: Some(precision), format: Some(PixelFormat::Rgb8), ..Purpose::default() };
    let plan = Plan::new(engine, scene, purpose).unwrap();
    plan.tracer().rows(0..scene.camera.height(), film.as_mut());
}

#[test]
fn triangle_in_many_tiles_takes_at_most_190_bytes() {
    /// Besides what [`triangle_of_a_mesh_file_takes_at_most_45_bytes`] lists: the triangles of one
    /// tile that are traced at once, and the candidates of a piece.
    const FIXED: usize = 4 << 20;
    const COUNT: usize = 500_000;
    let camera = Camera::new(1632, 1224, 1.0, 1.0).unwrap();
    let mut with_large = long(COUNT, camera, |_| [9, 20]);
    let [left, right, top] = [(-1.0, -1.0), (1.0, -1.0), (0.0, 1.0)].map(|(x, y)| 90.0 * Vec3::new(x, y, 1.0));
    with_large.triangles.push(Triangle { colour: Vec3::ONE, vertices: [left, right, top] });
    for (name, scene) in [
        ("all over", long(COUNT, camera, |rng| [rng.next_u64() % 15, rng.next_u64() % 38].map(|tile| tile as u32))),
        ("all in the same tiles, behind them a wall", with_large),
    ] {
        for &precision in extent::sampled(Engine::fastest().precisions(), 3) {
            let each = peak_beside(&scene, precision).saturating_sub(FIXED) as f64 / COUNT as f64;
            assert!(each <= 190.0, "{name} in {precision}: {each:.1} bytes for each");
            // A candidate takes 16 bytes in each list that it is in: nothing takes more.
            assert!(each >= 170.0, "{name} in {precision}: {each:.1} bytes for each, so this is not the worst case");
        }
    }
}

#[test]
fn triangle_of_a_mesh_file_takes_at_most_45_bytes() {
    /// Memory that does not grow with the scene: the piece of the file that is read, the current
    /// tile, the places of all tiles, and the candidates of a piece of the scene.
    const FIXED: usize = 4 << 20;
    let mesh = icosphere(1_000_000, 0.3, 1);
    let count = mesh.triangles.len();
    let folder = tempfile::tempdir().unwrap();
    // Text formats are left out: memory is reserved by the length of the text, and mostly not
    // touched.
    let paths = [("mesh.ply", MeshFormat::Ply), ("mesh.stl", MeshFormat::Stl)].map(|(name, format)| {
        let path = folder.path().join(name);
        mesh.write(format, &mut std::io::BufWriter::new(std::fs::File::create(&path).unwrap())).unwrap();
        path
    });
    drop(mesh);
    let mut film = Film::new(PixelFormat::Rgb8, 800 * 600).unwrap();
    for path in paths {
        let ((), peak) =
            peak_of(|| picture(&rayo::internals::scene::read(&path).unwrap(), Precision::Single, &mut film));
        let each = peak.saturating_sub(FIXED) as f64 / count as f64;
        assert!(each <= 45.0, "{}: {each:.1} bytes for each", path.display());
    }
}

/// Spheres that shadow each other, under lights all around.
fn under(lights: usize, spheres: usize, camera: Camera) -> Scene {
    let mut rng = Rng::new(5);
    let mut place = || Vec3::from_array([0; 3].map(|_| 20.0 * (rng.next_u64() % 1000) as f32 / 1000.0 - 10.0));
    let lights = (0..lights).map(|_| Light { intensity: 0.01, colour: Vec3::ONE, position: 4.0 * place() });
    let lights = lights.collect();
    let spheres = (0..spheres).map(|_| Sphere { colour: Vec3::ONE, centre: place() + 15.0 * Vec3::Z, radius: 1.0 });
    Scene { spheres: spheres.collect(), lights, shadows: true, ..Scene::new(camera) }
}

#[test]
fn shadows_take_at_most_64_bytes_a_pixel_and_light() {
    const LIGHTS: usize = 200;
    let camera = Camera::new(1632, 32, 1.0, 1.0).unwrap();
    let shadows = under(LIGHTS, 300, camera);
    let plain = Scene { shadows: false, ..shadows.clone() };
    for precision in [Precision::Single, Precision::Double] {
        let [plain, shadows] = [&plain, &shadows].map(|scene| peak_beside(scene, precision));
        let bytes = (shadows - plain) as f64 / (camera.pixels() as usize * LIGHTS) as f64;
        assert!(bytes > 1.0 && bytes < 64.0, "{precision:?}: {bytes} bytes for each");
    }
}

#[test]
fn shadows_of_many_lights_take_memory_by_the_objects() {
    const LIGHTS: usize = 16384;
    /// The most effects of lights on visible points that are kept at once.
    const EFFECTS: usize = 1 << 22;
    let scene = under(LIGHTS, 60, Camera::new(64, 32, 1.0, 1.0).unwrap());
    for (precision, of_effect) in [(Precision::Single, 110), (Precision::Double, 220)] {
        let peak = peak_beside(&scene, precision);
        let most = EFFECTS * of_effect + LIGHTS * (2048 + scene.spheres.len() * 150);
        println!("{precision:?} {peak} {most}");
        assert!(peak < most, "{precision:?}: {peak} bytes, at most {most}");
    }
}

/// With many objects in one tile and many lights, records are kept for a part of the tile only, and
/// for the objects visible in it.
#[test]
fn lights_in_great_number_take_memory_for_a_part_of_a_tile() {
    /// The most effects of lights on objects: those kept at once, and those that are set up
    /// together.
    const EFFECTS: usize = 2 << 22;
    let mut rng = Rng::new(3);
    let mut place = |z: f32| {
        let [x, y] = [0; 2].map(|_| z * (rng.next_u64() % 1000) as f32 / 1000.0 - 0.5 * z);
        Vec3::new(x, 0.5 * y, z)
    };
    let spheres = (0..3000).map(|i| Sphere { colour: Vec3::ONE, centre: place(20.0 - i as f32 / 300.0), radius: 0.2 });
    let spheres: Vec<_> = spheres.collect();
    let triangles: Vec<_> = (0..3000)
        .map(|i| {
            let corner = place(20.0 - i as f32 / 300.0);
            Triangle { colour: Vec3::ONE, vertices: [Vec3::ZERO, 0.4 * Vec3::X, 0.4 * Vec3::Y].map(|at| corner + at) }
        })
        .collect();
    let around = (0..3000).map(|i| Sphere { colour: Vec3::ONE, centre: Vec3::ZERO, radius: 60.0 - i as f32 / 100.0 });
    let camera = Camera::new(64, 32, 1.0, 1.0).unwrap();
    let lights = |count: usize| {
        let light =
            |i| Light { intensity: 1.0 / count as f32, colour: Vec3::ONE, position: Vec3::new(i as f32, 9.0, -5.0) };
        (0..count).map(light).collect()
    };
    let plain = Scene::new(camera);
    let mixed = Scene { lights: lights(8192), spheres, triangles: triangles.clone(), ..plain.clone() };
    let inside = Scene { lights: lights(8192), spheres: around.collect(), triangles, ..plain.clone() };
    for (name, scene) in [("mixed", mixed), ("inside", inside)] {
        let mut expected = Film::new(PixelFormat::F32x4, scene.camera.pixels() as usize).unwrap();
        Engine::Rust.prepare(None, &scene).unwrap().rows(0..32, expected.as_mut());
        for precision in [Precision::Single, Precision::Double] {
            let mut film = Film::new(PixelFormat::Rgb8, scene.camera.pixels() as usize).unwrap();
            let peak = peak_of(|| picture(&scene, precision, &mut film)).1;
            let most = EFFECTS * if precision == Precision::Double { 200 } else { 100 };
            assert!(peak < most, "{name}, {precision:?}: {peak} bytes, at most {most}");
            let plan =
                Plan::new(Engine::fastest(), &scene, Purpose { precision: Some(precision), ..Purpose::default() });
            let plan = plan.unwrap();
            let ((hits, report), peak) = peak_of(|| (plan.tracer().hits(0..32), plan.report()));
            assert!(peak < 2 * most, "{name}, {precision:?}: {peak} bytes, at most twice {most}");
            assert!(report.kept.lights == 8192 && hits.iter().flatten().count() > 100, "{name}, {precision:?}");
            let levels = |film: &Film, at: usize| film.colour(at).levels().map(i32::from);
            let apart = (0..2048).filter(|at| {
                let pairs = levels(&film, *at).into_iter().zip(levels(&expected, *at));
                pairs.into_iter().any(|(one, other)| (one - other).abs() > 1)
            });
            // `rust` rounds each of the thousands of sums.
            assert_eq!(apart.count(), 0, "{name}, {precision:?}");
        }
    }
    let many = Scene {
        lights: lights(300_000),
        spheres: vec![Sphere { colour: Vec3::ONE, centre: Vec3::Z, radius: 0.1 }],
        ..plain
    };
    let refused = Engine::fastest().prepare(None, &many).err().unwrap().to_string();
    assert!(
        refused.contains(" takes at most 262144 lights, and the scene has 300000: ask rust or reference"),
        "{refused}"
    );
}
