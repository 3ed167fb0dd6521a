//! The proof that a user's function equals our twin for all inputs, by our own prover.

use super::call::Session;
use super::findings::{Finding, PROVED};
use super::wanted::Truth;
use crate::experiments::prove::operations::of_macros;
use crate::experiments::prove::{Verdict, prove as prove_subject};
use rayo::internals::kernels::ALL_OPERATIONS;
use rayo::internals::reference::aos::Form;

/// Tries to prove it equal to the twin in one of its forms, and reports what came of it.
pub fn prove(session: &Session<'_>) {
    let Truth::Operation(wanted) = &session.wanted.truth else { return };
    let Some(name) = ALL_OPERATIONS.into_iter().find(|known| known == wanted) else { return };
    let Some(like) = session.wanted.ours() else { return };
    let op = session.function.like(like);
    let mut why = String::new();
    for (form, form_name) in [(Form::Paper, "paper"), (Form::Best, "aos")] {
        match prove_subject(&of_macros(form, name, op)).verdict {
            Verdict::Proved => {
                return session.tell(&Finding::Proof(format!("{PROVED} `{form_name}`, for every input")));
            }
            Verdict::Differs(_) => {}
            Verdict::Unproved(reason) => why = format!("none: {reason}"),
        }
    }
    let differs = "none: there are inputs for which it gives neither what `paper` gives nor what `aos` does";
    session.tell(&Finding::Proof(if why.is_empty() { differs.into() } else { why }));
}
