//! The JSON document of the experiment; `docs/experiment.schema.json` is its schema.

use serde::{Deserialize, Serialize};

use super::claims::Claim;
use super::jumps::Jumps;
use super::ladder::{AgainstCompiler, Explanation, Rung};
use super::speedup::{BASELINE, CONTROL, Speedup, Timing};
use super::sweeps::Sweep;
use crate::measure::Machine;

/// All that was measured, on which machine and with which settings.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Experiment {
    pub machine: Machine,
    pub conditions: Conditions,
    #[serde(flatten)]
    pub table: Speedup,
    /// The rungs of the ladder; empty without `--ladder`.
    pub ladder: Vec<Rung>,
    /// The packet engines compared with compiled code; empty without `--ladder`.
    pub against_compiler: Vec<AgainstCompiler>,
    /// Why the ladder has no counts of instructions, if it has none.
    pub uncounted: Option<String>,
    /// The factor between C and SIMD divided among its causes; empty if the rungs for it were not
    /// measured.
    pub explanations: Vec<Explanation>,
    /// Time per pixel from small pictures to large ones; None if the run was stopped before it.
    pub jumps: Option<Jumps>,
    /// Cost in objects and lights; empty if the run was stopped before it.
    pub sweeps: Vec<Sweep>,
    /// Why parts of the measurement allow no verdict: it was preempted too often, or two
    /// measurements of the same ratio disagree.
    pub disturbed: Vec<String>,
    pub verdicts: Vec<Claim>,
}

/// The conditions of the measurement, and what could have disturbed it.
#[derive(Clone, Debug, Default, Deserialize, Serialize)]
pub struct Conditions {
    /// The core that the thread was pinned to; None if it could not be pinned.
    pub core: Option<usize>,
    /// Runs of each size, each in a process of its own.
    pub runs: usize,
    pub complete: bool,
    pub seconds: f64,
    /// The share of those seconds that was spent in timed work.
    pub timed_share: Option<f64>,
    /// The share of those seconds in which the thread was preempted by other programs.
    pub taken_share: Option<f64>,
}

impl Experiment {
    /// The rows of each size that was finished.
    pub fn sizes(&self) -> impl Iterator<Item = &[Timing]> {
        self.table.rows.chunk_by(|a, b| a.width == b.width && a.height == b.height)
    }

    /// Why the rows form no table: a size lacks C or SIMD, or has not the same engines as the first
    /// size.
    pub fn gap(&self) -> Option<String> {
        let who = |rows: &[Timing]| rows.iter().map(|row| (row.engine.clone(), row.output.clone())).collect::<Vec<_>>();
        let first = who(self.sizes().next().unwrap_or_default());
        self.sizes().find_map(|rows| {
            let lacks = [BASELINE, CONTROL].into_iter().find(|name| !rows.iter().any(|row| row.is(name)));
            let what = match lacks {
                Some(name) => format!("no {name}"),
                None if who(rows) != first => "other engines than the first size".into(),
                None => return None,
            };
            Some(format!("in its rows, {}x{} has {what}", rows[0].width, rows[0].height))
        })
    }
}
