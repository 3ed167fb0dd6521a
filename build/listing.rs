//! The table of source lines: for each instruction of a unit the macros that it came from, from
//! NASM's own listing.
//!
//! A listing has, for each line, its number in its file, the offset and bytes of its code if any,
//! its depth of nesting, and its text; and before the lines of a macro, the call with its
//! parameters expanded:
//!
//! ```text
//!    29                              <2>  VEC_DOT %%k, %%k, %%s
//!    29                              <2>  ;;; [macro] VEC_DOT {xmm10},{xmm10},{xmm11}
//!   109 000210FD 450F59D2            <3>  mulps %%d, %%b
//! ```
//!
//! NASM 2.15 has a call with its parameters one deeper, and continues counting lines where it
//! includes a file.
//!
//! `lab/src/measure/source.rs` reads the table: numbers of seven bits a byte, the lowest first, the
//! eighth bit meaning that more follow; and strings, each after its length. It consists of, each
//! list after its length,
//!
//! ```text
//! strings
//! macros:        name, file, the first sentence of its comment: strings; of each parameter its name, its direction, such as
//!                `in` or `out`, and its description: strings
//! calls:         the call that it stands in, 0 for none and else one more than its place in this list; macro; number of the
//!                line that calls it; that line and its comment: strings; its arguments: a list of strings
//! instructions:  bytes since the end of the one before; length; call, one more than its place; line; text, comment: strings
//! ```

use std::collections::HashMap;
use std::fs;
use std::path::Path;

use object::{Object, ObjectSection};

/// The definition of a macro.
struct Macro {
    name: usize,
    file: usize,
    says: usize,
    parameters: Vec<[usize; 3]>,
}

/// A call of a macro.
struct Call {
    within: usize,
    of: usize,
    line: usize,
    text: usize,
    comment: usize,
    arguments: Vec<usize>,
    /// The depth of the calling line.
    depth: usize,
}

struct Instruction {
    offset: usize,
    bytes: Vec<Option<u8>>,
    call: usize,
    line: usize,
    text: usize,
    comment: usize,
}

/// StringTable, each stored once.
#[derive(Default)]
struct StringTable {
    all: Vec<String>,
    places: HashMap<String, usize>,
}

impl StringTable {
    fn place(&mut self, text: &str) -> usize {
        if let Some(&place) = self.places.get(text) {
            return place;
        }
        self.places.insert(text.into(), self.all.len());
        self.all.push(text.into());
        self.all.len() - 1
    }
}

/// A line of a listing.
struct Line<'a> {
    number: usize,
    /// Offset and bytes in hexadecimal, as NASM writes them.
    code: Option<(usize, &'a str)>,
    depth: usize,
    text: &'a str,
}

impl<'a> Line<'a> {
    /// The columns: five for the number, eight for the offset, eighteen for bytes, then the depth.
    fn new(line: &'a str) -> Option<Self> {
        const NUMBER: usize = 6;
        const OFFSET: usize = 7;
        const BYTES: usize = 16;
        const DEPTH: usize = 35;
        let number = line.get(..NUMBER)?.trim().parse().ok()?;
        let offset = line.get(OFFSET..BYTES).and_then(|text| usize::from_str_radix(text.trim(), 16).ok());
        let end = line.get(BYTES..).and_then(|rest| rest.find(' ')).map_or(line.len(), |length| BYTES + length);
        let code = offset.map(|offset| (offset, line.get(BYTES..end).unwrap_or("")));
        let rest = line.get(DEPTH.max(if code.is_some() { end } else { 0 })..).unwrap_or("").trim_start();
        let nested = rest.strip_prefix('<').and_then(|rest| rest.split_once('>'));
        let (depth, text) = nested.and_then(|(depth, text)| Some((depth.parse().ok()?, text))).unwrap_or((0, rest));
        Some(Line { number, code, depth, text: text.trim() })
    }
}

/// Adds bytes as a listing writes them; None for those known only after linking.
fn add_bytes(bytes: &mut Vec<Option<u8>>, text: &str) {
    let text = text.trim_end_matches('-');
    let (mut known, mut at) = (true, 0);
    while at < text.len() {
        match text.as_bytes()[at] {
            b'(' | b'[' => (known, at) = (false, at + 1),
            b')' | b']' => (known, at) = (true, at + 1),
            _ => {
                let byte = u8::from_str_radix(&text[at..at + 2], 16).expect("two digits of a byte");
                bytes.push(known.then_some(byte));
                at += 2;
            }
        }
    }
}

/// The arguments of `{first},{second}`, which may have braces themselves.
fn arguments(text: &str) -> Vec<&str> {
    let mut found = Vec::new();
    let (mut depth, mut start) = (0, 0);
    for (at, letter) in text.char_indices() {
        match letter {
            '{' => {
                depth += 1;
                if depth == 1 {
                    start = at + 1;
                }
            }
            '}' => {
                depth -= 1;
                if depth == 0 {
                    found.push(&text[start..at]);
                }
            }
            _ => {}
        }
    }
    found
}

/// The content of the files in `asm`.
struct Sources {
    macros: Vec<Macro>,
    /// Indices of macros, by name.
    places: HashMap<String, usize>,
    /// Comments of lines by file and number.
    comments: HashMap<(usize, usize), usize>,
}

/// The first sentence of the comment above a macro, which begins with `; NAME - `; empty without one.
fn description(source: &str, name: &str) -> String {
    let heads = [format!("; {name} - "), format!("; {name}  - ")];
    let mut lines = source.lines().skip_while(|line| !heads.iter().any(|head| line.starts_with(head)));
    let Some((_, first)) = lines.next().and_then(|line| line.split_once("- ")) else { return String::new() };
    let mut said = first.trim().to_owned();
    for line in lines.map_while(|line| line.strip_prefix(';')).map(str::trim).take_while(|line| !line.is_empty()) {
        if sentence_end(&said) < said.len() || said.ends_with('.') {
            break;
        }
        said = format!("{said} {line}");
    }
    said.truncate(sentence_end(&said));
    said
}

/// The end of the first sentence of a text: a full stop before a capital letter, but not the dot of
/// a product or of `...`, which follows a space or a dot. The end of the text without one.
fn sentence_end(text: &str) -> usize {
    let is_end = |at: usize| {
        let begins = text[at + 2..].starts_with(|letter: char| letter.is_uppercase());
        begins && !text[..at].ends_with([' ', '.'])
    };
    text.match_indices(". ").map(|(at, _)| at).find(|at| is_end(*at)).map_or(text.len(), |at| at + 1)
}

fn read_sources(strings: &mut StringTable) -> Sources {
    let mut files: Vec<_> = ["asm/include", "asm/ops", "asm/tracers"]
        .iter()
        .flat_map(|folder| fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()))
        .collect();
    files.sort();
    let (mut macros, mut places, mut comments) = (Vec::new(), HashMap::new(), HashMap::new());
    for path in files {
        let text = fs::read_to_string(&path).unwrap();
        let file = strings.place(&path.to_str().unwrap().replace('\\', "/"));
        for (number, line) in text.lines().enumerate() {
            if let Some((_, comment)) = line.split_once(';') {
                comments.insert((file, number + 1), strings.place(comment.trim()));
            }
            if let Some(name) = line.strip_prefix("%macro ").and_then(|rest| rest.split_whitespace().next()) {
                let says = strings.place(&description(&text, name));
                places.insert(name.to_owned(), macros.len());
                macros.push(Macro { name: strings.place(name), file, says, parameters: Vec::new() });
            } else if let (Some(rest), Some(last)) = (line.strip_prefix("%define %%"), macros.last_mut())
                && let Some((name, rest)) = rest.split_once(" %")
                && let (number, comment) = rest.split_once(';').unwrap_or((rest, ""))
                && number.trim().parse() == Ok(last.parameters.len() + 1)
            {
                let (kind, says) = comment.trim().trim_start_matches('[').split_once(']').unwrap_or_default();
                last.parameters.push([name.trim(), kind.trim(), says.trim()].map(|text| strings.place(text)));
            }
        }
    }
    Sources { macros, places, comments }
}

/// By how many lines NASM 2.15 counts too many in each file, since it goes on counting in files
/// that are included.
#[derive(Default)]
struct Shifts {
    of_files: HashMap<usize, usize>,
    /// The open files: for each the depth of the line that includes it, and by how many lines its
    /// count is too high.
    open: Vec<(usize, usize)>,
    /// The previous line's file, if it includes one.
    included: Option<(usize, usize, usize)>,
}

impl Shifts {
    /// Takes the next line.
    fn take(&mut self, line: &Line<'_>, strings: &mut StringTable) {
        self.open.retain(|(depth, _)| *depth < line.depth);
        if let Some((depth, number, file)) = self.included.take() {
            let shift = if line.number == number + 1 { number } else { 0 };
            self.open.push((depth, shift));
            self.of_files.insert(file, shift);
        }
        if let Some(path) = line.text.strip_prefix("%include \"") {
            let file = strings.place(&format!("asm/{}", path.trim_end_matches('"')));
            self.included = Some((line.depth, line.number, file));
        }
    }

    /// The corrected number of a line: in the file of the macro around it, or else in the innermost
    /// open file.
    fn number(&self, line: &Line<'_>, around: Option<usize>) -> usize {
        let of = |file| self.of_files.get(&file).copied();
        line.number - around.map_or(self.open.last().map(|(_, shift)| *shift), of).unwrap_or(0)
    }
}

/// Whether `function` exists only for a measurement: a chain of one operation, or the tracer whose
/// operations are out of line.
fn is_measured(function: &str) -> bool {
    function.ends_with("_latency") || function.ends_with("_throughput") || function.starts_with("calls_")
}

/// The table of the unit of which NASM wrote `listing` and `object`.
///
/// # Panics
/// Where the bytes of an instruction are not those of the object.
pub fn table(listing: &Path, object: &Path) -> Vec<u8> {
    let mut strings = StringTable::default();
    let Sources { macros, places, comments } = read_sources(&mut strings);
    let nothing = strings.place("");
    let (mut calls, mut open): (Vec<Call>, Vec<usize>) = (Vec::new(), Vec::new());
    let mut instructions: Vec<Instruction> = Vec::new();
    let (mut text_section, mut wanted) = (false, false);
    let listing = fs::read_to_string(listing).unwrap();
    let (mut last_text, mut last_depth) = ("", 0);
    let (mut continues, mut shifts) = (false, Shifts::default());
    for line in listing.lines().filter_map(Line::new) {
        if let (true, Some((_, bytes))) = (continues, line.code) {
            continues = bytes.ends_with('-');
            if text_section && wanted && !bytes.contains('<') {
                add_bytes(&mut instructions.last_mut().expect("what goes on has begun").bytes, bytes);
            }
            continue;
        }
        shifts.take(&line, &mut strings);
        if let Some(section) = line.text.strip_prefix("section ") {
            text_section = section == ".text";
        }
        if let Some(call) = line.text.strip_prefix(";;; [macro] ") {
            let (name, rest) = call.split_once(' ').unwrap_or((call, ""));
            if name == "FUNC" {
                wanted = !is_measured(rest.trim_matches(['{', '}']));
            }
            let depth = line.depth.min(last_depth);
            open.retain(|&open| calls[open].depth < depth);
            if let Some(&of) = places.get(name) {
                let around = open.last().map(|&open: &usize| macros[calls[open].of].file);
                let number = shifts.number(&line, around);
                let comment = around.and_then(|file| comments.get(&(file, number))).copied().unwrap_or(nothing);
                let within = open.last().map_or(0, |&open| open + 1);
                let arguments = arguments(rest).into_iter().map(|argument| strings.place(argument)).collect();
                let text = strings.place(last_text);
                open.push(calls.len());
                calls.push(Call { within, of, line: number, text, comment, arguments, depth });
            }
            continue;
        }
        (last_text, last_depth) = (line.text, line.depth);
        let Some((offset, bytes)) = line.code else { continue };
        continues = bytes.ends_with('-');
        // Repeated bytes, which NASM marks by `<`, are padding up to an alignment.
        if !text_section || !wanted || bytes.contains('<') {
            continue;
        }
        while open.last().is_some_and(|&open| calls[open].depth >= line.depth) {
            open.pop();
        }
        let call = open.last().map_or(0, |&open| open + 1);
        let around = open.last().map(|&open| macros[calls[open].of].file);
        let number = shifts.number(&line, around);
        let comment = around.and_then(|file| comments.get(&(file, number))).copied().unwrap_or(nothing);
        let text = strings.place(line.text);
        let mut instruction = Instruction { offset, bytes: Vec::new(), call, line: number, text, comment };
        add_bytes(&mut instruction.bytes, bytes);
        instructions.push(instruction);
    }
    check(&instructions, object);
    write(&strings, &macros, &calls, &instructions)
}

/// Checks that the bytes in the listing are those of the object.
fn check(instructions: &[Instruction], object: &Path) {
    let data = fs::read(object).unwrap();
    let file = object::File::parse(&*data).unwrap();
    let text = file.sections().find(|section| matches!(section.name(), Ok(".text" | "__text"))).unwrap();
    let text = text.data().unwrap();
    assert!(!instructions.is_empty(), "NASM's listing has no instructions");
    for Instruction { offset, bytes, line, .. } in instructions {
        for (at, byte) in (*offset..).zip(bytes) {
            let byte = byte.unwrap_or(text[at]);
            assert_eq!(byte, text[at], "the listing differs from the object at {at:#x}, line {line}");
        }
    }
}

/// The table in the format that the head of this file describes, with only what instructions refer
/// to.
fn write(strings: &StringTable, macros: &[Macro], calls: &[Call], instructions: &[Instruction]) -> Vec<u8> {
    fn number(out: &mut Vec<u8>, mut value: usize) {
        while value >= 0x80 {
            out.push(value as u8 | 0x80);
            value >>= 7;
        }
        out.push(value as u8);
    }
    fn numbers(out: &mut Vec<u8>, values: &[usize]) {
        number(out, values.len());
        values.iter().for_each(|&value| number(out, value));
    }
    // Calls of macros that make no instruction are left out.
    let mut used = vec![false; calls.len() + 1];
    for instruction in instructions {
        let mut call = instruction.call;
        while call != 0 && !used[call] {
            used[call] = true;
            call = calls[call - 1].within;
        }
    }
    let mut places = vec![0; calls.len() + 1];
    let kept: Vec<_> = (1..=calls.len()).filter(|&call| used[call]).collect();
    for (place, &call) in kept.iter().enumerate() {
        places[call] = place + 1;
    }
    let mut new_strings = StringTable::default();
    let mut place = |old: usize| new_strings.place(&strings.all[old]);
    let mut body = Vec::new();
    number(&mut body, macros.len());
    for Macro { name, file, says, parameters } in macros {
        for string in [*name, *file, *says] {
            number(&mut body, place(string));
        }
        number(&mut body, parameters.len());
        for &string in parameters.iter().flatten() {
            number(&mut body, place(string));
        }
    }
    number(&mut body, kept.len());
    for call in kept {
        let Call { within, of, line, text, comment, arguments, .. } = &calls[call - 1];
        for value in [places[*within], *of, *line, place(*text), place(*comment)] {
            number(&mut body, value);
        }
        let arguments: Vec<_> = arguments.iter().map(|&argument| place(argument)).collect();
        numbers(&mut body, &arguments);
    }
    number(&mut body, instructions.len());
    let mut end = 0;
    for Instruction { offset, bytes, call, line, text, comment } in instructions {
        for value in [offset - end, bytes.len(), places[*call], *line, place(*text), place(*comment)] {
            number(&mut body, value);
        }
        end = offset + bytes.len();
    }
    let mut out = Vec::new();
    number(&mut out, new_strings.all.len());
    for string in &new_strings.all {
        number(&mut out, string.len());
        out.extend_from_slice(string.as_bytes());
    }
    out.extend(body);
    out
}
