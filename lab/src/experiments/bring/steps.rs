//! One call of a user's function by its lines, and what each instruction changes.

use super::call::Session;
use super::findings::{Finding, Step};
use crate::measure::instructions::decode;
use rayo::internals::kernels::step::{self, Recording, State};

/// The most instructions that are shown.
const MOST_STEPS: usize = 2000;
/// General registers by their numbers in instructions.
const GENERAL: [&str; 16] =
    ["rax", "rcx", "rdx", "rbx", "rsp", "rbp", "rsi", "rdi", "r8", "r9", "r10", "r11", "r12", "r13", "r14", "r15"];

/// Records a call with the first input, and reports its instructions.
pub fn record(session: &Session<'_>) {
    let steps = |recording: Recording| recording.steps().map(|step| told(session, &step)).collect();
    session.tell(&match session.record(MOST_STEPS) {
        Ok(recording) => Finding::Steps(steps(recording)),
        Err(reason) => Finding::Undone(format!("steps: {reason}")),
    });
}

fn told(session: &Session<'_>, step: &step::Step<'_>) -> Step {
    let text = decode(step.code, 0).next().map_or(String::new(), |instruction| instruction.text);
    let mut changed = changes(step.before, step.after);
    if let Some(touched) = step.touched.filter(|touched| touched.before != touched.after) {
        let bytes = usize::from(touched.bytes).min(touched.after.len());
        changed.push(("memory".into(), numbers(&touched.after[..bytes])));
    }
    Step { text, line: session.line(step.before.rip), changed }
}

/// The registers that differ, but for the stack pointer.
fn changes(before: &State, after: &State) -> Vec<(String, String)> {
    let general = GENERAL
        .iter()
        .enumerate()
        .filter(|(number, name)| **name != "rsp" && before.general[*number] != after.general[*number]);
    let mut changed: Vec<_> =
        general.map(|(number, name)| ((*name).to_owned(), format!("{:#x}", after.general[number]))).collect();
    for (number, (before, after)) in before.vectors.iter().zip(&after.vectors).enumerate() {
        if before != after {
            let bytes = if after[16..].iter().all(|byte| *byte == 0) { 16 } else { 32 };
            changed.push((format!("{}mm{number}", if bytes == 16 { "x" } else { "y" }), numbers(&after[..bytes])));
        }
    }
    changed
}

/// Bytes as floats; fewer than four of them by their digits.
fn numbers(bytes: &[u8]) -> String {
    let floats = bytes.chunks_exact(4).map(|bytes| f32::from_ne_bytes(bytes.try_into().expect("four bytes")));
    let floats: Vec<_> = floats.map(|number| format!("{number:?}")).collect();
    if floats.is_empty() { format!("{bytes:02x?}") } else { format!("({})", floats.join(", ")) }
}
