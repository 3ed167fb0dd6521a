//! A kernel's crash in words: the signal, the instruction with its line of the source, and the
//! address.

use std::fmt::Write;
use std::ops::Range;

use iced_x86::{OpKind, Register};

use super::instructions::{Decoded, decode_raw, functions};
use super::source::{Origin, Unit};
use rayo::internals::kernels::crash::Crash;
use rayo::internals::kernels::{self, Isa};

// Numbers of Linux on x86-64, the only system on which crashes are described.
const SIGILL: i32 = 4;
const SIGABRT: i32 = 6;
const SIGBUS: i32 = 7;
const SIGFPE: i32 = 8;
const SIGSEGV: i32 = 11;
/// The code of a fault that does not come from memory management: a vector that is not aligned, or
/// an address that is not canonical.
const SI_KERNEL: i32 = 0x80;

/// The addresses of all kernels in assembly that this CPU runs, and of the functions of the engine
/// `c`.
pub fn code_of_kernels() -> Vec<Range<usize>> {
    let mut ranges: Vec<_> = Isa::ALL.into_iter().filter_map(Unit::code_of).collect();
    ranges.extend(functions_of_c().into_iter().map(|function| function.addresses));
    ranges
}

/// A function of the engine `c`.
struct FunctionOfC {
    symbol: &'static str,
    addresses: Range<usize>,
}

/// The functions of the engine `c`.
fn functions_of_c() -> Vec<FunctionOfC> {
    let Some(c) = kernels::c() else { return Vec::new() };
    let known = functions();
    let mut found = Vec::new();
    for (symbol, address) in c.functions() {
        if let Some(function) = known.iter().find(|function| function.symbol == symbol) {
            found.push(FunctionOfC { symbol, addresses: address..address + function.bytes });
        }
    }
    found
}

/// Describes a crash in several lines, the last without a line end. `symbol` is the kernel that was
/// called, if it is known.
pub fn describe(crash: &Crash, symbol: Option<&str>) -> String {
    let rip = crash.rip as usize;
    let unit = Isa::ALL.into_iter().filter_map(Unit::of).find(|unit| unit.code.contains(&rip));
    let function =
        unit.and_then(|unit| unit.function(rip)).map(|function| (function.symbol.to_owned(), function.address));
    let in_c = || {
        let found = functions_of_c().into_iter().find(|function| function.addresses.contains(&rip));
        found.map(|function| (function.symbol.to_owned(), function.addresses.start))
    };
    let function = function.or_else(in_c);
    let name = function.as_ref().map(|(name, _)| name.as_str()).or(symbol).unwrap_or("a kernel");
    let mut text = format!("{name} crashed: {}", signal(crash.signal));
    let decoded = kernels::code_at(rip).and_then(|code| decode_raw(code, crash.rip).next());
    if let Some(Decoded { instruction, raw }) = decoded {
        let offset = function.map_or(String::new(), |(_, start)| format!(" (byte {} of it)", rip - start));
        write!(text, "\n  instruction {}{offset}", instruction.text).expect("a string");
        if let Some(Origin { calls, number, text: line, .. }) = unit.and_then(|unit| unit.origin(rip)) {
            let unit = unit.expect("it has the origin");
            let file = unit.file(calls.last().copied());
            write!(text, "\n  source      {file}:{number}: {line}").expect("a string");
            let macros: Vec<_> = calls.iter().map(|&call| unit.macros[unit.calls[call].of].name).collect();
            write!(text, "\n  macros      {}", macros.join(" > ")).expect("a string");
        }
        if let Some(why) = cause(crash, &raw) {
            write!(text, "\n  cause       {why}").expect("a string");
        }
    } else {
        write!(text, "\n  instruction at {rip:#x}, where there is no code").expect("a string");
    }
    text
}

/// A signal's name, with what it stands for.
pub fn signal(number: i32) -> String {
    match number {
        SIGSEGV => "SIGSEGV, an access to memory".into(),
        SIGBUS => "SIGBUS, an access to memory".into(),
        SIGILL => "SIGILL, an instruction that this CPU does not have".into(),
        SIGFPE => "SIGFPE, an exception in arithmetic".into(),
        SIGABRT => "SIGABRT, as of a panic or a failed assertion".into(),
        other => format!("signal {other}"),
    }
}

/// What was wrong with the memory access or with the arithmetic.
pub fn cause(crash: &Crash, raw: &iced_x86::Instruction) -> Option<String> {
    if crash.signal == SIGFPE {
        return Some(match crash.code {
            1 => "a division by 0 in general registers, or a quotient that is too large".into(),
            _ => "an exception of floating point that MXCSR does not mask".into(),
        });
    }
    if crash.signal == SIGILL {
        return None;
    }
    let memory = (0..raw.op_count()).find(|&index| raw.op_kind(index) == OpKind::Memory);
    let operand = memory.and_then(|index| {
        raw.virtual_address(index, 0, |register, _, _| match register {
            Register::ES | Register::CS | Register::SS | Register::DS => Some(0),
            _ if register.is_gpr64() => Some(crash.general[register.number()]),
            _ => None,
        })
    });
    let size = raw.memory_size().size() as u64;
    match (operand, crash.code) {
        (Some(address), SI_KERNEL) if size > 1 && address % size != 0 => {
            Some(format!("the address {address:#x} is not a multiple of {size}, as this instruction needs it"))
        }
        (Some(address), SI_KERNEL) => Some(format!("{address:#x} is no address")),
        (_, 1) => Some(format!("nothing is mapped at the address {:#x}", crash.address)),
        (_, 2) => Some(format!("the memory at the address {:#x} may not be accessed like this", crash.address)),
        _ => Some(format!("the address {:#x}", crash.address)),
    }
}
