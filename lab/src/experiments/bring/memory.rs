//! The check of memory: guard pages, arguments at the same address, and the red zone.

use std::io;

use iced_x86::{InstructionInfoFactory, OpAccess};

use super::call::{FencedPlaces, Part, SIGPROF, Session};
use super::findings::{Crash, FENCED_INPUTS, Fault, Finding};
use super::wanted::{Sample, Trial};
use crate::measure::instructions::decode_raw_at;
use rayo::internals::kernels::crash;
use rayo::internals::kernels::fences::Side;
use rayo::internals::kernels::step::{MemoryOperand, count_instructions, memory_operand};

/// What a function does to memory that is not its own.
#[derive(Default)]
pub struct MemoryFaults {
    faults: Vec<Fault>,
    /// Whether one of them is a write.
    writes: bool,
}

impl MemoryFaults {
    fn add(&mut self, fault: Fault, writes: bool) {
        self.writes |= writes;
        if !self.faults.contains(&fault) {
            self.faults.push(fault);
        }
    }

    /// Adds a crash beside one of these parts of memory.
    fn add_crash(&mut self, session: &Session<'_>, crash: &crash::Crash, parts: &[Part]) {
        let decoded = decode_raw_at(crash.rip);
        let instruction = decoded.as_ref().map(|(instruction, _)| instruction.text.clone());
        let line = session.line(crash.rip);
        let operand = decoded.as_ref().and_then(|(_, raw)| memory_operand(raw, &crash.general));
        let unknown = MemoryOperand { address: crash.address, bytes: 1 };
        let MemoryOperand { address, bytes: size } = operand.unwrap_or(unknown);
        let is_write = decoded.as_ref().is_some_and(|(_, raw)| writes(raw));
        let verb = if is_write { "writes" } else { "reads" };
        let nearest = parts.iter().min_by_key(|part| address.abs_diff(part.address()));
        let part = nearest.expect("a call has a result");
        let (name, bytes) = (part.name, part.place.len());
        let offset = address.wrapping_sub(part.address()).cast_signed();
        let rule = match (bytes, offset) {
            _ if offset.unsigned_abs() > 1 << 16 => {
                let Crash { what, cause, .. } = session.crash(crash, &Sample { arguments: Vec::new() });
                format!("crashes: {}", [Some(what), cause].into_iter().flatten().collect::<Vec<_>>().join(", "))
            }
            (0, _) => format!("{verb} {name}, which `{}` is not given", session.wanted.name()),
            (_, 0) => format!("{verb} {} of {name}, which has {bytes}", count(size)),
            (_, 1..) => format!("{verb} {} from byte {offset} of {name}, which has {bytes}", count(size)),
            (_, _) => format!("{verb} {} from {} before {name}", count(size), count(offset.unsigned_abs() as usize)),
        };
        self.add(Fault { rule, instruction, line }, is_write);
    }

    pub fn tell(self, session: &Session<'_>) {
        session.tell(&Finding::Memory { faults: self.faults, writes: self.writes });
    }
}

/// Calls the function with each argument next to guard pages, on either side, and reports what it
/// touches beside them.
///
/// # Errors
/// If there is no memory for an argument.
pub fn check(session: &Session<'_>) -> io::Result<()> {
    let trials = session.request.trials();
    let mut faults = MemoryFaults::default();
    'sides: for side in Side::ALL {
        for (index, trial) in trials.iter().enumerate() {
            session.note(index as u64);
            let places = FencedPlaces::of(session.wanted, &trial.sample, side)?;
            if !call_between_fences(session, places.registers(), &places.parts, &mut faults) {
                break 'sides;
            }
        }
    }
    faults.tell(session);
    Ok(())
}

/// Makes one call, and adds what it does to `faults`. False if it did not come to an end in time.
pub fn call_between_fences(
    session: &Session<'_>,
    registers: [u64; 6],
    parts: &[Part],
    faults: &mut MemoryFaults,
) -> bool {
    let crash = session.examine(registers).crash;
    if let Some(crashed) = &crash {
        faults.add_crash(session, &crashed.crash, parts);
    }
    for Part { role, name, place, before } in parts {
        if before.as_ref().is_some_and(|before| place.bytes(before.len()) != *before) {
            faults.add(Fault::new(format!("writes over {role}{name}")), true);
        }
        if let Some(spoiled) = place.spoiled() {
            let spoiled = distance(spoiled, place.len());
            faults.add(Fault::new(format!("writes beside {role}{name}: {spoiled}")), true);
        }
    }
    crash.is_none_or(|crashed| crashed.crash.signal != SIGPROF)
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

/// Whether an instruction writes memory.
fn writes(raw: &iced_x86::Instruction) -> bool {
    let mut factory = InstructionInfoFactory::new();
    let is_write = |access| {
        matches!(access, OpAccess::Write | OpAccess::CondWrite | OpAccess::ReadWrite | OpAccess::ReadCondWrite)
    };
    factory.info(raw).used_memory().iter().any(|memory| is_write(memory.access()))
}

/// Calls the function with the result in the place of an argument, and with one argument in the
/// place of the other, and returns what is wrong with that.
pub fn check_aliasing(session: &Session<'_>) -> Vec<Fault> {
    let trials = session.wanted.trials(FENCED_INPUTS, session.request.seed);
    let (takes, gives) = (&session.wanted.takes, session.wanted.gives);
    let mut faults = Vec::new();
    for (argument, name) in ["a", "b"].into_iter().take(takes.len()).enumerate() {
        // A result that is longer would lie beyond the argument.
        if takes[argument].bytes() >= gives.bytes() && takes[argument].align() >= gives.align() {
            let place = format!("where it lies in the place of {name}");
            let fault = |trial: &Trial| fault_if_aliased(session, &trial.sample, [0, 1 + argument], &place);
            faults.extend(trials.iter().find_map(fault));
        }
    }
    if takes.len() == 2 && takes[0] == takes[1] {
        let fault = |trial: &Trial| {
            let twice = Sample { arguments: vec![trial.sample.arguments[0].clone(); 2] };
            fault_if_aliased(session, &twice, [2, 1], "where a and b are the same address")
        };
        faults.extend(trials.iter().find_map(fault));
    }
    faults
}

/// What is wrong with a call in which one register has the address in another one; 0 is that of the
/// result. Nothing is known of what crashes without that too.
fn fault_if_aliased(session: &Session<'_>, sample: &Sample, aliased: [usize; 2], place: &str) -> Option<Fault> {
    let bytes = session.wanted.gives.bytes();
    let apart = FencedPlaces::of(session.wanted, sample, Side::Before).ok()?;
    if session.examine(apart.registers()).crash.is_some() {
        return None;
    }
    // In places of its own: the call may have written over its arguments.
    let together = FencedPlaces::of(session.wanted, sample, Side::Before).ok()?;
    let mut registers = together.registers();
    registers[aliased[0]] = registers[aliased[1]];
    if let Some(crashed) = session.examine(registers).crash {
        let Crash { what, instruction, line, .. } = session.crash(&crashed.crash, sample);
        return Some(Fault { rule: format!("crashes {place}: {what}"), instruction, line });
    }
    // Where the result lies.
    let part = if aliased[0] == 0 { aliased[1] } else { 0 };
    let why = ["", ": it is written before a was read", ": it is written before b was read"][part];
    let is_same = same_numbers(&apart.result(), &together.parts[part].place.bytes(bytes));
    (!is_same).then(|| Fault::new(format!("a different result {place}{why}")))
}

/// Whether the bytes are the same numbers: any NaN equals any NaN.
fn same_numbers(a: &[u8], b: &[u8]) -> bool {
    let number = |bytes: &[u8]| f32::from_ne_bytes(bytes.try_into().expect("four bytes"));
    let same = |(a, b): (&[u8], &[u8])| a == b || number(a).is_nan() && number(b).is_nan();
    a.chunks_exact(4).zip(b.chunks_exact(4)).all(same)
}

/// Whether the results stay the same where a signal interrupts the function after every
/// instruction. Signals leave 128 bytes under the stack pointer alone, and may write over what
/// lies further under it. None where nothing can be single-stepped, or where a call does not end.
pub fn keeps_the_red_zone(session: &Session<'_>) -> Option<bool> {
    let trials = session.wanted.trials(FENCED_INPUTS, session.request.seed);
    for trial in trials.iter().step_by(10) {
        let undisturbed = FencedPlaces::of(session.wanted, &trial.sample, Side::Before).ok()?;
        if session.examine(undisturbed.registers()).crash.is_some() {
            return None;
        }
        let places = FencedPlaces::of(session.wanted, &trial.sample, Side::Before).ok()?;
        let mut crash = None;
        let counted = count_instructions(|| crash = session.examine(places.registers()).crash);
        match crash {
            Some(crashed) if crashed.crash.signal == SIGPROF => return None,
            // It jumped to an address that it had left there.
            Some(_) => return Some(false),
            None => counted.ok()?,
        };
        if !same_numbers(&undisturbed.result(), &places.result()) {
            return Some(false);
        }
    }
    Some(true)
}

#[cfg(test)]
mod tests {
    use super::super::call::bytes_of;
    use super::*;
    use rayo::internals::kernels::fences::Fenced;

    #[test]
    fn places_beside_an_argument_are_told_by_their_distance() {
        assert_eq!(distance(4, 4), "1 byte after its 4 bytes");
        assert_eq!(distance(15, 4), "12 bytes after its 4 bytes");
        assert_eq!(distance(-8, 16), "8 bytes before it");
    }

    #[test]
    fn what_a_fenced_argument_does_not_have_is_not_read() {
        for bytes in [&[][..], &[1, 2, 3]] {
            let fenced = Fenced::new(bytes, 4, Side::After).unwrap();
            assert_eq!(fenced.bytes(bytes.len()), bytes);
            assert!(std::panic::catch_unwind(|| fenced.bytes(bytes.len() + 1)).is_err());
        }
        assert!(Fenced::new(&[1], 1 << 17, Side::Before).is_err());
    }

    #[test]
    fn numbers_are_the_same_by_their_bits_or_as_any_nan() {
        let bytes = |numbers: &[f32]| bytes_of(numbers);
        assert!(same_numbers(&bytes(&[1.0, f32::NAN]), &bytes(&[1.0, -f32::NAN])));
        assert!(!same_numbers(&bytes(&[0.0]), &bytes(&[-0.0])));
    }
}
