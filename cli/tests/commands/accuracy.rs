//! `rayo accuracy`: its files, its JSON document, and the errors for bad requests.

use std::path::Path;

use rayo_lab::experiments::accuracy::contenders;
use serde_json::Value;
use tempfile::TempDir;

use crate::program::{self, Run};
use crate::schema;

fn rayo_accuracy(args: &[&str], out: &Path) -> Run {
    let arguments = [&["accuracy"], args, &["--out", out.to_str().unwrap()]].concat();
    program::rayo(arguments, Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/..")))
}

#[test]
fn a_run_writes_its_files_and_its_document_keeps_to_the_schema() {
    let directory = TempDir::new().unwrap();
    let run = rayo_accuracy(&["scenes/tetrahedron.in", "s1", "--quick", "--json"], directory.path());
    let document = run.document();
    assert_eq!(run.stderr, "");
    let schema = serde_json::from_str(include_str!("../../../docs/accuracy.schema.json")).unwrap();
    assert_eq!(schema::errors(&schema, &document), Vec::<String>::new());
    let text = |name: &str| std::fs::read_to_string(directory.path().join(name)).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&text("results.json")).unwrap(), document, "what is printed is written");

    let rows = document["rows"].as_array().unwrap();
    let scenes: Vec<_> = rows.iter().filter(|row| row["engine"] == "rust").map(|row| row["scene"].clone()).collect();
    assert_eq!(scenes, ["scenes/tetrahedron.in", "S1 4", "S1 1000", "S1 1e7"]);
    for contender in contenders() {
        let [engine, precision] = [contender.engine.name(), contender.precision.name()];
        let is_its = |row: &&Value| row["engine"] == engine && row["precision"] == precision;
        assert!(rows.iter().filter(is_its).count() >= 4, "{contender:?}");
    }
    // A row with --keep-all has the same errors as the row without.
    let kept = rows.iter().filter(|row| row["option"] == "--keep-all");
    for row in kept.clone() {
        let same = |other: &&Value| ["scene", "engine", "precision", "output"].iter().all(|key| other[key] == row[key]);
        let planned = rows.iter().filter(same).find(|other| other["option"].is_null()).unwrap();
        for figure in ["wrong_hits", "max_ulp", "max_angle", "max_colour", "rms_colour", "off_by_1", "psnr"] {
            assert_eq!(planned[figure], row[figure], "{figure} of {row}");
        }
    }
    assert!(kept.count() > 0);
    assert_eq!(
        document["against_plain"].as_array().unwrap().is_empty(),
        cfg!(not(all(feature = "asm", target_arch = "x86_64")))
    );
    // The fastest row of each scene and output is on its Pareto front.
    for (scene, output) in rows.iter().map(|row| (&row["scene"], &row["output"])) {
        let of = || rows.iter().filter(move |row| &row["scene"] == scene && &row["output"] == output);
        let time = |row: &Value| row["ns_per_ray"].as_f64().unwrap();
        let fastest = of().map(time).fold(f64::INFINITY, f64::min);
        assert!(of().any(|row| row["front"] == true && time(row) == fastest), "{scene} {output}");
    }
    assert_eq!(text("table.csv").lines().count(), 1 + rows.len());
    let cells = |line: &str| line.matches(',').count();
    assert!(text("table.csv").lines().all(|line| cells(line) == cells(text("table.csv").lines().next().unwrap())));
    assert!(text("accuracy.svg").starts_with("<svg") && text("accuracy.svg").contains("S1: far spheres"));
    let page = text("accuracy.md");
    assert!(page.contains("| S1 1e7"));
    assert!(page.contains(&rayo_lab::measure::cpu_name()));
}

#[test]
fn table_is_for_people_and_a_bad_scene_is_refused() {
    let directory = TempDir::new().unwrap();
    let run = rayo_accuracy(&["scenes/sphere.in", "--quick"], directory.path());
    let text = run.printed();
    assert!(text.contains("160×120") && text.contains("| reference |"), "{text}");
    assert!(text.contains("| front |") && text.contains("| * |") || text.contains("   * |"), "{text}");
    for scene in ["scenes/none.in", "N1", "Makefile"] {
        rayo_accuracy(&[scene, "--quick"], directory.path()).refuses(scene);
    }
}
