//! Several ranks: the file of one process, or an error that is told once and no file.
#![cfg(feature = "mpi")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;

/// `rayo` in a directory, started by MPI as so many ranks; on few cores and, as in a container, as root too.
fn mpirun(ranks: usize, directory: &Path) -> Command {
    let mut command = Command::new("mpirun");
    command.args(["--oversubscribe", "-n", &ranks.to_string(), env!("CARGO_BIN_EXE_rayo")]);
    command.env("OMPI_ALLOW_RUN_AS_ROOT", "1").env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1");
    command.env("NO_COLOR", "1").env_remove("RAYO_ENGINE").current_dir(directory);
    command
}

fn run(ranks: usize, directory: &Path, arguments: &str) -> Output {
    mpirun(ranks, directory).args(arguments.split(' ')).output().unwrap()
}

fn alone(directory: &Path, arguments: &str) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rayo"));
    let output = command.args(arguments.split(' ')).current_dir(directory).output().unwrap();
    assert!(output.status.success(), "{output:?}");
}

fn scene(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name)
}

/// The names in a directory, sorted, hidden ones too.
fn names(directory: &TempDir) -> Vec<String> {
    let entries = fs::read_dir(directory.path()).unwrap();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// What standard error says beside what mpirun itself has to say.
fn told(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn any_number_of_ranks_writes_the_file_of_one_process() {
    let directory = tempfile::tempdir().unwrap();
    for name in ["sphere.in", "many.in", "island.toml"] {
        for format in ["png", "ppm", "pgm", "pfm", "exr", "hdr", "tiff", "qoi"] {
            let render = format!("render {} --size 333x1251 --quiet", scene(name).display());
            alone(directory.path(), &format!("{render} -o alone.{format}"));
            let expected = fs::read(directory.path().join(format!("alone.{format}"))).unwrap();
            for (ranks, threads) in [(1, 2), (2, 1), (3, 2), (5, 1)] {
                let output = run(ranks, directory.path(), &format!("{render} --threads {threads} -o ranks.{format}"));
                assert!(output.status.success() && told(&output).is_empty(), "{output:?}");
                let found = fs::read(directory.path().join(format!("ranks.{format}"))).unwrap();
                assert!(found == expected, "{name} as {format} by {ranks} ranks of {threads} threads");
            }
        }
    }
}

#[test]
fn rows_scenes_and_a_scene_that_is_sent_are_what_they_are_without_ranks() {
    let directory = tempfile::tempdir().unwrap();
    let [sphere, island] = ["sphere.in", "island.toml"].map(scene);
    for arguments in ["--rows 17..91 --size 200x", "--film 35 --size 100x80", "--engine reference --size 60x50"] {
        let render = format!("render {} {arguments} --quiet", island.display());
        alone(directory.path(), &format!("{render} -o alone.exr"));
        for broadcast in ["", " --broadcast"] {
            let output = run(3, directory.path(), &format!("{render}{broadcast} -o ranks.exr"));
            assert!(output.status.success(), "{output:?}");
            let files = ["alone.exr", "ranks.exr"].map(|name| fs::read(directory.path().join(name)).unwrap());
            assert!(files[0] == files[1], "{arguments}{broadcast}");
        }
    }
    fs::create_dir(directory.path().join("out")).unwrap();
    let output = run(2, directory.path(), &format!("render {} {} -o out", sphere.display(), island.display()));
    assert!(output.status.success(), "{output:?}");
    assert_eq!(told(&output).lines().count(), 2, "each picture is told once: {output:?}");
    assert_eq!(fs::read_dir(directory.path().join("out")).unwrap().count(), 2);
}

#[test]
fn an_error_is_told_once_and_nothing_is_left() {
    let directory = tempfile::tempdir().unwrap();
    let sphere = scene("sphere.in");
    for (arguments, status, message) in [
        ("render no.in -o a.png".to_owned(), 2, "there is no scene file `no.in`"),
        (format!("render {} --engine sse2 -o a.png", sphere.display()), 2, "there is no engine `sse2`"),
        (format!("render {} -o no/a.png", sphere.display()), 1, "there is no directory no"),
        ("render".to_owned(), 2, "required arguments were not provided"),
        ("info".to_owned(), 2, "this command is for one process"),
    ] {
        let output = run(3, directory.path(), &arguments);
        assert_eq!(output.status.code(), Some(status), "{output:?}");
        assert_eq!(told(&output).matches(message).count(), 1, "{output:?}");
        assert_eq!(names(&directory), [""; 0]);
    }
}

/// Where ranks find different files, a shell starts each in a directory of its own.
#[test]
fn a_rank_without_the_scene_or_with_another_is_named() {
    let directory = tempfile::tempdir().unwrap();
    for place in ["0", "1", "2"] {
        fs::create_dir(directory.path().join(place)).unwrap();
    }
    let place = |rank: &str, name: &str| fs::copy(scene(name), directory.path().join(rank).join("a.in")).unwrap();
    place("0", "sphere.in");
    place("1", "sphere.in");
    let render = || {
        let script = format!("cd $OMPI_COMM_WORLD_RANK && exec {} \"$@\"", env!("CARGO_BIN_EXE_rayo"));
        let mut command = Command::new("mpirun");
        command.args(["--oversubscribe", "-n", "3", "sh", "-c", &script, "sh", "render", "a.in", "-o", "a.png"]);
        command.env("OMPI_ALLOW_RUN_AS_ROOT", "1").env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1");
        command.current_dir(directory.path());
        command
    };
    let output = render().output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert!(
        told(&output).contains("error: rank 2 on ") && told(&output).contains("no scene file `a.in`"),
        "{output:?}"
    );
    place("2", "tetrahedron.in");
    let output = render().output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert!(told(&output).contains("rank 2 on ") && told(&output).contains("is another scene here"), "{output:?}");
    assert!(!directory.path().join("0/a.png").exists());
    let output = render().arg("--broadcast").output().unwrap();
    assert!(output.status.success(), "{output:?}");
    assert!(directory.path().join("0/a.png").exists() && !directory.path().join("1/a.png").exists());
}

#[cfg(target_os = "linux")]
#[test]
fn rank_0_holds_a_few_bands_of_a_picture_of_any_size() {
    let directory = tempfile::tempdir().unwrap();
    let sphere = scene("sphere.in");
    let script = format!(
        "if [ $OMPI_COMM_WORLD_RANK = 0 ]; then ulimit -v 1048576; fi; exec {} \"$@\"",
        env!("CARGO_BIN_EXE_rayo")
    );
    // As floats these are 1.2 GB, nearly all of which rank 0 is not allowed to have beside MPI's own address space.
    let mut command = Command::new("mpirun");
    command.args(["--oversubscribe", "-n", "4", "sh", "-c", &script, "sh", "render", sphere.to_str().unwrap()]);
    command.args(["--size", "4000x25000", "--threads", "1", "--quiet", "-o", "a.pfm"]);
    command.env("OMPI_ALLOW_RUN_AS_ROOT", "1").env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1").env("MALLOC_ARENA_MAX", "1");
    let output = command.current_dir(directory.path()).output().unwrap();
    assert!(output.status.success(), "{output:?}");
}
