//! The call tree of `rayo step` as lines of text.

use crate::{BOLD, DIM, GREEN, RED, styled};
use rayo_lab::experiments::step::{Argument, Change, Line, Node, Value, Watched};
use rayo_lab::measure::instructions::Mix;

/// Options for showing the tree.
pub struct How {
    /// Macros nested deeper than this take one line each.
    pub depth: Option<usize>,
    /// The only macro that is shown, if given.
    pub only: Option<String>,
    /// Whether errors against exact values are shown.
    pub error: bool,
    /// Whether colours are used.
    pub colour: bool,
}

impl How {
    fn styled(&self, style: &str, text: &str) -> String {
        styled(self.colour, style, text)
    }
}

/// The width of the column with the instruction's source.
const SOURCE: usize = 44;

/// The whole text.
pub fn text(watched: &Watched, how: &How) -> String {
    let mut out = String::new();
    out += &format!("{}\n", how.styled(BOLD, &title(watched)));
    nodes(&mut out, &watched.tree, watched, how, 0, how.only.is_none());
    out + "\n"
        + &if how.error { dearest(watched, how.only.as_deref()) } else { String::new() }
        + &outcome(watched)
        + &work(watched)
}

/// A line that says what is followed.
pub fn title(watched: &Watched) -> String {
    let Watched { engine, precision, pixel, lane, lanes, .. } = watched;
    let of = match pixel {
        Some([x, y]) => format!("pixel {x},{y} by {engine} in {precision}"),
        None => format!("one operation by {engine}"),
    };
    let lane = lane.map_or(String::new(), |lane| format!(", lane {lane} of {lanes}"));
    of + &lane
}

/// A number of instructions, in words.
pub fn count(instructions: usize) -> String {
    if instructions == 1 { "1 instruction".into() } else { format!("{instructions} instructions") }
}

/// The line for instructions that pad to an alignment, in words.
pub fn padding(instructions: usize) -> String {
    format!("{} of padding up to an alignment", count(instructions))
}

/// The line for omitted rounds of a loop, in words.
pub fn others(rounds: usize, instructions: usize) -> String {
    let rounds = if rounds == 1 { "one round".into() } else { format!("{rounds} rounds") };
    format!("… {rounds} for other pixels or without effect on this one: {}", count(instructions))
}

fn nodes(out: &mut String, of: &[Node], watched: &Watched, how: &How, depth: usize, told: bool) {
    let indent = "  ".repeat(depth);
    for node in of {
        match node {
            Node::Kernel { symbol, says, children } => {
                if told {
                    let says = if says.is_empty() { String::new() } else { format!(" - {says}") };
                    *out += &format!("\n{}{}\n", how.styled(BOLD, symbol), how.styled(DIM, &says));
                }
                if told && how.depth == Some(0) {
                    continue;
                }
                nodes(out, children, watched, how, depth + 1, told);
            }
            Node::Macro { name, says, file, line, comment, arguments, instructions, children } => {
                let wanted = told || how.only.as_deref() == Some(name);
                let folded = how.depth.is_some_and(|most| depth >= most);
                if wanted {
                    let count = count(*instructions);
                    if folded {
                        let values = values(arguments);
                        *out += &format!(
                            "{indent}{line:>4}  {}{values}  {}\n",
                            how.styled(BOLD, name),
                            how.styled(DIM, &count)
                        );
                        continue;
                    }
                    let mark = if comment.is_empty() { String::new() } else { format!("  ; {comment}") };
                    *out += &format!("{indent}{line:>4}  {}{}\n", how.styled(BOLD, name), how.styled(DIM, &mark));
                    let says = if says.is_empty() { String::new() } else { format!("{says} ") };
                    *out += &format!("{indent}      {}\n", how.styled(DIM, &format!("{says}({file}, {count})")));
                }
                nodes(out, children, watched, how, depth + 1, wanted);
            }
            Node::Once { instructions, children } => {
                let title = format!("{indent}      once for the row: {instructions} instructions\n");
                if told {
                    *out += &how.styled(DIM, &title);
                }
                if !(told && how.depth.is_some_and(|most| depth >= most)) {
                    nodes(out, children, watched, how, depth + 1, told);
                }
            }
            Node::Step(at) if told => {
                *out += &indent;
                step(out, &watched.steps[*at], how);
            }
            Node::Padding(count) if told => {
                *out += &how.styled(DIM, &format!("{indent}      {}\n", padding(*count)));
            }
            Node::Others { rounds, instructions } if told => {
                *out += &how.styled(DIM, &format!("{indent}      {}\n", others(*rounds, *instructions)));
            }
            Node::Step(_) | Node::Padding(_) | Node::Others { .. } => {}
        }
    }
}

fn step(out: &mut String, line: &Line, how: &How) {
    let Line { line: number, source, changed, compared, branch, comment, unknown, overturned, made, .. } = line;
    let padded = format!("{source:<SOURCE$}");
    let padded = if *made || branch.is_some() { padded } else { how.styled(DIM, &padded) };
    let mut told: Vec<_> = changed.iter().map(|change| changes(change, how)).collect();
    if how.error {
        for Lost { error, cancelled } in changed.iter().filter_map(lost) {
            told.push(cancelled.map_or(error.clone(), |cancelled| format!("{error}; {}", how.styled(RED, &cancelled))));
        }
    }
    if *overturned {
        told.push(how.styled(RED, OVERTURNED));
    }
    told.extend(compared.clone());
    if let Some(branch) = branch {
        let taken = if branch.taken { "taken" } else { "not taken" };
        told.push(format!("{} {}", how.styled(GREEN, taken), branch.why));
    }
    let comment = if comment.is_empty() { String::new() } else { how.styled(DIM, &format!("  ; {comment}")) };
    *out += &format!("{number:>4}  {padded}  {}{comment}", told.join("; "));
    out.truncate(out.trim_end().len());
    *out += "\n";
    if let Some(unknown) = unknown {
        *out += &format!("      {}\n", how.styled(RED, &format!("the model: {unknown}")));
    }
}

/// The values of a register: a single element as it is, several in brackets.
pub fn elements(values: &[Value]) -> String {
    match values {
        [value] => value.to_string(),
        values => format!("({})", values.iter().map(Value::to_string).collect::<Vec<_>>().join(", ")),
    }
}

fn changes(change: &Change, how: &How) -> String {
    let Change { name, before, after, .. } = change;
    let (before, after) = (elements(before), elements(after));
    format!("{} {} {} {}", how.styled(BOLD, name), how.styled(DIM, &before), how.styled(DIM, "→"), after)
}

/// The remark on a decision that exact values would turn out differently.
pub const OVERTURNED: &str = "exact values would decide otherwise";

/// The errors of a change, in words.
pub struct Lost {
    /// How far the elements are from exact values.
    pub error: String,
    /// How many bits cancelled, if they are worth mentioning.
    pub cancelled: Option<String>,
}

/// The errors of a change; None if no exact value is known.
pub fn lost(change: &Change) -> Option<Lost> {
    let Change { error_ulp, added_ulp, cancelled_bits, after, .. } = change;
    let known = || error_ulp.iter().flatten().copied();
    known().next()?;
    let ulp = |values: &[Option<f64>]| {
        let values: Vec<_> = values.iter().map(|v| v.map_or("?".into(), in_ulp)).collect();
        if values.len() == 1 { values[0].clone() } else { format!("({})", values.join(", ")) }
    };
    let mut error = format!("error {} ulp", ulp(error_ulp));
    if known().any(|error| error != 0.0) {
        error += &format!(", of which {} added here", ulp(added_ulp));
    }
    let digits = if after.iter().any(|value| matches!(value, Value::Double(_))) { 53 } else { 24 };
    let cancelled = cancelled_bits.iter().flatten().max().filter(|&&bits| bits > MUCH);
    Some(Lost { error, cancelled: cancelled.map(|bits| format!("{bits} of {digits} bits cancelled here")) })
}

/// More cancelled bits than this are mentioned.
const MUCH: u32 = 2;

/// An error in units of the last place, with three digits.
fn in_ulp(error: f64) -> String {
    match error.abs() {
        0.0 => "0".into(),
        size if (0.01..1000.0).contains(&size) => format!("{error:.2}"),
        _ => format!("{error:.1e}"),
    }
}

/// The instructions that lost most accuracy, with the macros around them. If only one macro is
/// shown, instructions outside of it are marked.
pub fn dearest(watched: &Watched, only: Option<&str>) -> String {
    let mut out = String::new();
    if !watched.dearest.iter().any(|&at| watched.steps[at].cost() > LITTLE) {
        return format!("digits: no instruction cost more than {LITTLE} units of the last place\n");
    }
    for &at in &watched.dearest {
        let line = &watched.steps[at];
        let Line { file, line: number, source, macros, .. } = line;
        let bits = line.cancelled_bits.iter().flatten().max().copied().unwrap_or(0);
        let cost = in_ulp(line.cost());
        let path: Vec<_> = macros.iter().map(|call| call.name).collect();
        let path = if path.is_empty() { String::new() } else { format!(", in {}", path.join(" > ")) };
        let outside = only.filter(|only| macros.iter().all(|call| call.name != *only));
        let outside = outside.map_or(String::new(), |only| format!(", outside of {only}"));
        out += &format!("digits: {source} ({file}:{number}{path}{outside}) cost {cost} ulp; {bits} bits cancelled\n");
    }
    out
}

/// A loss that is not worth mentioning: a few roundings, slightly amplified by cancellation.
const LITTLE: f64 = 10.0;

/// The inputs and results of a macro.
pub fn values(arguments: &[Argument]) -> String {
    let mut told = String::new();
    for Argument { name, kind, values, .. } in arguments {
        let Some([before, after]) = values else { continue };
        told += &match *kind {
            "in" => format!("  {name} {}", elements(before)),
            "out" => format!("  {name} → {}", elements(after)),
            kind if kind.starts_with("in/out") => format!("  {name} {} → {}", elements(before), elements(after)),
            _ => continue,
        };
    }
    told
}

/// The outcome: the hit and the colour of the ray, or the result of the operation.
pub fn outcome(watched: &Watched) -> String {
    let mut out = String::new();
    let Watched { precision, hit, colour, result, same_as_twin, failure, .. } = watched;
    // In the engine's precision, so that f32 are printed with as few digits as identify them.
    let number = |v: f64| if *precision == "double" { Value::Double(v) } else { Value::Single(v as f32) };
    let vector = |v: &[f64; 3]| elements(&v.map(number));
    if colour.is_some() {
        out += &match hit {
            Some(hit) => {
                let normal = hit.normal.as_ref().map_or(String::new(), |n| format!(", N = {}", vector(n)));
                format!("hits {} at t = {}, P = {}{normal}\n", hit.object, number(hit.t), vector(&hit.point))
            }
            None => "hits nothing\n".into(),
        };
    }
    if let Some([r, g, b]) = colour {
        out += &format!("colour ({r}, {g}, {b}), linear\n");
    }
    if let Some(result) = result {
        let values: Vec<_> = result.iter().map(f32::to_string).collect();
        out += &format!("result ({})\n", values.join(", "));
    }
    match (same_as_twin, failure) {
        (_, Some(failure)) => out += &format!("{failure}\n"),
        (Some(true), None) => out += "its twin returns the same bits, and the call keeps the calling convention\n",
        _ => {}
    }
    out
}

/// The number of instructions and their kinds, and how thoroughly the model of them was checked.
pub fn work(watched: &Watched) -> String {
    let Watched { instructions, unknown, bits_compared, kinds, .. } = watched;
    let Mix { arithmetic, shuffle, load, store, branch, r#move, other, .. } = kinds;
    let kinds = [
        (arithmetic, "arithmetic"),
        (shuffle, "shuffles"),
        (load, "loads"),
        (store, "stores"),
        (branch, "jumps"),
        (r#move, "moves"),
        (other, "others"),
    ];
    let counted =
        |(n, name): &(&usize, &str)| format!("{n} {}", if **n == 1 { name.trim_end_matches('s') } else { name });
    let kinds: Vec<_> = kinds.iter().filter(|(count, _)| **count > 0).map(counted).collect();
    format!(
        "{instructions} instructions: {}\n\
         the model of the instructions against the CPU: {bits_compared} bits compared, {unknown} unknown or wrong\n",
        kinds.join(", ")
    )
}
