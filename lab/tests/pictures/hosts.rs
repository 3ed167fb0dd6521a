//! Programs that use the library and have changed the floating-point environment: no scene and no
//! picture depends on it.

use glam::DVec3;
use rayo::internals::kernels::harness::HostFloats;
use rayo::{
    Camera, Developed, Development, Film, Frame, Hit, MeshFormat, MovingCamera, PixelFormat, Scene, Settings, View,
    parse,
};
use rayo_lab::families::FAMILIES;

use crate::contenders::{Contender, contenders, film};
use crate::extent;

/// Scenes in the paper's format with numbers, products or distances that are denormal in f32.
const SCENES: [&str; 6] = [
    "ball.png 40 30 1   1  1 1 1 1  20 20 0   1  30 1 1 1  0 0 120   0",
    "all.png 60 40 1e-39   1  1 1 1 1  2e-38 2e-38 0   2  3e-39 1 1 1  0 0 1.2e-38  1e-39 1 0.5 0.2  2e-39 2e-39 8e-39
     1  1 1 1  -4e-39 -2e-39 9e-39  4e-39 -2e-39 9e-39  0 3e-39 1.5e-38",
    "light.png 32 24 1   1  1e38 1e-38 1e-39 1e-39  3 4 0   1  1 1 1 1  0 0 5   0",
    "square.png 32 24 1   1  1 1 1 1  3e-20 4e-20 0   1  1e-20 1 1 1  0 0 5e-20   0",
    "radius.png 32 24 1   1  1 1 1 1  3e-38 4e-38 0   1  1e-38 1 1 1  0 0 5e-38   0",
    "triangle.png 32 24 1   1  1 1 1 1  3e-37 4e-37 0   0
     1  1 1 1  -2e-38 -1e-38 5e-38  2e-38 -1e-39 5e-38  0 2e-38 5e-38",
];

/// A roof with two corners exactly on the rays of pixels.
const ROOF: &str =
    "v -1 0 3\nv 1 0 3\nv 1 0 5\nv -1 0 5\nv 0.25 1.5 4.25\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\nf 1 3 2\n";

/// What a program sees of a scene: every number by its bits.
#[derive(PartialEq)]
struct Seen {
    floats: Vec<[u32; 4]>,
    developed: Film,
    hits: Vec<Option<Hit>>,
}

/// The pictures of a scene traced by two threads, and its hits.
fn seen(contender: &Contender, scene: &Scene) -> Seen {
    let camera = scene.camera;
    let tracer = contender.prepare(scene);
    let Film::F32x4(floats) = film(tracer.as_ref(), camera, 2, PixelFormat::F32x4) else { unreachable!() };
    let floats = floats.into_iter().map(|pixel| pixel.lanes().map(f32::to_bits)).collect();
    let development = Development { exposure: 0.3, srgb: true, ..Development::default() };
    let developed = Developed::new(tracer.as_ref(), &camera, development);
    let frame = Frame::new(tracer.as_ref(), camera, Settings { threads: 2 }).unwrap();
    let hits = (0..camera.height()).map(|row| frame.hit(camera.width() / 2, row)).collect();
    Seen { floats, developed: film(&developed, camera, 2, PixelFormat::Rgb8), hits }
}

/// Asserts that each engine shows a scene under every floating-point environment as in the default
/// one.
fn check(scene: &Scene, what: &str) {
    for contender in contenders() {
        let scene = Scene { shadows: contender.engine.has_shadows(), ..scene.clone() };
        let expected = seen(&contender, &scene);
        for host in HostFloats::ALL {
            let found = host.call(|| seen(&contender, &scene));
            assert!(found == expected, "{what}: {contender}, {}", host.name);
        }
    }
}

#[test]
fn scenes_of_denormal_numbers_are_read_and_rendered_alike() {
    for text in SCENES {
        let read = || parse(text.as_bytes(), "a host's scene").unwrap();
        let expected = read();
        for host in HostFloats::ALL {
            assert!(host.call(read) == expected, "{}: {}", expected.name, host.name);
        }
        check(&expected, &expected.name);
    }
}

#[test]
fn meshes_are_read_moved_and_rendered_alike() {
    let world = || {
        let text = "roof.png 41 31 1   1  1 1 1 1  -4 6.3 -3   0   0";
        let mesh = rayo::Mesh::from_bytes(ROOF.into(), MeshFormat::Obj, "roof.obj").unwrap();
        let faces = rayo::Faces::new(mesh.vertices, mesh.triangles, glam::Vec3::new(0.1, 0.7, 1.0));
        let scene = Scene { faces, ..parse(text.as_bytes(), "a host's scene").unwrap() };
        let view = View { position: DVec3::new(0.3, 1.1, -0.7), look_at: DVec3::new(0.1, 0.4, 4.0), up: DVec3::Y };
        let moved = MovingCamera::of(&scene).seen_from(view).unwrap().clone();
        let around = moved.seen_from(moved.orbit(0.1).unwrap()).unwrap();
        [scene, moved, around]
    };
    let expected = world();
    for host in HostFloats::ALL {
        assert!(host.call(world) == expected, "{}", host.name);
    }
    expected.iter().for_each(|scene| check(scene, "the roof"));
}

#[test]
fn ill_conditioned_scenes_are_rendered_alike() {
    for family in extent::sampled(FAMILIES.iter(), 4) {
        let case = family.case(0, 5, 18);
        if case.valid && case.scene.camera.pixels() <= 2000 {
            check(&case.scene, case.family);
        }
    }
}

#[test]
fn denormal_cameras_work_and_hosts_keep_their_modes() {
    for host in HostFloats::ALL {
        // The arithmetic of the calling program itself must show its own modes. `black_box` keeps
        // the compiler from computing it.
        let hosts_own = || {
            let [tiny, third] = std::hint::black_box([1e-39_f32, 1.0 / 3.0]);
            [(tiny * 2.0).to_bits(), (third * 1.1).to_bits(), (-third * 1.1).to_bits()]
        };
        host.call(|| {
            let before = hosts_own();
            assert!(Camera::new(4, 3, 1e-39, 1.0).is_ok(), "{}", host.name);
            assert_eq!(hosts_own(), before, "{}", host.name);
        });
    }
}

/// The format rounds floats to eight bits with a common exponent.
#[test]
fn files_of_floats_are_written_and_read_alike() {
    use rayo::{Engine, Format, ImageFile, ImageWriter, render_to_file};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ball.hdr");
    let scene = parse(SCENES[0].as_bytes(), "a host's scene").unwrap();
    let tracer = Engine::fastest().prepare(None, &scene).unwrap();
    let written = || {
        let frame = Frame::new(tracer.as_ref(), scene.camera, Settings { threads: 2 }).unwrap();
        let mut image = ImageWriter::create(&path, Format::Hdr, 40, 30).unwrap();
        render_to_file(&frame, &mut image, &|_| ()).unwrap();
        image.finish().unwrap();
        (std::fs::read(&path).unwrap(), ImageFile::open(&path).unwrap().read().unwrap())
    };
    let expected = written();
    for host in HostFloats::ALL {
        assert!(host.call(written) == expected, "{}", host.name);
    }
}
