//! Meshes with coordinates of maps: millions of metres from 0, with details that f32 has no digits
//! for so far away.

use std::fs;
use std::path::Path;

use glam::{DVec3, Vec3};
use rayo::internals::scene::mesh::Placement;
use rayo::internals::scene::mesh::shapes::terrain;
use rayo::internals::scene::{Camera, Mesh, MeshFormat, Scene, ToCamera, open};
use rayo::{Engine, Film, PixelFormat};

use crate::meshes::read;

/// Where the terrain is on the map.
const AWAY: [f64; 3] = [500_123.0, 350.0, -4_649_776.0];

/// The points of a terrain of some ten metres, with three decimals, and its triangles.
struct Ground {
    points: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

fn ground() -> Ground {
    let shape = terrain(700, 5);
    let millimetres = |number: f32| (f64::from(number) * 5000.0).round() / 1000.0;
    let points = shape.vertices.iter().map(|vertex| vertex.to_array().map(millimetres)).collect();
    Ground { points, triangles: shape.triangles }
}

/// A coordinate of a map in decimals, which is exact: the points have three.
fn decimal(number: f64, away: f64) -> String {
    format!("{:.3}", number + away)
}

impl Ground {
    fn moved(&self, away: [f64; 3]) -> impl Iterator<Item = [String; 3]> {
        self.points.iter().map(move |point| [0, 1, 2].map(|axis| decimal(point[axis], away[axis])))
    }

    fn obj(&self, away: [f64; 3]) -> String {
        let vertices = self.moved(away).map(|[x, y, z]| format!("v {x} {y} {z}\n"));
        let faces = self.triangles.iter().map(|corners| corners.map(|corner| corner + 1));
        vertices.chain(faces.map(|[a, b, c]| format!("f {a} {b} {c}\n"))).collect()
    }

    fn ply_header(&self, encoding: &str, kind: &str) -> String {
        format!(
            "ply\nformat {encoding} 1.0\nelement vertex {}\nproperty {kind} x\nproperty {kind} y\nproperty {kind} z\n\
             element face {}\nproperty list uchar uint vertex_indices\nend_header\n",
            self.points.len(),
            self.triangles.len()
        )
    }

    fn ply(&self, away: [f64; 3], kind: &str) -> String {
        let vertices = self.moved(away).map(|[x, y, z]| format!("{x} {y} {z}\n"));
        let faces = self.triangles.iter().map(|[a, b, c]| format!("3 {a} {b} {c}\n"));
        self.ply_header("ascii", kind) + &vertices.chain(faces).collect::<String>()
    }

    fn binary_ply(&self, away: [f64; 3]) -> Vec<u8> {
        let mut file = self.ply_header("binary_big_endian", "double").into_bytes();
        for coordinates in self.moved(away) {
            file.extend(coordinates.iter().flat_map(|number| number.parse::<f64>().unwrap().to_be_bytes()));
        }
        for corners in &self.triangles {
            file.push(3);
            file.extend(corners.iter().flat_map(|corner| corner.to_be_bytes()));
        }
        file
    }

    fn stl(&self, away: [f64; 3]) -> String {
        let places: Vec<_> = self.moved(away).collect();
        let facet = |corners: &[u32; 3]| {
            let vertices = corners.map(|corner| format!("vertex {}\n", places[corner as usize].join(" "))).concat();
            format!("facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n")
        };
        format!("solid\n{}endsolid\n", self.triangles.iter().map(facet).collect::<String>())
    }
}

fn picture(scene: &Scene) -> Vec<u8> {
    let mut film = Film::new(PixelFormat::Rgb8, scene.camera.pixels() as usize).unwrap();
    Engine::fastest().prepare(None, scene).unwrap().rows(0..scene.camera.height(), film.as_mut());
    film.bytes().to_vec()
}

fn seen(path: &Path) -> Vec<u8> {
    let camera = Camera::new(160, 120, 1.0, 1.0).unwrap();
    picture(&open(path, &camera).unwrap().scene)
}

#[test]
fn a_mesh_far_from_0_is_seen_as_the_same_at_0() {
    let folder = tempfile::tempdir().unwrap();
    let ground = ground();
    let put = |name: &str, content: &[u8]| {
        let path = folder.path().join(name);
        fs::write(&path, content).unwrap();
        path
    };
    let near = seen(&put("near.obj", ground.obj([0.0; 3]).as_bytes()));
    assert!(near.iter().any(|byte| *byte > 20));
    for (name, content) in [
        ("far.obj", ground.obj(AWAY).into_bytes()),
        ("far.ply", ground.ply(AWAY, "double").into_bytes()),
        ("floats.ply", ground.ply(AWAY, "float").into_bytes()),
        ("binary.ply", ground.binary_ply(AWAY)),
    ] {
        assert!(seen(&put(name, &content)) == near, "{name}");
    }
    // Files of STL stand otherwise. Each coordinate is rounded to f32, relative to another origin:
    // some pixel at an edge may belong to another triangle.
    let near = seen(&put("near.stl", ground.stl([0.0; 3]).as_bytes()));
    let far = seen(&put("far.stl", ground.stl(AWAY).as_bytes()));
    let differing = near.chunks(3).zip(far.chunks(3)).filter(|(near, far)| near != far).count();
    assert!(differing <= 3, "{differing} pixels");
}

#[test]
fn a_scene_that_moves_a_mesh_back_to_0_is_as_if_it_were_there() {
    let folder = tempfile::tempdir().unwrap();
    let ground = ground();
    let scene = |mesh: &str, translate: [f64; 3], camera: &str| {
        let text = format!(
            "[image]\nwidth = 160\nheight = 120\n[camera]\n{camera}\n[[light]]\nposition = [-20, 30, -20]\n\
             colour = [1, 1, 1]\nintensity = 1\n[[mesh]]\nfile = \"{mesh}\"\ntranslate = {translate:?}\n"
        );
        let path = folder.path().join("scene.toml");
        fs::write(&path, text).unwrap();
        open(&path, &Camera::default()).unwrap().scene
    };
    fs::write(folder.path().join("near.obj"), ground.obj([0.0; 3])).unwrap();
    fs::write(folder.path().join("far.obj"), ground.obj(AWAY)).unwrap();
    fs::write(folder.path().join("far.ply"), ground.binary_ply(AWAY)).unwrap();
    let camera = "position = [1, 8, -14]\nlook_at = [0, 0, 0]";
    let near = picture(&scene("near.obj", [0.0; 3], camera));
    for mesh in ["far.obj", "far.ply"] {
        let far = scene(mesh, AWAY.map(|number| -number), camera);
        assert!(picture(&far) == near, "{mesh}");
    }
}

#[test]
fn what_is_written_of_a_mesh_far_from_0_has_its_digits() {
    let ground = ground();
    let mesh = read(MeshFormat::Obj, ground.obj(AWAY)).unwrap();
    assert_ne!(mesh.origin, DVec3::ZERO);
    for format in [MeshFormat::Obj, MeshFormat::Ply] {
        let mut file = Vec::new();
        mesh.write(format, &mut file).unwrap();
        let again = read(format, file).unwrap();
        assert_eq!((again.origin, &again.vertices, &again.triangles), (mesh.origin, &mesh.vertices, &mesh.triangles));
    }
    // Text has no more digits than it was read with.
    let mut file = Vec::new();
    mesh.write(MeshFormat::Obj, &mut file).unwrap();
    let text = String::from_utf8(file).unwrap();
    let words = text.lines().filter(|line| line.starts_with('v')).flat_map(|line| line.split(' ').skip(1));
    let decimals = |word: &str| word.split_once('.').map_or(0, |(_, decimals)| decimals.len());
    assert!(words.map(decimals).max() <= Some(4), "{}", &text[..400]);
    // STL has 32 bits.
    let mut file = Vec::new();
    mesh.write(MeshFormat::Stl, &mut file).unwrap();
    let stl = read(MeshFormat::Stl, file).unwrap();
    let corner = mesh.origin + mesh.corners(mesh.triangles[0])[0].as_dvec3();
    assert_eq!((stl.origin, stl.corners(stl.triangles[0])[0]), (DVec3::ZERO, corner.as_vec3()));
}

#[test]
fn a_mesh_near_0_has_the_nearest_f32_of_its_numbers() {
    let ground = ground();
    for away in [[0.0; 3], [10.0, -40.0, 100.0]] {
        let mesh = read(MeshFormat::Ply, ground.ply(away, "double")).unwrap();
        let nearest = |[x, y, z]: [String; 3]| Vec3::new(x.parse().unwrap(), y.parse().unwrap(), z.parse().unwrap());
        assert_eq!(mesh.origin, DVec3::ZERO);
        assert!(mesh.vertices.iter().copied().eq(ground.moved(away).map(nearest)));
    }
}

#[test]
fn a_turned_and_stretched_mesh_is_placed_with_its_digits() {
    let ground = ground();
    let mesh = read(MeshFormat::Obj, ground.obj(AWAY)).unwrap();
    let turned =
        Placement { scale: DVec3::new(0.5, -2.0, 3.0), rotate: DVec3::new(20.0, 90.0, -130.0), translate: DVec3::ZERO };
    let away = turned.to_world().transform_point3(DVec3::from(AWAY));
    let back = Placement { translate: -away, ..turned };
    let placed = mesh.clone().placed(ToCamera::IDENTITY.of_placed(&back), Vec3::ONE).unwrap();
    for (face, corners) in placed.iter().zip(&ground.triangles) {
        for (vertex, corner) in face.vertices.iter().zip(corners) {
            let expected = turned.to_world().transform_point3(DVec3::from(ground.points[*corner as usize]));
            let error = (vertex.as_dvec3() - expected).abs().max_element();
            assert!(error < 1e-5, "{vertex} in place of {expected}");
        }
    }
}

#[test]
fn a_mesh_that_f32_holds_stays_as_it_is_however_far() {
    let mesh = Mesh {
        vertices: [1.0, 2.0, 3.5].map(|x| Vec3::new(4e6 + x, x * x, 0.0)).to_vec(),
        triangles: vec![[0, 1, 2]],
        ..Mesh::default()
    };
    for format in [MeshFormat::Obj, MeshFormat::Ply, MeshFormat::Stl] {
        let mut file = Vec::new();
        mesh.write(format, &mut file).unwrap();
        assert_eq!(read(format, file).unwrap(), mesh, "{format}");
    }
}
