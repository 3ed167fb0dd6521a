//! The JSON document of the experiment; `docs/experiment.schema.json` is its schema.

use serde::Serialize;

use super::speedup::{ControlRow, Row, Speedup};
use crate::measure::Machine;
use crate::measure::statistics::Estimate;

/// The number of the schema, in the document's field `schema`.
pub const SCHEMA: u32 = 1;

/// Everything that was measured, where, and with what.
#[derive(Clone, Debug, Serialize)]
pub struct Document {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The machine and the build.
    pub machine: Machine,
    /// The core that the thread was pinned to; None where it could not be.
    pub core: Option<usize>,
    /// Runs of each size.
    pub runs: usize,
    /// Whether every size that was asked for is there.
    pub complete: bool,
    /// No ratio closer to 1 than this is called a difference.
    pub noise_floor: f64,
    /// C/SIMD over all sizes.
    pub c_by_simd: Estimate,
    /// The paper's SIMD against itself, over all sizes.
    pub control_overall: Estimate,
    /// The same at each size.
    pub control: Vec<ControlRow>,
    /// The part of the run time that was spent in what is timed.
    pub timed_share: Option<f64>,
    /// Every engine at every size.
    pub rows: Vec<Row>,
}

impl Document {
    /// Puts together what belongs together.
    pub fn new(speedup: Speedup, machine: Machine, core: Option<usize>, runs: usize, seconds: f64) -> Self {
        Document {
            schema: SCHEMA,
            core,
            runs,
            complete: speedup.complete(),
            noise_floor: speedup.noise_floor,
            c_by_simd: speedup.c_by_simd,
            control_overall: speedup.control_overall,
            timed_share: machine.tsc_hz.map(|hz| speedup.timed_cycles / hz / seconds),
            control: speedup.control,
            rows: speedup.rows,
            machine,
        }
    }

    /// The sizes that were finished, each with its rows.
    pub fn sizes(&self) -> impl Iterator<Item = &[Row]> {
        self.rows.chunk_by(|a, b| a.width == b.width && a.height == b.height)
    }

    /// Of all runs of [`Document::rows`]: those that migrated, those that were off, and how many there are.
    pub fn odd_runs(&self) -> (usize, usize, usize) {
        let sum = |of: fn(&Row) -> usize| self.rows.iter().map(of).sum();
        (sum(|row| row.migrations), sum(|row| row.off), sum(|row| row.samples.len()))
    }
}
