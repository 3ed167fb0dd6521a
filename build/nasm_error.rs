//! Shortens NASM's error messages: NASM repeats each error for every use of a macro, level by
//! level.
//!
//! Its message begins with the line outside of all macros, and goes on to the innermost macro:
//!
//! ```text
//! asm/sse41.asm:16: error: parser: instruction expected
//! asm/ops/aos.asm:80: ... from macro `AOS_OPS' defined here
//! asm/include/vec3_aos.inc:110: ... from macro `VEC_DOT' defined here
//! ```

/// A line of a source.
struct Place<'a> {
    file: &'a str,
    number: usize,
}

/// Splits `file:number: rest`. A path may have a colon of its own.
fn split(line: &str) -> Option<(Place<'_>, &str)> {
    line.match_indices(": ").find_map(|(at, _)| {
        let (file, number) = line[..at].rsplit_once(':')?;
        Some((Place { file, number: number.parse().ok()? }, &line[at + 2..]))
    })
}

/// The macro that a line of the list below an error names.
fn macro_in(text: &str) -> Option<&str> {
    text.trim_start().strip_prefix("... from macro `")?.split_once('\'').map(|(name, _)| name)
}

/// The message of an error, or of a fatal error that ends the assembly.
fn error_in(text: &str) -> Option<&str> {
    ["error: ", "fatal: ", "panic: "].iter().find_map(|kind| text.strip_prefix(kind))
}

/// Lines that tell the first error among NASM's `messages`: its place, the text there, and the
/// macros around it. `line_of` gives a line of a file. None if there is no error among them.
pub fn first_error(messages: &str, line_of: impl Fn(&str, usize) -> Option<String>) -> Option<Vec<String>> {
    let is_error = |line: &&str| split(line).is_some_and(|(_, text)| error_in(text).is_some());
    let mut lines = messages.lines().skip_while(|line| !is_error(line));
    let (outermost, text) = split(lines.next()?)?;
    let message = error_in(text)?;
    let mut uses = vec![("", outermost)];
    uses.extend(lines.map_while(split).map_while(|(place, text)| Some((macro_in(text)?, place))));
    let (_, Place { file, number }) = uses.last().expect("there is the outermost");
    let mut told = vec![format!("{file}:{number}: {message}")];
    told.extend(line_of(file, *number).map(|line| format!("    {}", line.trim())));
    // A macro is used at the place in the entry before its own.
    for (used, (name, _)) in uses.iter().zip(&uses[1..]).rev() {
        let (_, Place { file, number }) = used;
        told.push(format!("in the macro {name}, used at {file}:{number}"));
    }
    let others = messages.lines().filter(is_error).count() - 1;
    if others > 0 {
        told.push(format!("NASM reports {others} more, of which most follow from this one"));
    }
    Some(told)
}
