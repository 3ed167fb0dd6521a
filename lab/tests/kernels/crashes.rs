//! Kernels with wrong results, broken rules or crashes: all are found and explained before they are
//! counted or timed.

use std::os::unix::process::ExitStatusExt;
use std::process::{Command, Output};

use rayo::internals::kernels::crash::{Crash, explain};
use rayo::internals::kernels::harness::BROKEN_DOTS;
use rayo::internals::kernels::step::record_until_crash;
use rayo::internals::kernels::{Fault, Op, OpRef, Vec4, paper};
use rayo::internals::reference::aos::Form;
use rayo_lab::experiments::check::inputs::Input;
use rayo_lab::experiments::check::{self, Failed, What, twins};
use rayo_lab::measure::crash::describe;
use rayo_lab::measure::instructions::decode;

/// The broken kernel with this mistake.
fn dot(mistake: &str) -> Op<Vec4, Vec4, f32> {
    let symbol = format!("rayo_broken_dot_{mistake}");
    *BROKEN_DOTS.iter().find(|broken| broken.symbol() == symbol).expect("there is a kernel with this mistake")
}

fn failure_of(mistake: &str) -> Failed {
    let twin = |input: &Input| twins::of_macros(Form::Paper, "dot", input);
    *check::operation(OpRef::Scalar(dot(mistake)), &twin).expect_err(mistake)
}

#[test]
fn a_wrong_result_is_told_with_its_inputs_lane_by_lane() {
    let failed = failure_of("wrong");
    let What::Result(lanes) = &failed.what else { panic!("{failed}") };
    assert!(lanes.len() == 1 && !lanes[0].same, "{failed}");
    let text = failed.to_string();
    assert!(text.starts_with("rayo_broken_dot_wrong is wrong: it does not return what its twin does\n  a  "), "{text}");
    let lane = format!("\n  lane 0      expected {}, got {}: WRONG", lanes[0].expected, lanes[0].got);
    assert!(text.contains("\n  b  ") && text.ends_with(&lane), "{text}");
}

#[test]
fn a_spoilt_register_is_told_though_the_result_is_right() {
    let failed = failure_of("rbx");
    assert!(matches!(&failed.what, What::Convention(call) if call.broken == [Fault::Rbx]), "{failed}");
    let text = failed.to_string();
    assert!(text.starts_with("rayo_broken_dot_rbx breaks the calling convention\n"), "{text}");
    assert!(text.ends_with("\n  broken      rbx is not preserved"), "{text}");
}

#[test]
fn every_kind_of_crash_is_told_with_its_instruction_and_cause() {
    let expected = [
        ("address", libc::SIGSEGV, "mulps xmm0, [rax+40h]", "nothing is mapped at the address 0x40"),
        ("alignment", libc::SIGSEGV, "movaps xmm0, [rsi+4]", "is not a multiple of 16"),
        ("instruction", libc::SIGILL, "ud2", "SIGILL, an instruction that this CPU does not have"),
        ("division", libc::SIGFPE, "div ecx", "a division by 0"),
    ];
    for (mistake, signal, instruction, cause) in expected {
        let failed = failure_of(mistake);
        let What::Crash(crashed) = &failed.what else { panic!("{failed}") };
        assert_eq!(crashed.crash.signal, signal, "{failed}");
        let text = failed.to_string();
        assert!(text.starts_with(&format!("rayo_broken_dot_{mistake} crashed: SIG")), "{text}");
        assert!(text.contains(&format!("\n  instruction {instruction}\n")) && text.contains(cause), "{text}");
    }
}

#[test]
fn checked_calls_go_on_after_a_crash_on_every_thread() {
    let Some(paper) = paper() else { return };
    std::thread::scope(|threads| {
        for _ in 0..4 {
            threads.spawn(|| {
                for mistake in ["address", "division", "instruction", "alignment"] {
                    assert!(matches!(failure_of(mistake).what, What::Crash(_)));
                    check::macros(Form::Paper, "dot", paper).unwrap();
                }
            });
        }
    });
}

#[test]
fn a_recording_keeps_the_instructions_before_a_crash() {
    let op = dot("address");
    let code = op.address()..op.address() + 16;
    let all = 0..u64::MAX;
    let (a, b) = (Vec4::new(1.0, 2.0, 3.0), Vec4::new(4.0, 5.0, 6.0));
    let recording =
        record_until_crash(std::slice::from_ref(&code), std::slice::from_ref(&all), 100, || _ = op.call(&a, &b))
            .unwrap();
    let crashed = recording.crashed.as_ref().unwrap();
    assert_eq!((crashed.symbol, crashed.crash.address), (op.symbol(), 64));
    let told: Vec<_> = recording.steps().map(|step| decode(step.code, 0).next().unwrap().text).collect();
    assert_eq!(told, ["endbr64", "movaps xmm0, [rsi]", "xor eax, eax"]);
    assert_eq!(recording.executed, 4, "the last is the one that crashed");
    // The recorded steps are right, and single-stepping still works afterwards.
    let last = recording.steps().next_back().unwrap();
    assert_eq!(&last.after.vectors[0][..4], &1.0_f32.to_le_bytes());
    assert!(check::macros(Form::Paper, "dot", paper().unwrap()).is_ok());
}

/// Runs a test of this file in a process of its own, which may crash.
fn run_alone(part: &str) -> Output {
    let program = std::env::current_exe().unwrap();
    let part = format!("crashes::{part}");
    Command::new(program).args(["--exact", &part, "--ignored", "--nocapture"]).output().unwrap()
}

fn tell(crash: Crash) -> ! {
    eprintln!("{}", describe(&crash, None));
    std::process::exit(1)
}

/// Calls a broken kernel unchecked, as engines do, on two threads at once.
fn crash_unchecked(is_known: bool) {
    let op = dot("address");
    let code = op.address()..op.address() + 16;
    explain(if is_known { vec![code] } else { Vec::new() }, tell);
    let crash = || _ = op.call(&Vec4::default(), &Vec4::default());
    std::thread::scope(|threads| {
        threads.spawn(crash);
        threads.spawn(crash);
    });
}

#[test]
#[ignore = "the process dies of it: run by the test below"]
fn part_with_a_kernel_that_is_known() {
    crash_unchecked(true);
}

#[test]
#[ignore = "the process dies of it: run by the test below"]
fn part_with_code_that_is_not_known() {
    crash_unchecked(false);
}

#[test]
#[ignore = "the process dies of it: run by the test below"]
fn part_with_a_signal_that_was_sent() {
    explain(Vec::new(), tell);
    let process = std::process::id().to_string();
    Command::new("kill").args(["-FPE", &process]).status().unwrap();
    std::thread::sleep(std::time::Duration::from_secs(60));
}

#[test]
fn only_crashes_of_kernels_are_told_and_others_die_as_ever() {
    let told = run_alone("part_with_a_kernel_that_is_known");
    let text = String::from_utf8_lossy(&told.stderr);
    assert_eq!(told.status.code(), Some(1), "{text}");
    assert_eq!(text.matches("crashed: SIGSEGV").count(), 1, "{text}");
    assert!(text.contains("mulps xmm0, [rax+40h]") && text.contains("the address 0x40"), "{text}");
    let others =
        [("part_with_code_that_is_not_known", libc::SIGSEGV), ("part_with_a_signal_that_was_sent", libc::SIGFPE)];
    for (part, signal) in others {
        assert_eq!(run_alone(part).status.signal(), Some(signal), "{part}");
    }
}
