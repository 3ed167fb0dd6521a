//! The document of all proofs: a row for each macro in each of its forms, and the bounds.

use std::collections::BTreeMap;

use serde::Serialize;

use super::goals::goals;
use super::graph::Lemma;
use super::rounding::{self, Bound};
use super::{EXCEPTIONS, Verdict, prove, subjects};
use rayo::internals::kernels::harness::spheres;

/// The document of `rayo ops --proofs`.
#[derive(Debug, Serialize)]
pub struct Proofs {
    pub macros: Vec<MacroProof>,
    pub bounds: Vec<Bound>,
}

/// The outcome of the proofs of a macro in one of its forms.
#[derive(Debug, Serialize)]
pub struct MacroProof {
    pub name: &'static str,
    /// The form: `paper` and `aos` for one vector in a register, `packets` for operations on
    /// packets, `macros` for macros of the tracers.
    pub form: &'static str,
    /// The instruction set; None for an exception, which holds for all of them.
    pub isa: Option<&'static str>,
    pub precision: Option<&'static str>,
    /// `proved`, `excepted`, or `failed`.
    pub verdict: &'static str,
    /// Paths through the machine code.
    pub paths: usize,
    /// How often each lemma was used.
    pub lemmas: BTreeMap<&'static str, usize>,
    /// Why it is not proved.
    pub reason: Option<String>,
}

impl Proofs {
    /// Carries out all proofs.
    pub fn of_all() -> Proofs {
        let mut macros = Vec::new();
        for subject in subjects() {
            let proof = prove(&subject);
            let used = Lemma::ALL.into_iter().zip(proof.lemmas).filter(|(_, uses)| *uses > 0);
            let lemmas: BTreeMap<_, _> = used.map(|(lemma, uses)| (lemma.name(), uses)).collect();
            let reason = match proof.verdict {
                Verdict::Proved => None,
                Verdict::Unproved(why) => Some(why),
                Verdict::Differs(Some(example)) => Some(format!("it differs: {example:?}")),
                Verdict::Differs(None) => Some("it differs; no input was found that shows it".into()),
            };
            macros.extend(subject.macros.iter().map(|name| MacroProof {
                name,
                form: subject.form,
                isa: Some(subject.isa.name()),
                precision: Some(subject.precision.name()),
                verdict: if reason.is_none() { "proved" } else { "failed" },
                paths: proof.paths,
                lemmas: lemmas.clone(),
                reason: reason.clone(),
            }));
        }
        macros.extend(EXCEPTIONS.map(|(name, reason)| MacroProof {
            name,
            form: "macros",
            isa: None,
            precision: None,
            verdict: "excepted",
            paths: 0,
            lemmas: BTreeMap::new(),
            reason: Some(reason.into()),
        }));
        let by_provers = goals().into_iter().map(|goal| goal.bound);
        Proofs { macros, bounds: rounding::bounds().into_iter().chain(by_provers).chain(by_hand()).collect() }
    }

    /// Whether no proof failed and every bound holds.
    pub fn hold(&self) -> bool {
        self.macros.iter().all(|row| row.verdict != "failed") && self.bounds.iter().all(|bound| bound.holds)
    }
}

/// Bounds that are derived on paper, in docs/no-hit-is-lost.md.
fn by_hand() -> [Bound; 1] {
    [Bound::new("box of a sphere", "src/kernels/portable/spheres.rs", spheres::OUTLINE, 4e-9, "pixels", "hand")]
}
