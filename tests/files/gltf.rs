//! glTF files: the positions and colours of the triangles made from them, and the errors for
//! invalid files.

use std::fs;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use glam::{DVec3, Vec3};
use rayo::internals::scene::{Camera, Mesh, MeshFormat, ModelOptions, open, open_with};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::meshes::{colours, read, refused, soup};

const FLOAT: u32 = 5126;
const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;

/// The corners of a square (not quite planar), in the order of a triangle strip.
const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5], [1.0, 1.0, 0.25]];

/// A file under construction: its JSON, and the bytes of its only buffer.
struct Model {
    json: Value,
    bytes: Vec<u8>,
}

impl Model {
    /// A file with one node, whose mesh is a primitive with the corners of the square.
    fn square() -> Self {
        let mut model = Model {
            json: json!({
                "asset": {"version": "2.0"},
                "scene": 0,
                "scenes": [{"nodes": [0]}],
                "nodes": [{"mesh": 0}],
                "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "mode": 5}]}],
                "accessors": [], "bufferViews": [], "buffers": [{}],
            }),
            bytes: Vec::new(),
        };
        model.accessor(
            CORNERS.map(|corner| corner.map(f32::to_le_bytes)).as_flattened().as_flattened(),
            FLOAT,
            "VEC3",
            4,
        );
        model
    }

    /// Adds an accessor with a buffer view of its own; returns the accessor's index.
    fn accessor(&mut self, bytes: &[u8], component: u32, of: &str, count: usize) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let view = json!({"buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len()});
        self.bytes.extend(bytes);
        let views = self.json["bufferViews"].as_array_mut().unwrap();
        views.push(view);
        let accessor = json!({"bufferView": views.len() - 1, "componentType": component, "count": count, "type": of});
        let accessors = self.json["accessors"].as_array_mut().unwrap();
        accessors.push(accessor);
        accessors.len() - 1
    }

    fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    /// The file with a change to its JSON.
    fn with(mut self, change: impl FnOnce(&mut Value)) -> Self {
        change(&mut self.json);
        self
    }

    /// The file as JSON text with its buffer embedded.
    fn text(mut self) -> String {
        let length = self.bytes.len();
        let buffer = self.json["buffers"][0].as_object_mut().unwrap();
        buffer.entry("byteLength").or_insert(json!(length));
        let data = format!("data:application/octet-stream;base64,{}", STANDARD.encode(&self.bytes));
        buffer.entry("uri").or_insert(json!(data));
        self.json.to_string()
    }

    /// The file in the binary format.
    fn binary(mut self) -> Vec<u8> {
        self.json["buffers"][0]["byteLength"] = json!(self.bytes.len());
        let mut json = self.json.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let mut file = b"glTF\x02\0\0\0".to_vec();
        for (kind, content) in [(b"JSON", &json), (b"BIN\0", &self.bytes)] {
            let length = (content.len() as u32).to_le_bytes();
            file.extend([&length, kind, &content[..]].concat());
        }
        let length = (file.len() + 4) as u32;
        file.splice(8..8, length.to_le_bytes());
        file
    }

    fn mesh(self) -> Mesh {
        let text = self.text();
        read(MeshFormat::Gltf, text.clone()).unwrap_or_else(|error| panic!("{error}: {text}"))
    }

    fn refused(self) -> String {
        let error = refused(MeshFormat::Gltf, self.text());
        error.strip_prefix("test: ").unwrap().to_owned()
    }
}

/// The two triangles of the square, as a strip defines them.
fn strip() -> Vec<[[f32; 3]; 3]> {
    let [a, b, c, d] = CORNERS;
    vec![[a, b, c], [c, b, d]]
}

fn indices(kind: u32, indices: &[u8]) -> Vec<u8> {
    let size = if kind == UNSIGNED_INT { 4 } else { if kind == UNSIGNED_SHORT { 2 } else { 1 } };
    indices.iter().flat_map(|index| u32::from(*index).to_le_bytes()[..size].to_vec()).collect()
}

#[test]
fn triangles_strips_and_fans_are_read_with_any_indices() {
    assert_eq!(soup(&Model::square().mesh()), strip());
    assert_eq!(soup(&read(MeshFormat::Gltf, Model::square().binary()).unwrap()), strip());
    for kind in [UNSIGNED_BYTE, UNSIGNED_SHORT, UNSIGNED_INT] {
        // As triangles, as a strip with a degenerate connecting triangle, and as fans around the
        // second and the last corner.
        for (mode, list, expected) in [
            (4, &[0, 1, 2, 2, 1, 3][..], [[0, 1, 2], [2, 1, 3]]),
            (5, &[0, 1, 2, 3], [[0, 1, 2], [2, 1, 3]]),
            (5, &[0, 1, 2, 2, 2, 1, 3], [[0, 1, 2], [2, 1, 3]]),
            (6, &[1, 0, 2, 3], [[1, 0, 2], [1, 2, 3]]),
        ] {
            let mut model = Model::square();
            let accessor = model.accessor(&indices(kind, list), kind, "SCALAR", list.len());
            model.primitive()["indices"] = json!(accessor);
            model.primitive()["mode"] = json!(mode);
            let expected: Vec<_> = expected.iter().map(|triangle| triangle.map(|corner| CORNERS[corner])).collect();
            assert_eq!(soup(&model.mesh()), expected, "{kind} {mode} {list:?}");
        }
    }
    // The default mode is triangles; a remainder of fewer than three indices is ignored.
    let mut model = Model::square();
    model.primitive().as_object_mut().unwrap().remove("mode");
    assert_eq!(soup(&model.mesh()), strip()[..1]);
}

#[test]
fn nodes_move_their_meshes_as_their_parents_move_them() {
    let turned = json!([0.0, 0.0, std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::FRAC_1_SQRT_2]);
    let by_parts = json!({"mesh": 0, "translation": [1, 2, 3], "rotation": turned, "scale": [2, 3, 4]});
    // The same as a matrix by columns: x is mapped to 2y, y to -3x, z to 4z.
    let by_matrix = json!({"mesh": 0, "matrix": [0, 2, 0, 0, -3, 0, 0, 0, 0, 0, 4, 0, 1, 2, 3, 1]});
    for node in [by_parts, by_matrix] {
        let model = Model::square().with(|json| {
            json["nodes"] = json!([{"children": [1], "translation": [10, 0, 0], "scale": [-1, 1, 1]}, node]);
        });
        let mesh = model.mesh();
        for (corner, [x, y, z]) in soup(&mesh)[0].iter().zip(CORNERS) {
            let expected = Vec3::new(10.0 - (1.0 - 3.0 * y), 2.0 + 2.0 * x, 3.0 + 4.0 * z);
            assert!(Vec3::from_array(*corner).distance(expected) < 1e-5, "{corner:?} {expected}");
        }
    }
    // Each node of the scene has an instance, other nodes have none; without a scene all nodes have
    // one.
    let instances = |scenes: Value| {
        let nodes = json!([{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 9]}, {"children": [1]}, {"mesh": 0}]);
        let model = Model::square().with(|json| {
            json["nodes"] = nodes;
            json["scenes"] = scenes;
            if json["scenes"].as_array().unwrap().len() == 2 {
                json["scene"] = json!(1);
            }
        });
        model.mesh().triangles.len()
    };
    assert_eq!(instances(json!([{"nodes": [0, 2]}])), 4);
    assert_eq!(instances(json!([{"nodes": [0, 2]}, {"nodes": [3]}])), 2);
    assert_eq!(instances(json!([])), 6);
}

#[test]
fn colours_are_the_factor_times_the_vertices_in_linear_light() {
    let factor = json!([{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 1.0, 1.0]}}]);
    let with_factor = || {
        let mut model = Model::square().with(|json| json["materials"] = factor.clone());
        model.primitive()["material"] = json!(0);
        model
    };
    assert_eq!(colours(&with_factor().mesh()), [[0.5, 0.25, 1.0]; 2]);
    // Colours in bytes (51 is a fifth), in shorts and floats, with and without an alpha channel.
    let bytes: Vec<u8> = [[255, 0, 51], [255, 0, 51], [255, 0, 51], [0, 0, 0]].concat();
    let shorts: Vec<u8> = bytes.iter().flat_map(|byte| (u16::from(*byte) * 257).to_le_bytes()).collect();
    let floats: Vec<u8> = bytes.iter().flat_map(|byte| (f32::from(*byte) / 255.0).to_le_bytes()).collect();
    for (kind, colour_bytes) in [(UNSIGNED_BYTE, bytes), (UNSIGNED_SHORT, shorts), (FLOAT, floats)] {
        for (of, size) in [("VEC3", 3), ("VEC4", 4)] {
            let channel = colour_bytes.len() / 12;
            let padded: Vec<u8> = colour_bytes
                .chunks(3 * channel)
                .flat_map(|colour| [colour, &vec![0xff; (size - 3) * channel]].concat())
                .collect();
            for (mut model, [red, blue]) in [(Model::square(), [1.0, 0.2]), (with_factor(), [0.5, 0.2])] {
                let accessor = model.accessor(&padded, kind, of, 4);
                model.primitive()["attributes"]["COLOR_0"] = json!(accessor);
                let found = colours(&model.mesh());
                let expected = [[red, 0.0, blue], [red * 2.0 / 3.0, 0.0, blue * 2.0 / 3.0]];
                for (found, expected) in found.iter().zip(expected) {
                    assert!(Vec3::from_array(*found).distance(expected.into()) < 1e-6, "{found:?} {expected:?}");
                }
            }
        }
    }
}

#[test]
fn places_may_be_of_integers_interleaved_or_sparse() {
    let shorts: Vec<u8> =
        [[0_i16, 0, 0], [32767, 0, 0], [0, -32768, 0]].as_flattened().iter().flat_map(|n| n.to_le_bytes()).collect();
    for (normalized, [x, y]) in [(true, [1.0, -1.0]), (false, [32767.0, -32768.0])] {
        let mut model = Model::square();
        let accessor = model.accessor(&shorts, 5122, "VEC3", 3);
        model.json["accessors"][accessor]["normalized"] = json!(normalized);
        model.primitive()["attributes"]["POSITION"] = json!(accessor);
        assert_eq!(soup(&model.mesh()), [[[0.0; 3], [x, 0.0, 0.0], [0.0, y, 0.0]]]);
    }
    let mut model = Model::square();
    let interleaved: Vec<u8> =
        CORNERS.iter().flat_map(|corner| [corner.map(f32::to_le_bytes).as_flattened(), &[7; 8]].concat()).collect();
    let accessor = model.accessor(&interleaved, FLOAT, "VEC3", 4);
    model.json["bufferViews"][accessor]["byteStride"] = json!(20);
    model.primitive()["attributes"]["POSITION"] = json!(accessor);
    assert_eq!(soup(&model.mesh()), strip());
    // A sparse accessor that replaces one corner.
    let sparse = |index: u8| {
        let mut model = Model::square();
        let which = model.accessor(&[index], UNSIGNED_BYTE, "SCALAR", 1);
        let places = model.accessor([7.0_f32, 8.0, 9.0].map(f32::to_le_bytes).as_flattened(), FLOAT, "VEC3", 1);
        model.json["accessors"][0]["sparse"] = json!({
            "count": 1,
            "indices": {"bufferView": which, "byteOffset": 0, "componentType": UNSIGNED_BYTE},
            "values": {"bufferView": places, "byteOffset": 0},
        });
        model
    };
    assert_eq!(soup(&sparse(3).mesh())[1][2], [7.0, 8.0, 9.0]);
    assert_eq!(soup(&sparse(3).mesh())[0], strip()[0]);
    assert!(sparse(4).refused().starts_with("accessors[0] has sparse indices that do not ascend, or are out of range"));
}

#[test]
fn buffers_are_inside_of_the_file_or_beside_it() {
    let folder = TempDir::new().unwrap();
    let write = |name: &str, content: &[u8]| fs::write(folder.path().join(name), content).unwrap();
    let path = folder.path().join("model.gltf");
    let model = |uri: &str| Model::square().with(|json| json["buffers"][0]["uri"] = json!(uri));
    write("a b.bin", &Model::square().bytes);
    for uri in ["a%20b.bin", "a b.bin", "./a%20b.bin"] {
        write("model.gltf", model(uri).text().as_bytes());
        let mesh = Mesh::read(&path).unwrap();
        assert_eq!((soup(&mesh), mesh.libraries.len()), (strip(), 1));
        let opened = open(&path, &Camera::default()).unwrap();
        assert_eq!(opened.files.len(), 2, "the buffer is one of its files");
    }
    let error = |uri: &str| {
        write("model.gltf", model(uri).text().as_bytes());
        let error = Mesh::read(&path).unwrap_err().to_string();
        error.strip_prefix(&format!("{}: ", path.display())).unwrap().to_owned()
    };
    let beside = "expected the file beside this one, as it was exported";
    assert_eq!(error("none.bin"), format!("there is no file `none.bin` for buffers[0]: {beside}"));
    assert_eq!(error("/dev/zero"), format!("there is no file `/dev/zero` for buffers[0]: {beside}"));
    assert!(error("https://example.org/a.bin").starts_with("buffers[0] is at an address"));
    write("short.bin", &[0; 10]);
    assert_eq!(error("short.bin"), "buffers[0] claims 48 bytes, and has 10: expected all of its bytes");
    for data in ["data:application/octet-stream;base64,AA=A", "data:text/plain,AAAA", "data:", "data:;base64"] {
        assert!(error(data).starts_with("buffers[0] has a data: address that cannot be decoded"), "{data}");
    }
    // Without a folder, a buffer in another file is an error.
    assert!(model("a.bin").refused().starts_with("buffers[0] is in another file, `a.bin`"));
}

#[test]
fn what_a_file_refers_to_is_there_or_is_missed_by_its_name() {
    let changed = |change: &dyn Fn(&mut Value)| Model::square().with(change).refused();
    let nan = {
        let mut model = Model::square();
        model.bytes[12..16].copy_from_slice(&f32::NAN.to_le_bytes());
        model.refused()
    };
    assert_eq!(
        nan,
        "vertex 1 of meshes[0].primitives[0] is not finite: expected numbers that f32 holds, within 3.4e38"
    );
    let too_large = {
        let mut model = Model::square();
        let accessor = model.accessor(&[0, 1, 4], UNSIGNED_BYTE, "SCALAR", 3);
        model.primitive()["indices"] = json!(accessor);
        model.refused()
    };
    assert_eq!(too_large, "meshes[0].primitives[0].indices[2] refers to vertex 4, and there are 4: expected 0 to 3");
    type Change = fn(&mut Value);
    let cases: [(Change, &str); 20] = [
        (|json| json["asset"]["version"] = json!("1.0"), "the file is of the version `1.0` of glTF: expected 2.0"),
        (
            |json| json["nodes"] = json!([{"children": [1]}, {"children": [0]}]),
            "nodes[0] is reached twice: expected nodes",
        ),
        (|json| json["nodes"] = json!([{"children": [0]}]), "nodes[0] is reached twice"),
        (|json| json["nodes"] = json!([{"children": [1, 1]}, {}]), "nodes[1] is reached twice"),
        (|json| json["nodes"] = json!([{"children": [9]}]), "a scene or a node refers to nodes[9], and the file has 1"),
        (|json| json["nodes"][0]["mesh"] = json!(7), "nodes[0] refers to meshes[7], and the file has 1 of them"),
        (|json| json["nodes"][0]["camera"] = json!(0), "nodes[0] refers to cameras[0], and the file has 0 of them"),
        (|json| json["nodes"][0]["scale"] = json!([1e39, 1, 1]), "the transformation of nodes[0] is not finite"),
        (|json| json["scene"] = json!(3), "the file refers to scenes[3], and the file has 1 of them"),
        (|json| json["accessors"][0]["count"] = json!(5), "accessors[0] has 5 elements of 12 bytes, 12 bytes apart"),
        (
            |json| json["accessors"][0]["count"] = json!(u64::MAX),
            "accessors[0] has 18446744073709551615 elements of 12",
        ),
        (
            |json| json["accessors"][0]["count"] = json!(0),
            "accessors[0], of meshes[0].primitives[0].attributes.POSITION",
        ),
        (
            |json| json["accessors"][0]["byteOffset"] = json!(1),
            "accessors[0] has 4 elements of 12 bytes, 12 bytes apart",
        ),
        (
            |json| json["accessors"][0]["type"] = json!("VEC2"),
            "accessors[0], of meshes[0].primitives[0].attributes.POSITION",
        ),
        (
            |json| json["accessors"][0] = json!({"componentType": FLOAT, "count": 1_u64 << 60, "type": "VEC3"}),
            "accessors[0], of",
        ),
        (
            |json| json["bufferViews"][0]["byteLength"] = json!(49),
            "bufferViews[0] has 49 bytes from 0 on, and buffers[0] has",
        ),
        (
            |json| json["bufferViews"][0]["byteOffset"] = json!(u64::MAX),
            "bufferViews[0] has 48 bytes from 18446744073709551615",
        ),
        (|json| json["bufferViews"][0]["buffer"] = json!(2), "bufferViews[0] refers to buffers[2]"),
        (
            |json| json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]),
            "the file needs the extension `KHR_draco",
        ),
        (|json| json["meshes"][0]["primitives"][0]["mode"] = json!(1), "the mesh is empty: expected at least one face"),
    ];
    for (change, message) in cases {
        let error = changed(&change);
        assert!(error.starts_with(message), "{error} is not {message}");
    }
    let first = r#"{"asset": {"version": 1.0}, "nodes": {"a": {}}}"#;
    assert!(refused(MeshFormat::Gltf, first).starts_with("test: the file is of the version `1.0` of glTF"));
    let compressed = changed(&|json| {
        json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
        json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    });
    assert!(compressed.ends_with("has no bytes for its 4 elements: expected a bufferView: decompress the file first"));
    assert!(refused(MeshFormat::Gltf, "{}").starts_with("test: the JSON is not that of glTF: missing field"));
    let binary = Model::square().binary();
    for length in [0, 5, 11, 12, 19, 30, binary.len() - 1] {
        let error = refused(MeshFormat::Gltf, &binary[..length]);
        assert!(error.starts_with("test: "), "{error}");
    }
    let old = [b"glTF\x01\0\0\0".as_slice(), &binary[8..]].concat();
    assert!(
        refused(MeshFormat::Gltf, old).starts_with("test: this is binary glTF of the version 1: expected version 2")
    );
    assert!(refused(MeshFormat::Gltf, "<!doctype html>").starts_with("test: this is a web page"));
}

#[test]
fn instances_do_not_multiply_beyond_measure() {
    let model = Model::square().with(|json| {
        let nodes: Vec<_> = (0..3000).map(|_| json!({"mesh": 0})).collect();
        json["scenes"][0]["nodes"] = json!((0..3000).collect::<Vec<_>>());
        json["nodes"] = json!(nodes);
        // Primitives that share their positions.
        let primitive = json["meshes"][0]["primitives"][0].clone();
        json["meshes"][0]["primitives"] = json!(vec![primitive; 10_000]);
        // A buffer that is declared but never read does not raise the limit.
        json["buffers"].as_array_mut().unwrap().push(json!({"byteLength": 1_000_000_000_000_u64}));
    });
    // The file of 300 kB would have 60 million triangles; reading it takes only the memory that the
    // limit allows.
    let error = Mesh::from_bytes(model.text().into_bytes(), MeshFormat::Gltf, "test").unwrap_err().to_string();
    assert!(error.contains("triangles, instances of meshes being counted each by itself"), "{error}");
}

#[test]
fn the_first_camera_and_point_lights_are_the_files_own() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("model.gltf");
    let model = Model::square().with(|json| {
        json["nodes"] = json!([
            {"mesh": 0},
            {"camera": 0}, {"camera": 1, "translation": [0.5, 0.5, 4]}, {"camera": 1},
            {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0.5, 0.5, 2]},
            {"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [0.5, 0.5, -4]},
            {"extensions": {"KHR_lights_punctual": {"light": 1}}},
        ]);
        json["scenes"][0]["nodes"] = json!([0, 1, 2, 3, 4, 5, 6]);
        json["cameras"] = json!([
            {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0, "zfar": 9}},
            {"type": "perspective", "perspective": {"yfov": std::f64::consts::FRAC_PI_3, "znear": 0.1}},
        ]);
        json["extensions"]["KHR_lights_punctual"]["lights"] = json!([
            {"type": "point", "color": [1, 0.5, 0], "intensity": 40},
            {"type": "directional"},
        ]);
    });
    fs::write(&path, model.text()).unwrap();
    let opened = open(&path, &Camera::default()).unwrap();
    let scene = opened.scene;
    // The camera is at z = 4 in front of the square and looks at it, from a distance of 4.
    assert_eq!(scene.view.position, DVec3::new(0.5, 0.5, -4.0));
    let [a, b, c] = scene.triangle(0).vertices;
    assert_eq!([a, b, c], [Vec3::new(-0.5, -0.5, 4.0), Vec3::new(0.5, -0.5, 4.0), Vec3::new(-0.5, 0.5, 3.5)]);
    let grid = scene.camera.grid::<f64>();
    assert!((grid.half_height / grid.focal - (std::f64::consts::PI / 6.0).tan()).abs() < 1e-6);
    // The lights' positions, colours and shares: the second light is about twice as far from the
    // middle of the square, and weaker.
    assert_eq!(scene.lights.len(), 3);
    assert_eq!(scene.lights[0].position, Vec3::new(0.0, 0.0, 2.0));
    assert_eq!(scene.lights[1].position, Vec3::new(0.0, 0.0, 8.0));
    assert_eq!(scene.lights[0].colour, Vec3::new(1.0, 0.5, 0.0));
    let [near, far, fill] = [0, 1, 2].map(|light: usize| scene.lights[light].intensity);
    assert!((near + far - 0.8).abs() < 1e-6 && fill == 0.2 && near > 4.0 * far && far > 0.05, "{near} {far}");
    let notes = opened.notes.join("\n");
    assert!(notes.contains("not read: orthographic cameras, directional lights and spots"), "{notes}");
    assert!(notes.contains("the camera is the file's first one; the point lights are the file's"), "{notes}");
    // Options replace both the camera and the lights of the file.
    let options = ModelOptions {
        from: Some(DVec3::X),
        lights: vec![DVec3::Y],
        ambient: Some(0.5),
        ..ModelOptions::of(Camera::default())
    };
    let scene = open_with(&path, &options).unwrap().scene;
    assert_eq!(scene.lights.iter().map(|light| light.intensity).collect::<Vec<_>>(), [0.5, 0.5]);
    assert_eq!((scene.camera, scene.lights[0].colour), (Camera::default(), Vec3::ONE));
}

#[test]
fn what_is_not_read_is_told_once() {
    let mut model = Model::square().with(|json| {
        json["materials"] = json!([{
            "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "alphaMode": "BLEND",
        }]);
        json["textures"] = json!([{}]);
        json["nodes"][0]["skin"] = json!(0);
        json["skins"] = json!([{"joints": [0]}]);
        json["animations"] = json!([{"channels": [], "samplers": []}]);
        json["extensionsUsed"] = json!(["KHR_draco_mesh_compression", "KHR_materials_ior", "EXT_meshopt_compression"]);
        json["extensionsRequired"] = json!(["KHR_texture_transform", "KHR_materials_unlit"]);
    });
    model.primitive()["material"] = json!(0);
    model.primitive()["targets"] = json!([{"POSITION": 0}]);
    let line = json!({"attributes": {"POSITION": 0}, "mode": 3});
    model.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(line);
    let mesh = model.mesh();
    assert_eq!(soup(&mesh), strip());
    assert_eq!(
        mesh.notes,
        [
            "not read: textures, transparency, skins, morph targets, animations, points and lines, Draco's compressed copies, \
         meshopt's compressed copies"
        ]
    );
}

#[test]
fn a_model_far_from_0_keeps_its_digits() {
    let model = Model::square().with(|json| json["nodes"][0]["translation"] = json!([4_000_000, 8_000_000, 0]));
    let mesh = model.mesh();
    assert_eq!(mesh.origin + mesh.vertices[3].as_dvec3(), DVec3::new(4_000_001.0, 8_000_001.0, 0.25));
    let mut file = Vec::new();
    mesh.write(MeshFormat::Gltf, &mut file).unwrap();
    let again = read(MeshFormat::Gltf, file).unwrap();
    assert_eq!(again.origin + again.vertices[3].as_dvec3(), DVec3::new(4_000_001.0, 8_000_001.0, 0.25));
}
