//! Pictures of mesh files, which have neither a camera nor lights.

use rayo::Pixels;
use rayo::internals::render::read;
use tempfile::TempDir;

use crate::program::{Run, rayo};

/// Runs the program with arguments that are separated by single spaces.
#[track_caller]
fn run(arguments: &str, directory: &TempDir) -> Run {
    rayo(arguments.split(' '), directory.path())
}

/// A new directory with a torus in a file of this name.
fn torus(name: &str) -> TempDir {
    let directory = TempDir::new().unwrap();
    run(&format!("make torus --triangles 2000 -o {name} --quiet"), &directory).printed();
    directory
}

/// The green channel of a picture in floats.
fn light(directory: &TempDir, name: &str) -> Vec<f32> {
    let Pixels::Rgb32F(pixels) = read(&directory.path().join(name)).unwrap().pixels else { panic!("floats") };
    pixels.iter().map(|pixel| pixel[1]).collect()
}

#[test]
fn a_mesh_alone_has_no_black_side_in_shadows() {
    for name in ["torus.obj", "torus.stl"] {
        let directory = torus(name);
        let picture = format!("render {name} --size 64x48 --orbit 8 --quiet -o");
        run(&format!("{picture} plain%d.pfm"), &directory).printed();
        run(&format!("{picture} shadows%d.pfm --shadows"), &directory).printed();
        for side in 0..8 {
            let plain = light(&directory, &format!("plain{side}.pfm"));
            let shadows = light(&directory, &format!("shadows{side}.pfm"));
            let lit = |light: &[f32]| light.iter().filter(|light| **light > 0.0).count();
            assert_eq!(lit(&plain), lit(&shadows), "{name} from side {side}");
            let dark = shadows.iter().filter(|light| (1e-9..0.02).contains(*light)).count();
            assert!(dark * 20 < lit(&shadows), "{name} from side {side}: {dark} pixels are nearly black");
            assert!(plain.iter().all(|light| *light <= 1.0), "{name} from side {side} is clipped");
            assert!(shadows.iter().any(|light| *light > 0.5), "{name} from side {side} is dark");
        }
    }
}

#[test]
fn a_mesh_that_was_converted_is_lit_as_it_was_alone() {
    let directory = torus("torus.ply");
    run("render torus.ply --shadows --quiet -o alone.ppm --size 64x48", &directory).printed();
    run("convert torus.ply torus.toml --quiet", &directory).printed();
    run("render torus.toml --shadows --quiet -o scene.ppm --size 64x48", &directory).printed();
    let bytes = |name: &str| std::fs::read(directory.path().join(name)).unwrap();
    assert!(bytes("alone.ppm") == bytes("scene.ppm"));
}

#[test]
fn what_is_assumed_of_meshes_alone_is_said_once_in_a_call() {
    let directory = torus("a.obj");
    run("make torus --triangles 100 -o b.ply --quiet", &directory).printed();
    run("make torus --triangles 100 -o c.stl --quiet", &directory).printed();
    let count = |arguments: &str| run(arguments, &directory).stderr.matches("a mesh alone").count();
    std::fs::create_dir(directory.path().join("out")).unwrap();
    assert_eq!(count("render a.obj b.ply -o out --size 8x6"), 1);
    // For STL another note says which axis is up.
    assert_eq!(count("render a.obj b.ply c.stl -o out --size 8x6"), 2);
    assert_eq!(count("render a.obj --orbit 4 -o out/%d.ppm --size 8x6"), 1);
    assert_eq!(count("plan a.obj b.ply --size 8x6"), 1);
    assert_eq!(count("render a.obj b.ply -o out --size 8x6 --quiet"), 0);
}
