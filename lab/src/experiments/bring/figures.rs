//! What calls of a user's function cost beside ours: executed instructions and cycles.

use std::cell::Cell;

use super::call::{Session, vectors};
use super::findings::{Cycles, Executed, Finding};
use super::wanted::{Sample, Truth};
use crate::experiments::ops::turns::{Contestant, YOURS, costs};
use rayo::internals::kernels::{Cycles as Counter, Vec4};

/// Counts and times, and reports both.
pub fn measure(session: &Session<'_>) {
    let mut contestants = vec![yours(session)];
    if let Truth::Operation(name) = &session.wanted.truth {
        contestants.extend(Contestant::ours(name));
    }
    let visits = match contestants[0].executed(session.request.bytes) {
        Ok(visits) => visits,
        Err(reason) => return session.tell(&Finding::Undone(format!("executed instructions: {reason}"))),
    };
    let body = session.request.body.and_then(|(start, end)| visits.at.get(start..end));
    let executed = Executed { function: visits.instructions, body: body.map(|body| body.iter().sum()) };
    session.tell(&Finding::Executed(executed));
    if !Counter::available() {
        return session.tell(&Finding::Undone("cycles: this machine has no time-stamp counter".into()));
    }
    let costs = costs(&contestants);
    let cycles = costs.iter().zip(&contestants).map(|(cost, contestant)| Cycles {
        contestant: contestant.name.into(),
        latency: cost.latency,
        throughput: cost.throughput,
        executed: if contestant.name == YOURS {
            Some(executed.function)
        } else {
            contestant.executed(0).ok().filter(|visits| visits.calls == 1).map(|visits| visits.instructions)
        },
    });
    session.tell(&Finding::Cycles(cycles.collect()));
}

/// The user's function, with the operands that ours have too.
fn yours(session: &Session<'_>) -> Contestant {
    if let (Truth::Operation(name), Some(like)) = (&session.wanted.truth, session.wanted.ours()) {
        return Contestant::of_operation(name, session.function.like(like));
    }
    /// Vectors of the longest argument.
    const MOST: usize = 4;
    let mut operands = [[Vec4::default(); MOST]; 2];
    let trials = session.wanted.trials(1, session.request.seed);
    let sample = trials.first().map_or_else(|| Sample { arguments: Vec::new() }, |trial| trial.sample.clone());
    for (operand, numbers) in operands.iter_mut().zip(&sample.arguments) {
        operand.iter_mut().zip(vectors(numbers)).for_each(|(to, from)| *to = from);
    }
    let function = session.function;
    // In a cell: foreign code may write to its arguments.
    Contestant::of_calls(function.address(), Cell::new(operands), move |operands| {
        let mut out = [Vec4::default(); MOST];
        let operands = operands.as_ptr().cast::<Vec4>();
        let addresses = [out.as_mut_ptr(), operands, operands.wrapping_add(MOST)];
        let [out_at, a, b] = addresses.map(|address| address.expose_provenance() as u64);
        function.call([out_at, a, b, 0, 0, 0]);
        std::hint::black_box(&out)[0].x.to_bits()
    })
}
