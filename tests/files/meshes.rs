//! Mesh files: what is read, what is refused and in which words, at what memory; and the shapes
//! that are made.

use std::collections::HashMap;
use std::fs;
use std::iter;
use std::path::Path;

use crate::counting::peak_of;
use glam::{DVec2, DVec3, Vec3};
use rayo::internals::scene::mesh::shapes::{icosphere, terrain, torus};
use rayo::internals::scene::{Camera, Mesh, MeshError, MeshFormat, Rng, Scene, SceneError, Setting, ToCamera, open};

const FORMATS: [MeshFormat; 4] = [MeshFormat::Obj, MeshFormat::Ply, MeshFormat::Stl, MeshFormat::Gltf];

/// What errors and a reader's buffers may take, however short the file.
const SLACK: usize = 2 << 20;

/// Reads a mesh, and holds the memory that this takes to a multiple of the file.
pub(crate) fn read(format: MeshFormat, source: impl Into<Vec<u8>>) -> Result<Mesh, MeshError> {
    let source = source.into();
    let length = source.len();
    let (mesh, peak) = peak_of(|| Mesh::from_bytes(source, format, "test"));
    assert!(peak <= 64 * length + SLACK, "{peak} bytes for a file of {length}");
    mesh
}

/// The colours of all triangles.
pub(crate) fn colours(mesh: &Mesh) -> Vec<[f32; 3]> {
    (0..mesh.triangles.len()).map(|triangle| mesh.colour(triangle).to_array()).collect()
}

pub(crate) fn refused(format: MeshFormat, source: impl Into<Vec<u8>>) -> String {
    read(format, source).expect_err("a refusal").to_string()
}

/// The linear light of a value on the sRGB curve.
pub(crate) fn light(encoded: f64) -> f32 {
    (if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }) as f32
}

/// The corners of all triangles.
pub(crate) fn soup(mesh: &Mesh) -> Vec<[[f32; 3]; 3]> {
    mesh.triangles.iter().map(|&triangle| mesh.corners(triangle).map(|corner| corner.to_array())).collect()
}

const SQUARE: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.5], [0.0, 1.0, -2.5e-7]];

/// The square as two triangles, a fan around its first corner.
pub(crate) fn fan() -> Vec<[[f32; 3]; 3]> {
    let [a, b, c, d] = SQUARE;
    vec![[a, b, c], [a, c, d]]
}

pub(crate) const OBJ_SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0.5\nv 0 1 -2.5e-7\n";

#[test]
fn a_ply_file_has_colours_of_vertices_or_of_faces() {
    for (kind, colour, white) in [("uchar", "255 0 51", "255 255 255"), ("float", "1 0 0.2", "1 1 1")] {
        let names = format!("property {kind} red\nproperty {kind} green\nproperty {kind} blue\n");
        for [of_vertex, of_face, alpha] in [[1, 0, 0], [0, 1, 0], [1, 1, 1]] {
            let [in_vertices, in_faces] = [of_vertex, of_face].map(|times| names.repeat(times));
            let extra = "property uchar alpha\n".repeat(alpha);
            let vertex = |at| format!("{at} {} {}\n", colour.repeat(of_vertex), "9".repeat(alpha));
            let face = |colour: &str| format!("3 0 1 2 {}\n", colour.repeat(of_face));
            let rows = [["0 0 0", "1 0 0", "1 1 0"].map(vertex).concat(), [colour, white].map(face).concat()].concat();
            let file = format!(
                "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                 {in_vertices}{extra}element face 2\nproperty list uchar int vertex_indices\n{in_faces}end_header\n{rows}"
            );
            let mesh = read(MeshFormat::Ply, file).unwrap();
            let first = [1.0, 0.0, light(0.2)];
            let second = if of_face == 0 { first } else { [1.0; 3] };
            assert_eq!(colours(&mesh), [first, second], "{kind} {of_vertex} {of_face}");
            assert_eq!(mesh.notes.len(), alpha);
        }
    }
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty ushort \
                diffuse_red\nproperty ushort diffuse_green\nproperty ushort diffuse_blue\nelement face 1\nproperty list uchar \
                int vertex_index\nend_header\n0 0 0 65535 0 0\n1 0 0 65535 0 0\n1 1 0 0 0 0\n3 0 1 2\n";
    assert_eq!(colours(&read(MeshFormat::Ply, text).unwrap()), [[2.0 / 3.0, 0.0, 0.0]]);
}

#[test]
fn triangle_strips_are_read_as_triangles_that_face_one_side() {
    let strips = |corners: &str| {
        let count = corners.split(' ').count();
        read(
            MeshFormat::Ply,
            format!(
                "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\nelement \
             tristrips 1\nproperty list int int vertex_indices\nend_header\n0 0 0\n0 1 0\n1 0 0\n1 1 0\n2 0 0\n{count} {corners}\n"
            ),
        )
    };
    let mesh = strips("0 1 2 3 4 -1 0 1 2 -1 3").unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 3], [2, 3, 4], [0, 1, 2]]);
    let side = |triangle: &[u32; 3]| {
        let [a, b, c] = mesh.corners(*triangle);
        (b - a).cross(c - a).z
    };
    assert!(mesh.triangles.iter().all(|triangle| side(triangle) < 0.0));
    // What leads to another place makes none.
    assert_eq!(strips("0 1 2 2 3 3 4").unwrap().triangles, [[0, 1, 2]]);
    let message = "test:15: strip 1's corner 3 refers to vertex 5, but the file has only 5 vertices: expected 0 to 4, counted from 0";
    assert_eq!(strips("0 1 5").unwrap_err().to_string(), message);
}

#[test]
fn colours_go_from_one_format_to_another_to_the_last_bit() {
    let (red, odd) = (Vec3::new(1.0, 0.0, 51.0 / 255.0), Vec3::new(0.1, 2.5, 1e-20));
    for second in [red * 0.0, odd] {
        let mut mesh = terrain(200, 3);
        let half = mesh.triangles.len() / 2;
        mesh.colours = vec![(half, red), (mesh.triangles.len(), second)];
        for format in [MeshFormat::Obj, MeshFormat::Ply, MeshFormat::Gltf] {
            let mut file = Vec::new();
            mesh.write(format, &mut file).unwrap();
            let again = read(format, file).unwrap();
            assert_eq!((soup(&again), &again.colours), (soup(&mesh), &mesh.colours), "{format}");
        }
        let mut setting = Setting::of(&mesh, MeshFormat::Ply, &Camera::default()).unwrap();
        setting.colour = Vec3::new(0.5, 1.0, 1.0);
        let scene = setting.scene(mesh.clone(), String::new()).unwrap();
        assert_eq!(scene.triangle(0).colour, red * Vec3::new(0.5, 1.0, 1.0));
        assert_eq!(Mesh::of_scene(&scene, MeshFormat::Ply).colour(half), second * Vec3::new(0.5, 1.0, 1.0));
    }
}

#[test]
fn colours_of_a_file_are_the_same_in_the_next_file() {
    let obj = "v 0 0 0 0.1 0.251 0.7\nv 1 0 0 0.1 0.251 0.7\nv 1 1 0 0.1 0.251 0.7\nf 1 2 3\n";
    let mut file = Vec::new();
    read(MeshFormat::Obj, obj).unwrap().write(MeshFormat::Obj, &mut file).unwrap();
    assert_eq!(String::from_utf8(file).unwrap(), obj);
    let header = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
        property float z\nelement face 1\nproperty list uchar uint vertex_indices\n";
    let [floats, levels] =
        [("float", [0.1_f32, 0.251, 0.7].map(f32::to_le_bytes).concat()), ("uchar", vec![128, 64, 32])].map(
            |(kind, colour)| {
                let channels = ["red", "green", "blue"].map(|channel| format!("property {kind} {channel}\n")).concat();
                let corners = [0_f32, 0., 0., 1., 0., 0., 1., 1., 0.].map(f32::to_le_bytes).concat();
                let face = [&[3][..], &[0_u32, 1, 2].map(u32::to_le_bytes).concat(), &colour].concat();
                [header.as_bytes(), channels.as_bytes(), b"end_header\n", &corners, &face].concat()
            },
        );
    for ply in [floats, levels] {
        let mut file = Vec::new();
        read(MeshFormat::Ply, ply.clone()).unwrap().write(MeshFormat::Ply, &mut file).unwrap();
        assert_eq!(file, ply);
    }
}

/// The square as PLY: text, or binary in either byte order, with properties and an element that
/// mean nothing here.
fn ply_square(encoding: &str, scalar: &str, index: &str) -> Vec<u8> {
    let mut file = format!(
        "ply\nformat {encoding} 1.0\ncomment of no interest\nelement vertex 4\nproperty uchar red\nproperty {scalar} x\n\
         property {scalar} y\nproperty {scalar} z\nelement edge 1\nproperty list uchar short ends\n\
         element face 1\nproperty list uchar {index} vertex_indices\nproperty float area\nend_header\n"
    )
    .into_bytes();
    let big = encoding.contains("big");
    let put = |file: &mut Vec<u8>, little: &[u8]| {
        let mut bytes = little.to_vec();
        if big {
            bytes.reverse();
        }
        file.extend(bytes);
    };
    if encoding == "ascii" {
        for [x, y, z] in SQUARE {
            file.extend(format!("200 {x} {y} {z:e}\n").bytes());
        }
        file.extend(b"2 0 1\n4 0 1 2 3 1.5\n");
        return file;
    }
    for vertex in SQUARE {
        file.push(200);
        for value in vertex {
            match scalar {
                "double" => put(&mut file, &f64::from(value).to_le_bytes()),
                _ => put(&mut file, &value.to_le_bytes()),
            }
        }
    }
    file.push(2);
    [0_i16, 1].iter().for_each(|end| put(&mut file, &end.to_le_bytes()));
    file.push(4);
    for corner in 0..4_i32 {
        match index {
            "uchar" => file.push(corner as u8),
            "short" => put(&mut file, &(corner as i16).to_le_bytes()),
            _ => put(&mut file, &corner.to_le_bytes()),
        }
    }
    put(&mut file, &1.5_f32.to_le_bytes());
    file
}

#[test]
fn a_ply_file_may_be_text_or_binary_of_either_byte_order() {
    for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for scalar in ["float", "double", "float32"] {
            for index in ["int", "uint", "uchar", "short", "int32"] {
                let mesh = read(MeshFormat::Ply, ply_square(encoding, scalar, index));
                let mesh = mesh.unwrap_or_else(|error| panic!("{encoding} {scalar} {index}: {error}"));
                assert_eq!(soup(&mesh), fan(), "{encoding} {scalar} {index}");
                assert_eq!(mesh.polygons, 1);
            }
        }
    }
    let crlf = String::from_utf8(ply_square("ascii", "float", "int")).unwrap().replace('\n', "\r\n");
    for mark in ["", "\u{feff}"] {
        assert_eq!(soup(&read(MeshFormat::Ply, format!("{mark}{crlf}")).unwrap()), fan());
    }
}

pub(crate) const STL_STEPS: &str = "expected facet normal x y z, outer loop, three times vertex x y z with finite numbers, endloop, endfacet; or endsolid";

pub(crate) fn stl_text(name: &str) -> String {
    let mut text = format!("solid{name}\n");
    for [a, b, c] in fan() {
        text += "  facet normal 0 0 1\n    outer loop\n";
        for [x, y, z] in [a, b, c] {
            text += &format!("      vertex {x} {y} {z:e}\n");
        }
        text += "    endloop\n  endfacet\n";
    }
    text + &format!("endsolid{name}\n")
}

pub(crate) fn stl_binary(title: &str) -> Vec<u8> {
    let mut bytes = title.as_bytes().to_vec();
    bytes.resize(80, b' ');
    bytes.extend(2_u32.to_le_bytes());
    for corners in fan() {
        bytes.extend([0; 12]);
        bytes.extend(corners.as_flattened().iter().flat_map(|value| value.to_le_bytes()));
        bytes.extend([7, 7]);
    }
    bytes
}

#[test]
fn an_stl_file_may_be_text_or_binary_whatever_its_title() {
    for source in [
        stl_text(" square").into_bytes(),
        stl_text(" a square of two").into_bytes(),
        stl_text("").into_bytes(),
        stl_text("").replace('\n', "\r\n").into_bytes(),
        format!("\u{feff}{}", stl_text("")).into_bytes(),
        stl_binary("square"),
        stl_binary("\u{feff}square"),
        stl_binary("solid as a rock"),
        stl_binary("solid\n facet"),
        stl_binary("solid \u{f1}"),
    ] {
        let mesh = read(MeshFormat::Stl, source.clone());
        let mesh = mesh.unwrap_or_else(|error| panic!("{error}: {}", source.escape_ascii()));
        assert_eq!(soup(&mesh), fan(), "{}", source.escape_ascii());
    }
}

#[test]
fn a_bad_ply_file_is_refused_at_its_line_and_element() {
    let square = String::from_utf8(ply_square("ascii", "float", "int")).unwrap();
    let header =
        "expected lines that begin with format, comment, element, property or obj_info, and end_header at last";
    for (good, bad, expected) in [
        ("4 0 1 2 3 1.5", "4 0 1 2 4 1.5", "test:20: face 1's corner 4 refers to vertex 4, but the file has only 4 vertices: expected 0 to 3, counted from 0".to_owned()),
        ("4 0 1 2 3 1.5", "4 0 1 2 -1 1.5", "test:20: face 1's corner 4 refers to vertex -1, but the file has only 4 vertices: expected 0 to 3, counted from 0".into()),
        ("4 0 1 2 3 1.5", "2 0 1 1.5", "test:20: face 1 has 2 corners: expected at least three".into()),
        ("4 0 1 2 3 1.5", "4 0 1 2", "test: the file ends in face 1: expected 1 of them, as its header says".into()),
        ("4 0 1 2 3 1.5", "99 0 1 2 3", "test: the file ends in face 1: expected 1 of them, as its header says".into()),
        ("4 0 1 2 3 1.5", "99999 0 1 2 3", "test:20: face 1's vertex_indices is `99999`: expected a whole number from 0 to 255, as its type uchar says".into()),
        ("4 0 1 2 3 1.5\n", "", "test: the file ends in face 1: expected 1 of them, as its header says".into()),
        ("200 1 0 0", "200 1 nan 0", "test:16: vertex 2 is not finite: expected numbers that f32 holds, within 3.4e38".into()),
        ("200 1 0 0", "200 1 none 0", "test:16: vertex 2's y is `none`: expected a number, as its type float says".into()),
        ("200 1 0 0", "200 1 1e39 0", "test:16: vertex 2 is not finite: expected numbers that f32 holds, within 3.4e38".into()),
        ("200 1 0 0", "200 1 0", "test:20: face 1's corner 1 refers to vertex 4, but the file has only 4 vertices: expected 0 to 3, counted from 0; line 17 does not end with an element, and numbers may be missing before".into()),
        ("ply", "plx", "test:1: this is no PLY file: expected the word ply in the first line".into()),
        ("format ascii 1.0", "format ebcdic 1.0", format!("test:2: the header cannot be understood: {header}")),
        ("format ascii 1.0\n", "", "test: the header has no usable format line: expected as in: format ascii 1.0".into()),
        ("property float y", "property float x", "test: the header names an element or a property twice: expected a name once".into()),
        ("property float y", "property float w", "test: vertices have no y: expected property float y".into()),
        ("element vertex 4", "element point 4", "test: the header has no vertices: expected element vertex, with its number".into()),
        ("element face 1", "element fact 1", "test: the header has no faces: expected element face, with its number".into()),
        ("list uchar int vertex_indices", "int vertex_indices", "test: faces have no corners: expected property list uchar int vertex_indices".into()),
        ("element face 1", "element face 0", "test: the mesh is empty: expected at least one face".into()),
        ("end_header\n", "end_heater\n", format!("test:14: the header cannot be understood: {header}")),
    ] {
        assert!(square.contains(good), "{good}");
        assert_eq!(refused(MeshFormat::Ply, square.replacen(good, bad, 1)), expected, "{bad}");
    }
    let binary = ply_square("binary_little_endian", "float", "int");
    let error = refused(MeshFormat::Ply, &binary[..binary.len() - 1]);
    assert_eq!(error, "test: the file ends in face 1: expected 1 of them, as its header says");
    let mut infinite = binary.clone();
    let x = infinite.windows(11).position(|window| window == b"end_header\n").unwrap() + 11 + 13 + 1;
    infinite[x..x + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    let error = refused(MeshFormat::Ply, infinite);
    assert_eq!(error, "test: vertex 2 is not finite: expected numbers that f32 holds, within 3.4e38");
}

#[test]
fn an_stl_file_in_text_may_have_several_solids() {
    let one = stl_text(" a");
    for between in ["", "\n", "  \r\n\t\n"] {
        for names in [" b", "", " solid endsolid"] {
            let file = [&*one, between, &stl_text(names), &stl_text(" c"), "\n\n"].concat();
            assert_eq!(soup(&read(MeshFormat::Stl, file).unwrap()), [fan(), fan(), fan()].concat());
        }
    }
    // Nothing that follows a solid hides the next one, or a facet.
    for between in
        ["of no interest\n", "end solid\nSolid x\nEndSolid x\n", "\u{a0}\u{b}endsolid\n\u{a0}solid\n", "\0\n"]
    {
        for next in [stl_text(" b"), stl_text("").replacen("solid\n", "", 1), stl_text(" b").to_uppercase()] {
            let mesh = read(MeshFormat::Stl, format!("{one}{between}{next}of no interest\n"));
            let mesh = mesh.unwrap_or_else(|error| panic!("{error}: {between:?} {next}"));
            assert_eq!(soup(&mesh), [fan(), fan()].concat(), "{between:?} {next}");
        }
    }
    let facet = format!("test:18: facet 3 cannot be understood: {STL_STEPS}");
    assert_eq!(refused(MeshFormat::Stl, format!("{one}facett normal 0 0 1\n  vertex 0 0 0\n")), facet);
    assert!(refused(MeshFormat::Stl, format!("{one}solid b\nfacet normal 0 0 1\n")).contains("facet 3"));
}

#[test]
fn a_bad_stl_file_is_refused_at_its_facet() {
    let text = stl_text(" x");
    for (good, bad, expected) in [
        ("vertex 1 0 0e0", "vertex 1 0", format!("test:5: facet 1 cannot be understood: {STL_STEPS}")),
        ("vertex 1 0 0e0", "vertex 1 0 nan", format!("test:5: facet 1 cannot be understood: {STL_STEPS}")),
        ("vertex 0 1 -2.5e-7", "vertex 0 1 1e39", format!("test:13: facet 2 cannot be understood: {STL_STEPS}")),
        ("endloop", "end", format!("test:7: facet 1 cannot be understood: {STL_STEPS}")),
    ] {
        assert!(text.contains(good), "{good}");
        assert_eq!(refused(MeshFormat::Stl, text.replacen(good, bad, 1)), expected, "{bad}");
    }
    assert_eq!(
        refused(MeshFormat::Stl, "solid x\nendsolid x\n"),
        "test: the mesh is empty: expected at least one face"
    );
    let start = "expected the word solid at its start, or 84 bytes and more";
    assert_eq!(refused(MeshFormat::Stl, "some other file"), format!("test: the file has 15 bytes: {start}"));
    let mut binary = stl_binary("x");
    binary[84 + 50 + 12 + 4..][..4].copy_from_slice(&f32::INFINITY.to_le_bytes());
    let error = refused(MeshFormat::Stl, binary);
    assert_eq!(error, "test: facet 2's vertex 1 is not finite: expected numbers that f32 holds, within 3.4e38");
    let binary = stl_binary("x");
    let error = refused(MeshFormat::Stl, &binary[..binary.len() - 1]);
    assert_eq!(
        error,
        "test: the header claims 2 facets, and the file has no room for so many: expected at most 1: 99 bytes follow it"
    );
}

#[test]
fn what_is_written_is_read_again_to_the_last_bit() {
    for mesh in [icosphere(500, 0.2, 3), torus(300), terrain(200, 4)] {
        for format in FORMATS {
            let mut bytes = Vec::new();
            mesh.write(format, &mut bytes).unwrap();
            let again = read(format, bytes).unwrap();
            assert_eq!(soup(&again), soup(&mesh), "{format}");
            if format == MeshFormat::Ply {
                assert_eq!(again, mesh);
            }
        }
    }
}

#[test]
fn a_scene_that_becomes_a_mesh_comes_back_as_it_was() {
    let scene = rayo::internals::scene::many(3, 50, 6);
    for format in FORMATS {
        let mesh = Mesh::of_scene(&scene, format);
        let mut bytes = Vec::new();
        mesh.write(format, &mut bytes).unwrap();
        let again =
            read(format, bytes).unwrap().placed(ToCamera::IDENTITY.of_placed(&format.placement()), Vec3::ONE).unwrap();
        let again: Vec<_> = again.iter().map(|triangle| triangle.vertices).collect();
        let corners: Vec<_> = scene.triangles.iter().map(|triangle| triangle.vertices).collect();
        assert_eq!(again, corners, "{format}");
    }
    // Four triangles of a tetrahedron share four corners.
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/tetrahedron.in");
    assert_eq!(Mesh::of_scene(&rayo::internals::scene::read(&file).unwrap(), MeshFormat::Ply).vertices.len(), 4);
}

#[test]
fn a_file_that_is_no_mesh_or_not_there_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("none.obj");
    let error = Mesh::read(&missing).unwrap_err().to_string();
    assert_eq!(error, format!("{}: there is no such file: expected a mesh file", missing.display()));
    fs::create_dir(folder.path().join("folder.ply")).unwrap();
    let error = Mesh::read(&folder.path().join("folder.ply")).unwrap_err().to_string();
    assert!(error.ends_with("folder.ply: this is a directory: expected a mesh file"), "{error}");
    let error = Mesh::read(Path::new("mesh.fbx")).unwrap_err().to_string();
    assert_eq!(
        error,
        "mesh.fbx: the name of a mesh file tells its format: expected .obj, .ply, .stl, .glb or .gltf at its end"
    );
    let bad = folder.path().join("bad.OBJ");
    fs::write(&bad, "v 0 0 0\nf 1 1 2\n").unwrap();
    let error = open(&bad, &Camera::default()).unwrap_err();
    assert!(matches!(error, SceneError::Mesh(_)));
    let expected = format!(
        "error: face 1's corner 3 refers to vertex 2, but the file has only 1 vertex\n--> {}:2\n = note: expected 1 to 1, the number \
         of its vertices, or -1 and down for the last ones",
        bad.display()
    );
    assert_eq!(error.render(false), expected);
}

/// How often each directed edge occurs.
fn edges(mesh: &Mesh) -> HashMap<(u32, u32), usize> {
    let mut edges = HashMap::new();
    for &[a, b, c] in &mesh.triangles {
        for edge in [(a, b), (b, c), (c, a)] {
            *edges.entry(edge).or_default() += 1;
        }
    }
    edges
}

fn volume(mesh: &Mesh) -> f64 {
    let signed = |[a, b, c]: [Vec3; 3]| a.as_dvec3().dot(b.as_dvec3().cross(c.as_dvec3())) / 6.0;
    mesh.triangles.iter().map(|&triangle| signed(mesh.corners(triangle))).sum()
}

#[test]
fn closed_shapes_are_closed_and_counter_clockwise_from_outside() {
    use std::f64::consts::PI;
    let sphere = 4.0 / 3.0 * PI;
    for (shape, mesh, full) in [
        ("icosphere", icosphere(20_000, 0.0, 1), sphere),
        ("icosphere", icosphere(20, 0.0, 1), sphere),
        ("bumpy icosphere", icosphere(5000, 0.5, 2), sphere),
        ("torus", torus(10_000), 2.0 * PI * PI * 0.16),
        ("torus", torus(1), 2.0 * PI * PI * 0.16),
    ] {
        let edges = edges(&mesh);
        assert!(edges.values().all(|&times| times == 1), "{shape}");
        assert!(edges.keys().all(|&(a, b)| edges.contains_key(&(b, a))), "{shape}");
        let share = volume(&mesh) / full;
        assert!((0.3..1.4).contains(&share), "{shape}: {share} of its volume");
        // Every vertex is in use, and none is there twice.
        let mut vertices: Vec<_> = mesh.vertices.iter().map(|vertex| vertex.to_array().map(f32::to_bits)).collect();
        let used: std::collections::HashSet<u32> = mesh.triangles.iter().flatten().copied().collect();
        assert_eq!(used.len(), vertices.len(), "{shape}");
        vertices.sort_unstable();
        vertices.dedup();
        assert_eq!(vertices.len(), mesh.vertices.len(), "{shape}");
    }
    assert!((volume(&icosphere(20_000, 0.0, 1)) / sphere - 1.0).abs() < 1e-3);
    let far = |vertex: &Vec3| (vertex.length() - 1.0).abs();
    assert!(icosphere(2000, 0.0, 1).vertices.iter().all(|vertex| far(vertex) < 1e-6));
    let bumpy = icosphere(2000, 0.3, 1);
    let furthest = bumpy.vertices.iter().map(far).fold(0.0, f32::max);
    assert!((0.1..=0.3).contains(&furthest), "{furthest}");
}

#[test]
fn terrain_covers_its_square_counter_clockwise() {
    let mesh = terrain(5000, 9);
    let mut area = 0.0;
    for &triangle in &mesh.triangles {
        let [a, b, c] = mesh.corners(triangle).map(|corner| corner.as_dvec3());
        let normal = (b - a).cross(c - a);
        assert!(normal.y > 0.0);
        area += normal.dot(DVec3::Y) / 2.0;
    }
    assert!((area - 4.0).abs() < 1e-4, "{area}");
    assert!(edges(&mesh).values().all(|&times| times == 1));
}

#[test]
fn shapes_have_nearly_the_triangles_asked_for() {
    for asked in [1_u64, 2, 20, 50, 51, 1000, 69_451, 100_000] {
        // The smaller of two.
        let nearest = |first: u64, triangles: u64| {
            let counts = (first..500).map(|n| triangles * n * n);
            counts.min_by_key(|count| (count.abs_diff(asked), *count)).unwrap() as usize
        };
        assert_eq!(icosphere(asked, 0.0, 1).triangles.len(), nearest(1, 20), "{asked}");
        assert_eq!(torus(asked).triangles.len(), nearest(3, 4), "{asked}");
        assert_eq!(terrain(asked, 1).triangles.len(), nearest(1, 2), "{asked}");
    }
}

#[test]
fn the_meshes_of_the_example_are_what_its_comment_says() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let comment = fs::read_to_string(folder.join("island.toml")).unwrap();
    for (command, mesh) in [
        ("terrain --triangles 1700 --seed 12 -o meshes/hills.ply", terrain(1700, 12)),
        ("icosphere --triangles 1280 --bumps 0.25 --seed 7 -o meshes/rock.ply", icosphere(1280, 0.25, 7)),
        ("torus --triangles 900 -o meshes/ring.ply", torus(900)),
    ] {
        assert!(comment.contains(&format!("#   rayo make {command}\n")), "{command}");
        let file = folder.join(command.split(' ').next_back().unwrap());
        assert!(Mesh::read(&file).unwrap() == mesh, "{}", file.display());
    }
    let scene = rayo::internals::scene::read(&folder.join("island.toml")).unwrap();
    assert_eq!((scene.name.as_str(), scene.triangle_count()), ("island.png", 1682 + 900 + 2 * 1280));
}

/// Where the camera sees a vertex, in halves of the film from its middle; behind it nowhere.
fn seen(scene: &Scene) -> Vec<(f64, f64)> {
    let grid = scene.camera.grid::<f64>();
    let corners = scene.all_triangles().flat_map(|triangle| triangle.vertices);
    corners
        .map(|v| {
            assert!(v.z > 0.0);
            let scale = grid.focal / f64::from(v.z);
            (f64::from(v.x) * scale / grid.half_width, f64::from(v.y) * scale / grid.half_height)
        })
        .collect()
}

#[test]
fn a_mesh_alone_is_seen_whole_upright_and_as_large_as_it_fits() {
    let camera = |width, height, focal| Camera::new(width, height, focal, 1.0).unwrap();
    let stretched = |by: Vec3, to: Vec3| {
        let mut mesh = icosphere(300, 0.3, 5);
        mesh.vertices.iter_mut().for_each(|vertex| *vertex = *vertex * by + to);
        mesh
    };
    for mesh in [
        icosphere(300, 0.0, 1),
        terrain(200, 1),
        stretched(Vec3::new(1.0, 100.0, 1.0), Vec3::ZERO),
        stretched(Vec3::new(1e-6, 1e-6, 3e-6), Vec3::new(5.0, 0.0, 0.0)),
        stretched(Vec3::splat(1e30), Vec3::splat(-1e31)),
    ] {
        for camera in [Camera::default(), camera(100, 900, 1.0), camera(900, 100, 3.0)] {
            for format in FORMATS {
                let setting = Setting::of(&mesh, format, &camera).unwrap();
                let scene = setting.scene(mesh.clone(), String::new()).unwrap();
                let seen = seen(&scene);
                let reach = seen.iter().map(|(x, y)| x.abs().max(y.abs())).fold(0.0, f64::max);
                assert!((0.45..0.92).contains(&reach), "{format}: {reach}");
            }
        }
    }
    // Up is up, right is right, and what is in front is nearer.
    let points =
        |up: Vec3| Mesh { vertices: vec![Vec3::ZERO, up, Vec3::X], triangles: vec![[0, 1, 2]], ..Mesh::default() };
    for (format, up, front) in [(MeshFormat::Obj, Vec3::Y, Vec3::Z), (MeshFormat::Stl, Vec3::Z, -Vec3::Y)] {
        let setting = Setting::of(&points(up), format, &Camera::default()).unwrap();
        let mut mesh = points(up);
        mesh.vertices.push(0.1 * front);
        mesh.triangles.push([3, 1, 2]);
        let scene = setting.scene(mesh, String::new()).unwrap();
        let [origin, above, right] = scene.triangle(0).vertices;
        let [nearer, ..] = scene.triangle(1).vertices;
        assert!(above.y > origin.y && right.x > origin.x && nearer.z < origin.z, "{format}");
    }
    // A vertex that no triangle has is not seen, and does not count.
    let (square, mut strewn) = (terrain(2, 1), terrain(2, 1));
    strewn.vertices.push(Vec3::splat(1e9));
    let view = |mesh: &Mesh| Setting::of(mesh, MeshFormat::Ply, &Camera::default()).unwrap().view;
    assert_eq!(view(&strewn), view(&square));
    // One point is no reason to fail.
    let point = Mesh { vertices: vec![Vec3::ONE], triangles: vec![[0, 0, 0]], ..Mesh::default() };
    assert!(Setting::of(&point, MeshFormat::Obj, &Camera::default()).is_some());
}

/// The outline as an OBJ file with one face, in a plane of any direction, and what its triangles
/// cover in that plane.
fn cut(outline: &[(f32, f32)]) -> Result<Vec<[DVec2; 3]>, MeshError> {
    let (along, across) = (Vec3::new(2.0, 1.0, 2.0), Vec3::new(-2.0, 2.0, 1.0));
    let vertices: String = outline
        .iter()
        .map(|&(u, v)| (u * along + v * across).to_array())
        .map(|[x, y, z]| format!("v {x} {y} {z}\n"))
        .collect();
    let corners: String = (1..=outline.len()).map(|number| format!(" {number}")).collect();
    let mesh = Mesh::from_bytes(format!("{vertices}f{corners}\n").into_bytes(), MeshFormat::Obj, "test")?;
    let in_plane = |corner: Vec3| DVec2::new(corner.dot(along).into(), corner.dot(across).into()) / 9.0;
    Ok(soup(&mesh).into_iter().map(|corners| corners.map(|corner| in_plane(corner.into()))).collect())
}

/// Twice the area to the left of a way round.
fn doubled_area(outline: &[DVec2]) -> f64 {
    (1..outline.len() - 1).map(|i| (outline[i] - outline[0]).perp_dot(outline[i + 1] - outline[0])).sum()
}

#[test]
fn concave_face_is_covered_exactly_once() {
    let comb = |teeth: i32| {
        let tooth =
            |i: i32| [(2 * i, 0), (2 * i + 1, 0), (2 * i + 1, 9), (2 * i + 2, 9)].map(|(u, v)| (u as f32, v as f32));
        (0..teeth).flat_map(tooth).chain([(2.0 * teeth as f32, 10.0), (0.0, 10.0)]).collect::<Vec<_>>()
    };
    let mut rng = Rng::new(1);
    let star = (0..40).map(|i| {
        let (angle, radius) = (i as f32 * 0.157, rng.between(0.2, 5.0));
        (radius * angle.cos(), radius * angle.sin())
    });
    for outline in [
        vec![(0.0, 0.0), (4.0, -2.0), (1.0, 0.0), (4.0, 2.0)], // an arrowhead, whose fan is right from one corner only
        vec![(4.0, -2.0), (1.0, 0.0), (4.0, 2.0), (0.0, 0.0)],
        vec![(4.0, 2.0), (0.0, 0.0), (4.0, -2.0), (1.0, 0.0)],
        vec![(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0)],
        // A hole, which is reached by a cut that is gone both ways.
        vec![
            (0.0, 0.0),
            (9.0, 0.0),
            (9.0, 9.0),
            (0.0, 9.0),
            (0.0, 0.0),
            (3.0, 3.0),
            (3.0, 6.0),
            (6.0, 6.0),
            (6.0, 3.0),
            (3.0, 3.0),
        ],
        // Two triangles that meet at a corner, and spikes from a square, out and in.
        vec![(-2.0, 0.0), (0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 0.0), (-2.0, 1.0)],
        vec![(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (7.0, 9.0), (4.0, 4.0), (0.0, 4.0)],
        vec![(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (1.0, 2.0), (4.0, 4.0), (0.0, 4.0)],
        star.collect(),
        comb(200),
    ] {
        for (turned, times) in [(false, 1), (true, 1), (false, 2), (true, 3)] {
            // A corner may be repeated, the first one at the end too.
            let mut outline: Vec<_> = outline.iter().flat_map(|&corner| iter::repeat_n(corner, times)).collect();
            outline.rotate_left(times / 2);
            if turned {
                outline.reverse();
            }
            let points: Vec<_> = outline.iter().map(|&(u, v)| DVec2::new(u.into(), v.into())).collect();
            let triangles = cut(&outline).unwrap();
            assert_eq!(triangles.len(), outline.len() - 2);
            // Each is turned as the face is: they overlap nowhere if together they are as large.
            let (whole, tiny) = (doubled_area(&points), 1e-4);
            let areas: Vec<_> = triangles.iter().map(|triangle| doubled_area(triangle) * whole.signum()).collect();
            assert!(areas.iter().all(|area| *area > -tiny), "{outline:?}: {areas:?}");
            assert!((areas.iter().sum::<f64>() - whole.abs()).abs() < 1e-4 * whole.abs(), "{outline:?}: {areas:?}");
        }
    }
    // What would take for ever is refused, with what to do.
    let error = cut(&comb(20_000)).unwrap_err().to_string();
    assert_eq!(error, "test: face 1 has 80002 corners and is not convex: expected triangles in its place");
    // An outline that crosses itself, and one on a line, have no inside; they are cut all the same.
    assert_eq!(cut(&[(0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)]).unwrap().len(), 2);
    assert_eq!(cut(&[(0.0, 0.0), (3.0, 0.0), (1.0, 0.0), (2.0, 0.0), (0.5, 0.0)]).unwrap().len(), 3);
    assert_eq!(cut(&[(1.0, 2.0); 5]).unwrap().len(), 3);
}

#[test]
fn a_mesh_of_many_pieces_is_the_same_wherever_these_end() {
    let shape = terrain(20_000, 2);
    let [obj, ply] = [MeshFormat::Obj, MeshFormat::Ply].map(|format| {
        let mut file = Vec::new();
        shape.write(format, &mut file).unwrap();
        file
    });
    let after = ply.iter().enumerate().filter(|(_, byte)| **byte == b'\n').nth(1).unwrap().0 + 1;
    for more in 0..16 {
        let comment = "c".repeat(more);
        let obj = [format!("# {comment}\n").as_bytes(), &obj].concat();
        assert_eq!(soup(&read(MeshFormat::Obj, obj).unwrap()), soup(&shape));
        let header = format!("ply\nformat binary_little_endian 1.0\ncomment {comment}\n");
        assert!(read(MeshFormat::Ply, [header.as_bytes(), &ply[after..]].concat()).unwrap() == shape);
    }
    // A line that is longer than what is at hand, and a header.
    for blanks in [8 << 10, 1 << 20].map(|count| " ".repeat(count)) {
        let long = [&obj[..], b"f 1", blanks.as_bytes(), b" 2 3\n", &b"# after\n".repeat(100_000)].concat();
        assert_eq!(read(MeshFormat::Obj, long).unwrap().triangles.len(), shape.triangles.len() + 1);
        let header = format!("ply\nformat binary_little_endian 1.0\ncomment {blanks}\n");
        assert!(read(MeshFormat::Ply, [header.as_bytes(), &ply[after..]].concat()).unwrap() == shape);
    }
}

#[test]
fn ply_is_read_alike_in_either_byte_order() {
    const POINT: [(&str, &str); 3] = [("float", "x"), ("float", "y"), ("float", "z")];
    let colour = |of| ["red", "green", "blue"].map(|channel| (of, channel));
    let number = |of: &str, value: usize| match of {
        "float" => (value as f32 / 4.0).to_le_bytes().to_vec(),
        "double" => (value as f64 / 4.0).to_le_bytes().to_vec(),
        "ushort" => (value as u16).to_le_bytes().to_vec(),
        _ => vec![value as u8],
    };
    for (of_vertex, of_face) in [
        (POINT.to_vec(), vec![]),
        ([&colour("ushort")[..], &POINT].concat(), colour("uchar").to_vec()),
        ([&[("double", "nx")][..], &POINT, &colour("uchar"), &[("uchar", "s")]].concat(), vec![("double", "t")]),
        ([&POINT[..], &colour("double")].concat(), colour("float").to_vec()),
    ] {
        let list =
            |of: &[(&str, &str)]| of.iter().map(|(of, name)| format!("property {of} {name}\n")).collect::<String>();
        let (vertex, face) = (list(&of_vertex), list(&of_face));
        let mut numbers = Vec::new();
        (0..5).for_each(|i| numbers.extend(of_vertex.iter().zip(1..).map(|((of, _), at)| number(of, i * i * at + at))));
        let (z, points) = (of_vertex.iter().position(|(_, name)| *name == "z").unwrap(), numbers.len());
        for (i, corners) in [&[0, 1, 2_i32][..], &[0, 1, 2, 3], &[2, 3, 4]].into_iter().enumerate() {
            numbers.push(vec![corners.len() as u8]);
            numbers.extend(corners.iter().map(|corner| corner.to_le_bytes().to_vec()));
            numbers.extend(of_face.iter().zip(1..).map(|((of, _), at)| number(of, i * at)));
        }
        let read_both = |numbers: &[Vec<u8>], length: usize| {
            let [little, big] = ["little", "big"].map(|order| {
                let header = format!(
                    "ply\nformat binary_{order}_endian 1.0\nelement vertex 5\n{vertex}element face 3\n\
                     property list uchar int vertex_indices\n{face}end_header\n"
                );
                let mut bytes = numbers.to_vec();
                bytes.iter_mut().filter(|_| order == "big").for_each(|number| number.reverse());
                let mesh = read(MeshFormat::Ply, [header.as_bytes(), &bytes.concat()[..length]].concat());
                // Which tells -0 from 0.
                mesh.map(|mesh| format!("{mesh:?}")).map_err(|error| error.to_string())
            });
            assert_eq!(little, big);
            little
        };
        let length = numbers.concat().len();
        assert!(read_both(&numbers, length).is_ok());
        (0..length).for_each(|end| assert!(read_both(&numbers, end).is_err()));
        // A point that is nowhere, an index beyond the vertices, one below 0, a face of two
        // corners.
        for (at, wrong) in [
            (z, f32::NAN.to_le_bytes().to_vec()),
            (points + 1, 5_i32.to_le_bytes().to_vec()),
            (points + 3, (-1_i32).to_le_bytes().to_vec()),
            (points, vec![2]),
        ] {
            let mut numbers = numbers.clone();
            numbers[at] = wrong;
            assert!(read_both(&numbers, length).is_err());
        }
    }
}

/// A header that counts less than there is does not hide the rest.
#[test]
fn what_follows_the_elements_that_a_header_counts_is_told() {
    let quad = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n";
    let facet = [[0_u8; 12].as_slice(), &[0, 0, 0x80, 0x3f].repeat(9), &[0; 2]].concat();
    let stl = |count: u8, facets: usize| [[b' '; 80].as_slice(), &[count, 0, 0, 0], &facet.repeat(facets)].concat();
    for (source, format, is_told) in [
        (quad.into(), MeshFormat::Ply, false),
        (format!("{quad}\n \n").into_bytes(), MeshFormat::Ply, false),
        (format!("{quad}3 0 2 3\n").into_bytes(), MeshFormat::Ply, true),
        (stl(2, 2), MeshFormat::Stl, false),
        (stl(1, 2), MeshFormat::Stl, true),
    ] {
        let mesh = Mesh::from_bytes(source, format, "a mesh").unwrap();
        assert_eq!(mesh.notes.iter().any(|note| note.starts_with("the file goes on after the ")), is_told, "{mesh:?}");
    }
}

#[test]
fn ply_lines_longer_than_the_header_says_are_told() {
    let mesh = |format: &str, vertex: &str, face: &str| {
        let header = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
                      property list uchar int vertex_indices\nproperty uchar flags\nend_header\n";
        let text = format!("ply\nformat {format}\n{header}0 0 0\n1 0 0{vertex}\n1 1 0\n3 0 1 2 7{face}\n");
        Mesh::from_bytes(text.into(), MeshFormat::Ply, "a mesh")
    };
    let told = "lines have more numbers than the properties that the header lists: these were not read";
    assert!(mesh("ascii 1.0", " ", " ").unwrap().notes.is_empty());
    assert_eq!(mesh("ascii 1.0", " 0.5", "").unwrap().notes, [told]);
    assert_eq!(mesh("ascii 1.0", "", " 9").unwrap().notes, [told]);
    let other = mesh("ascii 2.0", "", "").unwrap_err();
    assert_eq!(other.to_string(), "a mesh: the format's version is 2.0: expected 1.0, as in: format ascii 1.0");
}
