//! Picture files: their names, errors of the system, and comparing parts of pictures.

use std::fs;
use std::path::Path;

use crate::program::rayo;
use tempfile::TempDir;

/// A sphere and a triangle behind it in 40 x 30 pixels.
const SCENE: &str = "picture.png 40 30 1  1 1 1 1 1 5 5 0  1 1 1 0.5 0 0 0 5  1 0 0 1 -9 -9 9 9 -9 9 0 9 9\n";

/// A new directory with the scene.
fn place() -> TempDir {
    let directory = TempDir::new().unwrap();
    fs::write(directory.path().join("in.in"), SCENE).unwrap();
    directory
}

/// The names in a directory, including hidden ones, sorted.
fn names(directory: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn a_folder_that_is_missing_is_told_before_the_first_ray() {
    let place = place();
    fs::write(place.path().join("file"), "").unwrap();
    // Rendering this would take hours.
    let long = ["--engine", "reference", "--size", "40000x40000"];
    for (name, status, words) in [
        ("nowhere/a.png", 1, "cannot write nowhere/a.png: there is no directory nowhere; create it first"),
        ("file/a.png", 1, "cannot write file/a.png: Not a directory"),
        (".", 1, "cannot write .: Is a directory (os error 21); name a file in it"),
        ("folder.of/", 2, "the name of an image must end in"),
    ] {
        let run = rayo(["render", "in.in", "-o", name].iter().chain(&long), place.path());
        assert_eq!(run.status, status, "{name}: {}", run.stderr);
        assert!(run.stderr.contains(words), "{name}: {}", run.stderr);
    }
    assert_eq!(names(place.path()), ["file", "in.in"]);
}

#[test]
fn names_with_commas_percent_signs_and_dashes_are_names() {
    let place = place();
    for scene in ["a,b c.in", "100%.in", "./-dash.in", "[1].in", "new\nline.in"] {
        fs::write(place.path().join(scene), SCENE).unwrap();
        rayo(["render", scene, "--quiet", "-o", "o,%d 100%.png"], place.path()).printed();
        fs::remove_file(place.path().join("o,%d 100%.png")).unwrap();
    }
    rayo(["render", "--quiet", "-o", "d.png", "--", "-dash.in"], place.path()).printed();
    assert!(place.path().join("d.png").exists());
}

#[test]
fn a_pattern_of_several_pictures_has_one_number_of_sane_width() {
    let place = place();
    let patterns = ["a%.png", "a%d%d.png", "%s.png", "%99999999d.png", "%05d%%.png", "a.png", "%-3d.png", "% d.png"];
    for pattern in patterns {
        let run = rayo(["render", "in.in", "--orbit", "2", "-o", pattern], place.path());
        run.refuses("give it a number, as in frames/%04d.png");
    }
    assert_eq!(names(place.path()), ["in.in"]);
}

#[test]
fn rows_in_an_exr_are_compared_at_their_place() {
    let place = place();
    for (size, rows) in [("400x300", "0..1"), ("400x300", "0..10"), ("400x300", "150..151"), ("4000x3000", "9..10")] {
        let arguments = ["render", "in.in", "--quiet", "--size", size, "--rows", rows, "-o", "p.exr"];
        rayo(arguments, place.path()).printed();
        let same = rayo(["diff", "p.exr", "p.exr"], place.path());
        assert_eq!(same.printed(), format!("identical: {size} pixels\n"), "rows {rows}");
    }
    // Outside of the rows, the picture is black.
    rayo(["render", "in.in", "--quiet", "-o", "whole.exr"], place.path()).printed();
    rayo(["render", "in.in", "--quiet", "--rows", "15..16", "-o", "part.exr"], place.path()).printed();
    let run = rayo(["diff", "part.exr", "whole.exr"], place.path());
    assert_eq!(run.status, 1, "{}", run.stderr);
    assert!(run.stdout.contains(": 0 0 0 against "), "{}", run.stdout);
}

#[test]
fn a_number_that_is_none_differs_from_all_that_are() {
    let place = place();
    let pixels = |name: &str, value: f32| {
        let rows = [0.5_f32, 0.5, 0.5, value, value, value].map(f32::to_le_bytes);
        fs::write(place.path().join(name), [&b"PF\n2 1\n-1\n"[..], rows.as_flattened()].concat()).unwrap();
    };
    pixels("number.pfm", 0.25);
    pixels("nan.pfm", f32::NAN);
    pixels("inf.pfm", f32::INFINITY);
    pixels("minus.pfm", f32::NEG_INFINITY);
    let files = ["number.pfm", "nan.pfm", "inf.pfm", "minus.pfm"];
    for (a, b) in files.iter().flat_map(|a| files.iter().map(move |b| (a, b))) {
        for tolerance in ["0", "255"] {
            let run = rayo(["diff", a, b, "--tolerance", tolerance], place.path());
            assert_eq!(run.status, i32::from(a != b), "{a} {b} {tolerance}: {}{}", run.stdout, run.stderr);
        }
    }
}

#[cfg(target_os = "linux")]
mod refusals {
    use super::*;
    use crate::program::Run;
    use crate::refused::{LINKS, NAMELESS, Refusal, SYNC, refuse};
    use std::process::Command;

    /// Renders the scene to a file of this name while the system refuses calls.
    fn render(place: &TempDir, name: &str, refusal: Option<Refusal>) -> Run {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rayo"));
        command.args(["render", "in.in", "--quiet", "-o", name]).current_dir(place.path());
        if let Some(refusal) = refusal {
            refuse(&mut command, refusal);
        }
        Run::of(command.output().unwrap())
    }

    #[test]
    fn a_picture_is_named_where_nameless_files_or_links_are_refused() {
        let place = place();
        render(&place, "plain.png", None).printed();
        let plain = fs::read(place.path().join("plain.png")).unwrap();
        for refusal in [NAMELESS, LINKS] {
            // Once for a new file, and once for a file that is replaced.
            for _ in 0..2 {
                render(&place, "a.png", Some(refusal)).printed();
                assert_eq!(fs::read(place.path().join("a.png")).unwrap(), plain);
                assert_eq!(names(place.path()), ["a.png", "in.in", "plain.png"]);
            }
            fs::remove_file(place.path().join("a.png")).unwrap();
        }
    }

    #[test]
    fn what_the_disk_does_not_take_replaces_nothing() {
        let place = place();
        fs::write(place.path().join("a.png"), "old").unwrap();
        let run = render(&place, "a.png", Some(SYNC));
        assert_eq!(run.status, 1, "{}", run.stderr);
        assert!(run.stderr.starts_with("error: cannot write a.png: "), "{}", run.stderr);
        assert_eq!(fs::read(place.path().join("a.png")).unwrap(), b"old");
        assert_eq!(names(place.path()), ["a.png", "in.in"]);
    }

    #[test]
    fn a_name_may_be_as_long_as_the_file_system_allows() {
        let place = place();
        for refusal in [None, Some(NAMELESS), Some(LINKS)] {
            for length in [251, 255] {
                let name = "0".repeat(length - 4) + ".png";
                for _ in 0..2 {
                    render(&place, &name, refusal).printed();
                    assert_eq!(names(place.path()), [name.as_str(), "in.in"]);
                }
                fs::remove_file(place.path().join(name)).unwrap();
            }
            let run = render(&place, &("0".repeat(252) + ".png"), refusal);
            assert_eq!(run.status, 1);
            assert!(run.stderr.contains("File name too long"), "{}", run.stderr);
        }
    }
}
