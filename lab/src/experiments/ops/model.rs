//! The estimate of a body's cycles by llvm-mca: a model, to be compared with measurement.

use std::io::Write;
use std::process::{Command, Stdio};

use serde::{Deserialize, Serialize};

use crate::measure::Name;
use crate::measure::instructions::{Class, Instruction};

/// The number of passes through the body that the model simulates.
const ITERATIONS: u32 = 100;

/// llvm-mca's estimate for a body in a loop.
#[derive(Clone, Debug, Deserialize, Serialize)]
pub struct Model {
    /// The modelled CPU by llvm-mca's name. `native` is this machine's, or its nearest predecessor
    /// that this version of llvm-mca knows.
    pub cpu: Name,
    /// Cycles per pass when pass follows pass, with the dependences between passes that their
    /// registers cause.
    pub cycles: f64,
    /// The least cycles per pass that the CPU's execution resources allow.
    pub throughput: f64,
}

/// The CPUs to model, in order of preference. A version of llvm-mca that is older than this
/// machine's CPU takes `native` for a predecessor, which may lack AVX-512; then the model of
/// another CPU is used.
const CPUS: [&str; 3] = ["native", "znver4", "icelake-server"];

/// The estimate for this machine's CPU, or for the first of [`CPUS`] that has the body's
/// instructions. None without llvm-mca, and for bodies with a jump or a symbol, which llvm-mca
/// cannot follow.
pub fn estimate(body: &[Instruction]) -> Option<Model> {
    if body.is_empty() || body.iter().any(|i| i.class == Class::Branch) {
        return None;
    }
    let mut source = String::from(".intel_syntax noprefix\n");
    for i in body {
        // The disassembly shows a symbol in angle brackets, which llvm-mca does not read.
        if i.text.contains(" <") {
            return None;
        }
        source += &i.text;
        source.push('\n');
    }
    CPUS.into_iter().find_map(|cpu| ask(cpu, &source))
}

/// Runs llvm-mca. None if it is not installed, does not know the CPU, or finds an instruction that
/// the CPU lacks.
fn ask(cpu: &'static str, source: &str) -> Option<Model> {
    let mut child = Command::new("llvm-mca")
        .args([&format!("-mcpu={cpu}"), "-mtriple=x86_64", &format!("-iterations={ITERATIONS}")])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .ok()?;
    // If llvm-mca closed the pipe early, its exit status and its output will show it.
    let _ = child.stdin.take()?.write_all(source.as_bytes());
    let output = child.wait_with_output().ok().filter(|output| output.status.success())?;
    // For an unknown CPU llvm-mca prints only this message, and models another CPU.
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
