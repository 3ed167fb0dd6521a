//! Little memory, few threads, full disks, and signals.

use crate::place::{Place, SCENE, run_into};
use crate::program::{self, in_the_foreground};
use std::fs;

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
fn lack_of_memory_is_told_and_needs_no_other_thread() {
    let place = Place::new();
    let output = place.shell("ulimit -v 500000; rayo make torus --triangles 100000000 -o a.ply");
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1) && told.starts_with("error: there is no memory for "), "{output:?}");
    // A stack size that no thread can get.
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/../scenes/many.in");
    let output = place.shell(&format!("export RUST_MIN_STACK=100000000000000; rayo plan {scene}"));
    assert!(output.status.success(), "{output:?}");
    assert_eq!(place.files(), ["scene.in"]);
    let output = place.shell("export RUST_MIN_STACK=100000000000000; ulimit -s 64; rayo render scene.in -o a.png");
    let told = "error: the stack has less than 1 MiB, and no thread with a larger one can be started (";
    assert!(output.stderr.starts_with(told.as_bytes()) && output.status.code() == Some(1), "{output:?}");
    // An encoder's own thread is optional, too.
    let pictures = ["100000000000000", "2000000"].map(|stack| {
        let render = "rayo render scene.in --force --threads 1 -o a.exr";
        let output = place.shell(&format!("export RUST_MIN_STACK={stack}; {render}"));
        assert!(output.status.success(), "{output:?}");
        std::fs::read(place.path("a.exr")).unwrap()
    });
    assert!(pictures[0] == pictures[1]);
}

#[cfg(target_os = "linux")]
#[test]
fn threads_are_as_many_as_the_system_gives_or_as_asked() {
    let place = Place::new();
    let cores = std::thread::available_parallelism().unwrap().get();
    // Each further thread needs a stack of a gigabyte.
    for (others, threads) in [(0, 1), (1, 2), (3, 4)] {
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
fn picture_larger_than_memory_is_streamed() {
    let place = Place::new();
    let limited = |name: &str, size: &str| {
        let render = format!("rayo render scene.in --threads 1 --quiet --size {size} -o {name}");
        place.shell(&format!("export MALLOC_ARENA_MAX=1; ulimit -v 163840; {render}"))
    };
    // As floats these pictures have 205 MB; the address space is limited to 160 MiB.
    for name in ["a.png", "a.ppm", "a.pgm", "a.pfm", "a.exr"] {
        let output = limited(name, "4000x3200");
        assert!(output.status.success(), "{name}: {output:?}");
        fs::remove_file(place.path(name)).unwrap();
    }
    // Formats that hold the whole picture, here at least 192 MB, show that the limit works; and
    // pictures beyond a format's own limit are not begun.
    for (name, needed) in [("a.qoi", 1144), ("a.tiff", 1144), ("a.hdr", 4577)] {
        let output = limited(name, "8000x8000");
        assert_eq!(output.status.code(), Some(1), "{name}: {output:?}");
        let whole = place.run(&format!("render scene.in --size 20000x20000 -o {name}"));
        let told = format!("takes {needed} MiB of memory in this format");
        assert!(whole.status == 2 && whole.stderr.contains(&told), "{}", whole.stderr);
    }
    assert_eq!(place.files(), ["scene.in"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_disk_that_fills_up_is_told_and_leaves_nothing() {
    let place = Place::new();
    place.write("scene.in", &rayo::internals::scene::many(300, 300, 1).to_text());
    let names = ["a.png", "a.ppm", "a.pgm", "a.pfm", "a.hdr", "a.tiff", "a.exr", "a.qoi"];
    let renders = names.map(|name| (name, format!("render scene.in --size 800x600 -o {name}")));
    let others =
        [("a.obj", "make torus --triangles 100000 -o a.obj".into()), ("a.toml", "convert scene.in a.toml".into())];
    for (name, command) in renders.into_iter().chain(others) {
        // Files are limited to 64 blocks of 512 bytes.
        let output = place.shell(&format!("ulimit -f 64; rayo {command} --quiet"));
        let told = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{name}: {told}");
        let expected = format!("error: cannot write {name}: File too large");
        assert!(told.starts_with(&expected) && told.lines().count() == 1, "{name}: {told}");
        assert_eq!(place.files(), ["scene.in"], "{name}");
    }
}

#[cfg(all(feature = "asm", target_arch = "x86_64", target_os = "linux"))]
#[test]
fn experiment_that_cannot_start_names_likely_limits() {
    let place = Place::new();
    let run = |files| place.shell(&format!("ulimit -n {files}; rayo experiment --quick --runs 1 --out a"));
    // With fewer files allowed it cannot listen for signals or test the directory.
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
    use std::os::unix::process::ExitStatusExt;

    let place = Place::new();
    place.write("many.in", &rayo::internals::scene::many(300, 300, 1).to_text());
    // No handler is installed: the file has no name, and vanishes with the process.
    for (signal, number) in [("INT", 2), ("TERM", 15), ("KILL", 9)] {
        for name in ["a.png", "a.exr"] {
            // A picture that takes minutes.
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
            // From now on the signal may arrive at any time.
            std::thread::sleep(std::time::Duration::from_millis(60));
            assert!(program::signal(signal, child.id()));
            assert_eq!(child.wait().unwrap().signal(), Some(number), "{signal}");
            assert_eq!(place.files(), ["many.in", "scene.in"], "{signal}");
        }
    }
}
