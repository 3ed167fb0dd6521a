//! The destinations of pictures: names, links, standard output, and files that cannot be written.

use crate::place::{Place, SCENE, is_png, run_into};
use std::fs;
use std::path::Path;

#[cfg(unix)]
#[test]
fn a_picture_goes_where_its_name_leads() {
    let place = Place::new();
    // Two names of the same file.
    std::os::unix::fs::symlink("picture.png", place.path("link.png")).unwrap();
    place.write("link.in", &SCENE.replace("picture.png", "link.png"));
    let run = place.run("render scene.in link.in --force --quiet");
    let told =
        "error: link.in: its picture is link.png, as is that of a scene before it: render it in a call of its own\n";
    assert_eq!((run.status, run.stderr.as_str()), (2, told));
    // A file in a directory under its /proc or /dev name is written atomically, too.
    #[cfg(target_os = "linux")]
    {
        place.write("old.ppm", "old");
        let run =
            place.shell("trap '' XFSZ; ulimit -f 1; rayo render scene.in --size 100x100 -o /proc/self/cwd/old.ppm");
        assert_eq!(run.status.code(), Some(1), "{run:?}");
        assert_eq!(fs::read_to_string(place.path("old.ppm")).unwrap(), "old");
        // A folder whose name resembles the system's changes nothing.
        fs::create_dir(place.path("fd")).unwrap();
        place.write("fd/old.ppm", "old");
        let path = place.path("fd/old.ppm");
        let run = place
            .shell(&format!("trap '' XFSZ; ulimit -f 1; rayo render scene.in --size 100x100 -o {}", path.display()));
        assert_eq!(run.status.code(), Some(1), "{run:?}");
        assert_eq!(fs::read_to_string(path).unwrap(), "old");
        // The file of a running program cannot be written.
        let busy =
            place.shell(&format!("cp {} own; ./own render scene.in -o /proc/self/exe", env!("CARGO_BIN_EXE_rayo")));
        assert!(busy.status.code() == Some(1) && busy.stderr.ends_with(b"(os error 26)\n"), "{busy:?}");
        assert!(place.shell("exec 3>third.png; rayo render scene.in -o /proc/self/fd/3 --quiet").status.success());
        assert!(fs::read(place.path("third.png")).unwrap().starts_with(b"\x89PNG"));
    }
    let told = "error: the picture goes to standard error, where messages would print into it: name a file with -o";
    place.refuses("render scene.in --quiet -o /dev/stderr", 2, told);
    assert_eq!(place.run("render scene.in -o same.png --quiet").status, 0);
    let same = "rayo diff same.png same.png -o /dev/stderr";
    assert_eq!(place.shell(&format!("{same} 2>&-")).status.code(), Some(1));
    assert!(place.shell(same).stderr.starts_with(b"\x89PNG"));
    let told = "error: the plan is printed to standard output, where --figure would draw: name a file";
    place.refuses("plan scene.in --measure --figure -", 2, told);
    // Commands that measure for long report first that results cannot be written.
    #[cfg(target_os = "linux")]
    for command in [
        "stability --family S7 --engine rust --quick",
        "accuracy --quick",
        #[cfg(all(feature = "asm", feature = "c", target_arch = "x86_64"))]
        "experiment --quick",
    ] {
        let run = place.run(&format!("{command} --out /proc"));
        assert!(run.stderr.starts_with("error: cannot create a file in the directory /proc: "), "{}", run.stderr);
        assert!(run.status == 1 && run.stderr.ends_with("; name another one with --out\n"), "{}", run.stderr);
    }
    // Content that is written out of order goes to a temporary file before the stream.
    let run = place.shell("TMPDIR=/nowhere rayo render scene.in -o exr:-");
    let told = "error: cannot write /dev/stdout: there is no directory /nowhere; create it first\n";
    assert_eq!(String::from_utf8_lossy(&run.stderr), told);
    let run = place.shell("trap '' XFSZ; ulimit -f 0; rayo render scene.in -o exr:- | cat");
    assert!(String::from_utf8_lossy(&run.stderr).contains(" of temporary files"), "{run:?}");
}

#[cfg(unix)]
#[test]
fn a_replaced_file_keeps_its_mode_and_a_link_stays() {
    use std::os::unix::fs::{MetadataExt, PermissionsExt, symlink};
    let place = Place::new();
    fs::create_dir(place.path("in")).unwrap();
    for mode in [0o600, 0o640, 0o666, 0o755] {
        place.write("a.png", "old");
        fs::set_permissions(place.path("a.png"), fs::Permissions::from_mode(mode)).unwrap();
        fs::hard_link(place.path("a.png"), place.path("other.png")).unwrap();
        // A link to another link; both are relative to their own folders.
        symlink("../a.png", place.path("in/one.png")).unwrap();
        symlink("in/one.png", place.path("link.png")).unwrap();
        assert_eq!(place.run("render scene.in -o link.png").status, 0);
        assert_eq!(fs::metadata(place.path("a.png")).unwrap().mode() & 0o7777, mode);
        assert!(is_png(&place.path("a.png")));
        assert_eq!(fs::read_link(place.path("link.png")).unwrap(), Path::new("in/one.png"));
        assert!(place.path("in/one.png").is_symlink() && !place.path("a.png").is_symlink());
        assert_eq!(fs::read_to_string(place.path("other.png")).unwrap(), "old");
        ["link.png", "in/one.png", "other.png"].iter().for_each(|name| fs::remove_file(place.path(name)).unwrap());
    }
}

#[test]
fn the_name_in_the_scene_replaces_nothing_without_force() {
    let place = Place::new();
    place.write("picture.png", "precious");
    let message = "error: picture.png already exists: add --force to replace it, or name another file";
    place.refuses("render scene.in", 1, message);
    assert_eq!(fs::read_to_string(place.path("picture.png")).unwrap(), "precious");
    assert_eq!(place.run("render scene.in --force").status, 0);
    assert!(is_png(&place.path("picture.png")));
    assert_eq!(place.files(), ["picture.png", "scene.in"]);
}

#[test]
fn an_extension_that_is_unknown_is_refused() {
    let place = Place::new();
    let refused = place.run("render scene.in -o a.jpg");
    assert_eq!((refused.status, refused.stdout.as_str()), (2, ""));
    assert!(
        refused.stderr.starts_with("error: a.jpg: the name of an image must end in .png, .ppm, "),
        "{}",
        refused.stderr
    );
    place.write("scene.in", &SCENE.replace(".png", ".gif"));
    assert_eq!(place.run("render scene.in").status, 2);
    assert_eq!(place.files(), ["scene.in"]);
}

#[test]
fn where_nothing_can_be_written_the_status_is_1() {
    let place = Place::new();
    let message = "error: cannot write none/a.png: there is no directory none; create it first";
    place.refuses("render scene.in -o none/a.png", 1, message);
    #[cfg(target_os = "linux")]
    assert!(
        place
            .run("render scene.in -o /proc/a.png")
            .stderr
            .contains(": no file can be created in the directory /proc (")
    );
    fs::create_dir(place.path("directory.png")).unwrap();
    let run = place.run("render scene.in -o directory.png");
    assert_eq!(run.status, 1);
    assert!(run.stderr.starts_with("error: cannot write directory.png: "), "{}", run.stderr);
    assert!(run.stderr.trim_end().ends_with("; name a file in it"), "{}", run.stderr);
    assert_eq!(place.files(), ["directory.png", "scene.in"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_result_that_cannot_be_printed_is_told() {
    let place = Place::new();
    assert_eq!(place.run("render scene.in --quiet").status, 0);
    let others =
        ["render scene.in --force --stats", "render scene.in --force --json", "diff picture.png picture.png", "man"];
    for arguments in ["--help", "render --help", "--version", "info", "info --json"].into_iter().chain(others) {
        let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
        let message = "error: cannot write to standard output: No space left on device (os error 28)\n";
        assert_eq!(run_into(full, &place, arguments), (Some(1), message.into()), "{arguments}");
        // The reader closes the pipe before anything is written.
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        assert_eq!(run_into(writer, &place, arguments), (Some(0), String::new()), "{arguments}");
    }
}

#[cfg(unix)]
#[test]
fn a_standard_output_that_takes_nothing_is_told() {
    let place = Place::new();
    assert_eq!(place.run("render scene.in --quiet").status, 0);
    for arguments in
        ["render scene.in -o -", "info", "--help", "diff picture.png picture.png", "render scene.in --preview"]
    {
        for how in [">&-", "1</dev/null"] {
            let output = place.shell(&format!("rayo {arguments} {how}"));
            let told = String::from_utf8(output.stderr).unwrap();
            assert!(output.status.code() == Some(1) && told.contains(" closed"), "{arguments} {how}: {told}");
        }
    }
    assert!(place.shell("rayo render scene.in -o a.png --quiet >&-").status.success());
    assert!(is_png(&place.path("a.png")));
}

/// Runs the program with this standard input.
fn run_with(place: &Place, arguments: &str, input: &[u8]) -> (Option<i32>, Vec<u8>, String) {
    let output = place.command().args(arguments.split(' ')).write_stdin(input).output().unwrap();
    (output.status.code(), output.stdout, String::from_utf8(output.stderr).unwrap())
}

#[cfg(unix)]
#[test]
fn standard_output_takes_any_format_and_nothing_else() {
    let place = Place::new();
    for (name, file) in
        [("-", "a.png"), ("/dev/stdout", "a.png"), ("ppm:-", "a.ppm"), ("EXR:-", "a.exr"), ("pgm:-", "a.pgm")]
    {
        assert_eq!(place.run(&format!("render scene.in --quiet -o {file}")).status, 0);
        let (status, stdout, stderr) = run_with(&place, &format!("render scene.in -o {name}"), b"");
        assert_eq!(status, Some(0), "{stderr}");
        assert!(stdout == fs::read(place.path(file)).unwrap(), "{name}");
        assert!(stderr.starts_with("/dev/stdout: 16x12 by "), "{stderr}");
        fs::remove_file(place.path(file)).unwrap();
    }
    let message = "error: the picture goes to standard output, where --stats and --json would print into it: leave \
                   them out, or name a file with -o";
    for report in ["- --json", "/dev/stdout --json", "/dev/stdout --stats"] {
        place.refuses(&format!("render scene.in -o {report}"), 2, message);
    }
    assert_eq!(place.run("render scene.in -o gif:-").status, 2);
    // A file may be named like standard output.
    assert_eq!(place.run("render scene.in --quiet -o ./-").status, 0);
    let message = "error: the verdict goes to standard output: name a file for the picture of the differences";
    place.refuses("diff ./- ./- -o /dev/stdout", 2, message);
    assert_eq!(place.files(), ["-", "scene.in"]);
}

#[cfg(target_os = "linux")]
#[test]
fn no_picture_is_written_to_a_terminal() {
    let place = Place::new();
    let rayo = assert_cmd::cargo::cargo_bin!("rayo").display().to_string();
    // `script` runs the program in a terminal and prints its output.
    for (name, refused) in [("-", true), ("/dev/stdout", true), ("pgm:-", false)] {
        let mut command = std::process::Command::new("script");
        command.args(["-qec", &format!("'{rayo}' render scene.in --size 2x1 -o {name}"), "/dev/null"]);
        let output = command.current_dir(&place.directory).stdin(std::process::Stdio::null()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        let message = "the picture goes to standard output, and that is a terminal: name a file with -o";
        assert_eq!(output.status.code(), Some(if refused { 2 } else { 0 }), "{said}");
        assert_eq!(said.contains(message), refused, "{said}");
        assert_eq!(said.contains("P3"), !refused, "{said}");
    }
}

#[test]
fn a_dash_is_a_scene_from_standard_input_in_either_format() {
    let place = Place::new();
    assert_eq!(place.run("render scene.in --quiet -o file.png").status, 0);
    let toml = "# in TOML\n\n[image]\nwidth = 16\nheight = 12\n[camera]\nfocal = 1\n[[light]]\nposition = [5, 5, 0]\n\
                [[sphere]]\nradius = 0.5\ncentre = [0, 0, 5]\n[[triangle]]\ncolour = [1, 0, 0]\n\
                vertices = [[1, -9, -9], [9, 9, -9], [9, 0, 9]]\n";
    place.write("scene.toml", toml);
    assert_eq!(
        place.run("render scene.toml --quiet -o toml.png").status,
        0,
        "{}",
        place.run("render scene.toml").stderr
    );
    for (source, file) in [(SCENE, "file.png"), (toml, "toml.png")] {
        let (status, _, stderr) = run_with(&place, "render - --quiet -o piped.png", source.as_bytes());
        assert_eq!((status, stderr.as_str()), (Some(0), ""));
        assert!(fs::read(place.path("piped.png")).unwrap() == fs::read(place.path(file)).unwrap(), "{file}");
    }
    let (status, _, stderr) = run_with(&place, "render -", b"x.png 1 one");
    assert_eq!(status, Some(2));
    assert!(stderr.starts_with("error: the height is not a whole number\n --> standard input:1:9\n"), "{stderr}");
    let (status, _, stderr) = run_with(&place, "render -", b"[image]\nwidth = true");
    assert!(status == Some(2) && stderr.contains("--> standard input:2:9"), "{stderr}");
    assert!(run_with(&place, "plan -", SCENE.as_bytes()).0 == Some(0));
    assert_eq!(place.files(), ["file.png", "piped.png", "scene.in", "scene.toml", "toml.png"]);
}
