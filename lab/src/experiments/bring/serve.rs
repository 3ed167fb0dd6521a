//! What a process with a user's code does: it loads the code, and reports what it finds.

use std::fs::File;
use std::io::{self, Read};

use super::call::{Session, tell};
use super::figures;
use super::findings::{Fault, Finding, Request, Stage};
use super::{convention, memory, proof, steps, tracer, values};
use rayo::internals::kernels::foreign::{Function, Limits, Loaded, OwnProcess};

/// Bytes of memory that such a process may have.
const MEMORY: u64 = 4 << 30;
/// A longer request is not read to its end, and so refused.
const MOST_REQUESTED: u64 = 16 << 20;

/// Reads a request from standard input, and reports to what was standard output.
///
/// # Errors
/// If there is no request, or the system refuses what the process needs.
pub fn serve() -> io::Result<()> {
    let mut bytes = Vec::new();
    io::stdin().take(MOST_REQUESTED).read_to_end(&mut bytes)?;
    let request: Request = serde_json::from_slice(&bytes)?;
    let (own, report) = OwnProcess::begin(Limits { seconds: request.seconds, memory: MEMORY })?;
    let loaded = Loaded::open(&request.shared, &own);
    let function = loaded.and_then(|loaded| {
        loaded.function(&request.symbol, request.offset).ok_or_else(|| format!("no function `{}`", request.symbol))
    });
    match function {
        Ok(function) => try_operation((&own, &report), &request, function)?,
        Err(error) => tell(&own, &report, &Finding::Undone(format!("it cannot be loaded: {error}"))),
    }
    tell(&own, &report, &Finding::Done);
    // Nothing of the code is to run any more, such as what it wants done at the end.
    own.end()
}

fn try_operation((own, report): (&OwnProcess, &File), request: &Request, function: Function) -> io::Result<()> {
    let mut session = Session::new((own, report), request, function)?;
    match request.stage {
        Stage::Values if request.wanted.is_tracer() => tracer::check_pictures(&mut session),
        Stage::Memory if request.wanted.is_tracer() => tracer::check_memory(&session)?,
        Stage::Figures if request.wanted.is_tracer() => tracer::time(&session),
        Stage::Values => check_values(&mut session),
        Stage::Memory => memory::check(&session)?,
        Stage::Figures => figures::measure(&session),
        Stage::Steps => steps::record(&session),
        Stage::Proof => proof::prove(&session),
    }
    Ok(())
}

/// The stage of results and of the calling convention.
fn check_values(session: &mut Session<'_>) {
    let outcome = values::check(session);
    if outcome.is_ok() {
        let aliasing = memory::check_aliasing(session);
        session.tell(&Finding::Aliasing(aliasing));
    }
    let mut faults = convention::faults(session, outcome.is_ok());
    let changed = session.own.changed_handlers();
    if !changed.is_empty() {
        let list = changed.iter().map(usize::to_string).collect::<Vec<_>>().join(", ");
        faults.push(Fault::new(format!("it changes what signals do: {list}")));
    }
    // If a call did not return, what other calls kept says nothing: only broken rules are reported.
    if outcome.is_ok() || !faults.is_empty() {
        session.tell(&Finding::Convention(faults.clone()));
    }
    match outcome {
        Err(crash) => session.tell(&Finding::Crash(crash)),
        Ok(()) if memory::keeps_the_red_zone(session) == Some(false) => {
            faults.push(Fault::new("it keeps data more than 128 bytes under rsp, where a signal writes over it"));
            session.tell(&Finding::Convention(faults));
        }
        Ok(()) => {}
    }
}
