//! `rayo experiment`: its files, its document against the schema, and the errors for bad requests.

use crate::extent;
use crate::program::{self, Run};
use std::path::Path;
use std::sync::OnceLock;

use crate::schema::errors;
use serde_json::Value;
use tempfile::TempDir;

fn rayo(args: &[&str], out: &Path) -> Run {
    program::rayo([&["experiment"], args, &["--out", out.to_str().unwrap()]].concat(), Path::new("."))
}

/// The document of a quick run, and the directory with its files.
fn quick(args: &[&str]) -> (TempDir, Value) {
    let directory = TempDir::new().unwrap();
    let document = rayo(&[&["--quick", "--runs", "1", "--json"], args].concat(), directory.path()).document();
    (directory, document)
}

/// The document of a run with all stages, which is made once and shared with the tests of the
/// report.
pub fn whole() -> &'static (TempDir, Value) {
    static MADE: OnceLock<(TempDir, Value)> = OnceLock::new();
    MADE.get_or_init(|| quick(&["--ladder"]))
}

fn experiment_schema() -> Value {
    serde_json::from_str(include_str!("../../../docs/experiment.schema.json")).unwrap()
}

#[test]
fn quick_run_writes_every_file_by_its_schema() {
    let (directory, document) = whole();
    assert_eq!(errors(&experiment_schema(), document), Vec::<String>::new());
    let written: Value =
        serde_json::from_slice(&std::fs::read(directory.path().join("results.json")).unwrap()).unwrap();
    assert_eq!(&written, document, "what is printed is what is written");

    let text = |name: &str| std::fs::read_to_string(directory.path().join(name)).unwrap();
    for name in ["figure2.svg", "ratio.svg"] {
        assert!(text(name).starts_with("<svg"), "{name}");
    }
    let rows = document["rows"].as_array().unwrap();
    assert_eq!(text("table.csv").lines().count(), 1 + rows.len());
    assert!(text("table.md").contains("| 1632×1224 "));

    // Five sizes, each with the same contestants: floats by every engine, and bytes by some.
    let sizes: Vec<_> = rows.iter().filter(|row| row["engine"] == "c").map(|row| row["pixels"].as_u64()).collect();
    assert_eq!(sizes, [99_645, 499_392, 999_364, 1_498_840, 1_997_568].map(Some));
    for engine in rayo::internals::render::Engine::ALL.iter().filter(|engine| engine.usable()) {
        let of_engine = rows.iter().filter(|row| row["engine"] == engine.name() && row["output"] == "f32x4");
        assert_eq!(of_engine.count(), 5, "{engine}");
    }
    assert_eq!(document["verdicts"].as_array().unwrap().len(), 9);
    assert_eq!(document["conditions"]["complete"], true);
    let rungs: Vec<_> =
        document["ladder"].as_array().unwrap().iter().map(|rung| rung["rung"].as_str().unwrap()).collect();
    for rung in ["c, called", "c", "sqrtf", "inlined", "lean", "hoisted", "turned", "paper", "paper, called", "lanes"] {
        assert!(rungs.contains(&rung), "{rung} in {rungs:?}");
    }
}

/// A process that keeps a core busy until it is dropped.
#[cfg(target_os = "linux")]
struct Burner(std::process::Child);

#[cfg(target_os = "linux")]
impl Drop for Burner {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn verdicts_beside_a_busy_process_are_right_or_withheld() {
    if !extent::all() {
        return; // half a minute
    }
    // Child processes inherit the pinning, and so compete for the core.
    rayo::internals::kernels::sys::pin_to_this_core().unwrap();
    let (_directory, quiet) = quick(&["--engines", "c"]);
    let burner = std::process::Command::new("sh").args(["-c", "while :; do :; done"]).spawn().unwrap();
    let burner = Burner(burner);
    let (directory, busy) = quick(&["--engines", "c"]);
    drop(burner);

    let disturbed = busy["disturbed"].as_array().unwrap();
    let is_none = |verdict: &Value| verdict == "not testable here" || verdict == "too few runs to tell";
    for (quiet, busy) in quiet["verdicts"].as_array().unwrap().iter().zip(busy["verdicts"].as_array().unwrap()) {
        let [in_quiet, beside] = [&quiet["verdict"], &busy["verdict"]];
        assert!(in_quiet == beside || is_none(in_quiet) || is_none(beside), "{quiet}\n{busy}");
    }
    let table = std::fs::read_to_string(directory.path().join("table.md")).unwrap();
    for reason in disturbed {
        assert_eq!(table.matches(&format!("- {}\n", reason.as_str().unwrap())).count(), 2, "{table}");
    }
}

#[test]
fn unknown_engine_is_an_error_with_a_list() {
    let directory = TempDir::new().unwrap();
    let run = rayo(&["--quick", "--engines", "rust,fortran"], directory.path());
    ["fortran", "reference", "rust", "c", "paper"].into_iter().for_each(|part| run.refuses(part));
}

#[test]
fn bad_runs_are_bad_usage_and_a_bad_directory_fails() {
    let directory = TempDir::new().unwrap();
    for runs in ["0", "-1", "many"] {
        rayo(&["--runs", runs], directory.path()).refuses(runs);
    }
    let file = directory.path().join("file");
    std::fs::write(&file, "").unwrap();
    let run = rayo(&["--quick"], &file.join("below"));
    assert_eq!(run.status, 1, "{}", run.stderr);
}

#[test]
fn single_case_is_held_to_the_rest_of_its_limit() {
    let at = TempDir::new().unwrap();
    // Nearly all hits of this case are wrong, but far fewer of its whole level.
    let case = ["stability", "--family", "S1", "--engine", "paper", "--case", "45", "--quick"];
    assert!(program::rayo(case, at.path()).printed().contains("kept"));
}

/// By the time of the signal, the command has announced its duration and installed its handlers.
#[cfg(target_os = "linux")]
#[test]
fn stopped_measurement_has_the_status_of_its_signal() {
    use std::io::{BufRead, BufReader};
    use std::process::Stdio;
    for command in ["accuracy", "stability"] {
        for (signal, status) in [("TERM", 143), ("INT", 130)] {
            let directory = TempDir::new().unwrap();
            let mut program = program::in_the_foreground();
            program.arg(command).arg("--out").arg(directory.path()).stdout(Stdio::null()).stderr(Stdio::piped());
            let mut child = program.spawn().unwrap();
            let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
            assert!(lines.next().unwrap().starts_with("this will take"));
            assert!(program::signal(signal, child.id()));
            let said: Vec<_> = lines.collect();
            assert_eq!(child.wait().unwrap().code(), Some(status), "{command}, {signal}: {said:?}");
            assert!(said.last().unwrap().starts_with("error: stopped "), "{command}, {signal}: {said:?}");
        }
    }
}

/// Stopped in its first second, a run keeps the sizes that are finished and says so, or says that
/// none is.
#[cfg(target_os = "linux")]
#[test]
fn an_interrupt_keeps_what_is_finished_and_says_so() {
    use std::process::Stdio;
    let directory = TempDir::new().unwrap();
    // More runs than any machine can finish.
    let mut child = program::in_the_foreground()
        .args(["experiment", "--engines", "c", "--runs", "3", "--json", "--out"])
        .arg(directory.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_millis(600));
    let interrupted = program::signal("INT", child.id());
    let finished = child.try_wait().unwrap().is_some();
    let output = child.wait_with_output().unwrap();
    let message = String::from_utf8_lossy(&output.stderr);
    if finished || !interrupted {
        return;
    }
    match output.status.code() {
        Some(130) if !output.stdout.is_empty() => {
            let document: Value = serde_json::from_slice(&output.stdout).unwrap();
            assert_eq!(errors(&experiment_schema(), &document), Vec::<String>::new());
            assert_eq!(document["conditions"]["complete"], false);
            let runs = format!("error: stopped early: {} of 3 runs, in ", document["conditions"]["runs"]);
            assert!(message.contains(&runs) && message.contains("are finished and kept in "), "{message}");
        }
        Some(130) => assert!(message.contains("before the first size was finished"), "{message}"),
        other => panic!("{other:?}: {message}"),
    }
}

#[test]
fn growing_pictures_are_written_by_their_schema() {
    if !rayo::internals::render::Engine::ALL.iter().any(|engine| engine.is_packet() && engine.usable()) {
        return;
    }
    let directory = TempDir::new().unwrap();
    let document = rayo(&["--complexity", "--quick", "--runs", "1", "--json"], directory.path()).document();
    let schema = serde_json::from_str(include_str!("../../../docs/complexity.schema.json")).unwrap();
    assert_eq!(errors(&schema, &document), Vec::<String>::new());
    let text = |name: &str| std::fs::read_to_string(directory.path().join(name)).unwrap();
    assert!(text("complexity.svg").starts_with("<svg") && text("complexity.md").contains("## Lights"));
    assert!(text("complexity.md").contains(&rayo_lab::measure::cpu_name()));
    let rows = document["rows"].as_array().unwrap();
    assert_eq!(text("complexity.csv").lines().count(), 1 + rows.len());
    for (axis, most) in [("pixels", 399_310), ("objects", 10_000), ("lights", 64)] {
        let counts = rows.iter().filter(|row| row["axis"] == axis).map(|row| row["count"].as_u64().unwrap());
        assert_eq!(counts.max(), Some(most), "{axis}");
        assert!(document["slopes"].as_array().unwrap().iter().any(|slope| slope["axis"] == axis), "{axis}");
    }
}

#[test]
fn growing_pictures_without_packets_are_refused_by_name() {
    let directory = TempDir::new().unwrap();
    rayo(&["--complexity", "--engines", "rust"], directory.path()).refuses("sse41, avx2 or avx512");
    // Where packets are available, the other errors are reported before anything is measured.
    let taken = directory.path().join("taken");
    std::fs::write(&taken, "").unwrap();
    let run = rayo(&["--complexity", "--engines", "rust,portable,c"], &taken);
    let note = "note: --complexity is for packet engines, and leaves out rust, c\n";
    assert!(run.status != 0 && run.stderr.contains(note), "{}", run.stderr);
}
