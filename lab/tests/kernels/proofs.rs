//! Proofs that operations in assembly equal their twins; and the prover applied to wrong code, to
//! test it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use rayo::internals::kernels::harness::BROKEN_DOTS;
use rayo::internals::kernels::{self, Isa, OpRef};
use rayo::internals::reference::aos::Form;
use rayo_lab::experiments::prove::goals::{Goal, goals};
use rayo_lab::experiments::prove::graph::Lemma;
use rayo_lab::experiments::prove::mutants::{self, MutantOutcome};
use rayo_lab::experiments::prove::rounding::Bound;
use rayo_lab::experiments::prove::{self, Counterexample, Proof, Subject, Verdict, operations};

fn describe(subject: &Subject) -> String {
    format!("{} {} {} {}", subject.name, subject.form, subject.isa.name(), subject.precision.name())
}

/// An operation of the paper, in the form whose instructions the paper counts.
fn of_paper(name: &str) -> OpRef {
    let mut ops = kernels::paper().expect("every CPU of x86-64 that is tested has SSE4.1").ops();
    ops.find(|(known, _)| *known == name).expect("an operation").1
}

/// Code paired with the twin of other code, and a description of the difference.
fn wrong_pairs() -> Vec<(&'static str, Subject)> {
    let mut wrong = vec![
        ("a sum and a difference", operations::of_macros(Form::Paper, "sub", of_paper("add"))),
        ("the order of a sum", operations::of_macros(Form::Best, "dot", of_paper("dot"))),
        ("the order of a sum within a root", operations::of_macros(Form::Best, "norm", of_paper("norm"))),
        ("the order of a sum within a case", operations::of_macros(Form::Best, "sphere", of_paper("sphere"))),
        ("two sides and one", operations::of_macros(Form::Paper, "lambert2", of_paper("lambert"))),
    ];
    let dots = BROKEN_DOTS.iter().filter(|op| op.symbol() == "rayo_broken_dot_wrong");
    wrong.extend(dots.map(|op| ("a wrong product", operations::of_macros(Form::Paper, "dot", OpRef::Scalar(*op)))));
    for isa in Isa::ALL {
        let mut codes = kernels::packet_op_codes::<f64>(isa);
        codes[0].name = "sub";
        wrong.push(("a sum and a difference of packets", operations::of_packets::<f64>(isa, codes.swap_remove(0))));
    }
    wrong
}

/// Whether a prover is reliable: it proves equal code, and finds inputs that show a difference for
/// other code.
fn examine(prove: &dyn Fn(&Subject) -> Proof) -> Result<(), String> {
    let verdicts = prove::subjects().into_iter().map(|subject| (describe(&subject), prove(&subject).verdict));
    let failed: Vec<_> = verdicts.filter(|(_, verdict)| *verdict != Verdict::Proved).collect();
    if !failed.is_empty() {
        return Err(format!("these are not proved: {failed:#?}"));
    }
    for (difference, subject) in wrong_pairs() {
        match prove(&subject).verdict {
            // For packets `seen` may be false: the CPU runs the code with the twin's name, which is
            // another operation here.
            Verdict::Differs(Some(Counterexample { seen, .. })) if seen || subject.form == "packets" => {}
            verdict => return Err(format!("{difference}: {verdict:?}")),
        }
    }
    Ok(())
}

/// The uses of lemmas in a proof that needs no lemma.
const NO_LEMMA: [usize; Lemma::ALL.len()] = [0; Lemma::ALL.len()];

#[test]
fn operations_are_proved_and_what_differs_is_shown() {
    examine(&prove::prove).unwrap();
}

#[test]
fn a_prover_that_accepts_everything_is_found_out() {
    let accepts = |_: &Subject| Proof { verdict: Verdict::Proved, paths: 1, pairs: 1, lemmas: NO_LEMMA };
    assert!(examine(&accepts).unwrap_err().contains("a sum and a difference"));
    let refuses = |_: &Subject| Proof { verdict: Verdict::Differs(None), paths: 0, pairs: 0, lemmas: NO_LEMMA };
    assert!(examine(&refuses).unwrap_err().contains("are not proved"));
}

#[test]
fn code_that_cannot_be_read_is_never_proved() {
    let reasons = [
        ("rayo_broken_dot_address", "it reads memory at"),
        ("rayo_broken_dot_instruction", "ud2 is not done with symbols"),
    ];
    for (symbol, reason) in reasons {
        let op = BROKEN_DOTS.iter().find(|op| op.symbol() == symbol).unwrap();
        let verdict = prove::prove(&operations::of_macros(Form::Paper, "dot", OpRef::Scalar(*op))).verdict;
        assert!(matches!(&verdict, Verdict::Unproved(why) if why.contains(reason)), "{symbol}: {verdict:?}");
    }
}

#[test]
fn expressions_give_what_the_cpu_does() {
    let mut called = 0;
    for subject in prove::subjects() {
        prove::hold_against_cpu(&subject, 35, 1).unwrap();
        called += usize::from(subject.call.is_some());
    }
    // At least the functions of SSE4.1.
    assert!(called > 60, "only {called} functions were called");
}

/// The macros with an `equals` line in their comments.
fn macros_with_a_twin() -> BTreeSet<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../asm");
    let folders = ["include", "ops", "tracers"].map(|folder| fs::read_dir(root.join(folder)).unwrap());
    let mut found = BTreeSet::new();
    for file in folders.into_iter().flatten() {
        let mut equals = false;
        for line in fs::read_to_string(file.unwrap().path()).unwrap().lines() {
            let name = line.strip_prefix("%macro ").and_then(|rest| rest.split_whitespace().next());
            if let Some(name) = name.filter(|_| equals) {
                found.insert(name.to_owned());
            }
            equals = line.starts_with(';') && (equals || line.contains(";   equals "));
        }
    }
    found
}

#[test]
fn every_macro_with_a_twin_is_proved_or_excepted() {
    let with_a_twin = macros_with_a_twin();
    assert!(with_a_twin.len() > 60, "{with_a_twin:?}");
    let proved: BTreeSet<&str> = prove::subjects().iter().flat_map(|subject| subject.macros).copied().collect();
    for (name, reason) in prove::EXCEPTIONS {
        assert!(with_a_twin.contains(name), "{name}, which is excepted since {reason}, has no twin");
        assert!(!proved.contains(name), "{name} is proved and excepted");
    }
    let excepted = prove::EXCEPTIONS.map(|(name, _)| name);
    let left: Vec<_> =
        with_a_twin.iter().filter(|name| !proved.contains(&***name) && !excepted.contains(&&***name)).collect();
    assert_eq!(left, Vec::<&String>::new(), "these have a twin, and neither a proof nor a reason for none");
}

#[test]
fn no_mutant_that_differs_on_an_input_is_proved() {
    // A sample at regular steps, since all mutants would take half an hour. The test fails in
    // `mutants::fate` if one is proved that differs on an input.
    let step = if crate::extent::all() { 41 } else { 797 };
    let mut tally = BTreeMap::<String, usize>::new();
    let mut at = 0;
    for subject in prove::subjects() {
        for bit in mutants::bits(&subject) {
            at += 1;
            let Some(mutant) = Some(bit).filter(|_| at % step == 0).and_then(mutants::mutant) else { continue };
            let fate = match mutants::fate(&subject, &mutant) {
                MutantOutcome::Refuted => "refuted by an input".to_owned(),
                MutantOutcome::Differs => "refuted by its expressions".to_owned(),
                MutantOutcome::Unreadable(_) => "not followed by the model".to_owned(),
                MutantOutcome::Equivalent(kind) => {
                    println!("{}: {}: {}", subject.symbol, mutant.change, kind.name());
                    format!("equivalent: {}", kind.name())
                }
            };
            *tally.entry(fate).or_default() += 1;
        }
    }
    println!("{tally:#?}");
    let count = |fate: &str| tally.get(fate).copied().unwrap_or(0);
    let refuted = count("refuted by an input") + count("refuted by its expressions");
    let equivalent: usize =
        tally.iter().filter(|(fate, _)| fate.starts_with("equivalent")).map(|(_, count)| count).sum();
    assert!(refuted > 4 * equivalent, "{tally:?}");
}

#[test]
fn bounds_of_rounding_errors_are_proved_by_counting() {
    for bound in prove::rounding::bounds() {
        println!("{bound:?}");
        assert!(bound.holds && bound.needed > bound.constant / 3.0, "{bound:?}");
    }
}

/// Whether a prover proves a goal given as text; None if the prover is not installed.
fn is_proved_by(prover: &str, text: &str) -> Option<bool> {
    let mut command = Command::new(prover);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
    let mut child = command.spawn().ok()?;
    child.stdin.take().unwrap().write_all(text.as_bytes()).unwrap();
    let output = child.wait_with_output().unwrap();
    // Sollya prints whether a comparison holds.
    let is_true = prover != "sollya" || String::from_utf8_lossy(&output.stdout).contains("true");
    Some(output.status.success() && is_true)
}

/// Whether every case of a goal can be proved for the bound `needed`.
fn is_goal_proved(goal: &Goal, needed: f64) -> Option<bool> {
    let prover = goal.bound.by;
    goal.texts(needed).iter().try_fold(true, |all, text| Some(all && is_proved_by(prover, text)?))
}

#[test]
fn goals_are_proved_and_narrower_ones_are_not() {
    for goal in goals() {
        let Bound { needed, by, holds, .. } = goal.bound;
        assert!(holds, "{:?}", goal.bound);
        let Some(proved) = is_goal_proved(&goal, needed) else {
            crate::extent::not_run(by, &format!("{} is proved", goal.file));
            continue;
        };
        assert!(proved, "{} does not prove {}: {needed}", by, goal.file);
        assert_eq!(is_goal_proved(&goal, needed / 2.0), Some(false), "{by} proves anything of {}", goal.file);
    }
}

#[test]
fn every_file_of_proofs_has_a_goal() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../proofs");
    let files: BTreeSet<_> = fs::read_dir(folder).unwrap().map(|file| file.unwrap().file_name()).collect();
    assert_eq!(files, goals().iter().map(|goal| goal.file.into()).collect());
}
