//! The check of memory: guard pages, arguments at the same address, and the red zone.

use std::io;

use iced_x86::{InstructionInfoFactory, OpAccess};

use super::call::{FencedPlaces, SIGPROF, Session};
use super::findings::{Fault, Finding};
use super::wanted::{Sample, Trial};
use crate::measure::instructions::decode_raw_at;
use rayo::internals::kernels::crash::Crash;
use rayo::internals::kernels::fences::{Fenced, Side};
use rayo::internals::kernels::step::{MemoryOperand, count_instructions, memory_operand};

/// How many inputs are tried between guard pages, or at the same address.
const INPUTS: u32 = 54;

/// Calls the function with each argument next to guard pages, on either side, and reports what it
/// touches beside them.
///
/// # Errors
/// If there is no memory for an argument.
pub fn check(session: &mut Session<'_>) -> io::Result<()> {
    let trials = session.wanted.trials(INPUTS, session.request.seed);
    let mut faults = Vec::new();
    for side in Side::ALL {
        for (index, trial) in trials.iter().enumerate() {
            session.note(index as u64);
            if !between_fences(session, &trial.sample, side, &mut faults)? {
                session.tell(&Finding::Memory(faults));
                return Ok(());
            }
        }
    }
    session.tell(&Finding::Memory(faults));
    Ok(())
}

/// Makes one call, and adds what is new to `faults`. False if no more calls make sense.
fn between_fences(session: &Session<'_>, sample: &Sample, side: Side, faults: &mut Vec<Fault>) -> io::Result<bool> {
    let places = FencedPlaces::of(session.wanted, sample, side)?;
    let outcome = session.function.examine(places.registers());
    let mut found = Vec::new();
    if let Some(crashed) = &outcome.crash {
        found.push(beyond(session, &crashed.crash, &places.parts()));
    }
    if let Some(place) = places.out.spoiled() {
        found.push(Fault::new(format!("writes beside its result: {}", distance(place, session.wanted.gives.bytes()))));
    }
    for ((name, argument), before) in ["a", "b"].iter().zip(&places.arguments).zip(&places.before) {
        if argument.bytes(before.len()) != *before {
            found.push(Fault::new(format!("writes over its argument {name}")));
        }
        if let Some(place) = argument.spoiled() {
            found.push(Fault::new(format!("writes beside its argument {name}: {}", distance(place, before.len()))));
        }
    }
    for fault in found {
        if !faults.contains(&fault) {
            faults.push(fault);
        }
    }
    Ok(outcome.crash.is_none_or(|crashed| crashed.crash.signal != SIGPROF))
}

/// A place in words: so many bytes before or after something of that length.
pub fn distance(place: isize, bytes: usize) -> String {
    match usize::try_from(place) {
        Ok(place) => format!("{} after its {bytes} bytes", count(place - bytes + 1)),
        Err(_) => format!("{} before it", count(place.unsigned_abs())),
    }
}

fn count(bytes: usize) -> String {
    if bytes == 1 { "1 byte".into() } else { format!("{bytes} bytes") }
}

/// A crash beside one of these parts of memory, in words.
pub fn beyond(session: &Session<'_>, crash: &Crash, parts: &[(&str, &Fenced)]) -> Fault {
    let decoded = decode_raw_at(crash.rip);
    let instruction = decoded.as_ref().map(|(instruction, _)| instruction.text.clone());
    let line = session.line(crash.rip);
    let operand = decoded.as_ref().and_then(|(_, raw)| memory_operand(raw, &crash.general));
    let unknown = MemoryOperand { address: crash.address, bytes: 1 };
    let MemoryOperand { address, bytes: size } = operand.unwrap_or(unknown);
    let verb = if decoded.as_ref().is_some_and(|(_, raw)| writes(raw)) { "writes" } else { "reads" };
    let nearest = parts.iter().min_by_key(|(_, place)| address.abs_diff(place.address() as u64));
    let (name, place) = nearest.expect("a call has a result");
    let bytes = place.len();
    let offset = address.wrapping_sub(place.address() as u64).cast_signed();
    let rule = match (bytes, offset) {
        _ if offset.unsigned_abs() > 1 << 16 => {
            let described = session.crash(crash, &Sample { arguments: Vec::new() });
            format!(
                "crashes: {}{}",
                described.what,
                described.cause.map_or(String::new(), |cause| format!(", {cause}"))
            )
        }
        (0, _) => format!("{verb} {name}, which `{}` is not given", session.wanted.name()),
        (_, 0) => format!("{verb} {} of {name}, which has {bytes}", count(size)),
        (_, 1..) => format!("{verb} {} from byte {offset} of {name}, which has {bytes}", count(size)),
        (_, _) => format!("{verb} {} from {} before {name}", count(size), count(offset.unsigned_abs() as usize)),
    };
    Fault { rule, instruction, line }
}

/// Whether an instruction writes memory.
fn writes(raw: &iced_x86::Instruction) -> bool {
    let mut factory = InstructionInfoFactory::new();
    let is_write = |access| {
        matches!(access, OpAccess::Write | OpAccess::CondWrite | OpAccess::ReadWrite | OpAccess::ReadCondWrite)
    };
    factory.info(raw).used_memory().iter().any(|memory| is_write(memory.access()))
}

/// Calls the function with the result in the place of an argument, and with one argument in the
/// place of the other.
pub fn check_aliasing(session: &mut Session<'_>) -> Vec<Fault> {
    let trials = session.wanted.trials(INPUTS, session.request.seed);
    let (takes, gives) = (session.wanted.takes.clone(), session.wanted.gives);
    let mut faults = Vec::new();
    for (index, name) in ["a", "b"].into_iter().take(takes.len()).enumerate() {
        // A result that is longer would lie beyond the argument.
        if takes[index].bytes() >= gives.bytes() && takes[index].align() >= gives.align() {
            let differs = |trial: &Trial| result_in_place_of(session, &trial.sample, index) == Some(false);
            if trials.iter().any(differs) {
                faults.push(Fault::new(format!(
                    "a different result where it lies in the place of {name}: it is written before {name} was read"
                )));
            }
        }
    }
    if takes.len() == 2 && takes[0] == takes[1] {
        let differs = |trial: &Trial| arguments_in_one_place(session, &trial.sample) == Some(false);
        if trials.iter().any(differs) {
            faults.push(Fault::new("a different result where a and b are the same address"));
        }
    }
    faults
}

/// Whether the result is the same in the place of an argument as elsewhere; None if a call crashes.
fn result_in_place_of(session: &Session<'_>, sample: &Sample, index: usize) -> Option<bool> {
    let places = FencedPlaces::of(session.wanted, sample, Side::Before).ok()?;
    let bytes = session.wanted.gives.bytes();
    let mut registers = places.registers();
    session.function.examine(registers).crash.is_none().then_some(())?;
    let apart = places.out.bytes(bytes);
    // The call may have written over its arguments: again from the start.
    let places = FencedPlaces::of(session.wanted, sample, Side::Before).ok()?;
    registers[1] = places.arguments[0].address() as u64;
    registers[2] = places.arguments[1].address() as u64;
    registers[0] = registers[1 + index];
    session.function.examine(registers).crash.is_none().then_some(())?;
    Some(same_numbers(&apart, &places.arguments[index].bytes(bytes)))
}

/// Whether the result for a twice the same address is that for two copies of a; None if a call
/// crashes.
fn arguments_in_one_place(session: &Session<'_>, sample: &Sample) -> Option<bool> {
    let twice = Sample { arguments: vec![sample.arguments[0].clone(), sample.arguments[0].clone()] };
    let bytes = session.wanted.gives.bytes();
    let call = |is_one: bool| {
        let places = FencedPlaces::of(session.wanted, &twice, Side::Before).ok()?;
        let mut registers = places.registers();
        registers[2] = if is_one { registers[1] } else { registers[2] };
        session.function.examine(registers).crash.is_none().then(|| places.out.bytes(bytes))
    };
    Some(same_numbers(&call(false)?, &call(true)?))
}

/// Whether the bytes are the same numbers: any NaN equals any NaN.
fn same_numbers(a: &[u8], b: &[u8]) -> bool {
    let number = |bytes: &[u8]| f32::from_ne_bytes(bytes.try_into().expect("four bytes"));
    let same = |(a, b): (&[u8], &[u8])| a == b || number(a).is_nan() && number(b).is_nan();
    a.chunks_exact(4).zip(b.chunks_exact(4)).all(same)
}

/// Whether the result changes where signals interrupt the function: then it keeps something further
/// under the stack pointer than the 128 bytes that signals leave alone. None where nothing can be
/// single-stepped.
pub fn keeps_the_red_zone(session: &Session<'_>) -> Option<bool> {
    let trials = session.wanted.trials(INPUTS, session.request.seed);
    let bytes = session.wanted.gives.bytes();
    for trial in trials.iter().step_by(10) {
        let places = FencedPlaces::of(session.wanted, &trial.sample, Side::Before).ok()?;
        session.function.examine(places.registers()).crash.is_none().then_some(())?;
        let undisturbed = places.out.bytes(bytes);
        let places = FencedPlaces::of(session.wanted, &trial.sample, Side::Before).ok()?;
        let mut crash = None;
        count_instructions(|| crash = session.function.examine(places.registers()).crash).ok()?;
        if crash.is_some() || !same_numbers(&undisturbed, &places.out.bytes(bytes)) {
            return Some(false);
        }
    }
    Some(true)
}

#[cfg(test)]
mod tests {
    use super::super::call::bytes_of;
    use super::*;

    #[test]
    fn places_beside_an_argument_are_told_by_their_distance() {
        assert_eq!(distance(4, 4), "1 byte after its 4 bytes");
        assert_eq!(distance(15, 4), "12 bytes after its 4 bytes");
        assert_eq!(distance(-8, 16), "8 bytes before it");
    }

    #[test]
    fn numbers_are_the_same_by_their_bits_or_as_any_nan() {
        let bytes = |numbers: &[f32]| bytes_of(numbers);
        assert!(same_numbers(&bytes(&[1.0, f32::NAN]), &bytes(&[1.0, -f32::NAN])));
        assert!(!same_numbers(&bytes(&[0.0]), &bytes(&[-0.0])));
    }
}
