//! Calls of a user's function: with numbers in aligned memory, or between guard pages.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;

use super::findings::{Crash, Finding, Request, told};
use super::lines::{Line, Lines};
use super::wanted::{Sample, Type, Wanted};
use crate::measure::crash::{cause, signal};
use crate::measure::instructions::decode_raw_at;
use rayo::internals::kernels::fences::{Fenced, Side};
use rayo::internals::kernels::foreign::{Function, Outcome, OwnProcess};
use rayo::internals::kernels::step::{Recording, record_until_crash};
use rayo::internals::kernels::{CheckedCall, Vec4, crash};

/// The signal of the timer: a call took too long. As Linux and others number it.
pub const SIGPROF: i32 = 27;

/// The bits of each number of a result before the call: those of a NaN that no computation gives.
pub const UNWRITTEN: u32 = 0xff80_dead;

/// Numbers behind a result that a call may write over without harm.
const ROOM: usize = 256;

/// A user's function in its process, and what reports about it.
pub struct Session<'a> {
    pub own: &'a OwnProcess,
    pub report: &'a File,
    pub request: &'a Request,
    pub wanted: &'a Wanted,
    pub function: Function,
    pub lines: Lines,
    progress: File,
    /// The rules that calls have broken so far.
    pub broken: Vec<rayo::internals::kernels::Fault>,
}

/// The arguments of a call and its result, in vectors.
struct Places {
    arguments: Vec<Vec<Vec4>>,
    out: Vec<Vec4>,
}

impl<'a> Session<'a> {
    /// # Errors
    /// If the file for the progress cannot be opened.
    pub fn new(
        (own, report): (&'a OwnProcess, &'a File),
        request: &'a Request,
        function: Function,
    ) -> io::Result<Self> {
        let wanted = &request.wanted;
        let progress = File::options().write(true).create(true).truncate(false).open(&request.progress)?;
        let lines = Lines::of(&request.shared);
        Ok(Session { own, report, request, wanted, function, lines, progress, broken: Vec::new() })
    }

    /// Reports a finding; a copy of the process that the code has made ends instead.
    pub fn tell(&self, finding: &Finding) {
        tell(self.own, self.report, finding);
    }

    /// Notes the number of the input that is tried next.
    pub fn note(&self, input: u64) {
        // Without it, the input is not named if the process dies of it.
        let _ = self.progress.write_all_at(&input.to_le_bytes(), 0);
    }

    /// Allows the next checked call the time that was requested.
    pub fn allow(&self) {
        self.own.allow(self.request.seconds);
    }

    /// Makes a checked call.
    pub fn examine(&self, registers: [u64; 6]) -> Outcome {
        self.allow();
        self.function.examine(registers)
    }

    /// Keeps the rules that checked calls broke.
    pub fn keep_broken(&mut self, calls: Vec<CheckedCall>) {
        for rule in calls.into_iter().flat_map(|call| call.broken) {
            if !self.broken.contains(&rule) {
                self.broken.push(rule);
            }
        }
    }

    /// The result for a sample, in memory with room around it.
    ///
    /// # Errors
    /// The crash, if the call did not return.
    pub fn call(&mut self, sample: &Sample) -> Result<Vec<f32>, Box<Crash>> {
        let mut places = Places::of(self.wanted, sample);
        let Outcome { crash, broken } = self.examine(places.registers());
        if self.own.is_copy() {
            tell(self.own, self.report, &Finding::Copy);
        }
        self.keep_broken(broken);
        match crash {
            Some(crashed) => Err(Box::new(self.crash(&crashed.crash, sample))),
            None => Ok(places.result(self.wanted.gives)),
        }
    }

    /// Records a call with the first input, at most that many instructions.
    ///
    /// # Errors
    /// Why there is nothing to be recorded, or it cannot be.
    pub fn record(&self, most: usize) -> Result<Recording, String> {
        let start = self.function.address();
        let watched = start..start + self.request.bytes.max(1);
        let trials = self.wanted.trials(1, self.request.seed);
        let trial = trials.first().ok_or("a tracer has too many; see `rayo step`")?;
        let places = FencedPlaces::of(self.wanted, &trial.sample, Side::Before).map_err(|error| error.to_string())?;
        self.allow();
        let all = 0..u64::MAX;
        let call = || self.function.call(places.registers());
        record_until_crash(&[watched], &[all], most, call).map_err(|reason| reason.to_string())
    }

    /// A crash in words.
    pub fn crash(&self, crash: &crash::Crash, sample: &Sample) -> Crash {
        let decoded = decode_raw_at(crash.rip);
        let what = match crash.signal {
            SIGPROF => format!("no answer within {} seconds of the CPU: does it loop for ever?", self.request.seconds),
            _ if is_stack(crash) => "SIGSEGV: the stack is full, as of calls without an end".into(),
            other => signal(other),
        };
        let cause = decoded.as_ref().filter(|_| crash.signal != SIGPROF).and_then(|(_, raw)| cause(crash, raw));
        Crash {
            what,
            stage: String::new(),
            cause,
            instruction: decoded.map(|(instruction, _)| instruction.text),
            line: self.line(crash.rip),
            arguments: told(self.wanted, sample),
        }
    }

    /// The line of the user's source with the instruction at `address`.
    pub fn line(&self, address: u64) -> Option<Line> {
        let base = self.function.address() as u64 - self.request.offset;
        self.lines.at(address.checked_sub(base)?)
    }
}

/// Whether a crash is of the stack's end: an access right around its pointer.
fn is_stack(crash: &crash::Crash) -> bool {
    const NEAR: u64 = 1 << 16;
    crash.code == 1 && crash.address != 0 && crash.address.abs_diff(crash.general[4]) < NEAR
}

/// Reports a finding, as [`Session::tell`].
pub fn tell(own: &OwnProcess, report: &File, finding: &Finding) {
    use std::io::Write;
    let mut line = serde_json::to_vec(finding).expect("findings are plain");
    line.push(b'\n');
    let mut report = report;
    // Nobody hears it if it cannot be written.
    let _ = report.write_all(&line);
    if own.is_copy() {
        own.end();
    }
}

impl Places {
    fn of(wanted: &Wanted, sample: &Sample) -> Self {
        let mut arguments: Vec<_> = sample.arguments.iter().map(|numbers| vectors(numbers)).collect();
        // Whether an argument is read that is not given, the guard pages tell.
        if arguments.len() < 2 {
            arguments.push(vectors(&[f32::from_bits(UNWRITTEN); 16]));
        }
        // Room behind the result, so that what is written there spoils nothing of ours.
        let out = vectors(&vec![f32::from_bits(UNWRITTEN); wanted.gives.numbers() + ROOM]);
        Places { arguments, out }
    }

    /// The addresses of the result and of the arguments: foreign code may write to any of them.
    fn registers(&mut self) -> [u64; 6] {
        let mut registers = [0; 6];
        for (register, vectors) in registers.iter_mut().zip([&mut self.out].into_iter().chain(&mut self.arguments)) {
            *register = vectors.as_mut_ptr().expose_provenance() as u64;
        }
        registers
    }

    fn result(&self, gives: Type) -> Vec<f32> {
        // What foreign code has written is not what the compiler may know of this memory.
        let out = std::hint::black_box(&self.out);
        out.iter().flat_map(|vector| vector.lanes()).take(gives.numbers()).collect()
    }
}

/// Numbers in memory that is aligned as vectors are.
pub fn vectors(numbers: &[f32]) -> Vec<Vec4> {
    let lane = |chunk: &[f32], index: usize| chunk.get(index).copied().unwrap_or(f32::from_bits(UNWRITTEN));
    let vector = |chunk: &[f32]| Vec4::from([0, 1, 2, 3].map(|index| lane(chunk, index)));
    numbers.chunks(4).map(vector).collect()
}

/// A part of the memory of a call, next to a guard page.
pub struct Part {
    /// What it is to the function, in words before its name: "its argument ".
    pub role: &'static str,
    pub name: &'static str,
    pub place: Fenced,
    /// What is in it before the call and has to stay; None of what the call is to write.
    pub before: Option<Vec<u8>>,
}

impl Part {
    /// # Errors
    /// If there is no memory for it.
    pub fn new(role: &'static str, name: &'static str, bytes: &[u8], align: usize, side: Side) -> io::Result<Self> {
        Ok(Part { role, name, place: Fenced::new(bytes, align, side)?, before: Some(bytes.to_vec()) })
    }

    pub fn address(&self) -> u64 {
        self.place.address() as u64
    }
}

/// The result of a call and then its arguments, each next to a guard page.
pub struct FencedPlaces {
    pub parts: Vec<Part>,
}

/// The bytes of numbers.
pub fn bytes_of(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_ne_bytes()).collect()
}

impl FencedPlaces {
    /// # Errors
    /// If there is no memory for them.
    pub fn of(wanted: &Wanted, sample: &Sample, side: Side) -> io::Result<Self> {
        let unwritten = bytes_of(&vec![f32::from_bits(UNWRITTEN); wanted.gives.numbers()]);
        let result = Part::new("", "its result", &unwritten, wanted.gives.align(), side)?;
        let mut parts = vec![Part { before: None, ..result }];
        for ((numbers, kind), name) in sample.arguments.iter().zip(&wanted.takes).zip(["a", "b"]) {
            parts.push(Part::new("its argument ", name, &bytes_of(numbers), kind.align(), side)?);
        }
        // An argument that is not given lies where nothing may be read.
        if parts.len() < 3 {
            parts.push(Part::new("its argument ", "b", &[], 16, side)?);
        }
        Ok(FencedPlaces { parts })
    }

    pub fn registers(&self) -> [u64; 6] {
        let mut registers = [0; 6];
        registers.iter_mut().zip(&self.parts).for_each(|(register, part)| *register = part.address());
        registers
    }

    /// The result as it is now.
    pub fn result(&self) -> Vec<u8> {
        let place = &self.parts[0].place;
        place.bytes(place.len())
    }
}
