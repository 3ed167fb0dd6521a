//! Times a user's operation and ours in turns.

use super::subjects::{Subject, of_calls, operation};
use super::{code, subject};
use crate::measure::instructions::Mix;
use rayo::internals::kernels::step::{self, Unavailable};
use rayo::internals::kernels::{OpRef, sys};

/// The implementations that a user's function is compared with.
pub const AGAINST: [&str; 4] = ["paper", "aos", "c-O3", "glam"];
/// The name of the user's own function.
pub const YOURS: &str = "yours";

/// How many times each contestant is timed, and how many measurements each time has.
const ROUNDS: u32 = 5;
const REPEATS: u32 = 5;

/// A function that is timed.
pub struct Contestant {
    pub name: &'static str,
    subject: Subject,
}

/// What calls of a contestant cost, in cycles of the core.
#[derive(Clone, Copy, Debug)]
pub struct Cost {
    pub contestant: &'static str,
    pub latency: Option<f64>,
    pub throughput: Option<f64>,
}

impl Contestant {
    /// A user's function for an operation of ours.
    pub fn of_operation(name: &str, op: OpRef) -> Self {
        Contestant { name: YOURS, subject: operation(name, op) }
    }

    /// A user's function that is called by `call` with `operands`, which returns some bits of the
    /// result.
    pub fn of_calls<T: Clone + 'static>(address: usize, operands: T, call: impl Fn(&T) -> u32 + 'static) -> Self {
        Contestant { name: YOURS, subject: of_calls(address, operands, call) }
    }

    /// Our implementations of an operation that run on this CPU.
    pub fn ours(name: &str) -> Vec<Self> {
        let contestant =
            |implementation| Some(Contestant { name: implementation, subject: subject(name, implementation).ok()? });
        AGAINST.into_iter().filter_map(contestant).collect()
    }

    /// The number of instructions that a call executes, and for each of the function's first
    /// `bytes` bytes how often an instruction that begins there was executed.
    ///
    /// # Errors
    /// If nothing can be single-stepped here.
    pub fn executed(&self, bytes: usize) -> Result<step::Visits, Unavailable> {
        step::count_function(self.subject.address, bytes, || {
            (self.subject.run)(0);
        })
    }
}

/// Times all contestants in turns, on one core.
pub fn costs(contestants: &[Contestant]) -> Vec<Cost> {
    // Failing to pin the thread makes the figures noisier, not wrong.
    let _ = sys::pin_to_this_core();
    let mut costs: Vec<_> =
        contestants.iter().map(|of| Cost { contestant: of.name, latency: None, throughput: None }).collect();
    let fewer = |a: Option<f64>, b: Option<f64>| a.into_iter().chain(b).reduce(f64::min);
    for _ in 0..ROUNDS {
        for (contestant, cost) in contestants.iter().zip(&mut costs) {
            let [latency, throughput] = (contestant.subject.cost)(REPEATS);
            cost.latency = fewer(cost.latency, latency);
            cost.throughput = fewer(cost.throughput, throughput);
        }
    }
    costs
}

/// The instructions of an implementation in [`AGAINST`]: those of the function, and those of its
/// body.
pub fn instructions(op: &str, implementation: &str) -> Option<(Mix, Option<Mix>)> {
    let code = code(op, implementation, subject(op, implementation).ok().as_ref())?;
    Some((code.function(), code.body()))
}
