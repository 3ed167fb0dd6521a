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
use rayo::internals::kernels::{Vec4, crash};

/// The signal of the timer: a call took too long. As Linux and others number it.
pub const SIGPROF: i32 = 27;

/// What a result is before the call: a signalling NaN, which no computation gives.
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

/// Where the arguments and the result of a call lie, in numbers.
pub struct Places {
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

    /// The result for a sample, in memory with room around it.
    ///
    /// # Errors
    /// The crash, if the call did not return.
    pub fn call(&mut self, sample: &Sample) -> Result<Vec<f32>, Box<Crash>> {
        let places = Places::of(self.wanted, sample);
        self.call_in(places, sample)
    }

    /// The same in these places.
    ///
    /// # Errors
    /// As [`Session::call`].
    pub fn call_in(&mut self, places: Places, sample: &Sample) -> Result<Vec<f32>, Box<Crash>> {
        let Outcome { crash, broken } = self.function.examine(places.registers());
        if self.own.is_copy() {
            tell(self.own, self.report, &Finding::Copy);
        }
        for rule in broken.into_iter().flat_map(|call| call.broken) {
            if !self.broken.contains(&rule) {
                self.broken.push(rule);
            }
        }
        match crash {
            Some(crashed) => Err(Box::new(self.crash(&crashed.crash, sample))),
            None => Ok(places.result(self.wanted.gives)),
        }
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
            signal: crash.signal,
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
    /// A place of its own for each.
    pub fn of(wanted: &Wanted, sample: &Sample) -> Self {
        let mut arguments: Vec<_> = sample.arguments.iter().map(|numbers| vectors(numbers)).collect();
        // Whether an argument is read that is not given, the guard pages tell.
        if arguments.len() < 2 {
            arguments.push(vectors(&[f32::from_bits(UNWRITTEN); 16]));
        }
        // Room behind the result, so that what is written there spoils nothing of ours.
        let out = vectors(&vec![f32::from_bits(UNWRITTEN); wanted.gives.numbers() + ROOM]);
        Places { arguments, out }
    }

    fn registers(&self) -> [u64; 6] {
        let address = |vectors: &Vec<Vec4>| vectors.as_ptr().expose_provenance() as u64;
        let mut registers = [0; 6];
        registers[0] = address(&self.out);
        for (register, argument) in registers[1..].iter_mut().zip(&self.arguments) {
            *register = address(argument);
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

/// The arguments and the result of a call, each next to a guard page.
pub struct FencedPlaces {
    pub out: Fenced,
    pub arguments: Vec<Fenced>,
    /// What the arguments were.
    pub before: Vec<Vec<u8>>,
}

/// The bytes of numbers.
pub fn bytes_of(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_ne_bytes()).collect()
}

impl FencedPlaces {
    /// # Errors
    /// If there is no memory for them.
    pub fn of(wanted: &Wanted, sample: &Sample, side: Side) -> io::Result<Self> {
        let unwritten = vec![f32::from_bits(UNWRITTEN); wanted.gives.numbers()];
        let out = Fenced::new(&bytes_of(&unwritten), wanted.gives.align(), side)?;
        let before: Vec<_> = sample.arguments.iter().map(|numbers| bytes_of(numbers)).collect();
        let mut arguments = Vec::new();
        for (bytes, kind) in before.iter().zip(&wanted.takes) {
            arguments.push(Fenced::new(bytes, kind.align(), side)?);
        }
        // An argument that is not given lies where nothing may be read.
        if arguments.len() < 2 {
            arguments.push(Fenced::new(&[], 16, side)?);
        }
        Ok(FencedPlaces { out, arguments, before })
    }

    /// Its parts by name.
    pub fn parts(&self) -> Vec<(&'static str, &Fenced)> {
        [("its result", &self.out)].into_iter().chain(["a", "b"].into_iter().zip(&self.arguments)).collect()
    }

    pub fn registers(&self) -> [u64; 6] {
        let mut registers = [0; 6];
        registers[0] = self.out.address() as u64;
        for (register, argument) in registers[1..].iter_mut().zip(&self.arguments) {
            *register = argument.address() as u64;
        }
        registers
    }
}
