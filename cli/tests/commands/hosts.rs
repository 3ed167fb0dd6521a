//! Environments that start the program: launchers of MPI ranks, and preloaded libraries that change
//! the floating-point environment.

use std::process::Command;

use crate::program::Run;

/// Runs the program in a folder with these environment variables.
fn start(variables: &[(&str, &str)], arguments: &[&str], folder: &tempfile::TempDir) -> Run {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rayo"));
    command.envs(variables.iter().copied()).env("NO_COLOR", "1").env_remove("RAYO_ENGINE");
    Run::of(command.args(arguments).current_dir(folder).output().unwrap())
}

const BALL: &str = "ball.png 40 30 1   1  1 1 1 1  20 20 0   1  30 1 1 1  0 0 120   0";

#[test]
fn rank_0_says_that_every_rank_does_all_the_work() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("ball.in"), BALL).unwrap();
    let render = |variables: &[(&str, &str)]| {
        let run = start(variables, &["render", "ball.in", "-o", "ball.png", "--quiet"], &folder);
        assert_eq!((run.status, run.stdout.as_str()), (0, ""), "{}", run.stderr);
        run.stderr
    };
    for (size, rank) in [
        ("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK"),
        ("PMI_SIZE", "PMI_RANK"),
        ("SLURM_STEP_NUM_TASKS", "SLURM_PROCID"),
    ] {
        let told = render(&[(size, "4"), (rank, "0")]);
        let expected =
            format!("warning: this is one of 4 processes ({size}), each of which does all the work by itself: ");
        assert!(told.starts_with(&expected) && told.contains("make mpi") && told.lines().count() == 1, "{told}");
        assert_eq!(render(&[(size, "4"), (rank, "3")]), "", "{size}");
        assert_eq!(render(&[(size, "1"), (rank, "0")]), "", "{size}");
    }
}

/// A library that sets MXCSR as an environment variable says, before main and in each new thread.
#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
const LIBRARY: &str = r#"
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <stdlib.h>

__attribute__((constructor)) static void set(void) {
    unsigned control = strtoul(getenv("CONTROL"), 0, 0);
    __asm__ volatile("ldmxcsr %0" : : "m"(control));
}

struct start { void *(*run)(void *); void *argument; };

static void *set_and_run(void *given) {
    struct start start = *(struct start *)given;
    free(given);
    set();
    return start.run(start.argument);
}

int pthread_create(pthread_t *thread, const pthread_attr_t *attributes, void *(*run)(void *), void *argument) {
    int (*create)(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *) = dlsym(RTLD_NEXT, "pthread_create");
    struct start *start = malloc(sizeof *start);
    *start = (struct start){run, argument};
    return create(thread, attributes, set_and_run, start);
}
"#;

#[cfg(all(target_os = "linux", target_arch = "x86_64"))]
#[test]
fn a_preloaded_library_that_sets_arithmetic_changes_no_picture() {
    use rayo::internals::kernels::harness::HostFloats;
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("set.c"), LIBRARY).unwrap();
    std::fs::write(path("ball.in"), BALL).unwrap();
    let roof = "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nv 0.25 1.5 0.25\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\nf 1 3 2\n";
    std::fs::write(path("roof.obj"), roof).unwrap();
    let mut compiler = Command::new("cc");
    let compiled = compiler.args(["-shared", "-fPIC", "set.c", "-o", "set.so", "-ldl"]).current_dir(&folder).status();
    if !compiled.is_ok_and(|status| status.success()) {
        return crate::extent::not_run("cc", "libraries that are loaded before the program, and set its arithmetic");
    }
    let library = path("set.so");
    let run = |control: u32, arguments: &[&str]| {
        let variables = [("LD_PRELOAD", library.to_str().unwrap()), ("CONTROL", &control.to_string())];
        let run = start(&variables, arguments, &folder);
        assert_eq!(run.status, 0, "{arguments:?}: {}", run.stderr);
        run.stdout
    };
    let rendered = |control: u32, arguments: &[&str]| {
        run(control, &[&["render", "-o", "picture.pfm", "--quiet"], arguments].concat());
        std::fs::read(path("picture.pfm")).unwrap()
    };
    // The threads of a pool survey a plan; nearly every operation of theirs is inexact, and would
    // trap.
    let traps_of_inexact_results = 0x0f80;
    assert_eq!(run(traps_of_inexact_results, &["plan", "roof.obj"]), run(0x1f80, &["plan", "roof.obj"]));
    for arguments in [&["ball.in"][..], &["roof.obj", "--shadows", "--samples", "2"], &["ball.in", "--engine", "rust"]]
    {
        let expected = rendered(0x1f80, arguments);
        for host in HostFloats::ALL {
            assert!(rendered(host.control, arguments) == expected, "{arguments:?}, {}", host.name);
        }
    }
}
