//! The origin of an instruction of our kernels: its source line and the macros around it, from the
//! tables that build.rs makes.

use std::ops::Range;
use std::sync::OnceLock;

use object::{Object, ObjectSection, ObjectSymbol};

use rayo::internals::kernels::{self, Isa};

#[derive(Clone, Debug)]
pub struct Macro {
    pub name: &'static str,
    /// The file that defines it.
    pub file: &'static str,
    /// The first sentence of its comment: its purpose, or its formula.
    pub says: &'static str,
    pub parameters: Vec<Parameter>,
}

#[derive(Clone, Copy, Debug)]
pub struct Parameter {
    pub name: &'static str,
    /// The parameter's direction: `in`, `out`, `in/out` or `clobbered`.
    pub kind: &'static str,
    /// The parameter's description.
    pub says: &'static str,
}

/// A call of a macro in a kernel.
#[derive(Clone, Debug)]
pub struct Call {
    /// The index of the enclosing call.
    pub within: Option<usize>,
    /// The index of the macro.
    pub of: usize,
    /// The line number of the call, in the file of the enclosing macro.
    pub line: usize,
    pub text: &'static str,
    pub comment: &'static str,
    /// The arguments of the call: registers, addresses, labels.
    pub arguments: Vec<&'static str>,
}

/// An instruction in the sources.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    /// The instruction's offset from the beginning of the unit's code, in bytes.
    pub offset: usize,
    /// The index of the innermost enclosing macro call.
    pub call: Option<usize>,
    /// The number of the source line, in the file of that macro.
    pub number: usize,
    pub text: &'static str,
    pub comment: &'static str,
}

/// The origin of an instruction, in the macro where a reader looks for it. Macros of isa.inc and
/// packet.inc stand for one operation on every lane and are taken for the instruction itself.
#[derive(Clone, Debug)]
pub struct Origin {
    /// The indices of the enclosing macro calls, outermost first.
    pub calls: Vec<usize>,
    /// The number of the source line, in the file of the innermost macro.
    pub number: usize,
    pub text: &'static str,
    pub comment: &'static str,
}

/// Whether a macro stands for a single instruction, or only brackets some.
fn is_plain(of: &Macro) -> bool {
    let words = ["asm/include/isa.inc", "asm/include/packet.inc"];
    words.contains(&of.file) || ["OPERATION", "END_OPERATION", "DISTINCT"].contains(&of.name)
}

/// The kernels for an instruction set in this process, with their source lines.
#[derive(Debug)]
pub struct Unit {
    /// The addresses of the unit's code.
    pub code: Range<usize>,
    pub macros: Vec<Macro>,
    /// The calls of macros; an enclosing call comes before those in it.
    pub calls: Vec<Call>,
    /// The instructions, sorted by offset.
    lines: Vec<Line>,
    /// The functions: the offsets of each, and its name.
    functions: Vec<(Range<usize>, String)>,
}

impl Unit {
    /// The unit of an instruction set; None if this CPU does not run it, or if this build has no
    /// table.
    pub fn of(isa: Isa) -> Option<&'static Unit> {
        static UNITS: [OnceLock<Option<Unit>>; 3] = [const { OnceLock::new() }; 3];
        UNITS[isa as usize].get_or_init(|| Unit::read(isa)).as_ref()
    }

    /// The addresses of the unit's code, without reading its table of source lines.
    pub fn code_of(isa: Isa) -> Option<Range<usize>> {
        let known = kernels::packet_ops::<f32>(isa)?.first()?;
        let file = object::File::parse(Unit::object(isa)?).ok()?;
        let symbol = file.symbol_by_name(known.symbol())?;
        let start = known.address() - symbol.address() as usize;
        Some(start..start + file.section_by_name(".text")?.size() as usize)
    }

    fn object(isa: Isa) -> Option<&'static [u8]> {
        kernels::OBJECTS.iter().find(|(name, _)| *name == isa.name()).map(|(_, data)| *data)
    }

    fn read(isa: Isa) -> Option<Unit> {
        let code = Unit::code_of(isa)?;
        let table = kernels::LINES[isa as usize];
        if table.is_empty() {
            return None;
        }
        let file = object::File::parse(Unit::object(isa)?).ok()?;
        let text = file.section_by_name(".text")?;
        let mut functions: Vec<_> = file
            .symbols()
            .filter(|symbol| symbol.section_index() == Some(text.index()) && symbol.size() > 0)
            .filter_map(|symbol| {
                let start = symbol.address() as usize;
                Some((start..start + symbol.size() as usize, symbol.name().ok()?.to_owned()))
            })
            .collect();
        functions.sort_by_key(|(range, _)| range.start);
        let mut table = Table { bytes: table };
        let strings = table.strings();
        let macros = table.list(|table| Macro {
            name: strings[table.number()],
            file: strings[table.number()],
            says: strings[table.number()],
            parameters: table.list(|table| Parameter {
                name: strings[table.number()],
                kind: strings[table.number()],
                says: strings[table.number()],
            }),
        });
        let calls = table.list(|table| Call {
            within: table.number().checked_sub(1),
            of: table.number(),
            line: table.number(),
            text: strings[table.number()],
            comment: strings[table.number()],
            arguments: table.list(|table| strings[table.number()]),
        });
        let mut end = 0;
        let lines = table.list(|table| {
            let offset = end + table.number();
            end = offset + table.number();
            let call = table.number().checked_sub(1);
            let number = table.number();
            Line { offset, call, number, text: strings[table.number()], comment: strings[table.number()] }
        });
        Some(Unit { code, macros, calls, lines, functions })
    }

    /// The source line of the instruction at `address`.
    pub fn line(&self, address: usize) -> Option<&Line> {
        let offset = address.checked_sub(self.code.start)?;
        self.lines.binary_search_by_key(&offset, |line| line.offset).ok().map(|place| &self.lines[place])
    }

    /// The macro calls that enclose a line, the outermost first.
    pub fn calls_of(&self, line: &Line) -> Vec<usize> {
        let mut calls: Vec<_> = std::iter::successors(line.call, |&call| self.calls[call].within).collect();
        calls.reverse();
        calls
    }

    /// The origin of the instruction at `address`.
    pub fn origin(&self, address: usize) -> Option<Origin> {
        let line = self.line(address)?;
        let mut calls = self.calls_of(line);
        let (mut number, mut text, mut comment) = (line.number, line.text, line.comment);
        while let Some(&last) = calls.last()
            && is_plain(&self.macros[self.calls[last].of])
        {
            Call { line: number, text, comment, .. } = self.calls[last];
            calls.pop();
        }
        Some(Origin { calls, number, text, comment })
    }

    /// Finds a function by its symbol, in the units that this CPU runs.
    pub fn with_function(symbol: &str) -> Option<FunctionInUnit> {
        Isa::ALL.into_iter().filter_map(Unit::of).find_map(|unit| {
            let (range, _) = unit.functions.iter().find(|(_, name)| name == symbol)?;
            Some(FunctionInUnit { unit, address: unit.code.start + range.start })
        })
    }

    /// The source file of a line in the macro call `call`.
    pub fn file(&self, call: Option<usize>) -> &'static str {
        call.map_or("", |call| self.macros[self.calls[call].of].file)
    }

    /// The function that contains the instruction at `address`.
    pub fn function(&self, address: usize) -> Option<Function<'_>> {
        let offset = address.checked_sub(self.code.start)?;
        let after = self.functions.partition_point(|(range, _)| range.start <= offset);
        let (range, name) = self.functions.get(after.checked_sub(1)?)?;
        range.contains(&offset).then_some(Function { symbol: name, address: self.code.start + range.start })
    }
}

/// A function of a unit.
#[derive(Clone, Copy, Debug)]
pub struct Function<'a> {
    pub symbol: &'a str,
    /// Its address in this process.
    pub address: usize,
}

/// A function's unit and address.
#[derive(Clone, Copy)]
pub struct FunctionInUnit {
    pub unit: &'static Unit,
    /// The function's address in this process.
    pub address: usize,
}

/// A table in the format that `build/listing.rs` describes, and a read position in it.
struct Table {
    bytes: &'static [u8],
}

impl Table {
    fn number(&mut self) -> usize {
        let (mut value, mut shift) = (0, 0);
        loop {
            let byte = self.bytes[0];
            self.bytes = &self.bytes[1..];
            value |= usize::from(byte & 0x7f) << shift;
            shift += 7;
            if byte & 0x80 == 0 {
                return value;
            }
        }
    }

    fn list<T>(&mut self, mut item: impl FnMut(&mut Self) -> T) -> Vec<T> {
        (0..self.number()).map(|_| item(self)).collect()
    }

    fn strings(&mut self) -> Vec<&'static str> {
        self.list(|table| {
            let length = table.number();
            let (string, rest) = table.bytes.split_at(length);
            table.bytes = rest;
            std::str::from_utf8(string).expect("build.rs wrote it")
        })
    }
}
