//! `rayo render --preview`: a picture in characters or half blocks, of the same view as a file.

use std::path::Path;

use crate::program::rayo;
use tempfile::TempDir;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

fn scene(name: &str) -> String {
    format!("{ROOT}/scenes/{name}")
}

/// The output of `rayo render ... --preview`, which must succeed.
fn shown(args: &[&str], directory: &Path) -> String {
    rayo([&["render", "--preview"], args].concat(), directory).printed().to_owned()
}

fn files(directory: &Path) -> usize {
    std::fs::read_dir(directory).unwrap().count()
}

#[test]
fn without_a_terminal_a_picture_is_letters_and_no_file() {
    let directory = TempDir::new().unwrap();
    let sphere = shown(&[&scene("sphere.in"), "--engine", "reference"], directory.path());
    let lines: Vec<_> = sphere.lines().collect();
    assert!(lines.len() == 24 && lines.iter().all(|line| line.len() <= 64), "{sphere}");
    assert!(sphere.chars().all(|c| " .:-=+*#%@\n".contains(c)), "{sphere}");
    // The sphere is in the middle, lit from the upper right.
    assert!(lines[0].is_empty() && lines[23].is_empty() && lines[12].len() > 32, "{sphere}");
    let brightest = lines.iter().position(|line| line.contains('@')).expect("it has a bright spot");
    assert!(brightest < 12 && lines[brightest].rfind('@').unwrap() > 32, "{sphere}");
    assert_eq!(files(directory.path()), 0);
    let forced = rayo(["render", "--preview", "--force", "--size", "4x4", &scene("sphere.in")], directory.path());
    let note = "note: --preview writes no file unless -o names one: --force has nothing to replace\n";
    assert!(forced.status == 0 && forced.stderr.starts_with(note), "{}", forced.stderr);
}

#[test]
fn every_option_of_the_picture_holds_for_the_preview() {
    let directory = TempDir::new().unwrap();
    let tetrahedron = scene("tetrahedron.in");
    let of = |args: &[&str]| shown(&[&[tetrahedron.as_str(), "--quiet"], args].concat(), directory.path());
    let plain = of(&[]);
    for engine in rayo::Engine::ALL.iter().filter(|engine| engine.usable()) {
        assert_eq!(of(&["--engine", engine.name(), "--threads", "2", "--keep-all"]), plain, "{engine}");
    }
    for change in [
        &["--samples", "1"][..],
        &["--background", "0.1,0.4,0.9"],
        &["--exposure", "1"],
        &["--srgb"],
        &["--film", "2"],
        &["--size", "40x"],
        &["--rows", "300..500"],
    ] {
        assert_ne!(of(change), plain, "{change:?}");
    }
    // A picture smaller than the terminal is not enlarged; rows are those of the whole picture.
    let whole = of(&["--size", "40x30", "--samples", "2"]);
    assert_eq!(whole.lines().count(), 15);
    let part = of(&["--size", "40x30", "--samples", "2", "--rows", "10..20"]);
    assert_eq!(part.lines().collect::<Vec<_>>(), whole.lines().skip(5).take(5).collect::<Vec<_>>());
    // A huge picture, and a single row of it.
    let huge = of(&["--size", "40000x30000"]);
    assert_eq!((huge.as_str(), of(&["--size", "40000x30000", "--rows", "9..10"]).lines().count()), (plain.as_str(), 1));
}

#[test]
fn preview_also_writes_a_named_file() {
    let directory = TempDir::new().unwrap();
    let at = directory.path();
    let both = shown(&[&scene("sphere.in"), &scene("tetrahedron.in"), "--size", "80x60"], at);
    let each = ["sphere.in", "tetrahedron.in"].map(|name| shown(&[&scene(name), "--size", "80x60"], at)).concat();
    assert_eq!((both, files(at)), (each, 0));
    let size = ["--size", "80x60"];
    let with_file = shown(&[&[scene("sphere.in").as_str(), "-o", "a.png", "--stats"], &size[..]].concat(), at);
    assert!(with_file.contains('@') && with_file.contains("\nengine "), "{with_file}");
    rayo([&["render", &scene("sphere.in"), "-o", "b.png"], &size[..]].concat(), at).printed();
    assert!(std::fs::read(at.join("a.png")).unwrap() == std::fs::read(at.join("b.png")).unwrap());
    // The messages of a preview do not name a file as if one had been written.
    let said = rayo(["render", "--preview", &scene("sphere.in"), "--size", "80x60"], at).stderr;
    assert!(said.starts_with("preview of ") && said.contains("sphere.in: ") && !said.contains(".png"), "{said}");
}

#[cfg(target_os = "linux")]
#[test]
fn terminal_gets_half_blocks_or_letters_in_its_width() {
    let rayo = assert_cmd::cargo::cargo_bin!("rayo").display().to_string();
    // `script` runs the program in a terminal and prints its output.
    let on_terminal = |variables: [(&str, &str); 2]| {
        let mut command = std::process::Command::new("script");
        let render = format!("stty cols 50 rows 40; '{rayo}' render scenes/tetrahedron.in --preview --quiet");
        command.args(["-qec", &render, "/dev/null"]).current_dir(ROOT).stdin(std::process::Stdio::null());
        let output = command.envs(variables).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        String::from_utf8(output.stdout).unwrap()
    };
    let true_colour = on_terminal([("COLORTERM", "truecolor"), ("NO_COLOR", "")]);
    let lines: Vec<_> = true_colour.lines().filter(|line| line.contains('▀')).collect();
    assert_eq!(lines.len(), 19, "{true_colour}");
    assert!(lines.iter().all(|line| line.matches('▀').count() == 50 && line.trim_end().ends_with("\u{1b}[0m")));
    assert!(true_colour.contains("\u{1b}[38;2;"));
    let few_colours = on_terminal([("COLORTERM", ""), ("NO_COLOR", "")]);
    assert!(few_colours.contains("\u{1b}[38;5;") && !few_colours.contains(";2;"), "{few_colours}");
    let letters = on_terminal([("COLORTERM", "truecolor"), ("NO_COLOR", "1")]);
    assert!(!letters.contains('\u{1b}') && letters.lines().count() == 19, "{letters}");
}

#[test]
fn what_cannot_be_shown_is_refused_with_a_reason() {
    let directory = TempDir::new().unwrap();
    for (args, expected) in [
        (&["-o", "-"][..], "--preview prints where the picture is to go"),
        (&["--json"], "--preview prints a picture where --json prints a document"),
        (&["--stats"], "--stats is of a picture that is written"),
        (&["--rows", "0..2000"], "--rows 0..2000: the picture has the rows 0..1224"),
        (&["--size", "80x65535", "--rows", "0..10"], "--samples 4: each side of an image"),
    ] {
        rayo([&["render", "--preview", &scene("sphere.in")], args].concat(), directory.path()).refuses(expected);
    }
    assert_eq!(files(directory.path()), 0);
}
