//! `rayo try`: kernels that are right, and wrong in many ways, each with its verdict.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::extent;
use crate::program::{Run, rayo};

/// A kernel of `cli/tests/kernels`, and what is to be said of it.
struct Kernel {
    file: &'static str,
    result: &'static str,
    /// Words of every check that does not hold, in the order of [`complaints`], and of no other.
    faults: &'static [&'static str],
}

const fn kernel(file: &'static str, result: &'static str, faults: &'static [&'static str]) -> Kernel {
    Kernel { file, result, faults }
}

const SAME: &str = "same bits";
const ORDER: &str = "another order";
const WRONG: &str = "wrong";
const NONE: &str = "none";

const KERNELS: [Kernel; 65] = [
    // Right ones.
    kernel("dot_three_shuffles.asm", SAME, &[]),
    kernel("dot_best.asm", SAME, &[]),
    kernel("dot_dpps.asm", SAME, &[]),
    kernel("dot_unaligned.asm", SAME, &[]),
    kernel("dot_saves_rbx.asm", SAME, &[]),
    kernel("dot_red_zone.asm", SAME, &[]),
    kernel("dot_called.asm", SAME, &[]),
    kernel("dot_by_value.c", SAME, &[]),
    kernel("dot_att.s", SAME, &[]),
    kernel("dot_prints.c", SAME, &[]),
    kernel("add_drops_w.asm", SAME, &[]),
    kernel("dot_other_order.asm", ORDER, &[]),
    kernel("dot_fma.asm", ORDER, &[]),
    kernel("dot_in_double.c", ORDER, &[]),
    kernel("normalise_by_reciprocal.asm", ORDER, &[]),
    // They keep the calling convention, and return other numbers.
    kernel("dot_one_haddps.asm", WRONG, &["result"]),
    kernel("dot_no_haddps.asm", WRONG, &["result"]),
    kernel("dot_wrong_lane.asm", WRONG, &["result"]),
    kernel("dot_of_a_and_a.asm", WRONG, &["result"]),
    kernel("dot_adds_one.asm", WRONG, &["result"]),
    kernel("dot_by_integers.asm", WRONG, &["result"]),
    kernel("dot_not_written.asm", WRONG, &["result", "aliasing: a different result"]),
    kernel("dot_stale.asm", WRONG, &["result", "aliasing: a different result"]),
    kernel("norm_estimate.asm", WRONG, &["result"]),
    kernel("norm_not_rooted.asm", WRONG, &["result"]),
    kernel("add_three_lanes.asm", WRONG, &["result", "aliasing: a different result"]),
    kernel("add_junk_in_w.asm", WRONG, &["result"]),
    kernel("sub_backwards.asm", WRONG, &["result"]),
    kernel("cross_sign.asm", WRONG, &["result"]),
    kernel("scale_one_lane.asm", WRONG, &["result"]),
    kernel("dot_no_root_below_zero.asm", WRONG, &["result"]),
    kernel("dot_some_w.asm", SAME, &["fourth lane"]),
    kernel("dot_no_nan.asm", ORDER, &["odd", "fourth lane"]),
    kernel("dot_no_denormals.asm", ORDER, &["odd", "fourth lane"]),
    // The calling convention.
    kernel("dot_rbx.asm", SAME, &["convention: rbx is not preserved (dot_rbx.asm:8)"]),
    kernel(
        "dot_r12_r15.asm",
        SAME,
        &[
            "convention: r12 is not preserved (dot_r12_r15.asm:7)",
            "convention: r15 is not preserved (dot_r12_r15.asm:8)",
        ],
    ),
    kernel("dot_rbp.asm", SAME, &["convention: rbp is not preserved (dot_rbp.asm:7)"]),
    kernel("dot_rsp.asm", SAME, &["convention: rsp is not as it was at the call (dot_rsp.asm:14)"]),
    kernel("dot_stack.asm", SAME, &["convention: the caller's stack frame is overwritten (dot_stack.asm:13)"]),
    kernel("dot_direction.asm", SAME, &["convention: the direction flag is left set (dot_direction.asm:13)"]),
    kernel("dot_mxcsr.asm", SAME, &["convention: the control bits of MXCSR are changed (dot_mxcsr.asm:15)"]),
    kernel("dot_upper.asm", SAME, &["convention: the upper parts of vector registers are left dirty"]),
    kernel("dot_below_the_red_zone.asm", SAME, &["convention: it keeps data more than 128 bytes under rsp"]),
    kernel("dot_jumps_below_the_red_zone.asm", SAME, &["convention: it keeps data more than 128 bytes under rsp"]),
    kernel("dot_signals.c", SAME, &["convention: it changes what signals do: 11"]),
    // Memory.
    kernel("dot_reads_32.asm", SAME, &["memory: reads 32 bytes of a, which has 16 (dot_reads_32.asm:7)"]),
    kernel(
        "dot_writes_16.asm",
        SAME,
        &["memory: writes beside its result: 1 byte after", "memory: writes 16 bytes of its result, which has 4"],
    ),
    kernel(
        "dot_aligned_store.asm",
        SAME,
        &["memory: writes beside its result", "memory: writes 16 bytes of its result, which has 4"],
    ),
    kernel(
        "dot_one_byte_beyond.asm",
        SAME,
        &["memory: writes beside its result", "memory: writes 1 byte from byte 4 of its result, which has 4"],
    ),
    kernel("dot_reads_before.asm", SAME, &["memory: reads 4 bytes from 4 bytes before a (dot_reads_before.asm:9)"]),
    kernel("dot_writes_a.asm", SAME, &["memory: writes over its argument a"]),
    kernel("norm_reads_b.asm", SAME, &["memory: reads b, which `norm` is not given (norm_reads_b.asm:8)"]),
    kernel("cross_writes_early.asm", SAME, &["aliasing: a different result where it lies in the place of a"]),
    kernel(
        "sub_crashes_in_place.asm",
        SAME,
        &["aliasing: crashes where it lies in the place of a: SIGILL, an instruction that this CPU does not have"],
    ),
    kernel("cross_aliased.c", SAME, &["aliasing: a different result where it lies in the place of a"]),
    // Those that do not come back.
    kernel("dot_address.asm", NONE, &["crash: SIGSEGV, an access to memory (dot_address.asm:9)"]),
    kernel("dot_instruction.asm", NONE, &["crash: SIGILL, an instruction that this CPU does not have"]),
    kernel("dot_division.asm", NONE, &["crash: SIGFPE, an exception in arithmetic (dot_division.asm:9)"]),
    kernel("dot_loop.asm", NONE, &["crash: no answer"]),
    kernel("dot_recursion.asm", NONE, &["crash: SIGSEGV: the stack is full"]),
    kernel("dot_own_code.asm", NONE, &["crash: SIGSEGV, an access to memory (dot_own_code.asm:8)"]),
    kernel("dot_smashes_stack.asm", NONE, &["crash: it kills the process"]),
    kernel("dot_exit.asm", NONE, &["crash: it ends the process, with exit status 0"]),
    kernel("dot_fork.asm", NONE, &["crash: it starts a copy of the process"]),
    // More than one at once.
    kernel("dot_wrong_and_rbx.asm", WRONG, &["result", "convention: rbx is not preserved (dot_wrong_and_rbx.asm:8)"]),
];

/// Those of instructions that not every CPU has.
const OF_AVX: [&str; 3] = ["dot_fma.asm", "dot_upper.asm", "dot_reads_32.asm"];

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/kernels")
}

/// The words for the result of a file.
fn result_of(verdict: &Value) -> &'static str {
    match (&verdict["result"]["holds"], &verdict["result"]["same_bits"]) {
        (Value::Bool(true), Value::String(_)) => SAME,
        (Value::Bool(true), _) => ORDER,
        (Value::Bool(false), _) => WRONG,
        _ => NONE,
    }
}

/// A fault, with the line that it is of.
fn with_line(check: &str, words: &str, line: &Value) -> String {
    match line["file"].as_str() {
        Some(file) => format!("{check}: {words} ({file}:{})", line["line"]),
        None => format!("{check}: {words}"),
    }
}

/// What does not hold of a file; of wrong results, not what follows from them.
fn complaints(verdict: &Value) -> Vec<String> {
    let fails = |check: &str| verdict[check]["holds"] == false;
    let mut found = Vec::new();
    if fails("result") {
        found.push("result".to_owned());
    } else {
        let others = [("odd", "odd"), ("fourth_lane", "fourth lane")];
        found.extend(others.iter().filter(|(check, _)| fails(check)).map(|(_, name)| (*name).to_owned()));
    }
    for check in ["aliasing", "convention", "memory"] {
        let faults = verdict[check]["faults"].as_array().unwrap();
        assert_eq!(fails(check), !faults.is_empty(), "{check} of {}", verdict["file"]);
        found.extend(faults.iter().map(|fault| with_line(check, fault["rule"].as_str().unwrap(), &fault["line"])));
    }
    if let Some(what) = verdict["crash"]["what"].as_str() {
        found.push(with_line("crash", what, &verdict["crash"]["line"]));
    }
    // In the place of b as of a.
    found.dedup_by_key(|words| if words.starts_with("aliasing") { "aliasing".to_owned() } else { words.clone() });
    found
}

fn run(arguments: &[&str]) -> Run {
    rayo([&["try"], arguments].concat(), &folder())
}

#[test]
fn every_kernel_gets_the_verdict_that_it_deserves() {
    let is_usable = |kernel: &&Kernel| {
        !OF_AVX.contains(&kernel.file) || std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma")
    };
    let kernels: Vec<_> = extent::sampled(&KERNELS, 3).filter(is_usable).collect();
    let mut arguments: Vec<_> = kernels.iter().map(|kernel| kernel.file).collect();
    arguments.extend(["--check", "--timeout", "2", "--json"]);
    let tried = run(&arguments);
    let document = tried.document();
    let files = document["files"].as_array().unwrap();
    assert_eq!((document["schema"].as_u64(), files.len()), (Some(1), kernels.len()));
    for (verdict, kernel) in files.iter().zip(&kernels) {
        assert_eq!(verdict["file"], kernel.file);
        let found = complaints(verdict);
        assert_eq!(result_of(verdict), kernel.result, "{}: {found:?}", kernel.file);
        let matches = found.len() == kernel.faults.len()
            && found.iter().zip(kernel.faults).all(|(found, expected)| found.starts_with(expected));
        assert!(matches, "{}: {found:?}", kernel.file);
        assert_eq!(verdict["holds"], kernel.faults.is_empty(), "{}", kernel.file);
    }
}

#[test]
fn every_file_beside_these_tests_is_tried() {
    let tried: BTreeSet<_> = KERNELS.iter().map(|kernel| kernel.file.to_owned()).collect();
    let names = fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    // What rustc makes takes a second or two: it has a test of its own.
    let there: BTreeSet<_> = names.filter(|name| !name.ends_with(".rs")).collect();
    assert_eq!(there, tried);
}

#[test]
fn the_smallest_wrong_input_is_told_lane_by_lane() {
    let tried = run(&["dot_one_haddps.asm", "--check"]);
    assert_eq!(tried.status, 1);
    let text = &tried.stdout;
    assert!(text.contains("dot_one_haddps.asm: dot\n  result        wrong: "), "{text}");
    assert!(text.contains("a         0.0, 0.0, 1.0, 0.0\n"), "{text}");
    assert!(text.contains("result    expected 1.0, got 0.0  <- wrong\n"), "{text}");
    assert!(text.contains("not timed: nothing is worth the cycles of a wrong result"), "{text}");
}

#[test]
fn same_seed_gives_the_same_verdict() {
    let check = |seed: &str| run(&["dot_other_order.asm", "--check", "--json", "--seed", seed]).document();
    assert_eq!(check("5"), check("5"));
    assert_ne!(check("5")["result"]["max_ulp"], check("6")["result"]["max_ulp"]);
    let timed = run(&["dot_three_shuffles.asm", "--json"]);
    assert_eq!(timed.status, 0, "{}", timed.stderr);
    let verdict = timed.document();
    for check in ["result", "convention", "memory", "instructions", "cycles", "proof"] {
        assert_eq!(verdict[check]["holds"], true, "{check}: {verdict}");
    }
    let too_many =
        run(&["dot_three_shuffles.asm", "--check", "--json", "--require", "body=1,instructions=8"]).document();
    assert_eq!((&too_many["instructions"]["holds"], &too_many["cycles"]["holds"]), (&false.into(), &Value::Null));
    let counts = &verdict["instructions"];
    assert_eq!((&counts["function"], &counts["executed"]), (&9.into(), &9.into()), "{counts}");
    for implementation in ["paper", "aos", "c-O3", "glam"] {
        assert!(verdict["against"][implementation]["executed"].as_u64() > Some(1), "{implementation}: {verdict}");
    }
    assert_eq!(verdict["against"]["paper"]["function"], 8);
}

#[test]
fn a_requirement_is_what_the_exit_status_asks() {
    for (file, requirements, status) in [
        ("dot_other_order.asm", "result,convention,memory", 0),
        ("dot_other_order.asm", "same-bits", 1),
        ("dot_other_order.asm", "ulp=4", 0),
        ("dot_other_order.asm", "ulp=0.5", 1),
        ("dot_no_root_below_zero.asm", "ulp=1000", 1),
        ("dot_rbx.asm", "same-bits,memory", 0),
        ("dot_rbx.asm", "convention", 1),
        ("dot_three_shuffles.asm", "instructions=9,executed=9", 0),
        ("dot_three_shuffles.asm", "instructions=8", 1),
        ("dot_address.asm", "convention", 1),
    ] {
        let tried = run(&[file, "--check", "--require", requirements]);
        assert_eq!(tried.status, status, "{file} {requirements}: {}{}", tried.stdout, tried.stderr);
    }
    run(&["dot_rbx.asm", "--require", "bits"]).refuses("expected one of result, same-bits");
    run(&["dot_rbx.asm", "--require", "ulp"]).refuses("`ulp` needs a number, as in ulp=2");
}

#[test]
fn several_files_are_a_table_with_the_best_first() {
    let tried = run(&["dot_rbx.asm", "dot_one_haddps.asm", "dot_best.asm", "--check"]);
    assert_eq!(tried.status, 1);
    let files: Vec<_> = tried.stdout.lines().filter_map(|line| line.split_whitespace().nth(1)).collect();
    assert_eq!(&files[1..2], ["dot_best.asm"], "{}", tried.stdout);
    assert!(tried.stdout.contains("the calling convention"), "{}", tried.stdout);
    let with_none = run(&["dot_best.asm", "missing.asm", "--check"]);
    assert!(
        with_none.status == 2 && with_none.stderr.contains("error: cannot read missing.asm"),
        "{}",
        with_none.stderr
    );
    assert!(with_none.stdout.contains("dot_best.asm") && with_none.stdout.contains("unusable"), "{}", with_none.stdout);
}

#[test]
fn a_formula_is_the_truth_of_an_operation_of_ones_own() {
    let files = tempfile::tempdir().unwrap();
    let reflect = "void reflect(float *out, const float *a, const float *b)\n{\n    float d = 2 * (a[0] * b[0] + a[1] * b[1] \
                   + a[2] * b[2] + a[3] * b[3]), r[4];\n    for (int i = 0; i < 4; i++) r[i] = a[i] - d * b[i];\n    for \
                   (int i = 0; i < 4; i++) out[i] = r[i];\n}\n";
    fs::write(files.path().join("reflect.c"), reflect).unwrap();
    fs::write(files.path().join("wrong.c"), reflect.replace("a[i] - d", "a[i] + d")).unwrap();
    let run = |file: &str, arguments: &[&str]| rayo([&["try", file, "--check"], arguments].concat(), files.path());
    let truth = ["--truth", "a - 2*dot(a,b)*b", "--takes", "vec4,vec4", "--gives", "vec4"];
    let right = run("reflect.c", &truth);
    assert_eq!(right.status, 0, "{}{}", right.stdout, right.stderr);
    assert!(right.stdout.contains("reflect.c: a - 2*dot(a,b)*b\n"), "{}", right.stdout);
    let wrong = run("wrong.c", &[&truth[..], &["--symbol", "reflect"]].concat());
    assert!(wrong.status == 1 && wrong.stdout.contains("  result        wrong: "), "{}", wrong.stdout);
    run("reflect.c", &["--truth", "a *", "--takes", "vec4", "--gives", "vec4"])
        .refuses("error: the formula `a *`, column 4: it ends where a value is expected");
    run("reflect.c", &["--truth", "a", "--takes", "matrix", "--gives", "vec4"])
        .refuses("expected one of f32, vec4, sphere, triangle, surface, light, found `matrix`");
    run("reflect.c", &["--truth", "a"]).refuses("--takes <T,T>");
}

#[test]
fn a_tracer_is_held_against_the_reference_and_timed_beside_c() {
    let files = tempfile::tempdir().unwrap();
    let start = rayo(["try", "--template", "c", "--op", "trace"], files.path());
    fs::write(files.path().join("trace.c"), start.printed()).unwrap();
    let tried = rayo(["try", "trace.c", "--json"], files.path());
    assert_eq!(tried.status, 0, "{}{}", tried.stdout, tried.stderr);
    let verdict = tried.document();
    let scenes: Vec<_> = verdict["pictures"].as_array().unwrap().iter().map(|picture| &picture["scene"]).collect();
    assert_eq!(scenes, ["sphere.in", "tetrahedron.in", "overlapping.in from column 53", "inside.in from column 53"]);
    let ratios: Vec<_> = verdict["ratios"].as_array().unwrap().iter().map(|ratio| &ratio["what"]).collect();
    assert_eq!(ratios, ["C/yours", "yours/paper", "C/yours", "yours/paper"]);
}

/// A mistake in the tracer of the template: what stands in place of what, and what is said of it.
struct Mistake {
    name: &'static str,
    was: &'static str,
    is: &'static str,
    said: &'static str,
}

const fn mistake(name: &'static str, was: &'static str, is: &'static str) -> Mistake {
    Mistake { name, was, is, said: "pixels are off by more than 1/255 (" }
}

const MISTAKES: [Mistake; 18] = [
    mistake("last_sphere", "if (t < nearest)", "if (t < INFINITY)"),
    mistake(
        "last_triangle",
        "normal, s);\n                if (t < nearest)",
        "normal, s);\n                if (t < INFINITY)",
    ),
    mistake("first_sphere", "if (t < nearest)", "if (t < INFINITY && nearest == INFINITY)"),
    mistake("one_sphere", "i < lists->sphere_count", "i < 1 && i < lists->sphere_count"),
    mistake("one_triangle", "i < lists->triangle_count", "i < 1 && i < lists->triangle_count"),
    mistake("one_light", "i < lists->light_count", "i < 1"),
    mistake("spheres_first", "i < lists->triangle_count", "nearest == INFINITY && i < lists->triangle_count"),
    mistake("first_row", "for (; row < end; row++)", "for (end -= row, row = 0; row < end; row++)"),
    mistake("first_column", "(float)(frame->first + column)", "(float)column"),
    mistake("black", "pixel = frame->background", "pixel = {0, 0, 0, 0}"),
    mistake("nearer_root", "near : far > 0 ? far : INFINITY", "near : INFINITY"),
    mistake("sphere_behind", "return near > 0 ?", "return 1 ?"),
    mistake("triangle_behind", "if (!(t > 0))", "if (0)"),
    mistake("one_side", "sides == 2 ? fabsf(cosine)", "sides == 3 ? fabsf(cosine)"),
    mistake("dark_light", "cosine = cosine > 0 ? cosine : 0;", ""),
    Mistake {
        said: "  memory        writes beside the picture: ",
        ..mistake("beyond", "pixel;\n        }", "pixel, *out = pixel;\n        }")
    },
    Mistake {
        said: "of the lights, which has",
        ..mistake("next_light", "lights[i].position, point", "lights[i + 1].position, point")
    },
    Mistake {
        said: "writes over the lights",
        ..mistake("own_lights", "*out++ = pixel;", "*out++ = pixel, ((Light *)lists->lights)->position.w = 1;")
    },
];

#[test]
fn no_mistake_of_a_tracer_is_praised() {
    let files = tempfile::tempdir().unwrap();
    let start = rayo(["try", "--template", "c", "--op", "trace"], files.path()).stdout;
    for Mistake { name, was, is, said } in extent::sampled(MISTAKES, 4) {
        assert!(start.contains(was), "{name}");
        let file = format!("{name}.c");
        fs::write(files.path().join(&file), start.replacen(was, is, 1)).unwrap();
        let tried = rayo(["try", &file, "--op", "trace", "--check"], files.path());
        assert_eq!(tried.status, 1, "{name}: {}{}", tried.stdout, tried.stderr);
        assert!(tried.stdout.contains(said), "{name}: {}", tried.stdout);
    }
}

#[test]
fn a_call_is_shown_by_its_lines_and_a_listing_beside_the_papers() {
    let stepped = run(&["dot_best.asm", "--check", "--step"]);
    let line = "dot_best.asm:7         movaps xmm0, [rsi]               xmm0 = (";
    assert!(stepped.stdout.contains(line), "{}", stepped.stdout);
    assert!(stepped.stdout.contains("movss [rdi], xmm0                memory = ("), "{}", stepped.stdout);
    let listed = run(&["dot_best.asm", "--asm"]);
    let first = listed.printed().lines().next().unwrap();
    assert_eq!(first.split_whitespace().collect::<Vec<_>>(), ["dot_best.asm,", "9", "instructions", "paper"]);
    assert!(
        listed.stdout.contains("mulps xmm0, xmm1") && listed.stdout.contains("haddps xmm0, xmm0"),
        "{}",
        listed.stdout
    );
}

#[test]
fn a_watched_file_is_tried_again_when_it_changes() {
    use std::io::{BufRead, BufReader};
    let files = tempfile::tempdir().unwrap();
    let path = files.path().join("dot.asm");
    fs::copy(folder().join("dot_best.asm"), &path).unwrap();
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_rayo"));
    command
        .args(["try", "dot.asm", "--check", "--watch"])
        .current_dir(files.path())
        .stdout(std::process::Stdio::piped());
    let mut watching = command.spawn().unwrap();
    let mut lines = BufReader::new(watching.stdout.take().unwrap()).lines().map(Result::unwrap);
    assert!(lines.any(|line| line.contains("the same bits as `paper`")));
    fs::copy(folder().join("dot_one_haddps.asm"), &path).unwrap();
    assert!(lines.any(|line| line.contains("wrong: ")));
    watching.kill().unwrap();
    watching.wait().unwrap();
}

#[test]
fn what_cannot_be_tried_is_told_in_a_sentence() {
    let files = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(files.path().join(name), text).unwrap();
    write("empty.asm", "");
    write("text.o", "this is no object\n");
    write("text.so", "neither is this\n");
    write("dot.txt", "what is it?\n");
    write("error.asm", "global dot\ndot:\n    mulpz xmm0, xmm1\n    ret\n");
    write("error.c", "void dot(float *out) { *out = ; }\n");
    write("nothing.asm", "dot:\n    ret\n");
    write("two.c", "void dot(void) {}\nvoid norm(void) {}\n");
    write("undefined.asm", "global dot\nextern missing\ndot:\n    jmp missing wrt ..plt\n");
    write(
        "absolute.asm",
        "section .text\nglobal dot\ndot:\n    movaps xmm0, [one]\n    ret\nsection .data\none: dq 0, 0\n",
    );
    fs::create_dir(files.path().join("folder.asm")).unwrap();
    fs::copy(folder().join("dot_best.asm"), files.path().join("dot.asm")).unwrap();
    for (arguments, said) in [
        (&["missing.asm"][..], "error: cannot read missing.asm: No such file"),
        (&["folder.asm"], "error: folder.asm is a folder: name a file of it"),
        (&["empty.asm"], "error: empty.asm is empty: `rayo try --template asm --op dot` prints a start"),
        (&["dot.txt"], "error: dot.txt: its name has to end in one of .asm, .nasm, .s, .S, .c, .rs, .o, .so"),
        (&["text.o"], "error: text.o is not an object file"),
        (&["text.so"], "error: text.so is not an object file that can be read"),
        (&["error.asm"], "error.asm:3: error: "),
        (&["error.c"], "error.c:1:31: error: "),
        (&["nothing.asm"], "error: nothing.asm has no function for others: is a `global` missing"),
        (&["two.c"], "error: two.c: it has functions of several operations: say which with --op"),
        (&["undefined.asm"], "undefined reference to `missing'"),
        (&["absolute.asm"], "write `default rel` at the top"),
        (&["dot.asm", "--op", "dots"], "error: there is no operation `dots`; there are: add, sub, scale, dot"),
        (&["dot.asm", "--symbol", "norm"], "error: dot.asm has no function `norm`; it has: dot"),
        (&["dot.asm", "--timeout", "0"], "expected a whole number from 1 to 3600"),
        (&[], "tip: for example"),
        (&["--template", "asm", "--op", "dots"], "there is no operation `dots`"),
    ] {
        rayo([&["try"], arguments].concat(), files.path()).refuses(said);
    }
    for (file, variable, said) in [
        ("dot.asm", "NASM", "error: dot.asm needs `no-such-tool`, which is not there: install the package `nasm`"),
        ("two.c", "CC", "error: two.c needs `no-such-tool`, which is not there: install the package `gcc`"),
        ("lib.rs", "RUSTC", "error: lib.rs needs `no-such-tool`, which is not there: install Rust"),
    ] {
        write("lib.rs", "fn f() {}\n");
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_rayo"));
        command.args(["try", file]).current_dir(files.path()).env(variable, "no-such-tool");
        Run::of(command.output().unwrap()).refuses(said);
    }
}

#[test]
fn objects_are_taken_as_they_are_and_flags_go_to_the_tool() {
    let files = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| fs::write(files.path().join(name), text).unwrap();
    let made = |program: &str, arguments: &[&str]| {
        let status = std::process::Command::new(program).args(arguments).current_dir(&files).status().unwrap();
        assert!(status.success(), "{program} {arguments:?}");
    };
    let right = folder().join("dot_best.asm");
    made("nasm", &["-f", "elf64", "-o", "dot.o", right.to_str().unwrap()]);
    made("cc", &["-shared", "-o", "dot.so", "dot.o"]);
    let run = |arguments: &[&str]| rayo([&["try"], arguments, &["--check"]].concat(), files.path());
    for name in ["dot.o", "dot.so"] {
        let tried = run(&[name]);
        assert!(
            tried.status == 0 && tried.stdout.contains("the same bits as `paper`"),
            "{}{}",
            tried.stdout,
            tried.stderr
        );
    }
    write(
        "flag.asm",
        "global dot\ndot:\nmovaps xmm0, [rsi]\nmulps xmm0, [rdx]\nHADD xmm0, xmm0\nHADD xmm0, xmm0\nmovss [rdi], xmm0\nret\n",
    );
    assert_eq!(run(&["flag.asm", "--flags", "-DHADD=haddps"]).status, 0);
    run(&["flag.asm"]).refuses("flag.asm:5: error: ");
    for name in ["-dash.asm", "@sign.asm"] {
        fs::copy(&right, files.path().join(name)).unwrap();
        let tried = rayo(["try", "--check", "--op", "dot", "--", name], files.path());
        assert_eq!(tried.status, 0, "{}{}", tried.stdout, tried.stderr);
    }
    write("-dash.c", "void dot(float *out) { *out = 0; }");
    assert_eq!(rayo(["try", "--check", "--", "-dash.c"], files.path()).status, 1);
    write("old.asm", "global dot\ndot:\nblcfill eax, eax\nret\n");
    if !std::is_x86_feature_detected!("tbm") {
        run(&["old.asm"]).refuses("error: old.asm: `dot` needs TBM, which this CPU does not have");
    }
}

#[test]
fn a_kernel_that_writes_beside_its_result_is_not_timed() {
    for file in ["dot_writes_16.asm", "dot_writes_a.asm"] {
        let tried = run(&[file]);
        let note = "not timed: it writes to memory that is not its own";
        assert!(tried.status == 1 && tried.stdout.contains(note), "{file}: {}", tried.stdout);
        assert!(!tried.stdout.contains("latency") && !tried.stdout.contains("crash"), "{file}: {}", tried.stdout);
    }
}

#[test]
fn children_of_others_are_left_alone() {
    let script = "sleep 100 > /dev/null 2>&1 & echo $!; exec \"$0\" try dot_best.asm --check > /dev/null";
    let shell = |arguments: &[&str]| {
        std::process::Command::new("sh").arg("-c").args(arguments).current_dir(folder()).output().unwrap()
    };
    let tried = shell(&[script, env!("CARGO_BIN_EXE_rayo")]);
    assert!(tried.status.success(), "{tried:?}");
    let sleeper = String::from_utf8(tried.stdout).unwrap();
    assert!(shell(&["kill $0", sleeper.trim()]).status.success(), "it was ended already");
}

#[test]
fn only_try_itself_starts_a_process_for_foreign_code() {
    let request = br#"{"shared": "x.so", "symbol": "dot", "offset": 0, "bytes": 0, "body": null, "wanted": {"truth":
        {"Operation": "dot"}, "takes": ["vec4", "vec4"], "gives": "f32"}, "stage": "Values", "seed": 1, "inputs": 1,
        "seconds": 1, "progress": "p"}"#;
    let files = tempfile::tempdir().unwrap();
    fs::write(files.path().join("request"), request).unwrap();
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_rayo"));
    command.args(["try", "--serve"]).stdin(fs::File::open(files.path().join("request")).unwrap());
    let served = Run::of(command.output().unwrap());
    assert!(served.status != 0 && served.stderr.contains("only `rayo try` itself starts"), "{}", served.stderr);
}

#[test]
fn nothing_of_a_kernel_is_left_behind() {
    let files = tempfile::tempdir().unwrap();
    let text = "#include <unistd.h>\nvoid dot(float *out)\n{\n    if (fork() == 0) { setsid(); for (;;) pause(); }\n    *out = 0;\n}\n";
    fs::write(files.path().join("dot.c"), text).unwrap();
    let tried = rayo(["try", "dot.c", "--check", "--timeout", "1"], files.path());
    assert_eq!(tried.status, 1, "{}", tried.stderr);
    let is_here =
        |process: &fs::DirEntry| fs::read_link(process.path().join("cwd")).is_ok_and(|cwd| cwd == files.path());
    assert_eq!(fs::read_dir("/proc").unwrap().map(Result::unwrap).filter(is_here).count(), 0);
}

#[test]
fn rust_is_tried_too_and_a_panic_is_a_crash() {
    if std::process::Command::new("rustc").arg("-V").output().is_err() {
        return extent::not_run("rustc", "functions in Rust");
    }
    let files = tempfile::tempdir().unwrap();
    fs::write(files.path().join("dot.rs"), rayo(["try", "--template", "rust"], files.path()).printed()).unwrap();
    let tried = rayo(["try", "dot.rs", "--check"], files.path());
    assert_eq!(tried.status, 0, "{}{}", tried.stdout, tried.stderr);
    let panics = run(&["dot_panics.rs", "--check"]);
    assert!(panics.stdout.contains("  crash         it kills the process: SIGABRT"), "{}", panics.stdout);
    assert!(panics.stdout.contains("index out of bounds: the len is 4 but the index is 4"), "{}", panics.stdout);
}

#[test]
fn a_template_passes_in_every_language() {
    let files = tempfile::tempdir().unwrap();
    let operations = rayo_lab::experiments::ops::ALL_OPERATIONS;
    let starts =
        operations.into_iter().flat_map(|op| [("asm", "asm"), ("macro", "asm"), ("c", "c")].map(|of| (op, of)));
    for (op, (language, extension)) in extent::sampled(starts, 5) {
        let start = rayo(["try", "--template", language, "--op", op], files.path());
        let name = format!("{op}.{extension}");
        fs::write(files.path().join(&name), start.printed()).unwrap();
        let tried =
            rayo(["try", &name, "--check", "--require", "same-bits,odd,aliasing,convention,memory"], files.path());
        assert_eq!(tried.status, 0, "{op} {language}: {}{}", tried.stdout, tried.stderr);
    }
}
