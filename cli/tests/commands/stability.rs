//! `rayo stability`: its files, the limits that it holds engines to, and what it refuses.

use std::fs;

use rayo_lab::experiments::accuracy::contenders;

use crate::program::rayo;

#[test]
fn command_writes_its_files_by_the_contract() {
    let directory = tempfile::tempdir().unwrap();
    let stability = ["stability", "--family", "s7", "--case", "3", "--quick", "--json"];
    let document = rayo(stability, directory.path()).document();
    assert_eq!(document["schema"], 1);
    let rows = document["rows"].as_array().unwrap();
    assert_eq!(rows.len(), contenders().len());
    for row in rows {
        for field in ["family", "engine", "precision", "worst", "bound", "wrong_hits", "slowdown", "holds"] {
            assert!(row.get(field).is_some(), "{field}");
        }
        assert_eq!(row["holds"], true);
    }
    for file in ["stability.md", "stability.svg", "results.json", "limits.csv"] {
        assert!(directory.path().join("out/stability").join(file).exists(), "{file}");
    }
    let page = std::fs::read_to_string(directory.path().join("out/stability/stability.md")).unwrap();
    assert!(page.contains(&rayo_lab::measure::cpu_name()));
}

#[test]
fn broken_limit_ends_with_1_and_a_command_to_repeat_it() {
    let directory = tempfile::tempdir().unwrap();
    let stability = |arguments: &[&str]| {
        let run = rayo([&["stability"], arguments].concat(), directory.path());
        (run.status, run.stderr)
    };
    let sweep = ["--family", "S7", "--engine", "rust", "--quick"];
    assert_eq!(stability(&sweep), (0, String::new()));
    // An engine keeps the limits that its own sweep wrote, but not with the one on the error of t
    // set to 0.25 ulp.
    let just = fs::read_to_string(directory.path().join("out/stability/limits.csv")).unwrap();
    let (head, row) = just.trim_end().split_once('\n').unwrap();
    let mut cells: Vec<_> = row.split(',').collect();
    assert_eq!((head.split(',').nth(3), &cells[..3]), (Some("max_ulp"), &["S7", "rust", "single"][..]));
    cells[3] = "0.25";
    fs::write(directory.path().join("just.csv"), &just).unwrap();
    fs::write(directory.path().join("strict.csv"), format!("{head}\n{}\n", cells.join(","))).unwrap();
    assert_eq!(stability(&[&sweep[..], &["--limits", "just.csv"]].concat()), (0, String::new()));
    let (status, error) = stability(&[&sweep[..], &["--limits", "strict.csv"]].concat());
    let lines: Vec<_> = error.lines().collect();
    assert_eq!((status, lines.len()), (1, 2), "{error}");
    let found =
        |line: &str| line.strip_prefix("error: S7 by rust in single: the error of t in ulp is ").unwrap().to_owned();
    assert!(found(lines[0]).ends_with(", above 0.25"), "{error}");
    // The command that was printed finds the same error in its one case.
    let replay: Vec<_> = lines[1].split_whitespace().skip(2).collect();
    assert!(replay.contains(&"--case") && replay.contains(&"--seed"), "{error}");
    let (status, again) = stability(&[&replay[..], &["--limits", "strict.csv"]].concat());
    assert_eq!((status, found(again.lines().next().unwrap())), (1, found(lines[0])));
    // A file that does not exist, or has no limits, is bad input.
    for (file, expected) in [("no.csv", "no.csv"), ("out/stability/stability.md", "the first line must be family")] {
        let (status, error) = stability(&[&sweep[..], &["--limits", file]].concat());
        assert!(status == 2 && error.contains(expected), "{error}");
    }
}

#[test]
fn what_there_is_not_is_an_error_that_says_what_there_is() {
    let directory = tempfile::tempdir().unwrap();
    for (arguments, expected) in [
        (&["stability", "--family", "S10"][..], "S1, S2"),
        (&["stability", "--family", "N1", "--case", "24"], "0 to 23"),
        (&["stability", "--engine", "cuda"], "reference"),
        (&["stability", "--case", "3"], "--family"),
    ] {
        rayo(arguments, directory.path()).refuses(expected);
    }
}
