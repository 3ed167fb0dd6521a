//! Scenes and meshes as arguments: what is read, refused, assumed and converted.

use crate::place::{Place, SCENE};
use rayo::Pixels;
use serde_json::{Value, json};
use std::fs;

// Scenes

#[test]
fn a_bad_scene_is_refused_at_its_place_and_nothing_is_written() {
    let place = Place::new();
    place.write("bad.in", "out.png 16 12\n 1\n 1\n 1 1 1 blue 0 0 0\n 0 0\n");
    place.refuses(
        "render bad.in",
        2,
        "error: light 1's blue is not a number
 --> bad.in:4:8
  |
4 |  1 1 1 blue 0 0 0
  |        ^^^^ expected a number of at least 0",
    );
    place.refuses("render bad.in -o out.png --json", 2, place.run("render bad.in").stderr.trim_end());
    assert_eq!(place.files(), ["bad.in", "scene.in"]);
}

#[test]
fn what_is_no_scene_file_is_named() {
    let place = Place::new();
    place.refuses("render none.in", 2, "error: there is no scene file `none.in`");
    place.refuses("render scnee.in", 2, "error: there is no scene file `scnee.in`: did you mean `scene.in`?");
    place.refuses("render ./scene.toml", 2, "error: there is no scene file `./scene.toml`: did you mean `./scene.in`?");
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("nowhere", place.path("dangling.in")).unwrap();
        place.refuses("render dangling.in", 2, "error: there is no scene file `dangling.in`");
        std::fs::remove_file(place.path("dangling.in")).unwrap();
        let run = place.shell("rayo render scene.in --orbit 2 -o \"$(printf 'p\\377%%d.png')\"");
        let told = "error: --orbit finds no number in a name that is not UTF-8: p\u{fffd}%d.png\n";
        assert_eq!(String::from_utf8_lossy(&run.stderr), told);
    }
    assert!(place.run("render scene.ply").stderr.contains("a mesh file, such as `scene.in`"));
    place.refuses("render .", 2, "error: `.` is a directory, and a scene is a file");
    for (name, content) in [("a.gz", "{}"), ("a.blend", "BLENDER-v300"), ("a.usda", "#usda 1.0\n(\n"), ("b.txt", "")] {
        place.write(name, content);
        let message = format!(
            "error: `{name}`: unsupported format: rayo reads scenes as .in and .toml, meshes as .obj, .ply, .stl, .glb and \
             .gltf, to which most programs can export, and atoms or points as .xyz, .pdb and .cif"
        );
        place.refuses(&format!("render {name}"), 2, &message);
        place.refuses(&format!("convert {name} a.ply"), 2, &message);
        fs::remove_file(place.path(name)).unwrap();
    }
    // The paper's format goes by any name, and so do its errors.
    for name in ["scene", "scene.txt", "scene.in.old"] {
        place.write(name, SCENE);
        assert_eq!(place.run(&format!("render {name} -o a.png")).status, 0, "{name}");
        place.write(name, &SCENE.replace("0.5", "x"));
        assert!(place.run(&format!("render {name}")).stderr.contains("sphere 1's green is not a number"), "{name}");
        fs::remove_file(place.path(name)).unwrap();
    }
    fs::remove_file(place.path("a.png")).unwrap();
    place.write("empty.in", "");
    // By its content: a name alone says little.
    assert_eq!(place.run("render scene.in --quiet").status, 0);
    let message = "error: `picture.png` is a picture, and a scene is expected: `-o picture.png` is how the picture to be \
                   written is named";
    place.refuses("render picture.png", 2, message);
    place.refuses("plan picture.png", 2, message);
    for format in ["ppm", "pgm", "pfm", "exr", "hdr", "tiff", "qoi"] {
        assert_eq!(place.run(&format!("render scene.in --quiet -o a.{format}")).status, 0);
        assert!(place.run(&format!("render a.{format}")).stderr.contains("is a picture"), "{format}");
        fs::remove_file(place.path(&format!("a.{format}"))).unwrap();
    }
    fs::remove_file(place.path("picture.png")).unwrap();
    let empty = place.run("render empty.in");
    assert_eq!(empty.status, 2);
    assert!(empty.stderr.starts_with("error: the file is empty\n --> empty.in:1:1\n"), "{}", empty.stderr);
    assert_eq!(place.files(), ["empty.in", "scene.in"]);
}

// Where the picture goes

#[test]
fn directories_in_the_scenes_name_are_dropped_with_a_warning() {
    for name in ["../up.png", "/up.png", "a/b/up.png", "..\\up.png", "C:\\x\\up.png", "./up.png"] {
        let place = Place::new();
        place.write("scene.in", &SCENE.replace("picture.png", name));
        let run = place.run("render scene.in");
        let warning = format!("warning: of the scene's image name `{name}` only `up.png` is used, in this directory");
        assert_eq!((run.status, run.stdout.as_str(), run.stderr.lines().next()), (0, "", Some(warning.as_str())));
        assert_eq!(place.files(), ["scene.in", "up.png"], "{name}");
        // --quiet leaves warnings.
        assert_eq!(place.run("render scene.in --quiet --force").stderr.trim_end(), warning);
    }
}

#[test]
fn hidden_or_empty_name_in_a_scene_is_refused() {
    for name in ["..", ".", "a/", "/", "-", "ppm:-", "a/-", ".profile", "a/.bashrc.png", "--help.png"] {
        let place = Place::new();
        place.write("scene.in", &SCENE.replace("picture.png", name));
        let message =
            format!("error: the scene's image name `{name}` is not the name of a plain file: name one with -o");
        place.refuses("render scene.in", 2, &message);
        assert_eq!(place.run("render scene.in -o x.png").status, 0);
    }
}

#[test]
fn no_file_steers_the_terminal() {
    let place = Place::new();
    // The title of a window, and a line that nobody wrote.
    let (title, shown) = ("\u{1b}]0;x\u{7}.png", "\\u{1b}]0;x\\u{7}.png");
    place.write("scene.in", &SCENE.replace("picture.png", title));
    let message = |name: &str| {
        format!("error: the scene's image name `{name}` has control or format characters: name a file with -o")
    };
    place.refuses("render scene.in", 2, &message(shown));
    let toml = "[image]\nfile = \"\\u001b]0;x\\u0007.png\\n\"\nwidth = 1\nheight = 1\n";
    place.write("scene.toml", toml);
    assert!(place.run("render scene.toml").stderr.contains(&message(&format!("{shown}\\n"))));
    // A name that reads from right to left, characters that nobody sees, and a line for those who
    // read Unicode.
    for c in "\u{202e}\u{200b}\u{2066}\u{feff}\u{ad}\u{2028}\u{e0041}".chars() {
        let (name, shown) = (format!("a{c}gnp.png"), message(&format!("a\\u{{{:x}}}gnp.png", u32::from(c))));
        place.write("scene.in", &SCENE.replace("picture.png", &name));
        place.refuses("render scene.in", 2, &shown);
        place.write("scene.toml", &format!("[image]\nfile = \"{name}\"\nwidth = 1\nheight = 1\n"));
        assert!(place.run("render scene.toml").stderr.contains(&shown));
        let output = place.command().args(["render", &name]).output().unwrap();
        assert!(!String::from_utf8_lossy(&output.stderr).contains(c), "{output:?}");
    }
    // JSON escapes these characters too: its reader gets the exact name of the file.
    let name = "a\u{7f}\u{9b}\u{202e}\u{e0041}\u{e9}\n.in";
    place.write(name, SCENE);
    let output = String::from_utf8(place.command().args(["plan", name, "--json"]).output().unwrap().stdout).unwrap();
    assert!(output.contains("a\\u007f\\u009b\\u202e\\udb40\\udc41\u{e9}\\n.in"), "{output}");
    assert_eq!(serde_json::from_str::<Value>(&output).unwrap()["scene"], name);
    // A mesh gives its picture a name.
    place.write("a\u{1b}.obj", "v 0 0 1\nv 1 0 1\nv 0 1 1\nf 1 2 3\n");
    place.command().args(["convert", "a\u{1b}.obj", "of_mesh.in"]).output().unwrap();
    assert!(place.run("render of_mesh.in").stderr.starts_with("a_.png: "));
    place.write("scene.in", &SCENE.replace("picture.png", title));
    place.write("a.in", SCENE);
    place.write(title, "P3 1 1 255 1 2 3");
    place.write("a\nb.stl", "solid");
    place.write("a\nb\u{1b} and a name that is long.in", SCENE);
    let long = "x".repeat(100_000);
    fs::create_dir(place.path("long")).unwrap();
    place.write("long/results.json", &format!("{{\"schema\": \"{long}\"}}"));
    place.write("long/key.toml", &format!("{long} = 1\n"));
    place.write("long/a.obj", &format!("mtllib {long}\nusemtl x\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf 1 2 3\n"));
    for arguments in [
        &["render", "scene.in", "--preview"][..],
        &["render", "a.in", "-o", "\u{1b}]0;.ppm"],
        &["render", "a.in", "-o", "\u{1b}]0;"],
        &["render", "a.in", "-o", "\u{1b}/a.png"],
        &["render", title],
        &["diff", title, title, "-o", "\u{1b}.png"],
        &["diff", title, "scene.in"],
        &["convert", "a.in", "\u{1b}.toml"],
        &["convert", "a.in", "\u{1b}.stl"],
        &["convert", "a\nb.stl", "b.obj"],
        &["plan", "\u{1b}"],
        &["accuracy", "a\nb\u{1b} and a name that is long.in", "--quick"],
        &["report", "--from", "\u{1b}"],
        &["render", "a.in", "--engine", "\u{1b}"],
        &["\u{9b}2J"],
        &["render", "a.in", "--size", "\u{9b}2J"],
        &["a\nb"],
        &["render", "a.in", "--a\nb"],
        &["render", "a.in", "--threads", "a\nb"],
        &["render", "a.in", "--engine", "a\nb\u{1b}[31m"],
        &["render", "a.in", "--precision", "a\nb"],
        &["stability", "--family", "a\nb"],
        &["ops", "--op", "a\nb"],
        &["ops", "--kernel", "a\nb"],
        &["ops", "--engine", "a\nb"],
        &["step", "--op", "a\nb"],
        &["render", "a.in", "--engine", &long],
        &["render", "a.in", "--threads", &long],
        &["report", "--from", "long"],
        &["render", "long/key.toml"],
        &["convert", "long/a.obj", "a.toml"],
    ] {
        let output = place.command().args(arguments).output().unwrap();
        let said = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
        assert!(!said.contains("panicked"), "{said}");
        let control = |c: char| c.is_control() && c != '\n';
        assert_eq!(said.find(control), None, "{arguments:?}: {}", said.escape_debug());
        assert!(!said.contains("a\nb"), "{}", said.escape_debug());
        assert!(said.len() < 50_000, "{} bytes of {arguments:?}", said.len());
    }
}

#[cfg(unix)]
#[test]
fn what_has_no_end_is_not_read_to_the_end() {
    let place = Place::new();
    std::os::unix::fs::symlink("/dev/zero", place.path("results.json")).unwrap();
    let limits = "error: /dev/zero: it has more than 1 MiB, too many for limits";
    place.refuses("stability --limits /dev/zero", 2, limits);
    let results = "error: cannot read ./results.json: it has more than 64 MiB, too many for results";
    place.refuses("report --from .", 2, results);
}

#[test]
fn what_is_read_is_not_replaced() {
    let place = Place::new();
    place.write("scene.ppm", SCENE);
    place.write("a.ppm", "P3 1 1 255 1 2 3");
    place.write("square.obj", SQUARE);
    let materials = ["paint.toml", "paint.ply", "paint.png", "paint2.png"];
    materials.iter().for_each(|name| place.write(name, "newmtl red\nKd 1 0 0\n"));
    place.write("painted.obj", &format!("mtllib {}\nusemtl red\n{SQUARE}", materials.join(" ")));
    place.write("mesh.toml", "[image]\nwidth = 4\nheight = 3\n[[mesh]]\nfile = \"square.obj\"\n");
    #[cfg(unix)]
    std::os::unix::fs::symlink("scene.ppm", place.path("link.ppm")).unwrap();
    for (arguments, of) in [
        ("render scene.ppm -o scene.ppm", "scene.ppm"),
        #[cfg(unix)]
        ("render scene.ppm -o link.ppm", "link.ppm"),
        ("render scene.ppm -o ./scene.ppm", "./scene.ppm"),
        ("diff a.ppm a.ppm -o a.ppm", "a.ppm"),
        ("convert scene.in scene.in", "scene.in"),
        ("convert mesh.toml square.obj", "square.obj"),
        ("plan mesh.toml --measure --figure square.obj", "square.obj"),
        ("convert painted.obj paint.toml --quiet", "paint.toml"),
        ("convert painted.obj paint.ply --quiet", "paint.ply"),
        ("render painted.obj --quiet -o paint.png", "paint.png"),
        ("render painted.obj --quiet --orbit 3 -o paint%d.png", "paint2.png"),
        ("plan scene.in --measure --figure scene.in", "scene.in"),
        #[cfg(all(feature = "asm", target_arch = "x86_64"))]
        ("step scene.in --html scene.in", "scene.in"),
        #[cfg(all(feature = "asm", target_arch = "x86_64"))]
        ("step mesh.toml --html square.obj", "square.obj"),
    ] {
        place.refuses(arguments, 2, &format!("error: {of} is also read, and would be replaced: name another file"));
    }
    assert_eq!(fs::read_to_string(place.path("scene.ppm")).unwrap(), SCENE);
    // Nor is a scene whose turn has not come, or was before.
    place.write("one.in", &SCENE.replace("picture.png", "scene.ppm"));
    for scenes in ["one.in scene.ppm", "scene.ppm one.in"] {
        let run = place.run(&format!("render {scenes} --force --quiet"));
        let told = "error: one.in: scene.ppm is also read, and would be replaced: name another file\n";
        assert_eq!((run.status, run.stderr.as_str()), (2, told), "{scenes}");
        assert_eq!(fs::read_to_string(place.path("scene.ppm")).unwrap(), SCENE);
    }
    #[cfg(target_os = "linux")]
    for command in [
        "render - -o scene.ppm < scene.ppm",
        "convert - scene.in < scene.in",
        "plan - --measure --figure scene.in < scene.in",
    ] {
        let ran = place.shell(&format!("rayo {command}"));
        assert!(String::from_utf8_lossy(&ran.stderr).contains(" is also read, and would be replaced"), "{ran:?}");
    }
    assert_eq!(place.run("stability --family S7 --engine rust --quick --out .").status, 0);
    place.refuses(
        "stability --limits limits.csv --out .",
        2,
        "error: ./limits.csv is also read, and would be replaced: name another file",
    );
    place.write("table.csv", SCENE);
    place.refuses(
        "accuracy table.csv --out .",
        2,
        "error: ./table.csv is also read, and would be replaced: name another file",
    );
    // The first two of three pictures are not written either.
    assert!(!place.files().contains(&"paint0.png".into()));
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("round1.png", place.path("round0.png")).unwrap();
        let told = "error: round1.png is the file of a picture before it, by a link: remove that";
        place.refuses("render scene.in --quiet --orbit 3 -o round%d.png", 2, told);
        // Whether read or not: a later scene of the same call may be.
        for file in ["later.in", "rock.PLY", "paints.mtl"] {
            place.write(file, SCENE);
            std::fs::remove_file(place.path("round1.png")).unwrap_or_default();
            std::os::unix::fs::symlink(file, place.path("round1.png")).unwrap();
            for command in ["render scene.in -o round1.png", "render scene.in --quiet --orbit 2 -o round%d.png"] {
                let run = place.run(command);
                let told = format!("/{file}, which is not a picture and would be replaced: name another file\n");
                assert!(run.stderr.contains(".png is a link to /"), "{}", run.stderr);
                assert!(run.status == 2 && run.stderr.ends_with(&told), "{}", run.stderr);
            }
            assert!(place.shell(&format!("rayo render scene.in --quiet -o - > {file}")).status.success());
            let run = place.run("diff paint.png paint.png -o round1.png");
            assert!(
                run.status == 2 && run.stderr.contains(" which is not a picture and would be replaced: "),
                "{run:?}"
            );
            // What is no link is not called one.
            let run = place.run(&format!("diff paint.png paint.png -o {file}"));
            assert!(run.status == 2 && !run.stderr.contains("link"), "{run:?}");
        }
    }
}

// Other scenes, and meshes

/// The square from (0, 0) to (1, 1) as one quad.
const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";

#[test]
fn a_mesh_alone_is_rendered_whole_and_what_was_assumed_is_said() {
    let place = Place::new();
    place.write("square.obj", SQUARE);
    let run = place.run("render square.obj --size 60x40");
    let lines: Vec<_> = run.stderr.lines().collect();
    assert_eq!((run.status, lines.len()), (0, 3), "{}", run.stderr);
    assert!(
        lines[0].starts_with("note: square.obj: 1 face of more than three corners was cut into triangles"),
        "{}",
        lines[0]
    );
    assert!(lines[1].starts_with("note: a mesh alone: y is up; the camera sees all of it"), "{}", lines[1]);
    assert!(lines[2].starts_with("square.png: 60x40 by "), "{}", lines[2]);
    let Pixels::Rgb8(pixels) = place.picture("square.png").pixels else { panic!("levels") };
    let lit = pixels.iter().filter(|pixel| pixel[0] > 20).count();
    assert!((300..1800).contains(&lit), "{lit} of 2400 pixels");
    // It fills the picture as well in another shape of it, and --quiet is silent.
    let run = place.run("render square.obj --size 40x400 --focal 2 --quiet --force");
    assert_eq!((run.status, run.stderr.as_str()), (0, ""));
    assert!(place.run("render square.obj --json --force").stdout.contains("\"hits\""));
}

#[test]
fn a_bad_mesh_is_refused_at_its_element_and_nothing_is_written() {
    let place = Place::new();
    place.write("bad.obj", &SQUARE.replace("3 4", "3 5"));
    let message = "error: face 1's corner 4 refers to vertex 5, but the file has only 4 vertices\n--> bad.obj:5\n \
        = note: expected 1 to 4, the number of its vertices, or -1 and down for the last ones";
    place.refuses("render bad.obj", 2, message);
    place.refuses("convert bad.obj out.toml", 2, message);
    place.refuses("convert bad.obj out.ply", 2, message);
    assert_eq!(place.files(), ["bad.obj", "scene.in"]);
}

#[test]
fn scenes_are_converted_without_a_change_in_the_picture() {
    let place = Place::new();
    place.write("square.obj", SQUARE);
    fs::create_dir(place.path("sub")).unwrap();
    // From one form to the next; each is rendered from where it is.
    for (from, to) in [
        ("scene.in", "a.toml"),
        ("a.toml", "b.in"),
        ("square.obj", "sub/square.toml"),
        ("sub/square.toml", "square.in"),
        ("square.in", "flat.toml"),
    ] {
        let run = place.run(&format!("convert {from} {to} --quiet"));
        assert_eq!((run.status, run.stdout.as_str(), run.stderr.as_str()), (0, "", ""), "{to}");
        for (file, picture) in [(from, "from.png"), (to, "to.png")] {
            assert_eq!(place.run(&format!("render {file} --quiet -o {picture}")).status, 0, "{file}");
        }
        let diff = place.run("diff from.png to.png");
        assert_eq!(diff.status, 0, "{from} {to}: {}", diff.stdout);
    }
    assert!(fs::read_to_string(place.path("sub/square.toml")).unwrap().contains("file = \"../square.obj\""));
}

#[test]
fn what_the_new_format_cannot_hold_is_lost_with_a_warning() {
    let place = Place::new();
    let run = place.run("convert scene.in out.obj");
    let warning = "warning: out.obj: OBJ has no place for 1 sphere, 1 light, the camera";
    assert_eq!((run.status, run.stderr.trim_end()), (0, warning));
    assert!(fs::read_to_string(place.path("out.obj")).unwrap().ends_with("f 1 2 3\n"));
    // --quiet leaves warnings.
    assert_eq!(
        place.run("convert scene.in out.ply --quiet").stderr.trim_end(),
        warning.replace("out.obj: OBJ", "out.ply: PLY")
    );
    let warning = "warning: out.stl: STL has no place for 1 sphere, 1 light, the triangles' colours, the camera";
    assert_eq!(place.run("convert scene.in out.stl").stderr.trim_end(), warning);
    place.write("film.toml", "[image]\nwidth = 9\nheight = 9\n[camera]\nfilm = 35\n");
    let run = place.run("convert film.toml film.in");
    let warning = "warning: film.in: the format has no place for a film of 35: render it with --film 35";
    assert_eq!((run.status, run.stderr.trim_end()), (0, warning));
    place.write("shadows.toml", "[image]\nwidth = 9\nheight = 9\nshadows = true\n");
    let run = place.run("convert shadows.toml film.in");
    let warning = "warning: film.in: the format has no place for shadows: render it with --shadows";
    assert_eq!((run.status, run.stderr.trim_end()), (0, warning));
    // Whatever a file is called, an error begins like one.
    let message = "error.stl: the scene has no triangles, and STL holds nothing else: write it as .in or .toml";
    place.refuses("convert film.toml error.stl", 2, &format!("error: {message}"));
    let names = "error: scene.out: the name of a scene or a mesh must end in .in, .toml, .obj, .ply, .stl or .glb";
    place.refuses("convert scene.in scene.out", 2, names);
    place.refuses("make torus --triangles 9 -o scene.out", 2, names);
    let directory = "error: cannot write none/out.toml: there is no directory none; create it first";
    place.refuses("convert scene.in none/out.toml", 1, directory);
    assert_eq!(place.files(), ["film.in", "film.toml", "out.obj", "out.ply", "out.stl", "scene.in", "shadows.toml"]);
}

#[test]
fn triangles_of_no_area_are_told_wherever_a_scene_is_read() {
    let place = Place::new();
    place.write("flat.in", "picture.png 16 12 1  1  1 1 1 1 0 5 0  0 1\n1 1 1  0 0 5  1 0 5  3 0 5\n");
    let warning = "warning: flat.in:2: triangle 1 has no area, and no ray hits it: its corners are on one line\n";
    for command in ["render flat.in --quiet", "plan flat.in", "convert flat.in flat.toml"] {
        assert_eq!(place.run(command).stderr, warning, "{command}");
    }
}

#[test]
fn triangles_beyond_the_limit_of_toml_are_not_written() {
    let place = Place::new();
    let message = "error: hills.toml: 299538 triangles and 0 spheres are more than the 32 MiB of TOML that can be read \
                   again: write them as .in, or triangles as a mesh that a scene names";
    place.refuses("make terrain --triangles 300000 -o hills.toml", 2, message);
    assert_eq!(place.run("make terrain --triangles 300000 -o hills.ply --quiet").status, 0);
    assert_eq!(place.run("convert hills.ply hills.in --quiet").status, 0);
    place.refuses("convert hills.in hills.toml", 2, message);
    // As a mesh that the scene names it takes a few lines.
    assert_eq!(place.run("convert hills.ply hills.toml").status, 0);
    assert!(fs::metadata(place.path("hills.toml")).unwrap().len() < 1000);
}

#[test]
fn shapes_are_made_as_meshes_and_as_scenes_that_show_the_same() {
    let place = Place::new();
    for (shape, made) in [("icosphere --bumps 0.2", 980), ("torus", 1024), ("terrain --seed 4", 968)] {
        for file in ["shape.obj", "shape.ply", "shape.stl", "shape.toml", "shape.in"] {
            let run = place.run(&format!("make {shape} --triangles 1000 -o {file}"));
            let name = shape.split(' ').next().unwrap();
            let start = format!("{file}: {name} of {made} triangles and ");
            assert!(run.summary().starts_with(&start), "{}", run.summary());
            let render = format!("render {file} --quiet --force --engine reference --size 40x30 -o {file}.png");
            assert_eq!(place.run(&render).status, 0, "{file}");
            // STL stands on another axis, and is turned; so rounding may differ in it.
            let diff = place.run(&format!("diff shape.obj.png {file}.png --json")).document();
            let most = if file == "shape.stl" { 3 } else { 0 };
            assert!(diff["off_by_2"].as_u64().unwrap() <= most, "{shape}, {file}: {diff}");
        }
    }
    let json = place.run("make torus --triangles 1000 -o shape.obj --json").document();
    assert_eq!((&json["schema"], &json["triangles"], &json["shape"]), (&json!(1), &json!(1024), &json!("torus")));
    place.refuses("make torus --triangles 9 -o x.obj --bumps 0.1", 2, "error: --bumps is for the icosphere alone");
    let random = "error: --seed is for the terrain and for the icosphere's --bumps: this shape has nothing random";
    for shape in ["torus", "icosphere"] {
        place.refuses(&format!("make {shape} --triangles 9 -o x.obj --seed 7"), 2, random);
    }
    for arguments in ["make cube --triangles 9 -o x.obj", "make torus --triangles 0 -o x.obj", "make torus -o x.obj"] {
        assert_eq!(place.run(arguments).status, 2, "{arguments}");
    }
}
