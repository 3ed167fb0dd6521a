//! What is fuzzed: each function hands bytes to a parser, and panics where what comes back is
//! unsound.

use std::path::Path;

use rayo::{Cloud, CloudFormat, Mesh, MeshFormat, Scene, SceneError, View, parse, parse_toml};
use rayo::{ImageError, ImageFile};

/// What takes any bytes.
pub type Target = fn(&[u8]);

/// The targets by their names, which are those of the folders in fuzz/corpus.
pub const TARGETS: [(&str, Target); 16] = [
    ("scene_in", scene_in),
    ("scene_toml", scene_toml),
    ("mesh_obj", mesh_obj),
    ("mesh_ply", mesh_ply),
    ("mesh_stl", mesh_stl),
    ("mesh_gltf", mesh_gltf),
    ("cloud_xyz", cloud_xyz),
    ("cloud_pdb", cloud_pdb),
    ("cloud_cif", cloud_cif),
    ("image_exr", image),
    ("image_hdr", image),
    ("image_pfm", image),
    ("image_png", image),
    ("image_pnm", image),
    ("image_qoi", image),
    ("image_tiff", image),
];

/// The paper's scene format.
pub fn scene_in(source: &[u8]) {
    match parse(source, "fuzz.in") {
        Ok(scene) => {
            // What was read can be written, and is the same when it is read again.
            assert_eq!(parse(scene.to_text().as_bytes(), "again.in").unwrap(), scene);
            sound(&scene);
        }
        Err(error) => explained(&error, source),
    }
}

/// Scenes in TOML.
pub fn scene_toml(source: &[u8]) {
    let nowhere = Path::new("/nowhere/at/all");
    match parse_toml(source, "fuzz.toml", nowhere) {
        Ok(opened) => {
            // It is written as the camera sees it, whose place in the world is not.
            let seen = Scene { view: View::default(), ..opened.scene.clone() };
            let again = parse_toml(opened.scene.to_toml().as_bytes(), "again.toml", nowhere).unwrap();
            assert_eq!(again.scene, seen);
            sound(&opened.scene);
        }
        Err(error) => explained(&error, source),
    }
}

/// Wavefront OBJ.
pub fn mesh_obj(source: &[u8]) {
    mesh(source, MeshFormat::Obj);
}

/// PLY, text and binary.
pub fn mesh_ply(source: &[u8]) {
    mesh(source, MeshFormat::Ply);
}

/// STL, text and binary.
pub fn mesh_stl(source: &[u8]) {
    mesh(source, MeshFormat::Stl);
}

/// glTF, in JSON and binary.
pub fn mesh_gltf(source: &[u8]) {
    mesh(source, MeshFormat::Gltf);
}

/// XYZ, of atoms or points.
pub fn cloud_xyz(source: &[u8]) {
    cloud(source, CloudFormat::Xyz);
}

/// The format of the Protein Data Bank.
pub fn cloud_pdb(source: &[u8]) {
    cloud(source, CloudFormat::Pdb);
}

/// CIF, of proteins or crystals.
pub fn cloud_cif(source: &[u8]) {
    cloud(source, CloudFormat::Cif);
}

fn cloud(source: &[u8], format: CloudFormat) {
    for frame in [None, Some(2)] {
        match Cloud::from_bytes(source, format, frame, "fuzz") {
            Ok(cloud) => {
                let count = cloud.centres.len();
                let spheres = cloud.spheres(None);
                assert!(count > 0 && spheres.len() == count);
                assert!(spheres.iter().all(|sphere| sphere.centre.is_finite() && sphere.colour.is_finite()));
                assert!(spheres.iter().all(|sphere| sphere.radius > 0.0 && sphere.radius.is_finite()));
            }
            Err(error) => {
                let text = error.to_string();
                assert!(text.starts_with("fuzz") && text.len() < 4000 && !text.contains(['\n', '\x1b']), "{text:?}");
            }
        }
    }
}

fn mesh(source: &[u8], format: MeshFormat) {
    let read = Mesh::from_bytes(source.to_vec(), format, "fuzz");
    match read {
        Ok(mesh) => {
            assert!(!mesh.triangles.is_empty());
            assert!(mesh.vertices.iter().all(|vertex| vertex.is_finite()));
            assert!(mesh.triangles.iter().flatten().all(|&index| (index as usize) < mesh.vertices.len()));
        }
        Err(error) => {
            let text = error.to_string();
            assert!(text.starts_with("fuzz") && text.len() < 4000 && !text.contains(['\n', '\x1b']), "{text:?}");
        }
    }
}

/// As many pixels as the other picture of a comparison has: none of another size is decoded.
const OTHER_PICTURE: u64 = 1 << 16;

/// Image files, whose content tells the format.
pub fn image(source: &[u8]) {
    let read = ImageFile::of_bytes(Path::new("fuzz"), source.to_vec()).and_then(|file| {
        let (width, height) = file.size();
        assert!(width > 0 && height > 0);
        if u64::from(width) * u64::from(height) > OTHER_PICTURE {
            return Ok(());
        }
        let picture = file.read()?;
        assert_eq!((picture.width, picture.height), (width, height));
        assert_eq!(picture.pixels.len() as u64, u64::from(width) * u64::from(height));
        Ok(())
    });
    if let Err(error) = read {
        assert!(!matches!(error, ImageError::Read { .. }), "bytes in memory can be read: {error}");
        let text = error.to_string();
        assert!(text.starts_with("fuzz ") && text.len() < 1000 && !text.contains(['\n', '\x1b']), "{text:?}");
    }
}

/// Every number is one that engines take.
fn sound(scene: &Scene) {
    assert!(scene.lights.iter().all(|light| light.position.is_finite() && light.colour.min_element() >= 0.0));
    assert!(scene.spheres.iter().all(|sphere| sphere.centre.is_finite() && sphere.radius > 0.0));
    assert!(scene.all_triangles().all(|triangle| triangle.vertices.iter().all(|vertex| vertex.is_finite())));
}

/// An error has a place in the file, and words of bounded length that cannot steer a terminal.
fn explained(error: &SceneError, source: &[u8]) {
    assert!((1..=20).contains(&error.diagnostics().len()));
    assert!(error.render(false).len() < 20_000 && error.render(true).len() < 40_000);
    for diagnostic in error.diagnostics() {
        assert!(diagnostic.line >= 1 && diagnostic.column >= 1 && diagnostic.span.end <= source.len());
        assert!(!diagnostic.message.is_empty() && !diagnostic.expected.is_empty());
        assert!(!diagnostic.one_line("fuzz").contains(['\n', '\r', '\x1b']));
    }
}
