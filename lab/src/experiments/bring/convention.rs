//! Broken rules of the calling convention, each with the line that breaks it.

use super::call::Session;
use super::findings::Fault;
use crate::measure::instructions::decode;
use rayo::internals::kernels::Fault as Rule;
use rayo::internals::kernels::step::Step;

/// The most instructions of a call that are looked at.
const MOST_STEPS: usize = 20_000;
const DIRECTION_FLAG: u64 = 0x400;
/// The control bits of MXCSR: all but the exceptions that have happened.
const MXCSR_CONTROL: u32 = 0xffc0;

/// The rules that calls have broken so far; with the lines that break them if the function
/// `returns`.
pub fn faults(session: &Session<'_>, returns: bool) -> Vec<Fault> {
    let spoilers = if returns { spoilers(session) } else { Vec::new() };
    let fault = |rule: &Rule| {
        let found = spoilers.iter().find(|(broken, ..)| broken == rule);
        Fault {
            rule: rule.to_string(),
            instruction: found.map(|(_, instruction, _)| instruction.clone()),
            line: found.and_then(|(.., address)| session.line(*address)),
        }
    };
    session.broken.iter().map(fault).collect()
}

/// For each broken rule, the instruction that broke it last, and its address.
fn spoilers(session: &Session<'_>) -> Vec<(Rule, String, u64)> {
    if session.broken.is_empty() {
        return Vec::new();
    }
    let Ok(recording) = session.record(MOST_STEPS) else { return Vec::new() };
    let Some(entry) = recording.steps().next().map(|step| step.before.general[4]) else { return Vec::new() };
    let mut found = Vec::new();
    for rule in &session.broken {
        let last = recording.steps().rfind(|step| breaks(*rule, step, entry));
        if let Some(step) = last {
            let text = decode(step.code, 0).next().map_or(String::new(), |instruction| instruction.text);
            found.push((*rule, text, step.before.rip));
        }
    }
    found
}

/// Whether a step is one that may break a rule; `entry` is the stack pointer at the function's
/// entry.
fn breaks(rule: Rule, step: &Step<'_>, entry: u64) -> bool {
    let changes = |register: usize| step.before.general[register] != step.after.general[register];
    match rule {
        Rule::Rbx => changes(3),
        Rule::Rbp => changes(5),
        Rule::R12 => changes(12),
        Rule::R13 => changes(13),
        Rule::R14 => changes(14),
        Rule::R15 => changes(15),
        Rule::Rsp => changes(4),
        Rule::Stack => {
            step.touched.is_some_and(|touched| touched.address >= entry + 8 && touched.before != touched.after)
        }
        Rule::Direction => (step.before.flags ^ step.after.flags) & DIRECTION_FLAG != 0,
        Rule::Mxcsr => (step.before.mxcsr ^ step.after.mxcsr) & MXCSR_CONTROL != 0,
        Rule::Upper => {
            let pairs = step.before.vectors.iter().zip(&step.after.vectors).take(16);
            pairs
                .into_iter()
                .any(|(before, after)| before[16..] != after[16..] && after[16..].iter().any(|byte| *byte != 0))
        }
    }
}
