//! Several ranks: the file of one process, or an error that is told once and no file.
#![cfg(feature = "mpi")]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use rayo::scene::Rng;
use serde_json::{Map, Value};
use tempfile::TempDir;

/// `rayo` in a directory, started by MPI as so many ranks, each after a line of the shell; on few cores and, as in a container, as
/// root too.
fn mpirun_after(line: &str, ranks: usize, directory: &Path) -> Command {
    let script = format!("{line} exec {} \"$@\"", env!("CARGO_BIN_EXE_rayo"));
    let mut command = Command::new("mpirun");
    // Ranks that wait for each other for ever are ended.
    command.args(["--timeout", "300", "--oversubscribe", "-n", &ranks.to_string(), "sh", "-c", &script, "sh"]);
    command.env("OMPI_ALLOW_RUN_AS_ROOT", "1").env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1");
    command.env("NO_COLOR", "1").env_remove("RAYO_ENGINE").current_dir(directory);
    command
}

fn mpirun(ranks: usize, directory: &Path) -> Command {
    mpirun_after("", ranks, directory)
}

/// Ranks that find different files: each is in a directory of its own, which has its number.
fn in_places(ranks: usize, directory: &Path) -> Command {
    mpirun_after("cd $OMPI_COMM_WORLD_RANK;", ranks, directory)
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
    for arguments in [
        "--rows 17..91 --size 200x",
        "--film 35 --size 100x80",
        "--engine reference --size 60x50",
        "--rows 5..61 --size 90x70 --samples 3 --background 0.1,0.2,0.3 --exposure -1",
        "--rows 31..67 --size 90x70 --samples 2 --edges",
        "--engine rust --size 60x50 --shadows",
    ] {
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
    // Rank 0 alone knows what it has written.
    let output = run(2, directory.path(), &format!("render {0} {0} -o out", sphere.display()));
    assert_eq!((output.status.code(), told(&output).matches("as is that of a scene before it").count()), (Some(2), 1));
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
    let with = |arguments: &str| {
        let mut command = in_places(3, directory.path());
        command.args(arguments.split(' '));
        command
    };
    for (arguments, made) in [("accuracy a.in --quick", "out"), ("render a.in -o a.png", "a.png")] {
        for (of_rank_2, words) in
            [(None, ["error: rank 2 on ", "a.in"]), (Some("tetrahedron.in"), ["rank 2 on ", "is another scene here"])]
        {
            of_rank_2.map(|name| place(2, name));
            let output = with(arguments).output().unwrap();
            assert_eq!(output.status.code(), Some(1), "{output:?}");
            assert!(words.iter().all(|word| told(&output).contains(word)), "{output:?}");
            assert!(!path(0, made).exists(), "{arguments}");
        }
        fs::remove_file(path(2, "a.in")).unwrap();
    }
    // With another name it would be another format.
    let renamed = fs::read_to_string(scene("sphere.in")).unwrap().replace("sphere.png", "sphere.exr");
    fs::write(path(2, "a.in"), renamed).unwrap();
    let output = with("render a.in").output().unwrap();
    assert!(told(&output).contains("rank 2 on ") && told(&output).contains("is another scene here"), "{output:?}");
    fs::remove_file(path(2, "a.in")).unwrap();
    // What stands in the way of rank 0's file, stands in nobody else's.
    std::os::unix::fs::symlink("a.in", path(1, "a.png")).unwrap();
    let output = with("render a.in -o a.png --broadcast").output().unwrap();
    assert!(output.status.success(), "{output:?}");
    assert!(path(0, "a.png").exists() && !path(2, "a.png").exists());
    assert_eq!(fs::read(path(1, "a.png")).unwrap(), fs::read(scene("sphere.in")).unwrap());
    // Nor need the others have the directory of the pictures.
    fs::create_dir(path(0, "out")).unwrap();
    fs::copy(scene("sphere.in"), path(0, "b.in")).unwrap();
    fs::write(path(0, "b.in"), fs::read_to_string(path(0, "b.in")).unwrap().replace("sphere.png", "b.png")).unwrap();
    let output = with("render a.in b.in -o out --broadcast").output().unwrap();
    assert!(output.status.success(), "{output:?}");
    assert!(path(0, "out/sphere.png").exists() && path(0, "out/b.png").exists() && !path(1, "out").exists());
}

#[test]
fn ranks_are_started_alike() {
    let directory = tempfile::tempdir().unwrap();
    let refused = ": this was started with other arguments, or another RAYO_ENGINE, than rank 0: start all alike";
    for engine in ["rust", ""] {
        for rank in 0..2 {
            let line = format!("if [ $OMPI_COMM_WORLD_RANK = {rank} ]; then export RAYO_ENGINE={engine}; fi;");
            let mut command = mpirun_after(&line, 2, directory.path());
            command.args(["render", scene("sphere.in").to_str().unwrap(), "-o", "a.png", "--quiet"]);
            let output = command.output().unwrap();
            // An empty one is none.
            let status = i32::from(!engine.is_empty());
            assert_eq!((output.status.code(), told(&output).contains(refused)), (Some(status), status == 1));
            assert_eq!(names(&directory), ["a.png"][..1 - status as usize]);
            if status == 0 {
                fs::remove_file(directory.path().join("a.png")).unwrap();
            }
        }
    }
    let line = "if [ $OMPI_COMM_WORLD_RANK = 1 ]; then set -- \"$@\" --bogus; fi;";
    let mut command = mpirun_after(line, 2, directory.path());
    let output = command.args(["render", scene("sphere.in").to_str().unwrap()]).output().unwrap();
    assert!(output.status.code() == Some(1) && told(&output).contains(refused), "{output:?}");
}

#[test]
fn ranks_that_can_start_no_thread_do_the_work_themselves() {
    let directory = tempfile::tempdir().unwrap();
    let island = scene("island.toml");
    alone(directory.path(), &format!("render {} --size 300x200 -o alone.png", island.display()));
    for who in ["true", "[ $OMPI_COMM_WORLD_RANK = 1 ]", "[ $OMPI_COMM_WORLD_RANK = 0 ]"] {
        let no_thread = format!("if {who}; then export RUST_MIN_STACK=100000000000000; fi;");
        let mut command = mpirun_after(&no_thread, 3, directory.path());
        command.args(["render", island.to_str().unwrap(), "--size", "300x200", "-o", "a.png"]);
        let output = command.output().unwrap();
        assert!(output.status.success(), "{output:?}");
        let file = |name| fs::read(directory.path().join(name)).unwrap();
        assert!(file("a.png") == file("alone.png"), "{who}");
    }
}

/// Ranks that [`watched`] has started, and their directory.
#[cfg(target_os = "linux")]
struct Started {
    mpirun: Child,
    directory: TempDir,
}

/// Ranks that render to `out`, each of which first writes its process's number into `ids`.
#[cfg(target_os = "linux")]
fn watched(ranks: usize, arguments: &str) -> Started {
    let directory = tempfile::tempdir().unwrap();
    fs::create_dir_all(directory.path().join("out")).unwrap();
    fs::create_dir_all(directory.path().join("ids")).unwrap();
    let mut command = mpirun_after("echo $$ >ids/$OMPI_COMM_WORLD_RANK;", ranks, directory.path());
    command.args(arguments.split(' '));
    let mpirun = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    Started { mpirun, directory }
}

#[cfg(target_os = "linux")]
impl Started {
    /// What a test waits for fails it after so long.
    const LIMIT: Duration = Duration::from_secs(60);

    fn wait<T>(&mut self, what: &str, mut there: impl FnMut(&mut Self) -> Option<T>) -> T {
        let start = Instant::now();
        loop {
            if let Some(found) = there(self) {
                return found;
            }
            if start.elapsed() > Self::LIMIT {
                self.mpirun.kill().unwrap();
                panic!("waited {:?} for {what}; there is {:?}", Self::LIMIT, self.written());
            }
            sleep(Duration::from_millis(1));
        }
    }

    /// The process of a rank.
    fn id(&self, rank: usize) -> String {
        fs::read_to_string(self.directory.path().join(format!("ids/{rank}"))).unwrap().trim().to_owned()
    }

    /// What is in the directory of the picture, hidden files too.
    fn written(&self) -> Vec<String> {
        let entries = fs::read_dir(self.directory.path().join("out")).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    /// Whether rank 0 has the picture's file open, which has no name until it is whole.
    fn is_writing(&self) -> bool {
        let place = self.directory.path().canonicalize().unwrap();
        let Ok(id) = fs::read_to_string(place.join("ids/0")) else { return false };
        let open = fs::read_dir(format!("/proc/{}/fd", id.trim())).into_iter().flatten().flatten();
        open.filter_map(|entry| fs::read_link(entry.path()).ok()).any(|file| file.starts_with(place.join("out")))
    }

    /// Waits until the picture is begun: MPI is ready by then, and the picture is not.
    fn wait_for_the_beginning(&mut self) {
        self.wait("the picture to be begun", |started| started.is_writing().then_some(()));
    }

    fn wait_for_the_end(&mut self) -> ExitStatus {
        self.wait("mpirun to end", |started| started.mpirun.try_wait().unwrap())
    }
}

#[cfg(target_os = "linux")]
fn signal(name: &str, process: &str) {
    // Who has ended in the meantime needs no signal.
    Command::new("sh").args(["-c", "kill -s \"$0\" \"$1\"", name, process]).stderr(Stdio::null()).status().unwrap();
}

/// A picture that two cores work on for a second or so.
#[cfg(target_os = "linux")]
const LONG: &str = "--size 2000x6000 --engine reference --threads 1 --quiet -o out/a.png";

#[cfg(target_os = "linux")]
#[test]
fn a_rank_that_is_killed_at_any_moment_leaves_no_part_of_a_picture() {
    let render = format!("render {} {LONG}", scene("sphere.in").display());
    let mut whole = watched(3, &render);
    let start = Instant::now();
    assert!(whole.wait_for_the_end().success());
    let time = start.elapsed();
    let expected = fs::read(whole.directory.path().join("out/a.png")).unwrap();
    let seed = 1;
    println!("seed {seed}");
    let mut rng = Rng::new(seed);
    let mut unfinished = 0;
    for attempt in 0..50 {
        let mut ranks = watched(3, &render);
        ranks.wait_for_the_beginning();
        // Moments all over the picture, most of them near its beginning, each rank in turn.
        sleep(time.mul_f64(f64::from(rng.next_f32()).powi(3)));
        signal("KILL", &ranks.id(attempt % 3));
        let status = ranks.wait_for_the_end();
        match &ranks.written()[..] {
            [] => {
                assert!(!status.success(), "attempt {attempt}");
                unfinished += 1;
            }
            [name] if name == "a.png" => {
                let found = fs::read(ranks.directory.path().join("out/a.png")).unwrap();
                assert!(found == expected, "attempt {attempt}: a part of the picture");
            }
            names => panic!("attempt {attempt} left {names:?}"),
        }
    }
    assert!(unfinished > 10, "the picture is too small: {unfinished} were killed before the end");
}

#[cfg(target_os = "linux")]
#[test]
fn ctrl_c_ends_all_ranks_and_leaves_nothing() {
    for name in ["INT", "TERM"] {
        // Nobody waits for its end, which has to be far even where mpirun takes its time.
        let long = LONG.replace("6000", "200000");
        let mut ranks = watched(3, &format!("render {} {long}", scene("sphere.in").display()));
        ranks.wait_for_the_beginning();
        signal(name, &ranks.mpirun.id().to_string());
        assert!(!ranks.wait_for_the_end().success());
        assert_eq!(ranks.written(), [""; 0], "{name}");
        for rank in 0..3 {
            let process = format!("/proc/{}", ranks.id(rank));
            ranks.wait("the ranks to end", |_| (!Path::new(&process).exists()).then_some(()));
        }
    }
}

/// A document of times, without them: a word in the place of each, and of what is made of them.
fn without_times(document: Value) -> Value {
    // In these units, or made of times.
    let is_time = |name: &str| {
        let units = ["_hz", "_ns", "ns_per_ray", "ns_per_ray_median"].iter().any(|unit| name.ends_with(unit));
        let made = "date spread front off_every_front ratio slowdown runs samples line";
        units || name.contains("cycles") || made.split(' ').any(|word| word == name)
    };
    match document {
        Value::Object(fields) => {
            let without = |(name, value): (String, Value)| {
                let value = if is_time(&name) && !value.is_null() { "a time".into() } else { without_times(value) };
                (name, value)
            };
            fields.into_iter().map(without).collect::<Map<_, _>>().into()
        }
        Value::Array(values) => values.into_iter().map(without_times).collect::<Vec<_>>().into(),
        other => other,
    }
}

#[test]
fn ranks_that_share_what_is_measured_write_the_rows_of_one_process_in_its_order() {
    let directory = tempfile::tempdir().unwrap();
    let [sphere, tetrahedron] = ["sphere.in", "tetrahedron.in"].map(scene);
    let accuracy = format!("accuracy {} {} --quick", sphere.display(), tetrahedron.display());
    for (command, rows, figures) in [
        (&accuracy[..], 20, None),
        ("stability --family S1 --quick", 5, Some("limits.csv")),
        ("experiment --complexity --quick --runs 1", 20, None),
    ] {
        let measured = [1, 2].map(|ranks| {
            let output = run(ranks, directory.path(), &format!("{command} --json --out {ranks}"));
            assert!(output.status.success() && told(&output).is_empty(), "{output:?}");
            let document = without_times(serde_json::from_slice(&output.stdout).unwrap());
            let figures =
                figures.map(|name| fs::read_to_string(directory.path().join(ranks.to_string()).join(name)).unwrap());
            (document, figures)
        });
        let [alone, ranks] = measured;
        assert!(alone.0["rows"].as_array().unwrap().len() >= rows, "{command}: {alone:?}");
        assert_eq!(alone.0["complete"], true, "{command}");
        assert_eq!(alone, ranks, "{command}");
    }
}

#[cfg(rayo_asm)]
#[test]
fn another_build_among_the_ranks_is_named() {
    let directory = tempfile::tempdir().unwrap();
    // Of another build, the hash of the kernels is another.
    let hash = env!("RAYO_KERNELS").as_bytes();
    let mut other = fs::read(env!("CARGO_BIN_EXE_rayo")).unwrap();
    let mut places: Vec<usize> = Vec::new();
    places.extend(other.windows(hash.len()).enumerate().filter(|(_, bytes)| *bytes == hash).map(|(place, _)| place));
    assert!(!places.is_empty());
    for place in places {
        other[place..place + hash.len()].fill(b'x');
    }
    let path = directory.path().join("other");
    fs::write(&path, other).unwrap();
    fs::set_permissions(&path, fs::metadata(env!("CARGO_BIN_EXE_rayo")).unwrap().permissions()).unwrap();
    let scene = scene("sphere.in");
    let render = ["render", scene.to_str().unwrap(), "-o", "a.png"];
    let mut command = mpirun(1, directory.path());
    command.args(render).args([":", "-n", "1"]).arg(&path).args(render);
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    let told = told(&output);
    assert!(told.contains("rank 1 on ") && told.contains("this is another build of rayo"), "{told}");
    assert!(told.contains("xxxxxxxx") && told.contains(env!("RAYO_KERNELS")), "both are named: {told}");
    assert_eq!(names(&directory), ["other"]);
}

/// Standard output of a rank is a terminal of mpirun's, which says here whose each line is.
#[test]
fn rank_0_alone_shows_how_far_all_are() {
    let directory = tempfile::tempdir().unwrap();
    let shown = |arguments: &str| {
        let mut command = Command::new("mpirun");
        command.args(["--oversubscribe", "--tag-output", "-n", "3", env!("CARGO_BIN_EXE_rayo")]);
        command.args(arguments.split(' '));
        command.env("OMPI_ALLOW_RUN_AS_ROOT", "1").env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1").env("TERM", "xterm");
        let output = command.current_dir(directory.path()).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        let shown = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(!shown.contains("[1,1]") && !shown.contains("[1,2]"), "{shown}");
        shown
    };
    // Hundreds of objects asked one by one take seconds on any machine, and a bar comes after one.
    let slow = format!("render {} --size 1000x600 --engine reference", scene("many.in").display());
    let rendered = shown(&format!("{slow} --threads 1 -o a.png"));
    assert!(rendered.contains("[1,0]<stdout>") && rendered.contains("/600 rows"), "{rendered}");
    let measured = shown(&format!("accuracy {} --quick", scene("sphere.in").display()));
    assert!(measured.contains(" %, ") && measured.contains(" left"), "{measured}");
}

#[cfg(target_os = "linux")]
#[test]
fn rank_0_holds_a_few_bands_of_a_picture_of_any_size() {
    // As bytes these are 1.2 GB, and as floats four times as much.
    let arguments = "--size 20000x20000 --threads 1 --quiet -o out/a.png";
    let mut ranks = watched(4, &format!("render {} {arguments}", scene("sphere.in").display()));
    ranks.wait_for_the_beginning();
    let status = format!("/proc/{}/status", ranks.id(0));
    let (mut looks, mut peak) = (0, 0);
    let ended = ranks.wait("mpirun to end", |ranks| {
        // The most that it has ever had, in KiB.
        let text = fs::read_to_string(&status).unwrap_or_default();
        let line = text.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        if let Some(most) = line.and_then(|line| line.trim().strip_suffix(" kB")?.parse::<u64>().ok()) {
            (looks, peak) = (looks + 1, most);
        }
        ranks.mpirun.try_wait().unwrap()
    });
    assert!(ended.success() && ranks.written() == ["a.png"]);
    assert!(looks > 10 && peak < 256 << 10, "{peak} KiB in {looks} looks");
}
