//! Scene files in TOML: what is read and transformed to camera coordinates, and the errors for
//! invalid files.

use std::fs;
use std::path::Path;

use crate::counting::peak_of;
use glam::{DMat3, DVec3, Vec3};
use rayo::internals::scene::mesh::Placement;
use rayo::internals::scene::mesh::shapes::icosphere;
use rayo::internals::scene::{
    Camera, Light, MeshFormat, Opened, Scene, SceneError, Setting, many, open, parse_toml, read,
};

/// Parses a file and checks that this takes at most a multiple of its length in memory.
fn parse(source: &[u8]) -> Result<Opened, SceneError> {
    let (opened, peak) = peak_of(|| parse_toml(source, "test.toml", Path::new("")));
    assert!(peak <= 300 * source.len() + (256 << 10), "{peak} bytes for a file of {}", source.len());
    opened
}

fn accepted(source: impl AsRef<[u8]>) -> Scene {
    parse(source.as_ref()).unwrap_or_else(|error| panic!("refused:\n{error}")).scene
}

/// The errors, one line for each diagnostic.
fn refused(source: impl AsRef<[u8]>) -> Vec<String> {
    parse(source.as_ref()).expect_err("a refusal").lines()
}

/// A scene with everything that needs no other file.
const VALID: &str = r#"
[image]
file = "room.png"
width = 640
height = 0x1e0

[camera]
focal = 2
film = 35.0

[[light]]
position = [20, -20.0, 0]
colour = [1, 0.25, 0]
intensity = 0.5

[[sphere]]
centre = [0, 0, 1_20]
radius = 30

[[sphere]]
centre = [-1e1, 0.5, +7]
radius = 2.5
colour = [0, 0.5, 1]

[[triangle]]
vertices = [[0, 0, 1], [1, 0, 1], [0, 1, 1]]
colour = [1, 0, 0]
"#;

#[test]
fn every_value_of_a_file_lands_in_its_place() {
    let same = "\
        x.png 1 1 1
        1  0.5  1 0.25 0  20 -20 0
        2  30  1 1 1  0 0 120    2.5  0 0.5 1  -10 0.5 7
        1  1 0 0  0 0 1  1 0 1  0 1 1";
    let same = rayo::internals::scene::parse(same.as_bytes(), "the same objects").unwrap();
    let expected = Scene { name: "room.png".into(), camera: Camera::new(640, 480, 2.0, 35.0).unwrap(), ..same };
    assert_eq!(accepted(VALID), expected);
    assert_eq!(accepted(format!("\u{feff}{}", VALID.replace('\n', "\r\n"))), expected);
}

#[test]
fn too_much_text_is_refused_before_it_takes_memory() {
    let directory = tempfile::tempdir().unwrap();
    let long = directory.path().join("long.toml");
    fs::File::create(&long).unwrap().set_len((32 << 20) + 1).unwrap();
    let (error, peak) = peak_of(|| read(&long).unwrap_err().to_string());
    let advice = "too many for TOML: put its triangles into a mesh file, which [[mesh]] names";
    assert!(error.ends_with(&format!("cannot be read: it has more than 32 MiB, {advice}")), "{error}");
    assert!(peak < 1 << 16, "{peak} bytes");
}

#[test]
fn triangles_of_no_area_are_told_by_line_or_number() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    let mut text = "image = { width = 9, height = 7 }\n".to_owned();
    for _ in 0..12 {
        text += "[[triangle]]\nvertices = [[0, 0, 5], [1, 0, 5], [2, 0, 5]]\n";
    }
    text += "[[mesh]]\nfile = \"flat.obj\"\n";
    let mesh = "v 0 0 5\nv 1 0 5\nv 3 0 5\nv 0 1 5\nf 1 2 4\n".to_owned() + &"f 1 2 3\n".repeat(1000);
    fs::write(path("flat.obj"), &mesh).unwrap();
    fs::write(path("flat.toml"), text).unwrap();
    let warnings = |name: &str| {
        let folder = format!("{}{}", directory.path().display(), std::path::MAIN_SEPARATOR);
        let warnings = open(&path(name), &Camera::default()).unwrap().warnings;
        warnings.into_iter().map(|line| line.replace(&folder, "")).collect::<Vec<_>>()
    };
    let found = warnings("flat.toml");
    let line = "triangle 10 has no area, and no ray hits it: its corners are on one line";
    assert_eq!((found.len(), &found[9][..]), (12, &format!("flat.toml:20: {line}")[..]));
    assert_eq!(found[10], "flat.toml: and 2 more triangles have no area");
    let many = "1000 triangles have no area, and no ray hits them: 2, 3, 4, 5, 6 and so on";
    assert_eq!(found[11], format!("flat.obj: {many}"));
    assert_eq!(warnings("flat.obj"), [format!("flat.obj: {many}")]);
    fs::write(path("flat.obj"), &mesh[..mesh.len() - 999 * 8]).unwrap();
    assert_eq!(warnings("flat.obj"), ["flat.obj: triangle 2 has no area, and no ray hits it"]);

    // A triangle whose corners are collinear stays without area after a transformation, although
    // rounding would give it one.
    let text = "image = { width = 9, height = 7 }\ncamera = { position = [1, 2, 3], look_at = [0.3, 0.1, 9] }\n\
        [[triangle]]\nvertices = [[0.1, 0.3, 5], [0.2, 0.6, 5], [0.3, 0.9, 5]]\n\
        [[triangle]]\nvertices = [[0.1, 0.3, 5], [0.2, 0.6, 5], [0.3, 0.9001, 5]]\n\
        [[mesh]]\nfile = \"flat.obj\"\nscale = 0.7\nrotate = [10, 20, 30]\n";
    fs::write(path("aside.toml"), text).unwrap();
    let of_mesh = "flat.obj: triangle 2 has no area, and no ray hits it";
    let first = "aside.toml:3: triangle 1 has no area, and no ray hits it: its corners are on one line";
    assert_eq!(warnings("aside.toml"), [first, of_mesh]);
    let scene = read(&path("aside.toml")).unwrap();
    assert_eq!(
        scene.all_triangles().map(|triangle| triangle.has_no_area()).collect::<Vec<_>>(),
        [true, false, false, true]
    );
}

#[test]
fn what_is_left_out_has_a_default() {
    let scene = accepted(
        "image = { width = 9, height = 7 }\nlight = [{ position = [1, 2, 3] }]\n\
         [[triangle]]\nvertices = [[0, 0, 1], [1, 0, 1], [0, 1, 1]]\n",
    );
    assert_eq!(scene.name, "test.png");
    assert_eq!(scene.camera, Camera::new(9, 7, 1.0, 1.0).unwrap());
    assert_eq!(scene.lights, [Light { intensity: 1.0, colour: Vec3::ONE, position: Vec3::new(1.0, 2.0, 3.0) }]);
    assert_eq!(scene.triangles[0].colour, Vec3::ONE);
    assert!(!scene.shadows);
}

#[test]
fn numbers_are_rounded_once_to_f32() {
    // Slightly above the midpoint of 1 and the next f32: rounding to f64 first would give 1.
    let scene = accepted(VALID.replace("[20, -20.0, 0]", "[1.000000059604644775390626, 1e-60, -0.0]"));
    let position = scene.lights[0].position.to_array().map(f32::to_bits);
    assert_eq!(position, [1.0 + f32::EPSILON, 0.0, -0.0].map(f32::to_bits));
}

#[test]
fn the_world_is_moved_into_the_cameras_frame() {
    let world = |camera: &str, point: [f64; 3]| {
        let [x, y, z] = point;
        let text = format!(
            "image = {{ width = 9, height = 7 }}\n[camera]\n{camera}\n[[sphere]]\nradius = 1\ncentre = [{x}, {y}, {z}]\n\
             [[light]]\nposition = [{x}, {y}, {z}]\n[[triangle]]\nvertices = [[{x}, {y}, {z}], [0, 0, 0], [1, 1, 1]]\n"
        );
        let scene = accepted(text);
        let seen = scene.spheres[0].centre;
        assert_eq!([scene.lights[0].position, scene.triangles[0].vertices[0]], [seen; 2]);
        seen
    };
    let at = |x, y, z| Vec3::new(x, y, z);
    // The camera at rest, written in several ways.
    for camera in
        ["", "position = [0, 0, 0]", "look_at = [0, 0, 7]", "up = [0, 2, 1]", "look_at = [0, 0, 1]\nup = [0, 1, 0]"]
    {
        assert_eq!(world(camera, [0.1, -2.0, 3e9]), at(0.1, -2.0, 3e9), "{camera}");
    }
    // Moved; the view stays along z.
    assert_eq!(world("position = [1, 2, 3]", [1.0, 2.0, 3.0]), at(0.0, 0.0, 0.0));
    assert_eq!(world("position = [1, 2, 3]", [2.0, 2.0, 5.0]), at(1.0, 0.0, 2.0));
    // From the other side left and right change places, and nothing is mirrored.
    assert_eq!(world("position = [0, 0, 10]\nlook_at = [0, 0, 0]", [1.0, 2.0, 3.0]), at(-1.0, 2.0, 7.0));
    // From the right, along -x: z is to the right.
    assert_eq!(world("position = [10, 0, 0]\nlook_at = [0, 0, 0]", [1.0, 2.0, 3.0]), at(3.0, 2.0, 9.0));
    // From above, z is up in the picture.
    let above = "position = [0, 10, 0]\nlook_at = [0, 0, 0]\nup = [0, 0, 1]";
    assert_eq!(world(above, [1.0, 2.0, 3.0]), at(1.0, 3.0, 8.0));
    // Turned upside down.
    assert_eq!(world("up = [0, -1, 0]", [1.0, 2.0, 3.0]), at(-1.0, -2.0, 3.0));
    // Differences that f32 would lose are taken in f64 and rounded once.
    assert_eq!(world("position = [1e6, 0, 0]\nlook_at = [1e6, 0, 5]", [1_000_000.001, 0.0, 1.0]).x, 0.001_f32);
}

/// The light, the centre of the sphere and the corners of the triangle.
fn points_of(scene: &Scene) -> impl Iterator<Item = Vec3> {
    let corners = scene.triangles[0].vertices;
    [scene.lights[0].position, scene.spheres[0].centre].into_iter().chain(corners)
}

#[test]
fn a_scene_that_was_read_is_seen_from_places_in_its_own_world() {
    let world = |camera: &str| {
        accepted(format!(
            "image = {{ width = 9, height = 7 }}\n[camera]\n{camera}\n[[light]]\nposition = [-4, 6.5, -3]\n\
             [[sphere]]\nradius = 1\ncentre = [0.3, 0.1, 2.7]\n\
             [[triangle]]\nvertices = [[0.1, -1, 4], [1.7, 0.3, 4], [0.2, 1.1, 3.9]]\n"
        ))
    };
    let views = [
        "position = [3, 1.2, -5]\nlook_at = [0, 0.1, 2]",
        "position = [-7.5, 4, 11]\nlook_at = [1, 0, 2]\nup = [0.1, 1, 0.2]",
        "position = [0, 50, 2]\nlook_at = [0, 0, 2]\nup = [0, 0, 1]",
        "",
    ];
    for from in views {
        let scene = world(from);
        assert_eq!(scene.seen_from(scene.view).unwrap(), scene, "{from}");
        assert_eq!(scene.seen_from(scene.orbit(0.0).unwrap()).unwrap(), scene, "{from}");
        for to in views {
            let (expected, moved) = (world(to), scene.seen_from(world(to).view).unwrap());
            assert_eq!(moved.view, expected.view);
            for (moved, expected) in points_of(&moved).zip(points_of(&expected)) {
                // Each is rounded to f32 in the frame of the first camera too, which is at most 60
                // away.
                assert!(moved.distance(expected) < 1e-5, "{from}, then {to}: {moved}, expected {expected}");
            }
        }
    }
}

#[test]
fn a_mesh_is_scaled_then_rotated_then_moved() {
    let placed = |scale, rotate, translate, point: DVec3| {
        Placement { scale, rotate, translate }.to_world().transform_point3(point)
    };
    let (one, zero) = (DVec3::ONE, DVec3::ZERO);
    // Quarter turns are exact.
    assert_eq!(placed(one, DVec3::new(90.0, 0.0, 0.0), zero, DVec3::Y), DVec3::Z);
    assert_eq!(placed(one, DVec3::new(0.0, 90.0, 0.0), zero, DVec3::Z), DVec3::X);
    assert_eq!(placed(one, DVec3::new(0.0, 0.0, 90.0), zero, DVec3::X), DVec3::Y);
    assert_eq!(placed(one, DVec3::new(-90.0, 0.0, 720.0), zero, DVec3::Y), -DVec3::Z);
    // About x first, then about y: y goes to z and from there to x.
    assert_eq!(placed(one, DVec3::new(90.0, 90.0, 0.0), zero, DVec3::Y), DVec3::X);
    let all = placed(DVec3::new(2.0, 3.0, 4.0), DVec3::new(90.0, 0.0, 0.0), DVec3::splat(10.0), one);
    assert_eq!(all, DVec3::new(12.0, 6.0, 13.0));
    let turn = DMat3::from_rotation_z(0.5) * DMat3::from_rotation_y(-1.2) * DMat3::from_rotation_x(2.1);
    let degrees = DVec3::new(2.1, -1.2, 0.5).map(f64::to_degrees);
    let expected = turn * DVec3::new(1.0, -2.0, 3.0);
    assert!(placed(one, degrees, zero, DVec3::new(1.0, -2.0, 3.0)).distance(expected) < 1e-12);
}

/// A folder with a square in square.obj.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("meshes")).unwrap();
    fs::write(folder.path().join("meshes/square.obj"), "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n").unwrap();
    folder
}

#[test]
fn mesh_files_are_beside_the_scene_after_its_triangles() {
    let folder = folder();
    let file = folder.path().join("scene.toml");
    let text = "image = { width = 9, height = 7 }\n[camera]\nposition = [0, 0, -1]\n\
        [[mesh]]\nfile = \"meshes/square.obj\"\ncolour = [0, 1, 0]\nscale = 2\nrotate = [0, 0, 90]\ntranslate = [5, 0, 3]\n\
        [[mesh]]\nfile = \"./meshes/square.obj\"\nscale = [1, 1, -1]\n\
        [[triangle]]\nvertices = [[0, 0, 1], [1, 0, 1], [0, 1, 1]]\n";
    fs::write(&file, text).unwrap();
    let Opened { scene, notes, .. } = open(&file, &Camera::default()).unwrap();
    let corners = |points: [[f32; 3]; 3]| points.map(Vec3::from_array);
    let found: Vec<_> = scene.all_triangles().map(|triangle| triangle.vertices).collect();
    let expected = [
        corners([[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [0.0, 1.0, 2.0]]),
        corners([[5.0, 0.0, 4.0], [5.0, 2.0, 4.0], [3.0, 2.0, 4.0]]),
        corners([[5.0, 0.0, 4.0], [3.0, 2.0, 4.0], [3.0, 0.0, 4.0]]),
        corners([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 1.0]]),
        corners([[0.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.0, 1.0, 1.0]]),
    ];
    assert_eq!(found, expected);
    assert_eq!(scene.triangle(1).colour, Vec3::Y);
    assert_eq!(notes.len(), 2);
    assert!(notes[0].ends_with("1 face of more than three corners was cut into triangles"));
    // From any directory.
    assert_eq!(read(&file).unwrap(), scene);
}

#[test]
fn a_bad_mesh_is_told_where_the_scene_names_it() {
    let folder = folder();
    let file = folder.path().join("scene.toml");
    let bad = folder.path().join("meshes/bad.ply");
    fs::write(&bad, "ply\nformat ascii 1.0\nelement vertex 1000000000\nend_header\n").unwrap();
    let told = |mesh: &str| {
        fs::write(&file, format!("image = {{ width = 9, height = 7 }}\n[[mesh]]\n{mesh}\n")).unwrap();
        let lines = read(&file).unwrap_err().lines().join("\n");
        lines.replace(&*folder.path().to_string_lossy(), "F")
    };
    assert_eq!(
        told("file = \"meshes/bad.ply\""),
        "F/scene.toml:3:8: F/meshes/bad.ply: the header claims 1000000000 vertex elements, and the file has no room for so \
         many: found `\"meshes/bad.ply\"`, expected at most 1: 0 bytes follow the header"
    );
    assert_eq!(
        told("file = \"none.stl\""),
        "F/scene.toml:3:8: F/none.stl: there is no such file: found `\"none.stl\"`, expected a mesh file"
    );
    assert_eq!(
        told("file = \"scene.toml\""),
        "F/scene.toml:3:8: F/scene.toml: the name of a mesh file tells its format: found `\"scene.toml\"`, expected .obj, \
         .ply, .stl, .glb or .gltf at its end"
    );
    assert_eq!(
        told("scale = 1e38\ntranslate = [3e38, 0, 0]\nfile = \"meshes/square.obj\""),
        "F/scene.toml:2:1: mesh 1 leaves the range of f32 where it is put: found `[[mesh]]`, expected coordinates within \
         3.4e38"
    );
}

/// What is replaced in the valid file by what, and the error that this gives: place, what is wrong,
/// what was expected.
const BAD_FILES: &str = r#"
width = 640 -> width = 0
    4:9: the image's width is out of range: found `0`, expected a whole number from 1 to 65535
width = 640 -> width = -5
    4:9: the image's width is out of range: found `-5`, expected a whole number from 1 to 65535
width = 640 -> width = 640.0
    4:9: the image's width is a number: found `640.0`, expected a whole number from 1 to 65535
width = 640 ->
    2:1: the image has no width: found `[image]`, expected `width`: a whole number from 1 to 65535
width = 640 -> widht = 640
    2:1: the image has no width: found `[image]`, expected `width`: a whole number from 1 to 65535
"room.png" -> 7
    3:8: the image's file is a number: found `7`, expected the name of a picture
"room.png" -> ""
    3:8: the image's file is empty: found `""`, expected the name of a picture
height = 0x1e0 -> height = 9\nshadows = 1
    6:11: the image's shadows are a number: found `1`, expected true or false
focal = 2 -> focal = -2
    8:9: the camera's focal is negative: found `-2`, expected a number greater than 0
focal = 2 -> focal = 1e-60
    8:9: the camera's focal rounds to 0: found `1e-60`, expected a number greater than 0
focal = 2 -> focal = inf
    8:9: the camera's focal is infinite: found `inf`, expected a number greater than 0
film = 35.0 -> film = "35"
    9:8: the camera's film is a string: found `"35"`, expected a number greater than 0
film = 35.0 -> position = 3
    9:12: the camera's position is a number: found `3`, expected three numbers, as in [0, 0, 5]
film = 35.0 -> look_at = [0, 0, 0]
    9:11: the camera looks at where it stands, which is no direction: found `[0, 0, 0]`, expected a point other than the camera's position
film = 35.0 -> up = [0, 0, -2]
    9:6: the camera's up is parallel to its view, or zero: found `[0, 0, -2]`, expected a direction across the view, such as up = [0, 1, 0]
film = 35.0 -> up = [0, 0, 0]
    9:6: the camera's up is parallel to its view, or zero: found `[0, 0, 0]`, expected a direction across the view, such as up = [0, 1, 0]
film = 35.0 -> look_at = [0, 5, 0]
    7:1: the camera's up is parallel to its view, or zero: found `[camera]`, expected a direction across the view, such as up = [0, 0, 1]
[20, -20.0, 0] -> [20, -20.0]
    12:12: light 1's position has 2 of its three numbers: found `[20, -20.0]`, expected three numbers, as in [0, 0, 5]
[20, -20.0, 0] -> [20, -20.0, 0, 1]
    12:12: light 1's position has 4 of its three numbers: found `[20, -20.0, 0, 1]`, expected three numbers, as in [0, 0, 5]
[20, -20.0, 0] -> [20, true, 0]
    12:17: the y of light 1's position is true or false: found `true`, expected a number
[20, -20.0, 0] -> [20, 1e39, 0]
    12:17: the y of light 1's position is out of range: found `1e39`, expected a number
[20, -20.0, 0] -> [20, 0xffffffffffffffffffffffffffffffffffff, 0]
    12:17: the y of light 1's position is out of range: found `0xffffffffffffffffffffffffffffffffffff`, expected a number
[1, 0.25, 0] -> [1, 0.25, nan]
    13:20: the blue of light 1's colour is not a number: found `nan`, expected a number of at least 0
intensity = 0.5 -> intensity = -0.5
    14:13: light 1's intensity is negative: found `-0.5`, expected a number of at least 0
radius = 30 ->
    16:1: sphere 1 has no radius: found `[[sphere]]`, expected `radius`: a number greater than 0
radius = 30 -> radius = 2020-01-01
    18:10: sphere 1's radius is a date or a time: found `2020-01-01`, expected a number greater than 0
centre = [-1e1 -> center = [-1e1
    20:1: sphere 2 has no centre: found `[[sphere]]`, expected `centre`: three numbers, as in [0, 0, 5]
[0, 1, 1]] -> [0, 1, 1], [1, 1, 1]]
    26:12: triangle 1 has 4 of its three vertices: found `[[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1,...`, expected three points, as in [[0, 0, 5], [1, 0, 5], [0, 1, 5]]
[0, 1, 1]] -> [0, 1]]
    26:35: triangle 1's vertex 3 has 2 of its three numbers: found `[0, 1]`, expected three numbers, as in [0, 0, 5]
[[triangle]] -> [triangle]
    25:1: triangle is a table: found `[triangle]`, expected [[triangle]] above the keys of each one
[image] -> mesh = 7\n[image]
    2:8: mesh is a number: found `7`, expected [[mesh]] above the keys of each one
radius = 30 -> radius 30
    18:8: key with no value: found `30`, expected `=`
radius = 30 -> radius =
    18:8: string values must be quoted: found `=`, expected literal string
radius = 30 -> radius = 30\nradius = 31
    19:1: duplicate key: found `radius`, expected TOML
"#;

#[test]
fn a_bad_file_is_refused_in_these_words() {
    for case in BAD_FILES.trim().split('\n').collect::<Vec<_>>().chunks(2) {
        let [change, error] = case else { panic!("{case:?}") };
        let (good, bad) = change.split_once(" ->").unwrap();
        assert!(VALID.contains(good), "{good}");
        let lines = refused(VALID.replacen(good, &bad.trim_start().replace("\\n", "\n"), 1));
        let error = format!("test.toml:{}", error.trim());
        assert!(lines.contains(&error), "{change}: {error}\n{}", lines.join("\n"));
    }
    assert_eq!(
        refused(""),
        [
            "test.toml:1:1: the scene has no image: found the end of the file, expected [image], with its width and height"
        ]
    );
    let far = VALID.replace("film = 35.0", "position = [0, 0, 3e38]\nlook_at = [0, 0, 0]").replace("1_20", "-3e38");
    assert_eq!(
        refused(far),
        ["test.toml:18:10: sphere 1's centre leaves the range of f32, seen from the camera: found `[0, 0, -3e38]`, \
          expected coordinates within 3.4e38"]
    );
    let image = "image = { width = 65535, height = 32769 }";
    assert_eq!(
        refused(image),
        [
            "test.toml:1:35: an image of 65535 x 32769 has more than 2147483648 pixels: found `32769`, expected a height of at most 32768 for that width"
        ]
    );
    assert_eq!(
        refused(b"# \xff"),
        ["test.toml:1:3: byte 2 of the file, 0xff, is not UTF-8: found `\\xff`, expected UTF-8 text"]
    );
}

#[test]
fn an_unknown_key_is_an_error_with_a_suggestion() {
    let source = VALID.replace("colour = [0, 0.5", "color = [0, 0.5").replace("[camera]", "[camra]");
    let error = parse(source.as_bytes()).unwrap_err();
    let expected = "\
error: the scene has no key `camra`
 --> test.toml:7:2
  |
7 | [camra]
  |  ^^^^^ expected `image`, `camera`, `light`, `sphere`, `triangle` or `mesh`
  |
  = help: did you mean `camera`?

error: sphere 2 has no key `color`
  --> test.toml:23:1
   |
23 | color = [0, 0.5, 1]
   | ^^^^^ expected `centre`, `radius` or `colour`
   |
   = help: did you mean `colour`?";
    assert_eq!(error.render(false), expected);
    let far = parse(VALID.replace("film", "shutter_speed").as_bytes()).unwrap_err();
    assert!(far.to_string().contains("no key `shutter_speed`") && !far.to_string().contains("did you mean"), "{far}");
}

#[test]
fn deep_and_long_files_are_refused_in_time() {
    for source in [
        format!("a = {}", "[".repeat(100_000)),
        format!("[{}b]", "a.".repeat(100_000)),
        format!("a{} = 1", ".a".repeat(100_000)),
        "a={a=".repeat(100_000),
        format!("a = {}", "9".repeat(200_000)),
        format!("image = {{ width = {}, height = 1 }}", "9".repeat(200_000)),
        "[[sphere]]\n".repeat(50_000),
    ] {
        let lines = refused(&source);
        assert!((1..=21).contains(&lines.len()) && lines.iter().all(|line| line.len() < 500));
    }
}

/// All numbers of a scene as bits, which tell -0 from 0.
fn bits(scene: &Scene) -> String {
    format!("{:?}", scene.to_text())
}

#[test]
fn scene_survives_toml_bit_by_bit() {
    let mut scene = many(40, 40, 3);
    scene.camera = Camera::new(640, 480, 35.0, 43.3).unwrap();
    scene.spheres[0].centre = Vec3::new(-0.0, f32::from_bits(1), f32::MAX);
    scene.spheres[1].radius = 1.000_000_1;
    for name in ["a.png", "a \"b\"\\c\u{7f}\u{1}\n.png", "図.png"] {
        scene.name = name.to_owned();
        scene.shadows = !scene.shadows;
        let again = accepted(scene.to_toml());
        assert_eq!(again, scene);
        assert_eq!(bits(&again), bits(&scene));
    }
}

#[test]
fn the_scene_of_a_mesh_is_the_same_by_way_of_toml() {
    let folder = tempfile::tempdir().unwrap();
    for format in [MeshFormat::Obj, MeshFormat::Ply, MeshFormat::Stl] {
        let file = format!("ball.{}", format.name().to_lowercase());
        let path = folder.path().join(&file);
        icosphere(500, 0.3, 2).write(format, &mut fs::File::create(&path).unwrap()).unwrap();
        let camera = Camera::new(300, 200, 1.5, 1.0).unwrap();
        let alone = open(&path, &camera).unwrap();
        assert!(alone.notes.iter().any(|note| note.contains("a mesh alone")), "{:?}", alone.notes);
        let mesh = rayo::internals::scene::Mesh::read(&path).unwrap();
        let setting = Setting::of(&mesh, format, &camera).unwrap();
        let toml = folder.path().join("ball.toml");
        fs::write(&toml, setting.to_toml(&file, "ball.png")).unwrap();
        assert_eq!(read(&toml).unwrap(), alone.scene, "{format}");
    }
}
