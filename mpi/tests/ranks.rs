//! Several ranks write the file of one process, or print an error once and leave no file.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use rayo::{Camera, Engine, Format, Frame, ImageWriter, MovingCamera, Plan, Purpose, Scene, Settings};
use tempfile::TempDir;

/// `rayo-mpi` in a directory, started by MPI as so many ranks. Each rank runs a line of the shell
/// before. There may be more ranks than cores, and the user may be root, as in a container.
fn mpirun_after(line: &str, ranks: usize, directory: &Path) -> Command {
    let script = format!("{line} exec {} \"$@\"", env!("CARGO_BIN_EXE_rayo-mpi"));
    let mut command = Command::new("mpirun");
    // Ends ranks that would wait for each other for ever.
    command.args(["--timeout", "120", "--oversubscribe", "-n", &ranks.to_string(), "sh", "-c", &script, "sh"]);
    command.env("OMPI_ALLOW_RUN_AS_ROOT", "1").env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1");
    command.env_remove("RAYO_ENGINE").current_dir(directory);
    command
}

fn run_after(line: &str, ranks: usize, directory: &Path, arguments: &str) -> Output {
    mpirun_after(line, ranks, directory).args(arguments.split(' ')).output().unwrap()
}

fn run(ranks: usize, directory: &Path, arguments: &str) -> Output {
    run_after("", ranks, directory, arguments)
}

fn scene(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../scenes")).join(name)
}

/// The file that the library writes of a scene, with the plan of `rayo render`.
fn file_of_library(scene: &Scene, path: &Path) -> Vec<u8> {
    let format = Format::from_path(path).unwrap();
    let engine = Engine::fastest();
    let films = engine.format_for(format.is_8bit());
    let purpose = Purpose { format: Some(films), threads: 2, in_bands: true, ..Purpose::default() };
    let plan = Plan::new(engine, scene, purpose).unwrap();
    let frame = Frame::new(plan.tracer(), scene.camera, Settings { threads: 2 }).unwrap();
    let mut image = ImageWriter::create(path, format, scene.camera.width(), scene.camera.height()).unwrap();
    rayo::render_to_file(&frame, &mut image, &|_| ()).unwrap();
    image.finish().unwrap();
    fs::read(path).unwrap()
}

/// The names in a directory, sorted, hidden ones too.
fn names(directory: &TempDir) -> Vec<String> {
    let entries = fs::read_dir(directory.path()).unwrap();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Standard error, which may have lines of mpirun too.
fn told(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn any_number_of_ranks_writes_the_file_of_one_process() {
    let directory = tempfile::tempdir().unwrap();
    for (name, formats) in
        [("sphere.in", &["png", "pgm", "hdr", "qoi"][..]), ("many.in", &["ppm", "pfm", "exr", "tiff"])]
    {
        let path = scene(name);
        let mut seen = rayo::read(&path).unwrap();
        seen.camera = seen.camera.sized(333, 1251).unwrap();
        for format in formats {
            let expected = file_of_library(&seen, &directory.path().join(format!("alone.{format}")));
            for (ranks, threads) in [(1, 2), (2, 1), (4, 2)] {
                let arguments =
                    format!("{} --size 333x1251 --quiet --threads {threads} -o ranks.{format}", path.display());
                let output = run(ranks, directory.path(), &arguments);
                assert!(output.status.success() && told(&output).is_empty(), "{output:?}");
                let found = fs::read(directory.path().join(format!("ranks.{format}"))).unwrap();
                assert!(found == expected, "{name} as {format} by {ranks} ranks of {threads} threads");
            }
        }
    }
}

#[test]
fn options_give_by_ranks_what_they_give_by_one() {
    let directory = tempfile::tempdir().unwrap();
    for arguments in [
        "--rows 17..91 --size 200x",
        "--film 35 --size 100x80",
        "--engine reference --size 24x20",
        "--rows 5..61 --size 90x70 --samples 3 --background 0.1,0.2,0.3 --exposure -1",
        "--rows 31..67 --size 90x70 --samples 2 --edges",
        "--engine rust --size 60x50 --shadows --keep-all --precision single",
    ] {
        let files = [1, 3].map(|ranks| {
            let name = format!("{ranks}.exr");
            let arguments = format!("{} {arguments} --quiet -o {name}", scene("island.toml").display());
            let output = run(ranks, directory.path(), &arguments);
            assert!(output.status.success(), "{output:?}");
            fs::read(directory.path().join(name)).unwrap()
        });
        assert!(files[0] == files[1], "{arguments}");
    }
}

#[test]
fn an_orbit_and_several_scenes_are_pictures_told_once() {
    let directory = tempfile::tempdir().unwrap();
    let [sphere, island] = ["sphere.in", "island.toml"].map(scene);
    for ranks in [1, 3] {
        let arguments = format!("{} --orbit 3 --size 90x70 --quiet -o {ranks}-%d.ppm", island.display());
        let output = run(ranks, directory.path(), &arguments);
        assert!(output.status.success(), "{output:?}");
    }
    let file = |name: String| fs::read(directory.path().join(name)).unwrap();
    for number in 0..3 {
        assert!(file(format!("1-{number}.ppm")) == file(format!("3-{number}.ppm")), "{number}");
    }
    assert!(file("1-0.ppm".into()) != file("1-1.ppm".into()));
    // A mesh alone has a light that the camera carries.
    fs::write(
        directory.path().join("mesh.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
    )
    .unwrap();
    let output = run(2, directory.path(), "mesh.obj --orbit 3 --size 90x70 --quiet -o mesh-%d.ppm");
    assert!(output.status.success(), "{output:?}");
    let camera = Camera::default().sized(90, 70).unwrap();
    let opened = rayo::open(&directory.path().join("mesh.obj"), &camera).unwrap();
    let mut moving = MovingCamera::of(&opened.scene).carrying_light(opened.carried_light);
    let view = opened.scene.orbit(1.0 / 3.0).unwrap();
    let expected = file_of_library(moving.seen_from(view).unwrap(), &directory.path().join("alone.ppm"));
    assert!(file("mesh-1.ppm".into()) == expected, "the mesh is lit otherwise by ranks");
    fs::create_dir(directory.path().join("out")).unwrap();
    let output = run(2, directory.path(), &format!("{} no.in {} -o out", sphere.display(), island.display()));
    assert_eq!(output.status.code(), Some(2), "{output:?}");
    assert_eq!(told(&output).matches(" on 2 ranks").count(), 2, "each picture is told once: {output:?}");
    assert_eq!(told(&output).matches("there is no scene file `no.in`").count(), 1, "{output:?}");
    assert_eq!(fs::read_dir(directory.path().join("out")).unwrap().count(), 2);
}

#[test]
fn an_error_is_told_once_and_nothing_is_left() {
    let directory = tempfile::tempdir().unwrap();
    let sphere = scene("sphere.in");
    for (arguments, status, message) in [
        ("no.in -o a.png".to_owned(), 2, "there is no scene file `no.in`"),
        (format!("{} --engine sse2 -o a.png", sphere.display()), 2, "there is no engine `sse2`"),
        (format!("{} -o no/a.png", sphere.display()), 1, "there is no directory no"),
        (format!("{} --orbit 2 -o a.png", sphere.display()), 2, "give it a number"),
        ("--quiet".to_owned(), 2, "required arguments were not provided"),
    ] {
        let output = run(3, directory.path(), &arguments);
        assert_eq!(output.status.code(), Some(status), "{output:?}");
        assert_eq!(told(&output).matches(message).count(), 1, "{output:?}");
        assert_eq!(names(&directory), [""; 0]);
    }
}

#[test]
fn a_rank_without_the_scene_or_with_another_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let path = |rank: usize, name: &str| directory.path().join(rank.to_string()).join(name);
    let place = |rank: usize, name: &str| fs::copy(scene(name), path(rank, "a.in")).unwrap();
    for rank in 0..3 {
        fs::create_dir(path(rank, "")).unwrap();
    }
    place(0, "sphere.in");
    place(1, "sphere.in");
    let in_places = || run_after("cd $OMPI_COMM_WORLD_RANK;", 3, directory.path(), "a.in -o a.png");
    for (of_rank_2, words) in
        [(None, ["error: rank 2 on ", "a.in"]), (Some("tetrahedron.in"), ["rank 2 on ", "is another scene here"])]
    {
        if let Some(name) = of_rank_2 {
            place(2, name);
        }
        let output = in_places();
        assert_eq!(output.status.code(), Some(1), "{output:?}");
        assert!(words.iter().all(|word| told(&output).contains(word)), "{output:?}");
        assert!(!path(0, "a.png").exists());
    }
    // Only rank 0 writes the picture.
    place(2, "sphere.in");
    let output = in_places();
    assert!(output.status.success(), "{output:?}");
    assert!(path(0, "a.png").exists() && !path(1, "a.png").exists() && !path(2, "a.png").exists());
}

#[test]
fn ranks_are_started_alike() {
    let directory = tempfile::tempdir().unwrap();
    let refused = "rank 1 on ";
    let arguments = format!("{} -o a.png --quiet", scene("sphere.in").display());
    for line in ["export RAYO_ENGINE=rust", "set -- \"$@\" --bogus"] {
        let line = format!("if [ $OMPI_COMM_WORLD_RANK = 1 ]; then {line}; fi;");
        let output = run_after(&line, 2, directory.path(), &arguments);
        assert!(output.status.code() == Some(1) && told(&output).contains(refused), "{output:?}");
        assert!(told(&output).contains("start all alike"), "{output:?}");
        assert_eq!(names(&directory), [""; 0]);
    }
    // Bytes behind its end make the program another file that runs the same.
    let other = directory.path().join("other");
    fs::copy(env!("CARGO_BIN_EXE_rayo-mpi"), &other).unwrap();
    let bytes = [fs::read(&other).unwrap(), b"other".to_vec()].concat();
    fs::write(&other, bytes).unwrap();
    let line = "if [ $OMPI_COMM_WORLD_RANK = 1 ]; then exec ./other \"$@\"; fi;";
    let output = run_after(line, 2, directory.path(), &arguments);
    assert!(told(&output).contains(refused) && told(&output).contains("this is another build"), "{output:?}");
    assert_eq!((output.status.code(), names(&directory)), (Some(1), vec!["other".to_owned()]));
}

/// Arguments of a picture that takes one core some seconds at least.
const LONG: &str = "--size 2000x20000 --engine reference --threads 1 --quiet";

#[test]
fn a_rank_that_is_killed_ends_all_and_leaves_no_file() {
    let directory = tempfile::tempdir().unwrap();
    for victim in 0..3 {
        let line = format!("if [ $OMPI_COMM_WORLD_RANK = {victim} ]; then (sleep 2; kill -KILL $$) & fi;");
        let arguments = format!("{} {LONG} -o a.png", scene("many.in").display());
        let output = run_after(&line, 3, directory.path(), &arguments);
        assert!(!output.status.success() && !told(&output).contains("timeout"), "{output:?}");
        assert_eq!(names(&directory), [""; 0], "rank {victim}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_ends_all_with_its_error() {
    let directory = tempfile::tempdir().unwrap();
    let output = run(3, directory.path(), &format!("{} --size 3000x3000 -o /dev/full", scene("many.in").display()));
    assert!(!output.status.success() && told(&output).contains("error: "), "{output:?}");
    let link = directory.path().join("full.ppm");
    std::os::unix::fs::symlink("/dev/full", &link).unwrap();
    let output = run(3, directory.path(), &format!("{} --size 3000x3000 -o full.ppm", scene("many.in").display()));
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert_eq!(told(&output).matches("error: ").count(), 1, "{output:?}");
    assert!(!told(&output).contains("timeout"), "{output:?}");
}
