//! llvm-mca's estimate of a body, where the program is installed: a model of the CPU, to be compared with measurement.

use std::io::Write;
use std::process::{Command, Stdio};

use serde::{Deserialize, Serialize};

use crate::measure::Name;
use crate::measure::instructions::{Class, Instruction};

/// Passes through the body that the model simulates.
const ITERATIONS: u32 = 100;

/// What llvm-mca says of a body in a loop.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Model {
    /// The CPU that is modelled, as llvm-mca calls it: `native` is this machine's, as far as that version knows it.
    pub cpu: Name,
    /// Cycles of a pass when each follows the one before, as the registers have it.
    pub cycles: f64,
    /// Cycles of a pass that its use of the CPU's parts allows at best.
    pub throughput: f64,
}

/// The models to ask. A version that is older than this machine's CPU takes it for one of its predecessors, which may lack
/// AVX-512: then another's model has to do.
const CPUS: [&str; 3] = ["native", "znver4", "icelake-server"];

/// The estimate for this machine's CPU, or for the first of [`CPUS`] that has the instructions; None without llvm-mca, and
/// for bodies that jump, which it cannot follow.
pub fn estimate(body: &[Instruction]) -> Option<Model> {
    if body.is_empty() || body.iter().any(|i| i.class == Class::Branch) {
        return None;
    }
    let mut source = String::from(".intel_syntax noprefix\n");
    for i in body {
        // A symbol is written as an operand in memory.
        source += &match i.text.split_once(" <") {
            Some(_) => return None,
            None => i.text.clone(),
        };
        source.push('\n');
    }
    CPUS.into_iter().find_map(|cpu| ask(cpu, &source))
}

/// None where llvm-mca is not there, or does not know the CPU, or the CPU lacks an instruction.
fn ask(cpu: &'static str, source: &str) -> Option<Model> {
    let mut child = Command::new("llvm-mca")
        .args([&format!("-mcpu={cpu}"), "-mtriple=x86_64", &format!("-iterations={ITERATIONS}")])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .ok()?;
    // A pipe that is closed early shows in the output.
    let _ = child.stdin.take()?.write_all(source.as_bytes());
    let output = child.wait_with_output().ok().filter(|output| output.status.success())?;
    // What it does not know it ignores, and says so.
    if String::from_utf8_lossy(&output.stderr).contains("not a recognized processor") {
        return None;
    }
    let text = String::from_utf8_lossy(&output.stdout);
    let value = |name: &str| {
        let rest = text.lines().find_map(|line| line.strip_prefix(name))?;
        rest.trim().parse::<f64>().ok()
    };
    let cycles = value("Total Cycles:")? / f64::from(ITERATIONS);
    Some(Model { cpu: cpu.into(), cycles, throughput: value("Block RThroughput:")? })
}
