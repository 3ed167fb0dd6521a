//! Meshes, molecules and point clouds without a scene file, seen and lit as the options say.

use std::fs;

use tempfile::TempDir;

use crate::program::{Run, rayo};

const WATER: &str = "3\nwater\nO 0 0 0\nH 0.96 0 0\nH -0.24 0.93 0\n2\nlater\nO 0 0 0\nH 0 0 0.96\n";

/// Runs the program with arguments that are separated by single spaces.
#[track_caller]
fn run(arguments: &str, directory: &TempDir) -> Run {
    rayo(arguments.split(' '), directory.path())
}

/// A directory with a mesh, the same mesh in a format with z up, a molecule of two frames, and a
/// scan.
fn models() -> TempDir {
    let directory = TempDir::new().unwrap();
    run("make torus --triangles 500 -o torus.ply --quiet", &directory).printed();
    run("make torus --triangles 500 -o torus.stl --quiet", &directory).printed();
    fs::write(directory.path().join("water.xyz"), WATER).unwrap();
    fs::write(directory.path().join("scan.xyz"), "0 0 0 255 0 0\n1 0 0 0 255 0\n0 1 0 0 0 255\n").unwrap();
    directory
}

fn bytes(directory: &TempDir, name: &str) -> Vec<u8> {
    fs::read(directory.path().join(name)).unwrap()
}

#[test]
fn a_model_that_was_converted_is_seen_as_it_was_alone() {
    let directory = models();
    for (model, options) in [
        ("torus.ply", "--from 1,-1,0.5 --up z --fov 50 --light 1,0,0 --light 0,0,1 --ambient 0.25 --colour 1,0.5,0"),
        ("torus.ply", "--up -x --ambient 0 --shadows --size 80x60"),
        ("torus.stl", "--from 0,0,1 --focal 2"),
        ("torus.ply", "--radius 0.05 --colour #ff8000"),
        ("water.xyz", "--from 0,-1,0 --fov 20 --radius 0.4"),
        ("water.xyz", "--frame 2 --up z"),
        ("scan.xyz", "--light 1,1,1"),
    ] {
        run(&format!("render {model} {options} -o alone.ppm --quiet"), &directory).printed();
        for scene in ["scene.toml", "scene.in"] {
            run(&format!("convert {model} {scene} {options} --quiet"), &directory).printed();
            let [fov, shadows] = ["--fov", "--shadows"].map(|option| options.contains(option) && scene == "scene.in");
            // The paper's format cannot express shadows or another film diagonal.
            if !fov && !shadows {
                run(&format!("render {scene} -o scene.ppm --quiet"), &directory).printed();
                assert!(bytes(&directory, "scene.ppm") == bytes(&directory, "alone.ppm"), "{model} {options} {scene}");
            }
        }
    }
}

#[test]
fn a_mesh_stands_on_the_axis_that_is_said() {
    let directory = models();
    // The torus of an STL file has z up; as a PLY file it looks the same with `--up z`.
    run("convert torus.stl other.ply --quiet", &directory).printed();
    for (model, options) in [("torus.stl", ""), ("other.ply", " --up z"), ("torus.ply", "")] {
        run(&format!("render {model}{options} -o {model}.ppm --size 80x60 --quiet"), &directory).printed();
    }
    assert!(bytes(&directory, "torus.stl.ppm") == bytes(&directory, "other.ply.ppm"));
    // For a scene, an axis means an axis of the world, and so do three numbers.
    run("convert torus.ply torus.toml --quiet", &directory).printed();
    let scene = |up: &str, name: &str| {
        run(&format!("render torus.toml --up {up} -o {name} --size 80x60 --quiet"), &directory).printed();
        bytes(&directory, name)
    };
    assert!(scene("z", "a.ppm") == scene("0,0,1", "b.ppm"));
    assert!(scene("y", "a.ppm") == scene("0,1,0", "b.ppm") && scene("y", "a.ppm") != scene("-y", "c.ppm"));
}

#[test]
fn options_that_do_not_suit_a_file_are_refused() {
    let directory = models();
    run("convert torus.ply torus.toml --quiet", &directory).printed();
    run("convert torus.ply torus.obj --quiet", &directory).printed();
    let model = "a mesh, a molecule or points alone";
    for (arguments, message) in [
        ("render torus.toml --from 1,0,0", format!("error: --from is for {model}, and torus.toml is something else")),
        ("plan torus.toml --light 1,0,0", format!("error: --light is for {model}")),
        ("render torus.toml --colour 1,1,1", format!("error: --colour is for {model}")),
        ("render torus.obj --radius 1", "error: --radius is for atoms and points: .xyz, .pdb, .cif and .ply".into()),
        ("render torus.ply --frame 1", "error: --frame is for files of several frames or models".into()),
        ("render water.xyz --frame 3", "error: there is no frame 3: the file has 2 frames".into()),
        ("convert torus.ply a.stl --fov 40", "error: --fov is for scenes: STL files have neither camera".into()),
        ("convert water.xyz a.pdb", "error: a.pdb: PDB files are read, and not written".into()),
        ("convert water.xyz a.obj", "error: a.obj: the scene has no triangles".into()),
        ("render torus.ply --from 0,0,0", "expected a direction: three numbers that are not all 0".into()),
        ("render torus.ply --from 1,0", "expected three numbers, as in 1,2.5,-3".into()),
        ("render torus.ply --up w", "expected three numbers, as in 1,2.5,-3, or an axis, as in z".into()),
        ("render torus.ply --fov 180", "expected an angle in degrees, greater than 0 and less than 180".into()),
        ("render torus.ply --ambient 1.5", "expected a number from 0 to 1".into()),
        ("render torus.ply --radius 0", "expected a number greater than 0".into()),
        ("render water.xyz --frame 0", "expected a whole number from 1".into()),
        ("render torus.ply --fov 40 --film 2", "cannot be used with".into()),
        ("render torus.ply --from 1,0,0 --position 1,0,0", "cannot be used with".into()),
    ] {
        run(arguments, &directory).refuses(&message);
    }
    if crate::CAN_STEP {
        run("step torus.toml --ambient 0.5", &directory).refuses(&format!("error: --ambient is for {model}"));
    }
}

#[test]
fn a_field_of_view_is_the_angle_of_a_column() {
    let directory = TempDir::new().unwrap();
    // A wall in front of the camera that extends slightly beyond 45 degrees up and down.
    let wall = |half: f64| {
        format!(
            "a.ppm 9 9 1 1 1 1 1 1 0 0 0 0 2 1 1 1 -{half} -{half} 1 {half} -{half} 1 {half} {half} 1 \
             1 1 1 -{half} -{half} 1 {half} {half} 1 -{half} {half} 1"
        )
    };
    for (half, fov, is_full) in [(1.001, 90, true), (0.8, 90, false), (0.8, 77, true), (0.2, 77, false)] {
        fs::write(directory.path().join("wall.in"), wall(half)).unwrap();
        for size in ["90x30", "30x90"] {
            run(&format!("render wall.in --fov {fov} --size {size} -o a.ppm --quiet"), &directory).printed();
            let picture = bytes(&directory, "a.ppm");
            let pixels = &picture[picture.len() - 90 * 30 * 3..];
            let (width, height) = if size == "90x30" { (90, 30) } else { (30, 90) };
            let column = |row: usize| pixels[3 * (row * width + width / 2)] > 0;
            assert_eq!((column(0) && column(height - 1)), is_full, "{half} {fov} {size}");
        }
    }
}

#[test]
fn notes_say_what_was_assumed_and_not_what_was_asked_for() {
    let directory = models();
    let notes = |arguments: &str| run(&format!("render {arguments} -o a.ppm --size 8x6"), &directory).stderr;
    let usual = notes("water.xyz");
    assert!(usual.contains("van der Waals radii") && usual.contains("the front, the right and above"), "{usual}");
    assert!(usual.contains("the file has several frames"), "{usual}");
    let asked = notes("water.xyz --radius 1 --from 0,0,1 --light 0,0,1 --frame 2 --ambient 0");
    assert!(!asked.contains("van der Waals") && !asked.contains("several frames"), "{asked}");
    assert!(asked.contains("sees all of it from 0 0 1; one white light is where it is asked for; "), "{asked}");
    assert!(notes("scan.xyz").contains("points have no size, and are drawn with radius"));
}
