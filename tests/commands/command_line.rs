//! The program as its user meets it: what it prints, what it writes, and its exit status, in words and numbers.

use std::fs;
use std::path::Path;

use crate::extent;
use crate::program::{self, Run, in_the_foreground};
use rayo::measure::picture::{Picture, Pixels};
use rayo::render::{Engine, read};
use serde_json::{Value, json};
use tempfile::TempDir;

/// A sphere and a triangle that each engine sees, in 16 x 12 pixels.
const SCENE: &str = "picture.png 16 12 1  1 1 1 1 1 5 5 0  1 1 1 0.5 0 0 0 5  1 0 0 1 -9 -9 9 9 -9 9 0 9 9\n";

/// A directory to work in, and what it takes to run the program there.
struct Place {
    directory: TempDir,
    variables: Vec<(&'static str, &'static str)>,
}

impl Place {
    /// With a scene in the file scene.in.
    fn new() -> Self {
        let place = Place { directory: tempfile::tempdir().unwrap(), variables: Vec::new() };
        place.write("scene.in", SCENE);
        place
    }

    fn path(&self, name: &str) -> std::path::PathBuf {
        self.directory.path().join(name)
    }

    fn write(&self, name: &str, content: &str) {
        fs::write(self.path(name), content).unwrap();
    }

    fn command(&self) -> assert_cmd::Command {
        let mut command = assert_cmd::Command::new(assert_cmd::cargo::cargo_bin!("rayo"));
        for variable in ["NO_COLOR", "CLICOLOR", "CLICOLOR_FORCE", "RAYO_ENGINE"] {
            command.env_remove(variable);
        }
        command.envs(self.variables.iter().copied()).env("COLUMNS", "120").current_dir(&self.directory);
        command
    }

    /// Runs the program with arguments that are separated by single spaces.
    fn run(&self, arguments: &str) -> Run {
        Run::of(self.command().args(arguments.split(' ').filter(|it| !it.is_empty())).output().unwrap())
    }

    /// Runs a line of the shell in which the program is called rayo.
    #[cfg(unix)]
    fn shell(&self, line: &str) -> std::process::Output {
        let mut command = std::process::Command::new("sh");
        command.args(["-c", &format!("rayo() {{ exec \"$0\" \"$@\"; }}; {line}")]);
        command.arg(assert_cmd::cargo::cargo_bin!("rayo")).current_dir(&self.directory).output().unwrap()
    }

    /// Runs it, and checks that it refuses with `status` and says `message` and nothing else.
    #[track_caller]
    fn refuses(&self, arguments: &str, status: i32, message: &str) {
        let run = self.run(arguments);
        let shown = format!("rayo {arguments}\n{}", run.stderr);
        assert_eq!((run.status, run.stdout.as_str()), (status, ""), "{shown}");
        assert_eq!(run.stderr.trim_end(), message, "rayo {arguments}");
    }

    /// The names in the directory, sorted.
    fn files(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.directory).unwrap();
        let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    fn picture(&self, name: &str) -> Picture {
        read(&self.path(name)).unwrap()
    }
}

fn is_png(path: &Path) -> bool {
    fs::read(path).unwrap().starts_with(b"\x89PNG\r\n\x1a\n")
}

fn size(picture: &Picture) -> (u32, u32) {
    (picture.width, picture.height)
}

/// The engines that run here, as errors list them.
fn engines(are_listed: fn(&&Engine) -> bool) -> String {
    let names = Engine::ALL.iter().filter(are_listed).map(|engine| engine.name());
    names.chain(["auto"]).collect::<Vec<_>>().join(", ")
}

// Help and usage

#[test]
fn help_lists_the_commands_and_each_has_its_own() {
    let place = Place::new();
    let help = place.run("--help");
    assert_eq!((help.status, help.stderr.as_str()), (0, ""));
    assert!(help.stdout.contains("Usage: rayo <COMMAND>"), "{}", help.stdout);
    assert!(help.stdout.contains("Exit status: 0 done, 1"), "{}", help.stdout);
    let commands =
        help.stdout.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let commands: Vec<_> = commands
        .filter_map(|line| line.strip_prefix("  ").filter(|rest| !rest.starts_with(' ')))
        .map(|line| line.split(' ').next().unwrap())
        .collect();
    for name in ["render", "convert", "make", "diff", "info"] {
        assert!(commands.contains(&name), "{commands:?}");
    }
    for name in commands.iter().filter(|name| **name != "help") {
        let own = place.run(&format!("{name} --help"));
        assert_eq!((own.status, own.stderr.as_str()), (0, ""), "{name}");
        assert!(own.stdout.contains(&format!("Usage: rayo {name}")), "{}", own.stdout);
        let short = place.run(&format!("{name} -h"));
        assert_eq!((short.status, short.stderr.as_str()), (0, ""), "{name}");
        assert_eq!(place.run(&format!("help {name}")).stdout, own.stdout);
    }
}

#[test]
fn shells_complete_and_manuals_have_every_command() {
    let place = Place::new();
    let bash = place.run("completions bash");
    assert_eq!((bash.status, bash.stderr.as_str()), (0, ""));
    for word in ["render", "--engine", "stability"] {
        assert!(bash.stdout.contains(word), "{word}");
    }
    assert_eq!(place.run("completions tcsh").status, 2);
    let page = place.run("man").stdout;
    assert!(page.starts_with(".ie") && page.contains("render"), "{page}");
    assert_eq!(place.run("man --out pages").status, 0);
    let named = page.lines().filter_map(|line| line.strip_suffix("(1)")).map(|name| name.replace('\\', ""));
    let named: Vec<_> = named.collect();
    assert!(named.len() > 10 && named.contains(&"rayo-step".into()), "{named:?}");
    for name in named {
        let page = fs::read_to_string(place.path("pages").join(format!("{name}.1"))).expect(&name);
        assert!(page.contains(".SH EXAMPLES\n  rayo "), "{page}");
    }
}

#[test]
fn without_arguments_the_help_is_shown_and_that_is_bad_usage() {
    let run = Place::new().run("");
    assert_eq!((run.status, run.stdout.as_str()), (2, ""));
    assert!(run.stderr.contains("Usage: rayo <COMMAND>") && run.stderr.contains("render"), "{}", run.stderr);
}

#[test]
fn what_is_mistyped_is_met_with_a_suggestion() {
    let place = Place::new();
    for (arguments, suggestion) in [
        ("rendr scene.in", "subcommands exist: 'report', 'render'"),
        ("render scene.in --engin c", "tip: a similar argument exists: '--engine'"),
        ("render scene.in --ouput x.png", "tip: a similar argument exists: '--output'"),
        ("render", "<SCENE>"),
        ("diff a.png", "<B>"),
    ] {
        let run = place.run(arguments);
        assert_eq!((run.status, run.stdout.as_str()), (2, ""), "{arguments}");
        assert!(run.stderr.starts_with("error: ") && run.stderr.contains(suggestion), "{arguments}: {}", run.stderr);
    }
    assert_eq!(place.files(), ["scene.in"]);
}

#[test]
fn a_value_that_cannot_be_is_refused_with_what_was_expected() {
    let place = Place::new();
    let refuses = |arguments: &str, message: &str| {
        place.refuses(&format!("render scene.in -o x.png {arguments}"), 2, message);
    };
    let size = "expected width and height in pixels, as in 1632x1224, or one of them, as in 800x or x600";
    let float = "invalid float literal";
    for (option, name, values, expected) in [
        ("--size", "<WxH>", "axb 5 x 5xx -1x5 4294967296x1", size),
        ("--film", "<DIAGONAL>", "one", float),
        ("--threads", "<N>", "0 -2 1025 two", "expected a whole number from 1 to 1024"),
        ("--orbit", "<N>", "0 100001 1.5", "expected a whole number from 1 to 100000"),
    ] {
        for value in values.split(' ') {
            refuses(&format!("{option} {value}"), &invalid(value, &format!("{option} {name}"), expected));
        }
    }
    let side = "each side of an image must be from 1 to 1000000 pixels";
    for (size, shown) in [("0x5", "0x5"), ("1000001x1", "1000001x1"), ("x1000001", "1333335x1000001")] {
        refuses(&format!("--size {size}"), &format!("error: {side}, not {shown}"));
    }
    refuses("--size 1000000x1000000", "error: an image of 1000000x1000000 has more than 2147483648 pixels");
    for (argument, shown) in [("--film -1", "-1"), ("--film 0", "0"), ("--film nan", "NaN"), ("--film=-inf", "-inf")] {
        refuses(argument, &format!("error: the film diagonal must be a finite number greater than 0, not {shown}"));
    }
    for value in ["inf", "-2.5"] {
        let message = format!("error: the focal distance must be a finite number greater than 0, not {value}");
        refuses(&format!("--focal {value}"), &message);
    }
    assert_eq!(place.files(), ["scene.in"]);
}

/// How clap refuses a value.
fn invalid(value: &str, option: &str, expected: &str) -> String {
    format!("error: invalid value '{value}' for '{option}': {expected}\n\nFor more information, try '--help'.")
}

// Engines

#[test]
fn an_unknown_engine_or_precision_is_refused_with_a_list() {
    let place = Place::new();
    // Those that only this CPU lacks are among them.
    let all = engines(|_| true);
    for (arguments, message) in [
        ("--engine nope", format!("error: there is no engine `nope`; this build has: {all}")),
        ("--engine Rust", format!("error: there is no engine `Rust`, did you mean `rust`?; this build has: {all}")),
        // Those that this machine or this build lacks too.
        ("--engine avx51", format!("error: there is no engine `avx51`, did you mean `avx512`?; this build has: {all}")),
        (
            "--engine AVX_512",
            format!("error: there is no engine `AVX_512`, did you mean `avx512`?; this build has: {all}"),
        ),
        (
            "--engine papper",
            format!("error: there is no engine `papper`, did you mean `paper`?; this build has: {all}"),
        ),
        ("--engine atuo", format!("error: there is no engine `atuo`, did you mean `auto`?; this build has: {all}")),
        ("--engine x", format!("error: there is no engine `x`; this build has: {all}")),
    ] {
        place.refuses(&format!("render scene.in {arguments}"), 2, &message);
    }
    for engine in Engine::ALL.iter().filter(|engine| ["reference", "rust", "c", "paper"].contains(&engine.name())) {
        let (lacks, has) = if *engine == Engine::Reference { ("single", "double") } else { ("double", "single") };
        let message = format!("error: the engine `{engine}` does not compute in {lacks}; it has: {has}");
        place.refuses(&format!("render scene.in --engine {engine} --precision {lacks}"), 2, &message);
    }
    let half = place.run("render scene.in --precision half");
    assert_eq!((half.status, half.stdout.as_str()), (2, ""));
    let list = "error: there is no precision `half`; there are: single, ";
    assert!(half.stderr.starts_with(list) && half.stderr.contains("double"), "{}", half.stderr);
    assert_eq!(place.files(), ["scene.in"]);
}

#[test]
fn the_environment_names_an_engine_and_an_option_overrides_it() {
    let mut place = Place::new();
    place.variables.push(("RAYO_ENGINE", "reference"));
    assert!(place.run("render scene.in").stderr.contains(" by reference, "));
    assert!(place.run("render scene.in --force --engine rust").stderr.contains(" by rust, "));
    assert!(place.run("plan scene.in").stdout.contains(" by reference in double, "));
    // Where a name comes from is told, since it is not in sight.
    place.variables = vec![("RAYO_ENGINE", "nope")];
    let message = format!("there is no engine `nope`; this build has: {}", engines(|_| true));
    for command in ["render", "plan"] {
        place.refuses(&format!("{command} scene.in"), 2, &format!("error: RAYO_ENGINE: {message}"));
    }
    assert_eq!(place.run("plan scene.in --engine rust").status, 0);
    #[cfg(unix)]
    {
        let run = place.shell("RAYO_ENGINE=$(printf 'a\\377') rayo plan scene.in");
        let told = format!("error: RAYO_ENGINE: {}\n", message.replace("nope", "a\u{fffd}"));
        assert_eq!((run.status.code(), String::from_utf8_lossy(&run.stderr).as_ref()), (Some(2), told.as_str()));
    }
    place.variables = vec![("RAYO_ENGINE", "")];
    assert_eq!(place.run("plan scene.in").status, 0);
    place.variables.clear();
    place.refuses("plan scene.in --engine=", 2, &format!("error: {}", message.replace("nope", "")));
    place.refuses("plan scene.in --engine nix", 2, &format!("error: {}", message.replace("nope", "nix")));
}

#[test]
fn an_engine_that_this_cpu_does_not_run_is_refused_alike_by_every_command() {
    let (place, list) = (Place::new(), engines(|engine| engine.usable()));
    for engine in Engine::ALL.iter().filter(|engine| !engine.usable()) {
        let message = format!("error: this CPU does not run the engine `{engine}`; it runs: {list}");
        for command in [
            "render scene.in --engine",
            "plan scene.in --engine",
            "step scene.in --engine",
            "step --op dot --a 1,2,3 --b 1,2,3 --engine",
            "stability --engine",
            "experiment --engines",
        ] {
            place.refuses(&format!("{command} {engine}"), 2, &message);
        }
    }
}

#[test]
fn what_only_another_build_has_is_refused_as_such() {
    let place = Place::new();
    let list = engines(|_| true);
    let message = |engine| format!("error: there is no engine `{engine}` in this build; this build has: {list}");
    let mut lacking = Vec::new();
    for (engine, built) in [("c", cfg!(rayo_c)), ("paper", cfg!(rayo_asm))] {
        assert_eq!(list.split(", ").any(|name| name == engine), built, "{engine}: {list}");
        if !built {
            place.refuses(&format!("render scene.in --engine {engine}"), 2, &message(engine));
            lacking.push(engine);
        }
    }
    // It needs both.
    if let Some(engine) = lacking.first() {
        place.refuses("experiment", 2, &message(engine));
    }
    if !cfg!(rayo_asm) {
        for (command, what) in [("ops", "count"), ("step scene.in", "watch"), ("report", "report on")] {
            let why = "it was built without the feature `asm`, or not for x86-64";
            place.refuses(command, 2, &format!("error: this build has no kernels in assembly to {what}: {why}"));
        }
    }
    let info = place.run("info").stdout;
    assert_eq!(info.contains("NASM         none (built without assembly)\n"), !cfg!(rayo_asm), "{info}");
    assert_eq!(info.contains("C compiler   none (built without C)\n"), !cfg!(rayo_c), "{info}");
}

#[test]
fn every_engine_renders_from_the_command_line() {
    let place = Place::new();
    let usable: Vec<_> = Engine::ALL.iter().filter(|engine| engine.usable()).collect();
    for engine in &usable {
        let run = place.run(&format!("render scene.in --engine {engine} -o {engine}.png"));
        let start = format!("{engine}.png: 16x12 by {engine}, traced in ");
        assert!(run.summary().starts_with(&start), "{}", run.summary());
        let diff = place.run(&format!("diff reference.png {engine}.png --tolerance 1"));
        assert_eq!(diff.status, 0, "{engine}: {}", diff.stdout);
    }
    let auto = place.run("render scene.in -o auto.png");
    assert!(auto.summary().contains(&format!(" by {}, ", Engine::fastest())), "{}", auto.summary());
    assert_eq!(place.files().len(), usable.len() + 2);
}

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
    for (name, content) in
        [("a.glb", "glTF\u{2}\0\0\0"), ("a.blend", "BLENDER-v300"), ("a.usda", "#usda 1.0\n(\n"), ("b.txt", "")]
    {
        place.write(name, content);
        let message = format!(
            "error: `{name}` is of no format that is read here: scenes are .in and .toml, meshes .obj, .ply and .stl, as \
             which most programs export theirs"
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
fn a_name_in_the_scene_that_is_no_file_or_a_hidden_one_is_refused() {
    for name in ["..", ".", "a/", "/", "-", "ppm:-", "a/-", ".profile", "a/.bashrc.png", "--help.png"] {
        let place = Place::new();
        place.write("scene.in", &SCENE.replace("picture.png", name));
        let message = format!("error: the scene's image name `{name}` names no plain file: name one with -o");
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
    // A name that reads from right to left, characters that nobody sees, and a line for those who read Unicode.
    for c in "\u{202e}\u{200b}\u{2066}\u{feff}\u{ad}\u{2028}\u{e0041}".chars() {
        let (name, shown) = (format!("a{c}gnp.png"), message(&format!("a\\u{{{:x}}}gnp.png", u32::from(c))));
        place.write("scene.in", &SCENE.replace("picture.png", &name));
        place.refuses("render scene.in", 2, &shown);
        place.write("scene.toml", &format!("[image]\nfile = \"{name}\"\nwidth = 1\nheight = 1\n"));
        assert!(place.run("render scene.toml").stderr.contains(&shown));
        let output = place.command().args(["render", &name]).output().unwrap();
        assert!(!String::from_utf8_lossy(&output.stderr).contains(c), "{output:?}");
    }
    // In JSON too, where the value is the name.
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
        #[cfg(rayo_asm)]
        ("step scene.in --html scene.in", "scene.in"),
        #[cfg(rayo_asm)]
        ("step mesh.toml --html square.obj", "square.obj"),
    ] {
        place.refuses(arguments, 2, &format!("error: {of} is what is read, and would be replaced: name another file"));
    }
    assert_eq!(fs::read_to_string(place.path("scene.ppm")).unwrap(), SCENE);
    // Nor is a scene whose turn has not come, or was before.
    place.write("one.in", &SCENE.replace("picture.png", "scene.ppm"));
    for scenes in ["one.in scene.ppm", "scene.ppm one.in"] {
        let run = place.run(&format!("render {scenes} --force --quiet"));
        let told = "error: one.in: scene.ppm is what is read, and would be replaced: name another file\n";
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
        assert!(String::from_utf8_lossy(&ran.stderr).contains(" is what is read, and would be replaced"), "{ran:?}");
    }
    assert_eq!(place.run("stability --family S7 --engine rust --quick --out .").status, 0);
    place.refuses(
        "stability --limits limits.csv --out .",
        2,
        "error: ./limits.csv is what is read, and would be replaced: name another file",
    );
    place.write("table.csv", SCENE);
    place.refuses(
        "accuracy table.csv --out .",
        2,
        "error: ./table.csv is what is read, and would be replaced: name another file",
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
                let told = format!("/{file}, which is no picture and would be replaced: name another file\n");
                assert!(run.stderr.contains(".png is a link to /"), "{}", run.stderr);
                assert!(run.status == 2 && run.stderr.ends_with(&told), "{}", run.stderr);
            }
            assert!(place.shell(&format!("rayo render scene.in --quiet -o - > {file}")).status.success());
            let run = place.run("diff paint.png paint.png -o round1.png");
            assert!(run.status == 2 && run.stderr.contains(" which is no picture and would be replaced: "), "{run:?}");
            // What is no link is not called one.
            let run = place.run(&format!("diff paint.png paint.png -o {file}"));
            assert!(run.status == 2 && !run.stderr.contains("link"), "{run:?}");
        }
    }
}

#[cfg(unix)]
#[test]
fn a_picture_goes_where_its_name_leads() {
    let place = Place::new();
    // Two names of one file.
    std::os::unix::fs::symlink("picture.png", place.path("link.png")).unwrap();
    place.write("link.in", &SCENE.replace("picture.png", "link.png"));
    let run = place.run("render scene.in link.in --force --quiet");
    let told =
        "error: link.in: its picture is link.png, as is that of a scene before it: render it in a call of its own\n";
    assert_eq!((run.status, run.stderr.as_str()), (2, told));
    // A file by way of the system's own names for its directory is whole or not at all, too.
    #[cfg(target_os = "linux")]
    {
        place.write("old.ppm", "old");
        let run =
            place.shell("trap '' XFSZ; ulimit -f 1; rayo render scene.in --size 100x100 -o /proc/self/cwd/old.ppm");
        assert_eq!(run.status.code(), Some(1), "{run:?}");
        assert_eq!(fs::read_to_string(place.path("old.ppm")).unwrap(), "old");
        // Nor does a folder that is called as the system's is make a file another one.
        fs::create_dir(place.path("fd")).unwrap();
        place.write("fd/old.ppm", "old");
        let path = place.path("fd/old.ppm");
        let run = place
            .shell(&format!("trap '' XFSZ; ulimit -f 1; rayo render scene.in --size 100x100 -o {}", path.display()));
        assert_eq!(run.status.code(), Some(1), "{run:?}");
        assert_eq!(fs::read_to_string(path).unwrap(), "old");
        // A program that runs is busy.
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
    // Whoever measures for long knows before that results can be written.
    #[cfg(target_os = "linux")]
    for command in [
        "stability --family S7 --engine rust --quick",
        "accuracy --quick",
        #[cfg(all(rayo_asm, rayo_c))]
        "experiment --quick",
    ] {
        let run = place.run(&format!("{command} --out /proc"));
        assert!(run.stderr.starts_with("error: cannot create a file in the directory /proc: "), "{}", run.stderr);
        assert!(run.status == 1 && run.stderr.ends_with("; name another one with --out\n"), "{}", run.stderr);
    }
    // What is written out of order to a stream is in a temporary file first.
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
        // One link to another, both relative to where they are.
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

/// Runs the program with standard output going to `stdout`: its status and what it says.
fn run_into(stdout: impl Into<std::process::Stdio>, place: &Place, arguments: &str) -> (Option<i32>, String) {
    let mut command = std::process::Command::new(assert_cmd::cargo::cargo_bin!("rayo"));
    command.args(arguments.split(' ')).current_dir(&place.directory).stdout(stdout);
    let output = command.stderr(std::process::Stdio::piped()).spawn().unwrap().wait_with_output().unwrap();
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
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
        // The reader has gone before the first word.
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

/// Runs the program with something on its standard input.
fn run_with(place: &Place, arguments: &str, input: &[u8]) -> (Option<i32>, Vec<u8>, String) {
    let output = place.command().args(arguments.split(' ')).write_stdin(input).output().unwrap();
    (output.status.code(), output.stdout, String::from_utf8(output.stderr).unwrap())
}

#[cfg(unix)]
#[test]
fn a_picture_goes_to_standard_output_in_any_format_and_nothing_else_beside_it() {
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
    // What is only called so is a file.
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
    // `script` gives the program a terminal, and prints what it says there.
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

// What is rendered

#[test]
fn size_film_and_focal_distance_take_the_place_of_the_scenes() {
    let place = Place::new();
    for arguments in
        ["-o plain.pfm", "-o scaled.pfm --film 32 --focal 32", "-o wide.pfm --focal 0.5", "-o small.pfm --size 7x3"]
    {
        assert_eq!(place.run(&format!("render scene.in --quiet {arguments}")).status, 0, "{arguments}");
    }
    let plain = place.picture("plain.pfm");
    assert_eq!(size(&plain), (16, 12));
    assert_eq!(place.picture("scaled.pfm"), plain);
    assert_ne!(place.picture("wide.pfm"), plain);
    assert_eq!(size(&place.picture("small.pfm")), (7, 3));
}

#[test]
fn shadows_are_an_option_and_a_key_and_the_papers_engines_refuse_them() {
    let place = Place::new();
    place.write("shadow.in", &SCENE.replace("5 5 0", "1 1 0"));
    for arguments in ["shadow.in -o plain.pfm", "shadow.in -o option.pfm --shadows"] {
        assert_eq!(place.run(&format!("render {arguments} --quiet --engine reference")).status, 0, "{arguments}");
    }
    assert_ne!(place.picture("option.pfm"), place.picture("plain.pfm"));
    assert_eq!(place.run("convert shadow.in shadow.toml").status, 0);
    let toml = fs::read_to_string(place.path("shadow.toml")).unwrap().replace("[image]\n", "[image]\nshadows = true\n");
    place.write("shadow.toml", &toml);
    assert_eq!(place.run("convert shadow.toml again.toml").status, 0);
    assert_eq!(place.run("render again.toml -o key.pfm --quiet --engine reference").status, 0);
    assert_eq!(place.picture("key.pfm"), place.picture("option.pfm"));
    assert_eq!(place.run("plan again.toml --engine rust").status, 0);
    let have = Engine::ALL.iter().filter(|engine| engine.has_shadows() && engine.usable());
    let have = have.map(|engine| engine.name()).collect::<Vec<_>>().join(", ");
    for engine in Engine::ALL.iter().filter(|engine| ["c", "paper"].contains(&engine.name())) {
        let message = format!(
            "error: the engine `{engine}` has no shadows, as in the paper: leave them out or ask one of {have}"
        );
        for arguments in
            ["render again.toml -o no.pfm", "render shadow.in -o no.pfm --shadows", "plan scene.in --shadows"]
        {
            place.refuses(&format!("{arguments} --engine {engine}"), 2, &message);
        }
    }
    assert!(!place.path("no.pfm").exists());
}

#[test]
fn one_side_of_the_size_keeps_the_shape() {
    let place = Place::new();
    for (given, expected) in [
        ("800x", "800x600"),
        ("x600", "800x600"),
        ("7x", "7x5"),
        ("x1", "1x1"),
        ("1x", "1x1"),
        // And both sides as they are, up to the longest.
        ("1000000x1", "1000000x1"),
        ("1x100000", "1x100000"),
    ] {
        let run = place.run(&format!("render scene.in --size {given} -o out.ppm"));
        assert!(run.summary().starts_with(&format!("out.ppm: {expected} by ")), "{given}: {}", run.summary());
    }
}

#[test]
fn a_picture_that_can_hardly_be_meant_is_warned_of() {
    let place = Place::new();
    let black = "warning: the scene has no light: whatever is seen is black\n";
    let behind = "warning: nothing is in front of the camera, which looks along +z from the origin\n";
    let filled = "warning: every ray hits, as through a long lens: is the focal distance of 50 meant for the film of an old \
                  scene? try `--film 35`\n";
    let light = "1 1 1 1 1 5 5 0";
    for (scene, arguments, warning) in [
        ("1  0  1 1 1 1 1 0 0 5  0".to_owned(), "", black.to_owned()),
        ("1  1 0 1 1 1 5 5 0  1 1 1 1 1 0 0 5  0".to_owned(), "", black.to_owned()),
        ("1  1 1 0 0 0 5 5 0  1 1 1 1 1 0 0 5  0".to_owned(), "", black.to_owned()),
        (format!("1  {light}  1 1 1 1 1 0 0 -5  0"), "", behind.to_owned()),
        (format!("1  {light}  1 6 1 1 1 0 0 -5  0"), "", String::new()),
        ("1  0  0  1 1 1 1 0 0 -1 1 0 -1 0 1 0".to_owned(), "", format!("{black}{behind}")),
        (format!("50  {light}  1 1 1 1 1 0 0 5  0"), "", filled.to_owned()),
        (format!("50  {light}  1 1 1 1 1 0 0 5  0"), "--film 35", String::new()),
        (format!("50  {light}  1 1 1 1 1 0 0 500  0"), "", String::new()),
        (format!("50  {light}  0  1 1 1 1 -9 -9 9 9 -9 9 0 9 9"), "", filled.to_owned()),
        (format!("5  {light}  1 1 1 1 1 0 0 5  0"), "", String::new()),
    ] {
        place.write("scene.in", &format!("x.png 16 12 {scene}\n"));
        let run = place.run(&format!("render scene.in --quiet --force {arguments}"));
        assert_eq!((run.status, run.stderr), (0, warning), "{scene} {arguments}");
    }
}

#[test]
fn a_camera_goes_round_a_scene_from_one_reading_of_it() {
    let place = Place::new();
    fs::create_dir(place.path("frames")).unwrap();
    let run = place.run("render scene.in --orbit 4 -o frames/%02d.ppm");
    assert_eq!((run.status, run.stdout.as_str()), (0, ""), "{}", run.stderr);
    let summary = format!("frames/00.ppm to frames/03.ppm: 4 of 16x12 by {}, traced in ", Engine::fastest());
    assert!(run.summary().starts_with(&summary), "{}", run.summary());
    place.run("render scene.in -o plain.ppm");
    let picture = |name: &str| fs::read(place.path(name)).unwrap();
    let all = [0, 1, 2, 3].map(|number| picture(&format!("frames/{number:02}.ppm")));
    assert!(all[0] == picture("plain.ppm") && (1..4).all(|i| all[i] != all[i - 1]));
    // The other steps of a finer turn are between those; samples and rows are of each picture.
    place.run("render scene.in --orbit 8 -o frames/%d.ppm --quiet");
    assert!((0..4).all(|i| all[i] == picture(&format!("frames/{}.ppm", 2 * i))));
    place.run("render scene.in --orbit 2 -o s%d.ppm --samples 2 --edges --rows 3..9 --background 1,0,0");
    place.run("render scene.in -o s.ppm --samples 2 --edges --rows 3..9 --background 1,0,0");
    assert!(picture("s0.ppm") == picture("s.ppm") && picture("s1.ppm") != picture("s.ppm"));

    let names_one = |name| {
        format!(
            "error: --orbit writes several pictures, and {name} is the name of one: give it a number, as in frames/%04d.png"
        )
    };
    for (arguments, message) in [
        ("scene.in --orbit 2 -o x.png", names_one("x.png")),
        ("scene.in --orbit 2 -o -", names_one("-")),
        ("scene.in --orbit 2 -o %x.png", names_one("%x.png")),
        ("scene.in --orbit 2 -o %4d.png", names_one("%4d.png")),
        ("scene.in --orbit 2 -o %d%d.png", names_one("%d%d.png")),
        ("scene.in --orbit 2 -o %099d.png", names_one("%099d.png")),
        (
            "scene.in scene.in --orbit 2 -o %d.png",
            "error: --orbit goes round one scene: render the others in calls of their own".into(),
        ),
        (
            "scene.in --orbit 2 -o none/%d.png",
            "error: cannot write none/0.png: there is no directory none; create it first".into(),
        ),
    ] {
        place.refuses(&format!("render {arguments}"), if arguments.contains("none") { 1 } else { 2 }, &message);
    }
    for with in ["--preview", "--stats", "--json", "--explain"] {
        let run = place.run(&format!("render scene.in --orbit 2 -o %d.png {with}"));
        assert!(run.status == 2 && run.stderr.contains("cannot be used with"), "{}", run.stderr);
    }
    let run = place.run("render scene.in --orbit 2");
    assert!(run.status == 2 && run.stderr.contains("--output <FILE>"), "{}", run.stderr);
}

#[test]
fn several_scenes_are_rendered_in_one_call() {
    let place = Place::new();
    place.write("other.in", &SCENE.replace("picture.png", "other.pfm"));
    place.write("same.in", SCENE);
    let expected = "several scenes have several pictures, and there is no directory out: create it first";
    place.refuses("render scene.in other.in -o out", 2, &format!("error: {expected}"));
    place.refuses(
        "render scene.in other.in -o -",
        2,
        "error: several pictures cannot go to standard output: name a directory with -o",
    );

    let run = place.run("render scene.in other.in --quiet --json");
    assert_eq!((run.status, run.stderr.as_str()), (0, ""));
    assert_eq!(serde_json::Deserializer::from_str(&run.stdout).into_iter::<Value>().count(), 2);
    fs::create_dir(place.path("out")).unwrap();
    assert_eq!(place.run("render scene.in other.in -o out").stderr.lines().count(), 2);
    for name in ["picture.png", "other.pfm"] {
        assert_eq!(fs::read(place.path(name)).unwrap(), fs::read(place.path("out").join(name)).unwrap());
    }

    // What cannot be rendered is told, and keeps no other scene from it.
    place.write("bad.in", "bad.png 8 0 1 0 0 0");
    fs::remove_file(place.path("out/other.pfm")).unwrap();
    let run = place.run("render bad.in scene.in same.in nothing.in other.in -o out --quiet");
    assert_eq!(run.status, 2);
    assert!(run.stderr.contains("bad.in:1:"), "{}", run.stderr);
    let same = "error: same.in: its picture is out/picture.png, as is that of a scene before it: render it in a call of \
                its own";
    assert!(run.stderr.contains(same) && run.stderr.contains("`nothing.in`"), "{}", run.stderr);
    assert!(place.path("out/other.pfm").exists());
}

#[test]
fn some_rows_are_those_of_the_whole_picture() {
    let place = Place::new();
    for name in ["a.png", "a.pfm", "a.hdr"] {
        place.run(&format!("render scene.in --quiet -o {name}"));
        place.run(&format!("render scene.in --rows 3..8 --quiet -o rows-{name}"));
        let (whole, part) = (place.picture(name), place.picture(&format!("rows-{name}")));
        assert_eq!(size(&part), (16, 5), "{name}");
        match (whole.pixels, part.pixels) {
            (Pixels::Rgb8(whole), Pixels::Rgb8(part)) => assert_eq!(whole[16 * 3..16 * 8], part, "{name}"),
            (Pixels::Rgb32F(whole), Pixels::Rgb32F(part)) => assert_eq!(whole[16 * 3..16 * 8], part, "{name}"),
            _ => panic!("{name}"),
        }
    }
    // An EXR is in its place, and black elsewhere.
    place.run("render scene.in --quiet -o a.exr");
    place.run("render scene.in --rows 3..8 --quiet -o rows.exr");
    let (Pixels::Rgb32F(mut whole), part) = (place.picture("a.exr").pixels, place.picture("rows.exr")) else {
        panic!()
    };
    assert_eq!(size(&part), (16, 12));
    (0..16 * 12).filter(|pixel| !(16 * 3..16 * 8).contains(pixel)).for_each(|pixel| whole[pixel] = [0.0; 3]);
    assert!(matches!(part.pixels, Pixels::Rgb32F(part) if part == whole));

    let stats = place.run("render scene.in --rows 3..8 --stats --json -o b.png").document();
    assert_eq!((&stats["height"], &stats["rays"]), (&json!(5), &json!(16 * 5)));
    place.refuses("render scene.in --rows 3..13 -o b.png", 2, "error: --rows 3..13: the picture has the rows 0..12");
    let run = place.run("render scene.in --rows 8..8 -o b.png");
    assert!(run.stderr.contains("expected the first row and the one after the last, as in 0..100"), "{}", run.stderr);
}

#[test]
fn a_long_picture_shows_no_progress_where_nobody_watches() {
    let place = Place::new();
    // Some two seconds' work for the slowest engine: a bar would have come after one.
    place.write("many.in", &rayo::scene::many(60, 60, 1).to_text());
    let run = place.run("render many.in --engine reference --threads 1");
    assert!(run.summary().starts_with("many.png: 640x480 by reference, traced in "), "{}", run.summary());
    assert!(!run.stderr.contains(['\r', '\u{1b}']), "{}", run.stderr.escape_debug());
}

// Figures

#[test]
fn stats_tell_where_the_time_went() {
    let place = Place::new();
    let run = place.run("render scene.in --stats --engine rust --threads 1");
    assert_eq!((run.status, run.stderr.as_str()), (0, ""));
    let names: Vec<_> = run.stdout.lines().map(|line| line.split_whitespace().next().unwrap()).collect();
    assert_eq!(names, ["engine", "rays", "parse", "set-up", "trace", "encode", "write"], "{}", run.stdout);
    assert!(run.stdout.starts_with("engine   rust, single, 1 thread\nrays     192 (16x12), "), "{}", run.stdout);
}

#[test]
fn stats_in_json_have_these_fields_and_count_the_rays_that_hit() {
    let place = Place::new();
    // Over everything, over nothing.
    for (triangle, hits) in [("-99 -99 9  99 -99 9  0 99 9", 192), ("-99 -99 -9  99 -99 -9  0 99 -9", 0)] {
        place.write("flat.in", &format!("x.png 16 12 1  1 1 1 1 1 0 5 0  0  1  1 1 1 {triangle}"));
        assert_eq!(place.run("render flat.in --json --force").document()["hits"], hits, "{triangle}");
    }
    for arguments in ["--stats --json", "--json", "--json --quiet"] {
        let run = place.run(&format!("render scene.in --engine rust --size 40x30 --force {arguments}"));
        assert_eq!((run.status, run.stderr.as_str()), (0, ""));
        let json = run.document();
        for (name, expected) in [
            ("schema", json!(1)),
            ("engine", json!("rust")),
            ("precision", json!("single")),
            ("width", json!(40)),
            ("height", json!(30)),
            ("rays", json!(1200)),
        ] {
            assert_eq!(json[name], expected, "{name}");
        }
        for name in ["hits", "parse_ns", "setup_ns", "trace_ns", "encode_ns", "write_ns"] {
            assert!(json[name].is_u64(), "{name}: {}", json[name]);
        }
        assert!((1..1200).contains(&json["hits"].as_u64().unwrap()), "{}", json["hits"]);
        let cycles = &json["trace_cycles"];
        assert!(if cfg!(target_arch = "x86_64") { cycles.is_u64() } else { cycles.is_null() }, "{cycles}");
    }
}

#[test]
fn info_tells_what_this_build_and_cpu_have() {
    let place = Place::new();
    let json = place.run("info --json").document();
    assert_eq!(json["schema"], 1);
    assert_eq!(json["version"], env!("CARGO_PKG_VERSION"));
    for name in ["cpu", "tsc_hz", "isa", "engines", "nasm", "cc", "rustc", "kernel", "hypervisor", "core_hz", "date"] {
        assert!(json.get(name).is_some(), "{name}");
    }
    // Of a repository, what was checked out; nothing of a package.
    let commit = json["commit"].as_str().unwrap_or_default();
    let digits = if Path::new(env!("CARGO_MANIFEST_DIR")).join(".git/description").is_file()
        || Path::new(env!("CARGO_MANIFEST_DIR")).join(".git").is_file()
    {
        12
    } else {
        commit.len()
    };
    assert!(commit.len() == digits && commit.chars().all(|digit| digit.is_ascii_hexdigit()), "{commit}");
    assert!(json["rustc"].as_str().unwrap().starts_with("rustc "));
    for (name, built) in [("nasm", cfg!(rayo_asm)), ("cc", cfg!(rayo_c))] {
        assert!(if built { json[name].is_string() } else { json[name].is_null() }, "{name}");
    }
    if cfg!(target_arch = "x86_64") {
        assert!(json["tsc_hz"].as_f64().unwrap() > 1e8);
    }
    for isa in json["isa"].as_array().unwrap() {
        assert!(isa["name"].is_string() && isa["usable"].is_boolean(), "{isa}");
        assert_eq!(isa["built"], cfg!(rayo_asm), "{isa}");
    }
    let names = Engine::ALL.iter().filter(|engine| engine.usable()).map(|engine| engine.name());
    assert_eq!(json["engines"], json!(names.collect::<Vec<_>>()));

    let text = place.run("info");
    assert_eq!((text.status, text.stderr.as_str()), (0, ""));
    assert!(text.stdout.starts_with(&format!("version      {}\n", env!("CARGO_PKG_VERSION"))), "{}", text.stdout);
    assert!(text.stdout.contains("\nengines      reference, rust"), "{}", text.stdout);
}

#[test]
fn nothing_is_coloured_but_at_a_terminal() {
    let mut place = Place::new();
    place.write("bad.in", "x.png 0 5");
    for variables in [vec![], vec![("NO_COLOR", "1")], vec![("NO_COLOR", "1"), ("CLICOLOR_FORCE", "1")]] {
        place.variables = variables;
        for arguments in ["", "--help", "rendr", "render --threads 0", "render bad.in", "render none.in", "info"] {
            let run = place.run(arguments);
            assert!(!run.stdout.contains('\u{1b}') && !run.stderr.contains('\u{1b}'), "{arguments}: {:?}", run.stderr);
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
        lines[0].starts_with("square.obj: 1 face of more than three corners was cut into triangles"),
        "{}",
        lines[0]
    );
    assert!(lines[1].starts_with("square.obj: a mesh alone: y is up, the camera sees all of it"), "{}", lines[1]);
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
    let message = "error: face 1's corner 4 is vertex 5, which the file has not\n--> bad.obj:5\n \
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
    let names = "error: scene.out: the name of a scene or a mesh must end in .in, .toml, .obj, .ply or .stl";
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
fn more_triangles_than_toml_is_read_again_with_are_not_written_to_it() {
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
    for arguments in ["make cube --triangles 9 -o x.obj", "make torus --triangles 0 -o x.obj", "make torus -o x.obj"] {
        assert_eq!(place.run(arguments).status, 2, "{arguments}");
    }
}

// Large pictures, and ends before the end

#[cfg(target_os = "linux")]
#[test]
fn a_stack_of_64_kb_is_enough() {
    let place = Place::new();
    place.write("scene.in", SCENE);
    for command in ["--version", "render scene.in -o a.exr --quiet", "convert scene.in a.toml", "man"] {
        let output = place.shell(&format!("ulimit -s 64; rayo {command}"));
        assert!(output.status.success() && output.stderr.is_empty(), "{command}: {output:?}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn what_there_is_no_memory_for_is_told_and_neither_plans_nor_pictures_need_another_thread() {
    let place = Place::new();
    let output = place.shell("ulimit -v 500000; rayo make torus --triangles 100000000 -o a.ply");
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1) && told.starts_with("error: there is no memory for "), "{output:?}");
    // A stack that no thread can have.
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/many.in");
    let output = place.shell(&format!("export RUST_MIN_STACK=100000000000000; rayo plan {scene}"));
    assert!(output.status.success(), "{output:?}");
    assert_eq!(place.files(), ["scene.in"]);
    let output = place.shell("export RUST_MIN_STACK=100000000000000; ulimit -s 64; rayo render scene.in -o a.png");
    let told = "error: the stack has less than 1 MiB, and no thread with a larger one can be started (";
    assert!(output.stderr.starts_with(told.as_bytes()) && output.status.code() == Some(1), "{output:?}");
    // Nor do pictures whose encoders have one of their own if there is one.
    for format in ["exr", "tiff"] {
        let render = format!("rayo render scene.in --force --threads 1 -o a.{format}");
        let pictures = ["100000000000000", "2000000"].map(|stack| {
            let output = place.shell(&format!("export RUST_MIN_STACK={stack}; {render}"));
            assert!(output.status.success(), "{format}: {output:?}");
            std::fs::read(place.path(&format!("a.{format}"))).unwrap()
        });
        assert!(pictures[0] == pictures[1], "{format}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_picture_is_by_as_many_threads_as_the_system_gives_unless_their_number_is_asked_for() {
    let place = Place::new();
    let cores = std::thread::available_parallelism().unwrap().get();
    // Each other thread has a stack of a gigabyte, and one listens for signals.
    for (others, threads) in [(0, 1), (1, 1), (2, 2), (4, 4)] {
        let run = |arguments: &str| {
            let limits = format!("export RUST_MIN_STACK=1000000000; ulimit -v {}", 1_000_000 * others + 500_000);
            place.shell(&format!("export MALLOC_ARENA_MAX=1; {limits}; rayo render scene.in -o a.png {arguments}"))
        };
        let output = run("--json");
        assert!(output.status.success(), "{others}: {output:?}");
        let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(document["threads"], threads.min(cores), "{others}");
        let told = String::from_utf8_lossy(&run("--threads 5").stderr).into_owned();
        assert!(
            told.ends_with(&format!("cannot start 5 threads: the system gives {threads}, ask for no more\n")),
            "{told}"
        );
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_picture_larger_than_memory_is_rendered_in_every_format_that_is_written_row_by_row() {
    let place = Place::new();
    let limited = |name: &str, size: &str| {
        let render = format!("rayo render scene.in --threads 1 --quiet --size {size} -o {name}");
        place.shell(&format!("export MALLOC_ARENA_MAX=1; ulimit -v 163840; {render}"))
    };
    // As floats these are 205 MB, and the address space is held to 160 MiB.
    for name in ["a.png", "a.ppm", "a.pgm", "a.pfm", "a.hdr", "a.tiff", "a.exr"] {
        let output = limited(name, "4000x3200");
        assert!(output.status.success(), "{name}: {output:?}");
        fs::remove_file(place.path(name)).unwrap();
    }
    // What is held whole, here 192 MB, shows that the limit is one; and more than a limit of its own is not begun.
    let output = limited("a.qoi", "8000x8000");
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let whole = place.run("render scene.in --size 20000x20000 -o a.qoi");
    assert!(whole.status == 2 && whole.stderr.contains("takes 1144 MiB of memory in this format"), "{}", whole.stderr);
    assert_eq!(place.files(), ["scene.in"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_disk_that_fills_up_is_told_and_leaves_nothing() {
    let place = Place::new();
    place.write("scene.in", &rayo::scene::many(300, 300, 1).to_text());
    let names = ["a.png", "a.ppm", "a.pgm", "a.pfm", "a.hdr", "a.tiff", "a.exr", "a.qoi"];
    let renders = names.map(|name| (name, format!("render scene.in --size 800x600 -o {name}")));
    let others =
        [("a.obj", "make torus --triangles 100000 -o a.obj".into()), ("a.toml", "convert scene.in a.toml".into())];
    for (name, command) in renders.into_iter().chain(others) {
        // No file may be longer than 64 blocks of 512 bytes.
        let output = place.shell(&format!("ulimit -f 64; rayo {command} --quiet"));
        let told = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{name}: {told}");
        let expected = format!("error: cannot write {name}: File too large");
        assert!(told.starts_with(&expected) && told.lines().count() == 1, "{name}: {told}");
        assert_eq!(place.files(), ["scene.in"], "{name}");
    }
}

#[cfg(all(target_os = "linux", rayo_asm))]
#[test]
fn an_experiment_whose_runs_cannot_start_names_the_limits_that_may_be_why() {
    let place = Place::new();
    let run = |files| place.shell(&format!("ulimit -n {files}; rayo experiment --quick --runs 1 --out a"));
    // With fewer files it can neither listen for signals nor try the directory.
    let mut told = (4..64).map(|files| String::from_utf8(run(files).stderr).unwrap());
    let is_before = |told: &str| ["listen for signals", "create a file"].iter().any(|what| told.contains(what));
    let told = told.find(|told| !is_before(told)).unwrap();
    let start = "error: run 0 in its own process: cannot start: Too many open files (os error 24); ";
    assert_eq!(told, [start, "raise ulimit -u or -n\n"].concat());
}

#[cfg(target_os = "linux")]
#[test]
fn a_reader_that_has_gone_ends_the_render_with_status_1() {
    let place = Place::new();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let message = "error: cannot write /dev/stdout: Broken pipe (os error 32); whatever was reading it has stopped\n";
    assert_eq!(run_into(writer, &place, "render scene.in -o /dev/stdout --size 2000x2000"), (Some(1), message.into()));
}

#[cfg(target_os = "linux")]
#[test]
fn a_render_that_is_ended_leaves_no_part_of_its_picture() {
    let place = Place::new();
    place.write("many.in", &rayo::scene::many(300, 300, 1).to_text());
    // Where files need no name, not even what nobody can listen to leaves one.
    let signals = [("INT", 130), ("TERM", 143), ("HUP", 129), ("QUIT", 131), ("XCPU", 152)];
    for (signal, status) in signals.map(|(signal, status)| (signal, Some(status))).into_iter().chain([("KILL", None)]) {
        for name in ["a.png", "a.exr"] {
            // Minutes of work.
            let mut command = in_the_foreground();
            command.args(["render", "many.in", "--engine", "reference", "--size", "4000x4000", "--quiet", "-o", name]);
            let mut child = command.current_dir(&place.directory).spawn().unwrap();
            let descriptors = format!("/proc/{}/fd", child.id());
            let begun = || {
                let open = fs::read_dir(&descriptors).into_iter().flatten().flatten();
                let mut names = open.filter_map(|entry| fs::read_link(entry.path()).ok());
                names.any(|name| {
                    name.to_string_lossy().ends_with(" (deleted)") || name.to_string_lossy().contains("/.rayo-")
                })
            };
            while !begun() {
                assert!(child.try_wait().unwrap().is_none(), "it has ended by itself");
                std::thread::sleep(std::time::Duration::from_millis(5));
            }
            // The signal may come at any time after that.
            std::thread::sleep(std::time::Duration::from_millis(60));
            assert!(program::signal(signal, child.id()));
            assert_eq!(child.wait().unwrap().code(), status, "{signal}");
            assert_eq!(place.files(), ["many.in", "scene.in"], "{signal}");
        }
    }
}

/// Without /proc a file that is being written has a name, a hidden one, as on file systems that know no others.
#[cfg(target_os = "linux")]
#[test]
fn a_command_that_is_ended_removes_the_hidden_file_that_it_is_writing() {
    let without_proc = |program: &std::ffi::OsStr| {
        let mut command = std::process::Command::new("unshare");
        command.args(["--map-root-user", "--mount", "sh", "-c", "mount -t tmpfs none /proc && exec \"$@\"", "sh"]);
        command.arg(program);
        command
    };
    if !without_proc("true".as_ref()).output().is_ok_and(|output| output.status.success()) {
        return extent::not_run("unshare", "a command that is ended removes the hidden file that it is writing");
    }
    let place = Place::new();
    fs::write(place.path("a.ppm"), [b"P6 4000 3000 255\n".as_slice(), &[7; 3 * 4000 * 3000]].concat()).unwrap();
    // It may be done before it is noticed or ended.
    let was_ended = || {
        let mut command = without_proc("env".as_ref());
        command.args(["--default-signal", env!("CARGO_BIN_EXE_rayo"), "diff", "a.ppm", "a.ppm", "-o", "b.png"]);
        let mut child = command.current_dir(&place.directory).spawn().unwrap();
        while place.files().iter().all(|name| !name.starts_with(".rayo-")) {
            if child.try_wait().unwrap().is_some() {
                return false;
            }
        }
        program::signal("TERM", child.id()) && child.wait().unwrap().code() == Some(143)
    };
    assert!((0..50).any(|_| was_ended()));
    assert!(place.files().iter().all(|name| !name.starts_with('.')), "{:?}", place.files());
}

// Two images

/// Two P3 files that differ by 3 levels in one pixel.
fn images() -> Place {
    let place = Place::new();
    place.write("a.ppm", "P3 2 1 255  10 20 30  1 2 3");
    place.write("b.ppm", "P3 2 1 255  10 20 30  1 5 3");
    place
}

#[test]
fn diff_tells_in_words_what_differs() {
    let place = images();
    let same = place.run("diff a.ppm a.ppm");
    assert_eq!((same.status, same.stdout.as_str(), same.stderr.as_str()), (0, "identical: 2x1 pixels\n", ""));
    let other = place.run("diff a.ppm b.ppm");
    assert_eq!((other.status, other.stderr.as_str()), (1, ""));
    assert_eq!(
        other.stdout,
        "1 of 2 pixels differ (50.000 %), 1 by 2 levels or more\n\
         largest difference 3 levels at (1, 0): 1 2 3 against 1 5 3\n\
         mean 0.500 levels, RMS 1.225 levels, PSNR 46.37 dB\n"
    );
}

#[test]
fn diff_passes_up_to_the_tolerance() {
    let place = images();
    for (tolerance, status) in [("0", 1), ("2.9", 1), ("3", 0), ("inf", 0)] {
        assert_eq!(place.run(&format!("diff a.ppm b.ppm --tolerance {tolerance}")).status, status, "{tolerance}");
    }
    // What is not a number differs by more than any tolerance.
    for (name, value) in [("nan.pfm", f32::NAN), ("one.pfm", 1.0)] {
        fs::write(place.path(name), [b"Pf\n1 1\n-1\n".as_slice(), &value.to_le_bytes()].concat()).unwrap();
    }
    assert_eq!(place.run("diff nan.pfm one.pfm --tolerance inf").status, 1);
    for tolerance in ["-1", "nan", "two"] {
        let message = invalid(tolerance, "--tolerance <T>", "expected a number that is not negative");
        place.refuses(&format!("diff a.ppm b.ppm --tolerance {tolerance}"), 2, &message);
    }
}

#[test]
fn diff_prints_one_json_document() {
    let run = images().run("diff a.ppm b.ppm --json");
    assert_eq!(run.status, 1);
    let json = run.document();
    for (name, expected) in [
        ("schema", json!(1)),
        ("within_tolerance", json!(false)),
        ("differing", json!(1)),
        ("largest", json!(3.0)),
        ("largest_at", json!([1, 0])),
    ] {
        assert_eq!(json[name], expected, "{name}");
    }
}

#[test]
fn diff_writes_the_picture_of_the_differences() {
    let place = images();
    let run = place.run("diff a.ppm b.ppm -o out.png");
    assert_eq!((run.status, run.stderr.as_str()), (1, ""));
    assert!(run.stdout.ends_with("\nout.png: the differences, white where they are largest\n"), "{}", run.stdout);
    assert_eq!(place.picture("out.png").pixels, Pixels::Rgb8(vec![[0; 3], [0, 255, 0]]));
}

#[test]
fn diff_refuses_what_claims_another_size_before_it_is_decoded() {
    let place = images();
    // A picture that says that it is large, and is damaged: that is not found out.
    place.write("large.ppm", &format!("P6 300 30 255\n{}", "x".repeat(27_000)));
    let damaged = fs::read(place.path("large.ppm")).unwrap();
    fs::write(place.path("large.ppm"), &damaged[..26_000]).unwrap();
    let sizes = "error: cannot compare a.ppm with large.ppm: the first picture has 2x1 pixels and the second 300x30: \
                 only pictures of one size can be compared";
    place.refuses("diff a.ppm large.ppm", 2, sizes);
    let run = place.run("diff large.ppm large.ppm");
    assert_eq!(
        (run.status, run.stderr.as_str()),
        (2, "error: large.ppm is damaged or incomplete: it ends too early\n")
    );
}

#[test]
fn diff_says_what_keeps_images_from_being_compared() {
    let place = images();
    let kind = "error: scene.in is no image that can be read here: PNG, PPM (P3, P6), PGM (P2, P5), PFM, EXR, HDR, TIFF and \
                QOI are";
    place.refuses("diff a.ppm scene.in", 2, kind);
    let missing = "error: cannot read none.png: No such file or directory (os error 2)";
    place.refuses("diff a.ppm none.png", 2, missing);
    let floats = "error: out.pfm: the picture of differences has 8 bits; name it .png or .ppm";
    place.refuses("diff a.ppm a.ppm -o out.pfm", 2, floats);
    assert_eq!(place.run("diff a.ppm a.ppm -o out.jpg").status, 2);
    let directory = "error: cannot write none/out.png: there is no directory none; create it first";
    place.refuses("diff a.ppm b.ppm -o none/out.png", 1, directory);
    assert_eq!(place.files(), ["a.ppm", "b.ppm", "scene.in"]);
}
