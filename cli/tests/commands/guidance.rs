//! Errors for unsuitable files and arguments: they tell the user what to do.

use std::fs;
use std::process::{Command, Stdio};

use crate::program::{Run, rayo};
use tempfile::TempDir;

const SCENE: &str = "picture.png 16 12 1  1 1 1 1 1 5 5 0  1 1 1 0.5 0 0 0 5  0\n";
const TOML: &str = "[image]\nwidth = 16\nheight = 12\n[[light]]\nposition = [5, 5, 0]\n\
                    [[sphere]]\nradius = 0.5\ncentre = [0, 0, 5]\n";
const OBJ: &str = "# a triangle\nmtllib none.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

/// A new directory with these files.
fn directory(files: &[(&str, &str)]) -> TempDir {
    let directory = TempDir::new().unwrap();
    for (name, content) in files {
        let path = directory.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }
    directory
}

/// Runs the program with arguments that are separated by single spaces.
#[track_caller]
fn run(arguments: &str, directory: &TempDir) -> Run {
    rayo(arguments.split(' '), directory.path())
}

/// Runs a line of bash in which the program is called rayo.
fn bash(line: &str, directory: &TempDir) -> Run {
    let runner = std::env::var("RAYO_RUNNER").unwrap_or_default();
    let mut command = Command::new("bash");
    command.args(["-c", &format!("rayo() {{ {runner} '{}' \"$@\"; }}; {line}", env!("CARGO_BIN_EXE_rayo"))]);
    Run::of(command.current_dir(directory).stdin(Stdio::null()).output().unwrap())
}

#[cfg(unix)]
#[test]
fn a_scene_from_a_pipe_is_read_as_from_standard_input() {
    let files = directory(&[("a.in", SCENE), ("a.toml", TOML), ("mesh.toml", ""), ("a.obj", OBJ)]);
    fs::write(files.path().join("mesh.toml"), format!("{TOML}[[mesh]]\nfile = \"a.obj\"\n")).unwrap();
    for name in ["a.in", "a.toml", "mesh.toml"] {
        run(&format!("render {name} -o file.ppm --quiet"), &files).printed();
        let picture = |name: &str| fs::read(files.path().join(name)).unwrap();
        for source in [format!("<(cat {name})"), format!("- < {name}"), format!("/dev/stdin < {name}")] {
            let piped = bash(&format!("rayo render -o piped.ppm --quiet {source}"), &files);
            assert_eq!((piped.status, piped.stderr.as_str()), (0, ""), "{source}");
            assert!(picture("piped.ppm") == picture("file.ppm"), "{source}");
        }
    }
    // A file with any name is recognised by its content; an error in it is shown as one in TOML.
    fs::write(files.path().join("scene.txt"), TOML.replace("16", "-16")).unwrap();
    run("render scene.txt", &files).refuses("error: the image's width is out of range\n --> scene.txt:2:9");
}

#[cfg(unix)]
#[test]
fn a_mesh_without_a_telling_name_is_asked_for_one() {
    let ply = "ply\nformat ascii 1.0\nelement vertex 0\nend_header\n";
    let stl = "Solid a=1\n  facet normal 0 0 1\n outer loop\n";
    let binary = format!("{:80}\0\0\0\0", "solid of no facets");
    let files = directory(&[("a.obj", OBJ), ("a.ply", ply), ("a.stl", stl), ("binary.stl", &binary), ("a.in", OBJ)]);
    for (name, format) in [("a.obj", "OBJ"), ("a.ply", "PLY"), ("a.stl", "STL"), ("binary.stl", "STL")] {
        let message = |source: &str| {
            let extension = format.to_lowercase();
            format!(
                "error: {source} looks like a mesh in {format} format, and meshes need names that tell their formats: save \
                 it as a file whose name ends in .{extension}\n"
            )
        };
        let run = bash(&format!("rayo render - < {name}"), &files);
        assert_eq!((run.status, run.stderr), (2, message("standard input")));
        let run = bash(&format!("rayo plan <(cat {name})"), &files);
        assert!(run.status == 2 && run.stderr.contains("` looks like a mesh in "), "{}", run.stderr);
    }
    run("render a.in", &files).refuses("error: `a.in` looks like a mesh in OBJ format");
    // An error in a scene is still shown as that.
    fs::write(files.path().join("v.in"), "v 10 x 1 0 0 0").unwrap();
    run("render v.in", &files).refuses("the height is not a whole number");
}

#[test]
fn meshes_and_scenes_of_other_programs_are_unsupported_formats() {
    for (name, content) in [
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
        ("a.OFF", "COFF\n3 1 0\n"),
        ("a.node", "3 2 0 0\n1 0 0\n2 1 0\n3 0 1\n"),
        ("scene.in", "{\"asset\": {\"version\": \"2.0\"}}"),
        ("a.dae", "<?xml version=\"1.0\"?>\n<COLLADA/>"),
        ("a.3mf", "PK\u{3}\u{4}"),
    ] {
        let files = directory(&[(name, content)]);
        let message =
            format!("error: `{name}`: unsupported format: rayo reads scenes as .in and .toml, meshes as .obj");
        let step = crate::CAN_STEP.then_some("step");
        for command in ["render", "plan", "accuracy"].into_iter().chain(step) {
            run(&format!("{command} {name}"), &files).refuses(&message);
        }
    }
}

#[test]
fn a_windows_path_in_toml_is_read_or_explained() {
    let files = directory(&[("meshes/tin.obj", OBJ), ("a.toml", "")]);
    let scene = |file: &str| {
        fs::write(files.path().join("a.toml"), format!("{TOML}[[mesh]]\nfile = {file}\n")).unwrap();
        run("render a.toml -o a.png --quiet", &files)
    };
    for file in ["'meshes\\tin.obj'", "\"meshes\\\\tin.obj\"", "\"meshes/tin.obj\""] {
        scene(file).printed();
    }
    for file in
        ["\"meshes\\tin.obj\"", "\"meshes\\bunny.obj\"", "\"C:\\meshes\\x.obj\"", "\"C:\\Users\\x.obj\"", "\"\\x.obj\""]
    {
        scene(file).refuses("begins an escape, such as \\t for a tab: write the path with / or in 'single quotes'");
    }
    scene("'meshes\\none.obj'").refuses("meshes/none.obj: there is no such file");
    // Other errors get no such help.
    assert!(!scene("\"none.obj\"").stderr.contains("single quotes"));
}

#[test]
fn an_address_is_told_to_be_no_file() {
    let files = directory(&[("a.toml", &format!("{TOML}[[mesh]]\nfile = \"https://x.org/a.obj\"\n"))]);
    for arguments in [
        "render http://x.org/a.in",
        "render https://x.org/a.obj",
        "convert ftp://x.org/a.stl a.ply",
        "accuracy http://x.org/a.in",
        "diff http://x.org/a.png b.png",
        "render a.toml",
    ] {
        run(arguments, &files).refuses("this is an address, and rayo only reads files: download it first");
    }
    run("render c:/a.in", &files).refuses("there is no scene file `c:/a.in`");
}

#[test]
fn picture_name_without_its_option_is_told_first() {
    let files = directory(&[("a.in", SCENE)]);
    run("render a.in b.PNG", &files)
        .refuses("error: there is no scene file `b.PNG`: the picture's name follows -o, as in -o b.PNG");
    assert!(!files.path().join("picture.png").exists());
    run("render b.pgm", &files).refuses("there is no scene file `b.pgm`: the picture's name follows -o");
    // A scene may have any file name.
    fs::write(files.path().join("b.pgm"), SCENE).unwrap();
    run("render b.pgm --quiet", &files).printed();
}

#[test]
fn unknown_family_is_answered_with_the_families() {
    let files = directory(&[]);
    run("accuracy S99", &files)
        .refuses("error: there is neither a scene file nor a family `S99`; the families are S1, S2,");
    run("accuracy none.in", &files).refuses("error: there is no scene file `none.in`");
}

#[test]
fn several_scenes_need_a_directory_and_are_told_how() {
    let files = directory(&[("a.in", SCENE), ("b.in", SCENE)]);
    let message = "error: 2 scenes make 2 pictures, and both.png is the name of one: name a directory with -o, in which \
                   each gets the name in its scene, or leave -o out to have them in this one";
    run("render a.in b.in -o both.png", &files).refuses(message);
    run("render a.in b.in -o a.in", &files).refuses("and a.in is the name of one");
    run("render a.in b.in -o out", &files).refuses("there is no directory out for them: create it first");
}

#[test]
fn an_option_of_another_program_is_met_with_ours() {
    let files = directory(&[("a.in", SCENE)]);
    for (arguments, tip) in [
        ("render a.in --camera 1,2,3", "--position, --look-at and --up place the camera"),
        ("step a.in --lookat 1,2,3", "--position, --look-at and --up place the camera"),
        ("render a.in --zoom 2", "--fov gives the angle of view"),
        ("render a.in --width 800", "--size 800x600"),
        ("render a.in --spp 16", "--samples 4"),
        ("render a.in --gamma 2.2", "--srgb"),
        ("render a.in -j 4", "--threads 4"),
    ] {
        let refused = run(arguments, &files);
        refused.refuses(tip);
        assert!(refused.stderr.contains("  tip: ") && !refused.stderr.contains("as a value"), "{}", refused.stderr);
    }
    // An option that a command lacks is not recommended for it.
    assert!(!run("make torus --width 8 -o a.obj", &files).stderr.contains("--size"));
}

#[test]
fn where_an_argument_is_missing_there_are_examples() {
    let files = directory(&[]);
    for (command, example) in [
        ("step", "rayo step --op cross --a 1,2,3 --b 4,5,6"),
        ("render", "rayo render scenes/sphere.in -o sphere.png"),
        ("diff a.png", "rayo diff "),
        ("convert a.in", "rayo convert "),
        ("make", "rayo make "),
    ] {
        let refused = run(command, &files);
        refused.refuses("were not provided");
        refused.refuses("  tip: for example\n");
        refused.refuses(example);
    }
}

#[cfg(all(feature = "asm", target_arch = "x86_64"))]
#[test]
fn a_compiler_is_no_implementation_and_what_is_one_is_listed() {
    let files = directory(&[]);
    let list = "there are: printed-c, printed-simd, c-O0, c-O1, c-O2, c-O3, c-native, rust, glam, paper, aos, sse41, avx2, \
                avx512; and c for all of C, printed for both of the paper's columns";
    run("ops --engine clang", &files).refuses(list);
}

#[test]
fn what_is_no_picture_is_told_what_it_is() {
    let files = directory(&[
        ("lfs.png", "version https://git-lfs.github.com/spec/v1\noid sha256:0\n"),
        ("page.png", "<!DOCTYPE html><html></html>"),
        ("archive.png", "PK\u{3}\u{4}"),
        ("empty.png", ""),
        ("other.png", "GIF89a"),
    ]);
    for (name, message) in [
        ("lfs.png", "error: lfs.png: this is a pointer of Git LFS"),
        ("lfs.png", "an image is expected: fetch the file: git lfs pull"),
        ("page.png", "error: page.png: this is a web page (HTML)"),
        ("archive.png", "error: archive.png: this is an archive, and an image is expected: unpack it first"),
        ("empty.png", "error: empty.png is damaged or incomplete: it is empty"),
        ("other.png", "error: other.png is of an unsupported format: rayo reads PNG"),
    ] {
        run(&format!("diff {name} {name}"), &files).refuses(message);
    }
}

#[test]
fn unusable_picture_name_is_told_with_its_scene() {
    let named = |name: &str| SCENE.replace("picture.png", name);
    let files = directory(&[
        ("jpg.in", &named("a.jpg")),
        ("folder.in", &named("shots.png")),
        ("shots.png/x", ""),
        ("a.in", SCENE),
    ]);
    run("render jpg.in", &files)
        .refuses("or .qoi; this name stands in the scene: change it there, or name a file with -o");
    run("render folder.in", &files)
        .refuses("error: the scene names its picture `shots.png`, and shots.png is a directory: name a file with -o");
    let several = run("render jpg.in a.in -o shots.png", &files);
    assert_eq!(several.status, 2);
    assert!(
        several.stderr.contains("change it there, or render it in a call of its own with -o"),
        "{}",
        several.stderr
    );
    assert!(files.path().join("shots.png/picture.png").exists());
    // A name that is given is not the scene's.
    assert!(!run("render a.in -o a.jpg", &files).stderr.contains("stands in the scene"));
    for arguments in ["render a.in -o new/", "render a.in -o new.png/", "diff a.png a.png -o new/"] {
        run("render a.in -o a.png --quiet", &files).printed();
        let refused = run(arguments, &files);
        assert_eq!(refused.status, 1, "{}", refused.stderr);
        assert!(refused.stderr.ends_with("/ names a directory: name a file in it\n"), "{}", refused.stderr);
    }
}

#[cfg(unix)]
#[test]
fn standard_input_is_a_picture_too_and_is_read_once() {
    let files = directory(&[("a.in", SCENE)]);
    run("render a.in -o a.png --quiet", &files).printed();
    for line in ["rayo diff a.png - < a.png", "cat a.png | rayo diff - a.png"] {
        assert_eq!(bash(line, &files).printed(), "identical: 16x12 pixels\n", "{line}");
    }
    for line in ["rayo diff - - < a.png", "rayo render - /dev/stdin < a.in", "rayo plan - - < a.in"] {
        bash(line, &files).refuses("error: standard input is read once, and is named more than once: name a file");
    }
}
